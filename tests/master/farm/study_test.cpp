// Studies as JSON and from options.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/json/request.h"
#include "master/farm/study.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::master::study_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::TemporaryFolder;
using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;

Study read(const std::string& json, const std::filesystem::path& folder = "/plant") {
  return read_study(services::parse_object(json), "study.json", folder);
}

TEST(Study, ReadsAllMembers) {
  const Study study = read(R"({"scenario": "cells/twin.ssd", "design": "sobol", "runs": 100, "set": "drive.K={K} {K}",
    "vary": {"K": {"log_uniform": [1e3, 1e5]}, "robot": {"values": ["lwr4", "panda"]}, "world.up": {"values": [true, 2, 0.5]},
             "x": {"from": 0, "to": 1, "points": 5}, "y": {"normal": [0, 1], "min": -2, "max": 2}},
    "keep": ["figures", "peak world.force"], "success": ["peak world.force<30", "drive.done"], "stop_s": 1.5, "limit_s": 20})");
  EXPECT_EQ(study.name, "study");
  EXPECT_EQ(study.scenario, "/plant/cells/twin.ssd");
  EXPECT_EQ(study.design.kind, DesignKind::kSobol);
  EXPECT_EQ(study.design.runs, 100);
  ASSERT_EQ(study.design.factors.size(), 5u);
  EXPECT_EQ(study.design.factors[2].distribution.values, (std::vector<std::string>{"true", "2", "0.5"}));
  EXPECT_EQ(study.design.factors[3].distribution.values, (std::vector<std::string>{"0", "0.25", "0.5", "0.75", "1"}));
  EXPECT_EQ(study.design.factors[4].distribution.min, -2);
  EXPECT_EQ(study.stop, 1.5);
  EXPECT_EQ(study.limit, 20);
  EXPECT_EQ(study.assignments({"2000", "panda", "true", "0.25", "-1"}),
            (std::vector<std::string>{"drive.K=2000 2000", "robot=panda", "world.up=true", "x=0.25", "y=-1"}));
  // Its text is the study, wherever it is read.
  EXPECT_EQ(read_study(Json::parse(study.text), "elsewhere", "/").text, study.text);
}

TEST(Study, TakesTheRunsOfAGridFromItsValues) {
  const Study study = read(R"({"scenario": "a.ssd", "design": "grid",
    "vary": {"a": {"values": [1, 2, 3]}, "b": {"from": 0, "to": 1, "points": 4}}})");
  EXPECT_EQ(study.design.runs, 12);
  EXPECT_EQ(study.design.point(12), (std::vector<std::string>{"3", "1"}));
}

TEST(Study, TakesRunsFromATable) {
  const TemporaryFolder folder("study");
  folder.write("runs.csv", "drive.K[1],robot\n1000,lwr4\n2000.5,panda\n");
  const Study study = read(R"({"scenario": "a.ssd", "table": "runs.csv"})", folder.path());
  EXPECT_EQ(study.design.runs, 2);
  EXPECT_EQ(study.assignments(study.design.point(2)), (std::vector<std::string>{"drive.K[1]=2000.5", "robot=panda"}));
  folder.write("empty.csv", "a,b\n");
  EXPECT_THAT(error_of([&] { read(R"({"scenario": "a.ssd", "table": "empty.csv"})", folder.path()); }),
              HasSubstr("has no rows"));
  EXPECT_THAT(error_of([&] { read(R"({"scenario": "a.ssd", "table": "none.csv"})", folder.path()); }), HasSubstr("none.csv"));
  EXPECT_THAT(error_of([&] { read(R"({"scenario": "a.ssd", "table": "runs.csv", "vary": {}})", folder.path()); }),
              HasSubstr("/table: is given beside vary"));
}

TEST(Study, RefusesWhatIsNone) {
  const auto refused = [](const std::string& members) {
    return error_of([&] { read(R"({"scenario": "a.ssd", )" + members + "}"); });
  };
  EXPECT_EQ(error_of([] { read(R"({"runs": 1, "vary": {"a": {"uniform": [0, 1]}}})"); }),
            "study.json: /scenario: is missing, expected it in the request");
  EXPECT_THAT(refused(R"("runs": 3)"), HasSubstr("/vary: is missing"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {})"), HasSubstr("/vary: is missing"));
  EXPECT_THAT(refused(R"("vary": {"a": {"uniform": [0, 1]}})"), HasSubstr("/runs: is missing"));
  EXPECT_THAT(refused(R"("runs": 0, "vary": {"a": {"uniform": [0, 1]}})"),
              HasSubstr("/runs: is 0, expected a whole number from 1"));
  EXPECT_THAT(refused(R"("runs": 1e3, "vary": {"a": {"uniform": [0, 1]}})"), HasSubstr("/runs"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": {"uniform": [1, 0]}})"), HasSubstr("/vary/a: uniform: expected [low, high]"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": {"gauss": [1, 0]}})"), HasSubstr("/vary/a: expected one of values, uniform"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": {"uniform": [0, 1], "normal": [0, 1]}})"),
              HasSubstr("/vary/a: expected one of"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": {"uniform": [0, 1], "mode": 1}})"),
              HasSubstr("/vary/a/mode: is an unknown member"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": {"values": []}})"), HasSubstr("/vary/a"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": {"values": [null]}})"), HasSubstr("/vary/a/values/0: is of type null"));
  EXPECT_THAT(refused(R"("runs": 3, "vary": {"a": 5})"), HasSubstr("/vary/a: is of type number, expected an object"));
  EXPECT_THAT(refused(R"("runs": 3, "design": "grid", "vary": {"a": {"values": [1]}})"),
              HasSubstr("/runs: is given, but has no effect"));
  EXPECT_THAT(refused(R"("design": "grid", "vary": {"a": {"uniform": [0, 1]}})"), HasSubstr("/vary/a: expected values"));
  EXPECT_THAT(refused(R"("design": "halton", "runs": 3, "vary": {"a": {"uniform": [0, 1]}})"),
              HasSubstr("/design: is 'halton', expected one of latin_hypercube, sobol, random, grid, table"));
  EXPECT_THAT(refused(R"("design": "sobol", "seed": 3, "runs": 3, "vary": {"a": {"uniform": [0, 1]}})"), HasSubstr("/seed"));
  EXPECT_THAT(refused(R"("design": "table")"), HasSubstr("/table: is missing"));
  EXPECT_THAT(refused(R"("rnus": 3, "runs": 3, "vary": {"a": {"uniform": [0, 1]}})"), HasSubstr("/rnus: is an unknown member"));
  EXPECT_THAT(refused(R"("set": ["b=2", "a=1"], "runs": 3, "vary": {"a": {"uniform": [0, 1]}})"),
              HasSubstr("/set: a varies, expected it in vary or in set"));
  EXPECT_THAT(refused(R"("limit_s": 0, "runs": 3, "vary": {"a": {"uniform": [0, 1]}})"), HasSubstr("/limit_s"));
  std::string many =
      R"("design": "grid", "vary": {"a": {"from": 0, "to": 1, "points": 100000}, "b": {"from": 0, "to": 1, "points": 100000}})";
  EXPECT_THAT(refused(many), HasSubstr("gives a grid of more than 1000000000 runs"));
}

TEST(Study, ReadsTheOptionVary) {
  const auto read_option = [](const char* option) { return distribution_of(option).dump(); };
  EXPECT_EQ(read_option("0:1"), R"({"uniform":[0.0,1.0]})");
  EXPECT_EQ(read_option("-1e-3:1e-3"), R"({"uniform":[-0.001,0.001]})");
  EXPECT_EQ(read_option("normal:2:0.5"), R"({"normal":[2.0,0.5]})");
  EXPECT_EQ(read_option("triangular:0:1:3"), R"({"triangular":[0.0,1.0,3.0]})");
  EXPECT_EQ(read_option("lwr4,panda"), R"({"values":["lwr4","panda"]})");
  EXPECT_EQ(read_option("1"), R"({"values":["1"]})");
  EXPECT_EQ(read_option("finger:0.02"), R"({"values":["finger:0.02"]})");
}

}  // namespace
}  // namespace cotwin::master::study_test
