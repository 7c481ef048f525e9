#include "components/gateway/jobs/worker_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstring>
#include <utility>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::gateway {

namespace {

constexpr std::size_t kRound = std::size_t{256} << 10;  // bytes that one read() takes at most
constexpr std::size_t kTail = 600;                      // bytes of stderr that are kept
constexpr int kFirstDescriptor = 3;                     // after stdin, stdout, stderr
constexpr int kMostDescriptors = 1 << 16;
constexpr int kWaits = 40, kWait_ms = 5;  // for the end of a process that has closed its stdout

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kLimitsMemory = false;  // shadow memory of the sanitizers is counted as data
#else
constexpr bool kLimitsMemory = true;
#endif

/// Two ends of a pipe or socket pair; those that are still here are closed at the end.
struct Ends {
  int ours = -1, childs = -1;
  Ends() = default;
  ~Ends() {
    if (ours >= 0) close(ours);
    if (childs >= 0) close(childs);
  }
  Ends(const Ends&) = delete;
  Ends& operator=(const Ends&) = delete;
};

/// Above the standard descriptors, with close-on-exec: dup2 onto those must not meet one that is still needed.
int move_up(int descriptor) {
  const int moved = fcntl(descriptor, F_DUPFD_CLOEXEC, kFirstDescriptor);
  const int error = errno;
  close(descriptor);
  if (moved < 0) throw Error("no file descriptor for a worker: " + system_reason(error));
  return moved;
}

void take(Ends& ends, const std::array<int, 2>& made, bool child_writes) {
  ends.ours = made[child_writes ? 0 : 1];
  ends.childs = made[child_writes ? 1 : 0];
  ends.ours = move_up(std::exchange(ends.ours, -1));
  ends.childs = move_up(std::exchange(ends.childs, -1));
  fcntl(ends.ours, F_SETFL, O_NONBLOCK);
}

void make_pipe(Ends& ends) {
  std::array<int, 2> made{};
  if (pipe(made.data()) != 0) throw Error("cannot create a pipe to a worker: " + system_reason(errno));
  take(ends, made, true);
}

// A socket, because send() can be asked not to raise SIGPIPE.
void make_input(Ends& ends) {
  std::array<int, 2> made{};
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, made.data()) != 0)
    throw Error("cannot create a socket to a worker: " + system_reason(errno));
  take(ends, made, false);
}

struct ChildPlan {
  char* const* arguments;
  int input, output, errors, report;
  pid_t parent;
  int nice;
  rlim_t memory;
};

/// Runs in the child between vfork and exec, in the memory of the parent: system calls only.
[[noreturn]] void become_worker(const ChildPlan& plan) {
#ifdef __linux__
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != plan.parent) _exit(127);  // the parent ended before
#endif
  setpgid(0, 0);
  dup2(plan.input, STDIN_FILENO);
  dup2(plan.output, STDOUT_FILENO);
  dup2(plan.errors, STDERR_FILENO);
#ifdef CLOSE_RANGE_CLOEXEC
  const bool closed = close_range(kFirstDescriptor, UINT_MAX, CLOSE_RANGE_CLOEXEC) == 0;
#else
  const bool closed = false;
#endif
  if (!closed) {
    for (int descriptor = kFirstDescriptor; descriptor < kMostDescriptors; ++descriptor) fcntl(descriptor, F_SETFD, FD_CLOEXEC);
  }
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);
  if (plan.memory > 0) {
    const rlimit memory{plan.memory, plan.memory};
    setrlimit(RLIMIT_DATA, &memory);
  }
  if (plan.nice > 0) setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + plan.nice);
  for (int number = 1; number < NSIG; ++number) signal(number, SIG_DFL);  // SIGKILL and SIGSTOP fail
  sigset_t all;
  sigemptyset(&all);
  sigprocmask(SIG_SETMASK, &all, nullptr);
  execv(plan.arguments[0], plan.arguments);
  const int error = errno;
  static_cast<void>(!::write(plan.report, &error, sizeof error));
  _exit(127);
}

/// Not fork: a copy of this process's page tables would delay its real-time threads.
pid_t spawn(const ChildPlan& plan) {
  const pid_t child = vfork();
  if (child == 0) become_worker(plan);
  return child;
}

std::string printable(const std::string& text) {
  std::string shown = text;
  for (char& c : shown) {
    if (c < ' ' || c > '~') c = c == '\n' ? ' ' : '?';
  }
  while (!shown.empty() && shown.back() == ' ') shown.pop_back();
  return shown;
}

}  // namespace

WorkerProcess::WorkerProcess(const std::vector<std::string>& command, const WorkerLimits& limits) : most_line_(limits.line) {
  start(command, limits);
}

void WorkerProcess::start(const std::vector<std::string>& command, const WorkerLimits& limits) {
  Ends input, output, errors, report;
  make_input(input);
  make_pipe(output);
  make_pipe(errors);
  make_pipe(report);
  std::vector<std::string> words = command;
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const ChildPlan plan{arguments.data(), input.childs, output.childs, errors.childs,
                       report.childs,    getpid(),     limits.nice,   kLimitsMemory ? static_cast<rlim_t>(limits.memory) : 0};
  sigset_t all, before;  // no handler of this program may run in the child
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t child = spawn(plan);
  const int error = errno;
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  if (child < 0) throw Error(words[0], "cannot be started: " + system_reason(error));
  close(std::exchange(report.childs, -1));
  fcntl(report.ours, F_SETFL, 0);
  int exec_error = 0;
  ssize_t n = 0;
  do n = ::read(report.ours, &exec_error, sizeof exec_error);
  while (n < 0 && errno == EINTR);
  if (n > 0) {
    while (waitpid(child, nullptr, 0) < 0 && errno == EINTR) continue;
    throw Error(words[0], "cannot be started as a worker: " + system_reason(exec_error));
  }
  id_ = child;
  input_ = std::exchange(input.ours, -1);
  output_ = std::exchange(output.ours, -1);
  errors_ = std::exchange(errors.ours, -1);
}

WorkerProcess::~WorkerProcess() {
  end();
  for (const int descriptor : {input_, output_, errors_}) {
    if (descriptor >= 0) close(descriptor);
  }
}

void WorkerProcess::send(std::string line) {
  unsent_ += std::move(line);
  unsent_ += '\n';
}

void WorkerProcess::write() {
  while (!unsent_.empty()) {
    const ssize_t n = ::send(input_, unsent_.data(), unsent_.size(), MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
    if (n < 0) return unsent_.clear();  // it does not read any more: the end of its stdout will come
    unsent_.erase(0, static_cast<std::size_t>(n));
  }
}

bool WorkerProcess::read() {
  read_errors();
  received_.erase(0, taken_);
  searched_ -= std::min(searched_, taken_);
  taken_ = 0;
  std::array<char, 1 << 16> bytes;
  for (std::size_t total = 0; total < kRound;) {
    const ssize_t n = ::read(output_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
    if (n == 0) return false;
    received_.append(bytes.data(), static_cast<std::size_t>(n));
    total += static_cast<std::size_t>(n);
  }
  return true;
}

std::optional<std::string_view> WorkerProcess::next_line() {
  const std::size_t end = received_.find('\n', std::max(searched_, taken_));
  const std::size_t size = (end == std::string::npos ? received_.size() : end) - taken_;
  if (size > most_line_)
    throw Error("the worker wrote a line of more than " + std::to_string(most_line_) + " bytes, which is the limit");
  if (end == std::string::npos) {
    searched_ = received_.size();
    return std::nullopt;
  }
  const std::string_view line(received_.data() + taken_, size);
  taken_ = searched_ = end + 1;
  return line;
}

void WorkerProcess::read_errors() {
  std::array<char, 1 << 12> bytes;
  if (errors_ < 0) return;
  for (std::size_t total = 0; total < kRound;) {
    const ssize_t n = ::read(errors_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n == 0) {  // else poll would report it again and again
      close(std::exchange(errors_, -1));
      return;
    }
    if (n < 0) return;
    tail_.append(bytes.data(), static_cast<std::size_t>(n));
    if (tail_.size() > kTail) tail_.erase(0, tail_.size() - kTail);
    total += static_cast<std::size_t>(n);
  }
}

void WorkerProcess::signal(int number) const {
  if (id_ > 0) ::kill(-id_, number);
}

// Without reaping: until then no other process has its number.
bool WorkerProcess::has_ended() const {
  siginfo_t info{};
  return waitid(P_PID, static_cast<id_t>(id_), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == id_;
}

void WorkerProcess::await_end() const {
  for (int waits = 0; !has_ended() && waits < kWaits; ++waits) poll(nullptr, 0, kWait_ms);
}

std::string WorkerProcess::end() {
  if (id_ <= 0) return "had ended";
  const bool killed = !has_ended();
  signal(SIGKILL);
  int status = 0;
  pid_t ended = 0;
  do ended = waitpid(id_, &status, 0);
  while (ended < 0 && errno == EINTR);
  id_ = -1;
  by_itself_ = !killed && ended >= 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0;
  read_errors();
  std::string how = killed      ? "was killed by the gateway"
                    : ended < 0 ? "has ended"
                    : WIFSIGNALED(status)
                        ? "was killed by signal " + std::to_string(WTERMSIG(status)) + " (" + strsignal(WTERMSIG(status)) + ")"
                        : "exited with code " + std::to_string(WEXITSTATUS(status));
  if (const std::string last = printable(tail_); !last.empty()) how += "; it wrote to stderr: " + last;
  return how;
}

}  // namespace cotwin::gateway
