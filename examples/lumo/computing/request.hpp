#pragma once

#include "computing/mechanics.hpp"

#include "lumo/pipeline/lighting.hpp"

#include <array>
#include <string>
#include <string_view>
#include <vector>

/// What is asked of a computation, in the units in which it is typed: lengths in mm, angles in degrees, loads in N.
namespace lumo::program {

enum class Ensemble { flat, curved };
inline std::string_view name(Ensemble ensemble) { return ensemble == Ensemble::flat ? "flat" : "curved"; }

struct Pad {
  std::array<double, 5> theta_mm = {6.0, 6.0, 8.0, 5.0, 0.0};
  std::string material = "DS";

  bool operator==(const Pad&) const = default;
};

/// A sphere that is pressed on the pad.
struct Touch {
  double diameter_mm = 10.0;
  double angle_deg = 0.0;  ///< from the pad's normal
  double y_mm = 0.0;       ///< along the finger
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};

  bool operator==(const Touch&) const = default;
};

struct PressRequest : Pad, Touch {
  Mechanics mechanics;

  bool operator==(const PressRequest&) const = default;
};

/// Of both objectives; a search takes all but the design.
struct EvaluationRequest : Pad {
  Mechanics mechanics;
  Ensemble ensemble = Ensemble::flat;
  double ray_error_percent = 100.0 * RayRefinement{}.tolerance;  ///< wanted standard error of J_obs by rays
};

}  // namespace lumo::program
