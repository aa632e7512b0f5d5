#pragma once

// Exact signs of orientation determinants. A rounded value with an error bound decides nearly always; what is too close
// to call is computed without error as an unevaluated sum of doubles of falling size. Own code: exact predicates of
// libraries come with CGAL or as C that sets the processor's rounding. Source: Shewchuk 1997, Adaptive
// precision floating-point arithmetic and fast robust geometric predicates; his error bounds, his expansions, without
// his intermediate stages. Needs IEEE doubles rounded to nearest (no -ffast-math); exact as long as nothing overflows
// or underflows (lengths 1e-60 … 1e60).

#include "lumo/core/types.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

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
