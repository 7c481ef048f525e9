#include "fmu/process.h"

#include <fcntl.h>
#include <linux/futex.h>
#include <poll.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <system_error>
#include <thread>

#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::fmu {

namespace {

using Steady = std::chrono::steady_clock;

constexpr std::size_t kTextBytes = 256u << 20;  // reserved, not used: a page costs memory when it is written
constexpr std::size_t kMessageBytes = 8192;
constexpr int kLooks = 400;                             // before a wait sleeps: 5 to 20 µs
constexpr auto kSlice = std::chrono::milliseconds(20);  // between two looks at whether the child lives
constexpr auto kGrace = std::chrono::seconds(2);        // for the end of a child that was asked to

enum class Verb : std::uint32_t { kMake, kInitialise, kStep, kSave, kRestore, kEnd };
enum class Reply : std::uint32_t { kDone, kDiscard, kFinished, kError };

/// In the shared memory, in front of the values.
struct Header {
  std::atomic<std::uint32_t> asked{0}, answered{0};  // calls so far; futexes
  Verb verb = Verb::kEnd;
  Reply reply = Reply::kDone;
  std::int64_t now_ns = 0, h_ns = 0;
  std::uint64_t text_bytes = 0;  // of texts and of a state
  char message[kMessageBytes] = "";
};
static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

void wake(std::atomic<std::uint32_t>& word) { syscall(SYS_futex, &word, FUTEX_WAKE, 1, nullptr, nullptr, 0); }

void sleep_on(std::atomic<std::uint32_t>& word, std::uint32_t while_it_is, std::chrono::nanoseconds at_most) {
  timespec time{};
  time.tv_sec = static_cast<time_t>(at_most.count() / 1'000'000'000);
  time.tv_nsec = static_cast<long>(at_most.count() % 1'000'000'000);
  syscall(SYS_futex, &word, FUTEX_WAIT, while_it_is, &time, nullptr, 0);
}

bool look_for(const std::atomic<std::uint32_t>& word, std::uint32_t wanted) {
  static const bool alone = std::thread::hardware_concurrency() < 2;
  for (int i = 0; i < (alone ? 1 : kLooks); ++i) {
    if (word.load(std::memory_order_acquire) == wanted) return true;
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#endif
  }
  return false;
}

bool goes_in(Role role) { return role == Role::kInput || role == Role::kTunable; }
bool comes_out(Role role) { return role == Role::kOutput || role == Role::kState; }
bool every(Role) { return true; }

/// The bytes of a variable that is no text.
template <class Call>
void each_number(const cotwin::Variable& v, Call call) {
  std::visit(
      [&](auto values) {
        if constexpr (!std::is_same_v<typename decltype(values)::value_type, std::string>)
          call(values.data(), values.size_bytes());
      },
      v.storage);
  call(v.rate.data(), v.rate.size_bytes());
}

std::string name_of_signal(int number) {
  const char* name = sigdescr_np(number);
  return "signal " + std::to_string(number) + (name != nullptr ? std::string(" (") + name + ")" : "");
}

}  // namespace

/// The memory that both processes see, and what each knows of the other.
struct ProcessUnit::Channel {
  explicit Channel(const Variables& list) {
    for (const cotwin::Variable& v : list) each_number(v, [&](void*, std::size_t n) { numbers += n; });
    numbers = (numbers + 63) / 64 * 64;
    bytes = sizeof(Header) + numbers + kTextBytes;
    void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (memory == MAP_FAILED) throw Error("no memory to share with another process: " + std::generic_category().message(errno));
    header = new (memory) Header;
    values = static_cast<char*>(memory) + sizeof(Header);
    texts = values + numbers;
  }
  ~Channel() {
    if (lifeline >= 0) close(lifeline);
    munmap(header, bytes);
  }
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  /// Writes those variables whose role `wanted` accepts; texts from `text` on, which is moved behind them.
  void write(const Variables& list, bool (*wanted)(Role), std::size_t& text) {
    char* out = values;
    for (const cotwin::Variable& v : list) {
      const bool skip = !wanted(v.role);
      each_number(v, [&](const void* at, std::size_t n) {
        if (!skip && n > 0) std::memcpy(out, at, n);
        out += n;
      });
      if (v.kind() == Kind::kString && !skip) {
        for (const std::string& s : v.strings()) append(s, text);
      }
    }
    header->text_bytes = text;
  }
  void read(const Variables& list, bool (*wanted)(Role), std::size_t& text) const {
    const char* in = values;
    for (const cotwin::Variable& v : list) {
      const bool skip = !wanted(v.role);
      each_number(v, [&](void* at, std::size_t n) {
        if (!skip && n > 0) std::memcpy(at, in, n);
        in += n;
      });
      if (v.kind() == Kind::kString && !skip) {
        for (std::string& s : v.strings()) take(s, text);
      }
    }
  }
  /// What the child does until it is told to end.
  [[noreturn]] void serve(const std::function<std::unique_ptr<ForeignUnit>()>& make, int pipe);
  void answer(const std::function<std::unique_ptr<ForeignUnit>()>& make);

  void append(const std::string& s, std::size_t& at) {
    const std::uint64_t n = s.size();
    if (at + sizeof n + n > kTextBytes)
      throw Error("texts of more than " + std::to_string(kTextBytes) + " bytes do not fit between two processes");
    std::memcpy(texts + at, &n, sizeof n);
    std::memcpy(texts + at + sizeof n, s.data(), s.size());
    at += sizeof n + s.size();
  }
  void take(std::string& s, std::size_t& at) const {
    std::uint64_t n = 0;
    if (at + sizeof n > header->text_bytes) throw Error("a text of the FMU's process is missing");
    std::memcpy(&n, texts + at, sizeof n);
    if (n > header->text_bytes - at - sizeof n) throw Error("a text of the FMU's process is cut short");
    s.assign(texts + at + sizeof n, n);
    at += sizeof n + n;
  }

  Header* header = nullptr;
  char* values = nullptr;
  char* texts = nullptr;
  std::size_t numbers = 0, bytes = 0;
  std::uint32_t calls = 0;
  pid_t child = -1;
  int lifeline = -1;  // the parent's end of a pipe that nobody writes to

  // The child's.
  std::unique_ptr<ForeignUnit> unit;
  Variables variables;
  std::string state;
};

void ProcessUnit::Channel::serve(const std::function<std::unique_ptr<ForeignUnit>()>& make, int pipe) {
  // What belongs to the program and came along: signal handlers, files, sockets.
  for (const int signal : {SIGTERM, SIGHUP, SIGPIPE, SIGUSR1, SIGUSR2, SIGALRM, SIGCHLD}) ::signal(signal, SIG_DFL);
  ::signal(SIGINT, SIG_IGN);  // Ctrl-C reaches the whole group: the parent ends the run, and then this
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  if (pipe > 3) close_range(3, static_cast<unsigned>(pipe) - 1, 0);
  close_range(static_cast<unsigned>(pipe) + 1, ~0u, 0);
  std::thread([pipe] {
    pollfd parent{pipe, POLLIN, 0};
    while (poll(&parent, 1, -1) < 0 && errno == EINTR) {
    }
    _exit(0);  // the parent is gone, whatever the FMU is doing
  }).detach();
  for (std::uint32_t n = 1;; ++n) {
    while (!look_for(header->asked, n)) sleep_on(header->asked, n - 1, std::chrono::seconds(10));
    const bool ends = header->verb == Verb::kEnd;
    header->reply = Reply::kDone;
    try {
      answer(make);
    } catch (const std::exception& error) {
      header->reply = Reply::kError;
      std::strncpy(header->message, error.what(), kMessageBytes - 1);
    } catch (...) {
      header->reply = Reply::kError;
      std::strncpy(header->message, "the FMU threw something that is no exception", kMessageBytes - 1);
    }
    header->answered.store(n, std::memory_order_release);
    wake(header->answered);
    if (ends) _exit(0);  // not exit(): what the program does at its end is not to be done here
  }
}

void ProcessUnit::Channel::answer(const std::function<std::unique_ptr<ForeignUnit>()>& make) {
  std::size_t in = 0, out = 0;
  switch (header->verb) {
    case Verb::kMake:
      unit = make();
      unit->declare(variables);
      return;
    case Verb::kInitialise:
      read(variables, every, in);
      unit->initialise({header->now_ns});
      write(variables, every, out);
      return;
    case Verb::kStep: {
      read(variables, goes_in, in);
      const StepResult result = unit->step({header->now_ns}, {header->h_ns});
      write(variables, comes_out, out);
      header->reply = result == StepResult::kDone      ? Reply::kDone
                      : result == StepResult::kDiscard ? Reply::kDiscard
                                                       : Reply::kFinished;
      return;
    }
    case Verb::kSave:
      read(variables, goes_in, in);  // what was set since the last step is what the FMU does not know yet
      unit->save_memory(state);
      append(state, out);
      header->text_bytes = out;
      return;
    case Verb::kRestore:
      take(state, in);
      read(variables, every, in);
      unit->restore_memory(state);
      return;
    case Verb::kEnd:
      unit.reset();
      return;
  }
}

ProcessUnit::ProcessUnit(std::function<std::unique_ptr<ForeignUnit>()> make, std::shared_ptr<const ForeignFmu> fmu,
                         const ForeignVariablesOptions& variables, bool restorable, double timeout)
    : make_(std::move(make)),
      fmu_(std::move(fmu)),
      variables_(fmu_->description, variables),
      restorable_(restorable),
      timeout_(timeout) {
  variables_.declare(declared_);
  begin();
}

ProcessUnit::~ProcessUnit() { end(); }

void ProcessUnit::declare(Variables& variables) { variables_.declare(variables); }

void ProcessUnit::begin() {
  auto channel = std::make_unique<Channel>(declared_);
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw Error("no pipe to another process: " + std::generic_category().message(errno));
  const pid_t child = fork();
  if (child < 0) {
    close(ends[0]);
    close(ends[1]);
    throw Error("no other process can be made: " + std::generic_category().message(errno));
  }
  if (child == 0) {
    close(ends[1]);
    channel->serve(make_, ends[0]);
  }
  close(ends[0]);
  channel->lifeline = ends[1];
  channel->child = child;
  channel_ = std::move(channel);
  channel_->header->verb = Verb::kMake;
  try {
    call();
  } catch (...) {
    end();
    throw;
  }
}

/// Asks the child to do header->verb, and waits for it. Throws Error for what the child threw, and where it is no more.
void ProcessUnit::call() {
  Channel& c = *channel_;
  const std::uint32_t n = ++c.calls;
  c.header->asked.store(n, std::memory_order_release);
  wake(c.header->asked);
  if (!look_for(c.header->answered, n)) {
    const Steady::time_point limit =
        Steady::now() + std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(timeout_));
    while (c.header->answered.load(std::memory_order_acquire) != n) {
      sleep_on(c.header->answered, n - 1, kSlice);
      if (c.header->answered.load(std::memory_order_acquire) == n) break;
      int status = 0;
      const pid_t ended = waitpid(c.child, &status, WNOHANG);
      if (ended == c.child || (ended < 0 && errno == ECHILD)) {
        c.child = -1;
        if (ended < 0) lost("ended");
        lost(WIFSIGNALED(status) ? "was ended by " + name_of_signal(WTERMSIG(status))
                                 : "exited with status " + std::to_string(WEXITSTATUS(status)));
      }
      if (Steady::now() > limit) lost("gave no answer for " + text::to_text(timeout_) + " s and was ended");
    }
  }
  if (c.header->reply == Reply::kError) throw Error(c.header->message);
}

void ProcessUnit::lost(const std::string& how) {
  end();
  throw Error("the FMU's own process " + how);
}

/// A child that does not answer within kGrace is killed; one that gave no answer before is not asked.
void ProcessUnit::end() noexcept {
  if (!channel_) return;
  Channel& c = *channel_;
  if (c.child > 0) {
    const bool answers = c.header->answered.load(std::memory_order_acquire) == c.calls;
    if (answers) {
      c.header->verb = Verb::kEnd;
      c.header->asked.store(++c.calls, std::memory_order_release);
      wake(c.header->asked);
    }
    const Steady::time_point limit = Steady::now() + (answers ? Steady::duration(kGrace) : Steady::duration::zero());
    pid_t ended = 0;
    while ((ended = waitpid(c.child, nullptr, WNOHANG)) == 0 && Steady::now() < limit) {
      const std::uint32_t answered = c.header->answered.load(std::memory_order_acquire);
      if (answered == c.calls) {
        std::this_thread::yield();  // about to exit
      } else {
        sleep_on(c.header->answered, answered, kSlice);
      }
    }
    if (ended == 0) {
      kill(c.child, SIGKILL);
      while (waitpid(c.child, nullptr, 0) < 0 && errno == EINTR) {
      }
    }
  }
  channel_.reset();
}

void ProcessUnit::initialise(Time start) {
  if (!channel_) begin();
  std::size_t text = 0;
  channel_->write(declared_, every, text);
  channel_->header->verb = Verb::kInitialise;
  channel_->header->now_ns = start.ns;
  call();
  text = 0;
  channel_->read(declared_, every, text);
}

StepResult ProcessUnit::step(Time now, Duration h) {
  if (!channel_) throw Error("the FMU's own process has ended: it must be initialised again");
  std::size_t text = 0;
  channel_->write(declared_, goes_in, text);
  Header& header = *channel_->header;
  header.verb = Verb::kStep;
  header.now_ns = now.ns;
  header.h_ns = h.ns;
  call();
  if (header.reply == Reply::kDiscard) return StepResult::kDiscard;
  text = 0;
  channel_->read(declared_, comes_out, text);
  return header.reply == Reply::kFinished ? StepResult::kFinished : StepResult::kDone;
}

void ProcessUnit::save_memory(std::string& bytes) {
  bytes.clear();
  if (!restorable_ || !channel_) return;
  std::size_t text = 0;
  channel_->write(declared_, goes_in, text);
  channel_->header->verb = Verb::kSave;
  call();
  text = 0;
  channel_->take(bytes, text);
}

void ProcessUnit::restore_memory(const std::string& bytes) {
  if (!channel_) begin();
  std::size_t text = 0;
  channel_->append(bytes, text);
  channel_->write(declared_, every, text);
  channel_->header->verb = Verb::kRestore;
  call();
}

}  // namespace cotwin::fmu
