#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/devices/frame.hpp"
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

/// How well holes must be seen.
struct HoleSearch {
  double reach_m = 8.0_mm;         ///< how far from where it is expected a hole may be
  double min_contrast = 10.0;      ///< how much darker than its rim [DN]
  double max_residual_m = 0.4_mm;  ///< RMS of the holes' places after the fit
  double max_scale_change = 0.05;  ///< relative to the guess; two holes tell nothing else of a mistake
};

namespace detail {

struct Hole {
  Eigen::Vector2d center;
  double contrast;
};

/// The dark disc of a radius that stands out most from its rim, within `reach` of a pixel; nothing where there is none
/// that is dark enough.
inline std::optional<Hole> find_hole(const ImageView& image, const Eigen::Vector2d& expected, double radius,
                                     double reach, double min_contrast) {
  const double inner = std::max(0.8, 0.75 * radius), rim = 1.35 * radius, outer = rim + std::max(1.5, 0.6 * radius);
  if (!(outer > 0.0 && 2.0 * outer < std::min(image.width, image.height) && expected.allFinite() &&
        expected.norm() < 1e6 && reach < 1e6))
    return std::nullopt;
  // Means of the disc and of the rim's eight sectors: a hole is darker than all of them, an edge or a gap is not.
  struct Near {
    int x, y;
    std::size_t part;  ///< sector, or 8: the disc
  };
  std::vector<Near> near;
  std::array<int, 9> count{};
  for (int y = -int(outer); y <= int(outer); ++y)
    for (int x = -int(outer); x <= int(outer); ++x) {
      const double d = std::hypot(x, y);
      if (d > outer || (d > inner && d < rim)) continue;
      near.push_back({x, y, d <= inner ? 8 : std::size_t(std::min(7.0, (std::atan2(y, x) / pi + 1.0) * 4.0))});
      ++count[near.back().part];
    }
  const auto look = [&](int cx, int cy) {
    std::array<int, 9> sum{};
    for (const Near& n : near) sum[n.part] += image.green(cx + n.x, cy + n.y);
    double around = 255.0;
    for (std::size_t k = 0; k < 8; ++k)
      if (count[k] > 0) around = std::min(around, double(sum[k]) / count[k]);
    return std::pair(double(sum[8]) / count[8], around);
  };
  const int whole = std::max(1, int(std::ceil(reach))), u = int(std::lround(expected.x())),
            v = int(std::lround(expected.y())), edge = int(std::ceil(outer));
  double best = min_contrast;
  std::optional<Eigen::Vector2d> place;
  for (int cy = std::max(v - whole, edge); cy <= std::min(v + whole, image.height - 1 - edge); ++cy)
    for (int cx = std::max(u - whole, edge); cx <= std::min(u + whole, image.width - 1 - edge); ++cx) {
      if (std::hypot(cx - u, cy - v) > reach) continue;
      const auto [disc, around] = look(cx, cy);
      if (around - disc > best) {
        best = around - disc;
        place = Eigen::Vector2d(cx, cy);
      }
    }
  if (!place) return std::nullopt;
  for (int pass = 0; pass < 4; ++pass) {  // centroid of the darkness, each time about the last one
    if (place->x() < outer || place->y() < outer || place->x() > image.width - 1 - outer ||
        place->y() > image.height - 1 - outer)
      return std::nullopt;
    const double light = look(int(std::lround(place->x())), int(std::lround(place->y()))).second;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    double weight = 0.0;
    for (int y = int(std::ceil(place->y() - rim)); y <= int(std::floor(place->y() + rim)); ++y)
      for (int x = int(std::ceil(place->x() - rim)); x <= int(std::floor(place->x() + rim)); ++x) {
        const double w =
            std::hypot(x - place->x(), y - place->y()) > rim ? 0.0 : std::max(0.0, light - image.green(x, y));
        moment += w * Eigen::Vector2d(x, y);
        weight += w;
      }
    if (!(weight > 0.0)) return std::nullopt;
    *place = moment / weight;
  }
  return Hole{*place, best};
}

}  // namespace detail

/// Finds the link by its mounting holes, about where `guess` expects them. Nothing where one is not seen, or where they
/// do not fit the link.
inline std::optional<LinkMap> register_link(const ImageView& image, const HandLink& link, const LinkMap& guess,
                                            const HoleSearch& search = {}) {
  if (image.empty() || !guess.origin_px.allFinite() || !(guess.origin_px.norm() < 1e6)) return std::nullopt;
  const double scale = guess.px_per_m();
  const Eigen::Index n = link.hole_m.cols();
  Eigen::Matrix2Xd seen(2, n);
  double contrast = 255.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Vector2d expected = guess.pixel(link.hole_m(0, k), link.hole_m(1, k));
    const auto hole =
        detail::find_hole(image, expected, link.hole_radius_m * scale, search.reach_m * scale, search.min_contrast);
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
