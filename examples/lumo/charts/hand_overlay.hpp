#pragma once

#include "console/text.hpp"
#include "lumo/core/units.hpp"
#include "lumo/sense/hand/hand_observer.hpp"
#include "lumo/support/opencv.hpp"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// A picture of a hand, twice as large: the outline of each link's read side and its mounting holes (grey; red where it
/// is not seen), the cells in which light has changed (orange), and where along the link their centroid lies.
inline std::string hand_overlay_png(const ImageView& image, const HandObserver& hand, const HandEstimate& e) {
  constexpr int zoom = 2;
  constexpr int fraction = 4;  // bits of OpenCV's fixed-point places
  cv::Mat out, small = lumo::matrix_of(image);
  if (small.channels() == 1) cv::cvtColor(small, small, cv::COLOR_GRAY2BGR);
  cv::resize(small, out, {}, zoom, zoom, cv::INTER_NEAREST);
  const cv::Scalar grey(170, 170, 170), red(60, 60, 230), orange(0, 150, 255), white(255, 255, 255), black(0, 0, 0);
  const auto at = [&](const Eigen::Vector2d& p) {
    const double scale = zoom * (1 << fraction);
    return cv::Point(int(std::lround(scale * (p.x() + 0.5))), int(std::lround(scale * (p.y() + 0.5))));
  };
  const auto box = [&](const LinkMap& map, double y0, double y1, double z0, double z1) {
    return std::vector<cv::Point>{
        at(map.pixel(y0, z0)), at(map.pixel(y1, z0)), at(map.pixel(y1, z1)), at(map.pixel(y0, z1))};
  };
  cv::Mat tint = out.clone();
  for (const HandContact& c : e.contacts) {
    const auto [length, height] = hand.cell_m(c.link);
    for (const auto& [i, j] : c.cells) {
      const auto [y, z] = hand.place(c.link, i, j);
      const auto corners =
          box(e.map[std::size_t(c.link)], y - 0.5 * length, y + 0.5 * length, z - 0.5 * height, z + 0.5 * height);
      cv::fillConvexPoly(tint, corners, orange, cv::LINE_8, fraction);
    }
  }
  cv::addWeighted(tint, 0.55, out, 0.45, 0.0, out);
  for (std::size_t l = 0; l < hand.links().size(); ++l) {
    const HandLink& link = hand.links()[l];
    const LinkMap& map = e.map[l];
    const cv::Scalar& colour = e.seen[l] ? grey : red;
    cv::polylines(out, std::vector{box(map, link.y_low_m, link.y_high_m, link.z_low_m, link.z_high_m)}, true, colour, 1,
        cv::LINE_AA, fraction);
    for (Eigen::Index k = 0; k < link.hole_m.cols(); ++k)
      cv::circle(out, at(map.pixel(link.hole_m(0, k), link.hole_m(1, k))),
          int(std::lround(zoom * (1 << fraction) * link.hole_radius_m * map.px_per_m())), colour, 1, cv::LINE_AA,
          fraction);
  }
  for (const HandContact& c : e.contacts) {
    const LinkMap& map = e.map[std::size_t(c.link)];
    const HandLink& link = hand.links()[std::size_t(c.link)];
    cv::line(
        out, at(map.pixel(c.y_m, link.z_low_m)), at(map.pixel(c.y_m, link.z_high_m)), white, 2, cv::LINE_AA, fraction);
    const std::string words = short_number(1e3 * c.y_m, 1) + " mm";
    const double size = 0.45;
    int below = 0;
    const cv::Size room = cv::getTextSize(words, cv::FONT_HERSHEY_SIMPLEX, size, 1, &below);
    // Beside the pad, on the side that it faces, and within the picture.
    const cv::Point beside = at(map.pixel(c.y_m, link.z_high_m + 11.0_mm));
    cv::Point corner(beside.x / (1 << fraction) - room.width / 2, beside.y / (1 << fraction) + room.height / 2);
    corner.x = std::clamp(corner.x, 2, std::max(2, out.cols - room.width - 2));
    corner.y = std::clamp(corner.y, room.height + 2, std::max(room.height + 2, out.rows - below - 2));
    cv::putText(out, words, corner, cv::FONT_HERSHEY_SIMPLEX, size, black, 3, cv::LINE_AA);
    cv::putText(out, words, corner, cv::FONT_HERSHEY_SIMPLEX, size, white, 1, cv::LINE_AA);
  }
  const auto bytes = encode_image(".png", lumo::view_of(out));
  return {bytes.begin(), bytes.end()};
}

}  // namespace lumo::program
