#include "lumo/geometry/surface_check.hpp"
#include "lumo/mesh/body_check.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/morphology/profile.hpp"
#include "lumo/morphology/round_shapes.hpp"
#include "lumo/support/tetgen.hpp"
#include "morphology/closed.hpp"

using namespace lumo;

namespace {

const std::vector<Symmetry> all_symmetries{{false, false}, {true, false}, {false, true}, {true, true}};

double parts(Symmetry s) { return (s.x ? 2.0 : 1.0) * (s.y ? 2.0 : 1.0); }

// Volume of the whole body that its facets bound, by the divergence theorem.
double volume(const Body& body) {
  double sum = 0.0;
  for (const Facet& f : body.facets)
    for (std::size_t k = 1; k + 1 < f.loop.size(); ++k) {
      const auto at = [&](std::size_t i) -> const Vec3d& { return body.vertices[std::size_t(f.loop[i])]; };
      sum += at(0).dot(at(k).cross(at(k + 1))) / 6.0;
    }
  return sum * parts(body.symmetry);
}

void check_surface(const Body& body) {
  check_closed(body);
  ClosedSurface surface;
  surface.vertices = body.vertices;
  surface.facets = body.facets;
  MeshInput input;
  static_cast<ClosedSurface&>(input) = surface;
  validate_surface(input);
  std::vector<bool> used(body.vertices.size(), false);
  for (const Facet& f : body.facets)
    for (const int v : f.loop) used[std::size_t(v)] = true;
  CHECK(std::find(used.begin(), used.end(), false) == used.end());  // else it would be an interior point
  require_on_shapes(body);
}

// A puck with a round upper edge and a dimple: disc, wall, torus, level ring, cone.
Body puck(Symmetry symmetry, int per_quarter) {
  const double R = 10e-3, h = 6e-3, tube = 2e-3, dimple = 3e-3, deep = 1.5e-3;
  enum { floor, wall, edge, top, cone };
  Body body;
  body.symmetry = symmetry;
  body.patches = {{.name = "floor", .shape = Plane{{0, 0, 0}, {0, 0, -1}}, .bonded = true},
      {.name = "wall", .shape = CylinderShape{.radius = R}},
      {.name = "edge", .shape = TorusShape{.center = {0, 0, h - tube}, .ring = R - tube, .tube = tube}},
      {.name = "top", .shape = Plane{{0, 0, h}, {0, 0, 1}}, .contactable = true},
      {.name = "dimple",
          .shape = ConeShape{.apex = {0, 0, h - deep}, .half_angle_rad = std::atan2(dimple, deep), .hole = true}}};
  std::vector<ProfileCorner> profile{{0, 0, floor}, {R, 0, wall}};
  const auto round = arc_profile({R - tube, h - tube, edge}, tube, 0.0, 0.5 * pi, 4);
  profile.insert(profile.end(), round.begin(), round.end());
  profile.back().patch = top;
  profile.push_back({dimple, h, cone});
  profile.push_back({0.0, h - deep});
  add_revolved(body, profile, per_quarter);
  body.sizing.edge = [](const Vec3d&) { return 2.5e-3; };
  // Pappus: a cylinder without its edge, whose rounding is a quarter tube; without the cone.
  const double square = tube * tube, quarter = 0.25 * pi * square;
  const double of_square = R - 0.5 * tube, of_quarter = R - tube + 4.0 / (3.0 * pi) * tube;
  body.exact_volume_m3 =
      pi * R * R * h - 2.0 * pi * (of_square * square - of_quarter * quarter) - pi * dimple * dimple * deep / 3.0;
  return body;
}

}  // namespace

TEST_CASE("A turned profile bounds its sector, whatever the symmetry, and its volume is that of the prisms' corners") {
  for (const Symmetry symmetry : all_symmetries) {
    INFO("x " << symmetry.x << ", y " << symmetry.y);
    Body cylinder;
    cylinder.symmetry = symmetry;
    cylinder.patches = {{.name = "floor", .shape = Plane{{0, 0, -1e-3}, {0, 0, -1}}},
        {.name = "wall", .shape = CylinderShape{.radius = 4e-3}},
        {.name = "top", .shape = Plane{{0, 0, 2e-3}, {0, 0, 1}}}};
    add_revolved(cylinder, {{0, -1e-3, 0}, {4e-3, -1e-3, 1}, {4e-3, 2e-3, 2}, {0, 2e-3}}, 5);
    check_surface(cylinder);
    CHECK(volume(cylinder) == Approx(0.5 * 20 * std::sin(2.0 * pi / 20) * 16e-6 * 3e-3).epsilon(1e-12));

    Body ring;  // rectangular section, clear of the axis
    ring.symmetry = symmetry;
    ring.patches = {{.name = "floor", .shape = Plane{{0, 0, 0}, {0, 0, -1}}},
        {.name = "wall", .shape = CylinderShape{.radius = 5e-3}},
        {.name = "top", .shape = Plane{{0, 0, 2e-3}, {0, 0, 1}}},
        {.name = "bore", .shape = CylinderShape{.radius = 3e-3, .hole = true}}};
    add_revolved(ring, {{3e-3, 0, 0}, {5e-3, 0, 1}, {5e-3, 2e-3, 2}, {3e-3, 2e-3, 3}}, 4);
    check_surface(ring);
    CHECK(volume(ring) == Approx(0.5 * 16 * std::sin(2.0 * pi / 16) * 16e-6 * 2e-3).epsilon(1e-12));
    const Body round = puck(symmetry, 6);
    check_surface(round);
    for (const Vec3d& v : round.vertices) {  // exactly in the planes, or clear of them
      if (symmetry.x) CHECK((v.x() == 0.0 || v.x() > 1e-5));
      if (symmetry.y) CHECK((v.y() == 0.0 || v.y() > 1e-5));
    }
  }
}

TEST_CASE("A puck with a round edge and a conical dimple is meshed to its exact volume") {
  for (const Symmetry symmetry : {Symmetry{true, true}, Symmetry{false, false}}) {
    const Body body = puck(symmetry, 8);
    const TetMesh mesh = mesh_body(body, TetgenMesher{});  // within its gate of the exact volume
    require_valid(body, mesh);
    require_on_shapes(body, mesh);
    double sum = 0.0;
    for (const BoundaryFace& f : mesh.faces) {
      const auto at = [&](std::size_t k) -> const Vec3d& { return mesh.nodes[std::size_t(f.nodes[k])]; };
      for (const auto& t : {std::array{0, 3, 5}, std::array{3, 1, 4}, std::array{5, 4, 2}, std::array{3, 4, 5}})
        sum += at(std::size_t(t[0])).dot(at(std::size_t(t[1])).cross(at(std::size_t(t[2])))) / 6.0;
    }
    CHECK(sum == Approx(body.exact_volume_m3).epsilon(5e-3));
  }
}

TEST_CASE("A swept section is what SweptMesher fills") {
  Body body;
  body.symmetry = {true, true};
  body.patches = {{.name = "floor", .shape = Plane{{0, 0, 0}, {0, 0, -1}}, .bonded = true},
      {.name = "roof", .shape = EllipticCylinder{{0, 0, 3e-3}, 5e-3, 2e-3}, .contactable = true},
      {.name = "side", .shape = Plane{{5e-3, 0, 0}, {1, 0, 0}}},
      {.name = "end", .shape = Plane{{0, 8e-3, 0}, {0, 1, 0}}}};
  std::vector<ProfileCorner> section{{0, 0, 0}, {5e-3, 0, 2}};
  for (int i = 0; i <= 6; ++i) {
    const double angle = 0.5 * pi * i / 6;
    section.push_back(
        {i == 6 ? 0.0 : 5e-3 * std::cos(angle), 3e-3 + 2e-3 * std::sin(angle), i == 6 ? Body::mirror_patch : 1});
  }
  add_extruded(body, section, {.high_m = 8e-3, .high_patch = 3});
  body.sizing.edge = [](const Vec3d&) { return 2e-3; };
  body.exact_volume_m3 = 4.0 * 8e-3 * (5e-3 * 3e-3 + 0.25 * pi * 5e-3 * 2e-3);
  check_surface(body);
  const TetMesh mesh = mesh_body(body, SweptMesher{});
  require_valid(body, mesh);
  CHECK(mesh.symmetry == Symmetry{true, true});
}

TEST_CASE("Profiles that are none are refused with the corner and what is wrong") {
  Body body;
  body.patches = {{}, {}};
  const auto revolved = [&](const std::vector<ProfileCorner>& p) { add_revolved(body, p); };
  CHECK_THROWS_WITH(revolved({{0, 0, 0}, {1, 0, 0}}), Catch::Contains("2 corners"));
  CHECK_THROWS_WITH(revolved({{0, 0, 0}, {0, 1, 0}, {1, 1, 0}, {1, 0, 0}}), Catch::Contains("counter-clockwise"));
  CHECK_THROWS_WITH(revolved({{0, 0, 0}, {1, 0, 2}, {1, 1, 0}, {0, 1, 0}}), Catch::Contains("corner 1 names patch 2"));
  CHECK_THROWS_WITH(revolved({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0.5, 1, 0}}), Catch::Contains("off the axis"));
  CHECK_THROWS_WITH(revolved({{-1, 0, 0}, {1, 0, 0}, {1, 1, 0}}), Catch::Contains("from the axis"));
  CHECK_THROWS_WITH(revolved({{0, 0, 0}, {std::nan(""), 0, 0}, {1, 1, 0}}), Catch::Contains("not finite"));
  CHECK_THROWS_WITH(revolved({{1, 0, 0}, {2, 0}, {2, 1, 0}}), Catch::Contains("names no patch"));
  CHECK_THROWS_WITH(add_extruded(body, {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {.low_m = 1.0, .high_m = 1.0}),
      Catch::Contains("longer than 0 mm"));
  CHECK_THROWS_AS(arc_profile({}, 1.0, 0.0, 1.0, 0), InvalidArgument);
  CHECK(body.facets.empty());
}
