#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace lumo {

/// Eight numbers that go through the same arithmetic at once: one AVX-512 register, or as many smaller ones as the
/// processor needs.
struct SimdPack {
  static constexpr std::size_t width = 8;
  typedef double Register __attribute__((vector_size(64)));
  Register v = {};

  /// A point, padded so that one load takes it.
  struct Point {
    typedef double Register __attribute__((vector_size(32)));
    Register v = {};
  };

  double operator[](std::size_t lane) const { return v[lane]; }
  void set(std::size_t lane, double value) { v[lane] = value; }
  /// x, y and z of points[index[lane]]: whole points are read and turned, which takes less than reading number by
  /// number. (Between functions go SimdPack, not registers: how a bare register is handed over depends on the processor
  /// compiled for.)
  static std::array<SimdPack, 3> gathered(const std::vector<Point>& points, const std::array<int, width>& index) {
    const auto two = [&](std::size_t lane) {
      return SimdPack{__builtin_shufflevector(points[std::size_t(index[lane])].v, points[std::size_t(index[lane + 4])].v,
                                           0, 1, 2, 3, 4, 5, 6, 7)};
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
  static SimdPack of(double value) { return {Register{value, value, value, value, value, value, value, value}}; }

  SimdPack& operator+=(const SimdPack& b) {
    v += b.v;
    return *this;
  }
  SimdPack& operator-=(const SimdPack& b) {
    v -= b.v;
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

}  // namespace lumo
