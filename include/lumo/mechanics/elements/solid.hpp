#pragma once

#include "lumo/core/error.hpp"
#include "lumo/mechanics/elements/element.hpp"
#include "lumo/mechanics/elements/equations.hpp"
#include "lumo/mechanics/materials/material.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <cmath>
#include <vector>

namespace lumo {

/// Deformed node positions, 3 × nodes [m].
using Positions = Eigen::Matrix3Xd;

inline Positions positions_of(const TetMesh& mesh) {
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k];
  return x;
}

/// The elastic energy of a tetrahedral mesh with its first and second derivatives.
template <HyperelasticMaterial Material, TetElement Element> class Solid {
 public:
  static constexpr int N = Element::nodes;
  using Gradients = Eigen::Matrix<double, 3, N>;

  /// Throws InvalidArgument where the mesh is not of the element's order.
  Solid(const TetMesh& mesh, Material material, Element element)
      : mesh_(&mesh), material_(material), element_(element), points_(mesh) {}

  /// Stored energy [J]; +∞ when an element is inverted at a quadrature point.
  double energy(const Positions& x) const {
    double sum = 0.0;
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      for (int q = 0; q < Element::points; ++q) {
        sum += weight(e, q) * material_.distortion_energy(s.F[std::size_t(q)]);
        if (!element_.mean_dilatation) sum += weight(e, q) * material_.volumetric(s.J[std::size_t(q)]).energy;
      }
      if (element_.mean_dilatation) sum += s.volume * material_.volumetric(s.mean_J).energy;
      if (!std::isfinite(sum)) return std::numeric_limits<double>::infinity();
    }
    return sum;
  }

  /// Volume ratios that the volumetric energy sees: one per element with the locking cure, else one per quadrature
  /// point.
  std::vector<double> volume_ratios(const Positions& x) const {
    std::vector<double> J;
    J.reserve(mesh_->tets.size() * cells());
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      if (element_.mean_dilatation) J.push_back(s.mean_J);
      else J.insert(J.end(), s.J.begin(), s.J.end());
    }
    return J;
  }

  /// The same, carried on by the displacement dx along the slope that they have at the positions `linear`.
  std::vector<double> predicted_ratios(const Positions& x, const Positions& linear, const Positions& dx) const {
    std::vector<double> J = volume_ratios(x);
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, linear);
      for (int q = 0; q < Element::points; ++q) {
        const Gradients slope = product(cofactor(s.F[std::size_t(q)]), gradient(e, q));
        double rate = 0.0;
        for (int a = 0; a < N; ++a) rate += Vec3d(dx.col(node(e, a))).dot(Vec3d(slope.col(a)));
        if (element_.mean_dilatation) J[e] += weight(e, q) / s.volume * rate;
        else J[e * cells() + std::size_t(q)] += rate;
      }
    }
    return J;
  }

  /// Adds the nodal forces ∂energy/∂x [N] to `force` (3 × nodes). The volumetric stress is linearised `about` given
  /// volume ratios θ, U'(θ) + U''(θ)(J − θ): see QuasiStatic.
  void add_forces(const Positions& x, Positions& force, const std::vector<double>* about = nullptr) const {
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      Gradients f = Gradients::Zero();
      for (int q = 0; q < Element::points; ++q) {
        const double J = element_.mean_dilatation ? s.mean_J : s.J[std::size_t(q)], theta = ratio(e, q, s, about);
        const VolumetricSample<double> u = material_.volumetric(theta);
        const Mat3d& F = s.F[std::size_t(q)];
        f += product(
            weight(e, q) * (material_.distortion_stress(F) + (u.stress + u.stiffness * (J - theta)) * cofactor(F)),
            gradient(e, q));
      }
      for (int a = 0; a < N; ++a) force.col(node(e, a)) += f.col(a);
    }
  }

  /// Adds the tangent [N/m] to the values of each system's lower triangle; the element matrices are made once for all.
  void add_tangent(const Positions& x, const std::vector<const Equations*>& systems, const std::vector<double*>& values,
      const std::vector<double>* about = nullptr) const {
    constexpr int size = 3 * N;
    Eigen::Matrix<double, size, size> K;
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      element_tangent(e, x, about, K);
      for (std::size_t k = 0; k < systems.size(); ++k) {
        const int* slot = systems[k]->slots.data() + e * (size * (size + 1) / 2);
        double* v = values[k];
        for (int j = 0; j < size; ++j)
          for (int i = j; i < size; ++i, ++slot)
            if (*slot >= 0) v[*slot] += K(i, j);
      }
    }
  }

  /// Smallest det F over all quadrature points.
  double smallest_J(const Positions& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (double J : state(e, x).J) least = std::min(least, J);
    return least;
  }

  /// Smallest undeformed volume that a quadrature point stands for [m³]; not positive where the mesh has an element
  /// that is inside out.
  double smallest_volume() const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (int q = 0; q < Element::points; ++q) least = std::min(least, weight(e, q));
    return least;
  }

  const Material& material() const { return material_; }

 private:
  struct ElementState {
    std::array<Mat3d, std::size_t(Element::points)> F;
    std::array<double, std::size_t(Element::points)> J;
    double volume = 0.0;
    double mean_J = 0.0;
  };

  int node(std::size_t e, int a) const { return mesh_->tets[e][std::size_t(a)]; }
  double weight(std::size_t e, int q) const { return points_.weight(e, q); }
  const Gradients& gradient(std::size_t e, int q) const { return points_.gradient(e, q); }

  static Gradients product(const Mat3d& A, const Gradients& g) {
    Gradients p;
    for (int a = 0; a < N; ++a)
      for (int i = 0; i < 3; ++i) p(i, a) = A(i, 0) * g(0, a) + A(i, 1) * g(1, a) + A(i, 2) * g(2, a);
    return p;
  }

  ElementState state(std::size_t e, const Positions& x) const {
    Gradients local;
    for (int a = 0; a < N; ++a) local.col(a) = x.col(node(e, a));
    ElementState s;
    for (int q = 0; q < Element::points; ++q) {
      const std::size_t k = std::size_t(q);
      const Gradients& g = gradient(e, q);
      s.F[k] = Mat3d::Zero();
      for (int a = 0; a < N; ++a)
        for (int j = 0; j < 3; ++j)
          for (int i = 0; i < 3; ++i) s.F[k](i, j) += local(i, a) * g(j, a);
      s.J[k] = s.F[k].determinant();
      s.volume += weight(e, q);
      s.mean_J += weight(e, q) * s.J[k];
    }
    s.mean_J /= s.volume;
    return s;
  }

  std::size_t cells() const { return element_.mean_dilatation ? 1 : std::size_t(Element::points); }

  // Volume ratio that the volumetric energy is taken at.
  double ratio(std::size_t e, int q, const ElementState& s, const std::vector<double>* about) const {
    if (about) return (*about)[e * cells() + (element_.mean_dilatation ? 0 : std::size_t(q))];
    return element_.mean_dilatation ? s.mean_J : s.J[std::size_t(q)];
  }

  void element_tangent(std::size_t e, const Positions& x, const std::vector<double>* about,
      Eigen::Matrix<double, 3 * N, 3 * N>& K) const {
    const ElementState s = state(e, x);
    Gradients dJ = Gradients::Zero();  // V ∂(mean J)/∂x
    K.setZero();
    for (int q = 0; q < Element::points; ++q) {
      const Mat3d& F = s.F[std::size_t(q)];
      const Gradients& g = gradient(e, q);
      const Mat3d c = cofactor(F);
      const VolumetricSample<double> u = material_.volumetric(ratio(e, q, s, about));
      Mat9d A = material_.distortion_tangent(F) + u.stress * determinant_hessian(F);
      if (element_.mean_dilatation) {
        dJ += product(weight(e, q) * c, g);
      } else {
        A += dyad(u.stiffness * c, c);
      }
      A = A * weight(e, q);
      // Plain loops: Eigen's expressions of blocks took most of a simulator's compile time.
      for (int a = 0; a < N; ++a) {
        std::array<double, 27> T;  // 9 × 3, by columns
        for (std::size_t k = 0; k < 27; ++k)
          T[k] = A.data()[k] * g(0, a) + A.data()[k + 27] * g(1, a) + A.data()[k + 54] * g(2, a);
        for (int b = a; b < N; ++b)
          for (int j = 0; j < 3; ++j) {
            const double* t = T.data() + 9 * j;
            double* block = &K(3 * b, 3 * a + j);
            for (int i = 0; i < 3; ++i) block[i] += g(0, b) * t[i] + g(1, b) * t[i + 3] + g(2, b) * t[i + 6];
          }
      }
    }
    if (element_.mean_dilatation) {
      const double stiffness = material_.volumetric(ratio(e, 0, s, about)).stiffness / s.volume;
      for (int j = 0; j < 3 * N; ++j) {
        const double scaled = stiffness * dJ.data()[j];
        for (int i = j; i < 3 * N; ++i) K(i, j) += scaled * dJ.data()[i];
      }
    }
  }

  const TetMesh* mesh_;
  Material material_;
  Element element_;
  ElementPoints<Element> points_;
};

}  // namespace lumo
