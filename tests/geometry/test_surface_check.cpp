#include "lumo/geometry/surface_check.hpp"

#include "catch.hpp"
#include "geometry/surfaces.hpp"

#include <optional>
#include <random>
#include <set>
#include <string>

using lumo::MeshError;
using lumo::MeshInput;
using lumo::validate_surface;
using lumo::Vec3d;
using Reason = MeshError::Reason;
using namespace surfaces;

namespace {

/// Why a surface is refused, if it is.
std::optional<Reason> verdict(const MeshInput& input) {
  try {
    validate_surface(input);
    return std::nullopt;
  } catch (const MeshError& error) {
    const std::string line = error.what();
    CHECK(line.find('\n') == std::string::npos);
    CHECK(line.size() > 20);
    return error.reason();
  }
}

/// Reasons that are right for a fault: random changes may break more than one rule.
std::set<Reason> right_reasons(surfaces::Fault fault) {
  switch (fault) {
    case surfaces::Fault::hole: return {Reason::open};
    case surfaces::Fault::crossing: return {Reason::self_intersecting};
    case surfaces::Fault::degenerate_facet: return {Reason::degenerate, Reason::duplicate};
    case surfaces::Fault::bad_index: return {Reason::bad_index};
    case surfaces::Fault::nan_vertex:
    case surfaces::Fault::infinite_vertex:
    case surfaces::Fault::huge_vertex: return {Reason::not_finite};
    case surfaces::Fault::duplicate_vertices: return {Reason::duplicate};
    case surfaces::Fault::touching_sheets: return {Reason::self_intersecting};
    case surfaces::Fault::soup: return {Reason::degenerate, Reason::open, Reason::not_manifold};
    case surfaces::Fault::coplanar: return {Reason::degenerate, Reason::duplicate};
    case surfaces::Fault::inverted: return {Reason::not_manifold};
    case surfaces::Fault::empty: return {Reason::degenerate};
  }
  return {};
}

}  // namespace

TEST_CASE("every kind of bad surface is refused for the right reason", "[mesh][surface]") {
  for (const auto& [fault, name] : all_faults) {
    int wrong = 0;
    for (std::uint64_t seed = 0; seed < 60; ++seed) {
      const auto reason = verdict(faulty(fault, seed));
      wrong += !reason || right_reasons(fault).count(*reason) == 0;
    }
    INFO(name);
    CHECK(wrong == 0);
  }
}

TEST_CASE("good surfaces pass, turned and scaled, with their area and volume", "[mesh][surface]") {
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 40; ++trial) {
    MeshInput input = trial % 5 == 0   ? box(Vec3d(0, 0, 0), Vec3d(1, 2, 3))
                      : trial % 5 == 1 ? l_prism()
                      : trial % 5 == 2 ? notched_finger(4 + trial)
                      : trial % 5 == 3 ? sphere(trial % 4)
                                       : block(2 + trial % 7, random);
    const lumo::SurfaceReport before = validate_surface(input);
    turn(input, random);
    const double scale = std::pow(10.0, trial % 9 - 4);
    for (Vec3d& v : input.vertices) v = scale * v + scale * Vec3d(5, -3, 1);
    const lumo::SurfaceReport after = validate_surface(input);
    CHECK(after.volume == Approx(before.volume * scale * scale * scale).epsilon(1e-11));
    CHECK(after.area == Approx(before.area * scale * scale).epsilon(1e-11));
  }
  CHECK(validate_surface(box(Vec3d(0, 0, 0), Vec3d(1, 2, 3))).volume == Approx(6.0));
  CHECK(validate_surface(l_prism()).volume == Approx(3.0));
  CHECK(validate_surface(l_prism()).area == Approx(14.0));
}

TEST_CASE("edges and vertices that are not those of a solid", "[mesh][surface]") {
  MeshInput one_turned = sphere(1);
  std::swap(one_turned.facets[5].loop[0], one_turned.facets[5].loop[1]);
  CHECK(verdict(one_turned) == Reason::not_manifold);

  MeshInput fin = sphere(1);  // an edge with three facets
  fin.vertices.emplace_back(3, 0, 0);
  fin.facets.push_back({{fin.facets[0].loop[0], fin.facets[0].loop[1], static_cast<int>(fin.vertices.size()) - 1}, 0});
  CHECK((verdict(fin) == Reason::open || verdict(fin) == Reason::not_manifold));

  MeshInput twice = sphere(0);
  for (std::size_t i = 0; i < 20; ++i) twice.facets.push_back(lumo::Facet(twice.facets[i]));
  CHECK(verdict(twice) == Reason::not_manifold);

  MeshInput pinched = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));  // two boxes with one corner in common
  append(pinched, box(Vec3d(1, 1, 1), Vec3d(2, 2, 2)));
  for (auto& facet : pinched.facets)
    for (int& vertex : facet.loop)
      if (vertex == 8) vertex = 7;
  CHECK(verdict(pinched).has_value());
  pinched.vertices[8] = Vec3d(0.5, 0.5, 0.5);  // the unused one becomes an interior point: only the fan is wrong
  CHECK(verdict(pinched) == Reason::not_manifold);
}

TEST_CASE("facets that are not flat simple polygons", "[mesh][surface]") {
  MeshInput warped = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  warped.vertices[7].z() = 1.01;
  CHECK(verdict(warped) == Reason::degenerate);

  MeshInput bow = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  std::swap(bow.facets[1].loop[1], bow.facets[1].loop[2]);
  CHECK(verdict(bow).has_value());

  MeshInput crossed = prism({{0, 0}, {2, 0}, {2, 2}, {1, -1}, {0, 2}}, 1.0);  // the ends' outline crosses itself
  CHECK(verdict(crossed) == Reason::self_intersecting);
  MeshInput touching =
      prism({{0, 0}, {2, 0}, {2, 2}, {1, 0}, {0, 2}}, 1.0);  // a notch that just reaches the other side
  CHECK(verdict(touching) == Reason::self_intersecting);
  CHECK(!verdict(prism({{0, 0}, {2, 0}, {2, 2}, {1, 0.01}, {0, 2}}, 1.0)));
  CHECK(!verdict(prism({{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}}, 1.0)));  // corners on straight edges
}

TEST_CASE("neighbours may be coplanar but not folded onto each other", "[mesh][surface]") {
  MeshInput flat = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  flat.facets[1] = {{4, 5, 7}, 1};
  flat.facets.push_back({{4, 7, 6}, 1});
  CHECK(!verdict(flat));

  // A spike of no thickness on the top: two facets lie on each other.
  MeshInput spike = flat;
  spike.vertices.emplace_back(0.5, 0.5, 2.0);
  spike.facets[1] = {{4, 5, 7}, 1};
  spike.facets.back() = {{4, 7, 8}, 1};
  spike.facets.push_back({{4, 8, 7}, 1});
  spike.facets.push_back({{4, 7, 6}, 1});
  CHECK(verdict(spike).has_value());

  for (const double lift : {1e-3, 1e-12, 0.0}) {  // a thin tent over the top, flatter and flatter
    MeshInput tent = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
    const int a = 8, b = 9;
    tent.vertices.emplace_back(1.5, 0.3, 1.0);
    tent.vertices.emplace_back(1.5, 0.7, 1.0);
    tent.vertices.emplace_back(0.5, 0.5, 1.0 + lift);
    tent.facets[1] = {{4, 5, 7, 6}, 1};
    tent.facets[5] = {{1, 3, 7, 5}, 5};
    // A flap from the top edge out and back over the top.
    tent.facets[1] = {{4, 10, 6}, 1};
    tent.facets.push_back({{4, 5, a, 10}, 1});
    tent.facets.push_back({{6, 10, b, 7}, 1});
    tent.facets.push_back({{10, a, b}, 1});
    tent.facets.push_back({{5, 7, b, a}, 1});
    const auto reason = verdict(tent);
    if (lift > 1e-6)
      CHECK((!reason || *reason == Reason::degenerate));  // the flap's four-corner facets are not flat then
    else CHECK(reason == Reason::self_intersecting);
  }
}

TEST_CASE("thin gaps are legal, closed ones are not", "[mesh][surface]") {
  for (const double gap : {1e-2, 1e-6, 1e-10, 0.0, -1e-10}) {
    MeshInput pair = box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
    append(pair, box(Vec3d(1 + gap, 0.2, 0.3), Vec3d(2, 1.2, 1.3)));
    std::mt19937_64 random(5);
    turn(pair, random);
    if (gap > 1e-7) CHECK(!verdict(pair));
    else CHECK(verdict(pair) == Reason::self_intersecting);
  }
}

TEST_CASE("cavities, separate bodies and interior points", "[mesh][surface]") {
  MeshInput hollow = box(Vec3d(0, 0, 0), Vec3d(4, 4, 4));
  MeshInput inner = box(Vec3d(1, 1, 1), Vec3d(2, 3, 3));
  append(hollow, inner);
  CHECK(verdict(hollow) == Reason::not_manifold);  // a solid in a solid
  hollow = box(Vec3d(0, 0, 0), Vec3d(4, 4, 4));
  invert(inner);
  append(hollow, inner);
  const auto report = validate_surface(hollow);
  CHECK(report.volume == Approx(60.0));
  REQUIRE(report.cavities.size() == 1);
  CHECK((report.cavities[0].array() > Vec3d(1, 1, 1).array()).all());
  CHECK((report.cavities[0].array() < Vec3d(2, 3, 3).array()).all());

  MeshInput beside = box(Vec3d(0, 0, 0), Vec3d(4, 4, 4));
  for (Vec3d& v : inner.vertices) v.x() += 10.0;
  append(beside, inner);
  CHECK(verdict(beside) == Reason::not_manifold);  // a cavity outside

  MeshInput point = sphere(1);
  point.vertices.emplace_back(0.1, 0.2, 0.3);
  CHECK(!verdict(point));
  point.vertices.emplace_back(2.0, 0.0, 0.0);
  CHECK(verdict(point) == Reason::bad_index);
}

TEST_CASE("a fine surface is checked, flat parts included", "[mesh][surface]") {
  std::mt19937_64 random(9);
  MeshInput fine = block(40, random);  // 19 200 triangles, most in exact planes
  CHECK(!verdict(fine));
  turn(fine, random);  // now in planes but for rounding
  CHECK(!verdict(fine));
  CHECK(!verdict(sphere(5)));
  CHECK(!verdict(notched_finger(100)));
}
