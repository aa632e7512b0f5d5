#pragma once

#include "lumo/mechanics/contact/contact_surface.hpp"

#include <algorithm>
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
struct FrictionHistory {
  double coefficient = 0.0;
  double stiffness_N_per_m3 = 0.0;  ///< of the spring
  /// 1: a sliding point's stiffness is its force's slope; 0: the secant, with which far starts do not cycle.
  double turning = 1.0;
  Vec3d origin{0.0, 0.0, 0.0};              ///< of the rigid thing's frame at the last equilibrium [m]
  std::vector<std::vector<Vec3d>> place;    ///< of each surface point there, face by face [m]
  std::vector<std::vector<Vec3d>> stretch;  ///< of its spring there [m]

  /// Springs without stretch at positions x, each a tenth as stiff as the law's penalty: a spring stretches by ten
  /// overlaps times the coefficient.
  template <ContactHandler Contact> FrictionHistory(
      const ContactSurface& surface, const Contact& law, double friction, const Positions& x, const Vec3d& rigid_origin)
      : coefficient(friction),
        stiffness_N_per_m3(0.1 * law.stiffness_N_per_m3),
        origin(rigid_origin),
        place(surface.size()),
        stretch(surface.size()) {
    if (coefficient == 0.0) return;
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (const SurfacePoint& p : surface.points(f)) {
        place[f].push_back(surface.position(f, p, x));
        stretch[f].push_back({0.0, 0.0, 0.0});
      }
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
    const Vec3d s = along * (stretch[face][point] + (at - place[face][point]) - (rigid_origin - origin));
    const double length = s.norm(), most = coefficient * std::max(pressure, 0.0) / stiffness_N_per_m3;
    if (length <= most) return {-stiffness_N_per_m3 * s, stiffness_N_per_m3 * along, s};
    const Vec3d way = s / length;
    return {-stiffness_N_per_m3 * most * way,
        stiffness_N_per_m3 * most / length * (along - turning * way * way.transpose()), most * way};
  }

  /// Takes positions x, with the rigid thing as it is now, as the last equilibrium. Springs out of contact relax.
  template <ContactHandler Contact, class Tool>
  void settle(const ContactSurface& surface, const Contact& law, const Moving<Tool>& rigid, const Positions& x) {
    if (coefficient == 0.0) return;
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const Vec3d at = surface.position(f, surface.points(f)[k], x);
        const DistanceSample d = rigid.sample(at);
        stretch[f][k] = d.distance < 0.0
                            ? answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).stretch
                            : Vec3d(Vec3d::Zero());
      }
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k)
        place[f][k] = surface.position(f, surface.points(f)[k], x);
    origin = rigid.origin;
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
};

}  // namespace lumo
