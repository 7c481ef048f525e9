// unit:energy in a scenario, and cotwin fit-energy.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/foundation/formats/csv.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace energy_program_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using nlohmann::json;
using ::testing::HasSubstr;

void replace(std::string& text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  ASSERT_NE(at, std::string::npos) << what;
  text.replace(at, what.size(), with);
}

/// The main example with a meter beside its drive train.
std::string metered_example(const std::string& stage) {
  std::string ssd = content(fs::path(cotwin::places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  replace(
      ssd, "    </ssd:Elements>",
      "<ssd:Component name=\"meter\" source=\"unit:energy?books=true\" type=\"application/x-cotwin-unit\"/></ssd:Elements>");
  std::string wires =
      "<ssd:Connection startElement=\"compliance\" startConnector=\"tau_m\" endElement=\"meter\" endConnector=\"tau_m\"/>";
  for (const char* name : {"theta", "dtheta", "work_m", "work_e", "work_0", "energy_kinetic", "energy_potential",
                           "energy_elastic", "energy_dissipated", "energy_bodies"}) {
    wires += std::string("<ssd:Connection startElement=\"drive\" startConnector=\"") + name +
             "\" endElement=\"meter\" endConnector=\"" + name + "\"/>";
  }
  replace(ssd, "    </ssd:Connections>", wires + "</ssd:Connections>");
  replace(ssd, "<cotwin:Component name=\"drive\" stage=\"2\"/>",
          "<cotwin:Component name=\"drive\" stage=\"2\"/><cotwin:Component name=\"meter\" stage=\"" + stage + "\"/>");
  replace(ssd, "variables=\"", "variables=\"meter.* drive.work_m ");
  return ssd;
}

double last(const cotwin::csv::Table& table, const std::string& name) { return table.column(name).back(); }

TEST(EnergyProgram, MetersTheMainExample) {
  const TemporaryFolder folder("energy");
  const fs::path scenario = folder.write("twin.ssd", metered_example("3"));
  const RunResult run = run_program({"run", scenario.string(), "--stop", "5", "--out", folder / "out"});
  ASSERT_EQ(run.code, 0) << run.err;
  EXPECT_THAT(run.out + run.err, HasSubstr("assumed drive"));
  EXPECT_THAT(run.out, HasSubstr("from the mains in 5 s"));
  const cotwin::csv::Table table = cotwin::csv::load(folder / "out" / "signals.csv");
  double work = 0;
  for (int j = 1; j <= 7; ++j) {
    const std::string index = "[" + std::to_string(j) + "]";
    work += last(table, "meter.work_positive" + index) + last(table, "meter.work_negative" + index);
  }
  EXPECT_NEAR(work, last(table, "drive.work_m"), 1e-9 * std::abs(work));
  const double drawn = last(table, "meter.drawn");
  EXPECT_GT(drawn, 5 * (37 / 0.88 + 50));  // stand-by alone
  EXPECT_LT(std::abs(last(table, "meter.residual")), 1e-4 * drawn);
}

TEST(EnergyProgram, MetersNearlyTheSameInAnEarlierStage) {
  // Inputs are then those of the step before, or torques one step ahead of the positions.
  std::vector<double> drawn;
  for (const char* stage : {"3", "2", "0"}) {
    const TemporaryFolder folder("energy");
    const fs::path scenario = folder.write("twin.ssd", metered_example(stage));
    const RunResult run = run_program({"run", scenario.string(), "--stop", "5", "--out", folder / "out"});
    ASSERT_EQ(run.code, 0) << run.err;
    const cotwin::csv::Table table = cotwin::csv::load(folder / "out" / "signals.csv");
    drawn.push_back(last(table, "meter.drawn"));
    EXPECT_NEAR(drawn.back(), drawn.front(), 1e-3 * drawn.front()) << stage;
  }
}

/// P = 30 + 5 i dq + 0.5 i² for one joint that moves and rests.
std::string log_text() {
  std::string csv = "t,P,qd1,i1\n";
  for (int k = 0; k < 600; ++k) {
    const int part = k % 60;
    const double dq = part < 40 ? std::pow(std::sin(3.14159265358979 * part / 40), 2) : 0,
                 i = 0.7 * dq + 0.2 * std::sin(0.37 * k);
    csv += std::to_string(0.04 * k) + "," + std::to_string(30 + 5 * i * dq + 0.5 * i * i) + "," + std::to_string(dq) + "," +
           std::to_string(i) + "\n";
  }
  return csv;
}

TEST(EnergyProgram, FitsALogAndWritesParametersThatTheUnitTakes) {
  const TemporaryFolder folder("fit");
  const fs::path log = folder.write("log.csv", log_text());
  const fs::path urdf = folder.write("robot.urdf", content(cotwin::places::source() + "/tests/components/data/rotor.urdf"));
  const RunResult fit = run_program({"fit-energy", log.string(), "--model", "current", "--train-before", "12", "--json",
                                     folder / "fit.json", "--out", folder / "energy.ssv"});
  ASSERT_EQ(fit.code, 0) << fit.err;
  EXPECT_THAT(fit.out, HasSubstr("each motion left out once: 10 motions"));
  const json result = json::parse(content(folder / "fit.json"));
  EXPECT_NEAR(result.at("parameters").at("k_1").at("value").get<double>(), 5, 1e-3);
  EXPECT_NEAR(result.at("parameters").at("r_1").at("value").get<double>(), 0.5, 1e-3);
  EXPECT_NEAR(result.at("parameters").at("P_0").at("value").get<double>(), 30, 1e-4);
  EXPECT_LT(result.at("leave_one_out").at("motion_part").get<double>(), 1e-4);
  EXPECT_LT(result.at("train_before").at("median").get<double>(), 1e-5);
  const RunResult described = run_program({"describe", "unit:energy?robot=" + urdf.string()});
  ASSERT_EQ(described.code, 0) << described.err;
  EXPECT_THAT(described.out, HasSubstr("fitted to log.csv (model current"));
}

TEST(EnergyProgram, FitsSeveralRecordingsAtOnce) {
  const TemporaryFolder folder("fit");
  const std::string text = log_text();
  const std::size_t middle = text.find('\n', text.size() / 2) + 1;  // amid the motions
  const fs::path a = folder.write("a.csv", text.substr(0, middle)),
                 b = folder.write("b.csv", "t,P,qd1,i1\n" + text.substr(middle) + text);
  const RunResult fit = run_program({"fit-energy", a.string(), b.string(), "--model", "current", "--json", folder / "fit.json",
                                     "--out", folder / "energy.ssv"});
  ASSERT_EQ(fit.code, 0) << fit.err;
  EXPECT_THAT(fit.out, HasSubstr("b.csv: 3 recordings, 1200 samples, 1 joints, 20 motions"));
  const json result = json::parse(content(folder / "fit.json"));
  EXPECT_NEAR(result.at("parameters").at("k_1").at("value").get<double>(), 5, 1e-3);
  EXPECT_EQ(result.at("recordings"), 3);
  EXPECT_THAT(content(folder / "energy.ssv"), HasSubstr("fitted to a.csv, b.csv (model current"));
  const fs::path other = folder.write(
      "other.csv", "t,P,qd1,i1,tau1\n" + [] {
        std::string rows;
        for (int k = 0; k < 20; ++k) rows += std::to_string(k) + "," + std::to_string(40 + k) + ",0.1,1,1\n";
        return rows;
      }());
  const RunResult refused = run_program({"fit-energy", a.string(), other.string(), "--model", "current"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("other.csv: has columns of torques, expected them in all logs or in none, as in"));
}

TEST(EnergyProgram, RefusesBadLogsAndOptionsInASentence) {
  const TemporaryFolder folder("fit");
  const fs::path log = folder.write("log.csv", log_text());
  const auto refused = [](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "fit-energy");
    const RunResult run = run_program(arguments);
    EXPECT_EQ(run.code, 2);
    EXPECT_EQ(run.out, "");
    return run.err;
  };
  EXPECT_THAT(refused({log.string()}), HasSubstr("no columns of torques"));
  EXPECT_THAT(refused({log.string(), "--model", "best"}), HasSubstr("'best', expected one of constant, work"));
  EXPECT_THAT(refused({log.string(), "--column", "speed=x"}), HasSubstr("'speed=x', expected t, power"));
  EXPECT_THAT(refused({log.string(), "--column", "dq=x"}), HasSubstr("x1"));
  EXPECT_THAT(refused({log.string(), "--model", "current", "--train-before", "0.1"}), HasSubstr("samples for 3 parameters"));
  EXPECT_THAT(refused({(folder / "none.csv").string()}), HasSubstr("none.csv"));
}

}  // namespace
}  // namespace energy_program_test
