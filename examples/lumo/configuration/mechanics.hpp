#pragma once

#include <optional>
#include <string_view>

namespace lumo::program {

/// How presses are computed, as typed; the defaults are lumo's own mechanics.
struct Mechanics {
  enum class Solver { quasi_static, vbd };
  enum class Element { linear, quadratic };
  enum class Law { neo_hookean, newton };
  enum class Points { surface, vertex };

  bool paper = false;  ///< the paper's
  Solver solver = Solver::quasi_static;
  Element element = Element::quadratic;
  double size_mm = 0.0;  ///< of all edges; 0: graded, fine where the indenter touches
  int sweeps = 10;       ///< of vertex block descent, per time step
  Law law = Law::neo_hookean;
  double contact_stiffness_N_per_m3 = 1e11;
  Points points = Points::surface;
  double friction = 0.0;                   ///< Coulomb's coefficient
  std::optional<double> carrier_friction;  ///< of the pad on the carrier; nullopt: the same
  double hold_s = 1.0;                     ///< of vertex block descent, at each load; 0: the step at which it is met
  double record_margin_mm = 0.0;           ///< of the contact set; 0: where the surface touches
  std::optional<double> time_limit_s;  ///< of a scenario's press, wall clock; decides no result, only whether one is

  bool operator==(const Mechanics&) const = default;
  /// Does it hold the indenter, short of an equilibrium? Whoever asks for that has it scored.
  bool holds() const { return solver == Solver::vbd; }
  int mesh_order() const { return element == Element::linear ? 1 : 2; }
};

/// What the paper ran: linear tetrahedra of 1 mm, 10 sweeps of vertex block descent in each 0.01 s, Newton's damped
/// Neo-Hookean law, full-surface contact with Newton's own friction. Source: paper §III-B and its table of settings;
/// friction is Newton's default, which the paper does not mention.
inline Mechanics paper_mechanics() {
  Mechanics m;
  m.paper = true;
  m.solver = Mechanics::Solver::vbd;
  m.element = Mechanics::Element::linear;
  m.size_mm = 1.0;
  m.law = Mechanics::Law::newton;
  m.friction = 0.5;
  return m;
}

constexpr std::string_view name(Mechanics::Solver s) { return s == Mechanics::Solver::vbd ? "vbd" : "quasi_static"; }
constexpr std::string_view name(Mechanics::Element e) {
  return e == Mechanics::Element::linear ? "linear" : "quadratic";
}
constexpr std::string_view name(Mechanics::Law l) { return l == Mechanics::Law::newton ? "newton" : "neo_hookean"; }
constexpr std::string_view name(Mechanics::Points p) { return p == Mechanics::Points::vertex ? "vertex" : "surface"; }

}  // namespace lumo::program
