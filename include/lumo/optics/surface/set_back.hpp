#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/morphology/optical_data.hpp"

#include <algorithm>
#include <vector>

namespace lumo {

/// Corners of a carrier face, moved away from the lit side by `gap_m`, or by twice as much as the points `soft` of the
/// body lie behind it if that is more: where a body rests on its carrier the two may cross a little, and light in the
/// gap must still meet the carrier. Throws InvalidArgument for a face that is not a polygon of finite corners with an
/// area.
inline std::vector<Vec3d> set_back(const RigidFace& face, const std::vector<Vec3d>& soft, double gap_m) {
  const double reach = 1e-3;  // [m]; what lies deeper behind the face does not rest on it
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
  // Standing back opens slits along the rim: the face is made larger in its plane, so that light cannot slip through.
  std::vector<Vec3d> corner(m);
  for (std::size_t k = 0; k < m; ++k) {
    const Vec3d& a = out[(k + m - 1) % m];
    corner[k] = c[k] - back * n + 10.0 * back * (a + out[k]) / (1.0 + std::max(-0.9, a.dot(out[k])));
  }
  return corner;
}

}  // namespace lumo
