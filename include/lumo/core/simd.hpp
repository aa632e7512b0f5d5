#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace lumo {

/// Eight numbers that go through the same arithmetic at once: one AVX-512 register, or as many smaller ones as the
/// processor needs.
struct Lanes {
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
  /// number. (Between functions go Lanes, not registers: how a bare register is handed over depends on the processor
  /// compiled for.)
  static std::array<Lanes, 3> gathered(const std::vector<Point>& points, const std::array<int, width>& index) {
    const auto two = [&](std::size_t lane) {
      return Lanes{__builtin_shufflevector(points[std::size_t(index[lane])].v, points[std::size_t(index[lane + 4])].v,
                                           0, 1, 2, 3, 4, 5, 6, 7)};
    };
    const Lanes p04 = two(0), p15 = two(1), p26 = two(2), p37 = two(3);
    const auto even = [](const Lanes& a, const Lanes& b) {
      return Lanes{__builtin_shufflevector(a.v, b.v, 0, 8, 2, 10, 4, 12, 6, 14)};
    };
    const auto odd = [](const Lanes& a, const Lanes& b) {
      return Lanes{__builtin_shufflevector(a.v, b.v, 1, 9, 3, 11, 5, 13, 7, 15)};
    };
    const Lanes xz_low = even(p04, p15), xz_high = even(p26, p37), y_low = odd(p04, p15), y_high = odd(p26, p37);
    return {Lanes{__builtin_shufflevector(xz_low.v, xz_high.v, 0, 1, 8, 9, 4, 5, 12, 13)},
            Lanes{__builtin_shufflevector(y_low.v, y_high.v, 0, 1, 8, 9, 4, 5, 12, 13)},
            Lanes{__builtin_shufflevector(xz_low.v, xz_high.v, 2, 3, 10, 11, 6, 7, 14, 15)}};
  }
  static Lanes of(double value) { return {Register{value, value, value, value, value, value, value, value}}; }

  Lanes& operator+=(const Lanes& b) {
    v += b.v;
    return *this;
  }
  Lanes& operator-=(const Lanes& b) {
    v -= b.v;
    return *this;
  }
};

inline Lanes operator+(const Lanes& a, const Lanes& b) { return {a.v + b.v}; }
inline Lanes operator-(const Lanes& a, const Lanes& b) { return {a.v - b.v}; }
inline Lanes operator*(const Lanes& a, const Lanes& b) { return {a.v * b.v}; }
inline Lanes operator/(const Lanes& a, const Lanes& b) { return {a.v / b.v}; }
inline Lanes operator-(const Lanes& a) { return {-a.v}; }
inline Lanes operator+(double a, const Lanes& b) { return Lanes::of(a) + b; }
inline Lanes operator-(double a, const Lanes& b) { return Lanes::of(a) - b; }
inline Lanes operator*(double a, const Lanes& b) { return Lanes::of(a) * b; }
inline Lanes operator+(const Lanes& a, double b) { return a + Lanes::of(b); }
inline Lanes operator-(const Lanes& a, double b) { return a - Lanes::of(b); }

inline Lanes log(const Lanes& a) {
  Lanes l;
  for (std::size_t lane = 0; lane < Lanes::width; ++lane) l.set(lane, std::log(a[lane]));
  return l;
}

}  // namespace lumo
