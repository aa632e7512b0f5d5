#pragma once

#include "lumo/support/process/fork_server_process.hpp"
#include "lumo/support/process/process.hpp"

#include <cstdint>
#include <mutex>
#include <span>

namespace lumo {

struct JobLimits {
  double time_s = 60.0;  ///< wall clock, and (rounded up, plus one second) processor time
  /// Address space on top of the helper's own; 0 for no limit; not applied under AddressSanitizer
  std::uint64_t memory_bytes = 0;
};

struct JobResult {
  JobOutcome outcome = JobOutcome::crashed;
  int detail = 0;  ///< signal number of a crash, or minus the exit code, or 0
  JobBytes data;   ///< the job's answer if `done`
};

/// A helper process that runs jobs in processes of their own, so that foreign code can crash, hang or eat memory alone.
///
/// The helper is forked in the constructor, which is best done while the program has one thread: a later fork is safe
/// only as far as the C library's own locks are (glibc cares for malloc's; AddressSanitizer's allocator does not). It
/// serves one job at a time, forks a grandchild for each, and is restarted when it is found dead. It goes when this
/// object goes, or when the process that made it dies. `run` may be called from any thread; calls wait for each other.
/// After a fork of the host, the new process gets a helper of its own.
class ForkServer {
 public:
  /// Runs in the grandchild. May do anything, even crash. What it throws counts as a crash, std::bad_alloc as lack of
  /// memory.
  using Work = JobBytes (*)(std::span<const char> request);

  explicit ForkServer(Work work) : work_(work) { start(); }
  ~ForkServer() { stop(); }
  ForkServer(const ForkServer&) = delete;
  ForkServer& operator=(const ForkServer&) = delete;

  /// Never throws but std::bad_alloc, never blocks longer than about `limits.time_s` + 5 s after its turn has come.
  JobResult run(std::span<const char> request, const JobLimits& limits);

  /// Process number of the helper, −1 if there is none.
  int pid() const { return pid_; }

 private:
  bool start();
  void stop();
  bool alive() const;

  Work work_;
  std::mutex mutex_;
  int pid_ = -1;
  int socket_ = -1;
  int owner_ = -1;  ///< the process that forked the helper: a copy of this object after fork() must not use it
};

inline bool ForkServer::start() {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return false;
  const pid_t pid = ::fork();
  if (pid == 0) serve_jobs(ends[1], work_);  // never returns
  ::close(ends[1]);
  if (pid < 0) {
    ::close(ends[0]);
    return false;
  }
  pid_ = pid;
  socket_ = ends[0];
  owner_ = ::getpid();
  return true;
}

inline void ForkServer::stop() {
  if (socket_ >= 0) {
    if (owner_ == ::getpid())
      ::shutdown(socket_, SHUT_RDWR);  // the helper reads the end of its input, even if the socket was copied
    ::close(socket_);
  }
  if (pid_ > 0 && owner_ == ::getpid()) {
    int status = 0;
    pid_t reaped = 0;
    for (int i = 0; i < 200 && reaped == 0; ++i) {  // up to about a second of grace
      reaped = ::waitpid(pid_, &status, WNOHANG);
      if (reaped < 0 && errno == EINTR) reaped = 0;
      if (reaped == 0) ::usleep(i < 20 ? 200 : 5000);
    }
    if (reaped == 0) {
      ::kill(pid_, SIGKILL);
      reap(pid_);
    }
  }
  socket_ = pid_ = owner_ = -1;
}

/// Whether the helper can be given a job. Nothing is ever readable between jobs but the end of the stream.
inline bool ForkServer::alive() const {
  if (socket_ < 0 || owner_ != ::getpid()) return false;
  char byte;
  const ssize_t got = ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  return got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
}

inline JobResult ForkServer::run(std::span<const char> request, const JobLimits& limits) {
  const std::lock_guard lock(mutex_);
  if (!alive()) {
    stop();
    if (!start()) return {JobOutcome::lost, 0, {}};
  }
  const Deadline deadline(limits.time_s + 5.0);
  const JobHeader header{request.size(), limits.time_s, limits.memory_bytes};
  ReplyHeader reply{};
  JobResult result;
  Transfer state = send_all(socket_, &header, sizeof header, deadline);
  if (state == Transfer::done) state = send_all(socket_, request.data(), request.size(), deadline);
  if (state == Transfer::done) state = receive_all(socket_, &reply, sizeof reply, deadline);
  if (state == Transfer::done) {
    try {
      result.data.resize(reply.size);
    } catch (...) {
      stop();  // the stream is out of step now
      throw;
    }
    state = receive_all(socket_, result.data.data(), result.data.size(), deadline);
  }
  if (state != Transfer::done) {
    stop();
    start();
    return {state == Transfer::late ? JobOutcome::timed_out : JobOutcome::lost, 0, {}};
  }
  result.outcome = static_cast<JobOutcome>(reply.outcome);
  result.detail = reply.detail;
  return result;
}

}  // namespace lumo
