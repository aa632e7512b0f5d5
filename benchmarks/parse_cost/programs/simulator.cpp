#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"

std::vector<lumo::MechanicalState> press(const lumo::Body& body, const lumo::TetMesh& mesh) {
  const lumo::Simulator<lumo::NeoHookean, lumo::SDFContact> simulator;
  return simulator.press(body, mesh, lumo::Scenario<lumo::Sphere>{});
}

int main() {}
