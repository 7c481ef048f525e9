// cotwin tune with realistic logs: lost rows, jitter of time stamps, joints that stand still; and results that are not usable.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <sstream>

#include "master/workflows/tuning/evidence.h"
#include "models/foundation/support/text.h"
#include "models/numerics/random.h"
#include "tests/master/workflows/tune_fixture.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/run_program.h"

namespace cotwin::master::tuning::tune_logs_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::RunResult;
using cotwin::testing::TunedRobot;
using ::testing::HasSubstr;
using ::testing::Not;
using Values = std::vector<double>;

const TunedRobot& robot() {
  static const TunedRobot robot;
  return robot;
}

double random(std::uint32_t row, std::uint32_t use) { return numerics::uniform(numerics::Key{25, 0, row, use, 0}); }

/// Whether a row is lost: a share of the rows, single or in bursts of `burst` rows.
bool lost(std::size_t row, double share, std::size_t burst) {
  return random(static_cast<std::uint32_t>(row / burst), static_cast<std::uint32_t>(burst)) < share;
}

/// `from` without the rows that `drop` selects, with the time of each row changed by `time`.
void copy_log(const fs::path& from, const fs::path& to, const std::function<bool(std::size_t)>& drop,
              const std::function<double(std::size_t, double)>& time = {}) {
  std::istringstream in(content(from));
  std::ofstream out(to);
  std::string line;
  std::getline(in, line);
  out << line << '\n';
  for (std::size_t row = 0; std::getline(in, line); ++row) {
    if (drop && drop(row)) continue;
    const std::size_t comma = line.find(',');
    const double t = std::strtod(line.c_str(), nullptr);
    out << (time ? text::to_text(time(row, t)) : line.substr(0, comma)) << line.substr(comma) << '\n';
  }
}

struct Outcome {
  double cutoff = 0;
  Eigen::VectorXd held_out;
};

Outcome tune_log(Settings settings, const fs::path& csv) {
  settings.data = {csv};
  settings.method = Method::kFeasible;
  const Result result = robot().tune(settings, "logs");
  return {robot().figures("logs")["cutoff"].get<double>(), result.evaluation.held_out->of[result.tuned].rms};
}

/// Lost rows of any kind change the automatic cutoff by at most 10 % and each held-out error by at most a tenth. The last
/// third, without lost rows, is held out, so that errors are those of the same samples. `itself`: rows are lost there, too.
void expect_losses_to_do_no_harm(Settings settings, const fs::path& csv, std::size_t rows, std::size_t burst, bool itself,
                                 std::initializer_list<double> shares = {0.05, 0.2, 0.5}) {
  const std::size_t split = rows * 2 / 3;
  const fs::path part = robot().folder / "part.csv", rest = robot().folder / "rest.csv";
  copy_log(csv, part, [&](std::size_t row) { return row >= split; });
  copy_log(csv, rest, [&](std::size_t row) { return row < split; });
  settings.held_out = {rest};
  const Outcome whole = tune_log(settings, part);
  for (const double share : shares) {
    SCOPED_TRACE(text::to_text(100 * share) + " % lost, " + std::to_string(burst) + " rows at a time");
    copy_log(csv, part, [&](std::size_t row) { return row >= split || lost(row, share, burst); });
    if (itself) copy_log(csv, rest, [&](std::size_t row) { return row < split || lost(row, share, burst); });
    const Outcome some = tune_log(settings, part);
    EXPECT_NEAR(some.cutoff, whole.cutoff, 0.1 * whole.cutoff);
    // Bursts remove whole reversals, by chance more of one joint than of another: the mean of the joints counts.
    if (burst > 1) {
      EXPECT_LT(some.held_out.cwiseQuotient(whole.held_out).mean(), 1.1);
      continue;
    }
    for (Eigen::Index j = 0; j < whole.held_out.size(); ++j)
      EXPECT_LT(some.held_out[j], 1.1 * whole.held_out[j]) << "joint " << j + 1;
  }
}

/// A log that the model does not fit exactly, like real logs: friction changes its sign over another range of speed.
Settings of_misfit() {
  Settings settings = robot().settings();
  settings.model.friction = identification::FrictionLaw::kCoulomb;
  settings.model.v_R = 0.02;
  settings.cutoff = 0;
  return settings;
}

TEST(TuneLogs, LostRowsHardlyChangeTheCutoffAndTheResult) {
  expect_losses_to_do_no_harm(of_misfit(), robot().folder / "log.csv", robot().log.samples(), 1, true);
  expect_losses_to_do_no_harm(of_misfit(), robot().folder / "log.csv", robot().log.samples(), 10, false, {0.05, 0.2});
}

TEST(TuneLogs, LostRowsHardlyChangeTheResultsOfRealRobots) {
  const fs::path log = places::public_data("measurements/ur10_unisa.csv");
  if (!fs::exists(log)) GTEST_SKIP() << "needs public measurements (scripts/fetch_logs.py)";
  Settings settings;
  settings.robot = places::source() + "/models/robots/ur10/robot.urdf";
  settings.prior_weight = 1;
  expect_losses_to_do_no_harm(settings, log, 3441, 1, true);
  expect_losses_to_do_no_harm(settings, log, 3441, 10, false);
}

TEST(TuneLogs, TimeStampsThatJitterAreTakenAsTheyAre) {
  const Settings settings = of_misfit();
  const fs::path log = robot().folder / "log.csv";
  const Outcome whole = tune_log(settings, log);
  const auto expect = [&](const char* what, double factor, const std::function<bool(std::size_t)>& drop,
                          const std::function<double(std::size_t, double)>& time) {
    SCOPED_TRACE(what);
    copy_log(log, robot().folder / "jitter.csv", drop, time);
    const Outcome jittered = tune_log(settings, robot().folder / "jitter.csv");
    EXPECT_NEAR(jittered.cutoff, whole.cutoff, 0.15 * whole.cutoff);
    for (Eigen::Index j = 0; j < whole.held_out.size(); ++j)
      EXPECT_LT(jittered.held_out[j], factor * whole.held_out[j]) << "joint " << j + 1;
  };
  // Wrong time stamps are errors of the data (10 ms at 1 rad/s are 10 mrad); the errors must not be larger than that.
  expect("2 ms of 10", 1.1, {},
         [](std::size_t row, double t) { return t + 4e-3 * (random(static_cast<std::uint32_t>(row), 77) - 0.5); });
  expect("written five at a time", 2, {}, [](std::size_t row, double t) { return t - 0.95e-2 * static_cast<double>(row % 5); });
  expect("a clock that ticks every 20 ms", 2, {}, [](std::size_t, double t) { return 0.02 * std::floor(t / 0.02 + 1e-6); });
}

TEST(TuneLogs, JointsThatStandStillLeaveTheOthersTheirWeights) {
  cotwin::testing::SyntheticLog log = robot().log;
  log.moving = 4;
  log.q_noise = 2e-5;
  log.write(robot().folder / "still.csv", robot().truth);
  Settings settings = robot().settings();
  settings.data = {robot().folder / "still.csv"};
  for (const Method method : {Method::kFeasible, Method::kLeastSquares}) {
    SCOPED_TRACE(to_text(method));
    settings.method = method;
    const Result result = robot().tune(settings, "still");
    for (const PartErrors* part : {&result.evaluation.training, &*result.evaluation.held_out}) {
      EXPECT_LT(part->of.back().rms.maxCoeff(), 0.05);  // the floor; noise of 0.02 N.m, and of the encoders
      EXPECT_LT(part->of[result.tuned].rms.maxCoeff(), 0.1);
    }
    for (Eigen::Index j = 0; j < 7; ++j) EXPECT_NEAR(result.floor.sigma[j], 0.01, 0.01) << j;
    for (std::size_t j = 0; j < 7; ++j) EXPECT_LE(result.floor.joint_rank[j], result.floor.joint_unknowns[j]) << j;
  }
  const nlohmann::json figures = robot().figures("still");
  EXPECT_EQ(figures["sigma"].size(), 7u);
  EXPECT_EQ(figures["joint_rank"].size(), 7u);
  EXPECT_THAT(content(robot().folder / "still/report.md"), HasSubstr("expected a motion"));
}

RunResult run(const std::string& arguments) {
  return cotwin::testing::run_program(cotwin::testing::words(arguments), {.folder = robot().folder.path()});
}

TEST(TuneAlarm, AResultThatIsWorseThanNoModelIsAnAlarmUnlessItIsAccepted) {
  // In the held-out part the torque of joint 7 has the opposite sign: no model of the first part can predict it.
  const auto spoil = [](std::size_t, std::vector<double>& cells) {
    if (cells[0] > 0.7 * 40) cells[14] = -cells[14];
  };
  robot().log.write(robot().folder / "other_way.csv", robot().truth, spoil);
  const std::string tune =
      "tune --robot prior.urdf --data other_way.csv --method feasible --cutoff 5 --accept-data --out alarm --quiet";
  const RunResult alarmed = run(tune);
  EXPECT_EQ(alarmed.code, 1);
  EXPECT_THAT(alarmed.err, HasSubstr("joint_7: held-out error"));
  EXPECT_THAT(alarmed.err, HasSubstr("expected below the torque itself"));
  EXPECT_THAT(content(robot().folder / "alarm/report.md"), HasSubstr("**Alarm**"));
  EXPECT_EQ(robot().figures("alarm")["alarms"].size(), 1u);
  EXPECT_EQ(robot().figures("alarm")["verdicts"].size(), 7u);
  EXPECT_EQ(run(tune + " --accept-result").code, 0);
  EXPECT_EQ(run("tune --robot prior.urdf --data log.csv --method feasible --cutoff 5 --out fine --quiet").code, 0);
  EXPECT_EQ(robot().figures("fine")["alarms"].size(), 0u);
}

// The options are those of all findings together, and what they are told to reach is what they reach.
TEST(TuneAlarm, EvidenceOfAWrongLogNamesTheOptionsThatMendIt) {
  const auto expect = [](const char* what, const std::function<void(std::size_t, std::vector<double>&)>& spoil,
                         const std::string& mends, const std::vector<std::string>& kinds, const std::string& given = "") {
    SCOPED_TRACE(what);
    robot().log.write(robot().folder / "wrong.csv", robot().truth, spoil);
    const std::string tune =
        "tune --robot prior.urdf --data wrong.csv --method feasible --cutoff 5 --quiet --overwrite --out wrong ";
    const RunResult wrong = run(tune + given);
    EXPECT_EQ(wrong.code, 1) << wrong.err;
    EXPECT_THAT(wrong.err, ::testing::ContainsRegex("(Tried: |; or )" + mends + ": held out joint_"));
    EXPECT_THAT(content(robot().folder / "wrong/report.md"), HasSubstr(mends));
    const nlohmann::json figures = robot().figures("wrong");
    std::vector<std::string> found;
    for (const nlohmann::json& finding : figures["findings"]) found.push_back(finding["kind"]);
    EXPECT_EQ(found, kinds);
    const RunResult mended = run(tune + mends + (mends.find("--tau-scale") == std::string::npos ? " " + given : ""));
    EXPECT_EQ(mended.code, 0) << mended.err;
    for (const nlohmann::json& repair : figures["repair"]) {
      if (repair["options"] != mends) continue;
      const nlohmann::json after = robot().figures("wrong")["held_out"]["rms"]["feasible"];
      for (std::size_t j = 0; j < 7; ++j)
        EXPECT_NEAR(repair["after"][j].get<double>(), after[j].get<double>(), 0.01 * after[j].get<double>()) << j;
      return;
    }
    ADD_FAILURE() << figures["repair"];
  };
  const auto swap = [](std::vector<double>& cells, std::size_t i, std::size_t j) { std::swap(cells[i], cells[j]); };
  expect(
      "two pairs exchanged, and scaled",
      [&](std::size_t, std::vector<double>& cells) {
        swap(cells, 8, 10);
        swap(cells, 12, 14);
        cells[10] *= 4;  // the first joint's
      },
      "--tau-columns tau3,tau2,tau1,tau4,tau7,tau6,tau5 --tau-scale 0.25,1,1,1,1,1,1", {"torque columns", "torque columns"},
      "--tau-scale 1,1,0.25,1,1,1,1");
  expect(
      "exchanged, and the scale is right: it is the joint's",
      [&](std::size_t, std::vector<double>& cells) {
        cells[8] *= 1.25;
        swap(cells, 8, 10);
      },
      "--tau-columns tau3,tau2,tau1,tau4,tau5,tau6,tau7", {"torque columns"}, "--tau-scale 0.8,1,1,1,1,1,1");
  expect("joints exchanged",
         [&](std::size_t, std::vector<double>& cells) {
           swap(cells, 3, 5);
           swap(cells, 10, 12);
         },
         "--q-columns q1,q2,q5,q4,q3,q6,q7 --tau-columns tau1,tau2,tau5,tau4,tau3,tau6,tau7", {"joints"});
  expect("sign", [](std::size_t, std::vector<double>& cells) { cells[14] *= -1; }, "--tau-scale 1,1,1,1,1,1,-1", {"sign"});
  expect("sign of a position", [](std::size_t, std::vector<double>& cells) { cells[7] *= -1; }, "--q-scale 1,1,1,1,1,1,-1",
         {"sign"});
}

TEST(TuneAlarm, OptionsThatWereNotTriedOrDoNotHelpAreNotNamed) {
  robot().log.write(robot().folder / "wrong.csv", robot().truth,
                    [](std::size_t, std::vector<double>& cells) { cells[14] *= -1; });
  Settings settings = robot().settings();
  settings.data = {robot().folder / "wrong.csv"};
  settings.method = Method::kFeasible;
  const Data data = load_data(settings, {});
  const Result result = robot().tune(settings, "named");
  ASSERT_EQ(result.repairs.found.size(), 2u) << "no log tells a mirrored last joint";
  EXPECT_THAT(result.evidence,
              ::testing::ElementsAre(HasSubstr("the log does not tell which: the other one is a mirrored robot")));
  Hooks hooks;
  hooks.stop = [] { return true; };
  const Repairs stopped = find_repairs(settings, data, result.evaluation, result.tuned, hooks);
  EXPECT_EQ(stopped.untried, "--tau-scale 1,1,1,1,1,1,-1 or --q-scale 1,1,1,1,1,1,-1");
  EXPECT_THAT(evidence(settings, data, stopped),
              ::testing::ElementsAre(HasSubstr("the other sign? Not tried: --tau-scale 1,1,1,1,1,1,-1 or --q-scale")));
  Data mirrored = data;  // an option that cures nothing
  mirrored.truth.sign = {-1, 1, 1, 1, 1, 1, 1};
  const Repairs none = find_repairs(settings, mirrored, result.evaluation, result.tuned, {});
  EXPECT_TRUE(none.looked);
  EXPECT_THAT(evidence(settings, data, none), ::testing::ElementsAre(HasSubstr("were looked for, not found")));
}

TEST(TuneAlarm, CheckTellsTheSameWithoutASolutionOrAFolder) {
  robot().log.write(robot().folder / "wrong.csv", robot().truth,
                    [](std::size_t, std::vector<double>& cells) { cells[14] *= -1; });
  const std::string tune = "tune --check --robot prior.urdf --cutoff 5 --out checked --data ";
  const RunResult wrong = run(tune + "wrong.csv"), right = run(tune + "log.csv"), json = run(tune + "wrong.csv --json -");
  EXPECT_EQ(wrong.code, 1);
  EXPECT_THAT(wrong.err, HasSubstr("friction of joint_7 would drive the joint"));
  EXPECT_THAT(wrong.err, HasSubstr("Not tried: --tau-scale 1,1,1,1,1,1,-1 or --q-scale 1,1,1,1,1,1,-1"));
  EXPECT_EQ(right.code, 0) << right.err;
  EXPECT_THAT(right.out, HasSubstr("\njoint_7 "));
  EXPECT_THAT(right.out, ::testing::ContainsRegex("the motion determines [0-9]+ of [0-9]+ unknowns"));
  EXPECT_THAT(right.out, HasSubstr("nothing against this log"));
  EXPECT_EQ(json.code, 1);
  const nlohmann::json told = nlohmann::json::parse(json.out);
  EXPECT_EQ(told["evidence"].size(), 1u);
  EXPECT_EQ(told["findings"][0]["kind"], "sign");
  EXPECT_EQ(told["joints"].size(), 7u);
  EXPECT_GT(told["joints"][1]["prior"], 1.0);
  EXPECT_FALSE(fs::exists(robot().folder / "checked"));
  EXPECT_EQ(run(tune + "wrong.csv --accept-result").code, 0);
  EXPECT_EQ(run(tune + "none.csv").code, 2);
  const std::string log = content(robot().folder / "log.csv");
  EXPECT_THAT(run(tune + "log.csv --json ./log.csv").err, HasSubstr("--json ./log.csv: is a log"));
  EXPECT_EQ(content(robot().folder / "log.csv"), log);
  EXPECT_THAT(run("tune --robot prior.urdf --data log.csv --json -").err, HasSubstr("--json: is for --check"));
}

TEST(TuneAlarm, MassesFarFromTheUrdfAreToldAndTheBoundThatHoldsThem) {
  robot::RobotModel heavy = robot().truth;
  for (robot::Body& body : heavy.bodies) {
    body.inertia.mass *= 8;
    body.inertia.I_CC *= 8;
  }
  robot().log.write(robot().folder / "heavy.csv", heavy);
  for (const std::string method : {"feasible", "least-squares"}) {
    SCOPED_TRACE(method);
    const std::string tune =
        "tune --robot prior.urdf --data heavy.csv --cutoff 5 --quiet --out heavy --overwrite --method " + method;
    const RunResult bound = run(tune);
    EXPECT_THAT(bound.err, HasSubstr("warning: moving mass "));
    if (method == "least-squares") {  // has no bounds
      EXPECT_EQ(bound.code, 0) << bound.err;
      continue;
    }
    EXPECT_EQ(bound.code, 1);
    const std::string alarm = "is at its bound (5 times the URDF's): --mass-factor 10 lowers the weighted RMS from ";
    EXPECT_THAT(bound.err, HasSubstr(alarm));
    EXPECT_THAT(bound.err, HasSubstr("at a bound, see --mass-factor"));
    EXPECT_THAT(content(robot().folder / "heavy/report.md"), HasSubstr(alarm));
    EXPECT_THAT(content(robot().folder / "heavy/report.md"), HasSubstr("with --mass-factor 50"));
    EXPECT_EQ(robot().figures("heavy")["alarms"][0].get<std::string>().substr(0, 5), "mass ");
    const RunResult wider = run(tune + " --mass-factor 10");
    EXPECT_EQ(wider.code, 0) << wider.err;
    EXPECT_THAT(wider.err, Not(HasSubstr("bound")));
    EXPECT_LT(robot().figures("heavy")["weighted_rms"]["feasible"], 1.05);
  }
}

// 0.2 s of one joint: a lag that is found, though its error is small against the limit of the joint.
TEST(TuneAlarm, ErrorsThatDoNotMatterAreToldWithoutAnAlarm) {
  std::string urdf = content(robot().folder / "prior.urdf");
  const auto tuned = [&](const std::string& effort) {
    std::string with = urdf;
    const std::size_t at = with.find("effort=\"", with.find("<joint name=\"joint_6\"")) + 8;
    with.replace(at, with.find('"', at) - at, effort);
    std::ofstream(robot().folder / "limit.urdf") << with;
    std::deque<double> before(20, 0.0);
    robot().log.write(robot().folder / "late.csv", robot().truth, [&](std::size_t row, std::vector<double>& cells) {
      if (row == 0) std::ranges::fill(before, cells[13]);
      before.push_back(cells[13]);
      cells[13] = before.front();
      before.pop_front();
    });
    return run("tune --robot limit.urdf --data late.csv --method feasible --cutoff 5 --quiet --overwrite --out late");
  };
  const RunResult small = tuned("60");
  EXPECT_EQ(small.code, 0) << small.err;
  EXPECT_THAT(small.err, ::testing::ContainsRegex("joint_6: held-out error .*late by [0-9.]+ ms, [0-9.]+ % of the limit"));
  for (const char* effort : {"0.5", "0", "1e5"}) {  // a small joint, and two placeholders
    const RunResult told = tuned(effort);
    EXPECT_EQ(told.code, 1) << effort;
    EXPECT_THAT(told.err, HasSubstr("torques of joint_6 that come ")) << effort;
  }
}

TEST(TuneAlarm, TheFeasibleRobotIsWrittenIfTheSwarmIsFarFromIt) {
  Settings settings = robot().settings();
  settings.rounds = 2;
  const Result result = robot().tune(settings, "unfinished");
  EXPECT_EQ(result.candidates[result.tuned].name, "feasible");
  EXPECT_EQ(robot().figures("unfinished")["tuned"], "feasible");
  EXPECT_THAT(content(robot().folder / "unfinished/robot.urdf"), HasSubstr("<!-- cotwin tune: feasible"));
  EXPECT_THAT(content(robot().folder / "unfinished/report.md"), HasSubstr("it is the robot that is written"));
}

}  // namespace
}  // namespace cotwin::master::tuning::tune_logs_test
