#pragma once

#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/body.hpp"
#include "lumo/morphology/region_images.hpp"

#include <concepts>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// Light that left the body for good: where it last crossed the surface, and where it goes.
struct Escape {
  Vec3d reference;  ///< last exit point in the undeformed body [m]
  Vec3d position;   ///< the same point, deformed [m]
  Vec3d direction;  ///< unit, in air
  int region = -1;  ///< Body::region of the last exit point; −1 if the body says that such light is not seen
};

/// Sorts escaping light into channels. A photodiode or a camera with a finite aperture asks whether (position,
/// direction) reaches it. Optional: `std::optional<std::vector<int>> image_channels(const Body&, int axis) const`,
/// channel → its mirror image in the plane across axis 0 or 1 (empty: itself; nullopt: none), lets one of two
/// mirrored states stand for both. Laws: a pure function; the channel lies in [0, channels(body)), or is −1 for light
/// that is not seen.
template <class R>
concept ExitReadout = requires(const R& readout, const Body& body, const Escape& escape) {
  { readout.channels(body) } -> std::convertible_to<int>;
  { readout.channel(escape) } -> std::convertible_to<int>;
};

/// A direction [unit] and the solid angle [sr] that it stands for; 0: there is no way.
struct Connection {
  Vec3d direction{0.0, 0.0, 1.0};
  double solid_angle_sr = 0.0;
};

/// From a point to a place of a camera's round opening of `radius_m` about `center`; `at`: the place, in radii.
inline Connection to_disc(const Vec3d& center, const Vec3d& view, double radius_m, const Vec3d& from, const Vec3d& at) {
  const Vec3d way = center + radius_m * at - from;
  const double length = way.norm(), toward = -way.dot(view);
  if (!(toward > 0.0)) return {};
  return {way / length, toward / length * pi * radius_m * radius_m / (length * length)};
}

/// A readout behind openings that are small seen from the body: few paths come there by themselves. Light that
/// Lambertian faces send is gathered from ways that start at an opening (next-event estimation: Coveyou, Cain & Yost
/// 1967); light that never met such a face is traced forward, as for others. Laws: connect(k, p, u, v) leads from the
/// point p through a point of opening k, and the mean of f(direction)·solid_angle over (u, v) in (0, 1)² is the
/// integral of f over the solid angle of the opening; channel() is −1 for light that passes no opening, and what passes
/// one has one channel.
template <class R>
concept ConnectedReadout = ExitReadout<R> && requires(const R& readout, const Vec3d& p, int k, double u) {
  { readout.openings() } -> std::convertible_to<int>;
  { readout.connect(k, p, u, u) } -> std::same_as<Connection>;
};

/// A connected readout whose openings are so small, or so far, that paths from emitters hardly ever come there: their
/// light is gathered, too, as ways from the opening meet them. The member says so.
template <class R>
concept WholeReadout = ConnectedReadout<R> && requires {
  requires R::gathers_emitters;
};

/// Light that stays on an opaque patch of the body.
struct Landing {
  Vec3d reference;  ///< where, in the undeformed body [m]
  Vec3d position;   ///< the same point, deformed [m]
  Vec3d direction;  ///< unit, in which it came
  int patch;        ///< of Body::patches
};

/// A readout that sees light on opaque patches, too, as photodiodes on the face do. Laws: landing_channel() is pure,
/// and −1 for light that is not seen. It is asked for patches that absorb or mirror; light on Lambertian ones goes on
/// with all other that falls there.
template <class R>
concept LandingReadout = ExitReadout<R> && requires(const R& readout, const Landing& landing) {
  { readout.landing_channel(landing) } -> std::convertible_to<int>;
};

/// All power that leaves through each region of the body and is seen (model reading of paper §III: r_b).
struct ExitPower {
  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const { return escape.region; }
  /// nullopt unless the images of all regions are regions. Throws as region_images() does.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const {
    RegionImages known = region_images(body, axis);
    if (known.kind != RegionImages::Kind::regions) return std::nullopt;
    return std::move(known.image);
  }
};

static_assert(ExitReadout<ExitPower>);
static_assert(!ExitReadout<int> && !ConnectedReadout<ExitPower>);

}  // namespace lumo
