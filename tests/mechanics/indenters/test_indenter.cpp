#include "catch.hpp"
#include "lumo/geometry/surface_file.hpp"
#include "lumo/mechanics/contact/first_touch.hpp"
#include "lumo/mechanics/indenters/box.hpp"
#include "lumo/mechanics/indenters/capsule.hpp"
#include "lumo/mechanics/indenters/cylinder.hpp"
#include "lumo/mechanics/indenters/mesh_indenter.hpp"
#include "lumo/mechanics/indenters/oriented.hpp"
#include "lumo/morphology/finger.hpp"
#include "mechanics/bodies.hpp"
#include "mechanics/indenters/indenter_laws.hpp"
#include "mechanics/indenters/tool_surfaces.hpp"
#include "temporary_folder.hpp"

#include <cstring>
#include <filesystem>

#include <sys/stat.h>

using namespace lumo;
using lumo::test::brick;

namespace {

/// A ball as a subdivided octahedron with its corners on the sphere.
TriangleSurface ball(double radius, int rounds) {
  TriangleSurface s;
  s.vertices = {Vec3d::UnitX(), -Vec3d::UnitX(), Vec3d::UnitY(), -Vec3d::UnitY(), Vec3d::UnitZ(), -Vec3d::UnitZ()};
  s.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int round = 0; round < rounds; ++round) {
    std::map<std::pair<int, int>, int> middle;
    const auto mid = [&](int a, int b) {
      const auto [it, fresh] = middle.try_emplace(std::minmax(a, b), int(s.vertices.size()));
      if (fresh) s.vertices.push_back((s.vertices[std::size_t(a)] + s.vertices[std::size_t(b)]).normalized());
      return it->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& t : s.triangles) {
      const int a = mid(t[0], t[1]), b = mid(t[1], t[2]), c = mid(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], a, c}, {a, t[1], b}, {c, b, t[2]}, {a, b, c}});
    }
    s.triangles = finer;
  }
  for (Vec3d& v : s.vertices) v *= radius;
  return s;
}

std::string obj_of(const TriangleSurface& s, double unit) {
  std::ostringstream out;
  out.precision(17);
  for (const Vec3d& v : s.vertices) out << "v " << v.x() / unit << ' ' << v.y() / unit << ' ' << v.z() / unit << '\n';
  for (const auto& t : s.triangles) out << "f " << t[0] + 1 << "/1/1 " << t[1] + 1 << "//2 " << t[2] + 1 << '\n';
  return out.str();
}

std::string binary_stl_of(const TriangleSurface& s, double unit) {
  std::string out(80, 'x');
  const auto word = [&](std::uint32_t v) {
    for (int k = 0; k < 4; ++k) out.push_back(char(v >> (8 * k) & 255));
  };
  word(std::uint32_t(s.triangles.size()));
  for (const auto& t : s.triangles) {
    for (int k = 0; k < 3; ++k) word(0);
    for (int n : t)
      for (int a = 0; a < 3; ++a) word(std::bit_cast<std::uint32_t>(float(s.vertices[std::size_t(n)][a] / unit)));
    out += std::string(2, '\0');
  }
  return out;
}

std::string text_stl_of(const TriangleSurface& s, double unit) {
  std::ostringstream out;
  out.precision(17);
  out << "solid thing\n";
  for (const auto& t : s.triangles) {
    out << " facet normal 0 0 0\n  outer loop\n";
    for (int n : t)
      out << "   vertex " << s.vertices[std::size_t(n)].x() / unit << ' ' << s.vertices[std::size_t(n)].y() / unit
          << ' ' << s.vertices[std::size_t(n)].z() / unit << '\n';
    out << "  endloop\n endfacet\n";
  }
  out << "endsolid thing\n";
  return out.str();
}

TetMesh extent_of(const Body& body) {  // only where the patches end matters for a first touch
  TetMesh mesh;
  mesh.order = 1;
  mesh.nodes = body.vertices;
  for (const Facet& f : body.facets)
    if (f.patch >= 0)
      for (std::size_t k = 1; k + 1 < f.loop.size(); ++k)
        mesh.faces.push_back({{f.loop[0], f.loop[k], f.loop[k + 1], -1, -1, -1}, f.patch});
  return mirrored(mirrored(mesh, 0), 1);
}

}  // namespace

TEST_CASE("every tool obeys the laws of an indenter") {
  test::check_distance_laws(Box{{12e-3, 8e-3, 6e-3}, 1e-3}, 12e-3);
  test::check_distance_laws(Box{{12e-3, 8e-3, 6e-3}, 0.0}, 12e-3);
  test::check_distance_laws(Cylinder{10e-3, 8e-3, 1e-3}, 12e-3);
  test::check_distance_laws(Cylinder{10e-3, 8e-3, 0.0}, 12e-3);
  test::check_distance_laws(Capsule{6e-3, 10e-3}, 12e-3);
  test::check_distance_laws(lying_along_x(Capsule{6e-3, 10e-3}), 12e-3);
  const Mat3d turn = Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized()).toRotationMatrix();
  test::check_distance_laws(Oriented{Cylinder{10e-3, 8e-3, 1e-3}, turn}, 12e-3);
}

TEST_CASE("distances of the tools are those to densely sampled surfaces") {
  // Independent of the formulas: the nearest of many points of the surface, found by projecting a sphere of directions.
  const auto check = [](const auto& tool, double size) {
    std::vector<Vec3d> surface;
    for (int i = 0; i < 400; ++i)
      for (int j = 0; j < 800; ++j) {
        const double a = pi * (i + 0.5) / 400, b = 2 * pi * j / 800;
        const Vec3d ray(std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a));
        double low = 0.0, high = 4 * size;  // bisection: the tools are convex and hold the origin
        for (int k = 0; k < 40; ++k) {
          const double t = 0.5 * (low + high);
          (tool.distance(t * ray) < 0.0 ? low : high) = t;
        }
        surface.push_back(low * ray);
      }
    std::mt19937 random(9);
    std::uniform_real_distribution<double> u(-size, size);
    for (int k = 0; k < 20; ++k) {
      const Vec3d p(u(random), u(random), u(random));
      double nearest = 1e9;
      for (const Vec3d& s : surface) nearest = std::min(nearest, (s - p).norm());
      CHECK(std::abs(tool.distance(p)) == Approx(nearest).margin(0.01 * size));
    }
  };
  check(Box{{12e-3, 8e-3, 6e-3}, 1e-3}, 10e-3);
  check(Cylinder{10e-3, 8e-3, 1e-3}, 10e-3);
  check(Capsule{6e-3, 10e-3}, 10e-3);
}

TEST_CASE("a capsule without length is a sphere, and a turned tool is the tool turned") {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> u(-12e-3, 12e-3);
  const auto along_x = lying_along_x(Capsule{6e-3, 10e-3});
  const auto along_y = lying_along_y(Capsule{6e-3, 10e-3});
  for (int k = 0; k < 50; ++k) {
    const Vec3d p(u(random), u(random), u(random));
    CHECK(Capsule{8e-3, 0.0}.distance(p) == Approx(Sphere{8e-3}.distance(p)).margin(1e-15));
    CHECK(along_x.distance(p) == Approx(Capsule{6e-3, 10e-3}.distance(Vec3d(p.y(), p.z(), p.x()))).margin(1e-15));
    CHECK(along_y.distance(p) == Approx(Capsule{6e-3, 10e-3}.distance(Vec3d(p.z(), p.x(), p.y()))).margin(1e-15));
  }
}

TEST_CASE("a ball as a mesh is the sphere up to its facets, with a normal of unit length, near and far") {
  const double R = 5e-3;
  const TriangleSurface surface = ball(R, 5);
  const MeshIndenter tool(surface);
  double sag = 0.0;  // the facets lie inside the sphere by this much
  for (const auto& t : surface.triangles) {
    const Vec3d middle = (surface.vertices[std::size_t(t[0])] + surface.vertices[std::size_t(t[1])] +
                             surface.vertices[std::size_t(t[2])]) /
                         3.0;
    sag = std::max(sag, R - middle.norm());
  }
  CHECK(sag < 5e-6);  // 1 − cos of half the angle across the largest facet, 5.03°: 4.8 µm
  CHECK(tool.radius_m() == Approx(R));
  std::mt19937 random(8);
  std::normal_distribution<double> n;
  for (int k = 0; k < 60; ++k) {
    const Vec3d u = Vec3d(n(random), n(random), n(random)).normalized();
    for (const double gap : {-0.1e-3, -1e-6, 0.0, 0.3e-3, 1e-3, 2e-3, 50e-3}) {
      const DistanceSample d = tool.sample((R + gap) * u);
      CHECK(d.distance >= gap - 1e-15);  // facets lie inside the sphere
      CHECK(d.distance <= gap + sag);
      CHECK(d.gradient.norm() == Approx(1.0).margin(1e-12));
      CHECK((d.gradient - u).norm() < 0.05);  // half the angle between facets
    }
  }
}

TEST_CASE("a mesh tool is exact at thin walls, at sharp tips and at small parts of long tools") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  // A blade of 0.3 mm, 120 mm long: as the box with sharp edges, whatever the point.
  const MeshIndenter blade(brick({0.15e-3, 2e-3, 60e-3}));
  const Box box{{0.3e-3, 4e-3, 120e-3}, 0.0};
  for (int k = 0; k < 2000; ++k) {
    const double near = k % 2 == 0 ? 1.0 : 0.02;
    const Vec3d p(0.15e-3 + near * 2e-3 * u(random), 2.2e-3 * u(random), -60e-3 + near * 2e-3 * u(random));
    CHECK(blade.distance(p) == Approx(box.distance(p)).margin(1e-16));
  }
  CHECK(blade.distance(Vec3d::Zero()) == Approx(-0.15e-3));
  test::check_distance_laws(MeshIndenter(brick({6e-3, 4e-3, 3e-3})), 12e-3);

  // A cone of 20° with 400 sides on a rod of 100 mm. Ahead of the tip all is as far as the tip; beside it the flank is.
  const double half = 10 * pi / 180, length = 5e-3, rim = length * std::tan(half);
  const MeshIndenter cone(test::turned_solid({{rim, length}, {rim, 100e-3}}, 0.0, 100e-3, 400));
  for (int k = 0; k < 500; ++k) {
    const double turn = pi * u(random), away = 1e-3 * std::abs(u(random)) + 1e-6, off = half * u(random);
    const Vec3d ahead = away * Vec3d(std::sin(off) * std::cos(turn), std::sin(off) * std::sin(turn), -std::cos(off));
    CHECK(cone.distance(ahead) == Approx(away).epsilon(1e-12));
    const double z = 2e-3 * std::abs(u(random)) + 0.4e-3, gap = 0.5 * std::sin(half) * z * u(random),
                 r = z * std::tan(half);
    const Vec3d radial(std::cos(turn), std::sin(turn), 0.0);
    const Vec3d beside =
        r * radial + z * Vec3d::UnitZ() + gap * (std::cos(half) * radial - std::sin(half) * Vec3d::UnitZ());
    CHECK(cone.distance(beside) == Approx(gap).margin(4e-5 * r));  // sag of the sides: 1 − cos(π/400)
  }

  // A ball of 4 mm, whose shaft is 10 or 120 mm long: at the ball they are one tool.
  const MeshIndenter small(test::probe(10e-3)), large(test::probe(120e-3));
  for (int k = 0; k < 1000; ++k) {
    const Vec3d p = (2e-3 + 0.1e-3 * u(random)) * Vec3d(u(random), u(random), -1.5).normalized();
    CHECK(large.distance(p) == small.distance(p));
    const double gap = Sphere{4e-3}.distance(p);
    CHECK(large.distance(p) >= gap - 1e-15);
    CHECK(large.distance(p) <= gap + 2.2e-6);  // sag of facets of 3.75°, both ways: R (1 − cos²(1.9°))
  }
}

TEST_CASE("a mesh tool has no distance to a point that is none, and a gradient at its own corners") {
  const MeshIndenter tool(brick(Vec3d::Constant(1e-3)));
  const Vec3d none(std::nan(""), 0.0, 0.0);
  CHECK(std::isnan(tool.distance(none)));
  CHECK(std::isnan(tool.sample(none).distance));
  for (const Vec3d& p : tool.surface().vertices) {
    const DistanceSample d = tool.sample(p);
    CHECK(d.distance == 0.0);
    CHECK((d.gradient - p.normalized()).norm() < 1e-12);
    CHECK(d.hessian.norm() == 0.0);
  }
}

TEST_CASE("signs hold where many thin triangles meet, as the winding number has them") {
  TriangleSurface s;  // a needle's point and a dent: corners at which single face normals mislead
  s.vertices = {{0, 0, 9e-3}, {0, 0, -1e-3}};
  constexpr int sides = 7;
  for (int k = 0; k < sides; ++k)
    s.vertices.emplace_back((k % 2 ? 1e-3 : 4e-3) * std::cos(2 * pi * k / sides),
        (k % 2 ? 1e-3 : 4e-3) * std::sin(2 * pi * k / sides), -3e-3);
  for (int k = 0; k < sides; ++k) {
    s.triangles.push_back({0, 2 + k, 2 + (k + 1) % sides});
    s.triangles.push_back({1, 2 + (k + 1) % sides, 2 + k});
  }
  validate_surface(s);
  const SignedDistance exact(s);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  int inside = 0;
  for (int k = 0; k < 2000; ++k) {
    const Vec3d p(5e-3 * u(random), 5e-3 * u(random), 3e-3 + 7e-3 * u(random));
    const bool solid = winding_number(s, p) > 0.5;
    inside += solid;
    CHECK((exact.sample(p).distance < 0.0) == solid);
  }
  CHECK(inside > 40);
}

TEST_CASE("one surface read twice is one tool") {
  CHECK(MeshIndenter(brick(Vec3d::Constant(1e-3))) == MeshIndenter(brick(Vec3d::Constant(1e-3))));
  CHECK_FALSE(MeshIndenter(brick(Vec3d::Constant(1e-3))) == MeshIndenter(brick(Vec3d(1e-3, 1e-3, 0.9e-3))));
}

TEST_CASE("signs and distances of a brick with a cavity are right everywhere") {
  TriangleSurface s = brick({6e-3, 4e-3, 3e-3});
  const TriangleSurface hole = brick({2e-3, 1.5e-3, 1e-3});
  for (const auto& t : hole.triangles) s.triangles.push_back({t[0] + 8, t[2] + 8, t[1] + 8});
  s.vertices.insert(s.vertices.end(), hole.vertices.begin(), hole.vertices.end());
  const SignedDistance exact(s);
  const TriangleTree tree(s);
  std::mt19937 random(8);
  std::uniform_real_distribution<double> u(-7e-3, 7e-3);
  for (int k = 0; k < 400; ++k) {
    const Vec3d p(u(random), u(random), u(random));
    const auto inside = [&](const Vec3d& half) { return (p.cwiseAbs().array() < half.array()).all(); };
    const bool solid = inside({6e-3, 4e-3, 3e-3}) && !inside({2e-3, 1.5e-3, 1e-3});
    double brute = 1e9;
    for (const auto& t : s.triangles)
      brute = std::min(brute, (closest_on_triangle(p, s.vertices[std::size_t(t[0])], s.vertices[std::size_t(t[1])],
                                   s.vertices[std::size_t(t[2])]) -
                                  p)
                                  .norm());
    CHECK(tree.distance(p) == Approx(brute).margin(1e-15));
    CHECK(winding_number(s, p) == Approx(solid ? 1.0 : 0.0).margin(1e-9));
    CHECK(exact.distance(p) == Approx(solid ? -brute : brute).margin(1e-15));
  }
}

TEST_CASE("surfaces read from files are those that were written, in any of three formats") {
  const TemporaryFolder folder;
  const TriangleSurface s = brick({6e-3, 4e-3, 3e-3});
  for (const auto& path : {folder.write("a.obj", obj_of(s, 1e-3)), folder.write("b.stl", binary_stl_of(s, 1e-3)),
           folder.write("c.stl", text_stl_of(s, 1e-3))}) {
    const TriangleSurface back = read_surface(path);
    CHECK(back.vertices.size() == 8);
    CHECK(back.triangles.size() == 12);
    CHECK(validate_surface(back).volume == Approx(12e-3 * 8e-3 * 6e-3).epsilon(1e-6));
  }
  CHECK(validate_surface(read_surface(folder.write("d.obj", obj_of(s, 25.4e-3)), 25.4e-3)).volume ==
        Approx(12e-3 * 8e-3 * 6e-3));
  const auto quads = folder.write("q.obj",
      "# a cube\no cube\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
      "f -8 -5 -6 -7\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\r\nf 4 1 5 8");
  CHECK(validate_surface(read_surface(quads)).volume == Approx(1e-9));
  CHECK(read_surface(folder.write("CAD.STL", binary_stl_of(s, 1e-3))).triangles.size() == 12);
  // A prism over an L and one over a star, whose polygons are not convex from any corner that a fan could start at:
  // corner 1 comes first.
  const auto prism = [](const std::vector<std::pair<double, double>>& outline) {
    std::ostringstream out;
    const int n = int(outline.size());
    for (const double z : {0.0, 1.0})
      for (const auto& [x, y] : outline) out << "v " << x << ' ' << y << ' ' << z << '\n';
    out << 'f';
    for (int k = n; k >= 1; --k) out << ' ' << k;
    out << "\nf";
    for (int k = 1; k <= n; ++k) out << ' ' << n + k;
    for (int k = 1; k <= n; ++k) out << "\nf " << k << ' ' << k % n + 1 << ' ' << n + k % n + 1 << ' ' << n + k;
    return out.str() + "\n";
  };
  CHECK(validate_surface(read_surface(folder.write("ell.obj", prism({{3, 0}, {3, 1}, {1, 1}, {1, 3}, {0, 3}, {0, 0}}))))
            .volume == Approx(5e-9));
  const auto star = read_surface(folder.write(
      "star.obj", prism({{2, 0}, {0.5, 0.5}, {0, 2}, {-0.5, 0.5}, {-2, 0}, {-0.5, -0.5}, {0, -2}, {0.5, -0.5}})));
  CHECK(
      validate_surface(star).volume == Approx(4e-9));  // four triangles of base 1 and height 1.5 on a square of side 1
}

TEST_CASE("bad surface files are refused with one line that says where") {
  const TemporaryFolder folder;
  const std::string good = obj_of(brick(Vec3d::Constant(1e-3)), 1e-3);
  const auto refuses = [&](const std::string& name, const std::string& bytes, const std::string& why) {
    const auto path = folder.write(name, bytes);
    CHECK_THROWS_WITH(read_surface(path), Catch::Contains(why));
    try {
      read_surface(path);
    } catch (const Error& e) {
      CHECK(std::string(e.what()).find('\n') == std::string::npos);
    }
  };
  refuses("a.obj", good + "f 1 2 9\n", "names vertex 9 of 8");
  refuses("b.obj", good + "f 1 2 0\n", "names vertex 0 of 8");
  refuses("c.obj", "v 1 2 x\n", "line 1: 'x' is no number");
  refuses("d.obj", "v 1 2\n", "3 coordinates");
  refuses("e.obj", "curv 1 2\n", "'curv' is no statement");
  refuses("f.obj", good.substr(0, good.rfind("f ")), "has 1 facet, must have 2");
  refuses("g.obj", "", "must have some of both");
  refuses("h.obj", "v nan 0 0\n" + good, "not finite");
  refuses("i.obj", good + "f 1 2\n", "at least 3 corners");
  refuses("j.obj", good + "f 99999999999999999999 1 2\n", "is no number");
  refuses("k.stl", "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nendloop\n", "line 5: 'vertex' was expected");
  refuses("l.stl", "solid x\nfacet normal 0 0 1\n", "'outer' was expected");
  refuses("m.stl", std::string(84, '\xff'), "a binary .stl of 4294967295 triangles");
  refuses("n.stl", binary_stl_of(brick(Vec3d::Constant(1e-3)), 1e-3).substr(0, 300), "has 300 bytes");
  refuses("o.stl", "", "has 0 bytes");
  refuses("p.ply", "ply\n", "must end in .obj or .stl");
  TriangleSurface turned = brick(Vec3d::Constant(1e-3));
  for (auto& t : turned.triangles) std::swap(t[1], t[2]);
  refuses("q.obj", obj_of(turned, 1e-3), "inside out");
  refuses("r.obj", "v 0 0 nan\nv 0 0 0\nv 1 0 nan\nv 1 nan 0\nf 1 2 3\n", "not finite");
  refuses("s.obj", "v 0 0 nan\nv 0 0 0\nv 1 0 inf\nv 1 nan 0\nv 0 1 0\nf 1 2 3 4 5\n", "not finite");
  REQUIRE(::mkfifo((folder / "pipe.stl").c_str(), 0600) == 0);
  CHECK_THROWS_AS(read_surface(folder / "pipe.stl"), InputError);  // and does not wait for a writer
  CHECK_THROWS_AS(read_surface(folder / "absent.obj"), InputError);
  std::filesystem::create_directory(folder / "d.stl");
  CHECK_THROWS_AS(read_surface(folder / "d.stl"), InputError);
}

TEST_CASE("first touch of tools with edges is that of a dense sample of the exact profile") {
  const FingerDesign design = plain_baseline();
  const Body body = finger(design, dragon_skin(), plain_finger());
  const TetMesh mesh = extent_of(body);
  const double w = 14.75e-3, fp = 6e-3, ep = 6e-3;
  const auto check = [&](const auto& tool, double margin) {
    for (double angle : {-30.0, 0.0, 20.0})
      for (double y : {0.0, 11e-3}) {
        const Scenario<std::decay_t<decltype(tool)>> s{tool, angle * pi / 180, y};
        const Touch t = first_touch(body, mesh, s);
        const Vec3d dir = s.direction(), far = body.pivot + Vec3d(0, y, 0) - 0.2 * dir;
        double least = 1e9;
        const auto reach = [&](const Vec3d& p) {
          if (const Vec3d e = p - far; (e - e.dot(dir) * dir).norm() > tool.radius_m()) return;
          least = std::min(least, advance_to(tool, far, dir, p, 1.0));
        };
        for (int j = -20; j <= 20; ++j)
          for (int k = 0; k <= 20000; ++k)
            reach({w * std::cos(pi * k / 20000), y + 5e-4 * j, fp + ep * std::sin(pi * k / 20000)});
        INFO("angle " << angle << " y " << y << " sampled " << least << " found " << (t.origin - far).dot(dir));
        CHECK((t.origin - far).dot(dir) <= least + margin);  // a sample cannot be touched earlier
        CHECK((t.origin - far).dot(dir) >= least - 2e-7 - margin);
        CHECK(std::abs(tool.distance(t.point - t.origin)) < 1e-9);
      }
  };
  check(Box{{8e-3, 8e-3, 8e-3}, 0.5e-3}, 1e-8);
  check(Box{{8e-3, 8e-3, 8e-3}, 0.0}, 1e-8);
  check(Cylinder{8e-3, 10e-3, 0.5e-3}, 1e-8);
  check(lying_along_x(Capsule{6e-3, 10e-3}), 1e-8);
  check(lying_along_y(Cylinder{6e-3, 10e-3, 0.5e-3}), 1e-8);
  check(MeshIndenter(ball(4e-3, 3)), 1e-7);
}

TEST_CASE("tools of impossible size are refused in one line") {
  CHECK_THROWS_WITH(validate(Box{{-1e-3, 1e-3, 1e-3}, 0.0}), Catch::Contains("box side") && Catch::Contains("mm"));
  CHECK_THROWS_WITH(validate(Box{{1e-3, 1e-3, 1e-3}, 1e-3}), Catch::Contains("edge radius"));
  CHECK_THROWS_AS(validate(Cylinder{10e-3, std::nan(""), 0.0}), InvalidArgument);
  CHECK_THROWS_AS(validate(Capsule{10e-3, -1e-3}), InvalidArgument);
  CHECK_THROWS_WITH(
      validate(Oriented{Sphere{}, Mat3d(2.0 * Mat3d::Identity())}), Catch::Contains("must be a rotation"));
}
