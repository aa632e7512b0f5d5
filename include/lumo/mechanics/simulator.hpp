#pragma once

#include "lumo/mechanics/certify.hpp"
#include "lumo/mechanics/contact/contact_set.hpp"
#include "lumo/mechanics/contact/preconditions.hpp"
#include "lumo/mechanics/contact/traction.hpp"
#include "lumo/mechanics/elements/energy_error.hpp"
#include "lumo/mechanics/solvers/press_solver.hpp"
#include "lumo/mechanics/solvers/quasi_static.hpp"
#include "lumo/mesh/body_check.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>

namespace lumo {

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Solver>
requires PressSolver<Solver, Material, Contact, Element>
class PreparedBody;

/// Presses an indenter into a body. Types choose the physics, values choose the numbers:
/// `Simulator sim{NeoHookean{.mu = 106.0_kPa, .lambda = 10.494_MPa}, SDFContact{}}`.
/// `Solver` finds the states: `QuasiStatic<Cholmod>` with CHOLMOD's factors, VertexBlockDescent, or one's own.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element = QuadraticTet,
    class Solver = QuasiStatic<>>
requires PressSolver<Solver, Material, Contact, Element>
struct Simulator {
  Material material = {};
  Contact contact = {};
  Element element = {};
  Solver solver = {};

  /// Everything that scenarios on one mesh share (elements, symbolic factorisations); thread-safe, so that scenarios
  /// can run side by side. Throws InvalidArgument for parameters out of range and for a body that nothing holds,
  /// MeshError for a mesh that is not valid or not the body's (require_valid(body, mesh)).
  PreparedBody<Material, Contact, Element, Solver> prepare(const Body& body, const TetMesh& mesh) const {
    validate(material);
    validate(contact);
    require_valid(body, mesh);
    require_held(body, mesh);
    return {*this, body, mesh};
  }

  /// One scenario from first touch through its loads. Throws as prepare() and PreparedBody::press() do.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) const {
    return prepare(body, mesh).press(scenario);
  }
};

template <class Material, class Contact> Simulator(Material, Contact) -> Simulator<Material, Contact>;
template <class Material, class Contact, class Element> Simulator(Material, Contact, Element)
    -> Simulator<Material, Contact, Element>;
template <class Material, class Contact, class Element, class Solver> Simulator(Material, Contact, Element, Solver)
    -> Simulator<Material, Contact, Element, Solver>;

/// A body ready to be pressed at many places.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Solver>
requires PressSolver<Solver, Material, Contact, Element>
class PreparedBody {
 public:
  using Model = typename Solver::template Model<Material, Contact, Element>;
  using Maker = Simulator<Material, Contact, Element, Solver>;

  PreparedBody(const Maker& maker, const Body& body, const TetMesh& mesh)
      : maker_(maker), body_(body), mesh_(std::make_shared<const TetMesh>(mesh)) {}

  /// States at the scenario's loads, on the whole mesh. Where body and scenario are symmetric the quasi-static solver
  /// takes only a half or a quarter; fields that break the symmetry are still tested for stability. Throws
  /// InvalidArgument for a scenario out of range, and for a tool that passes by or meets first what it may not touch.
  template <Indenter Tool> std::vector<MechanicalState> press(const Scenario<Tool>& scenario) const {
    validate(scenario);
    const Touch touch = first_touch(body_, *mesh_, scenario);
    require_free_way(body_, *mesh_, scenario, touch);
    // A fixed area per vertex knows no halves of vertices.
    const bool fold = Solver::uses_symmetry && area_per_vertex(maker_.contact) == 0.0;
    const Symmetry contact = symmetry_of(scenario),
                   planes{fold && mesh_->symmetry.x && contact.x, fold && mesh_->symmetry.y && contact.y};
    const Model& sector_model = model(planes);
    std::vector<MechanicalState> states = maker_.solver.run(sector_model, scenario, touch);
    const ContactSurface surface(
        *mesh_, body_, [](const Patch& p) { return p.contactable; }, maker_.contact);
    const ContactSurface resting(
        *mesh_, body_, [](const Patch& p) { return p.meets_carrier; }, maker_.contact);
    const Carrier carrier{body_.carrier};
    const Moving<Carrier> support{&carrier, Vec3d::Zero(), Vec3d::UnitZ()};
    const EnergyError<Material, Element> energy_error(*mesh_, maker_.material);
    for (MechanicalState& s : states) {
      s.displacement = unfold(*mesh_, sector_model.sector, s.displacement);
      if (!s.friction_N.empty()) s.friction_N = unfold(*mesh_, sector_model.sector, s.friction_N);
      const Vec3d origin = touch.origin + s.depth_m * scenario.direction();
      Positions x = positions_of(*mesh_);
      for (std::size_t k = 0; k < s.displacement.size(); ++k) x.col(Eigen::Index(k)) += s.displacement[k];
      const Moving<Tool> rigid{&scenario.indenter, origin, scenario.direction()};
      ContactField c = contact_field(*mesh_, surface, maker_.contact, rigid, x);
      const ContactSums sums = add_contact_forces(surface, maker_.contact, rigid, x, nullptr);
      s.force_N = sums.push_N + s.friction_push_N;
      s.penetration_m = sums.penetration_m;
      if (const double margin = record_margin(maker_.contact); margin > 0.0) {
        s.recorded = recorded_triangles(surface, rigid, x, margin);
        s.contact_area_m2 = recorded_area(surface, s.recorded, x);
        s.reference_area_m2 = recorded_area(surface, s.recorded, positions_of(*mesh_));
      } else {
        s.contact_area_m2 = contact_area(surface, c.field, x);
        s.reference_area_m2 = contact_area(surface, c.field, positions_of(*mesh_));
      }
      s.contact_field = std::move(c.field);
      s.tool_slopes = std::move(c.slopes);
      s.spots = std::move(c.spots);
      s.energy_error = energy_error(x);
      if (resting.size() > 0) s.carrier_slopes = resting_slopes(*mesh_, resting, support, x);
      s.pressure_Pa = std::move(c.pressure_Pa);
      if (x.allFinite()) {
        Tractions t = tractions_of(*mesh_, surface, maker_.contact, rigid, x, s.friction_N);
        s.tractions = std::move(t.points);
        s.traction_Pa = std::move(t.on_nodes);
      }
      // Certified on the whole mesh by the independent routine, whatever the solver reports. A held indenter bears
      // any force.
      const double wanted = s.status == Status::held ? s.force_N : s.load_N;
      s.residual_N =
          out_of_balance(body_, *mesh_, physics(), rigid, {wanted, s.displacement, {s.friction_N, s.friction_push_N}});
      if (s.status == Status::converged && !(s.residual_N <= 1e-6 * s.load_N))
        s.status = std::isfinite(s.residual_N) ? Status::max_iterations : Status::non_finite;
      if (std::isnan(s.residual_N)) s.residual_N = std::numeric_limits<double>::infinity();
      s.certified = s.status == Status::converged;
    }
    return states;
  }

  const TetMesh& mesh() const { return *mesh_; }

 private:
  PressPhysics<Material, Contact, Element> physics() const { return {maker_.material, maker_.contact, maker_.element}; }
  const Model& model(Symmetry planes) const {
    Slot& slot = (*slots_)[std::size_t((planes.x ? 1 : 0) + (planes.y ? 2 : 0))];
    const std::lock_guard one(slot.making);  // glibc aborts where std::call_once lets "out of memory" pass
    if (!slot.model) slot.model = maker_.solver.model(body_, *mesh_, planes, physics());
    return *slot.model;
  }

  struct Slot {
    std::mutex making;
    std::unique_ptr<Model> model;
  };
  Maker maker_;
  Body body_;
  std::shared_ptr<const TetMesh> mesh_;
  std::shared_ptr<std::array<Slot, 4>> slots_ = std::make_shared<std::array<Slot, 4>>();
};

}  // namespace lumo
