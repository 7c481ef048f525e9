// Gradients of the goals against central differences of their values, and closed forms.

#include "models/control/goals.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>

#include "tests/models/control/robots.h"
#include "tests/support/allocations.h"

namespace cotwin::control::goals_test {
namespace {

using namespace testing;
using Rows = ManipulabilityGoal::Rows;

VectorXd differences(const std::function<double(const VectorXd&)>& V, const VectorXd& q, double h = 1e-5) {
  VectorXd gradient(q.size());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const VectorXd d = h * VectorXd::Unit(q.size(), i);
    gradient[i] = (V(q + d) - V(q - d)) / (2 * h);
  }
  return gradient;
}

void expect_gradient(const std::function<double(const VectorXd&, VectorOut)>& goal, const VectorXd& q, double tolerance) {
  VectorXd gradient = VectorXd::Zero(q.size()), ignored = gradient;
  goal(q, gradient);
  const VectorXd expected = differences([&](const VectorXd& at) { return goal(at, ignored); }, q);
  EXPECT_LT((gradient - expected).norm(), tolerance * (1 + expected.norm())) << q.transpose();
}

TEST(Goals, PostureIsASpring) {
  const VectorXd K = (VectorXd(3) << 2, 0, 5).finished(), q_0 = (VectorXd(3) << 1, 2, 3).finished();
  const VectorXd q = (VectorXd(3) << 2, 7, 2).finished();
  VectorXd gradient = VectorXd::Ones(3);
  EXPECT_EQ(posture(q, q_0, K, gradient), 3.5);
  EXPECT_EQ(gradient, (VectorXd(3) << 3, 1, -4).finished());  // added
}

TEST(Goals, JointLimitsRepelOnlyNearThem) {
  const VectorXd low = (VectorXd(4) << -1, -1, -1, 0).finished(), high = (VectorXd(4) << 1, 1, 1, 0).finished();
  VectorXd gradient = VectorXd::Zero(4);
  EXPECT_EQ(joint_limits((VectorXd(4) << 0, 0.79, -0.79, 50).finished(), low, high, 2, 0.1, gradient), 0);
  EXPECT_EQ(gradient, VectorXd::Zero(4));
  // x = 0.05 of the range 2: weight (1/0.05 − 1/0.1)²
  EXPECT_NEAR(joint_limits((VectorXd(4) << 0.9, 0, 0, 0).finished(), low, high, 2, 0.1, gradient), 200, 1e-9);
  EXPECT_GT(gradient[0], 0);
  const auto goal = [&](const VectorXd& q, VectorOut g) { return joint_limits(q, low, high, 2, 0.1, g); };
  Draw draw(3);
  for (int i = 0; i < 2000; ++i) {
    VectorXd q = draw.numbers(4, -0.98, 0.98);
    expect_gradient(goal, q, 1e-4);
  }
  for (const double outside : {0.9999, 1.0, 1.5, 100.0}) {  // straight and finite, back inside on both sides
    gradient.setZero();
    EXPECT_TRUE(std::isfinite(goal((VectorXd(4) << outside, -outside, 0, 0).finished(), gradient)));
    EXPECT_GT(gradient[0], 1e3);
    EXPECT_EQ(gradient[0], -gradient[1]);
  }
}

TEST(Goals, JointLimitsSkipJointsWithoutLimits) {
  const double infinite = std::numeric_limits<double>::infinity();
  const VectorXd low = (VectorXd(2) << -infinite, 1).finished(), high = (VectorXd(2) << infinite, -1).finished();
  VectorXd gradient = VectorXd::Zero(2);
  EXPECT_EQ(joint_limits((VectorXd(2) << 3, 3).finished(), low, high, 1, 0.1, gradient), 0);
  EXPECT_EQ(gradient.norm(), 0);
}

TEST(Goals, GradientOfManipulabilityIsThatOfItsLogarithm) {
  sweep_robots(0.5, [](Robot& robot, Draw& draw, int& checked) {
    const Rows rows =
        std::vector{Rows::kTranslation, Rows::kRotation, Rows::kBoth}[static_cast<std::size_t>(draw.integer(0, 2))];
    ManipulabilityGoal goal(robot.n, rows, 0.3);
    const robot::FrameOnBody frame = robot.frame(robot.n - 1);
    const VectorXd q = draw.numbers(robot.n, -2, 2);
    VectorXd ignored(robot.n);
    if (goal.w(robot.mechanism, robot.data, q, frame) < 1e-4) return;  // differences of a logarithm are then not exact
    expect_gradient([&](const VectorXd& at, VectorOut g) { return goal.add(robot.mechanism, robot.data, at, frame, 2.5, g); },
                    q, 1e-4);
    ++checked;
  });
}

TEST(Goals, ManipulabilityOfThePlanarArmIsTheAreaOfItsLinks) {
  Robot robot("planar2", 0);
  const double l_1 = robot.model.joints[1].X_PJ.p.norm();
  const robot::FrameOnBody tip{1, {Eigen::Matrix3d::Identity(), Eigen::Vector3d(0, 0, 0)}};
  ManipulabilityGoal goal(2, Rows::kTranslation, 0.3);
  const VectorXd q = (VectorXd(2) << 0.4, 1.1).finished();
  // The second joint's own origin moves with the first joint alone: rank 1 of 2.
  EXPECT_NEAR(goal.w(robot.mechanism, robot.data, q, tip), 0, 1e-12);
  robot::FrameOnBody end = tip;
  const Eigen::Vector3d axis = robot.model.joints[1].axis;
  end.X_BF.p = 0.7 * axis.unitOrthogonal();
  const Eigen::Vector3d elbow = robot::forward_kinematics(robot.mechanism, robot.data, q, tip).p;
  const Eigen::Vector3d at = robot::forward_kinematics(robot.mechanism, robot.data, q, end).p;
  const Eigen::Vector3d base = robot::forward_kinematics(robot.mechanism, robot.data, q, {0, {}}).p;
  EXPECT_NEAR((elbow - base).norm(), l_1, 1e-12);
  // w = l_1 l_2 |sin q_2|: twice the area of the triangle of the links
  EXPECT_NEAR(goal.w(robot.mechanism, robot.data, q, end), (elbow - base).cross(at - elbow).norm(), 1e-12);
}

TEST(Goals, GradientOfTheEffectiveMassFollowsTheLocalAxis) {
  sweep_robots(0.5, [](Robot& robot, Draw& draw, int& checked) {
    EffectiveMassGoal goal(robot.n);
    const robot::FrameOnBody frame = robot.frame(robot.n - 1);
    const VectorXd q = draw.numbers(robot.n, -2, 2), B = VectorXd::Constant(draw.integer(0, 1) * robot.n, 0.5);
    const Eigen::Vector3d e = draw.direction();
    VectorXd ignored(robot.n);
    ignored.setZero();
    goal.add(robot.mechanism, robot.data, q, B, frame, e, robot::Direction::kInFrame, 0, ignored);
    if (!(goal.m_u < 1e3)) return;  // nearly singular
    expect_gradient(
        [&](const VectorXd& at, VectorOut g) {
          return goal.add(robot.mechanism, robot.data, at, B, frame, e, robot::Direction::kInFrame, 0.5, g);
        },
        q, 1e-3);
    ++checked;
  });
}

TEST(Goals, EffectiveMassOfTheLwr4IsThatOfTheSpecification) {
  Robot robot("lwr4", 0);
  EffectiveMassGoal goal(7);
  VectorXd gradient = VectorXd::Zero(7);
  const double V = goal.add(robot.mechanism, robot.data, lwr4_pose(), VectorXd(), robot::on_body(robot.model.frame("link_7")),
                            Eigen::Vector3d::UnitZ(), robot::Direction::kInFrame, 2, gradient);
  EXPECT_NEAR(goal.m_u, 3.28702, 5e-6);
  EXPECT_EQ(V, 2 * goal.m_u);
}

TEST(Goals, ManipulabilityStaysFiniteAtSingularPositionsAndAllocatesNothing) {
  Robot robot("lwr4", 0);
  ManipulabilityGoal goal(7, Rows::kBoth, 0.3);
  const robot::FrameOnBody frame = robot.frame(6);
  VectorXd gradient = VectorXd::Zero(7);
  const VectorXd q = VectorXd::Zero(7);
  const auto before = cotwin::testing::allocations();
  const double V = goal.add(robot.mechanism, robot.data, q, frame, 1, gradient);
  const double w = goal.w(robot.mechanism, robot.data, q, frame);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0U);
  EXPECT_TRUE(std::isfinite(V));
  EXPECT_TRUE(gradient.allFinite());
  EXPECT_LT(w, 1e-8);
}

}  // namespace
}  // namespace cotwin::control::goals_test
