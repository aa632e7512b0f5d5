#pragma once

#include "lumo/core/types.hpp"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <concepts>

namespace lumo {

/// Lower triangle of a symmetric matrix, compressed by columns.
using SparseLower = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

enum class FactorStatus { positive_definite, not_positive_definite, non_finite };

/// Direct solver for symmetric positive definite systems. analyze() sees the pattern once; copies share or copy that
/// analysis. Laws: factorize() reports every matrix that is not positive definite or not finite; equal input, equal
/// bits.
template <class S>
concept LinearSolver = std::copyable<S> && std::default_initializable<S> &&
    requires(S solver, const SparseLower& lower, const Eigen::MatrixXd& rhs) {
  solver.analyze(lower);
  { solver.factorize(lower) } -> std::same_as<FactorStatus>;
  { solver.solve(rhs) } -> std::convertible_to<Eigen::MatrixXd>;
};

/// One whose factor is an approximation that its solutions are refined from. precondition() is a solution as the factor
/// gives it, to some digits; certify() states whether the matrix itself is positive definite.
template <class S>
concept RefiningSolver = LinearSolver<S> && requires(S solver, const Eigen::VectorXd& rhs) {
  { solver.precondition(rhs) } -> std::convertible_to<Eigen::VectorXd>;
  { solver.certify() } -> std::same_as<FactorStatus>;
};

/// Eigen's own sparse Cholesky factorisation: needs nothing else, but is some twenty times slower than a supernodal
/// one.
class EigenCholesky {
 public:
  EigenCholesky() = default;
  EigenCholesky(const EigenCholesky& other) { *this = other; }
  EigenCholesky& operator=(const EigenCholesky& other) {  // Eigen's solver does not copy: analyse again
    if (this != &other && other.pattern_.size() > 0) analyze(other.pattern_);
    return *this;
  }

  void analyze(const SparseLower& lower) {
    pattern_ = lower;
    solver_.analyzePattern(lower);
  }
  FactorStatus factorize(const SparseLower& lower) {
    // A Cholesky factorisation of NaN reports success, so finiteness is checked here.
    if (!Eigen::Map<const Eigen::ArrayXd>(lower.valuePtr(), lower.nonZeros()).isFinite().all())
      return FactorStatus::non_finite;
    solver_.factorize(lower);
    return solver_.info() == Eigen::Success ? FactorStatus::positive_definite : FactorStatus::not_positive_definite;
  }
  Eigen::MatrixXd solve(const Eigen::MatrixXd& rhs) const { return solver_.solve(rhs); }

 private:
  SparseLower pattern_;
  Eigen::SimplicialLLT<SparseLower, Eigen::Lower> solver_;
};

static_assert(LinearSolver<EigenCholesky>);

}  // namespace lumo
