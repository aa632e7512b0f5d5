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

/// Unit normal of a carrier face on its lit side, and in-plane normals of its edges, outwards.
struct FaceFrame {
  Vec3d normal;
  std::vector<Vec3d> out;
};

/// Throws InvalidArgument for a face that is not a polygon of finite corners with an area.
inline FaceFrame face_frame(const RigidFace& face) {
  const std::vector<Vec3d>& c = face.corners;
  const std::size_t m = c.size();
  if (m < 3) throw InvalidArgument(message("carrier face '", face.name, "' has ", m, " corners, needs 3"));
  for (const Vec3d& p : c)
    if (!p.allFinite()) throw InvalidArgument(message("carrier face '", face.name, "': a corner is not finite"));
  Vec3d n = Vec3d::Zero();
  for (std::size_t k = 1; k + 1 < m; ++k) n += (c[k] - c[0]).cross(c[k + 1] - c[0]);
  if (!(n.norm() > 0.0)) throw InvalidArgument(message("carrier face '", face.name, "' has no area"));
  n.normalize();
  FaceFrame frame{n, {}};
  for (std::size_t k = 0; k < m; ++k) frame.out.push_back((c[(k + 1) % m] - c[k]).cross(n).normalized());
  return frame;
}

/// How deep the points `soft` of a body lie behind the carrier faces that they rest on [m], per face; 0: none rests
/// there. A point rests on one face, the one that it is least deep behind: at a carrier's edge it lies behind others,
/// too.
inline std::vector<double> resting_depths(
    const std::vector<RigidFace>& faces, const std::vector<FaceFrame>& frames, const std::vector<Vec3d>& soft) {
  constexpr double reach = 0.1e-3;  // [m]; contact never lets a point go deeper
  std::vector<double> depths(faces.size(), 0.0);
  for (const Vec3d& x : soft) {
    std::size_t rests_on = faces.size();
    double least = reach;
    for (std::size_t i = 0; i < faces.size(); ++i) {
      const std::vector<Vec3d>& c = faces[i].corners;
      const double depth = frames[i].normal.dot(c[0] - x);
      if (depth <= 0.0 || depth > least) continue;
      bool over = true;
      for (std::size_t k = 0; k < c.size() && over; ++k) over = frames[i].out[k].dot(x - c[k]) < 0.0;
      if (!over) continue;
      least = depth;
      rests_on = i;
    }
    if (rests_on < faces.size()) depths[rests_on] = std::max(depths[rests_on], least);
  }
  return depths;
}

/// Corners of a carrier face moved back by `back_m`. Slits open where two faces that stand back meet: each is made
/// larger in its plane by `rim_m`, the most by which any of them stands back, so that no light slips through.
inline std::vector<Vec3d> set_back(const RigidFace& face, const FaceFrame& frame, double back_m, double rim_m) {
  const std::vector<Vec3d>& c = face.corners;
  const std::size_t m = c.size();
  std::vector<Vec3d> corner(m);
  for (std::size_t k = 0; k < m; ++k) {
    const Vec3d &a = frame.out[(k + m - 1) % m], &b = frame.out[k];
    corner[k] = c[k] - back_m * frame.normal + rim_m * (a + b) / (1.0 + std::max(-0.9, a.dot(b)));
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
