#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/optical_data.hpp"

#include <string>
#include <string_view>

namespace lumo {

/// Material card of a transparent silicone. Source: paper Table I (both have Poisson's ratio 0.495).
struct Silicone {
  std::string name;
  double density_kg_per_m3;
  double mu_Pa;      ///< shear modulus
  double lambda_Pa;  ///< Lamé's first parameter
  double refractive_index;
  double extinction_per_m;         ///< absorption and scattering together
  double scattering_albedo = 0.0;  ///< share of the extinction that is scattering, for a ScatteringMedium; BeerLambert
                                   ///< takes all of it as absorption
  double anisotropy = 0.0;         ///< mean cosine of the angle of scattering; neither is in the paper

  bool operator==(const Silicone&) const = default;
  Medium medium() const { return {refractive_index, extinction_per_m, scattering_albedo, anisotropy}; }
};

inline Silicone dragon_skin() { return {"DS", 1070.0, 106.0_kPa, 10.494_MPa, 1.4348, 71.3801_per_m}; }
inline Silicone solaris() { return {"Sol", 990.0, 98.5_kPa, 9.750_MPa, 1.4100, 14.5063_per_m}; }

/// Card by its short name, "DS" or "Sol". Throws InvalidArgument for any other.
inline Silicone silicone(std::string_view name) {
  for (const Silicone& card : {dragon_skin(), solaris()})
    if (card.name == name) return card;
  throw InvalidArgument(message("material is '", name, "', must be DS or Sol"));
}

}  // namespace lumo
