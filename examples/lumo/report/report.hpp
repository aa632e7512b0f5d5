#pragma once

#include "lumo/mechanics/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <array>
#include <limits>
#include <optional>
#include <string>
#include <vector>

/// What the commands hand to the writers: plain numbers in the units of the output. NaN means "not defined by the given
/// loads" and is written as null (JSON) or a dash (text).
namespace lumo::program {

inline constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

struct StateReport {
  double load_N = undefined;
  double force_N = undefined;
  double depth_mm = undefined;
  double contact_area_mm2 = undefined;
  double reference_area_mm2 = undefined;
  double residual_N = undefined;
  double penetration_mm = undefined;      ///< largest overlap of pad and sphere
  std::vector<double> response = {};      ///< per emitted power and region; empty when no light was traced
  std::vector<double> change_error = {};  ///< standard error of the response minus the unloaded one
};

struct ScenarioReport {
  double diameter_mm = undefined, angle_deg = undefined, y_mm = undefined;
  std::string status = "converged";      ///< of the last state
  double q_form = undefined, q_stable = undefined, q_stiff = undefined;
  std::vector<StateReport> states;
};

struct MeshReport {
  std::size_t nodes = 0, elements = 0;
};

struct Seconds {
  double mesh = undefined, mechanics = undefined, optics = undefined, total = undefined;
};

/// Where the emitted power went, as fractions of it; all others add up to `emitted`. `sampling` is what Russian roulette and other estimators added or took; its expectation is 0.
struct Ledger {
  double emitted = undefined, regions = undefined, to_indenter = undefined, elsewhere = undefined;
  double absorbed_medium = undefined, absorbed_carrier = undefined, sampling = undefined, lost = undefined;
};

struct MeshResult {
  MeshReport size;
  std::size_t boundary_faces = 0;
  double volume_mm3 = undefined, exact_volume_mm3 = undefined;
  double min_jacobian_ratio = undefined, min_dihedral_deg = undefined;
  double seconds = undefined;
  TetMesh mesh;
};

struct PressResult {
  ScenarioReport scenario;
  MeshReport size;
  Seconds seconds;
  TetMesh mesh;
  std::vector<MechanicalState> states;   ///< one per load, for the pictures and .vtu files
};

/// One of several presses: a failure does not end the others.
struct PressOutcome {
  std::optional<PressResult> press;
  std::string why;                       ///< there is none
};

struct TraceResult {
  PressResult press;                     ///< its seconds are those of the light, too
  ScenarioReport scenario;               ///< the press's, with responses r (not differences)
  std::vector<double> unloaded_response, unloaded_error;   ///< per emitted power and region, and its standard error
  Ledger ledger;                         ///< of the state in which it closes worst
};

struct WorstContact {
  double diameter_mm, angle_deg, y_mm, value;
};

struct WorstObservation {
  double diameter_mm, angle_deg, load_N, y_a_mm, y_b_mm, value;
};

struct EvaluationResult {
  double J_contact = undefined, J_contact_err = undefined, J_obs = undefined, J_obs_err = undefined;
  std::optional<WorstContact> worst_contact;
  std::optional<WorstObservation> worst_observation;
  std::vector<double> unloaded_response, unloaded_error;
  std::vector<ScenarioReport> scenarios;
  Ledger ledger;
  MeshReport size;
  Seconds seconds;
};

}  // namespace lumo::program
