#pragma once
#include <signal.h>

#include <string>

/// Actions when an FMU in this process crashes or calls exit(), or when the program itself crashes.
namespace cotwin::master {

/// Data to be written in that case. During the lifetime of this object, a signal handler calls `save` with `object`. It may
/// only do async-signal-safe operations. It may wait for other threads, which continue.
class SavedOnCrash {
 public:
  using Save = void (*)(void* object) noexcept;
  /// `file`: named in the message as the file with the rows so far; "" for none.
  SavedOnCrash(Save save, void* object, std::string file);
  ~SavedOnCrash();
  SavedOnCrash(const SavedOnCrash&) = delete;
  SavedOnCrash& operator=(const SavedOnCrash&) = delete;

 private:
  friend struct CrashHandler;
  Save save_;
  void* object_;
  std::string file_;
};

/// Blocks the signals that end a process unless it handles them (SIGALRM and so on), in the calling thread and in those that it
/// starts, until it is destroyed. Threads that `save` waits for are started under it: one that handled a signal would wait for itself.
class EndingSignalsBlocked {
 public:
  EndingSignalsBlocked() noexcept;
  ~EndingSignalsBlocked();
  EndingSignalsBlocked(const EndingSignalsBlocked&) = delete;
  EndingSignalsBlocked& operator=(const EndingSignalsBlocked&) = delete;

 private:
  sigset_t before_;
};

/// Installs handlers, in the main thread. SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT inside an FMU, signals such as SIGALRM that
/// end a process unless it handles them, and exit() and quick_exit() called by an FMU, then save all SavedOnCrash, print
/// component, FMU, function and simulated time, and end the program with `exit_code`. The same signals elsewhere also save, and
/// then have their previous effect. In processes that an FMU forks, all of them have their usual effect.
void catch_crashes(int exit_code);

/// Call in the main thread of a process that was forked after catch_crashes() and continues the program.
void process_begins();

/// The same for _exit() and _Exit(), if the program gets to see their calls. Returns if the call is not that of an FMU in this
/// process.
void exit_called(int status, const char* function) noexcept;

/// Ends the process at once, as _exit() does, when that is not a failure of an FMU. For signal handlers.
[[noreturn]] void end_now(int code) noexcept;

/// Call before main() returns: exit() is expected from then on.
void main_ends();

}  // namespace cotwin::master
