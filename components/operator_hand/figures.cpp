#include "components/operator_hand/figures.h"

#include <cmath>

namespace cotwin::operator_hand {
namespace {

using Eigen::Vector3d;
constexpr double kLength = 1e-9;  // m: a point that moved less is at rest

}  // namespace

void Figures::declare_states(Variables& v) {
  v.state("figures_duration", duration_, "s", "duration of the motion so far, for the figures");
  v.state("figures_length", length_, "m", "length of the path of the gripped point so far");
  v.state("figures_force", force_, "N2.s", "integral of the squared force");
  v.state("figures_lag", lag_, "m2.s", "integral of the squared lag");
  v.state("figures_jerk", jerk_, "m2/s5", "integral of the squared jerk of the gripped point");
  v.state("figures_before", before_, "1", "force, lag, velocity and acceleration at the end of the last step");
  v.state("figures_h", h_before_, "s", "length of the last step; 0: the acceleration is not known yet");
}

void Figures::declare_outputs(Variables& v) {
  v.output("f_rms", f_rms_, "N", "root mean square of the force since the departure");
  v.output("lag_rms", lag_rms_, "m", "root mean square of the lag since the departure");
  v.output("jerk", dimensionless_jerk_, "1",
           "dimensionless jerk of the gripped point since the departure; 720: one minimum-jerk move");
}

void Figures::start(const Sample& first) {
  duration_ = length_ = force_ = lag_ = jerk_ = h_before_ = 0;
  take(first, 0);
  write();
}

void Figures::add(const Sample& end, double h, bool counts) {
  const Eigen::Map<const Vector3d> f(&before_[0]), lag(&before_[3]), v(&before_[6]), a(&before_[9]);
  if (counts) {
    duration_ += h;
    length_ += h * (end.v + v).norm() / 2;
    force_ += h * (end.f.squaredNorm() + f.squaredNorm()) / 2;
    lag_ += h * (end.lag.squaredNorm() + lag.squaredNorm()) / 2;
    const double between = (h + h_before_) / 2;  // of the middles of two steps, where the mean accelerations hold
    if (h_before_ > 0) jerk_ += between * (((end.v - v) / h - a) / between).squaredNorm();
  }
  take(end, h);
  write();
}

void Figures::take(const Sample& s, double h) {
  Eigen::Map<Vector3d> f(&before_[0]), lag(&before_[3]), v(&before_[6]), a(&before_[9]);
  a = h > 0 ? Vector3d((s.v - v) / h) : Vector3d::Zero();
  h_before_ = h;
  f = s.f;
  lag = s.lag;
  v = s.v;
}

void Figures::write() {
  const double T = duration_;
  f_rms_ = duration_ > 0 ? std::sqrt(force_ / duration_) : 0;
  lag_rms_ = duration_ > 0 ? std::sqrt(lag_ / duration_) : 0;
  dimensionless_jerk_ = length_ > kLength ? jerk_ * T * T * T * T * T / (length_ * length_) : 0;
}

}  // namespace cotwin::operator_hand
