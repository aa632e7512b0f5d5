#include "kernel.hpp"

#include "geometry/surfaces.hpp"

#include "lumo/geometry/predicates.hpp"
#include "lumo/geometry/signed_distance.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/swept_mesher.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/tetgen.hpp"

using namespace lumo;
using namespace lumo::micro;

namespace {

/// A body's quarter as meshers get it, in mm. The body must outlive it.
MeshInput quarter_of(const Body& body) {
  MeshInput input;
  input.facets = body.facets;
  for (const Vec3d& v : body.vertices) input.vertices.push_back(1e3 * v);
  input.edge = [&body](const Vec3d& p) { return 1e3 * body.sizing.edge(1e-3 * p); };
  return input;
}

/// Gives out what was filled before: what is left of mesh_body's work without the mesher.
struct FilledBefore {
  const LinearTets* tets;
  LinearTets fill(const MeshInput&) const { return *tets; }
};

TriangleSurface ball(int level, double radius) {
  const MeshInput input = surfaces::sphere(level, radius);
  TriangleSurface s{input.vertices, {}};
  for (const Facet& f : input.facets) s.triangles.push_back({f.loop[0], f.loop[1], f.loop[2]});
  return s;
}

}  // namespace

TEST_CASE("mesh: filling a quarter of the pad", "[mesh]") {
  const TetgenMesher tetgen;  // first of all: it forks a helper
  const Body body = finger({.h_fp = 5.0, .h_ep = 10.0, .w_s = 10.0, .h_s = 6.0, .w_v = 3.0}, dragon_skin(),
      plain_finger({.contact_edge = 3.0_mm, .growth = 0.5}));
  const MeshInput quarter = quarter_of(body);
  const LinearTets swept = SweptMesher{}.fill(quarter), free = tetgen.fill(quarter);
  REQUIRE(swept.tets.size() > 500);
  REQUIRE(free.tets.size() > 500);
  const std::string input = message("1 quarter of the pad, ", body.facets.size(), " facets");
  BENCHMARK(named("fill with tetrahedra", input, message("SweptMesher, ", swept.tets.size(), " tetrahedra"))) {
    return SweptMesher{}.fill(quarter);
  };
  BENCHMARK(named("fill with tetrahedra", input, message("TetGen in its process, ", free.tets.size(), " tetrahedra"))) {
    return tetgen.fill(quarter);
  };
  const FilledBefore filled{&swept};
  const TetMesh whole = mesh_body(body, filled);
  BENCHMARK(named("middle nodes, mirror images, validity", message(whole.tets.size(), " quadratic tetrahedra"))) {
    return mesh_body(body, filled);
  };
  BENCHMARK(named("quality of a mesh", message(whole.tets.size(), " quadratic tetrahedra"))) {
    return measure(whole).min_jacobian_ratio;
  };
}

TEST_CASE("mesh: checks of a surface", "[mesh]") {
  const MeshInput sphere = surfaces::sphere(4);
  const double gap = 1e-8;
  const std::vector<SurfaceTriangle> triangles = check_facets(sphere, gap);
  const std::string input = message(triangles.size(), " triangles");
  REQUIRE(validate_surface(sphere).volume > 4.1);
  REQUIRE(!SelfIntersection(sphere.vertices, triangles, gap).find());
  BENCHMARK(named("surface check, whole", input)) { return validate_surface(sphere); };
  BENCHMARK(named("self-intersection", input)) { return SelfIntersection(sphere.vertices, triangles, gap).find(); };

  const std::vector<Vec3d> p = points_in(Vec3d::Constant(-1.0), Vec3d::Constant(1.0), 1024, 3);
  std::vector<Vec3d> flat = p;  // all in one plane, where rounded numbers decide nothing
  for (Vec3d& v : flat) v.z() = v.x() + v.y();
  const auto signs = [](const std::vector<Vec3d>& at) {
    int sum = 0;
    for (std::size_t i = 0; i + 3 < at.size(); i += 4) sum += orient3d(at[i], at[i + 1], at[i + 2], at[i + 3]);
    return sum;
  };
  BENCHMARK(named("orientation of four points", "256 tetrahedra", "of volume")) { return signs(p); };
  BENCHMARK(named("orientation of four points", "256 tetrahedra", "nearly flat")) { return signs(flat); };
}

TEST_CASE("mesh: signed distance", "[mesh]") {
  const TriangleSurface sphere = ball(3, 5e-3);
  const SignedDistance exact(sphere);
  const std::vector<Vec3d> p = points_in(Vec3d::Constant(-6e-3), Vec3d::Constant(6e-3), 1024, 5);
  REQUIRE(std::abs(exact.distance(Vec3d(0, 0, 7e-3)) - 2e-3) < 0.1e-3);
  BENCHMARK(named("tree of a surface", message(sphere.triangles.size(), " triangles"))) {
    return SignedDistance(sphere).distance(p.front());
  };
  BENCHMARK(named("signed distance", message("1024 points to ", sphere.triangles.size(), " triangles"))) {
    double sum = 0.0;
    for (const Vec3d& at : p) sum += exact.distance(at);
    return sum;
  };
}

TEST_CASE("mesh: exact shape of the dome", "[mesh]") {
  const EllipticCylinder dome{{0, 0, 5e-3}, 10e-3, 8e-3};
  std::vector<Vec3d> near = points_in(Vec3d(-9e-3, -25e-3, 6e-3), Vec3d(9e-3, 25e-3, 12e-3), 1024, 7);
  BENCHMARK(named("closest point of an ellipse", "1024 points", "anywhere")) {
    double sum = 0.0;
    for (const Vec3d& at : near) sum += dome.closest_point(at).sum();
    return sum;
  };
  std::vector<Vec3d> on = near;
  for (Vec3d& at : on) at = dome.closest_point(at) * (1.0 + 1e-6);
  BENCHMARK(named("closest point of an ellipse", "1024 points", "near the ellipse")) {
    double sum = 0.0;
    for (const Vec3d& at : on) sum += dome.closest_point(at).sum();
    return sum;
  };
}
