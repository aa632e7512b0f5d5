#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace lumo {

/// Where a bounded minimisation ended.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0.0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;  ///< as the search has learnt it
  int evaluations = 0;
  bool converged = false;  ///< projected gradient or progress below tolerance
};

/// Minimises a smooth function of a few variables between bounds: BFGS on the variables that are free to move, with
/// projected line searches. Source: Bertsekas, "Projected Newton methods for optimization problems with simple
/// constraints", SIAM J. Control Optim. 20 (1982); damped updates after Powell, 1978.
struct QuasiNewton {
  int max_evaluations = 200;
  double gradient_tolerance = 1e-6;  ///< largest entry of the projected gradient
  double value_tolerance = 1e-9;     ///< relative decrease in one step
  double longest_step = 2.0;         ///< largest change of one variable in one step

  /// `function(x, gradient)` returns the value and fills the gradient; where it is not finite the search steps back.
  /// `start` is moved between the bounds; `hessian`, positive definite, from the search for a like minimum saves steps.
  /// Throws InvalidArgument when sizes differ or the value at the start is not finite.
  template <class Function>
  Minimum minimize(Function&& function, std::type_identity_t<Eigen::VectorXd> start, const Eigen::VectorXd& lower,
                   const Eigen::VectorXd& upper, const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const;
};

template <class Function>
Minimum QuasiNewton::minimize(Function&& function, std::type_identity_t<Eigen::VectorXd> start,
                              const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                              const std::optional<Eigen::MatrixXd>& known) const {
  const Eigen::Index n = start.size();
  if (lower.size() != n || upper.size() != n)
    throw InvalidArgument(
        message("minimiser has ", n, " variables but ", lower.size(), " lower and ", upper.size(), " upper bounds"));
  Minimum best;
  best.x = start.cwiseMax(lower).cwiseMin(upper);
  best.gradient.resize(n);
  best.value = function(best.x, best.gradient);
  best.evaluations = 1;
  if (!std::isfinite(best.value) || !best.gradient.allFinite())
    throw InvalidArgument(message("function is ", best.value, " where the minimiser starts, must be finite"));

  Eigen::MatrixXd hessian = known.value_or(Eigen::MatrixXd::Identity(n, n));
  bool fresh = !known;  // the Hessian has seen no curvature yet
  Eigen::VectorXd step(n), trial(n), slope(n);
  while (best.evaluations < max_evaluations) {
    // A variable at a bound that the gradient pushes it against stays there.
    std::vector<Eigen::Index> free;
    double steepest = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      if ((best.x[i] <= lower[i] && best.gradient[i] >= 0.0) || (best.x[i] >= upper[i] && best.gradient[i] <= 0.0))
        continue;
      free.push_back(i);
      steepest = std::max(steepest, std::abs(best.gradient[i]));
    }
    if (steepest <= gradient_tolerance) {
      best.converged = true;
      break;
    }
    step.setZero();
    const Eigen::MatrixXd block = hessian(free, free);
    step(free) = -block.llt().solve(Eigen::VectorXd(best.gradient(free)));
    if (!step.allFinite() || step.dot(best.gradient) >= 0.0) {
      hessian.setIdentity();
      fresh = true;
      step.setZero();
      step(free) = -Eigen::VectorXd(best.gradient(free));
    }
    const double longest = step.cwiseAbs().maxCoeff();
    double scale = std::min({1.0, longest_step / longest, fresh ? 0.5 / longest : 1.0});

    bool moved = false;
    double value = best.value;
    for (; scale * longest > 1e-12 && best.evaluations < max_evaluations; scale *= 0.3) {
      trial = (best.x + scale * step).cwiseMax(lower).cwiseMin(upper);
      value = function(trial, slope);
      ++best.evaluations;
      if (std::isfinite(value) && slope.allFinite() && value <= best.value + 1e-4 * best.gradient.dot(trial - best.x) &&
          value < best.value) {
        moved = true;
        break;
      }
    }
    if (!moved) {
      best.converged = best.evaluations < max_evaluations;  // no descent left that rounding would let through
      if (fresh) break;
      hessian.setIdentity();
      fresh = true;
      continue;
    }
    const Eigen::VectorXd s = trial - best.x;
    Eigen::VectorXd y = slope - best.gradient;
    if (fresh && s.dot(y) > 0.0) hessian = Eigen::MatrixXd::Identity(n, n) * (y.squaredNorm() / s.dot(y));
    const Eigen::VectorXd hs = hessian * s;
    const double curvature = s.dot(hs);
    if (s.dot(y) < 0.2 * curvature) {
      const double damping = 0.8 * curvature / (curvature - s.dot(y));
      y = damping * y + (1.0 - damping) * hs;
    }
    hessian += y * y.transpose() / s.dot(y) - hs * hs.transpose() / curvature;
    fresh = false;
    const double decrease = best.value - value;
    best.x = trial;
    best.value = value;
    best.gradient = slope;
    if (decrease <= value_tolerance * std::max(1.0, std::abs(value))) {
      best.converged = true;
      break;
    }
  }
  best.hessian = std::move(hessian);
  return best;
}

}  // namespace lumo
