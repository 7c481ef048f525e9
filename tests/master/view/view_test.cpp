// The C++ side of `cotwin view`: packing of numbers, recordings as they are left behind, what is on the stage.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <Eigen/Dense>
#include <bit>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "components/unit/unit_table.h"
#include "master/engine/wiring/members.h"
#include "master/run/columns.h"
#include "master/scenario/scenario.h"
#include "master/scenery/recorded.h"
#include "master/scenery/scenery.h"
#include "master/view/calculated.h"
#include "master/view/packer.h"
#include "master/view/stage_json.h"
#include "models/cloud/cloud_file.h"
#include "models/cloud/sample.h"
#include "models/foundation/support/error.h"
#include "models/robot/indices.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/shapes.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::master::view_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using cotwin::testing::TemporaryFile;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinity = std::numeric_limits<double>::infinity();

std::string bytes_of_base64(const std::string& text) {
  std::string bytes;
  unsigned group = 0, digits = 0;
  for (const char c : text) {
    const unsigned digit = c >= 'A' && c <= 'Z'   ? static_cast<unsigned>(c - 'A')
                           : c >= 'a' && c <= 'z' ? static_cast<unsigned>(c - 'a' + 26)
                           : c >= '0' && c <= '9' ? static_cast<unsigned>(c - '0' + 52)
                           : c == '+'             ? 62u
                                                  : 63u;
    if (c == '=') break;
    group = group << 6 | digit;
    if (++digits % 4 != 0) continue;
    for (const int shift : {16, 8, 0}) bytes += static_cast<char>(group >> shift & 255);
    group = 0;
  }
  return bytes;
}

/// Reads a stream as the page does (page/source/packed.ts).
std::vector<double> unpacked(const Packer& packer, const Packer::Json& stream) {
  const std::string all = bytes_of_base64(packer.base64());
  const std::size_t n = stream["count"], width = stream["kind"] == "whole" ? 7 : 4;
  std::vector<unsigned char> bytes(width * n);
  uLongf size = static_cast<uLongf>(bytes.size());
  EXPECT_EQ(stream["at"].get<std::size_t>() % 3, 0u);
  EXPECT_EQ(uncompress(bytes.data(), &size, reinterpret_cast<const Bytef*>(all.data()) + stream["at"].get<std::size_t>(),
                       stream["size"].get<uLong>()),
            Z_OK);
  EXPECT_EQ(size, bytes.size());
  std::vector<std::int64_t> whole(n);
  for (std::size_t i = 0; i < n; ++i) {
    std::uint64_t u = 0;
    for (std::size_t k = width; k-- > 0;) u = u << 8 | bytes[k * n + i];
    whole[i] = static_cast<std::int64_t>(u >> 1) ^ -static_cast<std::int64_t>(u & 1);
  }
  for (int k = 0; k < stream["order"]; ++k) {
    for (std::size_t i = 1; i < n; ++i) whole[i] += whole[i - 1];
  }
  std::vector<double> values(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (stream["kind"] == "whole") {
      values[i] = static_cast<double>(whole[i]);
    } else if (stream["kind"] == "steps") {
      values[i] = stream["least"].get<double>() + stream["step"].get<double>() * static_cast<double>(whole[i]);
    } else {
      const auto bits = static_cast<std::int32_t>(whole[i]);
      values[i] = static_cast<double>(std::bit_cast<float>(bits < 0 ? bits ^ 0x7fffffff : bits));
    }
  }
  for (const auto& gap : stream.value("gaps", Packer::Json::array())) {
    for (std::size_t i = 0; i < gap[1]; ++i)
      values[gap[0].get<std::size_t>() + i] = gap[2] == 0 ? kNan : gap[2] == 1 ? kInfinity : -kInfinity;
  }
  return values;
}

TEST(Packer, KeepsEveryNumberWithinTheStatedShareOfTheRange) {
  std::vector<double> values;
  for (int i = 0; i < 10'000; ++i) values.push_back(3 + 40 * std::sin(1e-3 * i) + 1e-3 * std::cos(i * i));
  Packer packer;
  packer.add_reals(std::vector<double>{1.0});
  const Packer::Json stream = packer.add_reals(values);
  EXPECT_EQ(stream["kind"], "steps");
  const std::vector<double> read = unpacked(packer, stream);
  const auto [least, largest] = std::minmax_element(values.begin(), values.end());
  const double bound = (*largest - *least) / (1 << 24) * (1 + 1e-6);  // rounding of the step
  for (std::size_t i = 0; i < values.size(); ++i) ASSERT_NEAR(read[i], values[i], bound);
}

TEST(Packer, KeepsSmallNumbersBesideAFewHugeOnes) {
  std::vector<double> values;
  for (int i = 0; i < 1000; ++i) values.push_back(i % 100 == 7 ? 1e12 : 4 + std::sin(0.1 * i));  // 1e12: cannot move
  Packer packer;
  const Packer::Json stream = packer.add_reals(values);
  EXPECT_EQ(stream["kind"], "float");
  const std::vector<double> read = unpacked(packer, stream);
  for (std::size_t i = 0; i < values.size(); ++i) ASSERT_NEAR(read[i], values[i], std::abs(values[i]) / (1 << 24));
}

TEST(Packer, KeepsWholeNumbersConstantsAndGapsExactly) {
  Packer packer;
  const std::vector<std::vector<double>> lists = {
      {0, 1, 1, 0, -4000000, 3}, {2.5, 2.5, 2.5}, {}, {kNan, kNan, 1, kInfinity, 2, -kInfinity, kNan}, {kNan}, {-0.25}};
  std::vector<Packer::Json> streams;
  for (const std::vector<double>& list : lists) streams.push_back(packer.add_reals(list));
  for (std::size_t k = 0; k < lists.size(); ++k) {
    const std::vector<double> read = unpacked(packer, streams[k]);
    ASSERT_EQ(read.size(), lists[k].size());
    for (std::size_t i = 0; i < read.size(); ++i) {
      if (std::isnan(lists[k][i])) {
        EXPECT_TRUE(std::isnan(read[i])) << k << ", " << i;
      } else {
        EXPECT_EQ(read[i], lists[k][i]) << k << ", " << i;
      }
    }
  }
  std::vector<double> holes(3000, kNan);  // too many gaps for a list
  for (std::size_t i = 0; i < holes.size(); i += 2) holes[i] = 0.5 * static_cast<double>(i);
  const std::vector<double> read = unpacked(packer, packer.add_reals(holes));
  for (std::size_t i = 0; i < holes.size(); ++i) ASSERT_TRUE(i % 2 == 0 ? read[i] == holes[i] : std::isnan(read[i]));
}

TEST(Packer, KeepsNanosecondsOfDaysExactlyAndInFewBytes) {
  std::vector<std::int64_t> times;
  for (std::int64_t i = 0; i < 60'000; ++i) times.push_back(900'000'000'000'000 + i * 1'000'000);
  Packer packer;
  const Packer::Json stream = packer.add_integers(times);
  EXPECT_LT(stream["size"], 2000);
  const std::vector<double> read = unpacked(packer, stream);
  for (std::size_t i = 0; i < times.size(); ++i) ASSERT_EQ(read[i], static_cast<double>(times[i]));
}

TEST(Recorded, JoinsElementsOfVectors) {
  const TemporaryFile file(
      "time,drive.q[1],drive.q[2],drive.energy,a[2],q0,q1,q2,x9\n0,1,2,3,4,5,6,7,8\n0.5,1,2,3,4,5,6,7,8\n");
  const Recorded recorded = load_recorded(file.path());
  std::vector<std::pair<std::string, std::size_t>> found;
  for (const RecordedSignal& signal : recorded.signals) found.emplace_back(signal.name, signal.count);
  using Found = std::pair<std::string, std::size_t>;
  EXPECT_THAT(found,
              ElementsAre(Found{"drive.q", 2}, Found{"drive.energy", 1}, Found{"a[2]", 1}, Found{"q", 3}, Found{"x9", 1}));
  EXPECT_THAT(recorded.time, ElementsAre(0, 500'000'000));
  EXPECT_EQ(recorded.column(*recorded.find("q"), 2)[1], 7);
  EXPECT_THAT(recorded.remarks, IsEmpty());
}

TEST(Recorded, EndsBeforeWhatWasCutShort) {
  const TemporaryFile in_a_number("time,x\n0,1.25\n1,2.5\n2,3.1");  // 3.125 was meant
  const Recorded cut = load_recorded(in_a_number.path());
  EXPECT_EQ(cut.time.size(), 2u);
  EXPECT_THAT(cut.remarks, ElementsAre(HasSubstr("cut short")));
  const TemporaryFile in_a_row("time,x,y\n0,1,2\n1,2\n2,3,4\n");
  const Recorded short_row = load_recorded(in_a_row.path());
  EXPECT_EQ(short_row.time.size(), 1u);
  EXPECT_THAT(short_row.remarks, ElementsAre(HasSubstr(":3")));
  const TemporaryFile heading("time,x\n");
  EXPECT_EQ(load_recorded(heading.path()).time.size(), 0u);
}

TEST(Recorded, ShowsWhatIsNoNumberAsGapsAndLeavesOutTimesThatGoBack) {
  const TemporaryFile file("t,x\n0,nan\n1,abc\n1,inf\n0.5,7\nnan,8\n1e300,9\n2,10\n");
  const Recorded recorded = load_recorded(file.path());
  EXPECT_THAT(recorded.time, ElementsAre(0, 1'000'000'000, 1'000'000'000, 2'000'000'000));
  EXPECT_TRUE(std::isnan(recorded.columns[0][0]) && std::isnan(recorded.columns[0][1]) && std::isinf(recorded.columns[0][2]));
  EXPECT_THAT(recorded.remarks, ElementsAre(HasSubstr("3 rows left out"), HasSubstr("no number")));
}

TEST(Recorded, HasTheTimeThatIsFoundByItsNameOrGiven) {
  const TemporaryFile second("x,Time\n5,0.5\n");
  EXPECT_THAT(load_recorded(second.path()).time, ElementsAre(500'000'000));
  const TemporaryFile ms("time_ms,x\n0,1\n20,2\n");
  EXPECT_THAT(error_of([&] { load_recorded(ms.path()); }),
              HasSubstr("has no column 't', 'time' or 'timestamp', expected one or --t-column NAME"));
  EXPECT_THAT(load_recorded(ms.path(), {}, {"time_ms", 1e-3}).time, ElementsAre(0, 20'000'000));
}

TEST(Recorded, OfWhichNoRowCanBeReadIsAnErrorWithTheReason) {
  const TemporaryFile comma("t;x\n0,01;1,5\n0,02;1,6\n");
  EXPECT_THAT(error_of([&] { load_recorded(comma.path()); }), HasSubstr(":2: column 't': '0,01' has a decimal comma"));
  const TemporaryFile iso("t,x\n2026-11-22T10:00:00,1\n2026-11-22T10:00:01,2\n");
  EXPECT_THAT(error_of([&] { load_recorded(iso.path()); }), HasSubstr("'2026-11-22T10:00:00', expected a number"));
  const TemporaryFile late("t,x\n1e9,1\n");
  EXPECT_THAT(error_of([&] { load_recorded(late.path()); }), HasSubstr("expected a time of at most 1e"));
  const TemporaryFile cells("t,x\n0,1,2\n1,2,3\n");
  EXPECT_THAT(error_of([&] { load_recorded(cells.path()); }), HasSubstr(":2: 3 cells"));
  const TemporaryFile cut("t,x,y\n0,1");
  EXPECT_THAT(load_recorded(cut.path()).remarks, ElementsAre(HasSubstr("cut short")));
}

TEST(Recorded, WithoutColumnsOrContentIsAnError) {
  EXPECT_THAT(error_of([] { load_recorded(TemporaryFile("time\n0\n").path()); }), HasSubstr("besides the time"));
  EXPECT_NE(error_of([] { load_recorded(TemporaryFile("").path()); }), "");
  EXPECT_NE(error_of([] { load_recorded("nowhere.csv"); }), "");
}

/// A recording of these signals without rows.
Recorded recording_of(const std::vector<std::pair<std::string, std::size_t>>& signals) {
  Recorded recorded;
  for (const auto& [name, count] : signals) {
    recorded.signals.push_back({name, "", recorded.columns.size(), count});
    recorded.columns.resize(recorded.columns.size() + count);
    recorded.names.resize(recorded.columns.size(), name);
  }
  return recorded;
}

std::string view_bytes() {
  std::string bytes =
      R"({"format":"cotwin view 1","columns":[{"name":"time","elements":1,"unit":"s"},)"
      R"({"name":"a.q","elements":2,"unit":"","units":["rad","m"],"joints":["elbow","slide"]},{"name":"a.E","elements":1,"unit":"J"}]})"
      "\n";
  for (const std::int64_t ns : {0, 16'000'000, 32'000'000}) {
    bytes.append(reinterpret_cast<const char*>(&ns), sizeof ns);
    for (const float value : {1.0f, 2.0f, static_cast<float>(ns) * 1e-9f})
      bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  return bytes;
}

TEST(Recorded, ReadsWhatPagesShowAlsoIfItWasCutShort) {
  const std::string bytes = view_bytes();
  const Recorded whole = parse_view_data(bytes, "view.bin");
  EXPECT_THAT(whole.time, ElementsAre(0, 16'000'000, 32'000'000));
  EXPECT_THAT(whole.names, ElementsAre("a.q[1]", "a.q[2]", "a.E"));
  EXPECT_THAT(whole.find("a.q")->elements.si, ElementsAre("rad", "m"));
  EXPECT_THAT(whole.find("a.q")->elements.names, ElementsAre("elbow", "slide"));
  EXPECT_EQ(whole.find("a.E")->unit, "J");
  EXPECT_EQ(whole.column(*whole.find("a.E"), 0)[2], static_cast<double>(32e6f * 1e-9f));
  const std::size_t heading = bytes.find('\n') + 1;
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    if (size < heading) {
      EXPECT_THAT(error_of([&] { parse_view_data(bytes.substr(0, size), "view.bin"); }), HasSubstr("view.bin: has no heading"))
          << size;
    } else {
      EXPECT_EQ(parse_view_data(bytes.substr(0, size), "view.bin").time.size(), (size - heading) / 20);
    }
  }
  std::string backwards = bytes;
  backwards[heading + 20 + 7] = '\x80';  // the sign of the second time
  EXPECT_THAT(error_of([&] { parse_view_data(backwards, "view.bin"); }), HasSubstr("row 2 goes back"));
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = bytes;
    for (int k = 0; k < 3; ++k) damaged[random() % damaged.size()] = static_cast<char>(random());
    const std::string error = error_of([&] { parse_view_data(damaged, "view.bin"); });
    EXPECT_TRUE(error.empty() || error.starts_with("view.bin: ")) << error;
  }
}

TEST(Recorded, IsJoinedLinearlyAtTheTimesOfTheOther) {
  const Recorded base = parse_view_data(view_bytes(), "view.bin");
  const Recorded other = load_recorded(TemporaryFile("time,a.E,b\n0.008,9,10\n0.024,9,20\n").path());
  const Recorded both = joined(base, other);
  EXPECT_THAT(both.names, ElementsAre("a.q[1]", "a.q[2]", "a.E", "b"));
  EXPECT_THAT(both.columns[3], ElementsAre(10, 15, 20));  // the ends hold
  EXPECT_EQ(both.columns[2], base.columns[2]);
  EXPECT_THAT(joined(base, recording_of({{"c", 2}})).columns.at(4),
              ElementsAre(::testing::IsNan(), ::testing::IsNan(), ::testing::IsNan()));
}

// Whatever the page of a live run can show, of all its signals, is also recorded for the page of the results.
TEST(ViewColumns, HaveAllThatPagesOfTheExamplesCanShow) {
  const fs::path root = places::source();
  std::size_t scenarios = 0;
  for (const auto& entry : fs::recursive_directory_iterator(root / "examples")) {
    if (entry.path().extension() != ".ssd") continue;
    std::vector<Member> members;
    const Scenario scenario = load_scenario(entry.path());
    const std::vector<fs::path> folders = {scenario.folder, root / "models"};
    try {
      members = load_members(scenario, unit_types(), folders);
    } catch (const Error&) {
      continue;  // needs an FMU that has to be made first
    }
    std::vector<std::pair<std::string, std::size_t>> all;
    for (const Member& member : members) {
      for (const Variable& v : member.variables()) {
        const std::string last = v.name.substr(v.name.rfind('.') + 1);
        const bool copy = v.role == Role::kInput && (last == "q" || last == "q_link" || last == "q_c" || last == "q_d");
        if (v.kind() != Kind::kString && v.role != Role::kParameter && !copy)
          all.emplace_back(member.name() + "." + v.name, v.size());
      }
    }
    std::vector<std::pair<std::string, std::size_t>> kept;
    for (const Column& column : choose_view_columns(members)) kept.emplace_back(column.signal.name, column.signal.count);
    const auto page_of = [&](const Recorded& recorded) {
      const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
      CalculatedTable calculated;
      Packer packer;
      std::vector<std::string> remarks;
      return stage_json({stage, recorded, &scenario, unit_types(), folders, true}, {}, calculated, packer, remarks);
    };
    const auto of_all = page_of(recording_of(all)), of_kept = page_of(recording_of(kept));
    EXPECT_EQ(of_all, of_kept) << entry.path() << ": " << nlohmann::json::diff(of_all, of_kept);
    ++scenarios;
  }
  EXPECT_GE(scenarios, 40u);
}

Scenery stage_of_example(const std::string& file, const Recorded& recorded) {
  const fs::path root = places::source();
  const Scenario scenario = load_scenario(root / "examples" / file);
  return scenery_of(scenario, recorded, unit_types(), {scenario.folder, root / "models"});
}

std::vector<std::string> words_of(const StagedRobot& robot) {
  static constexpr const char* kWords[] = {"main ", "desired ", "compliant ", "other "};
  std::vector<std::string> words;
  for (const StagedTrack& track : robot.tracks) words.push_back(kWords[static_cast<std::size_t>(track.role)] + track.signal);
  return words;
}

TEST(Scenery, ShowsTheDrivenRobotWithItsDesiredMotionAsAGhost) {
  const Recorded recorded =
      recording_of({{"motion.q_d", 7}, {"drive.q", 7}, {"drive.tau_J", 7}, {"compliance.q_c", 7}, {"compliance.q", 7}});
  const Scenery stage = stage_of_example("02_free_motion_lwr4/twin.ssd", recorded);
  ASSERT_EQ(stage.robots.size(), 1u);
  // compliance.q is connected to drive.q: it shows nothing else.
  EXPECT_THAT(words_of(stage.robots[0]), ElementsAre("main drive.q", "compliant compliance.q_c", "desired motion.q_d"));
  EXPECT_EQ(stage.models[stage.robots[0].model].model->n(), 7);
  EXPECT_THAT(stage.robots[0].q0, ElementsAre(0, 0.3, 0, -1.2, 0, 0.9, 0));
  EXPECT_THAT(stage.remarks, IsEmpty());
}

TEST(Scenery, TellsWhatMustBeRecordedForARobotToMove) {
  const Scenery stage = stage_of_example("02_free_motion_lwr4/twin.ssd", recording_of({{"drive.q", 6}, {"drive.q[3]", 1}}));
  ASSERT_EQ(stage.robots.size(), 1u);
  EXPECT_THAT(stage.robots[0].tracks, IsEmpty());
  EXPECT_THAT(stage.remarks, ElementsAre(HasSubstr("6 elements of drive.q are recorded, the robot has 7 joints now")));
  EXPECT_THAT(stage_of_example("02_free_motion_lwr4/twin.ssd", recording_of({{"drive.q[3]", 1}})).remarks,
              ElementsAre(HasSubstr("no joint positions are recorded, so it stands still; record ")));
}

TEST(Scenery, ShowsTwoRobotsAtTheirPlacesInAContactWorldWithItsBodies) {
  const Recorded recorded = recording_of({{"world.left.q_link", 7}, {"world.right.q_link", 7}});
  const Scenery stage = stage_of_example("10_cooperation/clamping.ssd", recorded);
  ASSERT_EQ(stage.robots.size(), 2u);
  for (const StagedRobot& robot : stage.robots) {
    EXPECT_NE(robot.by, "");
    EXPECT_EQ(robot.tracks.size(), 1u) << robot.name;
  }
  EXPECT_GT((stage.robots[0].base.X_WB.p - stage.robots[1].base.X_WB.p).norm(), 0.5);
  EXPECT_FALSE(stage.bodies.empty());
  EXPECT_THAT(stage.worlds, ElementsAre("world"));
}

TEST(Scenery, ShowsFloatingRobotsAtTheirPlaces) {
  const Recorded recorded =
      recording_of({{"rigid.q", 7}, {"rigid.base_p", 3}, {"rigid.base_quat", 4}, {"elastic.q", 7}, {"world.q", 7}});
  const Scenery stage = stage_of_example("21_reaction/reaction.ssd", recorded);
  ASSERT_EQ(stage.robots.size(), 3u);
  EXPECT_EQ(stage.robots[0].base.X_WB.p, Eigen::Vector3d(0, -2, 1));
  EXPECT_EQ(stage.robots[0].base.quat, "rigid.base_quat");
  EXPECT_EQ(stage.robots[1].base.X_WB.p, Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(stage.robots[2].base.X_WB.p, Eigen::Vector3d(0, 2, 1));
  EXPECT_EQ(stage.robots[2].base.quat, "world.base_quat");
}

// The monitor's robots are those of the motions that it follows, at its places, and its person is that of the contact world.
TEST(Scenery, ShowsWhatAMonitorWatches) {
  const fs::path root = places::source();
  const Scenario scenario = load_scenario(root / "examples/20_safety_hulls/cell.ssd");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const auto page_of = [&](const Recorded& recorded, Scenery& stage) {
    stage = scenery_of(scenario, recorded, unit_types(), folders);
    CalculatedTable calculated;
    Packer packer;
    std::vector<std::string> remarks;
    return stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
  };
  Scenery stage;
  const auto page = page_of(recording_of({{"left.q_d", 7},
                                          {"right.q_d", 6},
                                          {"floor.person.p", 3},
                                          {"monitor.left.p_a", 3},
                                          {"monitor.left.p_b", 3},
                                          {"monitor.left.distance", 1}}),
                            stage);
  EXPECT_THAT(stage.remarks, IsEmpty());
  ASSERT_EQ(stage.robots.size(), 2u);
  EXPECT_THAT(words_of(stage.robots[1]), ElementsAre("main right.q_d"));
  EXPECT_EQ(stage.robots[1].base.X_WB.p, Eigen::Vector3d(1.9, 0, 0));
  ASSERT_EQ(page.at("bodies").size(), 1u);
  EXPECT_EQ(stage.bodies[0].prefix, "floor.person");
  EXPECT_THAT(stage.worlds, ElementsAre("floor"));
  ASSERT_EQ(page.at("distances").size(), 1u);
  EXPECT_EQ(page.at("distances")[0].at("name"), "monitor.left");
  EXPECT_EQ(page.at("distances_lack"), "");
  const auto lacking = page_of(recording_of({{"left.q_d", 7}, {"right.q_d", 6}}), stage);
  EXPECT_EQ(lacking.at("distances_lack"), "record monitor.left.p_a, monitor.left.p_b and monitor.left.distance");
}

// A scanner moves nothing: its robot is where the scenario has it, its bodies are those of others.
TEST(Scenery, HasTheProfilesOfScanners) {
  const fs::path root = places::source();
  const Scenario scenario = load_scenario(root / "examples/30_scan_the_cell/profile.ssd");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const auto page_of = [&](const Recorded& recorded, Scenery& stage) {
    stage = scenery_of(scenario, recorded, unit_types(), folders);
    CalculatedTable calculated;
    Packer packer;
    std::vector<std::string> remarks;
    return stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
  };
  Scenery stage;
  const auto page = page_of(recording_of({{"motion.q_d", 6},
                                          {"scanner.ranges", 121},
                                          {"scanner.p_scan", 3},
                                          {"scanner.quat_scan", 4},
                                          {"scanner.angle_increment", 1}}),
                            stage);
  EXPECT_THAT(stage.remarks, IsEmpty());
  EXPECT_THAT(stage.worlds, IsEmpty());
  EXPECT_THAT(stage.monitors, IsEmpty());
  ASSERT_EQ(stage.robots.size(), 1u);
  EXPECT_THAT(words_of(stage.robots[0]), ElementsAre("main motion.q_d"));
  EXPECT_EQ(stage.robots[0].base.X_WB.p, Eigen::Vector3d(0, 0, 0.6));
  EXPECT_EQ(stage.bodies.size(), 4u);
  ASSERT_EQ(page.at("profiles").size(), 1u);
  EXPECT_EQ(page.at("profiles")[0].at("name"), "scanner");
  EXPECT_EQ(page.at("profiles_lack"), "");
  EXPECT_EQ(page.at("distances_lack"), "the scenario has no unit:monitor");
  const auto lacking = page_of(recording_of({{"motion.q_d", 6}, {"scanner.ranges", 121}}), stage);
  EXPECT_EQ(lacking.at("profiles_lack"),
            "record scanner.ranges, scanner.p_scan, scanner.quat_scan and scanner.angle_increment");
}

// Each point within half a step of 16 bits, in the frame of the cloud; more than 300 000 as the means of cubes.
TEST(Scenery, ShowsThePointsOfAMonitorsCloud) {
  const fs::path root = places::source();
  const testing::TemporaryFolder folder("cloud");
  Scenario scenario = load_scenario(root / "examples/29_scanned_cell/cell.ssd");
  const auto component = std::ranges::find(scenario.components, "monitor", &ComponentSpec::name);
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  std::vector<std::string> remarks;
  Packer packer;
  const auto cloud_of = [&](const std::string& file) {
    component->source = "unit:monitor?robot=ur5e&cloud=" + file;
    const Recorded recorded = recording_of({{"motion.q_d", 6}});
    const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
    CalculatedTable calculated;
    remarks.clear();
    packer = {};
    const auto page = stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
    return page.at("clouds").empty() ? Packer::Json() : page.at("clouds")[0];
  };
  const auto shown = cloud_of("scenes/cell_cloud/scene.pcd");
  const cloud::Cloud points = cloud::load_cloud(root / "models/scenes/cell_cloud/scene.pcd").cloud;
  const std::vector<double> steps = unpacked(packer, shown.at("points"));
  ASSERT_EQ(steps.size(), 3 * points.points.size());
  for (std::size_t k = 0; k < points.points.size(); ++k) {
    for (std::size_t i = 0; i < 3; ++i) {
      const double step = shown.at("step")[i],
                   x = shown.at("low")[i].get<double>() + step * steps[i * points.points.size() + k];
      ASSERT_NEAR(x, points.point(k)[static_cast<Eigen::Index>(i)], 0.51 * step + 1e-7);
    }
  }
  EXPECT_LT(shown.at("step")[0], 1e-4);
  EXPECT_THAT(remarks, IsEmpty());

  std::vector<std::string> none;
  scene::Scene ball;
  ball.bodies.resize(1);
  ball.bodies[0].shapes.resize(1);
  ball.bodies[0].shapes[0].size = {1, 0, 0};
  std::ofstream out(folder / "many.pcd", std::ios::binary);
  cloud::write_cloud(out, cloud::sample(ball, {.spacing = 0.005}, none), cloud::Format::kPcd);
  out.close();
  const auto thinned = cloud_of((folder / "many.pcd").string());
  EXPECT_LE(thinned.at("points").at("count").get<std::size_t>() / 3, 300'000u);
  EXPECT_GT(thinned.at("points").at("count").get<std::size_t>() / 3, 100'000u);
  EXPECT_THAT(remarks, ElementsAre(HasSubstr("of the 502655 points of many.pcd the page shows ")));
  EXPECT_LT(packer.base64().size(), 3'000'000u);

  folder.write("bad.pcd", "VERSION");
  EXPECT_TRUE(cloud_of((folder / "bad.pcd").string()).is_null());
  EXPECT_THAT(remarks, ElementsAre(HasSubstr("a point cloud is left out: ")));
}

// Obstacles are where the monitor has them, also if a contact world knows them, whichever comes first.
TEST(Scenery, ShowsObstaclesWhereTheMonitorHasThem) {
  const fs::path root = places::source();
  Scenario scenario = load_scenario(root / "examples/25_shared_cell/cell.ssd");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const Recorded recorded =
      recording_of({{"drive.q", 7}, {"right.q_d", 6}, {"monitor.trolley.present", 1}, {"monitor.left.zone", 1}});
  for (int order = 0; order < 2; ++order) {
    const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
    EXPECT_THAT(stage.remarks, IsEmpty());
    CalculatedTable calculated;
    Packer packer;
    std::vector<std::string> remarks;
    const auto page = stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
    ASSERT_EQ(page.at("bodies").size(), 3u);
    for (const auto& body : page.at("bodies")) {
      if (body.at("name") == "person") {
        EXPECT_FALSE(body.contains("obstacle"));
      } else {
        const bool trolley = body.at("name") == "trolley";
        EXPECT_EQ(body.at("obstacle").at("present"), trolley ? 0 : 1);
        EXPECT_EQ(body.at("obstacle").at("present_signal"), trolley ? "monitor.trolley.present" : "");
        EXPECT_EQ(body.at("obstacle").at("scale"), 1);
      }
    }
    ASSERT_EQ(page.at("lights").size(), 1u);
    EXPECT_EQ(page.at("lights")[0].at("name"), "monitor.left");
    std::ranges::reverse(scenario.components);
  }
}

TEST(Scenery, PutsBodiesWhereTheScenarioPutsThem) {
  const Scenery stage = stage_of_example("04_peg_in_hole/twin.ssd", recording_of({{"robot.q", 7}}));
  ASSERT_EQ(stage.bodies.size(), 1u);
  EXPECT_EQ(stage.bodies[0].body.X_WB.p, Eigen::Vector3d(0.5008, 0.0495, -0.07));

  const fs::path root = places::source();
  Scenario scenario = load_scenario(root / "examples/04_peg_in_hole/twin.ssd");
  for (const char* value : {"world.plate.p0[2]=0.25", "world.plate.quat0=0 0 0 1"}) assign(scenario, value, unit_types());
  const Pose pose = scenery_of(scenario, {}, unit_types(), {scenario.folder, root / "models"}).bodies.at(0).body.X_WB;
  EXPECT_EQ(pose.p, Eigen::Vector3d(0.5008, 0.25, -0.07));
  EXPECT_EQ(pose.R, Eigen::Matrix3d(Eigen::Vector3d(-1, -1, 1).asDiagonal()));
}

// Fig. 17b: a fixed cell and its free twin start at the same place, each in a contact world of its own.
TEST(Scenery, ShowsARobotOfAnotherWorldThatStartsAtTheSamePlaceAsAGhostWithItsOwnBase) {
  const fs::path root = places::source();
  const Scenario scenario = load_scenario(root / "examples/24_satellite_servicing/servicing.ssd");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const Recorded recorded = recording_of({{"free_world.q", 14},
                                          {"free_world.base_p", 3},
                                          {"free_world.base_quat", 4},
                                          {"free_world.block_1.p", 3},
                                          {"free_world.block_1.quat", 4},
                                          {"fixed_world.q", 14},
                                          {"free_world.grip.closed", 1},
                                          {"free_world.grip.p", 3},
                                          {"free_world.grip.f", 3},
                                          {"fixed_world.grip.closed", 1},
                                          {"fixed_world.grip.p", 3},
                                          {"fixed_world.grip.f", 3}});
  const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
  ASSERT_EQ(stage.robots.size(), 1u);
  EXPECT_THAT(words_of(stage.robots[0]), ElementsAre("main free_world.q", "other fixed_world.q"));
  ASSERT_EQ(stage.bodies.size(), 8u);
  for (const StagedBody& body : stage.bodies)
    EXPECT_EQ(is_of_ghost(stage, body.prefix), body.prefix.starts_with("fixed_world.")) << body.prefix;
  CalculatedTable calculated;
  Packer packer;
  std::vector<std::string> remarks;
  const auto page = stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
  ASSERT_EQ(page.at("contacts").size(), 1u);
  EXPECT_EQ(page.at("contacts")[0].at("f"), "free_world.grip.f");
  for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(page.at("bodies")[i].at("ghost"), is_of_ghost(stage, stage.bodies[i].prefix));
  const auto& figure = page.at("figures")[0];
  EXPECT_EQ(figure.at("base_quat"), "free_world.base_quat");
  EXPECT_FALSE(figure.at("tracks")[0].contains("base"));
  EXPECT_EQ(figure.at("tracks")[1].at("base_quat"), "");
  EXPECT_EQ(figure.at("tracks")[1].at("base").at("p"), (std::vector<double>{0, 0, 0.7}));

  Scenario apart = scenario;
  assign(apart, "fixed_world.base_p0=0 3 0", unit_types());
  const Scenery two = scenery_of(apart, recorded, unit_types(), folders);
  ASSERT_EQ(two.robots.size(), 2u);
  EXPECT_EQ(two.robots[1].base.X_WB.p, Eigen::Vector3d(0, 3, 0));
  EXPECT_TRUE(two.ghosts.empty());
}

// Fig. 14b: twins that follow the same desired motion are one robot with ghosts, also where each has a workpiece of its own.
TEST(Scenery, ShowsStiffAndCompliantMotionAsGhosts) {
  const Scenery own = stage_of_example("10_cooperation/ghosts.ssd", recording_of({{"compliant.q", 7}, {"stiff.q", 7}}));
  ASSERT_EQ(own.robots.size(), 1u);
  EXPECT_THAT(words_of(own.robots[0]), ElementsAre("main compliant.q", "other stiff.q"));
  const Scenery guided =
      stage_of_example("10_cooperation/guidance.ssd", recording_of({{"robot.q", 7}, {"twin.q_c", 7}, {"motion.q_d", 7}}));
  ASSERT_EQ(guided.robots.size(), 1u);
  EXPECT_THAT(words_of(guided.robots[0]), ElementsAre("main robot.q", "compliant twin.q_c", "desired motion.q_d"));
  EXPECT_THAT(guided.remarks, IsEmpty());
}

// A hand at a robot has its force in the robot's base, a hand that grips a body in W.
TEST(Scenery, ShowsTheForcesOfHandsAtRobotsAndBodies) {
  const fs::path root = places::source();
  const Scenario scenario = load_scenario(root / "examples/10_cooperation/guidance.ssd");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const Recorded recorded = recording_of({{"robot.q", 7},
                                          {"tool_hand.p", 3},
                                          {"tool_hand.f", 3},
                                          {"block_hand.p", 3},
                                          {"block_hand.f", 3},
                                          {"world.block.p", 3},
                                          {"world.block.f", 3}});
  const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
  CalculatedTable calculated;
  Packer packer;
  std::vector<std::string> remarks;
  const auto page = stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
  ASSERT_EQ(page.at("forces").size(), 2u) << page.at("forces").dump();
  EXPECT_EQ(page.at("forces")[0].at("f"), "tool_hand.f");
  EXPECT_EQ(page.at("forces")[0].at("figure"), 0);
  EXPECT_EQ(page.at("forces")[1].at("p"), "block_hand.p");
  EXPECT_EQ(page.at("forces")[1].at("figure"), -1);
}

TEST(Scenery, ShowsForcesOfLatchesAsThoseOfContacts) {
  const fs::path root = places::source();
  const Scenario scenario = load_scenario(root / "examples/23_latch/latch.ssd");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const Recorded recorded = recording_of(
      {{"drive.q", 7}, {"world.grip.closed", 1}, {"world.grip.p", 3}, {"world.grip.f", 3}, {"world.other.closed", 1}});
  const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
  CalculatedTable calculated;
  Packer packer;
  std::vector<std::string> remarks;
  const auto page = stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
  ASSERT_EQ(page.at("contacts").size(), 1u) << page.at("contacts").dump();
  EXPECT_EQ(page.at("contacts")[0].at("p"), "world.grip.p");
  EXPECT_EQ(page.at("contacts")[0].at("f"), "world.grip.f");
}

TEST(Scenery, ShowsToolsFromTheirMountingToTheirRemoval) {
  const fs::path root = places::source();
  Scenario scenario = load_scenario(root / "examples/02_free_motion_lwr4/twin.ssd");
  for (const char* tool :
       {"plate,parent=link_7,xyz=0 0 0.1,mass=2,com=0.01 0.02 0.03,inertia=0.02 1e-3 2e-3 0.018 -1e-3 0.012@1",
        "bit,parent=plate,xyz=0.2 0 0,rpy=0 0 1.5707963267948966,mass=0.1,com=0 0 0,inertia=0 0 0 0 0 0@2",
        "bit,parent=link_3,mass=0,com=0 0 0,inertia=0 0 0 0 0 0@4", "lost,parent=nowhere,mass=1@5"})
    add_tool_event(scenario, true, tool);
  add_tool_event(scenario, false, "bit@3");
  const std::vector<fs::path> folders = {scenario.folder, root / "models"};
  const Recorded recorded = recording_of({{"drive.q", 7}});
  const Scenery stage = scenery_of(scenario, recorded, unit_types(), folders);
  EXPECT_THAT(stage.remarks, ElementsAre(HasSubstr("tool 'lost' is not shown on robot drive: ")));
  const std::vector<StagedTool>& tools = stage.robots.at(0).tools;
  ASSERT_EQ(tools.size(), 3u);
  EXPECT_EQ(tools[0].until, std::nullopt);
  EXPECT_EQ(tools[1].body, 6);
  EXPECT_LT((tools[1].X_BA.p - Eigen::Vector3d(0.2, 0, 0.1)).norm(), 1e-15);
  EXPECT_LT((tools[1].X_BA.R.col(0) - Eigen::Vector3d::UnitY()).norm(), 1e-15);
  EXPECT_EQ(tools[1].from, 2);
  EXPECT_EQ(tools[1].until, 3);
  EXPECT_EQ(tools[2].body, 2);
  EXPECT_EQ(tools[2].from, 4);

  CalculatedTable calculated;
  Packer packer;
  std::vector<std::string> remarks;
  const auto page = stage_json({stage, recorded, &scenario, unit_types(), folders}, {}, calculated, packer, remarks);
  const auto& shown = page.at("figures")[0].at("tools");
  EXPECT_TRUE(shown[0].at("until").is_null());
  EXPECT_TRUE(shown[2].at("visuals").empty()) << "a frame without mass";
  const auto box_of = [](const auto& tool) {
    const auto& visual = tool.at("visuals").at(0);
    EXPECT_EQ(visual.at("kind"), "box");
    const std::vector<double> size = visual.at("size"), p = visual.at("p"), quat = visual.at("quat");
    scene::Shape box;
    box.type = scene::ShapeType::kBox;
    box.size = {size[0], size[1], size[2]};
    box.X_BS = {Eigen::Quaterniond(quat[0], quat[1], quat[2], quat[3]).toRotationMatrix(), {p[0], p[1], p[2]}};
    return box;
  };
  // A tool that is given by numbers is the box with its mass distribution.
  const scene::Shape box = box_of(shown[0]);
  const Inertia inertia = scene::solid_inertia(box, 2 / box.size.prod());
  EXPECT_LT((inertia.parameters() - tools[0].inertia.parameters()).norm(), 1e-14);
  EXPECT_NEAR(box_of(shown[1]).size.prod() * 7850, 0.1, 1e-12);
}

TEST(Scenery, OfARobotAloneTakesSignalsWithItsNumberOfJoints) {
  const auto model = std::make_shared<const robot::RobotModel>(
      robot::load_urdf(fs::path(places::source()) / "models/robots/planar2/robot.urdf"));
  const Scenery stage = scenery_of({model, ""}, recording_of({{"q", 2}, {"twin.q_d", 2}, {"other.q", 3}}));
  ASSERT_EQ(stage.robots.size(), 1u);
  EXPECT_THAT(words_of(stage.robots[0]), ElementsAre("main q", "desired twin.q_d"));
}

TEST(TipMatrices, AreThoseOfTheIndices) {
  const robot::RobotModel arm = robot::load_urdf(fs::path(places::source()) / "models/robots/lwr4/robot.urdf");
  Recorded recorded = recording_of({{"q", 7}});
  const std::vector<double> q = {0.3, 0.5, -0.2, -1.1, 0.4, 0.9, 0.1};
  recorded.time = {0, 1'000'000'000};
  for (std::size_t i = 0; i < 7; ++i) recorded.columns[i] = {q[i], kNan};  // the second row repeats the first
  const auto soft = [](std::size_t) { return Compliant{std::nullopt, false, std::vector<double>(7, 200.0)}; };
  const TipMatrices matrices = tip_matrices(arm, recorded, *recorded.find("q"), {0, 1}, soft);
  const robot::Mechanism mechanism(arm);
  robot::Data data(mechanism);
  robot::FrameInertia inertia(7);
  robot::frame_inertia(mechanism, data, Eigen::Map<const Eigen::VectorXd>(q.data(), 7), Eigen::VectorXd(0),
                       robot::on_body(arm.end_effector()), inertia);
  const Eigen::Vector3d u = Eigen::Vector3d(1, -2, 0.5).normalized();
  const auto matrix = [](const MatrixOverTime& m, std::size_t row) {
    Eigen::Matrix3d M;
    M << m[0][row], m[1][row], m[2][row], m[1][row], m[3][row], m[4][row], m[2][row], m[4][row], m[5][row];
    return M;
  };
  for (const std::size_t row : {0u, 1u}) {
    EXPECT_NEAR(1 / u.dot(matrix(*matrices.mobility, row) * u), robot::effective_mass(inertia, u), 1e-9);
    // A force f at the tip moves it by K⁻¹ f, and the joints by Jᵀ f / 200.
    const Eigen::Vector3d f(3, 1, -2);
    const Eigen::Vector3d way = inertia.J.topRows<3>() * (inertia.J.topRows<3>().transpose() * f) / 200;
    EXPECT_LT((matrix(*matrices.stiffness, row) * way - f).norm(), 1e-4 * f.norm());
    EXPECT_NEAR(matrix(matrices.velocity, row).trace(), inertia.J.topRows<3>().squaredNorm(), 1e-12);
  }
}

TEST(TipMatrices, OfAFloatingRobotRecoil) {
  const robot::RobotModel arm = robot::load_urdf(fs::path(places::source()) / "examples/21_reaction/satellite.urdf");
  Recorded recorded = recording_of({{"q", 7}});
  recorded.time = {0};
  Eigen::VectorXd q(7);
  q << 0.3, 0.5, -0.2, -1.1, 0.4, 0.9, 0.1;
  for (std::size_t i = 0; i < 7; ++i) recorded.columns[i] = {q[static_cast<Eigen::Index>(i)]};
  const auto none = [](std::size_t) { return std::optional<Compliant>(); };
  const TipMatrices free = tip_matrices(arm, recorded, *recorded.find("q"), {0}, none, true);
  const TipMatrices fixed = tip_matrices(arm, recorded, *recorded.find("q"), {0}, none);
  const robot::FloatingMechanism mechanism(arm);
  robot::FloatingData data(mechanism);
  robot::FloatingInertia inertia(7);
  floating_inertia(mechanism, data, q, inertia);
  Eigen::MatrixXd J(6, 7);
  generalised_jacobian(mechanism, data, inertia, q, robot::on_body(arm.end_effector()), J);
  EXPECT_NEAR(free.velocity[0][0], J.row(0).squaredNorm(), 1e-12);
  EXPECT_NEAR(free.velocity[4][0], J.row(1).dot(J.row(2)), 1e-12);
  // A base that gives way makes the tip lighter: by what a force moves the whole, and more.
  EXPECT_GT((*free.mobility)[0][0], (*fixed.mobility)[0][0] + 1e-3);
}

TEST(TipMatrices, AreMadeForRowsSpreadOverTheRecordingWithItsEnds) {
  Recorded recorded;
  for (std::int64_t i = 0; i < 10'001; ++i) recorded.time.push_back(i * 1'000'000);
  const std::vector<std::size_t> rows = chosen_rows(recorded, 50, 6000);
  EXPECT_EQ(rows.front(), 0u);
  EXPECT_EQ(rows.back(), 10'000u);
  EXPECT_EQ(rows.size(), 501u);
  EXPECT_LE(chosen_rows(recorded, 1e9, 100).size(), 101u);
  EXPECT_THAT(chosen_rows({}, 50, 100), IsEmpty());
}

}  // namespace
}  // namespace cotwin::master::view_test
