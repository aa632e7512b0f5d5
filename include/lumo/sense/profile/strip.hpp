#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/axis_map.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <vector>

namespace lumo::sense {

/// Where along the finger a profile is averaged: bin i lies between edges i and i + 1.
struct LongitudinalBins {
  Eigen::VectorXd edges_m;  ///< ascending

  /// The paper's 11 regions: 5 mm each on [−27.5, 27.5] mm.
  static LongitudinalBins regions() { return uniform(-27.5e-3, 27.5e-3, 11); }
  /// Six equal parts of the same stretch, the decoder's. Source: the authors' public code
  /// (dokkev/fingertip-design-framework, fig5c_decoder.py).
  static LongitudinalBins parts() { return uniform(-27.5e-3, 27.5e-3, 6); }
  static LongitudinalBins uniform(double from_m, double to_m, int count) {
    require_in_range("number of bins", count, 1, 4096, "");
    require_in_range("first edge", from_m, -10.0, 10.0, "m");
    require_in_range("last edge", to_m, -10.0, 10.0, "m");
    LongitudinalBins bins{Eigen::VectorXd::LinSpaced(count + 1, from_m, to_m)};
    validate(bins);
    return bins;
  }

  Eigen::Index size() const { return edges_m.size() - 1; }
  Eigen::VectorXd centres_m() const {
    const Eigen::VectorXd& edges = edges_m;
    return 0.5 * (edges.head(size()) + edges.tail(size()));
  }

  /// Throws InvalidArgument unless there are at least two edges that ascend.
  friend void validate(const LongitudinalBins& b) {
    if (b.edges_m.size() < 2)
      throw InvalidArgument(message("longitudinal bins have ", b.edges_m.size(), " edges, must have at least 2"));
    for (Eigen::Index i = 1; i < b.edges_m.size(); ++i)
      if (!(b.edges_m[i] > b.edges_m[i - 1]))
        throw InvalidArgument(message("edge ", i, " of the longitudinal bins is ", b.edges_m[i],
            " m, must exceed its predecessor, ", b.edges_m[i - 1], " m"));
  }
};

/// The pixels of a band along the finger, laid out once as runs in the image's rows. Lines of equal y cross the axis at
/// right angles, in steps of whole pixels along the image's direction that is nearer to the axis.
class Strip {
 public:
  struct Config {
    AxisMap map;
    LongitudinalBins bins = LongitudinalBins::regions();
    /// The band's limits to the sides of the map's line; positive lies clockwise of the tip's direction in the image
    /// (image y runs down).
    double band_low_m = -8.0_mm, band_high_m = 8.0_mm;
    int width = 640, height = 480;  ///< of the frames [px]
    PixelFormat format = PixelFormat::bgr;
    int row_step = 1;  ///< reads every n-th line along the finger: image rows, or columns for an upright finger
    int lit = 1;       ///< the channel that is measured, as ImageView has it
  };

  /// Throws InvalidArgument for a band outside of the image or numbers out of range.
  explicit Strip(const Config& config);

  bool fits(const ImageView& image) const {
    return !image.empty() && image.width == width_ && image.height == height_ && image.format == format_;
  }

  /// Mean of value(pixels, reference pixels, byte) over each bin. Bytes of all channels are summed, which is faster
  /// than to pick one of three.
  template <class Value>
  void sum(const ImageView& image, Value value, const ImageView* reference, Eigen::VectorXd& mean);

  /// Share of bytes of the measured channel that are 255, on every eighth row read.
  double saturated_share(const ImageView& image) const;

 private:
  struct Run {
    int row, first, count;  ///< pixels
    int place;              ///< first place along the axis; a run along the axis goes on from it, one across it stays
  };

  /// Bytes in a block of `sum_across`: whole pixels in either format.
  static constexpr std::size_t lanes = 48;
  /// Additions of bytes that 16 bits hold, less one.
  static constexpr int narrow_turns = 256;
  static constexpr double most_places = 65536.0;

  class Places;
  void lay_out(const Places& places, const Config& config, std::vector<int>& count);
  template <class Value>
  std::uint32_t sum_across(const std::uint8_t* p, const std::uint8_t* q, std::size_t bytes, Value value) const;
  void mean_of_bins(Eigen::VectorXd& mean);
  void flush();

  int width_, height_, places_ = 0, channels_, channel_;
  PixelFormat format_;
  bool along_;  ///< the axis runs along image rows
  std::vector<Run> runs_;
  std::vector<double> inverse_count_;  ///< 1/pixels at each place
  std::vector<double> edges_;          ///< of the bins, in places
  std::vector<std::uint16_t> narrow_;  ///< bytes of the places; wrap after 257 rows
  std::vector<std::uint32_t> wide_;
  std::vector<double> integral_;  ///< of the mean, from the first place
};

/// Places along the axis. A pixel's place is its column (or row) sheared onto the axis, so that u = (place − origin) ·
/// main; equal places have equal u. Place k covers [k − ½, k + ½).
class Strip::Places {
 public:
  explicit Places(const Config& c)
      : map_(c.map), along_(std::abs(c.map.direction.x()) >= std::abs(c.map.direction.y())), d_(c.map.direction) {
    const double first_m = c.bins.edges_m[0], last_m = c.bins.edges_m[c.bins.size()];
    const double scale = map_.scale_m_per_px(map_.u_px(0.5 * (first_m + last_m)));
    low_px_ = c.band_low_m / scale;
    high_px_ = c.band_high_m / scale;
    for (const double y : {first_m, last_m})
      if (const double u = map_.u_px(y); !(std::isfinite(u) && map_.scale_m_per_px(u) > 0.0 &&
                                           1.0 + map_.coefficients[2] * u / map_.half_length_px > 0.0))
        throw InvalidArgument(message("the axis map has no place in the image for y = ", 1e3 * y, " mm"));
    main_ = along_ ? d_.x() : d_.y();
    shear_ = along_ ? d_.y() / d_.x() : d_.x() / d_.y();
    main_origin_ = along_ ? map_.origin_px.x() : map_.origin_px.y();
    cross_origin_ = along_ ? map_.origin_px.y() : map_.origin_px.x();
    const double from = std::min(of(first_m), of(last_m)), to = std::max(of(first_m), of(last_m));
    if (!(to - from < most_places)) throw InvalidArgument("finger's bins reach far beyond the image");
    base_ = int(std::floor(from + 0.5));
    count_ = int(std::floor(to + 0.5)) - base_ + 1;
  }

  bool along() const { return along_; }
  int base() const { return base_; }
  int count() const { return count_; }
  double of(double y_m) const { return main_origin_ + map_.u_px(y_m) / main_; }
  double y_m(std::size_t place) const { return map_.y_m((double(base_) + double(place) - main_origin_) * main_); }
  /// Place of a pixel, counted from the first one; nullopt outside of the band.
  std::optional<int> at(int x, int y) const {
    const double px = x - map_.origin_px.x(), py = y - map_.origin_px.y();
    const double across = px * -d_.y() + py * d_.x();
    if (across < low_px_ || across >= high_px_) return std::nullopt;
    const double cross = along_ ? y : x;
    const int place = (along_ ? x : y) + int(std::lround((cross - cross_origin_) * shear_)) - base_;
    return place >= 0 && place < count_ ? std::optional(place) : std::nullopt;
  }

 private:
  const AxisMap& map_;
  bool along_;  ///< the axis runs along image rows
  Eigen::Vector2d d_;
  double low_px_, high_px_, main_, shear_, main_origin_, cross_origin_;
  int base_, count_;
};

inline Strip::Strip(const Config& c)
    : width_(c.width),
      height_(c.height),
      channels_(sense::channels(c.format)),
      channel_(c.format == PixelFormat::bgr ? c.lit : 0),
      format_(c.format) {
  require_in_range("frame width", c.width, 1, max_image_side, "px");
  require_in_range("frame height", c.height, 1, max_image_side, "px");
  require_in_range("measured channel", c.lit, 0, 2, "");
  require_in_range("row step", c.row_step, 1, c.height, "");
  require_in_range("band's upper limit", c.band_high_m, c.band_low_m, 10.0, "m");
  validate(c.bins);
  const Places places(c);
  along_ = places.along();
  places_ = places.count();
  std::vector<int> count(std::size_t(places_), 0);
  lay_out(places, c, count);
  for (std::size_t k = 0; k < count.size(); ++k) {
    if (count[k] == 0)
      throw InvalidArgument(
          message("the finger's band leaves the image: no pixel at y = ", 1e3 * places.y_m(k), " mm"));
    inverse_count_.push_back(1.0 / count[k]);
  }
  for (Eigen::Index i = 0; i < c.bins.edges_m.size(); ++i)
    edges_.push_back(places.of(c.bins.edges_m[i]) + 0.5 - places.base());
  for (double& e : edges_) e = std::clamp(e, 0.0, double(places_));
  const std::size_t bytes = std::size_t(places_) * std::size_t(along_ ? channels_ : 1);
  narrow_.resize(bytes);
  wide_.resize(bytes);
  integral_.resize(std::size_t(places_) + 1);
}

/// Runs of the band's pixels; `count` gets the number of pixels at each place. Only lines along the axis are left out,
/// so that every place keeps some pixels.
inline void Strip::lay_out(const Places& places, const Config& c, std::vector<int>& count) {
  for (int y = 0; y < height_; y += along_ ? c.row_step : 1)
    for (int x = 0; x < width_; x += along_ ? 1 : c.row_step) {
      const std::optional<int> place = places.at(x, y);
      if (!place) continue;
      ++count[std::size_t(*place)];
      const bool joins = !runs_.empty() && runs_.back().row == y && runs_.back().first + runs_.back().count == x &&
                         *place == runs_.back().place + (along_ ? runs_.back().count : 0);
      if (joins) ++runs_.back().count;
      else runs_.push_back({y, x, 1, *place});
    }
}

inline void Strip::flush() {
  for (std::size_t i = 0; i < narrow_.size(); ++i) wide_[i] += narrow_[i];
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
}

/// Sum over a run across the axis of the measured channel.
template <class Value> std::uint32_t Strip::sum_across(
    const std::uint8_t* __restrict p, const std::uint8_t* __restrict q, std::size_t bytes, Value value) const {
  std::uint16_t lane[lanes] = {};
  std::uint32_t total = 0;
  const auto collect = [&] {
    for (int k = channel_; k < int(lanes); k += channels_) total += lane[k];
    std::memset(lane, 0, sizeof lane);
  };
  std::size_t i = 0;
  for (int turns = 0; i + lanes <= bytes; i += lanes) {
    for (std::size_t k = 0; k < lanes; ++k) lane[k] = std::uint16_t(lane[k] + value(p + i, q ? q + i : nullptr, k));
    if (++turns == narrow_turns) {
      collect();
      turns = 0;
    }
  }
  collect();
  for (i += std::size_t(channel_); i < bytes; i += std::size_t(channels_)) total += value(p, q, i);
  return total;
}

template <class Value>
void Strip::sum(const ImageView& image, Value value, const ImageView* reference, Eigen::VectorXd& mean) {
  std::fill(wide_.begin(), wide_.end(), 0u);
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
  int rows = 0, row = -1;
  for (const Run& run : runs_) {
    const std::uint8_t* __restrict p = image.row(run.row) + std::ptrdiff_t(run.first) * channels_;
    const std::uint8_t* __restrict q =
        reference ? reference->row(run.row) + std::ptrdiff_t(run.first) * channels_ : nullptr;
    const std::size_t bytes = std::size_t(run.count) * std::size_t(channels_);
    if (!along_) {
      wide_[std::size_t(run.place)] += sum_across(p, q, bytes, value);
      continue;
    }
    if (run.row != row) {
      row = run.row;
      if (++rows == narrow_turns) {
        flush();
        rows = 0;
      }
    }
    std::uint16_t* __restrict to = narrow_.data() + std::ptrdiff_t(run.place) * channels_;
    for (std::size_t i = 0; i < bytes; ++i)
      to[i] = std::uint16_t(to[i] + value(p, q, i));  // -O3 makes vectors of it, which is four times as fast
  }
  if (along_) flush();
  mean_of_bins(mean);
}

/// Mean of each bin from the sums at the places, by differences of the integral.
inline void Strip::mean_of_bins(Eigen::VectorXd& mean) {
  const int stride = along_ ? channels_ : 1, offset = along_ ? channel_ : 0;
  for (int k = 0; k < places_; ++k)
    integral_[std::size_t(k) + 1] =
        integral_[std::size_t(k)] + wide_[std::size_t(k * stride + offset)] * inverse_count_[std::size_t(k)];
  const auto up_to = [&](double place) {
    const auto whole = std::min(std::size_t(place), integral_.size() - 2);
    return integral_[whole] + (place - double(whole)) * (integral_[whole + 1] - integral_[whole]);
  };
  mean.resize(Eigen::Index(edges_.size()) - 1);
  for (Eigen::Index i = 0; i < mean.size(); ++i) {
    const double a = edges_[std::size_t(i)], b = edges_[std::size_t(i) + 1];
    mean[i] = (up_to(b) - up_to(a)) / (b - a);
  }
}

inline double Strip::saturated_share(const ImageView& image) const {
  std::size_t full = 0, seen = 0;
  constexpr int every = 8;
  int row = -1, turn = every - 1;
  for (const Run& run : runs_) {
    if (run.row != row) {
      row = run.row;
      turn = (turn + 1) % every;
    }
    if (turn != 0) continue;
    const std::uint8_t* p = image.row(run.row) + std::ptrdiff_t(run.first) * channels_ + channel_;
    unsigned here = 0;
    for (int i = 0; i < run.count; ++i) here += p[std::ptrdiff_t(i) * channels_] == 255;
    full += here;
    seen += std::size_t(run.count);
  }
  return seen ? double(full) / double(seen) : 0.0;
}

}  // namespace lumo::sense
