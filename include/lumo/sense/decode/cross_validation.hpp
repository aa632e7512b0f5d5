#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/sense/decode/decoder.hpp"

#include <cmath>
#include <set>

namespace lumo::sense {

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
