#pragma once

#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/mechanics/elements/element.hpp"

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
  const auto slope = face_shape_derivatives(u, v, mesh.order);
  Vec3d by_u = Vec3d::Zero(), by_v = by_u, by_u0 = by_u, by_v0 = by_u;
  for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
    const int n = face.nodes[k];
    by_u += slope[k][0] * x.col(n);
    by_v += slope[k][1] * x.col(n);
    by_u0 += slope[k][0] * mesh.nodes[std::size_t(n)];
    by_v0 += slope[k][1] * mesh.nodes[std::size_t(n)];
  }
  return by_u.cross(by_v).norm() / by_u0.cross(by_v0).norm();
}

}  // namespace detail

template <ContactHandler Contact, class Tool> Tractions tractions_of(const TetMesh& mesh, const ContactSurface& surface,
    const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const std::vector<Vec3d>& friction_N) {
  Tractions all;
  all.on_nodes.assign(mesh.nodes.size(), Vec3d::Zero());
  std::vector<double> area(mesh.nodes.size(), 0.0);
  std::vector<std::pair<std::array<int, 3>, const SurfacePoint*>> places;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
      TractionPoint point;
      point.reference_m = p.reference;
      point.place_m = surface.position(f, p, x);
      point.area_m2 = p.area_m2 * detail::stretch(mesh, surface.face(f), p, x);
      const DistanceSample d = rigid.sample(point.place_m, surface.material(f, p));
      const Vec3d force = p.weight_m2 * contact.respond(d.distance).pressure * d.gradient;
      bool acts = force.squaredNorm() > 0.0;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t n = std::size_t(node[k]);
        area[n] += p.hat[k] * point.area_m2;
        all.on_nodes[n] += p.hat[k] * force;
        acts = acts || (!friction_N.empty() && friction_N[n].squaredNorm() > 0.0);
      }
      if (!acts || !(point.area_m2 > 0.0)) continue;
      point.traction_Pa = force / point.area_m2;
      point.pressure_Pa = point.traction_Pa.norm();
      all.points.push_back(point);
      places.emplace_back(node, &p);
    }
  for (std::size_t n = 0; n < area.size(); ++n) {
    if (!(area[n] > 0.0)) continue;
    if (!friction_N.empty()) all.on_nodes[n] += friction_N[n];
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
