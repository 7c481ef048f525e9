// examples/16_ethercat_cell as its page says: an emulated cell and its twin in two processes, over a pair of virtual interfaces.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/recording.h"
#include "tests/support/run_program.h"

namespace ethercat_cell_test {
namespace {

namespace fs = std::filesystem;

TEST(EtherCatCell, IsOperatedByItsTwinOnTheClockOfTheBus) {
  if (std::system("unshare --net true 2>/dev/null") != 0) GTEST_SKIP() << "needs the permission for network namespaces (root)";
  const cotwin::testing::TemporaryFolder folder("ethercat_cell");
  const fs::path script = fs::path(cotwin::places::source()) / "examples/16_ethercat_cell/run.sh";
  cotwin::testing::RunOptions options;
  options.environment = {"COTWIN=" + cotwin::places::program(), "OUT=" + folder.path().string()};
  options.merge = true;
  const cotwin::testing::RunResult run = cotwin::testing::run_command({script.string(), "--quiet"}, options);
  ASSERT_EQ(run.code, 0) << run.out;
  const auto columns = cotwin::testing::read_recording(folder.path() / "twin/signals.csv");
  const auto last = [&](const std::string& name) { return columns.at(name).back(); };
  for (int slave = 1; slave <= 4; ++slave) EXPECT_EQ(last("io.state[" + std::to_string(slave) + "]"), 8) << slave;
  EXPECT_EQ(last("io.operational"), 1);
  EXPECT_EQ(last("io.switches[1]"), 0);
  EXPECT_EQ(last("io.switches[2]"), 1);
  EXPECT_EQ(last("clock.locked"), 1);
  double closed = 0, difference = 0;
  for (std::size_t row = 0; row < columns.at("time").size(); ++row) {
    closed += columns.at("io.switches[1]")[row];
    if (columns.at("time")[row] > 3) difference = std::max(difference, columns.at("io.clock_difference")[row]);
  }
  EXPECT_GT(closed, 0) << "the gripper was never closed";
  // The counter begins at 0 wherever the axis is when the twin comes.
  const auto [low, high] = std::ranges::minmax(columns.at("io.q"));
  const double travel = high - low;
  EXPECT_GT(travel, 0.25) << "the axis did not move";
  EXPECT_LE(travel, 0.301);
  EXPECT_LT(difference, 1e-6);
}

}  // namespace
}  // namespace ethercat_cell_test
