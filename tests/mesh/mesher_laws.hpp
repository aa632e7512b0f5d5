#pragma once

// What must hold for every mesh that a Mesher makes of a surface.

#include "catch.hpp"
#include "lumo/geometry/surface_check.hpp"
#include "lumo/mesh/mesher.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace mesher_laws {

using lumo::LinearTets;
using lumo::MeshInput;
using lumo::Vec3d;

inline const Vec3d& at(const LinearTets& mesh, int i) { return mesh.vertices[static_cast<std::size_t>(i)]; }

inline double volume(const LinearTets& mesh, const std::array<int, 4>& t) {
  return (at(mesh, t[1]) - at(mesh, t[0])).cross(at(mesh, t[2]) - at(mesh, t[0])).dot(at(mesh, t[3]) - at(mesh, t[0])) /
         6.0;
}

inline Vec3d area(const LinearTets& mesh, const std::array<int, 3>& f) {
  return 0.5 * (at(mesh, f[1]) - at(mesh, f[0])).cross(at(mesh, f[2]) - at(mesh, f[0]));
}

/// What must hold for every mesh that fill() returns.
inline void check_laws(const LinearTets& mesh, const MeshInput& input) {
  const auto report = lumo::validate_surface(input);
  double total = 0.0;
  double least = HUGE_VAL;
  for (const auto& t : mesh.tets) {
    total += volume(mesh, t);
    least = std::min(least, volume(mesh, t));
  }
  CHECK(least > 0.0);
  CHECK(total == Approx(report.volume).epsilon(1e-9));
  REQUIRE(mesh.faces.size() == mesh.patches.size());
  Vec3d closed = Vec3d::Zero();
  double surface = 0.0;
  double enclosed = 0.0;
  std::map<std::pair<int, int>, int> edges;
  std::map<int, double> patch_area, given_area;
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    const auto& f = mesh.faces[i];
    const Vec3d normal = area(mesh, f);
    closed += normal;
    surface += normal.norm();
    enclosed += normal.dot(at(mesh, f[0]) - report.low) / 3.0;
    patch_area[mesh.patches[i]] += normal.norm();
    for (std::size_t k = 0; k < 3; ++k) ++edges[{f[k], f[(k + 1) % 3]}];
  }
  for (const auto& facet : input.facets)
    given_area[facet.patch] += 0.5 * lumo::polygon_normal(input.vertices, facet.loop).norm();
  CHECK(closed.norm() < 1e-9 * surface);
  CHECK(surface == Approx(report.area).epsilon(1e-9));
  CHECK(enclosed == Approx(report.volume).epsilon(1e-9));  // faces look outwards
  CHECK(patch_area.size() == given_area.size());
  for (const auto& [patch, value] : given_area) CHECK(patch_area[patch] == Approx(value).epsilon(1e-9));
  CHECK(std::all_of(edges.begin(), edges.end(), [&](const auto& entry) {
    const auto twin = edges.find({entry.first.second, entry.first.first});
    return entry.second == 1 && twin != edges.end() && twin->second == 1;
  }));
  for (std::size_t i = 0; i < input.vertices.size(); ++i) CHECK((mesh.vertices[i] == input.vertices[i]));
}

/// The same input, the same bits.
template <class M> void check_same_bits(const M& one, const M& other, const MeshInput& input) {
  const LinearTets first = one.fill(input), again = other.fill(input);
  CHECK(std::equal(first.vertices.begin(), first.vertices.end(), again.vertices.begin(), again.vertices.end()));
  CHECK((first.tets == again.tets));
  CHECK((first.faces == again.faces));
  CHECK((first.patches == again.patches));
}

}  // namespace mesher_laws
