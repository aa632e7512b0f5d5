#pragma once

#include "lumo/core/executor.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/pipeline/ensemble.hpp"
#include "lumo/pipeline/lighting.hpp"
#include "lumo/pipeline/observations.hpp"

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
template <Mesher M, class Simulation, class Light> struct Pipeline {
  M mesher;
  Simulation simulator;
  Light tracer;
  Focus focus = {};
  MechanicalError mechanical_error = {};
  OpticalError optical_error = {};
  bool mirror_once = true;  ///< solve mirror images once
  RayRefinement rays = {};
  int mesh_order = 2;        ///< of the simulator's elements
  bool accept_held = false;  ///< score states that a solver in time holds, too, not equilibria only
};

/// Called after each step, and before the first of a long stage: stage, steps done, steps in all. May be called from
/// any thread, one call at a time.
using ProgressReport = std::function<void(std::string_view stage, int done, int total)>;

/// A body pressed in every scenario, which may be lit more than once.
template <class Pad, Indenter Tool> struct Pressed {
  std::vector<Scenario<Tool>> scenarios;
  ContactPlan<Tool> plan;
  std::vector<std::unique_ptr<Pad>> places;  ///< the body on the mesh of each place of the plan
  std::vector<SolvedScenario> solved;        ///< as the plan has them
  Timing seconds;
};

template <class P> using PadOf =
    decltype(std::declval<const P&>().simulator.prepare(std::declval<const Body&>(), std::declval<const TetMesh&>()));

namespace detail {

template <class P, Indenter Tool, class Pad>
SolvedScenario solve_scenario(const Body& body, const Scenario<Tool>& scenario, const P& pipeline, const Pad& pad) {
  SolvedScenario out;
  const Stopwatch watch;
  out.states = pad.press(scenario);
  out.record = record_of(body, pad.mesh(), scenario, out.states, pipeline.mechanical_error);
  out.seconds = watch.seconds();
  return out;
}

/// Scenarios without a second symmetry plane take longest. They go first, so that threads end together.
template <Indenter Tool> std::vector<std::size_t> longest_first(const ContactPlan<Tool>& plan) {
  std::vector<std::size_t> order(plan.solves.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  const auto halves = [&](std::size_t k) {
    return symmetry_of(plan.solves[k].scenario).x + symmetry_of(plan.solves[k].scenario).y;
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return halves(a) < halves(b); });
  return order;
}

/// Records of all scenarios from those that were solved.
template <Indenter Tool> std::vector<ScenarioRecord> expanded(const std::vector<Scenario<Tool>>& scenarios,
    const ChannelImages& channels, const ContactPlan<Tool>& plan, const std::vector<ScenarioRecord>& solved) {
  std::vector<ScenarioRecord> records;
  for (std::size_t k = 0; k < scenarios.size(); ++k)
    records.push_back(mirrored(solved[plan.images[k].solve], scenarios[k], channels, plan.images[k]));
  return records;
}

/// Meshes of different places give the same unloaded response up to their facets. That difference would hide small
/// changes: changes are taken on one mesh and added to the common mean. `watts` names the mean power or its standard
/// error.
inline std::vector<double> mean_per_emitted(
    const std::vector<Response>& responses, const std::vector<double> Response::*watts, int channels) {
  std::vector<double> mean(std::size_t(channels), 0.0);
  for (const Response& r : responses)
    for (std::size_t b = 0; b < mean.size(); ++b)
      mean[b] += (r.*watts)[b] / (r.ledger.emitted * double(responses.size()));
  return mean;
}

/// Mirror images of the channels of a body's light.
template <class Light> ChannelImages channel_images(const Body& body, const Light& light) {
  if (light.channels(body) == 0) return {std::vector<int>{}, std::vector<int>{}};  // mechanics only
  return {light.image_channels(body, 0), light.image_channels(body, 1)};
}

/// Are the mirror images known of all channels in all planes in which the plan mirrors contacts?
template <Indenter Tool> bool images_known(const ContactPlan<Tool>& plan, const ChannelImages& images) {
  return std::none_of(plan.images.begin(), plan.images.end(),
      [&](const ScenarioImage& i) { return (i.mirror.x && !images[0]) || (i.mirror.y && !images[1]); });
}

/// Counts the steps of one stage, from any thread.
class StageReport {
 public:
  StageReport(const ProgressReport& progress, std::string stage) : progress_(progress), stage_(std::move(stage)) {}
  void begin(std::size_t total) {
    if (progress_) progress_(stage_, 0, int(total));
  }
  void step(std::size_t total) {
    const std::lock_guard lock(mutex_);
    if (progress_) progress_(stage_, ++done_, int(total));
  }

 private:
  const ProgressReport& progress_;
  std::string stage_;
  int done_ = 0;
  std::mutex mutex_;
};

}  // namespace detail

/// Presses a body in every scenario. Bit-identical for every executor. Throws InvalidArgument and MeshError; a solve
/// that fails is a status in its record.
template <class P, Indenter Tool, Executor E> Pressed<PadOf<P>, Tool> press(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const ProgressReport& progress = {}) {
  const Stopwatch clock;
  const ChannelImages images = detail::channel_images(body, pipeline.tracer);
  Pressed<PadOf<P>, Tool> out;
  out.scenarios = scenarios;
  out.plan =
      plan_contacts(scenarios, body.symmetry, {pipeline.mirror_once && images[0], pipeline.mirror_once && images[1]});
  const ContactPlan<Tool>& plan = out.plan;

  // Meshes: scenarios at one place and angle share one.
  const std::size_t places = plan.places.size();
  detail::StageReport meshing(progress, "mesh");
  meshing.begin(places);
  const TetMesh coarse = mesh_body(body, pipeline.mesher);
  out.places.resize(places);
  std::vector<double> spent(places);
  executor.for_each(places, [&](std::size_t k) {
    const Stopwatch watch;
    std::vector<Scenario<Tool>> here;
    for (std::size_t s : plan.places[k].solves) here.push_back(plan.solves[s].scenario);
    out.places[k] = std::make_unique<PadOf<P>>(pipeline.simulator.prepare(
        body, mesh_for_contact(body, coarse, here, pipeline.mesher, pipeline.focus, pipeline.mesh_order)));
    spent[k] = watch.seconds();
    meshing.step(places);
  });

  // Equilibria.
  const std::vector<std::size_t> order = detail::longest_first(plan);
  out.solved.resize(order.size());
  detail::StageReport pressing(progress, "press");
  pressing.begin(order.size());
  executor.for_each(order.size(), [&](std::size_t i) {
    const auto& s = plan.solves[order[i]];
    out.solved[order[i]] = detail::solve_scenario(body, s.scenario, pipeline, *out.places[s.place]);
    pressing.step(order.size());
  });

  out.seconds.mesh = std::accumulate(spent.begin(), spent.end(), 0.0);
  for (const auto& s : out.solved) out.seconds.mechanics += s.seconds;
  out.seconds.total = clock.seconds();
  return out;
}

/// Are the mirror images of the channels of `body` known in all planes in which these presses stand for their mirror
/// images? Only then can `body` be lit in them.
template <class P, class Pad, Indenter Tool>
bool has_image_channels(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline) {
  return detail::images_known(pressed.plan, detail::channel_images(body, pipeline.tracer));
}

/// Lights a body in every state that was pressed, and states that decide J_obs again with more rays. `body` is the one
/// that was pressed, or differs from it in its optics only. The seconds contain those of the presses. Bit-identical for
/// every executor. Throws InvalidArgument, also unless has_image_channels().
template <class P, class Pad, Indenter Tool, Executor E> Observations observe(const Body& body,
    const Pressed<Pad, Tool>& pressed, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  const Stopwatch clock;
  const ChannelImages images = detail::channel_images(body, pipeline.tracer);
  if (!detail::images_known(pressed.plan, images))
    throw InvalidArgument(
        "observe: contacts were pressed once with their mirror images, but channels of the light have none");
  const int channels = pipeline.tracer.channels(body);  // 0: mechanics only
  Observations out;

  // Light: first for all states, then with more rays for those that decide.
  Lighting lighting(body, pressed.plan, pipeline.tracer, pipeline.rays.focus_m, pressed.places, pressed.solved);
  const auto trace = [&](const auto& states, int round, std::string stage) {
    detail::StageReport tracing(progress, std::move(stage));
    lighting.trace(states, round, executor, [&](std::size_t total) { tracing.step(total); });
  };
  if (channels > 0) {
    trace(lighting.all(), 0, "light");
    out.unloaded_response = detail::mean_per_emitted(lighting.unloaded(), &Response::power_W, channels);
    out.unloaded_error = detail::mean_per_emitted(lighting.unloaded(), &Response::error_W, channels);
    const bool scored = all_scored(lighting.records(), pipeline.accept_held);
    for (int round = 1; scored && round <= pipeline.rays.rounds; ++round) {
      const auto undecided = lighting.undecided(
          detail::expanded(pressed.scenarios, images, pressed.plan, lighting.records()), pipeline.rays.tolerance);
      if (undecided.empty()) break;
      trace(undecided, round, message("light, ", rays_up_to(round), " times the rays"));
    }
  }

  out.scenarios = detail::expanded(pressed.scenarios, images, pressed.plan, lighting.records());
  for (auto& record : out.scenarios)
    for (auto& s : record.states) {
      for (Eigen::Index b = 0; b < s.change.cols(); ++b)
        s.response.push_back(out.unloaded_response[std::size_t(b)] + s.change.col(b).mean());
      s.change_error = standard_error(s.change);
    }
  for (const auto& p : pressed.places) {
    out.nodes = std::max(out.nodes, p->mesh().nodes.size());
    out.elements = std::max(out.elements, p->mesh().tets.size());
  }
  out.ledger = lighting.ledger;
  out.seconds = pressed.seconds;
  out.seconds.optics = lighting.seconds;
  out.seconds.total += clock.seconds();
  return out;
}

/// Presses and lights a body in every scenario.
template <class P, Indenter Tool, Executor E> Observations observe(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const ProgressReport& progress = {}) {
  return observe(body, press(body, scenarios, pipeline, executor, progress), pipeline, executor, progress);
}

}  // namespace lumo
