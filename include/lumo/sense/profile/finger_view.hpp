#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/green_profile.hpp"
#include "lumo/sense/profile/led_detector.hpp"
#include "lumo/sense/profile/unloaded_check.hpp"
#include "lumo/sense/profile/unloaded_reference.hpp"
#include "lumo/sense/recording/session.hpp"
#include "lumo/sense/recording/streams.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lumo::sense {

/// The stretch of a log with the finger unloaded: the first segment of kind `unloaded`, or else the first half second.
struct UnloadedStretch : Stretch {
  static constexpr std::int64_t first_ns = 500'000'000;
  bool chosen = false;  ///< by whoever knows the log: of what came before nothing is assumed

  static UnloadedStretch of(const Session& s, std::int64_t first_frame_ns) {
    const auto known = std::find_if(
        s.segments.begin(), s.segments.end(), [](const Segment& g) { return g.kind == SegmentKind::unloaded; });
    return known == s.segments.end() ? UnloadedStretch{{first_frame_ns, first_frame_ns + first_ns}}
                                     : UnloadedStretch{{known->from_ns, known->to_ns}};
  }
};

/// Mean of pictures of one size and format; pictures that differ from the first are left out.
class MeanImage {
 public:
  void add(const ImageView& v) {
    if (v.empty()) return;
    const std::size_t bytes = std::size_t(v.width) * std::size_t(channels(v.format));
    if (count_ == 0) {
      mean_ = Image::black(v.width, v.height, v.format);
      sum_.assign(bytes * std::size_t(v.height), 0);
    }
    if (v.width != mean_.width || v.height != mean_.height || v.format != mean_.format || count_ >= 1 << 16) return;
    ++count_;
    for (int y = 0; y < v.height; ++y)
      for (std::size_t x = 0; x < bytes; ++x) sum_[std::size_t(y) * bytes + x] += v.row(y)[x];
  }
  int count() const { return count_; }
  /// Rounded. Empty when nothing was added.
  Image image() const {
    Image m = mean_;
    for (std::size_t i = 0; i < sum_.size(); ++i)
      m.pixels[i] = std::uint8_t((sum_[i] + std::uint32_t(count_) / 2) / std::uint32_t(count_));
    return m;
  }

 private:
  Image mean_;
  std::vector<std::uint32_t> sum_;
  int count_ = 0;
};

/// A finger's place in a camera's pictures: the map along it from its LEDs, and the lit band to both sides.
struct FingerView {
  LedDetection leds;
  double band_low_m = 0.0, band_high_m = 0.0;  ///< as GreenProfile::Config
  int width = 0, height = 0;
  PixelFormat format = PixelFormat::bgr;
  int lit = 1;             ///< the channel in which the LEDs are seen, as ImageView has it
  double unchanged = 0.0;  ///< share of lit pixels that a picture repeats of the last one (RepeatedPixels); 0: unknown

  /// As profiles of these bins have it.
  Repeats repeats(const LongitudinalBins& bins) const {
    constexpr double block_px = 16.0;  // a macroblock of MPEG-2 to H.264; later codecs have larger ones too
    const double bin_m = (bins.edges_m[bins.size()] - bins.edges_m[0]) / double(bins.size());
    return {unchanged, std::max(1.0, block_px * leds.map.scale_m_per_px(leds.map.u_px(0.0)) / bin_m)};
  }

  SteadyLight steady{};  ///< set where lamps flicker; of the bins that profiles were read in

  GreenProfile readout(const LongitudinalBins& bins) const {
    return GreenProfile({leds.map, bins, band_low_m, band_high_m, width, height, format, 1, lit}, steady);
  }
};

/// The stretch across the finger, about its row of LEDs, that has at least half of the row's light above the darkest
/// surroundings. Across: positive clockwise of the tip's direction in the image, in m at the map's scale.
inline std::pair<double, double> lit_band(
    const ImageView& unloaded, const AxisMap& map, double half_range_m = 22.0e-3) {
  constexpr double half = 0.5;    // of the row's light; and of a line's pixels, that it counts
  constexpr int row_half_px = 8;  // what counts as beside the row
  const double scale = map.scale_m_per_px(map.u_px(0.0));
  const int reach = std::max(unloaded.width, unloaded.height);
  std::vector<double> sum(std::size_t(2 * reach + 1), 0.0), count = sum;
  for (int y = 0; y < unloaded.height; ++y)
    for (int x = 0; x < unloaded.width; ++x) {
      const Eigen::Vector2d p = Eigen::Vector2d(x, y) - map.origin_px;
      if (std::abs(map.y_m(p.dot(map.direction))) > half_range_m) continue;
      const long across = std::lround(-p.x() * map.direction.y() + p.y() * map.direction.x());
      if (std::abs(across) > reach) continue;
      sum[std::size_t(across + reach)] += unloaded.green(x, y);
      count[std::size_t(across + reach)] += 1.0;
    }
  const double most = *std::max_element(count.begin(), count.end());
  double dark = 255.0;
  for (std::size_t i = 0; i < sum.size(); ++i)
    if (count[i] > half * most) dark = std::min(dark, sum[i] / count[i]);
  // The row itself shines; the light beside it counts.
  std::vector<double> near;
  for (int k = -row_half_px; k <= row_half_px; ++k)
    if (const auto i = std::size_t(k + reach); count[i] > half * most) near.push_back(sum[i] / count[i]);
  const double limit = dark + half * (median(near) - dark);
  const auto lit = [&](int k) {
    return count[std::size_t(k + reach)] > half * most &&
           sum[std::size_t(k + reach)] / count[std::size_t(k + reach)] >= limit;
  };
  int low = 0, high = 0;
  while (low > -reach && lit(low - 1)) --low;
  while (high < reach && lit(high + 1)) ++high;
  return {scale * (low - 0.5), scale * (high + 0.5)};
}

/// Throws InputError where the row of LEDs lies at nearly a right angle to the tip's direction as the session has it,
/// so that a slight turn of the camera would decide which end is the tip.
inline void require_tip_known(const AxisMap& map, const Session& session, const std::string& name) {
  constexpr double farthest_deg = 70.0, deg_per_rad = 57.29577951308232;
  const Eigen::Vector2d& d = map.direction;
  const double cosine = d.dot(session.distal.normalized()),
               turned_deg = deg_per_rad * std::acos(std::clamp(cosine, -1.0, 1.0));
  if (turned_deg <= farthest_deg) return;
  const bool upright = std::abs(d.y()) > std::abs(d.x());
  throw InputError(message(name, ": the row of LEDs lies at ", std::lround(turned_deg), "° to the tip's direction, [",
      session.distal.x(), ", ", session.distal.y(),
      "], which does not say which end is the tip; state leds.distal in the "
      "session: ",
      upright ? "[0, 1] if the tip is below, [0, -1] if it is above"
              : "[1, 0] if the tip is on the right, [-1, 0] if it is on the left"));
}

/// What may be wrong with the exposure of a picture without LEDs; empty: nothing.
inline std::string exposure_hint(const ImageView& v) {
  constexpr int dark_DN = 60;          // of the brightest value
  constexpr double full_share = 0.02;  // of values at 255
  int most = 0;
  double full = 0.0;
  const int bytes = v.empty() ? 0 : v.width * channels(v.format);
  for (int y = 0; y < v.height && bytes > 0; ++y)
    for (int i = 0; i < bytes; ++i) {
      most = std::max<int>(most, v.row(y)[i]);
      full += v.row(y)[i] == 255 ? 1.0 / (double(bytes) * v.height) : 0.0;
    }
  if (bytes > 0 && most < dark_DN)
    return message("; the brightest value is ", most, " of 255: the pictures are under-exposed");
  if (full > full_share)
    return message("; ", std::lround(100.0 * full), " % of the values are 255: the pictures are over-exposed");
  return "";
}

/// The LEDs, and the channel that they are seen in: green, unless another shows them alone or far brighter.
struct LitChannel {
  int lit = 1;
  LedDetection leds;
};

/// nullopt where no channel shows the row.
inline std::optional<LitChannel> find_leds(ImageView unloaded, const LedDetector& detector) {
  constexpr double far_brighter = 2.5;  // contrast over green's, beyond which green sees the others' leak
  std::optional<LitChannel> best;
  double most = 0.0;
  for (const int channel : {1, 0, 2}) {
    if (channel != 1 && unloaded.format == PixelFormat::grey) continue;
    unloaded.lit = channel;
    const auto leds = detector.find(unloaded);
    if (!leds) continue;
    if (const double contrast = leds->contrast.minCoeff(); !best || contrast > most) {
      best = LitChannel{channel, *leds};
      most = contrast * (channel == 1 ? far_brighter : 1.0);
    }
  }
  return best;
}

/// From a picture of the unloaded finger. Throws InputError, with `name` before the message, if it shows no LEDs, or
/// the session does not say which end of their row is the tip.
inline FingerView view_finger(ImageView unloaded, const Session& session, const std::string& name) {
  std::optional<LitChannel> seen;
  const double parallax = led_parallax(session);
  if (!unloaded.empty())
    seen = find_leds(unloaded, LedDetector{session.led_count, parallax * session.led_pitch_m,
                                   parallax * session.led_first_y_m, session.distal});
  if (!seen)
    throw InputError(message(name, ": no row of ", session.led_count,
        " LEDs is seen in the pictures of the unloaded finger", exposure_hint(unloaded)));
  require_tip_known(seen->leds.map, session, name);
  unloaded.lit = seen->lit;
  const auto [low, high] = lit_band(unloaded, seen->leds.map);
  return {seen->leds, low, high, unloaded.width, unloaded.height, unloaded.format, seen->lit};
}

/// Mean picture of the unloaded stretch, and the finger in it. Throws InputError.
template <Camera C>
FingerView view_finger(C& camera, const Session& session, const UnloadedStretch& stretch, const std::string& name) {
  MeanImage mean;
  RepeatedPixels repeated;
  for (auto f = camera.next(); f && f->stamp_ns <= stretch.to_ns; f = camera.next())
    if (stretch.holds(f->stamp_ns)) {
      mean.add(f->image);
      repeated.add(f->image);
    }
  if (mean.count() == 0) throw InputError(message(name, ": has no picture of the unloaded finger"));
  FingerView view = view_finger(mean.image().view(), session, name);
  view.unchanged = repeated.share();
  return view;
}

/// Profiles of all frames that the readout can read.
template <Camera C> std::vector<Profile> read_profiles(C& camera, GreenProfile& readout) {
  std::vector<Profile> list;
  Profile p;
  for (auto f = camera.next(); f; f = camera.next())
    if (readout.read(*f, p)) list.push_back(p);
  return list;
}

/// Where lamps flicker in the unloaded stretch that is divided out of all profiles, and from now on of what the view
/// reads. The range of the result is 0 where they do not.
inline Flicker take_out_flicker(FingerView& view, std::vector<Profile>& profiles, const UnloadedStretch& stretch) {
  std::vector<const Profile*> held;
  for (const Profile& p : profiles)
    if (stretch.holds(p.stamp_ns)) held.push_back(&p);
  Flicker flicker = flicker_of(held);
  if (!(flicker.half_range > 0.0)) return flicker;
  view.steady = SteadyLight(flicker.middle);
  SteadyLight steady = view.steady;
  for (Profile& p : profiles) steady.divide(p.value);
  return flicker;
}

/// Of the profiles in the unloaded stretch that agree with each other. Throws InputError when there are none.
inline CheckedReference checked_reference(const std::vector<Profile>& profiles, const UnloadedStretch& stretch,
    const std::string& name, const Repeats& repeats = {}) {
  std::vector<const Profile*> held;
  for (const Profile& p : profiles)
    if (stretch.holds(p.stamp_ns)) held.push_back(&p);
  CheckedReference checked = checked_reference(held, repeats);
  if (checked.reference.count() == 0) throw InputError(message(name, ": has no picture of the unloaded finger"));
  return checked;
}
inline UnloadedReference unloaded_reference(const std::vector<Profile>& profiles, const UnloadedStretch& stretch,
    const std::string& name, const Repeats& repeats = {}) {
  return checked_reference(profiles, stretch, name, repeats).reference;
}

}  // namespace lumo::sense
