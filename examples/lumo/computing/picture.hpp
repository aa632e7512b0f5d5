#pragma once

#include "configuration/configuration.hpp"
#include "console/progress.hpp"
#include "lumo/mechanics/contact/state.hpp"
#include "lumo/optics/view.hpp"
#include "lumo/pipeline/observations.hpp"

#include <cstddef>
#include <vector>

namespace lumo::program {

/// What a camera sees of a pad.
struct Picture {
  double load_N = 0.0;           ///< 0: unloaded
  std::vector<double> radiance;  ///< per emitted power, row by row from the top [1/(m² sr)]
  std::vector<double> error;     ///< its standard error
  /// Change against the unloaded picture, and its standard error: both have the same lines of sight.
  std::vector<double> change, change_error;
};

/// A pad unloaded, and under each load.
struct RenderResult {
  int columns = 0, rows = 0;
  std::vector<Picture> pictures;  ///< the first is unloaded; empty if a load found no equilibrium
  ScenarioRecord press;
  EnergyLedger ledger;  ///< of the state that closes worst
  std::size_t nodes = 0, elements = 0;
  double seconds = 0.0;
};

RenderResult make_render(const Configuration& request, int threads, Progress& progress);

/// Of a linear sensor, above black and below full [DN per 1/(m² sr)].
double numbers_per_radiance(const CameraSettings& camera);
/// What a linear sensor makes of a radiance per emitted power [1/(m² sr)], 0 to 255. One scale for all pads: at 1 ms
/// and gain 64 the side of the built baseline in DS, unloaded, has on average the 70 that the virtual lab assumes.
double digital_number(const CameraSettings& camera, double radiance);

}  // namespace lumo::program
