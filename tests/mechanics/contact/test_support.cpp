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
  const Carrier carrier{body.carrier};
  int resting = 0;
  for (const BoundaryFace& f : mesh.faces) {
    if (body.patches[std::size_t(f.patch)].name != "void_roof") continue;
    Vec3d middle = Vec3d::Zero();
    for (std::size_t k = 0; k < 3; ++k) middle += mesh.nodes[std::size_t(f.nodes[k])] / 3.0;
    const double gap = carrier.distance(middle);
    const bool over_a_recess = std::abs(gap - 0.19e-3) < 1e-9, on_a_ridge = std::abs(gap) < 1e-9;
    const double from_led = std::abs(std::remainder(middle.y(), 11e-3));  // LEDs at 0, ±11, ±22 mm
    const bool on_an_edge =
        std::abs(middle.x()) > 3.4e-3 || std::abs(middle.y()) > 27.1e-3 || (from_led > 2.55e-3 && from_led < 2.95e-3);
    CHECK((over_a_recess || on_a_ridge || (on_an_edge && gap > 0.0)));
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
      if (std::abs(x.x() + u.x()) > 0.5e-3 * d.w_s - 0.4e-3) continue;  // on its edge
      up = std::max(up, u.z());
      down = std::min(down, u.z());
    }
  }
  CHECK(up > 1e-6);
  CHECK(down > -0.22e-3);
  CHECK(down < -0.1e-3);
}

TEST_CASE("A pad that is pushed over its stem's edge comes to rest on it, whatever the loads before", "[support]") {
  const Scenario<Sphere> at{Sphere{30e-3}, 30.0 * pi / 180.0, 0.0, {10.0}};
  const Body body = coarse_built(built_baseline());
  const TetMesh mesh = coarse_mesh(body, at);
  const Carrier carrier{body.carrier};
  std::vector<MechanicalState> ends;
  for (const std::vector<double>& loads : {std::vector<double>{10.0}, {0.5, 3.0, 8.0, 10.0}}) {
    Scenario<Sphere> s = at;
    s.loads_N = loads;
    ends.push_back(FastSimulator{}.press(body, mesh, s).back());
    REQUIRE(ends.back().certified);
  }
  CHECK(ends[0].depth_m == Approx(ends[1].depth_m).epsilon(1e-4));
  double deepest = 0.0, furthest = 0.0;
  for (const BoundaryFace& f : mesh.faces) {
    if (body.patches[std::size_t(f.patch)].name != "void_roof") continue;
    for (int n : f.nodes) {
      const Vec3d& u = ends[0].displacement[std::size_t(n)];
      const double gap = carrier.distance(mesh.nodes[std::size_t(n)] + u);
      deepest = std::max(deepest, -gap);
      if (gap <= 0.0) furthest = std::max(furthest, std::abs(u.x()));
    }
  }
  CHECK(furthest > 0.5e-3);
  CHECK(deepest < 0.1e-3);
}

TEST_CASE(
    "A pad near an equilibrium that does not last reaches the one that does, whatever the loads before", "[support]") {
  const Scenario<Sphere> at{Sphere{15e-3}, 0.0, 22e-3, {15.0}};  // a thin roof bends over the edge
  const Body body = coarse_built({5.5, 2, 9, 2, 0.5});
  const TetMesh mesh = coarse_mesh(body, at);
  std::vector<double> depth_m;
  for (const std::vector<double>& loads : {std::vector<double>{15.0}, {1.0, 5.0, 10.0, 15.0}}) {
    Scenario<Sphere> s = at;
    s.loads_N = loads;
    FastSimulator sim;
    sim.solver.config.max_iterations = 60;  // steps without any of the edge's curvature took more than twice as many
    const MechanicalState end = sim.press(body, mesh, s).back();
    REQUIRE(end.certified);
    depth_m.push_back(end.depth_m);
  }
  CHECK(depth_m[0] == Approx(depth_m[1]).epsilon(1e-6));
}

TEST_CASE("A bound of a far face's gaps has their sign", "[support]") {
  const Body body = coarse_built({14.5, 4, 5, 12.5, 5});
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  const ContactSurface roof(mesh, body, [](const Patch& p) { return p.meets_carrier; });
  const Carrier carrier{body.carrier};
  const Moving<Carrier> rigid{&carrier, Vec3d::Zero(), Vec3d::Zero()};
  Positions x(3, Eigen::Index(mesh.nodes.size())), dx = x;
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k];
  std::srand(3);
  for (const double moved_m : {0.0, 1e-5, 1e-3, 5e-3}) {
    dx.setRandom();
    dx *= moved_m;
    const ContactPlace<Carrier> at{rigid, x};
    const SurfaceGaps signs = predicted_gaps(roof, at, at, dx, 0.0);
    std::size_t bounds = 0;
    for (std::size_t f = 0; f < roof.size(); ++f) {
      const std::vector<double> all = predicted_gaps(roof, f, at, at, dx, 0.0);
      for (std::size_t k = 0; k < all.size(); ++k) {
        REQUIRE((all[k] < 0.0) == (signs[f][k] < 0.0));
        bounds += all[k] != signs[f][k];
      }
    }
    CHECK((moved_m > 1e-4 || bounds > 0));
  }
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
  double along = 0.0, across = 0.0;
  for (const Vec3d& f : rubbing.back().friction_N) {
    along += f.head<2>().norm();
    across += std::abs(f.z());  // at the rounded edges only
    most = std::max(most, f.norm());
  }
  CHECK(across < 0.2 * along);
  CHECK(most > 1e-3);
}

TEST_CASE("The edges of a carrier are cylinders, its corners spheres, and its sides stay where they are", "[support]") {
  const Carrier carrier{{{{0, 0, 2e-3}, {4e-3, 10e-3, 3e-3}, 0.5e-3}, {{0, 0, -2e-3}, {9e-3, 10e-3, 2e-3}}}};
  CHECK(carrier.distance({1e-3, 1e-3, 4.9e-3}) == Approx(-0.1e-3));
  CHECK(carrier.sample({1e-3, 1e-3, 4.9e-3}).gradient == Vec3d::UnitZ());
  CHECK(carrier.distance({3.9e-3, 1e-3, 1e-3}) == Approx(-0.1e-3));
  CHECK(carrier.sample({3.9e-3, 1e-3, 1e-3}).gradient == Vec3d::UnitX());
  CHECK(carrier.distance({8e-3, 1e-3, 0.1e-3}) == Approx(0.1e-3));
  // About the axis of an edge, and about the centre of a corner.
  const Vec3d axis(3.5e-3, 1e-3, 4.5e-3), centre(3.5e-3, 9.5e-3, 4.5e-3);
  for (double angle = 0.1; angle < 1.5; angle += 0.2) {
    const Vec3d across(std::cos(angle), 0, std::sin(angle));
    CHECK(carrier.distance(axis + 0.5e-3 * across) == Approx(0.0).margin(1e-15));
    CHECK((carrier.sample(axis + 0.48e-3 * across).gradient - across).norm() < 1e-12);
    const Vec3d out = Vec3d(across.x(), 0.7, across.z()).normalized();
    CHECK(carrier.distance(centre + 0.6e-3 * out) == Approx(0.1e-3));
    CHECK((carrier.sample(centre + 0.6e-3 * out).gradient - out).norm() < 1e-12);
  }
}
