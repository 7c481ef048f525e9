#include "tests/support/run_program.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <sstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "tests/support/places.h"

namespace cotwin::testing {
namespace {

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> all;
  for (std::string& text : texts) all.push_back(text.data());
  all.push_back(nullptr);
  return all;
}

/// The environment of the child. A later entry of a name replaces an earlier one.
std::vector<std::string> environment_of(const RunOptions& options) {
  std::vector<std::string> all = options.environment;
  for (char** inherited = environ; !options.only_this_environment && *inherited != nullptr; ++inherited) {
    const std::string_view entry = *inherited, name = entry.substr(0, entry.find('=') + 1);
    bool replaced = false;
    for (const std::string& given : options.environment) replaced = replaced || given.starts_with(name);
    if (!replaced) all.emplace_back(entry);
  }
  return all;
}

/// A file in memory for the output of a child.
int output_file() {
  const int file = memfd_create("output", MFD_CLOEXEC);
  if (file < 0) throw std::runtime_error("no file in memory for the output of a program");
  return file;
}

std::string content(int file) {
  std::string text;
  char buffer[4096];
  for (ssize_t n; (n = pread(file, buffer, sizeof buffer, static_cast<off_t>(text.size()))) > 0;)
    text.append(buffer, static_cast<std::size_t>(n));
  return text;
}

double seconds(const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); }

}  // namespace

Process::Process(std::vector<std::string> command, const RunOptions& options)
    : out_(output_file()), err_(output_file()), end_(std::chrono::steady_clock::now() + options.limit), limit_(options.limit) {
  std::vector<std::string> environment = environment_of(options);
  const std::vector<char*> arguments = pointers(command), variables = pointers(environment);
  id_ = fork();
  if (id_ < 0) throw std::runtime_error("no child process for " + command.front());
  if (id_ > 0) return;
  const int out = options.out.empty() ? out_ : open(options.out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  const bool ready = (options.folder.empty() || chdir(options.folder.c_str()) == 0) && dup2(out, STDOUT_FILENO) >= 0 &&
                     dup2(options.merge ? out : err_, STDERR_FILENO) >= 0 && (!options.prepare || options.prepare());
  if (ready) execvpe(arguments.front(), arguments.data(), variables.data());
  _exit(99);
}

Process::Process(Process&& other) noexcept { *this = std::move(other); }

Process& Process::operator=(Process&& other) noexcept {
  std::swap(id_, other.id_);
  std::swap(out_, other.out_);
  std::swap(err_, other.err_);
  std::swap(end_, other.end_);
  std::swap(limit_, other.limit_);
  return *this;
}

Process::~Process() {
  if (id_ > 0) {
    kill(id_, SIGKILL);
    waitpid(id_, nullptr, 0);
  }
  if (out_ >= 0) close(out_);
  if (err_ >= 0) close(err_);
}

void Process::signal(int number) const { kill(id_, number); }

RunResult Process::wait() {
  int status = 0;
  rusage usage{};
  bool late = false;
  while (wait4(id_, &status, late ? 0 : WNOHANG, &usage) != id_) {
    late = std::chrono::steady_clock::now() > end_;
    if (late) kill(id_, SIGKILL);
    if (!late) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  id_ = -1;
  RunResult result;
  result.code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  result.out = content(out_);
  result.err = content(err_);
  if (late) result.err += "\nkilled after the time limit of " + std::to_string(limit_.count()) + " s\n";
  result.memory = usage.ru_maxrss;
  result.cpu = seconds(usage.ru_utime) + seconds(usage.ru_stime);
  return result;
}

std::vector<std::string> words(std::string_view text) {
  std::vector<std::string> all;
  std::istringstream in{std::string(text)};
  for (std::string word; in >> word;) all.push_back(word);
  return all;
}

RunResult run_command(std::vector<std::string> command, const RunOptions& options) {
  return Process(std::move(command), options).wait();
}

Process start_program(std::vector<std::string> arguments, const RunOptions& options) {
  arguments.insert(arguments.begin(), places::program());
  return Process(std::move(arguments), options);
}

RunResult run_program(std::vector<std::string> arguments, const RunOptions& options) {
  return start_program(std::move(arguments), options).wait();
}

}  // namespace cotwin::testing
