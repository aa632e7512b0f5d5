#include "catch.hpp"
#include "coarse_pipeline.hpp"
#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/mechanics/indenters/capsule.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

using namespace lumo;

namespace {

/// Half lengths and height [m].
struct Block {
  double a, b, h;
};

/// A block that stands on z = 0, bonded, and is touched above; only a half or a quarter of it is described where it has
/// planes of symmetry.
Body body_of(const Block& block, Symmetry planes) {
  const auto [a, b, h] = block;
  Body body;
  body.name = "block";
  body.symmetry = planes;
  for (int k = 0; k < 8; ++k)
    body.vertices.emplace_back(k & 1 ? a : planes.x ? 0.0 : -a, k & 2 ? b : planes.y ? 0.0 : -b, k & 4 ? h : 0.0);
  const auto side = [](const char* name, const Vec3d& at, const Vec3d& normal) {
    return Patch{.name = name, .shape = Plane{at, normal}};
  };
  body.patches = {side("bottom", {0, 0, 0}, -Vec3d::UnitZ()), side("top", {0, 0, h}, Vec3d::UnitZ()),
      side("x+", {a, 0, 0}, Vec3d::UnitX()), side("y+", {0, b, 0}, Vec3d::UnitY()),
      side("x-", {-a, 0, 0}, -Vec3d::UnitX()), side("y-", {0, -b, 0}, -Vec3d::UnitY())};
  body.patches[0].bonded = true;
  body.patches[1].contactable = true;
  body.facets = {{{0, 2, 3, 1}, 0}, {{4, 5, 7, 6}, 1}, {{1, 3, 7, 5}, 2}, {{2, 6, 7, 3}, 3},
      {{0, 4, 6, 2}, planes.x ? Body::mirror_patch : 4}, {{0, 1, 5, 4}, planes.y ? Body::mirror_patch : 5}};
  body.exact_volume_m3 = 4 * a * b * h;
  body.pivot = {0, 0, h};
  body.sizing.edge = [](const Vec3d&) { return 6e-3; };
  return body;
}

/// Two balls side by side, as the pins of a plug.
struct TwoBalls {
  double ball = 1.5e-3, half = 4e-3;

  bool operator==(const TwoBalls&) const = default;
  double radius_m() const { return half + ball; }
  double contact_radius_m() const { return ball; }
  bool symmetric(int) const { return true; }
  Vec3d from_centre(const Vec3d& p) const { return p - Vec3d(p.x() < 0 ? -half : half, 0, 0); }
  double distance(const Vec3d& p) const { return from_centre(p).norm() - ball; }
  DistanceSample sample(const Vec3d& p) const {
    const Vec3d d = from_centre(p), n = d.normalized();
    return {d.norm() - ball, n, (Mat3d::Identity() - n * n.transpose()) / d.norm()};
  }
};
void validate(const TwoBalls&) {}

const NeoHookean soft{.mu = 106e3, .lambda = 10.494e6};
constexpr double reduced_Pa = 2 * 106e3 / (1 - 0.495);  // E* of Hertz under a rigid tool, ν = 0.495

/// Presses that are lost on the first meshes of some places.
struct LostPresses {
  using Simulation = decltype(CoarsePipeline::simulator);
  Simulation simulation;
  std::set<double> lost_y_m;
  std::size_t first_meshes;
  std::shared_ptr<std::vector<std::size_t>> nodes = std::make_shared<std::vector<std::size_t>>();  ///< of all meshes

  struct Pad {
    decltype(std::declval<Simulation>().prepare(std::declval<Body>(), std::declval<TetMesh>())) pad;
    std::set<double> lost_y_m;

    const TetMesh& mesh() const { return pad.mesh(); }
    std::vector<MechanicalState> press(const Scenario<Sphere>& s) const {
      std::vector<MechanicalState> states = pad.press(s);
      if (lost_y_m.contains(s.y_m)) states.back().status = Status::not_positive_definite;
      return states;
    }
  };
  Pad prepare(const Body& body, const TetMesh& mesh) const {
    nodes->push_back(mesh.nodes.size());
    return {simulation.prepare(body, mesh), nodes->size() <= first_meshes ? lost_y_m : std::set<double>{}};
  }
};

template <class Tool> SolvedScenario pressed(
    const Body& body, const Scenario<Tool>& scenario, const Focus& focus = {}, bool refine_once = true) {
  CoarsePipeline pipeline = coarse_pipeline();
  pipeline.simulator.material = soft;
  pipeline.focus = focus;
  pipeline.refine_once = refine_once;
  pipeline.mirror_once = false;
  auto done = press(body, std::vector{scenario}, pipeline, Serial{});
  return std::move(done.solved.front());
}

}  // namespace

TEST_CASE("two balls press two contacts of Hertz's area, however much of the block is described") {
  const double depth = std::pow(0.75 * 0.05 / (reduced_Pa * std::sqrt(1.5e-3)), 2.0 / 3.0);
  const Scenario<TwoBalls> s{TwoBalls{}, 0.0, 0.0, {0.1}};
  for (const Symmetry planes : {Symmetry{true, true}, Symmetry{true, false}, Symmetry{false, false}}) {
    CAPTURE(planes.x, planes.y);
    const Body body = body_of({15e-3, 12e-3, 10e-3}, planes);
    CHECK(touched_places(body, mesh_body(body, TetgenMesher{}), s).size() == 2);
    const SolvedScenario solved = pressed(body, s);
    const MechanicalState& state = solved.states.back();
    REQUIRE(state.status == Status::converged);
    CHECK(solved.record.status == Status::converged);
    REQUIRE(state.spots.size() == 2);
    for (const ContactSpot& spot : state.spots)
      CHECK(spot.area_m2 == Approx(pi * 1.5e-3 * depth).epsilon(0.04));  // the block is 20 radii deep
    CHECK(state.depth_m == Approx(depth).epsilon(0.02));
  }
}

TEST_CASE("a lying bar presses along its whole length") {
  // Hertz's line contact, 30 mm long; the round ends add a few percent.
  const Scenario<Oriented<Capsule>> s{lying_along_y(Capsule{4e-3, 30e-3}), 0.0, 0.0, {0.5}};
  const double line = 2.0 * 30e-3 * std::sqrt(4.0 * 0.5 / 30e-3 * 2e-3 / (pi * reduced_Pa));
  for (const Symmetry planes : {Symmetry{true, true}, Symmetry{false, false}}) {
    CAPTURE(planes.x);
    const Body body = body_of({15e-3, 25e-3, 12e-3}, planes);
    const MechanicalState state = pressed(body, s).states.back();
    REQUIRE(state.status == Status::converged);
    CHECK(state.spots.size() == 1);
    CHECK(state.contact_area_m2 > 1.0 * line);
    CHECK(state.contact_area_m2 < 1.1 * line);
    CHECK(state.depth_m == Approx(0.098e-3).epsilon(0.02));  // the same on each mesh
  }
}

TEST_CASE("a contact that its mesh does not resolve has no score, or is meshed once more") {
  const Body body = body_of({12e-3, 12e-3, 10e-3}, {true, true});
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {0.01}};
  const double radius = std::cbrt(0.75 * 0.01 * 5e-3 / reduced_Pa);
  const Focus coarse{1.2e-3, 0.4, 1.0};

  const ScenarioRecord once = pressed(body, s, coarse, false).record;
  CHECK(once.states.front().status == Status::converged);
  CHECK(once.status == Status::unresolved);
  REQUIRE(once.unresolved);
  CHECK(once.unresolved->load_N == 0.01);
  CHECK(once.unresolved->edge_m > 0.8 * radius);
  CHECK(failed_press({once}).starts_with("press: the contact is not resolved at 0.01 N: radius 0."));

  // One that ran out of time says so; it is not pressed again on a mesh that takes longer.
  SolvedScenario late = pressed(body, s, coarse, false);
  late.states.back().status = Status::time_limit;
  const TetgenMesher mesher;
  const ScenarioRecord ended =
      record_of(body, mesh_for_contact(body, mesh_body(body, mesher), std::vector{s}, mesher, coarse), s, late.states);
  CHECK(ended.status == Status::time_limit);
  CHECK_FALSE(ended.unresolved);
  CHECK(failed_press({ended}).starts_with("press: time_limit at 0.01 N, sphere of 10 mm"));

  const SolvedScenario twice = pressed(body, s, coarse);
  CHECK(twice.record.status == Status::converged);
  CHECK_FALSE(twice.record.unresolved);
  const StateRecord& state = twice.record.states.front();
  CHECK(std::abs(state.contact_area_m2 - pi * radius * radius) < state.contact_area_error_m2);
  CHECK(state.contact_area_error_m2 < 0.15 * state.contact_area_m2);
}

TEST_CASE("printed errors of depth and area cover what a finer mesh says") {
  const Body body = body_of({12e-3, 12e-3, 8e-3}, {true, true});
  const Scenario<Sphere> s{Sphere{8e-3}, 0.0, 0.0, {0.5, 3.0}};
  const ScenarioRecord fine = pressed(body, s, {0.25e-3, 0.1, 0.5}).record;
  for (const double edge : {0.4e-3, 0.6e-3, 0.8e-3, 1.6e-3}) {
    CAPTURE(edge);
    const ScenarioRecord r = pressed(body, s, {edge, 0.3, 1.0}).record;
    REQUIRE(r.status == Status::converged);
    for (std::size_t k = 0; k < 2; ++k) {
      const StateRecord &a = r.states[k], &b = fine.states[k];
      CHECK(std::abs(a.depth_m - b.depth_m) < a.depth_error_m + b.depth_error_m);
      CHECK(std::abs(a.contact_area_m2 - b.contact_area_m2) < a.contact_area_error_m2 + b.contact_area_error_m2);
      CHECK(a.contact_area_error_m2 < 0.4 * a.contact_area_m2);
    }
  }
}

TEST_CASE("a press that is lost at one place is tried on a finer mesh, and where most are, the body gives way") {
  const Body body = body_of({12e-3, 20e-3, 10e-3}, {true, false});
  std::vector<Scenario<Sphere>> scenarios;
  for (const double y : {-10e-3, 0.0, 10e-3}) scenarios.push_back({Sphere{10e-3}, 0.0, y, {1.0}});
  const auto pressed_with = [&](std::set<double> lost, bool refine_once) {
    const CoarsePipeline usual = coarse_pipeline();
    LostPresses presses{{soft}, std::move(lost), scenarios.size()};
    Pipeline<TetgenMesher, LostPresses, CoarseLight> pipeline{usual.mesher, presses, usual.tracer, usual.focus};
    pipeline.mirror_once = false;
    pipeline.refine_once = refine_once;
    std::vector<Status> status;
    for (const SolvedScenario& s : press(body, scenarios, pipeline, Serial{}).solved) status.push_back(s.record.status);
    return std::pair(status, *presses.nodes);
  };
  constexpr Status found = Status::converged, lost = Status::not_positive_definite;

  const auto [again, meshes] = pressed_with({10e-3}, true);
  CHECK(again == std::vector{found, found, found});
  REQUIRE(meshes.size() == 4);
  CHECK(meshes.back() > *std::min_element(meshes.begin(), meshes.end() - 1));

  CHECK(pressed_with({10e-3}, false) ==
        std::pair(std::vector{found, found, lost}, std::vector(meshes.begin(), meshes.end() - 1)));
  CHECK(pressed_with({-10e-3, 10e-3}, true).first == std::vector{lost, found, lost});
}
