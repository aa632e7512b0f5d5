#include "lumo/fabrication/faceted_solid.hpp"

#include "catch.hpp"

#include "lumo/core/units.hpp"

#include <cmath>
#include <functional>
#include <random>

using namespace lumo;

namespace {

using Loop = FacetedSolid::Loop;

/// Counter-clockwise about z, with corners at random radii within [low, high] of the middle: a star, perhaps concave.
Loop star(double x, double y, double low, double high, int corners, std::mt19937& random) {
  std::uniform_real_distribution<double> radius(low, high);
  Loop loop;
  for (int k = 0; k < corners; ++k) {
    const double angle = 2.0 * pi * k / corners, r = radius(random);
    loop.emplace_back(x + r * std::cos(angle), y + r * std::sin(angle), 0.0);
  }
  return loop;
}

double area(const Loop& loop) {
  double sum = 0.0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Vec3d &a = loop[i], &b = loop[(i + 1) % loop.size()];
    sum += 0.5 * (a.x() * b.y() - a.y() * b.x());
  }
  return sum;
}

Loop raised(Loop loop, double z) {
  for (Vec3d& p : loop) p.z() = z;
  return loop;
}

Loop square(double half, double x = 0.0, double y = 0.0) {
  return {{x - half, y - half, 0}, {x + half, y - half, 0}, {x + half, y + half, 0}, {x - half, y + half, 0}};
}

/// The prism over an outline with holes, of height one.
TriangleSurface prism(const Loop& outline, const std::vector<Loop>& holes) {
  FacetedSolid solid;
  std::vector<Loop> low, high;
  solid.band(outline, raised(outline, 1.0));
  for (const Loop& hole : holes) {
    solid.band(reversed(hole), raised(reversed(hole), 1.0));
    low.push_back(hole);
    high.push_back(raised(reversed(hole), 1.0));
  }
  solid.face(reversed(outline), low);
  solid.face(raised(outline, 1.0), high);
  return solid.surface();
}

MeshError::Reason reason(const std::function<void()>& build) {
  try {
    build();
  } catch (const MeshError& e) {
    return e.reason();
  }
  FAIL("must be refused");
  return {};
}

}  // namespace

TEST_CASE("a prism over a polygon with holes has the volume of the areas", "[fabrication]") {
  std::mt19937 random(7);
  for (int trial = 0; trial < 40; ++trial) {
    const Loop outline = star(0, 0, 6, 9, 5 + trial % 40, random);
    std::vector<Loop> holes;
    for (int k = 0; k < trial % 5; ++k) {
      const double angle = 2.0 * pi * k / 4 + 0.1 * trial;
      holes.push_back(star(2.2 * std::cos(angle), 2.2 * std::sin(angle), 0.3, 1.0, 3 + (trial + k) % 9, random));
    }
    if (trial % 5 == 4) holes.back() = star(0, 0, 0.3, 0.8, 7, random);  // in the middle of the others
    if (outline.size() < 8) holes.clear();                               // its edges may come near the middle
    double expected = area(outline);
    for (const Loop& hole : holes) expected -= area(hole);
    CHECK(validate_surface(prism(outline, holes)).volume == Approx(expected).epsilon(1e-12));
  }
}

TEST_CASE("holes in a row along an axis, and corners at the same heights, are no obstacle", "[fabrication]") {
  std::vector<Loop> holes;
  for (int i = -2; i <= 2; ++i)
    for (int j = -2; j <= 2; ++j) holes.push_back(square(0.5, 2.0 * i, 2.0 * j));
  CHECK(validate_surface(prism(square(6.0), holes)).volume == Approx(144.0 - 25.0).epsilon(1e-12));
}

TEST_CASE("faces meet edge to edge where their neighbours have more corners", "[fabrication]") {
  // A box whose top is given in four pieces and whose sides in one.
  FacetedSolid solid;
  const Loop low = square(1.0), high = raised(low, 1.0);
  solid.face(reversed(low));
  solid.band(low, high);
  for (const double x : {-0.5, 0.5})
    for (const double y : {-0.5, 0.5}) solid.face(raised(square(0.5, x, y), 1.0));
  CHECK(validate_surface(solid.surface()).volume == Approx(4.0).epsilon(1e-14));
}

TEST_CASE("what bounds no solid is refused for its reason", "[fabrication]") {
  const Loop low = square(1.0), high = raised(low, 1.0);
  CHECK(reason([&] {
    FacetedSolid solid;
    solid.band(low, high);
    solid.face(high);
    solid.surface();
  }) == MeshError::Reason::open);
  CHECK(reason([&] {
    FacetedSolid solid;
    solid.band(low, high);
    solid.face(high);
    solid.face(low);  // looks inwards
    solid.surface();
  }) == MeshError::Reason::not_manifold);
  CHECK(reason([&] { prism(square(1.0), {square(0.5, 0.8)}); }) ==
        MeshError::Reason::self_intersecting);  // a hole over the edge
  CHECK(reason([&] {
    prism(square(2.0), {square(0.5, 0.2), square(0.5, -0.2)});
  }) == MeshError::Reason::self_intersecting);  // holes over each other
}
