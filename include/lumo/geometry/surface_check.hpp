#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/self_intersection.hpp"
#include "lumo/geometry/shells.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// What is known of a surface once it is found good.
struct SurfaceReport {
  Vec3d low{0.0, 0.0, 0.0};  ///< bounding box
  Vec3d high{0.0, 0.0, 0.0};
  double area = 0.0;
  double volume = 0.0;          ///< enclosed, cavities not counted
  std::vector<Vec3d> cavities;  ///< a point inside each cavity (a closed inner shell that faces inwards)
};

/// Checks that a surface bounds a solid: numbers finite and below 1e6, indices valid, facets flat (1e-8 of their size),
/// simple and not degenerate, no two vertices at one place (1e-8 of the body's size), every edge shared by two facets
/// of one orientation, one fan of facets around each vertex, positive volume, and no facets that cross, touch (1e-8 of
/// the body's size) or lie on each other. Vertices of no facet are interior points. Several separate solids and
/// cavities are legal. Throws MeshError with the reason of the first broken rule; an inside-out surface is
/// not_manifold, no volume is degenerate. Time about n log n for n triangles, quadratic in the corners of a facet.
/// An own engine: each fault is an error with its kind, place and limit, and nothing but Eigen is needed.
inline SurfaceReport validate_surface(const ClosedSurface& input);

namespace detail {

// In the unit of the coordinates; the other two relative to the facet or the body. Own choice: far above what doubles
// round, far below what is made.
inline constexpr double largest_coordinate = 1e6;
inline constexpr double flatness = 1e-8;
inline constexpr double closeness = 1e-8;

[[noreturn]] inline void refuse_surface(MeshError::Reason reason, const std::string& line) {
  throw MeshError(reason, "surface: " + line);
}

inline std::string point_text(const Vec3d& p) { return message("(", p.x(), ", ", p.y(), ", ", p.z(), ")"); }

inline void check_numbers(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  if (input.vertices.empty() || input.facets.empty())
    refuse_surface(Reason::degenerate, message("has ", input.vertices.size(), " vertices and ", input.facets.size(),
                                           " facets, must have some of both"));
  if (input.vertices.size() > 100'000'000 || input.facets.size() > 100'000'000)
    refuse_surface(Reason::out_of_memory,
        message("has ", input.vertices.size(), " vertices and ", input.facets.size(), " facets, at most 1e8 of each"));
  for (std::size_t i = 0; i < input.vertices.size(); ++i)
    if (!(input.vertices[i].cwiseAbs().maxCoeff() <= largest_coordinate) || !input.vertices[i].allFinite())
      refuse_surface(Reason::not_finite, message("vertex ", i, " is at ", point_text(input.vertices[i]),
                                             ", coordinates must be finite and at most ", largest_coordinate));
  const auto count = static_cast<int>(input.vertices.size());
  std::vector<int> seen(input.vertices.size(), -1);
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    for (int vertex : loop)
      if (vertex < 0 || vertex >= count)
        refuse_surface(
            Reason::bad_index, message("facet ", f, " names vertex ", vertex, ", must lie in [0, ", count - 1, "]"));
    if (loop.size() < 3)
      refuse_surface(Reason::degenerate, message("facet ", f, " has ", loop.size(), " corners, must have at least 3"));
    for (int vertex : loop)
      if (std::exchange(seen[static_cast<std::size_t>(vertex)], static_cast<int>(f)) == static_cast<int>(f))
        refuse_surface(Reason::degenerate, message("facet ", f, " has vertex ", vertex, " more than once"));
  }
}

/// Vertices closer than `tolerance`, found by sorting along a direction in which hardly any two agree by accident.
inline void check_duplicates(const std::vector<Vec3d>& vertices, double tolerance) {
  const Vec3d direction = Vec3d(0.5477, 0.6083, 0.5744).normalized();
  struct Placed {
    double along;
    int vertex;
    auto operator<=>(const Placed&) const = default;
  };
  std::vector<Placed> order;
  for (std::size_t i = 0; i < vertices.size(); ++i) order.push_back({direction.dot(vertices[i]), static_cast<int>(i)});
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t j = i + 1; j < order.size() && order[j].along - order[i].along <= tolerance; ++j) {
      const Vec3d& a = vertices[static_cast<std::size_t>(order[i].vertex)];
      const double distance = (vertices[static_cast<std::size_t>(order[j].vertex)] - a).norm();
      if (distance <= tolerance)
        refuse_surface(MeshError::Reason::duplicate,
            message("vertices ", order[i].vertex, " and ", order[j].vertex, " at ", point_text(a), " are ", distance,
                " apart, must be more than ", tolerance));
    }
}

}  // namespace detail

/// Checks each facet alone and cuts it into triangles.
inline std::vector<SurfaceTriangle> check_facets(const ClosedSurface& input, double gap) {
  using Reason = MeshError::Reason;
  std::vector<SurfaceTriangle> triangles;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const auto corner = [&](std::size_t i) -> const Vec3d& {
      return input.vertices[static_cast<std::size_t>(loop[i % loop.size()])];
    };
    double size = 0.0;
    for (std::size_t i = 0; i < loop.size(); ++i)
      size = std::max({size, (corner(i) - corner(0)).norm(), (corner(i + 1) - corner(i)).norm()});
    const Vec3d doubled = polygon_normal(input.vertices, loop);
    if (!(doubled.norm() > 2.0 * detail::flatness * size * size))
      detail::refuse_surface(
          Reason::degenerate, message("facet ", f, " at ", detail::point_text(corner(0)), " has area ",
                                  0.5 * doubled.norm(), ", must be more than ", detail::flatness * size * size));
    const Vec3d normal = doubled.normalized();
    for (std::size_t i = 1; i < loop.size(); ++i) {
      const double height = std::abs(normal.dot(corner(i) - corner(0)));
      if (loop.size() > 3 && height > detail::flatness * size)
        detail::refuse_surface(
            Reason::degenerate, message("facet ", f, " at ", detail::point_text(corner(i)), " is not flat: ", height,
                                    " off its plane, at most ", detail::flatness * size));
    }
    const auto pieces = facet_triangles(input.vertices, loop, normal, static_cast<int>(f), 2.0 * gap);
    if (!pieces)
      detail::refuse_surface(Reason::self_intersecting,
          message("the outline of facet ", f, " at ", detail::point_text(corner(0)), " crosses or touches itself"));
    triangles.insert(triangles.end(), pieces->begin(), pieces->end());
  }
  return triangles;
}

inline SurfaceReport validate_surface(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  detail::check_numbers(input);
  SurfaceReport report;
  report.low = report.high = input.vertices[0];
  for (const Vec3d& vertex : input.vertices) {
    report.low = elementwise_min(report.low, vertex);
    report.high = elementwise_max(report.high, vertex);
  }
  const double size = (report.high - report.low).norm();
  if (!(size >= 1e-30))
    detail::refuse_surface(Reason::degenerate, message("has a size of ", size, ", must be at least 1e-30"));
  detail::check_duplicates(input.vertices, detail::closeness * size);
  const std::vector<SurfaceTriangle> triangles = check_facets(input, detail::closeness * size);
  check_edges(input);

  const std::vector<Shell> shells = find_shells(input, triangles);
  for (const Shell& shell : shells) {
    report.area += shell.area;
    report.volume += shell.volume;
    if (!(std::abs(shell.volume) > 1e-9 * shell.area * size))
      detail::refuse_surface(Reason::degenerate,
          message("the shell of facet ", triangles[static_cast<std::size_t>(shell.triangles[0])].facet,
              " encloses a volume of ", shell.volume, ", must be more than ", 1e-9 * shell.area * size));
  }
  if (!(report.volume > 0.0))
    detail::refuse_surface(
        Reason::not_manifold, message("is inside out: the enclosed volume is ", report.volume, ", must be > 0"));
  if (const auto pair = SelfIntersection(input.vertices, triangles, detail::closeness * size).find()) {
    const SurfaceTriangle& a = triangles[static_cast<std::size_t>(pair->first)];
    const SurfaceTriangle& b = triangles[static_cast<std::size_t>(pair->second)];
    detail::refuse_surface(Reason::self_intersecting,
        message("facets ", std::min(a.facet, b.facet), " and ", std::max(a.facet, b.facet), " cross or touch near ",
            detail::point_text(input.vertices[static_cast<std::size_t>(a.corners[0])]), ", must be more than ",
            detail::closeness * size, " apart"));
  }
  check_inside(input, triangles, shells);
  report.cavities = cavity_points(input.vertices, triangles, shells);
  return report;
}

}  // namespace lumo
