#pragma once
#include <string>

/// What is left to do when the program does not come to its end: an FMU in this process crashed or called exit(), or the
/// program itself crashed.
namespace cotwin::master {

/// Something that is to be written then. While this lives, `save` is called with `object` in a signal handler: it may do
/// nothing but what is async-signal-safe, and may wait for other threads, which go on running.
class SavedOnCrash {
 public:
  using Save = void (*)(void* object) noexcept;
  /// `file`: the message says that the rows up to then are there; "": it does not.
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

/// From now on SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT inside an FMU, and exit() and quick_exit() by an FMU, end the
/// program with `exit_code` after a message that names component, FMU, function and simulated time, and after everything
/// SavedOnCrash was saved. The same signals elsewhere save, too, and then do what they did before. _exit() cannot be caught:
/// only a process of its own shields from it. Call in the main thread.
void catch_crashes(int exit_code);

/// main() returns now: exit() is in order.
void main_ends();

}  // namespace cotwin::master
