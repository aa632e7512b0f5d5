#pragma once

#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/materials/material.hpp"

#include <concepts>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace lumo {

/// The physics of a press.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element> struct PressPhysics {
  Material material;
  Contact contact;
  Element element;
};

template <class Material, class Contact, class Element> PressPhysics(Material, Contact, Element)
    -> PressPhysics<Material, Contact, Element>;

/// How far the press of one scenario is.
struct PressReport {
  double wanted_N = 0.0;  ///< the load that is being approached, or has ended
  double load_N = 0.0;    ///< the last one that was reached, on the way to it, too
  double depth_m = 0.0;   ///< advance since first touch
  int iterations = 0;     ///< factorisations, or sweeps, spent on wanted_N
  std::optional<double> residual =
      {};  ///< out-of-balance forces over the load; none of a solver in time, or where it is not finite
  std::optional<Status> ended = {};  ///< how wanted_N ended; nullopt: on the way
};
/// Called by a solver as it goes, from the thread of the press; may be empty. What it does changes no result.
using PressWatch = std::function<void(const PressReport&)>;

/// How the states under a scenario's loads are found. model() makes what scenarios on one mesh share, for a sector of
/// it where the solver `uses_symmetry`; run() gives one state per load, displacements on the sector's nodes, up to the
/// first that fails. Laws: same input, same bits, also side by side; a state is `converged` or `held` or says why not;
/// run() changes nothing in the model.
template <class S, class Material, class Contact, class Element>
concept PressSolver = std::copyable<S> && requires(const S& solver, const Body& body, const TetMesh& mesh,
    Symmetry planes, const PressPhysics<Material, Contact, Element>& physics,
    const typename S::template Model<Material, Contact, Element>& model, const Scenario<Sphere>& scenario,
    const Touch& touch) {
  { S::uses_symmetry } -> std::convertible_to<bool>;
  {
    solver.model(body, mesh, planes, physics)
    } -> std::same_as<std::unique_ptr<typename S::template Model<Material, Contact, Element>>>;
  { solver.run(model, scenario, touch) } -> std::same_as<std::vector<MechanicalState>>;
};

}  // namespace lumo
