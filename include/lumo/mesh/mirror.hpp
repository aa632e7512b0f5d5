#pragma once

#include "lumo/mesh/tet_mesh.hpp"

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

}  // namespace lumo
