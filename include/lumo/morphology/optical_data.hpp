#pragma once

#include "lumo/core/types.hpp"

#include <string>
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

}  // namespace lumo
