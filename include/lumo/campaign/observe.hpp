#pragma once

#include "lumo/campaign/ensemble.hpp"
#include "lumo/campaign/lighting.hpp"
#include "lumo/campaign/observations.hpp"
#include "lumo/campaign/ray_refinement.hpp"
#include "lumo/campaign/stopwatch.hpp"
#include "lumo/core/executor.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/objective/contact_progression.hpp"
#include "lumo/objective/optical_separation.hpp"

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <numeric>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo {

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
  RayRefinement rays = {};
  int mesh_order = 2;                    ///< of the simulator's elements
  bool accept_held = false;              ///< score states of a solver that goes in time: the problem is what it holds, not equilibrium
};

/// Called after each step, and before the first of a long stage: stage, steps done, steps in all. May be called from any thread, one call at a time.
using ProgressReport = std::function<void(std::string_view stage, int done, int total)>;

/// Presses and lights a body in every scenario, and lights those states again with more rays that decide J_obs. Bit-identical for every
/// executor. Throws InvalidArgument and MeshError; a solve that fails is a status in its record.
template <class P, Indenter Tool, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress = {});

namespace detail {

template <class P, Indenter Tool, class Pad>
SolvedScenario solve_scenario(const Body& body, const Scenario<Tool>& scenario, const P& pipeline, const Pad& pad) {
  SolvedScenario out;
  const Stopwatch watch;
  out.states = pad.press(scenario);
  ScenarioRecord& record = out.record;
  record = {2.0 * contact_radius(scenario.indenter), scenario.angle_rad, scenario.y_m, out.states.back().status, {}, {}};
  record.terms = contact_terms(body, pad.mesh(), out.states, contact_radius(scenario.indenter), pipeline.mechanical_error);
  for (const MechanicalState& s : out.states)
    record.states.push_back({s.status, s.load_N, s.force_N, s.depth_m, s.contact_area_m2, s.reference_area_m2, s.residual_N, s.penetration_m, {}, {}});
  out.seconds = watch.seconds();
  return out;
}

/// Scenarios without a second symmetry plane take longest: they go first, so that threads end together.
template <Indenter Tool>
std::vector<std::size_t> longest_first(const ContactPlan<Tool>& plan) {
  std::vector<std::size_t> order(plan.solves.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  const auto halves = [&](std::size_t k) { return (plan.solves[k].scenario.y_m == 0.0) + (plan.solves[k].scenario.angle_rad == 0.0); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return halves(a) < halves(b); });
  return order;
}

/// Records of all scenarios from those that were solved.
template <Indenter Tool>
std::vector<ScenarioRecord> unfold(const std::vector<Scenario<Tool>>& scenarios, const ChannelImages& channels, const ContactPlan<Tool>& plan,
                                   const std::vector<SolvedScenario>& solved) {
  std::vector<ScenarioRecord> records;
  for (std::size_t k = 0; k < scenarios.size(); ++k) records.push_back(mirrored(solved[plan.images[k].solve].record, scenarios[k], channels, plan.images[k]));
  return records;
}

/// Meshes of different places give the same unloaded response up to their facets; that difference would hide small changes, so changes are
/// taken on one mesh and added to the common mean. `watts` names the mean power or its standard error.
inline std::vector<double> mean_per_emitted(const std::vector<Response>& responses, const std::vector<double> Response::*watts, int channels) {
  std::vector<double> mean(std::size_t(channels), 0.0);
  for (const Response& r : responses)
    for (std::size_t b = 0; b < mean.size(); ++b) mean[b] += (r.*watts)[b] / (r.ledger.emitted * double(responses.size()));
  return mean;
}

}  // namespace detail

template <class P, Indenter Tool, Executor E>
Observations observe(const Body& body, const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor, const ProgressReport& progress) {
  using Prepared = decltype(pipeline.simulator.prepare(body, std::declval<TetMesh>()));
  const detail::Stopwatch clock;
  Observations out;
  const int channels = pipeline.tracer.channels(body);  // 0: mechanics only
  const detail::ChannelImages images = channels > 0 ? detail::ChannelImages{pipeline.tracer.image_channels(body, 0), pipeline.tracer.image_channels(body, 1)}
                                                    : detail::ChannelImages{std::vector<int>{}, std::vector<int>{}};
  const ContactPlan plan = plan_contacts(scenarios, body.symmetry, {pipeline.mirror_once && images[0], pipeline.mirror_once && images[1]});
  std::mutex reporting;
  int done = 0;
  const auto begin = [&](std::string_view stage, std::size_t total) {
    done = 0;
    if (progress) progress(stage, done, int(total));
  };
  const auto report = [&](std::string_view stage, std::size_t total) {
    const std::lock_guard lock(reporting);
    if (progress) progress(stage, ++done, int(total));
  };

  // Meshes: scenarios at one place and angle share one.
  begin("mesh", plan.places.size());
  const TetMesh coarse = mesh_body(body, pipeline.mesher);
  std::vector<std::unique_ptr<Prepared>> places(plan.places.size());
  std::vector<double> meshing(places.size());
  executor.for_each(places.size(), [&](std::size_t k) {
    const detail::Stopwatch watch;
    std::vector<Scenario<Tool>> here;
    for (std::size_t s : plan.places[k].solves) here.push_back(plan.solves[s].scenario);
    places[k] = std::make_unique<Prepared>(pipeline.simulator.prepare(body, mesh_for_contact(body, coarse, here, pipeline.mesher, pipeline.focus, pipeline.mesh_order)));
    meshing[k] = watch.seconds();
    report("mesh", places.size());
  });

  // Equilibria.
  const std::vector<std::size_t> order = detail::longest_first(plan);
  std::vector<detail::SolvedScenario> solved(plan.solves.size());
  begin("press", order.size());
  executor.for_each(order.size(), [&](std::size_t i) {
    const auto& s = plan.solves[order[i]];
    solved[order[i]] = detail::solve_scenario(body, s.scenario, pipeline, *places[s.place]);
    report("press", order.size());
  });
  const bool all_converged = std::all_of(solved.begin(), solved.end(), [&](const auto& s) { return is_scored(s.record.status, pipeline.accept_held); });

  // Light, first for all states, then with more and more rays for those that decide.
  detail::Lighting lighting(body, plan, pipeline.tracer, pipeline.rays.focus_m, places, solved);
  if (channels > 0) {
    done = 0;
    lighting.trace(lighting.all(), 0, executor, [&](std::size_t n) { report("light", n); });
    out.unloaded_response = detail::mean_per_emitted(lighting.unloaded(), &Response::power_W, channels);
    out.unloaded_error = detail::mean_per_emitted(lighting.unloaded(), &Response::error_W, channels);
    for (int round = 1; all_converged && round <= pipeline.rays.rounds; ++round) {
      const auto undecided = lighting.undecided(detail::unfold(scenarios, images, plan, solved), pipeline.rays.tolerance);
      if (undecided.empty()) break;
      done = 0;
      lighting.trace(undecided, round, executor, [&](std::size_t n) { report(detail::text("light, ", rays_up_to(round), " times the rays"), n); });
    }
  }

  out.scenarios = detail::unfold(scenarios, images, plan, solved);
  for (ScenarioRecord& record : out.scenarios)
    for (StateRecord& s : record.states)
      for (Eigen::Index b = 0; b < s.change.cols(); ++b) s.response.push_back(out.unloaded_response[std::size_t(b)] + s.change.col(b).mean());
  for (const auto& p : places) {
    out.nodes = std::max(out.nodes, p->mesh().nodes.size());
    out.elements = std::max(out.elements, p->mesh().tets.size());
  }
  out.ledger = lighting.ledger;
  out.seconds.mesh = std::accumulate(meshing.begin(), meshing.end(), 0.0);
  for (const auto& s : solved) out.seconds.mechanics += s.seconds;
  out.seconds.optics = lighting.seconds;
  out.seconds.total = clock.seconds();
  return out;
}

}  // namespace lumo
