// Profiles in closed form, against all shapes one by one, and by the statistics of their noise.
#include "components/scanner/scanner.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "components/unit/snapshot.h"
#include "models/collision/ray.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/components/monitor/slides.h"
#include "tests/models/collision/random_shapes.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::scanner::scanner_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::UnitSubject;
using Eigen::Vector3d;
using ::testing::Each;
using ::testing::HasSubstr;

/// A scanner before the ball that slides along x, which looks along x at a plate at x = 3.
class Scanners : public monitor::Slides {
 protected:
  UnitSubject scanner(const std::string& query) const {
    UnitSubject made = unit("unit:scanner?" + query);
    const double half = std::sqrt(0.5);
    made.set("mount_p", std::vector<double>{0.2, 0, 0}).set("mount_quat", std::vector<double>{half, 0, half, 0});
    return made;
  }
  UnitSubject before_plate(const std::string& more = "") const {
    UnitSubject made = scanner("robot=@slide.urdf&scene=@plate.sdf&frame=arm&beams=101" + more);
    made.set("opening", std::vector{1.0}).set("q", std::vector<double>{0, 0, 2});
    return made;
  }
  static void trigger(UnitSubject& unit, double seconds = 1e-3) {
    unit.set("trigger", "false");
    unit.step(1e-3);
    unit.set("trigger", "true");
    unit.step(seconds);
  }
  static double angle(const UnitSubject& unit, std::size_t beam) {
    return (static_cast<double>(beam) - (static_cast<double>(unit.values("ranges").size()) - 1) / 2) *
           unit.real("angle_increment");
  }
  /// The point that a beam met, in W.
  static Vector3d point(const UnitSubject& unit, std::size_t beam) {
    const std::vector<double> Q = unit.values("quat_scan");
    const double a = angle(unit, beam), r = unit.real("ranges", beam);
    return unit.vector("p_scan") + Eigen::Quaterniond(Q[0], Q[1], Q[2], Q[3]) * Vector3d(r * std::sin(a), 0, r * std::cos(a));
  }
  static std::string notes_of(UnitSubject& unit) {
    std::vector<std::string> notes;
    unit.unit().append_notes(notes);
    std::string all;
    for (const std::string& note : notes) all += note + "\n";
    return all;
  }
};

TEST_F(Scanners, MeasureAPlateInClosedForm) {
  UnitSubject unit = before_plate();
  unit.initialise();
  EXPECT_EQ(unit.integer("count"), 0);
  EXPECT_THAT(unit.values("ranges"), Each(0.0));
  unit.set("trigger", "true");
  unit.step(1e-3);
  EXPECT_EQ(unit.integer("count"), 1);
  EXPECT_EQ(unit.real("angle_increment"), 0.01);
  EXPECT_LT((unit.vector("p_scan") - Vector3d(0.2, 0, 0)).norm(), 1e-15);
  for (std::size_t i = 0; i < 101; ++i) {
    const double d = 3 - 0.0005 - 0.2;
    EXPECT_NEAR(unit.real("ranges", i), d / std::cos(angle(unit, i)), 1e-13);
    // x of the scanner looks down.
    EXPECT_LT((point(unit, i) - Vector3d(2.9995, 0, -d * std::tan(angle(unit, i)))).norm(), 1e-13);
  }
  EXPECT_THAT(notes_of(unit), HasSubstr("took 1 profile; 100 % of the beams came back"));
  unit.set("range_max", std::vector{3.0}).set("range_min", std::vector{2.9});
  unit.set("trigger", "false");
  unit.initialise();
  trigger(unit);
  for (std::size_t i = 0; i < 101; ++i) {
    const double d = 2.7995 / std::cos(angle(unit, i));
    EXPECT_NEAR(unit.real("ranges", i), d >= 2.9 && d <= 3 ? d : 0, 1e-13);
  }
}

TEST_F(Scanners, MeasureOneBeamAlongTheMiddle) {
  UnitSubject unit = scanner("robot=@slide.urdf&scene=@plate.sdf&frame=arm&beams=1");
  unit.set("q", std::vector<double>{1, 0, 2}).set("trigger", "true");
  unit.initialise();
  EXPECT_NEAR(unit.real("ranges"), 1.7995, 1e-13);
}

// A rising edge, once, of where everything was at the beginning of the step.
TEST_F(Scanners, TakeOneProfileOfTheBeginningOfTheStepInWhichTheTriggerRises) {
  for (const double h : {1e-3, 0.5e-3, 2e-3}) {
    UnitSubject unit = before_plate();
    unit.set("sigma", std::vector{0.01});
    unit.initialise();
    std::vector<double> first;
    const int at = static_cast<int>(std::lround(0.02 / h));
    for (int k = 0; k < 2 * at; ++k) {
      unit.set("trigger", k >= at ? "true" : "false");
      unit.set("q", std::vector<double>{10 * h * (k + 1), 0, 2});
      unit.step(h);
      if (k < at) {
        EXPECT_EQ(unit.integer("count"), 0);
        continue;
      }
      EXPECT_EQ(unit.integer("count"), 1);
      EXPECT_NEAR(unit.real("t_scan"), 0.02, 1e-12);
      EXPECT_NEAR(unit.real("p_scan", 0), 0.2 + 0.2, 1e-12);
      if (first.empty()) first = unit.values("ranges");
      EXPECT_EQ(unit.values("ranges"), first);  // held
    }
    static std::vector<double> of_first_step;
    if (of_first_step.empty()) of_first_step = first;
    for (std::size_t i = 0; i < first.size(); ++i) EXPECT_NEAR(first[i], of_first_step[i], 1e-12) << h;
    trigger(unit);
    EXPECT_EQ(unit.integer("count"), 2);
  }
}

TEST_F(Scanners, TakeAProfileAtTheStartIfTheTriggerIsSetThen) {
  UnitSubject unit = before_plate();
  unit.set("trigger", "true");
  unit.initialise();
  EXPECT_EQ(unit.integer("count"), 1);
  EXPECT_EQ(unit.real("t_scan"), 0);
  EXPECT_NEAR(unit.real("ranges", 50), 2.7995, 1e-13);
  unit.step(1e-3);
  EXPECT_EQ(unit.integer("count"), 1);
  unit.initialise();
  EXPECT_EQ(unit.integer("count"), 1);
}

TEST_F(Scanners, RepeatTheirNoiseAfterASnapshotAndInAnyNumberOfSteps) {
  UnitSubject unit = before_plate();
  unit.set("sigma", std::vector{0.01}).set("dropout", std::vector{0.2});
  unit.initialise();
  trigger(unit);
  Snapshot snapshot;
  snapshot.take(unit.variables(), unit.unit());
  trigger(unit);
  const std::vector<double> second = unit.values("ranges");
  snapshot.restore(unit.variables(), unit.unit());
  EXPECT_EQ(unit.integer("count"), 1);
  for (int k = 0; k < 7; ++k) {
    unit.set("trigger", "false");
    unit.step(1e-4);
  }
  trigger(unit, 5e-3);
  EXPECT_EQ(unit.values("ranges"), second);
  unit.set("seed", 2);
  unit.initialise();
  trigger(unit);
  trigger(unit);
  EXPECT_NE(unit.values("ranges"), second);
}

TEST_F(Scanners, HaveTheNoiseResolutionAndDropoutOfTheirParameters) {
  UnitSubject unit = before_plate();
  unit.set("sigma", std::vector{0.004}).set("dropout", std::vector{0.1}).set("seed", 7);
  unit.initialise();
  double n = 0, sum = 0, square = 0, lost = 0, product = 0, last = 0;
  for (int k = 0; k < 400; ++k) {
    trigger(unit);
    for (std::size_t i = 0; i < 101; ++i) {
      const double r = unit.real("ranges", i), e = (r - 2.7995 / std::cos(angle(unit, i))) / 0.004;
      ++n;
      if (r == 0) {
        ++lost;
        last = 0;
        continue;
      }
      sum += e;
      square += e * e;
      product += e * last;
      last = e;
    }
  }
  const double met = n - lost;  // about 36 360
  EXPECT_NEAR(lost / n, 0.1, 4 * std::sqrt(0.09 / n));
  EXPECT_NEAR(sum / met, 0, 4 / std::sqrt(met));
  EXPECT_NEAR(square / met, 1, 4 * std::sqrt(2 / met));
  EXPECT_NEAR(product / met, 0, 4 / std::sqrt(met));
  unit.set("resolution", std::vector{0.01}).set("sigma", std::vector{0.0}).set("dropout", std::vector{0.0});
  unit.initialise();
  trigger(unit);
  for (std::size_t i = 0; i < 101; ++i) {
    const double d = 2.7995 / std::cos(angle(unit, i)), r = unit.real("ranges", i);
    EXPECT_LE(std::abs(r - d), 0.005 + 1e-12);
    EXPECT_NEAR(r / 0.01, std::round(r / 0.01), 1e-9);
  }
  unit.set("dropout", std::vector{1.0});
  unit.initialise();
  trigger(unit);
  EXPECT_THAT(unit.values("ranges"), Each(0.0));
}

TEST_F(Scanners, SeeTheLinksOfTheirOwnRobot) {
  UnitSubject unit = before_plate();
  unit.set("q", std::vector<double>{0, 0, 0}).set("trigger", "true");
  unit.initialise();
  for (std::size_t i = 0; i < 101; ++i) {
    const double a = angle(unit, i), beside = 0.2 * std::sin(a);
    const double expected =
        std::abs(beside) <= 0.05 ? 0.2 * std::cos(a) - std::sqrt(0.0025 - beside * beside) : 2.7995 / std::cos(a);
    EXPECT_NEAR(unit.real("ranges", i), expected, 1e-12) << i;
  }
  // Turned by 90°: along y, past the plate's edge at y = 4 is nothing; the hand turns with it.
  unit.set("q", std::vector<double>{0, std::numbers::pi / 2, 0});
  unit.initialise();
  EXPECT_NEAR(unit.real("ranges", 50), 0.15, 1e-12);
  EXPECT_EQ(unit.real("ranges", 0), 0);
  UnitSubject through = before_plate("&robot_shapes=none");
  through.set("q", std::vector<double>{0, 0, 0}).set("trigger", "true");
  through.initialise();
  EXPECT_NEAR(through.real("ranges", 50), 2.7995, 1e-13);
  EXPECT_EQ(through.instance().warnings.size(), 0u);
  UnitSubject bare = scanner("robot=@bare.urdf&scene=@plate.sdf&frame=arm&beams=3");
  EXPECT_THAT(bare.instance().warnings.at(0), HasSubstr("robot 'slide': no shapes, so that no beam meets them"));
  bare.set("trigger", "true");
  bare.initialise();
  EXPECT_NEAR(bare.real("ranges", 1), 2.7995, 1e-13);
}

TEST_F(Scanners, MeasureNothingFromInsideABodyAndSaySo) {
  UnitSubject unit = before_plate();
  unit.set("mount_p", std::vector<double>{0.05, 0, 0}).set("sigma", std::vector{0.1});
  unit.initialise();
  trigger(unit);
  trigger(unit);
  EXPECT_THAT(unit.values("ranges"), Each(0.0));
  EXPECT_THAT(notes_of(unit), HasSubstr("was inside ball in 2 of them, first at 0.001 s"));
  unit.set("mount_p", std::vector<double>{0.2, 0, 0});
  unit.initialise();
  trigger(unit);
  EXPECT_THAT(notes_of(unit), ::testing::Not(HasSubstr("inside")));
  UnitSubject never = before_plate();
  never.initialise();
  EXPECT_THAT(notes_of(never), HasSubstr("took no profile: trigger never became true"));
}

TEST_F(Scanners, FollowBodiesThatMoveAndAreFixedToThem) {
  UnitSubject unit = scanner("robots=a:@slide.urdf,b:@slide.urdf&scene=@ball.sdf&frame=b/rail&beams=1");
  unit.set("b.base_p0", std::vector<double>{0, 5, 0}).set("obstacle.p", std::vector<double>{2, 5, 0});
  unit.set("b.q", std::vector<double>{-3, 0, 0}).set("a.q", std::vector<double>{0, 0, 3}).set("trigger", "true");
  unit.initialise();
  EXPECT_NEAR(unit.real("ranges"), 2 - 0.2 - 0.2, 1e-13);
  unit.set("obstacle.p", std::vector<double>{4, 5, 0.1});
  unit.set("trigger", "false");
  unit.step(1e-3);
  trigger(unit);
  EXPECT_NEAR(unit.real("ranges"), 4 - 0.2 - std::sqrt(0.04 - 0.01), 1e-12);
  // On the body itself, outside of its ball.
  UnitSubject on = scanner("robot=@slide.urdf&scene=@ball.sdf&frame=obstacle&beams=1");
  on.set("mount_p", std::vector<double>{-0.3, 0, 0})
      .set("mount_quat", std::vector<double>{std::sqrt(0.5), 0, -std::sqrt(0.5), 0});
  on.set("obstacle.p", std::vector<double>{2, 0, 0}).set("q", std::vector<double>{0.5, 0, 3}).set("trigger", "true");
  on.initialise();
  EXPECT_NEAR(on.real("ranges"), 2 - 0.3 - 0.6, 1e-13);
  // A base that moves.
  UnitSubject floats = scanner("robot=@slide.urdf&scene=@plate.sdf&frame=arm&beams=1&base=floating");
  floats.set("base_p", std::vector<double>{0.5, 0, 0}).set("q", std::vector<double>{0, 0, 2}).set("trigger", "true");
  floats.initialise();
  EXPECT_NEAR(floats.real("ranges"), 2.2995, 1e-13);
  // Without a robot.
  UnitSubject alone = scanner("scene=@plate.sdf&frame=plate&beams=1");
  alone.set("mount_p", std::vector<double>{-1, 0, 0}).set("trigger", "true");
  alone.initialise();
  EXPECT_NEAR(alone.real("ranges"), 1 - 0.0005, 1e-13);
}

TEST_F(Scanners, SeeToolsWhileTheyAreThere) {
  folder_.write("finger.urdf",
                "<robot name=\"finger\"><link name=\"tip\"><collision><geometry><sphere radius=\"0.1\"/></geometry></collision>"
                "</link></robot>");
  UnitSubject unit = before_plate("&tools=finger|arm|1 0 0|0 0 0|@finger.urdf");
  unit.initialise();
  trigger(unit);
  EXPECT_NEAR(unit.real("ranges", 50), 2.7995, 1e-13);
  unit.set("tool.finger", std::vector{1.0});
  trigger(unit);
  EXPECT_NEAR(unit.real("ranges", 50), 1 - 0.2 - 0.1, 1e-13);
  unit.set("tool.finger", std::vector{0.0});
  trigger(unit);
  EXPECT_NEAR(unit.real("ranges", 50), 2.7995, 1e-13);
}

// Nothing is left out because it is far away, beside the fan or behind another body.
TEST_F(Scanners, MeetTheFirstOfAllShapes) {
  collision::Random random(3);
  std::string models;
  scene::Scene scene;
  for (int k = 0; k < 50; ++k) {
    const bool box = k % 2 == 0;
    const Vector3d p = random.vector(1.5), size(random.real(0.02, 0.4), random.real(0.02, 0.4), random.real(0.02, 0.4));
    const double turn = random.real(-3, 3);
    scene::Shape s = collision::shape(box ? scene::ShapeType::kBox : scene::ShapeType::kSphere, box ? size : size / 2);
    s.X_BS = {Eigen::AngleAxisd(turn, Vector3d::UnitZ()).toRotationMatrix(), p};
    scene.bodies.emplace_back();
    scene.bodies.back().shapes.push_back(s);
    const auto words = [](const Vector3d& v) {
      char text[100];
      std::snprintf(text, sizeof text, "%.17g %.17g %.17g", v.x(), v.y(), v.z());
      return std::string(text);
    };
    char angle[40];
    std::snprintf(angle, sizeof angle, " 0 0 %.17g", turn);
    models += "<model name=\"m" + std::to_string(k) + "\"><static>true</static><pose>" + words(p) + angle +
              "</pose><link name=\"m" + std::to_string(k) + "\"><collision name=\"c\"><geometry>" +
              (box ? "<box><size>" + words(size) + "</size></box>"
                   : "<sphere><radius>" + words(size / 2).substr(0, words(size / 2).find(' ')) + "</radius></sphere>") +
              "</geometry></collision></link></model>";
  }
  folder_.write("many.sdf", "<sdf version=\"1.11\"><world name=\"w\">" + models + "</world></sdf>");
  UnitSubject unit = this->unit("unit:scanner?robot=ur5e&scene=@many.sdf&beams=181");
  const std::string file = places::source() + "/models/robots/ur5e/robot.urdf";
  const robot::RobotModel ur5e = robot::load_urdf(file);
  const std::vector<std::vector<scene::Shape>> shapes = scene::hulls_of_urdf(file, ur5e);
  ASSERT_EQ(shapes.size(), ur5e.bodies.size() + 1);
  int met = 0, own = 0, inside = 0;
  for (int k = 0; k < 60; ++k) {
    std::vector<double> q(6);
    for (double& x : q) x = random.real(-3, 3);
    const Pose X_FS = random.pose(0.3);
    const Eigen::Quaterniond Q(X_FS.R);
    unit.set("mount_p", {X_FS.p.x(), X_FS.p.y(), X_FS.p.z()}).set("mount_quat", {Q.w(), Q.x(), Q.y(), Q.z()});
    unit.set("opening", std::vector{random.real(0.1, 6.28)}).set("range_max", std::vector{k % 3 == 0 ? 0.8 : 10.0});
    unit.set("q", q).set("trigger", "true");
    unit.initialise();
    std::vector<collision::Convex> all;
    for (const scene::Body& body : scene.bodies) all.push_back(collision::make_convex(body.shapes[0]));
    for (std::size_t i = 0; i < shapes.size(); ++i) {
      Pose X_WL;
      if (i > 0) {
        const Eigen::VectorXd at = Eigen::Map<Eigen::VectorXd>(q.data(), 6), rest = Eigen::VectorXd::Zero(6);
        const robot::FrameMotion motion = robot::FrameKinematics(ur5e, {"", static_cast<int>(i) - 1, {}}).at(at, rest, rest);
        X_WL = {motion.Q.toRotationMatrix(), motion.p};
      }
      for (scene::Shape s : shapes[i]) {
        s.X_BS = X_WL * s.X_BS;
        all.push_back(collision::make_convex(s));
      }
    }
    const bool is_inside = std::ranges::any_of(all, [&](const collision::Convex& convex) {
      return collision::first_along({unit.vector("p_scan"), Vector3d::UnitX()}, convex) == 0;
    });
    inside += is_inside ? 1 : 0;
    for (std::size_t i = 0; i < 181; ++i) {
      const Vector3d from = unit.vector("p_scan");
      const std::vector<double> quat = unit.values("quat_scan");
      const double a = angle(unit, i);
      const Vector3d d = Eigen::Quaterniond(quat[0], quat[1], quat[2], quat[3]) * Vector3d(std::sin(a), 0, std::cos(a));
      double expected = scene::kInfinity;
      std::size_t which = 0;
      for (std::size_t j = 0; j < all.size(); ++j) {
        const double t = collision::first_along({from, d}, all[j]);
        if (t < expected) expected = t, which = j;
      }
      if (expected > unit.real("range_max")) expected = 0;
      EXPECT_NEAR(unit.real("ranges", i), is_inside ? 0 : expected, 1e-9) << k << ' ' << i;
      if (!is_inside && expected > 0) ++(which < 50 ? met : own);
    }
  }
  EXPECT_GT(met, 1000);
  EXPECT_GT(own, 500);
  EXPECT_GT(inside, 1);
  EXPECT_LT(inside, 40);
}

TEST_F(Scanners, AllocateNothing) {
  UnitSubject unit = before_plate();
  unit.set("sigma", std::vector{0.01}).set("dropout", std::vector{0.1});
  unit.initialise();
  bool& on = unit.variables().at("trigger").booleans()[0];
  const std::uint64_t before = testing::allocations();
  for (int k = 0; k < 10; ++k) {
    on = k % 2 == 0;
    unit.step(Duration{1'000'000});
  }
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_EQ(unit.integer("count"), 5);
}

TEST_F(Scanners, RefuseWhatTheyCannotUse) {
  const auto refused = [&](const std::string& query) { return error_of([&] { (void)unit("unit:scanner?" + query); }); };
  EXPECT_THAT(refused("robot=ur5e&frame=wrist_3_lin"),
              HasSubstr("frame=wrist_3_lin: 'wrist_3_lin' is no frame of a robot and no body or frame of "
                        "scene 'none', expected ROBOT/FRAME (FRAME of a single robot), BODY or "
                        "BODY/FRAME; did you mean 'wrist_3_link'?"));
  EXPECT_THAT(refused("scene=table"), HasSubstr("frame: is not given, and there is no robot"));
  EXPECT_THAT(refused("robots=a:ur5e,b:ur5e"), HasSubstr("frame: is not given, and there are several robots"));
  EXPECT_THAT(refused("robots=a:ur5e,b:ur5e&frame=c/flange"), HasSubstr("'c/flange' is no frame"));
  EXPECT_THAT(refused("robot=ur5e&beams=0"), HasSubstr("beams"));
  UnitSubject unit = before_plate();
  unit.set("range_min", std::vector{2.0}).set("range_max", std::vector{2.0});
  EXPECT_THAT(unit.error_of_initialise(), HasSubstr("range_max: is 2 m, expected more than range_min, 2 m"));
  unit.set("range_min", std::vector{0.0}).set("mount_quat", std::vector<double>{1, 1, 0, 0});
  EXPECT_THAT(unit.error_of_initialise(), HasSubstr("mount_quat"));
  unit.set("mount_quat", std::vector<double>{1, 0, 0, 0});
  unit.initialise();
  unit.set("q", std::vector<double>{0, std::numeric_limits<double>::quiet_NaN(), 0});
  EXPECT_THAT(error_of([&] { unit.step(1e-3); }), HasSubstr("q[2]: is nan at 0.001 s, expected a finite value"));
  UnitSubject moving = scanner("robot=@slide.urdf&scene=@ball.sdf&frame=arm&beams=1");
  moving.initialise();
  moving.fill("obstacle.quat", 0);
  EXPECT_THAT(error_of([&] { moving.step(1e-3); }), HasSubstr("obstacle.quat"));
}

}  // namespace
}  // namespace cotwin::scanner::scanner_test
