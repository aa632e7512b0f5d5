#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/statistics.hpp"

#include <cmath>
#include <optional>
#include <span>

namespace lumo::sense {

/// Finds when a force sensor first feels the contact.
struct OnsetDetector {
  int baseline = 20;          ///< samples at the start that are without contact
  double threshold = 5.0;     ///< standard deviations of the baseline
  double min_force_N = 0.05;  ///< above the baseline's mean, however quiet it was
  int hold = 3;               ///< samples in a row that must lie above
  /// Samples from the crossing on, through which a line goes back to the baseline; 0: take the crossing itself
  int fit = 5;

  /// Place of the onset in samples (fractional), and the force's baseline there.
  struct Onset {
    double sample = 0.0;
    double baseline_N = 0.0;
  };
  /// nullopt if the force stays below the threshold. Throws InvalidArgument for too few samples or forces that are
  /// not finite.
  std::optional<Onset> find(std::span<const double> force_N) const {
    require_in_range("samples without contact", baseline, 2, 1e9, "");
    require_in_range("samples above the threshold", hold, 1, 1e6, "");
    require_in_range("threshold of the onset", threshold, 0.0, 1e6, "standard deviations");
    require_in_range("least force of the onset", min_force_N, 0.0, 1e6, "N");
    require_in_range("samples of the onset's line", fit, 0, 1e6, "");
    const auto n = std::ptrdiff_t(force_N.size());
    if (n <= baseline)
      throw InvalidArgument(message("onset: ", n, " forces, must have more than the ", baseline, " without contact"));
    for (const double f : force_N)
      if (!std::isfinite(f)) throw InvalidArgument("onset: forces must be finite");
    double mean = 0.0, squares = 0.0;
    for (int i = 0; i < baseline; ++i) mean += force_N[std::size_t(i)] / baseline;
    for (int i = 0; i < baseline; ++i) squares += std::pow(force_N[std::size_t(i)] - mean, 2);
    const double limit = mean + std::max(threshold * std::sqrt(squares / (baseline - 1)), min_force_N);
    int above = 0;
    for (std::ptrdiff_t i = baseline; i < n; ++i) {
      above = force_N[std::size_t(i)] > limit ? above + 1 : 0;
      if (above < hold) continue;
      const double first = double(i - hold + 1);
      // The force has risen before it crosses: a line through the next samples goes back to where it left the baseline.
      double si = 0.0, sf = 0.0, sii = 0.0, sif = 0.0;
      int count = 0;
      for (auto k = std::ptrdiff_t(first); k < n && count < fit; ++k, ++count) {
        const double t = double(k) - first, f = force_N[std::size_t(k)] - mean;
        si += t;
        sf += f;
        sii += t * t;
        sif += t * f;
      }
      const double det = count * sii - si * si, slope = det > 0.0 ? (count * sif - si * sf) / det : 0.0;
      if (!(slope > 0.0)) return Onset{first, mean};
      const double at = (sf - slope * si) / count;  // of the line, at the crossing
      return Onset{std::clamp(first - at / slope, double(baseline - 1), first), mean};
    }
    return std::nullopt;
  }
};

/// How far the marker on the indenter goes from contact onset until the force (above its baseline) first reaches
/// `force_N`, interpolated linearly [m]. nullopt if there is no onset or the force is not reached. Both series at the
/// same times.
inline std::optional<double> displacement_from_onset(std::span<const double> force, std::span<const double> marker_m,
    double force_N, const OnsetDetector& detector = {}) {
  if (force.size() != marker_m.size())
    throw InvalidArgument(
        message("displacement: ", force.size(), " forces and ", marker_m.size(), " marker places, must be as many"));
  require_positive("force to reach", force_N, "N");
  for (const double x : marker_m)
    if (!std::isfinite(x)) throw InvalidArgument("displacement: marker places must be finite");
  const auto onset = detector.find(force);
  if (!onset) return std::nullopt;
  const auto marker_at = [&](double sample) {
    const auto i = std::min(std::size_t(sample), marker_m.size() - 1), j = std::min(i + 1, marker_m.size() - 1);
    return marker_m[i] + (sample - double(i)) * (marker_m[j] - marker_m[i]);
  };
  const double target = onset->baseline_N + force_N;
  for (auto i = std::size_t(std::floor(onset->sample)) + 1; i < force.size(); ++i)
    if (force[i] >= target) {
      const double before = force[i - 1], step = force[i] - before;
      const double reached =
          before >= target || !(step > 0.0) ? double(i - 1) : double(i - 1) + (target - before) / step;
      return std::abs(marker_at(reached) - marker_at(onset->sample));
    }
  return std::nullopt;
}

/// Progressive-Constraint Gain [%]: by how much less the indenter sinks in from onset to the load than into the
/// baseline (paper, contact cycling).
inline double progressive_constraint_gain_percent(double displacement_m, double baseline_m) {
  require_positive("baseline's displacement", baseline_m, "m");
  require_in_range("displacement", displacement_m, 0.0, 1e3, "m");
  return 100.0 * (1.0 - displacement_m / baseline_m);
}

}  // namespace lumo::sense
