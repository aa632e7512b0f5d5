#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

// `template <class = void>` stands before functions that need no template parameter. A compiler instantiates whatever an inline function uses, called
// or not, and Eigen's expressions made up 98 % of what it cost to include lumo; the body of a function template waits for its first call. So a
// function that computes with matrices, or calls one that does, carries this line. benchmarks/parse_cost measures, tests/repository/check_cost.py guards it.

namespace lumo {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
/// Derivative of a 3 × 3 tensor by another, both flattened column by column: row i + 3 j, column k + 3 l.
using Mat9 = Eigen::Matrix<double, 9, 9>;

/// Planes of mirror symmetry of a body. `x` is the plane x = 0, `y` the plane y = 0.
struct Symmetry {
  bool x = false;
  bool y = false;
  bool operator==(const Symmetry&) const = default;
};

}  // namespace lumo
