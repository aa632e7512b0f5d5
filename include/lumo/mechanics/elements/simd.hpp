#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

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
