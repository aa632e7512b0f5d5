#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/solvers/press_system.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

namespace lumo {

/// What the steps with a kept factor have shown of a symmetric, positive definite tangent since it was made: the BFGS
/// correction of the factor's inverse (Matthies, Strang 1979, doi:10.1002/nme.1620141104), applied by Nocedal's two
/// loops (1980, doi:10.1090/S0025-5718-1980-0572855-7).
class SecantPairs {
 public:
  void clear() { pairs_.clear(); }

  /// A step with the change of the residual that came with it; of equal sizes. Without effect where the residual did
  /// not grow along the step beyond rounding: the corrected inverse stays positive definite.
  void add(Eigen::VectorXd step, Eigen::VectorXd change) {
    const double curvature = step.dot(change);
    if (curvature > 1e-12 * step.norm() * change.norm())
      pairs_.push_back({std::move(step), std::move(change), 1.0 / curvature});
  }

  /// Solution of the corrected system, where `factor` is that of the kept one: a function of a vector.
  template <class Factor> Eigen::VectorXd solve(Eigen::VectorXd residual, Factor&& factor) const {
    std::vector<double> along(pairs_.size());
    for (std::size_t k = pairs_.size(); k-- > 0;) {
      along[k] = pairs_[k].scale * pairs_[k].step.dot(residual);
      residual -= along[k] * pairs_[k].change;
    }
    Eigen::VectorXd solution = factor(residual);
    for (std::size_t k = 0; k < pairs_.size(); ++k)
      solution += (along[k] - pairs_[k].scale * pairs_[k].change.dot(solution)) * pairs_[k].step;
    return solution;
  }

 private:
  struct Pair {
    Eigen::VectorXd step, change;
    double scale;  ///< 1 / (step · change)
  };
  std::vector<Pair> pairs_;
};

/// Settings of the quasi-static solver.
struct QuasiStaticConfig {
  double residual_tolerance = 1e-7;  ///< of the load
  int max_iterations = 200;          ///< factorisations per load
  int stride_iterations = 20;        ///< factorisations before a stride is cut; twice as many near its end
  double chord_contraction = 0.02;   ///< a kept factor must shrink the residual by this factor per step
  /// By this one, when the residual is below 1 % of the load: a step costs a tenth of a factor.
  double late_contraction = 0.8;
  double load_stride = 1.6;   ///< loads in between are at most this factor apart
  double max_advance = 0.2;   ///< largest advance in one step, in radii of the indenter's contact
  double time_limit_s = 1e9;  ///< per scenario, wall clock; a solve ends at most one factorisation later
  PressWatch watch = {};      ///< called after each factorisation, and as a load ends
};

/// Throws InvalidArgument for settings out of range.
inline void validate(const QuasiStaticConfig& c) {
  require_in_range("residual tolerance", c.residual_tolerance, 1e-12, 1e-6, "of the load");  // the certificate's limit
  require_in_range("iterations per load", c.max_iterations, 1, 1 << 20, "");
  require_in_range("iterations per stride", c.stride_iterations, 1, 1 << 20, "");
  require_in_range("contraction of a kept factor", c.chord_contraction, 0.0, 1.0, "");
  require_in_range("late contraction of a kept factor", c.late_contraction, 0.0, 1.0, "");
  require_in_range("stride of loads", c.load_stride, 1.001, 1e6, "");
  require_in_range("largest advance of a step", c.max_advance, 1e-6, 1e3, "radii");
  require_in_range("time limit of a scenario", c.time_limit_s, 0.0, 1e12, "s");
}

/// Static equilibrium at prescribed loads: the indenter's advance is an unknown, so that each load is met exactly
/// (model: solver policy "quasi-static"). Newton's method on energy(x, s) − F s, load by load along 0 → F₁ → F₂ ….
///
/// The stiff parts of the energy, volume change and contact, are linearised about values that are carried on *linearly*
/// by each step (volume ratios θ, gaps γ) instead of those that the moved nodes happen to have: a step's second-order
/// errors in volume then make no spurious pressure, the tangent stays positive definite, and contact points change
/// sides by what the step meant. This is Newton's method for the mixed problem with θ and γ eliminated; its solution is
/// that of the plain one (Magisano, Leonetti, Garcea 2017 for stresses; Hintermüller, Ito, Kunisch 2002 for contact). A
/// factor is used again, corrected by what its steps show (SecantPairs), as long as it contracts.
///
/// A set of contact points that is too large loses its rim ring by ring, one factorisation each. So every stride starts
/// from a good guess of it: the points with the smallest gaps on the area that Hertz's formula gives for the first
/// load, and on the last area × (load/last)^0.6 after that. Where the tangent is lost on the way, the load is
/// approached again from the last state that was reached closely, in smaller strides that end closer to equilibrium.
///
/// With friction the residual is that of Coulomb's law and the tangent leaves out how friction grows with pressure, so
/// that it stays symmetric: convergence is linear, and states depend on the strides that lead to them.
///
/// Rounded edges of the carrier are taken as flat where they touch until the residual is small: their curvature makes
/// the tangent indefinite on the way. After that as much of it counts as leaves the tangent positive definite: about an
/// equilibrium that is none that lasts, steps without it move away slowly.
///
/// At each load the unshifted tangent of the *whole* body must be positive definite, fields that break the scenario's
/// symmetry included; otherwise the status says so.
template <LinearSolver Linear = EigenCholesky> struct QuasiStatic {
  template <class Material, class Contact, class Element> using Model = SectorModel<Material, Contact, Element, Linear>;
  using Config = QuasiStaticConfig;
  static constexpr bool uses_symmetry = true;
  Config config = {};

  /// Throws InvalidArgument for settings out of range.
  template <class Material, class Contact, class Element>
  std::unique_ptr<Model<Material, Contact, Element>> model(const Body& body, const TetMesh& mesh, Symmetry planes,
      const PressPhysics<Material, Contact, Element>& physics) const {
    validate(config);
    return std::make_unique<Model<Material, Contact, Element>>(body, mesh, planes, physics);
  }

  /// States at the scenario's loads, displacements on the sector's nodes, up to the first that is not converged; its
  /// status is the reason.
  template <class SomeModel, Indenter Tool>
  std::vector<MechanicalState> run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

template <class Model, Indenter Tool> class QuasiStaticRun {
 public:
  QuasiStaticRun(
      const Model& model, const Scenario<Tool>& scenario, const Touch& touch, const QuasiStaticConfig& config)
      : config_(config),
        model_(model),
        system_{model, scenario.indenter, touch.origin, scenario.direction()},
        eq_(model.blocks.front().equations),
        now_{positions_of(model.sector.mesh), 0.0, model.solid.volume_ratios(positions_of(model.sector.mesh))},
        touched_(model.touchable, model.contact, friction_coefficient(model.contact), now_.x, system_.indenter(0.0)),
        rested_(model.resting, model.contact, carrier_friction(model.contact), now_.x, system_.support()) {
    linear_.reserve(model.blocks.size());
    for (const auto& block : model.blocks) linear_.push_back(block.analysed);
  }

  /// Equilibrium at `load` (the sector's share), from where the last call ended.
  Status solve(double load) {
    iterations = 0;
    wanted_ = load;
    if (load_ == 0.0 && !(model_.solid.smallest_volume() > 0.0)) return Status::inverted;
    auto state = std::tie(now_, touched_, rested_, load_);
    // The last one that was reached closely: a loose one may be what led astray.
    std::tuple<typename System::Place, FrictionHistory, FrictionHistory, double> reached = state;
    double first = std::min(load, largest_first_load()) * (has_friction() ? first_share : 1.0),
           stride = config_.load_stride;
    double on_the_way = has_friction() ? close : loose;  // friction remembers where strides end
    for (int cuts = 0; load_ != load;) {
      const double next = load_ == 0.0 ? first : stride_end(load, stride),
                   tolerance = next == load ? config_.residual_tolerance : on_the_way;
      const Status s = load_ == 0.0 ? first_load(next, tolerance)
                                    : load_step(next, tolerance, touched_area() * std::pow(next / load_, 0.6));
      if (s == Status::converged) {
        load_ = next;
        touched_.settle(model_.touchable, model_.contact, system_.indenter(now_.advance), now_.x);
        rested_.settle(model_.resting, model_.contact, system_.support(), now_.x);
        if (tolerance <= close) {
          reached = state;
          stride = std::min(config_.load_stride, std::pow(stride, 1.4));
        }
        continue;
      }
      if (!is_lost(s) || ++cuts > most_cuts || iterations >= config_.max_iterations) return s;
      state = reached;
      first /= 4.0;
      stride = std::sqrt(stride);
      on_the_way = close;
    }
    return certify_stability();
  }

  const Positions& positions() const { return now_.x; }
  double advance() const { return now_.advance; }
  /// Tells whoever watches how far this is, and how the load ended if it did.
  void report(std::optional<Status> ended) const {
    const double share = model_.sector.fraction();
    const std::optional<double> residual = std::isfinite(residual_) ? std::optional(residual_) : std::nullopt;
    if (config_.watch) config_.watch({wanted_ / share, load_ / share, now_.advance, iterations, residual, ended});
  }
  /// Friction on the sector's nodes as parts of the whole body's, and the whole's push against the advance.
  FrictionForces friction() const;
  int iterations = 0;

 private:
  using System = PressSystem<Model, Tool>;
  bool has_friction() const { return touched_.coefficient > 0.0 || rested_.coefficient > 0.0; }

  // Residual over load at which a stride on the way may end, at first and after a loss.
  static constexpr double loose = 0.3, close = 1e-3;
  // Share of the carrier's curvature below which none is tried.
  static constexpr double least_curvature = 0.2;
  // Residual over load below which points seldom come and go, or change between sticking and sliding.
  static constexpr double settled = 1e-2;
  // Of the first load. A contact that has grown at once has slipped another way than one that grew.
  static constexpr double first_share = 0.1;
  static constexpr int most_cuts = 8;  // of the strides to one load

  /// Hertz's load for a contact half as wide as the indenter, on a half-space that keeps its volume.
  double largest_first_load() const {
    return model_.sector.fraction() * model_.solid.material().shear_modulus() * 2.0 / 3.0 *
           std::pow(contact_radius(system_.tool), 2);
  }
  double hertz_area(double load) const {
    const double share = model_.sector.fraction(), whole = load / share;
    return share * pi *
           std::pow(3.0 * whole * contact_radius(system_.tool) / (16.0 * model_.solid.material().shear_modulus()),
               2.0 / 3.0);
  }

  /// Where the next of equal strides from load_ to `load` ends.
  double stride_end(double load, double stride) const {
    const double strides = std::ceil(std::abs(std::log(load / load_)) / std::log(stride) - 1e-9);
    return strides <= 1.0 ? load : load_ * std::pow(load / load_, 1.0 / strides);
  }

  /// Reference area of the points that overlap now.
  double touched_area() const {
    double area = 0.0;
    const auto tool = system_.indenter(now_.advance);
    for (std::size_t f = 0; f < model_.touchable.size(); ++f)
      for (const SurfacePoint& p : model_.touchable.points(f))
        if (tool.distance(model_.touchable.position(f, p, now_.x)) < 0.0) area += p.area_m2;
    return area;
  }

  // From first touch. A softer contact forgives a wrong guess of its extent.
  static constexpr double first_penalty_scale = 0.1;
  Status first_load(double load, double tolerance) {
    system_.penalty_scale = first_penalty_scale;
    const Status s = load_step(load, loose, hertz_area(load));
    if (touched_.coefficient > 0.0) system_.touch_friction = &touched_;
    if (rested_.coefficient > 0.0) system_.rest_friction = &rested_;
    const double softer = std::exchange(system_.penalty_scale, 1.0);
    return s == Status::converged ? load_step(load, tolerance, 0.0, softer) : s;
  }

  // Equilibrium at a load, from contact on at least `area`. Overlaps so far were those of a contact with `softer` times
  // the penalty stiffness; pressures are kept.
  Status load_step(double load, double tolerance, double area, double softer = 1.0) {
    auto about = system_.values_at(now_);
    for (SurfaceGaps* gaps : {&about.touch, &about.rest})
      for (std::vector<double>& face : *gaps)
        for (double& g : face) g = g < 0.0 ? softer * g : g;
    touch_nearest(about.touch, area);
    Eigen::VectorXd before;  // residual at the start of the last step; none before the first factor
    double curvature = 1.0;  // of the carrier's, near the end
    for (const int stop = iterations + config_.stride_iterations;;) {
      Eigen::VectorXd r = system_.residual(now_.x, now_.advance, load, eq_, &about);
      const double unbalanced = r.norm();
      const bool nearly_there = unbalanced < settled * load;
      if (!std::isfinite(unbalanced)) return Status::non_finite;
      residual_ = unbalanced / load;
      // The plain residual is what counts; it is looked at when the linearised one is small.
      if (unbalanced <= tolerance * load) {
        const double plain = system_.residual(now_.x, now_.advance, load, eq_).norm();
        residual_ = plain / load;
        if (plain <= tolerance * load) return Status::converged;
      }
      if (is_out_of_time()) return Status::time_limit;
      if (before.size() > 0 &&
          unbalanced <= (nearly_there ? config_.late_contraction : config_.chord_contraction) * before.norm()) {
        steps_.add(std::move(last_step_), r - before);
      } else {
        const int last = nearly_there ? stop + config_.stride_iterations : stop;
        if (iterations >= std::min(last, config_.max_iterations)) return Status::max_iterations;
        ++iterations;
        touched_.turning = rested_.turning = nearly_there ? 1.0 : 0.0;
        about.curvature = nearly_there ? curvature : 0.0;
        system_.tangent(now_.x, now_.advance, 0, 1, tangent_, &about);
        const FactorStatus f = linear_.front().factorize(tangent_.matrix.front());
        if (f == FactorStatus::not_positive_definite && about.curvature > 0.0) {
          curvature = curvature > least_curvature ? 0.5 * curvature : 0.0;
          continue;
        }
        if (f != FactorStatus::positive_definite)
          return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
        if (!schur_complement()) return Status::not_positive_definite;
        factored_ = now_;
        steps_.clear();
        report({});
      }
      if (const Status s = step(r, about); s != Status::converged) return s;
      before = std::move(r);
    }
  }

  // Points that have just come into contact overlap, or gape, by the error of the last step. The next step undoes it;
  // it must not enter the tangent as pressure.
  static constexpr double just_touching = -1e-15;
  static void enter(SurfaceGaps& gaps, const SurfaceGaps& before) {
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k)
        if (gaps[f][k] < 0.0 && before[f][k] >= 0.0) gaps[f][k] = just_touching;
  }

  // Brings the points with the smallest gaps into contact until `area` [m²] is.
  void touch_nearest(SurfaceGaps& gaps, double area) const {
    struct Point {
      double gap, area_m2;
      auto operator<=>(const Point&) const = default;
    };
    std::vector<Point> points;
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k)
        points.push_back({gaps[f][k], model_.touchable.points(f)[k].area_m2});
    std::sort(points.begin(), points.end());
    double last = 0.0;
    for (std::size_t k = 0; k < points.size() && area > 0.0; ++k) {
      area -= points[k].area_m2;
      last = points[k].gap;
    }
    for (std::vector<double>& face : gaps)
      for (double& g : face)
        if (g >= 0.0 && g <= last) g = just_touching;
  }

  bool schur_complement() {
    response_ = roughly_solved(tangent_.coupling);
    schur_ = tangent_.stiffness - tangent_.coupling.dot(response_);
    return std::isfinite(schur_) && schur_ > 0.0;
  }

  // To the digits that a step needs, which is of a linearisation.
  Eigen::VectorXd roughly_solved(const Eigen::VectorXd& r) {
    if constexpr (RefiningSolver<Linear>) return linear_.front().precondition(r);
    else return linear_.front().solve(r);
  }

  // Solution with the last factor for all equations, the advance's included.
  Eigen::VectorXd solve_factored(const Eigen::VectorXd& r) {
    Eigen::VectorXd d(r.size());
    const Eigen::VectorXd z = roughly_solved(r.head(eq_.count));
    d[eq_.count] = (r[eq_.count] - tangent_.coupling.dot(z)) / schur_;
    d.head(eq_.count) = z - d[eq_.count] * response_;
    return d;
  }

  // A full step unless the indenter would jump, an element would be turned inside out, or lose most of the volume that
  // is predicted for it. The status names what refuses even the shortest step.
  static constexpr double least_volume = 0.2;  // of an element: of its present one, and by the prediction
  static constexpr int halvings = 20;
  Status step(const Eigen::VectorXd& r, typename System::LinearisationPoint& about) {
    const Eigen::VectorXd d = -steps_.solve(r, [&](const Eigen::VectorXd& rest) { return solve_factored(rest); });
    if (!d.allFinite()) return Status::non_finite;
    const double ds = d[eq_.count];
    double t = std::min(1.0, config_.max_advance * contact_radius(system_.tool) / std::max(std::abs(ds), 1e-300));
    Positions dx = Positions::Zero(3, now_.x.cols());
    System::move(dx, eq_, d, 1.0);
    Status refusal = Status::inverted;
    for (int k = 0; k < halvings; ++k, t *= 0.5) {
      typename System::Place trial{now_.x + t * dx, now_.advance + t * ds};
      trial.volumes = model_.solid.volume_ratios(trial.x);
      refusal = Status::inverted;
      if (!(trial.volumes.smallest > least_volume * now_.volumes.smallest)) continue;
      refusal = Status::line_search;
      auto next = system_.predicted(now_, factored_, t * dx, t * ds);
      if (!(*std::min_element(next.ratios.begin(), next.ratios.end()) > least_volume)) continue;
      enter(next.touch, about.touch);
      enter(next.rest, about.rest);
      about = std::move(next);
      now_ = std::move(trial);
      last_step_ = t * d;
      return Status::converged;
    }
    return refusal;
  }

  bool is_out_of_time() const { return watch_.seconds() > config_.time_limit_s; }

  // Tangents of all parities at the state that was reached.
  Status certify_stability() {
    if (is_out_of_time()) return Status::time_limit;
    typename System::Tangent t;
    system_.tangent(now_.x, now_.advance, 0, model_.blocks.size(), t);
    for (std::size_t b = 0; b < model_.blocks.size(); ++b) {
      if (is_out_of_time()) return Status::time_limit;
      FactorStatus f = linear_[b].factorize(t.matrix[b]);
      if constexpr (RefiningSolver<Linear>)
        if (f == FactorStatus::positive_definite) f = linear_[b].certify();
      if (f != FactorStatus::positive_definite)
        return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
      if (b > 0) continue;  // the advance moves with the even fields only
      const double stiffness = t.stiffness - t.coupling.dot(Eigen::VectorXd(linear_[b].solve(t.coupling)));
      if (!(stiffness > 0.0)) return std::isfinite(stiffness) ? Status::not_positive_definite : Status::non_finite;
    }
    return Status::converged;
  }

  QuasiStaticConfig config_;
  const Model& model_;
  System system_;
  const Equations& eq_;
  using Linear = std::decay_t<decltype(std::declval<Model>().blocks.front().analysed)>;
  std::vector<Linear> linear_;             // by parity; the first one's factor is that of the steps
  typename System::Place now_, factored_;  // where we are, and where the factor was made
  FrictionHistory touched_, rested_;       // at the end of the last stride
  Stopwatch watch_;
  typename System::Tangent tangent_;
  Eigen::VectorXd response_;  // K⁻¹ k
  double schur_ = 0.0;
  SecantPairs steps_;  // with that factor
  Eigen::VectorXd last_step_;
  double wanted_ = 0.0, load_ = 0.0;  // where the strides lead, and the last load that was reached
  double residual_ = 0.0;             // of the last step, over its load
};

template <class Model, Indenter Tool> FrictionForces QuasiStaticRun<Model, Tool>::friction() const {
  FrictionForces out;
  if (!has_friction()) return out;
  const Sector& sector = model_.sector;
  out.on_nodes.assign(sector.mesh.nodes.size(), Vec3d::Zero());
  rested_.add_nodal_forces(model_.resting, model_.contact, system_.support(), now_.x, out.on_nodes);
  out.push_N =
      touched_.add_nodal_forces(model_.touchable, model_.contact, system_.indenter(now_.advance), now_.x, out.on_nodes)
          .dot(system_.direction) /
      sector.fraction();
  for (std::size_t k = 0; k < out.on_nodes.size(); ++k)  // nodes in a bounding plane have as much on the other side
    for (int axis = 0; axis < 2; ++axis)
      if ((axis == 0 ? sector.planes.x : sector.planes.y) && sector.mesh.nodes[k][axis] == 0.0) {
        out.on_nodes[k] *= 2.0;
        out.on_nodes[k][axis] = 0.0;
      }
  return out;
}

template <LinearSolver Linear> template <class SomeModel, Indenter Tool>
std::vector<MechanicalState> QuasiStatic<Linear>::run(
    const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  QuasiStaticRun<SomeModel, Tool> path(model, scenario, touch, config);
  const double fraction = model.sector.fraction();
  std::vector<MechanicalState> states;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = path.solve(fraction * load);
    path.report(state.status);
    state.iterations = path.iterations;
    state.depth_m = path.advance();
    const auto& x = path.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k)
      state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    FrictionForces friction = path.friction();
    state.friction_N = std::move(friction.on_nodes);
    state.friction_push_N = friction.push_N;
    states.push_back(std::move(state));
    if (states.back().status != Status::converged) break;
  }
  return states;
}

}  // namespace lumo
