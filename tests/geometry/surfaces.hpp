#pragma once

// Surfaces for the mesh tests: good bodies, and eleven ways in which a surface can be bad.

#include "lumo/mesh/mesher.hpp"

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

namespace surfaces {

using lumo::Facet;
using lumo::MeshInput;
using lumo::Vec3d;

/// One quadrilateral per side, patches 0 … 5 for z low, z high, y low, y high, x low, x high.
inline MeshInput box(const Vec3d& low, const Vec3d& high) {
  MeshInput input;
  for (int i = 0; i < 8; ++i)
    input.vertices.emplace_back((i & 1 ? high : low).x(), (i & 2 ? high : low).y(), (i & 4 ? high : low).z());
  input.facets = {
      {{0, 2, 3, 1}, 0}, {{4, 5, 7, 6}, 1}, {{0, 1, 5, 4}, 2}, {{2, 6, 7, 3}, 3}, {{0, 4, 6, 2}, 4}, {{1, 3, 7, 5}, 5}};
  return input;
}

/// A prism over a polygon given counter-clockwise, from y = 0 to `length`: two polygon ends (patches −1 and 0), sides
/// (patch 1).
inline MeshInput prism(const std::vector<std::array<double, 2>>& outline, double length) {
  MeshInput input;
  const int n = static_cast<int>(outline.size());
  for (const auto& [x, z] : outline) input.vertices.emplace_back(x, 0.0, z);
  for (const auto& [x, z] : outline) input.vertices.emplace_back(x, length, z);
  Facet front, back;
  front.patch = -1;
  back.patch = 0;
  for (int i = 0; i < n; ++i) {
    front.loop.push_back(i);
    back.loop.push_back(2 * n - 1 - i);
    input.facets.push_back({{i, n + i, n + (i + 1) % n, (i + 1) % n}, 1});
  }
  input.facets.push_back(front);
  input.facets.push_back(back);
  return input;
}

inline MeshInput l_prism() { return prism({{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}}, 1.0); }

/// A finger-like section: half disc with a round notch cut into its flat side, about 4 n corners.
inline MeshInput notched_finger(int n) {
  std::vector<std::array<double, 2>> outline;
  for (int i = 0; i <= 2 * n; ++i) {
    const double angle = std::numbers::pi * i / (2 * n);
    outline.push_back({std::cos(angle), std::sin(angle)});
  }
  for (int i = 0; i <= 2 * n; ++i) {
    const double angle = std::numbers::pi * (2 * n - i) / (2 * n);
    outline.push_back({0.4 * std::cos(angle), 0.4 * std::sin(angle)});
  }
  return prism(outline, 3.0);
}

/// A sphere of 20 · 4^level triangles, patch 7.
inline MeshInput sphere(int level, double radius = 1.0, const Vec3d& center = Vec3d::Zero()) {
  const double g = std::numbers::phi;
  std::vector<Vec3d> points{{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0}, {0, -1, g}, {0, 1, g}, {0, -1, -g},
      {0, 1, -g}, {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
  std::vector<std::array<int, 3>> triangles{{0, 11, 5}, {0, 5, 1}, {0, 1, 7}, {0, 7, 10}, {0, 10, 11}, {1, 5, 9},
      {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8}, {3, 9, 4}, {3, 4, 2}, {3, 2, 6}, {3, 6, 8}, {3, 8, 9}, {4, 9, 5},
      {2, 4, 11}, {6, 2, 10}, {8, 6, 7}, {9, 8, 1}};
  for (int step = 0; step < level; ++step) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [entry, fresh] = middles.try_emplace(std::minmax(a, b), static_cast<int>(points.size()));
      if (fresh)
        points.push_back(
            points[static_cast<std::size_t>(a)].normalized() + points[static_cast<std::size_t>(b)].normalized());
      return entry->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& [a, b, c] : triangles) {
      const int ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    triangles = finer;
  }
  MeshInput input;
  for (const Vec3d& p : points) input.vertices.push_back(center + radius * p.normalized());
  for (const auto& [a, b, c] : triangles) input.facets.push_back({{a, b, c}, 7});
  return input;
}

/// A unit block whose top is a bumpy height field of n × n squares, all triangles (patches 0 … 5).
inline MeshInput block(int n, std::mt19937_64& random) {
  MeshInput input;
  std::uniform_real_distribution<double> bump(-0.3 / n, 0.3 / n);
  std::map<std::array<int, 3>, int> numbers;
  const auto vertex = [&](int i, int j, int k) {
    const auto [entry, fresh] = numbers.try_emplace({i, j, k}, static_cast<int>(input.vertices.size()));
    if (fresh) input.vertices.emplace_back(double(i) / n, double(j) / n, double(k) / n + (k == n ? bump(random) : 0.0));
    return entry->second;
  };
  const auto quad = [&](int a, int b, int c, int d, int patch) {
    input.facets.push_back({{a, b, c}, patch});
    input.facets.push_back({{a, c, d}, patch});
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      quad(vertex(i, j, 0), vertex(i, j + 1, 0), vertex(i + 1, j + 1, 0), vertex(i + 1, j, 0), 0);
      quad(vertex(i, j, n), vertex(i + 1, j, n), vertex(i + 1, j + 1, n), vertex(i, j + 1, n), 1);
      quad(vertex(i, 0, j), vertex(i + 1, 0, j), vertex(i + 1, 0, j + 1), vertex(i, 0, j + 1), 2);
      quad(vertex(i, n, j), vertex(i, n, j + 1), vertex(i + 1, n, j + 1), vertex(i + 1, n, j), 3);
      quad(vertex(0, i, j), vertex(0, i, j + 1), vertex(0, i + 1, j + 1), vertex(0, i + 1, j), 4);
      quad(vertex(n, i, j), vertex(n, i + 1, j), vertex(n, i + 1, j + 1), vertex(n, i, j + 1), 5);
    }
  return input;
}

inline void append(MeshInput& input, const MeshInput& other) {
  const int offset = static_cast<int>(input.vertices.size());
  input.vertices.insert(input.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (Facet facet : other.facets) {
    for (int& vertex : facet.loop) vertex += offset;
    input.facets.push_back(facet);
  }
}

inline void turn(MeshInput& input, std::mt19937_64& random) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const Eigen::Quaterniond rotation =
      Eigen::Quaterniond(unit(random), unit(random), unit(random), unit(random)).normalized();
  for (Vec3d& vertex : input.vertices) vertex = rotation * vertex;
}

inline void invert(MeshInput& input) {
  for (Facet& facet : input.facets) facet.loop = std::vector<int>(facet.loop.rbegin(), facet.loop.rend());
}

enum class Fault {
  hole,
  crossing,
  degenerate_facet,
  bad_index,
  nan_vertex,
  infinite_vertex,
  huge_vertex,
  duplicate_vertices,
  touching_sheets,
  soup,
  coplanar,
  inverted,
  empty
};
inline constexpr std::array<std::pair<Fault, const char*>, 13> all_faults{
    {{Fault::hole, "hole"}, {Fault::crossing, "self-intersecting"}, {Fault::degenerate_facet, "degenerate facet"},
        {Fault::bad_index, "index out of range"}, {Fault::nan_vertex, "NaN vertex"},
        {Fault::infinite_vertex, "infinite vertex"}, {Fault::huge_vertex, "1e308 vertex"},
        {Fault::duplicate_vertices, "duplicate vertices"}, {Fault::touching_sheets, "touching sheets"},
        {Fault::soup, "random soup"}, {Fault::coplanar, "all coplanar"}, {Fault::inverted, "inverted"},
        {Fault::empty, "empty"}}};

/// Spoils a good block in one way; the same seed gives the same surface.
class Spoiler {
 public:
  Spoiler(Fault fault, std::uint64_t seed)
      : seed_(seed),
        random_(1000 * static_cast<std::uint64_t>(fault) + seed),
        input_(block(2 + int(seed % 4), random_)) {
    spoil(fault);
  }
  MeshInput input() { return std::move(input_); }

 private:
  std::size_t pick(std::size_t count) { return static_cast<std::size_t>(random_() % count); }
  double unit() { return unit_(random_); }
  Vec3d& any_vertex() { return input_.vertices[pick(input_.vertices.size())]; }
  Facet& any_facet() { return input_.facets[pick(input_.facets.size())]; }
  Vec3d& corner(const Facet& facet, std::size_t k) { return input_.vertices[static_cast<std::size_t>(facet.loop[k])]; }

  void spoil(Fault fault);
  void make_hole();
  void cross();
  void make_degenerate();
  void duplicate();
  void touch();
  void mix();
  void flatten();

  std::uint64_t seed_;
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> unit_{0.0, 1.0};
  MeshInput input_;
};

inline void Spoiler::spoil(Fault fault) {
  switch (fault) {
    case Fault::hole: return make_hole();
    case Fault::crossing: return cross();
    case Fault::degenerate_facet: return make_degenerate();
    case Fault::bad_index:
      any_facet().loop[pick(3)] = seed_ % 3 == 0   ? -1
                                  : seed_ % 3 == 1 ? static_cast<int>(input_.vertices.size())
                                                   : std::numeric_limits<int>::max() - static_cast<int>(pick(100));
      return;
    case Fault::nan_vertex: any_vertex()[static_cast<int>(pick(3))] = std::numeric_limits<double>::quiet_NaN(); return;
    case Fault::infinite_vertex: any_vertex()[static_cast<int>(pick(3))] = seed_ % 2 ? HUGE_VAL : -HUGE_VAL; return;
    case Fault::huge_vertex: any_vertex()[static_cast<int>(pick(3))] = seed_ % 2 ? 1e308 : -1e308; return;
    case Fault::duplicate_vertices: return duplicate();
    case Fault::touching_sheets: return touch();
    case Fault::soup: return mix();
    case Fault::coplanar: return flatten();
    case Fault::inverted: return invert(input_);
    case Fault::empty:
      if (seed_ % 3 != 1) input_.facets.clear();
      if (seed_ % 3 != 0) input_.vertices.clear();
  }
}

inline void Spoiler::make_hole() {
  for (std::size_t i = 0; i <= seed_ % 3; ++i)
    input_.facets.erase(input_.facets.begin() + static_cast<std::ptrdiff_t>(pick(input_.facets.size())));
}

inline void Spoiler::cross() {
  if (seed_ % 3 == 0) {  // a top vertex pulled through the bottom
    for (Vec3d& v : input_.vertices)
      if (v.z() > 0.8 && v.x() > 0.1 && v.x() < 0.9 && v.y() > 0.1 && v.y() < 0.9) {
        v.z() = -0.5 - unit();
        return;
      }
    return;
  }
  MeshInput other = seed_ % 3 == 1 ? block(2, random_) : sphere(1, 0.6);  // another body that overlaps
  turn(other, random_);
  for (Vec3d& v : other.vertices) v += Vec3d(0.6, 0.5 * unit(), 0.5 * unit());
  append(input_, other);
}

inline void Spoiler::make_degenerate() {
  Facet& facet = any_facet();
  if (seed_ % 3 == 0) facet.loop[2] = facet.loop[1];
  else if (seed_ % 3 == 1) facet.loop.pop_back();
  else corner(facet, 2) = 0.5 * (corner(facet, 0) + corner(facet, 1));
}

/// A facet gets a corner of its own at the same place.
inline void Spoiler::duplicate() {
  Facet& facet = any_facet();
  input_.vertices.push_back(corner(facet, 0) + (seed_ % 2 ? 0.0 : 1e-12) * Vec3d::Ones());
  facet.loop[0] = static_cast<int>(input_.vertices.size()) - 1;
}

/// Two bodies that touch with a face, an edge or a corner.
inline void Spoiler::touch() {
  MeshInput other = box(Vec3d(1, 0, 0), Vec3d(2, 1, 1));
  const double shift = 0.3 + 0.4 * unit();
  for (Vec3d& v : other.vertices)
    v += seed_ % 3 == 0   ? Vec3d(0, shift, 0.2)
         : seed_ % 3 == 1 ? Vec3d(0, 1, -shift)
                          : Vec3d(0, -shift, -1 + 0.11 * shift);
  append(input_, other);
  if (seed_ % 2) turn(input_, random_);  // now they touch but for rounding
}

inline void Spoiler::mix() {
  for (Facet& facet : input_.facets)
    for (int& vertex : facet.loop) vertex = static_cast<int>(pick(input_.vertices.size()));
  for (Vec3d& v : input_.vertices) v = Vec3d(unit(), unit(), unit());
}

inline void Spoiler::flatten() {
  for (Vec3d& v : input_.vertices) v.z() = 0.3 * v.x() - 0.2 * v.y();
  if (seed_ % 2)  // no two vertices at one place
    for (Vec3d& v : input_.vertices) v = Vec3d(unit(), unit(), 0.0);
}

inline MeshInput faulty(Fault fault, std::uint64_t seed) { return Spoiler(fault, seed).input(); }

}  // namespace surfaces
