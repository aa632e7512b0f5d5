#pragma once

#include "lumo/core/types.hpp"

#include <array>
#include <cstddef>
#include <utility>

namespace lumo {

/// Shape functions of a quadratic triangle at barycentric (b1, b2); nodes: corners 0, 1, 2, then the middles of edges
/// 01, 12, 20.
inline std::array<double, 6> quadratic_shape(double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  return {b0 * (2.0 * b0 - 1.0), b1 * (2.0 * b1 - 1.0), b2 * (2.0 * b2 - 1.0),
          4.0 * b0 * b1,         4.0 * b1 * b2,         4.0 * b2 * b0};
}

/// Its point at (b1, b2).
inline Vec3d on_quadratic(const std::array<Vec3d, 6>& x, double b1, double b2) {
  const std::array<double, 6> n = quadratic_shape(b1, b2);
  return n[0] * x[0] + n[1] * x[1] + n[2] * x[2] + n[3] * x[3] + n[4] * x[4] + n[5] * x[5];
}

/// The same at (k1, k2)/n. Points on an edge come from the edge's own three nodes in the order of their `numbers`, so
/// that neighbours get the same bits: no cracks.
inline Vec3d lattice_point(const std::array<Vec3d, 6>& x, const std::array<int, 6>& numbers, int n, int k1, int k2) {
  const double h = 1.0 / n;
  const auto on_edge = [&](std::size_t a, std::size_t b, std::size_t m, int ka, int kb) {
    if (kb == 0) return x[a];
    if (ka == 0) return x[b];
    if (numbers[a] > numbers[b]) std::swap(a, b), std::swap(ka, kb);
    const double s = ka * h, t = kb * h;
    return Vec3d(s * (2.0 * s - 1.0) * x[a] + t * (2.0 * t - 1.0) * x[b] + 4.0 * s * t * x[m]);
  };
  const int k0 = n - k1 - k2;
  if (k2 == 0) return on_edge(0, 1, 3, k0, k1);
  if (k0 == 0) return on_edge(1, 2, 4, k1, k2);
  if (k1 == 0) return on_edge(2, 0, 5, k2, k0);
  return on_quadratic(x, k1 * h, k2 * h);
}

/// Unit normal at (b1, b2); not finite where the triangle is crushed to nothing.
inline Vec3d quadratic_normal(const std::array<Vec3d, 6>& x, double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  const Vec3d d1 =
      (1.0 - 4.0 * b0) * x[0] + (4.0 * b1 - 1.0) * x[1] + 4.0 * (b0 - b1) * x[3] + 4.0 * b2 * (x[4] - x[5]);
  const Vec3d d2 =
      (1.0 - 4.0 * b0) * x[0] + (4.0 * b2 - 1.0) * x[2] + 4.0 * (b0 - b2) * x[5] + 4.0 * b1 * (x[4] - x[3]);
  return d1.cross(d2).normalized();
}

/// A boundary face of the mesh in one state.
struct QuadraticFace {
  std::array<Vec3d, 6> reference, deformed;  ///< [m]
  std::array<Vec3d, 6> normal;  ///< unit outward normals of the deformed face at its nodes, shared with its neighbours
  std::array<double, 6> contact;  ///< contact field, > 0 in contact, −infinity where there can be none
  int patch;
  bool may_touch;

  /// Inside {φ > 0}, φ linear on the four triangles between corners and edge middles?
  bool in_contact(double b1, double b2) const {
    if (!may_touch) return false;
    const double b0 = 1.0 - b1 - b2;
    double value = 0.0;
    const auto add = [&](double weight, std::size_t node) {
      if (weight > 0.0) value += weight * contact[node];  // a weight of 0 must not meet −infinity
    };
    if (b0 > 0.5) {
      add(2.0 * b0 - 1.0, 0), add(2.0 * b1, 3), add(2.0 * b2, 5);
    } else if (b1 > 0.5) {
      add(2.0 * b1 - 1.0, 1), add(2.0 * b0, 3), add(2.0 * b2, 4);
    } else if (b2 > 0.5) {
      add(2.0 * b2 - 1.0, 2), add(2.0 * b1, 4), add(2.0 * b0, 5);
    } else {
      add(1.0 - 2.0 * b2, 3), add(1.0 - 2.0 * b0, 4), add(1.0 - 2.0 * b1, 5);
    }
    return value > 0.0;
  }
};

}  // namespace lumo
