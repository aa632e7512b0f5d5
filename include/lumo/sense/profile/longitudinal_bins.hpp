#pragma once

#include "lumo/core/error.hpp"

#include <Eigen/Core>

namespace lumo::sense {

/// Where along the finger a profile is averaged: bin i lies between edges i and i + 1.
struct LongitudinalBins {
  Eigen::VectorXd edges_m;  ///< ascending

  /// The paper's 11 regions: 5 mm each on [−27.5, 27.5] mm.
  static LongitudinalBins regions() { return uniform(-27.5e-3, 27.5e-3, 11); }
  static LongitudinalBins uniform(double from_m, double to_m, int count) {
    require_in_range("number of bins", count, 1, 4096, "");
    require_in_range("first edge", from_m, -10.0, 10.0, "m");
    require_in_range("last edge", to_m, -10.0, 10.0, "m");
    LongitudinalBins bins{Eigen::VectorXd::LinSpaced(count + 1, from_m, to_m)};
    validate(bins);
    return bins;
  }

  Eigen::Index size() const { return edges_m.size() - 1; }
  Eigen::VectorXd centres_m() const {
    const Eigen::VectorXd& edges = edges_m;
    return 0.5 * (edges.head(size()) + edges.tail(size()));
  }

  /// Throws InvalidArgument unless there are at least two edges that ascend.
  friend void validate(const LongitudinalBins& b) {
    if (b.edges_m.size() < 2)
      throw InvalidArgument(message("longitudinal bins have ", b.edges_m.size(), " edges, must have at least 2"));
    for (Eigen::Index i = 1; i < b.edges_m.size(); ++i)
      if (!(b.edges_m[i] > b.edges_m[i - 1]))
        throw InvalidArgument(message("edge ", i, " of the longitudinal bins is ", b.edges_m[i],
            " m, must exceed its predecessor, ", b.edges_m[i - 1], " m"));
  }
};

}  // namespace lumo::sense
