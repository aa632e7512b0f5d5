#include "catch.hpp"
#include "lumo/optics/bvh.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/transport/film_launch.hpp"
#include "optics/scenes.hpp"

using namespace optics_test;

namespace {

struct Start {
  PrimaryRay ray;
  double share;
  bool inside;
};

// Starts of a ray from a place below, or inside, a body whose underside is z = 0.5 mm.
std::vector<Start> starts(double z_m, std::optional<double> closes_m) {
  const Model m = box({10e-3, 10e-3, 0.5e-3}, {1.41, 0.0}, 3, {0, 0, 1e-3});
  const OpticalScene surface(m.body, m.mesh, {}, {}, {});
  const auto scene = Bvh{}.build(surface.triangles());
  PrimaryRay ray;
  ray.origin = {1e-4, 2e-4, z_m};
  ray.direction = Vec3d(0.5, 0.0, 0.8).normalized();
  std::vector<Start> all;
  FilmLaunch(scene, closes_m)(ray, Vec3d::UnitZ(), [&](const PrimaryRay& from, double share, bool in_body) {
    all.push_back({from, share, in_body});
  });
  for (const Start& s : all) CHECK(s.ray.direction == ray.direction);
  return all;
}

}  // namespace

TEST_CASE("A film that never closes leaves the light in air, however deep the body is pressed", "[film]") {
  for (const double z : {0.0, 0.3e-3, 0.4999e-3, 0.505e-3, 0.7e-3}) {
    const auto all = starts(z, std::nullopt);
    REQUIRE(all.size() == 1);
    CHECK_FALSE(all[0].inside);
    CHECK(all[0].share == 1.0);
    CHECK(all[0].ray.origin.z() < 0.5e-3);
    CHECK(all[0].ray.origin.z() == Approx(std::min(z, 0.5e-3)).margin(2e-7));
  }
}

TEST_CASE("A film that closes on touch is a switch there", "[film]") {
  const auto open = starts(0.4999e-3, 0.0), closed = starts(0.5001e-3, 0.0);
  REQUIRE(open.size() == 1);
  REQUIRE(closed.size() == 1);
  CHECK_FALSE(open[0].inside);
  CHECK(closed[0].inside);
  CHECK(closed[0].ray.origin.z() == 0.5001e-3);
}

TEST_CASE("A film that closes by degrees shares the light, smoothly in its height", "[film]") {
  const double closes = 0.1e-3;
  double last = 0.0;
  for (int step = 0; step <= 1000; ++step) {
    const double height = 0.12e-3 - 0.13e-3 * step / 1000;  // from open to pressed in
    double sum = 0.0, wet = 0.0;
    for (const Start& s : starts(0.5e-3 - height, closes)) {
      sum += s.share;
      if (!s.inside) continue;
      wet = s.share;
      CHECK(s.ray.origin.z() == Approx(std::max(0.5e-3, 0.5e-3 - height)).margin(1e-9));
    }
    CHECK(sum == Approx(1.0));
    CHECK(wet >= last - 1e-12);
    CHECK(wet - last < 0.003);
    last = wet;
  }
  CHECK(last == 1.0);
  CHECK(starts(0.39e-3, closes).size() == 1);
}
