#pragma once

#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/common_light.hpp"
#include "lumo/sense/profile/strip.hpp"

#include <utility>

namespace lumo::sense {

/// Mean green of a camera's frame over each longitudinal bin of the finger [DN, 0 … 255].
/// Reads only the pixels of the finger's band. Sums are whole numbers, so their order does not matter.
class GreenProfile {
 public:
  using Sample = Frame;

  using Config = Strip::Config;

  /// `steady`: what changes all light alike is divided out, if it is set; then the profile is not linear in the light.
  /// Throws InvalidArgument for a band outside the image or numbers out of range.
  explicit GreenProfile(const Config& config, SteadyLight steady = {})
      : strip_(config), centres_(config.bins.centres_m()), steady_(std::move(steady)) {}

  bool read(const Frame& frame, Profile& profile) {
    if (!strip_.fits(frame.image)) return false;
    profile.stamp_ns = frame.stamp_ns;
    strip_.sum(
        frame.image, [](const std::uint8_t* p, const std::uint8_t*, std::size_t i) { return p[i]; }, nullptr,
        profile.value);
    profile.saturated = strip_.saturated_share(frame.image);
    if (steady_.is_set()) steady_.divide(profile.value);
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return centres_; }

 private:
  Strip strip_;
  Eigen::VectorXd centres_;
  SteadyLight steady_;
};

static_assert(Readout<GreenProfile>);

/// Mean over each bin of green's excess over the unloaded image, pixel by pixel; darker pixels count 0 (paper, force
/// estimation). Not linear near zero: noise leaves a positive mean there, which an unloaded reference of these profiles
/// removes.
class PositiveGreenProfile {
 public:
  using Sample = Frame;

  /// `unloaded` must have the frames' size and format. Throws InvalidArgument as GreenProfile.
  PositiveGreenProfile(const GreenProfile::Config& config, Image unloaded)
      : strip_(config), centres_(config.bins.centres_m()), unloaded_(std::move(unloaded)) {
    if (!strip_.fits(unloaded_.view()))
      throw InvalidArgument("unloaded image has not the size or format of the frames");
  }

  bool read(const Frame& frame, Profile& profile) {
    if (!strip_.fits(frame.image)) return false;
    profile.stamp_ns = frame.stamp_ns;
    const ImageView reference = unloaded_.view();
    strip_.sum(
        frame.image,
        [](const std::uint8_t* p, const std::uint8_t* q, std::size_t i) {
          return std::uint8_t(p[i] > q[i] ? p[i] - q[i] : 0);
        },
        &reference, profile.value);
    profile.saturated = strip_.saturated_share(frame.image);
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return centres_; }

 private:
  Strip strip_;
  Eigen::VectorXd centres_;
  Image unloaded_;
};

static_assert(Readout<PositiveGreenProfile>);

}  // namespace lumo::sense
