#pragma once

#include <cmath>
#include <numeric>
#include <vector>

namespace lumo {

/// Where the emitted power of a run went [W]. Law: emitted = sum of everything else, to rounding.
struct EnergyLedger {
  double emitted = 0.0;
  std::vector<double> channels;       ///< left for good, per channel of the readout (ExitPower: per region)
  double to_indenter = 0.0;           ///< left through the contact set, into the opaque indenter
  double elsewhere = 0.0;             ///< left for good, but through no region
  double absorbed_in_medium = 0.0;    ///< in the silicone
  double absorbed_at_surfaces = 0.0;  ///< at opaque surfaces: carrier and LEDs
  double roulette = 0.0;              ///< ended minus added by Russian roulette; expectation 0, either sign
  double refinement = 0.0;  ///< channels as first traced minus channels as refined; expectation 0, either sign
  double lost = 0.0;        ///< rays that leaked or bounced too often; target ≤ 1e-6 of emitted

  double accounted() const {
    return std::accumulate(channels.begin(), channels.end(), 0.0) + to_indenter + elsewhere + absorbed_in_medium +
           absorbed_at_surfaces + roulette + refinement + lost;
  }
  /// |emitted − accounted| / emitted.
  double imbalance() const { return emitted > 0.0 ? std::abs(emitted - accounted()) / emitted : std::abs(accounted()); }
};

}  // namespace lumo
