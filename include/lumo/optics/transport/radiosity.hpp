#pragma once

#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/response.hpp"
#include "lumo/optics/surface_optics.hpp"
#include "lumo/optics/transport/face_set.hpp"
#include "lumo/optics/transport/light_accounts.hpp"
#include "lumo/optics/transport/ray_guide.hpp"

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
  LightNodes(const OpticalScene& scene, Symmetry symmetry, const RayGuide& guide = {})
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
        if (fresh) {
          albedo_.push_back(surface->albedo);
          area_.push_back(0.0);
          in_air_.push_back(!scene.on_body(t));
        }
        of_[std::size_t(t)][k] = it->second;
        area_[std::size_t(it->second)] += scene.triangle_area(t) / 3.0;
      }
    }
    bright_.assign(size(), false);
    for (std::size_t t = 0; t < guide.sent_W_m2.size(); ++t)
      if (guide.sent_W_m2[t] > guide.bright_W_m2)
        for (int k : of_[t]) bright_[std::size_t(k)] = true;
  }

  std::size_t size() const { return albedo_.size(); }
  /// The three nodes of a triangle; −1: it is not Lambertian.
  const std::array<int, 3>& of(int triangle) const { return of_[std::size_t(triangle)]; }
  /// Shares of the nodes at a point of a triangle.
  static std::array<double, 3> shares(const ScenePoint& p) { return {1.0 - p.u - p.v, p.u, p.v}; }
  double albedo(std::size_t node) const { return albedo_[node]; }
  /// Integral of the node's function, over all its mirror images [m²].
  double area(std::size_t node) const { return area_[node]; }
  /// Light meets it in the surroundings, not in the body.
  bool in_air(std::size_t node) const { return in_air_[node]; }
  /// Its light is found by paths from it, not backwards from where it leaves.
  bool is_bright(std::size_t node) const { return bright_[node]; }

 private:
  std::vector<std::array<int, 3>> of_;
  std::vector<double> albedo_, area_;
  std::vector<bool> in_air_, bright_;
};

/// Form factors of the nodes of Lambertian faces, sampled: the way of one watt from each.
class RadiosityTransport {
 public:
  RadiosityTransport(std::size_t nodes, int channels) : sums_(nodes), weights_(nodes, 0.0) {
    for (Tally& t : sums_) {
      t.gathered.assign(std::size_t(channels), 0.0);
      t.ledger.channels = t.gathered;
    }
  }
  /// Adds what became of a ray of one watt that stands for the area `area_m2` about a point with these shares of the
  /// nodes.
  void add(const Tally& ray, const std::array<int, 3>& nodes, const std::array<double, 3>& shares, double area_m2) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double w = shares[k] * area_m2;
      Tally& sum = sums_[std::size_t(nodes[k])];
      weights_[std::size_t(nodes[k])] += w;
      add_scaled(sum.ledger, ray.ledger, w);
      for (std::size_t c = 0; c < sum.gathered.size(); ++c) sum.gathered[c] += w * ray.gathered[c];
      for (const auto& [j, power] : ray.arrived) sum.arrived.emplace_back(j, w * power);
    }
  }
  std::size_t size() const { return sums_.size(); }
  const Tally& sum(std::size_t node) const { return sums_[node]; }
  /// Factor that takes sum(node) to one watt; 0 if nothing was added.
  double per_watt(std::size_t node) const { return weights_[node] > 0.0 ? 1.0 / weights_[node] : 0.0; }

 private:
  std::vector<Tally> sums_;
  std::vector<double> weights_;
};

/// Light that falls on a Lambertian face goes on as a Lambertian source that is linear between nodes (radiosity: Goral
/// et al. 1984). The rays that a face sends do not depend on what arrives: states differ smoothly, and further bounces
/// cost no rays. Sends on what arrived at the nodes, bounce after bounce, until less than 1e-13 of the emitted power is
/// under way. `total`: the emitters' own tally, completed here. Returns the power that each node sent [W]. Jacobi
/// iteration of the radiosity equation p = e + Tᵀ(albedo·p); it ends because every factor is at most 1.
inline std::vector<double> solve_radiosity(const LightNodes& nodes, const RadiosityTransport& transport, Tally& total) {
  std::vector<double> now(nodes.size(), 0.0), next(nodes.size(), 0.0), sent(nodes.size(), 0.0);
  for (const auto& [k, power] : total.arrived) now[std::size_t(k)] += power;
  EnergyLedger& ledger = total.ledger;
  const double emitted = ledger.emitted;
  constexpr int most_bounces = 10000;
  constexpr double under_way = 1e-13;  // of the emitted power
  double left = 0.0;
  for (int bounce = 0; bounce < most_bounces; ++bounce) {
    left = 0.0;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const double on = now[k] * nodes.albedo(k);
      ledger.absorbed_at_surfaces += now[k] - on;
      sent[k] += on;
      const double each = on * transport.per_watt(k);
      if (each > 0.0)
        for (const auto& [j, share] : transport.sum(k).arrived) next[std::size_t(j)] += each * share;
    }
    for (double p : next) left += p;
    now.swap(next);
    std::fill(next.begin(), next.end(), 0.0);
    if (left < under_way * emitted) break;
  }
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const double each = sent[k] * transport.per_watt(k);
    add_scaled(ledger, transport.sum(k).ledger, each);
    if (nodes.is_bright(k)) continue;
    for (std::size_t c = 0; c < total.gathered.size(); ++c) total.gathered[c] += each * transport.sum(k).gathered[c];
  }
  ledger.emitted = emitted;
  ledger.lost += left;
  return sent;
}

}  // namespace lumo
