#pragma once

#include "lumo/core/types.hpp"
#include "lumo/optics/intersector.hpp"
#include "lumo/optics/transport/ray_pattern.hpp"

#include <algorithm>
#include <optional>

namespace lumo {

/// How rays of emitters in air start where a film of air lies between an emitter and the body, which loads may close.
/// What a closed film does is not known from drawings (dust and roughness keep it open, dew wets it): closing is an
/// assumption, with a law that is smooth in the height of the film. The wetted share of the light enters the body as if
/// the emitter touched it, the rest crosses the film.
template <RayScene Scene> class FilmLaunch {
 public:
  /// `closes_m`: height of the film at which it begins to close; 0: it closes where the body reaches the emitter;
  /// nullopt: never, however hard the body is pressed there.
  FilmLaunch(const Scene& scene, std::optional<double> closes_m) : scene_(scene), closes_m_(closes_m) {}

  /// The film over a point of an emitter.
  struct Film {
    double height_m;  ///< to the body; 0: the body covers the point, or there is none over it
    bool covered;     ///< the body overlaps the emitter there
    double wet;       ///< share of the light that enters the body at once
  };
  Film at(const Vec3d& point, const Vec3d& axis) const {
    const RayHit in = scene_.first_hit(point, axis, true), out = scene_.first_hit(point, axis, false);
    const bool covered = in && (!out || in.t < out.t);
    const double height = covered || !out ? 0.0 : out.t;
    const double wet = !closes_m_ ? 0.0 : covered ? 1.0 : out ? wetted(height) : 0.0;
    return {height, covered, wet};
  }
  bool may_close() const { return closes_m_.has_value(); }

  /// Calls start(ray, share of its power, inside the body?) for the one or two ways on which a ray starts. `axis`: of
  /// its emitter.
  template <class Start> void operator()(const PrimaryRay& ray, const Vec3d& axis, Start&& start) const {
    const auto [height, covered, wet] = at(ray.origin, axis);
    if (wet > 0.0) {
      PrimaryRay entered = ray;
      entered.origin += height * axis;
      start(entered, wet, true);
    }
    if (wet == 1.0) return;
    PrimaryRay crossing = ray;
    if (covered) {  // the body crosses the emitter by the overlap of its contact: back to before its surface
      const RayHit surface = scene_.first_hit(ray.origin, -axis, true);
      crossing.origin -= ((surface ? surface.t : 0.0) + clear_m) * axis;
    }
    start(crossing, 1.0 - wet, false);
  }

 private:
  static constexpr double clear_m = 1e-7;  // before a surface, far above rounding

  double wetted(double height) const {
    if (!(*closes_m_ > height)) return 0.0;
    const double t = 1.0 - height / *closes_m_;
    return t * t * (3.0 - 2.0 * t);
  }

  const Scene& scene_;
  std::optional<double> closes_m_;
};

}  // namespace lumo
