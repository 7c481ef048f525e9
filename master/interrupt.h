#pragma once
#include <atomic>

/// Ctrl-C and SIGTERM: the first one asks the program to end cleanly, a second one ends it at once.
namespace cotwin::master {

/// The signal that asked the program to stop; 0 while none did.
extern std::atomic<int> stop_signal;

void catch_signals();

}  // namespace cotwin::master
