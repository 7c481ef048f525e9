// A faulty FMU for Co-Simulation (FMI 2.0): x' = 1, y = x. It does what COTWIN_HARM says, in the function that COTWIN_HARM_AT
// names ("load": when its library is loaded), in steps from 0.5 s on.
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include "fmu/fmi2.h"

namespace {

struct Instance {
  double x = 0;
};

volatile bool for_ever = true;
int recurse(int depth) {
  volatile char room[4096];
  room[0] = static_cast<char>(depth);
  return (for_ever ? recurse(depth + 1) : 0) + room[0];
}

void exhaust_memory(bool touch) {
  for (;;) {
    constexpr std::size_t kBytes = 8 << 20;
    char* volatile bytes = static_cast<char*>(malloc(kBytes));  // volatile: compilers leave out memory that nobody uses
    if (bytes == nullptr) abort();
    if (touch) memset(bytes, 1, kBytes);
  }
}

volatile int turns;
void* run_for_ever(void*) {  // in the code of this library
  for (;;) turns = turns + 1;
}

void do_harm(const std::string& harm) {
  if (harm == "exit") exit(0);
  if (harm == "exit-3") exit(3);
  if (harm == "_exit") _exit(0);
  if (harm == "_Exit") _Exit(0);
  if (harm == "exit_group") syscall(SYS_exit_group, 0);
  if (harm == "alarm") {
    const itimerval soon{{0, 0}, {0, 1000}};
    setitimer(ITIMER_REAL, &soon, nullptr);
    for (;;) pause();
  }
  if (harm == "alarms" || harm == "alarms and exit") {  // one while the program handles another
    for (const int number : {SIGALRM, SIGUSR1, SIGUSR2}) {
      sigevent event{};
      event.sigev_notify = SIGEV_SIGNAL;
      event.sigev_signo = number;
      timer_t timer;
      timer_create(CLOCK_MONOTONIC, &event, &timer);
      const itimerspec often{{0, 20000}, {0, 20000}};
      timer_settime(timer, 0, &often, nullptr);
    }
    if (harm == "alarms and exit") exit(0);
    for (;;) pause();
  }
  if (harm == "file size") {  // the next row cannot be written
    const rlimit none{0, RLIM_INFINITY};
    setrlimit(RLIMIT_FSIZE, &none);
  }
  if (harm == "file size signal") {
    const rlimit none{0, 0};
    setrlimit(RLIMIT_FSIZE, &none);
    signal(SIGXFSZ, SIG_DFL);
  }
  if (harm == "thread left") {
    static pthread_t thread;
    if (thread == 0) pthread_create(&thread, nullptr, run_for_ever, nullptr);
  }
  if (harm == "forks") {  // and its children end as children do
    for (int way = 0; way < 3; ++way) {
      const pid_t child = fork();
      if (child == 0 && way == 0) exit(0);
      if (child == 0 && way == 1) _exit(0);
      if (child == 0) raise(SIGSEGV);
      waitpid(child, nullptr, 0);
    }
  }
  if (harm == "heap") {  // writes beyond a block
    volatile char* const block = static_cast<char*>(malloc(24));
    for (int i = 0; i < 4000; ++i) block[i] = 'x';
  }
  if (harm == "daemon" || harm == "daemon and exit") {
    static bool begun;
    if (!begun && fork() == 0) {
      setsid();
      if (fork() != 0) _exit(0);
      for (;;) usleep(1000);
    }
    begun = true;
    if (harm == "daemon and exit") {
      usleep(20000);
      _exit(3);
    }
  }
  if (harm == "quick_exit") quick_exit(0);
  if (harm == "abort") abort();
  if (harm == "segv") raise(SIGSEGV);
  if (harm == "bus") raise(SIGBUS);
  if (harm == "fpe") raise(SIGFPE);
  if (harm == "ill") raise(SIGILL);
  if (harm == "kill") raise(SIGKILL);
  if (harm == "null") *const_cast<volatile int*>(static_cast<int*>(nullptr)) = 1;
  if (harm == "overflow") recurse(0);
  if (harm == "throw") throw std::runtime_error("the pump is dry");
  if (harm == "throw-int") throw 7;
  if (harm == "chdir") (void)!chdir("/");
  if (harm == "hang") {
    for (;;) usleep(1000);
  }
  if (harm == "deaf") {
    for (const int number : {SIGTERM, SIGINT, SIGHUP}) signal(number, SIG_IGN);
    for (;;) usleep(1000);
  }
  if (harm == "memory") exhaust_memory(true);
  if (harm == "reserve") exhaust_memory(false);
  if (harm == "stdout") {
    for (int i = 0; i < 5'000; ++i) printf("line %d of five thousand\n", i);
  }
  if (harm == "flood") {
    for (;;) fputs("the valve is open\n", stderr);
  }
  if (harm == "last words") {
    fputs("assertion failed: p > 0\n", stdout);
    abort();
  }
  if (harm == "thread-exit") {
    pthread_t thread;
    pthread_create(
        &thread, nullptr, [](void*) -> void* { exit(0); }, nullptr);
    for (;;) usleep(1000);
  }
  if (harm == "child") {  // ends by itself
    if (fork() == 0) {
      for (;;) usleep(1000);
    }
    for (;;) usleep(1000);
  }
  if (harm == "closed") {
    for (int descriptor = 0; descriptor < 64; ++descriptor) close(descriptor);
    raise(SIGSEGV);
  }
}

void harm(const char* function, double time = 1) {
  const char *what = getenv("COTWIN_HARM"), *where = getenv("COTWIN_HARM_AT");
  if (what == nullptr || where == nullptr || strcmp(where, function) != 0 || time < 0.5 - 1e-9) return;
  do_harm(what);
}

[[maybe_unused]] const int loaded = (harm("load"), 0);
struct Unloaded {
  ~Unloaded() { harm("unload"); }
} unloaded;

}  // namespace

extern "C" {
const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component, fmi2Boolean, size_t, const fmi2String[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String, fmi2Type, fmi2String, fmi2String, const fmi2CallbackFunctions*, fmi2Boolean,
                              fmi2Boolean) {
  harm("fmi2Instantiate");
  return new Instance;
}
void fmi2FreeInstance(fmi2Component c) {
  harm("fmi2FreeInstance");
  delete static_cast<Instance*>(c);
}
fmi2Status fmi2SetupExperiment(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean, fmi2Real) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component) {
  harm("fmi2EnterInitializationMode");
  return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component) {
  harm("fmi2Terminate");
  return fmi2OK;
}
fmi2Status fmi2Reset(fmi2Component) { return fmi2Error; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference[], size_t n, fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) v[k] = static_cast<Instance*>(c)->x;
  return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component, const fmi2ValueReference[], size_t, fmi2Integer[]) { return fmi2Error; }
fmi2Status fmi2GetBoolean(fmi2Component, const fmi2ValueReference[], size_t, fmi2Boolean[]) { return fmi2Error; }
fmi2Status fmi2GetString(fmi2Component, const fmi2ValueReference[], size_t, fmi2String[]) { return fmi2Error; }
fmi2Status fmi2SetReal(fmi2Component, const fmi2ValueReference[], size_t, const fmi2Real[]) { return fmi2OK; }
fmi2Status fmi2SetInteger(fmi2Component, const fmi2ValueReference[], size_t, const fmi2Integer[]) { return fmi2Error; }
fmi2Status fmi2SetBoolean(fmi2Component, const fmi2ValueReference[], size_t, const fmi2Boolean[]) { return fmi2Error; }
fmi2Status fmi2SetString(fmi2Component, const fmi2ValueReference[], size_t, const fmi2String[]) { return fmi2Error; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real h, fmi2Boolean) {
  harm("fmi2DoStep", now);
  static_cast<Instance*>(c)->x += h;
  return fmi2OK;
}
}
