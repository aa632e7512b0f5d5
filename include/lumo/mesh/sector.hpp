#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <vector>

namespace lumo {

/// The part of a symmetric mesh on the positive side of some of its symmetry planes, as a mesh of its own.
struct Sector {
  Symmetry planes;  ///< planes that bound it
  TetMesh mesh;
  std::vector<int> to_whole;  ///< sector node → node of the whole mesh

  /// What part of the whole it is: 1, ½ or ¼.
  double fraction() const { return (planes.x ? 0.5 : 1.0) * (planes.y ? 0.5 : 1.0); }
};

/// Throws InvalidArgument when the mesh is not symmetric in a wanted plane.
inline Sector sector_of(const TetMesh& whole, Symmetry planes);

/// A field of vectors on the sector's nodes, mirrored to the whole mesh.
inline std::vector<Vec3d> unfold(const TetMesh& whole, const Sector& sector, const std::vector<Vec3d>& field);

/// A field of numbers on the sector's nodes, mirrored to the whole mesh.
inline std::vector<double> unfold(const TetMesh& whole, const Sector& sector, const std::vector<double>& field);

inline Sector sector_of(const TetMesh& whole, Symmetry planes) {
  if ((planes.x && !whole.symmetry.x) || (planes.y && !whole.symmetry.y))
    throw InvalidArgument("sector: the mesh is not symmetric in the wanted plane");
  Sector s;
  s.planes = planes;
  s.mesh.order = whole.order;
  std::vector<int> number(whole.nodes.size(), -1);
  for (std::size_t k = 0; k < whole.nodes.size(); ++k) {
    if ((planes.x && whole.nodes[k].x() < 0.0) || (planes.y && whole.nodes[k].y() < 0.0)) continue;
    number[k] = int(s.to_whole.size());
    s.to_whole.push_back(int(k));
    s.mesh.nodes.push_back(whole.nodes[k]);
  }
  const auto keep = [&](const auto& nodes, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i)
      if (number[std::size_t(nodes[i])] < 0) return false;
    return true;
  };
  const auto renumber = [&](auto nodes) {
    for (int& n : nodes) n = n < 0 ? n : number[std::size_t(n)];
    return nodes;
  };
  for (const auto& t : whole.tets)
    if (keep(t, std::size_t(whole.nodes_per_tet()))) s.mesh.tets.push_back(renumber(t));
  for (const BoundaryFace& f : whole.faces)
    if (keep(f.nodes, std::size_t(whole.nodes_per_face()))) s.mesh.faces.push_back({renumber(f.nodes), f.patch});
  return s;
}

namespace detail {

template <class T, class Flip>
std::vector<T> unfolded(const TetMesh& whole, const Sector& sector, const std::vector<T>& field, Flip flip) {
  std::vector<T> all(whole.nodes.size());
  for (std::size_t k = 0; k < field.size(); ++k) all[std::size_t(sector.to_whole[k])] = field[k];
  const auto reflect = [&](const std::vector<int>& partner, int axis) {
    for (std::size_t k = 0; k < whole.nodes.size(); ++k)
      if (whole.nodes[k][axis] < 0.0) all[k] = flip(all[std::size_t(partner[k])], axis);
  };
  if (sector.planes.x) reflect(whole.mirror_x, 0);
  if (sector.planes.y) reflect(whole.mirror_y, 1);
  return all;
}

}  // namespace detail

inline std::vector<Vec3d> unfold(const TetMesh& whole, const Sector& sector, const std::vector<Vec3d>& field) {
  return detail::unfolded(whole, sector, field, [](Vec3d v, int axis) {
    v[axis] = -v[axis];
    return v;
  });
}

inline std::vector<double> unfold(const TetMesh& whole, const Sector& sector, const std::vector<double>& field) {
  return detail::unfolded(whole, sector, field, [](double v, int) { return v; });
}

}  // namespace lumo
