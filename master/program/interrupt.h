#pragma once
#include <atomic>

/// Stop signals: Ctrl-C, SIGTERM, SIGHUP, SIGXCPU. The first one requests a clean end; a second one of the same kind, 0.2 s
/// later or more, ends the program at once.
namespace cotwin::master {

/// Requests to the main loop: the number of a stop signal, and kCheckpointDue. 0: none.
extern std::atomic<int> attention;
inline constexpr int kCheckpointDue = 1 << 8;

/// Returns the stop signal that was received, or 0.
inline int stop_signal() { return attention.load(std::memory_order_relaxed) & (kCheckpointDue - 1); }
const char* name_of_signal(int signal);

/// From now on a stop signal ends the process at once with exit code 128 + its number and `message` on stderr. For phases that
/// do not check stop_signal() and have written nothing. A signal that was ignored when the program started (nohup) remains
/// ignored.
void end_on_signals(const char* message);
/// From now on a stop signal sets `attention`.
void note_signals();
/// From now on a stop signal ends the process at once, also after note_signals().
void end_at_once_on_signals();
/// Makes a write to a closed pipe, or beyond the limit of a file's size, an error of the write instead of a signal.
void ignore_signals_of_writing();

}  // namespace cotwin::master
