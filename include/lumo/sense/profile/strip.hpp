#pragma once

#include "lumo/sense/devices/frame.hpp"
#include "lumo/sense/profile/axis_map.hpp"
#include "lumo/sense/profile/longitudinal_bins.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace lumo::sense {

/// The pixels of a band along the finger, laid out once as runs in the image's rows. Lines of equal y cross the axis at
/// right angles, in steps of whole pixels along the image's direction that is nearer to the axis.
class Strip {
 public:
  Strip(const AxisMap& map, const LongitudinalBins& bins, double low_m, double high_m, int width, int height,
        PixelFormat format, int row_step);

  bool fits(const ImageView& image) const {
    return !image.empty() && image.width == width_ && image.height == height_ && image.format == format_;
  }

  /// Mean of value(pixels, reference pixels, byte) over each bin. Bytes of all channels are summed, which is cheaper
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

inline Strip::Strip(const AxisMap& map, const LongitudinalBins& bins, double low_m, double high_m, int width,
                    int height, PixelFormat format, int row_step)
    : width_(width),
      height_(height),
      channels_(sense::channels(format)),
      channel_(format == PixelFormat::bgr ? 1 : 0),
      format_(format) {
  require_in_range("frame width", width, 1, max_image_side, "px");
  require_in_range("frame height", height, 1, max_image_side, "px");
  require_in_range("row step", row_step, 1, height, "");
  require_in_range("band's upper limit", high_m, low_m, 10.0, "m");
  validate(bins);
  const Eigen::Vector2d d = map.direction;
  along_ = std::abs(d.x()) >= std::abs(d.y());
  const double scale = map.scale_m_per_px(map.u_px(0.5 * (bins.edges_m[0] + bins.edges_m[bins.size()])));
  const double v0 = low_m / scale, v1 = high_m / scale;
  for (const double y : {bins.edges_m[0], bins.edges_m[bins.size()]})
    if (const double u = map.u_px(y);
        !(std::isfinite(u) && map.scale_m_per_px(u) > 0.0 && 1.0 + map.coefficients[2] * u / map.half_length_px > 0.0))
      throw InvalidArgument(message("the axis map has no place in the image for y = ", 1e3 * y, " mm"));

  // Place of a pixel: its column (or row) sheared onto the line, so that u = (place − origin) · main; equal places have
  // equal u.
  const double main = along_ ? d.x() : d.y(), shear = along_ ? d.y() / d.x() : d.x() / d.y();
  const double main_origin = along_ ? map.origin_px.x() : map.origin_px.y(),
               cross_origin = along_ ? map.origin_px.y() : map.origin_px.x();
  const auto place_of = [&](double y) { return main_origin + map.u_px(y) / main; };
  const double from = std::min(place_of(bins.edges_m[0]), place_of(bins.edges_m[bins.size()]));
  const double to = std::max(place_of(bins.edges_m[0]), place_of(bins.edges_m[bins.size()]));
  const int base = int(std::floor(from + 0.5)), last = int(std::floor(to + 0.5));  // place k covers [k − ½, k + ½)
  if (!(to - from < 65536.0)) throw InvalidArgument("finger's bins reach far beyond the image");
  places_ = last - base + 1;

  std::vector<int> count(std::size_t(places_), 0);
  const auto inside = [&](int x, int y, int& place) {
    const double px = x - map.origin_px.x(), py = y - map.origin_px.y();
    const double across = px * -d.y() + py * d.x();
    if (across < v0 || across >= v1) return false;
    const double cross = along_ ? y : x;
    place = (along_ ? x : y) + int(std::lround((cross - cross_origin) * shear)) - base;
    return place >= 0 && place < places_;
  };
  // Lines along the axis are left out, so that every place keeps some pixels.
  for (int y = 0; y < height; y += along_ ? row_step : 1)
    for (int x = 0; x < width; x += along_ ? 1 : row_step) {
      int place = 0;
      if (!inside(x, y, place)) continue;
      ++count[std::size_t(place)];
      const bool joins = !runs_.empty() && runs_.back().row == y && runs_.back().first + runs_.back().count == x &&
                         place == runs_.back().place + (along_ ? runs_.back().count : 0);
      if (joins)
        ++runs_.back().count;
      else
        runs_.push_back({y, x, 1, place});
    }
  for (std::size_t k = 0; k < count.size(); ++k) {
    if (count[k] == 0)
      throw InvalidArgument(message("the finger's band leaves the image: no pixel at y = ",
                                    1e3 * map.y_m((double(base) + double(k) - main_origin) * main), " mm"));
    inverse_count_.push_back(1.0 / count[k]);
  }
  for (Eigen::Index i = 0; i < bins.edges_m.size(); ++i) edges_.push_back(place_of(bins.edges_m[i]) + 0.5 - base);
  for (double& e : edges_) e = std::clamp(e, 0.0, double(places_));
  const std::size_t bytes = std::size_t(places_) * std::size_t(along_ ? channels_ : 1);
  narrow_.resize(bytes);
  wide_.resize(bytes);
  integral_.resize(std::size_t(places_) + 1);
}

inline void Strip::flush() {
  for (std::size_t i = 0; i < narrow_.size(); ++i) wide_[i] += narrow_[i];
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
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
    if (along_) {
      if (run.row != row && (row = run.row, ++rows) == 256) {
        flush();
        rows = 0;
      }
      std::uint16_t* __restrict to = narrow_.data() + std::ptrdiff_t(run.place) * channels_;
      for (std::size_t i = 0; i < bytes; ++i)
        to[i] = std::uint16_t(to[i] + value(p, q, i));  // -O3 makes vectors of it, which is four times as fast
    } else {
      // 48 lanes are a whole number of pixels in either format; a lane takes 257 bytes.
      std::uint16_t lane[48] = {};
      std::uint32_t total = 0;
      const auto collect = [&] {
        for (int k = channel_; k < 48; k += channels_) total += lane[k];
        std::memset(lane, 0, sizeof lane);
      };
      std::size_t i = 0;
      for (int turns = 0; i + 48 <= bytes; i += 48) {
        for (std::size_t k = 0; k < 48; ++k) lane[k] = std::uint16_t(lane[k] + value(p + i, q ? q + i : nullptr, k));
        if (++turns == 256) {
          collect();
          turns = 0;
        }
      }
      collect();
      for (i += std::size_t(channel_); i < bytes; i += std::size_t(channels_)) total += value(p, q, i);
      wide_[std::size_t(run.place)] += total;
    }
  }
  if (along_) flush();

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
  int row = -1, turn = 7;
  for (const Run& run : runs_) {
    if (run.row != row) {
      row = run.row;
      turn = (turn + 1) % 8;
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
