#pragma once

#include "lumo/core/types.hpp"
#include "lumo/optics/ledger.hpp"

#include <Eigen/Core>

#include <cmath>
#include <vector>

namespace lumo {

/// What the readout sees of one state. Channels are those of the readout (ExitPower: regions of the body), once for
/// each colour of the emitters.
struct Response {
  std::vector<double> power_W;  ///< mean over replicates
  std::vector<double> error_W;  ///< standard error of the mean, from the scatter of the replicates
  /// [W], replicates × channels. Replicate k of every state is traced with the same rays, so an error of a *difference*
  /// of states comes from the differences row by row (common random numbers).
  Eigen::MatrixXd replicates;
  Eigen::MatrixXd direct;  ///< the part of `replicates` that met no surface but the one through which it left
  EnergyLedger ledger;     ///< mean over replicates
  long rays = 0;           ///< primary rays traced
  long segments = 0;       ///< straight pieces traced
};

/// Standard error of the mean of each column of `rows` (independent replicates × channels); zeros for one row.
inline std::vector<double> standard_error(const Eigen::MatrixXd& rows) {
  std::vector<double> error(std::size_t(rows.cols()), 0.0);
  const double n = double(rows.rows());
  if (rows.rows() < 2) return error;
  for (Eigen::Index c = 0; c < rows.cols(); ++c)
    error[std::size_t(c)] = std::sqrt((rows.col(c).array() - rows.col(c).mean()).square().sum() / (n * (n - 1.0)));
  return error;
}

}  // namespace lumo
