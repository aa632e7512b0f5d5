#include "computing/pad_light.hpp"

#include "computing/tools.hpp"
#include "configuration/effective.hpp"
#include "console/text.hpp"
#include "console/version.hpp"

#include "lumo/lab/observe_pad.hpp"

namespace lumo::program {

namespace {

Configuration of_pad(const Pad& pad) {
  Configuration whole;
  whole.pad = pad;
  return whole;
}

/// What the virtual lab computes its light with.
struct PadSettings {
  PadGrid grid;
  SideSight sight;
  FingerOptions finger;
  Focus focus;
  Light<SideSight>::Config rays;

  explicit PadSettings(const PressedPad& pressed) : finger(pressed.pad.finger) {
    const FingerOptions& of = pressed.pad.finger;
    grid.diameter_m = 1e-3 * pressed.diameter_mm;
    // A half as fine about the contact as elsewhere: depths are within 0.2 % of the default mesh's (y = 5 mm, 1 to 20
    // N), in less than half of the time.
    focus = {0.4e-3, 0.2, 0.8};
    const bool equal_ends = of.pad.cap_length == 0.0;
    if (equal_ends) {
      grid.load_N.push_back(20.0);
      grid.place_m = even_places(0.0, 26.0_mm, 1.0_mm);
      grid.tilt_place_m = {0.0, 22.0_mm};
    }
    rays.rays_per_emitter = 1 << 17;
    rays.carrier_rays = 1 << 17;
    rays.exit_rays = 1 << 19;
    if (!pressed.coarse) return;
    grid.load_N = {2.0, 5.0, grid.load_N.back()};
    if (equal_ends) {
      grid.place_m = {0.0, 13.0_mm, 26.0_mm};
      grid.tilt_place_m = {13.0_mm};
    } else {
      grid.place_m = even_places(-24.0_mm, 26.0_mm, 10.0_mm);  // where the plans press
      grid.tilt_place_m = {0.0};
    }
    finger.mesh.contact_edge = finger.mesh.coarsest_edge = 6.0_mm;
    focus = {1.2e-3, 0.4, 1.0};
    rays.rays_per_emitter = 1 << 12;
    rays.carrier_rays = 1 << 14;
    rays.exit_rays = 1 << 16;
  }
};

}  // namespace

std::string pad_responses_key(const PressedPad& pressed) {
  const PadSettings s(pressed);
  const Pad& o = pressed.pad;
  return lumo::message("lab 1, lumo ", version, ", theta ", joined(o.theta_mm), " mm, ",
      text_of(tree_of(of_pad(o), {"silicone", "finger", "leds", "mesh"}), -1), ", sphere ", 1e3 * s.grid.diameter_m,
      " mm, places ", joined(s.grid.place_m), " m, loads ", joined(s.grid.load_N), " N, finest edge ",
      1e3 * s.focus.finest, " mm, surface edge ", 1e3 * s.finger.mesh.contact_edge, " mm, rays ",
      s.rays.rays_per_emitter, " ", s.rays.carrier_rays, " ", s.rays.exit_rays, ", bins ", s.sight.bins);
}

PadResponses make_pad_responses(const PressedPad& pressed, int threads, Progress& progress) {
  const PadSettings s(pressed);
  const Pad& o = pressed.pad;
  auto pipeline = pipeline_for<SideSight>(of_pad(o), Light<SideSight>(s.rays, s.sight));
  pipeline.focus = s.focus;
  pipeline.rays.rounds = 0;
  const Body body = finger(o.design(), o.silicone, s.finger);
  PadResponses r = observe_pad(body, s.sight, s.grid, pipeline, TbbExecutor{threads}, shown_in(progress));
  r.theta_mm.assign(o.theta_mm.begin(), o.theta_mm.end());
  r.material = o.material();
  return r;
}

}  // namespace lumo::program
