#include "catch.hpp"
#include "lumo/geometry/triangle_surface.hpp"
#include "lumo/mechanics/contact_mesh.hpp"
#include "lumo/mechanics/indenters/mesh_indenter.hpp"
#include "lumo/mechanics/materials/neo_hookean.hpp"
#include "lumo/mechanics/simulator.hpp"
#include "lumo/mechanics/solvers/vertex_block_descent.hpp"
#include "lumo/support/tetgen.hpp"
#include "mechanics/bodies.hpp"

#include <chrono>
#include <functional>
#include <limits>

using namespace lumo;

namespace {

using Press = Simulator<NeoHookean, SDFContact>;

const double none = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();

std::pair<Body, TetMesh> small_block() {
  return test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(3), test::even(3), test::even(2));
}

const Scenario<Sphere> middle{Sphere{10e-3}, 0.0, 0.0, {0.2}};

TriangleSurface tetrahedron_at(const Vec3d& center, double size) {
  TriangleSurface s;
  for (const Vec3d& corner : {Vec3d(1, 1, 1), Vec3d(-1, -1, 1), Vec3d(-1, 1, -1), Vec3d(1, -1, -1)})
    s.vertices.push_back(center + size * corner);
  s.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return s;
}

}  // namespace

TEST_CASE("a press believes no mesh") {
  auto [body, mesh] = small_block();
  CHECK(Press{}.press(body, mesh, middle).front().status == Status::converged);
  TetMesh broken = mesh;
  broken.tets[3][1] = 1 << 20;
  CHECK_THROWS_AS(Press{}.press(body, broken, middle), MeshError);
  broken = mesh;
  for (auto& t : broken.tets) std::swap(t[0], t[1]);
  CHECK_THROWS_AS(Press{}.press(body, broken, middle), MeshError);
  broken = mesh;
  broken.mirror_x.resize(3);
  CHECK_THROWS_AS(Press{}.prepare(body, broken), MeshError);
  broken = mesh;
  broken.faces[3].patch = 1000;
  CHECK_THROWS_AS(Press{}.prepare(body, broken), MeshError);
  Body carried = body;
  carried.carrier = {RigidBox{Vec3d(0, 0, none), Vec3d(1e-3, 1e-3, 1e-3)}};
  CHECK_THROWS_AS(Press{}.prepare(carried, mesh), MeshError);
}

TEST_CASE("looking at a mesh takes less than a hundredth of a press on it") {
  const auto [body, mesh] =
      test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(6), test::even(6), test::even(5));  // 4,320 elements
  const auto began = std::clock();
  require_valid(body, mesh);
  const auto looked = std::clock();
  REQUIRE(Press{}.press(body, mesh, middle).front().status == Status::converged);
  const double share = double(looked - began) / double(std::clock() - looked);
  INFO("share " << share);
  CHECK(share < 0.01);
}

TEST_CASE("what nothing holds, and a tool that meets what it may not touch, is said before the solve") {
  const auto [body, mesh] = small_block();
  Body loose = body;
  for (Patch& p : loose.patches) p.bonded = false;
  CHECK_THROWS_WITH(Press{}.prepare(loose, mesh), "no patch is bonded: the body can move as a whole");
  loose.patches[0].meets_carrier = true;
  CHECK_THROWS_AS(Press{}.prepare(loose, mesh), InvalidArgument);  // but there is no carrier
  Body shy = body;
  for (Patch& p : shy.patches) p.contactable = false;
  CHECK_THROWS_WITH(Press{}.press(shy, mesh, middle), Catch::Contains("no patch of the body is contactable"));
  // The top is touched at its far edge only after the tool has gone through the side.
  Scenario<Sphere> aslant{Sphere{4e-3}, 80 * pi / 180, 0.0, {0.2}};
  Body low = body;
  low.pivot.z() = 0.0;
  CHECK_THROWS_WITH(
      Press{}.press(low, mesh, aslant), Catch::Contains("meets patch \"side\", which may not be touched"));
  low.pivot.z() = 1.5e-3;
  CHECK_THROWS_WITH(Press{}.press(low, mesh, aslant), Catch::Contains("\"side\", which may not be touched, 0.3"));
  low.pivot.z() = 3.5e-3;  // its centre comes by above the edge
  CHECK_NOTHROW(first_touch(low, mesh, aslant));
  CHECK_NOTHROW(require_free_way(low, mesh, aslant, first_touch(low, mesh, aslant)));
  Scenario<Sphere> beside = middle;
  beside.y_m = 0.2;
  CHECK_THROWS_WITH(Press{}.press(body, mesh, beside), Catch::Contains("passes by the body"));
}

TEST_CASE("a tool that lies far off its own origin is named as such when it passes by") {
  const auto [body, mesh] = small_block();
  const auto scenario = [](const Vec3d& at) {
    return Scenario<MeshIndenter>{MeshIndenter(tetrahedron_at(at, 3e-3)), 0.0, 0.0, {0.2}};
  };
  CHECK_THROWS_WITH(first_touch(body, mesh, scenario({0.1, 0.1, 0.0})), Catch::Contains("mm off its own origin"));
  CHECK_NOTHROW(first_touch(body, mesh, scenario({0.0, 0.0, 0.1})));  // on the line: it is only far
}

TEST_CASE("a contact mesh of a body without lengths, and numbers that are none") {
  Body body = test::block_to_mesh(Vec3d(6e-3, 6e-3, 4e-3), 1e-3, 0.3, 4e-3);
  body.sizing.edge = nullptr;
  const TetgenMesher mesher;
  const TetMesh coarse = mesh_body(body, mesher);
  const Focus focus{0.8e-3, 0.4, 1.0};
  CHECK(mesh_for_contact(body, coarse, std::vector{middle}, mesher, focus).tets.size() > coarse.tets.size());
  Scenario<Sphere> s = middle;
  s.angle_rad = none;
  CHECK_THROWS_AS(mesh_for_contact(body, coarse, std::vector{s}, mesher, focus), InvalidArgument);
}

TEST_CASE("a solver's settings are finite and in range") {
  const auto [body, mesh] = small_block();
  using Setting = std::function<void(QuasiStaticConfig&, double)>;
  const std::vector<Setting> settings{[](auto& c, double v) { c.residual_tolerance = v; },
      [](auto& c, double v) { c.chord_contraction = v; }, [](auto& c, double v) { c.late_contraction = v; },
      [](auto& c, double v) { c.load_stride = v; }, [](auto& c, double v) { c.max_advance = v; },
      [](auto& c, double v) { c.time_limit_s = v; }};
  for (const double bad : {none, -1.0, infinity, -infinity})
    for (const Setting& set : settings) {
      Press sim;
      set(sim.solver.config, bad);
      CHECK_THROWS_AS(sim.press(body, mesh, middle), InvalidArgument);
    }
  Press sim;
  sim.solver.config.max_iterations = -1;
  CHECK_THROWS_AS(sim.press(body, mesh, middle), InvalidArgument);
  for (const double bad : {none, -1.0, infinity}) {
    DescentConfig c;
    c.time_limit_s = bad;
    CHECK_THROWS_AS(validate(c), InvalidArgument);
  }
}
