#pragma once

#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/solvers/vertex_block.hpp"

#include <vector>

namespace lumo {

/// The contact points of one time step between a surface and one rigid thing, with Coulomb friction on the slip since
/// the step's start. Friction is smooth below a slip `stick_m`: (2 − u/stick) u/stick of its full size (Li et al. 2020;
/// Newton 1.8).
template <ContactHandler Contact, class Tool> class StepContacts {
 public:
  StepContacts(const ContactSurface& surface, const Contact& law) : surface_(&surface), law_(law) {}

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
      if (!friction_on_nodes || law_friction() == 0.0) continue;
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

  double law_friction() const { return friction_coefficient(law_); }
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
    if (law_friction() == 0.0) return out;
    const Vec3d slip = at - p.start - moved_, along = slip - n.dot(slip) * n;
    const double u = along.norm(),
                 scale = law_friction() * push * (u > stick_m_ ? 1.0 / u : (2.0 - u / stick_m_) / stick_m_);
    out.force -= scale * along;
    out.block += scale * (Mat3d::Identity() - n * n.transpose());
    return out;
  }

  const ContactSurface* surface_;
  Contact law_;
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
