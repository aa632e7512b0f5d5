#pragma once

#include "lumo/core/types.hpp"

#include <cmath>
#include <compare>

namespace lumo::test {

/// A number with its derivative by one variable: forward-mode differentiation, exact to rounding (Griewank and Walther
/// 2008, §3.1).
struct Dual {
  double value = 0.0;
  double slope = 0.0;

  Dual() = default;
  Dual(double v, double by_variable = 0.0) : value(v), slope(by_variable) {}

  friend Dual operator+(const Dual& a, const Dual& b) { return {a.value + b.value, a.slope + b.slope}; }
  friend Dual operator-(const Dual& a, const Dual& b) { return {a.value - b.value, a.slope - b.slope}; }
  friend Dual operator*(const Dual& a, const Dual& b) {
    return {a.value * b.value, a.slope * b.value + a.value * b.slope};
  }
  friend Dual operator/(const Dual& a, const Dual& b) {
    return {a.value / b.value, (a.slope - a.value / b.value * b.slope) / b.value};
  }
  friend Dual operator-(const Dual& a) { return {-a.value, -a.slope}; }
  Dual& operator+=(const Dual& b) { return *this = *this + b; }
  Dual& operator-=(const Dual& b) { return *this = *this - b; }
  Dual& operator*=(const Dual& b) { return *this = *this * b; }
  Dual& operator/=(const Dual& b) { return *this = *this / b; }
  friend bool operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
  friend std::partial_ordering operator<=>(const Dual& a, const Dual& b) { return a.value <=> b.value; }

  friend Dual abs(const Dual& a) { return a.value < 0.0 ? -a : a; }
  friend Dual exp(const Dual& a) { return {std::exp(a.value), std::exp(a.value) * a.slope}; }
  friend Dual expm1(const Dual& a) { return {std::expm1(a.value), std::exp(a.value) * a.slope}; }
  friend Dual log(const Dual& a) { return {std::log(a.value), a.slope / a.value}; }
  friend Dual pow(const Dual& a, double n) { return {std::pow(a.value, n), n * std::pow(a.value, n - 1.0) * a.slope}; }
  friend Dual sqrt(const Dual& a) { return {std::sqrt(a.value), 0.5 / std::sqrt(a.value) * a.slope}; }
  friend Dual hypot(const Dual& a, const Dual& b) { return sqrt(a * a + b * b); }
};

/// A matrix whose number `k`, column by column, is the variable.
template <int Rows, int Columns>
SmallMatrix<Dual, Rows, Columns> by_entry(const SmallMatrix<double, Rows, Columns>& m, int k) {
  SmallMatrix<Dual, Rows, Columns> dual;
  for (int i = 0; i < Rows * Columns; ++i) dual.data()[i] = Dual(m.data()[i], i == k ? 1.0 : 0.0);
  return dual;
}

}  // namespace lumo::test

template <> struct Eigen::NumTraits<lumo::test::Dual> : Eigen::NumTraits<double> {
  using Real = lumo::test::Dual;
  using NonInteger = lumo::test::Dual;
  using Nested = lumo::test::Dual;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 2,
    AddCost = 2,
    MulCost = 6
  };
};
