// Logs of robots: errors in them, their power spectrum, and smoothing in blocks.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include "models/foundation/support/error.h"
#include "models/identification/measurement/smoothing.h"
#include "models/identification/measurement/spectrum.h"
#include "models/identification/measurement/survey.h"
#include "models/numerics/random.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"
#include "tests/support/synthetic_log.h"

namespace cotwin::measurement::measurement_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::SyntheticLog;
using cotwin::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

robot::RobotModel lwr4() { return robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf"); }

class LogSurvey : public ::testing::Test {
 protected:
  Log log() const { return {{folder_ / "log.csv"}, {}}; }
  void write(const std::function<void(std::size_t, std::vector<double>&)>& spoil = {}) {
    synthetic_.write(folder_ / "log.csv", robot_, spoil);
  }
  std::string error(const Log& log) const {
    return error_of([&] { survey(log, robot_); });
  }
  std::string error() const { return error(log()); }
  static constexpr std::size_t kTau = 8;  // column of the first torque

  TemporaryFolder folder_{"survey"};
  robot::RobotModel robot_ = lwr4();
  SyntheticLog synthetic_;
};

TEST_F(LogSurvey, OfACleanLogReportsRateRangeAndGravityWithoutWarnings) {
  write();
  const Survey result = survey(log(), robot_);
  EXPECT_THAT(result.warnings, IsEmpty());
  EXPECT_EQ(result.samples, 4001u);
  EXPECT_NEAR(result.rate(), 200, 1e-6);
  ASSERT_EQ(result.segments.size(), 1u);
  EXPECT_NEAR(result.segments[0].duration, 20, 1e-9);
  EXPECT_GT(result.joints[1].gravity_correlation, 0.9);  // the shoulder carries the arm
  EXPECT_EQ(result.joints[2].tau_column, "tau3");
}

TEST_F(LogSurvey, NotANumberIsAnErrorThatNamesLineAndColumn) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row == 99) cells[kTau + 2] = std::nan("");
  });
  EXPECT_THAT(error(), AllOf(HasSubstr("log.csv:101: column 'tau3'"), HasSubstr("expected a finite number")));
}

TEST_F(LogSurvey, TimeThatRunsBackwardsIsAnErrorThatNamesBothLines) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row == 50) cells[0] -= 0.1;
  });
  EXPECT_THAT(error(), AllOf(HasSubstr("log.csv:52: column 't'"), HasSubstr("before the time on line 51"),
                             HasSubstr("expected increasing time")));
}

TEST_F(LogSurvey, FewBadRowsAreLeftOutAndCounted) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row == 50) cells[0] -= 0.1;  // out of order
    if (row == 99) cells[kTau + 2] = std::nan("");
    if (row == 700) cells[3] += 1;  // alone far away
  });
  std::ofstream(folder_ / "log.csv", std::ios::app) << "20.005,0.1,0.";  // half written
  Log lenient = log();
  lenient.skip = 0.01;
  const Survey result = survey(lenient, robot_);
  EXPECT_EQ(result.samples, 3998u);
  EXPECT_THAT(result.warnings,
              Contains(AllOf(HasSubstr("4 rows are left out (--skip-rows)"), HasSubstr("log.csv:52: column 't'"))));
  // The smoothing leaves out the same rows: the motion is the one without damage.
  const std::vector<trajectory::Axis> axes = trajectory::axes_of(robot_);
  const Smoothing smoothing{.step = result.step, .cutoff = 5};
  SmoothedLog smoothed(lenient, axes, smoothing, result.gap);
  std::size_t measured = 0;
  while (const Block* block = smoothed.next())
    for (std::size_t k = 0; k < block->count; ++k) {
      measured += block->measured[k] ? 1 : 0;
      EXPECT_NEAR(block->q[k * 7 + 2], synthetic_.motion(2, block->t[k])[0], 1e-3);
    }
  EXPECT_GT(measured, 3500u);
}

TEST_F(LogSurvey, ManyBadRowsAreAnErrorThatNamesTheFirst) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row % 50 == 49) cells[kTau + 2] = std::nan("");
  });
  Log lenient = log();
  lenient.skip = 0.01;
  EXPECT_THAT(error(lenient),
              AllOf(HasSubstr("log.csv:51: column 'tau3'"), HasSubstr("80 of 4001 rows are like this, expected at most 1 %"),
                    HasSubstr("--skip-rows")));
  lenient.skip = 0.03;
  EXPECT_EQ(survey(lenient, robot_).samples, 3921u);
}

TEST_F(LogSurvey, AJumpThatStaysIsNoOutlier) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row >= 2000) cells[3] += 0.5;
  });
  Log lenient = log();
  lenient.skip = 0.01;
  EXPECT_THAT(error(lenient), AllOf(HasSubstr("log.csv:2002: column 'q3'"), HasSubstr("would have moved with")));
}

TEST_F(LogSurvey, WrappedPositionsAreNamed) {
  write([](std::size_t, std::vector<double>& cells) { cells[1] = std::remainder(8 * cells[1], 2 * std::numbers::pi); });
  robot_.joints[0].q_max = std::numbers::pi;
  robot_.joints[0].q_min = -robot_.joints[0].q_max;
  EXPECT_THAT(error(), AllOf(HasSubstr("column 'q1'"), HasSubstr("nearly a whole turn: positions are wrapped")));
}

TEST_F(LogSurvey, TorquesThatAreCutOffOrStandStillAreDamage) {
  write();
  EXPECT_THAT(survey(log(), robot_).damage, IsEmpty());
  write([](std::size_t, std::vector<double>& cells) { cells[kTau + 1] = std::min(cells[kTau + 1], 12.0); });
  EXPECT_THAT(survey(log(), robot_).damage,
              ElementsAre(AllOf(HasSubstr("column 'tau2': is 12 N.m in "), HasSubstr("are torques cut off there?"))));
  write([](std::size_t row, std::vector<double>& cells) {
    static double kept = 0;
    if (row == 1000) kept = cells[kTau + 3];
    if (row >= 1000 && row < 1400) cells[kTau + 3] = kept;
  });
  EXPECT_THAT(survey(log(), robot_).damage,
              ElementsAre(AllOf(HasSubstr("column 'tau4': stood still for 1."), HasSubstr("while joint_4 moved by"))));
}

TEST_F(LogSurvey, TorquesOfLowResolutionAndOfARobotAtRestAreNoDamage) {
  synthetic_.noise = 1e-9;
  for (const double resolution : {0.1, 1.0}) {
    write([&](std::size_t, std::vector<double>& cells) {
      for (std::size_t j = 0; j < 7; ++j) cells[kTau + j] = resolution * std::round(cells[kTau + j] / resolution);
    });
    EXPECT_THAT(survey(log(), robot_).damage, IsEmpty()) << resolution;
  }
  std::vector<double> last;
  write([&](std::size_t row, std::vector<double>& cells) {
    if (row == 3000) last = cells;
    if (row > 3000) std::copy(last.begin() + 1, last.end(), cells.begin() + 1);
  });
  EXPECT_THAT(survey(log(), robot_).damage, IsEmpty());
}

TEST_F(LogSurvey, AGapIsAWarningAndCutsTheLogIntoSegments) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row >= 1000) cells[0] += 2;
  });
  const Survey result = survey(log(), robot_);
  EXPECT_EQ(result.segments.size(), 2u);
  EXPECT_EQ(result.segments[0].samples, 1000u);
  EXPECT_THAT(result.warnings,
              Contains(AllOf(HasSubstr("log.csv:1002"), HasSubstr("a gap of 2.005 s"), HasSubstr("expected at most 1 s"))));
}

TEST_F(LogSurvey, MissingRowsAreReportedAndDoNotDivideTheLog) {
  write([](std::size_t row, std::vector<double>& cells) {
    if (row >= 1000) cells[0] += 0.5;
  });
  const Survey result = survey(log(), robot_);
  EXPECT_EQ(result.segments.size(), 1u);
  EXPECT_THAT(result.warnings, Contains(AllOf(HasSubstr("100 at 200 Hz"), HasSubstr("rows are missing"))));
}

TEST(TypicalStep, IsTheSamplingStepAlsoWhereRowsAreLostAndStampsJitter) {
  std::vector<double> all, half, jittered, bunched;
  for (int k = 0; k < 2000; ++k) {
    const double t = 0.008 * k, u = numerics::uniform(numerics::Key{1, 0, static_cast<std::uint32_t>(k), 0, 0});
    all.push_back(t);
    if (u < 0.4) half.push_back(t);
    jittered.push_back(t + 0.006 * (u - 0.5));
    bunched.push_back(0.008 * (k - k % 5) + 1e-4 * (k % 5));
  }
  EXPECT_EQ(typical_step(all), trajectory::median_step(all));
  EXPECT_NEAR(typical_step(half), 0.008, 1e-5);
  EXPECT_NEAR(typical_step(jittered), 0.008, 4e-4);
  EXPECT_NEAR(typical_step(bunched), 0.008, 4e-4);
}

TEST_F(LogSurvey, AnotherNumberOfJointsIsAnErrorThatNamesTheFile) {
  const robot::RobotModel two = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  SyntheticLog().write(folder_ / "log.csv", two);
  EXPECT_THAT(error(), AllOf(HasSubstr("log.csv"), HasSubstr("7"), HasSubstr("expected")));
}

TEST_F(LogSurvey, DegreesReadAsRadiansAreAnError) {
  write([](std::size_t, std::vector<double>& cells) {
    for (std::size_t j = 1; j <= 7; ++j) cells[j] *= 180 / std::numbers::pi;
  });
  EXPECT_THAT(error(), AllOf(HasSubstr("column 'q"), HasSubstr("are these degrees? Then --angle-unit deg")));
  Log in_degrees = log();
  in_degrees.format.angle_unit = std::numbers::pi / 180;
  EXPECT_THAT(survey(in_degrees, robot_).warnings, IsEmpty());
}

TEST_F(LogSurvey, MillisecondsReadAsSecondsAreAnError) {
  write([](std::size_t, std::vector<double>& cells) { cells[0] *= 1000; });
  EXPECT_THAT(error(), AllOf(HasSubstr("median step is 5 s"), HasSubstr("milliseconds? Then --time-unit ms")));
  write([](std::size_t, std::vector<double>& cells) { cells[0] *= 1e6; });
  EXPECT_THAT(error(), HasSubstr("microseconds? Then --time-unit us"));
  write([](std::size_t, std::vector<double>& cells) { cells[0] *= 1e9; });
  EXPECT_THAT(error(), HasSubstr("nanoseconds? Then --time-unit ns"));
  Log slow = log();
  slow.format.rate = 1e-3;
  EXPECT_THAT(error_of([&] { survey(slow, robot_, {.accept = true}); }), HasSubstr("--rate: 0.001 Hz, expected at least 2 Hz"));
  write([](std::size_t, std::vector<double>& cells) { cells[0] *= 1000; });
  Log in_ms = log();
  in_ms.format.t_unit = 1e-3;
  EXPECT_NEAR(survey(in_ms, robot_).rate(), 200, 1e-6);
}

TEST_F(LogSurvey, SecondsReadAsMillisecondsMoveTooFast) {
  write();
  Log wrong = log();
  wrong.format.t_unit = 1e-3;
  EXPECT_THAT(error(wrong), AllOf(HasSubstr("would have moved with"), HasSubstr("--time-unit")));
}

TEST_F(LogSurvey, APassiveJointNeedsNoTorque) {
  robot::RobotModel robot = robot_;
  robot.joints[4].passive = true;
  write([](std::size_t, std::vector<double>& cells) { cells[kTau + 4] = 0; });
  EXPECT_THAT(survey(log(), robot).warnings, IsEmpty());
  write([](std::size_t, std::vector<double>& cells) { cells[kTau + 4] = -cells[kTau + 4]; });
  EXPECT_THAT(survey(log(), robot).warnings, Contains(HasSubstr("column 'tau5': is not 0, but")));
}

TEST_F(LogSurvey, ATorqueThatNeverChangesIsAnErrorThatNamesItsColumn) {
  write([](std::size_t, std::vector<double>& cells) { cells[kTau + 4] = 3; });
  EXPECT_THAT(error(), AllOf(HasSubstr("column 'tau5'"), HasSubstr("is 3 in every row"),
                             HasSubstr("expected the measured torque of joint_5")));
}

TEST_F(LogSurvey, AJointThatStandsStillIsAWarning) {
  write([](std::size_t, std::vector<double>& cells) { cells[4] = 0.5; });
  EXPECT_THAT(survey(log(), robot_).warnings, Contains(AllOf(HasSubstr("column 'q4'"), HasSubstr("joint_4 moves by 0 rad"))));
}

TEST_F(LogSurvey, ALogWithoutMotionIsAnError) {
  write([](std::size_t, std::vector<double>& cells) { std::fill(cells.begin() + 1, cells.begin() + 8, 0.5); });
  EXPECT_THAT(error(), HasSubstr("no joint moves"));
}

TEST_F(LogSurvey, TorquesAgainstGravityAreAnErrorUnlessAccepted) {
  write([](std::size_t, std::vector<double>& cells) { cells[kTau + 1] *= -1; });
  EXPECT_THAT(error(), AllOf(HasSubstr("column 'tau2'"), HasSubstr("goes against the URDF's gravity"),
                             HasSubstr("--tau-scale 1,-1,1,1,1,1,1")));
  const Survey accepted = survey(log(), robot_, {.accept = true});
  EXPECT_THAT(accepted.warnings, Contains(HasSubstr("goes against the URDF's gravity")));
  EXPECT_LT(accepted.joints[1].gravity_correlation, -0.9);
}

TEST_F(LogSurvey, TorquesOfTheMotorsAreAnErrorThatNamesTheGearRatio) {
  write([](std::size_t, std::vector<double>& cells) { cells[kTau + 1] /= 160; });
  EXPECT_THAT(error(), AllOf(HasSubstr("column 'tau2'"),
                             HasSubstr("are these the motor's? Then --tau-scale with the gear ratio (about 1")));
  Log scaled = log();
  scaled.format.tau_scale = {1, 160, 1, 1, 1, 1, 1};
  EXPECT_THAT(survey(scaled, robot_).warnings, IsEmpty());
}

TEST_F(LogSurvey, PositionsAndTorquesBeyondTheLimitsAreWarningsThatNameTheRow) {
  robot_.joints[1].q_max = 0.5;
  robot_.joints[1].q_min = -0.5;
  robot_.joints[3].tau_max = 2;
  write();
  EXPECT_THAT(survey(log(), robot_).warnings,
              AllOf(Contains(AllOf(HasSubstr("column 'q2'"), HasSubstr("expected -0.5 to 0.5 rad (limits of the URDF)"))),
                    Contains(AllOf(HasSubstr("column 'tau4'"), HasSubstr("expected at most 2 N.m")))));
}

TEST_F(LogSurvey, VelocitiesThatAreNotThoseOfThePositionsAreWarnings) {
  std::ofstream(folder_ / "log.csv") << [&] {
    std::ostringstream text;
    text << "t,q1,q2,dq1,dq2,tau1,tau2\n";
    for (int k = 0; k < 500; ++k) {
      const double t = k * 0.01, s = std::sin(t), c = std::cos(t);
      text << t << ',' << s << ',' << 0.5 * s << ',' << 57.3 * c << ',' << -0.5 * c << ',' << s + 0.01 * k << ',' << c << '\n';
    }
    return text.str();
  }();
  const robot::RobotModel two = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  const std::vector<std::string> warnings = survey(log(), two, {.accept = true}).warnings;
  EXPECT_THAT(warnings, Contains(AllOf(HasSubstr("is 57"), HasSubstr("times the derivative of column 'q1'"))));
  EXPECT_THAT(warnings, Contains(HasSubstr("is not the derivative of column 'q2' (correlation -1)")));
}

TEST_F(LogSurvey, VelocitiesAreComparedOverLongerThanTheResolutionOfTheEncoder) {
  std::ofstream out(folder_ / "log.csv");
  out << "t,q1,q2,dq1,dq2,tau1,tau2\n";
  for (int k = 0; k < 5000; ++k) {
    const double t = k * 1e-3, s = std::sin(t), c = std::cos(t);
    out << t << ',' << 2e-3 * std::round(s / 2e-3) << ',' << 2e-3 * std::round(s / 4e-3) << ',' << c << ',' << 0.5 * c << ','
        << s + 0.01 * k << ',' << c << '\n';
  }
  out.close();
  const robot::RobotModel two = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  for (const std::string& warning : survey(log(), two, {.accept = true}).warnings)
    EXPECT_THAT(warning, Not(HasSubstr("derivative"))) << warning;
}

TEST_F(LogSurvey, VelocitiesOfAnotherClockAreDamage) {
  const robot::RobotModel two = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  for (const double rate : {0.5, 1.0, 2.0}) {
    std::ofstream out(folder_ / "log.csv");
    out << "t,q1,q2,dq1,dq2,tau1,tau2\n";
    for (int k = 0; k < 500; ++k) {
      const double t = k * 0.01, s = std::sin(t), c = std::cos(t);
      out << rate * t << ',' << s << ',' << 0.5 * s << ',' << c << ',' << 0.5 * c << ',' << s + 0.01 * k << ',' << c << '\n';
    }
    out.close();
    const Survey result = survey(log(), two, {.accept = true});
    if (rate == 1)
      EXPECT_THAT(result.damage, IsEmpty());
    else
      EXPECT_THAT(result.damage,
                  ElementsAre(HasSubstr("velocities of all joints are " + std::string(rate == 2 ? "2" : "0.5"))));
  }
}

TEST_F(LogSurvey, AMissingColumnListsThoseThatThereAre) {
  std::ofstream(folder_ / "log.csv") << "t,q1,q2,q3,q4,q5,q6,q7,load1,load2\n";
  EXPECT_THAT(error(), AllOf(HasSubstr("has no columns of measured torques"), HasSubstr("'load{}'")));
  std::ofstream(folder_ / "log.csv") << "stamp,q1,q2\n0,0,0\n";
  EXPECT_THAT(error(), AllOf(HasSubstr("has no column 't', 'time' or 'timestamp'"), HasSubstr("'q{}'")));
  std::ofstream(folder_ / "log.csv") << "timestamp actual_q_0 actual_q_1\n0 0 0\n";
  EXPECT_THAT(error(), HasSubstr("whose name has blanks, expected a comma, semicolon or tab"));
}

TEST_F(LogSurvey, LogsOfDifferentRatesAreAnError) {
  write();
  SyntheticLog other;
  other.rate = 100;
  other.write(folder_ / "other.csv", robot_);
  Log both = log();
  both.files.push_back(folder_ / "other.csv");
  EXPECT_THAT(error(both), AllOf(HasSubstr("other.csv"), HasSubstr("is sampled every 0.01 s, expected 0.005 s")));
}

TEST(MotionSpectrum, TransformIsThatOfItsDefinition) {
  std::vector<std::complex<double>> x(16), X(16);
  for (std::size_t i = 0; i < 16; ++i)
    x[i] = {std::sin(1.0 + static_cast<double>(i * i)), std::cos(3.0 * static_cast<double>(i))};
  for (std::size_t k = 0; k < 16; ++k)
    for (std::size_t i = 0; i < 16; ++i)
      X[k] += x[i] * std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(i * k) / 16);
  fourier_transform(x);
  for (std::size_t k = 0; k < 16; ++k) EXPECT_LT(std::abs(x[k] - X[k]), 1e-13) << k;
}

TEST(MotionSpectrum, FindsTheFrequencyOfASineAtAnyRate) {
  for (const double rate : {30.0, 125.0, 1000.0}) {
    MotionSpectrum spectrum(2, rate);
    for (int k = 0; k < 60 * static_cast<int>(rate); ++k) {
      const double t = k / rate, q[] = {std::sin(2 * std::numbers::pi * 0.8 * t), 0.5};
      spectrum.add(q, k == 0);
    }
    const std::vector<double> frequency = spectrum.frequency_of_share(0.95);
    EXPECT_NEAR(frequency[0], 0.8, 0.05) << rate;  // the Hann window spreads a line over two bins of 1/60 s
    EXPECT_EQ(frequency[1], 0) << rate;
  }
}

/// All blocks one after the other.
struct Smoothed {
  std::vector<double> t, q, dq, ddq, tau;
  Smoothed(const Log& log, std::span<const trajectory::Axis> axes, const Smoothing& smoothing, std::size_t block) {
    SmoothedLog smoothed(log, axes, smoothing, 5 * smoothing.step, block);
    while (const Block* b = smoothed.next()) {
      for (auto [from, to] : {std::pair{&b->t, &t}, {&b->q, &q}, {&b->dq, &dq}, {&b->ddq, &ddq}, {&b->tau, &tau}})
        to->insert(to->end(), from->begin(), from->end());
    }
  }
};

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) return std::numeric_limits<double>::infinity();
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

TEST(SmoothedLog, InBlocksIsWhatTheWholeWouldGive) {
  const TemporaryFolder folder("blocks");
  const robot::RobotModel robot = lwr4();
  SyntheticLog synthetic;
  synthetic.rate = 100;
  synthetic.duration = 60;
  synthetic.noise = 0.5;
  for (const double jitter : {0.0, 0.2}) {  // share of the step; then samples are interpolated onto the grid by a spline
    synthetic.write(folder / "log.csv", robot, [&](std::size_t row, std::vector<double>& cells) {
      if (row % 3 == 1) cells[0] += jitter * 0.01;
    });
    const Log log{{folder / "log.csv"}, {}};
    const auto axes = trajectory::axes_of(robot);
    const Smoothing smoothing{0.01, 5, 4, 0.2};
    const Smoothed whole(log, axes, smoothing, 100000), parts(log, axes, smoothing, 1);
    EXPECT_EQ(whole.t.size(), grid_points(60, smoothing));
    EXPECT_LT(largest_difference(whole.t, parts.t), 1e-12);
    EXPECT_LT(largest_difference(whole.q, parts.q), 1e-8) << jitter;  // rad of 1
    EXPECT_LT(largest_difference(whole.dq, parts.dq), 1e-7) << jitter;
    EXPECT_LT(largest_difference(whole.ddq, parts.ddq), 1e-6) << jitter;  // q̈ of an error of 1e-8 at 5 Hz
    EXPECT_LT(largest_difference(whole.tau, parts.tau), 1e-6) << jitter;  // N.m of 60
  }
}

TEST(SmoothedLog, GivesTheMotionAndItsDerivativesWithoutDelay) {
  const TemporaryFolder folder("derivatives");
  const robot::RobotModel robot = lwr4();
  const SyntheticLog synthetic;
  synthetic.write(folder / "log.csv", robot);
  const Smoothed smoothed({{folder / "log.csv"}, {}}, trajectory::axes_of(robot), {0.005, 10, 4, 0.5}, 4096);
  double q = 0, dq = 0, ddq = 0;
  for (std::size_t k = 0; k < smoothed.t.size(); ++k) {
    for (std::size_t j = 0; j < 7; ++j) {
      const Eigen::Vector3d x = synthetic.motion(j, smoothed.t[k]);
      q = std::max(q, std::abs(smoothed.q[7 * k + j] - x[0]));
      dq = std::max(dq, std::abs(smoothed.dq[7 * k + j] - x[1]));
      ddq = std::max(ddq, std::abs(smoothed.ddq[7 * k + j] - x[2]));
    }
  }
  // The motion is below 0.5 Hz, where the filter's gain differs from 1 by 0.41 · 20⁻⁸; the remaining error is due to the ends,
  // 5 periods away.
  EXPECT_LT(q, 1e-4);
  EXPECT_LT(dq, 1e-3);
  EXPECT_LT(ddq, 2e-2);
}

TEST(SmoothedLog, NeverMixesSegmentsAndFiles) {
  const TemporaryFolder folder("segments");
  const robot::RobotModel robot = lwr4();
  const SyntheticLog synthetic;
  synthetic.write(folder / "a.csv", robot);
  synthetic.write(folder / "gap.csv", robot, [](std::size_t row, std::vector<double>& cells) {
    if (row > 2000) cells[0] += 3;
  });
  const auto axes = trajectory::axes_of(robot);
  const Smoothing smoothing{0.005, 10, 4, 0};
  const Smoothed one({{folder / "a.csv"}, {}}, axes, smoothing, 4096);
  const Smoothed twice({{folder / "a.csv", folder / "a.csv"}, {}}, axes, smoothing, 4096);
  ASSERT_EQ(twice.q.size(), 2 * one.q.size());
  EXPECT_TRUE(std::equal(one.ddq.begin(), one.ddq.end(), twice.ddq.begin() + static_cast<std::ptrdiff_t>(one.ddq.size())));
  const Smoothed gap({{folder / "gap.csv"}, {}}, axes, smoothing, 4096);
  EXPECT_EQ(gap.t.size(), 4001u);
  EXPECT_NEAR(gap.t[2001] - gap.t[2000], 3.005, 1e-9);
}

}  // namespace
}  // namespace cotwin::measurement::measurement_test
