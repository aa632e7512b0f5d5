#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"

#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace lumo {

/// A homogeneous medium: refractive index [–], extinction coefficient [1/m], and what a scattering reading of the
/// extinction needs.
struct Medium {
  double refractive_index = 1.0;
  double extinction_per_m = 0.0;   ///< absorption and scattering together
  double scattering_albedo = 0.0;  ///< share of the extinction that is scattering
  double anisotropy = 0.0;         ///< mean cosine of the angle of scattering
};

/// How light meets a surface.
struct Dielectric {
  bool operator==(const Dielectric&) const = default;
};  ///< smooth interface: Fresnel reflection and refraction
struct Lambertian {
  double albedo = 0.8;
  bool operator==(const Lambertian&) const = default;
};  ///< diffuse, opaque
struct Mirror {
  double reflectance = 1.0;
  bool operator==(const Mirror&) const = default;
};  ///< specular, opaque
struct Absorber {
  bool operator==(const Absorber&) const = default;
};  ///< black
using SurfaceOptics = std::variant<Dielectric, Lambertian, Mirror, Absorber>;

/// A flat opaque face of the rigid carrier that light can meet through air, as a convex polygon; counter-clockwise seen
/// from the lit side.
struct RigidFace {
  std::string name;
  std::vector<Vec3d> corners;  ///< [m]
  SurfaceOptics optics = Lambertian{};
};

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
