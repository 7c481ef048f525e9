// cotwin search: bisection over runs of a scenario.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace search_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using nlohmann::json;
using ::testing::HasSubstr;

RunResult search(const std::string& vary, const std::string& until, std::vector<std::string> more = {"--quiet"}) {
  const fs::path arm = fs::path(cotwin::places::source()) / "examples/01_joint_admittance/arm.ssd";
  std::vector<std::string> command{"search", arm, "--stop", "6", "--vary", vary, "--until", until};
  command.insert(command.end(), more.begin(), more.end());
  return run_program(command);
}

TEST(Search, FindsTheStiffnessAtWhichAJointYieldsByTheClosedForm) {
  // From t = 1 s, 20 N.m deflect joint 1 by 20/S, without overshoot for S up to 100 N.m/rad: by 0.2 rad and more where S < 100.
  const RunResult found = search("compliance.S_a[1]=20:3000", "compliance.Delta[1]>=0.2",
                                 {"--tolerance", "1e-6", "--json", "-", "--peak", "compliance.tau_e"});
  ASSERT_EQ(found.code, 0) << found.err;
  const json result = json::parse(found.out);
  EXPECT_NEAR(result.at("critical").get<double>(), 100, 1e-3);
  EXPECT_LE(result.at("high").get<double>() - result.at("low").get<double>(), 1e-6 * result.at("high").get<double>());
  EXPECT_EQ(result.at("holds"), "below");
  const double low = result.at("low"), high = result.at("high");
  for (const json& run : result.at("runs")) {
    const double value = run.at("value");
    EXPECT_EQ(run.at("holds").get<bool>(), value <= low) << value;
    EXPECT_TRUE(value <= low || value >= high) << value;
    EXPECT_EQ(run.at("peaks").at("compliance.tau_e"), 20);
    EXPECT_LE(run.at("time").get<double>(), run.at("holds").get<bool>() ? 5.999 : 6);
  }
  EXPECT_EQ(search("compliance.S_a[1]=20:3000", "compliance.Delta[1]>=0.2",
                   {"--tolerance", "1e-6", "--json", "-", "--peak", "compliance.tau_e"})
                .out,
            found.out);
}

TEST(Search, TellsEachRunAndTheResult) {
  const RunResult found = search("compliance.S_a[1]=20:3000", "compliance.Delta[1]>=0.2", {"--tolerance", "0.5"});
  EXPECT_EQ(found.code, 0);
  EXPECT_THAT(found.out, HasSubstr("\n20: holds at "));
  EXPECT_THAT(found.out, HasSubstr("\n3000: does not hold\n"));
  EXPECT_THAT(found.out, HasSubstr("compliance.Delta[1]>=0.2 holds below\n"));
}

TEST(Search, EndsAtZeroAndWarnsOnce) {
  // The value at which the condition begins is 0, of which no interval is a small share. Each run has the warning that a torque acts
  // on one of the two units only, with its own value of the torque.
  const fs::path arm = fs::path(cotwin::places::source()) / "examples/01_joint_admittance/arm.ssd";
  const RunResult found = run_program({"search", arm, "--stop", "0.01", "--vary", "compliance.tau_e[1]=-1:3", "--until",
                                       "compliance.tau_e[1]>0", "--json", "-"});
  ASSERT_EQ(found.code, 0) << found.err;
  const json result = json::parse(found.out);
  EXPECT_LE(result.at("low").get<double>(), 0);
  EXPECT_GT(result.at("high").get<double>(), 0);
  EXPECT_LE(result.at("high").get<double>() - result.at("low").get<double>(), 4e-3);  // 0.1 % of the interval
  EXPECT_LE(result.at("runs").size(), 14u);                                           // 2 + log2(1000)
  const std::string warning = "compliance.tau_e[1] the value";
  const std::size_t first = found.err.find(warning);
  ASSERT_NE(first, std::string::npos) << found.err;
  EXPECT_EQ(found.err.find(warning, first + 1), std::string::npos) << found.err;
}

TEST(Search, FindsNegativeValues) {
  const fs::path arm = fs::path(cotwin::places::source()) / "examples/01_joint_admittance/arm.ssd";
  const RunResult found = run_program({"search", arm, "--stop", "0.01", "--vary", "compliance.tau_e[1]=-900:-0.01", "--until",
                                       "compliance.tau_e[1]>-2", "--json", "-"});
  ASSERT_EQ(found.code, 0) << found.err;
  EXPECT_NEAR(json::parse(found.out).at("critical").get<double>(), -2, 2e-3);
}

TEST(Search, RefusesWhatItCannotSearch) {
  const std::vector<std::pair<RunResult, std::string>> cases{
      {search("compliance.S_a[1]=20:90", "compliance.Delta[1]>=0.2"), "holds at both ends of the interval"},
      {search("compliance.S_a[1]=200:900", "compliance.Delta[1]>=0.2"), "holds at neither end of the interval"},
      {search("compliance.S_a[1]", "compliance.Delta[1]>=0.2"), "expected component.variable=LOW:HIGH"},
      {search("compliance.S_a[1]=1", "compliance.Delta[1]>=0.2"), "expected component.variable=LOW:HIGH"},
      {search("compliance.S_a[1]=5:5", "compliance.Delta[1]>=0.2"), "expected component.variable=LOW:HIGH"},
      {search("compliance.S_a[1]=1:inf", "compliance.Delta[1]>=0.2"), "expected component.variable=LOW:HIGH"},
      {search("compliance.S_b[1]=1:5", "compliance.Delta[1]>=0.2"), "S_b"},
      {search("compliance.S_a[1]=20:900", "compliance.q_x>1"), "q_x"},
      {search("compliance.S_a[1]=20:900", "compliance.q_c>"), "expected a variable, or a comparison"},
      {search("compliance.S_a[1]=20:900", "compliance.warning"), "is a text"},
      {search("compliance.S_a[1]=20:900", "compliance.Delta[1]>=0.2", {"--tolerance", "2"}), "expected a share"},
      {search("compliance.S_a[1]=-20:900", "compliance.Delta[1]>=0.2"), "S_a"},
  };
  for (const auto& [result, message] : cases) {
    EXPECT_EQ(result.code, 2) << message;
    EXPECT_THAT(result.err, HasSubstr(message));
  }
}

TEST(Search, EndsWithTheErrorOfARunThatFails) {
  // An event in the middle of the run makes a value that is not finite.
  const fs::path arm = fs::path(cotwin::places::source()) / "examples/01_joint_admittance/arm.ssd";
  std::string text = cotwin::testing::content(arm);
  const std::string event = R"(variable="drive.tau_e" value="20 9")";
  ASSERT_NE(text.find(event), std::string::npos);
  text.replace(text.find(event), event.size(), R"(variable="drive.tau_e" value="1e308 9")");
  const cotwin::testing::TemporaryFolder folder("search");
  const RunResult failed = run_program({"search", folder.write("arm.ssd", text), "--vary", "compliance.S_a[1]=20:90", "--until",
                                        "compliance.Delta[2]>9", "--quiet"});
  EXPECT_EQ(failed.code, 1);
  EXPECT_THAT(failed.err, HasSubstr("compliance.S_a[1]=20: 'drive' discarded its step at t = 1 s"));
}

}  // namespace
}  // namespace search_test
