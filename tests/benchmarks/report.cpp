// report FOLDER OUT.json [FILTER]: runs the benchmarks in FOLDER whose names contain FILTER; if there is none, runs all of them
// for the rows whose names contain it. Prints a table and writes the rows as a JSON list. Exit code 1 if a benchmark fails.
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

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

/// Reads the rows that a program prints. Returns false if the program fails.
bool run(const fs::path& program, std::vector<Row>& rows) {
  FILE* pipe = popen(quoted(program.string()).c_str(), "r");
  if (pipe == nullptr) return false;
  std::string output;
  char buffer[4096];
  for (std::size_t n = 0; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) output.append(buffer, n);
  const int status = pclose(pipe);
  for (std::size_t begin = 0; begin < output.size();) {
    const std::size_t end = std::min(output.find('\n', begin), output.size());
    Row row = Row::parse(output.substr(begin, end - begin), nullptr, false);
    if (row.is_object()) {
      row["program"] = program.filename().string();
      rows.push_back(std::move(row));
    }
    begin = end + 1;
  }
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
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

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::cerr << "usage: report FOLDER OUT.json [FILTER]\n";
    return 2;
  }
  const std::string filter = argc > 3 ? argv[3] : "";
  std::vector<fs::path> programs = programs_in(argv[1], fs::read_symlink("/proc/self/exe"));
  std::vector<fs::path> named;
  std::copy_if(programs.begin(), programs.end(), std::back_inserter(named),
               [&](const fs::path& p) { return contains(p.filename().string(), filter); });
  const bool filter_rows = named.empty();
  if (!filter_rows) programs = named;

  bool all_ran = true;
  std::vector<Row> rows;
  for (const fs::path& program : programs) {
    std::cerr << "running " << program.filename().string() << '\n';
    if (run(program, rows)) continue;
    all_ran = false;
    std::cerr << program.string() << " failed\n";
  }
  if (filter_rows) std::erase_if(rows, [&](const Row& row) { return !contains(row.value("name", ""), filter); });
  print(rows);
  std::ofstream out(argv[2]);
  out << Row(rows).dump(1) << '\n';
  if (!out.flush()) {
    std::cerr << argv[2] << ": cannot be written\n";
    return 1;
  }
  return all_ran ? 0 : 1;
}
