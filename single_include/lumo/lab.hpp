// lumo/lab.hpp in one file; made by single_include/generate, not to be edited. Needs C++20 and Eigen.
//
// MIT License
//
// Copyright (c) 2026 the lumo authors
//
// Permission is hereby granted, free of charge, to any person obtaining a copy
// of this software and associated documentation files (the "Software"), to deal
// in the Software without restriction, including without limitation the rights
// to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
// copies of the Software, and to permit persons to whom the Software is
// furnished to do so, subject to the following conditions:
//
// The above copyright notice and this permission notice shall be included in all
// copies or substantial portions of the Software.
//
// THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
// IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
// FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
// AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
// LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
// OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
// SOFTWARE.

#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <complex>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <istream>
#include <iterator>
#include <limits>
#include <locale>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <optional>
#include <queue>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <thread>
#include <tuple>
#include <type_traits>
#include <unistd.h>
#include <utility>
#include <variant>
#include <vector>

// ---- lumo/version.hpp
#ifndef SINGLE_INCLUDE_LUMO_VERSION_HPP
#define SINGLE_INCLUDE_LUMO_VERSION_HPP

namespace lumo {

/// Version of this library, by semantic versioning: before 1.0 a new minor version may break its users, a new patch
/// does not. These three numbers are the only place where it stands; CMake and pkg-config read them here.
inline constexpr int version_major = 0;
inline constexpr int version_minor = 1;
inline constexpr int version_patch = 0;

}  // namespace lumo

#endif

// ---- lumo/core/error.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_ERROR_HPP
#define SINGLE_INCLUDE_LUMO_CORE_ERROR_HPP

namespace lumo {

/// Base of everything that lumo throws. The text is one line: what, value, limit, unit.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The caller broke a contract: an argument out of its range, not finite, or of the wrong shape.
class InvalidArgument : public Error {
 public:
  using Error::Error;
};

/// A design outside its space; names the broken constraint and by how much it is broken.
class InfeasibleDesign : public Error {
 public:
  InfeasibleDesign(std::string constraint, double value, double limit, std::string unit, const std::string& text)
      : Error(text), constraint_(std::move(constraint)), value_(value), limit_(limit), unit_(std::move(unit)) {}

  const std::string& constraint() const { return constraint_; }
  double value() const { return value_; }
  double limit() const { return limit_; }
  const std::string& unit() const { return unit_; }
  /// How far beyond the limit, in `unit()`; NaN if the value is not a number.
  double excess() const { return std::abs(value_ - limit_); }

 private:
  std::string constraint_;
  double value_;
  double limit_;
  std::string unit_;
};

/// The input was sound, and yet there is no result.
class NumericalError : public Error {
 public:
  using Error::Error;
};

/// A surface that cannot be meshed, or a mesh that fails a quality gate.
class MeshError : public NumericalError {
 public:
  enum class Reason {
    not_finite,         ///< a coordinate is NaN, infinite or absurdly large
    bad_index,          ///< a facet names a vertex that is not there
    degenerate,         ///< a facet without area, or a body without volume
    duplicate,          ///< two vertices at one place
    open,               ///< an edge without a partner
    not_manifold,       ///< an edge with more than two facets, or facets of opposite orientation
    self_intersecting,  ///< facets that cross
    crashed,            ///< the mesher died
    timed_out,          ///< the mesher ran out of time
    out_of_memory,      ///< the mesher ran out of memory
    inverted,           ///< an element whose Jacobian is not positive everywhere
    inaccurate,         ///< the mesh's volume or surface is not the body's
    asymmetric          ///< not its own mirror image where it claims to be
  };
  MeshError(Reason reason, const std::string& text) : NumericalError(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// A press found no equilibrium where one is needed to go on.
class PressFailure : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// A file or stream that cannot be read or written, or whose contents are not valid.
class InputError : public Error {
 public:
  using Error::Error;
};

/// The shortest spelling that reads back as the same number: a message must not round a value onto the limit that it
/// breaks. NaN has no sign.
inline std::string exact(double value) {
  if (std::isnan(value)) return "nan";
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, value).ptr};
}

/// Foreign text as a message may show it: at most `most` characters, '?' for what is not ASCII.
inline std::string printable(std::string_view s, std::size_t most = 40) {
  std::string p;
  for (const char c : s.substr(0, most)) p += c >= ' ' && c <= '~' ? c : '?';
  return p + (s.size() > most ? "..." : "");
}

/// Joins its arguments into one line of text, the same under every locale: it also becomes SQL and files.
template <class... Args> std::string message(const Args&... args) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(10);
  (out << ... << args);
  return out.str();
}

/// Throws InvalidArgument unless `value` is finite and lies in [low, high].
inline void require_in_range(const char* what, double value, double low, double high, const char* unit) {
  if (std::isfinite(value) && value >= low && value <= high) return;
  throw InvalidArgument(message(what, " is ", exact(value), " ", unit, ", must lie in [", low, ", ", high, "] ", unit));
}

/// What a quantity may be, ends included.
struct Limits {
  double low, high;
};

inline void require_in_range(const char* what, double value, const Limits& limits, const char* unit) {
  require_in_range(what, value, limits.low, limits.high, unit);
}

/// Throws InvalidArgument unless `value` is finite.
inline void require_finite(const char* what, double value, const char* unit) {
  if (std::isfinite(value)) return;
  throw InvalidArgument(message(what, " is ", exact(value), " ", unit, ", must be finite"));
}

/// Throws InvalidArgument unless `value` is finite and positive.
inline void require_positive(const char* what, double value, const char* unit) {
  if (std::isfinite(value) && value > 0.0) return;
  throw InvalidArgument(message(what, " is ", value, " ", unit, ", must be finite and > 0 ", unit));
}

/// The parts of a list with commas between them; `text(part)` is what stands for one.
template <class List, class Text> std::string listing(const List& list, Text&& text) {
  std::string all;
  for (const auto& part : list) all += (all.empty() ? "" : ", ") + std::string(text(part));
  return all;
}

}  // namespace lumo

#endif

// ---- lumo/core/units.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_UNITS_HPP
#define SINGLE_INCLUDE_LUMO_CORE_UNITS_HPP

namespace lumo {

/// Literals that turn the field's units into SI: `5.0_mm`, `106.0_kPa`, `3.1_dB_per_cm`.
inline namespace literals {

constexpr double operator""_m(long double v) { return double(v); }
constexpr double operator""_mm(long double v) { return double(v * 1e-3L); }
constexpr double operator""_um(long double v) { return double(v * 1e-6L); }
constexpr double operator""_N(long double v) { return double(v); }
constexpr double operator""_Pa(long double v) { return double(v); }
constexpr double operator""_kPa(long double v) { return double(v * 1e3L); }
constexpr double operator""_MPa(long double v) { return double(v * 1e6L); }
constexpr double operator""_W(long double v) { return double(v); }
constexpr double operator""_kg_per_m3(long double v) { return double(v); }
constexpr double operator""_N_per_m3(long double v) { return double(v); }
constexpr double operator""_deg(long double v) { return double(v * 3.14159265358979323846264338327950288L / 180.0L); }
constexpr double operator""_per_m(long double v) { return double(v); }
/// Power attenuation: 10 dB are a factor of ten, so 1 dB/cm = 100 ln(10)/10 per metre.
constexpr double operator""_dB_per_cm(long double v) { return double(v * 23.0258509299404568401799145468436421L); }

}  // namespace literals

inline constexpr double pi = 3.14159265358979323846;

}  // namespace lumo

#endif

// ---- lumo/core/types.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_TYPES_HPP
#define SINGLE_INCLUDE_LUMO_CORE_TYPES_HPP

namespace lumo {

/// A small matrix of fixed size: Eigen's, with sums and products that are computed at once instead of expressions.
/// Their order of summation is fixed, whatever the processor's vectors, so results do not depend on them; and a
/// compiler makes no type for each formula. An operand that is an expression of Eigen's (a block, a transpose) takes
/// Eigen's own operators.
template <class S, int Rows, int Cols> class SmallMatrix : public Eigen::Matrix<S, Rows, Cols> {
 public:
  using Base = Eigen::Matrix<S, Rows, Cols>;
  using Base::Base;
  SmallMatrix() = default;
  template <class E> SmallMatrix& operator=(const Eigen::EigenBase<E>& e) {
    Base::operator=(e.derived());
    return *this;
  }

  SmallMatrix eval() const { return *this; }
  SmallMatrix normalized() const { return Base::normalized(); }
  SmallMatrix cross(const SmallMatrix& b) const requires(Rows == 3 && Cols == 1) { return Base::cross(b); }
};

template <class S> using Vec3 = SmallMatrix<S, 3, 1>;
template <class S> using Mat3 = SmallMatrix<S, 3, 3>;
/// Derivative of a 3 × 3 tensor by another, both flattened column by column: row i + 3 j, column k + 3 l.
template <class S> using Mat9 = SmallMatrix<S, 9, 9>;

using Vec3d = Vec3<double>;
using Mat3d = Mat3<double>;
using Mat9d = Mat9<double>;

/// What may scale a matrix of scalars S.
template <class F, class S>
concept ScaleOf = std::same_as<F, S> || std::is_arithmetic_v<F>;

template <class S, int R, int C>
SmallMatrix<S, R, C> operator+(const SmallMatrix<S, R, C>& a, const SmallMatrix<S, R, C>& b) {
  SmallMatrix<S, R, C> sum;
  for (int k = 0; k < R * C; ++k) sum.data()[k] = a.data()[k] + b.data()[k];
  return sum;
}

template <class S, int R, int C>
SmallMatrix<S, R, C> operator-(const SmallMatrix<S, R, C>& a, const SmallMatrix<S, R, C>& b) {
  SmallMatrix<S, R, C> difference;
  for (int k = 0; k < R * C; ++k) difference.data()[k] = a.data()[k] - b.data()[k];
  return difference;
}

template <class S, int R, int C> SmallMatrix<S, R, C> operator-(const SmallMatrix<S, R, C>& a) {
  SmallMatrix<S, R, C> opposite;
  for (int k = 0; k < R * C; ++k) opposite.data()[k] = -a.data()[k];
  return opposite;
}

template <class S, int R, int C, ScaleOf<S> F>
SmallMatrix<S, R, C> operator*(const SmallMatrix<S, R, C>& a, const F& factor) {
  SmallMatrix<S, R, C> product;
  for (int k = 0; k < R * C; ++k) product.data()[k] = a.data()[k] * S(factor);
  return product;
}

template <class S, int R, int C, ScaleOf<S> F>
SmallMatrix<S, R, C> operator*(const F& factor, const SmallMatrix<S, R, C>& a) {
  return a * factor;
}

template <class S, int R, int C, ScaleOf<S> F>
SmallMatrix<S, R, C> operator/(const SmallMatrix<S, R, C>& a, const F& divisor) {
  SmallMatrix<S, R, C> quotient;
  for (int k = 0; k < R * C; ++k) quotient.data()[k] = a.data()[k] / S(divisor);
  return quotient;
}

template <class S, int C> SmallMatrix<S, 3, C> operator*(const Mat3<S>& a, const SmallMatrix<S, 3, C>& b) {
  SmallMatrix<S, 3, C> product;
  for (int j = 0; j < C; ++j)
    for (int i = 0; i < 3; ++i)
      product.data()[i + 3 * j] =
          a.data()[i] * b.data()[3 * j] + a.data()[i + 3] * b.data()[1 + 3 * j] + a.data()[i + 6] * b.data()[2 + 3 * j];
  return product;
}

/// a bᵀ.
template <class S, class B>
requires std::same_as<std::remove_const_t<B>, Eigen::Matrix<S, 3, 1>> Mat3<S>
operator*(const Vec3<S>& a, const Eigen::Transpose<B>& b) {
  Mat3<S> dyad;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) dyad.data()[i + 3 * j] = a.data()[i] * b.nestedExpression().data()[j];
  return dyad;
}

template <class S> Vec3<S> elementwise_min(const Vec3<S>& a, const Vec3<S>& b) {
  return {std::min(a.x(), b.x()), std::min(a.y(), b.y()), std::min(a.z(), b.z())};
}
template <class S> Vec3<S> elementwise_max(const Vec3<S>& a, const Vec3<S>& b) {
  return {std::max(a.x(), b.x()), std::max(a.y(), b.y()), std::max(a.z(), b.z())};
}

/// Two unit tangents that make a right-handed frame with the unit vector `n` (after Duff et al., JCGT 6(1), 2017).
template <class S> void tangents(const Vec3<S>& n, Vec3<S>& t1, Vec3<S>& t2) {
  const double sign =
      n.z() < -0.6180339887 ? -1.0 : 1.0;  // not at 0: walls are upright, and rounding must not turn their frames
  const S a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  t1 = {1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  t2 = {b, sign + n.y() * n.y() * a, -n.y()};
}

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo

#endif

// ---- lumo/lab/rig.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_RIG_HPP
#define SINGLE_INCLUDE_LUMO_LAB_RIG_HPP

namespace lumo {

// Every number of the virtual rig, with its source or the word "assumed" (docs/virtual_lab.md explains each). They were
// fixed before any decoder, localiser or force estimator ran on a log of the lab. The lab's `noise` multiplies all that
// is marked σ.

/// The camera, about an Intel RealSense D435's colour sensor at 640 × 480, of which a window about the finger is
/// recorded. The picture is its green plane.
struct CameraRig {
  int width = 192, height = 80;    ///< of the window [px]
  double focal_px = 616.0;         ///< 1386 px at 1920 × 1080 (FOV 69.4°, FRAMOS D435e manual), 1080 rows made 480
  double distance_m = 0.25;        ///< from the facing side; assumed, 0.41 mm/px
  double aim_sigma_rad = 1.5_deg;  ///< σ of yaw, pitch and roll of one placing by hand; assumed
  double aim_sigma_m = 1.0_mm;     ///< σ of the place along y and z; assumed
  double frames_per_s = 30.0;
  double exposure_s = 1.0e-3;   ///< device setting 10 (paper), 100 µs each (librealsense #8243)
  double gain = 64.0;           ///< device setting (paper)
  double level_DN = 70.0;       ///< of the unloaded side, mean over |y| ≤ 25 mm; assumed
  double brightest_DN = 220.0;  ///< of a loaded side: where it would be more, the exposure is shorter; assumed
  /// Light of a bin [DN] per emitted power: one exposure for all pads (paper). 0: each pad is exposed by itself, for
  /// `level_DN`.
  double exposure_DN = 0.0;
  double gamma = 1.0;     ///< DN = 255 (linear/255)^(1/gamma); 1: linear, assumed
  double black_DN = 2.0;  ///< assumed
  double full_DN = 255.0;
  double shot_DN = 0.03;  ///< σ² per DN of signal: SNR 36 dB at 128 DN (EMVA 1288 model; level from memory: assumed), σ
  double read_DN = 0.6;           ///< σ, assumed
  double row_DN = 0.35;           ///< σ of a row's offset, one frame; 0.3–0.5 (memory: assumed)
  double pixel_gain = 0.01;       ///< σ of fixed sensitivities, PRNU about 1 % (memory: assumed)
  double blur_px = 0.8;           ///< standard deviation of the lens's point spread; assumed
  double stamp_sigma_s = 0.2e-3;  ///< σ of a stamp; assumed
};

/// The finger's lamps and the room's.
struct LightRig {
  double lamp_drift = 3.0e-3;  ///< σ of the lamps' slow common change; LED drift 0.2 % between contacts, 1–2 % warm-up
                               ///< (memory: assumed)
  double lamp_drift_s = 20.0;   ///< its time
  double lamp_white = 1.0e-3;   ///< σ frame by frame; assumed
  double ambient_DN = 5.0;      ///< mean; assumed
  double ambient_slope = 0.2;   ///< relative, from end to end of the window; assumed
  double ambient_drift = 0.02;  ///< σ relative; assumed
  double ambient_drift_s = 5.0;
  double flicker = 0.1;  ///< σ-like amplitude of 100 Hz (mains) relative to ambient; assumed
  double flicker_hz = 100.0;
  double spot_DN = 80.0;  ///< a LED's package seen through the side, on top of the side's light; assumed (the paper
                          ///< detects five LEDs)
  double spot_sigma_m = 0.7_mm;  ///< half of the package's 1.6 mm, blurred; assumed
  // Off unless asked for.
  double one_lamp_sigma = 0.0;       ///< σ of each LED's slow change by itself, relative
  double one_lamp_drift_s = 60.0;    ///< its time; assumed
  double one_lamp_reach_m = 6.0_mm;  ///< along the finger, over which an LED's share of the light falls to 1/e; assumed
  double shadow = 0.0;               ///< share of the room's light that the tool takes away before it
  double shadow_sigma_m = 12.0_mm;   ///< half width of its shadow; assumed
};

/// The indenter and how well it comes back.
struct ContactRig {
  double place_sigma_m = 0.25_mm;  ///< σ of a re-contact along y; indexed jig 0.2–0.3 mm (memory: assumed)
  /// σ: angle 0.4° and 0.2 mm sideways on a dome of 36 mm radius, 0.3° (memory: assumed)
  double tilt_sigma_rad = 0.5_deg;
  double load_sigma = 0.005;     ///< σ of a hold's load, relative; assumed
  double sensor_sigma_N = 0.05;  ///< σ of one sample of the force sensor (Bota Rokubi, memory: assumed)
  double sensor_bias_N = 0.05;   ///< σ after tare; vendor's test accepts 0.2 N (bota_driver)
  double sensor_hz = 100.0;
  double marker_sigma_m = 0.02_mm;  ///< σ of the followed marker on the indenter; assumed
  double slide_m = 0.0;             ///< way along the finger from the first touch to leaving; a contact slides or rolls
};

/// Linear viscoelasticity: shear relaxation in parts of the instantaneous modulus. Solaris: half of what field notes
/// suggest for Dragon Skin; assumed.
struct SiliconeRig {
  std::array<double, 3> part{0.02, 0.015, 0.015};
  std::array<double, 3> time_s{0.1, 1.0, 10.0};
};

/// How a joint moves without contact: to and fro as a cosine, with a rest after each sweep. Moving shows friction,
/// resting what sticks. Assumed.
struct FreeRunRig {
  double beat_s = 0.75;  ///< of a sweep and its rest
  double sweep_s = 0.5;
  double swing_rad = 0.35;                ///< to both sides
  double rest_velocity_rad_per_s = 0.02;  ///< Coulomb friction turns within about it
};

/// The joints under local position control, with current for torque: one, or a second one alike before it.
struct MotorRig {
  int joints = 1;
  double joint_to_joint_m = 45.0_mm;       ///< from the first of two to the second; assumed
  double joint_to_origin_m = 65.0_mm;      ///< assumed; sets what a fixed arm errs by (paper: 2.72 N)
  double torque_constant_Nm_per_A = 0.35;  ///< gear included; assumed
  /// σ of the constant's relative error, one for each log; 3–5 % uncalibrated (memory: assumed)
  double constant_sigma = 0.02;
  /// σ of what sticks; new when a contact begins or ends, constant in between: set for 1.29 N
  double stiction_Nm = 0.079;
  double white_Nm = 0.0685;  ///< σ of one sample; current noise and ripple: set for 1.29 N
  double coulomb_Nm = 0.02, viscous_Nm_s_per_rad = 0.01;  ///< while it turns; 5–25 mN·m (memory: assumed)
  double weight_Nm = 0.06;                                ///< of the finger, times sin q; assumed
  double bias_Nm = 0.01;                    ///< σ of the current sensor's offset, one for each log; assumed
  double velocity_sigma_rad_per_s = 0.003;  ///< σ; assumed
  double hold_rad = 0.15;                   ///< where it holds; assumed
  double stiffness_Nm_per_rad = 200.0;      ///< of the position control; assumed
  double hz = 250.0;
  FreeRunRig free_run;
  // Off unless asked for.
  double cogging_Nm = 0.0;        ///< amplitude; 2–10 mN·m (memory: assumed)
  double cogging_periods = 10.0;  ///< per turn; 6–14 (memory: assumed)
  double backlash_rad = 0.0;      ///< the encoder turns by this before the finger does; 0.11° (PULSE115-60)
  double clock_offset_s = 0.0;    ///< of the joints' stamps, which the session does not state
};

/// How the pad at hand differs from the computed one.
struct SpecimenRig {
  double stiffness = 1.0;  ///< of its silicone, relative: it deforms as the computed pad does under the load over this
  double lamps = 1.0;      ///< power of its LEDs, relative

  /// Largest load that it can be given where the computed pad knows loads up to `computed_N`: a softer one deforms
  /// more.
  double bears_N(double computed_N) const { return std::min(1.0, stiffness) * computed_N; }
};

/// How far a finger is from its drawing, drawn once for a log; its session states the drawing. All 0: as drawn.
struct AssemblyRig {
  double pad_sigma_m = 0.0;       ///< σ: silicone glued off along the finger, by which its ends move
  double strip_sigma_m = 0.0;     ///< σ: LEDs off along the finger
  double distance_sigma = 0.0;    ///< σ of the camera's distance, relative
  double distortion_sigma = 0.0;  ///< σ of the lens's radial distortion, of a ray at 45°: tan becomes tan (1 + k tan²)
  double end_near_m = 5.0_mm, end_far_m = 15.0_mm;  ///< from an end: a contact's light moves with it wholly, not at all
};

/// All of it.
struct Rig {
  SpecimenRig specimen;
  AssemblyRig assembly;
  CameraRig camera;
  LightRig light;
  ContactRig contact;
  SiliconeRig silicone;
  MotorRig motor;
};

/// What a pixel gives for the light on it [DN before gamma]: shot and read noise (`normal`, a standard normal number,
/// times `noise`), the row's offset, black level, full well, gamma, 8 bits (EMVA 1288's linear model).
inline std::uint8_t sensed(const CameraRig& camera, double signal, double noise, double normal, double row_offset) {
  signal = std::max(signal, 0.0);
  signal += noise * std::sqrt(camera.shot_DN * signal + camera.read_DN * camera.read_DN) * normal + row_offset;
  double value = std::clamp(signal + camera.black_DN, 0.0, camera.full_DN);
  const double inverse_gamma = 1.0 / camera.gamma;
  if (inverse_gamma != 1.0) value = camera.full_DN * std::pow(value / camera.full_DN, inverse_gamma);
  return std::uint8_t(std::lround(value));
}

/// The lab's clock.
inline std::int64_t lab_stamp(double t_s) { return std::llround(1e9 * t_s); }

/// Throws InvalidArgument for numbers out of range.
inline void validate(const Rig& r) {
  require_in_range("stiffness of the specimen", r.specimen.stiffness, 0.5, 2.0, "times the computed pad's");
  require_in_range("power of the specimen's LEDs", r.specimen.lamps, 0.1, 3.0, "times the computed pad's");
  require_in_range("width of the camera's window", r.camera.width, 32, 4096, "px");
  require_in_range("height of the camera's window", r.camera.height, 32, 4096, "px");
  require_positive("focal length", r.camera.focal_px, "px");
  require_in_range("distance of the camera", r.camera.distance_m, 0.05, 10.0, "m");
  require_in_range("frame rate", r.camera.frames_per_s, 1.0, 1000.0, "1/s");
  require_in_range("gamma", r.camera.gamma, 0.2, 5.0, "");
  require_in_range("level of the unloaded side", r.camera.level_DN, 1.0, 250.0, "DN");
  require_in_range("level of the brightest side", r.camera.brightest_DN, 1.0, 1e6, "DN");
  require_in_range("exposure for all pads", r.camera.exposure_DN, 0.0, 1e12, "DN per emitted power");
  require_in_range("glue of the pad", 1e3 * r.assembly.pad_sigma_m, 0.0, 10.0, "mm");
  require_in_range("glue of the LED strip", 1e3 * r.assembly.strip_sigma_m, 0.0, 10.0, "mm");
  require_in_range("error of the camera's distance", r.assembly.distance_sigma, 0.0, 0.1, "");
  require_in_range("distortion of the lens", r.assembly.distortion_sigma, 0.0, 1.0, "");
  require_in_range("change of one LED", r.light.one_lamp_sigma, 0.0, 0.3, "");
  require_in_range("shadow of the tool", r.light.shadow, 0.0, 1.0, "of the room's light");
  require_in_range("way that a contact slides", 1e3 * r.contact.slide_m, -20.0, 20.0, "mm");
  require_in_range("cogging", 1e3 * r.motor.cogging_Nm, 0.0, 1000.0, "mN·m");
  require_in_range("backlash", r.motor.backlash_rad, 0.0, 0.2, "rad");
  require_in_range("offset of the joints' clock", r.motor.clock_offset_s, -1.0, 1.0, "s");
  require_in_range("number of the rig's joints", r.motor.joints, 1, 2, "");
  require_in_range("way from joint to joint", 1e3 * r.motor.joint_to_joint_m, 1.0, 1000.0, "mm");
  require_in_range("rate of the joint samples", r.motor.hz, 10.0, 10000.0, "1/s");
  require_in_range("rate of the force sensor", r.contact.sensor_hz, 1.0, 10000.0, "1/s");
  require_positive("torque constant", r.motor.torque_constant_Nm_per_A, "N·m/A");
  require_positive("stiffness of the position control", r.motor.stiffness_Nm_per_rad, "N·m/rad");
  double sum = 0.0;
  for (std::size_t k = 0; k < r.silicone.part.size(); ++k) {
    require_in_range("part of the relaxation", r.silicone.part[k], 0.0, 0.9, "");
    require_positive("relaxation time", r.silicone.time_s[k], "s");
    sum += r.silicone.part[k];
  }
  require_in_range("sum of the relaxing parts", sum, 0.0, 0.9, "");
}

/// What load would, in equilibrium, give the deformation that a pad has now: it lags behind the load on it (Prony
/// series; generalised Maxwell body). With the equilibrium modulus for unit, load = e + Σ w_k h_k, where h_k' = e' −
/// h_k/τ_k and w_k = part_k/(1 − Σ part).
class Relaxation {
 public:
  explicit Relaxation(const SiliconeRig& rig) : time_s_(rig.time_s) {
    double rest = 1.0;
    for (const double g : rig.part) rest -= g;
    for (std::size_t k = 0; k < weight_.size(); ++k) weight_[k] = rig.part[k] / rest;
  }

  /// Goes on by `dt_s` to the load [N] that is then there; e changes linearly within the step, for which the branches
  /// are exact. Returns e, never below 0.
  double step(double load_N, double dt_s) {
    double lag = 0.0, whole = 1.0;
    std::array<double, 3> keep{}, gain{};
    for (std::size_t k = 0; k < weight_.size(); ++k) {
      keep[k] = std::exp(-dt_s / time_s_[k]);
      gain[k] = (1.0 - keep[k]) * time_s_[k] / dt_s;
      lag += weight_[k] * (keep[k] * branch_[k] - gain[k] * equivalent_N_);
      whole += weight_[k] * gain[k];
    }
    const double next = std::max(0.0, (load_N - lag) / whole);
    for (std::size_t k = 0; k < weight_.size(); ++k)
      branch_[k] = keep[k] * branch_[k] + gain[k] * (next - equivalent_N_);
    return equivalent_N_ = next;
  }
  double equivalent_N() const { return equivalent_N_; }

 private:
  std::array<double, 3> time_s_, weight_{}, branch_{};
  double equivalent_N_ = 0.0;
};

}  // namespace lumo

#endif

// ---- lumo/lab/pad_responses.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_PAD_RESPONSES_HPP
#define SINGLE_INCLUDE_LUMO_LAB_PAD_RESPONSES_HPP

namespace lumo {

/// What one indenter does to the light at one side of a pad, computed at places along it and at loads. Powers are per
/// emitted power; of one side, with both sides' numbers used. Places that begin at 0 are of a pad with equal ends:
/// those below are mirror images.
struct PadResponses {
  std::vector<double> theta_mm;  ///< design
  std::string material;
  double diameter_m = 0.0;              ///< of the sphere
  Eigen::VectorXd position_m;           ///< middles of the bins, ascending, symmetric about 0
  Eigen::VectorXd unloaded;             ///< power through each bin
  Eigen::VectorXd place_m;              ///< ascending, from 0 or from one below it
  Eigen::VectorXd load_N;               ///< ascending, > 0
  Eigen::MatrixXd depth_m;              ///< loads × places
  std::vector<Eigen::MatrixXd> change;  ///< by place: bins × loads
  Eigen::VectorXd tilt_place_m;         ///< places at which a tilted approach was computed, ascending
  std::vector<Eigen::MatrixXd>
      tilt;  ///< by tilt place: odd part of the change on the side x > 0 per radian of approach angle, bins × loads
  Eigen::VectorXd error;  ///< by load: RMS standard error of a bin's change, from the tracer's replicates

  bool equal_ends() const { return place_m.size() > 0 && place_m[0] == 0.0; }
};

/// Throws InputError, with `name` before it, where the parts do not fit together or are not finite.
inline void validate(const PadResponses& r, const std::string& name) {
  const auto require = [&](bool good, const char* what) {
    if (!good) throw InputError(message(name, ": responses of a pad: ", what));
  };
  const Eigen::Index bins = r.position_m.size(), loads = r.load_N.size(), places = r.place_m.size(),
                     tilts = r.tilt_place_m.size();
  const auto ascend = [](const Eigen::VectorXd& v) { return std::is_sorted(v.begin(), v.end(), std::less_equal<>()); };
  require(bins >= 3 && r.unloaded.size() == bins && ascend(r.position_m),
      "there must be at least 3 bins, ascending, with unloaded power each");
  const Eigen::VectorXd& position_m = r.position_m;
  require((position_m + position_m.reverse()).cwiseAbs().maxCoeff() < 1e-9, "bins must be symmetric about y = 0");
  require(loads >= 2 && ascend(r.load_N) && r.load_N[0] > 0.0 && r.error.size() == loads,
      "there must be at least 2 loads, ascending");
  require(places >= 2 && ascend(r.place_m) && Eigen::Index(r.change.size()) == places && r.place_m[0] <= 0.0 &&
              r.place_m[places - 1] > 0.0,
      "there must be at least 2 places, ascending from 0 or from one below it to one above");
  require(tilts >= 1 && ascend(r.tilt_place_m) && Eigen::Index(r.tilt.size()) == tilts,
      "there must be a tilted approach at least at one place");
  require(
      r.depth_m.rows() == loads && r.depth_m.cols() == places && r.depth_m.allFinite() && r.depth_m.minCoeff() > 0.0,
      "a depth is missing or not positive");
  require(r.unloaded.allFinite() && r.unloaded.minCoeff() >= 0.0 && r.unloaded.sum() > 0.0,
      "unloaded power must be finite and not negative");
  for (const auto* list : {&r.change, &r.tilt})
    for (const Eigen::MatrixXd& m : *list)
      require(m.rows() == bins && m.cols() == loads && m.allFinite(), "a response is missing or not finite");
}

/// The responses in between: linear from place to place, monotone cubic (Fritsch & Butland 1984) from load to load,
/// starting at 0 N.
class PadLight {
 public:
  /// Throws InputError for responses that do not fit together.
  explicit PadLight(PadResponses responses) : r_(std::move(responses)) {
    validate(r_, "responses");
    for (const Eigen::MatrixXd& m : r_.change) slope_.push_back(slopes(m));
    for (const Eigen::MatrixXd& m : r_.tilt) tilt_slope_.push_back(slopes(m));
    depth_slope_ = slopes(r_.depth_m.transpose());
  }

  const PadResponses& responses() const { return r_; }
  /// The first and the last place.
  std::pair<double, double> reach_m() const {
    const double last = r_.place_m[r_.place_m.size() - 1];
    return {r_.equal_ends() ? -last : r_.place_m[0], last};
  }
  /// Throws InvalidArgument for a place beyond them; `what` names it.
  void require_reached(const char* what, double y_m) const {
    const auto [from, to] = reach_m();
    require_in_range(what, 1e3 * y_m, 1e3 * from, 1e3 * to, "mm");
  }
  /// Where light was computed, mirror images included.
  std::vector<double> places_m() const {
    std::vector<double> all(r_.place_m.begin(), r_.place_m.end());
    if (r_.equal_ends())
      for (const double y : r_.place_m)
        if (y > 0.0) all.insert(all.begin(), -y);
    return all;
  }
  double max_load_N() const { return r_.load_N[r_.load_N.size() - 1]; }
  /// Factor on the light for a mean of `level` on the unloaded side over |y| ≤ 25 mm, or less, so that no bin is above
  /// `brightest` under the last load: as who sets a camera's exposure.
  double scale_to(double level, double brightest) const {
    double sum = 0.0, most = 0.0;
    int bins = 0;
    for (Eigen::Index b = 0; b < r_.position_m.size(); ++b)
      if (std::abs(r_.position_m[b]) <= 25e-3) {
        sum += r_.unloaded[b];
        ++bins;
      }
    for (const Eigen::MatrixXd& change : r_.change)
      most = std::max(most, (r_.unloaded + change.rightCols<1>()).maxCoeff());
    return std::min(level * bins / sum, brightest / std::max(most, 1e-300));
  }
  /// Light of a bin [DN] per emitted power in a camera's pictures.
  double exposure(const CameraRig& camera) const {
    return camera.exposure_DN > 0.0 ? camera.exposure_DN : scale_to(camera.level_DN, camera.brightest_DN);
  }

  /// Change of the power through each bin of the side x > 0 under a contact at y. Places and loads beyond those
  /// computed count as the last ones. The odd part of a tilt is that of the nearest tilt places, moved with the
  /// contact.
  Eigen::VectorXd change(double y_m, double load_N, double tilt_rad = 0.0) const {
    const double place = computed(y_m);
    const auto [k, t] = between(r_.place_m, place);
    Eigen::VectorXd v = (1.0 - t) * at_load(r_.change[k], slope_[k], load_N);
    if (t > 0.0) v += t * at_load(r_.change[k + 1], slope_[k + 1], load_N);
    if (tilt_rad != 0.0) {
      const auto [i, s] = between(r_.tilt_place_m, place);
      add_moved(v, tilt_rad * (1.0 - s), at_load(r_.tilt[i], tilt_slope_[i], load_N),
          place - r_.tilt_place_m[Eigen::Index(i)]);
      if (s > 0.0)
        add_moved(v, tilt_rad * s, at_load(r_.tilt[i + 1], tilt_slope_[i + 1], load_N),
            place - r_.tilt_place_m[Eigen::Index(i) + 1]);
    }
    return place == y_m ? v : Eigen::VectorXd(v.reverse());
  }
  /// `light` of all bins moved along the finger, linear between bins; the end values stay beyond the ends.
  Eigen::VectorXd moved(const Eigen::VectorXd& light, double by_m) const {
    const double width = r_.position_m[1] - r_.position_m[0];
    const Eigen::Index last = light.size() - 1;
    Eigen::VectorXd v(light.size());
    for (Eigen::Index i = 0; i <= last; ++i) {
      const double at = std::clamp(double(i) - by_m / width, 0.0, double(last));
      const auto k = std::min(Eigen::Index(at), last - 1);
      v[i] = light[k] + (at - double(k)) * (light[k + 1] - light[k]);
    }
    return v;
  }
  double depth_m(double y_m, double load_N) const {
    const auto [k, t] = between(r_.place_m, computed(y_m));
    const Eigen::VectorXd all = at_load(r_.depth_m.transpose(), depth_slope_, load_N);
    return (1.0 - t) * all[Eigen::Index(k)] + (t > 0.0 ? t * all[Eigen::Index(k) + 1] : 0.0);
  }
  /// Load that gives a depth, the inverse of the above; beyond the last load with the last slope, 0 for none.
  double load_N(double y_m, double depth_m) const {
    const double most = max_load_N(), end = this->depth_m(y_m, most);
    if (!(depth_m > 0.0)) return 0.0;
    if (depth_m >= end) return most + (depth_m - end) * 0.05 * most / (end - this->depth_m(y_m, 0.95 * most));
    double low = 0.0, high = most;
    for (int k = 0; k < 50; ++k) {
      const double middle = 0.5 * (low + high);
      (this->depth_m(y_m, middle) < depth_m ? low : high) = middle;
    }
    return 0.5 * (low + high);
  }

 private:
  /// A place, or its mirror image, for which there are responses.
  double computed(double y_m) const { return r_.equal_ends() ? std::abs(y_m) : y_m; }

  /// Interval of ascending `x` and the share of it; clamped.
  static std::pair<std::size_t, double> between(const Eigen::VectorXd& x, double at) {
    if (x.size() == 1 || at <= x[0]) return {0, 0.0};
    const Eigen::Index last = x.size() - 1;
    if (at >= x[last]) return {std::size_t(last), 0.0};
    const auto k = Eigen::Index(std::upper_bound(x.begin(), x.end(), at) - x.begin()) - 1;
    return {std::size_t(k), (at - x[k]) / (x[k + 1] - x[k])};
  }

  double load(Eigen::Index k) const { return k == 0 ? 0.0 : r_.load_N[k - 1]; }

  /// Derivatives over the load of rows that are 0 at 0 N; columns 0 N and all loads.
  Eigen::MatrixXd slopes(const Eigen::MatrixXd& value) const {
    const Eigen::Index n = value.cols();
    Eigen::MatrixXd secant(value.rows(), n), slope(value.rows(), n + 1);
    for (Eigen::Index k = 0; k < n; ++k)
      secant.col(k) = (value.col(k) - (k ? Eigen::VectorXd(value.col(k - 1)) : Eigen::VectorXd::Zero(value.rows()))) /
                      (load(k + 1) - load(k));
    slope.col(0) = secant.col(0);
    slope.col(n) = secant.col(n - 1);
    for (Eigen::Index k = 1; k < n; ++k) {
      const double a = load(k) - load(k - 1), b = load(k + 1) - load(k), wa = (a + 2.0 * b) / (3.0 * (a + b));
      for (Eigen::Index i = 0; i < value.rows(); ++i) {
        const double left = secant(i, k - 1), right = secant(i, k);
        slope(i, k) = left * right > 0.0 ? left * right / (wa * right + (1.0 - wa) * left) : 0.0;
      }
    }
    return slope;
  }
  Eigen::VectorXd at_load(const Eigen::MatrixXd& value, const Eigen::MatrixXd& slope, double at) const {
    const Eigen::Index n = value.cols();
    if (!(at > 0.0)) return Eigen::VectorXd::Zero(value.rows());
    if (at >= load(n)) return value.col(n - 1);
    Eigen::Index k = 0;
    while (at >= load(k + 1)) ++k;
    const double h = load(k + 1) - load(k), t = (at - load(k)) / h, u = 1.0 - t;
    Eigen::VectorXd v =
        (t * t * (1.0 + 2.0 * u)) * value.col(k) + (h * t * u * u) * slope.col(k) - (h * t * t * u) * slope.col(k + 1);
    if (k > 0) v += (u * u * (1.0 + 2.0 * t)) * value.col(k - 1);
    return v;
  }
  /// v += share · f(y − shift), f linear between bins and 0 beyond.
  void add_moved(Eigen::VectorXd& v, double share, const Eigen::VectorXd& f, double shift_m) const {
    const double width = r_.position_m[1] - r_.position_m[0];
    const Eigen::Index n = v.size();
    for (Eigen::Index i = 0; i < n; ++i) {
      const double at = double(i) - shift_m / width, whole = std::floor(at);
      const auto k = Eigen::Index(whole);
      const double t = at - whole;
      v[i] += share * ((k >= 0 && k < n ? (1.0 - t) * f[k] : 0.0) + (k + 1 >= 0 && k + 1 < n ? t * f[k + 1] : 0.0));
    }
  }

  PadResponses r_;
  std::vector<Eigen::MatrixXd> slope_, tilt_slope_;
  Eigen::MatrixXd depth_slope_;
};

}  // namespace lumo

#endif

// ---- lumo/core/sobol.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_SOBOL_HPP
#define SINGLE_INCLUDE_LUMO_CORE_SOBOL_HPP

namespace lumo {

/// Mixes 64 bits; a bijection (Steele, Lea & Flood, "Fast Splittable Pseudorandom Number Generators", 2014).
constexpr std::uint64_t mix64(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

/// A key for the pair (key, label): counter-based, so that no draw depends on how many came before it.
constexpr std::uint64_t combine(std::uint64_t key, std::uint64_t label) {
  return mix64(key + 0x9e3779b97f4a7c15ull * (label + 1));
}

/// A number in (0, 1) from a key.
constexpr double uniform(std::uint64_t key) { return (double(key >> 11) + 0.5) * 0x1p-53; }

/// By ratio, of `wish` ≤ 2²⁴; counts of points that fill evenly. 1 for less than 1.
inline std::uint32_t nearest_power_of_two(double wish) {
  return std::max(1u, std::bit_floor(std::uint32_t(std::min(double(1 << 24), 1.4142 * wish))));
}

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
  x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
  return (x >> 16) | (x << 16);
}

/// Owen's nested uniform scramble by hashing: every bit is flipped by a hash of the higher bits.
/// Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020; the permutation of Laine & Karras (2011)
/// with the constants that Vegdahl found (2021), which are better mixed than the first ones.
constexpr std::uint32_t owen_scramble(std::uint32_t x, std::uint32_t seed) {
  x = reverse_bits(x);
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverse_bits(x);
}

/// Primitive polynomial (degree, inner coefficients) and first direction numbers of one dimension.
struct SobolSeed {
  int degree;
  std::uint32_t polynomial;
  std::array<std::uint32_t, 7> m;
};

/// Dimensions 2 … 32 (the first is van der Corput's). Source: Joe & Kuo, "Constructing Sobol sequences with better
/// two-dimensional projections", SIAM J. Sci. Comput. 30 (2008), set new-joe-kuo-6.
inline constexpr std::array<SobolSeed, 31> sobol_seeds{{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
    {6, 13, {1, 1, 1, 15, 21, 21}},
    {6, 16, {1, 3, 1, 13, 27, 49}},
    {6, 19, {1, 1, 1, 15, 7, 5}},
    {6, 22, {1, 3, 1, 15, 13, 25}},
    {6, 25, {1, 1, 5, 5, 19, 61}},
    {7, 1, {1, 3, 7, 11, 23, 15, 103}},
    {7, 4, {1, 3, 7, 13, 13, 15, 69}},
    {7, 7, {1, 1, 3, 13, 7, 35, 63}},
    {7, 8, {1, 3, 5, 9, 1, 25, 53}},
    {7, 14, {1, 3, 1, 13, 9, 35, 107}},
    {7, 19, {1, 3, 1, 5, 27, 61, 31}},
    {7, 21, {1, 1, 5, 11, 19, 41, 61}},
    {7, 28, {1, 3, 5, 3, 3, 13, 69}},
    {7, 31, {1, 1, 7, 13, 1, 19, 1}},
    {7, 32, {1, 3, 7, 5, 13, 19, 59}},
    {7, 37, {1, 1, 3, 9, 25, 29, 41}},
    {7, 41, {1, 3, 5, 13, 23, 1, 55}},
    {7, 42, {1, 3, 7, 3, 13, 59, 17}},
}};

/// A plain array, which a compiler fills faster than std::array.
struct SobolTable {
  std::uint32_t number[32][32];
};

/// Direction numbers, [dimension][bit]. Source: Bratley & Fox, Algorithm 659, ACM TOMS 14 (1988).
constexpr SobolTable make_sobol_table() {
  SobolTable table{};
  auto& v = table.number;
  for (std::uint32_t k = 0; k < 32; ++k) v[0][k] = 1u << (31 - k);
  for (std::size_t d = 1; d < 32; ++d) {
    const SobolSeed& seed = sobol_seeds[d - 1];
    const std::size_t s = std::size_t(seed.degree);
    for (std::size_t k = 0; k < 32; ++k) {
      if (k < s) {
        v[d][k] = seed.m[k] << (31 - k);
        continue;
      }
      v[d][k] = v[d][k - s] ^ (v[d][k - s] >> s);
      for (std::size_t j = 1; j < s; ++j)
        if ((seed.polynomial >> (s - 1 - j)) & 1u) v[d][k] ^= v[d][k - j];
    }
  }
  return table;
}

/// Made by the compiler, and so only where it is used.
inline constexpr SobolTable sobol_table = make_sobol_table();

/// Sobol's low-discrepancy sequence in up to 32 dimensions, in natural order: the first 2^m points are a digital net.
struct Sobol {
  static constexpr int dimensions = 32;

  /// Coordinate `dimension` of point `index` as a 32-bit binary fraction.
  static std::uint32_t bits(std::uint32_t index, int dimension) {
    std::uint32_t x = 0;
    for (std::size_t k = 0; index != 0; ++k, index >>= 1)
      if (index & 1u) x ^= sobol_table.number[dimension][k];
    return x;
  }
};

/// Sobol's sequence under a random Owen scramble per dimension: every point is uniform on [0, 1)^d, nets stay nets, and
/// different seeds are independent. Law: a pure function of (seed, index, dimension). Own code: libraries' generators
/// keep a state and are not scrambled.
struct OwenSobol {
  std::uint64_t seed = 0;

  /// In (0, 1): the middle of a cell of width 2^−32. Unchecked: dimension in [0, 32).
  double operator()(std::uint32_t index, int dimension) const {
    const std::uint32_t key = std::uint32_t(combine(seed, std::uint64_t(dimension)) >> 32);
    return (double(owen_scramble(Sobol::bits(index, dimension), key)) + 0.5) * 0x1p-32;
  }
};

}  // namespace lumo

#endif

// ---- lumo/lab/random_stream.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_RANDOM_STREAM_HPP
#define SINGLE_INCLUDE_LUMO_LAB_RANDOM_STREAM_HPP

namespace lumo {

/// Random numbers by counting: what is drawn depends on the seed, the stream's number and the count, not on what was
/// drawn elsewhere. The same on every machine up to its mathematical functions' last bit.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t stream) : key_(combine(combine(0x1ab0ull, seed), stream)) {}

  double uniform() { return lumo::uniform(combine(key_, count_++)); }
  /// Standard normal (Box & Muller 1958); each pair of uniforms gives two.
  double normal() {
    if (spare_) return spare_ = false, second_;
    const double r = std::sqrt(-2.0 * std::log(uniform())), a = 2.0 * pi * uniform();
    second_ = r * std::sin(a);
    spare_ = true;
    return r * std::cos(a);
  }

 private:
  std::uint64_t key_, count_ = 0;
  double second_ = 0.0;
  bool spare_ = false;
};

/// First-order Gauss–Markov noise of standard deviation 1.
class SlowNoise {
 public:
  SlowNoise(RandomStream draws, double time_s) : draws_(draws), time_s_(time_s), value_(draws_.normal()) {}
  /// At a time not before the last one.
  double at(double t_s) {
    const double keep = std::exp(-(t_s - t_s_) / time_s_);
    value_ = keep * value_ + std::sqrt(1.0 - keep * keep) * draws_.normal();
    t_s_ = t_s;
    return value_;
  }

 private:
  RandomStream draws_;
  double time_s_, value_, t_s_ = 0.0;
};

/// How much brighter lamps are than their mean, relative: slowly together, and frame by frame; standard deviations as
/// the rig has them. Takes the streams `first` and `first` + 2.
class LampNoise {
 public:
  LampNoise(const LightRig& rig, std::uint64_t seed, std::uint64_t first)
      : drift_(rig.lamp_drift),
        white_(rig.lamp_white),
        slow_(RandomStream(seed, first), rig.lamp_drift_s),
        fast_(seed, first + 2) {}
  double at(double t_s) {
    const double slow = drift_ * slow_.at(t_s);
    return slow + white_ * fast_.normal();
  }

 private:
  double drift_, white_;
  SlowNoise slow_;
  RandomStream fast_;
};

}  // namespace lumo

#endif

// ---- lumo/geometry/closed_surface.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_CLOSED_SURFACE_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_CLOSED_SURFACE_HPP

namespace lumo {

/// A flat polygon of a surface, by vertex numbers, counter-clockwise seen from outside.
struct Facet {
  std::vector<int> loop;
  int patch = -1;  ///< number of the part of the surface that it belongs to; negative: of none
};

/// A closed polyhedral surface.
struct ClosedSurface {
  std::vector<Vec3d> vertices;  ///< [m] or any unit: what reads it is scale-free
  std::vector<Facet> facets;    ///< closed, manifold, counter-clockwise seen from outside
};

}  // namespace lumo

#endif

// ---- lumo/morphology/emitter.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_EMITTER_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_EMITTER_HPP

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

#endif

// ---- lumo/morphology/shape.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_SHAPE_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_SHAPE_HPP

namespace lumo {

/// An exact surface that a patch of a body lies on.
/// Laws: closest_point is idempotent; normal(p) is the outward unit normal at closest_point(p). A `validate(shape)`
/// beside it is called before the shape is used.
template <class S>
concept SurfaceShape = requires(const S& shape, const Vec3d& p) {
  { shape.closest_point(p) } -> std::convertible_to<Vec3d>;
  { shape.normal(p) } -> std::convertible_to<Vec3d>;
};

/// The plane through `point` with outward unit normal `direction`.
struct Plane {
  Vec3d point{0.0, 0.0, 0.0};
  Vec3d direction{0.0, 0.0, 1.0};

  Vec3d closest_point(const Vec3d& p) const { return p - direction.dot(p - point) * direction; }
  Vec3d normal(const Vec3d&) const { return direction; }
};

/// The upper half (z ≥ centre) of the elliptic cylinder along y: ((x−cx)/semi_x)² + ((z−cz)/semi_z)² = 1, lengths in m.
struct EllipticCylinder {
  Vec3d center{0.0, 0.0, 0.0};
  double semi_x = 1.0;
  double semi_z = 1.0;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// Sphere of `radius` [m] about `center`; the body is inside.
struct SphereShape {
  Vec3d center{0.0, 0.0, 0.0};
  double radius = 1.0;

  Vec3d closest_point(const Vec3d& p) const { return center + radius * normal(p); }
  Vec3d normal(const Vec3d& p) const {
    const Vec3d d = p - center;
    const double r = d.norm();
    return r > 0.0 ? Vec3d(d / r) : Vec3d(Vec3d::UnitZ());
  }
};

/// Throws InvalidArgument unless the direction of a surface has length 1, within 1e-6.
inline void require_unit(const char* what, const Vec3d& direction) {
  if (!(std::abs(direction.norm() - 1.0) <= 1e-6))
    throw InvalidArgument(message(what, " has length ", direction.norm(), ", must be 1"));
}

inline void validate(const Plane& plane) { require_unit("direction of a plane", plane.direction); }

/// Any other model of SurfaceShape: a value, cheap to copy.
class OwnShape {
 public:
  template <class S>
  requires(!std::same_as<S, OwnShape> && SurfaceShape<S>) OwnShape(const S& model)
      : model_(std::make_shared<const S>(model)), calls_(&calls<S>) {}

  Vec3d closest_point(const Vec3d& p) const { return calls_->closest_point(model_.get(), p); }
  Vec3d normal(const Vec3d& p) const { return calls_->normal(model_.get(), p); }
  /// What the model's own validate() throws, if it has one.
  void validate() const { calls_->validate(model_.get()); }
  /// Its model, if it is an S.
  template <SurfaceShape S> const S* as() const {
    return calls_ == &calls<S> ? static_cast<const S*>(model_.get()) : nullptr;
  }

 private:
  struct Calls {
    Vec3d (*closest_point)(const void*, const Vec3d&);
    Vec3d (*normal)(const void*, const Vec3d&);
    void (*validate)(const void*);
  };
  template <class S> static const Calls calls;

  std::shared_ptr<const void> model_;
  const Calls* calls_;
};

/// The surface of a patch: any SurfaceShape. Three that bodies have most are called directly, all others through
/// OwnShape.
using Shape = std::variant<Plane, EllipticCylinder, SphereShape, OwnShape>;

inline Vec3d closest_point(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.closest_point(p); }, shape);
}
inline Vec3d outward_normal(const Shape& shape, const Vec3d& p) {
  return std::visit([&](const auto& s) -> Vec3d { return s.normal(p); }, shape);
}

namespace detail {

// What a shape says of its own numbers.
template <class S> void validate_shape(const S& shape) {
  if constexpr (requires { shape.validate(); }) shape.validate();
  else if constexpr (requires { validate(shape); }) validate(shape);
}

}  // namespace detail

/// Throws what the shape's own validate() throws. Not for what could become a Shape: that would ask itself.
template <std::same_as<Shape> S> void validate(const S& shape) {
  std::visit([](const auto& s) { detail::validate_shape(s); }, shape);
}

template <class S> const OwnShape::Calls OwnShape::calls = {
    [](const void* s, const Vec3d& p) -> Vec3d { return static_cast<const S*>(s)->closest_point(p); },
    [](const void* s, const Vec3d& p) -> Vec3d { return static_cast<const S*>(s)->normal(p); },
    [](const void* s) { detail::validate_shape(*static_cast<const S*>(s)); }};

// The foot of the perpendicular on an ellipse, after Eberly, "Distance from a Point to an Ellipse" (2013): the root of
// a convex, falling function; Newton's method from the surface, where most points are, and bisection where a step would
// leave the bracket, so that it converges for every aspect ratio and every point.
inline Vec3d EllipticCylinder::closest_point(const Vec3d& p) const {
  const double px = std::abs(p.x() - center.x());
  const double pz = std::max(0.0, p.z() - center.z());
  const double side = p.x() < center.x() ? -1.0 : 1.0;
  const bool x_major = semi_x >= semi_z;
  const double a = x_major ? semi_x : semi_z, b = x_major ? semi_z : semi_x;
  const double u = x_major ? px : pz, v = x_major ? pz : px;  // along the major and the minor axis
  double fu = 0.0, fv = 0.0;
  if (v > 0.0) {
    if (u > 0.0) {
      const double r = (a / b) * (a / b), e = r - 1.0, zu = r * u / a, zv = v / b;
      double low = zv, high = std::hypot(zu, zv), t = std::clamp(1.0, low, high);  // 1: on the surface
      for (int i = 0; i < 200; ++i) {
        const double x = zu / (t + e), y = zv / t, excess = x * x + y * y - 1.0;
        (excess > 0.0 ? low : high) = t;
        const double step = 0.5 * excess / (x * x / (t + e) + y * y / t), next = t + step;
        const bool close = std::abs(step) <= 1e-9 * t;  // then the error that is left is the square of this
        t = close || (next >= low && next <= high) ? next : 0.5 * (low + high);
        if (close || !(low < high)) break;
      }
      fu = r * u / (t + e);
      fv = v / t;
    } else {
      fv = b;
    }
  } else {
    const double c = a * a - b * b;
    if (a * u < c) {
      fu = a * a * u / c;
      fv = b * std::sqrt(std::max(0.0, 1.0 - (fu / a) * (fu / a)));
    } else {
      fu = a;
    }
  }
  return {center.x() + side * (x_major ? fu : fv), p.y(), center.z() + (x_major ? fv : fu)};
}

inline Vec3d EllipticCylinder::normal(const Vec3d& p) const {
  const Vec3d foot = closest_point(p) - center;
  return Vec3d(foot.x() / (semi_x * semi_x), 0.0, foot.z() / (semi_z * semi_z)).normalized();
}

static_assert(SurfaceShape<Plane> && SurfaceShape<EllipticCylinder> && SurfaceShape<SphereShape>);
static_assert(SurfaceShape<OwnShape> && !SurfaceShape<Shape>);

}  // namespace lumo

#endif

// ---- lumo/morphology/silicone.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_SILICONE_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_SILICONE_HPP

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

#endif

// ---- lumo/morphology/body.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_BODY_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_BODY_HPP

namespace lumo {

/// A part of a body's closed surface on which all tags are the same.
struct Patch {
  std::string name;
  Shape shape = Plane{};       ///< the exact surface; mesh nodes of the patch lie on it
  bool bonded = false;         ///< fixed to the carrier (closed set: its edge nodes are fixed too)
  bool contactable = false;    ///< the indenter may touch it
  bool meets_carrier = false;  ///< may come to rest on the carrier
  SurfaceOptics optics = Dielectric{};
  bool visible = true;  ///< on the outside: light that leaves here may lie in a region
};

/// A rigid axis-aligned box that the silicone can come to rest on.
struct RigidBox {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d half{1.0, 1.0, 1.0};    ///< half edges [m]
  /// Of all its edges and corners, inside the box; 0: sharp [m]. Where silicone slides over sharp edges, what becomes
  /// of a press depends on the steps that lead to it.
  double edge_radius = 0.0;
};

/// Wanted edge length of the mesh [m] at a place: across and along y. Elements are stretched by the ratio of the two.
struct Sizing {
  std::function<double(const Vec3d&)> edge;  ///< across y [m]
  double stretch_y = 1.0;                    ///< edges along y are this much longer
  /// Finer edges [m] at a place when a tool touches the body at another; empty: none are wanted.
  std::function<double(const Vec3d& place, const Vec3d& touch)> edge_under_touch;
};

/// One soft, transparent body on a rigid carrier: all that meshing, mechanics and optics need to know.
/// SI units, finger frame (x lateral, y along the finger, z outward normal).
struct Body {
  static constexpr int mirror_patch = -1;

  std::string name;
  std::vector<Patch> patches;
  std::vector<Vec3d> vertices;  ///< of the boundary of the meshed sector [m]
  /// Closed boundary of the sector x ≥ 0 and/or y ≥ 0 that `symmetry` leaves. Facet::patch: index into `patches`, or
  /// mirror_patch for a face in a symmetry plane.
  std::vector<Facet> facets;
  Symmetry symmetry;  ///< the whole body is the sector and its mirror images
  Sizing sizing;
  double exact_volume_m3 = 0.0;  ///< of the whole body; 0 when not known

  std::vector<RigidBox> carrier;  ///< union of boxes; what patches rest on
  Vec3d pivot{0.0, 0.0, 0.0};     ///< approach directions turn about this point (shifted by the place) [m]

  Medium medium;        ///< inside
  Medium surroundings;  ///< outside (air)
  /// What light in the body meets where a tool touches; Dielectric: a film of air is left between
  SurfaceOptics touched = Dielectric{};
  std::vector<RigidFace> rigid_faces;  ///< carrier faces seen through air
  std::vector<Emitter> emitters;
  /// Height of the film of air over an emitter in air at which it begins to close [m]; 0: where the body reaches the
  /// emitter; nullopt: never.
  std::optional<double> film_closes_m = 0.0;
  int regions = 0;  ///< number of readout regions
  /// Region of a point of the surface, from its position [m] and exact undeformed outward normal: 0 … regions−1, or −1.
  std::function<int(const Vec3d& position, const Vec3d& normal)> region;
  bool regions_in_space = false;  ///< region() is asked for where a point is, not for where it was undeformed
  /// Light that leaves against this direction is not seen; 0: all is.
  Vec3d seen_towards = Vec3d::Zero();
  /// Region → its mirror image in x = 0 and y = 0; empty: itself; nullopt: what region() says of mirror images
  /// (region_images). One that contradicts region() is refused.
  std::optional<std::vector<int>> region_image_x, region_image_y;
};

/// Exact outward normal at the point of a patch nearest to `p`, also in the mirror images of the sector that the patch
/// describes.
inline Vec3d outward_normal(const Body& body, int patch, const Vec3d& p) {
  const Vec3d fold(body.symmetry.x && p.x() < 0.0 ? -1.0 : 1.0, body.symmetry.y && p.y() < 0.0 ? -1.0 : 1.0, 1.0);
  return fold.cwiseProduct(outward_normal(body.patches[std::size_t(patch)].shape, fold.cwiseProduct(p)));
}

}  // namespace lumo

#endif

// ---- lumo/sense/devices/device.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DEVICES_DEVICE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DEVICES_DEVICE_HPP

namespace lumo::sense {

/// Bytes of a pixel: one of grey, or blue, green, red.
enum class PixelFormat { grey, bgr };

constexpr int channels(PixelFormat f) { return f == PixelFormat::grey ? 1 : 3; }

/// A view of 8-bit pixels that something else owns. Rows run from the top, columns from the left.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;  ///< bytes from a row to the next
  PixelFormat format = PixelFormat::bgr;
  int lit = 1;  ///< the channel that is measured: 0 blue, 1 green, 2 red; grey has one

  const std::uint8_t* row(int y) const { return data + y * stride; }
  /// Value of the measured channel, green unless `lit` says otherwise, or the grey one. Unchecked.
  std::uint8_t green(int x, int y) const { return format == PixelFormat::grey ? row(y)[x] : row(y)[3 * x + lit]; }
  bool empty() const { return !data || width <= 0 || height <= 0; }
};

inline constexpr int max_image_side = 32768;                 ///< [px]
inline constexpr std::int64_t max_image_area = 100'000'000;  ///< [px]

/// Whether an image from outside may be this large [px].
constexpr bool is_image_size(std::int64_t width, std::int64_t height) {
  return width >= 1 && height >= 1 && width <= max_image_side && height <= max_image_side &&
         width * height <= max_image_area;
}

/// An image that owns its pixels; rows without padding.
struct Image {
  int width = 0;
  int height = 0;
  PixelFormat format = PixelFormat::bgr;
  std::vector<std::uint8_t> pixels;

  /// Black. Throws InvalidArgument for sizes outside 1 … max_image_side.
  static Image black(int width, int height, PixelFormat format = PixelFormat::bgr) {
    require_in_range("image width", width, 1, max_image_side, "px");
    require_in_range("image height", height, 1, max_image_side, "px");
    return {width, height, format,
        std::vector<std::uint8_t>(std::size_t(width) * std::size_t(height) * std::size_t(channels(format)))};
  }
  /// Copies the pixels. Throws InvalidArgument for an empty view.
  static Image copy(const ImageView& v) {
    Image image = black(v.width, v.height, v.format);
    for (int y = 0; y < v.height; ++y)
      std::copy_n(v.row(y), std::size_t(v.width) * std::size_t(channels(v.format)), image.row(y));
    return image;
  }
  ImageView view() const { return {pixels.data(), width, height, std::ptrdiff_t(width) * channels(format), format}; }
  std::uint8_t* row(int y) { return pixels.data() + std::ptrdiff_t(y) * width * channels(format); }
};

/// One picture of a camera and how it was taken.
struct Frame {
  ImageView image;
  /// The source's stamp on the session's clock: the middle of the exposure plus the session's frame delay.
  std::int64_t stamp_ns = 0;
  double exposure_s = 0.0;  ///< 0: unknown
  double gain = 0.0;        ///< linear factor, or else the driver's own number; 0: unknown
  std::int64_t index = 0;   ///< counted by the source
};

/// What a source of frames or samples can still give.
enum class StreamState {
  open,   ///< there may be more
  ended,  ///< a recording has been read to its end
  failed  ///< unplugged or unreadable; what it gave before remains good
};

/// A source of frames: live, a video, a folder of images.
/// Laws: `next` gives each frame once, in the order of taking, and nullopt if there is none now; it waits no longer
/// than the model states; the pixels stay valid until the next call; there is no frame unless the state is `open`.
template <class C>
concept Camera = requires(C& camera, const C& view) {
  { camera.next() } -> std::same_as<std::optional<Frame>>;
  { view.state() } -> std::same_as<StreamState>;
};

/// A finger or hand has at most this many joints; vectors of joints need no heap.
inline constexpr int max_joints = 8;

using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, max_joints, 1>;

/// Quantity of a motor driver's effort. The torque model's constants turn a current into a torque.
enum class Effort { current_A, torque_Nm };

/// State of all joints at one time.
struct JointSample {
  std::int64_t stamp_ns = 0;  ///< on the clock that the session names
  JointVector position_rad;
  JointVector velocity_rad_per_s;
  JointVector effort;  ///< of the motor on the joint, positive along the joint's axis
  Effort unit = Effort::current_A;
  bool saturated = false;  ///< a value stands at the end of the driver's range: it may be more
};

/// A source of joint samples: live motors or a recording.
/// Laws: `next` gives each sample once, in the order of arrival, and nullopt if there is none now; it never waits; all
/// samples have the same number of joints, in the same order; there is no sample unless the state is `open`.
template <class A>
concept Actuator = requires(A& actuator, const A& view) {
  { actuator.next() } -> std::same_as<std::optional<JointSample>>;
  { view.state() } -> std::same_as<StreamState>;
};

/// Light along the finger at one time.
struct Profile {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd value;  ///< one for each position of the readout; its unit is the readout's
  /// Share of the raw values at the top of their range: profile values there are lower bounds.
  double saturated = 0.0;
  double nearly_saturated = 0.0;  ///< share of 250 and more, where the readout counts them
};

/// Turns one raw sample (a camera's frame, a row of photodiodes) into a longitudinal profile.
/// Laws: linear in the light unless a value saturates; value i belongs to `positions_m()[i]` on the finger's y axis,
/// ascending; a sample of another size or kind gives false and leaves the profile as it was; no memory is allocated
/// after the first call.
template <class R>
concept Readout = requires(R& readout, const R& view, const typename R::Sample& sample, Profile& profile) {
  { readout.read(sample, profile) } -> std::same_as<bool>;
  { view.positions_m() } -> std::convertible_to<const Eigen::VectorXd&>;
};

/// Makes pixels of an image file's bytes.
/// Law: the view holds until the next call; it is empty for what cannot be decoded.
template <class D>
concept PictureDecoder = requires(D& decode, std::span<const std::uint8_t> file) {
  { decode(file) } -> std::same_as<ImageView>;
};

}  // namespace lumo::sense

#endif

// ---- lumo/lab/side_camera.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_SIDE_CAMERA_HPP
#define SINGLE_INCLUDE_LUMO_LAB_SIDE_CAMERA_HPP

namespace lumo {

/// What a pad's side looks like, apart from the light itself.
struct SideGeometry {
  double half_width_m = 14.75_mm;       ///< of the pad: the facing side is taken as the plane x = half_width_m
  double half_length_m = 30.0_mm;       ///< where the pad ends along y
  double low_m = 0.0, high_m = 9.0_mm;  ///< heights between which light leaves the visible side
  double lamp_height_m = 5.0_mm;        ///< z of the LEDs
  double refractive_index = 1.41;
  std::vector<double> lamp_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
};

/// Of a body that is symmetric in x and y: its visible surface reaches as high as its regions do, found to 1 % of the
/// pad's height. Throws InvalidArgument for a body without LEDs or visible surface.
inline SideGeometry side_geometry(const Body& body) {
  if (body.emitters.empty() || body.vertices.empty())
    throw InvalidArgument("virtual lab: the pad has no LEDs or no surface");
  constexpr double infinity = std::numeric_limits<double>::infinity();
  constexpr int parts = 64;  // of an edge: heights to better than 1 % of the pad's
  SideGeometry g{0.0, 0.0, infinity, -infinity, body.emitters.front().center().z(), body.medium.refractive_index, {}};
  for (const Vec3d& v : body.vertices) {
    g.half_width_m = std::max(g.half_width_m, v.x());
    g.half_length_m = std::max(g.half_length_m, std::abs(v.y()));
  }
  for (const Facet& f : body.facets) {
    if (f.patch < 0 || !body.patches[std::size_t(f.patch)].contactable) continue;
    for (std::size_t k = 0; k < f.loop.size(); ++k)
      for (int part = 0; part <= parts; ++part) {
        const Vec3d &a = body.vertices[std::size_t(f.loop[k])],
                    &b = body.vertices[std::size_t(f.loop[(k + 1) % f.loop.size()])];
        Vec3d p = a + part / double(parts) * (b - a);
        p.y() = 0.0;
        p = closest_point(body.patches[std::size_t(f.patch)].shape, p);
        if (body.region(p, outward_normal(body, f.patch, p)) < 0) continue;
        g.low_m = std::min(g.low_m, p.z());
        g.high_m = std::max(g.high_m, p.z());
      }
  }
  if (!(g.high_m > g.low_m))
    throw InvalidArgument("virtual lab: no part of the pad's surface is visible from the side");
  for (const Emitter& e : body.emitters) g.lamp_m.push_back(e.center().y());
  std::sort(g.lamp_m.begin(), g.lamp_m.end());
  g.lamp_m.erase(std::unique(g.lamp_m.begin(), g.lamp_m.end()), g.lamp_m.end());  // one on each side
  return g;
}

/// Where the camera stands, from what it should be.
struct CameraPlace {
  double yaw_rad = 0.0, pitch_rad = 0.0, roll_rad = 0.0;
  double along_m = 0.0, height_m = 0.0;
};

/// A pinhole camera before the side of a pad.
class SideCamera {
 public:
  /// `distortion`: radial, a ray's tangent is tan (1 + distortion tan²) of its picture's.
  SideCamera(const CameraRig& camera, const SideGeometry& side, const CameraPlace& place, double distortion = 0.0)
      : camera_(camera),
        side_(side),
        distortion_(distortion),
        centre_(0.5 * (camera.width - 1), 0.5 * (camera.height - 1)) {
    // Level, looking along −x; distal to the right. It turns about the middle of the side, at which it is aimed.
    Eigen::Matrix3d level;
    level << 0, 0, -1, 1, 0, 0, 0, -1, 0;
    const Eigen::Vector3d aim(side.half_width_m, place.along_m, 0.5 * (side.low_m + side.high_m) + place.height_m);
    const Eigen::Matrix3d turn = (Eigen::AngleAxisd(place.yaw_rad, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(place.pitch_rad, Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(place.roll_rad, Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    axes_ = turn * level;
    eye_ = aim - camera.distance_m * axes_.col(2);
    place_ = place;
  }

  const CameraPlace& place() const { return place_; }

  /// From a pixel to the middle of the window, over the focal length.
  Eigen::Vector2d off_axis(double u, double v) const {
    const Eigen::Vector2d seen = (Eigen::Vector2d(u, v) - centre_) / camera_.focal_px;
    return distortion_ == 0.0 ? seen : Eigen::Vector2d((1.0 + distortion_ * seen.squaredNorm()) * seen);
  }
  /// Where the ray through a pixel meets the plane of the facing side.
  Eigen::Vector3d on_side(double u, double v) const {
    const Eigen::Vector2d off = off_axis(u, v);
    const Eigen::Vector3d ray = axes_ * Eigen::Vector3d(off.x(), off.y(), 1.0);
    return eye_ + (side_.half_width_m - eye_.x()) / ray.x() * ray;
  }
  /// Pixel of a point on the facing side.
  Eigen::Vector2d pixel(double y_m, double z_m) const { return project({side_.half_width_m, y_m, z_m}); }
  /// Pixel at which an LED is seen.
  Eigen::Vector2d lamp_pixel(double y_m) const {
    return project({side_.half_width_m - side_.half_width_m / side_.refractive_index, y_m, side_.lamp_height_m});
  }
  /// Does a point of the facing side lie in the window, a pixel from its edge at least?
  bool shows(double y_m, double z_m) const {
    const Eigen::Vector2d p = pixel(y_m, z_m);
    return p.x() >= 1.0 && p.y() >= 1.0 && p.x() <= camera_.width - 2.0 && p.y() <= camera_.height - 2.0;
  }
  /// The whole side?
  bool shows_side() const {
    return shows(-side_.half_length_m, side_.low_m) && shows(-side_.half_length_m, side_.high_m) &&
           shows(side_.half_length_m, side_.low_m) && shows(side_.half_length_m, side_.high_m);
  }

  const CameraRig& camera() const { return camera_; }
  const SideGeometry& side() const { return side_; }

 private:
  Eigen::Vector2d project(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d d = axes_.transpose() * (p - eye_);
    if (distortion_ == 0.0) return centre_ + camera_.focal_px / d.z() * d.head<2>();
    const Eigen::Vector2d ray = d.head<2>() / d.z();
    Eigen::Vector2d seen = ray;
    for (int k = 0; k < 20; ++k) seen = ray / (1.0 + distortion_ * seen.squaredNorm());  // a contraction in the window
    return centre_ + camera_.focal_px * seen;
  }

  CameraRig camera_;
  SideGeometry side_;
  CameraPlace place_;
  double distortion_;
  Eigen::Vector3d eye_;
  Eigen::Matrix3d axes_;  ///< columns: right, down, forward
  Eigen::Vector2d centre_;
};

/// A tool between the room's light and the side.
struct Shadow {
  double share = 0.0;  ///< of the room's light that it takes away at y
  double y_m = 0.0, sigma_m = 1.0;
};

/// Paints the side of a pad as a camera sees it: pinhole, lens blur, vignetting (cos⁴), shot, read, row and pixel
/// noise, gamma, 8 bits. The light of a bin fills the height of the visible side evenly (the responses hold no
/// more). LEDs are spots behind the side: in the pad's middle, as deep as refraction lets them seem, so that their
/// pitch looks smaller than the side's.
class SidePainter {
 public:
  /// `position_m`: middles of the light's bins, evenly spaced. Throws InvalidArgument when the side does not lie in the
  /// window.
  SidePainter(const SideCamera& view, const LightRig& light, const Eigen::VectorXd& position_m, std::uint64_t seed);

  /// `light`: of each bin [DN before gamma]. `lamps`: factor of the lamps' spots. `room_DN`: of the room at the
  /// window's middle.
  sense::Image paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise, RandomStream draws,
      const Shadow& shadow = {}) const;

  /// How it stands before the pad.
  const SideCamera& view() const { return view_; }

 private:
  struct Pixel {
    int bin;      ///< left one of the two that it lies between; −1: no light of the side
    float share;  ///< of the right one
    float side, spot, vignette, gain, room;
    float y_m;  ///< where it meets the plane of the side
  };

  SideCamera view_;
  std::vector<Pixel> pixels_;
};

inline SidePainter::SidePainter(
    const SideCamera& view, const LightRig& light, const Eigen::VectorXd& position_m, std::uint64_t seed)
    : view_(view) {
  const CameraRig& camera = view_.camera();
  const SideGeometry& side = view_.side();
  for (const double y : {-side.half_length_m, side.half_length_m})
    for (const double z : {side.low_m, side.high_m})
      if (!view_.shows(y, z)) {
        const Eigen::Vector2d corner = view_.pixel(y, z);
        throw InvalidArgument(message("virtual camera: the pad's corner is seen at (", corner.x(), ", ", corner.y(),
            "), outside the window of ", camera.width, " x ", camera.height, " px"));
      }
  const double spacing = position_m[1] - position_m[0], scale = camera.distance_m / camera.focal_px,
               blur = camera.blur_px * scale;
  const auto edge = [&](double distance) { return 0.5 * std::erfc(-distance / (std::sqrt(2.0) * blur)); };
  const Eigen::Index bins = position_m.size();
  pixels_.resize(std::size_t(camera.width) * std::size_t(camera.height));
  RandomStream sensitivity(seed, 101);
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      const Eigen::Vector2d off = view_.off_axis(u, v);
      const Eigen::Vector3d at = view_.on_side(u, v);
      const double cover = edge(at.y() + side.half_length_m) * edge(side.half_length_m - at.y()) *
                           edge(at.z() - side.low_m) * edge(side.high_m - at.z());
      const double place_in_bins = std::clamp((at.y() - position_m[0]) / spacing, 0.0, double(bins - 1) - 1e-9);
      p.bin = cover > 1e-4 ? int(place_in_bins) : -1;
      p.share = float(place_in_bins - std::floor(place_in_bins));
      p.side = float(cover);
      double spot = 0.0;
      for (const double y : side.lamp_m) {
        const double sigma = std::hypot(light.spot_sigma_m / scale, camera.blur_px),
                     d = (Eigen::Vector2d(u, v) - view_.lamp_pixel(y)).norm() / sigma;
        spot += light.spot_DN * std::exp(-0.5 * d * d);
      }
      p.spot = float(spot);
      p.y_m = float(at.y());
      const double cosine = 1.0 / std::sqrt(1.0 + off.squaredNorm());
      p.vignette = float(cosine * cosine * cosine * cosine);
      p.gain = float(sensitivity.normal());
      p.room = float(1.0 + light.ambient_slope * (double(u) / (camera.width - 1) - 0.5));
    }
}

inline sense::Image SidePainter::paint(const Eigen::VectorXd& light, double lamps, double room_DN, double noise,
    RandomStream draws, const Shadow& shadow) const {
  const CameraRig& camera = view_.camera();
  sense::Image image = sense::Image::black(camera.width, camera.height, sense::PixelFormat::grey);
  for (int v = 0; v < camera.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise * camera.row_DN * draws.normal();
    for (int u = 0; u < camera.width; ++u) {
      const Pixel& p = pixels_[std::size_t(v) * std::size_t(camera.width) + std::size_t(u)];
      double room = room_DN * p.room;
      if (shadow.share > 0.0) {
        const double away = (p.y_m - shadow.y_m) / shadow.sigma_m;
        room *= 1.0 - shadow.share * std::exp(-0.5 * away * away);
      }
      double signal = room + lamps * p.spot;
      if (p.bin >= 0) signal += p.side * ((1.0 - p.share) * light[p.bin] + p.share * light[p.bin + 1]);
      signal *= p.vignette * (1.0 + noise * camera.pixel_gain * p.gain);
      row[u] = sensed(camera, signal, noise, draws.normal(), row_offset);
    }
  }
  return image;
}

}  // namespace lumo

#endif

// ---- lumo/sense/recording/alignment.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_ALIGNMENT_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_ALIGNMENT_HPP

namespace lumo::sense {

/// Stamps lie within ±this [ns], 146 years, so that the difference of any two fits into 64 bits.
inline constexpr std::int64_t stamp_limit_ns = 4'600'000'000'000'000'000;

/// From one clock to another: to = from + offset + drift · (from − origin).
struct ClockMap {
  std::int64_t origin_ns = 0;
  double offset_s = 0.0;
  double drift = 0.0;       ///< seconds per second
  double residual_s = 0.0;  ///< RMS residual of a fit; 0 if the map was given
  bool operator==(const ClockMap&) const = default;

  /// Saturates at the limit of stamps. Throws InvalidArgument for an offset or drift that is not finite.
  std::int64_t operator()(std::int64_t from_ns) const {
    require_finite("offset of a clock", offset_s, "s");
    require_finite("drift of a clock", drift, "");
    constexpr double limit = double(stamp_limit_ns);
    const double shift = 1e9 * offset_s + drift * (double(from_ns) - double(origin_ns));
    return std::clamp<std::int64_t>(
        from_ns + std::llround(std::clamp(shift, -limit, limit)), -stamp_limit_ns, stamp_limit_ns);
  }

  /// Least-squares fit to the stamps of the same events on both clocks; one event gives the offset alone. Throws
  /// InvalidArgument for none.
  static ClockMap fit(std::span<const std::int64_t> from_ns, std::span<const std::int64_t> to_ns) {
    if (from_ns.empty() || from_ns.size() != to_ns.size())
      throw InvalidArgument(message(
          "clocks have ", from_ns.size(), " and ", to_ns.size(), " common events, must have as many, at least 1"));
    for (std::size_t i = 0; i < from_ns.size(); ++i)
      for (const std::int64_t stamp : {from_ns[i], to_ns[i]})
        if (stamp < -stamp_limit_ns || stamp > stamp_limit_ns)
          throw InvalidArgument(message("stamp of a common event is ", stamp, " ns, must lie within 4.6e18 ns"));
    ClockMap map;
    map.origin_ns = from_ns[from_ns.size() / 2];
    const double n = double(from_ns.size());
    double sum_t = 0.0, sum_d = 0.0, sum_tt = 0.0, sum_td = 0.0;
    for (std::size_t i = 0; i < from_ns.size(); ++i) {
      const double t = 1e-9 * double(from_ns[i] - map.origin_ns), d = 1e-9 * double(to_ns[i] - from_ns[i]);
      sum_t += t;
      sum_d += d;
      sum_tt += t * t;
      sum_td += t * d;
    }
    const double det = n * sum_tt - sum_t * sum_t;
    map.drift = det > 1e-9 * n * n ? (n * sum_td - sum_t * sum_d) / det : 0.0;
    map.offset_s = (sum_d - map.drift * sum_t) / n;
    double squares = 0.0;
    for (std::size_t i = 0; i < from_ns.size(); ++i) squares += std::pow(1e-9 * double(to_ns[i] - map(from_ns[i])), 2);
    map.residual_s = std::sqrt(squares / n);
    return map;
  }
};

/// A recorded quantity of some channels over time, interpolated linearly.
class TimeSeries {
 public:
  /// `value`: channels × stamps. Stamps ascend strictly. Throws InvalidArgument.
  TimeSeries(std::vector<std::int64_t> stamp_ns, Eigen::MatrixXd value)
      : stamp_(std::move(stamp_ns)), value_(std::move(value)) {
    if (value_.cols() != Eigen::Index(stamp_.size()))
      throw InvalidArgument(message("time series has ", stamp_.size(), " stamps and ", value_.cols(), " values"));
    for (std::size_t i = 1; i < stamp_.size(); ++i)
      if (stamp_[i] <= stamp_[i - 1])
        throw InvalidArgument(message(
            "time series: stamp ", i, " is ", stamp_[i], " ns, must exceed its predecessor, ", stamp_[i - 1], " ns"));
    if (!stamp_.empty() && (stamp_.front() < -stamp_limit_ns || stamp_.back() > stamp_limit_ns))
      throw InvalidArgument(
          message("time series goes from ", stamp_.front(), " to ", stamp_.back(), " ns, must lie within 4.6e18 ns"));
  }

  /// Value at a time; nullopt outside of the series, or in a gap longer than `max_gap_s` (NaN: in each).
  std::optional<Eigen::VectorXd> at(std::int64_t stamp_ns, double max_gap_s) const {
    const Eigen::MatrixXd& value = value_;
    const auto after = std::lower_bound(stamp_.begin(), stamp_.end(), stamp_ns);
    if (after == stamp_.end()) return std::nullopt;
    const auto j = Eigen::Index(after - stamp_.begin());
    if (*after == stamp_ns) return Eigen::VectorXd(value.col(j));
    if (after == stamp_.begin()) return std::nullopt;
    const double gap = double(*after - *(after - 1));
    if (!(1e-9 * gap <= max_gap_s)) return std::nullopt;
    const double share = double(stamp_ns - *(after - 1)) / gap;
    return Eigen::VectorXd((1.0 - share) * value.col(j - 1) + share * value.col(j));
  }

  /// RMS difference between each inner sample and the line through its neighbours, per channel: noise, and curvature
  /// that interpolation misses. White noise of standard deviation σ gives √1.5 σ. Interpolation itself spans half the
  /// distance, so its error is about a quarter of the curvature's part.
  Eigen::VectorXd interpolation_residual() const {
    const Eigen::MatrixXd& value = value_;
    Eigen::VectorXd squares = Eigen::VectorXd::Zero(value.rows());
    for (std::size_t i = 1; i + 1 < stamp_.size(); ++i) {
      const double share = double(stamp_[i] - stamp_[i - 1]) / double(stamp_[i + 1] - stamp_[i - 1]);
      const auto k = Eigen::Index(i);
      squares += (value.col(k) - (1.0 - share) * value.col(k - 1) - share * value.col(k + 1)).cwiseAbs2();
    }
    return stamp_.size() < 3 ? squares : Eigen::VectorXd((squares / double(stamp_.size() - 2)).cwiseSqrt());
  }
  double largest_gap_s() const {
    std::int64_t gap = 0;
    for (std::size_t i = 1; i < stamp_.size(); ++i) gap = std::max(gap, stamp_[i] - stamp_[i - 1]);
    return 1e-9 * double(gap);
  }
  std::size_t size() const { return stamp_.size(); }

 private:
  std::vector<std::int64_t> stamp_;
  Eigen::MatrixXd value_;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/joint_names.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_JOINT_NAMES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_JOINT_NAMES_HPP

namespace lumo::sense {

/// "base, tip", as messages show them.
inline std::string joint_list(const std::vector<std::string>& names) {
  return listing(names, [](const std::string& n) { return printable(n); });
}

/// A name of digits only: a joint's number.
inline bool is_joint_number(std::string_view name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char c) { return c >= '0' && c <= '9'; });
}

/// Whether columns of a table can carry these names: none is empty, a number, or there twice, and none holds what
/// divides a table or ends a line.
inline bool are_column_names(const std::vector<std::string>& names) {
  constexpr std::size_t longest = 200;
  const auto plain = [](const std::string& n) {
    return !n.empty() && n.size() <= longest && !is_joint_number(n) && n.front() != ' ' && n.back() != ' ' &&
           std::none_of(n.begin(), n.end(),
               [](char c) { return c == ',' || c == ';' || c == '"' || static_cast<unsigned char>(c) < ' '; });
  };
  for (std::size_t i = 0; i < names.size(); ++i)
    if (!plain(names[i]) ||
        std::find(names.begin(), names.begin() + std::ptrdiff_t(i), names[i]) != names.begin() + std::ptrdiff_t(i))
      return false;
  return true;
}

/// Place of each wanted name among those that are there. Throws InputError, with `where` before it, for one that is
/// not.
inline std::vector<std::size_t> places_of(
    const std::vector<std::string>& wanted, const std::vector<std::string>& there, const std::string& where) {
  std::vector<std::size_t> places;
  for (const std::string& name : wanted) {
    const auto at = std::find(there.begin(), there.end(), name);
    if (at == there.end())
      throw InputError(message(where, ": has no joint '", printable(name), "', but ", joint_list(there)));
    places.push_back(std::size_t(at - there.begin()));
  }
  return places;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/sensor_axes.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_SENSOR_AXES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_SENSOR_AXES_HPP

namespace lumo::sense {

/// How a force sensor is mounted: along the finger's x, y and z lie these axes of the sensor, each with a sign. All
/// three reversed: the sensor reports the force of the finger on the object.
struct SensorAxes {
  std::array<int, 3> axis{1, 2, 3};  ///< ±1: the sensor's x, ±2: y, ±3: z; each once
  bool operator==(const SensorAxes&) const = default;

  /// A force or torque of the sensor, in the finger's frame.
  Vec3d turned(const Vec3d& of_sensor) const {
    Vec3d v;
    for (int k = 0; k < 3; ++k) {
      const int a = axis[std::size_t(k)];
      v[k] = a < 0 ? -of_sensor[-a - 1] : of_sensor[a - 1];
    }
    return v;
  }
};

/// "x", "-y" …, one for each axis of the finger.
inline std::vector<std::string> names_of(const SensorAxes& axes) {
  std::vector<std::string> names;
  for (const int a : axes.axis) names.push_back(std::string(a < 0 ? "-" : "") + "xyz"[std::size_t(a < 0 ? -a : a) - 1]);
  return names;
}

/// Reads them. Throws InvalidArgument.
inline SensorAxes sensor_axes(const std::vector<std::string>& names) {
  SensorAxes axes;
  std::array<int, 3> seen{};
  for (std::size_t k = 0; k < names.size() && k < 3; ++k) {
    std::string_view name = names[k];
    const bool reversed = name.starts_with('-');
    if (reversed || name.starts_with('+')) name.remove_prefix(1);
    const std::size_t at = name.size() == 1 ? std::string_view("xyz").find(name[0]) : std::string_view::npos;
    if (at == std::string_view::npos) break;
    ++seen[at];
    axes.axis[k] = reversed ? -int(at) - 1 : int(at) + 1;
  }
  if (names.size() != 3 || seen != std::array{1, 1, 1})
    throw InvalidArgument("axes of the force sensor are '" + listing(names, [](const std::string& n) {
      return printable(n);
    }) + "', must be x, y and z, each once and with or without a minus, such as x, -y, -z");
  return axes;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/session.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_SESSION_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_SESSION_HPP

namespace lumo::sense {

/// What is done in a stretch of a recording.
enum class SegmentKind {
  unloaded,  ///< nothing touches the finger
  dark,      ///< the same with the LEDs off
  free,      ///< a joint moves without contact
  approach,
  hold,
  cycle,
  retract,
  other  ///< a recording's own kind, see Segment::other_kind
};

inline constexpr std::array<std::string_view, 7> segment_kind_names{
    "unloaded", "dark", "free", "approach", "hold", "cycle", "retract"};

/// The kind as files name it; empty for `other`.
constexpr std::string_view to_string(SegmentKind kind) {
  return kind == SegmentKind::other ? std::string_view() : segment_kind_names[std::size_t(kind)];
}

/// The kind of this name; `other` for a name that is not listed.
constexpr SegmentKind segment_kind_from_string(std::string_view name) {
  std::size_t k = 0;
  while (k < segment_kind_names.size() && segment_kind_names[k] != name) ++k;
  return SegmentKind(k);
}

static_assert(std::size_t(SegmentKind::other) == segment_kind_names.size());

/// A stretch of a log whose circumstances its maker knew. Decoders learn from segments and metrics compare them;
/// estimators do not read them.
struct Segment {
  std::int64_t from_ns = 0, to_ns = 0;
  SegmentKind kind = SegmentKind::hold;
  int place = -1;       ///< number of the tested place, from 0; −1: none
  double y_mm = 0.0;    ///< of that place
  int repetition = -1;  ///< re-contact or run, from 0; −1: none
  int cycle = -1;       ///< within maintained contact
  double load_N = 0.0;
  double angle_deg = 0.0;
  double diameter_mm = 0.0;  ///< of the indenter; 0: unknown
  std::string other_kind{};  ///< name of a kind of the recording's own; empty for the others
  bool operator==(const Segment&) const = default;

  bool is_without_contact() const {
    return kind == SegmentKind::unloaded || kind == SegmentKind::dark || kind == SegmentKind::free;
  }
  bool holds(std::int64_t stamp_ns) const { return stamp_ns >= from_ns && stamp_ns <= to_ns; }
  /// Name of the kind as it stands in files.
  std::string kind_name() const { return kind == SegmentKind::other ? other_kind : std::string(to_string(kind)); }
  void set_kind_name(std::string name) {
    kind = segment_kind_from_string(name);
    other_kind = kind == SegmentKind::other ? std::move(name) : std::string();
  }
};

/// One link of a hand, in its own plane as a camera sees its side: y along the link towards the tip, z out of the pad.
struct HandLink {
  std::string name;
  std::vector<int> joints;  ///< that move it, by their numbers in the joint samples
  Eigen::Matrix2Xd hole_m;  ///< centres (y, z) of its mounting holes, at least two
  double hole_radius_m = 1.5_mm;
  bool z_clockwise = false;                       ///< in the image z lies clockwise of y (image rows run down)
  double y_low_m = -27.5_mm, y_high_m = 27.5_mm;  ///< the pad's side that is read
  double z_low_m = 1.0_mm, z_high_m = 8.0_mm;
};

/// Throws InvalidArgument without joints or two holes, or for lengths out of range.
inline void validate(const HandLink& l) {
  if (l.joints.empty())
    throw InvalidArgument(message("link '", printable(l.name), "': no joint moves it, at least one must"));
  if (l.hole_m.cols() < 2 || !l.hole_m.allFinite())
    throw InvalidArgument(message("link '", printable(l.name), "': has ", l.hole_m.cols(),
        " mounting holes, must have at least 2, at finite places"));
  for (Eigen::Index k = 1; k < l.hole_m.cols(); ++k)
    for (Eigen::Index j = 0; j < k; ++j)
      if (const double apart = std::hypot(l.hole_m(0, k) - l.hole_m(0, j), l.hole_m(1, k) - l.hole_m(1, j));
          !(apart >= 1.0_mm && apart <= 10.0))
        throw InvalidArgument(message(
            "link '", printable(l.name), "': mounting holes are ", 1e3 * apart, " mm apart, must be 1 to 10000 mm"));
  require_in_range("radius of a mounting hole", 1e3 * l.hole_radius_m, 0.1, 100.0, "mm");
  require_in_range("length of a link's pad", 1e3 * (l.y_high_m - l.y_low_m), 1.0, 10000.0, "mm");
  require_in_range("height of a link's pad", 1e3 * (l.z_high_m - l.z_low_m), 0.5, 10000.0, "mm");
}

/// A link of a hand, and about where its holes are in the first picture: somebody pointed at them.
struct SessionLink {
  HandLink link;
  Eigen::Matrix2Xd hole_px;  ///< as many as link.hole_m has
};

/// Contents of session.json.
struct Session {
  std::string title;
  std::string clock = "monotonic";  ///< on which frames are stamped
  std::string material;             ///< of the pad
  std::string finger;               ///< which body the pad has, "built", "plain" or "own"; empty: not stated
  std::vector<double> theta_mm;     ///< its design; may be empty
  std::string video;                ///< file name beside session.json; empty: frames/
  int led_count = 5;
  double led_pitch_m = 11.0_mm, led_first_y_m = -22.0_mm;
  double led_depth_m = 0.0;  ///< of the LEDs behind the side that the camera sees, in silicone
  /// From that side to the camera's lens; 0: unknown, the LEDs' parallax stays as it is.
  double camera_distance_m = 0.0;
  Eigen::Vector2d distal{1.0, 0.0};  ///< direction of the tip in the image
  double joint_to_origin_m = 0.05;   ///< from the axis of the last joint to the finger's origin
  /// From each joint's axis to the next one's, along the finger; empty: one joint.
  std::vector<double> joint_to_joint_m;
  std::vector<double> torque_constant_Nm_per_A{1.0};  ///< of each joint, gear included
  /// The finger's joints from the base to the tip, by the names that joint.csv or a bag has; empty: all, as they stand.
  std::vector<std::string> joint_names;
  double frame_delay_s = 0.0, joint_delay_s = 0.0;  ///< from the event to the stamp
  ClockMap joint_clock, wrench_clock;               ///< onto the frames' clock
  SensorAxes wrench_axes;          ///< how the wrenches are to be turned; those of a Recording that was read are turned
  std::vector<SessionLink> links;  ///< of a hand; empty for one finger
  std::vector<Segment> segments;
};

/// Refractive index of silicone in the visible; assumed.
inline constexpr double silicone_index = 1.41;

/// Ratio of the LEDs' apparent pitch to the same length on the side before them: perspective on their apparent depth,
/// the true one over silicone's refractive index.
inline double led_parallax(const Session& s) {
  return s.camera_distance_m > 0.0 ? s.camera_distance_m / (s.camera_distance_m + s.led_depth_m / silicone_index) : 1.0;
}

namespace detail {

/// Checks of a session; each throws InputError with the session's name before the reason.
class SessionCheck {
 public:
  explicit SessionCheck(const std::string& name) : name_(name) {}

  void view(const Session& s) const {
    require(s.led_count >= 3 && s.led_count <= 64, message("led count is ", s.led_count, ", must lie in [3, 64]"));
    require(s.led_pitch_m > 0.0 && s.led_pitch_m < 1.0,
        message("led pitch is ", 1e3 * s.led_pitch_m, " mm, must lie in (0, 1000) mm"));
    require(s.led_depth_m >= 0.0 && s.led_depth_m <= 1.0,
        message("depth of the LEDs is ", 1e3 * s.led_depth_m, " mm, must lie in [0, 1000] mm"));
    require(s.camera_distance_m == 0.0 || (s.camera_distance_m >= 0.01 && s.camera_distance_m <= 100.0),
        message("distance of the camera is ", 1e3 * s.camera_distance_m,
            " mm, must lie in [10, 100000] mm, or be 0 (not known)"));
    require(led_parallax(s) >= 0.5,
        message("LEDs lie ", 1e3 * s.led_depth_m, " mm deep before a camera at ", 1e3 * s.camera_distance_m,
            " mm, must lie at most 1.41 times as deep as it is far"));
    require(std::isfinite(s.distal.norm()) && s.distal.norm() > 0.0, "distal direction must not be zero");
  }

  void finger(const Session& s) const {
    require(!s.torque_constant_Nm_per_A.empty() && s.torque_constant_Nm_per_A.size() <= std::size_t(max_joints),
        message("has ", s.torque_constant_Nm_per_A.size(), " torque constants, must have 1 to ", max_joints));
    require(s.video.find('/') == std::string::npos && s.video.find('\\') == std::string::npos && s.video != "..",
        "video must be a file name beside session.json");
    require(std::isfinite(s.led_first_y_m) && std::abs(s.led_first_y_m) <= 10.0,
        message("first LED's y is ", 1e3 * s.led_first_y_m, " mm, must lie within 10000 mm"));
    require(std::abs(s.joint_to_origin_m) <= 10.0,
        message("way from joint to origin is ", 1e3 * s.joint_to_origin_m, " mm, must lie within 10000 mm"));
    require(s.joint_to_joint_m.size() < std::size_t(max_joints),
        message("has ", s.joint_to_joint_m.size(), " ways from joint to joint, must have at most ", max_joints - 1));
    for (const double l : s.joint_to_joint_m)
      require(l > 0.0 && l <= 10.0, message("way from joint to joint is ", 1e3 * l, " mm, must lie in (0, 10000] mm"));
    require(s.joint_names.size() <= std::size_t(max_joints) &&
                (s.joint_names.empty() || are_column_names(s.joint_names) ||
                    std::all_of(s.joint_names.begin(), s.joint_names.end(), is_joint_number)),
        message("joint names are ", joint_list(s.joint_names), ", must be at most ", max_joints,
            ", each once, without commas, semicolons and quotes"));
    for (const double k : s.torque_constant_Nm_per_A)
      require(std::abs(k) >= 1e-6 && std::abs(k) <= 1e3,
          message("torque constant is ", k, " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
    for (const double theta : s.theta_mm) require(std::isfinite(theta), "design must be finite");
  }

  void clocks(const Session& s) const {
    for (const double delay : {s.frame_delay_s, s.joint_delay_s})
      require(std::abs(delay) <= 10.0, message("delay is ", delay, " s, must lie within 10 s"));
    for (const ClockMap& map : {s.joint_clock, s.wrench_clock}) {
      stamp(map.origin_ns);
      require(
          std::abs(map.offset_s) <= 4e9, message("offset of a clock is ", map.offset_s, " s, must lie within 4e9 s"));
      require(std::abs(map.drift) <= 0.1, message("drift of a clock is ", map.drift, ", must lie within 0.1"));
      require(map.residual_s >= 0.0 && std::isfinite(map.residual_s),
          message("residual of a clock is ", map.residual_s, " s, must not be negative"));
    }
  }

  void link(const SessionLink& l, std::size_t i) const {
    try {
      validate(l.link);
    } catch (const InvalidArgument& e) {
      require(false, message("link ", i, ": ", e.what()));
    }
    for (const int j : l.link.joints)
      require(j >= 0 && j < max_joints,
          message("link ", i, ": joint ", j, " moves it, must lie in [0, ", max_joints - 1, "]"));
    require(l.hole_px.cols() == l.link.hole_m.cols(),
        message("link ", i, ": has ", l.link.hole_m.cols(), " holes and ", l.hole_px.cols(),
            " places of them in the picture, must have as many"));
    require(l.hole_px.allFinite() && l.hole_px.cwiseAbs().maxCoeff() <= 1e5,
        message("link ", i, ": places of holes must lie within 1e5 px"));
    const double px_per_mm =
        1e-3 * (l.hole_px.col(0) - l.hole_px.col(1)).norm() / (l.link.hole_m.col(0) - l.link.hole_m.col(1)).norm();
    require(px_per_mm >= 0.05 && px_per_mm <= 100.0,
        message("link ", i, ": its first two holes are seen at ", px_per_mm, " px/mm, must lie in [0.05, 100] px/mm"));
  }

  void segment(const Segment& g, std::size_t i) const {
    stamp(g.from_ns);
    stamp(g.to_ns);
    require(g.to_ns >= g.from_ns,
        message("segment ", i, " ends at ", g.to_ns, " ns, before it begins at ", g.from_ns, " ns"));
    for (const double v : {g.y_mm, g.load_N, g.angle_deg, g.diameter_mm})
      require(std::isfinite(v), message("numbers of segment ", i, " must be finite"));
  }

  void require(bool good, const std::string& what) const {
    if (!good) throw InputError(message(name_, ": ", what));
  }

 private:
  void stamp(std::int64_t ns) const {
    require(ns >= -stamp_limit_ns && ns <= stamp_limit_ns, message("stamp ", ns, " ns is beyond the range of stamps"));
  }

  const std::string& name_;
};

}  // namespace detail

/// Throws InputError for a value out of its range; `name` stands in the message.
inline void validate(const Session& s, const std::string& name) {
  const detail::SessionCheck check(name);
  check.view(s);
  check.finger(s);
  check.clocks(s);
  check.require(s.links.size() <= 16, message("has ", s.links.size(), " links, must have at most 16"));
  for (std::size_t i = 0; i < s.links.size(); ++i) check.link(s.links[i], i);
  for (std::size_t i = 0; i < s.segments.size(); ++i) check.segment(s.segments[i], i);
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/hand/link_map.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_HAND_LINK_MAP_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_HAND_LINK_MAP_HPP

namespace lumo::sense {

/// How a link's plane lies in the image: turned, shifted and scaled.
struct LinkMap {
  Eigen::Vector2d origin_px{0.0, 0.0};
  Eigen::Vector2d along_px_per_m{1.0, 0.0};  ///< of y
  bool z_clockwise = false;
  double residual_px = 0.0;  ///< RMS of what the fit leaves
  double contrast_DN = 0.0;  ///< of the palest hole that it was found by

  Eigen::Vector2d pixel(double y_m, double z_m) const {
    const double side = z_clockwise ? 1.0 : -1.0;
    const Eigen::Vector2d across(-side * along_px_per_m.y(), side * along_px_per_m.x());
    const Eigen::Vector2d& along = along_px_per_m;
    return origin_px + y_m * along + z_m * across;
  }
  double px_per_m() const { return std::hypot(along_px_per_m.x(), along_px_per_m.y()); }

  /// Least squares over points of the link (2 × n, n ≥ 2) and where they are seen. Throws InvalidArgument for fewer, or
  /// points that coincide.
  static LinkMap fit(const Eigen::Matrix2Xd& point_m, const Eigen::Matrix2Xd& pixel, bool z_clockwise);
};

inline LinkMap LinkMap::fit(const Eigen::Matrix2Xd& point_m, const Eigen::Matrix2Xd& pixel, bool z_clockwise) {
  using Complex = std::complex<double>;
  const Eigen::Index n = point_m.cols();
  if (n < 2 || pixel.cols() != n)
    throw InvalidArgument(
        message("link map has ", n, " points and ", pixel.cols(), " pixels, must have at least 2 of each"));
  const auto point = [&](Eigen::Index k) {
    return Complex(point_m(0, k), z_clockwise ? point_m(1, k) : -point_m(1, k));
  };
  const auto seen = [&](Eigen::Index k) { return Complex(pixel(0, k), pixel(1, k)); };
  Complex middle = 0.0, middle_px = 0.0, turn = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    middle += point(k) / double(n);
    middle_px += seen(k) / double(n);
  }
  double spread = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    turn += std::conj(point(k) - middle) * (seen(k) - middle_px);
    spread += std::norm(point(k) - middle);
  }
  if (!(spread > 0.0)) throw InvalidArgument("link map: all points lie in one place");
  turn /= spread;
  const Complex origin = middle_px - turn * middle;
  LinkMap map{{origin.real(), origin.imag()}, {turn.real(), turn.imag()}, z_clockwise, 0.0, 0.0};
  double left = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) left += std::norm(origin + turn * point(k) - seen(k));
  map.residual_px = std::sqrt(left / double(n));
  return map;
}

/// How well holes must be seen, and what of the picture is compared. Sizes of disc and rim are in radii of the hole,
/// chosen so that the hole's blurred edge belongs to neither; assumed.
struct HoleSearch {
  double reach_m = 8.0_mm;         ///< how far from its expected place a hole may be
  double min_contrast = 10.0;      ///< how much darker than its rim [DN]
  double max_residual_m = 0.4_mm;  ///< RMS of the holes' places after the fit
  double max_scale_change = 0.05;  ///< relative to the guess; two holes show no other mistake
  double disc = 0.75;              ///< radius of the disc inside the edge
  double rim = 1.35;               ///< inner radius of the rim outside of the edge
  double rim_width = 0.6;
  double min_disc_px = 0.8;       ///< at least the middle pixel
  double min_rim_width_px = 1.5;  ///< at least a pixel in each sector
  int centroid_passes = 4;        ///< each about the last one's place
};

namespace detail {

struct Hole {
  Eigen::Vector2d center;
  double contrast;
};

/// Finds the dark disc of a radius that stands out most from its rim. Of lumo's own, so that sensing needs Eigen only.
class HoleFinder {
 public:
  HoleFinder(const ImageView& image, double radius_px, const HoleSearch& search)
      : image_(image),
        search_(search),
        inner_(std::max(search.min_disc_px, search.disc * radius_px)),
        rim_(search.rim * radius_px),
        outer_(rim_ + std::max(search.min_rim_width_px, search.rim_width * radius_px)) {
    if (fits()) lay_out();
  }

  /// Within `reach_px` of a pixel; nullopt if no disc is dark enough.
  std::optional<Hole> find(const Eigen::Vector2d& expected, double reach_px) const {
    constexpr double far_px = 1e6;  // beyond any picture, so that pixels can be counted in int
    if (!(fits() && expected.allFinite() && expected.norm() < far_px && reach_px < far_px)) return std::nullopt;
    std::optional<Hole> hole = darkest(expected, reach_px);
    if (!hole || !centre(hole->center)) return std::nullopt;
    return hole;
  }

 private:
  static constexpr std::size_t sectors = 8;  ///< of the rim; the part behind them is the disc
  struct Offset {
    int x, y;
    std::size_t part;
  };

  bool fits() const { return outer_ > 0.0 && 2.0 * outer_ < std::min(image_.width, image_.height); }

  void lay_out() {
    for (int y = -int(outer_); y <= int(outer_); ++y)
      for (int x = -int(outer_); x <= int(outer_); ++x) {
        const double d = std::hypot(x, y);
        if (d > outer_ || (d > inner_ && d < rim_)) continue;
        const auto sector = std::size_t(std::min(double(sectors - 1), (std::atan2(y, x) / pi + 1.0) * (0.5 * sectors)));
        offsets_.push_back({x, y, d <= inner_ ? sectors : sector});
        ++count_[offsets_.back().part];
      }
  }

  /// Means of the disc and of the rim's darkest sector: a hole is darker than all of them, an edge or a gap is not.
  std::pair<double, double> disc_and_rim(int cx, int cy) const {
    std::array<int, sectors + 1> sum{};
    for (const Offset& n : offsets_) sum[n.part] += image_.green(cx + n.x, cy + n.y);
    double around = 255.0;
    for (std::size_t k = 0; k < sectors; ++k)
      if (count_[k] > 0) around = std::min(around, double(sum[k]) / count_[k]);
    return {double(sum[sectors]) / count_[sectors], around};
  }

  std::optional<Hole> darkest(const Eigen::Vector2d& expected, double reach) const {
    const int whole = std::max(1, int(std::ceil(reach))), u = int(std::lround(expected.x())),
              v = int(std::lround(expected.y())), edge = int(std::ceil(outer_));
    double best = search_.min_contrast;
    std::optional<Hole> hole;
    for (int cy = std::max(v - whole, edge); cy <= std::min(v + whole, image_.height - 1 - edge); ++cy)
      for (int cx = std::max(u - whole, edge); cx <= std::min(u + whole, image_.width - 1 - edge); ++cx) {
        if (std::hypot(cx - u, cy - v) > reach) continue;
        const auto [disc, around] = disc_and_rim(cx, cy);
        if (around - disc > best) {
          best = around - disc;
          hole = Hole{Eigen::Vector2d(cx, cy), best};
        }
      }
    return hole;
  }

  /// Moves a place to the centroid of the darkness about it; false if that leaves the picture.
  bool centre(Eigen::Vector2d& place) const {
    for (int pass = 0; pass < search_.centroid_passes; ++pass) {
      if (place.x() < outer_ || place.y() < outer_ || place.x() > image_.width - 1 - outer_ ||
          place.y() > image_.height - 1 - outer_)
        return false;
      const double light = disc_and_rim(int(std::lround(place.x())), int(std::lround(place.y()))).second;
      Eigen::Vector2d moment = Eigen::Vector2d::Zero();
      double weight = 0.0;
      for (int y = int(std::ceil(place.y() - rim_)); y <= int(std::floor(place.y() + rim_)); ++y)
        for (int x = int(std::ceil(place.x() - rim_)); x <= int(std::floor(place.x() + rim_)); ++x) {
          const double w =
              std::hypot(x - place.x(), y - place.y()) > rim_ ? 0.0 : std::max(0.0, light - image_.green(x, y));
          moment += w * Eigen::Vector2d(x, y);
          weight += w;
        }
      if (!(weight > 0.0)) return false;
      place = moment / weight;
    }
    return true;
  }

  const ImageView& image_;
  const HoleSearch& search_;
  double inner_, rim_, outer_;  ///< [px]
  std::vector<Offset> offsets_;
  std::array<int, sectors + 1> count_{};
};

}  // namespace detail

/// Finds the link by its mounting holes, about where `guess` expects them; nullopt if one is not seen, or if they do
/// not fit the link.
inline std::optional<LinkMap> register_link(
    const ImageView& image, const HandLink& link, const LinkMap& guess, const HoleSearch& search = {}) {
  if (image.empty() || !guess.origin_px.allFinite() || !(guess.origin_px.norm() < 1e6)) return std::nullopt;
  const double scale = guess.px_per_m();
  const Eigen::Index n = link.hole_m.cols();
  Eigen::Matrix2Xd seen(2, n);
  double contrast = 255.0;
  const detail::HoleFinder finder(image, link.hole_radius_m * scale, search);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Vector2d expected = guess.pixel(link.hole_m(0, k), link.hole_m(1, k));
    const auto hole = finder.find(expected, search.reach_m * scale);
    if (!hole) return std::nullopt;
    seen.col(k) = hole->center;
    contrast = std::min(contrast, hole->contrast);
  }
  for (Eigen::Index k = 1; k < n; ++k)
    for (Eigen::Index j = 0; j < k; ++j)
      if ((seen.col(k) - seen.col(j)).norm() < link.hole_radius_m * scale)
        return std::nullopt;  // one hole taken for two
  LinkMap map = LinkMap::fit(link.hole_m, seen, link.z_clockwise);
  map.contrast_DN = contrast;
  if (map.residual_px > search.max_residual_m * scale ||
      std::abs(map.px_per_m() / scale - 1.0) > search.max_scale_change)
    return std::nullopt;
  return map;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/csv.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_CSV_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_CSV_HPP

namespace lumo::sense {

/// Reads comma-separated tables strictly: one header line whose names carry their units, then rows of as many fields.
/// No quotes, no empty lines but at the end, no comments; fields may have spaces around them, lines may end in CR LF.
/// A header without commas is a spreadsheet's: semicolons or tabs separate, and numbers may have a decimal comma.
/// Every fault is an InputError of one line with file, line and column.
class CsvReader {
 public:
  static constexpr std::size_t max_line = 65536, max_columns = 256;

  /// Reads the header. `name` stands in messages.
  CsvReader(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
    if (!read_line()) throw InputError(message(name_, ": is empty, must begin with a line of column names"));
    if (line_text_.starts_with("\xef\xbb\xbf")) line_text_.erase(0, 3);
    if (line_text_.starts_with("sep=") && line_text_.size() == 5 && !read_line())  // a spreadsheet's line of its own
      throw InputError(message(name_, ":2: is empty, must be a line of column names"));
    for (const char separator : {'\t', ';', ','})
      if (line_text_.find(separator) != std::string::npos) separator_ = separator;
    split();
    for (const std::string_view f : fields_) {
      if (f.empty()) throw InputError(message(name_, ":1: column ", columns_.size() + 1, " has no name"));
      for (const std::string& c : columns_)
        if (c == f) throw InputError(message(name_, ":1: column '", printable(f), "' is there twice"));
      columns_.emplace_back(f);
    }
  }

  const std::vector<std::string>& columns() const { return columns_; }
  /// Place of a column, or −1.
  int find(std::string_view column) const {
    for (std::size_t i = 0; i < columns_.size(); ++i)
      if (columns_[i] == column) return int(i);
    return -1;
  }
  /// Place of a column that must be there.
  int require(std::string_view column) const {
    if (const int i = find(column); i >= 0) return i;
    throw InputError(message(name_, ":1: column '", printable(column), "' is missing"));
  }
  /// Throws for the first column that is none of those known.
  template <class Known> void require_known(Known known) const {
    for (const std::string& c : columns_)
      if (!known(std::string_view(c))) throw InputError(message(name_, ":1: column '", printable(c), "' is not known"));
  }

  /// Goes to the next row; false at the end of the file.
  bool next() {
    if (!read_line()) return false;
    if (line_text_.find_first_not_of(" \t") == std::string::npos) {
      while (read_line())
        if (line_text_.find_first_not_of(" \t") != std::string::npos)
          throw InputError(message(name_, ":", line_ - 1, ": is empty, only the end of the file may be"));
      return false;
    }
    split();
    if (fields_.size() != columns_.size())
      throw InputError(message(name_, ":", line_, ": has ", fields_.size(), " fields, the header ", columns_.size()));
    return true;
  }
  std::string_view text(int column) const { return fields_[std::size_t(column)]; }
  /// A finite number.
  double number(int column) const {
    std::string_view f = text(column);
    std::string with_point;
    if (const auto comma = f.find(','); separator_ != ',' && comma != std::string_view::npos) {
      with_point = f;
      with_point[comma] = '.';
      f = with_point;
    }
    double v = 0.0;
    const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
    if (error != std::errc() || end != f.data() + f.size() || !std::isfinite(v)) fail(column, "is no finite number");
    return v;
  }
  /// Whether a field is empty or says that there is no number: nan, NaN, null.
  bool is_blank(int column) const {
    const std::string_view f = text(column);
    return f.empty() || f == "nan" || f == "NaN" || f == "NAN" || f == "-nan" || f == "null";
  }
  std::int64_t integer(int column) const {
    const std::string_view f = text(column);
    std::int64_t v = 0;
    const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
    if (error != std::errc() || end != f.data() + f.size()) fail(column, "is no whole number of 64 bits");
    return v;
  }
  long line() const { return line_; }
  const std::string& name() const { return name_; }
  /// Throws the error of a field: file, line, column, text, reason.
  [[noreturn]] void fail(int column, std::string_view why) const {
    throw InputError(message(name_, ":", line_, ": column ", printable(columns_[std::size_t(column)]), ": '",
        printable(text(column)), "' ", why));
  }

 private:
  bool read_line() {
    line_text_.clear();
    ++line_;
    for (int c = in_.get(); c != std::istream::traits_type::eof(); c = in_.get()) {
      if (c == '\n') {
        if (line_text_.ends_with('\r')) line_text_.pop_back();
        return true;
      }
      if (c == '\0') {
        const bool wide = line_text_.starts_with("\xff\xfe") || line_text_.starts_with("\xfe\xff");
        throw InputError(
            message(name_, ":", line_, ": holds a zero byte, is ", wide ? "UTF-16 and not UTF-8" : "no text"));
      }
      line_text_ += char(c);
      if (line_text_.size() > max_line)
        throw InputError(message(name_, ":", line_, ": is longer than ", max_line, " bytes"));
    }
    if (in_.bad()) throw InputError(message(name_, ":", line_, ": cannot be read"));
    return !line_text_.empty();
  }

  void split() {
    fields_.clear();
    const std::string_view all = line_text_;
    if (const auto quote = all.find('"'); quote != std::string_view::npos)
      throw InputError(message(name_, ":", line_, ": holds a quote at byte ", quote + 1, ", fields are not quoted"));
    for (std::size_t from = 0;;) {
      const std::size_t to = std::min(all.find(separator_, from), all.size());
      std::string_view f = all.substr(from, to - from);
      while (!f.empty() && (f.front() == ' ' || f.front() == '\t')) f.remove_prefix(1);
      while (!f.empty() && (f.back() == ' ' || f.back() == '\t')) f.remove_suffix(1);
      fields_.push_back(f);
      if (fields_.size() > max_columns)
        throw InputError(message(name_, ":", line_, ": has more than ", max_columns, " fields"));
      if (to == all.size()) return;
      from = to + 1;
    }
  }

  std::istream& in_;
  std::string name_, line_text_;
  std::vector<std::string> columns_;
  std::vector<std::string_view> fields_;
  long line_ = 0;
  char separator_ = ',';
};

/// The shortest text that reads back as the same number. Throws InvalidArgument unless it is finite.
inline std::string csv_number(double v) {
  if (!std::isfinite(v)) throw InvalidArgument("a table's number must be finite");
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, v);
  return {buffer, end};
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/devices/photodiodes.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DEVICES_PHOTODIODES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DEVICES_PHOTODIODES_HPP

namespace lumo::sense {

/// One reading of a row of photodiodes.
struct PhotodiodeSample {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd signal_V;
};

/// A row of photodiodes along the finger: the readout without a camera. Values are photocurrents in units of the
/// calibration, (V − dark) · scale.
class PhotodiodeArray {
 public:
  using Sample = PhotodiodeSample;

  struct Config {
    Eigen::VectorXd position_m;  ///< along the finger, ascending
    Eigen::VectorXd dark_V;      ///< without light; empty: 0
    Eigen::VectorXd scale;       ///< per volt; empty: 1
    double full_scale_V = 3.3;   ///< of the converter
  };

  /// Throws InvalidArgument for lengths that differ, positions that do not ascend, or numbers that are not finite.
  explicit PhotodiodeArray(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 2) throw InvalidArgument(message("photodiode array has ", n, " diodes, must have at least 2"));
    if (config_.dark_V.size() == 0) config_.dark_V = Eigen::VectorXd::Zero(n);
    if (config_.scale.size() == 0) config_.scale = Eigen::VectorXd::Ones(n);
    if (config_.dark_V.size() != n || config_.scale.size() != n)
      throw InvalidArgument(message("photodiode array has ", n, " positions, ", config_.dark_V.size(),
          " dark values and ", config_.scale.size(), " scales, must be as many"));
    if (!config_.position_m.allFinite() || !config_.dark_V.allFinite() || !config_.scale.allFinite())
      throw InvalidArgument("photodiode array: numbers must be finite");
    for (Eigen::Index i = 1; i < n; ++i)
      if (!(config_.position_m[i] > config_.position_m[i - 1]))
        throw InvalidArgument(message("photodiode ", i, " is at ", config_.position_m[i],
            " m, must lie beyond its predecessor at ", config_.position_m[i - 1], " m"));
    require_positive("photodiode full scale", config_.full_scale_V, "V");
  }

  bool read(const PhotodiodeSample& sample, Profile& profile) const {
    if (sample.signal_V.size() != config_.position_m.size() || !sample.signal_V.allFinite()) return false;
    profile.stamp_ns = sample.stamp_ns;
    profile.value = (sample.signal_V - config_.dark_V).cwiseProduct(config_.scale);
    profile.saturated =
        double((sample.signal_V.array() >= config_.full_scale_V).count()) / double(sample.signal_V.size());
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return config_.position_m; }

 private:
  Config config_;
};

static_assert(Readout<PhotodiodeArray>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/joint_velocity.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_JOINT_VELOCITY_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_JOINT_VELOCITY_HPP

namespace lumo::sense {

/// Limits of what is believed of a driver's velocities.
struct VelocityLimits {
  double window_s = 0.1;           ///< over which way and velocity are compared
  double moving_rad_per_s = 0.02;  ///< slower joints show nothing (RMS over the windows)
  double wrong_scale = 0.25;       ///< of the scale's distance from 1; noise and delays stay far below
  double smoothing_s = 0.02;       ///< velocities from positions are slopes over as much
  double largest_step_rad = 3.0;   ///< in a window: beyond, an encoder wraps round or jumps
  int least_windows = 10;
};

/// Velocities against the positions of a joint.
struct VelocityCheck {
  bool moves = false;  ///< enough to tell
  double scale = 1.0;  ///< velocity over change of position: 1; 0 where velocities are zeros, 57.3 in degrees
  bool agrees = true;
};

/// Throws InvalidArgument for a joint that the samples do not have.
inline VelocityCheck check_velocity(
    std::span<const JointSample> samples, int joint, const VelocityLimits& limits = {}) {
  VelocityCheck check;
  double ways = 0.0, products = 0.0, seconds = 0.0;
  int windows = 0;
  std::size_t from = 0;
  double integral = 0.0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (joint < 0 || joint >= samples[i].position_rad.size() || joint >= samples[i].velocity_rad_per_s.size())
      throw InvalidArgument(message("velocities: sample ", i, " has no joint ", joint));
    if (i == 0) continue;
    const double step_s = 1e-9 * double(samples[i].stamp_ns - samples[i - 1].stamp_ns);
    integral += 0.5 * step_s * (samples[i].velocity_rad_per_s[joint] + samples[i - 1].velocity_rad_per_s[joint]);
    const double span_s = 1e-9 * double(samples[i].stamp_ns - samples[from].stamp_ns);
    if (span_s < limits.window_s) continue;
    const double way = samples[i].position_rad[joint] - samples[from].position_rad[joint];
    const bool usable = span_s < 2.0 * limits.window_s && std::abs(way) < limits.largest_step_rad &&
                        std::isfinite(way) && std::isfinite(integral);
    if (usable) {
      ways += way * way;
      products += way * integral;
      seconds += span_s;
      ++windows;
    }
    from = i;
    integral = 0.0;
  }
  check.moves =
      windows >= limits.least_windows && std::sqrt(ways / windows) > limits.moving_rad_per_s * seconds / windows;
  if (!check.moves) return check;
  check.scale = products / ways;
  check.agrees = std::abs(check.scale - 1.0) <= limits.wrong_scale;
  return check;
}

/// Slope of a joint's positions over `smoothing_s` about sample i, and over its neighbours at least (least squares); 0
/// for a sample alone.
inline double slope_of_positions(
    std::span<const JointSample> samples, std::size_t i, Eigen::Index joint, double smoothing_s) {
  const double half_s = 0.5 * smoothing_s;
  const auto apart_s = [&](std::size_t k) { return 1e-9 * double(samples[k].stamp_ns - samples[i].stamp_ns); };
  std::size_t a = i > 0 ? i - 1 : i, b = std::min(i + 1, samples.size() - 1);
  while (a > 0 && apart_s(a - 1) >= -half_s) --a;
  while (b + 1 < samples.size() && apart_s(b + 1) <= half_s) ++b;
  double t = 0.0, q = 0.0, tt = 0.0, tq = 0.0;
  for (std::size_t k = a; k <= b; ++k) {
    const double at = apart_s(k), way = samples[k].position_rad[joint] - samples[i].position_rad[joint];
    t += at;
    q += way;
    tt += at * at;
    tq += at * way;
  }
  const double n = double(b - a + 1), det = n * tt - t * t;
  return det > 0.0 ? (n * tq - t * q) / det : 0.0;
}

/// Gives those samples a velocity that have none (an empty vector), from their positions. Throws InputError for
/// positions beyond all bounds.
inline void find_velocities(std::vector<JointSample>& samples, const VelocityLimits& limits = {}) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    JointVector& velocity = samples[i].velocity_rad_per_s;
    const Eigen::Index joints = samples[i].position_rad.size();
    if (velocity.size() == joints) continue;
    velocity.resize(joints);
    for (Eigen::Index j = 0; j < joints; ++j) velocity[j] = slope_of_positions(samples, i, j, limits.smoothing_s);
    if (!velocity.allFinite())
      throw InputError(message("positions about ", samples[i].stamp_ns, " ns are too far apart to give a velocity"));
  }
}

/// Sets the velocity of a joint to the slope of its positions.
inline void take_velocity_from_positions(
    std::vector<JointSample>& samples, int joint, const VelocityLimits& limits = {}) {
  for (std::size_t i = 0; i < samples.size(); ++i)
    samples[i].velocity_rad_per_s[joint] = slope_of_positions(samples, i, joint, limits.smoothing_s);
}

/// Takes the velocities of those joints from the positions that move, but not as their velocities say: zeros, degrees
/// or turns a minute. Returns a line for each, for whoever reads the log. Throws InvalidArgument for positions in
/// degrees.
inline std::vector<std::string> mend_velocities(std::vector<JointSample>& samples, const VelocityLimits& limits = {}) {
  std::vector<std::string> notes;
  if (samples.empty()) return notes;
  const auto joints = int(samples.front().position_rad.size());
  for (int j = 0; j < joints; ++j) {
    const VelocityCheck check = check_velocity(samples, j, limits);
    if (check.agrees) continue;
    const auto [least, most] = std::minmax_element(samples.begin(), samples.end(),
        [j](const JointSample& a, const JointSample& b) { return a.position_rad[j] < b.position_rad[j]; });
    if (std::abs(check.scale * 180.0 / pi - 1.0) <= limits.wrong_scale &&
        most->position_rad[j] - least->position_rad[j] > pi)
      throw InvalidArgument(message("positions of joint ", j,
          " change 57.3 times as fast as its velocities say: they seem to be in degrees, must be in rad"));
    take_velocity_from_positions(samples, j, limits);
    notes.push_back(message("velocities of joint ", j, " are ", 0.01 * std::round(100.0 * check.scale),
        " times the change of its positions"
        " (zeros, or not rad/s); they are taken from the positions"));
  }
  return notes;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/streams.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_STREAMS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_STREAMS_HPP

namespace lumo::sense {

/// The streams of a log.
enum class LogStream { frames, joints, wrenches, markers, photodiodes };
inline constexpr std::size_t log_streams = 5;

/// What was found of a stream as it was read.
struct StreamReading {
  /// Up to this share of the rows is left out for their stamps or gaps; beyond, the stream is faulty.
  static constexpr double most_left_out = 0.05;

  std::string fault;           ///< why the stream is empty although the log has it; empty: no fault
  std::size_t rows = 0;        ///< that the log has
  std::size_t repeated = 0;    ///< of them left out: they have the stamp of another one
  std::size_t backward = 0;    ///< and those whose stamps are against the order of the others
  std::size_t incomplete = 0;  ///< and those that lack a number which is needed
  bool operator==(const StreamReading&) const = default;

  std::size_t left_out() const { return repeated + backward + incomplete; }
  bool is_beyond_limit() const { return double(left_out()) > most_left_out * double(rows); }
};

/// The rows of a stream that can be kept so that stamps ascend strictly.
struct AscendingRows {
  std::vector<std::size_t> kept;
  StreamReading reading;
};

/// Keeps as many rows as possible, and of rows of one stamp the first: a single stamp in the far future costs one row,
/// not all that follow. By the longest ascending sequence (Fredman, 1975).
inline AscendingRows ascending_rows(std::span<const std::int64_t> stamp_ns) {
  std::vector<std::size_t> last, before(stamp_ns.size());  // `last`: row that ends the sequence of each length
  for (std::size_t i = 0; i < stamp_ns.size(); ++i) {
    const auto at = std::lower_bound(
        last.begin(), last.end(), stamp_ns[i], [&](std::size_t row, std::int64_t t) { return stamp_ns[row] < t; });
    if (at != last.end() && stamp_ns[*at] == stamp_ns[i]) continue;
    if (at != last.begin()) before[i] = *(at - 1);
    if (at == last.end()) last.push_back(i);
    else *at = i;
  }
  AscendingRows rows;
  rows.kept.resize(last.size());
  for (std::size_t n = last.size(), row = n > 0 ? last.back() : 0; n > 0; row = before[row]) rows.kept[--n] = row;
  rows.reading.rows = stamp_ns.size();
  std::size_t next = 0;
  for (std::size_t i = 0; i < stamp_ns.size(); ++i) {
    if (next < rows.kept.size() && rows.kept[next] == i) {
      ++next;
      continue;
    }
    const auto same = std::lower_bound(rows.kept.begin(), rows.kept.end(), stamp_ns[i],
        [&](std::size_t row, std::int64_t t) { return stamp_ns[row] < t; });
    ++(same != rows.kept.end() && stamp_ns[*same] == stamp_ns[i] ? rows.reading.repeated : rows.reading.backward);
  }
  return rows;
}

/// The first stamp that does not exceed the one before it, and the share of such rows, for a message. The row is one
/// of `stamp_ns`, which do not ascend strictly.
inline std::string stamps_fault(std::span<const std::int64_t> stamp_ns, const StreamReading& reading, std::size_t row) {
  return message("stamp ", stamp_ns[row], " ns does not exceed the one before it, ", stamp_ns[row - 1], " ns; ",
      reading.left_out(), " of ", reading.rows, " stamps do not ascend, at most ", 100.0 * StreamReading::most_left_out,
      " % are left out");
}

/// The first row whose stamp does not exceed the one before it; 0: there is none.
inline std::size_t first_backward(std::span<const std::int64_t> stamp_ns) {
  for (std::size_t i = 1; i < stamp_ns.size(); ++i)
    if (stamp_ns[i] <= stamp_ns[i - 1]) return i;
  return 0;
}

/// Period of a stream [s], from at least two rows: the mean, or where pauses make that longer the median.
template <class Rows> double stream_period_s(const Rows& rows) {
  constexpr double most_excess = 1.1;  // of the mean over the median: jitter, no pause
  std::vector<std::int64_t> period;
  for (std::size_t i = 1; i < rows.size(); ++i) period.push_back(rows[i].stamp_ns - rows[i - 1].stamp_ns);
  const auto middle = period.begin() + std::ptrdiff_t(period.size() / 2);
  std::nth_element(period.begin(), middle, period.end());
  const double mean = 1e-9 * double(rows.back().stamp_ns - rows.front().stamp_ns) / double(rows.size() - 1);
  return mean > most_excess * 1e-9 * double(*middle) ? 1e-9 * double(*middle) : mean;
}

/// Leaves these rows of a list, which are in ascending order.
template <class Row> void keep_rows(std::vector<Row>& list, const std::vector<std::size_t>& kept) {
  if (kept.size() == list.size()) return;
  for (std::size_t n = 0; n < kept.size(); ++n)
    if (n != kept[n]) list[n] = std::move(list[kept[n]]);
  list.resize(kept.size());
}

/// From a stream's first stamp to its last one.
struct Stretch {
  std::int64_t from_ns = 0, to_ns = 0;

  template <class Rows> static std::optional<Stretch> of(const Rows& rows) {
    if (rows.empty()) return std::nullopt;
    return Stretch{rows.front().stamp_ns, rows.back().stamp_ns};
  }
  bool holds(std::int64_t stamp_ns) const { return stamp_ns >= from_ns && stamp_ns <= to_ns; }
  bool meets(const Stretch& o) const { return std::max(from_ns, o.from_ns) <= std::min(to_ns, o.to_ns); }
};

/// "12.5 to 19.25 s".
inline std::string to_string(const Stretch& s) {
  const auto seconds = [](std::int64_t ns) {
    const std::int64_t ms = ns / 1'000'000;
    std::string digits = std::to_string(ms < 0 ? -(ms % 1000) : ms % 1000);
    digits.insert(0, 3 - digits.size(), '0');
    return (ns < 0 && ms / 1000 == 0 ? "-" : "") + std::to_string(ms / 1000) + '.' + digits;
  };
  return seconds(s.from_ns) + " to " + seconds(s.to_ns) + " s";
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/tables.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_TABLES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_TABLES_HPP

namespace lumo::sense {

// A log is a folder (docs/log_format.md). All tables may be absent. Each has a column stamp_ns or time_s, which ascends
// strictly. Columns stand in any order; unknown ones are errors.
//
// - session.json: circumstances of the log (read by support/json.hpp)
// - frames.csv: file (a path below frames/), exposure_s, gain; beside a video.* it has no column file
// - frames/: 8-bit images, colour or grey
// - joint.csv: position_rad_0, velocity_rad_per_s_0, current_A_0 or torque_Nm_0, position_rad_1, …; joints may have
//   names in place of numbers
// - wrench.csv: force_x_N, force_y_N, force_z_N, and torque_x_Nm, torque_y_Nm, torque_z_Nm or none of the three
// - marker.csv: displacement_m
// - photodiode.csv: signal_V_0, signal_V_1, …

/// A row of frames.csv.
struct FrameRecord {
  std::int64_t stamp_ns = 0;
  std::string file;         ///< below frames/; empty in a video's table
  double exposure_s = 0.0;  ///< 0: unknown
  double gain = 0.0;        ///< 0: unknown
};

/// Name of a log's picture by its number: 000042.png.
inline std::string frame_file(std::size_t number, std::string_view ending = ".png") {
  const std::string digits = std::to_string(number);
  return std::string(digits.size() < 6 ? 6 - digits.size() : 0, '0') + digits + std::string(ending);
}

/// Wrench of the object on the finger by a force/torque sensor, in the finger's frame, about its origin.
struct WrenchSample {
  std::int64_t stamp_ns = 0;
  Vec3d force_N{0.0, 0.0, 0.0};
  Vec3d torque_Nm{0.0, 0.0, 0.0};
  double normal_force_N() const { return -force_N.z(); }  ///< positive if the finger is pressed
};

struct MarkerSample {
  std::int64_t stamp_ns = 0;
  double displacement_m = 0.0;
};

/// The time column of a log's table, as integer nanoseconds; strictly ascending, or made so at the end.
class StampColumn {
 public:
  /// `reading`: counts rows whose stamps do not ascend, which `finish` then leaves out; null: such a row is an error.
  explicit StampColumn(const CsvReader& csv, StreamReading* reading = nullptr)
      : column_(csv.find("stamp_ns")), seconds_(column_ < 0), reading_(reading) {
    if (seconds_) column_ = csv.find("time_s");
    if (column_ < 0) throw InputError(message(csv.name(), ":1: column 'stamp_ns' (or 'time_s') is missing"));
    if (!seconds_ && csv.find("time_s") >= 0)
      throw InputError(message(csv.name(), ":1: has both 'stamp_ns' and 'time_s'"));
  }
  std::int64_t read(const CsvReader& csv) {
    std::int64_t stamp = 0;
    if (seconds_) {
      const double s = csv.number(column_);
      if (std::abs(s) > 1e-9 * double(stamp_limit_ns)) csv.fail(column_, "s is beyond the range of stamps");
      stamp = std::llround(s * 1e9);
    } else {
      stamp = csv.integer(column_);
      if (stamp < -stamp_limit_ns || stamp > stamp_limit_ns) csv.fail(column_, "is beyond the range of stamps");
    }
    if (last_ && stamp <= *last_) {
      if (reading_ == nullptr) csv.fail(column_, "does not exceed the stamp before it");
      if (!backward_line_) backward_line_ = csv.line();
    }
    last_ = stamp;
    if (reading_ != nullptr) all_.push_back(stamp);
    return stamp;
  }
  /// The row that was read last lacks a number: it is left out, too. Throws InputError where such a row is an error.
  void leave_out(const CsvReader& csv, int column) {
    if (reading_ == nullptr) csv.fail(column, "is no finite number");
    if (incomplete_++ == 0) {
      try {
        csv.fail(column, "is no finite number");
      } catch (const InputError& e) {
        incomplete_fault_ = e.what();
      }
    }
    all_.pop_back();
  }
  /// To be called with all rows but those left out: leaves out those whose stamps do not ascend, too. Throws InputError
  /// for too many.
  template <class Row> void finish(const CsvReader& csv, std::vector<Row>& rows) {
    if (reading_ == nullptr) return;
    const AscendingRows ascending = ascending_rows(all_);
    *reading_ = ascending.reading;
    reading_->rows += incomplete_;
    reading_->incomplete = incomplete_;
    const std::string at_most =
        message(" of ", reading_->rows, " rows, at most ", 100.0 * StreamReading::most_left_out, " % are left out");
    if (reading_->is_beyond_limit())
      throw InputError(reading_->incomplete > 0
                           ? message(incomplete_fault_, ", as are some of ", reading_->left_out(), at_most)
                           : message(csv.name(), ':', *backward_line_, ": column ", seconds_ ? "time_s" : "stamp_ns",
                                 " does not exceed the stamp before it, and so do ", reading_->left_out(), at_most));
    keep_rows(rows, ascending.kept);
  }

 private:
  int column_;
  bool seconds_;
  StreamReading* reading_;
  std::optional<std::int64_t> last_;
  std::optional<long> backward_line_;
  std::vector<std::int64_t> all_;
  std::size_t incomplete_ = 0;
  std::string incomplete_fault_;
};

/// A path below a log's frames/ that a table can hold.
inline bool is_below_frames(std::string_view file) {
  const bool plain = std::none_of(
      file.begin(), file.end(), [](char c) { return c == ',' || c == '"' || static_cast<unsigned char>(c) < ' '; });
  return plain && !file.empty() && file.front() != '/' && file.front() != ' ' && file.back() != ' ' &&
         file.find("..") == std::string_view::npos && file.find('\\') == std::string_view::npos;
}

/// Text of a stamp to be written. Throws InvalidArgument for one that StampColumn would refuse.
inline std::string stamp_text(std::int64_t stamp_ns, std::optional<std::int64_t>& last) {
  if (stamp_ns < -stamp_limit_ns || stamp_ns > stamp_limit_ns || (last && stamp_ns <= *last))
    throw InvalidArgument(message("stamp to write is ", stamp_ns, " ns, must lie within 4.6e18 ns",
        last ? message(" and exceed the one before it, ", *last, " ns") : std::string()));
  last = stamp_ns;
  return std::to_string(stamp_ns);
}

inline bool is_time(std::string_view c) { return c == "stamp_ns" || c == "time_s"; }

/// Column of a name with a joint's (diode's) number behind it.
inline std::string numbered(const char* name, int i) { return std::string(name) + '_' + std::to_string(i); }

/// Column of a quantity with a joint's name behind it.
inline std::string named(const char* name, const std::string& joint) { return std::string(name) + '_' + joint; }

/// Opens a file for reading. Throws InputError.
inline std::ifstream open_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(message(path, ": cannot be opened"));
  return in;
}

/// Each of the readers below throws InputError, with file, line and column. With `reading` rows whose stamps do not
/// ascend are left out and counted there, up to its limit; without it such a row is an error.

/// Reads frames.csv. `video`: there is no column `file`. Files must be relative paths without "..".
inline std::vector<FrameRecord> read_frame_log(
    std::istream& in, const std::string& name, bool video = false, StreamReading* reading = nullptr) {
  CsvReader csv(in, name);
  csv.require_known(
      [&](std::string_view c) { return is_time(c) || c == "exposure_s" || c == "gain" || (!video && c == "file"); });
  StampColumn stamp(csv, reading);
  const int file = video ? -1 : csv.require("file"), exposure = csv.find("exposure_s"), gain = csv.find("gain");
  std::vector<FrameRecord> list;
  while (csv.next()) {
    FrameRecord f{stamp.read(csv), "", 0.0, 0.0};
    if (file >= 0) {
      f.file = csv.text(file);
      if (!is_below_frames(f.file)) csv.fail(file, "is no path below frames/");
    }
    if (exposure >= 0 && (f.exposure_s = csv.number(exposure)) < 0.0) csv.fail(exposure, "s is negative");
    if (gain >= 0 && (f.gain = csv.number(gain)) < 0.0) csv.fail(gain, "is negative");
    list.push_back(std::move(f));
  }
  stamp.finish(csv, list);
  return list;
}

/// The samples of a joint.csv, and what its joints are called.
struct JointTable {
  std::vector<std::string> names;  ///< of the samples' joints, in their order; empty: they are numbered
  std::vector<JointSample> samples;
};

namespace detail {

/// Columns of a joint.csv: which joint stands where.
struct JointColumns {
  std::vector<int> position, velocity, effort;  ///< of each joint that is read; velocity −1: there is none
  Effort unit = Effort::torque_Nm;
};

/// What stands behind "position_rad_" in the columns' names, in their order.
inline std::vector<std::string> joints_of(const CsvReader& csv) {
  constexpr std::string_view quantity = "position_rad_";
  std::vector<std::string> names;
  for (const std::string& c : csv.columns())
    if (c.starts_with(quantity)) names.push_back(c.substr(quantity.size()));
  return names;
}

/// Numbers of joints from 0 without gaps, in their order; empty for joints that have names.
inline std::vector<std::string> numbered_joints(const CsvReader& csv) {
  std::vector<std::string> numbers;
  const std::vector<std::string> all = joints_of(csv);
  if (!std::all_of(all.begin(), all.end(), is_joint_number)) return numbers;
  while (numbers.size() < std::size_t(max_joints) && csv.find(numbered("position_rad", int(numbers.size()))) >= 0)
    numbers.push_back(std::to_string(numbers.size()));
  if (numbers.empty()) csv.require("position_rad_0");
  return numbers;
}

inline JointColumns joint_columns(const CsvReader& csv, const std::vector<std::string>& joints, bool all) {
  JointColumns c;
  c.unit = csv.find(named("current_A", joints.front())) >= 0 ? Effort::current_A : Effort::torque_Nm;
  const char* const effort = c.unit == Effort::current_A ? "current_A" : "torque_Nm";
  const bool velocities = csv.find(named("velocity_rad_per_s", joints.front())) >= 0;
  for (const std::string& joint : joints) {
    c.position.push_back(csv.require(named("position_rad", joint)));
    c.velocity.push_back(velocities ? csv.require(named("velocity_rad_per_s", joint)) : -1);
    c.effort.push_back(csv.require(named(effort, joint)));
  }
  const std::vector<std::string> others = all ? std::vector<std::string>() : joints_of(csv);
  csv.require_known([&](std::string_view column) {
    const auto is_of = [&](const std::vector<std::string>& some, std::initializer_list<const char*> quantities) {
      return std::any_of(some.begin(), some.end(), [&](const std::string& joint) {
        return std::any_of(
            quantities.begin(), quantities.end(), [&](const char* q) { return column == named(q, joint); });
      });
    };
    return is_time(column) || is_of(joints, {"position_rad", "velocity_rad_per_s", effort}) ||
           is_of(others, {"position_rad", "velocity_rad_per_s", "current_A", "torque_Nm"});
  });
  return c;
}

}  // namespace detail

/// Reads joint.csv. Joints are numbered from 0 without gaps, or have names; all have a current or all a torque. Of
/// `wanted` joints these are read, in this order, and others need not even have numbers; numbered joints of as many
/// are taken to have these names. Without columns for velocities, or in rows where one is empty or NaN, velocities
/// follow from the positions. A row without a position or an effort is left out as one whose stamp does not ascend.
inline JointTable read_joint_table(std::istream& in, const std::string& name, StreamReading* reading = nullptr,
    const std::vector<std::string>& wanted = {}) {
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  JointTable table;
  const std::vector<std::string> there = detail::joints_of(csv), numbers = detail::numbered_joints(csv);
  const bool has_names = numbers.empty(),
             chosen = !wanted.empty() && (has_names || std::all_of(wanted.begin(), wanted.end(), is_joint_number));
  if (chosen) places_of(wanted, there, name + ":1");
  if (!chosen && !wanted.empty() && wanted.size() != numbers.size())
    throw InputError(message(name, ":1: has ", numbers.size(), " joints by numbers, chosen by name are ", wanted.size(),
        ", ", joint_list(wanted)));
  table.names = !wanted.empty() ? wanted : has_names ? there : std::vector<std::string>();
  const std::vector<std::string>& joints = chosen ? wanted : has_names ? there : numbers;
  if (joints.size() > std::size_t(max_joints))
    throw InputError(message(name, ":1: has ", joints.size(), " joints, must have 1 to ", max_joints));
  const detail::JointColumns column = detail::joint_columns(csv, joints, !chosen);
  const auto n = Eigen::Index(joints.size());
  while (csv.next()) {
    JointSample s{stamp.read(csv), JointVector(n), JointVector(n), JointVector(n), column.unit};
    bool whole = true, with_velocity = column.velocity[0] >= 0;
    for (std::size_t j = 0; j < joints.size() && whole; ++j) {
      for (const int c : {column.position[j], column.effort[j]})
        if (whole && csv.is_blank(c)) {
          stamp.leave_out(csv, c);
          whole = false;
        }
      if (!whole) break;
      s.position_rad[Eigen::Index(j)] = csv.number(column.position[j]);
      s.effort[Eigen::Index(j)] = csv.number(column.effort[j]);
      with_velocity = with_velocity && !csv.is_blank(column.velocity[j]);
      if (with_velocity) s.velocity_rad_per_s[Eigen::Index(j)] = csv.number(column.velocity[j]);
    }
    if (!with_velocity) s.velocity_rad_per_s.resize(0);
    if (whole) table.samples.push_back(std::move(s));
  }
  stamp.finish(csv, table.samples);
  find_velocities(table.samples);
  return table;
}

/// Its samples alone.
inline std::vector<JointSample> read_joint_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  return read_joint_table(in, name, reading).samples;
}

/// Reads wrench.csv; torques may be absent altogether.
inline std::vector<WrenchSample> read_wrench_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  static constexpr const char* forces[] = {"force_x_N", "force_y_N", "force_z_N"};
  static constexpr const char* torques[] = {"torque_x_Nm", "torque_y_Nm", "torque_z_Nm"};
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  bool with_torque = false;
  for (const char* t : torques) with_torque = with_torque || csv.find(t) >= 0;
  int column[6] = {};
  for (int k = 0; k < 3; ++k) {
    column[k] = csv.require(forces[k]);
    column[3 + k] = with_torque ? csv.require(torques[k]) : -1;
  }
  csv.require_known([&](std::string_view c) {
    bool known = is_time(c);
    for (int k = 0; k < 3; ++k) known = known || c == forces[k] || c == torques[k];
    return known;
  });
  std::vector<WrenchSample> list;
  while (csv.next()) {
    WrenchSample w;
    w.stamp_ns = stamp.read(csv);
    for (int k = 0; k < 3; ++k) {
      w.force_N[k] = csv.number(column[k]);
      if (with_torque) w.torque_Nm[k] = csv.number(column[3 + k]);
    }
    list.push_back(w);
  }
  stamp.finish(csv, list);
  return list;
}

/// Reads marker.csv.
inline std::vector<MarkerSample> read_marker_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  const int place = csv.require("displacement_m");
  csv.require_known([](std::string_view c) { return is_time(c) || c == "displacement_m"; });
  std::vector<MarkerSample> list;
  while (csv.next()) {
    const std::int64_t at = stamp.read(csv);
    list.push_back({at, csv.number(place)});
  }
  stamp.finish(csv, list);
  return list;
}

/// Reads photodiode.csv: stamp_ns (or time_s), signal_V_0, signal_V_1, … without gaps in the numbers. Throws
/// InputError.
inline std::vector<PhotodiodeSample> read_photodiode_log(
    std::istream& in, const std::string& name, StreamReading* reading = nullptr) {
  CsvReader csv(in, name);
  StampColumn stamp(csv, reading);
  std::vector<int> column;
  while (csv.find(numbered("signal_V", int(column.size()))) >= 0)
    column.push_back(csv.find(numbered("signal_V", int(column.size()))));
  if (column.empty()) csv.require("signal_V_0");
  csv.require_known([&](std::string_view c) {
    bool known = is_time(c);
    for (std::size_t i = 0; i < column.size(); ++i) known = known || c == numbered("signal_V", int(i));
    return known;
  });
  std::vector<PhotodiodeSample> list;
  while (csv.next()) {
    PhotodiodeSample s{stamp.read(csv), Eigen::VectorXd(Eigen::Index(column.size()))};
    for (std::size_t i = 0; i < column.size(); ++i) s.signal_V[Eigen::Index(i)] = csv.number(column[i]);
    list.push_back(std::move(s));
  }
  stamp.finish(csv, list);
  return list;
}

inline std::string frame_header(bool video) {
  return video ? "stamp_ns,exposure_s,gain\n" : "stamp_ns,file,exposure_s,gain\n";
}

inline std::string frame_row(const FrameRecord& f, bool video, std::optional<std::int64_t>& last) {
  if (!video && !is_below_frames(f.file))
    throw InvalidArgument("frame log: a file is no path below frames/, or holds a comma, quote or line's end");
  if (f.exposure_s < 0.0 || f.gain < 0.0)
    throw InvalidArgument(
        message("frame log: exposure is ", f.exposure_s, " s, gain ", f.gain, ", must not be negative"));
  return stamp_text(f.stamp_ns, last) + ',' + (video ? "" : f.file + ',') + csv_number(f.exposure_s) + ',' +
         csv_number(f.gain) + '\n';
}

inline std::string joint_header(const std::vector<std::string>& joints, Effort unit) {
  std::string t = "stamp_ns";
  for (const std::string& joint : joints)
    for (const char* column :
        {"position_rad", "velocity_rad_per_s", unit == Effort::current_A ? "current_A" : "torque_Nm"})
      t += ',' + named(column, joint);
  return t + '\n';
}

inline std::string joint_header(int joints, Effort unit) {
  std::vector<std::string> numbers;
  for (int j = 0; j < joints; ++j) numbers.push_back(std::to_string(j));
  return joint_header(numbers, unit);
}

inline std::string joint_row(const JointSample& s, std::optional<std::int64_t>& last) {
  std::string t = stamp_text(s.stamp_ns, last);
  for (Eigen::Index j = 0; j < s.effort.size(); ++j)
    t +=
        ',' + csv_number(s.position_rad[j]) + ',' + csv_number(s.velocity_rad_per_s[j]) + ',' + csv_number(s.effort[j]);
  return t + '\n';
}

/// The tables as text, with numbers that read back as they were. They throw InvalidArgument for values that the readers
/// refuse.
inline std::string frame_log_text(const std::vector<FrameRecord>& frames, bool video = false) {
  std::string t = frame_header(video);
  std::optional<std::int64_t> last;
  for (const FrameRecord& f : frames) t += frame_row(f, video, last);
  return t;
}

/// `names`: of the joints; empty: they are numbered.
inline std::string joint_log_text(const std::vector<JointSample>& samples, const std::vector<std::string>& names = {}) {
  if (samples.empty()) return joint_header(1, Effort::current_A);
  const auto joints = samples.front().effort.size();
  const Effort unit = samples.front().unit;
  if (!names.empty() && (names.size() != std::size_t(joints) || !are_column_names(names)))
    throw InvalidArgument(
        message("joint log: ", joints, " joints cannot have columns of the names ", joint_list(names)));
  std::string t = names.empty() ? joint_header(int(joints), unit) : joint_header(names, unit);
  std::optional<std::int64_t> last;
  for (const JointSample& s : samples) {
    if (s.effort.size() != joints || s.position_rad.size() != joints || s.velocity_rad_per_s.size() != joints ||
        s.unit != unit)
      throw InvalidArgument("joint log: samples must have the same number of joints and the same kind of effort");
    t += joint_row(s, last);
  }
  return t;
}

inline std::string wrench_log_text(const std::vector<WrenchSample>& samples) {
  std::string t = "stamp_ns,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm\n";
  std::optional<std::int64_t> last;
  for (const WrenchSample& w : samples) {
    t += stamp_text(w.stamp_ns, last);
    for (const Vec3d& v : {w.force_N, w.torque_Nm})
      for (int k = 0; k < 3; ++k) t += ',' + csv_number(v[k]);
    t += '\n';
  }
  return t;
}

inline std::string marker_log_text(const std::vector<MarkerSample>& samples) {
  std::string t = "stamp_ns,displacement_m\n";
  std::optional<std::int64_t> last;
  for (const MarkerSample& m : samples) t += stamp_text(m.stamp_ns, last) + ',' + csv_number(m.displacement_m) + '\n';
  return t;
}

inline std::string photodiode_log_text(const std::vector<PhotodiodeSample>& samples) {
  std::string t = "stamp_ns";
  const auto n = samples.empty() ? Eigen::Index(1) : samples.front().signal_V.size();
  for (Eigen::Index i = 0; i < n; ++i) t += ',' + numbered("signal_V", int(i));
  t += '\n';
  std::optional<std::int64_t> last;
  for (const PhotodiodeSample& s : samples) {
    if (s.signal_V.size() != n) throw InvalidArgument("photodiode log: samples must have the same number of diodes");
    t += stamp_text(s.stamp_ns, last);
    for (Eigen::Index i = 0; i < n; ++i) t += ',' + csv_number(s.signal_V[i]);
    t += '\n';
  }
  return t;
}

}  // namespace lumo::sense

#endif

// ---- lumo/lab/hand_lab.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_HAND_LAB_HPP
#define SINGLE_INCLUDE_LUMO_LAB_HAND_LAB_HPP

namespace lumo {

using HandJoints = std::array<double, 4>;  ///< proximal and distal of the left finger, then of the right; bending
                                           ///< inwards is positive [rad]

/// Something that presses on a link: 0 and 1 are the left finger's, from proximal to distal, 2 and 3 the right one's.
struct HandTouch {
  int link;
  double y_m, load_N;
};

/// A grasp: what the hand looks like while it holds, and what presses where.
struct HandGrasp {
  HandJoints joints_rad;
  std::vector<HandTouch> touches;
};

/// The joints sweep their workspace without contact, then grasp after grasp is closed, held and opened.
struct HandPlan {
  std::string title = "grasps of a hand with two fingers";
  int sweep_steps = 6;                   ///< of each joint, there and back
  double low_rad = 0.0, high_rad = 0.4;  ///< of the sweep; the fingers then do not meet
  double speed_rad_per_s = 0.5;
  double close_s = 0.4, hold_s = 0.8;
  std::vector<HandGrasp> grasps;
};

/// `count` grasps with one to four links touched, drawn from a seed; loads of 5 to 15 N, places within ±22 mm, or the
/// nearest ones of `places_m`.
inline HandPlan hand_plan(std::uint64_t seed, int count = 12, const std::vector<double>& places_m = {}) {
  require_in_range("number of grasps", count, 1, 1000, "");
  HandPlan plan;
  RandomStream draws(seed, 40);
  for (int g = 0; g < count; ++g) {
    HandGrasp grasp;
    for (double& q : grasp.joints_rad)
      q = plan.low_rad + (plan.high_rad - plan.low_rad) * (0.1 + 0.8 * draws.uniform());
    const int links = 1 + g % 4, first = int(4.0 * draws.uniform());
    for (int k = 0; k < links; ++k) {
      double y = (2.0 * draws.uniform() - 1.0) * 22.0_mm;
      const auto nearer = [y](double a, double b) { return std::abs(a - y) < std::abs(b - y); };
      if (!places_m.empty()) y = *std::min_element(places_m.begin(), places_m.end(), nearer);
      grasp.touches.push_back({(first + k) % 4, y, 5.0 + 10.0 * draws.uniform()});
    }
    std::sort(grasp.touches.begin(), grasp.touches.end(),
        [](const HandTouch& a, const HandTouch& b) { return a.link < b.link; });
    plan.grasps.push_back(std::move(grasp));
  }
  return plan;
}

/// What really pressed on the hand at a frame.
struct HandTruth {
  std::int64_t stamp_ns = 0;
  HandJoints joints_rad{};
  std::vector<HandTouch> touches;  ///< with the loads of this moment
};

/// truth.csv of a hand: stamp_ns, link, y_mm, force_N; a row for each touch of each frame.
inline std::string truth_text(const std::vector<HandTruth>& truth) {
  std::string t = "stamp_ns,link,y_mm,force_N\n";
  for (const HandTruth& s : truth)
    for (const HandTouch& c : s.touches)
      t += std::to_string(s.stamp_ns) + ',' + std::to_string(c.link) + ',' + sense::csv_number(1e3 * c.y_m) + ',' +
           sense::csv_number(c.load_N) + '\n';
  return t;
}

/// Two fingers of two links each that bend in the plane of the picture, towards each other; the camera looks along
/// their joints. Every number is assumed. The distance of the fingers and the range of their joints were changed once
/// after the first pictures, in which the fingers ran into each other; all else was fixed before.
struct HandRig {
  Rig rig;                        ///< camera, lamps, specimen and motors, as for one finger
  SideGeometry side;              ///< of the pad on each link
  int width = 640, height = 480;  ///< of the picture [px]
  double scale_m_per_px = 0.55_mm;
  double link_m = 68.0_mm;                         ///< from joint to joint, and from the last joint to the tip
  double base_x_m = 92.0_mm, base_y_m = 120.0_mm;  ///< of the first joints: ± across the picture's middle, and below it
  double carrier_m = 8.0_mm;                       ///< how far the carrier's side reaches behind the pad
  double carrier_DN = 90.0, hole_DN = 14.0, ground_DN = 8.0;
  std::array<double, 2> hole_y_m{-22.0_mm, 22.0_mm};
  double hole_z_m = -4.0_mm, hole_radius_m = 1.8_mm;
  double edge_m = 1.0_mm;          ///< of the pad's side, above and below, that an observer leaves out
  double joint_sigma_rad = 0.002;  ///< σ of a joint's reading
};

/// A hand, a camera and four joints that go through a plan and leave a log as a real rig would. All four links carry
/// the same pad, whose light comes from computed responses, in equilibrium (no relaxation). A pure function of
/// responses, plan, seed and `noise`.
class HandLab {
 public:
  /// `light` stays the caller's. Throws InvalidArgument for places and loads beyond those computed, or a grasp in which
  /// a link leaves the picture.
  HandLab(const PadLight& light, HandPlan plan, std::uint64_t seed = 1, double noise = 1.0, const HandRig& hand = {});

  const sense::Session& session() const { return session_; }
  const std::vector<sense::FrameRecord>& frames() const { return frames_; }
  const std::vector<sense::JointSample>& joints() const { return joints_; }
  const std::vector<HandTruth>& truth() const { return truth_; }
  const HandPlan& plan() const { return plan_; }
  /// Picture k; the same whenever it is asked for.
  sense::Image image(std::size_t k) const;
  /// Where a link really is in the image.
  sense::LinkMap map(int link, const HandJoints& joints) const;

 private:
  // Times of every plan; assumed.
  static constexpr double first_rest_s = 0.5, pause_s = 0.3, settle_s = 0.05, first_frame_s = 0.01;

  void check_plan() const;
  void sweep_workspace();
  void describe_links();
  void close_grasps();
  void record_frames();
  void record_joints();
  void add_segment(double from_s, double to_s, sense::SegmentKind kind) {
    session_.segments.push_back({lab_stamp(from_s), lab_stamp(to_s), kind});
  }

  struct Key {
    double t_s;
    HandJoints joints;
    int grasp;     ///< whose touches there are, −1: none
    double share;  ///< of their loads
  };
  void move_to(const HandJoints& joints) {
    double way = 0.0;
    for (std::size_t k = 0; k < 4; ++k) way = std::max(way, std::abs(joints[k] - keys_.back().joints[k]));
    keys_.push_back({keys_.back().t_s + way / plan_.speed_rad_per_s + settle_s, joints, -1, 0.0});
  }
  HandTruth at(double t_s) const;
  void require_seen(const HandJoints& joints) const {
    for (int l = 0; l < 4; ++l)
      for (const double y : {-hand_.side.half_length_m, hand_.side.half_length_m})
        for (const double z : {-hand_.carrier_m, hand_.side.high_m}) {
          const auto p = map(l, joints).pixel(y, z);
          if (!(p.x() >= 0.0 && p.y() >= 0.0 && p.x() <= hand_.width - 1 && p.y() <= hand_.height - 1))
            throw InvalidArgument(message("link ", l, " leaves the picture at ", p.x(), ", ", p.y(), " px of ",
                hand_.width, " x ", hand_.height));
        }
  }

  const PadLight* light_;
  HandPlan plan_;
  std::uint64_t seed_;
  double noise_, per_DN_;
  HandRig hand_;
  sense::Session session_;
  std::vector<Key> keys_;
  std::vector<sense::FrameRecord> frames_;
  std::vector<sense::JointSample> joints_;
  std::vector<HandTruth> truth_;
  std::vector<double> lamps_, room_DN_;
};

inline auto HandLab::map(int link, const HandJoints& joints) const -> sense::LinkMap {
  const bool right = link >= 2;
  const double inwards = right ? -1.0 : 1.0, length = hand_.link_m / hand_.scale_m_per_px;
  Eigen::Vector2d at(0.5 * (hand_.width - 1) + (right ? 1.0 : -1.0) * hand_.base_x_m / hand_.scale_m_per_px,
      0.5 * (hand_.height - 1) + hand_.base_y_m / hand_.scale_m_per_px);
  double turn = -0.5 * pi + inwards * joints[right ? 2 : 0];  // image rows run down: −90° points up
  if (link % 2 == 1) {
    at += length * Eigen::Vector2d(std::cos(turn), std::sin(turn));
    turn += inwards * joints[std::size_t(link)];
  }
  const Eigen::Vector2d along(std::cos(turn), std::sin(turn));
  sense::LinkMap m;
  m.origin_px = at + 0.5 * length * along;
  m.along_px_per_m = along / hand_.scale_m_per_px;
  m.z_clockwise = !right;  // the pads face each other
  return m;
}

inline HandLab::HandLab(const PadLight& light, HandPlan plan, std::uint64_t seed, double noise, const HandRig& hand)
    : light_(&light),
      plan_(std::move(plan)),
      seed_(seed),
      noise_(noise),
      per_DN_(light.exposure(hand.rig.camera)),
      hand_(hand) {
  check_plan();
  session_.title = plan_.title;
  session_.clock = "virtual";
  session_.material = light.responses().material;
  session_.theta_mm = light.responses().theta_mm;
  session_.torque_constant_Nm_per_A.assign(4, hand_.rig.motor.torque_constant_Nm_per_A);
  sweep_workspace();
  describe_links();
  close_grasps();
  record_frames();
  record_joints();
}

inline void HandLab::check_plan() const {
  validate(hand_.rig);
  require_in_range("noise of the virtual lab", noise_, 0.0, 100.0, "");
  require_in_range("steps of the hand's sweep", plan_.sweep_steps, 2, 100, "");
  require_positive("speed of the hand's joints", plan_.speed_rad_per_s, "rad/s");
  for (const HandGrasp& g : plan_.grasps) {
    require_seen(g.joints_rad);
    for (const HandTouch& c : g.touches) {
      require_in_range("link of a touch", c.link, 0, 3, "");
      light_->require_reached("place of a touch", c.y_m);
      require_in_range("load of a touch", c.load_N, 0.0, hand_.rig.specimen.bears_N(light_->max_load_N()), "N");
    }
  }
}

inline void HandLab::sweep_workspace() {
  // Both fingers alike, to and fro.
  const auto node = [&](int k) {
    return plan_.low_rad + (plan_.high_rad - plan_.low_rad) * k / (plan_.sweep_steps - 1);
  };
  keys_.push_back({0.0, {plan_.low_rad, plan_.low_rad, plan_.low_rad, plan_.low_rad}, -1, 0.0});
  keys_.push_back({first_rest_s, keys_.back().joints, -1, 0.0});
  for (int i = 0; i < plan_.sweep_steps; ++i)
    for (int j = 0; j < plan_.sweep_steps; ++j) {
      const double a = node(i), b = node(i % 2 == 0 ? j : plan_.sweep_steps - 1 - j);
      move_to({a, b, a, b});
    }
  add_segment(0.0, keys_.back().t_s, sense::SegmentKind::free);
}

inline void HandLab::describe_links() {
  for (int l = 0; l < 4; ++l) {
    const bool right = l >= 2;
    sense::SessionLink s;
    s.link.name = std::string(right ? "right" : "left") + (l % 2 == 0 ? " proximal" : " distal");
    s.link.joints = l % 2 == 0 ? std::vector<int>{l} : std::vector<int>{l - 1, l};
    s.link.hole_m.resize(2, 2);
    s.hole_px.resize(2, 2);
    s.link.hole_radius_m = hand_.hole_radius_m;
    s.link.z_clockwise = !right;
    s.link.z_low_m = hand_.side.low_m + hand_.edge_m;
    s.link.z_high_m = hand_.side.high_m - hand_.edge_m;
    for (int k = 0; k < 2; ++k) {
      s.link.hole_m.col(k) << hand_.hole_y_m[std::size_t(k)], hand_.hole_z_m;
      s.hole_px.col(k) =
          map(l, keys_.front().joints).pixel(hand_.hole_y_m[std::size_t(k)], hand_.hole_z_m).array().round();
    }
    session_.links.push_back(std::move(s));
  }
}

inline void HandLab::close_grasps() {
  for (int g = 0; g < int(plan_.grasps.size()); ++g) {
    const HandGrasp& grasp = plan_.grasps[std::size_t(g)];
    move_to(grasp.joints_rad);
    double t = keys_.back().t_s;
    keys_.push_back({t + pause_s, grasp.joints_rad, -1, 0.0});
    t += pause_s;
    keys_.push_back({t, grasp.joints_rad, g, 0.0});
    keys_.push_back({t + plan_.close_s, grasp.joints_rad, g, 1.0});
    keys_.push_back({t + plan_.close_s + plan_.hold_s, grasp.joints_rad, g, 1.0});
    keys_.push_back({t + 2.0 * plan_.close_s + plan_.hold_s, grasp.joints_rad, g, 0.0});
    add_segment(t + plan_.close_s, t + plan_.close_s + plan_.hold_s, sense::SegmentKind::hold);
  }
}

inline void HandLab::record_frames() {
  const CameraRig& c = hand_.rig.camera;
  const LightRig& l = hand_.rig.light;
  LampNoise lamps(l, seed_, 48);
  SlowNoise room(RandomStream(seed_, 49), l.ambient_drift_s);
  RandomStream jitter(seed_, 51);
  for (double t = first_frame_s; t < keys_.back().t_s; t += 1.0 / c.frames_per_s) {
    HandTruth truth = at(t);
    truth.stamp_ns = lab_stamp(t + noise_ * c.stamp_sigma_s * jitter.normal());
    frames_.push_back({truth.stamp_ns, sense::frame_file(frames_.size()), c.exposure_s, c.gain});
    truth_.push_back(std::move(truth));
    lamps_.push_back(hand_.rig.specimen.lamps * (1.0 + noise_ * lamps.at(t)));
    room_DN_.push_back(l.ambient_DN * (1.0 + noise_ * l.ambient_drift * room.at(t)));
  }
}

inline void HandLab::record_joints() {
  RandomStream read(seed_, 52);
  HandJoints before = keys_.front().joints;
  for (double t = 0.0; t < keys_.back().t_s; t += 1.0 / hand_.rig.motor.hz) {
    const HandTruth now = at(t);
    sense::JointSample s{lab_stamp(t), sense::JointVector(4), sense::JointVector(4), sense::JointVector::Zero(4),
        sense::Effort::current_A};
    for (int k = 0; k < 4; ++k) {
      s.position_rad[k] = now.joints_rad[std::size_t(k)] + noise_ * hand_.joint_sigma_rad * read.normal();
      s.velocity_rad_per_s[k] = (now.joints_rad[std::size_t(k)] - before[std::size_t(k)]) * hand_.rig.motor.hz;
    }
    before = now.joints_rad;
    joints_.push_back(std::move(s));
  }
}

inline auto HandLab::at(double t_s) const -> HandTruth {
  std::size_t k = 0;
  while (k + 2 < keys_.size() && keys_[k + 1].t_s <= t_s) ++k;
  const Key &a = keys_[k], &b = keys_[k + 1];
  const double share = b.t_s > a.t_s ? std::clamp((t_s - a.t_s) / (b.t_s - a.t_s), 0.0, 1.0) : 1.0;
  HandTruth truth;
  for (std::size_t j = 0; j < 4; ++j) truth.joints_rad[j] = a.joints[j] + share * (b.joints[j] - a.joints[j]);
  const double load = a.share + share * (b.share - a.share);
  if (a.grasp >= 0 && a.grasp == b.grasp && load > 0.0)
    for (HandTouch c : plan_.grasps[std::size_t(a.grasp)].touches) {
      c.load_N *= load;
      truth.touches.push_back(c);
    }
  return truth;
}

inline sense::Image HandLab::image(std::size_t k) const {
  struct Seen {
    sense::LinkMap map;
    double c, s;  ///< cosine and sine of its turn
    Eigen::VectorXd light;
  };
  const HandTruth& truth = truth_.at(k);
  std::vector<Seen> links;
  for (int l = 0; l < 4; ++l) {
    Eigen::VectorXd light = light_->responses().unloaded;
    for (const HandTouch& c : truth.touches)
      if (c.link == l) light += light_->change(c.y_m, c.load_N / hand_.rig.specimen.stiffness, 0.0);
    const sense::LinkMap m = map(l, truth.joints_rad);
    const double scale = m.px_per_m();
    links.push_back({m, m.along_px_per_m.x() / scale, m.along_px_per_m.y() / scale, per_DN_ * lamps_[k] * light});
  }
  const Eigen::VectorXd& position = light_->responses().position_m;
  const double spacing = position[1] - position[0], blur = hand_.rig.camera.blur_px * hand_.scale_m_per_px,
               room = room_DN_[k];
  const auto edge = [&](double distance) { return std::clamp(0.5 + 0.5 * distance / (1.5 * blur), 0.0, 1.0); };
  sense::Image image = sense::Image::black(hand_.width, hand_.height, sense::PixelFormat::grey);
  RandomStream draws(seed_, 100000 + k), sensitivity(seed_, 53);
  for (int v = 0; v < hand_.height; ++v) {
    std::uint8_t* row = image.row(v);
    const double row_offset = noise_ * hand_.rig.camera.row_DN * draws.normal();
    for (int u = 0; u < hand_.width; ++u) {
      double signal = hand_.ground_DN;
      for (const Seen& l : links) {
        const double du = (u - l.map.origin_px.x()) * hand_.scale_m_per_px,
                     dv = (v - l.map.origin_px.y()) * hand_.scale_m_per_px, side = l.map.z_clockwise ? 1.0 : -1.0;
        const double y = du * l.c + dv * l.s, z = side * (-du * l.s + dv * l.c),
                     end = hand_.side.half_length_m - std::abs(y);
        if (end < -3.0 * blur || z < -hand_.carrier_m - 3.0 * blur || z > hand_.side.high_m + 3.0 * blur) continue;
        const double carrier = edge(end) * edge(hand_.side.low_m - z) * edge(z + hand_.carrier_m),
                     pad = edge(end) * edge(z - hand_.side.low_m) * edge(hand_.side.high_m - z);
        double hole = 0.0;
        for (const double at : hand_.hole_y_m)
          hole = std::max(hole, edge(hand_.hole_radius_m - std::hypot(y - at, z - hand_.hole_z_m)));
        const double behind = std::max(carrier, pad);
        signal =
            (1.0 - behind) * signal + carrier * (hole * hand_.hole_DN + (1.0 - hole) * hand_.carrier_DN) + pad * room;
        if (pad > 0.0) {
          const double place = std::clamp((y - position[0]) / spacing, 0.0, double(position.size() - 1) - 1e-9);
          const auto bin = Eigen::Index(place);
          signal += pad * ((1.0 - (place - double(bin))) * l.light[bin] + (place - double(bin)) * l.light[bin + 1]);
          for (const double at : hand_.side.lamp_m) {
            const double d = std::hypot(y - at, z - hand_.side.lamp_height_m) / hand_.rig.light.spot_sigma_m;
            if (d < 5.0) signal += pad * lamps_[k] * hand_.rig.light.spot_DN * std::exp(-0.5 * d * d);
          }
        }
      }
      signal *= 1.0 + noise_ * hand_.rig.camera.pixel_gain * sensitivity.normal();
      row[u] = sensed(hand_.rig.camera, signal, noise_, draws.normal(), row_offset);
    }
  }
  return image;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/predicates.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_PREDICATES_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_PREDICATES_HPP

// Exact signs of orientation determinants. A rounded value with an error bound decides nearly always; what is too close
// to call is computed without error as an unevaluated sum of doubles of falling size. Own code: exact predicates of
// libraries come with CGAL or as C that sets the processor's rounding. Source: Shewchuk 1997, Adaptive
// precision floating-point arithmetic and fast robust geometric predicates; his error bounds, his expansions, without
// his intermediate stages. Needs IEEE doubles rounded to nearest (no -ffast-math); exact as long as nothing overflows
// or underflows (lengths 1e-60 … 1e60).

namespace lumo {

using Point2 = std::array<double, 2>;

/// Sign of (b − a) × (c − a): +1 if a, b, c turn left, −1 right, 0 if they are exactly on a line.
inline int orient2d(const Point2& a, const Point2& b, const Point2& c);

/// Sign of (b − a) × (c − a) · (d − a): +1 if d is on the side from which a, b, c run counter-clockwise, 0 if exactly
/// in the plane.
inline int orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

namespace detail {

inline constexpr double half_ulp = 0.5 * std::numeric_limits<double>::epsilon();

/// A sum of doubles that do not overlap, smallest first, without zeros.
struct Expansion {
  std::size_t size = 0;
  std::array<double, 192> parts;  // as many as a 3 × 3 determinant of differences can need

  void push(double part) {
    if (part != 0.0) parts[size++] = part;
  }
  int sign() const { return size == 0 ? 0 : parts[size - 1] > 0.0 ? 1 : -1; }
};

struct SumAndError {
  double sum;
  double error;
};

inline SumAndError two_sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  const double a_part = sum - b_part;
  return {sum, (a - a_part) + (b - b_part)};
}

/// a − b without error.
inline Expansion exact_difference(double a, double b) {
  const auto [sum, error] = two_sum(a, -b);
  Expansion result;
  result.push(error);
  result.push(sum);
  return result;
}

/// Merges by size, then carries the rounding errors along.
inline Expansion operator+(const Expansion& e, const Expansion& f) {
  Expansion result;
  double carry = 0.0;
  for (std::size_t i = 0, j = 0; i < e.size || j < f.size;) {
    const bool from_e = j == f.size || (i < e.size && std::abs(e.parts[i]) < std::abs(f.parts[j]));
    const auto [sum, error] = two_sum(carry, from_e ? e.parts[i++] : f.parts[j++]);
    result.push(error);
    carry = sum;
  }
  result.push(carry);
  return result;
}

inline Expansion operator*(const Expansion& e, double factor) {
  Expansion result;
  double carry = 0.0;
  for (std::size_t i = 0; i < e.size; ++i) {
    const double product = e.parts[i] * factor;
    const double tail = std::fma(e.parts[i], factor, -product);
    const auto low = two_sum(carry, tail);
    const auto high = two_sum(product, low.sum);
    result.push(low.error);
    result.push(high.error);
    carry = high.sum;
  }
  result.push(carry);
  return result;
}

inline Expansion operator*(const Expansion& e, const Expansion& f) {  // f is a difference: at most two parts
  Expansion result;
  for (std::size_t i = 0; i < f.size; ++i) result = result + e * f.parts[i];
  return result;
}

/// a d − b c of differences, without error.
inline Expansion exact_minor(const Expansion& a, const Expansion& b, const Expansion& c, const Expansion& d) {
  return a * d + (b * c) * -1.0;
}

}  // namespace detail

/// The sign if rounding errors cannot change it, else 0.
inline int sure_orient2d(const Point2& a, const Point2& b, const Point2& c) {
  const double left = (b[0] - a[0]) * (c[1] - a[1]);
  const double right = (b[1] - a[1]) * (c[0] - a[0]);
  const double bound = 4.0 * detail::half_ulp * (std::abs(left) + std::abs(right));
  return left - right > bound ? 1 : left - right < -bound ? -1 : 0;
}

/// The sign if rounding errors cannot change it, else 0.
inline int sure_orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  const Vec3d u = b - a;
  const Vec3d v = c - a;
  const Vec3d w = d - a;
  double value = 0.0;
  double size = 0.0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double left = u[j] * v[k];
    const double right = u[k] * v[j];
    value += w[i] * (left - right);
    size += std::abs(w[i]) * (std::abs(left) + std::abs(right));
  }
  const double bound = 8.0 * detail::half_ulp * size;
  return value > bound ? 1 : value < -bound ? -1 : 0;
}

inline int orient2d(const Point2& a, const Point2& b, const Point2& c) {
  if (const int sure = sure_orient2d(a, b, c); sure != 0) return sure;
  return detail::exact_minor(detail::exact_difference(b[0], a[0]), detail::exact_difference(b[1], a[1]),
      detail::exact_difference(c[0], a[0]), detail::exact_difference(c[1], a[1]))
      .sign();
}

inline int orient3d(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  if (const int sure = sure_orient3d(a, b, c, d); sure != 0) return sure;
  std::array<std::array<detail::Expansion, 3>, 3> rows;
  for (int k = 0; k < 3; ++k) {
    rows[0][static_cast<std::size_t>(k)] = detail::exact_difference(b[k], a[k]);
    rows[1][static_cast<std::size_t>(k)] = detail::exact_difference(c[k], a[k]);
    rows[2][static_cast<std::size_t>(k)] = detail::exact_difference(d[k], a[k]);
  }
  detail::Expansion sum;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    const std::size_t k = (i + 2) % 3;
    sum = sum + detail::exact_minor(rows[0][j], rows[0][k], rows[1][j], rows[1][k]) * rows[2][i];
  }
  return sum.sign();
}

}  // namespace lumo

#endif

// ---- lumo/geometry/facet_triangles.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_FACET_TRIANGLES_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_FACET_TRIANGLES_HPP

namespace lumo {

/// A triangle of a surface, by vertex numbers, and the facet that it is part of.
struct SurfaceTriangle {
  std::array<int, 3> corners;
  int facet;
};

/// Twice the area vector of a polygon (Newell's sum), taken about its first corner to keep digits.
inline Vec3d polygon_normal(const std::vector<Vec3d>& vertices, const std::vector<int>& loop) {
  const Vec3d& origin = vertices[static_cast<std::size_t>(loop[0])];
  Vec3d sum = Vec3d::Zero();
  for (std::size_t i = 1; i + 1 < loop.size(); ++i)
    sum += (vertices[static_cast<std::size_t>(loop[i])] - origin)
               .cross(vertices[static_cast<std::size_t>(loop[i + 1])] - origin);
  return sum;
}

/// Drops one coordinate and keeps the sense of rotation of what faces along `normal`. Exact: nothing is computed.
struct Projection {
  std::size_t first = 0;
  std::size_t second = 1;

  explicit Projection(const Vec3d& normal) {
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    first = static_cast<std::size_t>((axis + 1) % 3);
    second = static_cast<std::size_t>((axis + 2) % 3);
    if (normal[axis] < 0.0) std::swap(first, second);
  }
  Point2 operator()(const Vec3d& p) const {
    return {p[static_cast<Eigen::Index>(first)], p[static_cast<Eigen::Index>(second)]};
  }
};

/// Whether p, known to be on the line through a and b, is between them or at an end.
inline bool between_ends(const Point2& a, const Point2& b, const Point2& p) {
  const std::size_t axis = std::abs(b[0] - a[0]) >= std::abs(b[1] - a[1]) ? 0 : 1;
  return std::min(a[axis], b[axis]) <= p[axis] && p[axis] <= std::max(a[axis], b[axis]);
}

/// Whether two closed line segments of the plane have a point in common. Exact.
inline bool segments_meet(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  const int ac = orient2d(a, b, c);
  const int ad = orient2d(a, b, d);
  const int ca = orient2d(c, d, a);
  const int cb = orient2d(c, d, b);
  if (ac * ad < 0 && ca * cb < 0) return true;
  return (ac == 0 && between_ends(a, b, c)) || (ad == 0 && between_ends(a, b, d)) ||
         (ca == 0 && between_ends(c, d, a)) || (cb == 0 && between_ends(c, d, b));
}

/// Whether the outline of a polygon meets itself anywhere but at its corners, or turns back on itself. Quadratic in the
/// number of corners.
inline bool outline_crosses(const std::vector<Point2>& points) {
  const std::size_t n = points.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Point2& a = points[i];
    const Point2& b = points[(i + 1) % n];
    const Point2& c = points[(i + 2) % n];
    const bool back = (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1]) > 0.0;
    if (back && orient2d(a, b, c) == 0) return true;
    for (std::size_t j = i + 2; j < n; ++j)
      if ((j + 1) % n != i && segments_meet(a, b, points[j], points[(j + 1) % n])) return true;
  }
  return false;
}

/// Signed height of p over the line from a to b, positive on its left.
inline double height_over(const Point2& a, const Point2& b, const Point2& p) {
  const double x = b[0] - a[0];
  const double y = b[1] - a[1];
  return (x * (p[1] - a[1]) - y * (p[0] - a[0])) / std::hypot(x, y);
}

/// Cuts a flat, simple, perhaps concave polygon with corners on straight edges into triangles that use all corners and
/// no others. Exact, by cutting off ears; first choice are ears to which no other corner comes closer than `slack`.
/// nullopt if the outline is not simple or not counter-clockwise about `normal`.
inline std::optional<std::vector<SurfaceTriangle>> facet_triangles(
    const std::vector<Vec3d>& vertices, const std::vector<int>& loop, const Vec3d& normal, int facet, double slack) {
  std::vector<SurfaceTriangle> triangles;
  if (loop.size() == 3) {
    triangles.push_back({{loop[0], loop[1], loop[2]}, facet});
    return triangles;
  }
  const Projection project(normal);
  std::vector<Point2> points;
  for (int vertex : loop) points.push_back(project(vertices[static_cast<std::size_t>(vertex)]));
  if (outline_crosses(points)) return std::nullopt;

  std::vector<std::size_t> left(loop.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  const auto is_ear = [&](std::size_t at, bool careful) {
    const std::size_t before = left[(at + left.size() - 1) % left.size()];
    const std::size_t here = left[at];
    const std::size_t after = left[(at + 1) % left.size()];
    const Point2& a = points[before];
    const Point2& b = points[here];
    const Point2& c = points[after];
    if (orient2d(a, b, c) <= 0 || (careful && height_over(a, c, b) > -slack)) return false;
    return std::none_of(left.begin(), left.end(), [&](std::size_t other) {
      if (other == before || other == here || other == after) return false;
      const Point2& p = points[other];
      if (careful)
        return height_over(a, b, p) > -slack && height_over(b, c, p) > -slack && height_over(c, a, p) > -slack;
      return orient2d(a, b, p) >= 0 && orient2d(b, c, p) >= 0 && orient2d(c, a, p) >= 0;
    });
  };
  for (std::size_t at = 0; left.size() > 3;) {
    std::size_t tried = 0;
    while (tried < 2 * left.size() && !is_ear(at % left.size(), tried < left.size())) {
      ++at;
      ++tried;
    }
    if (tried == 2 * left.size()) return std::nullopt;
    at %= left.size();
    triangles.push_back(
        {{loop[left[(at + left.size() - 1) % left.size()]], loop[left[at]], loop[left[(at + 1) % left.size()]]},
            facet});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(at));
    ++at;  // the next corner but one: fewer slender triangles than a fan
  }
  if (orient2d(points[left[0]], points[left[1]], points[left[2]]) <= 0) return std::nullopt;
  triangles.push_back({{loop[left[0]], loop[left[1]], loop[left[2]]}, facet});
  return triangles;
}

}  // namespace lumo

#endif

// ---- lumo/morphology/region_images.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_REGION_IMAGES_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_REGION_IMAGES_HPP

namespace lumo {

/// Where the mirror images of a body's regions lie in a plane of its symmetry.
struct RegionImages {
  enum class Kind {
    regions,  ///< each region's image is the region `image` names
    unseen,   ///< no image lies in a region: the body is seen from one side
    unknown   ///< neither, or not to be found out: contacts do not stand for their mirror images
  };
  Kind kind = Kind::unknown;
  std::vector<int> image;
};

/// Mirror images of the regions in the plane across `axis` (0: x, 1: y), by asking Body::region at points of the
/// surface and at their images; `unknown` where the body is not symmetric, and for a region without such a point.
/// Without facets what the body gives is believed. Throws InvalidArgument for a region_image_x or _y that region()
/// contradicts.
inline RegionImages region_images(const Body& body, int axis);

namespace detail {

// Asks region() at points that are spread over the facets by area, and at all their images.
class RegionSurvey {
 public:
  RegionSurvey(const Body& body, int axis)
      : body_(body),
        axis_(axis),
        given_(axis == 0 ? body.region_image_x : body.region_image_y),
        image_(std::size_t(body.regions), unasked) {
    require_sound_map();
    if (given_ && given_->empty())
      for (int r = 0; r < body.regions; ++r) given_->push_back(r);
    ask();
  }

  RegionImages answer() const {
    using Kind = RegionImages::Kind;
    if (given_) return {Kind::regions, *given_};
    if (conflict_) return {};
    if (std::all_of(image_.begin(), image_.end(), [](int r) { return r == -1; })) return {Kind::unseen, {}};
    for (std::size_t r = 0; r < image_.size(); ++r)
      if (image_[r] < 0 || image_[std::size_t(image_[r])] != int(r)) return {};
    return {Kind::regions, image_};
  }

 private:
  static constexpr int unasked = -2;
  static constexpr double points = 16384.0;  // in all; a triangle has at least four

  const char* name() const { return axis_ == 0 ? "region_image_x" : "region_image_y"; }
  void require_sound_map() const {
    if (!given_ || given_->empty()) return;
    if (given_->size() != image_.size())
      throw InvalidArgument(message(name(), " has ", given_->size(), " regions, the body has ", image_.size()));
    for (const int r : *given_) require_in_range(name(), r, 0, body_.regions - 1, "");
  }
  void ask() {
    struct Part {
      std::array<Vec3d, 3> corners;
      double area;
      const Shape* shape;
    };
    std::vector<Part> parts;
    double area = 0.0;
    for (std::size_t f = 0; f < body_.facets.size(); ++f) {
      const Facet& facet = body_.facets[f];
      if (facet.patch == Body::mirror_patch || !body_.patches.at(std::size_t(facet.patch)).visible) continue;
      const auto triangles =
          facet_triangles(body_.vertices, facet.loop, polygon_normal(body_.vertices, facet.loop), int(f), 0.0);
      if (!triangles) continue;  // the mesher says what is wrong with it
      for (const SurfaceTriangle& t : *triangles) {
        std::array<Vec3d, 3> c;
        for (std::size_t k = 0; k < 3; ++k) c[k] = body_.vertices[std::size_t(t.corners[k])];
        parts.push_back({c, (c[1] - c[0]).cross(c[2] - c[0]).norm(), &body_.patches[std::size_t(facet.patch)].shape});
        area += parts.back().area;
      }
    }
    for (const Part& p : parts) {
      const int count = std::max(4, int(points * p.area / area));
      for (int k = 1; k <= count; ++k) {  // not from 0, which lies on an edge
        // Additive sequence of the plastic number (Roberts 2018): even, and seldom where regions meet.
        double u = std::fmod(0.5 + 0.7548776662466927 * k, 1.0), v = std::fmod(0.5 + 0.5698402909980532 * k, 1.0);
        if (u + v > 1.0) {
          u = 1.0 - u;
          v = 1.0 - v;
        }
        const auto& [a, b, c] = p.corners;
        const Vec3d at = closest_point(*p.shape, (1.0 - u - v) * a + u * b + v * c);
        ask_images(at, outward_normal(*p.shape, at));
      }
    }
  }
  // A point of the sector stands for one in each of the others.
  void ask_images(const Vec3d& p, const Vec3d& n) {
    Vec3d mirror(1.0, 1.0, 1.0);
    mirror[axis_] = -1.0;
    for (unsigned sector = 0; sector < 4; ++sector) {
      if (((sector & 1u) && !body_.symmetry.x) || ((sector & 2u) && !body_.symmetry.y)) continue;
      const Vec3d s(sector & 1u ? -1.0 : 1.0, sector & 2u ? -1.0 : 1.0, 1.0);
      const Vec3d here = s.cwiseProduct(p), there = mirror.cwiseProduct(here), normal = s.cwiseProduct(n);
      const int r = region(here, normal);
      if (r >= 0) note(r, region(there, mirror.cwiseProduct(normal)), here);
    }
  }
  int region(const Vec3d& p, const Vec3d& n) const {
    const int r = body_.region(p, n);
    return r >= 0 && r < body_.regions ? r : -1;
  }
  void note(int r, int other, const Vec3d& at) {
    if (given_ && (*given_)[std::size_t(r)] != other)
      throw InvalidArgument(message(name(), " says that region ", r, " has its mirror image in region ",
          (*given_)[std::size_t(r)], ", but region() gives ", other, " for that of (", at.x() * 1e3, ", ", at.y() * 1e3,
          ", ", at.z() * 1e3, ") mm"));
    int& known = image_[std::size_t(r)];
    if (known == unasked) known = other;
    else if (known != other) conflict_ = true;
  }

  const Body& body_;
  int axis_;
  std::optional<std::vector<int>> given_;
  std::vector<int> image_;
  bool conflict_ = false;
};

}  // namespace detail

inline RegionImages region_images(const Body& body, int axis) {
  if (!(axis == 0 ? body.symmetry.x : body.symmetry.y) || (body.regions > 0 && !body.region)) return {};
  if (body.regions == 0) return {RegionImages::Kind::regions, {}};
  return detail::RegionSurvey(body, axis).answer();
}

}  // namespace lumo

#endif

// ---- lumo/optics/exit_power.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_EXIT_POWER_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_EXIT_POWER_HPP

namespace lumo {

/// Light that left the body for good: where it last crossed the surface, and where it goes.
struct Escape {
  Vec3d reference;  ///< last exit point in the undeformed body [m]
  Vec3d position;   ///< the same point, deformed [m]
  Vec3d direction;  ///< unit, in air
  int region = -1;  ///< Body::region of the last exit point; −1 if the body says that such light is not seen
};

/// Sorts escaping light into channels. A photodiode or a camera with a finite aperture asks whether (position,
/// direction) reaches it. Optional: `std::optional<std::vector<int>> image_channels(const Body&, int axis) const`,
/// channel → its mirror image in the plane across axis 0 or 1 (empty: itself; nullopt: none), lets one of two
/// mirrored states stand for both. Laws: a pure function; the channel lies in [0, channels(body)), or is −1 for light
/// that is not seen.
template <class R>
concept ExitReadout = requires(const R& readout, const Body& body, const Escape& escape) {
  { readout.channels(body) } -> std::convertible_to<int>;
  { readout.channel(escape) } -> std::convertible_to<int>;
};

/// A direction [unit] and the solid angle [sr] that it stands for; 0: there is no way.
struct Connection {
  Vec3d direction{0.0, 0.0, 1.0};
  double solid_angle_sr = 0.0;
};

/// From a point to a place of a camera's round opening of `radius_m` about `center`; `at`: the place, in radii.
inline Connection to_disc(const Vec3d& center, const Vec3d& view, double radius_m, const Vec3d& from, const Vec3d& at) {
  const Vec3d way = center + radius_m * at - from;
  const double length = way.norm(), toward = -way.dot(view);
  if (!(toward > 0.0)) return {};
  return {way / length, toward / length * pi * radius_m * radius_m / (length * length)};
}

/// A readout behind openings that are small seen from the body: few paths come there by themselves. Light that
/// Lambertian faces send is gathered from ways that start at an opening (next-event estimation: Coveyou, Cain & Yost
/// 1967); light that never met such a face is traced forward, as for others. Laws: connect(k, p, u, v) leads from the
/// point p through a point of opening k, and the mean of f(direction)·solid_angle over (u, v) in (0, 1)² is the
/// integral of f over the solid angle of the opening; channel() is −1 for light that passes no opening, and what passes
/// one has one channel.
template <class R>
concept ConnectedReadout = ExitReadout<R> && requires(const R& readout, const Vec3d& p, int k, double u) {
  { readout.openings() } -> std::convertible_to<int>;
  { readout.connect(k, p, u, u) } -> std::same_as<Connection>;
};

/// A connected readout whose openings are so small, or so far, that paths from emitters hardly ever come there: their
/// light is gathered, too, as ways from the opening meet them. The member says so.
template <class R>
concept WholeReadout = ConnectedReadout<R> && requires {
  requires R::gathers_emitters;
};

/// Light that stays on an opaque patch of the body.
struct Landing {
  Vec3d reference;  ///< where, in the undeformed body [m]
  Vec3d position;   ///< the same point, deformed [m]
  Vec3d direction;  ///< unit, in which it came
  int patch;        ///< of Body::patches
};

/// A readout that sees light on opaque patches, too, as photodiodes on the face do. Laws: landing_channel() is pure,
/// and −1 for light that is not seen. It is asked for patches that absorb or mirror; light on Lambertian ones goes on
/// with all other that falls there.
template <class R>
concept LandingReadout = ExitReadout<R> && requires(const R& readout, const Landing& landing) {
  { readout.landing_channel(landing) } -> std::convertible_to<int>;
};

/// All power that leaves through each region of the body and is seen (model reading of paper §III: r_b).
struct ExitPower {
  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const { return escape.region; }
  /// nullopt unless the images of all regions are regions. Throws as region_images() does.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const {
    RegionImages known = region_images(body, axis);
    if (known.kind != RegionImages::Kind::regions) return std::nullopt;
    return std::move(known.image);
  }
};

static_assert(ExitReadout<ExitPower>);
static_assert(!ExitReadout<int> && !ConnectedReadout<ExitPower>);

}  // namespace lumo

#endif

// ---- lumo/core/executor.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_EXECUTOR_HPP
#define SINGLE_INCLUDE_LUMO_CORE_EXECUTOR_HPP

namespace lumo {

/// Runs `task(i)` for every i in [0, count), in any order and on any thread, and returns when all are done.
/// Law: each i exactly once; an exception thrown by a task is rethrown to the caller after the others have stopped.
/// Tasks write to disjoint places, so that results do not depend on the number of threads.
template <class E>
concept Executor = requires(const E& executor, std::size_t count) {
  executor.for_each(count, [](std::size_t) {});
};

/// Everything on the calling thread, in order.
struct Serial {
  template <std::invocable<std::size_t> Task> void for_each(std::size_t count, Task&& task) const {
    for (std::size_t i = 0; i < count; ++i) task(i);
  }
};

/// Tasks on the calling thread and up to `threads` − 1 new ones, begun in the order of their indices. After an
/// exception no task begins; of several exceptions that of the lowest index is rethrown, as by Serial.
struct Threads {
  int threads = int(std::max(1u, std::thread::hardware_concurrency()));

  /// Throws InvalidArgument unless 1 ≤ threads ≤ 1024, std::system_error when a thread cannot be started.
  template <std::invocable<std::size_t> Task> void for_each(std::size_t count, Task&& task) const {
    if (threads < 1 || threads > 1024)
      throw InvalidArgument(message("number of threads is ", threads, ", must lie in [1, 1024]"));
    std::atomic<std::size_t> next = 0, failed = count;
    std::exception_ptr failure;
    std::mutex mutex;
    const auto work = [&] {
      for (std::size_t i = 0; failed == count && (i = next++) < count;) try {
          task(i);
        } catch (...) {
          const std::lock_guard lock(mutex);
          if (i < failed) {
            failed = i;
            failure = std::current_exception();
          }
        }
    };
    {
      std::vector<std::jthread> others;
      for (std::size_t k = 1; k < std::min(std::size_t(threads), count); ++k) others.emplace_back(work);
      work();
    }  // where the others are waited for
    if (failure) std::rethrow_exception(failure);
  }
};

static_assert(Executor<Serial> && Executor<Threads>);

}  // namespace lumo

#endif

// ---- lumo/core/stopwatch.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_STOPWATCH_HPP
#define SINGLE_INCLUDE_LUMO_CORE_STOPWATCH_HPP

namespace lumo {

/// A steady clock [ns]; under Linux the one on which Video4Linux2 and SocketCAN's adapter stamp (CLOCK_MONOTONIC).
inline std::int64_t steady_ns() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Lets other threads run for about so long.
inline void pause_for(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

/// Seconds since it was made.
class Stopwatch {
 public:
  double seconds() const { return 1e-9 * double(steady_ns() - start_); }

 private:
  std::int64_t start_ = steady_ns();
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/indenters/indenter.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_INDENTER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_INDENTER_HPP

namespace lumo {

/// Signed distance to a rigid surface with its first and second derivatives by the point.
struct DistanceSample {
  double distance;  ///< [m], negative inside
  Vec3d gradient;   ///< unit outward normal
  Mat3d hessian;    ///< [1/m]
};

/// A rigid tool, given by its signed distance field in its own frame (origin at its centre); radius_m() is that of a
/// ball about the origin that holds it. distance() is for doubles, or of a deduced scalar. Laws: |gradient| = 1 almost
/// everywhere; distance is 1-Lipschitz; derivatives match finite differences.
template <class T>
concept Indenter = requires(const T& tool, const Vec3d& p) {
  { tool.distance(p) } -> std::convertible_to<double>;
  { tool.sample(p) } -> std::convertible_to<DistanceSample>;
  { tool.radius_m() } -> std::convertible_to<double>;
  validate(tool);
};

/// How strongly a tool is curved where it is meant to touch [m]: its own contact_radius_m(), or the whole tool's
/// radius. Only a scale for first guesses.
template <Indenter Tool> double contact_radius(const Tool& tool) {
  if constexpr (requires { tool.contact_radius_m(); }) return tool.contact_radius_m();
  else return tool.radius_m();
}

/// Is the tool its own mirror image in the plane across `axis` (0: x, 1: y, 2: z) of its frame? One that does not say
/// so by symmetric(axis) is taken not to be.
template <Indenter Tool> bool is_symmetric(const Tool& tool, int axis) {
  if constexpr (requires {
                  { tool.symmetric(axis) } -> std::convertible_to<bool>;
                })
    return tool.symmetric(axis);
  else return false;
}

/// Rigid sphere.
struct Sphere {
  double diameter_m = 10e-3;

  bool operator==(const Sphere&) const = default;

  double radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const { return p.norm() - radius_m(); }
  DistanceSample sample(const Vec3d& p) const {
    const double r = p.norm();
    const Vec3d n = r > 0.0 ? Vec3d(p / r) : Vec3d(Vec3d::UnitZ());
    return {r - radius_m(), n, (Mat3d::Identity() - n * n.transpose()) / (r > 0.0 ? r : radius_m())};
  }
};

inline constexpr Limits sphere_diameters_mm{0.1, 1000.0};

inline void validate(const Sphere& s) {
  require_in_range("sphere diameter", s.diameter_m * 1e3, sphere_diameters_mm, "mm");
}

static_assert(Indenter<Sphere>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/scenario.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_SCENARIO_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_SCENARIO_HPP

namespace lumo {

/// Plane in which an approach is tilted from the pad normal: across the finger, as the paper's are read, or along it.
enum class TiltPlane { xz, yz };

/// One contact: an indenter, the line on which it comes, and the loads at which it is observed.
/// It moves along direction() on the line through Body::pivot shifted by `x_m` and `y_m`; it does not move sideways.
template <Indenter Tool = Sphere> struct Scenario {
  Tool indenter;
  double angle_rad = 0.0;                                     ///< approach angle from the pad normal
  double y_m = 0.0;                                           ///< place along the finger [m]
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};  ///< increasing
  TiltPlane tilt = TiltPlane::xz;                             ///< in which the angle lies
  double x_m = 0.0;                                           ///< place across the finger [m]

  bool operator==(const Scenario&) const = default;

  /// Unit vector of the advance (paper §III-B; model reading: −(sin α, 0, cos α)).
  Vec3d direction() const {
    const double sideways = -std::sin(angle_rad);
    return {tilt == TiltPlane::xz ? sideways : 0.0, tilt == TiltPlane::yz ? sideways : 0.0, -std::cos(angle_rad)};
  }
};

/// Planes in which a contact is its own mirror image.
template <Indenter Tool> Symmetry symmetry_of(const Scenario<Tool>& s) {
  const bool straight = s.angle_rad == 0.0;
  return {s.x_m == 0.0 && (straight || s.tilt == TiltPlane::yz) && is_symmetric(s.indenter, 0),
      s.y_m == 0.0 && (straight || s.tilt == TiltPlane::xz) && is_symmetric(s.indenter, 1)};
}

/// Mirror image of a contact with a symmetric tool in these planes.
template <Indenter Tool> Scenario<Tool> mirrored(Scenario<Tool> s, Symmetry planes) {
  if (planes.x) s.x_m = 0.0 - s.x_m;
  if (planes.y) s.y_m = 0.0 - s.y_m;
  if (s.tilt == TiltPlane::xz ? planes.x : planes.y) s.angle_rad = 0.0 - s.angle_rad;
  return s;
}

/// What validate() admits, in the units in which people give it.
inline constexpr Limits approach_angles_deg{-80.0, 80.0}, contact_places_mm{-1e4, 1e4}, loads_admitted_N{1e-3, 1e4};

/// Throws InvalidArgument for an angle, place or load out of range, and for loads that do not increase.
template <Indenter Tool> void validate(const Scenario<Tool>& s) {
  validate(s.indenter);
  require_in_range("approach angle", s.angle_rad * 180.0 / pi, approach_angles_deg, "deg");
  require_in_range("contact place x", s.x_m * 1e3, contact_places_mm, "mm");
  require_in_range("contact place y", s.y_m * 1e3, contact_places_mm, "mm");
  if (s.loads_N.empty()) throw InvalidArgument("loads: none given, at least one is needed");
  double last = 0.0;
  for (double load : s.loads_N) {
    require_in_range("load", load, loads_admitted_N, "N");
    if (load <= last) throw InvalidArgument(message("loads must increase: ", load, " N follows ", last, " N"));
    last = load;
  }
}

}  // namespace lumo

#endif

// ---- lumo/mesh/tet_mesh.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_TET_MESH_HPP
#define SINGLE_INCLUDE_LUMO_MESH_TET_MESH_HPP

namespace lumo {

/// Nodes lie within this of the origin [m]; lengths far beyond have no finite squares.
inline constexpr double largest_coordinate_m = 1e6;

/// Boundary triangle of a tetrahedral mesh, counter-clockwise seen from outside.
/// Nodes: three corners, then the middles of edges 01, 12, 20 (−1 in a linear mesh).
struct BoundaryFace {
  std::array<int, 6> nodes;
  int patch;  ///< index into Body::patches
};

/// Corners at the ends of a tetrahedron's edges, in the order of their middle nodes.
inline constexpr int tet_edges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};

/// Corners of the face opposite to corner i of a positive tetrahedron, counter-clockwise seen from outside.
inline constexpr std::array<std::array<int, 3>, 4> outward_faces{{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// Tetrahedral mesh of the *whole* body in its reference configuration.
/// Tet nodes: corners 0…3 (positive orientation), then the middles of tet_edges (−1 in a linear mesh).
struct TetMesh {
  int order = 2;             ///< 1 linear, 2 quadratic
  std::vector<Vec3d> nodes;  ///< [m]
  std::vector<std::array<int, 10>> tets;
  std::vector<BoundaryFace> faces;      ///< the closed boundary, patch by patch
  Symmetry symmetry;                    ///< planes in which the mesh is its own exact mirror image
  std::vector<int> mirror_x, mirror_y;  ///< node → its mirror image in x = 0 and y = 0 (empty without symmetry)

  int nodes_per_tet() const { return order == 2 ? 10 : 4; }
  int nodes_per_face() const { return order == 2 ? 6 : 3; }
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/first_touch.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_FIRST_TOUCH_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_FIRST_TOUCH_HPP

namespace lumo {

/// Where an indenter that comes along a line first meets the exact undeformed surface.
struct Touch {
  Vec3d origin;  ///< of the indenter's frame at first touch [m]
  Vec3d point;   ///< of the surface [m]
};

/// First touch with the body's contactable patches, on their exact shapes (never on facets), to 10 nm for convex tools
/// with edges and far better for round ones. The mesh bounds the patches. Throws InvalidArgument when the
/// indenter passes by, with what is known of why: no patch may be touched, it meets one that may not, or the tool lies
/// far off its own origin, which is what comes along the line.
template <Indenter Tool> Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario);

// How far the tool can advance from `start` until it reaches p: sphere tracing, because distance is 1-Lipschitz. +∞: it
// passes by.
template <Indenter Tool>
double advance_to(const Tool& tool, const Vec3d& start, const Vec3d& direction, const Vec3d& p, double limit) {
  double s = 0.0, before = 0.0;
  for (int i = 0; i < 500; ++i) {
    const double gap = tool.distance(p - start - s * direction);
    if (gap < -1e-12) {  // a distance that is not quite one was too long: back to its zero
      for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (before + s);
        (tool.distance(p - start - middle * direction) > 0.0 ? before : s) = middle;
      }
      return s;
    }
    if (gap < 1e-15) return s;
    before = s;
    s += gap;
    if (s > limit) break;
  }
  return s > limit ? std::numeric_limits<double>::infinity() : s;
}

namespace detail {

// The line on which an indenter comes.
template <Indenter Tool> struct ApproachLine {
  const Tool& tool;
  Vec3d start;  // of the tool's origin, clear of the body [m]
  Vec3d direction;
  double reach_m;

  double advance_to(const Vec3d& p) const { return lumo::advance_to(tool, start, direction, p, 2.0 * reach_m); }
};

// The first touch on one patch, or on its image in symmetry planes. Points are folded into the patch's own quarter.
template <Indenter Tool> struct PatchSearch {
  static constexpr double first_step = 0.1;    // of the box's diagonal
  static constexpr double finest_step = 1e-9;  // [m]: the advance is quadratic about its minimum
  static constexpr int directions = 8;
  static constexpr int most_moves = 1000;  // with one step: where rounding makes gains, there is no end to them

  const ApproachLine<Tool>& line;
  const Patch& patch;
  double sign_x, sign_y;  // −1: the image
  double slack_m;
  Vec3d low = Vec3d::Constant(std::numeric_limits<double>::infinity());  // box of the patch's nodes: it trims the shape
  Vec3d high = -low;
  Vec3d seed = Vec3d::Zero();
  double nearest = std::numeric_limits<double>::infinity();

  Vec3d fold(const Vec3d& p) const { return Vec3d(sign_x * p.x(), sign_y * p.y(), p.z()); }
  Vec3d into_box(const Vec3d& p) const { return elementwise_min(elementwise_max(p, low), high); }
  bool inside(const Vec3d& p) const {
    for (int axis = 0; axis < 3; ++axis)
      if (!(p[axis] >= low[axis] - slack_m && p[axis] <= high[axis] + slack_m)) return false;
    return true;
  }
  bool try_seed(const Vec3d& q, double gain) {
    const double s = line.advance_to(fold(q));
    if (!(s < nearest - gain)) return false;
    nearest = s;
    seed = q;
    return true;
  }

  void add_nodes(const TetMesh& mesh, int patch_number, Symmetry planes) {
    for (const BoundaryFace& f : mesh.faces) {
      if (f.patch != patch_number) continue;
      for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
        const Vec3d q = fold(mesh.nodes[std::size_t(f.nodes[k])]);
        if ((planes.x && q.x() < 0) || (planes.y && q.y() < 0)) continue;
        low = elementwise_min(low, q);
        high = elementwise_max(high, q);
        try_seed(q, 0.0);
      }
    }
  }
  bool empty() const { return !(low.x() <= high.x()); }

  // Nodes may be too far apart for a small tool: also start from where the tool's centre line comes closest.
  void follow_line() {
    const double radius = line.tool.radius_m();
    for (double s = 0.0; s < 2.0 * line.reach_m;) {
      const Vec3d center = fold(line.start + s * line.direction);
      const Vec3d q = closest_point(patch.shape, into_box(center));
      const double apart = (q - center).norm();
      if (inside(q) && apart < 1.01 * radius) try_seed(q, 0.0);
      s += std::max(0.2 * apart, 1e-3 * radius);
    }
  }

  // Pattern search on the exact shape, in directions that turn by `spin` after each round; an advance shorter by less
  // than `gain` is no gain.
  void refine(double spin, double gain) {
    double spun = 0.0;
    for (double step = first_step * (high - low).norm(); step > finest_step; step *= 0.5)
      for (int moves = 0, moved = 1; moved && moves < most_moves; ++moves, spun += spin) {
        moved = 0;
        const Vec3d n = outward_normal(patch.shape, seed);
        const Vec3d u = n.unitOrthogonal(), v = n.cross(u);
        for (int k = 0; k < directions; ++k) {
          const double turn = 0.25 * pi * k + spun;
          const Vec3d trial =
              closest_point(patch.shape, into_box(seed + step * (std::cos(turn) * u + std::sin(turn) * v)));
          if (inside(trial) && try_seed(trial, gain)) moved = 1;
        }
      }
  }
};

// A scenario's tool in a message.
template <Indenter Tool> std::string approach(const Scenario<Tool>& s) {
  return message("the indenter at ", s.x_m == 0.0 ? "" : message("x = ", s.x_m * 1e3, " mm, "), "y = ", s.y_m * 1e3,
      " mm and ", s.angle_rad * 180 / pi, " deg");
}

// Why a tool on this line touches nothing.
template <Indenter Tool>
std::string passing_by(const Body& body, const TetMesh& mesh, const std::string& what, const ApproachLine<Tool>& line) {
  bool may_touch = false;
  int met = -1;
  double nearest = std::numeric_limits<double>::infinity();
  for (const BoundaryFace& f : mesh.faces) {
    if (body.patches[std::size_t(f.patch)].contactable) {
      may_touch = true;
      continue;
    }
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k)
      if (const double s = line.advance_to(mesh.nodes[std::size_t(f.nodes[k])]); s < nearest) {
        nearest = s;
        met = f.patch;
      }
  }
  if (!may_touch) return what + " touches nothing: no patch of the body is contactable";
  if (met >= 0)
    return message(
        what, " meets patch \"", printable(body.patches[std::size_t(met)].name), "\", which may not be touched");
  const double off = line.tool.distance(Vec3d(0.0, 0.0, 0.0));
  return what + " passes by the body" +
         (off > contact_radius(line.tool) ? message("; the tool lies ", off * 1e3, " mm off its own origin") : "");
}

}  // namespace detail

template <Indenter Tool> Touch first_touch(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  validate(scenario);
  const Vec3d direction = scenario.direction();
  double size = 0.0;
  for (const Vec3d& p : mesh.nodes) size = std::max(size, p.norm());
  const Vec3d shift(scenario.x_m, scenario.y_m, 0.0);
  const double reach = 2.0 * size + 2.0 * scenario.indenter.radius_m() + shift.norm();
  const Vec3d start = body.pivot + shift - reach * direction;
  const detail::ApproachLine<Tool> line{scenario.indenter, start, direction, reach};

  double best = std::numeric_limits<double>::infinity();
  Vec3d point = Vec3d::Zero();
  for (std::size_t patch = 0; patch < body.patches.size(); ++patch) {
    if (!body.patches[patch].contactable) continue;
    for (int image = 0; image < 4; ++image) {
      const double sx = image & 1 ? -1.0 : 1.0, sy = image & 2 ? -1.0 : 1.0;
      if ((sx < 0 && !body.symmetry.x) || (sy < 0 && !body.symmetry.y)) continue;
      detail::PatchSearch<Tool> search{line, body.patches[patch], sx, sy, 1e-12 * size};
      search.add_nodes(mesh, int(patch), body.symmetry);
      if (search.empty()) continue;
      search.follow_line();
      if (!std::isfinite(search.nearest)) continue;
      search.refine(0.0, 1e-16);
      // Edges of a tool put kinks into the advance, at which fixed directions can get stuck; directions that never
      // repeat do not (Audet, Dennis 2006).
      constexpr double golden = 0.61803398875;
      search.refine(0.25 * pi * golden, 1e-12);
      if (search.nearest < best) {
        best = search.nearest;
        point = search.fold(search.seed);
      }
    }
  }
  if (!std::isfinite(best)) throw InvalidArgument(detail::passing_by(body, mesh, detail::approach(scenario), line));
  return {start + best * direction, point};
}

}  // namespace lumo

#endif

// ---- lumo/mesh/mesh_sides.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_MESH_SIDES_HPP
#define SINGLE_INCLUDE_LUMO_MESH_MESH_SIDES_HPP

namespace lumo::detail {

// A side of an element, or a boundary face as a side of what is outside: each must have one partner of opposite sense.
struct MeshSide {
  int middle, most;  // corners; the least one is the bucket that it lies in
  int from;          // 4 × element + corner opposite; −1 − face
  bool odd;          // sorting its corners was an odd permutation

  bool operator<(const MeshSide& o) const { return std::tie(middle, most, from) < std::tie(o.middle, o.most, o.from); }
  bool same_corners(const MeshSide& o) const { return middle == o.middle && most == o.most; }
};

class MeshSides {
 public:
  explicit MeshSides(const TetMesh& mesh) : mesh_(mesh), begin_(mesh.nodes.size() + 1, 0) {
    for_each([&](const std::array<int, 3>& c, int) { ++begin_[std::size_t(std::min({c[0], c[1], c[2]})) + 1]; });
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    sides_.resize(begin_.back());
    std::vector<std::size_t> end(begin_);
    for_each([&](std::array<int, 3> c, int from) {
      bool odd = from < 0;  // seen from the other side
      const auto order = [&](std::size_t i, std::size_t j) {
        if (c[i] <= c[j]) return;
        std::swap(c[i], c[j]);
        odd = !odd;
      };
      order(0, 1);
      order(1, 2);
      order(0, 1);
      sides_[end[std::size_t(c[0])]++] = {c[1], c[2], from, odd};
    });
  }

  /// Throws unless all have their partners.
  void require_pairs() {
    for (std::size_t node = 0; node + 1 < begin_.size(); ++node) {
      const auto first = sides_.begin() + std::ptrdiff_t(begin_[node]),
                 last = sides_.begin() + std::ptrdiff_t(begin_[node + 1]);
      std::sort(first, last);
      for (auto side = first; side != last;) {
        const auto end = std::find_if(side, last, [&](const MeshSide& s) { return !s.same_corners(*side); });
        require_pair({side, end});
        side = end;
      }
    }
  }

 private:
  template <class Visit> void for_each(Visit&& visit) const {
    for (std::size_t e = 0; e < mesh_.tets.size(); ++e)
      for (std::size_t k = 0; k < 4; ++k) visit(corners(int(4 * e + k)), int(4 * e + k));
    for (std::size_t f = 0; f < mesh_.faces.size(); ++f) visit(corners(-1 - int(f)), -1 - int(f));
  }
  std::array<int, 3> corners(int from) const {
    if (from < 0) {
      const auto& n = mesh_.faces[std::size_t(-1 - from)].nodes;
      return {n[0], n[1], n[2]};
    }
    const auto& t = mesh_.tets[std::size_t(from / 4)];
    const auto& [a, b, c] = outward_faces[std::size_t(from % 4)];
    return {t[std::size_t(a)], t[std::size_t(b)], t[std::size_t(c)]};
  }
  // Middle nodes of a side, each where the corner opposite to it is in ascending order.
  std::array<int, 3> middles(int from) const {
    // Of the edges that lie opposite to the corners, in the order of outward_faces.
    static constexpr std::array<std::array<std::size_t, 3>, 4> opposite{{{9, 8, 5}, {9, 6, 7}, {8, 7, 4}, {5, 4, 6}}};
    std::array<int, 3> c = corners(from), m{};
    for (std::size_t k = 0; k < 3; ++k)
      m[k] = from < 0 ? mesh_.faces[std::size_t(-1 - from)].nodes[3 + (k + 1) % 3]
                      : mesh_.tets[std::size_t(from / 4)][opposite[std::size_t(from % 4)][k]];
    const auto order = [&](std::size_t i, std::size_t j) {
      if (c[i] <= c[j]) return;
      std::swap(c[i], c[j]);
      std::swap(m[i], m[j]);
    };
    order(0, 1);
    order(1, 2);
    order(0, 1);
    return m;
  }
  static std::string name(int from) { return from < 0 ? message("face ", -1 - from) : message("element ", from / 4); }
  void require_pair(std::span<const MeshSide> same) const {
    using Reason = MeshError::Reason;
    const MeshSide& one = same[0];
    if (same.size() == 1 && one.from < 0)
      throw MeshError(Reason::bad_index, message("mesh ", name(one.from), " is no side of an element"));
    if (same.size() == 1)
      throw MeshError(Reason::open, message("mesh ", name(one.from), " has a side without neighbour or boundary face"));
    const MeshSide& other = same[1];
    if (same.size() > 2)
      throw MeshError(Reason::not_manifold,
          message("mesh ", name(one.from), ", ", name(other.from), " and ", name(same[2].from), " share one side"));
    if (one.odd == other.odd)
      throw MeshError(Reason::not_manifold, message("mesh ", name(one.from), " and ", name(other.from),
                                                " lie on one side of their common face: one is inside out"));
    if (mesh_.order == 2 && middles(one.from) != middles(other.from))
      throw MeshError(Reason::open, message("mesh ", name(one.from), " and ", name(other.from),
                                        " share three corners, but not the middle nodes between them"));
  }

  const TetMesh& mesh_;
  std::vector<std::size_t> begin_;  // of each node's bucket
  std::vector<MeshSide> sides_;
};

}  // namespace lumo::detail

#endif

// ---- lumo/mesh/quality.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_QUALITY_HPP
#define SINGLE_INCLUDE_LUMO_MESH_QUALITY_HPP

namespace lumo {

/// How good a mesh is.
struct MeshQuality {
  double volume_m3 = 0.0;           ///< exact integral of the Jacobian
  double min_jacobian_ratio = 1.0;  ///< smallest Bernstein coefficient of any element's Jacobian over the element's
                                    ///< mean: > 0 proves it valid everywhere
  double min_dihedral_deg = 180.0;  ///< of the corner tetrahedra
};

/// Bernstein coefficients of det(∂x/∂ξ) over one element: 1 (linear) or 20 (quadratic). All positive proves that the
/// map is invertible at every point, not only at quadrature points. Source: Johnen, Remacle, Geuzaine 2013.
inline std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& tet);

/// Measures without judging.
inline MeshQuality measure(const TetMesh& mesh);

/// Throws MeshError, which says what and where, unless nodes are finite and all in use, indices in range, middle nodes
/// there in a quadratic mesh only, all Jacobians positive over the whole element, elements joined side by side, `faces`
/// their boundary and a closed manifold, both sides of a plane of symmetry mirror images, and the volume within
/// `volume_tolerance` of `exact_volume_m3` (0: not checked). Linear in the size of the mesh.
inline void require_valid(const TetMesh& mesh, double exact_volume_m3 = 0.0, double volume_tolerance = 0.01);

namespace detail {

// Six times the volume of the corner tetrahedron, with its sign.
inline double corner_jacobian(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3d& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  return (x(1) - x(0)).cross(x(2) - x(0)).dot(x(3) - x(0));
}

// Symmetric multilinear form whose diagonal is the determinant.
inline double mixed_determinant(const Mat3d& a, const Mat3d& b, const Mat3d& c) {
  const auto det = [](const Vec3d& u, const Vec3d& v, const Vec3d& w) { return u.dot(v.cross(w)); };
  return (det(a.col(0), b.col(1), c.col(2)) + det(a.col(0), c.col(1), b.col(2)) + det(b.col(0), a.col(1), c.col(2)) +
             det(b.col(0), c.col(1), a.col(2)) + det(c.col(0), a.col(1), b.col(2)) +
             det(c.col(0), b.col(1), a.col(2))) /
         6.0;
}

}  // namespace detail

inline std::vector<double> jacobian_coefficients(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3d& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  if (mesh.order == 1) return {detail::corner_jacobian(mesh, t)};
  // The Jacobian of a quadratic map is linear in the barycentric coordinates: its values at the four corners determine
  // it.
  static constexpr int mid[4][4] = {{-1, 4, 6, 7}, {4, -1, 5, 8}, {6, 5, -1, 9}, {7, 8, 9, -1}};
  std::array<Mat3d, 4> corner;
  for (int k = 0; k < 4; ++k) {
    std::array<Vec3d, 4> by_lambda;  // ∂x/∂λ_j at corner k
    for (int j = 0; j < 4; ++j)
      by_lambda[std::size_t(j)] = j == k ? Vec3d(3.0 * x(k)) : Vec3d(4.0 * x(mid[k][j]) - x(j));
    for (int j = 1; j < 4; ++j) corner[std::size_t(k)].col(j - 1) = by_lambda[std::size_t(j)] - by_lambda[0];
  }
  std::vector<double> coefficients;
  for (std::size_t a = 0; a < 4; ++a)
    for (std::size_t b = a; b < 4; ++b)
      for (std::size_t c = b; c < 4; ++c)
        coefficients.push_back(detail::mixed_determinant(corner[a], corner[b], corner[c]));
  return coefficients;
}

inline MeshQuality measure(const TetMesh& mesh) {
  MeshQuality q;
  for (const auto& t : mesh.tets) {
    const std::vector<double> c = jacobian_coefficients(mesh, t);
    double sum = 0.0;
    for (double v : c) sum += v;
    const double mean = sum / double(c.size());
    q.volume_m3 += mean / 6.0;  // the integral of a Bernstein basis polynomial does not depend on its index
    q.min_jacobian_ratio =
        std::min(q.min_jacobian_ratio, *std::min_element(c.begin(), c.end()) / std::max(std::abs(mean), 1e-300));
    std::array<Vec3d, 4> n;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec3d &a = mesh.nodes[std::size_t(t[(k + 1) % 4])], &b = mesh.nodes[std::size_t(t[(k + 2) % 4])],
                  &d = mesh.nodes[std::size_t(t[(k + 3) % 4])];
      n[k] = (b - a).cross(d - a).normalized() * (k % 2 == 0 ? 1.0 : -1.0);
    }
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j)
        q.min_dihedral_deg =
            std::min(q.min_dihedral_deg, std::acos(std::clamp(-n[i].dot(n[j]), -1.0, 1.0)) * 180.0 / 3.14159265358979);
  }
  return q;
}

namespace detail {

// The parts of require_valid().
inline void require_indices(const TetMesh& mesh);
inline void require_orientation(const TetMesh& mesh);
inline void require_manifold(const TetMesh& mesh);
inline void require_mirror_images(const TetMesh& mesh, int axis);

}  // namespace detail

inline void require_valid(const TetMesh& mesh, double exact_volume_m3, double volume_tolerance) {
  detail::require_indices(mesh);
  detail::require_orientation(mesh);
  detail::MeshSides(mesh).require_pairs();
  detail::require_manifold(mesh);
  if (mesh.symmetry.x) detail::require_mirror_images(mesh, 0);
  if (mesh.symmetry.y) detail::require_mirror_images(mesh, 1);
  if (exact_volume_m3 > 0.0) {
    const double volume = measure(mesh).volume_m3;
    if (!(std::abs(volume / exact_volume_m3 - 1.0) <= volume_tolerance))
      throw MeshError(
          MeshError::Reason::inaccurate, message("mesh volume is ", volume * 1e9, " mm3, must be within ",
                                             100 * volume_tolerance, " % of ", exact_volume_m3 * 1e9, " mm3"));
  }
}

namespace detail {

// In a linear mesh the places of middle nodes are empty.
template <std::size_t N>
void require_nodes(const char* what, std::size_t number, const std::array<int, N>& nodes, int used, std::size_t there) {
  for (std::size_t k = 0; k < N; ++k) {
    const bool named = k < std::size_t(used), known = nodes[k] >= 0 && std::size_t(nodes[k]) < there;
    if (named && !known)
      throw MeshError(MeshError::Reason::bad_index,
          message("mesh ", what, " ", number, " names node ", nodes[k], ", the mesh has nodes 0 to ", int(there) - 1));
    if (!named && nodes[k] != -1)
      throw MeshError(MeshError::Reason::bad_index,
          message("mesh ", what, " ", number, " has middle node ", nodes[k], " in a linear mesh, must be -1"));
  }
}

inline void require_indices(const TetMesh& mesh) {
  using Reason = MeshError::Reason;
  if (mesh.order != 1 && mesh.order != 2)
    throw MeshError(Reason::bad_index, message("mesh order is ", mesh.order, ", must be 1 or 2"));
  if (mesh.tets.empty())
    throw MeshError(Reason::degenerate, "mesh has no elements: a bare surface can be lit, not pressed");
  const std::size_t count = mesh.nodes.size();
  for (std::size_t k = 0; k < count; ++k)
    if (!mesh.nodes[k].allFinite() || !(mesh.nodes[k].cwiseAbs().maxCoeff() < largest_coordinate_m))
      throw MeshError(Reason::not_finite, message("mesh node ", k, " is not at a finite place below 1e6 m"));
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    require_nodes("element", e, mesh.tets[e], mesh.nodes_per_tet(), count);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    require_nodes("face", f, mesh.faces[f].nodes, mesh.nodes_per_face(), count);
  std::vector<char> used(count, 0);
  for (const auto& t : mesh.tets)
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_tet()); ++k) used[std::size_t(t[k])] = 1;
  if (const auto loose = std::find(used.begin(), used.end(), 0); loose != used.end())
    throw MeshError(Reason::bad_index, message("mesh node ", loose - used.begin(), " belongs to no element"));
}

// How far, at most, the coefficients of a quadratic element lie from the Jacobian of its corners. They are determinants
// of edges, each moved by no more than four times the sum of how far middle nodes lie off the middles.
inline double largest_bend(const TetMesh& mesh, const std::array<int, 10>& t) {
  const auto x = [&](int k) -> const Vec3d& { return mesh.nodes[std::size_t(t[std::size_t(k)])]; };
  double moved = 0.0;
  for (int k = 0; k < 6; ++k) moved += 4.0 * (x(4 + k) - 0.5 * (x(tet_edges[k][0]) + x(tet_edges[k][1]))).norm();
  const double a = (x(1) - x(0)).norm(), b = (x(2) - x(0)).norm(), c = (x(3) - x(0)).norm();
  return (a + moved) * (b + moved) * (c + moved) - a * b * c;
}

inline void require_orientation(const TetMesh& mesh) {
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    const auto& t = mesh.tets[e];
    double least = corner_jacobian(mesh, t);
    if (mesh.order == 2 && !(least > 2.0 * largest_bend(mesh, t))) {  // twice: rounding
      const std::vector<double> c = jacobian_coefficients(mesh, t);
      least = *std::min_element(c.begin(), c.end());
    }
    if (!(least > 0.0))
      throw MeshError(MeshError::Reason::inverted, message("mesh element ", e, " has a Jacobian bound of ", least * 1e9,
                                                       " mm3, must be > 0 over the whole element"));
  }
}

// Directed edges of the closed surface must pair up.
inline void require_manifold(const TetMesh& mesh) {
  const auto key = [](int from, int to) { return std::uint64_t(unsigned(from)) << 32u | unsigned(to); };
  std::vector<std::uint64_t> edges, back;
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) {
      edges.push_back(key(f.nodes[k], f.nodes[(k + 1) % 3]));
      back.push_back(key(f.nodes[(k + 1) % 3], f.nodes[k]));
    }
  std::sort(edges.begin(), edges.end());
  std::sort(back.begin(), back.end());
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const bool twice = k + 1 < edges.size() && edges[k + 1] == edges[k];
    if (!twice && back[k] == edges[k]) continue;
    const std::uint64_t edge = twice ? edges[k] : std::min(edges[k], back[k]);
    throw MeshError(twice ? MeshError::Reason::not_manifold : MeshError::Reason::open,
        message("mesh surface is not a closed manifold at edge ", edge >> 32u, "-", unsigned(edge)));
  }
}

inline void require_mirror_images(const TetMesh& mesh, int axis) {
  using Reason = MeshError::Reason;
  const std::vector<int>& image = axis == 0 ? mesh.mirror_x : mesh.mirror_y;
  const char* plane = axis == 0 ? "x = 0" : "y = 0";
  if (image.size() != mesh.nodes.size())
    throw MeshError(Reason::bad_index, message("mesh has ", image.size(), " mirror images of nodes in ", plane,
                                           ", must have as many as nodes, ", mesh.nodes.size()));
  for (std::size_t k = 0; k < image.size(); ++k) {
    if (image[k] < 0 || std::size_t(image[k]) >= image.size())
      throw MeshError(Reason::bad_index, message("mesh node ", k, " has mirror image ", image[k], " in ", plane,
                                             ", the mesh has nodes 0 to ", int(image.size()) - 1));
    Vec3d mirrored = mesh.nodes[k];
    mirrored[axis] = -mirrored[axis];
    if (mesh.nodes[std::size_t(image[k])] != mirrored)
      throw MeshError(Reason::asymmetric,
          message("mesh node ", image[k], " is not the exact mirror image of node ", k, " in ", plane));
  }
  std::ptrdiff_t more = 0;  // elements on the positive side than on the other
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    double low = 0.0, high = 0.0;
    for (std::size_t k = 0; k < 4; ++k) {
      const double at = mesh.nodes[std::size_t(mesh.tets[e][k])][axis];
      low = std::min(low, at);
      high = std::max(high, at);
    }
    if (low < 0.0 && high > 0.0)
      throw MeshError(Reason::asymmetric, message("mesh element ", e, " crosses its plane of symmetry, ", plane));
    more += high > 0.0 ? 1 : -1;
  }
  if (more != 0)
    throw MeshError(Reason::asymmetric,
        message("mesh has ", std::abs(more), " elements more on one side of ", plane, " than on the other"));
}

}  // namespace detail

}  // namespace lumo

#endif

// ---- lumo/mesh/body_check.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_BODY_CHECK_HPP
#define SINGLE_INCLUDE_LUMO_MESH_BODY_CHECK_HPP

namespace lumo {

/// Throws MeshError, which says what and where, unless the mesh is valid, each face's patch is one of the body's, and
/// the carrier's boxes are finite, of positive size, and rounded by no more than their half edges.
inline void require_valid(const Body& body, const TetMesh& mesh);

/// Throws MeshError unless nodes of the boundary lie on their patches' exact shapes, within a millionth of the body's
/// size; mesh_body() places them so, middle nodes too. The message names the worst patch and its largest distance.
/// Indices must be in range. Throws InvalidArgument for a shape whose own validate() refuses it.
inline void require_on_shapes(const Body& body, const TetMesh& mesh);

/// The same for the vertices of the body's facets: what is meshed is moved onto the shapes, however far. Throws
/// MeshError, also for a facet of a patch or with a vertex that is not there.
inline void require_on_shapes(const Body& body);

inline void require_valid(const Body& body, const TetMesh& mesh) {
  using Reason = MeshError::Reason;
  require_valid(mesh);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    if (const int patch = mesh.faces[f].patch; patch < 0 || std::size_t(patch) >= body.patches.size())
      throw MeshError(Reason::bad_index, message("mesh face ", f, " is of patch ", patch,
                                             ", the body has patches 0 to ", int(body.patches.size()) - 1));
  for (std::size_t k = 0; k < body.carrier.size(); ++k) {
    const RigidBox& box = body.carrier[k];
    if (!box.center.allFinite() || !box.half.allFinite() || !std::isfinite(box.edge_radius))
      throw MeshError(Reason::not_finite, message("carrier box ", k, " has a number that is not finite"));
    if (const double least = box.half.minCoeff(); !(least > 0.0))
      throw MeshError(
          Reason::degenerate, message("carrier box ", k, " has a half edge of ", least * 1e3, " mm, must be > 0 mm"));
    if (!(box.edge_radius >= 0.0 && box.edge_radius <= box.half.minCoeff()))
      throw MeshError(Reason::degenerate, message("carrier box ", k, " is rounded by ", box.edge_radius * 1e3,
                                              " mm, must lie in [0, ", box.half.minCoeff() * 1e3, "] mm"));
  }
}

namespace detail {

// How far points are off the shapes of the patches that they should lie on.
class ShapeCheck {
 public:
  explicit ShapeCheck(const Body& body) : body_(body) {
    for (const Patch& p : body.patches) try {
        validate(p.shape);
      } catch (const InvalidArgument& e) {
        throw InvalidArgument(message("patch \"", printable(p.name), "\": ", e.what()));
      }
  }

  void add(int patch, const Vec3d& at) {
    const Vec3d p(body_.symmetry.x ? std::abs(at.x()) : at.x(), body_.symmetry.y ? std::abs(at.y()) : at.y(), at.z());
    size_ = std::max(size_, p.lpNorm<Eigen::Infinity>());
    const double apart = (closest_point(body_.patches[std::size_t(patch)].shape, p) - p).norm();
    if (apart <= worst_ || std::isnan(worst_)) return;
    worst_ = apart;
    patch_ = patch;
  }
  void require(const char* points) const {
    constexpr double precision = 1e-6;  // of the body's size: coordinates that went through single precision pass
    if (worst_ <= precision * size_) return;
    throw MeshError(std::isfinite(worst_) ? MeshError::Reason::inaccurate : MeshError::Reason::not_finite,
        message("patch \"", printable(body_.patches[std::size_t(patch_)].name), "\" has ", points, " up to ",
            worst_ * 1e3, " mm off its shape, at most ", precision * size_ * 1e3, " mm"));
  }

 private:
  const Body& body_;
  double size_ = 0.0, worst_ = 0.0;
  int patch_ = -1;
};

}  // namespace detail

inline void require_on_shapes(const Body& body, const TetMesh& mesh) {
  detail::ShapeCheck check(body);
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k)
      check.add(f.patch, mesh.nodes[std::size_t(f.nodes[k])]);
  check.require("nodes");
}

inline void require_on_shapes(const Body& body) {
  detail::ShapeCheck check(body);
  for (std::size_t f = 0; f < body.facets.size(); ++f) {
    const Facet& facet = body.facets[f];
    if (facet.patch == Body::mirror_patch) continue;
    if (facet.patch < 0 || std::size_t(facet.patch) >= body.patches.size())
      throw MeshError(MeshError::Reason::bad_index, message("facet ", f, " is of patch ", facet.patch,
                                                        ", the body has patches 0 to ", int(body.patches.size()) - 1));
    for (const int vertex : facet.loop) {
      if (vertex < 0 || std::size_t(vertex) >= body.vertices.size())
        throw MeshError(MeshError::Reason::bad_index,
            message("facet ", f, " names vertex ", vertex, ", the body has ", body.vertices.size()));
      check.add(facet.patch, body.vertices[std::size_t(vertex)]);
    }
  }
  check.require("vertices");
}

}  // namespace lumo

#endif

// ---- lumo/mesh/mesher.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_MESHER_HPP
#define SINGLE_INCLUDE_LUMO_MESH_MESHER_HPP

namespace lumo {

/// A closed surface to be filled, with a wanted edge length. Vertices of no facet are interior points.
struct MeshInput : ClosedSurface {
  std::function<double(const Vec3d&)> edge;  ///< wanted edge length, same unit; may be empty
  bool keep_surface = false;                 ///< do not split the given facets
};

/// Straight tetrahedra that fill a MeshInput. Boundary triangles are counter-clockwise seen from outside and carry
/// their facet's patch.
struct LinearTets {
  std::vector<Vec3d> vertices;
  std::vector<std::array<int, 4>> tets;  ///< positive orientation: (b−a)×(c−a)·(d−a) > 0
  std::vector<std::array<int, 3>> faces;
  std::vector<int> patches;  ///< one per face
};

/// Fills a closed surface with tetrahedra. Law: same input, same bits. Throws MeshError, never anything else.
template <class M>
concept Mesher = requires(const M& mesher, const MeshInput& input) {
  { mesher.fill(input) } -> std::same_as<LinearTets>;
};

}  // namespace lumo

#endif

// ---- lumo/mesh/body_mesh.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_BODY_MESH_HPP
#define SINGLE_INCLUDE_LUMO_MESH_BODY_MESH_HPP

namespace lumo {

/// The mesh together with its mirror image in the plane x = 0 (`axis` 0) or y = 0 (`axis` 1). Nodes with that
/// coordinate exactly 0 are shared; all other nodes lie on the positive side. Original nodes keep their numbers; images
/// follow.
inline TetMesh mirrored(const TetMesh& half, int axis) {
  TetMesh whole = half;
  const std::size_t n = half.nodes.size();
  std::vector<int> image(n);
  for (std::size_t k = 0; k < n; ++k) {
    if (half.nodes[k][axis] == 0.0) {
      image[k] = int(k);
      continue;
    }
    image[k] = int(whole.nodes.size());
    Vec3d x = half.nodes[k];
    x[axis] = -x[axis];
    whole.nodes.push_back(x);
  }
  const auto of = [&](int node) { return node < 0 ? node : image[std::size_t(node)]; };
  // A mirror image has the other orientation: exchange two corners, and the edge nodes that go with them.
  for (const auto& t : half.tets)
    whole.tets.push_back(
        {of(t[1]), of(t[0]), of(t[2]), of(t[3]), of(t[4]), of(t[6]), of(t[5]), of(t[8]), of(t[7]), of(t[9])});
  for (const BoundaryFace& f : half.faces)
    whole.faces.push_back(
        {{of(f.nodes[1]), of(f.nodes[0]), of(f.nodes[2]), of(f.nodes[3]), of(f.nodes[5]), of(f.nodes[4])}, f.patch});

  std::vector<int> partner(whole.nodes.size());
  for (std::size_t k = 0; k < n; ++k) {
    partner[k] = image[k];
    partner[std::size_t(image[k])] = int(k);
  }
  // The other plane's pairing carries over to the images.
  const auto extended = [&](const std::vector<int>& pairs) {
    std::vector<int> all(pairs);
    all.resize(whole.nodes.size());
    for (std::size_t k = 0; k < pairs.size(); ++k) all[std::size_t(image[k])] = image[std::size_t(pairs[k])];
    return all;
  };
  if (axis == 0) {
    whole.symmetry.x = true;
    whole.mirror_x = partner;
    if (half.symmetry.y) whole.mirror_y = extended(half.mirror_y);
  } else {
    whole.symmetry.y = true;
    whole.mirror_y = partner;
    if (half.symmetry.x) whole.mirror_x = extended(half.mirror_x);
  }
  return whole;
}

/// Meshes a body: its sector is filled with tetrahedra, boundary nodes are moved to the exact shapes, edges get middle
/// nodes (also on the exact shapes, `order` 2), and the mirror images are added, so that the mesh is exactly symmetric
/// where the body is. Throws MeshError when the surface is bad, the mesher fails, or the result fails a quality gate:
/// require_valid(), and require_on_shapes() of the facets' vertices.
template <Mesher M> TetMesh mesh_body(const Body& body, const M& mesher, int order = 2);

namespace detail {

// Patches that meet at each vertex or edge of the sector's boundary.
using PatchSet = std::set<int>;

// Signed distance of a point from a patch's shape, and the normal there.
struct OffShape {
  double gap;
  Vec3d normal;
};

inline OffShape off_shape(const Body& body, int patch, const Vec3d& p) {
  const Shape& shape = body.patches[std::size_t(patch)].shape;
  const Vec3d n = outward_normal(shape, p);
  return {n.dot(p - closest_point(shape, p)), n};
}

// Newton's shortest step to where two patches meet; it halves the way where they touch (a double root).
inline Vec3d toward_seam(const Body& body, int first, int second, const Vec3d& p) {
  const auto [g, m] = off_shape(body, first, p);
  const auto [h, n] = off_shape(body, second, p);
  const double c = m.dot(n), sine2 = m.cross(n).squaredNorm();
  if (!(sine2 > 1e-20)) return Vec3d::Zero();
  return -((g - c * h) / sine2) * m - ((h - c * g) / sine2) * n;
}

// Onto all of the patches: by turns, which is all that it takes where they meet at right angles, then by Newton's
// method.
inline Vec3d snapped(const Body& body, const PatchSet& patches, std::type_identity_t<Vec3d> p, double tiny) {
  std::vector<int> real;
  std::copy_if(patches.begin(), patches.end(), std::back_inserter(real), [](int patch) { return patch >= 0; });
  for (int round = 0; round < 2; ++round)
    for (int patch : real) p = closest_point(body.patches[std::size_t(patch)].shape, p);
  const auto is_off = [&](int patch) { return !(std::abs(off_shape(body, patch, p).gap) <= tiny); };
  constexpr int most_rounds = 60;
  for (int round = 0; round < most_rounds && real.size() > 1; ++round) {
    if (std::none_of(real.begin(), real.end(), is_off)) break;
    for (std::size_t i = 0; i < real.size(); ++i)
      for (std::size_t j = i + 1; j < real.size(); ++j) p = p + toward_seam(body, real[i], real[j], p);
  }
  if (body.symmetry.x && std::abs(p.x()) < tiny) p.x() = 0.0;
  if (body.symmetry.y && std::abs(p.y()) < tiny) p.y() = 0.0;
  return p;
}

inline void make_quadratic(
    const Body& body, TetMesh& mesh, const std::map<std::pair<int, int>, PatchSet>& boundary_edges, double tiny) {
  std::map<std::pair<int, int>, int> middle;
  const auto middle_of = [&](int a, int b) {
    const std::pair<int, int> key = std::minmax(a, b);
    const auto [it, fresh] = middle.try_emplace(key, int(mesh.nodes.size()));
    if (fresh) {
      const Vec3d &from = mesh.nodes[std::size_t(a)], &to = mesh.nodes[std::size_t(b)], half = 0.5 * (from + to);
      const auto on_surface = boundary_edges.find(key);
      mesh.nodes.push_back(on_surface == boundary_edges.end() ? half : snapped(body, on_surface->second, half, tiny));
    }
    return it->second;
  };
  for (auto& t : mesh.tets)
    for (std::size_t k = 0; k < 6; ++k)
      t[4 + k] = middle_of(t[std::size_t(tet_edges[k][0])], t[std::size_t(tet_edges[k][1])]);
  for (BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) f.nodes[3 + k] = middle_of(f.nodes[k], f.nodes[(k + 1) % 3]);
  mesh.order = 2;
}

}  // namespace detail

template <Mesher M> TetMesh mesh_body(const Body& body, const M& mesher, int order) {
  if (order != 1 && order != 2) throw InvalidArgument(message("mesh order is ", order, ", must be 1 or 2"));
  const double stretch = body.sizing.stretch_y;
  require_positive("mesh stretch along y", stretch, "");
  require_on_shapes(body);
  MeshInput input;
  input.facets = body.facets;
  // In squeezed space wanted edges are equally long in all directions; lengths in mm keep the mesher's tolerances away
  // from zero.
  for (const Vec3d& v : body.vertices) input.vertices.emplace_back(1e3 * v.x(), 1e3 * v.y() / stretch, 1e3 * v.z());
  if (body.sizing.edge)
    input.edge = [&body, stretch](
                     const Vec3d& p) { return 1e3 * body.sizing.edge(1e-3 * Vec3d(p.x(), p.y() * stretch, p.z())); };
  const auto filled = mesher.fill(input);

  TetMesh mesh;
  mesh.order = 1;
  for (const Vec3d& v : filled.vertices) mesh.nodes.emplace_back(1e-3 * v.x(), 1e-3 * v.y() * stretch, 1e-3 * v.z());
  double size = 0.0;
  for (const Vec3d& v : body.vertices) size = std::max(size, v.lpNorm<Eigen::Infinity>());
  const double tiny = 1e-9 * size;
  for (const auto& t : filled.tets) mesh.tets.push_back({t[0], t[1], t[2], t[3], -1, -1, -1, -1, -1, -1});

  std::map<int, detail::PatchSet> vertex_patches;
  std::map<std::pair<int, int>, detail::PatchSet> edge_patches;
  for (std::size_t f = 0; f < filled.faces.size(); ++f) {
    const auto& face = filled.faces[f];
    const int patch = filled.patches[f];
    for (std::size_t k = 0; k < 3; ++k) {
      vertex_patches[face[k]].insert(patch);
      edge_patches[std::minmax(face[k], face[(k + 1) % 3])].insert(patch);
    }
    if (patch != Body::mirror_patch) mesh.faces.push_back({{face[0], face[1], face[2], -1, -1, -1}, patch});
  }
  for (const auto& [vertex, patches] : vertex_patches)
    mesh.nodes[std::size_t(vertex)] = detail::snapped(body, patches, mesh.nodes[std::size_t(vertex)], tiny);
  if (order == 2) detail::make_quadratic(body, mesh, edge_patches, tiny);
  if (body.symmetry.x) mesh = mirrored(mesh, 0);
  if (body.symmetry.y) mesh = mirrored(mesh, 1);
  std::stable_sort(mesh.faces.begin(), mesh.faces.end(),
      [](const BoundaryFace& a, const BoundaryFace& b) { return a.patch < b.patch; });
  // The faces of a straight-sided mesh cut the curved profile short; only the quadratic one is held to the exact
  // volume.
  require_valid(mesh, order == 2 ? body.exact_volume_m3 : 0.0);
  return mesh;
}

}  // namespace lumo

#endif

// ---- lumo/mesh/size_field.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_SIZE_FIELD_HPP
#define SINGLE_INCLUDE_LUMO_MESH_SIZE_FIELD_HPP

namespace lumo {

/// A wanted edge length, sampled on an octree over a box so that it can be sent to another process. Trilinear in each
/// leaf. Leaves are split where the samples at their middles differ from the interpolation by more than `tolerance`
/// (relative) and are larger than half the wanted length, down to `max_depth`, with at most `max_cells` cells in all.
struct SizeField {
  struct Cell {
    std::array<double, 8> corners;  ///< wanted length at (x + 2 y + 4 z), each 0 or 1
    int child = -1;                 ///< first of eight children, or −1
    int unused = 0;                 ///< keeps the bytes defined
  };

  Vec3d low{0.0, 0.0, 0.0};
  double side = 0.0;        ///< of the root cube
  std::vector<Cell> cells;  ///< empty: no wish

  static constexpr int min_depth = 3;
  static constexpr int max_depth = 9;
  static constexpr std::size_t max_cells = 60000;
  static constexpr double tolerance = 0.05;

  static SizeField sample(const std::function<double(const Vec3d&)>& edge, const Vec3d& low, const Vec3d& high);

  double operator()(const Vec3d& point) const {
    Vec3d local = ((point - low) / side).cwiseMax(0.0).cwiseMin(1.0);
    int cell = 0;
    while (cells[static_cast<std::size_t>(cell)].child >= 0) {
      int octant = 0;
      for (int axis = 0; axis < 3; ++axis) {
        local[axis] *= 2.0;
        if (local[axis] >= 1.0) {
          local[axis] -= 1.0;
          octant |= 1 << axis;
        }
      }
      cell = cells[static_cast<std::size_t>(cell)].child + octant;
    }
    return trilinear(cells[static_cast<std::size_t>(cell)].corners, local);
  }

  static double trilinear(const std::array<double, 8>& c, const Vec3d& t) {
    const auto mix = [](double a, double b, double s) { return a + (b - a) * s; };
    return mix(mix(mix(c[0], c[1], t.x()), mix(c[2], c[3], t.x()), t.y()),
        mix(mix(c[4], c[5], t.x()), mix(c[6], c[7], t.x()), t.y()), t.z());
  }
};

/// Samples `edge` inside the box [low, high] only. Throws MeshError (not_finite) where it is not finite and positive;
/// what `edge` itself throws passes through.
inline SizeField SizeField::sample(
    const std::function<double(const Vec3d&)>& edge, const Vec3d& low, const Vec3d& high) {
  SizeField field;
  if (!edge) return field;
  field.side = (high - low).maxCoeff();
  field.low = 0.5 * (low + high) - Vec3d::Constant(0.5 * field.side);
  const auto value = [&](const Vec3d& at) {
    const Vec3d point = elementwise_min(elementwise_max(at, low), high);
    const double length = edge(point);
    if (std::isfinite(length) && length > 0.0) return length;
    throw MeshError(MeshError::Reason::not_finite,
        message("wanted edge length at (", point.x(), ", ", point.y(), ", ", point.z(), ") is ", length,
            ", must be finite and > 0, in the unit of the coordinates"));
  };
  struct Task {
    int cell;
    int depth;
    Vec3d low;
    double side;
  };
  const auto corner = [](int i) { return Vec3d(i & 1, (i >> 1) & 1, (i >> 2) & 1); };
  Cell root;
  for (int i = 0; i < 8; ++i) root.corners[static_cast<std::size_t>(i)] = value(field.low + field.side * corner(i));
  field.cells.push_back(root);
  std::vector<Task> tasks{{0, 0, field.low, field.side}};
  for (std::size_t next = 0; next < tasks.size(); ++next) {  // breadth first: if cells run out, they run out evenly
    const Task task = tasks[next];
    const bool outside = (task.low.array() > high.array()).any() || (task.low.array() + task.side < low.array()).any();
    if (outside || task.depth >= max_depth || field.cells.size() + 8 > max_cells) continue;
    const std::array<double, 8> corners = field.cells[static_cast<std::size_t>(task.cell)].corners;
    std::array<double, 27> grid;
    double error = 0.0;
    double least = corners[0];
    for (int i = 0; i < 27; ++i) {
      const Vec3d local = 0.5 * Vec3d(i % 3, (i / 3) % 3, i / 9);
      const double exact = value(task.low + task.side * local);
      error = std::max(error, std::abs(exact - trilinear(corners, local)) / exact);
      least = std::min(least, exact);
      grid[static_cast<std::size_t>(i)] = exact;
    }
    if (task.depth >= min_depth && (error <= tolerance || task.side <= 0.5 * least)) continue;
    const int first = static_cast<int>(field.cells.size());
    field.cells[static_cast<std::size_t>(task.cell)].child = first;
    for (int octant = 0; octant < 8; ++octant) {
      Cell cell;
      for (int i = 0; i < 8; ++i) {
        const int x = (octant & 1) + (i & 1);
        const int y = ((octant >> 1) & 1) + ((i >> 1) & 1);
        const int z = ((octant >> 2) & 1) + ((i >> 2) & 1);
        cell.corners[static_cast<std::size_t>(i)] = grid[static_cast<std::size_t>(x + 3 * y + 9 * z)];
      }
      field.cells.push_back(cell);
      tasks.push_back({first + octant, task.depth + 1, task.low + 0.5 * task.side * corner(octant), 0.5 * task.side});
    }
  }
  return field;
}

/// Mesh grading about the places where an indenter touches: the contact radius grows with the load, so edges that grow
/// in proportion to the distance resolve the edge of every contact equally well.
struct Focus {
  double finest = 0.4e-3;     ///< edge length at a place of touch [m]
  double growth = 0.12;       ///< edge length gained per distance from it
  double depth_growth = 0.7;  ///< and per depth below it: only the surface has to follow the edge of contact
  double of_tool = 0.2;       ///< edges at a place of touch are no longer than this part of the tool's contact radius

  /// All edges `factor` times as long.
  constexpr Focus scaled(double factor) const {
    return {factor * finest, factor * growth, factor * depth_growth, of_tool};
  }
  bool operator==(const Focus&) const = default;
};

/// A place of a body's surface, and the edge length that a mesh is to have there [m].
struct FinePlace {
  Vec3d place_m;
  double finest_m;
};

/// The body with its mesh sizing refined about the given places and their mirror images; `focus` says how edges grow
/// from there, which is all for a body that wants no lengths. Throws InvalidArgument.
inline Body focused(Body body, std::vector<FinePlace> places, const Focus& focus = {}) {
  for (const FinePlace& p : places) require_in_range("finest mesh edge", p.finest_m * 1e3, 0.02, 30.0, "mm");
  require_in_range("mesh growth about the contact", focus.growth, 0.01, 10.0, "");
  require_in_range("mesh growth with depth", focus.depth_growth, 0.0, 1e3, "");
  require_in_range("mesh edge over the tool's contact radius", focus.of_tool, 0.001, 1000.0, "");
  if (places.empty()) return body;
  for (FinePlace& p : places) {
    if (body.symmetry.x) p.place_m.x() = std::abs(p.place_m.x());
    if (body.symmetry.y) p.place_m.y() = std::abs(p.place_m.y());
  }
  body.sizing.edge = [coarse = body.sizing.edge, under_touch = body.sizing.edge_under_touch, places = std::move(places),
                         focus](const Vec3d& p) {
    double edge = coarse ? coarse(p) : std::numeric_limits<double>::infinity();
    for (const FinePlace& f : places) {
      const double depth = std::max(0.0, (f.place_m - p).z());
      edge = std::min(edge, f.finest_m + focus.growth * (p - f.place_m).norm() + focus.depth_growth * depth);
      if (under_touch) edge = std::min(edge, under_touch(p, f.place_m));
    }
    return edge;
  };
  return body;
}

/// The same about points, with the focus's own finest edge.
inline Body focused(Body body, const std::vector<Vec3d>& points, const Focus& focus = {}) {
  std::vector<FinePlace> places;
  for (const Vec3d& p : points) places.push_back({p, focus.finest});
  return focused(std::move(body), std::move(places), focus);
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact_mesh.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_MESH_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_MESH_HPP

namespace lumo {

namespace detail {

// Nearer than this part of the tool's contact radius, a surface counts as touched with it; places nearer to each other
// than the next one are one. A ball that touches a plane has one, whatever its size.
inline constexpr double near_part = 0.01, apart_part = 0.25;

// Calls visit(point of the exact surface) on a lattice over a face, at most `spacing` apart.
template <class Visit>
void for_points_on(const BoundaryFace& f, const TetMesh& mesh, const Shape& shape, double spacing, Visit&& visit) {
  constexpr int most_cuts = 40;
  const Vec3d a = mesh.nodes[std::size_t(f.nodes[0])], b = mesh.nodes[std::size_t(f.nodes[1])] - a,
              c = mesh.nodes[std::size_t(f.nodes[2])] - a;
  const double longest = std::max({b.norm(), c.norm(), (c - b).norm()});
  const int cuts = int(std::clamp(std::ceil(longest / spacing), 1.0, double(most_cuts)));
  for (int i = 0; i <= cuts; ++i)
    for (int j = 0; i + j <= cuts; ++j) visit(closest_point(shape, a + (double(i) * b + double(j) * c) / cuts));
}

}  // namespace detail

/// Places where the surface is as good as touched when the indenter first touches it: the place of first touch, and
/// others that stand for what lies farther along a line, on a face, or under a second part of the tool. Throws
/// InvalidArgument when the indenter passes by.
template <Indenter Tool>
std::vector<Vec3d> touched_places(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Touch touch = first_touch(body, mesh, scenario);
  const double radius = contact_radius(scenario.indenter), apart = detail::apart_part * radius,
               near = detail::near_part * radius;
  std::vector<Vec3d> places = {touch.point};
  for (const BoundaryFace& f : mesh.faces) {
    const Patch& patch = body.patches[std::size_t(f.patch)];
    if (!patch.contactable) continue;
    const Vec3d corner = mesh.nodes[std::size_t(f.nodes[0])];
    const double size = std::max(
        (mesh.nodes[std::size_t(f.nodes[1])] - corner).norm(), (mesh.nodes[std::size_t(f.nodes[2])] - corner).norm());
    if (scenario.indenter.distance(corner - touch.origin) > 2.0 * size + near) continue;
    detail::for_points_on(f, mesh, patch.shape, 0.5 * apart, [&](const Vec3d& p) {
      if (scenario.indenter.distance(p - touch.origin) > near) return;
      for (const Vec3d& known : places)
        if ((p - known).norm() < apart) return;
      places.push_back(p);
    });
  }
  return places;
}

/// The body with its mesh sizing refined where the scenarios' indenters first touch it (touched_places), and in the
/// mirror images of those places. `coarse` is any mesh of the body. Throws InvalidArgument when an indenter passes by.
template <Indenter Tool> Body focused_on_contact(
    const Body& body, const TetMesh& coarse, const std::vector<Scenario<Tool>>& scenarios, const Focus& focus = {}) {
  std::vector<Vec3d> touches;
  Focus fine = focus;
  for (const Scenario<Tool>& s : scenarios) {
    const std::vector<Vec3d> touched = touched_places(body, coarse, s);
    touches.insert(touches.end(), touched.begin(), touched.end());
    fine.finest = std::min(fine.finest, focus.of_tool * contact_radius(s.indenter));
  }
  return focused(body, touches, fine);
}

/// A mesh of that body. Throws MeshError when it cannot be meshed.
template <Mesher M, Indenter Tool> TetMesh mesh_for_contact(const Body& body, const TetMesh& coarse,
    const std::vector<Scenario<Tool>>& scenarios, const M& mesher, const Focus& focus = {}, int order = 2) {
  return mesh_body(focused_on_contact(body, coarse, scenarios, focus), mesher, order);
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/indenters/box.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_BOX_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_BOX_HPP

namespace lumo {

/// Signed distance from p to the box |x| ≤ half about the origin.
template <class S> S box_distance(const Vec3d& half, const Vec3<S>& p) {
  using std::abs;
  Vec3<S> out;
  S most = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const S beyond = abs(p[i]) - half[i];
    out[i] = beyond < 0.0 ? S(0.0) : beyond;
    if (i == 0 || beyond > most) most = beyond;
  }
  return most <= 0.0 ? most : S(out.norm());
}

/// The same with its derivatives.
inline DistanceSample distance_to_box(const Vec3d& half, const Vec3d& p) {
  Vec3d sign, beyond, out;
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    sign[i] = p[i] < 0.0 ? -1.0 : 1.0;
    beyond[i] = std::abs(p[i]) - half[i];
    out[i] = std::max(beyond[i], 0.0);
    if (beyond[i] > beyond[axis]) axis = i;
  }
  if (beyond[axis] <= 0.0) {
    Vec3d n = Vec3d::Zero();
    n[axis] = sign[axis];
    return {beyond[axis], n, Mat3d::Zero()};
  }
  const double r = out.norm();
  Vec3d n = out / r;
  Mat3d h = Mat3d::Zero();  // only the directions that are outside bend the distance
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (out[i] > 0.0 && out[j] > 0.0) h(i, j) = ((i == j ? 1.0 : 0.0) - n[i] * n[j]) / r * sign[i] * sign[j];
  for (int i = 0; i < 3; ++i) n[i] *= sign[i];
  return {r, n, h};
}

/// Distances to a box of half edges `half` whose edges and corners are rounded, inside it, by `radius`.
template <class S> S rounded_box_distance(const Vec3d& half, double radius, const Vec3<S>& p) {
  return box_distance(Vec3d(half - Vec3d::Constant(radius)), p) - radius;
}
inline DistanceSample distance_to_rounded_box(const Vec3d& half, double radius, const Vec3d& p) {
  DistanceSample d = distance_to_box(half - Vec3d::Constant(radius), p);
  d.distance -= radius;
  return d;
}

/// Rigid box with edges along the finger's axes, rounded where `edge_radius_m` > 0. Sharp edges concentrate stress
/// without limit: round them.
struct Box {
  Vec3d size_m{10e-3, 10e-3, 10e-3};
  double edge_radius_m = 0.5e-3;

  bool operator==(const Box&) const = default;

  double radius_m() const { return 0.5 * size_m.norm(); }
  double contact_radius_m() const { return 0.5 * size_m.minCoeff(); }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const {
    return rounded_box_distance(Vec3d(0.5 * size_m), edge_radius_m, p);
  }
  DistanceSample sample(const Vec3d& p) const { return distance_to_rounded_box(0.5 * size_m, edge_radius_m, p); }
};

inline void validate(const Box& b) {
  for (double side : {b.size_m.x(), b.size_m.y(), b.size_m.z()})
    require_in_range("box side", side * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the box", b.edge_radius_m * 1e3, 0.0, 0.499 * b.size_m.minCoeff() * 1e3, "mm");
}

static_assert(Indenter<Box>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/carrier.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CARRIER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CARRIER_HPP

namespace lumo {

/// What a body rests on, as a signed distance: to the union of its rigid boxes, +infinity if there are none. The origin
/// of its frame is the finger's.
struct Carrier {
  std::vector<RigidBox> boxes;

  double distance(const Vec3d& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const RigidBox& b : boxes)
      if (may_be_nearer(b, p, least))
        least = std::min(least, rounded_box_distance(b.half, b.edge_radius, Vec3d(p - b.center)));
    return least;
  }
  DistanceSample sample(const Vec3d& p) const {
    DistanceSample nearest{std::numeric_limits<double>::infinity(), Vec3d::UnitZ(), Mat3d::Zero()};
    for (const RigidBox& b : boxes) {
      if (!may_be_nearer(b, p, nearest.distance)) continue;
      const DistanceSample d = distance_to_rounded_box(b.half, b.edge_radius, p - b.center);
      if (d.distance < nearest.distance) nearest = d;
    }
    return nearest;
  }

 private:
  /// Most of a surface's points are far from most boxes: the distance along one axis decides, but for rounding.
  static bool may_be_nearer(const RigidBox& b, const Vec3d& p, double distance) {
    return ((p - b.center).cwiseAbs() - b.half).maxCoeff() < distance + 1e-12;
  }
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/contact_handler.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_HANDLER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_HANDLER_HPP

namespace lumo {

/// Response of a contact law to a gap [m]: energy per reference area [J/m²], pressure [Pa] = −dE/dg, stiffness [N/m³]
/// = d²E/dg².
template <class S> struct ContactResponse {
  S energy;
  S pressure;
  S stiffness;
};

/// A contact law between the body's surface and a rigid surface. It is frictionless unless it has a `friction`,
/// Coulomb's coefficient, and acts all over the surface unless it has `points`. Laws: no pressure at gaps ≥ 0; pressure
/// ≥ 0; pressure and stiffness are the derivatives of the energy. The gap is a double, or a deduced scalar.
template <class C>
concept ContactHandler = requires(const C& contact, double gap) {
  { contact.respond(gap) } -> std::convertible_to<ContactResponse<double>>;
  { contact.stiffness_N_per_m3 } -> std::convertible_to<double>;
  validate(contact);
};

/// Where a contact law acts: at many points inside all faces, or at the mesh's nodes, each with its share of the area.
enum class ContactPoints { surface, vertices };

template <ContactHandler Contact> constexpr ContactPoints contact_points() {
  if constexpr (requires {
                  { Contact::points } -> std::convertible_to<ContactPoints>;
                })
    return Contact::points;
  else return ContactPoints::surface;
}

/// Coulomb's coefficient of a law; 0 where it has none.
template <ContactHandler Contact> double friction_coefficient(const Contact& contact) {
  if constexpr (requires { contact.friction; }) return contact.friction;
  else return 0.0;
}

/// The same with the carrier: as with the tool, unless the law has one of its own.
template <ContactHandler Contact> double carrier_friction(const Contact& contact) {
  if constexpr (requires { contact.carrier_friction; })
    return contact.carrier_friction.value_or(friction_coefficient(contact));
  else return friction_coefficient(contact);
}

/// Area [m²] that the law gives each vertex instead of its share of the surface; 0: its share.
template <ContactHandler Contact> double area_per_vertex(const Contact& contact) {
  if constexpr (requires { contact.area_per_vertex_m2; }) return contact.area_per_vertex_m2;
  else return 0.0;
}

/// How near [m] a sub-triangle of the surface must come to a tool to belong to the contact set, as a collision pipeline
/// records it, with force or without; 0: the set is where the surface touches.
template <ContactHandler Contact> double record_margin(const Contact& contact) {
  if constexpr (requires { contact.record_margin_m; }) return contact.record_margin_m;
  else return 0.0;
}

/// Response of a spring of `stiffness` [N/m³] to a gap; 0 while it is open.
template <class S> ContactResponse<S> penalty(double stiffness, const S& gap) {
  if (gap >= 0.0) return {0.0, 0.0, 0.0};
  return {0.5 * stiffness * gap * gap, -stiffness * gap, stiffness};
}

/// Penalty on the signed distance, over the full surface (points inside faces, not only vertices), per reference area.
/// Source: paper §III-B ("signed-distance full-surface rigid–soft collision").
struct SDFContact {
  double stiffness_N_per_m3 = 1e11;             ///< overlap at 0.3 MPa is 3 µm
  double friction = 0.0;                        ///< Coulomb's coefficient
  double record_margin_m = 0.0;                 ///< see record_margin
  std::optional<double> carrier_friction = {};  ///< Coulomb's coefficient with the carrier; nullopt: `friction`

  template <class S> ContactResponse<S> respond(const S& gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const SDFContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
  require_in_range("margin of contact records", c.record_margin_m * 1e3, 0.0, 10.0, "mm");
  require_in_range("friction coefficient of the carrier", carrier_friction(c), 0.0, 10.0, "");
}

static_assert(ContactHandler<SDFContact>);

/// A contact law with its penalty stiffness scaled.
template <class Contact> struct ScaledContact {
  const Contact* law;
  double scale;
  double stiffness_N_per_m3 = scale * law->stiffness_N_per_m3;
  double friction = friction_coefficient(*law);
  static constexpr ContactPoints points = contact_points<Contact>();

  template <class S> ContactResponse<S> respond(const S& gap) const {
    const ContactResponse<S> r = law->respond(gap);
    return {scale * r.energy, scale * r.pressure, scale * r.stiffness};
  }
};

template <class Contact> void validate(const ScaledContact<Contact>& c) {
  validate(*c.law);
  require_in_range("factor on contact pressures", c.scale, 1e-6, 1e6, "");
}

static_assert(ContactHandler<ScaledContact<SDFContact>>);

/// Penalty at the mesh's nodes with Coulomb friction, as Newton 1.8 has it: faces may overlap the indenter between
/// their nodes. A solver that goes in time steps takes each node's tangent plane of the indenter at the step's start
/// (`plane_frozen`). Newton's stiffness k_e [N/m] belongs to a vertex, whatever its share of the surface: that is
/// stiffness_N_per_m3 · area_per_vertex_m2.
struct VertexContact {
  static constexpr ContactPoints points = ContactPoints::vertices;
  static constexpr bool plane_frozen = true;
  double stiffness_N_per_m3 = 1e11;
  double friction = 0.5;                        ///< Coulomb's coefficient
  double area_per_vertex_m2 = 0.0;              ///< the same for all; 0: each vertex has its share of the surface
  double record_margin_m = 0.0;                 ///< see record_margin
  std::optional<double> carrier_friction = {};  ///< with the carrier; nullopt: `friction`

  template <class S> ContactResponse<S> respond(const S& gap) const { return penalty(stiffness_N_per_m3, gap); }
};

inline void validate(const VertexContact& c) {
  require_in_range("contact stiffness", c.stiffness_N_per_m3, 1e6, 1e15, "N/m3");
  require_in_range("friction coefficient", c.friction, 0.0, 10.0, "");
  require_in_range("contact area per vertex", c.area_per_vertex_m2 * 1e6, 0.0, 1e6, "mm2");
  require_in_range("margin of contact records", c.record_margin_m * 1e3, 0.0, 10.0, "mm");
  require_in_range("friction coefficient of the carrier", carrier_friction(c), 0.0, 10.0, "");
}

static_assert(ContactHandler<VertexContact>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/elements/linear_solver.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_LINEAR_SOLVER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_LINEAR_SOLVER_HPP

namespace lumo {

/// Lower triangle of a symmetric matrix, compressed by columns.
using SparseLower = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

enum class FactorStatus { positive_definite, not_positive_definite, non_finite };

/// Direct solver for symmetric positive definite systems. analyze() sees the pattern once; copies share or copy that
/// analysis. Laws: factorize() reports every matrix that is not positive definite or not finite; equal input, equal
/// bits.
template <class S>
concept LinearSolver = std::copyable<S> && std::default_initializable<S> &&
    requires(S solver, const SparseLower& lower, const Eigen::MatrixXd& rhs) {
  solver.analyze(lower);
  { solver.factorize(lower) } -> std::same_as<FactorStatus>;
  { solver.solve(rhs) } -> std::convertible_to<Eigen::MatrixXd>;
};

/// One whose factor is an approximation that its solutions are refined from. precondition() is a solution as the factor
/// gives it, to some digits; certify() states whether the matrix itself is positive definite.
template <class S>
concept RefiningSolver = LinearSolver<S> && requires(S solver, const Eigen::VectorXd& rhs) {
  { solver.precondition(rhs) } -> std::convertible_to<Eigen::VectorXd>;
  { solver.certify() } -> std::same_as<FactorStatus>;
};

/// Eigen's own sparse Cholesky factorisation: needs nothing else, but is some twenty times slower than a supernodal
/// one.
class EigenCholesky {
 public:
  EigenCholesky() = default;
  EigenCholesky(const EigenCholesky& other) { *this = other; }
  EigenCholesky& operator=(const EigenCholesky& other) {  // Eigen's solver does not copy: analyse again
    if (this != &other && other.pattern_.size() > 0) analyze(other.pattern_);
    return *this;
  }

  void analyze(const SparseLower& lower) {
    pattern_ = lower;
    solver_.analyzePattern(lower);
  }
  FactorStatus factorize(const SparseLower& lower) {
    // A Cholesky factorisation of NaN reports success, so finiteness is checked here.
    if (!Eigen::Map<const Eigen::ArrayXd>(lower.valuePtr(), lower.nonZeros()).isFinite().all())
      return FactorStatus::non_finite;
    solver_.factorize(lower);
    return solver_.info() == Eigen::Success ? FactorStatus::positive_definite : FactorStatus::not_positive_definite;
  }
  Eigen::MatrixXd solve(const Eigen::MatrixXd& rhs) const { return solver_.solve(rhs); }

 private:
  SparseLower pattern_;
  Eigen::SimplicialLLT<SparseLower, Eigen::Lower> solver_;
};

static_assert(LinearSolver<EigenCholesky>);

}  // namespace lumo

#endif

// ---- lumo/mesh/sector.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_SECTOR_HPP
#define SINGLE_INCLUDE_LUMO_MESH_SECTOR_HPP

namespace lumo {

/// The part of a symmetric mesh on the positive side of some of its symmetry planes, as a mesh of its own.
struct Sector {
  Symmetry planes;  ///< planes that bound it
  TetMesh mesh;
  std::vector<int> to_whole;  ///< sector node → node of the whole mesh

  /// What part of the whole it is: 1, ½ or ¼.
  double fraction() const { return (planes.x ? 0.5 : 1.0) * (planes.y ? 0.5 : 1.0); }
};

/// Throws InvalidArgument when the mesh is not symmetric in a wanted plane.
inline Sector sector_of(const TetMesh& whole, Symmetry planes);

/// A field of vectors on the sector's nodes, mirrored to the whole mesh.
inline std::vector<Vec3d> unfold(const TetMesh& whole, const Sector& sector, const std::vector<Vec3d>& field);

/// A field of numbers on the sector's nodes, mirrored to the whole mesh.
inline std::vector<double> unfold(const TetMesh& whole, const Sector& sector, const std::vector<double>& field);

inline Sector sector_of(const TetMesh& whole, Symmetry planes) {
  if ((planes.x && !whole.symmetry.x) || (planes.y && !whole.symmetry.y))
    throw InvalidArgument("sector: the mesh is not symmetric in the wanted plane");
  Sector s;
  s.planes = planes;
  s.mesh.order = whole.order;
  std::vector<int> number(whole.nodes.size(), -1);
  for (std::size_t k = 0; k < whole.nodes.size(); ++k) {
    if ((planes.x && whole.nodes[k].x() < 0.0) || (planes.y && whole.nodes[k].y() < 0.0)) continue;
    number[k] = int(s.to_whole.size());
    s.to_whole.push_back(int(k));
    s.mesh.nodes.push_back(whole.nodes[k]);
  }
  const auto keep = [&](const auto& nodes, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i)
      if (number[std::size_t(nodes[i])] < 0) return false;
    return true;
  };
  const auto renumber = [&](auto nodes) {
    for (int& n : nodes) n = n < 0 ? n : number[std::size_t(n)];
    return nodes;
  };
  for (const auto& t : whole.tets)
    if (keep(t, std::size_t(whole.nodes_per_tet()))) s.mesh.tets.push_back(renumber(t));
  for (const BoundaryFace& f : whole.faces)
    if (keep(f.nodes, std::size_t(whole.nodes_per_face()))) s.mesh.faces.push_back({renumber(f.nodes), f.patch});
  return s;
}

namespace detail {

template <class T, class Flip>
std::vector<T> unfolded(const TetMesh& whole, const Sector& sector, const std::vector<T>& field, Flip flip) {
  std::vector<T> all(whole.nodes.size());
  for (std::size_t k = 0; k < field.size(); ++k) all[std::size_t(sector.to_whole[k])] = field[k];
  const auto reflect = [&](const std::vector<int>& partner, int axis) {
    for (std::size_t k = 0; k < whole.nodes.size(); ++k)
      if (whole.nodes[k][axis] < 0.0) all[k] = flip(all[std::size_t(partner[k])], axis);
  };
  if (sector.planes.x) reflect(whole.mirror_x, 0);
  if (sector.planes.y) reflect(whole.mirror_y, 1);
  return all;
}

}  // namespace detail

inline std::vector<Vec3d> unfold(const TetMesh& whole, const Sector& sector, const std::vector<Vec3d>& field) {
  return detail::unfolded(whole, sector, field, [](Vec3d v, int axis) {
    v[axis] = -v[axis];
    return v;
  });
}

inline std::vector<double> unfold(const TetMesh& whole, const Sector& sector, const std::vector<double>& field) {
  return detail::unfolded(whole, sector, field, [](double v, int) { return v; });
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/elements/equations.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_EQUATIONS_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_EQUATIONS_HPP

namespace lumo {

/// How a displacement field behaves under reflection in the planes that bound a sector.
struct Parity {
  bool odd_x = false;
  bool odd_y = false;
  bool operator==(const Parity&) const = default;
};

/// Numbers the free displacement components of a sector's nodes, and holds the sparsity pattern of its tangent.
/// Bonded faces are closed sets: all their nodes are fixed. On a bounding plane an even field has no normal component
/// and an odd field has only that one.
struct Equations {
  std::vector<int> of;  ///< 3 · node + component → equation, −1 where fixed
  int count = 0;
  SparseLower pattern;     ///< lower triangle; values are scratch
  std::vector<int> slots;  ///< per tet, (3N)(3N+1)/2 positions in the pattern's values (row ≥ column, column by
                           ///< column), −1 where fixed

  Equations(const Sector& sector, const Body& body, Parity parity);

  /// Position in the pattern's values of an entry of the lower triangle.
  int slot(int row, int column) const;
};

inline int Equations::slot(int row, int column) const {
  if (row < column) std::swap(row, column);
  const int* begin = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column];
  const int* end = pattern.innerIndexPtr() + pattern.outerIndexPtr()[column + 1];
  return int(std::lower_bound(begin, end, row) - pattern.innerIndexPtr());
}

inline Equations::Equations(const Sector& sector, const Body& body, Parity parity) {
  const TetMesh& mesh = sector.mesh;
  const std::size_t n = mesh.nodes.size();
  std::vector<char> fixed(3 * n, 0);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k)
        for (std::size_t c = 0; c < 3; ++c) fixed[3 * std::size_t(f.nodes[std::size_t(k)]) + c] = 1;
  const auto bound = [&](std::size_t node, std::size_t axis, bool odd) {
    for (std::size_t c = 0; c < 3; ++c)
      if ((c == axis) != odd) fixed[3 * node + c] = 1;
  };
  for (std::size_t k = 0; k < n; ++k) {
    if (sector.planes.x && mesh.nodes[k].x() == 0.0) bound(k, 0, parity.odd_x);
    if (sector.planes.y && mesh.nodes[k].y() == 0.0) bound(k, 1, parity.odd_y);
  }
  of.assign(3 * n, -1);
  for (std::size_t i = 0; i < 3 * n; ++i)
    if (!fixed[i]) of[i] = count++;

  // Node graph first (compact), then the equations of each pair of nodes.
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> near(n);
  for (const auto& t : mesh.tets)
    for (std::size_t a = 0; a < per; ++a)
      for (std::size_t b = 0; b < per; ++b) near[std::size_t(t[a])].push_back(t[b]);
  for (auto& list : near) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  std::vector<int> starts{0}, rows;
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t c = 0; c < 3; ++c) {
      const int column = of[3 * k + c];
      if (column < 0) continue;
      for (int other : near[k])
        for (std::size_t d = 0; d < 3; ++d)
          if (const int row = of[3 * std::size_t(other) + d]; row >= column) rows.push_back(row);
      starts.push_back(int(rows.size()));
    }
  const std::vector<double> zeros(rows.size(), 0.0);
  pattern = Eigen::Map<const SparseLower>(count, count, int(rows.size()), starts.data(), rows.data(), zeros.data());

  slots.reserve(mesh.tets.size() * (3 * per) * (3 * per + 1) / 2);
  for (const auto& t : mesh.tets)
    for (std::size_t j = 0; j < 3 * per; ++j)
      for (std::size_t i = j; i < 3 * per; ++i) {
        const int row = of[3 * std::size_t(t[i / 3]) + i % 3], column = of[3 * std::size_t(t[j / 3]) + j % 3];
        slots.push_back(row < 0 || column < 0 ? -1 : slot(row, column));
      }
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/materials/material.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_MATERIAL_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_MATERIAL_HPP

namespace lumo {

/// A function of the volume ratio J with its derivatives: energy density [J/m³], dU/dJ [Pa], d²U/dJ² [Pa].
template <class S> struct VolumetricSample {
  S energy;
  S stress;
  S stiffness;
};

/// A hyperelastic solid, W(F) = distortion(F) + U(det F). The split lets an element treat the stiff volumetric part U
/// by its mean. A law is written for doubles, or with a deduced scalar (`template <class S> S distortion_energy(const
/// Mat3<S>& F) const` …), so that it can also be differentiated by dual numbers. Laws: P(I) = 0; W(QF) = W(F) for
/// rotations Q; stress and tangent are the derivatives of the energy; W = +∞ where det F ≤ 0 if the law resists
/// inversion. Stress is the first Piola–Kirchhoff stress [Pa], 3 × 3; tangent is ∂P/∂F, 9 × 9, flattened by columns.
template <class M>
concept HyperelasticMaterial = requires(const M& m, const Mat3d& F, double J) {
  { m.distortion_energy(F) } -> std::convertible_to<double>;
  { m.distortion_stress(F) } -> std::convertible_to<Mat3d>;
  { m.distortion_tangent(F) } -> std::convertible_to<Mat9d>;
  { m.volumetric(J) } -> std::convertible_to<VolumetricSample<double>>;
  { m.shear_modulus() } -> std::convertible_to<double>;
  validate(m);
};

/// h'(J) and h''(J) [Pa] of a solid W = μ/2 (I_C − 3) + h(J), as numbers or packs of them.
template <class S> struct DilatationSample {
  S stress;
  S stiffness;
};

/// Derivative of det F by F: the cofactor matrix.
template <class S> Mat3<S> cofactor(const Mat3<S>& F) {
  Mat3<S> c;
  for (int j = 0; j < 3; ++j) {
    const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
    for (int i = 0; i < 3; ++i) {
      const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
      c(i, j) = F(i1, j1) * F(i2, j2) - F(i2, j1) * F(i1, j2);
    }
  }
  return c;
}

/// A⁻ᵀ.
template <class S> Mat3<S> inverse_transposed(const Mat3<S>& A) {
  const Mat3<S> c = cofactor(A);
  return c * (1.0 / (c(0, 0) * A(0, 0) + c(1, 0) * A(1, 0) + c(2, 0) * A(2, 0)));
}

/// Second derivative of det F by F, flattened by columns.
template <class S> Mat9<S> determinant_hessian(const Mat3<S>& F) {
  Mat9<S> h = Mat9<S>::Zero();
  for (int j = 0; j < 3; ++j)
    for (int turn = 1; turn < 3; ++turn)
      for (int i = 0; i < 3; ++i) {
        const int j2 = (j + turn) % 3, next = (i + 1) % 3, last = (i + 2) % 3;
        const S* column = F.data() + 3 * (3 - j - j2);
        h(i + 3 * j, next + 3 * j2) = turn == 1 ? column[last] : -column[last];
        h(i + 3 * j, last + 3 * j2) = turn == 1 ? -column[next] : column[next];
      }
  return h;
}

/// a ⊗ b, both flattened by columns.
template <class S> Mat9<S> dyad(const Mat3<S>& a, const Mat3<S>& b) {
  Mat9<S> product;
  for (int j = 0; j < 9; ++j)
    for (int i = 0; i < 9; ++i) product.data()[i + 9 * j] = a.data()[i] * b.data()[j];
  return product;
}

/// m I of nine rows.
template <class S> Mat9<S> isotropic(const S& m) {
  Mat9<S> diagonal = Mat9<S>::Zero();
  for (int i = 0; i < 9; ++i) diagonal.data()[10 * i] = m;
  return diagonal;
}

/// Energy density W(F) [J/m³].
template <HyperelasticMaterial M, class S> S energy_density(const M& m, const Mat3<S>& F) {
  return m.distortion_energy(F) + m.volumetric(F.determinant()).energy;
}

/// First Piola–Kirchhoff stress P = ∂W/∂F [Pa].
template <HyperelasticMaterial M, class S> Mat3<S> first_piola(const M& m, const Mat3<S>& F) {
  return m.distortion_stress(F) + m.volumetric(F.determinant()).stress * cofactor(F);
}

/// Tangent ∂P/∂F [Pa], 9 × 9, flattened by columns.
template <HyperelasticMaterial M, class S> Mat9<S> elasticity_tangent(const M& m, const Mat3<S>& F) {
  const VolumetricSample<S> u = m.volumetric(F.determinant());
  const Mat3<S> c = cofactor(F);
  return m.distortion_tangent(F) + dyad(u.stiffness * c, c) + u.stress * determinant_hessian(F);
}

}  // namespace lumo

// What nearly incompressible rubber laws share: invariants of the deformation without its volume change, and one
// volumetric energy.
namespace lumo {

/// A function of the deformation gradient with its first and second derivative, the latter flattened by columns.
template <class S> struct InvariantSample {
  S value;
  Mat3<S> gradient;
  Mat9<S> hessian;
};

/// U(J) = κ/4 (J² − 1 − 2 ln J): convex, and without limit at both ends. Source: Simo and Taylor 1991.
template <class S> VolumetricSample<S> convex_volumetric(double bulk, const S& J) {
  using std::log;
  if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
  return {0.25 * bulk * (J * J - 1.0 - 2.0 * log(J)), 0.5 * bulk * (J - 1.0 / J), 0.5 * bulk * (1.0 + 1.0 / (J * J))};
}

namespace detail {

// I J^(−m), from I with its derivatives.
template <class S> InvariantSample<S> without_volume(const Mat3<S>& F, const InvariantSample<S>& full, double m) {
  using std::pow;
  const S J = F.determinant(), scale = pow(J, -m);
  const Mat3<S> c = cofactor(F);
  const Mat9<S> mixed = dyad(full.gradient, c);
  return {scale * full.value, scale * (full.gradient - (m * full.value / J) * c),
      scale * (full.hessian - (m / J) * (mixed + mixed.transpose()) +
                  dyad((m * (m + 1.0) * full.value / (J * J)) * c, c) - (m * full.value / J) * determinant_hessian(F))};
}

}  // namespace detail

/// Ī₁ = J^(−2/3) tr C; det F must be positive.
template <class S> InvariantSample<S> first_isochoric_invariant(const Mat3<S>& F) {
  const InvariantSample<S> full{F.squaredNorm(), 2.0 * F, isotropic(S(2.0))};
  return detail::without_volume(F, full, 2.0 / 3.0);
}

/// Ī₂ = J^(−4/3) tr cof C; det F must be positive.
template <class S> InvariantSample<S> second_isochoric_invariant(const Mat3<S>& F) {
  const Mat3<S> C = F.transpose() * F, B = F * F.transpose();
  const S I1 = C.trace();
  Mat9<S> h;  // 2 (I₁ dF + 2 (F : dF) F − dF C − F dFᵀ F − B dF)
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) {
          const double same_row = i == k ? 1.0 : 0.0, same_column = j == l ? 1.0 : 0.0;
          h(i + 3 * j, k + 3 * l) = 2.0 * (I1 * same_row * same_column + 2.0 * F(i, j) * F(k, l) - same_row * C(l, j) -
                                              F(i, l) * F(k, j) - same_column * B(i, k));
        }
  const InvariantSample<S> full{0.5 * (I1 * I1 - C.squaredNorm()), 2.0 * (I1 * F - F * C), h};
  return detail::without_volume(F, full, 4.0 / 3.0);
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/elements/element.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_ELEMENT_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_ELEMENT_HPP

namespace lumo {

/// Gradients of Lagrange's shape functions by (λ₁, λ₂, λ₃) at xi, 3 × nodes, in the node order of TetMesh.
template <int Nodes, class S> Eigen::Matrix<S, 3, Nodes> shape_gradients(const Vec3<S>& xi) {
  static constexpr double corner[4][3] = {{-1, -1, -1}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  Eigen::Matrix<S, 3, Nodes> g;
  const std::array<S, 4> l = {1.0 - xi.sum(), xi.x(), xi.y(), xi.z()};
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 4; ++k) g(i, k) = Nodes == 4 ? S(corner[k][i]) : (4.0 * l[std::size_t(k)] - 1.0) * corner[k][i];
    for (int k = 4; k < Nodes; ++k) {
      const int a = tet_edges[k - 4][0], b = tet_edges[k - 4][1];
      g(i, k) = 4.0 * (l[std::size_t(b)] * corner[a][i] + l[std::size_t(a)] * corner[b][i]);
    }
  }
  return g;
}

/// A tetrahedral finite element: gradients of its shape functions by λ₁, λ₂, λ₃ at its quadrature points, 3 × nodes in
/// the node order of TetMesh, on the reference tetrahedron λ₁, λ₂, λ₃ ≥ 0, λ₁ + λ₂ + λ₃ ≤ 1, where those points are,
/// and how its mass is shared. `order` is the mesh's. Laws: gradients sum to zero and reproduce linear fields, weights
/// sum to 1/6, shares of the mass to 1.
template <class E>
concept TetElement = requires(const E& element) {
  requires E::order == 1 || E::order == 2;
  requires E::nodes == (E::order == 1 ? 4 : 10);
  requires E::points >= 1;
  { E::gradients(0) } -> std::same_as<Eigen::Matrix<double, 3, E::nodes>>;
  { E::place(0) } -> std::convertible_to<Vec3d>;
  { E::weight(0) } -> std::convertible_to<double>;
  { E::mass_share(0) } -> std::convertible_to<double>;
  { element.mean_dilatation } -> std::convertible_to<bool>;
};

/// Quadratic tetrahedron; with `mean_dilatation` its volumetric energy sees the element's mean of J, which cures
/// locking near incompressibility (Nagtegaal, Parks, Rice 1974). Four-point quadrature of degree 2.
struct QuadraticTet {
  static constexpr int order = 2;
  static constexpr int nodes = 10;
  static constexpr int points = 4;
  bool mean_dilatation = true;

  static Vec3d place(int q) {
    constexpr double a = 0.58541019662496845446, b = 0.13819660112501051518;
    return Vec3d(q == 1 ? a : b, q == 2 ? a : b, q == 3 ? a : b);
  }
  static Eigen::Matrix<double, 3, nodes> gradients(int q) { return shape_gradients<nodes>(place(q)); }
  static double weight(int) { return 1.0 / 24.0; }
  /// In proportion to the diagonal of the consistent matrix (Hinton, Rock, Zienkiewicz 1976): row sums would be
  /// negative.
  static double mass_share(int a) { return a < 4 ? 1.0 / 36.0 : 4.0 / 27.0; }
};

/// Linear tetrahedron: locks at ν = 0.495 (20–60 % too stiff on pads like LUMO's). Offered for comparison with codes
/// that use it.
struct LinearTet {
  static constexpr int order = 1;
  static constexpr int nodes = 4;
  static constexpr int points = 1;
  bool mean_dilatation = false;

  static Vec3d place(int) { return Vec3d(0.25, 0.25, 0.25); }
  static Eigen::Matrix<double, 3, nodes> gradients(int q) { return shape_gradients<nodes>(place(q)); }
  static double weight(int) { return 1.0 / 6.0; }
  static double mass_share(int) { return 0.25; }
};

/// Eight linear tetrahedra in place of one quadratic, on its ten nodes; with `mean_dilatation` the volumetric energy
/// sees the mean of J over the eight, which cures their locking (de Souza Neto, Pires, Owen 2005, patches of linear
/// elements, here with an energy). Without it, linear tetrahedra of half the size.
struct LinearPatchTet {
  static constexpr int order = 2;
  static constexpr int nodes = 10;
  static constexpr int points = 8;
  bool mean_dilatation = true;

  static Vec3d place(int q) {
    Vec3d middle = Vec3d::Zero();
    for (int k : parts[q]) middle += 0.25 * Vec3d(corner[k][0], corner[k][1], corner[k][2]);
    return middle;
  }
  static Eigen::Matrix<double, 3, nodes> gradients(int q) {
    using Gradients = Eigen::Matrix<double, 3, nodes>;
    Gradients g = Gradients::Zero();
    const auto& part = parts[q];
    const auto edge = [&](int k) {
      return Vec3d(corner[part[k]][0] - corner[part[0]][0], corner[part[k]][1] - corner[part[0]][1],
          corner[part[k]][2] - corner[part[0]][2]);
    };
    for (int k = 1; k < 4; ++k) {
      const Vec3d u = edge(k % 3 + 1), v = edge((k + 1) % 3 + 1),
                  slope = 8.0 * u.cross(v);  // u × v · edge(k) = 1/8, six times the volume
      for (int i = 0; i < 3; ++i) {
        g(i, part[k]) = slope[i];
        g(i, part[0]) -= slope[i];
      }
    }
    return g;
  }
  static double weight(int) { return 1.0 / 48.0; }
  static double mass_share(int a) {
    int shared = 0;
    for (const auto& part : parts)
      for (int node : part) shared += node == a;
    return shared / 32.0;
  }

  /// Nodes of the eight: at the corners, and the octahedron between them cut along the line from node 4 to node 9,
  /// which mirrored() leaves in place.
  static constexpr int parts[8][4] = {
      {0, 4, 6, 7}, {4, 1, 5, 8}, {6, 5, 2, 9}, {7, 8, 9, 3}, {4, 9, 5, 6}, {4, 9, 6, 7}, {4, 9, 7, 8}, {4, 9, 8, 5}};

 private:
  static constexpr double corner[10][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.5, 0, 0}, {0.5, 0.5, 0},
      {0, 0.5, 0}, {0, 0, 0.5}, {0.5, 0, 0.5}, {0, 0.5, 0.5}};
};

/// Shape functions of the six-node (or three-node) boundary triangle at barycentric (1−u−v, u, v), in the node order of
/// BoundaryFace.
template <class S> std::array<S, 6> face_shape(const S& u, const S& v, int order) {
  const S w = 1.0 - u - v;
  if (order == 1) return {w, u, v, 0.0, 0.0, 0.0};
  return {w * (2 * w - 1), u * (2 * u - 1), v * (2 * v - 1), 4 * w * u, 4 * u * v, 4 * v * w};
}

/// Derivatives of face_shape by u and v.
template <class S> std::array<std::array<S, 2>, 6> face_shape_derivatives(const S& u, const S& v, int order) {
  if (order == 1) return {{{-1, -1}, {1, 0}, {0, 1}, {0, 0}, {0, 0}, {0, 0}}};
  const S w = 1.0 - u - v;
  return {{{1 - 4 * w, 1 - 4 * w}, {4 * u - 1, 0}, {0, 4 * v - 1}, {4 * (w - u), -4 * u}, {4 * v, 4 * u},
      {-4 * v, 4 * (w - v)}}};
}

static_assert(TetElement<QuadraticTet> && TetElement<LinearTet> && TetElement<LinearPatchTet>);

/// Gradients of the shape functions by the place at rest, and volumes, at the quadrature points of all tetrahedra of a
/// mesh.
template <TetElement Element> class ElementPoints {
 public:
  using Gradients = Eigen::Matrix<double, 3, Element::nodes>;

  /// Throws InvalidArgument where the mesh is not of the element's order: nodes in the middle of edges would belong to
  /// no element, or be missing.
  explicit ElementPoints(const TetMesh& mesh) {
    if (mesh.order != Element::order)
      throw InvalidArgument(message(
          "elements are of order ", Element::order, ", the mesh is of order ", mesh.order, ", must be the same"));
    gradients_.reserve(mesh.tets.size() * Element::points);
    weights_.reserve(mesh.tets.size() * Element::points);
    for (const auto& t : mesh.tets)
      for (int q = 0; q < Element::points; ++q) {
        const Gradients by_xi = Element::gradients(q);
        Mat3d jacobian = Mat3d::Zero();
        for (int a = 0; a < Element::nodes; ++a)
          jacobian += mesh.nodes[std::size_t(t[std::size_t(a)])] * Vec3d(by_xi.col(a)).transpose();
        const Mat3d to_x = inverse_transposed(jacobian);
        Gradients& by_x = gradients_.emplace_back();
        for (int a = 0; a < Element::nodes; ++a)
          for (int i = 0; i < 3; ++i)
            by_x(i, a) = to_x(i, 0) * by_xi(0, a) + to_x(i, 1) * by_xi(1, a) + to_x(i, 2) * by_xi(2, a);
        weights_.push_back(Element::weight(q) * jacobian.determinant());
      }
  }

  /// [1/m], of tetrahedron e at point q.
  const Gradients& gradient(std::size_t e, int q) const {
    return gradients_[e * std::size_t(Element::points) + std::size_t(q)];
  }
  /// Volume that the point stands for [m³].
  double weight(std::size_t e, int q) const { return weights_[e * std::size_t(Element::points) + std::size_t(q)]; }

 private:
  std::vector<Gradients, Eigen::aligned_allocator<Gradients>> gradients_;
  std::vector<double> weights_;
};

/// Mass of each node [kg], as each element shares its own.
/// Throws InvalidArgument where the mesh is not of the element's order.
template <TetElement Element> std::vector<double> lumped_masses(const TetMesh& mesh, double density_kg_per_m3) {
  std::vector<double> mass(mesh.nodes.size(), 0.0);
  const ElementPoints<Element> points(mesh);
  for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
    double volume = 0.0;
    for (int q = 0; q < Element::points; ++q) volume += points.weight(e, q);
    for (int a = 0; a < Element::nodes; ++a)
      mass[std::size_t(mesh.tets[e][std::size_t(a)])] += density_kg_per_m3 * volume * Element::mass_share(a);
  }
  return mass;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/elements/simd.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_SIMD_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_SIMD_HPP

// The one place for the compiler's vector types; LUMO_PLAIN_SIMD takes arrays in their place, with the same results.
#if defined(__GNUC__) && !defined(LUMO_PLAIN_SIMD)
#define LUMO_VECTOR_TYPES 1
#else
#define LUMO_VECTOR_TYPES 0
#endif

namespace lumo {

namespace detail {

#if LUMO_VECTOR_TYPES
typedef double Register8 __attribute__((vector_size(64)));
typedef double Register4 __attribute__((vector_size(32)));
#else
template <std::size_t N> struct PlainRegister {
  std::array<double, N> lanes = {};

  double operator[](std::size_t k) const { return lanes[k]; }
  double& operator[](std::size_t k) { return lanes[k]; }
  template <class Operation>
  static PlainRegister each(const PlainRegister& a, const PlainRegister& b, Operation operation) {
    PlainRegister r;
    for (std::size_t k = 0; k < N; ++k) r[k] = operation(a[k], b[k]);
    return r;
  }
  friend PlainRegister operator+(const PlainRegister& a, const PlainRegister& b) {
    return each(a, b, [](double x, double y) { return x + y; });
  }
  friend PlainRegister operator-(const PlainRegister& a, const PlainRegister& b) {
    return each(a, b, [](double x, double y) { return x - y; });
  }
  friend PlainRegister operator*(const PlainRegister& a, const PlainRegister& b) {
    return each(a, b, [](double x, double y) { return x * y; });
  }
  friend PlainRegister operator/(const PlainRegister& a, const PlainRegister& b) {
    return each(a, b, [](double x, double y) { return x / y; });
  }
  friend PlainRegister operator-(const PlainRegister& a) {
    return each(a, a, [](double x, double) { return -x; });
  }
};
using Register8 = PlainRegister<8>;
using Register4 = PlainRegister<4>;
#endif

}  // namespace detail

/// Eight numbers that go through the same arithmetic at once: one AVX-512 register, or as many smaller ones as the
/// processor needs. Functions exchange packs, not registers: how a bare register is handed over depends on the
/// processor compiled for.
struct SimdPack {
  static constexpr std::size_t width = 8;
  using Register = detail::Register8;
  Register v = {};

  /// A point, padded so that one load takes it.
  struct Point {
    using Register = detail::Register4;
    Register v = {};
  };

  double operator[](std::size_t lane) const { return v[lane]; }
  void set(std::size_t lane, double value) { v[lane] = value; }
  static SimdPack of(double value) { return {Register{value, value, value, value, value, value, value, value}}; }

  /// x, y and z of points[index[lane]].
  static std::array<SimdPack, 3> gathered(const std::vector<Point>& points, const std::array<int, width>& index);

  /// Asks for a point that is needed soon.
  static void prefetch([[maybe_unused]] const Point& p) {
#if LUMO_VECTOR_TYPES
    __builtin_prefetch(&p);
#endif
  }

  SimdPack& operator+=(const SimdPack& b) {
    v = v + b.v;
    return *this;
  }
  SimdPack& operator-=(const SimdPack& b) {
    v = v - b.v;
    return *this;
  }
};

inline SimdPack operator+(const SimdPack& a, const SimdPack& b) { return {a.v + b.v}; }
inline SimdPack operator-(const SimdPack& a, const SimdPack& b) { return {a.v - b.v}; }
inline SimdPack operator*(const SimdPack& a, const SimdPack& b) { return {a.v * b.v}; }
inline SimdPack operator/(const SimdPack& a, const SimdPack& b) { return {a.v / b.v}; }
inline SimdPack operator-(const SimdPack& a) { return {-a.v}; }
inline SimdPack operator+(double a, const SimdPack& b) { return SimdPack::of(a) + b; }
inline SimdPack operator-(double a, const SimdPack& b) { return SimdPack::of(a) - b; }
inline SimdPack operator*(double a, const SimdPack& b) { return SimdPack::of(a) * b; }
inline SimdPack operator/(double a, const SimdPack& b) { return SimdPack::of(a) / b; }
inline SimdPack operator+(const SimdPack& a, double b) { return a + SimdPack::of(b); }
inline SimdPack operator-(const SimdPack& a, double b) { return a - SimdPack::of(b); }

inline SimdPack log(const SimdPack& a) {
  SimdPack l;
  for (std::size_t lane = 0; lane < SimdPack::width; ++lane) l.set(lane, std::log(a[lane]));
  return l;
}

#if LUMO_VECTOR_TYPES
// Whole points are read and turned, which takes less than reading number by number.
inline std::array<SimdPack, 3> SimdPack::gathered(
    const std::vector<Point>& points, const std::array<int, width>& index) {
  const auto two = [&](std::size_t lane) {
    return SimdPack{__builtin_shufflevector(
        points[std::size_t(index[lane])].v, points[std::size_t(index[lane + 4])].v, 0, 1, 2, 3, 4, 5, 6, 7)};
  };
  const SimdPack p04 = two(0), p15 = two(1), p26 = two(2), p37 = two(3);
  const auto even = [](const SimdPack& a, const SimdPack& b) {
    return SimdPack{__builtin_shufflevector(a.v, b.v, 0, 8, 2, 10, 4, 12, 6, 14)};
  };
  const auto odd = [](const SimdPack& a, const SimdPack& b) {
    return SimdPack{__builtin_shufflevector(a.v, b.v, 1, 9, 3, 11, 5, 13, 7, 15)};
  };
  const SimdPack xz_low = even(p04, p15), xz_high = even(p26, p37), y_low = odd(p04, p15), y_high = odd(p26, p37);
  return {SimdPack{__builtin_shufflevector(xz_low.v, xz_high.v, 0, 1, 8, 9, 4, 5, 12, 13)},
      SimdPack{__builtin_shufflevector(y_low.v, y_high.v, 0, 1, 8, 9, 4, 5, 12, 13)},
      SimdPack{__builtin_shufflevector(xz_low.v, xz_high.v, 2, 3, 10, 11, 6, 7, 14, 15)}};
}
#else
inline std::array<SimdPack, 3> SimdPack::gathered(
    const std::vector<Point>& points, const std::array<int, width>& index) {
  std::array<SimdPack, 3> xyz;
  for (std::size_t lane = 0; lane < width; ++lane)
    for (std::size_t i = 0; i < 3; ++i) xyz[i].set(lane, points[std::size_t(index[lane])].v[i]);
  return xyz;
}
#endif

}  // namespace lumo

#undef LUMO_VECTOR_TYPES

#endif

// ---- lumo/mechanics/elements/element_packs.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_ELEMENT_PACKS_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_ELEMENT_PACKS_HPP

namespace lumo {

/// Of eight elements: a vector, and a 3 × 3 matrix by columns.
using VectorPack = std::array<SimdPack, 3>;
using MatrixPack = std::array<VectorPack, 3>;

[[gnu::always_inline]] inline SimdPack dot(const VectorPack& a, const VectorPack& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
[[gnu::always_inline]] inline VectorPack cross(const VectorPack& a, const VectorPack& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
[[gnu::always_inline]] inline VectorPack scaled(const SimdPack& s, const VectorPack& v) {
  return {s * v[0], s * v[1], s * v[2]};
}
[[gnu::always_inline]] inline VectorPack product(const MatrixPack& m, const VectorPack& v) {
  VectorPack p;
  for (std::size_t i = 0; i < 3; ++i) p[i] = m[0][i] * v[0] + m[1][i] * v[1] + m[2][i] * v[2];
  return p;
}
/// Derivative of the determinant.
[[gnu::always_inline]] inline MatrixPack cofactor(const MatrixPack& m) {
  return {cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])};
}

/// Deformed nodes, each padded so that one load takes it.
using PaddedPositions = std::vector<SimdPack::Point>;

inline PaddedPositions padded(const Eigen::Matrix3Xd& x) {
  PaddedPositions p(std::size_t(x.cols()));
  for (std::size_t k = 0; k < p.size(); ++k)
    for (std::size_t i = 0; i < 3; ++i) p[k].v[i] = x(Eigen::Index(i), Eigen::Index(k));
  return p;
}

/// The elements of a mesh, eight at a time in their order, with the gradients of their shape functions at rest. The
/// last pack repeats the last element where there is no further one.
template <TetElement Element> class ElementPacks {
 public:
  static constexpr std::size_t width = SimdPack::width, nodes = std::size_t(Element::nodes),
                               points = std::size_t(Element::points);
  struct Pack {
    std::size_t first = 0, count = 0;                            ///< elements
    std::array<std::array<int, width>, nodes> node;              ///< their nodes
    std::array<std::array<VectorPack, nodes>, points> gradient;  ///< [1/m], at the quadrature points
    std::array<SimdPack, points> weight;                         ///< volume that a point stands for [m³]
    SimdPack volume;                                             ///< [m³]
  };
  /// Deformation gradients and volume ratios of a pack.
  struct Deformation {
    std::array<MatrixPack, points> F;
    std::array<SimdPack, points> J;
    SimdPack mean_J;
  };

  /// Throws InvalidArgument where the mesh is not of the element's order.
  explicit ElementPacks(const TetMesh& mesh) {
    const ElementPoints<Element> at(mesh);
    for (std::size_t first = 0; first < mesh.tets.size(); first += width) {
      Pack& p = packs_.emplace_back();
      p.first = first;
      p.count = std::min(width, mesh.tets.size() - first);
      for (std::size_t lane = 0; lane < width; ++lane) {
        const std::size_t e = first + std::min(lane, p.count - 1);
        for (std::size_t a = 0; a < nodes; ++a) p.node[a][lane] = mesh.tets[e][a];
        for (std::size_t q = 0; q < points; ++q) {
          p.weight[q].set(lane, at.weight(e, int(q)));
          for (std::size_t a = 0; a < nodes; ++a)
            for (std::size_t i = 0; i < 3; ++i)
              p.gradient[q][a][i].set(lane, at.gradient(e, int(q))(Eigen::Index(i), Eigen::Index(a)));
        }
      }
      for (const SimdPack& w : p.weight) p.volume += w;
    }
  }

  const std::vector<Pack>& packs() const { return packs_; }

  /// Derivatives of a nodal field by the place at rest, at each quadrature point.
  static std::array<MatrixPack, points> slopes(const Pack& pack, const PaddedPositions& field) {
    std::array<VectorPack, nodes> at;
    for (std::size_t a = 0; a < nodes; ++a) at[a] = SimdPack::gathered(field, pack.node[a]);
    std::array<MatrixPack, points> m{};
    for (std::size_t q = 0; q < points; ++q) {
      MatrixPack sum{};
      for (std::size_t a = 0; a < nodes; ++a)
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i) sum[j][i] += at[a][i] * pack.gradient[q][a][j];
      m[q] = sum;
    }
    return m;
  }
  static Deformation deformation(const Pack& pack, const PaddedPositions& x) {
    Deformation d{slopes(pack, x), {}, {}};
    for (std::size_t q = 0; q < points; ++q) {
      d.J[q] = dot(d.F[q][0], cross(d.F[q][1], d.F[q][2]));
      d.mean_J += pack.weight[q] * d.J[q];
    }
    d.mean_J = d.mean_J / pack.volume;
    return d;
  }

 private:
  std::vector<Pack> packs_;
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/elements/solid.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_SOLID_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_SOLID_HPP

namespace lumo {

/// Deformed node positions, 3 × nodes [m].
using Positions = Eigen::Matrix3Xd;

inline Positions positions_of(const TetMesh& mesh) {
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k];
  return x;
}

/// A solid whose distortion is μ/2 (I_C − 3) + g(J), with derivatives that are cheap enough to be taken for many
/// elements at once.
template <class M>
concept DilatationalDistortion = HyperelasticMaterial<M> && requires(const M& m, const SimdPack& J) {
  { m.distortion_dilatation(J) } -> std::same_as<DilatationSample<SimdPack>>;
};

/// How the volumes of a deformed mesh have changed.
struct VolumeRatios {
  std::vector<double> J;  ///< that the volumetric energy sees: one per element with the locking cure, else one per
                          ///< quadrature point
  double smallest = std::numeric_limits<double>::infinity();  ///< det F over all quadrature points
};

/// The elastic energy of a tetrahedral mesh with its first and second derivative, eight elements at a time.
template <HyperelasticMaterial Material, TetElement Element> class Solid {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  Solid(const TetMesh& mesh, Material material, Element element)
      : material_(material), element_(element), elements_(mesh), tets_(mesh.tets.size()) {}

  /// Stored energy [J]; +∞ when an element is inverted at a quadrature point.
  double energy(const Positions& x) const {
    const PaddedPositions at = padded(x);
    double sum = 0.0;
    for (const Pack& p : elements_.packs()) {
      const Deformation d = Elements::deformation(p, at);
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        for (std::size_t q = 0; q < points; ++q) {
          sum += p.weight[q][lane] * material_.distortion_energy(of_lane(d.F[q], lane));
          if (!element_.mean_dilatation) sum += p.weight[q][lane] * material_.volumetric(d.J[q][lane]).energy;
        }
        if (element_.mean_dilatation) sum += p.volume[lane] * material_.volumetric(d.mean_J[lane]).energy;
      }
      if (!std::isfinite(sum)) return std::numeric_limits<double>::infinity();
    }
    return sum;
  }

  VolumeRatios volume_ratios(const Positions& x) const {
    const PaddedPositions at = padded(x);
    VolumeRatios v;
    v.J.resize(tets_ * cells());
    for (const Pack& p : elements_.packs()) {
      const Deformation d = Elements::deformation(p, at);
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        for (std::size_t q = 0; q < points; ++q) v.smallest = std::min(v.smallest, d.J[q][lane]);
        for (std::size_t c = 0; c < cells(); ++c)
          v.J[(p.first + lane) * cells() + c] = element_.mean_dilatation ? d.mean_J[lane] : d.J[c][lane];
      }
    }
    return v;
  }

  /// Adds to volume ratios what the displacement dx changes along the slope that they have at the positions `linear`.
  void carry_on(std::vector<double>& J, const Positions& linear, const Positions& dx) const {
    const PaddedPositions at = padded(linear), by = padded(dx);
    for (const Pack& p : elements_.packs()) {
      const std::array<MatrixPack, points> F = Elements::slopes(p, at), dF = Elements::slopes(p, by);
      SimdPack mean;
      for (std::size_t q = 0; q < points; ++q) {
        const MatrixPack c = cofactor(F[q]);
        const SimdPack rate = dot(c[0], dF[q][0]) + dot(c[1], dF[q][1]) + dot(c[2], dF[q][2]);
        mean += p.weight[q] * rate;
        if (!element_.mean_dilatation)
          for (std::size_t lane = 0; lane < p.count; ++lane) J[(p.first + lane) * points + q] += rate[lane];
      }
      mean = mean / p.volume;
      if (element_.mean_dilatation)
        for (std::size_t lane = 0; lane < p.count; ++lane) J[p.first + lane] += mean[lane];
    }
  }

  /// Adds the nodal forces ∂energy/∂x [N] to `force` (3 × nodes). The volumetric stress is linearised `about` given
  /// volume ratios θ, U'(θ) + U''(θ)(J − θ): see QuasiStatic.
  void add_forces(const Positions& x, Positions& force, const std::vector<double>* about = nullptr) const {
    const PaddedPositions at = padded(x);
    for (const Pack& p : elements_.packs()) {
      const Deformation d = Elements::deformation(p, at);
      std::array<VectorPack, nodes> f{};
      SimdPack theta;
      Volumetric u;
      for (std::size_t q = 0; q < points; ++q) {
        const MatrixPack c = cofactor(d.F[q]);
        if (q < cells()) u = volumetric(theta = ratio(p, q, d, about));
        const MatrixPack s = distortion_stress(d.F[q], d.J[q], c);
        const SimdPack pressure = u.stress + u.stiffness * ((element_.mean_dilatation ? d.mean_J : d.J[q]) - theta);
        MatrixPack P;
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i) P[j][i] = p.weight[q] * (s[j][i] + pressure * c[j][i]);
        for (std::size_t a = 0; a < nodes; ++a) {
          const VectorPack share = product(P, p.gradient[q][a]);
          for (std::size_t i = 0; i < 3; ++i) f[a][i] += share[i];
        }
      }
      for (std::size_t lane = 0; lane < p.count; ++lane)
        for (std::size_t a = 0; a < nodes; ++a)
          for (std::size_t i = 0; i < 3; ++i) force(Eigen::Index(i), p.node[a][lane]) += f[a][i][lane];
    }
  }

  /// Adds the tangent [N/m] to the values of each system's lower triangle; the element matrices are made once for all.
  void add_tangent(const Positions& x, const std::vector<const Equations*>& systems, const std::vector<double*>& values,
      const std::vector<double>* about = nullptr) const {
    const PaddedPositions at = padded(x);
    for (const Pack& p : elements_.packs()) add_tangent(p, Elements::deformation(p, at), systems, values, about);
  }

  /// Smallest undeformed volume that a quadrature point stands for [m³]; not positive where the mesh has an element
  /// that is inside out.
  double smallest_volume() const {
    double least = std::numeric_limits<double>::infinity();
    for (const Pack& p : elements_.packs())
      for (const SimdPack& w : p.weight)
        for (std::size_t lane = 0; lane < p.count; ++lane) least = std::min(least, w[lane]);
    return least;
  }

  const Material& material() const { return material_; }

 private:
  using Elements = ElementPacks<Element>;
  using Pack = typename Elements::Pack;
  using Deformation = typename Elements::Deformation;
  static constexpr std::size_t nodes = Elements::nodes, points = Elements::points, width = Elements::width;
  static constexpr std::size_t size = 3 * nodes;  // of an element's tangent

  static Mat3d of_lane(const MatrixPack& m, std::size_t lane) {
    Mat3d one;
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t i = 0; i < 3; ++i) one(Eigen::Index(i), Eigen::Index(j)) = m[j][i][lane];
    return one;
  }

  std::size_t cells() const { return element_.mean_dilatation ? 1 : points; }

  // Volume ratios that the volumetric energy is taken at: with the locking cure the same at all points.
  SimdPack ratio(const Pack& p, std::size_t q, const Deformation& d, const std::vector<double>* about) const {
    if (!about) return element_.mean_dilatation ? d.mean_J : d.J[q];
    SimdPack theta;
    for (std::size_t lane = 0; lane < width; ++lane)
      theta.set(lane, (*about)[(p.first + std::min(lane, p.count - 1)) * cells() + (element_.mean_dilatation ? 0 : q)]);
    return theta;
  }

  struct Volumetric {
    SimdPack stress, stiffness;
  };
  Volumetric volumetric(const SimdPack& J) const {
    Volumetric u;
    for (std::size_t lane = 0; lane < width; ++lane) {
      const VolumetricSample<double> one = material_.volumetric(J[lane]);
      u.stress.set(lane, one.stress);
      u.stiffness.set(lane, one.stiffness);
    }
    return u;
  }

  MatrixPack distortion_stress(const MatrixPack& F, const SimdPack& J, const MatrixPack& c) const {
    MatrixPack P;
    if constexpr (DilatationalDistortion<Material>) {
      const SimdPack mu = SimdPack::of(material_.shear_modulus()), stress = material_.distortion_dilatation(J).stress;
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t i = 0; i < 3; ++i) P[j][i] = mu * F[j][i] + stress * c[j][i];
    } else {
      for (std::size_t lane = 0; lane < width; ++lane) {
        const Mat3d one = material_.distortion_stress(of_lane(F, lane));
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i) P[j][i].set(lane, one(Eigen::Index(i), Eigen::Index(j)));
      }
    }
    return P;
  }

  // Entries of the lower triangles of a pack's tangents, column by column, as Equations::slots has them.
  using Entries = std::array<SimdPack, size*(size + 1) / 2>;

  // Sets the part of node b's rows and node a's columns, b ≥ a, from block[j][i] of row 3 b + i and column 3 a + j.
  static void set_block(Entries& entries, std::size_t b, std::size_t a, const MatrixPack& block) {
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t column = 3 * a + j, start = column * size - column * (column + 1) / 2;
      for (std::size_t i = b == a ? j : 0; i < 3; ++i) entries[start + 3 * b + i] = block[j][i];
    }
  }

  // Element by element: block by block would go through the slots of eight at once, which takes half as long again.
  static void scatter(const Pack& p, const Entries& entries, const std::vector<const Equations*>& systems,
      const std::vector<double*>& values) {
    for (std::size_t k = 0; k < systems.size(); ++k)
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        const int* slots = systems[k]->slots.data() + (p.first + lane) * entries.size();
        for (std::size_t m = 0; m < entries.size(); ++m)
          if (slots[m] >= 0) values[k][slots[m]] += entries[m][lane];
      }
  }

  // With Aₐ = cof F gₐ: blocks Σ w (μ gₐ·g_b I + g'' A_b Aₐᵀ + (p/J) [A_b × Aₐ]), p all that presses, and the stiffness
  // against a change of volume.
  void add_tangent(const Pack& p, const Deformation& d, const std::vector<const Equations*>& systems,
      const std::vector<double*>& values,
      const std::vector<double>* about) const requires DilatationalDistortion<Material> {
    const SimdPack mu = SimdPack::of(material_.shear_modulus());
    struct Point {
      std::array<VectorPack, nodes> area, stiff, turn, stretch;
    };
    std::array<Point, points> at;
    std::array<VectorPack, nodes> dJ{};  // V ∂(mean J)/∂x
    SimdPack bulk;
    Volumetric u;
    for (std::size_t q = 0; q < points; ++q) {
      const MatrixPack c = cofactor(d.F[q]);
      if (q < cells()) u = volumetric(ratio(p, q, d, about));
      const DilatationSample<SimdPack> g = material_.distortion_dilatation(d.J[q]);
      const SimdPack w = p.weight[q], turning = w * (g.stress + u.stress) / d.J[q],
                     stiffness = w * (element_.mean_dilatation ? g.stiffness : g.stiffness + u.stiffness);
      if (q == 0) bulk = u.stiffness / p.volume;
      for (std::size_t a = 0; a < nodes; ++a) {
        const VectorPack area = product(c, p.gradient[q][a]);
        at[q].area[a] = area;
        at[q].stiff[a] = scaled(stiffness, area);
        at[q].turn[a] = scaled(turning, area);
        at[q].stretch[a] = scaled(w * mu, p.gradient[q][a]);
        for (std::size_t i = 0; i < 3; ++i) dJ[a][i] += w * area[i];
      }
    }
    Entries entries;
    for (std::size_t a = 0; a < nodes; ++a)
      for (std::size_t b = a; b < nodes; ++b) {
        MatrixPack block{};
        SimdPack stretch;
        VectorPack turn{};
        for (std::size_t q = 0; q < points; ++q) {
          stretch += dot(at[q].stretch[b], p.gradient[q][a]);
          const VectorPack n = cross(at[q].turn[b], at[q].area[a]);
          for (std::size_t i = 0; i < 3; ++i) turn[i] += n[i];
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i) block[j][i] += at[q].stiff[b][i] * at[q].area[a][j];
        }
        if (element_.mean_dilatation) {
          const VectorPack stiff = scaled(bulk, dJ[b]);
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i) block[j][i] += stiff[i] * dJ[a][j];
        }
        for (std::size_t i = 0; i < 3; ++i) {
          const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
          block[i][i] += stretch;
          block[j][i] += turn[k];
          block[i][j] -= turn[k];
        }
        set_block(entries, b, a, block);
      }
    scatter(p, entries, systems, values);
  }

  void add_tangent(const Pack& p, const Deformation& d, const std::vector<const Equations*>& systems,
      const std::vector<double*>& values, const std::vector<double>* about) const {
    std::array<std::array<MatrixPack, nodes>, nodes> K{};  // of columns' and rows' nodes
    std::array<VectorPack, nodes> dJ{};
    SimdPack bulk;
    Volumetric u;
    for (std::size_t q = 0; q < points; ++q) {
      const MatrixPack c = cofactor(d.F[q]);
      if (q < cells()) u = volumetric(ratio(p, q, d, about));
      if (q == 0) bulk = u.stiffness / p.volume;
      for (std::size_t a = 0; a < nodes; ++a) {
        const VectorPack area = product(c, p.gradient[q][a]);
        for (std::size_t i = 0; i < 3; ++i) dJ[a][i] += p.weight[q] * area[i];
      }
      for (std::size_t lane = 0; lane < p.count; ++lane) {
        const Mat3d F = of_lane(d.F[q], lane), cof = of_lane(c, lane);
        Mat9d A = material_.distortion_tangent(F) + u.stress[lane] * determinant_hessian(F);
        if (!element_.mean_dilatation) A += dyad(u.stiffness[lane] * cof, cof);
        A = A * p.weight[q][lane];
        for (std::size_t a = 0; a < nodes; ++a) {
          const auto slope = [&](std::size_t node, std::size_t i) { return p.gradient[q][node][i][lane]; };
          std::array<double, 27> T;  // 9 × 3, by columns
          for (std::size_t k = 0; k < 27; ++k)
            T[k] = A.data()[k] * slope(a, 0) + A.data()[k + 27] * slope(a, 1) + A.data()[k + 54] * slope(a, 2);
          for (std::size_t b = a; b < nodes; ++b)
            for (std::size_t j = 0; j < 3; ++j)
              for (std::size_t i = 0; i < 3; ++i) {
                SimdPack& entry = K[a][b][j][i];
                const double* t = T.data() + 9 * j + i;
                entry.set(lane, entry[lane] + slope(b, 0) * t[0] + slope(b, 1) * t[3] + slope(b, 2) * t[6]);
              }
        }
      }
    }
    Entries entries;
    for (std::size_t a = 0; a < nodes; ++a)
      for (std::size_t b = a; b < nodes; ++b) {
        if (element_.mean_dilatation) {
          const VectorPack stiff = scaled(bulk, dJ[b]);
          for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i) K[a][b][j][i] += stiff[i] * dJ[a][j];
        }
        set_block(entries, b, a, K[a][b]);
      }
    scatter(p, entries, systems, values);
  }

  Material material_;
  Element element_;
  Elements elements_;
  std::size_t tets_;
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/contact_surface.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_SURFACE_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_SURFACE_HPP

namespace lumo {

/// A point of the surface at which the gap is taken: shape functions of its face there, and its share of the reference
/// area.
struct SurfacePoint {
  std::array<double, 6> shape;
  double area_m2;
  double weight_m2;           ///< area that the contact law's pressure acts on: area_m2, unless the law says otherwise
  int part;                   ///< which of the face's four sub-triangles (one in a linear mesh) it lies in
  std::array<double, 3> hat;  ///< barycentric coordinates in that sub-triangle
  Vec3d reference;            ///< its place while the body is undeformed [m]
};

/// Corners of a face's sub-triangles, as places in BoundaryFace::nodes.
inline const std::array<std::array<int, 3>, 4>& face_parts() {
  static constexpr std::array<std::array<int, 3>, 4> parts = {{{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}}};
  return parts;
}

namespace detail {

// |∂x/∂u × ∂x/∂v| of a face at (u, v); `place(node)`: where its nodes are.
template <class Place>
double face_jacobian(const TetMesh& mesh, const BoundaryFace& face, double u, double v, Place&& place) {
  const auto slope = face_shape_derivatives(u, v, mesh.order);
  Vec3d by_u = Vec3d::Zero(), by_v = Vec3d::Zero();
  for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
    by_u += slope[k][0] * place(face.nodes[k]);
    by_v += slope[k][1] * place(face.nodes[k]);
  }
  return by_u.cross(by_v).norm();
}

}  // namespace detail

/// Part of a mesh's surface that may come into contact, with its quadrature.
class ContactSurface {
 public:
  /// Faces of the patches for which `chosen` holds, with points inside them.
  template <class Choose> ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen) : mesh_(&mesh) {
    for (const BoundaryFace& f : mesh.faces)
      if (chosen(body.patches[std::size_t(f.patch)])) add(f);
  }

  /// The same with the points at which a contact law acts.
  template <class Choose, ContactHandler Contact>
  ContactSurface(const TetMesh& mesh, const Body& body, Choose chosen, const Contact& law)
      : ContactSurface(mesh, body, chosen) {
    if (contact_points<Contact>() == ContactPoints::vertices) gather_at_vertices(area_per_vertex(law));
  }

  std::size_t size() const { return faces_.size(); }
  const BoundaryFace& face(std::size_t f) const { return faces_[f]; }
  const std::vector<SurfacePoint>& points(std::size_t f) const { return points_[f]; }

  Vec3d position(std::size_t f, const SurfacePoint& p, const Positions& x) const {
    Vec3d at = Vec3d::Zero();
    for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k)
      at += p.shape[k] * Vec3d(x.col(faces_[f].nodes[k]));
    return at;
  }

  /// Mesh nodes at the corners of one of a face's sub-triangles (one in a linear mesh).
  std::array<int, 3> sub_triangle(std::size_t f, std::size_t part) const {
    const std::array<int, 6>& nodes = faces_[f].nodes;
    const std::array<int, 3> corner = corners_of(part);
    return {nodes[std::size_t(corner[0])], nodes[std::size_t(corner[1])], nodes[std::size_t(corner[2])]};
  }
  std::size_t sub_triangles() const { return mesh_->order == 2 ? 4 : 1; }  ///< of each face

  /// A ball that holds the deformed face: its midpoint and radius. The face stays in the hull of its Bézier points.
  std::pair<Vec3d, double> ball(std::size_t f, const Positions& x) const {
    const auto& n = faces_[f].nodes;
    const auto at = [&](std::size_t k) -> Vec3d { return x.col(n[k]); };
    const Vec3d a = at(0), b = at(1), c = at(2), middle = (a + b + c) / 3.0;
    double r = std::max({(a - middle).norm(), (b - middle).norm(), (c - middle).norm()});
    if (mesh_->order == 2)
      for (std::size_t k = 0; k < 3; ++k)
        r = std::max(r, (2.0 * at(3 + k) - 0.5 * at(k) - 0.5 * at((k + 1) % 3) - middle).norm());
    return {middle, r};
  }

  int nodes_per_face() const { return mesh_->nodes_per_face(); }

  /// Area of the undeformed surface that is a node's, per mesh node [m²].
  std::vector<double> node_areas() const {
    std::vector<double> area(mesh_->nodes.size(), 0.0);
    for (std::size_t f = 0; f < faces_.size(); ++f)
      for (const SurfacePoint& p : points_[f])
        for (std::size_t k = 0; k < 3; ++k)
          area[std::size_t(sub_triangle(f, std::size_t(p.part))[k])] += p.area_m2 * p.hat[k];
    return area;
  }

 private:
  // Places in BoundaryFace::nodes of a sub-triangle's corners.
  std::array<int, 3> corners_of(std::size_t part) const {
    return mesh_->order == 2 ? face_parts()[part] : std::array<int, 3>{0, 1, 2};
  }
  void add(const BoundaryFace& face);
  void gather_at_vertices(double area_per_vertex);

  const TetMesh* mesh_;
  std::vector<BoundaryFace> faces_;
  std::vector<std::vector<SurfacePoint>> points_;
};

/// Contact energy, forces and stiffness between a surface and one rigid thing, for a given signed distance.
struct ContactSums {
  double energy = 0.0;  ///< [J]
  double push_N = 0.0;  ///< force on the indenter along −direction: −∂energy/∂advance … with the sign of a reaction
  double push_stiffness = 0.0;  ///< ∂²energy/∂advance² [N/m]
  double penetration_m = 0.0;   ///< largest overlap of the points that were looked at
};

inline void ContactSurface::add(const BoundaryFace& face) {
  const int order = mesh_->order;
  std::vector<SurfacePoint> points;
  // Corners of the sub-triangles in (u, v); each is quartered once more and takes the three-point rule there.
  const std::array<std::array<double, 2>, 6> uv = {{{0, 0}, {1, 0}, {0, 1}, {0.5, 0}, {0.5, 0.5}, {0, 0.5}}};
  const std::array<std::array<double, 3>, 6> quarter = {
      {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5, .5, 0}, {0, .5, .5}, {.5, 0, .5}}};
  const int parts = order == 2 ? 4 : 1;
  for (int part = 0; part < parts; ++part) {
    const std::array<int, 3> corner = corners_of(std::size_t(part));
    for (const auto& small : face_parts())
      for (int q = 0; q < 3; ++q) {
        SurfacePoint p{};
        p.part = part;
        for (std::size_t k = 0; k < 3; ++k)
          for (std::size_t m = 0; m < 3; ++m)
            p.hat[m] += (int(k) == q ? 2.0 / 3.0 : 1.0 / 6.0) * quarter[std::size_t(small[k])][m];
        double u = 0.0, v = 0.0;
        for (std::size_t m = 0; m < 3; ++m) {
          u += p.hat[m] * uv[std::size_t(corner[m])][0];
          v += p.hat[m] * uv[std::size_t(corner[m])][1];
        }
        p.shape = face_shape(u, v, order);
        p.reference = Vec3d::Zero();
        for (std::size_t k = 0; k < std::size_t(mesh_->nodes_per_face()); ++k)
          p.reference += p.shape[k] * mesh_->nodes[std::size_t(face.nodes[k])];
        const double twice_area = detail::face_jacobian(
            *mesh_, face, u, v, [&](int node) -> const Vec3d& { return mesh_->nodes[std::size_t(node)]; });
        p.area_m2 = twice_area * 0.5 / (12.0 * parts);
        p.weight_m2 = p.area_m2;
        points.push_back(p);
      }
  }
  faces_.push_back(face);
  points_.push_back(std::move(points));
}

// Every node once, on the first face that has it, with all of its area.
inline void ContactSurface::gather_at_vertices(double area_per_vertex) {
  const std::vector<double> area = node_areas();
  std::vector<char> done(mesh_->nodes.size(), 0);
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    points_[f].clear();
    for (int part = 0; part < (mesh_->order == 2 ? 4 : 1); ++part)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t local = std::size_t(corners_of(std::size_t(part))[k]),
                          node = std::size_t(faces_[f].nodes[local]);
        if (std::exchange(done[node], char(1))) continue;
        SurfacePoint p{
            {}, area[node], area_per_vertex > 0.0 ? area_per_vertex : area[node], part, {}, mesh_->nodes[node]};
        p.shape[local] = 1.0;
        p.hat[k] = 1.0;
        points_[f].push_back(p);
      }
  }
}

/// A rigid thing that moves by `advance` along `direction`: anything with distance(p) and sample(p) in its own frame.
template <class Tool> struct Moving {
  const Tool* tool;
  Vec3d origin;     ///< of the tool's frame, now [m]
  Vec3d direction;  ///< of its advance, unit

  double distance(const Vec3d& p) const { return tool->distance(p - origin); }
  DistanceSample sample(const Vec3d& p) const { return tool->sample(p - origin); }
};

/// Gaps [m] at each surface point, face by face.
using SurfaceGaps = std::vector<std::vector<double>>;

namespace detail {

// The answer of a contact without friction.
struct NoFriction {
  struct Answer {
    Vec3d traction;
    Mat3d stiffness;
  };
  Answer answer(std::size_t, std::size_t, const Vec3d&, const Vec3d&, const Vec3d&, double) const {
    return {Vec3d::Zero(), Mat3d::Zero()};
  }
};

// Calls visit(face, point number, point, position) for the surface points that can be in contact: those whose given
// gaps are closed, without any those of faces that the rigid thing reaches.
template <class Tool, class Visit> void for_contact_points(const ContactSurface& surface, const Positions& x,
    const Moving<Tool>& rigid, const SurfaceGaps* gaps, Visit&& visit) {
  for (std::size_t f = 0; f < surface.size(); ++f) {
    const std::vector<SurfacePoint>& points = surface.points(f);
    if (gaps) {
      for (std::size_t k = 0; k < points.size(); ++k)
        if ((*gaps)[f][k] < 0.0) visit(f, k, points[k], surface.position(f, points[k], x));
    } else if (const auto [middle, radius] = surface.ball(f, x); rigid.distance(middle) <= radius) {
      for (std::size_t k = 0; k < points.size(); ++k) visit(f, k, points[k], surface.position(f, points[k], x));
    }
  }
}

}  // namespace detail

/// What a contact has been through.
template <class Friction = detail::NoFriction> struct ContactHistory {
  const SurfaceGaps* gaps = nullptr;   ///< γ, about which the law is linearised; nullptr: the present ones
  const Friction* friction = nullptr;  ///< such as FrictionHistory; nullptr: none
};

/// Adds the contact energy and forces; `force` (3 × nodes) receives ∂energy/∂x. About given gaps γ the pressure is
/// p(γ) + p'(γ)(g − γ), so that points keep pulling or stay free until the next step says otherwise; the energy is not
/// meant then. Friction enters forces but not the energy.
template <ContactHandler Contact, class Tool, class Friction = detail::NoFriction>
ContactSums add_contact_forces(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid,
    const Positions& x, std::type_identity_t<Positions>* force, const ContactHistory<Friction>& history = {}) {
  ContactSums sums;
  detail::for_contact_points(
      surface, x, rigid, history.gaps, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3d& at) {
        const double gap = rigid.distance(at), gamma = history.gaps ? (*history.gaps)[f][k] : gap;
        if (gap < 0.0) sums.penetration_m = std::max(sums.penetration_m, -gap);
        if (gamma >= 0.0) return;
        const ContactResponse<double> r = contact.respond(gamma);
        sums.energy += p.weight_m2 * r.energy;
        const double pressure = r.pressure + r.stiffness * (gamma - gap);
        const Vec3d normal = rigid.sample(at).gradient;
        Vec3d traction = p.weight_m2 * pressure * normal;
        if (history.friction)
          traction += p.weight_m2 * history.friction->answer(f, k, at, rigid.origin, normal, pressure).traction;
        sums.push_N += traction.dot(rigid.direction);
        if (!force) return;
        for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n)
          force->col(surface.face(f).nodes[n]) -= p.shape[n] * traction;
      });
  return sums;
}

/// Where a contact stiffness is added.
struct TangentSums {
  const Equations& equations;
  double* values;                       ///< of the system's lower triangle
  Eigen::VectorXd* coupling = nullptr;  ///< ∂²energy/∂x∂advance, one per equation; nullptr: not wanted
  double curvature = 1.0;               ///< share of the rigid thing's curvature, which can make it indefinite
};

/// Adds the contact stiffness.
template <ContactHandler Contact, class Tool, class Friction = detail::NoFriction>
ContactSums add_contact_tangent(const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid,
    const Positions& x, const TangentSums& tangent, const ContactHistory<Friction>& history = {}) {
  ContactSums sums;
  const Equations& eq = tangent.equations;
  const std::size_t nodes = std::size_t(surface.nodes_per_face());
  Eigen::Matrix<double, 18, 18> K;
  std::size_t open = std::size_t(-1);
  const auto flush = [&] {
    if (open == std::size_t(-1)) return;
    const auto& n = surface.face(open).nodes;
    for (std::size_t j = 0; j < 3 * nodes; ++j)
      for (std::size_t i = 0; i < 3 * nodes; ++i) {
        const int row = eq.of[3 * std::size_t(n[i / 3]) + i % 3], column = eq.of[3 * std::size_t(n[j / 3]) + j % 3];
        if (row >= column && column >= 0) tangent.values[eq.slot(row, column)] += K(Eigen::Index(i), Eigen::Index(j));
      }
  };
  detail::for_contact_points(
      surface, x, rigid, history.gaps, [&](std::size_t f, std::size_t k, const SurfacePoint& p, const Vec3d& at) {
        const double gamma = history.gaps ? (*history.gaps)[f][k] : rigid.distance(at);
        if (gamma >= 0.0) return;
        if (f != open) {
          flush();
          open = f;
          K.setZero();
        }
        const DistanceSample d = rigid.sample(at);
        const ContactResponse<double> r = contact.respond(gamma);
        Mat3d block = p.weight_m2 * r.stiffness * d.gradient * d.gradient.transpose();
        block -= tangent.curvature * p.weight_m2 * r.pressure * d.hessian;
        if (history.friction) {
          const double pressure = r.pressure + r.stiffness * (gamma - d.distance);
          block += p.weight_m2 * history.friction->answer(f, k, at, rigid.origin, d.gradient, pressure).stiffness;
        }
        sums.push_stiffness += rigid.direction.dot(block * rigid.direction);
        for (std::size_t a = 0; a < nodes; ++a) {
          for (std::size_t b = 0; b < nodes; ++b)
            K.block<3, 3>(Eigen::Index(3 * a), Eigen::Index(3 * b)) += p.shape[a] * p.shape[b] * block;
          if (!tangent.coupling) continue;
          const Vec3d c = -p.shape[a] * (block * rigid.direction);
          for (std::size_t i = 0; i < 3; ++i)
            if (const int row = eq.of[3 * std::size_t(surface.face(f).nodes[a]) + i]; row >= 0)
              (*tangent.coupling)[row] += c[Eigen::Index(i)];
        }
      });
  flush();
  return sums;
}

template <class Tool>
SurfaceGaps surface_gaps(const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
  SurfaceGaps gaps(surface.size());
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) gaps[f].push_back(rigid.distance(surface.position(f, p, x)));
  return gaps;
}

/// A rigid thing and the body's node positions, at one time.
template <class Tool> struct ContactPlace {
  Moving<Tool> rigid;
  const Positions& x;
};

/// Gaps at the points of face f `now`, carried on by the displacement dx and the advance ds along the slope that they
/// have at `linear`.
template <class Tool> std::vector<double> predicted_gaps(const ContactSurface& surface, std::size_t f,
    const ContactPlace<Tool>& now, const ContactPlace<Tool>& linear, const Positions& dx, double ds) {
  std::vector<double> gaps;
  for (const SurfacePoint& p : surface.points(f))
    gaps.push_back(now.rigid.distance(surface.position(f, p, now.x)) +
                   linear.rigid.sample(surface.position(f, p, linear.x))
                       .gradient.dot(surface.position(f, p, dx) - ds * now.rigid.direction));
  return gaps;
}

/// The same of all faces, where the gaps of points that stay open do not matter: faces far from the rigid thing have a
/// bound of theirs.
template <class Tool> SurfaceGaps predicted_gaps(const ContactSurface& surface, const ContactPlace<Tool>& now,
    const ContactPlace<Tool>& linear, const Positions& dx, double ds) {
  constexpr double most_weight = 5.0 / 3.0;  // of a quadratic face's nodes together: Σ |shape|
  SurfaceGaps gaps(surface.size());
  for (std::size_t f = 0; f < surface.size(); ++f) {
    double moved = 0.0;
    for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k)
      moved = std::max(moved, dx.col(surface.face(f).nodes[k]).norm());
    const auto [middle, radius] = surface.ball(f, now.x);
    const double open = now.rigid.distance(middle) - radius - most_weight * moved - std::abs(ds);
    if (open > 0.0) gaps[f].assign(surface.points(f).size(), open);
    else gaps[f] = predicted_gaps(surface, f, now, linear, dx, ds);
  }
  return gaps;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/friction.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_FRICTION_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_FRICTION_HPP

namespace lumo {

/// Friction on the body's nodes [N], and what of its reaction pushes the indenter back along its way.
struct FrictionForces {
  std::vector<Vec3d> on_nodes;  ///< per mesh node; empty: none
  double push_N = 0.0;
};

/// Coulomb friction that remembers: a point of the surface sticks by a stiff spring along the rigid surface until the
/// spring's force is the coefficient times the pressure, and then slides with it. The spring's stretch is carried from
/// one equilibrium to the next. Source: Wriggers 2006, §5.2 (regularised Coulomb law, return mapping).
///
/// A point that comes into contact between two equilibria slips from then on only. Sticking, it is carried along by a
/// tool from where that met it: the tool's way counts from there. On what does not move, slip is the share of the
/// point's way that lies beyond the surface.
struct FrictionHistory {
  double coefficient = 0.0;
  double stiffness_N_per_m3 = 0.0;  ///< of the spring
  /// 1: a sliding point's stiffness is its force's slope; 0: the secant, with which far starts do not cycle.
  double turning = 1.0;

  /// A surface point at the last equilibrium.
  struct Point {
    Vec3d place;    ///< [m]
    Vec3d stretch;  ///< of its spring [m]
    double gap;     ///< [m]
    double ahead;   ///< advance after which the rigid thing meets it there [m]; infinite: never
  };
  Vec3d origin{0.0, 0.0, 0.0};     ///< of the rigid thing's frame there [m]
  Vec3d direction{0.0, 0.0, 0.0};  ///< of its advance, unit
  std::vector<std::vector<Point>> points;

  /// Springs without stretch at positions x, each 0.3 times as stiff as the law's penalty: a spring stretches by
  /// three overlaps times the coefficient.
  template <ContactHandler Contact, class Tool> FrictionHistory(
      const ContactSurface& surface, const Contact& law, double friction, const Positions& x, const Moving<Tool>& rigid)
      : coefficient(friction), stiffness_N_per_m3(0.3 * law.stiffness_N_per_m3), points(surface.size()) {
    if (coefficient > 0.0) remember(surface, rigid, x);
  }

  /// Traction [Pa] on the body at a point in contact, its stiffness [N/m³] at constant pressure, and the spring's
  /// stretch [m].
  struct Answer {
    Vec3d traction;
    Mat3d stiffness;
    Vec3d stretch;
  };
  Answer answer(std::size_t face, std::size_t point, const Vec3d& at, const Vec3d& rigid_origin, const Vec3d& normal,
      double pressure) const {
    const Mat3d along = Mat3d::Identity() - normal * normal.transpose();
    const auto [slip, share] = slip_since_touch(points[face][point], at, rigid_origin, normal);
    const Vec3d s = along * slip;
    const double length = s.norm(), most = coefficient * std::max(pressure, 0.0) / stiffness_N_per_m3;
    if (length <= most) return {-stiffness_N_per_m3 * s, share * stiffness_N_per_m3 * along, s};
    const Vec3d way = s / length;
    return {-stiffness_N_per_m3 * most * way,
        share * stiffness_N_per_m3 * most / length * (along - turning * way * way.transpose()), most * way};
  }

  /// Takes positions x, with the rigid thing as it is now, as the last equilibrium. Springs out of contact relax.
  template <ContactHandler Contact, class Tool>
  void settle(const ContactSurface& surface, const Contact& law, const Moving<Tool>& rigid, const Positions& x) {
    if (coefficient == 0.0) return;
    for (std::size_t f = 0; f < surface.size(); ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const Vec3d at = surface.position(f, surface.points(f)[k], x);
        const DistanceSample d = rigid.sample(at);
        points[f][k].stretch =
            d.distance < 0.0 ? answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).stretch
                             : Vec3d(Vec3d::Zero());
      }
    remember(surface, rigid, x);
  }

  /// Adds friction on the body's nodes [N] at positions x; returns their sum.
  template <ContactHandler Contact, class Tool> Vec3d add_nodal_forces(const ContactSurface& surface,
      const Contact& law, const Moving<Tool>& rigid, const Positions& x,
      std::type_identity_t<std::vector<Vec3d>>& on_nodes) const {
    Vec3d sum{0.0, 0.0, 0.0};
    for (std::size_t f = 0; f < surface.size() && coefficient > 0.0; ++f)
      for (std::size_t k = 0; k < surface.points(f).size(); ++k) {
        const SurfacePoint& p = surface.points(f)[k];
        const Vec3d at = surface.position(f, p, x);
        const DistanceSample d = rigid.sample(at);
        if (d.distance >= 0.0) continue;
        const Vec3d force =
            p.weight_m2 * answer(f, k, at, rigid.origin, d.gradient, law.respond(d.distance).pressure).traction;
        for (std::size_t n = 0; n < std::size_t(surface.nodes_per_face()); ++n)
          on_nodes[std::size_t(surface.face(f).nodes[n])] += p.shape[n] * force;
        sum += force;
      }
    return sum;
  }

 private:
  template <class Tool> void remember(const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
    origin = rigid.origin;
    direction = rigid.direction;
    for (std::size_t f = 0; f < surface.size(); ++f) {
      points[f].resize(surface.points(f).size(), {Vec3d::Zero(), Vec3d::Zero(), 0.0, 0.0});
      for (std::size_t k = 0; k < points[f].size(); ++k) {
        Point& p = points[f][k];
        p.place = surface.position(f, surface.points(f)[k], x);
        p.gap = rigid.distance(p.place);
        p.ahead = advance_to_meet(rigid, p.place, p.gap);
      }
    }
  }

  // Steps of the distance: none goes beyond the surface.
  template <class Tool> static double advance_to_meet(const Moving<Tool>& rigid, const Vec3d& place, double gap) {
    constexpr int most_steps = 40;
    constexpr double met = 1e-9;  // [m]
    if (rigid.direction.isZero(0.0)) return std::numeric_limits<double>::infinity();
    double ahead = 0.0;
    for (int k = 0; k < most_steps && gap > met; ++k) {
      ahead += gap;
      gap = rigid.distance(place - ahead * rigid.direction);
    }
    return gap > met ? std::numeric_limits<double>::infinity() : ahead;
  }

  // What a point has slipped by [m] since it came into contact, not yet projected on the surface, and how much of its
  // motion counts.
  std::pair<Vec3d, double> slip_since_touch(
      const Point& p, const Vec3d& at, const Vec3d& rigid_origin, const Vec3d& normal) const {
    const Vec3d motion = (at - p.place) - (rigid_origin - origin);
    if (p.gap <= 0.0) return {p.stretch + motion, 1.0};
    if (std::isfinite(p.ahead)) return {motion + p.ahead * direction, 1.0};
    const double closed = -normal.dot(motion), share = closed > p.gap ? 1.0 - p.gap / closed : 0.0;
    return {share * motion, share};
  }
};

}  // namespace lumo

#endif

// ---- lumo/mesh/contact_slope.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_CONTACT_SLOPE_HPP
#define SINGLE_INCLUDE_LUMO_MESH_CONTACT_SLOPE_HPP

namespace lumo {

/// How a surface leans away from the rigid thing that it touches, at one node: the surface's outward normal there is
/// `normal` + hertz_slope(opening)·tilt, made unit. All but `normal` may be interpolated across the edge of contact,
/// where the slope of the surface itself has a vertical tangent.
struct ContactSlope {
  Vec3d normal = Vec3d::Zero();  ///< into the rigid thing, unit; the surface's own where it touches; 0: not known
  Vec3d tilt = Vec3d::Zero();
  double opening = -1.0;  ///< q = (r² − a²)/a² of a round contact of radius a; < 0 where it touches
  double weight = 0.0;    ///< 1 at the contact, falling to 0 where this says nothing of the surface
};

/// In the middle between two nodes.
inline ContactSlope midway(const ContactSlope& a, const ContactSlope& b) {
  return {
      0.5 * (a.normal + b.normal), 0.5 * (a.tilt + b.tilt), 0.5 * (a.opening + b.opening), 0.5 * (a.weight + b.weight)};
}

/// Gap beside a round contact of two smooth elastic bodies at q = (r² − a²)/a² ≥ 0, in units of a²/(πR): √q + (q − 1)
/// atan √q. Source: Hertz 1882; Johnson 1985, eq. (3.42).
inline double hertz_gap(double q) {
  const double s = std::sqrt(q);
  return s + (q - 1.0) * std::atan(s);
}

/// Its derivative; 0 inside the contact.
inline double hertz_slope(double q) {
  if (!(q > 0.0)) return 0.0;
  const double s = std::sqrt(q);
  return std::atan(s) + s / (1.0 + q);
}

/// The q ≥ 0 at which hertz_gap(q) = gap.
inline double hertz_opening(double gap) {
  if (!(gap > 0.0)) return 0.0;
  double q = std::cbrt(0.5625 * gap * gap);  // (3/4 gap)^(2/3), from below; hertz_gap is convex
  for (int k = 0; k < 50; ++k) {
    const double step = (gap - hertz_gap(q)) / hertz_slope(q);
    q += step;
    if (std::abs(step) <= 1e-14 * q) break;
  }
  return q;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/state.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_STATE_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_STATE_HPP

namespace lumo {

/// How a solve ended. Only `converged` is scored (and `held` where a problem says so).
enum class Status {
  converged,              ///< equilibrium, residual certified, stable
  held,                   ///< a dynamic solver ran its sweeps; no statement about equilibrium
  max_iterations,         ///< residual still too large after the allowed iterations
  line_search,            ///< even the shortest step leaves an element less than a fifth of its volume by the solver's
                          ///< prediction: it is crushed, or flattened
  inverted,               ///< an element is turned inside out
  not_positive_definite,  ///< equilibrium, but unstable: the body would buckle away from it
  non_finite,             ///< NaN or infinity in the state or in a factor
  time_limit,             ///< stopped by the caller's time limit
  unresolved              ///< equilibria, but the mesh is too coarse for a contact: its area is not known
};

/// Whether objectives may rest on a state that ended so. `accept_held`: the problem says that it is about held states
/// (the paper's mechanics).
constexpr bool is_scored(Status s, bool accept_held = false) {
  return s == Status::converged || (accept_held && s == Status::held);
}

/// Whether the way to an equilibrium was lost: other strides, or another mesh, may find it.
constexpr bool is_lost(Status s) {
  return s == Status::not_positive_definite || s == Status::inverted || s == Status::line_search ||
         s == Status::max_iterations;
}

constexpr std::string_view to_string(Status s) {
  constexpr std::array<std::string_view, 9> names{"converged", "held", "max_iterations", "line_search", "inverted",
      "not_positive_definite", "non_finite", "time_limit", "unresolved"};
  return names[std::size_t(s)];
}

/// The tool's action about one point of the surface.
struct TractionPoint {
  Vec3d reference_m, place_m;  ///< undeformed and deformed
  double area_m2 = 0.0;        ///< of the deformed surface that it stands for
  double pressure_Pa = 0.0;
  Vec3d traction_Pa;  ///< on the body, per deformed area, with friction
};

/// One of the separate places where a tool touches, and how well the mesh resolves it.
struct ContactSpot {
  Vec3d reference_m = Vec3d::Zero();  ///< its place on the undeformed surface, the mean by force
  double force_N = 0.0;               ///< sum of the normal forces
  double area_m2 = 0.0;               ///< deformed
  double rim_m = 0.0;                 ///< length of its edge, deformed
  /// Between neighbouring nodes of the undeformed surface along its edge; where it has none, between those that bear.
  double edge_m = 0.0;
  double force_outside_N = 0.0;  ///< what of force_N acts outside the contact set: pressure and gap disagree there

  /// Of the disc with as much area for its edge; the width of a strip.
  double radius_m() const { return rim_m > 0.0 ? 2.0 * area_m2 / rim_m : 0.0; }
};

/// The pad at one load. Forces act on the indenter, along −direction; all in the finger frame, SI.
struct MechanicalState {
  Status status = Status::non_finite;
  double load_N = 0.0;       ///< prescribed
  bool certified = false;    ///< equilibrium, found so by an independent routine; never of a state that is only held
  double force_N = 0.0;      ///< contact wrench · (−direction)
  double met_force_N = 0.0;  ///< the force when a solver that goes in time stopped the advance, before the hold
  double depth_m = 0.0;      ///< advance since first touch of the exact undeformed profile
  std::vector<Vec3d> displacement;  ///< per mesh node [m]
  /// Contact field per mesh node: > 0 in contact with the indenter, < 0 outside; −infinity on nodes that it cannot
  /// touch. Linear on the sub-facets of the surface (corners and edge middles); the contact set is {φ > 0}.
  std::vector<double> contact_field;
  /// How the surface leans away from the indenter, and from the carrier, per mesh node; may be empty.
  std::vector<ContactSlope> tool_slopes, carrier_slopes;
  /// The contact set by records (record_margin): is each sub-triangle of the touchable surface, in its order, in it?
  /// Empty: it is {φ > 0}.
  std::vector<char> recorded;
  std::vector<Vec3d> friction_N;    ///< friction on the body per mesh node; empty without
  double friction_push_N = 0.0;     ///< what of it is in force_N
  std::vector<double> pressure_Pa;  ///< indenter pressure per mesh node, per reference area; 0 off the surface
  /// Cauchy traction of the tool on the body, per deformed area, where it presses or rubs. The sum of traction · area
  /// is the force on the body: force_N along the direction of approach, and what lies across it.
  std::vector<TractionPoint> tractions;
  /// The same per mesh node, linear on the sub-facets of the deformed surface, on which it integrates to the same
  /// force.
  std::vector<Vec3d> traction_Pa;
  std::vector<ContactSpot> spots;  ///< of contact with the indenter; empty without
  double contact_area_m2 = 0.0;    ///< A(C; X), deformed
  double reference_area_m2 = 0.0;  ///< A_0(C), undeformed
  /// Norm of the out-of-balance forces, from an independent routine
  double residual_N = std::numeric_limits<double>::infinity();
  double energy_error = 0.0;   ///< how far the mesh is from resolving the stresses, see EnergyError
  double penetration_m = 0.0;  ///< largest overlap of surface and indenter
  int iterations = 0;          ///< Newton steps, or sweeps, spent on this load
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/solvers/press_solver.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_PRESS_SOLVER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_PRESS_SOLVER_HPP

namespace lumo {

/// The physics of a press.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element> struct PressPhysics {
  Material material;
  Contact contact;
  Element element;
};

template <class Material, class Contact, class Element> PressPhysics(Material, Contact, Element)
    -> PressPhysics<Material, Contact, Element>;

/// How far the press of one scenario is.
struct PressReport {
  double wanted_N = 0.0;  ///< the load that is being approached, or has ended
  double load_N = 0.0;    ///< the last one that was reached, on the way to it, too
  double depth_m = 0.0;   ///< advance since first touch
  int iterations = 0;     ///< factorisations, or sweeps, spent on wanted_N
  std::optional<double> residual =
      {};  ///< out-of-balance forces over the load; none of a solver in time, or where it is not finite
  std::optional<Status> ended = {};  ///< how wanted_N ended; nullopt: on the way
};
/// Called by a solver as it goes, from the thread of the press; may be empty. What it does changes no result.
using PressWatch = std::function<void(const PressReport&)>;

/// How the states under a scenario's loads are found. model() makes what scenarios on one mesh share, for a sector of
/// it where the solver `uses_symmetry`; run() gives one state per load, displacements on the sector's nodes, up to the
/// first that fails. Laws: same input, same bits, also side by side; a state is `converged` or `held` or says why not;
/// run() changes nothing in the model.
template <class S, class Material, class Contact, class Element>
concept PressSolver = std::copyable<S> && requires(const S& solver, const Body& body, const TetMesh& mesh,
    Symmetry planes, const PressPhysics<Material, Contact, Element>& physics,
    const typename S::template Model<Material, Contact, Element>& model, const Scenario<Sphere>& scenario,
    const Touch& touch) {
  { S::uses_symmetry } -> std::convertible_to<bool>;
  {
    solver.model(body, mesh, planes, physics)
    } -> std::same_as<std::unique_ptr<typename S::template Model<Material, Contact, Element>>>;
  { solver.run(model, scenario, touch) } -> std::same_as<std::vector<MechanicalState>>;
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/certify.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CERTIFY_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CERTIFY_HPP

namespace lumo {

/// A state whose balance is to be found.
struct PressedState {
  double load_N;                           ///< on the indenter
  const std::vector<Vec3d>& displacement;  ///< per mesh node [m]
  FrictionForces friction = {};            ///< depends on the way that was taken, and is given
};

/// Norm of the out-of-balance forces on the free components of the whole body and on the indenter [N], by a routine
/// that shares no assembly with the solver: the virtual work of each node's shape function, point by point, on the
/// whole mesh, without sectors, equations or linearised volumes and gaps. It does share the policies (the material's
/// stresses, the element's points and shape functions, the contact's response) and the points and weights of
/// ContactSurface: a fault in one of these is found only by the policies' own tests.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const PressPhysics<Material, Contact, Element>& physics,
    const Moving<Tool>& indenter, const PressedState& state);

namespace detail {

// x of Aᵀ x = b by Gauss's elimination with the largest pivots, operation for operation as Eigen's PartialPivLU has it,
// which takes the compiler as long as a tenth of a program with a simulator.
template <class Columns> Columns solved_transposed(const Mat3d& A, Columns b) {
  std::array<std::array<double, 3>, 3> a;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) a[i][j] = A(Eigen::Index(j), Eigen::Index(i));
  for (std::size_t k = 0; k < 3; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < 3; ++i)
      if (std::abs(a[i][k]) > std::abs(a[pivot][k])) pivot = i;
    if (pivot != k) {
      std::swap(a[k], a[pivot]);
      for (Eigen::Index c = 0; c < b.cols(); ++c) std::swap(b(Eigen::Index(k), c), b(Eigen::Index(pivot), c));
    }
    for (std::size_t i = k + 1; i < 3; ++i) {
      if (a[k][k] != 0.0) a[i][k] /= a[k][k];
      for (std::size_t j = k + 1; j < 3; ++j) a[i][j] -= a[i][k] * a[k][j];
    }
  }
  for (Eigen::Index c = 0; c < b.cols(); ++c) {
    const auto rest = [&](std::size_t k, std::size_t from, std::size_t to) {
      double sum = 0.0;
      for (std::size_t i = from; i < to; ++i) sum += a[k][i] * b(Eigen::Index(i), c);
      return b(Eigen::Index(k), c) - sum;
    };
    for (std::size_t k = 1; k < 3; ++k) b(Eigen::Index(k), c) = rest(k, 0, k);
    for (std::size_t k = 3; k-- > 0;) b(Eigen::Index(k), c) = rest(k, k + 1, 3) * (1.0 / a[k][k]);
  }
  return b;
}

// Adds the internal forces of all tetrahedra.
template <class Material, class Element> void add_internal_forces(const TetMesh& mesh, const Material& material,
    const Element& element, const std::vector<Vec3d>& displacement, std::vector<Vec3d>& force) {
  constexpr std::size_t points = std::size_t(Element::points);
  for (const auto& t : mesh.tets) {
    std::array<Eigen::Matrix<double, 3, Element::nodes>, points> slope;
    std::array<Mat3d, points> F;
    std::array<double, points> volume;
    double whole = 0.0, changed = 0.0;
    for (std::size_t q = 0; q < points; ++q) {
      const auto by_xi = Element::gradients(int(q));
      Mat3d reference = Mat3d::Zero();
      for (int a = 0; a < Element::nodes; ++a)
        reference += mesh.nodes[std::size_t(t[std::size_t(a)])] * Vec3d(by_xi.col(a)).transpose();
      slope[q] = solved_transposed(reference, by_xi);
      F[q] = Mat3d::Identity();
      for (int a = 0; a < Element::nodes; ++a)
        F[q] += displacement[std::size_t(t[std::size_t(a)])] * Vec3d(slope[q].col(a)).transpose();
      volume[q] = Element::weight(int(q)) * reference.determinant();
      whole += volume[q];
      changed += volume[q] * F[q].determinant();
    }
    for (std::size_t q = 0; q < points; ++q) {
      const double J = F[q].determinant();
      const double ratio = element.mean_dilatation ? changed / whole : J;
      const Mat3d P = material.distortion_stress(F[q]) +
                      material.volumetric(ratio).stress * J * solved_transposed(F[q], Mat3d(Mat3d::Identity()));
      for (int a = 0; a < Element::nodes; ++a)
        force[std::size_t(t[std::size_t(a)])] += volume[q] * (P * Vec3d(slope[q].col(a)));
    }
  }
}

// Takes the contact pressure off the nodes' forces, and adds it to the push on an indenter.
template <class Contact, class Tool> void add_pressure(const ContactSurface& surface, const Contact& contact,
    const Moving<Tool>& rigid, const Positions& x, std::vector<Vec3d>& force, double* push) {
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const DistanceSample d = rigid.sample(surface.position(f, p, x));
      const Vec3d traction = contact.respond(d.distance).pressure * d.gradient;
      if (push) *push += p.weight_m2 * traction.dot(rigid.direction);
      for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k)
        force[std::size_t(surface.face(f).nodes[k])] -= p.weight_m2 * p.shape[k] * traction;
    }
}

}  // namespace detail

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, Indenter Tool>
double out_of_balance(const Body& body, const TetMesh& mesh, const PressPhysics<Material, Contact, Element>& physics,
    const Moving<Tool>& indenter, const PressedState& state) {
  std::vector<Vec3d> force(mesh.nodes.size(), Vec3d::Zero());
  detail::add_internal_forces(mesh, physics.material, physics.element, state.displacement, force);
  Positions x(3, Eigen::Index(mesh.nodes.size()));
  for (std::size_t k = 0; k < mesh.nodes.size(); ++k) x.col(Eigen::Index(k)) = mesh.nodes[k] + state.displacement[k];
  double push = state.friction.push_N;
  for (std::size_t k = 0; k < state.friction.on_nodes.size(); ++k) force[k] -= state.friction.on_nodes[k];
  const Carrier carrier{body.carrier};
  const auto surface = [&](auto chosen) { return ContactSurface(mesh, body, chosen, physics.contact); };
  detail::add_pressure(
      surface([](const Patch& p) { return p.contactable; }), physics.contact, indenter, x, force, &push);
  detail::add_pressure(surface([](const Patch& p) { return p.meets_carrier; }), physics.contact,
      Moving<Carrier>{&carrier, Vec3d::Zero(), indenter.direction}, x, force, nullptr);
  for (const BoundaryFace& f : mesh.faces)
    if (body.patches[std::size_t(f.patch)].bonded)
      for (int k = 0; k < mesh.nodes_per_face(); ++k) force[std::size_t(f.nodes[std::size_t(k)])].setZero();
  double sum = (push - state.load_N) * (push - state.load_N);
  for (const Vec3d& f : force) sum += f.squaredNorm();
  return std::sqrt(sum);
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/contact_edge.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_EDGE_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_EDGE_HPP

namespace lumo {

namespace detail {

// Nodes of a surface beside a rigid thing, numbered among themselves.
struct SurfaceNodes {
  std::vector<int> mesh_node;
  std::vector<int> number;                    // of each of the mesh's nodes among these; −1: it is none of them
  std::vector<Vec3d> place;                   // now [m]
  std::vector<Vec3d> away;                    // gradient of the rigid thing's signed distance
  std::vector<double> gap;                    // [m]; infinite where there is nothing to touch
  std::vector<double> area;                   // of the undeformed surface that is a node's [m²]
  std::vector<std::array<int, 3>> triangles;  // sub-triangles
  std::vector<int> first, neighbour;          // along edges of sub-triangles: neighbour[first[k]] …

  std::size_t size() const { return mesh_node.size(); }
  // Of a mesh's node that is here.
  std::size_t at(int node) const { return std::size_t(number[std::size_t(node)]); }
  std::span<const int> around(std::size_t k) const {
    return {neighbour.data() + first[k], std::size_t(first[k + 1] - first[k])};
  }
};

// Calls visit(area, mesh nodes at the corners) for every sub-triangle of the surface.
template <class Visit> void for_sub_triangles(const ContactSurface& surface, const Positions& x, Visit&& visit) {
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t part = 0; part < surface.sub_triangles(); ++part) {
      const std::array<int, 3> node = surface.sub_triangle(f, part);
      const Vec3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]);
      visit(0.5 * (b - a).cross(c - a).norm(), node);
    }
}

template <class Tool>
SurfaceNodes nodes_beside(const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
  SurfaceNodes s;
  std::vector<int>& number = s.number;
  number.assign(std::size_t(x.cols()), -1);
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k) {
      const int node = surface.face(f).nodes[k];
      if (number[std::size_t(node)] >= 0) continue;
      number[std::size_t(node)] = int(s.size());
      s.mesh_node.push_back(node);
      const Vec3d at = x.col(node);
      const DistanceSample d = rigid.sample(at);
      s.place.push_back(at);
      s.gap.push_back(d.distance);
      s.away.push_back(d.gradient);
    }
  const std::vector<double> areas = surface.node_areas();
  for (const int node : s.mesh_node) s.area.push_back(areas[std::size_t(node)]);
  std::vector<std::pair<int, int>> edges;
  for_sub_triangles(surface, x, [&](double, const std::array<int, 3>& node) {
    std::array<int, 3> t;
    for (std::size_t k = 0; k < 3; ++k) t[k] = number[std::size_t(node[k])];
    s.triangles.push_back(t);
    for (std::size_t k = 0; k < 3; ++k) {
      edges.emplace_back(t[k], t[(k + 1) % 3]);
      edges.emplace_back(t[(k + 1) % 3], t[k]);
    }
  });
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  s.first.assign(s.size() + 1, 0);
  for (const auto& [a, b] : edges) {
    ++s.first[std::size_t(a) + 1];
    s.neighbour.push_back(b);
  }
  for (std::size_t k = 0; k < s.size(); ++k) s.first[k + 1] += s.first[k];
  return s;
}

// What of a triangle lies inside the edge of contact, and the length of edge in it. `lone`: the corner that is not on
// the side of the other two; 0 where there is none.
struct RimCut {
  double area = 0.0, rim = 0.0;
  std::size_t lone = 0;
};

// `field` is > 0 inside, and linear.
inline RimCut cut_at_rim(const std::array<Vec3d, 3>& place, const std::array<double, 3>& field) {
  const auto inside = [&](std::size_t k) { return field[k] > 0.0; };
  const int count = inside(0) + inside(1) + inside(2);
  RimCut cut;
  if (count == 0) return cut;
  cut.lone = count == 3 || inside(0) == (count == 1) ? 0 : inside(1) == (count == 1) ? 1 : 2;
  const std::size_t first = cut.lone, second = (first + 1) % 3, third = (first + 2) % 3;
  const Vec3d b = place[second] - place[first], c = place[third] - place[first];
  const double whole = 0.5 * b.cross(c).norm();
  cut.area = whole;
  if (count == 3) return cut;
  const double u = field[first] / (field[first] - field[second]), v = field[first] / (field[first] - field[third]);
  cut.area = whole * (count == 1 ? u * v : 1.0 - u * v);
  cut.rim = (u * b - v * c).norm();
  return cut;
}

// The edge of contact, found from the gap beside it. Raw overlaps are no measure of contact: they are a few µm and
// perforated by the facets' sag. The gap of a smooth contact rises as the distance to its edge to the power 3/2, and
// Hertz's law for round contacts (hertz_gap), turned about, makes of it Y = (r² − a²)/2a, which is a quadratic of the
// place and passes through the edge with slope 1. A quadratic is fitted to Y about every node near the edge; its zero
// is the edge, and its slope, put back into the law, is the surface's slope against the rigid thing. Radius and
// stiffness of the law are each contact's own, found so that slope 1 holds in the mean.
class ContactEdge {
 public:
  // Nodes that are nearer than `tolerance` [m], and those that bear on most of their area, are taken to touch at first.
  // `bears`: the part of each node's area that presses.
  ContactEdge(const SurfaceNodes& nodes, const std::vector<double>& bears, double tolerance) : s_(&nodes) {
    for (std::size_t k = 0; k < s_->size(); ++k) spacing_.push_back(std::sqrt(lattice * s_->area[k]));
    find_parts(bears, tolerance);
    if (parts_.empty()) return;
    spread();
    mark_rings();
    sort_into_cells();
    guess_laws();
    for (int pass = 0; pass < most_passes && adjust(); ++pass) {
    }
    fit_field();
  }

  // Edge length of equilateral triangles that have as much area as a node [m].
  double spacing(std::size_t k) const { return spacing_[k]; }
  // Signed distance [m] of each node to the edge, > 0 inside.
  const std::vector<double>& field() const { return field_; }

  // How many separate contacts there are.
  std::size_t parts() const { return parts_.size(); }
  // The one that a triangle of nodes belongs to, of which `lone` is not on the side of the others; −1: none.
  int part_of(const std::array<int, 3>& t, std::size_t lone) const {
    const int part = part_[std::size_t(t[lone])];
    return part >= 0 ? part : part_[std::size_t(t[(lone + 1) % 3])];
  }
  int part_of_node(std::size_t k) const { return part_[k]; }

  std::vector<ContactSlope> slopes() const {
    std::vector<ContactSlope> all(s_->size());
    for (std::size_t k = 0; k < s_->size(); ++k) {
      if (part_[k] < 0) continue;
      const Part& part = part_of(k);
      const std::optional<Fit> fit = touches_[k] || ring_[k] ? fits_[k] : lifted(k);
      if (!fit && !touches_[k]) continue;
      const double to_edge = way_[k] / reach(k);
      ContactSlope& slope = all[k];
      slope.normal = -s_->away[k];
      slope.weight = touches_[k] || ring_[k] ? 1.0 : std::clamp(2.0 - 2.0 * to_edge, 0.0, 1.0);
      if (!fit) continue;
      slope.opening = 2.0 * fit->value / part.radius;
      slope.tilt = (2.0 * part.scale / part.radius) * fit->gradient;
    }
    return all;
  }

 private:
  static constexpr double lattice = 1.15;         // 2/√3: spacing² over the area of a node of equilateral triangles
  static constexpr double wanted_reach = 8.0;     // of the fit, in spacings of the nodes
  static constexpr double least_reach = 3.0;      // the same
  static constexpr double most_of_radius = 0.75;  // beyond, the gap is no quadratic under Hertz's law
  static constexpr double way_looked_at = 2.0;    // of the reach: what a fit at the reach's end needs
  static constexpr double most_of_area = 0.5;     // of a node
  static constexpr int rings = 2;                 // nodes this near to the edge, in edges, are placed by the fit
  static constexpr int most_passes = 20;
  static constexpr double least_change = 0.7;    // of radius and scale in a pass
  static constexpr double settled = 1e-3;        // of radius and scale
  static constexpr double circle_reach2 = 12.0;  // squared reach of points of the edge, in spacings
  static constexpr double believable = 0.3;      // logarithm of a slope over that of the nodes outside
  static constexpr double flattest = 1e-9;       // ridge on second derivatives, of the sum of the weights

  struct Part {
    double radius;  // a: of the circle with as much area for its edge [m]
    double scale;   // of the gap: a²/(πR) [m]
  };
  struct Fit {
    double value;    // Y [m]
    Vec3d gradient;  // in the plane at right angles to the gap
    double bend;     // second derivative along the gradient [1/m]

    // Signed distance to Y = 0, > 0 where Y < 0.
    double distance() const {
      const double steep = gradient.norm(), root = steep * steep - 2.0 * bend * value;
      return -2.0 * value / (steep + std::sqrt(std::max(root, 0.0)));
    }
    // Slope at the edge, 1 under the right law.
    double steepness(double radius) const {
      return gradient.norm() / std::sqrt(std::max(1.0 + 2.0 * value / radius, 0.1));
    }
  };

  // A point of the edge with the direction in which the gap opens there.
  struct Sample {
    int part;
    Vec3d point, outward;
    double spacing, steepness;
  };

  const Part& part_of(std::size_t k) const { return parts_[std::size_t(part_[k])]; }
  double reach(std::size_t k) const {
    return std::max(
        std::min(wanted_reach * spacing_[k], most_of_radius * part_of(k).radius), least_reach * spacing_[k]);
  }

  // Nodes that touch and are connected, if only by nodes that bear: coarse facets may hang free between places that
  // are pressed.
  void find_parts(const std::vector<double>& bears, double tolerance) {
    const std::size_t n = s_->size();
    touches_.assign(n, 0);
    part_.assign(n, -1);
    way_.assign(n, std::numeric_limits<double>::infinity());
    ring_.assign(n, 0);
    field_.resize(n);
    for (std::size_t k = 0; k < n; ++k) touches_[k] = s_->gap[k] <= tolerance || bears[k] > most_of_area;
    if (tolerance > 0.0 && std::none_of(touches_.begin(), touches_.end(), [](char t) { return t != 0; }))
      touches_[std::size_t(std::min_element(s_->gap.begin(), s_->gap.end()) - s_->gap.begin())] = 1;
    std::vector<std::size_t> open;
    for (std::size_t k = 0; k < n; ++k) {
      field_[k] = touches_[k] ? spacing_[k] : -s_->gap[k];
      if (!touches_[k] || part_[k] >= 0) continue;
      const int number = int(parts_.size());
      double area = 0.0;
      open.assign(1, k);
      part_[k] = number;
      while (!open.empty()) {
        const std::size_t at = open.back();
        open.pop_back();
        if (touches_[at]) area += s_->area[at];
        for (const int other : s_->around(at)) {
          const std::size_t o = std::size_t(other);
          if (part_[o] >= 0 || !(touches_[o] || bears[o] > 0.0)) continue;
          part_[o] = number;
          open.push_back(o);
        }
      }
      parts_.push_back({std::sqrt(area / pi), 0.0});
    }
  }

  // Every free node belongs to the contact to which it has the shortest way.
  void spread() {
    using Step = std::pair<double, int>;
    std::priority_queue<Step, std::vector<Step>, std::greater<>> next;
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (touches_[k]) {
        way_[k] = 0.0;
        next.emplace(0.0, int(k));
      }
    while (!next.empty()) {
      const auto [way, at] = next.top();
      next.pop();
      const std::size_t k = std::size_t(at);
      if (way > way_[k] || way > way_looked_at * reach(k)) continue;
      for (const int other : s_->around(k)) {
        const std::size_t o = std::size_t(other);
        const double longer = way + (s_->place[o] - s_->place[k]).norm();
        if (!(s_->gap[o] < std::numeric_limits<double>::infinity()) || !(longer < way_[o])) continue;
        way_[o] = longer;
        part_[o] = part_[k];
        next.emplace(longer, other);
      }
    }
  }

  // Nodes within `rings` edges of one of the other kind.
  void mark_rings() {
    for (std::size_t k = 0; k < s_->size(); ++k) {
      if (part_[k] < 0) continue;
      for (const int other : s_->around(k))
        if (touches_[std::size_t(other)] != touches_[k]) ring_[k] = 1;
    }
    for (char ring = 1; ring < rings; ++ring)
      for (std::size_t k = 0; k < s_->size(); ++k) {
        if (part_[k] < 0 || ring_[k]) continue;
        for (const int other : s_->around(k))
          if (ring_[std::size_t(other)] == ring && touches_[std::size_t(other)] == touches_[k])
            ring_[k] = char(ring + 1);
      }
  }

  // Free nodes that a fit may use, by cells of space.
  void sort_into_cells() {
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (part_[k] >= 0) cell_ = std::max(cell_, reach(k));
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (part_[k] >= 0 && !touches_[k]) free_.push_back({cell_of(s_->place[k]), int(k)});
    std::sort(free_.begin(), free_.end());
    lifted_.assign(s_->size(), 0.0);
  }
  using Cell = std::array<long, 3>;
  Cell cell_of(const Vec3d& p) const {
    return {std::lround(p.x() / cell_), std::lround(p.y() / cell_), std::lround(p.z() / cell_)};
  }
  template <class Visit> void for_free_near(const Vec3d& p, Visit&& visit) const {
    const Cell c = cell_of(p);
    for (long i = -1; i <= 1; ++i)
      for (long j = -1; j <= 1; ++j) {
        const Cell low{c[0] + i, c[1] + j, c[2] - 1}, high{c[0] + i, c[1] + j, c[2] + 1};
        for (auto at = std::lower_bound(free_.begin(), free_.end(), std::pair(low, -1));
             at != free_.end() && at->first <= high; ++at)
          visit(std::size_t(at->second));
      }
  }

  // Scales that suit the free nodes, by their way to the contact.
  void guess_laws() {
    std::vector<std::vector<double>> scales(parts_.size());
    for (const auto& [cell, number] : free_) {
      const std::size_t k = std::size_t(number);
      const std::size_t p = std::size_t(part_[k]);
      const double out = std::max(way_[k] - 0.5 * spacing_[k], 0.25 * spacing_[k]) / parts_[p].radius;
      if (way_[k] < least_reach * spacing_[k]) scales[p].push_back(s_->gap[k] / hertz_gap(out * (2.0 + out)));
    }
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      std::vector<double>& all = scales[p];
      if (all.empty()) continue;
      const auto middle = all.begin() + long(all.size() / 2);
      std::nth_element(all.begin(), middle, all.end());
      parts_[p].scale = *middle;
    }
  }

  void lift() {
    for (const auto& [cell, number] : free_) {
      const std::size_t k = std::size_t(number);
      const Part& part = part_of(k);
      lifted_[k] = part.scale > 0.0 ? 0.5 * part.radius * hertz_opening(s_->gap[k] / part.scale) : 0.0;
    }
  }

  // One step towards each contact's radius and scale; false: they have settled.
  bool adjust() {
    fit_field();
    struct Sum {
      double area = 0.0, length = 0.0, steepness = 0.0;
      int count = 0;
    };
    std::vector<Sum> sums(parts_.size());
    for (std::size_t k = 0; k < s_->size(); ++k)
      if (fits_[k] && !touches_[k]) {
        Sum& sum = sums[std::size_t(part_[k])];
        sum.steepness += fits_[k]->steepness(part_of(k).radius);
        ++sum.count;
      }
    for (const std::array<int, 3>& t : s_->triangles) measure(t, sums);
    bool moved = false;
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      if (!(sums[p].length > 0.0) || sums[p].count == 0 || !(sums[p].area > 0.0)) continue;
      Part& part = parts_[p];
      const Part before = part;
      // Half-way, and never far: a wrong law makes islands, which make the next one worse.
      const auto towards = [](double factor) {
        return std::sqrt(std::clamp(factor, least_change, 1.0 / least_change));
      };
      part.radius *= towards(2.0 * sums[p].area / (sums[p].length * part.radius));
      part.scale *= towards(std::pow(sums[p].steepness / sums[p].count, 1.5));
      moved = moved || std::abs(part.radius - before.radius) > settled * part.radius ||
              std::abs(part.scale - before.scale) > settled * part.scale;
    }
    return moved;
  }

  // Adds the part of a sub-triangle that is inside, and the length of the edge in it.
  template <class Sums> void measure(const std::array<int, 3>& t, Sums& sums) const {
    std::array<double, 3> field;
    std::array<Vec3d, 3> place;
    for (std::size_t k = 0; k < 3; ++k) {
      field[k] = field_[std::size_t(t[k])];
      place[k] = s_->place[std::size_t(t[k])];
    }
    const RimCut cut = cut_at_rim(place, field);
    if (cut.area == 0.0) return;
    const int part = part_of(t, cut.lone);
    if (part < 0) return;
    sums[std::size_t(part)].area += cut.area;
    sums[std::size_t(part)].length += cut.rim;
  }

  // Fits at free nodes give points of the edge. To nodes that touch, a fit has to be carried on; where it comes out
  // with a slope that no contact has, and behind the first ring, they are placed by the circle through those points.
  void fit_field() {
    lift();
    fits_.assign(s_->size(), std::nullopt);
    samples_.clear();
    for (const auto& [cell, number] : free_) {
      const std::size_t k = std::size_t(number);
      if (!ring_[k]) continue;
      fits_[k] = lifted(k);
      field_[k] = -s_->gap[k];
      if (!fits_[k]) continue;
      const double distance = fits_[k]->distance();
      const Vec3d outward = fits_[k]->gradient.normalized(), point = s_->place[k] + distance * outward;
      samples_.push_back({part_[k], point, outward, spacing_[k], fits_[k]->steepness(part_of(k).radius)});
      // A node that is well outside by its own gap stays there.
      if (!(distance > 0.0 && lifted_[k] > 0.5 * spacing_[k])) field_[k] = distance;
    }
    for (std::size_t k = 0; k < s_->size(); ++k) {
      if (!ring_[k] || !touches_[k]) continue;
      double usual = 1.0;
      fits_[k] = inside(k, usual);
      if (const std::optional<Fit> own = ring_[k] == 1 ? lifted(k) : std::nullopt)
        if (std::abs(std::log(own->steepness(part_of(k).radius) / usual)) < believable) fits_[k] = own;
      field_[k] = fits_[k] ? fits_[k]->distance() : spacing_[k];
      if (field_[k] < -0.5 * spacing_[k]) field_[k] = spacing_[k];
    }
  }

  // Y at a node that touches, from the circle that fits the points of the edge about it best. Source: Guennebaud,
  // Germann, Gross 2008 (algebraic spheres through oriented points).
  // `steepness`: the mean of theirs.
  std::optional<Fit> inside(std::size_t k, double& steepness) const {
    const Vec3d p = s_->place[k], normal = s_->away[k];
    const auto flat = [&](const Vec3d& v) -> Vec3d { return v - v.dot(normal) * normal; };
    double w = 0.0, pn = 0.0, pp = 0.0, steep_sum = 0.0;
    Vec3d sum_p = Vec3d::Zero(), sum_n = Vec3d::Zero();
    for (const Sample& s : samples_) {
      if (s.part != part_[k]) continue;
      const Vec3d d = flat(s.point - p), out = flat(s.outward).normalized();
      const double t = (s.point - p).squaredNorm() / (circle_reach2 * s.spacing * s.spacing);
      if (t >= 1.0) continue;
      const double weight = std::pow(1.0 - t, 4);
      w += weight;
      sum_p += weight * d;
      sum_n += weight * out;
      pn += weight * d.dot(out);
      pp += weight * d.squaredNorm();
      steep_sum += weight * s.steepness;
    }
    if (!(w > 0.0)) return std::nullopt;
    steepness = steep_sum / w;
    const double spread = pp - sum_p.squaredNorm() / w;
    const double q = spread > 1e-12 * pp ? 0.5 * (pn - sum_p.dot(sum_n) / w) / spread : 0.0;
    const Vec3d l = (sum_n - 2.0 * q * sum_p) / w;
    const double c = -(l.dot(sum_p) + q * pp) / w;
    // c + l·x + q x² at x = 0, as a distance along its slope; the circle's own root where it bends.
    const double root = l.squaredNorm() - 4.0 * q * c, steep = l.norm();
    if (!(steep > 0.0)) return std::nullopt;
    const double out = root > 0.0 ? 2.0 * c / (steep + std::sqrt(root)) : c / steep;
    const double a = part_of(k).radius, r = std::max(a + out, 0.1 * a);
    return Fit{0.5 * (r * r - a * a) / a, (r / a / steep) * l, 1.0 / a};
  }

  // The quadratic through Y of the free nodes about node k. Y is known the better the wider the gap is.
  std::optional<Fit> lifted(std::size_t k) const {
    const Part& part = part_of(k);
    if (!(part.scale > 0.0)) return std::nullopt;
    const double h = reach(k);
    const Vec3d normal = s_->away[k], across = std::abs(normal.x()) < 0.6 ? Vec3d::UnitX() : Vec3d::UnitY();
    const Vec3d e1 = normal.cross(across).normalized(), e2 = normal.cross(e1);
    using Vector6d = Eigen::Matrix<double, 6, 1>;
    Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
    Vector6d b = Vector6d::Zero();
    int count = 0;
    for_free_near(s_->place[k], [&](std::size_t o) {
      if (part_[o] != part_[k]) return;
      const Vec3d d = (s_->place[o] - s_->place[k]) / h;
      const double t = d.squaredNorm();
      if (t >= 1.0) return;
      const double u = e1.dot(d), v = e2.dot(d), gap = s_->gap[o] / part.scale;
      const double w = (1.0 - t) * (1.0 - t) * gap * gap * s_->area[o];
      Vector6d basis;
      basis << 1.0, u, v, 0.5 * u * u, u * v, 0.5 * v * v;
      A += w * basis * basis.transpose();
      b += w * lifted_[o] * basis;
      ++count;
    });
    if (count < 6) return std::nullopt;
    for (int i = 3; i < 6; ++i) A(i, i) += flattest * A(0, 0);
    const Vector6d c = A.ldlt().solve(b);
    if (!c.allFinite()) return std::nullopt;
    Fit fit;
    fit.value = c[0];
    fit.gradient = (c[1] * e1 + c[2] * e2) / h;
    const double steep2 = c[1] * c[1] + c[2] * c[2];
    if (!(steep2 > 0.0)) return std::nullopt;
    fit.bend = (c[3] * c[1] * c[1] + 2.0 * c[4] * c[1] * c[2] + c[5] * c[2] * c[2]) / (steep2 * h * h);
    return fit;
  }

  const SurfaceNodes* s_;
  std::vector<double> spacing_;
  std::vector<char> touches_;
  std::vector<int> part_;    // contact that a node belongs to; −1: none
  std::vector<double> way_;  // along edges, to the nearest node that touches [m]
  std::vector<char> ring_;   // 1 beside the edge, 2 behind that, 0 elsewhere
  std::vector<Part> parts_;
  double cell_ = 0.0;
  std::vector<std::pair<Cell, int>> free_;
  std::vector<double> lifted_;            // Y [m]
  std::vector<std::optional<Fit>> fits_;  // at nodes of the rings
  std::vector<Sample> samples_;
  std::vector<double> field_;
};

}  // namespace detail

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/contact_spots.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_SPOTS_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_SPOTS_HPP

namespace lumo::detail {

// A point of a surface that something presses on.
struct PressedPoint {
  std::size_t face;
  const SurfacePoint* point;
  Vec3d reference;  // undeformed
  double force_N;   // along the normal
};

// Part of each node's area that presses.
inline std::vector<double> bearing(
    const ContactSurface& surface, const std::vector<PressedPoint>& pressed, const SurfaceNodes& nodes) {
  std::vector<double> part(nodes.size(), 0.0);
  for (const PressedPoint& p : pressed) {
    const std::array<int, 3> node = surface.sub_triangle(p.face, std::size_t(p.point->part));
    for (std::size_t k = 0; k < 3; ++k) part[nodes.at(node[k])] += p.point->area_m2 * p.point->hat[k];
  }
  for (std::size_t k = 0; k < part.size(); ++k)
    if (part[k] > 0.0) part[k] /= nodes.area[k];
  return part;
}

// Adds area, rim and the nodes' spacing along it.
inline void measure_spots(const SurfaceNodes& nodes, const ContactEdge& edge, std::vector<ContactSpot>& spots) {
  for (const std::array<int, 3>& t : nodes.triangles) {
    std::array<Vec3d, 3> place;
    std::array<double, 3> field;
    double spacing = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t node = std::size_t(t[k]);
      place[k] = nodes.place[node];
      field[k] = edge.field()[node];
      spacing += edge.spacing(node) / 3.0;
    }
    const RimCut cut = cut_at_rim(place, field);
    const int part = cut.area > 0.0 ? edge.part_of(t, cut.lone) : -1;
    if (part < 0) continue;
    ContactSpot& spot = spots[std::size_t(part)];
    spot.area_m2 += cut.area;
    spot.rim_m += cut.rim;
    spot.edge_m += cut.rim * spacing;
  }
}

// The separate contacts of an edge, those that press hardest first; what presses beside all of them is one, too.
inline std::vector<ContactSpot> contact_spots(const ContactSurface& surface, const std::vector<PressedPoint>& pressed,
    const SurfaceNodes& nodes, const ContactEdge& edge) {
  std::vector<ContactSpot> spots(edge.parts() + 1);
  measure_spots(nodes, edge, spots);
  std::vector<double> bearing_edge(spots.size(), 0.0);
  for (const PressedPoint& p : pressed) {
    const std::array<int, 3> node = surface.sub_triangle(p.face, std::size_t(p.point->part));
    double field = 0.0;
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      field += p.point->hat[k] * edge.field()[nodes.at(node[k])];
      if (p.point->hat[k] > p.point->hat[nearest]) nearest = k;
    }
    const std::size_t at = nodes.at(node[nearest]);
    const std::size_t part = edge.part_of_node(at) >= 0 ? std::size_t(edge.part_of_node(at)) : edge.parts();
    ContactSpot& spot = spots[part];
    spot.force_N += p.force_N;
    spot.reference_m += p.force_N * p.reference;
    bearing_edge[part] += p.force_N * edge.spacing(at);
    if (!(field > 0.0)) spot.force_outside_N += p.force_N;
  }
  for (std::size_t k = 0; k < spots.size(); ++k) {
    ContactSpot& s = spots[k];
    if (!(s.force_N > 0.0)) continue;
    s.reference_m /= s.force_N;
    s.edge_m = s.rim_m > 0.0 ? s.edge_m / s.rim_m : bearing_edge[k] / s.force_N;
  }
  std::erase_if(spots, [](const ContactSpot& s) { return !(s.force_N > 0.0); });
  std::stable_sort(
      spots.begin(), spots.end(), [](const ContactSpot& a, const ContactSpot& b) { return a.force_N > b.force_N; });
  return spots;
}

}  // namespace lumo::detail

#endif

// ---- lumo/mechanics/contact/contact_set.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_SET_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_CONTACT_SET_HPP

namespace lumo {

/// Contact field and pressure per mesh node; see MechanicalState.
struct ContactField {
  std::vector<double> field;  ///< > 0 in contact
  std::vector<double> pressure_Pa;
  std::vector<ContactSlope> slopes;
  std::vector<ContactSpot> spots;  ///< those that press hardest first
};

/// Reference area of the intersection and of the union of two contact sets [m²].
struct SetOverlap {
  double both = 0.0;
  double either = 0.0;
  /// Intersection over union; 1 for two empty sets.
  double ratio() const { return either > 0.0 ? both / either : 1.0; }
};

/// Signed distance φ [m] to the edge of contact, > 0 inside, at the surface's nodes (see detail::ContactEdge), the
/// pressure lumped there, and how the surface leans away from the rigid thing.
template <ContactHandler Contact, class Tool> ContactField contact_field(const TetMesh& mesh,
    const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x);

/// How a surface leans away from what it rests on: where it touches, it lies on that; beyond, its slopes are too small
/// for a law of the gap to be better than the faces themselves.
template <class Tool> std::vector<ContactSlope> resting_slopes(
    const TetMesh& mesh, const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x);

/// Area of {φ > 0} on the given node positions: undeformed ones give A_0(C), deformed ones A(C; X) [m²].
template <class S> S contact_area(const ContactSurface& surface, const std::vector<S>& field, const Positions& x);

/// Overlap of {φ_a > 0} and {φ_b > 0}, measured on the given node positions.
inline SetOverlap contact_overlap(
    const ContactSurface& surface, const std::vector<double>& a, const std::vector<double>& b, const Positions& x);

/// The sub-triangles of which a point comes nearer than `margin_m` to the tool, one entry each: what a collision
/// pipeline with that margin has records of (a record of a vertex or an edge brings all triangles about it). It grows
/// with the size of the triangles.
template <class Tool> std::vector<char> recorded_triangles(
    const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x, double margin_m);

/// Area of the recorded sub-triangles on the given node positions [m²].
inline double recorded_area(const ContactSurface& surface, const std::vector<char>& recorded, const Positions& x);

/// Overlap of two such sets, measured on the given node positions.
inline SetOverlap recorded_overlap(
    const ContactSurface& surface, const std::vector<char>& a, const std::vector<char>& b, const Positions& x);

namespace detail {

// A convex polygon in the barycentric plane of a triangle, with the values of the fields at its corners.
template <class S> struct ClipPolygon {
  struct Corner {
    S u, v;
    std::array<S, 2> field;
  };
  std::vector<Corner> corners;

  /// The whole triangle.
  ClipPolygon(const std::array<S, 2>& a, const std::array<S, 2>& b, const std::array<S, 2>& c)
      : corners{{0.0, 0.0, a}, {1.0, 0.0, b}, {0.0, 1.0, c}} {}

  /// Keeps the part where field `k` is positive (Sutherland and Hodgman 1974).
  void clip(std::size_t k) {
    std::vector<Corner> kept;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Corner &a = corners[i], &b = corners[(i + 1) % corners.size()];
      if (a.field[k] > 0.0) kept.push_back(a);
      if ((a.field[k] > 0.0) != (b.field[k] > 0.0)) {
        const S t = a.field[k] / (a.field[k] - b.field[k]);
        kept.push_back({a.u + t * (b.u - a.u), a.v + t * (b.v - a.v),
            {a.field[0] + t * (b.field[0] - a.field[0]), a.field[1] + t * (b.field[1] - a.field[1])}});
      }
    }
    corners = std::move(kept);
  }
  /// Part of the triangle's area that it covers.
  S fraction() const {
    using std::abs;
    S twice = 0.0;
    for (std::size_t i = 1; i + 1 < corners.size(); ++i)
      twice += (corners[i].u - corners[0].u) * (corners[i + 1].v - corners[0].v) -
               (corners[i + 1].u - corners[0].u) * (corners[i].v - corners[0].v);
    return abs(twice);
  }
};

}  // namespace detail

template <ContactHandler Contact, class Tool> ContactField contact_field(const TetMesh& mesh,
    const ContactSurface& surface, const Contact& contact, const Moving<Tool>& rigid, const Positions& x) {
  const std::size_t n = mesh.nodes.size();
  ContactField c{std::vector<double>(n, -std::numeric_limits<double>::infinity()), std::vector<double>(n, 0.0),
      std::vector<ContactSlope>(n), {}};
  double overlap = 0.0;
  const Positions undeformed = positions_of(mesh);
  std::vector<detail::PressedPoint> pressed;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const Vec3d at = surface.position(f, p, x);
      const double g = rigid.distance(at), pressure = contact.respond(g).pressure;
      overlap = std::max(overlap, -g);
      const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
      for (std::size_t k = 0; k < 3; ++k) c.pressure_Pa[std::size_t(node[k])] += p.weight_m2 * p.hat[k] * pressure;
      if (pressure > 0.0) pressed.push_back({f, &p, surface.position(f, p, undeformed), p.weight_m2 * pressure});
    }
  const detail::SurfaceNodes nodes = detail::nodes_beside(surface, rigid, x);
  // Nodes that hang free by less than the overlap at other points of their facets are in contact.
  const detail::ContactEdge edge(nodes, detail::bearing(surface, pressed, nodes), 2.0 * overlap);
  const std::vector<ContactSlope> slopes = edge.slopes();
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const std::size_t node = std::size_t(nodes.mesh_node[k]);
    if (nodes.area[k] > 0.0) c.pressure_Pa[node] /= nodes.area[k];
    c.field[node] = edge.field()[k];
    c.slopes[node] = slopes[k];
  }
  c.spots = detail::contact_spots(surface, pressed, nodes, edge);
  return c;
}

template <class Tool> std::vector<ContactSlope> resting_slopes(
    const TetMesh& mesh, const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x) {
  std::vector<ContactSlope> slopes(mesh.nodes.size());
  std::vector<char> seen(mesh.nodes.size(), 0);
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (std::size_t k = 0; k < std::size_t(surface.nodes_per_face()); ++k) {
      const std::size_t node = std::size_t(surface.face(f).nodes[k]);
      if (std::exchange(seen[node], char(1))) continue;
      const DistanceSample d = rigid.sample(x.col(Eigen::Index(node)));
      if (d.distance < std::numeric_limits<double>::infinity())
        slopes[node] = {.normal = -d.gradient, .weight = d.distance <= 0.0 ? 1.0 : 0.0};
    }
  return slopes;
}

inline SetOverlap contact_overlap(
    const ContactSurface& surface, const std::vector<double>& a, const std::vector<double>& b, const Positions& x) {
  SetOverlap sum;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    const auto at = [&](std::size_t k) {
      return std::array<double, 2>{a[std::size_t(node[k])], b[std::size_t(node[k])]};
    };
    const detail::ClipPolygon<double> whole(at(0), at(1), at(2));
    detail::ClipPolygon<double> in_a = whole, in_b = whole;
    in_a.clip(0);
    in_b.clip(1);
    detail::ClipPolygon<double> in_both = in_a;
    in_both.clip(1);
    const double both = in_both.fraction();
    sum.both += area * both;
    sum.either += area * (in_a.fraction() + in_b.fraction() - both);
  });
  return sum;
}

template <class Tool> std::vector<char> recorded_triangles(
    const ContactSurface& surface, const Moving<Tool>& rigid, const Positions& x, double margin_m) {
  std::vector<char> recorded;
  detail::for_sub_triangles(surface, x, [&](double, const std::array<int, 3>& node) {
    const Vec3d a = x.col(node[0]), b = x.col(node[1]) - a, c = x.col(node[2]) - a;
    // On a lattice of points; what lies between them is nearer by little: 1 µm for edges of 1 mm on a 10 mm sphere.
    constexpr int cuts = 8;
    const auto comes_near = [&] {
      if (rigid.distance(a + (b + c) / 3.0) > margin_m + std::max({b.norm(), c.norm(), (c - b).norm()})) return false;
      for (int i = 0; i <= cuts; ++i)
        for (int j = 0; i + j <= cuts; ++j)
          if (rigid.distance(a + double(i) / cuts * b + double(j) / cuts * c) < margin_m) return true;
      return false;
    };
    recorded.push_back(char(comes_near()));
  });
  return recorded;
}

inline double recorded_area(const ContactSurface& surface, const std::vector<char>& recorded, const Positions& x) {
  return recorded_overlap(surface, recorded, recorded, x).both;
}

inline SetOverlap recorded_overlap(
    const ContactSurface& surface, const std::vector<char>& a, const std::vector<char>& b, const Positions& x) {
  SetOverlap sum;
  std::size_t k = 0;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>&) {
    if (a[k] && b[k]) sum.both += area;
    if (a[k] || b[k]) sum.either += area;
    ++k;
  });
  return sum;
}

template <class S> S contact_area(const ContactSurface& surface, const std::vector<S>& field, const Positions& x) {
  S sum = 0.0;
  detail::for_sub_triangles(surface, x, [&](double area, const std::array<int, 3>& node) {
    const auto at = [&](std::size_t k) {
      const S& f = field[std::size_t(node[k])];
      return std::array<S, 2>{f, f};
    };
    detail::ClipPolygon<S> inside(at(0), at(1), at(2));
    inside.clip(0);
    inside.clip(1);  // once more, as an overlap of the field with itself
    sum += area * inside.fraction();
  });
  return sum;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/preconditions.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_PRECONDITIONS_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_PRECONDITIONS_HPP

namespace lumo {

/// Throws InvalidArgument for a body that no bonded patch and no carrier holds. Patches must be the body's.
inline void require_held(const Body& body, const TetMesh& mesh) {
  for (const BoundaryFace& f : mesh.faces) {
    const Patch& patch = body.patches[std::size_t(f.patch)];
    if (patch.bonded || (patch.meets_carrier && !body.carrier.empty())) return;
  }
  throw InvalidArgument("no patch is bonded: the body can move as a whole");
}

/// Throws InvalidArgument if the tool, where it first touches, has already run into nodes of a patch that it may not
/// touch: contact there is not computed, so that it would go through.
template <Indenter Tool>
void require_free_way(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, const Touch& touch) {
  constexpr double precision = 1e-6;  // of the body's size, as of its surface
  double size = 0.0, least = 0.0;
  int met = -1;
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < std::size_t(mesh.nodes_per_face()); ++k) {
      const Vec3d& p = mesh.nodes[std::size_t(f.nodes[k])];
      size = std::max(size, p.lpNorm<Eigen::Infinity>());
      if (body.patches[std::size_t(f.patch)].contactable) continue;
      const double gap = scenario.indenter.distance(Vec3d(p - touch.origin));
      if (gap >= least) continue;
      least = gap;
      met = f.patch;
    }
  if (least >= -precision * size) return;
  throw InvalidArgument(
      message(detail::approach(scenario), " meets patch \"", printable(body.patches[std::size_t(met)].name),
          "\", which may not be touched, ", -1e3 * least, " mm deep when it first touches the body"));
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/traction.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_TRACTION_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_TRACTION_HPP

namespace lumo {

/// What the tool does to the deformed surface, at the points of its quadrature and on the mesh's nodes.
struct Tractions {
  std::vector<TractionPoint> points;  ///< where it presses or rubs
  std::vector<Vec3d> on_nodes;        ///< [Pa], per mesh node; see MechanicalState::traction_Pa
};

/// Tractions on `surface` at the places `x` of the mesh's nodes; `friction_N`: of the tool, per mesh node, may be
/// empty.
template <ContactHandler Contact, class Tool> Tractions tractions_of(const TetMesh& mesh, const ContactSurface& surface,
    const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const std::vector<Vec3d>& friction_N);

namespace detail {

// Area of the deformed surface about a point over that of the undeformed one.
inline double stretch(const TetMesh& mesh, const BoundaryFace& face, const SurfacePoint& p, const Positions& x) {
  const double u = p.shape[1] + 0.5 * (p.shape[3] + p.shape[4]), v = p.shape[2] + 0.5 * (p.shape[4] + p.shape[5]);
  return face_jacobian(mesh, face, u, v, [&](int node) { return Vec3d(x.col(node)); }) /
         face_jacobian(mesh, face, u, v, [&](int node) -> const Vec3d& { return mesh.nodes[std::size_t(node)]; });
}

}  // namespace detail

template <ContactHandler Contact, class Tool> Tractions tractions_of(const TetMesh& mesh, const ContactSurface& surface,
    const Contact& contact, const Moving<Tool>& rigid, const Positions& x, const std::vector<Vec3d>& friction_N) {
  const auto force_at = [&](const SurfacePoint& p, const Vec3d& at) -> Vec3d {
    const DistanceSample d = rigid.sample(at);
    return p.weight_m2 * contact.respond(d.distance).pressure * d.gradient;
  };
  const auto is_rubbed = [&](std::size_t n) { return !friction_N.empty() && !friction_N[n].isZero(0.0); };
  Tractions all;
  all.on_nodes.assign(mesh.nodes.size(), Vec3d::Zero());
  detail::for_contact_points(
      surface, x, rigid, nullptr, [&](std::size_t f, std::size_t, const SurfacePoint& p, const Vec3d& at) {
        const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
        const Vec3d force = force_at(p, at);
        for (std::size_t k = 0; k < 3; ++k) all.on_nodes[std::size_t(node[k])] += p.hat[k] * force;
      });
  std::vector<double> area(mesh.nodes.size(), 0.0);
  std::vector<std::pair<std::array<int, 3>, const SurfacePoint*>> places;
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f)) {
      const std::array<int, 3> node = surface.sub_triangle(f, std::size_t(p.part));
      const auto any = [&](auto&& holds) {
        return std::any_of(node.begin(), node.end(), [&](int n) { return holds(std::size_t(n)); });
      };
      const bool rubbed = any(is_rubbed);
      if (!rubbed && !any([&](std::size_t n) { return !all.on_nodes[n].isZero(0.0); })) continue;
      TractionPoint point;
      point.reference_m = p.reference;
      point.place_m = surface.position(f, p, x);
      point.area_m2 = p.area_m2 * detail::stretch(mesh, surface.face(f), p, x);
      for (std::size_t k = 0; k < 3; ++k) area[std::size_t(node[k])] += p.hat[k] * point.area_m2;
      const Vec3d force = force_at(p, point.place_m);
      if ((!rubbed && force.isZero(0.0)) || !(point.area_m2 > 0.0)) continue;
      point.traction_Pa = force / point.area_m2;
      point.pressure_Pa = point.traction_Pa.norm();
      all.points.push_back(point);
      places.emplace_back(node, &p);
    }
  for (std::size_t n = 0; n < area.size(); ++n) {
    if (!(area[n] > 0.0)) continue;
    if (is_rubbed(n)) all.on_nodes[n] += friction_N[n];
    all.on_nodes[n] /= area[n];
  }
  // Friction is known by its nodes; the points share it as the field does.
  for (std::size_t i = 0; i < places.size() && !friction_N.empty(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t n = std::size_t(places[i].first[k]);
      all.points[i].traction_Pa += places[i].second->hat[k] / area[n] * friction_N[n];
    }
  return all;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/elements/energy_error.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_ENERGY_ERROR_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_ELEMENTS_ENERGY_ERROR_HPP

namespace lumo {

/// How far a mesh is from resolving the stresses on it: in an element they are polynomials, and jump to the next one's.
/// Stresses of distortion are carried to the nodes, averaged there, and compared with themselves. Their difference, as
/// a part of their energy, is the part of the energy, and of a depth or stiffness, that a finer mesh would change.
/// Source: Zienkiewicz, Zhu 1987, doi:10.1002/nme.1620240206.
template <HyperelasticMaterial Material, TetElement Element> class EnergyError {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  EnergyError(const TetMesh& mesh, const Material& material) : mesh_(&mesh), material_(material), points_(mesh) {}

  /// Relative; +∞ where the state is not finite or an element is inverted.
  double operator()(const Positions& x) const {
    const std::size_t tets = mesh_->tets.size(), n = mesh_->nodes.size();
    std::vector<std::array<Mat3d, points>> stress(tets);
    std::vector<Mat3d> mean(n, Mat3d::Zero());
    std::vector<double> volume(n, 0.0);
    for (std::size_t e = 0; e < tets; ++e) {
      double whole = 0.0;
      for (std::size_t q = 0; q < points; ++q) {
        stress[e][q] = material_.distortion_stress(deformation(e, q, x));
        whole += points_.weight(e, int(q));
      }
      for (std::size_t a = 0; a < nodes; ++a) {
        const std::size_t node = std::size_t(mesh_->tets[e][a]);
        for (std::size_t q = 0; q < points; ++q)
          mean[node] += whole * to_nodes_(Eigen::Index(a), Eigen::Index(q)) * stress[e][q];
        volume[node] += whole;
      }
    }
    for (std::size_t k = 0; k < n; ++k)
      if (volume[k] > 0.0) mean[k] /= volume[k];
    const double rounding = std::pow(1e-12 * material_.shear_modulus(), 2);
    double jumps = 0.0, all = 0.0, rest = 0.0;
    for (std::size_t e = 0; e < tets; ++e)
      for (std::size_t q = 0; q < points; ++q) {
        Mat3d smooth = Mat3d::Zero();
        for (std::size_t a = 0; a < nodes; ++a)
          smooth += from_nodes_(Eigen::Index(q), Eigen::Index(a)) * mean[std::size_t(mesh_->tets[e][a])];
        jumps += points_.weight(e, int(q)) * (smooth - stress[e][q]).squaredNorm();
        all += points_.weight(e, int(q)) * stress[e][q].squaredNorm();
        rest += points_.weight(e, int(q)) * rounding;
      }
    if (all <= rest) return 0.0;
    return std::isfinite(jumps / all) ? jumps / all : std::numeric_limits<double>::infinity();
  }

 private:
  static constexpr std::size_t nodes = std::size_t(Element::nodes), points = std::size_t(Element::points);
  using ToNodes = Eigen::Matrix<double, Element::nodes, Element::points>;
  using FromNodes = Eigen::Matrix<double, Element::points, Element::nodes>;

  // Barycentric coordinates of a quadrature point, or of a node.
  static std::array<double, 4> corners_of_point(int q) {
    const Vec3d p = Element::place(q);
    return {1.0 - p.sum(), p.x(), p.y(), p.z()};
  }
  static std::array<double, 4> corners_of_node(int a) {
    std::array<double, 4> l = {};
    if (a < 4) l[std::size_t(a)] = 1.0;
    else
      for (const int k : tet_edges[a - 4]) l[std::size_t(k)] = 0.5;
    return l;
  }
  // The element's own polynomial at its nodes: constant by one point, linear through (or among) more.
  static ToNodes to_nodes() {
    if constexpr (Element::points == 1) return ToNodes::Ones();
    Eigen::Matrix<double, Element::points, 4> at;
    for (int q = 0; q < Element::points; ++q)
      for (int k = 0; k < 4; ++k) at(q, k) = corners_of_point(q)[std::size_t(k)];
    const Eigen::Matrix<double, 4, 4> normal = at.transpose() * at;
    const Eigen::Matrix<double, 4, Element::points> corner = normal.inverse() * at.transpose();
    ToNodes all = ToNodes::Zero();
    for (int a = 0; a < Element::nodes; ++a)
      for (int k = 0; k < 4; ++k) all.row(a) += corners_of_node(a)[std::size_t(k)] * corner.row(k);
    return all;
  }
  // Lagrange's shape functions at the quadrature points.
  static FromNodes from_nodes() {
    FromNodes all;
    for (int q = 0; q < Element::points; ++q) {
      const std::array<double, 4> l = corners_of_point(q);
      for (int a = 0; a < Element::nodes; ++a) {
        if (a >= 4) all(q, a) = 4.0 * l[std::size_t(tet_edges[a - 4][0])] * l[std::size_t(tet_edges[a - 4][1])];
        else all(q, a) = l[std::size_t(a)] * (Element::nodes == 4 ? 1.0 : 2.0 * l[std::size_t(a)] - 1.0);
      }
    }
    return all;
  }

  Mat3d deformation(std::size_t e, std::size_t q, const Positions& x) const {
    const auto& g = points_.gradient(e, int(q));
    Mat3d F = Mat3d::Zero();
    for (std::size_t a = 0; a < nodes; ++a)
      for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i) F(i, j) += x(i, mesh_->tets[e][a]) * g(j, Eigen::Index(a));
    return F;
  }

  const TetMesh* mesh_;
  Material material_;
  ElementPoints<Element> points_;
  ToNodes to_nodes_ = to_nodes();
  FromNodes from_nodes_ = from_nodes();
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/solvers/press_system.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_PRESS_SYSTEM_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_PRESS_SYSTEM_HPP

namespace lumo {

/// All that does not change between scenarios on one sector of one mesh: elements, surfaces, equations, symbolic
/// factors.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, LinearSolver Linear>
struct SectorModel {
  Sector sector;
  Body body;
  Contact contact;
  Solid<Material, Element> solid;
  ContactSurface touchable;  ///< against the indenter
  ContactSurface resting;    ///< against the carrier
  Carrier carrier;

  /// Equations of one parity with the symbolic factorisation of their tangent.
  struct Block {
    Equations equations;
    Linear analysed;
  };
  std::vector<Block> blocks;  ///< first the even fields, then every other parity of the bounding planes

  SectorModel(
      const Body& b, const TetMesh& mesh, Symmetry planes, const PressPhysics<Material, Contact, Element>& physics)
      : sector(sector_of(mesh, planes)),
        body(b),
        contact(physics.contact),
        solid(sector.mesh, physics.material, physics.element),
        touchable(
            sector.mesh, b, [](const Patch& p) { return p.contactable; }, contact),
        resting(
            sector.mesh, b, [](const Patch& p) { return p.meets_carrier; }, contact),
        carrier{b.carrier} {
    blocks.reserve(4);
    for (int odd = 0; odd < 4; ++odd) {
      const Parity parity{(odd & 1) != 0, (odd & 2) != 0};
      if ((parity.odd_x && !planes.x) || (parity.odd_y && !planes.y)) continue;
      Block block{Equations(sector, body, parity), Linear{}};
      block.analysed.analyze(block.equations.pattern);
      blocks.push_back(std::move(block));
    }
  }
  SectorModel(const SectorModel&) = delete;  // the solid and the surfaces point into the sector's mesh
  SectorModel& operator=(const SectorModel&) = delete;
};

/// One scenario on one sector: energy, forces and tangent of pad and indenter as functions of positions x and advance
/// s. Loads are the sector's share of the whole load.
template <class Model, Indenter Tool> struct PressSystem {
  const Model& model;
  const Tool& tool;
  Vec3d origin;  ///< of the indenter at first touch
  Vec3d direction;
  double penalty_scale = 1.0;                       ///< of all contact pressures; 1 but on the way to equilibrium
  const FrictionHistory* touch_friction = nullptr;  ///< with the indenter
  const FrictionHistory* rest_friction = nullptr;   ///< with the carrier

  ScaledContact<decltype(Model::contact)> contact() const { return {&model.contact, penalty_scale}; }
  Moving<Tool> indenter(double advance) const { return {&tool, origin + advance * direction, direction}; }
  Moving<Carrier> support() const { return {&model.carrier, Vec3d::Zero(), Vec3d::Zero()}; }  ///< stands still

  /// Elastic + contact energy − load · advance [J]; +∞ for an inverted element.
  double energy(const Positions& x, double advance, double load) const {
    const double elastic = model.solid.energy(x);
    if (!std::isfinite(elastic)) return elastic;
    return elastic + add_contact_forces(model.touchable, contact(), indenter(advance), x, nullptr).energy +
           add_contact_forces(model.resting, contact(), support(), x, nullptr).energy - load * advance;
  }

  /// What the stiff parts of the energy, volume and contact, are linearised about; see QuasiStatic.
  struct LinearisationPoint {
    std::vector<double> ratios;
    SurfaceGaps touch, rest;
    /// Share of the carrier's curvature where it touches. What its rounded edges add to the tangent is negative, and
    /// large where pressure is.
    double curvature = 1.0;
  };
  ContactHistory<FrictionHistory> touch_history(const LinearisationPoint* about) const {
    return {about ? &about->touch : nullptr, touch_friction};
  }
  ContactHistory<FrictionHistory> rest_history(const LinearisationPoint* about) const {
    return {about ? &about->rest : nullptr, rest_friction};
  }
  /// A configuration of pad and indenter.
  struct Place {
    Positions x;
    double advance = 0.0;
    VolumeRatios volumes = {};  ///< at x
  };
  /// The values at `now`.
  LinearisationPoint values_at(const Place& now) const {
    return {now.volumes.J, surface_gaps(model.touchable, indenter(now.advance), now.x),
        surface_gaps(model.resting, support(), now.x)};
  }
  /// Those at `now`, carried on by (dx, ds) along the slopes at `linear`; of gaps that stay open only the sign.
  LinearisationPoint predicted(const Place& now, const Place& linear, const Positions& dx, double ds) const {
    using Touching = ContactPlace<Tool>;
    using Resting = ContactPlace<Carrier>;
    LinearisationPoint values{now.volumes.J,
        predicted_gaps(model.touchable, Touching{indenter(now.advance), now.x},
            Touching{indenter(linear.advance), linear.x}, dx, ds),
        predicted_gaps(model.resting, Resting{support(), now.x}, Resting{support(), linear.x}, dx, 0.0)};
    model.solid.carry_on(values.ratios, linear.x, dx);
    return values;
  }

  /// Out-of-balance forces on the free equations and, last, on the indenter: push − load.
  Eigen::VectorXd residual(const Positions& x, double advance, double load, const Equations& eq,
      const LinearisationPoint* about = nullptr) const {
    Positions f = Positions::Zero(3, x.cols());
    model.solid.add_forces(x, f, about ? &about->ratios : nullptr);
    const ContactSums touch =
        add_contact_forces(model.touchable, contact(), indenter(advance), x, &f, touch_history(about));
    add_contact_forces(model.resting, contact(), support(), x, &f, rest_history(about));
    Eigen::VectorXd r(eq.count + 1);
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) r[eq.of[i]] = f.data()[i];
    r[eq.count] = touch.push_N - load;
    return r;
  }

  /// Tangents of several parities at once, the coupling of the even one to the advance, and the indenter's own
  /// stiffness.
  struct Tangent {
    std::vector<SparseLower> matrix;  ///< one per block asked for
    Eigen::VectorXd coupling;
    double stiffness = 0.0;
  };
  void tangent(const Positions& x, double advance, std::size_t first, std::size_t last, Tangent& t,
      const LinearisationPoint* about = nullptr) const {
    t.matrix.resize(last - first);
    std::vector<const Equations*> systems;
    std::vector<double*> values;
    for (std::size_t b = first; b < last; ++b) {
      const Equations& eq = model.blocks[b].equations;
      SparseLower& m = t.matrix[b - first];
      if (m.nonZeros() != eq.pattern.nonZeros()) m = eq.pattern;
      std::fill_n(m.valuePtr(), m.nonZeros(), 0.0);
      systems.push_back(&eq);
      values.push_back(m.valuePtr());
    }
    model.solid.add_tangent(x, systems, values, about ? &about->ratios : nullptr);
    for (std::size_t k = 0; k < systems.size(); ++k) {
      const bool even = first + k == 0;
      if (even) t.coupling = Eigen::VectorXd::Zero(systems[k]->count);
      const ContactSums s = add_contact_tangent(model.touchable, contact(), indenter(advance), x,
          {*systems[k], values[k], even ? &t.coupling : nullptr}, touch_history(about));
      if (even) t.stiffness = s.push_stiffness;
      add_contact_tangent(model.resting, contact(), support(), x,
          {*systems[k], values[k], nullptr, about ? about->curvature : 1.0}, rest_history(about));
    }
  }

  /// x moved by a field of the given equations.
  static void move(Positions& x, const Equations& eq, const Eigen::VectorXd& by, double factor) {
    for (std::size_t i = 0; i < eq.of.size(); ++i)
      if (eq.of[i] >= 0) x.data()[i] += factor * by[eq.of[i]];
  }
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/solvers/quasi_static.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_QUASI_STATIC_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_QUASI_STATIC_HPP

namespace lumo {

/// What the steps with a kept factor have shown of a symmetric, positive definite tangent since it was made: the BFGS
/// correction of the factor's inverse (Matthies, Strang 1979, doi:10.1002/nme.1620141104), applied by Nocedal's two
/// loops (1980, doi:10.1090/S0025-5718-1980-0572855-7).
class SecantPairs {
 public:
  void clear() { pairs_.clear(); }

  /// A step with the change of the residual that came with it; of equal sizes. Without effect where the residual did
  /// not grow along the step beyond rounding: the corrected inverse stays positive definite.
  void add(Eigen::VectorXd step, Eigen::VectorXd change) {
    const double curvature = step.dot(change);
    if (curvature > 1e-12 * step.norm() * change.norm())
      pairs_.push_back({std::move(step), std::move(change), 1.0 / curvature});
  }

  /// Solution of the corrected system, where `factor` is that of the kept one: a function of a vector.
  template <class Factor> Eigen::VectorXd solve(Eigen::VectorXd residual, Factor&& factor) const {
    std::vector<double> along(pairs_.size());
    for (std::size_t k = pairs_.size(); k-- > 0;) {
      along[k] = pairs_[k].scale * pairs_[k].step.dot(residual);
      residual -= along[k] * pairs_[k].change;
    }
    Eigen::VectorXd solution = factor(residual);
    for (std::size_t k = 0; k < pairs_.size(); ++k)
      solution += (along[k] - pairs_[k].scale * pairs_[k].change.dot(solution)) * pairs_[k].step;
    return solution;
  }

 private:
  struct Pair {
    Eigen::VectorXd step, change;
    double scale;  ///< 1 / (step · change)
  };
  std::vector<Pair> pairs_;
};

/// Settings of the quasi-static solver.
struct QuasiStaticConfig {
  double residual_tolerance = 1e-7;  ///< of the load
  int max_iterations = 200;          ///< factorisations per load
  int stride_iterations = 20;        ///< factorisations before a stride is cut; twice as many near its end
  double chord_contraction = 0.02;   ///< a kept factor must shrink the residual by this factor per step
  /// By this one, when the residual is below 1 % of the load: a step costs a tenth of a factor.
  double late_contraction = 0.8;
  double load_stride = 1.6;   ///< loads in between are at most this factor apart
  double max_advance = 0.2;   ///< largest advance in one step, in radii of the indenter's contact
  double time_limit_s = 1e9;  ///< per scenario, wall clock; a solve ends at most one factorisation later
  PressWatch watch = {};      ///< called after each factorisation, and as a load ends
};

/// Throws InvalidArgument for settings out of range.
inline void validate(const QuasiStaticConfig& c) {
  require_in_range("residual tolerance", c.residual_tolerance, 1e-12, 1e-6, "of the load");  // the certificate's limit
  require_in_range("iterations per load", c.max_iterations, 1, 1 << 20, "");
  require_in_range("iterations per stride", c.stride_iterations, 1, 1 << 20, "");
  require_in_range("contraction of a kept factor", c.chord_contraction, 0.0, 1.0, "");
  require_in_range("late contraction of a kept factor", c.late_contraction, 0.0, 1.0, "");
  require_in_range("stride of loads", c.load_stride, 1.001, 1e6, "");
  require_in_range("largest advance of a step", c.max_advance, 1e-6, 1e3, "radii");
  require_in_range("time limit of a scenario", c.time_limit_s, 0.0, 1e12, "s");
}

/// Static equilibrium at prescribed loads: the indenter's advance is an unknown, so that each load is met exactly
/// (model: solver policy "quasi-static"). Newton's method on energy(x, s) − F s, load by load along 0 → F₁ → F₂ ….
///
/// The stiff parts of the energy, volume change and contact, are linearised about values that are carried on *linearly*
/// by each step (volume ratios θ, gaps γ) instead of those that the moved nodes happen to have: a step's second-order
/// errors in volume then make no spurious pressure, the tangent stays positive definite, and contact points change
/// sides by what the step meant. This is Newton's method for the mixed problem with θ and γ eliminated; its solution is
/// that of the plain one (Magisano, Leonetti, Garcea 2017 for stresses; Hintermüller, Ito, Kunisch 2002 for contact). A
/// factor is used again, corrected by what its steps show (SecantPairs), as long as it contracts.
///
/// A set of contact points that is too large loses its rim ring by ring, one factorisation each. So every stride starts
/// from a good guess of it: the points with the smallest gaps on the area that Hertz's formula gives for the first
/// load, and on the last area × (load/last)^0.6 after that. Where the tangent is lost on the way, the load is
/// approached again from the last state that was reached closely, in smaller strides that end closer to equilibrium.
///
/// With friction the residual is that of Coulomb's law and the tangent leaves out how friction grows with pressure, so
/// that it stays symmetric: convergence is linear, and states depend on the strides that lead to them.
///
/// Rounded edges of the carrier are taken as flat where they touch until the residual is small: their curvature makes
/// the tangent indefinite on the way. After that as much of it counts as leaves the tangent positive definite: about an
/// equilibrium that is none that lasts, steps without it move away slowly.
///
/// At each load the unshifted tangent of the *whole* body must be positive definite, fields that break the scenario's
/// symmetry included; otherwise the status says so.
template <LinearSolver Linear = EigenCholesky> struct QuasiStatic {
  template <class Material, class Contact, class Element> using Model = SectorModel<Material, Contact, Element, Linear>;
  using Config = QuasiStaticConfig;
  static constexpr bool uses_symmetry = true;
  Config config = {};

  /// Throws InvalidArgument for settings out of range.
  template <class Material, class Contact, class Element>
  std::unique_ptr<Model<Material, Contact, Element>> model(const Body& body, const TetMesh& mesh, Symmetry planes,
      const PressPhysics<Material, Contact, Element>& physics) const {
    validate(config);
    return std::make_unique<Model<Material, Contact, Element>>(body, mesh, planes, physics);
  }

  /// States at the scenario's loads, displacements on the sector's nodes, up to the first that is not converged; its
  /// status is the reason.
  template <class SomeModel, Indenter Tool>
  std::vector<MechanicalState> run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

template <class Model, Indenter Tool> class QuasiStaticRun {
 public:
  QuasiStaticRun(
      const Model& model, const Scenario<Tool>& scenario, const Touch& touch, const QuasiStaticConfig& config)
      : config_(config),
        model_(model),
        system_{model, scenario.indenter, touch.origin, scenario.direction()},
        eq_(model.blocks.front().equations),
        now_{positions_of(model.sector.mesh), 0.0, model.solid.volume_ratios(positions_of(model.sector.mesh))},
        touched_(model.touchable, model.contact, friction_coefficient(model.contact), now_.x, system_.indenter(0.0)),
        rested_(model.resting, model.contact, carrier_friction(model.contact), now_.x, system_.support()) {
    linear_.reserve(model.blocks.size());
    for (const auto& block : model.blocks) linear_.push_back(block.analysed);
  }

  /// Equilibrium at `load` (the sector's share), from where the last call ended.
  Status solve(double load) {
    iterations = 0;
    wanted_ = load;
    if (load_ == 0.0 && !(model_.solid.smallest_volume() > 0.0)) return Status::inverted;
    auto state = std::tie(now_, touched_, rested_, load_);
    // The last one that was reached closely: a loose one may be what led astray.
    std::tuple<typename System::Place, FrictionHistory, FrictionHistory, double> reached = state;
    double first = std::min(load, largest_first_load()) * (has_friction() ? first_share : 1.0),
           stride = config_.load_stride;
    double on_the_way = has_friction() ? close : loose;  // friction remembers where strides end
    for (int cuts = 0; load_ != load;) {
      const double next = load_ == 0.0 ? first : stride_end(load, stride),
                   tolerance = next == load ? config_.residual_tolerance : on_the_way;
      const Status s = load_ == 0.0 ? first_load(next, tolerance)
                                    : load_step(next, tolerance, touched_area() * std::pow(next / load_, 0.6));
      if (s == Status::converged) {
        load_ = next;
        touched_.settle(model_.touchable, model_.contact, system_.indenter(now_.advance), now_.x);
        rested_.settle(model_.resting, model_.contact, system_.support(), now_.x);
        if (tolerance <= close) {
          reached = state;
          stride = std::min(config_.load_stride, std::pow(stride, 1.4));
        }
        continue;
      }
      if (!is_lost(s) || ++cuts > most_cuts || iterations >= config_.max_iterations) return s;
      state = reached;
      first /= 4.0;
      stride = std::sqrt(stride);
      on_the_way = close;
    }
    return certify_stability();
  }

  const Positions& positions() const { return now_.x; }
  double advance() const { return now_.advance; }
  /// Tells whoever watches how far this is, and how the load ended if it did.
  void report(std::optional<Status> ended) const {
    const double share = model_.sector.fraction();
    const std::optional<double> residual = std::isfinite(residual_) ? std::optional(residual_) : std::nullopt;
    if (config_.watch) config_.watch({wanted_ / share, load_ / share, now_.advance, iterations, residual, ended});
  }
  /// Friction on the sector's nodes as parts of the whole body's, and the whole's push against the advance.
  FrictionForces friction() const;
  int iterations = 0;

 private:
  using System = PressSystem<Model, Tool>;
  bool has_friction() const { return touched_.coefficient > 0.0 || rested_.coefficient > 0.0; }

  // Residual over load at which a stride on the way may end, at first and after a loss.
  static constexpr double loose = 0.3, close = 1e-3;
  // Share of the carrier's curvature below which none is tried.
  static constexpr double least_curvature = 0.2;
  // Residual over load below which points seldom come and go, or change between sticking and sliding.
  static constexpr double settled = 1e-2;
  // Of the first load. A contact that has grown at once has slipped another way than one that grew.
  static constexpr double first_share = 0.1;
  static constexpr int most_cuts = 8;  // of the strides to one load

  /// Hertz's load for a contact half as wide as the indenter, on a half-space that keeps its volume.
  double largest_first_load() const {
    return model_.sector.fraction() * model_.solid.material().shear_modulus() * 2.0 / 3.0 *
           std::pow(contact_radius(system_.tool), 2);
  }
  double hertz_area(double load) const {
    const double share = model_.sector.fraction(), whole = load / share;
    return share * pi *
           std::pow(3.0 * whole * contact_radius(system_.tool) / (16.0 * model_.solid.material().shear_modulus()),
               2.0 / 3.0);
  }

  /// Where the next of equal strides from load_ to `load` ends.
  double stride_end(double load, double stride) const {
    const double strides = std::ceil(std::abs(std::log(load / load_)) / std::log(stride) - 1e-9);
    return strides <= 1.0 ? load : load_ * std::pow(load / load_, 1.0 / strides);
  }

  /// Reference area of the points that overlap now.
  double touched_area() const {
    double area = 0.0;
    const auto tool = system_.indenter(now_.advance);
    for (std::size_t f = 0; f < model_.touchable.size(); ++f)
      for (const SurfacePoint& p : model_.touchable.points(f))
        if (tool.distance(model_.touchable.position(f, p, now_.x)) < 0.0) area += p.area_m2;
    return area;
  }

  // From first touch. A softer contact forgives a wrong guess of its extent.
  static constexpr double first_penalty_scale = 0.1;
  Status first_load(double load, double tolerance) {
    system_.penalty_scale = first_penalty_scale;
    const Status s = load_step(load, loose, hertz_area(load));
    if (touched_.coefficient > 0.0) system_.touch_friction = &touched_;
    if (rested_.coefficient > 0.0) system_.rest_friction = &rested_;
    const double softer = std::exchange(system_.penalty_scale, 1.0);
    return s == Status::converged ? load_step(load, tolerance, 0.0, softer) : s;
  }

  // Equilibrium at a load, from contact on at least `area`. Overlaps so far were those of a contact with `softer` times
  // the penalty stiffness; pressures are kept.
  Status load_step(double load, double tolerance, double area, double softer = 1.0) {
    auto about = system_.values_at(now_);
    for (SurfaceGaps* gaps : {&about.touch, &about.rest})
      for (std::vector<double>& face : *gaps)
        for (double& g : face) g = g < 0.0 ? softer * g : g;
    touch_nearest(about.touch, area);
    Eigen::VectorXd before;  // residual at the start of the last step; none before the first factor
    double curvature = 1.0;  // of the carrier's, near the end
    for (const int stop = iterations + config_.stride_iterations;;) {
      Eigen::VectorXd r = system_.residual(now_.x, now_.advance, load, eq_, &about);
      const double unbalanced = r.norm();
      const bool nearly_there = unbalanced < settled * load;
      if (!std::isfinite(unbalanced)) return Status::non_finite;
      residual_ = unbalanced / load;
      // The plain residual is what counts; it is looked at when the linearised one is small.
      if (unbalanced <= tolerance * load) {
        const double plain = system_.residual(now_.x, now_.advance, load, eq_).norm();
        residual_ = plain / load;
        if (plain <= tolerance * load) return Status::converged;
      }
      if (is_out_of_time()) return Status::time_limit;
      if (before.size() > 0 &&
          unbalanced <= (nearly_there ? config_.late_contraction : config_.chord_contraction) * before.norm()) {
        steps_.add(std::move(last_step_), r - before);
      } else {
        const int last = nearly_there ? stop + config_.stride_iterations : stop;
        if (iterations >= std::min(last, config_.max_iterations)) return Status::max_iterations;
        ++iterations;
        touched_.turning = rested_.turning = nearly_there ? 1.0 : 0.0;
        about.curvature = nearly_there ? curvature : 0.0;
        system_.tangent(now_.x, now_.advance, 0, 1, tangent_, &about);
        const FactorStatus f = linear_.front().factorize(tangent_.matrix.front());
        if (f == FactorStatus::not_positive_definite && about.curvature > 0.0) {
          curvature = curvature > least_curvature ? 0.5 * curvature : 0.0;
          continue;
        }
        if (f != FactorStatus::positive_definite)
          return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
        if (!schur_complement()) return Status::not_positive_definite;
        factored_ = now_;
        steps_.clear();
        report({});
      }
      if (const Status s = step(r, about); s != Status::converged) return s;
      before = std::move(r);
    }
  }

  // Points that have just come into contact overlap, or gape, by the error of the last step. The next step undoes it;
  // it must not enter the tangent as pressure.
  static constexpr double just_touching = -1e-15;
  static void enter(SurfaceGaps& gaps, const SurfaceGaps& before) {
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k)
        if (gaps[f][k] < 0.0 && before[f][k] >= 0.0) gaps[f][k] = just_touching;
  }

  // Brings the points with the smallest gaps into contact until `area` [m²] is.
  void touch_nearest(SurfaceGaps& gaps, double area) const {
    struct Point {
      double gap, area_m2;
      auto operator<=>(const Point&) const = default;
    };
    std::vector<Point> points;
    for (std::size_t f = 0; f < gaps.size(); ++f)
      for (std::size_t k = 0; k < gaps[f].size(); ++k)
        points.push_back({gaps[f][k], model_.touchable.points(f)[k].area_m2});
    std::sort(points.begin(), points.end());
    double last = 0.0;
    for (std::size_t k = 0; k < points.size() && area > 0.0; ++k) {
      area -= points[k].area_m2;
      last = points[k].gap;
    }
    for (std::vector<double>& face : gaps)
      for (double& g : face)
        if (g >= 0.0 && g <= last) g = just_touching;
  }

  bool schur_complement() {
    response_ = roughly_solved(tangent_.coupling);
    schur_ = tangent_.stiffness - tangent_.coupling.dot(response_);
    return std::isfinite(schur_) && schur_ > 0.0;
  }

  // To the digits that a step needs, which is of a linearisation.
  Eigen::VectorXd roughly_solved(const Eigen::VectorXd& r) {
    if constexpr (RefiningSolver<Linear>) return linear_.front().precondition(r);
    else return linear_.front().solve(r);
  }

  // Solution with the last factor for all equations, the advance's included.
  Eigen::VectorXd solve_factored(const Eigen::VectorXd& r) {
    Eigen::VectorXd d(r.size());
    const Eigen::VectorXd z = roughly_solved(r.head(eq_.count));
    d[eq_.count] = (r[eq_.count] - tangent_.coupling.dot(z)) / schur_;
    d.head(eq_.count) = z - d[eq_.count] * response_;
    return d;
  }

  // A full step unless the indenter would jump, an element would be turned inside out, or lose most of the volume that
  // is predicted for it. The status names what refuses even the shortest step.
  static constexpr double least_volume = 0.2;  // of an element: of its present one, and by the prediction
  static constexpr int halvings = 20;
  Status step(const Eigen::VectorXd& r, typename System::LinearisationPoint& about) {
    const Eigen::VectorXd d = -steps_.solve(r, [&](const Eigen::VectorXd& rest) { return solve_factored(rest); });
    if (!d.allFinite()) return Status::non_finite;
    const double ds = d[eq_.count];
    double t = std::min(1.0, config_.max_advance * contact_radius(system_.tool) / std::max(std::abs(ds), 1e-300));
    Positions dx = Positions::Zero(3, now_.x.cols());
    System::move(dx, eq_, d, 1.0);
    Status refusal = Status::inverted;
    for (int k = 0; k < halvings; ++k, t *= 0.5) {
      typename System::Place trial{now_.x + t * dx, now_.advance + t * ds};
      trial.volumes = model_.solid.volume_ratios(trial.x);
      refusal = Status::inverted;
      if (!(trial.volumes.smallest > least_volume * now_.volumes.smallest)) continue;
      refusal = Status::line_search;
      auto next = system_.predicted(now_, factored_, t * dx, t * ds);
      if (!(*std::min_element(next.ratios.begin(), next.ratios.end()) > least_volume)) continue;
      enter(next.touch, about.touch);
      enter(next.rest, about.rest);
      about = std::move(next);
      now_ = std::move(trial);
      last_step_ = t * d;
      return Status::converged;
    }
    return refusal;
  }

  bool is_out_of_time() const { return watch_.seconds() > config_.time_limit_s; }

  // Tangents of all parities at the state that was reached.
  Status certify_stability() {
    if (is_out_of_time()) return Status::time_limit;
    typename System::Tangent t;
    system_.tangent(now_.x, now_.advance, 0, model_.blocks.size(), t);
    for (std::size_t b = 0; b < model_.blocks.size(); ++b) {
      if (is_out_of_time()) return Status::time_limit;
      FactorStatus f = linear_[b].factorize(t.matrix[b]);
      if constexpr (RefiningSolver<Linear>)
        if (f == FactorStatus::positive_definite) f = linear_[b].certify();
      if (f != FactorStatus::positive_definite)
        return f == FactorStatus::non_finite ? Status::non_finite : Status::not_positive_definite;
      if (b > 0) continue;  // the advance moves with the even fields only
      const double stiffness = t.stiffness - t.coupling.dot(Eigen::VectorXd(linear_[b].solve(t.coupling)));
      if (!(stiffness > 0.0)) return std::isfinite(stiffness) ? Status::not_positive_definite : Status::non_finite;
    }
    return Status::converged;
  }

  QuasiStaticConfig config_;
  const Model& model_;
  System system_;
  const Equations& eq_;
  using Linear = std::decay_t<decltype(std::declval<Model>().blocks.front().analysed)>;
  std::vector<Linear> linear_;             // by parity; the first one's factor is that of the steps
  typename System::Place now_, factored_;  // where we are, and where the factor was made
  FrictionHistory touched_, rested_;       // at the end of the last stride
  Stopwatch watch_;
  typename System::Tangent tangent_;
  Eigen::VectorXd response_;  // K⁻¹ k
  double schur_ = 0.0;
  SecantPairs steps_;  // with that factor
  Eigen::VectorXd last_step_;
  double wanted_ = 0.0, load_ = 0.0;  // where the strides lead, and the last load that was reached
  double residual_ = 0.0;             // of the last step, over its load
};

template <class Model, Indenter Tool> FrictionForces QuasiStaticRun<Model, Tool>::friction() const {
  FrictionForces out;
  if (!has_friction()) return out;
  const Sector& sector = model_.sector;
  out.on_nodes.assign(sector.mesh.nodes.size(), Vec3d::Zero());
  rested_.add_nodal_forces(model_.resting, model_.contact, system_.support(), now_.x, out.on_nodes);
  out.push_N =
      touched_.add_nodal_forces(model_.touchable, model_.contact, system_.indenter(now_.advance), now_.x, out.on_nodes)
          .dot(system_.direction) /
      sector.fraction();
  for (std::size_t k = 0; k < out.on_nodes.size(); ++k)  // nodes in a bounding plane have as much on the other side
    for (int axis = 0; axis < 2; ++axis)
      if ((axis == 0 ? sector.planes.x : sector.planes.y) && sector.mesh.nodes[k][axis] == 0.0) {
        out.on_nodes[k] *= 2.0;
        out.on_nodes[k][axis] = 0.0;
      }
  return out;
}

template <LinearSolver Linear> template <class SomeModel, Indenter Tool>
std::vector<MechanicalState> QuasiStatic<Linear>::run(
    const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  QuasiStaticRun<SomeModel, Tool> path(model, scenario, touch, config);
  const double fraction = model.sector.fraction();
  std::vector<MechanicalState> states;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = path.solve(fraction * load);
    path.report(state.status);
    state.iterations = path.iterations;
    state.depth_m = path.advance();
    const auto& x = path.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k)
      state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    FrictionForces friction = path.friction();
    state.friction_N = std::move(friction.on_nodes);
    state.friction_push_N = friction.push_N;
    states.push_back(std::move(state));
    if (states.back().status != Status::converged) break;
  }
  return states;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/simulator.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SIMULATOR_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SIMULATOR_HPP

namespace lumo {

template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Solver>
requires PressSolver<Solver, Material, Contact, Element>
class PreparedBody;

/// Presses an indenter into a body. Types choose the physics, values choose the numbers:
/// `Simulator sim{NeoHookean{.mu = 106.0_kPa, .lambda = 10.494_MPa}, SDFContact{}}`.
/// `Solver` finds the states: `QuasiStatic<Cholmod>` with CHOLMOD's factors, VertexBlockDescent, or one's own.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element = QuadraticTet,
    class Solver = QuasiStatic<>>
requires PressSolver<Solver, Material, Contact, Element>
struct Simulator {
  Material material = {};
  Contact contact = {};
  Element element = {};
  Solver solver = {};

  /// Everything that scenarios on one mesh share (elements, symbolic factorisations); thread-safe, so that scenarios
  /// can run side by side. Throws InvalidArgument for parameters out of range and for a body that nothing holds,
  /// MeshError for a mesh that is not valid or not the body's (require_valid(body, mesh)).
  PreparedBody<Material, Contact, Element, Solver> prepare(const Body& body, const TetMesh& mesh) const {
    validate(material);
    validate(contact);
    require_valid(body, mesh);
    require_held(body, mesh);
    return {*this, body, mesh};
  }

  /// One scenario from first touch through its loads. Throws as prepare() and PreparedBody::press() do.
  template <Indenter Tool>
  std::vector<MechanicalState> press(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) const {
    return prepare(body, mesh).press(scenario);
  }
};

template <class Material, class Contact> Simulator(Material, Contact) -> Simulator<Material, Contact>;
template <class Material, class Contact, class Element> Simulator(Material, Contact, Element)
    -> Simulator<Material, Contact, Element>;
template <class Material, class Contact, class Element, class Solver> Simulator(Material, Contact, Element, Solver)
    -> Simulator<Material, Contact, Element, Solver>;

/// A body ready to be pressed at many places.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element, class Solver>
requires PressSolver<Solver, Material, Contact, Element>
class PreparedBody {
 public:
  using Model = typename Solver::template Model<Material, Contact, Element>;
  using Maker = Simulator<Material, Contact, Element, Solver>;

  PreparedBody(const Maker& maker, const Body& body, const TetMesh& mesh)
      : maker_(maker), body_(body), mesh_(std::make_shared<const TetMesh>(mesh)) {}

  /// States at the scenario's loads, on the whole mesh. Where body and scenario are symmetric the quasi-static solver
  /// takes only a half or a quarter; fields that break the symmetry are still tested for stability. Throws
  /// InvalidArgument for a scenario out of range, and for a tool that passes by or meets first what it may not touch.
  template <Indenter Tool> std::vector<MechanicalState> press(const Scenario<Tool>& scenario) const {
    validate(scenario);
    const Touch touch = first_touch(body_, *mesh_, scenario);
    require_free_way(body_, *mesh_, scenario, touch);
    // A fixed area per vertex knows no halves of vertices.
    const bool fold = Solver::uses_symmetry && area_per_vertex(maker_.contact) == 0.0;
    const Symmetry contact = symmetry_of(scenario),
                   planes{fold && mesh_->symmetry.x && contact.x, fold && mesh_->symmetry.y && contact.y};
    const Model& sector_model = model(planes);
    std::vector<MechanicalState> states = maker_.solver.run(sector_model, scenario, touch);
    const ContactSurface surface(
        *mesh_, body_, [](const Patch& p) { return p.contactable; }, maker_.contact);
    const ContactSurface resting(
        *mesh_, body_, [](const Patch& p) { return p.meets_carrier; }, maker_.contact);
    const Carrier carrier{body_.carrier};
    const Moving<Carrier> support{&carrier, Vec3d::Zero(), Vec3d::UnitZ()};
    const EnergyError<Material, Element> energy_error(*mesh_, maker_.material);
    for (MechanicalState& s : states) {
      s.displacement = unfold(*mesh_, sector_model.sector, s.displacement);
      if (!s.friction_N.empty()) s.friction_N = unfold(*mesh_, sector_model.sector, s.friction_N);
      const Vec3d origin = touch.origin + s.depth_m * scenario.direction();
      Positions x = positions_of(*mesh_);
      for (std::size_t k = 0; k < s.displacement.size(); ++k) x.col(Eigen::Index(k)) += s.displacement[k];
      const Moving<Tool> rigid{&scenario.indenter, origin, scenario.direction()};
      ContactField c = contact_field(*mesh_, surface, maker_.contact, rigid, x);
      const ContactSums sums = add_contact_forces(surface, maker_.contact, rigid, x, nullptr);
      s.force_N = sums.push_N + s.friction_push_N;
      s.penetration_m = sums.penetration_m;
      if (const double margin = record_margin(maker_.contact); margin > 0.0) {
        s.recorded = recorded_triangles(surface, rigid, x, margin);
        s.contact_area_m2 = recorded_area(surface, s.recorded, x);
        s.reference_area_m2 = recorded_area(surface, s.recorded, positions_of(*mesh_));
      } else {
        s.contact_area_m2 = contact_area(surface, c.field, x);
        s.reference_area_m2 = contact_area(surface, c.field, positions_of(*mesh_));
      }
      s.contact_field = std::move(c.field);
      s.tool_slopes = std::move(c.slopes);
      s.spots = std::move(c.spots);
      s.energy_error = energy_error(x);
      if (resting.size() > 0) s.carrier_slopes = resting_slopes(*mesh_, resting, support, x);
      s.pressure_Pa = std::move(c.pressure_Pa);
      if (x.allFinite()) {
        Tractions t = tractions_of(*mesh_, surface, maker_.contact, rigid, x, s.friction_N);
        s.tractions = std::move(t.points);
        s.traction_Pa = std::move(t.on_nodes);
      }
      // Certified on the whole mesh by the independent routine, whatever the solver reports. A held indenter bears
      // any force.
      const double wanted = s.status == Status::held ? s.force_N : s.load_N;
      s.residual_N =
          out_of_balance(body_, *mesh_, physics(), rigid, {wanted, s.displacement, {s.friction_N, s.friction_push_N}});
      if (s.status == Status::converged && !(s.residual_N <= 1e-6 * s.load_N))
        s.status = std::isfinite(s.residual_N) ? Status::max_iterations : Status::non_finite;
      if (std::isnan(s.residual_N)) s.residual_N = std::numeric_limits<double>::infinity();
      s.certified = s.status == Status::converged;
    }
    return states;
  }

  const TetMesh& mesh() const { return *mesh_; }

 private:
  PressPhysics<Material, Contact, Element> physics() const { return {maker_.material, maker_.contact, maker_.element}; }
  const Model& model(Symmetry planes) const {
    Slot& slot = (*slots_)[std::size_t((planes.x ? 1 : 0) + (planes.y ? 2 : 0))];
    const std::lock_guard one(slot.making);  // glibc aborts where std::call_once lets "out of memory" pass
    if (!slot.model) slot.model = maker_.solver.model(body_, *mesh_, planes, physics());
    return *slot.model;
  }

  struct Slot {
    std::mutex making;
    std::unique_ptr<Model> model;
  };
  Maker maker_;
  Body body_;
  std::shared_ptr<const TetMesh> mesh_;
  std::shared_ptr<std::array<Slot, 4>> slots_ = std::make_shared<std::array<Slot, 4>>();
};

}  // namespace lumo

#endif

// ---- lumo/pipeline/ensemble.hpp
#ifndef SINGLE_INCLUDE_LUMO_PIPELINE_ENSEMBLE_HPP
#define SINGLE_INCLUDE_LUMO_PIPELINE_ENSEMBLE_HPP

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

#endif

// ---- lumo/optics/response.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_RESPONSE_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_RESPONSE_HPP

namespace lumo {

/// Balance of the emitted power of a run [W]. Law: emitted = sum of everything else, to rounding.
struct EnergyLedger {
  double emitted = 0.0;
  std::vector<double> channels;       ///< left for good, per channel of the readout (ExitPower: per region)
  double to_indenter = 0.0;           ///< left through the contact set, into the opaque indenter
  double elsewhere = 0.0;             ///< left for good, but through no region
  double absorbed_in_medium = 0.0;    ///< in the silicone
  double absorbed_at_surfaces = 0.0;  ///< at opaque surfaces: carrier and LEDs
  double roulette = 0.0;              ///< ended minus added by Russian roulette; expectation 0, either sign
  double refinement = 0.0;  ///< channels as first traced minus channels as refined; expectation 0, either sign
  double lost = 0.0;        ///< rays that leaked or bounced too often; a result has at most largest_lost of emitted

  static constexpr double largest_lost = 1e-6;       ///< share of the emitted power, by default
  static constexpr double largest_imbalance = 1e-9;  ///< what rounding may do to imbalance()

  double accounted() const {
    return std::accumulate(channels.begin(), channels.end(), 0.0) + to_indenter + elsewhere + absorbed_in_medium +
           absorbed_at_surfaces + roulette + refinement + lost;
  }
  /// |emitted − accounted| / emitted.
  double imbalance() const { return emitted > 0.0 ? std::abs(emitted - accounted()) / emitted : std::abs(accounted()); }
};

/// Throws NumericalError unless the balance closes and next to nothing is lost: else light left where the surface is
/// open, or was still on its way after the last event.
inline void require_closed(const EnergyLedger& ledger, double largest_lost = EnergyLedger::largest_lost) {
  const double lost = ledger.emitted > 0.0 ? ledger.lost / ledger.emitted : ledger.lost;
  if (!(lost <= largest_lost))
    throw NumericalError(message("light: ", lost, " of the emitted power is lost, at most ", largest_lost,
        ": the surface is open, or max_events is too small"));
  if (!(ledger.imbalance() <= EnergyLedger::largest_imbalance))
    throw NumericalError(message("light: ", ledger.imbalance(), " of the emitted power is unaccounted for, at most ",
        EnergyLedger::largest_imbalance));
}

namespace detail {

inline constexpr std::array<double EnergyLedger::*, 8> ledger_entries = {&EnergyLedger::emitted,
    &EnergyLedger::to_indenter, &EnergyLedger::elsewhere, &EnergyLedger::absorbed_in_medium,
    &EnergyLedger::absorbed_at_surfaces, &EnergyLedger::roulette, &EnergyLedger::refinement, &EnergyLedger::lost};

}  // namespace detail

/// Adds `factor` × the accounts of `part`, `emitted` too.
inline void add_scaled(EnergyLedger& sum, const EnergyLedger& part, double factor) {
  for (std::size_t c = 0; c < sum.channels.size(); ++c) sum.channels[c] += factor * part.channels[c];
  for (const auto entry : detail::ledger_entries) sum.*entry += factor * part.*entry;
}

/// Power that the readout sees of one state. Channels are those of the readout (ExitPower: regions of the body), once
/// for each colour of the emitters.
struct Response {
  std::vector<double> power_W;  ///< mean over replicates
  std::vector<double> error_W;  ///< standard error of the mean, from the scatter of the replicates
  /// [W], replicates × channels. Replicate k of every state is traced with the same rays, so an error of a *difference*
  /// of states comes from the differences row by row (common random numbers).
  Eigen::MatrixXd replicates;
  Eigen::MatrixXd direct;  ///< the part of `replicates` that met no surface but the one through which it left
  /// The same two as paths from the emitters alone have them, of portions whose light was gathered backwards, too.
  Eigen::MatrixXd forward, forward_direct;
  EnergyLedger ledger;                ///< mean over replicates
  std::vector<EnergyLedger> ledgers;  ///< of each replicate, without its channels
  long rays = 0;                      ///< primary rays traced
  long segments = 0;                  ///< straight pieces traced
};

/// Standard error of the mean of each column of `rows` (independent replicates × channels); zeros for one row.
inline std::vector<double> standard_error(const Eigen::MatrixXd& rows) {
  std::vector<double> error(std::size_t(rows.cols()), 0.0);
  const double n = double(rows.rows());
  if (rows.rows() < 2) return error;
  for (Eigen::Index c = 0; c < rows.cols(); ++c)
    error[std::size_t(c)] = std::sqrt((rows.col(c).array() - rows.col(c).mean()).square().sum() / (n * (n - 1.0)));
  return error;
}

/// Standard errors of the ledger's entries, from the scatter of the replicates; of `channels`, error_W.
inline EnergyLedger ledger_error(const Response& r) {
  EnergyLedger error;
  error.channels = r.error_W;
  for (const auto entry : detail::ledger_entries) {
    Eigen::MatrixXd column(Eigen::Index(r.ledgers.size()), 1);
    for (std::size_t i = 0; i < r.ledgers.size(); ++i) column(Eigen::Index(i), 0) = r.ledgers[i].*entry;
    error.*entry = standard_error(column)[0];
  }
  return error;
}

/// Of each channel whose light was also gathered backwards, takes what the paths themselves found where that is the
/// better known: points on a face can be few where a lamp is near or all light comes from one spot, and then scatter,
/// or miss it all with an error of zero. Forward light is taken where all replicates saw it, its error is a hundredth
/// of it (few paths make errors that are themselves chance), and gathered light scatters four times as much, or is off
/// by a twentieth and eight errors.
inline void choose_better(Response& r) {
  constexpr double known = 0.01, noisier = 4.0, off_part = 0.05, off_errors = 8.0;
  if (r.forward.cols() != r.replicates.cols() || r.forward.rows() < 2) return;
  const std::vector<double> gathered = standard_error(r.replicates), forward = standard_error(r.forward),
                            apart = standard_error(r.replicates - r.forward);
  for (Eigen::Index c = 0; c < r.replicates.cols(); ++c) {
    const auto k = std::size_t(c);
    const double had = r.replicates.col(c).mean(), found = r.forward.col(c).mean(), off = std::abs(had - found);
    const bool misses = off > off_errors * apart[k] && off > off_part * std::max(had, found);
    const bool is_known = r.forward.col(c).minCoeff() > 0.0 && forward[k] < known * found;
    if (!(is_known && (misses || gathered[k] > noisier * forward[k]))) continue;
    for (std::size_t i = 0; i < r.ledgers.size(); ++i)
      r.ledgers[i].refinement += r.replicates(Eigen::Index(i), c) - r.forward(Eigen::Index(i), c);
    r.replicates.col(c) = r.forward.col(c);
    r.direct.col(c) = r.forward_direct.col(c);
  }
  r.forward.resize(0, 0);
  r.forward_direct.resize(0, 0);
}

}  // namespace lumo

#endif

// ---- lumo/optics/beer_lambert.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_BEER_LAMBERT_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_BEER_LAMBERT_HPP

namespace lumo {

/// The filling of a body, for light that runs straight through it. Made from the Medium data of a body.
/// Laws: transmittance(0) = 1, T(a + b) = T(a)·T(b), not increasing. The rest is booked as absorbed.
template <class M>
concept TransparentMedium = std::constructible_from<M, Medium> && requires(const M& medium, double path_m) {
  { medium.refractive_index() } -> std::convertible_to<double>;
  { medium.transmittance(path_m) } -> std::convertible_to<double>;
};

/// Exponential extinction along a path. Source: Bouguer 1729, Lambert 1760, Beer 1852; paper §III (μ_ext acts as
/// absorption).
class BeerLambert {
 public:
  /// Throws InvalidArgument unless the index lies in [1, 5] and the extinction in [0, 1e6] 1/m.
  explicit BeerLambert(const Medium& medium) : medium_(medium) {
    require_in_range("refractive index", medium.refractive_index, 1.0, 5.0, "");
    require_in_range("extinction", medium.extinction_per_m, 0.0, 1e6, "1/m");
  }

  double refractive_index() const { return medium_.refractive_index; }
  /// Share of the power left after `path_m` metres.
  template <class S> auto transmittance(const S& path_m) const {
    using std::exp;
    return exp(-medium_.extinction_per_m * path_m);
  }

 private:
  Medium medium_;
};

static_assert(TransparentMedium<BeerLambert>);
static_assert(!TransparentMedium<int>);

}  // namespace lumo

#endif

// ---- lumo/optics/intersector.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_INTERSECTOR_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_INTERSECTOR_HPP

namespace lumo {

/// Triangle of an optical scene, counter-clockwise seen from outside the body, or from the lit side of a carrier face.
struct SceneTriangle {
  std::array<Vec3d, 3> corners;  ///< [m]
  bool in_air_only = false;      ///< a carrier face: met only by rays outside the body
};

/// The first triangle on a ray.
struct RayHit {
  double t = std::numeric_limits<double>::infinity();  ///< along the unit direction [m]; infinite: no triangle
  int triangle = -1;
  explicit operator bool() const { return triangle >= 0; }
};

/// Finds what a ray meets first, *given the medium it is in*: inside the body only faces that it can leave by (d·n > 0,
/// not in_air_only) count, outside only faces that it can meet from their front (d·n < 0). A ray that starts on a face
/// can therefore never meet that face again, whatever the rounding, and needs no offset.
template <class S>
concept RayScene = requires(const S& scene, const Vec3d& v, bool inside) {
  { scene.first_hit(v, v, inside) } -> std::same_as<RayHit>;
};

/// Builds a RayScene from triangles. Laws: same triangles, same hits; results do not depend on where the scene lies in
/// space.
template <class I>
concept Intersector = requires(const I& intersector, const std::vector<SceneTriangle>& triangles) {
  { intersector.build(triangles) } -> RayScene;
};

}  // namespace lumo

#endif

// ---- lumo/optics/bvh.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_BVH_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_BVH_HPP

namespace lumo {

/// Ray scene on a tree of boxes, four children a node: triangles in double precision, boxes in float, rounded outwards.
class BvhScene {
 public:
  /// Throws InvalidArgument for a corner that is not finite.
  BvhScene(const std::vector<SceneTriangle>& triangles, int leaf_size) : leaf_size_(std::max(1, leaf_size)) {
    Box all;
    for (const SceneTriangle& t : triangles)
      for (const Vec3d& p : t.corners) {
        if (!p.allFinite()) throw InvalidArgument("optical scene: a corner is not finite");
        all.extend(p);
      }
    if (triangles.empty()) return;
    center_ = all.center();
    const double extent = all.diagonal().norm(), pad = box_margin * extent;
    slack_ = behind * extent;
    for (const SceneTriangle& t : triangles) {
      Box box;
      for (const Vec3d& p : t.corners) box.extend(Vec3d(p - center_));
      boxes_.emplace_back(Vec3d(box.min().array() - pad), Vec3d(box.max().array() + pad));
    }
    order_.resize(triangles.size());
    std::iota(order_.begin(), order_.end(), 0);
    build(bounds(0, int(triangles.size())));
    for (int i : order_) {
      const auto& [a, b, c] = triangles[std::size_t(i)].corners;
      triangles_.push_back({a - center_, b - a, c - a, i, triangles[std::size_t(i)].in_air_only});
    }
    boxes_ = {};
    order_ = {};
  }

  /// First triangle on the ray from `origin` [m] along the unit vector `direction`; `inside`: the ray runs in the body.
  RayHit first_hit(const Vec3d& origin, const Vec3d& direction, bool inside) const {
    RayHit best;
    if (nodes_.empty()) return best;
    const Vec3d o = origin - center_;
    std::array<float, 3> of, inverse;
    for (std::size_t a = 0; a < 3; ++a) {
      const double d = direction[Eigen::Index(a)];
      of[a] = float(o[Eigen::Index(a)]);
      inverse[a] = float(1.0 / (std::abs(d) < parallel ? std::copysign(parallel, d) : d));
    }
    struct Todo {
      int child, count;
      float t;
    };
    std::array<Todo, 256> stack;  // three a level at most; trees stay far below 80 levels
    std::size_t top = 0;
    stack[top++] = {0, 0, 0.0f};
    while (top > 0) {
      const Todo now = stack[--top];
      if (double(now.t) > best.t) continue;
      for (int i = now.child; i < now.child + now.count; ++i) {
        const Triangle& t = triangles_[std::size_t(i)];
        const Vec3d p = direction.cross(t.edge2);
        const double det = t.edge1.dot(p);  // > 0: against the normal, so from outside
        if (inside ? t.in_air_only || !(det < 0.0) : !(det > 0.0)) continue;
        const double f = 1.0 / det;
        const Vec3d s = o - t.corner;
        const double u = f * s.dot(p);
        if (!(u >= -edge && u <= 1.0 + edge)) continue;
        const Vec3d q = s.cross(t.edge1);
        const double v = f * direction.dot(q);
        if (!(v >= -edge && u + v <= 1.0 + edge)) continue;
        const double d = f * t.edge2.dot(q);
        if (d >= -slack_ && d < best.t) best = {d, t.id};
      }
      if (now.count > 0) continue;
      const Node& node = nodes_[std::size_t(now.child)];
      Eigen::Array4f enter = Eigen::Array4f::Zero(), leave = Eigen::Array4f::Constant(float(best.t));
      for (std::size_t a = 0; a < 3; ++a) {
        const Eigen::Array4f &near = inverse[a] < 0.0f ? node.high[a] : node.low[a],
                             &far = inverse[a] < 0.0f ? node.low[a] : node.high[a];
        enter = enter.max((near - of[a]) * inverse[a]);
        leave = leave.min((far - of[a]) * inverse[a]);
      }
      const std::size_t base = top;
      for (std::size_t k = 0; k < 4; ++k) {
        if (node.count[k] < 0 || !(enter[Eigen::Index(k)] <= leave[Eigen::Index(k)] * rounding) || top == stack.size())
          continue;
        std::size_t at = top++;  // keep the nearest on top
        for (; at > base && stack[at - 1].t < enter[Eigen::Index(k)]; --at) stack[at] = stack[at - 1];
        stack[at] = {node.child[k], node.count[k], enter[Eigen::Index(k)]};
      }
    }
    return best;
  }

 private:
  // Shares of the scene's diagonal: by how much boxes exceed their triangles, which covers float's rounding, and how
  // far behind its origin a ray still hits, which covers double's.
  static constexpr double box_margin = 1e-6, behind = 1e-11;
  static constexpr double parallel = 1e-12;     ///< components of a direction below it count as this
  static constexpr double edge = 1e-10;         ///< of barycentric coordinates: neighbours leave no gap between them
  static constexpr float rounding = 1.000001f;  ///< of the float that leaves a box: some units in the last place
  static constexpr std::size_t bins = 16;       ///< of the surface-area heuristic
  using Box = Eigen::AlignedBox<double, 3>;
  struct Triangle {
    Vec3d corner, edge1, edge2;
    int id;
    bool in_air_only;
  };
  struct Node {
    std::array<Eigen::Array4f, 3> low, high;
    std::array<int, 4> child{};  ///< node, or first triangle of a leaf
    std::array<int, 4> count{};  ///< triangles of a leaf, 0 for a node, −1 if unused
  };
  struct Range {
    int first, last;
    Box box;
  };

  Range bounds(int first, int last) const {
    Range r{first, last, {}};
    for (int i = first; i < last; ++i) r.box.extend(boxes_[std::size_t(order_[std::size_t(i)])]);
    return r;
  }
  // Cuts the range where the expected cost of a ray is least; false if it is small, or cannot be cut.
  bool split(const Range& range, std::array<Range, 2>& halves) {
    const int n = range.last - range.first;
    if (n <= leaf_size_) return false;
    Box centers;
    for (int i = range.first; i < range.last; ++i) centers.extend(boxes_[std::size_t(order_[std::size_t(i)])].center());
    int axis = 0;
    const double width = centers.diagonal().maxCoeff(&axis);
    if (!(width > 0.0)) return false;
    const auto bin = [&](int i) {
      const double x = (boxes_[std::size_t(i)].center()[axis] - centers.min()[axis]) / width;
      return std::min(bins - 1, std::size_t(x * double(bins)));
    };
    const auto area = [](const Box& b) {
      const Vec3d d = b.diagonal();
      return d.x() * d.y() + d.y() * d.z() + d.z() * d.x();
    };
    std::array<Box, bins> box;
    std::array<int, bins> count{};
    for (int i = range.first; i < range.last; ++i) {
      const int id = order_[std::size_t(i)];
      box[bin(id)].extend(boxes_[std::size_t(id)]);
      ++count[bin(id)];
    }
    std::array<double, bins> right{};
    Box sweep;
    for (std::size_t b = bins; b-- > 1;) {
      sweep.extend(box[b]);
      right[b] = sweep.isEmpty() ? 0.0 : area(sweep);
    }
    sweep.setEmpty();
    double best = std::numeric_limits<double>::infinity();
    std::size_t cut = 0;
    for (std::size_t b = 1, below = 0; b < bins; ++b) {
      sweep.extend(box[b - 1]);
      below += std::size_t(count[b - 1]);
      if (below == 0 || below == std::size_t(n)) continue;
      const double cost = area(sweep) * double(below) + right[b] * double(std::size_t(n) - below);
      if (cost < best) {
        best = cost;
        cut = b;
      }
    }
    const auto begin = order_.begin();
    const auto middle = std::partition(begin + range.first, begin + range.last, [&](int id) { return bin(id) < cut; });
    halves = {bounds(range.first, int(middle - begin)), bounds(int(middle - begin), range.last)};
    return true;
  }
  int build(const Range& range) {
    std::vector<Range> parts{range};
    for (std::size_t tried = 0; parts.size() < 4 && tried < parts.size();) {
      std::sort(parts.begin(), parts.end(),
          [](const Range& a, const Range& b) { return a.last - a.first > b.last - b.first; });
      std::array<Range, 2> halves;
      if (!split(parts[tried], halves)) {
        ++tried;
        continue;
      }
      parts[tried] = halves[0];
      parts.push_back(halves[1]);
      tried = 0;
    }
    const std::size_t me = nodes_.size();
    nodes_.emplace_back();
    for (std::size_t k = 0; k < 4; ++k) {
      for (std::size_t a = 0; a < 3; ++a) {
        const bool used = k < parts.size();
        nodes_[me].low[a][Eigen::Index(k)] =
            used ? float(parts[k].box.min()[Eigen::Index(a)]) : std::numeric_limits<float>::infinity();
        nodes_[me].high[a][Eigen::Index(k)] =
            used ? float(parts[k].box.max()[Eigen::Index(a)]) : -std::numeric_limits<float>::infinity();
      }
      if (k >= parts.size()) {
        nodes_[me].count[k] = -1;
        continue;
      }
      const bool leaf = parts.size() == 1 || parts[k].last - parts[k].first <= leaf_size_;
      nodes_[me].count[k] = leaf ? parts[k].last - parts[k].first : 0;
      const int child = leaf ? parts[k].first : build(parts[k]);
      nodes_[me].child[k] = child;
    }
    return int(me);
  }

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
  std::vector<Box> boxes_;        ///< per input triangle, while building
  std::vector<int> order_;        ///< likewise
  Vec3d center_ = Vec3d::Zero();  ///< corners are stored relative to it
  double slack_ = 0.0;            ///< rays may start this far behind a face [m]
  int leaf_size_;
};

/// The library's own Intersector; needs Eigen only. Law: independent of the place of the scene (it is centred).
/// Source: binned surface area heuristic, Wald 2007; ray–triangle test, Möller & Trumbore 1997.
struct Bvh {
  struct Config {
    int leaf_size = 4;  ///< triangles up to which a range is not split
  };
  Config config{};

  BvhScene build(const std::vector<SceneTriangle>& triangles) const { return {triangles, config.leaf_size}; }
};

static_assert(RayScene<BvhScene> && Intersector<Bvh>);

}  // namespace lumo

#endif

// ---- lumo/optics/lamp_places.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_LAMP_PLACES_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_LAMP_PLACES_HPP

namespace lumo {

/// Distance of the point p from a triangle. Source: Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
inline double distance_to_triangle(const Vec3d& p, const std::array<Vec3d, 3>& corners) {
  const auto& [a, b, c] = corners;
  const Vec3d ab = b - a, ac = c - a, bc = c - b, n = ab.cross(ac);
  const auto to_edge = [&](const Vec3d& from, const Vec3d& along) {
    const double l2 = along.squaredNorm(), t = l2 > 0.0 ? std::clamp(along.dot(p - from) / l2, 0.0, 1.0) : 0.0;
    return (p - from - t * along).norm();
  };
  const bool over = n.dot(ab.cross(p - a)) >= 0.0 && n.dot(bc.cross(p - b)) >= 0.0 && n.dot((p - a).cross(ac)) >= 0.0;
  if (const double length = n.norm(); over && length > 0.0) return std::abs(n.dot(p - a)) / length;
  return std::min({to_edge(a, ab), to_edge(b, bc), to_edge(a, ac)});
}

/// Where light may start in a scene. `triangles`: of the body, then of carrier faces, as the scene was built from.
template <RayScene Scene> class LampPlaces {
 public:
  /// Within `precision_m` of the surface a lamp is on it, which is right for each; where nodes have moved by up to
  /// `moved_m`, within both.
  LampPlaces(const std::vector<SceneTriangle>& triangles, const Scene& scene, double precision_m, double moved_m)
      : triangles_(triangles), scene_(scene), step_m_(precision_m), tolerance_m_(precision_m + moved_m) {}

  /// Throws InvalidArgument for an emitter of which a part lies out of the medium that it radiates into: outside the
  /// body, or, of one in air, inside it. The message names the lamp, the place and how far from the surface it lies.
  void require(const std::vector<Emitter>& emitters) const {
    for (std::size_t k = 0; k < emitters.size(); ++k) {
      const Worst worst = worst_of(emitters[k]);
      if (!(worst.distance_m > tolerance_m_)) continue;
      throw InvalidArgument(message("emitter ", k, " at ", text(emitters[k].center()), " mm radiates into the ",
          emitters[k].in_air() ? "air, but lies up to " : "body, but lies up to ", worst.distance_m * 1e3,
          emitters[k].in_air() ? " mm inside the body, at " : " mm outside of it, at ", text(worst.at), " mm"));
    }
  }

 private:
  struct Worst {
    double distance_m = 0.0;
    Vec3d at = Vec3d::Zero();
  };
  static std::string text(const Vec3d& p) {
    return message("(", 1e3 * p.x(), ", ", 1e3 * p.y(), ", ", 1e3 * p.z(), ")");
  }
  // Light finds first how to leave the body, or first how to enter it. Two of three directions decide: one may meet an
  // edge. `reach_m`: the surface is at most this far.
  bool inside(const Vec3d& p, const Vec3d& axis, double& reach_m) const {
    Vec3d t1, t2;
    tangents(axis, t1, t2);
    int votes = 0;
    for (const Vec3d& side : {Vec3d(0.313 * t1 + 0.171 * t2), Vec3d(-0.289 * t1 + 0.233 * t2), Vec3d(-0.127 * t2)}) {
      const Vec3d d = (axis + side).normalized();
      const RayHit leaving = scene_.first_hit(p, d, true), entering = scene_.first_hit(p, d, false);
      votes += leaving.t < entering.t ? 1 : -1;
      reach_m = std::min(reach_m, leaving.t);
      if (entering && !triangles_[std::size_t(entering.triangle)].in_air_only) reach_m = std::min(reach_m, entering.t);
    }
    return votes > 0;
  }
  double distance(const Vec3d& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const SceneTriangle& t : triangles_)
      if (!t.in_air_only) least = std::min(least, distance_to_triangle(p, t.corners));
    return least;
  }
  // A point on the surface is on either side, so its neighbours along the axis are looked at.
  Worst worst_of(const Emitter& e) const {
    static constexpr std::array<double, 5> places{1e-12, 0.25, 0.5, 0.75, 1.0 - 1e-12};
    Worst worst;
    for (const double u : places)
      for (const double v : places) {
        const Vec3d at = e.point(u, v), axis = e.axis(), step = step_m_ * axis;
        double reach_m = std::numeric_limits<double>::infinity();
        if (inside(at + step, axis, reach_m) != e.in_air() || inside(at - step, axis, reach_m) != e.in_air()) continue;
        if (reach_m + step_m_ <= tolerance_m_) continue;
        if (const double apart = distance(at); apart > worst.distance_m) worst = {apart, at};
      }
    return worst;
  }

  const std::vector<SceneTriangle>& triangles_;
  const Scene& scene_;
  double step_m_, tolerance_m_;
};

}  // namespace lumo

#endif

// ---- lumo/optics/surface/carrier_cells.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_SURFACE_CARRIER_CELLS_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_SURFACE_CARRIER_CELLS_HPP

namespace lumo {

/// Unit normal of a carrier face on its lit side, and in-plane normals of its edges, outwards.
struct FaceFrame {
  Vec3d normal;
  std::vector<Vec3d> out;
};

/// Throws InvalidArgument for a face that is not a polygon of finite corners with an area.
inline FaceFrame face_frame(const RigidFace& face) {
  const std::vector<Vec3d>& c = face.corners;
  const std::size_t m = c.size();
  if (m < 3) throw InvalidArgument(message("carrier face '", face.name, "' has ", m, " corners, needs 3"));
  for (const Vec3d& p : c)
    if (!p.allFinite()) throw InvalidArgument(message("carrier face '", face.name, "': a corner is not finite"));
  Vec3d n = Vec3d::Zero();
  for (std::size_t k = 1; k + 1 < m; ++k) n += (c[k] - c[0]).cross(c[k + 1] - c[0]);
  if (!(n.norm() > 0.0)) throw InvalidArgument(message("carrier face '", face.name, "' has no area"));
  n.normalize();
  FaceFrame frame{n, {}};
  for (std::size_t k = 0; k < m; ++k) frame.out.push_back((c[(k + 1) % m] - c[k]).cross(n).normalized());
  return frame;
}

/// How deep the points `soft` of a body lie behind the carrier faces that they rest on [m], per face; 0: none rests
/// there. A point rests on one face, the one that it is least deep behind: at a carrier's edge it lies behind others,
/// too.
inline std::vector<double> resting_depths(
    const std::vector<RigidFace>& faces, const std::vector<FaceFrame>& frames, const std::vector<Vec3d>& soft) {
  constexpr double reach = 0.1e-3;  // [m]; contact never lets a point go deeper
  std::vector<double> depths(faces.size(), 0.0);
  for (const Vec3d& x : soft) {
    std::size_t rests_on = faces.size();
    double least = reach;
    for (std::size_t i = 0; i < faces.size(); ++i) {
      const std::vector<Vec3d>& c = faces[i].corners;
      const double depth = frames[i].normal.dot(c[0] - x);
      if (depth <= 0.0 || depth > least) continue;
      bool over = true;
      for (std::size_t k = 0; k < c.size() && over; ++k) over = frames[i].out[k].dot(x - c[k]) < 0.0;
      if (!over) continue;
      least = depth;
      rests_on = i;
    }
    if (rests_on < faces.size()) depths[rests_on] = std::max(depths[rests_on], least);
  }
  return depths;
}

/// Corners of a carrier face moved back by `back_m`. Slits open where two faces that stand back meet: each is made
/// larger in its plane by `rim_m`, the most by which any of them stands back, so that no light slips through.
inline std::vector<Vec3d> set_back(const RigidFace& face, const FaceFrame& frame, double back_m, double rim_m) {
  const std::vector<Vec3d>& c = face.corners;
  const std::size_t m = c.size();
  std::vector<Vec3d> corner(m);
  for (std::size_t k = 0; k < m; ++k) {
    const Vec3d &a = frame.out[(k + m - 1) % m], &b = frame.out[k];
    corner[k] = c[k] - back_m * frame.normal + rim_m * (a + b) / (1.0 + std::max(-0.9, a.dot(b)));
  }
  return corner;
}

/// Cuts a convex polygon into triangles with edges of about `size_m` that fit together corner to corner. How many is
/// decided on the polygon `like` of as many corners, so that a face that is moved keeps its cells. A parallelogram
/// becomes an even number of cells each way, of four triangles each, any other polygon a fan about its middle: mirror
/// images of a polygon have mirror images of its triangles.
inline std::vector<std::array<Vec3d, 3>> polygon_cells(
    const std::vector<Vec3d>& c, const std::vector<Vec3d>& like, double size_m) {
  std::vector<std::array<Vec3d, 3>> cells;
  const auto pieces = [&](double length) { return std::max(1, int(std::ceil(length / size_m - 1e-9))); };
  if (like.size() == 4 && (like[0] + like[2] - like[1] - like[3]).norm() < 1e-9 * (like[2] - like[0]).norm()) {
    const int nu = 2 * pieces(0.5 * (like[1] - like[0]).norm()), nv = 2 * pieces(0.5 * (like[3] - like[0]).norm());
    const auto at = [&](double i, double j) {
      const double u = i / nu, v = j / nv;
      return Vec3d((1.0 - u) * (1.0 - v) * c[0] + u * (1.0 - v) * c[1] + u * v * c[2] + (1.0 - u) * v * c[3]);
    };
    for (int i = 0; i < nu; ++i)
      for (int j = 0; j < nv; ++j) {
        const Vec3d middle = at(i + 0.5, j + 0.5);
        const std::array<Vec3d, 4> p{at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)};
        for (std::size_t k = 0; k < 4; ++k) cells.push_back({p[k], p[(k + 1) % 4], middle});
      }
    return cells;
  }
  const std::size_t m = c.size();
  double longest = 0.0;
  Vec3d middle = Vec3d::Zero();
  for (std::size_t k = 0; k < m; ++k) {
    middle += c[k] / double(m);
    for (std::size_t l = 0; l < k; ++l) longest = std::max(longest, (like[k] - like[l]).norm());
  }
  const int n = pieces(longest);
  for (std::size_t k = 0; k < m; ++k) {
    const auto at = [&](int i, int j) {
      return Vec3d(middle + (double(i) / n) * (c[k] - middle) + (double(j) / n) * (c[(k + 1) % m] - middle));
    };
    for (int i = 0; i < n; ++i)
      for (int j = 0; i + j < n; ++j) {
        cells.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        if (i + j + 1 < n) cells.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
  }
  return cells;
}
inline std::vector<std::array<Vec3d, 3>> polygon_cells(const std::vector<Vec3d>& c, double size_m) {
  return polygon_cells(c, c, size_m);
}

}  // namespace lumo

#endif

// ---- lumo/optics/surface/quadratic_face.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_SURFACE_QUADRATIC_FACE_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_SURFACE_QUADRATIC_FACE_HPP

namespace lumo {

/// Shape functions of a quadratic triangle at barycentric (b1, b2); nodes: corners 0, 1, 2, then the middles of edges
/// 01, 12, 20.
inline std::array<double, 6> quadratic_shape(double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  return {
      b0 * (2.0 * b0 - 1.0), b1 * (2.0 * b1 - 1.0), b2 * (2.0 * b2 - 1.0), 4.0 * b0 * b1, 4.0 * b1 * b2, 4.0 * b2 * b0};
}

/// Its point at (b1, b2).
inline Vec3d on_quadratic(const std::array<Vec3d, 6>& x, double b1, double b2) {
  const std::array<double, 6> n = quadratic_shape(b1, b2);
  return n[0] * x[0] + n[1] * x[1] + n[2] * x[2] + n[3] * x[3] + n[4] * x[4] + n[5] * x[5];
}

/// The same at (k1, k2)/n. Points on an edge come from the edge's own three nodes in the order of their `numbers`, so
/// that neighbours get the same bits: no cracks.
inline Vec3d lattice_point(const std::array<Vec3d, 6>& x, const std::array<int, 6>& numbers, int n, int k1, int k2) {
  const double h = 1.0 / n;
  const auto on_edge = [&](std::size_t a, std::size_t b, std::size_t m, int ka, int kb) {
    if (kb == 0) return x[a];
    if (ka == 0) return x[b];
    if (numbers[a] > numbers[b]) {
      std::swap(a, b);
      std::swap(ka, kb);
    }
    const double s = ka * h, t = kb * h;
    return Vec3d(s * (2.0 * s - 1.0) * x[a] + t * (2.0 * t - 1.0) * x[b] + 4.0 * s * t * x[m]);
  };
  const int k0 = n - k1 - k2;
  if (k2 == 0) return on_edge(0, 1, 3, k0, k1);
  if (k0 == 0) return on_edge(1, 2, 4, k1, k2);
  if (k1 == 0) return on_edge(2, 0, 5, k2, k0);
  return on_quadratic(x, k1 * h, k2 * h);
}

/// Unit normal at (b1, b2); not finite if the triangle is crushed.
inline Vec3d quadratic_normal(const std::array<Vec3d, 6>& x, double b1, double b2) {
  const double b0 = 1.0 - b1 - b2;
  const Vec3d d1 =
      (1.0 - 4.0 * b0) * x[0] + (4.0 * b1 - 1.0) * x[1] + 4.0 * (b0 - b1) * x[3] + 4.0 * b2 * (x[4] - x[5]);
  const Vec3d d2 =
      (1.0 - 4.0 * b0) * x[0] + (4.0 * b2 - 1.0) * x[2] + 4.0 * (b0 - b2) * x[5] + 4.0 * b1 * (x[4] - x[3]);
  return d1.cross(d2).normalized();
}

/// A boundary face of the mesh in one state.
struct QuadraticFace {
  std::array<Vec3d, 6> reference, deformed;  ///< [m]
  std::array<Vec3d, 6> normal;  ///< unit outward normals of the deformed face at its nodes, shared with its neighbours
  std::array<double, 6> contact;  ///< contact field, > 0 in contact, −infinity where there can be none
  int patch;
  bool may_touch;
  std::array<ContactSlope, 6> slope;  ///< how the face leans away from what it touches
  bool leans;                         ///< they say something of it

  /// Unit outward normal at (b1, b2).
  Vec3d normal_at(double b1, double b2) const;

  /// Inside {φ > 0}, φ linear on the four triangles between corners and edge middles?
  bool in_contact(double b1, double b2) const {
    if (!may_touch) return false;
    const double b0 = 1.0 - b1 - b2;
    double value = 0.0;
    struct Term {
      double weight;
      std::size_t node;
    };
    using Terms = std::array<Term, 3>;
    const Terms terms = b0 > 0.5   ? Terms{{{2.0 * b0 - 1.0, 0}, {2.0 * b1, 3}, {2.0 * b2, 5}}}
                        : b1 > 0.5 ? Terms{{{2.0 * b1 - 1.0, 1}, {2.0 * b0, 3}, {2.0 * b2, 4}}}
                        : b2 > 0.5 ? Terms{{{2.0 * b2 - 1.0, 2}, {2.0 * b1, 4}, {2.0 * b0, 5}}}
                                   : Terms{{{1.0 - 2.0 * b2, 3}, {1.0 - 2.0 * b0, 4}, {1.0 - 2.0 * b1, 5}}};
    for (const auto& [weight, node] : terms)
      if (weight > 0.0) value += weight * contact[node];  // a weight of 0 must not meet −infinity
    return value > 0.0;
  }
};

inline Vec3d QuadraticFace::normal_at(double b1, double b2) const {
  const std::array<double, 6> shape = quadratic_shape(b1, b2);
  Vec3d recovered = Vec3d::Zero();
  for (std::size_t k = 0; k < 6; ++k) recovered += shape[k] * normal[k];
  if (!leans) return recovered.normalized();
  double weight = 0.0, opening = 0.0;
  Vec3d rigid = Vec3d::Zero(), tilt = Vec3d::Zero();
  for (std::size_t k = 0; k < 6; ++k) {
    weight += shape[k] * slope[k].weight;
    opening += shape[k] * slope[k].opening;
    rigid += shape[k] * slope[k].normal;
    tilt += shape[k] * slope[k].tilt;
  }
  const double share = std::clamp(weight, 0.0, 1.0);
  const Vec3d leaning = (rigid + hertz_slope(opening) * tilt).normalized();
  return (share * leaning + (1.0 - share) * recovered.normalized()).normalized();
}

/// Numbers of the six nodes of each face, shared by neighbours on the same patch only, so that a crease keeps both its
/// normals.
inline std::vector<std::array<int, 6>> patchwise_nodes(const std::vector<BoundaryFace>& faces) {
  std::vector<std::array<int, 6>> numbers(faces.size());
  std::map<std::array<int, 3>, int> known;  // patch and the corners of the edge (of a corner: itself twice)
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 6; ++k) {
      const int a = faces[f].nodes[k % 3], b = k < 3 ? a : faces[f].nodes[(k + 1) % 3];
      numbers[f][k] =
          known.try_emplace({faces[f].patch, std::min(a, b), std::max(a, b)}, int(known.size())).first->second;
    }
  return numbers;
}

/// Sets the normals of the deformed faces. Normals of neighbouring quadratic faces differ, by about as much as a light
/// load turns them; the shape of the undeformed body is known. The exact normals are therefore turned as the faces
/// turn, by the nearest field that is continuous and quadratic on each patch: it turns every node's surroundings as
/// much as the faces do in the mean. Source: Hinton, Campbell 1974.
inline void recover_normals(
    std::vector<QuadraticFace>& faces, const std::vector<BoundaryFace>& mesh_faces, const Body& body) {
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  using Matrix6d = Eigen::Matrix<double, 6, 6>;
  using SparseMatrix = Eigen::SparseMatrix<double>;
  struct Point {
    double weight, b1, b2;
  };
  constexpr double w = 0.223381589678011, b = 0.445948490915965, v = 0.109951743655322,
                   c = 0.091576213509771;  // degree 4: Dunavant 1985
  constexpr std::array<Point, 6> rule = {
      {{w, b, b}, {w, 1 - 2 * b, b}, {w, b, 1 - 2 * b}, {v, c, c}, {v, 1 - 2 * c, c}, {v, c, 1 - 2 * c}}};

  const std::vector<std::array<int, 6>> nodes = patchwise_nodes(mesh_faces);
  int size = 0;
  for (const std::array<int, 6>& n : nodes) size = std::max(size, 1 + *std::max_element(n.begin(), n.end()));
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * faces.size());
  Eigen::MatrixX3d turned = Eigen::MatrixX3d::Zero(size, 3);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::array<Vec3d, 6>& x = faces[f].reference;
    const double area = 0.5 * (x[1] - x[0]).cross(x[2] - x[0]).norm();
    Matrix6d mass = Matrix6d::Zero();
    for (const Point& p : rule) {
      const Vector6d shape(quadratic_shape(p.b1, p.b2).data());
      mass += area * p.weight * shape * shape.transpose();
      const Vec3d turn = quadratic_normal(faces[f].deformed, p.b1, p.b2) - quadratic_normal(x, p.b1, p.b2);
      if (!turn.allFinite()) continue;  // a crushed face has no normal
      for (std::size_t k = 0; k < 6; ++k) turned.row(nodes[f][k]) += area * p.weight * shape[int(k)] * turn.transpose();
    }
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t l = 0; l < 6; ++l) entries.emplace_back(nodes[f][k], nodes[f][l], mass(int(k), int(l)));
  }
  SparseMatrix mass(size, size);
  mass.setFromTriplets(entries.begin(), entries.end());
  Eigen::ConjugateGradient<SparseMatrix, Eigen::Lower | Eigen::Upper> solver(mass);
  solver.setTolerance(1e-10);
  turned = solver.solve(turned).eval();
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 6; ++k)
      faces[f].normal[k] =
          (outward_normal(body, faces[f].patch, faces[f].reference[k]) + turned.row(nodes[f][k]).transpose())
              .normalized();
}

}  // namespace lumo

#endif

// ---- lumo/optics/surface_optics.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_SURFACE_OPTICS_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_SURFACE_OPTICS_HPP

namespace lumo {

/// A smooth interface met under a given angle: share of the power that is reflected, and the cosine behind it.
template <class S> struct FresnelSplit {
  S reflectance;    ///< 1 under total internal reflection
  S cosine_behind;  ///< of the refracted ray to the normal; 0 under total internal reflection
};

/// Unpolarised power reflectance of a smooth dielectric interface, for numbers or dual numbers. `cosine` in [0, 1] in
/// front, `index_ratio` = n in front / n behind. Laws: reciprocity (the same on the way back), R + T = 1,
/// ((n−1)/(n+1))² at normal incidence, R_p = 0 at Brewster's angle. Source: Fresnel 1823; Born & Wolf, Principles of
/// Optics, §1.5.
template <class S> FresnelSplit<S> fresnel(const S& cosine, const std::type_identity_t<S>& index_ratio) {
  using std::sqrt;
  const S sine2 = index_ratio * index_ratio * (1.0 - cosine * cosine);
  if (!(sine2 < 1.0)) return {S(1.0), S(0.0)};
  const S behind = sqrt(1.0 - sine2);
  const S s = (index_ratio * cosine - behind) / (index_ratio * cosine + behind);
  const S p = (cosine - index_ratio * behind) / (cosine + index_ratio * behind);
  return {0.5 * (s * s + p * p), behind};
}

/// Mirror image of the unit direction `d` in the plane with unit normal `n`.
template <class S> Vec3<S> reflect(const Vec3<S>& d, const Vec3<S>& n) { return (d - 2.0 * d.dot(n) * n).normalized(); }

/// Refracted direction of the unit direction `d` by Snell's law; `n` is the unit normal on the side that light comes
/// from.
template <class S> Vec3<S> refract(const Vec3<S>& d, const Vec3<S>& n, const std::type_identity_t<S>& index_ratio,
    const std::type_identity_t<S>& cosine_behind) {
  return (index_ratio * (d - d.dot(n) * n) - cosine_behind * n).normalized();
}

// The policies themselves (Dielectric, Lambertian, Mirror, Absorber) are data of a body: morphology/silicone.hpp.
// This header has their reflection. Dielectric lets light through; the tracer splits it by fresnel().

/// Reflectance of an opaque surface [–], in [0, 1]. The rest is booked as absorbed there.
constexpr double reflectance(const Lambertian& s) { return s.albedo; }
constexpr double reflectance(const Mirror& s) { return s.reflectance; }
constexpr double reflectance(const Absorber&) { return 0.0; }

namespace detail {

/// Direction about the axis `n` with density cos θ/π from two numbers in (0, 1); the azimuth starts at `t1`.
inline Vec3d cosine_direction(const Vec3d& t1, const Vec3d& t2, const Vec3d& n, double u, double azimuth) {
  const double sine = std::sqrt(u);
  return (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + std::sqrt(1.0 - u) * n).normalized();
}

}  // namespace detail

/// Direction in which opaque surfaces send light: a unit vector for the incoming unit direction `d`, unit normal `n` on
/// the lit side, and two numbers in (0, 1). `mirror` (±1, ±1, 1) is the mirror image that the path belongs to: image
/// paths take image directions.
inline Vec3d reflected(const Lambertian&, const Vec3d&, const Vec3d& n, double u, double v, const Vec3d& mirror) {
  const Vec3d m = mirror.cwiseProduct(n);
  Vec3d t1, t2;
  tangents(m, t1, t2);
  return mirror.cwiseProduct(detail::cosine_direction(t1, t2, m, u, 2.0 * pi * v));
}
inline Vec3d reflected(const Mirror&, const Vec3d& d, const Vec3d& n, double, double, const Vec3d&) {
  return reflect(d, n);
}
inline Vec3d reflected(const Absorber&, const Vec3d&, const Vec3d& n, double, double, const Vec3d&) { return n; }

/// An opaque surface. Law: 0 ≤ reflectance ≤ 1, and reflected() stays on the lit side.
template <class S>
concept OpaqueSurface = requires(const S& s, const Vec3d& v) {
  { reflectance(s) } -> std::convertible_to<double>;
  { reflected(s, v, v, 0.5, 0.5, v) } -> std::convertible_to<Vec3d>;
};

static_assert(OpaqueSurface<Lambertian> && OpaqueSurface<Mirror> && OpaqueSurface<Absorber>);
static_assert(!OpaqueSurface<Dielectric>);

inline bool is_dielectric(const SurfaceOptics& s) { return std::holds_alternative<Dielectric>(s); }

/// Throws InvalidArgument for a reflectance outside [0, 1].
inline void validate(const SurfaceOptics& optics) {
  std::visit(
      [](const auto& s) {
        if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>)
          require_in_range("surface reflectance", reflectance(s), 0.0, 1.0, "");
      },
      optics);
}

}  // namespace lumo

#endif

// ---- lumo/optics/optical_scene.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_OPTICAL_SCENE_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_OPTICAL_SCENE_HPP

namespace lumo {

/// A body's surface in one state, per mesh node; each may be empty (undeformed; no contact; no slopes: normals are
/// recovered from the deformed faces alone).
struct SurfaceState {
  std::span<const Vec3d> displacement = {};    ///< [m]
  std::span<const double> contact_field = {};  ///< > 0 in contact, −infinity where there can be none
  std::span<const ContactSlope> tool_slopes = {}, carrier_slopes = {};
};

/// Place at which a ray met the scene.
struct ScenePoint {
  int face = -1;              ///< boundary face of the mesh; −1 on a carrier face
  double b1 = 0.0, b2 = 0.0;  ///< barycentric in the face (of corners 1 and 2)
  double u = 0.0, v = 0.0;    ///< barycentric in the flat triangle (of corners 1 and 2)
};

/// The surface of a body in one state, as light meets it: every face of the mesh cut into sub_facets² triangles on its
/// quadratic map, plus the carrier faces. Knows exact normals, regions, contact, and the optics of each face.
class OpticalScene {
 public:
  struct Config {
    int sub_facets = 3;  ///< each edge of a quadratic face is cut into this many; linear faces are not cut
    /// Carrier faces stand back by this, or by twice as far as the body is pressed into them if that is more.
    double carrier_gap_m = 20e-6;
    double carrier_cell_m = 2.5e-3;  ///< carrier faces are cut into cells of at most this size
  };

  /// `images`: also label regions for mirror images in the planes of this symmetry.
  /// Throws InvalidArgument for wrong sizes, numbers that are not finite (−infinity is allowed in the field), bad
  /// indices or optics, MeshError for patches off their shapes.
  OpticalScene(const Body& body, const TetMesh& mesh, const SurfaceState& state, Symmetry images, const Config& config)
      : body_(&body), n_(mesh.order == 2 ? config.sub_facets : 1) {
    require_in_range("sub-facets per edge", config.sub_facets, 1, 64, "");
    require_in_range("carrier gap", config.carrier_gap_m * 1e6, 0.0, 1000.0, "um");
    require_in_range("carrier cell", config.carrier_cell_m * 1e3, 1e-3, 1e6, "mm");
    if (mesh.order != 1 && mesh.order != 2)
      throw InvalidArgument(message("optical scene: mesh order ", mesh.order, ", must be 1 or 2"));
    for (const Patch& p : body.patches) validate(p.optics);
    for (const RigidFace& f : body.rigid_faces) validate(f.optics);
    validate(body.touched);
    if (body.regions > 0 && !body.region)
      throw InvalidArgument("optical scene: the body has regions but no region function");
    for (int i = 0; i < n_; ++i)
      for (int j = 0; i + j < n_; ++j) {
        lattice_.push_back({{{i, j}, {i + 1, j}, {i, j + 1}}});
        if (i + j + 1 < n_) lattice_.push_back({{{i + 1, j}, {i + 1, j + 1}, {i, j + 1}}});
      }
    add_faces(mesh, state);
    require_on_shapes(body, mesh);
    recover_normals(faces_, mesh.faces, body);
    body_triangles_ = triangles_.size();
    add_carrier(config);
    label(images);
  }

  const std::vector<SceneTriangle>& triangles() const { return triangles_; }

  /// Locates the point `p` [m] on triangle `t`.
  ScenePoint locate(int t, const Vec3d& p) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    const Vec3d e1 = b - a, e2 = c - a, n = e1.cross(e2);
    const double f = 1.0 / n.squaredNorm();
    // A triangle without area gives NaN, which becomes 0.
    const auto unit = [](double x) { return x > 0.0 ? std::min(x, 1.0) : 0.0; };
    double u = unit(f * n.dot((p - a).cross(e2))), v = unit(f * n.dot(e1.cross(p - a)));
    if (const double s = u + v; s > 1.0) {
      u /= s;
      v /= s;
    }
    ScenePoint r;
    r.u = u;
    r.v = v;
    if (!on_body(t)) return r;
    r.face = t / int(lattice_.size());
    const auto& l = lattice_[std::size_t(t) % lattice_.size()];
    r.b1 = (l[0][0] + u * (l[1][0] - l[0][0]) + v * (l[2][0] - l[0][0])) / n_;
    r.b2 = (l[0][1] + u * (l[1][1] - l[0][1]) + v * (l[2][1] - l[0][1])) / n_;
    return r;
  }
  /// Unit normal of triangle `t` (flat, outward).
  Vec3d flat_normal(int t) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    return (b - a).cross(c - a).normalized();
  }
  /// Unit outward normal of the deformed body.
  Vec3d smooth_normal(const ScenePoint& p) const { return faces_[std::size_t(p.face)].normal_at(p.b1, p.b2); }
  /// Undeformed position [m].
  Vec3d reference(const ScenePoint& p) const { return on_quadratic(faces_[std::size_t(p.face)].reference, p.b1, p.b2); }
  /// Deformed position on the quadratic map [m].
  Vec3d position(const ScenePoint& p) const { return on_quadratic(faces_[std::size_t(p.face)].deformed, p.b1, p.b2); }
  /// Optics that light inside the body meets under a tool.
  const SurfaceOptics& touched() const { return body_->touched; }
  /// Inside the contact set {φ > 0}, φ linear on the four sub-triangles of the face?
  bool in_contact(const ScenePoint& p) const { return faces_[std::size_t(p.face)].in_contact(p.b1, p.b2); }
  /// Region of the point, or of its mirror image `image` (bit 0: x → −x, bit 1: y → −y).
  int region(const ScenePoint& p, unsigned image) const {
    const int known = labels_[image][std::size_t(p.face)];
    if (known != mixed) return known;
    const Vec3d undeformed = reference(p);
    return region(
        faces_[std::size_t(p.face)].patch, undeformed, body_->regions_in_space ? position(p) : undeformed, image);
  }
  const SurfaceOptics& optics(int t) const {
    if (!on_body(t)) return body_->rigid_faces[std::size_t(rigid_[std::size_t(t) - body_triangles_])].optics;
    return body_->patches[std::size_t(faces_[std::size_t(t / triangles_per_face())].patch)].optics;
  }
  int triangles_per_face() const { return int(lattice_.size()); }
  /// How far a place on the body may be off its surface by rounding: a millionth of its size [m].
  double precision_m() const {
    double size = 0.0;
    for (const QuadraticFace& f : faces_)
      for (const Vec3d& p : f.reference) size = std::max(size, p.lpNorm<Eigen::Infinity>());
    return 1e-6 * size;
  }
  /// How far a node of the surface has moved, at most [m].
  double moved_m() const {
    double moved = 0.0;
    for (const QuadraticFace& f : faces_)
      for (std::size_t k = 0; k < f.reference.size(); ++k)
        moved = std::max(moved, (f.deformed[k] - f.reference[k]).norm());
    return moved;
  }
  bool on_body(int t) const { return std::size_t(t) < body_triangles_; }
  double triangle_area(int t) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    return 0.5 * (b - a).cross(c - a).norm();
  }
  double area(int face) const {
    double sum = 0.0;
    for (int k = 0; k < triangles_per_face(); ++k) sum += triangle_area(face * triangles_per_face() + k);
    return sum;
  }  ///< of its triangles [m²]
  /// May a point of a face, or of one of its mirror images, lie in a region while the body is undeformed?
  bool has_region(int face) const { return has_region_[std::size_t(face)] != 0; }
  std::size_t face_count() const { return faces_.size(); }
  /// Triangle of a face at barycentric (b1, b2), and the point of that (flat) triangle there [m].
  int triangle_at(int face, double b1, double b2, Vec3d& point) const {
    const double x = b1 * n_, y = b2 * n_;
    int i = std::clamp(int(x), 0, n_ - 1), j = std::clamp(int(y), 0, n_ - 1 - i);
    double u = x - i, v = y - j;
    const bool upper = u + v > 1.0 && i + j + 1 < n_;
    const int t = face * int(lattice_.size()) + 2 * n_ * i - i * i + 2 * j + (upper ? 1 : 0);
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    point = upper ? Vec3d((1.0 - v) * a + (u + v - 1.0) * b + (1.0 - u) * c) : Vec3d((1.0 - u - v) * a + u * b + v * c);
    return t;
  }
  /// Corners of a face, or of one of its sub-facets (sub ≥ 0), in the undeformed body [m].
  std::array<Vec3d, 3> reference_corners(int face, int sub) const {
    const std::array<Vec3d, 6>& x = faces_[std::size_t(face)].reference;
    if (sub < 0) return {x[0], x[1], x[2]};
    std::array<Vec3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& [i, j] = lattice_[std::size_t(sub)][k];
      corners[k] = on_quadratic(x, double(i) / n_, double(j) / n_);
    }
    return corners;
  }
  /// Corners of triangle `t` in the undeformed body; of a carrier face, where it stands without gap [m].
  std::array<Vec3d, 3> reference_corners(int t) const {
    if (!on_body(t)) return rigid_reference_[std::size_t(t) - body_triangles_];
    return reference_corners(t / triangles_per_face(), t % triangles_per_face());
  }
  /// Region of a place on a patch, undeformed and as it is now, or of its mirror image.
  int region(int patch, const Vec3d& reference, const Vec3d& position, unsigned image) const {
    if (!body_->region || !body_->patches[std::size_t(patch)].visible) return -1;
    const Vec3d mirror(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
    const Vec3d n = outward_normal(*body_, patch, reference);
    const int r =
        body_->region(mirror.cwiseProduct(body_->regions_in_space ? position : reference), mirror.cwiseProduct(n));
    return r >= 0 && r < body_->regions ? r : -1;
  }
  /// The region that light is seen in, if it leaves from there along `out`; −1: it is not seen.
  int seen_region(int region, const Vec3d& out) const { return body_->seen_towards.dot(out) < 0.0 ? -1 : region; }
  int patch_number(const ScenePoint& p) const { return faces_[std::size_t(p.face)].patch; }
  /// Number that distinguishes surfaces: the patch of a triangle of the body, or a carrier face.
  int surface_number(int t) const {
    return on_body(t) ? faces_[std::size_t(t / triangles_per_face())].patch
                      : int(body_->patches.size()) + rigid_[std::size_t(t) - body_triangles_];
  }
  /// A point a little inside the body from the point `p` on triangle `t`: towards the inside and the middle of the
  /// triangle.
  Vec3d pulled_inward(int t, const Vec3d& p) const {
    const std::array<Vec3d, 3>& corners = triangles_[std::size_t(t)].corners;
    const auto& [a, b, c] = corners;
    const double size = std::sqrt((b - a).cross(c - a).norm());
    return p + pull_sideways * ((a + b + c) / 3.0 - p) - pull_down * size * flat_normal(t);
  }

 private:
  static constexpr int mixed = -2;
  static constexpr double pull_sideways = 1e-4, pull_down = 1e-5;  ///< in sizes of a triangle
  void add_faces(const TetMesh& mesh, const SurfaceState& state) {
    const std::size_t nodes = mesh.nodes.size();
    const auto& [displacement, contact_field, tool_slopes, carrier_slopes] = state;
    const auto check_size = [&](std::size_t given, std::string_view what) {
      if (given != 0 && given != nodes)
        throw InvalidArgument(message("optical scene: ", given, " ", what, " for ", nodes, " nodes"));
    };
    check_size(displacement.size(), "displacements");
    check_size(contact_field.size(), "contact values");
    check_size(tool_slopes.size(), "slopes against the tool");
    check_size(carrier_slopes.size(), "slopes against the carrier");
    if (mesh.faces.empty()) throw InvalidArgument("optical scene: the mesh has no boundary faces");
    const double none = -std::numeric_limits<double>::infinity();
    faces_.reserve(mesh.faces.size());
    triangles_.reserve(mesh.faces.size() * lattice_.size());
    for (const BoundaryFace& face : mesh.faces) {
      if (face.patch < 0 || std::size_t(face.patch) >= body_->patches.size())
        throw InvalidArgument(
            message("optical scene: face of patch ", face.patch, ", the body has ", body_->patches.size()));
      QuadraticFace f;
      f.patch = face.patch;
      const Patch& patch = body_->patches[std::size_t(face.patch)];
      const std::span<const ContactSlope> slopes = patch.contactable     ? tool_slopes
                                                   : patch.meets_carrier ? carrier_slopes
                                                                         : std::span<const ContactSlope>{};
      const std::size_t given = mesh.order == 2 ? 6 : 3;
      for (std::size_t k = 0; k < given; ++k) {
        const std::size_t node = std::size_t(face.nodes[k]);
        if (face.nodes[k] < 0 || node >= nodes)
          throw InvalidArgument(message("optical scene: face with node ", face.nodes[k], " of ", nodes));
        f.reference[k] = mesh.nodes[node];
        f.deformed[k] = displacement.empty() ? mesh.nodes[node] : Vec3d(mesh.nodes[node] + displacement[node]);
        f.contact[k] = contact_field.empty() ? none : contact_field[node];
        if (!slopes.empty()) f.slope[k] = slopes[node];
        if (!f.deformed[k].allFinite() || !(f.deformed[k].cwiseAbs().maxCoeff() < largest_coordinate_m))
          throw InvalidArgument(message("optical scene: node ", node, " is not at a finite place below 1e6 m"));
        if (!(f.contact[k] < std::numeric_limits<double>::infinity()))
          throw InvalidArgument(message("optical scene: contact field of node ", node, " is ", f.contact[k]));
      }
      for (std::size_t k = given; k < 6; ++k) {
        const std::size_t a = k - 3, b = (a + 1) % 3;
        f.reference[k] = 0.5 * (f.reference[a] + f.reference[b]);
        f.deformed[k] = 0.5 * (f.deformed[a] + f.deformed[b]);
        f.contact[k] = 0.5 * (f.contact[a] + f.contact[b]);
        f.slope[k] = midway(f.slope[a], f.slope[b]);
      }
      f.leans = std::any_of(f.slope.begin(), f.slope.end(), [](const ContactSlope& s) {
        return s.weight > 0.0;
      }) && std::none_of(f.slope.begin(), f.slope.end(), [](const ContactSlope& s) { return s.normal.isZero(0.0); });
      f.may_touch = *std::max_element(f.contact.begin(), f.contact.end()) > 0.0;
      faces_.push_back(f);
      const auto at = [&](const std::array<int, 2>& k) {
        return lattice_point(f.deformed, face.nodes, n_, k[0], k[1]);
      };
      for (const auto& c : lattice_) triangles_.push_back({{at(c[0]), at(c[1]), at(c[2])}, false});
    }
  }
  // The cells are made on the face where it stands, and moved back as a whole: light that is spread over them sees the
  // same cells in every state.
  void add_carrier(const Config& config) {
    if (body_->rigid_faces.empty()) return;
    std::vector<Vec3d> soft;
    for (const QuadraticFace& f : faces_)
      if (is_dielectric(body_->patches[std::size_t(f.patch)].optics))
        soft.insert(soft.end(), f.deformed.begin(), f.deformed.end());
    std::vector<FaceFrame> frames;
    for (const RigidFace& face : body_->rigid_faces) frames.push_back(face_frame(face));
    // A body and the carrier that it rests on may cross a little, and light in the gap must still meet the carrier.
    std::vector<double> back = resting_depths(body_->rigid_faces, frames, soft);
    for (double& b : back) b = std::max(config.carrier_gap_m, 2.0 * b);
    const double rim = *std::max_element(back.begin(), back.end());
    for (std::size_t i = 0; i < body_->rigid_faces.size(); ++i) {
      const std::vector<Vec3d>& place = body_->rigid_faces[i].corners;
      const std::vector<Vec3d> corner = set_back(body_->rigid_faces[i], frames[i], back[i], rim);
      const auto cells = polygon_cells(place, config.carrier_cell_m);
      const auto moved = polygon_cells(corner, place, config.carrier_cell_m);
      for (std::size_t k = 0; k < cells.size(); ++k) {
        triangles_.push_back({moved[k], true});
        rigid_reference_.push_back(cells[k]);
        rigid_.push_back(int(i));
      }
    }
  }
  // Faces whose nodes share a region need no look-up at a hit; most do.
  void label(Symmetry images) {
    has_region_.assign(faces_.size(), 0);
    for (unsigned image = 0; image < 4; ++image) {
      if (((image & 1u) && !images.x) || ((image & 2u) && !images.y)) continue;
      for (std::size_t face = 0; face < faces_.size(); ++face) {
        const QuadraticFace& f = faces_[face];
        std::array<int, 6> r{};
        for (std::size_t k = 0; k < 6; ++k) {
          r[k] = region(f.patch, f.reference[k], f.deformed[k], image);
          const int undeformed =
              body_->regions_in_space ? region(f.patch, f.reference[k], f.reference[k], image) : r[k];
          has_region_[face] = has_region_[face] || undeformed != -1;
        }
        labels_[image].push_back(std::all_of(r.begin(), r.end(), [&](int x) { return x == r[0]; }) ? r[0] : mixed);
      }
    }
  }

  const Body* body_;
  int n_;                                                   ///< cuts per edge
  std::vector<std::array<std::array<int, 2>, 3>> lattice_;  ///< (b1, b2)·n of the corners of each sub-facet
  std::vector<QuadraticFace> faces_;
  std::vector<SceneTriangle> triangles_;
  std::vector<int> rigid_;  ///< carrier face of each triangle after those of the body
  std::vector<std::array<Vec3d, 3>> rigid_reference_;
  std::size_t body_triangles_ = 0;
  std::array<std::vector<int>, 4> labels_;  ///< per image and face: region, or `mixed`
  std::vector<char> has_region_;            ///< per face, undeformed: the same in all states
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/ray_pattern.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_RAY_PATTERN_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_RAY_PATTERN_HPP

namespace lumo {

/// How densely rays are sent along y: most where the body is pressed, since rays far from there find no change.
/// Default: evenly. A focus changes the error of a response, not its expected value. Compare responses of one focus
/// only: they share the rays.
struct RayFocus {
  double y_m = 0.0;
  double length_m = 0.0;     ///< the density falls by e over this distance; 0: nowhere
  double least = 1.0 / 8.0;  ///< of the density at y_m

  double density(double y) const {
    return length_m > 0.0 ? std::max(least, std::exp(-std::abs(y - y_m) / length_m)) : 1.0;
  }
  /// The same for y and −y?
  bool is_symmetric() const { return y_m == 0.0 || length_m == 0.0; }
};

/// A primary ray and what later events of its path draw their numbers from.
struct PrimaryRay {
  Vec3d origin{0.0, 0.0, 0.0};     ///< [m]
  Vec3d direction{0.0, 0.0, 1.0};  ///< unit
  std::uint64_t key = 0;           ///< the same for mirror images of a path
  int triangle = -1;               ///< of the scene that it starts on, if known
};

namespace detail {

/// Lengths below which two places of an emitter are one [m].
inline double place_tolerance(const Emitter& e) {
  return 1e-12 + 1e-9 * (e.point(0.1, 0.2) - e.point(0.9, 0.8)).norm();
}

/// Do two emitters radiate alike? Points and directions at some numbers are compared.
inline bool radiate_alike(const Emitter& a, const Emitter& b) {
  if (!a.same_model(b) || a.power_W() != b.power_W() || a.channel() != b.channel() || a.in_air() != b.in_air())
    return false;
  const double reach = place_tolerance(a);
  if ((a.center() - b.center()).norm() > reach || a.axis().dot(b.axis()) < 1.0 - 1e-12) return false;
  for (const auto& [u, v] : {std::pair(0.1, 0.2), std::pair(0.7, 0.1), std::pair(0.4, 0.9)})
    if ((a.point(u, v) - b.point(u, v)).norm() > reach) return false;
  for (double u : {0.05, 0.3, 0.5, 0.7, 0.95})
    if (std::abs(a.polar(u).cosine - b.polar(u).cosine) > 1e-12) return false;
  return true;
}

/// The mirror image with centre (and, in a plane, axis) in x ≥ 0, y ≥ 0.
inline Emitter fundamental(const Emitter& e, Vec3d& mirror) {
  const Vec3d center = e.center(), axis = e.axis();
  mirror = Vec3d::Ones();
  for (Eigen::Index a = 0; a < 2; ++a) {
    const bool in_plane = std::abs(center[a]) <= place_tolerance(e);
    if (in_plane ? axis[a] < -1e-9 : center[a] < 0.0) mirror[a] = -1.0;
  }
  return e.mirrored(mirror);
}

inline const Vec3d flip_x{-1.0, 1.0, 1.0}, flip_y{1.0, -1.0, 1.0};

}  // namespace detail

/// The one deterministic set of primary rays for all designs, states and emitters. Closed under x → −x and y → −y: a
/// point of the sequence makes a ray of the emitter moved to the quadrant x ≥ 0, y ≥ 0, and the rays of the real
/// emitters are its mirror images. An emitter that is its own mirror image shoots into a half or a quarter of the
/// hemisphere only, so that no ray is traced twice.
class RayPattern {
 public:
  /// The rays of one emitter that belong to one mirror image.
  struct Beam {
    Emitter source;  ///< moved to the fundamental quadrant
    Vec3d axis{0.0, 0.0, 1.0}, tangent1{1.0, 0.0, 0.0}, tangent2{0.0, 1.0, 0.0};
    double azimuth_from = 0.0, azimuth_range = 2.0 * pi;
    Vec3d mirror{1.0, 1.0, 1.0};  ///< (±1, ±1, 1): from the fundamental ray to the real one
    std::uint64_t orbit = 0;      ///< the same for emitters that are mirror images
    std::uint32_t rays = 0;       ///< per replicate
    double power_W = 0.0;         ///< per ray
  };

  /// `rays` per emitter and replicate, a power of two ≥ 4; with a focus about so many on average, each a power of two.
  /// `symmetry` keeps only one beam of each set of mirror images. Throws InvalidArgument for broken emitters, or
  /// if they do not have the symmetry.
  RayPattern(const std::vector<Emitter>& emitters, std::uint32_t rays, Symmetry symmetry, const RayFocus& focus = {}) {
    if (emitters.empty()) throw InvalidArgument("ray pattern: no emitters given, at least one is needed");
    for (const Emitter& e : emitters) e.validate();
    const Symmetry has = symmetry_of(emitters);
    if ((symmetry.x && !has.x) || (symmetry.y && !has.y))
      throw InvalidArgument("ray pattern: a symmetric state is claimed, but the emitters are not symmetric");
    double density = 0.0;
    for (const Emitter& e : emitters) density += focus.density(e.center().y()) / double(emitters.size());
    std::vector<Emitter> orbits;
    for (const Emitter& e : emitters) {
      Vec3d home;
      Beam beam{detail::fundamental(e, home)};
      const auto known = std::find_if(
          orbits.begin(), orbits.end(), [&](const auto& o) { return detail::radiate_alike(o, beam.source); });
      beam.orbit = std::uint64_t(known - orbits.begin());
      if (known == orbits.end()) orbits.push_back(beam.source);
      beam.source = orbits[beam.orbit];  // the very same bits for all images
      beam.axis = beam.source.axis();
      const bool own_x = detail::radiate_alike(beam.source.mirrored(detail::flip_x), beam.source);
      const bool own_y = detail::radiate_alike(beam.source.mirrored(detail::flip_y), beam.source);
      tangents(beam.axis, beam.tangent1, beam.tangent2);
      if (own_x || own_y) {
        beam.tangent1 = own_x ? Vec3d::UnitX() : Vec3d::UnitY();
        beam.tangent2 = beam.axis.cross(beam.tangent1);
        beam.azimuth_from = own_x && own_y ? 0.0 : -0.5 * pi;
        beam.azimuth_range = own_x && own_y ? 0.5 * pi : pi;
      }
      const std::uint32_t images = (own_x ? 2u : 1u) * (own_y ? 2u : 1u);
      const double wish = rays * focus.density(e.center().y()) / density;
      beam.rays = std::max(1u, std::max(4u, nearest_power_of_two(wish)) / images);
      beam.power_W = e.power_W() / double(beam.rays * images);
      for (std::uint32_t image = 0; image < 4; ++image) {
        if (((image & 1u) && !own_x) || ((image & 2u) && !own_y)) continue;
        beam.mirror = home;
        if (image & 1u) beam.mirror.x() = -beam.mirror.x();
        if (image & 2u) beam.mirror.y() = -beam.mirror.y();
        if ((symmetry.x && beam.mirror.x() < 0.0) || (symmetry.y && beam.mirror.y() < 0.0)) continue;
        beams_.push_back(beam);
      }
    }
  }

  const std::vector<Beam>& beams() const { return beams_; }

  /// Ray `index` of a beam, from numbers in (0, 1): angle to the axis and azimuth of its direction, then its place on
  /// the emitter.
  static PrimaryRay ray(const Beam& beam, const std::array<double, 4>& u, std::uint64_t seed, std::uint32_t index) {
    const double azimuth = beam.azimuth_from + beam.azimuth_range * u[1];
    const Polar polar = beam.source.polar(u[0]);
    const Vec3d d = (polar.sine * std::cos(azimuth) * beam.tangent1 + polar.sine * std::sin(azimuth) * beam.tangent2 +
                     polar.cosine * beam.axis)
                        .normalized();
    const Vec3d p = beam.source.point(u[2], u[3]);
    return {beam.mirror.cwiseProduct(p), beam.mirror.cwiseProduct(d), combine(combine(seed, beam.orbit), index), -1};
  }
  static PrimaryRay ray(const Beam& beam, const OwenSobol& sequence, std::uint32_t index) {
    return ray(beam, numbers(sequence, index), sequence.seed, index);
  }
  static std::array<double, 4> numbers(const OwenSobol& sequence, std::uint32_t index) {
    return {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)};
  }

  /// Is the set of emitters its own mirror image in each plane?
  static Symmetry symmetry_of(const std::vector<Emitter>& emitters) {
    const auto closed = [&](const Vec3d& m) {
      return std::all_of(emitters.begin(), emitters.end(), [&](const auto& e) {
        return std::any_of(emitters.begin(), emitters.end(),
            [&](const auto& other) { return detail::radiate_alike(e.mirrored(m), other); });
      });
    };
    return {closed(detail::flip_x), closed(detail::flip_y)};
  }

 private:
  std::vector<Beam> beams_;
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/face_set.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_FACE_SET_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_FACE_SET_HPP

namespace lumo {

/// A place to about a nanometre, for look-ups.
using PlaceKey = std::array<long long, 3>;

// The odd unit keeps round coordinates off the borders of its cells.
inline PlaceKey place_key(const Vec3d& p) {
  constexpr double unit = 1.0471975512e-9;
  return {std::llround(p.x() / unit), std::llround(p.y() / unit), std::llround(p.z() / unit)};
}

/// The mirror image of `p` with x ≥ 0 and y ≥ 0, as far as there is `symmetry`.
inline Vec3d folded(Vec3d p, Symmetry symmetry) {
  if (symmetry.x) p.x() = std::abs(p.x());
  if (symmetry.y) p.y() = std::abs(p.y());
  return p;
}

/// Some faces of the body, or triangles of the scene, each with a block of a low-discrepancy sequence as large as its
/// area asks for: points and directions on it that do not depend on the state, and are mirror images on faces that are
/// mirror images. Mirror images in a plane of `symmetry` are one face.
class FaceSet {
 public:
  struct Face {
    int face;                         ///< of the body; −1: a single triangle
    int triangle;                     ///< of the scene
    Vec3d mirror;                     ///< (±1, ±1, 1): from the image with x ≥ 0, y ≥ 0 to this face
    std::array<int, 3> corner_order;  ///< corners in an order that mirror images share
    std::uint32_t first = 0;          ///< place in the sequence of rays; the same for mirror images
    std::uint32_t count = 0;          ///< samples of this face, a power of two
  };

  /// How samples are spread over the faces.
  struct Sampling {
    bool whole = false;       ///< only faces of the body, each asked for with its first triangle; else all triangles
    double total = 0.0;       ///< about so many samples in all, counting mirror images that are not traced
    std::uint32_t least = 1;  ///< on each face
    RayFocus focus = {};      ///< more of them are here; must have the symmetry
    std::vector<double> density = {};  ///< per triangle, of samples, on average 1; empty: even
  };
  /// `wanted(triangle)` says which belong to the set.
  template <class Predicate>
  FaceSet(const OpticalScene& scene, Symmetry symmetry, const Sampling& sampling, Predicate&& wanted)
      : per_face_(scene.triangles_per_face()), member_(scene.face_count(), 0) {
    std::map<PlaceKey, int> known;  // folded by the symmetry → index
    // With x ≥ 0, and y ≥ 0 where mirror images have equally many samples; else y from the focus' side on, so that the
    // samples about mirrored foci are mirror images.
    std::vector<Vec3d> centers;
    std::vector<double> shares;  // undeformed area [m²] × density
    std::vector<int> images;     // faces folded onto each
    std::vector<bool> in_plane;
    const auto include = [&](int f, int triangle, const std::array<Vec3d, 3>& corner) {
      const Vec3d center = (corner[0] + corner[1] + corner[2]) / 3.0;
      Vec3d mirror = Vec3d::Ones();
      for (Eigen::Index a = 0; a < 2; ++a)
        if (center[a] < -1e-9) mirror[a] = -1.0;
      const bool fundamental = !(symmetry.x && mirror.x() < 0.0) && !(symmetry.y && mirror.y() < 0.0);
      Face face{f, triangle, mirror, {0, 1, 2}};
      std::sort(face.corner_order.begin(), face.corner_order.end(), [&](int a, int b) {
        return place_key(mirror.cwiseProduct(corner[std::size_t(a)])) <
               place_key(mirror.cwiseProduct(corner[std::size_t(b)]));
      });
      const auto [it, fresh] = known.try_emplace(place_key(folded(center, symmetry)), int(faces_.size()));
      const std::size_t k = std::size_t(it->second);
      if (fresh) {
        faces_.push_back(face);
        centers.push_back(folded(center, {true, sampling.focus.is_symmetric()}));
        if (sampling.focus.y_m < 0.0 && !sampling.focus.is_symmetric()) centers.back().y() *= -1.0;
        const double density = sampling.density.empty() ? 1.0 : sampling.density[std::size_t(triangle)];
        shares.push_back(0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm() *
                         sampling.focus.density(center.y()) * density);
        images.push_back(0);
        in_plane.push_back(std::abs(center.x()) < 1e-9 || std::abs(center.y()) < 1e-9);
      } else if (fundamental) {
        faces_[k] = face;
      }
      ++images[k];
    };
    for (int f = 0; sampling.whole && f < int(scene.face_count()); ++f)
      if (wanted(f * per_face_)) {
        include(f, -1, scene.reference_corners(f, -1));
        member_[std::size_t(f)] = 1;
      }
    for (int t = 0; !sampling.whole && t < int(scene.triangles().size()); ++t)
      if (wanted(t)) include(-1, t, scene.reference_corners(t));
    const int expected = (symmetry.x ? 2 : 1) * (symmetry.y ? 2 : 1);
    for (std::size_t k = 0; k < faces_.size(); ++k)
      if (images[k] != expected && !in_plane[k])
        throw InvalidArgument("optical scene: a symmetric state is claimed, but the surface mesh is not symmetric");
    number(centers, shares, images, sampling);
  }

  std::size_t size() const { return faces_.size(); }
  const Face& operator[](std::size_t k) const { return faces_[k]; }
  /// Does a point on the body lie on one of the faces?
  bool has(const ScenePoint& p) const { return p.face >= 0 && member_[std::size_t(p.face)]; }

  /// A point on a face.
  struct Sample {
    ScenePoint at;
    PrimaryRay ray;           ///< starts there; its direction is left open
    Vec3d normal;             ///< unit outward normal of the flat triangle
    double area = 0.0;        ///< that it stands for [m²]
    std::uint32_t index = 0;  ///< in the sequence
  };
  /// Sample `i` of face `k`. Takes dimensions 2 and 3 of the sequence; 0 and 1 are for its direction.
  Sample sample(std::size_t k, const OpticalScene& scene, const OwenSobol& sequence, std::uint32_t i) const {
    const Face& f = faces_[k];
    Sample x;
    x.index = f.first + i;
    const double s = std::sqrt(sequence(x.index, 2)), v = sequence(x.index, 3);
    std::array<double, 3> b{};
    b[std::size_t(f.corner_order[0])] = 1.0 - s;
    b[std::size_t(f.corner_order[1])] = s * (1.0 - v);
    b[std::size_t(f.corner_order[2])] = s * v;
    if (f.face >= 0) {
      x.ray.triangle = scene.triangle_at(f.face, b[1], b[2], x.ray.origin);
    } else {
      x.ray.triangle = f.triangle;
      const std::array<Vec3d, 3>& corners = scene.triangles()[std::size_t(x.ray.triangle)].corners;
      const auto& [p, q, r] = corners;
      x.ray.origin = b[0] * p + b[1] * q + b[2] * r;
    }
    x.ray.key = combine(sequence.seed, x.index);
    x.at = scene.locate(x.ray.triangle, x.ray.origin);
    const std::array<Vec3d, 3>& corners = scene.triangles()[std::size_t(x.ray.triangle)].corners;
    const auto& [p, q, r] = corners;
    const Vec3d normal = (q - p).cross(r - p);
    x.normal = normal.normalized();
    x.area = 0.5 * normal.norm() * (f.face >= 0 ? per_face_ : 1) / f.count;
    return x;
  }

 private:
  // Place along Morton's curve, 10 bits an axis; cells do not line up with regular grids.
  static std::uint64_t morton(const Vec3d& p) {
    std::uint64_t code = 0;
    for (int bit = 9; bit >= 0; --bit)
      for (Eigen::Index a = 0; a < 3; ++a)
        code = (code << 1) | ((std::uint64_t(std::clamp(p[a], 0.0, 1.0) * 1013.37 + 0.318) >> bit) & 1u);
    return code;
  }
  // Neighbours take neighbouring blocks of the sequence: together they are stratified more finely than each alone.
  void number(const std::vector<Vec3d>& centers, const std::vector<double>& shares, const std::vector<int>& images,
      const Sampling& sampling) {
    struct Block {
      std::uint64_t code = 0;
      std::uint32_t first = 0, count = 0;
    };
    Vec3d low = Vec3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    double all = 0.0;
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      low = elementwise_min(low, centers[k]);
      high = elementwise_max(high, centers[k]);
      all += shares[k] * images[k];
    }
    const double scale = faces_.empty() ? 1.0 : 1.0 / std::max(1e-12, (high - low).maxCoeff());
    std::map<PlaceKey, Block>
        blocks;  // what is found for one of two mirror images serves both: rounding could part them
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      const std::uint32_t count = std::max(sampling.least, nearest_power_of_two(sampling.total * shares[k] / all));
      blocks.try_emplace(place_key(centers[k]), Block{morton(scale * (centers[k] - low)), 0, count});
    }
    std::map<std::pair<std::uint64_t, PlaceKey>, Block*> order;
    for (auto& [place, block] : blocks) order[{block.code, place}] = &block;
    std::uint32_t next = 0;
    for (auto& [place, block] : order) {  // blocks of 2^m numbers start at multiples of 2^m: each is a net
      block->first = (next + block->count - 1) / block->count * block->count;
      next = block->first + block->count;
    }
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      const Block& block = blocks[place_key(centers[k])];
      faces_[k].first = block.first;
      faces_[k].count = block.count;
    }
  }

  int per_face_;  ///< sub-facets of a face
  std::vector<Face> faces_;
  std::vector<char> member_;  ///< per face of the body
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/film_launch.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_FILM_LAUNCH_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_FILM_LAUNCH_HPP

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

#endif

// ---- lumo/optics/transport/light_accounts.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_LIGHT_ACCOUNTS_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_LIGHT_ACCOUNTS_HPP

namespace lumo {

/// Power of some paths: booked, or arrived at nodes of Lambertian faces (index, power), from where it
/// goes on.
struct Tally {
  EnergyLedger ledger;
  std::vector<double> direct;    ///< part of the channels: direct light, but not what `gathered` has
  std::vector<double> gathered;  ///< part of the channels that NextEventGather finds with less noise
  std::vector<std::pair<int, double>> arrived;
};

/// Light from an emitter that left the body for good after reflections.
struct Exit {
  std::uint64_t route;  ///< the same for paths that met the same surfaces in the same way
  Escape light;         ///< of the traced one of the mirror images; its region is not looked up
  ScenePoint at;
  Vec3d normal;  ///< of the flat facet
  int patch;
  double power;  ///< [W], of one image
};

/// Accounts of the power of paths. A traced path stands for all its mirror images.
template <ExitReadout Readout> class LightAccounts {
 public:
  LightAccounts(const OpticalScene& surface, const Readout& readout, int channels, std::size_t nodes, Symmetry symmetry)
      : surface_(surface), readout_(readout), channels_(std::size_t(channels)), arrived_(nodes, 0.0) {
    for (unsigned image = 0; image < 4; ++image)
      if (!((image & 1u) && !symmetry.x) && !((image & 2u) && !symmetry.y)) images_.push_back(image);
    reset();
  }

  const std::vector<unsigned>& images() const { return images_; }
  std::size_t channels() const { return channels_; }

  /// `power` [W] of one image, for all of them.
  void book(double& account, double power) { account += power * double(images_.size()); }
  /// Light that falls on a Lambertian face.
  void arrive(int node, double power) {
    double& sum = arrived_[std::size_t(node)];
    if (!(sum > 0.0)) reached_.push_back(node);
    book(sum, power);
  }
  /// Books an exit in a channel, or elsewhere (−1). `power` is that of one image.
  void book_exit(int channel, double power) {
    (seen(channel) ? ledger.channels[std::size_t(channel)] : ledger.elsewhere) += power;
  }
  /// Books an exit of all images. `is_direct`: refracted out at most; `is_gathered`: NextEventGather finds it, too.
  void book_exit(const Exit& e, bool is_direct, bool is_gathered) {
    for (unsigned image : images_) {
      const int c = channel(e, image);
      book_exit(c, e.power);
      if (!seen(c)) continue;
      if (is_gathered) gathered_[std::size_t(c)] += e.power;
      else if (is_direct) direct_[std::size_t(c)] += e.power;
    }
  }
  /// Books what stays of light on an opaque patch, of all images. `power` is that of one.
  void book_landing(const Landing& l, double power) {
    for (unsigned image : images_) {
      int c = -1;
      if constexpr (LandingReadout<Readout>) {
        const Vec3d m = signs(image);
        c = readout_.landing_channel(
            {m.cwiseProduct(l.reference), m.cwiseProduct(l.position), m.cwiseProduct(l.direction), l.patch});
      }
      (seen(c) ? ledger.channels[std::size_t(c)] : ledger.absorbed_at_surfaces) += power;
    }
  }
  /// Channel of an exit, or −1.
  int channel(const Exit& e, unsigned image) const {
    const Vec3d m = signs(image);
    const Vec3d out = m.cwiseProduct(e.light.direction);
    const int region = e.at.face >= 0 ? surface_.region(e.at, image)
                                      : surface_.region(e.patch, e.light.reference, e.light.position, image);
    return readout_.channel(
        {m.cwiseProduct(e.light.reference), m.cwiseProduct(e.light.position), out, surface_.seen_region(region, out)});
  }

  /// All that was booked since the last call.
  Tally take() {
    Tally t{std::move(ledger), std::move(direct_), std::move(gathered_), {}};
    for (int k : reached_) {
      t.arrived.emplace_back(k, arrived_[std::size_t(k)]);
      arrived_[std::size_t(k)] = 0.0;
    }
    reached_.clear();
    reset();
    return t;
  }
  /// Σ weight(node)·(power that arrived there), for all that arrived since the last call; forgets everything else that
  /// was booked.
  template <class Weight> double collect(Weight&& weight) {
    double sum = 0.0;
    for (int k : reached_) {
      sum += weight(std::size_t(k)) * arrived_[std::size_t(k)];
      arrived_[std::size_t(k)] = 0.0;
    }
    reached_.clear();
    return sum;
  }

  EnergyLedger ledger;

 private:
  static Vec3d signs(unsigned image) { return {image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0}; }
  bool seen(int channel) const { return channel >= 0 && std::size_t(channel) < ledger.channels.size(); }
  void reset() {
    ledger = {};
    ledger.channels.assign(channels_, 0.0);
    direct_ = ledger.channels;
    gathered_ = ledger.channels;
  }

  const OpticalScene& surface_;
  const Readout& readout_;
  std::size_t channels_;
  std::vector<unsigned> images_;
  std::vector<double> direct_, gathered_;  ///< as in Tally
  std::vector<double> arrived_;            ///< per node
  std::vector<int> reached_;               ///< nodes with arrived_ > 0
};

}  // namespace lumo

#endif

// ---- lumo/optics/scattering_medium.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_SCATTERING_MEDIUM_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_SCATTERING_MEDIUM_HPP

namespace lumo {

/// A medium that also scatters light. transmittance() is the share that runs straight on; albedo() is the share of the
/// rest that is scattered. Laws: albedo in [0, 1]; free_path_m(path_m, u) is where light that does not pass `path_m`
/// ends, drawn with the density −dT/ds on [0, path_m]; scattering_cosine(u) is drawn from the phase function, which is
/// the same forwards and backwards (reciprocity).
template <class M>
concept TurbidMedium = TransparentMedium<M> && requires(const M& medium, double x) {
  { medium.albedo() } -> std::convertible_to<double>;
  { medium.free_path_m(x, x) } -> std::convertible_to<double>;
  { medium.scattering_cosine(x) } -> std::convertible_to<double>;
};

/// A turbid medium whose phase function is known as a density, too [1/sr], which scattering_cosine() draws from.
template <class M>
concept PhaseMedium = TurbidMedium<M> && requires(const M& medium, double cosine) {
  { medium.phase(cosine) } -> std::convertible_to<double>;
};

/// Exponential extinction, of which a share is scattering with Henyey and Greenstein's phase function
/// p(cos θ) = (1 − g²)/(4π (1 + g² − 2 g cos θ)^(3/2)), mean cosine g. It is BeerLambert for albedo 0, to the last
/// bit. Source: Henyey & Greenstein, Astrophys. J. 93 (1941); sampling: Witt, Astrophys. J. Suppl. 35 (1977).
class ScatteringMedium {
 public:
  /// Throws InvalidArgument unless index and extinction are BeerLambert's, the albedo lies in [0, 1] and the anisotropy
  /// in [−0.999, 0.999].
  explicit ScatteringMedium(const Medium& medium) : straight_(medium), medium_(medium) {
    require_in_range("scattering albedo", medium.scattering_albedo, 0.0, 1.0, "");
    require_in_range("anisotropy of scattering", medium.anisotropy, -0.999, 0.999, "");
  }

  double refractive_index() const { return straight_.refractive_index(); }
  template <class S> auto transmittance(const S& path_m) const { return straight_.transmittance(path_m); }
  double albedo() const { return medium_.scattering_albedo; }
  double free_path_m(double path_m, double u) const {
    const double depth = medium_.extinction_per_m * path_m;
    return depth > 0.0 ? std::clamp(-std::log1p(u * std::expm1(-depth)) / medium_.extinction_per_m, 0.0, path_m)
                       : u * path_m;
  }
  double scattering_cosine(double u) const {
    const double g = medium_.anisotropy, s = 2.0 * u - 1.0;
    constexpr double nearly_isotropic = 1e-4;  // below it the formula cancels: take its limit
    if (std::abs(g) < nearly_isotropic) return std::clamp(s + 1.5 * g * (1.0 - s * s), -1.0, 1.0);
    const double q = (1.0 - g * g) / (1.0 + g * s);
    return std::clamp((1.0 + g * g - q * q) / (2.0 * g), -1.0, 1.0);
  }
  double phase(double cosine) const {
    const double g = medium_.anisotropy, q = 1.0 + g * g - 2.0 * g * std::clamp(cosine, -1.0, 1.0);
    return (1.0 - g * g) / (4.0 * pi * q * std::sqrt(q));
  }

 private:
  BeerLambert straight_;
  Medium medium_;
};

static_assert(PhaseMedium<ScatteringMedium>);
static_assert(!TurbidMedium<BeerLambert>);

}  // namespace lumo

#endif

// ---- lumo/optics/transport/emitter_faces.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_EMITTER_FACES_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_EMITTER_FACES_HPP

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

#endif

// ---- lumo/optics/transport/ray_guide.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_RAY_GUIDE_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_RAY_GUIDE_HPP

namespace lumo {

/// Density of rays over the unit square of numbers that stand for the directions of an emitter (RayPattern::ray),
/// constant in cells. More rays go where light was found to change, as Neyman allots samples (1934), and each is worth
/// less for it.
class DirectionDensity {
 public:
  /// Cells in √(1 − u), the cosine to the axis under a cosine law, and in v, the azimuth.
  static constexpr std::size_t rows = 32, columns = 16, cells = rows * columns;

  /// `squares`: per cell, row by row, the sum of squares of what evenly sent rays brought.
  explicit DirectionDensity(const std::vector<double>& squares) {
    std::array<double, cells> mass{};
    double all = 0.0;
    for (std::size_t k = 0; k < cells; ++k) all += mass[k] = std::sqrt(squares[k] * area(k));
    for (std::size_t i = 0; i < rows; ++i) {
      std::array<double, columns>& along = along_[i];
      for (std::size_t j = 0; j < columns; ++j) {
        const std::size_t k = i * columns + j;
        density_[k] = all > 0.0 ? even + (1.0 - even) * mass[k] / (all * area(k)) : 1.0;
        along[j] = (j > 0 ? along[j - 1] : 0.0) + density_[k] * area(k);
      }
      up_[i] = (i > 0 ? up_[i - 1] : 0.0) + along.back();
    }
  }

  static std::size_t cell(double u, double v) {
    const auto index = [](double x, std::size_t n) { return std::min(std::size_t(x * double(n)), n - 1); };
    return index(1.0 - std::sqrt(1.0 - u), rows) * columns + index(v, columns);
  }

  struct Place {
    double u, v, density;  ///< the density is 1 on average
  };
  /// Takes evenly spread numbers in (0, 1) to this density, in their order.
  Place operator()(double u, double v) const {
    const auto [i, s] = locate(up_, u);
    const auto [j, t] = locate(along_[i], v);
    return {edge(i) + s * (edge(i + 1) - edge(i)), (double(j) + t) / columns, density_[i * columns + j]};
  }

 private:
  static constexpr double even = 0.3;  ///< share of the rays that goes everywhere, for what was not found

  /// Lower edge of a row, in u.
  static double edge(std::size_t row) {
    const double c = 1.0 - double(row) / rows;
    return 1.0 - c * c;
  }
  static double area(std::size_t cell) { return (edge(cell / columns + 1) - edge(cell / columns)) / columns; }
  struct Step {
    std::size_t index;
    double within;
  };
  /// The step of growing `sums` in which the share `x` of all lies.
  template <std::size_t N> static Step locate(const std::array<double, N>& sums, double x) {
    const double y = x * sums.back();
    const std::size_t k = std::min(std::size_t(std::upper_bound(sums.begin(), sums.end(), y) - sums.begin()), N - 1);
    const double below = k > 0 ? sums[k - 1] : 0.0;
    return {k, std::clamp((y - below) / (sums[k] - below), 0.0, 1.0)};
  }

  std::array<double, cells> density_{};
  std::array<double, rows> up_{};                          ///< rays up to the end of each row
  std::array<std::array<double, columns>, rows> along_{};  ///< likewise along each row
};

/// What some rays have shown of the light of a body and its states, for later traces on the same mesh. Responses that
/// are compared share it. Empty: nothing is known.
struct RayGuide {
  std::vector<std::vector<DirectionDensity>> directions;  ///< of emitters in air, per colour and orbit of RayPattern
  /// Power that a triangle sends on [W/m²], if it is Lambertian, of the undeformed body. Small bright faces beside
  /// emitters in air are rarely found backwards: paths start from them, in proportion to this.
  std::vector<double> sent_W_m2;
  double bright_W_m2 = 0.0;            ///< from which on that is done
  double area_m2 = 0.0, sent_W = 0.0;  ///< of these triangles in all
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/radiosity.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_RADIOSITY_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_RADIOSITY_HPP

namespace lumo {

/// Corners of all triangles of Lambertian surfaces, each with the function that is 1 there, 0 at its neighbours and
/// linear in between. Light that falls on such a surface is shared by the three nodes about it: shares vary
/// continuously with the place and add up to 1. Source: linear elements for radiosity, Heckbert (thesis, 1991). In a
/// plane of `symmetry` mirror images are one node.
class LightNodes {
 public:
  LightNodes(const OpticalScene& scene, Symmetry symmetry, const RayGuide& guide = {})
      : of_(scene.triangles().size(), std::array<int, 3>{-1, -1, -1}) {
    // Surfaces share a node where they are one patch, or cells of one plane of the carrier. Mirror images may be
    // patches of their own.
    std::map<PlaceKey, int> patch_at;
    const auto place = [&](int t) {
      const std::array<Vec3d, 3> corner = scene.reference_corners(t);
      return place_key(folded((corner[0] + corner[1] + corner[2]) / 3.0, symmetry));
    };
    for (int t = 0; t < int(of_.size()) && scene.on_body(t); ++t)
      if (std::holds_alternative<Lambertian>(scene.optics(t))) {
        const auto [it, fresh] = patch_at.try_emplace(place(t), scene.surface_number(t));
        it->second = std::min(it->second, scene.surface_number(t));
      }
    std::map<std::tuple<int, PlaceKey, PlaceKey, double>, int> known;
    for (int t = 0; t < int(of_.size()); ++t) {
      const SurfaceOptics& optics = scene.optics(t);
      const Lambertian* surface = std::get_if<Lambertian>(&optics);
      if (surface == nullptr) continue;
      const std::array<Vec3d, 3> corner = scene.reference_corners(t);
      Vec3d side = Vec3d::Zero();
      if (!scene.on_body(t)) {
        const Vec3d middle = (corner[0] + corner[1] + corner[2]) / 3.0;
        side = 1e-3 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
        if (symmetry.x && middle.x() < 0.0) side.x() = -side.x();
        if (symmetry.y && middle.y() < 0.0) side.y() = -side.y();
      }
      const int patch = scene.on_body(t) ? patch_at[place(t)] : -1;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto key = std::tuple(patch, place_key(folded(corner[k], symmetry)), place_key(side), surface->albedo);
        const auto [it, fresh] = known.try_emplace(key, int(albedo_.size()));
        if (fresh) {
          albedo_.push_back(surface->albedo);
          area_.push_back(0.0);
          in_air_.push_back(!scene.on_body(t));
        }
        of_[std::size_t(t)][k] = it->second;
        area_[std::size_t(it->second)] += scene.triangle_area(t) / 3.0;
      }
    }
    bright_.assign(size(), false);
    for (std::size_t t = 0; t < guide.sent_W_m2.size(); ++t)
      if (guide.sent_W_m2[t] > guide.bright_W_m2)
        for (int k : of_[t]) bright_[std::size_t(k)] = true;
  }

  std::size_t size() const { return albedo_.size(); }
  /// The three nodes of a triangle; −1: it is not Lambertian.
  const std::array<int, 3>& of(int triangle) const { return of_[std::size_t(triangle)]; }
  /// Shares of the nodes at a point of a triangle.
  static std::array<double, 3> shares(const ScenePoint& p) { return {1.0 - p.u - p.v, p.u, p.v}; }
  double albedo(std::size_t node) const { return albedo_[node]; }
  /// Integral of the node's function, over all its mirror images [m²].
  double area(std::size_t node) const { return area_[node]; }
  /// Light meets it in the surroundings, not in the body.
  bool in_air(std::size_t node) const { return in_air_[node]; }
  /// Its light is found by paths from it, not backwards from where it leaves.
  bool is_bright(std::size_t node) const { return bright_[node]; }

 private:
  std::vector<std::array<int, 3>> of_;
  std::vector<double> albedo_, area_;
  std::vector<bool> in_air_, bright_;
};

/// Form factors of the nodes of Lambertian faces, sampled: the way of one watt from each.
class RadiosityTransport {
 public:
  RadiosityTransport(std::size_t nodes, int channels) : sums_(nodes), weights_(nodes, 0.0) {
    for (Tally& t : sums_) {
      t.gathered.assign(std::size_t(channels), 0.0);
      t.ledger.channels = t.gathered;
    }
  }
  /// Adds what became of a ray of one watt that stands for the area `area_m2` about a point with these shares of the
  /// nodes.
  void add(const Tally& ray, const std::array<int, 3>& nodes, const std::array<double, 3>& shares, double area_m2) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double w = shares[k] * area_m2;
      Tally& sum = sums_[std::size_t(nodes[k])];
      weights_[std::size_t(nodes[k])] += w;
      add_scaled(sum.ledger, ray.ledger, w);
      for (std::size_t c = 0; c < sum.gathered.size(); ++c) sum.gathered[c] += w * ray.gathered[c];
      for (const auto& [j, power] : ray.arrived) sum.arrived.emplace_back(j, w * power);
    }
  }
  std::size_t size() const { return sums_.size(); }
  const Tally& sum(std::size_t node) const { return sums_[node]; }
  /// Factor that takes sum(node) to one watt; 0 if nothing was added.
  double per_watt(std::size_t node) const { return weights_[node] > 0.0 ? 1.0 / weights_[node] : 0.0; }

 private:
  std::vector<Tally> sums_;
  std::vector<double> weights_;
};

/// Light that falls on a Lambertian face goes on as a Lambertian source that is linear between nodes (radiosity: Goral
/// et al. 1984). The rays that a face sends do not depend on what arrives: states differ smoothly, and further bounces
/// cost no rays. Sends on what arrived at the nodes, bounce after bounce, until less than 1e-13 of the emitted power is
/// under way. `total`: the emitters' own tally, completed here. Returns the power that each node sent [W]. Jacobi
/// iteration of the radiosity equation p = e + Tᵀ(albedo·p); it ends because every factor is at most 1.
inline std::vector<double> solve_radiosity(const LightNodes& nodes, const RadiosityTransport& transport, Tally& total) {
  std::vector<double> now(nodes.size(), 0.0), next(nodes.size(), 0.0), sent(nodes.size(), 0.0);
  for (const auto& [k, power] : total.arrived) now[std::size_t(k)] += power;
  EnergyLedger& ledger = total.ledger;
  const double emitted = ledger.emitted;
  constexpr int most_bounces = 10000;
  constexpr double under_way = 1e-13;  // of the emitted power
  double left = 0.0;
  for (int bounce = 0; bounce < most_bounces; ++bounce) {
    left = 0.0;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const double on = now[k] * nodes.albedo(k);
      ledger.absorbed_at_surfaces += now[k] - on;
      sent[k] += on;
      const double each = on * transport.per_watt(k);
      if (each > 0.0)
        for (const auto& [j, share] : transport.sum(k).arrived) next[std::size_t(j)] += each * share;
    }
    for (double p : next) left += p;
    now.swap(next);
    std::fill(next.begin(), next.end(), 0.0);
    if (left < under_way * emitted) break;
  }
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const double each = sent[k] * transport.per_watt(k);
    add_scaled(ledger, transport.sum(k).ledger, each);
    if (nodes.is_bright(k)) continue;
    for (std::size_t c = 0; c < total.gathered.size(); ++c) total.gathered[c] += each * transport.sum(k).gathered[c];
  }
  ledger.emitted = emitted;
  ledger.lost += left;
  return sent;
}

}  // namespace lumo

#endif

// ---- lumo/optics/transport/path_tracer.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_PATH_TRACER_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_PATH_TRACER_HPP

namespace lumo {

/// A body in one state as its light meets it, and the readout: the input of all steps of a trace.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> struct LitBody {
  const OpticalScene& surface;
  const Scene& scene;
  const Medium& medium;
  double outer_index;  ///< refractive index of the surroundings
  const Readout& readout;
  int channels;             ///< of the readout
  const LightNodes& nodes;  ///< collect the light that falls on Lambertian faces
  const FaceSet& exits;     ///< faces whose light NextEventGather finds, if it came straight from an emitter or a face
  Symmetry symmetry;

  double index_ratio() const { return medium.refractive_index() / outer_index; }  ///< inside / outside
};

/// When paths end; see Tracer::Config.
struct PathLimits {
  double roulette_below, scattered_below;
  int max_events;
};

/// A primary ray, and what its path is traced for.
struct PathStart {
  PrimaryRay ray;
  Vec3d mirror;  ///< (±1, ±1, 1): the mirror image that the path belongs to
  double power_W;
  bool from_emitter = true;    ///< else from a Lambertian face
  bool inside = true;          ///< starts in the body, else in the air
  bool gathers_direct = true;  ///< NextEventGather finds the emitter's direct light
  bool gathers_all = false;    ///< NextEventGather finds all of the emitter's light
  /// Takes the exits of light from emitters that no gathering finds, instead of the channels, if given.
  std::vector<Exit>* exits = nullptr;
};

/// Follows one primary ray through all its branches and books where its power goes. One object per replicate.
/// The medium is a state of the ray, never inferred from counted hits.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class PathTracer {
 public:
  PathTracer(const LitBody<Scene, Medium, Readout>& body, const PathLimits& limits)
      : body_(body),
        limits_(limits),
        accounts_(body.surface, body.readout, body.channels, body.nodes.size(), body.symmetry) {}

  /// `emitters`: those that a path meets which runs backwards.
  void run(const PathStart& start, const EmitterFaces<Scene>* emitters = nullptr) {
    ++rays;
    start_ = &start;
    emitters_ = emitters;
    accounts_.book(accounts_.ledger.emitted, start.power_W);
    Branch first;
    first.origin = start.ray.origin;
    first.direction = start.ray.direction;
    first.power = start.power_W;
    first.key = start.ray.key;
    first.triangle = start.ray.triangle;
    first.direct = start.from_emitter;
    first.inside = start.inside;
    stack_.push_back(first);
    while (!stack_.empty()) {
      const Branch b = stack_.back();
      stack_.pop_back();
      follow(b);
    }
  }

  /// Power per path × π × radiance of emitters that backward paths met since the last call [W/m² for paths of 1].
  double take_emitted() { return std::exchange(emitted_, 0.0); }

  /// Accounts of the power.
  LightAccounts<Readout>& accounts() { return accounts_; }

  long rays = 0, segments = 0;

 private:
  struct Branch {
    Vec3d origin = Vec3d::Zero(), direction = Vec3d::Zero();
    double power = 0.0;
    std::uint64_t key = 0;
    int exit_triangle = -1;
    ScenePoint exit;  ///< where a ray in air left the body
    Vec3d exit_position = Vec3d::Zero();
    std::uint64_t route = 0;
    int triangle = -1;  ///< that it starts on
    int events = 0;
    bool inside = true;
    bool direct = true;         ///< light that was refracted out at most
    bool carrier_last = false;  ///< in air: met the carrier since it left the body
    bool scattered = false;     ///< in the medium, once at least
    bool spread = false;        ///< by a tool that wets the body: like a scattered one it has no neighbours
    double density = 0.0;       ///< of its direction [1/sr], if it was scattered and met no surface since
  };

  /// Light at a smooth interface.
  struct Split {
    FresnelSplit<double> share;
    Vec3d back, on;  ///< directions of the reflected and of the refracted ray
  };

  // Russian roulette. Its losses and gains have their own account, so that the ledger closes. False: ended.
  bool survives(Branch& b) {
    b.direct = false;
    if (!(b.power > 0.0)) return false;
    const double full = (b.scattered ? limits_.scattered_below : limits_.roulette_below) * start_->power_W;
    if (b.power >= full) return true;
    if (uniform(combine(b.key, 0)) * full < b.power) {
      accounts_.book(accounts_.ledger.roulette, b.power - full);
      b.power = full;
      return true;
    }
    accounts_.book(accounts_.ledger.roulette, b.power);
    return false;
  }

  // Route of the branch that is reflected at `triangle`; the refracted one has the next number.
  std::uint64_t route(const Branch& b, int triangle) const {
    return combine(b.route, 2 * std::uint64_t(body_.surface.surface_number(triangle)));
  }

  void escape(const Branch& b) {
    EnergyLedger& ledger = accounts_.ledger;
    if (b.exit.face < 0) return accounts_.book(ledger.elsewhere, b.power);
    const bool gathered = body_.exits.has(b.exit) && !b.carrier_last &&
                          (b.direct ? start_->gathers_direct : !start_->from_emitter || start_->gathers_all);
    // It has no neighbour to share with, or counts as direct light.
    const bool lone = b.scattered || b.spread || (b.direct && !start_->gathers_direct);
    const Escape light{body_.surface.reference(b.exit), b.exit_position, b.direction, -1};
    const Exit e{b.route, light, b.exit, body_.surface.flat_normal(b.exit_triangle), body_.surface.patch_number(b.exit),
        b.power};
    if (start_->exits != nullptr && start_->from_emitter && !gathered && !lone) start_->exits->push_back(e);
    else accounts_.book_exit(e, b.direct, gathered);
  }

  void follow(Branch b) {
    for (;;) {
      RayHit hit;
      if (++b.events <= limits_.max_events && b.direction.allFinite() && b.origin.allFinite()) {
        ++segments;
        hit = body_.scene.first_hit(b.origin, b.direction, b.inside);
        if (!hit && !b.inside) {
          meet_emitters(b, std::numeric_limits<double>::infinity());
          return escape(b);
        }
        if (!hit && b.triangle >= 0) {  // slipped out at an edge by rounding: once more from a point inside
          b.origin = body_.surface.pulled_inward(b.triangle, b.origin);
          hit = body_.scene.first_hit(b.origin, b.direction, b.inside);
        }
      }
      if (!hit) return accounts_.book(accounts_.ledger.lost, b.power);
      const auto& corner = body_.surface.triangles()[std::size_t(hit.triangle)].corners;
      const Vec3d n = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
      // Scenes may be in single precision: the distance again, in double.
      const double t = std::max(0.0, n.dot(corner[0] - b.origin) / n.dot(b.direction));
      const double path_m = std::isfinite(t) ? t : std::max(0.0, hit.t);
      meet_emitters(b, path_m);
      if (b.inside) {
        const double left = b.power * body_.medium.transmittance(path_m);
        double absorbed = b.power - left;
        if constexpr (TurbidMedium<Medium>) {
          const double scattered = body_.medium.albedo() * absorbed;
          absorbed -= scattered;
          scatter(b, path_m, scattered);
        }
        accounts_.book(accounts_.ledger.absorbed_in_medium, absorbed);
        b.power = left;
      }
      b.origin += path_m * b.direction;
      if (!meet(b, hit.triangle)) return;
    }
  }

  void meet_emitters(const Branch& b, double path_m) {
    if (emitters_ == nullptr) return;
    accounts_.book(emitted_, b.power * emitters_->exitance({b.origin, b.direction, path_m, b.inside, b.density},
                                           [&](double s) { return body_.medium.transmittance(s); }));
  }

  // Light that is scattered on a straight piece goes on from one place on it. The rest runs straight through as in a
  // clear medium, so that direct light and what is gathered backwards stay free of scattering's noise: there too, each
  // piece sends on both.
  void scatter(const Branch& b, double path_m, double power) {
    if constexpr (TurbidMedium<Medium>) {
      if (!(power > 0.0)) return;
      Branch c = b;
      c.power = power;
      c.key = combine(b.key, 6);
      c.scattered = true;
      if (!survives(c)) return;
      const Vec3d axis = start_->mirror.cwiseProduct(b.direction);  // image paths take image directions
      const double cosine = body_.medium.scattering_cosine(uniform(combine(c.key, 2))),
                   azimuth = 2.0 * pi * uniform(combine(c.key, 3));
      const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
      Vec3d t1, t2;
      tangents(axis, t1, t2);
      c.origin += body_.medium.free_path_m(path_m, uniform(combine(c.key, 4))) * b.direction;
      c.direction = start_->mirror.cwiseProduct(
          (sine * std::cos(azimuth) * t1 + sine * std::sin(azimuth) * t2 + cosine * axis).normalized());
      if constexpr (PhaseMedium<Medium>)
        if (emitters_ != nullptr) {
          const double u = uniform(combine(c.key, 7)), v = uniform(combine(c.key, 8));
          accounts_.book(emitted_, c.power * emitters_->scattered(c.origin, b.direction, body_.medium, u, v));
          c.density = body_.medium.phase(cosine);
        }
      stack_.push_back(c);
    }
  }

  // The event at a surface. True: `b` goes on.
  bool meet(Branch& b, int triangle) {
    const ScenePoint at = body_.surface.locate(triangle, b.origin);
    b.triangle = triangle;
    b.density = 0.0;
    const SurfaceOptics& optics = body_.surface.optics(triangle);
    if (is_dielectric(optics)) {
      if (at.face >= 0) return meet_dielectric(b, triangle, at);
      accounts_.book(accounts_.ledger.absorbed_at_surfaces, b.power);  // a carrier face is opaque, whatever it says
      return false;
    }
    // Light on a Lambertian face goes on with all other light that falls there.
    if (const auto& nodes = body_.nodes.of(triangle); nodes[0] >= 0 && b.inside == (at.face >= 0)) {
      const std::array<double, 3> share = LightNodes::shares(at);
      for (std::size_t k = 0; k < 3; ++k)
        if (share[k] > 0.0) accounts_.arrive(nodes[k], share[k] * b.power);
      return false;
    }
    b.carrier_last = !b.inside;
    const Vec3d normal = b.inside ? Vec3d(-body_.surface.flat_normal(triangle)) : body_.surface.flat_normal(triangle);
    const Vec3d came = b.direction;
    return reflect_off(b, optics, normal, [&](double power) {
      if (LandingReadout<Readout> && at.face >= 0)
        accounts_.book_landing({body_.surface.reference(at), b.origin, came, body_.surface.patch_number(at)}, power);
      else accounts_.book(accounts_.ledger.absorbed_at_surfaces, power);
    });
  }

  // Reflection off an opaque surface whose unit normal points back to where the light comes from. `absorb` is given
  // what stays there [W].
  template <class Absorb>
  bool reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3d& normal, Absorb&& absorb) {
    b.key = combine(b.key, 1);
    std::visit(
        [&](const auto& s) {
          if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) {
            const double kept = b.power * reflectance(s);
            absorb(b.power - kept);
            b.power = kept;
            b.direction = reflected(
                s, b.direction, normal, uniform(combine(b.key, 2)), uniform(combine(b.key, 3)), start_->mirror);
          }
        },
        optics);
    return survives(b);
  }

  bool meet_dielectric(Branch& b, int triangle, const ScenePoint& at) {
    const bool touched = body_.surface.in_contact(at);
    if (!b.inside && touched) {  // from air: the opaque indenter is in the way
      accounts_.book(accounts_.ledger.to_indenter, b.power);
      return false;
    }
    if (touched && !is_dielectric(body_.surface.touched())) return meet_wetting_tool(b, triangle, at);
    const Split met = split(b, triangle, at);
    const double reflected_power = b.power * met.share.reflectance;
    send_on(b, triangle, at, met, touched);
    b.direction = met.back;
    b.power = reflected_power;
    b.key = combine(b.key, 5);
    b.route = route(b, triangle);
    return survives(b);
  }

  // A tool that wets the body: no air is left between.
  bool meet_wetting_tool(Branch& b, int triangle, const ScenePoint& at) {
    const Vec3d flat = -body_.surface.flat_normal(triangle), curved = -body_.surface.smooth_normal(at);
    const bool specular = std::holds_alternative<Mirror>(body_.surface.touched());
    b.spread = b.spread || !specular;
    const bool smooth = specular && b.direction.dot(curved) < 0.0 && reflect(b.direction, curved).dot(flat) > 0.0;
    return reflect_off(b, body_.surface.touched(), smooth ? curved : flat,
        [&](double power) { accounts_.book(accounts_.ledger.to_indenter, power); });
  }

  Split split(const Branch& b, int triangle, const ScenePoint& at) const {
    const double side = b.inside ? -1.0 : 1.0;  // normals point back to where the light comes from
    const double ratio = b.inside ? body_.medium.refractive_index() / body_.outer_index
                                  : body_.outer_index / body_.medium.refractive_index();
    const Vec3d flat = side * Vec3d(body_.surface.flat_normal(triangle));
    Vec3d n = side * Vec3d(body_.surface.smooth_normal(at));
    Split met{};
    const auto turn = [&] {
      const double cosine = std::min(1.0, -b.direction.dot(n));
      met.share = fresnel(cosine, ratio);
      met.back = reflect(b.direction, n);
      met.on = refract(b.direction, n, ratio, met.share.cosine_behind);
      return cosine > 0.0 && met.back.dot(flat) > 0.0 && (met.share.reflectance >= 1.0 || met.on.dot(flat) < 0.0);
    };
    if (!turn()) {  // at grazing angles the curved normal may contradict the facet that was hit
      n = flat;
      turn();
    }
    return met;
  }

  // The refracted branch.
  void send_on(const Branch& b, int triangle, const ScenePoint& at, const Split& met, bool touched) {
    const double refracted_power = b.power - b.power * met.share.reflectance;
    if (!(refracted_power > 0.0)) return;
    if (b.inside && touched) return accounts_.book(accounts_.ledger.to_indenter, refracted_power);
    Branch c = b;
    c.direction = met.on;
    c.power = refracted_power;
    c.key = combine(b.key, 4);
    c.route = route(b, triangle) + 1;
    c.inside = !b.inside;
    if (c.inside) {
      if (!survives(c)) return;
    } else {
      c.exit = at;
      c.exit_triangle = triangle;
      c.exit_position = b.origin;
      c.carrier_last = false;
    }
    stack_.push_back(c);
  }

  const LitBody<Scene, Medium, Readout> body_;
  PathLimits limits_;
  LightAccounts<Readout> accounts_;
  std::vector<Branch> stack_;
  const PathStart* start_ = nullptr;               ///< of the path at hand
  const EmitterFaces<Scene>* emitters_ = nullptr;  ///< likewise
  double emitted_ = 0.0;
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/guide_lesson.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_GUIDE_LESSON_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_GUIDE_LESSON_HPP

namespace lumo {

/// Fills in what Lambertian faces send: `sent` by each of the nodes [W].
inline void learn_sent_light(
    const OpticalScene& surface, const LightNodes& nodes, const std::vector<double>& sent, RayGuide& guide) {
  constexpr double much_brighter = 4.0;  // than they are in their mean
  double power = 0.0, area = 0.0;
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    power += sent[k];
    area += nodes.area(k);
  }
  guide.bright_W_m2 = area > 0.0 ? much_brighter * power / area : 0.0;
  for (std::size_t t = 0; t < surface.triangles().size(); ++t) {
    double mean = 0.0;
    if (const auto& at = nodes.of(int(t)); at[0] >= 0) {
      for (int k : at) mean += sent[std::size_t(k)] / nodes.area(std::size_t(k)) / 3.0;
      const std::array<Vec3d, 3> corner = surface.reference_corners(int(t));
      const double here = 0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm();
      guide.area_m2 += here;
      guide.sent_W += here * mean;
    }
    guide.sent_W_m2.push_back(mean);
  }
}

/// Sends the same rays of emitters in air through the undeformed body and through its states, and keeps from where
/// their light changes.
class GuideLesson {
 public:
  GuideLesson(std::vector<RayPattern> patterns, const OwenSobol& sequence)
      : patterns_(std::move(patterns)), sequence_(sequence), squares_(patterns_.size()) {
    for (std::size_t c = 0; c < patterns_.size(); ++c)
      for (const RayPattern::Beam& beam : patterns_[c].beams()) {
        rays_ += beam.source.in_air() ? beam.rays : 0u;
        while (squares_[c].size() <= beam.orbit) squares_[c].emplace_back(DirectionDensity::cells);
      }
  }

  /// The undeformed body, first: what arrives at its Lambertian faces. `launch`: a FilmLaunch.
  template <class Path, class Launch> Tally undeformed(Path& path, const Launch& launch) {
    Tally all;
    bare_.resize(Eigen::Index(path.accounts().channels()), rays_);
    send(path, launch, [&](const Ray& ray, const Tally& tally, const Eigen::VectorXf& found) {
      bare_.col(ray.number) = found;
      all.arrived.insert(all.arrived.end(), tally.arrived.begin(), tally.arrived.end());
      all.ledger.emitted += tally.ledger.emitted;
    });
    return all;
  }

  /// A state. All count alike, however much light changes.
  template <class Path, class Launch> void state(Path& path, const Launch& launch) {
    std::vector<std::pair<double*, double>> changes;
    double sum = 0.0;
    send(path, launch, [&](const Ray& ray, const Tally&, const Eigen::VectorXf& found) {
      const double change = double((found - bare_.col(ray.number)).squaredNorm());
      if (!(change > 0.0)) return;
      changes.emplace_back(&squares_[ray.color][ray.orbit][ray.cell], change);
      sum += change;
    });
    for (const auto& [square, change] : changes) *square += change / sum;
  }

  std::vector<std::vector<DirectionDensity>> directions() const {
    std::vector<std::vector<DirectionDensity>> all;
    for (const auto& of_color : squares_) {
      all.emplace_back();
      for (const std::vector<double>& s : of_color) all.back().emplace_back(s);
    }
    return all;
  }

 private:
  struct Ray {
    Eigen::Index number;
    std::size_t color, orbit, cell;
  };

  template <class Path, class Launch, class Take> void send(Path& path, const Launch& launch, Take&& take) const {
    Eigen::Index number = 0;
    for (std::size_t c = 0; c < patterns_.size(); ++c)
      for (const RayPattern::Beam& beam : patterns_[c].beams())
        for (std::uint32_t i = 0; i < (beam.source.in_air() ? beam.rays : 0u); ++i, ++number) {
          launch(RayPattern::ray(beam, sequence_, i), beam.mirror.cwiseProduct(beam.axis),
              [&](const PrimaryRay& from, double share, bool inside) {
                path.run({.ray = from,
                    .mirror = beam.mirror,
                    .power_W = share * beam.power_W,
                    .inside = inside,
                    .gathers_direct = false});
              });
          const Tally tally = path.accounts().take();
          const auto& channels = tally.ledger.channels;
          take(Ray{number, c, std::size_t(beam.orbit), DirectionDensity::cell(sequence_(i, 0), sequence_(i, 1))}, tally,
              Eigen::Map<const Eigen::VectorXd>(channels.data(), Eigen::Index(channels.size())).template cast<float>());
        }
  }

  std::vector<RayPattern> patterns_;  ///< per colour
  OwenSobol sequence_;
  Eigen::Index rays_ = 0;
  Eigen::MatrixXf bare_;                                   ///< channels × rays [W]
  std::vector<std::vector<std::vector<double>>> squares_;  ///< per colour, orbit and cell
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/next_event.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_NEXT_EVENT_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_NEXT_EVENT_HPP

namespace lumo {

/// Emitters as paths of this body meet them.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout>
EmitterFaces<Scene> emitter_faces(const std::vector<Emitter>& emitters, const LitBody<Scene, Medium, Readout>& body,
    std::optional<double> film_closes_m) {
  const double ratio = body.index_ratio();
  return {emitters, body.scene, film_closes_m, ratio * ratio, body.surface.precision_m()};
}

/// Light that Lambertian faces, which sent `sent` W from their nodes, and `emitters`, if given, send along a path that
/// runs backwards: π times its radiance [W/m²], times n² if the path starts in the air (by Helmholtz's reciprocity
/// L/n² is kept but for Fresnel and extinction: Clausius 1864; Veach, thesis, 1997, ch. 5), per power of the path.
/// `counts(node)`: which nodes count.
template <class Path, RayScene Scene, TransparentMedium Medium, ExitReadout Readout, class Counts>
double gathered_light(const PathStart& start, const LitBody<Scene, Medium, Readout>& body, Path& path,
    const std::vector<double>& sent, const EmitterFaces<Scene>* emitters, Counts&& counts) {
  path.run(start, emitters);
  const double ratio = body.index_ratio();
  // From a face in air, light has gained n² of radiance on its way into the body: it comes out as it was sent.
  const double light = path.accounts().collect([&](std::size_t k) {
    return counts(k) ? (body.nodes.in_air(k) ? ratio * ratio : 1.0) * sent[k] / body.nodes.area(k) : 0.0;
  });
  return emitters == nullptr ? light : light + path.take_emitted();
}

/// Finds the light that leaves through faces with regions from those faces (next-event estimation), as few paths come
/// there. Direct light: points of the face × points of the emitters. Light of the carrier: a path from outside into the
/// body ends on Lambertian faces, whose light takes it backwards (gathered_light), scattered in the medium or not. A
/// readout behind openings is gathered from ways through them; then direct light is not, but a WholeReadout has all
/// light from emitters gathered, as its paths meet them. Points lie fixed in the undeformed body: no sample crosses the
/// border of a region that moves with it, so states differ smoothly.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class NextEventGather {
 public:
  NextEventGather(const std::vector<Emitter>& emitters, const LitBody<Scene, Medium, Readout>& body,
      PathTracer<Scene, Medium, Readout>& path, std::optional<double> film_closes_m)
      : body_(body), ratio_(body.index_ratio()), path_(path) {
    if (WholeReadout<Readout>) seen_.emplace(emitter_faces(emitters, body, film_closes_m));
    for (unsigned image = 0; image < 4; ++image) {
      if (!((image & 1u) && !body.symmetry.x) && !((image & 2u) && !body.symmetry.y)) images_.push_back(image);
      const Vec3d m = sign(image);
      for (const Emitter& e : emitters)
        if (e.has_intensity() && !e.in_air()) emitters_[image].push_back({e.mirrored(m), mirror(e.axis(), m)});
    }
  }

  /// Replaces the gathered part of the channels of `total`; `sent`: power of the nodes [W], their images included.
  void run(const OwenSobol& sequence, const std::vector<double>& sent, Tally& total) {
    if (body_.exits.size() == 0) return;
    direct_.assign(std::size_t(body_.channels), 0.0);
    diffuse_ = direct_;
    for (std::size_t k = 0; k < body_.exits.size(); ++k) {
      const std::uint32_t count = body_.exits[k].count, direct = (count + direct_every - 1) / direct_every;
      for (std::uint32_t i = 0; i < count; ++i) {
        FaceSet::Sample x = body_.exits.sample(k, body_.surface, sequence, i);
        if (body_.surface.in_contact(x.at)) continue;
        reference_ = body_.surface.reference(x.at);
        for (unsigned image : images_) region_[image] = body_.surface.region(x.at, image);
        Vec3d n = body_.surface.smooth_normal(x.at);
        if (!n.allFinite()) n = x.normal;
        if constexpr (ConnectedReadout<Readout>) {
          gather_connected(x, n, body_.exits[k].mirror, sequence, sent);
        } else {
          if (i % direct_every == 0) gather_direct(x, n, body_.exits[k].mirror, sequence, x.area * count / direct);
          gather_diffuse(x, n, body_.exits[k].mirror, sequence, sent);
        }
      }
    }
    path_.accounts().take();  // the paths ran backwards: their bookings are not power
    for (std::size_t c = 0; c < direct_.size(); ++c) {
      const double better = direct_[c] + diffuse_[c] - total.gathered[c];
      total.ledger.channels[c] += better;
      total.ledger.refinement -= better;
      total.direct[c] += direct_[c];
    }
  }

 private:
  struct Source {
    Emitter emitter;  ///< mirrored to the side of the fundamental face
    Vec3d axis;
  };

  /// Direct light is smooth in place: one point of this many is enough.
  static constexpr std::uint32_t direct_every = 2;

  static Vec3d mirror(const Vec3d& p, const Vec3d& m) { return m.cwiseProduct(p); }
  static Vec3d sign(unsigned image) { return {image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0}; }

  // Books `power` for every image, if the way out is free and the readout sees it.
  void book(std::vector<double>& account, const FaceSet::Sample& x, const Vec3d& out, double power) const {
    for (unsigned image : images_) {
      const int channel = channel_of(x, out, image);
      if (channel >= 0 && channel < body_.channels) account[std::size_t(channel)] += power;
    }
  }
  int channel_of(const FaceSet::Sample& x, const Vec3d& out, unsigned image) const {
    const Vec3d m = sign(image);
    const Vec3d goes = mirror(out, m);
    return body_.readout.channel(
        {mirror(reference_, m), mirror(x.ray.origin, m), goes, body_.surface.seen_region(region_[image], goes)});
  }
  bool seen(const FaceSet::Sample& x, const Vec3d& out) const {
    bool any = false;
    for (unsigned image : images_) any = any || channel_of(x, out, image) >= 0;
    return any && !body_.scene.first_hit(x.ray.origin, out, false);
  }

  void gather_direct(const FaceSet::Sample& x, const Vec3d& n, const Vec3d& m, const OwenSobol& sequence, double area) {
    const double u = sequence(x.index, 4), v = sequence(x.index, 5);
    for (const Source& s : emitters_[(m.x() < 0.0 ? 1u : 0u) + (m.y() < 0.0 ? 2u : 0u)]) {
      const Vec3d from = mirror(s.emitter.point(u, v), m), way = x.ray.origin - from;
      const double length = way.norm();
      const Vec3d d = way / length;
      const double intensity = s.emitter.intensity(d.dot(mirror(s.axis, m))), meets = d.dot(x.normal),
                   cosine = std::min(1.0, d.dot(n));
      if (!(intensity > 0.0 && meets > 0.0 && cosine > 0.0)) continue;
      const FresnelSplit<double> split = fresnel(cosine, ratio_);
      if (split.reflectance >= 1.0) continue;
      const Vec3d out = refract(d, -n, ratio_, split.cosine_behind);
      if (out.dot(x.normal) <= 0.0 || !seen(x, out)) continue;
      ++path_.segments;
      const RayHit hit = body_.scene.first_hit(from, d, true);
      if (!hit || hit.t < length - 1e-6 * length) continue;
      const double power = intensity * meets / (length * length) * area * (1.0 - split.reflectance);
      book(direct_, x, out, power * body_.medium.transmittance(length));
    }
  }

  void gather_diffuse(
      FaceSet::Sample& x, const Vec3d& n, const Vec3d& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    const Vec3d out = reflected(Lambertian{}, n, n, sequence(x.index, 0), sequence(x.index, 1), m);
    double weight = 0.0;
    if (out.dot(x.normal) <= 0.0 || !enter(x, n, out, weight) || !seen(x, out)) return;
    book(diffuse_, x, out, radiosity(x, m, weight, sent));
  }

  // Openings are not mirror images of each other: each image of the point has its own way out.
  void gather_connected(
      FaceSet::Sample& x, const Vec3d& n, const Vec3d& m, const OwenSobol& sequence, const std::vector<double>& sent) {
    for (unsigned image : images_)
      for (int k = 0; k < body_.readout.openings(); ++k) {
        const Connection way =
            body_.readout.connect(k, mirror(x.ray.origin, sign(image)), sequence(x.index, 0), sequence(x.index, 1));
        const Vec3d out = mirror(way.direction, sign(image));
        double weight = 0.0;
        if (!(way.solid_angle_sr > 0.0 && out.dot(x.normal) > 0.0 && out.dot(n) > 0.0) || !enter(x, n, out, weight))
          continue;
        const int channel = channel_of(x, out, image);
        if (channel < 0 || channel >= body_.channels || body_.scene.first_hit(x.ray.origin, out, false)) continue;
        diffuse_[std::size_t(channel)] += radiosity(x, m, weight * out.dot(n) * way.solid_angle_sr / pi, sent);
      }
  }

  // Turns the ray into the body, against light that leaves along `out`. `weight` [m²]: that light's power is
  // weight·radiosity of where in the body it comes from, if its directions have a cosine law. False: no such light.
  bool enter(FaceSet::Sample& x, const Vec3d& n, const Vec3d& out, double& weight) const {
    const FresnelSplit<double> split = fresnel(std::min(1.0, out.dot(n)), 1.0 / ratio_);
    if (split.reflectance >= 1.0) return false;
    x.ray.direction = refract(-out, n, 1.0 / ratio_, split.cosine_behind);
    const double slant = x.ray.direction.dot(x.normal) / x.ray.direction.dot(n);  // flat facet, curved normal
    if (!(x.ray.direction.dot(x.normal) < 0.0 && slant > 0.0)) return false;
    weight = x.area * slant * (1.0 - split.reflectance) / (ratio_ * ratio_);
    return true;
  }

  double radiosity(const FaceSet::Sample& x, const Vec3d& m, double weight, const std::vector<double>& sent) {
    return gathered_light(
        {.ray = x.ray, .mirror = m, .power_W = weight / double(images_.size()), .from_emitter = false}, body_, path_,
        sent, seen_ ? &*seen_ : nullptr, [&](std::size_t k) { return !body_.nodes.is_bright(k); });
  }

  const LitBody<Scene, Medium, Readout> body_;
  double ratio_;  ///< index inside / outside
  PathTracer<Scene, Medium, Readout>& path_;
  std::optional<EmitterFaces<Scene>> seen_;  ///< that paths meet
  std::vector<unsigned> images_;
  std::array<std::vector<Source>, 4> emitters_;
  std::vector<double> direct_, diffuse_;
  Vec3d reference_ = Vec3d::Zero();  ///< of the sample at hand
  std::array<int, 4> region_{};      ///< likewise, per image
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/splatting.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_SPLATTING_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_SPLATTING_HPP

namespace lumo {

/// Light from the emitters that reaches the readout by reflections, without the noise of rays that jump over borders of
/// regions: rays from one point of an emitter form a grid of directions, and where the three rays of a triangle of
/// neighbours go the same way, their power is spread over the triangle of their exits, linearly, and cut exactly at the
/// borders (beams: Heckbert & Hanrahan 1984). Rays whose neighbours go another way are booked where they are. All power
/// is kept; the error of spreading falls with the square of the grid's spacing.
template <class Path> class Splatting {
 public:
  explicit Splatting(Path& path) : path_(path) {}

  /// Traces all rays of a beam: grids of directions, each from one place on the emitter and shifted its own way. Places
  /// come in pairs opposite each other about the middle; places and shifts are a net. More rays make more
  /// places and finer grids.
  void run(const RayPattern::Beam& beam, const OwenSobol& sequence) {
    const std::uint32_t pairs =
        std::bit_floor(std::max(1u, std::uint32_t(std::sqrt(double(beam.rays)) / rays_per_pair)));
    const std::uint32_t places = std::min(beam.rays, 2u * pairs), directions = beam.rays / places;
    std::uint32_t rows = 1, columns = 1;  // in sin², in azimuth; cells of a full circle are made squarer
    while (rows * columns < directions) (columns < rows * (beam.azimuth_range > 2.0 ? 2u : 1u) ? columns : rows) *= 2u;
    const bool around = beam.azimuth_range > 6.0;
    for (std::uint32_t place = 0; place < places; ++place) {
      const double shift_u = sequence(place, 0), shift_v = sequence(place, 1), at_u = sequence(place / 2, 2),
                   at_v = sequence(place / 2, 3);
      const double place_u = place % 2 ? 1.0 - at_u : at_u, place_v = place % 2 ? 1.0 - at_v : at_v;
      exits_.clear();
      first_.assign(1, 0);
      for (std::uint32_t i = 0; i < rows; ++i)
        for (std::uint32_t j = 0; j < columns; ++j) {
          const std::array<double, 4> u{(i + shift_u) / rows, (j + shift_v) / columns, place_u, place_v};
          path_.run({.ray = RayPattern::ray(beam, u, sequence.seed, (place * rows + i) * columns + j),
              .mirror = beam.mirror,
              .power_W = beam.power_W,
              .gathers_direct = beam.source.has_intensity(),
              .exits = &exits_});
          first_.push_back(exits_.size());
        }
      left_.assign(exits_.size(), triangles_about);
      const auto at = [&](std::uint32_t i, std::uint32_t j) { return i * columns + j % columns; };
      for (std::uint32_t i = 0; i + 1 < rows; ++i)
        for (std::uint32_t j = 0; j + (around ? 0 : 1) < columns; ++j) {
          spread(at(i, j), at(i + 1, j), at(i, j + 1));
          spread(at(i + 1, j + 1), at(i, j + 1), at(i + 1, j));
        }
      for (std::size_t e = 0; e < exits_.size(); ++e)
        for (unsigned image : path_.accounts().images())
          if (left_[e] > 0)
            path_.accounts().book_exit(
                path_.accounts().channel(exits_[e], image), exits_[e].power * left_[e] / double(triangles_about));
    }
  }

 private:
  static constexpr int triangles_about = 6;      ///< an exit, in the grid of directions
  static constexpr int bisections = 12;          ///< for a crossing: 2⁻¹² of an edge
  static constexpr int deepest = 4;              ///< times that a triangle is quartered
  static constexpr double alike_cosine = 0.5;    ///< between the normals of exits that are neighbours
  static constexpr double rays_per_pair = 16.0;  ///< of places, as the root of the rays

  using Weights = std::array<double, 3>;  ///< of the three exits
  struct Corner {
    Weights at;
    int channel;
  };

  // Each exit has six triangles about it, and gives each a sixth of its power.
  void spread(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const auto alike = [&](std::uint32_t ray, const Exit& e) -> std::size_t {
      for (std::size_t k = first_[ray]; k < first_[ray + 1]; ++k)
        if (exits_[k].route == e.route && exits_[k].normal.dot(e.normal) > alike_cosine) return k;
      return exits_.size();
    };
    for (std::size_t k = first_[a]; k < first_[a + 1]; ++k) {
      const std::size_t l = alike(b, exits_[k]), m = alike(c, exits_[k]);
      if (l == exits_.size() || m == exits_.size()) continue;
      corner_ = {&exits_[k], &exits_[l], &exits_[m]};
      for (const std::size_t e : {k, l, m}) --left_[e];
      for (unsigned image : path_.accounts().images()) {
        image_ = image;
        std::array<Corner, 3> t;
        for (std::size_t n = 0; n < 3; ++n) {
          t[n] = {{}, path_.accounts().channel(*corner_[n], image)};
          t[n].at[n] = 1.0;
        }
        book(t[0], t[1], t[2], 1.0, 0);
      }
    }
  }

  static Weights mix(const Weights& a, const Weights& b, double t) {
    return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
  }
  int channel(const Weights& w) const {
    Exit e = *corner_[0];
    e.at.face = -1;  // between the rays: its place on the surface is not known
    for (Vec3d Escape::*part : {&Escape::reference, &Escape::position, &Escape::direction})
      e.light.*part =
          w[0] * (corner_[0]->light.*part) + w[1] * (corner_[1]->light.*part) + w[2] * (corner_[2]->light.*part);
    e.light.direction.normalize();
    return path_.accounts().channel(e, image_);
  }
  void book(const Weights& a, const Weights& b, const Weights& c, double area, int channel) {
    double power = 0.0;
    for (std::size_t n = 0; n < 3; ++n) power += (a[n] + b[n] + c[n]) / 3.0 * corner_[n]->power;
    path_.accounts().book_exit(channel, 0.5 * area * power);  // three exits give a sixth each
  }

  // `area`: share of the whole triangle. If one corner differs, the crossing is found on its two edges; else the
  // triangle is quartered.
  void book(const Corner& a, const Corner& b, const Corner& c, double area, int depth) {
    if (a.channel == b.channel && b.channel == c.channel) return book(a.at, b.at, c.at, area, a.channel);
    const Corner* odd = a.channel == b.channel   ? &c
                        : b.channel == c.channel ? &a
                        : a.channel == c.channel ? &b
                                                 : nullptr;
    const Corner *next = odd == &a ? &b : odd == &b ? &c : &a, *last = odd == &a ? &c : odd == &b ? &a : &b;
    if (odd != nullptr) {
      bool two = true;
      const auto crossing = [&](const Corner& other) {
        double low = 0.0, high = 1.0;
        for (int step = 0; step < bisections && two; ++step) {
          const double t = 0.5 * (low + high);
          const int here = channel(mix(odd->at, other.at, t));
          two = here == odd->channel || here == other.channel;
          (here == odd->channel ? low : high) = t;
        }
        return 0.5 * (low + high);
      };
      const double s = crossing(*next), t = two ? crossing(*last) : 0.0;
      if (two) {
        const Weights p = mix(odd->at, next->at, s), q = mix(odd->at, last->at, t);
        book(odd->at, p, q, area * s * t, odd->channel);
        book(p, next->at, last->at, area * (1.0 - s), next->channel);
        book(p, last->at, q, area * s * (1.0 - t), next->channel);
        return;
      }
    }
    if (depth == deepest) {
      for (const Corner* k : {&a, &b, &c}) book(k->at, k->at, k->at, area / 3.0, k->channel);
      return;
    }
    const auto middle = [&](const Corner& p, const Corner& q) {
      const Weights w = mix(p.at, q.at, 0.5);
      return Corner{w, channel(w)};
    };
    const Corner ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    book(a, ab, ca, area / 4.0, depth + 1);
    book(ab, b, bc, area / 4.0, depth + 1);
    book(ca, bc, c, area / 4.0, depth + 1);
    book(ab, bc, ca, area / 4.0, depth + 1);
  }

  Path& path_;
  std::vector<Exit> exits_;
  std::vector<std::size_t> first_;  ///< exit of each ray
  std::vector<int> left_;           ///< sixths of each exit that are not spread
  std::array<const Exit*, 3> corner_{};
  unsigned image_ = 0;
};

}  // namespace lumo

#endif

// ---- lumo/optics/view.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_VIEW_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_VIEW_HPP

namespace lumo {

/// A line from an eye outside of the body, and what the light on it counts.
struct SightLine {
  Vec3d origin{0.0, 0.0, 0.0};     ///< [m]
  Vec3d direction{0.0, 0.0, 1.0};  ///< unit, away from the eye
  double weight = 1.0;
};

/// Where light is looked for: lines of sight, pixel by pixel. Laws: a pure function; line(k, u) is a line of pixel k
/// for four numbers in (0, 1), and starts in the air.
template <class V>
concept View = requires(const V& view, int pixel, const std::array<double, 4>& u) {
  { view.pixels() } -> std::convertible_to<int>;
  { view.line(pixel, u) } -> std::same_as<SightLine>;
};

/// A state that is looked at, and the planes in which body and state are their own mirror images.
struct SeenState {
  SurfaceState surface = {};
  Symmetry symmetry = {};
};

/// How exactly a view is looked at.
struct ViewEffort {
  int samples = 16;  ///< lines a pixel, a multiple of the tracer's replicates, or a divisor of them
  /// As of Tracer::Config, of lines: lamps that are seen are a thousand times as bright as faces.
  double roulette_below = 2e-3;
};

/// What is seen of one state.
struct ViewLight {
  /// Mean of weight × radiance over the lines of a pixel [W/(m² sr)], replicates × (pixels of the first colour, then of
  /// the next). Replicate k of every state has the same rays: errors of differences come from the differences row by
  /// row.
  Eigen::MatrixXd replicates;
  EnergyLedger ledger;  ///< of the light that the emitters sent, mean over the replicates; its channels are empty

  std::vector<double> radiance() const {
    std::vector<double> mean(std::size_t(replicates.cols()), 0.0);
    for (Eigen::Index k = 0; k < replicates.cols(); ++k) mean[std::size_t(k)] = replicates.col(k).mean();
    return mean;
  }
  /// Standard errors of radiance(), from the scatter of the replicates.
  std::vector<double> error() const { return standard_error(replicates); }
};

}  // namespace lumo

#endif

// ---- lumo/optics/transport/view_gather.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_VIEW_GATHER_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRANSPORT_VIEW_GATHER_HPP

namespace lumo {

/// Finds the light on lines of sight: paths that start at an eye in the air and run backwards, as those of
/// NextEventGather do that start at a face.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class ViewGather {
 public:
  /// Light of one colour: what Lambertian nodes sent in each replicate [W], and the emitters.
  struct Color {
    std::vector<std::vector<double>> sent;
    EmitterFaces<Scene> emitters;
  };
  /// What lines of one pixel found, and lost.
  struct Pixel {
    std::vector<double> light;  ///< replicates of the first colour, then of the next
    double lines = 0.0, lost = 0.0;
  };

  ViewGather(const LitBody<Scene, Medium, Readout>& body, const PathLimits& limits, const std::vector<Color>& colors,
      std::uint64_t seed)
      : body_(body), path_(body, limits), colors_(colors), seed_(seed) {}

  /// `samples` lines for each of the replicates that has some.
  template <View V> Pixel operator()(const V& view, int pixel, int replicates, int samples) {
    Pixel found;
    found.light.assign(std::size_t(replicates) * colors_.size(), 0.0);
    const double ratio = body_.index_ratio(), images = double(path_.accounts().images().size());
    const OwenSobol sequence{combine(seed_, std::uint64_t(pixel))};
    for (int r = 0; r < replicates; ++r)
      for (int s = 0; s < samples; ++s) {
        const auto index = std::uint32_t(r * samples + s);
        const SightLine line =
            view.line(pixel, {sequence(index, 0), sequence(index, 1), sequence(index, 2), sequence(index, 3)});
        const PathStart start{.ray = {line.origin, line.direction, combine(sequence.seed, index), -1},
            .mirror = Vec3d::Ones(),
            .power_W = 1.0 / (ratio * ratio * images),  // of a line: n² of radiance is left in the body
            .from_emitter = false,
            .inside = false};
        for (std::size_t c = 0; c < colors_.size(); ++c) {
          const double light = gathered_light(start, body_, path_, colors_[c].sent[std::size_t(r)],
              &colors_[c].emitters, [](std::size_t) { return true; });
          found.light[c * std::size_t(replicates) + std::size_t(r)] += line.weight * light / (pi * samples);
        }
      }
    const Tally paths = path_.accounts().take();
    found.lines = paths.ledger.emitted;
    found.lost = paths.ledger.lost;
    return found;
  }

 private:
  const LitBody<Scene, Medium, Readout> body_;
  PathTracer<Scene, Medium, Readout> path_;
  const std::vector<Color>& colors_;
  std::uint64_t seed_;
};

}  // namespace lumo

#endif

// ---- lumo/optics/tracer.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_TRACER_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_TRACER_HPP

namespace lumo {

/// Planes in which body, mesh and emitters are their own mirror images.
inline Symmetry symmetry_of(const Body& body, const TetMesh& mesh) {
  const Symmetry s = RayPattern::symmetry_of(body.emitters), m = mesh.symmetry, b = body.symmetry;
  return {s.x && m.x && b.x, s.y && m.y && b.y};
}

/// Traces light from a body's emitters through its deformed shape to the channels of the readout.
///
/// Emitters in the medium (or in air beside it), both Fresnel branches at smooth interfaces, opaque carrier, straight
/// rays in air (model: paper §III). Channels of the response: those of the readout for the light of the first colour,
/// then for that of the next. A medium that scatters sends on light twice from each straight piece, straight and
/// scattered; steps 1 to 3 hold for both, but emitters' light that was scattered is neither spread nor gathered.
/// 1. trace_emitters: paths from the emitters, on a random grid or net of directions that is the same for every design,
///    state and emitter, until they are absorbed, leave for good, or fall on a Lambertian face. Light that leaves
///    through regions after reflections is spread between neighbouring paths (splatting.hpp).
/// 2. trace_faces: Lambertian faces, of the body and of the carrier seen through air, exchange their light, linear
///    between nodes (radiosity.hpp).
/// 3. Light that leaves through faces with regions is gathered backwards from them (next_event.hpp): direct light and
///    light of Lambertian faces. Channel by channel the paths' own light stays where it is better known
///    (choose_better). Steps 1 and 3 are plain forward tracing if exit_rays = 0.
/// Random numbers of later events are keyed by (path, event). Same arguments, same bits, whatever the thread; const and
/// thread-safe: run one state per task. Errors: of the integration, stated in the Response; of light that is linear
/// between nodes (scene.sub_facets, scene.carrier_cell_m), and of spreading, which are not in it.
template <TransparentMedium Medium = BeerLambert, ExitReadout Readout = ExitPower, Intersector Backend = Bvh>
class Tracer {
 public:
  struct Config {
    int rays_per_emitter = 1 << 16;  ///< over all replicates; a power of two
    int replicates = 8;          ///< independent scrambles of the pattern; a power of two ≥ 2, ≤ rays_per_emitter/4
    int carrier_rays = 1 << 15;  ///< over all replicates and Lambertian faces, by area; at least one on each triangle
    int exit_rays = 1 << 18;     ///< likewise over the faces with regions that light is gathered from; 0: not done
    double roulette_below = 0.02;  ///< branches below this share of their path's start weight may be ended
    double scattered_below = 0.5;  ///< the same for the many branches that were scattered in the medium
    int max_events = 4096;         ///< a branch that meets more surfaces is booked as lost
    /// Share of the emitted power beyond which a result is refused, if it is more than a few paths (lost_admitted).
    /// Only light that is caught for good, in a body that absorbs nothing, needs more.
    double largest_lost = EnergyLedger::largest_lost;
    std::uint64_t seed = 0;  ///< another number, another independent pattern
    OpticalScene::Config scene{};
  };

  Tracer() = default;
  explicit Tracer(const Config& config, const Readout& readout = {}, const Backend& backend = {})
      : config_(config), readout_(readout), backend_(backend) {}

  const Config& config() const { return config_; }

  /// Channels of the response: those of the readout for each colour; 0 without emitters.
  int channels(const Body& body) const { return color_count(body.emitters) * readout_.channels(body); }
  /// Channel → its mirror image in the plane across `axis` (0: x, 1: y). nullopt if the emitters are not symmetric or
  /// the readout does not know.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const {
    if constexpr (requires {
                    { readout_.image_channels(body, axis) } -> std::convertible_to<std::optional<std::vector<int>>>;
                  }) {
      const Symmetry light = RayPattern::symmetry_of(body.emitters);
      if (axis == 0 ? !light.x : !light.y) return std::nullopt;
      const std::optional<std::vector<int>> one = readout_.image_channels(body, axis);
      if (!one) return std::nullopt;
      std::vector<int> all;
      for (int color = 0; color < color_count(body.emitters); ++color)
        for (int c : *one) all.push_back(color * int(one->size()) + c);
      return all;
    } else {
      return std::nullopt;
    }
  }

  /// The same tracer with `factor` times as many rays of each kind, a power of two, and with an independent pattern for
  /// each number of `pattern`. Compare its responses with its own only. Throws InvalidArgument for a factor that is no
  /// power of two, or out of range.
  Tracer refined(double factor, std::uint64_t pattern = 0) const {
    require_in_range("refinement factor", factor, 1.0 / (1 << 12), double(1 << 12), "");
    int exponent = 0;
    if (std::frexp(factor, &exponent) != 0.5)
      throw InvalidArgument(message("refinement factor is ", factor, ", must be a power of two"));
    Tracer t = *this;
    Config& c = t.config_;
    const auto times = [&](int rays, int least) {
      return rays == 0 ? 0 : int(std::clamp(rays * factor, double(least), double(1 << 28)));
    };
    c.rays_per_emitter = times(c.rays_per_emitter, 4 * c.replicates);
    c.carrier_rays = times(c.carrier_rays, 1);
    c.exit_rays = times(c.exit_rays, 1);
    if (pattern > 0) c.seed = combine(config_.seed, pattern);
    return t;
  }

  /// Share of lost light up to which a result stands: a few paths may be lost, however few there are.
  double lost_admitted(const Body& body) const {
    constexpr double few = 10.0;
    return std::max(config_.largest_lost,
        few / (double(config_.rays_per_emitter) * double(std::max<std::size_t>(1, body.emitters.size()))));
  }

  /// `count` of the replicates from `first` on, as a tracer of its own: tasks that can run side by side. joined() makes
  /// of their responses that of all replicates, to the bit for the same division. A portion is not refused for what
  /// it loses: that is for require_closed() of the joined ledger.
  Tracer portion(int first, int count) const {
    Tracer t = *this;
    t.first_ = first_ + first;
    t.count_ = count;
    return t;
  }
  static Response joined(const std::vector<Response>& portions) {
    Response all;
    for (const Response& p : portions) {
      const Eigen::Index rows = all.replicates.rows(), more = p.replicates.rows();
      for (const auto& [sum, part] : {std::pair(&all.replicates, &p.replicates), std::pair(&all.direct, &p.direct),
               std::pair(&all.forward, &p.forward), std::pair(&all.forward_direct, &p.forward_direct)}) {
        sum->conservativeResize(rows + more, part->cols());
        sum->bottomRows(more) = *part;
      }
      all.ledgers.insert(all.ledgers.end(), p.ledgers.begin(), p.ledgers.end());
      all.rays += p.rays;
      all.segments += p.segments;
    }
    choose_better(all);
    return averaged(std::move(all));
  }

  /// Response of the undeformed body. Uses its symmetry when mesh and emitters share it.
  Response trace(const Body& body, const TetMesh& mesh) const {
    return trace(body, mesh, SurfaceState{}, symmetry_of(body, mesh));
  }

  /// Response of a mechanical state. `symmetry`: planes in which body *and* state are their own mirror images.
  Response trace(const Body& body, const TetMesh& mesh, const MechanicalState& state, Symmetry symmetry = {},
      const RayFocus& focus = {}, const RayGuide& guide = {}) const {
    return trace(body, mesh, surface_of(state), symmetry, focus, guide);
  }

  /// Response under `displacement` [m] and `contact_field` (> 0 in contact) per mesh node; either may be empty.
  Response trace(const Body& body, const TetMesh& mesh, const std::vector<Vec3d>& displacement,
      const std::vector<double>& contact_field, Symmetry symmetry = {}, const RayFocus& focus = {}) const {
    return trace(body, mesh, SurfaceState{displacement, contact_field}, symmetry, focus);
  }

  /// Response of a surface that is given node by node.
  /// One of two mirror images in a plane of `symmetry` is traced, and booked for both: the caller vouches for it.
  /// `focus` must have the symmetry; `guide` is of this body, mesh and tracer, and read-out through openings does
  /// without. Throws InvalidArgument for broken numbers, sizes or settings and for an emitter that lies out of the
  /// medium that it radiates into (by more than nodes have moved: LampPlaces), MeshError for patches off their shapes
  /// (require_on_shapes), NumericalError if light is lost (require_closed); never returns a NaN.
  Response trace(const Body& body, const TetMesh& mesh, const SurfaceState& state, Symmetry symmetry = {},
      const RayFocus& focus = {}, const RayGuide& guide = {}) const {
    check(body, symmetry, focus);
    const Medium medium{body.medium};
    const OpticalScene surface(body, mesh, state, symmetry, config_.scene);
    const auto scene = backend_.build(surface.triangles());
    using Scene = std::remove_const_t<decltype(scene)>;
    check(body, surface, scene, guide);
    const LightNodes nodes(surface, symmetry, guide);
    const FaceSet lambertian = sending_faces(body, surface, nodes, symmetry, guide),
                  exits = gathering_faces(surface, symmetry, focus);
    const int channels = readout_.channels(body), colors = color_count(body.emitters);
    const LitBody<Scene, Medium, Readout> lit{surface, scene, medium, BeerLambert(body.surroundings).refractive_index(),
        readout_, channels, nodes, exits, symmetry};
    PathTracer<Scene, Medium, Readout> path(lit, {config_.roulette_below, config_.scattered_below, config_.max_events});
    struct Color {
      RayPattern pattern;
      NextEventGather<Scene, Medium, Readout> gather;
    };
    std::vector<Color> light;
    for (int c = 0; c < colors; ++c) {
      const std::vector<Emitter> emitters = emitters_of(body, c);
      const auto rays = std::uint32_t(config_.rays_per_emitter / config_.replicates);
      light.push_back({RayPattern(emitters, rays, symmetry, focus), {emitters, lit, path, body.film_closes_m}});
    }

    const int count = count_ > 0 ? count_ : config_.replicates;
    Response response = unwritten(count, colors * channels, exits.size() > 0);
    for (int r = 0; r < count; ++r) {
      const auto sequence = [&](std::uint64_t use) {
        return OwenSobol{combine(config_.seed, 3 * std::uint64_t(first_ + r) + use)};
      };
      std::vector<Tally> totals;
      for (std::size_t c = 0; c < light.size(); ++c) {
        trace_emitters(lit, light[c].pattern, body.film_closes_m, sequence(0), path,
            guide.directions.empty() ? nullptr : &guide.directions[c]);
        totals.push_back(path.accounts().take());
      }
      const RadiosityTransport transport = trace_faces(lit, lambertian, sequence(1), path);
      for (int k = 0; k < colors; ++k) {
        Tally& total = totals[std::size_t(k)];
        const std::vector<double> direct = total.gathered;  // by emitters' paths
        const std::vector<double> sent = solve_radiosity(nodes, transport, total);
        book_forward(total, direct, r, k * channels, response);
        light[std::size_t(k)].gather.run(sequence(2), sent, total);
        book(total, r, k * channels, response);
      }
    }
    response.rays = path.rays;
    response.segments = path.segments;
    if (count_ == 0) choose_better(response);
    response = averaged(std::move(response));
    if (count_ == 0) require_closed(response.ledger, lost_admitted(body));
    return response;
  }

  /// Light on the lines of a view, of a body in one state: what its Lambertian faces send is found as for a response,
  /// and the lines' paths run backwards to them and to the emitters. Nothing else shines, and the tool is seen as the
  /// contact set only, black. Bit-identical for every executor. Throws as trace() does, and InvalidArgument for broken
  /// settings of the view and for emitters that cannot be seen.
  template <View V, Executor E> ViewLight look(const Body& body, const TetMesh& mesh, const SeenState& state,
      const V& view, const ViewEffort& effort, const E& executor) const {
    const Symmetry symmetry = state.symmetry;
    check(body, symmetry, {});
    const int replicates = check(body, view.pixels(), effort), samples = effort.samples / replicates;
    const Medium medium{body.medium};
    const OpticalScene surface(body, mesh, state.surface, symmetry, config_.scene);
    const auto scene = backend_.build(surface.triangles());
    using Scene = std::remove_const_t<decltype(scene)>;
    check(body, surface, scene, {});
    const LightNodes nodes(surface, symmetry);
    const FaceSet exits(surface, symmetry, {.whole = true}, [](int) { return false; });
    const LitBody<Scene, Medium, Readout> lit{surface, scene, medium, BeerLambert(body.surroundings).refractive_index(),
        readout_, readout_.channels(body), nodes, exits, symmetry};
    using Gather = ViewGather<Scene, Medium, Readout>;
    std::vector<typename Gather::Color> colors;
    for (int c = 0; c < color_count(body.emitters); ++c)
      colors.push_back({std::vector<std::vector<double>>(std::size_t(replicates)),
          emitter_faces(emitters_of(body, c), lit, body.film_closes_m)});
    ViewLight seen;
    seen.ledger = sent_light(body, lit, executor, colors);
    require_closed(seen.ledger, lost_admitted(body));
    const std::size_t pixels = std::size_t(view.pixels()), tasks = (pixels + pixels_together - 1) / pixels_together;
    seen.replicates.resize(replicates, Eigen::Index(pixels * colors.size()));
    std::vector<double> lines(tasks, 0.0), lost(tasks, 0.0);
    executor.for_each(tasks, [&](std::size_t task) {
      Gather gather(lit, {effort.roulette_below, config_.scattered_below, config_.max_events}, colors,
          combine(config_.seed, view_key));
      for (std::size_t k = task * pixels_together; k < std::min(pixels, (task + 1) * pixels_together); ++k) {
        const auto found = gather(view, int(k), replicates, samples);
        for (std::size_t c = 0; c < colors.size(); ++c)
          for (int r = 0; r < replicates; ++r)
            seen.replicates(r, Eigen::Index(c * pixels + k)) =
                found.light[c * std::size_t(replicates) + std::size_t(r)];
        lines[task] += found.lines;
        lost[task] += found.lost;
      }
    });
    require_lines_kept(lines, lost, pixels * std::size_t(effort.samples));
    if (!seen.replicates.allFinite()) throw NumericalError("light: a pixel of the view is not finite");
    return seen;
  }

  /// Learns how these states' light differs from that of the undeformed body, all on one mesh: empty unless emitters
  /// radiate into air. `symmetry`: planes in which body and all of the states are their own mirror images.
  RayGuide guide(const Body& body, const TetMesh& mesh, const std::vector<const MechanicalState*>& states,
      Symmetry symmetry = {}) const {
    check(body, symmetry, {});
    RayGuide learned;
    if (ConnectedReadout<Readout> ||
        std::none_of(body.emitters.begin(), body.emitters.end(), [](const Emitter& e) { return e.in_air(); }))
      return learned;
    std::vector<RayPattern> patterns;
    for (int c = 0; c < color_count(body.emitters); ++c)
      patterns.emplace_back(emitters_of(body, c), guide_rays, symmetry);
    const OwenSobol sequence{combine(config_.seed, guide_rays)};
    GuideLesson lesson(std::move(patterns), sequence);
    const Medium medium{body.medium};
    const int channels = readout_.channels(body);
    for (std::size_t k = 0; k <= states.size(); ++k) {
      const OpticalScene surface(
          body, mesh, k == 0 ? SurfaceState{} : surface_of(*states[k - 1]), symmetry, config_.scene);
      const auto scene = backend_.build(surface.triangles());
      using Scene = std::remove_const_t<decltype(scene)>;
      const LightNodes nodes(surface, symmetry);
      const FaceSet exits(surface, symmetry, {.whole = true}, [](int) { return false; });
      const LitBody<Scene, Medium, Readout> lit{surface, scene, medium,
          BeerLambert(body.surroundings).refractive_index(), readout_, channels, nodes, exits, symmetry};
      PathTracer<Scene, Medium, Readout> path(
          lit, {config_.roulette_below, config_.scattered_below, config_.max_events});
      const FilmLaunch launch(scene, body.film_closes_m);
      if (k > 0) {
        lesson.state(path, launch);
        continue;
      }
      Tally light = lesson.undeformed(path, launch);
      const RadiosityTransport transport =
          trace_faces(lit, sending_faces(body, surface, nodes, symmetry, {}), sequence, path);
      learn_sent_light(surface, nodes, solve_radiosity(nodes, transport, light), learned);
    }
    learned.directions = lesson.directions();
    return learned;
  }

 private:
  static constexpr std::uint32_t guide_rays = 1 << 16;  ///< of each emitter; far fewer learn chance
  static constexpr double sent_per_emitted = 4.0;       ///< rays a watt that bright faces send
  static constexpr std::uint64_t view_key = 5;          ///< of the lines' sequence
  static constexpr std::size_t pixels_together = 64;    ///< in one task

  static SurfaceState surface_of(const MechanicalState& state) {
    return {state.displacement, state.contact_field, state.tool_slopes, state.carrier_slopes};
  }
  static std::vector<Emitter> emitters_of(const Body& body, int color) {
    std::vector<Emitter> emitters;
    std::copy_if(body.emitters.begin(), body.emitters.end(), std::back_inserter(emitters),
        [&](const Emitter& e) { return e.channel() == color; });
    return emitters;
  }

  // Few paths lead through an opening: there light is gathered or not known.
  static Response unwritten(int rows, int columns, bool gathers) {
    Response r;
    r.replicates.resize(rows, columns);
    r.direct.resize(rows, columns);
    r.ledgers.resize(std::size_t(rows));
    if (gathers && !ConnectedReadout<Readout>) r.forward_direct = r.forward = r.replicates;
    return r;
  }
  // Power, error and ledger from the replicates.
  static Response averaged(Response response) {
    response.ledger = {};
    for (const EnergyLedger& one : response.ledgers)
      add_scaled(response.ledger, one, 1.0 / double(response.ledgers.size()));
    for (Eigen::Index c = 0; c < response.replicates.cols(); ++c)
      response.ledger.channels.push_back(response.replicates.col(c).mean());
    response.power_W = response.ledger.channels;
    response.error_W = standard_error(response.replicates);
    return response;
  }

  /// Throws InvalidArgument unless settings, body and focus can be traced.
  void check(const Body& body, Symmetry symmetry, const RayFocus& focus) const {
    const auto power_of_two = [](const char* what, int value, int low) {
      require_in_range(what, value, low, 1 << 28, "");
      if (!std::has_single_bit(unsigned(value)))
        throw InvalidArgument(message(what, " is ", value, ", must be a power of two"));
    };
    power_of_two("replicates", config_.replicates, 2);
    power_of_two("rays per emitter", config_.rays_per_emitter, 4 * config_.replicates);
    require_in_range("carrier rays", config_.carrier_rays, 1, 1 << 30, "");
    require_in_range("exit rays", config_.exit_rays, 0, 1 << 30, "");
    require_in_range("roulette_below", config_.roulette_below, 0.0, 1.0, "");
    require_in_range("scattered_below", config_.scattered_below, 1e-4, 1.0, "");  // each piece sends on two
    require_in_range("max_events", config_.max_events, 1, 1 << 28, "");
    require_in_range("largest share of lost light", config_.largest_lost, 0.0, 1.0, "");
    if (body.surroundings.extinction_per_m != 0.0)
      throw InvalidArgument(
          message("surroundings extinguish ", body.surroundings.extinction_per_m, " 1/m, only 0 1/m is known"));

    require_in_range("focus of the rays", focus.y_m, -1e3, 1e3, "m");
    require_in_range("length of the rays' focus", focus.length_m, 0.0, 1e3, "m");
    require_in_range("least density of rays", focus.least, 1e-6, 1.0, "");
    if (symmetry.y && !focus.is_symmetric())
      throw InvalidArgument(
          message("rays are focussed on y = ", focus.y_m * 1e3, " mm, must be 0 mm in a state that is symmetric in y"));
    validate(body.emitters);
    require_in_range("readout channels", readout_.channels(body), 0, 1 << 18, "");
  }
  /// Replicates that lines of a view are divided by. Throws InvalidArgument.
  int check(const Body& body, int pixels, const ViewEffort& effort) const {
    require_in_range("pixels of a view", pixels, 1, 1 << 26, "");
    require_in_range("samples per pixel", effort.samples, 1, 1 << 20, "");
    require_in_range("roulette_below of a view", effort.roulette_below, 0.0, 1.0, "");
    const int replicates = std::min(config_.replicates, effort.samples);
    if (effort.samples % replicates != 0 || config_.replicates % replicates != 0)
      throw InvalidArgument(message("samples per pixel are ", effort.samples, ", must be a multiple of ",
          config_.replicates, ", or a power of two below"));
    for (const Emitter& e : body.emitters)
      if (!e.can_be_seen())
        throw InvalidArgument("view: an emitter has no area or no known shape, so that no line of sight meets it");
    return replicates;
  }
  /// Throws NumericalError if more light than admitted is lost on lines of sight.
  void require_lines_kept(const std::vector<double>& lines, const std::vector<double>& lost, std::size_t count) const {
    constexpr double few = 10.0;
    const double all = std::accumulate(lines.begin(), lines.end(), 0.0),
                 gone = std::accumulate(lost.begin(), lost.end(), 0.0),
                 admitted = std::max(config_.largest_lost, few / double(count));
    if (!(gone <= admitted * all))
      throw NumericalError(message("light: ", gone / all, " of the lines of sight are lost, at most ", admitted,
          ": the surface is open, or max_events is too small"));
  }
  /// Finds what Lambertian faces send in each replicate, colour by colour. Returns the mean ledger.
  template <class Scene, Executor E, class Color> EnergyLedger sent_light(const Body& body,
      const LitBody<Scene, Medium, Readout>& lit, const E& executor, std::vector<Color>& colors) const {
    const FaceSet lambertian = sending_faces(body, lit.surface, lit.nodes, lit.symmetry, {});
    std::vector<RayPattern> patterns;
    for (std::size_t c = 0; c < colors.size(); ++c)
      patterns.emplace_back(
          emitters_of(body, int(c)), std::uint32_t(config_.rays_per_emitter / config_.replicates), lit.symmetry);
    std::vector<EnergyLedger> ledgers(colors.front().sent.size());
    executor.for_each(ledgers.size(), [&](std::size_t r) {
      const auto sequence = [&](std::uint64_t use) { return OwenSobol{combine(config_.seed, 3 * r + use)}; };
      PathTracer<Scene, Medium, Readout> path(
          lit, {config_.roulette_below, config_.scattered_below, config_.max_events});
      const RadiosityTransport transport = trace_faces(lit, lambertian, sequence(1), path);
      for (std::size_t c = 0; c < colors.size(); ++c) {
        trace_emitters(lit, patterns[c], body.film_closes_m, sequence(0), path, nullptr);
        Tally total = path.accounts().take();
        colors[c].sent[r] = solve_radiosity(lit.nodes, transport, total);
        for (const double w : total.ledger.channels) total.ledger.elsewhere += w;
        total.ledger.channels.clear();
        add_scaled(ledgers[r], total.ledger, 1.0);
      }
    });
    EnergyLedger mean;
    for (const EnergyLedger& one : ledgers) add_scaled(mean, one, 1.0 / double(ledgers.size()));
    return mean;
  }
  /// Throws InvalidArgument unless lamps and guide fit the scene.
  template <class Scene>
  static void check(const Body& body, const OpticalScene& surface, const Scene& scene, const RayGuide& guide) {
    LampPlaces<Scene>(surface.triangles(), scene, surface.precision_m(), surface.moved_m()).require(body.emitters);
    if (!guide.sent_W_m2.empty() && guide.sent_W_m2.size() != surface.triangles().size())
      throw InvalidArgument(
          message("ray guide for ", guide.sent_W_m2.size(), " triangles, the scene has ", surface.triangles().size()));
  }
  template <class Scene> void trace_emitters(const LitBody<Scene, Medium, Readout>& body, const RayPattern& pattern,
      std::optional<double> film_closes_m, const OwenSobol& sequence, PathTracer<Scene, Medium, Readout>& path,
      const std::vector<DirectionDensity>* densities) const {
    constexpr bool connected = ConnectedReadout<Readout>;  // an opening is too small to be found between rays
    const FilmLaunch launch(body.scene, film_closes_m);
    Splatting splatting(path);
    for (const RayPattern::Beam& beam : pattern.beams()) {
      const bool air = beam.source.in_air();
      if (config_.exit_rays > 0 && !connected && !air) {
        splatting.run(beam, sequence);
        continue;
      }
      // Few ways from a face and an emitter lead through an opening.
      const bool all = WholeReadout<Readout> && config_.exit_rays > 0 && beam.source.can_be_seen(),
                 direct = all || (!connected && beam.source.has_intensity() && !air);
      double worth = 1.0;  // of the ray at hand, in those that are sent evenly
      const auto start = [&](const PrimaryRay& ray, double share, bool inside) {
        path.run({.ray = ray,
            .mirror = beam.mirror,
            .power_W = share * worth * beam.power_W,
            .inside = inside,
            .gathers_direct = direct,
            .gathers_all = all});
      };
      for (std::uint32_t i = 0; i < beam.rays; ++i) {
        std::array<double, 4> u = RayPattern::numbers(sequence, i);
        worth = 1.0;
        if (air && densities != nullptr) {
          const DirectionDensity::Place place = (*densities)[beam.orbit](u[0], u[1]);
          u[0] = place.u;
          u[1] = place.v;
          worth = 1.0 / place.density;
        }
        const PrimaryRay ray = RayPattern::ray(beam, u, sequence.seed, i);
        if (air) launch(ray, beam.mirror.cwiseProduct(beam.axis), start);
        else start(ray, 1.0, true);
      }
    }
  }
  /// Faces with regions, or seen through openings, that light is gathered from.
  FaceSet gathering_faces(const OpticalScene& surface, Symmetry symmetry, const RayFocus& focus) const {
    const double rays = double(config_.exit_rays) / config_.replicates;
    return FaceSet(surface, symmetry, {.whole = true, .total = rays, .least = 2, .focus = focus}, [&](int t) {
      return config_.exit_rays > 0 && is_dielectric(surface.optics(t)) &&
             (ConnectedReadout<Readout> || surface.has_region(t / surface.triangles_per_face()));
    });
  }
  /// Lambertian faces, with rays by area and, as far as is known, by the light that falls there.
  FaceSet sending_faces(const Body& body, const OpticalScene& surface, const LightNodes& nodes, Symmetry symmetry,
      const RayGuide& guide) const {
    FaceSet::Sampling sampling{.total = double(config_.carrier_rays) / config_.replicates};
    if (!guide.sent_W_m2.empty()) {
      double emitted = 0.0;
      for (const Emitter& e : body.emitters) emitted += e.power_W();
      const double per_watt = sent_per_emitted * double(config_.rays_per_emitter) * double(body.emitters.size()) /
                              config_.replicates / emitted;
      for (double w : guide.sent_W_m2) sampling.density.push_back(sampling.total / guide.area_m2 + per_watt * w);
      sampling.total += per_watt * guide.sent_W;
    }
    return FaceSet(surface, symmetry, sampling, [&](int t) { return nodes.of(t)[0] >= 0; });
  }
  template <class Scene> RadiosityTransport trace_faces(const LitBody<Scene, Medium, Readout>& body,
      const FaceSet& lambertian, const OwenSobol& sequence, PathTracer<Scene, Medium, Readout>& path) const {
    const double images = (body.symmetry.x ? 2.0 : 1.0) * (body.symmetry.y ? 2.0 : 1.0);
    RadiosityTransport transport(body.nodes.size(), body.channels);
    for (std::size_t k = 0; k < lambertian.size(); ++k)
      for (std::uint32_t i = 0; i < lambertian[k].count; ++i) {
        FaceSet::Sample x = lambertian.sample(k, body.surface, sequence, i);
        const bool inside = x.at.face >= 0;
        const Vec3d lit = inside ? Vec3d(-x.normal) : x.normal;
        x.ray.direction =
            reflected(Lambertian{}, -lit, lit, sequence(x.index, 0), sequence(x.index, 1), lambertian[k].mirror);
        path.run({.ray = x.ray,
            .mirror = lambertian[k].mirror,
            .power_W = 1.0 / images,
            .from_emitter = false,
            .inside = inside});
        transport.add(path.accounts().take(), body.nodes.of(x.ray.triangle), LightNodes::shares(x.at), x.area);
      }
    return transport;
  }
  /// Books what paths alone found, of which `direct` W is gathered, too.
  void book_forward(
      const Tally& total, const std::vector<double>& direct, int r, Eigen::Index first, Response& response) const {
    if (response.forward.cols() == 0) return;
    for (std::size_t c = 0; c < total.ledger.channels.size(); ++c) {
      response.forward(r, first + Eigen::Index(c)) = total.ledger.channels[c];
      response.forward_direct(r, first + Eigen::Index(c)) = total.direct[c] + direct[c];
    }
  }
  /// Books replicate `r` of one colour in the channels from `first` on.
  void book(Tally& total, int r, Eigen::Index first, Response& response) const {
    for (std::size_t c = 0; c < total.ledger.channels.size(); ++c) {
      response.replicates(r, first + Eigen::Index(c)) = total.ledger.channels[c];
      response.direct(r, first + Eigen::Index(c)) = total.direct[c];
    }
    total.ledger.channels.clear();
    add_scaled(response.ledgers[std::size_t(r)], total.ledger, 1.0);
  }

  Config config_{};
  Readout readout_{};
  Backend backend_{};
  int first_ = 0, count_ = 0;  // replicates that are traced; 0: all
};

}  // namespace lumo

#endif

// ---- lumo/objective/contact_progression.hpp
#ifndef SINGLE_INCLUDE_LUMO_OBJECTIVE_CONTACT_PROGRESSION_HPP
#define SINGLE_INCLUDE_LUMO_OBJECTIVE_CONTACT_PROGRESSION_HPP

namespace lumo {

/// A number with its numerical error: half width of an interval that should hold a much finer computation's value in
/// 95 of 100 cases.
struct Estimate {
  double value = 0.0;
  double error = 0.0;

  double standard_error() const { return 0.5 * error; }
};

/// A contact too small for its mesh: its area is not known.
struct Unresolved {
  double load_N = 0.0;
  double radius_m = 0.0;  ///< of the contact
  double edge_m = 0.0;    ///< between the mesh's nodes along its edge
};

/// The three terms of progressive-constraint contact of one scenario (paper Eq. 3–5). A term is empty if the loads do
/// not define it, or if a contact that it needs is unresolved.
struct ContactTerms {
  std::optional<Estimate> form;    ///< q_form: patch radius at 2 N over indenter radius
  std::optional<Estimate> stable;  ///< q_stable: overlap of the contact sets at 2 N and 10 N, on the reference surface
  std::optional<Estimate> stiff;   ///< q_stiff: 1 − κ(1→2 N)/κ(5→10 N)
  /// (q_form q_stable q_stiff)^(1/3); nullopt if a term is empty, out of [0, 1] or not finite.
  std::optional<Estimate> score() const;
};

/// How far areas, overlaps and stiffness are from those of a fine mesh, by what their own mesh says: the distance of
/// its nodes along the edge of contact, pressure that acts outside of the contact set, and EnergyError. The numbers
/// cover nine of ten differences on meshes of 0.7 to 5.6 times the default's edges
/// (benchmarks/refinement/results.md).
struct MechanicalError {
  double area = 0.42;         ///< of an area, where the nodes are as far apart as the contact's radius is long
  double area_power = 1.6;    ///< of that ratio
  double outside = 0.75;      ///< of an area, times the outside part of the force to the power 2/3
  double coarsest = 1.0;      ///< of that ratio: beyond it there is no area to speak of
  double most_outside = 0.5;  ///< of the force; the same
  double stiffness = 0.9;     ///< of a secant stiffness, times the energy's error

  bool resolves(const ContactSpot& spot) const {
    return spot.area_m2 > 0.0 && spot.edge_m <= coarsest * spot.radius_m() &&
           spot.force_outside_N <= most_outside * spot.force_N;
  }
  /// Relative, of one contact.
  double of_area(const ContactSpot& spot) const {
    if (!(spot.area_m2 > 0.0)) return 1.0;
    return std::min(1.0, area * std::pow(spot.edge_m / spot.radius_m(), area_power) +
                             outside * std::pow(spot.force_outside_N / spot.force_N, 2.0 / 3.0));
  }
  /// Relative, of a state's whole contact area.
  double of_area(const MechanicalState& state) const;
  /// The contact that is resolved worst, if one that bears a hundredth of the load is not. States that are only held
  /// are not judged.
  std::optional<Unresolved> unresolved_in(const MechanicalState& state) const;
  /// Edge length that a contact wants where its own does not resolve it; else its own.
  double wanted_edge(const ContactSpot& spot) const;
  double of_stiffness(const MechanicalState& state) const { return stiffness * state.energy_error; }
};

/// The paper's loads that enter the terms [N].
struct ContactLoads {
  double first = 1.0, second = 2.0, third = 5.0, fourth = 10.0;
};

/// The worst scenario's contact progression (paper Eq. 5) and the index of the scenario that sets it; nullopt without
/// scenarios, or if one of them has no score.
template <class Record>
requires requires(const Record& s) {
  { s.terms } -> std::convertible_to<ContactTerms>;
}
std::optional<std::pair<Estimate, std::size_t>> contact_progression(const std::vector<Record>& scenarios) {
  std::optional<std::pair<Estimate, std::size_t>> worst;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const auto score = scenarios[k].terms.score();
    if (!score) return std::nullopt;
    if (!worst || score->value < worst->first.value) worst = std::pair(*score, k);
  }
  return worst;
}

/// How much less than the baseline a pad gives way at the same load, in percent: 100 (1 − δ/δ_baseline). Source: paper
/// Table II. Throws InvalidArgument for a depth that is negative or not finite, and for a baseline that is not
/// positive.
inline double progressive_constraint_gain(double depth, double baseline_depth) {
  require_in_range("depth", depth, 0.0, 1e3, "");
  require_in_range("baseline's depth", baseline_depth, 1e-12, 1e3, "");
  return 100.0 * (1.0 - depth / baseline_depth);
}

namespace detail {

/// A term in [0, 1]. The error of a term that is cut off is the part of it that reaches back over the edge.
inline Estimate clipped(const Estimate& e) {
  const double value = std::clamp(e.value, 0.0, 1.0);
  return {value, std::max(0.0, e.error - std::abs(e.value - value))};
}

/// Are the numbers finite that terms are made of?
inline bool is_sound(const MechanicalState& s) {
  return std::isfinite(s.force_N) && std::isfinite(s.depth_m) && std::isfinite(s.contact_area_m2) &&
         s.contact_area_m2 >= 0.0 && s.energy_error >= 0.0 && std::isfinite(s.energy_error) &&
         std::all_of(s.spots.begin(), s.spots.end(),
             [](const ContactSpot& spot) {
               return spot.force_N > 0.0 && spot.force_outside_N >= 0.0 && spot.area_m2 >= 0.0 && spot.rim_m >= 0.0 &&
                      std::isfinite(spot.force_N + spot.force_outside_N + spot.area_m2 + spot.rim_m + spot.edge_m);
             }) &&
         std::none_of(s.contact_field.begin(), s.contact_field.end(), [](double gap) { return std::isnan(gap); });
}

}  // namespace detail

inline double MechanicalError::of_area(const MechanicalState& state) const {
  double all = 0.0, wrong = 0.0;
  for (const ContactSpot& s : state.spots) {
    all += s.force_N;
    wrong += s.force_N * of_area(s);
  }
  return all > 0.0 ? wrong / all : 0.0;
}

inline double MechanicalError::wanted_edge(const ContactSpot& spot) const {
  constexpr double of_radius = 0.25, of_edge = 0.15;  // the latter where the contact has no radius that means something
  if (resolves(spot)) return spot.edge_m;
  const double trusted = spot.radius_m() > of_radius * spot.edge_m ? of_radius * spot.radius_m() : 0.0;
  return std::max(trusted, of_edge * spot.edge_m);
}

inline std::optional<Unresolved> MechanicalError::unresolved_in(const MechanicalState& state) const {
  constexpr double least_part = 0.01;  // of the load
  std::optional<Unresolved> worst;
  if (state.status == Status::held) return worst;
  double largest = 0.0;
  for (const ContactSpot& s : state.spots)
    if (s.force_N >= least_part * state.load_N && !resolves(s) && of_area(s) > largest) {
      largest = of_area(s);
      worst = Unresolved{state.load_N, s.radius_m(), s.edge_m};
    }
  return worst;
}

inline std::optional<Estimate> ContactTerms::score() const {
  if (!form || !stable || !stiff) return std::nullopt;
  for (const Estimate& e : {*form, *stable, *stiff})
    if (!(e.value >= 0.0 && e.value <= 1.0 && e.error >= 0.0 && std::isfinite(e.error))) return std::nullopt;
  const double value = std::cbrt(form->value * stable->value * stiff->value);
  const auto with = [&](double f, double s, double k) {
    return std::abs(std::cbrt(std::max(0.0, f) * std::max(0.0, s) * std::max(0.0, k)) - value);
  };
  // Errors of the three terms are taken as independent; finite changes, because the cube root has no slope at zero.
  const double a = std::max(with(form->value + form->error, stable->value, stiff->value),
      with(form->value - form->error, stable->value, stiff->value));
  const double b = std::max(with(form->value, stable->value + stable->error, stiff->value),
      with(form->value, stable->value - stable->error, stiff->value));
  const double c = std::max(with(form->value, stable->value, stiff->value + stiff->error),
      with(form->value, stable->value, stiff->value - stiff->error));
  return Estimate{value, std::sqrt(a * a + b * b + c * c)};
}

/// Terms of one scenario from its states on `mesh`, for a round indenter of `radius_m`. Only converged (or held) states
/// count, with finite numbers. Throws InvalidArgument for a radius, error or load out of range.
inline ContactTerms contact_terms(const Body& body, const TetMesh& mesh, const std::vector<MechanicalState>& states,
    double radius_m, const MechanicalError& error = {}, const ContactLoads& loads = {}) {
  require_positive("radius of the indenter", radius_m, "m");
  for (const double e :
      {error.area, error.area_power, error.outside, error.coarsest, error.most_outside, error.stiffness})
    require_in_range("error of the contact's terms", e, 0.0, 1e3, "");
  const auto at = [&](double load) -> const MechanicalState* {
    require_positive("load of the contact's terms", load, "N");
    for (const MechanicalState& s : states)
      if (std::abs(s.load_N - load) <= 1e-9 * load && is_scored(s.status, true) && detail::is_sound(s)) return &s;
    return nullptr;
  };
  const MechanicalState *one = at(loads.first), *two = at(loads.second), *three = at(loads.third),
                        *four = at(loads.fourth);
  ContactTerms q;
  const auto known = [&](const MechanicalState* s) { return s != nullptr && !error.unresolved_in(*s); };
  if (known(two)) {
    const double form = std::sqrt(two->contact_area_m2 / (pi * radius_m * radius_m));
    q.form = detail::clipped({form, 0.5 * error.of_area(*two) * form});
  }
  if (known(two) && known(four)) {
    const ContactSurface surface(mesh, body, [](const Patch& p) { return p.contactable; });
    const Positions undeformed = positions_of(mesh);
    const SetOverlap overlap = two->recorded.empty() || four->recorded.empty()
                                   ? contact_overlap(surface, two->contact_field, four->contact_field, undeformed)
                                   : recorded_overlap(surface, two->recorded, four->recorded, undeformed);
    // One set lies in the other, or nearly so.
    q.stable =
        detail::clipped({overlap.ratio(), overlap.ratio() * std::hypot(error.of_area(*two), error.of_area(*four))});
  }
  if (one && two && three && four) {
    const double early = (two->force_N - one->force_N) / (two->depth_m - one->depth_m);
    const double late = (four->force_N - three->force_N) / (four->depth_m - three->depth_m);
    const double ratio = early / late;
    // A held indenter's force may pass the next load before it moves on: no advance, no stiffness.
    const bool advanced = two->depth_m > one->depth_m && four->depth_m > three->depth_m;
    if (advanced && late > 0.0)
      q.stiff = detail::clipped(
          {1.0 - ratio, std::abs(ratio) * std::hypot(error.of_stiffness(*two), error.of_stiffness(*four))});
  }
  return q;
}

}  // namespace lumo

#endif

// ---- lumo/objective/optical_separation.hpp
#ifndef SINGLE_INCLUDE_LUMO_OBJECTIVE_OPTICAL_SEPARATION_HPP
#define SINGLE_INCLUDE_LUMO_OBJECTIVE_OPTICAL_SEPARATION_HPP

namespace lumo {

/// Response of one state with the quantities that it is compared by (paper Eq. 6–7).
struct ObservedState {
  std::size_t scenario;  ///< the caller's number of the scenario
  double diameter_m, angle_rad, y_m, load_N;
  Eigen::MatrixXd change;  ///< (r − r_0)/P_emit, replicates × regions
  TiltPlane tilt = TiltPlane::xz;
  double load_rise = 0.0;   ///< see load_rises()
  double area_error = 0.0;  ///< of the contact area, by the mesh, as a fraction (MechanicalError)
  double x_m = 0.0;
};

/// The closest pair of places: J_obs = min over matched diameter, angle and load, and over pairs of places, of the
/// distance between their response changes; with its error from replicates and the two states that set it.
struct Separation {
  Estimate distance;
  std::size_t first, second;  ///< indices into the states
};

/// How far a response change is from that on a fine mesh: a mesh that has the contact area wrong has the light of
/// another load, and of another dent. Where light that the dent took under less load and light that it gives now nearly
/// cancel, that is much more than the same part of the change. The number covers 95 of 100 differences
/// (benchmarks/refinement/results.md).
struct OpticalError {
  double area = 2.0;  ///< of change and rise (load_rises()), times the relative error of the contact area

  /// Throws InvalidArgument.
  double of(const ObservedState& state) const {
    require_in_range("relative error of the contact area", state.area_error, 0.0, 1.0, "");
    require_in_range("rise of a response over load", state.load_rise, 0.0, 1e150, "");
    return area * state.area_error * (state.load_rise + state.change.colwise().mean().norm());
  }
  void require_valid() const { require_in_range("error of light per error of area", area, 0.0, 1e3, ""); }
  /// Of the distance of two states, whose meshes differ.
  double of(const ObservedState& a, const ObservedState& b) const { return std::hypot(of(a), of(b)); }
};

/// F ‖Δchange‖/ΔF of each state of one press, its loads ascending [N]; differences are to the state before, of the
/// first one to the unloaded body. Throws InvalidArgument for loads that do not ascend from above 0, and for changes
/// that are not one for each load, of one size and finite.
inline std::vector<double> load_rises(
    const std::vector<double>& loads_N, const std::vector<Eigen::RowVectorXd>& changes) {
  if (changes.size() != loads_N.size())
    throw InvalidArgument(message("rises over load: ", changes.size(), " changes for ", loads_N.size(), " loads"));
  std::vector<double> rises;
  for (std::size_t k = 0; k < loads_N.size(); ++k) {
    const double step = k == 0 ? loads_N[0] : loads_N[k] - loads_N[k - 1];
    require_positive("step of load", step, "N");
    if (changes[k].size() != changes[0].size())
      throw InvalidArgument(
          message("rises over load: changes of ", changes[0].size(), " and ", changes[k].size(), " channels"));
    const double change = k == 0 ? changes[0].norm() : (changes[k] - changes[k - 1]).norm();
    rises.push_back(loads_N[k] * change / step);
    require_in_range("rise of a response over load", rises.back(), 0.0, 1e150, "");
  }
  return rises;
}

namespace detail {

inline void require_same_shape(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols() || a.rows() < 1)
    throw InvalidArgument(message("responses of ", a.rows(), " and ", b.rows(), " replicates of ", a.cols(), " and ",
        b.cols(), " channels, must be as many, at least 1 replicate"));
  constexpr double largest = 1e150;  // squares do not overflow
  if (!(a.array().abs() <= largest).all() || !(b.array().abs() <= largest).all())
    throw InvalidArgument("responses: a number is not finite, or beyond +-1e150");
}

}  // namespace detail

/// (r − r_0)/P_emit by replicate. Throws InvalidArgument for responses of different shape or that are not finite, or
/// without emitted power.
inline Eigen::MatrixXd response_change(const Response& loaded, const Response& unloaded) {
  detail::require_same_shape(loaded.replicates, unloaded.replicates);
  require_positive("emitted power", loaded.ledger.emitted, "W");
  return (loaded.replicates - unloaded.replicates) / loaded.ledger.emitted;
}

/// May these two states be compared: same tool, angle and load, other place?
inline bool comparable(const ObservedState& a, const ObservedState& b) {
  return a.diameter_m == b.diameter_m && a.angle_rad == b.angle_rad && a.tilt == b.tilt && a.load_N == b.load_N &&
         (a.y_m != b.y_m || a.x_m != b.x_m);
}

/// Distance of two response changes and its standard error from paired replicates. The square of the distance is the
/// mean over pairs of *different* replicates of the scalar product of their differences (a U-statistic, Hoeffding
/// 1948): noise does not raise it, unlike the square of the mean difference. The distance is 0 if noise makes the
/// square negative. The error is that of the larger of distance and noise. Throws InvalidArgument for changes of
/// different shape, without replicates, or that are not finite.
inline Estimate response_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  detail::require_same_shape(a, b);
  const Eigen::MatrixXd d = a - b;
  const Eigen::RowVectorXd mean = d.colwise().mean();
  const double n = double(d.rows());
  if (d.rows() < 2) return {mean.norm(), 0.0};
  const Eigen::MatrixXd off = d.rowwise() - mean;
  const double noise2 = off.squaredNorm() / (n * (n - 1.0)), square = mean.squaredNorm() - noise2;
  const double distance = std::sqrt(std::max(0.0, square)), scale = std::sqrt(std::max(square, noise2));
  if (scale == 0.0) return {0.0, 0.0};
  // The distance moves, to first order, with the replicates' components along the mean difference. This overstates the
  // error somewhat if the mean difference is mostly noise.
  return {distance, std::sqrt((off * mean.transpose()).squaredNorm() / (n * (n - 1.0))) / scale};
}

namespace detail {

/// Distances of all pairs that may be compared.
inline std::vector<Separation> separations(const std::vector<ObservedState>& states) {
  std::vector<Separation> pairs;
  for (std::size_t i = 0; i < states.size(); ++i)
    for (std::size_t j = i + 1; j < states.size(); ++j)
      if (comparable(states[i], states[j]))
        pairs.push_back({response_distance(states[i].change, states[j].change), i, j});
  return pairs;
}

}  // namespace detail

/// A state whose noise must fall, and by how much.
struct Undecided {
  std::size_t state;
  double excess;  ///< of its pair's error over the wanted one, ≥ 1
};

/// States whose noise must fall before J_obs is known to `tolerance` (a fraction of it, one standard error), or to a
/// quarter of its error by the mesh: those of all pairs that come within two errors (of the difference) of the least
/// distance and are noisier than that. Wanted is the error that decides: that one, or a third of what the pair lies
/// above the least one. Ascending; empty if done, or if no states can be compared. A pure function: a campaign that
/// retraces these states (Tracer::refined) stays deterministic. Retraced states need the unloaded body retraced with
/// the same rays.
inline std::vector<Undecided> undecided_states(
    const std::vector<ObservedState>& states, double tolerance = 0.02, const OpticalError& mesh = {}) {
  constexpr double of_mesh = 0.25;  // two standard errors are half of it, and add an eighth
  require_in_range("tolerance of J_obs", tolerance, 0.0, 1e3, "");
  mesh.require_valid();
  const std::vector<Separation> pairs = detail::separations(states);
  // The least of the upper bounds, so that one very noisy pair does not stand for all.
  const auto upper = [](const Separation& p) { return p.distance.value + 2.0 * p.distance.error; };
  const auto least = std::min_element(
      pairs.begin(), pairs.end(), [&](const Separation& a, const Separation& b) { return upper(a) < upper(b); });
  std::map<std::size_t, double> wanted;
  for (const Separation& p : pairs) {
    const double above = p.distance.value - least->distance.value;
    const double enough = of_mesh * mesh.of(states[p.first], states[p.second]);
    const bool within_reach = above <= 2.0 * std::hypot(p.distance.error, least->distance.error);
    if (!within_reach || !(p.distance.error > std::max(enough, tolerance * p.distance.value))) continue;
    // A distance that its noise hides may be as large as that.
    const double known = std::max(enough, tolerance * std::max(p.distance.value, p.distance.error)),
                 excess = std::max(1.0, p.distance.error / std::max(known, above / 3.0));
    for (const std::size_t state : {p.first, p.second}) wanted[state] = std::max(wanted[state], excess);
  }
  std::vector<Undecided> all;
  for (const auto& [state, excess] : wanted) all.push_back({state, excess});
  return all;
}

/// nullopt if no two states can be compared. Cost: all pairs.
inline std::optional<Separation> optical_separation(
    const std::vector<ObservedState>& states, const OpticalError& error = {}) {
  error.require_valid();
  const std::vector<Separation> pairs = detail::separations(states);
  const auto closest = std::min_element(pairs.begin(), pairs.end(),
      [](const Separation& a, const Separation& b) { return a.distance.value < b.distance.value; });
  if (closest == pairs.end()) return std::nullopt;
  Separation least = *closest;
  least.distance.error = std::hypot(2.0 * least.distance.error, error.of(states[least.first], states[least.second]));
  return least;
}

}  // namespace lumo

#endif

// ---- lumo/pipeline/observations.hpp
#ifndef SINGLE_INCLUDE_LUMO_PIPELINE_OBSERVATIONS_HPP
#define SINGLE_INCLUDE_LUMO_PIPELINE_OBSERVATIONS_HPP

namespace lumo {

/// One state as it is kept: numbers only, no fields.
struct StateRecord {
  Status status = Status::non_finite;
  double load_N = 0.0, force_N = 0.0, depth_m = 0.0, contact_area_m2 = 0.0, reference_area_m2 = 0.0, residual_N = 0.0,
         penetration_m = 0.0;
  double depth_error_m = 0.0, contact_area_error_m2 = 0.0;  ///< by the mesh, see MechanicalError
  /// Per emitted power and channel: Observations::unloaded_response + mean change; empty without light.
  std::vector<double> response;
  /// (r − r_0)/P_emit, replicates × channels, both traced on the scenario's own mesh.
  Eigen::MatrixXd change;
  std::vector<double> change_error;  ///< standard error of the response minus the unloaded one; empty without light
};

/// One scenario of an ensemble.
struct ScenarioRecord {
  double diameter_m = 0.0, angle_rad = 0.0, y_m = 0.0;  ///< diameter of the tool, or twice its contact_radius()
  /// Of the last state that was tried; unresolved where all converged, and one has such a contact.
  Status status = Status::non_finite;
  ContactTerms terms;
  std::vector<StateRecord> states;
  TiltPlane tilt = TiltPlane::xz;
  std::optional<Unresolved> unresolved = std::nullopt;  ///< the first contact that its mesh does not resolve
  double x_m = 0.0;
};

/// Seconds spent, summed over threads, and by the clock in all.
struct Timing {
  double mesh = 0.0, mechanics = 0.0, optics = 0.0, total = 0.0;
};

/// All states and responses of one body under an ensemble.
struct Observations {
  std::vector<ScenarioRecord> scenarios;  ///< in the ensemble's order, mirror images included
  /// Per emitted power and channel (of the first colour, then the next), mean over the meshes.
  std::vector<double> unloaded_response;
  /// Its standard error. Meshes share their rays, so it does not shrink with their number.
  std::vector<double> unloaded_error;
  EnergyLedger ledger;                  ///< of the traced state that closes worst
  std::size_t nodes = 0, elements = 0;  ///< of the largest mesh
  Timing seconds;
};

/// The record of a scenario, before it is lit, from its states on `mesh`.
template <Indenter Tool> ScenarioRecord record_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario,
    const std::vector<MechanicalState>& states, const MechanicalError& error = {}) {
  ScenarioRecord record;
  record.diameter_m = 2.0 * contact_radius(scenario.indenter);
  record.angle_rad = scenario.angle_rad;
  record.x_m = scenario.x_m;
  record.y_m = scenario.y_m;
  record.tilt = scenario.tilt;
  record.status = states.back().status;
  record.terms = contact_terms(body, mesh, states, contact_radius(scenario.indenter), error);
  for (const MechanicalState& s : states) {
    StateRecord& kept = record.states.emplace_back();
    kept.status = s.status;
    kept.load_N = s.load_N;
    kept.force_N = s.force_N;
    kept.depth_m = s.depth_m;
    kept.contact_area_m2 = s.contact_area_m2;
    kept.reference_area_m2 = s.reference_area_m2;
    kept.residual_N = s.residual_N;
    kept.penetration_m = s.penetration_m;
    kept.depth_error_m = error.of_stiffness(s) * s.depth_m;
    kept.contact_area_error_m2 = error.of_area(s) * s.contact_area_m2;
    if (const auto spot = error.unresolved_in(s)) {
      kept.contact_area_error_m2 += pi * spot->edge_m * spot->edge_m;
      if (!record.unresolved) record.unresolved = spot;
    }
  }
  if (record.unresolved && is_scored(record.status, true)) record.status = Status::unresolved;
  // It would be pressed again, on a finer mesh, which takes longer still.
  if (record.status == Status::time_limit) record.unresolved.reset();
  return record;
}

/// Did all scenarios converge, or were held where that is accepted?
inline bool all_scored(const std::vector<ScenarioRecord>& scenarios, bool accept_held) {
  return std::all_of(
      scenarios.begin(), scenarios.end(), [&](const ScenarioRecord& s) { return is_scored(s.status, accept_held); });
}

/// The lit states of one scenario, which is the caller's number `scenario`.
inline std::vector<ObservedState> observed_states(const ScenarioRecord& record, std::size_t scenario) {
  std::vector<ObservedState> states;
  std::vector<double> loads_N;
  std::vector<Eigen::RowVectorXd> changes;
  for (const StateRecord& s : record.states) {
    if (s.change.size() == 0) continue;
    const double known = s.contact_area_m2 > 0.0 ? std::min(1.0, s.contact_area_error_m2 / s.contact_area_m2) : 0.0;
    states.push_back({scenario, record.diameter_m, record.angle_rad, record.y_m, s.load_N, s.change, record.tilt, 0.0,
        known, record.x_m});
    loads_N.push_back(s.load_N);
    changes.push_back(s.change.colwise().mean());
  }
  const std::vector<double> rises = load_rises(loads_N, changes);
  for (std::size_t k = 0; k < states.size(); ++k) states[k].load_rise = rises[k];
  return states;
}

/// All states that can be compared for J_obs.
inline std::vector<ObservedState> observed_states(const std::vector<ScenarioRecord>& scenarios) {
  std::vector<ObservedState> all;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    std::vector<ObservedState> states = observed_states(scenarios[k], k);
    std::move(states.begin(), states.end(), std::back_inserter(all));
  }
  return all;
}

/// Channel of the light → its mirror image, in the planes x = 0 and y = 0; empty: itself; nullopt: unknown.
using ChannelImages = std::array<std::optional<std::vector<int>>, 2>;

/// The record of a scenario from that of its mirror image.
template <Indenter Tool> ScenarioRecord mirrored(
    ScenarioRecord record, const Scenario<Tool>& scenario, const ChannelImages& channels, const ScenarioImage& image) {
  record.angle_rad = scenario.angle_rad;
  record.x_m = scenario.x_m;
  record.y_m = scenario.y_m;
  const auto renumber = [&](const std::optional<std::vector<int>>& channel) {
    if (!channel || channel->empty()) return;
    for (StateRecord& s : record.states) {
      const Eigen::MatrixXd change = s.change;
      for (Eigen::Index k = 0; k < change.cols(); ++k) s.change.col((*channel)[std::size_t(k)]) = change.col(k);
    }
  };
  if (image.mirror.x) renumber(channels[0]);
  if (image.mirror.y) renumber(channels[1]);
  return record;
}

}  // namespace lumo

#endif

// ---- lumo/pipeline/lighting.hpp
#ifndef SINGLE_INCLUDE_LUMO_PIPELINE_LIGHTING_HPP
#define SINGLE_INCLUDE_LUMO_PIPELINE_LIGHTING_HPP

namespace lumo {

/// Planes in which body, mesh, emitters and the states of a scenario are their own mirror images.
template <Indenter Tool> Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario) {
  const Symmetry unloaded = symmetry_of(body, mesh), contact = symmetry_of(scenario);
  return {unloaded.x && contact.x, unloaded.y && contact.y};
}

/// The same for a state that ended with `status`. Sweeps visit vertices one after the other: a state that they hold is
/// not its own mirror image.
template <Indenter Tool>
Symmetry symmetry_of(const Body& body, const TetMesh& mesh, const Scenario<Tool>& scenario, Status status) {
  return status == Status::held ? Symmetry{} : symmetry_of(body, mesh, scenario);
}

/// How the states that decide J_obs become known better than the others. First all states are lit with few rays. Then
/// each round lights the states that undecided_states() names with as many as their noise asks for, in one pattern (and
/// the unloaded bodies on their meshes, too), until there are none. The error covers those still undecided then. Rays
/// of states are sent where contacts at their place change the light.
struct RayRefinement {
  double tolerance = 0.02;  ///< wanted standard error of J_obs, and of all that might be less, as a fraction
  int rounds = 8;           ///< at most this many; 0: everything is lit once, with the tracer's rays
  double pilot = 0.25;     ///< share of the tracer's rays that all states are lit with if rounds follow; a power of two
  double focus_m = 14e-3;  ///< the rays' density falls by e over this distance from the contact's place

  static constexpr double most = 512.0;       ///< times the tracer's rays, in one pattern
  static constexpr double most_growth = 4.0;  ///< from one round to the next
  /// Variance falls as the rays to this power: one fine pattern is worth more than many coarse ones. Measured from 1 to
  /// 16 times the default's rays on the deciding pair of the plain baseline: 1.4.
  static constexpr double rate = 1.4;

  /// Rays, in the tracer's, for a state that has had `rays` and whose error is `excess` times the wanted one.
  static double next(double rays, double excess) {
    const double growth = std::exp2(std::ceil(2.0 / rate * std::log2(excess) - 0.5));
    return std::min(most, rays * std::clamp(growth, 2.0, most_growth));
  }
};

/// A solved scenario with its fields.
struct SolvedScenario {
  ScenarioRecord record;
  std::vector<MechanicalState> states;
  double seconds = 0.0;
};

/// Light in the states of all solved scenarios.
template <class Light, class Pad, Indenter Tool> class Lighting {
 public:
  /// `places`: the body on its mesh for each place of the plan.
  Lighting(const Body& body, const ContactPlan<Tool>& plan, const Light& light, const RayRefinement& rays,
      const std::vector<Pad>& places, const std::vector<SolvedScenario>& solved)
      : body_(body), plan_(plan), light_(light), rays_(rays), places_(places), solved_(solved) {
    for (std::size_t k = 0; k < solved.size(); ++k) {
      records_.push_back(solved[k].record);
      for (std::size_t s = 0; s < solved[k].states.size(); ++s)
        if (is_scored(solved[k].states[s].status, true)) all_.push_back({k, s});
    }
  }

  struct State {
    std::size_t solve, state;
    auto operator<=>(const State&) const = default;
  };
  /// A state, and with how many rays it is to be lit, in the tracer's.
  struct Wanted {
    State state;
    double rays;
  };

  /// All states, for the first trace, which lights the unloaded body on all meshes, too.
  std::vector<Wanted> all() const {
    std::vector<Wanted> wanted;
    for (const State& s : all_) wanted.push_back({s, pilot()});
    return wanted;
  }

  /// Lights these states, and the unloaded body on their meshes with the same rays. Patterns of different size are
  /// independent. `report(count)` is called after each of `count` jobs. Throws NumericalError if too much light is
  /// lost.
  template <Executor E, class Report>
  void trace(const std::vector<Wanted>& wanted, const E& executor, Report&& report) {
    if (guides_.empty()) learn(executor);
    const std::vector<Job> jobs = jobs_for(wanted);
    std::vector<Task> tasks;  // long ones first, so that threads end together
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      const int parts = parts_of(jobs[j]);
      for (int part = 0; part < parts; ++part) tasks.push_back({j, part, parts});
    }
    std::stable_sort(tasks.begin(), tasks.end(), [&](const Task& a, const Task& b) {
      return jobs[a.job].bare.rays / a.parts > jobs[b.job].bare.rays / b.parts;
    });
    std::vector<Response> lit(tasks.size());
    std::vector<double> spent(tasks.size(), 0.0);
    executor.for_each(tasks.size(), [&](std::size_t i) {
      const Stopwatch watch;
      lit[i] = light(jobs[tasks[i].job], tasks[i].part, tasks[i].parts);
      spent[i] = watch.seconds();
      report(tasks.size());
    });
    seconds += std::accumulate(spent.begin(), spent.end(), 0.0);
    std::vector<std::vector<Response>> parts(jobs.size());
    for (std::size_t i = 0; i < tasks.size(); ++i) parts[tasks[i].job].push_back(std::move(lit[i]));
    keep(jobs, parts);
  }

  /// Records of the solved scenarios, with their changes.
  const std::vector<ScenarioRecord>& records() const { return records_; }

  /// Responses of the undeformed body on each mesh, with rays that are sent evenly.
  std::vector<Response> unloaded() const {
    std::vector<Response> each;
    for (std::size_t place = 0; place < places_.size(); ++place) each.push_back(unloaded_.at({place, pilot(), {}}));
    return each;
  }

  /// States that decide the least distance of those observed in `all` scenarios, mirror images being one state, and the
  /// rays that they need. A pure function of the responses.
  std::vector<Wanted> undecided(const std::vector<ScenarioRecord>& all, const OpticalError& mesh) const {
    const std::vector<ObservedState> observed = observed_states(all);
    std::map<State, double> excess;
    for (const Undecided& u : undecided_states(observed, rays_.tolerance, mesh)) {
      const ObservedState& o = observed[u.state];
      const std::size_t solve = plan_.images[o.scenario].solve;
      const auto& candidates = records_[solve].states;
      const auto it = std::find_if(
          candidates.begin(), candidates.end(), [&](const StateRecord& s) { return s.load_N == o.load_N; });
      double& most = excess[{solve, std::size_t(it - candidates.begin())}];
      most = std::max(most, u.excess);
    }
    std::vector<Wanted> wanted;
    for (const auto& [state, e] : excess)
      if (const double had = had_.at(state).rays, rays = RayRefinement::next(had, e); rays > had)
        wanted.push_back({state, rays});
    return wanted;
  }

  EnergyLedger ledger;   ///< of the traced state that closes worst
  double seconds = 0.0;  ///< spent in tracing, summed over threads

 private:
  // An undeformed body, as it is lit for a state.
  struct Bare {
    std::size_t place;
    double rays;
    std::optional<double> focus_m;  // y that more rays are sent to than elsewhere; with them goes the place's guide
    auto operator<=>(const Bare&) const = default;
  };
  struct Job {
    Bare bare;
    const State* state;  // null: unloaded
  };
  // What a state was lit with: rays of the last and finest pattern, and the weight of all.
  struct Had {
    double rays = 0.0, weight = 0.0;
  };
  struct Task {
    std::size_t job;
    int part, parts;
  };

  double pilot() const { return rays_.rounds > 0 ? rays_.pilot : 1.0; }

  // Long traces are divided by their replicates, so that all threads have work.
  int parts_of(const Job& job) const {
    int parts = 1;
    while (parts < job.bare.rays && 2 * parts <= light_.config().replicates) parts *= 2;
    return parts;
  }

  // What is worth knowing before light is traced, place by place: of the undeformed body, and how the states at the
  // middle loads differ from it, which stand for the others there.
  template <Executor E> void learn(const E& executor) {
    std::vector<std::vector<State>> taught(places_.size());
    for (const State& s : all_)
      if (s.state == solved_[s.solve].states.size() / 2) taught[plan_.solves[s.solve].place].push_back(s);
    guides_.resize(places_.size());
    std::vector<double> spent(places_.size(), 0.0);
    executor.for_each(places_.size(), [&](std::size_t place) {
      const Stopwatch watch;
      const TetMesh& mesh = places_[place]->mesh();
      Symmetry all = symmetry_of(body_, mesh);
      std::vector<const MechanicalState*> states;
      for (const State& s : taught[place]) {
        states.push_back(&solved_[s.solve].states[s.state]);
        const Symmetry one = symmetry_of(body_, mesh, plan_.solves[s.solve].scenario, states.back()->status);
        all = {all.x && one.x, all.y && one.y};
      }
      guides_[place] = light_.guide(body_, mesh, states, all);
      spent[place] = watch.seconds();
    });
    seconds += std::accumulate(spent.begin(), spent.end(), 0.0);
  }

  std::vector<Job> jobs_for(const std::vector<Wanted>& wanted) {
    std::set<Bare> bare;
    std::vector<Job> jobs;
    for (const Wanted& w : wanted) {
      const auto& solve = plan_.solves[w.state.solve];
      jobs.push_back({{solve.place, w.rays, solve.scenario.y_m}, &w.state});
      bare.insert(jobs.back().bare);
    }
    for (std::size_t place = 0; unloaded_.empty() && place < places_.size(); ++place) bare.insert({place, pilot(), {}});
    for (const Bare& b : bare)
      if (!unloaded_.contains(b)) jobs.push_back({b, nullptr});
    return jobs;
  }

  Response light(const Job& job, int part, int parts) const {
    const auto& [place, rays, focus_m] = job.bare;
    const int count = light_.config().replicates / parts;
    const Light refined = light_.refined(rays, std::uint64_t(std::log2(rays / pilot()))).portion(part * count, count);
    const TetMesh& mesh = places_[place]->mesh();
    if (!focus_m) return refined.trace(body_, mesh);
    const auto& p = plan_.places[place];
    RayFocus focus{.y_m = *focus_m};
    if (p.angle_rad == 0.0 || p.tilt == TiltPlane::xz) focus.length_m = rays_.focus_m;  // others touch elsewhere
    if (job.state == nullptr) {
      const Symmetry unloaded = symmetry_of(body_, mesh);
      return refined.trace(
          body_, mesh, SurfaceState{}, {unloaded.x, unloaded.y && focus.is_symmetric()}, focus, guides_[place]);
    }
    const MechanicalState& loaded = solved_[job.state->solve].states[job.state->state];
    const Symmetry symmetry = symmetry_of(body_, mesh, plan_.solves[job.state->solve].scenario, loaded.status);
    return refined.trace(body_, mesh, loaded, symmetry, focus, guides_[place]);
  }

  void keep(const std::vector<Job>& jobs, const std::vector<std::vector<Response>>& parts) {
    std::vector<Response> lit;
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      lit.push_back(Light::joined(parts[j]));
      require_closed(lit.back().ledger, light_.refined(jobs[j].bare.rays).lost_admitted(body_));
    }
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      if (ledger.emitted == 0.0 || lit[j].ledger.imbalance() >= ledger.imbalance()) ledger = lit[j].ledger;
      if (jobs[j].state == nullptr) unloaded_[jobs[j].bare] = lit[j];
    }
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      const auto& [bare, state] = jobs[j];
      if (state == nullptr) continue;
      const Eigen::MatrixXd change = response_change(lit[j], unloaded_.at(bare));
      Eigen::MatrixXd& mean = records_[state->solve].states[state->state].change;
      // Patterns count by the inverse of their variance.
      Had& had = had_[*state];
      const double weight = std::pow(bare.rays, RayRefinement::rate), share = weight / (had.weight + weight);
      mean = had.weight == 0.0 ? change : Eigen::MatrixXd((1.0 - share) * mean + share * change);
      had.weight += weight;
      had.rays = bare.rays;
    }
  }

  const Body& body_;
  const ContactPlan<Tool>& plan_;
  const Light& light_;
  RayRefinement rays_;
  const std::vector<Pad>& places_;
  const std::vector<SolvedScenario>& solved_;
  std::vector<ScenarioRecord> records_;
  std::vector<State> all_;
  std::map<State, Had> had_;
  std::map<Bare, Response> unloaded_;
  std::vector<RayGuide> guides_;  // per place
};

}  // namespace lumo

#endif

// ---- lumo/pipeline/observe.hpp
#ifndef SINGLE_INCLUDE_LUMO_PIPELINE_OBSERVE_HPP
#define SINGLE_INCLUDE_LUMO_PIPELINE_OBSERVE_HPP

namespace lumo {

/// Tools of one evaluation; policies are types, settings are values.
template <Mesher M, class Simulation, class Light> struct Pipeline {
  M mesher;
  Simulation simulator;
  Light tracer;
  Focus focus = {};
  MechanicalError mechanical_error = {};
  OpticalError optical_error = {};
  bool mirror_once = true;  ///< solve mirror images once
  RayRefinement rays = {};
  int mesh_order = 2;        ///< of the simulator's elements
  bool refine_once = true;   ///< mesh a place again, and finer, where a contact was not resolved, or a press lost
  bool accept_held = false;  ///< score states that a solver in time holds, too, not equilibria only
};

/// Called after each step, and before the first of a long stage: stage, steps done, steps in all. May be called from
/// any thread, one call at a time.
using ProgressReport = std::function<void(std::string_view stage, int done, int total)>;

/// A body pressed in every scenario, which may be lit more than once.
template <class Pad, Indenter Tool> struct Pressed {
  std::vector<Scenario<Tool>> scenarios;
  ContactPlan<Tool> plan;
  std::vector<std::unique_ptr<Pad>> places;  ///< the body on the mesh of each place of the plan
  std::vector<SolvedScenario> solved;        ///< as the plan has them
  Timing seconds;
};

template <class P> using PadOf =
    decltype(std::declval<const P&>().simulator.prepare(std::declval<const Body&>(), std::declval<const TetMesh&>()));

namespace detail {

template <class P, Indenter Tool, class Pad>
SolvedScenario solve_scenario(const Body& body, const Scenario<Tool>& scenario, const P& pipeline, const Pad& pad) {
  SolvedScenario out;
  const Stopwatch watch;
  out.states = pad.press(scenario);
  out.record = record_of(body, pad.mesh(), scenario, out.states, pipeline.mechanical_error);
  out.seconds = watch.seconds();
  return out;
}

/// Scenarios without a second symmetry plane take longest. They go first, so that threads end together.
template <Indenter Tool> std::vector<std::size_t> longest_first(const ContactPlan<Tool>& plan) {
  std::vector<std::size_t> order(plan.solves.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  const auto halves = [&](std::size_t k) {
    return symmetry_of(plan.solves[k].scenario).x + symmetry_of(plan.solves[k].scenario).y;
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return halves(a) < halves(b); });
  return order;
}

/// A body of which one side is seen, as if both were: its regions, and then their mirror images in x = 0.
inline Body with_both_sides(Body body) {
  const int n = body.regions;
  body.regions = 2 * n;
  body.region = [n, one = body.region](const Vec3d& p, const Vec3d& normal) {
    const Vec3d flip(-1.0, 1.0, 1.0);
    if (const int here = one(p, normal); here >= 0) return here;
    const int there = one(flip.cwiseProduct(p), flip.cwiseProduct(normal));
    return there >= 0 ? n + there : -1;
  };
  std::vector<int> other;
  for (int k = 0; k < 2 * n; ++k) other.push_back((k + n) % (2 * n));
  body.region_image_x = other;
  if (body.region_image_y && !body.region_image_y->empty())
    for (int k = 0; k < n; ++k) body.region_image_y->push_back(n + (*body.region_image_y)[std::size_t(k)]);
  return body;
}

/// How a body is lit so that contacts stand for their mirror images, and what of it is seen.
struct LitSides {
  std::optional<Body> both;  ///< of a body of which one side is seen
  ChannelImages images;
  std::vector<int> seen;  ///< channels

  template <class Light> LitSides(const Body& body, const Light& light) {
    const int channels = light.channels(body), colors = color_count(body.emitters);
    if (channels == 0) {  // mechanics only
      images = {std::vector<int>{}, std::vector<int>{}};
      return;
    }
    if (body.symmetry.x && body.region) both = with_both_sides(body);
    const bool knows_regions = both && light.channels(*both) == 2 * channels;
    if (!knows_regions || region_images(body, 0).kind != RegionImages::Kind::unseen) both.reset();
    const int of_color = channels / colors;
    for (int c = 0; c < colors; ++c)
      for (int k = 0; k < of_color; ++k) seen.push_back(c * (both ? 2 : 1) * of_color + k);
    images = {light.image_channels(lit(body), 0), light.image_channels(lit(body), 1)};
  }
  const Body& lit(const Body& body) const { return both ? *both : body; }
};

/// Records of all scenarios from those that were solved, with the channels that are seen.
template <Indenter Tool> std::vector<ScenarioRecord> expanded(const std::vector<Scenario<Tool>>& scenarios,
    const LitSides& sides, const ContactPlan<Tool>& plan, const std::vector<ScenarioRecord>& solved) {
  std::vector<ScenarioRecord> records;
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    records.push_back(mirrored(solved[plan.images[k].solve], scenarios[k], sides.images, plan.images[k]));
    for (StateRecord& s : records.back().states)
      if (s.change.cols() > Eigen::Index(sides.seen.size()))
        s.change = Eigen::MatrixXd(s.change(Eigen::all, sides.seen));
  }
  return records;
}

/// Meshes of different places give the same unloaded response up to their facets. That difference would hide small
/// changes: changes are taken on one mesh and added to the common mean. `watts` names the mean power or its standard
/// error.
inline std::vector<double> mean_per_emitted(
    const std::vector<Response>& responses, const std::vector<double> Response::*watts, const std::vector<int>& seen) {
  std::vector<double> mean(seen.size(), 0.0);
  for (const Response& r : responses)
    for (std::size_t b = 0; b < mean.size(); ++b)
      mean[b] += (r.*watts)[std::size_t(seen[b])] / (r.ledger.emitted * double(responses.size()));
  return mean;
}

/// Are the mirror images known of all channels in all planes in which the plan mirrors contacts?
template <Indenter Tool> bool images_known(const ContactPlan<Tool>& plan, const ChannelImages& images) {
  return std::none_of(plan.images.begin(), plan.images.end(),
      [&](const ScenarioImage& i) { return (i.mirror.x && !images[0]) || (i.mirror.y && !images[1]); });
}

/// Counts the steps of one stage, from any thread.
class StageReport {
 public:
  StageReport(const ProgressReport& progress, std::string stage) : progress_(progress), stage_(std::move(stage)) {}
  void begin(std::size_t total) {
    if (progress_) progress_(stage_, 0, int(total));
  }
  void step(std::size_t total) {
    const std::lock_guard lock(mutex_);
    if (progress_) progress_(stage_, ++done_, int(total));
  }

 private:
  const ProgressReport& progress_;
  std::string stage_;
  int done_ = 0;
  std::mutex mutex_;
};

}  // namespace detail

namespace detail {

/// Meshes places of a plan and presses there.
template <class P, Indenter Tool> struct PlacePresses {
  const Body& body;
  const P& pipeline;
  TetMesh coarse;
  Pressed<PadOf<P>, Tool>& out;
  std::vector<std::vector<FinePlace>> more = std::vector<std::vector<FinePlace>>(out.plan.places.size());
  std::set<std::size_t> lost = {};  ///< places whose next mesh is to be another one

  template <Executor E> void run(const std::vector<std::size_t>& places, const E& executor,
      const ProgressReport& progress, const std::string& how) {
    out.places.resize(out.plan.places.size());
    out.solved.resize(out.plan.solves.size());
    StageReport meshing(progress, "mesh" + how);
    meshing.begin(places.size());
    std::vector<double> spent(places.size());
    executor.for_each(places.size(), [&](std::size_t k) {
      const Stopwatch watch;
      mesh(places[k]);
      spent[k] = watch.seconds();
      meshing.step(places.size());
    });
    std::vector<std::size_t> order;
    for (const std::size_t k : longest_first(out.plan))
      if (std::find(places.begin(), places.end(), out.plan.solves[k].place) != places.end()) order.push_back(k);
    StageReport pressing(progress, "press" + how);
    pressing.begin(order.size());
    executor.for_each(order.size(), [&](std::size_t i) {
      const auto& s = out.plan.solves[order[i]];
      out.solved[order[i]] = solve_scenario(body, s.scenario, pipeline, *out.places[s.place]);
      pressing.step(order.size());
    });
    out.seconds.mesh += std::accumulate(spent.begin(), spent.end(), 0.0);
  }

  /// Places with a contact that is not resolved, whose next mesh will be finer there, and with a press that was lost,
  /// which will be tried on another mesh; unless so many were that it is the body which gives way.
  std::vector<std::size_t> to_try_again() {
    std::set<std::size_t> places;
    for (std::size_t k = 0; k < out.solved.size(); ++k) {
      const std::size_t place = out.plan.solves[k].place;
      if (is_lost(out.solved[k].record.status)) lost.insert(place);
      if (!out.solved[k].record.unresolved) continue;
      for (const MechanicalState& s : out.solved[k].states) add_places(s, more[place]);
      places.insert(place);
    }
    if (lost.size() > std::max<std::size_t>(1, out.plan.places.size() / 4)) lost.clear();
    places.insert(lost.begin(), lost.end());
    return {places.begin(), places.end()};
  }

 private:
  static constexpr double finest_wanted = 20e-6;  // [m]
  static constexpr double of_lost = 0.8;          // edges about a lost contact, on its next mesh

  // Covers where the tool presses, if a contact wants a finer mesh.
  void add_places(const MechanicalState& state, std::vector<FinePlace>& all) const {
    double edge = std::numeric_limits<double>::infinity(), apart = edge;
    for (const ContactSpot& spot : state.spots)
      if (const double wanted = pipeline.mechanical_error.wanted_edge(spot); wanted < spot.edge_m) {
        edge = std::min(edge, std::max(wanted, finest_wanted));
        apart = std::min(apart, std::max(spot.radius_m(), spot.edge_m));
      }
    if (!std::isfinite(edge)) return;
    for (const TractionPoint& p : state.tractions)
      if (std::none_of(all.begin(), all.end(), [&](const FinePlace& known) {
            return known.finest_m <= edge && (known.place_m - p.reference_m).norm() < apart;
          }))
        all.push_back({p.reference_m, edge});
  }

  // Scenarios at one place and angle share a mesh. One that cannot be made finer stays.
  void mesh(std::size_t place) const {
    std::vector<Scenario<Tool>> here;
    for (const std::size_t s : out.plan.places[place].solves) here.push_back(out.plan.solves[s].scenario);
    const bool other = lost.contains(place);
    Focus about = other ? pipeline.focus.scaled(of_lost) : pipeline.focus;
    Body wanted = focused_on_contact(body, coarse, here, about);
    if (!more[place].empty()) {
      about.growth = std::min(about.growth, Focus{}.growth);
      wanted = focused(wanted, more[place], about);
    }
    try {
      out.places[place] = std::make_unique<PadOf<P>>(
          pipeline.simulator.prepare(body, mesh_body(wanted, pipeline.mesher, pipeline.mesh_order)));
    } catch (const MeshError&) {
      if (more[place].empty() && !other) throw;
    }
  }
};

}  // namespace detail

/// Presses a body in every scenario. Where a mesh turns out to be too coarse for a contact, or a press is lost on it at
/// a place or two, that is meshed and pressed once more (Pipeline::refine_once). Bit-identical for every executor.
/// Throws InvalidArgument and MeshError; a solve that fails is a status in its record.
template <class P, Indenter Tool, Executor E> Pressed<PadOf<P>, Tool> press(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const ProgressReport& progress = {}) {
  const Stopwatch clock;
  const ChannelImages images = detail::LitSides(body, pipeline.tracer).images;
  Pressed<PadOf<P>, Tool> out;
  out.scenarios = scenarios;
  out.plan =
      plan_contacts(scenarios, body.symmetry, {pipeline.mirror_once && images[0], pipeline.mirror_once && images[1]});

  detail::PlacePresses<P, Tool> presses{body, pipeline, mesh_body(body, pipeline.mesher), out};
  std::vector<std::size_t> places(out.plan.places.size());
  std::iota(places.begin(), places.end(), std::size_t(0));
  presses.run(places, executor, progress, "");
  if (pipeline.refine_once)
    if (const auto again = presses.to_try_again(); !again.empty())
      presses.run(again, executor, progress, " again, finer");
  for (const auto& s : out.solved) out.seconds.mechanics += s.seconds;
  out.seconds.total = clock.seconds();
  return out;
}

/// Are the mirror images of the channels of `body` known in all planes in which these presses stand for their mirror
/// images? Only then can `body` be lit in them.
template <class P, class Pad, Indenter Tool>
bool has_image_channels(const Body& body, const Pressed<Pad, Tool>& pressed, const P& pipeline) {
  return detail::images_known(pressed.plan, detail::LitSides(body, pipeline.tracer).images);
}

/// Lights a body in every state that was pressed, and states that decide J_obs again with more rays. `body` is the one
/// that was pressed, or differs from it in its optics only. The seconds contain those of the presses. Bit-identical for
/// every executor. Throws InvalidArgument, also unless has_image_channels(), and as Tracer::trace() does.
template <class P, class Pad, Indenter Tool, Executor E> Observations observe(const Body& body,
    const Pressed<Pad, Tool>& pressed, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  const Stopwatch clock;
  const detail::LitSides sides(body, pipeline.tracer);
  if (!detail::images_known(pressed.plan, sides.images))
    throw InvalidArgument(
        "observe: contacts were pressed once with their mirror images, but channels of the light have none");
  const bool has_light = !sides.seen.empty();
  Observations out;

  // Light: first for all states, then with more rays for those that decide.
  Lighting lighting(sides.lit(body), pressed.plan, pipeline.tracer, pipeline.rays, pressed.places, pressed.solved);
  const auto trace = [&](const auto& states, std::string stage) {
    detail::StageReport tracing(progress, std::move(stage));
    lighting.trace(states, executor, [&](std::size_t total) { tracing.step(total); });
  };
  if (has_light) {
    trace(lighting.all(), "light");
    out.unloaded_response = detail::mean_per_emitted(lighting.unloaded(), &Response::power_W, sides.seen);
    out.unloaded_error = detail::mean_per_emitted(lighting.unloaded(), &Response::error_W, sides.seen);
    const bool scored = all_scored(lighting.records(), pipeline.accept_held);
    for (int round = 1; scored && round <= pipeline.rays.rounds; ++round) {
      const auto undecided = lighting.undecided(
          detail::expanded(pressed.scenarios, sides, pressed.plan, lighting.records()), pipeline.optical_error);
      if (undecided.empty()) break;
      trace(undecided, message("light of ", undecided.size(), " states, round ", round));
    }
  }

  out.scenarios = detail::expanded(pressed.scenarios, sides, pressed.plan, lighting.records());
  for (auto& record : out.scenarios)
    for (auto& s : record.states) {
      for (Eigen::Index b = 0; b < s.change.cols(); ++b)
        s.response.push_back(out.unloaded_response[std::size_t(b)] + s.change.col(b).mean());
      s.change_error = standard_error(s.change);
    }
  for (const auto& p : pressed.places) {
    out.nodes = std::max(out.nodes, p->mesh().nodes.size());
    out.elements = std::max(out.elements, p->mesh().tets.size());
  }
  out.ledger = lighting.ledger;
  out.seconds = pressed.seconds;
  out.seconds.optics = lighting.seconds;
  out.seconds.total += clock.seconds();
  return out;
}

/// Presses and lights a body in every scenario.
template <class P, Indenter Tool, Executor E> Observations observe(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const ProgressReport& progress = {}) {
  return observe(body, press(body, scenarios, pipeline, executor, progress), pipeline, executor, progress);
}

}  // namespace lumo

#endif

// ---- lumo/lab/observe_pad.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_OBSERVE_PAD_HPP
#define SINGLE_INCLUDE_LUMO_LAB_OBSERVE_PAD_HPP

namespace lumo {

/// What is seen of a pad's two sides, by the *deformed* place along the finger (a camera sees where the surface is, not
/// where it was). By default all light that leaves a visible side counts, whatever its direction, which is how the
/// paper's own model reads an image (r_b). A real lens sees a narrow cone: one that looks level or down on a pad that
/// does not scatter sees hardly more than shadows, because a dent throws light down and outwards (docs/virtual_lab.md).
/// Channels 0 … bins − 1 are the side x > 0, the others the side x < 0, each from proximal to distal.
struct SideSight {
  int bins = 60;
  double half_range_m = 30.0_mm;
  double pitch_rad = 0.0;  ///< of the line of sight above the base plane: the camera looks down on the pad by so much
  double cone_rad = pi;    ///< half angle of the cone about the line of sight; π: all directions

  int channels(const Body&) const { return 2 * bins; }
  int channel(const Escape& e) const {
    if (e.region < 0) return -1;
    const bool right = e.reference.x() > 0.0;
    const double sideways = right ? e.direction.x() : -e.direction.x();
    if (cone_rad < pi && sideways * std::cos(pitch_rad) + e.direction.z() * std::sin(pitch_rad) < std::cos(cone_rad))
      return -1;
    const double at = (e.position.y() + half_range_m) / (2.0 * half_range_m) * bins;
    return at >= 0.0 && at < bins ? int(at) + (right ? 0 : bins) : -1;
  }
  /// Middles of the bins of one side [m].
  std::vector<double> positions_m() const {
    std::vector<double> y;
    for (int b = 0; b < bins; ++b) y.push_back(half_range_m * ((2 * b + 1.0) / bins - 1.0));
    return y;
  }
};

static_assert(ExitReadout<SideSight>);

/// The body with the sight's bins for regions, on the surface that was visible before (whose ends now reach as far as
/// the sight does). `min_abs_nx`: of the undeformed normal, as FingerOptions::Readout says. Throws InvalidArgument for
/// numbers out of range.
inline Body seen_from_sides(std::type_identity_t<Body> body, const SideSight& sight, double min_abs_nx = 0.5) {
  require_in_range("bins of the side's sight", sight.bins, 2, 4096, "");
  require_positive("range of the side's sight", sight.half_range_m, "m");
  require_in_range("cone of the side's sight", sight.cone_rad, 0.01, pi, "rad");
  const int n = sight.bins;
  body.regions = 2 * n;
  std::vector<int> other_side(std::size_t(2 * n)), other_end(std::size_t(2 * n));
  for (int b = 0; b < n; ++b) {
    other_side[std::size_t(b)] = b + n;
    other_side[std::size_t(b + n)] = b;
    other_end[std::size_t(b)] = n - 1 - b;
    other_end[std::size_t(b + n)] = 2 * n - 1 - b;
  }
  body.seen_towards = Vec3d::Zero();
  body.region_image_x = other_side;
  body.region_image_y = other_end;
  body.region = [n, half = sight.half_range_m, min_abs_nx](const Vec3d& p, const Vec3d& normal) {
    if (std::abs(normal.x()) < min_abs_nx || std::abs(p.y()) > half) return -1;
    const int b = std::clamp(int((p.y() + half) / (2.0 * half) * n), 0, n - 1);
    return p.x() > 0.0 ? b : b + n;
  };
  return body;
}

/// `from`, `from` + `spacing` … `to` [m].
inline std::vector<double> even_places(double from, double to, double spacing) {
  std::vector<double> y;
  for (int k = 0; from + spacing * k < to + 0.5 * spacing; ++k) y.push_back(from + spacing * k);
  return y;
}

/// Where and how hard a pad is pressed for the virtual lab.
struct PadGrid {
  double diameter_m = 10.0_mm;
  std::vector<double> load_N{1.0, 2.0, 5.0, 10.0, 15.0};
  /// Ascending; from 0 for a pad with equal ends. Loads and places are the built finger's: at 20 N its silicone folds
  /// over the carrier's edge at some places, and its open proximal end gives way at 15 N from y = −26 mm on.
  std::vector<double> place_m = even_places(-24.0_mm, 28.0_mm, 2.0_mm);
  double tilt_rad = 4.0_deg;  ///< of an approach from the side, from which follows what small angles do
  std::vector<double> tilt_place_m{-22.0_mm, 0.0, 22.0_mm};

  /// The straight approaches, then the tilted ones.
  std::vector<Scenario<Sphere>> scenarios() const {
    std::vector<Scenario<Sphere>> all;
    for (const double y : place_m) all.push_back({Sphere{diameter_m}, 0.0, y, load_N});
    for (const double y : tilt_place_m) all.push_back({Sphere{diameter_m}, tilt_rad, y, load_N});
    return all;
  }
};

/// Presses the pad at all places of the grid and traces its light: mechanics and optics as everywhere else, read out as
/// `sight` says. The pipeline's tracer must have `sight` for its readout; `body` must be symmetric in x.
/// Throws InvalidArgument, MeshError, and PressFailure when a press does not converge.
template <class P, Executor E> PadResponses observe_pad(const Body& body, const SideSight& sight, const PadGrid& grid,
    const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  if (!body.symmetry.x) throw InvalidArgument("virtual lab: the pad must be symmetric in x");
  const bool equal_ends = body.symmetry.y;
  require_in_range("places of the virtual lab", double(grid.place_m.size()), 2, 1000, "");
  if (equal_ends != (grid.place_m[0] == 0.0))
    throw InvalidArgument(message("virtual lab: the first place is y = ", 1e3 * grid.place_m[0], " mm, must be ",
        equal_ends ? "0: the pad has equal ends" : "below 0: the pad's ends are not alike"));
  require_in_range("tilt of the virtual lab", grid.tilt_rad, 0.001, 0.5, "rad");
  const std::vector<Scenario<Sphere>> scenarios = grid.scenarios();
  const Observations seen = observe(seen_from_sides(body, sight), scenarios, pipeline, executor, progress);
  for (const ScenarioRecord& s : seen.scenarios)
    if (s.status != Status::converged)
      throw PressFailure(message("virtual lab: no equilibrium at ", s.states.back().load_N, " N, y = ", 1e3 * s.y_m,
          " mm (", to_string(s.status), ")"));

  const Eigen::Index bins = sight.bins, loads = Eigen::Index(grid.load_N.size());
  PadResponses r;
  r.diameter_m = grid.diameter_m;
  const std::vector<double> at = sight.positions_m();
  r.position_m = Eigen::Map<const Eigen::VectorXd>(at.data(), bins);
  const Eigen::Map<const Eigen::VectorXd> rest(seen.unloaded_response.data(), 2 * bins);
  r.unloaded = 0.5 * (rest.head(bins) + rest.tail(bins));
  if (equal_ends) r.unloaded = 0.5 * (r.unloaded + r.unloaded.reverse().eval());
  r.load_N = Eigen::Map<const Eigen::VectorXd>(grid.load_N.data(), loads);
  const auto is_straight = [](const Scenario<Sphere>& s) { return s.angle_rad == 0.0; };
  const auto places = Eigen::Index(grid.place_m.size());
  r.place_m.resize(places);
  r.depth_m.resize(loads, places);
  r.tilt_place_m.resize(Eigen::Index(scenarios.size()) - places);
  r.error = Eigen::VectorXd::Zero(loads);
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    const bool straight = is_straight(scenarios[k]);
    Eigen::MatrixXd part(bins, loads);
    for (Eigen::Index l = 0; l < loads; ++l) {
      const StateRecord& s = seen.scenarios[k].states[std::size_t(l)];
      const Eigen::MatrixXd right = s.change.leftCols(bins), left = s.change.rightCols(bins),
                            wanted = straight ? Eigen::MatrixXd(0.5 * (right + left))
                                              : Eigen::MatrixXd(0.5 * (right - left) / grid.tilt_rad);
      part.col(l) = wanted.colwise().mean().transpose();
      if (!straight) continue;
      double squares = 0.0;
      for (const double e : standard_error(wanted)) squares += e * e;
      r.error[l] += squares / double(bins * places);
      r.depth_m(l, Eigen::Index(k)) = s.depth_m;
    }
    // At y = 0 a pad with equal ends is its own mirror image; only the rays are not.
    if (equal_ends && scenarios[k].y_m == 0.0) part = (0.5 * (part + part.colwise().reverse())).eval();
    (straight ? r.change : r.tilt).push_back(std::move(part));
    (straight ? r.place_m[Eigen::Index(k)] : r.tilt_place_m[Eigen::Index(k) - places]) = scenarios[k].y_m;
  }
  r.error = r.error.cwiseSqrt().eval();
  return r;
}

}  // namespace lumo

#endif

// ---- lumo/core/part.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_PART_HPP
#define SINGLE_INCLUDE_LUMO_CORE_PART_HPP

namespace lumo {

/// A file or folder that is written beside its place, as `<place>.part-…`, until it is whole. Its writer holds a lock
/// on it (flock(2)), which the kernel frees when the writer dies, in whichever container: the next one to write the
/// same removes what the dead have left.
class Part {
 public:
  enum class Kind { file, folder };

  /// A new one that no other writer has; nullopt if it cannot be made: errno says why.
  static std::optional<Part> make(const std::filesystem::path& place, Kind kind) {
    for (int tries = 0; tries < 100; ++tries) {  // one that sweep() took for a dead writer's is made again
      const std::string name = message(place.string(), ".part-", steady_ns(), '-', ::getpid());
      const int file = kind == Kind::file            ? ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666)
                       : ::mkdir(name.c_str(), 0777) ? -1
                                                     : ::open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
      if (file < 0 && errno == EEXIST) continue;
      if (file < 0) return std::nullopt;
      // Where a file system has no locks nothing is swept; where sweep() has this one's, it is about to be removed.
      const bool is_swept = ::flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
      struct stat mine = {}, there = {};
      if (!is_swept && ::fstat(file, &mine) == 0 && ::stat(name.c_str(), &there) == 0 && mine.st_ino == there.st_ino)
        return Part(name, file);
      ::close(file);
    }
    errno = EEXIST;
    return std::nullopt;
  }
  /// Removes what dead writers have left at this place.
  static void sweep(const std::filesystem::path& place) {
    namespace fs = std::filesystem;
    const std::string begin = place.filename().string() + ".part-";
    std::error_code error;
    const fs::path folder = place.has_parent_path() ? place.parent_path() : fs::path(".");
    for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
      const std::string name = at->path().filename().string();
      if (!name.starts_with(begin) || name.find_first_not_of("0123456789abcdefx-", begin.size()) != std::string::npos)
        continue;
      const int left = ::open(at->path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
      if (left < 0) continue;
      std::error_code none;
      if (::flock(left, LOCK_EX | LOCK_NB) == 0) fs::remove_all(at->path(), none);
      ::close(left);
    }
  }

  Part(Part&& other) noexcept : path_(std::move(other.path_)), file_(std::exchange(other.file_, -1)) {}
  Part& operator=(Part&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(file_, other.file_);
    return *this;
  }
  /// Removes it, unless it has its name.
  ~Part() {
    std::error_code none;
    if (file_ >= 0 && !path_.empty()) std::filesystem::remove_all(path_, none);
    if (file_ >= 0) ::close(file_);
  }

  const std::filesystem::path& path() const { return path_; }
  /// Writes at the end of a file; errno says why not.
  bool write(std::string_view bytes) const {
    while (!bytes.empty()) {
      const ::ssize_t n = ::write(file_, bytes.data(), bytes.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return false;
      bytes.remove_prefix(std::size_t(n));
    }
    return true;
  }
  /// Brings it to the disk, but not what is in a folder; errno says why not.
  bool synchronise() const { return ::fsync(file_) == 0; }
  /// Gives it its name; what had it is replaced. errno says why not.
  bool take_name(const std::filesystem::path& name) {
    if (::rename(path_.c_str(), name.c_str()) != 0) return false;
    path_.clear();
    return true;
  }

 private:
  Part(std::string path, int file) : path_(std::move(path)), file_(file) {}

  std::filesystem::path path_;
  int file_ = -1;
};

}  // namespace lumo

#endif

// ---- lumo/core/files.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_FILES_HPP
#define SINGLE_INCLUDE_LUMO_CORE_FILES_HPP

namespace lumo {

/// Bytes of a regular file; nullopt for anything else.
inline std::optional<std::uintmax_t> file_size(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  return error ? std::nullopt : std::optional(size);
}

/// All bytes of a regular file; nullopt if there is none, it cannot be read, or it has more than `most` bytes. (A pipe
/// would wait, a folder reads as empty.)
inline std::optional<std::string> read_whole(const std::string& path, std::uintmax_t most = std::uintmax_t{1} << 29) {
  const auto size = file_size(path);
  if (!size || *size > most) return std::nullopt;
  std::ifstream in(path, std::ios::binary);
  if (!in) return std::nullopt;
  std::string bytes(std::size_t(*size), '\0');
  in.read(bytes.data(), std::streamsize(bytes.size()));
  if (in.bad()) return std::nullopt;
  bytes.resize(std::size_t(in.gcount()));
  return bytes;
}

/// All bytes of a file, a pipe or a device that ends. Throws InputError of one line that names file and reason, also
/// for more than `most` bytes.
inline std::string read_text(const std::string& path, std::size_t most = std::size_t{1} << 26) {
  const auto refuse = [&](const std::string& why) { throw InputError(message(path, ": cannot be read: ", why)); };
  const auto reason = [] { return std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message(); };
  errno = 0;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), std::fclose);
  if (!file) refuse(reason());
  std::string text(std::size_t{1} << 16, '\0');
  for (std::size_t size = 0;;) {
    if (size == text.size()) text.resize(std::min(2 * size, most + 1));
    const std::size_t n = std::fread(text.data() + size, 1, text.size() - size, file.get());
    size += n;
    if (size > most) refuse(message("it has more than ", most, " bytes"));
    if (n > 0) continue;
    if (std::ferror(file.get()) != 0) refuse(reason());
    text.resize(size);
    return text;
  }
}

/// Brings a file or folder to the disk; errno says why not.
inline bool synchronise(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return false;
  const bool done = ::fsync(file) == 0;
  const int why = errno;
  ::close(file);
  errno = why;
  return done;
}

/// What a power failure leaves of a file that was written.
enum class Durability {
  disk,   ///< the whole of it, once the call has returned
  memory  ///< what the system had written by then: for the many pictures of a recording
};

/// The whole file or none, after a power failure, too: written beside its place as a Part, brought to the disk, then
/// renamed; an older one is replaced. Throws InputError of one line, and leaves what was there.
inline void write_whole(const std::string& path, std::string_view bytes, Durability durability = Durability::disk) {
  const bool durable = durability == Durability::disk;
  if (durable) Part::sweep(path);
  errno = 0;
  std::optional<Part> part = Part::make(path, Part::Kind::file);
  if (part && part->write(bytes) && (!durable || part->synchronise()) && part->take_name(path)) {
    if (durable) synchronise(std::filesystem::absolute(path).parent_path().string());  // the name must last as well
    return;
  }
  throw InputError(message(
      path, ": cannot be written: ", std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message()));
}

}  // namespace lumo

#endif

// ---- lumo/lab/pad_file.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_PAD_FILE_HPP
#define SINGLE_INCLUDE_LUMO_LAB_PAD_FILE_HPP

namespace lumo {

// Responses of a pad as a text file: a line that names the format, the key of what was computed, blocks "name rows
// columns" with their numbers row by row, and a last line with a checksum of all before it.

inline constexpr std::string_view pad_file_head = "lumo-pad-responses 1\n";

inline std::uint64_t checksum(std::string_view text) {
  std::uint64_t sum = text.size();
  for (const char c : text) sum = mix64(sum ^ std::uint64_t(static_cast<unsigned char>(c))) + 0x9e3779b97f4a7c15ull;
  return sum;
}

inline void append_block(std::string& to, const char* name, const Eigen::MatrixXd& m) {
  to += message(name, ' ', m.rows(), ' ', m.cols(), '\n');
  char buffer[32];
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j) {
      const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, m(i, j));
      to.append(buffer, end);
      to += j + 1 < m.cols() ? ' ' : '\n';
    }
}

/// Reads blocks in the order in which they were written. Throws InputError.
class BlockReader {
 public:
  BlockReader(std::string_view text, std::string name) : left_(text), name_(std::move(name)) {}

  std::string_view line() {
    const auto end = left_.find('\n');
    if (end == std::string_view::npos) fail("ends too early");
    const std::string_view l = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    return l;
  }
  Eigen::MatrixXd block(std::string_view wanted) {
    const std::string_view head = line();
    const auto first = head.find(' '), second = head.find(' ', first + 1);
    long rows = -1, columns = -1;
    if (first == std::string_view::npos || second == std::string_view::npos || head.substr(0, first) != wanted)
      fail("a block is missing");
    std::from_chars(head.data() + first + 1, head.data() + second, rows);
    std::from_chars(head.data() + second + 1, head.data() + head.size(), columns);
    if (rows < 0 || columns < 0 || rows > 100000 || columns > 10000 || rows * columns > 4000000)
      fail("a block has no sensible size");
    Eigen::MatrixXd m(rows, columns);
    for (long i = 0; i < rows && columns > 0; ++i) {
      const std::string_view l = line();
      const char* at = l.data();
      for (long j = 0; j < columns; ++j) {
        const auto [end, error] = std::from_chars(at, l.data() + l.size(), m(i, j));
        if (error != std::errc{}) fail("a number is damaged");
        at = end + (end < l.data() + l.size());
      }
    }
    return m;
  }
  Eigen::VectorXd column(std::string_view wanted) {
    const Eigen::MatrixXd m = block(wanted);
    if (m.cols() != 1) fail("a block has more than one column");
    return m.col(0);
  }
  [[noreturn]] void fail(const char* why) const { throw InputError(message(name_, ": ", why)); }

 private:
  std::string_view left_;
  std::string name_;
};

/// `key` names in one line what was computed and how; a reader must ask for the same.
inline std::string to_text(const PadResponses& r, const std::string& key) {
  std::string t(pad_file_head);
  t += "key " + key + "\nmaterial " + r.material + '\n';
  const auto add = [&](const char* name, const Eigen::MatrixXd& m) { append_block(t, name, m); };
  add("theta_mm", Eigen::Map<const Eigen::VectorXd>(r.theta_mm.data(), Eigen::Index(r.theta_mm.size())));
  add("diameter_m", Eigen::MatrixXd::Constant(1, 1, r.diameter_m));
  add("position_m", r.position_m);
  add("unloaded", r.unloaded);
  add("place_m", r.place_m);
  add("load_N", r.load_N);
  add("depth_m", r.depth_m);
  for (const auto& m : r.change) add("change", m);
  add("tilt_place_m", r.tilt_place_m);
  for (const auto& m : r.tilt) add("tilt", m);
  add("error", r.error);
  return t + message("checksum ", checksum(t), '\n');
}

/// Throws InputError of one line for what is damaged or was made for another key; without a key any will do. `name`
/// stands in the message.
inline PadResponses pad_responses_from_text(
    std::string_view text, const std::optional<std::string>& key, const std::string& name) {
  BlockReader reader(text, name);
  if (!text.starts_with(pad_file_head)) reader.fail("holds no responses of a pad");
  const auto last = text.rfind("checksum ");
  if (last == std::string_view::npos || text.substr(last) != message("checksum ", checksum(text.substr(0, last)), '\n'))
    reader.fail("is damaged, its checksum is wrong");
  reader.line();
  const std::string_view made_for = reader.line();
  if (key && made_for != "key " + *key) reader.fail("was made for another pad or with other settings");
  PadResponses r;
  const std::string_view material = reader.line();
  r.material = material.substr(std::min<std::size_t>(material.size(), 9));
  const Eigen::VectorXd theta = reader.column("theta_mm");
  r.theta_mm.assign(theta.begin(), theta.end());
  const Eigen::MatrixXd diameter = reader.block("diameter_m");
  if (diameter.size() != 1) reader.fail("the diameter is missing");
  r.diameter_m = diameter(0, 0);
  r.position_m = reader.column("position_m");
  r.unloaded = reader.column("unloaded");
  r.place_m = reader.column("place_m");
  r.load_N = reader.column("load_N");
  r.depth_m = reader.block("depth_m");
  for (Eigen::Index k = 0; k < r.place_m.size(); ++k) r.change.push_back(reader.block("change"));
  r.tilt_place_m = reader.column("tilt_place_m");
  for (Eigen::Index k = 0; k < r.tilt_place_m.size(); ++k) r.tilt.push_back(reader.block("tilt"));
  r.error = reader.column("error");
  validate(r, name);
  return r;
}

/// nullopt if there is no such file. Throws InputError for one that cannot be used.
inline std::optional<PadResponses> read_pad_responses(
    const std::string& path, const std::optional<std::string>& key = {}) {
  if (std::error_code unseen; !std::filesystem::exists(path, unseen)) return std::nullopt;
  const auto text = read_whole(path);
  if (!text) throw InputError(message(path, ": cannot be read"));
  return pad_responses_from_text(*text, key, path);
}

/// The whole file or none. Throws InputError.
inline void write_pad_responses(const std::string& path, const PadResponses& r, const std::string& key) {
  write_whole(path, to_text(r, key));
}

}  // namespace lumo

#endif

// ---- lumo/sense/localize/location_estimator.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_LOCATION_ESTIMATOR_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_LOCATION_ESTIMATOR_HPP

namespace lumo::sense {

/// Where the finger is touched, and how sure that is.
struct ContactLocation {
  double y_m = 0.0;
  double variance_m2 = 0.0;       ///< of all errors
  double amplitude = 0.0;         ///< of the response there, in the readout's unit
  double bias_variance_m2 = 0.0;  ///< the part that stays the same from profile to profile
  /// Of this profile's own information, without bias: for a filter that takes estimates as independent.
  double noise_variance_m2 = 0.0;
};

/// Throws InvalidArgument unless positions of a profile are finite and ascend.
inline void require_ascending_positions(const Eigen::VectorXd& position_m) {
  for (Eigen::Index i = 0; i < position_m.size(); ++i) {
    require_in_range("position of a profile's value", position_m[i], -10.0, 10.0, "m");
    if (i > 0 && !(position_m[i] > position_m[i - 1]))
      throw InvalidArgument(message("position ", i, " of a profile is ", position_m[i],
          " m, must exceed its predecessor, ", position_m[i - 1], " m"));
  }
}

/// Contacts by one profile and those before it. Always finite.
struct LocationEstimate {
  std::int64_t stamp_ns = 0;
  int contacts = 0;                        ///< 0, 1 or 2
  std::array<ContactLocation, 2> contact;  ///< the first `contacts` count, the stronger one first
  double probability = 1.0;                ///< of this number of contacts under the model
  /// The response is neither no contact nor any that the model knows: no place is given, and that means nothing.
  bool unknown = false;
};

/// Can a response be worked with: are its values finite, and their squares?
inline bool is_usable(const Profile& response) {
  constexpr double largest = 1e100;
  return (response.value.array().abs() <= largest).all();
}

/// Locates contacts from responses: profiles minus the unloaded reference.
/// Laws: causal, the estimate depends on this and earlier responses only; always finite; a response that is not newer
/// than its predecessor, or not usable (is_usable), changes only the answer's stamp, but that a gap without usable ones
/// is forgotten; after `reset` the estimator is as new.
template <class L>
concept LocationEstimator = requires(L& localizer, const Profile& response) {
  { localizer.update(response) } -> std::same_as<LocationEstimate>;
  localizer.reset();
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/localize/response_templates.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_RESPONSE_TEMPLATES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_RESPONSE_TEMPLATES_HPP

namespace lumo::sense {

/// What contacts at known places and loads do to the light along one pad: computed, or recorded. In any unit;
/// `unloaded` is in the same one.
struct ResponseTemplates {
  Eigen::VectorXd position_m;          ///< of a response's values, ascending
  Eigen::VectorXd unloaded;            ///< light at rest at each; empty: not known, responses are in the readout's unit
  Eigen::VectorXd place_m;             ///< ascending
  Eigen::VectorXd load_N;              ///< ascending, > 0
  std::vector<Eigen::MatrixXd> value;  ///< by place: positions × loads
  /// By place: what a contact does on top that comes from the side, one standard deviation of its angle; empty: not
  /// known.
  std::vector<Eigen::MatrixXd> sideways;
};

/// Throws InvalidArgument for parts that do not fit together or are not finite.
inline void validate(const ResponseTemplates& t) {
  const Eigen::Index positions = t.position_m.size(), places = t.place_m.size(), loads = t.load_N.size();
  const auto require = [](bool good, const char* what) {
    if (!good) throw InvalidArgument(message("templates of responses: ", what));
  };
  require(positions >= 3, "there must be at least 3 positions");
  require_ascending_positions(t.position_m);
  require(t.unloaded.size() == 0 || (t.unloaded.size() == positions && t.unloaded.allFinite() && t.unloaded.sum() > 0),
      "light at rest must be finite, and there must be some");
  require(places >= 2 && t.place_m.allFinite() && loads >= 1 && t.load_N.allFinite(),
      "there must be at least 2 places and a load");
  for (Eigen::Index k = 1; k < places; ++k) require(t.place_m[k] > t.place_m[k - 1], "places must ascend");
  for (Eigen::Index k = 0; k < loads; ++k)
    require(t.load_N[k] > (k > 0 ? t.load_N[k - 1] : 0.0), "loads must be positive and ascend");
  require(Eigen::Index(t.value.size()) == places && (t.sideways.empty() || t.sideways.size() == t.value.size()),
      "each place must have its responses");
  for (const auto* list : {&t.value, &t.sideways})
    for (const Eigen::MatrixXd& m : *list)
      require(m.rows() == positions && m.cols() == loads && is_usable({0, m.reshaped(), 0.0}),
          "a response is missing or not finite");
}

/// The response to one contact between the known places, at given positions.
struct TemplateResponse {
  Eigen::VectorXd value;
  Eigen::VectorXd doubt;     ///< what two ways to go from place to place differ by
  Eigen::VectorXd sideways;  ///< as in the templates; 0 where not known
};

/// Templates in between. From load to load linear, from 0 at 0 N, beyond the last load with its slope. From place to
/// place the mean of two ways: each value changes linearly, or the shape moves along with the contact and changes
/// linearly. The first is right for light that stays at an LED, the second for light that stays at the contact. Places
/// beyond the first or last move with the contact.
class TemplateField {
 public:
  /// Throws InvalidArgument for templates that do not fit together.
  explicit TemplateField(ResponseTemplates templates) : t_(std::move(templates)) { validate(t_); }

  const ResponseTemplates& templates() const { return t_; }
  double first_place_m() const { return t_.place_m[0]; }
  double last_place_m() const { return t_.place_m[t_.place_m.size() - 1]; }
  double max_load_N() const { return t_.load_N[t_.load_N.size() - 1]; }

  TemplateResponse at(const Eigen::VectorXd& position_m, double y_m, double load_N) const {
    const Eigen::Index last = t_.place_m.size() - 1;
    const auto above = std::upper_bound(t_.place_m.begin(), t_.place_m.end(), y_m) - t_.place_m.begin();
    const Eigen::Index k = std::clamp<Eigen::Index>(above - 1, 0, last - 1);
    const double gap = t_.place_m[k + 1] - t_.place_m[k], share = std::clamp((y_m - t_.place_m[k]) / gap, 0.0, 1.0);
    const double beyond = y_m - (t_.place_m[k] + share * gap);
    const auto between = [&](const std::vector<Eigen::MatrixXd>& list, double moved) {
      const Eigen::VectorXd a = at_load(list[std::size_t(k)], load_N), b = at_load(list[std::size_t(k) + 1], load_N);
      Eigen::VectorXd v(position_m.size());
      for (Eigen::Index i = 0; i < v.size(); ++i) {
        const double x = position_m[i] - beyond;
        v[i] =
            (1.0 - share) * sampled(a, x - moved * share * gap) + share * sampled(b, x + moved * (1.0 - share) * gap);
      }
      return v;
    };
    const Eigen::VectorXd stays = between(t_.value, 0.0), moves = between(t_.value, 1.0);
    return {0.5 * (stays + moves), moves - stays,
        t_.sideways.empty() ? Eigen::VectorXd(Eigen::VectorXd::Zero(position_m.size())) : between(t_.sideways, 0.0)};
  }
  /// Light at rest at given positions; none where it is not known.
  Eigen::VectorXd unloaded_at(const Eigen::VectorXd& position_m) const {
    if (t_.unloaded.size() == 0) return {};
    Eigen::VectorXd v(position_m.size());
    for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = sampled(t_.unloaded, position_m[i]);
    return v;
  }

 private:
  Eigen::VectorXd at_load(const Eigen::MatrixXd& by_load, double load_N) const {
    const Eigen::Index last = t_.load_N.size() - 1;
    const auto above = std::upper_bound(t_.load_N.begin(), t_.load_N.end(), load_N) - t_.load_N.begin();
    const Eigen::Index k = std::min<Eigen::Index>(above, last);
    if (k == 0) return load_N / t_.load_N[0] * by_load.col(0);
    const double share = (load_N - t_.load_N[k - 1]) / (t_.load_N[k] - t_.load_N[k - 1]);
    return (1.0 - share) * by_load.col(k - 1) + share * by_load.col(k);
  }
  /// Linear between the positions, the end values beyond them.
  double sampled(const Eigen::VectorXd& v, double x) const {
    const Eigen::VectorXd& p = t_.position_m;
    if (!(x > p[0])) return v[0];
    if (!(x < p[p.size() - 1])) return v[v.size() - 1];
    const Eigen::Index k = std::upper_bound(p.begin(), p.end(), x) - p.begin() - 1;
    return v[k] + (x - p[k]) / (p[k + 1] - p[k]) * (v[k + 1] - v[k]);
  }

  ResponseTemplates t_;
};

/// A response at a known place and load, as a hold of a log has it.
struct PressedResponse {
  double y_m = 0.0, load_N = 0.0;
  Eigen::VectorXd response;
};

/// Templates from recorded contacts, in their unit: the mean at each place and load. Loads that not all places have are
/// left out. Throws InvalidArgument for fewer than two places, or no load that all of them have.
inline ResponseTemplates recorded_templates(
    const Eigen::VectorXd& position_m, const std::vector<PressedResponse>& pressed) {
  std::map<double, std::map<double, std::pair<Eigen::VectorXd, int>>> sums;  // by place and load
  std::map<double, std::size_t> places_with;                                 // by load
  for (const PressedResponse& p : pressed) {
    if (p.response.size() != position_m.size())
      throw InvalidArgument(
          message("recorded response has ", p.response.size(), " values, must have ", position_m.size()));
    const bool seen = sums[p.y_m].contains(p.load_N);
    auto& [sum, count] = sums[p.y_m][p.load_N];
    sum = seen ? Eigen::VectorXd(sum + p.response) : p.response;
    ++count;
    places_with[p.load_N] += !seen;
  }
  ResponseTemplates t;
  t.position_m = position_m;
  std::vector<double> loads;
  for (const auto& [load, places] : places_with)
    if (load > 0.0 && places == sums.size()) loads.push_back(load);
  if (sums.size() < 2 || loads.empty())
    throw InvalidArgument(message("recorded responses are of ", sums.size(), " places with ", loads.size(),
        " loads that all of them have, must be at least 2 places and a load"));
  t.load_N = Eigen::Map<const Eigen::VectorXd>(loads.data(), Eigen::Index(loads.size()));
  t.place_m.resize(Eigen::Index(sums.size()));
  for (const auto& [place, by_load] : sums) {
    t.place_m[Eigen::Index(t.value.size())] = place;
    Eigen::MatrixXd value(position_m.size(), t.load_N.size());
    for (Eigen::Index l = 0; l < t.load_N.size(); ++l) {
      const auto& [sum, count] = by_load.at(t.load_N[l]);
      value.col(l) = sum / double(count);
    }
    t.value.push_back(std::move(value));
  }
  validate(t);
  return t;
}

/// Templates in the readout's unit [DN], by what the picture of the unloaded finger has for the templates' light at
/// rest. Room light and the camera's black level are on top of it, so that the size is known to a quarter at best.
/// Positions within 2.5 mm of a lamp, whose package shows through, are left out. Templates without light at rest stay
/// as they are. Throws InvalidArgument where none of the light is seen.
inline ResponseTemplates scaled_to(ResponseTemplates t, const Eigen::VectorXd& position_m,
    const Eigen::VectorXd& unloaded_DN, const std::vector<double>& lamp_m) {
  constexpr double near_m = 2.5e-3, room_DN = 5.0, room_sigma_DN = 5.0, fit_sigma_DN = 5.0;  // assumed
  if (t.unloaded.size() == 0) return t;
  const Eigen::VectorXd light = TemplateField(t).unloaded_at(position_m);
  if (unloaded_DN.size() != position_m.size())
    throw InvalidArgument(
        message("unloaded profile has ", unloaded_DN.size(), " values, must have ", position_m.size()));
  // Least squares of scale · light + room, with the room's prior.
  const double by_room = 1.0 / (room_sigma_DN * room_sigma_DN), by_value = 1.0 / (fit_sigma_DN * fit_sigma_DN);
  Eigen::Matrix2d normal{{0.0, 0.0}, {0.0, by_room}};
  Eigen::Vector2d right(0.0, by_room * room_DN);
  for (Eigen::Index i = 0; i < light.size(); ++i) {
    if (std::any_of(lamp_m.begin(), lamp_m.end(), [&](double y) { return std::abs(position_m[i] - y) < near_m; }))
      continue;
    const Eigen::Vector2d row(light[i], 1.0);
    normal += by_value * row * row.transpose();
    right += by_value * unloaded_DN[i] * row;
  }
  const double scale = (normal(1, 1) * right[0] - normal(0, 1) * right[1]) / normal.determinant();
  if (!(scale > 0.0) || !std::isfinite(scale))
    throw InvalidArgument("unloaded profile shows none of the light that the pad's templates have at rest");
  t.unloaded *= scale;
  for (auto* list : {&t.value, &t.sideways})
    for (Eigen::MatrixXd& m : *list) m *= scale;
  return t;
}

}  // namespace lumo::sense

#endif

// ---- lumo/lab/pad_templates.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_PAD_TEMPLATES_HPP
#define SINGLE_INCLUDE_LUMO_LAB_PAD_TEMPLATES_HPP

namespace lumo {

/// Computed responses of a pad as templates for a localiser, per emitted power. Mirror images are among them where the
/// pad has equal ends. `angle_sigma_rad`: how far contacts come from the side. Throws InputError for responses that do
/// not fit together.
inline sense::ResponseTemplates templates_of(const PadResponses& responses, double angle_sigma_rad = 0.5_deg) {
  const PadLight light(responses);
  sense::ResponseTemplates t;
  t.position_m = responses.position_m;
  t.unloaded = responses.unloaded;
  t.load_N = responses.load_N;
  const std::vector<double> places = light.places_m();
  t.place_m = Eigen::Map<const Eigen::VectorXd>(places.data(), Eigen::Index(places.size()));
  for (const double y : places) {
    Eigen::MatrixXd value(t.position_m.size(), t.load_N.size()), sideways = value;
    for (Eigen::Index l = 0; l < t.load_N.size(); ++l) {
      value.col(l) = light.change(y, t.load_N[l]);
      sideways.col(l) = light.change(y, t.load_N[l], angle_sigma_rad) - value.col(l);
    }
    t.value.push_back(std::move(value));
    t.sideways.push_back(std::move(sideways));
  }
  return t;
}

}  // namespace lumo

#endif

// ---- lumo/optics/camera_cone.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_CAMERA_CONE_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_CAMERA_CONE_HPP

namespace lumo {

/// Light that leaves through each region of the body into the narrow cone that ends in a camera's lens [W]: what
/// ExitPower counts, of one direction only. PinholeCamera has its picture.
class CameraCone {
 public:
  static constexpr bool gathers_emitters = true;  ///< see WholeReadout

  struct Config {
    Vec3d position{0.0, 0.0, 0.0};  ///< of the lens [m]
    Vec3d view{0.0, 0.0, 1.0};      ///< the way that it looks
    double aperture_m = 0.48e-3;    ///< radius of its opening
  };

  CameraCone() : CameraCone(Config{}) {}
  /// Throws InvalidArgument for numbers out of range.
  explicit CameraCone(const Config& config) : config_(config), view_(config.view.normalized()) {
    require_in_range("radius of the camera's opening", config.aperture_m * 1e3, 1e-6, 1e3, "mm");
    if (!config.position.allFinite()) throw InvalidArgument("camera: its position is not finite");
    if (!(std::abs(view_.norm() - 1.0) < 1e-9)) throw InvalidArgument("camera: its direction of view is none");
    tangents(view_, right_, up_);
  }

  int channels(const Body& body) const { return body.regions; }
  int channel(const Escape& escape) const {
    const double toward = -escape.direction.dot(view_), z = (escape.position - config_.position).dot(view_);
    if (escape.region < 0 || !(toward > 0.0 && z > 0.0)) return -1;
    const Vec3d hit = escape.position + (z / toward) * escape.direction;
    return (hit - config_.position).squaredNorm() < config_.aperture_m * config_.aperture_m ? escape.region : -1;
  }
  int openings() const { return 1; }
  Connection connect(int, const Vec3d& from, double u, double v) const {
    return to_disc(config_.position, view_, config_.aperture_m, from, on_unit_disc(u, v, right_, up_));
  }
  /// nullopt unless the images of all regions are regions, and the camera stands in the plane. Throws as
  /// region_images() does.
  std::optional<std::vector<int>> image_channels(const Body& body, int axis) const {
    if (config_.position[axis] != 0.0 || view_[axis] != 0.0) return std::nullopt;
    return ExitPower{}.image_channels(body, axis);
  }

 private:
  Config config_;
  Vec3d view_, right_, up_;
};

static_assert(WholeReadout<CameraCone>);

}  // namespace lumo

#endif

// ---- lumo/optics/photodiode.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_PHOTODIODE_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_PHOTODIODE_HPP

namespace lumo {

/// A flat detector outside the body, a parallelogram or an ellipse. It sees light that falls on the side to which
/// `half_u` × `half_v` points.
struct Photodiode {
  Vec3d center{0.0, 0.0, 0.0};       ///< [m]
  Vec3d half_u{1e-3, 0.0, 0.0};      ///< half edge, or half axis [m]
  Vec3d half_v{0.0, 1e-3, 0.0};      ///< likewise
  bool round = false;                ///< an ellipse with these half axes
  double acceptance_rad = 0.5 * pi;  ///< largest angle between the light and the normal

  double area_m2() const { return (round ? pi : 4.0) * half_u.cross(half_v).norm(); }
  Vec3d normal() const { return half_u.cross(half_v).normalized(); }
};

/// Photodiodes, a channel each: the power that falls on them [W], as if none stood in another's light.
class Photodiodes {
 public:
  /// Throws InvalidArgument for no photodiodes, or one without area or acceptance.
  explicit Photodiodes(std::vector<Photodiode> diodes) : diodes_(std::move(diodes)) {
    if (diodes_.empty()) throw InvalidArgument("photodiodes: none given, at least one is needed");
    for (const Photodiode& d : diodes_) {
      if (!d.center.allFinite()) throw InvalidArgument("photodiode: its centre is not finite");
      require_positive("area of a photodiode", d.area_m2(), "m2");
      require_in_range("acceptance angle of a photodiode", d.acceptance_rad * 180.0 / pi, 0.1, 90.0, "deg");
    }
  }

  int channels(const Body&) const { return int(diodes_.size()); }
  /// The first one of several photodiodes behind each other.
  int channel(const Escape& escape) const {
    int best = -1;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < diodes_.size(); ++k) {
      const Photodiode& d = diodes_[k];
      if (!(escape.direction.dot(d.normal()) < 0.0) || !accepts(d, escape.direction)) continue;
      const double way = (d.center - escape.position).dot(d.normal()) / escape.direction.dot(d.normal());
      if (!(way > 0.0 && way < nearest)) continue;
      const Vec3d p = escape.position + way * escape.direction - d.center, n = d.half_u.cross(d.half_v);
      const double a = p.cross(d.half_v).dot(n) / n.squaredNorm(), b = d.half_u.cross(p).dot(n) / n.squaredNorm();
      if (d.round ? a * a + b * b < 1.0 : std::abs(a) < 1.0 && std::abs(b) < 1.0) {
        best = int(k);
        nearest = way;
      }
    }
    return best;
  }
  int openings() const { return int(diodes_.size()); }
  Connection connect(int k, const Vec3d& from, double u, double v) const {
    const Photodiode& d = diodes_[std::size_t(k)];
    const Vec3d at = d.center + (d.round ? on_unit_disc(u, v, d.half_u, d.half_v)
                                         : Vec3d((2.0 * u - 1.0) * d.half_u + (2.0 * v - 1.0) * d.half_v));
    const Vec3d way = at - from;
    const double length = way.norm();
    if (!(length > 0.0)) return {};
    const Vec3d direction = way / length;
    if (!(direction.dot(d.normal()) < 0.0) || !accepts(d, direction)) return {};
    return {direction, -direction.dot(d.normal()) * d.area_m2() / (length * length)};
  }
  /// Photodiode → its mirror image; nullopt if one has none.
  std::optional<std::vector<int>> image_channels(const Body&, int axis) const {
    Vec3d mirror = Vec3d::Ones();
    mirror[axis] = -1.0;
    std::vector<int> images;
    for (const Photodiode& d : diodes_) {
      const auto image = std::find_if(diodes_.begin(), diodes_.end(), [&](const Photodiode& o) {
        return o.center == mirror.cwiseProduct(d.center) && o.normal() == mirror.cwiseProduct(d.normal()) &&
               o.acceptance_rad == d.acceptance_rad && o.round == d.round &&
               same_edges(o, mirror.cwiseProduct(d.half_u), mirror.cwiseProduct(d.half_v));
      });
      if (image == diodes_.end()) return std::nullopt;
      images.push_back(int(image - diodes_.begin()));
    }
    return images;
  }

 private:
  static bool same_edges(const Photodiode& d, const Vec3d& u, const Vec3d& v) {
    return (d.half_u == u || d.half_u == -u) && (d.half_v == v || d.half_v == -v);
  }
  static bool accepts(const Photodiode& d, const Vec3d& direction) {
    return -direction.dot(d.normal()) > std::cos(d.acceptance_rad) - 1e-12;
  }

  std::vector<Photodiode> diodes_;
};

static_assert(ConnectedReadout<Photodiodes>);

/// Power that stays on opaque patches of the body, as on photodiodes that lie on its face: a channel for each; over the
/// patch's area it is the absorbed part of the irradiance [W/m²]. Mirror images of a patch are one patch. Light that
/// leaves the body is not seen.
class PatchLight {
 public:
  /// Throws InvalidArgument unless each name is that of one patch of `body`, and its optics Absorber or Mirror.
  PatchLight(const Body& body, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      const auto named = [&](const Patch& p) { return p.name == name; };
      const auto& all = body.patches;
      if (std::count_if(all.begin(), all.end(), named) != 1)
        throw InvalidArgument(message("light is to fall on patch \"", printable(name), "\", the body must have one"));
      const auto patch = std::find_if(all.begin(), all.end(), named);
      if (!std::holds_alternative<Absorber>(patch->optics) && !std::holds_alternative<Mirror>(patch->optics))
        throw InvalidArgument(
            message("light is to stay on patch \"", printable(name), "\", its optics must be Absorber or Mirror"));
      patches_.push_back(int(patch - all.begin()));
    }
  }

  int channels(const Body&) const { return int(patches_.size()); }
  int channel(const Escape&) const { return -1; }
  int landing_channel(const Landing& light) const {
    const auto at = std::find(patches_.begin(), patches_.end(), light.patch);
    return at == patches_.end() ? -1 : int(at - patches_.begin());
  }
  std::optional<std::vector<int>> image_channels(const Body&, int) const { return std::vector<int>{}; }

 private:
  std::vector<int> patches_;
};

static_assert(LandingReadout<PatchLight>);

}  // namespace lumo

#endif

// ---- lumo/optics/pinhole_camera.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTICS_PINHOLE_CAMERA_HPP
#define SINGLE_INCLUDE_LUMO_OPTICS_PINHOLE_CAMERA_HPP

namespace lumo {

/// A camera with one small round opening. Channel row·columns + column holds the power [W] that passes the opening into
/// that pixel; pixels are numbered from the upper left corner of the upright image. The opening holds an ideal thin
/// lens focused at `focus_m`: what lies at another distance z is blurred to a disc of about 2 aperture_m |z/focus_m −
/// 1| there. There is no other approximation.
class PinholeCamera {
 public:
  struct Config {
    Vec3d position{0.0, 0.0, 0.0};                 ///< of the opening [m]
    Vec3d view{0.0, 0.0, 1.0};                     ///< the way that the camera looks
    Vec3d up{0.0, 1.0, 0.0};                       ///< upwards in the image; not along `view`
    double field_of_view_rad = 60.0 * pi / 180.0;  ///< across all columns
    int columns = 32;
    int rows = 32;
    double aperture_m = 0.25e-3;  ///< radius of the opening
    double focus_m = 20e-3;       ///< distance along `view` that is sharp
  };

  /// Throws InvalidArgument for numbers out of range.
  explicit PinholeCamera(const Config& config) : config_(config) {
    require_in_range("columns of the camera", config.columns, 1, 4096, "");
    require_in_range("rows of the camera", config.rows, 1, 4096, "");
    require_in_range("field of view", config.field_of_view_rad * 180.0 / pi, 0.1, 170.0, "deg");
    require_in_range("radius of the camera's opening", config.aperture_m * 1e3, 1e-6, 1e3, "mm");
    require_positive("focus distance of the camera", config.focus_m, "m");
    if (!config.position.allFinite()) throw InvalidArgument("camera: its position is not finite");
    view_ = config.view.normalized();
    right_ = view_.cross(config.up).normalized();
    up_ = right_.cross(view_);
    if (!(std::abs(up_.norm() - 1.0) < 1e-9))
      throw InvalidArgument("camera: the directions of view and up are not finite, or are parallel");
    half_width_ = std::tan(0.5 * config.field_of_view_rad);
    half_height_ = half_width_ * config.rows / config.columns;
  }

  const Config& config() const { return config_; }
  int channels(const Body&) const { return config_.columns * config_.rows; }
  int channel(const Escape& escape) const {
    const double toward = -escape.direction.dot(view_), z = (escape.position - config_.position).dot(view_);
    if (!(toward > 0.0 && z > 0.0)) return -1;
    const Vec3d hit = escape.position + (z / toward) * escape.direction;
    if (!((hit - config_.position).squaredNorm() < config_.aperture_m * config_.aperture_m)) return -1;
    return pixel(hit - (config_.focus_m / toward) * escape.direction);
  }
  int openings() const { return 1; }
  Connection connect(int, const Vec3d& from, double u, double v) const {
    return to_disc(config_.position, view_, config_.aperture_m, from, on_unit_disc(u, v, right_, up_));
  }
  /// Pixel that sees the point `p` [m], by the ray through the middle of the opening; −1: outside the image.
  int pixel(const Vec3d& p) const {
    const Vec3d way = p - config_.position;
    const double z = way.dot(view_);
    return z > 0.0 ? pixel_of(way.dot(right_) / z, way.dot(up_) / z) : -1;
  }
  int pixels() const { return config_.columns * config_.rows; }
  /// Through a place of the pixel, by the first two numbers, and a place of the opening, by the other two. The mean of
  /// a pixel's lines times etendue_m2_sr() is the power that passes the opening into it: they count cos⁴ of their angle
  /// to the axis, as light does behind a real lens (natural vignetting).
  SightLine line(int pixel, const std::array<double, 4>& u) const {
    const double column = pixel % config_.columns + u[0], row = pixel / config_.columns + u[1];
    const Vec3d way = view_ + (2.0 * column / config_.columns - 1.0) * half_width_ * right_ +
                      (1.0 - 2.0 * row / config_.rows) * half_height_ * up_,
                at = config_.aperture_m * on_unit_disc(u[2], u[3], right_, up_);
    const Vec3d d = (config_.focus_m * way - at).normalized();
    return {config_.position + at, d, std::pow(d.dot(view_), 4)};
  }
  /// Area of the opening × solid angle of a pixel on the axis.
  double etendue_m2_sr() const {
    return pi * config_.aperture_m * config_.aperture_m * 4.0 * half_width_ * half_height_ / pixels();
  }

 private:
  int pixel_of(double right, double up) const {
    const double column = 0.5 * (right / half_width_ + 1.0) * config_.columns,
                 row = 0.5 * (1.0 - up / half_height_) * config_.rows;
    if (!(column >= 0.0 && column < config_.columns && row >= 0.0 && row < config_.rows)) return -1;
    return int(row) * config_.columns + int(column);
  }

  Config config_;
  Vec3d view_, right_, up_;
  double half_width_, half_height_;  ///< of the image at distance 1
};

static_assert(ConnectedReadout<PinholeCamera> && View<PinholeCamera>);

}  // namespace lumo

#endif

// ---- lumo/lab/side_view.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_SIDE_VIEW_HPP
#define SINGLE_INCLUDE_LUMO_LAB_SIDE_VIEW_HPP

namespace lumo {

/// A camera before the side x > 0 of a pad, aimed at its middle. The same lens is a readout (CameraCone: power by
/// region) and a picture (PinholeCamera).
struct SideView {
  double distance_m = 0.25;               ///< from what it is aimed at
  double yaw_rad = 0.0, pitch_rad = 0.0;  ///< of where it stands: towards +y, and above the base plane
  double roll_rad = 0.0;                  ///< about the line of sight
  double along_m = 0.0, height_m = 0.0;   ///< of what it is aimed at, beside the middle of the side
  double aperture_m = 0.48e-3;  ///< radius of the lens' opening: 1.93 mm at f/2 (Intel RealSense D435, colour)

  /// From the pad towards the camera.
  Vec3d back() const {
    return {std::cos(pitch_rad) * std::cos(yaw_rad), std::cos(pitch_rad) * std::sin(yaw_rad), std::sin(pitch_rad)};
  }
  Vec3d position_m(const SideGeometry& side) const {
    return Vec3d(side.half_width_m, along_m, 0.5 * (side.low_m + side.high_m) + height_m) + distance_m * back();
  }
  CameraCone cone(const SideGeometry& side) const {
    return CameraCone({.position = position_m(side), .view = -back(), .aperture_m = aperture_m});
  }
  PinholeCamera picture(const SideGeometry& side, double focal_px, int columns, int rows) const {
    const Vec3d up = Eigen::AngleAxisd(roll_rad, Eigen::Vector3d(-back())) * Eigen::Vector3d::UnitZ();
    return PinholeCamera({.position = position_m(side),
        .view = -back(),
        .up = up,
        .field_of_view_rad = 2.0 * std::atan(0.5 * columns / focal_px),
        .columns = columns,
        .rows = rows,
        .aperture_m = aperture_m,
        .focus_m = distance_m});
  }
};

/// A row of square photodiodes that face the side x > 0 at half its height, each before the middle of one of `count`
/// equal parts of |y| ≤ half_range_m.
struct PhotodiodeRow {
  int count = 11;
  double half_range_m = 27.5e-3;
  double gap_m = 5e-3;   ///< to the side
  double edge_m = 2e-3;  ///< of a photodiode

  Photodiodes before(const SideGeometry& side) const {
    const double half = 0.5 * edge_m, x = side.half_width_m + gap_m, z = 0.5 * (side.low_m + side.high_m);
    std::vector<Photodiode> row;
    for (int k = 0; k < count; ++k) {
      // Whole parts of the range: places on both sides of y = 0 are mirror images to the bit.
      const double y = half_range_m * (2 * k + 1 - count) / count;
      row.push_back({{x, y, z}, {0.0, 0.0, half}, {0.0, half, 0.0}});
    }
    return Photodiodes(std::move(row));
  }
};

}  // namespace lumo

#endif

// ---- lumo/lab/protocol.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_PROTOCOL_HPP
#define SINGLE_INCLUDE_LUMO_LAB_PROTOCOL_HPP

namespace lumo {

/// One load of a contact: reached evenly, then held.
struct LoadStep {
  double load_N = 0.0;
  double ramp_s = 0.3;
  double hold_s = 1.0;
  /// Of the hold's segment. Steps of kind `cycle` with one number share a segment, ramps included.
  sense::SegmentKind kind = sense::SegmentKind::hold;
  int cycle = -1;
};

/// One contact from first touch to leaving.
struct LabContact {
  int place = 0;
  double y_m = 0.0;  ///< of the jig
  int repetition = 0;
  std::vector<LoadStep> steps;
  double angle_rad = 0.0;  ///< of approach, small
  double rest_s = 1.0;     ///< without contact before it
  int view = 0;            ///< of LabPlan::views
};

/// A camera's place and the room's and lamps' light, as an experiment sets them on purpose.
struct LabView {
  CameraPlace place;
  double room = 1.0;   ///< ambient light, times the rig's
  double lamps = 1.0;  ///< 0: off
};

/// What is done in one log.
struct LabPlan {
  std::string title;
  double free_run_s = 0.0;  ///< the joint sweeps without contact, to get to know its friction and weight
  std::vector<LabContact> contacts;
  std::vector<LabView> views{LabView{}};
  double frames_per_s = 0.0;  ///< that are recorded; 0: all of the camera's
};

inline constexpr std::array<double, 6> lab_places_m{-25e-3, -15e-3, -5e-3, 5e-3, 15e-3, 25e-3};
/// Places 1, 3 and 5 of those, numbered along the finger without gaps in their own logs, where they are each other's
/// neighbours.
inline constexpr std::array<double, 3> lab_odd_places_m{lab_places_m[0], lab_places_m[2], lab_places_m[4]};

inline std::vector<LoadStep> lab_holds(const std::vector<double>& loads_N, double ramp_s, double hold_s) {
  std::vector<LoadStep> steps;
  for (const double f : loads_N) steps.push_back({f, ramp_s, hold_s});
  return steps;
}

/// Six places 10 mm apart, `repetitions` independent re-contacts each, 2, 5, 10, 15 N held 1 s, unloaded in between
/// (paper, re-contact evaluation).
inline LabPlan recontact_plan(int repetitions = 5) {
  require_in_range("repetitions", repetitions, 1, 1000, "");
  LabPlan plan{"re-contacts at six places", 0.0, {}};
  for (int r = 0; r < repetitions; ++r)
    for (int p = 0; p < 6; ++p)
      plan.contacts.push_back({p, lab_places_m[std::size_t(p)], r, lab_holds({2, 5, 10, 15}, 0.3, 1.0)});
  return plan;
}

/// Two conditioning and five measured cycles between 2 and 15 N in one contact, at places 1, 3 and 5, three runs, each
/// with re-contacts for the other metrics. 1 N/s, 1 s at both ends, five frames a second. Source: paper, contact
/// cycling; conditioning, rate, dwell and frames from the authors' public code (dokkev/fingertip-design-framework,
/// force_trajectory.py). Their approach angles of ±30° are not among them: the lab's angles are small.
inline LabPlan cycle_plan(int runs = 3) {
  require_in_range("runs", runs, 1, 1000, "");
  constexpr double low_N = 2.0, high_N = 15.0, rate_N_per_s = 1.0, dwell_s = 1.0, rest_s = 2.0;
  constexpr int conditioning = 2, measured = 5;
  constexpr double ramp_s = (high_N - low_N) / rate_N_per_s;
  LabPlan plan{"cycles within contact at three places", 0.0, {}};
  plan.frames_per_s = 5.0;
  for (int r = 0; r < runs; ++r)
    for (int p = 0; p < 3; ++p) {
      const double y = lab_odd_places_m[std::size_t(p)];
      LabContact c{p, y, r, {{low_N, low_N / rate_N_per_s, dwell_s, sense::SegmentKind::approach}}, 0.0, rest_s};
      for (int k = -conditioning; k < measured; ++k)
        for (const double f : {high_N, low_N}) c.steps.push_back({f, ramp_s, dwell_s, sense::SegmentKind::cycle, k});
      plan.contacts.push_back(std::move(c));
      // The same contact anew: one hold at each load, for W_recontact and D_neighbor of these runs.
      plan.contacts.push_back({p, y, r, lab_holds({2, 5, 10, 15}, 0.3, 1.0), 0.0, rest_s});
    }
  return plan;
}

/// Places 1, 3 and 5 up to 20 N under other camera heights and pitches, other room light, and with the LEDs off (paper,
/// imaging variation).
inline LabPlan imaging_plan() {
  LabPlan plan{"imaging variation", 0.0, {}, {}};
  plan.views = {
      {}, {{0, 0, 0, 0, 1.5_mm}}, {{0, 0, 0, 0, -1.5_mm}}, {{0, 6.0_deg}}, {{0, -6.0_deg}}, {{}, 4.0}, {{}, 1.0, 0.0}};
  for (int v = 0; v < int(plan.views.size()); ++v)
    for (int p = 0; p < 3; ++p)
      plan.contacts.push_back(
          {p, lab_odd_places_m[std::size_t(p)], v, lab_holds({2, 5, 10, 15, 20}, 0.3, 0.5), 0.0, 1.0, v});
  return plan;
}

/// An unloaded sweep of the joint, then six sequences of 2, 5, 10, 15, 20 N, one for each place (paper, force
/// estimation).
inline LabPlan force_plan() {
  LabPlan plan{"location and force at six places", 9.0, {}};
  for (int p = 0; p < 6; ++p)
    plan.contacts.push_back({p, lab_places_m[std::size_t(p)], 0, lab_holds({2, 5, 10, 15, 20}, 0.3, 0.9), 0.0, 1.5});
  return plan;
}

/// How far the built finger's places lie from those of the plans: its open proximal end gives way under 15 N at
/// y = −26 mm. Its places are then y = 26 mm − x, x = 0 … 50 mm the stages' travel from the distal one, which the
/// authors' rig leaves open by some millimetres.
inline constexpr double built_finger_shift_m = 1e-3;

/// The plan with every place moved along the finger.
inline LabPlan moved(LabPlan plan, double by_m) {
  for (LabContact& c : plan.contacts) c.y_m += by_m;
  return plan;
}

/// The plan without loads above one that the pad bears.
inline LabPlan up_to(LabPlan plan, double load_N) {
  for (LabContact& c : plan.contacts) std::erase_if(c.steps, [&](const LoadStep& s) { return s.load_N > load_N; });
  return plan;
}

}  // namespace lumo

#endif

// ---- lumo/lab/virtual_rig.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_VIRTUAL_RIG_HPP
#define SINGLE_INCLUDE_LUMO_LAB_VIRTUAL_RIG_HPP

namespace lumo {

/// What was really so at a frame: for comparisons with estimates, never for their making.
struct TruthSample {
  std::int64_t stamp_ns = 0;
  int contact = -1;  ///< number in the plan; −1: none
  double y_m = 0.0, force_N = 0.0, tilt_rad = 0.0;
  double equivalent_N = 0.0;  ///< load that in equilibrium gives the deformation there is
  double depth_m = 0.0;
};

/// truth.csv: stamp_ns, contact, y_mm, force_N, tilt_deg, equivalent_N, depth_mm.
inline std::string truth_text(const std::vector<TruthSample>& truth) {
  std::string t = "stamp_ns,contact,y_mm,force_N,tilt_deg,equivalent_N,depth_mm\n";
  for (const TruthSample& s : truth) {
    t += std::to_string(s.stamp_ns) + ',' + std::to_string(s.contact);
    for (const double v : {1e3 * s.y_m, s.force_N, s.tilt_rad * 180.0 / pi, s.equivalent_N, 1e3 * s.depth_m})
      t += ',' + sense::csv_number(v);
    t += '\n';
  }
  return t;
}

/// A pad, a camera, a motor and an indenter that go through a plan and leave a log as a real rig would. All light comes
/// from computed responses. A pure function of responses, plan, seed and `noise`, which multiplies every σ of the
/// rig.
class VirtualRig {
 public:
  /// `light` stays the caller's. Throws InvalidArgument for numbers out of range, or loads and places beyond
  /// those computed.
  VirtualRig(const PadLight& light, LabPlan plan, std::uint64_t seed = 1, double noise = 1.0, Rig rig = {},
      SideGeometry side = {});

  const sense::Session& session() const { return session_; }
  const std::vector<sense::FrameRecord>& frames() const { return frames_; }
  const std::vector<sense::JointSample>& joints() const { return joints_; }
  const std::vector<sense::WrenchSample>& wrenches() const { return wrenches_; }
  const std::vector<sense::MarkerSample>& markers() const { return markers_; }
  const std::vector<TruthSample>& truth() const { return truth_; }
  const Rig& rig() const { return rig_; }
  const LabPlan& plan() const { return plan_; }
  /// Picture k; the same whenever it is asked for.
  sense::Image image(std::size_t k) const;

 private:
  // Times of every plan; assumed.
  static constexpr double settle_s = 0.5, margin_s = 0.02;  ///< cut from an unloaded stretch's start (at most) and end
  static constexpr double settling_share = 0.2;             ///< of a hold, cut from its start: the pad creeps
  static constexpr double release_s = 0.2, last_rest_s = 1.0, first_frame_s = 0.01;
  static constexpr int most_trials = 1000;  ///< to place the camera so that it shows the side

  struct Contact {
    double y_m, tilt_rad, stick_Nm;
    std::vector<double> load_N;       ///< of each step, as it came out
    double from_s = 0.0, to_s = 1.0;  ///< first touch and leaving
  };
  /// Load over a stretch of time, linear.
  struct Phase {
    double from_s, to_s, from_N, to_N;
    int contact;
  };
  struct Sampled {
    double load_N, equivalent_N;
    int contact;
  };

  void draw_contacts();
  void lay_out_time();
  void add_segment(double from_s, double to_s, sense::SegmentKind kind) {
    session_.segments.push_back({lab_stamp(from_s), lab_stamp(to_s), kind});
  }
  void add_segment(double reached_s, const LabContact& c, std::size_t step);
  void deform();
  void record_joints();
  void record_forces();
  void place_cameras(RandomStream& once);
  void record_frames();
  Sampled at(double t_s) const;
  /// Where the finger is touched at a time.
  double place_m(int contact, double t_s) const;
  Eigen::VectorXd side_light(const TruthSample& s, const Eigen::VectorXd& lamps) const;
  Eigen::VectorXd one_by_one(const Eigen::VectorXd& light, const Eigen::VectorXd& lamps) const;

  const PadLight* light_;
  LabPlan plan_;
  std::uint64_t seed_;
  double noise_;
  Rig rig_;
  SideGeometry side_;
  sense::Session session_;
  std::vector<Contact> contacts_;
  std::vector<Phase> phases_;
  std::vector<Sampled> sampled_;  ///< at the joint's rate
  std::vector<SidePainter> painters_;
  std::vector<sense::FrameRecord> frames_;
  std::vector<TruthSample> truth_;
  std::vector<int> view_;                     ///< of each frame
  std::vector<double> lamps_, room_DN_;       ///< at each frame
  std::vector<Eigen::VectorXd> lamp_change_;  ///< at each frame, of each LED by itself, relative; empty: none
  double pad_off_m_ = 0.0, strip_off_m_ = 0.0;
  std::vector<sense::JointSample> joints_;
  std::vector<sense::WrenchSample> wrenches_;
  std::vector<sense::MarkerSample> markers_;
  double end_s_ = 0.0, per_DN_ = 1.0;
};

/// The rig's camera as frames come from it. The rig stays the caller's.
class VirtualCamera {
 public:
  explicit VirtualCamera(const VirtualRig& rig) : rig_(&rig) {}

  std::optional<sense::Frame> next() {
    if (next_ == rig_->frames().size()) return std::nullopt;
    image_ = rig_->image(next_);
    const sense::FrameRecord& f = rig_->frames()[next_];
    return sense::Frame{image_.view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(next_++)};
  }
  sense::StreamState state() const {
    return next_ == rig_->frames().size() ? sense::StreamState::ended : sense::StreamState::open;
  }

 private:
  const VirtualRig* rig_;
  sense::Image image_;
  std::size_t next_ = 0;
};

static_assert(sense::Camera<VirtualCamera>);

inline VirtualRig::VirtualRig(
    const PadLight& light, LabPlan plan, std::uint64_t seed, double noise, Rig rig, SideGeometry side)
    : light_(&light), plan_(std::move(plan)), seed_(seed), noise_(noise), rig_(rig), side_(std::move(side)) {
  validate(rig_);
  require_in_range("noise of the virtual lab", noise_, 0.0, 100.0, "");
  require_in_range("frames of a plan", plan_.frames_per_s, 0.0, 1000.0, "1/s");
  for (const LabContact& c : plan_.contacts) {
    light.require_reached("place of a contact", c.y_m);
    require_in_range("view of a contact", c.view, 0, double(plan_.views.size()) - 1.0, "");
    require_in_range("place's number", c.place, 0, 1000, "");
    for (const LoadStep& s : c.steps) {
      require_in_range("load of a contact", s.load_N, 0.0, rig_.specimen.bears_N(light.max_load_N()), "N");
      require_positive("time to reach a load", s.ramp_s, "s");
    }
  }
  const PadResponses& r = light.responses();
  per_DN_ = light.exposure(rig_.camera);

  session_.title = plan_.title;
  session_.clock = "virtual";
  session_.material = r.material;
  session_.theta_mm = r.theta_mm;
  session_.joint_to_origin_m = rig_.motor.joint_to_origin_m;
  session_.led_depth_m = side_.half_width_m;
  session_.camera_distance_m = rig_.camera.distance_m;
  session_.torque_constant_Nm_per_A.assign(std::size_t(rig_.motor.joints), rig_.motor.torque_constant_Nm_per_A);
  if (rig_.motor.joints == 2) session_.joint_to_joint_m = {rig_.motor.joint_to_joint_m};
  draw_contacts();
  lay_out_time();
  deform();
  record_joints();
  record_forces();
  record_frames();
}

inline void VirtualRig::draw_contacts() {
  RandomStream draws(seed_, 1);
  const auto [from, to] = light_->reach_m();
  for (const LabContact& c : plan_.contacts) {
    const double y = c.y_m + noise_ * rig_.contact.place_sigma_m * draws.normal(),
                 tilt = c.angle_rad + noise_ * rig_.contact.tilt_sigma_rad * draws.normal();
    contacts_.push_back({std::clamp(y, from, to), tilt, noise_ * rig_.motor.stiction_Nm * draws.normal(), {}});
    for (const LoadStep& s : c.steps)
      contacts_.back().load_N.push_back(std::min(rig_.specimen.bears_N(light_->max_load_N()),
          s.load_N * (1.0 + noise_ * rig_.contact.load_sigma * draws.normal())));
  }
}

inline void VirtualRig::lay_out_time() {
  double t = plan_.free_run_s;
  if (t > 0.0) add_segment(0.0, t, sense::SegmentKind::free);
  for (std::size_t i = 0; i < plan_.contacts.size(); ++i) {
    const LabContact& c = plan_.contacts[i];
    phases_.push_back({t, t + c.rest_s, 0.0, 0.0, -1});
    const double from = t + std::min(settle_s, 0.5 * c.rest_s), to = t + c.rest_s - margin_s;
    add_segment(from, to, sense::SegmentKind::unloaded);
    if (plan_.views[std::size_t(c.view)].lamps == 0.0) add_segment(from, to, sense::SegmentKind::dark);
    t += c.rest_s;
    contacts_[i].from_s = t;
    double load = 0.0;
    for (std::size_t k = 0; k < c.steps.size(); ++k) {
      const LoadStep& s = c.steps[k];
      phases_.push_back({t, t + s.ramp_s, load, contacts_[i].load_N[k], int(i)});
      t += s.ramp_s;
      load = contacts_[i].load_N[k];
      phases_.push_back({t, t + s.hold_s, load, load, int(i)});
      add_segment(t, c, k);
      t += s.hold_s;
    }
    phases_.push_back({t, t + release_s, load, 0.0, int(i)});
    t += release_s;
    contacts_[i].to_s = t;
  }
  phases_.push_back({t, t + last_rest_s, 0.0, 0.0, -1});
  end_s_ = t + last_rest_s;
}

/// Of a step whose load is reached at that time.
inline void VirtualRig::add_segment(double reached_s, const LabContact& c, std::size_t step) {
  const LoadStep& s = c.steps[step];
  const bool cycle = s.kind == sense::SegmentKind::cycle;
  const std::int64_t to_ns = lab_stamp(reached_s + s.hold_s);
  if (cycle && step > 0 && c.steps[step - 1].kind == s.kind && c.steps[step - 1].cycle == s.cycle) {
    sense::Segment& begun = session_.segments.back();
    begun.to_ns = to_ns;
    begun.load_N = std::max(begun.load_N, s.load_N);
    return;
  }
  const double from_s = cycle ? reached_s - s.ramp_s : reached_s + settling_share * s.hold_s;
  session_.segments.push_back({lab_stamp(from_s), to_ns, s.kind, c.place, 1e3 * c.y_m, c.repetition, s.cycle, s.load_N,
      c.angle_rad * 180.0 / pi, 1e3 * light_->responses().diameter_m});
}

inline void VirtualRig::deform() {
  int places = 1;
  for (const LabContact& c : plan_.contacts) places = std::max(places, c.place + 1);
  std::vector<Relaxation> pad(std::size_t(places), Relaxation(rig_.silicone));  // a place remembers its own contacts
  const double dt = 1.0 / rig_.motor.hz;
  std::size_t phase = 0;
  for (double t = 0.0; t < end_s_; t += dt) {
    while (phase + 1 < phases_.size() && t >= phases_[phase].to_s) ++phase;
    Sampled s{0.0, 0.0, -1};
    if (const Phase& p = phases_[phase]; p.contact >= 0 && t >= p.from_s)
      s = {p.from_N + (p.to_N - p.from_N) * std::clamp((t - p.from_s) / (p.to_s - p.from_s), 0.0, 1.0), 0.0, p.contact};
    const int place = s.contact < 0 ? -1 : plan_.contacts[std::size_t(s.contact)].place;
    for (int k = 0; k < places; ++k) {
      const double equivalent = pad[std::size_t(k)].step(k == place ? s.load_N / rig_.specimen.stiffness : 0.0, dt);
      if (k == place) s.equivalent_N = equivalent;
    }
    sampled_.push_back(s);
  }
}

inline auto VirtualRig::at(double t_s) const -> Sampled {
  const double index = std::clamp(t_s * rig_.motor.hz, 0.0, double(sampled_.size() - 1));
  const auto i = std::size_t(index), j = std::min(i + 1, sampled_.size() - 1);
  const Sampled &a = sampled_[i], &b = sampled_[j];
  const double share = index - double(i);
  if (a.contact != b.contact) return share < 0.5 ? a : b;
  return {
      a.load_N + share * (b.load_N - a.load_N), a.equivalent_N + share * (b.equivalent_N - a.equivalent_N), a.contact};
}

inline double VirtualRig::place_m(int contact, double t_s) const {
  const Contact& c = contacts_[std::size_t(contact)];
  if (rig_.contact.slide_m == 0.0) return c.y_m;
  const auto [from, to] = light_->reach_m();
  return std::clamp(c.y_m + rig_.contact.slide_m * (t_s - c.from_s) / (c.to_s - c.from_s), from, to);
}

/// Joint by joint: what sticks and errs is each one's own.
inline void VirtualRig::record_joints() {
  const MotorRig& m = rig_.motor;
  const double dt = 1.0 / m.hz;
  for (std::size_t i = 0; i < sampled_.size(); ++i)
    joints_.push_back({lab_stamp(double(i) * dt + m.clock_offset_s), sense::JointVector(m.joints),
        sense::JointVector(m.joints), sense::JointVector(m.joints), sense::Effort::current_A});
  for (int joint = 0; joint < m.joints; ++joint) {
    const bool last_joint = joint + 1 == m.joints;
    const std::uint64_t stream = last_joint ? 2 : 60;
    RandomStream once(seed_, stream), draws(seed_, stream + 1), stick(seed_, stream + 2), own(seed_, stream + 3);
    const double constant = m.torque_constant_Nm_per_A * (1.0 + noise_ * m.constant_sigma * once.normal()),
                 bias = noise_ * m.bias_Nm * once.normal();
    // Both hold the same angle, so that the pad's link is turned against the one before it.
    const double before = last_joint ? 0.0 : m.joint_to_joint_m * std::cos(m.hold_rad);
    std::vector<double> sticks;  // under each contact
    for (const Contact& c : contacts_)
      sticks.push_back(last_joint ? c.stick_Nm : noise_ * m.stiction_Nm * own.normal());
    const double cogging_phase = 2.0 * pi * RandomStream(seed_, stream + 200).uniform();
    double rest_stick = 0.0, last_load = 0.0;
    int last = -1;
    bool moving = false;
    for (std::size_t i = 0; i < sampled_.size(); ++i) {
      const double t = double(i) * dt;
      const Sampled& s = sampled_[i];
      if (s.contact < 0 && (last >= 0 || i == 0)) rest_stick = noise_ * m.stiction_Nm * stick.normal();
      last = s.contact;
      const double arm = s.contact < 0 ? 0.0 : before + m.joint_to_origin_m + place_m(s.contact, t),
                   load = s.load_N * arm;
      double q = m.hold_rad - load / m.stiffness_Nm_per_rad, v = -(load - last_load) / m.stiffness_Nm_per_rad / dt,
             friction = s.contact < 0 ? rest_stick : sticks[std::size_t(s.contact)];
      if (i == 0) v = 0.0;
      last_load = load;
      if (t < plan_.free_run_s) {
        const auto& [beat, sweep, swing, rest_velocity] = m.free_run;
        const double k = std::floor(t / beat), phase = std::min((t - k * beat) / sweep, 1.0),
                     way = std::fmod(k, 2.0) == 0.0 ? 1.0 : -1.0;
        q = m.hold_rad - way * swing * std::cos(pi * phase);
        v = phase < 1.0 ? way * swing * pi / sweep * std::sin(pi * phase) : 0.0;
        if (phase >= 1.0 && moving) rest_stick = noise_ * m.stiction_Nm * stick.normal();
        moving = phase < 1.0;
        friction = moving ? m.coulomb_Nm * std::tanh(v / rest_velocity) + m.viscous_Nm_s_per_rad * v : rest_stick;
      }
      if (m.backlash_rad > 0.0) q -= (s.contact < 0 ? 0.0 : 0.5) * m.backlash_rad;  // pressed against the other flank
      double torque = load + m.weight_Nm * std::sin(q) + friction + bias + noise_ * m.white_Nm * draws.normal();
      if (m.cogging_Nm > 0.0) torque += m.cogging_Nm * std::sin(m.cogging_periods * q + cogging_phase);
      sense::JointSample& sample = joints_[i];
      sample.position_rad[joint] = q;
      sample.velocity_rad_per_s[joint] = v + noise_ * m.velocity_sigma_rad_per_s * draws.normal();
      sample.effort[joint] = torque / constant;
    }
  }
}

inline void VirtualRig::record_forces() {
  const ContactRig& c = rig_.contact;
  RandomStream draws(seed_, 5);
  const double bias = noise_ * c.sensor_bias_N * draws.normal();
  for (double t = 0.0; t < end_s_; t += 1.0 / c.sensor_hz) {
    const Sampled s = at(t);
    const double y = s.contact < 0 ? 0.0 : place_m(s.contact, t);
    const auto jitter = [&] { return noise_ * c.sensor_sigma_N * draws.normal(); };
    const double fx = jitter(), fy = jitter(), fz = -s.load_N + bias + jitter();
    wrenches_.push_back({lab_stamp(t), Vec3d(fx, fy, fz), Vec3d(-y * s.load_N, 0.0, 0.0)});
    const double sunk = s.contact < 0 ? 0.0 : light_->depth_m(y, s.equivalent_N);
    markers_.push_back({lab_stamp(t), sunk + noise_ * c.marker_sigma_m * draws.normal()});
  }
}

/// Cameras for all views, and the finger as it was put together before them.
inline void VirtualRig::place_cameras(RandomStream& once) {
  const CameraRig& c = rig_.camera;
  // Placed by hand: where the picture does not show the whole pad, the camera is placed again.
  std::vector<SideCamera> cameras;
  for (int trial = 0;
       trial == 0 || (trial < most_trials && !std::all_of(cameras.begin(), cameras.end(),
                                                 [](const SideCamera& view) { return view.shows_side(); }));
       ++trial) {
    const CameraPlace set{noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_rad * once.normal(),
        noise_ * c.aim_sigma_rad * once.normal(), noise_ * c.aim_sigma_m * once.normal(),
        noise_ * c.aim_sigma_m * once.normal()};
    cameras.clear();
    for (const LabView& v : plan_.views)
      cameras.emplace_back(c, side_,
          CameraPlace{set.yaw_rad + v.place.yaw_rad, set.pitch_rad + v.place.pitch_rad, set.roll_rad + v.place.roll_rad,
              set.along_m + v.place.along_m, set.height_m + v.place.height_m});
  }
  // Assembly: what is painted is off, what was aimed at is not.
  RandomStream built(seed_, 120);
  const AssemblyRig& a = rig_.assembly;
  pad_off_m_ = a.pad_sigma_m * built.normal();
  strip_off_m_ = a.strip_sigma_m * built.normal();
  CameraRig placed = c;
  placed.distance_m *= 1.0 + a.distance_sigma * built.normal();
  const double distortion = a.distortion_sigma * built.normal();
  SideGeometry lit = side_;
  for (double& y : lit.lamp_m) y += strip_off_m_;
  const bool as_drawn = placed.distance_m == c.distance_m && distortion == 0.0 && strip_off_m_ == 0.0;
  for (const SideCamera& view : cameras)
    painters_.emplace_back(as_drawn ? view : SideCamera(placed, lit, view.place(), distortion), rig_.light,
        light_->responses().position_m, seed_);
}

inline void VirtualRig::record_frames() {
  const CameraRig& c = rig_.camera;
  const LightRig& l = rig_.light;
  RandomStream once(seed_, 6), jitter(seed_, 7);
  place_cameras(once);
  std::vector<SlowNoise> one_lamp;
  for (std::size_t k = 0; k < side_.lamp_m.size() && l.one_lamp_sigma > 0.0; ++k)
    one_lamp.emplace_back(RandomStream(seed_, 130 + k), l.one_lamp_drift_s);
  LampNoise lamps(l, seed_, 8);
  SlowNoise room(RandomStream(seed_, 9), l.ambient_drift_s);
  const double phase = 2.0 * pi * once.uniform(), half = pi * l.flicker_hz * c.exposure_s,
               averaged = half > 0.0 ? std::sin(half) / half : 1.0;
  int view = plan_.contacts.empty() ? 0 : plan_.contacts.front().view;
  const double per_s = plan_.frames_per_s > 0.0 ? std::min(plan_.frames_per_s, c.frames_per_s) : c.frames_per_s;
  for (double t = first_frame_s; t < end_s_; t += 1.0 / per_s) {
    const Sampled s = at(t);
    // The next contact's view is set while nothing touches.
    for (const Phase& p : phases_)
      if (p.contact >= 0 && p.to_s > t) {
        view = plan_.contacts[std::size_t(p.contact)].view;
        break;
      }
    TruthSample truth{lab_stamp(t + noise_ * c.stamp_sigma_s * jitter.normal()), s.contact};
    if (s.contact >= 0) {
      const Contact& now = contacts_[std::size_t(s.contact)];
      const double y = place_m(s.contact, t);
      truth = {
          truth.stamp_ns, s.contact, y, s.load_N, now.tilt_rad, s.equivalent_N, light_->depth_m(y, s.equivalent_N)};
    }
    frames_.push_back({truth.stamp_ns, sense::frame_file(frames_.size()), c.exposure_s, c.gain});
    truth_.push_back(truth);
    view_.push_back(view);
    lamp_change_.emplace_back(Eigen::Index(one_lamp.size()));
    for (std::size_t k = 0; k < one_lamp.size(); ++k)
      lamp_change_.back()[Eigen::Index(k)] = l.one_lamp_sigma * one_lamp[k].at(t);
    lamps_.push_back(rig_.specimen.lamps * plan_.views[std::size_t(view)].lamps * (1.0 + noise_ * lamps.at(t)));
    room_DN_.push_back(plan_.views[std::size_t(view)].room * l.ambient_DN *
                       (1.0 + noise_ * (l.ambient_drift * room.at(t) +
                                           l.flicker * averaged * std::sin(2.0 * pi * l.flicker_hz * t + phase))));
  }
}

/// Light that each bin has, shared out between the LEDs by their distance.
inline Eigen::VectorXd VirtualRig::one_by_one(const Eigen::VectorXd& light, const Eigen::VectorXd& lamps) const {
  const Eigen::VectorXd& x = light_->responses().position_m;
  Eigen::VectorXd changed = light;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    double all = 0.0, change = 0.0;
    for (Eigen::Index k = 0; k < lamps.size(); ++k) {
      const double share = std::exp(-std::abs(x[i] - side_.lamp_m[std::size_t(k)]) / rig_.light.one_lamp_reach_m);
      all += share;
      change += share * lamps[k];
    }
    changed[i] *= 1.0 + change / all;
  }
  return changed;
}

/// What leaves the side. LEDs that are off along the finger take all light with them; silicone that is off takes the
/// light of its ends.
inline Eigen::VectorXd VirtualRig::side_light(const TruthSample& s, const Eigen::VectorXd& lamps) const {
  Eigen::VectorXd light = light_->responses().unloaded;
  const bool touched = s.contact >= 0;
  if (pad_off_m_ == 0.0 && strip_off_m_ == 0.0) {
    if (touched) light += light_->change(s.y_m, s.equivalent_N, s.tilt_rad);
  } else {
    light = light_->moved(light, strip_off_m_ + pad_off_m_);
    if (touched) {
      const AssemblyRig& a = rig_.assembly;
      const double to_end = side_.half_length_m - std::abs(s.y_m),
                   share = std::clamp((a.end_far_m - to_end) / (a.end_far_m - a.end_near_m), 0.0, 1.0),
                   off = strip_off_m_ + share * pad_off_m_;
      light += light_->moved(light_->change(s.y_m - off, s.equivalent_N, s.tilt_rad), off);
    }
  }
  return lamps.size() > 0 ? one_by_one(light, lamps) : light;
}

inline sense::Image VirtualRig::image(std::size_t k) const {
  const TruthSample& s = truth_.at(k);
  Eigen::VectorXd light = side_light(s, lamp_change_[k]);
  light *= per_DN_ * lamps_[k];
  Shadow shadow;
  if (s.contact >= 0) shadow = {rig_.light.shadow, s.y_m, rig_.light.shadow_sigma_m};
  return painters_[std::size_t(view_[k])].paint(
      light, lamps_[k], room_DN_[k], noise_, RandomStream(seed_, 1000 + k), shadow);
}

}  // namespace lumo

#endif

// ---- lumo/lab.hpp
#ifndef SINGLE_INCLUDE_LUMO_LAB_HPP
#define SINGLE_INCLUDE_LUMO_LAB_HPP

// The virtual lab: a pad, a camera, a motor and an indenter that write the same recordings as a real rig. Needs Eigen
// only.

#endif
