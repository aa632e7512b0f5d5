#pragma once

#include "lumo/core/types.hpp"
#include "lumo/sense/decode/linear_decoder.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Bayes filter over the places: takes one response after the other and keeps the probability of each. The contact
/// stays where it is but for a `change` per step.
class PlaceFilter {
 public:
  /// Throws InvalidArgument for fewer than two places or a change that is no probability.
  explicit PlaceFilter(int places, double change = 0.0)
      : change_(change), probability_(Eigen::VectorXd::Constant(std::max(places, 1), 1.0 / std::max(places, 1))) {
    require_in_range("number of places", places, 2, 1e6, "");
    require_in_range("change of place per step", change, 0.0, 1.0, "");
  }
  /// Takes the log likelihoods of the places (up to a constant) under the next response. Throws InvalidArgument, and
  /// stays as it was, for another number of places and as decoding_of() does.
  const Eigen::VectorXd& update(const Eigen::VectorXd& log_likelihood) {
    Eigen::VectorXd& p = probability_;
    const double n = double(p.size());
    if (log_likelihood.size() != p.size())
      throw InvalidArgument(message("place filter has ", p.size(), " places, got ", log_likelihood.size()));
    const Eigen::VectorXd prior = ((1.0 - change_) * p.array() + change_ / n).max(1e-300);
    p = decoding_of((prior.array().log() + log_likelihood.array()).matrix()).probability;
    return probability_;
  }
  const Eigen::VectorXd& probability() const { return probability_; }

 private:
  double change_;
  Eigen::VectorXd probability_;
};

/// Decodes a contact from several steps of its loading: a response is `steps` blocks of features, one below the other,
/// each with a linear discriminant of its own, and the places' probabilities pass from step to step. With one step it
/// is the linear decoder.
struct BayesDecoder {
  int steps = 1;
  double change = 0.0;  ///< of place from step to step
  LinearDecoder step = {};

  class Model {
   public:
    Model(std::vector<LinearDecoder::Model> steps, int places, double change)
        : steps_(std::move(steps)), places_(places), change_(change) {}
    /// Throws InvalidArgument for another number of features.
    Decoding decode(const Eigen::VectorXd& response) const {
      const auto n = Eigen::Index(steps_.size());
      if (response.size() % n != 0)
        throw InvalidArgument(message("response has ", response.size(), " features, must be ", n, " steps of as many"));
      PlaceFilter filter(places_, change_);
      for (Eigen::Index k = 0; k < n; ++k)
        filter.update(
            steps_[std::size_t(k)].log_likelihood(response.segment(k * (response.size() / n), response.size() / n)));
      const Eigen::VectorXd& p = filter.probability();
      return decoding_of(p.array().max(1e-300).log().matrix());
    }

   private:
    std::vector<LinearDecoder::Model> steps_;
    int places_;
    double change_;
  };

  /// Throws InvalidArgument for data that do not fit together, or features that are not `steps` blocks.
  Model fit(const LabelledResponses& training) const {
    validate(training);
    require_in_range("steps of the decoder", steps, 1, 1e6, "");
    if (training.response.rows() % steps != 0)
      throw InvalidArgument(
          message("responses have ", training.response.rows(), " features, must be ", steps, " steps of as many"));
    std::vector<LinearDecoder::Model> models;
    const Eigen::Index rows = training.response.rows() / steps;
    for (int k = 0; k < steps; ++k)
      models.push_back(step.fit({training.response.middleRows(k * rows, rows), training.place, training.place_m}));
    return Model(std::move(models), training.places(), change);
  }
};

static_assert(Decoder<BayesDecoder>);

}  // namespace lumo::sense
