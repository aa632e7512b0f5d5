// lumo/lumo.hpp in one file; made by single_include/generate, not to be edited. Needs C++20 and Eigen.
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
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <locale>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <numeric>
#include <optional>
#include <ostream>
#include <queue>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
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

// ---- lumo/core/design_space.hpp
#ifndef SINGLE_INCLUDE_LUMO_CORE_DESIGN_SPACE_HPP
#define SINGLE_INCLUDE_LUMO_CORE_DESIGN_SPACE_HPP

namespace lumo {

/// One design variable: bounds and, when `step` > 0, a lattice of multiples of `step` counted from `origin`.
struct Variable {
  std::string name;
  double lower = 0.0;
  double upper = 1.0;
  double step = 0.0;
  std::string unit;
  double origin = 0.0;

  /// The lattice node nearest to `x`, which may lie outside the bounds.
  double nearest_node(double x) const { return origin + std::round((x - origin) / step) * step; }
  /// Is `x` a node, but for rounding?
  bool on_lattice(double x) const {
    return std::abs(x - nearest_node(x)) <=
           4.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(x), std::abs(origin));
  }
};

/// lower ≤ Σ coefficients · x ≤ upper. Coefficients as many as variables.
struct LinearConstraint {
  std::string name;
  std::vector<double> coefficients;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  std::string unit;

  double sum(std::span<const double> x) const {
    double total = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) total += coefficients[i] * x[i];
    return total;
  }
  /// By how much rounding may have moved the sum: 0.1 + 0.2 must not break a limit of 0.3.
  double rounding(std::span<const double> x) const {
    double size = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) size += std::abs(coefficients[i] * x[i]);
    return 2.0 * std::numeric_limits<double>::epsilon() * size;
  }
};

/// A constraint of any form. Both are called only where bounds, lattice, linear constraints and the rules before hold.
struct DesignRule {
  std::function<bool(std::span<const double>)> holds;
  std::function<InfeasibleDesign(std::span<const double>)> refusal;  ///< what check() throws if it does not hold
};

/// The designs that may be tried, in any number of dimensions: a box or lattice, linear constraints, and further rules.
struct DesignSpace {
  std::vector<Variable> variables;
  std::vector<LinearConstraint> constraints;
  std::vector<DesignRule> rules;

  /// Throws InfeasibleDesign naming the first broken constraint, or InvalidArgument when the number of values is wrong.
  void check(std::span<const double> x) const;

  /// Whether check() would pass. Throws InvalidArgument when the number of values is wrong.
  bool contains(std::span<const double> x) const;
};

inline void DesignSpace::check(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    const std::string unit = v.unit.empty() ? "" : " " + v.unit;
    if (!std::isfinite(x[i]))
      throw InfeasibleDesign(v.name + " finite", x[i], v.upper, v.unit,
          message("infeasible design: ", v.name, " = ", exact(x[i]), unit, ", must lie in [", v.lower, ", ", v.upper,
              "]", unit));
    if (x[i] < v.lower)
      throw InfeasibleDesign(v.name + " lower bound", x[i], v.lower, v.unit,
          message(
              "infeasible design: ", v.name, " = ", exact(x[i]), unit, " is below its lower bound ", v.lower, unit));
    if (x[i] > v.upper)
      throw InfeasibleDesign(v.name + " upper bound", x[i], v.upper, v.unit,
          message(
              "infeasible design: ", v.name, " = ", exact(x[i]), unit, " is above its upper bound ", v.upper, unit));
    if (v.step > 0.0 && !v.on_lattice(x[i]))
      throw InfeasibleDesign(v.name + " lattice", x[i], v.nearest_node(x[i]), v.unit,
          message("infeasible design: ", v.name, " = ", exact(x[i]), unit, " is off the ", v.step, unit,
              " lattice; nearest is ", v.nearest_node(x[i]), unit));
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    const std::string unit = c.unit.empty() ? "" : " " + c.unit;
    if (sum > c.upper + rounding)
      throw InfeasibleDesign(c.name, sum, c.upper, c.unit,
          message("infeasible design: ", c.name, " = ", sum, unit, " exceeds its limit ", c.upper, unit));
    if (sum < c.lower - rounding)
      throw InfeasibleDesign(c.name, sum, c.lower, c.unit,
          message("infeasible design: ", c.name, " = ", sum, unit, " is below its limit ", c.lower, unit));
  }
  for (const DesignRule& r : rules)
    if (!r.holds(x)) throw r.refusal(x);
}

inline bool DesignSpace::contains(std::span<const double> x) const {
  if (x.size() != variables.size())
    throw InvalidArgument(message("design has ", x.size(), " values, the space has ", variables.size(), " variables"));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Variable& v = variables[i];
    if (!(x[i] >= v.lower && x[i] <= v.upper) || (v.step > 0.0 && !v.on_lattice(x[i]))) return false;
  }
  for (const LinearConstraint& c : constraints) {
    const double sum = c.sum(x), rounding = c.rounding(x);
    if (sum > c.upper + rounding || sum < c.lower - rounding) return false;
  }
  return std::all_of(rules.begin(), rules.end(), [&](const DesignRule& r) { return r.holds(x); });
}

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

/// The whole file or none, after a power failure, too: written beside its place under a name that no other writer
/// takes, brought to the disk, then renamed; an older one is replaced. Throws InputError of one line, and leaves what
/// was there.
inline void write_whole(const std::string& path, std::string_view bytes, Durability durability = Durability::disk) {
  // Two programs, or threads, may write the same file at once: the time and a place on the stack make names unique.
  const std::string part = message(path, ".part-", steady_ns(), '-', static_cast<const void*>(&bytes));
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  out.close();
  const bool durable = durability == Durability::disk;
  if (out && (!durable || synchronise(part)) && std::rename(part.c_str(), path.c_str()) == 0) {
    if (durable) synchronise(std::filesystem::absolute(path).parent_path().string());  // the name must last as well
    return;
  }
  const std::string why = std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message();
  std::remove(part.c_str());
  throw InputError(message(path, ": cannot be written: ", why));
}

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

// ---- lumo/geometry/polygon_triangles.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_POLYGON_TRIANGLES_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_POLYGON_TRIANGLES_HPP

namespace lumo {

/// Cuts a flat polygon with holes into triangles that use all of its corners and no others.
/// Each hole is joined to the outline by a bridge to a corner that it sees (Held 2001, section 4), then ears are cut
/// off, the best shaped first. All decisions are exact. Corners on straight edges are allowed.
class PolygonTriangles {
 public:
  using Triangle = std::array<int, 3>;
  using Loop = std::vector<int>;

  PolygonTriangles(const std::vector<Vec3d>& vertices, const Vec3d& normal) {
    const Projection project(normal);
    for (const Vec3d& v : vertices) points_.push_back(project(v));
  }

  /// By vertex numbers; the outline counter-clockwise about the normal, the holes clockwise. nullopt if outline and
  /// holes cross or touch.
  std::optional<std::vector<Triangle>> cut(std::vector<int> outline, std::vector<std::vector<int>> holes) const;

 private:
  const Point2& at(int vertex) const { return points_[std::size_t(vertex)]; }
  int turn(int a, int b, int c) const { return orient2d(at(a), at(b), at(c)); }
  bool crosses(int a, int b, const std::vector<int>& loop) const;
  bool opens_to(const std::vector<int>& loop, std::size_t corner, int to) const;
  bool bridge(Loop& loop, const std::vector<int>& hole, const std::vector<std::vector<int>>& others) const;
  double shape_of_ear(const std::vector<int>& loop, std::size_t corner) const;

  std::vector<Point2> points_;
};

/// Whether the segment a b meets an edge of the loop that does not end in a or b.
inline bool PolygonTriangles::crosses(int a, int b, const std::vector<int>& loop) const {
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const int p = loop[i], q = loop[(i + 1) % loop.size()];
    const bool shared = p == a || p == b || q == a || q == b;
    if (!shared && segments_meet(at(a), at(b), at(p), at(q))) return true;
  }
  return false;
}

/// Whether `to` is seen from the inside of the loop's corner: bridges make a vertex a corner more than once.
inline bool PolygonTriangles::opens_to(const std::vector<int>& loop, std::size_t corner, int to) const {
  const int before = loop[(corner + loop.size() - 1) % loop.size()], here = loop[corner],
            after = loop[(corner + 1) % loop.size()];
  const bool left_of_in = turn(before, here, to) > 0, left_of_out = turn(here, after, to) > 0;
  return turn(before, here, after) > 0 ? left_of_in && left_of_out : left_of_in || left_of_out;
}

inline bool PolygonTriangles::bridge(
    Loop& loop, const std::vector<int>& hole, const std::vector<std::vector<int>>& others) const {
  const auto start = std::size_t(
      std::max_element(hole.begin(), hole.end(), [&](int p, int q) { return at(p) < at(q); }) - hole.begin());
  const int from = hole[start];
  struct Candidate {
    double distance2;
    std::size_t corner;
    auto operator<=>(const Candidate&) const = default;
  };
  std::vector<Candidate> nearest;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const double dx = at(loop[i])[0] - at(from)[0], dy = at(loop[i])[1] - at(from)[1];
    nearest.push_back({dx * dx + dy * dy, i});
  }
  std::sort(nearest.begin(), nearest.end());
  for (const auto& candidate : nearest) {
    const std::size_t corner = candidate.corner;
    const int to = loop[corner];
    if (!opens_to(loop, corner, from) || !opens_to(hole, start, to) || crosses(from, to, loop) ||
        crosses(from, to, hole))
      continue;
    if (std::any_of(
            others.begin(), others.end(), [&](const std::vector<int>& other) { return crosses(from, to, other); }))
      continue;
    std::vector<int> detour{to};
    for (std::size_t k = 0; k <= hole.size(); ++k) detour.push_back(hole[(start + k) % hole.size()]);
    loop.insert(loop.begin() + std::ptrdiff_t(corner), detour.begin(), detour.end());
    return true;
  }
  return false;
}

/// Sine of the smallest angle or so, at most one; 0 where the corner is no ear.
inline double PolygonTriangles::shape_of_ear(const std::vector<int>& loop, std::size_t corner) const {
  const int a = loop[(corner + loop.size() - 1) % loop.size()], b = loop[corner], c = loop[(corner + 1) % loop.size()];
  if (a == c || turn(a, b, c) <= 0) return 0.0;
  for (const int p : loop)
    if (p != a && p != b && p != c && turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return 0.0;
  const auto squared = [&](int p, int q) {
    return (at(q)[0] - at(p)[0]) * (at(q)[0] - at(p)[0]) + (at(q)[1] - at(p)[1]) * (at(q)[1] - at(p)[1]);
  };
  const double twice_area =
      (at(b)[0] - at(a)[0]) * (at(c)[1] - at(a)[1]) - (at(b)[1] - at(a)[1]) * (at(c)[0] - at(a)[0]);
  return twice_area / std::max({squared(a, b), squared(b, c), squared(c, a)});
}

inline auto PolygonTriangles::cut(std::vector<int> loop, std::vector<std::vector<int>> holes) const
    -> std::optional<std::vector<Triangle>> {
  const auto farthest = [&](const std::vector<int>& hole) {
    return at(*std::max_element(hole.begin(), hole.end(), [&](int p, int q) { return at(p) < at(q); }));
  };
  std::sort(holes.begin(), holes.end(), [&](const auto& a, const auto& b) { return farthest(a) < farthest(b); });
  while (!holes.empty()) {
    const std::vector<int> hole = std::move(holes.back());
    holes.pop_back();
    if (!bridge(loop, hole, holes)) return std::nullopt;
  }
  std::vector<Triangle> triangles;
  std::vector<double> shape;  // of the ear at each corner
  for (std::size_t i = 0; i < loop.size(); ++i) shape.push_back(shape_of_ear(loop, i));
  while (loop.size() > 3) {
    const auto ear = std::size_t(std::max_element(shape.begin(), shape.end()) - shape.begin());
    if (!(shape[ear] > 0.0)) return std::nullopt;
    const std::size_t n = loop.size();
    triangles.push_back({loop[(ear + n - 1) % n], loop[ear], loop[(ear + 1) % n]});
    loop.erase(loop.begin() + std::ptrdiff_t(ear));
    shape.erase(shape.begin() + std::ptrdiff_t(ear));
    // Only its neighbours change, for what was free of corners stays free; what was not may have become so.
    for (std::size_t i = 0; i < loop.size(); ++i)
      if (shape[i] == 0.0 || i == ear % loop.size() || (i + 1) % loop.size() == ear % loop.size())
        shape[i] = shape_of_ear(loop, i);
  }
  if (turn(loop[0], loop[1], loop[2]) <= 0) return std::nullopt;
  triangles.push_back({loop[0], loop[1], loop[2]});
  return triangles;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/self_intersection.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SELF_INTERSECTION_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SELF_INTERSECTION_HPP

namespace lumo {

/// Two triangles that meet elsewhere than in corners that they share, or come closer than `gap` without sharing any.
/// First what is certain in rounded numbers, then exact predicates; a sweep along the longest axis finds the
/// candidates.
class SelfIntersection {
 public:
  SelfIntersection(const std::vector<Vec3d>& vertices, const std::vector<SurfaceTriangle>& triangles, double gap)
      : vertices_(vertices), triangles_(triangles), gap_(gap) {}

  /// The first offending pair of triangle numbers, if any. Triangles of one facet are not compared: cutting it up made
  /// them disjoint.
  std::optional<std::pair<int, int>> find() const;

 private:
  using Corners = std::array<int, 3>;

  const Vec3d& at(int vertex) const { return vertices_[static_cast<std::size_t>(vertex)]; }
  static bool has(const Corners& t, int vertex) { return t[0] == vertex || t[1] == vertex || t[2] == vertex; }
  Vec3d normal(const Corners& t) const { return (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])); }

  bool clash(const Corners& a, const Corners& b) const;
  bool surely_apart(const Corners& a, const Corners& b) const;
  bool surely_beside(const Corners& a, const Corners& b, const Projection& project) const;
  bool folded(const Corners& a, const Corners& b) const;
  bool meets(int p, int q, const Corners& t) const;
  bool close(const Corners& a, const Corners& b) const;

  const std::vector<Vec3d>& vertices_;
  const std::vector<SurfaceTriangle>& triangles_;
  double gap_;
};

/// Squared distance between two line segments. Source: Ericson 2005, section 5.1.9.
inline double segment_distance2(const Vec3d& p1, const Vec3d& q1, const Vec3d& p2, const Vec3d& q2) {
  const Vec3d d1 = q1 - p1;
  const Vec3d d2 = q2 - p2;
  const Vec3d r = p1 - p2;
  const double a = d1.squaredNorm();
  const double e = d2.squaredNorm();
  const double b = d1.dot(d2);
  const double c = d1.dot(r);
  const double f = d2.dot(r);
  const double det = a * e - b * b;
  double s = det > 0.0 ? std::clamp((b * f - c * e) / det, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + f) / e, 0.0, 1.0);
  s = std::clamp((b * t - c) / a, 0.0, 1.0);
  return (r + s * d1 - t * d2).squaredNorm();
}

/// All vertices of b strictly on one side of the plane of a, but those that are also a's; or the same with a and b
/// exchanged.
inline bool SelfIntersection::surely_apart(const Corners& a, const Corners& b) const {
  int side = 0;
  for (int vertex : b) {
    if (has(a, vertex)) continue;
    const int sign = sure_orient3d(at(a[0]), at(a[1]), at(a[2]), at(vertex));
    if (sign == 0 || sign == -side) return false;
    side = sign;
  }
  return true;
}

/// Seen along one axis, an edge of a has a on one side and b, but shared corners, strictly on the other. What is
/// disjoint in a projection is disjoint in space.
inline bool SelfIntersection::surely_beside(const Corners& a, const Corners& b, const Projection& project) const {
  for (std::size_t i = 0; i < 3; ++i) {
    const int p = a[i];
    const int q = a[(i + 1) % 3];
    const Point2 from = project(at(p));
    const Point2 to = project(at(q));
    const int side = sure_orient2d(from, to, project(at(a[(i + 2) % 3])));
    if (side == 0) continue;
    const auto beyond = [&](int vertex) {
      return vertex == p || vertex == q || sure_orient2d(from, to, project(at(vertex))) == -side;
    };
    if (std::all_of(b.begin(), b.end(), beyond)) return true;
  }
  return false;
}

/// Neighbours across an edge that lie on each other, or nearly (dihedral angle below 1e-6).
inline bool SelfIntersection::folded(const Corners& a, const Corners& b) const {
  int apex_a = 0, apex_b = 0;
  std::array<int, 2> edge{};
  std::size_t shared = 0;
  for (int vertex : a) {
    if (has(b, vertex)) edge[shared++] = vertex;
    else apex_a = vertex;
  }
  for (int vertex : b)
    if (!has(a, vertex)) apex_b = vertex;
  const Vec3d along = at(edge[1]) - at(edge[0]);
  const Vec3d u = along.cross(at(apex_a) - at(edge[0]));
  const Vec3d v = along.cross(at(apex_b) - at(edge[0]));
  return u.dot(v) > 0.0 && u.cross(v).norm() < 1e-6 * u.norm() * v.norm();
}

/// Whether the closed segment p q meets the closed triangle t. Exact.
inline bool SelfIntersection::meets(int p, int q, const Corners& t) const {
  const int side_p = orient3d(at(t[0]), at(t[1]), at(t[2]), at(p));
  const int side_q = orient3d(at(t[0]), at(t[1]), at(t[2]), at(q));
  if (side_p * side_q > 0) return false;
  if (side_p != 0 || side_q != 0) {
    int low = 0, high = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const int sign = orient3d(at(p), at(q), at(t[i]), at(t[(i + 1) % 3]));
      low = std::min(low, sign);
      high = std::max(high, sign);
    }
    return low == 0 || high == 0;
  }
  const Projection project(normal(t));
  const std::array<Point2, 3> corners{project(at(t[0])), project(at(t[1])), project(at(t[2]))};
  const Point2 from = project(at(p));
  const Point2 to = project(at(q));
  bool inside = true;
  for (std::size_t i = 0; i < 3; ++i) {
    if (segments_meet(from, to, corners[i], corners[(i + 1) % 3])) return true;
    inside = inside && orient2d(corners[i], corners[(i + 1) % 3], from) > 0;
  }
  return inside;
}

inline bool SelfIntersection::close(const Corners& a, const Corners& b) const {
  for (const auto& [t, other] : {std::pair{&a, &b}, std::pair{&b, &a}}) {
    const Vec3d n = normal(*t).normalized();
    int above = 0, below = 0;
    for (int vertex : *other) {
      const double height = n.dot(at(vertex) - at((*t)[0]));
      above += height > gap_;
      below += height < -gap_;
      if (std::abs(height) > gap_) continue;
      bool inside = true;  // of the prism over the triangle
      for (std::size_t i = 0; i < 3; ++i) {
        const Vec3d& corner = at((*t)[i]);
        inside = inside && n.dot((at((*t)[(i + 1) % 3]) - corner).cross(at(vertex) - corner)) >= 0.0;
      }
      if (inside) return true;
    }
    if (above == 3 || below == 3) return false;
  }
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (segment_distance2(at(a[i]), at(a[(i + 1) % 3]), at(b[j]), at(b[(j + 1) % 3])) < gap_ * gap_) return true;
  return false;
}

inline bool SelfIntersection::clash(const Corners& a, const Corners& b) const {
  const auto shared = std::count_if(a.begin(), a.end(), [&](int vertex) { return has(b, vertex); });
  if (shared == 3) return true;
  if (shared == 2) return folded(a, b);
  if (shared == 0 && close(a, b)) return true;
  if (surely_apart(a, b) || surely_apart(b, a)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const Projection project(Vec3d::Unit(axis));
    if (surely_beside(a, b, project) || surely_beside(b, a, project)) return false;
  }
  // One shared corner: whatever else they share reaches an edge opposite to it.
  for (const auto& [t, other] : {std::pair{&a, &b}, std::pair{&b, &a}})
    for (std::size_t i = 0; i < 3; ++i) {
      const int p = (*t)[i];
      const int q = (*t)[(i + 1) % 3];
      if (has(*other, p) || has(*other, q)) continue;
      if (meets(p, q, *other)) return true;
    }
  return false;
}

inline std::optional<std::pair<int, int>> SelfIntersection::find() const {
  struct TriangleBox {
    Vec3d low, high;
    int triangle;
  };
  std::vector<TriangleBox> boxes;
  const Vec3d margin = Vec3d::Constant(0.5 * gap_);
  Vec3d low = Vec3d::Constant(HUGE_VAL), high = Vec3d::Constant(-HUGE_VAL);
  for (std::size_t i = 0; i < triangles_.size(); ++i) {
    const Corners& t = triangles_[i].corners;
    const Vec3d &a = at(t[0]), &b = at(t[1]), &c = at(t[2]);
    boxes.push_back({elementwise_min(elementwise_min(a, b), c) - margin,
        elementwise_max(elementwise_max(a, b), c) + margin, static_cast<int>(i)});
    low = elementwise_min(low, boxes.back().low);
    high = elementwise_max(high, boxes.back().high);
  }
  int axis = 0;
  (high - low).maxCoeff(&axis);
  std::sort(boxes.begin(), boxes.end(), [axis](const TriangleBox& a, const TriangleBox& b) {
    return a.low[axis] != b.low[axis] ? a.low[axis] < b.low[axis] : a.triangle < b.triangle;
  });
  for (std::size_t i = 0; i < boxes.size(); ++i)
    for (std::size_t j = i + 1; j < boxes.size() && boxes[j].low[axis] <= boxes[i].high[axis]; ++j) {
      if ((boxes[i].low.array() > boxes[j].high.array()).any() || (boxes[j].low.array() > boxes[i].high.array()).any())
        continue;
      const SurfaceTriangle& a = triangles_[static_cast<std::size_t>(boxes[i].triangle)];
      const SurfaceTriangle& b = triangles_[static_cast<std::size_t>(boxes[j].triangle)];
      if (a.facet != b.facet && clash(a.corners, b.corners)) return std::pair{boxes[i].triangle, boxes[j].triangle};
    }
  return std::nullopt;
}

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

// ---- lumo/geometry/shells.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SHELLS_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SHELLS_HPP

namespace lumo {

/// A connected part of a surface. It faces outwards (volume > 0, a solid) or inwards (a cavity).
struct Shell {
  std::vector<int> triangles;
  double area = 0.0;
  double volume = 0.0;
};

/// Union–find with path halving.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  int find(int i) {
    while (at(i) != i) i = at(i) = at(at(i));
    return i;
  }
  void join(int i, int j) { at(find(i)) = find(j); }

 private:
  int& at(int i) { return parent_[static_cast<std::size_t>(i)]; }
  std::vector<int> parent_;
};

/// Every edge has two facets that run along it in opposite directions, and the facets around each vertex form one fan.
/// Throws MeshError (open, not_manifold).
inline void check_edges(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  struct Side {
    int low, high;
    bool up;  // runs from the lower vertex number to the higher
    int facet;
    int from, to;  // corners, numbered through all facets
  };
  std::vector<Side> sides;
  std::vector<int> vertex_of;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const int base = static_cast<int>(vertex_of.size());
    const int n = static_cast<int>(loop.size());
    for (int i = 0; i < n; ++i) {
      const int a = loop[static_cast<std::size_t>(i)];
      const int b = loop[static_cast<std::size_t>((i + 1) % n)];
      sides.push_back({std::min(a, b), std::max(a, b), a < b, static_cast<int>(f), base + i, base + (i + 1) % n});
      vertex_of.push_back(a);
    }
  }
  std::sort(sides.begin(), sides.end(),
      [](const Side& a, const Side& b) { return std::tie(a.low, a.high, a.from) < std::tie(b.low, b.high, b.from); });
  Groups fans(vertex_of.size());
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].low == sides[i].low && sides[end].high == sides[i].high) ++end;
    const auto place = [&](int vertex) {
      const Vec3d& p = input.vertices[static_cast<std::size_t>(vertex)];
      return message(vertex, " at (", p.x(), ", ", p.y(), ", ", p.z(), ")");
    };
    const auto edge = message(
        "the edge from vertex ", place(sides[i].low), " to ", place(sides[i].high), " of facet ", sides[i].facet);
    if (end - i == 1) throw MeshError(Reason::open, message("surface: ", edge, " has 1 facet, must have 2"));
    if (end - i > 2)
      throw MeshError(Reason::not_manifold, message("surface: ", edge, " has ", end - i, " facets, must have 2"));
    const Side& a = sides[i];
    const Side& b = sides[i + 1];
    if (a.up == b.up)
      throw MeshError(
          Reason::not_manifold, message("surface: ", edge, " has a facet of opposite orientation, ", b.facet));
    fans.join(a.from, b.to);
    fans.join(a.to, b.from);
    i = end;
  }
  std::vector<int> fan_of(input.vertices.size(), -1);
  for (std::size_t corner = 0; corner < vertex_of.size(); ++corner) {
    int& known = fan_of[static_cast<std::size_t>(vertex_of[corner])];
    const int fan = fans.find(static_cast<int>(corner));
    if (known >= 0 && known != fan)
      throw MeshError(Reason::not_manifold,
          message("surface: vertex ", vertex_of[corner], " joins more than 1 fan of facets, must be 1"));
    known = fan;
  }
}

/// The connected parts of a surface, with areas and enclosed volumes.
inline std::vector<Shell> find_shells(const ClosedSurface& input, const std::vector<SurfaceTriangle>& triangles) {
  Groups groups(input.vertices.size());
  for (const SurfaceTriangle& t : triangles) {
    groups.join(t.corners[0], t.corners[1]);
    groups.join(t.corners[0], t.corners[2]);
  }
  std::vector<int> number(input.vertices.size(), -1);
  std::vector<Shell> shells;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    int& shell = number[static_cast<std::size_t>(groups.find(triangles[i].corners[0]))];
    if (shell < 0) {
      shell = static_cast<int>(shells.size());
      shells.emplace_back();
    }
    shells[static_cast<std::size_t>(shell)].triangles.push_back(static_cast<int>(i));
  }
  const auto at = [&](int vertex) -> const Vec3d& { return input.vertices[static_cast<std::size_t>(vertex)]; };
  for (Shell& shell : shells) {
    const Vec3d origin = at(triangles[static_cast<std::size_t>(shell.triangles[0])].corners[0]);
    for (int i : shell.triangles) {
      const auto& [a, b, c] = triangles[static_cast<std::size_t>(i)].corners;
      const Vec3d doubled = (at(b) - at(a)).cross(at(c) - at(a));
      shell.area += 0.5 * doubled.norm();
      shell.volume += doubled.dot(at(a) - origin) / 6.0;
    }
  }
  return shells;
}

/// Solid angle of the triangle abc seen from `point`, positive from behind. Source: van Oosterom and Strackee 1983.
inline double solid_angle(const Vec3d& from_a, const Vec3d& from_b, const Vec3d& from_c, const Vec3d& point) {
  const Vec3d a = from_a - point, b = from_b - point, c = from_c - point;
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

/// How often a shell winds around a point: 1 inside, 0 outside.
inline double winding(const std::vector<Vec3d>& vertices, const std::vector<SurfaceTriangle>& triangles,
    const Shell& shell, const Vec3d& point) {
  double angle = 0.0;
  for (int i : shell.triangles) {
    const auto& corners = triangles[static_cast<std::size_t>(i)].corners;
    angle += solid_angle(vertices[static_cast<std::size_t>(corners[0])], vertices[static_cast<std::size_t>(corners[1])],
        vertices[static_cast<std::size_t>(corners[2])], point);
  }
  return angle / (4.0 * std::numbers::pi);
}

/// Solids lie outside each other, cavities in a solid, interior points in the material.
/// Throws MeshError (not_manifold for shells, bad_index for points).
inline void check_inside(
    const ClosedSurface& input, const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  const auto total = [&](const Vec3d& point, const Shell* without) {
    double sum = 0.0;
    for (const Shell& shell : shells)
      if (&shell != without) sum += winding(input.vertices, triangles, shell, point);
    return sum;
  };
  for (std::size_t i = 0; shells.size() > 1 && i < shells.size(); ++i) {
    const SurfaceTriangle& first = triangles[static_cast<std::size_t>(shells[i].triangles[0])];
    const double around = total(input.vertices[static_cast<std::size_t>(first.corners[0])], &shells[i]);
    const double wanted = shells[i].volume > 0.0 ? 0.0 : 1.0;
    if (std::abs(around - wanted) > 0.25)
      throw MeshError(MeshError::Reason::not_manifold,
          message("surface: the shell of facet ", first.facet, " with volume ", shells[i].volume,
              " is wound by other shells ", around, " times, must be ", wanted));
  }
  std::vector<char> used(input.vertices.size(), 0);
  for (const SurfaceTriangle& t : triangles)
    for (int vertex : t.corners) used[static_cast<std::size_t>(vertex)] = 1;
  for (std::size_t i = 0; i < used.size(); ++i)
    if (!used[i] && total(input.vertices[i], nullptr) < 0.75)
      throw MeshError(MeshError::Reason::bad_index,
          message("surface: vertex ", i, " belongs to no facet and is not inside the body"));
}

/// A point inside each cavity: half way from one of its triangles to what faces it.
inline std::vector<Vec3d> cavity_points(const std::vector<Vec3d>& vertices,
    const std::vector<SurfaceTriangle>& triangles, const std::vector<Shell>& shells) {
  std::vector<Vec3d> points;
  const auto at = [&](int vertex) -> const Vec3d& { return vertices[static_cast<std::size_t>(vertex)]; };
  for (const Shell& shell : shells) {
    if (shell.volume > 0.0) continue;
    const auto& [a, b, c] = triangles[static_cast<std::size_t>(shell.triangles[0])].corners;
    const Vec3d from = (at(a) + at(b) + at(c)) / 3.0;
    const Vec3d ray = (at(b) - at(a)).cross(at(c) - at(a)).normalized();  // out of the material
    double nearest = HUGE_VAL;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      if (static_cast<int>(i) == shell.triangles[0]) continue;
      const auto& [p, q, r] = triangles[i].corners;
      const Vec3d normal = (at(q) - at(p)).cross(at(r) - at(p));
      const double distance = normal.dot(at(p) - from) / normal.dot(ray);
      if (!(distance > 0.0 && distance < nearest)) continue;
      const Vec3d hit = from + distance * ray;
      const double slack = -1e-9 * normal.squaredNorm();
      const auto left = [&](int v, int w) { return normal.dot((at(w) - at(v)).cross(hit - at(v))) >= slack; };
      if (left(p, q) && left(q, r) && left(r, p)) nearest = distance;
    }
    points.push_back(from + 0.5 * nearest * ray);
  }
  return points;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/surface_check.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_CHECK_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_CHECK_HPP

namespace lumo {

/// What is known of a surface once it is found good.
struct SurfaceReport {
  Vec3d low{0.0, 0.0, 0.0};  ///< bounding box
  Vec3d high{0.0, 0.0, 0.0};
  double area = 0.0;
  double volume = 0.0;          ///< enclosed, cavities not counted
  std::vector<Vec3d> cavities;  ///< a point inside each cavity (a closed inner shell that faces inwards)
};

/// Checks that a surface bounds a solid: numbers finite and below 1e6, indices valid, facets flat (1e-8 of their size),
/// simple and not degenerate, no two vertices at one place (1e-8 of the body's size), every edge shared by two facets
/// of one orientation, one fan of facets around each vertex, positive volume, and no facets that cross, touch (1e-8 of
/// the body's size) or lie on each other. Vertices of no facet are interior points. Several separate solids and
/// cavities are legal. Throws MeshError with the reason of the first broken rule; an inside-out surface is
/// not_manifold, no volume is degenerate. Time about n log n for n triangles, quadratic in the corners of a facet.
/// An own engine: each fault is an error with its kind, place and limit, and nothing but Eigen is needed.
inline SurfaceReport validate_surface(const ClosedSurface& input);

namespace detail {

// In the unit of the coordinates; the other two relative to the facet or the body. Own choice: far above what doubles
// round, far below what is made.
inline constexpr double largest_coordinate = 1e6;
inline constexpr double flatness = 1e-8;
inline constexpr double closeness = 1e-8;

[[noreturn]] inline void refuse_surface(MeshError::Reason reason, const std::string& line) {
  throw MeshError(reason, "surface: " + line);
}

inline std::string point_text(const Vec3d& p) { return message("(", p.x(), ", ", p.y(), ", ", p.z(), ")"); }

inline void check_numbers(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  if (input.vertices.empty() || input.facets.empty())
    refuse_surface(Reason::degenerate, message("has ", input.vertices.size(), " vertices and ", input.facets.size(),
                                           " facets, must have some of both"));
  if (input.vertices.size() > 100'000'000 || input.facets.size() > 100'000'000)
    refuse_surface(Reason::out_of_memory,
        message("has ", input.vertices.size(), " vertices and ", input.facets.size(), " facets, at most 1e8 of each"));
  for (std::size_t i = 0; i < input.vertices.size(); ++i)
    if (!(input.vertices[i].cwiseAbs().maxCoeff() <= largest_coordinate) || !input.vertices[i].allFinite())
      refuse_surface(Reason::not_finite, message("vertex ", i, " is at ", point_text(input.vertices[i]),
                                             ", coordinates must be finite and at most ", largest_coordinate));
  const auto count = static_cast<int>(input.vertices.size());
  std::vector<int> seen(input.vertices.size(), -1);
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    for (int vertex : loop)
      if (vertex < 0 || vertex >= count)
        refuse_surface(
            Reason::bad_index, message("facet ", f, " names vertex ", vertex, ", must lie in [0, ", count - 1, "]"));
    if (loop.size() < 3)
      refuse_surface(Reason::degenerate, message("facet ", f, " has ", loop.size(), " corners, must have at least 3"));
    for (int vertex : loop)
      if (std::exchange(seen[static_cast<std::size_t>(vertex)], static_cast<int>(f)) == static_cast<int>(f))
        refuse_surface(Reason::degenerate, message("facet ", f, " has vertex ", vertex, " more than once"));
  }
}

/// Vertices closer than `tolerance`, found by sorting along a direction in which hardly any two agree by accident.
inline void check_duplicates(const std::vector<Vec3d>& vertices, double tolerance) {
  const Vec3d direction = Vec3d(0.5477, 0.6083, 0.5744).normalized();
  struct Placed {
    double along;
    int vertex;
    auto operator<=>(const Placed&) const = default;
  };
  std::vector<Placed> order;
  for (std::size_t i = 0; i < vertices.size(); ++i) order.push_back({direction.dot(vertices[i]), static_cast<int>(i)});
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t j = i + 1; j < order.size() && order[j].along - order[i].along <= tolerance; ++j) {
      const Vec3d& a = vertices[static_cast<std::size_t>(order[i].vertex)];
      const double distance = (vertices[static_cast<std::size_t>(order[j].vertex)] - a).norm();
      if (distance <= tolerance)
        refuse_surface(MeshError::Reason::duplicate,
            message("vertices ", order[i].vertex, " and ", order[j].vertex, " at ", point_text(a), " are ", distance,
                " apart, must be more than ", tolerance));
    }
}

}  // namespace detail

/// Checks each facet alone and cuts it into triangles.
inline std::vector<SurfaceTriangle> check_facets(const ClosedSurface& input, double gap) {
  using Reason = MeshError::Reason;
  std::vector<SurfaceTriangle> triangles;
  for (std::size_t f = 0; f < input.facets.size(); ++f) {
    const std::vector<int>& loop = input.facets[f].loop;
    const auto corner = [&](std::size_t i) -> const Vec3d& {
      return input.vertices[static_cast<std::size_t>(loop[i % loop.size()])];
    };
    double size = 0.0;
    for (std::size_t i = 0; i < loop.size(); ++i)
      size = std::max({size, (corner(i) - corner(0)).norm(), (corner(i + 1) - corner(i)).norm()});
    const Vec3d doubled = polygon_normal(input.vertices, loop);
    if (!(doubled.norm() > 2.0 * detail::flatness * size * size))
      detail::refuse_surface(
          Reason::degenerate, message("facet ", f, " at ", detail::point_text(corner(0)), " has area ",
                                  0.5 * doubled.norm(), ", must be more than ", detail::flatness * size * size));
    const Vec3d normal = doubled.normalized();
    for (std::size_t i = 1; i < loop.size(); ++i) {
      const double height = std::abs(normal.dot(corner(i) - corner(0)));
      if (loop.size() > 3 && height > detail::flatness * size)
        detail::refuse_surface(
            Reason::degenerate, message("facet ", f, " at ", detail::point_text(corner(i)), " is not flat: ", height,
                                    " off its plane, at most ", detail::flatness * size));
    }
    const auto pieces = facet_triangles(input.vertices, loop, normal, static_cast<int>(f), 2.0 * gap);
    if (!pieces)
      detail::refuse_surface(Reason::self_intersecting,
          message("the outline of facet ", f, " at ", detail::point_text(corner(0)), " crosses or touches itself"));
    triangles.insert(triangles.end(), pieces->begin(), pieces->end());
  }
  return triangles;
}

inline SurfaceReport validate_surface(const ClosedSurface& input) {
  using Reason = MeshError::Reason;
  detail::check_numbers(input);
  SurfaceReport report;
  report.low = report.high = input.vertices[0];
  for (const Vec3d& vertex : input.vertices) {
    report.low = elementwise_min(report.low, vertex);
    report.high = elementwise_max(report.high, vertex);
  }
  const double size = (report.high - report.low).norm();
  if (!(size >= 1e-30))
    detail::refuse_surface(Reason::degenerate, message("has a size of ", size, ", must be at least 1e-30"));
  detail::check_duplicates(input.vertices, detail::closeness * size);
  const std::vector<SurfaceTriangle> triangles = check_facets(input, detail::closeness * size);
  check_edges(input);

  const std::vector<Shell> shells = find_shells(input, triangles);
  for (const Shell& shell : shells) {
    report.area += shell.area;
    report.volume += shell.volume;
    if (!(std::abs(shell.volume) > 1e-9 * shell.area * size))
      detail::refuse_surface(Reason::degenerate,
          message("the shell of facet ", triangles[static_cast<std::size_t>(shell.triangles[0])].facet,
              " encloses a volume of ", shell.volume, ", must be more than ", 1e-9 * shell.area * size));
  }
  if (!(report.volume > 0.0))
    detail::refuse_surface(
        Reason::not_manifold, message("is inside out: the enclosed volume is ", report.volume, ", must be > 0"));
  if (const auto pair = SelfIntersection(input.vertices, triangles, detail::closeness * size).find()) {
    const SurfaceTriangle& a = triangles[static_cast<std::size_t>(pair->first)];
    const SurfaceTriangle& b = triangles[static_cast<std::size_t>(pair->second)];
    detail::refuse_surface(Reason::self_intersecting,
        message("facets ", std::min(a.facet, b.facet), " and ", std::max(a.facet, b.facet), " cross or touch near ",
            detail::point_text(input.vertices[static_cast<std::size_t>(a.corners[0])]), ", must be more than ",
            detail::closeness * size, " apart"));
  }
  check_inside(input, triangles, shells);
  report.cavities = cavity_points(input.vertices, triangles, shells);
  return report;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/triangle_surface.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_TRIANGLE_SURFACE_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_TRIANGLE_SURFACE_HPP

namespace lumo {

/// A surface of triangles, counter-clockwise seen from outside.
struct TriangleSurface {
  std::vector<Vec3d> vertices;  ///< [m]
  std::vector<std::array<int, 3>> triangles;
};

/// Removes the vertices that no triangle has; the others keep their order.
inline void drop_unused_vertices(TriangleSurface& surface) {
  std::vector<int> number(surface.vertices.size(), -1);
  for (const auto& t : surface.triangles)
    for (const int v : t) number[std::size_t(v)] = 0;
  std::vector<Vec3d> used;
  for (std::size_t v = 0; v < number.size(); ++v)
    if (number[v] == 0) {
      number[v] = int(used.size());
      used.push_back(surface.vertices[v]);
    }
  surface.vertices = std::move(used);
  for (auto& t : surface.triangles)
    for (int& v : t) v = number[std::size_t(v)];
}

/// Throws MeshError unless the surface is closed, manifold, faces outwards and does not cross itself; see
/// validate_surface.
inline SurfaceReport validate_surface(const TriangleSurface& surface) {
  ClosedSurface input;
  input.vertices = surface.vertices;
  for (const auto& t : surface.triangles) input.facets.push_back({{t[0], t[1], t[2]}, 0});
  return validate_surface(input);
}

/// How often the surface winds around a point: 1 inside, 0 outside.
inline double winding_number(const TriangleSurface& surface, const Vec3d& point) {
  double angle = 0.0;
  const auto at = [&](int vertex) -> const Vec3d& { return surface.vertices[std::size_t(vertex)]; };
  for (const auto& t : surface.triangles) angle += solid_angle(at(t[0]), at(t[1]), at(t[2]), point);
  return angle / (4.0 * std::numbers::pi);
}

}  // namespace lumo

#endif

// ---- lumo/geometry/surface_mending.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_MENDING_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_MENDING_HPP

namespace lumo {

/// What was mended of a surface so that it is closed.
struct SurfaceMending {
  int joined = 0;           ///< corners moved to their twins
  double farthest_m = 0.0;  ///< the longest of those moves [m]
  int dropped = 0;          ///< facets without area
  int split = 0;            ///< edges split at corners that lie on them

  bool any() const { return joined + dropped + split > 0; }
};

/// A side of a triangle, in its direction.
struct TriangleSide {
  int from = 0, to = 0;
  int triangle = 0;
};

/// Sides without a partner, of edges that have no other, in order of their vertex numbers.
inline std::vector<TriangleSide> open_sides(const TriangleSurface& surface) {
  std::vector<TriangleSide> sides, open;
  for (std::size_t i = 0; i < surface.triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      sides.push_back({surface.triangles[i][k], surface.triangles[i][(k + 1) % 3], int(i)});
  const auto edge = [](const TriangleSide& s) { return std::pair(std::min(s.from, s.to), std::max(s.from, s.to)); };
  std::sort(sides.begin(), sides.end(), [&](const TriangleSide& a, const TriangleSide& b) {
    return std::tuple(edge(a), a.triangle) < std::tuple(edge(b), b.triangle);
  });
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && edge(sides[end]) == edge(sides[i])) ++end;
    if (end - i == 1) open.push_back(sides[i]);
    i = end;
  }
  return open;
}

/// Mends what rounding does to a closed surface: corners that left their twins, facets without area. Nothing moves
/// farther than `precision`, in the surface's unit, but to be joined with a third by twice that. Holes stay.
class SurfaceMender {
 public:
  SurfaceMender(TriangleSurface& surface, double precision) : surface_(surface), precision_(precision) {}

  /// `farthest_m` is in the surface's unit. Vertices that no triangle has are dropped, and not counted.
  SurfaceMending mend() {
    drop_repeated();
    join_twins();
    close_slits();
    drop_slivers();
    drop_unused_vertices(surface_);
    return mending_;
  }

 private:
  using Triangle = std::array<int, 3>;
  using Cell = std::array<std::int64_t, 3>;
  static constexpr double sharpest_fold = 0.999;  // cosine of the 2.6° below which two facets lie on each other

  const Vec3d& at(int vertex) const { return surface_.vertices[std::size_t(vertex)]; }
  Triangle& triangle(int t) { return surface_.triangles[std::size_t(t)]; }
  static bool has(const Triangle& t, int vertex) { return t[0] == vertex || t[1] == vertex || t[2] == vertex; }
  double apart(int a, int b) const { return (at(a) - at(b)).cwiseAbs().maxCoeff(); }
  Cell cell(int vertex) const {
    Cell c;
    for (std::size_t a = 0; a < 3; ++a)
      c[a] = std::int64_t(std::floor(at(vertex)[Eigen::Index(a)] / (2.0 * precision_)));
    return c;
  }

  void drop_repeated();
  void join_twins();
  void close_slits();
  void drop_slivers();

  struct Twins {
    double distance;
    std::size_t one, other;
  };
  std::vector<Twins> twins(const std::vector<TriangleSide>& open) const;
  bool folds(const TriangleSide& one, const TriangleSide& other);
  bool join(int a, int b);
  bool turns_back(int from, int to, int next) const;

  enum class Sliver { none, needle, cap };  // two corners at one place; or one on the edge between the others
  struct Form {
    int a, b, m;  // corners: of the longest edge, and the third
    int nearer;   // of a and b, to m
    Sliver sliver;
  };
  Form form(const Triangle& t) const;
  void flip(int t, const Form& sliver);
  void collapse(int kept, int gone);
  void enter(int t);
  void leave(int t);

  TriangleSurface& surface_;
  double precision_;
  SurfaceMending mending_;
  int caps_ = 0;  // added to fill slits
  Groups places_{0};
  std::vector<std::vector<int>> about_;      // triangles at a vertex, and some that were
  std::map<std::pair<int, int>, int> side_;  // triangle of a side
  std::vector<int> doubtful_;
};

inline void SurfaceMender::drop_repeated() {
  const std::size_t before = surface_.triangles.size();
  std::erase_if(surface_.triangles, [](const Triangle& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
  mending_.dropped += int(before - surface_.triangles.size());
}

/// Pairs of open sides that run along each other in opposite directions, nearest first.
inline std::vector<SurfaceMender::Twins> SurfaceMender::twins(const std::vector<TriangleSide>& open) const {
  std::map<Cell, std::vector<std::size_t>> begins;
  for (std::size_t i = 0; i < open.size(); ++i) begins[cell(open[i].from)].push_back(i);
  std::vector<Twins> found;
  for (std::size_t i = 0; i < open.size(); ++i) {
    const Cell middle = cell(open[i].to);
    for (int n = 0; n < 27; ++n) {
      const auto there = begins.find({middle[0] + n % 3 - 1, middle[1] + n / 3 % 3 - 1, middle[2] + n / 9 - 1});
      if (there == begins.end()) continue;
      for (const std::size_t j : there->second) {
        const double distance = std::max(apart(open[i].to, open[j].from), apart(open[i].from, open[j].to));
        if (i < j && distance <= precision_) found.push_back({distance, i, j});
      }
    }
  }
  std::sort(found.begin(), found.end(), [](const Twins& a, const Twins& b) {
    return std::tie(a.distance, a.one, a.other) < std::tie(b.distance, b.one, b.other);
  });
  return found;
}

/// Do the facets of two sides lie on each other, as the two sides of a thin wall do where its rim is missing?
inline bool SurfaceMender::folds(const TriangleSide& one, const TriangleSide& other) {
  const auto across = [&](const TriangleSide& s) {
    const Triangle& t = triangle(s.triangle);
    const int apex = t[0] + t[1] + t[2] - s.from - s.to;
    const Vec3d along = (at(one.to) - at(one.from)).normalized(), way = at(apex) - at(s.from);
    return Vec3d(way - way.dot(along) * along);
  };
  const Vec3d u = across(one), v = across(other);
  if (!(u.norm() > 4.0 * precision_) || !(v.norm() > 4.0 * precision_)) return false;
  return u.dot(v) > sharpest_fold * u.norm() * v.norm();
}

/// Two places become one, unless an edge would vanish.
inline bool SurfaceMender::join(int a, int b) {
  const int p = places_.find(std::min(a, b)), q = places_.find(std::max(a, b)), kept = std::min(p, q),
            gone = std::max(p, q);
  if (p == q) return true;
  if (apart(p, q) > 2.0 * precision_) return false;
  for (const int t : about_[std::size_t(gone)])
    for (const int v : triangle(t))
      if (places_.find(v) == kept) return false;
  places_.join(gone, kept);
  auto& all = about_[std::size_t(kept)];
  all.insert(all.end(), about_[std::size_t(gone)].begin(), about_[std::size_t(gone)].end());
  return true;
}

/// Corners are joined only where open sides meet by it: what is closed is not touched.
inline void SurfaceMender::join_twins() {
  if (!(precision_ > 0.0)) return;
  const std::vector<TriangleSide> open = open_sides(surface_);
  if (open.empty()) return;
  places_ = Groups(surface_.vertices.size());
  about_.assign(surface_.vertices.size(), {});
  for (std::size_t t = 0; t < surface_.triangles.size(); ++t)
    for (const int v : surface_.triangles[t]) about_[std::size_t(v)].push_back(int(t));
  std::vector<char> met(open.size(), 0);
  for (const Twins& pair : twins(open)) {
    const TriangleSide &one = open[pair.one], &other = open[pair.other];
    if (met[pair.one] || met[pair.other] || folds(one, other)) continue;
    met[pair.one] = met[pair.other] = join(one.from, other.to) && join(one.to, other.from);
  }
  for (int v = 0; v < int(surface_.vertices.size()); ++v) {
    const int place = places_.find(v);
    if (place == v) continue;
    ++mending_.joined;
    mending_.farthest_m = std::max(mending_.farthest_m, (at(v) - at(place)).norm());
  }
  for (Triangle& t : surface_.triangles)
    for (int& v : t) v = places_.find(v);
}

/// Does an open side turn back on itself at `to`, and run on to `next`, no wider than rounding?
inline bool SurfaceMender::turns_back(int from, int to, int next) const {
  Vec3d way = at(from) - at(to), other = at(next) - at(to);
  if (other.squaredNorm() > way.squaredNorm()) std::swap(way, other);
  const double t = other.dot(way) / way.squaredNorm();
  return t > 0.0 && t < 1.0 && (other - t * way).norm() <= precision_;
}

/// A slit without width, whose two sides have corners of their own: facets of no width are added from its ends on, and
/// go with the slivers, which splits the edges on both sides.
inline void SurfaceMender::close_slits() {
  std::set<std::pair<int, int>> open;
  for (const TriangleSide& s : open_sides(surface_)) open.emplace(s.from, s.to);
  const std::vector<std::pair<int, int>> all(open.begin(), open.end());
  for (std::pair<int, int> side : all)
    while (open.contains(side)) {
      const int from = side.first, to = side.second;
      auto next = open.lower_bound({to, -1});
      while (next != open.end() && next->first == to && !turns_back(from, to, next->second)) ++next;
      if (next == open.end() || next->first != to) break;
      const int end = next->second;
      surface_.triangles.push_back({to, from, end});
      ++caps_;
      open.erase(next);
      open.erase(side);
      side = {from, end};
      if (open.erase({end, from}) == 0) open.insert(side);
    }
  mending_.split = caps_;
}

inline void SurfaceMender::enter(int t) {
  for (std::size_t k = 0; k < 3; ++k) {
    side_[{triangle(t)[k], triangle(t)[(k + 1) % 3]}] = t;
    about_[std::size_t(triangle(t)[k])].push_back(t);
  }
}
inline void SurfaceMender::leave(int t) {
  for (std::size_t k = 0; k < 3; ++k) side_.erase({triangle(t)[k], triangle(t)[(k + 1) % 3]});
}

inline void SurfaceMender::drop_slivers() {
  // First whether there are any: most files have none, and need no tables.
  for (std::size_t t = 0; t < surface_.triangles.size(); ++t)
    if (form(surface_.triangles[t]).sliver != Sliver::none) doubtful_.push_back(int(t));
  if (doubtful_.empty()) return;
  mending_.dropped += int(doubtful_.size()) - caps_;
  about_.assign(surface_.vertices.size(), {});
  for (std::size_t t = 0; t < surface_.triangles.size(); ++t) enter(int(t));
  for (std::size_t tries = 100 + 20 * doubtful_.size(); !doubtful_.empty() && tries > 0; --tries) {
    const int t = doubtful_.back();
    doubtful_.pop_back();
    if (triangle(t)[0] < 0) continue;
    const Form f = form(triangle(t));
    if (f.sliver == Sliver::cap) flip(t, f);
    if (f.sliver == Sliver::needle) collapse(std::min(f.m, f.nearer), std::max(f.m, f.nearer));
  }
  std::erase_if(surface_.triangles, [](const Triangle& t) { return t[0] < 0; });
}

inline SurfaceMender::Form SurfaceMender::form(const Triangle& t) const {
  const auto length = [&](std::size_t k) { return (at(t[k]) - at(t[(k + 1) % 3])).norm(); };
  std::size_t longest = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (length(k) > length(longest)) longest = k;
  Form f{t[longest], t[(longest + 1) % 3], t[(longest + 2) % 3], 0, Sliver::none};
  const double edge = length(longest), width = (at(f.b) - at(f.a)).cross(at(f.m) - at(f.a)).norm() / edge,
               least = 2.02 * detail::flatness * edge;
  f.nearer = length((longest + 1) % 3) < length((longest + 2) % 3) ? f.b : f.a;
  if ((at(f.m) - at(f.nearer)).norm() > precision_)
    f.sliver = width > std::max(precision_, least) ? f.sliver : Sliver::cap;
  else if (width <= least) f.sliver = Sliver::needle;
  return f;
}

/// The sliver's long edge ab becomes one between its third corner m and the neighbour's, c.
inline void SurfaceMender::flip(int t, const Form& sliver) {
  const int a = sliver.a, b = sliver.b, m = sliver.m;
  const auto there = side_.find({b, a});
  if (there == side_.end()) return;
  const int n = there->second, c = triangle(n)[0] + triangle(n)[1] + triangle(n)[2] - a - b;
  if (c == m || side_.contains({m, c}) || side_.contains({c, m})) return;
  leave(t);
  leave(n);
  triangle(t) = {m, a, c};
  triangle(n) = {m, c, b};
  for (const int changed : {t, n}) {
    enter(changed);
    doubtful_.push_back(changed);
  }
}

/// One corner takes the other's place, and the two facets at the edge between them go, if that pinches nothing.
inline void SurfaceMender::collapse(int kept, int gone) {
  const auto around = [&](int vertex) {
    std::vector<int> now = about_[std::size_t(vertex)];
    std::sort(now.begin(), now.end());
    now.erase(std::unique(now.begin(), now.end()), now.end());
    std::erase_if(now, [&](int t) { return !has(triangle(t), vertex); });
    return now;
  };
  const auto neighbours = [&](const std::vector<int>& triangles) {
    std::vector<int> all;
    for (const int t : triangles) all.insert(all.end(), triangle(t).begin(), triangle(t).end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  };
  const std::vector<int> moved = around(gone), here = neighbours(around(kept)), there = neighbours(moved);
  std::vector<int> common;
  std::set_intersection(here.begin(), here.end(), there.begin(), there.end(), std::back_inserter(common));
  if (common.size() != 4) return;  // the two themselves, and one on each side of the edge
  for (const int t : moved) leave(t);
  for (const int t : moved) {
    if (has(triangle(t), kept)) {
      triangle(t) = {-1, -1, -1};
      continue;
    }
    std::replace(triangle(t).begin(), triangle(t).end(), gone, kept);
    enter(t);
    doubtful_.push_back(t);
  }
}

}  // namespace lumo

#endif

// ---- lumo/geometry/surface_file.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_FILE_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SURFACE_FILE_HPP

namespace lumo {

/// A surface from a file, and what had to be mended of it.
struct SurfaceFromFile : TriangleSurface {
  SurfaceMending mended;
};

/// What was mended, in one line for whoever reads the file; empty: nothing.
inline std::string mending_text(const SurfaceMending& mended);

/// Reads a closed surface from a Wavefront .obj or a .stl file (text or binary), whose numbers are in units of `unit_m`
/// [m]; by default mm, as CAD writes them; the ending may be in capitals. All solids of an .stl are read. Polygons of
/// an .obj, concave ones too, are cut into triangles; its lines, points and unused vertices are passed over.
///
/// Vertices at one place become one. What the file's own precision did to a closed surface is mended and reported:
/// corners beside their twins by a few steps of float32 or the last printed digit, facets without area. Nothing else
/// is: holes, crossings and edges of three facets are refused. Throws InputError when the file is none, cannot be read
/// or breaks its format (with the line), MeshError when its surface does not bound a solid (an open edge with its
/// place, in the file's own numbers).
inline SurfaceFromFile read_surface(const std::string& path, double unit_m = 1e-3);

namespace detail {

/// Words of a text, line by line.
class SurfaceText {
 public:
  /// `continued`: a line that ends with a backslash goes on in the next.
  SurfaceText(std::string_view text, std::string name, bool continued)
      : rest_(text), name_(std::move(name)), continued_(continued) {}

  /// The words of the next line that has any, without a comment; none at the end.
  std::vector<std::string_view> next() {
    std::vector<std::string_view> words;
    bool more = false;
    while ((more || words.empty()) && !rest_.empty()) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      std::string_view line = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++line_;
      line = line.substr(0, std::min(line.find('#'), line.size()));
      const std::size_t last = line.find_last_not_of(" \t\r");
      more = continued_ && last != std::string_view::npos && line[last] == '\\';
      if (more) line = line.substr(0, last);
      for (;;) {
        const std::size_t begin = line.find_first_not_of(" \t\r");
        if (begin == std::string_view::npos) break;
        line.remove_prefix(begin);
        const std::size_t stop = std::min(line.find_first_of(" \t\r"), line.size());
        words.push_back(line.substr(0, stop));
        line.remove_prefix(stop);
      }
    }
    return words;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw InputError(message("surface file '", name_, "', line ", line_, ": ", what));
  }

  template <class Number> Number number(std::string_view word) const {
    Number value{};
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    const auto [end, fault] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (fault != std::errc{} || end != word.data() + word.size())
      refuse(message("'", printable(word), "' is no number"));
    return value;
  }
  Vec3d point(const std::vector<std::string_view>& words, std::size_t first) {
    if (words.size() < first + 3) refuse("a point needs three coordinates");
    Vec3d p;
    for (std::size_t a = 0; a < 3; ++a) {
      p[Eigen::Index(a)] = number<double>(words[first + a]);
      digits_ = std::max(digits_, significant_digits(words[first + a]));
    }
    return p;
  }

  /// Of the coordinate that was printed with most.
  int digits() const { return digits_; }

 private:
  static int significant_digits(std::string_view word) {
    int digits = 0;
    for (const char c : word.substr(0, word.find_first_of("eE")))
      if (c >= (digits > 0 ? '0' : '1') && c <= '9') ++digits;
    return digits;
  }

  std::string_view rest_;
  std::string name_;
  bool continued_;
  int line_ = 0, digits_ = 0;
};

/// Adds the triangles of a plane polygon; of one that crosses itself a fan, which is refused with its surface.
inline void add_polygon(TriangleSurface& surface, const std::vector<int>& loop) {
  std::vector<Vec3d> corners;
  std::vector<int> order;
  for (const int vertex : loop) {
    order.push_back(int(order.size()));
    corners.push_back(surface.vertices[std::size_t(vertex)]);
  }
  auto triangles = PolygonTriangles(corners, polygon_normal(corners, order)).cut(order, {});
  if (!triangles) {
    triangles.emplace();
    for (std::size_t k = 1; k + 1 < order.size(); ++k) triangles->push_back({0, order[k], order[k + 1]});
  }
  for (const auto& t : *triangles)
    surface.triangles.push_back({loop[std::size_t(t[0])], loop[std::size_t(t[1])], loop[std::size_t(t[2])]});
}

/// Statements of an .obj that say nothing about its facets: normals, groups, materials, loose lines and points.
inline constexpr std::array<std::string_view, 12> passed_over{
    "vn", "vt", "o", "g", "s", "mg", "l", "p", "usemtl", "mtllib", "usemap", "maplib"};

inline TriangleSurface read_obj(SurfaceText& text) {
  TriangleSurface s;
  for (auto words = text.next(); !words.empty(); words = text.next()) {
    if (words[0] == "v") {
      if (words.size() != 4 && words.size() != 5 && words.size() != 7)
        text.refuse("a vertex has 3 coordinates, and perhaps a weight or a colour");
      s.vertices.push_back(text.point(words, 1));
    } else if (words[0] == "f") {
      if (words.size() < 4) text.refuse("a face needs at least 3 corners");
      std::vector<int> loop;
      for (std::size_t k = 1; k < words.size(); ++k) {
        const int n = text.number<int>(words[k].substr(0, words[k].find('/'))), count = int(s.vertices.size()),
                  at = n < 0 ? count + n : n - 1;
        if (n == 0 || at < 0 || at >= count) text.refuse(message("a face names vertex ", n, " of ", count));
        if (loop.empty() || loop.back() != at) loop.push_back(at);
      }
      if (loop.size() > 1 && loop.front() == loop.back()) loop.pop_back();
      if (loop.size() > 2) add_polygon(s, loop);
    } else if (std::find(passed_over.begin(), passed_over.end(), words[0]) == passed_over.end()) {
      text.refuse(message("'", printable(words[0]), "' is no statement of a polygon surface"));
    }
  }
  return s;
}

/// One solid after the other, as one surface.
inline TriangleSurface read_stl_text(SurfaceText& text) {
  TriangleSurface s;
  const auto expect = [&](const std::vector<std::string_view>& words, std::initializer_list<std::string_view> wanted) {
    std::size_t k = 0;
    for (std::string_view w : wanted)
      if (k >= words.size() || words[k++] != w) text.refuse(message("'", w, "' was expected"));
  };
  expect(text.next(), {"solid"});
  for (;;) {
    const auto words = text.next();
    if (!words.empty() && words[0] == "endsolid") {
      const auto another = text.next();
      if (another.empty()) return s;
      expect(another, {"solid"});
      continue;
    }
    expect(words, {"facet", "normal"});
    expect(text.next(), {"outer", "loop"});
    const int first = int(s.vertices.size());
    for (int k = 0; k < 3; ++k) {
      const auto corner = text.next();
      expect(corner, {"vertex"});
      if (corner.size() != 4) text.refuse("a vertex has 3 coordinates");
      s.vertices.push_back(text.point(corner, 1));
    }
    s.triangles.push_back({first, first + 1, first + 2});
    expect(text.next(), {"endloop"});
    expect(text.next(), {"endfacet"});
  }
}

/// 80 bytes of anything, the number of triangles, then 50 bytes each: normal, three corners (little-endian float32), 2
/// bytes of anything.
inline TriangleSurface read_stl_binary(std::string_view bytes) {
  TriangleSurface s;
  for (std::size_t at = 84; at + 50 <= bytes.size(); at += 50) {
    const int first = int(s.vertices.size());
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3d p;
      for (int i = 0; i < 3; ++i)
        p[i] = double(std::bit_cast<float>(
            number_at<std::uint32_t>(&bytes[at + 12 + 12 * k + 4 * std::size_t(i)], ByteOrder::little)));
      s.vertices.push_back(p);
    }
    s.triangles.push_back({first, first + 1, first + 2});
  }
  return s;
}

/// One vertex for each place, in order of first mention.
inline TriangleSurface welded(const TriangleSurface& loose) {
  TriangleSurface s;
  using Place = std::array<double, 3>;
  std::map<Place, int> known;
  std::vector<int> number;
  for (const Vec3d& v : loose.vertices) {
    const auto [it, fresh] =
        known.try_emplace(Place{v.x() + 0.0, v.y() + 0.0, v.z() + 0.0}, int(s.vertices.size()));  // −0 is 0
    if (fresh) s.vertices.push_back(v);
    number.push_back(it->second);
  }
  for (const auto& t : loose.triangles)
    s.triangles.push_back({number[std::size_t(t[0])], number[std::size_t(t[1])], number[std::size_t(t[2])]});
  return s;
}

/// How far twins of a corner may lie apart, in the file's numbers: some steps of float32 at the largest, or what the
/// last printed digit is worth there. Texts of few digits, such as whole numbers, are not that inexact.
inline double file_precision(const TriangleSurface& surface, int digits) {
  constexpr double steps = 4.0, float_step = 1.2e-7, coarsest = 1e-4;  // the last two of the largest coordinate
  double largest = 0.0;
  for (const auto& t : surface.triangles)
    for (const int n : t) largest = std::max(largest, surface.vertices[std::size_t(n)].cwiseAbs().maxCoeff());
  const double last_digit =
      digits > 0 && largest > 0.0 ? std::pow(10.0, std::floor(std::log10(largest)) + 1.0 - digits) : 0.0;
  return std::max(steps * float_step * largest, std::min(1.01 * last_digit, coarsest * largest));
}

/// Refuses a surface with open edges by the place of the first, in the file's numbers.
inline void require_closed(const TriangleSurface& surface, double precision, const std::string& name) {
  const std::vector<TriangleSide> open = open_sides(surface);
  if (open.empty()) return;
  const auto place = [&](int vertex) { return point_text(surface.vertices[std::size_t(vertex)]); };
  throw MeshError(
      MeshError::Reason::open, message("surface file '", name, "': the edge from ", place(open[0].from), " to ",
                                   place(open[0].to), " in the file's unit has 1 facet, must have 2; ", open.size(),
                                   " such edges; corners are joined up to ", precision, " apart"));
}

}  // namespace detail

inline std::string mending_text(const SurfaceMending& mended) {
  std::string text;
  const auto add = [&](int count, const char* one, const char* many, const std::string& how) {
    if (count > 0) text += message(text.empty() ? "" : ", ", count, ' ', count == 1 ? one : many, how);
  };
  add(mended.joined, "corner", "corners", message(" joined to twins at most ", 1e3 * mended.farthest_m, " mm away"));
  add(mended.dropped, "facet", "facets", " without area dropped");
  add(mended.split, "edge", "edges", " split at corners on them");
  return text.empty() ? text : "surface mended: " + text;
}

/// Reads a surface from a file's bytes; `kind`: ".obj" or ".stl", `name`: for messages. Throws as read_surface does.
inline SurfaceFromFile parse_surface(
    std::string_view kind, const std::string& bytes, const std::string& name, double unit_m) {
  SurfaceFromFile s;
  TriangleSurface& surface = s;
  detail::SurfaceText text(bytes, name, kind == ".obj");
  if (kind == ".obj") {
    surface = detail::read_obj(text);
  } else {
    // A text, too, may begin with any 80 bytes; only the length distinguishes a binary file.
    const std::uint64_t count = bytes.size() >= 84 ? number_at<std::uint32_t>(&bytes[80], ByteOrder::little) : 0;
    if (bytes.size() >= 84 && bytes.size() == 84 + 50 * count) surface = detail::read_stl_binary(bytes);
    else if (bytes.rfind("solid", 0) == 0) surface = detail::read_stl_text(text);
    else
      throw InputError(message("surface file '", name, "' has ", bytes.size(), " bytes, a binary .stl of ", count,
          " triangles has ", 84 + 50 * count));
  }
  for (const Vec3d& v : surface.vertices)
    if (!v.allFinite())
      throw InputError(message("surface file '", name, "': a coordinate is not finite"));  // before they are sorted
  surface = detail::welded(surface);
  const double precision = detail::file_precision(surface, text.digits());
  s.mended = SurfaceMender(surface, precision).mend();
  s.mended.farthest_m *= unit_m;
  detail::require_closed(surface, precision, name);
  for (Vec3d& v : surface.vertices) v *= unit_m;
  validate_surface(surface);
  return s;
}

inline SurfaceFromFile read_surface(const std::string& path, double unit_m) {
  require_in_range("unit of a surface file", unit_m, 1e-9, 1e3, "m");
  const std::size_t dot = std::min(path.find_last_of("./"), path.size());
  std::string kind = path.substr(dot);
  for (char& c : kind) c = c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
  if (kind != ".obj" && kind != ".stl")
    throw InputError(message("surface file '", path, "': its name must end in .obj or .stl"));
  const auto size = file_size(path);
  if (!size) throw InputError(message("cannot read surface file '", path, "': there is no such file"));
  constexpr std::uintmax_t most = 500'000'000;
  if (*size > most) throw InputError(message("surface file '", path, "' is larger than ", most, " bytes"));
  const auto bytes = read_whole(path);
  if (!bytes) throw InputError(message("cannot read surface file '", path, "'"));
  return parse_surface(kind, *bytes, path, unit_m);
}

}  // namespace lumo

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

// ---- lumo/morphology/design.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_DESIGN_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_DESIGN_HPP

namespace lumo {

/// The paper's design vector θ = [h_fp, h_ep, w_s, h_s, w_v] in mm (paper §III-A).
struct FingerDesign {
  double h_fp = 6.0;  ///< height of the flat sides
  double h_ep = 6.0;  ///< height of the half ellipse above them
  double w_s = 8.0;   ///< width of the rigid stem
  double h_s = 5.0;   ///< height of the stem
  double w_v = 0.0;   ///< width of the lateral void on each side of the stem

  static constexpr double lattice_mm = 0.5;  ///< all five are multiples of it

  /// Values that are multiples of the lattice but for rounding become them, so that 0.1 + 0.4 is 0.5 in every bit;
  /// others are taken as they are.
  static FingerDesign from(std::span<const double> x);
  std::array<double, 5> values() const { return {h_fp, h_ep, w_s, h_s, w_v}; }
  bool operator==(const FingerDesign&) const = default;
};

/// What is meant by the smallest thickness of silicone.
enum class Thickness {
  euclidean,   ///< least distance between the half ellipse and the cavity's walls and roof
  along_axes,  ///< above the cavity along z, beside it along x
  above        ///< above the cavity along z only
};

/// How the silicone sits on the stem.
enum class Stem {
  bonded,  ///< it holds to the stem's top, and to its sides where there is no void
  free     ///< it lies on the stem, which only pushes
};

/// What the paper leaves open about the pad, shared by all designs; lengths in mm. Its defaults are those of the pad
/// that the paper's authors cast: a stair-shaped carrier, bonded shoulders beside its block, a solid distal cap.
/// Source: the first author's public code (dokkev/fingertip-design-framework, August 2026), lumo/fingertip/.
struct PadDimensions {
  double width = 30.0;
  double length = 55.0;          ///< of the part that has a cavity, centred on y = 0
  double cap_length = 5.0;       ///< of a solid end beyond it, at positive y
  double shoulder_width = 5.0;   ///< of silicone that hangs down beside the carrier's block; 0: the base is flat
  double shoulder_height = 8.0;  ///< how far it hangs down below z = 0
  double carrier_height = 10.0;  ///< of the carrier below z = 0
  Stem stem = Stem::free;
  double t_min = 5.0;  ///< smallest silicone thickness
  Thickness thickness = Thickness::euclidean;

  double lip_end() const { return 0.5 * width - shoulder_width; }  ///< |x| up to which the base z = 0 is silicone
  double proximal_end() const { return -0.5 * length; }            ///< y
  double distal_end() const { return 0.5 * length + cap_length; }  ///< y
  bool operator==(const PadDimensions&) const = default;
};

/// The default, by name.
inline PadDimensions built_pad() { return {}; }
/// A pad on a flat base, free at both ends, as lumo had it before the built one was known. At its width w_s + 2 w_v ≤
/// 19.5 says the same as 5 mm of silicone at each side.
inline PadDimensions plain_pad() {
  return {.width = 29.5,
      .length = 60.0,
      .cap_length = 0.0,
      .shoulder_width = 0.0,
      .shoulder_height = 0.0,
      .stem = Stem::bonded,
      .thickness = Thickness::along_axes};
}

/// Silicone above the voids and the stem: min over |x| ≤ w_s/2 + w_v of z_outer(x) − h_s, in mm.
double vertical_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Silicone beside the voids: min over 0 ≤ z ≤ h_s of x_outer(z) − (w_s/2 + w_v), in mm.
double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad = {});
/// Least distance between the half ellipse, its ends included, and the cavity's walls and roof, or between cavity and
/// side if that is less, in mm. 0 if the cavity's corner is not under the dome.
double euclidean_thickness(const FingerDesign& d, const PadDimensions& pad = {});

/// The space of θ: bounds, 0.5 mm lattice, the two sums and the thickness rule (paper Table I), decided exactly on the
/// lattice where it is counted along the axes, to 1e-9 mm where it is a distance.
inline DesignSpace finger_space(const PadDimensions& pad = {});

/// The hand-designed finger of the paper's authors, off the lattice. Source: as built_pad().
inline FingerDesign built_baseline() { return {5.0, 9.0, 7.6, 6.0, 2.0}; }
/// The designs that started the authors' campaigns of inclined contacts. Source: as built_pad().
inline std::vector<FingerDesign> built_references() {
  return {{14.5, 4.0, 5.0, 12.5, 5.0}, {13.5, 1.5, 7.0, 9.5, 5.5}, {5.5, 2.0, 9.0, 2.0, 0.5},
      {13.0, 7.0, 7.5, 14.5, 0.0}, {2.5, 17.5, 7.0, 2.0, 3.5}};
}

/// Throws InfeasibleDesign unless the design lies in finger_space(pad); designs that are known by name may lie off its
/// lattice.
inline void require_feasible(const FingerDesign& d, const PadDimensions& pad);

/// The plain finger's nominal design, and the five that start its campaigns.
inline FingerDesign plain_baseline() { return {6.0, 6.0, 8.0, 5.0, 0.0}; }
inline std::vector<FingerDesign> plain_references() {
  return {plain_baseline(), {4.0, 8.0, 8.0, 5.0, 2.0}, {8.0, 4.0, 6.0, 4.0, 2.0}, {5.0, 10.0, 10.0, 6.0, 3.0},
      {10.0, 5.0, 8.0, 6.0, 1.0}};
}

inline FingerDesign FingerDesign::from(std::span<const double> x) {
  if (x.size() != 5)
    throw InvalidArgument(message("theta has ", x.size(), " values, must have 5 (h_fp, h_ep, w_s, h_s, w_v in mm)"));
  const Variable lattice{"length", 0.0, 0.0, lattice_mm, "mm"};
  const auto snapped = [&](double value) { return lattice.on_lattice(value) ? lattice.nearest_node(value) : value; };
  return {snapped(x[0]), snapped(x[1]), snapped(x[2]), snapped(x[3]), snapped(x[4])};
}

inline double vertical_thickness(const FingerDesign& d, const PadDimensions& pad) {
  const double r = (d.w_s + 2.0 * d.w_v) / pad.width;
  return d.h_fp + d.h_ep * std::sqrt(std::max(0.0, 1.0 - r * r)) - d.h_s;
}

inline double euclidean_thickness(const FingerDesign& d, const PadDimensions& pad) {
  // The corner is the point of the cavity that comes nearest: above the roof the ellipse falls towards it, beside the
  // wall it leans towards it.
  const double a = 0.5 * pad.width, c = 0.5 * d.w_s + d.w_v, up = d.h_s - d.h_fp;
  const double under = d.h_ep * d.h_ep * (1.0 - c * c / (a * a));
  if (c >= a || (up > 0.0 && up * up >= under)) return 0.0;
  const auto squared = [&](double t) {
    const double x = a * std::cos(t) - c, z = d.h_ep * std::sin(t) - up;
    return x * x + z * z;
  };
  constexpr int pieces = 64;
  const double step = 0.5 * pi / pieces;
  int nearest = 0;
  for (int k = 1; k <= pieces; ++k)
    if (squared(k * step) < squared(nearest * step)) nearest = k;
  const double low = std::max(0, nearest - 1) * step, high = std::min(pieces, nearest + 1) * step;
  const double least = std::min(squared(0.0), squared(golden_section(squared, low, high, 60)));
  return std::min(a - c, std::sqrt(least));
}

inline double horizontal_thickness(const FingerDesign& d, const PadDimensions& pad) {
  const double above = std::max(0.0, d.h_s - d.h_fp) / d.h_ep;
  return 0.5 * pad.width * std::sqrt(std::max(0.0, 1.0 - above * above)) - 0.5 * (d.w_s + 2.0 * d.w_v);
}

namespace detail {

// Squared forms of the two thickness rules: on the lattice every term is a dyadic rational of few bits, so doubles
// decide them exactly.
inline bool vertically_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double inner = d.w_s + 2.0 * d.w_v, need = pad.t_min + d.h_s - d.h_fp, w2 = pad.width * pad.width;
  if (inner >= pad.width) return false;
  return need <= 0.0 || d.h_ep * d.h_ep * (w2 - inner * inner) >= w2 * need * need;
}

inline bool horizontally_thick(const FingerDesign& d, const PadDimensions& pad) {
  const double need = d.w_s + 2.0 * d.w_v + 2.0 * pad.t_min, above = d.h_s - d.h_fp;
  if (above <= 0.0) return pad.width >= need;
  if (above > d.h_ep) return false;
  return pad.width * pad.width * (d.h_ep * d.h_ep - above * above) >= need * need * d.h_ep * d.h_ep;
}

}  // namespace detail

inline DesignSpace finger_space(const PadDimensions& pad) {
  DesignSpace space;
  const double step = FingerDesign::lattice_mm;
  space.variables = {{"h_fp", 2.0, 29.0, step, "mm"}, {"h_ep", 1.0, 20.0, step, "mm"}, {"w_s", 4.0, 15.0, step, "mm"},
      {"h_s", 2.0, 15.0, step, "mm"}, {"w_v", 0.0, 7.5, step, "mm"}};
  const double unbounded = -std::numeric_limits<double>::infinity();
  space.constraints = {
      {"h_fp + h_ep", {1, 1, 0, 0, 0}, unbounded, 20.0, "mm"}, {"w_s + 2 w_v", {0, 0, 1, 0, 2}, unbounded, 19.5, "mm"}};
  const auto refusal = [pad](const char* where, double value) {
    return InfeasibleDesign(std::string("t_min ") + where, value, pad.t_min, "mm",
        message("infeasible design: smallest silicone thickness t_min (", where, ") = ", value,
            " mm is below its limit ", pad.t_min, " mm"));
  };
  if (pad.thickness == Thickness::euclidean) {
    constexpr double rounding_mm = 1e-9;
    space.rules = {{[pad](std::span<const double> x) {
                      return euclidean_thickness(FingerDesign::from(x), pad) >= pad.t_min - rounding_mm;
                    },
        [pad, refusal](std::span<const double> x) {
          return refusal("distance", euclidean_thickness(FingerDesign::from(x), pad));
        }}};
    return space;
  }
  space.rules = {{[pad](std::span<const double> x) { return detail::vertically_thick(FingerDesign::from(x), pad); },
      [pad, refusal](
          std::span<const double> x) { return refusal("vertical", vertical_thickness(FingerDesign::from(x), pad)); }}};
  if (pad.thickness == Thickness::along_axes)
    space.rules.push_back(
        {[pad](std::span<const double> x) { return detail::horizontally_thick(FingerDesign::from(x), pad); },
            [pad, refusal](std::span<const double> x) {
              return refusal("horizontal", horizontal_thickness(FingerDesign::from(x), pad));
            }});
  return space;
}

inline void require_feasible(const FingerDesign& d, const PadDimensions& pad) {
  DesignSpace space = finger_space(pad);
  if (d == built_baseline())
    for (Variable& v : space.variables) v.step = 0.0;
  space.check(d.values());
}

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
/// not into the body; its light is traced forward. Laws: |axis| = 1; point(u, v) is uniform in area [m] over (0, 1)²
/// (there is less noise where point(1−u, 1−v) lies opposite it about `center`); polar(u) is monotone; mirrored(m), m =
/// (±1, ±1, 1), radiates to the mirror image of the axis, and points do not depend on which of several ways the same
/// source is described; power_W is all that it radiates [W]; `channel` ≥ 0 is its colour.
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
  RectangleEmitter mirrored(const Vec3d& m) const;
};

static_assert(EmitterModel<RectangleEmitter>);

/// Throws InvalidArgument for an emitter without area or with a coordinate that is not finite.
inline void validate(const RectangleEmitter& e) {
  if (!e.half_u.allFinite() || !e.half_v.allFinite()) throw InvalidArgument("emitter: a coordinate is not finite");
  require_positive("emitter area", 4.0 * e.half_u.cross(e.half_v).norm(), "m2");
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
    double (*intensity)(const void*, double);  ///< or null
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
    [](const void* e, double u) -> Polar { return model<E>(e).polar(u); }, intensity_of<E>(),
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
  Vec3d pivot{0.0, 0.0, 0.0};     ///< approach directions turn about this point (shifted along y) [m]

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

// ---- lumo/morphology/section.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_SECTION_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_SECTION_HPP

namespace lumo {

/// Matched variants of a design. The twins without a carrier are for mechanics only (paper §IV-A).
enum class Twin {
  none,              ///< the finger itself
  no_void,           ///< the same θ with w_v = 0
  bonded_base,       ///< the stem's volume is silicone, voids stay, base bonded under the stem too
  unsupported_base,  ///< the same, but bonded at the two end faces only: a soft finger that can bend
  held_top           ///< silicone alone in the outline of pad and carrier, held on all of the carrier's back
};

constexpr std::string_view to_string(Twin twin) {
  switch (twin) {
    case Twin::no_void: return "no_void";
    case Twin::bonded_base: return "bonded_base";
    case Twin::unsupported_base: return "unsupported_base";
    case Twin::held_top: return "held_top";
    default: return "design";
  }
}

/// Is there a rigid stem under the silicone?
constexpr bool has_stem(Twin twin) { return twin == Twin::none || twin == Twin::no_void; }

/// What a boundary edge of the section is.
enum class SectionTag {
  mirror,
  stem_top,
  stem_side,
  void_inner,
  void_roof,
  void_wall,
  base,
  shoulder_wall,
  shoulder_top,
  side,
  dome
};

/// Half cross-section x ≥ 0 as a closed polygon in (x, z), counter-clockwise, in metres; edge i runs from point i to
/// i + 1, the last point is the dome's apex.
struct HalfSection {
  FingerDesign design;
  PadDimensions pad;
  Twin twin = Twin::none;
  std::vector<double> x, z;
  std::vector<SectionTag> tag;

  double half_width_m() const { return 0.5e-3 * pad.width; }
  double height_m() const { return z.back(); }  ///< of the dome's apex over the base
  bool lies_on_stem() const { return has_stem(twin) && pad.stem == Stem::free; }
  double length_m() const { return 1e-3 * (pad.length + pad.cap_length); }
  /// Exact area of the half section [m²].
  double exact_area_m2() const;
};

/// How a curve is cut into chords.
struct Chords {
  double longest_m;
  double max_turn_rad;
  double shortest_m = 0.0;  ///< about; turning does not ask for shorter ones
};

/// The section of a feasible design, its curve cut into chords, its straight edges left whole. Throws InfeasibleDesign.
inline HalfSection half_section(
    const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

/// The same of the solid distal cap. Throws likewise, and InvalidArgument for a pad without one.
inline HalfSection cap_section(
    const FingerDesign& design, Twin twin, const Chords& chords, const PadDimensions& pad = {});

/// Half x ≥ 0 of the carrier under the cavity, counter-clockwise from the middle of its back, (x, z) in m.
inline std::vector<std::array<double, 2>> carrier_outline(const FingerDesign& design, const PadDimensions& pad = {});

namespace detail {

// Angles of points on the quarter ellipse from the side (0) to the apex (π/2): each chord is as long and turns as much
// as allowed, evened out.
inline std::vector<double> ellipse_angles(double a, double b, const Chords& chords) {
  constexpr int fine = 20000;
  std::vector<double> measure(fine + 1, 0.0);
  const auto tangent = [&](double t) { return std::atan2(b * std::cos(t), -a * std::sin(t)); };
  for (int i = 1; i <= fine; ++i) {
    const double t0 = 0.5 * pi * (i - 1) / fine, t1 = 0.5 * pi * i / fine;
    const double arc = std::hypot(a * (std::cos(t1) - std::cos(t0)), b * (std::sin(t1) - std::sin(t0)));
    measure[std::size_t(i)] =
        measure[std::size_t(i) - 1] + arc / chords.longest_m +
        std::min(std::abs(tangent(t1) - tangent(t0)) / chords.max_turn_rad, arc / std::max(chords.shortest_m, 1e-12));
  }
  const int count = std::max(2, int(std::ceil(measure.back() - 1e-9)));
  std::vector<double> angles;
  std::size_t at = 0;
  for (int k = 0; k <= count; ++k) {
    const double want = measure.back() * k / count;
    while (at + 1 < measure.size() && measure[at + 1] < want) ++at;
    if (k == 0) angles.push_back(0.0);
    else if (k == count) angles.push_back(0.5 * pi);
    else angles.push_back(0.5 * pi * (double(at) + (want - measure[at]) / (measure[at + 1] - measure[at])) / fine);
  }
  return angles;
}

// The polygon of a section, point by point.
struct SectionPen {
  HalfSection& section;
  void add(double x, double z, SectionTag tag) const {
    section.x.push_back(x);
    section.z.push_back(z);
    section.tag.push_back(tag);
  }
  // From the lower end of the side to the apex.
  void add_outside(double low, const Chords& chords) const {
    const double w = section.half_width_m(), fp = 1e-3 * section.design.h_fp, ep = 1e-3 * section.design.h_ep;
    add(w, low, SectionTag::side);
    const std::vector<double> angles = ellipse_angles(w, ep, chords);
    for (std::size_t k = 0; k + 1 < angles.size(); ++k)
      add(k == 0 ? w : w * std::cos(angles[k]), fp + ep * std::sin(angles[k]), SectionTag::dome);
    add(0.0, fp + ep, SectionTag::mirror);
  }
};

inline bool has_soft_stem(Twin twin) { return twin == Twin::bonded_base || twin == Twin::unsupported_base; }

// Edges from the middle of the cavity to the base beside it.
inline void add_cavity(const SectionPen& pen, const HalfSection& s) {
  const FingerDesign& d = s.design;
  const double stem = 0.5e-3 * d.w_s, hs = 1e-3 * d.h_s, outer = stem + 1e-3 * d.w_v;
  const bool has_void = d.w_v > 0.0;
  if (has_soft_stem(s.twin)) {
    pen.add(0.0, 0.0, SectionTag::base);
    if (!has_void) return;
    pen.add(stem, 0.0, SectionTag::void_inner);
  } else if (!s.lies_on_stem()) {
    pen.add(0.0, hs, SectionTag::stem_top);
    if (!has_void) {
      pen.add(stem, hs, SectionTag::stem_side);
      pen.add(stem, 0.0, SectionTag::base);
      return;
    }
  }
  pen.add(s.lies_on_stem() ? 0.0 : stem, hs, SectionTag::void_roof);
  pen.add(outer, hs, SectionTag::void_wall);
  pen.add(outer, 0.0, SectionTag::base);
}

inline HalfSection empty_section(const FingerDesign& given, Twin twin, const PadDimensions& pad) {
  require_feasible(given, pad);
  HalfSection s{given, pad, twin, {}, {}, {}};
  if (twin == Twin::no_void) s.design.w_v = 0.0;
  return s;
}

}  // namespace detail

inline HalfSection half_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  HalfSection s = detail::empty_section(given, twin, pad);
  const detail::SectionPen pen{s};
  if (twin == Twin::held_top) {
    const double low = -1e-3 * pad.carrier_height;
    pen.add(0.0, low, SectionTag::base);
    pen.add_outside(low, chords);
    return s;
  }
  detail::add_cavity(pen, s);
  const double low = -1e-3 * pad.shoulder_height;
  if (low < 0.0) {
    pen.add(1e-3 * pad.lip_end(), 0.0, SectionTag::shoulder_wall);
    pen.add(1e-3 * pad.lip_end(), low, SectionTag::shoulder_top);
  }
  pen.add_outside(low, chords);
  return s;
}

inline HalfSection cap_section(const FingerDesign& given, Twin twin, const Chords& chords, const PadDimensions& pad) {
  require_positive("length of the cap", pad.cap_length, "mm");
  HalfSection s = detail::empty_section(given, twin, pad);
  const detail::SectionPen pen{s};
  const double low = twin == Twin::held_top ? -1e-3 * pad.carrier_height : -1e-3 * pad.shoulder_height;
  pen.add(0.0, low, twin == Twin::held_top ? SectionTag::base : SectionTag::shoulder_top);
  pen.add_outside(low, chords);
  return s;
}

inline std::vector<std::array<double, 2>> carrier_outline(const FingerDesign& d, const PadDimensions& pad) {
  const double w = 0.5e-3 * pad.width, lip = 1e-3 * pad.lip_end(), shoulder = -1e-3 * pad.shoulder_height,
               back = -1e-3 * pad.carrier_height, stem = 0.5e-3 * d.w_s, top = 1e-3 * d.h_s;
  std::vector<std::array<double, 2>> outline = {{0.0, back}, {w, back}};
  if (shoulder < 0.0) outline.insert(outline.end(), {{w, shoulder}, {lip, shoulder}});
  outline.insert(outline.end(), {{lip, 0.0}, {stem, 0.0}, {stem, top}, {0.0, top}});
  return outline;
}

inline double HalfSection::exact_area_m2() const {
  const double w = 0.5e-3 * pad.width;
  const double outside = w * 1e-3 * design.h_fp + 0.25 * pi * w * 1e-3 * design.h_ep;
  if (x.front() == 0.0 && z.front() < 0.0) return outside - w * z.front();  // solid: a cap, or a held twin
  const double cut = (detail::has_soft_stem(twin) ? 0.0 : 0.5e-3 * design.w_s) + 1e-3 * design.w_v;
  return outside + 1e-6 * pad.shoulder_width * pad.shoulder_height - cut * 1e-3 * design.h_s;
}

}  // namespace lumo

#endif

// ---- lumo/morphology/finger_options.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_OPTIONS_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_OPTIONS_HPP

namespace lumo {

/// About which point of the section an approach is tilted.
enum class TiltPivot {
  flat_top,  ///< x = 0, z = h_fp: where the flat sides end
  base       ///< x = 0, z = 0
};

/// What may be chosen about a finger besides θ, where the paper leaves a choice open. Its defaults are the finger that
/// the paper's authors built. Source: as PadDimensions; lengths of LEDs and recesses, albedo and pivot are of the same
/// code. Ours: the mesh, that a side is seen by its normals, and that the film of air over an LED never closes.
struct FingerOptions {
  /// Mesh size [m]; the defaults come from the reference study, benchmarks/reference.
  struct Mesh {
    double contact_edge = 2.5e-3;    ///< on the surface that an indenter can touch, away from where it does
    double coarsest_edge = 8.0e-3;   ///< at depth
    double growth = 0.5;             ///< edge length gained per length of depth
    double stretch_y = 1.0;          ///< edges along y are this much longer
    double max_turn_rad = 0.6;       ///< largest turning of the profile along one edge
    double shortest_chord = 0.4e-3;  ///< of the profile; turning does not ask for shorter ones
    double support_edge = 2.5e-3;    ///< on the surface that lies free on the carrier
    double seam_edge = 1.0e-3;       ///< at the edges of a bonded stem, below a tool
    double stem_edge = 0.4e-3;       ///< at the rounded edges of a stem on which silicone lies free, below a tool

    /// All edges `factor` times as long; the stretch stays.
    constexpr Mesh scaled(double factor) const {
      return {factor * contact_edge, factor * coarsest_edge, factor * growth, stretch_y, factor * max_turn_rad,
          factor * shortest_chord, factor * support_edge, factor * seam_edge, factor * stem_edge};
    }
    /// For a look in a fifth of the time. About a stem's edges, where equilibria are lost first, they stay finer.
    static constexpr double quick_edges = 1.8, quick_stem_edges = 1.25;
    constexpr Mesh quick() const {
      Mesh mesh = scaled(quick_edges);
      mesh.shortest_chord = quick_stem_edges * shortest_chord;
      mesh.stem_edge = quick_stem_edges * stem_edge;
      return mesh;
    }
    bool operator==(const Mesh&) const = default;
  };
  /// The five LEDs, lengths in m. On the sides there are as many on each, at half the stem's height, with half the
  /// power; beside a void they shine into its air.
  struct Leds {
    enum class Place { top, sides };
    Place place = Place::top;
    int count = 5;
    double pitch = 11.0e-3;
    double length_y = 1.6e-3;
    double width_x = 1.8e-3;  ///< on the sides, their height
    double power_W = 1.0;     ///< of all together

    bool operator==(const Leds&) const = default;
  };
  /// Hollows in the top of a stem on which the silicone lies free, one for each LED on the top, across the stem's whole
  /// width: the LED lies on the floor and shines into the film of air above it.
  struct Recess {
    double depth = 0.19e-3;  ///< 0: there are none, and LEDs touch the silicone
    double length_y = 5.1e-3;
    std::optional<double> film_closes;  ///< Body::film_closes_m

    bool operator==(const Recess&) const = default;
  };
  /// Readout regions on the outer surface.
  struct Readout {
    int bins = 11;
    double half_range = 27.5e-3;  ///< |y| beyond it is not seen [m]
    double min_abs_nx = 0.5;      ///< the undeformed normal must point this much sideways
    bool one_side = true;         ///< only x > 0 is seen
    /// Light is seen by its direction, wherever it leaves, and `min_abs_nx` says nothing.
    bool by_direction = false;
    bool in_space = false;  ///< bins stay where they are; otherwise they move with the material

    bool operator==(const Readout&) const = default;
  };

  Twin twin = Twin::none;
  PadDimensions pad = {};
  Mesh mesh = {};
  Leds leds = {};
  Recess recess = {};
  Readout readout = {};
  TiltPivot pivot = TiltPivot::base;
  /// Of the edges of a stem on which silicone lies free, its ridges' too; 0: sharp [m]. Ours: the drawings have sharp
  /// edges, over which no equilibrium is certain.
  double stem_edge_radius = 0.4e-3;
  double carrier_albedo = 0.7;
  bool bonded_ends = false;              ///< the end faces are held, by something clear: light passes them as before
  SurfaceOptics touched = Dielectric{};  ///< Body::touched

  bool operator==(const FingerOptions&) const = default;
};

/// The default, by name.
inline FingerOptions built_finger(const FingerOptions::Mesh& mesh = {}) {
  FingerOptions o;
  o.mesh = mesh;
  return o;
}

/// A pad on a flat carrier, bonded to the stem, with free ends and LEDs in the silicone: lumo's reading of the paper
/// before the built one was known.
inline FingerOptions plain_finger(const FingerOptions::Mesh& mesh = {}) {
  FingerOptions o = built_finger(mesh);
  o.pad = plain_pad();
  o.leds.width_x = 0.8e-3;
  o.recess.depth = 0.0;
  o.recess.film_closes = 0.0;
  o.readout.one_side = false;
  o.pivot = TiltPivot::flat_top;
  o.carrier_albedo = 0.8;
  return o;
}

/// Another finger by one choice. By its key, a word without blanks, it is asked for.
struct FingerVariant {
  const char *key, *quantity, *value;
  void (*apply)(FingerOptions&);
};

/// What distinguishes the plain finger's pad from the built one's, and may be chosen by itself.
inline std::vector<FingerVariant> finger_variants() {
  return {{"bonded_stem", "stem", "bonded, as on a primed one", [](FingerOptions& o) { o.pad.stem = Stem::bonded; }},
      {"tilt_about_flat_top", "tilt", "about z = h_fp", [](FingerOptions& o) { o.pivot = TiltPivot::flat_top; }},
      {"thickness_along_axes", "t_min", "along the axes",
          [](FingerOptions& o) { o.pad.thickness = Thickness::along_axes; }}};
}

/// Throws InvalidArgument for an option that is out of range.
inline void validate(const FingerOptions& options);

inline void validate(const FingerOptions& o) {
  require_in_range("mesh edge at the contact surface", o.mesh.contact_edge * 1e3, 0.2, 10.0, "mm");
  require_in_range("coarsest mesh edge", o.mesh.coarsest_edge * 1e3, o.mesh.contact_edge * 1e3, 30.0, "mm");
  require_in_range("mesh growth with depth", o.mesh.growth, 0.0, 100.0, "");
  require_in_range("mesh stretch along y", o.mesh.stretch_y, 0.5, 4.0, "");
  require_in_range("largest turning along an edge", o.mesh.max_turn_rad, 0.01, 1.6, "rad");
  require_in_range("shortest chord", o.mesh.shortest_chord * 1e3, 0.0, 10.0, "mm");
  require_in_range("pad width", o.pad.width, 1.0, 200.0, "mm");
  require_in_range("pad length", o.pad.length, 1.0, 1000.0, "mm");
  require_in_range("smallest silicone thickness", o.pad.t_min, 0.0, 100.0, "mm");
  if ((o.pad.shoulder_width > 0.0) != (o.pad.shoulder_height > 0.0))
    throw InvalidArgument(message("shoulders are ", o.pad.shoulder_width, " mm wide and ", o.pad.shoulder_height,
        " mm high, must be 0 both or neither"));
  require_in_range("length of the pad's cap", o.pad.cap_length, 0.0, 1000.0, "mm");
  require_in_range("width of the shoulders", o.pad.shoulder_width, 0.0, 0.5 * o.pad.width - 1e-3, "mm");
  require_in_range("height of the shoulders", o.pad.shoulder_height, 0.0, 100.0, "mm");
  require_in_range(
      "height of the carrier below the base", o.pad.carrier_height, o.pad.shoulder_height + 1e-3, 200.0, "mm");
  require_in_range("depth of the LEDs' recesses", o.recess.depth * 1e3, 0.0, 1.0, "mm");
  if (o.recess.film_closes)
    require_in_range("height at which the film over an LED closes", *o.recess.film_closes * 1e3, 0.0, 1.0, "mm");
  if (o.recess.depth > 0.0)  // walls are left between them
    require_in_range(
        "length of the LEDs' recesses", o.recess.length_y * 1e3, o.leds.length_y * 1e3, o.leds.pitch * 1e3 - 1.0, "mm");
  require_in_range("mesh edge on the carrier", o.mesh.support_edge * 1e3, 0.1, 30.0, "mm");
  require_in_range("mesh edge at a bonded stem's edges", o.mesh.seam_edge * 1e3, 0.05, 30.0, "mm");
  require_in_range("mesh edge at a free stem's edges", o.mesh.stem_edge * 1e3, 0.05, 30.0, "mm");
  require_in_range("radius of a free stem's edges", o.stem_edge_radius * 1e3, 0.0, 1.0, "mm");
  require_in_range("number of LEDs", o.leds.count, 0, 1000, "");
  require_in_range("LED pitch", o.leds.pitch * 1e3, 0.0, 1000.0, "mm");
  require_in_range("LED length", o.leds.length_y * 1e3, 1e-3, 100.0, "mm");
  require_in_range("LED width", o.leds.width_x * 1e3, 1e-3, 100.0, "mm");
  require_positive("LED power", o.leds.power_W, "W");
  require_in_range("readout bins", o.readout.bins, 0, 10000, "");
  require_in_range("readout half range", o.readout.half_range * 1e3, 1e-3, 1000.0, "mm");
  require_in_range("least sideways part of a visible normal", o.readout.min_abs_nx, 0.0, 1.0, "");
  require_in_range("carrier albedo", o.carrier_albedo, 0.0, 1.0, "");
  if (const auto* white = std::get_if<Lambertian>(&o.touched))
    require_in_range("albedo of a tool that wets the pad", white->albedo, 0.0, 1.0, "");
  if (const auto* mirror = std::get_if<Mirror>(&o.touched))
    require_in_range("reflectance of a tool that wets the pad", mirror->reflectance, 0.0, 1.0, "");
}

}  // namespace lumo

#endif

// ---- lumo/morphology/stem_faces.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_STEM_FACES_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_STEM_FACES_HPP

namespace lumo {

/// A stretch along y of the top of a stem on which the silicone lies, between two recesses or the stem's ends [m].
struct Ridge {
  double low, high;
};

/// Stretches of the recesses' floors between ridges, low and high end along y [m].
inline std::vector<std::array<double, 2>> recess_floors(const std::vector<Ridge>& ridges) {
  std::vector<std::array<double, 2>> floors;
  for (std::size_t k = 0; k + 1 < ridges.size(); ++k) floors.push_back({ridges[k].high, ridges[k + 1].low});
  return floors;
}

/// A stem on which silicone lies, with edges of one radius [m].
struct FreeStem {
  double half_width, half_length, height;
  double floor;  ///< height of the floors between ridges
  std::vector<Ridge> ridges;
  double edge_radius;
};

namespace detail {

/// Collects carrier faces; those without area are left out.
struct FaceList {
  std::vector<RigidFace>& faces;
  SurfaceOptics optics;

  void add(std::string name, std::vector<Vec3d> corners) const {
    Vec3d area = Vec3d::Zero();
    for (std::size_t k = 1; k + 1 < corners.size(); ++k)
      area += (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]);
    if (area.norm() > 1e-12) faces.push_back({std::move(name), std::move(corners), optics});  // [m²]
  }
  /// The face and its image at negative x.
  void add_pair(const std::string& name, std::vector<Vec3d> corners) const {
    std::vector<Vec3d> image(corners);
    std::reverse(image.begin() + 1, image.end());
    for (Vec3d& p : image) p.x() = -p.x();
    add(name + " +x", std::move(corners));
    add(name + " -x", std::move(image));
  }
};

// A rounded edge between two faces as chords: how far each point is from the sharp edge along the first face, and how
// far behind that face. Chords lie inside the edge: silicone that rests on it does not cross them.
inline std::array<std::array<double, 2>, 3> rounded_edge(double radius) {
  const double middle = (1.0 - std::sqrt(0.5)) * radius;
  return {{{radius, 0.0}, {middle, middle}, {0.0, radius}}};
}

// How far behind its sharp end a ridge meets a floor that lies `depth` below its top.
inline double ridge_foot(double radius, double depth) {
  const auto edge = rounded_edge(radius);
  for (std::size_t k = 0; k + 1 < edge.size(); ++k)
    if (edge[k + 1][1] > depth) {
      const double t = (depth - edge[k][1]) / (edge[k + 1][1] - edge[k][1]);
      return edge[k][0] + t * (edge[k + 1][0] - edge[k][0]);
    }
  return 0.0;
}

// One end of a ridge; `side`: −1 the low one, 1 the high one. An end of the stem goes down to its base, one at a recess
// to the floor.
inline void add_ridge_end(const FaceList& list, const FreeStem& stem, const Ridge& ridge, double side) {
  const double r = stem.edge_radius, w = stem.half_width, inner = w - r, h = stem.height;
  const double end = side < 0.0 ? ridge.low : ridge.high;
  const bool outer = std::abs(end) >= stem.half_length - 1e-9;
  const double bottom = outer ? 0.0 : stem.floor, side_bottom = outer ? 0.0 : stem.floor - r;
  const auto edge = rounded_edge(r);
  // Lit from outside: the order of corners that holds at the high end is turned round at the low one.
  const auto turned = [&](std::vector<Vec3d> corners) {
    if (side < 0.0) std::reverse(corners.begin() + 1, corners.end());
    return corners;
  };
  const auto across = [&](const std::string& name, double y0, double z0, double y1, double z1) {
    list.add(name, turned({{-inner, y0, z0}, {inner, y0, z0}, {inner, y1, z1}, {-inner, y1, z1}}));
  };
  for (std::size_t k = 0; k + 1 < edge.size(); ++k) {
    const double z0 = h - edge[k][1], z1 = std::max(h - edge[k + 1][1], bottom);
    if (z0 <= bottom) break;
    const double y1 = h - edge[k + 1][1] < bottom ? ridge_foot(r, h - bottom) : edge[k + 1][0];
    across(outer ? "stem edge" : "recess wall", end - side * edge[k][0], z0, end - side * y1, z1);
  }
  if (h - r > bottom) across(outer ? "stem end" : "recess wall", end, h - r, end, bottom);

  // The corner: an eighth of a sphere, and the upright edge below it. Towards a recess half of that is in the floor.
  const Vec3d middle(inner, end - side * r, h - r);
  const auto at = [&](double x, double y, double z) { return Vec3d(middle + r * Vec3d(x, side * y, z).normalized()); };
  const Vec3d top = at(0, 0, 1), right = at(1, 0, 0), front = at(0, 1, 0), top_right = at(1, 0, 1),
              top_front = at(0, 1, 1), right_front = at(1, 1, 0);
  const auto triangle = [&](const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    list.add_pair("stem corner", turned({a, b, c}));
  };
  triangle(top, top_right, top_front);
  triangle(top_right, right, right_front);
  triangle(top_right, right_front, top_front);
  triangle(top_front, right_front, front);
  const auto upright = [&](const Vec3d& a, const Vec3d& b) {
    list.add_pair("stem edge", turned({{a.x(), a.y(), side_bottom}, {b.x(), b.y(), side_bottom}, b, a}));
  };
  upright(right, right_front);
  if (outer) upright(right_front, front);
}

// Its ridges, the floors between them, and its sides; rounded edges as chords.
inline void add_free_stem(const FaceList& list, const FreeStem& stem) {
  const double r = stem.edge_radius, w = stem.half_width, inner = w - r, h = stem.height, l = stem.half_length - r;
  const auto edge = rounded_edge(r);
  const auto level = [&](const char* name, double y0, double y1, double z) {
    list.add(name, {{-inner, y0, z}, {inner, y0, z}, {inner, y1, z}, {-inner, y1, z}});
  };
  const auto long_edge = [&](double y0, double y1, double z) {
    for (std::size_t k = 0; k + 1 < edge.size(); ++k) {
      const double x0 = w - edge[k][0], z0 = z - edge[k][1], x1 = w - edge[k + 1][0], z1 = z - edge[k + 1][1];
      list.add_pair("stem edge", {{x1, y0, z1}, {x1, y1, z1}, {x0, y1, z0}, {x0, y0, z0}});
    }
  };
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, stem.floor - r}, {w, -l, stem.floor - r}});
  for (const Ridge& ridge : stem.ridges) {
    const double y0 = ridge.low + r, y1 = ridge.high - r;
    level("ridge", y0, y1, h);
    long_edge(y0, y1, h);
    list.add_pair("ridge side", {{w, y0, stem.floor - r}, {w, y1, stem.floor - r}, {w, y1, h - r}, {w, y0, h - r}});
    for (const double side : {-1.0, 1.0}) add_ridge_end(list, stem, ridge, side);
  }
  const double foot = ridge_foot(r, h - stem.floor);
  for (const auto& [from, to] : recess_floors(stem.ridges)) {
    level("recess floor", from - foot, to + foot, stem.floor);
    long_edge(from - r, to + r, stem.floor);
  }
}

}  // namespace detail
}  // namespace lumo

#endif

// ---- lumo/morphology/finger_carrier.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_CARRIER_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_CARRIER_HPP

namespace lumo {

/// Where the LEDs lie along the finger [m].
inline std::vector<double> led_places(const FingerOptions::Leds& leds) {
  std::vector<double> y;
  for (int k = 0; k < leds.count; ++k) y.push_back((k - 0.5 * (leds.count - 1)) * leds.pitch);
  return y;
}

/// Ridges of a stem; one if it has no recesses.
inline std::vector<Ridge> stem_ridges(const FingerOptions& o) {
  const double half = 0.5e-3 * o.pad.length;
  std::vector<Ridge> ridges{{-half, half}};
  if (o.recess.depth > 0.0)
    for (const double y : led_places(o.leds)) {
      ridges.back().high = y - 0.5 * o.recess.length_y;
      ridges.push_back({y + 0.5 * o.recess.length_y, half});
    }
  return ridges;
}

/// Lengths of a finger's carrier [m].
struct StemLengths {
  double stem, outer, lip, height, half_length;
  double floor;  ///< height of the recesses' floors

  StemLengths(const HalfSection& s, const FingerOptions& o)
      : stem(0.5e-3 * s.design.w_s),
        outer(stem + 1e-3 * s.design.w_v),
        lip(1e-3 * s.pad.lip_end()),
        height(1e-3 * s.design.h_s),
        half_length(0.5e-3 * s.pad.length),
        floor(height - o.recess.depth) {}
};

/// The carrier's boxes. Throws InvalidArgument where a stem's edges cannot be as round as asked for.
inline std::vector<RigidBox> carrier_boxes(const HalfSection& s, const FingerOptions& o) {
  if (s.twin == Twin::unsupported_base || s.twin == Twin::held_top) return {};
  const StemLengths at(s, o);
  const double back = -1e-3 * s.pad.carrier_height;
  const auto box = [&](double x, double y0, double y1, double z0, double z1) {
    return RigidBox{{0, 0.5 * (y0 + y1), 0.5 * (z0 + z1)}, {x, 0.5 * (y1 - y0), 0.5 * (z1 - z0)}};
  };
  std::vector<RigidBox> boxes{box(at.lip, -at.half_length, at.half_length, back, 0.0)};
  if (s.twin == Twin::bonded_base) return boxes;
  const double low = s.pad.stem == Stem::bonded ? 0.5 * back : back;  // inside the block
  if (s.pad.stem == Stem::bonded || o.recess.depth == 0.0) {
    boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.height));
  } else {
    boxes.push_back(box(at.stem, -at.half_length, at.half_length, low, at.floor));
    for (const Ridge& ridge : stem_ridges(o)) boxes.push_back(box(at.stem, ridge.low, ridge.high, low, at.height));
  }
  if (s.lies_on_stem())
    for (std::size_t k = 1; k < boxes.size(); ++k) {
      boxes[k].edge_radius = o.stem_edge_radius;
      require_in_range(
          "radius of a free stem's edges", o.stem_edge_radius * 1e3, 0.0, boxes[k].half.minCoeff() * 1e3, "mm");
    }
  return boxes;
}

namespace detail {

// Faces of a bonded stem beside voids.
inline void add_bonded_stem(const FaceList& list, const StemLengths& at, bool capped) {
  const double w = at.stem, l = at.half_length, h = at.height;
  list.add_pair("stem", {{w, -l, 0}, {w, l, 0}, {w, l, h}, {w, -l, h}});
  if (capped) list.add("stem end", {{w, l, 0}, {-w, l, 0}, {-w, l, h}, {w, l, h}});
}

// The end of the block, at which a solid cap looks.
inline void add_block_end(const FaceList& list, const StemLengths& at, double shoulder) {
  const double y = at.half_length;
  list.add("block end", {{at.lip, y, shoulder}, {-at.lip, y, shoulder}, {-at.lip, y, 0}, {at.lip, y, 0}});
}

}  // namespace detail

/// Faces of the carrier that light meets through air.
inline std::vector<RigidFace> carrier_faces(const HalfSection& s, const FingerOptions& o) {
  const StemLengths at(s, o);
  std::vector<RigidFace> faces;
  const detail::FaceList list{faces, Lambertian{o.carrier_albedo}};
  const double l = at.half_length;
  if (!has_stem(s.twin) || (!s.lies_on_stem() && s.design.w_v <= 0.0)) return faces;
  const bool capped = s.pad.cap_length > 0.0;
  if (s.lies_on_stem())
    detail::add_free_stem(list, {at.stem, l, at.height, at.floor, stem_ridges(o), o.stem_edge_radius});
  else detail::add_bonded_stem(list, at, capped);
  list.add_pair("base", {{at.stem, -l, 0}, {at.outer, -l, 0}, {at.outer, l, 0}, {at.stem, l, 0}});
  if (capped) detail::add_block_end(list, at, -1e-3 * s.pad.shoulder_height);
  return faces;
}

}  // namespace lumo

#endif

// ---- lumo/morphology/finger.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_FINGER_HPP

namespace lumo {

/// The whole finger of a feasible design as a body. The quarter x ≥ 0, y ≥ 0 of a pad without a cap is described, the
/// half x ≥ 0 of one with a cap; the rest is mirrored. Throws InfeasibleDesign or InvalidArgument. Source: paper §III-A
/// and Table I.
inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& options = {});

namespace detail {

inline Patch finger_patch(SectionTag tag, const HalfSection& s, const FingerOptions& o) {
  const bool supported = s.twin != Twin::unsupported_base;
  const double w = 0.5e-3 * s.pad.width, hs = 1e-3 * s.design.h_s, stem = 0.5e-3 * s.design.w_s;
  const SurfaceOptics wall = Lambertian{o.carrier_albedo};
  const bool mouth = o.readout.by_direction;  // light out of the cavity is seen, too
  switch (tag) {
    case SectionTag::stem_top: return {"stem_top", Plane{{0, 0, hs}, -Vec3d::UnitZ()}, true, false, false, wall};
    case SectionTag::stem_side: return {"stem_side", Plane{{stem, 0, 0}, -Vec3d::UnitX()}, true, false, false, wall};
    case SectionTag::base:
      return {"base", Plane{{0, 0, std::min(0.0, s.z[0])}, -Vec3d::UnitZ()}, supported, false, false, wall};
    case SectionTag::shoulder_wall:
      return {"shoulder_wall", Plane{{1e-3 * s.pad.lip_end(), 0, 0}, -Vec3d::UnitX()}, supported, false, false, wall};
    case SectionTag::shoulder_top:
      return {
          "shoulder_top", Plane{{0, 0, -1e-3 * s.pad.shoulder_height}, -Vec3d::UnitZ()}, supported, false, false, wall};
    case SectionTag::void_inner:
      return {"void_inner", Plane{{stem, 0, 0}, Vec3d::UnitX()}, false, false, false, Dielectric{}, mouth};
    case SectionTag::void_roof:
      return {"void_roof", Plane{{0, 0, hs}, -Vec3d::UnitZ()}, false, false, supported, Dielectric{}, mouth};
    case SectionTag::void_wall:
      return {"void_wall", Plane{{stem + 1e-3 * s.design.w_v, 0, 0}, -Vec3d::UnitX()}, false, false, supported,
          Dielectric{}, mouth};
    case SectionTag::side: return {"side", Plane{{w, 0, 0}, Vec3d::UnitX()}, false, true, false, Dielectric{}};
    default:
      return {"dome", EllipticCylinder{{0, 0, 1e-3 * s.design.h_fp}, w, 1e-3 * s.design.h_ep}, false, true, false,
          Dielectric{}};
  }
}

inline void add_light(Body& body, const HalfSection& s, const Silicone& silicone, const FingerOptions& o) {
  body.medium = silicone.medium();
  if (!has_stem(s.twin)) return;
  const auto& led = o.leds;
  const double stem = 0.5e-3 * s.design.w_s, height = 1e-3 * s.design.h_s;
  const Vec3d along(0, 0.5 * led.length_y, 0);
  const double recess = s.lies_on_stem() ? o.recess.depth : 0.0;
  for (const double y : led_places(led)) {
    if (led.place == FingerOptions::Leds::Place::top) {
      body.emitters.push_back(RectangleEmitter{
          {0, y, height - recess}, {0.5 * led.width_x, 0, 0}, along, led.power_W / led.count, 0, recess > 0.0});
      continue;
    }
    const bool air = s.design.w_v > 0.0;
    require_in_range("height of the LEDs on the stem's sides", led.width_x * 1e3, 1e-3, s.design.h_s, "mm");
    for (const double side : {1.0,
             -1.0})  // in air, with the face that stands back (OpticalScene::Config::carrier_gap_m), but in front of it
      body.emitters.push_back(RectangleEmitter{{side * (stem - (air ? 10e-6 : 0.0)), y, 0.5 * height}, along,
          {0, 0, side * 0.5 * led.width_x}, 0.5 * led.power_W / led.count, 0, air});
  }
  const auto r = o.readout;
  body.film_closes_m = o.recess.film_closes;
  body.touched = o.touched;
  body.regions = r.bins;
  body.regions_in_space = r.in_space;
  std::vector<int> other_end;
  for (int b = 0; b < r.bins; ++b) other_end.push_back(r.bins - 1 - b);
  body.region_image_y = other_end;
  if (r.one_side && r.by_direction) body.seen_towards = Vec3d::UnitX();
  body.region = [r](const Vec3d& p, const Vec3d& n) {
    const bool turned_away = (r.one_side ? n.x() : std::abs(n.x())) < r.min_abs_nx;
    if ((turned_away && !r.by_direction) || std::abs(p.y()) > r.half_range) return -1;
    const double bin = (p.y() + r.half_range) / (2.0 * r.half_range) * r.bins;
    return std::clamp(int(bin), 0, r.bins - 1);
  };
}

// Boundary of a sector that is swept along y, and its patches by what the section's edges are.
class SweptBoundary {
 public:
  SweptBoundary(Body& body, const HalfSection& section, const FingerOptions& options)
      : body_(body), section_(section), options_(options) {}

  int vertex(double x, double y, double z) {
    body_.vertices.emplace_back(x, y, z);
    return int(body_.vertices.size()) - 1;
  }
  void facet(std::vector<int> loop, int patch) { body_.facets.push_back({std::move(loop), patch}); }
  int patch(SectionTag tag) {
    if (tag == SectionTag::mirror) return Body::mirror_patch;
    int& patch = patch_of_[std::size_t(tag)];
    if (patch < 0) patch = add(finger_patch(tag, section_, options_));
    return patch;
  }
  int add(Patch p) {
    body_.patches.push_back(std::move(p));
    return int(body_.patches.size()) - 1;
  }

 private:
  Body& body_;
  const HalfSection& section_;
  const FingerOptions& options_;
  std::vector<int> patch_of_ = std::vector<int>(std::size_t(SectionTag::dome) + 1, -1);
};

inline Patch end_face(const char* name, double y, double outwards, const FingerOptions& o) {
  return {name, Plane{{0, y, 0}, outwards * Vec3d::UnitY()}, o.bonded_ends || o.twin == Twin::unsupported_base, false,
      false, Dielectric{}};
}

// The sector of a pad whose section is the same all along: a quarter where the body is symmetric in y, else a half.
inline void sweep_prism(Body& body, const HalfSection& s, const FingerOptions& o) {
  SweptBoundary boundary(body, s, o);
  const double from = body.symmetry.y ? 0.0 : 1e-3 * o.pad.proximal_end(), to = 1e-3 * o.pad.distal_end();
  const std::size_t n = s.x.size();
  std::vector<int> near, far;
  for (std::size_t k = 0; k < n; ++k) {
    near.push_back(boundary.vertex(s.x[k], from, s.z[k]));
    far.push_back(boundary.vertex(s.x[k], to, s.z[k]));
  }
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t next = (k + 1) % n;
    boundary.facet({near[k], far[k], far[next], near[next]}, boundary.patch(s.tag[k]));
  }
  boundary.facet(near, body.symmetry.y ? Body::mirror_patch : boundary.add(end_face("proximal_end", from, -1.0, o)));
  boundary.facet(
      {far.rbegin(), far.rend()}, boundary.add(end_face(body.symmetry.y ? "end" : "distal_end", to, 1.0, o)));
}

// Lines of vertices on a cavity's roof, from its proximal end to its distal one, broken at the edges of ridges; empty
// on a stem that holds the silicone.
struct RoofSeams {
  std::vector<int> axis, stem;  // x = 0, and above the stem's edge
  bool at_wall(int first_of_wall) const { return stem.front() == first_of_wall; }
};

// `axis` and `wall`: vertices at both ends of the roof's edges.
inline RoofSeams add_seams(SweptBoundary& boundary, const HalfSection& s, const FingerOptions& o,
    const std::array<int, 2>& axis, const std::array<int, 2>& wall) {
  if (!s.lies_on_stem()) return {};
  const StemLengths at(s, o);
  const bool ends_at_wall = at.outer <= at.stem;
  std::vector<double> breaks;
  for (const auto& [low, high] : recess_floors(stem_ridges(o))) breaks.insert(breaks.end(), {low, high});
  RoofSeams seams{{axis[0]}, {ends_at_wall ? wall[0] : boundary.vertex(at.stem, -at.half_length, at.height)}};
  for (const double y : breaks) {
    seams.axis.push_back(boundary.vertex(0.0, y, at.height));
    seams.stem.push_back(boundary.vertex(at.stem, y, at.height));
  }
  seams.axis.push_back(axis[1]);
  seams.stem.push_back(ends_at_wall ? wall[1] : boundary.vertex(at.stem, at.half_length, at.height));
  return seams;
}

// A roof cut along its seams; `loop` is that of the whole: near and far end at the axis, far and near end at the wall.
inline void add_roof(SweptBoundary& boundary, const RoofSeams& seams, const std::vector<int>& loop, int patch) {
  for (std::size_t i = 0; i + 1 < seams.axis.size(); ++i)
    boundary.facet({seams.axis[i], seams.axis[i + 1], seams.stem[i + 1], seams.stem[i]}, patch);
  if (seams.at_wall(loop[3])) return;
  std::vector<int> beside(seams.stem);
  beside.insert(beside.end(), {loop[2], loop[3]});
  boundary.facet(beside, patch);
}

// The half of a pad with a solid cap. Points of the section inside its outline end where the cap begins, those of the
// outline go on.
inline void sweep_capped_half(Body& body, const HalfSection& s, const HalfSection& cap, const FingerOptions& o) {
  SweptBoundary boundary(body, s, o);
  const double from = 1e-3 * o.pad.proximal_end(), joint = 0.5e-3 * o.pad.length, to = 1e-3 * o.pad.distal_end();
  const int n = int(s.x.size());
  const auto place = [&](SectionTag tag) { return int(std::find(s.tag.begin(), s.tag.end(), tag) - s.tag.begin()); };
  const int side = place(SectionTag::side);
  std::vector<int> near, far;  // vertices of each point
  for (int k = 0; k < n; ++k) {
    const double x = s.x[std::size_t(k)], z = s.z[std::size_t(k)];
    near.push_back(boundary.vertex(x, from, z));
    far.push_back(boundary.vertex(x, k < side ? joint : to, z));
  }
  const int low_joint = boundary.vertex(0.0, joint, cap.z[0]), low_end = boundary.vertex(0.0, to, cap.z[0]);
  const RoofSeams seams = add_seams(boundary, s, o, {near[0], far[0]}, {near[1], far[1]});
  for (int k = 0; k + 1 < n; ++k) {
    const std::size_t i = std::size_t(k);
    std::vector<int> loop{near[i], far[i]};
    if (k + 1 == side) loop.insert(loop.end(), {low_joint, low_end});  // this plane goes on under the cap
    loop.insert(loop.end(), {far[i + 1], near[i + 1]});
    if (!seams.stem.empty() && k == 0) add_roof(boundary, seams, loop, boundary.patch(s.tag[i]));
    else if (!seams.stem.empty() && k == 1 && seams.at_wall(near[1])) {
      loop.insert(loop.begin() + 1, seams.stem.begin() + 1, seams.stem.end() - 1);
      boundary.facet(loop, boundary.patch(s.tag[i]));
    } else boundary.facet(loop, boundary.patch(s.tag[i]));
  }

  // The cap's wall: against cavity and stem, and, where the carrier is a stair, against its block.
  const int base = place(SectionTag::base), wall = boundary.add({"cap_wall", Plane{{0, joint, 0}, -Vec3d::UnitY()},
                                                false, false, true, Dielectric{}, o.readout.by_direction});
  const bool stair = cap.z[0] < 0.0;
  const int corner = stair ? boundary.vertex(0.0, joint, 0.0) : low_joint;
  std::vector<int> upper{corner};
  for (int k = base; k >= 0; --k) {
    if (k == 0 && !seams.stem.empty() && !seams.at_wall(near[1])) upper.push_back(seams.stem.back());
    upper.push_back(far[std::size_t(k)]);
  }
  boundary.facet(upper, wall);
  std::vector<int> mirror{near[std::size_t(n - 1)], far[std::size_t(n - 1)], low_end, low_joint};
  if (stair) {
    const int block = boundary.add({"cap_block", Plane{{0, joint, 0}, -Vec3d::UnitY()}, false, false, false,
        Dielectric{}, o.readout.by_direction});
    std::vector<int> lower{low_joint};
    for (int k = side - 1; k >= base; --k) lower.push_back(far[std::size_t(k)]);
    lower.push_back(corner);
    boundary.facet(lower, block);
    mirror.push_back(corner);
  }
  mirror.push_back(far[0]);
  if (!seams.axis.empty()) mirror.insert(mirror.end(), seams.axis.rbegin() + 1, seams.axis.rend() - 1);
  mirror.push_back(near[0]);
  boundary.facet(mirror, Body::mirror_patch);

  if (!seams.stem.empty() && !seams.at_wall(near[1])) near.insert(near.begin() + 1, seams.stem.front());
  boundary.facet(near, boundary.add(end_face("proximal_end", from, -1.0, o)));
  std::vector<int> distal;
  for (int k = n - 1; k >= side; --k) distal.push_back(far[std::size_t(k)]);
  distal.push_back(low_end);
  boundary.facet(distal, boundary.add(end_face("distal_end", to, 1.0, o)));
}

// Distance from p to the nearest edge of the stem's top and of its recesses [m].
inline double distance_to_stem_edges(const Vec3d& p, const StemLengths& at, const std::vector<Ridge>& ridges) {
  const double x = std::abs(p.x()), beyond = std::max(0.0, x - at.stem);
  double least = std::numeric_limits<double>::infinity();
  const auto add = [&](double dx, double dy, double dz) {
    least = std::min(least, std::sqrt(dx * dx + dy * dy + dz * dz));
  };
  const double dz = p.z() - at.height;
  add(x - at.stem, std::max(0.0, std::abs(p.y()) - at.half_length), dz);
  for (const Ridge& r : ridges) {
    add(beyond, p.y() - r.low, dz);
    add(beyond, p.y() - r.high, dz);
  }
  return least;
}

inline Sizing finger_sizing(const Body& body, const HalfSection& s, const FingerOptions& o) {
  const auto mesh = o.mesh;
  std::vector<Shape> touchable;
  for (const Patch& p : body.patches)
    if (p.contactable && p.name == "dome") touchable.push_back(p.shape);
  Sizing sizing;
  sizing.stretch_y = mesh.stretch_y;
  const auto below_the_dome = [mesh, touchable](const Vec3d& p) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Shape& shape : touchable) depth = std::min(depth, (closest_point(shape, p) - p).norm());
    return std::min(mesh.contact_edge + mesh.growth * depth, mesh.coarsest_edge);
  };
  sizing.edge = below_the_dome;
  if (!has_stem(s.twin)) return sizing;

  const StemLengths at(s, o);
  const std::vector<Ridge> ridges = stem_ridges(o);
  if (s.lies_on_stem())
    sizing.edge = [mesh, below_the_dome, at](const Vec3d& p) {
      const double dx = std::max(0.0, std::abs(p.x()) - at.stem), dz = p.z() - at.height;
      return std::min(below_the_dome(p), mesh.support_edge + mesh.growth * std::hypot(dx, dz));
    };
  // What is high at the edges has to be resolved below the tool: pressure, or at the end of a bond stress.
  // The load spreads along the finger. A rounded edge is smooth, and coarser elements are near enough.
  const bool rounded = s.lies_on_stem();
  const double edge = rounded ? mesh.stem_edge : mesh.seam_edge, growth = (rounded ? 1.5 : 1.0) * mesh.growth,
               growth_along = (rounded ? 0.5 : 0.25) * mesh.growth;
  sizing.edge_under_touch = [edge, growth, growth_along, at, ridges](const Vec3d& p, const Vec3d& touch) {
    const double along = std::max(0.0, std::abs(p.y() - touch.y()) - at.height);
    return edge + growth * distance_to_stem_edges(p, at, ridges) + growth_along * along;
  };
  return sizing;
}

}  // namespace detail

inline Body finger(const FingerDesign& design, const Silicone& silicone, const FingerOptions& o) {
  validate(o);
  validate(silicone);
  const Chords chords{o.mesh.contact_edge, o.mesh.max_turn_rad, o.mesh.shortest_chord};
  const HalfSection s = half_section(design, o.twin, chords, o.pad);
  const bool capped = o.pad.cap_length > 0.0;
  if (capped && detail::has_soft_stem(o.twin))
    throw InvalidArgument(message("twin ", to_string(o.twin), " of a pad with a cap of ", o.pad.cap_length,
        " mm is not known, only of one without"));
  Body body;
  body.name = "finger";
  body.symmetry = {true, !capped};
  body.exact_volume_m3 = 4.0 * s.exact_area_m2() * (0.5e-3 * o.pad.length);
  body.pivot = {0, 0, o.pivot == TiltPivot::flat_top ? 1e-3 * s.design.h_fp : 0.0};
  body.carrier = carrier_boxes(s, o);
  body.rigid_faces = carrier_faces(s, o);
  detail::add_light(body, s, silicone, o);
  if (capped) {
    const HalfSection cap = cap_section(design, o.twin, chords, o.pad);
    body.exact_volume_m3 += 2.0 * cap.exact_area_m2() * 1e-3 * o.pad.cap_length;
    if (has_stem(o.twin)) detail::sweep_capped_half(body, s, cap, o);
  }
  if (!capped || o.twin == Twin::held_top) detail::sweep_prism(body, s, o);
  body.sizing = detail::finger_sizing(body, s, o);
  return body;
}

}  // namespace lumo

#endif

// ---- lumo/morphology/measured_lobe.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_MEASURED_LOBE_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_MEASURED_LOBE_HPP

namespace lumo {

/// Intensity against the angle from an axis, as data sheets give it, in any unit; linear in the angle's cosine between
/// entries, 0 beyond the last.
class LobeTable {
 public:
  /// `angles_rad` ascend from 0 to at most π, `relative` intensities ≥ 0 are not all 0. Throws InvalidArgument.
  LobeTable(const std::vector<double>& angles_rad, std::vector<double> relative);

  /// Share of the power per solid angle [1/sr]; its integral over all directions is 1.
  double density(double cosine) const;
  /// Cosine of the angle below which the share `u` of the power lies: the inverse of a distribution that is quadratic
  /// between entries.
  double cosine(double u) const;

 private:
  std::vector<double> cosine_, density_, below_;  ///< descending; [1/sr]; share of the power up to each entry
};

/// A round flat emitter, or a point where the radius is 0, with a measured lobe.
struct MeasuredLobe {
  LobeTable lobe;
  Vec3d center{0.0, 0.0, 0.0};     ///< [m]
  Vec3d direction{0.0, 0.0, 1.0};  ///< unit, of the lobe's axis
  double radius_m = 0.0;
  double power_W = 1.0;
  int channel = 0;  ///< colour channel

  Vec3d axis() const { return direction; }
  Vec3d point(double u, double v) const { return on_disc(center, direction, radius_m, u, v); }
  Polar polar(double u) const {
    const double c = lobe.cosine(u);
    return {std::sqrt(std::max(0.0, 1.0 - c * c)), c};
  }
  double intensity(double cosine) const { return power_W * lobe.density(cosine); }
  MeasuredLobe mirrored(const Vec3d& m) const {
    return {lobe, m.cwiseProduct(center), m.cwiseProduct(direction), radius_m, power_W, channel};
  }
};

inline void validate(const MeasuredLobe& e) {
  require_in_range("radius of a measured lobe", e.radius_m * 1e3, 0.0, 1e3, "mm");
}

static_assert(EmitterModel<MeasuredLobe>);

inline LobeTable::LobeTable(const std::vector<double>& angles_rad, std::vector<double> relative)
    : density_(std::move(relative)) {
  const std::size_t n = angles_rad.size();
  if (n < 2 || density_.size() != n)
    throw InvalidArgument(
        message("lobe: ", n, " angles and ", density_.size(), " intensities, needs as many, at least 2"));
  if (angles_rad[0] != 0.0)
    throw InvalidArgument(message("lobe: the first angle is ", angles_rad[0], " rad, must be 0 rad"));
  for (std::size_t k = 0; k < n; ++k) {
    require_in_range(
        "angle of a lobe", angles_rad[k], k > 0 ? angles_rad[k - 1] + 1e-9 : 0.0, pi * (1.0 + 1e-12), "rad");
    require_in_range("intensity of a lobe", density_[k], 0.0, 1e300, "");
    cosine_.push_back(std::cos(angles_rad[k]));
  }
  below_.assign(n, 0.0);
  for (std::size_t k = 1; k < n; ++k)
    below_[k] = below_[k - 1] + pi * (density_[k - 1] + density_[k]) * (cosine_[k - 1] - cosine_[k]);
  const double all = below_.back();
  require_positive("intensity of a lobe, summed over its angles,", all, "");
  for (double& d : density_) d /= all;
  for (double& b : below_) b /= all;
}

inline double LobeTable::density(double c) const {
  if (!(c >= cosine_.back())) return 0.0;
  const auto next =
      std::lower_bound(cosine_.begin() + 1, cosine_.end() - 1, c, std::greater<>());  // first entry with a cosine ≤ c
  const std::size_t k = std::size_t(next - cosine_.begin());
  const double t = (cosine_[k - 1] - std::min(c, cosine_[k - 1])) / (cosine_[k - 1] - cosine_[k]);
  return density_[k - 1] + t * (density_[k] - density_[k - 1]);
}

inline double LobeTable::cosine(double u) const {
  const auto next = std::upper_bound(below_.begin() + 1, below_.end() - 1, u);
  const std::size_t k = std::size_t(next - below_.begin());
  const double width = cosine_[k - 1] - cosine_[k], a = density_[k - 1], b = density_[k];
  // 2π width (a t + (b − a) t²/2) = what is left of u: the root in [0, 1], in the form that does not cancel.
  const double left = std::clamp(u - below_[k - 1], 0.0, below_[k] - below_[k - 1]) / (2.0 * pi * width);
  const double root = std::sqrt(std::max(0.0, a * a + 2.0 * (b - a) * left));
  const double t = a + root > 0.0 ? std::min(1.0, 2.0 * left / (a + root)) : 0.0;
  return cosine_[k - 1] - t * width;
}

}  // namespace lumo

#endif

// ---- lumo/morphology/profile.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_PROFILE_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_PROFILE_HPP

namespace lumo {

/// A corner of a flat profile, and the patch of the edge from it to the next corner (of the last one: to the first).
struct ProfileCorner {
  double across_m = 0.0;  ///< x, or the distance from the axis
  double z_m = 0.0;
  int patch = Body::mirror_patch;  ///< index into Body::patches
};

/// Corners on the arc of `radius_m` about (across_m, z_m) of `about`, from one angle to another, both ends included;
/// angles are from x to z. All edges of the arc and the one after it are of the patch of `about`.
inline std::vector<ProfileCorner> arc_profile(
    const ProfileCorner& about, double radius_m, double from_rad, double to_rad, int edges);

/// Where a section ends along y, and the patches there; at y = 0 of a body that is symmetric in y: mirror_patch.
struct SectionEnds {
  double low_m = 0.0, high_m = 0.0;
  int low_patch = Body::mirror_patch, high_patch = Body::mirror_patch;
};

/// Adds to the body the closed boundary of what a section in (x, z), swept along y, fills. The section is a simple
/// polygon, counter-clockwise with x to the right and z up. One facet for each edge, and one for each end, as
/// SweptMesher wants it. Throws InvalidArgument for a section that is none, and for patches that the body does not
/// have.
inline void add_extruded(Body& body, const std::vector<ProfileCorner>& section, const SectionEnds& ends);

/// Adds to the body the closed boundary of what a profile in (distance from the z axis, z), turned about that axis,
/// fills; of the sector that Body::symmetry leaves. Counter-clockwise with the distance to the right and z up: either
/// from the axis to the axis (the patch of the last corner means nothing), or, for a ring, clear of it. Each edge
/// becomes `edges_per_quarter` flat facets a quarter turn; one that is level and starts or ends on the axis becomes one
/// facet. Vertices lie on the surfaces of revolution, and exactly in the planes of symmetry. Throws InvalidArgument as
/// above.
inline void add_revolved(Body& body, const std::vector<ProfileCorner>& profile, int edges_per_quarter = 8);

namespace detail {

inline void require_profile(const Body& body, const std::vector<ProfileCorner>& corners) {
  if (corners.size() < 3)
    throw InvalidArgument(message("profile: ", corners.size(), " corners, at least 3 are needed"));
  double area = 0.0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const ProfileCorner &a = corners[k], &b = corners[(k + 1) % corners.size()];
    if (!std::isfinite(a.across_m) || !std::isfinite(a.z_m))
      throw InvalidArgument(message("profile: corner ", k, " is not finite"));
    if (a.patch != Body::mirror_patch && (a.patch < 0 || std::size_t(a.patch) >= body.patches.size()))
      throw InvalidArgument(message("profile: corner ", k, " names patch ", a.patch, ", the body has patches 0 to ",
          int(body.patches.size()) - 1));
    area += 0.5 * (a.across_m * b.z_m - b.across_m * a.z_m);
  }
  if (!(area > 0.0))
    throw InvalidArgument(message("profile: its area is ", area * 1e6,
        " mm2, must be > 0 mm2: corners run counter-clockwise, with x or the distance to the right and z up"));
}

inline int add_vertex(Body& body, const Vec3d& at) {
  body.vertices.push_back(at);
  return int(body.vertices.size()) - 1;
}

// Directions about the z axis of the sector that a symmetry leaves, from its first plane to its last; exact where they
// lie in a plane.
inline std::vector<std::array<double, 2>> sector_directions(Symmetry symmetry, int per_quarter) {
  const int first = symmetry.x && !symmetry.y ? -1 : 0;  // quarter turn at which the sector starts
  const int quarters = symmetry.x && symmetry.y ? 1 : symmetry.x || symmetry.y ? 2 : 4;
  std::vector<std::array<double, 2>> directions;
  for (int i = 0; i <= quarters * per_quarter; ++i) {
    const int quarter = first + i / per_quarter, part = i % per_quarter;
    const double angle = 0.5 * pi * part / per_quarter, c = part == 0 ? 1.0 : std::cos(angle),
                 s = part == 0 ? 0.0 : std::sin(angle);
    const std::array<std::array<double, 2>, 4> turned{{{c, s}, {-s, c}, {-c, -s}, {s, -c}}};
    directions.push_back(turned[std::size_t(quarter + 4) % 4]);
  }
  if (quarters == 4) directions.pop_back();
  return directions;
}

// The boundary of a solid of revolution.
class Revolution {
 public:
  Revolution(Body& body, const std::vector<ProfileCorner>& profile, int per_quarter)
      : body_(body), profile_(profile), directions_(sector_directions(body.symmetry, per_quarter)) {
    closed_ = !body.symmetry.x && !body.symmetry.y;
    double largest = 0.0;
    for (const ProfileCorner& c : profile) largest = std::max(largest, c.across_m);
    for (const ProfileCorner& c : profile) on_axis_.push_back(std::abs(c.across_m) <= 1e-12 * largest);
    require_axis();
    for (std::size_t k = 0; k < profile.size(); ++k) {
      std::vector<int> ring;
      for (const auto& [x, y] : directions_) {
        if (!on_axis_[k]) ring.push_back(add_vertex(body, Vec3d(x * at(k), y * at(k), profile[k].z_m)));
        else if (ring.empty() && !(closed_ && ends_disc(k)))
          ring.push_back(add_vertex(body, Vec3d(0.0, 0.0, profile[k].z_m)));
      }
      rings_.push_back(std::move(ring));
    }
  }

  void add() {
    const std::size_t edges = profile_.size() - (on_axis_[0] ? 1 : 0);
    for (std::size_t k = 0; k < edges; ++k) {
      const std::size_t next = (k + 1) % profile_.size();
      if (is_disc(k, next)) add_disc(k, next);
      else add_band(k, next);
    }
    if (closed_) return;
    std::vector<int> start, end;  // the profile in both planes of the sector
    for (const std::vector<int>& ring : rings_) {
      start.push_back(ring.front());
      end.insert(end.begin(), ring.back());
    }
    body_.facets.push_back({start, Body::mirror_patch});
    body_.facets.push_back({end, Body::mirror_patch});
  }

 private:
  double at(std::size_t k) const { return profile_[k].across_m; }
  bool is_disc(std::size_t k, std::size_t next) const {
    return (on_axis_[k] || on_axis_[next]) && profile_[k].z_m == profile_[next].z_m;
  }
  // The middle of a whole disc is no vertex: no facet would have it.
  bool ends_disc(std::size_t k) const { return k == 0 ? is_disc(0, 1) : is_disc(k - 1, k); }
  void require_axis() const {
    const std::size_t last = profile_.size() - 1;
    for (std::size_t k = 0; k <= last; ++k) {
      if (!on_axis_[k] && !(at(k) > 0.0))
        throw InvalidArgument(
            message("profile: corner ", k, " is ", at(k) * 1e3, " mm from the axis, must be >= 0 mm"));
      const bool end = k == 0 || k == last;
      if (on_axis_[k] != (end && on_axis_[0]))
        throw InvalidArgument(message("profile: corner ", k, " lies ", on_axis_[k] ? "on" : "off",
            " the axis; the first and the last do, or none"));
    }
    for (std::size_t k = 0; k <= last; ++k)
      if (profile_[k].patch == Body::mirror_patch && !(k == last && on_axis_[0]))
        throw InvalidArgument(message("profile: corner ", k, " names no patch of the body"));
  }
  int vertex(std::size_t k, std::size_t direction) const {
    return on_axis_[k] ? rings_[k][0] : rings_[k][direction % directions_.size()];
  }
  void add_band(std::size_t k, std::size_t next) {
    const std::size_t steps = directions_.size() - (closed_ ? 0 : 1);
    for (std::size_t i = 0; i < steps; ++i) {
      std::vector<int> loop{vertex(k, i)};
      if (!on_axis_[k]) loop.push_back(vertex(k, i + 1));
      if (!on_axis_[next]) loop.push_back(vertex(next, i + 1));
      loop.push_back(vertex(next, i));
      body_.facets.push_back({loop, profile_[k].patch});
    }
  }
  void add_disc(std::size_t k, std::size_t next) {
    std::vector<int> loop = rings_[on_axis_[k] ? next : k];
    if (on_axis_[k]) std::reverse(loop.begin(), loop.end());
    if (!closed_) loop.push_back(rings_[on_axis_[k] ? k : next][0]);
    body_.facets.push_back({loop, profile_[k].patch});
  }

  Body& body_;
  const std::vector<ProfileCorner>& profile_;
  std::vector<std::array<double, 2>> directions_;
  bool closed_ = false;  ///< all the way round
  std::vector<bool> on_axis_;
  std::vector<std::vector<int>> rings_;  ///< vertices of each corner, one for each direction; on the axis one
};

}  // namespace detail

inline std::vector<ProfileCorner> arc_profile(
    const ProfileCorner& about, double radius_m, double from_rad, double to_rad, int edges) {
  require_in_range("edges of an arc", edges, 1, 10000, "");
  require_positive("radius of an arc", radius_m, "m");
  std::vector<ProfileCorner> corners;
  for (int i = 0; i <= edges; ++i) {
    const double angle = (from_rad * (edges - i) + to_rad * i) / edges;
    corners.push_back(
        {about.across_m + radius_m * std::cos(angle), about.z_m + radius_m * std::sin(angle), about.patch});
  }
  return corners;
}

inline void add_extruded(Body& body, const std::vector<ProfileCorner>& section, const SectionEnds& ends) {
  detail::require_profile(body, section);
  if (!(ends.low_m < ends.high_m))
    throw InvalidArgument(
        message("section from y = ", ends.low_m * 1e3, " mm to ", ends.high_m * 1e3, " mm, must be longer than 0 mm"));
  std::vector<int> low, high;
  for (const ProfileCorner& c : section) {
    low.push_back(detail::add_vertex(body, Vec3d(c.across_m, ends.low_m, c.z_m)));
    high.push_back(detail::add_vertex(body, Vec3d(c.across_m, ends.high_m, c.z_m)));
  }
  for (std::size_t k = 0; k < section.size(); ++k) {
    const std::size_t next = (k + 1) % section.size();
    body.facets.push_back({{low[k], high[k], high[next], low[next]}, section[k].patch});
  }
  body.facets.push_back({low, ends.low_patch});
  body.facets.push_back({{high.rbegin(), high.rend()}, ends.high_patch});
}

inline void add_revolved(Body& body, const std::vector<ProfileCorner>& profile, int edges_per_quarter) {
  require_in_range("edges of a quarter turn", edges_per_quarter, 1, 10000, "");
  detail::require_profile(body, profile);
  detail::Revolution(body, profile, edges_per_quarter).add();
}

}  // namespace lumo

#endif

// ---- lumo/morphology/round_shapes.hpp
#ifndef SINGLE_INCLUDE_LUMO_MORPHOLOGY_ROUND_SHAPES_HPP
#define SINGLE_INCLUDE_LUMO_MORPHOLOGY_ROUND_SHAPES_HPP

namespace lumo {

// Shapes of revolution and the ellipsoid. Of each the body is inside, or, with `hole`, around it: then the normal
// points into the hole.

/// The cylinder of `radius` [m] about the line through `point` along the unit vector `axis`; it has no ends.
struct CylinderShape {
  Vec3d point{0.0, 0.0, 0.0};  ///< [m]
  Vec3d axis{0.0, 0.0, 1.0};
  double radius = 1.0;
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// The cone from `apex` that opens along the unit vector `axis`, on that side only; `half_angle_rad` between axis and
/// surface. At the apex the normal is one of many.
struct ConeShape {
  Vec3d apex{0.0, 0.0, 0.0};  ///< [m]
  Vec3d axis{0.0, 0.0, 1.0};
  double half_angle_rad = 0.25 * pi;
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// The ellipsoid about `center` with half axes `semi` along x, y and z [m].
struct EllipsoidShape {
  Vec3d center{0.0, 0.0, 0.0};
  Vec3d semi{1.0, 1.0, 1.0};
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// The torus about `center`: a tube of radius `tube` [m] whose middle is the circle of radius `ring` [m] across the
/// unit vector `axis`. A round edge is a quarter of it, a fillet a quarter with `hole`.
struct TorusShape {
  Vec3d center{0.0, 0.0, 0.0};  ///< [m]
  Vec3d axis{0.0, 0.0, 1.0};
  double ring = 2.0, tube = 1.0;
  bool hole = false;

  Vec3d closest_point(const Vec3d& p) const;
  Vec3d normal(const Vec3d& p) const;
};

/// Throw InvalidArgument for an axis whose length is not 1, a length that is not positive, a cone's angle out of
/// [0.1, 89.9] degrees, and a tube that is thicker than its ring.
inline void validate(const CylinderShape& s) {
  require_unit("axis of a cylinder", s.axis);
  require_positive("radius of a cylinder", s.radius, "m");
}
inline void validate(const ConeShape& s) {
  require_unit("axis of a cone", s.axis);
  require_in_range("half angle of a cone", s.half_angle_rad * 180.0 / pi, 0.1, 89.9, "deg");
}
inline void validate(const EllipsoidShape& s) {
  for (Eigen::Index k = 0; k < 3; ++k) require_positive("half axis of an ellipsoid", s.semi[k], "m");
}
inline void validate(const TorusShape& s) {
  require_unit("axis of a torus", s.axis);
  require_positive("radius of a torus' tube", s.tube, "m");
  require_positive("radius of a torus' ring", s.ring, "m");
  if (!(s.tube <= s.ring))
    throw InvalidArgument(
        message("radius of a torus' tube is ", s.tube, " m, at most that of its ring, ", s.ring, " m"));
}

namespace detail {

// A point as it lies about an axis.
struct AboutAxis {
  double along, aside;
  Vec3d out;  ///< unit, from the axis to the point; of points on the axis any

  AboutAxis(const Vec3d& from_origin, const Vec3d& axis) : along(axis.dot(from_origin)) {
    const Vec3d across = from_origin - along * axis;
    aside = across.norm();
    Vec3d t1, t2;
    tangents(axis, t1, t2);
    out = aside > 0.0 ? Vec3d(across / aside) : t1;
  }
};

}  // namespace detail

inline Vec3d CylinderShape::closest_point(const Vec3d& p) const {
  const detail::AboutAxis at(p - point, axis);
  return point + at.along * axis + radius * at.out;
}
inline Vec3d CylinderShape::normal(const Vec3d& p) const {
  return (hole ? -1.0 : 1.0) * detail::AboutAxis(p - point, axis).out;
}

inline Vec3d ConeShape::closest_point(const Vec3d& p) const {
  const detail::AboutAxis at(p - apex, axis);
  const double c = std::cos(half_angle_rad), s = std::sin(half_angle_rad);
  return apex + std::max(0.0, c * at.along + s * at.aside) * (c * axis + s * at.out);
}
inline Vec3d ConeShape::normal(const Vec3d& p) const {
  const detail::AboutAxis at(p - apex, axis);
  return (hole ? -1.0 : 1.0) * (std::cos(half_angle_rad) * at.out - std::sin(half_angle_rad) * axis);
}

// After Eberly, "Distance from a Point to an Ellipsoid" (2013), as EllipticCylinder does in the plane: the root of a
// convex, falling function by Newton's method in a bracket. Half axes are in units of the least.
inline Vec3d EllipsoidShape::closest_point(const Vec3d& p) const {
  Eigen::Index least = 0;
  semi.minCoeff(&least);
  const Vec3d q = (p - center).cwiseAbs();
  Vec3d r, excess, z;  // squared ratio of half axes, what it has over 1, and the place in units of the half axis
  for (Eigen::Index k = 0; k < 3; ++k) {
    r[k] = (semi[k] / semi[least]) * (semi[k] / semi[least]);
    excess[k] = r[k] - 1.0;
    z[k] = q[k] / semi[k];
  }
  const auto sum = [&](double t, double& slope) {
    double squares = 0.0;
    slope = 0.0;
    for (Eigen::Index k = 0; k < 3; ++k)
      if (z[k] > 0.0) {
        const double w = r[k] * z[k] / (t + excess[k]);
        squares += w * w;
        slope += w * w / (t + excess[k]);
      }
    return squares;
  };
  double low = z[least], high = Vec3d(r.cwiseProduct(z)).norm(), t = 0.0, slope = 0.0;
  // Without a part along the least axis the root may lie beyond the pole at t = 0: then the foot leaves the plane.
  if (low > 0.0 || !(sum(0.0, slope) <= 1.0)) {
    t = std::clamp(1.0, low, high);
    for (int i = 0; i < 200; ++i) {
      const double over = sum(t, slope) - 1.0;
      (over > 0.0 ? low : high) = t;
      const double step = 0.5 * over / slope, next = t + step;
      const bool close = std::abs(step) <= 1e-9 * t;
      t = close || (next >= low && next <= high) ? next : 0.5 * (low + high);
      if (close || !(low < high)) break;
    }
  }
  Vec3d foot(0.0, 0.0, 0.0);
  double rest = 1.0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    if (z[k] > 0.0) foot[k] = r[k] * q[k] / (t + excess[k]);
    rest -= (foot[k] / semi[k]) * (foot[k] / semi[k]);
  }
  if (!(z[least] > 0.0)) foot[least] = semi[least] * std::sqrt(std::max(0.0, rest));
  for (Eigen::Index k = 0; k < 3; ++k) foot[k] = std::copysign(foot[k], p[k] - center[k]);
  return center + foot;
}
inline Vec3d EllipsoidShape::normal(const Vec3d& p) const {
  const Vec3d foot = closest_point(p) - center;
  return (hole ? -1.0 : 1.0) * foot.cwiseQuotient(semi.cwiseProduct(semi)).normalized();
}

inline Vec3d TorusShape::closest_point(const Vec3d& p) const {
  const detail::AboutAxis at(p - center, axis);
  return center + ring * at.out + (hole ? -tube : tube) * normal(p);
}
inline Vec3d TorusShape::normal(const Vec3d& p) const {
  const detail::AboutAxis at(p - center, axis);
  const Vec3d d = (at.aside - ring) * at.out + at.along * axis;
  const double length = d.norm();
  return (hole ? -1.0 : 1.0) * (length > 0.0 ? Vec3d(d / length) : axis);
}

static_assert(
    SurfaceShape<CylinderShape> && SurfaceShape<ConeShape> && SurfaceShape<EllipsoidShape> && SurfaceShape<TorusShape>);

}  // namespace lumo

#endif

// ---- lumo/mesh/tet_mesh.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_TET_MESH_HPP
#define SINGLE_INCLUDE_LUMO_MESH_TET_MESH_HPP

namespace lumo {

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
    if (!mesh.nodes[k].allFinite())
      throw MeshError(Reason::not_finite, message("mesh node ", k, " is not at a finite place"));
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

// ---- lumo/geometry/signed_distance.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_SIGNED_DISTANCE_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_SIGNED_DISTANCE_HPP

namespace lumo {

/// Where on a triangle abc a point is nearest to another, and on what of it.
struct TrianglePoint {
  Vec3d point{0.0, 0.0, 0.0};
  int feature = inside;  ///< corner a, b, c: 0, 1, 2; edge ab, bc, ca: 3, 4, 5; or
  static constexpr int inside = 6;
};

/// Point of the triangle abc nearest to p. Source: Ericson 2005, §5.1.5.
inline TrianglePoint closest_point(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, 0};
  const Vec3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, 1};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {a + d1 / (d1 - d3) * ab, 3};
  const Vec3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, 2};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {a + d2 / (d2 - d6) * ac, 5};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 >= d3 && d5 >= d6) return {b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), 4};
  const double scale = 1.0 / (va + vb + vc);
  return {a + vb * scale * ab + vc * scale * ac, TrianglePoint::inside};
}

inline Vec3d closest_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return closest_point(p, a, b, c).point;
}

/// Boxes about the triangles of a surface, for the distance to it. Own code: the promise is that lumo needs Eigen only.
class TriangleTree {
 public:
  explicit TriangleTree(const TriangleSurface& surface) {
    for (const auto& t : surface.triangles) {
      const auto at = [&](std::size_t k) -> const Vec3d& { return surface.vertices[std::size_t(t[k])]; };
      leaves_.push_back({{at(0), at(1), at(2)}, int(leaves_.size())});
    }
    if (!leaves_.empty()) build(0, int(leaves_.size()));
  }

  /// The place on the surface that is nearest to a point.
  struct Nearest {
    int triangle = -1;  ///< −1: there is none so near
    TrianglePoint at;
    double distance = std::numeric_limits<double>::infinity();  ///< unsigned [m]
  };

  /// Looks no farther than `near` [m] from p.
  Nearest nearest(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    Nearest best;
    double least = near * near;
    if (!nodes_.empty()) search(0, p, least, best);
    best.distance = std::sqrt(least);
    return best;
  }

  /// Unsigned distance [m] from p to the surface; `near` or more when it is farther than that.
  double distance(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    return nearest(p, near).distance;
  }

 private:
  struct Leaf {
    std::array<Vec3d, 3> corners;
    int triangle;
  };
  struct Node {
    std::array<double, 3> low{}, high{};  // corners of its box
    int first = 0, count = 0;             // leaves; count 0: the children are the next node and the one at `first`

    double squared_distance(const Vec3d& p) const {
      double sum = 0.0;
      for (std::size_t a = 0; a < 3; ++a) {
        const double off = std::max(std::max(low[a] - p[Eigen::Index(a)], p[Eigen::Index(a)] - high[a]), 0.0);
        sum += off * off;
      }
      return sum;
    }
  };

  int build(int begin, int end) {
    const int self = int(nodes_.size());
    Eigen::AlignedBox3d box;
    for (int i = begin; i < end; ++i)
      for (const Vec3d& corner : leaves_[std::size_t(i)].corners) box.extend(corner);
    const Vec3d low = box.min(), high = box.max();
    nodes_.push_back({{low[0], low[1], low[2]}, {high[0], high[1], high[2]}, begin, end - begin});
    if (end - begin <= 2) return self;
    int axis;
    box.sizes().maxCoeff(&axis);
    const auto middle = [&](const Leaf& t) { return t.corners[0][axis] + t.corners[1][axis] + t.corners[2][axis]; };
    const int half = (begin + end) / 2;
    std::nth_element(
        leaves_.begin() + begin, leaves_.begin() + half, leaves_.begin() + end, [&](const Leaf& a, const Leaf& b) {
          const double x = middle(a), y = middle(b);
          return x < y || (x == y && a.triangle < b.triangle);
        });
    build(begin, half);
    const int right = build(half, end);
    nodes_[std::size_t(self)].first = right;
    nodes_[std::size_t(self)].count = 0;
    return self;
  }

  void search(int self, const Vec3d& p, double& least, Nearest& best) const {
    const Node& n = nodes_[std::size_t(self)];
    if (n.count > 0) {
      for (int i = n.first; i < n.first + n.count; ++i) {
        const Leaf& t = leaves_[std::size_t(i)];
        const TrianglePoint on = closest_point(p, t.corners[0], t.corners[1], t.corners[2]);
        if (const double squared = (on.point - p).squaredNorm(); squared < least) {
          least = squared;
          best.triangle = t.triangle;
          best.at = on;
        }
      }
      return;
    }
    int near = self + 1, far = n.first;
    double to_near = nodes_[std::size_t(near)].squared_distance(p),
           to_far = nodes_[std::size_t(far)].squared_distance(p);
    if (to_far < to_near) {
      std::swap(near, far);
      std::swap(to_near, to_far);
    }
    if (to_near < least) search(near, p, least, best);
    if (to_far < least) search(far, p, least, best);
  }

  std::vector<Leaf> leaves_;
  std::vector<Node> nodes_;
};

/// Exact signed distance to a closed surface of triangles, negative inside. The sign is that of the outward direction
/// at the nearest place, with the normals of the triangles that meet there weighted by their angles. Source: Bærentzen
/// & Aanæs 2005. The surface must outlive it and be valid (unchecked). Of a point that is not finite, all is NaN.
class SignedDistance {
 public:
  explicit SignedDistance(const TriangleSurface& surface);

  /// Distance [m] with its first two derivatives; at the surface itself the gradient is the outward direction there.
  struct Sample {
    double distance;
    Vec3d gradient;
    Mat3d hessian;  ///< [1/m]
  };
  Sample sample(const Vec3d& p) const;

  /// Distance alone; `near`: a bound [m] that its size is known to keep.
  double distance(const Vec3d& p, double near = std::numeric_limits<double>::infinity()) const {
    const TriangleTree::Nearest n = tree_.nearest(p, near);
    if (n.triangle < 0) return p.allFinite() ? n.distance : std::numeric_limits<double>::quiet_NaN();
    return (p - n.at.point).dot(outward(n)) < 0.0 ? -n.distance : n.distance;
  }

 private:
  struct Normals {
    Vec3d own{0.0, 0.0, 0.0};
    std::array<Vec3d, 3> at_edge;  // sums with the neighbour's; by TrianglePoint's edges
  };

  const Vec3d& corner(const std::array<int, 3>& t, std::size_t k) const {
    return surface_->vertices[std::size_t(t[k])];
  }
  const Vec3d& outward(const TriangleTree::Nearest& n) const {
    const Normals& own = normals_[std::size_t(n.triangle)];
    if (n.at.feature == TrianglePoint::inside) return own.own;
    if (n.at.feature > 2) return own.at_edge[std::size_t(n.at.feature) - 3];
    return at_corner_[std::size_t(surface_->triangles[std::size_t(n.triangle)][std::size_t(n.at.feature)])];
  }

  const TriangleSurface* surface_;
  TriangleTree tree_;
  std::vector<Normals> normals_;
  std::vector<Vec3d> at_corner_;
};

inline SignedDistance::SignedDistance(const TriangleSurface& surface)
    : surface_(&surface),
      tree_(surface),
      normals_(surface.triangles.size()),
      at_corner_(surface.vertices.size(), Vec3d::Zero()) {
  std::map<std::pair<int, int>, Vec3d> at_edge;
  const auto edge = [&](const std::array<int, 3>& t, std::size_t k) -> Vec3d& {
    return at_edge.try_emplace(std::minmax(int(t[k]), int(t[(k + 1) % 3])), Vec3d::Zero()).first->second;
  };
  for (std::size_t i = 0; i < normals_.size(); ++i) {
    const auto& t = surface.triangles[i];
    const Vec3d n = (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).normalized();
    normals_[i].own = n;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3d forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
      at_corner_[std::size_t(t[k])] += std::atan2(forth.cross(back).norm(), forth.dot(back)) * n;
      edge(t, k) += n;
    }
  }
  for (std::size_t i = 0; i < normals_.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) normals_[i].at_edge[k] = edge(surface.triangles[i], k);
}

inline SignedDistance::Sample SignedDistance::sample(const Vec3d& p) const {
  const TriangleTree::Nearest n = tree_.nearest(p);
  if (n.triangle < 0) {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    return {none, Vec3d::Constant(none), Mat3d::Constant(none)};
  }
  const Vec3d &out = outward(n), way = p - n.at.point;
  const double sign = way.dot(out) < 0.0 ? -1.0 : 1.0;
  Sample s{sign * n.distance, out.normalized(), Mat3d::Zero()};
  // A way that is as short as what rounding leaves of it has no direction.
  const double rounding = 8.0 * std::numeric_limits<double>::epsilon() * p.cwiseAbs().maxCoeff();
  if (n.at.feature == TrianglePoint::inside || !(n.distance > rounding)) return s;
  s.gradient = way / s.distance;
  // A plane's distance is straight, an edge's bends across it, a corner's all around.
  Mat3d turning = Mat3d::Identity() - s.gradient * s.gradient.transpose();
  if (n.at.feature > 2) {
    const auto& t = surface_->triangles[std::size_t(n.triangle)];
    const std::size_t k = std::size_t(n.at.feature) - 3;
    const Vec3d along = (corner(t, (k + 1) % 3) - corner(t, k)).normalized();
    turning -= along * along.transpose();
  }
  s.hessian = turning / s.distance;
  return s;
}

}  // namespace lumo

#endif

// ---- lumo/mesh/surface_mesh.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_SURFACE_MESH_HPP
#define SINGLE_INCLUDE_LUMO_MESH_SURFACE_MESH_HPP

namespace lumo {

/// Triangles of a surface as the shape of a patch. Normals turn evenly from corner to corner (Phong 1975); those of the
/// corners are the mean of the triangles about them, by angle (Thürmer & Wüthrich 1998).
class TriangleShape {
 public:
  /// The triangles must have an area.
  explicit TriangleShape(const TriangleSurface& surface)
      : surface_(surface), tree_(surface), at_corner_(surface.vertices.size(), Vec3d::Zero()) {
    for (const auto& t : surface.triangles)
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d forth = corner(t, (k + 1) % 3) - corner(t, k), back = corner(t, (k + 2) % 3) - corner(t, k);
        const Vec3d n = forth.cross(back);
        at_corner_[std::size_t(t[k])] += std::atan2(n.norm(), forth.dot(back)) * n.normalized();
      }
    for (Vec3d& n : at_corner_) n = n.normalized();
  }

  Vec3d closest_point(const Vec3d& p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    return n.triangle < 0 ? p : n.at.point;
  }
  Vec3d normal(const Vec3d& p) const {
    const TriangleTree::Nearest n = tree_.nearest(p);
    if (n.triangle < 0) return p;
    const auto& t = surface_.triangles[std::size_t(n.triangle)];
    const Vec3d b = corner(t, 1) - corner(t, 0), c = corner(t, 2) - corner(t, 0), at = n.at.point - corner(t, 0);
    const Vec3d across = b.cross(c);
    const double u = at.cross(c).dot(across) / across.squaredNorm(), v = b.cross(at).dot(across) / across.squaredNorm();
    return ((1.0 - u - v) * at_corner_[std::size_t(t[0])] + u * at_corner_[std::size_t(t[1])] +
            v * at_corner_[std::size_t(t[2])])
        .normalized();
  }

 private:
  const Vec3d& corner(const std::array<int, 3>& t, std::size_t k) const { return surface_.vertices[std::size_t(t[k])]; }

  TriangleSurface surface_;
  TriangleTree tree_;
  std::vector<Vec3d> at_corner_;
};

static_assert(SurfaceShape<TriangleShape>);

/// Neighbours whose normals differ by more are parts of their own.
inline constexpr double crease_rad = 0.5;

/// Number of the part, from 0 on, that each triangle belongs to; parts are what creases divide.
inline std::vector<int> smooth_parts(const TriangleSurface& surface, double crease = crease_rad);

/// A closed surface, such as read_surface() gives, as a mesh without elements: Tracer lights it, and a press refuses
/// it. Faces are of the patches that surface_patches() makes. Throws MeshError as validate_surface does.
inline TetMesh surface_mesh(const TriangleSurface& surface, double crease = crease_rad);

/// A patch for each smooth part, "part 0" and so on, whose normals are those of the triangles. Tell them apart by their
/// shapes; those that are planes or spheres may be given them.
inline std::vector<Patch> surface_patches(const TriangleSurface& surface, double crease = crease_rad);

inline std::vector<int> smooth_parts(const TriangleSurface& surface, double crease) {
  validate_surface(surface);
  const std::size_t count = surface.triangles.size();
  std::vector<Vec3d> normal;
  for (const auto& t : surface.triangles) {
    const auto at = [&](std::size_t k) -> const Vec3d& { return surface.vertices[std::size_t(t[k])]; };
    normal.push_back(Vec3d(at(1) - at(0)).cross(at(2) - at(0)).normalized());
  }
  std::vector<std::size_t> root(count);
  std::iota(root.begin(), root.end(), std::size_t(0));
  const auto find = [&](std::size_t i) {
    for (; root[i] != i; i = root[i]) root[i] = root[root[i]];
    return i;
  };
  std::map<std::pair<int, int>, std::size_t> across;
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& t = surface.triangles[i];
      const auto [it, fresh] = across.try_emplace(std::minmax(int(t[k]), int(t[(k + 1) % 3])), i);
      if (fresh || normal[i].dot(normal[it->second]) < std::cos(crease)) continue;
      const std::size_t a = find(i), b = find(it->second);
      root[std::max(a, b)] = std::min(a, b);
    }
  std::map<std::size_t, int> number;
  std::vector<int> parts;
  for (std::size_t i = 0; i < count; ++i)
    parts.push_back(number.try_emplace(find(i), int(number.size())).first->second);
  return parts;
}

inline TetMesh surface_mesh(const TriangleSurface& surface, double crease) {
  const std::vector<int> parts = smooth_parts(surface, crease);
  TetMesh mesh;
  mesh.order = 1;
  mesh.nodes = surface.vertices;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& t = surface.triangles[i];
    mesh.faces.push_back({{t[0], t[1], t[2], -1, -1, -1}, parts[i]});
  }
  std::stable_sort(mesh.faces.begin(), mesh.faces.end(),
      [](const BoundaryFace& a, const BoundaryFace& b) { return a.patch < b.patch; });
  return mesh;
}

inline std::vector<Patch> surface_patches(const TriangleSurface& surface, double crease) {
  const std::vector<int> parts = smooth_parts(surface, crease);
  std::vector<TriangleSurface> part(std::size_t(1 + *std::max_element(parts.begin(), parts.end())));
  for (std::size_t i = 0; i < parts.size(); ++i) part[std::size_t(parts[i])].triangles.push_back(surface.triangles[i]);
  std::vector<Patch> patches(part.size());
  for (std::size_t k = 0; k < part.size(); ++k) {
    part[k].vertices = surface.vertices;
    drop_unused_vertices(part[k]);
    patches[k].name = "part " + std::to_string(k);
    patches[k].shape = TriangleShape(part[k]);
  }
  return patches;
}

}  // namespace lumo

#endif

// ---- lumo/geometry/polygon_refinement.hpp
#ifndef SINGLE_INCLUDE_LUMO_GEOMETRY_POLYGON_REFINEMENT_HPP
#define SINGLE_INCLUDE_LUMO_GEOMETRY_POLYGON_REFINEMENT_HPP

namespace lumo {

/// A simple polygon filled with well-shaped triangles of wanted size: Delaunay refinement after Ruppert 1995. Signs of
/// areas are exact, so that every state is a valid triangulation; whether a circle holds a point is rounded, which
/// costs at most quality. Same input, same bits. Own code: CGAL's meshes are heavy, Triangle is not free, and a mapped
/// sweep cannot follow a wanted size.
class PolygonRefinement {
 public:
  static constexpr std::size_t most_points = 200'000;
  struct Triangle {
    std::array<int, 3> corners;  ///< counter-clockwise
    std::array<int, 3> across;   ///< the triangle on the other side of the edge opposite to each corner, or −1
  };
  /// A piece of the outline from one point to the next, and the edge of the polygon that it is part of.
  struct Piece {
    int from, to, edge;
  };

  /// The polygon counter-clockwise, its corners the first points; edge i runs from corner i to the next. nullopt if
  /// it is not simple.
  static std::optional<PolygonRefinement> of(const std::vector<Point2>& polygon);

  /// Adds points until no triangle's circumradius is above that of an equilateral triangle of the wanted edge length,
  /// nor above √2 times its shortest edge, as far as points do not come closer than a tenth of both the wanted length
  /// and the polygon's shortest edge. False: there would be too many.
  bool refine(const std::function<double(const Point2&)>& edge_length);

  const std::vector<Point2>& points() const { return points_; }
  const std::vector<Triangle>& triangles() const { return triangles_; }
  std::vector<Piece> outline() const;

 private:
  struct Circle {
    Point2 center;
    double radius, shortest_edge;
  };
  struct Place {
    int triangle;
    bool beyond;  ///< the outline is in between, at `side`
    int side;
  };

  const Point2& at(int point) const { return points_[std::size_t(point)]; }
  Triangle& triangle(int t) { return triangles_[std::size_t(t)]; }
  const Triangle& triangle(int t) const { return triangles_[std::size_t(t)]; }
  static double distance(const Point2& a, const Point2& b) { return std::hypot(b[0] - a[0], b[1] - a[1]); }
  static std::pair<int, int> key(int a, int b) { return std::minmax(a, b); }
  static int corner_of(const Triangle& t, int neighbour) {
    return int(std::find(t.across.begin(), t.across.end(), neighbour) - t.across.begin());
  }

  std::pair<int, int> ends(int t, int k) const {
    return {triangle(t).corners[std::size_t(k + 1) % 3], triangle(t).corners[std::size_t(k + 2) % 3]};
  }  // of the edge opposite to corner k
  Circle circle(const Triangle& t) const;
  bool in_circle(const Triangle& t, const Point2& p) const;
  Place walk(int from, const Point2& p) const;
  void reconnect(int neighbour, int before, int now);
  bool flip(int t, int k);
  void settle(int point, std::vector<int>& changed);
  std::optional<std::pair<int, int>> encroached(int t, const Point2& p) const;
  void insert(int t, const Point2& p, std::vector<int>& changed);
  void split_inside(int t, const Point2& p, std::vector<int>& changed);
  void split_edge(int t, int k, const Point2& p, std::vector<int>& changed);
  bool split_outline(int t, int k, double closest, std::vector<int>& changed);

  std::vector<Point2> points_;
  std::vector<Triangle> triangles_;
  std::map<std::pair<int, int>, int> edge_of_;  // pieces of the outline
  double shortest_given_ = 0.0;
};

inline auto PolygonRefinement::of(const std::vector<Point2>& polygon) -> std::optional<PolygonRefinement> {
  if (polygon.size() < 3 || outline_crosses(polygon)) return std::nullopt;
  PolygonRefinement r;
  r.points_ = polygon;
  std::vector<int> loop;
  const int n = int(polygon.size());
  r.shortest_given_ = distance(polygon.back(), polygon.front());
  for (int i = 0; i < n; ++i) {
    loop.push_back(i);
    r.edge_of_[key(i, (i + 1) % n)] = i;
    r.shortest_given_ = std::min(r.shortest_given_, distance(r.at(i), r.at((i + 1) % n)));
  }
  std::vector<Vec3d> corners;
  for (const Point2& p : polygon) corners.emplace_back(p[0], p[1], 0.0);
  const auto cut = PolygonTriangles(corners, Vec3d(0, 0, 1)).cut(loop, {});
  if (!cut) return std::nullopt;
  std::map<std::pair<int, int>, std::pair<int, int>> waiting;  // directed edge → triangle and corner opposite
  for (const auto& ear : *cut) {
    const int t = int(r.triangles_.size());
    r.triangles_.push_back({ear, {-1, -1, -1}});
    for (int k = 0; k < 3; ++k) {
      const auto [a, b] = r.ends(t, k);
      if (const auto other = waiting.find({b, a}); other != waiting.end()) {
        r.triangle(t).across[std::size_t(k)] = other->second.first;
        r.triangle(other->second.first).across[std::size_t(other->second.second)] = t;
      }
      waiting[{a, b}] = {t, k};
    }
  }
  for (bool again = true; again;) {  // ears are cut as they come; a flip makes the least angle larger, so this ends
    again = false;
    for (int t = 0; t < int(r.triangles_.size()); ++t)
      for (int k = 0; k < 3; ++k) again = r.flip(t, k) || again;
  }
  return r;
}

inline auto PolygonRefinement::circle(const Triangle& t) const -> Circle {
  const Point2 &a = at(t.corners[0]), &b = at(t.corners[1]), &c = at(t.corners[2]);
  const double bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
  const double bb = bx * bx + by * by, cc = cx * cx + cy * cy, twice = 2.0 * (bx * cy - by * cx);
  const double x = (cy * bb - by * cc) / twice, y = (bx * cc - cx * bb) / twice;
  return {{a[0] + x, a[1] + y}, std::hypot(x, y), std::min({std::sqrt(bb), std::sqrt(cc), distance(b, c)})};
}

/// Clearly inside, so that two triangles on one circle stay as they are.
inline bool PolygonRefinement::in_circle(const Triangle& t, const Point2& p) const {
  double rows[3][3];
  double size = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double x = at(t.corners[i])[0] - p[0], y = at(t.corners[i])[1] - p[1];
    rows[i][0] = x;
    rows[i][1] = y;
    rows[i][2] = x * x + y * y;
    size = std::max(size, rows[i][2]);
  }
  const auto minor = [&](int i, int j) { return rows[i][0] * rows[j][1] - rows[i][1] * rows[j][0]; };
  return rows[0][2] * minor(1, 2) + rows[1][2] * minor(2, 0) + rows[2][2] * minor(0, 1) > 1e-12 * size * size;
}

/// From triangle to triangle towards a point, as far as the outline allows.
inline auto PolygonRefinement::walk(int t, const Point2& p) const -> Place {
  for (std::size_t steps = 0; steps <= 4 * triangles_.size(); ++steps) {
    int next = -2, side = 0;
    for (int k = 0; k < 3 && next == -2; ++k)
      if (const auto [a, b] = ends(t, k); orient2d(at(a), at(b), p) < 0) {
        next = triangle(t).across[std::size_t(k)];
        side = k;
      }
    if (next == -2) return {t, false, 0};
    if (next == -1) return {t, true, side};
    t = next;
  }
  return {-1, false, 0};  // rounded circles may let a walk turn about
}

inline void PolygonRefinement::reconnect(int neighbour, int before, int now) {
  if (neighbour < 0) return;
  Triangle& n = triangle(neighbour);
  n.across[std::size_t(corner_of(n, before))] = now;
}

/// Exchanges the diagonal of the two triangles at the edge opposite to corner k, where that is better.
inline bool PolygonRefinement::flip(int t, int k) {
  const int other = triangle(t).across[std::size_t(k)];
  if (other < 0) return false;
  const int j = corner_of(triangle(other), t);
  const auto corner = [&](int of, int i) { return triangle(of).corners[std::size_t(i % 3)]; };
  const auto beyond = [&](int of, int i) { return triangle(of).across[std::size_t(i % 3)]; };
  const int apex = corner(t, k), a = corner(t, k + 1), b = corner(t, k + 2), far = corner(other, j);
  if (!in_circle(triangle(t), at(far)) || orient2d(at(apex), at(a), at(far)) <= 0 ||
      orient2d(at(apex), at(far), at(b)) <= 0)
    return false;
  // What lies across the four other edges; in `other` the common edge runs from b to a.
  const int b_apex = beyond(t, k + 1), apex_a = beyond(t, k + 2), a_far = beyond(other, j + 1),
            far_b = beyond(other, j + 2);
  triangle(t) = {{apex, a, far}, {a_far, other, apex_a}};
  triangle(other) = {{apex, far, b}, {far_b, b_apex, t}};
  reconnect(a_far, other, t);
  reconnect(b_apex, t, other);
  return true;
}

/// Lawson's flips around a new point.
inline void PolygonRefinement::settle(int point, std::vector<int>& changed) {
  for (std::size_t i = 0; i < changed.size(); ++i) {
    const auto& corners = triangle(changed[i]).corners;
    const auto found = std::find(corners.begin(), corners.end(), point);
    if (found == corners.end()) continue;
    const int k = int(found - corners.begin()), other = triangle(changed[i]).across[std::size_t(k)];
    if (!flip(changed[i], k)) continue;
    changed.push_back(changed[i]);
    changed.push_back(other);
  }
}

inline void PolygonRefinement::split_inside(int t, const Point2& p, std::vector<int>& changed) {
  const int point = int(points_.size()), second = int(triangles_.size()), third = second + 1;
  points_.push_back(p);
  const Triangle old = triangle(t);
  const auto [a, b, c] = old.corners;
  triangle(t) = {{point, b, c}, {old.across[0], second, third}};
  triangles_.push_back({{point, c, a}, {old.across[1], third, t}});
  triangles_.push_back({{point, a, b}, {old.across[2], t, second}});
  reconnect(old.across[1], t, second);
  reconnect(old.across[2], t, third);
  changed.insert(changed.end(), {t, second, third});
  settle(point, changed);
}

/// A point on the edge opposite to corner k; on the outline, too.
inline void PolygonRefinement::split_edge(int t, int k, const Point2& p, std::vector<int>& changed) {
  const int point = int(points_.size()), new_t = int(triangles_.size());
  points_.push_back(p);
  const auto corner = [&](int of, int i) { return triangle(of).corners[std::size_t(i % 3)]; };
  const auto beyond = [&](int of, int i) { return triangle(of).across[std::size_t(i % 3)]; };
  const int other = beyond(t, k), apex = corner(t, k), a = corner(t, k + 1), b = corner(t, k + 2),
            b_apex = beyond(t, k + 1), apex_a = beyond(t, k + 2);
  const int new_other = other < 0 ? -1 : new_t + 1;
  triangles_.push_back({{apex, point, b}, {other, b_apex, t}});
  reconnect(b_apex, t, new_t);
  if (other >= 0) {
    const int j = corner_of(triangle(other), t), far = corner(other, j), a_far = beyond(other, j + 1),
              far_b = beyond(other, j + 2);
    // `other` keeps the side of b, which lies against the new triangle.
    triangles_.push_back({{far, point, a}, {t, a_far, other}});
    reconnect(a_far, other, new_other);
    triangle(other) = {{far, b, point}, {new_t, new_other, far_b}};
    changed.insert(changed.end(), {other, new_other});
  }
  triangle(t) = {{apex, a, point}, {new_other, new_t, apex_a}};
  changed.insert(changed.end(), {t, new_t});
  if (const auto piece = edge_of_.find(key(a, b)); piece != edge_of_.end()) {
    const int edge = piece->second;
    edge_of_.erase(piece);
    edge_of_[key(a, point)] = edge_of_[key(point, b)] = edge;
  }
  settle(point, changed);
}

/// Halves the piece of the outline opposite to corner k, unless that brings points too close.
inline bool PolygonRefinement::split_outline(int t, int k, double closest, std::vector<int>& changed) {
  const auto [from, to] = ends(t, k);
  const Point2 a = at(from), b = at(to), apex = at(triangle(t).corners[std::size_t(k)]);
  if (0.5 * distance(a, b) < closest) return false;
  const Point2 middle{0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])};
  // The middle of a slanted edge is rounded: both halves must still face the apex.
  if (orient2d(apex, a, middle) <= 0 || orient2d(apex, middle, b) <= 0) return false;
  split_edge(t, k, middle, changed);
  return true;
}

/// The side of a triangle, if any, that is a piece of the outline and has the point in the circle about it: there the
/// point would leave a flat triangle. Looked for among the triangles that have the point in their circles, which hang
/// together about triangle t, where it lies.
inline std::optional<std::pair<int, int>> PolygonRefinement::encroached(int t, const Point2& p) const {
  std::vector<int> reached{t};
  for (std::size_t i = 0; i < reached.size(); ++i)
    for (int k = 0; k < 3; ++k) {
      const auto [a, b] = ends(reached[i], k);
      const int next = triangle(reached[i]).across[std::size_t(k)];
      if (next < 0) {
        if ((at(a)[0] - p[0]) * (at(b)[0] - p[0]) + (at(a)[1] - p[1]) * (at(b)[1] - p[1]) < 0.0)
          return std::pair(reached[i], k);
      } else if (in_circle(triangle(next), p) && std::find(reached.begin(), reached.end(), next) == reached.end()) {
        reached.push_back(next);
      }
    }
  return std::nullopt;
}

/// A point of the closed triangle.
inline void PolygonRefinement::insert(int t, const Point2& p, std::vector<int>& changed) {
  for (int k = 0; k < 3; ++k)
    if (const auto [a, b] = ends(t, k); orient2d(at(a), at(b), p) == 0) return split_edge(t, k, p, changed);
  split_inside(t, p, changed);
}

inline bool PolygonRefinement::refine(const std::function<double(const Point2&)>& edge_length) {
  std::vector<int> todo;
  for (int t = int(triangles_.size()); t-- > 0;) todo.push_back(t);
  std::vector<int> changed;
  while (!todo.empty()) {
    const int t = todo.back();
    todo.pop_back();
    const Circle round = circle(triangle(t));
    Point2 middle{};
    for (const int corner : triangle(t).corners) {
      middle[0] += at(corner)[0] / 3.0;
      middle[1] += at(corner)[1] / 3.0;
    }
    const double wanted = edge_length(middle);
    if (round.radius <= wanted / std::numbers::sqrt3 * 1.1 && round.radius <= std::numbers::sqrt2 * round.shortest_edge)
      continue;
    if (points_.size() >= most_points) return false;
    const double closest = 0.1 * std::min(wanted, shortest_given_);
    changed.clear();
    const Place place = walk(t, round.center);
    if (place.triangle < 0) continue;
    if (place.beyond) {
      split_outline(place.triangle, place.side, closest, changed);
    } else {
      if (const auto side = encroached(place.triangle, round.center))
        split_outline(side->first, side->second, closest, changed);
      else if (round.radius >= closest) insert(place.triangle, round.center, changed);
    }
    if (changed.empty()) continue;  // as good as the outline allows
    todo.push_back(t);
    todo.insert(todo.end(), changed.begin(), changed.end());
  }
  return true;
}

inline auto PolygonRefinement::outline() const -> std::vector<Piece> {
  std::vector<Piece> pieces;
  for (int t = 0; t < int(triangles_.size()); ++t)
    for (int k = 0; k < 3; ++k)
      if (const auto [a, b] = ends(t, k); triangle(t).across[std::size_t(k)] < 0)
        pieces.push_back({a, b, edge_of_.at(key(a, b))});
  return pieces;
}

}  // namespace lumo

#endif

// ---- lumo/mesh/fill_check.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_FILL_CHECK_HPP
#define SINGLE_INCLUDE_LUMO_MESH_FILL_CHECK_HPP

namespace lumo {

/// A mesher's raw answer, in plain numbers.
struct RawFill {
  std::vector<double> coordinates;   ///< 3 per vertex; the given vertices first, in order
  std::vector<std::int32_t> tets;    ///< 4 vertices each
  std::vector<std::int32_t> faces;   ///< 3 vertices of each boundary triangle, in any sense and order
  std::vector<std::int32_t> facets;  ///< for each face, the number of its facet + 1
};

/// Makes a LinearTets of a raw answer, whose coordinates times `scale` are the input's, and checks it against the
/// surface that was to be filled: finite, positive volumes, faces shared by two tetrahedra of opposite sense or on the
/// boundary, boundary faces on their facets, volume and area those of the input to 1e-6. Throws MeshError: crashed for
/// an answer that cannot be a mesh, inverted, open, not_manifold, or inaccurate.
inline LinearTets checked_fill(
    const MeshInput& input, const SurfaceReport& surface, const RawFill& raw, double scale = 1.0);

namespace detail {

/// A triangle with its corners in ascending order, for matching, and where it came from.
struct SortedFace {
  std::array<int, 3> key;
  int from;  ///< 4 × tetrahedron + corner opposite
  bool odd;  ///< sorting it was an odd permutation

  SortedFace(std::array<int, 3> corners, int source) : key(corners), from(source), odd(false) {
    const auto order = [this](std::size_t i, std::size_t j) {
      if (key[i] <= key[j]) return;
      std::swap(key[i], key[j]);
      odd = !odd;
    };
    order(0, 1);
    order(1, 2);
    order(0, 1);
  }
  bool operator<(const SortedFace& other) const { return key != other.key ? key < other.key : from < other.from; }
};

/// The steps of checked_fill, in order.
class FillCheck {
 public:
  explicit FillCheck(const MeshInput& input) : input_(input) {}

  void take_vertices(const RawFill& raw, double scale);
  double take_tets(const std::vector<std::int32_t>& tets);  ///< their volume
  void find_boundary(const RawFill& raw);
  double take_faces(double reach);  ///< their area; none is farther than `reach` off its facet
  LinearTets result() { return std::move(mesh_); }

 private:
  using Reason = MeshError::Reason;
  struct Boundary {
    int side, facet;
    auto operator<=>(const Boundary&) const = default;
  };
  const Vec3d& at(int i) const { return mesh_.vertices[std::size_t(i)]; }

  const MeshInput& input_;
  LinearTets mesh_;
  std::vector<SortedFace> sides_;   ///< of all tetrahedra
  std::vector<Boundary> boundary_;  ///< in the order of the tetrahedra, whatever the mesher's order was
};

inline void FillCheck::take_vertices(const RawFill& raw, double scale) {
  const std::size_t count = raw.coordinates.size() / 3, given = input_.vertices.size();
  if (count < given || raw.tets.size() < 4)
    throw MeshError(
        Reason::crashed, message("mesher returned ", count, " vertices and ", raw.tets.size() / 4, " tetrahedra"));
  mesh_.vertices.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double* c = &raw.coordinates[3 * i];
    const Vec3d point = scale * Vec3d(c[0], c[1], c[2]);
    if (!point.allFinite())
      throw MeshError(Reason::crashed, message("mesher returned vertex ", i, " that is not finite"));
    mesh_.vertices.push_back(point);
  }
  for (std::size_t i = 0; i < given; ++i)
    if (mesh_.vertices[i] != input_.vertices[i])
      throw MeshError(Reason::inaccurate, message("mesher moved the given vertex ", i));
}

inline double FillCheck::take_tets(const std::vector<std::int32_t>& tets) {
  const int count = int(mesh_.vertices.size());
  double volume = 0.0;
  sides_.reserve(tets.size());
  for (std::size_t i = 0; i + 3 < tets.size(); i += 4) {
    std::array<int, 4> tet{tets[i], tets[i + 1], tets[i + 2], tets[i + 3]};
    if (!std::all_of(tet.begin(), tet.end(), [count](int v) { return v >= 0 && v < count; }))
      throw MeshError(Reason::crashed, message("mesher returned tetrahedron ", i / 4, " with a bad index"));
    double six = (at(tet[1]) - at(tet[0])).cross(at(tet[2]) - at(tet[0])).dot(at(tet[3]) - at(tet[0]));
    if (six < 0.0) {  // the mesher's sense of orientation need not be ours
      std::swap(tet[2], tet[3]);
      six = -six;
    }
    if (!(six > 0.0))
      throw MeshError(Reason::inverted, message("tetrahedron ", i / 4, " has volume ", six / 6.0, ", must be > 0"));
    volume += six / 6.0;
    const int number = int(mesh_.tets.size());
    for (int k = 0; k < 4; ++k) {
      const auto& [a, b, c] = outward_faces[std::size_t(k)];
      sides_.emplace_back(
          std::array<int, 3>{tet[std::size_t(a)], tet[std::size_t(b)], tet[std::size_t(c)]}, 4 * number + k);
    }
    mesh_.tets.push_back(tet);
  }
  return volume;
}

inline void FillCheck::find_boundary(const RawFill& raw) {
  std::sort(sides_.begin(), sides_.end());
  std::vector<SortedFace> named;
  for (std::size_t i = 0; i < raw.facets.size() && 3 * i + 2 < raw.faces.size(); ++i)
    named.emplace_back(std::array<int, 3>{raw.faces[3 * i], raw.faces[3 * i + 1], raw.faces[3 * i + 2]}, raw.facets[i]);
  std::sort(named.begin(), named.end());
  for (std::size_t i = 0; i < sides_.size();) {
    const SortedFace& side = sides_[i];
    std::size_t end = i + 1;
    while (end < sides_.size() && sides_[end].key == side.key) ++end;
    if (end - i > 2 || (end - i == 2 && side.odd == sides_[i + 1].odd))
      throw MeshError(Reason::not_manifold,
          message("tetrahedron ", side.from / 4, " overlaps its neighbour ", sides_[i + 1].from / 4));
    if (end - i == 1) {
      const auto found = std::lower_bound(
          named.begin(), named.end(), side, [](const SortedFace& a, const SortedFace& b) { return a.key < b.key; });
      if (found == named.end() || found->key != side.key || found->from < 1 || found->from > int(input_.facets.size()))
        throw MeshError(Reason::open, message("a boundary face of tetrahedron ", side.from / 4, " lies on no facet"));
      boundary_.push_back({side.from, found->from - 1});
    }
    i = end;
  }
  std::sort(boundary_.begin(), boundary_.end());
}

inline double FillCheck::take_faces(double reach) {
  std::vector<Vec3d> normals;
  for (const Facet& facet : input_.facets) normals.push_back(polygon_normal(input_.vertices, facet.loop).normalized());
  double area = 0.0;
  for (const auto& [side, number] : boundary_) {
    const auto& tet = mesh_.tets[std::size_t(side / 4)];
    const auto& [a, b, c] = outward_faces[std::size_t(side % 4)];
    const std::array<int, 3> face{tet[std::size_t(a)], tet[std::size_t(b)], tet[std::size_t(c)]};
    area += 0.5 * (at(face[1]) - at(face[0])).cross(at(face[2]) - at(face[0])).norm();
    const Facet& facet = input_.facets[std::size_t(number)];
    for (int vertex : face)
      if (const double height = std::abs(normals[std::size_t(number)].dot(at(vertex) - at(facet.loop[0])));
          height > reach)
        throw MeshError(Reason::inaccurate,
            message("boundary vertex ", vertex, " is ", height, " off facet ", number, ", at most ", reach));
    mesh_.faces.push_back(face);
    mesh_.patches.push_back(facet.patch);
  }
  return area;
}

}  // namespace detail

inline LinearTets checked_fill(const MeshInput& input, const SurfaceReport& surface, const RawFill& raw, double scale) {
  constexpr double tolerance = 1e-6;  // relative
  detail::FillCheck check(input);
  check.take_vertices(raw, scale);
  const double volume = check.take_tets(raw.tets);
  check.find_boundary(raw);
  const double area = check.take_faces(tolerance * (surface.high - surface.low).norm());
  const auto compare = [](const char* what, double value, double wanted, const char* unit) {
    if (!(std::abs(value - wanted) <= tolerance * wanted))
      throw MeshError(MeshError::Reason::inaccurate, message("mesh ", what, " is ", value, ", the surface's is ",
                                                         wanted, ", may differ by 1e-6 relative [unit", unit, "]"));
  };
  compare("volume", volume, surface.volume, "^3");
  compare("area", area, surface.area, "^2");
  return check.result();
}

}  // namespace lumo

#endif

// ---- lumo/mesh/swept_mesher.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_SWEPT_MESHER_HPP
#define SINGLE_INCLUDE_LUMO_MESH_SWEPT_MESHER_HPP

namespace lumo {

/// Fills prisms along y, such as a finger's quarter, without any foreign library: the section is triangulated by
/// Delaunay refinement, swept along y in layers, and each triangular prism cut into three tetrahedra. Where edges grow
/// away from a place of touch, layers and section are as fine as the finest wish along them: it takes several times the
/// elements that an unstructured mesh does.
struct SweptMesher {
  /// The same input gives the same bits. Throws MeshError: degenerate for a surface that is no prism along y, with two
  /// flat ends and one quadrilateral for each edge of its section, or one with holes, interior points or
  /// `keep_surface`.
  LinearTets fill(const MeshInput& input) const;

  static constexpr int samples = 64;  ///< along y, at which a point of the section is asked for its wanted edge length
  static constexpr std::size_t most_layers = 10'000, most_vertices = 5'000'000;  ///< against wishes too short
};

static_assert(Mesher<SweptMesher>);

namespace detail {

/// A prism along y: its section as a polygon in (x, −z), counter-clockwise seen along −y from beyond `high`, and what
/// the input calls its parts.
struct Prism {
  double low = 0.0, high = 0.0;
  std::vector<Point2> section;
  std::vector<int> at_low, at_high;  ///< corner of the section → vertex
  std::vector<int> side;             ///< edge of the section → facet
  int low_end = -1, high_end = -1;   ///< facets
};

[[noreturn]] inline void refuse_prism(const std::string& why) {
  throw MeshError(MeshError::Reason::degenerate,
      message("swept mesher: ", why, "; the surface must be a prism along y with one facet on each side"));
}

inline Prism prism_of(const MeshInput& input, const SurfaceReport& surface) {
  Prism p;
  p.low = surface.low.y();
  p.high = surface.high.y();
  const auto at = [&](int v) -> const Vec3d& { return input.vertices[std::size_t(v)]; };
  const auto all_at = [&](const Facet& f, double y) {
    return std::all_of(f.loop.begin(), f.loop.end(), [&](int v) { return at(v).y() == y; });
  };
  if (input.keep_surface) refuse_prism("facets are to be kept whole");
  for (int f = 0; f < int(input.facets.size()); ++f)
    for (int* end : {&p.low_end, &p.high_end})
      if (all_at(input.facets[std::size_t(f)], end == &p.low_end ? p.low : p.high)) {
        if (*end >= 0) refuse_prism(message("facets ", *end, " and ", f, " lie in one end"));
        *end = f;
      }
  if (p.low_end < 0 || p.high_end < 0) refuse_prism("one of the ends is no facet");
  p.at_high = input.facets[std::size_t(p.high_end)].loop;
  const std::size_t n = p.at_high.size();
  if (input.facets.size() != n + 2 || input.vertices.size() != 2 * n)
    refuse_prism(message("an end has ", n, " edges, there are ", input.facets.size() - 2, " other facets and ",
        input.vertices.size(), " vertices"));
  std::map<std::pair<double, double>, int> below;
  for (const int v : input.facets[std::size_t(p.low_end)].loop) below[{at(v).x(), at(v).z()}] = v;
  std::map<std::pair<int, int>, int> edge;  // of the high end, directed → number
  for (std::size_t i = 0; i < n; ++i) {
    const int v = p.at_high[i];
    const auto under = below.find({at(v).x(), at(v).z()});
    if (under == below.end()) refuse_prism(message("vertex ", v, " has none opposite"));
    p.at_low.push_back(under->second);
    p.section.push_back({at(v).x(), -at(v).z()});
    edge[{v, p.at_high[(i + 1) % n]}] = int(i);
  }
  p.side.assign(n, -1);
  for (int f = 0; f < int(input.facets.size()); ++f) {
    if (f == p.low_end || f == p.high_end) continue;
    const std::vector<int>& loop = input.facets[std::size_t(f)].loop;
    for (std::size_t k = 0; k < loop.size() && loop.size() == 4; ++k)  // its edge at the high end runs the other way
      if (const auto found = edge.find({loop[(k + 1) % 4], loop[k]}); found != edge.end())
        p.side[std::size_t(found->second)] = f;
  }
  for (const int f : p.side)
    if (f < 0) refuse_prism("an edge of the section has no side of its own");
  return p;
}

/// Where layers meet, from 0 to 1: as thick as `thickness` wants at their place, evened out.
inline std::vector<double> layer_places(const std::vector<double>& thickness) {
  const std::size_t steps = thickness.size();  // of equal width, thickness in units of the whole
  std::vector<double> layers(steps + 1, 0.0);
  for (std::size_t i = 0; i < steps; ++i) layers[i + 1] = layers[i] + 1.0 / (double(steps) * thickness[i]);
  const double count = std::max(1.0, std::ceil(layers.back() - 1e-9));
  if (!(count <= double(SweptMesher::most_layers)))
    throw MeshError(
        MeshError::Reason::out_of_memory, message("swept mesher: ", count, " layers are wanted, at most 10000"));
  std::vector<double> places{0.0};
  std::size_t i = 0;
  for (double k = 1.0; k < count; k += 1.0) {
    const double want = layers.back() * k / count;
    while (layers[i + 1] < want) ++i;
    places.push_back((double(i) + (want - layers[i]) / (layers[i + 1] - layers[i])) / double(steps));
  }
  places.push_back(1.0);
  return places;
}

/// Wanted edge length at a point of the section and a place along y.
using SectionWish = std::function<double(const Point2& point, double y)>;

/// What one layer may be thick [share of the prism's length] at each of evenly spaced places along y.
inline std::vector<double> layer_thickness(
    const Prism& prism, const std::vector<Point2>& points, const SectionWish& wanted) {
  constexpr int places = 4 * SweptMesher::samples;
  const double length = prism.high - prism.low;
  std::vector<double> thickness;
  for (int i = 0; i < places; ++i) {
    double least = length;
    for (const Point2& p : points) least = std::min(least, wanted(p, prism.low + length * (i + 0.5) / places));
    thickness.push_back(least / length);
  }
  return thickness;
}

/// Points of the section in layers along y, and the tetrahedra between them.
class Sweep {
 public:
  Sweep(const Prism& prism, const PolygonRefinement& section, const std::vector<double>& places)
      : prism_(prism), section_(section), places_(places), count_(section.points().size()) {}

  RawFill fill(const MeshInput& input) {
    add_vertices(input);
    for (std::size_t layer = 0; layer + 1 < places_.size(); ++layer) add_layer(layer);
    for (const auto& [corners, across] : section_.triangles()) {
      const std::size_t last = places_.size() - 1;
      add_face({at(0, corners[0]), at(0, corners[1]), at(0, corners[2])}, prism_.low_end);
      add_face({at(last, corners[0]), at(last, corners[1]), at(last, corners[2])}, prism_.high_end);
    }
    return std::move(raw_);
  }

 private:
  std::int32_t at(std::size_t layer, int point) const { return vertex_[layer * count_ + std::size_t(point)]; }
  void add_vertex(const Vec3d& v) { raw_.coordinates.insert(raw_.coordinates.end(), {v.x(), v.y(), v.z()}); }
  void add_face(const std::array<std::int32_t, 3>& face, int facet) {
    raw_.faces.insert(raw_.faces.end(), face.begin(), face.end());
    raw_.facets.push_back(facet + 1);
  }
  void add_vertices(const MeshInput& input);
  void add_layer(std::size_t layer);

  const Prism& prism_;
  const PolygonRefinement& section_;
  const std::vector<double>& places_;
  std::size_t count_;                 ///< points of the section
  std::vector<std::int32_t> vertex_;  ///< of each point in each layer
  RawFill raw_;
};

/// Given vertices come first, as they were.
inline void Sweep::add_vertices(const MeshInput& input) {
  for (const Vec3d& v : input.vertices) add_vertex(v);
  const std::size_t given = prism_.section.size(), layers = places_.size();
  vertex_.assign(count_ * layers, -1);
  for (std::size_t layer = 0; layer < layers; ++layer)
    for (std::size_t i = 0; i < count_; ++i) {
      std::int32_t& v = vertex_[layer * count_ + i];
      if (i < given && layer == 0) {
        v = prism_.at_low[i];
      } else if (i < given && layer + 1 == layers) {
        v = prism_.at_high[i];
      } else {
        v = std::int32_t(raw_.coordinates.size() / 3);
        const double length = prism_.high - prism_.low;
        const double y = layer + 1 == layers ? prism_.high : prism_.low + length * places_[layer];
        add_vertex(Vec3d(section_.points()[i][0], y, -section_.points()[i][1]));
      }
    }
}

/// Each quadrilateral's diagonal leaves its point of lower number on one level and ends on the other; levels take
/// turns, so that no direction is preferred.
inline void Sweep::add_layer(std::size_t layer) {
  const std::size_t base = layer + layer % 2, top = layer + 1 - layer % 2;
  for (const auto& t : section_.triangles()) {
    auto [i, j, k] = t.corners;
    if (i > j) std::swap(i, j);
    if (j > k) std::swap(j, k);
    if (i > j) std::swap(i, j);
    raw_.tets.insert(raw_.tets.end(), {at(base, i), at(base, j), at(base, k), at(top, k)});
    raw_.tets.insert(raw_.tets.end(), {at(base, i), at(base, j), at(top, j), at(top, k)});
    raw_.tets.insert(raw_.tets.end(), {at(base, i), at(top, i), at(top, j), at(top, k)});
  }
  for (const auto& piece : section_.outline()) {
    const auto [i, j] = std::minmax(piece.from, piece.to);
    add_face({at(base, i), at(base, j), at(top, j)}, prism_.side[std::size_t(piece.edge)]);
    add_face({at(base, i), at(top, i), at(top, j)}, prism_.side[std::size_t(piece.edge)]);
  }
}

}  // namespace detail

inline LinearTets SweptMesher::fill(const MeshInput& input) const {
  const SurfaceReport surface = validate_surface(input);
  const detail::Prism prism = detail::prism_of(input, surface);
  const double length = prism.high - prism.low;
  const auto wanted = [&](const Point2& p, double y) {
    const double edge = input.edge ? input.edge(Vec3d(p[0], y, -p[1])) : std::numeric_limits<double>::infinity();
    if (!(edge > 0.0))
      throw MeshError(MeshError::Reason::not_finite,
          message("swept mesher: wanted edge length at (", p[0], ", ", y, ", ", -p[1], ") is ", edge, ", must be > 0"));
    return edge;
  };
  auto section = PolygonRefinement::of(prism.section);
  if (!section) detail::refuse_prism("the section is not simple");
  const bool filled = section->refine([&](const Point2& p) {
    double least = length;
    for (int i = 0; i <= samples; ++i) least = std::min(least, wanted(p, prism.low + length * i / samples));
    return least;
  });
  std::vector<double> places;
  if (filled) places = detail::layer_places(detail::layer_thickness(prism, section->points(), wanted));
  if (!filled || section->points().size() * places.size() > most_vertices)
    throw MeshError(
        MeshError::Reason::out_of_memory, "swept mesher: the wanted edges are too short, at most 5 million vertices");
  return checked_fill(input, surface, detail::Sweep(prism, *section, places).fill(input));
}

}  // namespace lumo

#endif

// ---- lumo/mesh/vtu.hpp
#ifndef SINGLE_INCLUDE_LUMO_MESH_VTU_HPP
#define SINGLE_INCLUDE_LUMO_MESH_VTU_HPP

namespace lumo {

/// Values on the nodes of a mesh: `components` (1 or 3) numbers per node, node by node. The unit belongs in the name.
struct NodeField {
  std::string name;
  int components = 1;
  std::vector<double> values;
};

/// One file of a time series and the value (a load, a time) it stands for.
struct SeriesEntry {
  double value;
  std::string file;
};

/// The mesh as a ParaView unstructured grid (.vtu, coordinates in m, binary arrays), with fields on its nodes.
/// Throws InvalidArgument when a field does not fit the mesh, InputError when the stream fails. Source: VTK file
/// formats, cell types 10 and 24.
inline void write_vtu(std::ostream& out, const TetMesh& mesh, const std::span<const NodeField>& fields = {});

/// A ParaView collection (.pvd) of .vtu files.
inline void write_pvd(std::ostream& out, const std::span<const SeriesEntry>& entries);

/// The field for write_vtu from one vector per node.
inline NodeField node_field(std::string name, const std::span<const Vec3d>& vectors) {
  NodeField f{std::move(name), 3, {}};
  f.values.reserve(3 * vectors.size());
  for (const Vec3d& v : vectors) f.values.insert(f.values.end(), {v.x(), v.y(), v.z()});
  return f;
}

inline std::string base64(std::span<const unsigned char> bytes) {
  static constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string s;
  s.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t have = std::min<std::size_t>(3, bytes.size() - i);
    unsigned group = unsigned(bytes[i]) << 16;
    if (have > 1) group |= unsigned(bytes[i + 1]) << 8;
    if (have > 2) group |= bytes[i + 2];
    for (std::size_t k = 0; k < 4; ++k) s += k <= have ? digits[group >> (18 - 6 * k) & 63u] : '=';
  }
  return s;
}

// VTK's inline binary: the number of bytes as UInt64, then the values, encoded as one piece.
template <class T> void vtu_array(
    std::ostream& out, std::string_view type, std::string_view name, int components, const std::vector<T>& values) {
  const std::uint64_t size = values.size() * sizeof(T);
  std::vector<unsigned char> bytes(sizeof size + size);
  std::memcpy(bytes.data(), &size, sizeof size);
  if (size > 0) std::memcpy(bytes.data() + sizeof size, values.data(), size);
  out << "<DataArray type=\"" << type << "\" Name=\"" << name << "\"";
  if (components > 1) out << message(" NumberOfComponents=\"", components, "\"");
  out << " format=\"binary\">" << base64(bytes) << "</DataArray>\n";
}

inline std::string xml_attribute(std::string_view s) {
  std::string out;
  for (const char c : s) {
    if (c == '&') out += "&amp;";
    else if (c == '<') out += "&lt;";
    else if (c == '"') out += "&quot;";
    else out += c;
  }
  return out;
}

inline void write_vtu(std::ostream& out, const TetMesh& mesh, const std::span<const NodeField>& fields) {
  for (const NodeField& f : fields)
    if ((f.components != 1 && f.components != 3) || f.values.size() != mesh.nodes.size() * std::size_t(f.components))
      throw InvalidArgument(message("field '", f.name, "' has ", f.values.size(), " values of ", f.components,
          " components, the mesh has ", mesh.nodes.size(), " nodes"));

  const std::size_t per_tet = std::size_t(mesh.nodes_per_tet());
  std::vector<std::int64_t> connectivity, offsets;
  connectivity.reserve(mesh.tets.size() * per_tet);
  offsets.reserve(mesh.tets.size());
  for (const auto& tet : mesh.tets) {  // the edge order 01, 12, 02, 03, 13, 23 is VTK's own
    for (std::size_t k = 0; k < per_tet; ++k) connectivity.push_back(tet[k]);
    offsets.push_back(std::int64_t(connectivity.size()));
  }
  const std::vector<std::uint8_t> types(mesh.tets.size(), mesh.order == 2 ? 24 : 10);

  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\""
      << (std::endian::native == std::endian::little ? "LittleEndian" : "BigEndian")
      << "\" header_type=\"UInt64\">\n<UnstructuredGrid>\n"
      << message(
             "<Piece NumberOfPoints=\"", mesh.nodes.size(), "\" NumberOfCells=\"", mesh.tets.size(), "\">\n<Points>\n");
  vtu_array(out, "Float64", "position_m", 3, node_field("", mesh.nodes).values);
  out << "</Points>\n<Cells>\n";
  vtu_array(out, "Int64", "connectivity", 1, connectivity);
  vtu_array(out, "Int64", "offsets", 1, offsets);
  vtu_array(out, "UInt8", "types", 1, types);
  out << "</Cells>\n<PointData>\n";
  for (const NodeField& f : fields) vtu_array(out, "Float64", xml_attribute(f.name), f.components, f.values);
  out << "</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
  if (!out) throw InputError("writing a .vtu file failed");
}

inline void write_pvd(std::ostream& out, const std::span<const SeriesEntry>& entries) {
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n";
  for (const SeriesEntry& e : entries)
    out << "<DataSet timestep=\"" << message(e.value) << "\" part=\"0\" file=\"" << xml_attribute(e.file) << "\"/>\n";
  out << "</Collection>\n</VTKFile>\n";
  if (!out) throw InputError("writing a .pvd file failed");
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

// ---- lumo/mechanics/materials/mooney_rivlin.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_MOONEY_RIVLIN_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_MOONEY_RIVLIN_HPP

namespace lumo {

/// Mooney–Rivlin solid, W = c₁₀ (Ī₁ − 3) + c₀₁ (Ī₂ − 3) + κ/4 (J² − 1 − 2 ln J). Shear modulus 2 (c₁₀ + c₀₁); +∞ where
/// J ≤ 0. Source: Mooney 1940, Rivlin 1948. The default is Dragon Skin of the paper at small strain, a fifth of it in
/// the second term.
struct MooneyRivlin {
  double c10 = 42.4e3;      ///< [Pa]
  double c01 = 10.6e3;      ///< [Pa]
  double bulk = 10.5647e6;  ///< bulk modulus κ [Pa]

  double shear_modulus() const { return 2.0 * (c10 + c01); }

  template <class S> S distortion_energy(const Mat3<S>& F) const {
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();
    return c10 * (first_isochoric_invariant(F).value - 3.0) + c01 * (second_isochoric_invariant(F).value - 3.0);
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const {
    return c10 * first_isochoric_invariant(F).gradient + c01 * second_isochoric_invariant(F).gradient;
  }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    return c10 * first_isochoric_invariant(F).hessian + c01 * second_isochoric_invariant(F).hessian;
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const { return convex_volumetric(bulk, J); }
};

inline void validate(const MooneyRivlin& m) {
  require_in_range("Mooney-Rivlin c10", m.c10, 0.0, 1e12, "Pa");
  require_in_range("Mooney-Rivlin c01", m.c01, 0.0, 1e12, "Pa");
  require_positive("shear modulus 2 (c10 + c01)", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<MooneyRivlin>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/materials/neo_hookean.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_NEO_HOOKEAN_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_NEO_HOOKEAN_HPP

namespace lumo {

/// Compressible Neo-Hookean solid, W = μ/2 (I_C − 3) − μ ln J + λ/2 (ln J)². Source: Bonet and Wood 2008, §6.4.3.
struct NeoHookean {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  template <class S> S distortion_energy(const Mat3<S>& F) const {
    using std::log;
    const S J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * log(J);
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const {
    return mu * F - (mu / F.determinant()) * cofactor(F);
  }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    const S J = F.determinant();
    const Mat3<S> c = cofactor(F);
    return isotropic(S(mu)) + dyad((mu / (J * J)) * c, c) - (mu / J) * determinant_hessian(F);
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const {
    using std::log;
    if (!(J > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const S l = log(J);
    return {0.5 * lambda * l * l, lambda * l / J, lambda * (1.0 - l) / (J * J)};
  }
  template <class S> DilatationSample<S> dilatation(const S& J) const {
    using std::log;
    const S l = log(J);
    return {(lambda * l - mu) / J, (lambda * (1.0 - l) + mu) / (J * J)};
  }
};

inline void validate(const NeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<NeoHookean>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/materials/ogden.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_OGDEN_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_OGDEN_HPP

namespace lumo {

/// Ogden solid, W = Σ μ_p/α_p (λ̄₁^α_p + λ̄₂^α_p + λ̄₃^α_p − 3) + κ/4 (J² − 1 − 2 ln J), λ̄ᵢ = J^(−1/3) λᵢ the
/// principal stretches without the volume change. Shear modulus ½ Σ μ_p α_p; +∞ where J ≤ 0. Source: Ogden 1972. A term
/// with μ_p = 0 is none. Distortion is for doubles: principal stretches come from an iteration. The default is Dragon
/// Skin of the paper at small strain.
struct Ogden {
  struct Term {
    double mu = 0.0;     ///< [Pa], of the sign of alpha
    double alpha = 2.0;  ///< exponent
  };
  std::array<Term, 3> terms = {{{106.0e3, 2.0}, {}, {}}};
  double bulk = 10.5647e6;  ///< bulk modulus κ [Pa]

  double shear_modulus() const {
    double sum = 0.0;
    for (const Term& t : terms) sum += 0.5 * t.mu * t.alpha;
    return sum;
  }

  double distortion_energy(const Mat3d& F) const {
    const double J = F.determinant();
    if (!(J > 0.0)) return std::numeric_limits<double>::infinity();
    const Vec3d l = principal(F).l / std::cbrt(J);
    double sum = 0.0;
    for (const Term& t : terms)
      if (t.mu != 0.0) sum += t.mu / t.alpha * (l.array().pow(t.alpha).sum() - 3.0);
    return sum;
  }
  Mat3d distortion_stress(const Mat3d& F) const {
    const Principal p = principal(F);
    return p.U * p.g.cwiseQuotient(p.l).asDiagonal() * p.V.transpose();
  }
  // In the principal frame stretching couples the diagonal, and each pair of off-diagonal components is a stretch and a
  // turn.
  Mat9d distortion_tangent(const Mat3d& F) const {
    const Principal p = principal(F);
    const Mat3d slopes = log_slopes(p.l);
    Mat9d local = Mat9d::Zero();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        local(4 * i, 4 * j) = (slopes(i, j) - (i == j ? p.g[i] : 0.0)) / (p.l[i] * p.l[j]);
        if (i == j) continue;
        const double stretch = divided_difference(p.l, i, j) / p.l[i] - p.g[j] / (p.l[i] * p.l[j]);
        const double turn = (p.g[i] / p.l[i] + p.g[j] / p.l[j]) / (p.l[i] + p.l[j]);
        local(i + 3 * j, i + 3 * j) = 0.5 * (stretch + turn);
        local(i + 3 * j, j + 3 * i) = 0.5 * (stretch - turn);
      }
    Mat9d frame;  // vec(U X Vᵀ) = frame · vec(X)
    for (int j = 0; j < 3; ++j)
      for (int l = 0; l < 3; ++l) frame.block<3, 3>(3 * j, 3 * l) = p.V(j, l) * p.U;
    return frame * local * frame.transpose();
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const { return convex_volumetric(bulk, J); }

 private:
  // Principal stretches l, with F = U diag(l) Vᵀ, and gᵢ = lᵢ ∂W/∂lᵢ.
  struct Principal {
    Mat3d U, V;
    Vec3d l, g;
  };
  Principal principal(const Mat3d& F) const {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Principal p{svd.matrixU(), svd.matrixV(), svd.singularValues(), Vec3d::Zero()};
    const double J = p.l.prod();
    for (const Term& t : terms) {
      const Vec3d power = t.mu * std::pow(J, -t.alpha / 3.0) * p.l.array().pow(t.alpha).matrix();
      p.g += power - Vec3d::Constant(power.sum() / 3.0);
    }
    return p;
  }
  // ∂gᵢ/∂ln lⱼ
  Mat3d log_slopes(const Vec3d& l) const {
    Mat3d d = Mat3d::Zero();
    for (const Term& t : terms) {
      const Vec3d power = t.mu * t.alpha * std::pow(l.prod(), -t.alpha / 3.0) * l.array().pow(t.alpha).matrix();
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          d(i, j) += (i == j ? power[i] : 0.0) - (power[i] + power[j]) / 3.0 + power.sum() / 9.0;
    }
    return d;
  }
  // (gᵢ − gⱼ)/(lᵢ − lⱼ), without cancellation where they meet.
  double divided_difference(const Vec3d& l, int i, int j) const {
    const double apart = l[i] - l[j];
    double sum = 0.0;
    for (const Term& t : terms) {
      const double scale = t.mu * std::pow(l.prod(), -t.alpha / 3.0) * std::pow(l[j], t.alpha);
      sum += scale * (apart == 0.0 ? t.alpha / l[j] : std::expm1(t.alpha * std::log1p(apart / l[j])) / apart);
    }
    return sum;
  }
};

inline void validate(const Ogden& m) {
  for (const Ogden::Term& t : m.terms) {
    require_in_range("Ogden exponent alpha", t.alpha, -20.0, 20.0, "");
    if (t.mu != 0.0) require_positive("Ogden product mu alpha", t.mu * t.alpha, "Pa");
  }
  require_positive("shear modulus", m.shear_modulus(), "Pa");
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<Ogden>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/materials/stable_neo_hookean.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_STABLE_NEO_HOOKEAN_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_STABLE_NEO_HOOKEAN_HPP

namespace lumo {

/// Neo-Hookean solid without a logarithm, W = μ/2 (I_C − 3) + λ'/2 (J − α)² less its value at rest, with λ' = λ + μ and
/// α = 1 + μ/λ'. Rest is free of stress, and μ and λ are the Lamé parameters of small strain. Finite where J ≤ 0: an
/// element that is turned inside out is pushed back. Source: Smith, de Goes, Kim 2018, without their logarithmic term,
/// as Newton 1.8 has it.
struct StableNeoHookean {
  double mu = 106.0e3;       ///< shear modulus [Pa]
  double lambda = 10.494e6;  ///< Lamé's first parameter [Pa]

  double shear_modulus() const { return mu; }

  // λ'/2 (J − α)² − μ²/(2 λ') = λ'/2 (J − 1)² − μ (J − 1): only the first term is stiff.
  template <class S> S distortion_energy(const Mat3<S>& F) const {
    return 0.5 * mu * (F.squaredNorm() - 3.0) - mu * (F.determinant() - 1.0);
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const { return mu * (F - cofactor(F)); }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    return mu * (isotropic(S(1.0)) - determinant_hessian(F));
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const {
    const double k = lambda + mu;
    return {0.5 * k * (J - 1.0) * (J - 1.0), k * (J - 1.0), k};
  }
  template <class S> DilatationSample<S> dilatation(const S& J) const {
    const double k = lambda + mu;
    return {k * (J - 1.0) - mu, k + 0.0 * J};
  }
};

inline void validate(const StableNeoHookean& m) {
  require_positive("shear modulus mu", m.mu, "Pa");
  require_in_range("Lame parameter lambda", m.lambda, 0.0, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<StableNeoHookean>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/materials/yeoh.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_YEOH_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_MATERIALS_YEOH_HPP

namespace lumo {

/// Yeoh solid, W = Σ cₖ (Ī₁ − 3)ᵏ, k = 1, 2, 3, + κ/4 (J² − 1 − 2 ln J). Shear modulus 2 c₁; +∞ where J ≤ 0. Source:
/// Yeoh 1993. The energy's slope by Ī₁ must be positive however far the body is stretched; c₂ may be negative, as fits
/// to rubber that softens and then stiffens have it. The default is Dragon Skin of the paper at small strain.
struct Yeoh {
  double c1 = 53.0e3;       ///< [Pa]
  double c2 = 0.0;          ///< [Pa]
  double c3 = 0.0;          ///< [Pa]
  double bulk = 10.5647e6;  ///< bulk modulus κ [Pa]

  double shear_modulus() const { return 2.0 * c1; }

  template <class S> S distortion_energy(const Mat3<S>& F) const {
    if (!(F.determinant() > 0.0)) return std::numeric_limits<double>::infinity();
    const S s = first_isochoric_invariant(F).value - 3.0;
    return s * (c1 + s * (c2 + s * c3));
  }
  template <class S> Mat3<S> distortion_stress(const Mat3<S>& F) const {
    const InvariantSample<S> I = first_isochoric_invariant(F);
    return slope(I.value - 3.0) * I.gradient;
  }
  template <class S> Mat9<S> distortion_tangent(const Mat3<S>& F) const {
    const InvariantSample<S> I = first_isochoric_invariant(F);
    const S s = I.value - 3.0;
    const Eigen::Map<const Eigen::Matrix<S, 9, 1>> g(I.gradient.data());
    return slope(s) * I.hessian + (2.0 * c2 + 6.0 * c3 * s) * g * g.transpose();
  }
  template <class S> VolumetricSample<S> volumetric(const S& J) const { return convex_volumetric(bulk, J); }

 private:
  template <class S> S slope(const S& s) const { return c1 + s * (2.0 * c2 + s * 3.0 * c3); }
};

inline void validate(const Yeoh& m) {
  require_positive("Yeoh c1", m.c1, "Pa");
  require_in_range("Yeoh c3", m.c3, 0.0, 1e12, "Pa");
  // c₁ + 2 c₂ s + 3 c₃ s² > 0 for all s ≥ 0; where the parabola only touches 0 there is no stiffness left.
  const double least = -std::sqrt(3.0 * m.c1 * m.c3);
  if (!(std::isfinite(m.c2) && m.c2 <= 1e12 && (m.c2 >= 0.0 || m.c2 > least)))
    throw InvalidArgument(message("Yeoh c2 is ", m.c2, " Pa, must lie above -sqrt(3 c1 c3) = ", least,
        " Pa, or not below 0, and not above 1e12 Pa"));
  require_in_range("bulk modulus", m.bulk, 1e-3, 1e15, "Pa");
}

static_assert(HyperelasticMaterial<Yeoh>);

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

// ---- lumo/mechanics/indenters/capsule.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_CAPSULE_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_CAPSULE_HPP

namespace lumo {

/// Rigid capsule about its own z axis: all points within half a diameter of a segment. Lying (see Oriented) it is a bar
/// with round ends.
struct Capsule {
  double diameter_m = 10e-3;
  double length_m = 20e-3;  ///< of the segment, without the caps

  bool operator==(const Capsule&) const = default;

  double radius_m() const { return 0.5 * (length_m + diameter_m); }
  double contact_radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const { return (p - nearest(p)).norm() - contact_radius_m(); }
  DistanceSample sample(const Vec3d& p) const {
    const Vec3d foot = nearest(p), out = p - foot;
    const double r = out.norm();
    const Vec3d n = r > 0.0 ? Vec3d(out / r) : Vec3d(Vec3d::UnitX());
    const bool side = std::abs(p.z()) <= 0.5 * length_m;
    Mat3d across = Mat3d::Identity() - n * n.transpose();
    if (side) across -= Vec3d::UnitZ() * Vec3d::UnitZ().transpose();
    return {r - contact_radius_m(), n, across / (r > 0.0 ? r : contact_radius_m())};
  }

 private:
  template <class S> Vec3<S> nearest(const Vec3<S>& p) const {
    return {S(0.0), S(0.0), std::clamp(p.z(), S(-0.5 * length_m), S(0.5 * length_m))};
  }
};

inline void validate(const Capsule& c) {
  require_in_range("capsule diameter", c.diameter_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("capsule length", c.length_m * 1e3, 0.0, 1000.0, "mm");
}

static_assert(Indenter<Capsule>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/indenters/cylinder.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_CYLINDER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_CYLINDER_HPP

namespace lumo {

/// Rigid cylinder about its own z axis, with rounded rims where `edge_radius_m` > 0: a flat punch; lying (see
/// Oriented), a bar.
struct Cylinder {
  double diameter_m = 10e-3;
  double length_m = 20e-3;
  double edge_radius_m = 0.5e-3;

  bool operator==(const Cylinder&) const = default;

  double radius_m() const { return 0.5 * std::hypot(diameter_m, length_m); }
  double contact_radius_m() const { return 0.5 * diameter_m; }
  bool symmetric(int) const { return true; }
  template <class S> S distance(const Vec3<S>& p) const;
  DistanceSample sample(const Vec3d& p) const;
};

inline void validate(const Cylinder& c) {
  require_in_range("cylinder diameter", c.diameter_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("cylinder length", c.length_m * 1e3, 0.1, 1000.0, "mm");
  require_in_range("edge radius of the cylinder", c.edge_radius_m * 1e3, 0.0,
      0.499 * std::min(c.diameter_m, c.length_m) * 1e3, "mm");
}

// A rectangle in the half-plane through the axis, turned about it.
template <class S> S Cylinder::distance(const Vec3<S>& p) const {
  using std::abs, std::hypot;
  const S beyond = abs(p.z()) - 0.5 * length_m + edge_radius_m,
          aside = hypot(p.x(), p.y()) - 0.5 * diameter_m + edge_radius_m;
  if (beyond > 0.0 && aside > 0.0) return hypot(beyond, aside) - edge_radius_m;
  return (beyond > aside ? beyond : aside) - edge_radius_m;
}

inline DistanceSample Cylinder::sample(const Vec3d& p) const {
  const double rho = std::hypot(p.x(), p.y()), up = p.z() < 0.0 ? -1.0 : 1.0;
  const Vec3d radial = rho > 0.0 ? Vec3d(p.x() / rho, p.y() / rho, 0.0) : Vec3d(Vec3d::UnitX()),
              axial = up * Vec3d::UnitZ();
  const Vec3d around = Vec3d::UnitZ().cross(radial);
  const double beyond = std::abs(p.z()) - 0.5 * length_m + edge_radius_m,
               aside = rho - 0.5 * diameter_m + edge_radius_m;
  if (beyond > 0.0 && aside > 0.0) {
    const double r = std::hypot(beyond, aside);
    const Vec3d n = (beyond * axial + aside * radial) / r, t = (aside * axial - beyond * radial) / r;
    return {r - edge_radius_m, n, t * t.transpose() / r + aside / (r * rho) * around * around.transpose()};
  }
  if (beyond > aside) return {beyond - edge_radius_m, axial, Mat3d::Zero()};
  return {aside - edge_radius_m, radial, around * around.transpose() / (rho > 0.0 ? rho : 0.5 * diameter_m)};
}

static_assert(Indenter<Cylinder>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/indenters/mesh_indenter.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_MESH_INDENTER_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_MESH_INDENTER_HPP

namespace lumo {

/// Rigid tool of any closed triangle surface, by the exact distance to its triangles: thin walls, sharp tips and small
/// parts on long shafts are where the surface has them. The surface's own coordinates are the tool's frame. Copies
/// share the surface. `MeshIndenter tool(read_surface("knob.stl"))`.
///
/// The gradient turns steadily outside of convex edges. It jumps across the planes that halve convex edges inside, and
/// concave ones outside, by the angle between the facets. Presses bear that: the law's energy has no step there, so
/// that a line search descends. Rounding the edges instead, on a grid, made another tool of a blade or a cone.
class MeshIndenter {
 public:
  /// Throws MeshError for a surface that bounds no solid (see validate_surface).
  explicit MeshIndenter(const TriangleSurface& surface) : field_(std::make_shared<const Field>(surface)) {
    Eigen::AlignedBox3d box;
    for (const auto& t : surface.triangles)
      for (const int n : t) {
        const Vec3d& v = surface.vertices[std::size_t(n)];
        radius_m_ = std::max(radius_m_, v.norm());
        box.extend(v);
      }
    contact_radius_m_ = 0.5 * box.sizes().minCoeff();
  }

  bool operator==(const MeshIndenter& other) const {
    const TriangleSurface &a = surface(), &b = other.surface();
    return field_ == other.field_ || (a.vertices == b.vertices && a.triangles == b.triangles);
  }

  double radius_m() const { return radius_m_; }
  double contact_radius_m() const { return contact_radius_m_; }
  double distance(const Vec3d& p) const { return field_->exact.distance(p); }
  DistanceSample sample(const Vec3d& p) const {
    const SignedDistance::Sample s = field_->exact.sample(p);
    return {s.distance, s.gradient, s.hessian};
  }
  const TriangleSurface& surface() const { return field_->surface; }

 private:
  struct Field {
    explicit Field(const TriangleSurface& s) : surface(checked(s)), exact(surface) {}
    Field(const Field&) = delete;  // the distance points into the surface
    Field& operator=(const Field&) = delete;

    static const TriangleSurface& checked(const TriangleSurface& s) {
      validate_surface(s);
      return s;
    }

    TriangleSurface surface;
    SignedDistance exact;
  };

  std::shared_ptr<const Field> field_;
  double radius_m_ = 0.0, contact_radius_m_ = 0.0;
};

inline void validate(const MeshIndenter& m) {
  require_in_range("radius about a mesh indenter's origin", m.radius_m() * 1e3, 0.05, 1000.0, "mm");
}

static_assert(Indenter<MeshIndenter>);

}  // namespace lumo

#endif

// ---- lumo/mechanics/indenters/oriented.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_ORIENTED_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_INDENTERS_ORIENTED_HPP

namespace lumo {

/// A tool turned in the finger's frame: `turn` takes vectors of the tool's own frame there.
template <Indenter Tool> struct Oriented {
  Tool tool;
  Mat3d turn{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};

  bool operator==(const Oriented&) const = default;

  double radius_m() const { return tool.radius_m(); }
  double contact_radius_m() const { return contact_radius(tool); }
  bool symmetric(int axis) const {  // where an axis of the tool lies along it
    for (int k = 0; k < 3; ++k)
      if (std::abs(turn(axis, k)) == 1.0) return is_symmetric(tool, k);
    return false;
  }
  template <class S> auto distance(const Vec3<S>& p) const -> decltype(tool.distance(p)) {
    return tool.distance(Vec3<S>(turn.template cast<S>().transpose() * p));
  }
  DistanceSample sample(const Vec3d& p) const {
    const auto d = tool.sample(turn.transpose() * p);
    return {d.distance, turn * d.gradient, turn * d.hessian * turn.transpose()};
  }
};

template <Indenter Tool> Oriented(Tool, Mat3d) -> Oriented<Tool>;

/// A tool that is long along its own z, laid along y, the finger: its z becomes y.
template <Indenter Tool> Oriented<Tool> lying_along_y(const Tool& tool) {
  Mat3d turn;
  turn << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return {tool, turn};
}

/// The same, laid along x, across the finger.
template <Indenter Tool> Oriented<Tool> lying_along_x(const Tool& tool) {
  Mat3d turn;
  turn << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  return {tool, turn};
}

template <Indenter Tool> void validate(const Oriented<Tool>& o) {
  validate(o.tool);
  if (!((o.turn.transpose() * o.turn - Mat3d::Identity()).norm() < 1e-9 && o.turn.determinant() > 0.0))
    throw InvalidArgument(message("turn of a tool: its determinant is ", o.turn.determinant(), ", must be a rotation"));
}

static_assert(Indenter<Oriented<Sphere>>);

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

/// The elastic energy of a tetrahedral mesh with its first and second derivatives.
template <HyperelasticMaterial Material, TetElement Element> class Solid {
 public:
  static constexpr int N = Element::nodes;
  using Gradients = Eigen::Matrix<double, 3, N>;

  /// Throws InvalidArgument where the mesh is not of the element's order.
  Solid(const TetMesh& mesh, Material material, Element element)
      : mesh_(&mesh), material_(material), element_(element), points_(mesh) {}

  /// Stored energy [J]; +∞ when an element is inverted at a quadrature point.
  double energy(const Positions& x) const {
    double sum = 0.0;
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      for (int q = 0; q < Element::points; ++q) {
        sum += weight(e, q) * material_.distortion_energy(s.F[std::size_t(q)]);
        if (!element_.mean_dilatation) sum += weight(e, q) * material_.volumetric(s.J[std::size_t(q)]).energy;
      }
      if (element_.mean_dilatation) sum += s.volume * material_.volumetric(s.mean_J).energy;
      if (!std::isfinite(sum)) return std::numeric_limits<double>::infinity();
    }
    return sum;
  }

  /// Volume ratios that the volumetric energy sees: one per element with the locking cure, else one per quadrature
  /// point.
  std::vector<double> volume_ratios(const Positions& x) const {
    std::vector<double> J;
    J.reserve(mesh_->tets.size() * cells());
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      if (element_.mean_dilatation) J.push_back(s.mean_J);
      else J.insert(J.end(), s.J.begin(), s.J.end());
    }
    return J;
  }

  /// The same, carried on by the displacement dx along the slope that they have at the positions `linear`.
  std::vector<double> predicted_ratios(const Positions& x, const Positions& linear, const Positions& dx) const {
    std::vector<double> J = volume_ratios(x);
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, linear);
      for (int q = 0; q < Element::points; ++q) {
        const Gradients slope = product(cofactor(s.F[std::size_t(q)]), gradient(e, q));
        double rate = 0.0;
        for (int a = 0; a < N; ++a) rate += Vec3d(dx.col(node(e, a))).dot(Vec3d(slope.col(a)));
        if (element_.mean_dilatation) J[e] += weight(e, q) / s.volume * rate;
        else J[e * cells() + std::size_t(q)] += rate;
      }
    }
    return J;
  }

  /// Adds the nodal forces ∂energy/∂x [N] to `force` (3 × nodes). The volumetric stress is linearised `about` given
  /// volume ratios θ, U'(θ) + U''(θ)(J − θ): see QuasiStatic.
  void add_forces(const Positions& x, Positions& force, const std::vector<double>* about = nullptr) const {
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      const ElementState s = state(e, x);
      Gradients f = Gradients::Zero();
      for (int q = 0; q < Element::points; ++q) {
        const double J = element_.mean_dilatation ? s.mean_J : s.J[std::size_t(q)], theta = ratio(e, q, s, about);
        const VolumetricSample<double> u = material_.volumetric(theta);
        const Mat3d& F = s.F[std::size_t(q)];
        f += product(
            weight(e, q) * (material_.distortion_stress(F) + (u.stress + u.stiffness * (J - theta)) * cofactor(F)),
            gradient(e, q));
      }
      for (int a = 0; a < N; ++a) force.col(node(e, a)) += f.col(a);
    }
  }

  /// Adds the tangent [N/m] to the values of each system's lower triangle; the element matrices are made once for all.
  void add_tangent(const Positions& x, const std::vector<const Equations*>& systems, const std::vector<double*>& values,
      const std::vector<double>* about = nullptr) const {
    constexpr int size = 3 * N;
    Eigen::Matrix<double, size, size> K;
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e) {
      element_tangent(e, x, about, K);
      for (std::size_t k = 0; k < systems.size(); ++k) {
        const int* slot = systems[k]->slots.data() + e * (size * (size + 1) / 2);
        double* v = values[k];
        for (int j = 0; j < size; ++j)
          for (int i = j; i < size; ++i, ++slot)
            if (*slot >= 0) v[*slot] += K(i, j);
      }
    }
  }

  /// Smallest det F over all quadrature points.
  double smallest_J(const Positions& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (double J : state(e, x).J) least = std::min(least, J);
    return least;
  }

  /// Smallest undeformed volume that a quadrature point stands for [m³]; not positive where the mesh has an element
  /// that is inside out.
  double smallest_volume() const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (int q = 0; q < Element::points; ++q) least = std::min(least, weight(e, q));
    return least;
  }

  const Material& material() const { return material_; }

 private:
  struct ElementState {
    std::array<Mat3d, std::size_t(Element::points)> F;
    std::array<double, std::size_t(Element::points)> J;
    double volume = 0.0;
    double mean_J = 0.0;
  };

  int node(std::size_t e, int a) const { return mesh_->tets[e][std::size_t(a)]; }
  double weight(std::size_t e, int q) const { return points_.weight(e, q); }
  const Gradients& gradient(std::size_t e, int q) const { return points_.gradient(e, q); }

  static Gradients product(const Mat3d& A, const Gradients& g) {
    Gradients p;
    for (int a = 0; a < N; ++a)
      for (int i = 0; i < 3; ++i) p(i, a) = A(i, 0) * g(0, a) + A(i, 1) * g(1, a) + A(i, 2) * g(2, a);
    return p;
  }

  ElementState state(std::size_t e, const Positions& x) const {
    Gradients local;
    for (int a = 0; a < N; ++a) local.col(a) = x.col(node(e, a));
    ElementState s;
    for (int q = 0; q < Element::points; ++q) {
      const std::size_t k = std::size_t(q);
      const Gradients& g = gradient(e, q);
      s.F[k] = Mat3d::Zero();
      for (int a = 0; a < N; ++a)
        for (int j = 0; j < 3; ++j)
          for (int i = 0; i < 3; ++i) s.F[k](i, j) += local(i, a) * g(j, a);
      s.J[k] = s.F[k].determinant();
      s.volume += weight(e, q);
      s.mean_J += weight(e, q) * s.J[k];
    }
    s.mean_J /= s.volume;
    return s;
  }

  std::size_t cells() const { return element_.mean_dilatation ? 1 : std::size_t(Element::points); }

  // Volume ratio that the volumetric energy is taken at.
  double ratio(std::size_t e, int q, const ElementState& s, const std::vector<double>* about) const {
    if (about) return (*about)[e * cells() + (element_.mean_dilatation ? 0 : std::size_t(q))];
    return element_.mean_dilatation ? s.mean_J : s.J[std::size_t(q)];
  }

  void element_tangent(std::size_t e, const Positions& x, const std::vector<double>* about,
      Eigen::Matrix<double, 3 * N, 3 * N>& K) const {
    const ElementState s = state(e, x);
    Gradients dJ = Gradients::Zero();  // V ∂(mean J)/∂x
    K.setZero();
    for (int q = 0; q < Element::points; ++q) {
      const Mat3d& F = s.F[std::size_t(q)];
      const Gradients& g = gradient(e, q);
      const Mat3d c = cofactor(F);
      const VolumetricSample<double> u = material_.volumetric(ratio(e, q, s, about));
      Mat9d A = material_.distortion_tangent(F) + u.stress * determinant_hessian(F);
      if (element_.mean_dilatation) {
        dJ += product(weight(e, q) * c, g);
      } else {
        A += dyad(u.stiffness * c, c);
      }
      A = A * weight(e, q);
      // Plain loops: Eigen's expressions of blocks took most of a simulator's compile time.
      for (int a = 0; a < N; ++a) {
        std::array<double, 27> T;  // 9 × 3, by columns
        for (std::size_t k = 0; k < 27; ++k)
          T[k] = A.data()[k] * g(0, a) + A.data()[k + 27] * g(1, a) + A.data()[k + 54] * g(2, a);
        for (int b = a; b < N; ++b)
          for (int j = 0; j < 3; ++j) {
            const double* t = T.data() + 9 * j;
            double* block = &K(3 * b, 3 * a + j);
            for (int i = 0; i < 3; ++i) block[i] += g(0, b) * t[i] + g(1, b) * t[i + 3] + g(2, b) * t[i + 6];
          }
      }
    }
    if (element_.mean_dilatation) {
      const double stiffness = material_.volumetric(ratio(e, 0, s, about)).stiffness / s.volume;
      for (int j = 0; j < 3 * N; ++j) {
        const double scaled = stiffness * dJ.data()[j];
        for (int i = j; i < 3 * N; ++i) K(i, j) += scaled * dJ.data()[i];
      }
    }
  }

  const TetMesh* mesh_;
  Material material_;
  Element element_;
  ElementPoints<Element> points_;
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
  double penetration_m = 0.0;   ///< largest overlap
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

// Calls visit(face, point number, point, position) for the surface points that can be in contact: those of faces that
// the rigid thing reaches, or whose given gaps are closed.
template <class Tool, class Visit> void for_contact_points(const ContactSurface& surface, const Positions& x,
    const Moving<Tool>& rigid, const SurfaceGaps* gaps, Visit&& visit) {
  for (std::size_t f = 0; f < surface.size(); ++f) {
    const auto [middle, radius] = surface.ball(f, x);
    const bool near = rigid.distance(middle) <= radius;
    if (!near && !(gaps && std::any_of((*gaps)[f].begin(), (*gaps)[f].end(), [](double g) { return g < 0.0; })))
      continue;
    const std::vector<SurfacePoint>& points = surface.points(f);
    for (std::size_t k = 0; k < points.size(); ++k) visit(f, k, points[k], surface.position(f, points[k], x));
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
  bool curved = true;                   ///< with the rigid thing's curvature, which can make it indefinite
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
        if (tangent.curved) block -= p.weight_m2 * r.pressure * d.hessian;
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

/// A rigid thing and the body's node positions, at one time.
template <class Tool> struct ContactPlace {
  Moving<Tool> rigid;
  const Positions& x;
};

/// Gaps at all surface points `now`, carried on by the displacement dx and the advance ds along the slope that they
/// have at `linear`.
template <class Tool> SurfaceGaps predicted_gaps(const ContactSurface& surface, const ContactPlace<Tool>& now,
    const ContactPlace<Tool>& linear, const Positions& dx, double ds) {
  SurfaceGaps gaps(surface.size());
  for (std::size_t f = 0; f < surface.size(); ++f)
    for (const SurfacePoint& p : surface.points(f))
      gaps[f].push_back(now.rigid.distance(surface.position(f, p, now.x)) +
                        linear.rigid.sample(surface.position(f, p, linear.x))
                            .gradient.dot(surface.position(f, p, dx) - ds * now.rigid.direction));
  return gaps;
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/contact/scenario.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_SCENARIO_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_CONTACT_SCENARIO_HPP

namespace lumo {

/// Plane in which an approach is tilted from the pad normal: across the finger, as the paper's are read, or along it.
enum class TiltPlane { xz, yz };

/// One contact: an indenter, the line on which it comes, and the loads at which it is observed.
/// It moves along direction() on the line through Body::pivot shifted by `y_m`; it does not move sideways.
template <Indenter Tool = Sphere> struct Scenario {
  Tool indenter;
  double angle_rad = 0.0;                                     ///< approach angle from the pad normal
  double y_m = 0.0;                                           ///< place along the finger [m]
  std::vector<double> loads_N = {1.0, 2.0, 5.0, 10.0, 15.0};  ///< increasing
  TiltPlane tilt = TiltPlane::xz;                             ///< in which the angle lies

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
  return {(straight || s.tilt == TiltPlane::yz) && is_symmetric(s.indenter, 0),
      s.y_m == 0.0 && (straight || s.tilt == TiltPlane::xz) && is_symmetric(s.indenter, 1)};
}

/// Mirror image of a contact with a symmetric tool in these planes.
template <Indenter Tool> Scenario<Tool> mirrored(Scenario<Tool> s, Symmetry planes) {
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
      for (bool moved = true; moved; spun += spin) {
        moved = false;
        const Vec3d n = outward_normal(patch.shape, seed);
        const Vec3d u = n.unitOrthogonal(), v = n.cross(u);
        for (int k = 0; k < directions; ++k) {
          const double turn = 0.25 * pi * k + spun;
          const Vec3d trial =
              closest_point(patch.shape, into_box(seed + step * (std::cos(turn) * u + std::sin(turn) * v)));
          if (inside(trial) && try_seed(trial, gain)) moved = true;
        }
      }
  }
};

// A scenario's tool in a message.
template <Indenter Tool> std::string approach(const Scenario<Tool>& s) {
  return message("the indenter at y = ", s.y_m * 1e3, " mm and ", s.angle_rad * 180 / pi, " deg");
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
  const double reach = 2.0 * size + 2.0 * scenario.indenter.radius_m() + std::abs(scenario.y_m);
  const Vec3d start = body.pivot + Vec3d(0, scenario.y_m, 0) - reach * direction;
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

// ---- lumo/mechanics/solvers/vertex_block.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_VERTEX_BLOCK_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_VERTEX_BLOCK_HPP

namespace lumo {

/// Newton's equation of one node, the others held: block · step = force, both of the node's own three components.
struct VertexBlock {
  Vec3d force{0.0, 0.0, 0.0};                                      ///< [N]
  Mat3d block{{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};  ///< [N/m]
};

/// Part of det F that a vertex's step must leave.
inline constexpr double least_J_kept = 0.1;

/// Elastic and viscous force and stiffness of single nodes, for any material and element.
/// Viscosity is absolute, on the rate of C = FᵀF since the step's start: force −η ∂/∂x ½ ∫ |Ċ|² dt, as Newton 1.8 has
/// it.
template <HyperelasticMaterial Material, TetElement Element> class VertexElasticity {
 public:
  /// Throws InvalidArgument where the mesh is not of the element's order.
  VertexElasticity(const TetMesh& mesh, const Material& material, const Element& element)
      : mesh_(&mesh), material_(material), element_(element), points_(mesh) {
    at_.resize(mesh.nodes.size());
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
      for (int a = 0; a < N; ++a) at_[std::size_t(mesh.tets[e][std::size_t(a)])].push_back({int(e), a});
  }

  /// Adds node v's share at positions x; `start` are the positions at the step's start, `rate` = η/Δt [Pa].
  void add(int v, const Positions& x, const Positions& start, double rate, VertexBlock& out) const {
    for (const Incidence& in : at_[std::size_t(v)]) {
      std::array<Mat3d, std::size_t(Element::points)> F;
      double volume = 0.0, changed = 0.0;
      for (int q = 0; q < Element::points; ++q) {
        F[std::size_t(q)] = deformation(in.tet, q, x);
        volume += weight(in.tet, q);
        changed += weight(in.tet, q) * F[std::size_t(q)].determinant();
      }
      Vec3d dilation = Vec3d::Zero();  // of the whole element by the node's place
      for (int q = 0; q < Element::points; ++q) {
        const Mat3d& f = F[std::size_t(q)];
        const Vec3d g = gradient(in.tet, q).col(in.place);
        const double w = weight(in.tet, q);
        const Vec3d c = cofactor(f) * g;
        out.force -= w * (material_.distortion_stress(f) * g);
        out.block += w * contracted(material_.distortion_tangent(f), g);
        dilation += w * c;
        if (!element_.mean_dilatation) {
          const VolumetricSample<double> u = material_.volumetric(f.determinant());
          out.force -= w * u.stress * c;
          out.block +=
              w * u.stiffness * c * c.transpose();  // the second derivative of J vanishes on a node's own block
        }
        if (rate > 0.0) {
          const Mat3d before = deformation(in.tet, q, start);
          const Vec3d fg = f * g;
          out.force -= 2.0 * w * rate * (f * ((f.transpose() * f - before.transpose() * before) * g));
          out.block += 2.0 * w * rate * (g.squaredNorm() * f * f.transpose() + fg * fg.transpose());
        }
      }
      if (element_.mean_dilatation) {
        const VolumetricSample<double> u = material_.volumetric(changed / volume);
        out.force -= u.stress * dilation;
        out.block += u.stiffness / volume * dilation * dilation.transpose();
      }
    }
  }

  /// Largest part t ≤ 1 of a step of node v that leaves every det F about it above `least_J_kept` of its value (det F
  /// is linear in one node).
  double feasible_part(int v, const Positions& x, const Vec3d& step) const {
    double t = 1.0;
    for (const Incidence& in : at_[std::size_t(v)])
      for (int q = 0; q < Element::points; ++q) {
        const Mat3d f = deformation(in.tet, q, x);
        const double slope = (cofactor(f) * gradient(in.tet, q).col(in.place)).dot(step), J = f.determinant();
        if (J + t * slope < least_J_kept * J) t = (least_J_kept - 1.0) * J / slope;
      }
    return t;
  }

  /// Smallest det F.
  double smallest_J(const Positions& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t e = 0; e < mesh_->tets.size(); ++e)
      for (int q = 0; q < Element::points; ++q) least = std::min(least, deformation(int(e), q, x).determinant());
    return least;
  }

  const Material& material() const { return material_; }

  /// Where a node takes part: its tetrahedra, and which of their nodes it is.
  struct Incidence {
    int tet, place;
  };
  const std::vector<Incidence>& incidences(int v) const { return at_[std::size_t(v)]; }
  const typename ElementPoints<Element>::Gradients& gradient(int e, int q) const {
    return points_.gradient(std::size_t(e), q);
  }
  double weight(int e, int q) const { return points_.weight(std::size_t(e), q); }

 private:
  static constexpr int N = Element::nodes;

  Mat3d deformation(int e, int q, const Positions& x) const {
    Mat3d F = Mat3d::Zero();
    for (int a = 0; a < N; ++a)
      F += x.col(mesh_->tets[std::size_t(e)][std::size_t(a)]) * gradient(e, q).col(a).transpose();
    return F;
  }

  // Σ gₖ A(i + 3k, j + 3l) gₗ
  static Mat3d contracted(const Mat9d& A, const Vec3d& g) {
    Eigen::Matrix<double, 9, 3> right = A.leftCols<3>() * g[0] + A.middleCols<3>(3) * g[1] + A.rightCols<3>() * g[2];
    return right.topRows<3>() * g[0] + right.middleRows<3>(3) * g[1] + right.bottomRows<3>() * g[2];
  }

  const TetMesh* mesh_;
  Material material_;
  Element element_;
  std::vector<std::vector<Incidence>> at_;
  ElementPoints<Element> points_;
};

/// The contact points of one time step between a surface and one rigid thing, with Coulomb friction on the slip since
/// the step's start. Friction is smooth below a slip `stick_m`: (2 − u/stick) u/stick of its full size (Li et al. 2020;
/// Newton 1.8).
template <ContactHandler Contact, class Tool> class StepContacts {
 public:
  /// `friction`: Coulomb's coefficient.
  StepContacts(const ContactSurface& surface, const Contact& law, double friction)
      : surface_(&surface), law_(law), friction_(friction) {}

  /// The points that come within `reach_m` of the rigid thing, which moved by `moved` since the last step and is now at
  /// its place.
  void find(const Positions& start, const Moving<Tool>& rigid, const Vec3d& moved, double reach_m, double stick_m);

  /// Adds node v's share at positions x.
  void add(int v, const Positions& x, VertexBlock& out) const {
    for (int k = first_[std::size_t(v)]; k < first_[std::size_t(v) + 1]; ++k) {
      const auto [point, shape] = corners_[std::size_t(k)];
      const VertexBlock at = response(points_[std::size_t(point)], x);
      out.force += shape * at.force;
      out.block += shape * shape * at.block;
    }
  }

  /// Force on the whole surface at positions x, and friction alone on the nodes.
  struct Sums {
    Vec3d force = Vec3d::Zero(), friction = Vec3d::Zero();
  };
  Sums sum(const Positions& x, std::vector<Vec3d>* friction_on_nodes) const {
    Sums s;
    for (const Point& p : points_) {
      const Vec3d force = response(p, x).force, friction = force - normal_force(p, x);
      s.force += force;
      s.friction += friction;
      if (!friction_on_nodes || friction_ == 0.0) continue;
      for (std::size_t a = 0; a < std::size_t(surface_->nodes_per_face()); ++a)
        (*friction_on_nodes)[std::size_t(surface_->face(p.face).nodes[a])] +=
            surface_->points(p.face)[p.number].shape[a] * friction;
    }
    return s;
  }

 private:
  static constexpr bool frozen = requires { requires Contact::plane_frozen; };
  struct Point {
    std::size_t face, number;
    Vec3d start;  // its place at the step's start
    Vec3d foot;   // of the plane
    Vec3d normal;
  };
  struct Corner {
    int point;
    double shape;
  };

  std::pair<double, Vec3d> gap(const Point& p, const Vec3d& at) const {
    if constexpr (frozen) {
      return {p.normal.dot(at - p.foot), p.normal};
    } else {
      const DistanceSample d = rigid_.sample(at);
      return {d.distance, d.gradient};
    }
  }
  Vec3d place(const Point& p, const Positions& x) const {
    return surface_->position(p.face, surface_->points(p.face)[p.number], x);
  }
  Vec3d normal_force(const Point& p, const Positions& x) const {
    const auto [g, n] = gap(p, place(p, x));
    return surface_->points(p.face)[p.number].weight_m2 * law_.respond(g).pressure * n;
  }
  // Force on the surface at the point, and its stiffness without the curvature of the rigid thing.
  VertexBlock response(const Point& p, const Positions& x) const {
    const Vec3d at = place(p, x);
    const auto [g, n] = gap(p, at);
    if (g >= 0.0) return {};
    const ContactResponse<double> r = law_.respond(g);
    const double weight = surface_->points(p.face)[p.number].weight_m2, push = weight * r.pressure;
    VertexBlock out{push * n, weight * r.stiffness * n * n.transpose()};
    if (friction_ == 0.0) return out;
    const Vec3d slip = at - p.start - moved_, along = slip - n.dot(slip) * n;
    const double u = along.norm(),
                 scale = friction_ * push * (u > stick_m_ ? 1.0 / u : (2.0 - u / stick_m_) / stick_m_);
    out.force -= scale * along;
    out.block += scale * (Mat3d::Identity() - n * n.transpose());
    return out;
  }

  const ContactSurface* surface_;
  Contact law_;
  double friction_;
  Moving<Tool> rigid_{};
  Vec3d moved_{0.0, 0.0, 0.0};
  double stick_m_ = 1.0;
  std::vector<Point> points_;
  std::vector<int> first_;  // per node, into corners_
  std::vector<Corner> corners_;
};

template <ContactHandler Contact, class Tool> void StepContacts<Contact, Tool>::find(
    const Positions& start, const Moving<Tool>& rigid, const Vec3d& moved, double reach_m, double stick_m) {
  rigid_ = rigid;
  moved_ = moved;
  stick_m_ = stick_m;
  points_.clear();
  std::vector<std::vector<Corner>> of_node(std::size_t(start.cols()));
  for (std::size_t f = 0; f < surface_->size(); ++f) {
    const auto [middle, radius] = surface_->ball(f, start);
    if (rigid.distance(middle) > radius + reach_m) continue;
    const std::vector<SurfacePoint>& points = surface_->points(f);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Vec3d at = surface_->position(f, points[k], start);
      const DistanceSample d = rigid.sample(at);
      if (d.distance > reach_m) continue;
      for (std::size_t a = 0; a < std::size_t(surface_->nodes_per_face()); ++a)
        if (points[k].shape[a] != 0.0)
          of_node[std::size_t(surface_->face(f).nodes[a])].push_back({int(points_.size()), points[k].shape[a]});
      points_.push_back({f, k, at, at - d.distance * d.gradient, d.gradient});
    }
  }
  first_.assign(1, 0);
  corners_.clear();
  for (const auto& corners : of_node) {
    corners_.insert(corners_.end(), corners.begin(), corners.end());
    first_.push_back(int(corners_.size()));
  }
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/solvers/simd.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_SIMD_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_SIMD_HPP

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

// ---- lumo/mechanics/solvers/vertex_packs.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_VERTEX_PACKS_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_VERTEX_PACKS_HPP

namespace lumo {

/// Groups of nodes no two of which share a tetrahedron: each node takes the first group that is free, in the order of
/// node numbers.
using VertexColors = std::vector<std::vector<int>>;

inline VertexColors color_vertices(const TetMesh& mesh) {
  const std::size_t per = std::size_t(mesh.nodes_per_tet());
  std::vector<std::vector<int>> tets_of(mesh.nodes.size());
  for (std::size_t e = 0; e < mesh.tets.size(); ++e)
    for (std::size_t a = 0; a < per; ++a) tets_of[std::size_t(mesh.tets[e][a])].push_back(int(e));
  VertexColors colors;
  std::vector<int> color(mesh.nodes.size(), -1), last_seen;
  for (std::size_t v = 0; v < mesh.nodes.size(); ++v) {
    for (int e : tets_of[v])
      for (std::size_t a = 0; a < per; ++a)
        if (const int c = color[std::size_t(mesh.tets[std::size_t(e)][a])]; c >= 0) last_seen[std::size_t(c)] = int(v);
    std::size_t free = 0;
    while (free < colors.size() && last_seen[free] == int(v)) ++free;
    if (free == colors.size()) {
      colors.emplace_back();
      last_seen.push_back(-1);
    }
    color[v] = int(free);
    colors[free].push_back(int(v));
  }
  return colors;
}

/// Throws InvalidArgument unless every node is in one group and no two nodes of a group share a tetrahedron.
inline void validate(const VertexColors& colors, const TetMesh& mesh) {
  std::vector<int> color(mesh.nodes.size(), -1);
  for (std::size_t c = 0; c < colors.size(); ++c)
    for (int v : colors[c]) {
      if (v < 0 || std::size_t(v) >= mesh.nodes.size())
        throw InvalidArgument(message("color ", c, " names node ", v, " of ", mesh.nodes.size()));
      if (color[std::size_t(v)] >= 0) throw InvalidArgument(message("node ", v, " has more than one color"));
      color[std::size_t(v)] = int(c);
    }
  for (std::size_t v = 0; v < color.size(); ++v)
    if (color[v] < 0) throw InvalidArgument(message("node ", v, " has no color"));
  for (const auto& t : mesh.tets)
    for (int a = 0; a < mesh.nodes_per_tet(); ++a)
      for (int b = 0; b < a; ++b)
        if (color[std::size_t(t[std::size_t(a)])] == color[std::size_t(t[std::size_t(b)])])
          throw InvalidArgument(
              message("nodes ", t[std::size_t(a)], " and ", t[std::size_t(b)], " of one tetrahedron have one color"));
}

/// A solid of the form W = μ/2 (I_C − 3) + h(J), whose P = μ F + h'(J) cof F is cheap enough to be taken for many
/// elements at once.
template <class M>
concept DilatationalMaterial = HyperelasticMaterial<M> && requires(const M& m, const SimdPack& J) {
  { m.dilatation(J) } -> std::same_as<DilatationSample<SimdPack>>;
};

/// Elastic and viscous forces and blocks of eight vertices of one color at once, on linear tetrahedra of a dilatational
/// solid. What a vertex's tetrahedra need lies in the order of use; vertices with as many tetrahedra go together. A
/// sweep waits for memory as much as for arithmetic, and the solid is isotropic: a tetrahedron at rest is seen in axes
/// of its own, where a third of F's derivatives vanish.
template <DilatationalMaterial Material> class VertexPacks {
 public:
  static constexpr std::size_t width = SimdPack::width;

  /// Up to eight vertices of one color.
  struct Batch {
    std::array<int, width> vertex;  ///< where there is none, the first again
    std::array<bool, width> moves;  ///< there is one
    std::size_t first, count;       ///< their slots
  };
  using Places = std::vector<SimdPack::Point>;  ///< where nodes are [m]
  /// Per slot what viscosity wants of a step's start: the column of C = FᵀF along the vertex's own gradient.
  using Start = std::vector<std::array<SimdPack, 3>>;

  /// `colors` name the vertices that move.
  VertexPacks(const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors);

  /// Batches color by color.
  const std::vector<std::vector<Batch>>& batches() const { return batches_; }
  std::size_t slots() const { return slots_.size(); }

  /// Start of one batch.
  void remember(const Batch& batch, const Places& x, Start& start) const;

  /// Adds the shares of a batch's vertices; see VertexElasticity::add. `start` is not looked at without viscosity.
  void add(
      const Batch& batch, const Places& x, const Start& start, double rate, std::array<VertexBlock, width>& out) const;

  /// Largest part of each vertex's step that is safe; see VertexElasticity::feasible_part.
  std::array<double, width> feasible_parts(
      const Batch& batch, const Places& x, const std::array<Vec3d, width>& steps) const;

 private:
  using Vector = std::array<SimdPack, 3>;
  // One tetrahedron of each of the batch's vertices, by its three other nodes. Axis 1 lies along the gradient g = (γ,
  // 0, 0) of the vertex's own shape function, axis 3 across the first other node's: the gradients are (a₀, c, 0), (a₁,
  // d, f), (a₂, −c−d, −f), γ = −a₀−a₁−a₂, and γ c f = 1/(6 V).
  struct Slot {
    Vector a;
    SimdPack c, d, f;                            // [1/m]
    SimdPack volume;                             // [m³]; 0 where a vertex has no further tetrahedron
    std::array<std::array<int, width>, 3> node;  // right-handed as seen from the vertex
  };
  // A tetrahedron as it is now.
  struct Shape {
    std::array<Vector, 3> F;  // columns
    Vector area;              // slope of det F by the vertex's place, cof F applied to g
    SimdPack J, gamma;
  };

  [[gnu::always_inline]] static SimdPack dot(const Vector& a, const Vector& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  }
  [[gnu::always_inline]] static Vector difference(const Vector& a, const Vector& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
  }
  // From vertices at `self`.
  [[gnu::always_inline]] static Shape shape(const Vector& self, const Slot& s, const Places& x) {
    const Vector p0 = SimdPack::gathered(x, s.node[0]), p1 = SimdPack::gathered(x, s.node[1]),
                 p2 = SimdPack::gathered(x, s.node[2]);
    const Vector e0 = difference(p0, self), e1 = difference(p1, self), e2 = difference(p2, self),
                 u = difference(p0, p2), v = difference(p1, p2);
    Shape now;
    now.gamma = -(s.a[0] + s.a[1] + s.a[2]);
    const SimdPack scale = now.gamma * s.c * s.f;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
      now.F[0][i] = s.a[0] * e0[i] + s.a[1] * e1[i] + s.a[2] * e2[i];
      now.F[1][i] = s.c * u[i] + s.d * v[i];
      now.F[2][i] = s.f * v[i];
      now.area[i] = scale * (u[k] * v[j] - u[j] * v[k]);
    }
    now.J = -dot(now.area, e2);
    return now;
  }
  // Column of C along axis 1.
  [[gnu::always_inline]] static Vector square(const Shape& now) {
    return {dot(now.F[0], now.F[0]), dot(now.F[1], now.F[0]), dot(now.F[2], now.F[0])};
  }

  Material material_;
  std::vector<std::vector<Batch>> batches_;
  std::vector<Slot> slots_;
};

template <DilatationalMaterial Material> VertexPacks<Material>::VertexPacks(
    const TetMesh& mesh, const VertexElasticity<Material, LinearTet>& elasticity, const VertexColors& colors)
    : material_(elasticity.material()) {
  for (const std::vector<int>& color : colors) {
    std::vector<int> order = color;
    std::stable_sort(order.begin(), order.end(),
        [&](int a, int b) { return elasticity.incidences(a).size() > elasticity.incidences(b).size(); });
    batches_.emplace_back();
    for (std::size_t begin = 0; begin < order.size(); begin += width) {
      Batch batch{{}, {}, slots_.size(), elasticity.incidences(order[begin]).size()};
      for (std::size_t lane = 0; lane < width; ++lane) {
        batch.moves[lane] = begin + lane < order.size();
        batch.vertex[lane] = order[batch.moves[lane] ? begin + lane : begin];
      }
      for (std::size_t k = 0; k < batch.count; ++k) {
        Slot slot;
        for (std::size_t lane = 0; lane < width; ++lane) {
          // What is missing repeats something sound without volume, so that no lane makes NaN.
          const auto& at = elasticity.incidences(batch.vertex[lane]);
          const auto& in = at[std::min(k, at.size() - 1)];
          const auto& gradient = elasticity.gradient(in.tet, 0);
          // The other nodes of a right-handed tetrahedron, right-handed as seen from each.
          static constexpr int others[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
          const auto& other = others[in.place];
          const Vec3d axis1 = gradient.col(in.place).normalized(), g0 = gradient.col(other[0]),
                      g1 = gradient.col(other[1]);
          const Vec3d axis2 = Vec3d(g0 - g0.dot(axis1) * axis1).normalized();
          for (std::size_t b = 0; b < 3; ++b) {
            slot.a[b].set(lane, gradient.col(other[b]).dot(axis1));
            slot.node[b][lane] = mesh.tets[std::size_t(in.tet)][std::size_t(other[b])];
          }
          slot.c.set(lane, g0.dot(axis2));
          slot.d.set(lane, g1.dot(axis2));
          slot.f.set(lane, std::abs(g1.dot(axis1.cross(axis2))));  // the third axis points where f is positive
          slot.volume.set(lane, batch.moves[lane] && k < at.size() ? elasticity.weight(in.tet, 0) : 0.0);
        }
        slots_.push_back(slot);
      }
      batches_.back().push_back(batch);
    }
  }
}

template <DilatationalMaterial Material>
std::array<double, VertexPacks<Material>::width> VertexPacks<Material>::feasible_parts(
    const Batch& batch, const Places& x, const std::array<Vec3d, width>& steps) const {
  std::array<double, width> part;
  part.fill(1.0);
  Vector step;
  for (std::size_t lane = 0; lane < width; ++lane)
    for (std::size_t i = 0; i < 3; ++i) step[i].set(lane, steps[lane][Eigen::Index(i)]);
  const Vector self = SimdPack::gathered(x, batch.vertex);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    const Shape now = shape(self, slots_[k], x);
    const SimdPack slope = dot(now.area, step);
    for (std::size_t lane = 0; lane < width; ++lane)
      if (now.J[lane] + part[lane] * slope[lane] < least_J_kept * now.J[lane])
        part[lane] = (least_J_kept - 1.0) * now.J[lane] / slope[lane];
  }
  return part;
}

template <DilatationalMaterial Material>
void VertexPacks<Material>::remember(const Batch& batch, const Places& x, Start& start) const {
  const Vector self = SimdPack::gathered(x, batch.vertex);
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) start[k] = square(shape(self, slots_[k], x));
}

template <DilatationalMaterial Material> void VertexPacks<Material>::add(
    const Batch& batch, const Places& x, const Start& start, double rate, std::array<VertexBlock, width>& out) const {
  static constexpr std::size_t row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  const double mu = material_.shear_modulus();
  const Vector self = SimdPack::gathered(x, batch.vertex);
  Vector force;
  std::array<SimdPack, 6> block;
  for (std::size_t k = batch.first; k < batch.first + batch.count; ++k) {
    // Neighbours are scattered over the mesh: those of the slot after next are sent for.
    for (const auto& nodes : slots_[std::min(k + 2, slots_.size() - 1)].node)
      for (int n : nodes) SimdPack::prefetch(x[std::size_t(n)]);
    const Slot& s = slots_[k];
    const Shape now = shape(self, s, x);
    const DilatationSample<SimdPack> h = material_.dilatation(now.J);
    const SimdPack stretch = mu * s.volume * now.gamma, push = s.volume * h.stress, bulk = s.volume * h.stiffness;
    Vector bulk_area;
    for (std::size_t i = 0; i < 3; ++i) {
      force[i] -= stretch * now.F[0][i] + push * now.area[i];
      block[i] += stretch * now.gamma;
      bulk_area[i] = bulk * now.area[i];
    }
    for (std::size_t m = 0; m < 6; ++m) block[m] += bulk_area[row[m]] * now.area[column[m]];
    if (rate > 0.0) {
      const SimdPack w = (2.0 * rate) * s.volume * now.gamma;
      const Vector change = difference(square(now), start[k]);
      for (std::size_t i = 0; i < 3; ++i)
        force[i] -= w * (now.F[0][i] * change[0] + now.F[1][i] * change[1] + now.F[2][i] * change[2]);
      const SimdPack wg = w * now.gamma;
      for (std::size_t m = 0; m < 6; ++m) {
        const std::size_t i = row[m], j = column[m];
        block[m] += wg * (2.0 * now.F[0][i] * now.F[0][j] + now.F[1][i] * now.F[1][j] + now.F[2][i] * now.F[2][j]);
      }
    }
  }
  for (std::size_t lane = 0; lane < width; ++lane) {
    out[lane].force += Vec3d(force[0][lane], force[1][lane], force[2][lane]);
    for (std::size_t m = 0; m < 6; ++m) {
      out[lane].block(Eigen::Index(row[m]), Eigen::Index(column[m])) += block[m][lane];
      if (m > 2) out[lane].block(Eigen::Index(column[m]), Eigen::Index(row[m])) += block[m][lane];
    }
  }
}

}  // namespace lumo

#endif

// ---- lumo/mechanics/solvers/descent_model.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_DESCENT_MODEL_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_DESCENT_MODEL_HPP

namespace lumo {

/// Where the sweeps of a time step begin.
enum class Predictor {
  position,     ///< where the last step ended
  inertia,      ///< as if nothing held it: x + v Δt, as Newton 1.8 does
  acceleration  ///< as if the last step's acceleration went on: x + v Δt + a Δt² (Chen et al. 2024, without their clamp
                ///< to gravity)
};

/// Settings of vertex block descent; the defaults are the paper's.
struct DescentConfig {
  double time_step_s = 0.01;
  int sweeps = 10;  ///< per time step
  Predictor predictor = Predictor::inertia;
  double density_kg_per_m3 = 1070.0;  ///< Dragon Skin
  double viscosity_Pa_s = 10.0;       ///< η on the rate of C = FᵀF
  double speed_m_per_s = 5e-3;        ///< of the indenter's advance
  double hold_s = 1.0;                ///< at each load
  double slip_speed_m_per_s = 1e-2;   ///< below it friction is smooth
  double detection_m = 1e-3;          ///< points nearer than this at a step's start are watched during the step
  double max_advance_m = 20e-3;       ///< a load that is not met by then is given up
  double time_limit_s = 1e9;          ///< per scenario, wall clock
  bool packs = true;                  ///< eight vertices of a color at once, where material and element allow it
  VertexColors colors = {};           ///< empty: color_vertices
  PressWatch watch = {};              ///< called after each time step, and as a load ends
};

/// Throws InvalidArgument for settings out of range.
inline void validate(const DescentConfig& c) {
  require_in_range("time step", c.time_step_s, 1e-6, 1.0, "s");
  require_in_range("sweeps", c.sweeps, 1, 1e6, "");
  require_in_range("density", c.density_kg_per_m3, 1.0, 1e5, "kg/m3");
  require_in_range("viscosity", c.viscosity_Pa_s, 0.0, 1e6, "Pa s");
  require_in_range("speed of the indenter", c.speed_m_per_s * 1e3, 1e-3, 1e3, "mm/s");
  require_in_range("time of a hold", c.hold_s, 0.0, 1e3, "s");
  require_in_range("slip speed", c.slip_speed_m_per_s, 1e-9, 1e3, "m/s");
  require_in_range("distance at which contact is watched", c.detection_m * 1e3, 1e-3, 100.0, "mm");
  require_in_range("largest advance", c.max_advance_m * 1e3, 1e-3, 1e3, "mm");
  require_in_range("time limit of a scenario", c.time_limit_s, 0.0, 1e12, "s");
}

namespace detail {

struct NoPacks {
  struct Start {};
};
template <class Material, class Element> struct PacksFor { using type = NoPacks; };
template <DilatationalMaterial Material> struct PacksFor<Material, LinearTet> { using type = VertexPacks<Material>; };

}  // namespace detail

/// All that does not change between scenarios on one mesh: masses, colors, elements, surfaces.
template <HyperelasticMaterial Material, ContactHandler Contact, TetElement Element> struct DescentModel {
  using Packs = typename detail::PacksFor<Material, Element>::type;
  static constexpr bool batched = !std::same_as<Packs, detail::NoPacks>;

  Sector sector;
  Contact contact;
  VertexElasticity<Material, Element> elasticity;
  ContactSurface touchable;  ///< against the indenter
  ContactSurface resting;    ///< against the carrier
  Carrier carrier;
  std::vector<double> mass;  ///< per node [kg]
  std::vector<char> moves;   ///< per node: it is not bonded
  VertexColors colors;       ///< of the nodes that move
  bool resists_inversion;    ///< the material's energy has no bound where J ≤ 0

  std::optional<Packs> packs;  ///< where they are asked for

  /// Throws InvalidArgument when the given colors are none.
  DescentModel(const Body& body, const TetMesh& mesh, Symmetry planes,
      const PressPhysics<Material, Contact, Element>& physics, const DescentConfig& config)
      : sector(sector_of(mesh, planes)),
        contact(physics.contact),
        elasticity(sector.mesh, physics.material, physics.element),
        touchable(
            sector.mesh, body, [](const Patch& p) { return p.contactable; }, contact),
        resting(
            sector.mesh, body, [](const Patch& p) { return p.meets_carrier; }, contact),
        carrier{body.carrier},
        mass(lumped_masses<Element>(sector.mesh, config.density_kg_per_m3)),
        moves(sector.mesh.nodes.size(), 1),
        resists_inversion(!std::isfinite(energy_density(physics.material, Mat3d(-Mat3d::Identity())))) {
    for (const BoundaryFace& f : sector.mesh.faces)
      if (body.patches[std::size_t(f.patch)].bonded)
        for (int k = 0; k < sector.mesh.nodes_per_face(); ++k) moves[std::size_t(f.nodes[std::size_t(k)])] = 0;
    const VertexColors all = config.colors.empty() ? color_vertices(sector.mesh) : config.colors;
    validate(all, sector.mesh);
    for (const std::vector<int>& color : all) {
      colors.emplace_back();
      for (int v : color)
        if (moves[std::size_t(v)]) colors.back().push_back(v);
    }
    if constexpr (batched)
      if (config.packs) packs.emplace(sector.mesh, elasticity, colors);
  }
  DescentModel(const DescentModel&) = delete;  // elements and surfaces point into the sector's mesh
  DescentModel& operator=(const DescentModel&) = delete;
};

}  // namespace lumo

#endif

// ---- lumo/mechanics/solvers/vertex_block_descent.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_VERTEX_BLOCK_DESCENT_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_SOLVERS_VERTEX_BLOCK_DESCENT_HPP

namespace lumo {

/// The paper's solver: implicit Euler in time, each step a fixed number of sweeps over the vertices, color by color;
/// each vertex is moved by Newton's method on its own three components, with inertia, elasticity, viscosity and contact
/// in the 3×3 block. The indenter advances at a constant speed until a load is met, then stands still for `hold_s`, and
/// the state is recorded: `held`, which says nothing of equilibrium. Vertices of one color do not meet, so that any
/// executor gives the same bits. Source: Chen, Liu, Yang, Yuksel 2024 (vertex block descent); protocol of the paper's
/// §III-B and its table of settings.
template <Executor E = Serial> struct BlockDescent {
  template <class Material, class Contact, class Element> using Model = DescentModel<Material, Contact, Element>;
  using Config = DescentConfig;
  static constexpr bool uses_symmetry = false;
  Config config = {};
  E executor = {};

  /// Throws InvalidArgument for settings out of range and for colors that are none.
  template <class Material, class Contact, class Element>
  std::unique_ptr<Model<Material, Contact, Element>> model(const Body& body, const TetMesh& mesh, Symmetry planes,
      const PressPhysics<Material, Contact, Element>& physics) const {
    validate(config);
    return std::make_unique<Model<Material, Contact, Element>>(body, mesh, planes, physics, config);
  }

  /// States after each load's hold. A load that is not met within `max_advance_m` ends as max_iterations; a step
  /// without finite positions as non_finite, with the state before it.
  template <class SomeModel, Indenter Tool>
  std::vector<MechanicalState> run(const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const;
};

using VertexBlockDescent = BlockDescent<>;

/// One body under one indenter in time.
template <class Model, Indenter Tool, Executor E> class Descent {
 public:
  Descent(const Model& model, const Tool& tool, const Touch& touch, const Vec3d& direction, const DescentConfig& config,
      const E& executor)
      : model_(model),
        config_(config),
        executor_(executor),
        tool_(tool),
        origin_(touch.origin),
        direction_(direction),
        x_(positions_of(model.sector.mesh)),
        start_(x_),
        target_(x_),
        velocity_(Positions::Zero(3, x_.cols())),
        last_velocity_(velocity_),
        touching_(model.touchable, model.contact, friction_coefficient(model.contact)),
        resting_(model.resting, model.contact, carrier_friction(model.contact)) {
    if constexpr (Model::batched)
      if (model.packs) {
        points_.resize(std::size_t(x_.cols()));
        packs_start_.resize(model.packs->slots());
        place_all();
      }
  }

  /// One time step, at whose start the indenter moves on by `by` [m]. False when it ends without sound positions; then
  /// all is as it was before.
  bool step(double by) {
    advance_ += by;
    const double dt = config_.time_step_s, stick = config_.slip_speed_m_per_s * dt;
    start_ = x_;
    remember();
    predict();
    place_all();
    touching_.find(
        start_, {&tool_, origin_ + advance_ * direction_, direction_}, by * direction_, config_.detection_m, stick);
    resting_.find(start_, {&model_.carrier, Vec3d::Zero(), Vec3d::UnitZ()}, Vec3d::Zero(), config_.detection_m, stick);
    for (int k = 0; k < config_.sweeps; ++k) sweep();
    if (!(x_.array().abs() < lost_m).all()) {
      x_ = start_;
      advance_ -= by;
      place_all();
      return false;
    }
    last_velocity_ = velocity_;
    velocity_ = (x_ - start_) / dt;
    return true;
  }

  /// What the indenter feels against its advance [N].
  double push() const { return touching_.sum(x_, nullptr).force.dot(direction_); }
  /// Friction on the nodes, and its part of the push.
  double friction(std::vector<Vec3d>& on_nodes) const {
    on_nodes.assign(std::size_t(x_.cols()), Vec3d::Zero());
    resting_.sum(x_, &on_nodes);
    return touching_.sum(x_, &on_nodes).friction.dot(direction_);
  }
  const Positions& positions() const { return x_; }
  double advance() const { return advance_; }

 private:
  // That far off, a pad is as lost as with NaN, and its forces are about to overflow.
  static constexpr double lost_m = 1e3;

  double rate() const { return config_.viscosity_Pa_s / config_.time_step_s; }

  // Copies a vertex's position for the packs.
  void place(int v) {
    if constexpr (Model::batched)
      if (model_.packs) points_[std::size_t(v)] = {SimdPack::Point::Register{x_(0, v), x_(1, v), x_(2, v), 0.0}};
  }
  void place_all() {
    for (int v = 0; v < int(x_.cols()); ++v) place(v);
  }
  void remember() {
    if constexpr (Model::batched)
      if (rate() > 0.0) for_batches([&](const auto& batch) { model_.packs->remember(batch, points_, packs_start_); });
  }

  // Where inertia alone would carry the vertices, and where the sweeps begin.
  void predict() {
    const double dt = config_.time_step_s;
    target_ = start_ + dt * velocity_;
    Positions ahead = Positions::Zero(3, x_.cols());
    if (config_.predictor != Predictor::position) ahead = dt * velocity_;
    if (config_.predictor == Predictor::acceleration) ahead += dt * (velocity_ - last_velocity_);
    for (Eigen::Index v = 0; v < x_.cols(); ++v)
      if (!model_.moves[std::size_t(v)]) ahead.col(v).setZero();
    x_ = start_ + ahead;
    // A law without an energy inside out must not begin there.
    if (model_.resists_inversion && config_.predictor != Predictor::position) {
      const double floor = 0.2 * model_.elasticity.smallest_J(start_);
      for (int k = 0; k < 10 && !(model_.elasticity.smallest_J(x_) > floor); ++k) {
        ahead *= 0.5;
        x_ = start_ + ahead;
      }
      if (!(model_.elasticity.smallest_J(x_) > floor)) x_ = start_;
    }
  }

  // Pieces of work that are large enough to hand out.
  static constexpr std::size_t piece = 16;

  template <class Visit> void for_batches(Visit&& visit) const {
    if constexpr (Model::batched)
      if (model_.packs)
        for (const auto& batches : model_.packs->batches())
          over(batches.size(), [&](std::size_t k) { visit(batches[k]); });
  }
  template <class Visit> void over(std::size_t count, Visit&& visit) const {
    executor_.for_each((count + piece - 1) / piece, [&](std::size_t p) {
      for (std::size_t k = p * piece; k < std::min(count, (p + 1) * piece); ++k) visit(k);
    });
  }

  void sweep() {
    if constexpr (Model::batched)
      if (model_.packs) {
        for_batches([&](const auto& batch) {
          std::array<VertexBlock, SimdPack::width> blocks;
          model_.packs->add(batch, points_, packs_start_, rate(), blocks);
          std::array<Vec3d, SimdPack::width> steps;
          steps.fill(Vec3d::Zero());
          for (std::size_t lane = 0; lane < SimdPack::width; ++lane)
            if (batch.moves[lane]) steps[lane] = step_of(batch.vertex[lane], blocks[lane]);
          if (model_.resists_inversion) {
            const auto part = model_.packs->feasible_parts(batch, points_, steps);
            for (std::size_t lane = 0; lane < SimdPack::width; ++lane) steps[lane] *= part[lane];
          }
          for (std::size_t lane = 0; lane < SimdPack::width; ++lane)
            if (batch.moves[lane]) {
              x_.col(batch.vertex[lane]) += steps[lane];
              place(batch.vertex[lane]);
            }
        });
        return;
      }
    for (const std::vector<int>& color : model_.colors)
      over(color.size(), [&](std::size_t k) {
        VertexBlock b;
        model_.elasticity.add(color[k], x_, start_, rate(), b);
        const Vec3d step = step_of(color[k], b);
        x_.col(color[k]) +=
            (model_.resists_inversion ? model_.elasticity.feasible_part(color[k], x_, step) : 1.0) * step;
      });
  }

  // Adds inertia and contact, and solves for the vertex's step.
  Vec3d step_of(int v, VertexBlock& b) const {
    const double inertia = model_.mass[std::size_t(v)] / (config_.time_step_s * config_.time_step_s);
    b.force += inertia * (target_.col(v) - x_.col(v));
    b.block += inertia * Mat3d::Identity();
    touching_.add(v, x_, b);
    resting_.add(v, x_, b);
    const Mat3d& H = b.block;
    const Mat3d c = cofactor(H);  // of a symmetric matrix: its inverse times the determinant
    const double determinant = H.col(0).dot(c.col(0));
    if (H(0, 0) > 0.0 && c(2, 2) > 0.0 && determinant > 1e-14 * H(0, 0) * H(1, 1) * H(2, 2))
      return c * b.force / determinant;
    if (!H.allFinite() || !b.force.allFinite())
      return Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());  // seen at the step's end
    // Curvatures that are negative change sign: a step along them still lowers the energy.
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(H);
    const Vec3d l = eigen.eigenvalues().cwiseAbs();
    return eigen.eigenvectors() *
           (eigen.eigenvectors().transpose() * b.force).cwiseQuotient(l.cwiseMax(1e-9 * l.maxCoeff()));
  }

  const Model& model_;
  const DescentConfig& config_;
  const E& executor_;
  const Tool& tool_;
  Vec3d origin_, direction_;
  double advance_ = 0.0;
  Positions x_, start_, target_, velocity_, last_velocity_;
  StepContacts<std::decay_t<decltype(std::declval<Model>().contact)>, Tool> touching_;
  StepContacts<std::decay_t<decltype(std::declval<Model>().contact)>, Carrier> resting_;
  std::vector<SimdPack::Point> points_;  // x_ for the packs
  typename Model::Packs::Start packs_start_;
};

template <Executor E> template <class SomeModel, Indenter Tool> std::vector<MechanicalState> BlockDescent<E>::run(
    const SomeModel& model, const Scenario<Tool>& scenario, const Touch& touch) const {
  const Stopwatch watch;
  Descent<SomeModel, Tool, E> body(model, scenario.indenter, touch, scenario.direction(), config, executor);
  const int hold = int(std::lround(config.hold_s / config.time_step_s));
  std::vector<MechanicalState> states;
  int steps = 0;
  for (double load : scenario.loads_N) {
    MechanicalState state;
    state.load_N = load;
    state.status = Status::held;
    const int before = steps;
    const auto report = [&](std::optional<Status> ended) {
      const double reached = ended == Status::held ? load : states.empty() ? 0.0 : states.back().load_N;
      if (config.watch)
        config.watch({load, reached, body.advance(), config.sweeps * (steps - before), std::nullopt, ended});
    };
    const auto go = [&](double by) {
      ++steps;
      if (!body.step(by)) state.status = Status::non_finite;
      else if (watch.seconds() > config.time_limit_s) state.status = Status::time_limit;
      report({});
    };
    while (state.status == Status::held && body.push() < load) {
      if (body.advance() >= config.max_advance_m) state.status = Status::max_iterations;
      else go(config.speed_m_per_s * config.time_step_s);
    }
    state.met_force_N = body.push();
    for (int k = 0; k < hold && state.status == Status::held; ++k) go(0.0);
    state.iterations = config.sweeps * (steps - before);
    state.depth_m = body.advance();
    const auto& x = body.positions();
    for (std::size_t k = 0; k < model.sector.mesh.nodes.size(); ++k)
      state.displacement.push_back(x.col(Eigen::Index(k)) - model.sector.mesh.nodes[k]);
    if (friction_coefficient(model.contact) > 0.0 || carrier_friction(model.contact) > 0.0)
      state.friction_push_N = body.friction(state.friction_N);
    report(state.status);
    states.push_back(std::move(state));
    if (states.back().status != Status::held) break;
  }
  return states;
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

// ---- lumo/drawing/svg.hpp
#ifndef SINGLE_INCLUDE_LUMO_DRAWING_SVG_HPP
#define SINGLE_INCLUDE_LUMO_DRAWING_SVG_HPP

namespace lumo {

/// A number with at most `digits` decimals and no trailing zeros; the same in every locale. "?" where that takes more
/// than 400 characters.
inline std::string short_number(double v, int digits = 2) {
  std::array<char, 400> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), v, std::chars_format::fixed, digits);
  if (end.ec != std::errc{}) return "?";
  std::string s(buffer.data(), end.ptr);
  if (s.find('.') != std::string::npos) {
    while (s.back() == '0') s.pop_back();
    if (s.back() == '.') s.pop_back();
  }
  return s == "-0" ? "0" : s;
}

/// Writes an SVG picture, element by element; coordinates in px or in the page's unit, x to the right, y downwards.
class Svg {
 public:
  using Point = std::array<double, 2>;
  using Points = std::vector<Point>;

  struct Page {
    double width, height;
    std::string unit = {};  ///< of width and height on paper; empty: px
    std::string title = {};
    int digits = 2;  ///< decimals of all numbers
  };
  /// How a shape is painted; an empty colour means none.
  struct Paint {
    std::string fill = {};
    std::string stroke = {};
    double width = 1.0;
    double opacity = 1.0;
    std::string dash = {};
    bool round_ends = false;
  };
  /// Which end of a text stands at its place; `left_out` is `start`, too, but not written.
  enum Anchor { start, middle, end, left_out };
  struct TextStyle {
    double size = 12.0;
    Anchor anchor = start;
    std::string fill = "#222222";
    double rotate_deg = 0.0;  ///< about the anchor point
    bool bold = false;
    std::string stroke = {};  ///< empty: that of the group
  };

  explicit Svg(Page page) : page_(std::move(page)) {}
  Svg(double width, double height) : Svg(Page{width, height}) {}

  double width() const { return page_.width; }
  double height() const { return page_.height; }

  void line(Point a, Point b, const Paint& p) {
    body_ += "<line" + place("x1", "y1", a) + place("x2", "y2", b) + style(p) + "/>\n";
  }
  /// Corners are rounded by `radius`.
  void rect(Point corner, double w, double h, const Paint& p, double radius = 0.0) {
    body_ += box(corner, w, h) + (radius > 0.0 ? quoted("rx", n(radius)) : "") + style(p) + "/>\n";
  }
  void circle(Point c, double r, const Paint& p) {
    body_ += "<circle" + place("cx", "cy", c) + quoted("r", n(r)) + style(p) + "/>\n";
  }
  void polyline(const Points& points, const Paint& p) { path(trace(points), p); }
  /// Several lines as one element.
  void polylines(const std::vector<Points>& lines, const Paint& p) {
    std::string d;
    for (const Points& line : lines) d += trace(line);
    path(d, p);
  }
  /// One filled shape of several closed loops; holes by the even–odd rule.
  void polygon(const std::vector<Points>& loops, const Paint& p) {
    std::string d;
    for (const Points& loop : loops) d += trace(loop) + "Z";
    path(d, p);
  }
  /// A line that is painted as its group says.
  void outline(const Points& points, bool closed) {
    body_ += "<path d=\"" + trace(points) + (closed ? "Z\"/>\n" : "\"/>\n");
  }
  void text(Point at, std::string_view words) { text(at, words, TextStyle{}); }
  void text(Point at, std::string_view words, const TextStyle& t) {
    body_ += "<text" + place("x", "y", at) + quoted("font-size", n(t.size)) + given("text-anchor", words_of(t.anchor)) +
             quoted("fill", t.fill) + given("stroke", t.stroke);
    if (t.bold) body_ += " font-weight=\"bold\"";
    if (t.rotate_deg != 0.0)
      body_ += quoted("transform", "rotate(" + n(t.rotate_deg) + " " + n(at[0]) + " " + n(at[1]) + ")");
    body_ += ">" + escaped(words) + "</text>\n";
  }
  /// All elements up to end_group(), under a name that other programs show as a layer.
  void begin_group(const std::string& name, const Paint& p) { body_ += "<g" + quoted("id", name) + style(p) + ">\n"; }
  /// Only what lies in a box is shown of the elements up to end_group(). Once in a picture.
  void begin_clip(Point corner, double w, double h) {
    body_ += "<clipPath id=\"plot\">" + box(corner, w, h) + "/></clipPath>\n<g clip-path=\"url(#plot)\">\n";
  }
  void end_group() { body_ += "</g>\n"; }

  std::string str() const {
    const std::string w = n(page_.width), h = n(page_.height);
    return "<svg xmlns=\"http://www.w3.org/2000/svg\"" + quoted("width", w + page_.unit) +
           quoted("height", h + page_.unit) + quoted("viewBox", "0 0 " + w + " " + h) +
           " font-family=\"DejaVu Sans, Verdana, Helvetica, sans-serif\">\n" +
           (page_.title.empty() ? "" : "<title>" + escaped(page_.title) + "</title>\n") +
           "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n" + body_ + "</svg>\n";
  }
  /// Throws InputError when the stream fails.
  void write(std::ostream& out) const {
    if (!(out << str())) throw InputError("writing an .svg file failed");
  }

 private:
  std::string n(double v) const { return short_number(v, page_.digits); }
  static std::string quoted(const char* key, const std::string& value) {
    return std::string(" ") + key + "=\"" + value + "\"";
  }
  static std::string given(const char* key, const std::string& value) {
    return value.empty() ? "" : quoted(key, value);
  }
  static std::string words_of(Anchor a) {
    return a == left_out ? "" : a == end ? "end" : a == middle ? "middle" : "start";
  }
  std::string place(const char* x, const char* y, Point p) const { return quoted(x, n(p[0])) + quoted(y, n(p[1])); }
  std::string box(Point corner, double w, double h) const {
    return "<rect" + place("x", "y", corner) + quoted("width", n(w)) + quoted("height", n(h));
  }
  static std::string escaped(std::string_view s) {
    std::string out;
    for (const char c : s) {
      if (c == '&') out += "&amp;";
      else if (c == '<') out += "&lt;";
      else if (c == '>') out += "&gt;";
      else out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;  // XML has no control characters
    }
    return out;
  }
  std::string trace(const Points& points) const {
    std::string d;
    for (const Point& p : points) d += (d.empty() ? "M" : "L") + n(p[0]) + " " + n(p[1]);
    return d;
  }
  std::string style(const Paint& p) const {
    std::string s = quoted("fill", p.fill.empty() ? "none" : p.fill);
    if (!p.stroke.empty())
      s += quoted("stroke", p.stroke) + quoted("stroke-width", n(p.width)) + " stroke-linejoin=\"round\"";
    if (p.opacity < 1.0) s += quoted("opacity", n(p.opacity));
    if (p.round_ends) s += " stroke-linecap=\"round\"";
    return s + given("stroke-dasharray", p.dash);
  }
  void path(const std::string& d, const Paint& p) {
    body_ += "<path fill-rule=\"evenodd\"" + quoted("d", d) + style(p) + "/>\n";
  }

  Page page_;
  std::string body_;
};

/// "#rrggbb" of red, green and blue, each 0 … 255.
inline std::string hex_colour(const std::array<int, 3>& rgb) {
  std::string colour = "#";
  for (const int c : rgb)
    for (const int digit : {c / 16, c % 16}) colour += "0123456789abcdef"[digit];
  return colour;
}

/// "#rrggbb" at `part`, 0 … 1, of the way through evenly spaced stops: red, green and blue, each 0 … 255.
template <std::size_t N> std::string colour_between(const std::array<std::array<double, 3>, N>& stops, double part) {
  const double t = double(N - 1) * std::clamp(part, 0.0, 1.0);
  const std::size_t low = std::min(N - 2, std::size_t(t));
  std::array<int, 3> rgb{};
  for (std::size_t k = 0; k < 3; ++k)
    rgb[k] = int(std::lround(stops[low][k] + (t - double(low)) * (stops[low + 1][k] - stops[low][k])));
  return hex_colour(rgb);
}

}  // namespace lumo

#endif

// ---- lumo/drawing/plot.hpp
#ifndef SINGLE_INCLUDE_LUMO_DRAWING_PLOT_HPP
#define SINGLE_INCLUDE_LUMO_DRAWING_PLOT_HPP

/// Headline and axes of a picture with a plot in it.
namespace lumo::plot {

inline constexpr const char *ink = "#222222", *faint = "#dddddd", *grey = "#666666";

/// Plot area; maps data to px. Ticks in units of the data.
struct Frame {
  double left = 72, top = 58, right = 0, bottom = 0;
  std::vector<double> x_ticks = {}, y_ticks = {};
  double x0 = 0, x1 = 1, y0 = 0, y1 = 1;

  double x(double v) const { return left + (v - x0) / (x1 - x0) * (right - left); }
  double y(double v) const { return bottom - (v - y0) / (y1 - y0) * (bottom - top); }
  /// The axes end at the first and at the last tick.
  void fit_x() {
    x0 = x_ticks.front();
    x1 = x_ticks.back();
  }
  void fit_y() {
    y0 = y_ticks.front();
    y1 = y_ticks.back();
  }
};

/// Round tick values that cover [low, high].
inline std::vector<double> ticks(double low, double high, int wanted) {
  if (!(high > low)) high = low + 1.0;
  const double raw = (high - low) / wanted, power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10.0 * power;
  for (const double s : {5.0, 2.5, 2.0, 1.0})
    if (s * power >= raw * (1.0 - 1e-9)) step = s * power;
  std::vector<double> out;
  // What sticks out by a millionth of a step (15.0000001 N) does not earn a tick of its own.
  const int first = int(std::floor(low / step + 1e-6));
  const int last = std::max(int(std::ceil(high / step - 1e-6)), first + 1);
  for (int k = first; k <= last; ++k) out.push_back(k * step);
  return out;
}

/// Small magnitudes get a common power of ten in the axis label, not zeros at every tick.
inline int common_exponent(const std::vector<double>& t) {
  const double largest = std::max(std::abs(t.front()), std::abs(t.back()));
  if (largest == 0.0) return 0;
  const int e = int(std::floor(std::log10(largest) + 1e-9));
  return e < -2 || e > 4 ? e : 0;
}

/// A label with the power of ten by which the axis is divided in its unit.
inline std::string with_power(const std::string& label, int e) {
  if (e == 0) return label;
  static constexpr std::array<std::string_view, 10> raised = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string power = e < 0 ? "10⁻" : "10";
  for (const char c : std::to_string(std::abs(e))) power += raised[std::size_t(c - '0')];
  const std::size_t unit = label.rfind('[');
  return unit == std::string::npos ? label + " [" + power + "]"
                                   : label.substr(0, unit + 1) + power + " " + label.substr(unit + 1);
}

/// Tick values as they stand at an axis that is divided by a power of ten, with a true minus sign.
inline std::vector<std::string> tick_texts(std::vector<double> values, int exponent) {
  for (double& v : values) v /= std::pow(10.0, exponent);
  int digits = 0;
  for (double s = values.size() > 1 ? values[1] - values[0] : 1.0; digits < 9 && std::abs(s - std::round(s)) > 1e-6 * s;
       s *= 10.0)
    ++digits;
  std::vector<std::string> texts;
  for (const double v : values) {
    const std::string s = short_number(v, digits);
    texts.push_back(s.starts_with('-') ? "−" + s.substr(1) : s);
  }
  return texts;
}

inline void headline(Svg& svg, double left, const std::string& title, const std::string& subtitle) {
  svg.text({left, 24}, title, {.size = 15, .bold = true});
  svg.text({left, 43}, subtitle, {.fill = grey});
}

inline void x_grid(Svg& svg, const Frame& f, int exponent = 0) {
  const std::vector<std::string> texts = tick_texts(f.x_ticks, exponent);
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const double x = f.x(f.x_ticks[k]);
    svg.line({x, f.top}, {x, f.bottom}, {.stroke = faint});
    svg.text({x, f.bottom + 18}, texts[k], {.anchor = Svg::middle});
  }
}

inline void y_grid(Svg& svg, const Frame& f, int exponent = 0) {
  const std::vector<std::string> texts = tick_texts(f.y_ticks, exponent);
  for (std::size_t k = 0; k < texts.size(); ++k) {
    const double y = f.y(f.y_ticks[k]);
    svg.line({f.left, y}, {f.right, y}, {.stroke = faint});
    svg.text({f.left - 8, y + 4}, texts[k], {.anchor = Svg::end});
  }
}

inline void x_label(Svg& svg, const Frame& f, const std::string& label) {
  svg.text({0.5 * (f.left + f.right), f.bottom + 42}, label, {.size = 13, .anchor = Svg::middle});
}

/// `at`: the baseline's place, in px from the left.
inline void y_label(Svg& svg, const Frame& f, const std::string& label, double at = 22) {
  svg.text({at, 0.5 * (f.top + f.bottom)}, label, {.size = 13, .anchor = Svg::middle, .rotate_deg = -90});
}

/// Grid and label, divided by 10 to the `exponent`.
inline void x_axis(Svg& svg, const Frame& f, const std::string& label, int exponent = 0) {
  x_grid(svg, f, exponent);
  x_label(svg, f, with_power(label, exponent));
}

/// Grid and label, divided by a power of ten where the numbers ask for it.
inline void y_axis(Svg& svg, const Frame& f, const std::string& label) {
  const int exponent = common_exponent(f.y_ticks);
  y_grid(svg, f, exponent);
  y_label(svg, f, with_power(label, exponent));
}

}  // namespace lumo::plot

#endif

// ---- lumo/mechanics/press_svg.hpp
#ifndef SINGLE_INCLUDE_LUMO_MECHANICS_PRESS_SVG_HPP
#define SINGLE_INCLUDE_LUMO_MECHANICS_PRESS_SVG_HPP

namespace lumo {

/// Writes an SVG picture of the pressed body: a cut through it across y at the place of touch, coloured by how far the
/// material has moved, over its undeformed outline, with carrier and indenter; axes x and z in mm. Throws
/// InvalidArgument for a state that has no displacement on this mesh, or when the indenter passes by; InputError when
/// the stream fails.
template <Indenter Tool> void write_press_svg(std::ostream& out, const Body& body, const TetMesh& mesh,
    const Scenario<Tool>& scenario, const MechanicalState& state);

namespace detail {

/// A point of a cut in mm, with how far it has moved.
struct CutPoint {
  double x, z, moved_mm;
};

/// The body where a plane across y cuts it.
struct BodyCut {
  std::vector<std::vector<CutPoint>> areas;    ///< of the elements, pressed
  std::vector<std::vector<CutPoint>> outline;  ///< of the surface before, line by line
};

/// Where the plane y = `at` cuts a tetrahedron or triangle with these corners, in order around the cut. A corner in the
/// plane counts as beyond it.
template <std::size_t N> std::vector<CutPoint> cut_across(
    const std::array<Vec3d, N>& corners, const std::array<double, N>& moved_mm, double at) {
  std::vector<CutPoint> points;
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t j = 0; j < N; ++j) {
      if (!(corners[i].y() < at) || corners[j].y() < at) continue;
      const double t = (at - corners[i].y()) / (corners[j].y() - corners[i].y());
      const Vec3d p = corners[i] + t * (corners[j] - corners[i]);
      points.push_back({1e3 * p.x(), 1e3 * p.z(), moved_mm[i] + t * (moved_mm[j] - moved_mm[i])});
    }
  if (points.size() == 4) std::swap(points[2], points[3]);  // edges come as ac, ad, bc, bd
  return points;
}

inline BodyCut cut_body(const TetMesh& mesh, const MechanicalState& state, double at) {
  const auto cut = [&]<std::size_t N>(const auto& nodes, const std::array<int, N>& part, bool pressed) {
    std::array<Vec3d, N> p;
    std::array<double, N> moved;
    for (std::size_t k = 0; k < N; ++k) {
      const auto n = std::size_t(nodes[std::size_t(part[k])]);
      p[k] = pressed ? Vec3d(mesh.nodes[n] + state.displacement[n]) : mesh.nodes[n];
      moved[k] = 1e3 * state.displacement[n].norm();
    }
    return cut_across(p, moved, at);
  };
  const bool quadratic = mesh.order == 2;
  BodyCut out;
  for (const auto& t : mesh.tets)
    for (std::size_t k = 0; k < (quadratic ? 8 : 1); ++k) {
      auto area = cut(t, quadratic ? std::to_array(LinearPatchTet::parts[k]) : std::array{0, 1, 2, 3}, true);
      if (area.size() >= 3) out.areas.push_back(std::move(area));
    }
  for (const BoundaryFace& f : mesh.faces)
    for (std::size_t k = 0; k < (quadratic ? 4 : 1); ++k) {
      auto line = cut(f.nodes, quadratic ? face_parts()[k] : std::array{0, 1, 2}, false);
      if (line.size() == 2) out.outline.push_back(std::move(line));
    }
  return out;
}

/// A plot with equal scales for all that the plane cuts, with room for what of the indenter is near.
inline plot::Frame frame_around(const BodyCut& cut) {
  constexpr double tick_mm = 5.0, longest_px = 560.0;
  double x_low = 0.0, x_high = 0.0, z_high = 0.0;
  for (const auto* lines : {&cut.areas, &cut.outline})
    for (const auto& line : *lines)
      for (const CutPoint& p : line) {
        x_low = std::min(x_low, p.x);
        x_high = std::max(x_high, p.x);
        z_high = std::max(z_high, p.z);
      }
  const auto next = [](double v, double room) { return std::ceil(v / tick_mm + room); };
  plot::Frame f{.left = 64.0, .top = 56.0};
  for (double k = -next(-x_low, 0.2); k <= next(x_high, 0.2); ++k) f.x_ticks.push_back(k * tick_mm);
  for (double k = -1.0; k <= next(z_high, 0.2) + 1.0; ++k) f.y_ticks.push_back(k * tick_mm);
  f.fit_x();
  f.fit_y();
  const double scale = longest_px / std::max(f.x1 - f.x0, f.y1 - f.y0);
  f.right = f.left + scale * (f.x1 - f.x0);
  f.bottom = f.top + scale * (f.y1 - f.y0);
  return f;
}

/// Lightness falls with the value, which survives greyscale print; the hue is the same for any colour vision.
inline std::string moved_colour(double part) {
  constexpr std::array<std::array<double, 3>, 4> stops{{{235, 243, 250}, {141, 190, 222}, {43, 119, 184}, {8, 44, 92}}};
  return colour_between(stops, part);
}

/// Lines, in px, along which a distance that is given for places in the plot changes its sign, on a grid of triangles.
template <class Distance> std::vector<Svg::Points> zero_lines(const plot::Frame& f, const Distance& distance) {
  constexpr double step = 0.25;  // [mm]
  std::vector<Svg::Points> lines;
  for (double x = f.x0; x < f.x1; x += step)
    for (double z = f.y0; z < f.y1; z += step)
      for (const double upper : {0.0, step}) {
        const std::array<Svg::Point, 3> corner{{{x + upper, z + upper}, {x + step, z}, {x, z + step}}};
        Svg::Points line;
        for (std::size_t i = 0; i < 3; ++i) {
          const auto &a = corner[i], &b = corner[(i + 1) % 3];
          const double da = distance(a[0], a[1]), db = distance(b[0], b[1]), t = da / (da - db);
          if ((da < 0.0) != (db < 0.0)) line.push_back({f.x(a[0] + t * (b[0] - a[0])), f.y(a[1] + t * (b[1] - a[1]))});
        }
        if (line.size() == 2) lines.push_back(std::move(line));
      }
  return lines;
}

/// The scale of colours, right of the plot.
inline void draw_colour_bar(Svg& svg, const plot::Frame& f, double most_mm) {
  constexpr int steps = 40;
  const double left = f.right + 24.0, height = std::min(220.0, f.bottom - f.top);
  for (int k = 0; k < steps; ++k)
    svg.rect({left, f.top + height * (steps - 1 - k) / steps}, 18, height / steps + 0.5,
        {.fill = moved_colour((k + 0.5) / steps)});
  for (const double part : {0.0, 0.5, 1.0})
    svg.text({left + 24, f.top + height * (1.0 - part) + 4}, short_number(part * most_mm));
  svg.text({left, f.top + height + 22}, "moved by [mm]");
}

inline Svg::Points to_px(const plot::Frame& f, const std::vector<CutPoint>& points) {
  Svg::Points px;
  for (const CutPoint& p : points) px.push_back({f.x(p.x), f.y(p.z)});
  return px;
}

}  // namespace detail

template <Indenter Tool> void write_press_svg(std::ostream& out, const Body& body, const TetMesh& mesh,
    const Scenario<Tool>& scenario, const MechanicalState& state) {
  if (state.displacement.size() != mesh.nodes.size())
    throw InvalidArgument(message("picture: the state has ", state.displacement.size(), " displacements, the mesh ",
        mesh.nodes.size(), " nodes"));
  const Touch touch = first_touch(body, mesh, scenario);
  const Vec3d tool = touch.origin + state.depth_m * scenario.direction();
  const double y = touch.point.y();
  const detail::BodyCut cut = detail::cut_body(mesh, state, y);
  const plot::Frame f = detail::frame_around(cut);
  double most_mm = 0.0;
  for (const auto& area : cut.areas)
    for (const detail::CutPoint& p : area) most_mm = std::max(most_mm, p.moved_mm);

  Svg svg(f.right + 130.0, f.bottom + 60.0);
  plot::headline(svg, f.left,
      "Pressed to " + short_number(state.force_N, 1) + " N: " + short_number(1e3 * state.depth_m) + " mm deep, " +
          short_number(1e6 * state.contact_area_m2, 1) + " mm² of contact",
      "cut at y = " + short_number(1e3 * y) + " mm; dashed: the surface before");
  plot::x_axis(svg, f, "across x [mm]");
  plot::y_axis(svg, f, "height z [mm]");
  svg.begin_clip({f.left, f.top}, f.right - f.left, f.bottom - f.top);
  for (const RigidBox& box : body.carrier) {
    if (std::abs(y - box.center.y()) > box.half.y()) continue;
    const Vec3d low = 1e3 * (box.center - box.half), high = 1e3 * (box.center + box.half);
    svg.rect({f.x(low.x()), f.y(high.z())}, f.x(high.x()) - f.x(low.x()), f.y(low.z()) - f.y(high.z()),
        {.fill = "#8c8c8c"}, f.x(1e3 * box.edge_radius) - f.x(0.0));
  }
  for (const auto& area : cut.areas) {
    double moved = 0.0;
    for (const detail::CutPoint& p : area) moved += p.moved_mm / double(area.size());
    const std::string colour = detail::moved_colour(most_mm > 0.0 ? moved / most_mm : 0.0);
    svg.polygon({detail::to_px(f, area)}, {.fill = colour, .stroke = colour, .width = 0.6});
  }
  const auto distance = [&](double x, double z) {
    return scenario.indenter.distance(Vec3d(1e-3 * x, y, 1e-3 * z) - tool);
  };
  svg.polylines(detail::zero_lines(f, distance), {.stroke = "#d55e00", .width = 2, .round_ends = true});
  std::vector<Svg::Points> outline;
  for (const auto& line : cut.outline) outline.push_back(detail::to_px(f, line));
  svg.polylines(outline, {.stroke = "#444444", .dash = "5 4"});
  svg.end_group();
  detail::draw_colour_bar(svg, f, most_mm);
  svg.write(out);
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
    /// Is the carrier flat where it touches? What its rounded edges add to the tangent is negative, and large where
    /// pressure is.
    bool flat = false;
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
  };
  /// Values at `now`, carried on by (dx, ds) along the slopes at `linear`.
  LinearisationPoint predicted(const Place& now, const Place& linear, const Positions& dx, double ds) const {
    using Touching = ContactPlace<Tool>;
    using Resting = ContactPlace<Carrier>;
    return {model.solid.predicted_ratios(now.x, linear.x, dx),
        predicted_gaps(model.touchable, Touching{indenter(now.advance), now.x},
            Touching{indenter(linear.advance), linear.x}, dx, ds),
        predicted_gaps(model.resting, Resting{support(), now.x}, Resting{support(), linear.x}, dx, 0.0)};
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
          {*systems[k], values[k], nullptr, !about || !about->flat}, rest_history(about));
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
  int stride_iterations = 20;        ///< factorisations before a stride is cut
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
/// the tangent indefinite on the way.
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
        now_{positions_of(model.sector.mesh), 0.0},
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
      const bool lost = s == Status::not_positive_definite || s == Status::inverted || s == Status::line_search ||
                        s == Status::max_iterations;
      if (!lost || ++cuts > most_cuts || iterations >= config_.max_iterations) return s;
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
    auto about = system_.predicted(now_, now_, Positions::Zero(3, now_.x.cols()), 0.0);
    for (SurfaceGaps* gaps : {&about.touch, &about.rest})
      for (std::vector<double>& face : *gaps)
        for (double& g : face) g = g < 0.0 ? softer * g : g;
    touch_nearest(about.touch, area);
    Eigen::VectorXd before;  // residual at the start of the last step; none before the first factor
    bool is_convex = true;   // near the end, with the carrier's curvature
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
        if (iterations >= std::min(stop, config_.max_iterations)) return Status::max_iterations;
        ++iterations;
        touched_.turning = rested_.turning = nearly_there ? 1.0 : 0.0;
        about.flat = !nearly_there || !is_convex;
        system_.tangent(now_.x, now_.advance, 0, 1, tangent_, &about);
        const FactorStatus f = linear_.front().factorize(tangent_.matrix.front());
        if (f == FactorStatus::not_positive_definite && !about.flat) {
          is_convex = false;
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
    const double now = model_.solid.smallest_J(now_.x);
    double t = std::min(1.0, config_.max_advance * contact_radius(system_.tool) / std::max(std::abs(ds), 1e-300));
    Positions dx = Positions::Zero(3, now_.x.cols());
    System::move(dx, eq_, d, 1.0);
    Status refusal = Status::inverted;
    for (int k = 0; k < halvings; ++k, t *= 0.5) {
      const Positions trial = now_.x + t * dx;
      refusal = Status::inverted;
      if (!(model_.solid.smallest_J(trial) > least_volume * now)) continue;
      refusal = Status::line_search;
      auto next = system_.predicted(now_, factored_, t * dx, t * ds);
      if (!(*std::min_element(next.ratios.begin(), next.ratios.end()) > least_volume)) continue;
      enter(next.touch, about.touch);
      enter(next.rest, about.rest);
      about = std::move(next);
      now_.x = trial;
      now_.advance += t * ds;
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

 private:
  static bool accepts(const Photodiode& d, const Vec3d& direction) {
    return -direction.dot(d.normal()) > std::cos(d.acceptance_rad) - 1e-12;
  }

  std::vector<Photodiode> diodes_;
};

static_assert(ConnectedReadout<Photodiodes>);

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
    const Vec3d way = config_.position + config_.aperture_m * on_unit_disc(u, v, right_, up_) - from;
    const double length = way.norm(), toward = -way.dot(view_);
    if (!(toward > 0.0)) return {};
    return {way / length, toward / length * pi * config_.aperture_m * config_.aperture_m / (length * length)};
  }
  /// Pixel that sees the point `p` [m], by the ray through the middle of the opening; −1: outside the image.
  int pixel(const Vec3d& p) const {
    const Vec3d way = p - config_.position;
    const double z = way.dot(view_);
    return z > 0.0 ? pixel_of(way.dot(right_) / z, way.dot(up_) / z) : -1;
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

static_assert(ConnectedReadout<PinholeCamera>);

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

 private:
  BeerLambert straight_;
  Medium medium_;
};

static_assert(TurbidMedium<ScatteringMedium>);
static_assert(!TurbidMedium<BeerLambert>);

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
  static constexpr double largest_coordinate_m = 1e6;
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

  /// Calls start(ray, share of its power, inside the body?) for the one or two ways on which a ray starts. `axis`: of
  /// its emitter.
  template <class Start> void operator()(const PrimaryRay& ray, const Vec3d& axis, Start&& start) const {
    const RayHit in = scene_.first_hit(ray.origin, axis, true), out = scene_.first_hit(ray.origin, axis, false);
    const bool covered = in && (!out || in.t < out.t);
    const double height = covered || !out ? 0.0 : out.t;
    const double wet = !closes_m_ ? 0.0 : covered ? 1.0 : out ? wetted(height) : 0.0;
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
  /// Channel of an exit, or −1.
  int channel(const Exit& e, unsigned image) const {
    const Vec3d m(image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0);
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

  void run(const PathStart& start) {
    ++rays;
    start_ = &start;
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
    const bool gathered =
        body_.exits.has(b.exit) && !b.carrier_last && (b.direct ? start_->gathers_direct : !start_->from_emitter);
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
        if (!hit && !b.inside) return escape(b);
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
      stack_.push_back(c);
    }
  }

  // The event at a surface. True: `b` goes on.
  bool meet(Branch& b, int triangle) {
    const ScenePoint at = body_.surface.locate(triangle, b.origin);
    b.triangle = triangle;
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
    return reflect_off(b, optics,
        b.inside ? Vec3d(-body_.surface.flat_normal(triangle)) : body_.surface.flat_normal(triangle),
        accounts_.ledger.absorbed_at_surfaces);
  }

  // Reflection off an opaque surface whose unit normal points back to where the light comes from.
  bool reflect_off(Branch& b, const SurfaceOptics& optics, const Vec3d& normal, double& absorbed) {
    b.key = combine(b.key, 1);
    std::visit(
        [&](const auto& s) {
          if constexpr (OpaqueSurface<std::decay_t<decltype(s)>>) {
            const double kept = b.power * reflectance(s);
            accounts_.book(absorbed, b.power - kept);
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
    return reflect_off(b, body_.surface.touched(), smooth ? curved : flat, accounts_.ledger.to_indenter);
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
  const PathStart* start_ = nullptr;  ///< of the path at hand
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

/// Finds the light that leaves through faces with regions from those faces (next-event estimation), as few paths come
/// there. Direct light: points of the face × points of the emitters. Light of the carrier: a path from outside into the
/// body ends on Lambertian faces; by Helmholtz's reciprocity their light takes it backwards (L/n² is kept but for
/// Fresnel and extinction: Clausius 1864; Veach, thesis, 1997, ch. 5), scattered in the medium or not. A readout behind
/// openings is gathered from ways through them; then direct light is not. Points lie fixed in the undeformed body: no
/// sample crosses the border of a region that moves with it, so states differ smoothly.
template <RayScene Scene, TransparentMedium Medium, ExitReadout Readout> class NextEventGather {
 public:
  NextEventGather(const std::vector<Emitter>& emitters, const LitBody<Scene, Medium, Readout>& body,
      PathTracer<Scene, Medium, Readout>& path)
      : body_(body), ratio_(body.index_ratio()), path_(path) {
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
    path_.run({.ray = x.ray, .mirror = m, .power_W = weight / double(images_.size()), .from_emitter = false});
    // From a face in air, light has gained n² of radiance on its way into the body: it comes out as it was sent.
    return path_.accounts().collect([&](std::size_t k) {
      return body_.nodes.is_bright(k) ? 0.0
                                      : (body_.nodes.in_air(k) ? ratio_ * ratio_ : 1.0) * sent[k] / body_.nodes.area(k);
    });
  }

  const LitBody<Scene, Medium, Readout> body_;
  double ratio_;  ///< index inside / outside
  PathTracer<Scene, Medium, Readout>& path_;
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
    require_in_range("readout channels", channels, 0, 1 << 24, "");
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
      light.push_back({RayPattern(emitters, rays, symmetry, focus), {emitters, lit, path}});
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
    require_in_range("scattered_below", config_.scattered_below, 0.0, 1.0, "");
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
      const bool direct = !connected && beam.source.has_intensity() && !air;
      double worth = 1.0;  // of the ray at hand, in those that are sent evenly
      const auto start = [&](const PrimaryRay& ray, double share, bool inside) {
        path.run({.ray = ray,
            .mirror = beam.mirror,
            .power_W = share * worth * beam.power_W,
            .inside = inside,
            .gathers_direct = direct});
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

/// A number with its numerical error (half width of an interval that should hold a much finer computation's value).
struct Estimate {
  double value = 0.0;
  double error = 0.0;
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
         a.y_m != b.y_m;
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
    Scenario<Tool> scenario;  ///< with angle ≥ 0 and y ≥ 0 where mirror images are solved once
    std::size_t place;        ///< index into `places`
  };
  /// Contacts at one angle and place share a mesh.
  struct Place {
    double angle_rad, y_m;
    TiltPlane tilt;
    std::vector<std::size_t> solves;
  };
  std::vector<Solve> solves;
  std::vector<ScenarioImage> images;  ///< one per scenario
  std::vector<Place> places;
};

namespace detail {

/// Planes, of those that are allowed, in which a contact is to be mirrored so that all its images become the same one:
/// y ≥ 0, angle ≥ 0.
template <Indenter Tool> Symmetry to_first_image(const Scenario<Tool>& s, Symmetry allowed) {
  const bool along = s.tilt == TiltPlane::yz, back = s.angle_rad < 0.0;
  return {allowed.x && !along && back, allowed.y && (s.y_m < 0.0 || (along && s.y_m == 0.0 && back))};
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
      while (
          place < plan.places.size() && !(plan.places[place].angle_rad == home.angle_rad &&
                                            plan.places[place].y_m == home.y_m && plan.places[place].tilt == home.tilt))
        ++place;
      if (place == plan.places.size()) plan.places.push_back({home.angle_rad, home.y_m, home.tilt, {}});
      plan.places[place].solves.push_back(k);
      plan.solves.push_back({first, place});
    }
    plan.images.push_back({k, mirror});
  }
  return plan;
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
    states.push_back(
        {scenario, record.diameter_m, record.angle_rad, record.y_m, s.load_N, s.change, record.tilt, 0.0, known});
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
  bool refine_once = true;   ///< mesh a place again, and finer, where a contact was not resolved
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

  /// Places with a contact that is not resolved; their next mesh will be finer there.
  std::vector<std::size_t> unresolved() {
    std::vector<std::size_t> places;
    for (std::size_t k = 0; k < out.solved.size(); ++k) {
      if (!out.solved[k].record.unresolved) continue;
      const std::size_t place = out.plan.solves[k].place;
      for (const MechanicalState& s : out.solved[k].states) add_places(s, more[place]);
      if (places.empty() || places.back() != place) places.push_back(place);
    }
    std::sort(places.begin(), places.end());
    places.erase(std::unique(places.begin(), places.end()), places.end());
    return places;
  }

 private:
  static constexpr double finest_wanted = 20e-6;  // [m]

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
    Body wanted = focused_on_contact(body, coarse, here, pipeline.focus);
    if (!more[place].empty()) {
      Focus about = pipeline.focus;
      about.growth = std::min(about.growth, Focus{}.growth);
      wanted = focused(wanted, more[place], about);
    }
    try {
      out.places[place] = std::make_unique<PadOf<P>>(
          pipeline.simulator.prepare(body, mesh_body(wanted, pipeline.mesher, pipeline.mesh_order)));
    } catch (const MeshError&) {
      if (more[place].empty()) throw;
    }
  }
};

}  // namespace detail

/// Presses a body in every scenario. Where a mesh turns out to be too coarse for a contact, its place is meshed and
/// pressed once more (Pipeline::refine_once). Bit-identical for every executor. Throws InvalidArgument and MeshError; a
/// solve that fails is a status in its record.
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
    if (const auto again = presses.unresolved(); !again.empty())
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

// ---- lumo/pipeline/scores.hpp
#ifndef SINGLE_INCLUDE_LUMO_PIPELINE_SCORES_HPP
#define SINGLE_INCLUDE_LUMO_PIPELINE_SCORES_HPP

namespace lumo {

/// A number to optimise, with its error, from all that was observed of a body; nullopt if the observations do not
/// define it. Laws: a pure function; never NaN.
template <class O>
concept ObservedObjective = requires(const O& objective, const Observations& all) {
  { objective(all) } -> std::same_as<std::optional<Estimate>>;
};

/// Result of the evaluation of any body. All objectives are empty unless every scenario converged, or was held where
/// the pipeline accepts held states.
struct Scores {
  bool converged = false;
  std::vector<std::optional<Estimate>> objectives;
  Observations observations;
};

/// Objectives from the observations. A numerical failure is a status, never a score.
template <class P, ObservedObjective... Objectives>
Scores score(Observations observations, const P& pipeline, const std::tuple<Objectives...>& objectives) {
  Scores result;
  result.observations = std::move(observations);
  result.converged = all_scored(result.observations.scenarios, pipeline.accept_held);
  const auto add = [&](const auto&... objective) {
    (result.objectives.push_back(result.converged ? objective(result.observations) : std::nullopt), ...);
  };
  std::apply(add, objectives);
  return result;
}

/// Result of the evaluation of a finger. An objective is empty if a scenario did not converge, or if the loads do not
/// define its terms.
struct Evaluation {
  std::optional<Estimate> J_contact, J_obs;
  std::optional<std::size_t> worst_contact;     ///< scenario that sets J_contact
  std::optional<Separation> worst_observation;  ///< pair of `observed` that sets J_obs
  std::vector<ObservedState> observed;
  Observations observations;
};

/// The paper's two objectives from the observations.
template <class P> Evaluation score(Observations observations, const P& pipeline) {
  Evaluation result;
  result.observations = std::move(observations);
  const std::vector<ScenarioRecord>& scenarios = result.observations.scenarios;
  if (!all_scored(scenarios, pipeline.accept_held)) return result;

  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  result.observed = observed_states(scenarios);
  result.worst_observation = optical_separation(result.observed, pipeline.optical_error);
  if (result.worst_observation) result.J_obs = result.worst_observation->distance;
  return result;
}

}  // namespace lumo

#endif

// ---- lumo/pipeline/evaluate.hpp
#ifndef SINGLE_INCLUDE_LUMO_PIPELINE_EVALUATE_HPP
#define SINGLE_INCLUDE_LUMO_PIPELINE_EVALUATE_HPP

namespace lumo {

/// A finger to evaluate: θ, the silicone that it is cast of, and how it is built.
struct Finger {
  FingerDesign design;
  Silicone silicone;
  FingerOptions options = {};
};

/// θ → finger → mesh → press → light → objectives: the paper's two.
/// Throws InfeasibleDesign before anything is computed, MeshError for a body that cannot be meshed, InvalidArgument.
template <class P, Executor E> Evaluation evaluate(const Finger& wanted, const Ensemble& ensemble, const P& pipeline,
    const E& executor, const ProgressReport& progress = {}) {
  const Body body = finger(wanted.design, wanted.silicone, wanted.options);
  const auto pressed = press(body, ensemble.scenarios(), pipeline, executor, progress);
  return score(observe(body, pressed, pipeline, executor, progress), pipeline);
}

/// Body → mesh → press → light → objectives, for any body, tool and objectives (ObservedObjective). Mirror images are
/// solved once; scenarios run side by side. Throws MeshError for a body that cannot be meshed, InvalidArgument.
template <class P, Indenter Tool, Executor E, ObservedObjective... Objectives> Scores evaluate(const Body& body,
    const std::vector<Scenario<Tool>>& scenarios, const P& pipeline, const E& executor,
    const std::tuple<Objectives...>& objectives, const ProgressReport& progress = {}) {
  const auto pressed = press(body, scenarios, pipeline, executor, progress);
  return score(observe(body, pressed, pipeline, executor, progress), pipeline, objectives);
}

}  // namespace lumo

#endif

// ---- lumo/model/normal.hpp
#ifndef SINGLE_INCLUDE_LUMO_MODEL_NORMAL_HPP
#define SINGLE_INCLUDE_LUMO_MODEL_NORMAL_HPP

namespace lumo {

namespace detail {

/// Throws InvalidArgument for NaN; infinite numbers are ends of the distribution.
inline double number(double z) {
  if (std::isnan(z)) throw InvalidArgument("normal distribution: nan is no number");
  return z;
}

}  // namespace detail

/// Density of the standard normal distribution. Like all here, it throws InvalidArgument for NaN.
inline double normal_density(double z) { return 0.39894228040143267794 * std::exp(-0.5 * detail::number(z) * z); }

/// P(Z ≤ z) of the standard normal distribution, accurate in both tails.
inline double normal_probability(double z) { return 0.5 * std::erfc(-0.70710678118654752440 * detail::number(z)); }

/// z with P(Z ≤ z) = p; ∓∞ at 0 and 1. A rational start (Abramowitz & Stegun 1964, 26.2.23), then Halley's iteration.
inline double normal_quantile(double p) {
  detail::number(p);
  if (!(p > 0.0)) return -std::numeric_limits<double>::infinity();
  if (!(p < 1.0)) return std::numeric_limits<double>::infinity();
  const bool upper = p > 0.5;
  const double tail = upper ? 1.0 - p : p;
  const double t = std::sqrt(-2.0 * std::log(tail));
  double z = (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308))) -
             t;  // of the lower tail
  for (int i = 0; i < 3; ++i) {
    const double error = (normal_probability(z) - tail) / normal_density(z);
    z -= error / (1.0 + 0.5 * z * error);
  }
  return upper ? -z : z;
}

namespace detail {

/// E[(Z + a)⁺] / φ(a) for a ≤ −8: from the continued fraction of Mills' ratio, where a Φ(a) + φ(a) would cancel.
inline double scaled_excess_tail(double a) {
  const double x = -a;
  double c = x;
  for (int k = x < 10.0 ? 13 : x < 16.0 ? 10 : 8; k >= 2; --k) c = x + double(k) / c;  // relative error below 10⁻¹³
  return 1.0 / (x * c + 1.0);
}

/// a Φ(a) + φ(a) on [−8, 8) with its first two derivatives, Φ and φ, at 256 nodes a unit; quintic Hermite interpolation
/// between them leaves a relative error below 10⁻¹³ (h⁶ f⁽⁶⁾/46080) and takes a tenth of the time of erfc and exp.
class ExcessTable {
 public:
  static constexpr double edge = 8.0;

  double operator()(double a) const {
    const double t = (a + edge) * per_unit;
    const auto k = std::min(std::size_t(t), nodes_.size() - 2);
    const double u = t - double(k);
    const Node &p = nodes_[k], &q = nodes_[k + 1];
    const double rise = q.value - p.value - p.slope - 0.5 * p.curvature, turn = q.slope - p.slope - p.curvature,
                 bend = q.curvature - p.curvature;
    const double u3 = 10.0 * rise - 4.0 * turn + 0.5 * bend, u4 = -15.0 * rise + 7.0 * turn - bend,
                 u5 = 6.0 * rise - 3.0 * turn + 0.5 * bend;
    return p.value + u * (p.slope + u * (0.5 * p.curvature + u * (u3 + u * (u4 + u * u5))));
  }

  static const ExcessTable& get() {
    static const ExcessTable table;
    return table;
  }

 private:
  static constexpr double per_unit = 256.0;
  struct Node {
    double value, slope, curvature;  // of the function of u = 256 a
  };
  std::vector<Node> nodes_;

  ExcessTable() {
    for (int k = 0; k <= int(2.0 * edge * per_unit); ++k) {
      const double a = k / per_unit - edge, density = normal_density(a), probability = normal_probability(a);
      // Near the lower edge the two terms of the value cancel.
      const double value = a < -2.0 ? density * scaled_excess(-a) : a * probability + density;
      nodes_.push_back({value, probability / per_unit, density / (per_unit * per_unit)});
    }
  }

  /// E[(Z − x)⁺] / φ(x) for x ≥ 2: the continued fraction from far enough out.
  static double scaled_excess(double x) {
    double c = x;
    for (int k = 200; k >= 2; --k) c = x + double(k) / c;
    return 1.0 / (x * c + 1.0);
  }
};

}  // namespace detail

/// E[(Z + a)⁺] = a Φ(a) + φ(a) for a standard normal Z, to full relative accuracy (10⁻¹³) until it underflows below a =
/// −38.
inline double expected_excess(double a) {
  detail::number(a);
  if (a >= detail::ExcessTable::edge) return a;
  if (a >= -detail::ExcessTable::edge) return detail::ExcessTable::get()(a);
  return a > -39.0 ? normal_density(a) * detail::scaled_excess_tail(a) : 0.0;
}

/// log E[(Z + a)⁺], finite for every finite a. Source: Ament, Daulton, Eriksson, Balandat & Bakshy, "Unexpected
/// Improvements to Expected Improvement for Bayesian Optimization", NeurIPS 2023.
inline double log_expected_excess(double a) {
  detail::number(a);
  if (a <= -8.0) return -0.5 * a * a - 0.5 * std::log(2.0 * pi) + std::log(detail::scaled_excess_tail(a));
  return std::log(a * normal_probability(a) + normal_density(a));
}

/// log(eˣ − eʸ) for x ≥ y; −∞ if they are equal.
inline double log_difference(double x, double y) {
  detail::number(x);
  detail::number(y);
  if (!(y < x)) return -std::numeric_limits<double>::infinity();
  const double d = y - x;
  return x + (d > -0.69314718055994530942 ? std::log(-std::expm1(d)) : std::log1p(-std::exp(d)));
}

/// log Σ exp of the numbers in [first, last); −∞ for none.
template <class Iterator> double log_sum_exp(Iterator first, Iterator last) {
  double top = -std::numeric_limits<double>::infinity();
  for (Iterator i = first; i != last; ++i) top = std::max(top, detail::number(*i));
  if (!std::isfinite(top)) return top;
  double sum = 0.0;
  for (Iterator i = first; i != last; ++i)
    if (*i - top > -745.0) sum += std::exp(*i - top);  // underflow would be slow
  return top + std::log(sum);
}

}  // namespace lumo

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

  /// `x`: d × n, normalised; `y`: n, standardised.
  MarginalLikelihood(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, Kernel kernel, HyperparameterPrior prior)
      : size_(x.cols()), y_(y), kernel_(kernel), prior_(prior), squares_(x.cols() * (x.cols() - 1) / 2, x.rows()) {
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
  Eigen::VectorXd y_;
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
    const MarginalLikelihood<Kernel> likelihood(gp.x_, gp.y_, config.kernel, gp.prior());
    std::vector<Minimum> optima;
    if (n <= config.subset) {
      optima = gp.optima(likelihood, n);
    } else {
      std::vector<Eigen::Index> some;
      for (Eigen::Index i = 0; i < config.subset; ++i) some.push_back(i * n / config.subset);
      const MarginalLikelihood<Kernel> coarse(gp.x_(Eigen::all, some), gp.y_(some), config.kernel, gp.prior());
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
    const auto value = MarginalLikelihood<Kernel>(x_, y_, config_.kernel, prior())(hyperparameters_, false);
    return (value.log_likelihood + value.log_prior) / double(size());
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
  Eigen::MatrixXd x_;  ///< normalised
  Eigen::VectorXd y_;  ///< standardised
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
  }
  void condition(const Hyperparameters& h) {
    hyperparameters_ = h;
    Eigen::MatrixXd covariance = correlation(x_, x_);
    covariance.diagonal().array() += h.noise;
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

// ---- lumo/model/surrogate.hpp
#ifndef SINGLE_INCLUDE_LUMO_MODEL_SURROGATE_HPP
#define SINGLE_INCLUDE_LUMO_MODEL_SURROGATE_HPP

namespace lumo {

/// How observed outputs become objectives. Laws: objectives(outputs) works column by column (outputs × points →
/// objectives × points); there are outputs(m) outputs for m objectives, and objective(k) is the one that output k
/// counts for; identity() only if objectives() returns its argument, so that normal outputs stay normal; scaling
/// all outputs of an objective by s > 0 scales the objective by s.
template <class R>
concept Reduction = requires(const R& reduction, const Eigen::MatrixXd& outputs, int k) {
  { reduction.objectives(outputs) } -> std::convertible_to<Eigen::MatrixXd>;
  { reduction.outputs(k) } -> std::convertible_to<int>;
  { reduction.objective(k) } -> std::convertible_to<int>;
  { reduction.identity() } -> std::convertible_to<bool>;
};

/// Each output is an objective.
struct EachOutput {
  const Eigen::MatrixXd& objectives(const Eigen::MatrixXd& outputs) const { return outputs; }
  int outputs(int objectives) const { return objectives; }
  int objective(int output) const { return output; }
  bool identity() const { return true; }
};

/// Composite surrogate: each objective is the least of its terms (scenarios), and each term has a Gaussian process of
/// its own, so that the kinks of the minimum stay out of the model. Source: Astudillo & Frazier, "Bayesian Optimization
/// of Composite Functions", ICML 2019.
struct MinimumOverTerms {
  std::vector<int> terms;  ///< number of consecutive outputs that belong to each objective

  Eigen::MatrixXd objectives(const Eigen::MatrixXd& y) const {
    Eigen::MatrixXd least(Eigen::Index(terms.size()), y.cols());
    Eigen::Index first = 0;
    for (std::size_t j = 0; j < terms.size(); first += terms[j++])
      least.row(Eigen::Index(j)) = y.middleRows(first, terms[j]).colwise().minCoeff();
    return least;
  }
  /// Throws InvalidArgument unless there are as many counts as objectives, and all are positive.
  int outputs(int objectives) const {
    if (int(terms.size()) != objectives || std::any_of(terms.begin(), terms.end(), [](int n) { return n < 1; }))
      throw InvalidArgument(message("minimum over terms needs a positive number of terms for each of ", objectives,
          " objectives, has ", terms.size(), " numbers"));
    return std::accumulate(terms.begin(), terms.end(), 0);
  }
  int objective(int output) const {
    int j = 0;
    for (; j + 1 < int(terms.size()) && output >= terms[std::size_t(j)]; ++j) output -= terms[std::size_t(j)];
    return j;
  }
  bool identity() const {
    return std::all_of(terms.begin(), terms.end(), [](int n) { return n == 1; });
  }
};

static_assert(Reduction<EachOutput>);
static_assert(Reduction<MinimumOverTerms>);

/// Designs that are observed or pending, as acquisitions see them. All objectives are maximised.
struct Evidence {
  Eigen::MatrixXd x;        ///< observed: d × n
  Eigen::MatrixXd outputs;  ///< observed: outputs × n
  Eigen::MatrixXd pending;  ///< d × p: asked and not yet observed
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd reference;  ///< per objective
};

/// Joint posterior of a Gaussian process at base points, drawn once, and of any further point given each draw. Without
/// base points there is one empty draw, and the conditional on it is the plain posterior.
template <CovarianceKernel Kernel> class ConditionalPosterior {
 public:
  /// `normals`: base points × draws. Throws InvalidArgument if they do not fit.
  ConditionalPosterior(const GaussianProcess<Kernel>& gp, const Eigen::MatrixXd& base, const Eigen::MatrixXd& normals)
      : gp_(&gp), base_(gp.normalized(base)), normals_(normals) {
    if (normals.rows() != base.cols())
      throw InvalidArgument(
          message("draws at ", base.cols(), " points need as many rows of normal numbers, not ", normals.rows()));
    if (base.cols() == 0) return;
    whitened_ = gp.whitened(base_);
    const auto factor = jittered_factor(gp.correlation(base_, base_) - whitened_.transpose() * whitened_);
    if (!factor) throw InvalidArgument("posterior covariance of the base points is not positive definite");
    factor_ = factor->lower;
    jitter_ = factor->jitter;
  }

  /// Samples at the base points: points × draws, in the units of the data.
  Eigen::MatrixXd draws() const {
    if (base_.cols() == 0) return Eigen::MatrixXd(0, std::max<Eigen::Index>(1, normals_.cols()));
    const Eigen::MatrixXd standard = (factor_ * normals_).colwise() + standard_mean(whitened_);
    return (gp_->output_mean() + gp_->output_scale() * standard.array()).matrix();
  }

  /// Given each draw, the latent function at the columns of `x` is normal with these means (points × draws) and
  /// deviations (points).
  struct Conditional {
    Eigen::MatrixXd mean;
    Eigen::VectorXd deviation;
  };
  Conditional at(const Eigen::MatrixXd& x) const {
    const Eigen::MatrixXd unit = gp_->normalized(x), v = gp_->whitened(unit);
    Eigen::VectorXd variance = (1.0 - v.colwise().squaredNorm().array()).transpose();
    Eigen::MatrixXd standard = standard_mean(v);
    if (base_.cols() > 0) {
      Eigen::MatrixXd cross = gp_->correlation(base_, unit) - whitened_.transpose() * v;
      factor_.template triangularView<Eigen::Lower>().solveInPlace(cross);
      variance.array() -= cross.colwise().squaredNorm().array().transpose();
      standard = (cross.transpose() * normals_).colwise() + Eigen::VectorXd(standard.col(0));
    }
    const double scale = gp_->output_scale();
    return {(gp_->output_mean() + scale * standard.array()).matrix(), scale * variance.cwiseMax(1e-18).cwiseSqrt()};
  }

  double jitter() const { return jitter_; }

 private:
  Eigen::VectorXd standard_mean(const Eigen::MatrixXd& v) const {
    return ((v.transpose() * gp_->weights()).array() + gp_->hyperparameters().mean).matrix();
  }

  const GaussianProcess<Kernel>* gp_;
  Eigen::MatrixXd base_, normals_, whitened_, factor_;
  double jitter_ = 0.0;
};

/// Probability that an evaluation succeeds, for objectives that are not defined everywhere, and it is not known where:
/// a Gaussian process of 1 for a success and 0 for a failure of the design, and the probability that it is above one
/// half. Labels are taken as numbers with noise, so no iteration is needed. Source: hidden constraints of Lee,
/// Gramacy, Linkletter & Gray, Pacific J. Optim. 7 (2011); their probability as a factor of the acquisition: Gelbart,
/// Snoek & Adams, UAI 2014.
template <CovarianceKernel Kernel = RbfKernel> class SuccessModel {
 public:
  static constexpr double least_probability = 1e-12;  ///< leaves a choice between designs that are all thought to fail
  /// Utility that is not worth a failure, in units of the objectives' spread
  static constexpr double negligible = 1e-3;

  /// Designs (d × n each) inside [lower, upper], at least one in all. Throws InvalidArgument as GaussianProcess::fit().
  SuccessModel(const Eigen::MatrixXd& succeeded, const Eigen::MatrixXd& failed, const Eigen::VectorXd& lower,
      const Eigen::VectorXd& upper, const typename GaussianProcess<Kernel>::Config& config = {})
      : process_(GaussianProcess<Kernel>::fit(labelled(succeeded, failed, lower, upper), config)) {}

  /// log P(success) at the columns of `x`, from log least_probability to 0.
  Eigen::VectorXd log_probability(const Eigen::MatrixXd& x) const {
    const auto label = process_.predict(x);
    Eigen::VectorXd log(x.cols());
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      const double deviation = std::max(std::sqrt(label.variance[i]), 1e-9);  // labels are of order 1
      log[i] = std::log(std::max(normal_probability((label.mean[i] - 0.5) / deviation), least_probability));
    }
    return log;
  }

  /// log((utility + negligible) P(success)) from log utility at the columns of `x`. Once a search has converged on the
  /// edge of the failures, all utility lies beyond the edge, by many orders of magnitude; without the constant the
  /// search would ask for designs there without end.
  Eigen::VectorXd expected(const Eigen::VectorXd& log_utility, const Eigen::MatrixXd& x) const {
    const Eigen::VectorXd floor = Eigen::VectorXd::Constant(x.cols(), std::log(negligible)),
                          high = log_utility.cwiseMax(floor), low = log_utility.cwiseMin(floor);
    return high + (low - high).array().exp().log1p().matrix() + log_probability(x);
  }

 private:
  static TrainingData labelled(const Eigen::MatrixXd& succeeded, const Eigen::MatrixXd& failed,
      const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
    Eigen::MatrixXd x(lower.size(), succeeded.cols() + failed.cols());
    x << succeeded, failed;
    Eigen::VectorXd y(x.cols());
    y << Eigen::VectorXd::Ones(succeeded.cols()), Eigen::VectorXd::Zero(failed.cols());
    return {x, y, lower, upper};
  }

  GaussianProcess<Kernel> process_;
};

}  // namespace lumo

#endif

// ---- lumo/optimize/acquisition.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_ACQUISITION_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_ACQUISITION_HPP

namespace lumo {

/// Utility of a design: prepared once on models and evidence, then called with candidates (d × n) for its logarithm
/// (n). Laws: a pure function of its arguments; larger is better; −∞ or finite, never NaN; conditioned on observed and
/// pending designs.
template <class A, class Models, class R>
concept Acquisition = requires(const A& acquisition, const Models& models, const R& reduction, const Evidence& evidence,
    std::uint64_t seed, const Eigen::MatrixXd& x) {
  { acquisition.prepare(models, reduction, evidence, seed)(x) } -> std::convertible_to<Eigen::VectorXd>;
};

/// Standard normal numbers, points × draws: each row is an Owen-scrambled Sobol dimension, so that every point sees
/// evenly spread draws. Blocks of 32 dimensions are scrambled independently. Row `point` does not depend on the number
/// of rows. Throws InvalidArgument for negative numbers or more than a million.
inline Eigen::MatrixXd base_normals(Eigen::Index points, Eigen::Index draws, std::uint64_t seed) {
  require_in_range("points of base draws", double(points), 0.0, 1e6, "");
  require_in_range("base draws", double(draws), 0.0, 1e6, "");
  Eigen::MatrixXd z(points, draws);
  for (Eigen::Index i = 0; i < points; ++i) {
    const OwenSobol sequence{combine(seed, std::uint64_t(i / Sobol::dimensions))};
    for (Eigen::Index s = 0; s < draws; ++s)
      z(i, s) = normal_quantile(sequence(std::uint32_t(s), int(i % Sobol::dimensions)));
  }
  return z;
}

/// Points of the base draws: observed designs (if they are noisy) and pending ones.
inline Eigen::MatrixXd base_points(const Evidence& evidence, bool noisy) {
  if (!noisy) return evidence.pending;
  Eigen::MatrixXd base(evidence.x.rows(), evidence.x.cols() + evidence.pending.cols());
  base << evidence.x, evidence.pending;
  return base;
}

/// Objectives that stand in draw `s`: the drawn ones, and the observed ones unless they are drawn, too.
template <Reduction R> Eigen::MatrixXd standing_objectives(const std::vector<Eigen::MatrixXd>& draws, Eigen::Index s,
    const R& reduction, const Evidence& evidence, bool noisy) {
  const Eigen::Index observed = noisy ? 0 : evidence.outputs.cols(), drawn = draws.front().rows();
  Eigen::MatrixXd outputs(Eigen::Index(draws.size()), observed + drawn);
  if (observed > 0) outputs.leftCols(observed) = evidence.outputs;
  for (std::size_t j = 0; j < draws.size(); ++j) outputs.row(Eigen::Index(j)).tail(drawn) = draws[j].col(s).transpose();
  if (outputs.cols() == 0) return Eigen::MatrixXd(evidence.reference.size(), 0);
  return reduction.objectives(outputs);
}

}  // namespace lumo

#endif

// ---- lumo/optimize/hypervolume.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_HYPERVOLUME_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_HYPERVOLUME_HPP

namespace lumo {

/// Does `a` dominate `b`: at least as good everywhere, better somewhere? All objectives are maximised.
template <class A, class B> bool dominates(const Eigen::DenseBase<A>& a, const Eigen::DenseBase<B>& b) {
  return (a.derived().array() >= b.derived().array()).all() && (a.derived().array() > b.derived().array()).any();
}

namespace detail {

inline void require_finite_objectives(const Eigen::MatrixXd& y) {
  if (!y.allFinite()) throw InvalidArgument("objectives must be finite numbers");
}

}  // namespace detail

/// Columns of `y` (objectives × points, maximised) that no other dominates, by falling first objective, equal ones by
/// index. Throws InvalidArgument, like all here, for objectives that are not finite.
inline std::vector<Eigen::Index> pareto_front(const Eigen::MatrixXd& y) {
  detail::require_finite_objectives(y);
  std::vector<Eigen::Index> order(std::size_t(y.cols()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) {
    for (Eigen::Index j = 0; j < y.rows(); ++j)
      if (y(j, i) != y(j, k)) return y(j, i) > y(j, k);
    return false;
  });
  // No point dominates one before it in this order.
  std::vector<Eigen::Index> front;
  for (const Eigen::Index i : order) {
    const bool beaten = y.rows() == 2 ? !front.empty() && dominates(y.col(front.back()), y.col(i))
                                      : std::any_of(front.begin(), front.end(),
                                            [&](Eigen::Index k) { return dominates(y.col(k), y.col(i)); });
    if (!beaten) front.push_back(i);
  }
  return front;
}

/// Boxes that overlap at their faces only: objectives × boxes; upper corners may be infinite.
struct BoxDecomposition {
  Eigen::MatrixXd lower, upper;
};

namespace detail {

/// Slices the space above `reference` that no point dominates into boxes.
struct BoxSlicer {
  const Eigen::VectorXd& reference;
  Eigen::VectorXd low, high;  ///< of the slice at hand
  std::vector<Eigen::VectorXd> lower, upper;

  explicit BoxSlicer(const Eigen::VectorXd& r) : reference(r), low(r.size()), high(r.size()) {}

  /// Slices the space that no column of `y` dominates along objective `along`, and each slice along those after it.
  void slice(const Eigen::MatrixXd& y, Eigen::Index along) {
    const double infinite = std::numeric_limits<double>::infinity();
    if (along + 1 == reference.size()) {
      low[along] = y.cols() ? std::max(reference[along], y.row(along).maxCoeff()) : reference[along];
      high[along] = infinite;
      lower.push_back(low);
      upper.push_back(high);
      return;
    }
    std::vector<double> levels = {reference[along]};
    for (Eigen::Index i = 0; i < y.cols(); ++i) levels.push_back(y(along, i));
    std::sort(levels.begin(), levels.end());
    levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const double top = k + 1 < levels.size() ? levels[k + 1] : infinite;
      std::vector<Eigen::Index> reach;  // those that dominate inside the slice
      for (Eigen::Index i = 0; i < y.cols(); ++i)
        if (y(along, i) >= top) reach.push_back(i);
      low[along] = levels[k];
      high[along] = top;
      slice(y(Eigen::all, reach), along + 1);
    }
  }
};

}  // namespace detail

/// Decomposes the space above `reference` that no column of `y` (objectives × points, maximised) dominates. Exact for
/// any number of objectives: one more box than the front has points for two, more than proportional for three and
/// above.
inline BoxDecomposition nondominated_boxes(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) {
  if (reference.size() < 1 || (y.cols() > 0 && y.rows() != reference.size()))
    throw InvalidArgument(message("points have ", y.rows(), " objectives, the reference point has ", reference.size()));
  detail::require_finite_objectives(y);
  detail::require_finite_objectives(reference);
  std::vector<Eigen::Index> above;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) above.push_back(i);
  Eigen::MatrixXd front = y.cols() ? Eigen::MatrixXd(y(Eigen::all, above)) : Eigen::MatrixXd(reference.size(), 0);
  front = Eigen::MatrixXd(front(Eigen::all, pareto_front(front)));
  detail::BoxSlicer slicer(reference);
  slicer.slice(front, 0);
  const auto count = Eigen::Index(slicer.lower.size());
  BoxDecomposition boxes{Eigen::MatrixXd(reference.size(), count), Eigen::MatrixXd(reference.size(), count)};
  for (Eigen::Index k = 0; k < count; ++k) {
    boxes.lower.col(k) = slicer.lower[std::size_t(k)];
    boxes.upper.col(k) = slicer.upper[std::size_t(k)];
  }
  return boxes;
}

/// Volume above `reference` that the columns of `y` (objectives × points, maximised) dominate; points not above
/// it add nothing. Exact for any number of objectives, by slicing along the last. Source: Zitzler, 2001; While,
/// Hingston, Barone & Huband, 2006.
inline double hypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference) {
  const Eigen::Index m = reference.size();
  if (m < 1 || (y.cols() > 0 && y.rows() != m))
    throw InvalidArgument(message("points have ", y.rows(), " objectives, the reference point has ", m));
  detail::require_finite_objectives(y);
  detail::require_finite_objectives(reference);
  std::vector<Eigen::Index> order;
  for (Eigen::Index i = 0; i < y.cols(); ++i)
    if ((y.col(i).array() > reference.array()).all()) order.push_back(i);
  if (order.empty()) return 0.0;
  if (m == 1) {
    double best = reference[0];
    for (const Eigen::Index i : order) best = std::max(best, y(0, i));
    return best - reference[0];
  }
  std::stable_sort(
      order.begin(), order.end(), [&](Eigen::Index i, Eigen::Index k) { return y(m - 1, i) > y(m - 1, k); });
  double volume = 0.0, widest = reference[0];
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double bottom = k + 1 < order.size() ? y(m - 1, order[k + 1]) : reference[m - 1];
    const double height = y(m - 1, order[k]) - bottom;
    if (m == 2) {  // the slice's section is one interval
      widest = std::max(widest, y(0, order[k]));
      volume += height * (widest - reference[0]);
    } else if (height > 0.0) {
      const std::vector<Eigen::Index> reach(order.begin(), order.begin() + std::ptrdiff_t(k) + 1);
      volume += height * hypervolume(Eigen::MatrixXd(y(Eigen::all, reach).topRows(m - 1)), reference.head(m - 1));
    }
  }
  return volume;
}

/// Expected hypervolume improvement of a point whose objectives are independent and normal, in closed form: over each
/// box of the decomposition the expectation is a product of one-dimensional integrals, and all terms are positive.
/// Exact for any number of objectives. Source: Emmerich, Deutz & Klinkenberg, CEC 2011; Yang, Emmerich, Deutz & Bäck,
/// J. Glob. Optim. 75 (2019), for the slices of two objectives.
class ExpectedHypervolume {
 public:
  /// `y`: objectives × points, maximised; only those above `reference` that no other dominates matter.
  ExpectedHypervolume(const Eigen::MatrixXd& y, const Eigen::VectorXd& reference)
      : boxes_(nondominated_boxes(y, reference)) {}

  /// log of the expected improvement, finite for all `mean` and positive `deviation` within 1e153; others throw
  /// InvalidArgument.
  template <class Mean, class Deviation> double log_value(const Mean& mean, const Deviation& deviation) const {
    const double sum = value(mean, deviation);
    if (sum > 1e-280 && std::isfinite(sum)) return std::log(sum);
    return log_sum(mean, deviation);
  }

  /// The expected improvement itself; underflows to 0 far from the front. Two objectives only take one pass over the
  /// front.
  template <class Mean, class Deviation> double value(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index m = boxes_.lower.rows(), count = boxes_.lower.cols();
    for (Eigen::Index j = 0; j < m; ++j) {
      require_in_range("mean of an objective", mean[j], -largest, largest, "");
      require_positive("deviation of an objective", deviation[j], "");
    }
    if (m != 2) return std::exp(log_sum(mean, deviation));
    double sum = 0.0, above = 0.0, side = std::numeric_limits<double>::quiet_NaN(), excess = 0.0;
    for (Eigen::Index k = count; k-- > 0;) {  // from the topmost slice, which has no upper end, downwards
      if (boxes_.lower(1, k) != side) {
        side = boxes_.lower(1, k);
        excess = expected_excess((mean[1] - side) / deviation[1]);
      }
      const double from = expected_excess((mean[0] - boxes_.lower(0, k)) / deviation[0]);
      sum += excess * (from - above);
      above = from;
    }
    return sum * deviation[0] * deviation[1];
  }

  const BoxDecomposition& boxes() const { return boxes_; }

 private:
  static constexpr double largest = 1e153;  ///< squares do not overflow

  /// log ∫ P(Y > t) dt over [low, high] for Y normal.
  static double log_side(double mean, double deviation, double low, double high) {
    const double a = (mean - low) / deviation;
    if (!std::isfinite(high)) return std::log(deviation) + log_expected_excess(a);
    const double b = (mean - high) / deviation;
    if ((a - b) * std::max(1.0, std::abs(a)) < 1e-5)  // too thin for a difference
      return std::log(high - low) + log_probability(0.5 * (a + b));
    return std::log(deviation) + log_difference(log_expected_excess(a), log_expected_excess(b));
  }
  static double log_probability(double z) {
    if (z > -30.0) return std::log(normal_probability(z));
    return -0.5 * z * z - 0.5 * std::log(2.0 * pi) - std::log(-z) + std::log1p(-1.0 / (z * z) + 3.0 / (z * z * z * z));
  }
  /// Sum over the boxes in logarithms. E[(Z + a)⁺] ≤ e^(−a²/2) for a ≤ 0 and ≤ a + 1 above: boxes that this bound
  /// leaves below e⁻⁴⁰ of the most promising one are passed over.
  template <class Mean, class Deviation> double log_sum(const Mean& mean, const Deviation& deviation) const {
    const Eigen::Index count = boxes_.lower.cols(), m = boxes_.lower.rows();
    if (count == 0) return -std::numeric_limits<double>::infinity();
    double scale = 0.0;
    for (Eigen::Index j = 0; j < m; ++j) scale += std::log(deviation[j]);
    Eigen::ArrayXd bound = Eigen::ArrayXd::Constant(count, scale);
    for (Eigen::Index k = 0; k < count; ++k)
      for (Eigen::Index j = 0; j < m; ++j) {
        const double a = (mean[j] - boxes_.lower(j, k)) / deviation[j];
        bound[k] += a > 0.0 ? std::log(a + 1.0) : -0.5 * a * a;
      }
    const auto term = [&](Eigen::Index k) {
      double log = 0.0;
      for (Eigen::Index j = 0; j < m; ++j)
        log += log_side(mean[j], deviation[j], boxes_.lower(j, k), boxes_.upper(j, k));
      return log;
    };
    Eigen::Index first = 0;
    bound.maxCoeff(&first);
    const double floor = term(first) - 40.0;
    std::vector<double> terms;
    for (Eigen::Index k = 0; k < count; ++k)
      if (bound[k] >= floor) terms.push_back(term(k));
    return log_sum_exp(terms.begin(), terms.end());
  }

  BoxDecomposition boxes_;
};

}  // namespace lumo

#endif

// ---- lumo/optimize/log_nehvi.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_LOG_NEHVI_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_LOG_NEHVI_HPP

namespace lumo {

/// Log noisy expected hypervolume improvement with only the standing designs drawn: given a draw of them, a candidate's
/// objectives are independent and normal, so its improvement is known in closed form. Stays exact far from the front,
/// where a sampled candidate finds no improvement and is ranked by distance. Needs a reduction that is the identity.
/// Source of NEHVI: Daulton, Balandat & Bakshy, "Parallel Bayesian Optimization of Multiple Noisy Objectives with
/// Expected Hypervolume Improvement", NeurIPS 2021.
struct LogNehvi {
  int draws = 16;
  bool noisy = true;  ///< false: observed values stand as they are, and only pending designs are drawn
  /// Observed designs are not drawn if another still beats them in all objectives after so many deviations of both
  /// towards each other: they would hardly ever be in a front, and cost time.
  double hopeless = 3.0;

  template <CovarianceKernel Kernel> class Prepared {
   public:
    Prepared(std::vector<ConditionalPosterior<Kernel>> posteriors, std::vector<ExpectedHypervolume> improvements)
        : posteriors_(std::move(posteriors)), improvements_(std::move(improvements)) {}

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const auto m = Eigen::Index(posteriors_.size()), drawn = Eigen::Index(improvements_.size());
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd mean(m), deviation(m), sum = Eigen::VectorXd::Zero(x.cols());
      const auto load = [&](Eigen::Index i, Eigen::Index s) {
        for (Eigen::Index j = 0; j < m; ++j) {
          mean[j] = at[std::size_t(j)].mean(i, s);
          deviation[j] = at[std::size_t(j)].deviation[i];
        }
      };
      for (Eigen::Index s = 0; s < drawn; ++s)
        for (Eigen::Index i = 0; i < x.cols(); ++i) {
          load(i, s);
          sum[i] += improvements_[std::size_t(s)].value(mean, deviation);
        }
      std::vector<double> logs(improvements_.size());
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        if (sum[i] > 1e-280 && std::isfinite(sum[i])) {
          sum[i] = std::log(sum[i] / double(drawn));
          continue;
        }
        for (Eigen::Index s = 0; s < drawn; ++s) {  // hopeless, but to be ranked
          load(i, s);
          logs[std::size_t(s)] = improvements_[std::size_t(s)].log_value(mean, deviation);
        }
        sum[i] = log_sum_exp(logs.begin(), logs.end()) - std::log(double(drawn));
      }
      return sum;
    }

   private:
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<ExpectedHypervolume> improvements_;
  };

  /// Models are referred to, not copied: they must outlive the result. Throws InvalidArgument for a reduction other
  /// than the identity.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction,
      const Evidence& evidence, std::uint64_t seed) const {
    if (!reduction.identity() || Eigen::Index(models.size()) != evidence.reference.size())
      throw InvalidArgument(message("closed-form improvement needs one model for each of ", evidence.reference.size(),
          " objectives, has ", models.size(), " outputs to reduce"));
    const Eigen::MatrixXd base = noisy ? contenders(models, evidence) : evidence.pending;
    const Eigen::Index count = base.cols() ? std::max(1, draws) : 1;
    std::vector<ConditionalPosterior<Kernel>> posteriors;
    std::vector<Eigen::MatrixXd> drawn;
    for (std::size_t j = 0; j < models.size(); ++j) {
      posteriors.emplace_back(models[j], base, base_normals(base.cols(), count, combine(seed, j)));
      drawn.push_back(posteriors.back().draws());
    }
    std::vector<ExpectedHypervolume> improvements;
    for (Eigen::Index s = 0; s < count; ++s)
      improvements.emplace_back(standing_objectives(drawn, s, reduction, evidence, noisy), evidence.reference);
    return {std::move(posteriors), std::move(improvements)};
  }

 private:
  /// Observed designs that may be in a front, and all that are pending.
  template <CovarianceKernel Kernel>
  Eigen::MatrixXd contenders(const std::vector<GaussianProcess<Kernel>>& models, const Evidence& evidence) const {
    const Eigen::Index n = evidence.x.cols(), m = Eigen::Index(models.size());
    Eigen::MatrixXd low(m, n), high(m, n);
    for (Eigen::Index j = 0; j < m; ++j) {
      const auto p = models[std::size_t(j)].predict(evidence.x);
      const Eigen::VectorXd reach = hopeless * p.variance.cwiseSqrt();
      low.row(j) = (p.mean - reach).transpose();
      high.row(j) = (p.mean + reach).transpose();
    }
    std::vector<Eigen::Index> kept;
    for (Eigen::Index i = 0; i < n; ++i) {
      bool beaten = false;
      for (Eigen::Index k = 0; k < n && !beaten; ++k) beaten = (low.col(k).array() > high.col(i).array()).all();
      if (!beaten) kept.push_back(i);
    }
    Eigen::MatrixXd base(evidence.x.rows(), Eigen::Index(kept.size()) + evidence.pending.cols());
    base << Eigen::MatrixXd(evidence.x(Eigen::all, kept)), evidence.pending;
    return base;
  }
};

namespace detail {

/// log of a smooth max(x, 0) whose lower tail falls like 1/x² instead of exponentially. Source: Ament et al. 2023,
/// appendix A.
inline double log_fat_relu(double x, double tau) {
  const double t = x / tau;
  const double softplus = t > 0.0 ? t + std::log1p(std::exp(-t)) : std::log1p(std::exp(t));
  return std::log(tau) + std::log(softplus + 0.1 / (1.0 + t * t));
}

/// Smooth minimum of two numbers with a tail that falls like a power. Source: Ament et al. 2023, appendix A.
inline double fat_minimum(double a, double b, double tau) {
  const double gap = std::abs(a - b) / tau;
  return std::min(a, b) - tau * std::log1p(2.0 / (2.0 + gap * (2.0 + gap)));
}

}  // namespace detail

/// qLogNEHVI by sampling, for any reduction: q > 1 designs are chosen one after the other, each with those before it
/// pending, and pending designs join the front draw by draw. Fixed base samples. Source: Daulton, Balandat & Bakshy,
/// NeurIPS 2021 (cached box decompositions, sequential greedy choice); Ament et al., NeurIPS 2023 (logarithms and
/// smoothing).
struct QLogNehvi {
  int draws = 128;
  bool noisy = true;       ///< false: observed values stand as they are (qLogEHVI)
  double tau_relu = 1e-6;  ///< smoothing of max(·, 0), in the units of the objectives
  double tau_max = 1e-3;   ///< smoothing of minima of logarithms

  /// Standard normal numbers that replace random ones.
  struct BaseSamples {
    std::vector<Eigen::MatrixXd> base;       ///< per output: base points × draws
    std::vector<Eigen::VectorXd> candidate;  ///< per output: draws
  };

  template <CovarianceKernel Kernel, Reduction R> class Prepared {
   public:
    Prepared(const QLogNehvi& config, const std::vector<GaussianProcess<Kernel>>& models, const R& reduction,
        const Evidence& evidence, const BaseSamples& samples)
        : tau_relu_(config.tau_relu), tau_max_(config.tau_max), reduction_(reduction), candidate_(samples.candidate) {
      const Eigen::MatrixXd base = base_points(evidence, config.noisy);
      std::vector<Eigen::MatrixXd> drawn;
      for (std::size_t j = 0; j < models.size(); ++j) {
        posteriors_.emplace_back(models[j], base, samples.base[j]);
        drawn.push_back(posteriors_.back().draws());
      }
      for (Eigen::Index s = 0; s < candidate_.front().size(); ++s)
        boxes_.push_back(nondominated_boxes(
            standing_objectives(drawn, std::min(s, drawn.front().cols() - 1), reduction, evidence, config.noisy),
            evidence.reference));
    }

    Eigen::VectorXd operator()(const Eigen::MatrixXd& x) const {
      const Eigen::Index outputs = Eigen::Index(posteriors_.size()), count = candidate_.front().size();
      std::vector<typename ConditionalPosterior<Kernel>::Conditional> at;
      for (const auto& p : posteriors_) at.push_back(p.at(x));
      Eigen::VectorXd out(x.cols());
      Eigen::MatrixXd sample(outputs, count);
      std::vector<double> per_draw(static_cast<std::size_t>(count)), per_box;
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        for (Eigen::Index j = 0; j < outputs; ++j) {
          const auto& a = at[std::size_t(j)];
          for (Eigen::Index s = 0; s < count; ++s)
            sample(j, s) = a.mean(i, std::min(s, a.mean.cols() - 1)) + a.deviation[i] * candidate_[std::size_t(j)][s];
        }
        const Eigen::MatrixXd y = reduction_.objectives(sample);
        for (Eigen::Index s = 0; s < count; ++s) {
          const BoxDecomposition& boxes = boxes_[std::size_t(s)];
          per_box.assign(std::size_t(boxes.lower.cols()), 0.0);
          for (Eigen::Index k = 0; k < boxes.lower.cols(); ++k)
            for (Eigen::Index j = 0; j < y.rows(); ++j) {
              const double side = std::log(boxes.upper(j, k) - boxes.lower(j, k));  // ∞ where the box is open
              per_box[std::size_t(k)] +=
                  detail::fat_minimum(detail::log_fat_relu(y(j, s) - boxes.lower(j, k), tau_relu_), side, tau_max_);
            }
          per_draw[std::size_t(s)] = log_sum_exp(per_box.begin(), per_box.end());
        }
        out[i] = log_sum_exp(per_draw.begin(), per_draw.end()) - std::log(double(count));
      }
      return out;
    }

   private:
    double tau_relu_, tau_max_;
    R reduction_;
    std::vector<Eigen::VectorXd> candidate_;
    std::vector<ConditionalPosterior<Kernel>> posteriors_;
    std::vector<BoxDecomposition> boxes_;
  };

  /// Models are referred to, not copied: they must outlive the result.
  template <CovarianceKernel Kernel, Reduction R>
  Prepared<Kernel, R> prepare(const std::vector<GaussianProcess<Kernel>>& models, const R& reduction,
      const Evidence& evidence, std::uint64_t seed) const {
    const Eigen::Index base = base_points(evidence, noisy).cols();
    BaseSamples samples;
    for (std::size_t j = 0; j < models.size(); ++j) {
      const Eigen::MatrixXd z = base_normals(base + 1, draws, combine(seed, j));
      samples.base.push_back(z.topRows(base));
      samples.candidate.push_back(z.row(base).transpose());
    }
    return Prepared<Kernel, R>(*this, models, reduction, evidence, samples);
  }
};

}  // namespace lumo

#endif

// ---- lumo/optimize/problem.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_PROBLEM_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_PROBLEM_HPP

namespace lumo {

/// Values in variable order.
using Design = std::vector<double>;
using DesignSet = std::set<Design>;

/// One figure of merit. Only values better than `reference` add to the hypervolume.
struct Objective {
  std::string name;
  bool maximize = true;
  double reference = 0.0;

  double signed_value(double y) const { return maximize ? y : -y; }  ///< larger is better
};

/// An optimisation problem, and how much of the search is fixed beforehand.
struct Problem {
  DesignSpace space;
  std::vector<Objective> objectives;
  std::vector<Design> initial;  ///< asked first
  int sobol = 8;                ///< asked next: points spread over the space
  int evaluations = 40;         ///< observed trials at which it ends, initial and Sobol ones included
  std::uint64_t seed = 0;

  /// Throws InvalidArgument or InfeasibleDesign naming the fault; DesignSampler checks variables and constraints.
  void validate() const {
    if (objectives.empty()) throw InvalidArgument("problem has no objectives, must have at least 1");
    std::set<std::string> names;
    for (const Objective& o : objectives) {
      if (!names.insert(o.name).second) throw InvalidArgument(message("objective ", o.name, " is there twice"));
      if (!std::isfinite(o.reference))
        throw InvalidArgument(
            message("objective ", o.name, " has reference ", o.reference, ", must be a finite number"));
    }
    if (sobol < 0 || sobol > 100000)
      throw InvalidArgument(message("number of Sobol points is ", sobol, ", must lie in [0, 100000]"));
    if (evaluations < 1 || evaluations > 100000)
      throw InvalidArgument(message("number of evaluations is ", evaluations, ", must lie in [1, 100000]"));
    for (const Design& x : initial) space.check(x);
  }
};

/// A design that was asked, and its outcome.
struct Trial {
  enum class State { pending, observed, failed };
  int id = 0;  ///< counts from 0 in the order of asking
  Design x;
  State state = State::pending;
  std::vector<double> outputs;  ///< observed ones, in their own units and sense
  bool retry = false;           ///< failed for a reason that does not lie in the design
  std::string why;
};

/// An observed trial's objectives, in their own units and sense.
struct Outcome {
  int id = 0;
  std::vector<double> objectives;
};

/// Evaluations that ended, and how many of them failed.
struct FailureTally {
  int failed = 0, ended = 0;
};

/// Counts designs: a failure of the machine is no evaluation.
inline FailureTally design_failures(const std::vector<Trial>& trials) {
  FailureTally tally;
  for (const Trial& t : trials) {
    const bool failed = t.state == Trial::State::failed && !t.retry;
    tally.failed += failed;
    tally.ended += failed || t.state == Trial::State::observed;
  }
  return tally;
}

/// Counts failures of the machine in the trials `own`.
inline FailureTally machine_failures(const std::vector<Trial>& trials, const std::set<int>& own) {
  FailureTally tally{0, int(own.size())};
  for (const int id : own)
    tally.failed += trials[std::size_t(id)].state == Trial::State::failed && trials[std::size_t(id)].retry;
  return tally;
}

/// When failures end a search, so that one that cannot succeed does not go on for ever.
struct FailureLimit {
  int at_least = 5;    ///< once so many evaluations have failed
  double above = 0.5;  ///< and more than this share of them

  bool exceeded(const FailureTally& tally) const {
    return tally.failed >= at_least && tally.failed > above * tally.ended;
  }
  /// Why a search ends, in words; of the last trial that failed.
  std::string reason(const FailureTally& tally, const std::vector<Trial>& trials) const {
    std::string why;
    for (const Trial& t : trials)
      if (t.state == Trial::State::failed) why = t.why;
    return message(tally.failed, " of ", tally.ended, " evaluations failed, the limit is ", 100 * above, " % once ",
        at_least, " have; the last: ", why);
  }
};

enum class OptimizerStatus {
  running,   ///< there is more to ask
  waiting,   ///< no design to ask until a pending trial is answered
  finished,  ///< as many trials are observed as the problem wants
  exhausted  ///< every feasible design that can be found has been asked
};

}  // namespace lumo

#endif

// ---- lumo/optimize/polytope_walk.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_POLYTOPE_WALK_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_POLYTOPE_WALK_HPP

namespace lumo {

/// Random walk over the feasible designs of a space that random points hardly ever hit. Each move goes to a uniformly
/// random place of the feasible part of a line, so that designs become uniform over the space, wherever the walk began.
/// Lines run along an axis, along a pair of axes so that one constraint keeps its sum, or in any direction of the
/// continuous variables. Source: Smith, "Efficient Monte Carlo Procedures for Generating Points Uniformly Distributed
/// over Bounded Regions", Oper. Res. 32 (1984).
class PolytopeWalk {
 public:
  /// Refers to the space.
  explicit PolytopeWalk(const DesignSpace& space) : space_(space) {
    for (std::size_t i = 0; i < space.variables.size(); ++i)
      if (space.variables[i].step == 0.0) continuous_.push_back(i);
  }

  /// The design after `moves` moves from a feasible one; `shifted(i, value, by)` is the variable's value after a
  /// change, on its lattice if it has one.
  template <class Shifted> Design after(Design x, int moves, std::uint64_t key, const Shifted& shifted) const {
    for (int k = 0; k < moves; ++k) {
      const std::uint64_t draw = combine(key, std::uint64_t(k));
      const Line line = random_line(draw);
      const auto [low, high] = feasible(line, x);
      if (!(low <= high)) continue;
      const double u = uniform(combine(draw, 1)),
                   t = line.whole ? std::min(low + std::floor(u * (high - low + 1.0)), high) : low + u * (high - low);
      Design y = x;
      for (const auto& [i, by] : line.steps) y[i] = shifted(i, x[i], t * by);
      if (space_.contains(y)) x = std::move(y);
    }
    return x;
  }
  /// Moves that make a design nearly independent of the one before, and ten times as many of one at an edge.
  int between() const { return 10 * int(space_.variables.size()); }

 private:
  struct Line {
    std::vector<std::pair<std::size_t, double>> steps;  ///< variables, and their changes per unit
    bool whole = false;                                 ///< whole units only
  };

  double unit(std::size_t i) const {
    const Variable& v = space_.variables[i];
    return v.step > 0.0 ? v.step : v.upper - v.lower;
  }
  Line random_line(std::uint64_t key) const {
    const auto pick = [&](std::uint64_t label, std::size_t count) {
      return std::size_t(uniform(combine(key, label)) * double(count));
    };
    const std::size_t kinds = continuous_.size() > 1 ? 3 : 2, kind = pick(2, kinds);
    const LinearConstraint* face =
        space_.constraints.empty() ? nullptr : &space_.constraints[pick(3, space_.constraints.size())];
    if (kind == 2) return direction(key, uniform(combine(key, 4)) < 0.5 ? nullptr : face);
    const std::size_t i = pick(5, space_.variables.size());
    if (kind == 0 || !face || face->coefficients[i] == 0.0) return {{{i, unit(i)}}, space_.variables[i].step > 0.0};
    return along(*face, i, pick(6, space_.variables.size()));
  }
  /// Changes two variables so that the sum of a constraint stays as it is.
  Line along(const LinearConstraint& face, std::size_t i, std::size_t k) const {
    if (k == i || face.coefficients[k] == 0.0) return {{{i, unit(i)}}, space_.variables[i].step > 0.0};
    const double ratio = -face.coefficients[i] / face.coefficients[k];
    const bool i_whole = space_.variables[i].step > 0.0, k_whole = space_.variables[k].step > 0.0;
    if (!k_whole) return {{{i, unit(i)}, {k, ratio * unit(i)}}, i_whole};
    if (!i_whole) return {{{i, unit(k) / ratio}, {k, unit(k)}}, true};
    constexpr double most_steps = 16.0;
    for (double steps = 1.0; steps <= most_steps; ++steps) {
      const double other = ratio * steps * unit(i) / unit(k);
      if (std::abs(other) > 0.5 && std::abs(other - std::round(other)) < 1e-9 * std::abs(other))
        return {{{i, steps * unit(i)}, {k, std::round(other) * unit(k)}}, true};
    }
    return {{{i, unit(i)}}, true};
  }
  /// Any direction of the continuous variables, or any in which a constraint keeps its sum.
  Line direction(std::uint64_t key, const LinearConstraint* face) const {
    Line line;
    double rate = 0.0, size = 0.0;  // variables count by their range
    for (std::size_t i : continuous_) {
      line.steps.emplace_back(i, normal_quantile(uniform(combine(combine(key, 7), i))) * unit(i));
      const double c = face ? face->coefficients[i] : 0.0;
      rate += c * line.steps.back().second;
      size += c * c * unit(i) * unit(i);
    }
    if (face && size > 0.0)
      for (auto& [i, by] : line.steps) by -= rate / size * face->coefficients[i] * unit(i) * unit(i);
    return line;
  }
  /// Between which units a line from a design stays within bounds and linear constraints; the first above the second:
  /// nowhere.
  std::pair<double, double> feasible(const Line& line, const Design& x) const {
    double low = -std::numeric_limits<double>::infinity(), high = -low;
    const auto limit = [&](double rate, double below, double above) {
      if (rate < 0.0) std::swap(below, above);
      low = std::max(low, below / rate);
      high = std::min(high, above / rate);
    };
    for (const auto& [i, by] : line.steps)
      if (by != 0.0) limit(by, space_.variables[i].lower - x[i], space_.variables[i].upper - x[i]);
    for (const LinearConstraint& c : space_.constraints) {
      double rate = 0.0, size = 0.0;
      for (const auto& [i, by] : line.steps) {
        rate += c.coefficients[i] * by;
        size += std::abs(c.coefficients[i] * by);
      }
      if (std::abs(rate) <= 1e-12 * size) continue;
      const double sum = c.sum(x);
      limit(rate, c.lower - sum, c.upper - sum);
    }
    if (!std::isfinite(low) || !std::isfinite(high)) return {1.0, 0.0};
    constexpr double rounding = 1e-9;
    return line.whole ? std::pair{std::ceil(low - rounding), std::floor(high + rounding)} : std::pair{low, high};
  }

  const DesignSpace& space_;
  std::vector<std::size_t> continuous_;
};

}  // namespace lumo

#endif

// ---- lumo/optimize/design_sampler.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_DESIGN_SAMPLER_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_DESIGN_SAMPLER_HPP

namespace lumo {

/// Samples feasible designs of a space: fresh ones spread over it, and moves from a given one. Small lattices are
/// listed, so that their last free design is found and their end is known. Law: all that it returns is feasible, on the
/// lattice to the bit, and a function of its key.
class DesignSampler {
 public:
  static constexpr std::size_t list_limit = 100000;     ///< feasible designs up to which a lattice is listed
  static constexpr std::size_t visit_limit = 4000000;   ///< nodes looked at for that
  static constexpr std::uint32_t try_limit = 1u << 18;  ///< points tried for one set of fresh designs

  /// Throws InvalidArgument for a space without variables, a name twice, bounds that are not finite or are reversed, a
  /// lattice without a node between them, a constraint with the wrong number of coefficients. The space is copied.
  explicit DesignSampler(DesignSpace space) : space_(std::move(space)) {
    if (space_.variables.empty()) throw InvalidArgument("design space has no variables, must have at least 1");
    std::set<std::string> names;
    for (std::size_t i = 0; i < dimensions(); ++i) {
      const Variable& v = space_.variables[i];
      if (!names.insert(v.name).second) throw InvalidArgument(message("variable ", v.name, " is there twice"));
      if (!std::isfinite(v.lower) || !std::isfinite(v.upper) || v.lower > v.upper || !std::isfinite(v.upper - v.lower))
        throw InvalidArgument(message(
            "variable ", v.name, " has bounds ", v.lower, " and ", v.upper, ", must be finite, the lower first"));
      if (!std::isfinite(v.step) || v.step < 0.0)
        throw InvalidArgument(message("variable ", v.name, " has step ", v.step, ", must be finite and >= 0"));
      Axis axis;
      if (v.step > 0.0) {
        const double slack = 1e-9;  // bounds such as 0.3 on a lattice of 0.1 are meant to be nodes
        axis.first_node = std::ceil((v.lower - v.origin) / v.step - slack);
        axis.nodes = std::floor((v.upper - v.origin) / v.step + slack) - axis.first_node + 1.0;
        if (!(axis.nodes >= 1.0) || axis.nodes > 1e15)
          throw InvalidArgument(message("variable ", v.name, " has ", std::max(0.0, axis.nodes), " nodes of step ",
              v.step, " between ", v.lower, " and ", v.upper, ", must have 1 to 1e15"));
      }
      axes_.push_back(axis);
      if (axis.nodes > 0.0 && axis.nodes <= 65536.0)
        for (double k = 0.0; k < axis.nodes; ++k) axes_[i].table.push_back(node(i, k));
    }
    for (const LinearConstraint& c : space_.constraints)
      if (c.coefficients.size() != dimensions() || !(c.lower <= c.upper))
        throw InvalidArgument(
            message("constraint ", c.name, " has ", c.coefficients.size(), " coefficients and limits ", c.lower,
                " and ", c.upper, ", must have ", dimensions(), " and the lower limit first"));
    if (std::all_of(axes_.begin(), axes_.end(), [](const Axis& a) { return a.nodes > 0.0; })) list();
  }

  const DesignSpace& space() const { return space_; }
  std::size_t dimensions() const { return space_.variables.size(); }
  /// Number of feasible designs, where they are few enough to be listed.
  std::optional<std::size_t> feasible_count() const { return listed_ ? std::optional(list_.size()) : std::nullopt; }

  /// Up to `count` different feasible designs that are not in `taken`, uniform over the space; fewer if there are no
  /// more, or none is found in `try_limit` tries. Points of a Sobol sequence, or of a random walk where less than one
  /// in a thousand of them is feasible.
  std::vector<Design> fresh(std::size_t count, std::uint64_t key, const DesignSet& taken) const {
    std::vector<Design> out;
    DesignSet seen;
    const PolytopeWalk walk(space_);
    const auto change = [this](std::size_t i, double x, double by) { return shifted(i, x, by); };
    std::optional<Design> walker;
    const OwenSobol sequence{key};
    const std::uint32_t tries = listed_ ? std::uint32_t(std::min<std::size_t>(64 * count, try_limit)) : try_limit;
    for (std::uint32_t index = 0; index < tries && out.size() < count; ++index) {
      Design x = point(sequence, index);
      if (!space_.contains(x)) {
        const std::uint64_t draw = combine(key, index);
        if (!walker) {  // where repair ends is a face
          if (listed_ || out.size() * 1000 > index || index < 4096 || index % 64 != 0) continue;
          const auto repair = repaired(x, draw);
          if (!repair) continue;
          walker = walk.after(*repair, 10 * walk.between(), draw, change);
        }
        x = *(walker = walk.after(*walker, walk.between(), combine(draw, 1), change));
      }
      if (!taken.contains(x) && seen.insert(x).second) out.push_back(x);
    }
    // Nodes of a listed lattice that random points missed, in an order that depends on the key.
    struct Missed {
      std::uint64_t order;
      std::size_t number;
      auto operator<=>(const Missed&) const = default;
    };
    std::vector<Missed> rest;
    for (std::size_t i = 0; i < list_.size() && out.size() < count; ++i)
      if (!taken.contains(list_[i]) && !seen.contains(list_[i])) rest.push_back({combine(key, i), i});
    std::sort(rest.begin(), rest.end());
    for (std::size_t i = 0; i < rest.size() && out.size() < count; ++i) out.push_back(list_[rest[i].number]);
    return out;
  }

  /// The feasible designs one move away from `x`: along each axis, along pairs of lattice axes and in `extra` random
  /// directions. A move is `reach` times the variable's range, and at least one step of its lattice.
  std::vector<Design> moves(const Design& x, double reach, int extra, std::uint64_t key) const {
    std::vector<Design> out;
    const std::size_t d = dimensions();
    const auto by = [&](std::size_t i) { return reach * (space_.variables[i].upper - space_.variables[i].lower); };
    const auto offer = [&](const Design& y) {
      if (y != x && space_.contains(y)) out.push_back(y);
    };
    for (std::size_t i = 0; i < d; ++i)
      for (const double sign : {-1.0, 1.0}) {
        Design y = x;
        y[i] = shifted(i, x[i], sign * by(i));
        offer(y);
        // One up, its neighbour down (and so on) follows a constraint's face; off lattices, and where pairs are many,
        // the random moves do.
        for (std::size_t k = i + 1; k < d && d <= 8; ++k)
          for (const double other : {-1.0, 1.0}) {
            if (axes_[i].nodes == 0.0 || axes_[k].nodes == 0.0) continue;
            Design z = y;
            z[k] = shifted(k, x[k], other * by(k));
            offer(z);
          }
      }
    for (int e = 0; e < extra; ++e) {
      Design y = x;
      for (std::size_t i = 0; i < d; ++i) {
        const std::uint64_t draw = combine(combine(key, std::uint64_t(e)), i);
        y[i] = shifted(i, x[i], 2.0 * (uniform(draw) - 0.5) * by(i) * 1.5);
      }
      offer(y);
    }
    return out;
  }

  /// Is `reach` too small to make a difference: one step on every lattice, less than 10⁻⁴ of the range elsewhere?
  bool finest(double reach) const {
    for (std::size_t i = 0; i < dimensions(); ++i) {
      const Variable& v = space_.variables[i];
      const double range = v.upper - v.lower;
      if (axes_[i].nodes > 0.0 ? reach * range >= 1.5 * v.step : reach >= 1e-4 && range > 0.0) return false;
    }
    return true;
  }

  /// The same design with lattice values to the bit as the sampler writes them.
  Design canonical(Design x) const {
    for (std::size_t i = 0; i < x.size() && i < dimensions(); ++i)
      if (axes_[i].nodes > 0.0) x[i] = shifted(i, x[i], 0.0);
    return x;
  }

 private:
  /// Values along one axis: a lattice's nodes, or any between the bounds.
  struct Axis {
    double first_node = 0.0, nodes = 0.0;  ///< index of the first node and number of nodes; none: continuous
    std::vector<double> table;
  };

  /// The shortest decimal number for a node: 0.3, not 0.30000000000000004.
  double node(std::size_t i, double k) const {
    if (!axes_[i].table.empty() && k < double(axes_[i].table.size())) return axes_[i].table[std::size_t(k)];
    const Variable& v = space_.variables[i];
    const double x = v.origin + (axes_[i].first_node + k) * v.step;
    char digits[40];
    const char* end = std::to_chars(digits, digits + sizeof digits, x, std::chars_format::general, 14).ptr;
    double rounded = x;
    std::from_chars(digits, end, rounded);
    const double size = std::max({std::abs(x), std::abs(v.origin), std::abs(x - v.origin)});  // of what was added
    return std::clamp(
        std::abs(rounded - x) <= 2.0 * std::numeric_limits<double>::epsilon() * size ? rounded : x, v.lower, v.upper);
  }
  double place(std::size_t i, double unit) const {
    const Variable& v = space_.variables[i];
    if (axes_[i].nodes > 0.0) return node(i, std::clamp(std::floor(unit * axes_[i].nodes), 0.0, axes_[i].nodes - 1.0));
    return std::clamp(v.lower + unit * (v.upper - v.lower), v.lower, v.upper);
  }
  double shifted(std::size_t i, double x, double by) const {
    const Variable& v = space_.variables[i];
    if (axes_[i].nodes == 0.0) return std::clamp(x + by, v.lower, v.upper);
    double steps = std::round(by / v.step);
    if (steps == 0.0 && by != 0.0) steps = by > 0.0 ? 1.0 : -1.0;
    return node(
        i, std::clamp(std::round((x - v.origin) / v.step) - axes_[i].first_node + steps, 0.0, axes_[i].nodes - 1.0));
  }
  void list() {
    Design x(dimensions());
    std::size_t visits = 0;
    listed_ = descend(0, x, visits);
    if (!listed_) list_ = {};
  }
  /// Depth first over the lattice, leaving branches that no choice of the remaining variables can save. False when
  /// there is too much.
  bool descend(std::size_t i, Design& x, std::size_t& visits) {
    if (++visits > visit_limit) return false;
    for (const LinearConstraint& c : space_.constraints) {
      double least = 0.0, most = 0.0, size = 0.0;
      for (std::size_t j = 0; j < dimensions(); ++j) {
        const Variable& v = space_.variables[j];
        const double a = c.coefficients[j] * (j < i ? x[j] : v.lower), b = c.coefficients[j] * (j < i ? x[j] : v.upper);
        least += std::min(a, b);
        most += std::max(a, b);
        size += std::max(std::abs(a), std::abs(b));
      }
      if (least > c.upper + 1e-12 * size || most < c.lower - 1e-12 * size) return true;
    }
    if (i == dimensions()) {
      if (space_.contains(x)) list_.push_back(x);
      return list_.size() <= list_limit;
    }
    for (double k = 0.0; k < axes_[i].nodes; ++k) {
      x[i] = node(i, k);
      if (!descend(i + 1, x, visits)) return false;
    }
    return true;
  }
  /// Projects on the linear constraints in turn until all hold; nullopt if that does not end. For spaces that random
  /// points rarely hit.
  std::optional<Design> repaired(Design x, std::uint64_t key) const {
    for (int sweep = 0; sweep < 100; ++sweep) {
      if (space_.contains(x)) return x;
      for (const LinearConstraint& c : space_.constraints) {
        const double too_much = excess(c, x);
        if (too_much == 0.0) continue;
        double norm = 0.0;  // variables count by their range
        for (std::size_t i = 0; i < x.size(); ++i)
          norm += std::pow(c.coefficients[i] * (space_.variables[i].upper - space_.variables[i].lower), 2);
        if (!(norm > 0.0)) return std::nullopt;
        for (std::size_t i = 0; i < x.size(); ++i) {
          const double range = space_.variables[i].upper - space_.variables[i].lower;
          const double by = -too_much * c.coefficients[i] * range * range / norm;
          x[i] = axes_[i].nodes > 0.0 ? (std::abs(by) > 0.25 * space_.variables[i].step ? shifted(i, x[i], by) : x[i])
                                      : shifted(i, x[i], by);
        }
        settle(c, x, combine(key, std::uint64_t(sweep)));  // what rounding left, or was too little to move any
      }
    }
    return std::nullopt;
  }
  /// Excess of a sum above its upper limit, or (negative) below its lower one, and a little more, so that rounding
  /// does not matter.
  static double excess(const LinearConstraint& c, const Design& x) {
    const double sum = c.sum(x), inside = std::min(1e-9 * std::abs(sum),
                                     std::isfinite(c.upper - c.lower) ? 0.5 * (c.upper - c.lower) : 1.0);
    return sum > c.upper ? sum - c.upper + inside : sum < c.lower ? sum - c.lower - inside : 0.0;
  }
  /// Moves single lattice variables by the steps that the excess is worth, in an order that depends on the key, if that
  /// lessens it.
  void settle(const LinearConstraint& c, Design& x, std::uint64_t key) const {
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double before = excess(c, x);
      if (std::abs(before) <= c.rounding(x)) return;
      const std::size_t i = (std::size_t(key % x.size()) + k) % x.size();
      if (axes_[i].nodes == 0.0 || c.coefficients[i] == 0.0) continue;
      const double steps = -before / (c.coefficients[i] * space_.variables[i].step);
      Design moved = x;
      moved[i] = shifted(i, x[i], std::copysign(std::ceil(std::abs(steps) - 1e-6), steps) * space_.variables[i].step);
      if (std::abs(excess(c, moved)) < std::abs(before)) x = std::move(moved);
    }
  }
  Design point(const OwenSobol& sequence, std::uint32_t index) const {
    Design x(dimensions());
    for (std::size_t i = 0; i < dimensions(); ++i) {
      const std::uint64_t number = i / std::size_t(Sobol::dimensions), key = combine(sequence.seed, number);
      // Later blocks take the points in another order, or their dimensions would go with those of the first.
      const std::uint32_t of_block =
          number == 0 ? index : owen_scramble(index, std::uint32_t(combine(key, Sobol::dimensions) >> 32));
      x[i] = place(i, OwenSobol{key}(of_block, int(i % std::size_t(Sobol::dimensions))));
    }
    return x;
  }

  DesignSpace space_;
  std::vector<Axis> axes_;
  std::vector<Design> list_;
  bool listed_ = false;
};

}  // namespace lumo

#endif

// ---- lumo/optimize/candidate_source.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_CANDIDATE_SOURCE_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_CANDIDATE_SOURCE_HPP

namespace lumo {

/// The input of a source of candidates.
struct CandidateRequest {
  const DesignSampler& sampler;
  const DesignSet& taken;            ///< never to be proposed
  const std::vector<Design>& front;  ///< observed designs that no other dominates, by falling first objective
  std::uint64_t key;
};

/// Utility of designs (columns), larger is better; may be −∞.
using Score = std::function<Eigen::VectorXd(const Eigen::MatrixXd&)>;

/// Searches a space for the design of highest score. Laws: the design is feasible and not taken; nullopt only if no
/// such design is found; a pure function of request and scores.
template <class S>
concept CandidateSource = requires(const S& source, const CandidateRequest& request, const Score& score) {
  { source.best(request, score) } -> std::convertible_to<std::optional<Design>>;
};

/// Designs as the columns of a matrix of `rows` variables.
inline Eigen::MatrixXd design_columns(const std::vector<Design>& designs, std::size_t rows) {
  Eigen::MatrixXd x(Eigen::Index(rows), Eigen::Index(designs.size()));
  for (std::size_t i = 0; i < designs.size(); ++i)
    x.col(Eigen::Index(i)) = Eigen::Map<const Eigen::VectorXd>(designs[i].data(), Eigen::Index(rows));
  return x;
}

/// The paper's: a number of fresh feasible designs, the best of them.
struct FreshCandidates {
  std::size_t count = 256;

  std::optional<Design> best(const CandidateRequest& request, const Score& score) const {
    const auto pool = request.sampler.fresh(count, request.key, request.taken);
    if (pool.empty()) return std::nullopt;
    Eigen::Index top = 0;
    score(design_columns(pool, request.sampler.dimensions())).maxCoeff(&top);
    return pool[std::size_t(top)];
  }
};

/// Fresh designs and moves from the current front, and from the best of those uphill by pattern search, until no move
/// on the finest lattice helps. This is a discrete local search on a lattice; steps are halved elsewhere. Source: Hooke
/// & Jeeves, J. ACM 8 (1961).
struct LocalSearchCandidates {
  std::size_t fresh = 256;
  std::size_t from_front = 256;  ///< at most
  std::size_t climbers = 6;      ///< places that are searched from
  double reach = 0.08;           ///< first move, relative to a variable's range
  int random_moves = 12;         ///< per climber and round, besides those along axes
  int rounds = 25;

  std::optional<Design> best(const CandidateRequest& request, const Score& score) const {
    const std::vector<Design> designs = pool(request);
    if (designs.empty()) return std::nullopt;
    std::vector<Climber> team = best_of(designs, request, score);
    for (int round = 0; round < rounds; ++round)
      if (!climb(team, round, request, score)) break;
    return std::max_element(team.begin(), team.end(), [](const Climber& a, const Climber& b) {
      return a.score < b.score;
    })->x;
  }

 private:
  struct Climber {
    Design x;
    double score;
    double reach;
    bool stuck = false;
  };
  // Fresh designs, and moves from the front: a random choice of them if the front is long.
  std::vector<Design> pool(const CandidateRequest& request) const {
    const DesignSampler& sampler = request.sampler;
    std::vector<Design> all = sampler.fresh(fresh, request.key, request.taken);
    DesignSet seen(all.begin(), all.end());
    std::vector<Design> near;
    for (std::size_t i = 0; i < request.front.size(); ++i)
      for (const double r : {0.25 * reach, reach})
        for (Design& x : sampler.moves(request.front[i], r, random_moves, combine(combine(request.key, 1), i)))
          if (!request.taken.contains(x) && seen.insert(x).second) near.push_back(std::move(x));
    for (std::size_t i = 0; i < near.size() && i < from_front; ++i)
      std::swap(near[i], near[i + combine(combine(request.key, 2), i) % (near.size() - i)]);
    if (near.size() > from_front) near.resize(from_front);
    all.insert(all.end(), near.begin(), near.end());
    return all;
  }
  std::vector<Climber> best_of(
      const std::vector<Design>& designs, const CandidateRequest& request, const Score& score) const {
    const Eigen::VectorXd scores = score(design_columns(designs, request.sampler.dimensions()));
    std::vector<std::size_t> order(designs.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::stable_sort(order.begin(), order.end(),
        [&](std::size_t a, std::size_t b) { return scores[Eigen::Index(a)] > scores[Eigen::Index(b)]; });
    std::vector<Climber> team;
    for (std::size_t i = 0; i < order.size() && team.size() < climbers; ++i)
      team.push_back({designs[order[i]], scores[Eigen::Index(order[i])], reach});
    return team;
  }
  // Moves each climber to the best of its moves, or halves its reach. False: all are stuck.
  bool climb(std::vector<Climber>& team, int round, const CandidateRequest& request, const Score& score) const {
    const DesignSampler& sampler = request.sampler;
    std::vector<Design> moves;
    std::vector<std::size_t> owner;
    for (std::size_t c = 0; c < team.size(); ++c) {
      if (team[c].stuck) continue;
      for (Design& x : sampler.moves(
               team[c].x, team[c].reach, random_moves, combine(combine(request.key, 3 + std::uint64_t(round)), c)))
        if (!request.taken.contains(x)) {
          moves.push_back(std::move(x));
          owner.push_back(c);
        }
    }
    std::vector<Climber> next = team;
    if (!moves.empty()) {
      const Eigen::VectorXd values = score(design_columns(moves, sampler.dimensions()));
      for (std::size_t i = 0; i < moves.size(); ++i)
        if (values[Eigen::Index(i)] > next[owner[i]].score)
          next[owner[i]] = {moves[i], values[Eigen::Index(i)], team[owner[i]].reach};
    }
    bool all_stuck = true;
    for (std::size_t c = 0; c < team.size(); ++c) {
      if (!next[c].stuck && next[c].x == team[c].x) {
        next[c].stuck = sampler.finest(team[c].reach);
        next[c].reach *= 0.5;
      }
      for (std::size_t b = 0; b < c; ++b)
        next[c].stuck = next[c].stuck || next[c].x == next[b].x;  // two on one place: one is enough
      all_stuck = all_stuck && next[c].stuck;
    }
    team = std::move(next);
    return !all_stuck;
  }
};

static_assert(CandidateSource<FreshCandidates>);
static_assert(CandidateSource<LocalSearchCandidates>);

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

// ---- lumo/optimize/outliers.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_OUTLIERS_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_OUTLIERS_HPP

namespace lumo {

/// When a value of an objective is an outlier. Ranges are those of the bulk, of all that is none.
struct OutlierRule {
  double worse = 20.0;        ///< ranges between the bulk and a worse value that is an outlier
  double better = 1e6;        ///< and a better one, which may be what is looked for
  std::size_t confirmed = 3;  ///< so many different ones that are better are no outliers
  std::size_t least = 6;      ///< different values below which none is an outlier
  std::size_t early = 8;      ///< different values, at least, among which the bulk begins
  std::size_t few = 3;        ///< so many values may be the bulk, if the others are worse by `penalty` ranges
  double penalty = 1000.0;
};

/// Finds the outliers of an objective: absurd values, of a solver that blew up, and penalties. The bulk begins with the
/// half of the early values that lies closest together, and takes in what lies within some of its ranges; so no single
/// value moves it. Later values, which the search has chosen, crowd around the best one: they extend the bulk, but it
/// does not begin with them.
class ValueBulk {
 public:
  /// `values` in the order of asking, finite, larger is better; the first `starts` of them are spread over the space.
  ValueBulk(const std::vector<double>& values, std::size_t starts, const OutlierRule& rule = {}) {
    std::vector<double> first;
    for (std::size_t i = 0; i < values.size() && (i < starts || first.size() < rule.early); ++i) {
      const auto place = std::lower_bound(first.begin(), first.end(), values[i]);
      if (place == first.end() || *place != values[i]) first.insert(place, values[i]);
    }
    if (first.size() < rule.least) return;
    begin(first, rule);
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    grow(sorted, rule);
    const auto above = std::upper_bound(sorted.begin(), sorted.end(), high_);
    if (std::size_t(sorted.end() - above) >= rule.confirmed) high_ = sorted.back();
    whole_ = sorted.front() >= low_ && sorted.back() <= high_;
  }

  bool whole() const { return whole_; }  ///< no outliers
  bool worse(double y) const { return !whole_ && y < low_; }
  bool better(double y) const { return !whole_ && y > high_; }
  double low() const { return low_; }  ///< ends of the bulk; only where there are outliers
  double high() const { return high_; }

 private:
  void begin(const std::vector<double>& first, const OutlierRule& rule) {
    const std::size_t n = first.size(), half = std::max(rule.least - 2, (n + 1) / 2);
    high_ = first.back();
    for (std::size_t worse = 1; worse + rule.few <= n; ++worse) {
      low_ = first[worse];
      if (low_ - first[worse - 1] > rule.penalty * (high_ - low_)) return;
    }
    const std::size_t closest = closest_together(first, half);
    low_ = first[closest];
    high_ = first[closest + half - 1];
  }
  void grow(const std::vector<double>& sorted, const OutlierRule& rule) {
    auto below = std::lower_bound(sorted.begin(), sorted.end(), low_);
    auto above = std::upper_bound(sorted.begin(), sorted.end(), high_);
    for (bool grown = true; grown;) {
      const double range = high_ - low_;
      grown = false;
      if (below != sorted.begin() && low_ - *(below - 1) <= rule.worse * range) {
        low_ = *--below;
        grown = true;
      }
      if (above != sorted.end() && *above - high_ <= rule.better * range) {
        high_ = *above++;
        grown = true;
      }
    }
  }

  double low_ = 0.0, high_ = 0.0;
  bool whole_ = true;
};

}  // namespace lumo

#endif

// ---- lumo/optimize/trials.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_TRIALS_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_TRIALS_HPP

namespace lumo {

/// The trials of one optimisation: asked, observed and failed ones, and the next design if no model is needed. All that
/// an optimiser knows is here: restoring the trials restores the optimiser.
class Trials {
 public:
  static constexpr double largest_output = 1e150;  ///< squares do not overflow

  /// `outputs`: values per observed trial. Throws as Problem::validate() and DesignSampler.
  Trials(Problem problem, int outputs, int retries)
      : problem_(std::move(problem)), sampler_(problem_.space), outputs_(outputs), retries_(retries) {
    problem_.validate();
    DesignSet known;
    for (const Design& x : problem_.initial)
      if (known.insert(sampler_.canonical(x)).second) starts_.push_back(sampler_.canonical(x));
    for (Design& x : sampler_.fresh(std::size_t(problem_.sobol), combine(problem_.seed, 0), known))
      starts_.push_back(std::move(x));
  }

  const Problem& problem() const { return problem_; }
  const DesignSampler& sampler() const { return sampler_; }
  const std::vector<Trial>& trials() const { return trials_; }
  const DesignSet& taken() const { return taken_; }
  int count(Trial::State state) const {
    return int(std::count_if(trials_.begin(), trials_.end(), [state](const Trial& t) { return t.state == state; }));
  }

  int outputs() const { return outputs_; }
  std::vector<int> observed_ids() const {
    std::vector<int> ids;
    for (const Trial& t : trials_)
      if (t.state == Trial::State::observed) ids.push_back(t.id);
    return ids;
  }
  /// Observed trials before the first that a model chose.
  std::size_t observed_starts() const {
    std::size_t count = 0;
    for (const Trial& t : trials_) {
      if (std::find(starts_.begin(), starts_.end(), t.x) == starts_.end()) break;
      count += t.state == Trial::State::observed;
    }
    return count;
  }

  /// A failed trial that may be retried, else the next start; nullopt if a model has to choose. With restored trials of
  /// another seed, there are as many starts in all as without.
  std::optional<Design> scheduled() const {
    for (const Trial& t : trials_)
      if (t.state == Trial::State::failed && t.retry && !superseded(t) && tries_left(t)) return t.x;
    if (taken_.size() >= starts_.size()) return std::nullopt;
    for (const Design& x : starts_)
      if (!taken_.contains(x)) return x;
    return std::nullopt;
  }
  /// Adds a pending trial. Throws InvalidArgument or InfeasibleDesign if it cannot have been asked.
  const Trial& open(int id, std::type_identity_t<Design> x) {
    if (id != int(trials_.size()))
      throw InvalidArgument(
          message("trial has id ", id, ", must have ", trials_.size(), ", the number of trials before it"));
    problem_.space.check(x);
    x = sampler_.canonical(std::move(x));
    if (taken_.contains(x))
      for (const Trial& t : trials_)
        if (t.x == x && !(t.state == Trial::State::failed && t.retry))
          throw InvalidArgument(message("trial ", id, " repeats the design of trial ", t.id));
    taken_.insert(x);
    trials_.push_back({id, std::move(x), Trial::State::pending, {}, false, {}});
    return trials_.back();
  }
  /// Throw InvalidArgument if the trial is not pending, or the outputs are too few, too many or not finite.
  void tell(int id, std::vector<double> outputs) {
    Trial& trial = pending(id);
    if (int(outputs.size()) != outputs_)
      throw InvalidArgument(message("trial ", id, " has ", outputs.size(), " values, must have ", outputs_));
    for (const double y : outputs)
      if (!(std::abs(y) <= largest_output))
        throw InvalidArgument(message("trial ", id, " has a value of ", y, ", must be a finite number within +-1e150"));
    trial.outputs = std::move(outputs);
    trial.state = Trial::State::observed;
  }
  void fail(int id, bool retry, std::string why) {
    Trial& trial = pending(id);
    trial.state = Trial::State::failed;
    trial.retry = retry;
    trial.why = std::move(why);
  }

  /// Inputs (d × n) of the trials in a state, by id; failed ones only where the failure lay in the design.
  Eigen::MatrixXd designs(Trial::State state) const {
    Eigen::MatrixXd x(Eigen::Index(sampler_.dimensions()), count(state));
    Eigen::Index column = 0;
    for (const Trial& t : trials_)
      if (t.state == state && !(state == Trial::State::failed && t.retry))
        x.col(column++) = Eigen::Map<const Eigen::VectorXd>(t.x.data(), x.rows());
    return x.leftCols(column);
  }
  /// Outputs of the observed trials (outputs × n) by id, in their own units and sense.
  Eigen::MatrixXd observed_outputs() const {
    Eigen::MatrixXd y(outputs_, count(Trial::State::observed));
    Eigen::Index column = 0;
    for (const Trial& t : trials_)
      if (t.state == Trial::State::observed)
        y.col(column++) = Eigen::Map<const Eigen::VectorXd>(t.outputs.data(), outputs_);
    return y;
  }

 private:
  Trial& pending(int id) {
    if (id < 0 || id >= int(trials_.size())) throw InvalidArgument(message("trial ", id, " was never asked"));
    Trial& trial = trials_[std::size_t(id)];
    if (trial.state == Trial::State::observed) throw InvalidArgument(message("trial ", id, " was answered before"));
    if (trial.state == Trial::State::failed) throw InvalidArgument(message("trial ", id, " failed before"));
    return trial;
  }
  /// Is there a later trial of its design?
  bool superseded(const Trial& trial) const {
    return std::any_of(trials_.begin() + trial.id + 1, trials_.end(), [&](const Trial& t) { return t.x == trial.x; });
  }
  bool tries_left(const Trial& trial) const {
    return std::count_if(trials_.begin(), trials_.end(), [&](const Trial& t) { return t.x == trial.x; }) <= retries_;
  }

  Problem problem_;
  DesignSampler sampler_;
  int outputs_, retries_;
  std::vector<Design> starts_;
  std::vector<Trial> trials_;
  DesignSet taken_;
};

}  // namespace lumo

#endif

// ---- lumo/optimize/optimizer.hpp
#ifndef SINGLE_INCLUDE_LUMO_OPTIMIZE_OPTIMIZER_HPP
#define SINGLE_INCLUDE_LUMO_OPTIMIZE_OPTIMIZER_HPP

namespace lumo {

/// Bayesian optimisation by ask and tell: it never calls an objective. First come the problem's initial designs, then
/// Sobol points, then the candidate of highest acquisition under Gaussian processes of the observed trials, given those
/// still pending. Once a trial has failed for a reason of its design, the acquisition is multiplied by the probability
/// of success. Answers may come in any order. Law: a proposal is a function of the problem, the
/// configuration and the trials before it, to the bit; so whoever keeps the trials can restore() them and go on. No
/// design is asked twice, except after a failure that may be retried.
template <CovarianceKernel Kernel = RbfKernel, class AcquisitionPolicy = LogNehvi,
    CandidateSource Source = LocalSearchCandidates, Reduction R = EachOutput>
requires Acquisition<AcquisitionPolicy, std::vector<GaussianProcess<Kernel>>, R>
class Optimizer {
 public:
  struct Config {
    typename GaussianProcess<Kernel>::Config model = {};
    AcquisitionPolicy acquisition = {};
    Source source = {};
    R reduction = {};  ///< outputs → objectives, after those of an objective that is minimised have changed sign
    OutlierRule outliers = {};
    int retries = 2;  ///< of one design after failures that may be retried
  };

  /// Throws InvalidArgument for a problem that cannot be solved, InfeasibleDesign for an initial design outside the
  /// space.
  explicit Optimizer(Problem problem, Config config = {})
      : config_(std::move(config)),
        trials_(problem, config_.reduction.outputs(int(problem.objectives.size())), config_.retries) {}

  /// The next design to evaluate, now pending; nullopt if there is none: status() states why.
  std::optional<Trial> ask() {
    if (observed() + pending() >= problem().evaluations) return std::nullopt;
    auto x = trials_.scheduled();
    if (!x) x = chosen();
    exhausted_ = !x;
    if (!x) return std::nullopt;
    return trials_.open(int(trials().size()), std::move(*x));
  }

  /// Outputs of a pending trial. Throws InvalidArgument if it is not pending, or the outputs are too few, too many or
  /// not finite.
  void tell(int id, std::vector<double> outputs) { trials_.tell(id, std::move(outputs)); }

  /// A pending trial that failed; with `retry` it may be asked again under a new id. Throws InvalidArgument if it is
  /// not pending.
  void fail(int id, bool retry, std::string why) {
    trials_.fail(id, retry, std::move(why));
    exhausted_ = exhausted_ && !retry;
  }

  /// Takes over the next trial of an earlier run, pending; tell() or fail() follow. Throws InvalidArgument or
  /// InfeasibleDesign if it cannot have been asked.
  void restore(int id, Design x) { trials_.open(id, std::move(x)); }

  OptimizerStatus status() const {
    if (observed() >= problem().evaluations) return OptimizerStatus::finished;
    if (observed() + pending() >= problem().evaluations) return OptimizerStatus::waiting;
    if (exhausted_) return pending() > 0 ? OptimizerStatus::waiting : OptimizerStatus::exhausted;
    return OptimizerStatus::running;
  }

  const Problem& problem() const { return trials_.problem(); }
  const std::vector<Trial>& trials() const { return trials_.trials(); }  ///< by id
  int observed() const { return trials_.count(Trial::State::observed); }
  int pending() const { return trials_.count(Trial::State::pending); }

  /// Observed trials that no other dominates, from the best in the first objective on. An outlier counts with its
  /// own value.
  std::vector<Outcome> front() const {
    const std::vector<int> ids = trials_.observed_ids();
    const Eigen::MatrixXd y = objectives();
    std::vector<Outcome> out;
    for (const Eigen::Index i : pareto_front(y)) {
      out.push_back({ids[std::size_t(i)], {}});
      for (Eigen::Index j = 0; j < y.rows(); ++j)
        out.back().objectives.push_back(problem().objectives[std::size_t(j)].signed_value(y(j, i)));
    }
    return out;
  }

  /// A value that lies absurdly far from the others of its objective. The models of values do without its trial; to the
  /// model of success one that is worse than the others is a failure.
  struct Outlier {
    int id = 0, output = 0;
    double value = 0.0;
    bool better = false;
    double low = 0.0, high = 0.0;  ///< between which the others lie
  };
  /// By trial. Whether a value is an outlier may change with those that follow.
  std::vector<Outlier> outliers() const {
    const std::vector<int> ids = trials_.observed_ids();
    const Eigen::MatrixXd outputs = trials_.observed_outputs();
    std::vector<Outlier> out;
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      const std::vector<Eigen::Index> rows = rows_of(j);
      const Eigen::MatrixXd y = objective(j).signed_value(1.0) * outputs(rows, Eigen::all);
      const ValueBulk bulk({y.data(), y.data() + y.size()}, trials_.observed_starts() * rows.size(), config_.outliers);
      for (Eigen::Index i = 0; i < y.cols(); ++i)
        for (Eigen::Index k = 0; k < y.rows(); ++k) {
          if (!bulk.worse(y(k, i)) && !bulk.better(y(k, i))) continue;
          const double first = objective(j).signed_value(bulk.low()), last = objective(j).signed_value(bulk.high());
          out.push_back({ids[std::size_t(i)], int(rows[std::size_t(k)]), objective(j).signed_value(y(k, i)),
              bulk.better(y(k, i)), std::min(first, last), std::max(first, last)});
        }
    }
    std::stable_sort(out.begin(), out.end(), [](const Outlier& a, const Outlier& b) { return a.id < b.id; });
    return out;
  }

  /// Volume that the front dominates above the reference point, in the product of the objectives' units.
  double hypervolume() const {
    Eigen::VectorXd reference(Eigen::Index(problem().objectives.size()));
    for (Eigen::Index j = 0; j < reference.size(); ++j)
      reference[j] = objective(int(j)).signed_value(objective(int(j)).reference);
    return lumo::hypervolume(objectives(), reference);
  }

  /// Models of the observed outputs as they are in evidence(). Empty before two trials are observed.
  const std::vector<GaussianProcess<Kernel>>& models() {
    if (observed() < 2 || modelled_ == observed()) return models_;
    const Evidence e = evidence();
    models_.clear();
    for (Eigen::Index k = 0; k < e.outputs.rows(); ++k)
      models_.push_back(
          GaussianProcess<Kernel>::fit({e.x, e.outputs.row(k).transpose(), e.lower, e.upper}, config_.model));
    modelled_ = observed();
    return models_;
  }

  /// Observed and pending trials as models and acquisition see them: without outliers, outputs less their reference,
  /// larger is better, in units of the spread of their objective.
  Evidence evidence() const {
    Evidence e;
    const std::vector<Eigen::Index> kept = inliers();
    e.x = trials_.designs(Trial::State::observed)(Eigen::all, kept);
    e.pending = trials_.designs(Trial::State::pending);
    e.outputs = trials_.observed_outputs()(Eigen::all, kept);
    for (int j = 0; j < int(problem().objectives.size()); ++j) {
      const std::vector<Eigen::Index> rows = rows_of(j);
      Eigen::ArrayXXd y =
          objective(j).signed_value(1.0) * (e.outputs(rows, Eigen::all).array() - objective(j).reference);
      const double largest = y.size() ? y.abs().maxCoeff() : 0.0;  // so that squares neither overflow nor vanish
      if (largest > 0.0) {
        y /= largest;
        const double spread = std::sqrt((y - y.mean()).square().mean());
        if (spread > 1e-14) y /= spread;
      }
      e.outputs(rows, Eigen::all) = y.matrix();
    }
    const auto& variables = problem().space.variables;
    e.lower.resize(Eigen::Index(variables.size()));
    e.upper.resize(Eigen::Index(variables.size()));
    for (std::size_t i = 0; i < variables.size(); ++i) {
      e.lower[Eigen::Index(i)] = variables[i].lower;
      e.upper[Eigen::Index(i)] = variables[i].upper;
    }
    e.reference = Eigen::VectorXd::Zero(Eigen::Index(problem().objectives.size()));
    return e;
  }

 private:
  const Objective& objective(int j) const { return problem().objectives[std::size_t(j)]; }

  /// Outputs that an objective is made of.
  std::vector<Eigen::Index> rows_of(int j) const {
    std::vector<Eigen::Index> rows;
    for (int k = 0; k < trials_.outputs(); ++k)
      if (config_.reduction.objective(k) == j) rows.push_back(k);
    return rows;
  }
  /// Observed trials without outliers, as columns of the observed ones.
  std::vector<Eigen::Index> inliers() const {
    std::set<int> absurd;
    for (const Outlier& o : outliers()) absurd.insert(o.id);
    const std::vector<int> ids = trials_.observed_ids();
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < ids.size(); ++i)
      if (!absurd.contains(ids[i])) kept.push_back(Eigen::Index(i));
    return kept;
  }

  /// Objectives of the observed trials (objectives × n) in their units, larger is better.
  Eigen::MatrixXd objectives() const {
    Eigen::MatrixXd y = trials_.observed_outputs();
    for (Eigen::Index k = 0; k < y.rows(); ++k)
      y.row(k) *= objective(config_.reduction.objective(int(k))).signed_value(1.0);
    return y.cols() ? Eigen::MatrixXd(config_.reduction.objectives(y))
                    : Eigen::MatrixXd(Eigen::Index(problem().objectives.size()), 0);
  }

  /// Model of the success of evaluations; nullopt if none has failed for a reason of its design, or given a value that
  /// is absurdly bad.
  std::optional<SuccessModel<Kernel>> success(const Evidence& e) const {
    Eigen::MatrixXd failed = trials_.designs(Trial::State::failed);
    std::set<int> absurd;
    for (const Outlier& o : outliers())
      if (!o.better) absurd.insert(o.id);
    for (const int id : absurd) {
      failed.conservativeResize(Eigen::NoChange, failed.cols() + 1);
      failed.rightCols(1) = Eigen::Map<const Eigen::VectorXd>(trials()[std::size_t(id)].x.data(), failed.rows());
    }
    if (failed.cols() == 0) return std::nullopt;
    return SuccessModel<Kernel>(e.x, failed, e.lower, e.upper, config_.model);
  }

  /// The candidate of highest acquisition; a fresh design while there is too little for a model.
  std::optional<Design> chosen() {
    const std::uint64_t key = combine(combine(problem().seed, 1), trials().size());
    if (models().empty()) {
      auto fresh = trials_.sampler().fresh(1, key, trials_.taken());
      return fresh.empty() ? std::nullopt : std::optional(std::move(fresh.front()));
    }
    const std::vector<int> ids = trials_.observed_ids();
    const std::vector<Eigen::Index> kept = inliers();
    std::vector<Design> standing;
    for (const Eigen::Index i : pareto_front(Eigen::MatrixXd(objectives()(Eigen::all, kept))))
      standing.push_back(trials()[std::size_t(ids[std::size_t(kept[std::size_t(i)])])].x);
    const Evidence e = evidence();
    const auto utility = config_.acquisition.prepare(models_, config_.reduction, e, combine(key, 1));
    const CandidateRequest request{trials_.sampler(), trials_.taken(), standing, combine(key, 2)};
    const auto model = success(e);
    if (!model) return config_.source.best(request, utility);
    return config_.source.best(
        request, [&](const Eigen::MatrixXd& x) -> Eigen::VectorXd { return model->expected(utility(x), x); });
  }

  Config config_;
  Trials trials_;
  bool exhausted_ = false;
  std::vector<GaussianProcess<Kernel>> models_;
  int modelled_ = 0;  ///< observed trials that the models know
};

}  // namespace lumo

#endif

// ---- lumo/campaign/journal.hpp
#ifndef SINGLE_INCLUDE_LUMO_CAMPAIGN_JOURNAL_HPP
#define SINGLE_INCLUDE_LUMO_CAMPAIGN_JOURNAL_HPP

namespace lumo {

/// One entry of a campaign's journal. Entries are only ever added. `notes` is what may differ between two runs of the
/// same campaign (times, process numbers); everything else is the same to the last bit.
struct JournalEntry {
  enum class Kind { problem, ask, tell, fail };
  std::int64_t number = 0;  ///< from 0, without gaps
  Kind kind = Kind::problem;
  std::string content;  ///< what a resumed campaign needs of it
  std::string record;   ///< the whole result
  std::string notes;
};

/// The kind as stores write it.
inline std::string to_string(JournalEntry::Kind kind) {
  switch (kind) {
    case JournalEntry::Kind::ask: return "ask";
    case JournalEntry::Kind::tell: return "tell";
    case JournalEntry::Kind::fail: return "fail";
    default: return "problem";
  }
}

/// The kind that a store has written; nullopt if there is no such kind.
inline std::optional<JournalEntry::Kind> journal_kind(std::string_view text) {
  using enum JournalEntry::Kind;
  for (const auto kind : {problem, ask, tell, fail})
    if (to_string(kind) == text) return kind;
  return std::nullopt;
}

/// A journal that cannot be opened, read or written.
class StoreError : public Error {
 public:
  enum class Reason {
    corrupt,    ///< its content is not what was written
    full,       ///< no space left
    busy,       ///< another process holds it for too long
    different,  ///< it belongs to another problem
    unusable    ///< no such folder, no permission, a defect disk, not a store
  };
  StoreError(Reason reason, const std::string& text) : Error(text), reason_(reason) {}
  Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// Where a campaign is kept. Entry 0 is the problem. Laws: what `append` returned is there after any crash; two
/// processes never append at once; `next` sees all entries, without their records, and nothing is added between its
/// look and its entry.
template <class J>
concept Journal = requires(J& journal, const J& view,
    std::function<std::optional<JournalEntry>(const std::vector<JournalEntry>&)> next, std::int64_t number) {
  { view.entries() } -> std::same_as<std::vector<JournalEntry>>;
  { view.record(number) } -> std::same_as<std::string>;
  { journal.append(next) } -> std::same_as<std::optional<JournalEntry>>;
  { journal.claim(number) } -> std::same_as<bool>;
};

/// A journal that lives as long as its process.
class MemoryJournal {
 public:
  explicit MemoryJournal(std::string problem) {
    entries_.push_back({0, JournalEntry::Kind::problem, std::move(problem), "", ""});
  }

  /// All entries, without their records.
  std::vector<JournalEntry> entries() const {
    std::vector<JournalEntry> list = entries_;
    for (JournalEntry& e : list) e.record.clear();
    return list;
  }
  std::string record(std::int64_t number) const { return entries_.at(std::size_t(number)).record; }

  /// Adds the entry that `next` makes of those so far, if any; returns it with its number.
  template <class Next> std::optional<JournalEntry> append(Next&& next) {
    std::optional<JournalEntry> entry = next(entries());
    if (!entry) return std::nullopt;
    entry->number = std::int64_t(entries_.size());
    entries_.push_back(*entry);
    return entry;
  }

  /// May this process work on the trial that the entry announces? Not while another living process does.
  bool claim(std::int64_t) { return true; }

 private:
  std::vector<JournalEntry> entries_;
};

static_assert(Journal<MemoryJournal>);

/// A trial in a journal: "<id> <design>" (ask), "<id> <outputs>" (tell) or "<id> retry|final <why>" (fail).
struct TrialEntry {
  JournalEntry::Kind kind = JournalEntry::Kind::ask;
  int id = 0;
  std::vector<double> values;  ///< the design, or its outputs
  bool retry = false;
  std::string why;
};

inline JournalEntry trial_entry(JournalEntry::Kind kind, int id, const std::vector<double>& values) {
  std::string text = std::to_string(id);
  for (const double v : values) text += ' ' + exact(v);
  return {0, kind, std::move(text), "", ""};
}
inline JournalEntry ask_entry(int id, const std::vector<double>& design) {
  return trial_entry(JournalEntry::Kind::ask, id, design);
}
inline JournalEntry tell_entry(int id, const std::vector<double>& outputs) {
  return trial_entry(JournalEntry::Kind::tell, id, outputs);
}
inline JournalEntry fail_entry(int id, bool retry, const std::string& why) {
  return {0, JournalEntry::Kind::fail, std::to_string(id) + (retry ? " retry " : " final ") + why, "", ""};
}

/// Throws StoreError for an entry that is none of these.
inline TrialEntry parse_trial(const JournalEntry& entry) {
  const auto refuse = [&] {
    throw StoreError(StoreError::Reason::corrupt,
        message("entry ", entry.number, " is no trial: ", to_string(entry.kind), ' ', entry.content));
  };
  std::string_view rest = entry.content;
  const auto read = [&](auto& value) {
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc{} || (end != rest.data() + rest.size() && *end != ' ')) refuse();
    rest.remove_prefix(std::min(rest.size(), std::size_t(end - rest.data()) + 1));
  };
  if (entry.kind == JournalEntry::Kind::problem) refuse();
  TrialEntry t;
  t.kind = entry.kind;
  read(t.id);
  if (t.id < 0) refuse();
  if (entry.kind == JournalEntry::Kind::fail) {
    t.retry = rest.starts_with("retry ");
    if (!t.retry && !rest.starts_with("final ")) refuse();
    t.why = rest.substr(std::string_view("retry ").size());
    return t;
  }
  while (!rest.empty()) read(t.values.emplace_back());
  return t;
}

}  // namespace lumo

#endif

// ---- lumo/campaign/campaign.hpp
#ifndef SINGLE_INCLUDE_LUMO_CAMPAIGN_CAMPAIGN_HPP
#define SINGLE_INCLUDE_LUMO_CAMPAIGN_CAMPAIGN_HPP

namespace lumo {

/// The result of one evaluation.
struct TrialResult {
  std::vector<double> outputs;  ///< empty: it failed
  bool retry = false;           ///< failed for a reason of the machine, not of the design
  std::string why;              ///< stage and scenario of the failure
  std::string record;           ///< the whole result, the same in every run
  std::string notes;            ///< what may differ in another run: times, machine
};

/// More evaluations failed than a campaign can stand.
class CampaignError : public NumericalError {
 public:
  using NumericalError::NumericalError;
};

/// A campaign's journal, read by an optimiser: all trials that were asked, reported and failed so far.
template <class O> class CampaignState {
 public:
  /// `optimizer` knows the problem only.
  explicit CampaignState(O optimizer) : optimizer_(std::move(optimizer)) {}

  /// Takes in the new entries. Throws StoreError for entries that no campaign of this problem wrote.
  void read(const std::vector<JournalEntry>& entries) {
    for (; known_ < entries.size(); ++known_) {
      const JournalEntry& e = entries[known_];
      try {
        const TrialEntry t = parse_trial(e);
        if (t.kind == JournalEntry::Kind::ask) {
          optimizer_.restore(t.id, t.values);
          asked_.push_back(e.number);
          answered_.emplace_back();
          continue;
        }
        if (t.kind == JournalEntry::Kind::tell) optimizer_.tell(t.id, t.values);
        else optimizer_.fail(t.id, t.retry, t.why);
        answered_[std::size_t(t.id)] = e.number;
      } catch (const StoreError&) {
        throw;
      } catch (const Error& error) {
        throw StoreError(
            StoreError::Reason::corrupt, message("entry ", e.number, " does not fit those before it: ", error.what()));
      }
    }
  }
  /// The next trial, as the entry that announces it.
  std::optional<JournalEntry> ask(const std::vector<JournalEntry>& entries) {
    read(entries);
    O next = optimizer_;
    const std::optional<Trial> trial = next.ask();
    if (!trial) {
      optimizer_ = std::move(next);  // knows why there is none
      return std::nullopt;
    }
    return ask_entry(trial->id, trial->x);
  }

  const O& optimizer() const { return optimizer_; }
  /// Number of the entry that announced a trial, and of the one that answered it.
  std::int64_t asked(int id) const { return asked_[std::size_t(id)]; }
  std::optional<std::int64_t> answered(int id) const { return answered_[std::size_t(id)]; }

 private:
  O optimizer_;
  std::size_t known_ = 1;  // entry 0 is the problem
  std::vector<std::int64_t> asked_;
  std::vector<std::optional<std::int64_t>> answered_;
};

/// When a campaign stops because evaluations fail, and how it waits for other processes.
struct CampaignConfig {
  FailureLimit failures;  ///< of all evaluations for their designs, or of this process's own for the machine
  double poll_s = 0.5;    ///< between looks whether another process has ended, or died
};

namespace detail {

/// A trial for this process: one whose worker died, or a new one. `state` has read the journal.
template <Journal J, class O> std::optional<int> take_trial(J& journal, CampaignState<O>& state) {
  const auto claimed = [&](int id) {
    if (!journal.claim(state.asked(id))) return false;
    state.read(journal.entries());  // who had it may have answered and ended since the last look
    return !state.answered(id);
  };
  for (std::size_t k = 0; k < state.optimizer().trials().size(); ++k)
    if (state.optimizer().trials()[k].state == Trial::State::pending && claimed(int(k))) return int(k);
  const auto entry = journal.append([&](const std::vector<JournalEntry>& entries) { return state.ask(entries); });
  if (!entry) return std::nullopt;
  state.read(journal.entries());
  const int id = parse_trial(*entry).id;
  return claimed(id) ? std::optional(id) : take_trial(journal, state);  // another process was faster
}

/// Outputs that the optimiser does not take (too few, too many, not finite) are a failure of the design: as an answer
/// they would end the journal.
template <class O> TrialResult acceptable(O probe, int id, TrialResult result) {
  if (result.outputs.empty()) return result;
  try {
    probe.tell(id, result.outputs);
  } catch (const InvalidArgument& e) {
    result.outputs.clear();
    result.retry = false;
    result.why = message("objective: ", e.what());
  }
  return result;
}

}  // namespace detail

/// Evaluates what the optimiser asks until it has as many results as its problem wants, or no design is left. Continues
/// what the journal holds; several processes may work on one journal. Each entry depends only on those before it: a
/// campaign in one process has the same journal, to the bit, after any number of crashes. `evaluate(design)` gives a
/// TrialResult; `watch(state, id, result)` sees each as it was kept. Throws StoreError and CampaignError.
template <Journal J, class O, class Evaluate, class Watch> OptimizerStatus run_campaign(
    J& journal, const O& optimizer, const Evaluate& evaluate, const Watch& watch, const CampaignConfig& config = {}) {
  CampaignState<O> state(optimizer);
  std::set<int> own;  // trials that this process answered
  while (true) {
    state.read(journal.entries());
    const std::vector<Trial>& trials = state.optimizer().trials();
    for (const FailureTally& tally : {design_failures(trials), machine_failures(trials, own)})
      if (config.failures.exceeded(tally))
        throw CampaignError("campaign stops: " + config.failures.reason(tally, trials));
    const std::optional<int> id = detail::take_trial(journal, state);
    if (!id) {
      if (state.optimizer().status() != OptimizerStatus::waiting) return state.optimizer().status();
      pause_for(config.poll_s);
      continue;
    }
    TrialResult result = evaluate(state.optimizer().trials()[std::size_t(*id)].x);
    const auto answer = journal.append([&](const std::vector<JournalEntry>& entries) -> std::optional<JournalEntry> {
      state.read(entries);
      if (state.answered(*id)) return std::nullopt;
      result = detail::acceptable(state.optimizer(), *id, std::move(result));
      JournalEntry e =
          result.outputs.empty() ? fail_entry(*id, result.retry, result.why) : tell_entry(*id, result.outputs);
      e.record = result.record;
      e.notes = result.notes;
      return e;
    });
    if (!answer) continue;
    own.insert(*id);
    state.read(journal.entries());
    watch(std::as_const(state), *id, std::as_const(result));
  }
}

}  // namespace lumo

#endif

// ---- lumo/campaign/finger_campaign.hpp
#ifndef SINGLE_INCLUDE_LUMO_CAMPAIGN_FINGER_CAMPAIGN_HPP
#define SINGLE_INCLUDE_LUMO_CAMPAIGN_FINGER_CAMPAIGN_HPP

namespace lumo {

/// The paper's search: J_contact and J_obs as large as can be over θ, from the references (the paper has five) and
/// eight Sobol designs. Source: paper §III-D.
inline Problem finger_problem(int evaluations = 160, std::uint64_t seed = 1, const PadDimensions& pad = {},
    const std::vector<FingerDesign>& references = built_references()) {
  Problem p;
  p.space = finger_space(pad);
  p.objectives = {{"J_contact", true, 0.0}, {"J_obs", true, 0.0}};
  for (const FingerDesign& d : references) {
    const auto x = d.values();
    p.initial.emplace_back(x.begin(), x.end());
  }
  p.sobol = 8;  // paper §III-D
  p.evaluations = evaluations;
  p.seed = seed;
  return p;
}

/// Where a scenario presses, in words.
inline std::string contact_words(const ScenarioRecord& s) {
  return message(
      "sphere of ", 1e3 * s.diameter_m, " mm at ", s.angle_rad * 180.0 / pi, " deg, y = ", 1e3 * s.y_m, " mm");
}

/// Why a scenario has no score though it has equilibria.
inline std::string unresolved_contact(const ScenarioRecord& s) {
  const Unresolved& u = *s.unresolved;
  return message("the contact is not resolved at ", u.load_N, " N: radius ", 1e-2 * std::round(1e5 * u.radius_m),
      " mm, edges ", 1e-2 * std::round(1e5 * u.edge_m), " mm, ", contact_words(s));
}

/// The first scenario that failed, and how; empty if all converged, or were held where that is accepted.
inline std::string failed_press(const std::vector<ScenarioRecord>& scenarios, bool accept_held = false) {
  for (const ScenarioRecord& s : scenarios)
    if (s.unresolved && !is_scored(s.status, accept_held)) return "press: " + unresolved_contact(s);
    else if (!is_scored(s.status, accept_held))
      return message("press: ", to_string(s.status), " at ", s.states.back().load_N, " N, ", contact_words(s));
  return "";
}

/// Why an evaluation has no objectives: the stage and the first scenario that failed; empty if it has both.
inline std::string failure_of(const Evaluation& e, bool accept_held = false) {
  if (e.J_contact && e.J_obs) return "";
  if (std::string why = failed_press(e.observations.scenarios, accept_held); !why.empty()) return why;
  return !e.J_contact ? "objective: the loads do not define the terms of J_contact"
                      : "objective: no two states can be compared for J_obs";
}

/// Did the machine's limits end a solve, and not the body?
inline bool is_machine_limit(const std::vector<ScenarioRecord>& scenarios) {
  return std::any_of(
      scenarios.begin(), scenarios.end(), [](const ScenarioRecord& s) { return s.status == Status::time_limit; });
}
/// Did they end a mesh?
inline bool is_machine_limit(const MeshError& e) {
  return e.reason() == MeshError::Reason::timed_out || e.reason() == MeshError::Reason::out_of_memory;
}

/// The part of an evaluation that a campaign keeps. It may try again what the machine ended.
inline TrialResult trial_result(const Evaluation& e, bool accept_held = false) {
  TrialResult result;
  result.why = failure_of(e, accept_held);
  if (result.why.empty()) result.outputs = {e.J_contact->value, e.J_obs->value};
  result.retry = is_machine_limit(e.observations.scenarios);
  return result;
}

/// The same of a mesh that could not be made.
inline TrialResult trial_result(const MeshError& e) {
  TrialResult result;
  result.why = message("mesh: ", e.what());
  result.retry = is_machine_limit(e);
  return result;
}

}  // namespace lumo

#endif

// ---- lumo/objective/selection.hpp
#ifndef SINGLE_INCLUDE_LUMO_OBJECTIVE_SELECTION_HPP
#define SINGLE_INCLUDE_LUMO_OBJECTIVE_SELECTION_HPP

namespace lumo {

/// The design to build: argmax of min(J_contact/max J_contact, J_obs/max J_obs), the first of equals. Pairs (J_contact,
/// J_obs); nullopt without pairs, or if an objective is positive in none. Throws InvalidArgument for one that is not
/// finite. Source: paper §III-D.
inline std::optional<std::size_t> balanced_choice(const std::vector<std::pair<double, double>>& objectives) {
  double contact = 0.0, observation = 0.0;
  for (const auto& [c, o] : objectives) {
    require_finite("J_contact", c, "");
    require_finite("J_obs", o, "");
    contact = std::max(contact, c);
    observation = std::max(observation, o);
  }
  if (!(contact > 0.0 && observation > 0.0)) return std::nullopt;
  std::size_t best = 0;
  const auto score = [&](std::size_t k) {
    return std::min(objectives[k].first / contact, objectives[k].second / observation);
  };
  for (std::size_t k = 1; k < objectives.size(); ++k)
    if (score(k) > score(best)) best = k;
  return best;
}

}  // namespace lumo

#endif

// ---- lumo/study/choice_stability.hpp
#ifndef SINGLE_INCLUDE_LUMO_STUDY_CHOICE_STABILITY_HPP
#define SINGLE_INCLUDE_LUMO_STUDY_CHOICE_STABILITY_HPP

namespace lumo {

/// Searches of one model by different seeds.
struct SeedStudy {
  int seeds = 1;        ///< 1, 2, …
  int evaluations = 1;  ///< of each search
};

/// The choice of a search with each seed, if the objectives were the posterior means of Gaussian processes of the
/// observed trials: how much of the choice is the search's luck. Both objectives are maximised, reference (0, 0).
/// `make_optimizer(problem)` gives a fresh optimiser; `watch()` is called after each search, from any thread. nullopt
/// for a search that found no choice. Throws InvalidArgument for fewer than two observed trials.
template <class MakeOptimizer, Executor E, class Watch>
std::vector<std::optional<Design>> choices_over_seeds(const Problem& problem, const std::vector<Trial>& trials,
    const SeedStudy& study, const MakeOptimizer& make_optimizer, const E& executor, const Watch& watch) {
  std::vector<const Trial*> observed;
  for (const Trial& t : trials)
    if (t.state == Trial::State::observed) observed.push_back(&t);
  if (observed.size() < 2)
    throw InvalidArgument(message("a model of the results needs at least 2 observed trials, has ", observed.size()));

  const auto n = Eigen::Index(observed.size()), d = Eigen::Index(problem.space.variables.size());
  TrainingData data{Eigen::MatrixXd(d, n), Eigen::VectorXd(n), Eigen::VectorXd(d), Eigen::VectorXd(d)};
  for (Eigen::Index i = 0; i < d; ++i) {
    data.lower[i] = problem.space.variables[std::size_t(i)].lower;
    data.upper[i] = problem.space.variables[std::size_t(i)].upper;
  }
  std::vector<GaussianProcess<>> models;
  for (std::size_t k = 0; k < problem.objectives.size(); ++k) {
    for (Eigen::Index j = 0; j < n; ++j) {
      data.x.col(j) = Eigen::Map<const Eigen::VectorXd>(observed[std::size_t(j)]->x.data(), d);
      data.y[j] = observed[std::size_t(j)]->outputs[k];
    }
    models.push_back(GaussianProcess<>::fit(data));
  }

  std::vector<std::optional<Design>> choices(std::size_t(study.seeds), std::nullopt);
  executor.for_each(choices.size(), [&](std::size_t s) {
    Problem searched = problem;
    searched.seed = std::uint64_t(s) + 1;
    searched.evaluations = study.evaluations;
    auto optimizer = make_optimizer(searched);
    std::vector<std::pair<double, double>> found;
    while (const std::optional<Trial> trial = optimizer.ask()) {
      const Eigen::MatrixXd x = Eigen::Map<const Eigen::VectorXd>(trial->x.data(), d);
      found.emplace_back(models[0].mean(x)[0], models[1].mean(x)[0]);
      optimizer.tell(trial->id, {found.back().first, found.back().second});
    }
    if (const auto best = balanced_choice(found)) choices[s] = optimizer.trials()[*best].x;
    watch();
  });
  return choices;
}

}  // namespace lumo

#endif

// ---- lumo/study/matched_study.hpp
#ifndef SINGLE_INCLUDE_LUMO_STUDY_MATCHED_STUDY_HPP
#define SINGLE_INCLUDE_LUMO_STUDY_MATCHED_STUDY_HPP

namespace lumo {

/// A design, or a matched variant of it, under the contacts of a study.
struct VariantResult {
  Twin twin = Twin::none;
  std::string why;  ///< empty: all scenarios converged
  std::optional<Estimate> J_contact;
  std::optional<std::size_t> worst_contact;
  /// D: norm of the response change at the study's load, median over scenarios, per emitted power.
  std::optional<Estimate> change;
  Observations observations;
};

/// Comparisons of a matched study. Source: paper §IV-A.
struct MatchedStudy {
  std::vector<Twin> twins;     ///< each design is compared with these
  bool light = false;          ///< trace light, too
  double change_load_N = 1.0;  ///< at which D is taken
};

/// Contacts at the middle of the finger, along the pad normal, with the smallest and the largest sphere of the paper.
inline Ensemble middle_contacts() {
  Ensemble e;
  e.diameters_m = {10e-3, 30e-3};
  e.places_m = {0.0};
  return e;
}

/// The one contact of the authors' carrier and void study. Source: the first author's public code
/// (dokkev/fingertip-design-framework), validation/contact-physics/multi_design_void_ablation.py.
inline Ensemble authors_study_contact() {
  Ensemble e = authors_flat_ensemble();
  e.diameters_m = {20e-3};
  e.places_m = {-5.5e-3};
  return e;
}

/// Points that a study draws its designs from.
inline constexpr int study_points = 1024;
/// Designs up to which a study is spread evenly: a campaign stops before half of its evaluations have failed, and twice
/// as many points are drawn.
inline constexpr int largest_study = 500;

/// The designs of a study: feasible lattice points spread over `space` (Owen-scrambled Sobol points), as a problem
/// without a search. The points do not depend on `designs`, so a study can go on with more. Throws InvalidArgument for
/// fewer than 1 or more than largest_study.
inline Problem study_problem(const DesignSpace& space, int designs, std::uint64_t seed) {
  if (designs < 1 || designs > largest_study)
    throw InvalidArgument(
        message("number of designs of a study is ", designs, ", must lie in [1, ", largest_study, "]"));
  Problem p;
  p.space = space;
  p.objectives = {{"J_contact", true, 0.0}};
  p.sobol = study_points;
  p.evaluations = designs;
  p.seed = seed;
  return p;
}

/// Median over scenarios of the norm of the response change at one load; nullopt if a scenario has none.
inline std::optional<Estimate> median_change(
    const std::vector<ScenarioRecord>& scenarios, double load_N, const OpticalError& error) {
  std::vector<Estimate> norms;
  for (const ScenarioRecord& s : scenarios) {
    const std::vector<ObservedState> lit = observed_states(s, 0);
    const auto state = std::find_if(lit.begin(), lit.end(), [&](const ObservedState& k) { return k.load_N == load_N; });
    if (state == lit.end()) return std::nullopt;
    const Estimate d =
        response_distance(state->change, Eigen::MatrixXd::Zero(state->change.rows(), state->change.cols()));
    norms.push_back({d.value, std::hypot(2.0 * d.error, error.of(*state))});
  }
  if (norms.empty()) return std::nullopt;
  std::sort(norms.begin(), norms.end(), [](const Estimate& a, const Estimate& b) { return a.value < b.value; });
  const Estimate &low = norms[(norms.size() - 1) / 2], &high = norms[norms.size() / 2];
  return Estimate{
      0.5 * (low.value + high.value), 0.5 * (low.error + high.error)};  // errors of the mesh are alike in all scenarios
}

namespace detail {

template <class P, Executor E> VariantResult evaluate_variant(const Finger& wanted, const Ensemble& ensemble,
    const MatchedStudy& study, const P& pipeline, const E& executor, const ProgressReport& progress) {
  Body body = finger(wanted.design, wanted.silicone, wanted.options);
  if (!study.light) body.regions = 0;
  VariantResult result;
  result.twin = wanted.options.twin;
  try {
    result.observations = observe(body, ensemble.scenarios(), pipeline, executor, progress);
  } catch (const MeshError& e) {
    if (is_machine_limit(e)) throw;
    result.why = message("mesh: ", e.what());
    return result;
  }
  const auto& scenarios = result.observations.scenarios;
  result.why = failed_press(scenarios, pipeline.accept_held);
  if (!result.why.empty()) return result;
  if (const auto worst = contact_progression(scenarios)) {
    result.J_contact = worst->first;
    result.worst_contact = worst->second;
  }
  if (body.regions > 0) result.change = median_change(scenarios, study.change_load_N, pipeline.optical_error);
  return result;
}

}  // namespace detail

/// The design itself, then its variants, in the order of `study.twins`. A failure in one leaves the others whole.
/// Throws InfeasibleDesign, and MeshError if the machine's limits ended a mesh: another try may have them all.
template <class P, Executor E> std::vector<VariantResult> compare_variants(Finger design, const Ensemble& ensemble,
    const MatchedStudy& study, const P& pipeline, const E& executor, const ProgressReport& progress = {}) {
  std::vector<Twin> twins = {Twin::none};
  twins.insert(twins.end(), study.twins.begin(), study.twins.end());
  std::vector<VariantResult> results;
  for (const Twin twin : twins) {
    design.options.twin = twin;
    results.push_back(detail::evaluate_variant(design, ensemble, study, pipeline, executor, progress));
  }
  return results;
}

}  // namespace lumo

#endif

// ---- lumo/study/paired_differences.hpp
#ifndef SINGLE_INCLUDE_LUMO_STUDY_PAIRED_DIFFERENCES_HPP
#define SINGLE_INCLUDE_LUMO_STUDY_PAIRED_DIFFERENCES_HPP

namespace lumo {

/// A design less its variant. The errors of both are taken as independent.
inline Estimate paired_difference(const Estimate& design, const Estimate& variant) {
  return {design.value - variant.value, std::hypot(design.error, variant.error)};
}

/// Differences of many designs in a few numbers.
struct PairedSummary {
  std::size_t positive = 0, negative = 0;  ///< signs that count: |difference| above twice its error
  std::size_t undecided = 0;
  std::size_t above_zero = 0;  ///< differences > 0, whatever their error
  double median = 0.0;
  /// Distribution-free interval of the median, between order statistics: the narrowest to which the binomial law gives
  /// at least 95 %; nullopt below six differences, as not even the extremes reach that then. Source: Conover, Practical
  /// Nonparametric Statistics, §3.2.
  std::optional<std::pair<double, double>> median_95;

  std::size_t count() const { return positive + negative + undecided; }
};

/// nullopt without differences.
inline std::optional<PairedSummary> summarize(const std::vector<Estimate>& differences) {
  if (differences.empty()) return std::nullopt;
  PairedSummary s;
  std::vector<double> sorted;
  for (const Estimate& d : differences) {
    if (std::abs(d.value) <= 2.0 * d.error) ++s.undecided;
    else ++(d.value > 0.0 ? s.positive : s.negative);
    s.above_zero += d.value > 0.0;
    sorted.push_back(d.value);
  }
  std::sort(sorted.begin(), sorted.end());
  const std::size_t n = sorted.size();
  s.median = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
  double term = std::pow(0.5, double(n)), outside = 0.0;  // P(exactly k of n below the median), and up to there
  for (std::size_t k = 0; k < n / 2; ++k) {
    outside += term;
    if (outside > 0.025) break;
    s.median_95 = std::pair(sorted[k], sorted[n - 1 - k]);
    term *= double(n - k) / double(k + 1);
  }
  return s;
}

/// Kendall's τ-b of two rankings of the same things: pairs in the same order less pairs in the opposite one, over the
/// geometric mean of the pairs that either ranking distinguishes; 1 for the same ranking, ties included. nullopt if one
/// of them ties all. Source: Kendall, Biometrika 33 (1945).
inline std::optional<double> kendall_tau(std::span<const double> a, std::span<const double> b) {
  const std::size_t n = a.size();
  if (b.size() != n) return std::nullopt;
  long agreed = 0, apart_a = 0, apart_b = 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) {
      const int order_a = (a[i] > a[j]) - (a[i] < a[j]), order_b = (b[i] > b[j]) - (b[i] < b[j]);
      agreed += order_a * order_b;
      apart_a += order_a != 0;
      apart_b += order_b != 0;
    }
  if (apart_a == 0 || apart_b == 0) return std::nullopt;
  return double(agreed) / std::sqrt(double(apart_a) * double(apart_b));
}

}  // namespace lumo

#endif

// ---- lumo/lumo.hpp
#ifndef SINGLE_INCLUDE_LUMO_LUMO_HPP
#define SINGLE_INCLUDE_LUMO_LUMO_HPP

// The design chain and its optimisation, in the order in which data flows: section → mesh → contact → light →
// objectives → search. Needs Eigen only. Foreign libraries enter through lumo/support/.

#endif
