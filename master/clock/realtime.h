#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "master/scenario/scenario.h"

/// Scheduling, memory and CPUs of the threads of a loop with deadlines. Only realtime_linux.cpp depends on the operating system.
/// What is not permitted is appended to `refused` as a sentence; the run goes on without it.
namespace cotwin::master::realtime {

/// Throws Error for a priority or a CPU that this machine does not have.
void check(const ClockSpec& spec);

/// Locks the memory of the process, and makes the heap larger and keeps it so.
void prepare_process(std::vector<std::string>& refused);

/// Gives the calling thread its CPU, touches its stack, and with a priority > 0 schedules it by SCHED_FIFO. `index`: 0 for the
/// loop, then the workers; it has the CPU of this index in the list, counted round. Threads that it creates have ordinary scheduling.
void prepare_thread(const ClockSpec& spec, std::size_t index, std::vector<std::string>& refused);

/// Page faults of the calling thread so far.
std::int64_t page_faults();

}  // namespace cotwin::master::realtime
