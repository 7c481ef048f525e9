// unit:anomaly in a run: what its sources may do (late and held values, gaps, no numbers, other robots), tunables, snapshots.
#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "models/numerics/random.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/tuner/subject.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/synthetic_log.h"

namespace cotwin::anomaly_unit_test {
namespace {

using namespace testing;
using ::testing::Contains;
using ::testing::HasSubstr;

constexpr double kStep = 0.004;  // s

/// The unit beside a robot that moves, with noise on its torques.
class Session {
 public:
  explicit Session(const std::string& settings = "", const std::string& robot = "lwr4")
      : watch("unit:anomaly?robot=lwr4&torques=joint" + settings),
        real(robot::load_urdf(kModels / "robots" / robot / "robot.urdf")) {
    watch.set("baseline", "20");
    watch.fill("link_tau_C", 3).fill("link_sigma2", 2).fill("link_v_R", 0.02);
  }
  void run(double until) {
    const robot::Mechanism mechanism(real);
    robot::Data data(mechanism);
    Eigen::VectorXd q(7), dq(7), ddq(7), tau(7);
    for (; watch.now() < until - 1e-9; ++k) {
      const double t = watch.now() + kStep;
      for (Eigen::Index j = 0; j < 7; ++j) {
        const Eigen::Vector3d x = motion.motion(static_cast<std::size_t>(j), t);
        q[j] = x[0], dq[j] = x[1], ddq[j] = x[2];
      }
      robot::inverse_dynamics(mechanism, data, q, dq, ddq, tau);
      for (std::size_t j = 0; j < 7; ++j) {
        const auto i = static_cast<Eigen::Index>(j);
        const double noise = numerics::normal({.seed = 4, .stream = k, .round = static_cast<std::uint32_t>(j)});
        watch["q"][j] = q[i];
        watch["dq"][j] = dq[i];
        watch["tau"][j] = tau[i] + friction * (3 * std::tanh(dq[i] / 0.02) + 2 * dq[i]) + 0.3 * noise;
      }
      if (spoil) spoil(t);
      if (k == 0) watch.initialise();
      const std::uint64_t before = allocations();
      watch.step(kStep);
      allocated += allocations() - before;
    }
  }
  std::vector<std::string> notes() {
    std::vector<std::string> sentences;
    watch.unit().append_notes(sentences);
    return sentences;
  }

  Subject watch;
  robot::RobotModel real;
  SyntheticLog motion{.amplitude = 0.6};
  double friction = 1;
  std::function<void(double t)> spoil;
  std::uint32_t k = 0;
  std::uint64_t allocated = 0;
};

robot::RobotModel with_half_a_kilogram(robot::RobotModel robot) {
  robot::Attachment part;
  part.name = "part";
  part.parent = robot.end_effector().name;
  part.inertia.mass = 0.5;
  robot::attach(robot, part);
  return robot;
}

TEST(AnomalyUnit, TellsALoadThatNobodyAnnounced) {
  Session s;
  s.run(30);
  EXPECT_EQ(s.watch.integer("comparing"), 1);
  EXPECT_EQ(s.watch.integer("event_count"), 0);
  EXPECT_EQ(s.watch.real("changed_since", 1), -1);
  s.real = with_half_a_kilogram(s.real);
  s.run(40);
  ASSERT_EQ(s.watch.integer("event_count"), 1);
  EXPECT_EQ(s.watch.integer("event_hint"), 1);
  EXPECT_EQ(s.watch.integer("event_kind"), 1);
  EXPECT_NEAR(s.watch.real("event_size"), 0.5, 0.1);
  EXPECT_NEAR(s.watch.real("event_since"), 30, 1.5);
  EXPECT_LE(s.watch.real("event_t"), 40);
  EXPECT_NEAR(s.watch.real("changed_since", 1), 30, 1.5);
  EXPECT_EQ(s.watch.real("changed_since", 6), -1);
  EXPECT_EQ(s.allocated, 0u);
  EXPECT_THAT(s.notes(), Contains(HasSubstr("load +0.5")));
  EXPECT_THAT(s.notes(), Contains(HasSubstr("maturity")));
}

TEST(AnomalyUnit, TellsFrictionOfAJoint) {
  Session s;
  s.run(30);
  s.spoil = [&](double) { s.watch["tau"][0] += 0.3 * (3 * std::tanh(s.watch["dq"][0] / 0.02) + 2 * s.watch["dq"][0]); };
  s.run(42);
  ASSERT_EQ(s.watch.integer("event_count"), 1);
  EXPECT_EQ(s.watch.integer("event_hint"), 2);
  EXPECT_EQ(s.watch.integer("event_joint"), 1);
  EXPECT_NEAR(s.watch.real("event_size"), 0.3, 0.06);
}

TEST(AnomalyUnit, BeginsAgainWithWhatIsAnnounced) {
  Session s;
  s.run(30);
  s.real = with_half_a_kilogram(s.real);
  for (std::size_t i = 0; i < 7; ++i) {
    const auto pi = s.real.bodies[i].inertia.parameters();
    s.watch["mass"][i] = pi[0];
    std::copy_n(pi.data() + 1, 3, s.watch["first_moment"].data() + 3 * i);
    std::copy_n(pi.data() + 4, 6, s.watch["inertia"].data() + 6 * i);
  }
  s.run(32);
  EXPECT_EQ(s.watch.integer("comparing"), 0);
  s.run(70);
  EXPECT_EQ(s.watch.integer("comparing"), 1);
  EXPECT_EQ(s.watch.integer("event_count"), 0);
  EXPECT_LT(s.watch.real("rms", 1), 0.3);
  s.watch.fill("link_sigma2", 2.1);
  s.run(72);
  EXPECT_EQ(s.watch.integer("comparing"), 0);
  EXPECT_EQ(s.allocated, 0u);
}

TEST(AnomalyUnit, IsNotMisledByGapsLateAndHeldValues) {
  for (const int kind : {0, 1, 2, 3}) {
    Session s;
    double measured = -1, q[7] = {}, dq[7] = {}, tau[7] = {};
    s.spoil = [&](double t) {
      const bool lost = kind == 0   ? std::fmod(t, 7) < 0.8                                // gaps
                        : kind == 1 ? numerics::uniform({.seed = 3, .stream = s.k}) < 0.4  // single losses
                        : kind == 2 ? s.k % 5 != 0                                         // slower than the unit
                                    : false;
      if (kind == 3 && std::fmod(t + 1, 3) < 0.02) s.watch["tau"][3] = std::numeric_limits<double>::quiet_NaN();
      if (!lost) measured = t;
      for (std::size_t j = 0; j < 7; ++j) {
        if (!lost) q[j] = s.watch["q"][j], dq[j] = s.watch["dq"][j], tau[j] = s.watch["tau"][j];
        s.watch["q"][j] = q[j], s.watch["dq"][j] = dq[j], s.watch["tau"][j] = tau[j];
      }
      if (kind < 3) s.watch["t_measured"][0] = measured;
    };
    s.run(60);
    EXPECT_EQ(s.watch.integer("event_count"), 0) << kind << ": " << s.notes().front();
    EXPECT_EQ(s.watch.integer("comparing"), 1) << kind;
    EXPECT_EQ(s.watch.integer("skipped") > 50, kind == 3) << kind;
    EXPECT_LT(s.watch.real("rms", 1), 0.3) << kind;
    EXPECT_EQ(s.allocated, 0u);
  }
}

TEST(AnomalyUnit, TakesNothingWhileItIsNotEnabled) {
  Session s;
  s.spoil = [&](double t) { s.watch.set("enabled", t < 10 ? "true" : "false"); };
  s.run(40);
  EXPECT_EQ(s.watch.integer("comparing"), 0);
  EXPECT_THAT(s.notes(), Contains(HasSubstr("no change could be found: the baseline takes 20 s of motion, and there were 9.")));
}

TEST(AnomalyUnit, TellsAnotherRobotAtOnce) {
  Session s("", "iiwa14");
  s.spoil = [&](double) { std::ranges::for_each(s.watch["tau"], [](double& x) { x *= -1; }); };
  s.run(3);
  EXPECT_THAT(s.watch.text("warning"), HasSubstr("the torques are not those of this robot"));
  Session same;
  same.run(3);
  EXPECT_EQ(same.watch.text("warning"), "");
}

TEST(AnomalyUnit, SaysThatAFaultFromTheBeginningIsNotSeen) {
  Session s;
  s.friction = 1.3;
  s.run(40);
  EXPECT_EQ(s.watch.integer("event_count"), 0);
  EXPECT_THAT(s.notes(), Contains(HasSubstr("one from the beginning on would be in the baseline, and not seen")));
}

TEST(AnomalyUnit, ContinuesFromASnapshotToTheSameBits) {
  for (const double at : {0.4, 12.0, 24.0, 33.0}) {
    Session s, other;
    const auto change = [&](Session& x) { x.spoil = [&x](double t) { x.watch["tau"][2] += t > 30 ? 5 : 0; }; };
    change(s);
    change(other);
    s.run(at);
    const Snapshot snapshot = s.watch.save();
    other.run(5);
    other.watch.restore(snapshot, s.watch.now());
    other.k = s.k;
    s.run(45);
    other.run(45);
    EXPECT_TRUE(s.watch.everything() == other.watch.everything()) << at;
    EXPECT_EQ(s.watch.integer("event_count"), 1);
  }
}

TEST(AnomalyUnit, RefusesMemoryThatItDidNotWrite) {
  Session s;
  s.run(2);
  for (const std::string& bytes : {std::string(), std::string("short"), std::string(1 << 20, '\xff')})
    EXPECT_NE(error_of([&] { s.watch.unit().restore_memory(bytes); }), "") << bytes.size();
}

}  // namespace
}  // namespace cotwin::anomaly_unit_test
