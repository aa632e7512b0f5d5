#pragma once

#include "lumo/geometry/polygon_triangles.hpp"
#include "lumo/geometry/triangle_surface.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <utility>
#include <vector>

namespace lumo {

/// A solid that is given face by face: flat polygons with holes, and bands between loops. Corners at one place (in
/// every bit) are one vertex, and an edge along an axis takes up the corners of its neighbours that lie on it, so that
/// faces meet edge to edge however they are cut. There are no boolean operations; surface() checks that the faces bound
/// a solid.
class FacetedSolid {
 public:
  using Loop = std::vector<Vec3d>;

  /// A flat face; outline counter-clockwise seen from outside, holes clockwise.
  void face(const Loop& outline, const std::vector<Loop>& holes = {});
  /// Quadrilaterals between two chains of corners: from[i], from[i+1], to[i+1], to[i], which must be flat. With
  /// `closed` the last joins the first. Outward for a loop that is counter-clockwise seen from the side of `to`.
  void band(const Loop& from, const Loop& to, bool closed = true);

  /// The solid's triangles. Throws MeshError unless they bound a solid (see validate_surface).
  TriangleSurface surface() const;

 private:
  struct Face {
    std::vector<int> outline;
    std::vector<std::vector<int>> holes;
  };

  int vertex(const Vec3d& p);
  std::vector<int> numbers(const Loop& loop);
  std::vector<int> with_corners_between(const std::vector<int>& loop) const;

  std::vector<Vec3d> vertices_;
  std::map<std::array<double, 3>, int> known_;
  std::vector<Face> faces_;
};

/// The loop the other way round.
inline std::vector<Vec3d> reversed(std::type_identity_t<std::vector<Vec3d>> loop) {
  std::reverse(loop.begin(), loop.end());
  return loop;
}

inline int FacetedSolid::vertex(const Vec3d& p) {
  const auto [place, fresh] =
      known_.try_emplace({p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}, int(vertices_.size()));  // −0 is 0
  if (fresh) vertices_.push_back(p);
  return place->second;
}

inline std::vector<int> FacetedSolid::numbers(const Loop& loop) {
  std::vector<int> n;
  for (const Vec3d& p : loop) n.push_back(vertex(p));
  return n;
}

inline void FacetedSolid::face(const Loop& outline, const std::vector<Loop>& holes) {
  Face f{numbers(outline), {}};
  for (const Loop& hole : holes) f.holes.push_back(numbers(hole));
  faces_.push_back(std::move(f));
}

inline void FacetedSolid::band(const Loop& from, const Loop& to, bool closed) {
  const std::size_t n = from.size();
  for (std::size_t i = 0; i + (closed ? 0 : 1) < n; ++i) face({from[i], from[(i + 1) % n], to[(i + 1) % n], to[i]});
}

/// The loop with all vertices of the solid that lie on its edges along an axis; exact, for two coordinates are the same
/// there.
inline std::vector<int> FacetedSolid::with_corners_between(const std::vector<int>& loop) const {
  std::vector<int> full;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int from = loop[i], to = loop[(i + 1) % loop.size()];
    const Vec3d &a = vertices_[std::size_t(from)], &b = vertices_[std::size_t(to)];
    full.push_back(from);
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      if (a[u] != b[u] || a[v] != b[v]) continue;
      struct Corner {
        double way;
        int vertex;
        auto operator<=>(const Corner&) const = default;
      };
      std::vector<Corner> between;
      for (std::size_t k = 0; k < vertices_.size(); ++k) {
        const Vec3d& p = vertices_[k];
        if (p[u] == a[u] && p[v] == a[v] && (p[axis] - a[axis]) * (p[axis] - b[axis]) < 0.0)
          between.push_back({std::abs(p[axis] - a[axis]), int(k)});
      }
      std::sort(between.begin(), between.end());
      for (const auto& corner : between) full.push_back(corner.vertex);
    }
  }
  return full;
}

inline auto FacetedSolid::surface() const -> TriangleSurface {
  TriangleSurface s{vertices_, {}};
  for (const Face& f : faces_) {
    const std::vector<int> outline = with_corners_between(f.outline);
    std::vector<std::vector<int>> holes;
    for (const auto& hole : f.holes) holes.push_back(with_corners_between(hole));
    const Vec3d normal = polygon_normal(vertices_, f.outline);
    // Numbers of the corners alone: the projection of thousands of others would cost more than the cut.
    std::vector<int> of = outline;
    for (const auto& hole : holes) of.insert(of.end(), hole.begin(), hole.end());
    std::sort(of.begin(), of.end());
    of.erase(std::unique(of.begin(), of.end()), of.end());
    std::vector<Vec3d> corners;
    for (const int vertex : of) corners.push_back(vertices_[std::size_t(vertex)]);
    const auto local = [&](std::vector<int> loop) {
      for (int& vertex : loop) vertex = int(std::lower_bound(of.begin(), of.end(), vertex) - of.begin());
      return loop;
    };
    std::vector<std::vector<int>> local_holes;
    for (const auto& hole : holes) local_holes.push_back(local(hole));
    const auto triangles = PolygonTriangles(corners, normal).cut(local(outline), std::move(local_holes));
    if (!triangles)
      throw MeshError(
          MeshError::Reason::self_intersecting, "solid: a face's outline crosses or touches itself or its holes");
    for (const auto& t : *triangles)
      s.triangles.push_back({of[std::size_t(t[0])], of[std::size_t(t[1])], of[std::size_t(t[2])]});
  }
  validate_surface(s);
  return s;
}

}  // namespace lumo
