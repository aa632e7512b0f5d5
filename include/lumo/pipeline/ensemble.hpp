#pragma once

#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/mechanics/contact/scenario.hpp"

#include <vector>

namespace lumo {

/// All combinations of diameters, approach angles (in one plane) and places along the finger, at the same loads.
struct Ensemble {
  std::vector<double> diameters_m = {10e-3, 15e-3, 20e-3, 30e-3};
  std::vector<double> angles_rad = {0.0};
  std::vector<double> places_m = {-22e-3, -11e-3, -5.5e-3, 0.0, 5.5e-3, 11e-3, 22e-3};
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};
  TiltPlane tilt = TiltPlane::xz;

  bool operator==(const Ensemble&) const = default;
  std::vector<Scenario<Sphere>> scenarios() const {
    std::vector<Scenario<Sphere>> all;
    for (double d : diameters_m)
      for (double a : angles_rad)
        for (double y : places_m) all.push_back({Sphere{d}, a, y, loads_N, tilt});
    return all;
  }
};

/// The paper's pad-normal contacts: 4 diameters × 7 places.
inline Ensemble flat_ensemble() { return {}; }

/// The paper's contacts under five approach angles: 4 × 5 × 7.
inline Ensemble curved_ensemble() {
  Ensemble e;
  e.angles_rad = {-30 * pi / 180, -15 * pi / 180, 0.0, 15 * pi / 180, 30 * pi / 180};
  return e;
}

/// What the authors' public code presses, three spheres to 10 N: 21 pad-normal contacts, or 75 under five angles at the
/// five inner places. The paper has a fourth sphere, 15 N, and all seven places. Source: the first author's public code
/// (dokkev/fingertip-design-framework, August 2026).
inline Ensemble authors_flat_ensemble() {
  Ensemble e;
  e.diameters_m = {10e-3, 15e-3, 20e-3};
  e.loads_N = {1.0, 2.0, 5.0, 10.0};
  return e;
}
inline Ensemble authors_curved_ensemble() {
  Ensemble e = authors_flat_ensemble();
  e.angles_rad = curved_ensemble().angles_rad;
  e.places_m = {-11e-3, -5.5e-3, 0.0, 5.5e-3, 11e-3};
  return e;
}

/// A scenario as the mirror image of one that is solved.
struct ScenarioImage {
  std::size_t solve;  ///< which solve it comes from
  Symmetry mirror;    ///< in which planes it is reflected
};

/// Which scenarios have to be solved if mirror images are solved once.
template <Indenter Tool = Sphere> struct ContactPlan {
  struct Solve {
    Scenario<Tool> scenario;  ///< with angle, x and y ≥ 0 where mirror images are solved once
    std::size_t place;        ///< index into `places`
  };
  /// Contacts at one angle and place share a mesh.
  struct Place {
    double angle_rad, x_m, y_m;
    TiltPlane tilt;
    std::vector<std::size_t> solves;
  };
  std::vector<Solve> solves;
  std::vector<ScenarioImage> images;  ///< one per scenario
  std::vector<Place> places;
};

namespace detail {

/// Planes, of those that are allowed, in which a contact is to be mirrored so that all its images become the same one:
/// y ≥ 0, angle ≥ 0, and x ≥ 0 where that does not turn the angle.
template <Indenter Tool> Symmetry to_first_image(const Scenario<Tool>& s, Symmetry allowed) {
  const bool along = s.tilt == TiltPlane::yz, back = s.angle_rad < 0.0;
  return {allowed.x && (along || s.angle_rad == 0.0 ? s.x_m < 0.0 : back),
      allowed.y && (s.y_m < 0.0 || (along && s.y_m == 0.0 && back))};
}

}  // namespace detail

/// `symmetry`: of the body. `once`: planes in which one of two mirrored states stands for both if tool and body are
/// symmetric.
template <Indenter Tool> ContactPlan<Tool> plan_contacts(
    const std::vector<Scenario<Tool>>& scenarios, Symmetry symmetry, Symmetry once = {true, true}) {
  ContactPlan<Tool> plan;
  for (const Scenario<Tool>& s : scenarios) {
    validate(s);
    const Symmetry mirror = detail::to_first_image(
        s, {once.x && symmetry.x && is_symmetric(s.indenter, 0), once.y && symmetry.y && is_symmetric(s.indenter, 1)});
    const Scenario<Tool> first = mirrored(s, mirror);
    std::size_t k = 0;
    while (k < plan.solves.size() && !(plan.solves[k].scenario == first)) ++k;
    if (k == plan.solves.size()) {
      // One mesh serves a contact and its mirror images: the mesh has the body's symmetry.
      const Scenario<Tool> home = mirrored(first, detail::to_first_image(first, symmetry));
      std::size_t place = 0;
      while (place < plan.places.size() &&
             !(plan.places[place].angle_rad == home.angle_rad && plan.places[place].x_m == home.x_m &&
                 plan.places[place].y_m == home.y_m && plan.places[place].tilt == home.tilt))
        ++place;
      if (place == plan.places.size()) plan.places.push_back({home.angle_rad, home.x_m, home.y_m, home.tilt, {}});
      plan.places[place].solves.push_back(k);
      plan.solves.push_back({first, place});
    }
    plan.images.push_back({k, mirror});
  }
  return plan;
}

}  // namespace lumo
