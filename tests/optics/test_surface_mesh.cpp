#include "catch.hpp"
#include "lumo/mesh/body_check.hpp"
#include "lumo/mesh/surface_mesh.hpp"
#include "optics/scenes.hpp"

using namespace optics_test;

namespace {

// Each quadratic face as four triangles.
TriangleSurface triangles_of(const TetMesh& mesh) {
  TriangleSurface s;
  s.vertices = mesh.nodes;
  for (const BoundaryFace& f : mesh.faces)
    for (const auto& t : {std::array{0, 3, 5}, std::array{3, 1, 4}, std::array{5, 4, 2}, std::array{3, 4, 5}})
      s.triangles.push_back({f.nodes[std::size_t(t[0])], f.nodes[std::size_t(t[1])], f.nodes[std::size_t(t[2])]});
  return s;
}

}  // namespace

TEST_CASE("A sphere of triangles is lit as the exact sphere is, and as its closed form says") {
  const double R = 10e-3, n = 1.4, mu = 40.0;
  const TriangleSurface surface = triangles_of(sphere(R, {n, mu}, 8).mesh);
  const TetMesh mesh = surface_mesh(surface);
  Body body;
  body.patches = surface_patches(surface);
  REQUIRE(body.patches.size() == 1);
  body.medium = {n, mu};
  body.regions = 2;
  body.region = [](const Vec3d& p, const Vec3d&) { return p.z() > 0.0 ? 0 : 1; };
  Body exact = body;
  exact.patches[0].shape = SphereShape{Vec3d::Zero(), R};
  double worst = 0.0;
  for (const Vec3d& p : mesh.nodes)
    worst = std::max(worst, (outward_normal(body, 0, p) - outward_normal(exact, 0, p)).norm());
  CHECK(worst < 2e-2);
  Tracer<>::Config config;
  config.rays_per_emitter = 1 << 13;
  config.exit_rays = 0;
  for (const double z : {0.0, 4e-3}) {
    body.emitters = exact.emitters = {PointEmitter{{0, 0, z}, 1.0, 0}};
    const Response a = Tracer<>(config).trace(body, mesh), b = Tracer<>(config).trace(exact, mesh);
    for (std::size_t r = 0; r < 2; ++r) CHECK(a.power_W[r] == Approx(b.power_W[r]).epsilon(5e-3));
    if (z > 0.0) continue;
    const double back = std::pow((n - 1.0) / (n + 1.0), 2), way = std::exp(-mu * R);
    CHECK(a.power_W[0] + a.power_W[1] == Approx((1.0 - back) * way / (1.0 - back * way * way)).epsilon(5e-3));
  }
}

TEST_CASE("Creases divide a cube into its faces, whose normals are those of planes, and it cannot be pressed") {
  const Model cube = box({3e-3, 4e-3, 5e-3}, {1.4, 20.0}, 3);
  const TriangleSurface surface = triangles_of(cube.mesh);
  const TetMesh mesh = surface_mesh(surface);
  Body body;
  body.patches = surface_patches(surface);
  REQUIRE(body.patches.size() == 6);
  require_on_shapes(body, mesh);
  for (const BoundaryFace& f : mesh.faces) {
    const auto at = [&](std::size_t k) -> const Vec3d& { return mesh.nodes[std::size_t(f.nodes[k])]; };
    const Vec3d flat = Vec3d(at(1) - at(0)).cross(at(2) - at(0)).normalized();
    for (std::size_t k = 0; k < 3; ++k) CHECK((outward_normal(body, f.patch, at(k)) - flat).norm() < 1e-12);
  }
  CHECK_THROWS_WITH(require_valid(body, mesh), Catch::Contains("a bare surface can be lit, not pressed"));
  TriangleSurface open = surface;
  open.triangles.pop_back();
  CHECK_THROWS_AS(surface_mesh(open), MeshError);
}
