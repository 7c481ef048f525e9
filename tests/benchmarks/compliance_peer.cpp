#include "tests/benchmarks/compliance_peer.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <kdl/chaindynparam.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>
#include <kdl/chainjnttojacdotsolver.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "tests/benchmarks/kdl_chain.h"

namespace cotwin::benchmark {
namespace {

constexpr int n = 7;
using Joints = Eigen::Matrix<double, n, 1>;
using Jacobian = Eigen::Matrix<double, 6, n>;
using Mass = Eigen::Matrix<double, n, n>;
using Six = Eigen::Matrix<double, 6, 1>;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

struct At {
  Vector3d p;
  Matrix3d R;
};

class Kdl final : public CompliancePeer {
 public:
  Kdl(const robot::RobotModel& robot, const ComplianceDesign& d)
      : d_(d),
        chain_(kdl_chain(robot)),
        inverse_(chain_, kdl(robot.gravity)),
        parameters_(chain_, kdl(robot.gravity)),
        pose_(chain_),
        jacobian_(chain_),
        jacobian_dot_(chain_),
        no_wrenches_(chain_.getNrOfSegments(), KDL::Wrench::Zero()) {
    // x(h) of M ẍ + D ẋ + S x = f at the aperiodic limit, w = √(S/M): e^(−wh) [1 + wh, h; −w² h, 1 − wh].
    w_T_ = std::sqrt(d.S_T / d.M_T);
    left_ = std::exp(-w_T_ * d.h);
    winding_ = std::exp(-d.bandwidth * d.h);
  }

  void start(const Eigen::VectorXd& q) override {
    q_c = q;
    dq_.setZero();
    ddq_.setZero();
    desired_ = forward(q_c);
    Delta_.setZero();
    dDelta_.setZero();
    Q_dc_.setIdentity();
    w_.setZero();
    p_ = desired_.p;
    Q_ = Quaterniond(desired_.R);
    V_.setZero();
    tau_w_ = inverse_dynamics(q_c, dq_, ddq_);
    dtau_w_.setZero();
    theta_c_ = q_c + tau_w_ / d_.K;
    dtheta_c_.setZero();
  }

  void step(const Six& F, const Eigen::VectorXd& q, const Eigen::VectorXd& theta) override {
    const double h = d_.h;
    const Joints e = theta_c_ - theta, de = dtheta_c_;
    const Joints tau_e = frame_jacobian(q).transpose() * F;

    const Vector3d rest = F.head<3>() / d_.S_T, x = Delta_ - rest;
    Delta_ = rest + left_ * (x * (1 + w_T_ * h) + h * dDelta_);
    dDelta_ = left_ * (dDelta_ * (1 - w_T_ * h) - w_T_ * w_T_ * h * x);
    const Vector3d m = desired_.R.transpose() * F.tail<3>();
    const double D_R = 2 * std::sqrt(d_.K_o * d_.M_R), decay = std::exp(-D_R / d_.M_R * h / 2);
    w_ = decay * w_ + h / 2 * (m - moment()) / d_.M_R;
    const double angle = w_.norm() * h, s = angle > 1e-9 ? std::sin(angle / 2) / angle : 0.5;
    Q_dc_ = Quaterniond(std::cos(angle / 2), s * h * w_.x(), s * h * w_.y(), s * h * w_.z()) * Q_dc_;
    Q_dc_.normalize();
    w_ = decay * w_ + h / 2 * (m - moment()) / d_.M_R;

    const Quaterniond Q_d(desired_.R);
    const Vector3d p = desired_.p + Delta_;
    const Quaterniond Q = Q_d * Q_dc_;
    Six V, A_end;
    V << dDelta_, desired_.R * w_;
    A_end << (F.head<3>() - 2 * std::sqrt(d_.S_T * d_.M_T) * dDelta_ - d_.S_T * Delta_) / d_.M_T,
        desired_.R * (m - D_R * w_ - moment()) / d_.M_R;
    const Six mean = (V - V_) / h;
    const Joints dq_before = dq_;
    move_joints(mean, A_end);
    p_ = p;
    Q_ = Q;
    V_ = V;
    const At end = forward(q_c);
    task_error_ = (p_ - end.p).norm();

    track((dq_ - dq_before) / h, tau_e, e, de, q, theta);
  }

 private:
  Vector3d moment() const {
    const Vector3d eps = Q_dc_.vec();
    return 2 * d_.K_o * Q_dc_.w() * eps;
  }

  void move_joints(const Six& mean, const Six& end) {
    const double h = d_.h;
    const Joints q_mid = q_c + h / 2 * dq_;
    const At X = forward(q_mid);
    const Jacobian J = frame_jacobian(q_mid);
    const Mass M = mass(q_mid);
    const Eigen::LLT<Mass> M_llt(M);
    const Eigen::Matrix<double, n, 6> Y = M_llt.matrixL().solve(J.transpose());
    const Eigen::Matrix<double, 6, 6> A = Y.transpose() * Y, G = J * J.transpose();
    sigma_ = std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>>(G, Eigen::EigenvaluesOnly).eigenvalues()[0]);
    const Eigen::LLT<Eigen::Matrix<double, 6, 6>> A_llt(A);
    KDL::JntArrayVel at(n);
    at.q.data = q_mid;
    at.qdot.data = dq_;
    KDL::Twist drift_kdl;
    jacobian_dot_.JntToJacDot(at, drift_kdl);
    Six drift, error;
    for (int i = 0; i < 6; ++i) drift[i] = drift_kdl[i];
    const Quaterniond turn = Q_ * Quaterniond(X.R).conjugate();
    error << p_ + h / 2 * V_.head<3>() - X.p, 2 * turn.w() * turn.vec() + h / 2 * V_.tail<3>();
    const double K_v = 2 * d_.omega_k, K_p = d_.omega_k * d_.omega_k;
    const Six feedback = K_v * (V_ - J * dq_) + K_p * error - drift;
    const Joints xi = -d_.k_nu * dq_;
    Six r = mean + feedback / (1 + K_v * h / 2) - J * xi;
    A_llt.solveInPlace(r);
    ddq_ = M_llt.matrixU().solve(Joints(Y * r)) + xi;
    q_c += h * dq_ + h * h / 2 * ddq_;
    dq_ += h * ddq_;
    Six rest = end - mean;
    A_llt.solveInPlace(rest);
    ddq_ += M_llt.matrixU().solve(Joints(Y * rest));
  }

  void track(const Joints& a, const Joints& tau_e, const Joints& e, const Joints& de, const Eigen::VectorXd& q,
             const Eigen::VectorXd& theta) {
    const double h = d_.h, w = d_.bandwidth;
    tau_c_ = inverse_dynamics(q_c, dq_, ddq_) - tau_e;
    const Joints q_mid = q_c - h / 2 * dq_ + h * h / 8 * a;
    const Joints wanted = inverse_dynamics(q_mid, dq_ - h / 2 * a, a) - tau_e;
    Mass M = mass(q_mid);
    M.diagonal().array() += d_.B;
    const Joints before = tau_w_, dbefore = dtau_w_, gap = wanted - tau_w_;
    dtau_w_ = winding_ * (dbefore * (1 - w * h) + w * w * h * gap);
    tau_w_ = wanted - winding_ * (gap * (1 + w * h) - h * dbefore);
    const Joints a_theta = a + (dtau_w_ - dbefore) / (h * d_.K);
    theta_c_ = q_c + tau_w_ / d_.K;
    dtheta_c_ = dq_ + dtau_w_ / d_.K;
    const Joints g_c = gravity(q_mid), at = q_mid - e;
    const Joints g = gravity(at - 2 * (gravity(at) - g_c) / d_.K);
    const Joints feedback = g - g_c + d_.omega * d_.omega * (M * e) + 2 * d_.omega * d_.zeta * (M * de);
    const Joints tau_J = d_.K * (theta - q);
    tau_m = d_.B * a_theta + (before + tau_w_) / 2 + feedback + (d_.shaping - 1) * (feedback + before - tau_J);
  }

  At forward(const Joints& q) {
    in_.data = q;
    KDL::Frame X;
    pose_.JntToCart(in_, X);
    At at;
    for (int i = 0; i < 3; ++i) {
      at.p[i] = X.p[i];
      for (int k = 0; k < 3; ++k) at.R(i, k) = X.M(i, k);
    }
    return at;
  }
  Jacobian frame_jacobian(const Joints& q) {
    in_.data = q;
    jacobian_.JntToJac(in_, jac_);
    return jac_.data;
  }
  Mass mass(const Joints& q) {
    in_.data = q;
    parameters_.JntToMass(in_, mass_);
    return mass_.data;
  }
  Joints inverse_dynamics(const Joints& q, const Joints& dq, const Joints& ddq) {
    in_.data = q;
    speed_.data = dq;
    acceleration_.data = ddq;
    inverse_.CartToJnt(in_, speed_, acceleration_, no_wrenches_, out_);
    return out_.data;
  }
  Joints gravity(const Joints& q) {
    in_.data = q;
    parameters_.JntToGravity(in_, out_);
    return out_.data;
  }

  ComplianceDesign d_;
  KDL::Chain chain_;
  KDL::ChainIdSolver_RNE inverse_;
  KDL::ChainDynParam parameters_;
  KDL::ChainFkSolverPos_recursive pose_;
  KDL::ChainJntToJacSolver jacobian_;
  KDL::ChainJntToJacDotSolver jacobian_dot_;
  KDL::Wrenches no_wrenches_;
  KDL::JntArray in_{n}, speed_{n}, acceleration_{n}, out_{n};
  KDL::JntSpaceInertiaMatrix mass_{n};
  KDL::Jacobian jac_{n};
  double w_T_, left_, winding_, sigma_ = 0, task_error_ = 0;
  At desired_;
  Vector3d Delta_, dDelta_, w_, p_;
  Quaterniond Q_dc_, Q_;
  Six V_;
  Joints dq_, ddq_, tau_w_, dtau_w_, theta_c_, dtheta_c_, tau_c_;
};

}  // namespace

std::unique_ptr<CompliancePeer> make_kdl_compliance(const robot::RobotModel& robot, const ComplianceDesign& design) {
  return std::make_unique<Kdl>(robot, design);
}

}  // namespace cotwin::benchmark
