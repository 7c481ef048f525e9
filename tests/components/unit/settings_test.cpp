#include "components/unit/settings.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_store.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"
#include "tests/support/places.h"

namespace cotwin::settings_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// A unit whose number of elements is a setting.
class Line final : public Unit {
 public:
  static void declare_settings(SettingList& s) {
    s.integer("length", 3, 1, 100, "number of places");
    s.boolean("loud", false, "whether it warns");
    s.integer("volume", 1, 1, 9, "with loud=true: how much");
  }
  explicit Line(Settings& settings) : x_(static_cast<std::size_t>(settings.integer("length"))) {
    if (settings.boolean("loud")) settings.warn("loud " + std::to_string(settings.integer("volume")));
  }
  void declare(Variables& v) override {
    v.parameter("x", x_, "m", "places along the line");
    v.output("y", x_, "m", "the same places");
  }
  void initialise(Time) override {}
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  std::vector<double> x_;
};

const UnitType kTypes[] = {{"line", "places along a line",
                            [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Line>(s); },
                            &Line::declare_settings}};

/// Settings of a unit "line" with the settings a, b, c, d (texts), n, on, colour, robot.
Settings settings(std::string_view query, std::map<std::string, std::string> defaults = {},
                  std::vector<std::filesystem::path> folders = {}) {
  SettingList list;
  for (const char* name : {"a", "b", "c", "d"}) list.text(name, "0", "a text");
  list.integer("n", 1, 0, 9, "a number");
  list.boolean("on", true, "a switch");
  list.choice("colour", {"red", "blue"}, "a colour");
  list.robot("a robot").required();
  Settings s("line", query, std::move(defaults), std::move(folders));
  s.declare(std::move(list));
  return s;
}

TEST(Settings, TakeTheQueryBeforeTheDefaultsBeforeTheFallback) {
  Settings s = settings("a=1&b=x%20y", {{"a", "2"}, {"c", "3"}});
  EXPECT_EQ(s.text("a"), "1");
  EXPECT_EQ(s.text("b"), "x y");
  EXPECT_EQ(s.text("c"), "3");
  EXPECT_EQ(s.text("d"), "0");
  EXPECT_THAT(s.defaults_used(), ::testing::ElementsAre("c"));
}

TEST(Settings, ReportInvalidValues) {
  Settings s = settings("n=7x&on=maybe&colour=blau");
  EXPECT_THAT([&] { s.integer("n"); }, ThrowsMessage<Error>(HasSubstr("n=7x, expected an integer from 0 to 9")));
  EXPECT_THAT([&] { s.boolean("on"); }, ThrowsMessage<Error>(HasSubstr("expected true or false")));
  EXPECT_THAT([&] { s.choice("colour"); }, ThrowsMessage<Error>(HasSubstr("expected one of red, blue; did you mean 'blue'?")));
  EXPECT_THAT([&] { s.text("robot"); }, ThrowsMessage<Error>(HasSubstr("needs the setting 'robot'")));
  EXPECT_THROW(Settings("line", "n", {}, {}), Error);
  EXPECT_THROW(Settings("line", "n=1&n=2", {}, {}), Error);
}

TEST(Settings, ReportForHowManyUnitsAWrongValueWasGiven) {
  Settings s = settings("", {{"colour", "green"}});
  EXPECT_THAT([&] { s.choice("colour"); },
              ThrowsMessage<Error>(HasSubstr("the value is given for all units, for one: --set COMPONENT.colour=")));
}

TEST(Settings, AreReadOnlyAsTheyAreDeclared) {
  Settings s = settings("n=2");
  EXPECT_THAT([&] { s.text("n"); }, ThrowsMessage<Error>(HasSubstr("does not declare as a setting of kind text")));
  EXPECT_THAT([&] { s.text("z"); }, ThrowsMessage<Error>(HasSubstr("does not declare")));
  SettingList list;
  list.boolean("on", true, "a switch");
  EXPECT_THROW(list.boolean("on", true, "again"), Error);
  EXPECT_THROW(list.boolean("off", true, ""), Error);
}

TEST(Settings, ListTheFoldersInWhichAFileWasNotFound) {
  const std::filesystem::path here = places::source();
  Settings s = settings("robot=lwr4", {}, {here / "tests", here / "models"});
  EXPECT_EQ(s.robot_file(), here / "models/robots/lwr4/robot.urdf");
  EXPECT_THAT([&] { (void)s.file("no.csv"); }, ThrowsMessage<Error>(AllOf(HasSubstr((here / "tests/no.csv").string()),
                                                                          HasSubstr((here / "models/no.csv").string()))));
}

TEST(MakeUnit, BuildsDeclaresAndWarns) {
  std::vector<std::string> used;
  const Instance line = make_unit("unit:line?loud=true", {{"length", "5"}, {"robot", "lwr4"}}, {}, kTypes, &used);
  EXPECT_EQ(line.variables.at("x").size(), 5u);
  EXPECT_THAT(line.warnings, ::testing::ElementsAre("loud 1"));
  EXPECT_THAT(used, ::testing::ElementsAre("length"));
}

TEST(MakeUnit, NamesUnknownUnitsAndSettings) {
  EXPECT_THAT([] { make_unit("unit:lime", {}, {}, kTypes); }, ThrowsMessage<Error>(HasSubstr("did you mean 'line'?")));
  EXPECT_THAT([] { make_unit("unit:line?lenght=2", {}, {}, kTypes); },
              ThrowsMessage<Error>(HasSubstr("did you mean 'length'?")));
  EXPECT_THAT([] { make_unit("unit:line?volume=2", {}, {}, kTypes); },
              ThrowsMessage<Error>(HasSubstr("the setting volume=2 has no effect with the defaults of the other settings")));
  EXPECT_EQ(make_unit("unit:line?volume=2&loud=true", {}, {}, kTypes).warnings.front(), "loud 2");
  EXPECT_THAT([] { make_unit("line", {}, {}, kTypes); }, ThrowsMessage<Error>(HasSubstr("expected unit:<name>")));
}

TEST(Apply, WritesAParameterSetAndConvertsItsMeasures) {
  const Instance line = make_unit("unit:line", {}, {}, kTypes);
  ParameterSet set;
  set.values = {{"x", 1.0, "", "a.ssv:1"}, {"x[2]", 250.0, "mm", "a.ssv:2"}, {"x[3]", std::int64_t{4}, "", "a.ssv:3"}};
  apply(set, line.variables);
  EXPECT_THAT(line.variables.at("x").reals(), ::testing::ElementsAre(1.0, 0.25, 4.0));
}

TEST(Apply, TakesNoOffsetForADifference) {
  std::vector<double> dT(1), T(1);
  Variables v;
  v.parameter("dT", dT, "K", "difference of temperatures").relative();
  v.parameter("T", T, "K", "temperature");
  apply(ParameterSet{"", {{"dT", 5.0, "degC", "a.ssv:1"}, {"T", 5.0, "degC", "a.ssv:2"}}, {}}, v);
  EXPECT_EQ(dT[0], 5);
  EXPECT_EQ(T[0], 278.15);
}

TEST(Apply, NamesThePlaceOfAnInvalidValue) {
  const Instance line = make_unit("unit:line", {}, {}, kTypes);
  const auto applying = [&](ParameterValue value) {
    return [&line, value] { apply(ParameterSet{"", {value}, {}}, line.variables); };
  };
  EXPECT_THAT(applying({"z", 1.0, "", "a.ssv:1"}),
              ThrowsMessage<Error>(AllOf(HasSubstr("a.ssv:1"), HasSubstr("no variable 'z'"))));
  EXPECT_THAT(applying({"x[4]", 1.0, "", "a.ssv:2"}),
              ThrowsMessage<Error>(AllOf(HasSubstr("a.ssv:2"), HasSubstr("expected 1 to 3"))));
  EXPECT_THAT(applying({"x", 1.0, "rad", "a.ssv:3"}),
              ThrowsMessage<Error>(AllOf(HasSubstr("a.ssv:3"), HasSubstr("rad cannot give m"))));
  EXPECT_THAT(applying({"x", true, "", "a.ssv:4"}), ThrowsMessage<Error>(HasSubstr("a.ssv:4")));
  EXPECT_THAT(applying({"y", 1.0, "", "a.ssv:5"}),
              ThrowsMessage<Error>(AllOf(HasSubstr("a.ssv:5"), HasSubstr("is an output"))));
}

Settings cell_settings(std::string_view query) {
  SettingList list;
  list.cell();
  Settings s("world", query, {}, {std::filesystem::path(places::source()) / "tests/components/data"});
  s.declare(std::move(list));
  return s;
}

TEST(Settings, LockAndFreeJointsOfOneOfSeveralRobots) {
  const std::string robots = "robots=left:finger.urdf,right:finger.urdf";
  const scene::Cell cell = cell_settings(robots + "&lock=left/knuckle:0.3&passive=right/shoulder,right/knuckle").cell();
  EXPECT_EQ(cell.robots[0].model.n(), 1);
  EXPECT_TRUE(cell.robots[0].model.mimics.empty());  // they stand still with their leader
  EXPECT_FALSE(cell.robots[0].model.joints[0].passive);
  EXPECT_EQ(cell.robots[1].model.n(), 2);
  EXPECT_TRUE(cell.robots[1].model.joints[0].passive && cell.robots[1].model.joints[1].passive);
  for (const char* wrong : {"&lock=knuckle:0.3", "&lock=up/knuckle:0.3", "&passive=shoulder"}) {
    EXPECT_THAT([&] { cell_settings(robots + wrong).cell(); },
                ThrowsMessage<Error>(HasSubstr("names no robot, expected robot/joint")))
        << wrong;
  }
}

TEST(Settings, ReadAFileOnceForAllWhoShareAStore) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "cotwin_settings_store";
  std::filesystem::create_directories(folder);
  const std::filesystem::path models = std::filesystem::path(places::source()) / "models";
  std::filesystem::copy_file(models / "robots/planar2/robot.urdf", folder / "arm.urdf",
                             std::filesystem::copy_options::overwrite_existing);
  const auto store = std::make_shared<FileStore>();
  const auto with = [&](const std::string& query, const std::shared_ptr<FileStore>& models_of) {
    SettingList list;
    list.cell();
    auto s = std::make_unique<Settings>("world", query, std::map<std::string, std::string>{}, std::vector{folder, models},
                                        models_of);
    s->declare(std::move(list));
    return s;
  };
  const auto first = with("robot=arm.urdf", store), second = with("robot=arm.urdf", store);
  const robot::RobotModel robot = first->robot();
  second->robot();
  EXPECT_EQ(first->robot_used(), second->robot_used());
  EXPECT_EQ(second->robot_files(), std::vector{folder / "arm.urdf"});
  // Another setting is another robot.
  EXPECT_EQ(with("robot=arm.urdf&lock=" + robot.joints[0].name + ":0.1", store)->robot().n(), robot.n() - 1);
  EXPECT_NE(with("robot=arm.urdf", nullptr)->robot_used(), first->robot_used());
  const auto cell = with("robot=arm.urdf&scene=table", store), same = with("robot=arm.urdf&scene=table", store);
  const scene::Cell read = cell->cell();
  same->cell();
  EXPECT_EQ(cell->cell_used(), same->cell_used());
  EXPECT_EQ(read.robots.size(), 1u);
  EXPECT_FALSE(read.scene.bodies.empty());
  EXPECT_TRUE(with("robot=arm.urdf", store)->cell().scene.bodies.empty());
  EXPECT_TRUE(with("robot=arm.urdf&scene=table&robot_shapes=none", store)->cell().robots[0].shapes[1].empty());
  const auto idle = with("scene=table&lock=elbow:0", store);
  idle->cell();
  EXPECT_THAT([&] { idle->check_all_used(); }, ThrowsMessage<Error>(HasSubstr("has no effect")));
  // A file that was read is not read again; one that could not be read is.
  std::ofstream(folder / "arm.urdf") << "<robot";
  EXPECT_EQ(with("robot=arm.urdf", store)->robot().n(), robot.n());
  std::ofstream(folder / "late.urdf") << "<robot";
  EXPECT_THROW(with("robot=late.urdf", store)->robot(), Error);
  std::filesystem::copy_file(models / "robots/planar2/robot.urdf", folder / "late.urdf",
                             std::filesystem::copy_options::overwrite_existing);
  EXPECT_EQ(with("robot=late.urdf", store)->robot().n(), robot.n());
  std::filesystem::remove_all(folder);
}

TEST(Settings, AXacroFileAsRobotIsReadAndRefusedWithAHint) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "cotwin_settings_xacro";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "arm.xacro") << "<robot xmlns:xacro=\"http://wiki.ros.org/xacro\"><xacro:arm/></robot>";
  SettingList list;
  list.robot("a robot");
  Settings s("line", "robot=arm.xacro", {}, {folder});
  s.declare(std::move(list));
  EXPECT_THAT([&] { s.robot(); }, ThrowsMessage<Error>(HasSubstr("expand it first: xacro FILE > robot.urdf")));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace cotwin::settings_test
