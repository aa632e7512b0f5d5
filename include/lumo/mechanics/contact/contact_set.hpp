#pragma once

#include "lumo/mechanics/contact/contact_edge.hpp"
#include "lumo/mechanics/contact/contact_spots.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace lumo {

/// Contact field and pressure per mesh node; see MechanicalState.
struct ContactField {
  std::vector<double> field;  ///< > 0 in contact
  std::vector<double> pressure_Pa;
  std::vector<ContactSlope> slopes;
  std::vector<ContactSpot> spots;  ///< those that press hardest first
};

/// Reference area of the intersection and of the union of two contact sets [m²].
struct SetOverlap {
  double both = 0.0;
  double either = 0.0;
  /// Intersection over union; 1 for two empty sets.
  double ratio() const { return either > 0.0 ? both / either : 1.0; }
};

/// Signed distance φ [m] to the edge of contact, > 0 inside, at the surface's nodes (see detail::ContactEdge), the
/// pressure lumped there, and how the surface leans away from the rigid thing.
template <ContactHandler Contact, class Tool> ContactField contact_field(const TetMesh& mesh,
    const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x);

/// How a surface leans away from what it rests on: where it touches, it lies on that; beyond, its slopes are too small
/// for a law of the gap to be better than the faces themselves.
template <class Tool> std::vector<ContactSlope> resting_slopes(
    const TetMesh& mesh, const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x);

/// Area of {φ > 0} on the given node positions: undeformed ones give A_0(C), deformed ones A(C; X) [m²].
template <class S> S contact_area(const ContactSurface& surface, const std::vector<S>& field, const Positions& x);

/// Overlap of {φ_a > 0} and {φ_b > 0}, measured on the given node positions.
inline SetOverlap contact_overlap(
    const ContactSurface& surface, const std::vector<double>& a, const std::vector<double>& b, const Positions& x);

/// The sub-triangles of which a point comes nearer than `margin_m` to the tool, one entry each: what a collision
/// pipeline with that margin has records of (a record of a vertex or an edge brings all triangles about it). It grows
/// with the size of the triangles.
template <class Tool> std::vector<char> recorded_triangles(
    const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x, double margin_m);

/// Area of the recorded sub-triangles on the given node positions [m²].
inline double recorded_area(const ContactSurface& surface, const std::vector<char>& recorded, const Positions& x);

/// Overlap of two such sets, measured on the given node positions.
inline SetOverlap recorded_overlap(
    const ContactSurface& surface, const std::vector<char>& a, const std::vector<char>& b, const Positions& x);

namespace detail {

// A convex polygon in the barycentric plane of a triangle, with the values of the fields at its corners.
template <class S> struct ClipPolygon {
  struct Corner {
    S u, v;
    std::array<S, 2> field;
  };
  std::vector<Corner> corners;

  /// The whole triangle.
  ClipPolygon(const std::array<S, 2>& a, const std::array<S, 2>& b, const std::array<S, 2>& c)
      : corners{{0.0, 0.0, a}, {1.0, 0.0, b}, {0.0, 1.0, c}} {}

  /// Keeps the part where field `k` is positive (Sutherland and Hodgman 1974).
  void clip(std::size_t k) {
    std::vector<Corner> kept;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Corner &a = corners[i], &b = corners[(i + 1) % corners.size()];
      if (a.field[k] > 0.0) kept.push_back(a);
      if ((a.field[k] > 0.0) != (b.field[k] > 0.0)) {
        const S t = a.field[k] / (a.field[k] - b.field[k]);
        kept.push_back({a.u + t * (b.u - a.u), a.v + t * (b.v - a.v),
            {a.field[0] + t * (b.field[0] - a.field[0]), a.field[1] + t * (b.field[1] - a.field[1])}});
      }
    }
    corners = std::move(kept);
  }
  /// Part of the triangle's area that it covers.
  S fraction() const {
    using std::abs;
    S twice = 0.0;
    for (std::size_t i = 1; i + 1 < corners.size(); ++i)
      twice += (corners[i].u - corners[0].u) * (corners[i + 1].v - corners[0].v) -
               (corners[i + 1].u - corners[0].u) * (corners[i].v - corners[0].v);
    return abs(twice);
  }
};

}  // namespace detail

template <ContactHandler Contact, class Tool> ContactField contact_field(const TetMesh& mesh,
    const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x) {
  const std::size_t n = mesh.nodes.size();
  ContactField c{std::vector<double>(n, -std::numeric_limits<double>::infinity()), std::vector<double>(n, 0.0),
      std::vector<ContactSlope>(n), {}};
  double overlap = 0.0;
  const Positions undeformed = positions_of(mesh);
  std::vector<detail::PressedPoint> pressed;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const Vec3d at = surface.position(f, p, x);
      const double g = rigid.distance(at), pressure = contact.respond(g).pressure;
      overlap = std::max(overlap, -g);
      const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
      for (std::size_t k = 0; k < 3; ++k) c.pressure_Pa[std::size_t(node[k])] += p.weight_m2 * p.hat[k] * pressure;
      if (pressure > 0.0) pressed.push_back({f, &p, surface.position(f, p, undeformed), p.weight_m2 * pressure});
    }
  const detail::SurfaceNodes nodes = detail::nodes_beside(surface, rigid, x);
  // Nodes that hang free by less than the overlap at other points of their facets are in contact.
  const detail::ContactEdge edge(nodes, detail::bearing(surface, pressed, nodes), 2.0 * overlap);
  const std::vector<ContactSlope> slopes = edge.slopes();
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const std::size_t node = std::size_t(nodes.mesh_node[k]);
    if (nodes.area[k] > 0.0) c.pressure_Pa[node] /= nodes.area[k];
    c.field[node] = edge.field()[k];
    c.slopes[node] = slopes[k];
  }
  c.spots = detail::contact_spots(surface, pressed, nodes, edge);
  return c;
}

template <class Tool> std::vector<ContactSlope> resting_slopes(
    const TetMesh& mesh, const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
  std::vector<ContactSlope> slopes(mesh.nodes.size());
  std::vector<char> seen(mesh.nodes.size(), 0);
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k) {
      const std::size_t node = std::size_t(surface.face(f).nodes[k]);
      if (std::exchange(seen[node], char(1))) continue;
      const DistanceSample d = rigid.sample(x.col(Eigen::Index(node)));
      if (d.distance < std::numeric_limits<double>::infinity())
        slopes[node] = {.normal = -d.gradient, .weight = d.distance <= 0.0 ? 1.0 : 0.0};
    }
  return slopes;
}

inline SetOverlap contact_overlap(
    const ContactSurface& surface, const std::vector<double>& a, const std::vector<double>& b, const Positions& x) {
  SetOverlap sum;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    const auto at = [&](std::size_t k) {
      return std::array<double, 2>{a[std::size_t(node[k])], b[std::size_t(node[k])]};
    };
    const detail::ClipPolygon<double> whole(at(0), at(1), at(2));
    detail::ClipPolygon<double> in_a = whole, in_b = whole;
    in_a.clip(0);
    in_b.clip(1);
    detail::ClipPolygon<double> in_both = in_a;
    in_both.clip(1);
    const double both = in_both.fraction();
    sum.both += area * both;
    sum.either += area * (in_a.fraction() + in_b.fraction() - both);
  });
  return sum;
}

template <class Tool> std::vector<char> recorded_triangles(
    const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x, double margin_m) {
  std::vector<char> recorded;
  detail::for_sub_triangles(surface, x, [&](double, const std::array<int, 3>& node) {
    const Vec3d a = x.col(node[0]), b = x.col(node[1]) - a, c = x.col(node[2]) - a;
    // On a lattice of points; what lies between them is nearer by little: 1 µm for edges of 1 mm on a 10 mm sphere.
    constexpr int cuts = 8;
    const auto comes_near = [&] {
      if (rigid.distance(a + (b + c) / 3.0) > margin_m + std::max({b.norm(), c.norm(), (c - b).norm()})) return false;
      for (int i = 0; i <= cuts; ++i)
        for (int j = 0; i + j <= cuts; ++j)
          if (rigid.distance(a + double(i) / cuts * b + double(j) / cuts * c) < margin_m) return true;
      return false;
    };
    recorded.push_back(char(comes_near()));
  });
  return recorded;
}

inline double recorded_area(const ContactSurface& surface, const std::vector<char>& recorded, const Positions& x) {
  return recorded_overlap(surface, recorded, recorded, x).both;
}

inline SetOverlap recorded_overlap(
    const ContactSurface& surface, const std::vector<char>& a, const std::vector<char>& b, const Positions& x) {
  SetOverlap sum;
  std::size_t k = 0;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>&) {
    if (a[k] && b[k]) sum.both += area;
    if (a[k] || b[k]) sum.either += area;
    ++k;
  });
  return sum;
}

template <class S> S contact_area(const ContactSurface& surface, const std::vector<S>& field, const Positions& x) {
  S sum = 0.0;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    const auto at = [&](std::size_t k) {
      const S& f = field[std::size_t(node[k])];
      return std::array<S, 2>{f, f};
    };
    detail::ClipPolygon<S> inside(at(0), at(1), at(2));
    inside.clip(0);
    inside.clip(1);  // once more, as an overlap of the field with itself
    sum += area * inside.fraction();
  });
  return sum;
}

}  // namespace lumo
