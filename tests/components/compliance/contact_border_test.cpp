// K_e_max as a lower bound: contacts of random designs of three arms with tools, pushed by 0.06 N s under the torque limits of their URDFs.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "tests/components/compliance/cartesian_harness.h"

namespace cotwin::testing::contact_border_test {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

/// Gains, drives, posture and tool, by seed.
struct Design {
  explicit Design(unsigned seed) {
    std::mt19937_64 random(seed);
    const auto draw = [&](double least, double most) { return std::uniform_real_distribution<double>(least, most)(random); };
    const auto decades = [&](double least, double most) { return std::pow(10, draw(std::log10(least), std::log10(most))); };
    robot = std::array{"lwr4", "ur5e", "ur10e"}[seed % 3];
    q = seed % 3 == 0 ? lwr4_posture() : (VectorXd(6) << 0.2, -1.2, 1.5, 0.3, 0.7, 0.1).finished();
    for (double& angle : q) angle += draw(-0.4, 0.4);
    tool = decades(0.3, 5);
    M = decades(0.3, 5);
    S = draw(0, 1) < 0.2 ? 0 : decades(100, 2000);
    omega = decades(10, 60);
    shaping = draw(1, 4);
    K = decades(2e3, 3e4);
    B = decades(0.2, 2);
    D = draw(0, 1) < 0.25 ? 0 : decades(0.01, 0.1) * std::sqrt(K * B);  // 0.5 to 5 % of critical damping
    if (seed % 2 == 0 && D == 0) shaping = 1;  // torque feedback makes undamped gears vibrate without a contact
    axis = static_cast<int>(seed / 3 % 3);
  }
  std::string robot;
  VectorXd q;
  double tool, M, S, omega, shaping, K, B, D;
  int axis;
};

/// Controller and drive train, whose frame presses a spring that begins at its pose.
class Contact {
 public:
  explicit Contact(const Design& d)
      : axis_(d.axis), kinematics_(d.robot), loop_("", d.robot), X_(kinematics_.at(d.q)), undamped_(d.D == 0) {
    for (Subject* part : {&loop_.unit, &loop_.drive}) {
      for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) (*part)[friction].setZero();
      (*part)["K"].setConstant(d.K);
      (*part)["B"].setConstant(d.B);
      (*part)["D"].setConstant(d.D);
      // A ball of 6 cm radius, 8 cm in front of the last body.
      const double reach = 0.08, own = 0.4 * 0.06 * 0.06;
      (*part)["mass"].tail(1)[0] += d.tool;
      (*part)["first_moment"].tail(1)[0] += reach * d.tool;
      auto inertia = (*part)["inertia"].tail(6);
      for (const int k : {0, 3}) inertia[k] += d.tool * (own + reach * reach);
      inertia[5] += d.tool * own;
    }
    loop_.unit["M_T"].setConstant(d.M);
    loop_.unit["M_R"].setConstant(0.1 * d.M);
    loop_.unit["S_T"].setConstant(d.S);
    loop_.unit["omega"].setConstant(d.omega);
    loop_.unit["shaping"].setConstant(d.shaping);
    desire(loop_.unit, X_);
    loop_.start(d.q);
  }
  /// K_e_max in the direction of the contact.
  double told() {
    for (int n = 0; n < 1500 && loop_.unit["K_e_max"].maxCoeff() == 0; ++n) loop_.step();
    return loop_.unit["K_e_max"][axis_];
  }
  /// Whether the joints still vibrate `steps` steps after a push of 20 ms.
  bool vibrates(double K_e, double push, int steps) {
    constexpr int kParts = 8;  // of a step: the wall's force is continuous for the links
    const Vector3d axis = Vector3d::Unit(axis_);
    double early = 0, late = 0;
    for (int n = 0; n < steps; ++n) {
      const Vector3d f = n < 20 ? Vector3d(push * axis) : Vector3d::Zero();
      const auto force = [&](const VectorXd& q) -> Vector3d { return f - K_e * axis * axis.dot(kinematics_.at(q).p - X_.p); };
      loop_.unit["f_e"] = force(loop_.drive["q"]);
      loop_.step_parts(kParts, [&](Subject& drive) {
        drive["tau_e"] = kinematics_.jacobian(drive["q"]).topRows(3).transpose() * force(drive["q"]);
      });
      const double speed = loop_.drive["dq"].norm();
      if (!(speed < 100)) return true;
      if (n > steps / 6 && n < steps / 3) early = std::max(early, speed);
      if (n > 5 * steps / 6) late = std::max(late, speed);
    }
    // Undamped gears ring on for seconds.
    return late > (undamped_ ? 1.01 : 0.7) * early && late > 1e-6 * push;
  }

 private:
  int axis_;
  Kinematics kinematics_;
  CartesianLoop loop_;
  Pose X_;
  bool undamped_;
};

constexpr double kPush = 3;  // N for 20 ms: 0.06 N s

TEST(ContactBorder, NoDesignVibratesBelowKeMaxAndHalfOfThemDoAtFourTimesIt) {
  int told = 0, above = 0;
  constexpr int kDesigns = 30;
  for (unsigned seed = 0; seed < kDesigns; ++seed) {
    const Design design(seed);
    const double K_e = Contact(design).told();
    if (K_e == 0) continue;  // vibrates without a contact
    ++told;
    EXPECT_FALSE(Contact(design).vibrates(0.999 * K_e, kPush, 1000)) << seed << " " << K_e;
    above += Contact(design).vibrates(4 * K_e, 0.01, 600);
  }
  EXPECT_GT(told, 15);
  EXPECT_LT(told, kDesigns - 2);
  EXPECT_GE(2 * above, told);
}

/// For docs/equations.md: 200 designs, some minutes.
TEST(ContactBorder, DISABLED_TableOfManyDesigns) {
  std::vector<double> borders;
  int below = 0, none = 0;
  for (unsigned seed = 0; seed < 200; ++seed) {
    const Design design(seed);
    const double K_e = Contact(design).told();
    none += K_e == 0;
    if (K_e == 0) continue;
    const bool vibrates = Contact(design).vibrates(0.999 * K_e, kPush, 1000);
    below += vibrates;
    double border = 1;
    for (; border < 50; border *= 1.3) {
      if (Contact(design).vibrates(border * K_e, 0.01, 600)) break;
    }
    borders.push_back(border);
    std::printf("%u %s K_e_max %.0f border %.2f%s\n", seed, design.robot.c_str(), K_e, border,
                vibrates ? " VIBRATES BELOW" : "");
  }
  std::ranges::sort(borders);
  std::printf(
      "%zu designs, %d vibrate below K_e_max, %d without a contact; border/K_e_max: least %.2f, median %.2f, most %.2f\n",
      borders.size() + static_cast<std::size_t>(none), below, none, borders.front(), borders[borders.size() / 2],
      borders.back());
  EXPECT_EQ(below, 0);
}

}  // namespace
}  // namespace cotwin::testing::contact_border_test
