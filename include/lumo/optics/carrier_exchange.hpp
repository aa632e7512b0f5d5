#pragma once

#include "lumo/optics/face_set.hpp"
#include "lumo/optics/ledger.hpp"
#include "lumo/optics/path_tracer.hpp"

#include <utility>
#include <vector>

namespace lumo::detail {

/// Adds `factor` × the accounts of `part`, `emitted` too.
inline void add(EnergyLedger& sum, const EnergyLedger& part, double factor) {
  for (std::size_t c = 0; c < sum.channels.size(); ++c) sum.channels[c] += factor * part.channels[c];
  sum.emitted += factor * part.emitted;
  sum.to_indenter += factor * part.to_indenter;
  sum.elsewhere += factor * part.elsewhere;
  sum.absorbed_in_medium += factor * part.absorbed_in_medium;
  sum.absorbed_at_surfaces += factor * part.absorbed_at_surfaces;
  sum.roulette += factor * part.roulette;
  sum.refinement += factor * part.refinement;
  sum.lost += factor * part.lost;
}

/// All light that falls on a Lambertian face of the body from inside goes on as one uniform Lambertian source (radiosity: Goral et al.
/// 1984). Which rays a face sends does not depend on what arrives, so that states differ smoothly, and further bounces cost no rays. Sends
/// on what arrived on the faces, bounce after bounce, until less than 1e-13 of the emitted power is under way. `from_face`: where one watt
/// from each face goes. `total`: the emitters' own tally, completed here. Returns what each face sent [W]. Jacobi iteration of the
/// radiosity equation p = e + Tᵀ(albedo·p); it ends because every factor is at most 1.
inline std::vector<double> exchange(const std::vector<double>& albedo, const std::vector<Tally>& from_face, Tally& total) {
  std::vector<double> now(albedo.size(), 0.0), next(albedo.size(), 0.0), sent(albedo.size(), 0.0);
  for (const auto& [k, power] : total.arrived) now[std::size_t(k)] = power;
  EnergyLedger& ledger = total.ledger;
  const double emitted = ledger.emitted;
  double left = 0.0;
  for (int bounce = 0; bounce < 10000; ++bounce) {
    left = 0.0;
    for (std::size_t k = 0; k < albedo.size(); ++k) {
      const double on = now[k] * albedo[k];
      ledger.absorbed_at_surfaces += now[k] - on;
      sent[k] += on;
      if (on > 0.0)
        for (const auto& [j, share] : from_face[k].arrived) next[std::size_t(j)] += on * share;
    }
    for (double p : next) left += p;
    now.swap(next);
    std::fill(next.begin(), next.end(), 0.0);
    if (left < 1e-13 * emitted) break;
  }
  for (std::size_t k = 0; k < albedo.size(); ++k) {
    add(ledger, from_face[k].ledger, sent[k]);
    for (std::size_t c = 0; c < total.gathered.size(); ++c) total.gathered[c] += sent[k] * from_face[k].gathered[c];
  }
  ledger.emitted = emitted;
  ledger.lost += left;
  return sent;
}

}  // namespace lumo::detail
