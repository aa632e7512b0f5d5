#pragma once

#include "lumo/mesh/mesher.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <set>
#include <vector>

namespace own {

//! [mesher]
/// Another mesher's tetrahedra, each inner vertex moved to the middle of its neighbours where no tetrahedron becomes
/// flatter than the flattest one there was.
template <lumo::Mesher M> struct Relaxed {
  M mesher{};
  int rounds = 3;

  lumo::LinearTets fill(const lumo::MeshInput& input) const {
    lumo::LinearTets mesh = mesher.fill(input);
    const std::size_t count = mesh.vertices.size();
    std::vector<std::set<int>> neighbours(count);
    std::vector<std::vector<std::size_t>> around(count);  // tetrahedra
    std::vector<char> stays(count, 0);
    for (std::size_t k = 0; k < input.vertices.size(); ++k) stays[k] = 1;
    for (const auto& face : mesh.faces)
      for (const int v : face) stays[std::size_t(v)] = 1;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t)
      for (const int v : mesh.tets[t]) {
        around[std::size_t(v)].push_back(t);
        neighbours[std::size_t(v)].insert(mesh.tets[t].begin(), mesh.tets[t].end());
      }
    const auto least_volume = [&](std::size_t v) {
      double least = 1e300;
      for (const std::size_t t : around[v]) least = std::min(least, volume(mesh, mesh.tets[t]));
      return least;
    };
    for (int round = 0; round < rounds; ++round)
      for (std::size_t v = 0; v < count; ++v) {
        if (stays[v] || around[v].empty()) continue;
        const lumo::Vec3d was = mesh.vertices[v];
        const double least = least_volume(v);
        lumo::Vec3d middle = -was;  // a vertex is among its own neighbours
        for (const int n : neighbours[v]) middle += mesh.vertices[std::size_t(n)];
        mesh.vertices[v] = middle / double(neighbours[v].size() - 1);
        if (least_volume(v) < least) mesh.vertices[v] = was;
      }
    return mesh;
  }

  static double volume(const lumo::LinearTets& mesh, const std::array<int, 4>& t) {
    const auto at = [&](std::size_t k) -> const lumo::Vec3d& { return mesh.vertices[std::size_t(t[k])]; };
    return (at(1) - at(0)).cross(at(2) - at(0)).dot(at(3) - at(0)) / 6.0;
  }
};
//! [mesher]

}  // namespace own
