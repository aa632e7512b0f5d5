#include "lumo/geometry/surface_file.hpp"

#include "catch.hpp"
#include "geometry/surfaces.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <random>
#include <sstream>
#include <string>
#include <vector>

using namespace lumo;

namespace {

using Corners = std::array<Vec3d, 3>;

/// What a file has: triangles with corners of their own, in mm.
std::vector<Corners> triangle_soup(const MeshInput& input, const Vec3d& offset_mm = Vec3d::Zero()) {
  std::vector<Corners> soup;
  for (const SurfaceTriangle& t : check_facets(input, 1e-9)) {
    Corners c;
    for (std::size_t k = 0; k < 3; ++k) c[k] = input.vertices[std::size_t(t.corners[k])] + offset_mm;
    soup.push_back(c);
  }
  return soup;
}

std::string binary_file(const std::vector<Corners>& soup) {
  std::string out(80, ' ');
  const auto word = [&](std::uint32_t v) {
    for (int k = 0; k < 4; ++k) out.push_back(char(v >> (8 * k) & 255));
  };
  word(std::uint32_t(soup.size()));
  for (const Corners& t : soup) {
    for (int k = 0; k < 3; ++k) word(0);
    for (const Vec3d& p : t)
      for (int a = 0; a < 3; ++a) word(std::bit_cast<std::uint32_t>(float(p[a])));
    out += std::string(2, '\0');
  }
  return out;
}

std::string solid_text(const std::string& name, const std::vector<Corners>& soup, int digits) {
  std::ostringstream out;
  out.precision(digits);
  out << "solid " << name << '\n';
  for (const Corners& t : soup) {
    out << " facet normal 0 0 0\n  outer loop\n";
    for (const Vec3d& p : t) out << "   vertex " << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
    out << "  endloop\n endfacet\n";
  }
  out << "endsolid " << name << '\n';
  return out.str();
}

SurfaceFromFile from_stl(const std::string& bytes) { return parse_surface(".stl", bytes, "x.stl", 1e-3); }
double volume_mm3(const TriangleSurface& s) { return 1e9 * validate_surface(s).volume; }

std::string refusal(const std::string& kind, const std::string& bytes) {
  try {
    parse_surface(kind, bytes, "x" + kind, 1e-3);
  } catch (const MeshError& error) {
    return error.what();
  }
  return "";
}

/// Corners on their own, shifted by up to `most` steps of float32 at the largest coordinate.
void shake(std::vector<Corners>& soup, int most, std::mt19937_64& random) {
  double largest = 0.0;
  for (const Corners& t : soup)
    for (const Vec3d& p : t) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  const double step = std::ldexp(1.0, std::ilogb(largest) - 23);
  std::uniform_int_distribution<int> steps(-most, most);
  for (Corners& t : soup)
    for (Vec3d& p : t)
      for (int a = 0; a < 3; ++a) p[a] = double(float(p[a])) + steps(random) * step;
}

MeshInput some_solid(int kind, std::mt19937_64& random) {
  MeshInput input = kind % 4 == 0   ? surfaces::box(Vec3d(0, 0, 0), Vec3d(1, 2, 3))
                    : kind % 4 == 1 ? surfaces::l_prism()
                    : kind % 4 == 2 ? surfaces::notched_finger(6)
                                    : surfaces::sphere(2);
  surfaces::turn(input, random);
  for (Vec3d& v : input.vertices) v *= 5.0;
  return input;
}

const Vec3d cube_low(-5, -5, -5), cube_high(5, 5, 5);

}  // namespace

TEST_CASE("a corner one float32 beside its twins is joined, and that is reported", "[surface]") {
  for (const double offset : {0.0, 1000.0}) {  // mm; at 1 m a step is 61 nm
    auto soup = triangle_soup(surfaces::box(cube_low, cube_high), Vec3d(offset, 0, 0));
    const SurfaceFromFile good = from_stl(binary_file(soup));
    CHECK_FALSE(good.mended.any());
    CHECK(mending_text(good.mended).empty());
    for (const float beyond : {-2000.0F, 2000.0F}) {
      auto one_off = soup;
      const float x = float(one_off[0][0].x());
      one_off[0][0].x() = double(std::nextafter(x, beyond));
      const SurfaceFromFile s = from_stl(binary_file(one_off));
      CHECK(s.vertices.size() == 8);
      CHECK(s.triangles.size() == 12);
      CHECK(volume_mm3(s) == Approx(1000.0).epsilon(1e-4 * (offset + 5) / 1000));
      CHECK(s.mended.joined == 1);
      CHECK(s.mended.farthest_m == Approx(1e-3 * std::abs(one_off[0][0].x() - double(x))));
      CHECK_THAT(mending_text(s.mended), Catch::StartsWith("surface mended: 1 corner joined to twins at most "));
    }
  }
}

TEST_CASE("all solids of a text .stl are read, as from the other formats", "[surface]") {
  const auto left = triangle_soup(surfaces::box(Vec3d(-4, -2, -5), Vec3d(-2, 2, 5))),
             right = triangle_soup(surfaces::box(Vec3d(2, -2, -5), Vec3d(4, 2, 5))),
             ball = triangle_soup(surfaces::sphere(2), Vec3d(0, 0, 20));
  auto both = left;
  both.insert(both.end(), right.begin(), right.end());
  const SurfaceFromFile binary = from_stl(binary_file(both)),
                        text = from_stl(solid_text("left", left, 6) + solid_text("", right, 6));
  CHECK(volume_mm3(binary) == Approx(160.0).epsilon(1e-6));
  CHECK(text.vertices == binary.vertices);
  CHECK(text.triangles == binary.triangles);
  const double of_ball = volume_mm3(from_stl(binary_file(ball)));
  CHECK(of_ball == Approx(4.19).epsilon(0.05));
  const SurfaceFromFile three =
      from_stl(solid_text("a\\", left, 6) + "\n\n" + solid_text("b", right, 9) + solid_text("c", ball, 9));
  CHECK(volume_mm3(three) == Approx(160.0 + of_ball).epsilon(1e-6));
  CHECK_THROWS_WITH(
      from_stl(solid_text("a", left, 6) + "facet normal 0 0 1\n"), Catch::Contains("'solid' was expected"));
}

TEST_CASE("an .obj may continue its lines and have lines, points, groups and vertices beside its facets", "[surface]") {
  const std::string cube =
      "mtllib a.mtl\ng top \\\n bottom\nv 99 99 99\nv 0 0 0\nv 1 0 \\\r\n0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\n"
      "v 1 1 1\nv 0 1 1\nl 1 2 3\np 1\nf 2 5 4 \\\n  3\nf 6 7 8 9\nf 2/1 3/2 \\\n7/3 \\\n 6/4\nf -7 -6 -2 -3\n"
      "usemtl m\nf 4 5 9 8\nf 5 5 2 6 9\n";
  const SurfaceFromFile s = parse_surface(".obj", cube, "cube.obj", 1e-3);
  CHECK(s.vertices.size() == 8);
  CHECK(volume_mm3(s) == Approx(1.0));
  CHECK_FALSE(s.mended.any());
  CHECK_THROWS_WITH(parse_surface(".obj", cube + "f 1 \\\n 2 \\\n 17\n", "cube.obj", 1e-3),
      Catch::Contains("line 28: a face names vertex 17 of 9"));
  CHECK_THROWS_WITH(parse_surface(".obj", cube + "v 1 2 \\", "cube.obj", 1e-3), Catch::Contains("3 coordinates"));
}

TEST_CASE("facets without area go, and leave their neighbours closed", "[surface]") {
  // A cube whose top has corners on one of its edges; a facet of no width stands between them and the side.
  for (const int on_edge : {1, 2, 5})
    for (const double off : {0.0, 4e-7, -4e-7})  // mm: a step of float32
      for (const bool left_out : {false, true}) {
        auto soup = triangle_soup(surfaces::box(cube_low, cube_high));
        std::vector<Vec3d> edge{Vec3d(-5, -5, 5)};  // along x, top and front
        for (int k = 1; k <= on_edge; ++k) edge.emplace_back(-5.0 + 10.0 * k / (on_edge + 1), -5.0 + off, 5.0);
        edge.emplace_back(5, -5, 5);
        std::vector<Corners> fan;
        std::erase_if(soup, [&](const Corners& t) {  // the facet of the top at that edge
          const auto is_at = [&](const Vec3d& p) { return std::find(t.begin(), t.end(), p) != t.end(); };
          if (!is_at(edge.front()) || !is_at(edge.back()) || (t[0].z() + t[1].z() + t[2].z()) < 14.0) return false;
          Vec3d apex = t[0];
          for (const Vec3d& p : t)
            if (p != edge.front() && p != edge.back()) apex = p;
          for (std::size_t k = 0; k + 1 < edge.size(); ++k) fan.push_back({edge[k], edge[k + 1], apex});
          for (std::size_t k = 0; k + 2 < edge.size() && !left_out; ++k)
            fan.push_back({edge[k + 1], edge[k], edge.back()});
          return true;
        });
        REQUIRE(soup.size() == 11);
        soup.insert(soup.end(), fan.begin(), fan.end());
        INFO(on_edge << " corners on the edge, " << off << " mm off, facets left out " << left_out);
        const SurfaceFromFile s = from_stl(binary_file(soup));
        CHECK(volume_mm3(s) == Approx(1000.0).epsilon(1e-6));
        CHECK(s.triangles.size() == 12 + 2 * std::size_t(on_edge));
        CHECK(s.mended.dropped == (left_out ? 0 : on_edge));
        CHECK(s.mended.split == (left_out ? on_edge : 0));
      }
  // Twins of a corner in one facet, and a corner that is two: 1e-8 mm apart, in a text of many digits.
  auto soup = triangle_soup(surfaces::box(cube_low, cube_high));
  soup.push_back({cube_low, cube_low, cube_high});
  CHECK(from_stl(binary_file(soup)).mended.dropped == 1);
  const std::string needle =
      "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nv 0 0 10.00000001\n"
      "f 1 3 2\nf 1 2 5\nf 2 4 5\nf 2 3 4\nf 3 5 4\nf 3 1 5\n";
  const SurfaceFromFile tip = parse_surface(".obj", needle, "tip.obj", 1e-3);
  CHECK(tip.mended.dropped == 2);
  CHECK(tip.triangles.size() == 4);
  CHECK(volume_mm3(tip) == Approx(1000.0 / 6.0));
}

TEST_CASE("holes and thin walls are not mended away: an open edge is refused with its place", "[surface]") {
  auto soup = triangle_soup(surfaces::box(cube_low, cube_high));
  const Corners lost = soup.back();
  soup.pop_back();
  const std::string line = refusal(".stl", binary_file(soup));
  CHECK_THAT(line, Catch::Contains("x.stl") && Catch::Contains("has 1 facet, must have 2; 3 such edges"));
  int named = 0;
  for (const Vec3d& p : lost)
    named += line.find(message("(", p.x(), ", ", p.y(), ", ", p.z(), ")")) != std::string::npos;
  CHECK(named == 2);

  auto slit = triangle_soup(surfaces::box(cube_low, cube_high));  // ten steps wide: more than rounding
  slit[0][0].x() += 5e-6;
  CHECK_THAT(refusal(".stl", binary_file(slit)), Catch::Contains("has 1 facet"));

  // A wall of one step, closed and without its rim: its sides stay apart.
  const double thin = 4.76837158203125e-7;
  const MeshInput wall = surfaces::box(Vec3d(-5, -5, 5), Vec3d(5, 5, 5 + thin));
  const SurfaceFromFile read = from_stl(binary_file(triangle_soup(wall)));
  CHECK(read.vertices.size() == 8);
  CHECK(volume_mm3(read) == Approx(100 * thin));
  CHECK_FALSE(read.mended.any());
  // One of two steps, with a corner of the top half way down: it belongs to the top, although the bottom is as near.
  auto two_steps = triangle_soup(surfaces::box(Vec3d(-5, -5, 5), Vec3d(5, 5, 5 + 2 * thin)));
  for (Corners& t : two_steps)
    if (t[0].z() > 5 && t[1].z() > 5 && t[2].z() > 5) {
      t[0].z() -= thin;
      break;
    }
  const SurfaceFromFile joined = from_stl(binary_file(two_steps));
  CHECK(joined.vertices.size() == 8);
  CHECK(joined.mended.joined == 1);
  CHECK(volume_mm3(joined) == Approx(200 * thin).epsilon(0.2));
  auto sheets = triangle_soup(wall);
  std::erase_if(sheets, [](const Corners& t) { return t[0].z() != t[1].z() || t[1].z() != t[2].z(); });
  REQUIRE(sheets.size() == 4);
  CHECK_THAT(refusal(".stl", binary_file(sheets)), Catch::Contains("has 1 facet"));

  // Whole numbers say nothing about precision: a gap of 1 mm in 5 is a hole.
  auto gap = triangle_soup(surfaces::box(cube_low, cube_high));
  gap[0][0].x() += 1.0;
  CHECK_THAT(refusal(".stl", solid_text("gap", gap, 6)), Catch::Contains("has 1 facet"));
}

TEST_CASE("the last printed digit of a text is its precision", "[surface]") {
  auto soup = triangle_soup(surfaces::sphere(2));
  for (Corners& t : soup)
    for (Vec3d& p : t) p *= 12.34;
  auto one_off = soup;
  one_off[0][0].x() += 0.9e-4;
  one_off[7][1].y() -= 0.9e-4;
  const SurfaceFromFile good = from_stl(solid_text("ball", soup, 6)), s = from_stl(solid_text("ball", one_off, 6));
  CHECK_FALSE(good.mended.any());
  CHECK(s.mended.joined == 2);
  CHECK(volume_mm3(s) == Approx(volume_mm3(good)).epsilon(1e-5));
  CHECK_THAT(refusal(".stl", solid_text("ball", one_off, 9)), Catch::Contains("has 1 facet"));
}

TEST_CASE("solids whose corners were rounded one by one are read closed, with their volume", "[surface]") {
  std::mt19937_64 random(11);
  int moved = 0;
  for (int trial = 0; trial < 300; ++trial) {
    MeshInput input = some_solid(trial, random);
    const double volume = validate_surface(input).volume, area = validate_surface(input).area;
    const double offset = trial % 3 == 0 ? 0.0 : trial % 3 == 1 ? 30.0 : 1000.0;
    auto soup = triangle_soup(input, Vec3d(offset, -offset, 0.3 * offset));
    shake(soup, 1, random);
    INFO("trial " << trial << ", " << refusal(".stl", binary_file(soup)));
    const SurfaceFromFile s = from_stl(binary_file(soup));
    moved += s.mended.joined;
    CHECK(s.triangles.size() == soup.size());
    CHECK(std::abs(volume_mm3(s) - volume) < 1e-6 * volume + area * 4.8e-7 * (offset + 15.0));
    CHECK(s.mended.farthest_m < 1e-3 * 2 * 4.8e-7 * (offset + 15.0) * std::sqrt(3.0));
  }
  CHECK(moved > 3000);
}

TEST_CASE("solids of which a facet is missing are refused, rounded or not", "[surface]") {
  std::mt19937_64 random(12);
  for (int trial = 0; trial < 100; ++trial) {
    auto soup = triangle_soup(some_solid(trial, random), Vec3d::Constant(trial % 2 == 0 ? 0.0 : 100.0));
    if (trial % 3 > 0) shake(soup, 1, random);
    soup.erase(soup.begin() + std::ptrdiff_t(random() % soup.size()));
    INFO("trial " << trial);
    CHECK_THAT(refusal(".stl", binary_file(soup)),
        Catch::Contains("the edge from (") && Catch::Contains("has 1 facet, must have 2; 3 such edges"));
  }
}

TEST_CASE("edges that each of their two facets cuts by itself are closed, the slivers between them there or not",
    "[surface]") {
  std::mt19937_64 random(13);
  std::uniform_real_distribution<double> along(0.1, 0.9);
  int split = 0, dropped = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const MeshInput input = some_solid(trial, random);
    const double volume = validate_surface(input).volume, area = validate_surface(input).area;
    auto soup = triangle_soup(input);
    for (int cut = 0; cut < 6; ++cut) {
      const std::size_t t = random() % soup.size(), side = random() % 3;
      const Vec3d a = soup[t][side], b = soup[t][(side + 1) % 3], c = soup[t][(side + 2) % 3];
      if ((b - a).cross(c - a).norm() < 1e-3) continue;  // of a sliver that is there already
      const Vec3d m = a + along(random) * (b - a);
      soup[t] = {a, m, c};
      soup.push_back({m, b, c});
      if (trial % 2 == 0) soup.push_back({b, m, a});
    }
    INFO("trial " << trial << ", " << refusal(".stl", binary_file(soup)));
    const SurfaceFromFile s = from_stl(binary_file(soup));
    split += s.mended.split;
    dropped += s.mended.dropped;
    CHECK(std::abs(volume_mm3(s) - volume) < area * 1e-5);
  }
  CHECK(split > 300);
  CHECK(dropped > 300);
}
