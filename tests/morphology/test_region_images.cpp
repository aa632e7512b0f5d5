#include "catch.hpp"
#include "lumo/lab/observe_pad.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/morphology/region_images.hpp"

#include <cmath>

using namespace lumo;
using Kind = RegionImages::Kind;

namespace {

// A quarter of a block 20 × 40 × 5 mm, of which the whole is symmetric in x and y.
Body quarter_block() {
  Body b;
  const Vec3d half(10e-3, 20e-3, 5e-3);
  for (int k = 0; k < 8; ++k)
    b.vertices.emplace_back(k & 1 ? half.x() : 0.0, k & 2 ? half.y() : 0.0, k & 4 ? half.z() : 0.0);
  b.patches = {{.name = "bottom", .shape = Plane{Vec3d::Zero(), -Vec3d::UnitZ()}, .bonded = true},
      {.name = "top", .shape = Plane{{0, 0, half.z()}, Vec3d::UnitZ()}, .contactable = true},
      {.name = "side", .shape = Plane{{half.x(), 0, 0}, Vec3d::UnitX()}},
      {.name = "end", .shape = Plane{{0, half.y(), 0}, Vec3d::UnitY()}}};
  b.facets = {{{0, 2, 3, 1}, 0}, {{4, 5, 7, 6}, 1}, {{1, 3, 7, 5}, 2}, {{2, 6, 7, 3}, 3},
      {{0, 4, 6, 2}, Body::mirror_patch}, {{0, 1, 5, 4}, Body::mirror_patch}};
  b.symmetry = {true, true};
  return b;
}

Body with_regions(int count, std::function<int(const Vec3d&, const Vec3d&)> region) {
  Body b = quarter_block();
  b.regions = count;
  b.region = std::move(region);
  return b;
}

}  // namespace

TEST_CASE("mirror images of regions are found by asking", "[regions]") {
  Body halves = with_regions(2, [](const Vec3d& p, const Vec3d&) { return p.y() > 0.0 ? 0 : 1; });
  CHECK(region_images(halves, 0).image == std::vector<int>{0, 1});
  CHECK(region_images(halves, 1).image == std::vector<int>{1, 0});
  const Body by_normal = with_regions(2, [](const Vec3d&, const Vec3d& n) { return n.x() > 0.5 ? 0 : n.x() < -0.5; });
  CHECK(region_images(by_normal, 0).kind == Kind::unknown);  // the rest is a region 0, too
  const Body sides = with_regions(2, [](const Vec3d&, const Vec3d& n) {
    return n.x() > 0.5 ? 0 : n.x() < -0.5 ? 1 : -1;
  });
  CHECK(region_images(sides, 0).image == std::vector<int>{1, 0});
  CHECK(region_images(sides, 1).image == std::vector<int>{0, 1});
  const Body one_side = with_regions(1, [](const Vec3d& p, const Vec3d&) { return p.x() > 0.0 ? 0 : -1; });
  CHECK(region_images(one_side, 0).kind == Kind::unseen);
  CHECK(region_images(one_side, 1).image == std::vector<int>{0});
}

TEST_CASE("regions without images of their own are not made up", "[regions]") {
  const Body uneven = with_regions(2, [](const Vec3d& p, const Vec3d&) { return p.y() > 3e-3 ? 0 : 1; });
  CHECK(region_images(uneven, 1).kind == Kind::unknown);
  CHECK(region_images(uneven, 0).image == std::vector<int>{0, 1});
  const Body partly = with_regions(1, [](const Vec3d& p, const Vec3d&) { return p.y() > -3e-3 ? 0 : -1; });
  CHECK(region_images(partly, 1).kind == Kind::unknown);
  const Body never = with_regions(2, [](const Vec3d&, const Vec3d&) { return 0; });  // region 1 is nowhere
  CHECK(region_images(never, 0).kind == Kind::unknown);
  Body lopsided = with_regions(2, [](const Vec3d& p, const Vec3d&) { return p.y() > 0.0 ? 0 : 1; });
  lopsided.symmetry.y = false;
  CHECK(region_images(lopsided, 1).kind == Kind::unknown);
  CHECK(region_images(quarter_block(), 1).kind == Kind::regions);  // none at all
}

TEST_CASE("a map that contradicts region() is refused with a place", "[regions]") {
  Body halves = with_regions(2, [](const Vec3d& p, const Vec3d&) { return p.y() > 0.0 ? 0 : 1; });
  halves.region_image_y = std::vector<int>{1, 0};
  CHECK(region_images(halves, 1).image == std::vector<int>{1, 0});
  halves.region_image_y = std::vector<int>{};  // itself
  CHECK_THROWS_WITH(region_images(halves, 1), Catch::Contains("region_image_y says that region 0"));
  halves.region_image_y = std::vector<int>{1, 1};
  CHECK_THROWS_AS(region_images(halves, 1), InvalidArgument);
  halves.region_image_y = std::vector<int>{1};
  CHECK_THROWS_WITH(region_images(halves, 1), Catch::Contains("has 1 regions, the body has 2"));
  halves.region_image_y = std::vector<int>{1, 2};
  CHECK_THROWS_AS(region_images(halves, 1), InvalidArgument);
  halves.facets.clear();  // nothing to be asked at
  halves.region_image_y = std::vector<int>{1, 0};
  CHECK(region_images(halves, 1).image == std::vector<int>{1, 0});
  halves.region_image_y.reset();
  CHECK(region_images(halves, 1).kind == Kind::unknown);
}

TEST_CASE("fingers and the lab's pads know their images, and each map is the one that is found", "[regions]") {
  FingerOptions one_side = plain_finger();
  one_side.readout.one_side = true;
  for (const Body& body : {finger(plain_baseline(), dragon_skin(), plain_finger()),
           finger(plain_baseline(), dragon_skin(), one_side), finger(built_baseline(), dragon_skin(), {}),
           seen_from_sides(finger(plain_baseline(), dragon_skin(), plain_finger()), SideSight{})})
    for (const int axis : {0, 1}) {
      Body bare = body;
      bare.region_image_x.reset();
      bare.region_image_y.reset();
      const RegionImages given = region_images(body, axis), found = region_images(bare, axis);
      CHECK(given.kind == found.kind);
      CHECK(given.image == found.image);
    }
  CHECK(region_images(finger(plain_baseline(), dragon_skin(), one_side), 0).kind == Kind::unseen);
  CHECK(region_images(finger(plain_baseline(), dragon_skin(), plain_finger()), 0).kind == Kind::regions);
}
