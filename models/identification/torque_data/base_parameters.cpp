// Base parameters from the rank of the regressor on random motions.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/torque_data/torque_data.h"
#include "models/numerics/random.h"

namespace cotwin::identification {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr const char* kNames[10] = {"m", "mc_x", "mc_y", "mc_z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"};

/// A column counts as a combination of others where less of its length than this is left. Structural zeros leave 1e-15 to
/// 1e-13, what is independent leaves more than 1e-4 on motions that use every joint fully.
constexpr double kDependent = 1e-9;

/// The regressors of random states, one below the other. Speeds and accelerations are such that gravity, inertial and
/// centrifugal torques are of one order.
MatrixXd random_regressor(const robot::RobotModel& robot) {
  const Index n = robot.n(), states = 60;
  const robot::Mechanism mechanism(robot);
  robot::Data scratch(mechanism);
  MatrixXd W(n * states, 10 * robot.body_count()), Y(n, W.cols());
  VectorXd q(n), dq(n), ddq(n);
  for (Index s = 0; s < states; ++s) {
    for (Index j = 0; j < n; ++j) {
      const auto draw = [&](std::uint32_t k, double reach) {
        const numerics::Key key{5489, 0, static_cast<std::uint32_t>(s), static_cast<std::uint32_t>(j), k};
        return reach * (2 * numerics::uniform(key) - 1);
      };
      q[j] = draw(0, std::numbers::pi);
      dq[j] = draw(1, 3);
      ddq[j] = draw(2, 10);
    }
    robot::regressor(mechanism, scratch, q, dq, ddq, Y);
    W.middleRows(n * s, n) = Y;
  }
  return W;
}

}  // namespace

std::string parameter_name(int k) { return std::string(kNames[k % 10]) + "_" + std::to_string(k / 10 + 1); }

BaseParameters base_parameters(const robot::RobotModel& robot) {
  const Index all = 10 * robot.body_count();
  if (robot.n() == 0) throw Error("robot " + robot.name, "has no joints, expected at least one");
  const MatrixXd W = random_regressor(robot);
  // Gram–Schmidt, each column twice (which makes it orthogonal to rounding), bodies from the base to the tip; within a body the
  // mass last, so that moments keep their names where they can.
  MatrixXd Q(W.rows(), all), coefficients = MatrixXd::Zero(all, all);
  std::vector<int> kept;
  const double largest = W.colwise().norm().maxCoeff();
  for (const int body : robot.depth_first())
    for (int k = 1; k <= 10; ++k) {
      const Index column = 10 * body + k % 10;
      const auto rank = static_cast<Index>(kept.size());
      VectorXd rest = W.col(column);
      const double length = rest.norm();
      for (int pass = 0; pass < 2; ++pass) {
        const VectorXd along = Q.leftCols(rank).transpose() * rest;
        rest -= Q.leftCols(rank) * along;
        coefficients.col(column).head(rank) += along;
      }
      if (length <= kDependent * largest) {
        coefficients.col(column).setZero();
      } else if (rest.norm() > kDependent * length) {
        coefficients(rank, column) = rest.norm();
        Q.col(rank) = rest / rest.norm();
        kept.push_back(static_cast<int>(column));
      }
    }
  const auto rank = static_cast<Index>(kept.size());
  MatrixXd R(rank, rank);
  for (Index i = 0; i < rank; ++i) R.col(i) = coefficients.col(kept[static_cast<std::size_t>(i)]).head(rank);
  MatrixXd G = R.triangularView<Eigen::Upper>().solve(coefficients.topRows(rank));
  G = (G.array().abs() < 1e-10).select(0.0, G);
  for (Index i = 0; i < rank; ++i) G.col(kept[static_cast<std::size_t>(i)]) = VectorXd::Unit(rank, i);
  return {kept, G};
}

std::string BaseParameters::name(int i, double least) const {
  std::string text = parameter_name(columns[static_cast<std::size_t>(i)]);
  for (Index k = 0; k < G.cols(); ++k) {
    const double factor = G(i, k);
    if (k == columns[static_cast<std::size_t>(i)] || std::abs(factor) < least) continue;
    text += factor < 0 ? " - " : " + ";
    if (std::abs(std::abs(factor) - 1) > least) text += text::to_text(std::abs(factor), 4) + " ";
    text += parameter_name(static_cast<int>(k));
  }
  return text;
}

}  // namespace cotwin::identification
