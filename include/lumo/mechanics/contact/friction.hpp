#pragma once

#include "lumo/mechanics/contact/contact_surface.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace lumo {

/// Friction on the body's nodes [N], and what of its reaction pushes the indenter back along its way.
struct FrictionForces {
  std::vector<Vec3d> on_nodes;  ///< per mesh node; empty: none
  double push_N = 0.0;
};

/// Coulomb friction that remembers: a point of the surface sticks by a stiff spring along the rigid surface until the
/// spring's force is the coefficient times the pressure, and then slides with it. The spring's stretch is carried from
/// one equilibrium to the next. Source: Wriggers 2006, §5.2 (regularised Coulomb law, return mapping).
///
/// A point that comes into contact between two equilibria slips from then on only. Sticking, it is carried along by a
/// tool from where that met it: the tool's way counts from there. On what does not move, slip is the share of the
/// point's way that lies beyond the surface.
struct FrictionHistory {
  double coefficient = 0.0;
  double stiffness_N_per_m3 = 0.0;  ///< of the spring
  /// 1: a sliding point's stiffness is its force's slope; 0: the secant, with which far starts do not cycle.
  double turning = 1.0;

  /// A surface point at the last equilibrium.
  struct Point {
    Vec3d place;    ///< [m]
    Vec3d stretch;  ///< of its spring [m]
    double gap;     ///< [m]
    double ahead;   ///< advance after which the rigid thing meets it there [m]; infinite: never
  };
  Vec3d origin{0.0, 0.0, 0.0};     ///< of the rigid thing's frame there [m]
  Vec3d direction{0.0, 0.0, 0.0};  ///< of its advance, unit
  std::vector<std::vector<Point>> points;

  /// Springs without stretch at positions x, each 0.3 times as stiff as the law's penalty: a spring stretches by
  /// three overlaps times the coefficient.
  template <ContactHandler Contact, class Tool> FrictionHistory(
      const ContactSurface& surface, const Contact& law, double friction, const Positions& x, const Moving<Tool>& rigid)
      : coefficient(friction), stiffness_N_per_m3(0.3 * law.stiffness_N_per_m3), points(surface.size()) {
    if (coefficient > 0.0) remember(surface, rigid, x);
  }

  /// Traction [Pa] on the body at a point in contact, its stiffness [N/m³] at constant pressure, and the spring's
  /// stretch [m].
  struct Answer {
    Vec3d traction;
    Mat3d stiffness;
    Vec3d stretch;
  };
  Answer answer(std::size_t face, std::size_t point, const Vec3d& at, const Vec3d& rigid_origin, const Vec3d& normal,
      double pressure) const {
    const Mat3d along = Mat3d::Identity() - normal * normal.transpose();
    const auto [slip, share] = slip_since_touch(points[face][point], at, rigid_origin, normal);
    const Vec3d s = along * slip;
    const double length = s.norm(), most = coefficient * std::max(pressure, 0.0) / stiffness_N_per_m3;
    if (length <= most) return {-stiffness_N_per_m3 * s, share * stiffness_N_per_m3 * along, s};
    const Vec3d way = s / length;
    return {-stiffness_N_per_m3 * most * way,
        share * stiffness_N_per_m3 * most / length * (along - turning * way * way.transpose()), most * way};
  }

  /// Takes positions x, with the rigid thing as it is now, as the last equilibrium. Springs out of contact relax.
  template <ContactHandler Contact, class Tool>
  void settle(const ContactSurface& surface, const Contact& law, const Moving<Tool>& rigid, const Positions& x) {
    if (coefficient == 0.0) return;
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const Vec3d at = surface.position(f, surface.points(f)[k], x);
        const DistanceSample d = rigid.sample(at);
        points[f][k].stretch =
            d.distance < 0.0 ? answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).stretch
                             : Vec3d(Vec3d::Zero());
      }
    remember(surface, rigid, x);
  }

  /// Adds friction on the body's nodes [N] at positions x; returns their sum.
  template <ContactHandler Contact, class Tool> Vec3d add_nodal_forces(const ContactSurface& surface,
      const Contact& law, const Moving<Tool>& rigid, const Positions& x,
      std::type_identity_t<std::vector<Vec3d>>& on_nodes) const {
    Vec3d sum{0.0, 0.0, 0.0};
    for (std::size_t f = 0; f < surface.size() && coefficient > 0.0; ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const SurfacePoint& p = surface.points(f)[k];
        const Vec3d at = surface.position(f, p, x);
        const DistanceSample d = rigid.sample(at);
        if (d.distance >= 0.0) continue;
        const Vec3d force =
            p.weight_m2 * answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).traction;
        for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n)
          on_nodes[std::size_t(surface.face(f).nodes[n])] += p.shape[n] * force;
        sum += force;
      }
    return sum;
  }

 private:
  template <class Tool> void remember(const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
    origin = rigid.origin;
    direction = rigid.direction;
    for (std::size_t f = 0; f < surface.size(); ++f) {
      points[f].resize(surface.points(f).size(), {Vec3d::Zero(), Vec3d::Zero(), 0.0, 0.0});
      for (std::size_t k = 0; k < points[f].size(); ++k) {
        Point& p = points[f][k];
        p.place = surface.position(f, surface.points(f)[k], x);
        p.gap = rigid.distance(p.place);
        p.ahead = advance_to_meet(rigid, p.place, p.gap);
      }
    }
  }

  // Steps of the distance: none goes beyond the surface.
  template <class Tool> static double advance_to_meet(const Moving<Tool>& rigid, const Vec3d& place, double gap) {
    constexpr int most_steps = 40;
    constexpr double met = 1e-9;  // [m]
    if (rigid.direction.isZero(0.0)) return std::numeric_limits<double>::infinity();
    double ahead = 0.0;
    for (int k = 0; k < most_steps && gap > met; ++k) {
      ahead += gap;
      gap = rigid.distance(place - ahead * rigid.direction);
    }
    return gap > met ? std::numeric_limits<double>::infinity() : ahead;
  }

  // What a point has slipped by [m] since it came into contact, not yet projected on the surface, and how much of its
  // motion counts.
  std::pair<Vec3d, double> slip_since_touch(
      const Point& p, const Vec3d& at, const Vec3d& rigid_origin, const Vec3d& normal) const {
    const Vec3d motion = (at - p.place) - (rigid_origin - origin);
    if (p.gap <= 0.0) return {p.stretch + motion, 1.0};
    if (std::isfinite(p.ahead)) return {motion + p.ahead * direction, 1.0};
    const double closed = -normal.dot(motion), share = closed > p.gap ? 1.0 - p.gap / closed : 0.0;
    return {share * motion, share};
  }
};

}  // namespace lumo
