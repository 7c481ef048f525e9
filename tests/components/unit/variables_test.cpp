#include "components/unit/variables.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::variables_test {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

struct Members {
  double K = 1;
  std::vector<double> q = {1, 2, 3};
  std::array<std::int32_t, 2> mode = {4, 5};
  bool on = false;
  std::string file;
  Eigen::VectorXd tau = Eigen::VectorXd::Zero(3);
  std::vector<double> dq = {0, 0, 0};
};

Variables declare(Members& m) {
  Variables v;
  v.parameter("K", m.K, "N.m/rad", "joint stiffness").range(0, 10);
  v.input("q", m.q, "rad", "joint position").rate(m.dq);
  v.tunable("mode", m.mode, "what to do").range(0, 7);
  v.state("on", m.on, "whether it runs");
  v.parameter("file", m.file, "name of a file");
  v.output("tau", m.tau, "N.m", "joint torque");
  return v;
}

TEST(Variables, AreTheMembersOfTheirUnit) {
  Members m;
  const Variables v = declare(m);
  v.at("tau").reals()[1] = 7;
  EXPECT_EQ(m.tau[1], 7);
  m.q[2] = 9;
  EXPECT_EQ(v.at("q").reals()[2], 9);
  EXPECT_EQ(v.at("q").rate.data(), m.dq.data());
  EXPECT_EQ(v.at("mode").kind(), Kind::kInteger);
  EXPECT_EQ(v.at("on").kind(), Kind::kBoolean);
  EXPECT_EQ(v.at("file").kind(), Kind::kString);
}

TEST(Variables, RefuseADeclarationThatIsIncomplete) {
  double x = 0;
  Variables v;
  v.input("x", x, "m", "position");
  EXPECT_THAT([&] { v.input("x", x, "m", "position"); }, ThrowsMessage<Error>(HasSubstr("declared twice")));
  EXPECT_THAT([&] { v.input("2x", x, "m", "position"); }, ThrowsMessage<Error>(HasSubstr("expected a name")));
  EXPECT_THAT([&] { v.input("y", x, "", "position"); }, ThrowsMessage<Error>(HasSubstr("unit of measure")));
  EXPECT_THAT([&] { v.input("y", x, "deg", "angle"); }, ThrowsMessage<Error>(HasSubstr("expected SI")));
  EXPECT_THAT([&] { v.input("y", x, "m", ""); }, ThrowsMessage<Error>(HasSubstr("without a description")));
}

TEST(Variables, RefuseAnEssentialOutput) {
  Variables v;
  double value = 0;
  EXPECT_THROW(v.output("y", value, "m", "an output").essential(), Error);
  v.input("u", value, "m", "an input").essential();
  EXPECT_TRUE(v.at("u").essential);
}

TEST(Variables, HaveANominalValueThatIsAMagnitude) {
  Members m;
  Variables v = declare(m);
  const std::uint64_t before = v.fingerprint();
  EXPECT_EQ(v.at("tau").nominal, 0);
  Variables with;
  with.parameter("K", m.K, "N.m/rad", "joint stiffness").range(0, 10).nominal(5);
  with.input("q", m.q, "rad", "joint position").rate(m.dq).nominal(0.1);
  with.tunable("mode", m.mode, "what to do").range(0, 7);
  with.state("on", m.on, "whether it runs");
  with.parameter("file", m.file, "name of a file");
  with.output("tau", m.tau, "N.m", "joint torque").nominal(200);
  EXPECT_EQ(with.at("tau").nominal, 200);
  EXPECT_EQ(with.fingerprint(), before);  // snapshots stay readable
  double x = 0;
  auto declared = v.output("x", x, "m", "position");
  for (const double wrong : {0.0, -1.0, double{INFINITY}, double{NAN}}) {
    EXPECT_THAT([&] { declared.nominal(wrong); }, ThrowsMessage<Error>(HasSubstr("expected a positive and finite number")));
  }
  EXPECT_EQ(v.at("x").nominal, 0);
  EXPECT_THAT([&] { v.output("word", m.file, "a text").nominal(1); }, ThrowsMessage<Error>(HasSubstr("only for reals")));
}

TEST(Variables, SuggestTheClosestNameForAMisspeltOne) {
  Members m;
  const Variables v = declare(m);
  EXPECT_EQ(v.find("taw"), nullptr);
  EXPECT_THAT([&] { (void)v.at("taw"); }, ThrowsMessage<Error>(HasSubstr("did you mean 'tau'?")));
}

TEST(Variables, NameElementValueAndRangeOfAValueOutside) {
  Members m;
  const Variables v = declare(m);
  EXPECT_NO_THROW(v.check_ranges());
  m.K = -1;
  EXPECT_THAT([&] { v.check_ranges(); }, ThrowsMessage<Error>(HasSubstr("K = -1 N.m/rad, expected 0 to 10")));
  m.K = std::nan("");
  EXPECT_THROW(v.check_ranges(), Error);
  m.K = 1;
  m.mode[1] = 8;
  EXPECT_THAT([&] { v.check_ranges(); }, ThrowsMessage<Error>(HasSubstr("mode[2] = 8, expected 0 to 7")));
  m.mode[1] = 7;
  m.q[1] = std::nan("");
  EXPECT_THAT([&] { v.check_ranges(); }, ThrowsMessage<Error>(HasSubstr("q[2] = nan rad, expected a number")));
}

TEST(Variables, DescribeTheirRange) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double x = 0;
  Variables v;
  v.parameter("between", x, "1", "bounded on both sides").range(-1, 2.5);
  v.parameter("above", x, "1", "bounded below").range(0, kInfinity);
  v.parameter("below", x, "1", "bounded above").range(-kInfinity, 3);
  v.parameter("free", x, "1", "not bounded");
  EXPECT_EQ(allowed_values(v.at("between")), "-1 to 2.5");
  EXPECT_EQ(allowed_values(v.at("above")), ">= 0");
  EXPECT_EQ(allowed_values(v.at("below")), "<= 3");
  EXPECT_EQ(allowed_values(v.at("free")), "a number");
}

TEST(Variables, FindTheFirstOutputThatIsNotFinite) {
  Members m;
  const Variables v = declare(m);
  EXPECT_EQ(v.first_not_finite(), "");
  m.q[0] = INFINITY;  // the source of an input is responsible for its values
  EXPECT_EQ(v.first_not_finite(), "");
  m.tau[2] = NAN;
  EXPECT_EQ(v.first_not_finite(), "tau[3]");
}

TEST(Variables, HaveAFingerprintOfTheirLayoutAndNotOfTheirValues) {
  Members a, b;
  b.K = 5;
  EXPECT_EQ(declare(a).fingerprint(), declare(b).fingerprint());
  b.q.push_back(4);
  b.dq.push_back(0);
  EXPECT_NE(declare(a).fingerprint(), declare(b).fingerprint());
  Variables ranged = declare(a);
  const std::uint64_t before = ranged.fingerprint();
  double x = 0;
  ranged.input("x", x, "m", "position").range(0, 1);
  EXPECT_NE(ranged.fingerprint(), before);
}

TEST(AssignText, WritesOneValueForAllOrAsManyAsThereAre) {
  Members m;
  const Variables v = declare(m);
  assign_text(v.at("q"), "4");
  EXPECT_THAT(m.q, ::testing::ElementsAre(4, 4, 4));
  assign_text(v.at("q"), "1, 2,3e-1");
  EXPECT_THAT(m.q, ::testing::ElementsAre(1, 2, 0.3));
  assign_text(v.at("q"), "7 8  9");
  EXPECT_THAT(m.q, ::testing::ElementsAre(7, 8, 9));
  assign_text(v.at("q"), 1, "-1");
  EXPECT_THAT(m.q, ::testing::ElementsAre(7, -1, 9));
  assign_text(v.at("on"), "true");
  EXPECT_TRUE(m.on);
  assign_text(v.at("file"), "a file, with blanks.csv");
  EXPECT_EQ(m.file, "a file, with blanks.csv");
}

TEST(AssignText, ChangesNothingWhereTheTextIsWrong) {
  Members m;
  const Variables v = declare(m);
  EXPECT_THAT([&] { assign_text(v.at("q"), "1,2"); }, ThrowsMessage<Error>(HasSubstr("2 values, expected 1 or 3")));
  EXPECT_THAT([&] { assign_text(v.at("q"), "1,2,x"); }, ThrowsMessage<Error>(HasSubstr("'x', expected a number in rad")));
  EXPECT_THROW(assign_text(v.at("q"), ""), Error);
  EXPECT_THROW(assign_text(v.at("q"), "1,,3"), Error);
  EXPECT_THROW(assign_text(v.at("q"), 3, "1"), Error);
  EXPECT_THROW(assign_text(v.at("mode"), "1.5"), Error);
  EXPECT_THROW(assign_text(v.at("mode"), "3000000000"), Error);
  EXPECT_THROW(assign_text(v.at("on"), "yes"), Error);
  EXPECT_THAT(m.q, ::testing::ElementsAre(1, 2, 3));
  EXPECT_THAT(m.mode, ::testing::ElementsAre(4, 5));
}

TEST(ElementName, CountsFromOne) {
  EXPECT_EQ(parse_element_name("tau_J").element, -1);
  EXPECT_EQ(parse_element_name("tau_J[3]").name, "tau_J");
  EXPECT_EQ(parse_element_name("tau_J[3]").element, 2);
  for (const char* wrong : {"", "q[0]", "q[x]", "q[", "q[]", "[1]", "q[1", "q[-1]", "q[1]x"}) {
    EXPECT_THROW(parse_element_name(wrong), Error) << wrong;
  }
}

}  // namespace
}  // namespace cotwin::variables_test
