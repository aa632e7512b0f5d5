#pragma once

#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/elements/simd.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace lumo {

/// Of eight elements: a vector, and a 3 × 3 matrix by columns.
using VectorPack = std::array<SimdPack, 3>;
using MatrixPack = std::array<VectorPack, 3>;

[[gnu::always_inline]] inline SimdPack dot(const VectorPack& a, const VectorPack& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
[[gnu::always_inline]] inline VectorPack cross(const VectorPack& a, const VectorPack& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
[[gnu::always_inline]] inline VectorPack scaled(const SimdPack& s, const VectorPack& v) {
  return {s * v[0], s * v[1], s * v[2]};
}
[[gnu::always_inline]] inline VectorPack product(const MatrixPack& m, const VectorPack& v) {
  VectorPack p;
  for (std::size_t i = 0; i < 3; ++i) p[i] = m[0][i] * v[0] + m[1][i] * v[1] + m[2][i] * v[2];
  return p;
}
/// Derivative of the determinant.
[[gnu::always_inline]] inline MatrixPack cofactor(const MatrixPack& m) {
  return {cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])};
}

/// Deformed nodes, each padded so that one load takes it.
using PaddedPositions = std::vector<SimdPack::Point>;

inline PaddedPositions padded(const Eigen::Matrix3Xd& x) {
  PaddedPositions p(std::size_t(x.cols()));
  for (std::size_t k = 0; k < p.size(); ++k)
    for (std::size_t i = 0; i < 3; ++i) p[k].v[i] = x(Eigen::Index(i), Eigen::Index(k));
  return p;
}

/// The elements of a mesh, eight at a time in their order, with the gradients of their shape functions at rest. The
/// last pack repeats the last element where there is no further one.
template <TetElement Element> class ElementPacks {
 public:
  static constexpr std::size_t width = SimdPack::width, nodes = std::size_t(Element::nodes),
                               points = std::size_t(Element::points);
  struct Pack {
    std::size_t first = 0, count = 0;                            ///< elements
    std::array<std::array<int, width>, nodes> node;              ///< their nodes
    std::array<std::array<VectorPack, nodes>, points> gradient;  ///< [1/m], at the quadrature points
    std::array<SimdPack, points> weight;                         ///< volume that a point stands for [m³]
    SimdPack volume;                                             ///< [m³]
  };
  /// Deformation gradients and volume ratios of a pack.
  struct Deformation {
    std::array<MatrixPack, points> F;
    std::array<SimdPack, points> J;
    SimdPack mean_J;
  };

  /// Throws InvalidArgument where the mesh is not of the element's order.
  explicit ElementPacks(const TetMesh& mesh) {
    const ElementPoints<Element> at(mesh);
    for (std::size_t first = 0; first < mesh.tets.size(); first += width) {
      Pack& p = packs_.emplace_back();
      p.first = first;
      p.count = std::min(width, mesh.tets.size() - first);
      for (std::size_t lane = 0; lane < width; ++lane) {
        const std::size_t e = first + std::min(lane, p.count - 1);
        for (std::size_t a = 0; a < nodes; ++a) p.node[a][lane] = mesh.tets[e][a];
        for (std::size_t q = 0; q < points; ++q) {
          p.weight[q].set(lane, at.weight(e, int(q)));
          for (std::size_t a = 0; a < nodes; ++a)
            for (std::size_t i = 0; i < 3; ++i)
              p.gradient[q][a][i].set(lane, at.gradient(e, int(q))(Eigen::Index(i), Eigen::Index(a)));
        }
      }
      for (const SimdPack& w : p.weight) p.volume += w;
    }
  }

  const std::vector<Pack>& packs() const { return packs_; }

  /// Derivatives of a nodal field by the place at rest, at each quadrature point.
  static std::array<MatrixPack, points> slopes(const Pack& pack, const PaddedPositions& field) {
    std::array<VectorPack, nodes> at;
    for (std::size_t a = 0; a < nodes; ++a) at[a] = SimdPack::gathered(field, pack.node[a]);
    std::array<MatrixPack, points> m{};
    for (std::size_t q = 0; q < points; ++q) {
      MatrixPack sum{};
      for (std::size_t a = 0; a < nodes; ++a)
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i) sum[j][i] += at[a][i] * pack.gradient[q][a][j];
      m[q] = sum;
    }
    return m;
  }
  static Deformation deformation(const Pack& pack, const PaddedPositions& x) {
    Deformation d{slopes(pack, x), {}, {}};
    for (std::size_t q = 0; q < points; ++q) {
      d.J[q] = dot(d.F[q][0], cross(d.F[q][1], d.F[q][2]));
      d.mean_J += pack.weight[q] * d.J[q];
    }
    d.mean_J = d.mean_J / pack.volume;
    return d;
  }

 private:
  std::vector<Pack> packs_;
};

}  // namespace lumo
