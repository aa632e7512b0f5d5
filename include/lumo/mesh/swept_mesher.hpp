#pragma once

#include "lumo/geometry/polygon_refinement.hpp"
#include "lumo/mesh/fill_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace lumo {

/// Fills prisms along y, such as a finger's quarter, without any foreign library: the section is triangulated by
/// Delaunay refinement, swept along y in layers, and each triangular prism cut into three tetrahedra. Where edges grow
/// away from a place of touch, layers and section are as fine as the finest wish along them: it takes several times the
/// elements that an unstructured mesh does.
struct SweptMesher {
  /// The same input gives the same bits. Throws MeshError: degenerate for a surface that is no prism along y, with two
  /// flat ends and one quadrilateral for each edge of its section, or one with holes, interior points or
  /// `keep_surface`.
  LinearTets fill(const MeshInput& input) const;

  static constexpr int samples = 64;  ///< along y, at which a point of the section is asked for its wanted edge length
  static constexpr std::size_t most_layers = 10'000, most_vertices = 5'000'000;  ///< against wishes too short
};

static_assert(Mesher<SweptMesher>);

namespace detail {

/// A prism along y: its section as a polygon in (x, −z), counter-clockwise seen along −y from beyond `high`, and what
/// the input calls its parts.
struct Prism {
  double low = 0.0, high = 0.0;
  std::vector<Point2> section;
  std::vector<int> at_low, at_high;  ///< corner of the section → vertex
  std::vector<int> side;             ///< edge of the section → facet
  int low_end = -1, high_end = -1;   ///< facets
};

[[noreturn]] inline void refuse_prism(const std::string& why) {
  throw MeshError(MeshError::Reason::degenerate,
      message("swept mesher: ", why, "; the surface must be a prism along y with one facet on each side"));
}

inline Prism prism_of(const MeshInput& input, const SurfaceReport& surface) {
  Prism p;
  p.low = surface.low.y();
  p.high = surface.high.y();
  const auto at = [&](int v) -> const Vec3d& { return input.vertices[std::size_t(v)]; };
  const auto all_at = [&](const Facet& f, double y) {
    return std::all_of(f.loop.begin(), f.loop.end(), [&](int v) { return at(v).y() == y; });
  };
  if (input.keep_surface) refuse_prism("facets are to be kept whole");
  for (int f = 0; f < int(input.facets.size()); ++f)
    for (int* end : {&p.low_end, &p.high_end})
      if (all_at(input.facets[std::size_t(f)], end == &p.low_end ? p.low : p.high)) {
        if (*end >= 0) refuse_prism(message("facets ", *end, " and ", f, " lie in one end"));
        *end = f;
      }
  if (p.low_end < 0 || p.high_end < 0) refuse_prism("one of the ends is no facet");
  p.at_high = input.facets[std::size_t(p.high_end)].loop;
  const std::size_t n = p.at_high.size();
  if (input.facets.size() != n + 2 || input.vertices.size() != 2 * n)
    refuse_prism(message("an end has ", n, " edges, there are ", input.facets.size() - 2, " other facets and ",
        input.vertices.size(), " vertices"));
  std::map<std::pair<double, double>, int> below;
  for (const int v : input.facets[std::size_t(p.low_end)].loop) below[{at(v).x(), at(v).z()}] = v;
  std::map<std::pair<int, int>, int> edge;  // of the high end, directed → number
  for (std::size_t i = 0; i < n; ++i) {
    const int v = p.at_high[i];
    const auto under = below.find({at(v).x(), at(v).z()});
    if (under == below.end()) refuse_prism(message("vertex ", v, " has none opposite"));
    p.at_low.push_back(under->second);
    p.section.push_back({at(v).x(), -at(v).z()});
    edge[{v, p.at_high[(i + 1) % n]}] = int(i);
  }
  p.side.assign(n, -1);
  for (int f = 0; f < int(input.facets.size()); ++f) {
    if (f == p.low_end || f == p.high_end) continue;
    const std::vector<int>& loop = input.facets[std::size_t(f)].loop;
    for (std::size_t k = 0; k < loop.size() && loop.size() == 4; ++k)  // its edge at the high end runs the other way
      if (const auto found = edge.find({loop[(k + 1) % 4], loop[k]}); found != edge.end())
        p.side[std::size_t(found->second)] = f;
  }
  for (const int f : p.side)
    if (f < 0) refuse_prism("an edge of the section has no side of its own");
  return p;
}

/// Where layers meet, from 0 to 1: as thick as `thickness` wants at their place, evened out.
inline std::vector<double> layer_places(const std::vector<double>& thickness) {
  const std::size_t steps = thickness.size();  // of equal width, thickness in units of the whole
  std::vector<double> layers(steps + 1, 0.0);
  for (std::size_t i = 0; i < steps; ++i) layers[i + 1] = layers[i] + 1.0 / (double(steps) * thickness[i]);
  const double count = std::max(1.0, std::ceil(layers.back() - 1e-9));
  if (!(count <= double(SweptMesher::most_layers)))
    throw MeshError(
        MeshError::Reason::out_of_memory, message("swept mesher: ", count, " layers are wanted, at most 10000"));
  std::vector<double> places{0.0};
  std::size_t i = 0;
  for (double k = 1.0; k < count; k += 1.0) {
    const double want = layers.back() * k / count;
    while (layers[i + 1] < want) ++i;
    places.push_back((double(i) + (want - layers[i]) / (layers[i + 1] - layers[i])) / double(steps));
  }
  places.push_back(1.0);
  return places;
}

/// Wanted edge length at a point of the section and a place along y.
using SectionWish = std::function<double(const Point2& point, double y)>;

/// What one layer may be thick [share of the prism's length] at each of evenly spaced places along y.
inline std::vector<double> layer_thickness(
    const Prism& prism, const std::vector<Point2>& points, const SectionWish& wanted) {
  constexpr int places = 4 * SweptMesher::samples;
  const double length = prism.high - prism.low;
  std::vector<double> thickness;
  for (int i = 0; i < places; ++i) {
    double least = length;
    for (const Point2& p : points) least = std::min(least, wanted(p, prism.low + length * (i + 0.5) / places));
    thickness.push_back(least / length);
  }
  return thickness;
}

/// Points of the section in layers along y, and the tetrahedra between them.
class Sweep {
 public:
  Sweep(const Prism& prism, const PolygonRefinement& section, const std::vector<double>& places)
      : prism_(prism), section_(section), places_(places), count_(section.points().size()) {}

  RawFill fill(const MeshInput& input) {
    add_vertices(input);
    for (std::size_t layer = 0; layer + 1 < places_.size(); ++layer) add_layer(layer);
    for (const auto& [corners, across] : section_.triangles()) {
      const std::size_t last = places_.size() - 1;
      add_face({at(0, corners[0]), at(0, corners[1]), at(0, corners[2])}, prism_.low_end);
      add_face({at(last, corners[0]), at(last, corners[1]), at(last, corners[2])}, prism_.high_end);
    }
    return std::move(raw_);
  }

 private:
  std::int32_t at(std::size_t layer, int point) const { return vertex_[layer * count_ + std::size_t(point)]; }
  void add_vertex(const Vec3d& v) { raw_.coordinates.insert(raw_.coordinates.end(), {v.x(), v.y(), v.z()}); }
  void add_face(const std::array<std::int32_t, 3>& face, int facet) {
    raw_.faces.insert(raw_.faces.end(), face.begin(), face.end());
    raw_.facets.push_back(facet + 1);
  }
  void add_vertices(const MeshInput& input);
  void add_layer(std::size_t layer);

  const Prism& prism_;
  const PolygonRefinement& section_;
  const std::vector<double>& places_;
  std::size_t count_;                 ///< points of the section
  std::vector<std::int32_t> vertex_;  ///< of each point in each layer
  RawFill raw_;
};

/// Given vertices come first, as they were.
inline void Sweep::add_vertices(const MeshInput& input) {
  for (const Vec3d& v : input.vertices) add_vertex(v);
  const std::size_t given = prism_.section.size(), layers = places_.size();
  vertex_.assign(count_ * layers, -1);
  for (std::size_t layer = 0; layer < layers; ++layer)
    for (std::size_t i = 0; i < count_; ++i) {
      std::int32_t& v = vertex_[layer * count_ + i];
      if (i < given && layer == 0) {
        v = prism_.at_low[i];
      } else if (i < given && layer + 1 == layers) {
        v = prism_.at_high[i];
      } else {
        v = std::int32_t(raw_.coordinates.size() / 3);
        const double length = prism_.high - prism_.low;
        const double y = layer + 1 == layers ? prism_.high : prism_.low + length * places_[layer];
        add_vertex(Vec3d(section_.points()[i][0], y, -section_.points()[i][1]));
      }
    }
}

/// Each quadrilateral's diagonal leaves its point of lower number on one level and ends on the other; levels take
/// turns, so that no direction is preferred.
inline void Sweep::add_layer(std::size_t layer) {
  const std::size_t base = layer + layer % 2, top = layer + 1 - layer % 2;
  for (const auto& t : section_.triangles()) {
    auto [i, j, k] = t.corners;
    if (i > j) std::swap(i, j);
    if (j > k) std::swap(j, k);
    if (i > j) std::swap(i, j);
    raw_.tets.insert(raw_.tets.end(), {at(base, i), at(base, j), at(base, k), at(top, k)});
    raw_.tets.insert(raw_.tets.end(), {at(base, i), at(base, j), at(top, j), at(top, k)});
    raw_.tets.insert(raw_.tets.end(), {at(base, i), at(top, i), at(top, j), at(top, k)});
  }
  for (const auto& piece : section_.outline()) {
    const auto [i, j] = std::minmax(piece.from, piece.to);
    add_face({at(base, i), at(base, j), at(top, j)}, prism_.side[std::size_t(piece.edge)]);
    add_face({at(base, i), at(top, i), at(top, j)}, prism_.side[std::size_t(piece.edge)]);
  }
}

}  // namespace detail

inline LinearTets SweptMesher::fill(const MeshInput& input) const {
  const SurfaceReport surface = validate_surface(input);
  const detail::Prism prism = detail::prism_of(input, surface);
  const double length = prism.high - prism.low;
  const auto wanted = [&](const Point2& p, double y) {
    const double edge = input.edge ? input.edge(Vec3d(p[0], y, -p[1])) : std::numeric_limits<double>::infinity();
    if (!(edge > 0.0))
      throw MeshError(MeshError::Reason::not_finite,
          message("swept mesher: wanted edge length at (", p[0], ", ", y, ", ", -p[1], ") is ", edge, ", must be > 0"));
    return edge;
  };
  auto section = PolygonRefinement::of(prism.section);
  if (!section) detail::refuse_prism("the section is not simple");
  const bool filled = section->refine([&](const Point2& p) {
    double least = length;
    for (int i = 0; i <= samples; ++i) least = std::min(least, wanted(p, prism.low + length * i / samples));
    return least;
  });
  std::vector<double> places;
  if (filled) places = detail::layer_places(detail::layer_thickness(prism, section->points(), wanted));
  if (!filled || section->points().size() * places.size() > most_vertices)
    throw MeshError(
        MeshError::Reason::out_of_memory, "swept mesher: the wanted edges are too short, at most 5 million vertices");
  return checked_fill(input, surface, detail::Sweep(prism, *section, places).fill(input));
}

}  // namespace lumo
