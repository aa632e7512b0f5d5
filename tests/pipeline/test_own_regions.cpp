#include "catch.hpp"
#include "pipeline/coarse_pipeline.hpp"

using namespace lumo;

namespace {

// A quarter of a slab 16 × 24 × 5 mm with a lamp in it. Light that leaves at y > 0 is one region, the rest another.
Body two_halves(double half_length = 12e-3) {
  Body b;
  const Vec3d half(8e-3, half_length, 5e-3);
  for (int k = 0; k < 8; ++k)
    b.vertices.emplace_back(k & 1 ? half.x() : 0.0, k & 2 ? half.y() : 0.0, k & 4 ? half.z() : 0.0);
  b.patches = {
      {.name = "bottom", .shape = Plane{Vec3d::Zero(), -Vec3d::UnitZ()}, .bonded = true, .optics = Lambertian{}},
      {.name = "top", .shape = Plane{{0, 0, half.z()}, Vec3d::UnitZ()}, .contactable = true},
      {.name = "side", .shape = Plane{{half.x(), 0, 0}, Vec3d::UnitX()}},
      {.name = "end", .shape = Plane{{0, half.y(), 0}, Vec3d::UnitY()}}};
  b.facets = {{{0, 2, 3, 1}, 0}, {{4, 5, 7, 6}, 1}, {{1, 3, 7, 5}, 2}, {{2, 6, 7, 3}, 3},
      {{0, 4, 6, 2}, Body::mirror_patch}, {{0, 1, 5, 4}, Body::mirror_patch}};
  b.symmetry = {true, true};
  b.pivot = {0, 0, half.z()};
  b.medium = {1.41, 20.0};
  b.surroundings = {1.0};
  b.emitters = {RectangleEmitter{{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}}};
  b.regions = 2;
  b.region = [](const Vec3d& p, const Vec3d&) { return p.y() > 0.0 ? 0 : 1; };
  return b;
}

std::vector<Scenario<Sphere>> on_both_halves() {
  return {{Sphere{10e-3}, 0.0, 4e-3, {0.5}}, {Sphere{10e-3}, 0.0, -4e-3, {0.5}}};
}

}  // namespace

TEST_CASE("a body of one's own that says nothing of mirror images has its own light on each side") {
  CoarsePipeline p = coarse_pipeline();
  const auto change = [&](const Body& body, std::size_t scenario, Eigen::Index region) {
    return observe(body, on_both_halves(), p, Serial{}).scenarios[scenario].states[0].change.col(region).mean();
  };
  const Body body = two_halves();
  const double near = change(body, 0, 0), far = change(body, 0, 1);
  REQUIRE(std::abs(near - far) > 1e-4);
  CHECK(change(body, 1, 0) == far);  // to the bit: one is the other's mirror image
  CHECK(change(body, 1, 1) == near);
  p.mirror_once = false;  // pressed and lit by itself: the same up to mesh and rays
  CHECK(std::abs(change(body, 1, 0) - far) < 0.2 * std::abs(near - far));
  CHECK(std::abs(change(body, 1, 1) - near) < 0.2 * std::abs(near - far));
  p.mirror_once = true;
  // Regions without images: each contact is pressed by itself.
  Body uneven = body;
  uneven.region = [](const Vec3d& q, const Vec3d&) { return q.y() > 1e-3 ? 0 : 1; };
  const auto pressed = press(uneven, on_both_halves(), p, Serial{});
  CHECK(pressed.plan.solves.size() == 2);
  CHECK(press(body, on_both_halves(), p, Serial{}).plan.solves.size() == 1);
  Body wrong = body;
  wrong.region_image_y = std::vector<int>{};
  CHECK_THROWS_AS(observe(wrong, on_both_halves(), p, Serial{}), InvalidArgument);
}

TEST_CASE("a contact off the plane x = 0 is that off the plane y = 0, turned by a right angle") {
  CoarsePipeline p = coarse_pipeline();
  Body along = two_halves(8e-3), across = along;  // a square
  across.region = [](const Vec3d& q, const Vec3d&) { return q.x() > 0.0 ? 0 : 1; };
  const auto at = [](double x_m, double y_m) {
    return Scenario<Sphere>{Sphere{10e-3}, 0.0, y_m, {0.5}, TiltPlane::xz, x_m};
  };
  const auto sideways = observe(across, std::vector{at(3e-3, 0.0), at(-3e-3, 0.0)}, p, Serial{}),
             lengthways = observe(along, std::vector{at(0.0, 3e-3)}, p, Serial{});
  const auto &plus = sideways.scenarios[0].states[0], &minus = sideways.scenarios[1].states[0],
             &turned = lengthways.scenarios[0].states[0];
  CHECK(sideways.scenarios[1].x_m == -3e-3);
  CHECK(plus.depth_m == Approx(turned.depth_m).epsilon(0.005));
  CHECK(plus.contact_area_m2 == Approx(turned.contact_area_m2).epsilon(0.03));
  CHECK(minus.depth_m == plus.depth_m);
  CHECK(minus.change.col(0) == plus.change.col(1));
  CHECK(minus.change.col(1) == plus.change.col(0));
  const double spread = std::abs(plus.change.col(0).mean() - plus.change.col(1).mean());
  REQUIRE(spread > 1e-4);
  for (Eigen::Index region = 0; region < 2; ++region)
    CHECK(std::abs(plus.change.col(region).mean() - turned.change.col(region).mean()) < 0.2 * spread);
  p.mirror_once = false;  // pressed by itself
  const auto alone = observe(across, std::vector{at(-3e-3, 0.0)}, p, Serial{});
  CHECK(alone.scenarios[0].states[0].depth_m == Approx(plus.depth_m).epsilon(1e-9));
}

TEST_CASE("a lamp beside the body is refused by all that lights it") {
  const CoarsePipeline p = coarse_pipeline();
  Body body = two_halves();
  body.emitters = {RectangleEmitter{{0, 0, -1e-3}, {1e-3, 0, 0}, {0, 1e-3, 0}}};
  CHECK_THROWS_WITH(observe(body, on_both_halves(), p, Serial{}), Catch::Contains("1 mm outside of it"));
  CHECK_THROWS_AS(evaluate(body, on_both_halves(), p, Serial{}, std::tuple<>{}), InvalidArgument);
}
