#pragma once

#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"
#include "lumo/morphology/emitter.hpp"
#include "lumo/optics/intersector.hpp"
#include "lumo/optics/scattering_medium.hpp"
#include "lumo/optics/transport/film_launch.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace lumo {

/// Emitters as paths meet them that run backwards, from where light is seen: flat faces that radiate and stand in
/// nobody's way, as paths from emitters have it. What lies in air starts as FilmLaunch says, across its film or, where
/// that is closed, in the body at once.
template <RayScene Scene> class EmitterFaces {
 public:
  /// A straight piece of a path.
  struct Piece {
    Vec3d origin, direction;
    double length_m;
    bool inside;  ///< in the body
    /// Of its direction [1/sr], where that was drawn as light was scattered: scattered() has a part of the light.
    double density = 0.0;
  };

  /// Emitters that cannot be seen (Emitter::can_be_seen) are left out. `air_gain`: of radiance in the body over that in
  /// the air that it came from, the index ratio squared. `slack_m`: that a lamp may lie behind a surface by rounding.
  EmitterFaces(const std::vector<Emitter>& emitters, const Scene& scene, std::optional<double> film_closes_m,
      double air_gain, double slack_m)
      : scene_(scene), film_(scene, film_closes_m), air_gain_(air_gain), slack_m_(slack_m) {
    for (const Emitter& e : emitters)
      if (e.can_be_seen()) faces_.push_back({e, e.center(), e.axis(), pi / e.area_m2()});
  }

  bool empty() const { return faces_.empty(); }

  /// π times the radiance [W/m²] that starts on a piece and runs along it to its origin, `transmittance(s)` of which
  /// is left after s metres in the body. Light that starts in air counts `air_gain` times.
  template <class Transmittance> double exitance(const Piece& piece, Transmittance&& transmittance) const {
    double sum = 0.0;
    for (const Face& f : faces_) {
      const double cosine = -piece.direction.dot(f.axis);
      if (!(cosine > 0.0)) continue;
      const double sent = f.per_area * f.emitter.intensity(cosine) / cosine;
      if (!(sent > 0.0)) continue;
      if (!f.emitter.in_air()) {
        if (piece.inside) sum += sent * crossing(f, piece, cosine, transmittance);
      } else {
        sum += sent * (piece.inside ? through_closed_film(f, piece, transmittance)
                                    : air_gain_ * across_film(f, piece, cosine));
      }
    }
    return sum;
  }

  /// π times the radiance [W/m²] that comes straight from emitters in the body to the point `p` and is scattered there
  /// into −`direction`, for one point of each emitter, from two numbers in (0, 1) (next-event estimation).
  template <PhaseMedium Medium>
  double scattered(const Vec3d& p, const Vec3d& direction, const Medium& medium, double u, double v) const {
    double sum = 0.0;
    for (const Face& f : faces_) {
      if (f.emitter.in_air()) continue;
      const Vec3d way = f.emitter.point(u, v) - p;
      const double length = way.norm();
      if (!(length > slack_m_)) continue;
      const Vec3d d = way / length;
      const double cosine = -d.dot(f.axis);
      if (!(cosine > 0.0)) continue;
      const RayHit hit = scene_.first_hit(p, d, true);
      if (!hit || hit.t < length - slack_m_ / cosine) continue;
      const double phase = medium.phase(direction.dot(d)),
                   density = length * length / (f.emitter.area_m2() * cosine);  // of the direction, drawn like this
      sum += pi * f.emitter.intensity(cosine) / (f.emitter.area_m2() * cosine) * phase / (density + phase) *
             medium.transmittance(length);
    }
    return sum;
  }

 private:
  struct Face {
    Emitter emitter;
    Vec3d center, axis;
    double per_area;  ///< π over its area
  };

  template <class Transmittance>
  double crossing(const Face& f, const Piece& piece, double cosine, Transmittance&& transmittance) const {
    const double at = (piece.origin - f.center).dot(f.axis) / cosine;
    if (!(at >= 0.0 && at <= piece.length_m + slack_m_ / cosine)) return 0.0;
    if (!f.emitter.covers(piece.origin + at * piece.direction)) return 0.0;
    const double other = at * at / (f.emitter.area_m2() * cosine),
                 share = piece.density > 0.0 ? piece.density / (piece.density + other) : 1.0;
    return share * transmittance(at);
  }
  // Share of the light that crosses the film. A body that overlaps the emitter has its light start before its surface.
  double across_film(const Face& f, const Piece& piece, double cosine) const {
    const double height = (piece.origin - f.center).dot(f.axis);
    if (height / cosine > piece.length_m + slack_m_ / cosine) return 0.0;
    const Vec3d on =
        height >= 0.0 ? Vec3d(piece.origin + height / cosine * piece.direction) : Vec3d(piece.origin - height * f.axis);
    if (!f.emitter.covers(on)) return 0.0;
    const auto film = film_.at(on, f.axis);
    return height >= 0.0 || film.covered ? 1.0 - film.wet : 0.0;
  }
  // Share of the light that enters where the piece ends.
  template <class Transmittance>
  double through_closed_film(const Face& f, const Piece& piece, Transmittance&& transmittance) const {
    if (!film_.may_close()) return 0.0;
    const Vec3d end = piece.origin + piece.length_m * piece.direction;
    const double height = (end - f.center).dot(f.axis);
    const Vec3d on = end - height * f.axis;
    if (!f.emitter.covers(on)) return 0.0;
    const auto film = film_.at(on, f.axis);
    return film.wet > 0.0 && std::abs(film.height_m - std::max(0.0, height)) <= slack_m_
               ? film.wet * transmittance(piece.length_m)
               : 0.0;
  }

  const Scene& scene_;
  FilmLaunch<Scene> film_;
  double air_gain_, slack_m_;
  std::vector<Face> faces_;
};

}  // namespace lumo
