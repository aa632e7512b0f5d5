#pragma once

#include "lumo/core/executor.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/region_images.hpp"
#include "lumo/pipeline/ensemble.hpp"
#include "lumo/pipeline/lighting.hpp"
#include "lumo/pipeline/observations.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <numeric>
#include <set>
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
  bool refine_once = true;   ///< mesh a place again, and finer, where a contact was not resolved, or a press lost
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

/// A body of which one side is seen, as if both were: its regions, and then their mirror images in x = 0.
inline Body with_both_sides(Body body) {
  const int n = body.regions;
  body.regions = 2 * n;
  body.region = [n, one = body.region](const Vec3d& p, const Vec3d& normal) {
    const Vec3d flip(-1.0, 1.0, 1.0);
    if (const int here = one(p, normal); here >= 0) return here;
    const int there = one(flip.cwiseProduct(p), flip.cwiseProduct(normal));
    return there >= 0 ? n + there : -1;
  };
  std::vector<int> other;
  for (int k = 0; k < 2 * n; ++k) other.push_back((k + n) % (2 * n));
  body.region_image_x = other;
  if (body.region_image_y && !body.region_image_y->empty())
    for (int k = 0; k < n; ++k) body.region_image_y->push_back(n + (*body.region_image_y)[std::size_t(k)]);
  return body;
}

/// How a body is lit so that contacts stand for their mirror images, and what of it is seen.
struct LitSides {
  std::optional<Body> both;  ///< of a body of which one side is seen
  ChannelImages images;
  std::vector<int> seen;  ///< channels

  template <class Light> LitSides(const Body& body, const Light& light) {
    const int channels = light.channels(body), colors = color_count(body.emitters);
    if (channels == 0) {  // mechanics only
      images = {std::vector<int>{}, std::vector<int>{}};
      return;
    }
    if (body.symmetry.x && body.region) both = with_both_sides(body);
    const bool knows_regions = both && light.channels(*both) == 2 * channels;
    if (!knows_regions || region_images(body, 0).kind != RegionImages::Kind::unseen) both.reset();
    const int of_color = channels / colors;
    for (int c = 0; c < colors; ++c)
      for (int k = 0; k < of_color; ++k) seen.push_back(c * (both ? 2 : 1) * of_color + k);
    images = {light.image_channels(lit(body), 0), light.image_channels(lit(body), 1)};
  }
  const Body& lit(const Body& body) const { return both ? *both : body; }
};

/// Records of all scenarios from those that were solved, with the channels that are seen.
template <Indenter Tool> std::vector<ScenarioRecord> expanded(const std::vector<Scenario<Tool>>& scenarios,
    const LitSides& sides, const ContactPlan<Tool>& plan, const std::vector<ScenarioRecord>& solved) {
  std::vector<ScenarioRecord> records;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    records.push_back(mirrored(solved[plan.images[k].solve], scenarios[k], sides.images, plan.images[k]));
    for (StateRecord& s : records.back().states)
      if (s.change.cols() > Eigen::Index(sides.seen.size()))
        s.change = Eigen::MatrixXd(s.change(Eigen::all, sides.seen));
  }
  return records;
}

/// Meshes of different places give the same unloaded response up to their facets. That difference would hide small
/// changes: changes are taken on one mesh and added to the common mean. `watts` names the mean power or its standard
/// error.
inline std::vector<double> mean_per_emitted(
    const std::vector<Response>& responses, const std::vector<double> Response::*watts, const std::vector<int>& seen) {
  std::vector<double> mean(seen.size(), 0.0);
  for (const Response& r : responses)
    for (std::size_t b = 0; b < mean.size(); ++b)
      mean[b] += (r.*watts)[std::size_t(seen[b])] / (r.ledger.emitted * double(responses.size()));
  return mean;
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

namespace detail {

/// Meshes places of a plan and presses there.
template <class P, Indenter Tool> struct PlacePresses {
  const Body& body;
  const P& pipeline;
  TetMesh coarse;
  Pressed<PadOf<P>, Tool>& out;
  std::vector<std::vector<FinePlace>> more = std::vector<std::vector<FinePlace>>(out.plan.places.size());
  std::set<std::size_t> lost = {};  ///< places whose next mesh is to be another one

  template <Executor E> void run(const std::vector<std::size_t>& places, const E& executor,
      const ProgressReport& progress, const std::string& how) {
    out.places.resize(out.plan.places.size());
    out.solved.resize(out.plan.solves.size());
    StageReport meshing(progress, "mesh" + how);
    meshing.begin(places.size());
    std::vector<double> spent(places.size());
    executor.for_each(places.size(), [&](std::size_t k) {
      const Stopwatch watch;
      mesh(places[k]);
      spent[k] = watch.seconds();
      meshing.step(places.size());
    });
    std::vector<std::size_t> order;
    for (const std::size_t k : longest_first(out.plan))
      if (std::find(places.begin(), places.end(), out.plan.solves[k].place) != places.end()) order.push_back(k);
    StageReport pressing(progress, "press" + how);
    pressing.begin(order.size());
    executor.for_each(order.size(), [&](std::size_t i) {
      const auto& s = out.plan.solves[order[i]];
      out.solved[order[i]] = solve_scenario(body, s.scenario, pipeline, *out.places[s.place]);
      pressing.step(order.size());
    });
    out.seconds.mesh += std::accumulate(spent.begin(), spent.end(), 0.0);
  }

  /// Places with a contact that is not resolved, whose next mesh will be finer there, and with a press that was lost,
  /// which will be tried on another mesh; unless so many were that it is the body which gives way.
  std::vector<std::size_t> to_try_again() {
    std::set<std::size_t> places;
    for (std::size_t k = 0; k < out.solved.size(); ++k) {
      const std::size_t place = out.plan.solves[k].place;
      if (is_lost(out.solved[k].record.status)) lost.insert(place);
      if (!out.solved[k].record.unresolved) continue;
      for (const MechanicalState& s : out.solved[k].states) add_places(s, more[place]);
      places.insert(place);
    }
    if (lost.size() > std::max<std::size_t>(1, out.plan.places.size() / 4)) lost.clear();
    places.insert(lost.begin(), lost.end());
    return {places.begin(), places.end()};
  }

 private:
  static constexpr double finest_wanted = 20e-6;  // [m]
  static constexpr double of_lost = 0.8;          // edges about a lost contact, on its next mesh

  // Covers where the tool presses, if a contact wants a finer mesh.
  void add_places(const MechanicalState& state, std::vector<FinePlace>& all) const {
    double edge = std::numeric_limits<double>::infinity(), apart = edge;
    for (const ContactSpot& spot : state.spots)
      if (const double wanted = pipeline.mechanical_error.wanted_edge(spot); wanted < spot.edge_m) {
        edge = std::min(edge, std::max(wanted, finest_wanted));
        apart = std::min(apart, std::max(spot.radius_m(), spot.edge_m));
      }
    if (!std::isfinite(edge)) return;
    for (const TractionPoint& p : state.tractions)
      if (std::none_of(all.begin(), all.end(), [&](const FinePlace& known) {
            return known.finest_m <= edge && (known.place_m - p.reference_m).norm() < apart;
          }))
        all.push_back({p.reference_m, edge});
  }

  // Scenarios at one place and angle share a mesh. One that cannot be made finer stays.
  void mesh(std::size_t place) const {
    std::vector<Scenario<Tool>> here;
    for (const std::size_t s : out.plan.places[place].solves) here.push_back(out.plan.solves[s].scenario);
    const bool other = lost.contains(place);
    Focus about = other ? pipeline.focus.scaled(of_lost) : pipeline.focus;
    Body wanted = focused_on_contact(body, coarse, here, about);
    if (!more[place].empty()) {
      about.growth = std::min(about.growth, Focus{}.growth);
      wanted = focused(wanted, more[place], about);
    }
    try {
      out.places[place] = std::make_unique<PadOf<P>>(
          pipeline.simulator.prepare(body, mesh_body(wanted, pipeline.mesher, pipeline.mesh_order)));
    } catch (const MeshError&) {
      if (more[place].empty() && !other) throw;
    }
  }
};

}  // namespace detail

/// Presses a body in every scenario. Where a mesh turns out to be too coarse for a contact, or a press is lost on it at
/// a place or two, that is meshed and pressed once more (Pipeline::refine_once). Bit-identical for every executor.
/// Throws InvalidArgument and MeshError; a solve that fails is a status in its record.
template <class P, Indenter Tool, Executor E> Pressed<PadOf<P>, Tool> press(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const ProgressReport& progress = {}) {
  const Stopwatch clock;
  const ChannelImages images = detail::LitSides(body, pipeline.tracer).images;
  Pressed<PadOf<P>, Tool> out;
  out.scenarios = scenarios;
  out.plan =
      plan_contacts(scenarios, body.symmetry, {pipeline.mirror_once && images[0], pipeline.mirror_once && images[1]});

  detail::PlacePresses<P, Tool> presses{body, pipeline, mesh_body(body, pipeline.mesher), out};
  std::vector<std::size_t> places(out.plan.places.size());
  std::iota(places.begin(), places.end(), std::size_t(0));
  presses.run(places, executor, progress, "");
  if (pipeline.refine_once)
    if (const auto again = presses.to_try_again(); !again.empty())
      presses.run(again, executor, progress, " again, finer");
  for (const auto& s : out.solved) out.seconds.mechanics += s.seconds;
  out.seconds.total = clock.seconds();
  return out;
}

/// Are the mirror images of the channels of `body` known in all planes in which these presses stand for their mirror
/// images? Only then can `body` be lit in them.
template <class P, class Pad, Indenter Tool>
bool has_image_channels(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline) {
  return detail::images_known(pressed.plan, detail::LitSides(body, pipeline.tracer).images);
}

/// Lights a body in every state that was pressed, and states that decide J_obs again with more rays. `body` is the one
/// that was pressed, or differs from it in its optics only. The seconds contain those of the presses. Bit-identical for
/// every executor. Throws InvalidArgument, also unless has_image_channels(), and as Tracer::trace() does.
template <class P, class Pad, Indenter Tool, Executor E> Observations observe(const Body& body,
    const Pressed<Pad, Tool>& pressed, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  const Stopwatch clock;
  const detail::LitSides sides(body, pipeline.tracer);
  if (!detail::images_known(pressed.plan, sides.images))
    throw InvalidArgument(
        "observe: contacts were pressed once with their mirror images, but channels of the light have none");
  const bool has_light = !sides.seen.empty();
  Observations out;

  // Light: first for all states, then with more rays for those that decide.
  Lighting lighting(sides.lit(body), pressed.plan, pipeline.tracer, pipeline.rays, pressed.places, pressed.solved);
  const auto trace = [&](const auto& states, std::string stage) {
    detail::StageReport tracing(progress, std::move(stage));
    lighting.trace(states, executor, [&](std::size_t total) { tracing.step(total); });
  };
  if (has_light) {
    trace(lighting.all(), "light");
    out.unloaded_response = detail::mean_per_emitted(lighting.unloaded(), &Response::power_W, sides.seen);
    out.unloaded_error = detail::mean_per_emitted(lighting.unloaded(), &Response::error_W, sides.seen);
    const bool scored = all_scored(lighting.records(), pipeline.accept_held);
    for (int round = 1; scored && round <= pipeline.rays.rounds; ++round) {
      const auto undecided = lighting.undecided(
          detail::expanded(pressed.scenarios, sides, pressed.plan, lighting.records()), pipeline.optical_error);
      if (undecided.empty()) break;
      trace(undecided, message("light of ", undecided.size(), " states, round ", round));
    }
  }

  out.scenarios = detail::expanded(pressed.scenarios, sides, pressed.plan, lighting.records());
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
