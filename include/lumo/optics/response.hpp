#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

namespace lumo {

/// Balance of the emitted power of a run [W]. Law: emitted = sum of everything else, to rounding.
struct EnergyLedger {
  double emitted = 0.0;
  std::vector<double> channels;       ///< left for good, per channel of the readout (ExitPower: per region)
  double to_indenter = 0.0;           ///< left through the contact set, into the opaque indenter
  double elsewhere = 0.0;             ///< left for good, but through no region
  double absorbed_in_medium = 0.0;    ///< in the silicone
  double absorbed_at_surfaces = 0.0;  ///< at opaque surfaces: carrier and LEDs
  double roulette = 0.0;              ///< ended minus added by Russian roulette; expectation 0, either sign
  double refinement = 0.0;  ///< channels as first traced minus channels as refined; expectation 0, either sign
  double lost = 0.0;        ///< rays that leaked or bounced too often; a result has at most largest_lost of emitted

  static constexpr double largest_lost = 1e-6;       ///< share of the emitted power, by default
  static constexpr double largest_imbalance = 1e-9;  ///< what rounding may do to imbalance()

  double accounted() const {
    return std::accumulate(channels.begin(), channels.end(), 0.0) + to_indenter + elsewhere + absorbed_in_medium +
           absorbed_at_surfaces + roulette + refinement + lost;
  }
  /// |emitted − accounted| / emitted.
  double imbalance() const { return emitted > 0.0 ? std::abs(emitted - accounted()) / emitted : std::abs(accounted()); }
};

/// Throws NumericalError unless the balance closes and next to nothing is lost: else light left where the surface is
/// open, or was still on its way after the last event.
inline void require_closed(const EnergyLedger& ledger, double largest_lost = EnergyLedger::largest_lost) {
  const double lost = ledger.emitted > 0.0 ? ledger.lost / ledger.emitted : ledger.lost;
  if (!(lost <= largest_lost))
    throw NumericalError(message("light: ", lost, " of the emitted power is lost, at most ", largest_lost,
        ": the surface is open, or max_events is too small"));
  if (!(ledger.imbalance() <= EnergyLedger::largest_imbalance))
    throw NumericalError(message("light: ", ledger.imbalance(), " of the emitted power is unaccounted for, at most ",
        EnergyLedger::largest_imbalance));
}

namespace detail {

inline constexpr std::array<double EnergyLedger::*, 8> ledger_entries = {&EnergyLedger::emitted,
    &EnergyLedger::to_indenter, &EnergyLedger::elsewhere, &EnergyLedger::absorbed_in_medium,
    &EnergyLedger::absorbed_at_surfaces, &EnergyLedger::roulette, &EnergyLedger::refinement, &EnergyLedger::lost};

}  // namespace detail

/// Adds `factor` × the accounts of `part`, `emitted` too.
inline void add_scaled(EnergyLedger& sum, const EnergyLedger& part, double factor) {
  for (std::size_t c = 0; c < sum.channels.size(); ++c) sum.channels[c] += factor * part.channels[c];
  for (const auto entry : detail::ledger_entries) sum.*entry += factor * part.*entry;
}

/// Power that the readout sees of one state. Channels are those of the readout (ExitPower: regions of the body), once
/// for each colour of the emitters.
struct Response {
  std::vector<double> power_W;  ///< mean over replicates
  std::vector<double> error_W;  ///< standard error of the mean, from the scatter of the replicates
  /// [W], replicates × channels. Replicate k of every state is traced with the same rays, so an error of a *difference*
  /// of states comes from the differences row by row (common random numbers).
  Eigen::MatrixXd replicates;
  Eigen::MatrixXd direct;  ///< the part of `replicates` that met no surface but the one through which it left
  /// The same two as paths from the emitters alone have them, of portions whose light was gathered backwards, too.
  Eigen::MatrixXd forward, forward_direct;
  EnergyLedger ledger;                ///< mean over replicates
  std::vector<EnergyLedger> ledgers;  ///< of each replicate, without its channels
  long rays = 0;                      ///< primary rays traced
  long segments = 0;                  ///< straight pieces traced
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

/// Standard errors of the ledger's entries, from the scatter of the replicates; of `channels`, error_W.
inline EnergyLedger ledger_error(const Response& r) {
  EnergyLedger error;
  error.channels = r.error_W;
  for (const auto entry : detail::ledger_entries) {
    Eigen::MatrixXd column(Eigen::Index(r.ledgers.size()), 1);
    for (std::size_t i = 0; i < r.ledgers.size(); ++i) column(Eigen::Index(i), 0) = r.ledgers[i].*entry;
    error.*entry = standard_error(column)[0];
  }
  return error;
}

/// Of each channel whose light was also gathered backwards, takes what the paths themselves found where that is the
/// better known: points on a face can be few where a lamp is near or all light comes from one spot, and then scatter,
/// or miss it all with an error of zero. Forward light is taken where all replicates saw it, its error is a hundredth
/// of it (few paths make errors that are themselves chance), and gathered light scatters four times as much, or is off
/// by a twentieth and eight errors.
inline void choose_better(Response& r) {
  constexpr double known = 0.01, noisier = 4.0, off_part = 0.05, off_errors = 8.0;
  if (r.forward.cols() != r.replicates.cols() || r.forward.rows() < 2) return;
  const std::vector<double> gathered = standard_error(r.replicates), forward = standard_error(r.forward),
                            apart = standard_error(r.replicates - r.forward);
  for (Eigen::Index c = 0; c < r.replicates.cols(); ++c) {
    const auto k = std::size_t(c);
    const double had = r.replicates.col(c).mean(), found = r.forward.col(c).mean(), off = std::abs(had - found);
    const bool misses = off > off_errors * apart[k] && off > off_part * std::max(had, found);
    const bool is_known = r.forward.col(c).minCoeff() > 0.0 && forward[k] < known * found;
    if (!(is_known && (misses || gathered[k] > noisier * forward[k]))) continue;
    for (std::size_t i = 0; i < r.ledgers.size(); ++i)
      r.ledgers[i].refinement += r.replicates(Eigen::Index(i), c) - r.forward(Eigen::Index(i), c);
    r.replicates.col(c) = r.forward.col(c);
    r.direct.col(c) = r.forward_direct.col(c);
  }
  r.forward.resize(0, 0);
  r.forward_direct.resize(0, 0);
}

}  // namespace lumo
