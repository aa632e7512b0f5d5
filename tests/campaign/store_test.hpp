#pragma once

#include <unistd.h>
#include <cstdio>
#include <exception>
#include <functional>

/// Runs `work` in a child process that leaves nothing but an exit code, 1 with a line about what was thrown.
inline pid_t start_child(const std::function<void()>& work) {
  const pid_t pid = fork();
  if (pid != 0) return pid;
  try {
    work();
    _exit(0);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
  } catch (...) {
  }
  _exit(1);
}
