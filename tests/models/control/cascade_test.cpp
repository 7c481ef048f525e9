// Prioritised tasks and self-motion against the literal formulas with dense matrices, conserved energy, and algebraic identities.

#include "models/control/cascade.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <string>
#include <vector>

#include "tests/models/control/robots.h"
#include "tests/support/allocations.h"

namespace cotwin::control::cascade_test {
namespace {

using namespace testing;

constexpr double kExact = 1e-10;

double relative(const MatrixXd& difference, const MatrixXd& of) {
  return difference.cwiseAbs().maxCoeff() / (1 + of.cwiseAbs().maxCoeff());
}

/// The formulas as printed, with (J M⁻¹ Jᵀ)⁺ by singular values above 1e-9.
struct Literal {
  MatrixXd N;
  VectorXd ddq;
  std::vector<MatrixXd> J_bar;

  Literal(const MatrixXd& M, const std::vector<Task>& tasks) : N(MatrixXd::Identity(M.rows(), M.rows())), ddq(M.rows()) {
    ddq.setZero();
    const MatrixXd inverse = M.inverse();
    for (const Task& task : tasks) {
      const MatrixXd J_p = task.J * N;
      const MatrixXd A = J_p * inverse * J_p.transpose();
      Eigen::JacobiSVD<MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
      VectorXd d = svd.singularValues();
      for (double& x : d) x = x > 1e-9 * (1 + svd.singularValues()[0]) ? 1 / x : 0;
      J_bar.push_back(inverse * J_p.transpose() * svd.matrixV() * d.asDiagonal() * svd.matrixU().transpose());
      ddq += J_bar.back() * (task.a - task.J * ddq);
      N = N * (MatrixXd::Identity(M.rows(), M.rows()) - J_bar.back() * J_p);
    }
  }
};

TEST(Cascade, OneTaskHasTheIdentitiesOfTheDynamicallyConsistentInverse) {
  sweep_robots(0.5, [](Robot& robot, Draw& draw, int& checked) {
    const int m = std::min(robot.n, draw.integer(1, 6));
    Cascade cascade(robot.n, {m});
    cascade.sigma_0 = 1e-4;
    const VectorXd q = draw.numbers(robot.n, -2, 2);
    robot.fill(cascade.tasks[0], q, VectorXd::Zero(robot.n), draw.integer(0, 6 - m));
    const MatrixXd M = robot.metric(q), J = cascade.tasks[0].J;
    ASSERT_TRUE(cascade.decompose(M));
    const double smallest = Eigen::JacobiSVD<MatrixXd>(cascade.tasks[0].scale.asDiagonal() * J).singularValues().tail<1>()[0];
    EXPECT_NEAR(cascade.tasks[0].sigma_min, smallest, 1e-7);
    if (smallest < 0.01) return;  // conditions of the matrices below are then not those of rounding
    ASSERT_TRUE(cascade.exact());
    const MatrixXd N = projector(cascade), J_bar = Literal(M, cascade.tasks).J_bar[0];
    const MatrixXd one = MatrixXd::Identity(m, m);
    EXPECT_LT((J * J_bar - one).cwiseAbs().maxCoeff(), kExact);
    EXPECT_LT(relative(J * N, J), kExact);
    EXPECT_LT(relative(N * N - N, N), kExact);
    EXPECT_LT(relative(M * N - N.transpose() * M, M), kExact);
    EXPECT_LT(relative(J * M.inverse() * N.transpose(), J * M.inverse()), kExact);
    MatrixXd mobility(robot.n, robot.n);
    cascade.mobility(0, mobility);
    EXPECT_LT(relative(mobility - M.inverse(), M.inverse()), kExact);
    cascade.mobility(1, mobility);
    EXPECT_LT(relative(mobility - N * M.inverse(), M.inverse()), kExact);

    VectorXd tau = draw.numbers(robot.n, -10, 10), v = draw.numbers(robot.n, -1, 1);
    VectorXd projected = tau, moved = v;
    projected = N.transpose() * tau;
    cascade.solve_mass(projected);
    EXPECT_LT((J * projected).norm(), kExact * (1 + (J * M.inverse()).norm() * tau.norm()));  // no ẍ
    std::vector<VectorXd> forces{VectorXd(m)};
    cascade.split(moved, forces);
    EXPECT_LT((moved - N * v).norm(), kExact * (1 + N.norm()));
    EXPECT_LT((M * (v - moved) - J.transpose() * forces[0]).norm(), kExact * (1 + M.norm()));
    ++checked;
  });
}

TEST(Cascade, FollowsTheSuccessiveNullSpacesOfTheLiteratureAndLowerTasksMoveNoHigherOne) {
  sweep_robots(0.35, [](Robot& robot, Draw& draw, int& checked) {
    if (robot.n < 3) return;
    const int first = draw.integer(1, std::min(3, robot.n - 2)), second = draw.integer(1, robot.n - first - 1);
    std::vector<int> rows{first, std::min(3, second), 1};
    Cascade cascade(robot.n, rows);
    cascade.sigma_0 = 1e-4;
    const VectorXd q = draw.numbers(robot.n, -2, 2), dq = draw.numbers(robot.n, -1, 1);
    for (std::size_t k = 0; k < rows.size(); ++k) {
      Task& task = cascade.tasks[k];
      robot.fill(task, q, dq, k == 0 ? 0 : draw.integer(0, 6 - rows[k]), k == 1 ? draw.integer(0, robot.n - 1) : robot.n - 1);
      task.a = draw.numbers(rows[k], -1, 1);
    }
    const MatrixXd M = robot.metric(q);
    ASSERT_TRUE(cascade.decompose(M));
    for (const Task& task : cascade.tasks)
      if (task.sigma_min < 0.01) return;  // contradictions and singular poses are other tests
    const Literal literal(M, cascade.tasks);
    VectorXd ddq(robot.n);
    cascade.solve(ddq);
    const double size = 1 + literal.ddq.norm();
    EXPECT_LT((ddq - literal.ddq).norm(), 1e-8 * size);  // the literal one loses digits in A
    for (const Task& task : cascade.tasks) {
      EXPECT_LT((task.a - task.J * ddq).norm(), kExact * size);
      EXPECT_LT((task.residual - (task.a - task.J * ddq)).norm(), kExact * size);
    }
    const MatrixXd N = projector(cascade);
    EXPECT_LT(relative(N - literal.N, literal.N), 1e-8);
    EXPECT_LT(relative(M * N - N.transpose() * M, M), kExact);
    MatrixXd mobility(robot.n, robot.n);
    const Literal above(M, {cascade.tasks[0], cascade.tasks[1]});
    cascade.mobility(2, mobility);
    EXPECT_LT(relative(mobility - above.N * M.inverse(), M.inverse()), 1e-8);

    VectorXd v = draw.numbers(robot.n, -1, 1), left = v, sum = VectorXd::Zero(robot.n);
    std::vector<VectorXd> forces;
    for (const int m : rows) forces.emplace_back(VectorXd(m));
    cascade.split(left, forces);
    for (std::size_t k = 0; k < rows.size(); ++k) sum += cascade.tasks[k].J.transpose() * forces[k];
    EXPECT_LT((left - N * v).norm(), kExact * (1 + N.norm()));
    EXPECT_LT((M * (v - left) - sum).norm(), 1e-9 * (1 + M.norm()));

    VectorXd changed(robot.n);  // other lower tasks
    cascade.tasks[1].a *= -3;
    cascade.tasks[2].a[0] += 100;
    cascade.solve(changed);
    EXPECT_LT((cascade.tasks[0].J * (changed - ddq)).norm(), kExact * (1 + changed.norm()));
    ++checked;
  });
}

TEST(Cascade, ATaskThatContradictsAHigherOneIsToldAndLeavesItAsItIs) {
  Robot robot("lwr4", 0.05);
  const VectorXd q = lwr4_pose(), zero = VectorXd::Zero(7);
  Cascade cascade(7, {6, 3});
  robot.fill(cascade.tasks[0], q, zero, 0);
  robot.fill(cascade.tasks[1], q, zero, 0);  // the position again
  cascade.tasks[0].a << 1, 0, 0, 0, 0, 0;
  cascade.tasks[1].a << -1, 0.5, 0;
  ASSERT_TRUE(cascade.decompose(robot.metric(q)));
  VectorXd ddq(7);
  cascade.solve(ddq);
  EXPECT_LT((cascade.tasks[0].J * ddq - cascade.tasks[0].a).norm(), kExact);
  EXPECT_LT(cascade.tasks[0].residual.norm(), kExact);
  EXPECT_NEAR(cascade.tasks[1].residual[0], -2, 1e-9);  // asked −1, gets 1
  EXPECT_NEAR(cascade.tasks[1].residual[1], 0.5, 1e-9);
  EXPECT_LT(cascade.tasks[1].sigma_min, 1e-6);
  EXPECT_NEAR(cascade.tasks[1].lambda, cascade.sigma_0, 1e-9);
  EXPECT_LT(ddq.norm(), 20);
}

TEST(Cascade, TaskWithMoreRowsThanTheRobotHasJointsIsDoneAsFarAsPossible) {
  Robot robot("planar2", 0);
  Cascade cascade(2, {6});
  const VectorXd q = (VectorXd(2) << 0.3, 1).finished();
  robot.fill(cascade.tasks[0], q, VectorXd::Zero(2), 0);
  cascade.tasks[0].a << 1, 1, 1, 0, 0, 0;
  ASSERT_TRUE(cascade.decompose(robot.metric(q)));
  VectorXd ddq(2);
  cascade.solve(ddq);
  EXPECT_TRUE(ddq.allFinite());
  EXPECT_EQ(cascade.tasks[0].sigma_min, 0);
  EXPECT_GT(cascade.tasks[0].residual.norm(), 0.5);
}

// A path of the elbow through the stretched arm, in steps of 1e-4 rad: q̈ turns by no more than its slope allows.
TEST(Cascade, MovesThroughSingularPositionsWithoutJumpsOrLargeSpeeds) {
  for (const double sigma_0 : {0.005, 0.02, 0.05}) {
    Robot robot("lwr4", 0.05);
    Cascade cascade(7, {6});
    cascade.sigma_0 = sigma_0;
    VectorXd q = lwr4_pose(), ddq(7), before;
    double jump = 0, most = 0;
    bool damped = false, exact = false;
    for (int i = -4000; i <= 4000; ++i) {
      q[3] = i * 1e-4;
      robot.fill(cascade.tasks[0], q, VectorXd::Zero(7), 0);
      cascade.tasks[0].a << 0.6, -0.3, 0.5, 0.2, 0.1, -0.4;
      ASSERT_TRUE(cascade.decompose(robot.metric(q)));
      cascade.solve(ddq);
      damped = damped || cascade.tasks[0].lambda > 0;
      exact = exact || cascade.exact();
      most = std::max(most, ddq.norm());
      if (i > -4000) jump = std::max(jump, (ddq - before).norm());
      before = ddq;
    }
    EXPECT_TRUE(damped && exact);
    EXPECT_LT(most, 10 / sigma_0);                // ‖ẍ‖/sigma_0 and a factor of the masses
    EXPECT_LT(jump, 1e-4 * 30 * most / sigma_0);  // a slope of about 1/sigma_0 per rad
  }
}

TEST(Cascade, ActivationFadesATaskAndItsNullSpaceInAndOut) {
  Robot robot("lwr4", 0.05);
  const VectorXd q = lwr4_pose(), zero = VectorXd::Zero(7);
  Cascade cascade(7, {3, 3}), without(7, {3}), only(7, {3});
  robot.fill(cascade.tasks[0], q, zero, 0);
  robot.fill(cascade.tasks[1], q, zero, 3);
  cascade.tasks[0].a << 1, 2, -1;
  cascade.tasks[1].a << -2, 1, 3;
  without.tasks[0] = cascade.tasks[1];
  only.tasks[0] = cascade.tasks[0];
  const MatrixXd M = robot.metric(q);
  VectorXd ddq(7), reference(7), before;
  MatrixXd N(7, 7), N_reference(7, 7);
  for (int i = 0; i <= 1000; ++i) {
    cascade.tasks[0].activation = i / 1000.0;
    ASSERT_TRUE(cascade.decompose(M));
    cascade.solve(ddq);
    if (i > 0) {
      EXPECT_LT((ddq - before).norm(), 0.05 * (1 + ddq.norm())) << i;
    }
    before = ddq;
    if (i == 0) {
      ASSERT_TRUE(without.decompose(M));
      without.solve(reference);
      EXPECT_LT((ddq - reference).norm(), kExact * (1 + ddq.norm()));
      N = projector(cascade);
      N_reference = projector(without);
      EXPECT_LT((N - N_reference).norm(), kExact);
    }
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen([&] {  // of L⁻¹ (M N) L⁻ᵀ
      N = projector(cascade);
      const Eigen::LLT<MatrixXd> L(M);
      MatrixXd S = L.matrixL().solve(M * N);
      return MatrixXd(L.matrixL().solve(S.transpose()));
    }());
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-9);
    EXPECT_LT(eigen.eigenvalues().maxCoeff(), 1 + 1e-9);
  }
  EXPECT_LT((cascade.tasks[0].J * ddq - cascade.tasks[0].a).norm(), kExact * (1 + ddq.norm()));
}

TEST(Cascade, RefusesAMetricThatIsNotPositiveDefinite) {
  Cascade cascade(2, {1});
  cascade.tasks[0].J << 1, 0;
  EXPECT_FALSE(cascade.decompose((MatrixXd(2, 2) << 1, 2, 2, 1).finished()));
  EXPECT_FALSE(cascade.decompose(MatrixXd::Constant(2, 2, std::nan(""))));
  EXPECT_TRUE(cascade.decompose(MatrixXd::Identity(2, 2)));
}

TEST(Cascade, AllocatesNothingAlsoWhereItIsDamped) {
  Robot robot("lwr4", 0.05);
  Cascade cascade(7, {6, 3});
  VectorXd q = lwr4_pose(), ddq(7);
  q[3] = 0;
  robot.fill(cascade.tasks[0], q, VectorXd::Zero(7), 0);
  robot.fill(cascade.tasks[1], q, VectorXd::Zero(7), 0, 3);
  const MatrixXd M = robot.metric(q);
  std::vector<VectorXd> forces{VectorXd(6), VectorXd(3)};
  const auto before = cotwin::testing::allocations();
  const bool done = cascade.decompose(M);
  cascade.solve(ddq);
  cascade.project(ddq);
  cascade.split(ddq, forces);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0U);
  EXPECT_TRUE(done);
  EXPECT_FALSE(cascade.exact());
}

}  // namespace
}  // namespace cotwin::control::cascade_test
