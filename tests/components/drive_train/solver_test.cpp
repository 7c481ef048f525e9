// The drive train's solvers: order, agreement, snapshots bit for bit, no allocation, bounded work.
#include <gtest/gtest.h>

#include <cstring>

#include "tests/components/drive_train/harness.h"
#include "tests/support/allocations.h"

namespace cotwin::testing::solver_test {
namespace {

void excite(Drive& drive, int step, double size = 1) {
  for (std::size_t i = 0; i < drive["tau_m"].size(); ++i) drive["tau_m"][i] = size * excitation(step, i);
}

using Trajectory = std::vector<double>;

Trajectory run(Drive& drive, int steps, double h, double size = 1) {
  drive.initialise();
  Trajectory trajectory;
  for (int n = 0; n < steps; ++n) {
    excite(drive, n, size);
    drive.step(h);
    trajectory.insert(trajectory.end(), drive["q"].begin(), drive["q"].end());
    trajectory.insert(trajectory.end(), drive["theta"].begin(), drive["theta"].end());
  }
  return trajectory;
}

double distance(const Trajectory& a, const Trajectory& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

// LuGre friction on elastic joints, and a stiff variant with σ0 x 100 and σ1 x 10.
Drive lwr(const std::string& query, bool stiff) {
  Drive drive("robot=lwr4" + query);
  for (double& s : drive["sigma0"]) s *= stiff ? 100 : 1;
  for (double& s : drive["sigma1"]) s *= stiff ? 10 : 1;
  return drive;
}

TEST(DriveTrainRosenbrock, IsOfOrderTwo) {
  // Smooth: viscous friction, elastic joints, the sigmoid of the links; torques constant for 5 ms.
  const auto make = [](const std::string& query) {
    Drive drive("robot=lwr4" + query);
    drive.set("tau_C", 0).set("tau_S", 0).set("link_A", 0.6).set("link_alpha", 5);
    return drive;
  };
  Drive tight = make("&method=cvode");
  tight.tolerances(1e-12, 1e-14, 1e-12);
  const Trajectory reference = run(tight, 40, 5e-3);
  std::vector<double> errors;
  for (const int m : {32, 64, 128}) {
    Drive drive = make("&method=rosenbrock");
    drive.substeps(m);
    errors.push_back(distance(run(drive, 40, 5e-3), reference));
  }
  EXPECT_NEAR(errors[0] / errors[1], 4, 0.6);
  EXPECT_NEAR(errors[1] / errors[2], 4, 0.4);
  EXPECT_LT(errors[2], 1e-6);
}

TEST(DriveTrainRosenbrock, KeepsItsOrderUnderRampedTorquesAndAMovingLink) {
  const auto follow = [](Drive& drive) {
    drive.set("input_order", 1).set("tau_C", 0).set("tau_S", 0).set("sigma2", 5).set("D", 4).set("B", 0.7);
    drive.initialise();
    Trajectory trajectory;
    for (int n = 1; n <= 40; ++n) {
      const double t = 5e-3 * n;
      drive.set("tau_m", 10 * std::sin(20 * t)).set("q", 0.01 * std::sin(15 * t)).set("dq", 0.15 * std::cos(15 * t));
      drive.step(5e-3);
      trajectory.push_back(drive["theta"][0]);
    }
    return trajectory;
  };
  Drive tight("link_side=outside&joints=1&method=cvode");
  tight.tolerances(1e-12, 1e-14, 1e-12);
  const Trajectory reference = follow(tight);
  std::vector<double> errors;
  for (const int m : {32, 64, 128}) {
    Drive drive("link_side=outside&joints=1&method=rosenbrock");
    drive.substeps(m);
    errors.push_back(distance(follow(drive), reference));
  }
  EXPECT_NEAR(errors[0] / errors[1], 4, 0.3);
  EXPECT_NEAR(errors[1] / errors[2], 4, 0.3);
}

TEST(DriveTrainRosenbrock, WithLugreAgreesWithATightCvodeAsCloselyAsItsToleranceSays) {
  for (const bool stiff : {false, true}) {
    Drive tight = lwr("&method=cvode", stiff);
    tight.tolerances(1e-11, 1e-13, 1e-11);
    const Trajectory reference = run(tight, 500, 1e-3);
    double last = 1;
    for (const double atol : {1e-8, 1e-9, 1e-10}) {
      Drive drive = lwr("&method=rosenbrock", stiff);
      drive.tolerances(0, atol, 1).set("max_substeps", 100000);
      const double error = distance(run(drive, 500, 1e-3), reference);
      EXPECT_LT(error, 2e4 * atol) << stiff << " " << atol;  // 500 steps of several sub-steps each, amplified by the arm
      EXPECT_LT(error, last) << stiff << " " << atol;
      last = error;
    }
  }
}

TEST(DriveTrainRosenbrock, AtItsDefaultsIsWithinAMicroradian) {
  Drive tight = lwr("&method=cvode", false), drive = lwr("&method=rosenbrock", false);
  tight.tolerances(1e-11, 1e-13, 1e-11);
  EXPECT_LT(distance(run(drive, 500, 1e-3), run(tight, 500, 1e-3)), 1e-6);
}

TEST(DriveTrainRosenbrock, TakesNoMoreThanTheAllowedSubstepsAndSaysSo) {
  Drive drive = lwr("&method=rosenbrock", true);
  drive.tolerances(0, 1e-13, 1e-12).set("max_substeps", 5);
  drive.initialise();
  int forced = 0;
  for (int n = 0; n < 200; ++n) {
    excite(drive, n);
    drive.step(1e-3);
    ASSERT_LE(drive.integer("substeps"), 5);
    forced += drive.integer("forced_substeps");
    ASSERT_EQ(drive.integer("forced_substeps") > 0, drive["error_estimate"][0] > 1);
  }
  EXPECT_GT(forced, 200);
  EXPECT_EQ(drive.variables().first_not_finite(), "");
}

TEST(DriveTrainRosenbrock, WarnsWhereForcedSubstepsMissTheToleranceByFar) {
  // Motors of 1e-5 kg.m² with bristles of 5000 N.m/rad are too fast for 64 sub-steps after a jump of the torque; the robot's
  // own motors are not.
  for (const bool light : {false, true}) {
    Drive drive("robot=lwr4");
    if (light) drive.set("B", 1e-5);
    drive.initialise();
    std::uint64_t allocated = 0;
    for (int n = 0; n < 300; ++n) {
      excite(drive, n / 100 * 100);
      const std::uint64_t before = allocations();
      drive.step(1e-3);
      allocated += allocations() - before;
    }
    EXPECT_NE(drive.variables().at("warning").strings()[0].empty(), light);
    EXPECT_EQ(allocated, 0u);
    drive.initialise();
    EXPECT_TRUE(drive.variables().at("warning").strings()[0].empty());
  }
}

TEST(DriveTrainRosenbrock, StaysBoundedInSubstepsForcedAgainstTheTolerance) {
  // One sub-step per step, bristles up to a million times stiffer. Without its bound, z would overflow in most of these runs. The
  // second joint passes its limit, and an impact on its stop has no accuracy in a sub-step of 10 ms.
  for (const double h : {1e-3, 10e-3}) {
    for (const double factor : {1.0, 1e2, 1e4, 1e6}) {
      Drive drive("robot=lwr4&method=rosenbrock");
      for (double& s : drive["sigma0"]) s *= factor;
      for (double& s : drive["sigma1"]) s *= std::sqrt(factor);
      drive.set("max_substeps", 1).set("stop_stiffness", 0);
      drive.initialise();
      for (int n = 0; n < 1000; ++n) {
        excite(drive, n);
        ASSERT_EQ(drive.try_step(h), StepResult::kDone) << h << " " << factor;
        for (const double speed : drive["dtheta"]) ASSERT_LT(std::abs(speed), 10) << h << " " << factor;
      }
    }
  }
}

TEST(DriveTrainSundials, AgreeWithATightSolutionAsCloselyAsTheirToleranceSays) {
  Drive tight = lwr("&method=cvode", false);
  tight.tolerances(1e-11, 1e-13, 1e-11);
  const Trajectory reference = run(tight, 300, 1e-3);
  for (const char* method : {"&method=cvode"}) {
    double last = 1;
    for (const double rtol : {1e-6, 1e-8, 1e-10}) {
      Drive drive = lwr(method, false);
      drive.tolerances(rtol, 1e-3 * rtol, 0.1 * rtol);
      const double error = distance(run(drive, 300, 1e-3), reference);
      EXPECT_LT(error, last) << method << " " << rtol;
      last = error;
    }
    EXPECT_LT(last, 1e-6) << method;
  }
}

TEST(DriveTrainSundials, KeepsItsHistoryWhereInputsAreContinuousAndNeedsFewerStepsThen) {
  for (const char* method : {"cvode"}) {
    int held = 0, ramped = 0;
    for (const int order : {0, 1}) {
      Drive drive(std::string("robot=lwr4&method=") + method);
      drive.set("input_order", order);
      drive.initialise();
      for (int n = 0; n < 200; ++n) {
        excite(drive, n);
        drive.step(1e-3);
        (order == 0 ? held : ramped) += drive.integer("substeps");
      }
    }
    EXPECT_LT(ramped, 0.7 * held) << method;
  }
}

TEST(DriveTrainInputs, WithRatesEqualARampToTheSameValue) {
  for (const char* method : {"exponential", "rosenbrock", "cvode"}) {
    Drive ramped(std::string("robot=lwr4&method=") + method), rated(std::string("robot=lwr4&method=") + method);
    ramped.set("input_order", 1);
    ramped.initialise();
    rated.initialise();
    const std::span<double> rate = rated.variables().at("tau_m").rate;
    std::vector<double> before(7, 0.0);
    for (int n = 0; n < 50; ++n) {
      excite(ramped, n);
      for (std::size_t i = 0; i < 7; ++i) {
        rated["tau_m"][i] = before[i];
        rate[i] = (ramped["tau_m"][i] - before[i]) / 1e-3;
        before[i] = ramped["tau_m"][i];
      }
      ramped.step(1e-3);
      rated.step(1e-3);
      for (std::size_t i = 0; i < 7; ++i) ASSERT_EQ(ramped["q"][i], rated["q"][i]) << method << " " << n;
    }
  }
}

TEST(DriveTrainSolversAll, DiscardAStepThatLeavesTheFiniteNumbersAndGoOnAfterIt) {
  for (const char* method : {"exponential", "rosenbrock", "cvode"}) {
    Drive drive(std::string("robot=lwr4&method=") + method), twin(std::string("robot=lwr4&method=") + method);
    for (Drive* d : {&drive, &twin}) d->initialise();
    drive.set("tau_m", 1e200);
    const std::vector<double> q(drive["q"].begin(), drive["q"].end()), z(drive["z"].begin(), drive["z"].end());
    ASSERT_EQ(drive.try_step(1e-3), StepResult::kDiscard) << method;
    EXPECT_TRUE(std::equal(q.begin(), q.end(), drive["q"].begin()));
    EXPECT_TRUE(std::equal(z.begin(), z.end(), drive["z"].begin()));
    for (int n = 0; n < 20; ++n) {
      for (Drive* d : {&drive, &twin}) {
        excite(*d, n);
        d->step(1e-3);
      }
      for (std::size_t i = 0; i < 7; ++i) ASSERT_EQ(drive["theta"][i], twin["theta"][i]) << method << " " << n;
    }
  }
}

class DriveTrainSolvers : public ::testing::TestWithParam<std::string> {};

std::vector<std::uint64_t> bits(const Variables& variables) {
  std::vector<std::uint64_t> all;
  for (const Variable& v : variables) {
    if (v.kind() == Kind::kInteger) all.insert(all.end(), v.integers().begin(), v.integers().end());
    if (v.kind() != Kind::kReal) continue;
    for (const double value : v.reals()) {
      std::uint64_t word = 0;
      std::memcpy(&word, &value, sizeof word);
      all.push_back(word);
    }
  }
  return all;
}

// Torques that are constant or jump, and move the robot's links into their stops; an outside link oscillates.
void drive_about(Drive& drive, int n) {
  excite(drive, n / 7 * 7, n < 60 ? 1 : 4);
  if (drive.variables().at("q").role != Role::kInput) return;
  for (std::size_t i = 0; i < drive["q"].size(); ++i) {
    drive["q"][i] = 0.1 * std::sin(0.02 * n + static_cast<double>(i));
    drive["dq"][i] = 0.1 * 20 * std::cos(0.02 * n + static_cast<double>(i));
  }
}

Drive prepared(const std::string& query, int input_order) {
  Drive drive(query);
  drive.set("input_order", input_order).set("stop_stiffness", 1e5).set("q_min", -0.05).set("q_max", 0.04);
  drive_about(drive, 0);
  drive.initialise();
  return drive;
}

TEST_P(DriveTrainSolvers, StepFromASnapshotExactlyAsTheyWouldHaveStepped) {
  for (const int input_order : {0, 1}) {
    Drive drive = prepared(GetParam(), input_order), fresh = prepared(GetParam(), input_order);
    Snapshot snapshot;
    for (int n = 0; n < 120; ++n) {
      const double h = n % 5 == 4 ? 0.4e-3 : 1e-3;
      snapshot.take(drive.variables());
      fresh.move_clock_to(drive);
      drive_about(drive, n);
      drive.step(h);
      const auto once = bits(drive.variables());
      if (n % 3 == 0) {  // into another instance with another history
        Snapshot::deserialise(snapshot.serialise()).restore(fresh.variables(), *fresh.instance().unit);
        drive_about(fresh, n);
        fresh.step(h);
        ASSERT_EQ(bits(fresh.variables()), once) << "step " << n << ", input_order " << input_order;
      }
      if (n % 4 == 0) {  // back, elsewhere, and back again
        snapshot.restore(drive.variables(), *drive.instance().unit);
        drive_about(drive, n + 50);
        ASSERT_EQ(drive.instance().unit->step(Time{0}, Duration::from_seconds(2e-3)), StepResult::kDone);
        snapshot.restore(drive.variables(), *drive.instance().unit);
        drive_about(drive, n);
        ASSERT_EQ(drive.instance().unit->step(Time{0}, Duration::from_seconds(h)), StepResult::kDone);
        ASSERT_EQ(bits(drive.variables()), once) << "step " << n << ", input_order " << input_order;
      }
    }
  }
}

TEST_P(DriveTrainSolvers, AllocateNothingInAStep) {
  for (const int input_order : {0, 1}) {
    Drive drive = prepared(GetParam(), input_order);
    std::uint64_t allocated = 0;
    for (int n = 0; n < 150; ++n) {
      drive_about(drive, n);
      const std::uint64_t before = allocations();
      const StepResult result = drive.try_step(1e-3);
      allocated += allocations() - before;
      ASSERT_EQ(result, StepResult::kDone);
    }
    EXPECT_EQ(allocated, 0u) << "input_order " << input_order;
  }
}

TEST_P(DriveTrainSolvers, StartAfreshWhenInitialisedAgain) {
  Drive drive = prepared(GetParam(), 1);
  const auto start = bits(drive.variables());
  for (int n = 0; n < 50; ++n) {
    drive_about(drive, n);
    drive.step(1e-3);
  }
  drive_about(drive, 0);
  drive.initialise();
  EXPECT_EQ(bits(drive.variables()), start);
}

TEST_P(DriveTrainSolvers, ForgetStopsThatParametersHaveRemoved) {
  Drive drive = prepared(GetParam(), 0), fresh = prepared(GetParam(), 0);
  if (drive.variables().at("q").role == Role::kInput) return;  // stops belong to the unit that integrates the links
  bool in_stop = false;
  for (int n = 0; n < 300 && !in_stop; ++n) {
    drive_about(drive, n);
    drive.step(1e-3);
    for (std::size_t i = 0; i < 7; ++i) in_stop = in_stop || drive.integer("stop", i) != 0;
  }
  ASSERT_TRUE(in_stop);
  for (Drive* d : {&drive, &fresh}) {
    drive_about(*d, 0);
    d->set("stop_stiffness", 0).initialise();
  }
  fresh.move_clock_to(drive);
  for (int n = 0; n < 20; ++n) {
    for (Drive* d : {&drive, &fresh}) {
      drive_about(*d, n);
      d->step(1e-3);
    }
    ASSERT_EQ(bits(drive.variables()), bits(fresh.variables())) << "step " << n;
  }
}

INSTANTIATE_TEST_SUITE_P(Variants, DriveTrainSolvers,
                         ::testing::Values("robot=lwr4", "robot=lwr4&method=rosenbrock", "robot=lwr4&method=cvode",
                                           "robot=lwr4&friction=coulomb", "robot=lwr4&friction=coulomb&method=rosenbrock",
                                           "robot=lwr4&friction=coulomb&method=cvode", "robot=lwr4&friction=elasto_plastic",
                                           "robot=lwr4&transmission=rigid", "robot=lwr4&transmission=rigid&method=cvode",
                                           "link_side=outside&joints=3", "link_side=outside&joints=3&method=cvode"),
                         [](const auto& query) {
                           std::string name;
                           for (const char c : query.param) name += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
                           return name;
                         });

}  // namespace
}  // namespace cotwin::testing::solver_test
