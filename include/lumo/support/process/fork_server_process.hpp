#pragma once

// The far side of ForkServer: what runs in the helper process and in the process of one job. Linux.

#include "lumo/support/process/process.hpp"

#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <span>

namespace lumo {

/// What became of a job that ran in another process.
enum class JobOutcome : std::uint32_t {
  done,
  crashed,
  timed_out,
  out_of_memory,
  lost  ///< the helper went, which says nothing about the job
};

struct JobHeader {
  std::uint64_t size;
  double time_s;
  std::uint64_t memory_bytes;
};

struct ReplyHeader {
  std::uint32_t outcome;
  std::int32_t detail;
  std::uint64_t size;
};

inline constexpr int exit_no_memory = 77;
inline constexpr int exit_threw = 78;

#if defined(__SANITIZE_ADDRESS__)
inline constexpr bool limit_address_space = false;  // shadow memory needs terabytes of address space
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
inline constexpr bool limit_address_space = false;
#else
inline constexpr bool limit_address_space = true;
#endif
#else
inline constexpr bool limit_address_space = true;
#endif

inline int reap(pid_t pid, rusage* usage = nullptr) {
  int status = 0;
  pid_t got;
  do got = ::wait4(pid, &status, 0, usage);
  while (got < 0 && errno == EINTR);
  return got == pid ? status : SIGKILL;
}

/// Pages mapped (field 0) or resident (field 1) of this process, in bytes; 0 if unknown.
inline std::uint64_t own_memory(int field) {
  char text[128] = {};
  const int fd = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (fd < 0) return 0;
  const ssize_t count = ::read(fd, text, sizeof text - 1);
  ::close(fd);
  if (count <= 0) return 0;
  char* next = text;
  std::uint64_t pages = std::strtoull(next, &next, 10);
  if (field == 1) pages = std::strtoull(next, &next, 10);
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

inline void set_limit(int resource, std::uint64_t soft, std::uint64_t hard) {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource_t>(resource), &limit) != 0) return;
  limit.rlim_max = std::min<rlim_t>(limit.rlim_max, hard);
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, soft);
  ::setrlimit(static_cast<__rlimit_resource_t>(resource), &limit);
}

/// One job, in its own process.
template <class Work>
[[noreturn]] void run_job(int out, Work work, std::span<const char> request, const JobHeader& header, pid_t server) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != server) ::_exit(exit_threw);
  set_limit(RLIMIT_CORE, 0, 0);
  const auto cpu_s = static_cast<std::uint64_t>(std::ceil(std::clamp(header.time_s, 0.0, 1e9))) + 1;
  set_limit(RLIMIT_CPU, cpu_s, cpu_s + 1);
  if (limit_address_space && header.memory_bytes > 0) {
    const std::uint64_t total = own_memory(0) + header.memory_bytes;
    set_limit(RLIMIT_AS, total, total);
  }
  std::set_new_handler([] { ::_exit(exit_no_memory); });
  try {
    const JobBytes answer = work(request);
    // Exit code 0 after the last byte distinguishes a whole answer from a broken one.
    for (std::size_t sent = 0; sent < answer.size();) {
      const ssize_t count = ::write(out, answer.data() + sent, answer.size() - sent);
      if (count > 0) sent += static_cast<std::size_t>(count);
      if (count < 0 && errno != EINTR) ::_exit(exit_threw);
    }
    ::_exit(0);
  } catch (const std::bad_alloc&) {
    ::_exit(exit_no_memory);
  } catch (...) {
    ::_exit(exit_threw);
  }
}

/// Drains the job's pipe until it ends. False if the time is over or the host has gone.
inline bool drain(int in, int host, JobBytes& data, const Deadline& deadline) {
  char buffer[65536];
  for (;;) {
    pollfd entries[2] = {{in, POLLIN, 0}, {host, POLLRDHUP, 0}};
    const int count = ::poll(entries, 2, deadline.left_ms());
    if (count < 0 && errno != EINTR) return false;
    if (count > 0 && entries[1].revents != 0) return false;
    if (count > 0 && entries[0].revents != 0) {
      const ssize_t got = ::read(in, buffer, sizeof buffer);
      if (got == 0) return true;
      if (got > 0) data.insert(data.end(), buffer, buffer + got);
      if (got < 0 && errno != EINTR) return false;
    }
    if (deadline.over()) return false;
  }
}

/// Forks one job, waits for it within its limits, and says what became of it.
template <class Work> ReplyHeader supervise_job(
    int host, Work work, std::span<const char> request, const JobHeader& header, JobBytes& answer) {
  const auto reply = [](JobOutcome outcome, int detail = 0) {
    return ReplyHeader{static_cast<std::uint32_t>(outcome), detail, 0};
  };
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return reply(JobOutcome::crashed);
  const Deadline deadline(header.time_s);
  const std::uint64_t base = own_memory(1);
  const pid_t server = ::getpid();
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::close(ends[0]);
    ::close(host);
    run_job(ends[1], work, request, header, server);
  }
  ::close(ends[1]);
  if (pid < 0) {
    ::close(ends[0]);
    return reply(JobOutcome::out_of_memory);
  }
  bool ended = false;
  bool full = false;
  try {
    ended = drain(ends[0], host, answer, deadline);
  } catch (const std::bad_alloc&) {
    full = true;
  }
  ::close(ends[0]);
  if (!ended) ::kill(pid, SIGKILL);
  rusage usage{};
  const int status = reap(pid, &usage);
  if (full) return reply(JobOutcome::out_of_memory);
  if (!ended) return reply(JobOutcome::timed_out);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
    return {static_cast<std::uint32_t>(JobOutcome::done), 0, answer.size()};
  if (WIFEXITED(status) && WEXITSTATUS(status) == exit_no_memory) return reply(JobOutcome::out_of_memory);
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) return reply(JobOutcome::timed_out);
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL)
    return reply(JobOutcome::out_of_memory, SIGKILL);  // not by us: the kernel's out-of-memory killer
  // Code that does not look at malloc's result dies of a signal: what it had in use distinguishes that from other
  // crashes.
  const std::uint64_t peak = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
  if (header.memory_bytes > 0 && peak > base + header.memory_bytes / 2) return reply(JobOutcome::out_of_memory);
  return reply(JobOutcome::crashed, WIFSIGNALED(status) ? WTERMSIG(status) : -WEXITSTATUS(status));
}

/// In a process just forked: cuts all ties to the host but one socket, and returns its number.
inline int leave_host(int socket) {
  for (int signal = 1; signal < 65; ++signal)
    ::signal(signal, SIG_DFL);  // the host's handlers are not ours; fails for some, rightly
  ::signal(SIGPIPE, SIG_IGN);
  for (const int whole_group : {SIGINT, SIGHUP, SIGTERM})
    ::signal(whole_group, SIG_IGN);  // the host decides, and closes the socket
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  set_limit(RLIMIT_CORE, 0, 0);

  // Descriptors 0–2 to nowhere, 3 the socket, nothing else: a copy of a foreign pipe or socket would keep its reader
  // waiting.
  const int host = 3;
  if (socket != host) ::dup2(socket, host);
  bool closed = false;
#ifdef SYS_close_range
  closed = ::syscall(SYS_close_range, 4u, ~0u, 0u) == 0;
#endif
  for (int fd = 4; !closed && fd < 65536; ++fd) ::close(fd);
  const int nowhere = ::open("/dev/null", O_RDWR);
  for (int fd = 0; fd < 3; ++fd) ::dup2(nowhere, fd);
  if (nowhere > 3) ::close(nowhere);
  return host;
}

/// The helper's life: serves jobs until the host's socket closes.
template <class Work> [[noreturn]] void serve_jobs(int socket, Work work) {
  const int host = leave_host(socket);
  const Deadline never(1e9);
  for (;;) {
    JobHeader header{};
    if (receive_all(host, &header, sizeof header, never) != Transfer::done) ::_exit(0);
    try {
      JobBytes request(header.size);
      if (receive_all(host, request.data(), request.size(), never) != Transfer::done) ::_exit(0);
      JobBytes answer;
      const ReplyHeader reply = supervise_job(host, work, std::span<const char>(request), header, answer);
      if (send_all(host, &reply, sizeof reply, never) != Transfer::done) ::_exit(0);
      if (send_all(host, answer.data(), reply.size, never) != Transfer::done) ::_exit(0);
    } catch (...) {
      ::_exit(1);  // no memory for the request: the host sees a closed socket
    }
  }
}

}  // namespace lumo
