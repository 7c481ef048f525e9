// A short version of VI-A: an LWR 4+ under joint admittance lowers its peg into a hole that is beside the expected place, with
// the links integrated by either unit (link_side=inside or outside). Robot, gains and the low-pass of the sensors as in
// examples/04_peg_in_hole, in 4 s.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "components/unit/unit_table.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "tests/support/places.h"

namespace cotwin::insertion_test {
namespace {

using Eigen::Matrix;
using Eigen::Vector3d;
using Vector7 = Matrix<double, 7, 1>;

constexpr bool kSanitized = std::string_view(COTWIN_SANITIZERS) != "";  // ten times slower: one case of a kind
const std::string kExample = places::source() + "/examples/04_peg_in_hole/";
const std::string kModels = places::source() + "/models/";
constexpr double kTip = 0.178;             // m from link_7 to the peg's end along z, lwr4_peg.urdf
constexpr double kMouth = -0.05;           // m, height of the hole's mouth
constexpr int kLower = 3000, kEnd = 4000;  // ms
constexpr double kCutoff = 40;             // Hz, of the measured external torques

Vector3d tip(const robot::RobotModel& model, std::span<const double> q, std::vector<Pose>& X_WL) {
  std::vector<Twist> V_WL(7);
  const std::vector<double> still(7, 0.0);
  scene::place_links(model, {}, q, still, X_WL, V_WL);
  return X_WL[6] * Vector3d(0, 0, kTip);
}

/// The posture near q that holds the peg upright over (0.5, 0.05) with its tip at z, by Newton's method.
Vector7 posture(const robot::RobotModel& model, double z, Vector7 q) {
  std::vector<Pose> X_WL(7);
  for (int round = 0; round < 20; ++round) {
    const Vector3d p = tip(model, {q.data(), 7}, X_WL), axis = X_WL[6].R.col(2);
    Matrix<double, 5, 1> error;
    error << Vector3d(0.5, 0.05, z) - p, axis.cross(-Vector3d::UnitZ()).head<2>();
    if (error.norm() < 1e-13) break;
    Matrix<double, 5, 7> J;
    for (int i = 0; i < 7; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const Vector3d s = X_WL[k].R * model.joints[k].axis;
      J.col(i) << s.cross(p - X_WL[k].p), s.head<2>();
    }
    q += J.transpose() * (J * J.transpose()).ldlt().solve(error);
  }
  return q;
}

/// The desired motion, one sample per millisecond: 45 mm down from 10 mm above the mouth, at rest at both ends.
struct Motion {
  Motion() {
    const robot::RobotModel model = robot::load_urdf(kExample + "lwr4_peg.urdf");
    Vector7 at;
    at << -0.028727831, -0.443875956, 0.166775837, 1.682038439, -0.083624858, -1.022631290, 0.165796174;
    for (int i = 0; i <= kEnd; ++i) {
      const double s = std::min(1.0, static_cast<double>(i) / kLower);
      at = posture(model, kMouth + 0.01 - 0.045 * s * s * s * (10 - 15 * s + 6 * s * s), at);
      q.push_back(at);
    }
    dq = derivative(q);
    ddq = derivative(dq);
  }
  static std::vector<Vector7> derivative(const std::vector<Vector7>& x) {
    std::vector<Vector7> dx(x.size(), Vector7::Zero());
    for (std::size_t i = 1; i + 1 < x.size(); ++i) dx[i] = (x[i + 1] - x[i - 1]) / 2e-3;
    return dx;
  }
  std::vector<Vector7> q, dq, ddq;
};

struct Case {
  std::string link, plate;
  double x = 0, y = 0;  // mm, offset of the hole from the place that the robot expects
  std::string method = "tree";
  double damping = 1;  // share of the gears' stiffness
  int parts = 1;       // steps of robot and world per millisecond
};

struct Outcome {
  double depth = 0;                                // m, of the tip below the mouth at the end
  double largest = 0;                              // N, contact force
  Vector3d steady{0, 0, 0};                        // N, mean of the last 0.3 s
  double shake = 0;                                // N, its standard deviation there
  double penetration = 0;                          // m
  double energy = 0;                               // J, largest kinetic energy of the motors and, with link_side=inside, links
  bool inserted() const { return depth > 0.032; }  // of 35 mm that the controller commands
};

class Insertion {
 public:
  explicit Insertion(const Case& c)
      : outside_(c.link == "outside"),
        parts_(c.parts),
        controller_(make("compliance", "?robot=" + kExample + "lwr4_peg.urdf")),
        drive_(make("drive_train", "?link_side=" + c.link + "&robot=" + kExample + "real/robot.urdf")),
        world_(make("contact_world", "?link_side=" + c.link + "&method=" + c.method + "&scene=" + kModels +
                                         "scenes/peg_in_hole/" + c.plate + ".sdf&robot=" + kExample + "real/robot.urdf")) {
    apply(load_parameter_set(kModels + "robots/lwr4/compliance.ssv"), controller_.variables);
    put(controller_, "S_a", {1200, 1200, 900, 900, 600, 400, 300});
    put(controller_, "M_a", {12, 12, 9, 9, 6, 4, 3});
    put(controller_, "zeta_a", {4, 4, 4, 4, 4, 4, 4});
    for (double& D : drive_.variables.at("D").reals()) D *= c.damping;
    for (const char* name : {"K", "D"}) copy(drive_, name, world_, name);
    put(world_, "plate.p0", {0.5 + 1e-3 * c.x, 0.05 + 1e-3 * c.y, -0.07});

    const Vector7& q = motion().q.front();
    const std::vector<double> start(q.data(), q.data() + 7);
    put(controller_, "q_d", start);
    if (outside_) {
      // The motors hold the weight of the links, which the drive train of an inside robot includes.
      Instance inside = make("drive_train", "?link_side=inside&robot=" + kExample + "real/robot.urdf");
      put(inside, "q0", start);
      inside.unit->initialise({});
      copy(inside, "tau_J", drive_, "tau_m");
      put(drive_, "q", start);
      put(world_, "q0", start);
      drive_.variables.at("link_order").integers()[0] = 1;
    } else {
      put(drive_, "q0", start);
      put(world_, "q", start);
    }
    drive_.unit->initialise({});
    copy(drive_, "tau_J", world_, "tau_J");
    world_.unit->initialise({});
    sense();
    controller_.unit->initialise({});
  }

  Outcome lower() {
    Outcome out;
    double sum = 0, square = 0;
    constexpr int kLast = 300;
    for (int i = 0; i < kEnd; ++i) {
      step(i);
      const auto f = world_.variables.at("f_c").reals();
      const Vector3d force(f[0], f[1], f[2]);
      out.largest = std::max(out.largest, force.norm());
      out.penetration = std::max(out.penetration, world_.variables.at("penetration").reals()[0]);
      out.energy = std::max(out.energy, drive_.variables.at("energy_kinetic").reals()[0]);
      if (i < kEnd - kLast) continue;
      out.steady += force / kLast;
      sum += force.norm() / kLast;
      square += force.squaredNorm() / kLast;
    }
    out.shake = std::sqrt(std::max(0.0, square - sum * sum));
    std::vector<Pose> X_WL(7);
    const robot::RobotModel model = robot::load_urdf(kExample + "lwr4_peg.urdf");
    out.depth = kMouth - tip(model, links().variables.at("q").reals(), X_WL).z();
    return out;
  }

 private:
  static const Motion& motion() {
    static const Motion made;
    return made;
  }
  static Instance make(const std::string& unit, const std::string& query) {
    return make_unit("unit:" + unit + query, {}, {kModels}, unit_types());
  }
  static void put(Instance& to, const char* name, const std::vector<double>& values) {
    std::copy(values.begin(), values.end(), to.variables.at(name).reals().begin());
  }
  static void copy(Instance& from, const char* out, Instance& to, const char* in) {
    const auto values = from.variables.at(out).reals();
    std::copy(values.begin(), values.end(), to.variables.at(in).reals().begin());
  }
  static void run(Instance& unit, Duration h) { ASSERT_EQ(unit.unit->step({}, h), StepResult::kDone); }
  Instance& links() { return outside_ ? world_ : drive_; }  // which unit moves them

  /// One tick: controller, then world, then drive.
  void step(int i) {
    constexpr Duration kTick{1'000'000};
    const auto k = static_cast<std::size_t>(i + 1);
    const auto want = [&](const char* name, const Vector7& v) { put(controller_, name, {v.data(), v.data() + 7}); };
    want("q_d", motion().q[k]);
    want("dq_d", motion().dq[k]);
    want("ddq_d", motion().ddq[k]);
    sense();
    run(controller_, kTick);
    copy(controller_, "tau_m", drive_, "tau_m");
    for (int part = 0; part < parts_; ++part) {
      const Duration h{kTick.ns / parts_};
      for (const char* name : {"tau_J", "dtheta"}) copy(drive_, name, world_, name);
      for (const char* name : {"q", "dq"}) {
        if (!outside_) copy(drive_, name, world_, name);
      }
      run(world_, h);
      for (const char* name : {"q", "dq"}) {
        if (outside_) copy(world_, name, drive_, name);
      }
      copy(world_, "tau_e", drive_, "tau_e");
      run(drive_, h);
    }
  }
  void sense() {
    for (const char* name : {"theta", "dtheta"}) copy(drive_, name, controller_, name);
    for (const char* name : {"q", "dq"}) copy(links(), name, controller_, name);
    const double share = 1 - std::exp(-2 * std::numbers::pi * kCutoff * 1e-3);
    const auto measured = controller_.variables.at("tau_e").reals(), true_one = world_.variables.at("tau_e").reals();
    for (std::size_t j = 0; j < 7; ++j) measured[j] += share * (true_one[j] - measured[j]);
  }

  bool outside_;
  int parts_;
  Instance controller_, drive_, world_;
};

Outcome lower(const Case& c) { return Insertion(c).lower(); }

std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << c.plate << " link=" << c.link << " " << c.method << " hole at (" << c.x << ", " << c.y << ") mm";
}

/// Runs a case with either link.
struct Both {
  explicit Both(Case c) {
    c.link = "inside";
    inside = lower(c);
    c.link = "outside";
    outside = lower(c);
  }
  Outcome inside, outside;
};

// The place where a peg rests within the friction cones depends slightly on its path.
void expect_alike(const Both& both, double relative, double least) {
  const double scale = both.outside.steady.norm();
  EXPECT_LT((both.inside.steady - both.outside.steady).norm(), relative * scale + least)
      << both.inside.steady.transpose() << " N, " << both.outside.steady.transpose() << " N";
  EXPECT_NEAR(both.inside.largest, both.outside.largest, 0.05 * both.outside.largest + 5);
  EXPECT_NEAR(both.inside.depth, both.outside.depth, 2e-5 + 0.01 * both.outside.depth);
}

// The force never exceeds what the admittance gives for the distance to the middle of the hole, nor does the motion; then the
// peg is at rest. At 28 mm/s the dampers D = 2 ζ_a √(S_a M_a) alone give about 100 N, half a metre from the axes.
void expect_insertion(const Outcome& o) {
  EXPECT_TRUE(o.inserted()) << o.depth;
  EXPECT_LT(o.largest, 60) << "45 N seen";
  EXPECT_LT(o.energy, 0.05) << "0.033 J seen, 0.007 J where nothing is touched";
  EXPECT_LT(o.penetration, 2e-5) << "10^6 N/m under the largest force at one point";
  EXPECT_LT(o.shake, 0.01) << "it rests at the end";
}

TEST(Insertion, ThePegGoesInWhereverTheHoleStandsWithinItsClearance) {
  for (const auto& [plate, c] : {std::pair{"plate", 0.5}, {"plate_tight", 0.1}}) {
    for (const auto& [x, y] : {std::pair{0.0, 0.0}, {c, 0.0}, {0.0, c}, {0.0, -c}, {0.7 * c, -0.7 * c}}) {
      if (kSanitized && x != c) continue;
      const Case one{"", plate, x, y};
      SCOPED_TRACE(::testing::Message() << one);
      const Both both(one);
      expect_insertion(both.inside);
      expect_insertion(both.outside);
      expect_alike(both, 0.01, 0.12);
    }
  }
}

// On the other side of the chamfer the same arm yields sideways when it is pushed up, against the slope: it stays on the
// chamfer and presses, as the robot would. With a larger offset in the tight hole the peg tilts and wedges. The forces at rest
// are bounded and the same with either link, also with a quarter of the step.
TEST(Insertion, APegThatJamsPressesWithTheSameForceWithEitherLink) {
  for (const Case& one : {Case{"", "plate", -0.8, 0.5}, {"", "plate_tight", -0.8, 0.5}, {"", "plate_tight", 1.5, 0}}) {
    SCOPED_TRACE(::testing::Message() << one);
    const Both both(one);
    for (const Outcome& o : {both.inside, both.outside}) {
      EXPECT_FALSE(o.inserted()) << o.depth;
      EXPECT_GT(o.steady.norm(), 50);
      EXPECT_LT(o.largest, 250);
      EXPECT_LT(o.shake, 1);
      EXPECT_LT(o.energy, 0.06);
    }
    expect_alike(both, 0.01, 0);
    if (kSanitized) return;
  }
  const Outcome coarse = lower({"inside", "plate_tight", -0.8, 0.5}),
                fine = lower({"inside", "plate_tight", -0.8, 0.5, "tree", 1, 4});
  EXPECT_LT((coarse.steady - fine.steady).norm(), 1e-3 * fine.steady.norm());
}

TEST(Insertion, AllSolversAndShorterStepsFindTheSameForces) {
  for (const char* link : {"inside", "outside"}) {
    const Outcome tree = lower({link, "plate_tight", 0.8, -0.5});
    EXPECT_TRUE(tree.inserted());
    EXPECT_GT(tree.steady.norm(), 2);
    for (const Case& one : {Case{link, "plate_tight", 0.8, -0.5, "pgs"},
                            {link, "plate_tight", 0.8, -0.5, "dantzig"},
                            {link, "plate_tight", 0.8, -0.5, "tree", 1, 4}}) {
      SCOPED_TRACE(::testing::Message() << one << " in " << one.parts);
      const Outcome other = lower(one);
      EXPECT_LT((other.steady - tree.steady).norm(), 2e-3 * tree.steady.norm());
      EXPECT_NEAR(other.largest, tree.largest, 0.02 * tree.largest);
    }
    if (kSanitized) break;
  }
}

// Undamped gears and links oscillate against each other with up to 500 Hz, which a step of a millisecond cannot resolve.
TEST(Insertion, UndampedGearsDoNotOscillate) {
  for (const char* plate : {"plate", "plate_tight"}) {
    const Both damped({"", plate, 0.8, -0.5}), undamped({"", plate, 0.8, -0.5, "tree", 0});
    for (const auto& [with, without] : {std::pair{damped.inside, undamped.inside}, {damped.outside, undamped.outside}}) {
      EXPECT_TRUE(without.inserted());
      EXPECT_LT((with.steady - without.steady).norm(), 0.01 * with.steady.norm()) << plate;
      EXPECT_LT(without.largest, 1.1 * with.largest) << plate;
      EXPECT_LT(without.shake, 0.01) << plate;
    }
    if (kSanitized) break;
  }
}

}  // namespace
}  // namespace cotwin::insertion_test
