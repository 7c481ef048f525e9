#include "master/run/crash.h"

#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <utility>

#include "fmu/import/under_way.h"
#include "fmu/import/watched_calls.h"

namespace cotwin::master {

namespace {

constexpr std::array kCrashes = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
// Signals that end a process unless it handles them: an FMU may call alarm(). Those that the user sends to stop a run are not here.
constexpr std::array kEnding = {SIGALRM, SIGVTALRM, SIGPROF, SIGUSR1, SIGUSR2, SIGSYS, SIGTRAP, SIGIO, SIGPWR, SIGSTKFLT};
constexpr std::size_t kStackBytes = 64 << 10;  // for the handler: the crash may be a stack overflow

std::array<std::atomic<SavedOnCrash*>, 16> saved;
std::array<struct sigaction, NSIG> before;
std::atomic<bool> main_has_ended{false};
std::atomic<pid_t> own_process{0};  // an FMU may fork: its child has nothing to save
std::atomic_flag ending = ATOMIC_FLAG_INIT;
const fmu::UnderWay* of_main_thread = nullptr;
int exit_code = 1;
alignas(16) std::array<char, kStackBytes> stack;

/// A text of limited length; the excess is dropped.
class CrashText {
 public:
  CrashText& operator<<(std::string_view s) {
    const std::size_t n = std::min(s.size(), room_.size() - used_);
    std::memcpy(room_.data() + used_, s.data(), n);
    used_ += n;
    return *this;
  }
  CrashText& operator<<(std::int64_t value) {
    std::array<char, 24> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return *this << std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data()));
  }
  CrashText& seconds(std::int64_t ns) {
    if (ns < 0) *this << "-";
    const std::int64_t magnitude = ns < 0 ? -ns : ns;
    *this << magnitude / 1'000'000'000;
    std::int64_t fraction = magnitude % 1'000'000'000;
    if (fraction == 0) return *this;
    *this << ".";
    for (std::int64_t digit = 100'000'000; fraction > 0; fraction %= digit, digit /= 10) *this << fraction / digit;
    return *this;
  }
  void write() const {
    for (std::size_t done = 0; done < used_;) {
      const ssize_t n = ::write(STDERR_FILENO, room_.data() + done, used_ - done);
      if (n <= 0) return;
      done += static_cast<std::size_t>(n);
    }
  }

 private:
  std::array<char, 2048> room_;
  std::size_t used_ = 0;
};

/// On a terminal, begins a new line after a progress bar.
void begin_message(CrashText& text) { text << (isatty(STDERR_FILENO) != 0 ? "\ncotwin: " : "cotwin: "); }

/// The FMU call that this thread is in, otherwise that of the main thread; nullptr if there is none.
const fmu::UnderWay* call_under_way() {
  if (fmu::under_way().function != nullptr) return &fmu::under_way();
  return of_main_thread != nullptr && of_main_thread->function != nullptr ? of_main_thread : nullptr;
}

void name_call(CrashText& text, const fmu::UnderWay& call) {
  text << "component '" << call.place->instance << "' at t = ";
  text.seconds(call.ns) << " s: " << call.place->fmu << ": " << call.function;
}

}  // namespace

struct CrashHandler {
  static void save(CrashText& text) {
    for (std::atomic<SavedOnCrash*>& slot : saved) {
      SavedOnCrash* const one = slot.exchange(nullptr);
      if (one == nullptr) continue;
      one->save_(one->object_);
      if (!one->file_.empty()) text << "; the rows up to then are in " << one->file_;
    }
  }

  static void add(SavedOnCrash* one) {
    for (std::atomic<SavedOnCrash*>& slot : saved) {
      SavedOnCrash* none = nullptr;
      if (slot.compare_exchange_strong(none, one)) return;
    }
  }
  static void remove(SavedOnCrash* one) {
    for (std::atomic<SavedOnCrash*>& slot : saved) {
      SavedOnCrash* expected = one;
      if (slot.compare_exchange_strong(expected, nullptr)) return;
    }
  }
  /// If several threads crash or get signals at the same time, only the first ends the program; the others block here. No signal
  /// may be handled from here on in this thread, for it would block here, too.
  static void enter() {
    if (!ending.test_and_set()) return;
    for (;;) pause();
  }

  static void on_signal(int number) {
    if (getpid() != own_process) return pass_on(number);
    enter();
    const fmu::UnderWay* const call = call_under_way();
    const char* description = sigdescr_np(number);
    CrashText text;
    begin_message(text);
    if (call != nullptr) {
      name_call(text, *call);
      text << " was ended by ";
    } else {
      text << "ended by ";
    }
    text << "signal " << std::int64_t{number} << " (" << (description != nullptr ? description : "unknown") << ")";
    save(text);
    text << "\n";
    text.write();
    note_end(fmu::WatchedCalls::End::kReported);
    if (call != nullptr) end_now(exit_code);
    pass_on(number);
  }
  /// The signal has its previous effect when the handler returns.
  static void pass_on(int number) {
    sigaction(number, &before[static_cast<std::size_t>(number)], nullptr);
    raise(number);
  }

  static void on_exit(int status, const char* function) {
    if (main_has_ended || getpid() != own_process) return;
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, nullptr);
    enter();
    CrashText text;
    begin_message(text);
    if (const fmu::UnderWay* const call = call_under_way()) {
      name_call(text, *call);
      text << " called ";
    } else {
      text << "the run was ended by ";
    }
    text << function << "(" << std::int64_t{status} << ")";
    save(text);
    text << "\n";
    text.write();
    note_end(fmu::WatchedCalls::End::kReported);
    end_now(exit_code);
  }

  static void note_end(fmu::WatchedCalls::End end) {
    if (fmu::watched_calls != nullptr) fmu::watched_calls->end = end;
  }
  static void note_expected_end() {
    if (fmu::watched_calls == nullptr) return;
    auto none = fmu::WatchedCalls::End::kUnexpected;
    fmu::watched_calls->end.compare_exchange_strong(none, fmu::WatchedCalls::End::kExpected);
  }
};

SavedOnCrash::SavedOnCrash(Save save, void* object, std::string file) : save_(save), object_(object), file_(std::move(file)) {
  CrashHandler::add(this);
}

SavedOnCrash::~SavedOnCrash() { CrashHandler::remove(this); }

EndingSignalsBlocked::EndingSignalsBlocked() noexcept {
  sigset_t ending_signals;
  sigemptyset(&ending_signals);
  for (const int number : kEnding) sigaddset(&ending_signals, number);
  pthread_sigmask(SIG_BLOCK, &ending_signals, &before_);
}

EndingSignalsBlocked::~EndingSignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

void catch_crashes(int code) {
  exit_code = code;
  process_begins();
  stack_t alternative{};
  alternative.ss_sp = stack.data();
  alternative.ss_size = stack.size();
  sigaltstack(&alternative, nullptr);
  struct sigaction action = {};
  action.sa_handler = CrashHandler::on_signal;
  action.sa_flags = SA_ONSTACK | SA_RESTART;
  for (const int number : kCrashes) sigaddset(&action.sa_mask, number);
  for (const int number : kEnding) sigaddset(&action.sa_mask, number);
  const auto handle = [&](int number) -> const struct sigaction& {
    struct sigaction& earlier = before[static_cast<std::size_t>(number)];
    sigaction(number, &action, &earlier);
    return earlier;
  };
  for (const int number : kCrashes) handle(number);
  for (const int number : kEnding) {  // one that is ignored, or handled by a preloaded profiler, ends nothing
    const struct sigaction& earlier = handle(number);
    if (earlier.sa_handler != SIG_DFL) sigaction(number, &earlier, nullptr);
  }
  ::on_exit([](int status, void*) { CrashHandler::on_exit(status, "exit"); }, nullptr);
  std::at_quick_exit([] { CrashHandler::on_exit(0, "quick_exit"); });
}

void process_begins() {
  own_process = getpid();
  of_main_thread = &fmu::under_way();
}

void exit_called(int status, const char* function) noexcept { CrashHandler::on_exit(status, function); }

void end_now(int code) noexcept {
  if (getpid() == own_process) CrashHandler::note_expected_end();
  for (;;) syscall(SYS_exit_group, code);
}

void main_ends() {
  main_has_ended = true;
  CrashHandler::note_expected_end();
}

}  // namespace cotwin::master
