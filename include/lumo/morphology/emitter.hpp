#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/core/units.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <memory>
#include <vector>

namespace lumo {

/// Sine (≥ 0) and cosine of the angle between a direction and an axis.
struct Polar {
  double sine, cosine;
};

/// A source of light in the medium that it touches: a flat or pointlike place, from all of which light goes the same
/// ways, evenly round an axis. Optional: `double intensity(double cosine) const` [W/sr], power_W times the density of
/// the directions that polar() draws; with it direct light is gathered backwards, which has less noise, without it (a
/// collimated beam has no such density) it is traced forward. `bool in_air`: it radiates into the air beside the body,
/// not into the body; its light is traced forward. `double area_m2() const` and `bool covers(const Vec3d& p) const`
/// (does it cover a point of its plane [m]?): with them and the intensity, a camera's paths see it. Laws: |axis| = 1;
/// point(u, v) is uniform in area [m] over (0, 1)² (there is less noise where point(1−u, 1−v) lies opposite it about
/// `center`); polar(u) is monotone; mirrored(m), m = (±1, ±1, 1), radiates to the mirror image of the axis, and points
/// do not depend on which of several ways the same source is described; power_W is all that it radiates [W]; `channel`
/// ≥ 0 is its colour.
template <class E>
concept EmitterModel = requires(const E& e, double u, const Vec3d& m) {
  { e.center } -> std::convertible_to<Vec3d>;
  { e.power_W } -> std::convertible_to<double>;
  { e.channel } -> std::convertible_to<int>;
  { e.axis() } -> std::convertible_to<Vec3d>;
  { e.point(u, u) } -> std::convertible_to<Vec3d>;
  { e.polar(u) } -> std::convertible_to<Polar>;
  { e.mirrored(m) } -> std::convertible_to<E>;
};

/// A flat rectangular emitter with a cosine law (Lambert 1760). It radiates to `half_u` × `half_v`.
struct RectangleEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d half_u{1.0, 0.0, 0.0};  ///< half edge [m]
  Vec3d half_v{0.0, 1.0, 0.0};  ///< half edge [m]
  double power_W = 1.0;
  int channel = 0;      ///< colour channel
  bool in_air = false;  ///< radiates into the air beside the body

  Vec3d axis() const {
    const Vec3d &u = half_u, &v = half_v;
    return u.cross(v).normalized();
  }
  Vec3d point(double u, double v) const {
    const Vec3d &c = center, &to_u = half_u, &to_v = half_v;
    return c + (2.0 * u - 1.0) * to_u + (2.0 * v - 1.0) * to_v;
  }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  double area_m2() const { return 4.0 * half_u.cross(half_v).norm(); }
  bool covers(const Vec3d& p) const {
    const Vec3d from = p - center, n = half_u.cross(half_v);
    const double of_one = n.squaredNorm();
    return std::abs(from.cross(half_v).dot(n)) <= of_one && std::abs(half_u.cross(from).dot(n)) <= of_one;
  }
  RectangleEmitter mirrored(const Vec3d& m) const;
};

static_assert(EmitterModel<RectangleEmitter>);

/// Throws InvalidArgument for an emitter without area or with a coordinate that is not finite.
inline void validate(const RectangleEmitter& e) {
  if (!e.half_u.allFinite() || !e.half_v.allFinite()) throw InvalidArgument("emitter: a coordinate is not finite");
  require_positive("emitter area", e.area_m2(), "m2");
}

/// Any model of EmitterModel: a value, cheap to copy.
class Emitter {
 public:
  template <class E>
  requires(!std::same_as<E, Emitter> && EmitterModel<E>) Emitter(const E& model)
      : model_(std::make_shared<const E>(model.mirrored(Vec3d(1.0, 1.0, 1.0)))), calls_(&calls<E>) {}

  Vec3d center() const { return calls_->center(model_.get()); }
  double power_W() const { return calls_->power_W(model_.get()); }
  int channel() const { return calls_->channel(model_.get()); }
  Vec3d axis() const { return calls_->axis(model_.get()); }
  Vec3d point(double u, double v) const { return calls_->point(model_.get(), u, v); }
  Polar polar(double u) const { return calls_->polar(model_.get(), u); }
  bool has_intensity() const { return calls_->intensity != nullptr; }
  bool in_air() const { return calls_->in_air(model_.get()); }
  /// [W/sr]; only where has_intensity().
  double intensity(double cosine) const { return calls_->intensity(model_.get(), cosine); }
  /// Has it a brightness, and a shape that is known?
  bool can_be_seen() const { return has_intensity() && calls_->area != nullptr && area_m2() > 0.0; }
  /// [m²]; this and covers() only where can_be_seen().
  double area_m2() const { return calls_->area(model_.get()); }
  bool covers(const Vec3d& p) const { return calls_->covers(model_.get(), p); }
  Emitter mirrored(const Vec3d& m) const { return calls_->mirrored(model_.get(), m); }
  /// Its model, if it is an E.
  template <EmitterModel E> const E* as() const {
    return calls_ == &calls<E> ? static_cast<const E*>(model_.get()) : nullptr;
  }
  bool same_model(const Emitter& other) const { return calls_ == other.calls_; }
  /// Throws InvalidArgument for a power that is not positive, a channel below 0, numbers that are not finite, and what
  /// the model's own validate() refuses.
  void validate() const;

 private:
  struct Calls {
    Vec3d (*center)(const void*);
    double (*power_W)(const void*);
    int (*channel)(const void*);
    Vec3d (*axis)(const void*);
    Vec3d (*point)(const void*, double, double);
    Polar (*polar)(const void*, double);
    double (*intensity)(const void*, double);   ///< or null
    double (*area)(const void*);                ///< or null
    bool (*covers)(const void*, const Vec3d&);  ///< or null
    bool (*in_air)(const void*);
    Emitter (*mirrored)(const void*, const Vec3d&);
    void (*validate)(const void*);
  };
  template <class E> static const E& model(const void* e) { return *static_cast<const E*>(e); }
  template <class E> static constexpr auto intensity_of() -> double (*)(const void*, double) {
    if constexpr (requires(const E& e) {
                    { e.intensity(0.5) } -> std::convertible_to<double>;
                  })
      return [](const void* e, double c) -> double { return model<E>(e).intensity(c); };
    else return nullptr;
  }
  template <class E> static constexpr bool has_shape = requires(const E& e, const Vec3d& p) {
    { e.area_m2() } -> std::convertible_to<double>;
    { e.covers(p) } -> std::convertible_to<bool>;
  };
  template <class E> static constexpr auto area_of() -> double (*)(const void*) {
    if constexpr (has_shape<E>) return [](const void* e) -> double { return model<E>(e).area_m2(); };
    else return nullptr;
  }
  template <class E> static constexpr auto covers_of() -> bool (*)(const void*, const Vec3d&) {
    if constexpr (has_shape<E>) return [](const void* e, const Vec3d& p) -> bool { return model<E>(e).covers(p); };
    else return nullptr;
  }
  template <class E> static const Calls calls;

  std::shared_ptr<const void> model_;
  const Calls* calls_;
};

/// Throws InvalidArgument for no emitters, a broken one, or a colour channel below the highest one that no emitter has.
inline void validate(const std::vector<Emitter>& emitters);

/// Number of colour channels: one more than the highest; 0 without emitters.
inline int color_count(const std::vector<Emitter>& emitters) {
  int count = 0;
  for (const Emitter& e : emitters) count = std::max(count, e.channel() + 1);
  return count;
}

// A mirror image changes the handedness of the edges, which is mended; of the two ways to name the edges, one is
// standard.
inline RectangleEmitter RectangleEmitter::mirrored(const Vec3d& m) const {
  RectangleEmitter image = *this;
  image.center = m.cwiseProduct(center);
  image.half_u = m.cwiseProduct(half_u);
  image.half_v = m.cwiseProduct(half_v) * m.prod();
  Eigen::Index k = 0;
  image.half_u.cwiseAbs().maxCoeff(&k);
  if (image.half_u[k] < 0.0) {
    image.half_u = -image.half_u;
    image.half_v = -image.half_v;
  }
  return image;
}

namespace detail {

/// What the model's own validate() says, if it has one.
template <class E> void validate_model(const E& model) {
  if constexpr (requires { validate(model); }) validate(model);
}

}  // namespace detail

template <class E> const Emitter::Calls Emitter::calls = {[](const void* e) -> Vec3d { return model<E>(e).center; },
    [](const void* e) -> double { return model<E>(e).power_W; },
    [](const void* e) -> int { return model<E>(e).channel; }, [](const void* e) -> Vec3d { return model<E>(e).axis(); },
    [](const void* e, double u, double v) -> Vec3d { return model<E>(e).point(u, v); },
    [](const void* e, double u) -> Polar { return model<E>(e).polar(u); }, intensity_of<E>(), area_of<E>(),
    covers_of<E>(),
    [](const void* e) -> bool {
      if constexpr (requires {
                      { model<E>(e).in_air } -> std::convertible_to<bool>;
                    })
        return model<E>(e).in_air;
      else return false;
    },
    [](const void* e, const Vec3d& m) { return Emitter(model<E>(e).mirrored(m)); },
    [](const void* e) { detail::validate_model(model<E>(e)); }};

inline void Emitter::validate() const {
  require_positive("emitter power", power_W(), "W");
  require_in_range("emitter channel", channel(), 0, 255, "");
  if (!center().allFinite()) throw InvalidArgument("emitter: its centre is not finite");
  calls_->validate(model_.get());
  if (!point(0.3, 0.6).allFinite()) throw InvalidArgument("emitter: a point of it is not finite");
  if (!(std::abs(axis().norm() - 1.0) < 1e-9))
    throw InvalidArgument(message("emitter: its axis has length ", axis().norm(), ", must be 1"));
}

inline void validate(const std::vector<Emitter>& emitters) {
  if (emitters.empty()) throw InvalidArgument("emitters: none given, at least one is needed");
  for (const Emitter& e : emitters) e.validate();
  for (int c = 0; c < color_count(emitters); ++c)
    if (std::none_of(emitters.begin(), emitters.end(), [&](const Emitter& e) { return e.channel() == c; }))
      throw InvalidArgument(message("emitters: none has colour channel ", c, ", but one has a higher one"));
}

/// Point of the unit disc from two numbers in (0, 1), uniform in area; opposite numbers give opposite points. Source:
/// Shirley & Chiu, "A Low Distortion Map Between Disk and Square", J. Graphics Tools 2 (1997).
inline Vec3d on_unit_disc(double u, double v, const Vec3d& t1, const Vec3d& t2) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  if (a == 0.0 && b == 0.0) return Vec3d::Zero();
  const bool steep = std::abs(b) > std::abs(a);
  const double r = steep ? b : a, turn = steep ? 0.5 * pi - 0.25 * pi * (a / b) : 0.25 * pi * (b / a);
  return r * (std::cos(turn) * t1 + std::sin(turn) * t2);
}

/// Point of the disc about `center` with unit normal `n`; the same for every description of it.
inline Vec3d on_disc(const Vec3d& center, const Vec3d& n, double radius_m, double u, double v) {
  Vec3d t1, t2;
  tangents(n, t1, t2);
  return center + radius_m * on_unit_disc(u, v, t1, t2);
}

/// A flat round emitter with a cosine law (Lambert 1760). It radiates to `normal`.
struct DiscEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d normal{0.0, 0.0, 1.0};  ///< unit
  double radius_m = 0.5e-3;
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return normal; }
  Vec3d point(double u, double v) const { return on_disc(center, normal, radius_m, u, v); }
  Polar polar(double u) const { return {std::sqrt(u), std::sqrt(1.0 - u)}; }
  double intensity(double cosine) const { return cosine > 0.0 ? power_W / pi * cosine : 0.0; }
  double area_m2() const { return pi * radius_m * radius_m; }
  bool covers(const Vec3d& p) const { return (p - center).squaredNorm() <= radius_m * radius_m; }
  DiscEmitter mirrored(const Vec3d& m) const {
    return {m.cwiseProduct(center), m.cwiseProduct(normal), radius_m, power_W, channel};
  }
};

inline void validate(const DiscEmitter& e) { require_positive("radius of a disc emitter", e.radius_m, "m"); }

static_assert(EmitterModel<DiscEmitter>);

/// A point that radiates alike in all directions. It must lie inside the medium: of a point on its surface half the
/// light starts out of it.
struct PointEmitter {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return Vec3d::UnitZ(); }
  Vec3d point(double, double) const { return center; }
  Polar polar(double u) const { return {2.0 * std::sqrt(u * (1.0 - u)), 1.0 - 2.0 * u}; }
  double intensity(double) const { return power_W / (4.0 * pi); }
  PointEmitter mirrored(const Vec3d& m) const { return {m.cwiseProduct(center), power_W, channel}; }
};

static_assert(EmitterModel<PointEmitter>);

}  // namespace lumo
