// The watch over synthetic sessions: noise that is correlated as that of real robots, and changes whose time and size are known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "models/anomaly/anomaly.h"
#include "models/anomaly/maturity.h"
#include "models/foundation/support/error.h"
#include "models/numerics/random.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"
#include "tests/support/synthetic_log.h"

namespace cotwin::anomaly_watch_test {
namespace {

using namespace anomaly;
using testing::error_of;

robot::RobotModel robot_of(const std::string& name) {
  const bool path = name.find('/') != std::string::npos;
  return robot::load_urdf(places::source() + (path ? "/tests/" + name : "/models/robots/" + name + "/robot.urdf"));
}
/// What stands for a limit of torque that a robot does not have.
double limit_of(const robot::Joint& joint) { return std::isfinite(joint.tau_max) ? joint.tau_max : 100; }

/// One sample as it is measured; `truth` is evaluated at it.
struct Sample {
  double t = 0;
  std::vector<double> q, dq, ddq, tau;
};

/// A robot that moves, its noise, and the watch.
struct Session {
  static constexpr double kStep = 0.01;  // s
  robot::RobotModel robot;
  TorqueModel model, truth;
  Watch watch;
  testing::SyntheticLog motion{.amplitude = 0.6};
  double noise = 0.005, memory = 0.2;  // of the limit of torque; s, in which noise is alike
  std::vector<double> state;
  std::uint32_t k = 0, seed = 1;

  explicit Session(const std::string& name, const WatchOptions& options = {.baseline = 30}, bool motor = true,
                   double friction = 1)
      : robot(robot_of(name)),
        model(robot, motor),
        truth(robot, motor),
        watch(robot, with_friction(model, robot, friction), motor, options) {
    with_friction(truth, robot, friction);
    state.assign(robot.joints.size(), 0.0);
  }
  static TorqueModel& with_friction(TorqueModel& model, const robot::RobotModel& robot, double factor) {
    for (std::size_t j = 0; j < robot.joints.size(); ++j) {
      model.drives.tau_C[j] = 0.05 * factor * limit_of(robot.joints[j]);
      model.drives.sigma2[j] = 0.05 * factor * limit_of(robot.joints[j]);
    }
    model.update();
    return model;
  }
  double t() const { return k * kStep; }

  /// The next samples, until t. `change` may alter what is measured.
  using Change = std::function<void(Session&, Sample&)>;
  void run(double until, const Change& change = {}) {
    const std::size_t n = robot.joints.size();
    Sample s;
    for (auto* v : {&s.q, &s.dq, &s.ddq, &s.tau}) v->resize(n);
    for (; t() < until - 1e-9; ++k) {
      s.t = t();
      for (std::size_t j = 0; j < n; ++j) {
        const Eigen::Vector3d x = motion.motion(j, s.t);
        s.q[j] = x[0], s.dq[j] = x[1], s.ddq[j] = x[2];
      }
      truth.evaluate(s.q.data(), s.dq.data(), s.ddq.data());
      const double keep = std::exp(-kStep / memory);
      for (std::size_t j = 0; j < n; ++j) {
        const double limit = limit_of(robot.joints[j]);
        state[j] = keep * state[j] + std::sqrt(1 - keep * keep) * noise * limit *
                                         numerics::normal({.seed = seed, .stream = k, .round = static_cast<std::uint32_t>(j)});
        s.tau[j] = truth.tau()[static_cast<Eigen::Index>(j)] + state[j];
      }
      if (change) change(*this, s);
      model.evaluate(s.q.data(), s.dq.data(), s.ddq.data());
      watch.add(s.t, k == 0 ? 0 : kStep, s.dq.data(), s.ddq.data(), s.tau.data());
    }
  }
  /// What adds `size` of cause k.
  static Change add(int k, double size) {
    return [k, size](Session& x, Sample& s) {
      for (std::size_t j = 0; j < s.tau.size(); ++j) s.tau[j] += size * x.truth.effects()(static_cast<Eigen::Index>(j), k);
    };
  }
};

struct Case {
  const char* robot;
  const char* name;
  int cause;
  double size, within;  // s
};

class AnomalyWatch : public ::testing::TestWithParam<Case> {};

TEST_P(AnomalyWatch, FindsDatesAndNamesAChange) {
  const Case& c = GetParam();
  Session x(c.robot);
  x.run(60);
  ASSERT_TRUE(x.watch.ready());
  ASSERT_EQ(x.watch.count(), 0);
  x.run(100, Session::add(c.cause, c.size));
  ASSERT_EQ(x.watch.count(), 1);
  const Event& e = x.watch.events()[0];
  EXPECT_EQ(e.which, c.cause) << describe(e, x.model, x.robot.joints);
  EXPECT_NEAR(e.size, c.size, 4 * e.deviation);
  EXPECT_LT(e.deviation, 0.34 * std::abs(c.size));
  EXPECT_GE(e.found, 60);
  EXPECT_LE(e.found, 60 + c.within) << c.name;
  EXPECT_NEAR(e.since, 60, 2);
  EXPECT_TRUE(e.concerns(static_cast<std::size_t>(e.joint)));
  EXPECT_FALSE(e.brief || e.spread);
}

INSTANTIATE_TEST_SUITE_P(Robots, AnomalyWatch,
                         ::testing::Values(Case{"ur10e", "load", 0, 1, 5}, Case{"ur10e", "less_load", 0, -1, 5},
                                           Case{"ur10e", "friction1", 1, 0.2, 8}, Case{"ur10e", "friction5", 5, 0.3, 8},
                                           Case{"ur10e", "contact4", 10, 3, 5}, Case{"ur10e", "encoder2", 14, 0.06, 10},
                                           Case{"lwr4", "load", 0, 1, 5}, Case{"lwr4", "friction3", 3, 0.3, 8},
                                           Case{"lwr4", "encoder4", 18, 0.1, 10}, Case{"kr300_r2500", "load", 0, 40, 5},
                                           Case{"kr300_r2500", "friction2", 2, 0.3, 8},
                                           Case{"planar2", "friction1", 1, 0.3, 8}),
                         [](const auto& one) { return std::string(one.param.robot) + "_" + one.param.name; });

TEST(AnomalyWatchEvents, TellLoadAtAllJointsThatCarryIt) {
  Session x("ur10e");
  x.run(60);
  x.run(80, Session::add(0, 1));
  ASSERT_EQ(x.watch.count(), 1);
  const Event& e = x.watch.events()[0];
  for (const std::size_t j : {1, 2, 3}) EXPECT_TRUE(e.concerns(j)) << j;
  EXPECT_FALSE(e.concerns(5)) << "the load is on the last axis";
  EXPECT_THAT(describe(e, x.model, x.robot.joints), ::testing::StartsWith("load +1"));
}

TEST(AnomalyWatchEvents, AreNoneInHalfAnHourOfCorrelatedNoise) {
  for (const double memory : {0.05, 1.0}) {
    Session x("ur10e");
    x.memory = memory;
    x.run(1800);
    EXPECT_EQ(x.watch.count(), 0) << memory;
    EXPECT_NEAR(x.watch.motion(), 1800, 2);
    EXPECT_EQ(x.watch.outside(), 0);
  }
}

TEST(AnomalyWatchEvents, OfABlowAreBrief) {
  Session x("ur10e");
  x.run(60);
  x.run(60.15, Session::add(7 + 1, 40));
  x.run(90);
  ASSERT_EQ(x.watch.count(), 1);
  const Event& e = x.watch.events()[0];
  EXPECT_TRUE(e.brief);
  EXPECT_EQ(e.joint, 1);
  EXPECT_NEAR(e.torque, 40, 5);
  EXPECT_NEAR(e.since, 60, 0.5);
  EXPECT_TRUE(x.watch.ready()) << "the session goes on with its baseline";
}

TEST(AnomalyWatchEvents, OfAStepThatStaysAreNotBrief) {
  Session x("ur10e");
  x.run(60);
  x.run(90, Session::add(7 + 3, 8));
  ASSERT_EQ(x.watch.count(), 1);
  EXPECT_FALSE(x.watch.events()[0].brief);
  EXPECT_EQ(x.watch.events()[0].which, 7 + 3);
}

TEST(AnomalyWatchEvents, OfScatterNameTheJointThatScatters) {
  Session x("ur10e");
  x.run(60);
  x.run(80, [](Session& s, Sample& m) { m.tau[2] += 3 * s.state[2]; });
  ASSERT_EQ(x.watch.count(), 1);
  const Event& e = x.watch.events()[0];
  EXPECT_TRUE(e.spread) << describe(e, x.model, x.robot.joints);
  EXPECT_EQ(e.joint, 2);
  EXPECT_NEAR(e.size, 4, 1);
  EXPECT_LE(e.found, 66);
}

TEST(AnomalyWatchEvents, ComeAgainAfterANewBaseline) {
  Session x("ur10e");
  x.run(60);
  x.run(110, Session::add(0, 1));
  EXPECT_TRUE(x.watch.ready());
  x.run(130);
  ASSERT_EQ(x.watch.count(), 2);
  EXPECT_NEAR(x.watch.events()[1].size, -1, 0.2) << "the load was taken away";
  EXPECT_NEAR(x.watch.events()[1].since, 110, 2);
}

TEST(AnomalyWatchEvents, AreNoneAfterAnAnnouncedChange) {
  Session x("ur10e");
  x.run(60);
  x.watch.restart();
  x.run(120, Session::add(0, 1));
  EXPECT_EQ(x.watch.count(), 0);
  EXPECT_TRUE(x.watch.ready());
}

TEST(AnomalyWatchJudges, NotMotionsBeyondTheBaseline) {
  Session x("ur10e");
  x.run(60);
  x.motion.amplitude *= 2;
  x.run(120, [](Session& s, Sample& m) { m.tau[0] += std::abs(m.dq[0]) > 1 ? 40 * s.noise : 0; });
  EXPECT_EQ(x.watch.count(), 0);
  EXPECT_GT(x.watch.outside(), 20);
}

TEST(AnomalyWatchJudges, NotJointsAtRestThatFrictionMayHold) {
  Session x("ur10e");
  x.motion.moving = 3;
  x.run(60);
  x.run(120, [](Session& s, Sample& m) { m.tau[4] += 0.04 * s.robot.joints[4].tau_max; });
  EXPECT_EQ(x.watch.count(), 0);
  EXPECT_NEAR(x.watch.resting(4), 120, 1);
  EXPECT_EQ(x.watch.compared(4), 0);
  EXPECT_GT(x.watch.compared(1), 40);
  // A joint without friction, whose torque is measured behind the gear, tells something at rest, too.
  Session y("lwr4", {.baseline = 30}, false, 0);
  y.motion.moving = 3;
  y.run(60);
  y.run(90, [](Session& s, Sample& m) { m.tau[4] += 0.04 * s.robot.joints[4].tau_max; });
  ASSERT_EQ(y.watch.count(), 1);
  EXPECT_EQ(y.watch.events()[0].cause, Cause::kContact);
  EXPECT_EQ(y.watch.events()[0].joint, 4);
}

TEST(AnomalyWatchJudges, NotTorquesAtTheirLimitAndPassiveJoints) {
  Session x("ur10e");
  x.run(60);
  x.run(100, [](Session& s, Sample& m) { m.tau[5] = s.robot.joints[5].tau_max; });
  EXPECT_EQ(x.watch.count(), 0);
  EXPECT_NEAR(x.watch.saturated(5), 40, 4);
}

TEST(AnomalyWatchJudges, NothingBeforeABaselineOfMotion) {
  Session x("ur10e");
  x.motion.moving = 0;
  x.run(100);
  EXPECT_FALSE(x.watch.ready());
  EXPECT_EQ(x.watch.motion(), 0);
  EXPECT_FALSE(x.watch.finish());
  Session y("ur10e");
  y.run(20);
  EXPECT_FALSE(y.watch.ready());
  EXPECT_TRUE(y.watch.finish()) << "a shorter baseline, when it is asked for";
}

TEST(AnomalyWatchJudges, TorquesWithoutAnyNoise) {
  Session x("ur10e");
  x.noise = 0;
  x.run(60);
  EXPECT_EQ(x.watch.count(), 0) << describe(x.watch.events()[0], x.model, x.robot.joints);
  x.run(80, Session::add(0, 1));
  ASSERT_GE(x.watch.count(), 1);
  EXPECT_EQ(x.watch.events()[0].cause, Cause::kLoad);
  EXPECT_NEAR(x.watch.events()[0].size, 1, 1e-3);
}

TEST(AnomalyWatchJudges, WithGapsInsteadOfSamples) {
  Session x("ur10e");
  x.run(60);
  for (int gap = 0; gap < 20; ++gap) {
    x.k += 170;
    x.watch.add(x.t(), 0, nullptr, nullptr, nullptr);
    ++x.k;
    x.run(x.t() + 1.3);
  }
  EXPECT_EQ(x.watch.count(), 0);
}

TEST(AnomalyWatchJudges, RobotsWithSlidesMimicsAndWithoutLimits) {
  for (const char* name : {"components/data/finger.urdf", "components/data/gantry.urdf", "components/data/scara.urdf",
                           "components/data/pusher.urdf"}) {
    Session x(name);
    x.run(80);
    EXPECT_EQ(x.watch.count(), 0) << name;
    x.run(110, Session::add(1, 0.4));
    ASSERT_GE(x.watch.count(), 1) << name;
    const Event& e = x.watch.events()[0];
    EXPECT_EQ(e.cause, Cause::kFriction) << name << ": " << describe(e, x.model, x.robot.joints);
    EXPECT_EQ(e.joint, 0) << name;
    EXPECT_NEAR(e.size, 0.4, 4 * e.deviation) << name;
  }
}

TEST(AnomalyWatchMemory, ContinuesToTheSameBits) {
  for (const double at : {10.27, 45.0, 62.3, 64.0}) {
    Session x("ur10e"), y("ur10e");
    const auto change = [](Session& s, Sample& m) {
      if (s.t() > 60) Session::add(0, 1)(s, m);
    };
    x.run(at, change);
    ByteWriter out;
    x.watch.write(out);
    ByteReader in(as_bytes(out.bytes()), "memory");
    y.watch.read(in);
    in.expect_end();
    y.k = x.k;
    y.state = x.state;
    x.run(110, change);
    y.run(110, change);
    ByteWriter a, b;
    x.watch.write(a);
    y.watch.write(b);
    EXPECT_EQ(a.bytes(), b.bytes()) << at;
    EXPECT_EQ(x.watch.count(), 1);
  }
}

TEST(AnomalyWatchMemory, RefusesWhatNoWatchWrote) {
  Session x("planar2", {.baseline = 10});
  x.run(14, Session::add(1, 0.5));
  x.run(40);
  ByteWriter out;
  x.watch.write(out);
  const std::string good = out.bytes();
  for (std::size_t size = 0; size < good.size(); size += 97) {
    ByteReader in(as_bytes(std::string_view(good).substr(0, size)), "memory");
    EXPECT_NE(error_of([&] { x.watch.read(in); }), "") << size;
  }
  // Whatever bytes it accepts, it goes on with.
  std::size_t refused = 0;
  for (std::uint32_t k = 0; k < 3000; ++k) {
    std::string bad = good;
    for (std::uint32_t i = 0; i < 3; ++i)
      bad[static_cast<std::size_t>(numerics::uniform({.seed = k, .draw = 2 * i}) * static_cast<double>(bad.size()))] =
          static_cast<char>(256 * numerics::uniform({.seed = k, .draw = 2 * i + 1}));
    ByteReader in(as_bytes(bad), "memory");
    if (error_of([&] { x.watch.read(in); }) != "") {
      ++refused;
    } else if (k % 10 == 0) {
      x.run(x.t() + 2);
    }
  }
  EXPECT_GT(refused, 10u);
}

TEST(AnomalyWatchMemory, AllocatesNothing) {
  Session x("ur10e", {.baseline = 10});
  x.run(1);
  std::uint64_t allocated = 0;
  std::vector<double> q(6), dq(6), ddq(6), tau(6);
  for (; x.t() < 60; ++x.k) {
    for (std::size_t j = 0; j < 6; ++j) {
      const Eigen::Vector3d m = x.motion.motion(j, x.t());
      q[j] = m[0], dq[j] = m[1], ddq[j] = m[2];
    }
    const std::uint64_t before = testing::allocations();
    x.model.evaluate(q.data(), dq.data(), ddq.data());
    for (std::size_t j = 0; j < 6; ++j)
      tau[j] = x.model.tau()[static_cast<Eigen::Index>(j)] + (x.t() > 30 ? 5 : 0) +
               numerics::normal({.stream = x.k, .draw = static_cast<std::uint32_t>(j)});
    x.watch.add(x.t(), Session::kStep, dq.data(), ddq.data(), tau.data());
    allocated += testing::allocations() - before;
  }
  EXPECT_EQ(allocated, 0u);
  EXPECT_GE(x.watch.count(), 1);
}

TEST(Maturity, IsUnknownWithoutALimit) {
  EXPECT_EQ(maturity_band(maturity(1, std::numeric_limits<double>::infinity())), "unknown: the joint has no limit of torque");
  EXPECT_EQ(maturity_band(maturity(1, 0)), "unknown: the joint has no limit of torque");
  EXPECT_EQ(maturity_band(maturity(1, 100)), "up to 1 %");
  EXPECT_EQ(maturity_band(maturity(2.5, 100)), "1 to 2.5 %");
  EXPECT_EQ(maturity_band(maturity(4, 100)), "2.5 to 4 %");
  EXPECT_EQ(maturity_band(maturity(4.1, 100)), "beyond 4 %");
  EXPECT_NEAR(kPaperMaturity[0], 2.4, 0.01);
}

}  // namespace
}  // namespace cotwin::anomaly_watch_test
