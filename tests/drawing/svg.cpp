#include "lumo/drawing/svg.hpp"

#include "catch.hpp"
#include "lumo/drawing/plot.hpp"

#include <sstream>

using namespace lumo;

TEST_CASE("short numbers have no trailing zeros and no minus zero") {
  CHECK(short_number(1.50) == "1.5");
  CHECK(short_number(-0.001, 2) == "0");
  CHECK(short_number(10.0, 0) == "10");
  CHECK(short_number(-29.5, 2) == "-29.5");
}

TEST_CASE("ticks are round, few and cover the data") {
  for (const double high : {1e-6, 0.0037, 0.3, 1.0, 3.7, 15.0, 999.0, 12345.0})
    for (const double low : {0.0, -0.3 * high}) {
      const auto t = plot::ticks(low, high, 6);
      INFO(low << " " << high);
      CHECK(t.front() <= low + 1e-5 * high);
      CHECK(t.back() >= high * (1 - 1e-5));
      CHECK(t.size() >= 3);
      CHECK(t.size() <= 12);
    }
  CHECK(plot::ticks(0.0, 15.0 + 1e-7, 6).back() == 15.0);
  CHECK(plot::ticks(0.0, 0.0, 6).size() > 1);  // all values zero
}

TEST_CASE("an axis of small or large numbers is divided by a power of ten, which its unit names") {
  CHECK(plot::common_exponent({0.0, 3e-6}) == -6);
  CHECK(plot::common_exponent({-0.5, 20.0}) == 0);
  CHECK(plot::with_power("force [N]", -6) == "force [10⁻⁶ N]");
  CHECK(plot::with_power("count", 12) == "count [10¹²]");
  CHECK(plot::tick_texts({-1e-6, 0.0, 1e-6}, -6) == std::vector<std::string>{"−1", "0", "1"});
}

TEST_CASE("a picture has its page, its groups and its words, escaped") {
  Svg svg({.width = 20.0, .height = 10.5, .unit = "mm", .title = "a & b", .digits = 3});
  svg.begin_group("OUTLINE", {.stroke = "#000000", .width = 0.15});
  svg.outline({{0.0, 0.0}, {1.23456, 2.0}}, true);
  svg.end_group();
  svg.text({1.0, 2.0}, "x < 1");
  const std::string s = svg.str();
  CHECK(s.find("width=\"20mm\" height=\"10.5mm\" viewBox=\"0 0 20 10.5\"") != std::string::npos);
  CHECK(s.find("<title>a &amp; b</title>") != std::string::npos);
  CHECK(s.find("<g id=\"OUTLINE\" fill=\"none\" stroke=\"#000000\" stroke-width=\"0.15\"") != std::string::npos);
  CHECK(s.find("<path d=\"M0 0L1.235 2Z\"/>\n</g>") != std::string::npos);
  CHECK(s.find(">x &lt; 1</text>") != std::string::npos);
  std::ostringstream out;
  svg.write(out);
  CHECK(out.str() == s);
  out.setstate(std::ios::badbit);
  CHECK_THROWS_AS(svg.write(out), InputError);
}

TEST_CASE("colours between stops meet them") {
  constexpr std::array<std::array<double, 3>, 3> stops{{{0, 0, 0}, {100, 200, 50}, {255, 255, 255}}};
  CHECK(colour_between(stops, -1.0) == "#000000");
  CHECK(colour_between(stops, 0.25) == "#326419");
  CHECK(colour_between(stops, 0.5) == "#64c832");
  CHECK(colour_between(stops, 1.0) == "#ffffff");
}

TEST_CASE("colours are written with two digits each", "[core]") {
  CHECK(hex_colour({0, 15, 255}) == "#000fff");
  CHECK(hex_colour({16, 160, 171}) == "#10a0ab");
}
