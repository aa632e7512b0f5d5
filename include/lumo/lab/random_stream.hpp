#pragma once

#include "lumo/core/sobol.hpp"
#include "lumo/core/units.hpp"
#include "lumo/lab/rig.hpp"

#include <cmath>
#include <cstdint>

namespace lumo {

/// Random numbers by counting: what is drawn depends on the seed, the stream's number and the count, not on what was
/// drawn elsewhere. The same on every machine up to its mathematical functions' last bit.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t stream) : key_(combine(combine(0x1ab0ull, seed), stream)) {}

  double uniform() { return lumo::uniform(combine(key_, count_++)); }
  /// Standard normal (Box & Muller 1958); each pair of uniforms gives two.
  double normal() {
    if (spare_) return spare_ = false, second_;
    const double r = std::sqrt(-2.0 * std::log(uniform())), a = 2.0 * pi * uniform();
    second_ = r * std::sin(a);
    spare_ = true;
    return r * std::cos(a);
  }

 private:
  std::uint64_t key_, count_ = 0;
  double second_ = 0.0;
  bool spare_ = false;
};

/// First-order Gauss–Markov noise of standard deviation 1.
class SlowNoise {
 public:
  SlowNoise(RandomStream draws, double time_s) : draws_(draws), time_s_(time_s), value_(draws_.normal()) {}
  /// At a time not before the last one.
  double at(double t_s) {
    const double keep = std::exp(-(t_s - t_s_) / time_s_);
    value_ = keep * value_ + std::sqrt(1.0 - keep * keep) * draws_.normal();
    t_s_ = t_s;
    return value_;
  }

 private:
  RandomStream draws_;
  double time_s_, value_, t_s_ = 0.0;
};

/// How much brighter lamps are than their mean, relative: slowly together, and frame by frame; standard deviations as
/// the rig has them. Takes the streams `first` and `first` + 2.
class LampNoise {
 public:
  LampNoise(const LightRig& rig, std::uint64_t seed, std::uint64_t first)
      : drift_(rig.lamp_drift),
        white_(rig.lamp_white),
        slow_(RandomStream(seed, first), rig.lamp_drift_s),
        fast_(seed, first + 2) {}
  double at(double t_s) {
    const double slow = drift_ * slow_.at(t_s);
    return slow + white_ * fast_.normal();
  }

 private:
  double drift_, white_;
  SlowNoise slow_;
  RandomStream fast_;
};

}  // namespace lumo
