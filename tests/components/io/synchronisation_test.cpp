// PD synchronisation of robot and twin (V-D): components/io/links/synchronisation.h.
#include "components/io/links/synchronisation.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "components/io/links/gain_check.h"
#include "tests/components/io/ports.h"
#include "tests/support/error_of.h"

namespace cotwin::io::synchronisation_test {
namespace {

/// Largest magnitude of the zeros of c[0] zⁿ + … + c[n], as eigenvalues of the companion matrix.
double spectral_radius(const std::vector<double>& c) {
  const auto n = static_cast<Eigen::Index>(c.size()) - 1;
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) companion(0, i) = -c[static_cast<std::size_t>(i) + 1] / c[0];
  for (Eigen::Index i = 1; i < n; ++i) companion(i, i - 1) = 1;
  return companion.eigenvalues().cwiseAbs().maxCoeff();
}

/// Whether robot and twin stay together: a robot that follows with q_r(k+1) = q_r(k) + a (q_cmd(k − delay) − q_r(k)) has the
/// characteristic polynomial z^(3+delay) − (1 − a) z^(2+delay) + a (K_P + K_D/h) z − a K_D/h.
double spectral_radius_of_loop(double a, double K_P, double K_D_over_h, std::size_t delay = 0) {
  std::vector<double> c(4 + delay);
  c[0] = 1;
  c[1] = a - 1;
  c[2 + delay] += a * (K_P + K_D_over_h);
  c[3 + delay] = -a * K_D_over_h;
  return spectral_radius(c);
}

/// A robot of one joint that moves by a share `a` of the distance to its command in each cycle, and its twin.
struct Pair {
  explicit Pair(double share, std::size_t delay = 0) : a(share), commands(delay + 1) {}

  double a = 1, q_r = 0;
  std::deque<double> commands;
  Synchronisation synchronisation{1};
  std::array<double, 1> K_P{}, K_D{}, dq_max{std::numeric_limits<double>::infinity()};
  double h = 0.002, ddq_max = std::numeric_limits<double>::infinity();

  Synchronisation::Gains gains() const { return {K_P, K_D, dq_max, ddq_max}; }
  void start(double q) {
    synchronisation.start(std::array{q});
    q_r = q;
    std::ranges::fill(commands, q);
  }
  /// One cycle: command, then the measurement of the same cycle, then the robot moves.
  double cycle(double q_v) {
    const double q_cmd = synchronisation.command(std::array{q_v}, gains(), h)[0];
    synchronisation.measure(std::array{q_v}, std::array{q_r}, gains(), h);
    commands.push_back(q_cmd);
    commands.pop_front();
    q_r += a * (commands.front() - q_r);
    return q_cmd;
  }
};

TEST(Synchronisation, ALateMeasurementChangesNothing) {
  const std::array K_P{0.5}, K_D{0.1}, dq_max{1e9};
  const Synchronisation::Gains gains{K_P, K_D, dq_max, 1e9};
  Synchronisation s(1);
  s.start(std::array{0.0});
  s.measure(std::array{1.0}, std::array{0.9}, gains, 0.01);
  s.measure(std::array{1.0}, std::array{0.8}, gains, 0.01);
  const double correction = 0.5 * 0.2 + 0.1 * (0.2 - 0.1) / 0.01;
  EXPECT_NEAR(s.correction()[0], correction, 1e-12);
  s.measure(std::array{1.0}, std::array{0.95}, gains, 0);
  EXPECT_NEAR(s.correction()[0], correction, 1e-12);
}

TEST(Synchronisation, StabilityRegionIsThatOfTheSimulatedLoop) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<> unit(0, 1);
  int stable = 0, decided = 0;
  for (int k = 0; k < 1500; ++k) {
    const auto delay = static_cast<std::size_t>(random() % 5);
    Pair pair(0.02 + 1.4 * unit(random), delay);
    pair.K_P[0] = 4 * unit(random) - 0.5;
    pair.K_D[0] = (2 * unit(random) - 0.5) * pair.h;
    const double radius = spectral_radius_of_loop(pair.a, pair.K_P[0], pair.K_D[0] / pair.h, delay);
    if (std::abs(radius - 1) < 0.01) continue;  // too slow to tell in 2000 cycles
    ++decided;
    pair.start(0);
    double early = 0, late = 0;
    for (int i = 0; i < 2000 && late < 1e100; ++i) {
      pair.cycle(i == 0 ? 0.1 : 0);
      if (i < 200) early = std::max(early, std::abs(pair.q_r));
      if (i >= 1900 || std::abs(pair.q_r) > 1e100) late = std::max(late, std::abs(pair.q_r));
    }
    const bool expected = radius < 1;
    ASSERT_EQ(late < 1e-3 * early, expected)
        << "draw " << k << ": a " << pair.a << ", K_P " << pair.K_P[0] << ", delay " << delay;
    if (expected) ++stable;
  }
  EXPECT_GT(stable, decided / 10);
  EXPECT_LT(stable, 9 * decided / 10);
}

TEST(Synchronisation, WithProportionalGainIsStableBelowTheInverseOfTheRobotsShare) {
  // K_D = 0: z² − (1 − a) z + a K_P has both zeros inside for a K_P < 1 (its product) and, with K_P > −1, for 0 < a < 2.
  for (const double a : {0.05, 0.3, 1.0}) {
    EXPECT_LT(spectral_radius_of_loop(a, 0.999 / a, 0), 1);
    EXPECT_GT(spectral_radius_of_loop(a, 1.001 / a, 0), 1);
    EXPECT_LT(spectral_radius_of_loop(a, -0.999, 0), 1);
    EXPECT_GT(spectral_radius_of_loop(a, -1.001, 0), 1);
  }
}

TEST(Synchronisation, DividesTheLagInASteadyMotionByOnePlusTheGain) {
  // q_r advances by v h = a (q_cmd − q_r), and q_cmd − q_r = e(k) + K_P e(k − 1); K_D has no share because e is constant.
  for (const double K_P : {0.0, 1.0, 3.0}) {
    Pair pair(0.2);
    pair.K_P[0] = K_P;
    pair.K_D[0] = 0.3 * pair.h;
    pair.start(0);
    const double v = 0.4;
    for (int k = 0; k < 2000; ++k) pair.cycle(v * k * pair.h);
    EXPECT_NEAR(pair.synchronisation.discrepancy()[0], v * pair.h / (0.2 * (1 + K_P)), 1e-12) << K_P;
  }
}

TEST(Synchronisation, KeepsItsSpeedLimitThroughValuesThatAreNotFinite) {
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, infinity, -infinity}) {
    Pair pair(1.0);
    pair.K_P[0] = 0.5;
    pair.dq_max[0] = 0.25;
    pair.start(0);
    double before = 0;
    for (int k = 0; k < 400; ++k) {
      const double q_cmd = pair.cycle(k % 8 == 3 ? bad : 0.5);
      ASSERT_TRUE(std::isfinite(q_cmd));
      ASSERT_LE(std::abs(q_cmd - before), 0.25 * pair.h * (1 + 1e-12)) << k;
      before = q_cmd;
    }
    pair.synchronisation.measure(std::array{0.5}, std::array{nan}, pair.gains(), pair.h);
    EXPECT_NEAR(pair.cycle(0.5), before + 0.25 * pair.h, 1e-12);
  }
}

TEST(Synchronisation, ApproachesATwinThatIsElsewhereSoftlyWithinItsLimitsAndWithoutOvershoot) {
  for (const double ddq_max : {1.0, 20.0, 300.0}) {
    Pair pair(1.0);
    pair.dq_max[0] = 0.25;
    pair.ddq_max = ddq_max;
    pair.start(-0.1);
    double before = -0.1, dq = 0, fastest = 0;
    for (int k = 0; k < 1500; ++k) {
      const double q_cmd = pair.cycle(0.1), speed = (q_cmd - before) / pair.h;
      const double share = std::min((k + 1) * pair.h / Synchronisation::kSoftStart, 1.0);
      ASSERT_LE(speed, 0.25 * share * (1 + 1e-9)) << k;
      ASSERT_LE(std::abs(speed - dq), ddq_max * pair.h * (1 + 1e-6) + 1e-9) << k;
      ASSERT_LE(q_cmd - 0.1, ddq_max * pair.h * pair.h / 8 + 1e-12) << k;
      fastest = std::max(fastest, speed);
      before = q_cmd;
      dq = speed;
    }
    EXPECT_NEAR(fastest, 0.25, 1e-9);
    EXPECT_NEAR(pair.q_r, 0.1, 1e-9);
  }
}

TEST(Synchronisation, FollowsATwinThatMovesWithinItsLimitsWithoutDelay) {
  Pair pair(1.0);
  pair.dq_max[0] = 2;
  pair.ddq_max = 20;
  pair.start(0);
  for (int k = 0; k < 3000; ++k) {
    const double q_v = 0.5 * (1 - std::cos(3 * k * pair.h));  // 1.5 rad/s, 4.5 rad/s²
    const double q_cmd = pair.cycle(q_v);
    if (k > 400) {
      ASSERT_NEAR(q_cmd, q_v, 1e-12) << k;
    }
  }
}

TEST(Synchronisation, ComesToRestWithItsAcceleration) {
  Pair pair(1.0);
  pair.dq_max[0] = 1;
  pair.ddq_max = 10;
  pair.start(0);
  for (int k = 0; k < 1000; ++k) pair.cycle(0.4 * k * pair.h);
  const double from = pair.synchronisation.last()[0];
  for (int k = 0; k < 100; ++k) pair.synchronisation.rest(pair.gains(), pair.h);
  EXPECT_NEAR(pair.synchronisation.last()[0], from + 0.4 * 0.4 / 20, 0.4 * pair.h);  // v²/2a
  EXPECT_EQ(pair.synchronisation.share(), 0) << "what follows begins softly";
}

/// The check of a link with these parameters at 1 ms; its message, or nothing.
std::string refusal(const std::map<std::string, std::string>& parameters, double K_P, double K_D = 0) {
  GainCheck check(150);
  Variables v;
  check.declare(v);
  for (const auto& [name, value] : parameters) assign_text(v.at(name), value);
  const std::array gains_P{0.0, K_P}, gains_D{0.0, K_D};
  return testing::error_of([&] { check.check(gains_P, gains_D, std::array{0.001}, 2, "place"); });
}

TEST(GainCheck, RefusesGainsWithWhichRobotHandAndTwinVibrate) {
  using ::testing::HasSubstr;
  const std::map<std::string, std::string> guided{{"guided_M", "4"}, {"guided_D", "30"}}, alone{{"guided_M", "0"}};
  EXPECT_EQ(refusal({}, 0), "") << "the default needs nothing";
  EXPECT_THAT(refusal({}, 0.05), ::testing::AllOf(HasSubstr("guided_M is not given"), HasSubstr("place: K_P, K_D")));
  EXPECT_THAT(refusal(guided, 0.5), ::testing::AllOf(HasSubstr("of joint 2"), HasSubstr("expected K_P at most 0")));
  EXPECT_THAT(refusal(alone, 0.5), HasSubstr("expected K_P at most 0.1"));
  EXPECT_EQ(refusal(alone, 0.09), "");
  EXPECT_NE(refusal(alone, 0, 0.1), "") << "K_D alone";
  EXPECT_NE(refusal(alone, 0.05, -0.01), "");
  // A rigid robot allows more, and less with a delay.
  std::map<std::string, std::string> rigid = guided;
  rigid["robot_resonance"] = "0";
  EXPECT_EQ(refusal(rigid, 0.5), "");
  EXPECT_NE(refusal(rigid, 5), "");
  rigid["guided_M"] = "0.3";
  EXPECT_NE(refusal(rigid, 0.5), "") << "a light twin";
}

TEST(GainCheck, AllowsWhatItSaysThatIsAllowed) {
  for (const std::string M : {"0", "20"}) {
    const std::map<std::string, std::string> parameters{{"guided_M", M}, {"guided_D", "60"}};
    const std::string message = refusal(parameters, 8);
    const std::string words = "expected K_P at most ";
    const double most = std::stod(message.substr(message.find(words) + words.size()));
    EXPECT_GT(most, 0.01) << message;
    EXPECT_EQ(refusal(parameters, most), "") << M;
    EXPECT_NE(refusal(parameters, 1.05 * most + 2e-3), "") << M;
  }
}

TEST(GainCheck, IsMadeBeforeTheRun) {
  using ::testing::HasSubstr;
  for (const std::string query : {"robot=lwr4&link=fri&protocol=lwr", "robot=ur5e&link=rtde"}) {
    Ports link(query);
    link.set("K_P", "5");
    if (query.find("fri") != std::string::npos) link.set("port", "0");
    EXPECT_EQ(testing::error_of([&] { link.instance.unit->initialise(Time{}); }), "") << "a monitor";
    link.set("mode", "position");
    EXPECT_THAT(testing::error_of([&] { link.instance.unit->initialise(Time{}); }), HasSubstr("guided_M is not given"));
    link.set("guided_M", "0");
    EXPECT_THAT(testing::error_of([&] { link.instance.unit->initialise(Time{}); }), HasSubstr("expected K_P at most "));
    link.set("K_P", "0.05");
    EXPECT_EQ(testing::error_of([&] { link.instance.unit->initialise(Time{}); }), "");
  }
}

/// Commands and measurements of a moving pair get lost, in bursts of at most `burst`, and come up to a cycle late.
struct Disturbed {
  double loss = 0;
  int burst = 1;
  bool jitter = false;
  std::size_t delay = 0;  // cycles of the commands
};

class SynchronisationOverALossyLink : public ::testing::TestWithParam<Disturbed> {};

TEST_P(SynchronisationOverALossyLink, StaysNearTheTwinWithoutAJump) {
  const Disturbed& link = GetParam();
  constexpr double kAmplitude = 0.3, kRate = 3.14, kSpeed = kAmplitude * kRate, kMax = 1.5;
  double rms_plain = 0;
  for (const double K_P : {0.0, 1.0}) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<> unit(0, 1);
    Pair pair(0.2, link.delay);
    pair.K_P[0] = K_P;
    pair.K_D[0] = 0.2 * pair.h * K_P;
    pair.dq_max[0] = kMax;
    pair.start(0);
    int command_lost = 0, measurement_lost = 0, since = 0;
    double robot_command = 0, robot_speed = 0, sent = 0, late_q_r = 0, worst = 0, sum = 0;
    const auto lost = [&](int& left) {
      if (left == 0 && unit(random) < link.loss / link.burst) left = link.burst;
      return left > 0 && left-- > 0;
    };
    constexpr int kCycles = 20'000;
    for (int k = 0; k < kCycles; ++k) {
      const double q_v = kAmplitude * std::sin(kRate * k * pair.h);
      const double q_cmd = pair.synchronisation.command(std::array{q_v}, pair.gains(), pair.h)[0];
      ASSERT_LE(std::abs(q_cmd - sent), kMax * pair.h * (1 + 1e-12)) << "cycle " << k;
      ++since;
      if (!lost(measurement_lost)) {
        const double q_r = link.jitter && unit(random) < 0.5 ? late_q_r : pair.q_r;
        pair.synchronisation.measure(std::array{q_v}, std::array{q_r}, pair.gains(), since * pair.h);
        since = 0;
      }
      late_q_r = pair.q_r;
      // The robot's controller goes on with the last speed if a command is lost.
      if (lost(command_lost)) {
        robot_command += robot_speed * pair.h;
      } else {
        robot_speed = std::clamp((q_cmd - robot_command) / pair.h, -kMax, kMax);
        robot_command += robot_speed * pair.h;
      }
      sent = q_cmd;
      pair.commands.push_back(robot_command);
      pair.commands.pop_front();
      pair.q_r += pair.a * (pair.commands.front() - pair.q_r);
      if (k > 500) {
        worst = std::max(worst, std::abs(q_v - pair.q_r));
        sum += (q_v - pair.q_r) * (q_v - pair.q_r);
      }
    }
    const double rms = std::sqrt(sum / kCycles);
    const double cycles = 1 / 0.2 + static_cast<double>(link.delay);
    const double lag = kSpeed * pair.h * cycles / (1 + K_P);  // of a steady motion without losses
    // A command that is extrapolated over a burst is wrong by at most (speed + v_max) · burst · h, until the delay is over.
    const double wrong = link.loss > 0 ? link.burst + static_cast<double>(link.delay) : 0;  // cycles
    const double bound = lag + (kSpeed + kMax) * wrong * pair.h + (link.jitter ? kSpeed * pair.h : 0);
    EXPECT_LT(worst, 1.05 * bound);
    EXPECT_LT(rms, 1.1 * lag) << "worst " << worst;
    EXPECT_GT(worst, 0.5 * lag);
    if (K_P == 0) rms_plain = rms;
    if (K_P == 1) {
      EXPECT_LT(rms, 0.65 * rms_plain) << "the gain still halves the discrepancy";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Links, SynchronisationOverALossyLink,
                         ::testing::Values(Disturbed{}, Disturbed{0.05, 1, false}, Disturbed{0.2, 1, false},
                                           Disturbed{0.2, 1, true}, Disturbed{0.2, 5, false}, Disturbed{0.2, 5, true},
                                           Disturbed{0, 1, true}, Disturbed{0, 1, false, 4}, Disturbed{0.2, 5, true, 2}),
                         [](const auto& link) {
                           return "Loss" + std::to_string(static_cast<int>(100 * link.param.loss)) + "Burst" +
                                  std::to_string(link.param.burst) + (link.param.jitter ? "Jitter" : "") +
                                  (link.param.delay > 0 ? "Delay" + std::to_string(link.param.delay) : "");
                         });

}  // namespace
}  // namespace cotwin::io::synchronisation_test
