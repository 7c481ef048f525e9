#include "components/unit/settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "components/unit/unit_table.h"
#include "models/text/error.h"

namespace cotwin {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// A unit whose length is a setting.
class Line final : public Unit {
 public:
  explicit Line(Settings& settings) : x_(static_cast<std::size_t>(settings.integer("length", 3, 1, 100))) {
    if (settings.boolean("loud", false)) settings.warn("loud");
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

const UnitType kTypes[] = {
    {"line", "places along a line", [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Line>(s); }}};

TEST(Settings, TakeTheQueryBeforeTheDefaultsBeforeTheFallback) {
  Settings s("line", "a=1&b=x%20y", {{"a", "2"}, {"c", "3"}}, {});
  EXPECT_EQ(s.text("a", "0"), "1");
  EXPECT_EQ(s.text("b", "0"), "x y");
  EXPECT_EQ(s.text("c", "0"), "3");
  EXPECT_EQ(s.text("d", "0"), "0");
  EXPECT_THAT(s.defaults_used(), ::testing::ElementsAre("c"));
}

TEST(Settings, SayWhatIsWrongWithAValue) {
  Settings s("line", "n=7x&on=maybe&colour=blau", {}, {});
  EXPECT_THAT([&] { s.integer("n", 1, 0, 9); }, ThrowsMessage<Error>(HasSubstr("n=7x, expected an integer from 0 to 9")));
  EXPECT_THAT([&] { s.boolean("on", true); }, ThrowsMessage<Error>(HasSubstr("expected true or false")));
  EXPECT_THAT([&] { s.choice("colour", {"red", "blue"}); }, ThrowsMessage<Error>(HasSubstr("expected one of red, blue")));
  EXPECT_THAT([&] { s.text("robot"); }, ThrowsMessage<Error>(HasSubstr("needs the setting 'robot'")));
  EXPECT_THROW(Settings("line", "n", {}, {}), Error);
  EXPECT_THROW(Settings("line", "n=1&n=2", {}, {}), Error);
}

TEST(Settings, ListTheFoldersInWhichAFileWasNotFound) {
  const std::filesystem::path here = COTWIN_SOURCE_DIR;
  Settings s("line", "robot=lwr4", {}, {here / "tests", here / "models"});
  EXPECT_EQ(s.robot_file(), here / "models/robots/lwr4/robot.urdf");
  EXPECT_THAT([&] { (void)s.file("no.csv"); }, ThrowsMessage<Error>(AllOf(HasSubstr((here / "tests/no.csv").string()),
                                                                          HasSubstr((here / "models/no.csv").string()))));
}

TEST(MakeUnit, BuildsDeclaresAndWarns) {
  std::vector<std::string> used;
  const Instance line = make_unit("unit:line?loud=true", {{"length", "5"}, {"robot", "lwr4"}}, {}, kTypes, &used);
  EXPECT_EQ(line.variables.at("x").size(), 5u);
  EXPECT_THAT(line.warnings, ::testing::ElementsAre("loud"));
  EXPECT_THAT(used, ::testing::ElementsAre("length"));
}

TEST(MakeUnit, NamesWhatItDoesNotKnow) {
  EXPECT_THAT([] { make_unit("unit:lime", {}, {}, kTypes); }, ThrowsMessage<Error>(HasSubstr("did you mean 'line'?")));
  EXPECT_THAT([] { make_unit("unit:line?lenght=2", {}, {}, kTypes); },
              ThrowsMessage<Error>(HasSubstr("did you mean 'length'?")));
  EXPECT_THAT([] { make_unit("line", {}, {}, kTypes); }, ThrowsMessage<Error>(HasSubstr("expected unit:<name>")));
}

TEST(Apply, WritesAParameterSetAndConvertsItsMeasures) {
  const Instance line = make_unit("unit:line", {}, {}, kTypes);
  ParameterSet set;
  set.values = {{"x", 1.0, "", "a.ssv:1"}, {"x[2]", 250.0, "mm", "a.ssv:2"}, {"x[3]", std::int64_t{4}, "", "a.ssv:3"}};
  apply(set, line.variables);
  EXPECT_THAT(line.variables.at("x").reals(), ::testing::ElementsAre(1.0, 0.25, 4.0));
}

TEST(Apply, NamesThePlaceOfWhatDoesNotFit) {
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

}  // namespace
}  // namespace cotwin
