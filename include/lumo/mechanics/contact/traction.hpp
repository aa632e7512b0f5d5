#pragma once

#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/state.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace lumo {

/// What the tool does to the deformed surface, at the points of its quadrature and on the mesh's nodes.
struct Tractions {
  std::vector<TractionPoint> points;  ///< where it presses or rubs
  std::vector<Vec3d> on_nodes;        ///< [Pa], per mesh node; see MechanicalState::traction_Pa
};

/// Tractions on `surface` at the places `x` of the mesh's nodes; `friction_N`: of the tool, per mesh node, may be
/// empty.
template <ContactHandler Contact, class Tool> Tractions tractions_of(const TetMesh& mesh, const ContactSurface& surface,
    const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const std::vector<Vec3d>& friction_N);

namespace detail {

// Area of the deformed surface about a point over that of the undeformed one.
inline double stretch(const TetMesh& mesh, const BoundaryFace& face, const SurfacePoint& p, const Positions& x) {
  const double u = p.shape[1] + 0.5 * (p.shape[3] + p.shape[4]), v = p.shape[2] + 0.5 * (p.shape[4] + p.shape[5]);
  return face_jacobian(mesh, face, u, v, [&](int node) { return Vec3d(x.col(node)); }) /
         face_jacobian(mesh, face, u, v, [&](int node) -> const Vec3d& { return mesh.nodes[std::size_t(node)]; });
}

}  // namespace detail

template <ContactHandler Contact, class Tool> Tractions tractions_of(const TetMesh& mesh, const ContactSurface& surface,
    const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const std::vector<Vec3d>& friction_N) {
  const auto force_at = [&](const SurfacePoint& p, const Vec3d& at) -> Vec3d {
    const DistanceSample d = rigid.sample(at);
    return p.weight_m2 * contact.respond(d.distance).pressure * d.gradient;
  };
  const auto is_rubbed = [&](std::size_t n) { return !friction_N.empty() && !friction_N[n].isZero(0.0); };
  Tractions all;
  all.on_nodes.assign(mesh.nodes.size(), Vec3d::Zero());
  detail::for_contact_points(
      surface, x, rigid, nullptr, [&](std::size_t f, std::size_t, const SurfacePoint& p, const Vec3d& at) {
        const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
        const Vec3d force = force_at(p, at);
        for (std::size_t k = 0; k < 3; ++k) all.on_nodes[std::size_t(node[k])] += p.hat[k] * force;
      });
  std::vector<double> area(mesh.nodes.size(), 0.0);
  std::vector<std::pair<std::array<int, 3>, const SurfacePoint*>> places;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
      const auto any = [&](auto&& holds) {
        return std::any_of(node.begin(), node.end(), [&](int n) { return holds(std::size_t(n)); });
      };
      const bool rubbed = any(is_rubbed);
      if (!rubbed && !any([&](std::size_t n) { return !all.on_nodes[n].isZero(0.0); })) continue;
      TractionPoint point;
      point.reference_m = p.reference;
      point.place_m = surface.position(f, p, x);
      point.area_m2 = p.area_m2 * detail::stretch(mesh, surface.face(f), p, x);
      for (std::size_t k = 0; k < 3; ++k) area[std::size_t(node[k])] += p.hat[k] * point.area_m2;
      const Vec3d force = force_at(p, point.place_m);
      if ((!rubbed && force.isZero(0.0)) || !(point.area_m2 > 0.0)) continue;
      point.traction_Pa = force / point.area_m2;
      point.pressure_Pa = point.traction_Pa.norm();
      all.points.push_back(point);
      places.emplace_back(node, &p);
    }
  for (std::size_t n = 0; n < area.size(); ++n) {
    if (!(area[n] > 0.0)) continue;
    if (is_rubbed(n)) all.on_nodes[n] += friction_N[n];
    all.on_nodes[n] /= area[n];
  }
  // Friction is known by its nodes; the points share it as the field does.
  for (std::size_t i = 0; i < places.size() && !friction_N.empty(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t n = std::size_t(places[i].first[k]);
      all.points[i].traction_Pa += places[i].second->hat[k] / area[n] * friction_N[n];
    }
  return all;
}

}  // namespace lumo
