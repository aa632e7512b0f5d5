#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace lumo {

/// End of a bounded minimisation.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0.0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;  ///< as the search has built it up
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
  double shortest_step = 1e-12;      ///< the line search ends below this change
  double cut = 0.3;                  ///< of the step after a trial that is refused
  double descent = 1e-4;             ///< share of the slope's decrease that a step must have (Armijo)

  /// `function(x, gradient)` returns the value and fills the gradient. The search steps back from values that are not
  /// finite. `start` is moved between the bounds. `hessian`, positive definite, from the search for a like minimum
  /// saves steps. Throws InvalidArgument if sizes differ, for a start or bounds that are no numbers, or if the value at
  /// the start is not finite.
  template <class Function> Minimum minimize(Function&& function, const Eigen::VectorXd& start,
      const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
      const std::optional<Eigen::MatrixXd>& hessian = std::nullopt) const;

 private:
  struct Point {
    Eigen::VectorXd x;
    double value = 0.0;
    Eigen::VectorXd gradient;
  };

  static Eigen::VectorXd step_of(Minimum& best, const std::vector<Eigen::Index>& free, bool& fresh);
  static void update(Eigen::MatrixXd& hessian, const Eigen::VectorXd& s, Eigen::VectorXd y, bool fresh);
};

namespace detail {

/// Variables that may move: one at a bound that the gradient pushes it against stays there.
inline std::vector<Eigen::Index> free_variables(
    const Minimum& at, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
  std::vector<Eigen::Index> free;
  for (Eigen::Index i = 0; i < at.x.size(); ++i)
    if (!((at.x[i] <= lower[i] && at.gradient[i] >= 0.0) || (at.x[i] >= upper[i] && at.gradient[i] <= 0.0)))
      free.push_back(i);
  return free;
}

}  // namespace detail

// Newton's step of the free variables, or the steepest descent if that does not lead downwards.
inline Eigen::VectorXd QuasiNewton::step_of(Minimum& best, const std::vector<Eigen::Index>& free, bool& fresh) {
  Eigen::VectorXd step = Eigen::VectorXd::Zero(best.x.size());
  const Eigen::MatrixXd block = best.hessian(free, free);
  step(free) = -block.llt().solve(Eigen::VectorXd(best.gradient(free)));
  if (step.allFinite() && step.dot(best.gradient) < 0.0) return step;
  best.hessian.setIdentity();
  fresh = true;
  step.setZero();
  step(free) = -Eigen::VectorXd(best.gradient(free));
  return step;
}

// BFGS after the step `s` that changed the gradient by `y`.
inline void QuasiNewton::update(Eigen::MatrixXd& hessian, const Eigen::VectorXd& s, Eigen::VectorXd y, bool fresh) {
  constexpr double least = 0.2;  // share of the curvature along a step that is kept: Powell 1978
  const Eigen::Index n = s.size();
  if (fresh && s.dot(y) > 0.0) hessian = Eigen::MatrixXd::Identity(n, n) * (y.squaredNorm() / s.dot(y));
  const Eigen::VectorXd hs = hessian * s;
  const double curvature = s.dot(hs);
  if (s.dot(y) < least * curvature) {
    const double damping = 0.8 * curvature / (curvature - s.dot(y));
    y = damping * y + (1.0 - damping) * hs;
  }
  hessian += y * y.transpose() / s.dot(y) - hs * hs.transpose() / curvature;
}

template <class Function> Minimum QuasiNewton::minimize(Function&& function, const Eigen::VectorXd& start,
    const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, const std::optional<Eigen::MatrixXd>& known) const {
  const Eigen::Index n = start.size();
  if (lower.size() != n || upper.size() != n)
    throw InvalidArgument(
        message("minimiser has ", n, " variables but ", lower.size(), " lower and ", upper.size(), " upper bounds"));
  if (!start.allFinite() || !(lower.array() <= upper.array()).all())
    throw InvalidArgument("minimiser: the start must be finite, lower bounds at most the upper ones");
  Minimum best;
  best.x = start.cwiseMax(lower).cwiseMin(upper);
  best.gradient.resize(n);
  best.value = function(best.x, best.gradient);
  best.evaluations = 1;
  if (!std::isfinite(best.value) || !best.gradient.allFinite())
    throw InvalidArgument(message("function is ", best.value, " where the minimiser starts, must be finite"));

  best.hessian = known.value_or(Eigen::MatrixXd::Identity(n, n));
  bool fresh = !known;  // the Hessian has seen no curvature yet
  Point trial{Eigen::VectorXd(n), 0.0, Eigen::VectorXd(n)};
  while (best.evaluations < max_evaluations) {
    const std::vector<Eigen::Index> free = detail::free_variables(best, lower, upper);
    double steepest = 0.0;
    for (const Eigen::Index i : free) steepest = std::max(steepest, std::abs(best.gradient[i]));
    if (steepest <= gradient_tolerance) {
      best.converged = true;
      break;
    }
    const Eigen::VectorXd step = step_of(best, free, fresh);
    const double longest = step.cwiseAbs().maxCoeff();
    double scale = std::min({1.0, longest_step / longest, fresh ? 0.5 / longest : 1.0});
    bool moved = false;
    for (; !moved && scale * longest > shortest_step && best.evaluations < max_evaluations; scale *= cut) {
      trial.x = (best.x + scale * step).cwiseMax(lower).cwiseMin(upper);
      trial.value = function(trial.x, trial.gradient);
      ++best.evaluations;
      moved = std::isfinite(trial.value) && trial.gradient.allFinite() &&
              trial.value <= best.value + descent * best.gradient.dot(trial.x - best.x) && trial.value < best.value;
    }
    if (!moved) {
      best.converged = best.evaluations < max_evaluations;  // no descent left that rounding would let through
      if (fresh) break;
      best.hessian.setIdentity();
      fresh = true;
      continue;
    }
    update(best.hessian, trial.x - best.x, trial.gradient - best.gradient, fresh);
    fresh = false;
    const double decrease = best.value - trial.value;
    best.x = trial.x;
    best.value = trial.value;
    best.gradient = trial.gradient;
    if (decrease <= value_tolerance * std::max(1.0, std::abs(best.value))) {
      best.converged = true;
      break;
    }
  }
  return best;
}

}  // namespace lumo
