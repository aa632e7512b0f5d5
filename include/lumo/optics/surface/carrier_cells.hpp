#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/morphology/silicone.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace lumo {

/// Corners of a carrier face, moved away from the lit side by `gap_m`, or by twice as much as the points `soft` of the
/// body lie behind it if that is more: a body and the carrier that it rests on may cross a little, and light in the gap
/// must still meet the carrier. Throws InvalidArgument for a face that is not a polygon of finite corners with an
/// area.
inline std::vector<Vec3d> set_back(const RigidFace& face, const std::vector<Vec3d>& soft, double gap_m) {
  constexpr double reach = 1e-3;     // [m]; points deeper behind the face do not rest on it
  constexpr double widening = 10.0;  // of the face, in distances that it stands back
  const std::vector<Vec3d>& c = face.corners;
  const std::size_t m = c.size();
  if (m < 3) throw InvalidArgument(message("carrier face '", face.name, "' has ", m, " corners, needs 3"));
  for (const Vec3d& p : c)
    if (!p.allFinite()) throw InvalidArgument(message("carrier face '", face.name, "': a corner is not finite"));
  Vec3d n = Vec3d::Zero();
  for (std::size_t k = 1; k + 1 < m; ++k) n += (c[k] - c[0]).cross(c[k + 1] - c[0]);
  if (!(n.norm() > 0.0)) throw InvalidArgument(message("carrier face '", face.name, "' has no area"));
  n.normalize();
  std::vector<Vec3d> out(m);  // in-plane outward normals of the edges
  for (std::size_t k = 0; k < m; ++k) out[k] = (c[(k + 1) % m] - c[k]).cross(n).normalized();
  double back = gap_m;
  for (const Vec3d& x : soft) {
    const double depth = n.dot(c[0] - x);
    if (depth <= 0.5 * back || depth > reach) continue;
    bool over = true;
    for (std::size_t k = 0; k < m && over; ++k) over = out[k].dot(x - c[k]) < 0.0;
    if (over) back = 2.0 * depth;
  }
  // Slits open along the rim of a face that stands back: it is made larger in its plane, so that no light slips
  // through.
  std::vector<Vec3d> corner(m);
  for (std::size_t k = 0; k < m; ++k) {
    const Vec3d& a = out[(k + m - 1) % m];
    corner[k] = c[k] - back * n + widening * back * (a + out[k]) / (1.0 + std::max(-0.9, a.dot(out[k])));
  }
  return corner;
}

/// Cuts a convex polygon into triangles with edges of about `size_m` that fit together corner to corner. How many is
/// decided on the polygon `like` of as many corners, so that a face that is moved keeps its cells. A parallelogram
/// becomes an even number of cells each way, of four triangles each, any other polygon a fan about its middle: mirror
/// images of a polygon have mirror images of its triangles.
inline std::vector<std::array<Vec3d, 3>> polygon_cells(
    const std::vector<Vec3d>& c, const std::vector<Vec3d>& like, double size_m) {
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
