#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

namespace lumo {

/// A wanted edge length, sampled on an octree over a box so that it can be sent to another process. Trilinear in each
/// leaf. Leaves are split where the samples at their middles differ from the interpolation by more than `tolerance`
/// (relative) and are larger than half the wanted length, down to `max_depth`, with at most `max_cells` cells in all.
struct SizeField {
  struct Cell {
    std::array<double, 8> corners;  ///< wanted length at (x + 2 y + 4 z), each 0 or 1
    int child = -1;                 ///< first of eight children, or −1
    int unused = 0;                 ///< keeps the bytes defined
  };

  Vec3d low{0.0, 0.0, 0.0};
  double side = 0.0;        ///< of the root cube
  std::vector<Cell> cells;  ///< empty: no wish

  static constexpr int min_depth = 3;
  static constexpr int max_depth = 9;
  static constexpr std::size_t max_cells = 60000;
  static constexpr double tolerance = 0.05;

  static SizeField sample(const std::function<double(const Vec3d&)>& edge, const Vec3d& low, const Vec3d& high);

  double operator()(const Vec3d& point) const {
    Vec3d local = ((point - low) / side).cwiseMax(0.0).cwiseMin(1.0);
    int cell = 0;
    while (cells[static_cast<std::size_t>(cell)].child >= 0) {
      int octant = 0;
      for (int axis = 0; axis < 3; ++axis) {
        local[axis] *= 2.0;
        if (local[axis] >= 1.0) {
          local[axis] -= 1.0;
          octant |= 1 << axis;
        }
      }
      cell = cells[static_cast<std::size_t>(cell)].child + octant;
    }
    return trilinear(cells[static_cast<std::size_t>(cell)].corners, local);
  }

  static double trilinear(const std::array<double, 8>& c, const Vec3d& t) {
    const auto mix = [](double a, double b, double s) { return a + (b - a) * s; };
    return mix(mix(mix(c[0], c[1], t.x()), mix(c[2], c[3], t.x()), t.y()),
        mix(mix(c[4], c[5], t.x()), mix(c[6], c[7], t.x()), t.y()), t.z());
  }
};

/// Samples `edge` inside the box [low, high] only. Throws MeshError (not_finite) where it is not finite and positive;
/// what `edge` itself throws passes through.
inline SizeField SizeField::sample(
    const std::function<double(const Vec3d&)>& edge, const Vec3d& low, const Vec3d& high) {
  SizeField field;
  if (!edge) return field;
  field.side = (high - low).maxCoeff();
  field.low = 0.5 * (low + high) - Vec3d::Constant(0.5 * field.side);
  const auto value = [&](const Vec3d& at) {
    const Vec3d point = elementwise_min(elementwise_max(at, low), high);
    const double length = edge(point);
    if (std::isfinite(length) && length > 0.0) return length;
    throw MeshError(MeshError::Reason::not_finite,
        message("wanted edge length at (", point.x(), ", ", point.y(), ", ", point.z(), ") is ", length,
            ", must be finite and > 0, in the unit of the coordinates"));
  };
  struct Task {
    int cell;
    int depth;
    Vec3d low;
    double side;
  };
  const auto corner = [](int i) { return Vec3d(i & 1, (i >> 1) & 1, (i >> 2) & 1); };
  Cell root;
  for (int i = 0; i < 8; ++i) root.corners[static_cast<std::size_t>(i)] = value(field.low + field.side * corner(i));
  field.cells.push_back(root);
  std::vector<Task> tasks{{0, 0, field.low, field.side}};
  for (std::size_t next = 0; next < tasks.size(); ++next) {  // breadth first: if cells run out, they run out evenly
    const Task task = tasks[next];
    const bool outside = (task.low.array() > high.array()).any() || (task.low.array() + task.side < low.array()).any();
    if (outside || task.depth >= max_depth || field.cells.size() + 8 > max_cells) continue;
    const std::array<double, 8> corners = field.cells[static_cast<std::size_t>(task.cell)].corners;
    std::array<double, 27> grid;
    double error = 0.0;
    double least = corners[0];
    for (int i = 0; i < 27; ++i) {
      const Vec3d local = 0.5 * Vec3d(i % 3, (i / 3) % 3, i / 9);
      const double exact = value(task.low + task.side * local);
      error = std::max(error, std::abs(exact - trilinear(corners, local)) / exact);
      least = std::min(least, exact);
      grid[static_cast<std::size_t>(i)] = exact;
    }
    if (task.depth >= min_depth && (error <= tolerance || task.side <= 0.5 * least)) continue;
    const int first = static_cast<int>(field.cells.size());
    field.cells[static_cast<std::size_t>(task.cell)].child = first;
    for (int octant = 0; octant < 8; ++octant) {
      Cell cell;
      for (int i = 0; i < 8; ++i) {
        const int x = (octant & 1) + (i & 1);
        const int y = ((octant >> 1) & 1) + ((i >> 1) & 1);
        const int z = ((octant >> 2) & 1) + ((i >> 2) & 1);
        cell.corners[static_cast<std::size_t>(i)] = grid[static_cast<std::size_t>(x + 3 * y + 9 * z)];
      }
      field.cells.push_back(cell);
      tasks.push_back({first + octant, task.depth + 1, task.low + 0.5 * task.side * corner(octant), 0.5 * task.side});
    }
  }
  return field;
}

/// Mesh grading about the places where an indenter touches: the contact radius grows with the load, so edges that grow
/// in proportion to the distance resolve the edge of every contact equally well.
struct Focus {
  double finest = 0.4e-3;     ///< edge length at a place of touch [m]
  double growth = 0.12;       ///< edge length gained per distance from it
  double depth_growth = 0.7;  ///< and per depth below it: only the surface has to follow the edge of contact
  double of_tool = 0.2;       ///< edges at a place of touch are no longer than this part of the tool's contact radius

  /// All edges `factor` times as long.
  constexpr Focus scaled(double factor) const {
    return {factor * finest, factor * growth, factor * depth_growth, of_tool};
  }
  bool operator==(const Focus&) const = default;
};

/// A place of a body's surface, and the edge length that a mesh is to have there [m].
struct FinePlace {
  Vec3d place_m;
  double finest_m;
};

/// The body with its mesh sizing refined about the given places and their mirror images; `focus` says how edges grow
/// from there, which is all for a body that wants no lengths. Throws InvalidArgument.
inline Body focused(Body body, std::vector<FinePlace> places, const Focus& focus = {}) {
  for (const FinePlace& p : places) require_in_range("finest mesh edge", p.finest_m * 1e3, 0.02, 30.0, "mm");
  require_in_range("mesh growth about the contact", focus.growth, 0.01, 10.0, "");
  require_in_range("mesh growth with depth", focus.depth_growth, 0.0, 1e3, "");
  require_in_range("mesh edge over the tool's contact radius", focus.of_tool, 0.001, 1000.0, "");
  if (places.empty()) return body;
  for (FinePlace& p : places) {
    if (body.symmetry.x) p.place_m.x() = std::abs(p.place_m.x());
    if (body.symmetry.y) p.place_m.y() = std::abs(p.place_m.y());
  }
  body.sizing.edge = [coarse = body.sizing.edge, under_touch = body.sizing.edge_under_touch, places = std::move(places),
                         focus](const Vec3d& p) {
    double edge = coarse ? coarse(p) : std::numeric_limits<double>::infinity();
    for (const FinePlace& f : places) {
      const double depth = std::max(0.0, (f.place_m - p).z());
      edge = std::min(edge, f.finest_m + focus.growth * (p - f.place_m).norm() + focus.depth_growth * depth);
      if (under_touch) edge = std::min(edge, under_touch(p, f.place_m));
    }
    return edge;
  };
  return body;
}

/// The same about points, with the focus's own finest edge.
inline Body focused(Body body, const std::vector<Vec3d>& points, const Focus& focus = {}) {
  std::vector<FinePlace> places;
  for (const Vec3d& p : points) places.push_back({p, focus.finest});
  return focused(std::move(body), std::move(places), focus);
}

}  // namespace lumo
