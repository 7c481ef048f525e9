// The program `cotwin` as users call it: exit codes, files, messages.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace program_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::Process;
using cotwin::testing::RunResult;
using ::testing::HasSubstr;
using ::testing::StartsWith;

/// Runs the program in a folder of its own.
class Program : public ::testing::Test {
 protected:
  Program() { fs::create_directories(folder_); }
  ~Program() override { fs::remove_all(folder_); }

  Process start(std::vector<std::string> arguments) {
    return cotwin::testing::start_program(std::move(arguments), {.folder = folder_});
  }
  RunResult run(std::vector<std::string> arguments) { return start(std::move(arguments)).wait(); }

  /// A scenario of one unit: the desired motion of the LWR 4+, for an hour.
  std::string scenario() {
    std::ofstream(folder_ / "motion.ssd") << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="just motion"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="just motion">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=lwr4" type="application/x-cotwin-unit"/>
    </ssd:Elements>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="3600"/>
</ssd:SystemStructureDescription>
)";
    return "motion.ssd";
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_program_" + std::to_string(::getpid()) + "_" +
                                                        ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(Program, PrintsItsVersionItsHelpAndItsUnits) {
  EXPECT_THAT(run({"--version"}).out, StartsWith("cotwin "));
  EXPECT_THAT(run({"run", "--help"}).out, HasSubstr("--set NAME=VALUE"));
  const RunResult units = run({"units"});
  EXPECT_EQ(units.code, 0);
  for (const char* unit : {"motion", "io", "compliance", "drive_train"}) EXPECT_THAT(units.out, HasSubstr(unit));
}

TEST_F(Program, BadInputIsExitCodeTwoWithAMessageAndNoFiles) {
  EXPECT_EQ(run({}).code, 2);
  EXPECT_EQ(run({"walk"}).code, 2);
  EXPECT_EQ(run({"run", "x.ssd", "--threads", "0"}).code, 2);
  const RunResult missing = run({"run", "nowhere.ssd"});
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, StartsWith("cotwin: nowhere.ssd"));
  const RunResult wrong = run({"run", scenario(), "--set", "motion.speed_of_light=1"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("speed_of_light"));
  EXPECT_EQ(run({"run", scenario(), "--record", "nothing.*"}).code, 2);
  EXPECT_EQ(run({"describe", "drive_trian"}).code, 2);
  EXPECT_FALSE(fs::exists(folder_ / "results"));
}

TEST_F(Program, RecognisesFmusByTheirNameInAnyCase) {
  for (const char* name : {"plant.fmu", "PLANT.FMU"}) {
    std::ofstream(folder_ / name) << "no archive";
    const RunResult checked = run({"check", name}), ran = run({"run", name, "--output-file", "out.csv"});
    EXPECT_THAT(checked.out, HasSubstr("expected a zip archive")) << name;
    EXPECT_THAT(ran.err, HasSubstr("expected a zip archive")) << name;
  }
}

TEST_F(Program, RunsAScenarioAndSaysWhereTheResultsAre) {
  const RunResult result = run({"run", scenario(), "--stop", "0.05", "--json", "summary.json", "--set", "motion.waypoint_q=0"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.err, "");  // no progress bar if stderr is no terminal
  EXPECT_THAT(result.out, HasSubstr("just motion: 0.05 s in 50 ticks of 1 ms"));
  EXPECT_THAT(result.out, HasSubstr("results: results/just_motion/signals.csv (51 rows)"));
  EXPECT_THAT(content(folder_ / "results/just_motion/signals.csv"), StartsWith("time,motion.q_d[1],motion.q_d[2]"));
  EXPECT_EQ(nlohmann::json::parse(content(folder_ / "summary.json"))["state"], "done");
}

TEST_F(Program, RecordsTheChosenVariablesIntoTheChosenFolder) {
  const RunResult result =
      run({"run", "--record", "motion.q_d[2]", "--out", "there", "--quiet", "--json", "-", "--stop", "0.002", scenario()});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(nlohmann::json::parse(result.out)["rows"], 3);
  EXPECT_THAT(content(folder_ / "there/signals.csv"), StartsWith("time,motion.q_d[2]\n0,"));
}

TEST_F(Program, CtrlCEndsARunCleanlyWithEverythingOnDisk) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    // SIGHUP: on a thread of its own
    Process child = signal == SIGHUP ? start({"run", scenario(), "--clock", "wall", "--cpu", "0"})
                                     : start({"run", scenario(), "--real-time"});
    const fs::path file = folder_ / "results/just_motion/signals.csv", growing = file.string() + ".part";
    for (int i = 0; i < 1000 && (!fs::exists(growing) || fs::file_size(growing) < 2000); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    child.signal(signal);
    const RunResult result = child.wait();
    EXPECT_EQ(result.code, 128 + signal) << result.err;
    EXPECT_THAT(result.out, HasSubstr("just motion: interrupted at t = "));
    const std::string csv = content(file);
    EXPECT_EQ(csv.back(), '\n');
    // The last row is the one that the report names.
    const std::size_t last = csv.rfind('\n', csv.size() - 2) + 1;
    const std::string time = csv.substr(last, csv.find(',', last) - last);
    EXPECT_THAT(result.out, HasSubstr("interrupted at t = " + time + " s"));
    fs::remove_all(folder_ / "results");
  }
}

TEST_F(Program, AFailureBeforeTheStartKeepsEarlierResults) {
  EXPECT_EQ(run({"run", scenario(), "--stop", "0.01"}).code, 0);
  const std::string before = content(folder_ / "results/just_motion/signals.csv");
  const RunResult wrong = run({"run", scenario(), "--stop", "0.01", "--set", "motion.time_scale=-1"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_EQ(content(folder_ / "results/just_motion/signals.csv"), before);
}

TEST_F(Program, OutputThatCannotBeWrittenIsAnError) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "needs /dev/full";
  fs::create_symlink("/dev/full", folder_ / "full.json");
  const RunResult file = run({"run", scenario(), "--stop", "0.01", "--json", "full.json"});
  EXPECT_EQ(file.code, 1);
  EXPECT_THAT(file.err, HasSubstr("full.json: cannot be written: No space left"));
  const std::vector<std::vector<std::string>> all = {
      {"run", scenario(), "--stop", "0.01"},
      {"run", scenario(), "--stop", "0.01", "--json", "-"},
      {"ask", "energy", "--robot", "planar2", "--from", "0,0", "--to", "1,1", "--detail", "all"},
      {"ask", "--schema", "energy"},
      {"describe", "unit:motion"},
      {"units"},
      {"info", scenario()},
      {"check", scenario()},
      {"reference", "--help"},
      {"--help"},
      {"--version"},
  };
  for (const std::vector<std::string>& command : all) {
    const RunResult printed = cotwin::testing::run_program(command, {.folder = folder_, .out = "/dev/full"});
    EXPECT_EQ(printed.code, 1) << command.front();
    EXPECT_THAT(printed.err, HasSubstr("cotwin: stdout: cannot be written")) << command.front();
  }
  // An earlier reason counts more.
  EXPECT_EQ(cotwin::testing::run_program({"run", "nothing.ssd"}, {.folder = folder_, .out = "/dev/full"}).code, 2);
}

TEST_F(Program, AReaderThatHasGoneIsNoErrorOfItsOwn) {
  const auto shell = [&](const std::string& line) { return cotwin::testing::run_command({"bash", "-c", line}); };
  const std::string cotwin = "'" + cotwin::places::program() + "'";
  for (const char* command : {" units", " describe unit:motion", " --help", " ask --schema energy"}) {
    const RunResult gone =
        shell("{ trap '' PIPE; while echo x 2>/dev/null; do :; done; " + cotwin + command + "; echo $? >&2; } | true");
    EXPECT_EQ(gone.err, "141\n") << command << ": 128 + SIGPIPE, as programs that SIGPIPE ends";
  }
}

TEST_F(Program, AStreamThatIsClosedAtTheStartDoesNotGetTheContentOfAFile) {
  const auto shell = [&](const std::string& line) {
    return cotwin::testing::run_command({"bash", "-c", "cd '" + folder_.string() + "' && " + line});
  };
  const std::string command = "'" + cotwin::places::program() + "' run '" + scenario() + "' --stop 0.01 --overwrite --out ";
  EXPECT_EQ(shell(command + "open").code, 0);
  const RunResult closed = shell(command + "closed >&- <&-");
  EXPECT_EQ(closed.code, 1);
  EXPECT_THAT(closed.err, HasSubstr("cotwin: stdout: cannot be written: Bad file descriptor\n"));
  EXPECT_EQ(shell(command + "silent --quiet >&- <&- 2>&-").code, 0);
  for (const char* out : {"closed", "silent"})
    EXPECT_EQ(content(folder_ / out / "signals.csv"), content(folder_ / "open/signals.csv")) << out;
}

// The ranges of the command line's library let it pass.
TEST_F(Program, TakesNoOptionThatIsNotANumber) {
  const std::vector<std::vector<std::string>> all = {
      {"run", scenario(), "--checkpoint"},
      {"tune", "log.csv", "--checkpoint"},
      {"anomaly", "log.csv", "--baseline"},
      {"excite", "--robot", "planar2", "--floor"},
      {"plot", "run", "motion.q_d", "--from"},
      {"plot", "run", "motion.q_d", "--to"},
      {"fit-energy", "log.csv", "--train-before"},
      {"farm", scenario(), "--stop"},
      {"farm", scenario(), "--limit"},
      {"serve", "--seconds"},
      {"robot", "--seconds"},
  };
  for (std::vector<std::string> command : all) {
    const std::string option = command.back();
    for (const char* value : {"nan", "NaN", "+nan"}) {
      command.push_back(value);
      const RunResult refused = run(command);
      EXPECT_EQ(refused.code, 2) << command.front() << option;
      EXPECT_THAT(refused.err, HasSubstr(option)) << command.front();
      EXPECT_THAT(refused.err, HasSubstr(std::string("is ") + value + ", expected a number")) << command.front();
      command.pop_back();
    }
  }
}

TEST_F(Program, NamesWhatWasProbablyMeant) {
  EXPECT_THAT(run({"rnu", scenario()}).err, HasSubstr("'rnu' is not a command, expected run, pack"));
  EXPECT_THAT(run({"rnu", scenario()}).err, HasSubstr("did you mean run?"));
  EXPECT_THAT(run({"run", scenario(), "--recrod", "a.*"}).err,
              HasSubstr("'--recrod' is not an option of run; did you mean --record?"));
  for (const char* option : {"--step-size", "--tick=1"}) {
    const RunResult refused = run({"run", scenario(), option, "0.1"});
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.err,
                HasSubstr("the step of an FMU is --output-interval SECONDS, that of a scenario the attribute tick"));
  }
  EXPECT_THAT(run({"new", "--robot", "lwr"}).err,
              HasSubstr("robot 'lwr': is neither a file nor the name of a robot, expected a URDF; did you mean lwr4?"));
  const fs::path urdf = fs::path(cotwin::places::source()) / "models/robots/lwr4/robot.urdf";
  for (const char* command : {"run", "check", "info"}) {
    const RunResult refused = run({command, urdf});
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.out + refused.err,
                HasSubstr("is a URDF, expected a scenario (.ssd); cotwin new --robot FILE writes a first one"));
  }
}

TEST_F(Program, NamesInvalidArguments) {
  EXPECT_THAT(run({"walk"}).err, StartsWith("cotwin: 'walk' is not a command, expected run"));
  EXPECT_THAT(run({"run", scenario(), "--threads", "many"}).err, StartsWith("cotwin: "));
  for (const char* stop : {"nan", "inf", "1e12"}) {
    const RunResult result = run({"run", scenario(), "--stop", stop});
    EXPECT_EQ(result.code, 2) << stop;
    EXPECT_THAT(result.err, HasSubstr("expected a time in seconds")) << stop;
  }
  const std::string file = scenario();
  const std::pair<std::vector<std::string>, const char*> clocks[] = {
      {{"--clock", "bus"}, "cotwin: --clock bus: 'bus', expected one of free, wall, arrivals, locked, real-time"},
      {{"--overrun", "skip"}, "cotwin: --overrun: does not apply to a free-running clock, expected also --clock wall"},
      {{"--clock", "free", "--cpu", "0"}, "cotwin: --cpu: does not apply to a free-running clock"},
      {{"--clock", "wall", "--cpu", "a"}, "cotwin: --cpu: 'a', expected numbers of CPUs such as '2' or '2 3'"},
      {{"--clock", "wall", "--cpu", "999999"}, "cotwin: --clock wall: CPU 999999, expected 0 to "},
      {{"--clock", "wall", "--real-time"}, "cotwin: --real-time: given with --clock wall, expected one of the two"},
      {{"--clock", "arrivals"}, "cotwin: --clock arrivals: no component has the clock of a robot or bus"},
      {{"--clock", "locked:motion"},
       "cotwin: --clock locked:motion: 'motion' has no clock of a robot or bus that ticks can follow"},
      {{"--clock", "wall", "--priority", "100"}, "cotwin: --priority: "}};
  for (const auto& [options, message] : clocks) {
    std::vector<std::string> command = {"run", file};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.code, 2) << message;
    EXPECT_THAT(result.err, StartsWith(message));
  }
  const RunResult robot = run({"describe", "motion?robot=nobody"});
  EXPECT_EQ(robot.code, 2);
  EXPECT_THAT(robot.err, HasSubstr("no file robots/nobody/robot.urdf (another robot: --set robot=PATH.urdf); looked for"));
  EXPECT_THAT(run({"describe", "motion?robot=lwr"}).err, HasSubstr("no file robots/lwr/robot.urdf; did you mean 'lwr4'?"));
}

TEST_F(Program, CtrlCWhileTheClockIsWaitedForStepsNoFurther) {
  // A tick of ten minutes: the first one runs at once, the second one not before its time.
  std::string text = content(folder_ / scenario());
  const std::string end = "</ssd:SystemStructureDescription>";
  text.replace(
      text.find(end), end.size(),
      R"(<ssd:Annotations><ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="600 s"/>
</ssc:Annotation></ssd:Annotations>)" +
          end);
  std::ofstream(folder_ / "slow.ssd") << text;
  Process child = start({"run", "slow.ssd", "--real-time"});
  const fs::path file = folder_ / "results/just_motion/signals.csv", growing = file.string() + ".part";
  const auto rows = [&] {
    const std::string csv = content(fs::exists(growing) ? growing : file);
    return std::count(csv.begin(), csv.end(), '\n');
  };
  for (int i = 0; i < 1000 && rows() < 3; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  child.signal(SIGINT);
  const RunResult result = child.wait();
  EXPECT_EQ(result.code, 130) << result.err;
  EXPECT_THAT(result.out, HasSubstr("interrupted at t = 600 s; 600 s in 1 tick of 600 s"));
  EXPECT_EQ(rows(), 3);  // header, start, first tick
}

TEST_F(Program, DescribesSettingsBeforeTheOneIsGivenThatVariablesDependOn) {
  const RunResult described = run({"describe", "tuner"});
  EXPECT_EQ(described.code, 0) << described.err;
  EXPECT_THAT(described.out, HasSubstr("none, coulomb, sigmoid, stribeck; default: none"));
  EXPECT_THAT(described.out, HasSubstr("needs the setting 'robot'"));
  const auto json = nlohmann::json::parse(run({"describe", "tuner?friction=coulomb", "--json"}).out);
  EXPECT_EQ(json["settings"][0]["name"], "robot");
  EXPECT_EQ(json["settings"][0]["required"], true);
  EXPECT_THAT(json["missing"].get<std::string>(), HasSubstr("robot"));
  EXPECT_EQ(run({"describe", "tuner?robto=lwr4"}).code, 2);  // a misspelt setting is not a missing setting
}

TEST_F(Program, SetsASettingOfOneUnit) {
  std::string text = content(folder_ / scenario());
  const std::string one = R"(<ssd:Component name="motion" source="unit:motion?robot=lwr4" type="application/x-cotwin-unit"/>)";
  text.replace(text.find(one), one.size(), one + R"(<ssd:Component name="drive" source="unit:drive_train?robot=planar2"/>
<ssd:Component name="world" source="unit:contact_world?scene=stack"/>)");
  std::ofstream(folder_ / "two.ssd") << text;
  const auto ran = [&](std::vector<std::string> more) {
    std::vector<std::string> all = {"run", "two.ssd", "--stop", "0.002", "--quiet"};
    all.insert(all.end(), more.begin(), more.end());
    return run(all);
  };
  const RunResult both = ran({"--set", "drive.method=cvode", "--set", "world.method=dantzig"});
  EXPECT_EQ(both.code, 0) << both.err;
  const RunResult wrong = ran({"--set", "world.method=cvode"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("component 'world': unit:contact_world: method=cvode, expected one of tree, pgs, dantzig"));
  const RunResult shared = ran({"--set", "method=cvode"});
  EXPECT_EQ(shared.code, 2);
  EXPECT_THAT(shared.err, HasSubstr("for one: --set COMPONENT.method="));
  const RunResult misspelt = ran({"--set", "world.methd=pgs"});
  EXPECT_EQ(misspelt.code, 2);
  EXPECT_THAT(misspelt.err, HasSubstr("world: no variable and no setting 'methd'; did you mean 'method'?"));
  const RunResult output = ran({"--set", "world.contacts=7"});  // a setting and an output of the same name
  EXPECT_EQ(output.code, 0) << output.err;
}

TEST_F(Program, NamesTheStageOfADriveThatGetsItsTorqueLate) {
  std::string ssd = content(fs::path(cotwin::places::source()) / "examples/07_cartesian_compliance/twin.ssd");
  const std::string event = R"(time="1" variable="compliance.f_e")";
  ASSERT_NE(ssd.find(event), std::string::npos);
  ssd.replace(ssd.find(event), event.size(),
              R"(time="1" variable="compliance.nothing")");  // an error, so that the loop is not measured
  std::ofstream(folder_ / "apart.ssd") << ssd;
  EXPECT_THAT(run({"check", "apart.ssd"}).out, Not(HasSubstr("late")));
  const std::string stage = R"(name="drive" stage="1")";
  ASSERT_NE(ssd.find(stage), std::string::npos);
  ssd.replace(ssd.find(stage), stage.size(), R"(name="drive" stage="0")");
  std::ofstream(folder_ / "together.ssd") << ssd;
  EXPECT_THAT(run({"check", "together.ssd"}).out,
              HasSubstr("'drive' is in stage 0 and 'compliance' in stage 0: the torque compliance.tau_m arrives a tick late"));
}

TEST_F(Program, WarnsBeforeARunOfOmissionsInTheScenario) {
  const std::string file = scenario();  // no waypoints
  const std::string expected = "motion.waypoint_q (joint positions";
  const RunResult checked = run({"check", file});
  EXPECT_EQ(checked.code, 0) << checked.err;
  EXPECT_THAT(checked.out, HasSubstr(expected));
  const RunResult ran = run({"run", file, "--stop", "0.01", "--json", "summary.json"});
  EXPECT_EQ(ran.code, 0);
  EXPECT_THAT(ran.err, StartsWith("cotwin: warning: motion.ssd:7: " + expected));
  EXPECT_EQ(ran.err.find(expected), ran.err.rfind(expected)) << "once";
  EXPECT_EQ(ran.out.find(expected), std::string::npos);
  const auto json = nlohmann::json::parse(content(folder_ / "summary.json"));
  ASSERT_EQ(json["warnings"].size(), 1u);
  EXPECT_THAT(json["warnings"][0].get<std::string>(), HasSubstr(expected));
  const RunResult given = run({"run", file, "--stop", "0.01", "--set", "motion.waypoint_q=0"});
  EXPECT_EQ(given.code, 0);
  EXPECT_EQ(given.err, "");
}

TEST_F(Program, CompletesCommandsOptionsUnitsAndSettings) {
  EXPECT_THAT(run({"completion", "bash"}).out, HasSubstr("complete -o default -F _cotwin cotwin"));
  EXPECT_EQ(run({"completion", "powershell"}).code, 2);
  const auto completed = [&](const std::string& line) {
    const RunResult result = run({"completion", "candidates", line});
    EXPECT_EQ(result.code, 0) << result.err;
    return result.out;
  };
  EXPECT_THAT(completed("cotwin "), HasSubstr("describe\n"));
  EXPECT_THAT(completed("cotwin run " + scenario() + " --"), HasSubstr("--record\n"));
  EXPECT_THAT(completed("cotwin describe "), HasSubstr("unit:tuner\n"));
  EXPECT_THAT(completed("cotwin describe tuner?robot=lwr4&"), HasSubstr("tuner?robot=lwr4&friction=stribeck\n"));
  const std::string set = completed("cotwin run " + scenario() + " --set motion.");
  EXPECT_THAT(set, HasSubstr("\nmotion.kind=polynomial\n"));
  EXPECT_THAT(set, HasSubstr("\nmotion.waypoint_q=\n"));
  EXPECT_EQ(set.find("motion.q_d="), std::string::npos);  // an output
}

TEST_F(Program, DescribesAUnitAndWritesItsReference) {
  EXPECT_THAT(run({"describe", "unit:drive_train?robot=lwr4"}).out, HasSubstr("tau_m[7]"));
  const auto json = nlohmann::json::parse(run({"describe", "drive_train?robot=lwr4", "--json"}).out);
  EXPECT_EQ(json["source"], "unit:drive_train?robot=lwr4");
  EXPECT_GT(json["variables"].size(), 5u);
  EXPECT_THAT(run({"describe", "drive_train?robot=lwr4&method=cvode"}).out,
              HasSubstr("auto, exponential, rosenbrock, cvode; default: auto; here: cvode"));
  const RunResult reference = run({"reference", "pages"});
  EXPECT_EQ(reference.code, 0) << reference.err;
  EXPECT_THAT(content(folder_ / "pages/drive_train.md"), HasSubstr("| `tau_m` | 7 | N.m |"));
  EXPECT_THAT(content(folder_ / "pages/drive_train.md"),
              HasSubstr("| `method` | auto, exponential, rosenbrock, cvode | auto |"));
  EXPECT_THAT(content(folder_ / "pages/README.md"), HasSubstr("[`drive_train`](drive_train.md)"));
}

/// The links of an arm without motors.
constexpr const char* kArm = R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="arm"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="arm"><ssd:Elements>
    <ssd:Component name="drive" source="unit:drive_train?robot=planar2" type="application/x-cotwin-unit"/>
  </ssd:Elements></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="0.1"/>
</ssd:SystemStructureDescription>
)";

TEST_F(Program, MountsToolsInARunAndExportsTheRobotAtAnyTime) {
  std::ofstream(folder_ / "arm.ssd") << kArm;
  const std::string gripper = "gripper,parent=tip,mass=1.5,com=0.05 0 0,inertia=1e-3 0 0 1e-3 0 1e-3,reason=pick";
  const std::vector<std::string> command = {"run",      "arm.ssd",         "--set",    "drive.q0=0.3",
                                            "--attach", gripper + "@0.04", "--detach", "gripper@70 ms"};
  const RunResult result = run(command);
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("tool 'gripper' attached to 'tip' at 0.04 s in drive"));
  const RunResult history = run({"tool", "history", "results/arm/history.json"});
  EXPECT_THAT(history.out, HasSubstr("  1  0.04 s  attach gripper to tip: 1.5 kg at (0.05, 0, 0) m in gripper (pick)\n"
                                     "  2  0.07 s  detach gripper from tip"));
  const auto mass_of_forearm = [&](const std::vector<std::string>& at) {
    std::vector<std::string> arguments = {"tool", "export", "results/arm/history.json"};
    arguments.insert(arguments.end(), at.begin(), at.end());
    const std::string urdf = run(arguments).out;
    const std::size_t mass = urdf.find("<mass value=\"", urdf.find("<link name=\"forearm\""));
    return mass == std::string::npos ? "" : urdf.substr(mass + 13, urdf.find('"', mass + 13) - mass - 13);
  };
  EXPECT_EQ(mass_of_forearm({}), "4");
  EXPECT_EQ(mass_of_forearm({"--time", "0.05"}), "5.5");
  EXPECT_EQ(mass_of_forearm({"--change", "1"}), "5.5");
  EXPECT_EQ(mass_of_forearm({"--change", "0"}), "4");
  const RunResult beyond = run({"tool", "export", "results/arm/history.json", "--change", "3"});
  EXPECT_EQ(beyond.code, 2);
  EXPECT_THAT(beyond.err, HasSubstr("no change 3, its history has 2"));
  EXPECT_EQ(run({"run", "arm.ssd", "--set", "drive.q0=0.3"}).code, 0);  // earlier results are moved away
  EXPECT_FALSE(fs::exists(folder_ / "results/arm/history.json"));
  EXPECT_TRUE(fs::exists(folder_ / "results/arm/earlier-1/history.json"));

  const RunResult wrong = run({"run", "arm.ssd", "--attach", "gripper,parent=hand,mass=1@0.04"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err,
              StartsWith("cotwin: --attach gripper,parent=hand,mass=1@0.04: attach 'gripper' at 0.04 s to 'drive': "));
}

TEST_F(Program, MountsToolsOutsideOfARun) {
  const std::string anvil = "anvil,parent=tip,mass=30,com=0.1 0 0,inertia=0.1 0 0 0.1 0 0.1";
  EXPECT_THAT(run({"tool", "attach", "lab.json", anvil}).err, HasSubstr("lab.json: does not exist, expected --robot"));
  const RunResult heavy = run({"tool", "attach", "lab.json", anvil, "--robot", "planar2", "--reason", "a test"});
  EXPECT_EQ(heavy.code, 0) << heavy.err;
  // g (6 · 0.2 + 4 · 0.575 + 30 · 0.85) = 284.49 N.m, 1.90 times the limit; the elbow: 139.3 N.m, 1.86 times
  EXPECT_THAT(heavy.err,
              HasSubstr("at this pose joint 'shoulder' needs 284.5 N.m against gravity, more than its limit of 150 N.m"));
  const RunResult upright = run({"tool", "detach", "lab.json", "anvil"});
  EXPECT_EQ(upright.err, "");
  EXPECT_THAT(run({"tool", "detach", "lab.json", "anvil"}).err, HasSubstr("no attachment is named 'anvil'"));
  EXPECT_EQ(run({"tool", "attach", "lab.json", anvil, "--q", "1.5707963267948966,0"}).err, "");  // it stands upright
  EXPECT_THAT(run({"tool", "attach", "lab.json", anvil, "--robot", "lwr4"}).err, HasSubstr("exists already"));
  EXPECT_THAT(run({"tool", "history", "lab.json"}).out, HasSubstr("  3  attach anvil to tip"));
  // A history is in the order of time: an earlier change is refused, and the file stays as it was.
  const std::string hook = "hook,parent=anvil,mass=0.1";
  EXPECT_EQ(run({"tool", "attach", "lab.json", hook, "--time", "3"}).code, 0);
  const RunResult earlier = run({"tool", "detach", "lab.json", "hook", "--time", "2"});
  EXPECT_EQ(earlier.code, 2);
  EXPECT_THAT(earlier.err, HasSubstr("at 2 s, expected one not before 3 s, that of 'attach hook"));
  EXPECT_THAT(run({"tool", "detach", "lab.json", "hook", "--time", "nan"}).err, HasSubstr("expected a finite time"));
  EXPECT_EQ(run({"tool", "detach", "lab.json", "hook"}).code, 0);
  EXPECT_THAT(run({"tool", "history", "lab.json"}).out, HasSubstr("  5  3 s  detach hook"));
  EXPECT_THAT(run({"tool", "attach", "lab.json", "hook"}).err, StartsWith("cotwin: tool hook: 'attach' without the attribute"));
  EXPECT_THAT(run({"tool", "attach", "lab.json", hook + ",known=false"}).err, HasSubstr("'known' is only for tools of a run"));
  EXPECT_THAT(run({"completion", "candidates", "cotwin tool "}).out, HasSubstr("export"));
  EXPECT_THAT(run({"completion", "candidates", "cotwin tool export h.json --"}).out, HasSubstr("--change"));
}

}  // namespace
}  // namespace program_test
