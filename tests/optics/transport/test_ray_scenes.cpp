#include "catch.hpp"
#include "lumo/optics/transport/radiosity.hpp"
#include "optics/scenes.hpp"

using namespace optics_test;

namespace {

std::vector<SceneTriangle> cube(const Vec3d& center, double half) {
  const Model m = box(Vec3d::Constant(half), {}, 4, center);
  return OpticalScene(m.body, m.mesh, {}, {}, {}).triangles();
}

}  // namespace

static_assert(RayScene<BvhScene> && Intersector<Bvh> && !Intersector<int>);

TEST_CASE("The tree finds the wall of a cube, wherever it lies", "[rays]") {
  const OwenSobol s{1};
  for (const Vec3d& center : {Vec3d(0, 0, 0), Vec3d(1000, -500, 30)}) {
    const BvhScene scene = Bvh{}.build(cube(center, 0.01));
    int misses = 0;
    double worst = 0.0;
    for (std::uint32_t i = 0; i < 4096; ++i) {
      const Vec3d p = 0.0099 * (2.0 * Vec3d(s(i, 0), s(i, 1), s(i, 2)) - Vec3d::Ones());
      const Vec3d d = (Vec3d(s(i, 3), s(i, 4), s(i, 5)) - Vec3d::Constant(0.5)).normalized();
      double exact = 1e9;
      for (int a = 0; a < 3; ++a) exact = std::min(exact, ((d[a] > 0 ? 0.01 : -0.01) - p[a]) / d[a]);
      const RayHit hit = scene.first_hit(center + p, d, true);
      if (!hit) ++misses;
      else worst = std::max(worst, std::abs(hit.t - exact));
      CHECK(!scene.first_hit(center + p, d, false));  // from outside one meets fronts only
    }
    CHECK(misses == 0);
    CHECK(worst < 1e-11);
  }
}

TEST_CASE("The medium decides what a ray meets: contradicting faces and carrier faces are passed inside", "[rays]") {
  std::vector<SceneTriangle> t = cube(Vec3d::Zero(), 0.01);
  const int walls = int(t.size());
  t.push_back({{Vec3d(-1, -1, 0), Vec3d(-1, 1, 0), Vec3d(1, 0, 0)}, false});  // front down, against the ray
  t.push_back({{Vec3d(-1, -1, 0.001), Vec3d(1, 0, 0.001), Vec3d(-1, 1, 0.001)}, true});
  t.push_back({{Vec3d(-1, -1, 0.03), Vec3d(-1, 1, 0.03), Vec3d(1, 0, 0.03)}, true});
  const BvhScene scene = Bvh{}.build(t);
  const RayHit wall = scene.first_hit(Vec3d(0.001, 0.0005, -0.005), Vec3d::UnitZ(), true);
  CHECK(wall.triangle < walls);
  CHECK(wall.t == Approx(0.015));
  const RayHit outside = scene.first_hit(Vec3d(0.001, 0.0005, 0.02), Vec3d::UnitZ(), false);
  CHECK(outside.triangle == walls + 2);
  CHECK(scene.first_hit(Vec3d(0.001, 0.0005, -0.005), Vec3d::UnitZ(), false).triangle == walls);
}

TEST_CASE("A ray that starts on a face never meets that face again", "[rays]") {
  const BvhScene scene = Bvh{}.build(cube(Vec3d(7, 8, 9), 0.01));
  const OwenSobol s{2};
  for (std::uint32_t i = 0; i < 1000; ++i) {
    const Vec3d p = Vec3d(7, 8, 9) + 0.01 * Vec3d(2.0 * s(i, 0) - 1.0, 2.0 * s(i, 1) - 1.0, 1.0);
    const Vec3d d = (Vec3d(s(i, 2) - 0.5, s(i, 3) - 0.5, -0.01 - s(i, 4))).normalized();
    const RayHit hit = scene.first_hit(p, d, true);
    REQUIRE(bool(hit));
    CHECK(hit.t > 1e-9);
    CHECK(!scene.first_hit(p, -d, false));
  }
}

TEST_CASE("Degenerate triangles and empty scenes are no trouble, broken numbers are", "[rays]") {
  CHECK(!Bvh{}.build({}).first_hit(Vec3d::Zero(), Vec3d::UnitX(), false));
  std::vector<SceneTriangle> same(100, SceneTriangle{{Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()}, false});
  CHECK(!Bvh{}.build(same).first_hit(-Vec3d::UnitX(), Vec3d::UnitX(), false));
  same[50].corners[1].x() = std::nan("");
  CHECK_THROWS_AS(Bvh{}.build(same), InvalidArgument);
}

TEST_CASE("Sub-facets follow the quadratic map: normals and areas of a sphere", "[rays]") {
  const double radius = 5e-3;
  const Model m = sphere(radius, {});
  double last = 1.0;
  for (int n : {1, 2, 4}) {
    OpticalScene::Config c;
    c.sub_facets = n;
    const OpticalScene scene(m.body, m.mesh, {}, {}, c);
    double area = 0.0, worst = 0.0;
    for (std::size_t i = 0; i < scene.triangles().size(); ++i) {
      const auto& [p, q, r] = scene.triangles()[i].corners;
      area += 0.5 * (q - p).cross(r - p).norm();
      const Vec3d middle = (p + q + r) / 3.0;
      worst = std::max(worst, (scene.smooth_normal(scene.locate(int(i), middle)) - middle.normalized()).norm());
    }
    const double error = std::abs(area / (4.0 * pi * radius * radius) - 1.0);
    CHECK(error < 0.35 * last);
    CHECK(worst < 0.02);
    last = error;
  }
}

TEST_CASE("Cells of a carrier face cover it once, fit together, and stay the same cells when it moves", "[scene]") {
  const std::vector<Vec3d> square{{0, 0, 0}, {2, 0, 0}, {2, 6, 0}, {0, 6, 0}},
      pentagon{{0, 0, 1}, {2, 0, 1}, {3, 1, 1}, {1, 3, 1}, {0, 1, 1}};
  for (const auto& [polygon, exact] : {std::pair(square, 12.0), std::pair(pentagon, 5.5)}) {
    std::vector<Vec3d> moved = polygon;
    for (Vec3d& p : moved) p = 1.01 * p - Vec3d(0, 0, 0.1);
    const auto cells = lumo::polygon_cells(polygon, 0.7), after = lumo::polygon_cells(moved, polygon, 0.7);
    REQUIRE(cells.size() == after.size());
    double area = 0.0;
    for (std::size_t k = 0; k < cells.size(); ++k) {
      const Vec3d a = 0.5 * (cells[k][1] - cells[k][0]).cross(cells[k][2] - cells[k][0]);
      CHECK(a.z() > 0.0);
      area += a.z();
      for (std::size_t c = 0; c < 3; ++c) CHECK((after[k][c] - (1.01 * cells[k][c] - Vec3d(0, 0, 0.1))).norm() < 1e-12);
    }
    CHECK(area == Approx(exact));
  }
}

TEST_CASE("Shares of light nodes add up: their areas are the area of all Lambertian faces", "[scene]") {
  const PadShape s{.gap = 2e-3};
  const Model m = pad(s);
  for (const Symmetry symmetry : {Symmetry{}, Symmetry{true, true}}) {
    const OpticalScene scene(m.body, m.mesh, {}, symmetry, {});
    const lumo::LightNodes nodes(scene, symmetry);
    double lit = 0.0, sum = 0.0;
    for (int t = 0; t < int(scene.triangles().size()); ++t)
      if (nodes.of(t)[0] >= 0) lit += scene.triangle_area(t);
    for (std::size_t k = 0; k < nodes.size(); ++k) sum += nodes.area(k);
    CHECK(sum == Approx(lit));
    CHECK(lit > 0.0);
  }
}
