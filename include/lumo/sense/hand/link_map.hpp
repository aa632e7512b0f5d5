#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/sense/recording/session.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace lumo::sense {

/// How a link's plane lies in the image: turned, shifted and scaled.
struct LinkMap {
  Eigen::Vector2d origin_px{0.0, 0.0};
  Eigen::Vector2d along_px_per_m{1.0, 0.0};  ///< of y
  bool z_clockwise = false;
  double residual_px = 0.0;  ///< RMS of what the fit leaves
  double contrast_DN = 0.0;  ///< of the palest hole that it was found by

  Eigen::Vector2d pixel(double y_m, double z_m) const {
    const double side = z_clockwise ? 1.0 : -1.0;
    const Eigen::Vector2d across(-side * along_px_per_m.y(), side * along_px_per_m.x());
    const Eigen::Vector2d& along = along_px_per_m;
    return origin_px + y_m * along + z_m * across;
  }
  double px_per_m() const { return std::hypot(along_px_per_m.x(), along_px_per_m.y()); }

  /// Least squares over points of the link (2 × n, n ≥ 2) and where they are seen. Throws InvalidArgument for fewer, or
  /// points that coincide.
  static LinkMap fit(const Eigen::Matrix2Xd& point_m, const Eigen::Matrix2Xd& pixel, bool z_clockwise);
};

inline LinkMap LinkMap::fit(const Eigen::Matrix2Xd& point_m, const Eigen::Matrix2Xd& pixel, bool z_clockwise) {
  using Complex = std::complex<double>;
  const Eigen::Index n = point_m.cols();
  if (n < 2 || pixel.cols() != n)
    throw InvalidArgument(
        message("link map has ", n, " points and ", pixel.cols(), " pixels, must have at least 2 of each"));
  const auto point = [&](Eigen::Index k) {
    return Complex(point_m(0, k), z_clockwise ? point_m(1, k) : -point_m(1, k));
  };
  const auto seen = [&](Eigen::Index k) { return Complex(pixel(0, k), pixel(1, k)); };
  Complex middle = 0.0, middle_px = 0.0, turn = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    middle += point(k) / double(n);
    middle_px += seen(k) / double(n);
  }
  double spread = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    turn += std::conj(point(k) - middle) * (seen(k) - middle_px);
    spread += std::norm(point(k) - middle);
  }
  if (!(spread > 0.0)) throw InvalidArgument("link map: all points lie in one place");
  turn /= spread;
  const Complex origin = middle_px - turn * middle;
  LinkMap map{{origin.real(), origin.imag()}, {turn.real(), turn.imag()}, z_clockwise, 0.0, 0.0};
  double left = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) left += std::norm(origin + turn * point(k) - seen(k));
  map.residual_px = std::sqrt(left / double(n));
  return map;
}

/// How well holes must be seen, and what of the picture is compared. Sizes of disc and rim are in radii of the hole,
/// chosen so that the hole's blurred edge belongs to neither; assumed.
struct HoleSearch {
  double reach_m = 8.0_mm;         ///< how far from its expected place a hole may be
  double min_contrast = 10.0;      ///< how much darker than its rim [DN]
  double max_residual_m = 0.4_mm;  ///< RMS of the holes' places after the fit
  double max_scale_change = 0.05;  ///< relative to the guess; two holes show no other mistake
  double disc = 0.75;              ///< radius of the disc inside the edge
  double rim = 1.35;               ///< inner radius of the rim outside of the edge
  double rim_width = 0.6;
  double min_disc_px = 0.8;       ///< at least the middle pixel
  double min_rim_width_px = 1.5;  ///< at least a pixel in each sector
  int centroid_passes = 4;        ///< each about the last one's place
};

namespace detail {

struct Hole {
  Eigen::Vector2d center;
  double contrast;
};

/// Finds the dark disc of a radius that stands out most from its rim. Of lumo's own, so that sensing needs Eigen only.
class HoleFinder {
 public:
  HoleFinder(const ImageView& image, double radius_px, const HoleSearch& search)
      : image_(image),
        search_(search),
        inner_(std::max(search.min_disc_px, search.disc * radius_px)),
        rim_(search.rim * radius_px),
        outer_(rim_ + std::max(search.min_rim_width_px, search.rim_width * radius_px)) {
    if (fits()) lay_out();
  }

  /// Within `reach_px` of a pixel; nullopt if no disc is dark enough.
  std::optional<Hole> find(const Eigen::Vector2d& expected, double reach_px) const {
    constexpr double far_px = 1e6;  // beyond any picture, so that pixels can be counted in int
    if (!(fits() && expected.allFinite() && expected.norm() < far_px && reach_px < far_px)) return std::nullopt;
    std::optional<Hole> hole = darkest(expected, reach_px);
    if (!hole || !centre(hole->center)) return std::nullopt;
    return hole;
  }

 private:
  static constexpr std::size_t sectors = 8;  ///< of the rim; the part behind them is the disc
  struct Offset {
    int x, y;
    std::size_t part;
  };

  bool fits() const { return outer_ > 0.0 && 2.0 * outer_ < std::min(image_.width, image_.height); }

  void lay_out() {
    for (int y = -int(outer_); y <= int(outer_); ++y)
      for (int x = -int(outer_); x <= int(outer_); ++x) {
        const double d = std::hypot(x, y);
        if (d > outer_ || (d > inner_ && d < rim_)) continue;
        const auto sector = std::size_t(std::min(double(sectors - 1), (std::atan2(y, x) / pi + 1.0) * (0.5 * sectors)));
        offsets_.push_back({x, y, d <= inner_ ? sectors : sector});
        ++count_[offsets_.back().part];
      }
  }

  /// Means of the disc and of the rim's darkest sector: a hole is darker than all of them, an edge or a gap is not.
  std::pair<double, double> disc_and_rim(int cx, int cy) const {
    std::array<int, sectors + 1> sum{};
    for (const Offset& n : offsets_) sum[n.part] += image_.green(cx + n.x, cy + n.y);
    double around = 255.0;
    for (std::size_t k = 0; k < sectors; ++k)
      if (count_[k] > 0) around = std::min(around, double(sum[k]) / count_[k]);
    return {double(sum[sectors]) / count_[sectors], around};
  }

  std::optional<Hole> darkest(const Eigen::Vector2d& expected, double reach) const {
    const int whole = std::max(1, int(std::ceil(reach))), u = int(std::lround(expected.x())),
              v = int(std::lround(expected.y())), edge = int(std::ceil(outer_));
    double best = search_.min_contrast;
    std::optional<Hole> hole;
    for (int cy = std::max(v - whole, edge); cy <= std::min(v + whole, image_.height - 1 - edge); ++cy)
      for (int cx = std::max(u - whole, edge); cx <= std::min(u + whole, image_.width - 1 - edge); ++cx) {
        if (std::hypot(cx - u, cy - v) > reach) continue;
        const auto [disc, around] = disc_and_rim(cx, cy);
        if (around - disc > best) {
          best = around - disc;
          hole = Hole{Eigen::Vector2d(cx, cy), best};
        }
      }
    return hole;
  }

  /// Moves a place to the centroid of the darkness about it; false if that leaves the picture.
  bool centre(Eigen::Vector2d& place) const {
    for (int pass = 0; pass < search_.centroid_passes; ++pass) {
      if (place.x() < outer_ || place.y() < outer_ || place.x() > image_.width - 1 - outer_ ||
          place.y() > image_.height - 1 - outer_)
        return false;
      const double light = disc_and_rim(int(std::lround(place.x())), int(std::lround(place.y()))).second;
      Eigen::Vector2d moment = Eigen::Vector2d::Zero();
      double weight = 0.0;
      for (int y = int(std::ceil(place.y() - rim_)); y <= int(std::floor(place.y() + rim_)); ++y)
        for (int x = int(std::ceil(place.x() - rim_)); x <= int(std::floor(place.x() + rim_)); ++x) {
          const double w =
              std::hypot(x - place.x(), y - place.y()) > rim_ ? 0.0 : std::max(0.0, light - image_.green(x, y));
          moment += w * Eigen::Vector2d(x, y);
          weight += w;
        }
      if (!(weight > 0.0)) return false;
      place = moment / weight;
    }
    return true;
  }

  const ImageView& image_;
  const HoleSearch& search_;
  double inner_, rim_, outer_;  ///< [px]
  std::vector<Offset> offsets_;
  std::array<int, sectors + 1> count_{};
};

}  // namespace detail

/// Finds the link by its mounting holes, about where `guess` expects them; nullopt if one is not seen, or if they do
/// not fit the link.
inline std::optional<LinkMap> register_link(
    const ImageView& image, const HandLink& link, const LinkMap& guess, const HoleSearch& search = {}) {
  if (image.empty() || !guess.origin_px.allFinite() || !(guess.origin_px.norm() < 1e6)) return std::nullopt;
  const double scale = guess.px_per_m();
  const Eigen::Index n = link.hole_m.cols();
  Eigen::Matrix2Xd seen(2, n);
  double contrast = 255.0;
  const detail::HoleFinder finder(image, link.hole_radius_m * scale, search);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Vector2d expected = guess.pixel(link.hole_m(0, k), link.hole_m(1, k));
    const auto hole = finder.find(expected, search.reach_m * scale);
    if (!hole) return std::nullopt;
    seen.col(k) = hole->center;
    contrast = std::min(contrast, hole->contrast);
  }
  for (Eigen::Index k = 1; k < n; ++k)
    for (Eigen::Index j = 0; j < k; ++j)
      if ((seen.col(k) - seen.col(j)).norm() < link.hole_radius_m * scale)
        return std::nullopt;  // one hole taken for two
  LinkMap map = LinkMap::fit(link.hole_m, seen, link.z_clockwise);
  map.contrast_DN = contrast;
  if (map.residual_px > search.max_residual_m * scale ||
      std::abs(map.px_per_m() / scale - 1.0) > search.max_scale_change)
    return std::nullopt;
  return map;
}

}  // namespace lumo::sense
