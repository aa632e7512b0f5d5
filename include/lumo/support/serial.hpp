#pragma once

// Serial lines (POSIX termios): a row of photodiodes behind a microcontroller. It has not met hardware yet; tested over
// a pseudo-terminal and a pipe.

#include "lumo/core/error.hpp"
#include "lumo/core/stopwatch.hpp"
#include "lumo/sense/devices/photodiodes.hpp"
#include "lumo/sense/devices/stream.hpp"
#include "lumo/support/process/descriptor.hpp"

#include <termios.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace lumo {

/// Photodiode readings as lines of text, one for each: volts separated by commas, `2.031,1.997,…`. Stamped when they
/// are read, on CLOCK_MONOTONIC. Lines that are not such are left out and counted.
class SerialPhotodiodes {
 public:
  struct Config {
    int diodes = 8;
    int baud = 115200;
    std::int64_t (*now)() = steady_ns;
  };

  /// On a serial device, which is set to raw 8N1 without flow control. What comes before the first line's end is left
  /// out: it may be a line's rest and read as another number. Throws InputError.
  static SerialPhotodiodes open(const std::string& device, const Config& config) {
    Descriptor port(::open(device.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (port.get() < 0) throw InputError(message(device, ": cannot be opened: ", std::strerror(errno)));
    termios settings{};
    if (::tcgetattr(port.get(), &settings) != 0) throw InputError(message(device, ": is no serial line"));
    ::cfmakeraw(&settings);
    settings.c_cflag = (settings.c_cflag & ~tcflag_t(CSTOPB | CRTSCTS)) | CLOCAL | CREAD;
    speed_t speed = B0;
    using Rates = std::initializer_list<std::pair<int, speed_t>>;
    for (const auto& [baud, constant] : Rates{{9600, B9600},
                                              {57600, B57600},
                                              {115200, B115200},
                                              {230400, B230400},
                                              {460800, B460800},
                                              {921600, B921600}})
      if (config.baud == baud) speed = constant;
    if (speed == B0)
      throw InvalidArgument(
          message("baud rate is ", config.baud, ", must be 9600, 57600, 115200, 230400, 460800 or 921600"));
    ::cfsetspeed(&settings, speed);
    if (::tcsetattr(port.get(), TCSANOW, &settings) != 0)
      throw InputError(message(device, ": does not take its settings: ", std::strerror(errno)));
    ::tcflush(port.get(), TCIFLUSH);
    SerialPhotodiodes diodes(std::move(port), config);
    diodes.begun_ = false;
    return diodes;
  }

  /// On anything that can be read. Throws InvalidArgument for no diodes.
  SerialPhotodiodes(Descriptor source, const Config& config) : source_(std::move(source)), config_(config) {
    require_in_range("number of photodiodes", config.diodes, 1, 256, "");
    source_.do_not_block();
  }

  /// The next reading, if one has come whole. Never waits.
  std::optional<sense::PhotodiodeSample> next() {
    for (;;) {
      for (auto end = buffer_.find('\n'); end != std::string::npos; end = buffer_.find('\n')) {
        const bool whole = begun_ && !overlong_;
        const std::optional<sense::PhotodiodeSample> s =
            whole ? parse(std::string_view(buffer_).substr(0, end)) : std::nullopt;
        buffer_.erase(0, end + 1);
        bad_lines_ += begun_ && !s;
        overlong_ = false;
        begun_ = true;
        if (s) return s;
      }
      if (buffer_.size() > max_line) buffer_.clear(), overlong_ = true;
      if (state_ != sense::StreamState::open) return std::nullopt;
      char some[1024];
      const ssize_t size = ::read(source_.get(), some, sizeof some);
      if (size > 0) {
        buffer_.append(some, std::size_t(size));
      } else if (size < 0 && errno == EINTR) {
        continue;
      } else if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
        return std::nullopt;
      } else {
        state_ = sense::StreamState::failed;  // hung up
      }
    }
  }
  sense::StreamState state() const { return state_; }
  long bad_lines() const { return bad_lines_; }

 private:
  static constexpr std::size_t max_line = 8192;

  std::optional<sense::PhotodiodeSample> parse(std::string_view line) const {
    if (line.ends_with('\r')) line.remove_suffix(1);
    sense::PhotodiodeSample s{config_.now(), Eigen::VectorXd(config_.diodes)};
    const char *at = line.data(), *end = at + line.size();
    for (int i = 0; i < config_.diodes; ++i) {
      if (i > 0 && (at == end || *at++ != ',')) return std::nullopt;
      while (at != end && *at == ' ') ++at;
      const auto [stop, error] = std::from_chars(at, end, s.signal_V[i]);
      if (error != std::errc() || !std::isfinite(s.signal_V[i])) return std::nullopt;
      at = stop;
    }
    return at == end ? std::optional(std::move(s)) : std::nullopt;
  }

  Descriptor source_;
  Config config_;
  std::string buffer_;
  bool overlong_ = false, begun_ = true;
  sense::StreamState state_ = sense::StreamState::open;
  long bad_lines_ = 0;
};

}  // namespace lumo
