#include "catch.hpp"

#include "lumo/core/units.hpp"

#include <cmath>

using namespace lumo::literals;

TEST_CASE("lengths, pressures and angles become SI") {
  CHECK(5.0_mm == 5e-3);
  CHECK(106.0_kPa == 106e3);
  CHECK(10.494_MPa == Approx(10.494e6).epsilon(1e-15));
  CHECK(30.0_um == Approx(30e-6).epsilon(1e-15));
  CHECK(180.0_deg == lumo::pi);
  CHECK(1070.0_kg_per_m3 == 1070.0);
}

TEST_CASE("attenuation in dB/cm is one of power, per metre and to the base e") {
  CHECK(3.1_dB_per_cm == Approx(71.3801).margin(5e-5));
  CHECK(0.63_dB_per_cm == Approx(14.5063).margin(5e-5));
  // 10 dB over 1 cm leave a tenth.
  CHECK(std::exp(-10.0_dB_per_cm * 1e-2) == Approx(0.1).epsilon(1e-14));
}

TEST_CASE("literals are compile-time constants") {
  static_assert(2.0_N == 2.0 && 1.0_m == 1000.0_mm && 1.0_W == 1.0);
  SUCCEED();
}
