#pragma once

#include "lumo/morphology/emitter.hpp"
#include "lumo/morphology/measured_lobe.hpp"
#include "lumo/optics/photodiode.hpp"
#include "lumo/optics/pinhole_camera.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "optics/scenes.hpp"

#include <string>

/// Every optical policy, a line each: the laws in test_policy_laws.cpp run over all of them.
namespace optics_test {

struct NamedEmitter {
  std::string name;
  Emitter emitter;
};
/// About the place `at`, radiating along +z as far as they have a way, 1 W.
inline std::vector<NamedEmitter> all_emitters(const Vec3d& at) {
  const LobeTable lobe({0.0, 0.3, 0.8, 1.2}, {1.0, 0.9, 0.4, 0.0});
  return {{"rectangle", RectangleEmitter{at, {0.5e-3, 0, 0}, {0, 0.8e-3, 0}, 1.0, 0}},
      {"disc", DiscEmitter{at, Vec3d::UnitZ(), 0.6e-3, 1.0, 0}}, {"point", PointEmitter{at, 1.0, 0}},
      {"lobe", MeasuredLobe{lobe, at, Vec3d::UnitZ(), 0.4e-3, 1.0, 0}},
      {"point with a lobe, askew", MeasuredLobe{lobe, at, Vec3d(0.5, 0.1, 0.8).normalized(), 0.0, 1.0, 0}}};
}

struct NamedSurface {
  std::string name;
  SurfaceOptics optics;
  bool lossless;
};
inline std::vector<NamedSurface> all_surfaces() {
  return {{"dielectric", Dielectric{}, true}, {"Lambertian", Lambertian{0.7}, false}, {"white", Lambertian{1.0}, true},
      {"mirror", Mirror{0.9}, false}, {"perfect mirror", Mirror{1.0}, true}, {"absorber", Absorber{}, false}};
}

/// Calls `f(name, tracer type's medium as a tag, medium data)` for each medium policy.
template <class M> struct MediumTag { using type = M; };
template <class F> void for_each_medium(double index, F&& f) {
  f("Beer-Lambert", MediumTag<BeerLambert>{}, lumo::Medium{index, 60.0});
  f("scattering forwards", MediumTag<ScatteringMedium>{}, lumo::Medium{index, 150.0, 0.8, 0.7});
  f("scattering evenly", MediumTag<ScatteringMedium>{}, lumo::Medium{index, 100.0, 0.9, 0.0});
}

/// Two photodiodes and a camera above a box whose top is z = 3 mm, all of them large, so that paths find them, too.
inline Photodiodes two_diodes() {
  return Photodiodes({{{-3e-3, 1e-3, 6e-3}, {2e-3, 0, 0}, {0, -2e-3, 0}, false, 60 * pi / 180},
      {{4e-3, 0, 7e-3}, {2e-3, 0, 0.5e-3}, {0, -1.5e-3, 0}, true}});
}
inline PinholeCamera wide_camera() {
  return PinholeCamera({.position = {1e-3, -1e-3, 9e-3},
      .view = -Vec3d::UnitZ(),
      .field_of_view_rad = 80 * pi / 180,
      .columns = 2,
      .rows = 2,
      .aperture_m = 1.5e-3,
      .focus_m = 6e-3});
}
template <class F> void for_each_readout(F&& f) {
  f("exit power", ExitPower{});
  f("photodiodes", two_diodes());
  f("camera", wide_camera());
}

/// A box of 10 × 8 × 6 mm whose floor (−z) and one side (+x) have the given optics; its top is region 0, everything
/// else region 1.
inline Model lit_box(const SurfaceOptics& optics, const lumo::Medium& medium, const Emitter& emitter) {
  Model m = box({5e-3, 4e-3, 3e-3}, medium, 2);
  m.body.patches[4].optics = m.body.patches[1].optics = optics;
  m.body.emitters = {emitter};
  m.body.regions = 2;
  m.body.region = [](const Vec3d&, const Vec3d& n) { return n.z() > 0.5 ? 0 : 1; };
  return m;
}

template <class Medium, class Readout> typename Tracer<Medium, Readout>::Config few_rays(int rays = 1 << 9) {
  typename Tracer<Medium, Readout>::Config c;
  c.rays_per_emitter = rays;
  c.replicates = 8;
  c.carrier_rays = 2 * rays;
  c.exit_rays = 2 * rays;
  c.roulette_below = 0.05;
  c.scene.sub_facets = 1;
  return c;
}

}  // namespace optics_test
