#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/optics/beer_lambert.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/optics/fresnel.hpp"
#include "lumo/optics/intersector.hpp"
#include "lumo/optics/ledger.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/surface_optics.hpp"
#include "lumo/optics/transport/face_set.hpp"
#include "lumo/optics/transport/light_accounts.hpp"
#include "lumo/optics/transport/light_nodes.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <variant>
#include <vector>

namespace lumo {

struct PathLimits {
  double roulette_below, scattered_below;
  int max_events;
};

/// Follows one primary ray through all its branches and books where its power goes. One object per replicate.
/// The medium is a state of the ray, never inferred from counted hits.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class PathTracer {
 public:
  /// `nodes`: collect what falls on Lambertian faces. `exits`: faces whose light NextEventGather finds, if it came straight
  /// from an emitter or a face.
  PathTracer(const OpticalScene& surface, const Scene& scene, const Medium& medium, double outer_index,
             const Readout& readout, int channels, const LightNodes& nodes, const FaceSet& exits, Symmetry symmetry,
             const PathLimits& limits)
      : surface_(surface),
        scene_(scene),
        medium_(medium),
        outer_index_(outer_index),
        nodes_(nodes),
        exits_(exits),
        limits_(limits),
        accounts_(surface, readout, channels, nodes.size(), symmetry) {}

  /// Traces `ray`, which starts in the body, or (`inside` false) in the air, as a path of the mirror image `mirror`.
  /// `from_emitter`: not from a Lambertian face. `log`: takes the exits of light from emitters that no gathering finds,
  /// instead of the channels. `gathers_direct`: NextEventGather finds the emitter's direct light.
  void run(const PrimaryRay& ray, const Vec3d& mirror, double power_W, bool from_emitter, bool inside = true,
           std::vector<Exit>* log = nullptr, bool gathers_direct = true) {
    ++rays;
    mirror_ = mirror;
    start_ = power_W;
    from_emitter_ = from_emitter;
    gathers_direct_ = gathers_direct;
    accounts_.book(accounts_.ledger.emitted, power_W);
    Branch first;
    first.origin = ray.origin, first.direction = ray.direction, first.power = power_W, first.key = ray.key;
    first.triangle = ray.triangle, first.direct = from_emitter, first.inside = inside;
    log_ = log;
    stack_.push_back(first);
    while (!stack_.empty()) {
      const Branch b = stack_.back();
      stack_.pop_back();
      follow(b);
    }
  }

  /// Where the power went.
  LightAccounts<Readout>& accounts() { return accounts_; }

  long rays = 0, segments = 0;

 private:
  struct Branch {
    Vec3d origin = Vec3d::Zero(), direction = Vec3d::Zero();
    double power = 0.0;
    std::uint64_t key = 0;
    int exit_triangle = -1;
    ScenePoint exit;  ///< where a ray in air left the body
    Vec3d exit_position = Vec3d::Zero();
    std::uint64_t route = 0;
    int triangle = -1;  ///< that it starts on
    int events = 0;
    bool inside = true;
    bool direct = true;         ///< light that was refracted out at most
    bool carrier_last = false;  ///< in air: met the carrier since it left the body
    bool scattered = false;     ///< in the medium, once at least
    bool spread = false;        ///< by a tool that wets the body: like a scattered one it has no neighbours
  };

  // Russian roulette; what it ends or adds has its own account, so that the ledger closes. False: ended.
  bool survives(Branch& b) {
    b.direct = false;
    if (!(b.power > 0.0)) return false;
    const double full = (b.scattered ? limits_.scattered_below : limits_.roulette_below) * start_;
    if (b.power >= full) return true;
    if (uniform(combine(b.key, 0)) * full < b.power) {
      accounts_.book(accounts_.ledger.roulette, b.power - full);
      b.power = full;
      return true;
    }
    accounts_.book(accounts_.ledger.roulette, b.power);
    return false;
  }

  void escape(const Branch& b) {
    EnergyLedger& ledger = accounts_.ledger;
    if (b.exit.face < 0) return accounts_.book(ledger.elsewhere, b.power);
    const bool gathered = exits_.has(b.exit) && !b.carrier_last && (b.direct ? gathers_direct_ : !from_emitter_);
    const bool lone = b.scattered || b.spread ||
                      (b.direct && !gathers_direct_);  // no neighbour to share with, or counted as direct light
    const Escape light{surface_.reference(b.exit), b.exit_position, b.direction, -1};
    const Exit e{b.route, light, b.exit, surface_.flat_normal(b.exit_triangle), surface_.patch_number(b.exit), b.power};
    if (log_ != nullptr && from_emitter_ && !gathered && !lone)
      log_->push_back(e);
    else
      accounts_.book_exit(e, b.direct, gathered);
  }

  void follow(Branch b);
  void scatter(const Branch& b, double path_m, double power);
  bool meet(Branch& b, int triangle);
  bool reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3d& normal, double& absorbed);
  bool meet_dielectric(Branch& b, int triangle, const ScenePoint& at);

  const OpticalScene& surface_;
  const Scene& scene_;
  const Medium& medium_;
  double outer_index_;
  const LightNodes& nodes_;
  const FaceSet& exits_;
  PathLimits limits_;
  LightAccounts<Readout> accounts_;
  std::vector<Exit>* log_ = nullptr;
  std::vector<Branch> stack_;
  Vec3d mirror_ = Vec3d::Ones();
  double start_ = 0.0;
  bool from_emitter_ = true, gathers_direct_ = true;
};

template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
void PathTracer<Scene, Medium, Readout>::follow(Branch b) {
  for (;;) {
    RayHit hit;
    if (++b.events <= limits_.max_events && b.direction.allFinite() && b.origin.allFinite()) {
      ++segments;
      hit = scene_.first_hit(b.origin, b.direction, b.inside);
      if (!hit && !b.inside) return escape(b);
      if (!hit &&
          b.triangle >= 0) {  // slipped out by rounding at an edge: once more from a point that is surely inside
        b.origin = surface_.pulled_inward(b.triangle, b.origin);
        hit = scene_.first_hit(b.origin, b.direction, b.inside);
      }
    }
    if (!hit) return accounts_.book(accounts_.ledger.lost, b.power);
    const auto& corner = surface_.triangles()[std::size_t(hit.triangle)].corners;
    const Vec3d n = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    const double t =
        std::max(0.0, n.dot(corner[0] - b.origin) / n.dot(b.direction));  // single-precision scenes: t again in double
    const double path_m = std::isfinite(t) ? t : std::max(0.0, hit.t);
    if (b.inside) {
      const double left = b.power * medium_.transmittance(path_m);
      double absorbed = b.power - left;
      if constexpr (TurbidMedium<Medium>) {
        const double scattered = medium_.albedo() * absorbed;
        absorbed -= scattered;
        scatter(b, path_m, scattered);
      }
      accounts_.book(accounts_.ledger.absorbed_in_medium, absorbed);
      b.power = left;
    }
    b.origin += path_m * b.direction;
    if (!meet(b, hit.triangle)) return;
  }
}

// Light that is scattered on a straight piece goes on from one place on it. The rest runs straight through as in a
// clear medium, so that direct light and what is gathered backwards stay free of scattering's noise: there too, each
// piece sends on both.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
void PathTracer<Scene, Medium, Readout>::scatter(const Branch& b, double path_m, double power) {
  if constexpr (TurbidMedium<Medium>) {
    if (!(power > 0.0)) return;
    Branch c = b;
    c.power = power;
    c.key = combine(b.key, 6);
    c.scattered = true;
    if (!survives(c)) return;
    const Vec3d axis = mirror_.cwiseProduct(b.direction);  // image paths take image directions
    const double cosine = medium_.scattering_cosine(uniform(combine(c.key, 2))),
                 azimuth = 2.0 * pi * uniform(combine(c.key, 3));
    const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
    Vec3d t1, t2;
    tangents(axis, t1, t2);
    c.origin += medium_.free_path_m(path_m, uniform(combine(c.key, 4))) * b.direction;
    c.direction = mirror_.cwiseProduct(
        (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + cosine * axis).normalized());
    stack_.push_back(c);
  }
}

// What happens at a surface. True: `b` goes on.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::meet(Branch& b, int triangle) {
  const ScenePoint at = surface_.locate(triangle, b.origin);
  b.triangle = triangle;
  const SurfaceOptics& optics = surface_.optics(triangle);
  if (is_dielectric(optics)) {
    if (at.face >= 0) return meet_dielectric(b, triangle, at);
    accounts_.book(accounts_.ledger.absorbed_at_surfaces, b.power);  // a carrier face is opaque, whatever it says
    return false;
  }
  if (const auto& nodes = nodes_.of(triangle);
      nodes[0] >= 0 && b.inside == (at.face >= 0)) {  // goes on with all else that falls there
    const std::array<double, 3> share = LightNodes::shares(at);
    for (std::size_t k = 0; k < 3; ++k)
      if (share[k] > 0.0) accounts_.arrive(nodes[k], share[k] * b.power);
    return false;
  }
  b.carrier_last = !b.inside;
  return reflect_off(b, optics, b.inside ? Vec3d(-surface_.flat_normal(triangle)) : surface_.flat_normal(triangle),
                     accounts_.ledger.absorbed_at_surfaces);
}

// At an opaque surface whose unit normal points back to where the light comes from.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3d& normal,
                                                     double& absorbed) {
  b.key = combine(b.key, 1);
  std::visit(
      [&](const auto& s) {
        if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) {
          const double kept = b.power * reflectance(s);
          accounts_.book(absorbed, b.power - kept);
          b.power = kept;
          b.direction =
              reflected(s, b.direction, normal, uniform(combine(b.key, 2)), uniform(combine(b.key, 3)), mirror_);
        }
      },
      optics);
  return survives(b);
}

template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
bool PathTracer<Scene, Medium, Readout>::meet_dielectric(Branch& b, int triangle, const ScenePoint& at) {
  const bool touched = surface_.in_contact(at);
  if (!b.inside && touched) {  // from air: the opaque indenter is in the way
    accounts_.book(accounts_.ledger.to_indenter, b.power);
    return false;
  }
  if (touched && !is_dielectric(surface_.touched())) {  // the tool wets it: no air is left between
    const Vec3d flat = -surface_.flat_normal(triangle), curved = -surface_.smooth_normal(at);
    const bool specular = std::holds_alternative<Mirror>(surface_.touched());
    b.spread = b.spread || !specular;
    const bool smooth = specular && b.direction.dot(curved) < 0.0 && reflect(b.direction, curved).dot(flat) > 0.0;
    return reflect_off(b, surface_.touched(), smooth ? curved : flat, accounts_.ledger.to_indenter);
  }
  const double side = b.inside ? -1.0 : 1.0;  // normals point back to where the light comes from
  const double ratio = b.inside ? medium_.refractive_index() / outer_index_ : outer_index_ / medium_.refractive_index();
  const Vec3d flat = side * Vec3d(surface_.flat_normal(triangle));
  Vec3d n = side * Vec3d(surface_.smooth_normal(at));
  FresnelSplit split{};
  Vec3d back, on;
  const auto turn = [&] {
    const double cosine = std::min(1.0, -b.direction.dot(n));
    split = fresnel(cosine, ratio);
    back = reflect(b.direction, n);
    on = refract(b.direction, n, ratio, split.cosine_behind);
    return cosine > 0.0 && back.dot(flat) > 0.0 && (split.reflectance >= 1.0 || on.dot(flat) < 0.0);
  };
  if (!turn()) {  // at grazing angles the curved normal may contradict the facet that was hit
    n = flat;
    turn();
  }
  const double reflected_power = b.power * split.reflectance;
  const double refracted_power = b.power - reflected_power;
  const std::uint64_t key = b.key, route = combine(b.route, 2 * std::uint64_t(surface_.surface_number(triangle)));
  if (refracted_power > 0.0) {
    if (b.inside && touched) {
      accounts_.book(accounts_.ledger.to_indenter, refracted_power);
    } else {
      Branch c = b;
      c.direction = on;
      c.power = refracted_power;
      c.key = combine(key, 4);
      c.route = route + 1;
      c.inside = !b.inside;
      if (c.inside) {
        if (survives(c)) stack_.push_back(c);
      } else {
        c.exit = at;
        c.exit_triangle = triangle;
        c.exit_position = b.origin;
        c.carrier_last = false;
        stack_.push_back(c);
      }
    }
  }
  b.direction = back;
  b.power = reflected_power;
  b.key = combine(key, 5);
  b.route = route;
  return survives(b);
}

}  // namespace lumo
