#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/closed_surface.hpp"
#include "lumo/geometry/facet_triangles.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <tuple>
#include <vector>

namespace lumo {

/// A connected part of a surface. It faces outwards (volume > 0, a solid) or inwards (a cavity).
struct Shell {
  std::vector<int> triangles;
  double area = 0.0;
  double volume = 0.0;
};

/// Union–find with path halving.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  int find(int i) {
    while (at(i) != i) i = at(i) = at(at(i));
    return i;
  }
  void join(int i, int j) { at(find(i)) = find(j); }

 private:
  int& at(int i) { return parent_[static_cast<std::size_t>(i)]; }
  std::vector<int> parent_;
};

/// Every edge has two facets that run along it in opposite directions, and the facets around each vertex form one fan.
/// Throws MeshError (open, not_manifold).
inline void check_edges(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  struct Side {
    int low, high;
    bool up;  // runs from the lower vertex number to the higher
    int facet;
    int from, to;  // corners, numbered through all facets
  };
  std::vector<Side> sides;
  std::vector<int> vertex_of;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const int base = static_cast<int>(vertex_of.size());
    const int n = static_cast<int>(loop.size());
    for (int i = 0; i < n; ++i) {
      const int a = loop[static_cast<std::size_t>(i)];
      const int b = loop[static_cast<std::size_t>((i + 1) % n)];
      sides.push_back({std::min(a, b), std::max(a, b), a < b, static_cast<int>(f), base + i, base + (i + 1) % n});
      vertex_of.push_back(a);
    }
  }
  std::sort(sides.begin(), sides.end(),
      [](const Side& a, const Side& b) { return std::tie(a.low, a.high, a.from) < std::tie(b.low, b.high, b.from); });
  Groups fans(vertex_of.size());
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].low == sides[i].low && sides[end].high == sides[i].high) ++end;
    const auto place = [&](int vertex) {
      const Vec3d& p = input.vertices[static_cast<std::size_t>(vertex)];
      return message(vertex, " at (", p.x(), ", ", p.y(), ", ", p.z(), ")");
    };
    const auto edge = message(
        "the edge from vertex ", place(sides[i].low), " to ", place(sides[i].high), " of facet ", sides[i].facet);
    if (end - i == 1) throw MeshError(Reason::open, message("surface: ", edge, " has 1 facet, must have 2"));
    if (end - i > 2)
      throw MeshError(Reason::not_manifold, message("surface: ", edge, " has ", end - i, " facets, must have 2"));
    const Side& a = sides[i];
    const Side& b = sides[i + 1];
    if (a.up == b.up)
      throw MeshError(
          Reason::not_manifold, message("surface: ", edge, " has a facet of opposite orientation, ", b.facet));
    fans.join(a.from, b.to);
    fans.join(a.to, b.from);
    i = end;
  }
  std::vector<int> fan_of(input.vertices.size(), -1);
  for (std::size_t corner = 0; corner < vertex_of.size(); ++corner) {
    int& known = fan_of[static_cast<std::size_t>(vertex_of[corner])];
    const int fan = fans.find(static_cast<int>(corner));
    if (known >= 0 && known != fan)
      throw MeshError(Reason::not_manifold,
          message("surface: vertex ", vertex_of[corner], " joins more than 1 fan of facets, must be 1"));
    known = fan;
  }
}

/// The connected parts of a surface, with areas and enclosed volumes.
inline std::vector<Shell> find_shells(const ClosedSurface& input, const std::vector<SurfaceTriangle>& triangles) {
  Groups groups(input.vertices.size());
  for (const SurfaceTriangle& t : triangles) {
    groups.join(t.corners[0], t.corners[1]);
    groups.join(t.corners[0], t.corners[2]);
  }
  std::vector<int> number(input.vertices.size(), -1);
  std::vector<Shell> shells;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    int& shell = number[static_cast<std::size_t>(groups.find(triangles[i].corners[0]))];
    if (shell < 0) {
      shell = static_cast<int>(shells.size());
      shells.emplace_back();
    }
    shells[static_cast<std::size_t>(shell)].triangles.push_back(static_cast<int>(i));
  }
  const auto at = [&](int vertex) -> const Vec3d& { return input.vertices[static_cast<std::size_t>(vertex)]; };
  for (Shell& shell : shells) {
    const Vec3d origin = at(triangles[static_cast<std::size_t>(shell.triangles[0])].corners[0]);
    for (int i : shell.triangles) {
      const auto& [a, b, c] = triangles[static_cast<std::size_t>(i)].corners;
      const Vec3d doubled = (at(b) - at(a)).cross(at(c) - at(a));
      shell.area += 0.5 * doubled.norm();
      shell.volume += doubled.dot(at(a) - origin) / 6.0;
    }
  }
  return shells;
}

/// Solid angle of the triangle abc seen from `point`, positive from behind. Source: van Oosterom and Strackee 1983.
inline double solid_angle(const Vec3d& from_a, const Vec3d& from_b, const Vec3d& from_c, const Vec3d& point) {
  const Vec3d a = from_a - point, b = from_b - point, c = from_c - point;
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

/// How often a shell winds around a point: 1 inside, 0 outside.
inline double winding(const std::vector<Vec3d>& vertices, const std::vector<SurfaceTriangle>& triangles,
    const Shell& shell, const Vec3d& point) {
  double angle = 0.0;
  for (int i : shell.triangles) {
    const auto& corners = triangles[static_cast<std::size_t>(i)].corners;
    angle += solid_angle(vertices[static_cast<std::size_t>(corners[0])], vertices[static_cast<std::size_t>(corners[1])],
        vertices[static_cast<std::size_t>(corners[2])], point);
  }
  return angle / (4.0 * std::numbers::pi);
}

/// Solids lie outside each other, cavities in a solid, interior points in the material.
/// Throws MeshError (not_manifold for shells, bad_index for points).
inline void check_inside(
    const ClosedSurface& input, const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  const auto total = [&](const Vec3d& point, const Shell* without) {
    double sum = 0.0;
    for (const Shell& shell : shells)
      if (&shell != without) sum += winding(input.vertices, triangles, shell, point);
    return sum;
  };
  for (std::size_t i = 0; shells.size() > 1 && i < shells.size(); ++i) {
    const SurfaceTriangle& first = triangles[static_cast<std::size_t>(shells[i].triangles[0])];
    const double around = total(input.vertices[static_cast<std::size_t>(first.corners[0])], &shells[i]);
    const double wanted = shells[i].volume > 0.0 ? 0.0 : 1.0;
    if (std::abs(around - wanted) > 0.25)
      throw MeshError(MeshError::Reason::not_manifold,
          message("surface: the shell of facet ", first.facet, " with volume ", shells[i].volume,
              " is wound by other shells ", around, " times, must be ", wanted));
  }
  std::vector<char> used(input.vertices.size(), 0);
  for (const SurfaceTriangle& t : triangles)
    for (int vertex : t.corners) used[static_cast<std::size_t>(vertex)] = 1;
  for (std::size_t i = 0; i < used.size(); ++i)
    if (!used[i] && total(input.vertices[i], nullptr) < 0.75)
      throw MeshError(MeshError::Reason::bad_index,
          message("surface: vertex ", i, " belongs to no facet and is not inside the body"));
}

/// A point inside each cavity: half way from one of its triangles to what faces it.
inline std::vector<Vec3d> cavity_points(const std::vector<Vec3d>& vertices,
    const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  std::vector<Vec3d> points;
  const auto at = [&](int vertex) -> const Vec3d& { return vertices[static_cast<std::size_t>(vertex)]; };
  for (const Shell& shell : shells) {
    if (shell.volume > 0.0) continue;
    const auto& [a, b, c] = triangles[static_cast<std::size_t>(shell.triangles[0])].corners;
    const Vec3d from = (at(a) + at(b) + at(c)) / 3.0;
    const Vec3d ray = (at(b) - at(a)).cross(at(c) - at(a)).normalized();  // out of the material
    double nearest = HUGE_VAL;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      if (static_cast<int>(i) == shell.triangles[0]) continue;
      const auto& [p, q, r] = triangles[i].corners;
      const Vec3d normal = (at(q) - at(p)).cross(at(r) - at(p));
      const double distance = normal.dot(at(p) - from) / normal.dot(ray);
      if (!(distance > 0.0 && distance < nearest)) continue;
      const Vec3d hit = from + distance * ray;
      const double slack = -1e-9 * normal.squaredNorm();
      const auto left = [&](int v, int w) { return normal.dot((at(w) - at(v)).cross(hit - at(v))) >= slack; };
      if (left(p, q) && left(q, r) && left(r, p)) nearest = distance;
    }
    points.push_back(from + 0.5 * nearest * ray);
  }
  return points;
}

}  // namespace lumo
