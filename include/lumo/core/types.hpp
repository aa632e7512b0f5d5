#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

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
