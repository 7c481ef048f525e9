#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

/// Two emulated drives of a unit with link=ethercat, for tests in simulated time.
namespace cotwin::io {

namespace fs = std::filesystem;
inline constexpr double kScale = 1e-5;                                    // rad per count
inline constexpr int kOff = 1, kEnabled = 4, kQuickStop = 5, kFault = 7;  // drive_state

/// Two axes that stand at 0.5 and −0.2 rad when the run begins.
struct Axes {
  explicit Axes(const std::string& mode, const std::string& settings = "")
      : instance(make_unit("unit:io?joints=2&link=ethercat&slaves=EK1100,q1:DRIVE402,q2:DRIVE402,valves:EL2809" + settings, {},
                           {fs::path(places::source()) / "models"}, unit_types())) {
    set("drive_mode", mode);
    set("q_scale", "1e-5 1e-5");
    set("q1_start", "50000");
    set("q2_start", "-20000");
    set("q_command", "0.5 -0.2");
  }
  void set(const std::string& name, const std::string& value) { assign_text(instance.variables.at(name), value); }
  void command(double q1, double q2) {
    instance.variables.at("q_command").reals()[0] = q1;
    instance.variables.at("q_command").reals()[1] = q2;
  }
  double real(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).reals()[i]; }
  int integer(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).integers()[i]; }
  bool boolean(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).booleans()[i]; }
  /// Position of an axis behind its drive, rad.
  double axis(int i) { return kScale * real(i == 0 ? "q1_field" : "q2_field"); }
  void start() { instance.unit->initialise(now); }
  void steps(int n) {
    for (int i = 0; i < n; ++i) step(kTick);
  }
  void step(Duration h) {
    const double before[] = {axis(0), axis(1)};
    ASSERT_EQ(instance.unit->step(now, h), StepResult::kDone);
    now = now + h;
    for (int k = 0; k < 2; ++k) {
      const double speed = (axis(k) - before[k]) / h.seconds();
      fastest = std::max(fastest, std::abs(speed));
      hardest = std::max(hardest, std::abs(speed - speeds[k]) / h.seconds());
      speeds[k] = speed;
    }
  }
  bool enables() {
    for (int n = 0; n < 300 && !boolean("drives_enabled"); ++n) steps(1);
    return boolean("drives_enabled");
  }
  /// Is off, and then on for the least time that counts, which ends with the last step.
  void acknowledge() {
    set("acknowledge", "false");
    steps(3);
    set("acknowledge", "true");
    steps(50);
    set("acknowledge", "false");
  }
  std::vector<std::string> told() {
    std::vector<std::string> sentences;
    instance.unit->append_notes(sentences);
    return sentences;
  }
  void forget() { fastest = hardest = 0; }

  static constexpr Duration kTick{1'000'000};
  Instance instance;
  Time now{0};
  double fastest = 0, hardest = 0;  // of the axes, rad/s, rad/s²
  double speeds[2] = {};
};

/// A file of start-up values, for the setting start_up.
struct StartUpFile {
  explicit StartUpFile(const std::string& lines) { std::ofstream(path) << "slave,when,index,subindex,type,value\n" << lines; }
  std::string setting() const { return "&start_up=" + path; }
  cotwin::testing::TemporaryFolder folder{"drives"};
  std::string path = (folder.path() / "drives.csv").string();
};

}  // namespace cotwin::io
