#include "components/io/emulators/kuka/pose_interpolator.h"
#include "components/io/emulators/kuka/interpolator.h"

#include <algorithm>

namespace cotwin::fri {

namespace {

constexpr double kRoundingOfFrames = 1e-5;  // m, rad: of frames in single floats

/// The vector, shortened to this length if it is longer.
Eigen::Vector3d shortened(const Eigen::Vector3d& v, double length) {
  const double norm = v.norm();
  return norm > length ? Eigen::Vector3d(v * (length / norm)) : v;
}

}  // namespace

PoseInterpolator::Frame PoseInterpolator::frame_of(const Pose& X) { return {X.p, Eigen::Quaterniond(X.R).normalized()}; }

PoseInterpolator::Frame PoseInterpolator::moved(const Frame& from, const Change& change, double share) {
  const double angle = change.phi.norm();
  Frame to{from.p + share * change.p, from.R};
  if (angle > 0) to.R = (from.R * Eigen::Quaterniond(Eigen::AngleAxisd(share * angle, change.phi / angle))).normalized();
  return to;
}

PoseInterpolator::Change PoseInterpolator::between(const Frame& from, const Frame& to) {
  Eigen::Quaterniond turn = from.R.conjugate() * to.R;
  if (turn.w() < 0) turn.coeffs() *= -1;  // the shorter way
  const Eigen::AngleAxisd rotation(turn);
  return {to.p - from.p, rotation.angle() * rotation.axis()};
}

void PoseInterpolator::start(const Pose& X, std::int64_t index) {
  newest_ = from_ = frame_of(X);
  slope_ = step_ = {};
  index_ = index;
  stopping_ = false;
}

void PoseInterpolator::command(const Pose& X, std::int64_t index) {
  if (stopping_ || index <= index_) return;
  const Frame next = frame_of(X);
  slope_ = between(newest_, next);
  const auto messages = static_cast<double>(index - index_);
  slope_.p /= messages;
  slope_.phi /= messages;
  newest_ = next;
  index_ = index;
}

bool PoseInterpolator::is_jump(const Pose& X, std::int64_t index) const {
  const Change change = between(newest_, frame_of(X));
  const double time = static_cast<double>(settings_.message_period * (index - index_) + settings_.slack) * 1e-9;
  return !(change.p.norm() <= settings_.linear_speed * time + kRoundingOfFrames &&
           change.phi.norm() <= settings_.angular_speed * time + kRoundingOfFrames);
}

void PoseInterpolator::begin_period(std::int64_t now, std::int64_t lost) {
  if (stopping_) return;
  from_ = frame_at(now);
  step_ = between(from_, moved(newest_, slope_, static_cast<double>(lost)));
  step_.p = shortened(step_.p, settings_.linear_speed * period());
  step_.phi = shortened(step_.phi, settings_.angular_speed * period());
  begin_ = now;
}

void PoseInterpolator::stop(std::int64_t now) {
  if (stopping_) return;
  from_ = frame_at(now);
  if (static_cast<double>(now - begin_) * 1e-9 > 2 * period()) step_ = {};
  begin_ = now;
  stopping_ = true;
}

PoseInterpolator::Frame PoseInterpolator::frame_at(std::int64_t now) const {
  const double t = static_cast<double>(std::max<std::int64_t>(now - begin_, 0)) * 1e-9;
  if (!stopping_) return moved(from_, step_, period() <= kLongestStep ? 1 : std::min(t / period(), 1.0));
  // The speed falls linearly to 0: after the time t, t − t²/(2 t_s) of it.
  const double stop_time = static_cast<double>(settings_.stop_time) * 1e-9;
  const double s = std::min(t, stop_time);
  return moved(from_, step_, stop_time > 0 ? (s - s * s / (2 * stop_time)) / period() : 0);
}

Pose PoseInterpolator::at(std::int64_t now) const {
  const Frame frame = frame_at(now);
  return {frame.R.toRotationMatrix(), frame.p};
}

}  // namespace cotwin::fri
