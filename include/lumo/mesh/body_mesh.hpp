#pragma once

#include "lumo/mesh/body_check.hpp"
#include "lumo/mesh/mesher.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <vector>

namespace lumo {

/// The mesh together with its mirror image in the plane x = 0 (`axis` 0) or y = 0 (`axis` 1). Nodes with that
/// coordinate exactly 0 are shared; all other nodes lie on the positive side. Original nodes keep their numbers; images
/// follow.
inline TetMesh mirrored(const TetMesh& half, int axis) {
  TetMesh whole = half;
  const std::size_t n = half.nodes.size();
  std::vector<int> image(n);
  for (std::size_t k = 0; k < n; ++k) {
    if (half.nodes[k][axis] == 0.0) {
      image[k] = int(k);
      continue;
    }
    image[k] = int(whole.nodes.size());
    Vec3d x = half.nodes[k];
    x[axis] = -x[axis];
    whole.nodes.push_back(x);
  }
  const auto of = [&](int node) { return node < 0 ? node : image[std::size_t(node)]; };
  // A mirror image has the other orientation: exchange two corners, and the edge nodes that go with them.
  for (const auto& t : half.tets)
    whole.tets.push_back(
        {of(t[1]), of(t[0]), of(t[2]), of(t[3]), of(t[4]), of(t[6]), of(t[5]), of(t[8]), of(t[7]), of(t[9])});
  for (const BoundaryFace& f : half.faces)
    whole.faces.push_back(
        {{of(f.nodes[1]), of(f.nodes[0]), of(f.nodes[2]), of(f.nodes[3]), of(f.nodes[5]), of(f.nodes[4])}, f.patch});

  std::vector<int> partner(whole.nodes.size());
  for (std::size_t k = 0; k < n; ++k) {
    partner[k] = image[k];
    partner[std::size_t(image[k])] = int(k);
  }
  // The other plane's pairing carries over to the images.
  const auto extended = [&](const std::vector<int>& pairs) {
    std::vector<int> all(pairs);
    all.resize(whole.nodes.size());
    for (std::size_t k = 0; k < pairs.size(); ++k) all[std::size_t(image[k])] = image[std::size_t(pairs[k])];
    return all;
  };
  if (axis == 0) {
    whole.symmetry.x = true;
    whole.mirror_x = partner;
    if (half.symmetry.y) whole.mirror_y = extended(half.mirror_y);
  } else {
    whole.symmetry.y = true;
    whole.mirror_y = partner;
    if (half.symmetry.x) whole.mirror_x = extended(half.mirror_x);
  }
  return whole;
}

/// Meshes a body: its sector is filled with tetrahedra, boundary nodes are moved to the exact shapes, edges get middle
/// nodes (also on the exact shapes, `order` 2), and the mirror images are added, so that the mesh is exactly symmetric
/// where the body is. Throws MeshError when the surface is bad, the mesher fails, or the result fails a quality gate:
/// require_valid(), and require_on_shapes() of the facets' vertices.
template <Mesher M> TetMesh mesh_body(const Body& body, const M& mesher, int order = 2);

namespace detail {

// Patches that meet at each vertex or edge of the sector's boundary.
using PatchSet = std::set<int>;

// Signed distance of a point from a patch's shape, and the normal there.
struct OffShape {
  double gap;
  Vec3d normal;
};

inline OffShape off_shape(const Body& body, int patch, const Vec3d& p) {
  const Shape& shape = body.patches[std::size_t(patch)].shape;
  const Vec3d n = outward_normal(shape, p);
  return {n.dot(p - closest_point(shape, p)), n};
}

// Newton's shortest step to where two patches meet; it halves the way where they touch (a double root).
inline Vec3d toward_seam(const Body& body, int first, int second, const Vec3d& p) {
  const auto [g, m] = off_shape(body, first, p);
  const auto [h, n] = off_shape(body, second, p);
  const double c = m.dot(n), sine2 = m.cross(n).squaredNorm();
  if (!(sine2 > 1e-20)) return Vec3d::Zero();
  return -((g - c * h) / sine2) * m - ((h - c * g) / sine2) * n;
}

// Onto all of the patches: by turns, which is all that it takes where they meet at right angles, then by Newton's
// method.
inline Vec3d snapped(const Body& body, const PatchSet& patches, std::type_identity_t<Vec3d> p, double tiny) {
  std::vector<int> real;
  std::copy_if(patches.begin(), patches.end(), std::back_inserter(real), [](int patch) { return patch >= 0; });
  for (int round = 0; round < 2; ++round)
    for (int patch : real) p = closest_point(body.patches[std::size_t(patch)].shape, p);
  const auto is_off = [&](int patch) { return !(std::abs(off_shape(body, patch, p).gap) <= tiny); };
  constexpr int most_rounds = 60;
  for (int round = 0; round < most_rounds && real.size() > 1; ++round) {
    if (std::none_of(real.begin(), real.end(), is_off)) break;
    for (std::size_t i = 0; i < real.size(); ++i)
      for (std::size_t j = i + 1; j < real.size(); ++j) p = p + toward_seam(body, real[i], real[j], p);
  }
  if (body.symmetry.x && std::abs(p.x()) < tiny) p.x() = 0.0;
  if (body.symmetry.y && std::abs(p.y()) < tiny) p.y() = 0.0;
  return p;
}

inline void make_quadratic(
    const Body& body, TetMesh& mesh, const std::map<std::pair<int, int>, PatchSet>& boundary_edges, double tiny) {
  std::map<std::pair<int, int>, int> middle;
  const auto middle_of = [&](int a, int b) {
    const std::pair<int, int> key = std::minmax(a, b);
    const auto [it, fresh] = middle.try_emplace(key, int(mesh.nodes.size()));
    if (fresh) {
      const Vec3d &from = mesh.nodes[std::size_t(a)], &to = mesh.nodes[std::size_t(b)], half = 0.5 * (from + to);
      const auto on_surface = boundary_edges.find(key);
      mesh.nodes.push_back(on_surface == boundary_edges.end() ? half : snapped(body, on_surface->second, half, tiny));
    }
    return it->second;
  };
  for (auto& t : mesh.tets)
    for (std::size_t k = 0; k < 6; ++k)
      t[4 + k] = middle_of(t[std::size_t(tet_edges[k][0])], t[std::size_t(tet_edges[k][1])]);
  for (BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) f.nodes[3 + k] = middle_of(f.nodes[k], f.nodes[(k + 1) % 3]);
  mesh.order = 2;
}

}  // namespace detail

template <Mesher M> TetMesh mesh_body(const Body& body, const M& mesher, int order) {
  if (order != 1 && order != 2) throw InvalidArgument(message("mesh order is ", order, ", must be 1 or 2"));
  const double stretch = body.sizing.stretch_y;
  require_positive("mesh stretch along y", stretch, "");
  require_on_shapes(body);
  MeshInput input;
  input.facets = body.facets;
  // In squeezed space wanted edges are equally long in all directions; lengths in mm keep the mesher's tolerances away
  // from zero.
  for (const Vec3d& v : body.vertices) input.vertices.emplace_back(1e3 * v.x(), 1e3 * v.y() / stretch, 1e3 * v.z());
  if (body.sizing.edge)
    input.edge = [&body, stretch](
                     const Vec3d& p) { return 1e3 * body.sizing.edge(1e-3 * Vec3d(p.x(), p.y() * stretch, p.z())); };
  const auto filled = mesher.fill(input);

  TetMesh mesh;
  mesh.order = 1;
  for (const Vec3d& v : filled.vertices) mesh.nodes.emplace_back(1e-3 * v.x(), 1e-3 * v.y() * stretch, 1e-3 * v.z());
  double size = 0.0;
  for (const Vec3d& v : body.vertices) size = std::max(size, v.lpNorm<Eigen::Infinity>());
  const double tiny = 1e-9 * size;
  for (const auto& t : filled.tets) mesh.tets.push_back({t[0], t[1], t[2], t[3], -1, -1, -1, -1, -1, -1});

  std::map<int, detail::PatchSet> vertex_patches;
  std::map<std::pair<int, int>, detail::PatchSet> edge_patches;
  for (std::size_t f = 0; f < filled.faces.size(); ++f) {
    const auto& face = filled.faces[f];
    const int patch = filled.patches[f];
    for (std::size_t k = 0; k < 3; ++k) {
      vertex_patches[face[k]].insert(patch);
      edge_patches[std::minmax(face[k], face[(k + 1) % 3])].insert(patch);
    }
    if (patch != Body::mirror_patch) mesh.faces.push_back({{face[0], face[1], face[2], -1, -1, -1}, patch});
  }
  for (const auto& [vertex, patches] : vertex_patches)
    mesh.nodes[std::size_t(vertex)] = detail::snapped(body, patches, mesh.nodes[std::size_t(vertex)], tiny);
  if (order == 2) detail::make_quadratic(body, mesh, edge_patches, tiny);
  if (body.symmetry.x) mesh = mirrored(mesh, 0);
  if (body.symmetry.y) mesh = mirrored(mesh, 1);
  std::stable_sort(mesh.faces.begin(), mesh.faces.end(),
      [](const BoundaryFace& a, const BoundaryFace& b) { return a.patch < b.patch; });
  // The faces of a straight-sided mesh cut the curved profile short; only the quadratic one is held to the exact
  // volume.
  require_valid(mesh, order == 2 ? body.exact_volume_m3 : 0.0);
  return mesh;
}

}  // namespace lumo
