#pragma once

#include "lumo/sense/decode/decoder.hpp"

#include <algorithm>

namespace lumo::sense {

/// The paper's decoder: the place whose template is nearest (Euclidean). The template is the mean, not the median, over
/// the training data, which cross_validate makes all other repetitions. Probabilities are those of equal, round
/// Gaussians about the templates, as wide as the training data scatter. Source: paper; the mean from its authors'
/// public code (dokkev/fingertip-design-framework, fig5c_decoder.py), whose features are the signed means of six equal
/// parts (LongitudinalBins::parts).
struct NearestTemplate {
  class Model {
   public:
    explicit Model(const LabelledResponses& training) : template_(place_means(training)) {
      const Eigen::MatrixXd& means = template_;
      double squares = 0.0;
      for (std::size_t i = 0; i < training.place.size(); ++i)
        squares += (training.response.col(Eigen::Index(i)) - means.col(training.place[i])).squaredNorm();
      const double freedom =
          double(training.response.rows()) * std::max(1.0, double(training.place.size()) - double(training.places()));
      variance_ = std::max(squares / freedom, 1e-12 * means.cwiseAbs2().maxCoeff() + 1e-300);
    }
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const {
      const Eigen::MatrixXd& means = template_;
      if (response.size() != template_.rows())
        throw InvalidArgument(message("response has ", response.size(), " features, the templates ", template_.rows()));
      return decoding_of((means.colwise() - response).colwise().squaredNorm().transpose() * (-0.5 / variance_));
    }
    const Eigen::MatrixXd& templates() const { return template_; }

   private:
    Eigen::MatrixXd template_;
    double variance_ = 1.0;
  };

  /// Throws InvalidArgument for data that do not fit together.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    return Model(training);
  }
};

static_assert(Decoder<NearestTemplate>);

}  // namespace lumo::sense
