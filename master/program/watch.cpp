#include "master/program/watch.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iostream>

#include "fmu/archive/archive.h"
#include "fmu/import/watched_calls.h"
#include "master/program/interrupt.h"
#include "master/run/crash.h"

namespace cotwin::master {

namespace {

using fmu::WatchedCalls;

constexpr int kFailed = 1, kEndedBySignal = 128;  // exit codes, as in commands/commands.h
constexpr std::array kPassedOn = {SIGINT, SIGTERM, SIGHUP, SIGXCPU, SIGQUIT, SIGUSR1, SIGUSR2};

constexpr unsigned kFirstReport = 5, kReports = 30;  // s: when a long initialisation is reported, and again
constexpr unsigned kPatience = 2;                    // s: until an initialisation that does not obey a stop signal is killed

std::atomic<pid_t> watched{0};
std::atomic<bool> alarmed{false};
std::atomic<int> stopped_by{0};  // a stop signal during the initialisation

bool is_stop_signal(int number) {
  return number == SIGINT || number == SIGTERM || number == SIGHUP || number == SIGXCPU || number == SIGQUIT;
}

/// Passes a signal on that was sent to this process. One of a terminal reaches the child itself.
void pass_on(int number, siginfo_t* info, void*) {
  if (info->si_code <= 0 && watched > 0) kill(watched, number);
  if (!is_stop_signal(number)) return;
  stopped_by = number;
  alarm(kPatience);
}

bool is_debugged() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("TracerPid:")) return line.find_first_of("123456789") != std::string::npos;
  }
  return false;
}

void watch_signals() {
  for (const int number : kPassedOn) {
    struct sigaction before = {};
    sigaction(number, nullptr, &before);
    if (before.sa_handler == SIG_IGN) continue;
    struct sigaction action = {};
    action.sa_sigaction = pass_on;
    action.sa_flags = SA_SIGINFO | SA_RESTART;
    sigaction(number, &action, nullptr);
  }
  struct sigaction alarms = {};
  alarms.sa_handler = [](int) { alarmed = true; };
  sigaction(SIGALRM, &alarms, nullptr);  // interrupts waitpid
}

/// At an alarm, while the child initialises: kills it if it does not obey a stop signal, or says where it is.
void look_after(pid_t child, const WatchedCalls& calls, unsigned& seconds) {
  if (!calls.initialising) return;
  if (stopped_by != 0) {
    kill(child, SIGKILL);
    return;
  }
  const std::string where = calls.last_calls();
  std::cerr << "cotwin: initialising for " << seconds << " s" << (where.empty() ? "" : ", now " + where) << '\n';
  seconds += kReports;
  alarm(kReports);
}

int wait_for(pid_t child, const WatchedCalls& calls, bool quiet) {
  unsigned seconds = kFirstReport;
  if (!quiet) alarm(kFirstReport);
  for (;;) {
    int status = 0;
    const pid_t ended = waitpid(-1, &status, 0);  // also orphans that the run has left to this process
    if (ended == child) return status;
    if (ended < 0 && errno != EINTR) return 0;
    if (ended < 0 && alarmed.exchange(false)) look_after(child, calls, seconds);
  }
}

/// Kills the children of this process, and theirs, which become its own.
void kill_children() {
  const std::string list = "/proc/self/task/" + std::to_string(getpid()) + "/children";
  for (;;) {
    std::ifstream children(list);
    pid_t child = 0;
    if (!(children >> child)) return;
    do {
      kill(child, SIGKILL);
    } while (children >> child);
    while (waitpid(-1, nullptr, 0) > 0 || errno == EINTR) {
    }
  }
}

std::string name_of(int number) {
  const char* name = sigdescr_np(number);
  return "signal " + std::to_string(number) + (name != nullptr ? std::string(" (") + name + ")" : "");
}

/// The code with which the program ends, and how the child ended if not as the program ends.
struct Ending {
  int code;
  std::string how;
};
Ending ending_of(int status, WatchedCalls::End end) {
  if (WIFSIGNALED(status)) {
    const int number = WTERMSIG(status);
    if (is_stop_signal(number)) return {kEndedBySignal + number, std::string("ended by a second ") + name_of_signal(number)};
    return {kFailed, end == WatchedCalls::End::kReported ? "" : "the process of the run was killed by " + name_of(number)};
  }
  if (end != WatchedCalls::End::kUnexpected) return {WEXITSTATUS(status), ""};
  return {kFailed, "the process of the run exited with status " + std::to_string(WEXITSTATUS(status)) + " without a summary"};
}

}  // namespace

std::optional<int> watch_run(const WatchOptions& options) {
  WatchedCalls* const calls = is_debugged() ? nullptr : WatchedCalls::make();
  if (calls == nullptr) return std::nullopt;
  std::cout.flush();
  std::fflush(nullptr);
  const pid_t parent = getpid(), child = fork();
  if (child < 0) return std::nullopt;
  if (child == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);  // set by the main thread of the parent, which lives as long as the parent
    if (getppid() != parent) raise(SIGKILL);
    calls->begin();
    process_begins();
    return std::nullopt;
  }
  watched = child;
  watch_signals();
  if (options.ends_children) prctl(PR_SET_CHILD_SUBREAPER, 1);
  const int status = wait_for(child, *calls, options.quiet);
  watched = 0;
  if (options.ends_children) kill_children();
  fmu::remove_temporary_folders(child);
  alarm(0);
  const int stopped = calls->initialising && WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL ? stopped_by.load() : 0;
  if (stopped != 0) {
    const std::string where = calls->last_calls();
    std::cerr << "cotwin: " << name_of_signal(stopped) << " while loading and initialising"
              << (where.empty() ? "" : ", in " + where) << ", which had to be killed; no results were written\n";
    return kEndedBySignal + stopped;
  }
  const Ending ending = ending_of(status, calls->end);
  const bool fails = ending.code == kFailed && !ending.how.empty();
  const std::string where = fails ? calls->last_calls() : "";
  const std::string reason = (where.empty() ? "" : where + ": ") + ending.how;
  const std::string kept = options.ended(child, reason);
  if (fails) std::cerr << (isatty(STDERR_FILENO) != 0 ? "\ncotwin: " : "cotwin: ") << reason << kept << '\n';
  return ending.code;
}

}  // namespace cotwin::master
