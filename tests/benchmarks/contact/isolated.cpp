#include "tests/benchmarks/contact/isolated.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <exception>
#include <sstream>
#include <stdexcept>

namespace cotwin::benchmark {
namespace {

constexpr int kNotApplicable = 2;  // exit code

// One figure a line: value, goal, unit, name.
void write_figures(const std::vector<Figure>& figures, int file) {
  std::string text;
  for (const Figure& figure : figures) {
    std::array<char, 64> numbers{};
    std::snprintf(numbers.data(), numbers.size(), "%.17g\t%.17g\t", figure.value, figure.goal);
    text += numbers.data() + figure.unit + '\t' + figure.name + '\n';
  }
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t n = ::write(file, text.data() + done, text.size() - done);
    if (n <= 0) _exit(1);
    done += static_cast<std::size_t>(n);
  }
}

std::vector<Figure> parse_figures(const std::string& text) {
  std::vector<Figure> figures;
  std::istringstream lines(text);
  std::string value, goal;
  Figure figure;
  while (std::getline(lines, value, '\t') && std::getline(lines, goal, '\t') && std::getline(lines, figure.unit, '\t') &&
         std::getline(lines, figure.name)) {
    figure.value = std::strtod(value.c_str(), nullptr);
    figure.goal = std::strtod(goal.c_str(), nullptr);
    figures.push_back(figure);
  }
  return figures;
}

[[noreturn]] void child(const Case& what, const EngineKind& engine, unsigned limit, int file) {
  const rlimit time{limit, limit + 1};
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CPU, &time);
  setrlimit(RLIMIT_CORE, &no_core);
  try {
    write_figures(what.run(engine), file);
    _exit(0);
  } catch (const NotApplicable&) {
    _exit(kNotApplicable);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s, %s: %s\n", what.name.c_str(), engine.name.c_str(), error.what());
    _exit(1);
  }
}

}  // namespace

Outcome run_isolated(const Case& what, const EngineKind& engine, unsigned limit) {
  std::array<int, 2> ends{};
  if (pipe(ends.data()) != 0) throw std::runtime_error("pipe() failed");
  std::fflush(stdout);
  const pid_t pid = fork();
  if (pid < 0) throw std::runtime_error("fork() failed");
  if (pid == 0) {
    close(ends[0]);
    child(what, engine, limit, ends[1]);
  }
  close(ends[1]);
  std::string text;
  std::array<char, 4096> buffer{};
  for (ssize_t n = 0; (n = read(ends[0], buffer.data(), buffer.size())) > 0;)
    text.append(buffer.data(), static_cast<std::size_t>(n));
  close(ends[0]);
  int status = 0;
  waitpid(pid, &status, 0);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {parse_figures(text), ""};
  if (WIFEXITED(status)) return {{}, WEXITSTATUS(status) == kNotApplicable ? "–" : "error"};
  const bool late = WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL;
  return {{}, late ? "does not end" : "crashes"};
}

}  // namespace cotwin::benchmark
