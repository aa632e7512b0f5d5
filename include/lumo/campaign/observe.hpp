#pragma once

#include "lumo/campaign/ensemble.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"

#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <numeric>
#include <string_view>

namespace lumo {

/// One state as it is kept: numbers only, no fields.
struct StateRecord {
  Status status = Status::non_finite;
  double load_N = 0.0, force_N = 0.0, depth_m = 0.0, contact_area_m2 = 0.0, reference_area_m2 = 0.0, residual_N = 0.0, penetration_m = 0.0;
  std::vector<double> response;          ///< per emitted power and region: Observations::unloaded_response + mean change; empty without light
  Eigen::MatrixXd change;                ///< (r − r_0)/P_emit by replicate, replicates × regions, both traced on the scenario's own mesh
};

/// One scenario of an ensemble.
struct ScenarioRecord {
  double diameter_m = 0.0, angle_rad = 0.0, y_m = 0.0;
  Status status = Status::non_finite;    ///< of the last state that was tried
  ContactTerms terms;
  std::vector<StateRecord> states;
};

/// Seconds spent, summed over threads, and by the clock in all.
struct Timing {
  double mesh = 0.0, mechanics = 0.0, optics = 0.0, total = 0.0;
};

/// All states and responses of one body under an ensemble.
struct Observations {
  std::vector<ScenarioRecord> scenarios;        ///< in the ensemble's order, mirror images included
  std::vector<double> unloaded_response;        ///< per emitted power and region, mean over the meshes
  EnergyLedger ledger;                          ///< of the traced state that closes worst
  std::size_t nodes = 0, elements = 0;          ///< of the largest mesh
  Timing seconds;
};

/// Tools of one evaluation; policies are types, settings are values.
template <Mesher M, class Simulation, class Light>
struct Pipeline {
  M mesher;
  Simulation simulator;
  Light tracer;
  Focus focus = {};
  MechanicalError mechanical_error = {};
  OpticalError optical_error = {};
  bool mirror_once = true;               ///< solve mirror images once
};

/// Called after each step: stage, steps done, steps in all. May be called from any thread, one call at a time.
using ProgressReport = std::function<void(std::string_view stage, int done, int total)>;

/// Presses and lights a body in every scenario. Bit-identical for every executor. Throws InvalidArgument and MeshError; a solve that fails is
/// a status in its record.
template <class P, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Sphere>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress = {});

namespace detail {

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// A place of contact: its mesh, what all its scenarios share, and its unloaded response.
template <class Prepared>
struct PreparedPlace {
  std::unique_ptr<Prepared> pad;
  Response unloaded;
  Timing seconds;
};

// One solved scenario with its states' responses.
struct SolvedScenario {
  ScenarioRecord record;
  EnergyLedger worst;
  Timing seconds;
};

inline void reflect_regions(ScenarioRecord& record, const std::vector<int>& image) {
  if (image.empty()) return;
  for (StateRecord& s : record.states) {
    const Eigen::MatrixXd change = s.change;
    for (Eigen::Index k = 0; k < change.cols(); ++k) s.change.col(image[std::size_t(k)]) = change.col(k);
  }
}

template <class P, class Prepared>
SolvedScenario solve_scenario(const Body& body, const Scenario<Sphere>& scenario, const P& pipeline, const PreparedPlace<Prepared>& place) {
  SolvedScenario out;
  ScenarioRecord& record = out.record;
  record = {scenario.indenter.diameter_m, scenario.angle_rad, scenario.y_m, Status::non_finite, {}, {}};
  const Stopwatch pressing;
  const std::vector<MechanicalState> states = place.pad->press(scenario);
  record.status = states.back().status;
  record.terms = contact_terms(body, place.pad->mesh(), states, scenario.indenter.radius_m(), pipeline.mechanical_error);
  out.seconds.mechanics = pressing.seconds();
  const Stopwatch tracing;
  const Symmetry symmetry{body.symmetry.x && scenario.angle_rad == 0.0, body.symmetry.y && scenario.y_m == 0.0};
  for (const MechanicalState& s : states) {
    StateRecord r{s.status, s.load_N, s.force_N, s.depth_m, s.contact_area_m2, s.reference_area_m2, s.residual_N, s.penetration_m, {}, {}};
    if (body.regions > 0 && (s.status == Status::converged || s.status == Status::held)) {
      const Response light = pipeline.tracer.trace(body, place.pad->mesh(), s, symmetry);
      r.change = response_change(light, place.unloaded);
      if (light.ledger.imbalance() >= out.worst.imbalance()) out.worst = light.ledger;
    }
    record.states.push_back(std::move(r));
  }
  out.seconds.optics = tracing.seconds();
  return out;
}

}  // namespace detail

template <class P, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Sphere>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress) {
  using Prepared = decltype(pipeline.simulator.prepare(body, std::declval<TetMesh>()));
  const detail::Stopwatch clock;
  const ContactPlan plan = plan_contacts(scenarios, body.symmetry, pipeline.mirror_once);
  std::mutex reporting;
  int done = 0;
  const auto report = [&](std::string_view stage, std::size_t total) {
    const std::lock_guard lock(reporting);
    ++done;
    if (progress) progress(stage, done, int(total));
  };

  const TetMesh coarse = mesh_body(body, pipeline.mesher);
  std::vector<detail::PreparedPlace<Prepared>> places(plan.places.size());
  executor.for_each(places.size(), [&](std::size_t k) {
    const detail::Stopwatch meshing;
    std::vector<Scenario<Sphere>> here;
    for (std::size_t s : plan.places[k].solves) here.push_back(plan.solves[s].scenario);
    const TetMesh mesh = mesh_for_contact(body, coarse, here, pipeline.mesher, pipeline.focus);
    places[k].pad = std::make_unique<Prepared>(pipeline.simulator.prepare(body, mesh));
    places[k].seconds.mesh = meshing.seconds();
    const detail::Stopwatch tracing;
    if (body.regions > 0) places[k].unloaded = pipeline.tracer.trace(body, mesh);
    places[k].seconds.optics = tracing.seconds();
    report("mesh", places.size());
  });

  // Scenarios without a second symmetry plane take longest: they go first, so that threads end together.
  std::vector<std::size_t> order(plan.solves.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  const auto halves = [&](std::size_t k) { return (plan.solves[k].scenario.y_m == 0.0) + (plan.solves[k].scenario.angle_rad == 0.0); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return halves(a) < halves(b); });
  std::vector<detail::SolvedScenario> solved(plan.solves.size());
  done = 0;
  executor.for_each(order.size(), [&](std::size_t i) {
    const ContactPlan::Solve& s = plan.solves[order[i]];
    solved[order[i]] = detail::solve_scenario(body, s.scenario, pipeline, places[s.place]);
    report("press and light", order.size());
  });

  Observations out;
  // Meshes of different places give the same unloaded response up to their facets; that difference would hide small changes, so
  // changes are taken on one mesh and added to the common mean.
  if (body.regions > 0) {
    out.unloaded_response.assign(std::size_t(body.regions), 0.0);
    for (const auto& p : places)
      for (std::size_t b = 0; b < out.unloaded_response.size(); ++b) out.unloaded_response[b] += p.unloaded.power_W[b] / p.unloaded.ledger.emitted / double(places.size());
    out.ledger = places.front().unloaded.ledger;
  }
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const ContactPlan::Image& image = plan.images[k];
    ScenarioRecord record = solved[image.solve].record;
    record.angle_rad = scenarios[k].angle_rad;
    record.y_m = scenarios[k].y_m;
    if (image.mirror_x) detail::reflect_regions(record, body.region_image_x);
    if (image.mirror_y) detail::reflect_regions(record, body.region_image_y);
    for (StateRecord& s : record.states)
      for (Eigen::Index b = 0; b < s.change.cols(); ++b) s.response.push_back(out.unloaded_response[std::size_t(b)] + s.change.col(b).mean());
    out.scenarios.push_back(std::move(record));
  }
  for (const auto& s : solved) {
    if (s.worst.emitted > 0.0 && s.worst.imbalance() >= out.ledger.imbalance()) out.ledger = s.worst;
    out.seconds.mechanics += s.seconds.mechanics;
    out.seconds.optics += s.seconds.optics;
  }
  for (const auto& p : places) {
    out.seconds.mesh += p.seconds.mesh;
    out.seconds.optics += p.seconds.optics;
    out.nodes = std::max(out.nodes, p.pad->mesh().nodes.size());
    out.elements = std::max(out.elements, p.pad->mesh().tets.size());
  }
  out.seconds.total = clock.seconds();
  return out;
}

}  // namespace lumo
