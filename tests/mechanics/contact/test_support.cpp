#include "catch.hpp"
#include "lumo/mechanics/certify.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tetgen.hpp"

using namespace lumo;

namespace {

using FastSimulator = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<Cholmod>>;

/// Coarse: contracts do not need accuracy.
Body coarse_built(const FingerDesign& design) {
  FingerOptions o = built_finger();
  o.mesh = o.mesh.scaled(2.0);
  return finger(design, dragon_skin(), o);
}
TetMesh coarse_mesh(const Body& body, const Scenario<Sphere>& s) {
  const TetgenMesher mesher;
  return mesh_for_contact(body, mesh_body(body, mesher), std::vector{s}, mesher, {1.0e-3, 0.4, 1.0});
}

}  // namespace

TEST_CASE("A finger on its stem rests there without load: no force anywhere, the roof flat", "[support]") {
  const Body body = coarse_built(built_baseline());
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  const FastSimulator sim;
  const Sphere far{10e-3};
  const Moving<Sphere> tool{&far, Vec3d(0, 0, 1.0), -Vec3d::UnitZ()};
  const PressedState unloaded{0.0, std::vector<Vec3d>(mesh.nodes.size(), Vec3d::Zero())};
  CHECK(out_of_balance(body, mesh, PressPhysics{sim.material, sim.contact, sim.element}, tool, unloaded) < 1e-9);
  const Carrier carrier(body);
  int resting = 0;
  for (const BoundaryFace& f : mesh.faces) {
    if (body.patches[std::size_t(f.patch)].name != "void_roof") continue;
    Vec3d middle = Vec3d::Zero();
    for (std::size_t k = 0; k < 3; ++k) middle += mesh.nodes[std::size_t(f.nodes[k])] / 3.0;
    const double gap = carrier.distance(middle, {middle, f.patch});
    const bool over_a_recess = std::abs(gap - 0.19e-3) < 1e-9, on_a_ridge = std::abs(gap) < 1e-9;
    CHECK((over_a_recess || on_a_ridge || std::abs(middle.x()) > 3.8e-3));
    resting += on_a_ridge;
  }
  CHECK(resting > 10);
}

TEST_CASE("One equilibrium on the stem, whatever the loads before it", "[support]") {
  const FingerDesign d = GENERATE(FingerDesign{5, 9, 7.6, 6, 2}, FingerDesign{13, 7, 7.5, 14.5, 0});
  const Scenario<Sphere> at{Sphere{10e-3}, 0.0, 2e-3, {10.0}};
  const Body body = coarse_built(d);
  const TetMesh mesh = coarse_mesh(body, at);
  std::vector<MechanicalState> ends;
  for (const std::vector<double>& loads : {std::vector<double>{10.0}, {0.01, 2.0, 7.0, 10.0}}) {
    Scenario<Sphere> s = at;
    s.loads_N = loads;
    const std::vector<MechanicalState> states = FastSimulator{}.press(body, mesh, s);
    REQUIRE(states.size() == loads.size());
    for (const MechanicalState& state : states) {
      REQUIRE(state.status == Status::converged);
      CHECK(state.residual_N <= 1e-6 * state.load_N);
    }
    ends.push_back(states.back());
  }
  CHECK(ends[0].depth_m == Approx(ends[1].depth_m).epsilon(1e-5));
  double apart = 0.0;
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k)
    apart = std::max(apart, (ends[0].displacement[k] - ends[1].displacement[k]).norm());
  CHECK(apart < 1e-4 * ends[0].depth_m);

  // The stem only pushes: the roof lifts off somewhere, and sinks into nothing but the recesses.
  double up = 0.0, down = 0.0;
  for (const BoundaryFace& f : mesh.faces) {
    if (body.patches[std::size_t(f.patch)].name != "void_roof") continue;
    for (int n : f.nodes) {
      const Vec3d &x = mesh.nodes[std::size_t(n)], &u = ends[0].displacement[std::size_t(n)];
      if (std::abs(x.x()) > 0.5e-3 * d.w_s + 1e-9) continue;
      up = std::max(up, u.z());
      down = std::min(down, u.z());
    }
  }
  CHECK(up > 1e-6);
  CHECK(down > -0.22e-3);
  CHECK(down < -0.1e-3);
}

TEST_CASE("A roof that rubs on the stem gives way less than on a smooth one, and more than one that holds to it",
    "[support]") {
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {2.0, 10.0}};
  const auto pressed = [&](const SDFContact& contact, Stem stem) {
    FingerOptions o = built_finger();
    o.mesh = o.mesh.scaled(2.0);
    o.pad.stem = stem;
    const Body body = finger(built_baseline(), dragon_skin(), o);
    return FastSimulator{.contact = contact}.press(body, coarse_mesh(body, s), s);
  };
  const auto smooth = pressed({}, Stem::free), held = pressed({}, Stem::bonded),
             rubbing = pressed({.carrier_friction = 0.5}, Stem::free),
             same = pressed({.friction = 0.5, .carrier_friction = 0.0}, Stem::free);
  for (std::size_t k = 0; k < 2; ++k) {
    for (const auto* states : {&smooth, &held, &rubbing, &same}) REQUIRE((*states)[k].status == Status::converged);
    CHECK(rubbing[k].depth_m < 0.995 * smooth[k].depth_m);
    CHECK(rubbing[k].depth_m > 1.005 * held[k].depth_m);
    CHECK(rubbing[k].certified);
    CHECK(rubbing[k].friction_push_N == 0.0);  // the tool is smooth
    CHECK(rubbing[k].friction_N.size() == rubbing[k].displacement.size());
    CHECK(same[k].friction_push_N != 0.0);  // the other way round
  }
  double most = 0.0;
  for (const Vec3d& f : rubbing.back().friction_N) {
    CHECK(std::abs(f.z()) < 1e-9);  // along the roof
    most = std::max(most, f.norm());
  }
  CHECK(most > 1e-3);
}

TEST_CASE("Points rest on the support that they lie over, with one normal, and beside them on nothing", "[support]") {
  Body body;
  body.patches = {{"roof"}, {"wall"}};
  body.supports = {{"roof", {0, 0, 5e-3}, {4e-3, 0, 0}, {0, 10e-3, 0}},
      {"roof", {0, 0, 2e-3}, {6e-3, 0, 0}, {0, 10e-3, 0}}, {"wall", {4e-3, 0, 2e-3}, {0, 10e-3, 0}, {0, 0, 2e-3}}};
  const Carrier carrier(body);
  const MaterialPoint over{{3e-3, 1e-3, 5e-3}, 0}, beside{{5e-3, 1e-3, 5e-3}, 0}, away{{7e-3, 1e-3, 5e-3}, 0},
      wall{{5e-3, 1e-3, 1e-3}, 1};
  CHECK(carrier.distance({3e-3, 1e-3, 4.9e-3}, over) == Approx(-0.1e-3));
  CHECK(carrier.distance({4.5e-3, 1e-3, 4.9e-3}, over) == Approx(-0.1e-3));  // it slid over the edge, and stays
  CHECK(carrier.distance({5e-3, 1e-3, 4.9e-3}, beside) == Approx(2.9e-3));
  CHECK(std::isinf(carrier.distance({7e-3, 1e-3, 4.9e-3}, away)));
  CHECK(carrier.distance({3.9e-3, 1e-3, 1e-3}, wall) == Approx(-0.1e-3));
  CHECK(carrier.sample({3.9e-3, 1e-3, 1e-3}, wall).gradient == Vec3d::UnitX());
  CHECK(carrier.reaches({3e-3, 0, 5.5e-3}, 1e-3, 0));
  CHECK_FALSE(carrier.reaches({3e-3, 0, 7.5e-3}, 1e-3, 0));
}
