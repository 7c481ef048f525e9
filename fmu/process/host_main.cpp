// The program cotwin-fmu-host: runs one FMU for the program that started it (process.h). It is two processes: one with the FMU, and
// one that ends what the FMU has started.
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>

#include "fmu/import/package.h"
#include "fmu/import/unit/fmu_unit.h"
#include "fmu/import/unit/model_exchange.h"
#include "fmu/process/channel.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

class Host {
 public:
  explicit Host(Channel channel) : channel_(std::move(channel)), header_(channel_.header()) {}

  [[noreturn]] void serve() {
    for (std::uint32_t n = 1;; ++n) {
      if (!spin_.wait_for(header_.asked, n, header_.may_spin != 0)) {
        while (!sleep_for(header_.asked, n, header_.host_sleeps, std::chrono::seconds(10))) {
        }
      }
      const bool ends = header_.verb == Verb::kEnd;
      header_.reply = Reply::kDone;
      try {
        answer();
      } catch (const std::exception& error) {
        reply_error(error.what());
      } catch (...) {
        reply_error("the FMU threw an exception, expected a status");
      }
      if (ends) std::fflush(nullptr);
      post(header_.answered, n, header_.program_sleeps);
      if (ends) _exit(0);  // the FMU's library is already unloaded, so exit handlers are not needed
    }
  }

 private:
  void reply_error(const char* why) {
    header_.reply = Reply::kError;
    std::strncpy(header_.message, why, ChannelHeader::kMessageBytes - 1);
  }
  void answer();
  void make();

  Channel channel_;
  ChannelHeader& header_;
  SpinWait spin_;
  std::unique_ptr<ForeignUnit> unit_;
  Variables variables_;
  std::string state_;
};

void Host::make() {
  std::size_t in = 0;
  ForeignPackage package;
  {
    std::string bytes;  // hundreds of MB for a million variables
    channel_.take(bytes, in);
    package = deserialise_foreign(bytes, "the FMU's description");
  }
  std::string folder;
  channel_.take(folder, in);
  auto fmu = std::make_shared<ForeignFmu>();
  fmu->name = package.name;
  fmu->folder = folder;
  fmu->description = std::move(package.description);
  const UnitOptions options = unit_options(fmu->description, package.options);
  if (chosen_kind(fmu->description, package.options.kind) == InterfaceKind::kCoSimulation) {
    unit_ = std::make_unique<FmuUnit>(std::move(fmu), options);
  } else {
    unit_ = std::make_unique<ModelExchangeUnit>(std::move(fmu), options);
  }
  unit_->declare(variables_);
  channel_.check_layout(variables_);
  std::size_t out = 0;
  channel_.clear_texts();
  for (const std::string& warning : unit_->warnings()) channel_.append(warning, out);
}

void Host::answer() {
  std::size_t in = 0, out = 0;
  switch (header_.verb) {
    case Verb::kMake:
      return make();
    case Verb::kInitialise:
      channel_.read(variables_, Channel::any, in);
      unit_->initialise({header_.now_ns});
      channel_.write(variables_, Channel::any, out);
      return;
    case Verb::kEnter:
      channel_.read(variables_, Channel::any, in);
      unit_->enter_initialisation({header_.now_ns});
      channel_.write(variables_, Channel::any, out);
      return;
    case Verb::kUpdate:
      channel_.read(variables_, Channel::any, in);
      unit_->update_initialisation();
      channel_.write(variables_, Channel::any, out);
      return;
    case Verb::kExit:
      channel_.read(variables_, Channel::any, in);
      unit_->exit_initialisation();
      channel_.write(variables_, Channel::any, out);
      return;
    case Verb::kStep: {
      channel_.read(variables_, Channel::is_input, in);
      const StepResult result = unit_->step({header_.now_ns}, {header_.h_ns});
      channel_.write(variables_, Channel::is_output, out);
      header_.reply = result == StepResult::kDone      ? Reply::kDone
                      : result == StepResult::kDiscard ? Reply::kDiscard
                                                       : Reply::kFinished;
      return;
    }
    case Verb::kSave:
      channel_.take(state_, in);
      channel_.read(variables_, Channel::is_input, in);  // inputs set since the last step are not in the FMU yet
      unit_->save_memory(state_);
      channel_.append(state_, out);
      return;
    case Verb::kRestore:
      channel_.take(state_, in);
      channel_.read(variables_, Channel::any, in);
      unit_->restore_memory(state_);
      return;
    case Verb::kTell: {
      std::vector<std::string> notes;
      unit_->append_notes(notes);
      channel_.clear_texts();
      for (const std::string& note : notes) channel_.append(note, out);
      return;
    }
    case Verb::kEnd:
      unit_.reset();
      return;
  }
}

/// Makes allocations above the limit fail. Not with a sanitizer, which reserves more memory for itself; then only the program's
/// check of the resident memory applies.
void limit_memory([[maybe_unused]] std::uint64_t bytes) {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  constexpr std::uint64_t kOwn = 64u << 20;  // bytes that this program uses itself
  rlimit limit{bytes + kOwn, bytes + kOwn};
  setrlimit(RLIMIT_DATA, &limit);
#endif
}

[[noreturn]] void serve(Channel channel, pid_t supervisor) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != supervisor) raise(SIGKILL);    // it ended before
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);  // line buffered, so that output before a crash is not lost
  limit_memory(channel.header().memory_limit);
  own_call.mirror = channel.header().function;
  Host(std::move(channel)).serve();
}

/// Kills the children of this process, and theirs, which then become its own.
void kill_children() {
  const std::string list = "/proc/self/task/" + std::to_string(getpid()) + "/children";
  for (;;) {
    std::ifstream children(list);
    pid_t child = 0;
    if (!(children >> child)) return;
    do {
      kill(child, SIGKILL);
    } while (children >> child);
    while (waitpid(-1, nullptr, 0) > 0 || errno == EINTR) {
    }
  }
}

/// Waits for the end of the process with the FMU, and kills it as soon as the program has ended. Then ends all processes that the
/// FMU has started, wherever they have moved, and ends like its process.
[[noreturn]] void supervise(pid_t served) {
  const int ended = static_cast<int>(syscall(SYS_pidfd_open, served, 0));
  const int patience = ended < 0 ? 20 : -1;  // ms: without such descriptors the process is asked
  std::array<pollfd, 2> events{{{kLifelineDescriptor, POLLIN, 0}, {ended, POLLIN, 0}}};
  int status = 0;
  for (pid_t one = 0; one != served; one = waitpid(served, &status, WNOHANG)) {
    if (one < 0 && errno != EINTR) _exit(1);
    if (poll(events.data(), events.size(), patience) <= 0 || events[0].revents == 0) continue;
    kill(served, SIGKILL);
    events[0].fd = -1;
  }
  kill_children();
  if (WIFEXITED(status)) _exit(WEXITSTATUS(status));
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);  // its process has written one if that is wanted
  signal(WTERMSIG(status), SIG_DFL);
  raise(WTERMSIG(status));
  _exit(1);
}

int run() {
  try {
    Channel channel = Channel::open(kMemoryDescriptor);
    close_range(static_cast<unsigned>(kLifelineDescriptor) + 1, ~0u, 0);
    prctl(PR_SET_CHILD_SUBREAPER, 1);
    const pid_t supervisor = getpid(), served = fork();
    if (served == 0) serve(std::move(channel), supervisor);
    if (served < 0) throw Error("cannot start a process for the FMU");
    channel.header().served = served;
    supervise(served);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s; only cotwin starts this program\n", kHostProgram, error.what());
    return 2;
  }
}

}  // namespace

}  // namespace cotwin::fmu

int main() { return cotwin::fmu::run(); }
