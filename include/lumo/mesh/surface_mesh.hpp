#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/signed_distance.hpp"
#include "lumo/geometry/triangle_surface.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// Triangles of a surface as the shape of a patch. Normals turn evenly from corner to corner (Phong 1975); those of the
/// corners are the mean of the triangles about them, by angle (Thürmer & Wüthrich 1998).
class TriangleShape {
 public:
  /// The triangles must have an area.
  explicit TriangleShape(const TriangleSurface& surface)
      : surface_(surface), tree_(surface), at_corner_(surface.vertices.size(), Vec3d::Zero()) {
    for (const auto& t : surface.triangles)
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
        const Vec3d n = forth.cross(back);
        at_corner_[std::size_t(t[k])] += std::atan2(n.norm(), forth.dot(back)) * n.normalized();
      }
    for (Vec3d& n : at_corner_) n = n.normalized();
  }

  Vec3d closest_point(const Vec3d& p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    return n.triangle < 0 ? p : n.at.point;
  }
  Vec3d normal(const Vec3d& p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    if (n.triangle < 0) return p;
    const auto& t = surface_.triangles[std::size_t(n.triangle)];
    const Vec3d b = corner(t, 1) - corner(t, 0), c = corner(t, 2) - corner(t, 0), at = n.at.point - corner(t, 0);
    const Vec3d across = b.cross(c);
    const double u = at.cross(c).dot(across) / across.squaredNorm(), v = b.cross(at).dot(across) / across.squaredNorm();
    return ((1.0 - u - v) * at_corner_[std::size_t(t[0])] + u * at_corner_[std::size_t(t[1])] +
            v * at_corner_[std::size_t(t[2])])
        .normalized();
  }

 private:
  const Vec3d& corner(const std::array<int, 3>& t, std::size_t k) const { return surface_.vertices[std::size_t(t[k])]; }

  TriangleSurface surface_;
  TriangleTree tree_;
  std::vector<Vec3d> at_corner_;
};

static_assert(SurfaceShape<TriangleShape>);

/// Neighbours whose normals differ by more are parts of their own.
inline constexpr double crease_rad = 0.5;

/// Number of the part, from 0 on, that each triangle belongs to; parts are what creases divide.
inline std::vector<int> smooth_parts(const TriangleSurface& surface, double crease = crease_rad);

/// A closed surface, such as read_surface() gives, as a mesh without elements: Tracer lights it, and a press refuses
/// it. Faces are of the patches that surface_patches() makes. Throws MeshError as validate_surface does.
inline TetMesh surface_mesh(const TriangleSurface& surface, double crease = crease_rad);

/// A patch for each smooth part, "part 0" and so on, whose normals are those of the triangles. Tell them apart by their
/// shapes; those that are planes or spheres may be given them.
inline std::vector<Patch> surface_patches(const TriangleSurface& surface, double crease = crease_rad);

inline std::vector<int> smooth_parts(const TriangleSurface& surface, double crease) {
  validate_surface(surface);
  const std::size_t count = surface.triangles.size();
  std::vector<Vec3d> normal;
  for (const auto& t : surface.triangles) {
    const auto at = [&](std::size_t k) -> const Vec3d& { return surface.vertices[std::size_t(t[k])]; };
    normal.push_back(Vec3d(at(1) - at(0)).cross(at(2) - at(0)).normalized());
  }
  std::vector<std::size_t> root(count);
  std::iota(root.begin(), root.end(), std::size_t(0));
  const auto find = [&](std::size_t i) {
    for (; root[i] != i; i = root[i]) root[i] = root[root[i]];
    return i;
  };
  std::map<std::pair<int, int>, std::size_t> across;
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& t = surface.triangles[i];
      const auto [it, fresh] = across.try_emplace(std::minmax(int(t[k]), int(t[(k + 1) % 3])), i);
      if (fresh || normal[i].dot(normal[it->second]) < std::cos(crease)) continue;
      const std::size_t a = find(i), b = find(it->second);
      root[std::max(a, b)] = std::min(a, b);
    }
  std::map<std::size_t, int> number;
  std::vector<int> parts;
  for (std::size_t i = 0; i < count; ++i)
    parts.push_back(number.try_emplace(find(i), int(number.size())).first->second);
  return parts;
}

inline TetMesh surface_mesh(const TriangleSurface& surface, double crease) {
  const std::vector<int> parts = smooth_parts(surface, crease);
  TetMesh mesh;
  mesh.order = 1;
  mesh.nodes = surface.vertices;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& t = surface.triangles[i];
    mesh.faces.push_back({{t[0], t[1], t[2], -1, -1, -1}, parts[i]});
  }
  std::stable_sort(mesh.faces.begin(), mesh.faces.end(),
      [](const BoundaryFace& a, const BoundaryFace& b) { return a.patch < b.patch; });
  return mesh;
}

inline std::vector<Patch> surface_patches(const TriangleSurface& surface, double crease) {
  const std::vector<int> parts = smooth_parts(surface, crease);
  std::vector<TriangleSurface> part(std::size_t(1 + *std::max_element(parts.begin(), parts.end())));
  for (std::size_t i = 0; i < parts.size(); ++i) part[std::size_t(parts[i])].triangles.push_back(surface.triangles[i]);
  std::vector<Patch> patches(part.size());
  for (std::size_t k = 0; k < part.size(); ++k) {
    part[k].vertices = surface.vertices;
    drop_unused_vertices(part[k]);
    patches[k].name = "part " + std::to_string(k);
    patches[k].shape = TriangleShape(part[k]);
  }
  return patches;
}

}  // namespace lumo
