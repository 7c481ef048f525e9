#include "master/program/interrupt.h"

#include <time.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdint>
#include <cstring>

#include "fmu/import/watched_calls.h"
#include "master/run/crash.h"

namespace cotwin::master {

std::atomic<int> attention{0};

namespace {

constexpr std::array kStopSignals = {SIGINT, SIGTERM, SIGHUP, SIGXCPU};
constexpr int kSignalled = 128;
// `timeout` and shells send a signal to a process and again to its group, and the process that watches a run passes it on.
constexpr std::int64_t kRepeated = 200'000'000;  // ns: signals of one kind that come within this time count once

std::atomic<const char*> ending_message{nullptr};

std::array<std::atomic<std::int64_t>, NSIG> noted_at{};  // ns; 0: not yet

std::int64_t now_ns() {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

// Only async-signal-safe functions: clock_gettime, write, end_now, atomics.

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
    end_now(kSignalled + signal);
  }
  const std::int64_t now = now_ns();
  std::int64_t first = 0;
  if (!noted_at[static_cast<std::size_t>(signal)].compare_exchange_strong(first, now)) {
    if (now - first < kRepeated) return;
    std::signal(signal, SIG_DFL);
    std::raise(signal);  // delivered when this handler returns
    return;
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
    case SIGQUIT:
      return "SIGQUIT";
    default:
      return "a signal";
  }
}

void end_on_signals(const char* message) {
  ending_message = message;
  catch_signals();
}

void note_signals() {
  for (std::atomic<std::int64_t>& time : noted_at) time = 0;
  ending_message = nullptr;
  if (fmu::watched_calls != nullptr) fmu::watched_calls->initialising = false;
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
