#include "master/report/gnuplot.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <initializer_list>
#include <thread>
#include <utility>
#include <vector>

#include "models/foundation/formats/xml.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

using Clock = std::chrono::steady_clock;

/// A file in memory: the stdin, stdout or stderr of a process, which cannot block it.
class MemoryFile {
 public:
  explicit MemoryFile(std::string_view content = {}) : descriptor_(::memfd_create("gnuplot", MFD_CLOEXEC)) {
    if (descriptor_ < 0) throw Error("gnuplot", "no file in memory: " + system_reason(errno));
    for (std::size_t done = 0; done < content.size();) {
      const ssize_t n = ::pwrite(descriptor_, content.data() + done, content.size() - done, static_cast<off_t>(done));
      if (n <= 0) {
        const int error = errno;
        ::close(descriptor_);
        throw Error("gnuplot", "its script cannot be written: " + system_reason(error));
      }
      done += static_cast<std::size_t>(n);
    }
  }
  ~MemoryFile() { ::close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  int descriptor() const { return descriptor_; }
  std::string content() const {
    std::string text;
    std::array<char, 1 << 16> part;
    for (ssize_t n; (n = ::pread(descriptor_, part.data(), part.size(), static_cast<off_t>(text.size()))) > 0;)
      text.append(part.data(), static_cast<std::size_t>(n));
    return text;
  }

 private:
  int descriptor_;
};

struct Ended {
  int error = 0;      // of the start: errno
  bool late = false;  // killed after the time limit
  int status = 0;     // of waitpid
  std::string out, err;
  bool well() const { return error == 0 && !late && WIFEXITED(status) && WEXITSTATUS(status) == 0; }
};

/// Runs a program to its end. Its output files are bounded by its own limits on files.
Ended run_program(std::vector<std::string> command, std::string_view input, std::chrono::seconds limit) {
  const MemoryFile in(input), out, err;
  std::vector<char*> arguments;
  for (std::string& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_init(&actions);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_adddup2(&actions, in.descriptor(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, out.descriptor(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.descriptor(), STDERR_FILENO);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  Ended ended;
  pid_t child = -1;
  ended.error = ::posix_spawnp(&child, arguments.front(), &actions, &attributes, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (ended.error != 0) return ended;
  const Clock::time_point end = Clock::now() + limit;
  for (;;) {
    const pid_t done = ::waitpid(child, &ended.status, ended.late ? 0 : WNOHANG);
    if (done == child || (done < 0 && errno != EINTR)) break;
    if (!ended.late && Clock::now() > end) {
      ended.late = true;
      ::kill(child, SIGKILL);
    } else if (!ended.late) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  ended.out = out.content();
  ended.err = err.content();
  return ended;
}

/// The line of gnuplot's stderr that names the error: the last one that is neither empty nor the marker under the script.
std::string message_of(const std::string& err) {
  std::string message;
  for (const std::string_view line : text::split(err, '\n')) {
    const std::string_view trimmed = text::trim(line);
    if (!trimmed.empty() && trimmed != "^") message = std::string(trimmed.substr(0, 300));
  }
  return message;
}

}  // namespace

Gnuplot::Gnuplot() {
  const char* given = std::getenv("COTWIN_GNUPLOT");
  program_ = given != nullptr && *given != '\0' ? given : "gnuplot";
  const Ended ended = run_program({program_, "--version"}, {}, std::chrono::seconds(20));
  const std::string first(text::trim(std::string_view(ended.out).substr(0, ended.out.find('\n'))));
  if (ended.well() && first.starts_with("gnuplot ")) {
    version_ = first.substr(0, 100);
  } else if (ended.error == ENOENT) {
    lacking_ = "the program '" + program_ + "' is not installed (Debian: gnuplot-nox)";
  } else {
    lacking_ = "the program '" + program_ + "' does not work" +
               (ended.error != 0 ? ": " + system_reason(ended.error) : std::string(", expected gnuplot"));
  }
}

std::string Gnuplot::run(std::string_view script, std::chrono::seconds limit) const {
  if (!available()) throw Error("gnuplot", lacking_);
  Ended ended = run_program({program_, "--default-settings", "-"}, script, limit);
  if (ended.error != 0) throw Error(program_, "cannot be started: " + system_reason(ended.error));
  if (ended.late) throw Error(program_, "was not done after " + std::to_string(limit.count()) + " s");
  if (!ended.well()) {
    const std::string message = message_of(ended.err);
    throw Error(program_, message.empty() ? "ended with an error and no message" : message);
  }
  return std::move(ended.out);
}

std::string Gnuplot::quoted(std::string_view text) {
  std::string plain;
  for (const char c : text) plain += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
  try {
    static_cast<void>(xml::escaped(plain));
  } catch (const Error&) {
    for (char& c : plain) {
      if (static_cast<unsigned char>(c) >= 0x80) c = '?';
    }
  }
  std::string out = "'";
  for (const char c : plain) {
    if (c == '\'')
      out += "’";
    else
      out += c;
  }
  return out + "'";
}

}  // namespace cotwin::report
