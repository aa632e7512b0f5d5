#include "optics/scenes.hpp"

#include "lumo/optics/optical_scene.hpp"

#include <catch2/catch.hpp>

using namespace lumo;
using namespace optics_test;

namespace {

constexpr double radius = 5e-3;

/// A dent of 0.4 mm that spreads over 2 mm, and the exact normal of the sphere with it (Nanson: F⁻ᵀ n).
Vec3d dent(const Vec3d& p) {
  const Vec3d at = radius * Vec3d(1, 2, 2) / 3.0;
  return -0.4e-3 * std::exp(-(p - at).squaredNorm() / (2.0 * 2e-3 * 2e-3)) * Vec3d(1, 2, 2) / 3.0;
}

Vec3d dented_normal(const Vec3d& p) {
  Mat3d f;
  for (int j = 0; j < 3; ++j)
    f.col(j) = Vec3d::Unit(j) + (dent(p + 1e-7 * Vec3d::Unit(j)) - dent(p - 1e-7 * Vec3d::Unit(j))) / 2e-7;
  return (f.inverse().transpose() * p.normalized()).normalized();
}

struct Errors {
  double recovered = 0.0, own = 0.0;  ///< root mean square over all faces
};

Errors errors(int cells, int order) {
  Model m = sphere(radius, {}, cells);
  m.mesh.order = order;
  if (order == 1)
    for (BoundaryFace& f : m.mesh.faces) f.nodes[3] = f.nodes[4] = f.nodes[5] = -1;
  std::vector<Vec3d> displacement;
  for (const Vec3d& p : m.mesh.nodes) displacement.push_back(dent(p));
  const OpticalScene scene(m.body, m.mesh, {displacement}, {}, {});
  Errors e;
  int count = 0;
  for (std::size_t f = 0; f < scene.face_count(); ++f)
    for (const auto& [b1, b2] :
        {std::pair(0.2, 0.2), std::pair(0.6, 0.2), std::pair(0.2, 0.6), std::pair(0.45, 0.45)}) {
      ScenePoint at;
      at.face = int(f);
      at.b1 = b1;
      at.b2 = b2;
      const Vec3d exact = dented_normal(radius * scene.reference(at).normalized());
      std::array<Vec3d, 6> deformed;
      for (std::size_t k = 0; k < 6; ++k) {
        const std::array<int, 6>& nodes = m.mesh.faces[f].nodes;
        const auto place = [&](std::size_t n) {
          return Vec3d(m.mesh.nodes[std::size_t(nodes[n])] + displacement[std::size_t(nodes[n])]);
        };
        deformed[k] = nodes[k] >= 0 ? place(k) : Vec3d(0.5 * (place(k - 3) + place((k - 2) % 3)));
      }
      e.recovered += (scene.smooth_normal(at) - exact).squaredNorm();
      e.own += (lumo::quadratic_normal(deformed, b1, b2) - exact).squaredNorm();
      ++count;
    }
  return {std::sqrt(e.recovered / count), std::sqrt(e.own / count)};
}

}  // namespace

TEST_CASE("Recovered normals of a dented sphere: nearer to the exact ones than those of the faces, and of second order",
    "[scene]") {
  const Errors coarse = errors(8, 2), fine = errors(16, 2), finest = errors(32, 2);
  for (const Errors& e : {coarse, fine, finest}) {
    INFO(e.recovered << " recovered, " << e.own << " of the faces");
    CHECK(e.recovered < 0.3 * e.own);
  }
  CHECK(fine.recovered < coarse.recovered / 3.5);
  CHECK(finest.recovered < fine.recovered / 3.5);
}

TEST_CASE("Recovered normals of a mesh with straight edges converge too", "[scene]") {
  const Errors coarse = errors(8, 1), fine = errors(16, 1);
  CHECK(coarse.recovered < 0.5 * coarse.own);
  CHECK(fine.recovered < coarse.recovered / 1.9);
}

TEST_CASE("Each side of a crease keeps its own normal, and turns with it", "[scene]") {
  const Model m = box(Vec3d(1, 2, 3) * 1e-3, {});
  const Mat3d turn = Eigen::AngleAxisd(0.3, Vec3d(1, -1, 2).normalized()).toRotationMatrix();
  std::vector<Vec3d> displacement;
  for (const Vec3d& p : m.mesh.nodes) displacement.push_back(turn * p - p);
  const OpticalScene scene(m.body, m.mesh, {displacement}, {}, {});
  for (std::size_t f = 0; f < scene.face_count(); ++f)
    for (const double b : {0.0, 0.3, 1.0}) {
      ScenePoint at;
      at.face = int(f);
      at.b1 = b;
      at.b2 = 0.5 * (1.0 - b);
      const Vec3d side = std::get<Plane>(m.body.patches[std::size_t(scene.patch_number(at))].shape).direction;
      CHECK((scene.smooth_normal(at) - turn * side).norm() < 1e-9);
    }
}

TEST_CASE("Normals are the tool's where it touches, and lean away from it by the law of the gap beside", "[scene]") {
  Model m = sphere(radius, {}, 24);
  for (Patch& p : m.body.patches) p.contactable = true;
  constexpr double a = 1.5e-3, steepness = 0.2;
  const auto opening = [](const Vec3d& p) { return (p.x() * p.x() + p.y() * p.y()) / (a * a) - 1.0; };
  const auto tilt = [](const Vec3d& p) { return Vec3d(steepness / a * Vec3d(p.x(), p.y(), 0.0)); };
  std::vector<ContactSlope> slopes;
  for (const Vec3d& p : m.mesh.nodes)
    slopes.push_back(
        p.z() > 0.0 ? ContactSlope{p.normalized(), tilt(p), opening(p), opening(p) < 3.0 ? 1.0 : 0.0} : ContactSlope{});
  const OpticalScene scene(m.body, m.mesh, {.tool_slopes = slopes}, {}, {}), plain(m.body, m.mesh, {}, {}, {});
  int touching = 0, beside = 0, below = 0;
  for (std::size_t f = 0; f < scene.face_count(); ++f)
    for (const auto& [b1, b2] : {std::pair(0.2, 0.2), std::pair(0.6, 0.2), std::pair(0.2, 0.6)}) {
      ScenePoint at;
      at.face = int(f);
      at.b1 = b1;
      at.b2 = b2;
      const Vec3d p = scene.reference(at), n = scene.smooth_normal(at);
      if (const double q = opening(p); p.z() > 0.1e-3 && q < 2.5) {
        CHECK((n - (p.normalized() + hertz_slope(q) * tilt(p)).normalized()).norm() < 0.01);
        ++(q < 0.0 ? touching : beside);
      } else if (p.z() < -0.1 * radius) {
        CHECK((n - plain.smooth_normal(at)).norm() == 0.0);
        ++below;
      }
    }
  CHECK(touching > 20);
  CHECK(beside > 20);
  CHECK(below > 20);
  slopes.pop_back();
  CHECK_THROWS_AS(OpticalScene(m.body, m.mesh, {.tool_slopes = slopes}, {}, {}), InvalidArgument);
}
