#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo {

/// How densely rays are sent along y: most where the body is pressed, since rays far from there find no change.
/// Default: evenly. A focus changes the error of a response, not its expected value. Compare responses of one focus
/// only: they share the rays.
struct RayFocus {
  double y_m = 0.0;
  double length_m = 0.0;     ///< the density falls by e over this distance; 0: nowhere
  double least = 1.0 / 8.0;  ///< of the density at y_m

  double density(double y) const {
    return length_m > 0.0 ? std::max(least, std::exp(-std::abs(y - y_m) / length_m)) : 1.0;
  }
  /// The same for y and −y?
  bool is_symmetric() const { return y_m == 0.0 || length_m == 0.0; }
};

/// A primary ray and what later events of its path draw their numbers from.
struct PrimaryRay {
  Vec3d origin{0.0, 0.0, 0.0};     ///< [m]
  Vec3d direction{0.0, 0.0, 1.0};  ///< unit
  std::uint64_t key = 0;           ///< the same for mirror images of a path
  int triangle = -1;               ///< of the scene that it starts on, if known
};

namespace detail {

/// Lengths below which two places of an emitter are one [m].
inline double place_tolerance(const Emitter& e) {
  return 1e-12 + 1e-9 * (e.point(0.1, 0.2) - e.point(0.9, 0.8)).norm();
}

/// Do two emitters radiate alike? Points and directions at some numbers are compared.
inline bool radiate_alike(const Emitter& a, const Emitter& b) {
  if (!a.same_model(b) || a.power_W() != b.power_W() || a.channel() != b.channel() || a.in_air() != b.in_air())
    return false;
  const double reach = place_tolerance(a);
  if ((a.center() - b.center()).norm() > reach || a.axis().dot(b.axis()) < 1.0 - 1e-12) return false;
  for (const auto& [u, v] : {std::pair(0.1, 0.2), std::pair(0.7, 0.1), std::pair(0.4, 0.9)})
    if ((a.point(u, v) - b.point(u, v)).norm() > reach) return false;
  for (double u : {0.05, 0.3, 0.5, 0.7, 0.95})
    if (std::abs(a.polar(u).cosine - b.polar(u).cosine) > 1e-12) return false;
  return true;
}

/// The mirror image with centre (and, in a plane, axis) in x ≥ 0, y ≥ 0.
inline Emitter fundamental(const Emitter& e, Vec3d& mirror) {
  const Vec3d center = e.center(), axis = e.axis();
  mirror = Vec3d::Ones();
  for (Eigen::Index a = 0; a < 2; ++a) {
    const bool in_plane = std::abs(center[a]) <= place_tolerance(e);
    if (in_plane ? axis[a] < -1e-9 : center[a] < 0.0) mirror[a] = -1.0;
  }
  return e.mirrored(mirror);
}

inline const Vec3d flip_x{-1.0, 1.0, 1.0}, flip_y{1.0, -1.0, 1.0};

}  // namespace detail

/// The one deterministic set of primary rays for all designs, states and emitters. Closed under x → −x and y → −y: a
/// point of the sequence makes a ray of the emitter moved to the quadrant x ≥ 0, y ≥ 0, and the rays of the real
/// emitters are its mirror images. An emitter that is its own mirror image shoots into a half or a quarter of the
/// hemisphere only, so that no ray is traced twice.
class RayPattern {
 public:
  /// The rays of one emitter that belong to one mirror image.
  struct Beam {
    Emitter source;  ///< moved to the fundamental quadrant
    Vec3d axis{0.0, 0.0, 1.0}, tangent1{1.0, 0.0, 0.0}, tangent2{0.0, 1.0, 0.0};
    double azimuth_from = 0.0, azimuth_range = 2.0 * pi;
    Vec3d mirror{1.0, 1.0, 1.0};  ///< (±1, ±1, 1): from the fundamental ray to the real one
    std::uint64_t orbit = 0;      ///< the same for emitters that are mirror images
    std::uint32_t rays = 0;       ///< per replicate
    double power_W = 0.0;         ///< per ray
  };

  /// `rays` per emitter and replicate, a power of two ≥ 4; with a focus about so many on average, each a power of two.
  /// `symmetry` keeps only one beam of each set of mirror images. Throws InvalidArgument for broken emitters, or
  /// if they do not have the symmetry.
  RayPattern(const std::vector<Emitter>& emitters, std::uint32_t rays, Symmetry symmetry, const RayFocus& focus = {}) {
    if (emitters.empty()) throw InvalidArgument("ray pattern: no emitters given, at least one is needed");
    for (const Emitter& e : emitters) e.validate();
    const Symmetry has = symmetry_of(emitters);
    if ((symmetry.x && !has.x) || (symmetry.y && !has.y))
      throw InvalidArgument("ray pattern: a symmetric state is claimed, but the emitters are not symmetric");
    double density = 0.0;
    for (const Emitter& e : emitters) density += focus.density(e.center().y()) / double(emitters.size());
    std::vector<Emitter> orbits;
    for (const Emitter& e : emitters) {
      Vec3d home;
      Beam beam{detail::fundamental(e, home)};
      const auto known = std::find_if(
          orbits.begin(), orbits.end(), [&](const auto& o) { return detail::radiate_alike(o, beam.source); });
      beam.orbit = std::uint64_t(known - orbits.begin());
      if (known == orbits.end()) orbits.push_back(beam.source);
      beam.source = orbits[beam.orbit];  // the very same bits for all images
      beam.axis = beam.source.axis();
      const bool own_x = detail::radiate_alike(beam.source.mirrored(detail::flip_x), beam.source);
      const bool own_y = detail::radiate_alike(beam.source.mirrored(detail::flip_y), beam.source);
      tangents(beam.axis, beam.tangent1, beam.tangent2);
      if (own_x || own_y) {
        beam.tangent1 = own_x ? Vec3d::UnitX() : Vec3d::UnitY();
        beam.tangent2 = beam.axis.cross(beam.tangent1);
        beam.azimuth_from = own_x && own_y ? 0.0 : -0.5 * pi;
        beam.azimuth_range = own_x && own_y ? 0.5 * pi : pi;
      }
      const std::uint32_t images = (own_x ? 2u : 1u) * (own_y ? 2u : 1u);
      const double wish = rays * focus.density(e.center().y()) / density;
      beam.rays = std::max(1u, std::max(4u, nearest_power_of_two(wish)) / images);
      beam.power_W = e.power_W() / double(beam.rays * images);
      for (std::uint32_t image = 0; image < 4; ++image) {
        if (((image & 1u) && !own_x) || ((image & 2u) && !own_y)) continue;
        beam.mirror = home;
        if (image & 1u) beam.mirror.x() = -beam.mirror.x();
        if (image & 2u) beam.mirror.y() = -beam.mirror.y();
        if ((symmetry.x && beam.mirror.x() < 0.0) || (symmetry.y && beam.mirror.y() < 0.0)) continue;
        beams_.push_back(beam);
      }
    }
  }

  const std::vector<Beam>& beams() const { return beams_; }

  /// Ray `index` of a beam, from numbers in (0, 1): angle to the axis and azimuth of its direction, then its place on
  /// the emitter.
  static PrimaryRay ray(const Beam& beam, const std::array<double, 4>& u, std::uint64_t seed, std::uint32_t index) {
    const double azimuth = beam.azimuth_from + beam.azimuth_range * u[1];
    const Polar polar = beam.source.polar(u[0]);
    const Vec3d d = (polar.sine * std::cos(azimuth) * beam.tangent1 + polar.sine * std::sin(azimuth) * beam.tangent2 +
                     polar.cosine * beam.axis)
                        .normalized();
    const Vec3d p = beam.source.point(u[2], u[3]);
    return {beam.mirror.cwiseProduct(p), beam.mirror.cwiseProduct(d), combine(combine(seed, beam.orbit), index), -1};
  }
  static PrimaryRay ray(const Beam& beam, const OwenSobol& sequence, std::uint32_t index) {
    return ray(beam, numbers(sequence, index), sequence.seed, index);
  }
  static std::array<double, 4> numbers(const OwenSobol& sequence, std::uint32_t index) {
    return {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)};
  }

  /// Is the set of emitters its own mirror image in each plane?
  static Symmetry symmetry_of(const std::vector<Emitter>& emitters) {
    const auto closed = [&](const Vec3d& m) {
      return std::all_of(emitters.begin(), emitters.end(), [&](const auto& e) {
        return std::any_of(emitters.begin(), emitters.end(),
            [&](const auto& other) { return detail::radiate_alike(e.mirrored(m), other); });
      });
    };
    return {closed(detail::flip_x), closed(detail::flip_y)};
  }

 private:
  std::vector<Beam> beams_;
};

}  // namespace lumo
