// Runs the program on damaged and malicious files: it ends by itself within limits of time and memory, and names the faulty
// file.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "fmu/archive/archive.h"
#include "tests/hostile/hostile_files.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::hostile::hostile_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::RunOptions;
using cotwin::testing::RunResult;
using ::testing::HasSubstr;
using Arguments = std::vector<std::string>;

constexpr rlim_t kCpuSeconds = 10;
constexpr std::chrono::seconds kWallTime{300};  // the machine may be busy with other processes
constexpr long kMemory = 1l << 20;              // KiB
const bool kSanitized = std::string(COTWIN_SANITIZERS) != "";

class Hostile : public ::testing::Test {
 protected:
  Hostile() {
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "temporary");
    write("arm.urdf", content(source("models/robots/planar2/robot.urdf")));
  }
  ~Hostile() override { fs::remove_all(folder_); }

  static fs::path source(const std::string& name) { return fs::path(places::source()) / name; }
  void write(const std::string& name, const std::string& bytes) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }

  RunResult run(Arguments arguments) const {
    RunOptions options{.folder = folder_,
                       .environment = {"TMPDIR=" + (folder_ / "temporary").string(), "ASAN_OPTIONS=exitcode=98:detect_leaks=0",
                                       "UBSAN_OPTIONS=exitcode=98"},
                       .merge = true,
                       .limit = kWallTime};
    options.prepare = [] {
      const rlim_t seconds = kSanitized ? 10 * kCpuSeconds : kCpuSeconds;
      const rlimit cpu{seconds, seconds + 1}, core{0, 0};
      return setrlimit(RLIMIT_CPU, &cpu) == 0 && setrlimit(RLIMIT_CORE, &core) == 0;
    };
    return cotwin::testing::run_program(std::move(arguments), options);
  }

  /// Checks how the program ended; `name`: of the file, which a message must contain.
  void expect_orderly(const Arguments& arguments, const std::string& name, bool never_good, const std::string& what) const {
    const RunResult r = run(arguments);
    std::string command;
    for (const std::string& a : arguments) command += " " + a;
    SCOPED_TRACE("cotwin" + command + " (" + what + "), output:\n" + r.out.substr(0, 1000));
    EXPECT_TRUE(r.code == 0 || r.code == 1 || r.code == 2) << "it ended with " << r.code;
    if (never_good) {
      EXPECT_NE(r.code, 0);
    }
    // `check` lists what it finds in its one file; a wrong value may be detected in the scenario that uses it.
    if (r.code == 2 && arguments[0] != "check" && (never_good || arguments[0] != "tune")) {
      EXPECT_THAT(r.out, ::testing::AnyOf(HasSubstr(name), HasSubstr(".ssd:")));
    }
    if (r.code != 0) {
      EXPECT_FALSE(r.out.empty());
    }
    if (!kSanitized) {
      EXPECT_LE(r.memory, kMemory);
    }
    EXPECT_TRUE(fs::is_empty(folder_ / "temporary"));
  }

  /// Runs all commands on each variant, under a name of its own.
  template <class Commands>
  void try_variants(const std::string& good, const std::string& ending, std::size_t count, std::uint64_t seed, bool part_is_bad,
                    bool is_text, Commands commands) const {
    write("good" + ending, good);
    for (const Arguments& arguments : commands("good" + ending)) {
      const RunResult r = run(arguments);
      ASSERT_EQ(r.code, 0) << arguments[0] << " of a valid file: " << r.out;
    }
    const std::vector<File> files = variants(good, count, seed, part_is_bad, is_text);
    for (std::size_t i = 0; i < files.size(); ++i) {
      const std::string name = "hostile" + std::to_string(i) + ending;
      write(name, files[i].bytes);
      for (const Arguments& arguments : commands(name)) {
        expect_orderly(arguments, name, files[i].never_good, files[i].what);
        if (HasFatalFailure()) return;
      }
      fs::remove(folder_ / name);
    }
  }

  /// Runs all commands on things that are not regular files.
  template <class Commands>
  void try_no_files(const std::string& ending, Commands commands) const {
    const std::string fifo = "fifo" + ending, folder = "folder" + ending, device = "device" + ending, none = "none" + ending,
                      broken = "broken" + ending;
    ASSERT_EQ(mkfifo((folder_ / fifo).c_str(), 0600), 0);
    fs::create_directory(folder_ / folder);
    fs::create_symlink("/dev/zero", folder_ / device);
    fs::create_symlink("nowhere", folder_ / broken);
    for (const std::string& name : {fifo, folder, device, none, broken}) {
      for (const Arguments& arguments : commands(name)) expect_orderly(arguments, name, true, "no file");
    }
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_hostile_" + std::to_string(getpid()));
};

constexpr const char* kHead = R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="hostile" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
)";

std::string ssd(const std::string& elements, const std::string& more = "") {
  return std::string(kHead) + "<ssd:System name=\"hostile\">\n<ssd:Elements>\n" + elements + "\n</ssd:Elements>\n" + more +
         "</ssd:System>\n</ssd:SystemStructureDescription>\n";
}

/// A component with one text parameter.
std::string component(const std::string& name, const std::string& source, const std::string& parameter = "",
                      const std::string& value = "") {
  std::string bindings;
  if (!parameter.empty()) {
    bindings =
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version=\"1.0\" name=\"p\">"
        "<ssv:Parameters><ssv:Parameter name=\"" +
        parameter + "\"><ssv:String value=\"" + value +
        "\"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>"
        "</ssd:ParameterBindings>";
  }
  return "<ssd:Component name=\"" + name + "\" source=\"" + source + "\" type=\"application/x-cotwin-unit\">" + bindings +
         "</ssd:Component>";
}

const std::string kSystem = ssd(
    component("motion", "unit:motion?robot=arm.urdf&amp;kind=polynomial", "q_end", "0.5 -0.5") +
        component("drive", "unit:drive_train?robot=arm.urdf"),
    R"(<ssd:Connections><ssd:Connection startElement="motion" startConnector="q_d[1]" endElement="drive" endConnector="tau_e[1]" suppressUnitConversion="true"/></ssd:Connections>
<ssd:Annotations><ssc:Annotation type="cotwin.master"><c:Master xmlns:c="urn:cotwin:master:1" tick="0.001" unknownParameters="error">
<c:Component name="drive" stage="1" period="2"/>
<c:Event time="0.0005" variable="drive.tau_m[2]" value="3" ramp="1 ms"/>
<c:Recording decimation="1"><c:Record variables="drive.* motion.q_d"/></c:Recording>
<c:Report kind="signal" a="drive.theta"/>
</c:Master></ssc:Annotation></ssd:Annotations>
)");

constexpr const char* kValues = R"(<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="drive">
  <ssv:Parameters>
    <ssv:Parameter name="K"><ssv:Real value="10000" unit="N.m/rad"/></ssv:Parameter>
    <ssv:Parameter name="K[2]"><ssv:Real value="5" unit="kN.m/rad"/></ssv:Parameter>
    <ssv:Parameter name="B"><ssv:String value="0.2 0.1"/></ssv:Parameter>
  </ssv:Parameters>
</ssv:ParameterSet>
)";

constexpr const char* kScene = R"(<?xml version="1.0"?>
<sdf version="1.9">
  <world name="w">
    <gravity>0 0 -9.81</gravity>
    <model name="ground"><static>true</static><link name="l"><collision name="c"><geometry><plane><normal>0 0 1</normal></plane></geometry></collision></link></model>
    <model name="box"><pose>0 0 0.5 0 0 0.1</pose><link name="l"><inertial><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>
      <collision name="c"><geometry><box><size>0.2 0.3 0.4</size></box></geometry></collision></link></model>
    <model name="ball"><pose>1 0 0.5 0 0 0</pose><link name="l"><inertial auto="true"/>
      <collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision></link></model>
  </world>
</sdf>
)";

Arguments short_run(const std::string& file) { return {"run", file, "--stop", "0.002", "--out", "out", "--quiet"}; }

TEST_F(Hostile, SystemStructuresEndWithAMessage) {
  const auto commands = [](const std::string& file) {
    return std::vector<Arguments>{{"check", file}, {"info", file}, short_run(file)};
  };
  try_variants(kSystem, ".ssd", 50, 1, true, true, commands);
  try_no_files(".ssd", commands);
}

TEST_F(Hostile, ParameterSetsEndWithAMessage) {
  const auto commands = [this](const std::string& file) {
    write("system.ssd",
          ssd("<ssd:Component name=\"drive\" source=\"unit:drive_train?robot=arm.urdf\" type=\"application/x-cotwin-unit\">"
              "<ssd:ParameterBindings><ssd:ParameterBinding source=\"" +
              file + "\"/></ssd:ParameterBindings></ssd:Component>"));
    return std::vector<Arguments>{short_run("system.ssd"),
                                  {"perturb", "--robot", "arm.urdf", "--parameters", file, "-o", "other"}};
  };
  try_variants(kValues, ".ssv", 40, 2, true, true, commands);
  try_no_files(".ssv", commands);
}

TEST_F(Hostile, RobotsEndWithAMessage) {
  write("arm.ssd", ssd(component("drive", "unit:drive_train")));
  const auto commands = [](const std::string& file) {
    Arguments run = short_run("arm.ssd");
    run.insert(run.end(), {"--set", "robot=" + file});
    return std::vector<Arguments>{run, {"perturb", "--robot", file, "-o", "other"}};
  };
  try_variants(content(folder_ / "arm.urdf"), ".urdf", 40, 3, true, true, commands);
  try_no_files(".urdf", commands);
}

TEST_F(Hostile, ScenesEndWithAMessage) {
  write("world.ssd", ssd(component("world", "unit:contact_world")));
  const auto commands = [](const std::string& file) {
    Arguments run = short_run("world.ssd");
    run.insert(run.end(), {"--set", "scene=" + file});
    return std::vector<Arguments>{run};
  };
  try_variants(kScene, ".sdf", 50, 4, true, true, commands);
  try_no_files(".sdf", commands);
}

TEST_F(Hostile, MeshesEndWithAMessage) {
  write("world.ssd", ssd(component("world", "unit:contact_world?scene=mesh.sdf")));
  const auto commands = [this](const std::string& file) {
    write(
        "mesh.sdf",
        "<sdf version=\"1.9\"><world name=\"w\"><model name=\"m\"><static>true</static><link name=\"l\"><collision name=\"c\">"
        "<geometry><mesh><uri>" +
            file + "</uri></mesh></geometry></collision></link></model></world></sdf>");
    return std::vector<Arguments>{short_run("world.ssd")};
  };
  std::string points, binary(80, ' ');
  for (int i = 0; i < 200; ++i)
    points += "v " + std::to_string(std::sin(i)) + " " + std::to_string(std::cos(2 * i)) + " " +
              std::to_string(std::sin(3 * i)) + "\n";
  try_variants(points, ".obj", 20, 5, false, true, commands);
  const std::uint32_t triangles = 100;
  binary.append(reinterpret_cast<const char*>(&triangles), sizeof triangles);
  for (std::uint32_t i = 0; i < triangles; ++i) {
    for (int k = 0; k < 12; ++k) {
      const float x = std::sin(static_cast<float>(i) * 1.3f + static_cast<float>(k) * 2.1f);
      binary.append(reinterpret_cast<const char*>(&x), sizeof x);
    }
    binary += std::string(2, '\0');
  }
  try_variants(binary, ".stl", 20, 6, false, false, commands);
  try_no_files(".stl", commands);
}

/// A log of the arm at 100 Hz.
std::string log() {
  std::string csv = "t,q1,q2,tau1,tau2\n";
  for (int i = 0; i < 1000; ++i) {
    const double t = 0.01 * i;
    csv += std::to_string(t);
    for (const double x : {std::sin(1.1 * t), std::sin(1.7 * t), 20 * std::cos(t), 5 * std::cos(1.7 * t)})
      csv += "," + std::to_string(x);
    csv += "\n";
  }
  return csv;
}

TEST_F(Hostile, TablesEndWithAMessage) {
  const auto commands = [this](const std::string& file) {
    write("log.ssd", ssd(component("recording", "unit:io?robot=arm.urdf", "file", file)));
    return std::vector<Arguments>{short_run("log.ssd"),
                                  {"tune", "--robot", "arm.urdf", "--data", file, "--method", "least-squares", "--friction",
                                   "none", "--out", "tuned", "--threads", "1", "--accept-data", "--cutoff", "5", "--quiet"}};
  };
  try_variants(log(), ".csv", 50, 7, false, true, commands);
  try_no_files(".csv", commands);
}

TEST_F(Hostile, StoppedTuningsEndWithAMessage) {
  const std::string good = content(source("tests/fuzz/corpus/resume/small.json"));
  const std::vector<File> files = variants(good, 20, 8, true, true);
  for (const File& file : files) {
    write("stopped/resume.json", file.bytes);
    expect_orderly({"tune", "--resume", "stopped", "--quiet"}, "resume.json", file.never_good, file.what);
  }
  fs::remove(folder_ / "stopped/resume.json");
  ASSERT_EQ(mkfifo((folder_ / "stopped/resume.json").c_str(), 0600), 0);
  expect_orderly({"tune", "--resume", "stopped", "--quiet"}, "resume.json", true, "a FIFO");
}

std::string archive(const fs::path& file, const std::vector<fmu::ArchiveFile>& files) {
  fmu::write_archive(file, files);
  return content(file);
}

std::vector<Arguments> fmu_commands(const std::string& file) {
  return {{"info", file},
          {"check", file},
          {"run", file, "--stop-time", "0.002", "--output-interval", "0.001", "--output-file", "out.csv", "--quiet"}};
}

TEST_F(Hostile, FmusEndWithAMessage) {
  const fs::path library = fs::path(places::foreign_libraries()) / "ball2.so";
  const std::string description = content(source("tests/fmu/fmus/ball2.xml"));
  const auto pack = [&](const std::string& xml) {
    return archive(folder_ / "packed", {{"modelDescription.xml", xml}, {"binaries/linux64/ball.so", library}});
  };
  try_variants(pack(description), ".fmu", 20, 9, true, false, fmu_commands);
  // The contents of the archive are as hostile as the archive.
  const std::vector<File> descriptions = variants(description, 40, 10, true, true);
  for (std::size_t i = 0; i < descriptions.size(); ++i) {
    const std::string name = "inside" + std::to_string(i) + ".fmu";
    write(name, pack(descriptions[i].bytes));
    for (const Arguments& arguments : fmu_commands(name))
      expect_orderly(arguments, name, descriptions[i].never_good, descriptions[i].what);
    fs::remove(folder_ / name);
  }
  try_no_files(".fmu", fmu_commands);
}

TEST_F(Hostile, FmusAboveTheLimitOfExpansionAreRefusedBeforeUnpacking) {
  // 2 GB of modelDescription.xml from 2 MB of archive.
  write("blanks", " ");
  fs::resize_file(folder_ / "blanks", std::uintmax_t{2} << 30);
  fmu::write_archive(folder_ / "large.fmu", std::vector<fmu::ArchiveFile>{{"modelDescription.xml", folder_ / "blanks"}});
  fmu::write_archive(folder_ / "resource.fmu",
                     std::vector<fmu::ArchiveFile>{{"modelDescription.xml", content(source("tests/fmu/fmus/ball2.xml"))},
                                                   {"resources/table.bin", folder_ / "blanks"}});
  fmu::write_archive(
      folder_ / "inner.ssp",
      std::vector<fmu::ArchiveFile>{{"SystemStructure.ssd", ssd("<ssd:Component name=\"a\" source=\"large.fmu\"/>")},
                                    {"large.fmu", folder_ / "large.fmu"}});
  fs::remove(folder_ / "blanks");
  std::vector<Arguments> all = {short_run("inner.ssp"), {"check", "inner.ssp"}, {"pack", "inner.ssp", "-o", "p.ssp"}};
  for (const char* name : {"large.fmu", "resource.fmu"}) {
    for (const Arguments& arguments : fmu_commands(name)) all.push_back(arguments);
  }
  for (const Arguments& arguments : all) {
    SCOPED_TRACE(arguments[0] + " " + arguments[1]);
    const RunResult r = run(arguments);
    EXPECT_EQ(r.code, 2) << r.out;
    EXPECT_THAT(r.out, HasSubstr("expected at most"));
    if (!kSanitized) {
      EXPECT_LE(r.memory, 200l << 10);
    }
  }
}

TEST_F(Hostile, PackagesEndWithAMessage) {
  const std::string package =
      archive(folder_ / "packed",
              {{"SystemStructure.ssd", ssd("<ssd:Component name=\"drive\" source=\"unit:drive_train?robot=arm.urdf\">"
                                           "<ssd:ParameterBindings><ssd:ParameterBinding source=\"resources/v.ssv\"/>"
                                           "</ssd:ParameterBindings></ssd:Component>")},
               {"resources/v.ssv", std::string(kValues)},
               {"arm.urdf", content(folder_ / "arm.urdf")}});
  const auto commands = [](const std::string& file) {
    return std::vector<Arguments>{{"check", file}, {"info", file}, short_run(file)};
  };
  try_variants(package, ".ssp", 20, 11, true, false, commands);
  try_no_files(".ssp", commands);
}

}  // namespace
}  // namespace cotwin::hostile::hostile_test
