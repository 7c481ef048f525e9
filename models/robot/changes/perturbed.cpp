#include "models/robot/changes/perturbed.h"

#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/random.h"
#include "models/robot/changes/attachment.h"

namespace cotwin::robot {

RobotModel perturbed(const RobotModel& robot, double bound, std::uint64_t seed) {
  if (!(bound >= 0 && bound <= 0.5)) throw Error("perturbation", "bound " + text::to_text(bound) + ", expected 0 to 0.5");
  constexpr std::uint32_t kStream = 0x9e37;
  RobotModel other = robot;
  for (int body = 0; body < robot.body_count(); ++body) {
    std::uint32_t draw = 0;
    const auto uniform = [&] {
      return 2 * numerics::uniform({seed, kStream, 0, static_cast<std::uint32_t>(body), draw++}) - 1;
    };
    const Inertia& inertia = robot.bodies[static_cast<std::size_t>(body)].inertia;
    if (inertia.is_nothing()) continue;

    // P about the centre of mass, where h = 0
    Eigen::Matrix4d P = Eigen::Matrix4d::Zero();
    P.topLeftCorner<3, 3>() = 0.5 * inertia.I_CC.trace() * Eigen::Matrix3d::Identity() - inertia.I_CC;
    P(3, 3) = inertia.mass;
    const double gyration = std::sqrt(P.topLeftCorner<3, 3>().trace() / inertia.mass);
    Eigen::Matrix4d A = Eigen::Matrix4d::Identity();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) A(i, j) += 0.5 * bound * uniform();
      A(i, 3) = bound * gyration * uniform();
    }
    A(3, 3) = std::sqrt(1 + bound * uniform());

    const Eigen::Matrix4d Q = A * P * A.transpose();
    const double mass = Q(3, 3);
    const Eigen::Vector3d shift = Q.topRightCorner<3, 1>() / mass;
    const Eigen::Matrix3d Sigma = Q.topLeftCorner<3, 3>() - mass * shift * shift.transpose();
    const Eigen::Matrix3d I_CC = Sigma.trace() * Eigen::Matrix3d::Identity() - Sigma;
    set_inertia(other, body, {mass, inertia.p_LC + shift, 0.5 * (I_CC + I_CC.transpose())}, "perturbed");
  }
  return other;
}

}  // namespace cotwin::robot
