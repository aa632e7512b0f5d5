#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>

namespace lumo::sense {

/// Parameters from a linear least-squares problem, with what the data leave open.
struct Identification {
  Eigen::VectorXd value;       ///< of least norm in units of the scales: nothing is added along null directions
  Eigen::MatrixXd covariance;  ///< along the identified directions only
  Eigen::Index rank = 0;
  Eigen::MatrixXd
      null_space;  ///< parameters × (parameters − rank), unit columns in units of the scales: may be added at will
  double residual = 0.0;  ///< RMS of what the fit leaves

  Eigen::Index unknowns() const { return value.size(); }
  bool complete() const { return rank == unknowns(); }
};

/// Solves a x ≈ b for equal, independent errors. `scale` makes parameters of unlike units comparable (a typical size of
/// each). Singular values below `tolerance` times the largest do not count. `sigma`: standard deviation of an entry of
/// b; where it is 0, that of the residual is taken. `known` > 0: nor do directions whose standard deviation exceeds
/// that many scales, for which the data add nothing to what was known before. Throws InvalidArgument for shapes that do
/// not fit or numbers that are not finite.
inline Identification identify(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, const Eigen::VectorXd& scale,
    double sigma = 0.0, double tolerance = 1e-6, double known = 0.0) {
  const Eigen::Index n = a.cols();
  if (n < 1 || a.rows() != b.size() || scale.size() != n)
    throw InvalidArgument(message("identification has ", a.rows(), " × ", n, " coefficients, ", b.size(),
        " observations and ", scale.size(), " scales"));
  if (!a.allFinite() || !b.allFinite() || !(scale.array() > 0.0).all())
    throw InvalidArgument("identification: numbers must be finite, scales positive");
  Identification r;
  const Eigen::MatrixXd scaled = a * scale.asDiagonal();
  if (a.rows() == 0 || scaled.cwiseAbs().maxCoeff() == 0.0) {
    r.value = Eigen::VectorXd::Zero(n);
    r.covariance = Eigen::MatrixXd::Zero(n, n);
    r.null_space = Eigen::MatrixXd::Identity(n, n);
    r.residual = b.size() ? b.norm() / std::sqrt(double(b.size())) : 0.0;
    return r;
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeFullV);
  const Eigen::VectorXd& s = svd.singularValues();
  r.rank = (s.array() > tolerance * s[0]).count();
  const Eigen::VectorXd projection = svd.matrixU().transpose() * b;
  const auto deviation = [&] {
    const double left = std::max(b.squaredNorm() - projection.head(r.rank).squaredNorm(), 0.0);
    return sigma > 0.0 ? sigma : b.size() > r.rank ? std::sqrt(left / double(b.size() - r.rank)) : 0.0;
  };
  while (known > 0.0 && r.rank > 0 && deviation() > known * s[r.rank - 1]) --r.rank;
  const Eigen::MatrixXd v = svd.matrixV().leftCols(r.rank);
  const Eigen::VectorXd inverse = s.head(r.rank).cwiseInverse();
  r.value = scale.asDiagonal() * (v * inverse.cwiseProduct(projection.head(r.rank)));
  r.null_space = svd.matrixV().rightCols(n - r.rank);
  const double left = (a * r.value - b).squaredNorm();
  r.residual = std::sqrt(left / double(b.size()));
  const double variance = sigma > 0.0 ? sigma * sigma : b.size() > r.rank ? left / double(b.size() - r.rank) : 0.0;
  const Eigen::MatrixXd half = scale.asDiagonal() * v * inverse.asDiagonal();
  r.covariance = variance * half * half.transpose();
  return r;
}

}  // namespace lumo::sense
