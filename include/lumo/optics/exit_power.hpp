#pragma once

#include "lumo/core/types.hpp"
#include "lumo/morphology/body.hpp"

#include <concepts>

namespace lumo {

/// Light that left the body for good: where it last crossed the surface, and where it goes.
struct Escape {
  Vec3 reference;   ///< last exit point in the undeformed body [m]
  Vec3 position;    ///< the same point, deformed [m]
  Vec3 direction;   ///< unit, in air
  int region = -1;  ///< Body::region of the last exit point
};

/// Sorts escaping light into channels. A photodiode or a camera with a finite aperture asks whether (position, direction) reaches it.
/// Laws: a pure function; the channel lies in [0, channels(body)), or is −1 for light that is not seen.
template <class R>
concept ExitReadout = requires(const R& readout, const Body& body, const Escape& escape) {
  { readout.channels(body) } -> std::convertible_to<int>;
  { readout.channel(escape) } -> std::convertible_to<int>;
};

/// All power that leaves through each region of the body, whatever its direction (model reading of paper §III: r_b).
struct ExitPower {
  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const { return escape.region; }
};

static_assert(ExitReadout<ExitPower>);
static_assert(!ExitReadout<int>);

}  // namespace lumo
