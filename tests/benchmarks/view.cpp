// Pages of `cotwin view` in Chromium: size of the file, time until they can be used, frames while they play and pan. Chromium draws with the
// processor here, so that the figures depend on the load of the machine.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace {

namespace fs = std::filesystem;
using cotwin::benchmark::print;
using cotwin::benchmark::shortened;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;

/// `signals` columns of 1 kHz: joint positions of an arm of seven joints, and noise that does not pack well, as measured torques.
void write_recording(const fs::path& file, int rows, int signals) {
  std::ofstream out(file);
  out << "time";
  for (int i = 0; i < std::min(signals, 7); ++i) out << ",drive.q[" << i + 1 << ']';
  for (int i = 7; i < signals; ++i) out << ",log.s" << i / 7 << '[' << i % 7 + 1 << ']';
  out << '\n';
  std::uint32_t random = 1;
  char text[32];
  for (int k = 0; k < rows; ++k) {
    std::snprintf(text, sizeof text, "%.3f", 1e-3 * k);
    out << text;
    for (int i = 0; i < signals; ++i) {
      random = random * 1664525u + 1013904223u;
      const double noise = i < 7 ? 0 : 1e-3 * (random >> 8) / 16777216.0;
      std::snprintf(text, sizeof text, ",%.6f", std::sin(1e-3 * k * (1 + 0.1 * i) + i) + noise);
      out << text;
    }
    out << '\n';
  }
}

/// Columns of 10 boxes each, just touching, on the ground.
void write_scene(const fs::path& folder, int boxes) {
  std::ofstream scene(folder / "scene.sdf");
  scene << "<?xml version=\"1.0\"?><sdf version=\"1.11\"><world name=\"boxes\"><gravity>0 0 -9.81</gravity><model "
           "name=\"ground\"><static>true"
           "</static><link name=\"ground\"><collision name=\"ground\"><geometry><plane><normal>0 0 "
           "1</normal></plane></geometry></collision>"
           "</link></model>";
  for (int i = 0; i < boxes; ++i) {
    scene << "<model name=\"box_" << i << "\"><pose>" << 0.3 * (i / 10 % 5) << ' ' << 0.3 * (i / 50) << ' '
          << 0.05 + 0.12 * (i % 10) << " 0 0 " << 0.1 * i
          << "</pose><link name=\"box\"><inertial auto=\"true\"><density>1000</density></inertial><collision "
             "name=\"box\"><geometry><box>"
             "<size>0.1 0.1 0.1</size></box></geometry></collision></link></model>";
  }
  scene << "</world></sdf>";
  std::ofstream(folder / "boxes.ssd") << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="boxes" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription">
  <ssd:System name="boxes"><ssd:Elements><ssd:Component name="world" source="unit:contact_world?scene=scene.sdf" type="application/x-cotwin-unit"/></ssd:Elements></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="2"/>
</ssd:SystemStructureDescription>)";
}

void must(const RunResult& result) {
  if (result.code != 0) throw cotwin::Error("a command of the benchmark", result.out + result.err);
}

class Pages {
 public:
  fs::path folder() const { return folder_.path(); }
  void cotwin(std::vector<std::string> arguments) {
    must(cotwin::testing::run_program(std::move(arguments), {.folder = folder_.path(), .limit = std::chrono::seconds(600)}));
  }
  nlohmann::json open(const std::string& page, const std::string& signal = {}) {
    std::vector<std::string> command = {COTWIN_NODE, cotwin::places::source() + "/tests/benchmarks/view.mjs", COTWIN_CHROMIUM,
                                        (folder() / page).string()};
    if (!signal.empty()) command.push_back(signal);
    const RunResult result = cotwin::testing::run_command(command, {.limit = std::chrono::seconds(600)});
    must(result);
    return nlohmann::json::parse(result.out);
  }

 private:
  TemporaryFolder folder_{"view_benchmark"};
};

void row(const std::string& name, const std::string& unit, double value, double goal) {
  print({.name = name, .unit = unit, .ours = value, .peer = "none", .peer_value = 0, .goal = goal, .goal_is_ratio = false});
}

}  // namespace

int main() try {
  constexpr double kMega = 1e-6;
  Pages pages;
  write_recording(pages.folder() / "minute.csv", shortened(60'000, 2'000), 60);
  pages.cotwin({"view", "minute.csv", "--robot", "lwr4", "-o", "minute.html"});
  row("page of 60 s × 60 signals × 1 kHz: file", "MB",
      kMega * static_cast<double>(fs::file_size(pages.folder() / "minute.html")), 15);
  const nlohmann::json minute = pages.open("minute.html");
  row("page of 60 s × 60 signals × 1 kHz: ready", "ms", minute["ready"], 2000);
  row("page of 60 s × 60 signals × 1 kHz: frame, one arm", "ms", minute["frame"], 1000.0 / 30);

  write_recording(pages.folder() / "million.csv", shortened(1'000'000, 10'000), 1);
  pages.cotwin({"view", "million.csv", "-o", "million.html"});
  const nlohmann::json million = pages.open("million.html", "drive.q");
  row("page of 10⁶ points: pan, 95 % of the frames", "ms", million["pan_95"], 1000.0 / 15);

  write_scene(pages.folder(), shortened(200, 20));
  pages.cotwin({"run", "boxes.ssd", "--out", "boxes", "--record", "world.*.p", "--record", "world.*.quat", "--quiet"});
  pages.cotwin({"view", "boxes"});
  const nlohmann::json boxes = pages.open("boxes/view.html");
  row("page of 200 bodies: ready", "ms", boxes["ready"], 0);
  row("page of 200 bodies: frame", "ms", boxes["frame"], 1000.0 / 15);
  return 0;
} catch (const std::exception& error) {
  std::cerr << "view: " << error.what() << '\n';
  return 1;
}
