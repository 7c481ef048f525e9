#pragma once
#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

/// Runs programs as child processes of a test.
namespace cotwin::testing {

struct RunOptions {
  std::filesystem::path folder = {};          // working directory; empty: that of the test
  std::vector<std::string> environment = {};  // "NAME=value": added to the environment of the test
  bool only_this_environment = false;         // the child does not inherit the environment of the test
  bool merge = false;                         // stderr is written to RunResult::out, too
  std::filesystem::path out = {};             // file for stdout, e.g. /dev/full; empty: RunResult::out
  std::chrono::seconds limit{300};            // of wall time, after which the process is killed
  std::function<bool()> prepare = {};  // called in the child before the program starts; must not allocate. false: exit code 99
};

struct RunResult {
  int code = -1;         // exit code; −signal if a signal ended the process
  std::string out, err;  // its output
  long memory = 0;       // KiB, peak of resident memory
  double cpu = 0;        // s, user and system time
};

/// A running child process. The destructor kills it.
class Process {
 public:
  /// Starts `command`: program (a path, or a name to look up in PATH) and arguments. Throws std::runtime_error if that fails.
  explicit Process(std::vector<std::string> command, const RunOptions& options = {});
  Process(Process&& other) noexcept;
  Process& operator=(Process&& other) noexcept;
  ~Process();

  pid_t id() const { return id_; }
  void signal(int number) const;
  /// Waits for the end of the process; kills it at the time limit and adds a line to RunResult::err. Call it once.
  RunResult wait();

 private:
  pid_t id_ = -1;  // -1: waited for
  int out_ = -1, err_ = -1;
  std::chrono::steady_clock::time_point end_;
  std::chrono::seconds limit_{0};
};

/// The words of a text that has no quotes: "run x.fmu --quiet".
std::vector<std::string> words(std::string_view text);

RunResult run_command(std::vector<std::string> command, const RunOptions& options = {});

/// The program `cotwin` of this build with these arguments.
Process start_program(std::vector<std::string> arguments, const RunOptions& options = {});
RunResult run_program(std::vector<std::string> arguments, const RunOptions& options = {});

}  // namespace cotwin::testing
