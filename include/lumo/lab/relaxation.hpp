#pragma once

#include "lumo/lab/rig.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace lumo {

/// What load would, in equilibrium, give the deformation that a pad has now: it lags behind the load on it (Prony
/// series; generalised Maxwell body). With the equilibrium modulus for unit, load = e + Σ w_k h_k, where h_k' = e' −
/// h_k/τ_k and w_k = part_k/(1 − Σ part).
class Relaxation {
 public:
  explicit Relaxation(const SiliconeRig& rig) : time_s_(rig.time_s) {
    double rest = 1.0;
    for (const double g : rig.part) rest -= g;
    for (std::size_t k = 0; k < weight_.size(); ++k) weight_[k] = rig.part[k] / rest;
  }

  /// Goes on by `dt_s` to the load [N] that is then there; e changes linearly within the step, for which the branches
  /// are exact. Returns e, never below 0.
  double step(double load_N, double dt_s) {
    double lag = 0.0, whole = 1.0;
    std::array<double, 3> keep{}, gain{};
    for (std::size_t k = 0; k < weight_.size(); ++k) {
      keep[k] = std::exp(-dt_s / time_s_[k]);
      gain[k] = (1.0 - keep[k]) * time_s_[k] / dt_s;
      lag += weight_[k] * (keep[k] * branch_[k] - gain[k] * equivalent_N_);
      whole += weight_[k] * gain[k];
    }
    const double next = std::max(0.0, (load_N - lag) / whole);
    for (std::size_t k = 0; k < weight_.size(); ++k)
      branch_[k] = keep[k] * branch_[k] + gain[k] * (next - equivalent_N_);
    return equivalent_N_ = next;
  }
  double equivalent_N() const { return equivalent_N_; }

 private:
  std::array<double, 3> time_s_, weight_{}, branch_{};
  double equivalent_N_ = 0.0;
};

}  // namespace lumo
