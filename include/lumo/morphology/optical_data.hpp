#pragma once

#include "lumo/core/types.hpp"

#include <string>
#include <variant>
#include <vector>

namespace lumo {

/// A homogeneous medium: refractive index [–] and extinction coefficient [1/m].
struct Medium {
  double refractive_index = 1.0;
  double extinction_per_m = 0.0;
};

/// How light meets a surface.
struct Dielectric {};                                ///< smooth interface: Fresnel reflection and refraction
struct Lambertian { double albedo = 0.8; };          ///< diffuse, opaque
struct Mirror { double reflectance = 1.0; };         ///< specular, opaque
struct Absorber {};                                  ///< black
using SurfaceOptics = std::variant<Dielectric, Lambertian, Mirror, Absorber>;

/// A flat rectangular emitter with a cosine law into the medium that it touches. It radiates to `half_u` × `half_v`.
struct RectangleEmitter {
  Vec3 center = Vec3::Zero();      ///< [m]
  Vec3 half_u = Vec3::UnitX();     ///< half edge [m]
  Vec3 half_v = Vec3::UnitY();     ///< half edge [m]
  double power_W = 1.0;
  int channel = 0;                 ///< colour channel
};

/// A flat opaque face of the rigid carrier that light can meet through air, as a convex polygon; counter-clockwise seen from the lit side.
struct RigidFace {
  std::string name;
  std::vector<Vec3> corners;       ///< [m]
  SurfaceOptics optics = Lambertian{};
};

}  // namespace lumo
