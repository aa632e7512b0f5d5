#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <type_traits>

// What it costs to include lumo. A compiler instantiates whatever an inline function uses, called or not, and Eigen's expressions made up nearly all of
// the cost. The body of a function template waits for its first call, so a function that computes with matrices, or calls one that does, is one:
// `template <class = void>`. Even there the types of expressions are made at once if they do not depend on a parameter. Hence
// `template <class Mat3 = Mat3>`: under their own names the matrix types are parameters, which nobody passes, and nothing is made before the call.
// Arguments then convert by `In`. benchmarks/parse_cost measures it, tests/repository/check_cost.py guards it.

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

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo
