#include "catch.hpp"

#include "charts/chart.hpp"
#include "charts/contact_picture.hpp"

#include <limits>

using namespace lumo;
using namespace lumo::program;

TEST_CASE("shades run from light to dark") {
  CHECK(shade(0, 5) == "#a9cfea");
  CHECK(shade(4, 5) == "#082c5c");
  CHECK(shade(0, 1) == "#082c5c");
}

TEST_CASE("charts escape their words and survive missing values") {
  BarChart bars{"a < b & c", "", "x", "y", {"1", "2"},
      {{"s", "#000000", {1.0, std::numeric_limits<double>::quiet_NaN()}, {0.1}}}};
  const std::string svg = draw(bars);
  CHECK(svg.find("a &lt; b &amp; c") != std::string::npos);
  CHECK(svg.find("nan") == std::string::npos);
  CHECK(draw(LineChart{"empty", "", "x", "y", {}}).find("</svg>") != std::string::npos);
}

TEST_CASE("a triangle is clipped where its field is zero") {
  const std::array<Point, 3> corner = {{{0, 0}, {4, 0}, {0, 4}}};
  CHECK(program::drawing::clip_positive(corner, {-1, -1, -1}).empty());
  CHECK(program::drawing::clip_positive(corner, {1, 1, 1}).size() == 3);
  const auto tip = program::drawing::clip_positive(corner, {1, -3, -1});
  REQUIRE(tip.size() == 3);
  CHECK(tip[1] == Point{1, 0});
  CHECK(tip[2] == Point{0, 2});
  const double untouchable = -std::numeric_limits<double>::infinity();
  for (const Point& p : program::drawing::clip_positive(corner, {1, 1, untouchable}))
    CHECK((std::isfinite(p[0]) && std::isfinite(p[1])));
}
