#include "fmu/process/process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <system_error>
#include <thread>
#include <utility>

#include "fmu/import/package.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/installation.h"
#include "models/foundation/support/text.h"

extern char** environ;

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

constexpr auto kSlice = std::chrono::milliseconds(20);      // between two checks of the process during a long call
constexpr auto kShortSlice = std::chrono::milliseconds(1);  // the same while the FMU writes much output
constexpr std::uint32_t kCallsBetweenChecks = 256;          // of memory and output, while calls are short
constexpr double kStartFactor = 10;                         // factor on the time limit for instantiation and initialisation
constexpr double kNearlyAll = 0.8;       // of the memory limit: above it a crash is reported as probably out of memory
constexpr std::size_t kTailBytes = 400;  // of the output, for messages
constexpr auto kMostToEnd = std::chrono::seconds(5);  // until a process that does not end when asked is killed
constexpr int kFirstDescriptor = 10;                  // in this program; the descriptors of the started process are below
constexpr int kPipeBytes = 1 << 20;

std::atomic<int> processes{0}, ends_unclean{0};

std::string name_of_signal(int number) {
  const char* name = sigdescr_np(number);
  return "signal " + std::to_string(number) + (name != nullptr ? std::string(" (") + name + ")" : "");
}

std::string system_error(int number) { return std::generic_category().message(number); }

/// Moves a descriptor above those of the started process, with close-on-exec.
int move_up(int descriptor) {
  const int moved = fcntl(descriptor, F_DUPFD_CLOEXEC, kFirstDescriptor);
  const int error = errno;
  close(descriptor);
  if (moved < 0) throw Error("no file descriptor for the FMU's process: " + system_error(error));
  return moved;
}

struct Pipe {
  Pipe() {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) throw Error("cannot create a pipe to the FMU's process: " + system_error(errno));
    read = ends[0];
    write = ends[1];
    read = move_up(std::exchange(read, -1));
    write = move_up(std::exchange(write, -1));
  }
  ~Pipe() {
    if (read >= 0) close(read);
    if (write >= 0) close(write);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int read = -1, write = -1;
};

/// Attributes and file descriptors of the process to start.
class SpawnSettings {
 public:
  SpawnSettings() {
    posix_spawn_file_actions_init(&actions_);
    posix_spawnattr_init(&attributes_);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    posix_spawnattr_setpgroup(&attributes_, 0);  // Ctrl-C must reach only this program, which then ends the process
    posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;

  void pass(int descriptor, int as) { posix_spawn_file_actions_adddup2(&actions_, descriptor, as); }
  void pass_null(int as) { posix_spawn_file_actions_addopen(&actions_, as, "/dev/null", O_RDONLY, 0); }
  pid_t spawn(const fs::path& program, const std::string& name) {
    std::string path = program.string(), fmu = name;
    std::array<char*, 3> arguments = {path.data(), fmu.data(), nullptr};
    pid_t child = -1;
    const int error = posix_spawn(&child, path.c_str(), &actions_, &attributes_, arguments.data(), environ);
    if (error != 0) throw Error(path, "cannot be started: " + system_error(error));
    return child;
  }

 private:
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
};

std::string megabytes(double bytes) { return text::to_text(bytes / 1e6, 6) + " MB"; }

}  // namespace

fs::path host_program() {
  if (const char* chosen = std::getenv("COTWIN_FMU_HOST")) return chosen;
  std::error_code none;
  const fs::path host = installation() / "bin" / kHostProgram;
  return fs::is_regular_file(host, none) ? host : fs::path();
}

int unclean_ends() { return ends_unclean; }

HostProcess::HostProcess(const Variables& variables, std::string name, double timeout, double memory)
    : channel_(variables), name_(std::move(name)), timeout_(timeout), memory_(memory) {
  channel_.header().memory_limit = static_cast<std::uint64_t>(std::min(memory_, 1e18));
  start();
}

void HostProcess::start() {
  const fs::path program = host_program();
  if (program.empty()) {
    throw Error(std::string(kHostProgram) +
                " is missing, expected it in the folder of this program or in COTWIN_FMU_HOST; "
                "process=shared runs the FMU without it");
  }
  Pipe lifeline, output;
  static_cast<void>(fcntl(output.write, F_SETPIPE_SZ, kPipeBytes));  // if this fails, the pipe keeps its default size
  fcntl(output.read, F_SETFL, O_NONBLOCK);
  const int shared = fcntl(channel_.descriptor(), F_DUPFD_CLOEXEC, kFirstDescriptor);
  if (shared < 0) throw Error("no file descriptor for the FMU's process: " + system_error(errno));
  SpawnSettings settings;
  settings.pass_null(STDIN_FILENO);
  settings.pass(output.write, STDOUT_FILENO);
  settings.pass(output.write, STDERR_FILENO);
  settings.pass(shared, kMemoryDescriptor);
  settings.pass(lifeline.read, kLifelineDescriptor);
  try {
    child_ = settings.spawn(program, name_);
  } catch (...) {
    close(shared);
    throw;
  }
  close(shared);
  lifeline_ = std::exchange(lifeline.write, -1);
  output_ = std::exchange(output.read, -1);
  ++processes;
}

/// Asks the process to end and kills it if it has not ended within the time limit of a call.
HostProcess::~HostProcess() {
  if (child_ > 0 && channel_.header().answered.load(std::memory_order_acquire) == calls_) {
    try {
      call(Verb::kEnd);
      const Clock::time_point begin = Clock::now();
      std::string how;
      while (child_ > 0 && !ended(how)) {
        if (Clock::now() - begin > std::chrono::duration<double>(timeout_))
          throw Error("the FMU's own process did not end after its instance was freed");
        pass_on_output();
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
      pass_on_output();
    } catch (const std::exception& error) {
      ++ends_unclean;
      std::cerr << "cotwin: " << name_ << ": " << error.what() << '\n';
    }
  }
  kill();
  close_lifeline();
  for (const int descriptor : {output_, statistics_}) {
    if (descriptor >= 0) close(descriptor);
  }
}

void HostProcess::close_lifeline() noexcept {
  if (lifeline_ >= 0) close(std::exchange(lifeline_, -1));
}

void HostProcess::call(Verb verb) {
  ChannelHeader& header = channel_.header();
  if (!alive()) throw Error("the FMU's own process has ended; initialise the FMU again");
  static const std::uint32_t cores = std::max(1u, std::thread::hardware_concurrency());
  const bool may_spin = static_cast<std::uint32_t>(processes.load(std::memory_order_relaxed)) < cores;
  header.verb = verb;
  header.may_spin = may_spin ? 1 : 0;
  const std::uint32_t n = ++calls_;
  post(header.asked, n, header.host_sleeps);
  if (!spin_.wait_for(header.answered, n, may_spin)) {
    const bool starts = verb <= Verb::kExit;
    wait_for_answer(starts ? kStartFactor * timeout_ : timeout_);
  } else if (n % kCallsBetweenChecks == 0) {
    check_memory();
  }
  if (header.reply == Reply::kError) {
    pass_on_output();
    const char* message = header.message;
    throw Error(std::string(message, strnlen(message, ChannelHeader::kMessageBytes)));
  }
}

void HostProcess::wait_for_answer(double seconds) {
  ChannelHeader& header = channel_.header();
  const Clock::time_point begin = Clock::now();
  const auto limit = std::chrono::duration<double>(seconds);
  auto slice = kSlice;
  while (!sleep_for(header.answered, calls_, header.program_sleeps, slice)) {
    std::string how;
    if (ended(how)) {
      if (header.answered.load(std::memory_order_acquire) == calls_) return;
      fail(how);
    }
    const std::uint64_t before = written_;
    check_memory();
    slice = written_ > before ? kShortSlice : kSlice;
    if (Clock::now() - begin > limit)
      fail("did not answer for " + text::to_text(seconds) + " s" + in_function() + " and was killed");
  }
}

/// Copies the FMU's output and kills the process if it uses more memory than its limit.
void HostProcess::check_memory() {
  pass_on_output();
  const double used = memory_used();
  if (used > memory_)
    fail("used " + megabytes(used) + " of memory" + in_function() + ", more than " + megabytes(memory_) + ", and was killed");
}

/// Returns the resident memory in bytes, without files and without the channel.
double HostProcess::memory_used() {
  if (const int served = channel_.header().served; statistics_ < 0 && served > 0)
    statistics_ = ::open(("/proc/" + std::to_string(served) + "/statm").c_str(), O_RDONLY | O_CLOEXEC);
  std::array<char, 128> text{};
  if (statistics_ < 0 || pread(statistics_, text.data(), text.size() - 1, 0) <= 0) return 0;
  static const auto page = static_cast<double>(sysconf(_SC_PAGESIZE));
  char* rest = nullptr;
  std::strtoull(text.data(), &rest, 10);  // total mapped size, not used
  const auto resident = static_cast<double>(std::strtoull(rest, &rest, 10));
  const auto shared = static_cast<double>(std::strtoull(rest, nullptr, 10));
  return page * (resident - shared);
}

std::uint64_t HostProcess::pass_on_output() {
  std::array<char, 1 << 16> bytes;
  for (int reads = 0; reads < 64; ++reads) {  // limited, for an FMU may write faster than this loop reads
    const ssize_t n = ::read(output_, bytes.data(), bytes.size());
    if (n <= 0) break;
    const auto count = static_cast<std::size_t>(n);
    const std::size_t shown = written_ < kShownBytes ? std::min<std::size_t>(count, kShownBytes - written_) : 0;
    if (shown > 0) {
      std::cerr.write(bytes.data(), static_cast<std::streamsize>(shown));
      std::cerr.flush();
    }
    written_ += count;
    if (written_ > kShownBytes && !std::exchange(cut_, true)) {
      std::cerr << "\ncotwin: " << name_ << " wrote more than " << kShownBytes / 1024
                << " KiB to stdout and stderr; the rest is not shown\n";
    }
    tail_.append(bytes.data() + count - std::min(count, kTailBytes), std::min(count, kTailBytes));
    if (tail_.size() > kTailBytes) tail_.erase(0, tail_.size() - kTailBytes);
  }
  return written_;
}

bool HostProcess::ended(std::string& how) {
  int status = 0;
  rusage usage{};
  const pid_t ended = wait4(child_, &status, WNOHANG, &usage);
  if (ended == 0 || (ended < 0 && errno == EINTR)) return false;
  child_ = -1;
  --processes;
  how = ended < 0             ? "ended"  // other code called wait for it
        : WIFSIGNALED(status) ? "was killed by " + name_of_signal(WTERMSIG(status))
                              : "exited with status " + std::to_string(WEXITSTATUS(status));
  how += in_function();
  rusage own{};
  getrusage(RUSAGE_SELF, &own);
  const double most = 1024.0 * static_cast<double>(usage.ru_maxrss);
  // The process starts with this program's maximum, so only a larger value is its own.
  if (usage.ru_maxrss > own.ru_maxrss && most > kNearlyAll * memory_)
    how += " after using " + megabytes(most) + " of memory, limit " + megabytes(memory_);
  return true;
}

std::string HostProcess::in_function() const {
  const char* function = channel_.header().function;
  const std::string name(function, strnlen(function, UnderWay::kMirrorBytes));
  return name.empty() ? "" : " in " + name;
}

/// Returns the last line that the FMU wrote, as the end of a message.
std::string HostProcess::last_output() const {
  std::string_view words = tail_;
  const auto blank = [](char c) { return c == '\n' || c == '\r' || c == ' ' || c == '\0'; };
  while (!words.empty() && blank(words.back())) words.remove_suffix(1);
  const std::size_t line = words.rfind('\n');
  if (line != std::string_view::npos) words.remove_prefix(line + 1);
  constexpr std::size_t kMost = 200;
  std::string line_shown;
  for (const char c : words.substr(0, kMost)) line_shown += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  return line_shown.empty() ? "" : "; its last output was '" + line_shown + "'";
}

void HostProcess::fail(const std::string& how) {
  kill();
  pass_on_output();
  throw Error("the FMU's own process " + how + last_output());
}

/// Kills the process with the FMU. The process that it is a child of then ends those that the FMU has started, and itself.
void HostProcess::kill() noexcept {
  if (child_ <= 0) return;
  close_lifeline();
  const Clock::time_point begin = Clock::now();
  pid_t ended = 0;
  while ((ended = waitpid(child_, nullptr, WNOHANG)) == 0 || (ended < 0 && errno == EINTR)) {
    if (Clock::now() - begin > kMostToEnd) {  // suspended by the FMU
      ::kill(-child_, SIGKILL);
      ::kill(child_, SIGKILL);
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  child_ = -1;
  --processes;
}

ProcessUnit::ProcessUnit(std::shared_ptr<const ForeignFmu> fmu, LoadOptions options)
    : fmu_(std::move(fmu)),
      options_(std::move(options)),
      variables_(fmu_->description, variables_options(fmu_->description, chosen_kind(fmu_->description, options_.kind),
                                                      unit_options(fmu_->description, options_))) {
  const UnitOptions for_unit = unit_options(fmu_->description, options_);
  restorable_ = can_restore(interface_of(fmu_->description, chosen_kind(fmu_->description, options_.kind)), for_unit);
  goes_back_ = restorable_ && for_unit.rollback;
  variables_.declare(declared_);
  begin();
}

ProcessUnit::~ProcessUnit() = default;

void ProcessUnit::declare(Variables& variables) { variables_.declare(variables); }

void ProcessUnit::begin() {
  host_.reset();  // before the new process starts, for an FMU may allow only one instance per machine
  host_ = std::make_unique<HostProcess>(declared_, options_.instance_name + " (" + fmu_->name + ")", options_.timeout,
                                        options_.memory);
  std::size_t text = 0;
  channel().append(serialise_checked(fmu_->name, "fmu", options_, fmu_->description, {}), text);
  channel().append(fs::absolute(fmu_->folder).string(), text);
  try {
    host_->call(Verb::kMake);
    text = 0;
    warnings_.clear();
    while (text < channel().header().text_bytes) channel().take(warnings_.emplace_back(), text);
  } catch (...) {
    host_.reset();
    throw;
  }
}

void ProcessUnit::initialise(Time start) {
  if (!host_ || !host_->alive()) begin();
  exchange_all(Verb::kInitialise, start);
}

void ProcessUnit::enter_initialisation(Time start) {
  if (!host_ || !host_->alive()) begin();
  exchange_all(Verb::kEnter, start_ = start);
}

void ProcessUnit::update_initialisation() { exchange_all(Verb::kUpdate, start_); }

void ProcessUnit::exit_initialisation() { exchange_all(Verb::kExit, start_); }

void ProcessUnit::exchange_all(Verb verb, Time start) {
  std::size_t text = 0;
  channel().write(declared_, Channel::any, text);
  channel().header().now_ns = start.ns;
  host_->call(verb);
  text = 0;
  channel().read(declared_, Channel::any, text);
}

StepResult ProcessUnit::step(Time now, Duration h) {
  std::size_t text = 0;
  ChannelHeader& header = channel().header();
  channel().write(declared_, Channel::is_input, text);
  header.now_ns = now.ns;
  header.h_ns = h.ns;
  host_->call(Verb::kStep);
  if (header.reply == Reply::kDiscard) return StepResult::kDiscard;
  text = 0;
  channel().read(declared_, Channel::is_output, text);
  return header.reply == Reply::kFinished ? StepResult::kFinished : StepResult::kDone;
}

void ProcessUnit::save_memory(std::string& bytes) {
  if (!restorable_ || !host_ || !host_->alive()) return bytes.clear();
  std::size_t text = 0;
  channel().append(holds_state(bytes) ? std::string() : bytes, text);  // the state that it replaces
  channel().write(declared_, Channel::is_input, text);
  host_->call(Verb::kSave);
  text = 0;
  channel().take(bytes, text);
}

void ProcessUnit::restore_memory(const std::string& bytes) {
  if (!host_ || !host_->alive()) begin();
  std::size_t text = 0;
  channel().append(bytes, text);
  channel().write(declared_, Channel::any, text);
  host_->call(Verb::kRestore);
}

void ProcessUnit::append_notes(std::vector<std::string>& notes) const {
  if (!host_) return;
  if (const std::uint64_t bytes = host_->pass_on_output(); bytes > 0)
    notes.push_back("wrote " + std::to_string(bytes) + " bytes to stdout and stderr");
  if (!host_->alive()) return;
  try {
    host_->call(Verb::kTell);
    std::size_t text = 0;
    while (text < host_->channel().header().text_bytes) host_->channel().take(notes.emplace_back(), text);
  } catch (const Error& error) {
    notes.emplace_back(error.what());
  }
}

}  // namespace cotwin::fmu
