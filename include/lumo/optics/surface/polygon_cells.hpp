#pragma once

#include "lumo/core/types.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace lumo {

/// Cuts a convex polygon into triangles with edges of about `size_m` that fit together corner to corner. How many is
/// decided on the polygon `like` of as many corners, so that a face that is moved keeps its cells. A parallelogram
/// becomes an even number of cells each way, of four triangles each, any other polygon a fan about its middle: mirror
/// images of a polygon have mirror images of its triangles.
inline std::vector<std::array<Vec3d, 3>> polygon_cells(const std::vector<Vec3d>& c, const std::vector<Vec3d>& like,
                                                       double size_m) {
  std::vector<std::array<Vec3d, 3>> cells;
  const auto pieces = [&](double length) { return std::max(1, int(std::ceil(length / size_m - 1e-9))); };
  if (like.size() == 4 && (like[0] + like[2] - like[1] - like[3]).norm() < 1e-9 * (like[2] - like[0]).norm()) {
    const int nu = 2 * pieces(0.5 * (like[1] - like[0]).norm()), nv = 2 * pieces(0.5 * (like[3] - like[0]).norm());
    const auto at = [&](double i, double j) {
      const double u = i / nu, v = j / nv;
      return Vec3d((1.0 - u) * (1.0 - v) * c[0] + u * (1.0 - v) * c[1] + u * v * c[2] + (1.0 - u) * v * c[3]);
    };
    for (int i = 0; i < nu; ++i)
      for (int j = 0; j < nv; ++j) {
        const Vec3d middle = at(i + 0.5, j + 0.5);
        const std::array<Vec3d, 4> p{at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)};
        for (std::size_t k = 0; k < 4; ++k) cells.push_back({p[k], p[(k + 1) % 4], middle});
      }
    return cells;
  }
  const std::size_t m = c.size();
  double longest = 0.0;
  Vec3d middle = Vec3d::Zero();
  for (std::size_t k = 0; k < m; ++k) {
    middle += c[k] / double(m);
    for (std::size_t l = 0; l < k; ++l) longest = std::max(longest, (like[k] - like[l]).norm());
  }
  const int n = pieces(longest);
  for (std::size_t k = 0; k < m; ++k) {
    const auto at = [&](int i, int j) {
      return Vec3d(middle + (double(i) / n) * (c[k] - middle) + (double(j) / n) * (c[(k + 1) % m] - middle));
    };
    for (int i = 0; i < n; ++i)
      for (int j = 0; i + j < n; ++j) {
        cells.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        if (i + j + 1 < n) cells.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
  }
  return cells;
}
inline std::vector<std::array<Vec3d, 3>> polygon_cells(const std::vector<Vec3d>& c, double size_m) {
  return polygon_cells(c, c, size_m);
}

}  // namespace lumo
