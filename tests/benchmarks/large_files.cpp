// Files with a million elements of each kind. `large_files` measures the time and memory that the program takes to read them;
// `large_files FOLDER [N]` writes them, so that commands can be tried on them.
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include "fmu/archive/archive.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/bag_writer.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace {

namespace fs = std::filesystem;
using namespace cotwin;

/// The bouncing ball of tests/fmu with n more variables, which are all aliases of its height.
void write_fmu(const fs::path& folder, std::size_t n) {
  std::ifstream in(cotwin::places::source() + "/tests/fmu/fmus/ball2.xml");
  std::string xml{std::istreambuf_iterator<char>(in), {}}, more;
  for (std::size_t i = 0; i < n; ++i) {
    const std::string k = std::to_string(i);
    more += "<ScalarVariable name=\"plant.part" + k +
            ".height\" valueReference=\"1\" causality=\"output\" variability=\"continuous\" "
            "description=\"height of part " +
            k + "\"><Real unit=\"m\"/></ScalarVariable>\n";
  }
  std::string outputs;
  for (std::size_t i = 0; i < n; ++i) outputs += "<Unknown index=\"" + std::to_string(15 + i) + "\"/>";
  xml.insert(xml.find("</ModelVariables>"), more);
  xml.insert(xml.find("</Outputs>"), outputs);
  xml.insert(xml.find("<ModelVariables>"), "<UnitDefinitions><Unit name=\"m\"><BaseUnit m=\"1\"/></Unit></UnitDefinitions>");
  fmu::write_archive(
      folder / "variables.fmu",
      std::vector<fmu::ArchiveFile>{{"modelDescription.xml", xml},
                                    {"binaries/linux64/ball.so", fs::path(cotwin::places::foreign_libraries()) / "ball2.so"}});
}

void write_events(const fs::path& folder, std::size_t n) {
  std::ofstream out(folder / "events.ssd");
  out << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="events" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="events">
    <ssd:Elements><ssd:Component name="drive" source="unit:drive_train?robot=planar2" type="application/x-cotwin-unit"/></ssd:Elements>
    <ssd:Annotations><ssc:Annotation type="cotwin.master"><c:Master xmlns:c="urn:cotwin:master:1" tick="0.001">
)";
  for (std::size_t i = 0; i < n; ++i) {
    out << "      <c:Event time=\"" << static_cast<double>(i) / static_cast<double>(n) << "\" variable=\"drive.tau_m["
        << 1 + i % 2 << "]\" value=\"" << i % 10 << '"' << (i % 4 == 0 ? " ramp=\"1 ms\"" : "") << "/>\n";
  }
  out << "    </c:Master></ssc:Annotation></ssd:Annotations>\n  </ssd:System>\n</ssd:SystemStructureDescription>\n";
}

/// A log of planar2 among n other columns.
void write_columns(const fs::path& folder, std::size_t n) {
  std::ofstream csv(folder / "columns.csv");
  csv << "t,q1,q2";
  for (std::size_t c = 0; c < n; ++c) csv << ",signal" << c;
  csv << '\n';
  for (int row = 0; row < 5; ++row) {
    csv << 0.1 * row << "," << 0.01 * row << ",0";
    for (std::size_t c = 0; c < n; ++c) csv << ',' << c % 100;
    csv << '\n';
  }
  std::ofstream(folder / "columns.ssd") << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="columns" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="columns"><ssd:Elements>
    <ssd:Component name="recording" source="unit:io?robot=planar2" type="application/x-cotwin-unit"><ssd:ParameterBindings><ssd:ParameterBinding>
      <ssd:ParameterValues><ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>
        <ssv:Parameter name="file"><ssv:String value="columns.csv"/></ssv:Parameter>
      </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>
    </ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>
  </ssd:Elements></ssd:System>
</ssd:SystemStructureDescription>
)";
}

/// 1 GB of joint states for n = 10⁶, in chunks of 768 kB as rosbag2 writes them.
void write_bag(const fs::path& folder, std::size_t n) {
  constexpr std::size_t kPerChunk = 2200;
  const std::vector<std::string> joints = {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
                                           "wrist_1_joint",      "wrist_2_joint",       "wrist_3_joint"};
  testing::McapWriter bag(true);
  const std::uint16_t topic = bag.channel("/joint_states", "sensor_msgs/msg/JointState");
  std::vector<double> values(joints.size());
  for (std::size_t k = 0; k < 3 * n; ++k) {
    for (std::size_t j = 0; j < values.size(); ++j) values[j] = std::sin(0.001 * static_cast<double>(k * (j + 1)));
    const auto time = static_cast<std::int64_t>(k * 2'000'000 + 1);
    bag.message(topic, time, testing::joint_state(time, joints, values, values, values));
    if (k % kPerChunk == kPerChunk - 1 || k == 3 * n - 1) bag.end_chunk();
  }
  std::ofstream(folder / "joints.mcap", std::ios::binary) << bag.file();
}

struct Cost {
  double seconds = 0;  // CPU time
  double megabytes = 0;
  bool done = false;
};

Cost run(const fs::path& folder, const std::vector<std::string>& arguments) {
  const auto ran = testing::run_program(arguments, {.folder = folder, .out = "/dev/null", .limit = std::chrono::seconds(600)});
  return {ran.cpu, static_cast<double>(ran.memory) / 1024, ran.code == 0};
}

/// Measures a command; a figure with the goal 0 is not printed. Returns whether it succeeded.
bool report(const fs::path& folder, const std::string& name, const std::vector<std::string>& arguments, double seconds,
            double megabytes) {
  const Cost cost = run(folder, arguments);
  if (seconds > 0) benchmark::print({name, "s", cost.seconds, "", 0, seconds, false});
  if (megabytes > 0) benchmark::print({name + ", peak memory", "MB", cost.megabytes, "", 0, megabytes, false});
  return cost.done;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 3) {
    std::cerr << "large_files [FOLDER [N]]: without FOLDER, measures the cost of a million elements of each kind\n";
    return 2;
  }
  const bool measures = argc < 2;
  const fs::path folder = measures ? fs::temp_directory_path() / ("cotwin_large_files_" + std::to_string(getpid())) : argv[1];
  const std::size_t n = argc == 3 ? std::strtoull(argv[2], nullptr, 10) : benchmark::shortened<std::size_t>(1'000'000, 10'000);
  fs::create_directories(folder);
  write_fmu(folder, n);
  write_events(folder, n);
  write_columns(folder, n);
  write_bag(folder, n);
  if (!measures) return 0;
  bool done = report(folder, "FMU of 1e6 variables, cotwin info", {"info", "variables.fmu"}, 3, 1500);
  done = report(folder, "FMU of 1e6 variables, cotwin check", {"check", "variables.fmu"}, 0, 1500) && done;
  done = report(folder, "1e6 events, cotwin check", {"check", "events.ssd"}, 3, 0) && done;
  done = report(folder, "1e6 CSV columns, cotwin run, 1 tick", {"run", "columns.ssd", "--stop", "0.001", "--quiet"}, 5, 1000) &&
         done;
  done =
      report(folder, "1 GB bag of joint states, cotwin info --csv", {"info", "joints.mcap", "--csv", "joints.csv"}, 10, 300) &&
      done;
  fs::remove_all(folder);
  return done ? 0 : 1;
}
