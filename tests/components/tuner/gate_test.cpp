// What the tuner takes as a new measurement, and what as a gap.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "models/robot/changes/perturbed.h"
#include "tests/components/tuner/subject.h"

namespace cotwin::gate_test {
namespace {

using namespace testing;
using ::testing::HasSubstr;

// The filter restarts after a gap: the jump across it is not an acceleration.
TEST(Tuner, IsNotMisledByGaps) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject tuner = tuner_of_planar2();
  tuner.set("settle", "0.1");
  for (int i = 0; i < 4600; ++i) {
    measured.at(i * 1e-3);
    measured.feed(tuner);
    if (i == 0) tuner.initialise();
    if (i % 800 >= 700) tuner["q"][0] = std::numeric_limits<double>::quiet_NaN();
    tuner.step();
  }
  ASSERT_EQ(tuner.integer("tunings"), 1);
  for (std::size_t j = 0; j < 2; ++j) EXPECT_LT(tuner["rms"][j], 0.05 * tuner["rms_prior"][j]) << j;
}

/// Feeds measurements of which `lost` are held as a link with lost messages holds them: speeds are differences since the last one.
template <class Lost>
void run_with_losses(Subject& tuner, Measured& robot, bool tells, int from, int to, Lost&& lost) {
  std::array<double, 2> q{};
  int last = from - 1;
  robot.at(last * 1e-3);
  for (std::size_t j = 0; j < 2; ++j) q[j] = robot.q()[static_cast<Eigen::Index>(j)];
  for (int i = from; i < to; ++i) {
    const bool comes = !lost(i);
    if (comes) {
      robot.at(i * 1e-3);
      robot.feed(tuner);
      for (std::size_t j = 0; j < 2; ++j) {
        tuner["dq"][j] = (tuner["q"][j] - q[j]) / ((i - last) * 1e-3);
        q[j] = tuner["q"][j];
      }
      last = i;
    }
    if (tells) tuner["t_measured"][0] = last * 1e-3;
    if (i == 0) tuner.initialise();
    tuner.step();
  }
}

TEST(Tuner, TakesNoSamplesOfHeldValuesNorAroundAGap) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2();
  const auto never = [](int) { return false; };
  run_with_losses(tuner, measured, true, 0, 2000, never);
  const std::int32_t samples = tuner.integer("samples");
  EXPECT_NEAR(samples, 300, 1) << "one in five after 0.5 s";
  // The network is cut for 4 s, over the start of the first estimation at 4 s.
  run_with_losses(tuner, measured, true, 2000, 6000, [](int) { return true; });
  EXPECT_LE(tuner.integer("samples"), samples + 1);
  EXPECT_EQ(tuner.integer("tunings"), 0) << "there is nothing new to estimate from";
  const std::int32_t after = tuner.integer("samples");
  run_with_losses(tuner, measured, true, 6000, 6499, never);
  EXPECT_EQ(tuner.integer("samples"), after) << "the filter settles for 0.5 s";
  run_with_losses(tuner, measured, true, 6499, 6600, never);
  EXPECT_NEAR(tuner.integer("samples"), after + 20, 1);
}

// A burst of four in each 50 ms. Held values would be samples with accelerations of v ω² h (ω: of the filter).
TEST(Tuner, LearnsTheSameFromAStreamWithBurstsOfLosses) {
  const auto error = [](bool losses, bool tells) {
    Measured measured(robot::perturbed(planar(), 0.3, 5));
    Subject tuner = tuner_of_planar2();
    run_with_losses(tuner, measured, tells, 0, 4600, [&](int i) { return losses && i > 0 && i % 50 < 4; });
    EXPECT_EQ(tuner.integer("tunings"), 1);
    EXPECT_GT(tuner.integer("samples"), 300);
    return tuner["rms_floor"][0] + tuner["rms_floor"][1];
  };
  const double whole = error(false, true), bridged = error(true, true), held = error(true, false);
  EXPECT_LT(bridged, 2 * whole);
  EXPECT_GT(held, 4 * bridged) << "what it would learn from held values";
}

/// Measurements at multiples of `interval`, in ms, that are not `lost`, and speeds as differences. The tuner steps every `period` and sees
/// the newest one. The robot's clock has another zero and runs 100 ppm slow.
template <class Lost>
void run_at(Subject& tuner, Measured& robot, int interval, int period, int to, Lost&& lost) {
  std::array<double, 2> q{};
  int last = -1;
  tuner["t_measured"][0] = 0;
  for (int i = 0; i < to; ++i) {
    if (i % interval == 0 && !lost(i)) {
      robot.at(i * 1e-3);
      robot.feed(tuner);
      for (std::size_t j = 0; j < 2; ++j) {
        tuner["dq"][j] = last < 0 ? 0 : (tuner["q"][j] - q[j]) / ((i - last) * 1e-3);
        q[j] = tuner["q"][j];
      }
      last = i;
      tuner["t_measured"][0] = 1234.5 + i * 0.9999e-3;
    }
    if (i == 0) tuner.initialise();
    if (i % period == 0) tuner.step(Duration{period * kTick.ns});
  }
}

TEST(Tuner, LearnsFromEverySendPeriodWithEveryPeriodOfItsOwn) {
  const auto none = [](int) { return false; };
  for (const int interval : {1, 2, 5, 10, 20, 50, 100}) {
    for (const int period : {1, 3, 4, 7, 10, 20}) {
      Measured measured(planar());
      Subject tuner = tuner_of_planar2();
      tuner.set("cutoff", "10");
      tuner.set("decimation", "1");
      run_at(tuner, measured, interval, period, 3000, none);
      // One for each measurement that it can see after it has settled for 0.5 s, which begins with the second of a slow source.
      const double expected = 2500.0 / std::max(interval, period);
      EXPECT_NEAR(tuner.integer("samples"), expected, 0.05 * expected + 4) << interval << " ms, step " << period;
      EXPECT_EQ(tuner.text("warning"), "");
      std::vector<std::string> notes;
      tuner.unit().append_notes(notes);
      EXPECT_TRUE(notes.empty());
    }
  }
}

// The filter's steps are those of the measurements, not of the tuner: 5 ms measurements that a step of 4 or 10 ms sees are as good as those of
// a step of 5 ms. With the steps' own times they would jitter by up to 3 ms, 3 ms times 3 rad/s.
TEST(Tuner, LearnsTheSameInAnotherPeriodThanTheMeasurements) {
  const auto error = [](int interval, int period, int burst) {
    Measured measured(robot::perturbed(planar(), 0.3, 5));
    Subject tuner = tuner_of_planar2();
    tuner.set("cutoff", "10");
    tuner.set("decimation", "1");
    run_at(tuner, measured, interval, period, 4700, [&](int i) { return i > 0 && i % 50 < burst; });
    EXPECT_EQ(tuner.integer("tunings"), 1) << interval << " " << period;
    return tuner["rms_floor"][0] + tuner["rms_floor"][1];
  };
  const double same = error(5, 5, 0);
  for (const int period : {1, 3, 4, 7}) EXPECT_NEAR(error(5, period, 0), same, 0.15 * same) << period;
  EXPECT_LT(error(1, 10, 4), 1.5 * error(10, 10, 0)) << "losses between two of its steps";
}

TEST(Tuner, SaysThatMeasurementsAreTooRareOrTooIrregular) {
  for (const bool rare : {true, false}) {
    Measured measured(planar());
    Subject tuner = tuner_of_planar2();
    if (rare) {
      run_at(tuner, measured, 300, 1, 20000, [](int) { return false; });
    } else {
      run_at(tuner, measured, 5, 1, 8000, [](int i) { return i % 400 < 100; });  // a gap of 0.1 s in each 0.4 s
    }
    EXPECT_EQ(tuner.integer("samples"), 0);
    EXPECT_GT(tuner.integer("measurements"), 60);
    EXPECT_THAT(tuner.text("warning"), HasSubstr("none became a sample"));
  }
  Measured measured(planar());
  Subject brief = tuner_of_planar2(), silent = tuner_of_planar2();
  std::vector<std::string> notes;
  run_at(brief, measured, 10, 1, 400, [](int) { return false; });
  brief.unit().append_notes(notes);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_THAT(notes[0], HasSubstr("of 39 measurements, the last two 0.01 s apart"));
  run_at(silent, measured, 10, 1, 400, [](int i) { return i > 0; });
  silent.unit().append_notes(notes);
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_THAT(notes[1], HasSubstr("no measurement came"));
}

// Saved while a measurement is held, with another one lost shortly before and after.
TEST(Tuner, GoesOnToTheSameBitsBetweenTwoMeasurements) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2(), other = tuner_of_planar2();
  tuner.set("decimation", "1");
  for (int i = 0; i < 4800; i += 4) {
    const int last = i - i % 10 - (i / 10 % 60 == 0 ? 10 : 0);
    measured.at(last * 1e-3);
    for (Subject* subject : {&tuner, &other}) {
      measured.feed(*subject);
      (*subject)["t_measured"][0] = last * 1e-3;
      if (i == 0) subject->initialise();
    }
    if (i == 1208) other.restore(tuner.save(), i * 1e-3);
    tuner.step(Duration{4 * kTick.ns});
    if (i >= 1208) other.step(Duration{4 * kTick.ns});
  }
  EXPECT_EQ(tuner.integer("tunings"), 1);
  EXPECT_EQ(other.everything(), tuner.everything());
}

TEST(Tuner, BeginsAgainWhenTheRobotsClockDoesOrIsNotANumber) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2();
  const auto never = [](int) { return false; };
  run_at(tuner, measured, 1, 1, 1000, never);
  const std::int32_t samples = tuner.integer("samples");
  ASSERT_GT(samples, 90);
  for (const double t : {-5.0, 1e300, -1e300, 3.0, std::numeric_limits<double>::infinity()}) {
    tuner["t_measured"][0] = t;
    tuner.step();
    EXPECT_EQ(tuner["gathering"][0] < 0.5, true) << t;
    for (const double x : tuner["filter"]) EXPECT_TRUE(std::isfinite(x));
  }
  EXPECT_EQ(tuner.integer("samples"), samples);
  EXPECT_EQ(tuner.integer("skipped"), 1);
}

}  // namespace
}  // namespace cotwin::gate_test
