#pragma once

#include "lumo/sense/decode/decoder.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <limits>

namespace lumo::sense {

/// Covariance of residuals (features × observations) about means that took `parameters` degrees of freedom, shrunk
/// towards a multiple of the identity; a negative shrinkage asks for Ledoit and Wolf's and is replaced by it. `floor`:
/// the least mean variance that is believed.
inline Eigen::MatrixXd shrunk_covariance(
    const Eigen::MatrixXd& residual, Eigen::Index parameters, double& shrinkage, double floor = 1e-300) {
  const Eigen::Index d = residual.rows(), n = residual.cols();
  const Eigen::MatrixXd s = residual * residual.transpose() / double(n);
  const double level = std::max(s.trace() / double(d), floor);
  const Eigen::MatrixXd target = level * Eigen::MatrixXd::Identity(d, d);
  if (shrinkage < 0.0) {
    double scatter = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) scatter += (residual.col(i) * residual.col(i).transpose() - s).squaredNorm();
    const double far = (s - target).squaredNorm();
    shrinkage = far > 0.0 ? std::clamp(scatter / (double(n) * double(n)) / far, 0.0, 1.0) : 1.0;
  }
  const double left = double(std::max<Eigen::Index>(1, n - parameters)) / double(n);
  return ((1.0 - shrinkage) * s + (shrinkage + 1e-9) * target) / left;
}

/// Regularised linear discriminant: Gaussians about the places' means with one covariance, shrunk towards a multiple of
/// the identity because a finger gives few re-contacts for many regions. Source: Friedman 1989; the shrinkage is Ledoit
/// & Wolf's (2004) from the data, or given.
struct LinearDecoder {
  double shrinkage = -1.0;  ///< 0 … 1; negative: Ledoit and Wolf's

  class Model {
   public:
    Model(const LabelledResponses& t, double shrinkage) : mean_(place_means(t)) {
      const Eigen::MatrixXd& mean = mean_;
      Eigen::MatrixXd residual = t.response;
      for (Eigen::Index i = 0; i < residual.cols(); ++i) residual.col(i) -= mean.col(t.place[std::size_t(i)]);
      const Eigen::MatrixXd covariance =
          shrunk_covariance(residual, t.places(), shrinkage, 1e-12 * mean.cwiseAbs2().maxCoeff() + 1e-300);
      shrinkage_ = shrinkage;
      factor_.compute(covariance);
      weight_ = factor_.solve(mean);
      offset_ = -0.5 * mean.cwiseProduct(weight_).colwise().sum().transpose();
    }
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const { return decoding_of(log_likelihood(response)); }
    /// Of each place, up to one common constant.
    Eigen::VectorXd log_likelihood(const Eigen::VectorXd& response) const {
      if (response.size() != mean_.rows())
        throw InvalidArgument(message("response has ", response.size(), " features, the decoder ", mean_.rows()));
      const Eigen::MatrixXd& weight = weight_;
      return weight.transpose() * response + offset_;
    }
    double shrinkage() const { return shrinkage_; }

   private:
    Eigen::MatrixXd mean_, weight_;
    Eigen::VectorXd offset_;
    Eigen::LLT<Eigen::MatrixXd> factor_;
    double shrinkage_ = 0.0;
  };

  /// Throws InvalidArgument for data that do not fit together.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("shrinkage", shrinkage, std::numeric_limits<double>::lowest(), 1.0, "");
    return Model(training, shrinkage);
  }
};

static_assert(Decoder<LinearDecoder>);

}  // namespace lumo::sense
