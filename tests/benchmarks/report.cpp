// report [--quick] FOLDER OUT.csv [FILTER]: runs the benchmarks in FOLDER whose names contain FILTER; if there is none, runs all of
// them for the rows whose names contain it. Prints a table and writes the rows as CSV, with day and machine in its first line. Exit code 1 if a benchmark fails.
// --quick: runs each with COTWIN_BENCH_QUICK (measure.h) and judges no goal. A benchmark fails if it prints a row whose figures are
// not numbers, a failed run, no row, or fewer rows than tests/benchmarks/rows.txt has. Adds the counts of benchmarks that passed,
// failed and were skipped to the file named by COTWIN_COUNTS (scripts/counts.sh). FOLDER/left_out.txt names benchmarks that were
// not built, and why.
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/places.h"

namespace {

namespace fs = std::filesystem;
using Row = nlohmann::ordered_json;

bool is_program(const fs::directory_entry& entry) {
  return entry.is_regular_file() && (entry.status().permissions() & fs::perms::owner_exec) != fs::perms::none;
}

std::vector<fs::path> programs_in(const fs::path& folder, const fs::path& self) {
  std::vector<fs::path> programs;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (is_program(entry) && !fs::equivalent(entry.path(), self)) programs.push_back(entry.path());
  }
  std::sort(programs.begin(), programs.end());
  return programs;
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::string quoted(const std::string& path) {
  std::string q = "'";
  for (const char c : path) q += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return q + "'";
}

struct Run {
  std::vector<Row> rows;
  std::vector<std::string> unread;  // lines that are no JSON: rows with a figure that is not a number
  bool done = false;                // exit code 0
};

/// Runs a program and reads the rows that it prints.
Run run(const fs::path& program) {
  Run run;
  FILE* pipe = popen(quoted(program.string()).c_str(), "r");
  if (pipe == nullptr) return run;
  std::string output;
  char buffer[4096];
  for (std::size_t n = 0; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) output.append(buffer, n);
  const int status = pclose(pipe);
  std::istringstream lines(output);
  for (std::string line; std::getline(lines, line);) {
    Row row = Row::parse(line, nullptr, false);
    if (row.is_object()) {
      row["program"] = program.filename().string();
      run.rows.push_back(std::move(row));
    } else if (line.starts_with('{')) {
      run.unread.push_back(line);
    }
  }
  run.done = WIFEXITED(status) && WEXITSTATUS(status) == 0;
  return run;
}

std::vector<std::string> lines_of(const fs::path& path) {
  std::vector<std::string> lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    if (!line.empty()) lines.push_back(line);
  }
  return lines;
}

/// The least number of rows of each program.
std::map<std::string, std::size_t> least_rows() {
  std::map<std::string, std::size_t> least;
  for (const std::string& line : lines_of(cotwin::places::source() + "/tests/benchmarks/rows.txt")) {
    if (line.starts_with('#')) continue;
    std::istringstream words(line);
    std::string program;
    std::size_t rows = 0;
    if (words >> program >> rows) least[program] = rows;
  }
  return least;
}

/// What is wrong with a quick run; empty: nothing.
std::vector<std::string> problems(const Run& run, std::size_t least) {
  std::vector<std::string> found;
  if (!run.done) found.push_back("did not end with exit code 0");
  for (const std::string& line : run.unread) found.push_back("row with a figure that is not a number: " + line);
  for (const Row& row : run.rows) {
    const std::string name = row.value("name", "");
    for (const char* key : {"ours", "peer_value"})
      if (!row.contains(key) || !row[key].is_number()) found.push_back(name + ": no number " + key);
    if (row.value("unit", "") == "failed runs") found.push_back(name);
  }
  if (run.rows.size() < least)
    found.push_back(std::to_string(run.rows.size()) + " rows, expected at least " + std::to_string(least));
  return found;
}

/// Prints the benchmarks that were not built, and why.
void print_left_out(const fs::path& folder) {
  for (const std::string& line : lines_of(folder / "left_out.txt")) std::cout << "skipped: " << line << '\n';
}

/// Runs each program in a short form. Returns whether all passed.
bool run_quickly(const fs::path& folder, const std::vector<fs::path>& programs) {
  setenv("COTWIN_BENCH_QUICK", "1", 1);
  const std::map<std::string, std::size_t> least = least_rows();
  std::size_t passed = 0, failed = 0;
  for (const fs::path& program : programs) {
    const std::string name = program.filename().string();
    const auto listed = least.find(name);
    const Run ran = run(program);
    const std::vector<std::string> wrong = problems(ran, listed != least.end() ? listed->second : 1);
    ++(wrong.empty() ? passed : failed);
    std::cout << name << ": " << ran.rows.size() << " rows" << (listed != least.end() ? "" : ", not listed in rows.txt")
              << (wrong.empty() ? "" : ", failed") << '\n';
    for (const std::string& problem : wrong) std::cout << "  " << problem << '\n';
    std::cout.flush();
  }
  const std::vector<std::string> left_out = lines_of(folder / "left_out.txt");
  for (const auto& [name, rows] : least) {
    const std::string begin = name + ": ";
    if (fs::exists(folder / name) ||
        std::any_of(left_out.begin(), left_out.end(), [&](const auto& line) { return line.starts_with(begin); }))
      continue;
    std::cout << name << ": listed in rows.txt, but not built, failed\n";
    ++failed;
  }
  const std::size_t skipped = left_out.size();
  print_left_out(folder);
  std::cout << "benchmarks: passed " << passed << ", failed " << failed << ", skipped " << skipped << '\n';
  if (const char* counts = std::getenv("COTWIN_COUNTS")) {
    std::ofstream(counts, std::ios::app) << passed << ' ' << failed << ' ' << skipped << '\n';
  }
  return failed == 0 && passed > 0;
}

std::string number(const Row& row, const char* key) {
  if (!row.contains(key) || !row[key].is_number()) return "";
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", row[key].get<double>());
  return text;
}

void print(const std::vector<Row>& rows) {
  using Line = std::vector<std::string>;
  std::vector<Line> lines = {{"what", "ours", "", "peer", "", "ratio", "goal", "met"}};
  for (const Row& row : rows) {
    lines.push_back({row.value("name", ""), number(row, "ours"), row.value("unit", ""), number(row, "peer_value"),
                     row.value("peer", ""), number(row, "ratio"), row.value("goal", ""),
                     row.value("met", false) ? "yes" : "NO"});
  }
  std::vector<std::size_t> widths(lines[0].size());
  for (const Line& line : lines) {
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  }
  for (const Line& line : lines) {
    for (std::size_t i = 0; i < line.size(); ++i) {
      const std::string pad(widths[i] - line[i].size(), ' ');
      const bool is_number = i == 1 || i == 3 || i == 5;
      std::cout << (is_number ? pad + line[i] : line[i] + pad) << (i + 1 < line.size() ? "  " : "\n");
    }
  }
}

/// Day, processor, cores, load before the first benchmark, and compiler.
std::string machine_now() {
  std::string processor = "unknown processor";
  for (const std::string& line : lines_of("/proc/cpuinfo")) {
    if (line.starts_with("model name")) processor = line.substr(line.find(':') + 2);
  }
  const std::time_t now = std::time(nullptr);
  char day[16], load[16];
  std::strftime(day, sizeof day, "%F", std::gmtime(&now));
  double average = 0;
  getloadavg(&average, 1);
  std::snprintf(load, sizeof load, "%.2f", average);
  return std::string(day) + "; " + processor + "; " + std::to_string(std::thread::hardware_concurrency()) + " cores; load " +
         load + "; compiler " + __VERSION__;
}

void write_csv(const std::vector<Row>& rows, std::ostream& out) {
  out << "program,name,unit,ours,peer,peer value,ratio,goal,met\n";
  for (const Row& row : rows) {
    const std::string goal = row.value("goal", "none");
    out << row.value("program", "") << ",\"" << row.value("name", "") << "\",\"" << row.value("unit", "") << "\"" << ','
        << number(row, "ours") << ",\"" << row.value("peer", "") << "\"," << number(row, "peer_value") << ','
        << number(row, "ratio") << ',' << goal << ','
        << (goal == "none"            ? ""
            : row.value("met", false) ? "yes"
                                      : "no")
        << '\n';
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool quick = std::erase(arguments, "--quick") > 0;
  if (arguments.size() < 2) {
    std::cerr << "usage: report [--quick] FOLDER OUT.csv [FILTER]\n";
    return 2;
  }
  const fs::path folder = arguments[0];
  const std::string filter = arguments.size() > 2 ? arguments[2] : "";
  std::vector<fs::path> programs = programs_in(folder, fs::read_symlink("/proc/self/exe"));
  std::vector<fs::path> named;
  std::copy_if(programs.begin(), programs.end(), std::back_inserter(named),
               [&](const fs::path& p) { return contains(p.filename().string(), filter); });
  const bool filter_rows = named.empty();
  if (!filter_rows) programs = named;
  if (quick) return run_quickly(folder, programs) ? 0 : 1;

  const std::string machine = "# " + machine_now();
  std::cout << machine << '\n';
  bool all_ran = true;
  std::vector<Row> rows;
  for (const fs::path& program : programs) {
    std::cerr << "running " << program.filename().string() << '\n';
    Run ran = run(program);
    std::move(ran.rows.begin(), ran.rows.end(), std::back_inserter(rows));
    for (const std::string& line : ran.unread) std::cerr << "row with a figure that is not a number: " << line << '\n';
    if (ran.done) continue;
    all_ran = false;
    std::cerr << program.string() << " failed\n";
  }
  if (filter_rows) std::erase_if(rows, [&](const Row& row) { return !contains(row.value("name", ""), filter); });
  print(rows);
  print_left_out(folder);
  std::ofstream out(arguments[1]);
  out << machine << '\n';
  write_csv(rows, out);
  if (!out.flush()) {
    std::cerr << arguments[1] << ": cannot be written\n";
    return 1;
  }
  return all_ran ? 0 : 1;
}
