#pragma once

#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/surface/place_key.hpp"
#include "lumo/optics/surface_optics.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <tuple>
#include <variant>
#include <vector>

namespace lumo {

/// Corners of all triangles of Lambertian surfaces, each with the function that is 1 there, 0 at its neighbours and
/// linear in between. Light that falls on such a surface is shared by the three nodes about it: shares vary
/// continuously with the place and add up to 1. Source: linear elements for radiosity, Heckbert (thesis, 1991). In a
/// plane of `symmetry` mirror images are one node.
class LightNodes {
 public:
  LightNodes(const OpticalScene& scene, Symmetry symmetry)
      : of_(scene.triangles().size(), std::array<int, 3>{-1, -1, -1}) {
    // Surfaces share a node where they are one patch, or cells of one plane of the carrier. Mirror images may be
    // patches of their own.
    std::map<PlaceKey, int> patch_at;
    const auto place = [&](int t) {
      const std::array<Vec3d, 3> corner = scene.reference_corners(t);
      return place_key(folded((corner[0] + corner[1] + corner[2]) / 3.0, symmetry));
    };
    for (int t = 0; t < int(of_.size()) && scene.on_body(t); ++t)
      if (std::holds_alternative<Lambertian>(scene.optics(t))) {
        const auto [it, fresh] = patch_at.try_emplace(place(t), scene.surface_number(t));
        it->second = std::min(it->second, scene.surface_number(t));
      }
    std::map<std::tuple<int, PlaceKey, PlaceKey, double>, int> known;
    for (int t = 0; t < int(of_.size()); ++t) {
      const SurfaceOptics& optics = scene.optics(t);
      const Lambertian* surface = std::get_if<Lambertian>(&optics);
      if (surface == nullptr) continue;
      const std::array<Vec3d, 3> corner = scene.reference_corners(t);
      Vec3d side = Vec3d::Zero();
      if (!scene.on_body(t)) {
        const Vec3d middle = (corner[0] + corner[1] + corner[2]) / 3.0;
        side = 1e-3 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
        if (symmetry.x && middle.x() < 0.0) side.x() = -side.x();
        if (symmetry.y && middle.y() < 0.0) side.y() = -side.y();
      }
      const int patch = scene.on_body(t) ? patch_at[place(t)] : -1;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto key = std::tuple(patch, place_key(folded(corner[k], symmetry)), place_key(side), surface->albedo);
        const auto [it, fresh] = known.try_emplace(key, int(albedo_.size()));
        if (fresh) albedo_.push_back(surface->albedo), area_.push_back(0.0);
        of_[std::size_t(t)][k] = it->second;
        area_[std::size_t(it->second)] += scene.triangle_area(t) / 3.0;
      }
    }
  }

  std::size_t size() const { return albedo_.size(); }
  /// The three nodes of a triangle; −1: it is not Lambertian.
  const std::array<int, 3>& of(int triangle) const { return of_[std::size_t(triangle)]; }
  /// Shares of the nodes at a point of a triangle.
  static std::array<double, 3> shares(const ScenePoint& p) { return {1.0 - p.u - p.v, p.u, p.v}; }
  double albedo(std::size_t node) const { return albedo_[node]; }
  /// Integral of the node's function, over all its mirror images [m²].
  double area(std::size_t node) const { return area_[node]; }

 private:
  std::vector<std::array<int, 3>> of_;
  std::vector<double> albedo_, area_;
};

}  // namespace lumo
