#pragma once
#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cotwin::gateway {

struct WorkerLimits {
  int nice = 0;              // added to the level of this process
  std::uint64_t memory = 0;  // of data, bytes; 0: none
  std::uint64_t line = 0;    // of a line that it writes, bytes
};

/// A child process that reads lines from stdin and writes lines to stdout. It is a process group of its own, inherits no
/// descriptor but those, and is killed when this process ends, however it ends (Linux; elsewhere it must end when its stdin ends).
/// By one thread, which must live as long as the child does, except for signal().
class WorkerProcess {
 public:
  /// Throws Error if the program cannot be started.
  WorkerProcess(const std::vector<std::string>& command, const WorkerLimits& limits);
  /// Kills it and waits for its end.
  ~WorkerProcess();
  WorkerProcess(const WorkerProcess&) = delete;
  WorkerProcess& operator=(const WorkerProcess&) = delete;

  pid_t id() const { return id_; }
  int output() const { return output_; }  // for poll: readable
  int errors() const { return errors_; }
  int input() const { return unsent_.empty() ? -1 : input_; }  // for poll: writable

  /// Queues a line for stdin; write() sends it.
  void send(std::string line);
  void write();
  /// Reads what the process has written, 256 KiB of it at most. False: its stdout is at its end.
  bool read();
  /// The next complete line; valid until read(). Throws Error if a line is longer than the limit.
  std::optional<std::string_view> next_line();
  /// To the whole process group. Any thread, while the object exists.
  void signal(int number) const;
  /// Waits 0.2 s at most for the end of a process that has closed its stdout.
  void await_end() const;
  /// Kills it, waits for its end and returns how it ended: "was killed by signal 9 (Killed)", with the end of its stderr. Not at the
  /// same time as signal().
  std::string end();
  /// After end(): it had ended before, with code 0.
  bool ended_by_itself() const { return by_itself_; }

 private:
  void start(const std::vector<std::string>& command, const WorkerLimits& limits);
  void read_errors();
  bool has_ended() const;

  std::uint64_t most_line_;
  pid_t id_ = -1;
  int input_ = -1, output_ = -1, errors_ = -1;
  std::string unsent_, received_, tail_;  // tail_: of stderr
  std::size_t taken_ = 0;                 // of received_
  bool by_itself_ = false;
  std::size_t searched_ = 0;  // of received_, without an end of line
};

}  // namespace cotwin::gateway
