#pragma once

#include "lumo/sense/devices/actuator.hpp"
#include "lumo/sense/devices/camera.hpp"

#include <cstdint>
#include <optional>
#include <utility>

namespace lumo::sense {

/// A recorded stream given as it came: nothing is there before its time. One item is read ahead, so that reading a
/// picture does not count to whoever asks for it.
template <class Source> class Replay {
 public:
  explicit Replay(Source source) : source_(std::move(source)), ahead_(source_.next()) {}

  /// Lets all up to this time through.
  void until(std::int64_t now_ns) {
    now_ns_ = now_ns;
    if (!ahead_) ahead_ = source_.next();
  }
  auto next() {
    if (!ahead_ || ahead_->stamp_ns > now_ns_) return decltype(ahead_)();
    auto item = std::move(ahead_);
    ahead_.reset();
    if constexpr (Actuator<Source>)
      ahead_ = source_.next();  // owns what it gives; a picture stays valid until the next one is read
    return item;
  }
  StreamState state() const { return ahead_ ? StreamState::open : source_.state(); }

 private:
  Source source_;
  decltype(std::declval<Source&>().next()) ahead_;
  std::int64_t now_ns_ = INT64_MIN;
};

}  // namespace lumo::sense
