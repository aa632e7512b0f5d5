// 01 Section: a design is five numbers in mm on a lattice; it becomes a body, or an error that says why not.
#include "lumo/morphology/finger.hpp"

#include <cstdio>

int main() {
  using namespace lumo;
  const FingerDesign design{.h_fp = 5.0, .h_ep = 10.0, .w_s = 10.0, .h_s = 6.0, .w_v = 3.0};
  std::printf("silicone over the cavity %.2f mm\n", euclidean_thickness(design));

  const Body body = finger(design, dragon_skin());
  std::printf("%s: %.2f cm3 of silicone, %zu LEDs, %d readout regions\n", body.name.c_str(), 1e6 * body.exact_volume_m3,
      body.emitters.size(), body.regions);
  for (const Patch& p : body.patches)
    std::printf("  %-10s %s%s%s\n", p.name.c_str(), p.bonded ? "bonded " : "", p.contactable ? "touchable " : "",
        p.meets_carrier ? "meets the carrier" : "");

  try {
    finger({.h_fp = 5.0, .h_ep = 10.0, .w_s = 10.0, .h_s = 6.0, .w_v = 5.5}, dragon_skin());
  } catch (const InfeasibleDesign& e) {
    std::printf("%s (by %.1f %s)\n", e.what(), e.excess(), e.unit().c_str());
    return 0;
  }
  return 1;  // that design must be refused
}
