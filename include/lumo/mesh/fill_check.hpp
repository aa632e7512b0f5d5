#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/surface_check.hpp"
#include "lumo/mesh/mesher.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo {

/// A triangle with its corners in ascending order, for matching, and where it came from.
struct SortedFace {
  std::array<int, 3> key;
  int from;  ///< 4 × tetrahedron + corner opposite
  bool odd;  ///< sorting it was an odd permutation

  SortedFace(std::array<int, 3> corners, int source) : key(corners), from(source), odd(false) {
    const auto order = [this](std::size_t i, std::size_t j) {
      if (key[i] <= key[j]) return;
      std::swap(key[i], key[j]);
      odd = !odd;
    };
    order(0, 1);
    order(1, 2);
    order(0, 1);
  }
  bool operator<(const SortedFace& other) const { return key != other.key ? key < other.key : from < other.from; }
};

/// Corners of the face opposite to corner i of a positive tetrahedron, counter-clockwise seen from outside.
inline constexpr std::array<std::array<int, 3>, 4> outward_faces{{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// Makes a LinearTets of a mesher's raw answer and checks it against the surface that was to be filled: finite,
/// positive volumes, faces shared by two tetrahedra of opposite sense or on the boundary, boundary faces on their
/// facets, volume and area those of the input to 1e-6. `faces` and `facets` (number + 1) name the boundary triangles,
/// in any sense and order. Throws MeshError: crashed for an answer that makes no sense, inverted, open, not_manifold,
/// or inaccurate.
inline LinearTets checked_fill(const MeshInput& input, const SurfaceReport& surface,
                               const std::vector<double>& coordinates, double scale,
                               const std::vector<std::int32_t>& tets, const std::vector<std::int32_t>& faces,
                               const std::vector<std::int32_t>& facets) {
  using Reason = MeshError::Reason;
  LinearTets mesh;
  const int count = static_cast<int>(coordinates.size() / 3);
  const int given = static_cast<int>(input.vertices.size());
  if (count < given || tets.size() < 4)
    throw MeshError(Reason::crashed,
                    message("mesher returned ", count, " vertices and ", tets.size() / 4, " tetrahedra"));
  mesh.vertices.reserve(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const Vec3d point = scale * Vec3d(coordinates[3 * i], coordinates[3 * i + 1], coordinates[3 * i + 2]);
    if (!point.allFinite())
      throw MeshError(Reason::crashed, message("mesher returned vertex ", i, " that is not finite"));
    mesh.vertices.push_back(point);
  }
  for (std::size_t i = 0; i < static_cast<std::size_t>(given); ++i)
    if (mesh.vertices[i] != input.vertices[i])
      throw MeshError(Reason::inaccurate, message("mesher moved the given vertex ", i));
  const auto at = [&](int i) -> const Vec3d& { return mesh.vertices[static_cast<std::size_t>(i)]; };
  const auto valid = [&](int i) { return i >= 0 && i < count; };

  double volume = 0.0;
  std::vector<SortedFace> sides;
  sides.reserve(tets.size());
  for (std::size_t i = 0; i + 3 < tets.size(); i += 4) {
    std::array<int, 4> tet{tets[i], tets[i + 1], tets[i + 2], tets[i + 3]};
    if (!std::all_of(tet.begin(), tet.end(), valid))
      throw MeshError(Reason::crashed, message("mesher returned tetrahedron ", i / 4, " with a bad index"));
    double six = (at(tet[1]) - at(tet[0])).cross(at(tet[2]) - at(tet[0])).dot(at(tet[3]) - at(tet[0]));
    if (six < 0.0) {  // the mesher's sense of orientation need not be ours
      std::swap(tet[2], tet[3]);
      six = -six;
    }
    if (!(six > 0.0))
      throw MeshError(Reason::inverted, message("tetrahedron ", i / 4, " has volume ", six / 6.0, ", must be > 0"));
    volume += six / 6.0;
    const int number = static_cast<int>(mesh.tets.size());
    for (int k = 0; k < 4; ++k) {
      const auto& face = outward_faces[static_cast<std::size_t>(k)];
      sides.emplace_back(
          std::array<int, 3>{tet[static_cast<std::size_t>(face[0])], tet[static_cast<std::size_t>(face[1])],
                             tet[static_cast<std::size_t>(face[2])]},
          4 * number + k);
    }
    mesh.tets.push_back(tet);
  }

  std::sort(sides.begin(), sides.end());
  std::vector<SortedFace> named;
  for (std::size_t i = 0; i < facets.size() && 3 * i + 2 < faces.size(); ++i)
    named.emplace_back(std::array<int, 3>{faces[3 * i], faces[3 * i + 1], faces[3 * i + 2]}, facets[i]);
  std::sort(named.begin(), named.end());
  struct Boundary {
    int side, facet;
    auto operator<=>(const Boundary&) const = default;
  };
  std::vector<Boundary> boundary;  // in the order of the tetrahedra, whatever the mesher's order was
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].key == sides[i].key) ++end;
    if (end - i > 2 || (end - i == 2 && sides[i].odd == sides[i + 1].odd))
      throw MeshError(Reason::not_manifold,
                      message("tetrahedron ", sides[i].from / 4, " overlaps its neighbour ", sides[i + 1].from / 4));
    if (end - i == 1) {
      const auto found = std::lower_bound(named.begin(), named.end(), sides[i],
                                          [](const SortedFace& a, const SortedFace& b) { return a.key < b.key; });
      if (found == named.end() || found->key != sides[i].key || found->from < 1 ||
          found->from > static_cast<int>(input.facets.size()))
        throw MeshError(Reason::open,
                        message("a boundary face of tetrahedron ", sides[i].from / 4, " lies on no facet"));
      boundary.push_back({sides[i].from, found->from - 1});
    }
    i = end;
  }
  std::sort(boundary.begin(), boundary.end());
  std::vector<Vec3d> normals;
  for (const Facet& facet : input.facets) normals.push_back(polygon_normal(input.vertices, facet.loop).normalized());
  const double reach = 1e-6 * (surface.high - surface.low).norm();
  double area = 0.0;
  for (const auto& [side, facet] : boundary) {
    const auto& tet = mesh.tets[static_cast<std::size_t>(side / 4)];
    const auto& local = outward_faces[static_cast<std::size_t>(side % 4)];
    const std::array<int, 3> face{tet[static_cast<std::size_t>(local[0])], tet[static_cast<std::size_t>(local[1])],
                                  tet[static_cast<std::size_t>(local[2])]};
    area += 0.5 * (at(face[1]) - at(face[0])).cross(at(face[2]) - at(face[0])).norm();
    const Vec3d& normal = normals[static_cast<std::size_t>(facet)];
    const Vec3d& origin = at(input.facets[static_cast<std::size_t>(facet)].loop[0]);
    for (int vertex : face)
      if (const double height = std::abs(normal.dot(at(vertex) - origin)); height > reach)
        throw MeshError(Reason::inaccurate,
                        message("boundary vertex ", vertex, " is ", height, " off facet ", facet, ", at most ", reach));
    mesh.faces.push_back(face);
    mesh.patches.push_back(input.facets[static_cast<std::size_t>(facet)].patch);
  }
  const auto compare = [](const char* what, double value, double wanted, const char* unit) {
    if (!(std::abs(value - wanted) <= 1e-6 * wanted))
      throw MeshError(Reason::inaccurate, message("mesh ", what, " is ", value, ", the surface's is ", wanted,
                                                  ", may differ by 1e-6 relative [unit", unit, "]"));
  };
  compare("volume", volume, surface.volume, "^3");
  compare("area", area, surface.area, "^2");
  return mesh;
}

}  // namespace lumo
