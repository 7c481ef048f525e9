#include "components/compliance/cartesian/frame/contact_stiffness.h"

#include <algorithm>
#include <cmath>

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Complex = std::complex<double>;

constexpr double kLowest = 0.1;  // rad/s
constexpr double kPi = 3.14159265358979323846;
constexpr double kCoarsest = 1.35, kFinest = 1.002;  // ratios of two frequencies
constexpr double kNone = 1e300;                      // N/m; finite, because states are
constexpr double kTurn = 0.3;                        // rad; of G between them

/// arg(a s² + b s + c) at s = jΩ.
double phase(double a, double b, double c, double Omega) { return std::atan2(b * Omega, c - a * Omega * Omega); }

/// |a s² + b s + c| at s = jΩ.
double magnitude(double a, double b, double c, double Omega) { return std::hypot(c - a * Omega * Omega, b * Omega); }

/// Its least value at Ω and above.
double least_magnitude(double a, double b, double c, double Omega) {
  const double at = c / a - b * b / (2 * a * a);  // the square of the frequency where it is least
  return magnitude(a, b, c, std::max(Omega, std::sqrt(std::max(at, 0.0))));
}

}  // namespace

double largest_contact_stiffness(const SecondOrder& admittance, double omega, double zeta, double delay) {
  // (M s² + D s + S)(s² + 2ζω s + ω²) + K_e ω² = 0: K_e is in a₀ alone.
  const auto [M, D, S] = admittance;
  const double two_zw = 2 * zeta * omega, w2 = omega * omega;
  const double a3 = D + two_zw * M;
  const double a2 = S + two_zw * D + w2 * M;
  const double a1 = two_zw * S + w2 * D;
  if (!(a3 > 0)) return 0;
  const double at_once = std::max(a1 * (a3 * a2 - M * a1) / (a3 * a3 * w2) - S, 0.0);
  if (delay <= 0 || at_once <= 0) return at_once;
  // The phase grows with Ω, and is π below √(a₁/a₃). Where it is 3π, 5π … K_e may be less if A or T resonates there.
  constexpr int kCrossings = 50, kHalvings = 24;  // to 1e-7 of the frequency
  double least = at_once, low = 0, high = std::sqrt(a1 / a3);
  for (int n = 0; n < kCrossings; ++n) {
    for (int k = 0; k < kHalvings; ++k) {
      const double Omega = (low + high) / 2;
      const double turn = phase(M, D, S, Omega) + phase(1, two_zw, w2, Omega) + Omega * delay;
      (turn < (2 * n + 1) * kPi ? low : high) = Omega;
    }
    least = std::min(least, magnitude(M, D, S, low) * magnitude(1, two_zw, w2, low) / w2);
    const double beyond = least_magnitude(M, D, S, low) * least_magnitude(1, two_zw, w2, low) / w2;
    if (beyond >= least) return least;
    if (n + 1 == kCrossings) least = beyond;
    high = (2 * n + 3) * kPi / delay;
  }
  return least;
}

FollowingRobot::FollowingRobot(int n)
    : M(Eigen::MatrixXd::Identity(n, n)),
      B(Eigen::VectorXd::Zero(n)),
      K(B),
      D(B),
      shaping(Eigen::VectorXd::Ones(n)),
      K_P(Eigen::MatrixXd::Zero(n, n)),
      K_D(K_P),
      J(Eigen::MatrixXd::Zero(6, n)),
      J_bar(Eigen::MatrixXd::Zero(n, 6)),
      tau(Eigen::VectorXd::Constant(n, kNone)) {}

ContactSweep::ContactSweep(int n)
    : lu_(n), llt_(n), scaled_(Eigen::MatrixXd::Zero(n, n)), eigen_(n), column_(Eigen::VectorXd::Zero(n)) {
  x_c_.setZero(6, 6);
  for (ComplexMatrix* A : {&q_c_, &tau_w_, &q_}) A->setZero(n, 6);
  for (ComplexMatrix* A : {&gain_, &motors_, &links_}) A->setZero(n, n);
  for (ComplexMatrix* A : {&drive_, &held_, &theta_}) A->setZero(n, n + 6);
  lu_.compute(ComplexMatrix::Identity(n, n));
  llt_.compute(Eigen::MatrixXd::Identity(n, n));
}

// Everything that the controller gets from measurements comes z = e^(−s (delay + step/2)) late. With f along each of the six axes:
//   q_c = z J̄ A⁻¹ f,   A = M s² + D s + S
// Rigid robots:
//   M s² q = Jᵀ f + M s² q_c + (K_P + K_D s)(q_c − z q) − z Jᵀ f
// Elastic joints, κ = K + d s, F = (w/(s + w))², in rigid joints κ = ∞ and F = 1:
//   M s² q = κ (θ − q) + Jᵀ f
//   B s² θ + κ (θ − q) = r u − (r − 1) z K (θ − q)
//   u = (B/r) s² θ_c + τ_w + (K_P + K_D s)(θ_c − z θ),   τ_w = F (M s² q_c − z Jᵀ f),   θ_c = q_c + τ_w/K
void ContactSweep::respond(const FollowingRobot& r, double at) {
  const Index n = r.M.rows();
  const Complex s(0, at), s2 = s * s, z = std::exp(-(r.delay + r.step / 2) * s);
  for (int part = 0; part < 2; ++part) {
    const Impedance& A = part == 0 ? r.translation : r.rotation;
    x_c_.block<3, 3>(3 * part, 3 * part) =
        (s2 * A.M.cast<Complex>() + s * A.D.cast<Complex>() + A.S.cast<Complex>()).inverse() * z;
  }
  q_ = r.J_bar.cast<Complex>();  // scratch, so that no product allocates
  q_c_.noalias() = q_.lazyProduct(x_c_);
  const Complex forward = r.feeds_wrench_forward ? z : Complex(0);
  links_ = s2 * r.M.cast<Complex>();
  tau_w_.noalias() = links_.lazyProduct(q_c_);
  tau_w_ -= forward * r.J.transpose().cast<Complex>();
  gain_ = r.K_P.cast<Complex>() + s * r.K_D.cast<Complex>();
  if ((r.K.array() == 0).all()) {
    q_ = tau_w_ + r.J.transpose().cast<Complex>();
    q_.noalias() += gain_.lazyProduct(q_c_);
    links_ += z * gain_;
  } else {
    constexpr double kStiff = 1e9;  // N.m/rad, of rigid joints among elastic ones
    const Complex smoothed = r.bandwidth / (s + r.bandwidth), F = smoothed * smoothed;
    held_.setZero();
    for (Index i = 0; i < n; ++i) {
      const bool soft = r.K[i] > 0;
      const double K = soft ? r.K[i] : kStiff;
      if (soft) tau_w_.row(i) *= F;
      theta_.row(i).head(6) = q_c_.row(i) + tau_w_.row(i) / K;  // θ_c
      held_(i, i) = K + r.D[i] * s + (r.shaping[i] - 1) * z * K;
    }
    drive_.leftCols(6).noalias() = gain_.lazyProduct(theta_.leftCols(6));
    for (Index i = 0; i < n; ++i) {
      held_.row(i).tail(6) = r.B[i] * s2 * theta_.row(i).head(6) + r.shaping[i] * (tau_w_.row(i) + drive_.row(i).head(6));
      motors_.row(i) = r.shaping[i] * z * gain_.row(i);
      motors_(i, i) += r.B[i] * s2 + held_(i, i);
    }
    lu_.compute(motors_);
    theta_ = lu_.solve(held_);
    q_ = r.J.transpose().cast<Complex>();
    for (Index i = 0; i < n; ++i) {
      const Complex kappa = (r.K[i] > 0 ? r.K[i] : kStiff) + r.D[i] * s;
      links_.row(i) -= kappa * theta_.row(i).head(n);
      links_(i, i) += kappa;
      q_.row(i) += kappa * theta_.row(i).tail(6);
    }
  }
  lu_.compute(links_);
  theta_.leftCols(6) = lu_.solve(q_);
  for (Index k = 0; k < 6; ++k) {
    Complex sum = 0;
    for (Index i = 0; i < n; ++i) sum += r.J(k, i) * theta_(i, k);
    G_[static_cast<std::size_t>(k)] = sum;
  }
}

void ContactSweep::reset() {
  K_e_max.fill(0);
  least.fill(0);
  before.fill(0);
  Omega = 0;
  ratio = 1;
}

bool ContactSweep::advance(const FollowingRobot& robot) {
  const bool first = Omega == 0;
  const double highest = kPi / robot.step;
  const double at = first ? kLowest : std::min(Omega * ratio, highest);
  respond(robot, at);
  double turn = 0;
  if (!first) {
    for (std::size_t k = 0; k < 6; ++k) {
      const Complex last(before[2 * k], before[2 * k + 1]);
      if (G_[k] != 0.0 && last != 0.0) turn = std::max(turn, std::abs(std::arg(-1.0 / G_[k] / last)));
    }
    if (turn > kTurn && ratio > kFinest) {
      ratio = std::max(std::sqrt(ratio), kFinest);
      return false;
    }
  }
  const auto range = [&](double frequency) { return std::tan(std::min(kDelay * robot.step * frequency, 0.5)); };
  const double near = range(at), near_before = range(Omega);
  for (std::size_t k = 0; k < 6; ++k) {
    const Complex last(before[2 * k], before[2 * k + 1]), now = G_[k] == 0.0 ? Complex(0) : -1.0 / G_[k];
    if (first) least[k] = kNone;
    if (now.real() > 0 && std::abs(now.imag()) < near * now.real()) least[k] = std::min(least[k], std::abs(now));
    for (const double side : {-1.0, 0.0, 1.0}) {  // where the phase enters the range, and where it passes −π
      const double from = last.imag() - side * near_before * last.real(), to = now.imag() - side * near * now.real();
      if (first || (from > 0) == (to > 0)) continue;
      const Complex crossing = last + from / (from - to) * (now - last);
      if (crossing.real() > 0) least[k] = std::min(least[k], std::abs(crossing));
    }
    before[2 * k] = now.real();
    before[2 * k + 1] = now.imag();
  }
  if (first) ratio = kCoarsest;
  if (!first && turn < kTurn / 3) ratio = std::min(ratio * ratio, kCoarsest);
  Omega = at;
  if (at < highest) return false;
  finish(robot);
  return true;
}

/// The largest K_e, at most `most`, with which a push of kImpulse along the axis `direction` does not saturate the motors.
double ContactSweep::unsaturated(const FollowingRobot& robot, Index direction, double most) {
  const bool rigid = (robot.K.array() == 0).all();
  const double M = robot.translation.M(direction, direction);
  column_.noalias() = robot.M.lazyProduct(robot.J_bar.col(direction));  // torques of the links for an acceleration of 1
  const auto fits = [&](double K_e) {
    const double omega2 = K_e / M, a = kImpulse / M * std::sqrt(omega2);
    for (Index i = 0; i < column_.size(); ++i) {
      double torque = std::abs(column_[i] + (rigid ? 0 : robot.B[i]) * robot.J_bar(i, direction));
      if (robot.K[i] > 0) {
        const double smoothed = omega2 / (1 + omega2 / (robot.bandwidth * robot.bandwidth));
        torque += robot.B[i] * smoothed * std::abs(column_[i]) / robot.K[i];
      }
      if (a * torque > kTorque * robot.tau[i]) return false;
    }
    return true;
  };
  if (fits(most)) return most;
  double low = 0, high = most;
  constexpr double kExact = 1e-3;
  while (high - low > kExact * most) {
    const double middle = (low + high) / 2;
    (fits(middle) ? low : high) = middle;
  }
  return low;
}

void ContactSweep::finish(const FollowingRobot& robot) {
  const bool rigid = (robot.K.array() == 0).all();
  for (Index i = 0; i < scaled_.rows(); ++i)
    column_[i] = robot.K[i] > 0 ? robot.B[i] / robot.shaping[i] : robot.M(i, i) + (rigid ? 0 : robot.B[i]);
  for (Index i = 0; i < scaled_.rows(); ++i) {
    for (Index j = 0; j < scaled_.rows(); ++j)
      scaled_(i, j) = (robot.K_D(i, j) + robot.K_D(j, i)) / 2 / std::sqrt(std::max(column_[i] * column_[j], 1e-300));
  }
  // Of a rigid robot K_D acts on M itself: the diagonal is its size.
  gain_of_step_ = robot.step * (rigid ? scaled_.diagonal().maxCoeff()
                                      : eigen_.compute(scaled_, Eigen::EigenvaluesOnly).eigenvalues().maxCoeff());
  const double share = kShare * std::max(0.0, 1 - gain_of_step_ / 2);
  llt_.compute(robot.M);
  for (Index k = 0; k < 6; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const Impedance& A = k < 3 ? robot.translation : robot.rotation;
    column_ = robot.J.row(k).transpose();
    const bool rendered = !column_.isZero(0);
    llt_.matrixL().solveInPlace(column_);
    const double mass = 1 / std::max(column_.squaredNorm(), 1e-12);
    const double most = std::min(A.M(k % 3, k % 3), mass) / (robot.step * robot.step);
    K_e_max[i] = rendered ? std::min(share * least[i], most) : 0;
    if (k < 3) K_e_max[i] = unsaturated(robot, k, K_e_max[i]);
  }
  Omega = 0;
}

}  // namespace cotwin::compliance
