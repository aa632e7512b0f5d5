#include "lumo/mesh/swept_mesher.hpp"

#include "catch.hpp"
#include "geometry/surfaces.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"
#include "mesh/finger_laws.hpp"
#include "mesh/mesher_laws.hpp"
#include "mesh/random_design.hpp"

#include <random>
#include <set>

using namespace lumo;
using mesher_laws::check_laws;

namespace {

double turned_area(const Point2& a, const Point2& b, const Point2& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

double polygon_area(const std::vector<Point2>& polygon) {
  double sum = 0.0;
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) sum += 0.5 * turned_area(polygon[0], polygon[i], polygon[i + 1]);
  return sum;
}

/// Valid, all of the polygon, its outline whole; returns the smallest angle [deg].
double check_triangulation(const PolygonRefinement& r, const std::vector<Point2>& polygon) {
  double sum = 0.0, least = 180.0;
  std::map<std::pair<int, int>, int> edges;
  const auto& p = r.points();
  for (const auto& t : r.triangles())
    for (std::size_t k = 0; k < 3; ++k) {
      const Point2 &a = p[std::size_t(t.corners[k])], &b = p[std::size_t(t.corners[(k + 1) % 3])],
                   &c = p[std::size_t(t.corners[(k + 2) % 3])];
      CHECK(orient2d(a, b, c) > 0);
      sum += turned_area(a, b, c) / 6.0;
      ++edges[{t.corners[k], t.corners[(k + 1) % 3]}];
      least = std::min(least,
          std::atan2(turned_area(a, b, c), (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1])) * 180.0 / pi);
      // Neighbours know each other, and share the edge.
      if (const int other = t.across[k]; other >= 0) {
        const auto& n = r.triangles()[std::size_t(other)];
        const auto self = std::find_if(n.across.begin(), n.across.end(),
            [&](int back) { return back >= 0 && &r.triangles()[std::size_t(back)] == &t; });
        REQUIRE(self != n.across.end());
        const auto j = std::size_t(self - n.across.begin());
        CHECK((n.corners[(j + 1) % 3] == t.corners[(k + 2) % 3] && n.corners[(j + 2) % 3] == t.corners[(k + 1) % 3]));
      }
    }
  CHECK(sum == Approx(polygon_area(polygon)).epsilon(1e-12));
  for (const auto& [edge, times] : edges) CHECK(times == 1);
  std::vector<double> covered(polygon.size(), 0.0);
  for (const auto& piece : r.outline()) {
    const Point2 &a = p[std::size_t(piece.from)], &b = p[std::size_t(piece.to)];
    covered[std::size_t(piece.edge)] += std::hypot(b[0] - a[0], b[1] - a[1]);
    CHECK((edges.contains({piece.from, piece.to}) && !edges.contains({piece.to, piece.from})));
  }
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point2 &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    CHECK((p[i] == polygon[i]));
    CHECK(covered[i] == Approx(std::hypot(b[0] - a[0], b[1] - a[1])).epsilon(1e-12));
  }
  return least;
}

MeshError::Reason refusal(const MeshInput& input) {
  try {
    SweptMesher{}.fill(input);
  } catch (const MeshError& error) {
    CHECK(std::string(error.what()).find('\n') == std::string::npos);
    return error.reason();
  }
  FAIL("filled");
  return {};
}

}  // namespace

TEST_CASE("a polygon without sharp corners is filled with triangles of more than 20 degrees and of the wanted size") {
  const std::vector<std::vector<Point2>> polygons{{{0, 0}, {1, 0}, {1, 1}, {0, 1}},
      {{0, 0}, {8, 0}, {8, 0.5}, {0, 0.5}}, {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}},
      {{0, 0}, {10, 0}, {10, 10}, {6, 10}, {6, 0.2}, {5.9, 0.2}, {5.9, 10}, {0, 10}},  // a narrow slot that nearly cuts
                                                                                       // it in two
      {{0, 0}, {1, 0}, {1.5, 0.8660254}, {1, 1.7320508}, {0, 1.7320508}, {-0.5, 0.8660254}}};
  for (const auto& polygon : polygons)
    for (const double edge : {3.0, 0.4, 0.1}) {
      auto filled = PolygonRefinement::of(polygon);
      REQUIRE(filled);
      check_triangulation(*filled, polygon);
      REQUIRE(filled->refine([&](const Point2&) { return edge; }));
      INFO(polygon.size() << " corners, edge " << edge << ", " << filled->triangles().size() << " triangles");
      CHECK(check_triangulation(*filled, polygon) > 20.0);
      double longest = 0.0;
      for (const auto& t : filled->triangles())
        for (std::size_t k = 0; k < 3; ++k) {
          const Point2 &a = filled->points()[std::size_t(t.corners[k])],
                       &b = filled->points()[std::size_t(t.corners[(k + 1) % 3])];
          longest = std::max(longest, std::hypot(b[0] - a[0], b[1] - a[1]));
        }
      CHECK(longest <= 2.0 * 1.1 / std::sqrt(3.0) * edge);  // the diameter of the largest circumcircle admitted
    }
}

TEST_CASE("any simple polygon is filled, sharp corners and all, and grading is followed") {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int round = 0; round < 60; ++round) {
    const int n = 3 + int(random() % 40);
    std::vector<Point2> polygon;
    for (int i = 0; i < n; ++i) {  // a star: spikes where neighbours' radii differ
      const double angle = 2.0 * pi * (i + 0.7 * unit(random)) / n, radius = 0.2 + 0.8 * unit(random);
      polygon.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
    if (polygon_area(polygon) <= 0.0) continue;
    auto filled = PolygonRefinement::of(polygon);
    if (!filled) continue;  // three corners may leave the centre out and turn the other way
    INFO("round " << round);
    REQUIRE(filled->refine([](const Point2& p) { return 0.02 + 0.2 * std::hypot(p[0] - 0.5, p[1]); }));
    check_triangulation(*filled, polygon);
  }
  auto square = PolygonRefinement::of({{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  REQUIRE(square);
  CHECK_FALSE(square->refine([](const Point2&) { return 1e-4; }));  // ten million triangles
  CHECK_FALSE(PolygonRefinement::of({{0, 0}, {1, 1}, {1, 0}, {0, 1}}));
  CHECK_FALSE(PolygonRefinement::of({{0, 0}, {0, 1}, {1, 1}, {1, 0}}));  // clockwise
}

TEST_CASE("the swept mesher obeys a mesher's laws") {
  std::vector<MeshInput> bodies{
      surfaces::box(Vec3d(0, 0, 0), Vec3d(1, 2, 3)), surfaces::l_prism(), surfaces::notched_finger(8)};
  for (MeshInput& body : bodies)
    for (const double edge : {0.0, 0.7, 0.15}) {
      if (edge > 0.0) body.edge = [edge](const Vec3d& p) { return edge * (1.0 + std::abs(p.y() - 0.5)); };
      check_laws(SweptMesher{}.fill(body), body);
      mesher_laws::check_same_bits(SweptMesher{}, SweptMesher{}, body);
    }
  // Layers follow the wish along y.
  bodies[0].edge = [](const Vec3d& p) { return 0.05 + 0.2 * p.y(); };
  std::set<double> levels;
  for (const Vec3d& v : SweptMesher{}.fill(bodies[0]).vertices) levels.insert(v.y());
  double before = -1.0, thickness = 0.0;
  for (const double y : levels) {
    if (before >= 0.0) {
      CHECK(y - before > thickness);
      thickness = y - before;
      CHECK(thickness == Approx(0.05 + 0.2 * 0.5 * (before + y)).epsilon(0.1));
    }
    before = y;
  }
}

TEST_CASE("the swept mesher says what is no prism along y") {
  CHECK(refusal(surfaces::sphere(1)) == MeshError::Reason::degenerate);
  MeshInput slanted = surfaces::box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  for (const std::size_t v : {4, 5, 6, 7}) slanted.vertices[v].x() += 0.1 * slanted.vertices[v].y();
  CHECK(refusal(slanted) == MeshError::Reason::degenerate);
  MeshInput two = surfaces::box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  surfaces::append(two, surfaces::box(Vec3d(2, 0, 0), Vec3d(3, 1, 1)));
  CHECK(refusal(two) == MeshError::Reason::degenerate);
  MeshInput point = surfaces::box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
  point.vertices.emplace_back(0.5, 0.5, 0.5);
  CHECK(refusal(point) == MeshError::Reason::degenerate);
  MeshInput kept = surfaces::l_prism();
  kept.keep_surface = true;
  CHECK(refusal(kept) == MeshError::Reason::degenerate);
  MeshInput halves = surfaces::box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));  // one side in two triangles
  halves.facets[5] = {{1, 3, 7}, 5};
  halves.facets.push_back({{1, 7, 5}, 5});
  CHECK(refusal(halves) == MeshError::Reason::degenerate);
  MeshInput open = surfaces::l_prism();
  open.facets.pop_back();
  CHECK(refusal(open) == MeshError::Reason::open);
  MeshInput vague = surfaces::l_prism();
  vague.edge = [](const Vec3d&) { return std::numeric_limits<double>::quiet_NaN(); };
  CHECK(refusal(vague) == MeshError::Reason::not_finite);
  vague.edge = [](const Vec3d&) { return 1e-7; };
  CHECK(refusal(vague) == MeshError::Reason::out_of_memory);
}

TEST_CASE("fingers are swept: exact profile, exact volume, exactly symmetric") {
  std::mt19937 random(3);
  for (int k = 0; k < 25; ++k) check_finger_mesh(random_design(random), SweptMesher{}, {1.2e-3, 0.3, 1.0}, true);
}
