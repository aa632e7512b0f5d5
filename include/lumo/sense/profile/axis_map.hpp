#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace lumo::sense {

/// Map from a straight line on the finger (its LEDs) to the image: u pixels from `origin_px` along `direction` lies the
/// finger coordinate y = (a + b s)/(1 + c s), s = u/half_length_px; c is the perspective's. Holds the covariance of
/// (a, b, c) from the fit.
struct AxisMap {
  Eigen::Vector2d origin_px{0.0, 0.0};  ///< pixel centres lie on whole numbers
  Eigen::Vector2d direction{1.0, 0.0};  ///< unit, towards the finger's tip (+y)
  double half_length_px = 1.0;
  Eigen::Vector3d coefficients{0.0, 1.0, 0.0};  ///< a [m], b [m], c
  Eigen::Matrix3d covariance{{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
  double centroid_sigma_px = 0.0;  ///< assumed or found, whichever is larger
  double residual_px = 0.0;        ///< RMS of the fit

  double u_px(const Eigen::Vector2d& pixel) const { return finite((pixel - origin_px).dot(direction)); }
  /// This and all below throw InvalidArgument for NaN and beyond the line's ends, where the map is not finite.
  double y_m(double u) const {
    const double s = u / half_length_px;
    return finite((coefficients[0] + coefficients[1] * s) / (1.0 + coefficients[2] * s));
  }
  /// Inverse of y_m; infinite at the horizon.
  double u_px(double y) const {
    return half_length_px * (finite(y) - coefficients[0]) / (coefficients[1] - coefficients[2] * y);
  }
  /// dy/du [m/px].
  double scale_m_per_px(double u) const {
    const double w = 1.0 + coefficients[2] * u / half_length_px;
    return finite((coefficients[1] - coefficients[0] * coefficients[2]) / (half_length_px * w * w));
  }
  /// Variance of y at u [m²] that comes from the map itself.
  double variance_m2(double u) const {
    const Eigen::Vector3d g = gradient(u);
    return finite(g.dot(covariance * g));
  }
  /// ∂y/∂(a, b, c).
  Eigen::Vector3d gradient(double u) const {
    const double s = u / half_length_px, w = 1.0 + coefficients[2] * s;
    return {1.0 / w, s / w, -s * (coefficients[0] + coefficients[1] * s) / (w * w)};
  }

  /// Fit to places in the image (2 × n, ascending in y) of known finger coordinates, by least squares in pixels. Three
  /// places fix the map, more give a residual. `sigma_px`: assumed standard deviation of a centroid. Throws
  /// InvalidArgument for fewer than three, wrong order or numbers that are not finite.
  static AxisMap fit(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px = 0.3);

 private:
  static double finite(double value) {
    require_finite("place on an axis map", value, "");
    return value;
  }
  static constexpr double max_perspective = 0.5;  ///< of |c|: beyond, the line's end lies near the camera
  static constexpr int most_steps = 20;           ///< of Gauss–Newton
  static constexpr double least_step = 1e-14;     ///< [m]: rounding

  static void require_places(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px);
};

inline void AxisMap::require_places(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px) {
  const Eigen::Index n = y_m.size();
  if (n < 3 || pixel.cols() != n)
    throw InvalidArgument(
        message("axis map has ", pixel.cols(), " places and ", n, " coordinates, must have at least 3 of each"));
  if (!pixel.allFinite() || !y_m.allFinite()) throw InvalidArgument("axis map: places and coordinates must be finite");
  require_positive("centroid error", sigma_px, "px");
  for (Eigen::Index i = 1; i < n; ++i)
    if (!(y_m[i] > y_m[i - 1]))
      throw InvalidArgument(
          message("axis map: coordinate ", i, " is ", y_m[i], " m, must exceed its predecessor, ", y_m[i - 1], " m"));
}

inline AxisMap AxisMap::fit(const Eigen::Matrix2Xd& pixel, const Eigen::VectorXd& y_m, double sigma_px) {
  require_places(pixel, y_m, sigma_px);
  const Eigen::Index n = y_m.size();
  AxisMap map;
  map.origin_px = pixel.rowwise().mean();
  const Eigen::Matrix2Xd centred = pixel.colwise() - map.origin_px;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread;
  spread.computeDirect(centred * centred.transpose());
  map.direction = spread.eigenvectors().col(1);
  if (map.direction.dot(pixel.col(n - 1) - pixel.col(0)) < 0.0) map.direction = -map.direction;
  const Eigen::VectorXd u = centred.transpose() * map.direction;
  for (Eigen::Index i = 1; i < n; ++i)
    if (!(u[i] > u[i - 1]))
      throw InvalidArgument(message("axis map: place ", i, " does not follow its predecessor in the image"));
  map.half_length_px = 0.5 * (u[n - 1] - u[0]);

  // Gauss–Newton on u − u(y) ≈ (y(u) − y)/y'(u); the start is the affine map through the ends.
  const double b = 0.5 * (y_m[n - 1] - y_m[0]);
  map.coefficients = {y_m[0] - b * u[0] / map.half_length_px, b, 0.0};
  Eigen::MatrixX3d J(n, 3);
  Eigen::Matrix3d normal;
  Eigen::VectorXd r(n);
  const auto linearise = [&] {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double slope = map.scale_m_per_px(u[i]);
      r[i] = (map.y_m(u[i]) - y_m[i]) / slope;
      J.row(i) = map.gradient(u[i]).transpose() / slope;
    }
    normal = J.transpose() * J;
  };
  for (int k = 0; k < most_steps; ++k) {
    linearise();
    Eigen::Vector3d step = normal.ldlt().solve(Eigen::Vector3d(J.transpose() * r));
    const double c = std::clamp(map.coefficients[2] - step[2], -max_perspective, max_perspective);
    if (c != map.coefficients[2] - step[2]) {  // a and b then fit best with c at its limit
      step[2] = map.coefficients[2] - c;
      map.coefficients[2] = c;
      linearise();
      step.head<2>() = Eigen::Matrix2d(normal.topLeftCorner<2, 2>()).inverse() * (J.leftCols<2>().transpose() * r);
      map.coefficients.head<2>() -= step.head<2>();
    } else {
      map.coefficients -= step;
    }
    if (step.norm() < least_step) break;
  }
  linearise();
  map.residual_px = std::sqrt(r.squaredNorm() / double(n));
  map.centroid_sigma_px = std::max(sigma_px, n > 3 ? std::sqrt(r.squaredNorm() / double(n - 3)) : 0.0);
  map.covariance = map.centroid_sigma_px * map.centroid_sigma_px * normal.inverse();
  return map;
}

}  // namespace lumo::sense
