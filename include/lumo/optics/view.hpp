#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/response.hpp"

#include <Eigen/Core>

#include <array>
#include <concepts>
#include <cstddef>
#include <vector>

namespace lumo {

/// A line from an eye outside of the body, and what the light on it counts.
struct SightLine {
  Vec3d origin{0.0, 0.0, 0.0};     ///< [m]
  Vec3d direction{0.0, 0.0, 1.0};  ///< unit, away from the eye
  double weight = 1.0;
};

/// Where light is looked for: lines of sight, pixel by pixel. Laws: a pure function; line(k, u) is a line of pixel k
/// for four numbers in (0, 1), and starts in the air.
template <class V>
concept View = requires(const V& view, int pixel, const std::array<double, 4>& u) {
  { view.pixels() } -> std::convertible_to<int>;
  { view.line(pixel, u) } -> std::same_as<SightLine>;
};

/// A state that is looked at, and the planes in which body and state are their own mirror images.
struct SeenState {
  SurfaceState surface = {};
  Symmetry symmetry = {};
};

/// How exactly a view is looked at.
struct ViewEffort {
  int samples = 16;  ///< lines a pixel, a multiple of the tracer's replicates, or a divisor of them
  /// As of Tracer::Config, of lines: lamps that are seen are a thousand times as bright as faces.
  double roulette_below = 2e-3;
};

/// What is seen of one state.
struct ViewLight {
  /// Mean of weight × radiance over the lines of a pixel [W/(m² sr)], replicates × (pixels of the first colour, then of
  /// the next). Replicate k of every state has the same rays: errors of differences come from the differences row by
  /// row.
  Eigen::MatrixXd replicates;
  EnergyLedger ledger;  ///< of the light that the emitters sent, mean over the replicates; its channels are empty

  std::vector<double> radiance() const {
    std::vector<double> mean(std::size_t(replicates.cols()), 0.0);
    for (Eigen::Index k = 0; k < replicates.cols(); ++k) mean[std::size_t(k)] = replicates.col(k).mean();
    return mean;
  }
  /// Standard errors of radiance(), from the scatter of the replicates.
  std::vector<double> error() const { return standard_error(replicates); }
};

}  // namespace lumo
