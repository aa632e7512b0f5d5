#pragma once

#include "console/text.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <mutex>
#include <string>
#include <vector>

namespace lumo::program {

/// Shows on standard error how far a piece of work is: a bar with the time left on a terminal, else a line now and
/// then. May be called from any thread.
class Progress {
 public:
  explicit Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}
  ~Progress() { finish(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Starts a stage of `total` steps and ends the one before.
  void stage(const std::string& title, int total = 1) {
    const std::lock_guard lock(mutex_);
    close();
    title_ = title;
    total_ = std::max(1, total);
    done_ = 0;
    open_ = true;
    start_ = shown_ = Clock::now();
    if (quiet_) return;
    if (terminal_) draw();
    else std::fprintf(stderr, "lumo: %s ...\n", title_.c_str());
  }

  /// One step is done.
  void step() {
    const std::lock_guard lock(mutex_);
    if (!open_) return;
    done_ = std::min(total_, done_ + 1);
    if (quiet_ || total_ == 1) return;
    if (!is_due() && done_ < total_) return;
    shown_ = Clock::now();
    if (terminal_) draw();
    else if (done_ < total_)
      std::fprintf(stderr, "lumo: %s: %d of %d, %s left\n", title_.c_str(), done_, total_, left().c_str());
  }

  /// What a stage is at, behind its title. On a terminal it stays there as a line if it `stays`, and the next one takes
  /// its place if not; else it is a line, now and then.
  void at(const std::string& text, bool stays) {
    const std::lock_guard lock(mutex_);
    if (!open_ || quiet_) return;
    const bool is_line = terminal_ && stays;
    if (!is_line && !is_due()) return;
    shown_ = Clock::now();
    if (is_line) std::fprintf(stderr, "\r\033[Klumo: %s: %s\n", title_.c_str(), text.c_str());
    if (!terminal_) std::fprintf(stderr, "lumo: %s: %s\n", title_.c_str(), text.c_str());
    else if (stays) draw();
    else std::fprintf(stderr, "\r\033[K%s ... %s", title_.c_str(), text.c_str());
    std::fflush(stderr);
  }

  /// Ends the stage and leaves one line about it.
  void finish() {
    const std::lock_guard lock(mutex_);
    close();
  }

  /// Is there somebody who watches a bar?
  bool watched() const { return terminal_ && !quiet_; }

  /// A line that somebody must read to do his part; --quiet does not silence it.
  void tell(const std::string& line) {
    const std::lock_guard lock(mutex_);
    close();
    std::fprintf(stderr, "lumo: %s\n", line.c_str());
  }

  /// A line of its own, such as a file that was written.
  void note(const std::string& line) {
    const std::lock_guard lock(mutex_);
    close();
    notes_.push_back(line);
    if (!quiet_) std::fprintf(stderr, "lumo: %s\n", line.c_str());
  }
  /// All of them, for results that are read by programs.
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  using Clock = std::chrono::steady_clock;

  /// Was the last line, or picture of the bar, a while ago?
  bool is_due() const {
    return std::chrono::duration<double>(Clock::now() - shown_).count() >= (terminal_ ? 0.1 : 5.0);
  }
  double elapsed() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

  std::string left() const { return done_ > 0 ? span(elapsed() / done_ * (total_ - done_)) : "?"; }

  void draw() const {
    constexpr int cells = 30;
    std::string bar;
    for (int i = 0; i < cells; ++i) bar += i < cells * done_ / total_ ? "█" : "░";
    if (total_ > 1)
      std::fprintf(stderr, "\r\033[K%s %s %d/%d, %s left", title_.c_str(), bar.c_str(), done_, total_, left().c_str());
    else std::fprintf(stderr, "\r\033[K%s ...", title_.c_str());
    std::fflush(stderr);
  }

  void close() {
    if (!open_) return;
    open_ = false;
    if (quiet_) return;
    if (terminal_) std::fprintf(stderr, "\r\033[K");
    if (done_ == total_) std::fprintf(stderr, "lumo: %s: done in %s\n", title_.c_str(), span(elapsed()).c_str());
    else if (total_ > 1) std::fprintf(stderr, "lumo: %s: stopped at %d of %d\n", title_.c_str(), done_, total_);
  }

  bool quiet_, terminal_, open_ = false;
  std::string title_;
  int total_ = 1, done_ = 0;
  Clock::time_point start_, shown_;
  std::mutex mutex_;
  std::vector<std::string> notes_;
};

/// How long each of a row of things took, and the rest will.
class Pace {
 public:
  /// Text about the thing that has just ended, of which `left` are still to come; those that do not count (failed) take
  /// their time all the same.
  std::string after(int left, bool counts = true) {
    const auto now = Clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    spent_ += seconds;
    ended_ += counts;
    return span(seconds) + (left > 0 ? ", " + span(spent_ / std::max(1, ended_) * left) + " left" : "");
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_ = Clock::now();
  double spent_ = 0.0;
  int ended_ = 0;
};

}  // namespace lumo::program
