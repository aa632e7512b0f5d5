#pragma once

#include "lumo/mechanics/contact/state.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"
#include "lumo/optics/response.hpp"
#include "lumo/pipeline/ensemble.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cstddef>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// One state as it is kept: numbers only, no fields.
struct StateRecord {
  Status status = Status::non_finite;
  double load_N = 0.0, force_N = 0.0, depth_m = 0.0, contact_area_m2 = 0.0, reference_area_m2 = 0.0, residual_N = 0.0,
         penetration_m = 0.0;
  double depth_error_m = 0.0, contact_area_error_m2 = 0.0;  ///< by the mesh, see MechanicalError
  /// Per emitted power and channel: Observations::unloaded_response + mean change; empty without light.
  std::vector<double> response;
  /// (r − r_0)/P_emit, replicates × channels, both traced on the scenario's own mesh.
  Eigen::MatrixXd change;
  std::vector<double> change_error;  ///< standard error of the response minus the unloaded one; empty without light
};

/// One scenario of an ensemble.
struct ScenarioRecord {
  double diameter_m = 0.0, angle_rad = 0.0, y_m = 0.0;  ///< diameter of the tool, or twice its contact_radius()
  /// Of the last state that was tried; unresolved where all converged, and one has such a contact.
  Status status = Status::non_finite;
  ContactTerms terms;
  std::vector<StateRecord> states;
  TiltPlane tilt = TiltPlane::xz;
  std::optional<Unresolved> unresolved = std::nullopt;  ///< the first contact that its mesh does not resolve
  double x_m = 0.0;
};

/// Seconds spent, summed over threads, and by the clock in all.
struct Timing {
  double mesh = 0.0, mechanics = 0.0, optics = 0.0, total = 0.0;
};

/// All states and responses of one body under an ensemble.
struct Observations {
  std::vector<ScenarioRecord> scenarios;  ///< in the ensemble's order, mirror images included
  /// Per emitted power and channel (of the first colour, then the next), mean over the meshes.
  std::vector<double> unloaded_response;
  /// Its standard error. Meshes share their rays, so it does not shrink with their number.
  std::vector<double> unloaded_error;
  EnergyLedger ledger;                  ///< of the traced state that closes worst
  std::size_t nodes = 0, elements = 0;  ///< of the largest mesh
  Timing seconds;
};

/// The record of a scenario, before it is lit, from its states on `mesh`.
template <Indenter Tool> ScenarioRecord record_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario,
    const std::vector<MechanicalState>& states, const MechanicalError& error = {}) {
  ScenarioRecord record;
  record.diameter_m = 2.0 * contact_radius(scenario.indenter);
  record.angle_rad = scenario.angle_rad;
  record.x_m = scenario.x_m;
  record.y_m = scenario.y_m;
  record.tilt = scenario.tilt;
  record.status = states.back().status;
  record.terms = contact_terms(body, mesh, states, contact_radius(scenario.indenter), error);
  for (const MechanicalState& s : states) {
    StateRecord& kept = record.states.emplace_back();
    kept.status = s.status;
    kept.load_N = s.load_N;
    kept.force_N = s.force_N;
    kept.depth_m = s.depth_m;
    kept.contact_area_m2 = s.contact_area_m2;
    kept.reference_area_m2 = s.reference_area_m2;
    kept.residual_N = s.residual_N;
    kept.penetration_m = s.penetration_m;
    kept.depth_error_m = error.of_stiffness(s) * s.depth_m;
    kept.contact_area_error_m2 = error.of_area(s) * s.contact_area_m2;
    if (const auto spot = error.unresolved_in(s)) {
      kept.contact_area_error_m2 += pi * spot->edge_m * spot->edge_m;
      if (!record.unresolved) record.unresolved = spot;
    }
  }
  if (record.unresolved && is_scored(record.status, true)) record.status = Status::unresolved;
  // It would be pressed again, on a finer mesh, which takes longer still.
  if (record.status == Status::time_limit) record.unresolved.reset();
  return record;
}

/// Did all scenarios converge, or were held where that is accepted?
inline bool all_scored(const std::vector<ScenarioRecord>& scenarios, bool accept_held) {
  return std::all_of(
      scenarios.begin(), scenarios.end(), [&](const ScenarioRecord& s) { return is_scored(s.status, accept_held); });
}

/// The lit states of one scenario, which is the caller's number `scenario`.
inline std::vector<ObservedState> observed_states(const ScenarioRecord& record, std::size_t scenario) {
  std::vector<ObservedState> states;
  std::vector<double> loads_N;
  std::vector<Eigen::RowVectorXd> changes;
  for (const StateRecord& s : record.states) {
    if (s.change.size() == 0) continue;
    const double known = s.contact_area_m2 > 0.0 ? std::min(1.0, s.contact_area_error_m2 / s.contact_area_m2) : 0.0;
    states.push_back({scenario, record.diameter_m, record.angle_rad, record.y_m, s.load_N, s.change, record.tilt, 0.0,
        known, record.x_m});
    loads_N.push_back(s.load_N);
    changes.push_back(s.change.colwise().mean());
  }
  const std::vector<double> rises = load_rises(loads_N, changes);
  for (std::size_t k = 0; k < states.size(); ++k) states[k].load_rise = rises[k];
  return states;
}

/// All states that can be compared for J_obs.
inline std::vector<ObservedState> observed_states(const std::vector<ScenarioRecord>& scenarios) {
  std::vector<ObservedState> all;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    std::vector<ObservedState> states = observed_states(scenarios[k], k);
    std::move(states.begin(), states.end(), std::back_inserter(all));
  }
  return all;
}

/// Channel of the light → its mirror image, in the planes x = 0 and y = 0; empty: itself; nullopt: unknown.
using ChannelImages = std::array<std::optional<std::vector<int>>, 2>;

/// The record of a scenario from that of its mirror image.
template <Indenter Tool> ScenarioRecord mirrored(
    ScenarioRecord record, const Scenario<Tool>& scenario, const ChannelImages& channels, const ScenarioImage& image) {
  record.angle_rad = scenario.angle_rad;
  record.x_m = scenario.x_m;
  record.y_m = scenario.y_m;
  const auto renumber = [&](const std::optional<std::vector<int>>& channel) {
    if (!channel || channel->empty()) return;
    for (StateRecord& s : record.states) {
      const Eigen::MatrixXd change = s.change;
      for (Eigen::Index k = 0; k < change.cols(); ++k) s.change.col((*channel)[std::size_t(k)]) = change.col(k);
    }
  };
  if (image.mirror.x) renumber(channels[0]);
  if (image.mirror.y) renumber(channels[1]);
  return record;
}

}  // namespace lumo
