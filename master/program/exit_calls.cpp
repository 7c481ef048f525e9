// _exit() and _Exit() of the program, which FMUs and the libraries that they need find before those of the C library. So an FMU
// that calls one of them is named, and the rows are kept. Processes that an FMU forks may call them.
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdlib>

#include "master/run/crash.h"

namespace {

[[noreturn]] void end_process(int status, const char* function) {
  cotwin::master::exit_called(status, function);
  for (;;) syscall(SYS_exit_group, status);
}

}  // namespace

extern "C" {
[[gnu::visibility("default")]] void _exit(int status) { end_process(status, "_exit"); }
[[gnu::visibility("default")]] void _Exit(int status) noexcept { end_process(status, "_Exit"); }
}
