#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <concepts>
#include <type_traits>

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
