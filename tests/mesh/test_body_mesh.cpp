#include "catch.hpp"
#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/sector.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/tetgen.hpp"
#include "mesh/finger_laws.hpp"
#include "mesh/random_design.hpp"

#include <random>

using namespace lumo;

TEST_CASE("a finger's mesh lies on the exact profile, is exactly symmetric and has the exact volume") {
  const TetgenMesher mesher;
  for (const FingerDesign& d : {plain_baseline(), FingerDesign{5, 10, 10, 6, 3}, FingerDesign{12, 1, 4, 5, 1}})
    check_finger_mesh(d, mesher, {0.5e-3, 0.2, 1.0}, true);
}

TEST_CASE("edges along y are longer by the stretch that is asked for, and the mesh is as true") {
  const TetgenMesher mesher;
  const auto meshed = [&](double stretch) {
    FingerOptions options = plain_finger();
    options.mesh.stretch_y = stretch;
    const Body body = finger(plain_baseline(), dragon_skin(), options);
    const TetMesh mesh = mesh_body(body, mesher);
    const MeshQuality q = measure(mesh);
    CHECK(q.min_jacobian_ratio > 0.0);
    CHECK(q.volume_m3 == Approx(body.exact_volume_m3).epsilon(2e-3));
    double along = 0.0, across = 0.0;
    for (const auto& t : mesh.tets)
      for (std::size_t k = 1; k < 4; ++k) {
        const Vec3d edge = mesh.nodes[std::size_t(t[k])] - mesh.nodes[std::size_t(t[0])];
        along += std::abs(edge.y());
        across += std::abs(edge.x());
      }
    return std::pair(along / across, mesh.tets.size());
  };
  const auto [even, many] = meshed(1.0);
  const auto [long_in_y, few] = meshed(2.0);
  CHECK(even == Approx(1.0).margin(0.15));
  CHECK(long_in_y == Approx(2.0 * even).epsilon(0.15));
  CHECK(double(few) == Approx(0.5 * double(many)).epsilon(0.25));
}

TEST_CASE("random feasible designs mesh") {
  std::mt19937 random(11);
  const TetgenMesher mesher;
  for (int k = 0; k < 8; ++k) check_finger_mesh(random_design(random), mesher, {0.5e-3, 0.2, 1.0}, false);
}

TEST_CASE("300 random feasible designs mesh", "[long]") {
  std::mt19937 random(12);
  const TetgenMesher mesher;
  for (int k = 0; k < 300; ++k) check_finger_mesh(random_design(random), mesher, {0.5e-3, 0.2, 1.0}, false);
}

TEST_CASE("2000 random designs are valid fingers or typed errors") {
  std::mt19937 random(5);
  const DesignSpace space = finger_space(plain_pad());
  const double odd[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
      -std::numeric_limits<double>::infinity(), 1e308, -1e308, 1e-310, 0.0, -0.0};
  int valid = 0, refused = 0;
  for (int k = 0; k < 2000; ++k) {
    std::array<double, 5> x;
    for (std::size_t i = 0; i < 5; ++i) {
      const Variable& v = space.variables[i];
      const double uniform = std::uniform_real_distribution<double>(v.lower - 1, v.upper + 1)(random);
      const double lattice =
          0.5 * double(std::uniform_int_distribution<int>(int(2 * v.lower), int(2 * v.upper))(random));
      const double corner = random() % 2 ? v.lower : v.upper;
      switch (k % 4) {
        case 0: x[i] = lattice; break;
        case 1: x[i] = uniform; break;
        case 2: x[i] = random() % 2 ? corner : lattice; break;
        default: x[i] = random() % 3 ? lattice : odd[random() % 8];
      }
    }
    try {
      const Body b = finger(FingerDesign::from(x), solaris(), plain_finger());
      CHECK_NOTHROW(validate_surface(ClosedSurface{b.vertices, b.facets}));
      ++valid;
    } catch (const InfeasibleDesign& e) {
      CHECK_FALSE(space.contains(x));
      CHECK(std::string(e.what()).find("infeasible design") == 0);
      ++refused;
    }
  }
  CHECK(valid > 30);
  CHECK(valid + refused == 2000);
}

TEST_CASE("a sector and its mirror images are the whole") {
  const Body body = finger({8, 4, 6, 4, 2}, dragon_skin(), plain_finger());
  const TetMesh mesh = mesh_body(body, TetgenMesher{});
  const double volume = measure(mesh).volume_m3;
  for (Symmetry planes : {Symmetry{true, false}, Symmetry{false, true}, Symmetry{true, true}}) {
    const Sector s = sector_of(mesh, planes);
    CHECK(measure(s.mesh).volume_m3 == Approx(s.fraction() * volume).epsilon(1e-12));
    std::vector<Vec3d> field;
    for (const Vec3d& x : s.mesh.nodes)
      field.emplace_back(x.x() * x.z(), x.y() * x.x() * x.x(), x.z());  // even in x and y as a vector field
    const std::vector<Vec3d> all = unfold(mesh, s, field);
    for (std::size_t k = 0; k < all.size(); ++k) {
      const Vec3d& x = mesh.nodes[k];
      CHECK((all[k] - Vec3d(x.x() * x.z(), x.y() * x.x() * x.x(), x.z())).norm() < 1e-18);
    }
  }
  TetMesh plain = mesh;
  plain.symmetry = {};
  CHECK_THROWS_AS(sector_of(plain, {true, false}), InvalidArgument);
}

TEST_CASE("the Jacobian bound sees an element that is only bent inside out between its corners") {
  TetMesh m;
  m.nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5, 0, 0}, {.5, .5, 0}, {0, .5, 0}, {0, 0, .5}, {.5, 0, .5},
      {0, .5, .5}};
  m.tets = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9}};
  CHECK(measure(m).volume_m3 == Approx(1.0 / 6.0));
  CHECK(measure(m).min_jacobian_ratio == Approx(1.0));
  m.nodes[4] = {0.5, 0.0, 0.45};
  const auto c = jacobian_coefficients(m, m.tets[0]);
  CHECK(*std::min_element(c.begin(), c.end()) < 0.0);
  CHECK_THROWS_AS(require_valid(m), MeshError);
}
