// lumo/sense.hpp in one file; made by single_include/generate, not to be edited. Needs C++20 and Eigen.
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
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <complex>
#include <concepts>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <exception>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <istream>
#include <limits>
#include <locale>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <optional>
#include <ostream>
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

// ---- lumo/sense/devices/mini_cheetah.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DEVICES_MINI_CHEETAH_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DEVICES_MINI_CHEETAH_HPP

namespace lumo::sense {

/// A number as an unsigned integer of some bits over a symmetric range: 0 is −limit, all ones is +limit.
struct FixedRange {
  double low, high;
  int bits;

  double step() const { return (high - low) / double((1u << bits) - 1u); }
  std::uint32_t pack(double v) const { return std::uint32_t(std::lround((std::clamp(v, low, high) - low) / step())); }
  double unpack(std::uint32_t n) const { return low + step() * double(n); }
};

/// The CAN protocol of the MIT mini-cheetah actuators and of the drivers that follow it. Source: B. Katz's public
/// firmware and its documentation. Widths and byte order are common; ranges differ by make and firmware and must be set
/// to the motor's.
///
/// Command, 8 bytes, most significant first: position 16 bits, velocity 12, kp 12, kd 12, feed-forward torque 12.
/// Reply, 6 bytes: number of the motor 8 bits, position 16, velocity 12, torque or current 12. Later firmware appends
/// temperature and error, which are not read.
struct MiniCheetahProtocol {
  double position_rad = 12.5;
  double velocity_rad_per_s = 65.0;
  double kp_max = 500.0;  ///< N·m/rad
  double kd_max = 5.0;    ///< N·m·s/rad
  double torque_Nm = 18.0;
  double effort = 18.0;  ///< range of the reply's last field: N·m, or A (40 in Katz's first firmware)

  struct Command {
    double position_rad = 0.0, velocity_rad_per_s = 0.0, kp = 0.0, kd = 0.0, torque_Nm = 0.0;
  };
  struct Reply {
    int motor = 0;
    double position_rad = 0.0, velocity_rad_per_s = 0.0, effort = 0.0;
    bool saturated = false;  ///< a field stands at the end of its range
  };
  using Bytes = std::array<std::uint8_t, 8>;

  static constexpr Bytes enter{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfc};  ///< motor on
  static constexpr Bytes leave{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfd};  ///< motor off
  static constexpr Bytes zero{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe};   ///< here is position 0

  /// Values beyond a range are clamped to it. Throws InvalidArgument for numbers that are not finite.
  Bytes pack(const Command& c) const {
    for (const double v : {c.position_rad, c.velocity_rad_per_s, c.kp, c.kd, c.torque_Nm})
      if (!std::isfinite(v)) throw InvalidArgument("motor command: numbers must be finite");
    const std::uint32_t p = range(position_rad, 16).pack(c.position_rad),
                        v = range(velocity_rad_per_s, 12).pack(c.velocity_rad_per_s);
    const std::uint32_t kp = FixedRange{0.0, kp_max, 12}.pack(c.kp), kd = FixedRange{0.0, kd_max, 12}.pack(c.kd),
                        t = range(torque_Nm, 12).pack(c.torque_Nm);
    return {std::uint8_t(p >> 8), std::uint8_t(p & 0xff), std::uint8_t(v >> 4), std::uint8_t((v & 0xf) << 4 | kp >> 8),
        std::uint8_t(kp & 0xff), std::uint8_t(kd >> 4), std::uint8_t((kd & 0xf) << 4 | t >> 8), std::uint8_t(t & 0xff)};
  }
  /// nullopt for fewer than six bytes.
  std::optional<Reply> unpack(std::span<const std::uint8_t> b) const {
    if (b.size() < 6) return std::nullopt;
    const std::uint32_t p = std::uint32_t(b[1]) << 8 | b[2], v = std::uint32_t(b[3]) << 4 | b[4] >> 4,
                        t = std::uint32_t(b[4] & 0xf) << 8 | b[5];
    const bool full = p == 0 || p == 0xffff || v == 0 || v == 0xfff || t == 0 || t == 0xfff;
    return Reply{int(b[0]), range(position_rad, 16).unpack(p), range(velocity_rad_per_s, 12).unpack(v),
        range(effort, 12).unpack(t), full};
  }

  static FixedRange range(double limit, int bits) { return {-limit, limit, bits}; }
};

/// Throws InvalidArgument for a range that is not positive.
inline void validate(const MiniCheetahProtocol& p) {
  require_positive("motor's position range", p.position_rad, "rad");
  require_positive("motor's velocity range", p.velocity_rad_per_s, "rad/s");
  require_positive("motor's kp range", p.kp_max, "N·m/rad");
  require_positive("motor's kd range", p.kd_max, "N·m·s/rad");
  require_positive("motor's torque range", p.torque_Nm, "N·m");
  require_positive("motor's effort range", p.effort, "");
}

}  // namespace lumo::sense

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

// ---- lumo/sense/devices/replay.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DEVICES_REPLAY_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DEVICES_REPLAY_HPP

namespace lumo::sense {

/// A frame together with its pixels.
struct RecordedFrame {
  Image image;
  std::int64_t stamp_ns = 0;
  double exposure_s = 0.0;
  double gain = 0.0;
};

/// Frames that are in memory, given as fast as they are asked for.
class RecordedCamera {
 public:
  explicit RecordedCamera(std::vector<RecordedFrame> frames) : frames_(std::move(frames)) {}

  std::optional<Frame> next() {
    if (next_ == frames_.size()) return std::nullopt;
    const RecordedFrame& f = frames_[next_];
    return Frame{f.image.view(), f.stamp_ns, f.exposure_s, f.gain, std::int64_t(next_++)};
  }
  StreamState state() const { return next_ == frames_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<RecordedFrame> frames_;
  std::size_t next_ = 0;
};

static_assert(Camera<RecordedCamera>);

/// Joint samples that are in memory, given as fast as they are asked for. `read_joint_log` (sense/recording/tables.hpp)
/// reads them from a file.
class RecordedActuator {
 public:
  explicit RecordedActuator(std::vector<JointSample> samples) : samples_(std::move(samples)) {}

  std::optional<JointSample> next() {
    return next_ == samples_.size() ? std::nullopt : std::optional<JointSample>(samples_[next_++]);
  }
  StreamState state() const { return next_ == samples_.size() ? StreamState::ended : StreamState::open; }

 private:
  std::vector<JointSample> samples_;
  std::size_t next_ = 0;
};

static_assert(Actuator<RecordedActuator>);

/// A recorded stream in its own time: no item is there before its stamp. One item is read ahead, so that the time to
/// read a picture does not count.
template <class Source> class Replay {
 public:
  explicit Replay(Source source) : source_(std::move(source)), ahead_(source_.next()) {}

  /// Lets all up to this time through.
  void until(std::int64_t now_ns) {
    now_ns_ = now_ns;
    if (!ahead_) ahead_ = source_.next();
  }
  auto next() {
    if (!ahead_ || ahead_->stamp_ns > now_ns_) return decltype(ahead_)();
    auto item = std::move(ahead_);
    ahead_.reset();
    // A sample owns its values; a picture stays valid until the next one is read.
    if constexpr (Actuator<Source>) ahead_ = source_.next();
    return item;
  }
  StreamState state() const { return ahead_ ? StreamState::open : source_.state(); }

 private:
  Source source_;
  decltype(std::declval<Source&>().next()) ahead_;
  std::int64_t now_ns_ = INT64_MIN;
};

}  // namespace lumo::sense

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

// ---- lumo/sense/recording/log_truth.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_LOG_TRUTH_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_LOG_TRUTH_HPP

namespace lumo::sense {

/// Force that presses the finger over time: one channel [N], less `tare_N`. `clock` moves the stamps, for instance
/// Session::wrench_clock onto the frames'. Throws InvalidArgument if that leaves two samples at the same time.
inline TimeSeries normal_force(
    const std::vector<WrenchSample>& wrenches, const ClockMap& clock = {}, double tare_N = 0.0) {
  std::vector<std::int64_t> stamp_ns;
  Eigen::MatrixXd force_N(1, Eigen::Index(wrenches.size()));
  for (const WrenchSample& w : wrenches) {
    force_N(0, Eigen::Index(stamp_ns.size())) = w.normal_force_N() - tare_N;
    stamp_ns.push_back(clock(w.stamp_ns));
  }
  return {std::move(stamp_ns), std::move(force_N)};
}

/// What the force sensor reads in the unloaded segments, mean normal force [N]; 0 without any.
inline double force_tare_N(const Session& session, const std::vector<WrenchSample>& wrenches) {
  double sum = 0.0;
  long count = 0;
  for (const WrenchSample& w : wrenches) {
    const std::int64_t at = session.wrench_clock(w.stamp_ns);
    for (const Segment& s : session.segments)
      if (s.kind == SegmentKind::unloaded && s.holds(at)) {
        sum += w.normal_force_N();
        ++count;
      }
  }
  return count > 0 ? sum / double(count) : 0.0;
}

/// The true contacts of a log, for comparison with its estimates. Estimators do not read it.
class LogTruth {
 public:
  struct Touch {
    std::optional<double> y_m, force_N;
  };
  static constexpr double max_gap_s = 0.1;  ///< between samples of the force sensor; beyond, the force is unknown

  /// From the jig's places (segments) and the force sensor, which is tared on its unloaded segments. Throws
  /// InvalidArgument if the session's clock leads two of its samples to the same time.
  static LogTruth from_log(const Session& session, const std::vector<WrenchSample>& wrenches) {
    LogTruth t;
    t.segments_ = session.segments;
    t.force_ = normal_force(wrenches, session.wrench_clock, force_tare_N(session, wrenches));
    return t;
  }
  /// From a lab's truth.csv: stamp_ns, contact, y_mm, force_N and columns that are not read. Throws InputError.
  static LogTruth from_table(std::istream& in, const std::string& name) {
    CsvReader csv(in, name);
    StampColumn stamp(csv);
    const int contact = csv.require("contact"), y = csv.require("y_mm"), force = csv.require("force_N");
    LogTruth t;
    while (csv.next()) {
      const std::int64_t at = stamp.read(csv);
      t.table_.push_back(
          {at, {csv.integer(contact) < 0 ? std::nullopt : std::optional(1e-3 * csv.number(y)), csv.number(force)}});
    }
    return t;
  }

  /// Place and force at a time; unknown values are empty. Without contact the place is empty and a known force is 0.
  Touch at(std::int64_t stamp_ns) const {
    if (!force_) {
      const auto row = std::lower_bound(
          table_.begin(), table_.end(), stamp_ns, [](const auto& r, std::int64_t t) { return r.first < t; });
      return row != table_.end() && row->first == stamp_ns ? row->second : Touch{};
    }
    Touch touch;
    if (const auto f = force_->at(stamp_ns, max_gap_s)) touch.force_N = (*f)[0];
    for (const Segment& s : segments_)
      if (s.place >= 0 && s.holds(stamp_ns)) {
        touch.y_m = 1e-3 * s.y_mm;
        if (!touch.force_N) touch.force_N = s.load_N;
      }
    return touch;
  }

 private:
  std::optional<TimeSeries> force_;  ///< of a log's sensor; none of a table
  std::vector<Segment> segments_;
  std::vector<std::pair<std::int64_t, Touch>> table_;
};

}  // namespace lumo::sense

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

// ---- lumo/core/statistics.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_STATISTICS_HPP
#define SINGLE_INCLUDE_LUMO_CORE_STATISTICS_HPP

namespace lumo {

/// A number with a lower and an upper bound.
struct Interval {
  double value = 0.0, low = 0.0, high = 0.0;
};

/// Half of a normal's values lie within so many standard deviations.
inline constexpr double half_of_normal = 0.6744897501960817;

/// Middle one of the numbers, mean of the middle two for an even count. Throws InvalidArgument for none.
inline double median(std::vector<double> v) {
  if (v.empty()) throw InvalidArgument("median of no numbers");
  const auto half = v.begin() + std::ptrdiff_t(v.size() / 2);
  std::nth_element(v.begin(), half, v.end());
  return v.size() % 2 ? *half : 0.5 * (*half + *std::max_element(v.begin(), half));
}

/// Quantile by linear interpolation between order statistics (type 7 of Hyndman & Fan 1996). Throws InvalidArgument for
/// none.
inline double quantile(std::vector<double> v, double p) {
  if (v.empty()) throw InvalidArgument("quantile of no numbers");
  require_in_range("quantile", p, 0.0, 1.0, "");
  std::sort(v.begin(), v.end());
  const double place = p * double(v.size() - 1);
  const auto i = std::size_t(place);
  return i + 1 == v.size() ? v[i] : v[i] + (place - double(i)) * (v[i + 1] - v[i]);
}

/// Of ascending numbers the first of those `count` in a row that lie closest together; `count` is 1 to their number.
inline std::size_t closest_together(const std::vector<double>& sorted, std::size_t count) {
  std::size_t closest = 0;
  for (std::size_t i = 1; i + count <= sorted.size(); ++i)
    if (sorted[i + count - 1] - sorted[i] < sorted[closest + count - 1] - sorted[closest]) closest = i;
  return closest;
}

/// Root mean square of the entries.
inline double rms(const Eigen::Ref<const Eigen::VectorXd>& v) {
  return v.size() ? v.norm() / std::sqrt(double(v.size())) : 0.0;
}

/// Median of each row.
inline Eigen::VectorXd pointwise_median(const Eigen::MatrixXd& m) {
  Eigen::VectorXd r(m.rows());
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    const Eigen::VectorXd row = m.row(i);
    r[i] = median({row.data(), row.data() + row.size()});
  }
  return r;
}

/// Wilson's score interval of a share, `right` of `all`; z = 1.96 for 95 %. Source: Wilson 1927.
inline Interval wilson_interval(int right, int all, double z = 1.959963984540054) {
  if (all < 1 || right < 0 || right > all)
    throw InvalidArgument(message("share is ", right, " of ", all, ", must have 0 <= right <= all, all >= 1"));
  const double n = all, p = right / n, z2 = z * z, middle = (p + 0.5 * z2 / n) / (1.0 + z2 / n);
  const double half = z * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / (n * n)) / (1.0 + z2 / n);
  return {p, std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

/// Standard normal numbers from a counter; a pure function of (seed, number of calls). Source: Box & Muller 1958.
class CountedNormals {
 public:
  explicit CountedNormals(std::uint64_t seed) : seed_(seed) {}
  double operator()() {
    const double radius = std::sqrt(-2.0 * std::log(uniform(combine(seed_, count_)))),
                 turn = uniform(combine(seed_, count_ + 1));
    count_ += 2;
    return radius * std::cos(6.2831853071795864769 * turn);
  }

 private:
  std::uint64_t seed_, count_ = 0;
};

}  // namespace lumo

#endif

// ---- lumo/sense/recording/wrench_drift.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_WRENCH_DRIFT_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_WRENCH_DRIFT_HPP

namespace lumo::sense {

/// Limits of what is taken for a force sensor's drift; chosen on the virtual lab, whose sensor does not drift.
struct DriftLimits {
  std::size_t least_samples = 5;  ///< of a tare
  double least_N = 0.15;          ///< by which a tare must be off the middle one …
  double sigmas = 6.0;            ///< … and so many of its own errors
};

/// What a force sensor reads without load.
struct WrenchTare {
  std::int64_t stamp_ns = 0;  ///< middle, on the frames' clock
  Vec3d force_N{0.0, 0.0, 0.0}, torque_Nm{0.0, 0.0, 0.0};
  double sigma_N = 0.0;  ///< of the normal force's mean
};

namespace detail {

/// Stretches in which a session says that the force sensor has no load. What lies before an approach may be one, or the
/// end of another contact.
inline std::vector<Segment> without_load(const Session& session) {
  std::vector<Segment> list;
  for (const Segment& g : session.segments)
    if (g.is_without_contact()) list.push_back(g);
  std::sort(list.begin(), list.end(),
      [](const Segment& a, const Segment& b) { return a.from_ns + a.to_ns < b.from_ns + b.to_ns; });
  return list;
}

inline std::optional<WrenchTare> tare_of(const Segment& segment, const Session& session,
    const std::vector<WrenchSample>& wrenches, std::size_t least_samples) {
  WrenchTare tare;
  double squares = 0.0;
  std::size_t count = 0;
  for (const WrenchSample& w : wrenches) {
    if (!segment.holds(session.wrench_clock(w.stamp_ns))) continue;
    const double off = w.force_N.z() - tare.force_N.z();
    ++count;
    tare.force_N += (w.force_N - tare.force_N) / double(count);
    tare.torque_Nm += (w.torque_Nm - tare.torque_Nm) / double(count);
    squares += off * (w.force_N.z() - tare.force_N.z());
  }
  if (count < std::max<std::size_t>(least_samples, 2)) return std::nullopt;
  tare.stamp_ns = segment.from_ns / 2 + segment.to_ns / 2;
  tare.sigma_N = std::sqrt(squares / double(count - 1) / double(count));
  return tare;
}

}  // namespace detail

/// The tares of a log, in the order of time.
inline std::vector<WrenchTare> wrench_tares(
    const Session& session, const std::vector<WrenchSample>& wrenches, const DriftLimits& limits = {}) {
  std::vector<WrenchTare> list;
  for (const Segment& g : detail::without_load(session))
    if (const auto tare = detail::tare_of(g, session, wrenches, limits.least_samples);
        tare && (list.empty() || tare->stamp_ns > list.back().stamp_ns))
      list.push_back(*tare);
  return list;
}

/// Takes a force sensor's drift out of its samples, by straight lines from tare to tare; what is left has one tare, the
/// mean of all. Returns the greatest distance of a tare from the middle one [N]; nullopt, with all samples as they
/// were, if none is off by more than noise makes.
inline std::optional<double> remove_wrench_drift(
    std::vector<WrenchSample>& wrenches, const Session& session, const DriftLimits& limits = {}) {
  const std::vector<WrenchTare> tares = wrench_tares(session, wrenches, limits);
  if (tares.size() < 2) return std::nullopt;
  std::vector<double> normal;
  WrenchTare mean;
  for (const WrenchTare& t : tares) {
    normal.push_back(t.force_N.z());
    mean.force_N += t.force_N / double(tares.size());
    mean.torque_Nm += t.torque_Nm / double(tares.size());
  }
  const double middle = median(normal);
  double most = 0.0;
  bool drifts = false;
  for (const WrenchTare& t : tares) {
    const double off = std::abs(t.force_N.z() - middle);
    most = std::max(most, off);
    drifts = drifts || off > std::max(limits.least_N, limits.sigmas * t.sigma_N);
  }
  if (!drifts) return std::nullopt;
  for (WrenchSample& w : wrenches) {
    const std::int64_t at = session.wrench_clock(w.stamp_ns);
    const auto after = std::lower_bound(
        tares.begin(), tares.end(), at, [](const WrenchTare& t, std::int64_t stamp) { return t.stamp_ns < stamp; });
    const WrenchTare &b = after == tares.end() ? tares.back() : *after, &a = after == tares.begin() ? b : *(after - 1);
    const double share = a.stamp_ns == b.stamp_ns || after == tares.end()
                             ? 1.0
                             : double(at - a.stamp_ns) / double(b.stamp_ns - a.stamp_ns);
    w.force_N -= (1.0 - share) * a.force_N + share * b.force_N - mean.force_N;
    w.torque_Nm -= (1.0 - share) * a.torque_Nm + share * b.torque_Nm - mean.torque_Nm;
  }
  return most;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/bag_metadata.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_BAG_METADATA_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_BAG_METADATA_HPP

namespace lumo::sense {

/// What the file metadata.yaml of a ROS 2 bag's folder says of its files (rosbag2_storage/yaml.hpp).
struct BagMetadata {
  std::string storage;             ///< "mcap", "sqlite3"
  std::vector<std::string> files;  ///< in their order, below the folder
};

namespace detail {

/// A value without blanks, comment and quotes.
inline std::string yaml_scalar(std::string_view text) {
  const auto trim = [&] {
    while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
    while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r')) text.remove_suffix(1);
  };
  trim();
  if (!text.empty() && (text.front() == '"' || text.front() == '\'')) {
    const std::size_t end = text.find(text.front(), 1);
    return std::string(text.substr(1, end == std::string_view::npos ? end : end - 1));
  }
  if (const std::size_t comment = text.find(" #"); comment != std::string_view::npos) text = text.substr(0, comment);
  trim();
  return std::string(text);
}

}  // namespace detail

/// Reads metadata.yaml as rosbag2 writes it: of YAML no more than lines "key: value" and the list of files, in block or
/// in flow style. Throws InputError if it names no files, or such as do not lie below the folder.
inline BagMetadata bag_metadata(std::string_view text, const std::string& name) {
  BagMetadata m;
  bool listing = false;
  const auto add = [&](std::string_view item) {
    if (const std::string file = detail::yaml_scalar(item); !file.empty()) m.files.push_back(file);
  };
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    std::string_view line = text.substr(from, end - from);
    from = end + 1;
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (listing && line.starts_with("- ")) {
      add(line.substr(2));
      continue;
    }
    const std::size_t colon = line.find(':');
    const std::string_view key = line.substr(0, std::min(colon, line.size()));
    const std::string value =
        colon == std::string_view::npos ? std::string() : detail::yaml_scalar(line.substr(colon + 1));
    if (key == "storage_identifier") m.storage = value;
    listing = key == "relative_file_paths" && m.files.empty();
    if (listing && value.starts_with('['))
      for (std::size_t at = 1; at < value.size();) {
        const std::size_t next = std::min(value.find_first_of(",]", at), value.size());
        add(std::string_view(value).substr(at, next - at));
        at = next + 1;
      }
  }
  if (m.files.empty()) throw InputError(message(name, ": names no files (relative_file_paths)"));
  for (const std::string& file : m.files)
    if (file.front() == '/' || file.find("..") != std::string::npos || file.find('\0') != std::string::npos)
      throw InputError(message(name, ": file '", printable(file), "' does not lie below the folder"));
  return m;
}

/// Puts the files of a bag in the order of the numbers in their names: bag_2 before bag_10.
inline void sort_by_number(std::vector<std::string>& files) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto key = [&](const std::string& name) {
    std::string padded;
    for (std::size_t i = 0; i < name.size();) {
      std::size_t end = i;
      while (end < name.size() && is_digit(name[end])) ++end;
      constexpr std::size_t most_digits = 20;
      if (end > i) padded += std::string(most_digits - std::min(most_digits, end - i), '0') + name.substr(i, end - i);
      else padded += name[end++];
      i = end;
    }
    return padded;
  };
  std::sort(files.begin(), files.end(),
      [&](const std::string& a, const std::string& b) { return std::pair(key(a), a) < std::pair(key(b), b); });
}

}  // namespace lumo::sense

#endif

// ---- lumo/core/bytes.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_BYTES_HPP
#define SINGLE_INCLUDE_LUMO_CORE_BYTES_HPP

namespace lumo {

enum class ByteOrder : std::uint8_t { big = 0, little = 1 };

/// The number whose first byte is at `bytes`.
template <std::unsigned_integral T, class Byte> constexpr T number_at(const Byte* bytes, ByteOrder order) {
  T v = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    v = T(v | T(static_cast<std::uint8_t>(bytes[i])) << 8 * (order == ByteOrder::little ? i : sizeof(T) - 1 - i));
  return v;
}

namespace detail {

/// Table k: what a byte does to the state k bytes later.
constexpr std::array<std::array<std::uint32_t, 256>, 8> make_crc32_tables() {
  std::array<std::array<std::uint32_t, 256>, 8> t{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t s = i;
    for (int bit = 0; bit < 8; ++bit) s = s >> 1 ^ ((s & 1) != 0 ? 0xEDB88320u : 0u);
    t[0][i] = s;
  }
  for (std::size_t k = 1; k < 8; ++k)
    for (std::size_t i = 0; i < 256; ++i) t[k][i] = t[k - 1][i] >> 8 ^ t[0][t[k - 1][i] & 255];
  return t;
}

inline constexpr auto crc32_tables = make_crc32_tables();

}  // namespace detail

/// Cyclic redundancy check of 32 bits, fed piece by piece: of zip, PNG and MCAP. Reflected polynomial 0xEDB88320, all
/// ones before and after (ISO 3309). Eight bytes at a time by as many tables (Kounavis and Berry 2005). Own code, for
/// these thirty lines would else be the only need of zlib.
class Crc32 {
 public:
  void add(std::span<const std::uint8_t> bytes) {
    const auto& t = detail::crc32_tables;
    std::uint32_t s = state_;
    std::size_t i = 0;
    for (; i + 8 <= bytes.size(); i += 8) {
      const std::uint8_t* b = bytes.data() + i;
      s ^= std::uint32_t(b[0]) | std::uint32_t(b[1]) << 8 | std::uint32_t(b[2]) << 16 | std::uint32_t(b[3]) << 24;
      s = t[7][s & 255] ^ t[6][s >> 8 & 255] ^ t[5][s >> 16 & 255] ^ t[4][s >> 24] ^ t[3][b[4]] ^ t[2][b[5]] ^
          t[1][b[6]] ^ t[0][b[7]];
    }
    for (; i < bytes.size(); ++i) s = s >> 8 ^ t[0][(s ^ bytes[i]) & 255];
    state_ = s;
  }
  std::uint32_t value() const { return ~state_; }
  static std::uint32_t of(std::span<const std::uint8_t> bytes) {
    Crc32 crc;
    crc.add(bytes);
    return crc.value();
  }

 private:
  std::uint32_t state_ = 0xFFFFFFFFu;
};

}  // namespace lumo

#endif

// ---- lumo/sense/devices/picture_header.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DEVICES_PICTURE_HEADER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DEVICES_PICTURE_HEADER_HPP

namespace lumo::sense {

/// Format and size of an image file, which stand before its pixels.
struct PictureHeader {
  enum class Format { png, jpeg, bmp, webp };
  Format format;
  std::uint32_t width, height;  ///< [px]
  int bits;                     ///< of one channel; of a whole pixel in a BMP file
};

/// The header of a PNG, JPEG, BMP or WebP file (PNG: W3C 2003 §11.2.2; JPEG: ITU-T T.81 §B.2.2; BMP: BITMAPINFOHEADER
/// and later; WebP: RFC 9649 §2); nullopt without one, since the memory that a decoder would take is then unknown.
std::optional<PictureHeader> picture_header(std::span<const std::uint8_t> file);

/// Whether a picture is worth decoding: a few bytes must not ask for gigabytes.
inline bool is_decodable(const std::optional<PictureHeader>& h) { return h && is_image_size(h->width, h->height); }

namespace detail {

template <std::unsigned_integral T> T number_in(std::span<const std::uint8_t> bytes, std::size_t at, ByteOrder order) {
  return number_at<T>(bytes.data() + at, order);
}

inline std::optional<PictureHeader> png_header(std::span<const std::uint8_t> f) {
  constexpr std::array<std::uint8_t, 16> head{
      0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n', 0, 0, 0, 13, 'I', 'H', 'D', 'R'};
  if (f.size() < 26 || !std::equal(head.begin(), head.end(), f.begin())) return std::nullopt;
  return PictureHeader{PictureHeader::Format::png, number_in<std::uint32_t>(f, 16, ByteOrder::big),
      number_in<std::uint32_t>(f, 20, ByteOrder::big), f[24]};
}

/// From marker to marker up to the frame's.
inline std::optional<PictureHeader> jpeg_header(std::span<const std::uint8_t> f) {
  if (f.size() < 4 || f[0] != 0xff || f[1] != 0xd8) return std::nullopt;
  for (std::size_t at = 2; at + 4 <= f.size();) {
    if (f[at] != 0xff) return std::nullopt;
    const std::uint8_t marker = f[at + 1];
    if (marker == 0xff) {  // fill bytes may stand before a marker
      ++at;
      continue;
    }
    const bool alone = marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
    if (alone) {
      at += 2;
      continue;
    }
    if (marker == 0xd9 || marker == 0xda) return std::nullopt;  // end, or pixels, before a frame
    const std::size_t length = number_in<std::uint16_t>(f, at + 2, ByteOrder::big);
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (length < 2 || (frame && length < 8)) return std::nullopt;
    if (frame) {
      if (at + 9 > f.size()) return std::nullopt;
      return PictureHeader{PictureHeader::Format::jpeg, number_in<std::uint16_t>(f, at + 7, ByteOrder::big),
          number_in<std::uint16_t>(f, at + 5, ByteOrder::big), f[at + 4]};
    }
    at += 2 + length;
  }
  return std::nullopt;
}

inline std::optional<PictureHeader> bmp_header(std::span<const std::uint8_t> f) {
  if (f.size() < 30 || f[0] != 'B' || f[1] != 'M' || number_in<std::uint32_t>(f, 14, ByteOrder::little) < 40)
    return std::nullopt;
  // Rows may run from top to bottom, as a negative height states.
  const std::uint32_t height = number_in<std::uint32_t>(f, 22, ByteOrder::little);
  return PictureHeader{PictureHeader::Format::bmp, number_in<std::uint32_t>(f, 18, ByteOrder::little),
      height >> 31 ? ~height + 1 : height, int(number_in<std::uint16_t>(f, 28, ByteOrder::little))};
}

/// A container whose first chunk is the picture with loss, the one without, or the canvas of several chunks.
inline std::optional<PictureHeader> webp_header(std::span<const std::uint8_t> f) {
  const auto is = [&](std::size_t at, std::string_view word) {
    return std::equal(word.begin(), word.end(), f.begin() + std::ptrdiff_t(at));
  };
  if (f.size() < 25 || !is(0, "RIFF") || !is(8, "WEBP")) return std::nullopt;
  const auto number = [&](std::size_t at, int from_bit, int bits) {
    return number_in<std::uint32_t>(f, at, ByteOrder::little) >> from_bit & ((1u << bits) - 1);
  };
  const auto header = [](std::uint32_t width, std::uint32_t height) {
    return PictureHeader{PictureHeader::Format::webp, width, height, 8};
  };
  constexpr int side_bits = 14, canvas_bits = 24;
  if (is(12, "VP8L") && f[20] == 0x2f)
    return header(number(21, 0, side_bits) + 1, number(21, side_bits, side_bits) + 1);
  if (f.size() < 30) return std::nullopt;
  if (is(12, "VP8 ") && f[23] == 0x9d && f[24] == 0x01 && f[25] == 0x2a)
    return header(number(26, 0, side_bits), number(26, 16, side_bits));
  if (is(12, "VP8X")) return header(number(24, 0, canvas_bits) + 1, number(26, 8, canvas_bits) + 1);
  return std::nullopt;
}

}  // namespace detail

inline std::optional<PictureHeader> picture_header(std::span<const std::uint8_t> file) {
  if (const auto png = detail::png_header(file)) return png;
  if (const auto jpeg = detail::jpeg_header(file)) return jpeg;
  if (const auto webp = detail::webp_header(file)) return webp;
  return detail::bmp_header(file);
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/mcap.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_HPP

namespace lumo::sense {

// MCAP, a container of time-stamped messages, the default of ROS 2's bags (mcap.dev/spec, version 0). lumo reads and
// writes it itself: its limits on hostile input are strict, and fuzzed.
//
// All numbers are little endian. The parts of a file are: magic; Header; data (Schema, Channel, Message, Chunk,
// MessageIndex, Attachment, Metadata …); DataEnd; summary (Schema, Channel, Statistics, indexes …); Footer; magic.
// A record is its opcode (1 byte), its length (8 bytes) and its contents, to which later versions may append. Records
// of unknown opcodes are skipped. A chunk holds schemas, channels and messages, compressed.

enum class McapOpcode : std::uint8_t {
  header = 1,
  footer,
  schema,
  channel,
  message,
  chunk,
  message_index,
  chunk_index,
  attachment,
  attachment_index,
  statistics,
  metadata,
  metadata_index,
  summary_offset,
  data_end
};

inline constexpr std::array<std::uint8_t, 8> mcap_magic = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};

/// The type of a channel's messages.
struct McapSchema {
  std::uint16_t id = 0;  ///< not 0
  std::string name, encoding, data;
  bool operator==(const McapSchema&) const = default;
};

/// A stream of messages of one type.
struct McapChannel {
  std::uint16_t id = 0, schema = 0;  ///< schema 0: none
  std::string topic, encoding;
  std::map<std::string, std::string> metadata;
  bool operator==(const McapChannel&) const = default;
};

/// A file within the file.
struct McapAttachment {
  std::string name, media_type;
  std::uint64_t log_ns = 0, offset = 0, size = 0;  ///< where its data lie in the file
};

struct McapMetadata {
  std::string name;
  std::map<std::string, std::string> values;
};

/// Compression of chunks. A chunk states its `name`, empty for none.
/// Laws: `decompress` restores what was compressed; it gives `size` bytes or throws InputError, and allocates no more
/// than it has found.
template <class C>
concept ChunkCodec = requires(const C& codec, std::span<const std::uint8_t> bytes, std::size_t size) {
  { C::name } -> std::convertible_to<std::string_view>;
  { codec.compress(bytes) } -> std::same_as<std::vector<std::uint8_t>>;
  { codec.decompress(bytes, size) } -> std::same_as<std::vector<std::uint8_t>>;
};

/// Chunks as they are.
struct Uncompressed {
  static constexpr std::string_view name = "";

  std::vector<std::uint8_t> compress(std::span<const std::uint8_t> bytes) const { return {bytes.begin(), bytes.end()}; }
  std::vector<std::uint8_t> decompress(std::span<const std::uint8_t> bytes, std::size_t size) const {
    if (bytes.size() != size) throw InputError(message("has ", bytes.size(), " bytes, says ", size));
    return {bytes.begin(), bytes.end()};
  }
};

static_assert(ChunkCodec<Uncompressed>);

/// Reads a record's fields one by one and checks each length. Throws InputError that begins with `where` and the byte.
class McapFields {
 public:
  /// `offset`: of the first byte, in what `where` names.
  McapFields(std::span<const std::uint8_t> bytes, const std::string& where, std::uint64_t offset)
      : bytes_(bytes), where_(where), offset_(offset) {}

  template <std::unsigned_integral T> T number() { return number_at<T>(bytes(sizeof(T)).data(), ByteOrder::little); }
  std::string string() {
    const auto b = bytes(number<std::uint32_t>());
    return {b.begin(), b.end()};
  }
  std::map<std::string, std::string> map() {
    std::map<std::string, std::string> m;
    const auto b = bytes(number<std::uint32_t>());
    McapFields in(b, where_, offset() - b.size());
    while (in.rest() > 0) {
      std::string key = in.string();
      m[std::move(key)] = in.string();
    }
    return m;
  }
  /// Numbers, texts and maps, one after the other.
  template <class... Fields> void read(Fields&... f) { (field(f), ...); }
  std::span<const std::uint8_t> bytes(std::uint64_t size) {
    if (size > rest()) fail(message("a field of ", size, " bytes goes beyond the end of its record"));
    at_ += std::size_t(size);
    return bytes_.subspan(at_ - std::size_t(size), std::size_t(size));
  }
  std::size_t rest() const { return bytes_.size() - at_; }
  std::uint64_t offset() const { return offset_ + at_; }
  [[noreturn]] void fail(const std::string& why) const {
    throw InputError(message(where_, "byte ", offset(), ": ", why));
  }

 private:
  template <std::unsigned_integral T> void field(T& v) { v = number<T>(); }
  void field(std::string& s) { s = string(); }
  void field(std::map<std::string, std::string>& m) { m = map(); }

  std::span<const std::uint8_t> bytes_;
  const std::string& where_;
  std::uint64_t offset_;
  std::size_t at_ = 0;
};

/// Builds records.
class McapBytes {
 public:
  template <std::unsigned_integral T> void number(T v) {
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes_.push_back(std::uint8_t(v >> 8 * i));
  }
  void string(std::string_view s) {
    number(std::uint32_t(s.size()));
    bytes_.insert(bytes_.end(), s.begin(), s.end());
  }
  void map(const std::map<std::string, std::string>& m) {
    const std::size_t at = begin_length<std::uint32_t>();
    for (const auto& [key, value] : m) fields(key, value);
    end_length<std::uint32_t>(at);
  }
  /// Numbers, texts and maps, one after the other.
  template <class... Fields> void fields(const Fields&... f) { (field(f), ...); }
  void bytes(std::span<const std::uint8_t> b) { bytes_.insert(bytes_.end(), b.begin(), b.end()); }
  /// A record, whose fields `fill()` appends. Returns where it begins.
  template <class Fill> std::size_t record(McapOpcode opcode, Fill fill) {
    const std::size_t begin = bytes_.size();
    bytes_.push_back(std::uint8_t(opcode));
    const std::size_t at = begin_length<std::uint64_t>();
    fill();
    end_length<std::uint64_t>(at);
    return begin;
  }
  template <std::unsigned_integral T> std::size_t begin_length() {
    number(T(0));
    return bytes_.size();
  }
  template <std::unsigned_integral T> void end_length(std::size_t at) {
    const auto n = T(bytes_.size() - at);
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes_[at - sizeof(T) + i] = std::uint8_t(n >> 8 * i);
  }
  std::span<const std::uint8_t> since(std::size_t at) const { return std::span(bytes_).subspan(at); }
  std::size_t size() const { return bytes_.size(); }
  void clear() { bytes_.clear(); }

 private:
  template <std::unsigned_integral T> void field(T v) { number(v); }
  void field(std::string_view s) { string(s); }
  void field(const std::map<std::string, std::string>& m) { map(m); }

  std::vector<std::uint8_t> bytes_;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/mcap_source.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_SOURCE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_SOURCE_HPP

namespace lumo::sense {

/// The bytes of an MCAP file. Allocates no more than the file has. Throws InputError with file and byte.
class McapSource {
 public:
  static constexpr std::uint64_t head_bytes = 9;  ///< of a record, before its contents

  McapSource(std::unique_ptr<std::istream> in, std::string name)
      : in_(std::move(in)), name_(std::move(name)), where_(name_ + ": ") {
    in_->seekg(0, std::ios::end);
    size_ = std::uint64_t(std::max<std::streamoff>(0, std::streamoff(in_->tellg())));
    if (!in_->good()) throw InputError(where_ + "cannot be read");
  }

  const std::string& name() const { return name_; }
  const std::string& where() const { return where_; }  ///< what messages begin with
  std::uint64_t size() const { return size_; }
  [[noreturn]] void fail(std::uint64_t at, const std::string& why) const {
    throw InputError(message(where_, "byte ", at, ": ", why));
  }

  /// Without zeros behind the end mark, as they are left where space was allocated beforehand; a file without end mark
  /// keeps them.
  std::uint64_t size_without_padding() {
    constexpr std::uint64_t piece = 1u << 16;
    for (std::uint64_t end = size_; end > 0;) {
      const std::uint64_t from = end - std::min(end, piece);
      const std::vector<std::uint8_t> b = bytes(from, end - from);
      const auto last = std::find_if(b.rbegin(), b.rend(), [](std::uint8_t v) { return v != 0; });
      if (last == b.rend()) {
        end = from;
        continue;
      }
      end -= std::uint64_t(last - b.rbegin());
      return end >= mcap_magic.size() && has_magic(end - mcap_magic.size()) ? end : size_;
    }
    return size_;
  }

  /// Bytes that lie within the file.
  std::vector<std::uint8_t> bytes(std::uint64_t at, std::uint64_t size) {
    std::vector<std::uint8_t> b(static_cast<std::size_t>(size));
    in_->clear();
    in_->seekg(std::streamoff(at));
    in_->read(reinterpret_cast<char*>(b.data()), std::streamsize(size));
    if (!*in_) fail(at, "cannot be read");
    return b;
  }
  bool has_magic(std::uint64_t at) {
    const std::vector<std::uint8_t> b = bytes(at, mcap_magic.size());
    return std::equal(b.begin(), b.end(), mcap_magic.begin());
  }
  /// Continues a checksum with a stretch of the file, which may be larger than the memory.
  void add(Crc32& crc, std::uint64_t at, std::uint64_t size) {
    while (size > 0) {
      const std::uint64_t piece = std::min<std::uint64_t>(size, 1u << 20);
      crc.add(bytes(at, piece));
      at += piece;
      size -= piece;
    }
  }

  struct Head {
    McapOpcode opcode;
    std::uint64_t length;
  };
  /// A record's head. It lies before `end` with all of its contents.
  Head head(std::uint64_t at, std::uint64_t end) {
    if (end - at < head_bytes) fail(at, message("the file ends ", end - at, " bytes into a record"));
    const std::vector<std::uint8_t> b = bytes(at, head_bytes);
    McapFields in(b, where_, at);
    const Head h{McapOpcode(in.number<std::uint8_t>()), in.number<std::uint64_t>()};
    if (h.opcode == McapOpcode(0)) fail(at, "a record has the opcode 0, which there is not");
    if (h.length > end - at - head_bytes)
      fail(at, message("a record of ", h.length, " bytes goes beyond the end of the file, ", end - at - head_bytes,
                   " bytes on"));
    return h;
  }
  /// A whole record with its head.
  std::vector<std::uint8_t> record(std::uint64_t at, std::uint64_t most) {
    const Head h = head(at, size_);
    if (h.length > most) fail(at, message("a record has ", h.length, " bytes, read are at most ", most));
    return bytes(at, head_bytes + h.length);
  }

 private:
  std::unique_ptr<std::istream> in_;
  std::string name_, where_;
  std::uint64_t size_ = 0;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/mcap_reader.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_READER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_READER_HPP

namespace lumo::sense {

/// Where a message lies in a file, and what orders it.
struct McapEntry {
  std::uint64_t log_ns = 0;
  std::uint64_t record = 0;    ///< byte of its chunk in the file, or its own
  std::uint32_t in_chunk = 0;  ///< byte in the chunk's contents
  std::uint16_t channel = 0;
  bool chunked = false;
};

struct McapMessage {
  const McapChannel* channel = nullptr;  ///< the reader's
  std::uint32_t sequence = 0;
  std::uint64_t log_ns = 0, publish_ns = 0;
  std::span<const std::uint8_t> data;
  std::shared_ptr<const std::vector<std::uint8_t>> owner;  ///< of `data`
};

/// Limits on what a reader of MCAP files allocates at once.
struct McapLimits {
  std::uint32_t record_bytes = 256u << 20;  ///< of a record but an attachment, and of a chunk's contents
  std::uint32_t kept_bytes = 64u << 20;     ///< of chunks' contents kept for the next message; one chunk always is
};

/// An MCAP file. The constructor goes through all of it once: it checks records, lengths and checksums, keeps schemas,
/// channels and attachments, and lists messages in the order of their log times. It does not rely on summary and
/// indexes, so files without them read as well. A file without its end mark was cut, for instance by a power failure:
/// it is read up to its first incomplete record, which `fault` reports. Any other damage is an InputError, one line
/// with file, byte and reason. `Codecs`: compressions that can be read beside none. For one thread.
template <ChunkCodec... Codecs> class McapReader {
 public:
  /// Throws InputError.
  McapReader(std::unique_ptr<std::istream> in, std::string name, const McapLimits& limits = {})
      : source_(std::move(in), std::move(name)), limits_(limits) {
    const std::uint64_t size = source_.size_without_padding();
    if (size < mcap_magic.size() || !source_.has_magic(0)) fail(0, "is no MCAP file, which begins with its magic");
    const bool whole = size >= 2 * mcap_magic.size() && source_.has_magic(size - mcap_magic.size());
    try {
      scan(whole ? size - mcap_magic.size() : size);
      if (!whole) fail(size, "the file was cut, it lacks its end");
    } catch (const InputError& e) {
      if (whole) throw;
      fault_ = e.what();
    }
    std::stable_sort(
        messages_.begin(), messages_.end(), [](const McapEntry& a, const McapEntry& b) { return a.log_ns < b.log_ns; });
  }
  /// Throws InputError.
  static McapReader open(const std::string& path, const McapLimits& limits = {}) {
    auto in = std::make_unique<std::ifstream>(path, std::ios::binary);
    if (!*in) throw InputError(path + ": cannot be opened");
    return McapReader(std::move(in), path, limits);
  }

  const std::string& name() const { return source_.name(); }
  const std::string& profile() const { return profile_; }
  const std::string& library() const { return library_; }  ///< that wrote the file
  const std::map<std::uint16_t, McapSchema>& schemas() const { return schemas_; }
  const std::map<std::uint16_t, McapChannel>& channels() const { return channels_; }
  const std::vector<McapAttachment>& attachments() const { return attachments_; }
  const std::vector<McapMetadata>& metadata() const { return metadata_; }
  /// In the order of their log times; those of one time as they stand in the file.
  const std::vector<McapEntry>& messages() const { return messages_; }
  /// Place and reason of a cut file's end; empty for a whole file.
  const std::string& fault() const { return fault_; }

  /// Throws InputError if the file has changed since, and for a packed message that cannot be unpacked.
  McapMessage read(const McapEntry& entry) {
    McapMessage m;
    std::size_t at = 0;
    if (entry.chunked) {
      m.owner = chunk(entry.record);
      at = entry.in_chunk;
    } else {
      m.owner = std::make_shared<const std::vector<std::uint8_t>>(record_at(entry.record));
    }
    const std::string where = entry.chunked ? chunk_place(entry.record) : source_.where();
    McapFields in(std::span<const std::uint8_t>(*m.owner).subspan(std::min(at, m.owner->size())), where,
        entry.chunked ? at : entry.record);
    const auto opcode = McapOpcode(in.number<std::uint8_t>());
    const auto length = in.number<std::uint64_t>();
    const std::uint64_t begin = in.offset();
    McapFields fields(in.bytes(length), where, begin);
    if (opcode != McapOpcode::message) fields.fail("is no message any more: the file has changed");
    fill(m, fields);
    unpack(m);
    return m;
  }
  /// Throws InputError if the file has changed since.
  std::vector<std::uint8_t> read(const McapAttachment& a) { return source_.bytes(a.offset, a.size); }

 private:
  using Bytes = std::vector<std::uint8_t>;
  static constexpr std::uint64_t head_bytes = McapSource::head_bytes;

  std::string chunk_place(std::uint64_t at) const { return message(source_.where(), "chunk at byte ", at, ", "); }
  [[noreturn]] void fail(std::uint64_t at, const std::string& why) const { source_.fail(at, why); }
  Bytes record_at(std::uint64_t at) { return source_.record(at, limits_.record_bytes); }

  void scan(std::uint64_t end) {
    Crc32 data_crc;
    data_crc.add(mcap_magic);
    std::optional<std::uint64_t> data_end;  // where the summary may begin
    bool first = true, closed = false;
    std::uint64_t at = mcap_magic.size();
    while (at < end) {
      if (closed) fail(at, "there is more behind the footer");
      const McapSource::Head h = source_.head(at, end);
      if (first != (h.opcode == McapOpcode::header))
        fail(at, first ? "the first record is no header" : "there is a second header");
      first = false;
      const bool of_data = h.opcode == McapOpcode::message || h.opcode == McapOpcode::chunk ||
                           h.opcode == McapOpcode::message_index || h.opcode == McapOpcode::attachment ||
                           h.opcode == McapOpcode::metadata || h.opcode == McapOpcode::data_end;
      if (of_data && data_end)
        fail(at, message("a record of the data, opcode ", int(h.opcode), ", stands behind their end"));
      if (h.opcode == McapOpcode::attachment) {
        add_attachment(at, h.length);
        source_.add(data_crc, at, head_bytes + h.length);
      } else if (h.opcode > McapOpcode::data_end) {
        if (!data_end) source_.add(data_crc, at, head_bytes + h.length);
      } else {
        const Bytes record = record_at(at);
        McapFields in(std::span<const std::uint8_t>(record).subspan(head_bytes), source_.where(), at + head_bytes);
        if (h.opcode == McapOpcode::data_end) {
          const auto stated = in.number<std::uint32_t>();
          if (stated != 0 && stated != data_crc.value()) fail(at, "the data are damaged: their checksum is another");
          data_end = at + head_bytes + h.length;
        } else if (h.opcode == McapOpcode::footer) {
          if (!data_end) fail(at, "there is a footer before the end of the data");
          check_summary(in, at, *data_end);
          closed = true;
        } else if (h.opcode == McapOpcode::chunk) {
          take_chunk(record, at);
        } else {
          take(h.opcode, in, {0, at, 0, 0, false});
        }
        if (!data_end) data_crc.add(record);
      }
      at += head_bytes + h.length;
    }
    if (!closed) fail(at, "the file ends without a footer");
  }

  /// A record of the data or the summary. `place`: of a message.
  void take(McapOpcode opcode, McapFields& in, McapEntry place) {
    switch (opcode) {
      case McapOpcode::header: in.read(profile_, library_); break;
      case McapOpcode::schema: {
        McapSchema s;
        in.read(s.id, s.name, s.encoding, s.data);
        if (s.id == 0) in.fail("a schema has the number 0");
        if (const auto [it, added] = schemas_.emplace(s.id, s); !added && it->second != s)
          in.fail(message("there is another schema ", s.id));
        break;
      }
      case McapOpcode::channel: {
        McapChannel c;
        in.read(c.id, c.schema, c.topic, c.encoding, c.metadata);
        if (c.schema != 0 && !schemas_.contains(c.schema))
          in.fail(message("channel ", c.id, " is of schema ", c.schema, ", which was not there before it"));
        if (const auto [it, added] = channels_.emplace(c.id, c); !added && it->second != c)
          in.fail(message("there is another channel ", c.id));
        break;
      }
      case McapOpcode::message: {
        McapMessage m;
        fill(m, in);
        place.log_ns = m.log_ns;
        place.channel = m.channel->id;
        messages_.push_back(place);
        break;
      }
      case McapOpcode::metadata: {
        McapMetadata m;
        in.read(m.name, m.values);
        metadata_.push_back(std::move(m));
        break;
      }
      default: break;  // indexes of what has been seen
    }
  }
  void fill(McapMessage& m, McapFields& in) const {
    const auto id = in.number<std::uint16_t>();
    const auto channel = channels_.find(id);
    if (channel == channels_.end()) in.fail(message("a message is of channel ", id, ", which was not there before it"));
    m.channel = &channel->second;
    in.read(m.sequence, m.log_ns, m.publish_ns);
    m.data = in.bytes(in.rest());
  }

  /// rosbag2 can pack each message by itself ("compression_mode: MESSAGE"), which the file does not state. No CDR
  /// message begins as a frame of Zstandard does.
  void unpack(McapMessage& m) const {
    if (m.channel->encoding != "cdr") return;
    const auto attempt = [&](const auto& codec) {
      if constexpr (requires { codec.frame_bytes(m.data); }) {
        const auto size = codec.frame_bytes(m.data);
        if (!size) return;
        if (*size > limits_.record_bytes)
          throw InputError(message(source_.where(), "a packed message says that it holds ", *size,
              " bytes, read are at most ", limits_.record_bytes));
        auto whole = std::make_shared<const Bytes>(codec.decompress(m.data, std::size_t(*size)));
        m.data = *whole;
        m.owner = std::move(whole);
      }
    };
    std::apply([&](const auto&... codec) { (attempt(codec), ...); }, codecs_);
  }

  void take_chunk(std::span<const std::uint8_t> chunk_record, std::uint64_t at) {
    const auto contents = keep(at, unpacked(chunk_record, at));
    const std::string where = chunk_place(at);
    McapFields in(*contents, where, 0);
    while (in.rest() > 0) {
      const std::uint64_t begin = in.offset();
      if (const auto rest = std::span(*contents).subspan(std::size_t(begin));
          std::all_of(rest.begin(), rest.end(), [](std::uint8_t b) { return b == 0; }))
        break;  // padded with zeros, which are no records
      const auto opcode = McapOpcode(in.number<std::uint8_t>());
      const auto length = in.number<std::uint64_t>();
      const std::uint64_t inside = in.offset();
      McapFields record(in.bytes(length), where, inside);
      if (opcode == McapOpcode::schema || opcode == McapOpcode::channel || opcode == McapOpcode::message)
        take(opcode, record, {0, at, std::uint32_t(begin), 0, true});
      else if (opcode <= McapOpcode::data_end) record.fail(message("a chunk holds a record of opcode ", int(opcode)));
    }
  }
  /// Contents of the chunk at a place, from what is kept or from the file.
  std::shared_ptr<const Bytes> chunk(std::uint64_t at) {
    const auto known = std::find_if(kept_.begin(), kept_.end(), [at](const auto& k) { return k.first == at; });
    if (known != kept_.end()) {
      std::rotate(known, known + 1, kept_.end());  // the one used last is dropped last
      return kept_.back().second;
    }
    return keep(at, unpacked(record_at(at), at));
  }
  std::shared_ptr<const Bytes> keep(std::uint64_t at, Bytes contents) {
    kept_.emplace_back(at, std::make_shared<const Bytes>(std::move(contents)));
    std::uint64_t sum = 0;
    for (const auto& k : kept_) sum += k.second->size();
    while (kept_.size() > 1 && sum > limits_.kept_bytes) {
      sum -= kept_.front().second->size();
      kept_.erase(kept_.begin());
    }
    return kept_.back().second;
  }
  Bytes unpacked(std::span<const std::uint8_t> record, std::uint64_t at) const {
    McapFields in(record.subspan(head_bytes), source_.where(), at + head_bytes);
    in.bytes(16);  // times of the first and last message
    const auto size = in.number<std::uint64_t>();
    const auto crc = in.number<std::uint32_t>();
    const std::string compression = in.string();
    const auto packed = in.bytes(in.number<std::uint64_t>());
    if (size > limits_.record_bytes)
      fail(at, message("a chunk says that it holds ", size, " bytes, read are at most ", limits_.record_bytes));
    std::optional<Bytes> contents;
    try {
      const auto attempt = [&](const auto& codec) {
        const bool is_none = codec.name.empty() && compression == "none";  // as some writers name it
        if (!contents && (codec.name == compression || is_none)) contents = codec.decompress(packed, std::size_t(size));
      };
      attempt(Uncompressed{});
      std::apply([&](const auto&... codec) { (attempt(codec), ...); }, codecs_);
    } catch (const InputError& e) {
      fail(at, message("a chunk's contents cannot be unpacked: ", e.what()));
    }
    if (!contents)
      fail(at, message("a chunk is compressed by '", printable(compression), "', which cannot be read here"));
    if (crc != 0 && crc != Crc32::of(*contents)) fail(at, "a chunk is damaged: its contents' checksum is another");
    return std::move(*contents);
  }

  /// The record's checksum is checked piece by piece: it may be larger than the memory.
  void add_attachment(std::uint64_t at, std::uint64_t length) {
    const std::uint64_t begin = at + head_bytes;
    const Bytes front = source_.bytes(begin, std::min<std::uint64_t>(length, 1u << 20));
    McapFields in(front, source_.where(), begin);
    McapAttachment a;
    a.log_ns = in.number<std::uint64_t>();
    in.number<std::uint64_t>();  // when it was made
    in.read(a.name, a.media_type, a.size);
    a.offset = in.offset();
    const std::uint64_t rest = length - (a.offset - begin);
    if (rest < 4 || a.size > rest - 4)
      in.fail(message("an attachment of ", a.size, " bytes goes beyond the end of its record"));
    const Bytes tail = source_.bytes(a.offset + a.size, 4);
    const auto stated = McapFields(tail, source_.where(), a.offset + a.size).number<std::uint32_t>();
    Crc32 crc;
    if (stated != 0) source_.add(crc, begin, a.offset + a.size - begin);
    if (stated != 0 && stated != crc.value()) fail(at, "an attachment is damaged: its checksum is another");
    attachments_.push_back(std::move(a));
  }
  /// The checksum goes from the summary's first byte to the footer's last but itself.
  void check_summary(McapFields& footer, std::uint64_t at, std::uint64_t data_end) {
    const auto start = footer.number<std::uint64_t>();
    footer.number<std::uint64_t>();  // where the summary's offsets begin
    const auto stated = footer.number<std::uint32_t>();
    if (start != 0 && (start < data_end || start > at))
      fail(at, message("the footer says that the summary begins at byte ", start, ", must lie in [", data_end, ", ", at,
                   "]"));
    const std::uint64_t from = start == 0 ? at : start;
    Crc32 crc;
    if (stated != 0) source_.add(crc, from, at + head_bytes + 16 - from);
    if (stated != 0 && stated != crc.value()) fail(at, "the summary is damaged: its checksum is another");
  }

  McapSource source_;
  std::string profile_, library_, fault_;
  McapLimits limits_;
  std::map<std::uint16_t, McapSchema> schemas_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::vector<McapAttachment> attachments_;
  std::vector<McapMetadata> metadata_;
  std::vector<McapEntry> messages_;
  std::vector<std::pair<std::uint64_t, std::shared_ptr<const Bytes>>> kept_;
  [[no_unique_address]] std::tuple<Codecs...> codecs_;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/cdr.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_CDR_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_CDR_HPP

namespace lumo::sense {

// Common Data Representation, as ROS 2 serialises messages (OMG DDS-XTypes 1.3, 7.4.1: plain CDR of version 1). lumo
// reads and writes it itself: its limits on hostile input are strict, and fuzzed.
//
// Four bytes state the byte order. The fields follow one by one, each number at a multiple of its size, counted from
// behind those four bytes. A text is its length with the closing zero (32 bits), then its bytes; a sequence is its
// length, then its items.
//
// A message is a struct with `static void fields(self, archive)`, which hands its members to the archive in order:
// CdrReader fills them, CdrWriter takes them.

template <class T>
concept CdrNumber = std::is_arithmetic_v<T> && sizeof(T) <= 8;

/// The unsigned integer as large as a number.
template <class T> using BitsOf = std::conditional_t<sizeof(T) == 8, std::uint64_t,
    std::conditional_t<sizeof(T) == 4, std::uint32_t, std::conditional_t<sizeof(T) == 2, std::uint16_t, std::uint8_t>>>;

/// A message, or a part of one.
template <class T, class Archive>
concept CdrStruct = requires(T& t, Archive& a) {
  T::fields(t, a);
};

/// Reads the fields of one message. Throws InputError with the byte. Allocates no more than the message could hold.
class CdrReader {
 public:
  explicit CdrReader(std::span<const std::uint8_t> message) {
    if (message.size() < 4)
      throw InputError(lumo::message("CDR message has ", message.size(), " bytes, must have at least 4"));
    if (message[0] != 0 || message[1] > 1)
      throw InputError(lumo::message("CDR message is of representation ", message[0] * 256 + message[1],
          ", read are 0 (big endian) and 1 (little endian)"));
    order_ = ByteOrder(message[1]);
    bytes_ = message.subspan(4);
  }

  template <class... Fields> void operator()(Fields&... fields) { (read(fields), ...); }
  /// To be called last. Some writers fill up to a multiple of four bytes.
  void finish() const {
    if (bytes_.size() - at_ > 3)
      fail(lumo::message("the message goes on for ", bytes_.size() - at_, " bytes behind its last field"));
  }

 private:
  [[noreturn]] void fail(const std::string& why) const {
    throw InputError(lumo::message("CDR byte ", at_ + 4, ": ", why));
  }

  std::span<const std::uint8_t> take(std::size_t size, std::size_t alignment) {
    const std::size_t padding = (alignment - at_ % alignment) % alignment, rest = bytes_.size() - at_;
    if (padding > rest || size > rest - padding)
      fail(lumo::message("a field of ", size, " bytes goes beyond the end of the message"));
    at_ += padding + size;
    return bytes_.subspan(at_ - size, size);
  }
  template <class Bits> Bits bits() { return number_at<Bits>(take(sizeof(Bits), sizeof(Bits)).data(), order_); }
  /// Length of a sequence whose items have at least `least` bytes each.
  std::size_t length(std::size_t least) {
    const std::size_t n = bits<std::uint32_t>();
    if (n > (bytes_.size() - at_) / least)
      fail(lumo::message("a sequence of ", n, " items goes beyond the end of the message"));
    return n;
  }

  void read(std::span<const std::uint8_t>& v) { v = take(length(1), 1); }
  void read(bool& v) { v = bits<std::uint8_t>() != 0; }
  void read(std::string& v) {
    const auto b = take(length(1), 1);
    if (!b.empty() && b.back() != 0) fail("a text does not end in a zero");
    v.assign(b.begin(), b.end());
    if (!v.empty()) v.pop_back();
  }
  template <CdrNumber T> void read(T& v) { v = std::bit_cast<T>(bits<BitsOf<T>>()); }
  template <class T, std::size_t size> void read(std::array<T, size>& v) {
    for (T& item : v) read(item);
  }
  template <class T> void read(std::vector<T>& v) {
    v.resize(length(std::is_arithmetic_v<T> ? sizeof(T) : 4));
    for (T& item : v) read(item);
  }
  template <class T>
  requires CdrStruct<T, CdrReader>
  void read(T& v) { T::fields(v, *this); }

  std::span<const std::uint8_t> bytes_;
  ByteOrder order_;
  std::size_t at_ = 0;
};

/// Writes the fields of one message.
class CdrWriter {
 public:
  explicit CdrWriter(ByteOrder order = ByteOrder::little) : bytes_{0, std::uint8_t(order), 0, 0}, order_(order) {}

  template <class... Fields> void operator()(const Fields&... fields) { (write(fields), ...); }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  template <class Bits> void bits(Bits v) {
    while (bytes_.size() % sizeof(Bits) != 4 % sizeof(Bits)) bytes_.push_back(0);  // counted from behind the first four
    for (std::size_t i = 0; i < sizeof(Bits); ++i)
      bytes_.push_back(std::uint8_t(v >> 8 * (order_ == ByteOrder::little ? i : sizeof(Bits) - 1 - i)));
  }
  void length(std::size_t n) {
    if (n > 0xFFFFFFFFu)
      throw InvalidArgument(lumo::message("CDR sequence has ", n, " items, must have at most 4294967295"));
    bits(std::uint32_t(n));
  }

  void write(std::span<const std::uint8_t> v) {
    length(v.size());
    bytes_.insert(bytes_.end(), v.begin(), v.end());
  }
  void write(bool v) { bits(std::uint8_t(v)); }
  void write(const std::string& v) {
    length(v.size() + 1);
    bytes_.insert(bytes_.end(), v.begin(), v.end());
    bytes_.push_back(0);
  }
  template <CdrNumber T> void write(T v) { bits(std::bit_cast<BitsOf<T>>(v)); }
  template <class T, std::size_t size> void write(const std::array<T, size>& v) {
    for (const T& item : v) write(item);
  }
  template <class T> void write(const std::vector<T>& v) {
    length(v.size());
    for (const T& item : v) write(item);
  }
  template <class T>
  requires CdrStruct<const T, CdrWriter>
  void write(const T& v) { T::fields(v, *this); }

  std::vector<std::uint8_t> bytes_;
  ByteOrder order_;
};

/// The message in these bytes. Throws InputError.
template <class Message>
requires CdrStruct<Message, CdrReader> Message from_cdr(std::span<const std::uint8_t> bytes) {
  Message m;
  CdrReader in(bytes);
  in(m);
  in.finish();
  return m;
}

template <class Message>
requires CdrStruct<const Message, CdrWriter> std::vector<std::uint8_t> to_cdr(
    const Message& m, ByteOrder order = ByteOrder::little) {
  CdrWriter out(order);
  out(m);
  return out.bytes();
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/ros_messages.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_ROS_MESSAGES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_ROS_MESSAGES_HPP

namespace lumo::sense {

// Messages of ROS 2 that a log holds, and lumo's own where ROS has none. `type` is the name of the schema,
// `definition` its text (encoding ros2msg): the fields, and behind a line of 80 '=' those of each type that they name.
// Source: the packages std_msgs, sensor_msgs and geometry_msgs of ROS 2.

namespace detail {

inline constexpr std::string_view ros_rule =
    "================================================================================\n";
inline constexpr std::string_view ros_header = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
inline constexpr std::string_view ros_time = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

/// Fields, then the types below them: those given, and always the header.
inline std::string ros_definition(std::string_view fields, std::initializer_list<std::string_view> below = {}) {
  std::string t = "std_msgs/Header header\n" + std::string(fields);
  for (const std::string_view b : below) t += std::string(ros_rule) + std::string(b);
  return t + std::string(ros_rule) + std::string(ros_header) + std::string(ros_rule) + std::string(ros_time);
}

}  // namespace detail

/// std_msgs/Header. On the wire seconds are of 32 bits: from 1901 to 2038.
struct RosHeader {
  std::int64_t stamp_ns = 0;
  std::string frame_id;

  template <class Archive> static void fields(const RosHeader& self, Archive& archive) {
    std::int64_t s = self.stamp_ns / 1'000'000'000, ns = self.stamp_ns % 1'000'000'000;
    if (ns < 0) {
      --s;
      ns += 1'000'000'000;
    }
    if (s != std::int32_t(s))
      throw InvalidArgument(
          message("stamp of a message is ", self.stamp_ns, " ns, must lie within the 2147483648 s of its format"));
    archive(std::int32_t(s), std::uint32_t(ns), self.frame_id);
  }
  template <class Archive> static void fields(RosHeader& self, Archive& archive) {
    std::int32_t s = 0;
    std::uint32_t ns = 0;
    archive(s, ns, self.frame_id);
    if (ns >= 1'000'000'000) throw InputError(message("stamp has ", ns, " ns, must have fewer than 1000000000"));
    self.stamp_ns = std::int64_t(s) * 1'000'000'000 + ns;
  }
};

/// Pixels as they are: rows of `step` bytes.
struct RosImage {
  static constexpr std::string_view type = "sensor_msgs/msg/Image";
  static std::string definition() {
    return detail::ros_definition(
        "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n");
  }
  RosHeader header;
  std::uint32_t height = 0, width = 0;
  std::string encoding;  ///< "mono8", "bgr8", "rgb8" or one of those that lumo does not read
  std::uint8_t is_bigendian = 0;
  std::uint32_t step = 0;
  std::span<const std::uint8_t> data;  ///< of the bytes that the message was read from

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.height, s.width, s.encoding, s.is_bigendian, s.step, s.data);
  }
};

/// An image file.
struct RosCompressedImage {
  static constexpr std::string_view type = "sensor_msgs/msg/CompressedImage";
  static std::string definition() { return detail::ros_definition("string format\nuint8[] data\n"); }
  RosHeader header;
  std::string format;                  ///< "png", "jpeg", or with more words
  std::span<const std::uint8_t> data;  ///< of the bytes that the message was read from

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.format, s.data);
  }
};

struct RosRegionOfInterest {
  std::uint32_t x_offset = 0, y_offset = 0, height = 0, width = 0;
  bool do_rectify = false;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.x_offset, s.y_offset, s.height, s.width, s.do_rectify);
  }
};

/// A camera's size, and its calibration where k[0] is not 0.
struct RosCameraInfo {
  static constexpr std::string_view type = "sensor_msgs/msg/CameraInfo";
  static std::string definition() {
    return detail::ros_definition(
        "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] "
        "p\nuint32 binning_x\nuint32 binning_y\n"
        "sensor_msgs/RegionOfInterest roi\n",
        {"MSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool "
         "do_rectify\n"});
  }
  RosHeader header;
  std::uint32_t height = 0, width = 0;
  std::string distortion_model;
  std::vector<double> d;
  std::array<double, 9> k{}, r{};
  std::array<double, 12> p{};
  std::uint32_t binning_x = 0, binning_y = 0;
  RosRegionOfInterest roi;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.height, s.width, s.distortion_model, s.d, s.k, s.r, s.p, s.binning_x, s.binning_y, s.roi);
  }
};

/// Of joints: rad, rad/s, N·m; a list is as long as that of the names, or empty.
struct RosJointState {
  static constexpr std::string_view type = "sensor_msgs/msg/JointState";
  static std::string definition() {
    return detail::ros_definition("string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n");
  }
  RosHeader header;
  std::vector<std::string> name;
  std::vector<double> position, velocity, effort;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.name, s.position, s.velocity, s.effort);
  }
};

/// Force [N] and torque [N·m].
struct RosWrenchStamped {
  static constexpr std::string_view type = "geometry_msgs/msg/WrenchStamped";
  static std::string definition() {
    return detail::ros_definition("geometry_msgs/Wrench wrench\n",
        {"MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
            "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"});
  }
  RosHeader header;
  std::array<double, 3> force{}, torque{};

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.force, s.torque);
  }
};

/// How the picture of the same stamp was taken.
struct FrameExposure {
  static constexpr std::string_view type = "lumo_msgs/msg/FrameExposure";
  static std::string definition() { return detail::ros_definition("float64 exposure_s\nfloat64 gain\n"); }
  RosHeader header;
  double exposure_s = 0.0, gain = 0.0;  ///< 0: not known

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.exposure_s, s.gain);
  }
};

/// Motors' currents [A] of the JointState of the same stamp. Its effort is then empty, because it would be a torque.
struct JointCurrents {
  static constexpr std::string_view type = "lumo_msgs/msg/JointCurrents";
  static std::string definition() { return detail::ros_definition("float64[] current_a\n"); }
  RosHeader header;
  std::vector<double> current_A;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) { archive(s.header, s.current_A); }
};

struct MarkerDisplacement {
  static constexpr std::string_view type = "lumo_msgs/msg/MarkerDisplacement";
  static std::string definition() { return detail::ros_definition("float64 displacement_m\n"); }
  RosHeader header;
  double displacement_m = 0.0;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) {
    archive(s.header, s.displacement_m);
  }
};

struct PhotodiodeSignals {
  static constexpr std::string_view type = "lumo_msgs/msg/PhotodiodeSignals";
  static std::string definition() { return detail::ros_definition("float64[] signal_v\n"); }
  RosHeader header;
  std::vector<double> signal_V;

  template <class Self, class Archive> static void fields(Self& s, Archive& archive) { archive(s.header, s.signal_V); }
};

/// A message with its name and its schema.
template <class M>
concept RosMessage = CdrStruct<M, CdrReader> && CdrStruct<const M, CdrWriter> && requires(M& m) {
  { M::type } -> std::convertible_to<std::string_view>;
  { M::definition() } -> std::same_as<std::string>;
  { m.header } -> std::same_as<RosHeader&>;
};

static_assert(RosMessage<RosImage> && RosMessage<RosCompressedImage> && RosMessage<RosCameraInfo> &&
              RosMessage<RosJointState> && RosMessage<RosWrenchStamped>);
static_assert(RosMessage<FrameExposure> && RosMessage<JointCurrents> && RosMessage<MarkerDisplacement> &&
              RosMessage<PhotodiodeSignals>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/ros_pixels.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_ROS_PIXELS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_ROS_PIXELS_HPP

namespace lumo::sense {

/// How the bytes of an Image's pixels are arranged.
struct RosEncoding {
  enum class Layout { grey, colours, yuv, bayer };
  std::string_view name;
  Layout layout;
  int bytes;  ///< of a pixel
  std::array<int, 3> place{
      0, 0, 0};                ///< where blue, green, red stand in a pixel; of yuv: luminance, U, V in two pixels
  std::string_view pattern{};  ///< of bayer: the colours of two rows of two pixels
};

/// The encodings that are read, all of 8 bits (sensor_msgs/image_encodings.hpp). 8UC3 does not say which colour comes
/// first: green, which counts, is in the middle anyhow.
inline constexpr std::array<RosEncoding, 17> ros_encodings{{
    {"mono8", RosEncoding::Layout::grey, 1},
    {"8UC1", RosEncoding::Layout::grey, 1},
    {"bgr8", RosEncoding::Layout::colours, 3, {0, 1, 2}},
    {"rgb8", RosEncoding::Layout::colours, 3, {2, 1, 0}},
    {"8UC3", RosEncoding::Layout::colours, 3, {0, 1, 2}},
    {"bgra8", RosEncoding::Layout::colours, 4, {0, 1, 2}},
    {"rgba8", RosEncoding::Layout::colours, 4, {2, 1, 0}},
    {"8UC4", RosEncoding::Layout::colours, 4, {0, 1, 2}},
    {"yuv422", RosEncoding::Layout::yuv, 2, {1, 0, 2}},
    {"uyvy", RosEncoding::Layout::yuv, 2, {1, 0, 2}},
    {"yuv422_yuy2", RosEncoding::Layout::yuv, 2, {0, 1, 3}},
    {"yuyv", RosEncoding::Layout::yuv, 2, {0, 1, 3}},
    {"yuy2", RosEncoding::Layout::yuv, 2, {0, 1, 3}},
    {"bayer_rggb8", RosEncoding::Layout::bayer, 1, {}, "rggb"},
    {"bayer_bggr8", RosEncoding::Layout::bayer, 1, {}, "bggr"},
    {"bayer_gbrg8", RosEncoding::Layout::bayer, 1, {}, "gbrg"},
    {"bayer_grbg8", RosEncoding::Layout::bayer, 1, {}, "grbg"},
}};

/// The encoding of that name; null if it is not read.
constexpr const RosEncoding* ros_encoding(std::string_view name) {
  const auto* const found =
      std::find_if(ros_encodings.begin(), ros_encodings.end(), [&](const RosEncoding& e) { return e.name == name; });
  return found == ros_encodings.end() ? nullptr : found;
}

/// Checks an Image's encoding and that its pixels are all there; no pixels at all are a frame that was lost. Throws
/// InputError.
inline const RosEncoding& require_readable(const RosImage& m) {
  const RosEncoding* const e = ros_encoding(m.encoding);
  if (e == nullptr)
    throw InputError(message("pictures are of encoding '", printable(m.encoding),
        "', read are mono8, bgr8, rgb8, bgra8, rgba8, yuv422 (uyvy), yuv422_yuy2 (yuyv), 8UC1, 8UC3 and bayer_*8"));
  if (m.width == 0 && m.height == 0) return *e;
  if (m.width < 1 || m.height < 1 || m.width > max_image_side || m.height > max_image_side)
    throw InputError(
        message("a picture has ", m.width, " x ", m.height, " px, must have 1 to ", max_image_side, " each way"));
  if (e->layout == RosEncoding::Layout::yuv && m.width % 2 != 0)
    throw InputError(message("a picture of encoding '", e->name, "' is ", m.width, " px wide, must be even"));
  const std::uint64_t row = std::uint64_t(m.width) * std::uint64_t(e->bytes),
                      needed = std::uint64_t(m.step) * (m.height - 1) + row;
  if (m.step < row) throw InputError(message("a picture's rows have ", m.step, " bytes, must have ", row));
  if (m.data.size() < needed) throw InputError(message("a picture has ", m.data.size(), " bytes, must have ", needed));
  return *e;
}

/// Pixels of an Image as grey, or as blue, green, red.
class RosPixels {
 public:
  /// A view that holds until the next call, and as long as the message's bytes; empty for an Image without pixels.
  /// Throws InputError for another encoding or sizes that do not match.
  ImageView operator()(const RosImage& m) {
    const RosEncoding& e = require_readable(m);
    if (m.width == 0 && m.height == 0) return {};
    const bool as_it_is = e.layout == RosEncoding::Layout::grey || (e.bytes == 3 && e.place[0] == 0);
    const PixelFormat format = e.layout == RosEncoding::Layout::grey ? PixelFormat::grey : PixelFormat::bgr;
    const ImageView raw{m.data.data(), int(m.width), int(m.height), std::ptrdiff_t(m.step), format};
    if (as_it_is) return raw;
    if (image_.width != raw.width || image_.height != raw.height) image_ = Image::black(raw.width, raw.height);
    for (int y = 0; y < raw.height; ++y) {
      std::uint8_t* const to = image_.row(y);
      if (e.layout == RosEncoding::Layout::colours) colours(e, raw.row(y), to);
      else if (e.layout == RosEncoding::Layout::yuv) yuv(e, raw.row(y), to);
      else bayer(e, raw, y, to);
    }
    return image_.view();
  }

 private:
  void colours(const RosEncoding& e, const std::uint8_t* from, std::uint8_t* to) const {
    for (int x = 0; x < image_.width; ++x)
      for (std::size_t c = 0; c < 3; ++c) to[3 * x + int(c)] = from[e.bytes * x + e.place[c]];
  }

  /// ITU-R BT.601 over the full range, as JFIF has it: nothing is cut off, so that values stay linear in the light. A
  /// camera that leaves out the ends of the range gives values smaller by 1.16.
  void yuv(const RosEncoding& e, const std::uint8_t* from, std::uint8_t* to) const {
    const auto byte = [](double v) { return std::uint8_t(std::clamp(v + 0.5, 0.0, 255.0)); };
    for (int x = 0; x < image_.width; ++x) {
      const std::uint8_t* const pair = from + 4 * (x / 2);
      const double luminance = pair[e.place[0] + 2 * (x % 2)], u = double(pair[e.place[1]]) - 128.0,
                   v = double(pair[e.place[2]]) - 128.0;
      to[3 * x] = byte(luminance + 1.772 * u);
      to[3 * x + 1] = byte(luminance - 0.344136 * u - 0.714136 * v);
      to[3 * x + 2] = byte(luminance + 1.402 * v);
    }
  }

  /// Each colour is the mean of its own pixels among the neighbours, or the pixel itself.
  void bayer(const RosEncoding& e, const ImageView& raw, int y, std::uint8_t* to) const {
    const auto colour_at = [&](int column, int row) {
      const char c = e.pattern[std::size_t(2 * (row % 2) + column % 2)];
      return c == 'b' ? 0 : c == 'g' ? 1 : 2;
    };
    for (int x = 0; x < raw.width; ++x) {
      std::array<int, 3> sum{}, count{};
      for (int row = std::max(0, y - 1); row <= std::min(raw.height - 1, y + 1); ++row)
        for (int column = std::max(0, x - 1); column <= std::min(raw.width - 1, x + 1); ++column) {
          const auto c = std::size_t(colour_at(column, row));
          sum[c] += raw.row(row)[column];
          ++count[c];
        }
      const int own = colour_at(x, y);
      for (std::size_t c = 0; c < 3; ++c)
        to[3 * x + int(c)] = int(c) == own   ? raw.row(y)[x]
                             : count[c] == 0 ? std::uint8_t(0)
                                             : std::uint8_t((sum[c] + count[c] / 2) / count[c]);
    }
  }

  Image image_;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/recording.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_RECORDING_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_RECORDING_HPP

namespace lumo::sense {

/// A log's session and tables; the pictures stay in their files. A table that is absent is empty.
struct Recording {
  std::string path;  ///< of the folder, or of the MCAP file
  Session session;
  std::vector<FrameRecord> frames;
  std::vector<JointSample> joints;
  std::vector<WrenchSample> wrenches;
  std::vector<MarkerSample> markers;
  std::vector<PhotodiodeSample> photodiodes;
  std::array<StreamReading, log_streams> reading{};  ///< of each LogStream, where it was read
  std::vector<std::string> notes{};                  ///< what readers of results should know of how it was read
  std::vector<std::string> joint_names{};            ///< of the samples' joints, in their order; empty: numbered
};

/// Throws InputError if the log has this stream and it could not be read.
inline void require_readable(const Recording& log, LogStream stream) {
  if (const std::string& fault = log.reading[std::size_t(stream)].fault; !fault.empty()) throw InputError(fault);
}

/// The same for all streams.
inline void require_readable(const Recording& log) {
  for (std::size_t s = 0; s < log_streams; ++s) require_readable(log, LogStream(s));
}

/// Throws InputError if pictures and joint samples, by the session's clocks, have no time in common.
inline void require_common_time(const Recording& log) {
  const auto frames = Stretch::of(log.frames);
  auto joints = Stretch::of(log.joints);
  if (!frames || !joints) return;
  joints = Stretch{log.session.joint_clock(joints->from_ns), log.session.joint_clock(joints->to_ns)};
  if (!joints->meets(*frames))
    throw InputError(message(log.path, ": pictures and joint samples have no time in common: pictures from ",
        to_string(*frames), ", joints from ", to_string(*joints),
        "; if their clocks differ, joint_clock of session.json must say by how much"));
}

/// Throws InputError where pictures or joint samples come faster than cameras and drives give them, more than 10,000 or
/// 100,000 times a second: their stamps are then not in ns.
inline void require_nanoseconds(const Recording& log) {
  const auto require = [&](const char* what, const auto& rows, double shortest_s) {
    if (rows.size() < 2) return;
    const double period_s = stream_period_s(rows);
    if (!(period_s > 0.0) || period_s >= shortest_s) return;
    throw InputError(message(log.path, ": ", what, " come ", std::round(1.0 / period_s),
        " times a second: stamps seem to be in ", period_s >= 1e-3 * shortest_s ? "µs" : "ms", ", must be in ns"));
  };
  require("pictures", log.frames, 1e-4);
  require("joint samples", log.joints, 1e-5);
}

/// Throws InputError if session and tables do not match: currents need a torque constant for each joint.
inline void validate(const Recording& log) {
  if (log.joints.empty() || log.joints.front().unit == Effort::torque_Nm) return;
  const auto joints = std::size_t(log.joints.front().effort.size());
  if (log.session.torque_constant_Nm_per_A.size() != joints)
    throw InputError(message(log.path, ": has currents of ", joints, " joints, its session ",
        log.session.torque_constant_Nm_per_A.size(), " torque constants"));
}

/// The segments of a session as the plan of a recording, in the order of time, each announced `notice_s` before it
/// begins. Times count from the first picture. A plan that begins within the notice, or after `latest_begin_ns` (on
/// another recording's clock), is moved as a whole to begin right after the notice.
class RecordingPlan {
 public:
  static constexpr double notice_s = 2.0;
  static constexpr std::int64_t latest_begin_ns = 60'000'000'000;

  explicit RecordingPlan(std::vector<Segment> segments) : segments_(std::move(segments)) {
    std::stable_sort(
        segments_.begin(), segments_.end(), [](const Segment& a, const Segment& b) { return a.from_ns < b.from_ns; });
    if (segments_.empty()) return;
    constexpr auto notice_ns = std::int64_t(1e9 * notice_s);
    const std::int64_t begin = segments_.front().from_ns,
                       shift = begin >= notice_ns && begin <= latest_begin_ns ? 0 : notice_ns - begin;
    for (Segment& s : segments_) {
      s.from_ns += shift;
      s.to_ns += shift;
    }
  }

  const std::vector<Segment>& segments() const { return segments_; }
  /// When the last one ends [s]; 0 without any.
  double seconds() const {
    std::int64_t end = 0;
    for (const Segment& s : segments_) end = std::max(end, s.to_ns);
    return 1e-9 * double(end);
  }
  /// The next segment to be announced by now, each once; null: none.
  const Segment* announced(double now_s) {
    return next_ < segments_.size() && 1e-9 * double(segments_[next_].from_ns) - notice_s <= now_s ? &segments_[next_++]
                                                                                                   : nullptr;
  }
  /// The segments that a recording which ended at this time holds whole.
  std::vector<Segment> done(std::int64_t end_ns) const {
    std::vector<Segment> list;
    for (const Segment& s : segments_)
      if (s.to_ns <= end_ns) list.push_back(s);
    return list;
  }

 private:
  std::vector<Segment> segments_;
  std::size_t next_ = 0;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/mcap_log.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_LOG_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_LOG_HPP

namespace lumo::sense {

// A log as an MCAP file (docs/log_format.md): one topic for each table, messages of ROS 2 (CDR, schema encoding
// ros2msg), session.json as an attachment. A bag of ROS 2 may have several files, which follow one another.
//
// - Image or CompressedImage: pictures; a frame's stamp is the header's
// - FrameExposure: exposure and gain of the picture of the same stamp
// - CameraInfo: size and calibration
// - JointState: joints; its effort is a torque, or empty if JointCurrents of the same stamp hold currents
// - WrenchStamped, MarkerDisplacement, PhotodiodeSignals

/// Which topics to read; empty: the only one of its kind.
struct McapTopics {
  std::string image{}, joints{}, wrench{};
  /// The finger's joints in the order of the chain, by the names that messages have. Others are not read, several
  /// publishers may share the topic, and of several topics those are read that have these joints. Empty: all messages
  /// name the finger's joints, in this order.
  std::vector<std::string> joint_names{};
  std::optional<SensorAxes> wrench_axes{};  ///< how the force sensor is mounted; empty: as the session says
};

/// A stream that is stamped on another clock than the pictures, and how log times join both.
struct JoinedClock {
  LogStream stream = LogStream::joints;
  ClockMap clock;
  std::string note;  ///< for people
};

/// Where a frame's picture lies.
struct McapPicture {
  McapEntry at;
  bool compressed = false;
  std::size_t file = 0;  ///< number of its file in a bag
};

/// Contents of an MCAP file. A file of other programs has no session: then the default one holds, and its LEDs and
/// delays must be given otherwise.
struct McapLog {
  Recording log;                        ///< with the default session; frames are named by their number
  std::string session_json;             ///< text of the attachment session.json; may be empty
  std::vector<McapPicture> pictures;    ///< of the frames
  std::optional<RosCameraInfo> camera;  ///< the first one, if one topic has them
  std::string contents;                 ///< all topics that have messages, with their types, for people
  std::vector<JoinedClock> clocks;      ///< for a session that says nothing of them; none in a log of lumo's
};

/// The files of a bag, in their order.
template <ChunkCodec... Codecs> using McapFiles = std::vector<std::shared_ptr<McapReader<Codecs...>>>;

/// Ending of the names of image files of this kind: ".png", ".jpg" or ".webp"; empty for any other.
inline std::string_view picture_ending(std::span<const std::uint8_t> file) {
  const auto begins = [&](std::initializer_list<std::uint8_t> magic) {
    return file.size() > magic.size() && std::equal(magic.begin(), magic.end(), file.begin());
  };
  if (begins({0x89, 'P', 'N', 'G'})) return ".png";
  if (begins({0xFF, 0xD8, 0xFF})) return ".jpg";
  const auto header = picture_header(file);
  return header && header->format == PictureHeader::Format::webp ? ".webp" : "";
}

/// Why a CompressedImage is none of those that are read: a video's packet, a depth picture. Empty: it is one, or it is
/// damaged. Its format says so, and its first bytes.
inline std::string packed_fault(const RosCompressedImage& m) {
  const auto says = [&](std::string_view word) { return m.format.find(word) != std::string::npos; };
  const bool depth = says("compressedDepth") || m.format.starts_with("16UC1") || m.format.starts_with("32FC1");
  if (!depth && (m.data.empty() || picture_header(m.data))) return "";
  const bool known = m.format.empty() || says("png") || says("jpeg") || says("jpg") || says("bmp") || says("webp");
  return known && !depth ? ""
                         : message("pictures are of format '", printable(m.format),
                               "', read are PNG, JPEG, BMP and WebP of 8 bits");
}

/// Stamps of one topic's messages, which only all of them tell: programs that do not set a header's stamp leave it 0,
/// and a simulator's clock begins at 0.
class TopicStamps {
 public:
  void add(std::int64_t header_ns, std::uint64_t log_ns) {
    header_.push_back(header_ns);
    log_.push_back(std::int64_t(std::min(log_ns, std::uint64_t(stamp_limit_ns))));
    set_ = set_ || header_ns != 0;
  }
  /// The headers' stamps, or where none is set the log's times. A log of lumo's has its stamps.
  const std::vector<std::int64_t>& ns(bool has_session) const { return set_ || has_session ? header_ : log_; }
  const std::vector<std::int64_t>& log_ns() const { return log_; }
  /// Median of log times less stamps; nullopt without any.
  std::optional<std::int64_t> log_less_stamp_ns(bool has_session) const {
    std::vector<std::int64_t> late;
    for (std::size_t i = 0; i < log_.size(); ++i) late.push_back(log_[i] - ns(has_session)[i]);
    if (late.empty()) return std::nullopt;
    const auto middle = late.begin() + std::ptrdiff_t(late.size() / 2);
    std::nth_element(late.begin(), middle, late.end());
    return *middle;
  }

 private:
  std::vector<std::int64_t> header_, log_;
  bool set_ = false;
};

/// Collects a log's tables from messages. What is wrong with one stream is kept as its fault, and leaves it empty.
class McapTables {
 public:
  /// `joint_names`: as McapTopics has them.
  explicit McapTables(bool has_session, std::vector<std::string> joint_names = {})
      : has_session_(has_session), chosen_(!joint_names.empty()), names_(std::move(joint_names)) {
    known_.resize(names_.size());
  }

  /// A message of the type with the name `type`.
  template <RosMessage... Messages>
  void add_any(std::string_view type, std::span<const std::uint8_t> data, const McapPicture& at) {
    const auto attempt = [&]<RosMessage M>(std::type_identity<M>) {
      if (type == M::type) add(from_cdr<M>(data), at);
    };
    (attempt(std::type_identity<Messages>{}), ...);
  }

  void add(const RosImage& m, const McapPicture& at) {
    require_readable(m);
    add_frame(m.header, {at.at, false, at.file}, ".png");
  }
  void add(const RosCompressedImage& m, const McapPicture& at) {
    if (const std::string fault = packed_fault(m); !fault.empty()) throw InputError(fault);
    const std::string_view ending = picture_ending(m.data);
    add_frame(m.header, {at.at, true, at.file}, ending.empty() ? ".png" : ending);
  }
  void add(const RosCameraInfo& m, const McapPicture&) {
    if (!found.camera) found.camera = m;
  }
  void add(const FrameExposure& m, const McapPicture& at) {
    if (!(m.exposure_s >= 0.0 && m.gain >= 0.0))
      throw InputError(message("exposure is ", m.exposure_s, " s, gain ", m.gain, ", must not be negative"));
    exposure_stamps_.add(m.header.stamp_ns, at.at.log_ns);
    exposures_.emplace_back(finite(m.exposure_s), finite(m.gain));
  }
  void add(const RosJointState& m, const McapPicture& at) {
    const std::size_t n = m.name.size();
    if (chosen_ && !names_any(m)) return;
    if (!chosen_ && (n < 1 || n > std::size_t(max_joints)))
      throw InputError(message("has ", n, " joints, must have 1 to ", max_joints));
    const auto fits = [n](const std::vector<double>& list) { return list.size() == n || list.empty(); };
    if (!fits(m.position) || (!chosen_ && m.position.empty()) || !fits(m.velocity) || !fits(m.effort))
      throw InputError(message("has ", n, " joints, ", m.position.size(), " positions, ", m.velocity.size(),
          " velocities and ", m.effort.size(), " efforts, must have as many"));
    if (names_.empty()) {
      names_ = m.name;
      known_.resize(n);
    }
    if (!chosen_ && !std::is_permutation(m.name.begin(), m.name.end(), names_.begin(), names_.end()))
      throw InputError(message("joints must be chosen by their names: this is of ", joint_list(m.name),
          ", the first of ", joint_list(names_), "; it names other joints than the messages before it"));
    if (!by_name(m)) return;
    const auto joints = Eigen::Index(names_.size());
    JointSample s{0, JointVector(joints), JointVector(joints), JointVector(joints), Effort::torque_Nm};
    for (Eigen::Index j = 0; j < joints; ++j) {
      const JointValues& v = known_[std::size_t(j)];
      s.position_rad[j] = v.position;
      s.velocity_rad_per_s[j] = v.velocity;
      s.effort[j] = v.effort;
    }
    if (!s.velocity_rad_per_s.allFinite()) s.velocity_rad_per_s.resize(0);
    if (!s.effort.allFinite()) {
      s.effort.resize(0);
      order_currents(m.name);
    }
    take(LogStream::joints, m.header, at.at);
    found.log.joints.push_back(std::move(s));
  }
  void add(const JointCurrents& m, const McapPicture& at) {
    if (m.current_A.size() > std::size_t(max_joints))
      throw InputError(message("has ", m.current_A.size(), " currents, must have at most ", max_joints));
    currents_.push_back(joint_vector(m.current_A));
    current_stamps_.add(m.header.stamp_ns, at.at.log_ns);
  }
  void add(const RosWrenchStamped& m, const McapPicture& at) {
    WrenchSample w;
    for (std::size_t k = 0; k < 3; ++k) {
      w.force_N[Eigen::Index(k)] = finite(m.force[k]);
      w.torque_Nm[Eigen::Index(k)] = finite(m.torque[k]);
    }
    take(LogStream::wrenches, m.header, at.at);
    found.log.wrenches.push_back(w);
  }
  void add(const MarkerDisplacement& m, const McapPicture& at) {
    found.log.markers.push_back({0, finite(m.displacement_m)});
    take(LogStream::markers, m.header, at.at);
  }
  void add(const PhotodiodeSignals& m, const McapPicture& at) {
    PhotodiodeSample s{0, Eigen::VectorXd(Eigen::Index(m.signal_V.size()))};
    for (std::size_t k = 0; k < m.signal_V.size(); ++k) s.signal_V[Eigen::Index(k)] = finite(m.signal_V[k]);
    const auto& list = found.log.photodiodes;
    if (s.signal_V.size() == 0 || (!list.empty() && list.front().signal_V.size() != s.signal_V.size()))
      throw InputError("all messages must have as many diodes, at least 1");
    take(LogStream::photodiodes, m.header, at.at);
    found.log.photodiodes.push_back(std::move(s));
  }

  /// `where` and the error become the stream's fault, if it has none yet.
  void fail(LogStream stream, const std::string& where, const std::string& error) {
    std::string& fault = found.log.reading[std::size_t(stream)].fault;
    if (fault.empty()) fault = where + error;
  }
  bool has_failed(LogStream stream) const { return !found.log.reading[std::size_t(stream)].fault.empty(); }

  /// To be called last: gives all rows their stamps, leaves out those whose stamps do not ascend, and joins messages of
  /// one stamp. `topic` of a stream stands in faults of the file `name`.
  void finish(const std::string& name, const std::array<std::string, log_streams>& topic) {
    name_ = &name;
    topic_ = &topic;
    finish(LogStream::frames, found.log.frames);
    finish(LogStream::joints, found.log.joints);
    finish(LogStream::wrenches, found.log.wrenches);
    finish(LogStream::markers, found.log.markers);
    finish(LogStream::photodiodes, found.log.photodiodes);
    if (has_failed(LogStream::frames)) found.pictures.clear();
    join_exposures();
    name_joints();
    try {
      join_efforts();
      find_velocities(found.log.joints);
    } catch (const InputError& error) {
      fail(LogStream::joints, name + ": ", error.what());
      found.log.joints.clear();
    }
    if (!has_session_) join_clocks();
  }

  McapLog found;

 private:
  static double finite(double v) {
    if (!std::isfinite(v)) throw InputError("numbers must be finite");
    return v;
  }
  static JointVector joint_vector(const std::vector<double>& v) {
    JointVector j(static_cast<Eigen::Index>(v.size()));
    for (std::size_t k = 0; k < v.size(); ++k) j[Eigen::Index(k)] = finite(v[k]);
    return j;
  }
  void take(LogStream stream, const RosHeader& h, const McapEntry& at) {
    stamps_[std::size_t(stream)].add(h.stamp_ns, at.log_ns);
  }
  void add_frame(const RosHeader& h, const McapPicture& picture, std::string_view ending) {
    take(LogStream::frames, h, picture.at);
    found.log.frames.push_back({0, frame_file(found.pictures.size(), ending), 0.0, 0.0});
    found.pictures.push_back(picture);
  }

  template <class Row> void finish(LogStream stream, std::vector<Row>& rows) {
    StreamReading& reading = found.log.reading[std::size_t(stream)];
    const TopicStamps& topic = stamps_[std::size_t(stream)];
    const std::vector<std::int64_t>& stamp = topic.ns(has_session_);
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i].stamp_ns = stamp[i];
    AscendingRows ascending = ascending_rows(stamp);
    ascending.reading.fault = reading.fault;
    ascending.reading.incomplete = reading.incomplete;
    ascending.reading.rows += reading.incomplete;
    reading = ascending.reading;
    if (reading.fault.empty() && reading.incomplete > 0 && reading.is_beyond_limit())
      fail(stream, message(*name_, ": topic ", printable((*topic_)[std::size_t(stream)]), ": "),
          message("numbers must be finite: a position or an effort is not in ", reading.incomplete, " of ",
              reading.rows, " messages, at most ", 100.0 * StreamReading::most_left_out, " % are left out"));
    if (reading.fault.empty() && reading.is_beyond_limit()) {
      const std::size_t row = first_backward(stamp);
      fail(stream,
          message(*name_, ": topic ", printable((*topic_)[std::size_t(stream)]), ", log time ", topic.log_ns()[row],
              " ns: "),
          stamps_fault(stamp, reading, row));
    }
    if (!reading.fault.empty()) {
      rows.clear();
      return;
    }
    keep_rows(rows, ascending.kept);
    if constexpr (std::is_same_v<Row, FrameRecord>) keep_rows(found.pictures, ascending.kept);
  }
  /// lumo's own names are numbers.
  void name_joints() {
    if (chosen_ && found.log.joints.empty() && !has_failed(LogStream::joints))
      fail(LogStream::joints, *name_ + ": ", "no messages name all of the joints " + joint_list(names_));
    bool numbers = has_session_;
    for (std::size_t j = 0; j < names_.size(); ++j) numbers = numbers && names_[j] == numbered("joint", int(j));
    if (numbers || found.log.joints.empty()) return;
    if (are_column_names(names_)) found.log.joint_names = names_;
    else
      found.log.notes.push_back("joints are numbered: a table cannot have columns of the names " + joint_list(names_));
  }
  void join_exposures() {
    std::map<std::int64_t, std::pair<double, double>> at;
    for (std::size_t i = 0; i < exposures_.size(); ++i) at[exposure_stamps_.ns(has_session_)[i]] = exposures_[i];
    for (FrameRecord& f : found.log.frames)
      if (const auto e = at.find(f.stamp_ns); e != at.end()) {
        f.exposure_s = e->second.first;
        f.gain = e->second.second;
      }
  }
  void join_efforts() {
    std::map<std::int64_t, JointVector> at;
    for (std::size_t i = 0; i < currents_.size(); ++i) at[current_stamps_.ns(has_session_)[i]] = currents_[i];
    const auto lacks_effort = [](const JointSample& s) { return s.effort.size() != s.position_rad.size(); };
    std::vector<JointSample>& list = found.log.joints;
    if (currents_.empty() && !std::all_of(list.begin(), list.end(), lacks_effort)) {  // positions came before efforts
      StreamReading& reading = found.log.reading[std::size_t(LogStream::joints)];
      reading.incomplete += std::erase_if(list, lacks_effort);
      if (reading.is_beyond_limit())
        throw InputError(message("joints have no effort in ", reading.incomplete, " of ", reading.rows,
            " messages, at most ", 100.0 * StreamReading::most_left_out, " % are left out"));
    }
    for (JointSample& s : list) {
      if (!lacks_effort(s)) continue;
      const auto c = at.find(s.stamp_ns);
      if (c == at.end() || std::size_t(c->second.size()) != named_with_currents_.size())
        throw InputError(message("joints at ", s.stamp_ns, " ns have neither efforts nor currents"));
      s.effort.resize(s.position_rad.size());
      for (Eigen::Index j = 0; j < s.effort.size(); ++j) s.effort[j] = c->second[currents_order_[std::size_t(j)]];
      s.unit = Effort::current_A;
    }
    for (const JointSample& s : found.log.joints)
      if (s.unit != found.log.joints.front().unit)
        throw InputError(message("joints at ", s.stamp_ns, " ns have another kind of effort than the first ones"));
  }

  /// A stream that shares no time with the pictures is stamped on another clock. The log times of all are of one, so
  /// that the difference of how late they are logged is the offset, but for what both take to get there.
  void join_clocks() {
    const auto frames = Stretch::of(found.log.frames);
    const auto late = stamps_[std::size_t(LogStream::frames)].log_less_stamp_ns(has_session_);
    const auto join = [&](LogStream stream, const auto& rows, const char* what) {
      const auto own = Stretch::of(rows);
      const auto own_late = stamps_[std::size_t(stream)].log_less_stamp_ns(has_session_);
      if (!frames || !own || own->meets(*frames) || !late || !own_late) return;
      const std::int64_t offset = *own_late - *late;
      if (!Stretch{own->from_ns + offset, own->to_ns + offset}.meets(*frames)) return;
      const ClockMap clock{0, 1e-9 * double(offset), 0.0, 0.0};
      found.clocks.push_back({stream, clock,
          message(what, " are stamped on another clock than the pictures (", to_string(*own), ", pictures ",
              to_string(*frames), "): moved by ", clock.offset_s,
              " s, as the file's log times have it; what the streams differ in on their way to the recorder is not "
              "known")});
    };
    join(LogStream::joints, found.log.joints, "joint states");
    join(LogStream::wrenches, found.log.wrenches, "wrenches");
  }

  /// The part of a joint state that is about one joint. What is missing or not finite is NaN.
  struct JointValues {
    double position = std::numeric_limits<double>::quiet_NaN(), velocity = position, effort = position;
  };
  bool names_any(const RosJointState& m) const {
    return std::any_of(m.name.begin(), m.name.end(),
        [&](const std::string& n) { return std::find(names_.begin(), names_.end(), n) != names_.end(); });
  }
  /// The joints by their names; what the message does not have of one is as it was last. False if the message has no
  /// position of the first joint, or some joint has not been seen yet. One with numbers that are needed and not finite
  /// is counted, and changes nothing.
  bool by_name(const RosJointState& m) {
    bool first = false;
    std::vector<JointValues> now = known_;
    for (std::size_t j = 0; j < names_.size(); ++j) {
      const auto at = std::find(m.name.begin(), m.name.end(), names_[j]);
      if (at == m.name.end()) continue;
      const auto i = std::size_t(at - m.name.begin());
      JointValues& v = now[j];
      if (!m.position.empty()) v.position = m.position[i];
      if (!m.velocity.empty()) v.velocity = m.velocity[i];  // one that is no number follows from the positions
      if (!m.effort.empty()) v.effort = m.effort[i];
      if ((!m.position.empty() && !std::isfinite(v.position)) || (!m.effort.empty() && !std::isfinite(v.effort))) {
        ++found.log.reading[std::size_t(LogStream::joints)].incomplete;
        return false;
      }
      first = first || (j == 0 && !m.position.empty());
    }
    known_ = std::move(now);
    return first && std::all_of(known_.begin(), known_.end(), [](const auto& k) { return std::isfinite(k.position); });
  }
  /// Currents stand in the order of the names of the joint state that they belong to. Throws InputError for another
  /// order than before.
  void order_currents(const std::vector<std::string>& names) {
    if (names == named_with_currents_) return;
    if (!named_with_currents_.empty() || names.size() > std::size_t(max_joints))
      throw InputError("joints whose currents come in messages of their own must always be named in one order");
    std::vector<int> order;
    for (const std::string& n : names_)
      if (const auto at = std::find(names.begin(), names.end(), n); at != names.end())
        order.push_back(int(at - names.begin()));
    if (order.size() != names_.size()) return;
    named_with_currents_ = names;
    currents_order_ = std::move(order);
  }

  bool has_session_, chosen_;
  std::vector<std::string> names_;
  std::vector<JointValues> known_;
  std::vector<std::string> named_with_currents_;  ///< by the messages whose efforts are currents, in their order
  std::vector<int> currents_order_;               ///< place of each joint in it
  std::array<TopicStamps, log_streams> stamps_;
  TopicStamps exposure_stamps_, current_stamps_;
  std::vector<std::pair<double, double>> exposures_;
  std::vector<JointVector> currents_;
  const std::string* name_ = nullptr;
  const std::array<std::string, log_streams>* topic_ = nullptr;
};

/// The topic of one kind: the wanted one, or the only one; empty: there is none. Throws InputError.
inline std::string choose_topic(
    const std::set<std::string>& topics, const std::string& wanted, const char* what, const std::string& name) {
  const std::string all = listing(topics, [](const std::string& t) { return printable(t); });
  if (!wanted.empty()) {
    if (!topics.contains(wanted))
      throw InputError(message(
          name, ": has no ", what, " on topic '", printable(wanted), "'", all.empty() ? "" : ", but on " + all));
    return wanted;
  }
  if (topics.size() > 1)
    throw InputError(message(name, ": has ", what, " on several topics, one must be chosen: ", all));
  return topics.empty() ? std::string() : *topics.begin();
}

namespace detail {

/// Text of the attachment session.json; empty without one.
template <ChunkCodec... Codecs> std::string attached_session(McapReader<Codecs...>& file) {
  constexpr std::uint32_t most_bytes = 64u << 20;
  std::string json;
  for (const McapAttachment& a : file.attachments())
    if (a.name == "session.json") {
      if (a.size > most_bytes)
        throw InputError(message(file.name(), ": session.json has ", a.size, " bytes, must have at most ", most_bytes));
      const std::vector<std::uint8_t> bytes = file.read(a);
      json.assign(bytes.begin(), bytes.end());
    }
  return json;
}

/// Name of the schema of a channel; empty without one.
template <ChunkCodec... Codecs> std::string_view schema_of(const McapReader<Codecs...>& file, std::uint16_t channel) {
  const auto s = file.schemas().find(file.channels().at(channel).schema);
  return s == file.schemas().end() ? std::string_view() : std::string_view(s->second.name);
}

/// A topic of a bag and the type of its messages.
using TopicType = std::pair<std::string, std::string_view>;

/// Finds the topics whose messages make a log.
template <ChunkCodec... Codecs> class TopicChoice {
 public:
  TopicChoice(const McapFiles<Codecs...>& files, const McapTopics& wanted, McapTables& tables)
      : files_(files), name_(files.front()->name()), tables_(tables) {
    for (std::size_t f = 0; f < files.size(); ++f)
      for (const McapEntry& e : files[f]->messages())
        first_.try_emplace(
            {files[f]->channels().at(e.channel).topic, schema_of(*files[f], e.channel)}, McapPicture{e, false, f});
    choose_pictures(wanted.image);
    choose(LogStream::frames, "exposures", "", {FrameExposure::type});
    choose_joints(wanted);
    choose(LogStream::joints, "currents", "", {JointCurrents::type});
    choose(LogStream::wrenches, "wrenches", wanted.wrench, {RosWrenchStamped::type});
    choose(LogStream::markers, "displacements", "", {MarkerDisplacement::type});
    choose(LogStream::photodiodes, "photodiodes", "", {PhotodiodeSignals::type});
    if (const auto cameras = topics_of({RosCameraInfo::type}); cameras.size() == 1)
      use_[{*cameras.begin(), RosCameraInfo::type}] = std::nullopt;
  }

  /// The stream that is faulty if a message is, none if nothing needs it; null: the message's channel is not read.
  const std::optional<LogStream>* use(const McapReader<Codecs...>& file, std::uint16_t channel) const {
    const auto u = use_.find({file.channels().at(channel).topic, schema_of(file, channel)});
    return u == use_.end() ? nullptr : &u->second;
  }
  /// Of each stream; empty without one.
  const std::array<std::string, log_streams>& topic() const { return topic_; }
  /// "/camera (foxglove.CompressedImage, json), …".
  std::string contents() const {
    constexpr std::size_t most = 12;
    std::string text;
    std::size_t count = 0;
    for (const auto& [topic, at] : first_)
      if (++count <= most)
        text += (text.empty() ? "" : ", ") + printable(topic.first) + " (" + printable(std::string(topic.second)) +
                ", " + printable(files_[at.file]->channels().at(at.at.channel).encoding) + ")";
    return text + (count > most ? message(" and ", count - most, " more") : std::string());
  }

 private:
  std::set<std::string> topics_of(std::initializer_list<std::string_view> types) const {
    std::set<std::string> topics;
    for (const auto& [topic, at] : first_)
      if (std::find(types.begin(), types.end(), topic.second) != types.end()) topics.insert(topic.first);
    return topics;
  }
  void choose(
      LogStream stream, const char* what, const std::string& wanted, std::initializer_list<std::string_view> types) {
    choose_of(topics_of(types), stream, what, wanted, types);
  }
  void choose_of(const std::set<std::string>& topics, LogStream stream, const char* what, const std::string& wanted,
      std::initializer_list<std::string_view> types) {
    try {
      const std::string chosen = choose_topic(topics, wanted, what, name_);
      if (chosen.empty()) return;
      std::string& topic = topic_[std::size_t(stream)];
      if (topic.empty()) topic = chosen;
      for (const std::string_view type : types) use_[{chosen, type}] = stream;
    } catch (const InputError& error) {
      tables_.fail(stream, "", error.what());
    }
  }

  /// Of several topics with joint states those count that have joints of the wanted names, each on one topic.
  void choose_joints(const McapTopics& wanted) {
    const std::set<std::string> topics = topics_of({RosJointState::type});
    if (topics.size() < 2 || !wanted.joints.empty())
      return choose(LogStream::joints, "joint states", wanted.joints, {RosJointState::type});
    const std::map<std::string, std::set<std::string>> names = joint_names_of(topics);
    std::set<std::string> with, twice;
    for (const std::string& joint : wanted.joint_names) {
      std::set<std::string> having;
      for (const std::string& t : topics)
        if (const auto n = names.find(t); n != names.end() && n->second.contains(joint)) having.insert(t);
      if (having.size() > 1) twice.insert(having.begin(), having.end());
      with.insert(having.begin(), having.end());
    }
    if (!with.empty() && twice.empty()) {
      topic_[std::size_t(LogStream::joints)] = listing(with, [](const std::string& t) { return t; });
      for (const std::string& t : with) use_[{t, RosJointState::type}] = LogStream::joints;
      return;
    }
    tables_.fail(LogStream::joints, name_ + ": ",
        "has joint states on several topics, one must be chosen, or joints by their names: " +
            listing(twice.empty() ? topics : twice, [&](const std::string& t) {
              const auto n = names.find(t);
              return printable(t) + " (" +
                     (n == names.end() ? std::string()
                                       : listing(n->second, [](const std::string& j) { return printable(j); })) +
                     ")";
            }));
  }
  /// Names in the first messages of each topic.
  std::map<std::string, std::set<std::string>> joint_names_of(const std::set<std::string>& topics) const {
    constexpr int first = 100;  // publishers that take turns
    constexpr std::size_t most_names = 64;
    std::map<std::string, std::set<std::string>> names;
    std::map<std::string, int> seen;
    for (const auto& file : files_)
      for (const McapEntry& e : file->messages()) {
        const McapChannel& channel = file->channels().at(e.channel);
        if (channel.encoding != "cdr" || schema_of(*file, e.channel) != RosJointState::type ||
            !topics.contains(channel.topic) || ++seen[channel.topic] > first)
          continue;
        try {
          for (const std::string& n : from_cdr<RosJointState>(file->read(e).data).name)
            if (names[channel.topic].size() < most_names) names[channel.topic].insert(n);
        } catch (const InputError&) {  // whoever reads the topic says so
        }
      }
    return names;
  }

  /// Of several topics with pictures those count that can be read: no depth, no video. image_transport sends the same
  /// pictures packed below the name of their topic.
  void choose_pictures(const std::string& wanted) {
    const std::initializer_list<std::string_view> types = {RosImage::type, RosCompressedImage::type};
    std::set<std::string> topics = topics_of(types);
    if (wanted.empty() && topics.size() > 1) {
      std::set<std::string> readable;
      std::string others;
      for (const std::string& t : topics) {
        const std::size_t slash = t.rfind('/');
        const std::string above = slash == std::string::npos ? std::string() : t.substr(0, slash);
        const bool twin = topics.contains(above) && unreadable(above).empty();
        const std::string why = twin ? "the same pictures packed" : unreadable(t);
        if (why.empty()) readable.insert(t);
        else others += (others.empty() ? "" : "; ") + printable(t) + ": " + why;
      }
      if (readable.size() == 1) {
        tables_.found.log.notes.push_back(
            message("pictures of topic ", printable(*readable.begin()), " are read, others are not: ", others));
        topics = readable;
      }
    }
    choose_of(topics, LogStream::frames, "pictures", wanted, types);
  }
  /// Why the first message of a topic cannot be read as a picture; empty: it can.
  std::string unreadable(const std::string& topic) const {
    try {
      if (const auto at = first_.find({topic, RosImage::type}); at != first_.end())
        require_readable(from_cdr<RosImage>(files_[at->second.file]->read(at->second.at).data));
      if (const auto at = first_.find({topic, RosCompressedImage::type}); at != first_.end())
        return packed_fault(from_cdr<RosCompressedImage>(files_[at->second.file]->read(at->second.at).data));
      return "";
    } catch (const InputError& error) {
      return error.what();
    }
  }

  const McapFiles<Codecs...>& files_;
  std::string name_;
  McapTables& tables_;
  std::map<TopicType, McapPicture> first_;  ///< message of each topic
  std::map<TopicType, std::optional<LogStream>> use_;
  std::array<std::string, log_streams> topic_;
};

}  // namespace detail

/// Text of the attachment session.json of a bag's files; empty without one. Throws InputError for one that is too
/// large.
template <ChunkCodec... Codecs> std::string attached_session(const McapFiles<Codecs...>& files) {
  std::string json;
  for (const auto& file : files)
    if (json.empty()) json = detail::attached_session(*file);
  return json;
}

/// Reads the tables of a log, and where its pictures lie; a cut file's up to the cut. `files` are those of one bag, in
/// their order, at least one. A stream that cannot be read is empty, and Recording::reading has the reason: one line
/// with file, topic, time. Throws InputError where the session is too large.
template <ChunkCodec... Codecs>
McapLog read_mcap_log(const McapFiles<Codecs...>& files, const McapTopics& wanted = {}) {
  if (files.empty()) throw InvalidArgument("bag without files");
  if (wanted.joint_names.size() > std::size_t(max_joints))
    throw InvalidArgument(
        message(wanted.joint_names.size(), " joints are chosen by name, must be at most ", max_joints));
  std::string session_json = attached_session(files);
  McapTables tables(!session_json.empty(), wanted.joint_names);
  const detail::TopicChoice<Codecs...> choice(files, wanted, tables);
  for (std::size_t f = 0; f < files.size(); ++f)
    for (const McapEntry& e : files[f]->messages()) {
      const std::optional<LogStream>* const use = choice.use(*files[f], e.channel);
      if (use == nullptr || (*use && tables.has_failed(**use))) continue;
      const McapChannel& channel = files[f]->channels().at(e.channel);
      try {
        if (channel.encoding != "cdr")
          throw InputError(message("messages are of encoding '", printable(channel.encoding), "', read is cdr"));
        const McapMessage m = files[f]->read(e);
        tables.add_any<RosImage, RosCompressedImage, RosCameraInfo, FrameExposure, RosJointState, JointCurrents,
            RosWrenchStamped, MarkerDisplacement, PhotodiodeSignals>(
            detail::schema_of(*files[f], e.channel), m.data, {e, false, f});
      } catch (const InputError& error) {
        if (*use)
          tables.fail(**use,
              message(files[f]->name(), ": topic ", printable(channel.topic), ", log time ", e.log_ns, " ns: "),
              error.what());
      }
    }
  tables.finish(files.front()->name(), choice.topic());
  tables.found.log.path = files.front()->name();
  tables.found.session_json = std::move(session_json);
  tables.found.contents = choice.contents();
  return std::move(tables.found);
}

/// The same of a single file.
template <ChunkCodec... Codecs> McapLog read_mcap_log(McapReader<Codecs...>& file, const McapTopics& wanted = {}) {
  return read_mcap_log(
      McapFiles<Codecs...>{std::shared_ptr<McapReader<Codecs...>>(std::shared_ptr<void>(), &file)}, wanted);
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/mcap_writer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_WRITER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_WRITER_HPP

namespace lumo::sense {

/// Writes an MCAP file in chunks, with checksums of chunks, data and summary. The summary repeats schemas and channels
/// and has statistics and the index of chunks, which other programs rely on. `finish` must be called last: a file
/// without it counts as cut.
template <ChunkCodec Codec = Uncompressed> class McapWriter {
 public:
  /// `out` outlives the writer. A chunk ends with the message that brings it to `chunk_bytes`.
  explicit McapWriter(
      std::ostream& out, std::string_view profile = "ros2", Codec codec = {}, std::size_t chunk_bytes = 1u << 20)
      : out_(out), codec_(std::move(codec)), chunk_bytes_(chunk_bytes) {
    put(mcap_magic);
    McapBytes b;
    b.record(McapOpcode::header, [&] { b.fields(profile, "lumo"); });
    put(b.since(0));
  }

  std::uint16_t add_schema(std::string_view name, std::string_view encoding, std::string_view data) {
    schemas_.push_back(
        {next_number(schemas_.size(), "schemas"), std::string(name), std::string(encoding), std::string(data)});
    record(chunk_, schemas_.back());
    return schemas_.back().id;
  }
  /// `schema`: of add_schema, or 0 for none.
  std::uint16_t add_channel(std::uint16_t schema, std::string_view topic, std::string_view encoding,
      std::map<std::string, std::string> metadata = {}) {
    if (schema > schemas_.size())
      throw InvalidArgument(message("channel is of schema ", schema, ", there are ", schemas_.size()));
    channels_.push_back({next_number(channels_.size(), "channels"), schema, std::string(topic), std::string(encoding),
        std::move(metadata)});
    record(chunk_, channels_.back());
    return channels_.back().id;
  }
  void write(std::uint16_t channel, std::uint64_t log_ns, std::span<const std::uint8_t> data) {
    if (channel == 0 || channel > channels_.size())
      throw InvalidArgument(message("message is of channel ", channel, ", there are ", channels_.size()));
    const std::size_t at = chunk_.record(McapOpcode::message, [&] {
      chunk_.number(channel);
      chunk_.number(std::uint32_t(counts_[channel]++));
      chunk_.number(log_ns);
      chunk_.number(log_ns);  // published when it was logged: nothing else is known
      chunk_.bytes(data);
    });
    index_[channel].emplace_back(log_ns, std::uint64_t(at));
    chunk_times_.add(log_ns);
    if (chunk_.size() >= chunk_bytes_) end_chunk();
  }
  void attach(
      std::string_view name, std::string_view media_type, std::uint64_t log_ns, std::span<const std::uint8_t> data) {
    end_chunk();
    McapBytes b;
    b.record(McapOpcode::attachment, [&] {
      const std::size_t at = b.size();
      b.number(log_ns);
      b.number(std::uint64_t(0));  // when it was made is not known
      b.fields(name, media_type, std::uint64_t(data.size()));
      b.bytes(data);
      b.number(Crc32::of(b.since(at)));
    });
    attachments_.push_back({{std::string(name), std::string(media_type), log_ns, offset_, data.size()}, b.size()});
    put(b.since(0));
  }
  /// Throws InputError if writing failed.
  void finish() {
    end_chunk();
    McapBytes b;
    b.record(McapOpcode::data_end, [&] { b.number(crc_.value()); });
    put(b.since(0));

    const std::uint64_t start = offset_;
    McapBytes summary, offsets;
    const auto group = [&](McapOpcode opcode, const auto& items, auto add) {
      const std::size_t at = summary.size();
      for (const auto& item : items) add(item);
      if (items.empty()) return;
      offsets.record(McapOpcode::summary_offset,
          [&] { offsets.fields(std::uint8_t(opcode), start + at, std::uint64_t(summary.size() - at)); });
    };
    group(McapOpcode::schema, schemas_, [&](const McapSchema& s) { record(summary, s); });
    group(McapOpcode::channel, channels_, [&](const McapChannel& c) { record(summary, c); });
    const int once[] = {0};
    group(McapOpcode::statistics, std::span(once), [&](int) { record_statistics(summary); });
    group(McapOpcode::chunk_index, chunks_, [&](const Chunk& c) { record(summary, c); });
    group(McapOpcode::attachment_index, attachments_, [&](const Attached& a) { record(summary, a); });
    const std::uint64_t offsets_start = start + summary.size();
    summary.bytes(offsets.since(0));
    const std::size_t footer =
        summary.record(McapOpcode::footer, [&] { summary.fields(start, offsets_start, std::uint32_t(0)); });
    const auto checked = summary.since(0).first(footer + 9 + 16);
    const std::uint32_t crc = Crc32::of(checked);
    put(checked);
    McapBytes last;
    last.number(crc);
    last.bytes(mcap_magic);
    put(last.since(0));
    out_.flush();
    if (!out_) throw InputError("MCAP file cannot be written");
  }

 private:
  struct Times {
    std::uint64_t first = std::numeric_limits<std::uint64_t>::max(), last = 0;
    void add(std::uint64_t t) {
      first = std::min(first, t);
      last = std::max(last, t);
    }
    std::uint64_t begin() const { return std::min(first, last); }  ///< 0 without messages
  };
  struct Chunk {
    Times times;
    std::uint64_t offset, length, index_length, packed, unpacked;
    std::map<std::uint16_t, std::uint64_t> index_offsets;
  };
  struct Attached {
    McapAttachment attachment;  ///< `offset`: of its record
    std::uint64_t length;
  };

  static std::uint16_t next_number(std::size_t before, const char* what) {
    if (before >= 65535)
      throw InvalidArgument(message("MCAP file has ", before, " ", what, ", must have at most 65535"));
    return std::uint16_t(before + 1);
  }
  void put(std::span<const std::uint8_t> bytes) {
    out_.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
    crc_.add(bytes);
    offset_ += bytes.size();
  }

  static void record(McapBytes& to, const McapSchema& s) {
    to.record(McapOpcode::schema, [&] { to.fields(s.id, s.name, s.encoding, s.data); });
  }
  static void record(McapBytes& to, const McapChannel& c) {
    to.record(McapOpcode::channel, [&] { to.fields(c.id, c.schema, c.topic, c.encoding, c.metadata); });
  }
  static void record(McapBytes& to, const Chunk& c) {
    to.record(McapOpcode::chunk_index, [&] {
      to.fields(c.times.begin(), c.times.last, c.offset, c.length);
      const std::size_t at = to.begin_length<std::uint32_t>();
      for (const auto& [channel, offset] : c.index_offsets) to.fields(channel, offset);
      to.end_length<std::uint32_t>(at);
      to.fields(c.index_length, Codec::name, c.packed, c.unpacked);
    });
  }
  static void record(McapBytes& to, const Attached& a) {
    to.record(McapOpcode::attachment_index, [&] {
      to.fields(a.attachment.offset, a.length, a.attachment.log_ns, std::uint64_t(0), a.attachment.size,
          a.attachment.name, a.attachment.media_type);
    });
  }
  void record_statistics(McapBytes& to) const {
    Times times;
    for (const Chunk& c : chunks_)
      if (!c.index_offsets.empty()) {
        times.add(c.times.first);
        times.add(c.times.last);
      }
    std::uint64_t messages = 0;
    for (const auto& [channel, count] : counts_) messages += count;
    to.record(McapOpcode::statistics, [&] {
      to.fields(messages, std::uint16_t(schemas_.size()), std::uint32_t(channels_.size()),
          std::uint32_t(attachments_.size()), std::uint32_t(0), std::uint32_t(chunks_.size()), times.begin(),
          times.last);
      const std::size_t at = to.begin_length<std::uint32_t>();
      for (const auto& [channel, count] : counts_) to.fields(channel, count);
      to.end_length<std::uint32_t>(at);
    });
  }

  void end_chunk() {
    if (chunk_.size() == 0) return;
    const auto contents = chunk_.since(0);
    const std::vector<std::uint8_t> packed = codec_.compress(contents);
    Chunk c{chunk_times_, offset_, 0, 0, packed.size(), contents.size(), {}};
    McapBytes b;
    b.record(McapOpcode::chunk, [&] {
      b.fields(c.times.begin(), c.times.last, c.unpacked, Crc32::of(contents), Codec::name, c.packed);
      b.bytes(packed);
    });
    c.length = b.size();
    for (const auto& of_channel : index_) {
      const std::size_t at = b.record(McapOpcode::message_index, [&] {
        b.number(of_channel.first);
        const std::size_t list = b.begin_length<std::uint32_t>();
        for (const auto& [log_ns, place] : of_channel.second) b.fields(log_ns, place);
        b.end_length<std::uint32_t>(list);
      });
      c.index_offsets[of_channel.first] = c.offset + at;
    }
    c.index_length = b.size() - c.length;
    put(b.since(0));
    chunks_.push_back(std::move(c));
    chunk_.clear();
    index_.clear();
    chunk_times_ = {};
  }

  std::ostream& out_;
  Codec codec_;
  std::size_t chunk_bytes_;
  Crc32 crc_;
  std::uint64_t offset_ = 0;
  std::vector<McapSchema> schemas_;
  std::vector<McapChannel> channels_;
  std::map<std::uint16_t, std::uint64_t> counts_;
  McapBytes chunk_;
  Times chunk_times_;
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> index_;
  std::vector<Chunk> chunks_;
  std::vector<Attached> attachments_;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/recording/mcap/mcap_log_writer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_LOG_WRITER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_RECORDING_MCAP_MCAP_LOG_WRITER_HPP

namespace lumo::sense {

/// A picture to be written: the bytes of an image file, or pixels.
struct McapPictureData {
  std::string format;              ///< of the file: "png" or "jpeg"; empty: pixels
  std::vector<std::uint8_t> file;  ///< may be empty: a frame without pixels
  ImageView pixels;                ///< may be empty: the same
  int width = 0, height = 0;       ///< [px]; 0: not known
};

namespace detail {

/// Writes messages, each type to a topic of its own.
template <ChunkCodec Codec> class RosMessageWriter {
 public:
  RosMessageWriter(std::ostream& out, Codec codec) : file(out, "ros2", std::move(codec)) {}

  template <RosMessage M> void write(const char* topic, std::int64_t log_ns, const M& message) {
    auto channel = channels_.find(topic);
    if (channel == channels_.end())
      channel =
          channels_.emplace(topic, file.add_channel(file.add_schema(M::type, "ros2msg", M::definition()), topic, "cdr"))
              .first;
    file.write(channel->second, std::uint64_t(log_ns), to_cdr(message));
  }

  McapWriter<Codec> file;

 private:
  std::map<std::string_view, std::uint16_t> channels_;
};

inline std::vector<double> list_of(const JointVector& v) { return {v.data(), v.data() + v.size()}; }

inline std::array<double, 3> list_of(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }

/// A row of one of a log's tables, and when it is logged.
struct LogRow {
  enum class Table { frames, joints, wrenches, markers, photodiodes };
  std::int64_t log_ns;  ///< on the frames' clock
  Table table;
  std::size_t index;
};

/// The rows of all tables in the order of log times. Throws InvalidArgument for stamps that do not ascend or lie
/// before 0.
inline std::vector<LogRow> rows_in_time(const Recording& log) {
  std::vector<LogRow> rows;
  const auto add = [&](LogRow::Table table, const auto& samples, const ClockMap& clock) {
    std::optional<std::int64_t> last;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      stamp_text(samples[k].stamp_ns, last);
      const std::int64_t at = clock(samples[k].stamp_ns);
      if (at < 0)
        throw InvalidArgument(message("stamp ", samples[k].stamp_ns, " ns is ", at,
            " ns on the frames' clock, in an MCAP file it must not lie before 0"));
      rows.push_back({at, table, k});
    }
  };
  add(LogRow::Table::frames, log.frames, {});
  add(LogRow::Table::joints, log.joints, log.session.joint_clock);
  add(LogRow::Table::wrenches, log.wrenches, log.session.wrench_clock);
  add(LogRow::Table::markers, log.markers, log.session.wrench_clock);
  add(LogRow::Table::photodiodes, log.photodiodes, {});
  std::stable_sort(rows.begin(), rows.end(), [](const LogRow& a, const LogRow& b) { return a.log_ns < b.log_ns; });
  return rows;
}

/// Writes the rows of a log, each as its messages. Throws InvalidArgument for what could not be read again.
template <ChunkCodec Codec> class LogMessages {
 public:
  LogMessages(RosMessageWriter<Codec>& to, const Recording& log) : to_(to), log_(log) {}

  template <class Picture> void frame(const LogRow& row, Picture& picture) {
    const FrameRecord& f = log_.frames[row.index];
    const RosHeader header{f.stamp_ns, "camera"};
    require(std::isfinite(f.exposure_s) && std::isfinite(f.gain) && f.exposure_s >= 0.0 && f.gain >= 0.0,
        "frame log: exposure and gain must be finite and not negative");
    const McapPictureData p = picture(row.index);
    const bool is_file = !p.format.empty();
    require(files_.value_or(is_file) == is_file, "pictures of a log must be all files or all pixels");
    files_ = is_file;
    if (is_file) to_.write("/camera/image/compressed", row.log_ns, RosCompressedImage{header, p.format, p.file});
    else pixels(row.log_ns, header, p.pixels);
    RosCameraInfo info;
    info.header = header;
    info.height = std::uint32_t(p.height);
    info.width = std::uint32_t(p.width);
    to_.write("/camera/camera_info", row.log_ns, info);
    if (f.exposure_s != 0.0 || f.gain != 0.0)
      to_.write("/camera/exposure", row.log_ns, FrameExposure{header, f.exposure_s, f.gain});
  }

  void joint(const LogRow& row) {
    const JointSample& s = log_.joints[row.index];
    const Eigen::Index n = s.position_rad.size();
    require(n > 0 && s.velocity_rad_per_s.size() == n && s.effort.size() == n &&
                log_.joints.front().effort.size() == n && s.unit == log_.joints.front().unit &&
                (log_.joint_names.empty() || log_.joint_names.size() == std::size_t(n)),
        "joint log: samples must have the same number of joints, one for each name, and the same kind of effort");
    require(s.position_rad.allFinite() && s.velocity_rad_per_s.allFinite() && s.effort.allFinite(),
        "a joint sample's numbers must be finite");
    const bool torque = s.unit == Effort::torque_Nm;
    RosJointState m{{s.stamp_ns, ""}, {}, list_of(s.position_rad), list_of(s.velocity_rad_per_s),
        torque ? list_of(s.effort) : std::vector<double>()};
    for (int j = 0; j < int(n); ++j)
      m.name.push_back(log_.joint_names.empty() ? numbered("joint", j) : log_.joint_names[std::size_t(j)]);
    to_.write("/joint_states", row.log_ns, m);
    if (!torque) to_.write("/joint_currents", row.log_ns, JointCurrents{{s.stamp_ns, ""}, list_of(s.effort)});
  }

  void wrench(const LogRow& row) {
    const WrenchSample& w = log_.wrenches[row.index];
    require(w.force_N.allFinite() && w.torque_Nm.allFinite(), "a wrench's numbers must be finite");
    to_.write(
        "/wrench", row.log_ns, RosWrenchStamped{{w.stamp_ns, "finger"}, list_of(w.force_N), list_of(w.torque_Nm)});
  }

  void marker(const LogRow& row) {
    const MarkerSample& m = log_.markers[row.index];
    require(std::isfinite(m.displacement_m), "a marker's displacement must be finite");
    to_.write("/marker", row.log_ns, MarkerDisplacement{{m.stamp_ns, "finger"}, m.displacement_m});
  }

  void photodiode(const LogRow& row) {
    const PhotodiodeSample& s = log_.photodiodes[row.index];
    require(s.signal_V.size() > 0 && s.signal_V.size() == log_.photodiodes.front().signal_V.size() &&
                s.signal_V.allFinite(),
        "photodiode log: samples must have the same number of diodes, and finite signals");
    to_.write("/photodiodes", row.log_ns,
        PhotodiodeSignals{{s.stamp_ns, ""}, {s.signal_V.data(), s.signal_V.data() + s.signal_V.size()}});
  }

 private:
  static void require(bool good, const char* what) {
    if (!good) throw InvalidArgument(what);
  }

  void pixels(std::int64_t log_ns, const RosHeader& header, const ImageView& v) {
    RosImage m{header, 0, 0, v.format == PixelFormat::grey ? "mono8" : "bgr8", 0, 0, {}};
    std::vector<std::uint8_t> bytes;
    if (!v.empty()) {
      m.height = std::uint32_t(v.height);
      m.width = std::uint32_t(v.width);
      m.step = m.width * std::uint32_t(channels(v.format));
      for (int y = 0; y < v.height; ++y) bytes.insert(bytes.end(), v.row(y), v.row(y) + m.step);
    }
    m.data = bytes;
    to_.write("/camera/image", log_ns, m);
  }

  RosMessageWriter<Codec>& to_;
  const Recording& log_;
  std::optional<bool> files_;  ///< whether pictures are files; empty before the first one
};

}  // namespace detail

/// Writes a log as an MCAP file that reads back as the same log, but for the names of pictures. `picture(k)` gives the
/// picture of frame k, in order; all of them are files, or all are pixels. Log times are on the frames' clock, headers'
/// stamps are the samples' own. The session comes first, so that a cut file has it. Throws InvalidArgument for what
/// could not be read again: stamps that do not ascend, that lie before 0 or beyond 2038, numbers that are not finite;
/// InputError if `out` fails.
template <ChunkCodec Codec = Uncompressed, class Picture> void write_mcap_log(
    std::ostream& out, const Recording& log, std::string_view session_json, Picture picture, Codec codec = {}) {
  using Table = detail::LogRow::Table;
  const std::vector<detail::LogRow> rows = detail::rows_in_time(log);
  detail::RosMessageWriter<Codec> to(out, std::move(codec));
  to.file.attach("session.json", "application/json", rows.empty() ? 0 : std::uint64_t(rows.front().log_ns),
      {reinterpret_cast<const std::uint8_t*>(session_json.data()), session_json.size()});
  detail::LogMessages<Codec> messages(to, log);
  for (const detail::LogRow& row : rows) {
    if (row.table == Table::frames) messages.frame(row, picture);
    if (row.table == Table::joints) messages.joint(row);
    if (row.table == Table::wrenches) messages.wrench(row);
    if (row.table == Table::markers) messages.marker(row);
    if (row.table == Table::photodiodes) messages.photodiode(row);
  }
  to.file.finish();
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/common_light.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_COMMON_LIGHT_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_COMMON_LIGHT_HPP

namespace lumo::sense {

/// Divides out what changes all light alike: lamps on alternating current or on pulses, seen by a camera of another
/// rate. The factor of a profile is the mean of the half of its places whose factors lie closest together, which leaves
/// out what a contact brightens. No memory is allocated after the first call.
class SteadyLight {
 public:
  SteadyLight() = default;
  /// `unloaded`: the light that profiles are brought to.
  explicit SteadyLight(Eigen::VectorXd unloaded) : unloaded_(std::move(unloaded)) {}

  bool is_set() const { return unloaded_.size() > 0; }
  const Eigen::VectorXd& unloaded() const { return unloaded_; }
  /// 1 for a profile of another length, or without light.
  double factor(const Eigen::VectorXd& value) {
    constexpr double least = 1e-3;
    if (value.size() != unloaded_.size() || value.size() < 2 || !value.allFinite()) return 1.0;
    ratio_.resize(std::size_t(value.size()));
    for (Eigen::Index i = 0; i < value.size(); ++i) ratio_[std::size_t(i)] = value[i] / std::max(unloaded_[i], 1e-9);
    std::sort(ratio_.begin(), ratio_.end());
    const std::size_t half = ratio_.size() / 2 + 1, from = closest_together(ratio_, half);
    double sum = 0.0;
    for (std::size_t i = from; i < from + half; ++i) sum += ratio_[i];
    return sum > least * double(half) ? sum / double(half) : 1.0;
  }
  void divide(Eigen::VectorXd& value) { value /= factor(value); }

 private:
  Eigen::VectorXd unloaded_;
  std::vector<double> ratio_;
};

/// Limits of what is taken for lamps that flicker; chosen on the virtual lab, whose lamps scatter by 1.7 % from picture
/// to picture.
struct FlickerLimits {
  std::size_t least = 12;     ///< pictures
  double half_range = 0.045;  ///< of the common factor, from its 10 % to its 90 % quantile
  double crossings = 0.125;   ///< of that range's middle, by picture: an exposure that settles crosses once
};

/// Light that rises and falls as a whole from picture to picture.
struct Flicker {
  double half_range = 0.0;  ///< relative; 0: none beyond what lamps do
  double rate_Hz = 0.0;     ///< as the pictures show it: lamps may be much faster
  Eigen::VectorXd middle;   ///< profile
};

/// Of pictures of the unloaded finger in the order of time.
inline Flicker flicker_of(const std::vector<const Profile*>& profiles, const FlickerLimits& limits = {}) {
  Flicker flicker;
  if (profiles.size() < limits.least) return flicker;
  Eigen::MatrixXd value(profiles.front()->value.size(), Eigen::Index(profiles.size()));
  for (std::size_t k = 0; k < profiles.size(); ++k) {
    if (profiles[k]->value.size() != value.rows() || !profiles[k]->value.allFinite()) return flicker;
    value.col(Eigen::Index(k)) = profiles[k]->value;
  }
  flicker.middle = pointwise_median(value);
  SteadyLight steady(flicker.middle);
  std::vector<double> factor;
  for (const Profile* p : profiles) factor.push_back(steady.factor(p->value));
  const double low = quantile(factor, 0.1), high = quantile(factor, 0.9), middle = 0.5 * (low + high),
               range = 0.5 * (high - low);
  int crossings = 0;
  for (std::size_t k = 1; k < factor.size(); ++k) crossings += (factor[k] > middle) != (factor[k - 1] > middle);
  if (range <= limits.half_range || crossings < limits.crossings * double(factor.size())) return flicker;
  flicker.half_range = range;
  const double seconds = 1e-9 * double(profiles.back()->stamp_ns - profiles.front()->stamp_ns);
  flicker.rate_Hz = seconds > 0.0 ? 0.5 * crossings / seconds : 0.0;
  return flicker;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/axis_map.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_AXIS_MAP_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_AXIS_MAP_HPP

namespace lumo::sense {

/// Map from a straight line on the finger (its LEDs) to the image: u pixels from `origin_px` along `direction` lies the
/// finger coordinate y = (a + b s)/(1 + c s), s = u/half_length_px; c is the perspective's. Holds the covariance of
/// (a, b, c) from the fit.
struct AxisMap {
  Eigen::Vector2d origin_px{0.0, 0.0};  ///< pixel centres lie on whole numbers
  Eigen::Vector2d direction{1.0, 0.0};  ///< unit, towards the finger's tip (+y)
  double half_length_px = 1.0;
  Eigen::Vector3d coefficients{0.0, 1.0, 0.0};  ///< a [m], b [m], c
  Eigen::Matrix3d covariance{{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
  double centroid_sigma_px = 0.0;  ///< assumed or found, whichever is larger
  double residual_px = 0.0;        ///< RMS of the fit

  double u_px(const Eigen::Vector2d& pixel) const { return finite((pixel - origin_px).dot(direction)); }
  /// This and all below throw InvalidArgument for NaN and beyond the line's ends, where the map is not finite.
  double y_m(double u) const {
    const double s = u / half_length_px;
    return finite((coefficients[0] + coefficients[1] * s) / (1.0 + coefficients[2] * s));
  }
  /// Inverse of y_m; infinite at the horizon.
  double u_px(double y) const {
    return half_length_px * (finite(y) - coefficients[0]) / (coefficients[1] - coefficients[2] * y);
  }
  /// dy/du [m/px].
  double scale_m_per_px(double u) const {
    const double w = 1.0 + coefficients[2] * u / half_length_px;
    return finite((coefficients[1] - coefficients[0] * coefficients[2]) / (half_length_px * w * w));
  }
  /// Variance of y at u [m²] that comes from the map itself.
  double variance_m2(double u) const {
    const Eigen::Vector3d g = gradient(u);
    return finite(g.dot(covariance * g));
  }
  /// ∂y/∂(a, b, c).
  Eigen::Vector3d gradient(double u) const {
    const double s = u / half_length_px, w = 1.0 + coefficients[2] * s;
    return {1.0 / w, s / w, -s * (coefficients[0] + coefficients[1] * s) / (w * w)};
  }

  /// Fit to places in the image (2 × n, ascending in y) of known finger coordinates, by least squares in pixels. Three
  /// places fix the map, more give a residual. `sigma_px`: assumed standard deviation of a centroid. Throws
  /// InvalidArgument for fewer than three, wrong order or numbers that are not finite.
  static AxisMap fit(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px = 0.3);

 private:
  static double finite(double value) {
    require_finite("place on an axis map", value, "");
    return value;
  }
  static constexpr double max_perspective = 0.5;  ///< of |c|: beyond, the line's end lies near the camera
  static constexpr int most_steps = 20;           ///< of Gauss–Newton
  static constexpr double least_step = 1e-14;     ///< [m]: rounding

  static void require_places(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px);
};

inline void AxisMap::require_places(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px) {
  const Eigen::Index n = y_m.size();
  if (n < 3 || pixel.cols() != n)
    throw InvalidArgument(
        message("axis map has ", pixel.cols(), " places and ", n, " coordinates, must have at least 3 of each"));
  if (!pixel.allFinite() || !y_m.allFinite()) throw InvalidArgument("axis map: places and coordinates must be finite");
  require_positive("centroid error", sigma_px, "px");
  for (Eigen::Index i = 1; i < n; ++i)
    if (!(y_m[i] > y_m[i - 1]))
      throw InvalidArgument(
          message("axis map: coordinate ", i, " is ", y_m[i], " m, must exceed its predecessor, ", y_m[i - 1], " m"));
}

inline AxisMap AxisMap::fit(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px) {
  require_places(pixel, y_m, sigma_px);
  const Eigen::Index n = y_m.size();
  AxisMap map;
  map.origin_px = pixel.rowwise().mean();
  const Eigen::Matrix2Xd centred = pixel.colwise() - map.origin_px;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread;
  spread.computeDirect(centred * centred.transpose());
  map.direction = spread.eigenvectors().col(1);
  if (map.direction.dot(pixel.col(n - 1) - pixel.col(0)) < 0.0) map.direction = -map.direction;
  const Eigen::VectorXd u = centred.transpose() * map.direction;
  for (Eigen::Index i = 1; i < n; ++i)
    if (!(u[i] > u[i - 1]))
      throw InvalidArgument(message("axis map: place ", i, " does not follow its predecessor in the image"));
  map.half_length_px = 0.5 * (u[n - 1] - u[0]);

  // Gauss–Newton on u − u(y) ≈ (y(u) − y)/y'(u); the start is the affine map through the ends.
  const double b = 0.5 * (y_m[n - 1] - y_m[0]);
  map.coefficients = {y_m[0] - b * u[0] / map.half_length_px, b, 0.0};
  Eigen::MatrixX3d J(n, 3);
  Eigen::Matrix3d normal;
  Eigen::VectorXd r(n);
  const auto linearise = [&] {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double slope = map.scale_m_per_px(u[i]);
      r[i] = (map.y_m(u[i]) - y_m[i]) / slope;
      J.row(i) = map.gradient(u[i]).transpose() / slope;
    }
    normal = J.transpose() * J;
  };
  for (int k = 0; k < most_steps; ++k) {
    linearise();
    Eigen::Vector3d step = normal.ldlt().solve(Eigen::Vector3d(J.transpose() * r));
    const double c = std::clamp(map.coefficients[2] - step[2], -max_perspective, max_perspective);
    if (c != map.coefficients[2] - step[2]) {  // a and b then fit best with c at its limit
      step[2] = map.coefficients[2] - c;
      map.coefficients[2] = c;
      linearise();
      step.head<2>() = Eigen::Matrix2d(normal.topLeftCorner<2, 2>()).inverse() * (J.leftCols<2>().transpose() * r);
      map.coefficients.head<2>() -= step.head<2>();
    } else {
      map.coefficients -= step;
    }
    if (step.norm() < least_step) break;
  }
  linearise();
  map.residual_px = std::sqrt(r.squaredNorm() / double(n));
  map.centroid_sigma_px = std::max(sigma_px, n > 3 ? std::sqrt(r.squaredNorm() / double(n - 3)) : 0.0);
  map.covariance = map.centroid_sigma_px * map.centroid_sigma_px * normal.inverse();
  return map;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/strip.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_STRIP_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_STRIP_HPP

namespace lumo::sense {

/// Where along the finger a profile is averaged: bin i lies between edges i and i + 1.
struct LongitudinalBins {
  Eigen::VectorXd edges_m;  ///< ascending

  /// The paper's 11 regions: 5 mm each on [−27.5, 27.5] mm.
  static LongitudinalBins regions() { return uniform(-27.5e-3, 27.5e-3, 11); }
  /// Six equal parts of the same stretch, the decoder's. Source: the authors' public code
  /// (dokkev/fingertip-design-framework, fig5c_decoder.py).
  static LongitudinalBins parts() { return uniform(-27.5e-3, 27.5e-3, 6); }
  static LongitudinalBins uniform(double from_m, double to_m, int count) {
    require_in_range("number of bins", count, 1, 4096, "");
    require_in_range("first edge", from_m, -10.0, 10.0, "m");
    require_in_range("last edge", to_m, -10.0, 10.0, "m");
    LongitudinalBins bins{Eigen::VectorXd::LinSpaced(count + 1, from_m, to_m)};
    validate(bins);
    return bins;
  }

  Eigen::Index size() const { return edges_m.size() - 1; }
  Eigen::VectorXd centres_m() const {
    const Eigen::VectorXd& edges = edges_m;
    return 0.5 * (edges.head(size()) + edges.tail(size()));
  }

  /// Throws InvalidArgument unless there are at least two edges that ascend.
  friend void validate(const LongitudinalBins& b) {
    if (b.edges_m.size() < 2)
      throw InvalidArgument(message("longitudinal bins have ", b.edges_m.size(), " edges, must have at least 2"));
    for (Eigen::Index i = 1; i < b.edges_m.size(); ++i)
      if (!(b.edges_m[i] > b.edges_m[i - 1]))
        throw InvalidArgument(message("edge ", i, " of the longitudinal bins is ", b.edges_m[i],
            " m, must exceed its predecessor, ", b.edges_m[i - 1], " m"));
  }
};

/// The pixels of a band along the finger, laid out once as runs in the image's rows. Lines of equal y cross the axis at
/// right angles, in steps of whole pixels along the image's direction that is nearer to the axis.
class Strip {
 public:
  struct Config {
    AxisMap map;
    LongitudinalBins bins = LongitudinalBins::regions();
    /// The band's limits to the sides of the map's line; positive lies clockwise of the tip's direction in the image
    /// (image y runs down).
    double band_low_m = -8.0_mm, band_high_m = 8.0_mm;
    int width = 640, height = 480;  ///< of the frames [px]
    PixelFormat format = PixelFormat::bgr;
    int row_step = 1;  ///< reads every n-th line along the finger: image rows, or columns for an upright finger
    int lit = 1;       ///< the channel that is measured, as ImageView has it
  };

  /// Throws InvalidArgument for a band outside of the image or numbers out of range.
  explicit Strip(const Config& config);

  bool fits(const ImageView& image) const {
    return !image.empty() && image.width == width_ && image.height == height_ && image.format == format_;
  }

  /// Mean of value(pixels, reference pixels, byte) over each bin. Bytes of all channels are summed, which is faster
  /// than to pick one of three.
  template <class Value>
  void sum(const ImageView& image, Value value, const ImageView* reference, Eigen::VectorXd& mean);

  /// Share of bytes of the measured channel that are 255, on every eighth row read.
  double saturated_share(const ImageView& image) const;

 private:
  struct Run {
    int row, first, count;  ///< pixels
    int place;              ///< first place along the axis; a run along the axis goes on from it, one across it stays
  };

  /// Bytes in a block of `sum_across`: whole pixels in either format.
  static constexpr std::size_t lanes = 48;
  /// Additions of bytes that 16 bits hold, less one.
  static constexpr int narrow_turns = 256;
  static constexpr double most_places = 65536.0;

  class Places;
  void lay_out(const Places& places, const Config& config, std::vector<int>& count);
  template <class Value>
  std::uint32_t sum_across(const std::uint8_t* p, const std::uint8_t* q, std::size_t bytes, Value value) const;
  void mean_of_bins(Eigen::VectorXd& mean);
  void flush();

  int width_, height_, places_ = 0, channels_, channel_;
  PixelFormat format_;
  bool along_;  ///< the axis runs along image rows
  std::vector<Run> runs_;
  std::vector<double> inverse_count_;  ///< 1/pixels at each place
  std::vector<double> edges_;          ///< of the bins, in places
  std::vector<std::uint16_t> narrow_;  ///< bytes of the places; wrap after 257 rows
  std::vector<std::uint32_t> wide_;
  std::vector<double> integral_;  ///< of the mean, from the first place
};

/// Places along the axis. A pixel's place is its column (or row) sheared onto the axis, so that u = (place − origin) ·
/// main; equal places have equal u. Place k covers [k − ½, k + ½).
class Strip::Places {
 public:
  explicit Places(const Config& c)
      : map_(c.map), along_(std::abs(c.map.direction.x()) >= std::abs(c.map.direction.y())), d_(c.map.direction) {
    const double first_m = c.bins.edges_m[0], last_m = c.bins.edges_m[c.bins.size()];
    const double scale = map_.scale_m_per_px(map_.u_px(0.5 * (first_m + last_m)));
    low_px_ = c.band_low_m / scale;
    high_px_ = c.band_high_m / scale;
    for (const double y : {first_m, last_m})
      if (const double u = map_.u_px(y); !(std::isfinite(u) && map_.scale_m_per_px(u) > 0.0 &&
                                           1.0 + map_.coefficients[2] * u / map_.half_length_px > 0.0))
        throw InvalidArgument(message("the axis map has no place in the image for y = ", 1e3 * y, " mm"));
    main_ = along_ ? d_.x() : d_.y();
    shear_ = along_ ? d_.y() / d_.x() : d_.x() / d_.y();
    main_origin_ = along_ ? map_.origin_px.x() : map_.origin_px.y();
    cross_origin_ = along_ ? map_.origin_px.y() : map_.origin_px.x();
    const double from = std::min(of(first_m), of(last_m)), to = std::max(of(first_m), of(last_m));
    if (!(to - from < most_places)) throw InvalidArgument("finger's bins reach far beyond the image");
    base_ = int(std::floor(from + 0.5));
    count_ = int(std::floor(to + 0.5)) - base_ + 1;
  }

  bool along() const { return along_; }
  int base() const { return base_; }
  int count() const { return count_; }
  double of(double y_m) const { return main_origin_ + map_.u_px(y_m) / main_; }
  double y_m(std::size_t place) const { return map_.y_m((double(base_) + double(place) - main_origin_) * main_); }
  /// Place of a pixel, counted from the first one; nullopt outside of the band.
  std::optional<int> at(int x, int y) const {
    const double px = x - map_.origin_px.x(), py = y - map_.origin_px.y();
    const double across = px * -d_.y() + py * d_.x();
    if (across < low_px_ || across >= high_px_) return std::nullopt;
    const double cross = along_ ? y : x;
    const int place = (along_ ? x : y) + int(std::lround((cross - cross_origin_) * shear_)) - base_;
    return place >= 0 && place < count_ ? std::optional(place) : std::nullopt;
  }

 private:
  const AxisMap& map_;
  bool along_;  ///< the axis runs along image rows
  Eigen::Vector2d d_;
  double low_px_, high_px_, main_, shear_, main_origin_, cross_origin_;
  int base_, count_;
};

inline Strip::Strip(const Config& c)
    : width_(c.width),
      height_(c.height),
      channels_(sense::channels(c.format)),
      channel_(c.format == PixelFormat::bgr ? c.lit : 0),
      format_(c.format) {
  require_in_range("frame width", c.width, 1, max_image_side, "px");
  require_in_range("frame height", c.height, 1, max_image_side, "px");
  require_in_range("measured channel", c.lit, 0, 2, "");
  require_in_range("row step", c.row_step, 1, c.height, "");
  require_in_range("band's upper limit", c.band_high_m, c.band_low_m, 10.0, "m");
  validate(c.bins);
  const Places places(c);
  along_ = places.along();
  places_ = places.count();
  std::vector<int> count(std::size_t(places_), 0);
  lay_out(places, c, count);
  for (std::size_t k = 0; k < count.size(); ++k) {
    if (count[k] == 0)
      throw InvalidArgument(
          message("the finger's band leaves the image: no pixel at y = ", 1e3 * places.y_m(k), " mm"));
    inverse_count_.push_back(1.0 / count[k]);
  }
  for (Eigen::Index i = 0; i < c.bins.edges_m.size(); ++i)
    edges_.push_back(places.of(c.bins.edges_m[i]) + 0.5 - places.base());
  for (double& e : edges_) e = std::clamp(e, 0.0, double(places_));
  const std::size_t bytes = std::size_t(places_) * std::size_t(along_ ? channels_ : 1);
  narrow_.resize(bytes);
  wide_.resize(bytes);
  integral_.resize(std::size_t(places_) + 1);
}

/// Runs of the band's pixels; `count` gets the number of pixels at each place. Only lines along the axis are left out,
/// so that every place keeps some pixels.
inline void Strip::lay_out(const Places& places, const Config& c, std::vector<int>& count) {
  for (int y = 0; y < height_; y += along_ ? c.row_step : 1)
    for (int x = 0; x < width_; x += along_ ? 1 : c.row_step) {
      const std::optional<int> place = places.at(x, y);
      if (!place) continue;
      ++count[std::size_t(*place)];
      const bool joins = !runs_.empty() && runs_.back().row == y && runs_.back().first + runs_.back().count == x &&
                         *place == runs_.back().place + (along_ ? runs_.back().count : 0);
      if (joins) ++runs_.back().count;
      else runs_.push_back({y, x, 1, *place});
    }
}

inline void Strip::flush() {
  for (std::size_t i = 0; i < narrow_.size(); ++i) wide_[i] += narrow_[i];
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
}

/// Sum over a run across the axis of the measured channel.
template <class Value> std::uint32_t Strip::sum_across(
    const std::uint8_t* __restrict p, const std::uint8_t* __restrict q, std::size_t bytes, Value value) const {
  std::uint16_t lane[lanes] = {};
  std::uint32_t total = 0;
  const auto collect = [&] {
    for (int k = channel_; k < int(lanes); k += channels_) total += lane[k];
    std::memset(lane, 0, sizeof lane);
  };
  std::size_t i = 0;
  for (int turns = 0; i + lanes <= bytes; i += lanes) {
    for (std::size_t k = 0; k < lanes; ++k) lane[k] = std::uint16_t(lane[k] + value(p + i, q ? q + i : nullptr, k));
    if (++turns == narrow_turns) {
      collect();
      turns = 0;
    }
  }
  collect();
  for (i += std::size_t(channel_); i < bytes; i += std::size_t(channels_)) total += value(p, q, i);
  return total;
}

template <class Value>
void Strip::sum(const ImageView& image, Value value, const ImageView* reference, Eigen::VectorXd& mean) {
  std::fill(wide_.begin(), wide_.end(), 0u);
  std::fill(narrow_.begin(), narrow_.end(), std::uint16_t(0));
  int rows = 0, row = -1;
  for (const Run& run : runs_) {
    const std::uint8_t* __restrict p = image.row(run.row) + std::ptrdiff_t(run.first) * channels_;
    const std::uint8_t* __restrict q =
        reference ? reference->row(run.row) + std::ptrdiff_t(run.first) * channels_ : nullptr;
    const std::size_t bytes = std::size_t(run.count) * std::size_t(channels_);
    if (!along_) {
      wide_[std::size_t(run.place)] += sum_across(p, q, bytes, value);
      continue;
    }
    if (run.row != row) {
      row = run.row;
      if (++rows == narrow_turns) {
        flush();
        rows = 0;
      }
    }
    std::uint16_t* __restrict to = narrow_.data() + std::ptrdiff_t(run.place) * channels_;
    for (std::size_t i = 0; i < bytes; ++i)
      to[i] = std::uint16_t(to[i] + value(p, q, i));  // -O3 makes vectors of it, which is four times as fast
  }
  if (along_) flush();
  mean_of_bins(mean);
}

/// Mean of each bin from the sums at the places, by differences of the integral.
inline void Strip::mean_of_bins(Eigen::VectorXd& mean) {
  const int stride = along_ ? channels_ : 1, offset = along_ ? channel_ : 0;
  for (int k = 0; k < places_; ++k)
    integral_[std::size_t(k) + 1] =
        integral_[std::size_t(k)] + wide_[std::size_t(k * stride + offset)] * inverse_count_[std::size_t(k)];
  const auto up_to = [&](double place) {
    const auto whole = std::min(std::size_t(place), integral_.size() - 2);
    return integral_[whole] + (place - double(whole)) * (integral_[whole + 1] - integral_[whole]);
  };
  mean.resize(Eigen::Index(edges_.size()) - 1);
  for (Eigen::Index i = 0; i < mean.size(); ++i) {
    const double a = edges_[std::size_t(i)], b = edges_[std::size_t(i) + 1];
    mean[i] = (up_to(b) - up_to(a)) / (b - a);
  }
}

inline double Strip::saturated_share(const ImageView& image) const {
  std::size_t full = 0, seen = 0;
  constexpr int every = 8;
  int row = -1, turn = every - 1;
  for (const Run& run : runs_) {
    if (run.row != row) {
      row = run.row;
      turn = (turn + 1) % every;
    }
    if (turn != 0) continue;
    const std::uint8_t* p = image.row(run.row) + std::ptrdiff_t(run.first) * channels_ + channel_;
    unsigned here = 0;
    for (int i = 0; i < run.count; ++i) here += p[std::ptrdiff_t(i) * channels_] == 255;
    full += here;
    seen += std::size_t(run.count);
  }
  return seen ? double(full) / double(seen) : 0.0;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/green_profile.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_GREEN_PROFILE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_GREEN_PROFILE_HPP

namespace lumo::sense {

/// Mean green of a camera's frame over each longitudinal bin of the finger [DN, 0 … 255].
/// Reads only the pixels of the finger's band. Sums are whole numbers, so their order does not matter.
class GreenProfile {
 public:
  using Sample = Frame;

  using Config = Strip::Config;

  /// `steady`: what changes all light alike is divided out, if it is set; then the profile is not linear in the light.
  /// Throws InvalidArgument for a band outside the image or numbers out of range.
  explicit GreenProfile(const Config& config, SteadyLight steady = {})
      : strip_(config), centres_(config.bins.centres_m()), steady_(std::move(steady)) {}

  bool read(const Frame& frame, Profile& profile) {
    if (!strip_.fits(frame.image)) return false;
    profile.stamp_ns = frame.stamp_ns;
    strip_.sum(
        frame.image, [](const std::uint8_t* p, const std::uint8_t*, std::size_t i) { return p[i]; }, nullptr,
        profile.value);
    profile.saturated = strip_.saturated_share(frame.image);
    if (steady_.is_set()) steady_.divide(profile.value);
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return centres_; }

 private:
  Strip strip_;
  Eigen::VectorXd centres_;
  SteadyLight steady_;
};

static_assert(Readout<GreenProfile>);

/// Mean over each bin of green's excess over the unloaded image, pixel by pixel; darker pixels count 0 (paper, force
/// estimation). Not linear near zero: noise leaves a positive mean there, which an unloaded reference of these profiles
/// removes.
class PositiveGreenProfile {
 public:
  using Sample = Frame;

  /// `unloaded` must have the frames' size and format. Throws InvalidArgument as GreenProfile.
  PositiveGreenProfile(const GreenProfile::Config& config, Image unloaded)
      : strip_(config), centres_(config.bins.centres_m()), unloaded_(std::move(unloaded)) {
    if (!strip_.fits(unloaded_.view()))
      throw InvalidArgument("unloaded image has not the size or format of the frames");
  }

  bool read(const Frame& frame, Profile& profile) {
    if (!strip_.fits(frame.image)) return false;
    profile.stamp_ns = frame.stamp_ns;
    const ImageView reference = unloaded_.view();
    strip_.sum(
        frame.image,
        [](const std::uint8_t* p, const std::uint8_t* q, std::size_t i) {
          return std::uint8_t(p[i] > q[i] ? p[i] - q[i] : 0);
        },
        &reference, profile.value);
    profile.saturated = strip_.saturated_share(frame.image);
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return centres_; }

 private:
  Strip strip_;
  Eigen::VectorXd centres_;
  Image unloaded_;
};

static_assert(Readout<PositiveGreenProfile>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/led_detector.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_LED_DETECTOR_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_LED_DETECTOR_HPP

namespace lumo::sense {

/// The finger's lights in an image, from proximal to distal, and the map they give.
struct LedDetection {
  Eigen::Matrix2Xd centroid_px;
  Eigen::VectorXd contrast;  ///< green above the brightest of its surroundings [DN]
  AxisMap map;
};

/// Finds the LEDs of a finger: bright spots in a row, at one pitch, in equal steps but for perspective. Runs once for a
/// camera's place, not on every frame. Of lumo's own, so that sensing needs Eigen only.
struct LedDetector {
  int count = 5;
  double pitch_m = 11.0_mm;
  double first_y_m = -22.0_mm;       ///< of the most proximal one
  Eigen::Vector2d distal{1.0, 0.0};  ///< direction in the image, at most a right angle from that of the tip
  int spot_radius_px = 0;            ///< of a LED's image; 0: the image's larger side over 120, at least 2
  double min_contrast = 8.0;         ///< green above the surroundings [DN]
  double min_share = 0.3;            ///< of the row's brightest spot that its dimmest must have
  double max_residual = 0.06;        ///< RMS distance of the spots from the fitted row, in pitches
  double centroid_sigma_px = 0.3;
  int max_candidates = 24;

  /// nullopt if the image shows no such row. Throws InvalidArgument for numbers out of range.
  std::optional<LedDetection> find(const ImageView& image) const;

 private:
  struct Spot {
    Eigen::Vector2d place;
    double contrast;
  };
  /// A window of this many radii's standard deviation weighs a spot's pixels.
  static constexpr double window = 1.5;
  static constexpr int centroid_passes = 3;  ///< each about the last one's middle: the window must not pull it
  /// A Gaussian window on a Gaussian spot of its width halves the way to its centre: a step goes nearly twice as far.
  static constexpr double centroid_step = 1.8;
  /// Spots lie at least this many radii apart, and no farther than this share of a pitch from their place in the row.
  static constexpr double min_step = 2.5, max_off = 0.3;
  static constexpr double least_step = 0.25;      ///< of a pitch, from a spot to the next along the row
  static constexpr double residual_weight = 0.3;  ///< standard deviation of a row's residual, in max_residual

  std::vector<Spot> spots(const ImageView& image, int radius) const;
  std::optional<LedDetection> row_between(const std::vector<Spot>& all, const Spot& first, const Spot& last) const;
};

namespace detail {

/// Sums of green over rectangles in constant time (Crow 1984).
class IntegralImage {
 public:
  explicit IntegralImage(const ImageView& v)
      : width_(v.width), height_(v.height), sum_(std::size_t(v.width + 1) * std::size_t(v.height + 1)) {
    for (int y = 0; y < v.height; ++y) {
      std::uint32_t row = 0;
      for (int x = 0; x < v.width; ++x) {
        row += v.green(x, y);
        at(x + 1, y + 1) = at(x + 1, y) + row;
      }
    }
  }
  /// Mean over the square of half width r about (x, y), as far as it lies in the image.
  double mean(int x, int y, int r) const {
    const int x0 = std::max(0, x - r), x1 = std::min(width_, x + r + 1), y0 = std::max(0, y - r),
              y1 = std::min(height_, y + r + 1);
    const std::uint32_t s = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);  // wraps round and back
    return double(s) / (double(x1 - x0) * double(y1 - y0));
  }

 private:
  std::uint32_t& at(int x, int y) { return sum_[std::size_t(y) * std::size_t(width_ + 1) + std::size_t(x)]; }
  std::uint32_t at(int x, int y) const { return sum_[std::size_t(y) * std::size_t(width_ + 1) + std::size_t(x)]; }
  int width_, height_;
  std::vector<std::uint32_t> sum_;
};

/// How far green stands above the brightest of eight neighbours, so that edges and streaks are no spots.
class SpotContrast {
 public:
  SpotContrast(const ImageView& image, const IntegralImage& sums, int radius)
      : width_(image.width), height_(image.height), contrast_(std::size_t(width_) * std::size_t(height_)) {
    const int far = 4 * radius;
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        double around = 0.0;
        for (int j = -far; j <= far; j += far)
          for (int i = -far; i <= far; i += far)
            if (i != 0 || j != 0)
              around = std::max(
                  around, sums.mean(std::clamp(x + i, 0, width_ - 1), std::clamp(y + j, 0, height_ - 1), radius));
        contrast_[std::size_t(y) * std::size_t(width_) + std::size_t(x)] = float(sums.mean(x, y, radius) - around);
      }
  }
  float at(int x, int y) const { return contrast_[std::size_t(y) * std::size_t(width_) + std::size_t(x)]; }
  /// Whether it is the largest within `reach` each way; of equals, the first is.
  bool is_top(int x, int y, int reach) const {
    const float c = at(x, y);
    for (int j = -reach; j <= reach; ++j)
      for (int i = -reach; i <= reach; ++i) {
        const int xx = x + i, yy = y + j;
        if (xx < 0 || yy < 0 || xx >= width_ || yy >= height_ || (i == 0 && j == 0)) continue;
        const float other = at(xx, yy);
        if (!(other < c || (other == c && (j > 0 || (j == 0 && i > 0))))) return false;
      }
    return true;
  }

 private:
  int width_, height_;
  std::vector<float> contrast_;
};

}  // namespace detail

inline std::vector<LedDetector::Spot> LedDetector::spots(const ImageView& image, int radius) const {
  const detail::IntegralImage sums(image);
  const int r = radius;
  const detail::SpotContrast contrast(image, sums, r);
  // Centroid of what stands above the surroundings.
  const auto centroid = [&](int x, int y) {
    Eigen::Vector2d centre(x, y);
    const double ground = sums.mean(x, y, 4 * r);
    for (int pass = 0; pass < centroid_passes; ++pass) {
      Eigen::Vector2d moment = Eigen::Vector2d::Zero();
      double weight = 0.0;
      const int cx = int(std::lround(centre.x())), cy = int(std::lround(centre.y()));
      for (int yy = std::max(0, cy - 3 * r); yy <= std::min(image.height - 1, cy + 3 * r); ++yy)
        for (int xx = std::max(0, cx - 3 * r); xx <= std::min(image.width - 1, cx + 3 * r); ++xx) {
          const Eigen::Vector2d p(xx, yy);
          const double near = std::exp(-0.5 * (p - centre).squaredNorm() / (window * r * window * r));
          const double w = near * std::max(0.0, image.green(xx, yy) - ground);
          moment += w * p;
          weight += w;
        }
      if (weight <= 0.0) break;
      centre += centroid_step * (moment / weight - centre);
    }
    return centre;
  };
  std::vector<Spot> found;
  for (int y = r; y < image.height - r; ++y)
    for (int x = r; x < image.width - r; ++x) {
      const float c = contrast.at(x, y);
      if (c < min_contrast || !contrast.is_top(x, y, 2 * r)) continue;
      const Eigen::Vector2d centre = centroid(x, y);
      if ((centre - Eigen::Vector2d(x, y)).norm() < 2.0 * r) found.push_back({centre, c});
    }
  std::stable_sort(found.begin(), found.end(), [](const Spot& a, const Spot& b) { return a.contrast > b.contrast; });
  if (found.size() > std::size_t(max_candidates)) found.resize(std::size_t(max_candidates));
  return found;
}

/// The row with these ends, without its map; nullopt if a spot is missing, out of order or too dim.
inline std::optional<LedDetection> LedDetector::row_between(
    const std::vector<Spot>& all, const Spot& first, const Spot& last) const {
  const Eigen::Vector2d &from = first.place, &to = last.place, step = (to - from) / double(count - 1);
  LedDetection row{Eigen::Matrix2Xd(2, count), Eigen::VectorXd(count), {}};
  for (int k = 0; k < count; ++k) {
    const Eigen::Vector2d expected = from + k * step;
    const auto off = [&](const Spot& s) { return (s.place - expected).squaredNorm(); };
    const auto near =
        std::min_element(all.begin(), all.end(), [&](const Spot& a, const Spot& b) { return off(a) < off(b); });
    if (!((near->place - expected).norm() < max_off * step.norm() &&
            (k == 0 || near->place != Eigen::Vector2d(row.centroid_px.col(k - 1)))))
      return std::nullopt;
    row.centroid_px.col(k) = near->place;
    row.contrast[k] = near->contrast;
  }
  for (int k = 1; k < count; ++k)
    if (!((row.centroid_px.col(k) - row.centroid_px.col(k - 1)).dot(step) > least_step * step.squaredNorm()))
      return std::nullopt;
  if (row.contrast.minCoeff() < min_share * row.contrast.maxCoeff()) return std::nullopt;
  return row;
}

inline std::optional<LedDetection> LedDetector::find(const ImageView& image) const {
  require_in_range("number of LEDs", count, 3, 64, "");
  require_positive("LED pitch", pitch_m, "m");
  require_positive("length of the distal direction", distal.norm(), "");
  if (image.empty()) throw InvalidArgument("LED detection: the image is empty");
  const int radius = spot_radius_px > 0 ? spot_radius_px : std::max(2, std::max(image.width, image.height) / 120);
  const std::vector<Spot> all = spots(image, radius);

  Eigen::VectorXd y(count);
  for (int k = 0; k < count; ++k) y[k] = first_y_m + pitch_m * k;
  std::optional<LedDetection> best;
  double best_score = 0.0;
  for (const Spot& first : all)
    for (const Spot& last : all) {
      const Eigen::Vector2d step = (last.place - first.place) / double(count - 1);
      if (step.dot(distal) <= 0.0 || step.norm() < min_step * radius) continue;
      std::optional<LedDetection> row = row_between(all, first, last);
      if (!row) continue;
      row->map = AxisMap::fit(row->centroid_px, y, centroid_sigma_px);
      const AxisMap& map = row->map;
      const Eigen::Vector2d across(-map.direction.y(), map.direction.x());
      const double off = ((row->centroid_px.colwise() - map.origin_px).transpose() * across).squaredNorm() / count;
      const double residual = std::sqrt(map.residual_px * map.residual_px + off) / step.norm();
      if (residual > max_residual) continue;
      const double far = residual / (residual_weight * max_residual);
      const double score = row->contrast.minCoeff() * std::exp(-0.5 * std::pow(far, 2));
      if (score > best_score) {
        best_score = score;
        best = row;
      }
    }
  return best;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/unloaded_reference.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_UNLOADED_REFERENCE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_UNLOADED_REFERENCE_HPP

namespace lumo::sense {

/// Mean profile of the unloaded finger and the scatter of single profiles about it. Responses are measured against it.
class UnloadedReference {
 public:
  /// Adds a profile of the unloaded finger (Welford's running moments). Throws InvalidArgument for another length or
  /// values that are not finite.
  void add(const Profile& p) {
    if (count_ == 0) mean_ = squares_ = Eigen::VectorXd::Zero(p.value.size());
    if (p.value.size() != mean_.size())
      throw InvalidArgument(message("unloaded profile has ", p.value.size(), " values, the reference ", mean_.size()));
    if (!p.value.allFinite()) throw InvalidArgument("unloaded profile: values must be finite");
    ++count_;
    const Eigen::VectorXd before = p.value - mean_;
    mean_ += before / double(count_);
    squares_ += before.cwiseProduct(p.value - mean_);
  }

  int count() const { return count_; }
  const Eigen::VectorXd& mean() const { return mean_; }
  /// Standard deviation of one response at each position, the mean's own error included. It is at least `floor`: an
  /// 8-bit camera that repeats a number is not free of noise, and at least set_least_noise's. Throws InvalidArgument
  /// for a floor that is not positive.
  Eigen::VectorXd noise(double floor = 0.02) const {
    require_in_range("least noise of a profile", floor, 0.0, std::numeric_limits<double>::max(), "");
    floor = std::max(floor, least_noise_);
    if (count_ < 2) return Eigen::VectorXd::Constant(mean_.size(), floor);
    const double n = count_;
    const Eigen::VectorXd& squares = squares_;
    return (squares / (n - 1.0) * (1.0 + 1.0 / n)).cwiseSqrt().cwiseMax(floor);
  }
  /// What noise is at least, whatever the scatter [the profile's unit]: a codec's steps. Throws InvalidArgument.
  void set_least_noise(double least) {
    require_in_range("least noise of a reference", least, 0.0, std::numeric_limits<double>::max(), "");
    least_noise_ = least;
  }
  /// Profile minus the mean. Lengths must agree (unchecked).
  void subtract(std::type_identity_t<Profile>& p) const { p.value -= mean_; }

 private:
  int count_ = 0;
  double least_noise_ = 0.0;
  Eigen::VectorXd mean_, squares_;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/unloaded_check.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_UNLOADED_CHECK_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_UNLOADED_CHECK_HPP

namespace lumo::sense {

/// How much of a picture is the last one again. A camera's noise changes most pixels from picture to picture; a video
/// codec, or a camera that averages, repeats them.
class RepeatedPixels {
 public:
  /// Pictures of one size and format; one that differs begins anew.
  void add(const ImageView& v) {
    if (v.empty()) return;
    const bool follows = v.width == last_.width && v.height == last_.height && v.format == last_.format;
    std::size_t lit = 0, same = 0;
    if (follows) {
      const ImageView before = last_.view();
      const int bytes = v.width * channels(v.format);
      for (int y = 0; y < v.height; ++y)
        for (int i = 0; i < bytes; ++i) {
          const int value = v.row(y)[i];
          if (value < least_DN || value > most_DN) continue;
          ++lit;
          same += value == before.row(y)[i];
        }
      const bool again = lit >= least_pixels && same == lit;
      run_ = again ? run_ + 1 : 0;
      longest_ = std::max(longest_, run_);
      if (lit >= least_pixels && !again) share_.push_back(double(same) / double(lit));
    }
    last_ = Image::copy(v);
  }
  /// Share of the lit pixels (of each channel) that keep their very value, in the tenth of all pictures that repeat
  /// most and are not wholly the last one again: a codec renews some pictures, a camera all. 1 where pictures come
  /// again more often in a row than a driver hands them on. 0 where nothing is known.
  double share() const { return longest_ >= longest_run ? 1.0 : share_.empty() ? 0.0 : quantile(share_, 0.9); }

 private:
  static constexpr int least_DN = 20, most_DN = 250;  ///< black and full pixels repeat by themselves
  static constexpr std::size_t least_pixels = 100;
  static constexpr int longest_run = 4;
  Image last_;
  int run_ = 0, longest_ = 0;  ///< pictures that are wholly the last one again, one after the other
  std::vector<double> share_;
};

/// How pictures repeat themselves.
struct Repeats {
  double unchanged = 0.0;   ///< share of lit pixels that keep their value (RepeatedPixels)
  double block_bins = 1.0;  ///< bins that one block of a codec covers, whose errors are then one
};

/// Limits of what is believed of pictures that are said to show the unloaded finger; chosen on the virtual lab.
struct UnloadedLimits {
  std::size_t least = 8;          ///< pictures, below which none is left out
  double light_sigmas = 9.0;      ///< from the others' light, in their scatter, beyond which a picture disagrees …
  double light_share = 0.04;      ///< … if it is also this share of the light off
  double left_sigmas = 5.0;       ///< the same once some were left out: what is like them goes, too
  double shape_sigmas = 10.0;     ///< the same of one place against the others …
  double shape_DN = 2.0;          ///< … if it is also this much
  double repeated_share = 0.6;    ///< of unchanged pixels, above which scatter says little of the next second's
  double fresh_share = 0.34;      ///< of pictures that are not the last one again, below which the same holds
  double repeated_DN = 1.5;       ///< least noise of a profile's value then: a codec's steps
  double repeated_scatter = 1.5;  ///< … and of the largest deviation, what is more than that, times √block_bins
  double largest_scatter = 0.04;  ///< of one response, share of the light, that a finger at rest has
  double band_together = 1.6;  ///< scatter of an eighth of the finger over that of places that vary by themselves …
  double band_DN = 0.3;        ///< … and scatter of one place, above which light moves along the finger in bands
};

/// The reference of a stretch, and what was found in it.
struct CheckedReference {
  UnloadedReference reference;
  int pictures = 0;          ///< of the stretch
  int left_out = 0;          ///< that disagree with the rest of it
  int repeated = 0;          ///< that are the one before again; they count once
  bool repeats = false;      ///< pixels repeat from picture to picture, and noise has a floor
  double least_noise = 0.0;  ///< that floor [DN]; 0: none
  double scatter = 0.0;      ///< of one response, share of the light (median over the finger)
  bool scatters = false;     ///< more than a finger at rest does
  double together = 0.0;     ///< part of that scatter that all places have together, share of the light
  double bands = 0.0;        ///< scatter by light that moves along the finger in bands, share of the light; 0: none
  double saturated = 0.0;    ///< share of full pixels, mean over the pictures
};

namespace detail {

/// Middle and scatter of the half of all numbers that lie closest together (the shorth: Andrews et al. 1972), in
/// standard deviations of a normal.
inline std::pair<double, double> closest_half(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  const std::size_t h = v.size() / 2 + 1;
  const std::size_t best = closest_together(v, h);
  double sum = 0.0;
  for (std::size_t i = best; i < best + h; ++i) sum += v[i];
  return {sum / double(h), 0.5 * (v[best + h - 1] - v[best]) / half_of_normal};
}

/// Deviations from the pointwise median profile, each profile scaled to its light: profiles × places.
inline Eigen::MatrixXd shape_deviations(const std::vector<const Profile*>& profiles) {
  const auto n = Eigen::Index(profiles.size()), places = profiles.front()->value.size();
  Eigen::MatrixXd value(places, n);
  for (Eigen::Index k = 0; k < n; ++k) value.col(k) = profiles[std::size_t(k)]->value;
  const Eigen::VectorXd middle = pointwise_median(value);
  const double light = std::max(middle.mean(), 1e-9);
  for (Eigen::Index k = 0; k < n; ++k) value.col(k) -= value.col(k).mean() / light * middle;
  return value;
}

/// Scatter of means over neighbouring places, an eighth of all, over that of as many that vary by themselves.
inline double scatter_together(const Eigen::MatrixXd& deviation) {
  const Eigen::Index width = std::max<Eigen::Index>(2, deviation.rows() / 8), windows = deviation.rows() - width + 1;
  const double single = deviation.squaredNorm() / double(deviation.size());
  if (windows < 1 || !(single > 0.0)) return 1.0;
  double sum = 0.0;
  for (Eigen::Index first = 0; first < windows; ++first)
    sum += deviation.middleRows(first, width).colwise().mean().squaredNorm();
  return std::sqrt(double(width) * sum / double(windows * deviation.cols()) / single);
}

/// Those whose light is that of the closest half. Where some are far off, that half may hold some of them: what is left
/// is then judged again by its own scatter, until it stays.
inline std::vector<const Profile*> of_one_light(
    const std::vector<const Profile*>& profiles, const UnloadedLimits& limits) {
  std::vector<double> light;
  for (const Profile* p : profiles) light.push_back(p->value.mean());
  const std::pair<double, double> half = closest_half(light);  // clang 14 captures no structured bindings
  double middle = half.first;
  const auto within = [&](const std::vector<const Profile*>& from, double off) {
    std::vector<const Profile*> kept;
    for (const Profile* p : from)
      if (std::abs(p->value.mean() - middle) <= std::max(off, limits.light_share * std::abs(middle))) kept.push_back(p);
    return kept;
  };
  std::vector<const Profile*> kept = within(profiles, limits.light_sigmas * half.second);
  for (std::size_t before = profiles.size(); kept.size() < before && kept.size() >= limits.least;) {
    before = kept.size();
    light.clear();
    for (const Profile* p : kept) light.push_back(p->value.mean());
    middle = median(light);
    for (double& l : light) l = std::abs(l - middle);
    kept = within(kept, limits.left_sigmas * median(light) / half_of_normal);
  }
  return kept;
}

}  // namespace detail

/// The profiles that agree with each other: neither all their light nor that of one place is far off. `left_out` counts
/// the others.
inline std::vector<const Profile*> agreeing(
    std::vector<const Profile*> profiles, int& left_out, const UnloadedLimits& limits = {}) {
  if (profiles.size() < limits.least) return profiles;
  const std::vector<const Profile*> alike = detail::of_one_light(profiles, limits);
  const Eigen::MatrixXd deviation = detail::shape_deviations(alike).cwiseAbs();
  const double typical = median({deviation.data(), deviation.data() + deviation.size()}) / half_of_normal,
               far = std::max(limits.shape_sigmas * typical, limits.shape_DN);
  std::vector<const Profile*> kept;
  for (std::size_t k = 0; k < alike.size(); ++k)
    if (deviation.col(Eigen::Index(k)).maxCoeff() <= far) kept.push_back(alike[k]);
  if (kept.empty()) kept = alike;
  left_out += int(profiles.size() - kept.size());
  return kept;
}

/// The reference from profiles that are said to be of the unloaded finger, in the order of time. Without profiles its
/// count is 0. Throws InvalidArgument as UnloadedReference::add.
inline CheckedReference checked_reference(
    const std::vector<const Profile*>& stretch, const Repeats& repeats = {}, const UnloadedLimits& limits = {}) {
  CheckedReference r;
  r.pictures = int(stretch.size());
  std::vector<const Profile*> fresh;
  for (const Profile* p : stretch)
    if (fresh.empty() || p->value.size() != fresh.back()->value.size() || p->value != fresh.back()->value)
      fresh.push_back(p);
  r.repeated = r.pictures - int(fresh.size());
  for (const Profile* p : fresh) {  // of one length and finite, or refused
    UnloadedReference one;
    one.add(*fresh.front());
    one.add(*p);
  }
  if (fresh.empty()) return r;
  const std::vector<const Profile*> kept = agreeing(fresh, r.left_out, limits);
  for (const Profile* p : kept) r.reference.add(*p);
  r.repeats =
      repeats.unchanged > limits.repeated_share || double(fresh.size()) < limits.fresh_share * double(r.pictures);
  if (r.repeats) {
    const double step = limits.repeated_DN,
                 seen = limits.repeated_scatter * detail::shape_deviations(fresh).cwiseAbs().maxCoeff();
    r.least_noise = step + std::sqrt(repeats.block_bins) * std::max(0.0, seen - step);
  }
  if (kept.size() >= limits.least) {
    const Eigen::MatrixXd deviation = detail::shape_deviations(kept);
    const double together = detail::scatter_together(deviation),
                 single = deviation.norm() / std::sqrt(double(deviation.size()));
    if (together > limits.band_together && single > limits.band_DN) {
      r.bands = single / std::max(r.reference.mean().mean(), 1e-9);
      r.least_noise = std::max(r.least_noise, limits.repeated_scatter * together * single);
    }
  }
  r.reference.set_least_noise(r.least_noise);
  const Eigen::VectorXd noise = r.reference.noise(), share = noise.cwiseQuotient(r.reference.mean().cwiseMax(1e-9));
  r.scatter = median({share.data(), share.data() + share.size()});
  std::vector<double> light;
  for (const Profile* p : kept) {
    light.push_back(p->value.mean());
    r.saturated += p->saturated / double(kept.size());
  }
  r.together = rms(Eigen::Map<const Eigen::VectorXd>(light.data(), Eigen::Index(light.size())).array() -
                   r.reference.mean().mean()) /
               std::max(r.reference.mean().mean(), 1e-9);
  r.scatters = !r.repeats && r.scatter > limits.largest_scatter;
  return r;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/finger_view.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_FINGER_VIEW_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_FINGER_VIEW_HPP

namespace lumo::sense {

/// The stretch of a log with the finger unloaded: the first segment of kind `unloaded`, or else the first half second.
struct UnloadedStretch : Stretch {
  static constexpr std::int64_t first_ns = 500'000'000;
  bool chosen = false;  ///< by whoever knows the log: of what came before nothing is assumed

  static UnloadedStretch of(const Session& s, std::int64_t first_frame_ns) {
    const auto known = std::find_if(
        s.segments.begin(), s.segments.end(), [](const Segment& g) { return g.kind == SegmentKind::unloaded; });
    return known == s.segments.end() ? UnloadedStretch{{first_frame_ns, first_frame_ns + first_ns}}
                                     : UnloadedStretch{{known->from_ns, known->to_ns}};
  }
};

/// Mean of pictures of one size and format; pictures that differ from the first are left out.
class MeanImage {
 public:
  void add(const ImageView& v) {
    if (v.empty()) return;
    const std::size_t bytes = std::size_t(v.width) * std::size_t(channels(v.format));
    if (count_ == 0) {
      mean_ = Image::black(v.width, v.height, v.format);
      sum_.assign(bytes * std::size_t(v.height), 0);
    }
    if (v.width != mean_.width || v.height != mean_.height || v.format != mean_.format || count_ >= 1 << 16) return;
    ++count_;
    for (int y = 0; y < v.height; ++y)
      for (std::size_t x = 0; x < bytes; ++x) sum_[std::size_t(y) * bytes + x] += v.row(y)[x];
  }
  int count() const { return count_; }
  /// Rounded. Empty when nothing was added.
  Image image() const {
    Image m = mean_;
    for (std::size_t i = 0; i < sum_.size(); ++i)
      m.pixels[i] = std::uint8_t((sum_[i] + std::uint32_t(count_) / 2) / std::uint32_t(count_));
    return m;
  }

 private:
  Image mean_;
  std::vector<std::uint32_t> sum_;
  int count_ = 0;
};

/// A finger's place in a camera's pictures: the map along it from its LEDs, and the lit band to both sides.
struct FingerView {
  LedDetection leds;
  double band_low_m = 0.0, band_high_m = 0.0;  ///< as GreenProfile::Config
  int width = 0, height = 0;
  PixelFormat format = PixelFormat::bgr;
  int lit = 1;             ///< the channel in which the LEDs are seen, as ImageView has it
  double unchanged = 0.0;  ///< share of lit pixels that a picture repeats of the last one (RepeatedPixels); 0: unknown

  /// As profiles of these bins have it.
  Repeats repeats(const LongitudinalBins& bins) const {
    constexpr double block_px = 16.0;  // a macroblock of MPEG-2 to H.264; later codecs have larger ones too
    const double bin_m = (bins.edges_m[bins.size()] - bins.edges_m[0]) / double(bins.size());
    return {unchanged, std::max(1.0, block_px * leds.map.scale_m_per_px(leds.map.u_px(0.0)) / bin_m)};
  }

  SteadyLight steady{};  ///< set where lamps flicker; of the bins that profiles were read in

  GreenProfile readout(const LongitudinalBins& bins) const {
    return GreenProfile({leds.map, bins, band_low_m, band_high_m, width, height, format, 1, lit}, steady);
  }
};

/// The stretch across the finger, about its row of LEDs, that has at least half of the row's light above the darkest
/// surroundings. Across: positive clockwise of the tip's direction in the image, in m at the map's scale.
inline std::pair<double, double> lit_band(
    const ImageView& unloaded, const AxisMap& map, double half_range_m = 22.0e-3) {
  constexpr double half = 0.5;    // of the row's light; and of a line's pixels, that it counts
  constexpr int row_half_px = 8;  // what counts as beside the row
  const double scale = map.scale_m_per_px(map.u_px(0.0));
  const int reach = std::max(unloaded.width, unloaded.height);
  std::vector<double> sum(std::size_t(2 * reach + 1), 0.0), count = sum;
  for (int y = 0; y < unloaded.height; ++y)
    for (int x = 0; x < unloaded.width; ++x) {
      const Eigen::Vector2d p = Eigen::Vector2d(x, y) - map.origin_px;
      if (std::abs(map.y_m(p.dot(map.direction))) > half_range_m) continue;
      const long across = std::lround(-p.x() * map.direction.y() + p.y() * map.direction.x());
      if (std::abs(across) > reach) continue;
      sum[std::size_t(across + reach)] += unloaded.green(x, y);
      count[std::size_t(across + reach)] += 1.0;
    }
  const double most = *std::max_element(count.begin(), count.end());
  double dark = 255.0;
  for (std::size_t i = 0; i < sum.size(); ++i)
    if (count[i] > half * most) dark = std::min(dark, sum[i] / count[i]);
  // The row itself shines; the light beside it counts.
  std::vector<double> near;
  for (int k = -row_half_px; k <= row_half_px; ++k)
    if (const auto i = std::size_t(k + reach); count[i] > half * most) near.push_back(sum[i] / count[i]);
  const double limit = dark + half * (median(near) - dark);
  const auto lit = [&](int k) {
    return count[std::size_t(k + reach)] > half * most &&
           sum[std::size_t(k + reach)] / count[std::size_t(k + reach)] >= limit;
  };
  int low = 0, high = 0;
  while (low > -reach && lit(low - 1)) --low;
  while (high < reach && lit(high + 1)) ++high;
  return {scale * (low - 0.5), scale * (high + 0.5)};
}

/// Throws InputError where the row of LEDs lies at nearly a right angle to the tip's direction as the session has it,
/// so that a slight turn of the camera would decide which end is the tip.
inline void require_tip_known(const AxisMap& map, const Session& session, const std::string& name) {
  constexpr double farthest_deg = 70.0, deg_per_rad = 57.29577951308232;
  const Eigen::Vector2d& d = map.direction;
  const double cosine = d.dot(session.distal.normalized()),
               turned_deg = deg_per_rad * std::acos(std::clamp(cosine, -1.0, 1.0));
  if (turned_deg <= farthest_deg) return;
  const bool upright = std::abs(d.y()) > std::abs(d.x());
  throw InputError(message(name, ": the row of LEDs lies at ", std::lround(turned_deg), "° to the tip's direction, [",
      session.distal.x(), ", ", session.distal.y(),
      "], which does not say which end is the tip; state leds.distal in the "
      "session: ",
      upright ? "[0, 1] if the tip is below, [0, -1] if it is above"
              : "[1, 0] if the tip is on the right, [-1, 0] if it is on the left"));
}

/// What may be wrong with the exposure of a picture without LEDs; empty: nothing.
inline std::string exposure_hint(const ImageView& v) {
  constexpr int dark_DN = 60;          // of the brightest value
  constexpr double full_share = 0.02;  // of values at 255
  int most = 0;
  double full = 0.0;
  const int bytes = v.empty() ? 0 : v.width * channels(v.format);
  for (int y = 0; y < v.height && bytes > 0; ++y)
    for (int i = 0; i < bytes; ++i) {
      most = std::max<int>(most, v.row(y)[i]);
      full += v.row(y)[i] == 255 ? 1.0 / (double(bytes) * v.height) : 0.0;
    }
  if (bytes > 0 && most < dark_DN)
    return message("; the brightest value is ", most, " of 255: the pictures are under-exposed");
  if (full > full_share)
    return message("; ", std::lround(100.0 * full), " % of the values are 255: the pictures are over-exposed");
  return "";
}

/// The LEDs, and the channel that they are seen in: green, unless another shows them alone or far brighter.
struct LitChannel {
  int lit = 1;
  LedDetection leds;
};

/// nullopt where no channel shows the row.
inline std::optional<LitChannel> find_leds(ImageView unloaded, const LedDetector& detector) {
  constexpr double far_brighter = 2.5;  // contrast over green's, beyond which green sees the others' leak
  std::optional<LitChannel> best;
  double most = 0.0;
  for (const int channel : {1, 0, 2}) {
    if (channel != 1 && unloaded.format == PixelFormat::grey) continue;
    unloaded.lit = channel;
    const auto leds = detector.find(unloaded);
    if (!leds) continue;
    if (const double contrast = leds->contrast.minCoeff(); !best || contrast > most) {
      best = LitChannel{channel, *leds};
      most = contrast * (channel == 1 ? far_brighter : 1.0);
    }
  }
  return best;
}

/// From a picture of the unloaded finger. Throws InputError, with `name` before the message, if it shows no LEDs, or
/// the session does not say which end of their row is the tip.
inline FingerView view_finger(ImageView unloaded, const Session& session, const std::string& name) {
  std::optional<LitChannel> seen;
  const double parallax = led_parallax(session);
  if (!unloaded.empty())
    seen = find_leds(unloaded, LedDetector{session.led_count, parallax * session.led_pitch_m,
                                   parallax * session.led_first_y_m, session.distal});
  if (!seen)
    throw InputError(message(name, ": no row of ", session.led_count,
        " LEDs is seen in the pictures of the unloaded finger", exposure_hint(unloaded)));
  require_tip_known(seen->leds.map, session, name);
  unloaded.lit = seen->lit;
  const auto [low, high] = lit_band(unloaded, seen->leds.map);
  return {seen->leds, low, high, unloaded.width, unloaded.height, unloaded.format, seen->lit};
}

/// Mean picture of the unloaded stretch, and the finger in it. Throws InputError.
template <Camera C>
FingerView view_finger(C& camera, const Session& session, const UnloadedStretch& stretch, const std::string& name) {
  MeanImage mean;
  RepeatedPixels repeated;
  for (auto f = camera.next(); f && f->stamp_ns <= stretch.to_ns; f = camera.next())
    if (stretch.holds(f->stamp_ns)) {
      mean.add(f->image);
      repeated.add(f->image);
    }
  if (mean.count() == 0) throw InputError(message(name, ": has no picture of the unloaded finger"));
  FingerView view = view_finger(mean.image().view(), session, name);
  view.unchanged = repeated.share();
  return view;
}

/// Profiles of all frames that the readout can read.
template <Camera C> std::vector<Profile> read_profiles(C& camera, GreenProfile& readout) {
  std::vector<Profile> list;
  Profile p;
  for (auto f = camera.next(); f; f = camera.next())
    if (readout.read(*f, p)) list.push_back(p);
  return list;
}

/// Where lamps flicker in the unloaded stretch that is divided out of all profiles, and from now on of what the view
/// reads. The range of the result is 0 where they do not.
inline Flicker take_out_flicker(FingerView& view, std::vector<Profile>& profiles, const UnloadedStretch& stretch) {
  std::vector<const Profile*> held;
  for (const Profile& p : profiles)
    if (stretch.holds(p.stamp_ns)) held.push_back(&p);
  Flicker flicker = flicker_of(held);
  if (!(flicker.half_range > 0.0)) return flicker;
  view.steady = SteadyLight(flicker.middle);
  SteadyLight steady = view.steady;
  for (Profile& p : profiles) steady.divide(p.value);
  return flicker;
}

/// Of the profiles in the unloaded stretch that agree with each other. Throws InputError when there are none.
inline CheckedReference checked_reference(const std::vector<Profile>& profiles, const UnloadedStretch& stretch,
    const std::string& name, const Repeats& repeats = {}) {
  std::vector<const Profile*> held;
  for (const Profile& p : profiles)
    if (stretch.holds(p.stamp_ns)) held.push_back(&p);
  CheckedReference checked = checked_reference(held, repeats);
  if (checked.reference.count() == 0) throw InputError(message(name, ": has no picture of the unloaded finger"));
  return checked;
}
inline UnloadedReference unloaded_reference(const std::vector<Profile>& profiles, const UnloadedStretch& stretch,
    const std::string& name, const Repeats& repeats = {}) {
  return checked_reference(profiles, stretch, name, repeats).reference;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/bright_rows.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_BRIGHT_ROWS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_BRIGHT_ROWS_HPP

namespace lumo::sense {

/// The paper's reading of a picture for location: rows across the finger, evenly spaced along its LEDs in the picture;
/// of each the mean over the brightest tenth of green's excess over an unloaded picture, pixel by pixel, darker pixels
/// 0 [DN]. A row's place is piecewise linear between the LEDs, and beyond the last ones as between the two next to
/// the end. Source: the authors' public code (dokkev/fingertip-design-framework, contact_localization.py), by
/// description. Rows and samples across are ours.
class BrightRows {
 public:
  using Sample = Frame;

  struct Config {
    FingerView view;
    Eigen::VectorXd led_m;         ///< of the LEDs in `view`, ascending
    Image unloaded;                ///< median picture
    double beyond_m = 11.0_mm;     ///< past the last LEDs, at most
    int rows = 256, across = 128;  ///< samples
    double brightest = 0.1;        ///< share of a row's samples that counts
  };

  /// Throws InvalidArgument where LEDs and places do not match, rows leave the picture altogether, or the unloaded
  /// picture has another size.
  explicit BrightRows(const Config& config) : config_(config) {
    const FingerView& view = config_.view;
    const Eigen::Index leds = config_.led_m.size();
    if (leds < 2 || view.leds.centroid_px.cols() != leds)
      throw InvalidArgument(message("rows: ", view.leds.centroid_px.cols(), " LEDs are seen at ", leds, " places"));
    require_in_range("rows", config_.rows, 3, 4096, "");
    require_in_range("samples across", config_.across, 1, 4096, "");
    require_in_range("brightest share", config_.brightest, 1e-6, 1.0, "");
    require_in_range("way past the LEDs", config_.beyond_m, 0.0, 1.0, "m");
    const ImageView v = config_.unloaded.view();
    if (v.width != view.width || v.height != view.height || v.format != view.format)
      throw InvalidArgument("unloaded image has not the size or format of the frames");
    lay_out();
  }

  bool read(const Frame& frame, Profile& profile) {
    const FingerView& view = config_.view;
    if (frame.image.empty() || frame.image.width != view.width || frame.image.height != view.height ||
        frame.image.format != view.format)
      return false;
    profile.stamp_ns = frame.stamp_ns;
    profile.value.resize(places_.size());
    ImageView unloaded = config_.unloaded.view();
    unloaded.lit = view.lit;
    std::size_t full = 0, nearly = 0, all = 0;
    for (std::size_t r = 0; r < samples_.size(); ++r) {
      excess_.clear();
      for (const auto& [x, y] : samples_[r]) {
        const int now = frame.image.green(x, y), before = unloaded.green(x, y);
        excess_.push_back(std::max(0, now - before));
        full += now == 255;
        nearly += now >= 250;
        ++all;
      }
      profile.value[Eigen::Index(r)] = mean_of_brightest();
    }
    profile.saturated = double(full) / double(std::max<std::size_t>(1, all));
    profile.nearly_saturated = double(nearly) / double(std::max<std::size_t>(1, all));
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return places_; }

 private:
  void lay_out() {
    const FingerView& view = config_.view;
    const AxisMap& map = view.leds.map;
    const Eigen::Index leds = config_.led_m.size();
    Eigen::VectorXd u(leds);
    for (Eigen::Index k = 0; k < leds; ++k) u[k] = map.u_px(Eigen::Vector2d(view.leds.centroid_px.col(k)));
    const auto slope = [&](Eigen::Index k) { return (u[k + 1] - u[k]) / (config_.led_m[k + 1] - config_.led_m[k]); };
    const double from = u[0] - slope(0) * config_.beyond_m, to = u[leds - 1] + slope(leds - 2) * config_.beyond_m,
                 scale = map.scale_m_per_px(0.5 * (from + to));
    const Eigen::Vector2d along = map.direction, across(-along.y(), along.x());
    places_.resize(config_.rows);
    samples_.resize(std::size_t(config_.rows));
    for (int r = 0; r < config_.rows; ++r) {
      const double at = from + (to - from) * r / (config_.rows - 1);
      Eigen::Index k = 0;
      while (k + 2 < leds && at > u[k + 1]) ++k;
      places_[r] = config_.led_m[k] + (at - u[k]) / slope(k);
      for (int c = 0; c < config_.across; ++c) {
        const double side =
            (view.band_low_m + (view.band_high_m - view.band_low_m) * (c + 0.5) / config_.across) / scale;
        const Eigen::Vector2d p = map.origin_px + at * along + side * across;
        const long x = std::lround(p.x()), y = std::lround(p.y());
        if (x >= 0 && y >= 0 && x < view.width && y < view.height)
          samples_[std::size_t(r)].emplace_back(int(x), int(y));
      }
    }
    if (std::all_of(samples_.begin(), samples_.end(), [](const auto& row) { return row.empty(); }))
      throw InvalidArgument("the finger's rows leave the image");
  }
  double mean_of_brightest() {
    if (excess_.empty()) return 0.0;
    const auto count = std::max<std::size_t>(1, std::size_t(std::lround(config_.brightest * double(excess_.size()))));
    const auto end = excess_.begin() + std::ptrdiff_t(count);
    std::nth_element(excess_.begin(), end - 1, excess_.end(), std::greater<>());
    double sum = 0.0;
    for (auto e = excess_.begin(); e != end; ++e) sum += *e;
    return sum / double(count);
  }

  Config config_;
  Eigen::VectorXd places_;
  std::vector<std::vector<std::pair<int, int>>> samples_;  ///< by row: pixels
  std::vector<int> excess_;
};

static_assert(Readout<BrightRows>);

}  // namespace lumo::sense

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

// ---- lumo/sense/localize/bayes_localizer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_BAYES_LOCALIZER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_BAYES_LOCALIZER_HPP

namespace lumo::sense {

/// Mean and variance of a distribution over places, and the number of its most probable one.
struct GridMoments {
  double mean, variance;
  Eigen::Index mode;
};

/// Weights below this share of the mode's do not count: what new contacts leave, which may be anywhere.
inline constexpr double least_grid_weight = 1e-4;

/// Moments about the mode. Throws InvalidArgument unless there are as many weights as places, all are finite, and the
/// largest weight is positive.
inline GridMoments moments_about_mode(const Eigen::VectorXd& place, const Eigen::VectorXd& weight) {
  if (place.size() != weight.size() || weight.size() < 1 || !(place.array().abs() <= 1e100).all() ||
      !(weight.array().abs() <= 1e100).all() || !(weight.maxCoeff() > 0.0))
    throw InvalidArgument(message("grid has ", place.size(), " places and ", weight.size(),
        " weights, must have as many, within 1e100, the largest weight > 0"));
  GridMoments m{0.0, 0.0, 0};
  const double most = weight.maxCoeff(&m.mode);
  double sum = 0.0, first = 0.0, second = 0.0;
  for (Eigen::Index j = 0; j < weight.size(); ++j) {
    const double w = weight[j] > least_grid_weight * most ? weight[j] : 0.0, d = place[j] - place[m.mode];
    sum += w;
    first += w * d;
    second += w * d * d;
  }
  m.mean = place[m.mode] + first / sum;
  m.variance = std::max(second / sum - first * first / (sum * sum), 0.0);
  return m;
}

/// Filter over the number of contacts (none, one, two) and over the place of a single one on a grid. The model of a
/// contact is a bright bump of unknown height and one of a few widths. It adds to noise and to slow changes of the
/// lamps and of ambient light, which are integrated out. No labels, no training. `shape_error` and `bias_sigma_m` state
/// how far a real bump is from the assumed shape.
class BayesLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;  ///< of the profile's values
    Eigen::VectorXd noise;       ///< standard deviation of each, unloaded
    Eigen::VectorXd unloaded;    ///< mean profile of the unloaded finger; empty: lamps are steady
    double lamp_sigma = 0.01;    ///< relative change of all lamps together; assumed
    double ambient_sigma = 0.3;  ///< change of ambient light, in the profile's unit; assumed
    double from_m = -30.0_mm, to_m = 30.0_mm, spacing_m = 0.5_mm;   ///< grid
    std::array<double, 4> width_m{3.0_mm, 4.0_mm, 5.5_mm, 8.0_mm};  ///< standard deviations of bumps
    /// The pad ends at ± this place in clear faces, which reflect a bump's light as its mirror image; 0: no ends near.
    double end_m = 0.0;
    /// Share of that light. Assumed: light within 45° of the finger's axis leaves, the rest is reflected totally.
    double end_share = 1.0;
    double amplitude_sigma = 50.0;      ///< prior of a bump's height, half normal, in the profile's unit
    double shape_error = 0.05;          ///< of the assumed bump, relative to the response; counts as noise
    double bias_sigma_m = 0.5_mm;       ///< how far the bump's middle is believed to lie from the contact; assumed
    double end_bias_sigma_m = 0.0;      ///< the same, on top, of contacts near an end; assumed
    double end_near_m = 5.0_mm;         ///< contacts within this of an end have all of it; assumed
    double end_far_m = 10.0_mm;         ///< those beyond this have none, those between a share; assumed
    double min_separation_m = 12.0_mm;  ///< of two contacts
    /// Of the stronger contact's height that the weaker one must have: less may be the bump's own shape.
    double min_share = 0.2;
    /// Of the weaker contact's height by which the response must dip between the two; assumed.
    double min_dip = 0.25;
    double change_rate_per_s = 2.0;      ///< how often contacts come and go
    double creep_m_per_sqrt_s = 1.0_mm;  ///< random walk of a contact that stays
    double gap_s = 0.5;                  ///< longer without a profile: forget
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit BayesLocalizer(Config config);

  void reset() { fresh_ = true; }
  LocationEstimate update(const Profile& response);

  const Eigen::VectorXd& grid_m() const { return grid_; }
  /// Posterior of the place given one contact; sums to 1.
  const Eigen::VectorXd& place() const { return place_; }
  /// Posterior of none, one, two contacts.
  const Eigen::Vector3d& number() const { return number_; }

 private:
  static constexpr Eigen::Index widths = 4;
  static constexpr double most_cells = 1024.0;        ///< pairs of places are looked up in tables of cells²
  static constexpr Eigen::Index pair_parameters = 4;  ///< places and heights of two bumps
  static constexpr double significant_sigmas = 3.0;   ///< beyond this many standard deviations it is more than noise
  static constexpr double least_number = 1e-12;       ///< probability that a number of contacts keeps
  static constexpr double least_likelihood = 1e-300;  ///< keeps a logarithm finite
  static constexpr double least_information = 1e-3;   ///< of a profile, relative to what was known before

  /// Two bumps of one width, the higher one first.
  struct Pair {
    Eigen::Index first = 0, second = 0, width = 0;
    double explained = -1.0;  ///< by how much they lower χ²; −1: no pair
  };

  static void require_valid(const Config& c);
  void lay_out_bumps();
  double explain(const Eigen::VectorXd& response);
  double weigh_places(double tempering);
  double log_evidence(double s, double g, double tempering) const;
  double log_evidence(const Pair& pair, double tempering) const;
  Pair best_pair(double tempering) const;
  bool dips_between(const Eigen::VectorXd& response, const Pair& pair) const;
  std::array<double, 2> heights(const Pair& pair, double tempering, double& det) const;
  void predict(double step_s);
  double bias_variance_m2(double y) const {
    const double from_far = std::abs(y) - config_.end_m + config_.end_far_m;
    const double near =
        config_.end_m > 0.0 ? std::clamp(from_far / (config_.end_far_m - config_.end_near_m), 0.0, 1.0) : 0.0;
    const double end = near * config_.end_bias_sigma_m;
    return config_.bias_sigma_m * config_.bias_sigma_m + end * end;
  }
  ContactLocation one() const;
  LocationEstimate answer(std::int64_t stamp_ns) const;

  Config config_;
  Eigen::VectorXd grid_;
  Eigen::MatrixXd bumps_;                ///< profile × (grid · widths): the width varies slowest
  Eigen::MatrixXd matched_;              ///< Σ⁻¹ bumps
  Eigen::MatrixXd precision_;            ///< Σ⁻¹ of the profile
  std::array<Eigen::MatrixXd, 4> gram_;  ///< bumpsᵀ Σ⁻¹ bumps of each width
  Eigen::VectorXd energy_;               ///< diagonal of it, all widths
  Eigen::VectorXd score_, place_, likelihood_, spread_, expected_;  ///< expected_: place_ before the newest profile
  Eigen::Vector3d number_{1.0, 0.0, 0.0};
  Pair pair_;
  std::int64_t stamp_ns_ = 0;
  bool fresh_ = true;
};

inline BayesLocalizer::BayesLocalizer(Config config) : config_(std::move(config)) {
  require_valid(config_);
  lay_out_bumps();
  place_ = Eigen::VectorXd::Constant(grid_.size(), 1.0 / double(grid_.size()));
  likelihood_ = spread_ = expected_ = place_;
  score_.resize(bumps_.cols());
}

inline void BayesLocalizer::require_valid(const Config& c) {
  const Eigen::Index n = c.position_m.size();
  if (n < 3 || c.noise.size() != n || (c.unloaded.size() != 0 && c.unloaded.size() != n))
    throw InvalidArgument(message("localiser has ", n, " positions, ", c.noise.size(), " noises and ",
        c.unloaded.size(), " unloaded values, must have as many, at least 3"));
  for (Eigen::Index i = 0; i < n; ++i) require_in_range("noise of a profile's value", c.noise[i], 1e-100, 1e100, "");
  require_ascending_positions(c.position_m);
  if (c.unloaded.size() && !c.unloaded.allFinite()) throw InvalidArgument("localiser: unloaded values must be finite");
  require_in_range("relative change of the lamps", c.lamp_sigma, 0.0, 1e3, "");
  require_in_range("change of ambient light", c.ambient_sigma, 0.0, 1e6, "");
  require_positive("grid spacing", c.spacing_m, "m");
  require_in_range("grid's start", c.from_m, -10.0, 10.0, "m");
  require_in_range("grid's end", c.to_m, c.from_m + 2.0 * c.spacing_m, c.from_m + most_cells * c.spacing_m, "m");
  for (const double w : c.width_m) require_positive("width of a bump", w, "m");
  require_in_range("end of the pad", c.end_m, 0.0, 10.0, "m");
  require_in_range("share of the light that the pad's ends throw back", c.end_share, 0.0, 1.0, "");
  require_in_range("height of a bump", c.amplitude_sigma, 1e-100, 1e100, "");
  require_in_range("shape error", c.shape_error, 0.0, 1.0, "");
  require_in_range("share of the weaker contact", c.min_share, 0.0, 1.0, "");
  require_positive("rate of change of contacts", c.change_rate_per_s, "1/s");
  require_in_range("bias of a bump", c.bias_sigma_m, 0.0, 1.0, "m");
  require_in_range("bias of a bump near an end", c.end_bias_sigma_m, 0.0, 1.0, "m");
  require_in_range("separation of two contacts", c.min_separation_m, 0.0, 10.0, "m");
  require_in_range("creep of a contact", c.creep_m_per_sqrt_s, 0.0, 10.0, "m/sqrt(s)");
  require_positive("gap of the localiser", c.gap_s, "s");
  require_in_range("reach of an end's bias", c.end_near_m, 0.0, c.end_far_m, "m");
  require_positive("fall of an end's bias", c.end_far_m - c.end_near_m, "m");
  require_in_range("dip between two contacts", c.min_dip, 0.0, 1.0, "");
}

/// The bumps of all places and widths, and what they are under the noise.
inline void BayesLocalizer::lay_out_bumps() {
  const Eigen::Index n = config_.position_m.size();
  const auto cells = Eigen::Index(std::floor((config_.to_m - config_.from_m) / config_.spacing_m + 0.5)) + 1;
  grid_ = Eigen::VectorXd::LinSpaced(cells, config_.from_m, config_.to_m);
  Eigen::MatrixXd covariance = config_.noise.cwiseAbs2().asDiagonal();
  covariance.array() += config_.ambient_sigma * config_.ambient_sigma;
  if (config_.unloaded.size())
    covariance += config_.lamp_sigma * config_.lamp_sigma * config_.unloaded * config_.unloaded.transpose();
  precision_ = covariance.llt().solve(Eigen::MatrixXd::Identity(n, n));
  bumps_.resize(n, cells * widths);
  for (Eigen::Index w = 0; w < widths; ++w)
    for (Eigen::Index j = 0; j < cells; ++j) {
      const auto bump_at = [&](double y) {
        return Eigen::VectorXd(
            (-0.5 * ((config_.position_m.array() - y) / config_.width_m[std::size_t(w)]).square()).exp());
      };
      auto bump = bumps_.col(w * cells + j);
      bump = bump_at(grid_[j]);
      if (config_.end_m > 0.0)
        for (const double end : {-config_.end_m, config_.end_m})
          bump += config_.end_share * bump_at(2.0 * end - grid_[j]);
    }
  matched_ = precision_ * bumps_;
  energy_ = bumps_.cwiseProduct(matched_).colwise().sum().transpose();
  for (Eigen::Index w = 0; w < widths; ++w)
    gram_[std::size_t(w)] = bumps_.middleCols(w * cells, cells).transpose() * matched_.middleCols(w * cells, cells);
}

/// Log of the Bayes factor of a bump with matched score s and energy g against none; its height is half normal and
/// integrated out.
inline double BayesLocalizer::log_evidence(double s, double g, double tempering) const {
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), h = g * tempering + prior,
               t = s * tempering;
  const double z = t / std::sqrt(h);
  // log of 2 Φ(z) e^{z²/2}, without overflow on either side
  constexpr double asymptotic_below = -6.0, one_by_sqrt_2 = 0.70710678118654752440;
  constexpr double sqrt_2_by_pi = 0.79788456080286535588;
  const double tail = z > asymptotic_below ? 0.5 * z * z + std::log(std::erfc(-one_by_sqrt_2 * z))
                                           : std::log(sqrt_2_by_pi / -z) - 1.0 / (z * z);
  return tail + 0.5 * std::log(prior / h);
}

/// Heights of the two bumps under the prior's ridge, the first's first; `det` of the two equations.
inline std::array<double, 2> BayesLocalizer::heights(const Pair& p, double tempering, double& det) const {
  const Eigen::MatrixXd& gram = gram_[std::size_t(p.width)];
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const double a = tempering * gram(p.first, p.first) + prior, b = tempering * gram(p.second, p.second) + prior,
               c = tempering * gram(p.first, p.second);
  const double s = tempering * score_[p.width * grid_.size() + p.first],
               t = tempering * score_[p.width * grid_.size() + p.second];
  det = a * b - c * c;
  return {(b * s - c * t) / det, (a * t - c * s) / det};
}

/// Searched on every other cell, then about the best.
inline auto BayesLocalizer::best_pair(double tempering) const -> Pair {
  const Eigen::Index cells = grid_.size();
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma);
  const auto apart =
      std::max<Eigen::Index>(1, Eigen::Index(std::ceil(config_.min_separation_m / config_.spacing_m - 1e-9)));
  Pair best;
  const auto look = [&](Eigen::Index width, Eigen::Index i, Eigen::Index j) {
    const Eigen::MatrixXd& gram = gram_[std::size_t(width)];
    const double a = tempering * gram(i, i) + prior, b = tempering * gram(j, j) + prior, c = tempering * gram(j, i);
    const double s = tempering * score_[width * cells + i], t = tempering * score_[width * cells + j];
    const double hi = b * s - c * t, hj = a * t - c * s;  // heights times the determinant
    if (!(std::min(hi, hj) > config_.min_share * std::max(hi, hj))) return;
    const double explained = (s * hi + t * hj) / (a * b - c * c);
    if (explained > best.explained) best = {hi >= hj ? i : j, hi >= hj ? j : i, width, explained};
  };
  for (Eigen::Index width = 0; width < widths; ++width)
    for (Eigen::Index i = 0; i < cells; i += 2)
      for (Eigen::Index j = i + apart; j < cells; j += 2) look(width, i, j);
  if (best.explained < 0.0) return best;
  const Eigen::Index i = std::min(best.first, best.second), j = std::max(best.first, best.second);
  for (Eigen::Index k = std::max<Eigen::Index>(0, i - 1); k <= i + 1; ++k)
    for (Eigen::Index l = std::max(j - 1, k + apart); l <= std::min(cells - 1, j + 1); ++l) look(best.width, k, l);
  return best;
}

/// Two contacts must show as two peaks, so two within about three bump widths count as one. Otherwise a bump of
/// slightly another shape, or a change of the lamps, would count as a second contact.
inline bool BayesLocalizer::dips_between(const Eigen::VectorXd& response, const Pair& pair) const {
  const auto index = [&](Eigen::Index cell) {
    Eigen::Index i = 0;
    (config_.position_m.array() - grid_[cell]).abs().minCoeff(&i);
    return i;
  };
  double det = 1.0;
  const Eigen::Index a = index(pair.first), b = index(pair.second);
  const double least = response.segment(std::min(a, b), std::abs(a - b) + 1).minCoeff();
  return response[b] - least > config_.min_dip * heights(pair, 1.0, det)[1];
}

/// Log of the Bayes factor of two bumps against none.
inline double BayesLocalizer::log_evidence(const Pair& p, double tempering) const {
  if (p.explained < 0.0) return -std::numeric_limits<double>::infinity();
  double det = 1.0;
  const auto h = heights(p, tempering, det);
  const double prior = 1.0 / (config_.amplitude_sigma * config_.amplitude_sigma), cells = double(grid_.size());
  const double fit =
      0.5 * tempering *
      (score_[p.width * grid_.size() + p.first] * h[0] + score_[p.width * grid_.size() + p.second] * h[1]);
  // The best pair times the cells that it stands for replaces the sum over pairs (Laplace): √(2π) times a bump's error
  // of place, width/√L. L = fit/2 is the log likelihood that the bump explains; moved by d it is L (1 − d²/(2 width²)).
  constexpr double sqrt_2_pi = 2.5066282746310002;
  const double width = config_.width_m[std::size_t(p.width)];
  const double sharp = std::max(1.0, sqrt_2_pi * width / std::sqrt(std::max(0.5 * fit, 1.0)) / config_.spacing_m);
  const double apart = config_.min_separation_m / config_.spacing_m,
               pairs = 0.5 * (cells - apart) * (cells - apart + 1.0);
  return fit + 0.5 * std::log(prior * prior / det) + std::log(4.0) + 2.0 * std::log(sharp) -
         std::log(std::max(pairs, 1.0)) - std::log(double(widths));
}

inline void BayesLocalizer::predict(double step_s) {
  const double change = -std::expm1(-config_.change_rate_per_s * step_s);
  number_ = (1.0 - change) * number_ + Eigen::Vector3d::Constant(change / 3.0);
  // A contact that stays creeps; one that is new may be anywhere.
  const double walk = config_.creep_m_per_sqrt_s * std::sqrt(step_s) / config_.spacing_m, cells = double(place_.size());
  // A Gaussian narrower than a cell loses its variance when it is sampled; a step to either side keeps it.
  const bool narrow = walk <= 1.0;
  const auto reach = std::min<Eigen::Index>(place_.size() - 1, narrow ? 1 : Eigen::Index(std::ceil(4.0 * walk)));
  spread_.setZero();
  double whole = 0.0;
  for (Eigen::Index k = -reach; k <= reach; ++k) {
    const double w = !narrow  ? std::exp(-0.5 * double(k * k) / (walk * walk))
                     : k == 0 ? 1.0 - walk * walk
                              : 0.5 * walk * walk;
    whole += w;
    const Eigen::Index n = place_.size() - std::abs(k);
    spread_.segment(std::max<Eigen::Index>(k, 0), n) += w * place_.segment(std::max<Eigen::Index>(-k, 0), n);
  }
  place_ = (1.0 - change) / whole * spread_;
  place_.array() += (1.0 - place_.sum()) / cells;
}

/// Scores of all bumps, and the best pair of them. Returns by what factor the response is less certain than its noise
/// states.
inline double BayesLocalizer::explain(const Eigen::VectorXd& response) {
  score_.noalias() = matched_.transpose() * response;
  // The error of the assumed shape grows with the response; it makes all that is seen less certain by one factor.
  const double typical = config_.noise.mean(), shape = config_.shape_error * response.cwiseAbs().maxCoeff();
  const double tempering = typical * typical / (typical * typical + shape * shape);

  // Best of one and of two bumps. If even that leaves more than noise, the response is no sum of such bumps, and noise
  // stands for the rest (Birge).
  const double explained = (score_.cwiseMax(0.0).cwiseAbs2().cwiseQuotient(energy_)).maxCoeff();
  pair_ = best_pair(tempering);
  if (pair_.explained > 0.0 && !dips_between(response, pair_)) pair_.explained = -1.0;
  const double chi2 = response.dot(precision_ * response),
               freedom = double(std::max<Eigen::Index>(1, response.size() - pair_parameters));
  const double left = chi2 - std::max(explained, pair_.explained / tempering);
  const bool beyond_noise = left > freedom + significant_sigmas * std::sqrt(2.0 * freedom);
  return beyond_noise ? std::min(tempering, freedom / left) : tempering;
}

/// Updates the posterior of a single contact's place. Returns the log of the Bayes factor of one contact against none.
inline double BayesLocalizer::weigh_places(double tempering) {
  const Eigen::Index cells = grid_.size();
  double top = -std::numeric_limits<double>::infinity();
  for (Eigen::Index j = 0; j < cells; ++j) {
    std::array<double, std::size_t(widths)> e{};
    for (std::size_t w = 0; w < e.size(); ++w) {
      const Eigen::Index k = Eigen::Index(w) * cells + j;
      e[w] = log_evidence(score_[k], energy_[k], tempering);
    }
    const double most = *std::max_element(e.begin(), e.end());
    double sum = 0.0;
    for (const double v : e) sum += std::exp(v - most);
    likelihood_[j] = most + std::log(sum / double(widths));
    top = std::max(top, likelihood_[j]);
  }
  likelihood_ = (likelihood_.array() - top).exp();
  const double log_one = top + std::log(std::max(likelihood_.mean(), least_likelihood));
  place_ = place_.cwiseProduct(likelihood_);
  const double sum = place_.sum();
  place_ = sum > 0.0 ? Eigen::VectorXd(place_ / sum) : Eigen::VectorXd(likelihood_ / likelihood_.sum());
  return log_one;
}

inline LocationEstimate BayesLocalizer::update(const Profile& response) {
  if (response.value.size() != config_.position_m.size())
    throw InvalidArgument(
        message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
  const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
  if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
  if (!is_usable(response)) {
    if (step_s > config_.gap_s) reset();
    return answer(response.stamp_ns);
  }
  if (fresh_ || step_s > config_.gap_s) {
    number_ = Eigen::Vector3d(1.0, 1.0, 1.0) / 3.0;
    place_.setConstant(1.0 / double(grid_.size()));
    fresh_ = false;
  } else {
    predict(step_s);
  }
  stamp_ns_ = response.stamp_ns;
  expected_ = place_;

  const double tempering = explain(response.value);
  const double log_one = weigh_places(tempering), log_two = log_evidence(pair_, tempering);
  const double highest = std::max({0.0, log_one, log_two});
  number_ = number_.cwiseProduct(
      Eigen::Vector3d(std::exp(-highest), std::exp(log_one - highest), std::exp(log_two - highest)));
  number_ = number_.cwiseMax(least_number);
  number_ /= number_.sum();
  return answer(stamp_ns_);
}

inline ContactLocation BayesLocalizer::one() const {
  const GridMoments now = moments_about_mode(grid_, place_), before = moments_about_mode(grid_, expected_);
  const double cell2 = config_.spacing_m * config_.spacing_m / 12.0, bias2 = bias_variance_m2(now.mean);
  // The noise of this profile alone: 1/noise = 1/posterior − 1/prior. A profile with little information has a large
  // noise; one that moves the estimate far owes nothing to the prior.
  const double posterior = now.variance + cell2, prior = before.variance + cell2, moved = now.mean - before.mean;
  const double noise = moved * moved > significant_sigmas * significant_sigmas * (prior + posterior)
                           ? posterior
                           : posterior * prior / std::max(prior - posterior, least_information * prior);
  const Eigen::Index k = grid_.size() + now.mode;  // of the second width, a middling one
  return {now.mean, posterior + bias2, std::max(0.0, score_[k] / energy_[k]), bias2, noise};
}

inline LocationEstimate BayesLocalizer::answer(std::int64_t stamp_ns) const {
  LocationEstimate e{stamp_ns, 0, {}, 1.0};
  if (fresh_) return e;
  Eigen::Index n = 0;
  e.probability = number_.maxCoeff(&n);
  e.contacts = int(n);
  if (n == 1) e.contact[0] = one();
  if (n == 2) {
    double det = 1.0;
    const auto h = heights(pair_, 1.0, det);
    // Each bump bends the other, which doubles the bias. The filter does not follow pairs in time.
    const double cell2 = config_.spacing_m * config_.spacing_m / 12.0;
    const auto at = [&](Eigen::Index cell, double height) {
      const double bias2 = 4.0 * bias_variance_m2(grid_[cell]);
      return ContactLocation{grid_[cell], cell2 + bias2, std::max(0.0, height), bias2, cell2};
    };
    e.contact[0] = at(pair_.first, h[0]);
    e.contact[1] = at(pair_.second, h[1]);
  }
  return e;
}

static_assert(LocationEstimator<BayesLocalizer>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/localize/paper_localizer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_PAPER_LOCALIZER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_PAPER_LOCALIZER_HPP

namespace lumo::sense {

/// The paper's localiser as its authors run it, on rows of the positive change of green (BrightRows): Gaussian filter
/// along the finger, causal median of three frames, a threshold above what the unloaded rows have, and the centroid or
/// the largest value of what stands above it. A contact whose light fails a gate has no place and is `unknown`. Source:
/// the authors' public code (dokkev/fingertip-design-framework, contact_localization.py), by description.
class PaperLocalizer {
 public:
  enum class Place { centroid, largest };  ///< the live code's, the force figure's

  struct Config {
    Eigen::VectorXd position_m;     ///< of the rows
    std::vector<Profile> unloaded;  ///< at least one
    Place place = Place::centroid;
    double smoothing_rows = 2.0;  ///< standard deviation
    double least_noise_DN = 0.75;
    double threshold_noises = 4.0;
    double least_evidence_DN = 4.0;  ///< sum over the rows
    double least_contrast = 1.2;     ///< of largest to median row, each with `contrast_floor_DN` on top
    double contrast_floor_DN = 0.75;
    double most_entropy = 0.985;  ///< of the evidence, 1: even
    double most_nearly_saturated = 0.25, most_saturated = 0.05;
    double sigma_m = 6.0_mm;  ///< stated error of a place; the paper states none, its mean error was 5 mm
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit PaperLocalizer(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 3 || config_.unloaded.empty())
      throw InvalidArgument(message("paper's localiser has ", n, " rows and ", config_.unloaded.size(),
          " unloaded profiles, must have at least 3 and 1"));
    require_ascending_positions(config_.position_m);
    require_in_range("smoothing", config_.smoothing_rows, 0.1, 100.0, "rows");
    require_positive("least noise", config_.least_noise_DN, "DN");
    require_positive("threshold", config_.threshold_noises, "noises");
    require_positive("stated error of a place", config_.sigma_m, "m");
    Eigen::MatrixXd rows(n, Eigen::Index(config_.unloaded.size()));
    for (Eigen::Index k = 0; k < rows.cols(); ++k) {
      const Profile& p = config_.unloaded[std::size_t(k)];
      if (p.value.size() != n || !is_usable(p))
        throw InvalidArgument(
            message("unloaded profile has ", p.value.size(), " values, must have ", n, " finite ones"));
      rows.col(k) = smoothed(p.value);
    }
    centre_ = pointwise_median(rows);
    constexpr double sigmas_per_mad = 1.4826;  // of a normal distribution
    noise_ =
        (sigmas_per_mad * pointwise_median((rows.colwise() - centre_).cwiseAbs())).cwiseMax(config_.least_noise_DN);
  }

  void reset() {
    seen_ = 0;
    stamped_ = false;
    last_ = {};
  }

  LocationEstimate update(const Profile& response) {
    if (response.value.size() != config_.position_m.size())
      throw InvalidArgument(
          message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
    if ((stamped_ && response.stamp_ns <= stamp_ns_) || !is_usable(response)) {
      last_.stamp_ns = response.stamp_ns;
      return last_;
    }
    stamp_ns_ = response.stamp_ns;
    stamped_ = true;
    recent_[std::size_t(seen_++ % 3)] = smoothed(response.value);
    last_ = answer(response, median_of_recent());
    return last_;
  }

 private:
  Eigen::VectorXd smoothed(const Eigen::VectorXd& v) const {
    const auto reach = Eigen::Index(std::ceil(4.0 * config_.smoothing_rows)), n = v.size();
    Eigen::VectorXd s(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      double sum = 0.0, whole = 0.0;
      for (Eigen::Index k = -reach; k <= reach; ++k) {
        const double away = double(k) / config_.smoothing_rows, weight = std::exp(-0.5 * away * away);
        sum += weight * v[std::clamp<Eigen::Index>(i + k, 0, n - 1)];
        whole += weight;
      }
      s[i] = sum / whole;
    }
    return s;
  }
  Eigen::VectorXd median_of_recent() const {
    const auto count = Eigen::Index(std::min<std::int64_t>(seen_, 3));
    Eigen::MatrixXd rows(config_.position_m.size(), count);
    for (Eigen::Index k = 0; k < count; ++k) rows.col(k) = recent_[std::size_t(k)];
    return pointwise_median(rows);
  }
  LocationEstimate answer(const Profile& response, const Eigen::VectorXd& rows) const {
    LocationEstimate e{response.stamp_ns, 0, {}, 1.0};
    const Eigen::VectorXd above = rows - centre_, evidence = (above - config_.threshold_noises * noise_).cwiseMax(0.0);
    const double sum = evidence.sum();
    Eigen::Index top = 0;
    const double largest = evidence.maxCoeff(&top);
    if (sum < config_.least_evidence_DN || !(largest > 0.0)) return e;
    const double middle = median({rows.data(), rows.data() + rows.size()}), peak = rows.maxCoeff();
    double entropy = 0.0;
    for (const double v : evidence)
      if (v > 0.0) entropy -= v / sum * std::log(v / sum);
    entropy /= std::log(double(evidence.size()));
    const double contrast = (peak + config_.contrast_floor_DN) / (middle + config_.contrast_floor_DN);
    e.unknown = contrast < config_.least_contrast || entropy > config_.most_entropy ||
                response.nearly_saturated > config_.most_nearly_saturated ||
                response.saturated > config_.most_saturated;
    if (e.unknown) return e;
    const double row =
                     evidence.dot(Eigen::VectorXd::LinSpaced(evidence.size(), 0.0, double(evidence.size() - 1))) / sum,
                 variance = config_.sigma_m * config_.sigma_m;
    e.contacts = 1;
    e.contact[0] = {
        config_.place == Place::largest ? config_.position_m[top] : place_of(row), variance, largest, variance, 0.0};
    return e;
  }
  double place_of(double row) const {
    const Eigen::VectorXd& x = config_.position_m;
    const auto k = std::min(Eigen::Index(row), x.size() - 2);
    return x[k] + (row - double(k)) * (x[k + 1] - x[k]);
  }

  Config config_;
  Eigen::VectorXd centre_, noise_;
  std::array<Eigen::VectorXd, 3> recent_;
  LocationEstimate last_;
  std::int64_t seen_ = 0, stamp_ns_ = 0;
  bool stamped_ = false;
};

static_assert(LocationEstimator<PaperLocalizer>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/localize/peak_localizer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_PEAK_LOCALIZER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_PEAK_LOCALIZER_HPP

namespace lumo::sense {

/// The paper's localiser: the strongest peak of the low-passed response above a noise threshold. No labels, no
/// training. A contact starts above `threshold` noises and ends below `release`. The filter is first order in time and
/// starts anew after a gap.
class PeakLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;     ///< of the profile's values
    Eigen::VectorXd noise;          ///< standard deviation of each, unloaded
    double time_constant_s = 0.05;  ///< of the filter
    double gap_s = 0.5;             ///< longer without a profile: forget
    double threshold = 6.0;         ///< in noises of the filtered profile
    double release = 4.0;
    double bias_sigma_m = 1.0_mm;  ///< how far the brightest place is believed to lie from the contact; assumed
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit PeakLocalizer(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 3 || config_.noise.size() != n)
      throw InvalidArgument(message(
          "localiser has ", n, " positions and ", config_.noise.size(), " noises, must have at least 3 of each"));
    for (Eigen::Index i = 0; i < n; ++i) require_positive("noise of a profile's value", config_.noise[i], "");
    require_ascending_positions(config_.position_m);
    require_positive("time constant of the localiser", config_.time_constant_s, "s");
    require_positive("gap of the localiser", config_.gap_s, "s");
    require_in_range("release threshold", config_.release, 0.0, config_.threshold, "noises");
    require_in_range("bias of the peak", config_.bias_sigma_m, 0.0, 1.0, "m");
    reset();
  }

  void reset() {
    fresh_ = true;
    touching_ = false;
    share_ = 1.0;
  }

  LocationEstimate update(const Profile& response) {
    if (response.value.size() != config_.position_m.size())
      throw InvalidArgument(
          message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
    const double step_s = 1e-9 * double(response.stamp_ns - stamp_ns_);
    if (!fresh_ && step_s <= 0.0) return answer(response.stamp_ns);
    if (!is_usable(response)) {
      if (step_s > config_.gap_s) reset();
      return answer(response.stamp_ns);
    }
    if (fresh_ || step_s > config_.gap_s) {
      filtered_ = response.value;
      share_ = 1.0;
      fresh_ = touching_ = false;
    } else {
      const double weight = -std::expm1(-step_s / config_.time_constant_s);
      filtered_ += weight * (response.value - filtered_);
      share_ = (1.0 - weight) * (1.0 - weight) * share_ + weight * weight;  // of the white noise's variance
    }
    stamp_ns_ = response.stamp_ns;
    return answer(stamp_ns_);
  }

 private:
  LocationEstimate answer(std::int64_t stamp_ns) {
    LocationEstimate e{stamp_ns, 0, {}, 1.0};
    if (fresh_) return e;
    Eigen::Index top = 0;
    filtered_.maxCoeff(&top);
    const double sigma = config_.noise[top] * std::sqrt(share_), peak = filtered_[top];
    touching_ = peak > (touching_ ? config_.release : config_.threshold) * sigma;
    if (!touching_) return e;
    e.contacts = 1;
    e.contact[0] = vertex(top, sigma);
    return e;
  }

  /// The parabola through the peak and its neighbours; at the ends of the profile, the end itself.
  ContactLocation vertex(Eigen::Index top, double sigma) const {
    const auto& x = config_.position_m;
    const double bias2 = config_.bias_sigma_m * config_.bias_sigma_m, peak = filtered_[top];
    const double width = top == 0 ? x[1] - x[0] : x[top] - x[top - 1];
    const auto at = [&](double y, double variance) {  // noise of one profile: white
      return ContactLocation{y, variance + bias2, peak, bias2, variance / share_};
    };
    if (top == 0 || top + 1 == x.size()) return at(x[top], width * width / 3.0);
    const double left = x[top - 1] - x[top], right = x[top + 1] - x[top];
    const double a = (filtered_[top - 1] - peak) / left, b = (filtered_[top + 1] - peak) / right;
    const double curvature = (b - a) / (right - left);  // ≤ 0 at a peak
    if (!(curvature < 0.0)) return at(x[top], width * width / 12.0);
    const double slope = a - curvature * left;  // at the peak's own place
    const double y = std::clamp(-0.5 * slope / curvature, 0.5 * left, 0.5 * right);
    // Noise moves the vertex by the slope's error over the curvature, at most within the bin.
    const double slope_sigma = sigma * std::sqrt(2.0) / (right - left);
    const double moved = std::min(0.5 * slope_sigma / -curvature, 0.5 * (right - left));
    return at(x[top] + y, moved * moved);
  }

  Config config_;
  Eigen::VectorXd filtered_;
  std::int64_t stamp_ns_ = 0;
  double share_ = 1.0;
  bool fresh_ = true, touching_ = false;
};

static_assert(LocationEstimator<PeakLocalizer>);

}  // namespace lumo::sense

#endif

// ---- lumo/core/chi_squared.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_CHI_SQUARED_HPP
#define SINGLE_INCLUDE_LUMO_CORE_CHI_SQUARED_HPP

namespace lumo {

/// Probability that χ² of `freedom` degrees of freedom is below x: the regularised lower incomplete gamma function
/// P(freedom/2, x/2) by its series (Abramowitz & Stegun 6.5.29). Throws InvalidArgument for numbers out of range.
inline double chi_squared_below(double x, double freedom) {
  require_in_range("degrees of freedom", freedom, 0.1, 1e4, "");
  require_in_range("chi squared", x, 0.0, 1e6, "");
  const double a = 0.5 * freedom, h = 0.5 * x;
  if (!(h > 0.0)) return 0.0;
  if (h > a + 20.0 * std::sqrt(a) + 60.0) return 1.0;  // what is left is below 1e-12
  double term = std::exp(a * std::log(h) - h - std::lgamma(a + 1.0)), sum = term;
  for (double k = 1.0; term > 1e-17 * sum; ++k) {
    term *= h / (a + k);
    sum += term;
  }
  return std::min(1.0, sum);
}

/// What χ² stays below with the given probability. Throws InvalidArgument for numbers out of range.
inline double chi_squared_quantile(double freedom, double probability) {
  require_in_range("probability", probability, 0.0, 1.0 - 1e-9, "");
  double low = 0.0, high = freedom + 20.0 * std::sqrt(freedom) + 120.0;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (chi_squared_below(middle, freedom) < probability ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace lumo

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

// ---- lumo/sense/localize/template_localizer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_TEMPLATE_LOCALIZER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_TEMPLATE_LOCALIZER_HPP

namespace lumo::sense {

/// Locates one contact on a pad whose responses are known. Each response is judged by itself: of no contact, or of one
/// at a place and load of a grid, each a Gaussian about its template. Its covariance holds noise, lamps that drift one
/// by one and together, ambient light, the tool's shadow, and how far this pad may be from the templates': size, shape,
/// the silicone glued off along the finger, the map of the picture, the angle of the contact. A response is `unknown`,
/// and gives no place, where χ² says that the best of these does not explain it, or where any smooth change of light,
/// of whatever size and either sign, is the likelier explanation.
class TemplateLocalizer {
 public:
  struct Config {
    Eigen::VectorXd position_m;    ///< of the profile's values
    Eigen::VectorXd noise;         ///< standard deviation of each, unloaded
    Eigen::VectorXd unloaded;      ///< mean profile of the unloaded finger
    ResponseTemplates templates;   ///< in the profile's unit
    std::vector<double> lamp_m{};  ///< where the LEDs are, ascending; empty: they do not drift one by one
    double from_m = -27.5_mm, to_m = 27.5_mm, spacing_m = 0.5_mm;  ///< grid of places
    double least_load_N = 0.5;       ///< the grid's first load; the last is the templates'
    double load_ratio = 1.5;         ///< from load to load of the grid, about
    double lamp_sigma = 0.005;       ///< relative change of all lamps together; assumed, as all below
    double one_lamp_sigma = 0.005;   ///< of each lamp by itself
    double ambient_sigma = 0.3;      ///< change of ambient light, in the profile's unit
    double size_sigma = 0.25;        ///< of a response, relative to its template
    double shape_sigma = 0.08;       ///< of a response's value, relative to the template's largest
    double shape_length_m = 4.0_mm;  ///< over which errors of shape are alike
    double pad_sigma_m = 1.0_mm;     ///< how far off the silicone may be glued along the finger
    double map_sigma_m = 0.3_mm;     ///< of the map from the picture, where a response is seen
    double origin_sigma_m = 0.6_mm;  ///< of the LEDs on the finger, which no picture shows
    double most_size_sigmas = 3.0;   ///< that a response's size may be off its template's, or it is unknown
    /// Of the tool in the room's light, about the contact, in the profile's unit; 0: none. What lets shadows pass lets
    /// other pads' responses pass, too.
    double shadow_sigma = 0.0;
    double shadow_width_m = 10.0_mm;  ///< its standard deviation along the finger
    double false_alarm = 0.01;        ///< share of known responses that are called unknown, at most
    double least_probability = 0.99;  ///< of a contact against none, that one is reported
    double unknown_odds = 0.3;  ///< before anything is seen, of a change that is not the pad's against one that is
    double least_change = 0.25,
           most_change = 256.0;  ///< sizes of a change that is not the pad's, in the profile's unit
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit TemplateLocalizer(Config config);

  void reset() { fresh_ = true; }
  LocationEstimate update(const Profile& response);

  const Eigen::VectorXd& grid_m() const { return grid_; }
  const Eigen::VectorXd& loads_N() const { return loads_; }
  /// Posterior of the place given one contact, of the newest response; sums to 1.
  const Eigen::VectorXd& place() const { return place_; }
  /// χ² of the newest response under the template that explains it best and under no contact, and the limit beyond
  /// which it is unknown.
  double chi2_contact() const { return chi2_contact_; }
  double chi2_free() const { return chi2_free_; }
  double chi2_limit() const { return limit_; }
  /// Mean response to a contact at a grid's place, at a load: what the localiser expects.
  Eigen::VectorXd expected(double y_m, double load_N) const { return field_.at(config_.position_m, y_m, load_N).value; }

 private:
  static constexpr Eigen::Index most_components = 24;  ///< of a response, the smoothest ones, that are compared
  static constexpr Eigen::Index terms = 6;             ///< size, glue, map, way between places, angle, shadow
  static constexpr double most_cells = 1024.0;
  static constexpr double farthest = 1e6;  ///< standard deviations that a component may be off

  static void require_valid(const Config& c);
  void whiten();
  void lay_out_templates();
  void lay_out(Eigen::Index number, double y_m, double load_N);
  double log_odds_of_any_change() const;
  LocationEstimate answer(std::int64_t stamp_ns) const;

  Config config_;
  TemplateField field_;
  Eigen::VectorXd grid_, loads_;
  Eigen::MatrixXd to_components_;  ///< components × positions: unloaded scatter has unit variance in each
  Eigen::VectorXd smoothness_;     ///< of each component: variance of an error of shape of size 1
  // By template, the loads vary fastest: χ² = z²·weight − 2 z·matched + own − |narrow z|².
  Eigen::MatrixXd weight_, matched_;  ///< templates × components
  Eigen::MatrixXd narrow_;            ///< (templates · terms) × components
  Eigen::VectorXd own_, log_det_, noise_share_, peak_;
  Eigen::VectorXd component_, square_, chi2_, likelihood_, narrowed_, place_;
  double limit_ = 0.0, chi2_contact_ = 0.0, chi2_free_ = 0.0, log_odds_ = 0.0, log_odds_unknown_ = 0.0, size_off_ = 0.0;
  Eigen::Index best_ = 0;
  std::int64_t stamp_ns_ = 0;
  bool fresh_ = true;
};

inline TemplateLocalizer::TemplateLocalizer(Config config) : config_(std::move(config)), field_(config_.templates) {
  require_valid(config_);
  whiten();
  lay_out_templates();
}

inline void TemplateLocalizer::require_valid(const Config& c) {
  const Eigen::Index n = c.position_m.size();
  if (n < 3 || c.noise.size() != n || c.unloaded.size() != n)
    throw InvalidArgument(message("localiser has ", n, " positions, ", c.noise.size(), " noises and ",
        c.unloaded.size(), " unloaded values, must have as many, at least 3"));
  for (Eigen::Index i = 0; i < n; ++i) require_in_range("noise of a profile's value", c.noise[i], 1e-100, 1e100, "");
  require_ascending_positions(c.position_m);
  if (!is_usable({0, c.unloaded, 0.0})) throw InvalidArgument("localiser: unloaded values must be finite");
  for (std::size_t k = 0; k < c.lamp_m.size(); ++k) {
    require_in_range("place of a lamp", c.lamp_m[k], -10.0, 10.0, "m");
    if (k > 0) require_positive("way from lamp to lamp", c.lamp_m[k] - c.lamp_m[k - 1], "m");
  }
  require_positive("grid spacing", c.spacing_m, "m");
  require_in_range("grid's start", c.from_m, -10.0, 10.0, "m");
  require_in_range("grid's end", c.to_m, c.from_m + 2.0 * c.spacing_m, c.from_m + most_cells * c.spacing_m, "m");
  require_in_range("first load of the grid", c.least_load_N, 1e-3, 1e3, "N");
  require_in_range("ratio of the grid's loads", c.load_ratio, 1.05, 10.0, "");
  require_in_range("relative change of the lamps", c.lamp_sigma, 0.0, 1e3, "");
  require_in_range("relative change of one lamp", c.one_lamp_sigma, 0.0, 1e3, "");
  require_in_range("change of ambient light", c.ambient_sigma, 0.0, 1e6, "");
  require_in_range("error of a response's size", c.size_sigma, 0.0, 1e3, "");
  require_in_range("error of a response's shape", c.shape_sigma, 0.0, 1e3, "");
  require_positive("length of an error of shape", c.shape_length_m, "m");
  require_in_range("shift of the pad", c.pad_sigma_m, 0.0, 1.0, "m");
  require_in_range("error of the map", c.map_sigma_m, 0.0, 1.0, "m");
  require_in_range("error of the LEDs' place", c.origin_sigma_m, 0.0, 1.0, "m");
  require_in_range("standard deviations of a response's size", c.most_size_sigmas, 0.1, 1e3, "");
  require_in_range("shadow of the tool", c.shadow_sigma, 0.0, 1e6, "");
  require_positive("width of the tool's shadow", c.shadow_width_m, "m");
  require_in_range("false alarms", c.false_alarm, 1e-9, 0.5, "");
  require_in_range("least probability of a contact", c.least_probability, 0.5, 1.0 - 1e-9, "");
  require_in_range("odds of a change that is not the pad's", c.unknown_odds, 1e-9, 1e9, "");
  require_positive("least change of light", c.least_change, "");
  require_in_range("largest change of light", c.most_change, c.least_change, 1e6, "");
}

/// Components in which the scatter of unloaded profiles is white and errors of shape are independent, the smoothest
/// first.
inline void TemplateLocalizer::whiten() {
  const Eigen::VectorXd &x = config_.position_m, &rest = config_.unloaded;
  const Eigen::Index n = x.size();
  Eigen::MatrixXd scatter = config_.noise.cwiseAbs2().asDiagonal();
  scatter.array() += config_.ambient_sigma * config_.ambient_sigma;
  scatter += config_.lamp_sigma * config_.lamp_sigma * rest * rest.transpose();
  const auto& lamps = config_.lamp_m;
  for (std::size_t k = 0; k < lamps.size(); ++k) {  // a lamp's share falls linearly to 0 at its neighbours
    Eigen::VectorXd light = rest;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (k > 0 && x[i] < lamps[k]) light[i] *= std::max(0.0, (x[i] - lamps[k - 1]) / (lamps[k] - lamps[k - 1]));
      if (k + 1 < lamps.size() && x[i] > lamps[k])
        light[i] *= std::max(0.0, (lamps[k + 1] - x[i]) / (lamps[k + 1] - lamps[k]));
    }
    scatter += config_.one_lamp_sigma * config_.one_lamp_sigma * light * light.transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> root(scatter);
  Eigen::MatrixXd shape(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j) {
      const double apart = (x[i] - x[j]) / config_.shape_length_m;
      shape(i, j) = std::exp(-0.5 * apart * apart);
    }
  const Eigen::MatrixXd half = root.matrixL().solve(shape);
  const Eigen::MatrixXd whole = root.matrixL().solve(half.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(0.5 * (whole + whole.transpose()));  // ascending
  const Eigen::Index m = std::min(n, most_components);
  const Eigen::MatrixXd smooth = axes.eigenvectors().rightCols(m).rowwise().reverse();
  smoothness_ = axes.eigenvalues().tail(m).reverse().cwiseMax(0.0);
  to_components_ = root.matrixL().transpose().solve(smooth).transpose();
}

inline void TemplateLocalizer::lay_out_templates() {
  const auto cells = Eigen::Index(std::floor((config_.to_m - config_.from_m) / config_.spacing_m + 0.5)) + 1;
  grid_ = Eigen::VectorXd::LinSpaced(cells, config_.from_m, config_.to_m);
  const double most = std::max(field_.max_load_N(), config_.least_load_N * config_.load_ratio);
  const auto loads =
      Eigen::Index(std::ceil(std::log(most / config_.least_load_N) / std::log(config_.load_ratio) - 1e-9)) + 1;
  loads_ = Eigen::VectorXd::LinSpaced(loads, std::log(config_.least_load_N), std::log(most)).array().exp();
  const Eigen::Index m = to_components_.rows(), count = cells * loads;
  weight_.resize(count, m);
  matched_.resize(count, m);
  narrow_.resize(count * terms, m);
  own_.resize(count);
  log_det_.resize(count);
  noise_share_.resize(count);
  peak_.resize(count);
  for (Eigen::Index i = 0; i < cells; ++i)
    for (Eigen::Index l = 0; l < loads; ++l) lay_out(i * loads + l, grid_[i], loads_[l]);
  place_ = Eigen::VectorXd::Constant(cells, 1.0 / double(cells));
  limit_ = chi_squared_quantile(double(m), 1.0 - config_.false_alarm);
}

/// What one template needs for its χ², by the matrix inversion lemma: a diagonal and a few terms.
inline void TemplateLocalizer::lay_out(Eigen::Index number, double y_m, double load_N) {
  const Eigen::VectorXd& x = config_.position_m;
  constexpr double step_m = 0.25_mm;
  const auto component = [&](const Eigen::VectorXd& v) { return Eigen::VectorXd(to_components_ * v); };
  const TemplateResponse here = field_.at(x, y_m, load_N);
  const Eigen::VectorXd before = field_.at(x, y_m - step_m, load_N).value,
                        after = field_.at(x, y_m + step_m, load_N).value,
                        left = field_.at(x.array() - step_m, y_m, load_N).value,
                        right = field_.at(x.array() + step_m, y_m, load_N).value;
  const Eigen::VectorXd by_place = (after - before) / (2.0 * step_m), along = (right - left) / (2.0 * step_m);
  const Eigen::VectorXd middle = component(here.value);
  Eigen::MatrixXd off(middle.size(), terms);
  off.col(0) = config_.size_sigma * middle;
  off.col(1) = config_.pad_sigma_m * component(by_place + along);  // pad and light move, LEDs and contact stay
  off.col(2) = config_.map_sigma_m * component(along);
  off.col(3) = component(here.doubt);
  off.col(4) = component(here.sideways);
  const Eigen::VectorXd away = (x.array() - y_m) / config_.shadow_width_m;
  off.col(5) = config_.shadow_sigma * component((-0.5 * away.array().square()).exp());
  Eigen::Index top = 0;
  const double largest = here.value.cwiseAbs().maxCoeff(&top), shape = config_.shape_sigma * largest;
  const Eigen::VectorXd diagonal = 1.0 + shape * shape * smoothness_.array();
  const Eigen::VectorXd inverse = diagonal.cwiseInverse();
  const Eigen::MatrixXd weighted = inverse.asDiagonal() * off;
  const Eigen::MatrixXd inner = Eigen::MatrixXd::Identity(terms, terms) + off.transpose() * weighted;
  const Eigen::LLT<Eigen::MatrixXd> root(inner);
  const auto explained = [&](const Eigen::VectorXd& v) {  // Σ⁻¹ v
    return Eigen::VectorXd(inverse.cwiseProduct(v) - weighted * root.solve(weighted.transpose() * v));
  };
  weight_.row(number) = inverse.transpose();
  narrow_.middleRows(number * terms, terms) = root.matrixL().solve(weighted.transpose());
  matched_.row(number) = explained(middle).transpose();
  own_[number] = middle.dot(matched_.row(number));
  log_det_[number] =
      diagonal.array().log().sum() + 2.0 * Eigen::VectorXd(root.matrixLLT().diagonal()).array().log().sum();
  const Eigen::VectorXd slope = component(by_place), aim = explained(slope);
  const double information = slope.dot(aim);
  noise_share_[number] = information > 0.0 ? std::min(1.0, aim.squaredNorm() / information) : 1.0;
  peak_[number] = here.value[top];
}

inline LocationEstimate TemplateLocalizer::update(const Profile& response) {
  if (response.value.size() != config_.position_m.size())
    throw InvalidArgument(
        message("response has ", response.value.size(), " values, the localiser ", config_.position_m.size()));
  if (!fresh_ && response.stamp_ns <= stamp_ns_) return answer(response.stamp_ns);
  if (!is_usable(response)) return answer(response.stamp_ns);
  fresh_ = false;
  stamp_ns_ = response.stamp_ns;
  component_.noalias() = to_components_ * response.value;
  component_ = component_.cwiseMax(-farthest).cwiseMin(farthest);
  square_ = component_.cwiseAbs2();
  chi2_free_ = square_.sum();
  narrowed_.noalias() = narrow_ * component_;
  chi2_.noalias() = weight_ * square_;
  chi2_.noalias() -= 2.0 * (matched_ * component_);
  const Eigen::Index count = own_.size(), loads = loads_.size();
  chi2_ += own_;
  for (Eigen::Index k = 0; k < count; ++k) chi2_[k] -= narrowed_.segment<terms>(k * terms).squaredNorm();
  likelihood_ = -0.5 * (chi2_ + log_det_);
  likelihood_.array() += 0.5 * chi2_free_;  // logarithms, against no contact
  const double top = likelihood_.maxCoeff(&best_);
  chi2_contact_ = chi2_[best_];
  size_off_ = config_.size_sigma * (matched_.row(best_).dot(component_) - own_[best_]);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < place_.size(); ++i) {
    place_[i] = (likelihood_.segment(i * loads, loads).array() - top).exp().sum();
    sum += place_[i];
  }
  place_ /= sum;
  log_odds_ = top + std::log(sum / double(count));
  log_odds_unknown_ = log_odds_of_any_change() + std::log(config_.unknown_odds);
  return answer(stamp_ns_);
}

/// Log of the Bayes factor of a smooth Gaussian change, its size unknown, against no contact.
inline double TemplateLocalizer::log_odds_of_any_change() const {
  double top = -std::numeric_limits<double>::infinity(), sum = 0.0;
  int sizes = 0;
  for (double size = config_.least_change; size <= config_.most_change * 1.0001; size *= 2.0) {
    double log_factor = 0.0;
    for (Eigen::Index i = 0; i < square_.size(); ++i) {
      const double more = size * size * smoothness_[i];
      log_factor += 0.5 * (square_[i] * more / (1.0 + more) - std::log1p(more));
    }
    sum = log_factor > top ? sum * std::exp(top - log_factor) + 1.0 : sum + std::exp(log_factor - top);
    top = std::max(top, log_factor);
    ++sizes;
  }
  return top + std::log(sum / sizes);
}

inline LocationEstimate TemplateLocalizer::answer(std::int64_t stamp_ns) const {
  LocationEstimate e{stamp_ns, 0, {}, 1.0};
  if (fresh_) return e;
  const double contact = 1.0 / (1.0 + std::exp(-std::clamp(log_odds_, -700.0, 700.0)));
  const bool touched = contact >= config_.least_probability;
  e.probability = touched ? contact : 1.0 - contact;
  // Gaussian sizes may be negative: a response that is upside down would be its template's of a size far off.
  const bool explained = std::min(chi2_contact_, chi2_free_) <= limit_ && log_odds_unknown_ <= std::max(log_odds_, 0.0);
  e.unknown = !explained || (touched && std::abs(size_off_) > config_.most_size_sigmas);
  if (e.unknown || !touched) return e;
  const GridMoments m = moments_about_mode(grid_, place_);
  const double cell2 = config_.spacing_m * config_.spacing_m / 12.0,
               origin2 = config_.origin_sigma_m * config_.origin_sigma_m, all = m.variance + cell2,
               noise = noise_share_[best_] * all;
  e.contacts = 1;
  e.contact[0] = {m.mean, all + origin2, peak_[best_], all - noise + origin2, noise};
  return e;
}

static_assert(LocationEstimator<TemplateLocalizer>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/localize/sensibility.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_SENSIBILITY_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LOCALIZE_SENSIBILITY_HPP

namespace lumo::sense {

/// How well contacts at one load can be located, by what the localiser says of its own templates.
struct Sensibility {
  double load_N = 0.0;
  double share = 0.0;         ///< of the places, at which a contact is located within `good_half_width_m`
  double half_width_m = 0.0;  ///< of the 90 % interval, median over the places with a location; 0: none has one
};

inline constexpr double good_half_width_m = 5.0_mm;  ///< of a 90 % interval: the width of the paper's regions
inline constexpr double least_sensible_share = 0.5;  ///< of the places; below, a pad is called insensible
inline constexpr double sensible_reach_m = 24.0_mm;  ///< places to both sides of the middle
inline constexpr double sensible_load_N = 5.0;       ///< at which a pad is judged

/// No picture is needed: templates and covariance alone decide which places can be distinguished.
inline Sensibility sensibility(TemplateLocalizer localizer, double load_N) {
  constexpr double half_of_90_percent = 1.6448536269514722;
  Sensibility s{load_N};
  std::vector<double> half_widths;
  int places = 0, good = 0;
  std::int64_t stamp_ns = 0;
  const Eigen::VectorXd grid = localizer.grid_m();
  localizer.reset();
  for (const double y : grid) {
    if (std::abs(y) > sensible_reach_m) continue;
    ++places;
    localizer.reset();
    const LocationEstimate e = localizer.update({++stamp_ns, localizer.expected(y, load_N), 0.0});
    if (e.contacts != 1) continue;
    half_widths.push_back(half_of_90_percent * std::sqrt(e.contact[0].variance_m2));
    good += half_widths.back() <= good_half_width_m;
  }
  if (places > 0) s.share = double(good) / places;
  if (!half_widths.empty()) s.half_width_m = median(half_widths);
  return s;
}

/// Can contacts on the pad be located at all?
inline bool is_sensible(const Sensibility& s) { return s.share >= least_sensible_share; }

/// The localiser of computed templates before any picture is seen: its light at rest has the mean `level_DN`, and a
/// value scatters by `noise_DN`, as in pictures of 640 × 480 (assumed). Throws InvalidArgument for templates without
/// light at rest.
inline TemplateLocalizer unseen_localizer(const ResponseTemplates& templates, const Eigen::VectorXd& position_m,
    const std::vector<double>& lamp_m, double level_DN = 70.0, double noise_DN = 0.2) {
  TemplateLocalizer::Config c;
  c.position_m = position_m;
  c.noise = Eigen::VectorXd::Constant(position_m.size(), noise_DN);
  c.templates = templates;
  c.unloaded = TemplateField(templates).unloaded_at(position_m);
  if (c.unloaded.size() == 0)
    throw InvalidArgument("templates have no light at rest, which gives responses their size");
  const double scale = level_DN / c.unloaded.mean();
  c.unloaded *= scale;
  for (auto* list : {&c.templates.value, &c.templates.sideways})
    for (Eigen::MatrixXd& m : *list) m *= scale;
  c.lamp_m = lamp_m;
  return TemplateLocalizer(c);
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/effort_check.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_EFFORT_CHECK_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_EFFORT_CHECK_HPP

namespace lumo::sense {

/// Limits of what is believed of a driver's efforts.
struct EffortLimits {
  double most = 1e6;          ///< [A or N·m]; beyond, a number is no effort
  double milli_from = 100.0;  ///< median magnitude beyond which amperes are milliamperes; no finger's motor holds it
  double wrap = 65536.0;      ///< of unsigned 16 bits …
  double wrap_near = 0.25;    ///< … and the share of it that values stay away from both ends
  double limit_share = 0.01;  ///< of the samples at their very largest or smallest value, beyond which that is a limit
  std::size_t least_limit = 20;
  double stuck_s = 1.0;       ///< the very same value for so long …
  double stuck_share = 0.02;  ///< … in this share of the log, in joints whose values change otherwise
};

/// What speaks against the efforts of a joint.
struct EffortCheck {
  bool never_changes = false;
  bool milli = false;        ///< milliamperes are given for amperes
  bool wraps = false;        ///< negative values of 16 bits are read as unsigned
  double limit = 0.0;        ///< value at which the driver or its controller stops; 0: none
  double at_limit = 0.0;     ///< share of the samples there
  double stuck_share = 0.0;  ///< of the log, in stretches that are stuck
};

namespace detail {

/// Share of the samples whose effort stays the very same for longer than `stuck_s`.
inline double stuck_share(std::span<const JointSample> samples, int joint, double stuck_s) {
  std::size_t stuck = 0, from = 0;
  for (std::size_t i = 1; i <= samples.size(); ++i)
    if (i == samples.size() || samples[i].effort[joint] != samples[from].effort[joint]) {
      if (1e-9 * double(samples[i - 1].stamp_ns - samples[from].stamp_ns) > stuck_s) stuck += i - from;
      from = i;
    }
  return double(stuck) / double(samples.size());
}

}  // namespace detail

/// Throws InvalidArgument for a joint that the samples do not have, or efforts that are not finite or beyond `most`.
inline EffortCheck check_effort(std::span<const JointSample> samples, int joint, const EffortLimits& limits = {}) {
  EffortCheck check;
  std::vector<double> effort, magnitude;
  for (const JointSample& s : samples) {
    if (joint < 0 || joint >= s.effort.size()) throw InvalidArgument(message("efforts: there is no joint ", joint));
    const double e = s.effort[joint];
    require_in_range("effort", e, -limits.most, limits.most, s.unit == Effort::current_A ? "A" : "N·m");
    effort.push_back(e);
    magnitude.push_back(std::abs(e));
  }
  if (effort.size() < 2) return check;
  const auto [least, most] = std::minmax_element(effort.begin(), effort.end());
  check.never_changes = *least == *most;
  if (check.never_changes) return check;
  const auto high = std::count_if(effort.begin(), effort.end(),
      [&](double e) { return e > (1.0 - limits.wrap_near) * limits.wrap && e < limits.wrap; });
  const auto low = std::count_if(
      effort.begin(), effort.end(), [&](double e) { return e >= 0.0 && e < limits.wrap_near * limits.wrap; });
  check.wraps = high > 0 && low > 0 && std::size_t(high + low) == effort.size();
  check.milli = !check.wraps && samples.front().unit == Effort::current_A && median(magnitude) > limits.milli_from;
  for (const double end : {*least, *most})
    if (const auto there = std::count(effort.begin(), effort.end(), end);
        std::size_t(there) >= limits.least_limit && double(there) > limits.limit_share * double(effort.size()) &&
        double(there) > check.at_limit * double(effort.size()) && std::abs(end) > median(magnitude)) {
      check.limit = end;
      check.at_limit = double(there) / double(effort.size());
    }
  check.stuck_share = detail::stuck_share(samples, joint, limits.stuck_s);
  if (check.stuck_share < limits.stuck_share) check.stuck_share = 0.0;
  return check;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/contact_jacobian.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_CONTACT_JACOBIAN_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_CONTACT_JACOBIAN_HPP

namespace lumo::sense {

/// A place on the pad of one of the links.
struct ContactPoint {
  int link = 0;      ///< counted from the base; the link after joint `link`
  double y_m = 0.0;  ///< finger coordinate on it
};

/// A stretch of one link's pad on which contacts are looked for.
struct PadRange {
  int link = 0;
  double from_m = -27.5e-3, to_m = 27.5e-3;  ///< finger coordinates; the paper's 11 regions of 5 mm

  double middle_m() const { return 0.5 * (from_m + to_m); }
};

/// How a normal force on a pad shows in the motors. The force is that of the object on the finger, against the pad's
/// outward normal, at the contact point; `column` is the torque that the motors add to hold it, n × 1 [N·m per N = m],
/// positive along each joint's axis. Laws: joints beyond the contact's link carry nothing; `slope` is the derivative of
/// `column` by y_m.
template <class J>
concept ContactJacobian = requires(const J& j, const JointVector& q, const ContactPoint& c) {
  { j.joints() } -> std::convertible_to<int>;
  { j.column(q, c) } -> std::same_as<JointVector>;
  { j.slope(q, c) } -> std::same_as<JointVector>;
};

/// Throws InvalidArgument for a place or an angle that is not finite.
inline void require_finite_pose(const JointVector& q, const ContactPoint& c) {
  require_finite("place of a contact", c.y_m, "m");
  for (const double angle : q) require_finite("angle of a joint", angle, "rad");
}

/// Torques of unit normal forces at several contacts, joints × contacts [m].
template <ContactJacobian J>
Eigen::MatrixXd contact_columns(const J& jacobian, const JointVector& q, std::span<const ContactPoint> contacts) {
  Eigen::MatrixXd a(jacobian.joints(), Eigen::Index(contacts.size()));
  for (std::size_t i = 0; i < contacts.size(); ++i) a.col(Eigen::Index(i)) = jacobian.column(q, contacts[i]);
  return a;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/planar_finger.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_PLANAR_FINGER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_PLANAR_FINGER_HPP

namespace lumo::sense {

/// One joint whose axis crosses the finger at right angles: the torque is force times distance.
struct MomentArm {
  double joint_to_origin_m = 0.05;  ///< from the joint's axis to the finger's origin, along y
  double sign = 1.0;                ///< −1 where the motor turns the other way: positive torque lifts the pad off

  int joints() const { return 1; }
  /// Throws InvalidArgument for numbers that are not finite.
  JointVector column(const JointVector&, const ContactPoint& c) const {
    const double arm_m = sign * (joint_to_origin_m + c.y_m);
    require_finite("moment arm of a contact", arm_m, "m");
    return JointVector::Constant(1, arm_m);
  }
  JointVector slope(const JointVector&, const ContactPoint&) const { return JointVector::Constant(1, sign); }
};

static_assert(ContactJacobian<MomentArm>);

/// A finger whose joints have parallel axes across it, its pad on the last link; at angle 0 all lie on one line along
/// y, and positive angles turn the tip towards the pad's outward normal. With one joint it is the moment arm. Lengths
/// in m.
class PlanarFinger {
 public:
  /// `joint_to_joint_m`: from each joint's axis to the next one's; `joint_to_origin_m`: from the last one's to the
  /// pad's origin. Throws InvalidArgument.
  PlanarFinger(std::vector<double> joint_to_joint_m, double joint_to_origin_m)
      : way_m_(std::move(joint_to_joint_m)), last_m_(joint_to_origin_m) {
    if (way_m_.size() >= std::size_t(max_joints))
      throw InvalidArgument(
          message("planar finger has ", way_m_.size() + 1, " joints, must have at most ", max_joints));
    for (const double l : way_m_) require_in_range("way from joint to joint", 1e3 * l, 0.0, 10000.0, "mm");
    require_in_range("way from joint to origin", 1e3 * std::abs(last_m_), 0.0, 10000.0, "mm");
  }

  int joints() const { return int(way_m_.size()) + 1; }
  int pad_link() const { return joints() - 1; }

  /// Seen from a joint, the normal force at y acts on the way along the pad's link to y, and on that part of each link
  /// between which lies along the pad's.
  JointVector column(const JointVector& q, const ContactPoint& c) const {
    check(q, c);
    JointVector torque = JointVector::Constant(joints(), last_m_ + c.y_m);
    double turn = 0.0;  // of the pad's link against the one looked at
    for (int j = joints() - 2; j >= 0; --j) {
      turn += q[j + 1];
      torque.head(j + 1).array() += way_m_[std::size_t(j)] * std::cos(turn);
    }
    return torque;
  }
  JointVector slope(const JointVector& q, const ContactPoint& c) const {
    check(q, c);
    return JointVector::Ones(joints());
  }

 private:
  void check(const JointVector& q, const ContactPoint& c) const {
    if (c.link != pad_link())
      throw InvalidArgument(message("contact lies on link ", c.link, ", the planar finger's pad on link ", pad_link()));
    if (q.size() != joints())
      throw InvalidArgument(message("planar finger has ", joints(), " joints, got ", q.size(), " angles"));
    require_finite_pose(q, c);
  }
  std::vector<double> way_m_;
  double last_m_;
};

static_assert(ContactJacobian<PlanarFinger>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/serial_chain.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_SERIAL_CHAIN_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_SERIAL_CHAIN_HPP

namespace lumo::sense {

/// Revolute joints in a row, each with one link that may carry a pad.
class SerialChain {
 public:
  struct Link {
    Eigen::Isometry3d joint = Eigen::Isometry3d::Identity();   ///< pose of the joint's frame in the frame of the link
                                                               ///< before (or the base), at angle 0
    Vec3d axis = Vec3d::UnitX();                               ///< of rotation, in the joint's frame; unit
    Eigen::Isometry3d finger = Eigen::Isometry3d::Identity();  ///< pose of the pad's finger frame (y along it, z out of
                                                               ///< it) in the joint's frame
  };

  /// Throws InvalidArgument for no or too many links, or numbers out of range.
  explicit SerialChain(std::vector<Link> links) : links_(std::move(links)) {
    if (links_.empty() || links_.size() > std::size_t(max_joints))
      throw InvalidArgument(message("serial chain has ", links_.size(), " links, must have 1 to ", max_joints));
    for (Link& l : links_) {
      if (!l.joint.matrix().allFinite() || !l.finger.matrix().allFinite())
        throw InvalidArgument("serial chain: poses must be finite");
      for (const Eigen::Isometry3d& pose : {l.joint, l.finger})
        if ((pose.linear().transpose() * pose.linear() - Mat3d::Identity()).norm() > 1e-6 ||
            pose.linear().determinant() < 0.0)
          throw InvalidArgument("serial chain: poses must turn and move, not stretch or mirror");
      require_positive("length of a joint's axis", l.axis.norm(), "");
      l.axis.normalize();
    }
  }

  int joints() const { return int(links_.size()); }

  JointVector column(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c);
    const Eigen::Isometry3d& finger = p.finger;
    return torques(p, finger * Vec3d(0.0, c.y_m, 0.0), finger.linear().col(2), true);
  }
  JointVector slope(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c);
    const Eigen::Isometry3d& finger = p.finger;
    return torques(p, finger.linear().col(1), finger.linear().col(2), false);
  }
  /// Where the contact is, in the base's frame [m].
  Vec3d position(const JointVector& q, const ContactPoint& c) const {
    return pose(q, c).finger * Vec3d(0.0, c.y_m, 0.0);
  }
  /// Outward normal of the pad there, in the base's frame.
  Vec3d normal(const JointVector& q, const ContactPoint& c) const {
    const Eigen::Isometry3d finger = pose(q, c).finger;
    return finger.linear().col(2);
  }

 private:
  struct Pose {
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, max_joints> axis,
        origin;  ///< of the joints up to the contact's
    Eigen::Isometry3d finger;
  };

  Pose pose(const JointVector& q, const ContactPoint& c) const {
    const int link = c.link;
    if (link < 0 || link >= joints())
      throw InvalidArgument(message("contact lies on link ", link, ", the chain has ", joints()));
    if (q.size() != joints())
      throw InvalidArgument(message("chain has ", joints(), " joints, got ", q.size(), " angles"));
    require_finite_pose(q, c);
    Pose p;
    p.axis.resize(3, link + 1);
    p.origin.resize(3, link + 1);
    Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
    for (int i = 0; i <= link; ++i) {
      const Link& l = links_[std::size_t(i)];
      frame = frame * l.joint;
      p.axis.col(i) = frame.linear() * l.axis;
      p.origin.col(i) = frame.translation();
      frame.rotate(Eigen::AngleAxisd(q[i], l.axis));
    }
    p.finger = frame * links_[std::size_t(link)].finger;
    return p;
  }

  /// The motors balance a force −n at `place`: axis · ((place − origin) × n). Directions have no origin.
  JointVector torques(const Pose& p, const Vec3d& place, const Vec3d& n, bool is_place) const {
    JointVector t = JointVector::Zero(joints());
    for (Eigen::Index i = 0; i < p.axis.cols(); ++i) {
      const Vec3d arm = is_place ? Vec3d(place - p.origin.col(i)) : place;
      t[i] = p.axis.col(i).dot(arm.cross(n));
    }
    return t;
  }

  std::vector<Link> links_;
};

static_assert(ContactJacobian<SerialChain>);

}  // namespace lumo::sense

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

// ---- lumo/sense/force/contact_filter.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_CONTACT_FILTER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_CONTACT_FILTER_HPP

namespace lumo::sense {

/// Kalman filter of a random walk x that is seen together with a slowly changing offset b (first-order Gauss–Markov):
/// two states, linear, exact. The offset keeps many equal measurements (a motor that sticks, frames of one peak) from
/// counting as independent ones.
struct OffsetWalk {
  double x = 0.0, b = 0.0;
  double xx = 0.0, xb = 0.0, bb = 0.0;  ///< covariance

  /// `walk`: growth of the variance of x per second, up to `most`. `offset`: stationary variance of b, which forgets
  /// within `time_s`.
  void predict(double dt, double walk, double most, double offset, double time_s) {
    const double keep = std::exp(-dt / time_s);
    b *= keep;
    xb *= keep;
    bb = keep * keep * bb + (1.0 - keep * keep) * offset;
    xx += walk * dt;
    if (xx > most) {
      xb *= std::sqrt(most / xx);
      xx = most;
    }
  }
  /// Takes z = x + share · b + noise.
  void update(double z, double variance, double share = 1.0) {
    const double px = xx + share * xb, pb = xb + share * bb, s = px + share * pb + variance;
    const double innovation = (z - x - share * b) / s;
    x += px * innovation;
    b += pb * innovation;
    xx = std::max(xx - px * px / s, 0.0);
    bb = std::max(bb - pb * pb / s, 0.0);
    xb -= px * pb / s;
  }
  /// Variance of what is seen, without noise.
  double seen() const { return xx + 2.0 * xb + bb; }
};

/// Place and normal force of one contact with their covariance.
struct ContactBelief {
  double y_m = 0.0;
  double force_N = 0.0;
  Eigen::Matrix2d covariance{{0.0, 0.0}, {0.0, 0.0}};  ///< of (y [m], F [N])
};

/// Settings of a ContactFilter.
struct ContactFilterConfig {
  int link = 0;
  double from_m = -27.5_mm, to_m = 27.5_mm;  ///< of the pad: the prior of y is uniform on it
  double creep_m_per_sqrt_s = 5.0_mm;        ///< random walk of y
  double torque_Nm_per_sqrt_s = 0.3;         ///< random walk of the contact's torques
  double torque_prior_Nm = 2.0, force_prior_N = 100.0;
  double location_bias_m = 1.0_mm,
         location_bias_s = 0.5;  ///< standard deviation and time constant of the localiser's offset
  double torque_bias_Nm = 0.02, torque_bias_s = 5.0;  ///< of the torques'; assumed
  double no_contact_Nm = 0.01;                        ///< torque of what may act on the pad unseen
  double jump_gate = 5.0;     ///< a location or torque this many standard deviations off is a new contact or load
  std::size_t history = 512;  ///< measurements that a late one may precede
  static constexpr double outside_m = 5.0_mm;  ///< how far beyond the pad's ends a place may be estimated
  // Gauss–Newton for place and force: iterations, and steps after which no further one is made.
  static constexpr int iterations = 8;
  static constexpr double place_step_m = 1e-9, force_step_N = 1e-7;
};

/// Fuses contact locations and joint torques, which come at different rates and with different delays. The filters hold
/// what is measured: y, and the contact's torque on each joint, each with the offset of its sensor; they are linear.
/// Place and force follow from them when asked (posterior mode, Gauss–Newton), so that no linearisation about an old
/// guess remains: an extended Kalman filter on (y, F) would come to believe that one joint's torque gives the place.
/// The torque's offset is learnt while nothing touches. A late measurement is inserted at its time, and later ones are
/// applied again.
template <ContactJacobian Jacobian> class ContactFilter {
 public:
  using Config = ContactFilterConfig;

  /// Throws InvalidArgument for numbers out of range.
  explicit ContactFilter(Jacobian jacobian, const Config& config = {});

  /// Contact torques (motor minus torque model) of all joints with the variances of their noises. False: older than the
  /// history, ignored. Throws InvalidArgument, as add_location does, for numbers that are not finite or belong to no
  /// finger.
  bool add_torque(std::int64_t stamp_ns, const JointVector& torque_Nm, const JointVector& variance) {
    if (torque_Nm.size() != jacobian_.joints() || variance.size() != jacobian_.joints())
      throw InvalidArgument(message("contact filter has ", jacobian_.joints(), " joints, got ", torque_Nm.size(),
          " torques and ", variance.size(), " variances"));
    for (Eigen::Index j = 0; j < torque_Nm.size(); ++j) {
      require_in_range("contact torque", torque_Nm[j], -1e9, 1e9, "N·m");
      require_in_range("variance of a contact torque", variance[j], 1e-18, 1e12, "N²·m²");
    }
    return add({stamp_ns, Kind::torque, torque_Nm, variance, 0.0, 0.0, {}});
  }
  /// Location with the variance of its noise, without the localiser's offset.
  bool add_location(std::int64_t stamp_ns, double y_m, double variance_m2) {
    require_in_range("place of a contact", y_m, -10.0, 10.0, "m");
    require_in_range("variance of a place", variance_m2, 1e-18, 100.0, "m²");
    return add({stamp_ns, Kind::location, {}, {}, y_m, variance_m2, {}});
  }
  /// Nothing touches the finger.
  bool add_no_contact(std::int64_t stamp_ns) { return add({stamp_ns, Kind::no_contact, {}, {}, 0.0, 0.0, {}}); }

  /// At a time not before the last measurement's (prediction only), at joint angles q.
  ContactBelief at(std::int64_t stamp_ns, const JointVector& q) const;
  /// Offset of a joint's torque that has been learnt [N·m].
  double torque_offset(int joint) const { return last().torque[std::size_t(joint)].b; }
  void reset() {
    begin_ = 0;
    size_ = 0;
    started_ = false;
  }
  const Jacobian& jacobian() const { return jacobian_; }

 private:
  static constexpr double least_variance = 1e-14;  ///< [m² or N²·m²] of what is known exactly: keeps weights finite

  enum class Kind { torque, location, no_contact };
  struct Seen {
    std::int64_t stamp_ns = 0;
    OffsetWalk place;
    std::array<OffsetWalk, std::size_t(max_joints)> torque;
  };
  struct Event {
    std::int64_t stamp_ns;
    Kind kind;
    JointVector torque, torque_variance;
    double y, y_variance;
    Seen after;
  };

  Event& event(std::size_t i) { return events_[(begin_ + i) % events_.size()]; }
  const Event& event(std::size_t i) const { return events_[(begin_ + i) % events_.size()]; }
  const Seen& last() const { return size_ ? event(size_ - 1).after : prior_; }
  double pad_variance() const { return (config_.to_m - config_.from_m) * (config_.to_m - config_.from_m) / 12.0; }
  bool add(Event e) {
    if (!started_) {
      prior_.stamp_ns = e.stamp_ns;
      started_ = true;
    }
    if (e.stamp_ns < prior_.stamp_ns) return false;
    if (size_ == events_.size()) {  // the oldest measurement becomes part of the prior
      if (e.stamp_ns < event(0).stamp_ns) return false;
      prior_ = event(0).after;
      begin_ = (begin_ + 1) % events_.size();
      --size_;
    }
    std::size_t place = size_++;
    for (; place > 0 && event(place - 1).stamp_ns > e.stamp_ns; --place) event(place) = event(place - 1);
    event(place) = std::move(e);
    for (std::size_t i = place; i < size_; ++i) {
      Event& now = event(i);
      now.after = i ? event(i - 1).after : prior_;
      predict(now.after, now.stamp_ns);
      apply(now.after, now);
    }
    return true;
  }
  void predict(Seen& s, std::int64_t stamp_ns) const {
    const double dt = 1e-9 * double(stamp_ns - s.stamp_ns);
    if (!(dt > 0.0)) return;
    s.stamp_ns = stamp_ns;
    const auto square = [](double v) { return v * v; };
    s.place.predict(dt, square(config_.creep_m_per_sqrt_s), pad_variance(), square(config_.location_bias_m),
        config_.location_bias_s);
    for (int j = 0; j < jacobian_.joints(); ++j)
      s.torque[std::size_t(j)].predict(dt, square(config_.torque_Nm_per_sqrt_s), square(config_.torque_prior_Nm),
          square(config_.torque_bias_Nm), config_.torque_bias_s);
  }
  void apply(Seen& s, const Event& e) const {
    if (e.kind == Kind::location) {
      const double off = e.y - s.place.x - s.place.b;
      if (off * off > config_.jump_gate * config_.jump_gate * (s.place.seen() + e.y_variance))  // another contact
        s.place = {e.y, 0.0, pad_variance(), 0.0, config_.location_bias_m * config_.location_bias_m};
      s.place.update(e.y, e.y_variance);
    } else {
      for (int j = 0; j < jacobian_.joints(); ++j) {
        OffsetWalk& t = s.torque[std::size_t(j)];
        if (e.kind == Kind::torque) {
          const double off = e.torque[j] - t.x - t.b;
          // Loads jump, offsets do not.
          if (off * off > config_.jump_gate * config_.jump_gate * (t.seen() + e.torque_variance[j])) {
            t.xx = config_.torque_prior_Nm * config_.torque_prior_Nm;
            t.xb = 0.0;
          }
          t.update(e.torque[j], e.torque_variance[j]);
        } else {
          t.update(0.0, config_.no_contact_Nm * config_.no_contact_Nm, 0.0);
        }
      }
    }
  }

  Jacobian jacobian_;
  Config config_;
  std::vector<Event> events_;  ///< ring, in the order of stamps
  std::size_t begin_ = 0, size_ = 0;
  Seen prior_;
  bool started_ = false;
};

template <ContactJacobian Jacobian> ContactFilter<Jacobian>::ContactFilter(Jacobian jacobian, const Config& config)
    : jacobian_(std::move(jacobian)), config_(config) {
  require_in_range("pad's end", config.to_m, config.from_m, 10.0, "m");
  require_in_range("joints of the Jacobian", jacobian_.joints(), 1, max_joints, "");
  using Row = std::tuple<const char*, double, const char*>;
  for (const auto& [what, value, unit] : {Row{"creep of the contact", config.creep_m_per_sqrt_s, "m/sqrt(s)"},
           Row{"random walk of the torque", config.torque_Nm_per_sqrt_s, "N·m/sqrt(s)"},
           Row{"prior of the torque", config.torque_prior_Nm, "N·m"},
           Row{"prior of the force", config.force_prior_N, "N"},
           Row{"time of the localiser's offset", config.location_bias_s, "s"},
           Row{"time of the torque's offset", config.torque_bias_s, "s"},
           Row{"torque without contact", config.no_contact_Nm, "N·m"}, Row{"jump gate", config.jump_gate, ""}})
    require_positive(what, value, unit);
  require_in_range("offset of the localiser", config.location_bias_m, 0.0, 1.0, "m");
  require_in_range("offset of the torque", config.torque_bias_Nm, 0.0, 1e3, "N·m");
  require_in_range("history of the filter", double(config.history), 2.0, 1e6, "measurements");
  events_.resize(config.history);
  prior_.place = {
      0.5 * (config.from_m + config.to_m), 0.0, pad_variance(), 0.0, config.location_bias_m * config.location_bias_m};
  prior_.torque.fill(
      {0.0, 0.0, config.torque_prior_Nm * config.torque_prior_Nm, 0.0, config.torque_bias_Nm * config.torque_bias_Nm});
}

template <ContactJacobian Jacobian>
ContactBelief ContactFilter<Jacobian>::at(std::int64_t stamp_ns, const JointVector& q) const {
  Seen s = last();
  predict(s, stamp_ns);
  const int n = jacobian_.joints();
  const double place = s.place.x, place_weight = 1.0 / std::max(s.place.xx, least_variance),
               force_weight = 1.0 / (config_.force_prior_N * config_.force_prior_N);
  // Mode of exp(−½ [(y − place)²/P_y + Σ (T_j − F a_j(y))²/P_j + F²/P_F]).
  ContactBelief belief;
  double y = place, force = 0.0;
  Eigen::Matrix2d information;
  for (int k = 0; k < Config::iterations; ++k) {
    const double inside = std::clamp(y, config_.from_m, config_.to_m);
    const JointVector a = jacobian_.column(q, {config_.link, inside}),
                      slope = jacobian_.slope(q, {config_.link, inside});
    double aa = force_weight, at = 0.0;
    for (int j = 0; j < n; ++j) {
      const OffsetWalk& t = s.torque[std::size_t(j)];
      const double weight = 1.0 / std::max(t.xx, least_variance);
      aa += weight * a[j] * a[j];
      at += weight * a[j] * t.x;
    }
    if (k == 0) force = at / aa;  // of that place
    information << place_weight, 0.0, 0.0, aa;
    Eigen::Vector2d gradient(place_weight * (place - y), at - aa * force);
    for (int j = 0; j < n; ++j) {
      const OffsetWalk& t = s.torque[std::size_t(j)];
      const double weight = 1.0 / std::max(t.xx, least_variance), h = slope[j] * force;
      information(0, 0) += weight * h * h;
      information(0, 1) += weight * h * a[j];
      gradient[0] += weight * h * (t.x - a[j] * force);
    }
    information(1, 0) = information(0, 1);
    belief.covariance = information.inverse();
    const Eigen::Vector2d step = belief.covariance * gradient;
    y = std::clamp(y + step[0], config_.from_m - Config::outside_m, config_.to_m + Config::outside_m);
    force += step[1];
    if (std::abs(step[0]) < Config::place_step_m && std::abs(step[1]) < Config::force_step_N) break;
  }
  belief.y_m = y;
  belief.force_N = force;
  return belief;
}

}  // namespace lumo::sense

#endif

// ---- lumo/core/golden_section.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_GOLDEN_SECTION_HPP
#define SINGLE_INCLUDE_LUMO_CORE_GOLDEN_SECTION_HPP

namespace lumo {

/// Where a function of one number is least between a and b, if it has one minimum there: `steps` sections, each of
/// which leaves 0.618 of the stretch. Source: Kiefer 1953.
template <class Function> double golden_section(Function function, double a, double b, int steps) {
  constexpr double golden = 0.61803398874989484820;
  for (int k = 0; k < steps; ++k) {
    const double c = b - golden * (b - a), d = a + golden * (b - a);
    if (function(c) <= function(d)) b = d;
    else a = c;
  }
  return 0.5 * (a + b);
}

}  // namespace lumo

#endif

// ---- lumo/sense/devices/faults.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DEVICES_FAULTS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DEVICES_FAULTS_HPP

namespace lumo::sense {

/// What can be wrong with a finger's two streams. The first block concerns frames, the second joint samples.
enum class Fault : std::uint32_t {
  frame_dropped,   ///< a frame is missing between two
  frames_missing,  ///< none for longer than the limit
  frame_repeated,  ///< the same picture or the same stamp again
  frame_late,      ///< older than allowed when it came
  frame_time,      ///< its stamp runs backwards or lies in the future
  frame_corrupt,   ///< wrong size or format, or light that no contact makes
  frame_black,
  frame_saturated,
  led_dead,          ///< dark about one LED
  exposure_changed,  ///< by its metadata, or all lights together
  response_unknown,  ///< light that is neither no contact nor any that the localiser knows (TemplateLocalizer)
  camera_lost,       ///< the source has failed
  joint_dropped,
  joint_missing,
  joint_time,
  joint_not_finite,  ///< a value is not a number, or the number of joints is another
  torque_stuck,      ///< the very same effort for too long
  torque_spike,
  torque_saturated,  ///< beyond the motor's range, or at the end of its driver's
  position_jump,     ///< faster, or farther, than the joint can turn
  actuator_lost,
  count
};

/// A set of faults.
class Faults {
 public:
  void add(Fault f) { bits_ |= 1u << unsigned(f); }
  bool has(Fault f) const { return bits_ >> unsigned(f) & 1u; }
  bool any() const { return bits_ != 0; }
  Faults& operator|=(Faults o) {
    bits_ |= o.bits_;
    return *this;
  }
  bool operator==(const Faults&) const = default;

 private:
  std::uint32_t bits_ = 0;
};

/// Names, separated by spaces.
inline std::string to_string(Faults faults) {
  static constexpr std::array<const char*, std::size_t(Fault::count)> names{"frame_dropped", "frames_missing",
      "frame_repeated", "frame_late", "frame_time", "frame_corrupt", "frame_black", "frame_saturated", "led_dead",
      "exposure_changed", "response_unknown", "camera_lost", "joint_dropped", "joint_missing", "joint_time",
      "joint_not_finite", "torque_stuck", "torque_spike", "torque_saturated", "position_jump", "actuator_lost"};
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (faults.has(Fault(i))) text += (text.empty() ? "" : " ") + std::string(names[i]);
  return text;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/torque_model.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_TORQUE_MODEL_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_TORQUE_MODEL_HPP

namespace lumo::sense {

/// Parameters from a linear least-squares problem, with what the data leave open.
struct Identification {
  Eigen::VectorXd value;       ///< of least norm in units of the scales: nothing is added along null directions
  Eigen::MatrixXd covariance;  ///< along the identified directions only
  Eigen::Index rank = 0;
  Eigen::MatrixXd
      null_space;  ///< parameters × (parameters − rank), unit columns in units of the scales: may be added at will
  double residual = 0.0;  ///< RMS of what the fit leaves

  Eigen::Index unknowns() const { return value.size(); }
  bool complete() const { return rank == unknowns(); }
};

/// Solves a x ≈ b for equal, independent errors. `scale` makes parameters of unlike units comparable (a typical size of
/// each). Singular values below `tolerance` times the largest do not count. `sigma`: standard deviation of an entry of
/// b; where it is 0, that of the residual is taken. `known` > 0: nor do directions whose standard deviation exceeds
/// that many scales, for which the data add nothing to what was known before. Throws InvalidArgument for shapes that do
/// not fit or numbers that are not finite.
inline Identification identify(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, const Eigen::VectorXd& scale,
    double sigma = 0.0, double tolerance = 1e-6, double known = 0.0) {
  const Eigen::Index n = a.cols();
  if (n < 1 || a.rows() != b.size() || scale.size() != n)
    throw InvalidArgument(message("identification has ", a.rows(), " × ", n, " coefficients, ", b.size(),
        " observations and ", scale.size(), " scales"));
  if (!a.allFinite() || !b.allFinite() || !(scale.array() > 0.0).all() || !(scale.array() <= 1e100).all())
    throw InvalidArgument("identification: numbers must be finite, scales positive and at most 1e100");
  require_in_range("standard deviation of an observation", sigma, 0.0, 1e100, "");
  require_in_range("tolerance of the identification", tolerance, 0.0, 1.0, "");
  require_in_range("known scales of the identification", known, 0.0, 1e100, "");
  Identification r;
  const Eigen::MatrixXd scaled = a * scale.asDiagonal();
  if (a.rows() == 0 || scaled.cwiseAbs().maxCoeff() == 0.0) {
    r.value = Eigen::VectorXd::Zero(n);
    r.covariance = Eigen::MatrixXd::Zero(n, n);
    r.null_space = Eigen::MatrixXd::Identity(n, n);
    r.residual = b.size() ? b.norm() / std::sqrt(double(b.size())) : 0.0;
    return r;
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeFullV);
  const Eigen::VectorXd& s = svd.singularValues();
  r.rank = (s.array() > tolerance * s[0]).count();
  const Eigen::VectorXd projection = svd.matrixU().transpose() * b;
  const auto deviation = [&] {
    const double left = std::max(b.squaredNorm() - projection.head(r.rank).squaredNorm(), 0.0);
    return sigma > 0.0 ? sigma : b.size() > r.rank ? std::sqrt(left / double(b.size() - r.rank)) : 0.0;
  };
  while (known > 0.0 && r.rank > 0 && deviation() > known * s[r.rank - 1]) --r.rank;
  const Eigen::MatrixXd v = svd.matrixV().leftCols(r.rank);
  const Eigen::VectorXd inverse = s.head(r.rank).cwiseInverse();
  r.value = scale.asDiagonal() * (v * inverse.cwiseProduct(projection.head(r.rank)));
  r.null_space = svd.matrixV().rightCols(n - r.rank);
  const double left = (a * r.value - b).squaredNorm();
  r.residual = std::sqrt(left / double(b.size()));
  const double variance = sigma > 0.0 ? sigma * sigma : b.size() > r.rank ? left / double(b.size() - r.rank) : 0.0;
  const Eigen::MatrixXd half = scale.asDiagonal() * v * inverse.asDiagonal();
  r.covariance = variance * half * half.transpose();
  return r;
}

/// One joint without contact: what the motor spends on friction, weight and offset. Friction is Coulomb's, Stribeck's
/// rise towards standstill and a viscous part (Armstrong-Hélouvry, Dupont & Canudas de Wit 1994); weight is that of one
/// rigid link, gravity_sin · sin q + gravity_cos · cos q.
struct TorqueModel {
  double torque_constant_Nm_per_A = 1.0;  ///< at the joint, gear included; not seen by an unloaded run
  double coulomb_Nm = 0.0;
  double stribeck_Nm = 0.0;  ///< by which friction at standstill exceeds Coulomb's
  double viscous_Nm_s_per_rad = 0.0;
  double bias_Nm = 0.0;
  double gravity_sin_Nm = 0.0, gravity_cos_Nm = 0.0;
  double stribeck_velocity_rad_per_s = 0.1;
  double rest_velocity_rad_per_s = 0.02;  ///< below, the joint may stand, and the sign of friction is not known
  double noise_Nm = 0.01;                 ///< of one sample

  /// Torque of the motor [N·m] from its effort.
  double motor_torque(double effort, Effort unit) const {
    return unit == Effort::current_A ? torque_constant_Nm_per_A * effort : effort;
  }
  double friction(double velocity) const {
    return std::tanh(velocity / rest_velocity_rad_per_s) * magnitude(velocity) + viscous_Nm_s_per_rad * velocity;
  }
  double unloaded(double position, double velocity) const {
    return friction(velocity) + bias_Nm + gravity_sin_Nm * std::sin(position) + gravity_cos_Nm * std::cos(position);
  }
  /// What friction at standstill leaves open [N·m]: uniform between its two signs.
  double stiction_sigma(double velocity) const {
    const double t = std::tanh(velocity / rest_velocity_rad_per_s);
    return (1.0 - t * t) * magnitude(velocity) / std::sqrt(3.0);
  }

 private:
  double magnitude(double velocity) const {
    return coulomb_Nm + stribeck_Nm * std::exp(-std::pow(velocity / stribeck_velocity_rad_per_s, 2));
  }
};

/// Throws InvalidArgument for numbers out of range.
inline void validate(const TorqueModel& m) {
  if (!(std::abs(m.torque_constant_Nm_per_A) >= 1e-6 && std::abs(m.torque_constant_Nm_per_A) <= 1e3))
    throw InvalidArgument(message("torque constant is ", m.torque_constant_Nm_per_A,
        " N·m/A, must lie in [1e-6, 1000] N·m/A, on either side of 0"));
  for (const double v : {m.coulomb_Nm, m.stribeck_Nm, m.bias_Nm, m.gravity_sin_Nm, m.gravity_cos_Nm})
    require_in_range("friction, offset or weight of a torque model", v, -1e3, 1e3, "N·m");
  require_in_range("viscous friction", m.viscous_Nm_s_per_rad, -1e3, 1e3, "N·m·s/rad");
  require_in_range("Stribeck velocity", m.stribeck_velocity_rad_per_s, 1e-9, 1e6, "rad/s");
  require_in_range("velocity below which a joint may stand", m.rest_velocity_rad_per_s, 1e-9, 1e6, "rad/s");
  require_in_range("noise of the torque", m.noise_Nm, 0.0, 1e3, "N·m");
}

/// A torque model from an unloaded run, and what that run left open.
struct TorqueIdentification {
  static constexpr std::array<const char*, 6> names{
      "coulomb_Nm", "stribeck_Nm", "viscous_Nm_s_per_rad", "bias_Nm", "gravity_sin_Nm", "gravity_cos_Nm"};
  TorqueModel model;      ///< what is not identified stays 0 along the null directions
  Identification linear;  ///< of `names`, in this order
};

/// Fits friction, bias and weight of joint `joint` to samples without contact. `start` gives the constants that such a
/// run leaves open. The Stribeck velocity is searched for by sections; all else is linear. Throws InvalidArgument for
/// no samples or numbers that are not finite.
inline TorqueIdentification identify_unloaded(
    std::span<const JointSample> samples, int joint, const TorqueModel& start = {}) {
  std::vector<double> q, v, t;
  for (const JointSample& s : samples) {
    if (joint < 0 || joint >= s.effort.size() || joint >= s.position_rad.size() || joint >= s.velocity_rad_per_s.size())
      throw InvalidArgument(message("unloaded run has no joint ", joint));
    q.push_back(s.position_rad[joint]);
    v.push_back(s.velocity_rad_per_s[joint]);
    t.push_back(start.motor_torque(s.effort[joint], s.unit));
  }
  if (t.empty()) throw InvalidArgument("unloaded run has no samples");
  const auto n = Eigen::Index(t.size());
  const Eigen::VectorXd torque = Eigen::Map<const Eigen::VectorXd>(t.data(), n);
  const auto fit = [&](double stribeck_velocity) {
    Eigen::MatrixXd a(n, 6);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double w = v[std::size_t(i)], sign = std::tanh(w / start.rest_velocity_rad_per_s);
      a.row(i) << sign, sign * std::exp(-std::pow(w / stribeck_velocity, 2)), w, 1.0, std::sin(q[std::size_t(i)]),
          std::cos(q[std::size_t(i)]);
    }
    // What the run does not give to half of a typical parameter stays out: noise would fill it.
    constexpr double typical_Nm = 0.05, tolerance = 1e-6, known = 0.5;
    return identify(a, torque, Eigen::VectorXd::Constant(6, typical_Nm), 0.0, tolerance, known);
  };
  // Golden sections in the logarithm, after a coarse look: the residual has one minimum near its smallest coarse value.
  double fastest = 0.0;
  for (const double w : v) fastest = std::max(fastest, std::abs(w));
  const double low = std::log(std::max(1.5 * start.rest_velocity_rad_per_s, 1e-6)),
               high = std::max(low + 1e-3, std::log(std::max(fastest, 1e-6)));
  constexpr int looks = 13;
  int least = 0;
  double smallest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < looks; ++k)
    if (const double r = fit(std::exp(low + (high - low) * k / (looks - 1))).residual; r < smallest * (1.0 - 1e-9)) {
      smallest = r;
      least = k;
    }
  const double a = low + (high - low) * std::max(0, least - 1) / (looks - 1),
               b = low + (high - low) * std::min(looks - 1, least + 1) / (looks - 1);
  const double best = std::exp(golden_section([&](double at) { return fit(std::exp(at)).residual; }, a, b, 24));
  TorqueIdentification result{start, fit(best)};
  const Eigen::VectorXd& x = result.linear.value;
  TorqueModel& m = result.model;
  m.stribeck_velocity_rad_per_s = best;
  m.coulomb_Nm = x[0];
  m.stribeck_Nm = x[1];
  m.viscous_Nm_s_per_rad = x[2];
  m.bias_Nm = x[3];
  m.gravity_sin_Nm = x[4];
  m.gravity_cos_Nm = x[5];
  m.noise_Nm = result.linear.residual;
  return result;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/force_solution.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_FORCE_SOLUTION_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_FORCE_SOLUTION_HPP

namespace lumo::sense {

/// Numbers of both solutions.
struct ForceSolutionConfig {
  static constexpr double on_axis_m = 1e-4;           ///< contacts so near all axes count as on them
  static constexpr double rank_tolerance = 1e-3;      ///< singular values below this share of the largest count as 0
  static constexpr double place_unit_m = 0.01;        ///< of y beside a force of 1 N, for the rank
  static constexpr int cells = 64, refinements = 40;  ///< of the search along the pad, and within the best cells
};

/// Normal forces [N] at known places from the torques that contacts put on the motors. Forces that the torques do not
/// separate come back as null directions: three contacts on two joints, two on one link of one joint, any at a
/// joint's axis.
template <ContactJacobian J> Identification solve_forces(const J& jacobian, const JointVector& q,
    const JointVector& contact_torque_Nm, std::span<const ContactPoint> contacts, double torque_sigma_Nm) {
  for (const double t : contact_torque_Nm) require_in_range("torque of the contacts", t, -1e6, 1e6, "N·m");
  require_in_range("error of the torque", torque_sigma_Nm, 0.0, 1e6, "N·m");
  const auto m = Eigen::Index(contacts.size());
  const Eigen::MatrixXd a = contact_columns(jacobian, q, contacts);
  const double largest = a.size() ? a.cwiseAbs().maxCoeff() : 0.0;
  if (largest < ForceSolutionConfig::on_axis_m)
    return {Eigen::VectorXd::Zero(m), Eigen::MatrixXd::Zero(m, m), 0, Eigen::MatrixXd::Identity(m, m), 0.0};
  return identify(a, contact_torque_Nm, Eigen::VectorXd::Ones(m), torque_sigma_Nm, ForceSolutionConfig::rank_tolerance);
}

/// One contact from torques alone: place and force together, as far as the joints determine them.
struct TorqueOnlySolution {
  double y_m = 0.0;
  double force_N = 0.0;
  int rank = 0;                                        ///< of (y, force): 2 both, 1 a combination, 0 nothing
  Eigen::Vector2d null_direction{0.0, 0.0};            ///< (y in units of 10 mm, force in N), unit; where the rank is 1
  Eigen::Matrix2d covariance{{0.0, 0.0}, {0.0, 0.0}};  ///< of (y [m], force [N]); where the rank is 2
};

/// Within `range`: two joints before the contact give the place by the ratio of their torques
/// (paper's torque-only baseline is τ₁/τ₂). A single joint has rank 1. The value along a null direction is that of the
/// range's middle.
template <ContactJacobian J> TorqueOnlySolution solve_torque_only(const J& jacobian, const JointVector& q,
    const JointVector& contact_torque_Nm, const PadRange& range, double torque_sigma_Nm) {
  using Config = ForceSolutionConfig;
  const int link = range.link;
  const double from_m = range.from_m, to_m = range.to_m;
  require_in_range("start of the finger", from_m, -10.0, 10.0, "m");
  require_in_range("end of the finger", to_m, from_m, 10.0, "m");
  for (const double t : contact_torque_Nm) require_in_range("torque of the contacts", t, -1e6, 1e6, "N·m");
  if (contact_torque_Nm.size() != jacobian.joints())
    throw InvalidArgument(
        message("torques of ", contact_torque_Nm.size(), " joints, the finger has ", jacobian.joints()));
  require_positive("error of the torque", torque_sigma_Nm, "N·m");
  const auto force_at = [&](double y, double& misfit) {
    const JointVector a = jacobian.column(q, {link, y});
    const double force = a.dot(contact_torque_Nm) / std::max(a.squaredNorm(), 1e-12);
    misfit = (contact_torque_Nm - force * a).squaredNorm();
    return force;
  };
  TorqueOnlySolution s;
  s.y_m = range.middle_m();
  double misfit = 0.0;
  s.force_N = force_at(s.y_m, misfit);
  const auto sensitivity = [&] {
    Eigen::MatrixXd h(jacobian.joints(), 2);
    h.col(0) = Config::place_unit_m * s.force_N * jacobian.slope(q, {link, s.y_m});
    h.col(1) = jacobian.column(q, {link, s.y_m});
    return h;
  };
  const auto look = [&] {
    return identify(sensitivity(), Eigen::VectorXd(contact_torque_Nm), Eigen::Vector2d::Ones(), torque_sigma_Nm,
        Config::rank_tolerance);
  };
  Identification local = look();
  if (local.complete()) {
    constexpr int cells = Config::cells;
    double least = std::numeric_limits<double>::infinity();
    int best = 0;
    for (int k = 0; k <= cells; ++k) {
      force_at(from_m + (to_m - from_m) * k / cells, misfit);
      if (misfit < least) {
        least = misfit;
        best = k;
      }
    }
    const double a = from_m + (to_m - from_m) * std::max(0, best - 1) / cells,
                 b = from_m + (to_m - from_m) * std::min(cells, best + 1) / cells;
    s.y_m = golden_section([&](double y) { return force_at(y, misfit), misfit; }, a, b, Config::refinements);
    s.force_N = force_at(s.y_m, misfit);
    local = look();
  }
  s.rank = int(local.rank);
  if (s.rank == 1) s.null_direction = local.null_space.col(0);
  if (s.rank == 2) {
    const Eigen::Vector2d unit(Config::place_unit_m, 1.0);
    s.covariance = unit.asDiagonal() * local.covariance * unit.asDiagonal();
  }
  return s;
}

/// Which streams an estimate rests on.
enum class EstimatorState {
  ok,           ///< both, without faults
  degraded,     ///< both, but something is or was just wrong with one
  torque_only,  ///< no usable frame for too long
  vision_only,  ///< no usable joint sample for too long
  invalid       ///< neither
};

constexpr const char* to_string(EstimatorState s) {
  constexpr std::array<const char*, 5> names{"ok", "degraded", "torque_only", "vision_only", "invalid"};
  return names[std::size_t(s)];
}

/// One contact: the place on the finger and the normal force of the object on the pad. What is not known is empty;
/// the rest is finite.
struct ContactForce {
  std::optional<double> y_m;
  std::optional<double> force_N;
  double y_variance_m2 = 0.0;      ///< also where y is empty
  double force_variance_N2 = 0.0;  ///< the prior's where the force is not known
  double covariance_m_N = 0.0;
};

struct ForceEstimate {
  std::int64_t stamp_ns = 0;  ///< the time that it is for
  EstimatorState state = EstimatorState::invalid;
  Faults faults;
  int contacts = 0;
  std::array<ContactForce, 2> contact;  ///< the first max(1, contacts) mean something
  /// Unknowns are (y, F) of one contact or (F₁, F₂) of two, in units of what counts as known; `rank` of them (or
  /// combinations) are.
  int rank = 0;
  Eigen::Matrix2d null_directions{
      {0.0, 0.0}, {0.0, 0.0}};      ///< the last 2 − rank columns: unit directions that the data leave open
  std::int64_t frame_stamp_ns = 0;  ///< of the newest usable frame
  std::int64_t joint_stamp_ns = 0;  ///< of the newest usable joint sample
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/joint_monitor.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_JOINT_MONITOR_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_JOINT_MONITOR_HPP

namespace lumo::sense {

/// Decides for each joint sample whether it can be trusted.
class JointMonitor {
 public:
  struct Config {
    int joints = 1;
    double period_s = 1e-3;
    double max_ahead_s = 0.01;  ///< how far a stamp may lie in the future
    /// The very same effort of a joint for this long is stuck; at least 20 samples. Real currents are noisy
    double stuck_s = 0.1;
    /// Step in which efforts come, and standard deviation of their noise before they are rounded to it, both in the
    /// effort's unit. Where there is a step, as many samples more must be the same as noise alone would not make so in
    /// 10⁹ trials; noise far below half a step never changes it. 0: no step.
    double quantum = 0.0, noise = 0.0;
    double spike = 0.5;        ///< jump against the median of the last five [A or N·m, as the effort]
    double max_effort = 40.0;  ///< of the motor, same unit
    double max_velocity_rad_per_s = 65.0;
    double max_position_rad = 1e4;  ///< beyond, the encoder is broken
  };

  /// Throws InvalidArgument for numbers out of range.
  explicit JointMonitor(const Config& config) : config_(config) {
    require_in_range("number of joints", config.joints, 1, max_joints, "");
    require_in_range("period of the joint samples", config.period_s, 1e-6, 1e3, "s");
    require_positive("time after which an effort is stuck", config.stuck_s, "s");
    require_positive("spike", config.spike, "");
    require_in_range("largest effort", config.max_effort, 1e-9, 1e4, "");
    require_in_range("largest velocity", config.max_velocity_rad_per_s, 1e-6, 1e4, "rad/s");
    require_in_range("largest position", config.max_position_rad, 1e-3, 1e9, "rad");
    require_in_range("step of the effort", config.quantum, 0.0, config.max_effort, "");
    require_in_range("noise of the effort", config.noise, 0.0, config.max_effort, "");
    if (config.quantum > 0.0) {
      const double same = config.noise > 0.0 ? std::erf(config.quantum / (2.8284271247461901 * config.noise))
                                             : 1.0;  // share of samples on a step's middle
      least_same_ =
          std::max(least_same_, same < 1.0 ? std::log(1e-9) / std::log(same) : std::numeric_limits<double>::infinity());
    }
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  Verdict check(const JointSample& s, std::int64_t now_ns) {
    Verdict v;
    const auto reject = [&](Fault f) {
      v.faults.add(f);
      v.usable = false;
    };
    if (s.stamp_ns < -stamp_limit_ns || s.stamp_ns > stamp_limit_ns) return reject(Fault::joint_time), v;
    if (1e-9 * double(s.stamp_ns - now_ns) > config_.max_ahead_s || (seen_ && s.stamp_ns <= stamp_ns_))
      return reject(Fault::joint_time), v;
    const double step_s = seen_ ? 1e-9 * double(s.stamp_ns - stamp_ns_) : 0.0;
    if (step_s > 2.5 * config_.period_s) v.faults.add(Fault::joint_dropped);
    stamp_ns_ = s.stamp_ns;
    const Eigen::Index n = config_.joints;
    if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n ||
        !s.effort.allFinite() || !s.position_rad.allFinite() || !s.velocity_rad_per_s.allFinite())
      return seen_ = true, reject(Fault::joint_not_finite), v;
    if (s.position_rad.cwiseAbs().maxCoeff() > config_.max_position_rad ||
        s.velocity_rad_per_s.cwiseAbs().maxCoeff() > config_.max_velocity_rad_per_s)
      return seen_ = true, reject(Fault::position_jump), v;
    if (!filled_) position_ = s.position_rad;

    const double reach =
        config_.max_velocity_rad_per_s * std::max(1e-9 * double(s.stamp_ns - position_ns_), config_.period_s);
    if (filled_ && (s.position_rad - position_).cwiseAbs().maxCoeff() > 1.5 * reach) reject(Fault::position_jump);
    if (v.usable) {
      position_ = s.position_rad;
      position_ns_ = s.stamp_ns;
    }
    if (s.saturated || s.effort.cwiseAbs().maxCoeff() > config_.max_effort) reject(Fault::torque_saturated);

    for (Eigen::Index j = 0; j < n; ++j) {
      Sameness& same = same_[std::size_t(j)];
      if (!filled_ || s.effort[j] != last_[j]) same = {0, s.stamp_ns};
      else if (++same.samples >= least_same_ && 1e-9 * double(s.stamp_ns - same.since_ns) > config_.stuck_s)
        reject(Fault::torque_stuck);
    }
    last_ = s.effort;

    // A real step fills the window within three samples and then is no spike.
    if (filled_ >= window)
      for (Eigen::Index j = 0; j < n; ++j) {
        std::array<double, window> sorted{};
        for (std::size_t k = 0; k < window; ++k) sorted[k] = recent_[k][j];
        std::nth_element(sorted.begin(), sorted.begin() + window / 2, sorted.end());
        if (std::abs(s.effort[j] - sorted[window / 2]) > config_.spike) reject(Fault::torque_spike);
      }
    recent_[std::size_t(next_)] = s.effort;
    next_ = (next_ + 1) % int(window);
    filled_ = std::min<std::size_t>(filled_ + 1, window);
    seen_ = true;
    return v;
  }

 private:
  static constexpr std::size_t window = 5;
  Config config_;
  std::array<JointVector, window> recent_;
  JointVector position_, last_;
  std::size_t filled_ = 0;
  struct Sameness {
    double samples = 0.0;  ///< that repeated the one before
    std::int64_t since_ns = 0;
  };
  std::array<Sameness, std::size_t(max_joints)> same_;
  double least_same_ = 20.0;
  int next_ = 0;
  std::int64_t stamp_ns_ = 0, position_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/frame_monitor.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_FRAME_MONITOR_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_FRAME_MONITOR_HPP

namespace lumo::sense {

/// Checks each frame's profile against the unloaded one and its predecessor.
class FrameMonitor {
 public:
  struct Config {
    Eigen::VectorXd position_m;  ///< of the profile's values
    Eigen::VectorXd unloaded;    ///< mean profile without contact
    std::vector<double> led_m{-22.0_mm, -11.0_mm, 0.0, 11.0_mm, 22.0_mm};
    double period_s = 1.0 / 30.0;  ///< of the frames
    double max_age_s = 0.15;       ///< from stamp to arrival
    double max_ahead_s = 0.01;     ///< how far a stamp may lie in the future
    double black = 0.25;           ///< mean light, relative to unloaded, below which a frame is black
    double saturated = 0.05;       ///< share of full pixels that is too many
    /// Light about one LED, relative to unloaded and where all is darker to the median over the finger, below which it
    /// is dead. A contact brightens half a finger to twice its light and leaves the other LEDs as they were, or darkens
    /// one to half (lab, built finger under 30 mm, 1 to 2 N).
    double led_dark = 0.4;
    /// Change of the median over the finger that counts, where all places agree to that, in ratio or in difference: a
    /// camera's exposure, or room light. A contact changes near places more than far ones (lab, built finger at 5 to 15
    /// N, spheres of 10 and 30 mm: the median by up to 117 %, the 95 % and 5 % quantiles of ratios apart by 41 % and
    /// more).
    double exposure = 0.15;
    double uniform = 0.5;  ///< of the unloaded light's spread, below which a bright picture shows no finger
    /// Light anywhere, relative to unloaded, outside of which the picture is damaged; contacts reach 0.3 and 10 (lab).
    double corrupt_low = 0.2, corrupt_high = 20.0;
    double exposure_s = 0.0, gain = 0.0;  ///< of the reference; 0: unknown
    double metadata_change = 0.01;        ///< relative, of exposure or gain: more than rounding
    double dropped_periods = 1.6;         ///< between two stamps, beyond which a frame is missing; assumed
  };

  /// Throws InvalidArgument for lengths that differ or numbers out of range.
  explicit FrameMonitor(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 1 || config_.unloaded.size() != n)
      throw InvalidArgument(message(
          "frame monitor has ", n, " positions and ", config_.unloaded.size(), " unloaded values, must have as many"));
    for (Eigen::Index i = 0; i < n; ++i) require_positive("unloaded light at every position", config_.unloaded[i], "");
    require_positive("period of the frames", config_.period_s, "s");
    require_positive("greatest age of a frame", config_.max_age_s, "s");
    unloaded_spread_ = spread_of(config_.unloaded);
    unloaded_median_ = sorted_[n / 2];
  }

  struct Verdict {
    Faults faults;
    bool usable = true;
  };

  /// Checks the time before a frame is read. A frame that fails must not be read.
  Verdict check_time(std::int64_t stamp_ns, std::int64_t now_ns) {
    Verdict v;
    if (stamp_ns < -stamp_limit_ns || stamp_ns > stamp_limit_ns) return reject(Fault::frame_time);
    if (const double ahead = 1e-9 * double(stamp_ns - now_ns); ahead > config_.max_ahead_s)
      return reject(Fault::frame_time);
    if (seen_ && stamp_ns == stamp_ns_) return reject(Fault::frame_repeated);
    if (seen_ && stamp_ns < stamp_ns_) return reject(Fault::frame_time);
    if (1e-9 * double(now_ns - stamp_ns) > config_.max_age_s) v.faults.add(Fault::frame_late);
    if (seen_ && 1e-9 * double(stamp_ns - stamp_ns_) > config_.dropped_periods * config_.period_s)
      v.faults.add(Fault::frame_dropped);
    seen_ = true;
    stamp_ns_ = stamp_ns;
    return v;
  }

  /// Checks the light before the reference is subtracted.
  Verdict check_light(const Profile& p, double exposure_s, double gain) {
    Verdict v;
    const bool same = last_.size() == p.value.size() && last_ == p.value;
    last_ = p.value;
    if (same) return reject(Fault::frame_repeated);
    if (!p.value.allFinite()) return reject(Fault::frame_corrupt);
    const auto differs = [&](double a, double b) {
      return a > 0.0 && b > 0.0 && std::abs(a / b - 1.0) > config_.metadata_change;
    };
    if (differs(exposure_s, config_.exposure_s) || differs(gain, config_.gain)) v.faults.add(Fault::exposure_changed);
    if (p.value.mean() < config_.black * config_.unloaded.mean()) v.faults.add(Fault::frame_black);
    if (p.saturated > config_.saturated) v.faults.add(Fault::frame_saturated);
    ratio_ = p.value.cwiseQuotient(config_.unloaded);
    const double median = sort(ratio_)[ratio_.size() / 2];
    if (!v.faults.any()) {
      const bool dead = std::any_of(config_.led_m.begin(), config_.led_m.end(),
          [&](double y) { return led_ratio(y) < config_.led_dark * std::min(median, 1.0); });
      if (dead) v.faults.add(Fault::led_dead);
      else if (ratio_.minCoeff() < config_.corrupt_low || ratio_.maxCoeff() > config_.corrupt_high)
        v.faults.add(Fault::frame_corrupt);
      else if (median > 1.0 && spread_of(p.value) < config_.uniform * unloaded_spread_)
        v.faults.add(Fault::frame_corrupt);
      if (std::abs(median - 1.0) > config_.exposure && all_alike(p.value)) v.faults.add(Fault::exposure_changed);
    }
    v.usable = !v.faults.any();
    return v;
  }

  static Verdict reject(Fault f) {
    Verdict v;
    v.faults.add(f);
    v.usable = false;
    return v;
  }

 private:
  const Eigen::VectorXd& sort(const Eigen::VectorXd& values) {
    sorted_ = values;
    std::sort(sorted_.data(), sorted_.data() + sorted_.size());
    return sorted_;
  }
  /// 95 % quantile less 5 % quantile.
  double range_of(const Eigen::VectorXd& values) {
    const Eigen::Index end = values.size() / 20;
    return sort(values)[values.size() - 1 - end] - sorted_[end];
  }
  /// Relative to the median.
  double spread_of(const Eigen::VectorXd& value) {
    const double range = range_of(value);
    return range / sorted_[sorted_.size() / 2];
  }
  bool all_alike(const Eigen::VectorXd& value) {
    const double ratios = range_of(ratio_), least = sorted_[ratio_.size() / 20];
    if (ratios < config_.exposure * least) return true;
    difference_ = value - config_.unloaded;
    return range_of(difference_) < config_.exposure * unloaded_median_;
  }
  /// Light at the position nearest to the LED, relative to unloaded.
  double led_ratio(double y) const {
    const Eigen::VectorXd& position_m = config_.position_m;
    Eigen::Index i = 0;
    (position_m.array() - y).abs().minCoeff(&i);
    return ratio_[i];
  }

  Config config_;
  Eigen::VectorXd last_, ratio_, difference_, sorted_;
  double unloaded_spread_ = 0.0, unloaded_median_ = 0.0;
  std::int64_t stamp_ns_ = 0;
  bool seen_ = false;
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/force_estimator.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_FORCE_ESTIMATOR_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_FORCE_ESTIMATOR_HPP

namespace lumo::sense {

/// Settings of a ForceEstimator.
struct ForceEstimatorConfig {
  FrameMonitor::Config frames;  ///< its positions and unloaded values are filled in where empty; exposure and gain of
                                ///< the reference, where known, are the caller's
  JointMonitor::Config joints;
  ContactFilterConfig filter;
  std::vector<TorqueModel> torque{TorqueModel{}};  ///< one for each joint
  double frame_delay_s = 0.0;                      ///< from the light to the stamp, known
  double joint_delay_s = 0.0;
  double frame_timeout_s = 0.2;
  double joint_timeout_s = 0.05;
  double fault_hold_s = 0.15;    ///< a fault is reported for this long
  double map_sigma_m = 0.0;      ///< of the map from image to finger (AxisMap::variance_m2); the same in all frames, so
                                 ///< no filter lessens it
  double stiction_time_s = 0.5;  ///< how long a joint sticks on one side; assumed
  double smoothing_s = 0.01;     ///< time constant of the torques that forces of two contacts are from
  double known_location_m = 6.0_mm;  ///< standard deviation up to which y counts as known
  double known_force_N = 5.0;
  int max_frames = 4, max_samples = 256;  ///< taken in one step
};

/// Place and force of a contact from a camera and motors, as both deliver. Each `step` takes what has arrived and
/// checks it; it waits no longer than the camera's `next` does. The estimate is always finite and states which streams
/// it rests on. Faulty frames and samples are left out; `fault_hold_s` after the last fault the state is ok again.
template <Camera Camera_, Actuator Actuator_, LocationEstimator Localizer, Readout Readout_ = GreenProfile,
    ContactJacobian Jacobian = MomentArm>
requires std::same_as<typename Readout_::Sample, Frame>
class ForceEstimator {
  static_assert(!std::same_as<Readout_, PositiveGreenProfile>,
      "frames are checked by their light against the unloaded finger's: the readout must be linear in it, as "
      "GreenProfile is");

 public:
  using Config = ForceEstimatorConfig;
  struct Light {
    Readout_ readout;
    UnloadedReference unloaded;  ///< of the same readout
  };

  /// Camera and actuator stay the caller's and must outlive the estimator. Throws InvalidArgument for parts that do not
  /// fit.
  ForceEstimator(
      Camera_& camera, Actuator_& actuator, Light light, Localizer localizer, Jacobian jacobian, Config config)
      : camera_(&camera),
        actuator_(&actuator),
        readout_(std::move(light.readout)),
        localizer_(std::move(localizer)),
        unloaded_(std::move(light.unloaded)),
        config_(std::move(config)),
        frame_monitor_(completed(config_.frames, readout_, unloaded_)),
        joint_monitor_(config_.joints),
        filter_(std::move(jacobian), config_.filter) {
    const int n = filter_.jacobian().joints();
    if (int(config_.torque.size()) != n || config_.joints.joints != n)
      throw InvalidArgument(message("force estimator has ", n, " joints in its Jacobian, ", config_.torque.size(),
          " torque models and ", config_.joints.joints, " joints to watch"));
    if (unloaded_.mean().size() != readout_.positions_m().size())
      throw InvalidArgument(message(
          "unloaded reference has ", unloaded_.mean().size(), " values, the readout ", readout_.positions_m().size()));
    joint_q_ = joint_torque_ = joint_variance_ = JointVector::Zero(n);
    for (const TorqueModel& m : config_.torque) validate(m);
    require_in_range("delay of the frames", config_.frame_delay_s, -10.0, 10.0, "s");
    require_in_range("delay of the joint samples", config_.joint_delay_s, -10.0, 10.0, "s");
    require_in_range("time for which a fault is reported", config_.fault_hold_s, 0.0, 1e6, "s");
    require_in_range("time for which a joint sticks", config_.stiction_time_s, 0.0, 1e3, "s");
    require_positive("time over which torques are smoothed", config_.smoothing_s, "s");
    require_positive("frame timeout", config_.frame_timeout_s, "s");
    require_positive("joint timeout", config_.joint_timeout_s, "s");
    require_positive("location that counts as known", config_.known_location_m, "m");
    require_positive("force that counts as known", config_.known_force_N, "N");
    require_in_range("error of the map", config_.map_sigma_m, 0.0, 1.0, "m");
    require_in_range("frames in a step", config_.max_frames, 1, 1e6, "");
    require_in_range("samples in a step", config_.max_samples, 1, 1e6, "");
  }

  /// Takes all that has arrived and answers for the time `now_ns`, on the clock of the stamps.
  ForceEstimate step(std::int64_t now_ns) {
    if (!begun_) begin_ns_ = now_ns_ = frame_ns_ = joint_ns_ = now_ns;
    begun_ = true;
    now_ns_ = std::max(now_ns_, now_ns);
    for (int i = 0; i < config_.max_samples; ++i) {
      const auto s = actuator_->next();
      if (!s) break;
      take(*s);
    }
    for (int i = 0; i < config_.max_frames; ++i) {
      const auto f = camera_->next();
      if (!f) break;
      take(*f);
    }
    if (camera_->state() == StreamState::failed) note(Fault::camera_lost);
    if (actuator_->state() == StreamState::failed) note(Fault::actuator_lost);
    const bool frames = within(frame_seen_, frame_ns_, config_.frame_timeout_s),
               joints = within(joint_seen_, joint_ns_, config_.joint_timeout_s);
    const double since_s = 1e-9 * double(now_ns_ - begin_ns_);  // what begins is not missing yet
    if (!frames && since_s > config_.frame_timeout_s) note(Fault::frames_missing);
    if (!joints && since_s > config_.joint_timeout_s) note(Fault::joint_missing);

    ForceEstimate e;
    e.stamp_ns = now_ns_;
    e.frame_stamp_ns = frame_ns_;
    e.joint_stamp_ns = joint_ns_;
    for (unsigned i = 0; i < unsigned(Fault::count); ++i)
      if (faulty_[i] && 1e-9 * double(now_ns_ - fault_ns_[i]) <= config_.fault_hold_s) e.faults.add(Fault(i));
    using enum EstimatorState;
    e.state = frames && joints ? (e.faults.any() ? degraded : ok)
              : joints         ? torque_only
              : frames         ? vision_only
                               : invalid;
    e.contacts = location_.contacts;
    if (e.contacts == 2 && frames) describe_two(e, joints);
    else describe_one(e);
    return e;
  }

  /// What the newest usable frame said.
  const LocationEstimate& location() const { return location_; }
  /// Its profile minus the unloaded one.
  const Profile& response() const { return profile_; }
  const ContactFilter<Jacobian>& filter() const { return filter_; }

 private:
  void take(const JointSample& s) {
    const auto verdict = joint_monitor_.check(s, now_ns_);
    note(verdict.faults);
    if (!verdict.usable) return;
    const Eigen::Index n = s.effort.size();
    JointVector torque(n), variance(n);
    for (Eigen::Index j = 0; j < n; ++j) {
      const TorqueModel& m = config_.torque[std::size_t(j)];
      torque[j] = m.motor_torque(s.effort[j], s.unit) - m.unloaded(s.position_rad[j], s.velocity_rad_per_s[j]);
      const double stick = m.stiction_sigma(s.velocity_rad_per_s[j]);
      variance[j] = std::clamp(
          m.noise_Nm * m.noise_Nm + stick * stick * std::max(1.0, config_.stiction_time_s / config_.joints.period_s),
          1e-12, 1e12);
    }
    filter_.add_torque(s.stamp_ns - std::int64_t(1e9 * config_.joint_delay_s), torque, variance);
    const double weight = joint_seen_ ? -std::expm1(-1e-9 * double(s.stamp_ns - joint_ns_) / config_.smoothing_s) : 1.0;
    joint_torque_ += weight * (torque - joint_torque_);
    joint_variance_ = (1.0 - weight) * (1.0 - weight) * joint_variance_ + weight * weight * variance;
    joint_q_ = s.position_rad;
    joint_ns_ = s.stamp_ns;
    joint_seen_ = true;
  }
  void take(const Frame& f) {
    const auto time = frame_monitor_.check_time(f.stamp_ns, now_ns_);
    note(time.faults);
    if (!time.usable) return;
    if (!readout_.read(f, reading_)) return note(Fault::frame_corrupt);
    const auto light = frame_monitor_.check_light(reading_, f.exposure_s, f.gain);
    note(light.faults);
    if (!light.usable) return;
    std::swap(profile_, reading_);
    unloaded_.subtract(profile_);
    location_ = localizer_.update(profile_);
    const std::int64_t taken = f.stamp_ns - std::int64_t(1e9 * config_.frame_delay_s);
    if (location_.unknown) note(Fault::response_unknown);
    else if (location_.contacts == 0) filter_.add_no_contact(taken);
    if (location_.contacts == 1) {
      // The filter has the localiser's offset as a state, and takes noises as independent.
      const ContactLocation& c = location_.contact[0];
      filter_.add_location(taken, c.y_m,
          std::clamp(c.noise_variance_m2 > 0.0 ? c.noise_variance_m2 : c.variance_m2 - c.bias_variance_m2, 1e-10, 1.0));
    }
    frame_ns_ = f.stamp_ns;
    frame_seen_ = true;
  }
  void note(Faults faults) {
    for (unsigned i = 0; i < unsigned(Fault::count); ++i)
      if (faults.has(Fault(i))) {
        fault_ns_[i] = now_ns_;
        faulty_[i] = true;
      }
  }
  void note(Fault f) {
    Faults one;
    one.add(f);
    note(one);
  }
  bool within(bool seen, std::int64_t stamp_ns, double limit_s) const {
    return seen && 1e-9 * double(now_ns_ - stamp_ns) <= limit_s;
  }
  void describe_one(ForceEstimate& e) const {
    ContactBelief b = filter_.at(now_ns_, joint_q_);
    const ContactPoint point{config_.filter.link, std::clamp(b.y_m, config_.filter.from_m, config_.filter.to_m)};
    const JointVector arm = filter_.jacobian().column(joint_q_, point),
                      slope = filter_.jacobian().slope(joint_q_, point);
    const Eigen::Vector2d shift(
        1.0, -b.force_N * slope.dot(arm) / std::max(arm.squaredNorm(), 1e-8));  // a shift of y moves F along the torque
    b.covariance += config_.map_sigma_m * config_.map_sigma_m * shift * shift.transpose();
    ContactForce& c = e.contact[0];
    c.y_variance_m2 = b.covariance(0, 0);
    c.force_variance_N2 = b.covariance(1, 1);
    c.covariance_m_N = b.covariance(0, 1);
    const double force = std::max(0.0, b.force_N);  // pads are pushed, not pulled
    if (e.state == EstimatorState::torque_only || e.state == EstimatorState::invalid)
      e.contacts = force > 3.0 * std::sqrt(c.force_variance_N2) ? 1 : 0;
    e.contacts = std::min(e.contacts, 1);
    if (std::sqrt(c.y_variance_m2) <= config_.known_location_m) c.y_m = point.y_m;
    if (std::sqrt(c.force_variance_N2) <= config_.known_force_N) c.force_N = force;
    // Directions of the posterior that are wider than what counts as known are open.
    const Eigen::Vector2d unit(config_.known_location_m, config_.known_force_N);
    const Eigen::Matrix2d scaled = unit.cwiseInverse().asDiagonal() * b.covariance * unit.cwiseInverse().asDiagonal();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes;
    axes.computeDirect(scaled);  // ascending
    e.rank = int((axes.eigenvalues().array() <= 1.0).count());
    e.null_directions = axes.eigenvectors();
  }
  void describe_two(ForceEstimate& e, bool with_forces) const {
    const int link = config_.filter.link;
    const double map2 = config_.map_sigma_m * config_.map_sigma_m,
                 force2 = config_.filter.force_prior_N * config_.filter.force_prior_N;
    std::array<ContactPoint, 2> points;
    for (std::size_t i = 0; i < 2; ++i) {
      points[i] = {link, location_.contact[i].y_m};
      e.contact[i].y_m = location_.contact[i].y_m;
      e.contact[i].y_variance_m2 = location_.contact[i].variance_m2 + map2;
      e.contact[i].force_variance_N2 = force2;
    }
    e.rank = 0;
    e.null_directions.setIdentity();
    if (!with_forces) return;

    JointVector torque = joint_torque_;
    for (int j = 0; j < int(torque.size()); ++j) torque[j] -= filter_.torque_offset(j);
    const double bias = config_.filter.torque_bias_Nm,
                 sigma = std::sqrt(bias * bias + joint_variance_.maxCoeff());  // of the joint that is worst
    const Identification forces = solve_forces(filter_.jacobian(), joint_q_, torque, points, sigma);
    // A place that is off by dy takes F a'(y) dy of torque for force: dF = −A⁺ a' F dy, with A⁺ = (AᵀA)⁺ Aᵀ. The map's
    // error is the same for both.
    const Eigen::MatrixXd inverse =
        forces.covariance / (sigma * sigma) *
        contact_columns(filter_.jacobian(), joint_q_, std::span<const ContactPoint>(points)).transpose();
    Eigen::Matrix2d by_place;
    for (Eigen::Index i = 0; i < 2; ++i)
      by_place.col(i) = -forces.value[i] * (inverse * filter_.jacobian().slope(joint_q_, points[std::size_t(i)]));
    Eigen::Matrix2d place = Eigen::Matrix2d::Constant(map2);
    for (Eigen::Index i = 0; i < 2; ++i) place(i, i) += location_.contact[std::size_t(i)].variance_m2;
    const Eigen::Matrix2d covariance = forces.covariance + by_place * place * by_place.transpose() +
                                       force2 * forces.null_space * forces.null_space.transpose();
    const Eigen::Matrix2d mixed = place * by_place.transpose();  // of places with forces
    for (Eigen::Index i = 0; i < 2; ++i) {
      ContactForce& c = e.contact[std::size_t(i)];
      c.force_variance_N2 = covariance(i, i);
      c.covariance_m_N = mixed(i, i);
      if (forces.complete() && std::sqrt(c.force_variance_N2) <= config_.known_force_N)
        c.force_N = std::max(0.0, forces.value[i]);
    }
    // As for one contact: forces that are separated in principle, but worse than what counts as known, are open.
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes;
    axes.computeDirect(Eigen::Matrix2d(covariance / (config_.known_force_N * config_.known_force_N)));  // ascending
    e.rank = int((axes.eigenvalues().array() <= 1.0).count());
    e.null_directions = axes.eigenvectors();
  }

  Camera_* camera_;
  Actuator_* actuator_;
  Readout_ readout_;
  Localizer localizer_;
  UnloadedReference unloaded_;
  Config config_;
  FrameMonitor frame_monitor_;
  JointMonitor joint_monitor_;
  ContactFilter<Jacobian> filter_;
  Profile reading_, profile_;
  LocationEstimate location_;
  JointVector joint_q_, joint_torque_,
      joint_variance_;  ///< newest angles, smoothed contact torque and the variance of its noise
  std::array<std::int64_t, std::size_t(Fault::count)> fault_ns_{};
  std::array<bool, std::size_t(Fault::count)> faulty_{};
  std::int64_t begin_ns_ = 0, now_ns_ = 0, frame_ns_ = 0, joint_ns_ = 0;
  bool begun_ = false, frame_seen_ = false, joint_seen_ = false;

  static FrameMonitor::Config completed(
      FrameMonitor::Config c, const Readout_& readout, const UnloadedReference& unloaded) {
    if (c.position_m.size() == 0) c.position_m = readout.positions_m();
    if (c.unloaded.size() == 0) c.unloaded = unloaded.mean();
    return c;
  }
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/free_run.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_FREE_RUN_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_FREE_RUN_HPP

namespace lumo::sense {

/// Limits for runs of which nobody said that they are without contact; chosen on the virtual lab.
struct FreeRunLimits {
  double block_s = 0.05;    ///< over which samples are averaged
  std::size_t least = 8;    ///< blocks, below which all are taken
  std::size_t fitted = 40;  ///< blocks that friction and weight are fitted to; fewer have one mean torque …
  double still_rad = 0.05;  ///< … if the joint moves no farther than that
  double far_sigmas = 8.0;  ///< of the closest half's scatter, from which a block is left out …
  double far_Nm = 0.05;     ///< … if it is also this far off: beyond what sticks in a joint
  int steps = 6;            ///< of concentration
};

/// A run without the stretches whose torque is far off what the rest of it shows.
struct FreeRun {
  std::vector<JointSample> samples;
  double left_out = 0.0;  ///< share of the run
};

namespace detail {

/// A run in blocks: their mean samples, and which samples each has.
struct RunBlocks {
  std::vector<JointSample> mean;
  std::vector<std::pair<std::size_t, std::size_t>> samples;  ///< first and one past the last
};

inline RunBlocks run_blocks(std::span<const JointSample> run, double block_s) {
  RunBlocks blocks;
  for (std::size_t from = 0; from < run.size();) {
    std::size_t to = from;
    JointSample mean = run[from];
    while (to < run.size() && 1e-9 * double(run[to].stamp_ns - run[from].stamp_ns) < block_s) {
      const double weight = 1.0 / double(++to - from);
      mean.position_rad += weight * (run[to - 1].position_rad - mean.position_rad);
      mean.velocity_rad_per_s += weight * (run[to - 1].velocity_rad_per_s - mean.velocity_rad_per_s);
      mean.effort += weight * (run[to - 1].effort - mean.effort);
    }
    blocks.mean.push_back(std::move(mean));
    blocks.samples.emplace_back(from, to);
    from = to;
  }
  return blocks;
}

/// How far each block's torque is off the model that is fitted to some of them [N·m]; `fitted`: with friction and
/// weight, or else their mean.
inline std::vector<double> block_misfits(const std::vector<JointSample>& blocks, const std::vector<std::size_t>& some,
    int joint, const TorqueModel& start, bool fitted) {
  std::vector<JointSample> chosen;
  for (const std::size_t i : some) chosen.push_back(blocks[i]);
  TorqueModel model = start;
  if (fitted) model = identify_unloaded(chosen, joint, start).model;
  else
    for (const JointSample& s : chosen)
      model.bias_Nm += model.motor_torque(s.effort[joint], s.unit) / double(chosen.size());
  std::vector<double> off;
  for (const JointSample& s : blocks)
    off.push_back(model.motor_torque(s.effort[joint], s.unit) -
                  model.unloaded(s.position_rad[joint], s.velocity_rad_per_s[joint]));
  return off;
}

/// The half that is least off, and the sum of its squares.
inline std::pair<std::vector<std::size_t>, double> least_half(const std::vector<double>& off) {
  std::vector<std::size_t> order(off.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(
      order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return std::abs(off[a]) < std::abs(off[b]); });
  order.resize(off.size() / 2 + 1);
  double sum = 0.0;
  for (const std::size_t i : order) sum += off[i] * off[i];
  return {std::move(order), sum};
}

/// Least trimmed squares by concentration steps (Rousseeuw & Van Driessen 2006), from all blocks, and from each third.
inline std::vector<double> robust_misfits(
    const std::vector<JointSample>& blocks, int joint, const TorqueModel& start, bool fitted, int steps) {
  const std::size_t n = blocks.size();
  std::vector<double> best;
  double least = std::numeric_limits<double>::infinity();
  for (int part = 0; part < 4; ++part) {
    const std::size_t from = part == 0 ? 0 : n * std::size_t(part - 1) / 3,
                      to = part == 0 ? n : n * std::size_t(part) / 3;
    std::vector<std::size_t> some;
    for (std::size_t i = from; i < to; ++i) some.push_back(i);
    std::vector<double> off;
    for (int step = 0; step < steps; ++step) {
      off = block_misfits(blocks, some, joint, start, fitted);
      some = least_half(off).first;
    }
    if (const double sum = least_half(off).second; sum < least) {
      least = sum;
      best = std::move(off);
    }
  }
  return best;
}

}  // namespace detail

/// Leaves out of a run what is far off the rest of it: contact, or a hand that moves the finger. A run in which nothing
/// is stays as it is. `torque_constant_Nm_per_A`: as identify_joints. Throws InvalidArgument for numbers that are not
/// finite.
inline FreeRun free_run(std::span<const JointSample> run, std::span<const double> torque_constant_Nm_per_A,
    const FreeRunLimits& limits = {}) {
  FreeRun free{{run.begin(), run.end()}};
  if (run.size() < limits.least) return free;
  constexpr double most_blocks = 1000.0;
  const double run_s = 1e-9 * double(run.back().stamp_ns - run.front().stamp_ns);
  const detail::RunBlocks blocks = detail::run_blocks(run, std::max(limits.block_s, run_s / most_blocks));
  const std::size_t n = blocks.mean.size();
  if (n < limits.least) return free;
  std::vector<bool> far(n, false);
  for (int j = 0; j < int(run.front().effort.size()); ++j) {
    TorqueModel start;
    if (std::size_t(j) < torque_constant_Nm_per_A.size())
      start.torque_constant_Nm_per_A = torque_constant_Nm_per_A[std::size_t(j)];
    double low = blocks.mean.front().position_rad[j], high = low;
    for (const JointSample& s : blocks.mean) {
      low = std::min(low, s.position_rad[j]);
      high = std::max(high, s.position_rad[j]);
    }
    const bool fitted = n >= limits.fitted;
    if (!fitted && high - low > limits.still_rad) continue;
    const std::vector<double> off = detail::robust_misfits(blocks.mean, j, start, fitted, limits.steps);
    std::vector<double> size;
    for (const double o : off) size.push_back(std::abs(o));
    const double limit = std::max(limits.far_sigmas * quantile(size, 0.5) / half_of_normal, limits.far_Nm);
    for (std::size_t i = 0; i < n; ++i) far[i] = far[i] || size[i] > limit;
  }
  std::vector<bool> alone(n);  // a joint that turns round is off for a moment, too
  for (std::size_t i = 0; i < n; ++i) alone[i] = !(i > 0 && far[i - 1]) && !(i + 1 < n && far[i + 1]);
  for (std::size_t i = 0; i < n; ++i) far[i] = far[i] && !alone[i];
  const auto left_out = std::size_t(std::count(far.begin(), far.end(), true));
  if (left_out == 0 || left_out == n) return free;
  free.samples.clear();
  for (std::size_t i = 0; i < n; ++i)  // what lies beside contact is the begin of it, or its end
    if (!far[i] && !(i > 0 && far[i - 1]) && !(i + 1 < n && far[i + 1]))
      free.samples.insert(free.samples.end(), run.begin() + std::ptrdiff_t(blocks.samples[i].first),
          run.begin() + std::ptrdiff_t(blocks.samples[i].second));
  if (free.samples.empty()) free.samples.assign(run.begin(), run.end());
  free.left_out = 1.0 - double(free.samples.size()) / double(run.size());
  return free;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/joints/joint_reference.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_JOINTS_JOINT_REFERENCE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_JOINTS_JOINT_REFERENCE_HPP

namespace lumo::sense {

/// What a run without contact gives for each joint.
struct JointReference {
  std::vector<TorqueModel> torque;    ///< friction, weight, offset and noise; empty without joint samples
  std::vector<double> standstill_Nm;  ///< what may stick unseen
  /// All efforts are whole multiples of it apart, the coarsest joint's [A or N·m]; 0: no step is seen.
  double effort_step = 0.0;
  double left_out = 0.0;  ///< share of the run whose torque is far off the rest's: contact (free_run)
};

/// Limits of the identification of joints; chosen on the virtual lab, none is critical.
struct JointIdentification {
  double moving_rad_per_s = 0.05;  ///< a faster sample shows friction: beyond the speeds of a held joint
  std::size_t least_moving = 100;  ///< moving samples that six parameters need; with fewer, all samples are taken
  /// Where there are too few rests. A scatter of 0.08 explains the paper's force error of 1.29 N
  /// (lab::MotorRig::stiction_Nm); a model from one rest and the next contact have √2 times that between them.
  double assumed_standstill_Nm = 0.11;
  double least_rest_s = 0.1;  ///< a shorter stop is a reversal, no rest; a longer pause of the samples ends one
  int least_rest_samples = 3, least_rests = 3;  ///< for a mean; for its scatter
  double rest_velocities = 1.5;                 ///< of TorqueModel::rest_velocity_rad_per_s: slower is at rest
  int least_changes = 20;                       ///< of an effort, before a step counts as the driver's
  double step_tolerance = 1e-3;  ///< part of a step by which efforts may be off its multiples: rounding of texts
};

/// Means of the torque of an unloaded joint at rest, less the model's.
struct RestScatter {
  double squares = 0.0;  ///< their sum [N²m²]
  int rests = 0;

  double rms() const { return std::sqrt(squares / rests); }
};

/// How far each rest of a run is off the model. What sticks differs from rest to rest, and adds unseen to the torque of
/// a contact. nullopt for too few rests.
inline std::optional<RestScatter> standstill_scatter(
    std::span<const JointSample> samples, int joint, const TorqueModel& model, const JointIdentification& limits = {}) {
  RestScatter scatter;
  double sum = 0.0;
  int count = 0;
  std::int64_t from = 0, last = 0;
  const auto close = [&] {
    if (count >= limits.least_rest_samples && 1e-9 * double(last - from) >= limits.least_rest_s) {
      scatter.squares += std::pow(sum / count, 2);
      ++scatter.rests;
    }
    sum = 0.0;
    count = 0;
  };
  for (const JointSample& s : samples) {
    const bool moves = std::abs(s.velocity_rad_per_s[joint]) > limits.rest_velocities * model.rest_velocity_rad_per_s;
    if (moves || 1e-9 * double(s.stamp_ns - last) > limits.least_rest_s) close();
    if (moves) continue;
    if (count == 0) from = s.stamp_ns;
    last = s.stamp_ns;
    sum += model.motor_torque(s.effort[joint], s.unit) - model.unloaded(s.position_rad[joint], 0.0);
    ++count;
  }
  close();
  return scatter.rests >= limits.least_rests ? std::optional(scatter) : std::nullopt;
}

/// The step in which a driver of few bits gives a joint's efforts [A or N·m]; 0 where they are not whole multiples of
/// one apart.
inline double effort_step(std::span<const JointSample> samples, int joint, const JointIdentification& limits = {}) {
  double step = std::numeric_limits<double>::infinity();
  int changes = 0;
  for (std::size_t i = 1; i < samples.size(); ++i)
    if (const double d = std::abs(samples[i].effort[joint] - samples[i - 1].effort[joint]); d > 0.0) {
      step = std::min(step, d);
      ++changes;
    }
  if (changes < limits.least_changes) return 0.0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double steps = (samples[i].effort[joint] - samples[i - 1].effort[joint]) / step;
    if (std::abs(steps - std::round(steps)) > limits.step_tolerance) return 0.0;
  }
  return step;
}

/// Friction, weight and offset of each joint from samples without contact. Moving samples show friction, resting ones
/// what sticks; where the run has too few rests, those of `later` samples without contact do.
/// `torque_constant_Nm_per_A`: of each joint, which such a run does not show; joints that give torques need none.
/// Throws InvalidArgument for numbers that are not finite.
inline JointReference identify_joints(std::span<const JointSample> free,
    std::span<const double> torque_constant_Nm_per_A, const JointIdentification& limits = {},
    std::span<const JointSample> later = {}) {
  JointReference reference;
  if (free.empty()) return reference;
  std::vector<JointSample> moving;
  for (const JointSample& s : free)
    if (s.velocity_rad_per_s.cwiseAbs().maxCoeff() > limits.moving_rad_per_s) moving.push_back(s);
  const auto joints = int(free.front().effort.size());
  for (int j = 0; j < joints; ++j) {
    TorqueModel start;
    if (std::size_t(j) < torque_constant_Nm_per_A.size())
      start.torque_constant_Nm_per_A = torque_constant_Nm_per_A[std::size_t(j)];
    reference.torque.push_back(
        identify_unloaded(moving.size() >= limits.least_moving ? std::span<const JointSample>(moving) : free, j, start)
            .model);
    const TorqueModel& model = reference.torque.back();
    double stuck = limits.assumed_standstill_Nm;
    if (const auto run = standstill_scatter(free, j, model, limits)) {
      stuck = run->rms();
    } else if (auto few = standstill_scatter(later, j, model, limits)) {  // the assumption counts as some rests more
      few->squares += limits.least_rests * std::pow(stuck, 2);
      few->rests += limits.least_rests;
      stuck = few->rms();
    }
    reference.standstill_Nm.push_back(stuck);
    reference.effort_step = std::max(reference.effort_step, effort_step(free, j, limits));
  }
  return reference;
}

/// From the samples up to `until_ns`.
inline JointReference identify_joints(std::span<const JointSample> samples,
    std::span<const double> torque_constant_Nm_per_A, std::int64_t until_ns, const JointIdentification& limits = {}) {
  std::vector<JointSample> free;
  for (const JointSample& s : samples)
    if (s.stamp_ns <= until_ns) free.push_back(s);
  return identify_joints(free, torque_constant_Nm_per_A, limits);
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/profile/first_touch.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_PROFILE_FIRST_TOUCH_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_PROFILE_FIRST_TOUCH_HPP

namespace lumo::sense {

/// Limits of a touch that pictures show beyond doubt; chosen on the virtual lab.
struct FirstTouchLimits {
  int smoothing = 5;       ///< values of a profile that are averaged first
  double noises = 8.0;     ///< by which a place must be brighter than unloaded …
  double share = 0.08;     ///< … and this share of its light
  int pictures = 3;        ///< in a row
  double before_s = 0.25;  ///< a touch begins so much before it is beyond doubt
};

/// Up to when pictures show the finger untouched, in the order of their stamps: shortly before the first few in a row
/// in which it is brighter at one place than unloaded, or the last one's stamp. What changes all light alike is no
/// touch. 0 without pictures.
inline std::int64_t untouched_until_ns(
    const std::vector<Profile>& profiles, const UnloadedReference& unloaded, const FirstTouchLimits& limits = {}) {
  const Eigen::VectorXd& mean = unloaded.mean();
  const Eigen::VectorXd noise = unloaded.noise();
  const Eigen::Index n = mean.size(), half = limits.smoothing / 2;
  int in_a_row = 0;
  std::int64_t first_ns = 0;
  for (const Profile& p : profiles) {
    if (p.value.size() != n || n <= 2 * half || !p.value.allFinite()) continue;
    const Eigen::VectorXd ratio = p.value.cwiseQuotient(mean.cwiseMax(1e-9));
    const Eigen::VectorXd change = p.value - median({ratio.data(), ratio.data() + n}) * mean;
    bool touched = false;
    for (Eigen::Index i = half; i < n - half && !touched; ++i) {
      const auto smooth = [&](const Eigen::VectorXd& v) { return v.segment(i - half, 2 * half + 1).mean(); };
      touched = smooth(change) > std::max(limits.noises * smooth(noise), limits.share * smooth(mean));
    }
    if (!touched) {
      in_a_row = 0;
      continue;
    }
    if (in_a_row++ == 0) first_ns = p.stamp_ns;
    if (in_a_row == limits.pictures) return first_ns - std::llround(1e9 * limits.before_s);
  }
  return profiles.empty() ? 0 : profiles.back().stamp_ns;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/finger_model.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_FINGER_MODEL_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_FINGER_MODEL_HPP

namespace lumo::sense {

/// The optical half of what is known of a finger: all that a location needs.
struct FingerOptics {
  LongitudinalBins bins = LongitudinalBins::uniform(-27.5_mm, 27.5_mm, 55);  ///< of 1 mm, where profiles are read
  FingerView view;             ///< camera's axis map and lit band, from the LEDs in an unloaded picture
  UnloadedReference unloaded;  ///< light at rest and its noise in each bin [DN], from unloaded pictures

  double from_m = -27.5_mm, to_m = 27.5_mm;  ///< where contacts are sought: the paper's 11 regions of 5 mm
  double end_m = 30.0_mm;                    ///< clear ends of the finger of 60 mm mirror a contact's light
  /// How far bumps of light lie from contacts, and how much farther near the ends. Chosen, as `end_m` was, by seeds 1
  /// to 10 of the virtual lab; those seeds do not judge it.
  double bias_sigma_m = 0.75_mm, end_bias_sigma_m = 1.25_mm;

  GreenProfile readout() const { return view.readout(bins); }
  /// Standard deviation of the map from image to finger at the origin [m].
  double map_sigma_m() const { return std::sqrt(view.leds.map.variance_m2(0.0)); }
};

/// The probabilistic localiser for a finger with clear ends. Throws InvalidArgument without view or unloaded pictures.
inline BayesLocalizer bayes_localizer(const FingerOptics& finger) {
  BayesLocalizer::Config c;
  c.position_m = finger.readout().positions_m();
  c.noise = finger.unloaded.noise();
  c.unloaded = finger.unloaded.mean();
  c.from_m = finger.from_m;
  c.to_m = finger.to_m;
  c.bias_sigma_m = finger.bias_sigma_m;
  c.end_m = finger.end_m;
  c.end_bias_sigma_m = finger.end_bias_sigma_m;
  return BayesLocalizer(c);
}

/// The localiser at the brightest place. Throws InvalidArgument without view or unloaded pictures.
inline PeakLocalizer peak_localizer(const FingerOptics& finger) {
  return PeakLocalizer({finger.readout().positions_m(), finger.unloaded.noise()});
}

/// How sure templates are of the pad at hand: computed ones of a pad of this design, or recorded ones of this very pad.
enum class TemplateSource { computed, recorded };

/// Settings of the localiser of a pad whose responses are known; `lamp_m`: where its LEDs are. The scatter at rest is
/// the mean over 9 neighbouring positions: a short unloaded stretch does not tell one position's own. Throws
/// InvalidArgument without view or unloaded pictures, or where these show none of the templates' light.
inline TemplateLocalizer::Config template_config(const FingerOptics& finger, const ResponseTemplates& templates,
    const std::vector<double>& lamp_m, TemplateSource source = TemplateSource::computed) {
  constexpr Eigen::Index neighbours = 4;  // to each side
  TemplateLocalizer::Config c;
  c.position_m = finger.readout().positions_m();
  const Eigen::VectorXd noise = finger.unloaded.noise();
  const Eigen::Index n = noise.size();
  c.noise.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Index from = std::max<Eigen::Index>(0, i - neighbours), to = std::min(n - 1, i + neighbours);
    c.noise[i] = rms(noise.segment(from, to - from + 1));
  }
  c.unloaded = finger.unloaded.mean();
  c.lamp_m = lamp_m;
  c.from_m = finger.from_m;
  c.to_m = finger.to_m;
  c.templates = scaled_to(templates, c.position_m, c.unloaded, lamp_m);
  if (source == TemplateSource::recorded) {
    c.size_sigma = 0.15;
    c.shape_sigma = 0.12;  // places may lie 10 mm apart
    c.pad_sigma_m = 0.2_mm;
  }
  return c;
}

/// What is assumed of a finger's streams and of what sticks in its joints; chosen on the virtual lab.
struct StreamAssumptions {
  double least_scatter = 0.05;  ///< of an effort [A or N·m]: jumps of quieter joints are not watched more closely
  double spike_scatters = 6.0;  ///< a jump of an effort by so many scatters is a fault; noise makes 2 in 10⁹ of them
  double least_standstill_Nm = 5e-3;  ///< that may stick unseen, however quiet the rests were
  double standstill_s = 0.5;          ///< what sticks at rest says nothing of what sticks under the next contact
  double frame_timeout_s = 0.2, frame_timeout_periods = 4.0;    ///< no frame for the longer of both is a fault
  double joint_timeout_s = 0.05, joint_timeout_periods = 10.0;  ///< the same of joint samples
  double joint_gap_s = 0.02, joint_gap_periods = 5.0;  ///< joints are interpolated over at most the longer of both
};

/// All that is known of a finger: what estimates of a recording and of a live run start from.
template <ContactJacobian Jacobian = PlanarFinger> struct FingerModel {
  Session session;        ///< LEDs [m], torque constants [N·m/A], delays [s], clocks; from session.json
  Jacobian jacobian;      ///< geometry of the joints: contact force to motor torque
  int link = 0;           ///< of `jacobian`, the one with the pad
  FingerOptics optics;    ///< known_finger and live runs fill in view and light
  JointReference joints;  ///< friction, weight, offset, noise and what sticks [N·m], from an unloaded run
  StreamAssumptions assumptions;
};

/// The session's finger with parallel joints; view, light and joints are still to be identified. Throws
/// InvalidArgument.
inline FingerModel<> finger_model(const Session& session) {
  PlanarFinger joints(session.joint_to_joint_m, session.joint_to_origin_m);
  const int link = joints.pad_link();
  return {session, std::move(joints), link, {}, {}, {}};
}

/// Periods of a finger's streams, and the unit of its efforts.
struct StreamRates {
  double frame_period_s = FrameMonitor::Config{}.period_s;
  double joint_period_s = JointMonitor::Config{}.period_s;
  Effort unit = Effort::torque_Nm;
};

/// Of a recording with at least two joint samples.
inline StreamRates stream_rates(std::span<const FrameRecord> frames, std::span<const JointSample> samples) {
  StreamRates rates;
  rates.unit = samples.front().unit;
  rates.joint_period_s = stream_period_s(samples);
  if (frames.size() > 1) rates.frame_period_s = stream_period_s(frames);
  return rates;
}

/// Whether somebody said when the finger was without contact: by segments, or by a chosen stretch.
inline bool is_stated(const Session& session, const UnloadedStretch& rest) {
  return rest.chosen || std::any_of(session.segments.begin(), session.segments.end(),
                            [](const Segment& g) { return g.is_without_contact(); });
}

/// The stretch that joints are learnt from: `rest`, or where nobody said when the finger was free up to shortly before
/// the first contact that `profiles` show, or that the session names.
inline UnloadedStretch joint_stretch(const Session& session, const UnloadedStretch& rest,
    const std::vector<Profile>& profiles, const UnloadedReference& unloaded) {
  if (is_stated(session, rest)) return rest;
  UnloadedStretch longer = rest;
  longer.to_ns = std::max(rest.to_ns, untouched_until_ns(profiles, unloaded));
  for (const Segment& g : session.segments)
    if (g.from_ns > rest.to_ns) longer.to_ns = std::min(longer.to_ns, g.from_ns);
  return longer;
}

/// A recording's joint samples, stamped on the frames' clock. Velocities that do not fit the positions are taken from
/// these (mend_velocities). Throws InputError for positions in degrees.
inline std::vector<JointSample> on_frames_clock(const Recording& recording) {
  std::vector<JointSample> samples = recording.joints;
  for (JointSample& s : samples) s.stamp_ns = recording.session.joint_clock(s.stamp_ns);
  try {
    mend_velocities(samples);
  } catch (const InvalidArgument& e) {
    throw InputError(message(recording.path, ": ", e.what()));
  }
  return samples;
}

/// The samples of a recording, on the frames' clock, that are without contact.
struct UntouchedSamples {
  /// Up to the end of the unloaded stretch. Where contacts came before, or the stretch was chosen, nothing is assumed
  /// of what lies between: then only those in the stretch and in segments that say so (unloaded, dark, free).
  std::vector<JointSample> first;
  /// In segments after that. They do not enter the joints' model: a joint sticks otherwise after each contact, and a
  /// mean over many rests is farther off the next one (lab: 2.2 against 1.4 N).
  std::vector<JointSample> later;
};
inline UntouchedSamples samples_without_contact(const Recording& recording, const UnloadedStretch& rest) {
  const std::vector<Segment>& segments = recording.session.segments;
  const bool after_contact = rest.chosen || std::any_of(segments.begin(), segments.end(), [&](const Segment& g) {
    return !g.is_without_contact() && g.from_ns < rest.to_ns;
  });
  UntouchedSamples untouched;
  for (JointSample& s : on_frames_clock(recording)) {
    const bool stated = rest.holds(s.stamp_ns) || std::any_of(segments.begin(), segments.end(), [&](const Segment& g) {
      return g.is_without_contact() && g.holds(s.stamp_ns);
    });
    if (s.stamp_ns > rest.to_ns) {
      if (stated) untouched.later.push_back(std::move(s));
    } else if (stated || !after_contact) {
      untouched.first.push_back(std::move(s));
    }
  }
  return untouched;
}

/// What a recording's samples without contact show of the finger's joints. Where nobody said when these were, what is
/// far off the rest of them is left out. Throws InputError if there are none, or of other joints than the session's.
inline JointReference unloaded_joints(const Recording& recording, const UnloadedStretch& rest) {
  const Session& session = recording.session;
  require_readable(recording, LogStream::joints);
  if (recording.joints.empty())
    throw InputError(recording.path + ": has no joint samples (joint.csv) to estimate a force from");
  const int joints = PlanarFinger(session.joint_to_joint_m, session.joint_to_origin_m).joints();
  if (recording.joints.front().effort.size() != joints)
    throw InputError(message(recording.path, ": the session describes ", joints, joints == 1 ? " joint" : " joints",
        " (joint_to_joint_mm), the samples have ", recording.joints.front().effort.size()));
  UntouchedSamples untouched = samples_without_contact(recording, rest);
  FreeRun free{std::move(untouched.first)};
  if (free.samples.empty()) throw InputError(recording.path + ": has no joint samples of the finger without contact");
  if (!is_stated(session, rest)) free = free_run(free.samples, session.torque_constant_Nm_per_A);
  JointReference reference = identify_joints(free.samples, session.torque_constant_Nm_per_A, {}, untouched.later);
  reference.left_out = free.left_out;
  return reference;
}

/// Settings of the force estimator of a finger whose joints were identified. One limit on jumps holds for all joints,
/// that of the one that scatters most.
template <ContactJacobian J> ForceEstimatorConfig force_config(const FingerModel<J>& finger, const StreamRates& rates) {
  const StreamAssumptions& assumed = finger.assumptions;
  const JointReference& joints = finger.joints;
  ForceEstimatorConfig config;
  config.torque = joints.torque;
  config.filter.link = finger.link;
  config.joints.joints = int(joints.torque.size());
  config.joints.period_s = rates.joint_period_s;
  double scatter = assumed.least_scatter, quietest = config.joints.max_effort;
  for (const TorqueModel& m : joints.torque) {
    const double noise =
        rates.unit == Effort::current_A ? std::abs(m.noise_Nm / m.torque_constant_Nm_per_A) : m.noise_Nm;
    scatter = std::max(scatter, noise);
    quietest = std::min(quietest, noise);
  }
  config.joints.quantum = std::min(joints.effort_step, config.joints.max_effort);
  config.joints.noise = quietest;
  config.joints.spike = assumed.spike_scatters * scatter;
  config.frames.period_s = rates.frame_period_s;
  config.filter.torque_bias_Nm = assumed.least_standstill_Nm;
  for (const double stuck : joints.standstill_Nm)
    config.filter.torque_bias_Nm = std::max(config.filter.torque_bias_Nm, stuck);
  config.filter.torque_bias_s = assumed.standstill_s;
  config.frame_delay_s = finger.session.frame_delay_s;
  config.joint_delay_s = finger.session.joint_delay_s;
  config.frame_timeout_s = std::max(assumed.frame_timeout_s, assumed.frame_timeout_periods * rates.frame_period_s);
  config.joint_timeout_s = std::max(assumed.joint_timeout_s, assumed.joint_timeout_periods * rates.joint_period_s);
  config.map_sigma_m = finger.optics.map_sigma_m();
  return config;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/torque_scale.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_TORQUE_SCALE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_TORQUE_SCALE_HPP

namespace lumo::sense {

/// A force by torque and place, as the given torque constants have it, and the truth.
struct TorqueForce {
  int sequence = 0;           ///< number of the contact that the sample is of
  double true_y_m = 0.0;      ///< of that contact
  double force_N = 0.0;       ///< α = 1; below 0 counts as 0
  double true_force_N = 0.0;  ///< of the force sensor
};

/// One sequence with its own factor, and with that of all others.
struct SequenceScale {
  int sequence = 0, samples = 0;
  double y_m = 0.0;
  double alpha = 1.0, mae_in_sample_N = 0.0;                ///< fitted on this sequence, and judged on it
  double alpha_of_others = 1.0, mae_out_of_sample_N = 0.0;  ///< fitted on all others, judged on this one
};

/// Mean absolute errors [N] of F = max(0, α F₁), where F₁ is the force as the given torque constants have it and α is
/// fitted to true forces.
struct TorqueScale {
  std::vector<SequenceScale> sequences;
  SequenceScale fitted_on;           ///< the one whose α the next two are of
  double mae_in_sample_N = 0.0;      ///< over all samples, those that α was fitted on included
  double mae_without_it_N = 0.0;     ///< over the samples of the other sequences
  double mae_out_of_sample_N = 0.0;  ///< over all samples, each with the α fitted on the other sequences
};

namespace detail {

/// Least squares over the samples of chosen sequences; nullopt where all their forces are 0.
template <class Chosen> std::optional<double> fitted_alpha(std::span<const TorqueForce> samples, Chosen chosen) {
  double products = 0.0, squares = 0.0;
  for (const TorqueForce& s : samples)
    if (chosen(s.sequence)) {
      const double force = std::max(0.0, s.force_N);
      products += force * s.true_force_N;
      squares += force * force;
    }
  return squares > 0.0 ? std::optional(products / squares) : std::nullopt;
}

template <class Chosen> double mean_error_N(std::span<const TorqueForce> samples, double alpha, Chosen chosen) {
  double sum = 0.0;
  int n = 0;
  for (const TorqueForce& s : samples)
    if (chosen(s.sequence)) {
      sum += std::abs(std::max(0.0, alpha * s.force_N) - s.true_force_N);
      ++n;
    }
  return n > 0 ? sum / n : 0.0;
}

}  // namespace detail

/// What a factor α from torque to force is worth that was fitted, by least squares through the origin, on the samples
/// it is judged by, and on others. The paper's authors fit α on one of the six sequences that their MAE is taken over
/// (dokkev/fingertip-design-framework, fig6d_force_timeseries.py); `fitted_on` is that sequence here. One sequence left
/// out shows what contacts err by whose forces were not measured before. nullopt for fewer than two sequences, or one
/// whose forces are all 0. Throws InvalidArgument for numbers that are not finite, or where no sample is of
/// `fitted_on`.
inline std::optional<TorqueScale> torque_scale(std::span<const TorqueForce> samples, int fitted_on = 0) {
  std::map<int, SequenceScale> sequences;
  for (const TorqueForce& s : samples) {
    require_in_range("force of the torque scale", s.force_N, -1e6, 1e6, "N");
    require_in_range("true force of the torque scale", s.true_force_N, -1e6, 1e6, "N");
    require_in_range("place of the torque scale", s.true_y_m, -10.0, 10.0, "m");
    SequenceScale& of = sequences[s.sequence];
    of.sequence = s.sequence;
    of.y_m += (s.true_y_m - of.y_m) / double(++of.samples);
  }
  if (sequences.size() < 2) return std::nullopt;
  const auto from = sequences.find(fitted_on);
  if (from == sequences.end())
    throw InvalidArgument(message("torque scale: there is no sequence ", fitted_on, " to fit alpha on"));
  TorqueScale scale;
  for (auto& entry : sequences) {
    SequenceScale& s = entry.second;
    const auto here = [&](int sequence) { return sequence == s.sequence; };
    const auto elsewhere = [&](int sequence) { return sequence != s.sequence; };
    const auto own = detail::fitted_alpha(samples, here), others = detail::fitted_alpha(samples, elsewhere);
    if (!own || !others) return std::nullopt;
    s.alpha = *own;
    s.alpha_of_others = *others;
    s.mae_in_sample_N = detail::mean_error_N(samples, *own, here);
    s.mae_out_of_sample_N = detail::mean_error_N(samples, *others, here);
    scale.mae_out_of_sample_N += s.mae_out_of_sample_N * s.samples / double(samples.size());
    scale.sequences.push_back(s);
  }
  scale.fitted_on = from->second;
  const double alpha = scale.fitted_on.alpha;
  scale.mae_in_sample_N = detail::mean_error_N(samples, alpha, [](int) { return true; });
  scale.mae_without_it_N = detail::mean_error_N(samples, alpha, [&](int sequence) { return sequence != fitted_on; });
  return scale;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/force_baselines.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_FORCE_BASELINES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_FORCE_BASELINES_HPP

namespace lumo::sense {

/// One moment of a log at which a force is asked for: joints there, what was estimated of the place, and the truth to
/// compare with.
struct ForceSample {
  std::int64_t stamp_ns = 0;
  JointVector position_rad, contact_torque_Nm;  ///< torque: motor minus torque model
  std::optional<double> estimated_y_m;          ///< of the localiser
  std::optional<double> fused_N;                ///< of the force estimator
  double true_y_m = 0.0, true_force_N = 0.0;
  int sequence = 0;  ///< of samples in one contact
};

/// Mean absolute errors [N] of the ways to a force, over the samples for which each gave one.
struct ForceErrors {
  struct Error {
    double mae_N = 0.0;
    int samples = 0;
  };
  Error fused;           ///< the filter
  Error optical;         ///< sample by sample, at the localiser's place
  Error fixed_arm;       ///< at the middle of the tested range
  Error known_location;  ///< at the true place
  Error torque_only;     ///< from the ratio of torques; none for a single joint
  struct Common {
    Error optical, fixed_arm, known_location;
  };
  Common common;  ///< over the samples for which all three gave one
  /// Share of the gap between fixed arm and known location that the optical location recovers (paper: 89.5 %), over the
  /// common samples; empty where there is no gap.
  std::optional<double> recovery() const {
    const double gap = common.fixed_arm.mae_N - common.known_location.mae_N;
    return common.optical.samples && gap > 0.0 ? std::optional((common.fixed_arm.mae_N - common.optical.mae_N) / gap)
                                               : std::nullopt;
  }
};

/// Contact torques of the joints at a time, interpolated in the joint log and moved to the frames' clock; nullopt in
/// gaps of more than `max_gap_s`.
class ContactTorques {
 public:
  /// Throws InvalidArgument for no samples, or models that do not fit the joints.
  ContactTorques(std::span<const JointSample> samples, const std::vector<TorqueModel>& models,
      const ClockMap& clock = {}, double delay_s = 0.0)
      : joints_(int(models.size())), series_(series(samples, models, clock, delay_s)) {}

  /// Positions, then torques.
  std::optional<Eigen::VectorXd> at(std::int64_t stamp_ns, double max_gap_s = 0.02) const {
    return series_.at(stamp_ns, max_gap_s);
  }
  int joints() const { return joints_; }
  /// RMS misfit of interpolation in position [rad] and torque [N·m], joint by joint.
  Eigen::VectorXd residual() const { return series_.interpolation_residual(); }

 private:
  static TimeSeries series(std::span<const JointSample> samples, const std::vector<TorqueModel>& models,
      const ClockMap& clock, double delay_s) {
    const auto n = Eigen::Index(models.size());
    std::vector<std::int64_t> stamp;
    Eigen::MatrixXd value(2 * n, Eigen::Index(samples.size()));
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const JointSample& s = samples[i];
      if (s.effort.size() != n || s.position_rad.size() != n || s.velocity_rad_per_s.size() != n)
        throw InvalidArgument(
            message("contact torques: sample ", i, " has ", s.effort.size(), " joints, there are ", n, " models"));
      stamp.push_back(clock(s.stamp_ns) - std::llround(1e9 * delay_s));
      for (Eigen::Index j = 0; j < n; ++j) {
        const TorqueModel& m = models[std::size_t(j)];
        value(j, Eigen::Index(i)) = s.position_rad[j];
        value(n + j, Eigen::Index(i)) =
            m.motor_torque(s.effort[j], s.unit) - m.unloaded(s.position_rad[j], s.velocity_rad_per_s[j]);
      }
    }
    if (stamp.empty() || n == 0) throw InvalidArgument("contact torques: no samples or no joints");
    return {std::move(stamp), std::move(value)};
  }

  int joints_;
  TimeSeries series_;
};

/// Force at an assumed place by a sample's torques [N], of either sign; nullopt where they do not give it.
template <ContactJacobian J>
std::optional<double> force_at(const J& jacobian, const ForceSample& s, const ContactPoint& point, double sigma_Nm) {
  const Identification f = solve_forces(jacobian, s.position_rad, s.contact_torque_Nm, std::span(&point, 1), sigma_Nm);
  return f.complete() ? std::optional(f.value[0]) : std::nullopt;
}

/// Forces at the places seen, for torque_scale.
template <ContactJacobian J> std::vector<TorqueForce> optical_forces(
    const J& jacobian, std::span<const ForceSample> samples, int link, double torque_sigma_Nm) {
  std::vector<TorqueForce> list;
  for (const ForceSample& s : samples)
    if (s.estimated_y_m)
      if (const auto f = force_at(jacobian, s, {link, *s.estimated_y_m}, torque_sigma_Nm))
        list.push_back({s.sequence, s.true_y_m, *f, s.true_force_N});
  return list;
}

/// Compares the ways to a force on the same samples. The middle of the `tested` range is the fixed arm. All ways alike
/// give forces of at least 0.
template <ContactJacobian J> ForceErrors force_errors(
    const J& jacobian, std::span<const ForceSample> samples, const PadRange& tested, double torque_sigma_Nm) {
  require_in_range("end of the tested range", tested.to_m, tested.from_m, 10.0, "m");
  ForceErrors e;
  const auto count = [](ForceErrors::Error& error, double force, double truth) {
    error.mae_N += (std::abs(std::max(0.0, force) - truth) - error.mae_N) / double(++error.samples);
  };
  for (const ForceSample& s : samples) {
    const auto at = [&](ForceErrors::Error& error, double y) {
      const auto f = force_at(jacobian, s, {tested.link, y}, torque_sigma_Nm);
      if (f) count(error, *f, s.true_force_N);
      return f;
    };
    if (s.fused_N) count(e.fused, *s.fused_N, s.true_force_N);
    const auto optical = s.estimated_y_m ? at(e.optical, *s.estimated_y_m) : std::nullopt;
    const auto fixed = at(e.fixed_arm, tested.middle_m()), known = at(e.known_location, s.true_y_m);
    if (optical && fixed && known) {
      count(e.common.optical, *optical, s.true_force_N);
      count(e.common.fixed_arm, *fixed, s.true_force_N);
      count(e.common.known_location, *known, s.true_force_N);
    }
    const TorqueOnlySolution alone =
        solve_torque_only(jacobian, s.position_rad, s.contact_torque_Nm, tested, torque_sigma_Nm);
    if (alone.rank == 2) count(e.torque_only, alone.force_N, s.true_force_N);
  }
  return e;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/frame_estimate.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_FRAME_ESTIMATE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_FRAME_ESTIMATE_HPP

namespace lumo::sense {

/// What is estimated at one frame of a recording.
struct FrameEstimate {
  std::int64_t stamp_ns = 0;
  LocationEstimate location;              ///< of the localiser
  ForceEstimate force;                    ///< of the filter
  std::optional<Eigen::VectorXd> joints;  ///< positions [rad], then contact torques [N·m], interpolated
  double seconds = 0.0;                   ///< from decoded picture to estimate

  /// Where the localiser sees exactly one contact.
  std::optional<ContactLocation> contact() const {
    return location.contacts == 1 ? std::optional(location.contact[0]) : std::nullopt;
  }
};

/// Half of a normal's 90 % interval, in standard deviations.
inline constexpr double sigmas_of_90_percent = 1.6448536269514722;

/// How well locations agree with the truth.
struct LocationScore {
  int samples = 0;           ///< frames to be located
  int located = 0;           ///< of them, those with exactly one contact found
  double mae_m = 0.0;        ///< over the located ones
  double coverage_90 = 0.0;  ///< share of the located ones whose 90 % interval holds the truth
};

/// Over the frames with a true force of at least `from_N` at a known place.
inline LocationScore location_score(std::span<const FrameEstimate> estimates, const LogTruth& truth, double from_N) {
  LocationScore s;
  int covered = 0;
  for (const FrameEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (!t.y_m || !t.force_N || *t.force_N < from_N) continue;
    ++s.samples;
    const std::optional<ContactLocation> at = e.contact();
    if (!at) continue;
    ++s.located;
    const double off = std::abs(at->y_m - *t.y_m);
    s.mae_m += off;
    covered += off <= sigmas_of_90_percent * std::sqrt(at->variance_m2);
  }
  if (s.located > 0) {
    s.mae_m /= s.located;
    s.coverage_90 = double(covered) / s.located;
  }
  return s;
}

/// Errors of forces against the truth.
struct ForceScore {
  ForceErrors errors;
  int samples = 0;
  double coverage_90 = 0.0;  ///< of the fused force's 90 % interval
  /// At the places seen, with torque constants as given: fitted on none of these samples (torque_scale fits a factor).
  std::vector<TorqueForce> optical;
};

/// Over the frames with a true force of at least `from_N`. Where the localiser saw no single contact the optical way
/// takes the middle of the tested range, so that all ways stand on the same samples; nothing is filled in from later
/// frames, so that each estimate is causal. A sequence ends where the true force falls below `from_N` or the true place
/// changes.
template <ContactJacobian J> ForceScore force_score(std::span<const FrameEstimate> estimates, const LogTruth& truth,
    const J& jacobian, const PadRange& tested, double torque_sigma_Nm, double from_N = 0.5) {
  std::vector<ForceSample> samples;
  int given = 0, covered = 0;
  bool touched = false;
  for (const FrameEstimate& e : estimates) {
    const LogTruth::Touch t = truth.at(e.stamp_ns);
    if (t.force_N && *t.force_N < from_N) touched = false;
    if (!t.y_m || !t.force_N || *t.force_N < from_N || !e.joints) continue;
    ForceSample s;
    if (!samples.empty()) s.sequence = samples.back().sequence + (touched && samples.back().true_y_m == *t.y_m ? 0 : 1);
    touched = true;
    const Eigen::Index n = e.joints->size() / 2;
    s.stamp_ns = e.stamp_ns;
    s.position_rad = e.joints->head(n);
    s.contact_torque_Nm = e.joints->tail(n);
    s.true_y_m = *t.y_m;
    s.true_force_N = *t.force_N;
    const std::optional<ContactLocation> at = e.contact();
    s.estimated_y_m = at ? at->y_m : tested.middle_m();
    const ContactForce& fused = e.force.contact[0];
    s.fused_N = fused.force_N;
    if (fused.force_N) {
      ++given;
      covered += std::abs(*fused.force_N - *t.force_N) <= sigmas_of_90_percent * std::sqrt(fused.force_variance_N2);
    }
    samples.push_back(std::move(s));
  }
  ForceScore score;
  score.samples = int(samples.size());
  const std::span<const ForceSample> all(samples);
  if (!all.empty()) score.errors = force_errors(jacobian, all, tested, torque_sigma_Nm);
  score.optical = optical_forces(jacobian, all, tested.link, torque_sigma_Nm);
  score.coverage_90 = given > 0 ? double(covered) / given : 0.0;
  return score;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/estimate.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_ESTIMATE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_ESTIMATE_HPP

namespace lumo::sense {

/// Of a reference, so that light relative to it is a number [DN].
inline constexpr double least_light_DN = 1e-6;

/// Picture → profile → unloaded reference; torques → joints: what a recording's unloaded stretch gives.
/// `make_camera()` gives the pictures from their start. Throws InputError if no unloaded finger is seen or felt.
template <class MakeCamera>
FingerModel<> known_finger(const Recording& recording, MakeCamera make_camera, const FingerOptics& assumed = {}) {
  require_nanoseconds(recording);
  const std::int64_t start_ns = recording.frames.empty() ? 0 : recording.frames.front().stamp_ns;
  const UnloadedStretch rest = UnloadedStretch::of(recording.session, start_ns);
  FingerModel<> finger = finger_model(recording.session);
  finger.optics = assumed;
  auto first = make_camera();
  finger.optics.view = view_finger(first, recording.session, rest, recording.path);
  auto pictures = make_camera();
  GreenProfile readout = finger.optics.readout();
  std::vector<Profile> profiles = read_profiles(pictures, readout);
  take_out_flicker(finger.optics.view, profiles, rest);
  finger.optics.unloaded =
      unloaded_reference(profiles, rest, recording.path, finger.optics.view.repeats(finger.optics.bins));
  finger.joints = unloaded_joints(recording, joint_stretch(recording.session, rest, profiles, finger.optics.unloaded));
  require_common_time(recording);
  return finger;
}

/// Profile → unloaded reference → location. Pictures that cannot be read have no profile and no estimate. Nor have
/// those that are black, damaged (no number) or dark about one LED: their state is `invalid`, and `force.faults` says
/// why. Light that changes as a whole is reported in `force.faults` only. Throws InvalidArgument for profiles of other
/// bins.
template <class MakeLocalizer> std::vector<FrameEstimate> locate(
    const std::vector<Profile>& profiles, const FingerOptics& finger, MakeLocalizer make_localizer) {
  auto localizer = make_localizer(finger);
  FrameMonitor::Config watched;
  watched.position_m = finger.readout().positions_m();
  watched.unloaded = finger.unloaded.mean().cwiseMax(least_light_DN);
  FrameMonitor monitor(watched);
  std::vector<FrameEstimate> list;
  for (Profile p : profiles) {
    FrameEstimate e;
    e.stamp_ns = e.location.stamp_ns = p.stamp_ns;
    e.force.faults = monitor.check_light(p, 0.0, 0.0).faults;
    if (e.force.faults.has(Fault::frame_black) || e.force.faults.has(Fault::led_dead) || !p.value.allFinite()) {
      list.push_back(std::move(e));
      continue;
    }
    finger.unloaded.subtract(p);
    e.force.state = EstimatorState::vision_only;
    e.location = localizer.update(p);
    if (e.location.unknown) e.force.faults.add(Fault::response_unknown);
    list.push_back(std::move(e));
  }
  return list;
}

/// Picture → profile → unloaded reference → location → torque → force: the recording plays as it came, one step at
/// each frame. Throws InputError without joint samples, InvalidArgument for parts that do not fit.
template <class MakeCamera, ContactJacobian J, class MakeLocalizer = BayesLocalizer (*)(const FingerOptics&)>
std::vector<FrameEstimate> estimate(const Recording& recording, MakeCamera make_camera, const FingerModel<J>& finger,
    MakeLocalizer make_localizer = bayes_localizer) {
  const std::vector<JointSample> samples = on_frames_clock(recording);
  if (samples.size() < 2 || finger.joints.torque.empty())
    throw InputError("the log has no joint samples to estimate a force from");
  const StreamRates rates = stream_rates(recording.frames, samples);
  Replay camera(make_camera());
  Replay motors{RecordedActuator(samples)};
  auto localizer = make_localizer(finger.optics);
  using Estimator = ForceEstimator<decltype(camera), decltype(motors), decltype(localizer), GreenProfile, J>;
  Estimator estimator(camera, motors, {finger.optics.readout(), finger.optics.unloaded}, std::move(localizer),
      finger.jacobian, force_config(finger, rates));
  const ContactTorques torques(samples, finger.joints.torque, {}, finger.session.joint_delay_s);
  const std::int64_t delay_ns = std::llround(1e9 * finger.session.frame_delay_s);
  const StreamAssumptions& assumed = finger.assumptions;
  const double gap_s = std::max(assumed.joint_gap_s, assumed.joint_gap_periods * rates.joint_period_s);
  std::vector<FrameEstimate> list;
  for (const FrameRecord& frame : recording.frames) {
    camera.until(frame.stamp_ns);
    motors.until(frame.stamp_ns);
    FrameEstimate e;
    e.stamp_ns = frame.stamp_ns;
    const Stopwatch watch;
    e.force = estimator.step(frame.stamp_ns);
    e.seconds = watch.seconds();
    e.location = estimator.location();
    e.joints = torques.at(frame.stamp_ns - delay_ns, gap_s);
    list.push_back(std::move(e));
  }
  return list;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/calibration.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_CALIBRATION_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_CALIBRATION_HPP

namespace lumo::sense {

/// Half of a normal's 95 % interval, in standard deviations.
inline constexpr double sigmas_of_95_percent = 1.96;

/// Stiffness of one specimen against the nominal one, from a press curve.
struct StiffnessFit {
  Interval factor;          ///< of the nominal shear modulus (λ/μ kept), 95 %
  double onset_m = 0.0;     ///< of the marker, where the nominal curve begins
  double residual_N = 0.0;  ///< RMS
};

/// Fits force = factor · nominal(depth − onset). `nominal_N`: force of the nominal pad at a depth [m], 0 below 0,
/// increasing: with the ratio of moduli kept, force is proportional to the modulus at given depth. Samples of one press
/// are not independent (the silicone creeps, the servo swings), so that the interval counts `independent` of them (0:
/// all). Throws InvalidArgument for fewer than three samples in contact, or ones that do not determine both.
inline StiffnessFit fit_stiffness(std::span<const double> depth_m, std::span<const double> force_N,
    const std::function<double(double)>& nominal_N, int independent = 0) {
  if (depth_m.size() != force_N.size())
    throw InvalidArgument(
        message("press curve has ", depth_m.size(), " depths and ", force_N.size(), " forces, must have as many"));
  for (const double d : depth_m) require_finite("depth of a press curve", d, "m");
  for (const double f : force_N) require_finite("force of a press curve", f, "N");
  require_in_range("independent samples of a press curve", independent, 0, 1e9, "");
  const auto n = Eigen::Index(depth_m.size());
  StiffnessFit fit{{1.0, 1.0, 1.0}, 0.0, 0.0};
  constexpr int most_steps = 30;                        // of Gauss–Newton; some five are needed
  constexpr double step_m = 1e-6;                       // of the difference quotient
  constexpr double scale_m = 1e-4, tolerance = 1e-4;    // typical onset; singular values below do not count
  constexpr double least_factor = 0.01, most_m = 1e-3;  // a softer specimen, a longer step is no fit
  constexpr double converged_factor = 1e-9, converged_m = 1e-11;
  Eigen::MatrixXd a(n, 2);
  Eigen::VectorXd left(n);
  Identification last;
  for (int k = 0; k < most_steps; ++k) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double d = depth_m[std::size_t(i)] - fit.onset_m, f = nominal_N(d);
      a(i, 0) = f;
      a(i, 1) = -fit.factor.value * (nominal_N(d + step_m) - nominal_N(d - step_m)) / (2.0 * step_m);
      left[i] = force_N[std::size_t(i)] - fit.factor.value * f;
    }
    if ((a.col(0).array() > 0.0).count() < 3) throw InvalidArgument("press curve: fewer than three samples in contact");
    last = identify(a, left, Eigen::Vector2d(1.0, scale_m), 0.0, tolerance);
    if (!last.complete()) throw InvalidArgument("press curve does not separate stiffness and onset");
    fit.factor.value = std::max(least_factor, fit.factor.value + last.value[0]);
    fit.onset_m += std::clamp(last.value[1], -most_m, most_m);
    if (std::abs(last.value[0]) < converged_factor && std::abs(last.value[1]) < converged_m) break;
  }
  fit.residual_N = last.residual;
  const double alike = independent > 0 ? std::max(1.0, double(n) / independent) : 1.0,
               sigma = std::sqrt(alike * last.covariance(0, 0));
  fit.factor.low = fit.factor.value - sigmas_of_95_percent * sigma;
  fit.factor.high = fit.factor.value + sigmas_of_95_percent * sigma;
  return fit;
}

/// Photon transfer of a camera (EMVA 1288): temporal variance of pixels over their signal. Row offsets and common
/// changes of the lamps are taken out of each pair of frames, fixed patterns fall out of their difference.
class PhotonTransfer {
 public:
  struct Result {
    Interval gain_DN_per_electron;  ///< slope, 95 %
    double dark_sigma_DN = 0.0;     ///< at no signal: read-out and the steps of 8 bits
  };

  /// One frame; the next one makes a pair with it. Throws InvalidArgument for another size or format.
  void add(const ImageView& v) {
    if (v.empty()) throw InvalidArgument("photon transfer: a picture is empty");
    const auto n = std::size_t(v.width) * std::size_t(v.height);
    if (frames_ == 0) {
      sum_.assign(n, 0.0);
      squares_.assign(n, 0.0);
    }
    if (frames_ > 0 && (v.width != last_.width || v.height != last_.height))
      throw InvalidArgument("photon transfer: pictures must have one size");
    const Image before = last_;
    last_ = Image::black(v.width, v.height, PixelFormat::grey);
    std::vector<double> difference(std::size_t(v.width));
    for (int y = 0; y < v.height; ++y) {
      double mean = 0.0;
      for (int x = 0; x < v.width; ++x) {
        const std::uint8_t g = v.green(x, y);
        last_.row(y)[x] = g;
        sum_[std::size_t(y) * std::size_t(v.width) + std::size_t(x)] += g;
        if (frames_ > 0) {
          difference[std::size_t(x)] = double(g) - before.view().row(y)[x];
          mean += difference[std::size_t(x)] / v.width;
        }
      }
      if (frames_ > 0)
        for (int x = 0; x < v.width; ++x)
          squares_[std::size_t(y) * std::size_t(v.width) + std::size_t(x)] +=
              0.5 * std::pow(difference[std::size_t(x)] - mean, 2) * v.width / (v.width - 1.0);
    }
    ++frames_;
  }
  /// From pixels with a mean below `full_DN` (above, the top of the range cuts the noise). Linear cameras only. Throws
  /// InvalidArgument for fewer than 8 pairs or signals that are all alike.
  Result result(double black_DN = 0.0, double full_DN = 230.0) const {
    constexpr int least_pairs = 8, least_pixels = 100, rounds = 4;
    if (pairs() < least_pairs)
      throw InvalidArgument(
          message("photon transfer has ", pairs(), " pairs of pictures, must have at least ", least_pairs));
    std::vector<double> signal, variance;
    for (std::size_t i = 0; i < sum_.size(); ++i)
      if (const double mean = sum_[i] / frames_; mean < full_DN && mean > black_DN + 1.0) {
        signal.push_back(mean - black_DN);
        variance.push_back(squares_[i] / pairs());
      }
    const auto n = Eigen::Index(signal.size());
    const double low = signal.empty() ? 0.0 : quantile(signal, 0.02),
                 high = signal.empty() ? 0.0 : quantile(signal, 0.98);
    if (n < least_pixels || !(high > 1.5 * low + 5.0))
      throw InvalidArgument("photon transfer: signals are all alike, they give no slope");
    // Variance of a variance is 2 σ⁴/pairs: weights by the signal, from a first look.
    Eigen::Vector2d line(0.5, 0.02);
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
    for (int k = 0; k < rounds; ++k) {
      Eigen::MatrixXd a(n, 2);
      Eigen::VectorXd b(n);
      for (Eigen::Index i = 0; i < n; ++i) {
        const double weight = 1.0 / std::max(line[0] + line[1] * signal[std::size_t(i)], 0.05);
        a.row(i) << weight, weight * signal[std::size_t(i)];
        b[i] = weight * variance[std::size_t(i)];
      }
      // Normal equations: pixels are many, parameters two.
      const Eigen::Matrix2d normal = a.transpose() * a;
      const Eigen::Matrix2d inverse = normal.inverse();
      line = inverse * (a.transpose() * b);
      covariance = (a * line - b).squaredNorm() / double(n - 2) * inverse;
    }
    const double sigma = std::sqrt(covariance(1, 1));
    return {{line[1], line[1] - sigmas_of_95_percent * sigma, line[1] + sigmas_of_95_percent * sigma},
        std::sqrt(std::max(line[0], 0.0))};
  }
  int pairs() const { return std::max(0, frames_ - 1); }

 private:
  Image last_;
  int frames_ = 0;
  std::vector<double> sum_, squares_;  ///< of the values; of the differences
};

/// Light of the lamps alone, from pictures with and without them: mean difference over pixels that are lit at all [DN],
/// and what that is in electrons.
struct LampLevel {
  double level_DN = 0.0;
  Interval electrons;  ///< a pixel and exposure, 95 %; flux, lens and exposure in one: a picture does not separate them
};

/// `lit` and `dark` are mean pictures of one view. Throws InvalidArgument for sizes that differ, or no light.
inline LampLevel lamp_level(const ImageView& lit, const ImageView& dark, const Interval& gain_DN_per_electron) {
  if (lit.empty() || lit.width != dark.width || lit.height != dark.height)
    throw InvalidArgument("lamp level: the lit and the dark picture must have one size");
  std::vector<double> difference;
  for (int y = 0; y < lit.height; ++y)
    for (int x = 0; x < lit.width; ++x) difference.push_back(double(lit.green(x, y)) - dark.green(x, y));
  const double half = 0.5 * quantile(difference, 0.98);
  double sum = 0.0;
  int count = 0;
  for (const double d : difference)
    if (d > half) {
      sum += d;
      ++count;
    }
  if (!(half > 0.5) || count == 0)
    throw InvalidArgument("lamp level: the lit picture is no brighter than the dark one");
  const double level = sum / count;
  return {
      level, {level / gain_DN_per_electron.value, level / gain_DN_per_electron.high, level / gain_DN_per_electron.low}};
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/latency.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_LATENCY_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_LATENCY_HPP

namespace lumo::sense {

/// Limits of the estimate of latency; chosen on the virtual lab, whose streams are stamped alike.
struct LatencyLimits {
  double most_s = 0.2, step_s = 4e-3;  ///< latencies that are tried
  double gap_s = 0.05;                 ///< over which joints are interpolated
  double noises = 4.0;                 ///< by which light must change from the picture before to the one after
  double apart_s = 1.0;                ///< from one event to the next
  int least_frames = 3, least_events = 3;
  double least_correlation = 0.8;  ///< of light's and torque's change in an event that counts
  double event_sigma_s = 0.02;     ///< standard deviation that one event has at least
  /// What all events of a log may have in common: light and torque do not rise by one law (silicone creeps, small loads
  /// take light and greater ones give it). Logs of the lab without any latency have a mean of −52 to 19 ms.
  double law_sigma_s = 0.03;
  double significant_sigmas = 4.0;  ///< from 0, beyond which a latency is none of chance
};

/// By how much joint samples are stamped later than pictures of the same moment, as contacts show that begin, grow and
/// end.
struct Latency {
  double seconds = 0.0, sigma_s = 0.0;
  int events = 0;               ///< contacts' changes that it is the mean of
  bool is_significant = false;  ///< it is none of chance
};

namespace detail {

/// Changes of light, and where they are great.
struct LightChanges {
  std::vector<std::int64_t> before_ns, after_ns;
  std::vector<double> change_DN;
  std::vector<std::vector<std::size_t>> events;
};

inline LightChanges light_changes(const std::vector<Profile>& profiles, const UnloadedReference& unloaded,
    double delay_s, const LatencyLimits& limits) {
  LightChanges c;
  const auto delay_ns = std::llround(1e9 * delay_s);
  std::vector<double> size;
  for (std::size_t k = 1; k + 1 < profiles.size(); ++k) {
    const Profile &a = profiles[k - 1], &b = profiles[k + 1];
    const bool usable = a.value.size() == unloaded.mean().size() && b.value.size() == a.value.size() &&
                        a.value.allFinite() && b.value.allFinite();
    c.before_ns.push_back(a.stamp_ns - delay_ns);
    c.after_ns.push_back(b.stamp_ns - delay_ns);
    c.change_DN.push_back(usable ? b.value.mean() - a.value.mean() : 0.0);
    size.push_back(std::abs(c.change_DN.back()));
  }
  if (size.empty()) return c;
  const double least = limits.noises * median(size) / half_of_normal;
  for (std::size_t k = 0; k < size.size(); ++k) {
    if (!(size[k] > least)) continue;
    if (c.events.empty() || 1e-9 * double(c.after_ns[k] - c.after_ns[c.events.back().back()]) > limits.apart_s)
      c.events.emplace_back();
    c.events.back().push_back(k);
  }
  return c;
}

/// Latency of the best match of an event, and its correlation; nullopt for the ends of what was tried, or for joints
/// that are not known throughout.
inline std::optional<std::pair<double, double>> event_latency(const LightChanges& c,
    const std::vector<std::size_t>& event, const ContactTorques& torques, const LatencyLimits& limits) {
  constexpr int parts = 8;  // of a picture's time, over which torques are averaged
  const Eigen::Index torque = 2 * torques.joints() - 1;
  const auto steps = int(std::lround(limits.most_s / limits.step_s));
  std::vector<double> match;
  for (int i = -steps; i <= steps; ++i) {
    double products = 0.0, light = 0.0, squares = 0.0;
    for (const std::size_t k : event) {
      double change = 0.0;
      const std::int64_t span = c.after_ns[k] - c.before_ns[k];
      for (int p = 0; p < parts; ++p) {
        const std::int64_t shift = std::llround(1e9 * limits.step_s * i) + span * (2 * p - parts + 1) / (4 * parts);
        const auto a = torques.at(c.before_ns[k] + shift, limits.gap_s),
                   b = torques.at(c.after_ns[k] + shift, limits.gap_s);
        if (!a || !b) return std::nullopt;
        change += ((*b)[torque] - (*a)[torque]) / parts;
      }
      products += change * c.change_DN[k];
      light += c.change_DN[k] * c.change_DN[k];
      squares += change * change;
    }
    match.push_back(std::abs(products) / std::sqrt(std::max(light * squares, 1e-300)));
  }
  const auto best = std::max_element(match.begin(), match.end());
  if (best == match.begin() || best + 1 == match.end()) return std::nullopt;
  const double before = *(best - 1), after = *(best + 1), bend = before - 2.0 * *best + after;
  const double part = bend < 0.0 ? 0.5 * (before - after) / bend : 0.0;
  return std::pair(limits.step_s * (double(best - match.begin() - steps) + part), *best);
}

}  // namespace detail

/// Light and torque rise and fall together: what shift in time makes their changes most alike, contact by contact.
/// `profiles`: before the reference is subtracted; `frame_delay_s`: of their stamps, as the session states it.
/// `torques`: on the same clock, less the joints' delay. nullopt: too few contacts show it.
inline std::optional<Latency> joint_latency(const std::vector<Profile>& profiles, const UnloadedReference& unloaded,
    const ContactTorques& torques, double frame_delay_s = 0.0, const LatencyLimits& limits = {}) {
  const detail::LightChanges changes = detail::light_changes(profiles, unloaded, frame_delay_s, limits);
  std::vector<double> found;
  for (const auto& event : changes.events) {
    if (int(event.size()) < limits.least_frames) continue;
    const auto at = detail::event_latency(changes, event, torques, limits);
    if (at && at->second >= limits.least_correlation) found.push_back(at->first);
  }
  if (int(found.size()) < limits.least_events) return std::nullopt;
  Latency l;
  l.events = int(found.size());
  for (const double f : found) l.seconds += f / double(found.size());
  double squares = 0.0;
  for (const double f : found) squares += std::pow(f - l.seconds, 2);
  const double scatter = std::max(std::sqrt(squares / double(found.size() - 1)), limits.event_sigma_s);
  l.sigma_s = std::hypot(scatter / std::sqrt(double(found.size())), limits.law_sigma_s);
  l.is_significant = std::abs(l.seconds) > limits.significant_sigmas * l.sigma_s;
  return l;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/force/stream_checks.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_FORCE_STREAM_CHECKS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_FORCE_STREAM_CHECKS_HPP

namespace lumo::sense {

// Streams of one log are checked against each other: what no finger does is a wrong sign, order, unit or reference.

/// Limits of these checks; chosen on clean logs of the virtual lab, where none of them is met.
struct StreamCheckLimits {
  // Reference
  int smoothing = 5;            ///< values of a profile that are averaged first
  double darker_noises = 8.0;   ///< by which a place must be darker than the reference …
  double darker_share = 0.1;    ///< … and this share of its light
  double darker_frames = 0.03;  ///< share of all frames for which that holds at about one place
  double one_place_m = 6.0_mm;  ///< half width of "about one place"
  int least_darker = 10;        ///< frames
  // Torques
  double sure = 0.9;               ///< probability of a contact that the pictures see
  int least_contacts = 20;         ///< frames with one
  double torque_noises = 5.0;      ///< by which torques must be on the wrong side (median over contacts) …
  double least_torque_Nm = 0.02;   ///< … and this much
  double one_sign = 0.8;           ///< share of the contacts for which they are
  double better_order = 0.5;       ///< of the misfit, to which another order of the joints must bring it
  double mirrored = -0.5;          ///< correlation of places by torque and by light, below which one is mirrored
  double least_spread_m = 5.0_mm;  ///< of the places touched, that shows a mirrored one
  // Joints
  int least_free = 30;              ///< frames that the pictures see free
  double free_torque_noises = 8.0;  ///< of their median, by which torques must be off 0 there …
  double free_torque_Nm = 0.2;      ///< … and this much: beyond what sticks in a joint
  // Force sensor
  double least_force_N = 2.0;  ///< from which torque over force is a place
  double wrong_force_N = 0.5;  ///< on the wrong side, in holds (median)
  double wrong_scale = 2.0;    ///< of torques over force and place, or its inverse: no friction makes as much
};

/// Frames in which the finger is darker at one place than in its reference, while no other place is brighter by as
/// much: the reference was touched there.
struct TouchedReference {
  double y_m = 0.0;
  double darker_DN = 0.0;  ///< median over those frames
  int frames = 0, of = 0;
};

/// nullopt: nothing speaks against the reference. `profiles`: of the whole log, before the reference is subtracted.
/// Lamps that dim as a whole do not count.
inline std::optional<TouchedReference> touched_reference(const std::vector<Profile>& profiles,
    const Eigen::VectorXd& position_m, const UnloadedReference& unloaded, const StreamCheckLimits& limits = {}) {
  const Eigen::VectorXd& mean = unloaded.mean();
  const Eigen::VectorXd noise = unloaded.noise();
  const Eigen::Index n = mean.size(), half = limits.smoothing / 2;
  if (n <= 2 * half || position_m.size() != n) return std::nullopt;
  const auto smooth = [&](const Eigen::VectorXd& v, Eigen::Index i) {
    return v.segment(i - half, 2 * half + 1).mean();
  };
  std::vector<std::pair<double, double>> darker;  // place, by how much
  for (const Profile& p : profiles) {
    if (p.value.size() != n || !p.value.allFinite()) continue;
    const Eigen::VectorXd ratio = p.value.cwiseQuotient(mean.cwiseMax(1e-9));
    const double lamps = std::min(1.0, quantile({ratio.data(), ratio.data() + n}, 0.9));
    const Eigen::VectorXd change = p.value - lamps * mean;
    double least = 0.0, most = 0.0;
    Eigen::Index at = half;
    for (Eigen::Index i = half; i < n - half; ++i) {
      const double c = smooth(change, i);
      if (c < least) {
        least = c;
        at = i;
      }
      most = std::max(most, c);
    }
    const double enough = std::max(limits.darker_noises * smooth(noise, at), limits.darker_share * smooth(mean, at));
    if (-least > enough + most) darker.emplace_back(position_m[at], -least);
  }
  if (darker.empty()) return std::nullopt;
  std::vector<double> place, by;
  for (const auto& d : darker) place.push_back(d.first);
  const double middle = median(place);
  for (const auto& d : darker)
    if (std::abs(d.first - middle) <= limits.one_place_m) by.push_back(d.second);
  if (int(by.size()) < limits.least_darker || double(by.size()) < limits.darker_frames * double(profiles.size()) ||
      2 * by.size() < darker.size())
    return std::nullopt;
  return TouchedReference{middle, median(by), int(by.size()), int(profiles.size())};
}

/// What torques say of the contacts that the pictures see.
struct TorqueAgreement {
  int contacts = 0;               ///< frames with one
  std::vector<int> reversed;      ///< joints whose torque falls in contacts, which no push makes
  std::vector<int> better_order;  ///< of the joints, to which the torques fit better than to the one given; empty: none
  bool mirrored = false;          ///< places by torque run against places by light
};

namespace detail {

/// A frame with one sure contact: angles, contact torques, place.
struct SeenContact {
  JointVector position_rad, torque_Nm;
  double y_m;
};

inline std::vector<SeenContact> seen_contacts(
    std::span<const FrameEstimate> estimates, const StreamCheckLimits& limits) {
  std::vector<SeenContact> list;
  for (const FrameEstimate& e : estimates)
    if (const auto at = e.contact(); at && e.joints && e.location.probability > limits.sure) {
      const Eigen::Index n = e.joints->size() / 2;
      list.push_back({e.joints->head(n), e.joints->tail(n), at->y_m});
    }
  return list;
}

/// Sum of squares that one push at the place seen leaves of the torques, with the joints in an order.
template <ContactJacobian J>
double misfit(const J& jacobian, int link, const std::vector<SeenContact>& contacts, const std::vector<int>& order) {
  double sum = 0.0;
  for (const SeenContact& c : contacts) {
    JointVector q = c.position_rad, t = c.torque_Nm;
    for (std::size_t j = 0; j < order.size(); ++j) {
      q[Eigen::Index(j)] = c.position_rad[order[j]];
      t[Eigen::Index(j)] = c.torque_Nm[order[j]];
    }
    const JointVector a = jacobian.column(q, {link, c.y_m});
    const double force = std::max(0.0, a.dot(t) / std::max(a.squaredNorm(), 1e-12));
    sum += (t - force * a).squaredNorm();
  }
  return sum;
}

inline double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto n = Eigen::Index(a.size());
  const Eigen::VectorXd x = Eigen::Map<const Eigen::VectorXd>(a.data(), n).array() -
                            std::accumulate(a.begin(), a.end(), 0.0) / double(n),
                        y = Eigen::Map<const Eigen::VectorXd>(b.data(), n).array() -
                            std::accumulate(b.begin(), b.end(), 0.0) / double(n);
  return x.dot(y) / std::max(x.norm() * y.norm(), 1e-300);
}

}  // namespace detail

/// Compares torques with the contacts that the pictures see. `noise_Nm`: of one torque. Two joints or more tell order
/// and direction, too.
template <ContactJacobian J> TorqueAgreement torque_agreement(std::span<const FrameEstimate> estimates,
    const J& jacobian, const PadRange& range, double noise_Nm, const StreamCheckLimits& limits = {}) {
  const std::vector<detail::SeenContact> contacts = detail::seen_contacts(estimates, limits);
  TorqueAgreement r;
  r.contacts = int(contacts.size());
  if (r.contacts < limits.least_contacts) return r;
  const int joints = jacobian.joints();
  for (int j = 0; j < joints; ++j) {
    std::vector<double> torque;
    int wrong = 0;
    for (const detail::SeenContact& c : contacts) {
      const double arm = jacobian.column(c.position_rad, {range.link, c.y_m})[j];
      torque.push_back(arm < 0.0 ? -c.torque_Nm[j] : c.torque_Nm[j]);
      wrong += torque.back() < 0.0;
    }
    if (median(torque) < -std::max(limits.torque_noises * noise_Nm, limits.least_torque_Nm) &&
        wrong >= limits.one_sign * r.contacts)
      r.reversed.push_back(j);
  }
  if (joints < 2 || !r.reversed.empty()) return r;
  std::vector<int> order(std::size_t(joints), 0);
  std::iota(order.begin(), order.end(), 0);
  const double given = detail::misfit(jacobian, range.link, contacts, order);
  double least = std::max(limits.better_order * given, noise_Nm * noise_Nm * double(joints * r.contacts));
  constexpr int most_joints = 4;  // 24 orders
  while (joints <= most_joints && std::next_permutation(order.begin(), order.end()))
    if (const double m = detail::misfit(jacobian, range.link, contacts, order); m < least && m < given) {
      least = m;
      r.better_order = order;
    }
  if (!r.better_order.empty()) return r;
  std::vector<double> light, torque;
  for (const detail::SeenContact& c : contacts)
    if (const TorqueOnlySolution s =
            solve_torque_only(jacobian, c.position_rad, c.torque_Nm, range, std::max(noise_Nm, 1e-6));
        s.rank == 2) {
      light.push_back(c.y_m);
      torque.push_back(s.y_m);
    }
  if (int(light.size()) >= limits.least_contacts && quantile(light, 0.9) - quantile(light, 0.1) > limits.least_spread_m)
    r.mirrored = detail::correlation(light, torque) < limits.mirrored;
  return r;
}

/// Torque of the pad's joint in frames after `after_ns` that the pictures see free [N·m, median], where it is no noise:
/// then its friction, weight and offset were learnt in a contact, or something touches what the pictures do not see.
/// nullopt: it is noise, or there are too few such frames.
template <ContactJacobian J> std::optional<double> torque_without_contact(std::span<const FrameEstimate> estimates,
    const J& jacobian, double noise_Nm, std::int64_t after_ns, const StreamCheckLimits& limits = {}) {
  std::vector<double> torque;
  int positive = 0;
  for (const FrameEstimate& e : estimates)
    if (e.stamp_ns > after_ns && e.joints && e.location.contacts == 0 && !e.location.unknown &&
        e.location.probability > limits.sure) {
      torque.push_back((*e.joints)[2 * jacobian.joints() - 1]);
      positive += torque.back() > 0.0;
    }
  if (int(torque.size()) < limits.least_free) return std::nullopt;
  const double middle = median(torque), share = double(positive) / double(torque.size());
  const double noise = noise_Nm / std::sqrt(double(torque.size()));
  const bool far = std::abs(middle) > std::max(limits.free_torque_noises * noise, limits.free_torque_Nm);
  return far && std::max(share, 1.0 - share) > limits.one_sign ? std::optional(middle) : std::nullopt;
}

/// What a force sensor makes of one joint's torque: torque over force is the contact's distance from the joint.
struct SensorAgreement {
  bool mirrored = false;  ///< places by torque run against places by light, as where the view is mirrored
  double scale = 1.0;     ///< of the torques, where they are out of all proportion to force and place (median); 1: not
};

/// `joint`: where the finger is. For the sensor's sign see force_falls_in_contacts.
inline SensorAgreement sensor_agreement(std::span<const FrameEstimate> estimates, const MomentArm& joint,
    const Session& session, const std::vector<WrenchSample>& wrenches, const StreamCheckLimits& limits = {}) {
  SensorAgreement r;
  if (wrenches.empty()) return r;
  const TimeSeries force = normal_force(wrenches, session.wrench_clock, force_tare_N(session, wrenches));
  std::vector<double> light, arm_m, scale;
  for (const FrameEstimate& e : estimates)
    if (const auto at = e.contact(); at && e.joints && e.joints->size() == 2 && e.location.probability > limits.sure)
      if (const auto f = force.at(e.stamp_ns, LogTruth::max_gap_s); f && (*f)[0] > limits.least_force_N) {
        light.push_back(at->y_m);
        arm_m.push_back((*e.joints)[1] / (*f)[0]);
        scale.push_back(arm_m.back() / (joint.joint_to_origin_m + at->y_m));
      }
  if (int(light.size()) < limits.least_contacts) return r;
  r.mirrored = quantile(light, 0.9) - quantile(light, 0.1) > limits.least_spread_m &&
               detail::correlation(light, arm_m) < limits.mirrored;
  const double middle = median(scale);
  if (std::isfinite(middle) && (middle > limits.wrong_scale || (middle > 0.0 && middle < 1.0 / limits.wrong_scale)))
    r.scale = middle;
  return r;
}

/// The force sensor against contacts that the pictures see: the force falls where they begin. For logs without holds.
inline bool force_falls_in_contacts(std::span<const FrameEstimate> estimates, const Session& session,
    const std::vector<WrenchSample>& wrenches, const StreamCheckLimits& limits = {}) {
  if (wrenches.empty()) return false;
  const TimeSeries force = normal_force(wrenches, session.wrench_clock);
  std::vector<double> touched, free;
  for (const FrameEstimate& e : estimates)
    if (const auto f = force.at(e.stamp_ns, LogTruth::max_gap_s); f && e.location.probability > limits.sure)
      (e.location.contacts > 0 ? touched : free).push_back((*f)[0]);
  return int(touched.size()) >= limits.least_contacts && int(free.size()) >= limits.least_contacts &&
         median(touched) - median(free) < -limits.wrong_force_N;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/decoder.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_DECODER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_DECODER_HPP

namespace lumo::sense {

/// Responses with the place that each belongs to. Places are numbered from 0 along the finger.
struct LabelledResponses {
  Eigen::MatrixXd response;  ///< features × observations
  std::vector<int> place;    ///< of each observation
  Eigen::VectorXd place_m;   ///< where the places are, ascending
  int places() const { return int(place_m.size()); }
};

/// Throws InvalidArgument unless shapes fit, numbers are finite, places ascend and every place has an observation.
inline void validate(const LabelledResponses& d) {
  if (d.places() < 2 || d.response.rows() < 1 || d.response.cols() != Eigen::Index(d.place.size()))
    throw InvalidArgument(message("labelled responses: ", d.response.rows(), " features × ", d.response.cols(),
        " observations, ", d.place.size(), " labels, ", d.places(), " places"));
  if (!d.response.allFinite() || !d.place_m.allFinite())
    throw InvalidArgument("labelled responses: numbers must be finite");
  for (Eigen::Index i = 1; i < d.place_m.size(); ++i)
    if (!(d.place_m[i] > d.place_m[i - 1]))
      throw InvalidArgument(message("labelled responses: place ", i, " lies at ", d.place_m[i],
          " m, must exceed its predecessor, ", d.place_m[i - 1], " m"));
  std::vector<bool> seen(std::size_t(d.places()), false);
  for (const int p : d.place) {
    if (p < 0 || p >= d.places())
      throw InvalidArgument(message("labelled responses: place ", p, ", must lie in [0, ", d.places() - 1, "]"));
    seen[std::size_t(p)] = true;
  }
  for (std::size_t p = 0; p < seen.size(); ++p)
    if (!seen[p]) throw InvalidArgument(message("labelled responses: no observation of place ", p));
}

/// What a decoder makes of one response.
struct Decoding {
  int place = 0;
  Eigen::VectorXd probability;  ///< of each place; sums to 1
};

/// Learns places from labelled responses; the model it gives decodes new ones.
/// Laws: `fit` is a pure function of its data; the place decoded is (one of) the most probable; the answer does not
/// depend on the order of observations (up to rounding).
template <class D>
concept Decoder = requires(const D& decoder, const LabelledResponses& training, const Eigen::VectorXd& response) {
  { decoder.fit(training).decode(response) } -> std::same_as<Decoding>;
};

/// Softmax of log weights, and its mode; −∞ is a weight of 0. Throws InvalidArgument unless the largest is finite, as
/// it is not for a response that is not.
inline Decoding decoding_of(const Eigen::VectorXd& log_weight) {
  constexpr double infinite = std::numeric_limits<double>::infinity();
  if (!(log_weight.array() < infinite).all() || !(log_weight.array() > -infinite).any())
    throw InvalidArgument(
        message("decoder: of ", log_weight.size(), " log weights one must be finite, none NaN or +inf"));
  Decoding d;
  Eigen::Index top = 0;
  const double most = log_weight.maxCoeff(&top);
  d.place = int(top);
  d.probability = (log_weight.array() - most).exp();
  d.probability /= d.probability.sum();
  return d;
}

/// Mean response of each place, features × places.
inline Eigen::MatrixXd place_means(const LabelledResponses& t) {
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(t.response.rows(), t.places());
  Eigen::VectorXd count = Eigen::VectorXd::Zero(t.places());
  for (std::size_t i = 0; i < t.place.size(); ++i) {
    mean.col(t.place[i]) += t.response.col(Eigen::Index(i));
    count[t.place[i]] += 1.0;
  }
  return mean * count.cwiseInverse().asDiagonal();
}

/// What a decoder made of observations that it had not seen.
struct DecodingReport {
  struct Prediction {
    int observation = 0, fold = 0, place = 0, decoded = 0;
    double probability = 0.0;  ///< that the decoder gave to the place decoded
  };
  std::vector<Prediction> predictions;  ///< by observation
  Eigen::MatrixXi confusion;            ///< true place × decoded place
  Interval accuracy;                    ///< share of right ones, with Wilson's 95 % interval
  double mean_error_m = 0.0;            ///< mean distance between the places
  double log_score = 0.0;               ///< mean logarithm of the probability given to the true place, at least −700
};

/// Leaves out one fold after the other (the paper: one repetition of all places), fits on the others and decodes it.
/// `fold[i]` of observation i. Throws InvalidArgument for fewer than two folds, or when a place is only in one fold.
template <Decoder D>
DecodingReport cross_validate(const D& decoder, const LabelledResponses& data, const std::vector<int>& fold) {
  validate(data);
  if (fold.size() != data.place.size())
    throw InvalidArgument(
        message("cross-validation: ", data.place.size(), " observations and ", fold.size(), " folds"));
  const std::set<int> folds(fold.begin(), fold.end());
  if (folds.size() < 2) throw InvalidArgument("cross-validation needs at least 2 folds");
  DecodingReport report;
  report.confusion = Eigen::MatrixXi::Zero(data.places(), data.places());
  report.predictions.resize(data.place.size());
  int right = 0;
  for (const int out : folds) {
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < fold.size(); ++i)
      if (fold[i] != out) kept.push_back(Eigen::Index(i));
    LabelledResponses training{data.response(Eigen::all, kept), {}, data.place_m};
    for (const Eigen::Index i : kept) training.place.push_back(data.place[std::size_t(i)]);
    const auto model = decoder.fit(training);
    for (std::size_t i = 0; i < fold.size(); ++i) {
      if (fold[i] != out) continue;
      const Decoding d = model.decode(data.response.col(Eigen::Index(i)));
      const int place = data.place[i];
      report.predictions[i] = {int(i), out, place, d.place, d.probability[d.place]};
      ++report.confusion(place, d.place);
      right += d.place == place;
      report.mean_error_m += std::abs(data.place_m[d.place] - data.place_m[place]) / double(fold.size());
      report.log_score += std::max(std::log(std::max(d.probability[place], 1e-305)), -700.0) / double(fold.size());
    }
  }
  report.accuracy = wilson_interval(right, int(fold.size()));
  return report;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/linear_decoder.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_LINEAR_DECODER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_LINEAR_DECODER_HPP

namespace lumo::sense {

/// Covariance of residuals (features × observations) about means that took `parameters` degrees of freedom, shrunk
/// towards a multiple of the identity; a negative shrinkage asks for Ledoit and Wolf's and is replaced by it. `floor`:
/// the least mean variance that is believed.
inline Eigen::MatrixXd shrunk_covariance(
    const Eigen::MatrixXd& residual, Eigen::Index parameters, double& shrinkage, double floor = 1e-300) {
  const Eigen::Index d = residual.rows(), n = residual.cols();
  const Eigen::MatrixXd s = residual * residual.transpose() / double(n);
  const double level = std::max(s.trace() / double(d), floor);
  const Eigen::MatrixXd target = level * Eigen::MatrixXd::Identity(d, d);
  if (shrinkage < 0.0) {
    double scatter = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) scatter += (residual.col(i) * residual.col(i).transpose() - s).squaredNorm();
    const double far = (s - target).squaredNorm();
    shrinkage = far > 0.0 ? std::clamp(scatter / (double(n) * double(n)) / far, 0.0, 1.0) : 1.0;
  }
  const double left = double(std::max<Eigen::Index>(1, n - parameters)) / double(n);
  return ((1.0 - shrinkage) * s + (shrinkage + 1e-9) * target) / left;
}

/// Regularised linear discriminant: Gaussians about the places' means with one covariance, shrunk towards a multiple of
/// the identity because a finger gives few re-contacts for many regions. Source: Friedman 1989; the shrinkage is Ledoit
/// & Wolf's (2004) from the data, or given.
struct LinearDecoder {
  double shrinkage = -1.0;  ///< 0 … 1; negative: Ledoit and Wolf's

  class Model {
   public:
    Model(const LabelledResponses& t, double shrinkage) : mean_(place_means(t)) {
      const Eigen::MatrixXd& mean = mean_;
      Eigen::MatrixXd residual = t.response;
      for (Eigen::Index i = 0; i < residual.cols(); ++i) residual.col(i) -= mean.col(t.place[std::size_t(i)]);
      const Eigen::MatrixXd covariance =
          shrunk_covariance(residual, t.places(), shrinkage, 1e-12 * mean.cwiseAbs2().maxCoeff() + 1e-300);
      shrinkage_ = shrinkage;
      factor_.compute(covariance);
      weight_ = factor_.solve(mean);
      offset_ = -0.5 * mean.cwiseProduct(weight_).colwise().sum().transpose();
    }
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const { return decoding_of(log_likelihood(response)); }
    /// Of each place, up to one common constant.
    Eigen::VectorXd log_likelihood(const Eigen::VectorXd& response) const {
      if (response.size() != mean_.rows())
        throw InvalidArgument(message("response has ", response.size(), " features, the decoder ", mean_.rows()));
      const Eigen::MatrixXd& weight = weight_;
      return weight.transpose() * response + offset_;
    }
    double shrinkage() const { return shrinkage_; }

   private:
    Eigen::MatrixXd mean_, weight_;
    Eigen::VectorXd offset_;
    Eigen::LLT<Eigen::MatrixXd> factor_;
    double shrinkage_ = 0.0;
  };

  /// Throws InvalidArgument for data that do not fit together.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("shrinkage", shrinkage, std::numeric_limits<double>::lowest(), 1.0, "");
    return Model(training, shrinkage);
  }
};

static_assert(Decoder<LinearDecoder>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/bayes_decoder.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_BAYES_DECODER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_BAYES_DECODER_HPP

namespace lumo::sense {

/// Bayes filter over the places: takes one response after the other and keeps the probability of each. The contact
/// stays where it is but for a `change` per step.
class PlaceFilter {
 public:
  /// Throws InvalidArgument for fewer than two places or a change that is no probability.
  explicit PlaceFilter(int places, double change = 0.0)
      : change_(change), probability_(Eigen::VectorXd::Constant(std::max(places, 1), 1.0 / std::max(places, 1))) {
    require_in_range("number of places", places, 2, 1e6, "");
    require_in_range("change of place per step", change, 0.0, 1.0, "");
  }
  /// Takes the log likelihoods of the places (up to a constant) under the next response. Throws InvalidArgument, and
  /// stays as it was, for another number of places and as decoding_of() does.
  const Eigen::VectorXd& update(const Eigen::VectorXd& log_likelihood) {
    Eigen::VectorXd& p = probability_;
    const double n = double(p.size());
    if (log_likelihood.size() != p.size())
      throw InvalidArgument(message("place filter has ", p.size(), " places, got ", log_likelihood.size()));
    const Eigen::VectorXd prior = ((1.0 - change_) * p.array() + change_ / n).max(1e-300);
    p = decoding_of((prior.array().log() + log_likelihood.array()).matrix()).probability;
    return probability_;
  }
  const Eigen::VectorXd& probability() const { return probability_; }

 private:
  double change_;
  Eigen::VectorXd probability_;
};

/// Decodes a contact from several steps of its loading: a response is `steps` blocks of features, one below the other,
/// each with a linear discriminant of its own, and the places' probabilities pass from step to step. With one step it
/// is the linear decoder.
struct BayesDecoder {
  int steps = 1;
  double change = 0.0;  ///< of place from step to step
  LinearDecoder step = {};

  class Model {
   public:
    Model(std::vector<LinearDecoder::Model> steps, int places, double change)
        : steps_(std::move(steps)), places_(places), change_(change) {}
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const {
      const auto n = Eigen::Index(steps_.size());
      if (response.size() % n != 0)
        throw InvalidArgument(message("response has ", response.size(), " features, must be ", n, " steps of as many"));
      PlaceFilter filter(places_, change_);
      for (Eigen::Index k = 0; k < n; ++k)
        filter.update(
            steps_[std::size_t(k)].log_likelihood(response.segment(k * (response.size() / n), response.size() / n)));
      const Eigen::VectorXd& p = filter.probability();
      return decoding_of(p.array().max(1e-300).log().matrix());
    }

   private:
    std::vector<LinearDecoder::Model> steps_;
    int places_;
    double change_;
  };

  /// Throws InvalidArgument for data that do not fit together, or features that are not `steps` blocks.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("steps of the decoder", steps, 1, 1e6, "");
    if (training.response.rows() % steps != 0)
      throw InvalidArgument(
          message("responses have ", training.response.rows(), " features, must be ", steps, " steps of as many"));
    std::vector<LinearDecoder::Model> models;
    const Eigen::Index rows = training.response.rows() / steps;
    for (int k = 0; k < steps; ++k)
      models.push_back(step.fit({training.response.middleRows(k * rows, rows), training.place, training.place_m}));
    return Model(std::move(models), training.places(), change);
  }
};

static_assert(Decoder<BayesDecoder>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/constraint_gain.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_CONSTRAINT_GAIN_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_CONSTRAINT_GAIN_HPP

namespace lumo::sense {

/// Finds when a force sensor first feels the contact.
struct OnsetDetector {
  int baseline = 20;          ///< samples at the start that are without contact
  double threshold = 5.0;     ///< standard deviations of the baseline
  double min_force_N = 0.05;  ///< above the baseline's mean, however quiet it was
  int hold = 3;               ///< samples in a row that must lie above
  /// Samples from the crossing on, through which a line goes back to the baseline; 0: take the crossing itself
  int fit = 5;

  /// Place of the onset in samples (fractional), and the force's baseline there.
  struct Onset {
    double sample = 0.0;
    double baseline_N = 0.0;
  };
  /// nullopt if the force stays below the threshold. Throws InvalidArgument for too few samples or forces that are
  /// not finite.
  std::optional<Onset> find(std::span<const double> force_N) const {
    require_in_range("samples without contact", baseline, 2, 1e9, "");
    require_in_range("samples above the threshold", hold, 1, 1e6, "");
    require_in_range("threshold of the onset", threshold, 0.0, 1e6, "standard deviations");
    require_in_range("least force of the onset", min_force_N, 0.0, 1e6, "N");
    require_in_range("samples of the onset's line", fit, 0, 1e6, "");
    const auto n = std::ptrdiff_t(force_N.size());
    if (n <= baseline)
      throw InvalidArgument(message("onset: ", n, " forces, must have more than the ", baseline, " without contact"));
    for (const double f : force_N)
      if (!std::isfinite(f)) throw InvalidArgument("onset: forces must be finite");
    double mean = 0.0, squares = 0.0;
    for (int i = 0; i < baseline; ++i) mean += force_N[std::size_t(i)] / baseline;
    for (int i = 0; i < baseline; ++i) squares += std::pow(force_N[std::size_t(i)] - mean, 2);
    const double limit = mean + std::max(threshold * std::sqrt(squares / (baseline - 1)), min_force_N);
    int above = 0;
    for (std::ptrdiff_t i = baseline; i < n; ++i) {
      above = force_N[std::size_t(i)] > limit ? above + 1 : 0;
      if (above < hold) continue;
      const double first = double(i - hold + 1);
      // The force has risen before it crosses: a line through the next samples goes back to where it left the baseline.
      double si = 0.0, sf = 0.0, sii = 0.0, sif = 0.0;
      int count = 0;
      for (auto k = std::ptrdiff_t(first); k < n && count < fit; ++k, ++count) {
        const double t = double(k) - first, f = force_N[std::size_t(k)] - mean;
        si += t;
        sf += f;
        sii += t * t;
        sif += t * f;
      }
      const double det = count * sii - si * si, slope = det > 0.0 ? (count * sif - si * sf) / det : 0.0;
      if (!(slope > 0.0)) return Onset{first, mean};
      const double at = (sf - slope * si) / count;  // of the line, at the crossing
      return Onset{std::clamp(first - at / slope, double(baseline - 1), first), mean};
    }
    return std::nullopt;
  }
};

/// How far the marker on the indenter goes from contact onset until the force (above its baseline) first reaches
/// `force_N`, interpolated linearly [m]. nullopt if there is no onset or the force is not reached. Both series at the
/// same times.
inline std::optional<double> displacement_from_onset(std::span<const double> force, std::span<const double> marker_m,
    double force_N, const OnsetDetector& detector = {}) {
  if (force.size() != marker_m.size())
    throw InvalidArgument(
        message("displacement: ", force.size(), " forces and ", marker_m.size(), " marker places, must be as many"));
  require_positive("force to reach", force_N, "N");
  for (const double x : marker_m)
    if (!std::isfinite(x)) throw InvalidArgument("displacement: marker places must be finite");
  const auto onset = detector.find(force);
  if (!onset) return std::nullopt;
  const auto marker_at = [&](double sample) {
    const auto i = std::min(std::size_t(sample), marker_m.size() - 1), j = std::min(i + 1, marker_m.size() - 1);
    return marker_m[i] + (sample - double(i)) * (marker_m[j] - marker_m[i]);
  };
  const double target = onset->baseline_N + force_N;
  for (auto i = std::size_t(std::floor(onset->sample)) + 1; i < force.size(); ++i)
    if (force[i] >= target) {
      const double before = force[i - 1], step = force[i] - before;
      const double reached =
          before >= target || !(step > 0.0) ? double(i - 1) : double(i - 1) + (target - before) / step;
      return std::abs(marker_at(reached) - marker_at(onset->sample));
    }
  return std::nullopt;
}

/// Progressive-Constraint Gain [%]: by how much less the indenter sinks in from onset to the load than into the
/// baseline (paper, contact cycling).
inline double progressive_constraint_gain_percent(double displacement_m, double baseline_m) {
  require_positive("baseline's displacement", baseline_m, "m");
  require_in_range("displacement", displacement_m, 0.0, 1e3, "m");
  return 100.0 * (1.0 - displacement_m / baseline_m);
}

}  // namespace lumo::sense

#endif

// ---- lumo/model/kernel.hpp
#ifndef SINGLE_INCLUDE_LUMO_MODEL_KERNEL_HPP
#define SINGLE_INCLUDE_LUMO_MODEL_KERNEL_HPP

namespace lumo {

/// Correlation of a stationary Gaussian process as a function of the squared distance r² between inputs, each divided
/// by its length scale; element by element, so that it is computed many at a time. Laws: correlation(0) = 1,
/// decreasing, positive definite in any dimension; slope(r², correlation(r²)) = d correlation / d r².
template <class K>
concept CovarianceKernel = requires(const K& kernel, const Eigen::ArrayXXd& r2, const Eigen::ArrayXXd& correlation) {
  { kernel.correlation(r2) } -> std::convertible_to<Eigen::ArrayXXd>;
  { kernel.slope(r2, correlation) } -> std::convertible_to<Eigen::ArrayXXd>;
};

/// Squared exponential: exp(−r²/2). Samples are smooth.
struct RbfKernel {
  Eigen::ArrayXXd correlation(const Eigen::ArrayXXd& r2) const { return (-0.5 * r2).exp(); }
  Eigen::ArrayXXd slope(const Eigen::ArrayXXd&, const Eigen::ArrayXXd& correlation) const { return -0.5 * correlation; }
};

/// Matérn with ν = 5/2: (1 + s + s²/3) e⁻ˢ with s = √5 r. Samples have two derivatives. Source: Stein, Interpolation of
/// Spatial Data, 1999.
struct Matern52Kernel {
  Eigen::ArrayXXd correlation(const Eigen::ArrayXXd& r2) const {
    const Eigen::ArrayXXd s = (5.0 * r2).sqrt();
    return (1.0 + s + s.square() / 3.0) * (-s).exp();
  }
  Eigen::ArrayXXd slope(const Eigen::ArrayXXd& r2, const Eigen::ArrayXXd& correlation) const {
    const Eigen::ArrayXXd s = (5.0 * r2).sqrt();
    return -5.0 / 6.0 * (1.0 + s) / (1.0 + s + s.square() / 3.0) * correlation;
  }
};

static_assert(CovarianceKernel<RbfKernel> && CovarianceKernel<Matern52Kernel>);

}  // namespace lumo

#endif

// ---- lumo/model/marginal_likelihood.hpp
#ifndef SINGLE_INCLUDE_LUMO_MODEL_MARGINAL_LIKELIHOOD_HPP
#define SINGLE_INCLUDE_LUMO_MODEL_MARGINAL_LIKELIHOOD_HPP

namespace lumo {

/// Hyper-parameters of a Gaussian process without output scale, on inputs normalised to the unit box and outputs
/// standardised.
struct Hyperparameters {
  Eigen::VectorXd length_scale;  ///< one per input
  double noise = 0.0;            ///< variance of an observation
  double mean = 0.0;
};

/// ln x is normal with mean `location` and standard deviation `scale`. Throws InvalidArgument for an x that is not
/// positive, and for numbers that are no distribution.
struct LogNormalPrior {
  double location = 0.0;
  double scale = 1.0;

  double log_density(double x) const {
    check(x);
    const double z = (std::log(x) - location) / scale;
    return -std::log(x) - std::log(scale) - 0.5 * std::log(2.0 * pi) - 0.5 * z * z;
  }
  /// d log_density / d ln x.
  double log_slope(double x) const {
    check(x);
    return -1.0 - (std::log(x) - location) / (scale * scale);
  }
  double mode() const {
    check(1.0);
    return std::exp(location - scale * scale);
  }

 private:
  void check(double x) const {
    require_positive("argument of a log-normal prior", x, "");
    require_in_range("location of a log-normal prior", location, -500.0, 500.0, "");
    require_in_range("scale of a log-normal prior", scale, 1e-6, 1e3, "");
  }
};

/// Priors and bounds under which hyper-parameters are fitted. The mean has no prior.
struct HyperparameterPrior {
  LogNormalPrior length_scale;  ///< of each
  LogNormalPrior noise{-4.0, 1.0};
  double min_length_scale = 0.025;
  double max_length_scale = 1e4;
  double min_noise = 1e-4;
  double max_noise = 10.0;

  /// Length scales grow with the square root of the dimension. Source: Hvarfner, Hellsten & Nardi, "Vanilla Bayesian
  /// Optimization Performs Great in High Dimensions", ICML 2024; the numbers are those of BoTorch 0.18.
  static HyperparameterPrior for_dimension(Eigen::Index d) {
    if (d < 1) throw InvalidArgument(message("Gaussian process has ", d, " inputs, must have at least 1"));
    HyperparameterPrior prior;
    prior.length_scale = {std::sqrt(2.0) + 0.5 * std::log(double(d)), std::sqrt(3.0)};
    return prior;
  }
};

/// Log marginal likelihood of a Gaussian process and its gradient in the logarithms of the hyper-parameters; the mean
/// takes its best value, (1ᵀK⁻¹y) / (1ᵀK⁻¹1), at each. Source: Rasmussen & Williams, Gaussian Processes for Machine
/// Learning, 2006, §5.4.
template <CovarianceKernel Kernel> class MarginalLikelihood {
 public:
  struct Value {
    /// −∞ where the covariance is not positive definite
    double log_likelihood = -std::numeric_limits<double>::infinity();
    double log_prior = 0.0;
    double mean = 0.0;
    Eigen::VectorXd gradient;            ///< d log_likelihood / d ln(length scales, noise)
    Eigen::VectorXd posterior_gradient;  ///< d (log_likelihood + log_prior) / d the same
  };

  /// `x`: d × n, normalised; `y`: n, standardised; `known_noise`: n variances besides the one that is fitted, or none.
  MarginalLikelihood(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, Kernel kernel, HyperparameterPrior prior,
      Eigen::VectorXd known_noise = {})
      : size_(x.cols()),
        y_(y),
        known_noise_(std::move(known_noise)),
        kernel_(kernel),
        prior_(prior),
        squares_(x.cols() * (x.cols() - 1) / 2, x.rows()) {
    for (Eigen::Index k = 0, first = 0; k < size_; ++k) {
      const Eigen::Index below = size_ - 1 - k;
      squares_.middleRows(first, below) =
          (x.rightCols(below).colwise() - x.col(k)).array().square().matrix().transpose();
      first += below;
    }
  }

  Value operator()(const Hyperparameters& h, bool with_gradient = true) const {
    const Eigen::Index n = size_, d = squares_.cols();
    Value value;
    for (Eigen::Index j = 0; j < d; ++j) value.log_prior += prior_.length_scale.log_density(h.length_scale[j]);
    value.log_prior += prior_.noise.log_density(h.noise);

    const Eigen::VectorXd weight = h.length_scale.array().square().inverse();
    const Eigen::ArrayXXd r2 = squares_ * weight, correlation = kernel_.correlation(r2);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
      covariance(k, k) = 1.0 + h.noise;
      covariance.col(k).tail(n - 1 - k) = correlation.col(0).segment(first, n - 1 - k);
    }
    if (known_noise_.size() > 0) covariance.diagonal() += known_noise_;
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
    if (factor.info() != Eigen::Success) return value;

    Eigen::MatrixXd both(n, 2);
    both << y_, Eigen::VectorXd::Ones(n);
    factor.solveInPlace(both);
    value.mean = both.col(0).sum() / both.col(1).sum();
    const Eigen::VectorXd alpha = both.col(0) - value.mean * both.col(1);
    double log_determinant = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) log_determinant += 2.0 * std::log(factor.matrixLLT()(i, i));
    value.log_likelihood =
        -0.5 * (alpha.dot((y_.array() - value.mean).matrix()) + log_determinant + double(n) * std::log(2.0 * pi));
    if (!std::isfinite(value.log_likelihood)) value.log_likelihood = -std::numeric_limits<double>::infinity();
    if (!with_gradient || !std::isfinite(value.log_likelihood)) return value;

    // ½ tr((α αᵀ − K⁻¹) dK): each pair counts twice. The mean is at its optimum and adds nothing.
    Eigen::MatrixXd inverse_factor = Eigen::MatrixXd::Identity(n, n);
    for (Eigen::Index first = 0; first < n; first += 32) {  // in blocks of columns, which are zero above the diagonal
      auto below = inverse_factor.block(first, first, n - first, std::min<Eigen::Index>(32, n - first));
      factor.matrixLLT()
          .bottomRightCorner(n - first, n - first)
          .template triangularView<Eigen::Lower>()
          .solveInPlace(below);
    }
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(n, n);
    inverse.template selfadjointView<Eigen::Lower>().rankUpdate(inverse_factor.transpose());
    Eigen::ArrayXXd pull = kernel_.slope(r2, correlation);
    for (Eigen::Index k = 0, first = 0; k < n; first += n - 1 - k, ++k) {
      const Eigen::Index below = n - 1 - k;
      pull.col(0).segment(first, below) *= alpha.tail(below).array() * alpha[k] - inverse.col(k).tail(below).array();
    }
    value.gradient.resize(d + 1);
    value.gradient.head(d) = -2.0 * weight.cwiseProduct(squares_.transpose() * pull.matrix());
    value.gradient[d] = 0.5 * h.noise * (alpha.squaredNorm() - inverse.trace());
    value.posterior_gradient = value.gradient;
    for (Eigen::Index j = 0; j < d; ++j)
      value.posterior_gradient[j] += prior_.length_scale.log_slope(h.length_scale[j]);
    value.posterior_gradient[d] += prior_.noise.log_slope(h.noise);
    return value;
  }

 private:
  Eigen::Index size_;
  Eigen::VectorXd y_, known_noise_;
  Kernel kernel_;
  HyperparameterPrior prior_;
  Eigen::MatrixXd squares_;  ///< (pair i > k, input): squared difference; pairs column by column of the lower triangle
};

}  // namespace lumo

#endif

// ---- lumo/model/quasi_newton.hpp
#ifndef SINGLE_INCLUDE_LUMO_MODEL_QUASI_NEWTON_HPP
#define SINGLE_INCLUDE_LUMO_MODEL_QUASI_NEWTON_HPP

namespace lumo {

/// End of a bounded minimisation.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0.0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;  ///< as the search has built it up
  int evaluations = 0;
  bool converged = false;  ///< projected gradient or progress below tolerance
};

/// Minimises a smooth function of a few variables between bounds: BFGS on the variables that are free to move, with
/// projected line searches. Source: Bertsekas, "Projected Newton methods for optimization problems with simple
/// constraints", SIAM J. Control Optim. 20 (1982); damped updates after Powell, 1978.
struct QuasiNewton {
  int max_evaluations = 200;
  double gradient_tolerance = 1e-6;  ///< largest entry of the projected gradient
  double value_tolerance = 1e-9;     ///< relative decrease in one step
  double longest_step = 2.0;         ///< largest change of one variable in one step
  double shortest_step = 1e-12;      ///< the line search ends below this change
  double cut = 0.3;                  ///< of the step after a trial that is refused
  double descent = 1e-4;             ///< share of the slope's decrease that a step must have (Armijo)

  /// `function(x, gradient)` returns the value and fills the gradient. The search steps back from values that are not
  /// finite. `start` is moved between the bounds. `hessian`, positive definite, from the search for a like minimum
  /// saves steps. Throws InvalidArgument if sizes differ, for a start or bounds that are no numbers, or if the value at
  /// the start is not finite.
  template <class Function> Minimum minimize(Function&& function, const Eigen::VectorXd& start,
      const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
      const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const;

 private:
  struct Point {
    Eigen::VectorXd x;
    double value = 0.0;
    Eigen::VectorXd gradient;
  };

  static Eigen::VectorXd step_of(Minimum& best, const std::vector<Eigen::Index>& free, bool& fresh);
  static void update(Eigen::MatrixXd& hessian, const Eigen::VectorXd& s, Eigen::VectorXd y, bool fresh);
};

namespace detail {

/// Variables that may move: one at a bound that the gradient pushes it against stays there.
inline std::vector<Eigen::Index> free_variables(
    const Minimum& at, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
  std::vector<Eigen::Index> free;
  for (Eigen::Index i = 0; i < at.x.size(); ++i)
    if (!((at.x[i] <= lower[i] && at.gradient[i] >= 0.0) || (at.x[i] >= upper[i] && at.gradient[i] <= 0.0)))
      free.push_back(i);
  return free;
}

}  // namespace detail

// Newton's step of the free variables, or the steepest descent if that does not lead downwards.
inline Eigen::VectorXd QuasiNewton::step_of(Minimum& best, const std::vector<Eigen::Index>& free, bool& fresh) {
  Eigen::VectorXd step = Eigen::VectorXd::Zero(best.x.size());
  const Eigen::MatrixXd block = best.hessian(free, free);
  step(free) = -block.llt().solve(Eigen::VectorXd(best.gradient(free)));
  if (step.allFinite() && step.dot(best.gradient) < 0.0) return step;
  best.hessian.setIdentity();
  fresh = true;
  step.setZero();
  step(free) = -Eigen::VectorXd(best.gradient(free));
  return step;
}

// BFGS after the step `s` that changed the gradient by `y`.
inline void QuasiNewton::update(Eigen::MatrixXd& hessian, const Eigen::VectorXd& s, Eigen::VectorXd y, bool fresh) {
  constexpr double least = 0.2;  // share of the curvature along a step that is kept: Powell 1978
  const Eigen::Index n = s.size();
  if (fresh && s.dot(y) > 0.0) hessian = Eigen::MatrixXd::Identity(n, n) * (y.squaredNorm() / s.dot(y));
  const Eigen::VectorXd hs = hessian * s;
  const double curvature = s.dot(hs);
  if (s.dot(y) < least * curvature) {
    const double damping = 0.8 * curvature / (curvature - s.dot(y));
    y = damping * y + (1.0 - damping) * hs;
  }
  hessian += y * y.transpose() / s.dot(y) - hs * hs.transpose() / curvature;
}

template <class Function> Minimum QuasiNewton::minimize(Function&& function, const Eigen::VectorXd& start,
    const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, const std::optional<Eigen::MatrixXd>& known) const {
  const Eigen::Index n = start.size();
  if (lower.size() != n || upper.size() != n)
    throw InvalidArgument(
        message("minimiser has ", n, " variables but ", lower.size(), " lower and ", upper.size(), " upper bounds"));
  if (!start.allFinite() || !(lower.array() <= upper.array()).all())
    throw InvalidArgument("minimiser: the start must be finite, lower bounds at most the upper ones");
  Minimum best;
  best.x = start.cwiseMax(lower).cwiseMin(upper);
  best.gradient.resize(n);
  best.value = function(best.x, best.gradient);
  best.evaluations = 1;
  if (!std::isfinite(best.value) || !best.gradient.allFinite())
    throw InvalidArgument(message("function is ", best.value, " where the minimiser starts, must be finite"));

  best.hessian = known.value_or(Eigen::MatrixXd::Identity(n, n));
  bool fresh = !known;  // the Hessian has seen no curvature yet
  Point trial{Eigen::VectorXd(n), 0.0, Eigen::VectorXd(n)};
  while (best.evaluations < max_evaluations) {
    const std::vector<Eigen::Index> free = detail::free_variables(best, lower, upper);
    double steepest = 0.0;
    for (const Eigen::Index i : free) steepest = std::max(steepest, std::abs(best.gradient[i]));
    if (steepest <= gradient_tolerance) {
      best.converged = true;
      break;
    }
    const Eigen::VectorXd step = step_of(best, free, fresh);
    const double longest = step.cwiseAbs().maxCoeff();
    double scale = std::min({1.0, longest_step / longest, fresh ? 0.5 / longest : 1.0});
    bool moved = false;
    for (; !moved && scale * longest > shortest_step && best.evaluations < max_evaluations; scale *= cut) {
      trial.x = (best.x + scale * step).cwiseMax(lower).cwiseMin(upper);
      trial.value = function(trial.x, trial.gradient);
      ++best.evaluations;
      moved = std::isfinite(trial.value) && trial.gradient.allFinite() &&
              trial.value <= best.value + descent * best.gradient.dot(trial.x - best.x) && trial.value < best.value;
    }
    if (!moved) {
      best.converged = best.evaluations < max_evaluations;  // no descent left that rounding would let through
      if (fresh) break;
      best.hessian.setIdentity();
      fresh = true;
      continue;
    }
    update(best.hessian, trial.x - best.x, trial.gradient - best.gradient, fresh);
    fresh = false;
    const double decrease = best.value - trial.value;
    best.x = trial.x;
    best.value = trial.value;
    best.gradient = trial.gradient;
    if (decrease <= value_tolerance * std::max(1.0, std::abs(best.value))) {
      best.converged = true;
      break;
    }
  }
  return best;
}

}  // namespace lumo

#endif

// ---- lumo/model/gaussian_process.hpp
#ifndef SINGLE_INCLUDE_LUMO_MODEL_GAUSSIAN_PROCESS_HPP
#define SINGLE_INCLUDE_LUMO_MODEL_GAUSSIAN_PROCESS_HPP

namespace lumo {

/// Data of a Gaussian process: inputs d × n inside [lower, upper], finite outputs n.
struct TrainingData {
  Eigen::MatrixXd x;
  Eigen::VectorXd y;
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd errors = {};  ///< standard errors of the outputs, n, if they are known; empty otherwise
};

/// Lower Cholesky factor of a covariance, and the addition to its diagonal that it took.
struct JitteredFactor {
  Eigen::MatrixXd lower;
  double jitter = 0.0;
};

inline constexpr double largest_jitter = 2e-4;  ///< above 1e-4, whatever rounding did on the way there
constexpr double next_jitter(double jitter) { return jitter == 0.0 ? 1e-12 : 10.0 * jitter; }

/// Adds 0, 10⁻¹², 10⁻¹¹ … 10⁻⁴ times the largest variance until the matrix is positive definite; nullopt if even that
/// is too little.
inline std::optional<JitteredFactor> jittered_factor(const Eigen::MatrixXd& covariance) {
  const double top = covariance.size() ? covariance.diagonal().maxCoeff() : 0.0;
  for (double jitter = 0.0; jitter <= largest_jitter; jitter = next_jitter(jitter)) {
    Eigen::MatrixXd a = covariance;
    a.diagonal().array() += jitter * top;
    const Eigen::LLT<Eigen::MatrixXd> factor(a);
    if (factor.info() == Eigen::Success && factor.matrixLLT().diagonal().minCoeff() > 0.0)
      return JitteredFactor{Eigen::MatrixXd(factor.matrixL()), jitter * top};
  }
  return std::nullopt;
}

/// Gaussian process regression with a constant mean, one length scale per input and homoscedastic noise. Inputs are
/// normalised by their bounds and outputs standardised (n − 1) inside; results are in the units of the data.
/// Equal inputs and constant outputs are allowed.
template <CovarianceKernel Kernel = RbfKernel> class GaussianProcess {
 public:
  struct Config {
    Kernel kernel = {};
    std::optional<HyperparameterPrior> prior;  ///< default: HyperparameterPrior::for_dimension
    int starts = 3;                            ///< searches for hyper-parameters; the first begins at the prior's modes
    int probes = 16;                           ///< places, the other starts are the best of
    Eigen::Index subset = 64;  ///< with more observations, the search over all begins at the best optimum of this many
    QuasiNewton search = {};
  };

  /// Fits hyper-parameters to their maximum a posteriori. Deterministic. Throws InvalidArgument for shapes that do not
  /// fit, values that are not finite, or no observations.
  static GaussianProcess fit(const TrainingData& data, const Config& config = {}) {
    GaussianProcess gp(data, config);
    const Eigen::Index n = gp.size();
    const MarginalLikelihood<Kernel> likelihood = gp.likelihood();
    std::vector<Minimum> optima;
    if (n <= config.subset) {
      optima = gp.optima(likelihood, n);
    } else {
      std::vector<Eigen::Index> some;
      for (Eigen::Index i = 0; i < config.subset; ++i) some.push_back(i * n / config.subset);
      const MarginalLikelihood<Kernel> coarse(gp.x_(Eigen::all, some), gp.y_(some), config.kernel, gp.prior(),
          gp.known_noise_.size() ? Eigen::VectorXd(gp.known_noise_(some)) : Eigen::VectorXd());
      gp.config_.search.value_tolerance = 1e-5;  // a start needs no more
      const std::vector<Minimum> found = gp.optima(coarse, config.subset);
      gp.config_.search = config.search;
      std::optional<std::size_t> nearest;
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < found.size(); ++k)
        if (const double value = negative(likelihood, n, found[k].x, nullptr); value < least) {
          least = value;
          nearest = k;
        }
      optima = {nearest ? gp.descend(likelihood, n, found[*nearest].x, found[*nearest].hessian)
                        : gp.descend(likelihood, n, gp.modes())};
    }
    const Minimum* best = &optima.front();
    for (const Minimum& o : optima) best = o.value < best->value - 1e-9 ? &o : best;
    Hyperparameters h = unpack(best->x);
    h.mean = likelihood(h, false).mean;
    gp.converged_ = best->converged;
    gp.condition(h);
    return gp;
  }

  /// Takes hyper-parameters as given. Throws as fit(), and if no bounded jitter makes the covariance positive definite.
  GaussianProcess(const TrainingData& data, const Hyperparameters& h, const Config& config = {})
      : GaussianProcess(data, config) {
    if (h.length_scale.size() != x_.rows() || !h.length_scale.allFinite() || !(h.length_scale.minCoeff() > 0.0) ||
        !(h.noise >= 0.0 && std::isfinite(h.noise)))
      throw InvalidArgument(message("Gaussian process: needs ", x_.rows(),
          " length scales > 0 and a noise variance >= 0, has ", h.length_scale.size(), " and ", h.noise));
    require_finite("mean of a Gaussian process", h.mean, "");
    condition(h);
  }

  const Hyperparameters& hyperparameters() const { return hyperparameters_; }
  double jitter() const { return jitter_; }  ///< added to the diagonal of the standardised covariance
  bool converged() const { return converged_; }
  Eigen::Index size() const { return x_.cols(); }
  /// (log p(y) + log prior) / n of the standardised outputs: what fit() maximises.
  double objective() const {
    const auto value = likelihood()(hyperparameters_, false);
    return (value.log_likelihood + value.log_prior) / double(size());
  }
  /// By how much the data are likelier (in the logarithm) than to a model of the same kind with hardly any noise.
  double evidence_of_noise() const {
    Config quiet = config_;
    quiet.prior = prior();
    quiet.prior->max_noise = quiet.prior->min_noise;
    GaussianProcess other = *this;
    other.config_ = quiet;
    const MarginalLikelihood<Kernel> without = other.likelihood();
    double best = -std::numeric_limits<double>::infinity();
    for (const Minimum& o : other.optima(without, size()))
      best = std::max(best, without(unpack(o.x), false).log_likelihood);
    return likelihood()(hyperparameters_, false).log_likelihood - best;
  }

  /// Mean and variance of the latent function (without observation noise) at the columns of `x`. All that takes places
  /// throws InvalidArgument for another number of inputs, and for numbers that are not finite.
  struct Prediction {
    Eigen::VectorXd mean, variance;
  };
  Prediction predict(const Eigen::MatrixXd& x) const {
    const Eigen::MatrixXd v = whitened(normalized(x));
    const Eigen::VectorXd standard = (v.transpose() * whitened_y_).array() + hyperparameters_.mean;
    const Eigen::VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).max(0.0).transpose();
    return {(output_mean_ + output_scale_ * standard.array()).matrix(), output_scale_ * output_scale_ * variance};
  }
  Eigen::VectorXd mean(const Eigen::MatrixXd& x) const {
    const Eigen::VectorXd alpha = factor_.matrixU().solve(whitened_y_);
    return (output_mean_ + output_scale_ * ((correlation(normalized(x), x_) * alpha).array() + hyperparameters_.mean))
        .matrix();
  }
  /// Posterior covariance of the latent function between two sets of points.
  Eigen::MatrixXd covariance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const {
    const Eigen::MatrixXd ua = normalized(a), ub = normalized(b);
    return output_scale_ * output_scale_ * (correlation(ua, ub) - whitened(ua).transpose() * whitened(ub));
  }
  /// Joint samples at the columns of `x`: points × samples, from standard normal numbers of the same shape. nullopt if
  /// the covariance cannot be factorised.
  std::optional<Eigen::MatrixXd> sample(const Eigen::MatrixXd& x, const Eigen::MatrixXd& normals) const {
    if (normals.rows() != x.cols() || !normals.allFinite())
      throw InvalidArgument(
          message("samples at ", x.cols(), " points need as many rows of finite normal numbers, not ", normals.rows()));
    const auto factor = jittered_factor(covariance(x, x));
    if (!factor) return std::nullopt;
    return (factor->lower * normals).colwise() + predict(x).mean;
  }
  /// Prediction of each observation without it, with its noise, from the fitted hyper-parameters.
  /// Source: Rasmussen & Williams 2006, eq. 5.12.
  Prediction leave_one_out() const {
    const Eigen::MatrixXd inverse = factor_.solve(Eigen::MatrixXd::Identity(size(), size()));
    const Eigen::VectorXd alpha = factor_.matrixU().solve(whitened_y_);
    const Eigen::ArrayXd variance = inverse.diagonal().array().inverse();
    return {(output_mean_ + output_scale_ * (y_.array() - alpha.array() * variance)).matrix(),
        (output_scale_ * output_scale_ * variance).matrix()};
  }

  /// K(X, x) after forward substitution: V with posterior covariance k(a, b) − V(a)ᵀV(b), in standardised units.
  Eigen::MatrixXd whitened(const Eigen::MatrixXd& unit_x) const {
    Eigen::MatrixXd v = correlation(x_, unit_x);
    factor_.matrixL().solveInPlace(v);
    return v;
  }
  Eigen::MatrixXd correlation(const Eigen::MatrixXd& unit_a, const Eigen::MatrixXd& unit_b) const {
    const Eigen::ArrayXd inverse = hyperparameters_.length_scale.array().inverse();
    const Eigen::MatrixXd a = (unit_a.array().colwise() * inverse).matrix(),
                          b = (unit_b.array().colwise() * inverse).matrix();
    Eigen::ArrayXXd r2 = Eigen::ArrayXXd::Zero(a.cols(), b.cols());
    for (Eigen::Index i = 0; i < b.cols(); ++i)
      for (Eigen::Index j = 0; j < a.rows(); ++j) r2.col(i) += (a.row(j).array() - b(j, i)).square().transpose();
    return config_.kernel.correlation(r2);
  }
  Eigen::MatrixXd normalized(const Eigen::MatrixXd& x) const {
    if (x.rows() != lower_.size() || !x.allFinite())
      throw InvalidArgument(
          message("Gaussian process: places have ", x.rows(), " inputs, must have ", lower_.size(), " finite ones"));
    Eigen::MatrixXd unit = ((x.colwise() - lower_).array().colwise() * inverse_width_.array()).matrix();
    constexpr double largest = 1e100;  // squares of differences do not overflow
    if (!(unit.array().abs() <= largest).all())
      throw InvalidArgument("Gaussian process: a place is more than 1e100 widths of the bounds away");
    return unit;
  }
  const Eigen::VectorXd& weights() const { return whitened_y_; }  ///< L⁻¹(y − mean), standardised
  double output_mean() const { return output_mean_; }
  double output_scale() const { return output_scale_; }

 private:
  Eigen::MatrixXd x_;            ///< normalised
  Eigen::VectorXd y_;            ///< standardised
  Eigen::VectorXd known_noise_;  ///< variances of the observations that are known, standardised; empty: none
  Eigen::VectorXd lower_, inverse_width_;
  double output_mean_ = 0.0, output_scale_ = 1.0;
  Hyperparameters hyperparameters_;
  Config config_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
  Eigen::VectorXd whitened_y_;
  double jitter_ = 0.0;
  bool converged_ = true;

  explicit GaussianProcess(const TrainingData& data, const Config& config) : lower_(data.lower), config_(config) {
    const Eigen::Index d = data.x.rows(), n = data.x.cols();
    if (n < 1 || d < 1)
      throw InvalidArgument(
          message("Gaussian process has ", n, " observations of ", d, " inputs, must have at least 1 of each"));
    if (data.y.size() != n || data.lower.size() != d || data.upper.size() != d)
      throw InvalidArgument(message("Gaussian process has ", n, " observations of ", d, " inputs, but ", data.y.size(),
          " outputs, ", data.lower.size(), " lower and ", data.upper.size(), " upper bounds"));
    if (!data.x.allFinite() || !data.y.allFinite() || !data.lower.allFinite() || !data.upper.allFinite())
      throw InvalidArgument("Gaussian process: observations and bounds must be finite numbers");
    inverse_width_ = (data.upper - data.lower).unaryExpr([](double w) { return w > 0.0 ? 1.0 / w : 0.0; });
    x_ = normalized(data.x);

    // Scaled so that squares neither overflow nor vanish.
    const double size = std::max(data.y.cwiseAbs().maxCoeff(), std::numeric_limits<double>::min());
    const Eigen::VectorXd scaled = data.y / size;
    const double mean = scaled.mean();
    const double deviation = n > 1 ? std::sqrt((scaled.array() - mean).square().sum() / double(n - 1)) : 0.0;
    const bool constant = deviation < 1e-14;  // no more than rounding
    output_mean_ = mean * size;
    output_scale_ = constant ? 1.0 : deviation * size;
    y_ = constant ? Eigen::VectorXd::Zero(n) : Eigen::VectorXd((scaled.array() - mean) / deviation);
    if (data.errors.size() == 0) return;
    if (data.errors.size() != n || !data.errors.allFinite() || data.errors.minCoeff() < 0.0)
      throw InvalidArgument(
          message("Gaussian process: needs ", n, " finite standard errors >= 0, has ", data.errors.size()));
    constexpr double largest = 1e3;  // of a standard deviation of the outputs: such an observation says nothing
    known_noise_ = (data.errors.array() / output_scale_).min(largest).square().matrix();
  }
  MarginalLikelihood<Kernel> likelihood() const { return {x_, y_, config_.kernel, prior(), known_noise_}; }
  void condition(const Hyperparameters& h) {
    hyperparameters_ = h;
    Eigen::MatrixXd covariance = correlation(x_, x_);
    covariance.diagonal().array() += h.noise;
    if (known_noise_.size() > 0) covariance.diagonal() += known_noise_;
    for (jitter_ = 0.0;; jitter_ = next_jitter(jitter_)) {
      if (jitter_ > largest_jitter)
        throw InvalidArgument("Gaussian process: covariance is not positive definite, even with a jitter of 1e-4");
      Eigen::MatrixXd a = covariance;
      a.diagonal().array() += jitter_;
      factor_.compute(a);
      if (factor_.info() == Eigen::Success && factor_.matrixLLT().diagonal().minCoeff() > 0.0) break;
    }
    whitened_y_ = (y_.array() - h.mean).matrix();
    factor_.matrixL().solveInPlace(whitened_y_);
  }
  // The search for hyper-parameters is in their logarithms; it minimises −(log p(y) + log prior)/n.
  static Hyperparameters unpack(const Eigen::VectorXd& u) {
    const Eigen::Index d = u.size() - 1;
    return {u.head(d).unaryExpr([](double v) { return std::exp(v); }), std::exp(u[d]), 0.0};
  }
  static double negative(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& u,
      Eigen::VectorXd* gradient) {
    const auto value = likelihood(unpack(u), gradient != nullptr);
    if (!std::isfinite(value.log_likelihood)) return std::numeric_limits<double>::infinity();
    if (gradient) *gradient = -value.posterior_gradient / double(n);
    return -(value.log_likelihood + value.log_prior) / double(n);
  }
  Eigen::VectorXd modes() const {
    Eigen::VectorXd u = Eigen::VectorXd::Constant(x_.rows() + 1, std::log(prior().length_scale.mode()));
    u[x_.rows()] = std::log(prior().noise.mode());
    return u;
  }
  Minimum descend(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n, const Eigen::VectorXd& start,
      const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const {
    const Eigen::Index d = x_.rows();
    const HyperparameterPrior p = prior();
    Eigen::VectorXd lower = Eigen::VectorXd::Constant(d + 1, std::log(p.min_length_scale)),
                    upper = Eigen::VectorXd::Constant(d + 1, std::log(p.max_length_scale));
    lower[d] = std::log(p.min_noise);
    upper[d] = std::log(p.max_noise);
    return config_.search.minimize(
        [&](const Eigen::VectorXd& u, Eigen::VectorXd& gradient) { return negative(likelihood, n, u, &gradient); },
        start, lower, upper, hessian);
  }
  /// One start stops in local optima: after the prior's modes come the most promising of some places spread between
  /// short and long length scales, little and much noise.
  std::vector<Minimum> optima(const MarginalLikelihood<Kernel>& likelihood, Eigen::Index n) const {
    const Eigen::Index d = x_.rows();
    std::vector<Minimum> found = {descend(likelihood, n, modes())};
    std::vector<std::pair<double, Eigen::VectorXd>> probes;
    for (int k = 0; config_.starts > 1 && k < config_.probes; ++k) {
      Eigen::VectorXd u(d + 1);
      for (Eigen::Index j = 0; j <= d; ++j) {
        const double t =
            OwenSobol{combine(7, std::uint64_t(j / Sobol::dimensions))}(std::uint32_t(k), int(j % Sobol::dimensions));
        u[j] = j < d ? std::log(0.1) + t * (std::log(100.0) + 0.5 * std::log(double(d)))
                     : std::log(1e-4) + t * std::log(1e3);
      }
      if (const double value = negative(likelihood, n, u, nullptr); std::isfinite(value)) probes.emplace_back(value, u);
    }
    std::stable_sort(probes.begin(), probes.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t k = 0; k < probes.size() && int(k) + 1 < config_.starts; ++k)
      found.push_back(descend(likelihood, n, probes[k].second));
    return found;
  }
  HyperparameterPrior prior() const {
    return config_.prior ? *config_.prior : HyperparameterPrior::for_dimension(x_.rows());
  }
};

}  // namespace lumo

#endif

// ---- lumo/sense/decode/gaussian_process_decoder.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_GAUSSIAN_PROCESS_DECODER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_GAUSSIAN_PROCESS_DECODER_HPP

namespace lumo::sense {

/// Templates that are smooth along the finger: one Gaussian process for each feature over the finger coordinate, so
/// that each place learns from its neighbours' observations too. A response is weighed against the processes' mean with
/// one shrunk covariance of the residuals and the processes' own variance. Unlike discriminants it has a template
/// between the tested places as well.
struct GaussianProcessDecoder {
  double shrinkage = -1.0;  ///< of the residuals' covariance, 0 … 1; negative: Ledoit and Wolf's
  int grid = 201;           ///< coordinates that `coordinate_m` weighs

  class Model {
   public:
    Model(const LabelledResponses& t, const GaussianProcessDecoder& config)
        : grid_(Eigen::VectorXd::LinSpaced(config.grid, t.place_m[0], t.place_m[t.places() - 1])) {
      const Eigen::Index d = t.response.rows(), n = t.response.cols();
      const Eigen::VectorXd& coordinate = grid_;
      TrainingData data{Eigen::MatrixXd(1, n), Eigen::VectorXd(n), t.place_m.head(1), t.place_m.tail(1)};
      for (Eigen::Index i = 0; i < n; ++i) data.x(0, i) = t.place_m[t.place[std::size_t(i)]];
      Eigen::MatrixXd residual(d, n), on_grid(d, config.grid), grid_variance(d, config.grid);
      Eigen::MatrixXd mean(d, t.places());
      Eigen::MatrixXd variance(d, t.places());
      for (Eigen::Index f = 0; f < d; ++f) {
        data.y = t.response.row(f).transpose();
        const auto process = GaussianProcess<>::fit(data);
        residual.row(f) = t.response.row(f) - process.mean(data.x).transpose();
        const auto places = process.predict(t.place_m.transpose()), fine = process.predict(coordinate.transpose());
        mean.row(f) = places.mean.transpose();
        variance.row(f) = places.variance.transpose();
        on_grid.row(f) = fine.mean.transpose();
        grid_variance.row(f) = fine.variance.transpose();
      }
      double share = config.shrinkage;
      covariance_ = shrunk_covariance(residual, t.places(), share);
      for (Eigen::Index p = 0; p < mean.cols(); ++p) place_.push_back(factor(variance.col(p)));
      for (Eigen::Index g = 0; g < grid_.size(); ++g) fine_.push_back(factor(grid_variance.col(g)));
      mean_ = std::move(mean);
      grid_mean_ = std::move(on_grid);
    }
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const { return weigh(response, mean_, place_); }
    /// Mean of the coordinate's posterior over the tested range, flat before [m].
    double coordinate_m(const Eigen::VectorXd& response) const {
      return weigh(response, grid_mean_, fine_).probability.dot(grid_);
    }

   private:
    using Factor = Eigen::LLT<Eigen::MatrixXd>;
    Factor factor(const Eigen::VectorXd& variance) const {
      return Factor(covariance_ + Eigen::MatrixXd(variance.asDiagonal()));
    }
    template <class Some> static Decoding weigh(
        const Eigen::VectorXd& response, const Eigen::MatrixXd& mean, const std::vector<Some>& factors) {
      if (response.size() != mean.rows())
        throw InvalidArgument(message("response has ", response.size(), " features, the decoder ", mean.rows()));
      Eigen::VectorXd log_likelihood(mean.cols());
      for (Eigen::Index p = 0; p < mean.cols(); ++p) {
        const Some& l = factors[std::size_t(p)];
        const Eigen::VectorXd z = l.matrixL().solve(response - mean.col(p));
        log_likelihood[p] = -0.5 * z.squaredNorm() - l.matrixLLT().diagonal().array().log().sum();
      }
      return decoding_of(log_likelihood);
    }

    Eigen::VectorXd grid_;
    Eigen::MatrixXd mean_, grid_mean_, covariance_;
    std::vector<Factor> place_, fine_;
  };

  /// Throws InvalidArgument for data that do not fit together.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("shrinkage", shrinkage, std::numeric_limits<double>::lowest(), 1.0, "");
    require_in_range("grid of the decoder", grid, 2, 100000, "");
    return Model(training, *this);
  }
};

static_assert(Decoder<GaussianProcessDecoder>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/recontact_metrics.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_RECONTACT_METRICS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_RECONTACT_METRICS_HPP

namespace lumo::sense {

/// Slope of each channel's response over force [unit/N], by least squares with an intercept: a profile that is the same
/// at all loads, such as the unloaded one, drops out, subtracted or not. `response`: channels × loads. Throws
/// InvalidArgument for fewer than two different loads or numbers that are not finite.
inline Eigen::VectorXd intensity_force_slope(const Eigen::MatrixXd& response, const Eigen::VectorXd& force_N) {
  if (force_N.size() < 2 || response.cols() != force_N.size())
    throw InvalidArgument(message("slope over force: ", response.cols(), " responses and ", force_N.size(),
        " loads, must be as many, at least 2"));
  if (!response.allFinite() || !force_N.allFinite()) throw InvalidArgument("slope over force: numbers must be finite");
  const Eigen::VectorXd centred = force_N.array() - force_N.mean();
  const double spread = centred.squaredNorm();
  if (!(spread > 1e-12 * force_N.squaredNorm())) throw InvalidArgument("slope over force: all loads are the same");
  return response * centred / spread;
}

/// How far neighbouring places differ, against how well re-contacts repeat, by slopes (intensity_force_slope). Source:
/// paper, Eq. 9; that no unloaded profile enters, its authors' public code (dokkev/fingertip-design-framework).
struct RecontactMetrics {
  double D_neighbor = 0.0;  ///< median over neighbours of the RMS difference of their median profiles [unit/N]
  /// Median over places and re-contacts of the RMS deviation from the median profile [unit/N]
  double W_recontact = 0.0;
  std::optional<double> Q;  ///< D/W; empty where W is 0
};

/// Q with what happens to it when one re-contact is left out (the paper's whiskers), and a bootstrap interval.
struct RecontactQuality {
  RecontactMetrics metrics;
  double Q_low = 0.0, Q_high = 0.0;  ///< least and greatest with one re-contact left out everywhere, and of all
  /// Interval of the Q that infinitely many re-contacts at these places would give. Few re-contacts make Q too large,
  /// for their median lies among them; the interval makes up for that and so need not hold the sample's own Q.
  double bootstrap_low = 0.0, bootstrap_high = 0.0;
};

/// `slope[i]`: profiles of slopes at place i along the finger, channels × re-contacts. Throws InvalidArgument for fewer
/// than two places, no re-contacts, or shapes that differ.
inline RecontactMetrics recontact_metrics(const std::vector<Eigen::MatrixXd>& slope) {
  if (slope.size() < 2)
    throw InvalidArgument(message("re-contact metrics have ", slope.size(), " places, must have at least 2"));
  std::vector<Eigen::VectorXd> middle;
  std::vector<double> between, within;
  for (const Eigen::MatrixXd& p : slope) {
    if (p.cols() < 1 || p.rows() != slope.front().rows() || p.rows() < 1)
      throw InvalidArgument(message("re-contact metrics: place ", middle.size(), " has ", p.rows(), " channels × ",
          p.cols(), " re-contacts, the first ", slope.front().rows(), " channels"));
    if (!p.allFinite())
      throw InvalidArgument(message("re-contact metrics: slopes at place ", middle.size(), " must be finite"));
    middle.push_back(pointwise_median(p));
    for (Eigen::Index r = 0; r < p.cols(); ++r) within.push_back(rms(p.col(r) - middle.back()));
  }
  for (std::size_t i = 1; i < middle.size(); ++i) between.push_back(rms(middle[i] - middle[i - 1]));
  RecontactMetrics m{median(between), median(within), {}};
  if (m.W_recontact > 0.0) m.Q = m.D_neighbor / m.W_recontact;
  return m;
}

/// At least three re-contacts at each place, as many everywhere (of two, the whiskers' one would be its own median).
/// The interval is a parametric bootstrap of log Q: re-contacts are drawn about each place's median from a Gaussian
/// with the covariance that the place's own re-contacts have (channels scatter together where a contact shifts), and
/// the errors of log Q against that known model are taken off. Re-contacts are not drawn anew: so few of
/// them would repeat, and W would be too small. `confidence` of the interval. Source: Efron & Tibshirani
/// 1993, §6.5 and §13. Throws InvalidArgument where Q is not defined.
inline RecontactQuality recontact_quality(
    const std::vector<Eigen::MatrixXd>& slope, int resamples = 2000, std::uint64_t seed = 1, double confidence = 0.95) {
  require_in_range("bootstrap resamples", resamples, 20, 1e6, "");
  require_in_range("confidence", confidence, 0.0, 1.0, "");
  RecontactQuality q;
  q.metrics = recontact_metrics(slope);
  const Eigen::Index repeats = slope.front().cols();
  for (const Eigen::MatrixXd& p : slope)
    if (p.cols() != repeats || repeats < 3)
      throw InvalidArgument(message(
          "re-contact quality needs as many re-contacts everywhere, at least 3; has ", p.cols(), " and ", repeats));
  if (!q.metrics.Q) throw InvalidArgument("re-contact quality is not defined: all re-contacts are the same");
  if (!(*q.metrics.Q > 0.0)) throw InvalidArgument("re-contact quality is not defined: all places are the same");
  q.Q_low = q.Q_high = *q.metrics.Q;
  std::vector<Eigen::MatrixXd> some(slope.size());
  for (Eigen::Index left_out = 0; left_out < repeats; ++left_out) {
    for (std::size_t i = 0; i < slope.size(); ++i) {
      some[i].resize(slope[i].rows(), repeats - 1);
      some[i] << slope[i].leftCols(left_out), slope[i].rightCols(repeats - 1 - left_out);
    }
    if (const auto without = recontact_metrics(some).Q) {
      q.Q_low = std::min(q.Q_low, *without);
      q.Q_high = std::max(q.Q_high, *without);
    }
  }
  std::vector<Eigen::VectorXd> middle;
  std::vector<Eigen::MatrixXd> scatter;  // times a vector of normal numbers: a deviation of that place
  for (const Eigen::MatrixXd& p : slope) {
    middle.push_back(pointwise_median(p));
    scatter.push_back((p.colwise() - p.rowwise().mean()) / std::sqrt(double(repeats) - 1.0));
  }
  CountedNormals normal(seed);
  Eigen::VectorXd numbers(repeats);
  const auto deviation = [&](std::size_t place) {
    for (double& z : numbers) z = normal();
    return Eigen::VectorXd(scatter[place] * numbers);
  };
  std::vector<double> sizes, error;
  for (int k = 0; k < resamples; ++k)
    for (std::size_t i = 0; i < slope.size(); ++i) sizes.push_back(rms(deviation(i)));
  const double W = median(sizes);  // of the model
  some = slope;
  for (int k = 0; k < resamples && W > 0.0; ++k) {
    for (std::size_t i = 0; i < slope.size(); ++i)
      for (Eigen::Index r = 0; r < repeats; ++r) some[i].col(r) = middle[i] + deviation(i);
    if (const auto drawn = recontact_metrics(some).Q; drawn && *drawn > 0.0)
      error.push_back(std::log(*drawn * W / q.metrics.D_neighbor));
  }
  if (error.empty())
    throw InvalidArgument("re-contact quality has no interval: at most places all re-contacts are the same");
  // The scatter itself is known from so many re-contacts only: wider by √(n/(n − 1)) about the middle.
  const double centre = median(error), wider = std::sqrt(double(repeats) / (double(repeats) - 1.0));
  const auto limit = [&](double p) { return *q.metrics.Q * std::exp(-centre - wider * (quantile(error, p) - centre)); };
  q.bootstrap_low = limit(0.5 * (1.0 + confidence));
  q.bootstrap_high = limit(0.5 * (1.0 - confidence));
  return q;
}

/// Regional RMS change: of each channel, over re-contacts, from a low load to a high one (paper: 2 to 15 N). Both
/// channels × re-contacts.
inline Eigen::VectorXd regional_rms_change(const Eigen::MatrixXd& low, const Eigen::MatrixXd& high) {
  if (low.rows() != high.rows() || low.cols() != high.cols() || low.cols() < 1)
    throw InvalidArgument(message("regional change: ", low.rows(), " × ", low.cols(), " and ", high.rows(), " × ",
        high.cols(), " responses, must be the same, at least one re-contact"));
  if (!low.allFinite() || !high.allFinite()) throw InvalidArgument("regional change: responses must be finite");
  return ((high - low).rowwise().squaredNorm() / double(low.cols())).cwiseSqrt();
}

/// 100 (1 − W/W_base) [%]: by how much a variation is smaller than the baseline's.
inline double reduction_percent(double value, double baseline) {
  constexpr double most = 1e150;  // their ratio does not overflow
  require_in_range("baseline's value", baseline, 1.0 / most, most, "");
  require_in_range("value", value, -most, most, "");
  return 100.0 * (1.0 - value / baseline);
}
/// 100 (D/D_base − 1) [%].
inline double gain_percent(double value, double baseline) { return -reduction_percent(value, baseline); }

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/segment_responses.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_SEGMENT_RESPONSES_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_SEGMENT_RESPONSES_HPP

namespace lumo::sense {

/// Mean response over each hold of a log, ready for metrics and decoders.
struct HoldResponse {
  Segment segment;
  Eigen::VectorXd response;  ///< mean over the segment's profiles, minus the unloaded one that came last before it
  int profiles = 0;
  double load_N = 0.0;  ///< that pressed: the segment's, or what a force sensor measured
};

/// Responses of all segments of kind `hold` that have profiles. Each is taken against the mean over the last
/// segment of kind `unloaded` that ended before it, because lamps drift between re-contacts; a session without any is
/// an error. Throws InvalidArgument.
inline std::vector<HoldResponse> hold_responses(
    const std::span<const Profile>& profiles, const std::vector<Segment>& segments) {
  const auto mean = [&](const Segment& s) {
    std::pair<Eigen::VectorXd, int> m{Eigen::VectorXd(), 0};
    for (const Profile& p : profiles) {
      if (p.stamp_ns < s.from_ns || p.stamp_ns > s.to_ns) continue;
      if (m.second == 0) m.first = Eigen::VectorXd::Zero(p.value.size());
      if (p.value.size() != m.first.size())
        throw InvalidArgument(message("profiles have ", m.first.size(), " and ", p.value.size(), " values"));
      m.first += p.value;
      ++m.second;
    }
    if (m.second > 0) m.first /= double(m.second);
    return m;
  };
  std::vector<HoldResponse> list;
  std::map<std::size_t, Eigen::VectorXd> unloaded;
  for (const Segment& s : segments) {
    if (s.kind != SegmentKind::hold) continue;
    const Segment* before = nullptr;
    for (const Segment& u : segments)
      if (u.kind == SegmentKind::unloaded && u.to_ns <= s.from_ns && (!before || u.to_ns > before->to_ns)) before = &u;
    if (!before)
      throw InvalidArgument(message("the segment that begins at ", s.from_ns, " ns has no unloaded segment before it"));
    auto& reference = unloaded[std::size_t(before - segments.data())];
    if (reference.size() == 0) reference = mean(*before).first;
    const auto [value, count] = mean(s);
    if (count == 0) continue;
    if (reference.size() != value.size())
      throw InvalidArgument(message("the unloaded segment that ends at ", before->to_ns, " ns has no profiles"));
    list.push_back({s, value - reference, count, s.load_N});
  }
  return list;
}

/// Those holds of one indenter at one approach angle: places are compared under the same contact only.
inline std::vector<HoldResponse> responses_of(
    const std::vector<HoldResponse>& holds, double diameter_mm, double angle_deg) {
  std::vector<HoldResponse> list;
  for (const HoldResponse& h : holds)
    if (h.segment.diameter_mm == diameter_mm && h.segment.angle_deg == angle_deg) list.push_back(h);
  return list;
}

namespace detail {

/// Holds by place, re-contact and load. Throws InvalidArgument unless one indenter at one angle made them all, each
/// load of a re-contact is held once, and places, numbered along the finger, ascend in y.
inline std::map<int, std::map<int, std::map<double, const HoldResponse*>>> recontacts(
    const std::vector<HoldResponse>& holds) {
  std::map<int, std::map<int, std::map<double, const HoldResponse*>>> by_place;
  const Segment* first = nullptr;
  for (const HoldResponse& h : holds) {
    const Segment& s = h.segment;
    if (s.place < 0 || s.repetition < 0) continue;
    if (!first) first = &s;
    if (s.diameter_mm != first->diameter_mm || s.angle_deg != first->angle_deg)
      throw InvalidArgument(message("holds are of indenters of ", first->diameter_mm, " mm at ", first->angle_deg,
          "° and of ", s.diameter_mm, " mm at ", s.angle_deg, "°, must be of one: take each by itself"));
    if (!by_place[s.place][s.repetition].emplace(s.load_N, &h).second)
      throw InvalidArgument(
          message("place ", s.place, ", re-contact ", s.repetition, " has two holds at ", s.load_N, " N"));
  }
  const Segment* before = nullptr;
  for (const auto& place : by_place) {
    const Segment& s = place.second.begin()->second.begin()->second->segment;
    for (const auto& recontact : place.second)
      for (const auto& hold : recontact.second)
        if (hold.second->segment.y_mm != s.y_mm)
          throw InvalidArgument(
              message("place ", s.place, " lies at y = ", s.y_mm, " and at ", hold.second->segment.y_mm, " mm"));
    if (before && !(s.y_mm > before->y_mm))
      throw InvalidArgument(message("place ", s.place, " lies at y = ", s.y_mm, " mm, must exceed that of place ",
          before->place, ", ", before->y_mm, " mm"));
    before = &s;
  }
  return by_place;
}

}  // namespace detail

/// Slope profiles p_{i,r} over the loads of each re-contact: for each place along the finger, channels ×
/// re-contacts. All holds of a re-contact that stand on one unloaded segment share its profile, which drops out.
/// Throws InvalidArgument where more than one indenter or angle is among the holds, a load is held twice, or a place
/// between two others is missing: its neighbours are none of each other.
inline std::vector<Eigen::MatrixXd> slope_profiles(const std::vector<HoldResponse>& holds) {
  std::vector<Eigen::MatrixXd> slopes;
  int next = -1;
  for (const auto& place : detail::recontacts(holds)) {
    if (next >= 0 && place.first != next)
      throw InvalidArgument(message("place ", next, " has no re-contacts, but places before and after it have"));
    next = place.first + 1;
    Eigen::MatrixXd m(holds.front().response.size(), Eigen::Index(place.second.size()));
    Eigen::Index column = 0;
    for (const auto& recontact : place.second) {
      Eigen::MatrixXd response(m.rows(), Eigen::Index(recontact.second.size()));
      Eigen::VectorXd load(response.cols());
      Eigen::Index k = 0;
      for (const auto& hold : recontact.second) {
        response.col(k) = hold.second->response;
        load[k++] = hold.second->load_N;
      }
      m.col(column++) = intensity_force_slope(response, load);
    }
    slopes.push_back(std::move(m));
  }
  return slopes;
}

/// The decoder's observations, with the repetition of each as its fold.
struct DecodingTask {
  LabelledResponses data;
  std::vector<int> fold;
};

/// Loads [N] of at least `least_N` at which every re-contact was held, ascending. Throws InvalidArgument as
/// slope_profiles does.
inline std::vector<double> common_loads(const std::vector<HoldResponse>& holds, double least_N) {
  std::map<double, int> count;
  int recontacts = 0;
  for (const auto& place : detail::recontacts(holds))
    for (const auto& recontact : place.second) {
      ++recontacts;
      for (const auto& hold : recontact.second) ++count[hold.first];
    }
  std::vector<double> loads;
  for (const auto& [load, times] : count)
    if (times == recontacts && load >= least_N) loads.push_back(load);
  return loads;
}

/// Signed change of response from load to load (paper: from 2 to 5 N), the steps one below the other. `load_N`: at
/// least two. Re-contacts that lack one of them are left out. Throws InvalidArgument when fewer than two places are
/// left, and as slope_profiles does for holds that are not of one kind.
inline DecodingTask decoding_task(const std::vector<HoldResponse>& holds, const std::vector<double>& load_N) {
  if (load_N.size() < 2) throw InvalidArgument(message("decoding needs at least 2 loads, has ", load_N.size()));
  struct Contact {
    int place, repetition;
    std::vector<const HoldResponse*> at;  // the loads
  };
  std::vector<Contact> contacts;
  std::map<int, double> place_m;
  for (const auto& place : detail::recontacts(holds))
    for (const auto& recontact : place.second) {
      Contact c{place.first, recontact.first, {}};
      for (const double load : load_N)
        for (const auto& hold : recontact.second)
          if (std::abs(hold.first - load) < 1e-6) c.at.push_back(hold.second);
      if (c.at.size() != load_N.size()) continue;
      place_m[c.place] = 1e-3 * c.at.front()->segment.y_mm;
      contacts.push_back(std::move(c));
    }
  if (place_m.size() < 2)
    throw InvalidArgument(message("decoding: ", place_m.size(), " places have all the loads, must be at least 2"));
  DecodingTask task;
  const Eigen::Index channels = contacts.front().at.front()->response.size(), steps = Eigen::Index(load_N.size()) - 1;
  task.data.response.resize(channels * steps, Eigen::Index(contacts.size()));
  task.data.place_m.resize(Eigen::Index(place_m.size()));
  std::map<int, int> number;
  for (const auto& p : place_m) {
    const int next = int(number.size());
    task.data.place_m[next] = p.second;
    number[p.first] = next;
  }
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const Contact& c = contacts[i];
    for (Eigen::Index k = 0; k < steps; ++k)
      task.data.response.block(k * channels, Eigen::Index(i), channels, 1) =
          c.at[std::size_t(k) + 1]->response - c.at[std::size_t(k)]->response;
    task.data.place.push_back(number[c.place]);
    task.fold.push_back(c.repetition);
  }
  return task;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/measured_loads.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_MEASURED_LOADS_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_MEASURED_LOADS_HPP

namespace lumo::sense {

/// Limits of what is believed of nominal loads; chosen on the virtual lab, whose controller stays within 1 %.
struct LoadLimits {
  double wrong_force_N = 0.5;  ///< on the wrong side in the holds (median): the sensor's sign is the other one
  double load_share = 0.03;    ///< by which measured loads may be off the nominal ones (median)
  double correlation = 0.8;    ///< of measured and nominal loads, at least, or the sensor measured something else
};

/// The force sensor against what the log's segments say of the holds.
struct LoadCheck {
  int holds = 0;          ///< with a measured load
  bool reversed = false;  ///< the sensor reports the force of the finger on the object
  double share = 1.0;     ///< measured over nominal load, median
  bool follows = false;   ///< measured loads rise with the nominal ones: slopes are per newton that it measured
  bool differs = false;   ///< by more than sensors and controllers do
};

/// Mean of the tared normal force over a segment [N]; nullopt without samples there.
inline std::optional<double> measured_load_N(
    const Segment& segment, const Session& session, const std::vector<WrenchSample>& wrenches, double tare_N) {
  double sum = 0.0;
  long count = 0;
  for (const WrenchSample& w : wrenches)
    if (segment.holds(session.wrench_clock(w.stamp_ns))) {
      sum += w.normal_force_N() - tare_N;
      ++count;
    }
  return count > 0 ? std::optional(sum / double(count)) : std::nullopt;
}

/// Whether the correlation of two lists is at least `least`; true where the second one does not vary.
inline bool rise_together(const std::vector<double>& a, const std::vector<double>& b, double least) {
  const Eigen::Map<const Eigen::VectorXd> first(a.data(), Eigen::Index(a.size())),
      second(b.data(), Eigen::Index(b.size()));
  const Eigen::VectorXd x = first.array() - first.mean(), y = second.array() - second.mean();
  return y.norm() <= 1e-9 * second.norm() || x.dot(y) >= std::max(least * x.norm() * y.norm(), 1e-12);
}

inline LoadCheck check_loads(
    const Session& session, const std::vector<WrenchSample>& wrenches, const LoadLimits& limits = {}) {
  LoadCheck check;
  const double tare = force_tare_N(session, wrenches);
  std::vector<double> load, nominal, share;
  for (const Segment& s : session.segments)
    if (s.kind == SegmentKind::hold && s.load_N > 0.0)
      if (const auto measured = measured_load_N(s, session, wrenches, tare)) {
        load.push_back(*measured);
        nominal.push_back(s.load_N);
        share.push_back(*measured / s.load_N);
      }
  check.holds = int(load.size());
  if (load.empty()) return check;
  check.share = median(share);
  check.reversed = median(load) < -limits.wrong_force_N;
  check.follows = !check.reversed && median(load) > 0.0 && rise_together(load, nominal, limits.correlation);
  check.differs = check.follows && std::abs(check.share - 1.0) > limits.load_share;
  return check;
}

/// Sets the load of each hold to what the force sensor measured in it, less its tare; holds without samples, or where
/// it measured nothing, keep theirs.
inline void take_measured_loads(
    std::vector<HoldResponse>& holds, const Session& session, const std::vector<WrenchSample>& wrenches) {
  const double tare = force_tare_N(session, wrenches);
  for (HoldResponse& h : holds)
    if (const auto measured = measured_load_N(h.segment, session, wrenches, tare); measured && *measured > 0.0)
      h.load_N = *measured;
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/decode/nearest_template.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_DECODE_NEAREST_TEMPLATE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_DECODE_NEAREST_TEMPLATE_HPP

namespace lumo::sense {

/// The paper's decoder: the place whose template is nearest (Euclidean). The template is the mean, not the median, over
/// the training data, which cross_validate makes all other repetitions. Probabilities are those of equal, round
/// Gaussians about the templates, as wide as the training data scatter. Source: paper; the mean from its authors'
/// public code (dokkev/fingertip-design-framework, fig5c_decoder.py), whose features are the signed means of six equal
/// parts (LongitudinalBins::parts).
struct NearestTemplate {
  class Model {
   public:
    explicit Model(const LabelledResponses& training) : template_(place_means(training)) {
      const Eigen::MatrixXd& means = template_;
      double squares = 0.0;
      for (std::size_t i = 0; i < training.place.size(); ++i)
        squares += (training.response.col(Eigen::Index(i)) - means.col(training.place[i])).squaredNorm();
      const double freedom =
          double(training.response.rows()) * std::max(1.0, double(training.place.size()) - double(training.places()));
      variance_ = std::max(squares / freedom, 1e-12 * means.cwiseAbs2().maxCoeff() + 1e-300);
    }
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const {
      const Eigen::MatrixXd& means = template_;
      if (response.size() != template_.rows())
        throw InvalidArgument(message("response has ", response.size(), " features, the templates ", template_.rows()));
      return decoding_of((means.colwise() - response).colwise().squaredNorm().transpose() * (-0.5 / variance_));
    }
    const Eigen::MatrixXd& templates() const { return template_; }

   private:
    Eigen::MatrixXd template_;
    double variance_ = 1.0;
  };

  /// Throws InvalidArgument for data that do not fit together.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    return Model(training);
  }
};

static_assert(Decoder<NearestTemplate>);

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

// ---- lumo/sense/hand/hand_observer.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_HAND_HAND_OBSERVER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_HAND_HAND_OBSERVER_HPP

namespace lumo::sense {

/// A place of a link where the light has changed.
struct HandContact {
  int link = 0;                 ///< number in the hand
  double y_m = 0.0, z_m = 0.0;  ///< centroid, weighted by the residual
  double y_low_m = 0.0, y_high_m = 0.0;
  double peak_DN = 0.0;  ///< largest residual
  double mean_DN = 0.0;  ///< over the region
  double area_m2 = 0.0;
  Eigen::Vector2d pixel{0.0, 0.0};         ///< of the centroid
  std::vector<std::pair<int, int>> cells;  ///< of HandObserver's grid, along and across
};

/// Contacts on a hand by one frame.
struct HandEstimate {
  std::int64_t stamp_ns = 0;
  std::vector<bool> seen;             ///< by link: its holes were found and a reference is there
  std::vector<int> reference;         ///< by link: number of the reference it was compared with, −1: none
  std::vector<LinkMap> map;           ///< by link; where it was seen last
  std::vector<HandContact> contacts;  ///< link by link, from proximal to distal
};

/// Contacts on several links at once, without labels (paper, integrated hand). Each link is found by its mounting holes
/// and compared with the unloaded picture of the nearest joint configuration. Global and slow differences of green are
/// removed. Connected regions whose residual stands above the noise are contacts.
class HandObserver {
 public:
  struct Config {
    double cell_m = 1.0_mm;  ///< of the grid on which a link's side is read
    double threshold = 6.0;  ///< a region must reach so many noises
    double edge = 3.0;       ///< and extends down to so many
    double noise_floor_DN = 1.0;
    double min_area_m2 = 6e-6;
    double max_joint_step_rad = 0.35;  ///< a reference farther away does not count
    HoleSearch holes;
  };

  /// `first`: about where each link is in the first picture. Throws InvalidArgument.
  HandObserver(std::vector<HandLink> links, std::vector<LinkMap> first, Config config)
      : links_(std::move(links)), last_(std::move(first)), config_(std::move(config)) {
    if (links_.empty() || last_.size() != links_.size())
      throw InvalidArgument(message(
          "hand has ", links_.size(), " links and ", last_.size(), " first places, must have as many, at least 1"));
    for (const HandLink& l : links_) validate(l);
    require_in_range("cell of the hand's grid", 1e3 * config_.cell_m, 0.1, 10.0, "mm");
    require_in_range("edge of a region", config_.edge, 0.0, config_.threshold, "noises");
    require_positive("noise floor", config_.noise_floor_DN, "DN");
    library_.resize(links_.size());
    steps_.resize(links_.size());
    noise_.resize(links_.size());
    for (const HandLink& l : links_) {
      const auto cells = [&](double low, double high) {
        return std::max(1, int(std::lround((high - low) / config_.cell_m)));
      };
      grid_.push_back({cells(l.y_low_m, l.y_high_m), cells(l.z_low_m, l.z_high_m)});
      require_in_range("cells of a link's grid", double(grid_.back().along) * grid_.back().across, 1, 20000, "");
    }
  }

  const std::vector<HandLink>& links() const { return links_; }
  const Config& config() const { return config_; }
  int references(int link) const { return int(library_[std::size_t(link)].size()); }
  /// Of a cell, along and across the link.
  std::pair<double, double> cell_m(int link) const {
    const HandLink& l = links_[std::size_t(link)];
    const auto& g = grid_[std::size_t(link)];
    return {(l.y_high_m - l.y_low_m) / g.along, (l.z_high_m - l.z_low_m) / g.across};
  }
  /// Middle of a cell in the link's plane [m].
  std::pair<double, double> place(int link, int along, int across) const {
    const HandLink& l = links_[std::size_t(link)];
    const auto [length, height] = cell_m(link);
    return {l.y_low_m + (along + 0.5) * length, l.z_low_m + (across + 0.5) * height};
  }

  /// Adds a picture of the unloaded hand to the references of each link that is seen; how many were.
  int add_reference(const JointVector& joints, const ImageView& image);

  /// Causal: the estimate depends on this frame, the references, and earlier places of the links.
  HandEstimate observe(std::int64_t stamp_ns, const JointVector& joints, const ImageView& image);
  /// The estimate without a picture or joints.
  HandEstimate unseen(std::int64_t stamp_ns) const {
    return {stamp_ns, std::vector<bool>(links_.size(), false), std::vector<int>(links_.size(), -1), last_, {}};
  }

 private:
  using Grid = Eigen::MatrixXd;  ///< along × across [DN]
  struct Cells {
    int along, across;
  };
  struct Reference {
    std::vector<double> joints;
    LinkMap map;
    Grid green;
  };

  std::vector<double> joints_of(int link, const JointVector& all) const;
  std::pair<int, double> nearest(int link, const std::vector<double>& joints) const;
  std::optional<LinkMap> find(int link, int nearest, const ImageView& image);
  Grid read(int link, const LinkMap& map, const ImageView& image) const;
  Grid levelled(const Grid& difference) const;
  const Grid& noise(int link);
  void regions(
      int link, const Grid& residual, const Grid& sigma, const LinkMap& map, std::vector<HandContact>& contacts) const;

  std::vector<HandLink> links_;
  std::vector<LinkMap> last_;
  Config config_;
  std::vector<Cells> grid_;
  std::vector<std::vector<Reference>> library_;  ///< by link
  /// By link: absolute differences between each reference and its nearest one before.
  std::vector<std::vector<Grid>> steps_;
  std::vector<Grid> noise_;  ///< by link; empty if references were added since
};

inline std::vector<double> HandObserver::joints_of(int link, const JointVector& all) const {
  std::vector<double> own;
  for (const int j : links_[std::size_t(link)].joints) {
    if (j < 0 || j >= all.size())
      throw InvalidArgument(message(
          "link '", printable(links_[std::size_t(link)].name), "' needs joint ", j, ", samples have ", all.size()));
    if (!std::isfinite(all[j])) throw InvalidArgument("positions of joints must be finite");
    own.push_back(all[j]);
  }
  return own;
}

/// Number and distance [rad] of the reference whose farthest joint is nearest; −1 without any.
inline std::pair<int, double> HandObserver::nearest(int link, const std::vector<double>& joints) const {
  std::pair<int, double> best{-1, std::numeric_limits<double>::infinity()};
  const auto& all = library_[std::size_t(link)];
  for (std::size_t r = 0; r < all.size(); ++r) {
    double apart = 0.0;
    for (std::size_t k = 0; k < joints.size(); ++k) apart = std::max(apart, std::abs(joints[k] - all[r].joints[k]));
    if (apart < best.second) best = {int(r), apart};
  }
  return best;
}

/// Searches about the link's last place and about its place at the nearest reference; takes the one whose holes stand
/// out more.
inline auto HandObserver::find(int link, int nearest, const ImageView& image) -> std::optional<LinkMap> {
  const HandLink& l = links_[std::size_t(link)];
  auto found = register_link(image, l, last_[std::size_t(link)], config_.holes);
  if (nearest >= 0) {
    const auto other = register_link(image, l, library_[std::size_t(link)][std::size_t(nearest)].map, config_.holes);
    if (other && (!found || other->contrast_DN > found->contrast_DN)) found = other;
  }
  if (found) last_[std::size_t(link)] = *found;
  return found;
}

/// Green at the cells' middles, bilinear; NaN outside the image.
inline auto HandObserver::read(int link, const LinkMap& map, const ImageView& image) const -> Grid {
  const auto [along, across] = grid_[std::size_t(link)];
  Eigen::MatrixXd g(along, across);
  for (int i = 0; i < along; ++i)
    for (int j = 0; j < across; ++j) {
      const auto [y, z] = place(link, i, j);
      const auto p = map.pixel(y, z);
      const int x0 = int(std::floor(p.x())), y0 = int(std::floor(p.y()));
      if (x0 < 0 || y0 < 0 || x0 + 1 >= image.width || y0 + 1 >= image.height) {
        g(i, j) = std::numeric_limits<double>::quiet_NaN();
        continue;
      }
      const double u = p.x() - x0, v = p.y() - y0;
      g(i, j) = (1 - v) * ((1 - u) * image.green(x0, y0) + u * image.green(x0 + 1, y0)) +
                v * ((1 - u) * image.green(x0, y0 + 1) + u * image.green(x0 + 1, y0 + 1));
    }
  return g;
}

/// Removes the slow part along the link: the straight line through the means across that passes closest to two fifths
/// of them, since contacts may cover more than half of a link. Least quantile of squares (after Rousseeuw 1984) over
/// all pairs of means, then least squares over those near it.
inline auto HandObserver::levelled(const Grid& difference) const -> Grid {
  std::vector<std::array<double, 2>> mean;  // row and mean, of rows that are seen
  for (Eigen::Index i = 0; i < difference.rows(); ++i) {
    double sum = 0.0;
    int count = 0;
    for (Eigen::Index j = 0; j < difference.cols(); ++j)
      if (std::isfinite(difference(i, j))) {
        sum += difference(i, j);
        ++count;
      }
    if (count > 0) mean.push_back({double(i), sum / count});
  }
  double level = mean.empty() ? 0.0 : mean[0][1], slope = 0.0, least = std::numeric_limits<double>::infinity();
  constexpr double inliers = 3.0;  // distances of the quantile that count as near the line
  const std::size_t part = 2 * mean.size() / 5;
  std::vector<double> off(mean.size());
  const auto offs = [&] {
    for (std::size_t k = 0; k < mean.size(); ++k) off[k] = std::abs(mean[k][1] - level - slope * mean[k][0]);
  };
  std::array<double, 2> best{level, slope};
  for (std::size_t a = 0; a < mean.size(); ++a)
    for (std::size_t b = a + 1; b < mean.size(); ++b) {
      slope = (mean[b][1] - mean[a][1]) / (mean[b][0] - mean[a][0]);
      level = mean[a][1] - slope * mean[a][0];
      offs();
      std::nth_element(off.begin(), off.begin() + std::ptrdiff_t(part), off.end());
      if (off[part] < least) {
        least = off[part];
        best = {level, slope};
      }
    }
  level = best[0];
  slope = best[1];
  offs();
  double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
  for (std::size_t k = 0; k < mean.size(); ++k) {
    if (off[k] > inliers * least) continue;
    n += 1.0;
    x += mean[k][0];
    y += mean[k][1];
    xx += mean[k][0] * mean[k][0];
    xy += mean[k][0] * mean[k][1];
  }
  if (const double spread = n * xx - x * x; spread > 0.0) {
    slope = (n * xy - x * y) / spread;
    level = (y - slope * x) / n;
  }
  Eigen::MatrixXd rest = difference;
  for (Eigen::Index i = 0; i < rest.rows(); ++i) rest.row(i).array() -= level + slope * double(i);
  return rest;
}

inline int HandObserver::add_reference(const JointVector& joints, const ImageView& image) {
  int count = 0;
  for (int l = 0; l < int(links_.size()); ++l) {
    const std::vector<double> own = joints_of(l, joints);
    const auto near = nearest(l, own);
    const auto map = find(l, near.first, image);
    if (!map) continue;
    const Grid green = read(l, *map, image);
    auto& all = library_[std::size_t(l)];
    if (near.first >= 0 && near.second <= config_.max_joint_step_rad) {
      steps_[std::size_t(l)].push_back(levelled(green - all[std::size_t(near.first)].green).cwiseAbs());
      noise_[std::size_t(l)].resize(0, 0);
    }
    all.push_back({own, *map, green});
    ++count;
  }
  return count;
}

/// Noise of each cell: the 90 % quantile of the references' differences, as the standard deviation of a normal number.
/// Beside an LED, where a fraction of a pixel counts, it is several times that of the plain side.
inline auto HandObserver::noise(int link) -> const Grid& {
  Eigen::MatrixXd& sigma = noise_[std::size_t(link)];
  if (sigma.size() > 0) return sigma;
  constexpr double share = 0.9, share_sigmas = 1.645;  // a normal number's absolute value stays below so many with it
  const auto [along, across] = grid_[std::size_t(link)];
  sigma = Eigen::MatrixXd::Constant(along, across, config_.noise_floor_DN);
  for (Eigen::Index k = 0; k < sigma.size(); ++k) {
    std::vector<double> size;
    for (const Grid& step : steps_[std::size_t(link)])
      if (std::isfinite(step.data()[k])) size.push_back(step.data()[k]);
    if (!size.empty()) sigma.data()[k] = std::max(config_.noise_floor_DN, quantile(size, share) / share_sigmas);
  }
  return sigma;
}

inline auto HandObserver::observe(std::int64_t stamp_ns, const JointVector& joints, const ImageView& image)
    -> HandEstimate {
  HandEstimate e{stamp_ns, {}, {}, {}, {}};
  for (int l = 0; l < int(links_.size()); ++l) {
    const std::vector<double> own = joints_of(l, joints);
    const auto near = nearest(l, own);
    const auto map = find(l, near.first, image);
    const bool known = map && near.first >= 0 && near.second <= config_.max_joint_step_rad;
    e.seen.push_back(known);
    e.reference.push_back(known ? near.first : -1);
    e.map.push_back(last_[std::size_t(l)]);
    if (known)
      regions(l, levelled(read(l, *map, image) - library_[std::size_t(l)][std::size_t(near.first)].green), noise(l),
          *map, e.contacts);
  }
  return e;
}

inline void HandObserver::regions(
    int link, const Grid& residual, const Grid& sigma, const LinkMap& map, std::vector<HandContact>& contacts) const {
  const auto [along, across] = grid_[std::size_t(link)];
  const auto [cell_length, cell_height] = cell_m(link);
  std::vector<bool> taken(std::size_t(along) * std::size_t(across), false);
  const auto index = [&, n = across](int i, int j) { return std::size_t(i) * std::size_t(n) + std::size_t(j); };
  const auto strong = [&](int i, int j) {
    return std::abs(residual(i, j)) > config_.edge * sigma(i, j);
  };  // false for NaN
  for (int i = 0; i < along; ++i)
    for (int j = 0; j < across; ++j) {
      if (taken[index(i, j)] || !strong(i, j)) continue;
      HandContact c;
      c.link = link;
      c.y_low_m = std::numeric_limits<double>::infinity();
      c.y_high_m = -c.y_low_m;
      c.cells.emplace_back(i, j);
      taken[index(i, j)] = true;
      double weight = 0.0, noises = 0.0;
      for (std::size_t k = 0; k < c.cells.size(); ++k) {
        const auto [a, b] = c.cells[k];
        const auto [y, z] = place(link, a, b);
        const double r = std::abs(residual(a, b));
        weight += r;
        c.y_m += r * y;
        c.z_m += r * z;
        c.peak_DN = std::max(c.peak_DN, r);
        noises = std::max(noises, r / sigma(a, b));
        c.y_low_m = std::min(c.y_low_m, y);
        c.y_high_m = std::max(c.y_high_m, y);
        for (int di = -1; di <= 1; ++di)
          for (int dj = -1; dj <= 1; ++dj) {
            const int p = a + di, q = b + dj;
            if (p < 0 || q < 0 || p >= along || q >= across || taken[index(p, q)] || !strong(p, q)) continue;
            taken[index(p, q)] = true;
            c.cells.emplace_back(p, q);
          }
      }
      c.area_m2 = cell_length * cell_height * double(c.cells.size());
      if (noises < config_.threshold || c.area_m2 < config_.min_area_m2) continue;
      c.y_m /= weight;
      c.z_m /= weight;
      c.mean_DN = weight / double(c.cells.size());
      c.pixel = map.pixel(c.y_m, c.z_m);
      std::sort(c.cells.begin(), c.cells.end());
      contacts.push_back(std::move(c));
    }
}

}  // namespace lumo::sense

#endif

// ---- lumo/sense/hand/hand_log.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_HAND_HAND_LOG_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_HAND_HAND_LOG_HPP

namespace lumo::sense {

/// The observer of the hand that a log's session describes. Throws InvalidArgument without a hand.
inline HandObserver hand_observer(const Session& session, HandObserver::Config config = {}) {
  std::vector<HandLink> links;
  std::vector<LinkMap> first;
  for (const SessionLink& l : session.links) {
    links.push_back(l.link);
    first.push_back(LinkMap::fit(l.link.hole_m, l.hole_px, l.link.z_clockwise));
  }
  return {std::move(links), std::move(first), std::move(config)};
}

/// Positions of all joints over time, on the frames' clock, delay taken off. Throws InvalidArgument for samples of
/// different size or order.
inline TimeSeries joint_positions(std::span<const JointSample> samples, const Session& session) {
  std::vector<std::int64_t> stamp;
  Eigen::MatrixXd position(samples.empty() ? 0 : samples.front().position_rad.size(), Eigen::Index(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const JointSample& s = samples[i];
    if (s.position_rad.size() != position.rows())
      throw InvalidArgument(
          message("joint sample ", i, " has ", s.position_rad.size(), " joints, the first one has ", position.rows()));
    stamp.push_back(session.joint_clock(s.stamp_ns) - std::llround(1e9 * session.joint_delay_s));
    position.col(Eigen::Index(i)) = s.position_rad;
  }
  return {std::move(stamp), std::move(position)};
}

/// Whether a segment states that nothing touches the hand then.
inline bool is_unloaded(const Session& session, std::int64_t stamp_ns) {
  return std::any_of(session.segments.begin(), session.segments.end(), [&](const Segment& s) {
    return (s.kind == SegmentKind::free || s.kind == SegmentKind::unloaded) && s.holds(stamp_ns);
  });
}

/// Plays a log to a hand's observer, frame by frame. `each(estimate, image)` gets a std::optional<HandEstimate>:
/// nullopt if the frame lies in a segment of kind `free` or `unloaded` and becomes a reference. No link is seen while
/// the joints are unknown, between samples more than `max_gap_s` apart. Returns the number of references.
template <Camera C, class Each> int observe_hand(C& camera, HandObserver& hand, const TimeSeries& positions,
    const Session& session, Each each, double max_gap_s = 0.1) {
  int references = 0;
  for (auto frame = camera.next(); frame; frame = camera.next()) {
    const auto joints = positions.at(frame->stamp_ns - std::llround(1e9 * session.frame_delay_s), max_gap_s);
    std::optional<HandEstimate> estimate;
    if (is_unloaded(session, frame->stamp_ns)) references += joints && hand.add_reference(*joints, frame->image) > 0;
    else estimate = joints ? hand.observe(frame->stamp_ns, *joints, frame->image) : hand.unseen(frame->stamp_ns);
    each(estimate, frame->image);
  }
  return references;
}

/// Shows a hand's observer only a log's pictures of the unloaded hand. Returns the number of references.
template <Camera C> int add_references(
    C& camera, HandObserver& hand, const TimeSeries& positions, const Session& session, double max_gap_s = 0.1) {
  int references = 0;
  for (auto frame = camera.next(); frame; frame = camera.next())
    if (is_unloaded(session, frame->stamp_ns))
      if (const auto joints = positions.at(frame->stamp_ns - std::llround(1e9 * session.frame_delay_s), max_gap_s))
        references += hand.add_reference(*joints, frame->image) > 0;
  return references;
}

/// True contacts on a hand, frame by frame, by a lab's truth.csv: stamp_ns, link, y_mm, force_N, one row for each
/// contact of a frame. Estimators do not read it.
class HandTouches {
 public:
  struct Touch {
    int link;
    double y_m, force_N;
  };

  /// Throws InputError.
  static HandTouches from_table(std::istream& in, const std::string& name) {
    CsvReader csv(in, name);
    const int stamp = csv.require("stamp_ns"), link = csv.require("link"), y = csv.require("y_mm"),
              force = csv.require("force_N");
    HandTouches t;
    while (csv.next()) {
      const std::int64_t number = csv.integer(link);
      const double y_m = 1e-3 * csv.number(y);
      if (number < 0 || number > 15) csv.fail(link, "must lie in [0, 15]");
      if (std::abs(y_m) > 10.0) csv.fail(y, "must lie within 10000 mm");
      t.rows_.push_back({csv.integer(stamp), {int(number), y_m, csv.number(force)}});
    }
    std::stable_sort(t.rows_.begin(), t.rows_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    return t;
  }
  std::vector<Touch> at(std::int64_t stamp_ns) const {
    std::vector<Touch> touches;
    for (auto row = std::lower_bound(
             rows_.begin(), rows_.end(), stamp_ns, [](const auto&r, std::int64_t t) { return r.first < t; });
         row != rows_.end() && row->first == stamp_ns; ++row)
      touches.push_back(row->second);
    return touches;
  }

 private:
  std::vector<std::pair<std::int64_t, Touch>> rows_;
};

/// How well a hand's contacts agree with the truth.
struct HandScore {
  int touches = 0;     ///< in all frames, of at least the least force
  int found = 0;       ///< of them, those with a contact on their link within 8 mm, `near_m`
  double mae_m = 0.0;  ///< along the link, over those found
  int contacts = 0;    ///< in all estimates
  int unfounded = 0;   ///< of them, those with no touch, however weak, so near on their link

  static constexpr double near_m = 8.0_mm;

  /// One frame.
  void add(const HandEstimate& e, const std::vector<HandTouches::Touch>& truth, double least_N = 5.0) {
    for (const auto& t : truth) {
      if (t.force_N < least_N) continue;
      ++touches;
      double off = near_m;
      bool hit = false;
      for (const HandContact& c : e.contacts)
        if (c.link == t.link && std::abs(c.y_m - t.y_m) <= off) {
          off = std::abs(c.y_m - t.y_m);
          hit = true;
        }
      if (hit) mae_m += (off - mae_m) / double(++found);
    }
    for (const HandContact& c : e.contacts) {
      ++contacts;
      unfounded += std::none_of(truth.begin(), truth.end(),
          [&](const auto& t) { return t.link == c.link && std::abs(c.y_m - t.y_m) <= near_m; });
    }
  }
};

}  // namespace lumo::sense

#endif

// ---- lumo/sense/live/live.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LIVE_LIVE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LIVE_LIVE_HPP

namespace lumo::sense {

/// How live streams are waited for.
struct LiveWait {
  std::string name = "camera";           ///< of the camera, before messages
  double rest_s = 1.0;                   ///< how long the finger rests unloaded at the start
  double patience_s = 2.0;               ///< without any picture
  double max_gap_s = 0.1;                ///< of joint samples about a picture of a hand
  std::int64_t (*now_ns)() = steady_ns;  ///< now, on the clock of the stamps
};

/// Throws InvalidArgument.
inline void validate(const LiveWait& w) {
  require_in_range("time that the finger rests", w.rest_s, 0.05, 60.0, "s");
  require_positive("patience with the camera", w.patience_s, "s");
}

namespace detail {

constexpr double pause_s = 200e-6;          ///< between looks at a silent camera: far below a picture's period
constexpr std::size_t most_at_rest = 300;   ///< pictures whose copies are kept while a finger rests
constexpr double shortest_period_s = 1e-4;  ///< of pictures: stamps closer than that are a driver's fault
constexpr double report_patience = 0.1;     ///< of LiveWait::patience_s, then a state without a picture is reported
constexpr std::size_t most_recent = 4096;   ///< joint samples kept about a picture: 4 s at 1 kHz

/// Empties a stream: what queued up before is not of this time.
template <class Stream> void discard_backlog(Stream& stream) {
  while (stream.next()) {
  }
}

}  // namespace detail

/// The next picture; nullopt when the camera has ended. `meanwhile()` is called while none is there. Throws InputError
/// where none comes in time.
template <Camera C, class Meanwhile>
std::optional<Frame> next_picture(C& camera, const LiveWait& w, Meanwhile meanwhile) {
  const std::int64_t from = w.now_ns();
  auto frame = camera.next();
  while (!frame && camera.state() == StreamState::open) {
    if (1e-9 * double(w.now_ns() - from) > w.patience_s)
      throw InputError(message(w.name, ": has given no picture for ", w.patience_s, " s"));
    meanwhile();
    pause_for(detail::pause_s);
    frame = camera.next();
  }
  return frame;
}

/// What the first pictures of a live camera show of a finger that nothing touches.
struct LiveRest {
  FingerOptics optics;
  FrameMonitor::Config trusted;  ///< pictures like those
  std::optional<Frame> next;     ///< the first one after the rest; its pixels are the camera's
};

/// Looks at the finger for `wait.rest_s`; `meanwhile()` is called while no picture is there. View and light of `finger`
/// are replaced by what is seen. Throws InputError where no finger is seen or no picture comes for `wait.patience_s`.
template <Camera C, class Meanwhile> LiveRest look_at_rest(
    C& camera, const Session& session, const FingerOptics& finger, const LiveWait& wait, Meanwhile meanwhile) {
  validate(wait);
  MeanImage mean;
  std::vector<Image> kept;  // a camera's own pixels are gone with its next picture
  std::vector<Frame> rest;
  auto frame = next_picture(camera, wait, meanwhile);
  const std::int64_t first = frame ? frame->stamp_ns : 0, from = wait.now_ns();
  for (; frame && 1e-9 * double(frame->stamp_ns - first) <= wait.rest_s &&
         1e-9 * double(wait.now_ns() - from) <= wait.rest_s + wait.patience_s;
       frame = next_picture(camera, wait, meanwhile)) {
    const ImageView& v = frame->image;
    if (v.empty() || rest.size() >= detail::most_at_rest) continue;
    mean.add(v);
    kept.push_back(Image::copy(v));
    rest.push_back(*frame);
  }
  if (rest.empty()) throw InputError(message(wait.name, ": gives no pictures"));
  LiveRest seen{finger, {}, frame};
  seen.optics.view = view_finger(mean.image().view(), session, wait.name);
  GreenProfile readout = seen.optics.readout();
  RepeatedPixels repeated;
  std::vector<Profile> profiles(rest.size());
  std::vector<const Profile*> read;
  for (std::size_t k = 0; k < rest.size(); ++k) {
    rest[k].image = kept[k].view();
    repeated.add(rest[k].image);
    if (readout.read(rest[k], profiles[k])) read.push_back(&profiles[k]);
  }
  seen.optics.view.unchanged = repeated.share();
  seen.optics.unloaded = checked_reference(read, seen.optics.view.repeats(seen.optics.bins)).reference;
  const UnloadedReference& unloaded = seen.optics.unloaded;
  if (unloaded.count() < 2)
    throw InputError(
        message(wait.name, ": ", unloaded.count(), " pictures of the unloaded finger can be read, must be at least 2"));
  seen.trusted.position_m = readout.positions_m();
  seen.trusted.unloaded = unloaded.mean();
  if (rest.size() > 1)
    seen.trusted.period_s = std::max(detail::shortest_period_s,
        1e-9 * double(rest.back().stamp_ns - rest.front().stamp_ns) / double(rest.size() - 1));
  seen.trusted.exposure_s = rest.front().exposure_s;
  seen.trusted.gain = rest.front().gain;
  seen.trusted.led_m.clear();
  for (int k = 0; k < session.led_count; ++k)
    seen.trusted.led_m.push_back(session.led_first_y_m + k * session.led_pitch_m);
  return seen;
}

/// Where a finger is touched, as its camera's pictures come. The pictures of the first `wait.rest_s` seconds must show
/// it unloaded. `make(optics)` gives the localiser. `report(stamp_ns, estimate, faults)` is called for each later
/// picture, without an estimate where FrameMonitor does not trust it, and returns whether to go on. Ends with the
/// camera. Throws as look_at_rest, and where no picture comes for `wait.patience_s`.
template <Camera C, ContactJacobian J, class MakeLocalizer, class Report> void locate_live(
    C& camera, const FingerModel<J>& finger, MakeLocalizer make, Report report, const LiveWait& wait = {}) {
  LiveRest rest = look_at_rest(camera, finger.session, finger.optics, wait, [] {});
  GreenProfile readout = rest.optics.readout();
  FrameMonitor monitor(rest.trusted);
  auto localizer = make(rest.optics);
  Profile p;
  for (auto frame = rest.next; frame; frame = next_picture(camera, wait, [] {})) {
    std::optional<LocationEstimate> estimate;
    auto verdict = monitor.check_time(frame->stamp_ns, frame->stamp_ns);
    if (verdict.usable) {
      const Faults time = verdict.faults;
      if (!readout.read(*frame, p)) verdict = FrameMonitor::reject(Fault::frame_corrupt);
      else verdict = monitor.check_light(p, frame->exposure_s, frame->gain);
      verdict.faults |= time;
    }
    if (verdict.usable) {
      rest.optics.unloaded.subtract(p);
      estimate = localizer.update(p);
    }
    if (!report(frame->stamp_ns, estimate, verdict.faults)) break;
  }
}

/// Where a finger is touched and how hard, as its camera's pictures and its motors' samples come. Both are stamped on
/// the clock of `wait.now_ns`. The first `wait.rest_s` seconds must be without contact, as for locate_live;
/// `finger.joints` is from an earlier run without contact (identify_joints). `report(estimate)` is called for each
/// usable picture, and every tenth of `wait.patience_s` where none comes, and returns whether to go on: lost pictures
/// and samples are states of the estimate, not the end. Ends when camera and motors have. Throws as look_at_rest, and
/// InputError where the motors are silent during the rest.
template <Camera C, Actuator A, ContactJacobian J, class MakeLocalizer, class Report> void estimate_live(
    C& camera, A& actuator, FingerModel<J> finger, MakeLocalizer make, Report report, const LiveWait& wait = {}) {
  std::int64_t samples = 0, first = 0, last = 0;
  StreamRates rates;
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next()) {
      if (s->effort.size() != Eigen::Index(finger.joints.torque.size()))
        throw InputError(message("the motors give ", s->effort.size(), " joints, the run without contact has ",
            finger.joints.torque.size()));
      if (samples++ == 0) first = s->stamp_ns;
      last = s->stamp_ns;
      rates.unit = s->unit;
    }
  };
  detail::discard_backlog(actuator);
  LiveRest rest = look_at_rest(camera, finger.session, finger.optics, wait, drain);
  drain();
  if (samples < 2 || last <= first)
    throw InputError(
        message("the motors: ", samples, " samples came while the finger rested; does something command them?"));
  finger.optics = std::move(rest.optics);
  rates.joint_period_s = 1e-9 * double(last - first) / double(samples - 1);
  rates.frame_period_s = rest.trusted.period_s;
  auto localizer = make(finger.optics);
  ForceEstimatorConfig config = force_config(finger, rates);
  config.frames = std::move(rest.trusted);
  using Estimator = ForceEstimator<C, A, decltype(localizer), GreenProfile, J>;
  Estimator estimator(camera, actuator, {finger.optics.readout(), finger.optics.unloaded}, std::move(localizer),
      finger.jacobian, std::move(config));
  std::int64_t picture = estimator.step(wait.now_ns()).frame_stamp_ns, reported = wait.now_ns();
  while (camera.state() == StreamState::open || actuator.state() == StreamState::open) {
    const ForceEstimate e = estimator.step(wait.now_ns());
    const bool is_new = e.frame_stamp_ns != picture,
               overdue = 1e-9 * double(wait.now_ns() - reported) > detail::report_patience * wait.patience_s;
    if (!is_new && !overdue) {
      pause_for(detail::pause_s);
      continue;
    }
    picture = e.frame_stamp_ns;
    reported = wait.now_ns();
    if (!report(e)) return;
  }
}

/// Contacts on a hand as pictures and joint samples come, both stamped on one clock; `hand` has its references
/// (add_references). `report(estimate, image)` is called for each picture and returns whether to go on; no link is seen
/// in pictures for which the joints are not known. Ends with the camera. Throws InputError where no picture comes for
/// `wait.patience_s`.
template <Camera C, Actuator A, class Report> void observe_hand_live(
    C& camera, A& actuator, HandObserver& hand, const Session& session, Report report, const LiveWait& wait = {}) {
  validate(wait);
  Session one_clock = session;
  one_clock.joint_clock = {};
  std::vector<JointSample> recent;
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next())
      if (recent.empty() ||
          (s->stamp_ns > recent.back().stamp_ns && s->position_rad.size() == recent.back().position_rad.size()))
        recent.push_back(std::move(*s));
    if (recent.size() > detail::most_recent) recent.erase(recent.begin(), recent.end() - detail::most_recent / 2);
  };
  detail::discard_backlog(actuator);
  for (auto frame = next_picture(camera, wait, drain); frame; frame = next_picture(camera, wait, drain)) {
    drain();
    const TimeSeries positions = joint_positions(std::span<const JointSample>(recent), one_clock);
    const std::int64_t at = frame->stamp_ns - std::llround(1e9 * session.frame_delay_s);
    auto joints = positions.at(at, wait.max_gap_s);
    if (!joints && !recent.empty())  // the newest sample may be a little older than the picture
      if (const double age_s = 1e-9 * double(at - recent.back().stamp_ns) + session.joint_delay_s;
          age_s >= 0.0 && age_s <= wait.max_gap_s)
        joints = recent.back().position_rad;
    if (!report(
            joints ? hand.observe(frame->stamp_ns, *joints, frame->image) : hand.unseen(frame->stamp_ns), frame->image))
      return;
  }
}

}  // namespace lumo::sense

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

// ---- lumo/sense/live/log_recorder.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_LIVE_LOG_RECORDER_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_LIVE_LOG_RECORDER_HPP

namespace lumo::sense {

/// Writes a log's folder while it happens: pictures by a thread of its own, tables row by row, so that what was taken
/// is there when the program or the power ends. Stamps count from the first picture's. What comes before it or goes
/// back in time is left out and counted, as are samples that the motor's range has cut off. `encode(ImageView)` gives
/// the bytes of an image file, a std::vector<std::uint8_t>; the recorder's thread calls it.
template <class Encode> class LogRecorder {
 public:
  static constexpr std::size_t most_waiting = 64;        ///< pictures that the disk is behind; more are left out
  static constexpr std::size_t most_unflushed = 16384;   ///< bytes of joint rows that a crash may lose
  static constexpr std::int64_t flush_ns = 200'000'000;  ///< the same in time

  /// `folder` and `folder`/frames are there. `session_json` is written as it is. Throws InputError.
  LogRecorder(std::string folder, std::string_view session_json, Encode encode)
      : folder_(std::move(folder)), encode_(std::move(encode)) {
    write_whole(folder_ + "/session.json", session_json);
    open(frames_, "frames.csv");
    append(frames_, frame_header(false), "frames.csv");
    writer_ = std::thread([this] { write(); });
  }
  ~LogRecorder() {
    try {
      finish();
    } catch (const Error&) {
    }
  }
  LogRecorder(const LogRecorder&) = delete;
  LogRecorder& operator=(const LogRecorder&) = delete;

  /// Copies the picture. Throws InputError where an earlier one could not be written.
  void add(const Frame& f) {
    if (!begin_) begin_ = f.stamp_ns;
    const std::int64_t stamp = f.stamp_ns - *begin_;
    std::unique_lock lock(mutex_);
    if (!fault_.empty()) throw InputError(fault_);
    if (waiting_.size() >= most_waiting || f.image.empty() || (last_frame_ && stamp <= *last_frame_))
      return void(++lost_frames_);
    lock.unlock();
    Image copy = Image::copy(f.image);
    lock.lock();
    last_frame_ = stamp;
    waiting_.push_back({{stamp, frame_file(count_++), f.exposure_s, f.gain}, std::move(copy)});
    there_.notify_one();
  }

  /// Throws InputError where it cannot be written, or joints or kind of effort change.
  void add(const JointSample& s) {
    if (!begin_ || s.stamp_ns < *begin_ || s.saturated || !s.effort.allFinite() || !s.position_rad.allFinite() ||
        !s.velocity_rad_per_s.allFinite())
      return void(++lost_samples_);
    JointSample shifted = s;
    shifted.stamp_ns -= *begin_;
    if (last_joint_ && shifted.stamp_ns <= *last_joint_) return void(++lost_samples_);
    if (samples_ == 0) {
      joints_of_ = s.effort.size();
      unit_ = s.unit;
    }
    if (s.effort.size() != joints_of_ || s.position_rad.size() != joints_of_ ||
        s.velocity_rad_per_s.size() != joints_of_ || s.unit != unit_)
      throw InputError(folder_ + "/joint.csv: the motors have other joints than before");
    if (samples_++ == 0) {
      open(joints_, "joint.csv");
      append(joints_, joint_header(int(joints_of_), unit_), "joint.csv");
    }
    joint_rows_ += joint_row(shifted, last_joint_);
    if (joint_rows_.size() > most_unflushed || shifted.stamp_ns - flushed_ns_ > flush_ns) {
      flushed_ns_ = shifted.stamp_ns;
      flush_joints();
    }
  }

  /// Waits until all is written. Throws InputError.
  void finish() {
    stop();
    if (!joint_rows_.empty()) flush_joints();
    if (!fault_.empty()) throw InputError(fault_);
  }

  std::size_t frames() const { return count_; }
  /// Stamp of the newest picture that was taken, in the log; 0 without any.
  std::int64_t end_ns() const { return last_frame_.value_or(0); }
  std::size_t samples() const { return samples_; }
  std::size_t lost_frames() const { return lost_frames_; }
  std::size_t lost_samples() const { return lost_samples_; }

 private:
  struct Picture {
    FrameRecord record;
    Image image;
  };

  void open(std::ofstream& out, const char* file) const {
    out.open(folder_ + '/' + file, std::ios::binary);
    if (!out) throw InputError(message(folder_, '/', file, ": cannot be written"));
  }
  /// Whole rows at once, so that a table that is cut ends with a row.
  void append(std::ofstream& out, const std::string& rows, const char* file) const {
    out.write(rows.data(), std::streamsize(rows.size())).flush();
    if (!out) throw InputError(message(folder_, '/', file, ": cannot be written"));
  }
  void flush_joints() {
    append(joints_, joint_rows_, "joint.csv");
    joint_rows_.clear();
  }
  void write() {
    std::optional<std::int64_t> last;
    std::unique_lock lock(mutex_);
    while (true) {
      there_.wait(lock, [this] { return stop_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      Picture p = std::move(waiting_.front());
      waiting_.pop_front();
      lock.unlock();
      std::string fault;
      try {
        const auto bytes = encode_(p.image.view());
        write_whole(folder_ + "/frames/" + p.record.file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()},
            Durability::memory);
        append(frames_, frame_row(p.record, false, last), "frames.csv");  // after its picture
      } catch (const std::exception& e) {
        fault = e.what();
      } catch (...) {
        fault = folder_ + "/frames: a picture cannot be encoded";
      }
      lock.lock();
      if (!fault.empty()) {
        fault_ = std::move(fault);
        waiting_.clear();
        return;
      }
    }
  }
  void stop() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    there_.notify_one();
    if (writer_.joinable()) writer_.join();
  }

  std::string folder_;
  Encode encode_;
  std::ofstream frames_, joints_;
  std::string joint_rows_;
  std::optional<std::int64_t> begin_, last_frame_, last_joint_;
  std::int64_t flushed_ns_ = 0;
  Eigen::Index joints_of_ = 0;
  Effort unit_ = Effort::torque_Nm;
  std::size_t count_ = 0, samples_ = 0, lost_frames_ = 0, lost_samples_ = 0;
  std::mutex mutex_;  ///< of what follows
  std::condition_variable there_;
  std::deque<Picture> waiting_;
  std::string fault_;
  bool stop_ = false;
  std::thread writer_;
};

/// Records camera and motors until the camera ends or `going_on(seconds)`, called at each picture with the time since
/// the first, returns false. Throws InputError where no picture comes for `wait.patience_s`.
template <Camera C, Actuator A, class Recorder, class GoingOn>
void record_live(C& camera, A& actuator, Recorder& recorder, GoingOn going_on, const LiveWait& wait = {}) {
  validate(wait);
  const auto drain = [&] {
    for (auto s = actuator.next(); s; s = actuator.next()) recorder.add(*s);
  };
  auto frame = next_picture(camera, wait, drain);
  if (!frame) throw InputError(wait.name + ": gives no pictures");
  for (const std::int64_t first = frame->stamp_ns; frame; frame = next_picture(camera, wait, drain)) {
    if (!going_on(1e-9 * double(frame->stamp_ns - first))) break;
    recorder.add(*frame);
    drain();
  }
}

/// Stands for motors where there are none.
struct NoActuator {
  std::optional<JointSample> next() { return std::nullopt; }
  StreamState state() const { return StreamState::ended; }
};

static_assert(Actuator<NoActuator>);

}  // namespace lumo::sense

#endif

// ---- lumo/sense.hpp
#ifndef SINGLE_INCLUDE_LUMO_SENSE_HPP
#define SINGLE_INCLUDE_LUMO_SENSE_HPP

// The sensing half, in the order in which data flows: devices → recordings → profiles → location → force → decoders →
// hand. Needs Eigen only.

#endif
