#include "components/io/io.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "components/unit/delay_line.h"
#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "tests/support/allocations.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/unit_subject.h"

namespace cotwin::io_test {
namespace {

using cotwin::testing::TemporaryFile;
using ::testing::HasSubstr;
using Values = std::vector<std::pair<std::string, std::string>>;

constexpr Duration kTick{1'000'000};
constexpr double kTurn = 2 * std::numbers::pi;

/// An io unit with a recording.
class Subject : public testing::UnitSubject {
 public:
  Subject(const std::string& query, const Values& values) : UnitSubject("unit:io?" + query, values) {}
};

double q_of(double t) { return 0.4 * std::sin(kTurn * 0.5 * t); }
double tau_of(int k) { return k % 2 == 0 ? 3.0 : -1.0; }  // large noise

/// Two joints at 50 Hz for 4 s: q, −q; torques that only linear interpolation reproduces.
std::string recording(bool torques, double angle = 1) {
  std::string content = torques ? "t,q1,q2,qd1,qd2,tau1,tau2\n" : "t,q1,q2\n";
  for (int k = 0; k <= 200; ++k) {
    const double t = k * 0.02;
    content += text::to_text(10 + t) + "," + text::to_text(q_of(t) * angle) + "," + text::to_text(-q_of(t) * angle);
    if (torques) content += ",7,8," + text::to_text(tau_of(k)) + "," + text::to_text(2 * tau_of(k));
    content += "\n";
  }
  return content;
}

TEST(Io, ARecordingIsPlayedWithItsDerivatives) {
  const TemporaryFile file(recording(false, 180 / std::numbers::pi));
  Subject s("joints=2", {{"file", file.path()}, {"angle", "deg"}});
  s.initialise();
  EXPECT_NEAR(s.real("q"), 0, 1e-12);
  const double w = kTurn * 0.5;
  for (double t = 0.001; t < 4; t += 0.0237) {
    s.at(t);
    EXPECT_NEAR(s.real("q", 0), q_of(t), 1e-9);
    EXPECT_NEAR(s.real("q", 1), -q_of(t), 1e-9);
    EXPECT_NEAR(s.real("dq", 0), 0.4 * w * std::cos(w * t), 1e-6);
    EXPECT_NEAR(s.real("ddq", 0), -0.4 * w * w * std::sin(w * t), 1e-4);
    EXPECT_FALSE(s.boolean("done"));
  }
  EXPECT_FALSE(s.boolean("has_tau"));
  EXPECT_EQ(s.real("tau", 1), 0);
}

TEST(Io, MeasuredTorquesAreLeftAloneUnlessAFilterIsAskedFor) {
  const TemporaryFile file(recording(true));
  Subject s("joints=2", {{"file", file.path()}, {"tau_scale", "1,-100"}});
  s.initialise();
  EXPECT_TRUE(s.boolean("has_tau"));
  EXPECT_FALSE(s.boolean("has_tau_e"));
  EXPECT_NEAR(s.real("tau", 0), tau_of(0), 1e-12);
  for (int k = 1; k < 200; ++k) {
    s.at(k * 0.02);  // at a sample's instant, the sample
    EXPECT_NEAR(s.real("tau", 0), tau_of(k), 1e-11);
    EXPECT_NEAR(s.real("tau", 1), -200 * tau_of(k), 1e-9);
    s.at(k * 0.02 + 0.005);  // between, a straight line
    EXPECT_NEAR(s.real("tau", 0), 0.75 * tau_of(k) + 0.25 * tau_of(k + 1), 1e-11);
  }
  s.set("tau_cutoff", "5");
  s.initialise();
  s.at(2);
  EXPECT_NEAR(s.real("tau", 0), 1, 1e-3);  // the mean of 3 and −1: the rest is at the Nyquist frequency
}

TEST(Io, VelocitiesAreDerivedFromPositionsOrTakenFromTheirColumns) {
  const TemporaryFile file(recording(true));
  Subject s("joints=2", {{"file", file.path()}, {"derivative", "columns"}});
  s.initialise();
  s.at(1.23);
  EXPECT_NEAR(s.real("dq", 0), 7, 1e-12);
  EXPECT_NEAR(s.real("dq", 1), 8, 1e-12);
  EXPECT_NEAR(s.real("ddq", 1), 0, 1e-9);
  EXPECT_NEAR(s.real("q", 0), q_of(1.23), 1e-9);
  s.set("derivative", "position");
  s.initialise();
  s.at(1.23);
  EXPECT_NEAR(s.real("dq", 0), 0.4 * kTurn * 0.5 * std::cos(kTurn * 0.5 * 1.23), 1e-6);
  const TemporaryFile without(recording(false));
  Subject none("joints=2", {{"file", without.path()}, {"derivative", "columns"}});
  EXPECT_THAT(none.error_of_initialise(), HasSubstr("has no columns of joint velocities"));
}

TEST(Io, FreshTellsWhetherASampleCameWithinTheStep) {
  const TemporaryFile file(recording(true));
  Subject s("joints=2", {{"file", file.path()}, {"start", "0.011"}, {"end", "3.5"}});
  s.initialise();
  EXPECT_FALSE(s.boolean("fresh"));
  int fresh = 0;
  for (int k = 1; k <= 4000; ++k) {
    s.at(k * 0.001);
    fresh += s.boolean("fresh") ? 1 : 0;
    EXPECT_EQ(s.boolean("done"), k * 0.001 + 0.011 >= 3.5);
  }
  EXPECT_EQ(fresh, 175);  // 0.02, 0.04 … 3.5 s of the recording
  Subject at_sample("joints=2", {{"file", file.path()}});
  at_sample.initialise();
  EXPECT_TRUE(at_sample.boolean("fresh"));
}

// Samples each 10 ms to 0.2 s, none between 0.1 and 0.14 s.
TEST(Io, ARecordingsTimeOfMeasurementGoesOnBetweenSamplesButNotInGapsNorAfterItsEnd) {
  std::string text = "t,q1\n";
  for (int i = 0; i <= 20; ++i) {
    if (i <= 10 || i >= 14) text += std::to_string(i * 0.01) + "," + std::to_string(std::sin(i * 0.1)) + "\n";
  }
  const TemporaryFile file(text);
  Subject s("joints=1", {{"file", file.path()}});
  s.initialise();
  for (int k = 1; k <= 300; ++k) {
    s.at(k * 0.001);
    const int expected = k > 200 ? 200 : k > 100 && k < 140 ? 100 : k;
    EXPECT_NEAR(s.real("t_measured", 0), expected * 0.001, 1e-12) << k;
  }
}

TEST(Io, AfterItsEndTheJointsRestWhereTheyAre) {
  const TemporaryFile file(recording(true));
  Subject s("joints=2", {{"file", file.path()}, {"start", "1"}, {"end", "2.25"}});
  s.initialise();
  EXPECT_NEAR(s.real("q"), q_of(1), 1e-9);
  s.at(9);
  EXPECT_NEAR(s.real("q"), q_of(2.25), 1e-9);
  EXPECT_EQ(s.real("dq"), 0);
  EXPECT_EQ(s.real("ddq"), 0);
  EXPECT_NEAR(s.real("tau"), 0.5 * tau_of(112) + 0.5 * tau_of(113), 1e-11);
  EXPECT_TRUE(s.boolean("done"));
}

TEST(Io, SmoothingIsThatOfTheDocumentedFilter) {
  // At the cutoff, −3 dB; no delay.
  const TemporaryFile file(recording(false));
  Subject s("joints=2", {{"file", file.path()}, {"q_cutoff", "0.5"}, {"filter_order", "2"}});
  s.initialise();
  s.at(2.5);
  // Only four seconds with a filter of half a hertz: the ends still have an influence.
  EXPECT_NEAR(s.real("q"), q_of(2.5) * std::sqrt(0.5), 0.15 * 0.4);
  s.set("q_cutoff", "12");
  s.initialise();
  for (double t = 0.5; t < 3.5; t += 0.01) {
    s.at(t);
    EXPECT_NEAR(s.real("q"), q_of(t), 1e-5);
  }
  s.set("q_cutoff", "25");
  EXPECT_THAT(s.error_of_initialise(), HasSubstr("expected more than 0 and less than half the sampling rate of 50 Hz"));
}

TEST(Io, StepsCanBeTakenBackAndAllocateNothing) {
  const TemporaryFile file(recording(true));
  const Values values = {{"file", file.path()}, {"q_cutoff", "8"}, {"derivative", "columns"}};
  Subject s("joints=2", values);
  s.initialise();
  EXPECT_TRUE(s.unit().restorable());
  s.at(1);
  Snapshot here;
  here.take(s.variables());
  s.at(1.001);
  const double q = s.real("q"), dq = s.real("dq", 1), tau = s.real("tau", 1);
  for (const double t : {3.0, 0.5, 2.0}) s.at(t);
  here.restore(s.variables(), s.unit());
  s.at(1.001);
  EXPECT_EQ(s.real("q"), q);
  EXPECT_EQ(s.real("dq", 1), dq);
  EXPECT_EQ(s.real("tau", 1), tau);
  const std::uint64_t before = testing::allocations();
  for (int k = 1; k <= 500; ++k) s.at(k * 0.001);
  EXPECT_EQ(testing::allocations(), before);
}

TEST(Io, ARepeatedInitialisationReadsTheFileAgainOnlyIfItChanged) {
  TemporaryFile file(recording(true));
  Subject s("joints=2", {{"file", file.path()}});
  s.initialise();
  const auto written = std::filesystem::last_write_time(file.path());
  std::ofstream(file.path()) << "t,q1,q2\n0,1,2\n1,1,2\n";
  std::filesystem::last_write_time(file.path(), written);
  s.initialise();
  EXPECT_NEAR(s.real("q"), 0, 1e-12);
  std::filesystem::last_write_time(file.path(), written + std::chrono::seconds(2));
  s.initialise();
  EXPECT_NEAR(s.real("q", 1), 2, 1e-12);
  EXPECT_FALSE(s.boolean("has_tau"));
}

TEST(Io, ErrorsInARecordingHaveFileAndLine) {
  const auto error = [](const std::string& content, Values values = {}) {
    const TemporaryFile file(content);
    values.push_back({"file", file.path()});
    return Subject("joints=1", values).error_of_initialise();
  };
  EXPECT_THAT(error("t,q1\n0,0\n1,\n"), HasSubstr(".csv:3: column 'q1': empty, expected a number"));
  EXPECT_THAT(error("t,q1\n0,0\n1,nan\n"), HasSubstr(".csv:3: column 'q1': nan, expected a finite number"));
  EXPECT_THAT(error("t,q1\n0,0\n1,0\n1,0\n"), HasSubstr(".csv:4: column 't': 1, the same time as on line 3"));
  EXPECT_THAT(error("t,q1\n0,0\n1,0\n2,0\n9,0\n"), HasSubstr(".csv:5: a gap: 7 s after the sample on line 4"));
  EXPECT_THAT(error("t,q1\n0,0\n1,0\n2,0\n9,0\n", {{"max_gap", "10"}}), "no error");
  EXPECT_THAT(error("t,q1,q2\n0,0,0\n1,0,0\n"), HasSubstr("has columns 'q1' to 'q2' of q, expected 1"));
  EXPECT_THAT(error("t,q1\n0,0\n0.1,40\n"), HasSubstr("are these degrees? Then angle = deg"));
  EXPECT_THAT(error("t,q1\n0,0\n0.1,40\n", {{"max_speed", "1000"}}), "no error");
  EXPECT_THAT(error("t,q1\n0,0\n1,0\n", {{"angle", "grad"}}), HasSubstr("io: angle: 'grad', expected one of rad, deg"));
  EXPECT_THAT(error("t,q1\n0,0\n1,0\n", {{"start", "1"}}), HasSubstr("expected a part of the 1 s of"));
  EXPECT_THAT(Subject("joints=1", {}).error_of_initialise(),
              HasSubstr("io: file: is empty, expected the CSV with the recording"));
  EXPECT_THAT(Subject("joints=1", {{"file", "nowhere.csv"}}).error_of_initialise(),
              HasSubstr("no file nowhere.csv; looked for"));
}

TEST(Io, LeavingTheRobotsLimitsIsAWarningAnErrorOrNothing) {
  std::string content = "t,q1,q2,q3,q4,q5,q6,q7\n";
  for (int k = 0; k <= 100; ++k)
    content += text::to_text(k * 0.05) + "," + text::to_text(k * 0.032) + ",0,0,0,0,0,0\n";  // to 3.2 rad; the limit is 170°
  const TemporaryFile file(content);
  Subject s("robot=lwr4", {{"file", file.path()}, {"tau_columns", "none"}});
  s.initialise();
  EXPECT_THAT(s.text("warning"), HasSubstr(" is at 3.2 rad at 5 s, expected -2.9"));
  s.set("limits", "ignore");
  s.initialise();
  EXPECT_EQ(s.text("warning"), "");
  s.set("limits", "error");
  EXPECT_THAT(s.error_of_initialise(), HasSubstr(" is at 3.2 rad at 5 s, expected -2.9"));
}

TEST(Io, ARecordingWithoutTorquesIsAWarningUnlessTorquesAreDisabled) {
  const TemporaryFile file("t,q1,torque\n0,0,5\n0.1,0,5\n");
  Subject s("joints=1", {{"file", file.path()}});
  s.initialise();
  EXPECT_FALSE(s.boolean("has_tau"));
  EXPECT_THAT(s.text("warning"), HasSubstr(": no columns of joint torques found, tau is 0; set tau_columns to their names"));
  s.set("tau_columns", "none");
  s.initialise();
  EXPECT_EQ(s.text("warning"), "");
  s.set("tau_columns", "torque");
  s.initialise();
  EXPECT_EQ(s.text("warning"), "");
  EXPECT_EQ(s.real("tau"), 5);
}

TEST(Io, CommandsAreAcceptedAndIgnoredByARecording) {
  const TemporaryFile file(recording(true));
  Subject s("joints=2", {{"file", file.path()}});
  s.initialise();
  s.at(1);
  const double q = s.real("q");
  s.set("q_command", "9");
  s.set("tau_command", "9");
  s.at(1);
  EXPECT_EQ(s.real("q"), q);
}

class RealRobot : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"panda_unisa.csv", "ur10_unisa.csv"})
      if (!std::filesystem::exists(file(name))) GTEST_SKIP() << "needs public measurements (scripts/fetch_logs.py)";
  }
  static std::string file(const std::string& name) { return places::public_data("measurements/" + name); }
};

TEST_F(RealRobot, ThePandaRecordingPlaysWithItsUrdfAndNoFurtherParameter) {
  Subject s("robot=" + places::public_data("models/panda_franka_ros.urdf"),
            {{"file", file("panda_unisa.csv")}, {"q_cutoff", "2"}});
  s.initialise();
  EXPECT_TRUE(s.boolean("has_tau"));
  EXPECT_EQ(s.variables().at("q").size(), 7u);
  EXPECT_EQ(s.text("warning"), "");
  EXPECT_NEAR(s.real("q", 0), -2.253338, 0.02);  // smoothed
  EXPECT_EQ(s.real("tau", 6), 0.06056813);       // as measured
}

TEST_F(RealRobot, TheUr10AndKr300RecordingsPlayWithNoFurtherParameter) {
  Subject ur10("robot=ur10", {{"file", file("ur10_unisa.csv")}});
  ur10.initialise();
  EXPECT_EQ(ur10.real("q", 0), 0.6197783);
  EXPECT_EQ(ur10.real("tau", 1), -20.64695);
  if (!std::filesystem::exists(file("kr300_A.csv"))) GTEST_SKIP() << "needs kr300_A.csv (examples/public_data.md)";
  Subject kr300("joints=6", {{"file", file("kr300_A.csv")}, {"q_columns", "qmot{}"}});
  kr300.initialise();
  EXPECT_EQ(kr300.real("q", 0), 0.001041595);
}

TEST(Io, ReportsTheEndOfTheRecording) {
  const TemporaryFile file("t,q1\n0,0\n0.01,0.001\n0.02,0.002\n0.03,0.003\n");
  Subject s("joints=1&robot=", {{"file", file.path()}});
  s.initialise();
  const std::string before = s.text("warning");
  s.at(0.02);
  s.at(0.03);
  EXPECT_EQ(s.text("warning"), before);
  const std::uint64_t allocated = testing::allocations();
  s.at(0.031);
  EXPECT_EQ(testing::allocations(), allocated);
  EXPECT_THAT(s.text("warning"), HasSubstr("the recording ended at 0.03 s; after that the robot is assumed to be at rest"));
  const std::string first = s.text("warning");
  s.at(0.032);
  EXPECT_EQ(s.text("warning"), first);  // once
}

TEST(Io, WarnsOfTimesThatLookLikeMillisecondsReadAsSeconds) {
  const TemporaryFile file("t,q1\n0,0\n4,0.001\n8,0.002\n12,0.003\n");
  Subject seconds("joints=1&robot=", {{"file", file.path()}});
  seconds.initialise();
  EXPECT_THAT(seconds.text("warning"),
              HasSubstr("its samples are 4 s apart, expected at most 0.1 s; are its times in another unit"));
  Subject milliseconds("joints=1&robot=", {{"file", file.path()}, {"t_unit", "ms"}});
  milliseconds.initialise();
  EXPECT_THAT(milliseconds.text("warning"), ::testing::Not(HasSubstr("apart")));
}

TEST(Sensors, MeasureWithGainOffsetAndResolution) {
  Subject io("joints=2&link=sensors", {{"q_true", "0.1234 -0.5"}, {"tau_true", "10 -4"}, {"tau_e_true", "1 2"}});
  io.set("q_resolution", "0.01");
  io.set("tau_gain", "1.5 1");
  io.set("tau_offset", "0.5 0");
  io.initialise();
  EXPECT_DOUBLE_EQ(io.real("q", 0), 0.12);
  EXPECT_DOUBLE_EQ(io.real("q", 1), -0.5);
  EXPECT_DOUBLE_EQ(io.real("tau", 0), 15.5);
  EXPECT_DOUBLE_EQ(io.real("tau", 1), -4);
  EXPECT_DOUBLE_EQ(io.real("tau_e", 1), 2);
  EXPECT_TRUE(io.boolean("has_tau_e"));
}

TEST(Sensors, HaveNoiseOfTheGivenDeviationThatIsTheSameForTheSameSeed) {
  const auto noise = [](const std::string& seed) {
    Subject io("joints=1&link=sensors", {{"tau_sigma", "0.2"}, {"seed", seed}});
    io.initialise();
    std::vector<double> all;
    for (int i = 1; i <= 20000; ++i) {
      io.at(i * 1e-3);
      all.push_back(io.real("tau"));
    }
    return all;
  };
  const std::vector<double> one = noise("1");
  double mean = 0, square = 0, lag = 0;
  for (std::size_t i = 0; i < one.size(); ++i) {
    mean += one[i];
    square += one[i] * one[i];
    if (i > 0) lag += one[i] * one[i - 1];
  }
  const double n = static_cast<double>(one.size());
  EXPECT_NEAR(mean / n, 0, 5 * 0.2 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(square / n), 0.2, 0.005);
  EXPECT_NEAR(lag / square, 0, 5 / std::sqrt(n));  // white
  EXPECT_EQ(noise("1"), one);
  EXPECT_NE(noise("2"), one);
}

// (1 − e^(−2π f t)) of a step, for any step length.
TEST(Sensors, MeasureTheExternalTorqueThroughTheLowPass) {
  Subject io("joints=1&link=sensors", {{"tau_e_cutoff", "5"}});
  io.initialise();
  io.set("tau_e_true", "3");
  for (int i = 1; i <= 40; ++i) io.at(i * 1e-3);
  EXPECT_NEAR(io.real("tau_e"), 3 * (1 - std::exp(-kTurn * 5 * 0.04)), 1e-12);
}

// The delayed measurement at t is that of an undelayed twin at t − delay, with all its bits: noise, filter and acceleration too.
TEST(Sensors, LeaveTheSensorsLaterByADelayExactToTheBit) {
  constexpr int kDelay = 7;
  const Values noisy = {{"q_sigma", "1e-3"}, {"dq_sigma", "1e-2"}, {"tau_sigma", "0.2"}, {"tau_e_cutoff", "40"}};
  Subject prompt("joints=2&link=sensors", noisy), late("joints=2&link=sensors&history=8", noisy);
  late.set("delay", "0.007");
  const std::vector<std::string> names = {"q", "dq", "ddq", "tau", "tau_e"};
  std::vector<std::vector<double>> sent;
  for (int i = 0; i <= 50; ++i) {
    for (Subject* s : {&prompt, &late}) {
      for (const char* name : {"q_true", "dq_true", "tau_true", "tau_e_true"}) {
        s->set(name, text::to_text(std::sin(0.3 * i)) + " " + text::to_text(std::cos(0.2 * i)));
      }
      i == 0 ? s->initialise() : s->at(i * 1e-3);
    }
    sent.emplace_back();
    for (const std::string& name : names) {
      for (std::size_t j = 0; j < 2; ++j) {
        sent.back().push_back(prompt.real(name, j));
        const auto& expected = sent[static_cast<std::size_t>(std::max(i - kDelay, 0))];
        ASSERT_EQ(late.real(name, j), expected[sent.back().size() - 1]) << name << " after step " << i;
      }
    }
  }
}

TEST(Sensors, RefuseADelayForWhichTheyKeepNoSamples) {
  Subject none("joints=1&link=sensors", {{"delay", "0.005"}});
  EXPECT_THAT(none.error_of_initialise(), HasSubstr("unit:io.delay: is 0.005 s"));
  Subject few("joints=1&link=sensors&history=5", {{"delay", "0.005"}});
  few.initialise();
  try {
    for (int i = 1; i <= 10; ++i) few.at(i * 1e-3);
    ADD_FAILURE() << "5 samples reach back 4 steps";
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("expected a larger setting history"));
  }
  EXPECT_THROW(Subject("joints=1&link=recording&history=5", {}), Error) << "a recording has no delay";
}

TEST(DelayLine, InterpolatesBetweenSamplesOfStepsOfAnyLength) {
  // x = 3 t − 1 is its own linear interpolation.
  DelayLine line(1, 10);
  const auto x = [](double t) { return 3 * t - 1; };
  double t = 0.2;
  line.start(Time::from_seconds(t), std::array{x(t)});
  double value = 0;
  for (int i = 0; i < 40; ++i) {
    t += 1e-3 * (1 + i % 3);
    line.push(Time::from_seconds(t), std::array{x(t)});
    for (const double ago : {0.0, 0.0004, 0.0017, 0.009}) {
      const double then = std::max(t - ago, 0.2);
      ASSERT_TRUE(line.at(Time::from_seconds(t - ago), {&value, 1}));
      ASSERT_NEAR(value, x(then), 1e-8) << t << " less " << ago;  // times are whole nanoseconds
    }
  }
  ASSERT_TRUE(line.at(Time::from_seconds(t + 1), {&value, 1}));
  EXPECT_EQ(value, line.latest()[0]);
  EXPECT_FALSE(line.at(Time::from_seconds(t - 0.1), {&value, 1})) << "the samples of then were replaced";
}

}  // namespace
}  // namespace cotwin::io_test
