#pragma once

#include "lumo/mechanics/contact/contact_handler.hpp"
#include "lumo/mechanics/elements/equations.hpp"
#include "lumo/mechanics/elements/solid.hpp"
#include "lumo/mechanics/indenters/indenter.hpp"
#include "lumo/morphology/body.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace lumo {

/// A point of the surface at which the gap is taken: shape functions of its face there, and its share of the reference
/// area.
struct SurfacePoint {
  std::array<double, 6> shape;
  double area_m2;
  double weight_m2;           ///< area that the contact law's pressure acts on: area_m2, unless the law says otherwise
  int part;                   ///< which of the face's four sub-triangles (one in a linear mesh) it lies in
  std::array<double, 3> hat;  ///< barycentric coordinates in that sub-triangle
  Vec3d reference;            ///< its place while the body is undeformed [m]
};

/// Corners of a face's sub-triangles, as places in BoundaryFace::nodes.
inline const std::array<std::array<int, 3>, 4>& face_parts() {
  static constexpr std::array<std::array<int, 3>, 4> parts = {{{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}}};
  return parts;
}

namespace detail {

// |∂x/∂u × ∂x/∂v| of a face at (u, v); `place(node)`: where its nodes are.
template <class Place>
double face_jacobian(const TetMesh& mesh, const BoundaryFace& face, double u, double v, Place&& place) {
  const auto slope = face_shape_derivatives(u, v, mesh.order);
  Vec3d by_u = Vec3d::Zero(), by_v = Vec3d::Zero();
  for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
    by_u += slope[k][0] * place(face.nodes[k]);
    by_v += slope[k][1] * place(face.nodes[k]);
  }
  return by_u.cross(by_v).norm();
}

}  // namespace detail

/// Part of a mesh's surface that may come into contact, with its quadrature.
class ContactSurface {
 public:
  /// Faces of the patches for which `chosen` holds, with points inside them.
  template <class Choose> ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen) : mesh_(&mesh) {
    for (const BoundaryFace& f : mesh.faces)
      if (chosen(body.patches[std::size_t(f.patch)])) add(f);
  }

  /// The same with the points at which a contact law acts.
  template <class Choose, ContactHandler Contact>
  ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen, const Contact& law)
      : ContactSurface(mesh, body, chosen) {
    if (contact_points<Contact>() == ContactPoints::vertices) gather_at_vertices(area_per_vertex(law));
  }

  std::size_t size() const { return faces_.size(); }
  const BoundaryFace& face(std::size_t f) const { return faces_[f]; }
  const std::vector<SurfacePoint>& points(std::size_t f) const { return points_[f]; }

  Vec3d position(std::size_t f, const SurfacePoint& p, const Positions& x) const {
    Vec3d at = Vec3d::Zero();
    for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k)
      at += p.shape[k] * Vec3d(x.col(faces_[f].nodes[k]));
    return at;
  }

  /// Mesh nodes at the corners of one of a face's sub-triangles (one in a linear mesh).
  std::array<int, 3> sub_triangle(std::size_t f, std::size_t part) const {
    const std::array<int, 6>& nodes = faces_[f].nodes;
    const std::array<int, 3> corner = corners_of(part);
    return {nodes[std::size_t(corner[0])], nodes[std::size_t(corner[1])], nodes[std::size_t(corner[2])]};
  }
  std::size_t sub_triangles() const { return mesh_->order == 2 ? 4 : 1; }  ///< of each face

  /// A ball that holds the deformed face: its midpoint and radius. The face stays in the hull of its Bézier points.
  std::pair<Vec3d, double> ball(std::size_t f, const Positions& x) const {
    const auto& n = faces_[f].nodes;
    const auto at = [&](std::size_t k) -> Vec3d { return x.col(n[k]); };
    const Vec3d a = at(0), b = at(1), c = at(2), middle = (a + b + c) / 3.0;
    double r = std::max({(a - middle).norm(), (b - middle).norm(), (c - middle).norm()});
    if (mesh_->order == 2)
      for (std::size_t k = 0; k < 3; ++k)
        r = std::max(r, (2.0 * at(3 + k) - 0.5 * at(k) - 0.5 * at((k + 1) % 3) - middle).norm());
    return {middle, r};
  }

  int nodes_per_face() const { return mesh_->nodes_per_face(); }

  /// Area of the undeformed surface that is a node's, per mesh node [m²].
  std::vector<double> node_areas() const {
    std::vector<double> area(mesh_->nodes.size(), 0.0);
    for (std::size_t f = 0; f < faces_.size(); ++f)
      for (const SurfacePoint& p : points_[f])
        for (std::size_t k = 0; k < 3; ++k)
          area[std::size_t(sub_triangle(f, std::size_t(p.part))[k])] += p.area_m2 * p.hat[k];
    return area;
  }

 private:
  // Places in BoundaryFace::nodes of a sub-triangle's corners.
  std::array<int, 3> corners_of(std::size_t part) const {
    return mesh_->order == 2 ? face_parts()[part] : std::array<int, 3>{0, 1, 2};
  }
  void add(const BoundaryFace& face);
  void gather_at_vertices(double area_per_vertex);

  const TetMesh* mesh_;
  std::vector<BoundaryFace> faces_;
  std::vector<std::vector<SurfacePoint>> points_;
};

/// Contact energy, forces and stiffness between a surface and one rigid thing, for a given signed distance.
struct ContactSums {
  double energy = 0.0;  ///< [J]
  double push_N = 0.0;  ///< force on the indenter along −direction: −∂energy/∂advance … with the sign of a reaction
  double push_stiffness = 0.0;  ///< ∂²energy/∂advance² [N/m]
  double penetration_m = 0.0;   ///< largest overlap of the points that were looked at
};

inline void ContactSurface::add(const BoundaryFace& face) {
  const int order = mesh_->order;
  std::vector<SurfacePoint> points;
  // Corners of the sub-triangles in (u, v); each is quartered once more and takes the three-point rule there.
  const std::array<std::array<double, 2>, 6> uv = {{{0, 0}, {1, 0}, {0, 1}, {0.5, 0}, {0.5, 0.5}, {0, 0.5}}};
  const std::array<std::array<double, 3>, 6> quarter = {
      {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5, .5, 0}, {0, .5, .5}, {.5, 0, .5}}};
  const int parts = order == 2 ? 4 : 1;
  for (int part = 0; part < parts; ++part) {
    const std::array<int, 3> corner = corners_of(std::size_t(part));
    for (const auto& small : face_parts())
      for (int q = 0; q < 3; ++q) {
        SurfacePoint p{};
        p.part = part;
        for (std::size_t k = 0; k < 3; ++k)
          for (std::size_t m = 0; m < 3; ++m)
            p.hat[m] += (int(k) == q ? 2.0 / 3.0 : 1.0 / 6.0) * quarter[std::size_t(small[k])][m];
        double u = 0.0, v = 0.0;
        for (std::size_t m = 0; m < 3; ++m) {
          u += p.hat[m] * uv[std::size_t(corner[m])][0];
          v += p.hat[m] * uv[std::size_t(corner[m])][1];
        }
        p.shape = face_shape(u, v, order);
        p.reference = Vec3d::Zero();
        for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k)
          p.reference += p.shape[k] * mesh_->nodes[std::size_t(face.nodes[k])];
        const double twice_area = detail::face_jacobian(
            *mesh_, face, u, v, [&](int node) -> const Vec3d& { return mesh_->nodes[std::size_t(node)]; });
        p.area_m2 = twice_area * 0.5 / (12.0 * parts);
        p.weight_m2 = p.area_m2;
        points.push_back(p);
      }
  }
  faces_.push_back(face);
  points_.push_back(std::move(points));
}

// Every node once, on the first face that has it, with all of its area.
inline void ContactSurface::gather_at_vertices(double area_per_vertex) {
  const std::vector<double> area = node_areas();
  std::vector<char> done(mesh_->nodes.size(), 0);
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    points_[f].clear();
    for (int part = 0; part < (mesh_->order == 2 ? 4 : 1); ++part)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t local = std::size_t(corners_of(std::size_t(part))[k]),
                          node = std::size_t(faces_[f].nodes[local]);
        if (std::exchange(done[node], char(1))) continue;
        SurfacePoint p{
            {}, area[node], area_per_vertex > 0.0 ? area_per_vertex : area[node], part, {}, mesh_->nodes[node]};
        p.shape[local] = 1.0;
        p.hat[k] = 1.0;
        points_[f].push_back(p);
      }
  }
}

/// A rigid thing that moves by `advance` along `direction`: anything with distance(p) and sample(p) in its own frame.
template <class Tool> struct Moving {
  const Tool* tool;
  Vec3d origin;     ///< of the tool's frame, now [m]
  Vec3d direction;  ///< of its advance, unit

  double distance(const Vec3d& p) const { return tool->distance(p - origin); }
  DistanceSample sample(const Vec3d& p) const { return tool->sample(p - origin); }
};

/// Gaps [m] at each surface point, face by face.
using SurfaceGaps = std::vector<std::vector<double>>;

namespace detail {

// The answer of a contact without friction.
struct NoFriction {
  struct Answer {
    Vec3d traction;
    Mat3d stiffness;
  };
  Answer answer(std::size_t, std::size_t, const Vec3d&, const Vec3d&, const Vec3d&, double) const {
    return {Vec3d::Zero(), Mat3d::Zero()};
  }
};

// Calls visit(face, point number, point, position) for the surface points that can be in contact: those whose given
// gaps are closed, without any those of faces that the rigid thing reaches.
template <class Tool, class Visit> void for_contact_points(const ContactSurface& surface, const Positions& x,
    const Moving<Tool>& rigid, const SurfaceGaps* gaps, Visit&& visit) {
  for (std::size_t f = 0; f < surface.size(); ++f) {
    const std::vector<SurfacePoint>& points = surface.points(f);
    if (gaps) {
      for (std::size_t k = 0; k < points.size(); ++k)
        if ((*gaps)[f][k] < 0.0) visit(f, k, points[k], surface.position(f, points[k], x));
    } else if (const auto [middle, radius] = surface.ball(f, x); rigid.distance(middle) <= radius) {
      for (std::size_t k = 0; k < points.size(); ++k) visit(f, k, points[k], surface.position(f, points[k], x));
    }
  }
}

}  // namespace detail

/// What a contact has been through.
template <class Friction = detail::NoFriction> struct ContactHistory {
  const SurfaceGaps* gaps = nullptr;   ///< γ, about which the law is linearised; nullptr: the present ones
  const Friction* friction = nullptr;  ///< such as FrictionHistory; nullptr: none
};

/// Adds the contact energy and forces; `force` (3 × nodes) receives ∂energy/∂x. About given gaps γ the pressure is
/// p(γ) + p'(γ)(g − γ), so that points keep pulling or stay free until the next step says otherwise; the energy is not
/// meant then. Friction enters forces but not the energy.
template <ContactHandler Contact, class Tool, class Friction = detail::NoFriction>
ContactSums add_contact_forces(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid,
    const Positions& x, std::type_identity_t<Positions>* force, const ContactHistory<Friction>& history = {}) {
  ContactSums sums;
  detail::for_contact_points(
      surface, x, rigid, history.gaps, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3d& at) {
        const double gap = rigid.distance(at), gamma = history.gaps ? (*history.gaps)[f][k] : gap;
        if (gap < 0.0) sums.penetration_m = std::max(sums.penetration_m, -gap);
        if (gamma >= 0.0) return;
        const ContactResponse<double> r = contact.respond(gamma);
        sums.energy += p.weight_m2 * r.energy;
        const double pressure = r.pressure + r.stiffness * (gamma - gap);
        const Vec3d normal = rigid.sample(at).gradient;
        Vec3d traction = p.weight_m2 * pressure * normal;
        if (history.friction)
          traction += p.weight_m2 * history.friction->answer(f, k, at, rigid.origin, normal, pressure).traction;
        sums.push_N += traction.dot(rigid.direction);
        if (!force) return;
        for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n)
          force->col(surface.face(f).nodes[n]) -= p.shape[n] * traction;
      });
  return sums;
}

/// Where a contact stiffness is added.
struct TangentSums {
  const Equations& equations;
  double* values;                       ///< of the system's lower triangle
  Eigen::VectorXd* coupling = nullptr;  ///< ∂²energy/∂x∂advance, one per equation; nullptr: not wanted
  double curvature = 1.0;               ///< share of the rigid thing's curvature, which can make it indefinite
};

/// Adds the contact stiffness.
template <ContactHandler Contact, class Tool, class Friction = detail::NoFriction>
ContactSums add_contact_tangent(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid,
    const Positions& x, const TangentSums& tangent, const ContactHistory<Friction>& history = {}) {
  ContactSums sums;
  const Equations& eq = tangent.equations;
  const std::size_t nodes = std::size_t(surface.nodes_per_face());
  Eigen::Matrix<double, 18, 18> K;
  std::size_t open = std::size_t(-1);
  const auto flush = [&] {
    if (open == std::size_t(-1)) return;
    const auto& n = surface.face(open).nodes;
    for (std::size_t j = 0; j < 3 * nodes; ++j)
      for (std::size_t i = 0; i < 3 * nodes; ++i) {
        const int row = eq.of[3 * std::size_t(n[i / 3]) + i % 3], column = eq.of[3 * std::size_t(n[j / 3]) + j % 3];
        if (row >= column && column >= 0) tangent.values[eq.slot(row, column)] += K(Eigen::Index(i), Eigen::Index(j));
      }
  };
  detail::for_contact_points(
      surface, x, rigid, history.gaps, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3d& at) {
        const double gamma = history.gaps ? (*history.gaps)[f][k] : rigid.distance(at);
        if (gamma >= 0.0) return;
        if (f != open) {
          flush();
          open = f;
          K.setZero();
        }
        const DistanceSample d = rigid.sample(at);
        const ContactResponse<double> r = contact.respond(gamma);
        Mat3d block = p.weight_m2 * r.stiffness * d.gradient * d.gradient.transpose();
        block -= tangent.curvature * p.weight_m2 * r.pressure * d.hessian;
        if (history.friction) {
          const double pressure = r.pressure + r.stiffness * (gamma - d.distance);
          block += p.weight_m2 * history.friction->answer(f, k, at, rigid.origin, d.gradient, pressure).stiffness;
        }
        sums.push_stiffness += rigid.direction.dot(block * rigid.direction);
        for (std::size_t a = 0; a < nodes; ++a) {
          for (std::size_t b = 0; b < nodes; ++b)
            K.block<3, 3>(Eigen::Index(3 * a), Eigen::Index(3 * b)) += p.shape[a] * p.shape[b] * block;
          if (!tangent.coupling) continue;
          const Vec3d c = -p.shape[a] * (block * rigid.direction);
          for (std::size_t i = 0; i < 3; ++i)
            if (const int row = eq.of[3 * std::size_t(surface.face(f).nodes[a]) + i]; row >= 0)
              (*tangent.coupling)[row] += c[Eigen::Index(i)];
        }
      });
  flush();
  return sums;
}

template <class Tool>
SurfaceGaps surface_gaps(const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
  SurfaceGaps gaps(surface.size());
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) gaps[f].push_back(rigid.distance(surface.position(f, p, x)));
  return gaps;
}

/// A rigid thing and the body's node positions, at one time.
template <class Tool> struct ContactPlace {
  Moving<Tool> rigid;
  const Positions& x;
};

/// Gaps at the points of face f `now`, carried on by the displacement dx and the advance ds along the slope that they
/// have at `linear`.
template <class Tool> std::vector<double> predicted_gaps(const ContactSurface& surface, std::size_t f,
    const ContactPlace<Tool>& now, const ContactPlace<Tool>& linear, const Positions& dx, double ds) {
  std::vector<double> gaps;
  for (const SurfacePoint& p : surface.points(f))
    gaps.push_back(now.rigid.distance(surface.position(f, p, now.x)) +
                   linear.rigid.sample(surface.position(f, p, linear.x))
                       .gradient.dot(surface.position(f, p, dx) - ds * now.rigid.direction));
  return gaps;
}

/// The same of all faces, where the gaps of points that stay open do not matter: faces far from the rigid thing have a
/// bound of theirs.
template <class Tool> SurfaceGaps predicted_gaps(const ContactSurface& surface, const ContactPlace<Tool>& now,
    const ContactPlace<Tool>& linear, const Positions& dx, double ds) {
  constexpr double most_weight = 5.0 / 3.0;  // of a quadratic face's nodes together: Σ |shape|
  SurfaceGaps gaps(surface.size());
  for (std::size_t f = 0; f < surface.size(); ++f) {
    double moved = 0.0;
    for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k)
      moved = std::max(moved, dx.col(surface.face(f).nodes[k]).norm());
    const auto [middle, radius] = surface.ball(f, now.x);
    const double open = now.rigid.distance(middle) - radius - most_weight * moved - std::abs(ds);
    if (open > 0.0) gaps[f].assign(surface.points(f).size(), open);
    else gaps[f] = predicted_gaps(surface, f, now, linear, dx, ds);
  }
  return gaps;
}

}  // namespace lumo
