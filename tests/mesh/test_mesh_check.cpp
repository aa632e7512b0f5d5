#include "catch.hpp"
#include "lumo/mesh/body_check.hpp"
#include "lumo/mesh/size_field.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/tetgen.hpp"
#include "mechanics/bodies.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

using namespace lumo;

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

struct Fault {
  const char* what;
  std::function<void(Body&, TetMesh&)> damage;
  MeshError::Reason reason;
  const char* said;
};

using Reason = MeshError::Reason;

std::vector<Fault> faults_of_numbers() {
  return {
      {"node beyond the last", [](Body&, TetMesh& m) { m.tets[7][2] = int(m.nodes.size()); }, Reason::bad_index,
          "element 7 names node"},
      {"negative node", [](Body&, TetMesh& m) { m.tets[7][9] = -3; }, Reason::bad_index, "element 7 names node -3"},
      {"face's node beyond", [](Body&, TetMesh& m) { m.faces[3].nodes[5] = 1 << 30; }, Reason::bad_index, "face 3"},
      {"face's negative node", [](Body&, TetMesh& m) { m.faces[3].nodes[0] = -1; }, Reason::bad_index, "face 3"},
      {"patch beyond", [](Body&, TetMesh& m) { m.faces[3].patch = 1000; }, Reason::bad_index,
          "face 3 is of patch 1000"},
      {"negative patch", [](Body&, TetMesh& m) { m.faces[3].patch = -1; }, Reason::bad_index, "face 3 is of patch -1"},
      {"short mirror list", [](Body&, TetMesh& m) { m.mirror_x.resize(3); }, Reason::bad_index, "has 3 mirror images"},
      {"no mirror list", [](Body&, TetMesh& m) { m.mirror_y.clear(); }, Reason::bad_index, "y = 0"},
      {"mirror image beyond", [](Body&, TetMesh& m) { m.mirror_x[5] = -7; }, Reason::bad_index, "node 5 has mirror"},
      {"wrong mirror image", [](Body&, TetMesh& m) { std::swap(m.mirror_x[0], m.mirror_x[1]); }, Reason::asymmetric,
          "mirror image"},
      {"node moved by an ulp", [](Body&, TetMesh& m) { m.nodes.back().z() = std::nextafter(m.nodes.back().z(), 1.0); },
          Reason::asymmetric, "exact"},
      {"all inside out",
          [](Body&, TetMesh& m) {
            for (auto& t : m.tets) std::swap(t[0], t[1]);
          },
          Reason::inverted, "element 0"},
      {"one inside out", [](Body&, TetMesh& m) { std::swap(m.tets[9][0], m.tets[9][1]); }, Reason::inverted,
          "element 9"},
      {"one NaN", [](Body&, TetMesh& m) { m.nodes[11].y() = none; }, Reason::not_finite, "node 11"},
      {"one infinite", [](Body&, TetMesh& m) { m.nodes[0].x() = 1.0 / 0.0; }, Reason::not_finite, "node 0"},
      {"third order", [](Body&, TetMesh& m) { m.order = 3; }, Reason::bad_index, "order is 3"},
      {"linear with middle nodes", [](Body&, TetMesh& m) { m.order = 1; }, Reason::bad_index, "in a linear mesh"},
      {"a node of nothing",
          [](Body&, TetMesh& m) {
            m.nodes.emplace_back(0, 0, 0);
            m.mirror_x.push_back(int(m.nodes.size()) - 1);
            m.mirror_y.push_back(int(m.nodes.size()) - 1);
          },
          Reason::bad_index, "belongs to no element"},
  };
}

std::vector<Fault> faults_of_sides() {
  return {
      {"no elements", [](Body&, TetMesh& m) { m.tets.clear(); }, Reason::degenerate, "no elements"},
      {"a face is missing", [](Body&, TetMesh& m) { m.faces.pop_back(); }, Reason::open, "boundary face"},
      {"a face twice", [](Body&, TetMesh& m) { m.faces.push_back(m.faces[2]); }, Reason::not_manifold, "face"},
      {"a face inside out",
          [](Body&, TetMesh& m) {
            auto& n = m.faces[4].nodes;
            n = {n[1], n[0], n[2], n[3], n[5], n[4]};
          },
          Reason::not_manifold, "face 4"},
      {"a face inside the body",
          [](Body&, TetMesh& m) {
            for (std::size_t e = 0; e < m.tets.size(); ++e) {
              const auto& t = m.tets[e];
              Vec3d middle = Vec3d::Zero();
              for (std::size_t k = 0; k < 4; ++k) middle += 0.25 * m.nodes[std::size_t(t[k])];
              if (middle.norm() > 2e-3) continue;
              m.faces.push_back({{t[0], t[2], t[1], t[6], t[5], t[4]}, 0});
              m.faces.push_back({{t[0], t[1], t[2], t[4], t[5], t[6]}, 0});
              return;
            }
          },
          Reason::not_manifold, "share one side"},
      {"another middle node", [](Body&, TetMesh& m) { std::swap(m.faces[0].nodes[3], m.faces[0].nodes[4]); },
          Reason::open, "middle nodes"},
      {"an element is missing", [](Body&, TetMesh& m) { m.tets.pop_back(); }, Reason::bad_index, ""},
  };
}

std::vector<Fault> faults_of_carriers() {
  return {
      {"NaN in a carrier box",
          [](Body& b, TetMesh&) {
            b.carrier = {RigidBox{Vec3d(0, 0, none), Vec3d(1, 1, 1)}};
          },
          Reason::not_finite, "carrier box 0"},
      {"NaN in a carrier's rounding",
          [](Body& b, TetMesh&) {
            b.carrier = {RigidBox{}, RigidBox{Vec3d(0, 0, 0), Vec3d(1, 1, 1), none}};
          },
          Reason::not_finite, "carrier box 1"},
      {"a box of no height",
          [](Body& b, TetMesh&) {
            b.carrier = {RigidBox{Vec3d(0, 0, 0), Vec3d(1, 1, 0)}};
          },
          Reason::degenerate, "half edge"},
      {"a box rounded beyond its half",
          [](Body& b, TetMesh&) {
            b.carrier = {RigidBox{Vec3d(0, 0, 0), Vec3d(1, 1, 1), 1.5}};
          },
          Reason::degenerate, "rounded"},
  };
}

}  // namespace

TEST_CASE("a damaged mesh is refused with what and where, and a sound one is not") {
  const auto [body, mesh] = test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(3), test::even(3), test::even(2));
  REQUIRE_NOTHROW(require_valid(body, mesh));
  for (const auto& faults : {faults_of_numbers(), faults_of_sides(), faults_of_carriers()})
    for (const Fault& fault : faults) {
      INFO(fault.what);
      Body b = body;
      TetMesh m = mesh;
      fault.damage(b, m);
      try {
        require_valid(b, m);
        FAIL_CHECK("taken");
      } catch (const MeshError& e) {
        INFO(e.what());
        if (*fault.said) CHECK(e.reason() == fault.reason);
        CHECK(std::string(e.what()).find(fault.said) != std::string::npos);
      }
    }
}

TEST_CASE("elements that do not come in mirror images are refused") {
  auto [body, mesh] = test::symmetric_block(Vec3d(6e-3, 6e-3, 4e-3), test::even(1), test::even(1), test::even(1), 1);
  REQUIRE_NOTHROW(require_valid(body, mesh));
  // A whole block that was not mirrored: its elements cross the plane, though its nodes lie in mirror images.
  TetMesh crossing = test::block_mesh(Vec3d(2, 1, 1), test::even(1), test::even(1), test::even(1), 1, false);
  for (Vec3d& x : crossing.nodes) x.x() -= 1.0;
  crossing.symmetry.x = true;
  for (std::size_t k = 0; k < crossing.nodes.size(); ++k)
    for (std::size_t i = 0; i < crossing.nodes.size(); ++i)
      if (crossing.nodes[i] == Vec3d(-crossing.nodes[k].x(), crossing.nodes[k].y(), crossing.nodes[k].z()))
        crossing.mirror_x.push_back(int(i));
  CHECK_THROWS_WITH(require_valid(crossing), Catch::Contains("crosses its plane of symmetry, x = 0"));
}

TEST_CASE("nodes of a patch lie on its shape, on curved ones and to single precision, or it is named") {
  for (const int order : {1, 2}) {
    Body body = finger(plain_baseline(), dragon_skin(), plain_finger());
    TetMesh mesh = mesh_body(body, TetgenMesher{}, order);
    CHECK_NOTHROW(require_on_shapes(body, mesh));
    for (Vec3d& x : mesh.nodes)
      for (int a = 0; a < 3; ++a) x[a] = double(float(x[a]));
    CHECK_NOTHROW(require_on_shapes(body, mesh));
    const auto dome =
        std::find_if(body.patches.begin(), body.patches.end(), [](const Patch& p) { return p.name == "dome"; });
    REQUIRE(dome != body.patches.end());
    const Shape exact = dome->shape;
    for (const Shape& wrong : {Shape(Plane{}), Shape(SphereShape{}), Shape(Plane{Vec3d(none, 0, 0), Vec3d(0, 0, 1)})}) {
      dome->shape = wrong;
      CHECK_THROWS_WITH(require_on_shapes(body, mesh), Catch::Contains("patch \"dome\"") && Catch::Contains("mm off"));
      CHECK_THROWS_WITH(mesh_body(body, TetgenMesher{}, order), Catch::Contains("patch \"dome\""));
    }
    // A dome that is 5 micrometres too high, and a node a micrometre off.
    EllipticCylinder high = std::get<EllipticCylinder>(exact);
    high.center.z() += 5e-6;
    dome->shape = high;
    CHECK_THROWS_AS(require_on_shapes(body, mesh), MeshError);
    dome->shape = exact;
    mesh.nodes[std::size_t(mesh.faces.back().nodes[0])] += Vec3d(1e-6, 1e-6, 1e-6);
    CHECK_THROWS_AS(require_on_shapes(body, mesh), MeshError);
  }
  Body broken = test::block_to_mesh(Vec3d(6e-3, 6e-3, 4e-3), 1e-3, 0.3, 4e-3);
  broken.facets[1].patch = 9;
  CHECK_THROWS_WITH(mesh_body(broken, TetgenMesher{}), Catch::Contains("facet 1 is of patch 9"));
  broken.facets[1] = {{4, 5, 77, 6}, 1};
  CHECK_THROWS_WITH(mesh_body(broken, TetgenMesher{}), Catch::Contains("facet 1 names vertex 77"));
}

TEST_CASE("a body that wants no lengths of edges is meshed by the focus alone") {
  Body body = test::block_to_mesh(Vec3d(6e-3, 6e-3, 4e-3), 1e-3, 0.3, 4e-3);
  body.sizing.edge = nullptr;
  const auto size = [&](const std::vector<Vec3d>& touches) {
    return mesh_body(focused(body, touches, {0.5e-3, 0.4, 1.0}), TetgenMesher{}).tets.size();
  };
  CHECK(size({}) > 0);
  CHECK(size({{0, 0, 4e-3}}) > 4 * size({}));
  CHECK_THROWS_AS(focused(body, {{0, 0, 4e-3}}, {none}), InvalidArgument);
  CHECK_THROWS_AS(focused(body, {{0, 0, 4e-3}}, {0.5e-3, 0.4, none}), InvalidArgument);
}
