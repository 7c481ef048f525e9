#include "models/robot/jacobian_rate.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cotwin::robot {

void jacobian_rate(int n, const double* J, std::ptrdiff_t ld, const double* dq, double* dJ, std::ptrdiff_t ld_rate) {
  using Vector = Eigen::Vector3d;
  using In = Eigen::Map<const Vector>;
  using Out = Eigen::Map<Vector>;
  Vector beyond = Vector::Zero();  // velocity of the frame by the joints beyond i
  for (int i = 0; i < n; ++i) beyond += In(J + i * ld) * dq[i];
  Vector turn = Vector::Zero();  // angular velocity by the joints up to i
  for (int i = 0; i < n; ++i) {
    const In v(J + i * ld), w(J + i * ld + 3);
    beyond -= v * dq[i];
    turn += w * dq[i];
    Out(dJ + i * ld_rate) = turn.cross(v) + w.cross(beyond);
    Out(dJ + i * ld_rate + 3) = turn.cross(w);
  }
}

}  // namespace cotwin::robot
