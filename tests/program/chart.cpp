#include "catch.hpp"

#include "drawing/chart.hpp"
#include "drawing/contact_picture.hpp"

#include <limits>

using namespace lumo::program;

TEST_CASE("short numbers have no trailing zeros and no minus zero") {
  CHECK(short_number(1.50) == "1.5");
  CHECK(short_number(-0.001, 2) == "0");
  CHECK(short_number(10.0, 0) == "10");
  CHECK(short_number(-29.5, 2) == "-29.5");
}

TEST_CASE("ticks are round, few and cover the data") {
  for (const double high : {1e-6, 0.0037, 0.3, 1.0, 3.7, 15.0, 999.0, 12345.0})
    for (const double low : {0.0, -0.3 * high}) {
      const auto t = detail::ticks(low, high, 6);
      INFO(low << " " << high);
      CHECK(t.front() <= low + 1e-5 * high);
      CHECK(t.back() >= high * (1 - 1e-5));
      CHECK(t.size() >= 3);
      CHECK(t.size() <= 12);
    }
  CHECK(detail::ticks(0.0, 15.0 + 1e-7, 6).back() == 15.0);
  CHECK(detail::ticks(0.0, 0.0, 6).size() > 1);   // all values zero
}

TEST_CASE("shades run from light to dark") {
  CHECK(shade(0, 5) == "#a9cfea");
  CHECK(shade(4, 5) == "#082c5c");
  CHECK(shade(0, 1) == "#082c5c");
}

TEST_CASE("charts escape their words and survive missing values") {
  BarChart bars{"a < b & c", "", "x", "y", {"1", "2"}, {{"s", "#000000", {1.0, std::numeric_limits<double>::quiet_NaN()}, {0.1}}}};
  const std::string svg = draw(bars);
  CHECK(svg.find("a &lt; b &amp; c") != std::string::npos);
  CHECK(svg.find("nan") == std::string::npos);
  CHECK(draw(LineChart{"empty", "", "x", "y", {}}).find("</svg>") != std::string::npos);
}

TEST_CASE("a triangle is clipped where its field is zero") {
  const std::array<Point, 3> corner = {{{0, 0}, {4, 0}, {0, 4}}};
  CHECK(detail::clip_positive(corner, {-1, -1, -1}).empty());
  CHECK(detail::clip_positive(corner, {1, 1, 1}).size() == 3);
  const auto tip = detail::clip_positive(corner, {1, -3, -1});
  REQUIRE(tip.size() == 3);
  CHECK(tip[1] == Point{1, 0});
  CHECK(tip[2] == Point{0, 2});
  const double untouchable = -std::numeric_limits<double>::infinity();
  for (const Point& p : detail::clip_positive(corner, {1, 1, untouchable})) CHECK((std::isfinite(p[0]) && std::isfinite(p[1])));
}
