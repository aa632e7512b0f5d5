#pragma once

#include "lumo/core/units.hpp"
#include "lumo/mechanics/contact/contact_surface.hpp"
#include "lumo/mesh/contact_slope.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <queue>
#include <span>
#include <utility>
#include <vector>

namespace lumo {

namespace detail {

// Nodes of a surface beside a rigid thing, numbered among themselves.
struct SurfaceNodes {
  std::vector<int> mesh_node;
  std::vector<int> number;                    // of each of the mesh's nodes among these; −1: it is none of them
  std::vector<Vec3d> place;                   // now [m]
  std::vector<Vec3d> away;                    // gradient of the rigid thing's signed distance
  std::vector<double> gap;                    // [m]; infinite where there is nothing to touch
  std::vector<double> area;                   // of the undeformed surface that is a node's [m²]
  std::vector<std::array<int, 3>> triangles;  // sub-triangles
  std::vector<int> first, neighbour;          // along edges of sub-triangles: neighbour[first[k]] …

  std::size_t size() const { return mesh_node.size(); }
  // Of a mesh's node that is here.
  std::size_t at(int node) const { return std::size_t(number[std::size_t(node)]); }
  std::span<const int> around(std::size_t k) const {
    return {neighbour.data() + first[k], std::size_t(first[k + 1] - first[k])};
  }
};

// Calls visit(area, mesh nodes at the corners) for every sub-triangle of the surface.
template <class Visit> void for_sub_triangles(const ContactSurface& surface, const Positions& x, Visit&& visit) {
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t part = 0; part < surface.sub_triangles(); ++part) {
      const std::array<int, 3> node = surface.sub_triangle(f, part);
      const Vec3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]);
      visit(0.5 * (b - a).cross(c - a).norm(), node);
    }
}

template <class Tool>
SurfaceNodes nodes_beside(const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
  SurfaceNodes s;
  std::vector<int>& number = s.number;
  number.assign(std::size_t(x.cols()), -1);
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k) {
      const int node = surface.face(f).nodes[k];
      if (number[std::size_t(node)] >= 0) continue;
      number[std::size_t(node)] = int(s.size());
      s.mesh_node.push_back(node);
      const Vec3d at = x.col(node);
      const DistanceSample d = rigid.sample(at);
      s.place.push_back(at);
      s.gap.push_back(d.distance);
      s.away.push_back(d.gradient);
    }
  const std::vector<double> areas = surface.node_areas();
  for (const int node : s.mesh_node) s.area.push_back(areas[std::size_t(node)]);
  std::vector<std::pair<int, int>> edges;
  for_sub_triangles(surface, x, [&](double, const std::array<int, 3>& node) {
    std::array<int, 3> t;
    for (std::size_t k = 0; k < 3; ++k) t[k] = number[std::size_t(node[k])];
    s.triangles.push_back(t);
    for (std::size_t k = 0; k < 3; ++k) {
      edges.emplace_back(t[k], t[(k + 1) % 3]);
      edges.emplace_back(t[(k + 1) % 3], t[k]);
    }
  });
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  s.first.assign(s.size() + 1, 0);
  for (const auto& [a, b] : edges) {
    ++s.first[std::size_t(a) + 1];
    s.neighbour.push_back(b);
  }
  for (std::size_t k = 0; k < s.size(); ++k) s.first[k + 1] += s.first[k];
  return s;
}

// What of a triangle lies inside the edge of contact, and the length of edge in it. `lone`: the corner that is not on
// the side of the other two; 0 where there is none.
struct RimCut {
  double area = 0.0, rim = 0.0;
  std::size_t lone = 0;
};

// `field` is > 0 inside, and linear.
inline RimCut cut_at_rim(const std::array<Vec3d, 3>& place, const std::array<double, 3>& field) {
  const auto inside = [&](std::size_t k) { return field[k] > 0.0; };
  const int count = inside(0) + inside(1) + inside(2);
  RimCut cut;
  if (count == 0) return cut;
  cut.lone = count == 3 || inside(0) == (count == 1) ? 0 : inside(1) == (count == 1) ? 1 : 2;
  const std::size_t first = cut.lone, second = (first + 1) % 3, third = (first + 2) % 3;
  const Vec3d b = place[second] - place[first], c = place[third] - place[first];
  const double whole = 0.5 * b.cross(c).norm();
  cut.area = whole;
  if (count == 3) return cut;
  const double u = field[first] / (field[first] - field[second]), v = field[first] / (field[first] - field[third]);
  cut.area = whole * (count == 1 ? u * v : 1.0 - u * v);
  cut.rim = (u * b - v * c).norm();
  return cut;
}

// The edge of contact, found from the gap beside it. Raw overlaps are no measure of contact: they are a few µm and
// perforated by the facets' sag. The gap of a smooth contact rises as the distance to its edge to the power 3/2, and
// Hertz's law for round contacts (hertz_gap), turned about, makes of it Y = (r² − a²)/2a, which is a quadratic of the
// place and passes through the edge with slope 1. A quadratic is fitted to Y about every node near the edge; its zero
// is the edge, and its slope, put back into the law, is the surface's slope against the rigid thing. Radius and
// stiffness of the law are each contact's own, found so that slope 1 holds in the mean.
class ContactEdge {
 public:
  // Nodes that are nearer than `tolerance` [m], and those that bear on most of their area, are taken to touch at first.
  // `bears`: the part of each node's area that presses.
  ContactEdge(const SurfaceNodes& nodes, const std::vector<double>& bears, double tolerance) : s_(&nodes) {
    for (std::size_t k = 0; k < s_->size(); ++k) spacing_.push_back(std::sqrt(lattice * s_->area[k]));
    find_parts(bears, tolerance);
    if (parts_.empty()) return;
    spread();
    mark_rings();
    sort_into_cells();
    guess_laws();
    for (int pass = 0; pass < most_passes && adjust(); ++pass) {
    }
    fit_field();
  }

  // Edge length of equilateral triangles that have as much area as a node [m].
  double spacing(std::size_t k) const { return spacing_[k]; }
  // Signed distance [m] of each node to the edge, > 0 inside.
  const std::vector<double>& field() const { return field_; }

  // How many separate contacts there are.
  std::size_t parts() const { return parts_.size(); }
  // The one that a triangle of nodes belongs to, of which `lone` is not on the side of the others; −1: none.
  int part_of(const std::array<int, 3>& t, std::size_t lone) const {
    const int part = part_[std::size_t(t[lone])];
    return part >= 0 ? part : part_[std::size_t(t[(lone + 1) % 3])];
  }
  int part_of_node(std::size_t k) const { return part_[k]; }

  std::vector<ContactSlope> slopes() const {
    std::vector<ContactSlope> all(s_->size());
    for (std::size_t k = 0; k < s_->size(); ++k) {
      if (part_[k] < 0) continue;
      const Part& part = part_of(k);
      const std::optional<Fit> fit = touches_[k] || ring_[k] ? fits_[k] : lifted(k);
      if (!fit && !touches_[k]) continue;
      const double to_edge = way_[k] / reach(k);
      ContactSlope& slope = all[k];
      slope.normal = -s_->away[k];
      slope.weight = touches_[k] || ring_[k] ? 1.0 : std::clamp(2.0 - 2.0 * to_edge, 0.0, 1.0);
      if (!fit) continue;
      slope.opening = 2.0 * fit->value / part.radius;
      slope.tilt = (2.0 * part.scale / part.radius) * fit->gradient;
    }
    return all;
  }

 private:
  static constexpr double lattice = 1.15;         // 2/√3: spacing² over the area of a node of equilateral triangles
  static constexpr double wanted_reach = 8.0;     // of the fit, in spacings of the nodes
  static constexpr double least_reach = 3.0;      // the same
  static constexpr double most_of_radius = 0.75;  // beyond, the gap is no quadratic under Hertz's law
  static constexpr double way_looked_at = 2.0;    // of the reach: what a fit at the reach's end needs
  static constexpr double most_of_area = 0.5;     // of a node
  static constexpr int rings = 2;                 // nodes this near to the edge, in edges, are placed by the fit
  static constexpr int most_passes = 20;
  static constexpr double least_change = 0.7;    // of radius and scale in a pass
  static constexpr double settled = 1e-3;        // of radius and scale
  static constexpr double circle_reach2 = 12.0;  // squared reach of points of the edge, in spacings
  static constexpr double believable = 0.3;      // logarithm of a slope over that of the nodes outside
  static constexpr double flattest = 1e-9;       // ridge on second derivatives, of the sum of the weights

  struct Part {
    double radius;  // a: of the circle with as much area for its edge [m]
    double scale;   // of the gap: a²/(πR) [m]
  };
  struct Fit {
    double value;    // Y [m]
    Vec3d gradient;  // in the plane at right angles to the gap
    double bend;     // second derivative along the gradient [1/m]

    // Signed distance to Y = 0, > 0 where Y < 0.
    double distance() const {
      const double steep = gradient.norm(), root = steep * steep - 2.0 * bend * value;
      return -2.0 * value / (steep + std::sqrt(std::max(root, 0.0)));
    }
    // Slope at the edge, 1 under the right law.
    double steepness(double radius) const {
      return gradient.norm() / std::sqrt(std::max(1.0 + 2.0 * value / radius, 0.1));
    }
  };

  // A point of the edge with the direction in which the gap opens there.
  struct Sample {
    int part;
    Vec3d point, outward;
    double spacing, steepness;
  };

  const Part& part_of(std::size_t k) const { return parts_[std::size_t(part_[k])]; }
  double reach(std::size_t k) const {
    return std::max(
        std::min(wanted_reach * spacing_[k], most_of_radius * part_of(k).radius), least_reach * spacing_[k]);
  }

  // Nodes that touch and are connected, if only by nodes that bear: coarse facets may hang free between places that
  // are pressed.
  void find_parts(const std::vector<double>& bears, double tolerance) {
    const std::size_t n = s_->size();
    touches_.assign(n, 0);
    part_.assign(n, -1);
    way_.assign(n, std::numeric_limits<double>::infinity());
    ring_.assign(n, 0);
    field_.resize(n);
    for (std::size_t k = 0; k < n; ++k) touches_[k] = s_->gap[k] <= tolerance || bears[k] > most_of_area;
    if (tolerance > 0.0 && std::none_of(touches_.begin(), touches_.end(), [](char t) { return t != 0; }))
      touches_[std::size_t(std::min_element(s_->gap.begin(), s_->gap.end()) - s_->gap.begin())] = 1;
    std::vector<std::size_t> open;
    for (std::size_t k = 0; k < n; ++k) {
      field_[k] = touches_[k] ? spacing_[k] : -s_->gap[k];
      if (!touches_[k] || part_[k] >= 0) continue;
      const int number = int(parts_.size());
      double area = 0.0;
      open.assign(1, k);
      part_[k] = number;
      while (!open.empty()) {
        const std::size_t at = open.back();
        open.pop_back();
        if (touches_[at]) area += s_->area[at];
        for (const int other : s_->around(at)) {
          const std::size_t o = std::size_t(other);
          if (part_[o] >= 0 || !(touches_[o] || bears[o] > 0.0)) continue;
          part_[o] = number;
          open.push_back(o);
        }
      }
      parts_.push_back({std::sqrt(area / pi), 0.0});
    }
  }

  // Every free node belongs to the contact to which it has the shortest way.
  void spread() {
    using Step = std::pair<double, int>;
    std::priority_queue<Step, std::vector<Step>, std::greater<>> next;
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (touches_[k]) {
        way_[k] = 0.0;
        next.emplace(0.0, int(k));
      }
    while (!next.empty()) {
      const auto [way, at] = next.top();
      next.pop();
      const std::size_t k = std::size_t(at);
      if (way > way_[k] || way > way_looked_at * reach(k)) continue;
      for (const int other : s_->around(k)) {
        const std::size_t o = std::size_t(other);
        const double longer = way + (s_->place[o] - s_->place[k]).norm();
        if (!(s_->gap[o] < std::numeric_limits<double>::infinity()) || !(longer < way_[o])) continue;
        way_[o] = longer;
        part_[o] = part_[k];
        next.emplace(longer, other);
      }
    }
  }

  // Nodes within `rings` edges of one of the other kind.
  void mark_rings() {
    for (std::size_t k = 0; k < s_->size(); ++k) {
      if (part_[k] < 0) continue;
      for (const int other : s_->around(k))
        if (touches_[std::size_t(other)] != touches_[k]) ring_[k] = 1;
    }
    for (char ring = 1; ring < rings; ++ring)
      for (std::size_t k = 0; k < s_->size(); ++k) {
        if (part_[k] < 0 || ring_[k]) continue;
        for (const int other : s_->around(k))
          if (ring_[std::size_t(other)] == ring && touches_[std::size_t(other)] == touches_[k])
            ring_[k] = char(ring + 1);
      }
  }

  // Free nodes that a fit may use, by cells of space.
  void sort_into_cells() {
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (part_[k] >= 0) cell_ = std::max(cell_, reach(k));
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (part_[k] >= 0 && !touches_[k]) free_.push_back({cell_of(s_->place[k]), int(k)});
    std::sort(free_.begin(), free_.end());
    lifted_.assign(s_->size(), 0.0);
  }
  using Cell = std::array<long, 3>;
  Cell cell_of(const Vec3d& p) const {
    return {std::lround(p.x() / cell_), std::lround(p.y() / cell_), std::lround(p.z() / cell_)};
  }
  template <class Visit> void for_free_near(const Vec3d& p, Visit&& visit) const {
    const Cell c = cell_of(p);
    for (long i = -1; i <= 1; ++i)
      for (long j = -1; j <= 1; ++j) {
        const Cell low{c[0] + i, c[1] + j, c[2] - 1}, high{c[0] + i, c[1] + j, c[2] + 1};
        for (auto at = std::lower_bound(free_.begin(), free_.end(), std::pair(low, -1));
             at != free_.end() && at->first <= high; ++at)
          visit(std::size_t(at->second));
      }
  }

  // Scales that suit the free nodes, by their way to the contact.
  void guess_laws() {
    std::vector<std::vector<double>> scales(parts_.size());
    for (const auto& [cell, number] : free_) {
      const std::size_t k = std::size_t(number);
      const std::size_t p = std::size_t(part_[k]);
      const double out = std::max(way_[k] - 0.5 * spacing_[k], 0.25 * spacing_[k]) / parts_[p].radius;
      if (way_[k] < least_reach * spacing_[k]) scales[p].push_back(s_->gap[k] / hertz_gap(out * (2.0 + out)));
    }
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      std::vector<double>& all = scales[p];
      if (all.empty()) continue;
      const auto middle = all.begin() + long(all.size() / 2);
      std::nth_element(all.begin(), middle, all.end());
      parts_[p].scale = *middle;
    }
  }

  void lift() {
    for (const auto& [cell, number] : free_) {
      const std::size_t k = std::size_t(number);
      const Part& part = part_of(k);
      lifted_[k] = part.scale > 0.0 ? 0.5 * part.radius * hertz_opening(s_->gap[k] / part.scale) : 0.0;
    }
  }

  // One step towards each contact's radius and scale; false: they have settled.
  bool adjust() {
    fit_field();
    struct Sum {
      double area = 0.0, length = 0.0, steepness = 0.0;
      int count = 0;
    };
    std::vector<Sum> sums(parts_.size());
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (fits_[k] && !touches_[k]) {
        Sum& sum = sums[std::size_t(part_[k])];
        sum.steepness += fits_[k]->steepness(part_of(k).radius);
        ++sum.count;
      }
    for (const std::array<int, 3>& t : s_->triangles) measure(t, sums);
    bool moved = false;
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      if (!(sums[p].length > 0.0) || sums[p].count == 0 || !(sums[p].area > 0.0)) continue;
      Part& part = parts_[p];
      const Part before = part;
      // Half-way, and never far: a wrong law makes islands, which make the next one worse.
      const auto towards = [](double factor) {
        return std::sqrt(std::clamp(factor, least_change, 1.0 / least_change));
      };
      part.radius *= towards(2.0 * sums[p].area / (sums[p].length * part.radius));
      part.scale *= towards(std::pow(sums[p].steepness / sums[p].count, 1.5));
      moved = moved || std::abs(part.radius - before.radius) > settled * part.radius ||
              std::abs(part.scale - before.scale) > settled * part.scale;
    }
    return moved;
  }

  // Adds the part of a sub-triangle that is inside, and the length of the edge in it.
  template <class Sums> void measure(const std::array<int, 3>& t, Sums& sums) const {
    std::array<double, 3> field;
    std::array<Vec3d, 3> place;
    for (std::size_t k = 0; k < 3; ++k) {
      field[k] = field_[std::size_t(t[k])];
      place[k] = s_->place[std::size_t(t[k])];
    }
    const RimCut cut = cut_at_rim(place, field);
    if (cut.area == 0.0) return;
    const int part = part_of(t, cut.lone);
    if (part < 0) return;
    sums[std::size_t(part)].area += cut.area;
    sums[std::size_t(part)].length += cut.rim;
  }

  // Fits at free nodes give points of the edge. To nodes that touch, a fit has to be carried on; where it comes out
  // with a slope that no contact has, and behind the first ring, they are placed by the circle through those points.
  void fit_field() {
    lift();
    fits_.assign(s_->size(), std::nullopt);
    samples_.clear();
    for (const auto& [cell, number] : free_) {
      const std::size_t k = std::size_t(number);
      if (!ring_[k]) continue;
      fits_[k] = lifted(k);
      field_[k] = -s_->gap[k];
      if (!fits_[k]) continue;
      const double distance = fits_[k]->distance();
      const Vec3d outward = fits_[k]->gradient.normalized(), point = s_->place[k] + distance * outward;
      samples_.push_back({part_[k], point, outward, spacing_[k], fits_[k]->steepness(part_of(k).radius)});
      // A node that is well outside by its own gap stays there.
      if (!(distance > 0.0 && lifted_[k] > 0.5 * spacing_[k])) field_[k] = distance;
    }
    for (std::size_t k = 0; k < s_->size(); ++k) {
      if (!ring_[k] || !touches_[k]) continue;
      double usual = 1.0;
      fits_[k] = inside(k, usual);
      if (const std::optional<Fit> own = ring_[k] == 1 ? lifted(k) : std::nullopt)
        if (std::abs(std::log(own->steepness(part_of(k).radius) / usual)) < believable) fits_[k] = own;
      field_[k] = fits_[k] ? fits_[k]->distance() : spacing_[k];
      if (field_[k] < -0.5 * spacing_[k]) field_[k] = spacing_[k];
    }
  }

  // Y at a node that touches, from the circle that fits the points of the edge about it best. Source: Guennebaud,
  // Germann, Gross 2008 (algebraic spheres through oriented points).
  // `steepness`: the mean of theirs.
  std::optional<Fit> inside(std::size_t k, double& steepness) const {
    const Vec3d p = s_->place[k], normal = s_->away[k];
    const auto flat = [&](const Vec3d& v) -> Vec3d { return v - v.dot(normal) * normal; };
    double w = 0.0, pn = 0.0, pp = 0.0, steep_sum = 0.0;
    Vec3d sum_p = Vec3d::Zero(), sum_n = Vec3d::Zero();
    for (const Sample& s : samples_) {
      if (s.part != part_[k]) continue;
      const Vec3d d = flat(s.point - p), out = flat(s.outward).normalized();
      const double t = (s.point - p).squaredNorm() / (circle_reach2 * s.spacing * s.spacing);
      if (t >= 1.0) continue;
      const double weight = std::pow(1.0 - t, 4);
      w += weight;
      sum_p += weight * d;
      sum_n += weight * out;
      pn += weight * d.dot(out);
      pp += weight * d.squaredNorm();
      steep_sum += weight * s.steepness;
    }
    if (!(w > 0.0)) return std::nullopt;
    steepness = steep_sum / w;
    const double spread = pp - sum_p.squaredNorm() / w;
    const double q = spread > 1e-12 * pp ? 0.5 * (pn - sum_p.dot(sum_n) / w) / spread : 0.0;
    const Vec3d l = (sum_n - 2.0 * q * sum_p) / w;
    const double c = -(l.dot(sum_p) + q * pp) / w;
    // c + l·x + q x² at x = 0, as a distance along its slope; the circle's own root where it bends.
    const double root = l.squaredNorm() - 4.0 * q * c, steep = l.norm();
    if (!(steep > 0.0)) return std::nullopt;
    const double out = root > 0.0 ? 2.0 * c / (steep + std::sqrt(root)) : c / steep;
    const double a = part_of(k).radius, r = std::max(a + out, 0.1 * a);
    return Fit{0.5 * (r * r - a * a) / a, (r / a / steep) * l, 1.0 / a};
  }

  // The quadratic through Y of the free nodes about node k. Y is known the better the wider the gap is.
  std::optional<Fit> lifted(std::size_t k) const {
    const Part& part = part_of(k);
    if (!(part.scale > 0.0)) return std::nullopt;
    const double h = reach(k);
    const Vec3d normal = s_->away[k], across = std::abs(normal.x()) < 0.6 ? Vec3d::UnitX() : Vec3d::UnitY();
    const Vec3d e1 = normal.cross(across).normalized(), e2 = normal.cross(e1);
    using Vector6d = Eigen::Matrix<double, 6, 1>;
    Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
    Vector6d b = Vector6d::Zero();
    int count = 0;
    for_free_near(s_->place[k], [&](std::size_t o) {
      if (part_[o] != part_[k]) return;
      const Vec3d d = (s_->place[o] - s_->place[k]) / h;
      const double t = d.squaredNorm();
      if (t >= 1.0) return;
      const double u = e1.dot(d), v = e2.dot(d), gap = s_->gap[o] / part.scale;
      const double w = (1.0 - t) * (1.0 - t) * gap * gap * s_->area[o];
      Vector6d basis;
      basis << 1.0, u, v, 0.5 * u * u, u * v, 0.5 * v * v;
      A += w * basis * basis.transpose();
      b += w * lifted_[o] * basis;
      ++count;
    });
    if (count < 6) return std::nullopt;
    for (int i = 3; i < 6; ++i) A(i, i) += flattest * A(0, 0);
    const Vector6d c = A.ldlt().solve(b);
    if (!c.allFinite()) return std::nullopt;
    Fit fit;
    fit.value = c[0];
    fit.gradient = (c[1] * e1 + c[2] * e2) / h;
    const double steep2 = c[1] * c[1] + c[2] * c[2];
    if (!(steep2 > 0.0)) return std::nullopt;
    fit.bend = (c[3] * c[1] * c[1] + 2.0 * c[4] * c[1] * c[2] + c[5] * c[2] * c[2]) / (steep2 * h * h);
    return fit;
  }

  const SurfaceNodes* s_;
  std::vector<double> spacing_;
  std::vector<char> touches_;
  std::vector<int> part_;    // contact that a node belongs to; −1: none
  std::vector<double> way_;  // along edges, to the nearest node that touches [m]
  std::vector<char> ring_;   // 1 beside the edge, 2 behind that, 0 elsewhere
  std::vector<Part> parts_;
  double cell_ = 0.0;
  std::vector<std::pair<Cell, int>> free_;
  std::vector<double> lifted_;            // Y [m]
  std::vector<std::optional<Fit>> fits_;  // at nodes of the rings
  std::vector<Sample> samples_;
  std::vector<double> field_;
};

}  // namespace detail

}  // namespace lumo
