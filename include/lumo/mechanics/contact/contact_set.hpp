#pragma once

#include "lumo/mechanics/contact/contact_surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

namespace lumo {

/// Contact field and pressure per mesh node; see MechanicalState.
struct ContactField {
  std::vector<double> field;  ///< > 0 in contact
  std::vector<double> pressure_Pa;
};

/// Reference area of the intersection and of the union of two contact sets [m²].
struct SetOverlap {
  double both = 0.0;
  double either = 0.0;
  /// Intersection over union; 1 for two empty sets.
  double ratio() const { return either > 0.0 ? both / either : 1.0; }
};

/// Signed distance φ [m] to the edge of contact, > 0 inside, at the surface's nodes, and the pressure lumped there. Raw
/// overlaps are no measure of contact: they are a few µm and perforated by the facets' sag. Outside, the gap of a
/// smooth contact grows as the distance to its edge to the power 3/2 (Hertz 1882; Johnson 1985, §4.2), so g^(2/3),
/// scaled by its own slope, *is* that distance; inside it is continued linearly.
template <ContactHandler Contact, class Tool> ContactField contact_field(const TetMesh& mesh,
    const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x);

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

// Calls visit(area, a at the corners, b at the corners) for every sub-triangle of the surface.
template <class Visit> void for_sub_triangles(const ContactSurface& surface, const Positions& x, Visit&& visit) {
  const std::size_t parts = surface.nodes_per_face() == 6 ? 4 : 1;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t part = 0; part < parts; ++part) {
      std::array<int, 3> node;
      for (std::size_t k = 0; k < 3; ++k)
        node[k] = surface.face(f).nodes[parts == 4 ? std::size_t(face_parts()[part][k]) : k];
      const Vec3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]);
      visit(0.5 * (b - a).cross(c - a).norm(), node);
    }
}

// The fit of the edge of contact. Lengths are in spacings of the nodes.
struct EdgeFit {
  static constexpr double triangle = 2.3;  // 4/√3: edge² over the area of an equilateral triangle
  static constexpr double lattice = 1.15;  // 2/√3: spacing² over the area of a node of such triangles
  static constexpr double reach = 4.0;     // of what is looked at
  static constexpr double nearest = 0.25;  // nearer, the kink inside a facet disturbs the gap
  static constexpr double farthest = 2.0;  // farther, the fit has to reach too far
  static constexpr double slope_reach2 = 16.0, circle_reach2 = 12.0;  // squared reach of the weights
  static constexpr double least_slope2 = 0.25;                        // of the mean: the fit may not fall below
};

// A point of the edge of contact with the direction in which the gap opens there.
struct EdgeSample {
  Vec3d point;
  Vec3d outward;
  double spacing;  // of the nodes about it
};

// Every free sub-triangle near the edge looks along the slope of G = g^(2/3), which falls to zero at the edge of
// contact. With G = αρ + βρ² the squared slope is linear in G, so that a local fit of slope² over G gives α, and the
// distance is 2 G / (α + slope).
inline std::vector<EdgeSample> edge_of_contact(
    const ContactSurface& surface, const Positions& x, const std::vector<double>& gap, double tolerance) {
  struct Free {
    Vec3d middle, outward;
    double power, slope, spacing;
  };
  std::vector<Free> free;
  for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    std::array<double, 3> power;
    for (std::size_t k = 0; k < 3; ++k) {
      const double g = gap[std::size_t(node[k])];
      if (!(g > tolerance)) return;
      power[k] = std::cbrt(g * g);
    }
    const Vec3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]), e1 = b - a, e2 = c - a;
    const Vec3d normal = e1.cross(e2);
    const Vec3d gradient =
        ((power[1] - power[0]) * e2.cross(normal) + (power[2] - power[0]) * normal.cross(e1)) / normal.squaredNorm();
    const Free f{(a + b + c) / 3.0, gradient.normalized(), (power[0] + power[1] + power[2]) / 3.0, gradient.norm(),
        std::sqrt(EdgeFit::triangle * area)};
    if (f.slope > 0.0 && f.power < EdgeFit::reach * f.spacing * f.slope) free.push_back(f);
  });
  std::vector<EdgeSample> samples;
  for (const Free& f : free) {
    if (f.power < EdgeFit::nearest * f.spacing * f.slope || f.power > EdgeFit::farthest * f.spacing * f.slope) continue;
    double w = 0.0, g = 0.0, s = 0.0, gg = 0.0, gs = 0.0;
    for (const Free& other : free) {
      const double t = (other.middle - f.middle).squaredNorm() / (EdgeFit::slope_reach2 * f.spacing * f.spacing);
      if (t >= 1.0 || other.power < EdgeFit::nearest * other.spacing * other.slope) continue;
      const double k = std::pow(1.0 - t, 2), square = other.slope * other.slope;
      w += k;
      g += k * other.power;
      s += k * square;
      gg += k * other.power * other.power;
      gs += k * other.power * square;
    }
    const double spread = gg - g * g / w;
    const double bend = spread > 1e-9 * gg ? (gs - g * s / w) / spread : 0.0;
    const double start = std::max((s - bend * g) / w, EdgeFit::least_slope2 * s / w),
                 here = std::max(start + bend * f.power, EdgeFit::least_slope2 * s / w);
    samples.push_back(
        {f.middle - 2.0 * f.power / (std::sqrt(start) + std::sqrt(here)) * f.outward, f.outward, f.spacing});
  }
  return samples;
}

// Signed distance (> 0 inside) from p to the circle that fits the samples about it best. Source: Guennebaud, Germann,
// Gross 2008 (algebraic spheres through oriented points).
inline std::optional<double> distance_to_edge(const std::vector<EdgeSample>& samples, const Vec3d& p) {
  double w = 0.0, pn = 0.0, pp = 0.0;
  Vec3d sum_p = Vec3d::Zero(), sum_n = Vec3d::Zero();
  for (const EdgeSample& s : samples) {
    const Vec3d d = s.point - p;
    const double t = d.squaredNorm() / (EdgeFit::circle_reach2 * s.spacing * s.spacing);
    if (t >= 1.0) continue;
    const double k = std::pow(1.0 - t, 4);
    w += k;
    sum_p += k * d;
    sum_n += k * s.outward;
    pn += k * d.dot(s.outward);
    pp += k * d.squaredNorm();
  }
  if (!(w > 0.0)) return std::nullopt;
  const double spread = pp - sum_p.squaredNorm() / w;
  const double q = spread > 1e-12 * pp ? 0.5 * (pn - sum_p.dot(sum_n) / w) / spread : 0.0;
  const Vec3d l = (sum_n - 2.0 * q * sum_p) / w;
  const double c = -(l.dot(sum_p) + q * pp) / w;
  // c + l·x + q x² at x = 0, turned into a distance along its slope; the circle's own root where it bends.
  const double root = l.squaredNorm() - 4.0 * q * c;
  if (!(root > 0.0)) return -c / std::max(l.norm(), 1e-300);
  return -2.0 * c / (l.norm() + std::sqrt(root));
}

}  // namespace detail

template <ContactHandler Contact, class Tool> ContactField contact_field(const TetMesh& mesh,
    const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x) {
  const std::size_t n = mesh.nodes.size();
  std::vector<double> area(n, 0.0), gap(n, std::numeric_limits<double>::quiet_NaN()), spacing(n, 0.0);
  ContactField c{std::vector<double>(n, -std::numeric_limits<double>::infinity()), std::vector<double>(n, 0.0)};
  double overlap = 0.0;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const double g = rigid.distance(surface.position(f, p, x));
      overlap = std::max(overlap, -g);
      const std::array<int, 3> corner =
          mesh.order == 2 ? face_parts()[std::size_t(p.part)] : std::array<int, 3>{0, 1, 2};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t node = std::size_t(surface.face(f).nodes[std::size_t(corner[k])]);
        area[node] += p.area_m2 * p.hat[k];
        c.pressure_Pa[node] += p.weight_m2 * p.hat[k] * contact.respond(g).pressure;
      }
    }
  for (std::size_t k = 0; k < n; ++k) {
    if (area[k] <= 0.0) continue;
    c.pressure_Pa[k] /= area[k];
    spacing[k] = std::sqrt(detail::EdgeFit::lattice * area[k]);
    gap[k] = rigid.distance(x.col(Eigen::Index(k)));
  }
  // Nodes that hang free by less than the overlap at other points of their facets are in contact.
  const double tolerance = 2.0 * overlap;
  const std::vector<detail::EdgeSample> edge = detail::edge_of_contact(surface, x, gap, tolerance);
  for (std::size_t k = 0; k < n; ++k) {
    if (area[k] <= 0.0) continue;
    const bool open = gap[k] > tolerance;
    const double far = open ? -gap[k] : spacing[k];
    double& field = c.field[k];
    field = detail::distance_to_edge(edge, x.col(Eigen::Index(k))).value_or(far);
    // The fit speaks for the edge's surroundings only; a node well on one side of it stays there.
    if ((field > 0.0) == open && std::abs(field) > 0.5 * spacing[k]) field = far;
  }
  return c;
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
