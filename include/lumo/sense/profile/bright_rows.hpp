#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/finger_view.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace lumo::sense {

/// The paper's reading of a picture for location: rows across the finger, evenly spaced along its LEDs in the picture;
/// of each the mean over the brightest tenth of green's excess over an unloaded picture, pixel by pixel, darker pixels
/// 0 [DN]. A row's place is piecewise linear between the LEDs, and beyond the last ones as between the two next to
/// the end. Source: the authors' public code (dokkev/fingertip-design-framework, contact_localization.py), by
/// description. Rows and samples across are ours.
class BrightRows {
 public:
  using Sample = Frame;

  struct Config {
    FingerView view;
    Eigen::VectorXd led_m;         ///< of the LEDs in `view`, ascending
    Image unloaded;                ///< median picture
    double beyond_m = 11.0_mm;     ///< past the last LEDs, at most
    int rows = 256, across = 128;  ///< samples
    double brightest = 0.1;        ///< share of a row's samples that counts
  };

  /// Throws InvalidArgument where LEDs and places do not match, rows leave the picture altogether, or the unloaded
  /// picture has another size.
  explicit BrightRows(const Config& config) : config_(config) {
    const FingerView& view = config_.view;
    const Eigen::Index leds = config_.led_m.size();
    if (leds < 2 || view.leds.centroid_px.cols() != leds)
      throw InvalidArgument(message("rows: ", view.leds.centroid_px.cols(), " LEDs are seen at ", leds, " places"));
    require_in_range("rows", config_.rows, 3, 4096, "");
    require_in_range("samples across", config_.across, 1, 4096, "");
    require_in_range("brightest share", config_.brightest, 1e-6, 1.0, "");
    require_in_range("way past the LEDs", config_.beyond_m, 0.0, 1.0, "m");
    const ImageView v = config_.unloaded.view();
    if (v.width != view.width || v.height != view.height || v.format != view.format)
      throw InvalidArgument("unloaded image has not the size or format of the frames");
    lay_out();
  }

  bool read(const Frame& frame, Profile& profile) {
    const FingerView& view = config_.view;
    if (frame.image.empty() || frame.image.width != view.width || frame.image.height != view.height ||
        frame.image.format != view.format)
      return false;
    profile.stamp_ns = frame.stamp_ns;
    profile.value.resize(places_.size());
    ImageView unloaded = config_.unloaded.view();
    unloaded.lit = view.lit;
    std::size_t full = 0, nearly = 0, all = 0;
    for (std::size_t r = 0; r < samples_.size(); ++r) {
      excess_.clear();
      for (const auto& [x, y] : samples_[r]) {
        const int now = frame.image.green(x, y), before = unloaded.green(x, y);
        excess_.push_back(std::max(0, now - before));
        full += now == 255;
        nearly += now >= 250;
        ++all;
      }
      profile.value[Eigen::Index(r)] = mean_of_brightest();
    }
    profile.saturated = double(full) / double(std::max<std::size_t>(1, all));
    profile.nearly_saturated = double(nearly) / double(std::max<std::size_t>(1, all));
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return places_; }

 private:
  void lay_out() {
    const FingerView& view = config_.view;
    const AxisMap& map = view.leds.map;
    const Eigen::Index leds = config_.led_m.size();
    Eigen::VectorXd u(leds);
    for (Eigen::Index k = 0; k < leds; ++k) u[k] = map.u_px(Eigen::Vector2d(view.leds.centroid_px.col(k)));
    const auto slope = [&](Eigen::Index k) { return (u[k + 1] - u[k]) / (config_.led_m[k + 1] - config_.led_m[k]); };
    const double from = u[0] - slope(0) * config_.beyond_m, to = u[leds - 1] + slope(leds - 2) * config_.beyond_m,
                 scale = map.scale_m_per_px(0.5 * (from + to));
    const Eigen::Vector2d along = map.direction, across(-along.y(), along.x());
    places_.resize(config_.rows);
    samples_.resize(std::size_t(config_.rows));
    for (int r = 0; r < config_.rows; ++r) {
      const double at = from + (to - from) * r / (config_.rows - 1);
      Eigen::Index k = 0;
      while (k + 2 < leds && at > u[k + 1]) ++k;
      places_[r] = config_.led_m[k] + (at - u[k]) / slope(k);
      for (int c = 0; c < config_.across; ++c) {
        const double side =
            (view.band_low_m + (view.band_high_m - view.band_low_m) * (c + 0.5) / config_.across) / scale;
        const Eigen::Vector2d p = map.origin_px + at * along + side * across;
        const long x = std::lround(p.x()), y = std::lround(p.y());
        if (x >= 0 && y >= 0 && x < view.width && y < view.height)
          samples_[std::size_t(r)].emplace_back(int(x), int(y));
      }
    }
    if (std::all_of(samples_.begin(), samples_.end(), [](const auto& row) { return row.empty(); }))
      throw InvalidArgument("the finger's rows leave the image");
  }
  double mean_of_brightest() {
    if (excess_.empty()) return 0.0;
    const auto count = std::max<std::size_t>(1, std::size_t(std::lround(config_.brightest * double(excess_.size()))));
    const auto end = excess_.begin() + std::ptrdiff_t(count);
    std::nth_element(excess_.begin(), end - 1, excess_.end(), std::greater<>());
    double sum = 0.0;
    for (auto e = excess_.begin(); e != end; ++e) sum += *e;
    return sum / double(count);
  }

  Config config_;
  Eigen::VectorXd places_;
  std::vector<std::vector<std::pair<int, int>>> samples_;  ///< by row: pixels
  std::vector<int> excess_;
};

static_assert(Readout<BrightRows>);

}  // namespace lumo::sense
