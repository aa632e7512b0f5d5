#pragma once

#include "charts/svg.hpp"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>
#include <vector>

/// How much room a text takes, and whether something is in its way. All in px, y downwards.
namespace lumo::program::drawing {

/// Advance widths of DejaVu Sans from ' ' to '~', in thousandths of the size (from the font's table hmtx,
/// version 2.37). It is the first font of every picture.
inline constexpr std::array<int, 95> advance_widths = {318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318,
    361, 318, 337, 636, 636, 636, 636, 636, 636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698,
    770, 632, 575, 775, 752, 295, 295, 656, 557, 863, 748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685,
    390, 337, 390, 838, 500, 500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635,
    411, 521, 392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838};

/// Width of a text in DejaVu Sans; other than ASCII characters count as one mean width each.
inline double text_width(std::string_view s, double size) {
  double width = 0.0;
  for (const char c : s) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 32 && byte < 127) width += advance_widths[byte - 32u];
    else if ((byte & 0xC0u) != 0x80u) width += 620.0;  // the bytes of one character count once
  }
  return 1e-3 * size * width;
}

struct Box {
  double left, top, right, bottom;
};

/// What a text covers when it stands at `at`: from the height of its capitals to the depth of its tails.
inline Box text_box(Point at, std::string_view words, const Svg::TextStyle& t) {
  const double width = text_width(words, t.size), left = t.anchor == Svg::end      ? at[0] - width
                                                         : t.anchor == Svg::middle ? at[0] - 0.5 * width
                                                                                   : at[0];
  return {left, at[1] - 0.76 * t.size, left + width, at[1] + 0.24 * t.size};
}

inline Box grown(const Box& b, double by) { return {b.left - by, b.top - by, b.right + by, b.bottom + by}; }

inline bool overlap(const Box& a, const Box& b) {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}

/// Whether the line from a to b passes through the box (Liang, Barsky 1984: the part of it that lies between each pair
/// of sides).
inline bool overlap(const Box& box, Point a, Point b) {
  double from = 0.0, to = 1.0;
  for (const auto& [start, step, low, high] :
      {std::array{a[0], b[0] - a[0], box.left, box.right}, std::array{a[1], b[1] - a[1], box.top, box.bottom}}) {
    if (step == 0.0) {
      if (start <= low || start >= high) return false;
      continue;
    }
    const auto [enters, leaves] = std::minmax({(low - start) / step, (high - start) / step});
    from = std::max(from, enters);
    to = std::min(to, leaves);
  }
  return from < to;
}

/// What labels are to keep off.
struct Obstacles {
  std::vector<std::pair<Point, Point>> lines;
  std::vector<Box> boxes;

  auto hits(const Box& b) const {
    return std::count_if(lines.begin(), lines.end(), [&](const auto& l) { return overlap(b, l.first, l.second); }) +
           std::count_if(boxes.begin(), boxes.end(), [&](const Box& other) { return overlap(b, other); });
  }
};

}  // namespace lumo::program::drawing
