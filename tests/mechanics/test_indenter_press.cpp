#include "catch.hpp"
#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/capsule.hpp"
#include "lumo/mechanics/indenters/cylinder.hpp"
#include "lumo/mechanics/indenters/mesh_indenter.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/support/cholmod.hpp"
#include "lumo/support/tetgen.hpp"
#include "mechanics/bodies.hpp"
#include "mechanics/indenters/tool_surfaces.hpp"

using namespace lumo;

namespace {

using FastSimulator = Simulator<NeoHookean, SDFContact, QuadraticTet, QuasiStatic<Cholmod>>;

TriangleSurface round_mesh(double radius, int around) {  // rings of latitude between two poles
  TriangleSurface s;
  s.vertices.emplace_back(0, 0, radius);
  const int rings = around / 2 - 1;
  for (int i = 1; i <= rings; ++i)
    for (int j = 0; j < around; ++j) {
      const double a = pi * i / (rings + 1), b = 2 * pi * j / around;
      s.vertices.emplace_back(
          radius * std::sin(a) * std::cos(b), radius * std::sin(a) * std::sin(b), radius * std::cos(a));
    }
  s.vertices.emplace_back(0, 0, -radius);
  const auto id = [&](int i, int j) { return 1 + (i - 1) * around + j % around; };
  for (int j = 0; j < around; ++j) {
    s.triangles.push_back({0, id(1, j), id(1, j + 1)});
    s.triangles.push_back({id(rings, j + 1), id(rings, j), int(s.vertices.size()) - 1});
    for (int i = 1; i < rings; ++i) {
      s.triangles.push_back({id(i, j), id(i + 1, j), id(i + 1, j + 1)});
      s.triangles.push_back({id(i, j), id(i + 1, j + 1), id(i, j + 1)});
    }
  }
  return s;
}

}  // namespace

TEST_CASE("a flat punch on a deep soft block meets Sneddon's stiffness") {
  // Sneddon 1965: F = 2 E* a d. The rim is rounded by a twentieth of the radius and the block is 40 radii deep and half
  // as wide.
  const double nu = 0.45, mu = 1e5, lambda = 2 * mu * nu / (1 - 2 * nu), E_star = 2 * mu * (1 + nu) / (1 - nu * nu),
               a = 1e-3;
  Body body = test::block_to_mesh(Vec3d::Constant(40e-3), 0.1e-3, 0.12, 12e-3);
  const Vec3d top(0, 0, 40e-3);
  body.sizing.edge = [=](const Vec3d& p) {  // fine along the rim
    const double rim = std::hypot(std::hypot(p.x(), p.y()) - a, p.z() - top.z());
    return std::min({12e-3, 0.06e-3 + 0.4 * rim});
  };
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  const FastSimulator sim{NeoHookean{mu, lambda}, SDFContact{3e12}};
  const Scenario<Cylinder> s{Cylinder{2 * a, 4e-3, 0.05 * a}, 0.0, 0.0, {0.003, 0.006}};
  for (const MechanicalState& state : sim.press(body, mesh, s)) {
    REQUIRE(state.status == Status::converged);
    INFO("d/a " << state.depth_m / a << " F/F_Sneddon " << state.force_N / (2 * E_star * a * state.depth_m)
                << " A/(pi a^2) " << state.contact_area_m2 / (pi * a * a));
    CHECK(state.force_N / (2 * E_star * a * state.depth_m) == Approx(1.0).margin(0.04));
    CHECK(state.contact_area_m2 / (pi * a * a) == Approx(1.0).margin(0.1));
  }
}

TEST_CASE("a long bar on a block meets Hertz's line contact in width and in peak pressure") {
  // Hertz 1882: b^2 = 4 F' R / (pi E*), p0 = 2 F' / (pi b). Without lateral contraction (lambda = 0) plane strain holds
  // whatever the ends do.
  const double mu = 1e5, E_star = 2 * mu, R = 8e-3, b = 0.6e-3, per_length = pi * E_star * b * b / (4 * R);
  const Vec3d half(8e-3, 0.6e-3, 8e-3);
  std::vector<double> gx, gz;
  for (int i = 0; i <= 26; ++i) gx.push_back(std::pow(i / 26.0, 1.4));
  for (int i = 0; i <= 12; ++i) gz.push_back(1.0 - std::pow(1.0 - i / 12.0, 1.8));
  const auto [body, mesh] = test::symmetric_block(half, gx, test::even(2), gz);
  const FastSimulator sim{NeoHookean{mu, 0.0}, SDFContact{1e12}};
  const double load = per_length * 2 * half.y();
  for (bool bar : {true, false}) {
    std::vector<MechanicalState> states;
    if (bar)
      states = sim.press(
          body, mesh, Scenario<Oriented<Cylinder>>{lying_along_y(Cylinder{2 * R, 10e-3, 0.5e-3}), 0.0, 0.0, {load}});
    else
      states =
          sim.press(body, mesh, Scenario<Oriented<Capsule>>{lying_along_y(Capsule{2 * R, 10e-3}), 0.0, 0.0, {load}});
    REQUIRE(states.front().status == Status::converged);
    double peak = 0.0;
    for (double p : states.front().pressure_Pa) peak = std::max(peak, p);
    INFO("width / Hertz " << states.front().reference_area_m2 / (4 * b * half.y()) << " peak / Hertz "
                          << peak / (2 * per_length / (pi * b)));
    CHECK(states.front().reference_area_m2 / (4 * b * half.y()) == Approx(1.0).margin(0.04));
    CHECK(peak / (2 * per_length / (pi * b)) == Approx(1.0).margin(0.04));
  }
}

TEST_CASE("a sphere as a mesh presses like the sphere, and a rounded box comes down on its face") {
  const auto [body, mesh] = test::symmetric_block(Vec3d(8e-3, 8e-3, 6e-3), test::even(6), test::even(6), test::even(4));
  const FastSimulator sim;
  const std::vector<double> loads = {0.5, 1.0, 2.0};
  const auto compare = [&](const auto& a, const auto& b, double margin) {
    REQUIRE(a.size() == loads.size());
    REQUIRE(b.size() == loads.size());
    for (std::size_t k = 0; k < loads.size(); ++k) {
      REQUIRE(a[k].status == Status::converged);
      REQUIRE(b[k].status == Status::converged);
      INFO("depth " << a[k].depth_m << " and " << b[k].depth_m << " area " << a[k].contact_area_m2 << " and "
                    << b[k].contact_area_m2);
      CHECK(a[k].depth_m == Approx(b[k].depth_m).margin(margin));
      CHECK(a[k].contact_area_m2 == Approx(b[k].contact_area_m2).epsilon(0.03));
      CHECK(a[k].residual_N <= 1e-6 * loads[k]);
    }
  };
  compare(sim.press(body, mesh, Scenario<MeshIndenter>{MeshIndenter(round_mesh(5e-3, 96)), 0.0, 0.0, loads}),
      sim.press(body, mesh, Scenario<Sphere>{Sphere{10e-3}, 0.0, 0.0, loads}), 4e-6);  // the sag of its facets
  const auto box = sim.press(body, mesh, Scenario<Box>{Box{{6e-3, 6e-3, 6e-3}, 1e-3}, 0.0, 0.0, loads});
  for (const MechanicalState& s : box) {
    CHECK(s.status == Status::converged);
    CHECK(s.residual_N <= 1e-6 * s.load_N);
  }
  // The flat face, 4 mm square, is in contact from the first load on; more comes round the edges, but never more than
  // the box has below it.
  for (std::size_t k = 0; k < loads.size(); ++k) {
    INFO("contact " << box[k].reference_area_m2 * 1e6 << " mm2");
    CHECK(box[k].reference_area_m2 > 16e-6);
    CHECK(box[k].reference_area_m2 < 36e-6);
    if (k > 0) CHECK(box[k].reference_area_m2 >= box[k - 1].reference_area_m2);
  }
}

TEST_CASE("a small ball on a long shaft presses like the ball, and a blade of triangles like the blade") {
  const auto [body, mesh] = test::symmetric_block(Vec3d(6e-3, 6e-3, 5e-3), test::even(4), test::even(4), test::even(3));
  const FastSimulator sim;
  const auto press = [&, &block = body, &nodes = mesh](const auto& tool) {
    const MechanicalState s =
        sim.press(block, nodes, Scenario<std::decay_t<decltype(tool)>>{tool, 0.0, 0.0, {0.3}}).front();
    REQUIRE(s.status == Status::converged);
    CHECK(s.residual_N <= 1e-6 * s.load_N);
    return s;
  };
  const MechanicalState probe = press(MeshIndenter(test::probe(120e-3))), ball = press(Sphere{4e-3});
  CHECK(probe.depth_m == Approx(ball.depth_m).margin(2e-6));  // its facets lie up to 2 µm inside the ball
  CHECK(press(MeshIndenter(test::brick({0.15e-3, 1.5e-3, 20e-3}))).depth_m ==
        Approx(press(Box{{0.3e-3, 3e-3, 40e-3}, 0.0}).depth_m).epsilon(1e-4));
}

TEST_CASE("a probe of 4 mm on a shaft of 120 mm, on a fine mesh", "[long]") {
  // Depths of Sphere{4 mm} to four digits, as reported from the field; areas are those of the ball on the same mesh.
  const double mu = 106e3;
  const Vec3d half(20e-3, 20e-3, 15e-3);
  Body body = test::block_to_mesh(half, 0.2e-3, 0.2, 8e-3);
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  const FastSimulator sim{NeoHookean{mu, 99 * mu}, {}};
  const std::vector<double> loads{0.1, 0.5};
  const auto ball = sim.press(body, mesh, Scenario<Sphere>{{4e-3}, 0.0, 0.0, loads}),
             probe = sim.press(body, mesh, Scenario<MeshIndenter>{MeshIndenter(test::probe(120e-3)), 0.0, 0.0, loads});
  for (std::size_t k = 0; k < 2; ++k) {
    REQUIRE(probe[k].status == Status::converged);
    INFO("depth " << probe[k].depth_m << " area " << probe[k].contact_area_m2 << " of the ball "
                  << ball[k].contact_area_m2);
    CHECK(probe[k].depth_m == Approx(k == 0 ? 0.2499e-3 : 0.7370e-3).epsilon(0.01));
    CHECK(probe[k].depth_m == Approx(ball[k].depth_m).epsilon(0.004));
    CHECK(probe[k].contact_area_m2 == Approx(ball[k].contact_area_m2).epsilon(0.01));
  }
}
