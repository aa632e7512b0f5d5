#pragma once

// Decodes a video in a process of its own: decoders are large, their input may be anything. Linux.

#include "lumo/core/error.hpp"
#include "lumo/sense/devices/device.hpp"
#include "lumo/support/process/fork_server_process.hpp"

#include <unistd.h>

#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>

namespace lumo {

/// What decodes. open() gives the file's frame rate [1/s], nullopt for what is no video; next() a view that holds until
/// the next call, empty for a frame that cannot be shown, nullopt at the end.
template <class S>
concept VideoSource = std::move_constructible<S> && requires(S& source, const std::string& path) {
  { source.open(path) } -> std::same_as<std::optional<double>>;
  { source.next() } -> std::same_as<std::optional<sense::ImageView>>;
};

/// A process that decodes one video, frame by frame as asked for. Whatever it does, the caller sees frames, an end or a
/// failure.
class VideoProcess {
 public:
  struct Limits {
    double open_s = 20.0, frame_s = 20.0;  ///< until it is killed
    /// Address space on top of this process's own; not applied under AddressSanitizer
    std::uint64_t memory_bytes = std::uint64_t{2} << 30;
  };
  enum class Got { frame, end, failed };

  template <VideoSource Source> VideoProcess(Source source, const std::string& path, const Limits& limits)
      : limits_(limits) {
    int ends[2];
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return;
    pid_ = ::fork();
    if (pid_ == 0) serve(ends[1], std::move(source), path, limits);  // never returns
    ::close(ends[1]);
    socket_ = ends[0];
    Reply reply{};
    if (pid_ < 0 || receive_all(socket_, &reply, sizeof reply, Deadline(limits.open_s)) != Transfer::done ||
        reply.kind != Reply::opened)
      stop();
    else rate_ = reply.rate;
  }
  ~VideoProcess() { stop(); }
  VideoProcess(const VideoProcess&) = delete;
  VideoProcess& operator=(const VideoProcess&) = delete;

  bool is_open() const { return socket_ >= 0; }
  double rate() const { return rate_; }  ///< [1/s]; what the file says, perhaps nonsense
  int pid() const { return pid_; }       ///< −1 when it has gone

  /// `image` has no pixels for a frame that cannot be shown.
  Got next(sense::Image& image) {
    if (!is_open()) return Got::failed;
    const Deadline deadline(limits_.frame_s);
    Reply reply{};
    const char ask = 'n';
    bool good = send_all(socket_, &ask, 1, deadline) == Transfer::done &&
                receive_all(socket_, &reply, sizeof reply, deadline) == Transfer::done;
    if (good && reply.kind == Reply::end) return Got::end;
    const bool blank = reply.width == 0 && reply.height == 0;
    good = good && reply.kind == Reply::frame && (blank || sense::is_image_size(reply.width, reply.height));
    if (good) {
      image = blank ? sense::Image{}
                    : sense::Image::black(reply.width, reply.height,
                          reply.grey != 0 ? sense::PixelFormat::grey : sense::PixelFormat::bgr);
      good = receive_all(socket_, image.pixels.data(), image.pixels.size(), deadline) == Transfer::done;
    }
    if (good) return Got::frame;
    stop();
    return Got::failed;
  }

 private:
  struct Reply {
    enum Kind : std::int32_t { opened = 1, frame, end };
    std::int32_t kind, width, height, grey;
    double rate;
  };

  template <VideoSource Source>
  [[noreturn]] static void serve(int socket, Source source, std::string path, const Limits& limits) {
    const int host = leave_host(socket);
    if (limit_address_space && limits.memory_bytes > 0) {
      const std::uint64_t total = own_memory(0) + limits.memory_bytes;
      set_limit(RLIMIT_AS, total, total);
    }
    const Deadline never(1e9);
    // Should the host go while this hangs, nobody else ends it.
    const auto last_moment = [](double seconds) { ::alarm(unsigned(std::ceil(std::min(seconds, 1e6))) + 5u); };
    try {
      last_moment(limits.open_s);
      const std::optional<double> rate = source.open(path);
      if (!rate) ::_exit(exit_threw);
      const Reply opened{Reply::opened, 0, 0, 0, *rate};
      if (send_all(host, &opened, sizeof opened, never) != Transfer::done) ::_exit(0);
      for (;;) {
        ::alarm(0);
        char ask = 0;
        if (receive_all(host, &ask, 1, never) != Transfer::done) ::_exit(0);
        last_moment(limits.frame_s);
        const std::optional<sense::ImageView> view = source.next();
        const Reply reply{view ? Reply::frame : Reply::end, view ? view->width : 0, view ? view->height : 0,
            view && view->format == sense::PixelFormat::grey, 0.0};
        if (send_all(host, &reply, sizeof reply, never) != Transfer::done) ::_exit(0);
        for (int y = 0; y < reply.height; ++y)
          if (send_all(host, view->row(y), std::size_t(view->width) * std::size_t(channels(view->format)), never) !=
              Transfer::done)
            ::_exit(0);
      }
    } catch (...) {
      ::_exit(exit_threw);
    }
  }

  void stop() {
    if (socket_ >= 0) ::close(socket_);
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);  // it has nothing to lose
      reap(pid_);
    }
    socket_ = pid_ = -1;
  }

  Limits limits_;
  int socket_ = -1, pid_ = -1;
  double rate_ = 0.0;
};

}  // namespace lumo
