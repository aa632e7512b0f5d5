#pragma once

#include "lumo/geometry/polygon_refinement.hpp"
#include "lumo/mesh/fill_check.hpp"

#include <cmath>
#include <cstdint>
#include <limits>

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
  p.low = surface.low.y(), p.high = surface.high.y();
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
  if (!(count <= 10'000.0))
    throw MeshError(MeshError::Reason::out_of_memory,
                    message("swept mesher: ", count, " layers are wanted, at most 10000"));
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

}  // namespace detail

inline LinearTets SweptMesher::fill(const MeshInput& input) const {
  const SurfaceReport surface = validate_surface(input);
  const detail::Prism prism = detail::prism_of(input, surface);
  const double length = prism.high - prism.low;
  const auto wanted = [&](const Point2& p, double y) {
    const double edge = input.edge ? input.edge(Vec3d(p[0], y, -p[1])) : std::numeric_limits<double>::infinity();
    if (!(edge > 0.0))
      throw MeshError(MeshError::Reason::not_finite, message("swept mesher: wanted edge length at (", p[0], ", ", y,
                                                             ", ", -p[1], ") is ", edge, ", must be > 0"));
    return edge;
  };
  constexpr int samples = 64;  // along y
  auto section = PolygonRefinement::of(prism.section);
  if (!section) detail::refuse_prism("the section is not simple");
  const bool filled = section->refine([&](const Point2& p) {
    double least = length;
    for (int i = 0; i <= samples; ++i) least = std::min(least, wanted(p, prism.low + length * i / samples));
    return least;
  });
  const std::size_t given = prism.section.size(), count = section->points().size();
  std::vector<double> thickness;
  for (int i = 0; i < 4 * samples && filled; ++i) {
    double least = length;
    for (const Point2& p : section->points())
      least = std::min(least, wanted(p, prism.low + length * (i + 0.5) / (4 * samples)));
    thickness.push_back(least / length);
  }
  const std::vector<double> places = filled ? detail::layer_places(thickness) : std::vector<double>{};
  const std::size_t layers = places.size();
  if (!filled || count * layers > 5'000'000)
    throw MeshError(MeshError::Reason::out_of_memory,
                    "swept mesher: the wanted edges are too short, at most 5 million vertices");

  // Given vertices come first, as they were.
  std::vector<double> coordinates;
  const auto put = [&](const Vec3d& v) { coordinates.insert(coordinates.end(), {v.x(), v.y(), v.z()}); };
  for (const Vec3d& v : input.vertices) put(v);
  std::vector<std::int32_t> vertex(count * layers, -1);  // of each point in each layer
  for (std::size_t layer = 0; layer < layers; ++layer)
    for (std::size_t i = 0; i < count; ++i) {
      std::int32_t& v = vertex[layer * count + i];
      if (i < given && layer == 0)
        v = prism.at_low[i];
      else if (i < given && layer + 1 == layers)
        v = prism.at_high[i];
      else {
        v = std::int32_t(coordinates.size() / 3);
        const double y = layer + 1 == layers ? prism.high : prism.low + length * places[layer];
        put(Vec3d(section->points()[i][0], y, -section->points()[i][1]));
      }
    }
  const auto at = [&](std::size_t layer, int point) { return vertex[layer * count + std::size_t(point)]; };

  std::vector<std::int32_t> tets, faces, facets;
  const auto name = [&](std::array<std::int32_t, 3> face, int facet) {
    faces.insert(faces.end(), face.begin(), face.end());
    facets.push_back(facet + 1);
  };
  for (std::size_t layer = 0; layer + 1 < layers; ++layer) {
    // Each quadrilateral's diagonal leaves its point of lower number on one level and ends on the other; levels take
    // turns, so that no direction is preferred.
    const std::size_t base = layer + layer % 2, top = layer + 1 - layer % 2;
    for (const auto& t : section->triangles()) {
      auto [i, j, k] = t.corners;
      if (i > j) std::swap(i, j);
      if (j > k) std::swap(j, k);
      if (i > j) std::swap(i, j);
      tets.insert(tets.end(), {at(base, i), at(base, j), at(base, k), at(top, k)});
      tets.insert(tets.end(), {at(base, i), at(base, j), at(top, j), at(top, k)});
      tets.insert(tets.end(), {at(base, i), at(top, i), at(top, j), at(top, k)});
    }
    for (const auto& piece : section->outline()) {
      const auto [i, j] = std::minmax(piece.from, piece.to);
      name({at(base, i), at(base, j), at(top, j)}, prism.side[std::size_t(piece.edge)]);
      name({at(base, i), at(top, i), at(top, j)}, prism.side[std::size_t(piece.edge)]);
    }
  }
  for (const auto& t : section->triangles()) {
    name({at(0, t.corners[0]), at(0, t.corners[1]), at(0, t.corners[2])}, prism.low_end);
    name({at(layers - 1, t.corners[0]), at(layers - 1, t.corners[1]), at(layers - 1, t.corners[2])}, prism.high_end);
  }
  return checked_fill(input, surface, coordinates, 1.0, tets, faces, facets);
}

}  // namespace lumo
