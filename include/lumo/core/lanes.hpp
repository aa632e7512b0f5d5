#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace lumo {

/// Eight numbers that go through the same arithmetic at once: one AVX-512 register, or as many smaller ones as the processor needs.
struct Lanes {
  static constexpr std::size_t width = 8;
  typedef double Register __attribute__((vector_size(64)));
  Register v = {};

  double operator[](std::size_t lane) const { return v[lane]; }
  void set(std::size_t lane, double value) { v[lane] = value; }
  /// values[index[lane]] in each lane.
  static Lanes gathered(const double* values, const std::array<int, width>& index) {
    const auto at = [&](std::size_t lane) { return values[index[lane]]; };
    return {Register{at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)}};
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
