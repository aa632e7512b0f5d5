#pragma once

#include "lumo/mechanics/elements/solid.hpp"

#include <vector>

namespace lumo {

/// Newton's equation of one node, the others held: block · step = force, both of the node's own three components.
struct VertexBlock {
  Vec3d force{0.0, 0.0, 0.0};                                      ///< [N]
  Mat3d block{{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};  ///< [N/m]
};

/// Part of det F that a vertex's step must leave.
inline constexpr double least_J_kept = 0.1;

/// Elastic and viscous force and stiffness of single nodes, for any material and element.
/// Viscosity is absolute, on the rate of C = FᵀF since the step's start: force −η ∂/∂x ½ ∫ |Ċ|² dt, as Newton 1.8 has
/// it.
template <HyperelasticMaterial Material, TetElement Element> class VertexElasticity {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  VertexElasticity(const TetMesh& mesh, const Material& material, const Element& element)
      : mesh_(&mesh), material_(material), element_(element), points_(mesh) {
    at_.resize(mesh.nodes.size());
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
      for (int a = 0; a < N; ++a) at_[std::size_t(mesh.tets[e][std::size_t(a)])].push_back({int(e), a});
  }

  /// Adds node v's share at positions x; `start` are the positions at the step's start, `rate` = η/Δt [Pa].
  void add(int v, const Positions& x, const Positions& start, double rate, VertexBlock& out) const {
    for (const Incidence& in : at_[std::size_t(v)]) {
      std::array<Mat3d, std::size_t(Element::points)> F;
      double volume = 0.0, changed = 0.0;
      for (int q = 0; q < Element::points; ++q) {
        F[std::size_t(q)] = deformation(in.tet, q, x);
        volume += weight(in.tet, q);
        changed += weight(in.tet, q) * F[std::size_t(q)].determinant();
      }
      Vec3d dilation = Vec3d::Zero();  // of the whole element by the node's place
      for (int q = 0; q < Element::points; ++q) {
        const Mat3d& f = F[std::size_t(q)];
        const Vec3d g = gradient(in.tet, q).col(in.place);
        const double w = weight(in.tet, q);
        const Vec3d c = cofactor(f) * g;
        out.force -= w * (material_.distortion_stress(f) * g);
        out.block += w * contracted(material_.distortion_tangent(f), g);
        dilation += w * c;
        if (!element_.mean_dilatation) {
          const VolumetricSample<double> u = material_.volumetric(f.determinant());
          out.force -= w * u.stress * c;
          out.block +=
              w * u.stiffness * c * c.transpose();  // the second derivative of J vanishes on a node's own block
        }
        if (rate > 0.0) {
          const Mat3d before = deformation(in.tet, q, start);
          const Vec3d fg = f * g;
          out.force -= 2.0 * w * rate * (f * ((f.transpose() * f - before.transpose() * before) * g));
          out.block += 2.0 * w * rate * (g.squaredNorm() * f * f.transpose() + fg * fg.transpose());
        }
      }
      if (element_.mean_dilatation) {
        const VolumetricSample<double> u = material_.volumetric(changed / volume);
        out.force -= u.stress * dilation;
        out.block += u.stiffness / volume * dilation * dilation.transpose();
      }
    }
  }

  /// Largest part t ≤ 1 of a step of node v that leaves every det F about it above `least_J_kept` of its value (det F
  /// is linear in one node).
  double feasible_part(int v, const Positions& x, const Vec3d& step) const {
    double t = 1.0;
    for (const Incidence& in : at_[std::size_t(v)])
      for (int q = 0; q < Element::points; ++q) {
        const Mat3d f = deformation(in.tet, q, x);
        const double slope = (cofactor(f) * gradient(in.tet, q).col(in.place)).dot(step), J = f.determinant();
        if (J + t * slope < least_J_kept * J) t = (least_J_kept - 1.0) * J / slope;
      }
    return t;
  }

  /// Smallest det F.
  double smallest_J(const Positions& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (int q = 0; q < Element::points; ++q) least = std::min(least, deformation(int(e), q, x).determinant());
    return least;
  }

  const Material& material() const { return material_; }

  /// Where a node takes part: its tetrahedra, and which of their nodes it is.
  struct Incidence {
    int tet, place;
  };
  const std::vector<Incidence>& incidences(int v) const { return at_[std::size_t(v)]; }
  const typename ElementPoints<Element>::Gradients& gradient(int e, int q) const {
    return points_.gradient(std::size_t(e), q);
  }
  double weight(int e, int q) const { return points_.weight(std::size_t(e), q); }

 private:
  static constexpr int N = Element::nodes;

  Mat3d deformation(int e, int q, const Positions& x) const {
    Mat3d F = Mat3d::Zero();
    for (int a = 0; a < N; ++a)
      F += x.col(mesh_->tets[std::size_t(e)][std::size_t(a)]) * gradient(e, q).col(a).transpose();
    return F;
  }

  // Σ gₖ A(i + 3k, j + 3l) gₗ
  static Mat3d contracted(const Mat9d& A, const Vec3d& g) {
    Eigen::Matrix<double, 9, 3> right = A.leftCols<3>() * g[0] + A.middleCols<3>(3) * g[1] + A.rightCols<3>() * g[2];
    return right.topRows<3>() * g[0] + right.middleRows<3>(3) * g[1] + right.bottomRows<3>() * g[2];
  }

  const TetMesh* mesh_;
  Material material_;
  Element element_;
  std::vector<std::vector<Incidence>> at_;
  ElementPoints<Element> points_;
};

}  // namespace lumo
