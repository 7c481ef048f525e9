// Runs examples/06_real_robots with the built program: the errors that its README lists, on held-out data.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/run_program.h"

namespace real_robots_test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class RealRobots : public ::testing::TestWithParam<std::string> {};

TEST_P(RealRobots, ArePredictedAsWellAsTheExampleSays) {
  const fs::path example = fs::path(cotwin::places::source()) / "examples/06_real_robots";
  const json expected = json::parse(std::ifstream(example / "expected.json")).at(GetParam());
  for (const std::string& need : expected.at("needs").get<std::vector<std::string>>()) {
    if (!fs::exists(cotwin::places::public_data(need))) GTEST_SKIP() << "needs " << need << " (examples/public_data.md)";
  }
  const std::string need = expected.at("needs").front(), file = cotwin::places::public_data(need);
  const std::string data = file.substr(0, file.size() - need.size() - 1);
  const cotwin::testing::TemporaryFolder out("real_robots");
  const auto ran = cotwin::testing::run_command(
      {example / "run.sh", GetParam()},
      {.environment = {"COTWIN=" + cotwin::places::program(), "DATA=" + data, "OUT=" + out.path().string()},
       .merge = true,
       .limit = std::chrono::seconds(600)});
  ASSERT_EQ(ran.code, 0) << ran.out;

  const json figures = json::parse(std::ifstream(out / GetParam() / "figures.json"));
  const auto rms = [&](const char* part, const char* of) {
    return figures.at(part).at("rms").at(of).get<std::vector<double>>();
  };
  const auto below = expected.at("held_out_below").get<std::vector<double>>();
  const std::vector<double> held_out = rms("held_out", "swarm"), prior = rms("held_out", "prior");
  ASSERT_EQ(held_out.size(), below.size());
  for (std::size_t j = 0; j < below.size(); ++j) {
    EXPECT_LT(held_out[j], below[j]) << "joint " << j + 1;
    EXPECT_LT(held_out[j], prior[j]) << "joint " << j + 1;
  }
  // The weighted errors of the swarm and its references on the training data, relative to the floor.
  const json& weighted = figures.at("weighted_rms");
  EXPECT_GE(weighted.at("swarm").get<double>(), 0.999 * weighted.at("floor").get<double>());
  EXPECT_LT(weighted.at("swarm").get<double>(), 1.02 * weighted.at("feasible").get<double>());
  // Stiffness, where another source has published it; 0: not found there, and not expected here.
  for (std::size_t j = 0; expected.contains("stiffness") && j < below.size(); ++j) {
    const double published = expected.at("stiffness").at(j).get<double>();
    EXPECT_NEAR(figures.at("stiffness").at(j).get<double>(), published, 0.3 * published) << "joint " << j + 1;
  }
  // A physically possible robot: otherwise the loader refuses it.
  EXPECT_NO_THROW(cotwin::robot::load_urdf(out / GetParam() / "robot.urdf"));
}

INSTANTIATE_TEST_SUITE_P(All, RealRobots, ::testing::Values("panda", "ur10", "kr300"),
                         [](const auto& robot) { return robot.param; });

}  // namespace
}  // namespace real_robots_test
