#pragma once

#include "configuration/mechanics.hpp"

#include "lumo/mechanics/contact/scenario.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/solvers/press_solver.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/morphology/silicone.hpp"

#include <functional>
#include <vector>

namespace lumo::program {

/// A body ready to be pressed at many places, side by side, by whatever Simulator; stands where a PreparedBody does.
struct AnyPad {
  std::function<const TetMesh&()> mesh;
  std::function<std::vector<MechanicalState>(const Scenario<Sphere>&)> press;
};

/// A Simulator whose policies were chosen at run time.
struct AnySimulation {
  std::function<AnyPad(const Body&, const TetMesh&)> prepare;
};

/// The Simulator that `mechanics` asks for, with the silicone's numbers. A press takes one thread; presses run side by
/// side. `watch` sees each as it goes.
AnySimulation simulation(const Mechanics& mechanics, const Silicone& silicone, const PressWatch& watch = {});

}  // namespace lumo::program
