#pragma once

#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/profile/axis_map.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

namespace lumo::sense {

/// The finger's lights in an image, from proximal to distal, and the map they give.
struct LedDetection {
  Eigen::Matrix2Xd centroid_px;
  Eigen::VectorXd contrast;  ///< green above the brightest of its surroundings [DN]
  AxisMap map;
};

/// Finds the LEDs of a finger: bright spots in a row, at one pitch, in equal steps but for perspective. Runs once for a
/// camera's place, not on every frame. Of lumo's own, so that sensing needs Eigen only.
struct LedDetector {
  int count = 5;
  double pitch_m = 11.0_mm;
  double first_y_m = -22.0_mm;       ///< of the most proximal one
  Eigen::Vector2d distal{1.0, 0.0};  ///< direction in the image, at most a right angle from that of the tip
  int spot_radius_px = 0;            ///< of a LED's image; 0: the image's larger side over 120, at least 2
  double min_contrast = 8.0;         ///< green above the surroundings [DN]
  double min_share = 0.3;            ///< of the row's brightest spot that its dimmest must have
  double max_residual = 0.06;        ///< RMS distance of the spots from the fitted row, in pitches
  double centroid_sigma_px = 0.3;
  int max_candidates = 24;

  /// nullopt if the image shows no such row. Throws InvalidArgument for numbers out of range.
  std::optional<LedDetection> find(const ImageView& image) const;

 private:
  struct Spot {
    Eigen::Vector2d place;
    double contrast;
  };
  /// A window of this many radii's standard deviation weighs a spot's pixels.
  static constexpr double window = 1.5;
  static constexpr int centroid_passes = 3;  ///< each about the last one's middle: the window must not pull it
  /// A Gaussian window on a Gaussian spot of its width halves the way to its centre: a step goes nearly twice as far.
  static constexpr double centroid_step = 1.8;
  /// Spots lie at least this many radii apart, and no farther than this share of a pitch from their place in the row.
  static constexpr double min_step = 2.5, max_off = 0.3;
  static constexpr double least_step = 0.25;      ///< of a pitch, from a spot to the next along the row
  static constexpr double residual_weight = 0.3;  ///< standard deviation of a row's residual, in max_residual

  std::vector<Spot> spots(const ImageView& image, int radius) const;
  std::optional<LedDetection> row_between(const std::vector<Spot>& all, const Spot& first, const Spot& last) const;
};

namespace detail {

/// Sums of green over rectangles in constant time (Crow 1984).
class IntegralImage {
 public:
  explicit IntegralImage(const ImageView& v)
      : width_(v.width), height_(v.height), sum_(std::size_t(v.width + 1) * std::size_t(v.height + 1)) {
    for (int y = 0; y < v.height; ++y) {
      std::uint32_t row = 0;
      for (int x = 0; x < v.width; ++x) {
        row += v.green(x, y);
        at(x + 1, y + 1) = at(x + 1, y) + row;
      }
    }
  }
  /// Mean over the square of half width r about (x, y), as far as it lies in the image.
  double mean(int x, int y, int r) const {
    const int x0 = std::max(0, x - r), x1 = std::min(width_, x + r + 1), y0 = std::max(0, y - r),
              y1 = std::min(height_, y + r + 1);
    const std::uint32_t s = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);  // wraps round and back
    return double(s) / (double(x1 - x0) * double(y1 - y0));
  }

 private:
  std::uint32_t& at(int x, int y) { return sum_[std::size_t(y) * std::size_t(width_ + 1) + std::size_t(x)]; }
  std::uint32_t at(int x, int y) const { return sum_[std::size_t(y) * std::size_t(width_ + 1) + std::size_t(x)]; }
  int width_, height_;
  std::vector<std::uint32_t> sum_;
};

/// How far green stands above the brightest of eight neighbours, so that edges and streaks are no spots.
class SpotContrast {
 public:
  SpotContrast(const ImageView& image, const IntegralImage& sums, int radius)
      : width_(image.width), height_(image.height), contrast_(std::size_t(width_) * std::size_t(height_)) {
    const int far = 4 * radius;
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        double around = 0.0;
        for (int j = -far; j <= far; j += far)
          for (int i = -far; i <= far; i += far)
            if (i != 0 || j != 0)
              around = std::max(
                  around, sums.mean(std::clamp(x + i, 0, width_ - 1), std::clamp(y + j, 0, height_ - 1), radius));
        contrast_[std::size_t(y) * std::size_t(width_) + std::size_t(x)] = float(sums.mean(x, y, radius) - around);
      }
  }
  float at(int x, int y) const { return contrast_[std::size_t(y) * std::size_t(width_) + std::size_t(x)]; }
  /// Whether it is the largest within `reach` each way; of equals, the first is.
  bool is_top(int x, int y, int reach) const {
    const float c = at(x, y);
    for (int j = -reach; j <= reach; ++j)
      for (int i = -reach; i <= reach; ++i) {
        const int xx = x + i, yy = y + j;
        if (xx < 0 || yy < 0 || xx >= width_ || yy >= height_ || (i == 0 && j == 0)) continue;
        const float other = at(xx, yy);
        if (!(other < c || (other == c && (j > 0 || (j == 0 && i > 0))))) return false;
      }
    return true;
  }

 private:
  int width_, height_;
  std::vector<float> contrast_;
};

}  // namespace detail

inline std::vector<LedDetector::Spot> LedDetector::spots(const ImageView& image, int radius) const {
  const detail::IntegralImage sums(image);
  const int r = radius;
  const detail::SpotContrast contrast(image, sums, r);
  // Centroid of what stands above the surroundings.
  const auto centroid = [&](int x, int y) {
    Eigen::Vector2d centre(x, y);
    const double ground = sums.mean(x, y, 4 * r);
    for (int pass = 0; pass < centroid_passes; ++pass) {
      Eigen::Vector2d moment = Eigen::Vector2d::Zero();
      double weight = 0.0;
      const int cx = int(std::lround(centre.x())), cy = int(std::lround(centre.y()));
      for (int yy = std::max(0, cy - 3 * r); yy <= std::min(image.height - 1, cy + 3 * r); ++yy)
        for (int xx = std::max(0, cx - 3 * r); xx <= std::min(image.width - 1, cx + 3 * r); ++xx) {
          const Eigen::Vector2d p(xx, yy);
          const double near = std::exp(-0.5 * (p - centre).squaredNorm() / (window * r * window * r));
          const double w = near * std::max(0.0, image.green(xx, yy) - ground);
          moment += w * p;
          weight += w;
        }
      if (weight <= 0.0) break;
      centre += centroid_step * (moment / weight - centre);
    }
    return centre;
  };
  std::vector<Spot> found;
  for (int y = r; y < image.height - r; ++y)
    for (int x = r; x < image.width - r; ++x) {
      const float c = contrast.at(x, y);
      if (c < min_contrast || !contrast.is_top(x, y, 2 * r)) continue;
      const Eigen::Vector2d centre = centroid(x, y);
      if ((centre - Eigen::Vector2d(x, y)).norm() < 2.0 * r) found.push_back({centre, c});
    }
  std::stable_sort(found.begin(), found.end(), [](const Spot& a, const Spot& b) { return a.contrast > b.contrast; });
  if (found.size() > std::size_t(max_candidates)) found.resize(std::size_t(max_candidates));
  return found;
}

/// The row with these ends, without its map; nullopt if a spot is missing, out of order or too dim.
inline std::optional<LedDetection> LedDetector::row_between(
    const std::vector<Spot>& all, const Spot& first, const Spot& last) const {
  const Eigen::Vector2d &from = first.place, &to = last.place, step = (to - from) / double(count - 1);
  LedDetection row{Eigen::Matrix2Xd(2, count), Eigen::VectorXd(count), {}};
  for (int k = 0; k < count; ++k) {
    const Eigen::Vector2d expected = from + k * step;
    const auto off = [&](const Spot& s) { return (s.place - expected).squaredNorm(); };
    const auto near =
        std::min_element(all.begin(), all.end(), [&](const Spot& a, const Spot& b) { return off(a) < off(b); });
    if (!((near->place - expected).norm() < max_off * step.norm() &&
            (k == 0 || near->place != Eigen::Vector2d(row.centroid_px.col(k - 1)))))
      return std::nullopt;
    row.centroid_px.col(k) = near->place;
    row.contrast[k] = near->contrast;
  }
  for (int k = 1; k < count; ++k)
    if (!((row.centroid_px.col(k) - row.centroid_px.col(k - 1)).dot(step) > least_step * step.squaredNorm()))
      return std::nullopt;
  if (row.contrast.minCoeff() < min_share * row.contrast.maxCoeff()) return std::nullopt;
  return row;
}

inline std::optional<LedDetection> LedDetector::find(const ImageView& image) const {
  require_in_range("number of LEDs", count, 3, 64, "");
  require_positive("LED pitch", pitch_m, "m");
  require_positive("length of the distal direction", distal.norm(), "");
  if (image.empty()) throw InvalidArgument("LED detection: the image is empty");
  const int radius = spot_radius_px > 0 ? spot_radius_px : std::max(2, std::max(image.width, image.height) / 120);
  const std::vector<Spot> all = spots(image, radius);

  Eigen::VectorXd y(count);
  for (int k = 0; k < count; ++k) y[k] = first_y_m + pitch_m * k;
  std::optional<LedDetection> best;
  double best_score = 0.0;
  for (const Spot& first : all)
    for (const Spot& last : all) {
      const Eigen::Vector2d step = (last.place - first.place) / double(count - 1);
      if (step.dot(distal) <= 0.0 || step.norm() < min_step * radius) continue;
      std::optional<LedDetection> row = row_between(all, first, last);
      if (!row) continue;
      row->map = AxisMap::fit(row->centroid_px, y, centroid_sigma_px);
      const AxisMap& map = row->map;
      const Eigen::Vector2d across(-map.direction.y(), map.direction.x());
      const double off = ((row->centroid_px.colwise() - map.origin_px).transpose() * across).squaredNorm() / count;
      const double residual = std::sqrt(map.residual_px * map.residual_px + off) / step.norm();
      if (residual > max_residual) continue;
      const double far = residual / (residual_weight * max_residual);
      const double score = row->contrast.minCoeff() * std::exp(-0.5 * std::pow(far, 2));
      if (score > best_score) {
        best_score = score;
        best = row;
      }
    }
  return best;
}

}  // namespace lumo::sense
