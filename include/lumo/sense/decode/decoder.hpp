#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/statistics.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Core>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <set>
#include <vector>

namespace lumo::sense {

/// Responses with the place that each belongs to. Places are numbered from 0 along the finger.
struct LabelledResponses {
  Eigen::MatrixXd response;  ///< features × observations
  std::vector<int> place;    ///< of each observation
  Eigen::VectorXd place_m;   ///< where the places are, ascending
  int places() const { return int(place_m.size()); }
};

/// Throws InvalidArgument unless shapes fit, numbers are finite, places ascend and every place has an observation.
inline void validate(const LabelledResponses& d) {
  if (d.places() < 2 || d.response.rows() < 1 || d.response.cols() != Eigen::Index(d.place.size()))
    throw InvalidArgument(message("labelled responses: ", d.response.rows(), " features × ", d.response.cols(),
        " observations, ", d.place.size(), " labels, ", d.places(), " places"));
  if (!d.response.allFinite() || !d.place_m.allFinite())
    throw InvalidArgument("labelled responses: numbers must be finite");
  for (Eigen::Index i = 1; i < d.place_m.size(); ++i)
    if (!(d.place_m[i] > d.place_m[i - 1]))
      throw InvalidArgument(message("labelled responses: place ", i, " lies at ", d.place_m[i],
          " m, must exceed its predecessor, ", d.place_m[i - 1], " m"));
  std::vector<bool> seen(std::size_t(d.places()), false);
  for (const int p : d.place) {
    if (p < 0 || p >= d.places())
      throw InvalidArgument(message("labelled responses: place ", p, ", must lie in [0, ", d.places() - 1, "]"));
    seen[std::size_t(p)] = true;
  }
  for (std::size_t p = 0; p < seen.size(); ++p)
    if (!seen[p]) throw InvalidArgument(message("labelled responses: no observation of place ", p));
}

/// What a decoder makes of one response.
struct Decoding {
  int place = 0;
  Eigen::VectorXd probability;  ///< of each place; sums to 1
};

/// Learns places from labelled responses; the model it gives decodes new ones.
/// Laws: `fit` is a pure function of its data; the place decoded is (one of) the most probable; the answer does not
/// depend on the order of observations (up to rounding).
template <class D>
concept Decoder = requires(const D& decoder, const LabelledResponses& training, const Eigen::VectorXd& response) {
  { decoder.fit(training).decode(response) } -> std::same_as<Decoding>;
};

/// Softmax of log weights, and its mode; −∞ is a weight of 0. Throws InvalidArgument unless the largest is finite, as
/// it is not for a response that is not.
inline Decoding decoding_of(const Eigen::VectorXd& log_weight) {
  constexpr double infinite = std::numeric_limits<double>::infinity();
  if (!(log_weight.array() < infinite).all() || !(log_weight.array() > -infinite).any())
    throw InvalidArgument(
        message("decoder: of ", log_weight.size(), " log weights one must be finite, none NaN or +inf"));
  Decoding d;
  Eigen::Index top = 0;
  const double most = log_weight.maxCoeff(&top);
  d.place = int(top);
  d.probability = (log_weight.array() - most).exp();
  d.probability /= d.probability.sum();
  return d;
}

/// Mean response of each place, features × places.
inline Eigen::MatrixXd place_means(const LabelledResponses& t) {
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(t.response.rows(), t.places());
  Eigen::VectorXd count = Eigen::VectorXd::Zero(t.places());
  for (std::size_t i = 0; i < t.place.size(); ++i) {
    mean.col(t.place[i]) += t.response.col(Eigen::Index(i));
    count[t.place[i]] += 1.0;
  }
  return mean * count.cwiseInverse().asDiagonal();
}

/// What a decoder made of observations that it had not seen.
struct DecodingReport {
  struct Prediction {
    int observation = 0, fold = 0, place = 0, decoded = 0;
    double probability = 0.0;  ///< that the decoder gave to the place decoded
  };
  std::vector<Prediction> predictions;  ///< by observation
  Eigen::MatrixXi confusion;            ///< true place × decoded place
  Interval accuracy;                    ///< share of right ones, with Wilson's 95 % interval
  double mean_error_m = 0.0;            ///< mean distance between the places
  double log_score = 0.0;               ///< mean logarithm of the probability given to the true place, at least −700
};

/// Leaves out one fold after the other (the paper: one repetition of all places), fits on the others and decodes it.
/// `fold[i]` of observation i. Throws InvalidArgument for fewer than two folds, or when a place is only in one fold.
template <Decoder D>
DecodingReport cross_validate(const D& decoder, const LabelledResponses& data, const std::vector<int>& fold) {
  validate(data);
  if (fold.size() != data.place.size())
    throw InvalidArgument(
        message("cross-validation: ", data.place.size(), " observations and ", fold.size(), " folds"));
  const std::set<int> folds(fold.begin(), fold.end());
  if (folds.size() < 2) throw InvalidArgument("cross-validation needs at least 2 folds");
  DecodingReport report;
  report.confusion = Eigen::MatrixXi::Zero(data.places(), data.places());
  report.predictions.resize(data.place.size());
  int right = 0;
  for (const int out : folds) {
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < fold.size(); ++i)
      if (fold[i] != out) kept.push_back(Eigen::Index(i));
    LabelledResponses training{data.response(Eigen::all, kept), {}, data.place_m};
    for (const Eigen::Index i : kept) training.place.push_back(data.place[std::size_t(i)]);
    const auto model = decoder.fit(training);
    for (std::size_t i = 0; i < fold.size(); ++i) {
      if (fold[i] != out) continue;
      const Decoding d = model.decode(data.response.col(Eigen::Index(i)));
      const int place = data.place[i];
      report.predictions[i] = {int(i), out, place, d.place, d.probability[d.place]};
      ++report.confusion(place, d.place);
      right += d.place == place;
      report.mean_error_m += std::abs(data.place_m[d.place] - data.place_m[place]) / double(fold.size());
      report.log_score += std::max(std::log(std::max(d.probability[place], 1e-305)), -700.0) / double(fold.size());
    }
  }
  report.accuracy = wilson_interval(right, int(fold.size()));
  return report;
}

}  // namespace lumo::sense
