#pragma once

#include "lumo/core/units.hpp"
#include "lumo/sense/devices/frame.hpp"
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

/// Finds the LEDs of a finger by what is known of them: bright spots in a row, at one pitch, in equal steps but for
/// perspective. Runs once for a camera's place, not on every frame.
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

  /// Nothing when no such row is seen. Throws InvalidArgument for numbers that make no sense.
  std::optional<LedDetection> find(const ImageView& image) const;

 private:
  struct Spot {
    Eigen::Vector2d place;
    double contrast;
  };
  std::vector<Spot> spots(const ImageView& image, int radius) const;
};

namespace detail {

/// Sums of green over rectangles in constant time.
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

}  // namespace detail

inline std::vector<LedDetector::Spot> LedDetector::spots(const ImageView& image, int radius) const {
  const detail::IntegralImage sums(image);
  const int r = radius, far = 4 * radius;
  std::vector<float> contrast(std::size_t(image.width) * std::size_t(image.height));
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      double around = 0.0;  // the brightest of eight neighbours, so that edges and streaks are no spots
      for (int j = -far; j <= far; j += far)
        for (int i = -far; i <= far; i += far)
          if (i != 0 || j != 0)
            around = std::max(
                around, sums.mean(std::clamp(x + i, 0, image.width - 1), std::clamp(y + j, 0, image.height - 1), r));
      contrast[std::size_t(y) * std::size_t(image.width) + std::size_t(x)] = float(sums.mean(x, y, r) - around);
    }
  const auto at = [&](int x, int y) { return contrast[std::size_t(y) * std::size_t(image.width) + std::size_t(x)]; };

  std::vector<Spot> found;
  for (int y = r; y < image.height - r; ++y)
    for (int x = r; x < image.width - r; ++x) {
      const float c = at(x, y);
      if (c < min_contrast) continue;
      bool top = true;
      for (int j = -2 * r; top && j <= 2 * r; ++j)
        for (int i = -2 * r; top && i <= 2 * r; ++i) {
          const int xx = x + i, yy = y + j;
          if (xx < 0 || yy < 0 || xx >= image.width || yy >= image.height || (i == 0 && j == 0)) continue;
          const float other = at(xx, yy);
          top = other < c || (other == c && (j > 0 || (j == 0 && i > 0)));  // of equals, the first
        }
      if (!top) continue;
      // Centroid of what stands above the surroundings, three times, each about the last one's middle: the window must
      // not pull it.
      Eigen::Vector2d centre(x, y);
      const double ground = sums.mean(x, y, far);
      for (int pass = 0; pass < 3; ++pass) {
        Eigen::Vector2d moment = Eigen::Vector2d::Zero();
        double weight = 0.0;
        const int cx = int(std::lround(centre.x())), cy = int(std::lround(centre.y()));
        for (int yy = std::max(0, cy - 3 * r); yy <= std::min(image.height - 1, cy + 3 * r); ++yy)
          for (int xx = std::max(0, cx - 3 * r); xx <= std::min(image.width - 1, cx + 3 * r); ++xx) {
            const Eigen::Vector2d p(xx, yy);
            const double window = std::exp(-0.5 * (p - centre).squaredNorm() / (1.5 * r * 1.5 * r));
            const double w = window * std::max(0.0, image.green(xx, yy) - ground);
            moment += w * p;
            weight += w;
          }
        if (weight <= 0.0) break;
        // A Gaussian window on a Gaussian spot halves the way to its centre (for equal widths): step nearly twice as
        // far.
        centre += 1.8 * (moment / weight - centre);
      }
      if ((centre - Eigen::Vector2d(x, y)).norm() < 2.0 * r) found.push_back({centre, c});
    }
  std::stable_sort(found.begin(), found.end(), [](const Spot& a, const Spot& b) { return a.contrast > b.contrast; });
  if (found.size() > std::size_t(max_candidates)) found.resize(std::size_t(max_candidates));
  return found;
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
      const Eigen::Vector2d &from = first.place, &to = last.place, step = (to - from) / double(count - 1);
      if (step.dot(distal) <= 0.0 || step.norm() < 2.5 * radius) continue;
      LedDetection row{Eigen::Matrix2Xd(2, count), Eigen::VectorXd(count), {}};
      bool whole = true;
      for (int k = 0; whole && k < count; ++k) {
        const Eigen::Vector2d expected = from + k * step;
        const auto off = [&](const Spot& s) { return (s.place - expected).squaredNorm(); };
        const auto near =
            std::min_element(all.begin(), all.end(), [&](const Spot& a, const Spot& b) { return off(a) < off(b); });
        whole = (near->place - expected).norm() < 0.3 * step.norm() &&
                (k == 0 || near->place != Eigen::Vector2d(row.centroid_px.col(k - 1)));
        row.centroid_px.col(k) = near->place;
        row.contrast[k] = near->contrast;
      }
      if (!whole) continue;
      for (int k = 1; whole && k < count; ++k)
        whole = (row.centroid_px.col(k) - row.centroid_px.col(k - 1)).dot(step) > 0.25 * step.squaredNorm();
      if (!whole || row.contrast.minCoeff() < min_share * row.contrast.maxCoeff()) continue;
      row.map = AxisMap::fit(row.centroid_px, y, centroid_sigma_px);
      const Eigen::Vector2d across(-row.map.direction.y(), row.map.direction.x());
      const double off = ((row.centroid_px.colwise() - row.map.origin_px).transpose() * across).squaredNorm() / count;
      const double residual = std::sqrt(row.map.residual_px * row.map.residual_px + off) / step.norm();
      if (residual > max_residual) continue;
      const double score = row.contrast.minCoeff() * std::exp(-0.5 * std::pow(residual / (0.3 * max_residual), 2));
      if (score > best_score) {
        best_score = score;
        best = row;
      }
    }
  return best;
}

}  // namespace lumo::sense
