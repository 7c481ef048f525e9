#include "models/bag/bag.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/trajectory/series/recording_reader.h"
#include "tests/support/bag_writer.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::bag::bag_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::joint_state;
using cotwin::testing::McapWriter;
using cotwin::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr const char* kJointState = "sensor_msgs/msg/JointState";
constexpr std::int64_t kStart = 1'700'000'000'000'000'000, kStep = 4'000'000;  // ns

struct Rows {
  std::vector<std::string> names, notes;
  std::vector<std::vector<double>> values;
};

Rows rows_of(const fs::path& file, const std::string& topic = "") {
  start();
  const std::unique_ptr<csv::Source> table = csv::open(file, {.topic = topic});
  Rows rows{table->names(), {}, {}};
  while (table->next()) {
    rows.values.emplace_back();
    for (std::size_t c = 0; c < rows.names.size(); ++c) rows.values.back().push_back(table->real(c));
  }
  rows.notes = table->notes();
  return rows;
}

std::string error_of(const fs::path& file, const std::string& topic = "") {
  try {
    rows_of(file, topic);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

/// The committed files, in a folder that may be written: SQLite puts the index of a log beside it.
class Files : public ::testing::TestWithParam<const char*> {
 public:
  Files() : folder("bags") {
    fs::copy(places::source() + "/tests/models/bag/files", folder.path(), fs::copy_options::recursive);
  }
  const TemporaryFolder folder;
};

TEST_P(Files, OfOtherWritersHaveTheValuesToTheBitInTheOrderOfTime) {
  const Rows rows = rows_of(folder / GetParam());
  EXPECT_THAT(rows.names,
              ElementsAre("t", "position_arm", "position_lift", "velocity_arm", "velocity_lift", "effort_arm", "effort_lift"));
  ASSERT_EQ(rows.values.size(), 60u);
  for (int i = 0; i < 60; ++i)
    EXPECT_THAT(rows.values[static_cast<std::size_t>(i)],
                ElementsAre(static_cast<double>(i * kStep) / 1e9, 0.1 * i, 0.001 * i, 25 + i, 0.25, 1.0 / (i + 1), -9.81))
        << i;
  EXPECT_THAT(rows.notes, ElementsAre(HasSubstr("/joint_states: times are the stamps of the messages")));
}

INSTANTIATE_TEST_SUITE_P(All, Files,
                         ::testing::Values("indexed.mcap", "plain.mcap", "lz4.mcap", "zstd.mcap", "mixed.mcap", "humble.db3",
                                           "jazzy.db3", "killed.db3"),
                         [](const auto& file) {
                           return std::string(file.param).replace(std::string(file.param).find('.'), 1, "_");
                         });

using BagFiles = Files;

TEST_F(BagFiles, OfOtherTypesHaveAColumnPerNumber) {
  const Rows own = rows_of(folder / "zstd.mcap", "/motor");
  EXPECT_THAT(own.names, ElementsAre("t", "temperature", "brakes[0]", "brakes[1]", "brakes[2]", "codes[0]", "codes[1]",
                                     "ends[0].x", "ends[0].y", "ends[1].x", "ends[1].y"));
  ASSERT_EQ(own.values.size(), 6u);
  EXPECT_THAT(own.values[4], ElementsAre(0.16, 60.5, 1, 0, 1, 40, -40, 40, 1, 2, 3));
  const Rows wrench = rows_of(folder / "humble.db3", "/wrench");
  EXPECT_THAT(wrench.names, ElementsAre("t", "force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"));
  EXPECT_THAT(wrench.values.at(2), ElementsAre(0.08, 20, 40, 60, 0.5, 0.25, 0.125));
  const Rows command = rows_of(folder / "humble.db3", "/command");
  EXPECT_THAT(command.names,
              ElementsAre("t", "layout.dim[0].size", "layout.dim[0].stride", "layout.data_offset", "data[0]", "data[1]"));
  EXPECT_THAT(command.values.at(3), ElementsAre(0.12, 2, 2, 0, 30, -30));
  EXPECT_THAT(command.notes, ElementsAre(HasSubstr("times are those of the log")));
  EXPECT_THAT(rows_of(folder / "jazzy.db3", "/level").values.at(1), ElementsAre(0.04, 10.5, 1, 7));
  EXPECT_THAT(error_of(folder / "humble.db3", "/level"),
              HasSubstr("humble.db3: /level: has the type own_msgs/msg/Level, whose definition"));
  EXPECT_THAT(error_of(folder / "humble.db3", "/wrenches"),
              AllOf(HasSubstr("has no topic '/wrenches'"), HasSubstr("/wrench (geometry_msgs/msg/WrenchStamped, 6 messages)")));
}

/// Where it ends, and where a byte is another one.
TEST_F(BagFiles, DamagedAreAnErrorThatNamesThem) {
  for (const char* name : {"indexed.mcap", "lz4.mcap", "zstd.mcap", "plain.mcap", "humble.db3"}) {
    const std::string whole = text::read_file(folder / name, "a bag"), place = (folder / "damaged").string();
    const auto is_told = [&](const std::string& bytes) {
      folder.write("damaged", bytes);
      return error_of(place).starts_with(place);
    };
    const std::size_t step = std::string_view(name) == "plain.mcap" ? 1 : 13;
    for (std::size_t length = 16; length < std::min<std::size_t>(whole.size(), 4096); length += step)
      EXPECT_TRUE(is_told(whole.substr(0, length))) << name << " cut at " << length;
    if (std::string_view(name) != "lz4.mcap") continue;
    for (std::size_t at = 8; at < 4096; at += 3) {
      std::string other = whole;
      other[at] = static_cast<char>(other[at] ^ 0x10);
      EXPECT_TRUE(is_told(other)) << name << " byte " << at;
    }
  }
}

class Bags : public ::testing::Test {
 public:
  /// The error for a file with these messages on /joint_states.
  std::string error_for(const std::vector<std::string>& messages) const {
    McapWriter bag;
    const std::uint16_t joints = bag.channel("/joint_states", kJointState);
    std::int64_t time = kStart;
    for (const std::string& message : messages) bag.message(joints, time += kStep, message);
    return error_of(folder.write("bag.mcap", bag.file()));
  }
  const TemporaryFolder folder{"bag"};
};

TEST_F(Bags, MessagesThatCannotBeReadAreNamed) {
  const std::string good = joint_state(kStart, {"a", "b"}, {1, 2}, {}, {3, 4});
  EXPECT_EQ(error_for({good, good}), "no error");
  EXPECT_THAT(error_for({good, joint_state(kStart, {"a", "b"}, {1}, {}, {})}),
              HasSubstr("bag.mcap: /joint_states: message 2: has 1 values of position for 2 joints"));
  EXPECT_THAT(error_for({joint_state(kStart, {"a", "a"}, {1, 2}, {}, {})}), HasSubstr("message 1: has joint 'a' twice"));
  EXPECT_THAT(error_for({good, good.substr(0, good.size() - 3)}), HasSubstr("message 2: ends within a member"));
  EXPECT_THAT(error_for({"\x28\xB5\x2F\xFD...."}), HasSubstr("message 1: is compressed by itself"));
  EXPECT_THAT(error_for({std::string("\0\x07\0\0....", 8)}), HasSubstr("message 1: is not in plain CDR"));
  std::string long_names = good;
  long_names.replace(20, 4, "\xFF\xFF\xFF\x7F");
  EXPECT_THAT(error_for({long_names}), HasSubstr("message 1: has a sequence that is longer than the message"));
  EXPECT_THAT(error_for({}), HasSubstr("0 topics with joints, expected one, or --topic NAME; topics: /joint_states"));
}

TEST_F(Bags, ChunksThatCannotBeReadAreNamed) {
  const auto error = [&](std::uint32_t crc, const std::string& compression, std::int64_t size) {
    McapWriter bag(true);
    bag.message(bag.channel("/joint_states", kJointState), kStart, joint_state(kStart, {"a"}, {1}, {}, {}));
    bag.end_chunk(crc, compression, size);
    return error_of(folder.write("bag.mcap", bag.file()));
  };
  EXPECT_EQ(error(0, "", -1), "no error");
  EXPECT_THAT(error(7, "", -1), HasSubstr("bag.mcap: a chunk whose CRC is another than it says"));
  EXPECT_THAT(error(0, "brotli", -1), HasSubstr("the compression 'brotli', expected none, lz4 or zstd"));
  for (const char* compression : {"", "lz4", "zstd"}) {
    EXPECT_THAT(error(0, compression, 1 << 20), HasSubstr("a chunk whose ")) << compression;
    EXPECT_THAT(error(0, compression, std::int64_t{1} << 31), HasSubstr("a chunk of 2147483648 bytes, expected at most"))
        << compression;
  }
  McapWriter undeclared;
  undeclared.message(3, kStart, joint_state(kStart, {"a"}, {1}, {}, {}));
  EXPECT_THAT(error_of(folder.write("bag.mcap", undeclared.file())), HasSubstr("a channel that is not declared"));
  EXPECT_THAT(error_of(folder.write("one.bag", "#ROSBAG V2.0\n................")),
              HasSubstr("is a bag of ROS 1, expected one of ROS 2: rosbags-convert"));
  for (const char* encoding : {"protobuf", "json"}) {
    McapWriter other;
    other.message(other.channel("/joint_states", kJointState, encoding), kStart, "{}");
    EXPECT_THAT(error_of(folder.write("bag.mcap", other.file())),
                HasSubstr(std::string("is encoded as '") + encoding + "', expected cdr"));
  }
}

TEST_F(Bags, DefinitionsThatCannotBeReadAreNamed) {
  const auto error = [&](const std::string& definition) {
    McapWriter bag;
    bag.message(bag.channel("/own", "own/msg/Own", "cdr", definition), kStart,
                std::string("\0\1\0\0", 4) + std::string(64, '\0'));
    return error_of(folder.write("bag.mcap", bag.file()), "/own");
  };
  EXPECT_EQ(error("float64 x\nOther y\n====\nMSG: own/Other\nint8 z\n"), "no error");
  EXPECT_THAT(error("wstring name\n"), HasSubstr("/own: has a member 'name' of the type wstring"));
  EXPECT_THAT(error("Other y\n"), HasSubstr("has members of the type own/Other, whose definition is not in the file"));
  EXPECT_THAT(error("float64\n"), HasSubstr("the line 'float64', expected a type and a name"));
  EXPECT_THAT(error("Own again\n"), HasSubstr("has a type that contains itself"));
  EXPECT_THAT(error("uint8[99999999] pixels\n"), HasSubstr("expected at most 10000 elements"));
}

/// An arm's messages and, on the same topic, those of its gripper; the joints in another order than the robot's.
TEST_F(Bags, JointsAreFoundByNameAndMessagesOfOthersAreLeftOut) {
  McapWriter bag;
  const std::uint16_t arm = bag.channel("/joint_states", kJointState), other = bag.channel("/tool/joint_states", kJointState);
  for (int i = 0; i < 10; ++i) {
    bag.message(arm, kStart + i * kStep, joint_state(0, {"elbow", "base"}, {10.0 + i, 20.0 + i}, {}, {1, 2}));
    if (i % 3 == 0) bag.message(arm, kStart + i * kStep + 1, joint_state(0, {"finger"}, {0.01}, {0}, {5}));
  }
  bag.message(other, kStart, joint_state(kStart, {"base", "elbow"}, {0, 0}, {}, {}));
  const fs::path file = folder.write("bag.mcap", bag.file());
  EXPECT_THAT(error_of(file), HasSubstr("2 topics with joints, expected one, or --topic NAME; topics: /joint_states "
                                        "(sensor_msgs/msg/JointState, 14 messages)"));
  std::vector<trajectory::Axis> axes = trajectory::free_axes(2);
  axes[0].name = "base";
  axes[1].name = "elbow";
  trajectory::RecordingFormat format;
  format.topic = "/joint_states";
  trajectory::RecordingReader reader(file, axes, format);
  for (int i = 0; i < 10; ++i) {
    ASSERT_TRUE(reader.next());
    EXPECT_EQ(reader.t(), static_cast<double>(i * kStep) / 1e9);
    EXPECT_THAT(reader.q().value, ElementsAre(20 + i, 10 + i));
    EXPECT_THAT(reader.tau().value, ElementsAre(2, 1));
    EXPECT_FALSE(reader.dq().present());
  }
  EXPECT_EQ(reader.place(), file.string() + ": /joint_states: message 13");
  EXPECT_FALSE(reader.next());
  EXPECT_THAT(
      reader.table().notes(),
      ElementsAre(
          HasSubstr("times are those of the log, as 14 messages of 14 have no stamp"), HasSubstr("name 2 sets of joints"),
          HasSubstr("4 messages without a value of one of the joints left out, the first is message 2"),
          "effort of /joint_states is taken as N.m; drivers of UR report currents (--tau-scale) or torques less gravity"));
}

/// Joints 2 and 1, another order in each message, velocities in some, and a topic that cannot be read.
TEST_F(Bags, JointsWhoseNamesAreNumbersAreThoseOfTheirNames) {
  McapWriter bag;
  const std::uint16_t joints = bag.channel("/joint_states", kJointState), other = bag.channel("/gripper", kJointState);
  for (int i = 0; i < 40; ++i) {
    std::vector<std::string> names = {"1", "2"};
    for (int k = 0; k < 6; ++k) names.push_back("x" + std::to_string(k));
    std::rotate(names.begin(), names.begin() + i % 8, names.end());
    std::vector<double> q;
    for (const std::string& name : names) q.push_back(name == "1" ? 100 + i : name == "2" ? 200 + i : 0);
    bag.message(joints, kStart + i * kStep, joint_state(0, names, q, i % 5 == 0 ? q : std::vector<double>{}, {}));
  }
  bag.message(other, kStart, joint_state(0, {"finger"}, {1, 2}, {}, {}));
  const fs::path file = folder.write("bag.mcap", bag.file());
  EXPECT_THAT(error_of(file, "/gripper"), HasSubstr("/gripper: message 1: has 2 values of position for 1 joints"));
  std::vector<trajectory::Axis> axes = trajectory::free_axes(2);
  axes[0].name = "2";
  axes[1].name = "1";
  trajectory::RecordingFormat format;
  format.topic = "/joint_states";
  trajectory::RecordingReader reader(file, axes, format);
  for (int i = 0; i < 40; ++i) {
    ASSERT_TRUE(reader.next());
    EXPECT_THAT(reader.q().value, ElementsAre(200 + i, 100 + i));
  }
  EXPECT_FALSE(reader.next());
  EXPECT_THAT(reader.table().notes(), Contains(HasSubstr("velocities are not in all messages")));
  EXPECT_THAT(reader.table().notes(), Not(Contains(HasSubstr("sets of joints"))));
}

TEST_F(Bags, ArraysOfOtherLengthsAreAnErrorAlsoWithAsManyNumbers) {
  McapWriter bag;
  const std::uint16_t own = bag.channel("/own", "own/msg/Own", "cdr", "float64[] a\nfloat64[] b\n");
  bag.message(own, kStart, cotwin::testing::Cdr().reals({1, 2}).reals({10}).bytes);
  bag.message(own, kStart + kStep, cotwin::testing::Cdr().reals({1}).reals({10, 20}).bytes);
  EXPECT_THAT(error_of(folder.write("bag.mcap", bag.file()), "/own"),
              HasSubstr("/own: message 2: has 3 numbers in arrays of other lengths"));
}

TEST_F(Bags, TopicsMayBeginAnywhere) {
  McapWriter bag;
  std::vector<std::uint16_t> topics;
  for (int k = 0; k < 40; ++k) {
    topics.push_back(bag.channel("/joints_" + std::to_string(k), kJointState));
    for (std::size_t i = 0; i < topics.size(); ++i)
      bag.message(topics[i], kStart + k * kStep,
                  joint_state(kStart, {"a" + std::to_string(i)}, {100.0 * static_cast<double>(i) + k}, {}, {}));
  }
  const fs::path file = folder.write("bag.mcap", bag.file());
  EXPECT_EQ(topics_of(file).size(), 40u);
  const Rows rows = rows_of(file, "/joints_7");
  EXPECT_THAT(rows.names, ElementsAre("t", "position_a7"));
  ASSERT_EQ(rows.values.size(), 33u);
  for (int k = 7; k < 40; ++k) EXPECT_EQ(rows.values[static_cast<std::size_t>(k - 7)][1], 700 + k);
}

TEST_F(Bags, TimesThatGoBackAndUnknownValuesAreErrorsOfTheirMessages) {
  std::vector<trajectory::Axis> axes = trajectory::free_axes(1);
  axes[0].name = "a";
  const auto error = [&](std::int64_t second, double q) -> std::string {
    McapWriter bag;
    const std::uint16_t joints = bag.channel("/joint_states", kJointState);
    bag.message(joints, kStart, joint_state(kStart, {"a"}, {1}, {}, {}));
    bag.message(joints, kStart + kStep, joint_state(second, {"a"}, {q}, {}, {}));
    const fs::path file = folder.write("bag.mcap", bag.file());
    try {
      trajectory::load_recording(file, axes);
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  };
  EXPECT_EQ(error(kStart + kStep, 1), "no error");
  EXPECT_THAT(error(kStart - kStep, 1),
              HasSubstr("/joint_states: message 2: column 't': -0.004 is before the time on message 1"));
  EXPECT_THAT(error(kStart + kStep, std::nan("")),
              HasSubstr("/joint_states: message 2: column 'position_a': nan, expected a finite number"));
}

TEST_F(Bags, SplitsOfAFolderAreReadInTheirOrder) {
  const fs::path bag = folder / "log";
  fs::create_directory(bag);
  for (int k = 0; k < 12; ++k) {
    McapWriter part(k % 2 == 0);
    const std::uint16_t joints = part.channel("/joint_states", kJointState);
    part.message(joints, kStart + k * kStep, joint_state(0, {"a"}, {static_cast<double>(k)}, {}, {}));
    if (k % 2 == 0) part.end_chunk();
    folder.write("log/log_" + std::to_string(k) + ".mcap", part.file());
  }
  folder.write("log/metadata.yaml", "rosbag2_bagfile_information:\n");
  const Rows rows = rows_of(bag);
  ASSERT_EQ(rows.values.size(), 12u);
  for (int k = 0; k < 12; ++k)
    EXPECT_THAT(rows.values[static_cast<std::size_t>(k)], ElementsAre(static_cast<double>(k * kStep) / 1e9, k));
  folder.write("log/log_12.mcap.zstd", "");
  EXPECT_THAT(error_of(bag), HasSubstr("is a compressed file of a bag, expected it as it was: zstd -d"));
}

TEST(PublicBags, HaveTheNumbersOfTheirTables) {
  const fs::path fetched = places::source() + "/build/public_data/fetched";
  if (!fs::exists(fetched)) GTEST_SKIP() << "scripts/fetch_logs.py has not fetched them";
  for (const auto& [name, n] : {std::pair{"panda", 7}, {"ur10", 6}}) {
    const Rows rows = rows_of(fetched / (std::string(name) + "_exciting_trajectory.db3"));
    const csv::Table table = csv::load(places::public_data(std::string("measurements/") + name + "_unisa.csv"));
    ASSERT_EQ(rows.values.size(), table.rows());
    ASSERT_EQ(rows.names.size(), table.names.size());
    for (std::size_t c = 1; c < rows.names.size(); ++c)
      for (std::size_t k = 0; k < rows.values.size(); ++k) {
        std::array<char, 40> digits{};
        std::snprintf(digits.data(), digits.size(), "%.7g", rows.values[k][c]);
        EXPECT_EQ(std::strtod(digits.data(), nullptr), table.columns[c][k]) << name << ' ' << rows.names[c] << ' ' << k;
      }
  }
}

}  // namespace
}  // namespace cotwin::bag::bag_test
