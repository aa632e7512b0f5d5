#pragma once

#include "lumo/core/error.hpp"
#include "lumo/geometry/surface_check.hpp"
#include "lumo/mesh/mesher.hpp"
#include "lumo/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo {

/// A mesher's raw answer, in plain numbers.
struct RawFill {
  std::vector<double> coordinates;   ///< 3 per vertex; the given vertices first, in order
  std::vector<std::int32_t> tets;    ///< 4 vertices each
  std::vector<std::int32_t> faces;   ///< 3 vertices of each boundary triangle, in any sense and order
  std::vector<std::int32_t> facets;  ///< for each face, the number of its facet + 1
};

/// Makes a LinearTets of a raw answer, whose coordinates times `scale` are the input's, and checks it against the
/// surface that was to be filled: finite, positive volumes, faces shared by two tetrahedra of opposite sense or on the
/// boundary, boundary faces on their facets, volume and area those of the input to 1e-6. Throws MeshError: crashed for
/// an answer that cannot be a mesh, inverted, open, not_manifold, or inaccurate.
inline LinearTets checked_fill(
    const MeshInput& input, const SurfaceReport& surface, const RawFill& raw, double scale = 1.0);

namespace detail {

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

/// The steps of checked_fill, in order.
class FillCheck {
 public:
  explicit FillCheck(const MeshInput& input) : input_(input) {}

  void take_vertices(const RawFill& raw, double scale);
  double take_tets(const std::vector<std::int32_t>& tets);  ///< their volume
  void find_boundary(const RawFill& raw);
  double take_faces(double reach);  ///< their area; none is farther than `reach` off its facet
  LinearTets result() { return std::move(mesh_); }

 private:
  using Reason = MeshError::Reason;
  struct Boundary {
    int side, facet;
    auto operator<=>(const Boundary&) const = default;
  };
  const Vec3d& at(int i) const { return mesh_.vertices[std::size_t(i)]; }

  const MeshInput& input_;
  LinearTets mesh_;
  std::vector<SortedFace> sides_;   ///< of all tetrahedra
  std::vector<Boundary> boundary_;  ///< in the order of the tetrahedra, whatever the mesher's order was
};

inline void FillCheck::take_vertices(const RawFill& raw, double scale) {
  const std::size_t count = raw.coordinates.size() / 3, given = input_.vertices.size();
  if (count < given || raw.tets.size() < 4)
    throw MeshError(
        Reason::crashed, message("mesher returned ", count, " vertices and ", raw.tets.size() / 4, " tetrahedra"));
  mesh_.vertices.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double* c = &raw.coordinates[3 * i];
    const Vec3d point = scale * Vec3d(c[0], c[1], c[2]);
    if (!point.allFinite())
      throw MeshError(Reason::crashed, message("mesher returned vertex ", i, " that is not finite"));
    mesh_.vertices.push_back(point);
  }
  for (std::size_t i = 0; i < given; ++i)
    if (mesh_.vertices[i] != input_.vertices[i])
      throw MeshError(Reason::inaccurate, message("mesher moved the given vertex ", i));
}

inline double FillCheck::take_tets(const std::vector<std::int32_t>& tets) {
  const int count = int(mesh_.vertices.size());
  double volume = 0.0;
  sides_.reserve(tets.size());
  for (std::size_t i = 0; i + 3 < tets.size(); i += 4) {
    std::array<int, 4> tet{tets[i], tets[i + 1], tets[i + 2], tets[i + 3]};
    if (!std::all_of(tet.begin(), tet.end(), [count](int v) { return v >= 0 && v < count; }))
      throw MeshError(Reason::crashed, message("mesher returned tetrahedron ", i / 4, " with a bad index"));
    double six = (at(tet[1]) - at(tet[0])).cross(at(tet[2]) - at(tet[0])).dot(at(tet[3]) - at(tet[0]));
    if (six < 0.0) {  // the mesher's sense of orientation need not be ours
      std::swap(tet[2], tet[3]);
      six = -six;
    }
    if (!(six > 0.0))
      throw MeshError(Reason::inverted, message("tetrahedron ", i / 4, " has volume ", six / 6.0, ", must be > 0"));
    volume += six / 6.0;
    const int number = int(mesh_.tets.size());
    for (int k = 0; k < 4; ++k) {
      const auto& [a, b, c] = outward_faces[std::size_t(k)];
      sides_.emplace_back(
          std::array<int, 3>{tet[std::size_t(a)], tet[std::size_t(b)], tet[std::size_t(c)]}, 4 * number + k);
    }
    mesh_.tets.push_back(tet);
  }
  return volume;
}

inline void FillCheck::find_boundary(const RawFill& raw) {
  std::sort(sides_.begin(), sides_.end());
  std::vector<SortedFace> named;
  for (std::size_t i = 0; i < raw.facets.size() && 3 * i + 2 < raw.faces.size(); ++i)
    named.emplace_back(std::array<int, 3>{raw.faces[3 * i], raw.faces[3 * i + 1], raw.faces[3 * i + 2]}, raw.facets[i]);
  std::sort(named.begin(), named.end());
  for (std::size_t i = 0; i < sides_.size();) {
    const SortedFace& side = sides_[i];
    std::size_t end = i + 1;
    while (end < sides_.size() && sides_[end].key == side.key) ++end;
    if (end - i > 2 || (end - i == 2 && side.odd == sides_[i + 1].odd))
      throw MeshError(Reason::not_manifold,
          message("tetrahedron ", side.from / 4, " overlaps its neighbour ", sides_[i + 1].from / 4));
    if (end - i == 1) {
      const auto found = std::lower_bound(
          named.begin(), named.end(), side, [](const SortedFace& a, const SortedFace& b) { return a.key < b.key; });
      if (found == named.end() || found->key != side.key || found->from < 1 || found->from > int(input_.facets.size()))
        throw MeshError(Reason::open, message("a boundary face of tetrahedron ", side.from / 4, " lies on no facet"));
      boundary_.push_back({side.from, found->from - 1});
    }
    i = end;
  }
  std::sort(boundary_.begin(), boundary_.end());
}

inline double FillCheck::take_faces(double reach) {
  std::vector<Vec3d> normals;
  for (const Facet& facet : input_.facets) normals.push_back(polygon_normal(input_.vertices, facet.loop).normalized());
  double area = 0.0;
  for (const auto& [side, number] : boundary_) {
    const auto& tet = mesh_.tets[std::size_t(side / 4)];
    const auto& [a, b, c] = outward_faces[std::size_t(side % 4)];
    const std::array<int, 3> face{tet[std::size_t(a)], tet[std::size_t(b)], tet[std::size_t(c)]};
    area += 0.5 * (at(face[1]) - at(face[0])).cross(at(face[2]) - at(face[0])).norm();
    const Facet& facet = input_.facets[std::size_t(number)];
    for (int vertex : face)
      if (const double height = std::abs(normals[std::size_t(number)].dot(at(vertex) - at(facet.loop[0])));
          height > reach)
        throw MeshError(Reason::inaccurate,
            message("boundary vertex ", vertex, " is ", height, " off facet ", number, ", at most ", reach));
    mesh_.faces.push_back(face);
    mesh_.patches.push_back(facet.patch);
  }
  return area;
}

}  // namespace detail

inline LinearTets checked_fill(const MeshInput& input, const SurfaceReport& surface, const RawFill& raw, double scale) {
  constexpr double tolerance = 1e-6;  // relative
  detail::FillCheck check(input);
  check.take_vertices(raw, scale);
  const double volume = check.take_tets(raw.tets);
  check.find_boundary(raw);
  const double area = check.take_faces(tolerance * (surface.high - surface.low).norm());
  const auto compare = [](const char* what, double value, double wanted, const char* unit) {
    if (!(std::abs(value - wanted) <= tolerance * wanted))
      throw MeshError(MeshError::Reason::inaccurate, message("mesh ", what, " is ", value, ", the surface's is ",
                                                         wanted, ", may differ by 1e-6 relative [unit", unit, "]"));
  };
  compare("volume", volume, surface.volume, "^3");
  compare("area", area, surface.area, "^2");
  return check.result();
}

}  // namespace lumo
