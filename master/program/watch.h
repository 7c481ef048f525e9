#pragma once
#include <sys/types.h>

#include <functional>
#include <optional>
#include <string>

/// A process that watches a run: FMUs run in the process of the run and can end it in ways that it cannot handle (SIGKILL, a
/// system call, a thread that crashes at the end).
namespace cotwin::master {

struct WatchOptions {
  /// Called in the watching process after the end of the run's process, with its id and with the reason if it was not the end of the program:
  /// "component 'pump' at t = 0.5 s: x.fmu: fmi2DoStep: …"; otherwise "". Returns what is added to the message.
  std::function<std::string(pid_t process, const std::string& reason)> ended;
  bool quiet = false;         // says nothing of a long initialisation
  bool ends_children = true;  // processes that FMUs have forked are killed at the end of the run
};

/// Forks, before this process has threads. In the child it returns nothing, and the child continues the program. In the parent it
/// passes stop signals on, waits for the end of the child, and returns the exit code of the program: that of the child, or
/// 1 with a message on stderr if the child ended in another way than the program ends. Without a fork (a debugger,
/// no more processes) it returns nothing.
std::optional<int> watch_run(const WatchOptions& options);

}  // namespace cotwin::master
