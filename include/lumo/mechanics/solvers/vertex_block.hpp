#pragma once

#include "lumo/mechanics/contact/contact_surface.hpp"
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

/// The contact points of one time step between a surface and one rigid thing, with Coulomb friction on the slip since
/// the step's start. Friction is smooth below a slip `stick_m`: (2 − u/stick) u/stick of its full size (Li et al. 2020;
/// Newton 1.8).
template <ContactHandler Contact, class Tool> class StepContacts {
 public:
  /// `friction`: Coulomb's coefficient.
  StepContacts(const ContactSurface& surface, const Contact& law, double friction)
      : surface_(&surface), law_(law), friction_(friction) {}

  /// The points that come within `reach_m` of the rigid thing, which moved by `moved` since the last step and is now at
  /// its place.
  void find(const Positions& start, const Moving<Tool>& rigid, const Vec3d& moved, double reach_m, double stick_m);

  /// Adds node v's share at positions x.
  void add(int v, const Positions& x, VertexBlock& out) const {
    for (int k = first_[std::size_t(v)]; k < first_[std::size_t(v) + 1]; ++k) {
      const auto [point, shape] = corners_[std::size_t(k)];
      const VertexBlock at = response(points_[std::size_t(point)], x);
      out.force += shape * at.force;
      out.block += shape * shape * at.block;
    }
  }

  /// Force on the whole surface at positions x, and friction alone on the nodes.
  struct Sums {
    Vec3d force = Vec3d::Zero(), friction = Vec3d::Zero();
  };
  Sums sum(const Positions& x, std::vector<Vec3d>* friction_on_nodes) const {
    Sums s;
    for (const Point& p : points_) {
      const Vec3d force = response(p, x).force, friction = force - normal_force(p, x);
      s.force += force;
      s.friction += friction;
      if (!friction_on_nodes || friction_ == 0.0) continue;
      for (std::size_t a = 0; a < std::size_t(surface_->nodes_per_face()); ++a)
        (*friction_on_nodes)[std::size_t(surface_->face(p.face).nodes[a])] +=
            surface_->points(p.face)[p.number].shape[a] * friction;
    }
    return s;
  }

 private:
  static constexpr bool frozen = requires { requires Contact::plane_frozen; };
  struct Point {
    std::size_t face, number;
    Vec3d start;  // its place at the step's start
    Vec3d foot;   // of the plane
    Vec3d normal;
  };
  struct Corner {
    int point;
    double shape;
  };

  std::pair<double, Vec3d> gap(const Point& p, const Vec3d& at) const {
    if constexpr (frozen) {
      return {p.normal.dot(at - p.foot), p.normal};
    } else {
      const DistanceSample d = rigid_.sample(at);
      return {d.distance, d.gradient};
    }
  }
  Vec3d place(const Point& p, const Positions& x) const {
    return surface_->position(p.face, surface_->points(p.face)[p.number], x);
  }
  Vec3d normal_force(const Point& p, const Positions& x) const {
    const auto [g, n] = gap(p, place(p, x));
    return surface_->points(p.face)[p.number].weight_m2 * law_.respond(g).pressure * n;
  }
  // Force on the surface at the point, and its stiffness without the curvature of the rigid thing.
  VertexBlock response(const Point& p, const Positions& x) const {
    const Vec3d at = place(p, x);
    const auto [g, n] = gap(p, at);
    if (g >= 0.0) return {};
    const ContactResponse<double> r = law_.respond(g);
    const double weight = surface_->points(p.face)[p.number].weight_m2, push = weight * r.pressure;
    VertexBlock out{push * n, weight * r.stiffness * n * n.transpose()};
    if (friction_ == 0.0) return out;
    const Vec3d slip = at - p.start - moved_, along = slip - n.dot(slip) * n;
    const double u = along.norm(),
                 scale = friction_ * push * (u > stick_m_ ? 1.0 / u : (2.0 - u / stick_m_) / stick_m_);
    out.force -= scale * along;
    out.block += scale * (Mat3d::Identity() - n * n.transpose());
    return out;
  }

  const ContactSurface* surface_;
  Contact law_;
  double friction_;
  Moving<Tool> rigid_{};
  Vec3d moved_{0.0, 0.0, 0.0};
  double stick_m_ = 1.0;
  std::vector<Point> points_;
  std::vector<int> first_;  // per node, into corners_
  std::vector<Corner> corners_;
};

template <ContactHandler Contact, class Tool> void StepContacts<Contact, Tool>::find(
    const Positions& start, const Moving<Tool>& rigid, const Vec3d& moved, double reach_m, double stick_m) {
  rigid_ = rigid;
  moved_ = moved;
  stick_m_ = stick_m;
  points_.clear();
  std::vector<std::vector<Corner>> of_node(std::size_t(start.cols()));
  for (std::size_t f = 0; f < surface_->size(); ++f) {
    const auto [middle, radius] = surface_->ball(f, start);
    if (rigid.distance(middle) > radius + reach_m) continue;
    const std::vector<SurfacePoint>& points = surface_->points(f);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Vec3d at = surface_->position(f, points[k], start);
      const DistanceSample d = rigid.sample(at);
      if (d.distance > reach_m) continue;
      for (std::size_t a = 0; a < std::size_t(surface_->nodes_per_face()); ++a)
        if (points[k].shape[a] != 0.0)
          of_node[std::size_t(surface_->face(f).nodes[a])].push_back({int(points_.size()), points[k].shape[a]});
      points_.push_back({f, k, at, at - d.distance * d.gradient, d.gradient});
    }
  }
  first_.assign(1, 0);
  corners_.clear();
  for (const auto& corners : of_node) {
    corners_.insert(corners_.end(), corners.begin(), corners.end());
    first_.push_back(int(corners_.size()));
  }
}

}  // namespace lumo
