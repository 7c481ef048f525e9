#include "master/program/watch.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iostream>
#include <thread>
#include <vector>

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
constexpr int kAttempts = 2000;                      // ms: to kill what a run leaves; a process may hang in the system

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
  alarms.sa_handler = [](int) {
    alarmed = true;
    alarm(1);  // once more, in case waitpid has not begun yet
  };
  sigaction(SIGALRM, &alarms, nullptr);  // interrupts waitpid
}

/// The next alarm, sooner after a stop signal, whose own alarm this would replace.
void set_alarm(unsigned seconds) {
  alarm(seconds);
  if (stopped_by != 0) alarm(kPatience);
}

/// At an alarm, while the child initialises: kills it if it does not obey a stop signal, or says where it is.
void look_after(pid_t child, const WatchedCalls& calls, unsigned& seconds) {
  if (!calls.initialising) {
    alarm(0);
    return;
  }
  if (stopped_by != 0) {
    kill(child, SIGKILL);
    return;
  }
  const std::string where = calls.last_calls();
  std::cerr << "cotwin: initialising for " << seconds << " s" << (where.empty() ? "" : ", now " + where) << '\n';
  seconds += kReports;
  set_alarm(kReports);
}

/// Adds the children of a process and theirs. A process without such a list in /proc has none.
void add_descendants(pid_t process, std::vector<pid_t>& all) {
  std::ifstream children("/proc/" + std::to_string(process) + "/task/" + std::to_string(process) + "/children");
  for (pid_t child = 0; children >> child;) {
    all.push_back(child);
    add_descendants(child, all);
  }
}

/// Waits for the end of the run's process. Returns its status, or nothing if the system does not tell it. `earlier`: see
/// kill_children(); those that end are removed, for their numbers may be given to others.
std::optional<int> wait_for(pid_t child, const WatchedCalls& calls, bool quiet, std::vector<pid_t>& earlier) {
  unsigned seconds = kFirstReport;
  if (!quiet) set_alarm(kFirstReport);
  for (;;) {
    int status = 0;
    const pid_t ended = waitpid(-1, &status, 0);  // also orphans that the run has left to this process
    if (ended == child) return status;
    if (ended < 0 && errno != EINTR) return std::nullopt;
    if (ended > 0) std::erase(earlier, ended);
    if (alarmed.exchange(false)) look_after(child, calls, seconds);
  }
}

/// Kills the children of this process, and theirs, which become its own, except those that were there before the run: the
/// shell that became this program may have started them (cotwin run … > >(tee log)).
void kill_children(const std::vector<pid_t>& earlier) {
  const std::string list = "/proc/self/task/" + std::to_string(getpid()) + "/children";
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    std::ifstream children(list);
    bool left = false;
    for (pid_t child = 0; children >> child;) {
      if (std::ranges::find(earlier, child) != earlier.end()) continue;
      left = true;
      kill(child, SIGKILL);
      waitpid(child, nullptr, WNOHANG);
    }
    if (!left) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
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
Ending ending_of(std::optional<int> ended, WatchedCalls::End end) {
  if (!ended) return {kFailed, "the process of the run ended, and the system does not tell how"};
  const int status = *ended;
  if (WIFSIGNALED(status)) {
    const int number = WTERMSIG(status);
    const std::string which = number == SIGQUIT ? "" : "a second ";  // the process notes the first one of all others itself
    if (is_stop_signal(number)) return {kEndedBySignal + number, "ended by " + which + name_of_signal(number)};
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
  std::signal(SIGCHLD, SIG_DFL);  // if it is ignored, no status can be waited for, here and of the processes of FMUs
  const pid_t parent = getpid();
  std::vector<pid_t> earlier;
  add_descendants(parent, earlier);
  const pid_t child = fork();
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
  const std::optional<int> status = wait_for(child, *calls, options.quiet, earlier);
  watched = 0;
  alarm(0);
  if (options.ends_children) kill_children(earlier);
  fmu::remove_temporary_folders(child);
  const bool killed = status && WIFSIGNALED(*status) && WTERMSIG(*status) == SIGKILL;
  const int stopped = calls->initialising && killed ? stopped_by.load() : 0;
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
