#pragma once

#include "lumo/core/types.hpp"
#include "lumo/optics/exit_power.hpp"
#include "lumo/optics/optical_scene.hpp"
#include "lumo/optics/response.hpp"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace lumo {

/// Power of some paths: booked, or arrived at nodes of Lambertian faces (index, power), from where it
/// goes on.
struct Tally {
  EnergyLedger ledger;
  std::vector<double> direct;    ///< part of the channels: direct light, but not what `gathered` has
  std::vector<double> gathered;  ///< part of the channels that NextEventGather finds with less noise
  std::vector<std::pair<int, double>> arrived;
};

/// Light from an emitter that left the body for good after reflections.
struct Exit {
  std::uint64_t route;  ///< the same for paths that met the same surfaces in the same way
  Escape light;         ///< of the traced one of the mirror images; its region is not looked up
  ScenePoint at;
  Vec3d normal;  ///< of the flat facet
  int patch;
  double power;  ///< [W], of one image
};

/// Accounts of the power of paths. A traced path stands for all its mirror images.
template <ExitReadout Readout> class LightAccounts {
 public:
  LightAccounts(const OpticalScene& surface, const Readout& readout, int channels, std::size_t nodes, Symmetry symmetry)
      : surface_(surface), readout_(readout), channels_(std::size_t(channels)), arrived_(nodes, 0.0) {
    for (unsigned image = 0; image < 4; ++image)
      if (!((image & 1u) && !symmetry.x) && !((image & 2u) && !symmetry.y)) images_.push_back(image);
    reset();
  }

  const std::vector<unsigned>& images() const { return images_; }
  std::size_t channels() const { return channels_; }

  /// `power` [W] of one image, for all of them.
  void book(double& account, double power) { account += power * double(images_.size()); }
  /// Light that falls on a Lambertian face.
  void arrive(int node, double power) {
    double& sum = arrived_[std::size_t(node)];
    if (!(sum > 0.0)) reached_.push_back(node);
    book(sum, power);
  }
  /// Books an exit in a channel, or elsewhere (−1). `power` is that of one image.
  void book_exit(int channel, double power) {
    (seen(channel) ? ledger.channels[std::size_t(channel)] : ledger.elsewhere) += power;
  }
  /// Books an exit of all images. `is_direct`: refracted out at most; `is_gathered`: NextEventGather finds it, too.
  void book_exit(const Exit& e, bool is_direct, bool is_gathered) {
    for (unsigned image : images_) {
      const int c = channel(e, image);
      book_exit(c, e.power);
      if (!seen(c)) continue;
      if (is_gathered) gathered_[std::size_t(c)] += e.power;
      else if (is_direct) direct_[std::size_t(c)] += e.power;
    }
  }
  /// Books what stays of light on an opaque patch, of all images. `power` is that of one.
  void book_landing(const Landing& l, double power) {
    for (unsigned image : images_) {
      int c = -1;
      if constexpr (LandingReadout<Readout>) {
        const Vec3d m = signs(image);
        c = readout_.landing_channel(
            {m.cwiseProduct(l.reference), m.cwiseProduct(l.position), m.cwiseProduct(l.direction), l.patch});
      }
      (seen(c) ? ledger.channels[std::size_t(c)] : ledger.absorbed_at_surfaces) += power;
    }
  }
  /// Channel of an exit, or −1.
  int channel(const Exit& e, unsigned image) const {
    const Vec3d m = signs(image);
    const Vec3d out = m.cwiseProduct(e.light.direction);
    const int region = e.at.face >= 0 ? surface_.region(e.at, image)
                                      : surface_.region(e.patch, e.light.reference, e.light.position, image);
    return readout_.channel(
        {m.cwiseProduct(e.light.reference), m.cwiseProduct(e.light.position), out, surface_.seen_region(region, out)});
  }

  /// All that was booked since the last call.
  Tally take() {
    Tally t{std::move(ledger), std::move(direct_), std::move(gathered_), {}};
    for (int k : reached_) {
      t.arrived.emplace_back(k, arrived_[std::size_t(k)]);
      arrived_[std::size_t(k)] = 0.0;
    }
    reached_.clear();
    reset();
    return t;
  }
  /// Σ weight(node)·(power that arrived there), for all that arrived since the last call; forgets everything else that
  /// was booked.
  template <class Weight> double collect(Weight&& weight) {
    double sum = 0.0;
    for (int k : reached_) {
      sum += weight(std::size_t(k)) * arrived_[std::size_t(k)];
      arrived_[std::size_t(k)] = 0.0;
    }
    reached_.clear();
    return sum;
  }

  EnergyLedger ledger;

 private:
  static Vec3d signs(unsigned image) { return {image & 1u ? -1.0 : 1.0, image & 2u ? -1.0 : 1.0, 1.0}; }
  bool seen(int channel) const { return channel >= 0 && std::size_t(channel) < ledger.channels.size(); }
  void reset() {
    ledger = {};
    ledger.channels.assign(channels_, 0.0);
    direct_ = ledger.channels;
    gathered_ = ledger.channels;
  }

  const OpticalScene& surface_;
  const Readout& readout_;
  std::size_t channels_;
  std::vector<unsigned> images_;
  std::vector<double> direct_, gathered_;  ///< as in Tally
  std::vector<double> arrived_;            ///< per node
  std::vector<int> reached_;               ///< nodes with arrived_ > 0
};

}  // namespace lumo
