#pragma once
#include <atomic>

/// Signals that ask the program to end: Ctrl-C, SIGTERM, SIGHUP, SIGXCPU. The first one asks it to end cleanly, a second one of
/// the same kind ends it at once.
namespace cotwin::master {

/// Why a loop should look up from its work: the number of the signal that asked the program to stop, and kCheckpointDue. 0: no
/// reason.
extern std::atomic<int> attention;
inline constexpr int kCheckpointDue = 1 << 8;

/// The signal that asked the program to stop; 0 while none did.
inline int stop_signal() { return attention.load(std::memory_order_relaxed) & (kCheckpointDue - 1); }
/// "SIGTERM".
const char* name_of_signal(int signal);

/// From here on a stop signal ends the process at once with exit code 128 + its number, and `message` on stderr: where nothing
/// is on the disk yet and nobody looks at stop_signal(). A signal that was ignored when the program started (nohup) stays so.
void end_on_signals(const char* message);
/// From here on a stop signal sets `attention`.
void note_signals();
/// Writing to a pipe that nobody reads, or beyond the limit of a file's size, is an error of the write and no signal.
void ignore_signals_of_writing();

}  // namespace cotwin::master
