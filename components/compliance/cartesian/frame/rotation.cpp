#include "components/compliance/cartesian/frame/rotation.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace cotwin::compliance {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// The solution of Q₊ − Q₋ = ½ (0, r) ⊗ (Q₊ + Q₋)/2: a rotation by 4 atan(|r|/4) about r.
inline Quaterniond turned(const Quaterniond& Q, const Vector3d& r) {
  const Vector3d a = r / 4;
  const double a2 = a.squaredNorm();
  const double scale = 1 / (1 + a2);
  const Vector3d v = 2 * scale * a;
  return Quaterniond((1 - a2) * scale, v.x(), v.y(), v.z()) * Q;
}

Quaterniond positive(const Quaterniond& Q) { return Q.w() < 0 ? Quaterniond(-Q.coeffs()) : Q; }

/// The elastic moment whose work over a turn by hΩ from Q to `next` is the difference of the potential.
inline Vector3d mean_moment(Potential potential, const Matrix3d& S, const Quaterniond& Q, const Quaterniond& next,
                            const Vector3d& h_Omega) {
  if (potential == Potential::kQuaternion) {
    const double eta = (Q.w() + next.w()) / 2;
    const Vector3d eps = (Q.vec() + next.vec()) / 2;
    const Vector3d Seps = S * eps;
    return 2 * (eta * Seps + eps.cross(Seps));
  }
  // As above with a matrix A that takes hΩ to the difference of φ exactly (Gonzalez 1996).
  const Vector3d before = axis_angle(Q), after = axis_angle(next), mean = (before + after) / 2;
  const Matrix3d J = inverse_left_jacobian(mean);
  const Vector3d S_mean = S * mean;
  Vector3d moment = J.transpose() * S_mean;
  const double length2 = h_Omega.squaredNorm();
  if (length2 > 1e-10 && (after - before).squaredNorm() < 1)
    moment += h_Omega * ((after - before - J * h_Omega).dot(S_mean) / length2);
  return moment;
}

/// Parts of a step that are short compared with the oscillation and the decay of all modes.
int parts(const Impedance& z, double h) {
  constexpr double kShort = 0.1, kDecay = 1;
  constexpr double kMost = 64;
  const Matrix3d inverse = z.M.inverse();
  const double omega = std::sqrt((inverse * z.S).cwiseAbs().rowwise().sum().maxCoeff());
  const double decay = (inverse * z.D).cwiseAbs().rowwise().sum().maxCoeff();
  return static_cast<int>(std::clamp(std::ceil(h * std::max(omega / kShort, decay / kDecay)), 1.0, kMost));
}

/// Takes speed, or else the whole motion from `before`, until the energy at `at` is that of `before` and `work`, J.
void bound_energy(Potential potential, const Impedance& z, const Turn& before, double work, Turn& at) {
  const auto kinetic = [&](const Turn& t) { return t.w.dot(z.M * t.w) / 2; };
  const double allowed = kinetic(before) + potential_energy(potential, z.S, before.Q) + std::min(work, 0.0);
  const double left = allowed - potential_energy(potential, z.S, at.Q);
  if (!(left >= 0)) {
    at = {before.Q, Vector3d::Zero()};
  } else if (kinetic(at) > left) {
    at.w *= std::sqrt(left / kinetic(at));
  }
}

}  // namespace

Matrix3d cross_matrix(const Vector3d& v) {
  Matrix3d S;
  S << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return S;
}

Matrix3d inverse_left_jacobian(const Vector3d& phi) {
  const double angle2 = phi.squaredNorm();
  // (1 − (θ/2) cot(θ/2))/θ², by its series near 0.
  double c = 1.0 / 12 + angle2 / 720 + angle2 * angle2 / 30240;
  if (angle2 > 1e-2) {
    const double half = std::sqrt(angle2) / 2;
    c = (1 - half * std::cos(half) / std::sin(half)) / angle2;
  }
  const Matrix3d S = cross_matrix(phi);
  return Matrix3d::Identity() - 0.5 * S + c * S * S;
}

Vector3d axis_angle(const Quaterniond& Q) {
  const Quaterniond q = positive(Q);
  const double s2 = q.vec().squaredNorm();
  if (s2 < 1e-6) return q.vec() * (2 + s2 * (1.0 / 3 + s2 * 0.15));  // of 2 asin(s)/s
  const double s = std::sqrt(s2);
  return q.vec() * (2 * std::atan2(s, q.w()) / s);
}

Quaterniond quaternion_of(const Vector3d& r) {
  const double angle2 = r.squaredNorm();
  double c, s;
  if (angle2 < 1e-4) {  // series of cos(angle/2) and sin(angle/2)/angle
    const double x = angle2 / 4;
    c = 1 - x / 2 * (1 - x / 12 * (1 - x / 30));
    s = (1 - x / 6 * (1 - x / 20 * (1 - x / 42))) / 2;
  } else {
    const double angle = std::sqrt(angle2);
    c = std::cos(angle / 2);
    s = std::sin(angle / 2) / angle;
  }
  return {c, s * r.x(), s * r.y(), s * r.z()};
}

double potential_energy(Potential potential, const Matrix3d& S, const Quaterniond& Q) {
  if (potential == Potential::kQuaternion) return 2 * Q.vec().dot(S * Q.vec());
  const Vector3d phi = axis_angle(Q);
  return phi.dot(S * phi) / 2;
}

Vector3d elastic_moment(Potential potential, const Matrix3d& S, const Quaterniond& Q) {
  return mean_moment(potential, S, positive(Q), positive(Q), Vector3d::Zero());
}

void RotationStep::prepare(const Impedance& z, double h) {
  if (h == h_ && z == impedance_) return;
  h_ = h;
  impedance_ = z;
  count_ = parts(z, h);
  part_ = h / count_;
  inertia_ = 2 / part_ * z.M;
  resistance_ = inertia_ + z.D;
  inverse_ = (resistance_ + part_ / 2 * z.S).inverse();
}

Turned RotationStep::advance(Potential potential, const Turn& start, const Vector3d& m0, const Vector3d& m1) const {
  const Impedance& z = impedance_;
  const double part = part_;
  Turned result{start, 0};
  Turn& at = result.turn;
  for (int k = 0; k < count_; ++k) {
    const Vector3d drive = inertia_ * at.w + m0 + m1 * ((k + 0.5) * part);
    Vector3d Omega = at.w;
    Quaterniond next = at.Q;
    // Newton's method with the slope of the moment at ε = 0: contraction by (omega part)²/4 < 0.0025 or better, except where
    // the parts are long (kMost). It ends where the next change would be less than rounding.
    constexpr int kMostIterations = 20;
    constexpr double kRounding = 1e-16, kConverged = 1e-8, kStill = 1e-5;  // the last in rad
    double rest = 1, contraction = 1;  // last change, relative, and its ratio to the one before
    for (int i = 0; i < kMostIterations && rest * contraction > kRounding; ++i) {
      next = turned(at.Q, part * Omega);
      const Vector3d moment = mean_moment(potential, z.S, at.Q, next, part * Omega);
      const Vector3d change = inverse_ * (drive - resistance_ * Omega - moment);
      Omega += change;
      const double before = rest, largest = Omega.cwiseAbs().maxCoeff();
      rest = change.cwiseAbs().maxCoeff() / (largest + kStill / part);
      contraction = i == 0 ? 1.0 : std::min(rest / before, 1.0);
    }
    const Turn before = at;
    at.Q = turned(at.Q, part * Omega);
    at.w = 2 * Omega - at.w;
    if (!(rest < kConverged)) {
      const double work = part * Omega.dot(m0 + m1 * ((k + 0.5) * part) - z.D * Omega);
      bound_energy(potential, z, before, work, at);
    }
    result.dissipated += part * Omega.dot(z.D * Omega);
  }
  at.Q = positive(at.Q.normalized());
  return result;
}

}  // namespace cotwin::compliance
