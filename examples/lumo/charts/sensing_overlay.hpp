#pragma once

#include "charts/chart.hpp"
#include "lumo/sense/localize/location_estimator.hpp"
#include "sensing/log.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// Numbers in the cells of a grid, darker for more.
inline std::string draw_confusion(const Eigen::MatrixXi& confusion, const Eigen::VectorXd& place_m) {
  constexpr double side = 52.0, left = 110.0, top = 70.0;
  const Eigen::Index n = confusion.rows();
  Svg svg(left + side * double(n) + 30.0, top + side * double(n) + 30.0);
  svg.text({left, 24}, "Decoded place (columns) of true place (rows), y [mm]", {.size = 14, .bold = true});
  const int most = std::max(1, confusion.maxCoeff());
  for (Eigen::Index i = 0; i < n; ++i) {
    svg.text({left - 10, top + side * (double(i) + 0.6)}, short_number(1e3 * place_m[i]), {.anchor = Svg::end});
    svg.text({left + side * (double(i) + 0.5), top - 10}, short_number(1e3 * place_m[i]), {.anchor = Svg::middle});
    for (Eigen::Index j = 0; j < n; ++j) {
      const int v = confusion(i, j);
      svg.rect({left + side * double(j), top + side * double(i)}, side - 2, side - 2,
          {.fill = v > 0 ? shade(v, most + 1) : "#f2f2f2"});
      svg.text({left + side * (double(j) + 0.5) - 1, top + side * (double(i) + 0.6)}, std::to_string(v),
          {.anchor = Svg::middle, .fill = 2 * v > most ? "#ffffff" : "#222222"});
    }
  }
  return svg.str();
}

/// One picture of the log, four times as large: LEDs (yellow crosses), the band that is read (grey lines), the place
/// found with its 90 % interval (orange).
inline std::string overlay_png(const SensedLog& s, std::int64_t stamp_ns, const ContactLocation& at) {
  LogCamera camera(s.log);
  for (auto f = camera.next(); f; f = camera.next()) {
    if (f->stamp_ns != stamp_ns || f->image.empty()) continue;
    constexpr int zoom = 4;
    using Bgr = std::array<std::uint8_t, 3>;
    Image out = Image::black(zoom * f->image.width, zoom * f->image.height);
    const int n = channels(f->image.format);
    for (int y = 0; y < out.height; ++y)
      for (int x = 0; x < out.width; ++x)
        for (int c = 0; c < 3; ++c) out.row(y)[3 * x + c] = f->image.row(y / zoom)[n * (x / zoom) + (n == 3 ? c : 0)];
    const auto dot = [&](double u, double v, const Bgr& colour) {
      const int x = int(std::lround(zoom * (u + 0.5))), y = int(std::lround(zoom * (v + 0.5)));
      if (x >= 0 && y >= 0 && x < out.width && y < out.height)
        std::copy(colour.begin(), colour.end(), out.row(y) + 3 * x);
    };
    const AxisMap& map = s.view.leds.map;
    const Eigen::Vector2d along = map.direction, across(-along.y(), along.x());
    const double scale = map.scale_m_per_px(map.u_px(0.0)), low = s.view.band_low_m / scale,
                 high = s.view.band_high_m / scale;
    const auto line = [&](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Bgr& colour) {
      const int steps = std::max(2, int(2 * zoom * (b - a).norm()));
      for (int k = 0; k <= steps; ++k) {
        const Eigen::Vector2d p = a + double(k) / steps * (b - a);
        dot(p.x(), p.y(), colour);
      }
    };
    const auto place = [&](double y_m, double v) {
      return Eigen::Vector2d(map.origin_px + map.u_px(y_m) * along + v * across);
    };
    constexpr Bgr grey = {150, 150, 150}, yellow = {66, 228, 240}, orange = {0, 94, 213};
    for (const double v : {low, high}) line(place(s.bins.edges_m[0], v), place(s.bins.edges_m[s.bins.size()], v), grey);
    for (Eigen::Index k = 0; k < s.view.leds.centroid_px.cols(); ++k) {
      const Eigen::Vector2d c = s.view.leds.centroid_px.col(k);
      for (const auto& arm : {along, across}) line(c - 2.0 * arm, c + 2.0 * arm, yellow);
    }
    const double half = 1.645 * std::sqrt(at.variance_m2);
    line(place(at.y_m, low), place(at.y_m, high), orange);
    line(place(at.y_m - half, high), place(at.y_m + half, high), orange);
    const std::vector<std::uint8_t> bytes = pictures().encode(".png", out.view());
    return {bytes.begin(), bytes.end()};
  }
  throw InputError(s.log.path + ": the picture to draw on cannot be read");
}

}  // namespace lumo::program
