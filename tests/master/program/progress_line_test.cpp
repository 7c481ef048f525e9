// The progress line of long commands: its text, the time left, and when it is shown.
#include <fcntl.h>
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include "master/program/progress_line.h"
#include "tests/support/files.h"
#include "tests/support/patience.h"
#include "tests/support/run_program.h"

namespace progress_line_test {
namespace {

using cotwin::master::duration_text;
using cotwin::master::progress_text;
using cotwin::master::TimeLeft;
using ::testing::HasSubstr;

TEST(TimeLeft, AtAConstantRateIsTheRest) {
  TimeLeft left;
  for (int k = 0; k <= 100; ++k) {
    const double elapsed = 0.5 * k, share = elapsed / 80;
    const std::optional<double> found = left.update(elapsed, share);
    if (elapsed < 1) {
      EXPECT_FALSE(found) << elapsed;
    } else {
      ASSERT_TRUE(found);
      EXPECT_NEAR(*found, 80 - elapsed, 1e-9);
    }
  }
}

TEST(TimeLeft, FollowsAChangeOfTheRate) {
  TimeLeft left;
  double elapsed = 0, share = 0;
  std::optional<double> found;
  for (; elapsed < 30; elapsed += 0.1, share += 0.001) found = left.update(elapsed, share);
  EXPECT_NEAR(*found, 70, 1);
  for (; elapsed < 150; elapsed += 0.1, share += 0.0001) found = left.update(elapsed, share);
  // The rate of the last third of the time is a tenth: 580 s; the mean rate of all the time would give 200 s.
  EXPECT_GT(*found, 450);
}

TEST(TimeLeft, IsUnknownBeforeAnythingIsDoneAndBeginsAgainWithANewComputation) {
  TimeLeft left;
  EXPECT_FALSE(left.update(0, 0.4));
  EXPECT_FALSE(left.update(5, 0.4));
  EXPECT_NEAR(left.update(6, 0.5).value(), 30, 15);
  EXPECT_FALSE(left.update(7, 0));
  EXPECT_FALSE(left.update(7.5, 0.1));
  EXPECT_NEAR(left.update(9, 0.4).value(), 3, 0.3);  // 0.2/s from t = 7 on
  EXPECT_NEAR(left.update(12, 1).value(), 0, 1e-12);
}

TEST(ProgressText, WritesDurationsInTwoUnits) {
  EXPECT_EQ(duration_text(0), "0 s");
  EXPECT_EQ(duration_text(11.2), "12 s");
  EXPECT_EQ(duration_text(200), "3 min 20 s");
  EXPECT_EQ(duration_text(7500), "2 h 5 min");
  EXPECT_EQ(duration_text(7200), "2 h");
  EXPECT_EQ(duration_text(100 * 3600), "4 d 4 h");
  EXPECT_EQ(duration_text(-1), "0 s");
  EXPECT_EQ(duration_text(1e300), duration_text(1e9));
}

TEST(ProgressText, FitsIntoTheTerminal) {
  EXPECT_EQ(progress_text("round 3", 0.5, 61, 40), "[######.......] round 3, 1 min 1 s left");
  for (std::size_t columns = 1; columns < 120; ++columns)
    EXPECT_LT(progress_text("round 3", 0.3, 61, columns).size(), columns) << columns;
  EXPECT_EQ(progress_text("round 3", 2, std::nullopt, 20), "[#########] round 3");
  EXPECT_EQ(progress_text("round 3", -1, std::nullopt, 12), "round 3");
}

const char* terminal_name = nullptr;

TEST(Progress, OfARunIsShownWithTheTimeLeftOnATerminalOnly) {
  const cotwin::testing::TemporaryFolder folder("progress");
  folder.write("motion.ssd", R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="motion"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="motion"><ssd:Elements>
      <ssd:Component name="motion" source="unit:motion" type="application/x-cotwin-unit"/>
  </ssd:Elements></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="3600"/>
</ssd:SystemStructureDescription>
)");
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
  ASSERT_GE(terminal, 0);
  ASSERT_EQ(grantpt(terminal), 0);
  ASSERT_EQ(unlockpt(terminal), 0);
  terminal_name = ptsname(terminal);
  ASSERT_NE(terminal_name, nullptr);
  cotwin::testing::RunOptions options;
  options.folder = folder.path();
  options.prepare = [] {
    const int descriptor = open(terminal_name, O_WRONLY | O_NOCTTY);
    return descriptor >= 0 && dup2(descriptor, STDERR_FILENO) >= 0;
  };
  cotwin::testing::Process child = cotwin::testing::start_program({"run", "motion.ssd", "--real-time"}, options);
  std::string shown;
  EXPECT_TRUE(cotwin::testing::within_patience([&] {
    char part[4096];
    const ssize_t n = read(terminal, part, sizeof part);
    if (n > 0) shown.append(part, static_cast<std::size_t>(n));
    return shown.find(" left") != std::string::npos;
  })) << shown;
  EXPECT_THAT(shown, HasSubstr("times real time, "));
  EXPECT_THAT(shown, HasSubstr("\r\x1b[K["));
  child.signal(SIGINT);
  EXPECT_EQ(child.wait().code, 130);
  close(terminal);
  // Not on a terminal: nothing (program_test.cpp checks a whole run).
  cotwin::testing::Process quiet =
      cotwin::testing::start_program({"run", "motion.ssd", "--stop", "1"}, {.folder = folder.path()});
  const std::string err = quiet.wait().err;
  EXPECT_THAT(err, ::testing::AllOf(::testing::Not(HasSubstr(" left")), ::testing::Not(HasSubstr("\r"))));
}

}  // namespace
}  // namespace progress_line_test
