#include "master/program/interrupt.h"

#include <unistd.h>

#include <array>
#include <csignal>
#include <cstring>

namespace cotwin::master {

std::atomic<int> attention{0};

namespace {

constexpr std::array kStopSignals = {SIGINT, SIGTERM, SIGHUP, SIGXCPU};
constexpr int kSignalled = 128;

std::atomic<const char*> ending_message{nullptr};

// Only async-signal-safe functions: write, _exit, atomics.

void print(const char* text) {
  for (std::size_t left = std::strlen(text); left > 0;) {
    const ssize_t n = ::write(STDERR_FILENO, text, left);
    if (n <= 0) return;
    text += n;
    left -= static_cast<std::size_t>(n);
  }
}

void on_signal(int signal) {
  if (const char* message = ending_message) {
    print("cotwin: ");
    print(name_of_signal(signal));
    print(message);
    ::_exit(kSignalled + signal);
  }
  int before = attention;
  while ((before & (kCheckpointDue - 1)) == 0 && !attention.compare_exchange_weak(before, before | signal)) {
  }
}

void catch_signals() {
  for (const int signal : kStopSignals) {
    struct sigaction before = {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler == SIG_IGN) continue;
    struct sigaction action = {};
    action.sa_handler = on_signal;
    action.sa_flags = SA_RESETHAND;
    sigaction(signal, &action, nullptr);
  }
}

}  // namespace

const char* name_of_signal(int signal) {
  switch (signal) {
    case SIGINT:
      return "SIGINT";
    case SIGTERM:
      return "SIGTERM";
    case SIGHUP:
      return "SIGHUP";
    case SIGXCPU:
      return "SIGXCPU";
    default:
      return "a signal";
  }
}

void end_on_signals(const char* message) {
  ending_message = message;
  catch_signals();
}

void note_signals() {
  ending_message = nullptr;
  catch_signals();
}

void end_at_once_on_signals() {
  for (const int signal : kStopSignals) {
    struct sigaction now = {};
    if (sigaction(signal, nullptr, &now) == 0 && now.sa_handler == on_signal) std::signal(signal, SIG_DFL);
  }
}

void ignore_signals_of_writing() {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

}  // namespace cotwin::master
