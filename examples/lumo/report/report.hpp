#pragma once

#include "console/text.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/pipeline/observations.hpp"

#include <optional>
#include <string>
#include <vector>

/// What the commands hand to the writers: the library's records, with the mesh and the fields of one press beside them.
namespace lumo::program {

struct MeshResult {
  TetMesh mesh;
  MeshQuality quality;
  double exact_volume_m3 = undefined;
  double seconds = undefined;
};

struct PressResult {
  Observations seen;  ///< one scenario; without light, what belongs to light is empty or undefined
  TetMesh mesh;
  std::vector<MechanicalState> states;  ///< one per load, for the pictures and .vtu files

  const ScenarioRecord& scenario() const { return seen.scenarios.front(); }
};

/// One of several presses: a failure does not end the others.
struct PressOutcome {
  std::optional<PressResult> press;
  std::string why;  ///< there is none
};

/// A press with its light.
struct TraceResult {
  PressResult press;
};

}  // namespace lumo::program
