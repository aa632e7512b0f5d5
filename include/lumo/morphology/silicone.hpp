#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"

#include <algorithm>
#include <optional>
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

/// Material card of a transparent silicone. Source: paper Table I (both have Poisson's ratio 0.495), where extinction
/// is one number: all of it is absorption here, as the paper uses it.
struct Silicone {
  std::string name;
  double density_kg_per_m3;
  double mu_Pa;      ///< shear modulus
  double lambda_Pa;  ///< Lamé's first parameter
  double refractive_index;
  double absorption_per_m;
  double scattering_per_m = 0.0;  ///< for a ScatteringMedium; BeerLambert takes it as absorption, too
  double anisotropy = 0.0;        ///< mean cosine of the angle of scattering

  double extinction_per_m() const { return absorption_per_m + scattering_per_m; }
  Medium medium() const {
    const double extinction = extinction_per_m();
    return {refractive_index, extinction, scattering_per_m > 0.0 ? scattering_per_m / extinction : 0.0, anisotropy};
  }
  bool operator==(const Silicone&) const = default;
};

/// The silicone with the same extinction, of which only `absorbed_per_m` [1/m] is absorption; more than there is
/// absorbs all. The paper gives one extinction for each silicone and takes it as absorption.
inline Silicone scattering_the_rest(Silicone card, double absorbed_per_m, double anisotropy) {
  const double extinction = card.extinction_per_m();
  card.absorption_per_m = std::min(absorbed_per_m, extinction);
  card.scattering_per_m = extinction - card.absorption_per_m;
  card.anisotropy = anisotropy;
  return card;
}

inline Silicone dragon_skin() { return {"DS", 1070.0, 106.0_kPa, 10.494_MPa, 1.4348, 71.3801_per_m}; }
inline Silicone solaris() { return {"Sol", 990.0, 98.5_kPa, 9.750_MPa, 1.4100, 14.5063_per_m}; }

/// What validate() admits.
inline constexpr Limits densities_kg_per_m3{1.0, 1e5}, shear_moduli_Pa{1.0, 1e12}, lame_parameters_Pa{0.0, 1e15},
    refractive_indices{1.0, 4.0}, extinctions_per_m{0.0, 1e6}, anisotropies{-0.999, 0.999};

/// Throws InvalidArgument for a number that is out of range.
inline void validate(const Silicone& s) {
  require_in_range("density of the silicone", s.density_kg_per_m3, densities_kg_per_m3, "kg/m3");
  require_in_range("shear modulus of the silicone", s.mu_Pa, shear_moduli_Pa, "Pa");
  require_in_range("first Lame parameter of the silicone", s.lambda_Pa, lame_parameters_Pa, "Pa");
  require_in_range("refractive index of the silicone", s.refractive_index, refractive_indices, "");
  require_in_range("absorption of the silicone", s.absorption_per_m, extinctions_per_m, "1/m");
  require_in_range("scattering of the silicone", s.scattering_per_m, extinctions_per_m, "1/m");
  require_in_range("anisotropy of scattering", s.anisotropy, anisotropies, "");
}

/// Card by its short name, "DS" or "Sol"; none for any other.
inline std::optional<Silicone> find_silicone(std::string_view name) {
  for (const Silicone& card : {dragon_skin(), solaris()})
    if (card.name == name) return card;
  return std::nullopt;
}

/// The same. Throws InvalidArgument for any other name.
inline Silicone silicone(std::string_view name) {
  if (const std::optional<Silicone> card = find_silicone(name)) return *card;
  throw InvalidArgument(message("material is '", name, "', must be DS or Sol"));
}

}  // namespace lumo
