#include "console/interrupt.hpp"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <set>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

namespace lumo::program {

namespace {

std::recursive_mutex writing;                // held while files are written
std::set<std::filesystem::path> unfinished;  // guarded by it
std::atomic<bool> gentle = false, asked_to_stop = false;

[[noreturn]] void stop() {
  for (const std::filesystem::path& folder : unfinished)
    for (int attempt = 0; attempt < 5; ++attempt) {  // others may be writing into it
      std::error_code error;
      std::filesystem::remove_all(folder, error);
      if (!error) break;
    }
  // The bar, where there is one, is on the line that the cursor is on.
  static constexpr char plain[] = "lumo: interrupted\n", terminal[] = "\nlumo: interrupted\n";
  const bool bar = isatty(STDERR_FILENO) == 1;
  [[maybe_unused]] const auto written =
      ::write(STDERR_FILENO, bar ? terminal : plain, (bar ? sizeof terminal : sizeof plain) - 1);
  _exit(130);
}

// OpenBLAS chooses its kernels by a list of processors: one that is younger than the list gets those that run anywhere,
// with Debian 12's an Intel of 2023 for one, and presses take 2.6 times as long. What the processor can do decides
// here.
const char* best_kernels() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512vl"))
    return "SkylakeX";
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return "Haswell";
#endif
  return nullptr;
}

}  // namespace

void settle_blas(char** argv) {
  const char* const threads = getenv("OPENBLAS_NUM_THREADS");
  const char* const kernels = best_kernels();
  if (threads != nullptr && std::string_view(threads) == "1" &&
      (kernels == nullptr || getenv("OPENBLAS_CORETYPE") != nullptr))
    return;
  if (kernels != nullptr) setenv("OPENBLAS_CORETYPE", kernels, 0);
  if (setenv("OPENBLAS_NUM_THREADS", "1", 1) == 0) execv("/proc/self/exe", argv);  // goes on as it is if that fails
}

void open_standard_streams() {
  // The next file to be opened would take the number of one that is missing, and get what is meant for it. Writing to
  // standard output fails then.
  for (int stream = 0; stream < 3; ++stream)
    if (fcntl(stream, F_GETFD) == -1 && open("/dev/null", stream == STDERR_FILENO ? O_WRONLY : O_RDONLY) != stream)
      _exit(1);
}

// A thread of its own waits for the signals, and all others are deaf to them: METIS puts a handler of its own in the
// place of any other while it orders a matrix, and jumps out of it.
void stop_on_interrupt() {
  for (const int signal : {SIGPIPE, SIGXFSZ}) ::signal(signal, SIG_IGN);  // errors to report
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before = {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler != SIG_IGN) sigaddset(&signals, signal);  // nohup and background jobs stay deaf
  }
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([signals] {
    int signal = 0;
    while (true) {
      while (sigwait(&signals, &signal) != 0) {
      }
      if (gentle && !asked_to_stop.exchange(true)) continue;
      const std::lock_guard whole(writing);
      stop();
    }
  }).detach();
}

UnfinishedFolder::UnfinishedFolder(std::filesystem::path path) : path_(std::move(path)) {
  const FilesBeingWritten now;
  unfinished.insert(path_);
}

UnfinishedFolder::~UnfinishedFolder() {
  const FilesBeingWritten now;
  unfinished.erase(path_);
}

GentleStop::GentleStop() { gentle = true; }

GentleStop::~GentleStop() { gentle = false; }

bool GentleStop::asked() { return asked_to_stop; }

void end_interrupted() {
  const FilesBeingWritten none;
  stop();
}

FilesBeingWritten::FilesBeingWritten() { writing.lock(); }

FilesBeingWritten::~FilesBeingWritten() { writing.unlock(); }

}  // namespace lumo::program
