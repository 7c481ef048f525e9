// The tuner as a unit in a running twin, and the units that use its results.
#include "components/tuner/tuner.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <thread>

#include "models/foundation/support/error.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/changes/perturbed.h"
#include "tests/components/tuner/subject.h"
#include "tests/support/allocations.h"

namespace cotwin::tuner_test {
namespace {

using namespace testing;
using ::testing::HasSubstr;

TEST(Tuner, FindsTheRobotBehindTheTorques) {
  const robot::RobotModel real = robot::perturbed(planar(), 0.3, 5);
  Measured measured(real), prior(planar());
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 5);
  ASSERT_EQ(tuner.integer("tunings"), 1) << tuner.text("warning");
  // No robot is below the floor of the errors of both joints together. A single joint may be, at the cost of the other.
  double over_floor = 0;
  for (std::size_t j = 0; j < 2; ++j) {
    EXPECT_LT(tuner["rms"][j], 0.05 * tuner["rms_prior"][j]) << j;
    over_floor += std::pow(tuner["rms"][j] / tuner["rms_floor"][j], 2) / 2;
  }
  EXPECT_GE(over_floor, 1 - 1e-6);
  EXPECT_THAT(tuner.text("log"), HasSubstr("tuned at 4 s"));

  // The result predicts a motion that was not used for tuning.
  robot::RobotModel found = planar();
  for (std::size_t i = 0; i < 2; ++i) {
    Eigen::Matrix<double, 10, 1> pi;
    pi << tuner["mass"][i], Eigen::Map<Eigen::Vector3d>(tuner["first_moment"].data() + 3 * i),
        Eigen::Map<Eigen::Matrix<double, 6, 1>>(tuner["inertia"].data() + 6 * i);
    found.bodies[i].inertia = Inertia::from_parameters(pi);
    EXPECT_EQ(found.bodies[i].inertia.unphysical(), "");
  }
  Measured predicted(found);
  double error = 0, error_of_prior = 0;
  for (double t = 0; t < 5; t += 0.01) {
    for (Measured* m : {&measured, &prior, &predicted}) m->at(t, 1.0);
    error += (predicted.tau() - measured.tau()).squaredNorm();
    error_of_prior += (prior.tau() - measured.tau()).squaredNorm();
  }
  EXPECT_LT(std::sqrt(error / error_of_prior), 0.05);
}

TEST(Tuner, OutputsThePriorBeforeTheFirstResult) {
  Subject tuner = tuner_of_planar2();
  tuner.initialise();
  EXPECT_EQ(tuner["mass"][0], 6);
  EXPECT_EQ(tuner["mass"][1], 4);
  EXPECT_NEAR(tuner["first_moment"][0], 6 * 0.2, 1e-15);
}

// The drive train divides by B: torques of a robot without motors must not give a B that the drive train refuses.
TEST(Tuner, OutputsMotorInertiaThatADriveTrainAccepts) {
  const robot::RobotModel real = robot::perturbed(planar(), 0.3, 5);
  Measured measured(real);
  Subject tuner = tuner_of_planar2("&motor_inertia=true");
  tuner.initialise();
  for (std::size_t j = 0; j < 2; ++j) EXPECT_EQ(tuner["B"][j], 1) << "the value of the drive train before the first result";
  Subject drive("unit:drive_train?robot=planar2");
  run(tuner, measured, 0, 5);
  ASSERT_EQ(tuner.integer("tunings"), 1) << tuner.text("warning");
  for (std::size_t j = 0; j < 2; ++j) {
    EXPECT_GT(tuner["B"][j], 0);
    EXPECT_LT(tuner["B"][j], 0.2);
    drive["B"][j] = tuner["B"][j];
  }
  ASSERT_NO_THROW(drive.initialise());
}

TEST(Tuner, OutputsAResultExactlyAfterItsLatency) {
  Measured measured(robot::perturbed(planar(), 0.2, 1));
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 4.498);
  EXPECT_EQ(tuner.integer("tunings"), 0);
  run(tuner, measured, 4.498, 4.501);
  EXPECT_EQ(tuner.integer("tunings"), 1);
  EXPECT_EQ(tuner.integer("late"), 0);
}

TEST(Tuner, FindsTheSameBitsAgain) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject one = tuner_of_planar2(), other = tuner_of_planar2();
  run(one, measured, 0, 9);
  run(other, measured, 0, 9);
  EXPECT_EQ(one.integer("tunings"), 2);
  EXPECT_EQ(one.outputs(), other.outputs());
}

TEST(Tuner, NeverWaitsWhereItMustNot) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject tuner = tuner_of_planar2("&wait=false");
  tuner.set("latency", "0");
  tuner.set("rounds", "100000");
  tuner.set("threshold", "0");
  run(tuner, measured, 0, 4.01);
  EXPECT_EQ(tuner.integer("tunings"), 0) << "100 000 rounds take longer than 10 ms";
}  // and the thread ends with its unit, during the search

TEST(Tuner, UsesALateResultOnArrivalAndCountsIt) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject tuner = tuner_of_planar2("&wait=false");
  tuner.set("latency", "0");
  tuner.set("rounds", "2000");
  run(tuner, measured, 0, 4.002);  // due after 4 s, which 2000 rounds do not meet
  for (int i = 0; i < 100000 && tuner.integer("tunings") == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    tuner.step();
  }
  EXPECT_EQ(tuner.integer("tunings"), 1);
  EXPECT_EQ(tuner.integer("late"), 1);
}

TEST(Tuner, TakesSamplesAlsoWhileItSeeks) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 4.1);
  const std::int32_t before = tuner.integer("samples");
  run(tuner, measured, 4.1, 4.4);  // due after 4.5 s
  EXPECT_EQ(tuner.integer("tunings"), 0);
  EXPECT_EQ(tuner.integer("samples"), before + 60);
  EXPECT_EQ(tuner.integer("skipped"), 0);
}

/// All outputs and states of a tuner after each of the steps from one instant to another.
std::vector<std::vector<std::string>> trace(Subject& tuner, Measured& robot, double from, double to) {
  std::vector<std::vector<std::string>> all;
  for (int i = static_cast<int>(from * 1000 + 0.5); i < static_cast<int>(to * 1000 + 0.5); ++i) {
    robot.at(i * 1e-3);
    robot.feed(tuner);
    tuner.step();
    if (i % 50 == 0) all.push_back(tuner.everything());
  }
  all.push_back(tuner.everything());
  return all;
}

// Before the first tuning, within a block of samples; during the search; in the step before a result is due and after it;
// during the second tuning.
TEST(Tuner, GoesOnToTheSameBitsInAFreshInstanceWhereverItWasSaved) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  for (const double when : {0.3, 2.013, 4.2, 4.499, 4.5, 6.37, 8.25}) {
    SCOPED_TRACE(when);
    Subject one = tuner_of_planar2();
    run(one, measured, 0, when);
    const std::string saved = one.save().serialise();
    const auto expected = trace(one, measured, when, 9);
    EXPECT_EQ(one.integer("tunings"), 2);

    Subject fresh = tuner_of_planar2();
    fresh.set("rounds", "3");  // parameters, too, are those of the snapshot
    fresh.set("forgetting", "0.99");
    measured.at(0.7);
    measured.feed(fresh);
    fresh.initialise();
    fresh.restore(Snapshot::deserialise(saved), when);
    EXPECT_EQ(trace(fresh, measured, when, 9), expected);
  }
}

TEST(Tuner, TakesItsStepsBack) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 4.2);
  const Snapshot seeking = tuner.save();
  const auto once = trace(tuner, measured, 4.2, 4.4);  // the same search is still running
  tuner.restore(seeking, 4.2);
  EXPECT_EQ(trace(tuner, measured, 4.2, 4.4), once);
  const auto adopted = trace(tuner, measured, 4.4, 4.6);
  const Snapshot behind = tuner.save();
  tuner.restore(seeking, 4.2);  // until after the adoption
  EXPECT_EQ(tuner.integer("tunings"), 0);
  (void)trace(tuner, measured, 4.2, 4.4);
  EXPECT_EQ(trace(tuner, measured, 4.4, 4.6), adopted);
  const auto later = trace(tuner, measured, 4.6, 8.7);
  EXPECT_EQ(tuner.integer("tunings"), 2);
  tuner.restore(behind, 4.6);
  EXPECT_EQ(trace(tuner, measured, 4.6, 8.7), later);
  // From the search to a state without search: the thread must stop.
  tuner.restore(seeking, 4.2);
  tuner.restore(behind, 4.6);
  EXPECT_EQ(trace(tuner, measured, 4.6, 8.7), later);
}

TEST(Tuner, InRealTimeCannotBeRestoredBecauseResultsComeAtAnyTime) {
  EXPECT_TRUE(tuner_of_planar2().unit().restorable());
  EXPECT_FALSE(tuner_of_planar2("&wait=false").unit().restorable());
}

/// What the unit remembers outside its variables.
std::string memory_of(Subject& tuner) {
  std::string bytes;
  tuner.unit().save_memory(bytes);
  return bytes;
}

/// The message of the error when `memory` is restored, or "".
std::string error_of(Subject& tuner, const std::string& memory) {
  try {
    tuner.unit().restore_memory(memory);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// A triangle of p columns: rows and pending rows (64-bit integers), weight, p (p + 1) / 2 numbers, p numbers per pending row.
TEST(Tuner, RefusesInvalidMemories) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 4.2);  // while it estimates
  const std::string good = memory_of(tuner);
  EXPECT_EQ(error_of(tuner, good), "");
  const auto with = [&](std::size_t at, auto value) {
    std::string bytes = good;
    std::memcpy(bytes.data() + at, &value, sizeof value);
    return error_of(tuner, bytes);
  };
  EXPECT_EQ(error_of(tuner, ""), "samples of the tuner: is cut short");
  for (std::size_t n = 1; n < good.size(); n += 101)
    EXPECT_EQ(error_of(tuner, good.substr(0, n)), "samples of the tuner: is cut short");
  EXPECT_EQ(error_of(tuner, good + "0"), "samples of the tuner: has bytes after its end");
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  EXPECT_THAT(with(0, std::uint64_t{1} << 54), HasSubstr("rows, expected at most 2^53"));
  EXPECT_THAT(with(0, std::uint64_t{1000}), HasSubstr("triangles of unlike numbers of rows"));
  EXPECT_THAT(with(8, std::uint64_t{64}), HasSubstr("has 64 rows in an incomplete block"));
  EXPECT_THAT(with(16, nan), HasSubstr("a number that is not finite in a triangle"));
  EXPECT_THAT(with(16, -1.0), HasSubstr("expected 0 or above"));
  EXPECT_THAT(with(24, infinity), HasSubstr("a number that is not finite in a triangle"));
  EXPECT_THAT(with(good.size() - 8, nan), HasSubstr("a number that is not finite in a triangle")) << "of the estimation";
  EXPECT_EQ(error_of(tuner, good), "") << "what was refused leaves a tuner that can be restored";
}

TEST(Tuner, RefusesStatesWithInvalidNumbers) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Measured measured(planar());
  Subject source = tuner_of_planar2();
  run(source, measured, 0, 4.2);
  const Snapshot good = source.save();
  const auto error_with = [&](const std::function<void(Subject&)>& damage) -> std::string {
    Subject tuner = tuner_of_planar2();
    tuner.initialise();
    tuner.restore(good, 4.2);
    damage(tuner);
    return error_of(tuner, memory_of(source));
  };
  const auto integer = [](const std::string& name, std::int32_t value) {
    return [=](Subject& tuner) { tuner.set(name, std::to_string(value)); };
  };
  EXPECT_EQ(error_with([](Subject&) {}), "");
  EXPECT_THAT(error_with([=](Subject& t) { t["filter"][4] = nan; }), HasSubstr("filter: has numbers that are not finite"));
  EXPECT_THAT(error_with([=](Subject& t) { t["due"][0] = nan; }), HasSubstr("due: nan, expected"));
  EXPECT_THAT(error_with([=](Subject& t) { t["next"][0] = 1e300; }), HasSubstr("next: 1e+300, expected"));
  EXPECT_THAT(error_with([=](Subject& t) { t["interval"][0] = nan; }), HasSubstr("interval: nan, expected"));
  EXPECT_THAT(error_with(integer("decimation", -2147483647 - 1)), HasSubstr("decimation: -2147483648, expected 1 to"));
  EXPECT_THAT(error_with(integer("particles", 2147483647)), HasSubstr("particles: 2147483647, expected 8 to"));
}

// A state that a host saved before initialisation holds no samples. The steps afterwards allocate nothing, whether the unit was
// initialised or not.
TEST(Tuner, ContinuesFromAStateSavedBeforeInitialisationAsWithoutSamples) {
  Measured measured(robot::perturbed(planar(), 0.2, 3));
  const Snapshot unborn = tuner_of_planar2().save();
  for (const bool initialised : {false, true}) {
    SCOPED_TRACE(initialised);
    Subject tuner = tuner_of_planar2();
    if (initialised) run(tuner, measured, 0, 1);
    tuner.restore(unborn, 0);
    tuner.set("next", "4");
    std::uint64_t allocated = 0;
    for (int i = 0; i < 4700; ++i) {
      measured.at(i * 1e-3);
      measured.feed(tuner);
      if (i == 700) tuner["q"][0] = std::numeric_limits<double>::infinity();  // this writes a warning
      const auto before = testing::allocations();
      tuner.step();
      allocated += testing::allocations() - before;
    }
    EXPECT_EQ(allocated, 0u);
    EXPECT_EQ(tuner.integer("tunings"), 1) << tuner.text("warning");
    EXPECT_NE(tuner.text("log"), "");
    EXPECT_GT(tuner.integer("samples"), 300);
    Subject again = tuner_of_planar2();
    again.restore(tuner.save(), 4.7);
    EXPECT_EQ(again.everything(), tuner.everything());
  }
}

TEST(Tuner, RefusesToRestoreAStateWithoutWaiting) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject tuner = tuner_of_planar2("&wait=false");
  tuner.set("rounds", "10");
  run(tuner, measured, 0, 4.2);
  EXPECT_THROW(tuner.restore(tuner.save(), 4.2), Error);
  for (int i = 0; i < 10000 && tuner.integer("tunings") == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    tuner.step();
  }
  EXPECT_EQ(tuner.integer("tunings"), 1) << tuner.text("warning");
}

TEST(Tuner, KeepsAHistoryOfWhatItFound) {
  Measured measured(robot::perturbed(planar(), 0.2, 2));
  Subject subject = tuner_of_planar2();
  run(subject, measured, 0, 9);
  const auto& tuner = dynamic_cast<const tuner::Tuner&>(subject.unit());
  ASSERT_EQ(tuner.robot().history.size(), 4u);  // two bodies, two tunings
  EXPECT_THAT(tuner.robot().history.back().reason, HasSubstr("tuned at 8 s"));
  EXPECT_EQ(tuner.robot().bodies[0].inertia.mass, subject["mass"][0]);
  subject.restore(subject.save(), 9);  // starts with the last tuning
  ASSERT_EQ(tuner.robot().history.size(), 2u);
  EXPECT_THAT(tuner.robot().history.back().reason, HasSubstr("tuned at 8 s"));
  EXPECT_EQ(tuner.robot().bodies[0].inertia.mass, subject["mass"][0]);
}

TEST(Tuner, IgnoresSamplesWithNaNAndReportsIt) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 1);
  const std::int32_t samples = tuner.integer("samples");
  EXPECT_GT(samples, 50);
  tuner["tau"][1] = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 100; ++i) tuner.step();
  EXPECT_EQ(tuner.integer("skipped"), 100);
  EXPECT_EQ(tuner.integer("samples"), samples);
  EXPECT_THAT(tuner.text("warning"), HasSubstr("not finite"));
}

// Two speeds that are finite, but their difference is not.
TEST(Tuner, LeavesOutSamplesThatTheFilterCannotFollow) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2("&friction=sigmoid");
  run(tuner, measured, 0, 1);
  const std::int32_t samples = tuner.integer("samples");
  for (int i = 0; i < 100; ++i) {
    tuner["dq"][0] = i % 2 == 0 ? 1.7e308 : -1.7e308;
    tuner.step();
  }
  EXPECT_GT(tuner.integer("skipped"), 40);
  EXPECT_EQ(tuner.integer("samples"), samples);
  EXPECT_THAT(tuner.text("warning"), HasSubstr("not finite"));
  for (const double x : tuner["filter"]) EXPECT_TRUE(std::isfinite(x));
}

TEST(Tuner, TakesNothingWhileItIsDisabled) {
  Measured measured(planar());
  Subject tuner = tuner_of_planar2();
  tuner.set("enabled", "false");
  run(tuner, measured, 0, 5);
  EXPECT_EQ(tuner.integer("samples"), 0);
  EXPECT_EQ(tuner.integer("tunings"), 0);
}

TEST(Tuner, AllocatesNothingInItsStepsWhileItTunes) {
  Measured measured(robot::perturbed(planar(), 0.2, 3));
  Subject tuner = tuner_of_planar2();
  run(tuner, measured, 0, 1);
  std::uint64_t allocated = 0;
  for (int i = 1000; i < 5000; ++i) {
    measured.at(i * 1e-3);
    measured.feed(tuner);
    const auto before = testing::allocations();
    tuner.step();
    allocated += testing::allocations() - before;
  }
  EXPECT_EQ(tuner.integer("tunings"), 1);
  EXPECT_EQ(allocated, 0u);
}

// A heavier forearm: the controller's inverse dynamics changes to it without a jump and ends at the right values.
TEST(BodyTunables, AreFollowedByTheControllerWithoutAJump) {
  Subject compliance("unit:compliance?robot=planar2");
  compliance["q_d"][0] = 0.3;
  compliance["q_d"][1] = -0.2;
  compliance.set("transition", "0.1");
  compliance.initialise();
  compliance.step();
  const auto torque = [&] { return compliance["tau_id"][1] - compliance["tau_f"][1]; };  // without the deflection of bristles
  const double before = torque();
  compliance["mass"][1] = 5;
  compliance["first_moment"][3] = 5 * 0.175;
  compliance["inertia"][9] += 0.175 * 0.175;  // Iyy and Izz about the elbow
  compliance["inertia"][11] += 0.175 * 0.175;
  double last = before, largest = 0;
  for (int i = 0; i < 4000; ++i) {
    compliance.step();
    largest = std::max(largest, std::abs(torque() - last));
    last = torque();
  }
  const double expected = 9.81 * 0.175 * std::cos(0.1);  // of one more kilogram
  EXPECT_NEAR(last - before, expected, 1e-6);
  EXPECT_LT(largest, 0.02 * expected);
}

TEST(BodyTunables, AreFollowedByTheDriveTrainAndItsEnergy) {
  Subject drive("unit:drive_train?robot=planar2");
  drive.initialise();
  const double before = drive["energy_potential"][0];
  drive["mass"][0] = 7;
  drive["first_moment"][0] = 7 * 0.2;
  drive["inertia"][3] += 0.04;
  drive["inertia"][5] += 0.04;
  drive.set("transition", "0");
  drive.step();
  EXPECT_NEAR(drive["energy_potential"][0] - before, 9.81 * 0.5, 1e-3);  // a kilogram at the height of the shoulder
}

TEST(BodyTunables, RefuseAnUnphysicalBody) {
  Subject drive("unit:drive_train?robot=planar2");
  drive.initialise();
  drive["inertia"][3] = -1;
  try {
    drive.step();
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("mass[1]"));
    EXPECT_THAT(error.what(), HasSubstr("upper_arm"));
  }
}

robot::RobotModel with_tool(robot::RobotModel robot) {
  robot::Attachment tool{"gripper", "tip", Pose{}, {1.5, {0.05, 0, 0.02}, Eigen::Matrix3d::Zero()}};
  tool.inertia.I_CC.diagonal() << 4e-3, 5e-3, 6e-3;
  robot::attach(robot, tool);
  return robot;
}

// What is known of the tool is subtracted from the torque: the samples before it remain valid, and so does the estimate.
TEST(Tuner, KeepsItsSamplesWhenAKnownToolIsAttached) {
  const robot::RobotModel bare = robot::perturbed(planar(), 0.3, 5), loaded = with_tool(bare);
  const auto tool = (loaded.bodies[1].inertia.parameters() - bare.bodies[1].inertia.parameters()).eval();
  Subject tuner = tuner_of_planar2();
  Measured without(bare), with(loaded);
  run(tuner, without, 0, 5);
  ASSERT_EQ(tuner.integer("tunings"), 1);
  const std::int32_t samples = tuner.integer("samples");
  const double mass = tuner["mass"][1];
  tuner["tool_mass"][1] = tool[0];
  for (std::size_t k = 0; k < 3; ++k) tuner["tool_first_moment"][3 + k] = tool[static_cast<Eigen::Index>(1 + k)];
  for (std::size_t k = 0; k < 6; ++k) tuner["tool_inertia"][6 + k] = tool[static_cast<Eigen::Index>(4 + k)];
  run(tuner, with, 5, 5.001);
  EXPECT_DOUBLE_EQ(tuner["mass"][1], mass + 1.5);  // at once
  EXPECT_EQ(tuner.integer("samples"), samples);
  run(tuner, with, 5.001, 13);
  ASSERT_EQ(tuner.integer("tunings"), 3);
  EXPECT_GT(tuner.integer("samples"), samples);
  // gravity's torque at the elbow: m c of the forearm with the tool
  EXPECT_NEAR(tuner["first_moment"][3], loaded.bodies[1].inertia.parameters()[1],
              2e-3 * loaded.bodies[1].inertia.parameters()[1]);
  EXPECT_LT(tuner["rms"][1], 0.02);
}

TEST(Tuner, FindsAnUnknownToolWhenItStartsAgain) {
  const robot::RobotModel bare = planar(), loaded = with_tool(bare);
  const double truth = loaded.bodies[1].inertia.parameters()[1], before = bare.bodies[1].inertia.parameters()[1];
  Subject tuner = tuner_of_planar2(), mixed = tuner_of_planar2();
  for (Subject* subject : {&tuner, &mixed}) {
    Measured without(bare), with(loaded);
    run(*subject, without, 0, 4.25);  // an estimation of the bare robot runs
    if (subject == &tuner) tuner["restart"][0] += 1;
    run(*subject, with, 4.25, 4.75);
    if (subject == &tuner) {
      EXPECT_EQ(tuner.integer("tunings"), 0);  // it was dropped
      EXPECT_EQ(tuner.integer("samples"), 0);
    }
    run(*subject, with, 4.75, 9);
  }
  EXPECT_NEAR(tuner["first_moment"][3], truth, 5e-3 * truth);
  EXPECT_GT(std::abs(mixed["first_moment"][3] - truth), 0.2 * (truth - before));
}

TEST(Tuner, RestoresItsToolsAndItsEstimateToTheBit) {
  const robot::RobotModel bare = planar(), loaded = with_tool(bare);
  Subject tuner = tuner_of_planar2(), other = tuner_of_planar2();
  Measured without(bare), with(loaded);
  run(tuner, without, 0, 4.2);
  tuner["tool_mass"][1] = 1.5;
  tuner["tool_first_moment"][3] = 0.1;
  tuner["tool_inertia"][6] = tuner["tool_inertia"][9] = tuner["tool_inertia"][11] = 0.05;
  run(tuner, with, 4.2, 6);
  const Snapshot snapshot = tuner.save();
  run(tuner, with, 6, 9);
  other.restore(snapshot, 6);
  run(other, with, 6, 9);
  EXPECT_EQ(other.everything(), tuner.everything());
}

}  // namespace
}  // namespace cotwin::tuner_test
