// The fit of drive losses to a wattmeter's log: logs whose parameters are known, damaged logs, and the log of a UR3e.
#include "models/energetics/power_fit.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <random>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::energetics::power_fit_test {
namespace {

using cotwin::testing::error_of;
using ::testing::HasSubstr;

constexpr int kJoints = 3;

PowerLog parse_power_log(const std::string& text, const std::string& name, const PowerColumns& columns = {},
                         const robot::RobotModel* robot = nullptr) {
  return read_power_log(cotwin::testing::TemporaryFile(text, name).path(), columns, robot);
}

/// A log whose power is known: motions of 1.6 s with rests of 0.8 s.
struct Synthetic {
  double step = 0.02;
  double noise = 0;  // W
  double P_0 = 35, k[kJoints] = {11, 8, 5}, r[kJoints] = {0.6, 1, 1.5};
  double c[kJoints] = {6, 4, 2}, d[kJoints] = {3, 2, 1};
  std::vector<int> motionless;  // joints, from 0
  bool with_tau = true, with_i = true, with_q = false;
  double power_factor = 1, speed_factor = 1, time_factor = 1;
  bool by_currents = true;       // power of kCurrent, else of kMotion with a = 1
  double rest_of_current = 0.3;  // A, share of gravity
  std::function<bool(double)> drop = [](double) { return false; };

  std::string text() const {
    std::string csv = "t,P";
    for (const char* name : {"q", "dq", "tau", "i"}) {
      if ((*name == 'q' && !with_q) || (*name == 't' && !with_tau) || (*name == 'i' && !with_i)) continue;
      for (int j = 1; j <= kJoints; ++j) csv += std::string(",") + name + std::to_string(j);
    }
    csv += '\n';
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    constexpr double kPi = 3.14159265358979323846, kPeriod = 2.4, kMoving = 1.6;
    for (double t = 0; t < 30; t += step) {
      if (drop(t)) continue;
      const int number = static_cast<int>(t / kPeriod);
      const double s = (t - number * kPeriod) / kMoving;
      double P = P_0;
      std::string q_cells, dq_cells, tau_cells, i_cells;
      for (int j = 0; j < kJoints; ++j) {
        const bool still = std::ranges::find(motionless, j) != motionless.end();
        const double top = still ? 0 : std::sin(1.7 * number + 2.1 * j + 0.3);
        const double dq = s < 1 ? top * std::pow(std::sin(kPi * s), 2) : 0;
        double q = top * kMoving * (s < 1 ? 0.5 * s - std::sin(2 * kPi * s) / (4 * kPi) : 0.5);
        for (int before = 0; before < number && !still; ++before) q += 0.5 * kMoving * std::sin(1.7 * before + 2.1 * j + 0.3);
        const double ddq = s < 1 ? top * kPi / kMoving * std::sin(2 * kPi * s) : 0;
        const double tau = 4 * ddq + 3 * std::sin(0.9 * number + j + s);
        const double i = still ? 0 : (tau + 3 * (dq > 0 ? 1 : dq < 0 ? -1 : 0)) / k[j] + rest_of_current;
        P += by_currents ? k[j] * i * dq + r[j] * i * i : tau * dq + c[j] * std::abs(dq) + d[j] * dq * dq;
        q_cells += "," + text::to_text(q);
        dq_cells += "," + text::to_text(speed_factor * dq);
        tau_cells += "," + text::to_text(tau);
        i_cells += "," + text::to_text(i);
      }
      csv += text::to_text(t * time_factor) + "," + text::to_text(power_factor * (P + noise * normal(random)));
      csv += (with_q ? q_cells : "") + dq_cells + (with_tau ? tau_cells : "") + (with_i ? i_cells : "") + "\n";
    }
    return csv;
  }
  PowerLog log() const { return parse_power_log(text(), "log.csv"); }
};

TEST(PowerFit, FindsTheParametersOfALogWithoutNoise) {
  const Synthetic currents;
  PowerFit fit = fit_power(currents.log(), PowerModel::kCurrent);
  EXPECT_NEAR(fit.value("P_0"), 35, 1e-9);
  for (int j = 0; j < kJoints; ++j) {
    EXPECT_NEAR(fit.value("k_" + std::to_string(j + 1)), currents.k[j], 1e-9);
    EXPECT_NEAR(fit.value("r_" + std::to_string(j + 1)), currents.r[j], 1e-9);
  }
  Synthetic motion;
  motion.by_currents = false;
  for (const FitOptions options : {FitOptions{}, FitOptions{.nonnegative = false}, FitOptions{.gain_is_one = true}}) {
    fit = fit_power(motion.log(), PowerModel::kMotion, {}, options);
    EXPECT_NEAR(fit.value("a"), 1, 1e-9);
    EXPECT_NEAR(fit.value("P_0"), 35, 1e-9);
    for (int j = 0; j < kJoints; ++j) {
      EXPECT_NEAR(fit.value("c_" + std::to_string(j + 1)), motion.c[j], 1e-8);
      EXPECT_NEAR(fit.value("d_" + std::to_string(j + 1)), motion.d[j], 1e-8);
    }
  }
  EXPECT_NEAR(fit.rmse, 0, 1e-9);
  EXPECT_LT(leave_one_out(motion.log(), PowerModel::kMotion).motion_part, 1e-9);
}

TEST(PowerFit, StandardErrorsAreThoseOfTheNoise) {
  Synthetic log;
  log.noise = 2;
  const PowerFit fit = fit_power(log.log(), PowerModel::kCurrent);
  EXPECT_NEAR(fit.rmse, 2, 0.1);
  for (const PowerParameter& p : fit.parameters) {
    const double truth = p.joint == 0 ? log.P_0 : p.name[0] == 'k' ? log.k[p.joint - 1] : log.r[p.joint - 1];
    EXPECT_LT(std::abs(p.value - truth), 4 * p.error) << p.name;
    EXPECT_GT(p.error, 0) << p.name;
  }
}

TEST(PowerFit, HardlyDependsOnTheRateOfTheLog) {
  for (const double step : {0.002, 0.01, 0.04, 0.1}) {
    Synthetic log;
    log.step = step;
    log.noise = 0.5;
    const PowerFit fit = fit_power(log.log(), PowerModel::kCurrent);
    for (int j = 1; j <= kJoints; ++j) EXPECT_NEAR(fit.value("k_" + std::to_string(j)), log.k[j - 1], 1.2) << step;
    EXPECT_GE(leave_one_out(log.log(), PowerModel::kCurrent).motions, 10u);
  }
}

TEST(PowerFit, TellsWhichParametersTheLogDoesNotShow) {
  Synthetic still;
  still.motionless = {1};
  PowerFit fit = fit_power(still.log(), PowerModel::kCurrent);
  for (const PowerParameter& p : fit.parameters) {
    EXPECT_EQ(p.told, p.joint == 2 ? Told::kUnexcited : Told::kValue) << p.name;
    if (p.joint == 2) {
      EXPECT_EQ(p.value, 0);
    }
  }
  EXPECT_NEAR(fit.value("k_1"), 11, 1e-9);
  EXPECT_NEAR(fit.value("k_3"), 5, 1e-9);
  // A current that is constant cannot be told from idle power: r_2 i² and P_0.
  std::string csv = "t,P,dq1,i1\n";
  for (int k = 0; k < 200; ++k) {
    const double dq = std::max(std::sin(0.1 * k), 0.0);
    csv += text::to_text(0.01 * k) + "," + text::to_text(20 + 3 * dq) + "," + text::to_text(dq) + ",2\n";
  }
  fit = fit_power(parse_power_log(csv, "log.csv"), PowerModel::kCurrent);
  EXPECT_EQ(fit.parameters[0].told, Told::kDependent);
  EXPECT_EQ(fit.parameters[1].told, Told::kValue);
  EXPECT_EQ(fit.parameters[2].told, Told::kDependent);
  EXPECT_NEAR(fit.value("k_1"), 1.5, 1e-9);
  EXPECT_NEAR(fit.value("P_0") + 4 * fit.value("r_1"), 20, 1e-9);
}

TEST(PowerFit, RefusesCurrentsThatAreCountedAgainstTheTorques) {
  std::string csv = "t,P,dq1,i1\n";
  for (int k = 0; k < 200; ++k) {
    const double dq = std::sin(0.1 * k), i = std::cos(0.17 * k);
    csv += text::to_text(0.01 * k) + "," + text::to_text(20 - 3 * i * dq + i * i) + "," + text::to_text(dq) + "," +
           text::to_text(i) + "\n";
  }
  EXPECT_THAT(error_of([&] { fit_power(parse_power_log(csv, "log.csv"), PowerModel::kCurrent); }), HasSubstr("k_1 = -3 N.m/A"));
}

TEST(PowerFit, KeepsLossesNonNegativeAndIsThenOptimal) {
  Synthetic log;
  log.by_currents = false;
  log.d[0] = -4;  // friction that falls with the speed
  log.noise = 1;
  const PowerLog data = log.log();
  const PowerFit free = fit_power(data, PowerModel::kMotion, {}, {.nonnegative = false}),
                 bound = fit_power(data, PowerModel::kMotion);
  EXPECT_LT(free.value("d_1"), -2);
  EXPECT_EQ(bound.value("d_1"), 0);
  for (const PowerParameter& p : bound.parameters) EXPECT_EQ(p.told, p.name == "d_1" ? Told::kAtZero : Told::kValue) << p.name;
  EXPECT_GE(bound.rmse, free.rmse);
  // No permitted change of a parameter makes the fit better (conditions of Karush, Kuhn and Tucker).
  const auto squares = [&](const PowerFit& fit) {
    double s = 0;
    for (std::size_t k = 0; k < data.t.size(); ++k) s += std::pow(fit.power(data, k) - data.P[k], 2);
    return s;
  };
  const double least = squares(bound);
  for (std::size_t k = 0; k < bound.parameters.size(); ++k) {
    for (const double change : {-1e-4, 1e-4}) {
      PowerFit other = bound;
      other.parameters[k].value += change;
      if (other.parameters[k].nonnegative && other.parameters[k].value < 0) continue;
      EXPECT_GT(squares(other), least) << bound.parameters[k].name;
    }
  }
}

TEST(PowerLog, LeavesOutGapsAndDamagedRows) {
  Synthetic log;
  log.drop = [](double t) { return t > 8 && t < 9.5; };
  std::string csv = log.text();
  csv += "31,nan,0,0,0,0,0,0,0,0,0\n31.1,36,0,0,inf,0,0,0,0,0,0\n";
  const PowerLog data = parse_power_log(csv, "log.csv");
  EXPECT_EQ(data.begins.size(), 2u);
  EXPECT_EQ(data.warnings.size(), 2u);
  EXPECT_EQ(motions_of(data).size(), motions_of(Synthetic().log()).size()) << "one is cut off at each end of the gap";
  for (const LoggedMotion& m : motions_of(data))
    for (std::size_t k = m.begin + 1; k < m.end; ++k) EXPECT_LT(data.t[k] - data.t[k - 1], 0.1);
  EXPECT_NEAR(fit_power(data, PowerModel::kCurrent).value("k_1"), 11, 1e-9);
}

TEST(PowerLog, UsesAMotionThatTheEndOfTheRecordingCutsOff) {
  Synthetic log;
  log.drop = [](double t) { return t > 3 * 2.4 + 1; };  // 1 s after the beginning of the fourth motion
  const PowerLog data = log.log();
  const std::vector<LoggedMotion> motions = motions_of(data);
  ASSERT_EQ(motions.size(), 4u);
  EXPECT_EQ(motions.back().end, data.t.size());
  const HeldOut held_out = leave_one_out(data, PowerModel::kCurrent);
  EXPECT_EQ(held_out.motions, 4u);
  EXPECT_LT(held_out.largest, 1e-9);
  log.drop = [](double t) { return t > 3 * 2.4 + 0.1; };
  EXPECT_EQ(motions_of(log.log()).size(), 3u) << "0.1 s are no motion";
}

TEST(PowerLog, TakesSeveralRecordingsInOneFile) {
  Synthetic first, second;
  first.drop = [](double t) { return t > 3 * 2.4 + 1; };
  second.drop = [](double t) { return t < 6 * 2.4 + 0.5; };  // begins and ends amid a motion
  const std::string a = first.text(), b = second.text();
  const PowerLog data = parse_power_log(b + a, "log.csv");  // with the header in the middle
  EXPECT_EQ(data.recordings, 2u);
  EXPECT_EQ(data.begins, (std::vector<std::size_t>{0, second.log().t.size()}));
  EXPECT_TRUE(data.warnings.empty());
  const std::vector<LoggedMotion> motions = motions_of(data);
  EXPECT_EQ(motions.size(), motions_of(first.log()).size() + motions_of(second.log()).size());
  for (const LoggedMotion& m : motions) EXPECT_LT(data.t[m.end - 1] - data.t[m.begin], 1.7) << "no motion spans two recordings";
  EXPECT_NEAR(fit_power(data, PowerModel::kCurrent).value("k_1"), 11, 1e-9);
  EXPECT_LT(leave_one_out(data, PowerModel::kCurrent).largest, 1e-9);
}

TEST(PowerLog, TakesOtherNamesAndJointsCountedFromZero) {
  const Synthetic log;
  std::string csv = log.text();
  csv.replace(
      0, csv.find('\n'),
      "timestamp,watts,actual_qd_0,actual_qd_1,actual_qd_2,m_0,m_1,m_2,actual_current_0,actual_current_1,actual_current_2");
  PowerColumns columns;
  columns.power = "watts";
  columns.dq = "actual_qd_";
  columns.i = "actual_current_";
  const PowerFit fit = fit_power(parse_power_log(csv, "log.csv", columns), PowerModel::kCurrent);
  for (int j = 0; j < kJoints; ++j) EXPECT_NEAR(fit.value("k_" + std::to_string(j + 1)), log.k[j], 1e-9);
  columns.i = "current_";
  EXPECT_THAT(error_of([&] { parse_power_log(csv, "log.csv", columns); }), HasSubstr("current_1"));
}

TEST(PowerLog, ComputesSpeedsFromPositions) {
  Synthetic log;
  log.with_q = true;
  log.by_currents = false;
  std::string csv = log.text();
  csv.replace(csv.find("dq1,dq2,dq3"), 11, "x1,x2,x3");
  const PowerLog data = parse_power_log(csv, "log.csv");
  const PowerFit fit = fit_power(data, PowerModel::kMotion);
  EXPECT_NEAR(fit.value("c_1"), 6, 0.1);  // central differences at 50 Hz
  EXPECT_NEAR(fit.value("P_0"), 35, 0.1);
}

TEST(PowerLog, ComputesTorquesByTheInverseDynamicsOfARobot) {
  const robot::RobotModel planar = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  const robot::Mechanism mechanism(planar);
  robot::Data data(mechanism);
  std::string csv = "t,P,q1,q2,dq1,dq2,ddq1,ddq2\n";
  for (int k = 0; k < 400; ++k) {
    const double t = 0.01 * k, w = 2.3;
    const Eigen::Vector2d q(0.8 * std::sin(w * t), std::cos(1.7 * t)), dq(0.8 * w * std::cos(w * t), -1.7 * std::sin(1.7 * t)),
        ddq(-0.8 * w * w * std::sin(w * t), -1.7 * 1.7 * std::cos(1.7 * t));
    Eigen::VectorXd tau(2);
    inverse_dynamics(mechanism, data, q, dq, ddq, tau);
    csv += text::to_text(t) + "," + text::to_text(300 + tau.dot(dq) + 7 * std::abs(dq[0]) + 2 * dq[1] * dq[1]);
    for (const auto& x : {q, dq, ddq}) csv += "," + text::to_text(x[0]) + "," + text::to_text(x[1]);
    csv += "\n";
  }
  const PowerFit fit = fit_power(parse_power_log(csv, "log.csv", {}, &planar), PowerModel::kMotion);
  EXPECT_NEAR(fit.value("a"), 1, 1e-9);
  EXPECT_NEAR(fit.value("c_1"), 7, 1e-7);
  EXPECT_NEAR(fit.value("d_2"), 2, 1e-7);
  const robot::RobotModel lwr = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  EXPECT_THAT(error_of([&] { parse_power_log(csv, "log.csv", {}, &lwr); }), HasSubstr("has 2 joints, expected the 7"));
}

TEST(PowerLog, RefusesWrongUnitsOfMeasure) {
  const auto refused = [](const std::function<void(Synthetic&)>& change) {
    Synthetic log;
    log.by_currents = false;
    change(log);
    return error_of([&] { fit_power(log.log(), PowerModel::kMotion); });
  };
  EXPECT_EQ(refused([](Synthetic&) {}), "");
  EXPECT_THAT(refused([](Synthetic& l) { l.power_factor = 1e-3; }), HasSubstr("expected about 1: power in W"));
  EXPECT_THAT(refused([](Synthetic& l) { l.speed_factor = 57.2957795; }), HasSubstr("expected rad/s"));
  EXPECT_THAT(refused([](Synthetic& l) {
                l.speed_factor = 1 / 57.2957795;
                l.with_q = true;
              }),
              HasSubstr("degrees"));
  EXPECT_THAT(refused([](Synthetic& l) {
                l.time_factor = 1000;
                l.with_q = true;
              }),
              HasSubstr("milliseconds"));
  EXPECT_THAT(refused([](Synthetic& l) { l.power_factor = -1; }), HasSubstr("expected a robot that draws power"));
}

TEST(PowerLog, RefusesWhatItCannotUse) {
  const auto refused = [](const std::string& csv) { return error_of([&] { parse_power_log(csv, "log.csv"); }); };
  EXPECT_THAT(refused("t,dq1\n0,0\n"), HasSubstr("no column of power"));
  EXPECT_THAT(refused("t,P\n0,0\n"), HasSubstr("no column of speeds"));
  EXPECT_THAT(refused("P,dq1\n0,0\n"), HasSubstr("no column of time"));
  EXPECT_THAT(refused("t,P,dq1\n0,10,0\n1,11,0\n"), HasSubstr("2 usable rows"));
  EXPECT_THAT(refused("t,P,dq1,dq2,tau1\n0,10,0,0,0\n"), HasSubstr("1 columns of tau for 2 joints"));
  std::string constant = "t,P,dq1\n", back = constant;
  for (int k = 0; k < 20; ++k) {
    constant += std::to_string(k) + ",40,0.1\n";
    back += std::to_string(k == 15 ? 3 : k) + "," + std::to_string(40 + k) + ",0.1\n";
  }
  EXPECT_THAT(refused(constant), HasSubstr("40 W all the time"));
  EXPECT_THAT(refused(back), HasSubstr("log.csv:17"));
  Synthetic without;
  without.with_i = false;
  without.with_tau = false;
  EXPECT_THAT(error_of([&] { fit_power(without.log(), PowerModel::kCurrent); }), HasSubstr("no columns of currents"));
  EXPECT_THAT(error_of([&] { fit_power(without.log(), PowerModel::kMotion); }), HasSubstr("no columns of torques"));
  Synthetic still;
  still.motionless = {0, 1, 2};
  still.noise = 1;
  EXPECT_THAT(error_of([&] { leave_one_out(still.log(), PowerModel::kConstant); }), HasSubstr("no motions"));
}

// The floors that plain least squares gives, by ../shared/data/energy/fit_floor.py with the motion that the end of the log cuts off
// (../shared/facts/energy.md, section 1, leaves it out).
TEST(PowerFit, OfTheUr3eReachesTheFloorsInHeldOutMotions) {
  const std::filesystem::path file = places::public_data("energy/ur3e_rad_25hz.csv");
  if (!std::filesystem::exists(file))
    GTEST_SKIP() << "needs energy/ur3e_rad_25hz.csv, a log of ubc-systopia/dsn-2022-rad-artifact";
  const PowerLog log = read_power_log(file);
  EXPECT_EQ(log.joints(), 6u);
  struct Row {
    PowerModel model;
    double rmse[2], median[2], largest[2], part[2];  // W, %, %, %: leave one motion out, train before 18 s
  };
  constexpr FitOptions plain{.nonnegative = false};
  for (const Row& row : {Row{PowerModel::kConstant, {5.95, 5.62}, {6.57, 5.71}, {17.24, 13.53}, {56.4, 48.4}},
                         Row{PowerModel::kWork, {5.24, 4.74}, {7.27, 5.42}, {10.63, 8.24}, {51.4, 41.2}},
                         Row{PowerModel::kSpeed, {2.84, 2.82}, {2.91, 2.99}, {8.65, 7.92}, {28.1, 29.6}},
                         Row{PowerModel::kMotion, {1.90, 1.89}, {1.34, 1.53}, {4.39, 4.59}, {10.4, 11.8}},
                         Row{PowerModel::kCurrent, {1.74, 1.68}, {1.03, 1.10}, {2.88, 2.27}, {8.3, 7.6}}}) {
    const HeldOut found[2] = {leave_one_out(log, row.model, plain), train_before(log, row.model, 18, plain)};
    EXPECT_EQ(found[0].motions, 19u);
    EXPECT_EQ(found[1].motions, 10u);
    for (int k = 0; k < 2; ++k) {
      EXPECT_NEAR(found[k].rmse, row.rmse[k], 0.0051) << name_of(row.model);
      EXPECT_NEAR(100 * found[k].median, row.median[k], 0.0051) << name_of(row.model);
      EXPECT_NEAR(100 * found[k].largest, row.largest[k], 0.0051) << name_of(row.model);
      EXPECT_NEAR(100 * found[k].motion_part, row.part[k], 0.051) << name_of(row.model);
    }
  }
  // Losses that are not negative predict no worse than plain least squares.
  for (const PowerModel model : {PowerModel::kMotion, PowerModel::kCurrent}) {
    const std::pair<HeldOut, HeldOut> both[] = {{leave_one_out(log, model), leave_one_out(log, model, plain)},
                                                {train_before(log, model, 18), train_before(log, model, 18, plain)}};
    for (const auto& [found, floor] : both) {
      EXPECT_LT(found.median, floor.median + 1e-3) << name_of(model);
      EXPECT_LT(found.motion_part, floor.motion_part + 1e-3) << name_of(model);
    }
  }
}

}  // namespace
}  // namespace cotwin::energetics::power_fit_test
