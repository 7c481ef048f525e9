#pragma once
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

/// Installs handlers, in the main thread. SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT inside an FMU, and exit() and
/// quick_exit() called by an FMU, then save all SavedOnCrash, print component, FMU, function and simulated time, and end the
/// program with `exit_code`. The same signals elsewhere also save, and then have their previous effect. _exit() cannot be
/// caught; it needs a process of its own.
void catch_crashes(int exit_code);

/// Call before main() returns: exit() is expected from then on.
void main_ends();

}  // namespace cotwin::master
