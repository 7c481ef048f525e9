#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>

#include "master/clock/realtime.h"
#include "master/engine/wiring/members.h"
#include "models/foundation/support/atomic_file.h"

namespace cotwin::master::realtime {

namespace {

constexpr std::size_t kPage = 4096;
constexpr std::size_t kStack = std::size_t{256} << 10;
constexpr std::size_t kHeap = std::size_t{16} << 20;

[[gnu::noinline]] void touch_stack() {
  volatile unsigned char bytes[kStack];
  for (std::size_t i = 0; i < kStack; i += kPage) bytes[i] = 0;
  asm volatile("" : : "r"(bytes) : "memory");
}

/// Free memory is not given back, and large blocks are taken from it.
void enlarge_heap() {
  mallopt(M_TRIM_THRESHOLD, -1);
  mallopt(M_MMAP_MAX, 0);
  if (auto* const bytes = static_cast<volatile unsigned char*>(std::malloc(kHeap))) {
    for (std::size_t i = 0; i < kHeap; i += kPage) bytes[i] = 0;
    std::free(const_cast<unsigned char*>(bytes));
  }
}

void add_once(std::vector<std::string>& refused, std::string sentence) {
  if (std::ranges::find(refused, sentence) == refused.end()) refused.push_back(std::move(sentence));
}

}  // namespace

void check(const ClockSpec& spec) {
  const int most = sched_get_priority_max(SCHED_FIFO);
  if (spec.priority < 0 || spec.priority > most)
    fail(spec.place, "priority " + std::to_string(spec.priority) + ", expected 0 (none) to " + std::to_string(most));
  const long cpus = std::min<long>(sysconf(_SC_NPROCESSORS_CONF), CPU_SETSIZE);
  for (const int cpu : spec.cpus) {
    if (cpu < 0 || cpu >= cpus)
      fail(spec.place,
           "CPU " + std::to_string(cpu) + ", expected 0 to " + std::to_string(cpus - 1) + ", those of this machine");
  }
}

void prepare_process(std::vector<std::string>& refused) {
  enlarge_heap();
  rlimit limit{};
  const bool unlimited = ::geteuid() == 0 || (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY);
  // Below a limit, MCL_FUTURE would let later allocations fail.
  if (mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) != 0)
    add_once(refused, "memory cannot be locked (mlockall: " + system_reason(errno) +
                          "; ulimit -l or CAP_IPC_LOCK permits it): page faults may delay ticks");
}

void prepare_thread(const ClockSpec& spec, std::size_t index, std::vector<std::string>& refused) {
  touch_stack();
  prctl(PR_SET_TIMERSLACK, 1);
  if (!spec.cpus.empty()) {
    const int cpu = spec.cpus[index % spec.cpus.size()];
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    if (const int error = pthread_setaffinity_np(pthread_self(), sizeof set, &set); error != 0)
      add_once(refused,
               "CPU " + std::to_string(cpu) + " cannot be used (" + system_reason(error) + "): the thread runs on any CPU");
  }
  if (spec.priority == 0) return;
  const sched_param parameters{spec.priority};
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) != 0)
    add_once(refused, "priority " + std::to_string(spec.priority) + " cannot be given (SCHED_FIFO: " + system_reason(errno) +
                          "; ulimit -r or CAP_SYS_NICE permits it): ticks may be late");
}

std::int64_t page_faults() {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_minflt + usage.ru_majflt;
}

}  // namespace cotwin::master::realtime
