#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/devices/device.hpp"

#include <utility>

namespace lumo::sense {

/// One reading of a row of photodiodes.
struct PhotodiodeSample {
  std::int64_t stamp_ns = 0;
  Eigen::VectorXd signal_V;
};

/// A row of photodiodes along the finger: the readout without a camera. Values are photocurrents in units of the
/// calibration, (V − dark) · scale.
class PhotodiodeArray {
 public:
  using Sample = PhotodiodeSample;

  struct Config {
    Eigen::VectorXd position_m;  ///< along the finger, ascending
    Eigen::VectorXd dark_V;      ///< without light; empty: 0
    Eigen::VectorXd scale;       ///< per volt; empty: 1
    double full_scale_V = 3.3;   ///< of the converter
  };

  /// Throws InvalidArgument for lengths that differ, positions that do not ascend, or numbers that are not finite.
  explicit PhotodiodeArray(Config config) : config_(std::move(config)) {
    const Eigen::Index n = config_.position_m.size();
    if (n < 2) throw InvalidArgument(message("photodiode array has ", n, " diodes, must have at least 2"));
    if (config_.dark_V.size() == 0) config_.dark_V = Eigen::VectorXd::Zero(n);
    if (config_.scale.size() == 0) config_.scale = Eigen::VectorXd::Ones(n);
    if (config_.dark_V.size() != n || config_.scale.size() != n)
      throw InvalidArgument(message("photodiode array has ", n, " positions, ", config_.dark_V.size(),
          " dark values and ", config_.scale.size(), " scales, must be as many"));
    if (!config_.position_m.allFinite() || !config_.dark_V.allFinite() || !config_.scale.allFinite())
      throw InvalidArgument("photodiode array: numbers must be finite");
    for (Eigen::Index i = 1; i < n; ++i)
      if (!(config_.position_m[i] > config_.position_m[i - 1]))
        throw InvalidArgument(message("photodiode ", i, " is at ", config_.position_m[i],
            " m, must lie beyond its predecessor at ", config_.position_m[i - 1], " m"));
    require_positive("photodiode full scale", config_.full_scale_V, "V");
  }

  bool read(const PhotodiodeSample& sample, Profile& profile) const {
    if (sample.signal_V.size() != config_.position_m.size() || !sample.signal_V.allFinite()) return false;
    profile.stamp_ns = sample.stamp_ns;
    profile.value = (sample.signal_V - config_.dark_V).cwiseProduct(config_.scale);
    profile.saturated =
        double((sample.signal_V.array() >= config_.full_scale_V).count()) / double(sample.signal_V.size());
    return true;
  }
  const Eigen::VectorXd& positions_m() const { return config_.position_m; }

 private:
  Config config_;
};

static_assert(Readout<PhotodiodeArray>);

}  // namespace lumo::sense
