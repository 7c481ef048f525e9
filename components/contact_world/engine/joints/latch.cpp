#include "components/contact_world/engine/joints/latch.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace cotwin::contact_world {
namespace {

/// Part of what `met` was that is left at this progress, and its derivative: the quintic from 1 to 0, at rest at both ends.
double left(double s) { return 1 - s * s * s * (10 + s * (6 * s - 15)); }
double left_rate(double s) { return -30 * s * s * (1 - s) * (1 - s); }

Matrix3d turned_by(const Vector3d& rotation) {
  const double angle = rotation.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix() : Matrix3d(Matrix3d::Identity());
}

}  // namespace

double Latch::angle() const { return Eigen::AngleAxisd(joint.R_parent.transpose() * joint.R_child).angle(); }

void Latch::close() {
  const Eigen::AngleAxisd turn(joint.R_parent.transpose() * joint.R_child);
  met.linear = joint.R_parent.transpose() * (joint.p_child - joint.p_parent);
  met.angular = turn.angle() * turn.axis();
  impulse = sum = {};
  progress = 0;
  closed = true;
  holds = false;
}

double Latch::progress_after(double h) const { return law.time > 0 ? std::min(1.0, progress + h / law.time) : progress; }

Latch::Aim Latch::aim(Stage stage, double h) const {
  const double end = progress_after(h), now = stage == Stage::kPosition ? progress : end;
  const double share = left(now);
  const double rate = stage == Stage::kPosition ? (left(end) - share) / h : law.time > 0 ? left_rate(end) / law.time : 0;
  Aim aim;
  aim.rate = {joint.R_parent * (rate * met.linear), joint.R_parent * (rate * met.angular)};
  aim.error.linear = joint.p_child - joint.p_parent - joint.R_parent * (share * met.linear);
  const Matrix3d R = joint.R_parent * turned_by(share * met.angular);
  for (int k = 0; k < 3; ++k) aim.error.angular += R.col(k).cross(joint.R_child.col(k)) / 2;
  aim.cosine = (R.cwiseProduct(joint.R_child).sum() - 1) / 2;
  return aim;
}

bool Latch::advance(double h) {
  progress = progress_after(h);
  if (overloaded) {
    const Motion6 error = aim(Stage::kPosition, h).error;
    const double stretch = law.stiffness > 0 ? law.force / law.stiffness : 0;
    const double twist = law.turn_stiffness > 0 ? law.moment / law.turn_stiffness : 0;
    if (holds || error.linear.norm() > law.reach + stretch || error.angular.norm() > law.tilt + twist) {
      open();
      return true;
    }
  }
  holds = holds || (!overloaded && (progress == 1 || law.time == 0));
  return false;
}

}  // namespace cotwin::contact_world
