#include "catch.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tetgen.hpp"
#include "mechanics/bodies.hpp"

#include <cmath>

using namespace lumo;

// The names that users type, with Eigen alone.
template struct lumo::Simulator<NeoHookean, SDFContact>;

namespace {

using FastSimulator = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<Cholmod>>;

/// Grid lines that grow from 0 to 1, the first step `first` times the mean.
std::vector<double> graded(int n, double power) {
  std::vector<double> x;
  for (int i = 0; i <= n; ++i) x.push_back(std::pow(double(i) / n, power));
  return x;
}
std::vector<double> from_top(int n, double power) {
  std::vector<double> x;
  for (int i = 0; i <= n; ++i) x.push_back(1.0 - std::pow(1.0 - double(i) / n, power));
  return x;
}

struct PressedFinger {
  Body body;
  TetMesh mesh;
};

/// A coarse finger: contracts do not need accuracy.
PressedFinger coarse_finger(const FingerDesign& design, const Scenario<Sphere>& scenario) {
  FingerOptions o = plain_finger();
  o.mesh.contact_edge = 5e-3;
  const Body body = finger(design, dragon_skin(), o);
  const TetgenMesher mesher;
  return {body, mesh_for_contact(body, mesh_body(body, mesher), std::vector{scenario}, mesher, {1.0e-3, 0.4, 1.0})};
}

}  // namespace

TEST_CASE("a sphere on a deep soft block meets Hertz in force and in area") {
  // Hertz 1882: F = 4/3 E* sqrt(R) d^1.5, a^3 = 3/4 F R / E* (small strain, half-space; the block is 80 contact radii
  // wide and deep).
  const double nu = 0.45, mu = 1e5, lambda = 2 * mu * nu / (1 - 2 * nu), E_star = 2 * mu * (1 + nu) / (1 - nu * nu),
               R = 20e-3;
  const Body body = test::block_to_mesh(Vec3d::Constant(40e-3), 0.05e-3, 0.12, 12e-3);
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  FastSimulator sim{NeoHookean{mu, lambda}, SDFContact{3e12}};
  const Scenario<Sphere> s{Sphere{2 * R}, 0.0, 0.0, {0.002, 0.004}};
  for (const MechanicalState& state : sim.press(body, mesh, s)) {
    REQUIRE(state.status == Status::converged);
    const double d = state.depth_m;
    const double hertz = 4.0 / 3.0 * E_star * std::sqrt(R) * std::pow(d, 1.5);
    INFO("F " << state.force_N << " d/R " << d / R << " a " << std::sqrt(R * d) << " F/F_Hertz "
              << state.force_N / hertz << " A/A_Hertz " << state.contact_area_m2 / (pi * R * d) << " overlap/d "
              << state.penetration_m / d);
    CHECK(state.force_N / hertz == Approx(1.0).margin(0.03));
    const double a2 =
        std::pow(0.75 * state.force_N * R / E_star, 2.0 / 3.0);  // from the force, so that both are tested
    CHECK(state.contact_area_m2 / (pi * a2) == Approx(1.0).margin(0.03));
  }
}

TEST_CASE("loads are met exactly, certified independently, with little overlap") {
  const Scenario<Sphere> s{Sphere{10e-3}, 15 * pi / 180, 5.5e-3};
  const PressedFinger f = coarse_finger({5, 10, 10, 6, 3}, s);
  const auto states = FastSimulator{}.press(f.body, f.mesh, s);
  REQUIRE(states.size() == 5);
  double last = 0.0;
  for (const MechanicalState& state : states) {
    CHECK(state.status == Status::converged);
    CHECK(std::abs(state.force_N - state.load_N) <= 1e-6 * state.load_N);
    CHECK(state.residual_N <= 1e-6 * state.load_N);
    CHECK(state.depth_m > last);
    CHECK(state.penetration_m < 0.015 * state.depth_m);  // on this coarse mesh; 0.4 % on the default's
    CHECK(state.contact_area_m2 > 0.0);
    last = state.depth_m;
    for (std::size_t k = 0; k < f.mesh.faces.size(); ++k)
      if (f.body.patches[std::size_t(f.mesh.faces[k].patch)].bonded)
        for (int n : f.mesh.faces[k].nodes) CHECK(state.displacement[std::size_t(n)].norm() == 0.0);
  }
}

TEST_CASE("tractions on the deformed surface bear the certified force, with friction too") {
  for (const double friction : {0.0, 0.5}) {
    const Scenario<Sphere> s{Sphere{10e-3}, 15 * pi / 180, 5.5e-3, {2.0, 8.0}};
    const PressedFinger f = coarse_finger({5, 10, 10, 6, 3}, s);
    FastSimulator simulator;
    simulator.contact.friction = friction;
    for (const MechanicalState& state : simulator.press(f.body, f.mesh, s)) {
      REQUIRE(state.status == Status::converged);
      Vec3d by_points = Vec3d::Zero(), by_nodes = Vec3d::Zero();
      double pressed_m2 = 0.0;
      for (const TractionPoint& p : state.tractions) {
        by_points += p.area_m2 * p.traction_Pa;
        if (p.pressure_Pa > 0.0) pressed_m2 += p.area_m2;
        if (friction == 0.0) CHECK(p.traction_Pa.norm() == Approx(p.pressure_Pa));
      }
      CHECK(by_points.dot(s.direction()) == Approx(state.force_N).epsilon(1e-9));
      CHECK(pressed_m2 < 1.05 * state.contact_area_m2);  // less, as points of a coarse surface come free inside it
      CHECK(pressed_m2 > 0.3 * state.contact_area_m2);
      // The field on sub-facets, taken as flat: they are bent, so that their areas are not quite the same.
      for (const BoundaryFace& face : f.mesh.faces)
        if (f.body.patches[std::size_t(face.patch)].contactable)
          for (const auto& part : face_parts()) {
            std::array<Vec3d, 3> x;
            Vec3d sum = Vec3d::Zero();
            for (std::size_t k = 0; k < 3; ++k) {
              const std::size_t n = std::size_t(face.nodes[std::size_t(part[k])]);
              x[k] = f.mesh.nodes[n] + state.displacement[n];
              sum += state.traction_Pa[n];
            }
            by_nodes += (x[1] - x[0]).cross(x[2] - x[0]).norm() / 6.0 * sum;
          }
      CHECK((by_nodes - by_points).norm() < 0.01 * by_points.norm());
    }
  }
}

TEST_CASE("the independent residual notices what a solver would have to hide") {
  const Scenario<Sphere> s{Sphere{20e-3}, 0.0, 0.0, {2.0}};
  const PressedFinger f = coarse_finger(plain_baseline(), s);
  const FastSimulator sim;
  const MechanicalState state = sim.press(f.body, f.mesh, s).front();
  const Touch touch = first_touch(f.body, f.mesh, s);
  const auto residual = [&](const std::vector<Vec3d>& u, double depth, double load) {
    const Moving<Sphere> tool{&s.indenter, touch.origin + depth * s.direction(), s.direction()};
    return out_of_balance(f.body, f.mesh, PressPhysics{sim.material, sim.contact, sim.element}, tool, {load, u});
  };
  CHECK(residual(state.displacement, state.depth_m, 2.0) < 2e-6);
  CHECK(residual(state.displacement, state.depth_m, 2.001) == Approx(1e-3).epsilon(0.01));
  CHECK(residual(state.displacement, state.depth_m + 1e-7, 2.0) > 1e-4);
  auto moved = state.displacement;
  for (std::size_t k = 0; k < moved.size(); ++k)
    if (moved[k].norm() > 0) {
      moved[k] += Vec3d(0, 0, 1e-7);
      break;
    }
  CHECK(residual(moved, state.depth_m, 2.0) > 1e-5);
}

TEST_CASE("what is pressed onto the carrier comes to rest there, and the independent residual knows of it") {
  // A plate held at its sides, 0.2 mm above a rigid floor.
  auto [body, mesh] = test::symmetric_block({6e-3, 6e-3, 2e-3}, test::even(6), test::even(6), test::even(2));
  body.patches[0].bonded = false;
  body.patches[0].meets_carrier = true;
  body.patches[2].bonded = true;
  const Body floating = body;
  body.carrier = {{{0, 0, -2.2e-3}, {20e-3, 20e-3, 2e-3}}};
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {2.0}};
  const FastSimulator sim;
  const auto lowest = [&mesh = mesh](const MechanicalState& state) {
    double z = 0.0;
    for (std::size_t k = 0; k < mesh.nodes.size(); ++k) z = std::min(z, mesh.nodes[k].z() + state.displacement[k].z());
    return z;
  };
  const MechanicalState resting = sim.press(body, mesh, s).front(), hanging = sim.press(floating, mesh, s).front();
  REQUIRE(resting.status == Status::converged);
  REQUIRE(hanging.status == Status::converged);
  CHECK(lowest(hanging) < -0.5e-3);
  CHECK(lowest(resting) == Approx(-0.2e-3).margin(0.02e-3));
  CHECK(resting.depth_m < 0.9 * hanging.depth_m);
  const Touch touch = first_touch(body, mesh, s);
  const auto residual = [&, &mesh = mesh](const Body& with) {
    const Moving<Sphere> tool{&s.indenter, touch.origin + resting.depth_m * s.direction(), s.direction()};
    return out_of_balance(
        with, mesh, PressPhysics{sim.material, sim.contact, sim.element}, tool, {2.0, resting.displacement});
  };
  CHECK(residual(body) < 2e-6);
  CHECK(residual(floating) > 0.01);  // without the floor its push is missing
}

TEST_CASE("half and quarter models, mirror images and the whole body agree") {
  const FingerDesign design{8, 4, 6, 4, 2};
  const auto depths = [&](bool symmetric, double angle, double y, TiltPlane tilt = TiltPlane::xz) {
    const Scenario<Sphere> s{Sphere{15e-3}, angle * pi / 180, y, {1.0, 5.0}, tilt};
    PressedFinger f = coarse_finger(design, {Sphere{15e-3}, std::abs(angle) * pi / 180, std::abs(y), {1.0}, tilt});
    if (!symmetric) f.mesh.symmetry = {};  // hides the symmetry from the solver, not from the mesh
    std::vector<std::array<double, 3>> d;
    for (const auto& state : FastSimulator{}.press(f.body, f.mesh, s)) {
      CHECK(state.status == Status::converged);
      d.push_back({state.depth_m, state.contact_area_m2, state.reference_area_m2});
    }
    return d;
  };
  const auto agree = [](const auto& a, const auto& b) {
    REQUIRE(a.size() == b.size());
    for (std::size_t k = 0; k < a.size(); ++k) {
      CHECK(a[k][0] == Approx(b[k][0]).epsilon(1e-6));
      CHECK(a[k][1] == Approx(b[k][1]).epsilon(1e-4));
      CHECK(a[k][2] == Approx(b[k][2]).epsilon(1e-4));
    }
  };
  agree(depths(true, 0, 0), depths(false, 0, 0));
  agree(depths(true, 0, 11e-3), depths(false, 0, 11e-3));
  agree(depths(true, 0, 11e-3), depths(true, 0, -11e-3));
  agree(depths(true, 20, 11e-3), depths(true, -20, -11e-3));
  agree(depths(true, 20, 0, TiltPlane::yz), depths(false, 20, 0, TiltPlane::yz));
  agree(depths(true, 20, 0, TiltPlane::yz), depths(true, -20, 0, TiltPlane::yz));
}

TEST_CASE(
    "the equilibrium does not depend on the way to it: 15 to 1 N retraces loading, and 0 to 10 N needs no stops") {
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {1.0, 2.0, 5.0, 10.0, 15.0}};
  const PressedFinger f = coarse_finger({4, 8, 8, 5, 2}, s);
  const FastSimulator sim;
  const auto up = sim.press(f.body, f.mesh, s);
  Scenario<Sphere> direct = s;
  direct.loads_N = {10.0};
  CHECK(sim.press(f.body, f.mesh, direct).front().depth_m == Approx(up[3].depth_m).epsilon(1e-6));

  using Model = SectorModel<NeoHookean, SDFContact, QuadraticTet, Cholmod>;
  const Model model(f.body, f.mesh, {true, true}, {sim.material, sim.contact, sim.element});
  QuasiStaticRun<Model, Sphere> path(model, s, first_touch(f.body, f.mesh, s), {});
  for (double load : s.loads_N) REQUIRE(path.solve(0.25 * load) == Status::converged);
  for (int k = 3; k >= 0; --k) {
    REQUIRE(path.solve(0.25 * s.loads_N[std::size_t(k)]) == Status::converged);
    CHECK(path.advance() == Approx(up[std::size_t(k)].depth_m).epsilon(1e-4));
  }
}

TEST_CASE("the Eigen-only simulator gives the same answer as the one with CHOLMOD") {
  const auto [body, mesh] =
      test::symmetric_block(Vec3d(8e-3, 8e-3, 6e-3), graded(4, 1.5), graded(4, 1.5), from_top(3, 1.5));
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {0.5, 1.0}};
  const auto a = Simulator{NeoHookean{}, SDFContact{}}.press(body, mesh, s);
  const auto b = FastSimulator{}.press(body, mesh, s);
  REQUIRE(a.size() == 2);
  for (std::size_t k = 0; k < 2; ++k) {
    CHECK(a[k].status == Status::converged);
    CHECK(a[k].depth_m == Approx(b[k].depth_m).epsilon(1e-7));
  }
}

TEST_CASE("linear tetrahedra are offered, and lock") {
  const Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {2.0}};
  const PressedFinger f = coarse_finger(plain_baseline(), s);
  const double quadratic = FastSimulator{}.press(f.body, f.mesh, s).front().depth_m;
  TetMesh linear = f.mesh;
  linear.order = 1;
  std::size_t corners = 0;
  for (auto& t : linear.tets) std::fill(t.begin() + 4, t.end(), -1);
  for (auto& face : linear.faces) std::fill(face.nodes.begin() + 3, face.nodes.end(), -1);
  // Corner nodes come in an arbitrary order: give them new numbers.
  std::vector<int> number(linear.nodes.size(), -1);
  std::vector<Vec3d> nodes;
  const auto renumber = [&](int& n) {
    if (n < 0) return;
    if (number[std::size_t(n)] < 0) {
      number[std::size_t(n)] = int(corners++);
      nodes.push_back(linear.nodes[std::size_t(n)]);
    }
    n = number[std::size_t(n)];
  };
  for (auto& t : linear.tets)
    for (int& n : t) renumber(n);
  for (auto& face : linear.faces)
    for (int& n : face.nodes) renumber(n);
  linear.nodes = nodes;
  linear.symmetry = {};
  linear.mirror_x.clear();
  linear.mirror_y.clear();
  const Simulator<NeoHookean, SDFContact, LinearTet, QuasiStatic<Cholmod>> sim;
  const MechanicalState state = sim.press(f.body, linear, s).front();
  CHECK(state.status == Status::converged);
  CHECK(state.depth_m < 0.85 * quadratic);
}

TEST_CASE("what cannot be solved is a status, and bad input one line") {
  const auto [body, mesh] = test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(3), test::even(3), test::even(2));
  Scenario<Sphere> s{Sphere{10e-3}, 0.0, 0.0, {1.0}};
  FastSimulator sim;
  sim.solver.config.max_iterations = 1;
  CHECK(sim.press(body, mesh, s).front().status == Status::max_iterations);
  sim.solver.config = {};
  sim.solver.config.time_limit_s = 0.0;
  CHECK(sim.press(body, mesh, s).front().status == Status::time_limit);
  sim.solver.config = {};
  s.loads_N = {1.0, 1e4};  // far more than the block can bear
  const auto states = sim.press(body, mesh, s);
  CHECK(states.front().status == Status::converged);
  CHECK(states.back().status != Status::converged);
  TetMesh broken = mesh;
  for (Vec3d& x : broken.nodes)
    if ((x - Vec3d(2e-3, 2e-3, 2e-3)).norm() < 1e-9) x.x() += 5e-3;  // beyond the next cell
  CHECK_THROWS_AS(sim.press(body, broken, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, {1.0}}), MeshError);
  for (const auto& bad : {std::vector<double>{}, {2.0, 1.0}, {-1.0}, {std::nan("")}}) {
    s.loads_N = bad;
    CHECK_THROWS_AS(sim.press(body, mesh, s), InvalidArgument);
  }
  s.loads_N = {1.0};
  s.indenter.diameter_m = -1.0;
  CHECK_THROWS_WITH(sim.press(body, mesh, s), Catch::Contains("sphere diameter") && Catch::Contains("mm"));
}

TEST_CASE(
    "a body that is squeezed out of its volume ends where no step keeps the rest, and not before smaller strides were "
    "tried") {
  const auto [body, mesh] = test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(3), test::even(3), test::even(2));
  FastSimulator sim{NeoHookean{1e5, 1e3}, SDFContact{1e11}};  // Poisson's ratio 0.005: a sponge
  sim.solver.config.load_stride = 100.0;
  sim.solver.config.stride_iterations = 300;
  sim.solver.config.max_iterations = 1500;
  const MechanicalState state = sim.press(body, mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, {20.0}}).front();
  CHECK(state.status == Status::line_search);
  CHECK(state.iterations > 60);  // the first approach ends after some 30
}

TEST_CASE("a strut that would buckle is not passed off as stable") {
  // A slender column under a central sphere: the symmetric path exists, but fields that break the symmetry let it
  // buckle.
  const Vec3d half(1.0e-3, 1.0e-3, 14e-3);
  const auto [body, mesh] = test::symmetric_block(half, test::even(1), test::even(1), test::even(14));
  // The sphere keeps the load's line, so the head is as good as pinned: 8.2 times Euler's pi^2 E I / (2 L)^2 for a free
  // head; E = 3 mu.
  const double euler = pi * pi * 3 * 1e5 * std::pow(2e-3, 4) / 12 / std::pow(2 * 14e-3, 2);
  Scenario<Sphere> s{Sphere{20e-3}, 0.0, 0.0, {4.0 * euler}};
  FastSimulator sim{NeoHookean{1e5, 9.9e6}, SDFContact{1e10}};
  CHECK(sim.press(body, mesh, s).front().status == Status::converged);
  s.loads_N = {12.0 * euler};
  CHECK(sim.press(body, mesh, s).front().status == Status::not_positive_definite);
}
