#pragma once

#include "lumo/core/types.hpp"
#include "lumo/model/gaussian_process.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"

#include <Eigen/Cholesky>

#include <limits>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Templates that are smooth along the finger: one Gaussian process for each feature over the finger coordinate, so
/// that each place learns from its neighbours' observations too. A response is weighed against the processes' mean with
/// one shrunk covariance of the residuals and the processes' own variance. Unlike discriminants it has a template
/// between the tested places as well.
struct GaussianProcessDecoder {
  double shrinkage = -1.0;  ///< of the residuals' covariance, 0 … 1; negative: Ledoit and Wolf's
  int grid = 201;           ///< coordinates that `coordinate_m` weighs

  class Model {
   public:
    Model(const LabelledResponses& t, const GaussianProcessDecoder& config)
        : grid_(Eigen::VectorXd::LinSpaced(config.grid, t.place_m[0], t.place_m[t.places() - 1])) {
      const Eigen::Index d = t.response.rows(), n = t.response.cols();
      const Eigen::VectorXd& coordinate = grid_;
      TrainingData data{Eigen::MatrixXd(1, n), Eigen::VectorXd(n), t.place_m.head(1), t.place_m.tail(1)};
      for (Eigen::Index i = 0; i < n; ++i) data.x(0, i) = t.place_m[t.place[std::size_t(i)]];
      Eigen::MatrixXd residual(d, n), on_grid(d, config.grid), grid_variance(d, config.grid);
      Eigen::MatrixXd mean(d, t.places());
      Eigen::MatrixXd variance(d, t.places());
      for (Eigen::Index f = 0; f < d; ++f) {
        data.y = t.response.row(f).transpose();
        const auto process = GaussianProcess<>::fit(data);
        residual.row(f) = t.response.row(f) - process.mean(data.x).transpose();
        const auto places = process.predict(t.place_m.transpose()), fine = process.predict(coordinate.transpose());
        mean.row(f) = places.mean.transpose();
        variance.row(f) = places.variance.transpose();
        on_grid.row(f) = fine.mean.transpose();
        grid_variance.row(f) = fine.variance.transpose();
      }
      double share = config.shrinkage;
      covariance_ = shrunk_covariance(residual, t.places(), share);
      for (Eigen::Index p = 0; p < mean.cols(); ++p) place_.push_back(factor(variance.col(p)));
      for (Eigen::Index g = 0; g < grid_.size(); ++g) fine_.push_back(factor(grid_variance.col(g)));
      mean_ = std::move(mean);
      grid_mean_ = std::move(on_grid);
    }
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const { return weigh(response, mean_, place_); }
    /// Mean of the coordinate's posterior over the tested range, flat before [m].
    double coordinate_m(const Eigen::VectorXd& response) const {
      return weigh(response, grid_mean_, fine_).probability.dot(grid_);
    }

   private:
    using Factor = Eigen::LLT<Eigen::MatrixXd>;
    Factor factor(const Eigen::VectorXd& variance) const {
      return Factor(covariance_ + Eigen::MatrixXd(variance.asDiagonal()));
    }
    template <class Some> static Decoding weigh(
        const Eigen::VectorXd& response, const Eigen::MatrixXd& mean, const std::vector<Some>& factors) {
      if (response.size() != mean.rows())
        throw InvalidArgument(message("response has ", response.size(), " features, the decoder ", mean.rows()));
      Eigen::VectorXd log_likelihood(mean.cols());
      for (Eigen::Index p = 0; p < mean.cols(); ++p) {
        const Some& l = factors[std::size_t(p)];
        const Eigen::VectorXd z = l.matrixL().solve(response - mean.col(p));
        log_likelihood[p] = -0.5 * z.squaredNorm() - l.matrixLLT().diagonal().array().log().sum();
      }
      return decoding_of(log_likelihood);
    }

    Eigen::VectorXd grid_;
    Eigen::MatrixXd mean_, grid_mean_, covariance_;
    std::vector<Factor> place_, fine_;
  };

  /// Throws InvalidArgument for data that do not fit together.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("shrinkage", shrinkage, std::numeric_limits<double>::lowest(), 1.0, "");
    require_in_range("grid of the decoder", grid, 2, 100000, "");
    return Model(training, *this);
  }
};

static_assert(Decoder<GaussianProcessDecoder>);

}  // namespace lumo::sense
