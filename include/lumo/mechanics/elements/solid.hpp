#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/elements/element_packs.hpp"
#include "lumo/mechanics/elements/equations.hpp"
#include "lumo/mechanics/materials/material.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <limits>
#include <vector>

namespace lumo {

/// Deformed node positions, 3 × nodes [m].
using Positions = Eigen::Matrix3Xd;

inline Positions positions_of(const TetMesh& mesh) {
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k];
  return x;
}

/// A solid whose distortion is μ/2 (I_C − 3) + g(J), with derivatives that are cheap enough to be taken for many
/// elements at once.
template <class M>
concept DilatationalDistortion = HyperelasticMaterial<M> && requires(const M& m, const SimdPack& J) {
  { m.distortion_dilatation(J) } -> std::same_as<DilatationSample<SimdPack>>;
};

/// How the volumes of a deformed mesh have changed.
struct VolumeRatios {
  std::vector<double> J;  ///< that the volumetric energy sees: one per element with the locking cure, else one per
                          ///< quadrature point
  double smallest = std::numeric_limits<double>::infinity();  ///< det F over all quadrature points
};

/// The elastic energy of a tetrahedral mesh with its first and second derivative, eight elements at a time.
template <HyperelasticMaterial Material, TetElement Element> class Solid {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  Solid(const TetMesh& mesh, Material material, Element element)
      : material_(material), element_(element), elements_(mesh), tets_(mesh.tets.size()) {}

  /// Stored energy [J]; +∞ when an element is inverted at a quadrature point.
  double energy(const Positions& x) const {
    const PaddedPositions at = padded(x);
    double sum = 0.0;
    for (const Pack& p : elements_.packs()) {
      const Deformation d = Elements::deformation(p, at);
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        for (std::size_t q = 0; q < points; ++q) {
          sum += p.weight[q][lane] * material_.distortion_energy(of_lane(d.F[q], lane));
          if (!element_.mean_dilatation) sum += p.weight[q][lane] * material_.volumetric(d.J[q][lane]).energy;
        }
        if (element_.mean_dilatation) sum += p.volume[lane] * material_.volumetric(d.mean_J[lane]).energy;
      }
      if (!std::isfinite(sum)) return std::numeric_limits<double>::infinity();
    }
    return sum;
  }

  VolumeRatios volume_ratios(const Positions& x) const {
    const PaddedPositions at = padded(x);
    VolumeRatios v;
    v.J.resize(tets_ * cells());
    for (const Pack& p : elements_.packs()) {
      const Deformation d = Elements::deformation(p, at);
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        for (std::size_t q = 0; q < points; ++q) v.smallest = std::min(v.smallest, d.J[q][lane]);
        for (std::size_t c = 0; c < cells(); ++c)
          v.J[(p.first + lane) * cells() + c] = element_.mean_dilatation ? d.mean_J[lane] : d.J[c][lane];
      }
    }
    return v;
  }

  /// Adds to volume ratios what the displacement dx changes along the slope that they have at the positions `linear`.
  void carry_on(std::vector<double>& J, const Positions& linear, const Positions& dx) const {
    const PaddedPositions at = padded(linear), by = padded(dx);
    for (const Pack& p : elements_.packs()) {
      const std::array<MatrixPack, points> F = Elements::slopes(p, at), dF = Elements::slopes(p, by);
      SimdPack mean;
      for (std::size_t q = 0; q < points; ++q) {
        const MatrixPack c = cofactor(F[q]);
        const SimdPack rate = dot(c[0], dF[q][0]) + dot(c[1], dF[q][1]) + dot(c[2], dF[q][2]);
        mean += p.weight[q] * rate;
        if (!element_.mean_dilatation)
          for (std::size_t lane = 0; lane < p.count; ++lane) J[(p.first + lane) * points + q] += rate[lane];
      }
      mean = mean / p.volume;
      if (element_.mean_dilatation)
        for (std::size_t lane = 0; lane < p.count; ++lane) J[p.first + lane] += mean[lane];
    }
  }

  /// Adds the nodal forces ∂energy/∂x [N] to `force` (3 × nodes). The volumetric stress is linearised `about` given
  /// volume ratios θ, U'(θ) + U''(θ)(J − θ): see QuasiStatic.
  void add_forces(const Positions& x, Positions& force, const std::vector<double>* about = nullptr) const {
    const PaddedPositions at = padded(x);
    for (const Pack& p : elements_.packs()) {
      const Deformation d = Elements::deformation(p, at);
      std::array<VectorPack, nodes> f{};
      SimdPack theta;
      Volumetric u;
      for (std::size_t q = 0; q < points; ++q) {
        const MatrixPack c = cofactor(d.F[q]);
        if (q < cells()) u = volumetric(theta = ratio(p, q, d, about));
        const MatrixPack s = distortion_stress(d.F[q], d.J[q], c);
        const SimdPack pressure = u.stress + u.stiffness * ((element_.mean_dilatation ? d.mean_J : d.J[q]) - theta);
        MatrixPack P;
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i) P[j][i] = p.weight[q] * (s[j][i] + pressure * c[j][i]);
        for (std::size_t a = 0; a < nodes; ++a) {
          const VectorPack share = product(P, p.gradient[q][a]);
          for (std::size_t i = 0; i < 3; ++i) f[a][i] += share[i];
        }
      }
      for (std::size_t lane = 0; lane < p.count; ++lane)
        for (std::size_t a = 0; a < nodes; ++a)
          for (std::size_t i = 0; i < 3; ++i) force(Eigen::Index(i), p.node[a][lane]) += f[a][i][lane];
    }
  }

  /// Adds the tangent [N/m] to the values of each system's lower triangle; the element matrices are made once for all.
  void add_tangent(const Positions& x, const std::vector<const Equations*>& systems, const std::vector<double*>& values,
      const std::vector<double>* about = nullptr) const {
    const PaddedPositions at = padded(x);
    for (const Pack& p : elements_.packs()) add_tangent(p, Elements::deformation(p, at), systems, values, about);
  }

  /// Smallest undeformed volume that a quadrature point stands for [m³]; not positive where the mesh has an element
  /// that is inside out.
  double smallest_volume() const {
    double least = std::numeric_limits<double>::infinity();
    for (const Pack& p : elements_.packs())
      for (const SimdPack& w : p.weight)
        for (std::size_t lane = 0; lane < p.count; ++lane) least = std::min(least, w[lane]);
    return least;
  }

  const Material& material() const { return material_; }

 private:
  using Elements = ElementPacks<Element>;
  using Pack = typename Elements::Pack;
  using Deformation = typename Elements::Deformation;
  static constexpr std::size_t nodes = Elements::nodes, points = Elements::points, width = Elements::width;
  static constexpr std::size_t size = 3 * nodes;  // of an element's tangent

  static Mat3d of_lane(const MatrixPack& m, std::size_t lane) {
    Mat3d one;
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t i = 0; i < 3; ++i) one(Eigen::Index(i), Eigen::Index(j)) = m[j][i][lane];
    return one;
  }

  std::size_t cells() const { return element_.mean_dilatation ? 1 : points; }

  // Volume ratios that the volumetric energy is taken at: with the locking cure the same at all points.
  SimdPack ratio(const Pack& p, std::size_t q, const Deformation& d, const std::vector<double>* about) const {
    if (!about) return element_.mean_dilatation ? d.mean_J : d.J[q];
    SimdPack theta;
    for (std::size_t lane = 0; lane < width; ++lane)
      theta.set(lane, (*about)[(p.first + std::min(lane, p.count - 1)) * cells() + (element_.mean_dilatation ? 0 : q)]);
    return theta;
  }

  struct Volumetric {
    SimdPack stress, stiffness;
  };
  Volumetric volumetric(const SimdPack& J) const {
    Volumetric u;
    for (std::size_t lane = 0; lane < width; ++lane) {
      const VolumetricSample<double> one = material_.volumetric(J[lane]);
      u.stress.set(lane, one.stress);
      u.stiffness.set(lane, one.stiffness);
    }
    return u;
  }

  MatrixPack distortion_stress(const MatrixPack& F, const SimdPack& J, const MatrixPack& c) const {
    MatrixPack P;
    if constexpr (DilatationalDistortion<Material>) {
      const SimdPack mu = SimdPack::of(material_.shear_modulus()), stress = material_.distortion_dilatation(J).stress;
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t i = 0; i < 3; ++i) P[j][i] = mu * F[j][i] + stress * c[j][i];
    } else {
      for (std::size_t lane = 0; lane < width; ++lane) {
        const Mat3d one = material_.distortion_stress(of_lane(F, lane));
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i) P[j][i].set(lane, one(Eigen::Index(i), Eigen::Index(j)));
      }
    }
    return P;
  }

  // Entries of the lower triangles of a pack's tangents, column by column, as Equations::slots has them.
  using Entries = std::array<SimdPack, size*(size + 1) / 2>;

  // Sets the part of node b's rows and node a's columns, b ≥ a, from block[j][i] of row 3 b + i and column 3 a + j.
  static void set_block(Entries& entries, std::size_t b, std::size_t a, const MatrixPack& block) {
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t column = 3 * a + j, start = column * size - column * (column + 1) / 2;
      for (std::size_t i = b == a ? j : 0; i < 3; ++i) entries[start + 3 * b + i] = block[j][i];
    }
  }

  // Element by element: block by block would go through the slots of eight at once, which takes half as long again.
  static void scatter(const Pack& p, const Entries& entries, const std::vector<const Equations*>& systems,
      const std::vector<double*>& values) {
    for (std::size_t k = 0; k < systems.size(); ++k)
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        const int* slots = systems[k]->slots.data() + (p.first + lane) * entries.size();
        for (std::size_t m = 0; m < entries.size(); ++m)
          if (slots[m] >= 0) values[k][slots[m]] += entries[m][lane];
      }
  }

  // With Aₐ = cof F gₐ: blocks Σ w (μ gₐ·g_b I + g'' A_b Aₐᵀ + (p/J) [A_b × Aₐ]), p all that presses, and the stiffness
  // against a change of volume.
  void add_tangent(const Pack& p, const Deformation& d, const std::vector<const Equations*>& systems,
      const std::vector<double*>& values,
      const std::vector<double>* about) const requires DilatationalDistortion<Material> {
    const SimdPack mu = SimdPack::of(material_.shear_modulus());
    struct Point {
      std::array<VectorPack, nodes> area, stiff, turn, stretch;
    };
    std::array<Point, points> at;
    std::array<VectorPack, nodes> dJ{};  // V ∂(mean J)/∂x
    SimdPack bulk;
    Volumetric u;
    for (std::size_t q = 0; q < points; ++q) {
      const MatrixPack c = cofactor(d.F[q]);
      if (q < cells()) u = volumetric(ratio(p, q, d, about));
      const DilatationSample<SimdPack> g = material_.distortion_dilatation(d.J[q]);
      const SimdPack w = p.weight[q], turning = w * (g.stress + u.stress) / d.J[q],
                     stiffness = w * (element_.mean_dilatation ? g.stiffness : g.stiffness + u.stiffness);
      if (q == 0) bulk = u.stiffness / p.volume;
      for (std::size_t a = 0; a < nodes; ++a) {
        const VectorPack area = product(c, p.gradient[q][a]);
        at[q].area[a] = area;
        at[q].stiff[a] = scaled(stiffness, area);
        at[q].turn[a] = scaled(turning, area);
        at[q].stretch[a] = scaled(w * mu, p.gradient[q][a]);
        for (std::size_t i = 0; i < 3; ++i) dJ[a][i] += w * area[i];
      }
    }
    Entries entries;
    for (std::size_t a = 0; a < nodes; ++a)
      for (std::size_t b = a; b < nodes; ++b) {
        MatrixPack block{};
        SimdPack stretch;
        VectorPack turn{};
        for (std::size_t q = 0; q < points; ++q) {
          stretch += dot(at[q].stretch[b], p.gradient[q][a]);
          const VectorPack n = cross(at[q].turn[b], at[q].area[a]);
          for (std::size_t i = 0; i < 3; ++i) turn[i] += n[i];
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i) block[j][i] += at[q].stiff[b][i] * at[q].area[a][j];
        }
        if (element_.mean_dilatation) {
          const VectorPack stiff = scaled(bulk, dJ[b]);
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i) block[j][i] += stiff[i] * dJ[a][j];
        }
        for (std::size_t i = 0; i < 3; ++i) {
          const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
          block[i][i] += stretch;
          block[j][i] += turn[k];
          block[i][j] -= turn[k];
        }
        set_block(entries, b, a, block);
      }
    scatter(p, entries, systems, values);
  }

  void add_tangent(const Pack& p, const Deformation& d, const std::vector<const Equations*>& systems,
      const std::vector<double*>& values, const std::vector<double>* about) const {
    std::array<std::array<MatrixPack, nodes>, nodes> K{};  // of columns' and rows' nodes
    std::array<VectorPack, nodes> dJ{};
    SimdPack bulk;
    Volumetric u;
    for (std::size_t q = 0; q < points; ++q) {
      const MatrixPack c = cofactor(d.F[q]);
      if (q < cells()) u = volumetric(ratio(p, q, d, about));
      if (q == 0) bulk = u.stiffness / p.volume;
      for (std::size_t a = 0; a < nodes; ++a) {
        const VectorPack area = product(c, p.gradient[q][a]);
        for (std::size_t i = 0; i < 3; ++i) dJ[a][i] += p.weight[q] * area[i];
      }
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        const Mat3d F = of_lane(d.F[q], lane), cof = of_lane(c, lane);
        Mat9d A = material_.distortion_tangent(F) + u.stress[lane] * determinant_hessian(F);
        if (!element_.mean_dilatation) A += dyad(u.stiffness[lane] * cof, cof);
        A = A * p.weight[q][lane];
        for (std::size_t a = 0; a < nodes; ++a) {
          const auto slope = [&](std::size_t node, std::size_t i) { return p.gradient[q][node][i][lane]; };
          std::array<double, 27> T;  // 9 × 3, by columns
          for (std::size_t k = 0; k < 27; ++k)
            T[k] = A.data()[k] * slope(a, 0) + A.data()[k + 27] * slope(a, 1) + A.data()[k + 54] * slope(a, 2);
          for (std::size_t b = a; b < nodes; ++b)
            for (std::size_t j = 0; j < 3; ++j)
              for (std::size_t i = 0; i < 3; ++i) {
                SimdPack& entry = K[a][b][j][i];
                const double* t = T.data() + 9 * j + i;
                entry.set(lane, entry[lane] + slope(b, 0) * t[0] + slope(b, 1) * t[3] + slope(b, 2) * t[6]);
              }
        }
      }
    }
    Entries entries;
    for (std::size_t a = 0; a < nodes; ++a)
      for (std::size_t b = a; b < nodes; ++b) {
        if (element_.mean_dilatation) {
          const VectorPack stiff = scaled(bulk, dJ[b]);
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i) K[a][b][j][i] += stiff[i] * dJ[a][j];
        }
        set_block(entries, b, a, K[a][b]);
      }
    scatter(p, entries, systems, values);
  }

  Material material_;
  Element element_;
  Elements elements_;
  std::size_t tets_;
};

}  // namespace lumo
