#include "program/interrupt.hpp"

#include <signal.h>
#include <unistd.h>

#include <atomic>

namespace lumo::program {

namespace {

std::atomic<bool> writing = false, asked = false;
pid_t owner = 0;   // forked helpers inherit the handler, but only the program itself speaks
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may only touch lock-free atomics");

[[noreturn]] void stop() {
  if (getpid() == owner) {
    // The bar, where there is one, is on the line that the cursor is on.
    static constexpr char plain[] = "lumo: interrupted\n", terminal[] = "\nlumo: interrupted\n";
    const bool bar = isatty(STDERR_FILENO) == 1;
    [[maybe_unused]] const auto written = ::write(STDERR_FILENO, bar ? terminal : plain, (bar ? sizeof terminal : sizeof plain) - 1);
  }
  _exit(130);
}

extern "C" void on_signal(int) {
  if (!writing) stop();
  asked = true;
}

}  // namespace

void stop_on_interrupt() {
  owner = getpid();
  struct sigaction action = {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  for (const int signal : {SIGINT, SIGTERM}) {
    struct sigaction before = {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler != SIG_IGN) sigaction(signal, &action, nullptr);   // nohup and background jobs stay deaf
  }
}

FilesBeingWritten::FilesBeingWritten() { writing = true; }

FilesBeingWritten::~FilesBeingWritten() {
  writing = false;
  if (asked) stop();
}

}  // namespace lumo::program
