#pragma once

#include "console/text.hpp"
#include "lumo/support/opencv.hpp"
#include "sensing/pictures.hpp"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace lumo::program {

namespace drawing {

/// Blue for −1, nearly white for 0, red for 1; in between by the square root, so that small changes are seen, too.
inline cv::Vec3b diverging(double t) {
  constexpr std::array<std::array<double, 3>, 3> ends{{{172, 83, 20}, {247, 247, 247}, {38, 24, 178}}};  // BGR
  const auto& end = ends[t < 0.0 ? 0 : 2];
  const double far = std::sqrt(std::min(1.0, std::abs(t)));
  cv::Vec3b colour;
  for (int k = 0; k < 3; ++k) {
    const auto i = std::size_t(k);
    colour[k] = cv::saturate_cast<unsigned char>(ends[1][i] + far * (end[i] - ends[1][i]));
  }
  return colour;
}

inline void words(cv::Mat& on, const std::string& text, cv::Point at, double size = 0.45) {
  cv::putText(on, text, at, cv::FONT_HERSHEY_SIMPLEX, size, cv::Scalar(34, 34, 34), 1, cv::LINE_AA);
}

}  // namespace drawing

/// A picture of signed values, with a colour bar and its unit, as a PNG file.
inline std::string false_colour_png(const FalseColour& f) {
  constexpr int margin = 16, head = 52, bar = 18, least_width = 760, least_height = 160, bar_room = 150;
  const int zoom = std::max({1, (least_width + f.columns - 1) / f.columns, (least_height + f.rows - 1) / f.rows}),
            width = zoom * f.columns, height = zoom * f.rows;
  cv::Mat small(f.rows, f.columns, CV_8UC3), large;
  for (int row = 0; row < f.rows; ++row)
    for (int column = 0; column < f.columns; ++column)
      small.at<cv::Vec3b>(row, column) = drawing::diverging(f.values[std::size_t(row * f.columns + column)] / f.range);
  cv::resize(small, large, {width, height}, 0.0, 0.0, cv::INTER_NEAREST);
  cv::Mat page(head + height + margin, width + 3 * margin + bar + bar_room, CV_8UC3, cv::Scalar(255, 255, 255));
  large.copyTo(page(cv::Rect(margin, head, width, height)));
  cv::rectangle(page, cv::Rect(margin, head, width, height), cv::Scalar(150, 150, 150));
  drawing::words(page, f.title, {margin, 20}, 0.52);
  drawing::words(page, f.subtitle, {margin, 41}, 0.42);
  const int left = 2 * margin + width;
  for (int y = 0; y < height; ++y)
    cv::line(
        page, {left, head + y}, {left + bar, head + y}, cv::Scalar(drawing::diverging(1.0 - 2.0 * y / (height - 1))));
  cv::rectangle(page, cv::Rect(left, head, bar + 1, height), cv::Scalar(150, 150, 150));
  for (const double part : {-1.0, -0.25, 0.0, 0.25, 1.0}) {
    const int y = head + int(std::lround(0.5 * (1.0 - part) * (height - 1)));
    cv::line(page, {left + bar, y}, {left + bar + 5, y}, cv::Scalar(90, 90, 90));
    const int lower = part == 1.0 ? 10 : part == -1.0 ? 0 : 4;
    drawing::words(
        page, (part > 0.0 ? "+" : "") + short_number(part * f.range, f.decimals), {left + bar + 9, y + lower}, 0.42);
  }
  drawing::words(page, f.unit, {left - 8, head - 11}, 0.42);
  const auto bytes = encode_image(".png", lumo::view_of(page));
  return {bytes.begin(), bytes.end()};
}

}  // namespace lumo::program
