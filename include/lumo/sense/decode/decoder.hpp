#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Core>

#include <concepts>
#include <cstddef>
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

/// Softmax of log weights, and its mode.
inline Decoding decoding_of(const Eigen::VectorXd& log_weight) {
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

}  // namespace lumo::sense
