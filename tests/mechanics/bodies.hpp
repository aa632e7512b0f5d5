#pragma once

#include "lumo/mesh/body_mesh.hpp"
#include "lumo/mesh/quality.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"

#include <map>

// A block [0, size] cut into n × n × n cells of six tetrahedra, and bodies to go with it: no mesher needed.
namespace lumo::test {

/// Patches of a block body: 0 bottom (bonded), 1 top (contactable), 2 sides.
inline Body block_body(const Vec3d& size) {
  Body b;
  b.name = "block";
  b.patches = {{"bottom", Plane{Vec3d::Zero(), -Vec3d::UnitZ()}, true, false, false, Lambertian{}},
      {"top", Plane{{0, 0, size.z()}, Vec3d::UnitZ()}, false, true, false, Dielectric{}},
      {"side", Plane{{size.x(), 0, 0}, Vec3d::UnitX()}, false, false, false, Dielectric{}}};
  b.exact_volume_m3 = size.prod();
  b.pivot = {0, 0, size.z()};
  return b;
}

/// Places of the grid lines along one direction, as fractions.
inline std::vector<double> even(int n) {
  std::vector<double> x;
  for (int i = 0; i <= n; ++i) x.push_back(double(i) / n);
  return x;
}

/// Outer faces of a block's tets: patch 0 at the bottom, 1 at the top, 2 at the sides; none on the planes of a quarter.
inline void add_block_faces(TetMesh& m, double height, bool quarter) {
  std::map<std::array<int, 3>, std::array<int, 3>> open;
  static constexpr int sides[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  for (const auto& t : m.tets)
    for (const auto& s : sides) {
      const std::array<int, 3> f{t[std::size_t(s[0])], t[std::size_t(s[1])], t[std::size_t(s[2])]};
      auto key = f;
      std::sort(key.begin(), key.end());
      if (!open.emplace(key, f).second) open.erase(key);
    }
  for (const auto& side : open) {
    const std::array<int, 3>& f = side.second;
    const auto all = [&](int axis, double value) {
      for (int n : f)
        if (std::abs(m.nodes[std::size_t(n)][axis] - value) > 1e-12) return false;
      return true;
    };
    if (quarter && (all(0, 0.0) || all(1, 0.0))) continue;
    m.faces.push_back({{f[0], f[1], f[2], -1, -1, -1}, all(2, 0.0) ? 0 : all(2, height) ? 1 : 2});
  }
}

/// Nodes in the middle of all edges.
inline void add_middles(TetMesh& m) {
  std::map<std::pair<int, int>, int> middle;
  const auto mid = [&](int a, int b) {
    const auto [it, fresh] = middle.try_emplace(std::minmax(a, b), int(m.nodes.size()));
    if (fresh) m.nodes.push_back(0.5 * (m.nodes[std::size_t(a)] + m.nodes[std::size_t(b)]));
    return it->second;
  };
  for (auto& t : m.tets)
    for (std::size_t e = 0; e < 6; ++e)
      t[4 + e] = mid(t[std::size_t(tet_edges[e][0])], t[std::size_t(tet_edges[e][1])]);
  for (auto& f : m.faces)
    for (std::size_t e = 0; e < 3; ++e) f.nodes[3 + e] = mid(f.nodes[e], f.nodes[(e + 1) % 3]);
  m.order = 2;
}

/// Quadratic (or linear) tetrahedra on a grid. Faces in the planes x = 0 and y = 0 are left out when `quarter`.
inline TetMesh block_mesh(const Vec3d& size, const std::vector<double>& gx, const std::vector<double>& gy,
    const std::vector<double>& gz, int order, bool quarter) {
  TetMesh m;
  m.order = 1;
  const int nx = int(gx.size()) - 1, ny = int(gy.size()) - 1, nz = int(gz.size()) - 1;
  const auto id = [&](int i, int j, int k) { return i + (nx + 1) * (j + (ny + 1) * k); };
  for (int k = 0; k <= nz; ++k)
    for (int j = 0; j <= ny; ++j)
      for (int i = 0; i <= nx; ++i)
        m.nodes.emplace_back(
            size.x() * gx[std::size_t(i)], size.y() * gy[std::size_t(j)], size.z() * gz[std::size_t(k)]);
  static constexpr int paths[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i)
        for (const auto& path : paths) {
          std::array<int, 3> at{i, j, k};
          std::array<int, 10> t;
          t.fill(-1);
          t[0] = id(at[0], at[1], at[2]);
          for (int s = 0; s < 3; ++s) {
            ++at[std::size_t(path[s])];
            t[std::size_t(s + 1)] = id(at[0], at[1], at[2]);
          }
          const auto& x = m.nodes;
          const auto p = [&](int q) { return x[std::size_t(t[std::size_t(q)])]; };
          if ((p(1) - p(0)).cross(p(2) - p(0)).dot(p(3) - p(0)) < 0) std::swap(t[1], t[2]);
          m.tets.push_back(t);
        }
  add_block_faces(m, size.z(), quarter);
  if (order == 2) add_middles(m);
  return m;
}

/// A block for tests that look at every element.
inline const Vec3d small_size(8e-3, 6e-3, 5e-3);

template <class Element> TetMesh small_mesh() {
  return block_mesh(small_size, even(2), even(2), even(2), Element::order, false);
}

/// A block 2a × 2b × h about the z axis as the mirrored quarter a × b × h, and its body.
inline std::pair<Body, TetMesh> symmetric_block(const Vec3d& half, const std::vector<double>& gx,
    const std::vector<double>& gy, const std::vector<double>& gz, int order = 2) {
  Body b = block_body(half);
  b.symmetry = {true, true};
  b.exact_volume_m3 = 4.0 * half.prod();
  return {b, mirrored(mirrored(block_mesh(half, gx, gy, gz, order, true), 0), 1)};
}

/// The same block for a mesher: its quarter as a closed surface, fine about the middle of the top.
inline Body block_to_mesh(const Vec3d& half, double finest, double growth, double coarsest) {
  Body b = block_body(half);
  b.symmetry = {true, true};
  b.exact_volume_m3 = 4.0 * half.prod();
  for (int k = 0; k < 8; ++k)
    b.vertices.emplace_back(k & 1 ? half.x() : 0.0, k & 2 ? half.y() : 0.0, k & 4 ? half.z() : 0.0);
  b.patches[2].shape = Plane{{half.x(), 0, 0}, Vec3d::UnitX()};
  b.patches.push_back({"end", Plane{{0, half.y(), 0}, Vec3d::UnitY()}, false, false, false, Dielectric{}});
  b.facets = {{{0, 2, 3, 1}, 0}, {{4, 5, 7, 6}, 1}, {{1, 3, 7, 5}, 2}, {{2, 6, 7, 3}, 3},
      {{0, 4, 6, 2}, Body::mirror_patch}, {{0, 1, 5, 4}, Body::mirror_patch}};
  const Vec3d top(0, 0, half.z());
  b.sizing.edge = [=](const Vec3d& p) {
    return std::min(coarsest, finest + growth * (p - top).norm() + 0.5 * (top - p).z());
  };
  return b;
}

/// A smooth displacement of a few percent, for derivative tests.
inline Vec3d wavy(const Vec3d& x, double size) {
  return 0.03 * size *
         Vec3d(std::sin(3 * x.y() / size + x.z() / size), std::cos(2 * x.x() / size) - 1.0 + x.z() / size,
             std::sin(2 * x.x() / size + x.y() / size));
}

}  // namespace lumo::test
