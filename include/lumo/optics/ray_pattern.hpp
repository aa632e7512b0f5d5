#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/optics/emitter.hpp"
#include "lumo/optics/surface_optics.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace lumo {

/// A primary ray and what later events of its path draw their numbers from.
struct PrimaryRay {
  Vec3 origin = Vec3::Zero();      ///< [m]
  Vec3 direction = Vec3::UnitZ();  ///< unit
  std::uint64_t key = 0;           ///< the same for mirror images of a path
  int triangle = -1;               ///< of the scene that it starts on, if known
};

/// The one deterministic set of primary rays for all designs, states and emitters. Closed under x → −x and y → −y: a point of the
/// sequence makes a ray of the emitter moved to the quadrant x ≥ 0, y ≥ 0, and the rays of the real emitters are its mirror images.
/// An emitter that is its own mirror image shoots into a half or a quarter of the hemisphere only, so that nothing is traced twice.
class RayPattern {
 public:
  /// The rays of one emitter that belong to one mirror image.
  struct Beam {
    RectangleEmitter source;  ///< moved to the fundamental quadrant
    Vec3 normal, tangent1, tangent2;
    double azimuth_from = 0.0, azimuth_range = 2.0 * pi;
    Vec3 mirror = Vec3::Ones();  ///< (±1, ±1, 1): from the fundamental ray to the real one
    std::uint64_t orbit = 0;     ///< the same for emitters that are mirror images
    std::uint32_t rays = 0;      ///< per replicate
    double power_W = 0.0;        ///< per ray
  };

  /// `rays` per emitter and replicate, a power of two ≥ 4. With `symmetry` only one beam of each set of mirror images is kept.
  /// Throws InvalidArgument for broken emitters, or when they do not have the symmetry.
  RayPattern(const std::vector<RectangleEmitter>& emitters, std::uint32_t rays, Symmetry symmetry);

  const std::vector<Beam>& beams() const { return beams_; }

  /// Ray `index` of a beam, from numbers in (0, 1): square of the sine and azimuth of its direction, then its place on the emitter.
  static PrimaryRay ray(const Beam& beam, const std::array<double, 4>& u, std::uint64_t seed, std::uint32_t index) {
    const double azimuth = beam.azimuth_from + beam.azimuth_range * u[1];
    const Vec3 d = detail::cosine_direction(beam.tangent1, beam.tangent2, beam.normal, u[0], azimuth);
    const Vec3 p = point(beam.source, u[2], u[3]);
    return {beam.mirror.cwiseProduct(p), beam.mirror.cwiseProduct(d), detail::combine(detail::combine(seed, beam.orbit), index), -1};
  }
  static PrimaryRay ray(const Beam& beam, const OwenSobol& sequence, std::uint32_t index) {
    return ray(beam, {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)}, sequence.seed, index);
  }

  /// Is the set of emitters its own mirror image in each plane?
  static Symmetry symmetry_of(const std::vector<RectangleEmitter>& emitters);

 private:
  std::vector<Beam> beams_;
};

namespace detail {

/// Mirror image of an emitter. It radiates to the image of its normal, so the handedness of its edges is mended.
inline RectangleEmitter mirrored(const RectangleEmitter& e, const Vec3& m) {
  RectangleEmitter image = e;
  image.center = m.cwiseProduct(e.center);
  image.half_u = m.cwiseProduct(e.half_u);
  image.half_v = m.cwiseProduct(e.half_v) * m.prod();
  return image;
}

/// Do two emitters radiate alike? Edges may point either way.
inline bool same(const RectangleEmitter& a, const RectangleEmitter& b) {
  const double tolerance = 1e-9 * (a.half_u.norm() + a.half_v.norm());
  const auto parallel = [&](const Vec3& p, const Vec3& q) { return std::min((p - q).norm(), (p + q).norm()) <= tolerance; };
  return (a.center - b.center).norm() <= tolerance && parallel(a.half_u, b.half_u) && parallel(a.half_v, b.half_v) &&
         normal(a).dot(normal(b)) > 0.5 && a.power_W == b.power_W && a.channel == b.channel;
}

/// The mirror image with centre (and, in a plane, normal) in x ≥ 0, y ≥ 0 and edges in a standard sense.
inline RectangleEmitter fundamental(const RectangleEmitter& e, Vec3& mirror) {
  const double tolerance = 1e-9 * (e.half_u.norm() + e.half_v.norm());
  mirror = Vec3::Ones();
  for (Eigen::Index a = 0; a < 2; ++a) {
    const bool in_plane = std::abs(e.center[a]) <= tolerance;
    if (in_plane ? normal(e)[a] < -1e-9 : e.center[a] < 0.0) mirror[a] = -1.0;
  }
  RectangleEmitter f = mirrored(e, mirror);
  Eigen::Index k = 0;
  f.half_u.cwiseAbs().maxCoeff(&k);
  if (f.half_u[k] < 0.0) f.half_u = -f.half_u, f.half_v = -f.half_v;
  return f;
}

inline const Vec3 flip_x{-1.0, 1.0, 1.0}, flip_y{1.0, -1.0, 1.0};

}  // namespace detail

inline Symmetry RayPattern::symmetry_of(const std::vector<RectangleEmitter>& emitters) {
  const auto closed = [&](const Vec3& m) {
    return std::all_of(emitters.begin(), emitters.end(), [&](const auto& e) {
      return std::any_of(emitters.begin(), emitters.end(), [&](const auto& other) { return detail::same(detail::mirrored(e, m), other); });
    });
  };
  return {closed(detail::flip_x), closed(detail::flip_y)};
}

inline RayPattern::RayPattern(const std::vector<RectangleEmitter>& emitters, std::uint32_t rays, Symmetry symmetry) {
  validate(emitters);
  const Symmetry has = symmetry_of(emitters);
  if ((symmetry.x && !has.x) || (symmetry.y && !has.y))
    throw InvalidArgument("ray pattern: a symmetric state is claimed, but the emitters are not symmetric");
  std::vector<RectangleEmitter> orbits;
  for (const RectangleEmitter& e : emitters) {
    Beam beam;
    Vec3 home;
    beam.source = detail::fundamental(e, home);
    const auto known = std::find_if(orbits.begin(), orbits.end(), [&](const auto& o) { return detail::same(o, beam.source); });
    beam.orbit = std::uint64_t(known - orbits.begin());
    if (known == orbits.end()) orbits.push_back(beam.source);
    beam.source = orbits[beam.orbit];  // the very same bits for all images
    beam.normal = normal(beam.source);
    const bool own_x = detail::same(detail::mirrored(beam.source, detail::flip_x), beam.source);
    const bool own_y = detail::same(detail::mirrored(beam.source, detail::flip_y), beam.source);
    detail::tangents(beam.normal, beam.tangent1, beam.tangent2);
    if (own_x || own_y) {
      beam.tangent1 = own_x ? Vec3::UnitX() : Vec3::UnitY();
      beam.tangent2 = beam.normal.cross(beam.tangent1);
      beam.azimuth_from = own_x && own_y ? 0.0 : -0.5 * pi;
      beam.azimuth_range = own_x && own_y ? 0.5 * pi : pi;
    }
    const std::uint32_t images = (own_x ? 2u : 1u) * (own_y ? 2u : 1u);
    beam.rays = std::max(1u, rays / images);
    beam.power_W = e.power_W / double(beam.rays * images);
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

}  // namespace lumo
