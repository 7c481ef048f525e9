#include "models/foundation/support/process.h"

#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <thread>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin {

namespace {

using Clock = std::chrono::steady_clock;

/// A file in memory: the stdin, stdout or stderr of a process, which cannot block it.
class MemoryFile {
 public:
  explicit MemoryFile(std::string_view content = {}) : descriptor_(::memfd_create("input or output", MFD_CLOEXEC)) {
    if (descriptor_ < 0) throw Error("memory", "no file in it: " + system_reason(errno));
    for (std::size_t done = 0; done < content.size();) {
      const ssize_t n = ::pwrite(descriptor_, content.data() + done, content.size() - done, static_cast<off_t>(done));
      if (n <= 0) {
        const int error = errno;
        ::close(descriptor_);
        throw Error("memory", "the input of a program cannot be written: " + system_reason(error));
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

}  // namespace

bool Ended::well() const { return error == 0 && !late && WIFEXITED(status) && WEXITSTATUS(status) == 0; }

Ended run_process(std::vector<std::string> command, std::string_view input, std::chrono::seconds limit) {
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

}  // namespace cotwin
