#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <concepts>
#include <type_traits>

// What it costs to include lumo. A compiler instantiates whatever an inline function uses, called or not, and Eigen's expressions made up nearly all of
// the cost. The body of a function template waits for its first call, so a function that computes with matrices, or calls one that does, is one:
// `template <class = void>`. Even there the types of expressions are made at once if they do not depend on a parameter. Hence
// `template <class Mat3 = Mat3>`: under their own names the matrix types are parameters, which nobody passes, and nothing is made before the call.
// Arguments then convert by `In`. What holds of Eigen's expressions holds of the constexpr members of std::vector and std::optional, of all of which a
// compiler makes a copy for each type of element; so records are parameters, too: `template <class Segment = Segment>`. Where nearly all of a class computes,
// it is a template as a whole, `BayesLocalizerOf<>`, and the name that users write is an alias of it: what is declared inside of it waits of itself.
// benchmarks/parse_cost measures it, tests/repository/check_cost.py guards it.

namespace lumo {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
/// Derivative of a 3 × 3 tensor by another, both flattened column by column: row i + 3 j, column k + 3 l.
using Mat9 = Eigen::Matrix<double, 9, 9>;

/// An argument of such a function. Nothing is deduced from it, so it converts as a plain parameter's does.
template <class T>
using In = const std::type_identity_t<T>&;

/// `Type`, of which the compiler knows no more than that it depends on `Parameter`: the same for all members of a class template.
template <class Type, class Parameter>
using Dependent = std::conditional_t<true, Type, Parameter>;

// Sums and products of small matrices are made at once, in place of Eigen's expressions, whose types a compiler makes anew for every formula; and their
// sums have one order, whatever the processor's vectors. What is no plain matrix – a block, a column, a product with a transpose – goes to Eigen's own operators as ever.

template <class T>
concept SmallMatrix = std::same_as<T, Vec3> || std::same_as<T, Mat3> || std::same_as<T, Mat9>;

template <class T>
concept Factor = std::is_arithmetic_v<T>;

template <SmallMatrix T>
T operator+(const T& a, const T& b) {
  T sum;
  for (int k = 0; k < T::SizeAtCompileTime; ++k) sum.data()[k] = a.data()[k] + b.data()[k];
  return sum;
}

template <SmallMatrix T>
T operator-(const T& a, const T& b) {
  T difference;
  for (int k = 0; k < T::SizeAtCompileTime; ++k) difference.data()[k] = a.data()[k] - b.data()[k];
  return difference;
}

template <SmallMatrix T>
T operator-(const T& a) {
  T opposite;
  for (int k = 0; k < T::SizeAtCompileTime; ++k) opposite.data()[k] = -a.data()[k];
  return opposite;
}

template <SmallMatrix T, Factor F>
T operator*(const T& a, F factor) {
  T product;
  for (int k = 0; k < T::SizeAtCompileTime; ++k) product.data()[k] = a.data()[k] * static_cast<double>(factor);
  return product;
}

template <SmallMatrix T, Factor F>
T operator*(F factor, const T& a) {
  return a * factor;
}

template <SmallMatrix T, Factor F>
T operator/(const T& a, F divisor) {
  T quotient;
  for (int k = 0; k < T::SizeAtCompileTime; ++k) quotient.data()[k] = a.data()[k] / static_cast<double>(divisor);
  return quotient;
}

template <std::same_as<Mat3> A, SmallMatrix B>
  requires(B::RowsAtCompileTime == 3)
B operator*(const A& a, const B& b) {
  B product;
  for (int j = 0; j < B::ColsAtCompileTime; ++j)
    for (int i = 0; i < 3; ++i) product.data()[i + 3 * j] = a.data()[i] * b.data()[3 * j] + a.data()[i + 3] * b.data()[1 + 3 * j] + a.data()[i + 6] * b.data()[2 + 3 * j];
  return product;
}

template <class = void>
inline Vec3 elementwise_min(const Vec3& a, const Vec3& b) {
  return {std::min(a.x(), b.x()), std::min(a.y(), b.y()), std::min(a.z(), b.z())};
}
template <class = void>
inline Vec3 elementwise_max(const Vec3& a, const Vec3& b) {
  return {std::max(a.x(), b.x()), std::max(a.y(), b.y()), std::max(a.z(), b.z())};
}

/// a bᵀ.
template <std::same_as<Vec3> A, class B>
  requires std::same_as<std::remove_const_t<B>, Vec3>
Mat3 operator*(const A& a, const Eigen::Transpose<B>& b) {
  Mat3 dyad;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) dyad.data()[i + 3 * j] = a.data()[i] * b.nestedExpression().data()[j];
  return dyad;
}

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo
