#include "catch.hpp"

#include "lumo/sense/profile/frame_monitor.hpp"

#include <cmath>

using namespace lumo;
using namespace lumo::sense;

TEST_CASE(
    "a contact that brightens the whole finger is no change of exposure, and room light is no contact", "[faults]") {
  FrameMonitor::Config config;
  config.position_m = Eigen::VectorXd::LinSpaced(55, -27e-3, 27e-3);
  config.unloaded = config.position_m.unaryExpr([](double y) { return 20.0 + 6.0 * std::cos(y * 2.0 * pi / 11e-3); });
  const auto seen = [&](auto light) {
    FrameMonitor monitor(config);
    Profile p;
    p.value = config.unloaded;
    for (Eigen::Index i = 0; i < p.value.size(); ++i) p.value[i] = light(config.position_m[i], p.value[i]);
    return monitor.check_light(p, 0.0, 0.0).faults;
  };
  // As the lab's built finger: eight times the light at 15 N, and half as much again at the far end.
  for (const double place_m : {-24e-3, -8e-3, 0.0, 15e-3})
    for (const double load : {0.05, 0.2, 0.5, 1.0})
      CHECK_FALSE(seen([&](double y, double v) {
        const double away = (y - place_m) / 6e-3;
        return v * (1.0 + load * (0.4 + 7.0 / (1.0 + away * away)));
      }).any());
  CHECK_FALSE(seen([](double y, double v) { return std::abs(y) < 4e-3 ? 0.5 * v : 1.03 * v; }).any());
  for (const double factor : {0.5, 0.8, 1.2, 3.0})
    CHECK(seen([&](double, double v) { return factor * v; }).has(Fault::exposure_changed));
  for (const double room : {5.0, 15.0, 60.0}) CHECK(seen([&](double, double v) { return v + room; }).any());
  CHECK(seen([](double, double) { return 127.0; }).has(Fault::frame_corrupt));
  CHECK(seen([](double y, double v) { return std::abs(y) < 4e-3 ? 0.2 * v : v; }).has(Fault::led_dead));
}
