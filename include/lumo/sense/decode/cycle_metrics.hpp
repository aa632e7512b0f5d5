#pragma once

#include "lumo/core/statistics.hpp"
#include "lumo/core/types.hpp"

#include <limits>
#include <vector>

namespace lumo::sense {

/// One run of cycles within maintained contact: `load[k]` holds the responses at matched force k, channels × cycles.
struct CycleRun {
  std::vector<Eigen::MatrixXd> load;
};

/// W_cycle: median over runs, forces and cycles of the RMS deviation from the pointwise median over the run's cycles at
/// that force. The paper says "matched-force variation across cycles"; that it is taken as W_recontact is, with cycles
/// for re-contacts, is our reading. Throws InvalidArgument for no runs, fewer than two cycles, or shapes that differ.
inline double cycle_variation(const std::vector<CycleRun>& runs) {
  std::vector<double> deviation;
  for (const CycleRun& run : runs)
    for (const Eigen::MatrixXd& cycles : run.load) {
      if (cycles.cols() < 2 || cycles.rows() < 1)
        throw InvalidArgument(message("cycle variation: ", cycles.rows(), " channels × ", cycles.cols(),
                                      " cycles, must have at least 1 × 2"));
      if (!cycles.allFinite()) throw InvalidArgument("cycle variation: responses must be finite");
      const Eigen::VectorXd middle = pointwise_median(cycles);
      for (Eigen::Index c = 0; c < cycles.cols(); ++c) deviation.push_back(rms(cycles.col(c) - middle));
    }
  if (deviation.empty()) throw InvalidArgument("cycle variation: no runs");
  return median(deviation);
}

/// Regional RMS change: of each channel, over re-contacts, from a low load to a high one (paper: 2 to 15 N). Both
/// channels × re-contacts.
inline Eigen::VectorXd regional_rms_change(const Eigen::MatrixXd& low, const Eigen::MatrixXd& high) {
  if (low.rows() != high.rows() || low.cols() != high.cols() || low.cols() < 1)
    throw InvalidArgument(message("regional change: ", low.rows(), " × ", low.cols(), " and ", high.rows(), " × ",
                                  high.cols(), " responses, must be the same, at least one re-contact"));
  if (!low.allFinite() || !high.allFinite()) throw InvalidArgument("regional change: responses must be finite");
  return ((high - low).rowwise().squaredNorm() / double(low.cols())).cwiseSqrt();
}

/// 100 (1 − W/W_base) [%]: by how much a variation is smaller than the baseline's.
inline double reduction_percent(double value, double baseline) {
  require_positive("baseline's value", baseline, "");
  constexpr double most = std::numeric_limits<double>::max();
  require_in_range("value", value, -most, most, "");
  return 100.0 * (1.0 - value / baseline);
}
/// 100 (D/D_base − 1) [%].
inline double gain_percent(double value, double baseline) { return -reduction_percent(value, baseline); }

}  // namespace lumo::sense
