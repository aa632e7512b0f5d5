#pragma once

#include "lumo/optics/ledger.hpp"
#include "lumo/optics/transport/light_nodes.hpp"
#include "lumo/optics/transport/path_tracer.hpp"

#include <array>
#include <vector>

namespace lumo {

/// Adds `factor` × the accounts of `part`, `emitted` too.
inline void add_scaled(EnergyLedger& sum, const EnergyLedger& part, double factor) {
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

/// Where one watt from each node of Lambertian faces goes.
class RadiosityTransport {
 public:
  RadiosityTransport(std::size_t nodes, int channels) : sums_(nodes), weights_(nodes, 0.0) {
    for (Tally& t : sums_) t.gathered.assign(std::size_t(channels), 0.0), t.ledger.channels = t.gathered;
  }
  /// Adds what became of a ray of one watt that stands for the area `area_m2` about a point with these shares of the
  /// nodes.
  void add(const Tally& ray, const std::array<int, 3>& nodes, const std::array<double, 3>& shares, double area_m2) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double w = shares[k] * area_m2;
      Tally& sum = sums_[std::size_t(nodes[k])];
      weights_[std::size_t(nodes[k])] += w;
      add_scaled(sum.ledger, ray.ledger, w);
      for (std::size_t c = 0; c < sum.gathered.size(); ++c) sum.gathered[c] += w * ray.gathered[c];
      for (const auto& [j, power] : ray.arrived) sum.arrived.emplace_back(j, w * power);
    }
  }
  std::size_t size() const { return sums_.size(); }
  const Tally& sum(std::size_t node) const { return sums_[node]; }
  /// What sum(node) is to be multiplied by; 0 where nothing was added.
  double per_watt(std::size_t node) const { return weights_[node] > 0.0 ? 1.0 / weights_[node] : 0.0; }

 private:
  std::vector<Tally> sums_;
  std::vector<double> weights_;
};

/// Light that falls on a Lambertian face goes on as a Lambertian source that is linear between nodes (radiosity: Goral
/// et al. 1984). Which rays a face sends does not depend on what arrives, so that states differ smoothly, and further
/// bounces cost no rays. Sends on what arrived at the nodes, bounce after bounce, until less than 1e-13 of the emitted
/// power is under way. `total`: the emitters' own tally, completed here. Returns what each node sent [W]. Jacobi
/// iteration of the radiosity equation p = e + Tᵀ(albedo·p); it ends because every factor is at most 1.
inline std::vector<double> exchange(const LightNodes& nodes, const RadiosityTransport& transport, Tally& total) {
  std::vector<double> now(nodes.size(), 0.0), next(nodes.size(), 0.0), sent(nodes.size(), 0.0);
  for (const auto& [k, power] : total.arrived) now[std::size_t(k)] += power;
  EnergyLedger& ledger = total.ledger;
  const double emitted = ledger.emitted;
  double left = 0.0;
  for (int bounce = 0; bounce < 10000; ++bounce) {
    left = 0.0;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const double on = now[k] * nodes.albedo(k);
      ledger.absorbed_at_surfaces += now[k] - on;
      sent[k] += on;
      const double each = on * transport.per_watt(k);
      if (each > 0.0)
        for (const auto& [j, share] : transport.sum(k).arrived) next[std::size_t(j)] += each * share;
    }
    for (double p : next) left += p;
    now.swap(next);
    std::fill(next.begin(), next.end(), 0.0);
    if (left < 1e-13 * emitted) break;
  }
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const double each = sent[k] * transport.per_watt(k);
    add_scaled(ledger, transport.sum(k).ledger, each);
    for (std::size_t c = 0; c < total.gathered.size(); ++c) total.gathered[c] += each * transport.sum(k).gathered[c];
  }
  ledger.emitted = emitted;
  ledger.lost += left;
  return sent;
}

}  // namespace lumo
