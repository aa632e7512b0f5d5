#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/mechanics/state.hpp"
#include "lumo/mesh/tet_mesh.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/optics/beer_lambert.hpp"
#include "lumo/optics/bvh.hpp"
#include "lumo/optics/carrier_exchange.hpp"
#include "lumo/optics/exit_gather.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/optics/face_set.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/path_tracer.hpp"
#include "lumo/optics/ray_pattern.hpp"
#include "lumo/optics/response.hpp"

#include <bit>
#include <cstdint>
#include <variant>
#include <vector>

namespace lumo {

/// Traces light from a body's emitters through its deformed shape, and says how much of it each channel of the readout sees.
///
/// Lambertian emitters in the medium, both Fresnel branches at smooth interfaces, opaque carrier, straight rays in air (model: paper §III).
/// 1. Paths from the emitters, on an Owen-scrambled Sobol pattern that is the same for every design, state and emitter, until they are
///    absorbed, leave for good, or fall on a Lambertian face of the body.
/// 2. Lambertian faces exchange their light (carrier_exchange.hpp): each sends what falls on it uniformly over the face, or sub-facet.
/// 3. What leaves through faces with regions is gathered backwards from them (exit_gather.hpp): direct light and light of the carrier.
/// Later events draw numbers keyed by (path, event). Same arguments, same bits, whatever the thread; const and thread-safe: run one
/// state per task. Errors: of the integration, stated in the Response; of uniform light on patches up to 2.5 mm, below 0.3 % of r and
/// 2 % of a difference of neighbouring states (measured; 4 mm: 1 % and 15 %).
template <TransparentMedium Medium = BeerLambert, ExitReadout Readout = ExitPower, Intersector Backend = Bvh>
class Tracer {
 public:
  struct Config {
    int rays_per_emitter = 1 << 15;   ///< over all replicates; a power of two
    int replicates = 8;               ///< independent scrambles of the pattern; a power of two ≥ 2, ≤ rays_per_emitter/4
    int carrier_rays = 1 << 15;       ///< over all replicates and Lambertian faces of the body; each face takes a power of two ≥ 2
    int exit_rays = 1 << 18;          ///< likewise over the faces with regions, from where light is gathered backwards; 0: not done
    double carrier_patch_m = 2.5e-3;  ///< larger Lambertian faces exchange light by their sub-facets
    double roulette_below = 0.05;     ///< branches below this share of their path's start weight may be ended
    int max_events = 4096;            ///< a branch that meets more surfaces is booked as lost
    std::uint64_t seed = 0;           ///< another number, another independent pattern
    OpticalScene::Config scene{};
  };

  Tracer() = default;
  explicit Tracer(const Config& config, const Readout& readout = {}, const Backend& backend = {})
      : config_(config), readout_(readout), backend_(backend) {}

  const Config& config() const { return config_; }

  /// Response of the undeformed body. Uses its symmetry when mesh and emitters share it.
  Response trace(const Body& body, const TetMesh& mesh) const {
    const Symmetry s = RayPattern::symmetry_of(body.emitters), m = mesh.symmetry, b = body.symmetry;
    return trace(body, mesh, {}, {}, {s.x && m.x && b.x, s.y && m.y && b.y});
  }

  /// Response of a mechanical state. `symmetry`: planes in which body *and* state are their own mirror images.
  Response trace(const Body& body, const TetMesh& mesh, const MechanicalState& state, Symmetry symmetry = {}) const {
    return trace(body, mesh, state.displacement, state.contact_field, symmetry);
  }

  /// Response under `displacement` [m] and `contact_field` (> 0 in contact) per mesh node; either may be empty.
  /// In a plane of `symmetry` only one of two mirror images is traced, and booked for both: the caller vouches for it.
  /// Throws InvalidArgument for broken numbers, sizes or settings; never returns a NaN.
  Response trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement, const std::vector<double>& contact_field,
                 Symmetry symmetry = {}) const;

 private:
  Config config_{};
  Readout readout_{};
  Backend backend_{};
};

template <TransparentMedium Medium, ExitReadout Readout, Intersector Backend>
Response Tracer<Medium, Readout, Backend>::trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3>& displacement,
                                                 const std::vector<double>& contact_field, Symmetry symmetry) const {
  const auto power_of_two = [](const char* what, int value, int low) {
    require_in_range(what, value, low, 1 << 28, "");
    if (!std::has_single_bit(unsigned(value))) throw InvalidArgument(detail::text(what, " is ", value, ", must be a power of two"));
  };
  power_of_two("replicates", config_.replicates, 2);
  power_of_two("rays per emitter", config_.rays_per_emitter, 4 * config_.replicates);
  require_in_range("carrier rays", config_.carrier_rays, 1, 1 << 30, "");
  require_in_range("exit rays", config_.exit_rays, 0, 1 << 30, "");
  require_in_range("carrier patch", config_.carrier_patch_m * 1e3, 0.0, 1e6, "mm");
  require_in_range("roulette_below", config_.roulette_below, 0.0, 1.0, "");
  require_in_range("max_events", config_.max_events, 1, 1 << 28, "");
  if (body.surroundings.extinction_per_m != 0.0)
    throw InvalidArgument(detail::text("surroundings extinguish ", body.surroundings.extinction_per_m, " 1/m, only 0 1/m is known"));

  const Medium medium{body.medium};
  const OpticalScene surface(body, mesh, displacement, contact_field, symmetry, config_.scene);
  const auto scene = backend_.build(surface.triangles());
  const RayPattern pattern(body.emitters, std::uint32_t(config_.rays_per_emitter / config_.replicates), symmetry);
  const detail::FaceSet carrier(surface, symmetry, config_.carrier_patch_m,
                                [&](int f) { return std::holds_alternative<Lambertian>(surface.patch(f).optics); });
  const detail::FaceSet exits(surface, symmetry, 1e3, [&](int f) {
    return config_.exit_rays > 0 && is_dielectric(surface.patch(f).optics) && surface.has_region(f);
  });
  std::vector<double> albedo;
  for (std::size_t k = 0; k < carrier.size(); ++k) albedo.push_back(std::get<Lambertian>(surface.patch(carrier[k].face).optics).albedo);
  const int channels = readout_.channels(body);
  require_in_range("readout channels", channels, 0, 1 << 24, "");
  const double images = (symmetry.x ? 2.0 : 1.0) * (symmetry.y ? 2.0 : 1.0);
  const std::uint32_t per_carrier_face = carrier.per_face(double(config_.carrier_rays) / config_.replicates, images);
  const std::uint32_t per_exit_face = exits.per_face(double(config_.exit_rays) / config_.replicates, images);
  const double outer_index = BeerLambert(body.surroundings).refractive_index();

  Response response;
  response.replicates.resize(config_.replicates, channels);
  response.direct.resize(config_.replicates, channels);
  EnergyLedger& sum = response.ledger;
  sum.channels.assign(std::size_t(channels), 0.0);
  detail::PathTracer path(surface, scene, medium, outer_index, readout_, channels, carrier, exits, symmetry,
                          {config_.roulette_below, config_.max_events});
  detail::ExitGather gather(body, surface, scene, medium, outer_index, readout_, channels, carrier, exits, symmetry, path);
  std::vector<detail::FaceSet::Sample> samples;
  for (int r = 0; r < config_.replicates; ++r) {
    const auto sequence = [&](std::uint64_t use) { return OwenSobol{detail::combine(config_.seed, 3 * std::uint64_t(r) + use)}; };
    for (const RayPattern::Beam& beam : pattern.beams())
      for (std::uint32_t i = 0; i < beam.rays; ++i) path.run(RayPattern::ray(beam, sequence(0), i), beam.mirror, beam.power_W, true);
    detail::Tally total = path.take();
    std::vector<detail::Tally> from_face;
    for (std::size_t k = 0; k < carrier.size(); ++k) {
      samples.clear();
      double area = 0.0;
      for (std::uint32_t i = 0; i < per_carrier_face; ++i) {
        detail::FaceSet::Sample x = carrier.sample(k, surface, sequence(1), i, per_carrier_face);
        x.ray.direction = reflected(Lambertian{}, x.normal, -x.normal, sequence(1)(x.index, 0), sequence(1)(x.index, 1), carrier[k].mirror);
        area += x.area;
        samples.push_back(x);
      }
      for (const detail::FaceSet::Sample& x : samples) path.run(x.ray, carrier[k].mirror, x.area / (area * images), false);
      from_face.push_back(path.take());
    }
    const std::vector<double> sent = detail::exchange(albedo, from_face, total);
    gather.run(sequence(2), per_exit_face, sent, total);
    for (int c = 0; c < channels; ++c) {
      response.replicates(r, c) = total.ledger.channels[std::size_t(c)];
      response.direct(r, c) = total.direct[std::size_t(c)];
    }
    detail::add(sum, total.ledger, 1.0 / config_.replicates);
  }
  response.rays = path.rays;
  response.segments = path.segments;
  for (int c = 0; c < channels; ++c) sum.channels[std::size_t(c)] = response.replicates.col(c).mean();
  response.power_W = sum.channels;
  response.error_W = standard_error(response.replicates);
  return response;
}

}  // namespace lumo
