#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/optics/beer_lambert.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/optics/intersector.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/response.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/surface_optics.hpp"
#include "lumo/optics/transport/emitter_faces.hpp"
#include "lumo/optics/transport/face_set.hpp"
#include "lumo/optics/transport/light_accounts.hpp"
#include "lumo/optics/transport/radiosity.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <variant>
#include <vector>

namespace lumo {

/// A body in one state as its light meets it, and the readout: the input of all steps of a trace.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> struct LitBody {
  const OpticalScene& surface;
  const Scene& scene;
  const Medium& medium;
  double outer_index;  ///< refractive index of the surroundings
  const Readout& readout;
  int channels;             ///< of the readout
  const LightNodes& nodes;  ///< collect the light that falls on Lambertian faces
  const FaceSet& exits;     ///< faces whose light NextEventGather finds, if it came straight from an emitter or a face
  Symmetry symmetry;

  double index_ratio() const { return medium.refractive_index() / outer_index; }  ///< inside / outside
};

/// When paths end; see Tracer::Config.
struct PathLimits {
  double roulette_below, scattered_below;
  int max_events;
};

/// A primary ray, and what its path is traced for.
struct PathStart {
  PrimaryRay ray;
  Vec3d mirror;  ///< (±1, ±1, 1): the mirror image that the path belongs to
  double power_W;
  bool from_emitter = true;    ///< else from a Lambertian face
  bool inside = true;          ///< starts in the body, else in the air
  bool gathers_direct = true;  ///< NextEventGather finds the emitter's direct light
  bool gathers_all = false;    ///< NextEventGather finds all of the emitter's light
  /// Takes the exits of light from emitters that no gathering finds, instead of the channels, if given.
  std::vector<Exit>* exits = nullptr;
};

/// Follows one primary ray through all its branches and books where its power goes. One object per replicate.
/// The medium is a state of the ray, never inferred from counted hits.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class PathTracer {
 public:
  PathTracer(const LitBody<Scene, Medium, Readout>& body, const PathLimits& limits)
      : body_(body),
        limits_(limits),
        accounts_(body.surface, body.readout, body.channels, body.nodes.size(), body.symmetry) {}

  /// `emitters`: those that a path meets which runs backwards.
  void run(const PathStart& start, const EmitterFaces<Scene>* emitters = nullptr) {
    ++rays;
    start_ = &start;
    emitters_ = emitters;
    accounts_.book(accounts_.ledger.emitted, start.power_W);
    Branch first;
    first.origin = start.ray.origin;
    first.direction = start.ray.direction;
    first.power = start.power_W;
    first.key = start.ray.key;
    first.triangle = start.ray.triangle;
    first.direct = start.from_emitter;
    first.inside = start.inside;
    stack_.push_back(first);
    while (!stack_.empty()) {
      const Branch b = stack_.back();
      stack_.pop_back();
      follow(b);
    }
  }

  /// Power per path × π × radiance of emitters that backward paths met since the last call [W/m² for paths of 1].
  double take_emitted() { return std::exchange(emitted_, 0.0); }

  /// Accounts of the power.
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
    double density = 0.0;       ///< of its direction [1/sr], if it was scattered and met no surface since
  };

  /// Light at a smooth interface.
  struct Split {
    FresnelSplit<double> share;
    Vec3d back, on;  ///< directions of the reflected and of the refracted ray
  };

  // Russian roulette. Its losses and gains have their own account, so that the ledger closes. False: ended.
  bool survives(Branch& b) {
    b.direct = false;
    if (!(b.power > 0.0)) return false;
    const double full = (b.scattered ? limits_.scattered_below : limits_.roulette_below) * start_->power_W;
    if (b.power >= full) return true;
    if (uniform(combine(b.key, 0)) * full < b.power) {
      accounts_.book(accounts_.ledger.roulette, b.power - full);
      b.power = full;
      return true;
    }
    accounts_.book(accounts_.ledger.roulette, b.power);
    return false;
  }

  // Route of the branch that is reflected at `triangle`; the refracted one has the next number.
  std::uint64_t route(const Branch& b, int triangle) const {
    return combine(b.route, 2 * std::uint64_t(body_.surface.surface_number(triangle)));
  }

  void escape(const Branch& b) {
    EnergyLedger& ledger = accounts_.ledger;
    if (b.exit.face < 0) return accounts_.book(ledger.elsewhere, b.power);
    const bool gathered = body_.exits.has(b.exit) && !b.carrier_last &&
                          (b.direct ? start_->gathers_direct : !start_->from_emitter || start_->gathers_all);
    // It has no neighbour to share with, or counts as direct light.
    const bool lone = b.scattered || b.spread || (b.direct && !start_->gathers_direct);
    const Escape light{body_.surface.reference(b.exit), b.exit_position, b.direction, -1};
    const Exit e{b.route, light, b.exit, body_.surface.flat_normal(b.exit_triangle), body_.surface.patch_number(b.exit),
        b.power};
    if (start_->exits != nullptr && start_->from_emitter && !gathered && !lone) start_->exits->push_back(e);
    else accounts_.book_exit(e, b.direct, gathered);
  }

  void follow(Branch b) {
    for (;;) {
      RayHit hit;
      if (++b.events <= limits_.max_events && b.direction.allFinite() && b.origin.allFinite()) {
        ++segments;
        hit = body_.scene.first_hit(b.origin, b.direction, b.inside);
        if (!hit && !b.inside) {
          meet_emitters(b, std::numeric_limits<double>::infinity());
          return escape(b);
        }
        if (!hit && b.triangle >= 0) {  // slipped out at an edge by rounding: once more from a point inside
          b.origin = body_.surface.pulled_inward(b.triangle, b.origin);
          hit = body_.scene.first_hit(b.origin, b.direction, b.inside);
        }
      }
      if (!hit) return accounts_.book(accounts_.ledger.lost, b.power);
      const auto& corner = body_.surface.triangles()[std::size_t(hit.triangle)].corners;
      const Vec3d n = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
      // Scenes may be in single precision: the distance again, in double.
      const double t = std::max(0.0, n.dot(corner[0] - b.origin) / n.dot(b.direction));
      const double path_m = std::isfinite(t) ? t : std::max(0.0, hit.t);
      meet_emitters(b, path_m);
      if (b.inside) {
        const double left = b.power * body_.medium.transmittance(path_m);
        double absorbed = b.power - left;
        if constexpr (TurbidMedium<Medium>) {
          const double scattered = body_.medium.albedo() * absorbed;
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

  void meet_emitters(const Branch& b, double path_m) {
    if (emitters_ == nullptr) return;
    accounts_.book(emitted_, b.power * emitters_->exitance({b.origin, b.direction, path_m, b.inside, b.density},
                                           [&](double s) { return body_.medium.transmittance(s); }));
  }

  // Light that is scattered on a straight piece goes on from one place on it. The rest runs straight through as in a
  // clear medium, so that direct light and what is gathered backwards stay free of scattering's noise: there too, each
  // piece sends on both.
  void scatter(const Branch& b, double path_m, double power) {
    if constexpr (TurbidMedium<Medium>) {
      if (!(power > 0.0)) return;
      Branch c = b;
      c.power = power;
      c.key = combine(b.key, 6);
      c.scattered = true;
      if (!survives(c)) return;
      const Vec3d axis = start_->mirror.cwiseProduct(b.direction);  // image paths take image directions
      const double cosine = body_.medium.scattering_cosine(uniform(combine(c.key, 2))),
                   azimuth = 2.0 * pi * uniform(combine(c.key, 3));
      const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
      Vec3d t1, t2;
      tangents(axis, t1, t2);
      c.origin += body_.medium.free_path_m(path_m, uniform(combine(c.key, 4))) * b.direction;
      c.direction = start_->mirror.cwiseProduct(
          (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + cosine * axis).normalized());
      if constexpr (PhaseMedium<Medium>)
        if (emitters_ != nullptr) {
          const double u = uniform(combine(c.key, 7)), v = uniform(combine(c.key, 8));
          accounts_.book(emitted_, c.power * emitters_->scattered(c.origin, b.direction, body_.medium, u, v));
          c.density = body_.medium.phase(cosine);
        }
      stack_.push_back(c);
    }
  }

  // The event at a surface. True: `b` goes on.
  bool meet(Branch& b, int triangle) {
    const ScenePoint at = body_.surface.locate(triangle, b.origin);
    b.triangle = triangle;
    b.density = 0.0;
    const SurfaceOptics& optics = body_.surface.optics(triangle);
    if (is_dielectric(optics)) {
      if (at.face >= 0) return meet_dielectric(b, triangle, at);
      accounts_.book(accounts_.ledger.absorbed_at_surfaces, b.power);  // a carrier face is opaque, whatever it says
      return false;
    }
    // Light on a Lambertian face goes on with all other light that falls there.
    if (const auto& nodes = body_.nodes.of(triangle); nodes[0] >= 0 && b.inside == (at.face >= 0)) {
      const std::array<double, 3> share = LightNodes::shares(at);
      for (std::size_t k = 0; k < 3; ++k)
        if (share[k] > 0.0) accounts_.arrive(nodes[k], share[k] * b.power);
      return false;
    }
    b.carrier_last = !b.inside;
    const Vec3d normal = b.inside ? Vec3d(-body_.surface.flat_normal(triangle)) : body_.surface.flat_normal(triangle);
    const Vec3d came = b.direction;
    return reflect_off(b, optics, normal, [&](double power) {
      if (LandingReadout<Readout> && at.face >= 0)
        accounts_.book_landing({body_.surface.reference(at), b.origin, came, body_.surface.patch_number(at)}, power);
      else accounts_.book(accounts_.ledger.absorbed_at_surfaces, power);
    });
  }

  // Reflection off an opaque surface whose unit normal points back to where the light comes from. `absorb` is given
  // what stays there [W].
  template <class Absorb>
  bool reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3d& normal, Absorb&& absorb) {
    b.key = combine(b.key, 1);
    std::visit(
        [&](const auto& s) {
          if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) {
            const double kept = b.power * reflectance(s);
            absorb(b.power - kept);
            b.power = kept;
            b.direction = reflected(
                s, b.direction, normal, uniform(combine(b.key, 2)), uniform(combine(b.key, 3)), start_->mirror);
          }
        },
        optics);
    return survives(b);
  }

  bool meet_dielectric(Branch& b, int triangle, const ScenePoint& at) {
    const bool touched = body_.surface.in_contact(at);
    if (!b.inside && touched) {  // from air: the opaque indenter is in the way
      accounts_.book(accounts_.ledger.to_indenter, b.power);
      return false;
    }
    if (touched && !is_dielectric(body_.surface.touched())) return meet_wetting_tool(b, triangle, at);
    const Split met = split(b, triangle, at);
    const double reflected_power = b.power * met.share.reflectance;
    send_on(b, triangle, at, met, touched);
    b.direction = met.back;
    b.power = reflected_power;
    b.key = combine(b.key, 5);
    b.route = route(b, triangle);
    return survives(b);
  }

  // A tool that wets the body: no air is left between.
  bool meet_wetting_tool(Branch& b, int triangle, const ScenePoint& at) {
    const Vec3d flat = -body_.surface.flat_normal(triangle), curved = -body_.surface.smooth_normal(at);
    const bool specular = std::holds_alternative<Mirror>(body_.surface.touched());
    b.spread = b.spread || !specular;
    const bool smooth = specular && b.direction.dot(curved) < 0.0 && reflect(b.direction, curved).dot(flat) > 0.0;
    return reflect_off(b, body_.surface.touched(), smooth ? curved : flat,
        [&](double power) { accounts_.book(accounts_.ledger.to_indenter, power); });
  }

  Split split(const Branch& b, int triangle, const ScenePoint& at) const {
    const double side = b.inside ? -1.0 : 1.0;  // normals point back to where the light comes from
    const double ratio = b.inside ? body_.medium.refractive_index() / body_.outer_index
                                  : body_.outer_index / body_.medium.refractive_index();
    const Vec3d flat = side * Vec3d(body_.surface.flat_normal(triangle));
    Vec3d n = side * Vec3d(body_.surface.smooth_normal(at));
    Split met{};
    const auto turn = [&] {
      const double cosine = std::min(1.0, -b.direction.dot(n));
      met.share = fresnel(cosine, ratio);
      met.back = reflect(b.direction, n);
      met.on = refract(b.direction, n, ratio, met.share.cosine_behind);
      return cosine > 0.0 && met.back.dot(flat) > 0.0 && (met.share.reflectance >= 1.0 || met.on.dot(flat) < 0.0);
    };
    if (!turn()) {  // at grazing angles the curved normal may contradict the facet that was hit
      n = flat;
      turn();
    }
    return met;
  }

  // The refracted branch.
  void send_on(const Branch& b, int triangle, const ScenePoint& at, const Split& met, bool touched) {
    const double refracted_power = b.power - b.power * met.share.reflectance;
    if (!(refracted_power > 0.0)) return;
    if (b.inside && touched) return accounts_.book(accounts_.ledger.to_indenter, refracted_power);
    Branch c = b;
    c.direction = met.on;
    c.power = refracted_power;
    c.key = combine(b.key, 4);
    c.route = route(b, triangle) + 1;
    c.inside = !b.inside;
    if (c.inside) {
      if (!survives(c)) return;
    } else {
      c.exit = at;
      c.exit_triangle = triangle;
      c.exit_position = b.origin;
      c.carrier_last = false;
    }
    stack_.push_back(c);
  }

  const LitBody<Scene, Medium, Readout> body_;
  PathLimits limits_;
  LightAccounts<Readout> accounts_;
  std::vector<Branch> stack_;
  const PathStart* start_ = nullptr;               ///< of the path at hand
  const EmitterFaces<Scene>* emitters_ = nullptr;  ///< likewise
  double emitted_ = 0.0;
};

}  // namespace lumo
