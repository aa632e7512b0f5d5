#pragma once

#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/elements/linear_solver.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/mechanics/solvers/quasi_static.hpp"

#include <concepts>
#include <memory>
#include <type_traits>
#include <vector>

namespace lumo {

/// How the states under a scenario's loads are found. model() makes what scenarios on one mesh share, for a sector of
/// it where the solver `uses_symmetry`; run() gives one state per load, displacements on the sector's nodes, up to the
/// first that fails. Laws: same input, same bits, also side by side; a state is `converged` or `held` or says why not;
/// run() changes nothing in the model.
template <class S, class Material, class Contact, class Element>
concept PressSolver = std::copyable<S> &&
    requires(const S& solver, const Body& body, const TetMesh& mesh, Symmetry planes, const Material& material,
             const Contact& contact, const Element& element,
             const typename S::template Model<Material, Contact, Element>& model, const Scenario<Sphere>& scenario,
             const Touch& touch) {
  { S::uses_symmetry } -> std::convertible_to<bool>;
  {
    solver.model(body, mesh, planes, material, contact, element)
    } -> std::same_as<std::unique_ptr<typename S::template Model<Material, Contact, Element>>>;
  { solver.run(model, scenario, touch) } -> std::same_as<std::vector<MechanicalState>>;
};

namespace detail {

template <class Method> struct SolverOf { using type = Method; };
template <LinearSolver Method> struct SolverOf<Method> { using type = QuasiStatic<Method>; };

}  // namespace detail

/// The solver that a simulator's last parameter names: a linear solver stands for the quasi-static one that uses it.
template <class Method> using SolverOf = typename detail::SolverOf<Method>::type;

}  // namespace lumo
