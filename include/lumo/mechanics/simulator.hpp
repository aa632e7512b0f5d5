#pragma once

#include "lumo/mechanics/certify.hpp"
#include "lumo/mechanics/first_touch.hpp"
#include "lumo/mechanics/quasi_static.hpp"

#include <array>
#include <memory>
#include <mutex>

namespace lumo {

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear, class Solver>
class PreparedBody;

/// Presses an indenter into a body. Types choose the physics, values choose the numbers:
/// `Simulator sim{NeoHookean{.mu = 106.0_kPa, .lambda = 10.494_MPa}, SDFContact{}}`.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element = QuadraticTet, LinearSolver Linear = EigenCholesky, class Solver = QuasiStatic>
struct Simulator {
  Material material = {};
  Contact contact = {};
  Element element = {};
  Solver solver = {};

  /// Everything that scenarios on one mesh share (elements, symbolic factorisations); thread-safe, so that scenarios can run side by side.
  /// Throws InvalidArgument for parameters out of range.
  PreparedBody<Material, Contact, Element, Linear, Solver> prepare(const Body& body, const TetMesh& mesh) const {
    validate(material);
    validate(contact);
    return {*this, body, mesh};
  }

  /// One scenario from first touch through its loads.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) const {
    return prepare(body, mesh).press(scenario);
  }
};

template <class Material, class Contact>
Simulator(Material, Contact) -> Simulator<Material, Contact>;
template <class Material, class Contact, class Element>
Simulator(Material, Contact, Element) -> Simulator<Material, Contact, Element>;

/// A body ready to be pressed at many places.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear, class Solver>
class PreparedBody {
 public:
  using Model = SectorModel<Material, Contact, Element, Linear>;
  using Maker = Simulator<Material, Contact, Element, Linear, Solver>;

  PreparedBody(const Maker& maker, const Body& body, const TetMesh& mesh) : maker_(maker), body_(body), mesh_(std::make_shared<const TetMesh>(mesh)) {}

  /// States at the scenario's loads, on the whole mesh. Where body and scenario are symmetric only a half or a quarter is solved; fields
  /// that break the symmetry are still tested for stability.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Scenario<Tool>& scenario) const;

  const TetMesh& mesh() const { return *mesh_; }

 private:
  const Model& model(Symmetry planes) const {
    Slot& slot = (*slots_)[std::size_t((planes.x ? 1 : 0) + (planes.y ? 2 : 0))];
    std::call_once(slot.once, [&] { slot.model = std::make_unique<Model>(body_, *mesh_, planes, maker_.material, maker_.contact, maker_.element); });
    return *slot.model;
  }

  struct Slot {
    std::once_flag once;
    std::unique_ptr<Model> model;
  };
  Maker maker_;
  Body body_;
  std::shared_ptr<const TetMesh> mesh_;
  std::shared_ptr<std::array<Slot, 4>> slots_ = std::make_shared<std::array<Slot, 4>>();
};

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear, class Solver>
template <Indenter Tool>
std::vector<MechanicalState> PreparedBody<Material, Contact, Element, Linear, Solver>::press(const Scenario<Tool>& scenario) const {
  validate(scenario);
  const Touch touch = first_touch(body_, *mesh_, scenario);
  const Symmetry planes{mesh_->symmetry.x && scenario.angle_rad == 0.0, mesh_->symmetry.y && scenario.y_m == 0.0};
  const Model& sector_model = model(planes);
  std::vector<MechanicalState> states = maker_.solver.run(sector_model, scenario, touch);
  const ContactSurface surface(*mesh_, body_, [](const Patch& p) { return p.contactable; });
  for (MechanicalState& s : states) {
    s.displacement = unfold(*mesh_, sector_model.sector, s.displacement);
    const Vec3 origin = touch.origin + s.depth_m * scenario.direction();
    // Certified on the whole mesh by the independent routine, whatever the solver says of itself.
    s.residual_N = out_of_balance(body_, *mesh_, maker_.material, maker_.contact, maker_.element, scenario.indenter, origin, scenario.direction(), s.load_N, s.displacement);
    if (s.status == Status::converged && !(s.residual_N <= 1e-6 * s.load_N)) s.status = std::isfinite(s.residual_N) ? Status::max_iterations : Status::non_finite;
    Positions x = positions_of(*mesh_);
    for (std::size_t k = 0; k < s.displacement.size(); ++k) x.col(Eigen::Index(k)) += s.displacement[k];
    const Moving<Tool> rigid{&scenario.indenter, origin, scenario.direction()};
    ContactField c = contact_field(*mesh_, surface, maker_.contact, rigid, x);
    const ContactSums sums = add_contact_forces(surface, maker_.contact, rigid, x, nullptr);
    s.force_N = sums.push_N;
    s.penetration_m = sums.penetration_m;
    s.contact_area_m2 = contact_area(surface, c.field, x);
    s.reference_area_m2 = contact_area(surface, c.field, positions_of(*mesh_));
    s.contact_field = std::move(c.field);
    s.pressure_Pa = std::move(c.pressure_Pa);
  }
  return states;
}

}  // namespace lumo
