// cotwin tune on a known robot: its results, its files, and that only the settings determine them.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <thread>

#include "master/workflows/tuning/cross_validation.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/error.h"
#include "tests/master/workflows/tune_fixture.h"
#include "tests/support/bag_writer.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::master::tuning::tune_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::Process;
using cotwin::testing::RunResult;
using cotwin::testing::TunedRobot;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::Gt;
using ::testing::HasSubstr;
using ::testing::Lt;
using Values = std::vector<double>;

const TunedRobot& robot() {
  static const TunedRobot robot;
  return robot;
}

TEST(Tune, PredictsHeldOutTorques) {
  const Result result = robot().tune(robot().settings(), "finds");
  const nlohmann::json figures = robot().figures("finds");
  // Noise of 0.02 N.m at 100 Hz; a third of it passes a low-pass at 5 Hz.
  EXPECT_THAT(figures["held_out"]["rms"]["floor"].get<Values>(), Each(Lt(0.03)));
  EXPECT_THAT(figures["held_out"]["rms"]["feasible"].get<Values>(), Each(Lt(0.05)));
  EXPECT_THAT(figures["held_out"]["rms"]["swarm"].get<Values>(), Each(Lt(0.3)));  // after 60 rounds of 64 particles
  EXPECT_THAT(figures["held_out"]["rms"]["prior"].get<Values>(), Each(Gt(1.0)));
  EXPECT_EQ(figures["training"]["samples"].get<std::size_t>() + figures["held_out"]["samples"].get<std::size_t>(), 3961u);
  EXPECT_NEAR(figures["training"]["samples"].get<double>() / 3961, 0.7, 1e-3);
  const double floor = result.floor_rms, feasible = result.feasible_rms, swarm = result.swarm_rms;
  EXPECT_LE(floor, feasible * (1 + 1e-9));
  EXPECT_LE(floor, swarm * (1 + 1e-9));
  EXPECT_LT(swarm, 0.1 * result.prior_rms);
}

TEST(Tune, FindsFrictionAndMotorInertia) {
  Settings settings = robot().settings();
  settings.method = Method::kFeasible;
  const Result result = robot().tune(settings, "friction");
  const identification::Estimate& found = result.candidates[result.tuned].estimate;
  for (const identification::JointDrive& drive : found.drive) {
    EXPECT_NEAR(drive.tau_C, 1.5, 0.05);
    EXPECT_NEAR(drive.v_R, 0.1, 0.01);
    EXPECT_NEAR(drive.sigma2, 2, 0.1);
    EXPECT_NEAR(drive.tau_0, 0.2, 0.05);
  }
  for (std::size_t j = 2; j < 7; ++j) EXPECT_NEAR(found.drive[j].B, 0.4, 0.01) << j;  // standard deviations of 0.0004
  // Motion and noise cannot separate the first two motors from the links that turn with them: link 2 rotates about its own axis
  // with q̇_2 alone. Their sum is determined; the parts are those nearest to the prior.
  const identification::BaseParameters base = identification::base_parameters(robot().truth);
  const Eigen::VectorXd beta = base.G * found.pi, truth = base.G * identification::estimate_of(robot().truth).pi;
  for (const int joint : {1, 2}) {
    const std::string own = "Izz_" + std::to_string(joint);
    for (int i = 0; i < beta.size(); ++i) {
      if (base.name(i).rfind(own, 0) != 0) continue;
      EXPECT_NEAR(beta[i] + found.drive[static_cast<std::size_t>(joint - 1)].B, truth[i] + 0.4, 0.01) << base.name(i);
    }
    EXPECT_NEAR(found.drive[static_cast<std::size_t>(joint - 1)].B, 0.4, 0.05);
    for (const identification::Determination& unknown : result.excitation.unknown) {
      if (unknown.name != "B_" + std::to_string(joint) && unknown.name.rfind(own, 0) != 0) continue;
      EXPECT_FALSE(unknown.determined) << unknown.name;
      EXPECT_EQ(unknown.deviation, std::numeric_limits<double>::infinity()) << unknown.name;
    }
  }
  for (const identification::Determination& unknown : result.excitation.unknown) {
    if (unknown.name != "B_3") continue;
    EXPECT_TRUE(unknown.determined);
    EXPECT_LT(unknown.deviation, 0.001);
  }
  EXPECT_THAT(
      content(robot().folder / "friction/report.md"),
      HasSubstr("Not determined, or only in sums with one another; the pull to the prior decides about them: `B_1` `B_2`"));
}

TEST(Tune, FindsLoadFrictionAndNoneWithoutLoad) {
  std::ofstream(robot().folder / "truth.urdf") << robot::to_urdf(robot().truth);
  cotwin::testing::SyntheticLog log = robot().log;
  log.load = 0.08;
  log.write(robot().folder / "load.csv", robot().truth);
  Settings settings = robot().settings();
  settings.robot = robot().folder / "truth.urdf";
  settings.data = {robot().folder / "load.csv"};
  settings.method = Method::kFeasible;
  settings.model.load = true;
  settings.model.v_R = log.v_R;
  const Result result = robot().tune(settings, "load");
  const auto& drive = result.candidates[result.tuned].estimate.drive;
  EXPECT_EQ(drive[0].load, 0);  // an upright axis
  EXPECT_NEAR(drive[1].load, 0.08, 0.004);
  EXPECT_NEAR(drive[3].load, 0.08, 0.01);
  EXPECT_NEAR(drive[1].tau_C, 1.5, 0.1);
  EXPECT_THAT(robot().figures("load")["held_out"]["max"]["feasible"].get<Values>(), Each(Lt(0.5)));
}

TEST(Tune, TheUrdfAndTheCsvHaveTheSameTorquesAsTheFigures) {
  const Result result = robot().tune(robot().settings(), "files");
  const robot::RobotModel tuned = robot::load_urdf(robot().folder / "files/robot.urdf");  // an Error if a body were unphysical
  ASSERT_EQ(tuned.n(), 7);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_EQ(tuned.bodies[i].inertia, result.robot.bodies[i].inertia);
    EXPECT_EQ(tuned.joints[i].friction, result.robot.joints[i].friction);
    EXPECT_EQ(tuned.joints[i].X_PJ, robot().truth.joints[i].X_PJ);
  }
  EXPECT_EQ(result.robot.history.size(), 7u);
  EXPECT_THAT(content(robot().folder / "files/robot.urdf"), HasSubstr("<!-- cotwin tune: feasible, seed 1, 2772 samples"));

  const csv::Table table = csv::load(robot().folder / "files/torques.csv", {"tau_smooth[3]", "tau_tuned[3]", "tau_prior[3]"});
  const nlohmann::json figures = robot().figures("files");
  double tuned_squares = 0, prior_squares = 0, most = 0;
  const std::size_t training = figures["training"]["samples"].get<std::size_t>();
  ASSERT_EQ(table.rows(), 3961u);
  for (std::size_t k = 0; k < training; ++k) {
    tuned_squares += std::pow(table.columns[0][k] - table.columns[1][k], 2);
    prior_squares += std::pow(table.columns[0][k] - table.columns[2][k], 2);
    most = std::max(most, std::abs(table.columns[0][k] - table.columns[1][k]));
  }
  const double N = static_cast<double>(training);
  // By Newton and Euler sample by sample, and by the compressed triangles, where the friction curve is linear between 40 nodes.
  EXPECT_NEAR(std::sqrt(tuned_squares / N), figures["training"]["rms"]["feasible"][2].get<double>(), 2e-3);
  EXPECT_NEAR(std::sqrt(prior_squares / N), figures["training"]["rms"]["prior"][2].get<double>(), 1e-6);
  EXPECT_NEAR(most, figures["training"]["max"]["feasible"][2].get<double>(), 1e-12);
}

TEST(Tune, TheReportNamesDataSeedConditioningAndTheReferences) {
  robot().tune(robot().settings(), "report");
  const std::string report = content(robot().folder / "report/report.md");
  for (const char* part :
       {"log.csv", "seed 1", "condition number", "standard deviation", "| joint | torque | prior | swarm | feasible | floor |",
        "held out", "low-pass at 5 Hz", "base parameters", "σ2"})
    EXPECT_THAT(report, HasSubstr(part));
}

const char* const kFiles[] = {"robot.urdf", "drive_train.ssv", "torques.csv", "figures.json", "report.md", "resume.json"};

TEST(Tune, GivesTheSameBytesOnAnyNumberOfThreads) {
  robot().tune(robot().settings(), "one", 1);
  robot().tune(robot().settings(), "eight", 8);
  for (const char* file : kFiles)
    EXPECT_EQ(content(robot().folder / "one" / file), content(robot().folder / "eight" / file)) << file;
}

TEST(Tune, InterruptedLeavesTheBestSoFarAndGoesOnToTheSameBytes) {
  Settings settings = robot().settings();
  robot().tune(settings, "straight");
  int rounds = 0;
  const Hooks stop_after_25{[&](const std::string& what, double) { rounds += what.rfind("round", 0) == 0 ? 1 : 0; },
                            [&] { return rounds >= 25; }};
  const Result stopped = robot().tune(settings, "stopped", 1, stop_after_25);
  EXPECT_TRUE(stopped.interrupted);
  EXPECT_EQ(robot().figures("stopped")["state"], "interrupted");
  EXPECT_NO_THROW(robot::load_urdf(robot().folder / "stopped/robot.urdf"));
  EXPECT_TRUE(fs::exists(robot().folder / "stopped/drive_train.ssv"));
  EXPECT_THAT(content(robot().folder / "stopped/report.md"), HasSubstr("**Interrupted**"));

  const Result resumed = robot().tune(settings, "stopped", 1, {}, true);
  EXPECT_FALSE(resumed.interrupted);
  for (const char* file : kFiles)
    EXPECT_EQ(content(robot().folder / "straight" / file), content(robot().folder / "stopped" / file)) << file;
}

TEST(Tune, InterruptedInFeasibleLeastSquaresKeepsItsResultAndResumesToTheSameBytes) {
  for (const Method method : {Method::kSwarm, Method::kFeasible}) {
    SCOPED_TRACE(to_text(method));
    Settings settings = robot().settings();
    settings.method = method;
    robot().tune(settings, "whole");
    bool solving = false;
    int asked = 0;
    const Hooks stop_after_5{[&](const std::string& what, double) { solving = solving || what == "feasible least squares"; },
                             [&] { return solving && ++asked > 5; }};
    const Result stopped = robot().tune(settings, "half", 1, stop_after_5);
    EXPECT_TRUE(stopped.interrupted);
    EXPECT_LT(asked, 10);  // it stops on request
    EXPECT_EQ(robot().figures("half")["state"], "interrupted");
    EXPECT_EQ(robot().figures("half")["weighted_rms"].contains("feasible"), method == Method::kFeasible);
    EXPECT_LE(method == Method::kSwarm ? stopped.swarm_rms : stopped.feasible_rms, stopped.prior_rms);
    EXPECT_NO_THROW(robot::load_urdf(robot().folder / "half/robot.urdf"));
    EXPECT_THAT(content(robot().folder / "half/report.md"), HasSubstr("**Interrupted**"));

    const Result resumed = robot().tune(settings, "half", 1, {}, true);
    EXPECT_FALSE(resumed.interrupted);
    for (const char* file : kFiles)
      EXPECT_EQ(content(robot().folder / "whole" / file), content(robot().folder / "half" / file)) << file;
  }
}

TEST(Tune, AnotherSeedFindsAnotherWay) {
  Settings settings = robot().settings();
  settings.rounds = 5;
  const Result one = robot().tune(settings, "seed1");
  settings.seed = 2;
  const Result two = robot().tune(settings, "seed2");
  EXPECT_NE(one.swarm->history, two.swarm->history);
}

TEST(Tune, SeparateLogsCanBeHeldOut) {
  cotwin::testing::SyntheticLog other = robot().log;
  other.seed = 7;
  other.write(robot().folder / "other.csv", robot().truth);
  Settings settings = robot().settings();
  settings.held_out = {robot().folder / "other.csv"};
  settings.method = Method::kFeasible;
  robot().tune(settings, "other");
  const nlohmann::json figures = robot().figures("other");
  EXPECT_EQ(figures["training"]["samples"], 3961);
  EXPECT_EQ(figures["held_out"]["samples"], 3961);
  EXPECT_THAT(figures["held_out"]["rms"]["feasible"].get<Values>(), Each(Lt(0.1)));
}

/// A log of the planar arm in a file of its own, and settings that fix only the shape of friction.
Settings of_planar_arm(const std::string& file, const cotwin::testing::SyntheticLog& log,
                       const std::function<void(std::size_t, std::vector<double>&)>& spoil = {}) {
  Settings settings;
  settings.robot = places::source() + "/models/robots/planar2/robot.urdf";
  log.write(robot().folder / file, robot::load_urdf(settings.robot), spoil);
  settings.data = {robot().folder / file};
  settings.model.friction = identification::FrictionLaw::kCoulomb;
  settings.model.v_R = log.v_R;
  settings.accept_data = true;  // gravity is small compared with friction
  return settings;
}

TEST(CrossValidation, ChoosesLoadFrictionIfTheGearsHaveIt) {
  for (const double load : {0.0, 0.08}) {
    SCOPED_TRACE(load);
    cotwin::testing::SyntheticLog log = robot().log;
    log.load = load;
    const Settings settings = of_planar_arm("gears.csv", log);
    const Settings chosen = cross_validate(settings, {}, 1, {});
    EXPECT_EQ(chosen.model.load, load > 0);
    EXPECT_GT(chosen.cutoff, 0.4);  // the motion has sines up to 0.3 Hz
    EXPECT_THAT(chosen.chosen.back(), HasSubstr(load > 0 ? "friction with the load" : "friction without the load"));
    EXPECT_EQ(cross_validate(settings, {}, 3, {}).chosen, chosen.chosen);
  }
}

// Changes after the training part have no influence.
TEST(CrossValidation, DoesNotUseTheHeldOutPart) {
  const cotwin::testing::SyntheticLog& log = robot().log;
  const Settings chosen = cross_validate(of_planar_arm("seen.csv", log), {}, 2, {});
  const auto spoil = [&](std::size_t, std::vector<double>& cells) {
    for (std::size_t j = 3; cells[0] > 0.7 * log.duration && j < 5; ++j) cells[j] = 3 * cells[j] + 7;
  };
  EXPECT_EQ(cross_validate(of_planar_arm("seen.csv", log, spoil), {}, 2, {}).chosen, chosen.chosen);
}

TEST(CrossValidation, KeepsGivenSettingsAndIsInTheReport) {
  Settings settings = of_planar_arm("given.csv", robot().log);
  settings.method = Method::kFeasible;
  settings.cutoff = 5;
  settings.prior_weight = 0.5;
  const Settings chosen = cross_validate(settings, {false, false, false}, 1, {});
  EXPECT_EQ(chosen.cutoff, 5);
  EXPECT_EQ(chosen.prior_weight, 0.5);
  EXPECT_FALSE(chosen.model.load);
  ASSERT_EQ(chosen.chosen.size(), 2u);
  EXPECT_EQ(chosen.chosen[0], "low-pass at 5 Hz: 1");
  EXPECT_EQ(chosen.chosen[1], "taken: low-pass at 5 Hz, friction without the load, prior weight 0.5");
  robot().tune(chosen, "chosen");
  EXPECT_THAT(content(robot().folder / "chosen/report.md"), HasSubstr("  * taken: low-pass at 5 Hz"));
  EXPECT_EQ(load_resume(robot().folder / "chosen/resume.json").settings.chosen, chosen.chosen);
  EXPECT_THROW(cross_validate(settings, {}, 1, Hooks{{}, [] { return true; }}), Stopped);
}

// A cutoff of 0 means the default cutoff: as a given value, it is not chosen by cross-validation.
TEST(CrossValidation, UsesTheDefaultCutoffIfItIsGivenAsZero) {
  Settings settings = of_planar_arm("rule.csv", robot().log);
  settings.cutoff = 0;
  const double rule = survey_log(settings, {}).survey.cutoff();
  const Settings chosen = cross_validate(settings, {false, false, false}, 1, {});
  EXPECT_EQ(chosen.chosen.size(), 2u);
  EXPECT_EQ(chosen.cutoff, rule);
  EXPECT_GT(cross_validate(settings, {true, false, false}, 1, {}).chosen.size(), 5u);
}

/// Stiffness that `cotwin tune` identifies for gears of 1e4 N.m/rad, from logs whose friction is as large as the torques of the
/// motion.
std::vector<double> stiffness_found(double load, bool joint) {
  cotwin::testing::SyntheticLog log = robot().log;
  log.load = load;
  log.joint = joint;
  log.K = 1e4;
  Settings settings = robot().settings();
  log.write(robot().folder / "motors.csv", robot().truth);
  settings.data = {robot().folder / "motors.csv"};
  settings.robot = places::source() + "/models/robots/lwr4/robot.urdf";
  settings.method = Method::kFeasible;
  settings.model.friction = identification::FrictionLaw::kCoulomb;
  settings.model.v_R = log.v_R;
  settings.model.load = load > 0;
  settings.model.motor_inertia = !joint;
  settings.format.theta_columns = "theta{}";
  const Result result = robot().tune(settings, "motors");
  std::vector<double> found;
  for (const identification::Torsion& torsion : result.evaluation.torsion) found.push_back(torsion.K);
  return found;
}

TEST(Stiffness, IsThatOfTheGearsAlsoWhereFrictionGrowsWithTheLoad) {
  for (const double load : {0.0, 0.3}) {
    SCOPED_TRACE(load);
    const std::vector<double> K = stiffness_found(load, false);
    ASSERT_EQ(K.size(), 7u);
    for (const std::size_t j : {1u, 3u}) EXPECT_NEAR(K[j], 1e4, 100) << j;  // which gravity loads
  }
}

TEST(Stiffness, OfTorquesBehindTheGearsSubtractsNoFriction) {
  const std::vector<double> K = stiffness_found(0, true);
  ASSERT_EQ(K.size(), 7u);
  for (const std::size_t j : {0u, 1u, 2u, 3u, 4u}) EXPECT_NEAR(K[j], 1e4, 100) << j;
}

TEST(Tune, LeastSquaresWritesNoUnphysicalRobot) {
  Settings settings = robot().settings();
  settings.method = Method::kLeastSquares;
  const Result result = robot().tune(settings, "floor");
  EXPECT_FALSE(fs::exists(robot().folder / "floor/robot.urdf"));
  EXPECT_EQ(result.candidates[result.tuned].name, "floor");
  EXPECT_FALSE(robot().figures("floor")["weighted_rms"].contains("swarm"));
}

TEST(Tune, SettingsSurviveTheResumeFile) {
  Settings settings = robot().settings();
  settings.format.q_offset = {1, 2, 3, 4, 5, 6, 7};
  settings.format.theta_columns = "motor{}";
  settings.model.harmonics = {0, 2, 0, 0, 0, 0, 0};
  settings.seed = 1234567890123456789u;
  const Resume resume{settings, {1, 2}, std::string("\0\xff\x10", 3), "cotwin 1.2", {"0123", "4567"}};
  const Resume read = parse_resume(to_text(resume), "resume.json");
  EXPECT_EQ(to_text(read), to_text(resume));
  EXPECT_EQ(read.swarm, resume.swarm);
  EXPECT_EQ(read.program, resume.program);
  EXPECT_EQ(read.hashes, resume.hashes);
  EXPECT_EQ(read.settings.model, settings.model);
  EXPECT_EQ(read.settings.format, settings.format);
}

TEST(Tune, AnInvalidResumeFileIsAnErrorThatNamesIt) {
  const std::string good = to_text(Resume{robot().settings(), {1}, {1, 2, 3}});
  const auto error_of = [](const std::string& text) -> std::string {
    try {
      parse_resume(text, "resume.json");
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  ASSERT_EQ(error_of(good), "");
  EXPECT_THAT(error_of(""), HasSubstr("resume.json: is no JSON object"));
  EXPECT_THAT(error_of("[1]"), HasSubstr("is no JSON object"));
  EXPECT_THAT(error_of(with("tuning 2", "tuning 9")), HasSubstr("another format"));
  EXPECT_THAT(error_of(with("\"rounds\": 60", "\"rounds\": -1")), HasSubstr("expected 1 to"));
  EXPECT_THAT(error_of(with("\"rounds\": 60", "\"rounds\": \"x\"")),
              AllOf(HasSubstr("'rounds'"), HasSubstr("expected another type")));
  EXPECT_THAT(error_of(with("010203", "01020")), HasSubstr("ends within a byte"));
  EXPECT_THAT(error_of(with("010203", "01zz03")), HasSubstr("hexadecimal"));
  for (std::size_t length = 0; length + 1 < good.size(); length += 7) EXPECT_NE(error_of(good.substr(0, length)), "") << length;
}

TEST(Tune, ResumingWithAnotherLogIsAnError) {
  Settings settings = robot().settings();
  settings.rounds = 2;
  robot().log.write(robot().folder / "changing.csv", robot().truth);
  settings.data = {robot().folder / "changing.csv"};
  robot().tune(settings, "changing");
  std::ofstream(robot().folder / "changing.csv", std::ios::app) << "# another line\n";
  EXPECT_THROW(load_resume(robot().folder / "changing/resume.json"), Error);
}

/// Starts the program in the folder of the robot.
cotwin::testing::Process start(std::vector<std::string> arguments) {
  return cotwin::testing::start_program(std::move(arguments), {.folder = robot().folder.path()});
}
RunResult run(std::vector<std::string> arguments, const std::vector<std::string>& environment = {}) {
  return cotwin::testing::run_program(std::move(arguments), {.folder = robot().folder.path(), .environment = environment});
}

TEST(TuneProgram, PrintsATablePerJointAndWhereTheFilesAre) {
  const RunResult tuned =
      run({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--out", "table", "--rounds", "5", "--cutoff", "5"});
  ASSERT_EQ(tuned.code, 0) << tuned.err;
  std::istringstream err(tuned.err);  // a verdict per joint, and no progress bar if stderr is no terminal
  std::string line;
  int joints = 0;
  while (std::getline(err, line)) {
    if (line.starts_with("cotwin: warning: ")) continue;
    const std::string joint = "joint_" + std::to_string(++joints);
    EXPECT_THAT(line, ::testing::MatchesRegex("cotwin: " + joint + ": held-out error .* N.m of .* N.m .*: good"));
  }
  EXPECT_EQ(joints, 7);
  EXPECT_THAT(tuned.out, AllOf(HasSubstr("prior"), HasSubstr("swarm"), HasSubstr("feasible"), HasSubstr("floor"),
                               HasSubstr("max, feasible")));
  EXPECT_THAT(tuned.out, AllOf(HasSubstr("held out"), HasSubstr("joint_7"), HasSubstr("results: table")));
  for (const char* file : kFiles) EXPECT_TRUE(fs::exists(robot().folder / "table" / file)) << file;
  for (const fs::directory_entry& entry : fs::directory_iterator(robot().folder / "table"))
    EXPECT_THAT(entry.path().string(), ::testing::Not(HasSubstr(".part")));  // no incomplete files remain
}

/// Its joints have another order than the robot's.
TEST(TuneProgram, OfABagWritesTheFilesOfItsTable) {
  const csv::Table log = csv::load(robot().folder / "log.csv");
  cotwin::testing::McapWriter bag;
  const std::uint16_t joints = bag.channel("/joint_states", "sensor_msgs/msg/JointState");
  for (std::size_t k = 0; k < log.rows(); ++k) {
    std::vector<std::string> names;
    std::vector<double> q, tau;
    for (const int j : {3, 7, 1, 5, 2, 6, 4}) {
      names.push_back("joint_" + std::to_string(j));
      q.push_back(log.column("q" + std::to_string(j))[k]);
      tau.push_back(log.column("tau" + std::to_string(j))[k]);
    }
    const std::int64_t time = 1'700'000'000'000'000'000 + std::llround(log.column("t")[k] * 1e9);
    bag.message(joints, time, cotwin::testing::joint_state(time, names, q, {}, tau));
  }
  robot().folder.write("log.mcap", bag.file());
  const RunResult written = run({"info", "log.mcap", "--csv", "table.csv"});
  ASSERT_EQ(written.code, 0) << written.err;
  for (const std::string file : {"log.mcap", "table.csv"}) {
    const RunResult tuned =
        run({"tune", "--robot", "prior.urdf", "--data", file, "--out", "of_" + file, "--rounds", "5", "--cutoff", "5"});
    ASSERT_EQ(tuned.code, 0) << tuned.err;
    EXPECT_EQ(tuned.err.find("effort of /joint_states is taken as N.m") != std::string::npos, file == "log.mcap") << tuned.err;
  }
  for (const char* file : {"robot.urdf", "drive_train.ssv", "torques.csv", "motion.csv", "twin.ssd"}) {
    std::string of_bag = content(robot().folder / "of_log.mcap" / file);
    const std::string name = "log.mcap";
    for (std::size_t at = of_bag.find(name); at != std::string::npos; at = of_bag.find(name))
      of_bag.replace(at, name.size(), "table.csv");
    EXPECT_EQ(of_bag, content(robot().folder / "of_table.csv" / file)) << file;
  }
}

// Kernels differ by rounding, and so may the robot: what the data do not determine is decided by the prior, not by noise of
// 1e-16.
TEST(TuneProgram, FindsTheSameRobotOnEveryInstructionSet) {
  std::vector<std::vector<double>> masses;
  std::vector<nlohmann::json> figures;
  for (const char* isa : {"x86-64-v2", "x86-64-v3", "x86-64-v4"}) {
    const RunResult tuned = run({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--out", isa, "--method", "feasible",
                                 "--cutoff", "5", "--quiet"},
                                {std::string("COTWIN_CPU=") + isa});
    ASSERT_EQ(tuned.code, 0) << tuned.err;
    masses.emplace_back();
    const robot::RobotModel found = robot::load_urdf(robot().folder / isa / "robot.urdf");
    for (const robot::Body& body : found.bodies) {
      const auto pi = body.inertia.parameters();
      masses.back().insert(masses.back().end(), pi.data(), pi.data() + 10);
    }
    const ParameterSet drives = load_parameter_set(robot().folder / isa / "drive_train.ssv");
    for (const ParameterValue& value : drives.values) {
      if (value.name[0] == 'B') masses.back().push_back(std::get<double>(value.value));
    }
    figures.push_back(robot().figures(isa));
  }
  EXPECT_EQ(masses[0].size(), 77u);
  for (std::size_t k : {std::size_t{0}, std::size_t{1}}) {
    for (std::size_t i = 0; i < masses[k].size(); ++i) EXPECT_NEAR(masses[k][i], masses[2][i], 1e-5) << i;
    for (const char* what : {"feasible", "floor"})
      EXPECT_NEAR(figures[k]["weighted_rms"][what].get<double>(), figures[2]["weighted_rms"][what].get<double>(), 1e-9) << what;
  }
}

TEST(TuneProgram, BadInputIsExitCodeTwoWithPlaceFactAndExpectation) {
  const auto expect_refused = [](const std::vector<std::string>& arguments, const std::vector<std::string>& parts) {
    const RunResult ran = run(arguments);
    EXPECT_EQ(ran.code, 2) << ran.err;
    for (const std::string& part : parts) EXPECT_THAT(ran.err, HasSubstr(part));
  };
  expect_refused({"tune", "--robot", "prior.urdf"}, {"--data: no file, expected at least one"});
  expect_refused({"tune", "--robot", "nobody", "--data", "log.csv"}, {"robot 'nobody'"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--split", "2"}, {"--split: 2, expected 0.05 to 1"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--method", "magic"},
                 {"expected one of swarm, feasible, least-squares"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--angle-unit", "deg", "--time-unit", "ms"},
                 {"log.csv", "expected"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--cutoff", "0.01"},
                 {"log.csv: the longest segment without a gap is 40 s, expected more than 200 s"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--harmonics", "0,5,0,0,0,0,0"},
                 {"--harmonics: 5, expected 0 to 4"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--held-out", "log.csv"},
                 {"--held-out: log.csv has the bytes of log.csv, expected a log that no solver sees"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--mass-factor", "1"},
                 {"--mass-factor: 1, expected 1.01 to"});
  expect_refused({"tune", "--robot", "prior.urdf", "--data", "log.csv", "--rate", "0.001", "--accept-data"},
                 {"--rate: 0.001 Hz, expected at least 2 Hz"});
  expect_refused({"tune", "--resume", "nowhere"}, {"nowhere/resume.json: cannot be read"});
  EXPECT_FALSE(fs::exists(robot().folder / "results"));
}

TEST(TuneProgram, TheAngleUnitDoesNotApplyToPrismaticJoints) {
  cotwin::testing::SyntheticLog log = robot().log;
  log.write(robot().folder / "gantry.csv", robot::load_urdf(places::source() + "/tests/components/data/gantry.urdf"));
  for (const char* unit : {"rad", "deg"}) {
    const RunResult tuned =
        run({"tune", "--robot", places::source() + "/tests/components/data/gantry.urdf", "--data", "gantry.csv", "--method",
             "feasible", "--q-offset", "0.1,-0.2", "--angle-unit", unit, "--out", unit, "--quiet"});
    ASSERT_EQ(tuned.code, 0) << tuned.err;
  }
  EXPECT_EQ(content(robot().folder / "deg/torques.csv"), content(robot().folder / "rad/torques.csv"));
  EXPECT_EQ(content(robot().folder / "deg/robot.urdf"), content(robot().folder / "rad/robot.urdf"));
}

TEST(TuneProgram, CtrlCLeavesTheBestSoFarAndResumeGoesOnToTheSameRobot) {
  const std::vector<std::string> command = {"tune", "--robot",     "prior.urdf", "--data",    "log.csv", "--cutoff",
                                            "5",    "--particles", "32",         "--threads", "2"};
  auto endless = command;
  endless.insert(endless.end(), {"--rounds", "1000000", "--out", "ctrl_c"});
  Process child = start(endless);
  using namespace std::chrono_literals;
  for (int i = 0; i < 600 && !fs::exists(robot().folder / "ctrl_c"); ++i)
    std::this_thread::sleep_for(50ms);  // the log has been read
  std::this_thread::sleep_for(1s);
  child.signal(SIGINT);
  const RunResult stopped = child.wait();
  ASSERT_EQ(stopped.code, 130) << stopped.err;
  EXPECT_THAT(stopped.err, HasSubstr("continue with: cotwin tune --resume ctrl_c"));
  EXPECT_NO_THROW(robot::load_urdf(robot().folder / "ctrl_c/robot.urdf"));

  const int rounds = robot().figures("ctrl_c")["swarm"]["rounds"].get<int>() + 3;
  const RunResult resumed = run({"tune", "--resume", "ctrl_c", "--rounds", std::to_string(rounds)});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  auto straight = command;
  straight.insert(straight.end(), {"--rounds", std::to_string(rounds), "--out", "no_ctrl_c"});
  const RunResult uninterrupted = run(straight);
  ASSERT_EQ(uninterrupted.code, 0) << uninterrupted.err;
  for (const char* file : kFiles)
    EXPECT_EQ(content(robot().folder / "ctrl_c" / file), content(robot().folder / "no_ctrl_c" / file)) << file;
}

TEST(TuneProgram, KilledAtAnyTimeItGoesOnToTheSameRobot) {
  const std::vector<std::string> command = {"tune",     "--robot",  "prior.urdf",  "--data",       "log.csv",
                                            "--cutoff", "5",        "--particles", "32",           "--threads",
                                            "1",        "--rounds", "60",          "--checkpoint", "1e-6"};
  const auto into = [&](const std::string& out) {
    auto all = command;
    all.insert(all.end(), {"--out", out});
    return all;
  };
  const fs::path resume = robot().folder / "killed/resume.json";
  Process child = start(into("killed"));
  const auto wait_for_a_checkpoint = [&] {
    const std::string before = content(resume);
    for (int i = 0; i < 60000 && content(resume) == before; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  // At the first checkpoint, before the first round, and at later ones.
  for (int times = 0; times < 3; ++times) {
    wait_for_a_checkpoint();
    ASSERT_TRUE(fs::exists(resume));
    child.signal(SIGKILL);
    if (child.wait().code == 0) break;
    child = start({"tune", "--resume", "killed", "--checkpoint", "1e-6", "--threads", "1"});
  }
  const RunResult resumed = child.wait(), not_killed = run(into("not_killed"));
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  ASSERT_EQ(not_killed.code, 0) << not_killed.err;
  for (const char* file : kFiles)
    EXPECT_EQ(content(robot().folder / "killed" / file), content(robot().folder / "not_killed" / file)) << file;
}

TEST(TuneProgram, OfTwoTuningsIntoOneFolderTheSecondIsRefusedAndEarlierResultsAreKept) {
  const std::vector<std::string> command = {"tune",     "--robot", "prior.urdf", "--data", "log.csv", "--cutoff", "5",
                                            "--method", "swarm",   "--rounds",   "3",      "--out",   "common"};
  const RunResult earlier = run(command);
  ASSERT_EQ(earlier.code, 0) << earlier.err;
  const std::string first = content(robot().folder / "common/report.md");
  auto endless = command;
  endless[10] = "1000000";
  Process child = start(endless);
  const auto begun = [&] { return fs::exists(robot().folder / "common/earlier-1/report.md"); };
  for (int i = 0; i < 60000 && !begun(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(content(robot().folder / "common/earlier-1/report.md"), first);
  const RunResult second = run(command);
  EXPECT_EQ(second.code, 2);
  EXPECT_THAT(second.err, HasSubstr("common: process " + std::to_string(child.id())));
  child.signal(SIGTERM);
  const RunResult stopped = child.wait();
  EXPECT_EQ(stopped.code, 143);
  EXPECT_THAT(stopped.err, HasSubstr("cotwin: stopped by SIGTERM"));
  // The robot may be in the results folder of an earlier tuning: it is copied, not moved.
  auto in_place = command;
  in_place[2] = "common/robot.urdf";
  const RunResult third = run(in_place);
  EXPECT_EQ(third.code, 0) << third.err;
  EXPECT_TRUE(fs::exists(robot().folder / "common/earlier-2/robot.urdf"));
}

TEST(TuneProgram, NeedsNoMoreMemoryForALongerLog) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers do not reuse freed memory";
#endif
  const robot::RobotModel two = robot::load_urdf(places::source() + "/models/robots/planar2/robot.urdf");
  std::vector<double> MiB;
  for (const double duration : {100.0, 300.0}) {  // 100 000 and 300 000 samples: from about 50 000 on the blocks are full
    cotwin::testing::SyntheticLog log;
    log.rate = 1000;
    log.duration = duration;
    log.write(robot().folder / "long.csv", two);
    const RunResult tuned = run({"tune", "--robot", "planar2", "--data", "long.csv", "--out", "long", "--cutoff", "10",
                                 "--method", "feasible", "--accept-data"});
    ASSERT_EQ(tuned.code, 0) << tuned.err;
    MiB.push_back(static_cast<double>(tuned.memory) / 1024);
  }
  EXPECT_LT(MiB[1], MiB[0] + 2) << MiB[0];  // the longer log has 12 MiB of numbers as doubles, and 20 MiB of text
}

TEST(ExciteProgram, WritesAMotionThatBeginsAndEndsAtRestAndPrintsConditionAndMargins) {
  std::vector<std::string> excite = {"excite", "--robot",     "prior.urdf", "--out",     "motion.csv", "--rounds",
                                     "5",      "--particles", "8",          "--periods", "2"};
  const RunResult excited = run(excite);
  ASSERT_EQ(excited.code, 0) << excited.err;
  EXPECT_THAT(excited.out,
              AllOf(HasSubstr("43 of 43 base parameters excited, condition number"), HasSubstr("torque"), HasSubstr(" %")));
  const csv::Table table = csv::load(robot().folder / "motion.csv");
  ASSERT_EQ(table.rows(), 5001u);
  for (std::size_t j = 0; j < 7; ++j) {
    for (const std::size_t row : {std::size_t{0}, std::size_t{2500}, std::size_t{5000}}) {
      EXPECT_EQ(table.columns[1 + j][row], table.columns[1 + j][0]);
      EXPECT_NEAR(table.columns[8 + j][row], 0, 1e-12);
      EXPECT_NEAR(table.columns[15 + j][row], 0, 1e-11);
    }
  }
  const std::string first = content(robot().folder / "motion.csv");
  excite.insert(excite.end(), {"--threads", "3"});
  ASSERT_EQ(run(excite).code, 0);
  EXPECT_EQ(content(robot().folder / "motion.csv"), first);
}

}  // namespace
}  // namespace cotwin::master::tuning::tune_test
