#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <vector>

namespace lumo::sense {

/// A force by torque and place, as the given torque constants have it, and the truth.
struct TorqueForce {
  int sequence = 0;           ///< number of the contact that the sample is of
  double true_y_m = 0.0;      ///< of that contact
  double force_N = 0.0;       ///< α = 1; below 0 counts as 0
  double true_force_N = 0.0;  ///< of the force sensor
};

/// One sequence with its own factor, and with that of all others.
struct SequenceScale {
  int sequence = 0, samples = 0;
  double y_m = 0.0;
  double alpha = 1.0, mae_in_sample_N = 0.0;                ///< fitted on this sequence, and judged on it
  double alpha_of_others = 1.0, mae_out_of_sample_N = 0.0;  ///< fitted on all others, judged on this one
};

/// Mean absolute errors [N] of F = max(0, α F₁), where F₁ is the force as the given torque constants have it and α is
/// fitted to true forces.
struct TorqueScale {
  std::vector<SequenceScale> sequences;
  SequenceScale fitted_on;           ///< the one whose α the next two are of
  double mae_in_sample_N = 0.0;      ///< over all samples, those that α was fitted on included
  double mae_without_it_N = 0.0;     ///< over the samples of the other sequences
  double mae_out_of_sample_N = 0.0;  ///< over all samples, each with the α fitted on the other sequences
};

namespace detail {

/// Least squares over the samples of chosen sequences; nullopt where all their forces are 0.
template <class Chosen> std::optional<double> fitted_alpha(std::span<const TorqueForce> samples, Chosen chosen) {
  double products = 0.0, squares = 0.0;
  for (const TorqueForce& s : samples)
    if (chosen(s.sequence)) {
      const double force = std::max(0.0, s.force_N);
      products += force * s.true_force_N;
      squares += force * force;
    }
  return squares > 0.0 ? std::optional(products / squares) : std::nullopt;
}

template <class Chosen> double mean_error_N(std::span<const TorqueForce> samples, double alpha, Chosen chosen) {
  double sum = 0.0;
  int n = 0;
  for (const TorqueForce& s : samples)
    if (chosen(s.sequence)) {
      sum += std::abs(std::max(0.0, alpha * s.force_N) - s.true_force_N);
      ++n;
    }
  return n > 0 ? sum / n : 0.0;
}

}  // namespace detail

/// What a factor α from torque to force is worth that was fitted, by least squares through the origin, on the samples
/// it is judged by, and on others. The paper's authors fit α on one of the six sequences that their MAE is taken over
/// (dokkev/fingertip-design-framework, fig6d_force_timeseries.py); `fitted_on` is that sequence here. One sequence left
/// out shows what contacts err by whose forces were not measured before. nullopt for fewer than two sequences, or one
/// whose forces are all 0. Throws InvalidArgument for numbers that are not finite, or where no sample is of
/// `fitted_on`.
inline std::optional<TorqueScale> torque_scale(std::span<const TorqueForce> samples, int fitted_on = 0) {
  std::map<int, SequenceScale> sequences;
  for (const TorqueForce& s : samples) {
    require_in_range("force of the torque scale", s.force_N, -1e6, 1e6, "N");
    require_in_range("true force of the torque scale", s.true_force_N, -1e6, 1e6, "N");
    require_in_range("place of the torque scale", s.true_y_m, -10.0, 10.0, "m");
    SequenceScale& of = sequences[s.sequence];
    of.sequence = s.sequence;
    of.y_m += (s.true_y_m - of.y_m) / double(++of.samples);
  }
  if (sequences.size() < 2) return std::nullopt;
  const auto from = sequences.find(fitted_on);
  if (from == sequences.end())
    throw InvalidArgument(message("torque scale: there is no sequence ", fitted_on, " to fit alpha on"));
  TorqueScale scale;
  for (auto& entry : sequences) {
    SequenceScale& s = entry.second;
    const auto here = [&](int sequence) { return sequence == s.sequence; };
    const auto elsewhere = [&](int sequence) { return sequence != s.sequence; };
    const auto own = detail::fitted_alpha(samples, here), others = detail::fitted_alpha(samples, elsewhere);
    if (!own || !others) return std::nullopt;
    s.alpha = *own;
    s.alpha_of_others = *others;
    s.mae_in_sample_N = detail::mean_error_N(samples, *own, here);
    s.mae_out_of_sample_N = detail::mean_error_N(samples, *others, here);
    scale.mae_out_of_sample_N += s.mae_out_of_sample_N * s.samples / double(samples.size());
    scale.sequences.push_back(s);
  }
  scale.fitted_on = from->second;
  const double alpha = scale.fitted_on.alpha;
  scale.mae_in_sample_N = detail::mean_error_N(samples, alpha, [](int) { return true; });
  scale.mae_without_it_N = detail::mean_error_N(samples, alpha, [&](int sequence) { return sequence != fitted_on; });
  return scale;
}

}  // namespace lumo::sense
