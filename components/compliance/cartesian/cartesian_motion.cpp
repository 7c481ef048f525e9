#include "components/compliance/cartesian/cartesian_motion.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <utility>

#include "components/compliance/cartesian/directions.h"
#include "components/compliance/cartesian/frame/variable_stiffness.h"
#include "components/compliance/joints/views.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// The unit quaternion with η ≥ 0 (the rule for η = 0: the first value that is not 0 is positive), so that Q and −Q give the same bits.
Quaterniond orientation(const std::array<double, 4>& values, const std::string& place, const char* name) {
  const Quaterniond Q = quaternion(values);
  const double length = Q.norm();
  if (!(std::isfinite(length) && length > 1e-6)) {
    throw Error(place + "." + name, "the quaternion (w, x, y, z) has length " + text::to_text(length, 6) +
                                        ", expected 1 (a length > 1e-6 is scaled)");
  }
  double sign = 1;
  for (const double value : values) {
    if (value == 0) continue;
    sign = value < 0 ? -1 : 1;
    break;
  }
  return Quaterniond(Q.coeffs() * (sign / length));
}

Matrix3d projector(const std::vector<int>& directions, int first) {
  Matrix3d P = Matrix3d::Zero();
  for (const int i : directions) {
    if (i >= first && i < first + 3) P(i - first, i - first) = 1;
  }
  return P;
}

/// The impedance of the rendered directions, with rest and unit mass in the others.
Impedance restricted(const Impedance& z, const Matrix3d& P) {
  const Matrix3d rest = Matrix3d::Identity() - P;
  return {P * z.M * P + rest, P * z.D * P, P * z.S * P};
}

struct Notice {
  std::int32_t what;
  std::string_view text;
};
constexpr Notice kNotices[] = {
    {1, "the least singular value of the Jacobian was below sigma_0: the joints were damped (outputs sigma_min, lambda)"},
    {2, "the joints did not follow the compliant frame by more than 1 mm (output task_error): out of reach or at a limit"},
    {4,
     "a change of M_T, S_T, M_R or K_o had to wait: the tank lacked the energy (tank_start, tank_max) or it was too fast for "
     "alpha"},
    {8, "the moment exceeded the least rotational stiffness K_o, which balances at most that moment: the frame turns on"},
    {16, "the robot did not start at the desired pose: the compliant frame started where the robot was, and went back"},
    {32, "a lower task could not be done beside the higher ones (outputs task_sigma, task_residual)"},
    {64,
     "S_T or K_o is close to the stiffness of the joints (output stiffness_ratio above 0.8): the links are softer than asked"},
    {128, "the static position of the links was not found (output static_error): the joints are too soft for the load"},
    {256,
     "the environment's stiffness K_e is above K_e_max, so the contact can vibrate: choose a larger M_T, M_R or damping, or "
     "render=impedance"},
    {512, "the compliant frame was stopped at p_min or p_max or held at v_max or w_max"},
    {1024,
     "the gains of tracking are too large for the step, so the motors vibrate (K_e_max is 0): choose a smaller omega, K_s or "
     "shaping, a shorter step or delay, or give D if the gears are damped"},
    {2048,
     "S_T or K_o is above 0.35 of the stiffness of the joints (output stiffness_ratio): the gears let the frame overshoot by "
     "more than 2 %, also "
     "with zeta_T = zeta_R = 1"}};
constexpr std::string_view kNoticeSeparator = "; ";

}  // namespace

void CartesianMotion::declare_settings(SettingList& s) {
  s.text("frame", "",
         "space=cartesian: link or frame of the robot that carries the compliance frame E; empty: the end-effector");
  s.choice("axes", {"world", "desired", "tool"}, "space=cartesian: axes of the matrices of translation and of their deviation");
  s.choice("rotation", {"quaternion", "log"},
           "space=cartesian: potential of rotation, from the quaternion (k sin phi, the paper's) or the angle (k phi)");
  s.choice("wrench", {"sensor", "joints"},
           "space=cartesian: the wrench at E from the ports f_e, m_e or from the external joint torques tau_e");
  s.choice("desired", {"pose", "joints"},
           "space=cartesian: the desired motion of E from p_d, quat_d, … or from the joint motion q_d");
  s.text(
      "sensor", "",
      "space=cartesian: link or frame of a force sensor that measures f_s, m_s in its axes; empty: the wrench is given at E");
  s.text("task", "", "space=cartesian: the rendered directions in the base's axes, some of x,y,z,rx,ry,rz; empty: all six");
  SelfMotion::declare_settings(s);
  s.choice("render", {"admittance", "impedance"},
           "space=cartesian: motion from the measured wrench, which is tracked, or motor torques from the deviation, without a "
           "measured wrench; the latter is stable on any environment");
}

CartesianMotion::CartesianMotion(Settings& settings, const robot::RobotModel& robot)
    : place_(settings.unit()),
      desired_joints_(settings.choice("desired") == "joints"),
      wrench_of_joints_(settings.choice("wrench") == "joints"),
      axes_(text::choose<Axes>(settings.unit(), settings.choice("axes"),
                               {{"world", Axes::kWorld}, {"desired", Axes::kDesired}, {"tool", Axes::kTool}})),
      potential_(settings.choice("rotation") == "log" ? Potential::kLog : Potential::kQuaternion),
      frame_([&] {
        const std::string name = settings.text("frame");
        return robot::on_body(name.empty() ? robot.end_effector() : robot.frame(name));
      }()),
      sensor_(!settings.text("sensor").empty()),
      S_(sensor_ ? robot::on_body(robot.frame(settings.text("sensor"))) : robot::FrameOnBody{}),
      gravity_(robot.gravity),
      directions_(rendered_directions(place_, settings.text("task"), robot, frame_)),
      P_T_(projector(directions_, 0)),
      P_R_(projector(directions_, 3)),
      self_motion_(settings, robot, directions_, wrench_of_joints_),
      joints_(robot, self_motion_),
      sampled_loop_(robot.n()),
      contact_(robot.n()),
      following_(robot.n()),
      sampled_(robot.n()),
      shaping_scratch_(static_cast<std::size_t>(robot.n())) {
  const Index n = robot.n();
  for (VectorXd* v : {&q_scratch_, &dq_scratch_, &ddq_scratch_, &tau_scratch_}) v->setZero(n);
  J_.setZero(6, n);
  J_S_.setZero(6, n);
  if (sensor_ && wrench_of_joints_) throw Error(place_, "sensor= with wrench=joints: expected one of them");
  if (settings.choice("render") == "impedance") {
    bool lower = false;
    for (const TaskEntry& task : self_motion_.tasks()) {
      if (lower && !task.held) {
        throw Error(place_,
                    "render=impedance, setting tasks: '" + task.name +
                        "' is below a held frame, expected all directions of E above the held frames, because the wrench "
                        "of its springs acts without regard to other tasks");
      }
      lower = lower || task.held;
    }
    impedance_ = std::make_unique<ImpedanceControl>(robot, directions_);
    impedance_self_motion_ = std::make_unique<ImpedanceSelfMotion>(robot, self_motion_);
    impedance_limits_ = std::make_unique<ImpedanceLimits>(n);
  }
  contact_total_.setZero(n, n);
}

void CartesianMotion::update_frames() {
  const Quaterniond Q_FE = orientation(quat_FE_, place_, "quat_FE");
  joints_.set_frame({frame_.body, frame_.X_BF * Pose{Q_FE.toRotationMatrix(), vector(p_FE_)}});
  Q_WB_ = orientation(quat_WB_, place_, "quat_WB");
  X_WB_ = {Q_WB_.toRotationMatrix(), vector(p_WB_)};
}

void CartesianMotion::check(const std::string& place) {
  self_motion_.check(place);
  settled_ = same(in_force_, wanted_, kCartesian);
  if (settled_ && in_force_is_checked_) return;
  if (!is_checked_ || wanted_ != checked_) {
    check_values(wanted_, kCartesian, place);
    check_definite(wanted_, place);
    checked_ = wanted_;
    is_checked_ = true;
  }
  in_force_is_checked_ = in_force_is_checked_ || settled_;
}

JointMotionGains CartesianMotion::gains() const {
  return {in_force_.omega_k[0], in_force_.sigma_0[0], in_force_.lambda_0[0], in_force_.k_nu[0]};
}

Matrix3d CartesianMotion::axes(const Quaterniond& Q_d, const Quaterniond& Q_c) const {
  if (axes_ == Axes::kWorld) return X_WB_.R.transpose();
  return (axes_ == Axes::kDesired ? Q_d : Q_c).toRotationMatrix();
}

CartesianMotion::Motion CartesianMotion::desired(LinkDynamics& links, const FromJoints& in) {
  Motion d;
  if (desired_joints_) {
    q_scratch_ = map(in.q_d);
    dq_scratch_ = map(in.dq_d);
    const Pose X = links.jacobian(q_scratch_, joints_.frame(), J_);
    d.pose.p = X.p;
    d.pose.Q = Quaterniond(X.R);
    d.pose.V.noalias() = J_ * dq_scratch_;
    links.jacobian_dot_times_dq(q_scratch_, dq_scratch_, joints_.frame(), d.acceleration);
    d.acceleration.noalias() += J_ * map(in.ddq_d);
    return d;
  }
  const std::pair<const char*, const Three*> ports[] = {
      {"p_d", &p_d_}, {"v_d", &v_d_}, {"w_d", &w_d_}, {"dv_d", &dv_d_}, {"dw_d", &dw_d_}};
  for (const auto& [name, values] : ports) {
    if (!vector(*values).allFinite()) throw Error(place_ + "." + name, "is not finite, expected three finite values");
  }
  const Matrix3d R_BW = X_WB_.R.transpose();
  d.pose.p = R_BW * (vector(p_d_) - X_WB_.p);
  d.pose.Q = Q_WB_.conjugate() * orientation(quat_d_, place_, "quat_d");
  d.pose.V << R_BW * vector(v_d_), R_BW * vector(w_d_);
  d.acceleration << R_BW * vector(dv_d_), R_BW * vector(dw_d_);
  return d;
}

void CartesianMotion::update_wrench(LinkDynamics& links, const FromJoints& in, std::vector<double>& tau,
                                    std::vector<double>& rate) {
  q_scratch_ = map(in.q);
  const Pose X = links.jacobian(q_scratch_, joints_.frame(), J_);
  const Quaterniond Q(X.R);
  p_q_ = array(Vector3d(X_WB_ * X.p));
  const Quaterniond Q_WE = Q_WB_ * Q, Q_W = Q_WB_ * quaternion(quat_before_);
  quat_q_ = array(Quaterniond(Q_WE.dot(Q_W) < 0 ? Quaterniond(-Q_WE.coeffs()) : Q_WE));
  const Quaterniond Q_dq = quaternion(quat_d_before_).conjugate() * Q;
  epsilon_q_ = array(Vector3d((Q_dq.w() < 0 ? -1 : 1) * Q_dq.vec()));
  if (wrench_of_joints_) {
    F_ = joints_.wrench_of(links, map(in.tau_e), gains());
    dF_ = joints_.wrench_of(links, map(in.tau_e_rate), gains());
    return;
  }
  const Vector3d f = vector(f_e_), m = vector(m_e_), df = vector(f_rate_), dm = vector(m_rate_);
  if (!f.allFinite()) throw Error(place_ + (sensor_ ? ".f_s" : ".f_e"), "is not finite, expected three finite values");
  if (!m.allFinite()) throw Error(place_ + (sensor_ ? ".m_s" : ".m_e"), "is not finite, expected three finite values");
  if (sensor_) {
    const Pose X_S = links.forward_kinematics(q_scratch_, S_);
    const Vector3d arm = X_S.p - X.p;
    const Wrench tool = inertia_of_tool(links, X_S);
    F_ << X_S.R * f, X_S.R * m;
    F_ -= tool;
    F_.tail<3>() += arm.cross(F_.head<3>());
    dF_ << X_S.R * df, X_S.R * dm;
    dF_.tail<3>() += arm.cross(dF_.head<3>());
  } else {
    const Matrix3d R_BW = X_WB_.R.transpose();
    F_ << R_BW * f, R_BW * m;
    dF_ << R_BW * df, R_BW * dm;
  }
  const auto n = static_cast<Index>(tau.size());
  Eigen::Map<VectorXd>(tau.data(), n).noalias() = J_.transpose().lazyProduct(F_);
  Eigen::Map<VectorXd>(rate.data(), n).noalias() = J_.transpose().lazyProduct(dF_);
}

/// Weight less inertia of what is mounted behind the sensor, in B about the sensor's origin, as the compliant motion moves it.
Wrench CartesianMotion::inertia_of_tool(LinkDynamics& links, const Pose& X_S) {
  Wrench w = Wrench::Zero();
  if (tool_mass_ == 0) return w;
  Twist a;
  links.jacobian(joints_.q, S_, J_S_);
  links.jacobian_dot_times_dq(joints_.q, joints_.dq, S_, a);
  a += J_S_ * joints_.ddq;
  const Twist V = J_S_ * joints_.dq;
  const Vector3d r = X_S.R * vector(tool_centre_), omega = V.tail<3>();
  const Vector3d acceleration = a.head<3>() + a.tail<3>().cross(r) + omega.cross(omega.cross(r));
  w.head<3>() = tool_mass_ * (gravity_ - acceleration);
  w.tail<3>() = r.cross(w.head<3>());
  return w;
}

/// The part of a wrench that the task renders.
Wrench CartesianMotion::rendered(const Wrench& F) const {
  Wrench part;
  part << P_T_ * F.head<3>(), P_R_ * F.tail<3>();
  return part;
}

void CartesianMotion::prepare(const Matrix3d& R_BA, const Matrix3d& R_d, double h) {
  if (!is_prepared_ || !(settled_ || prepared_ == in_force_)) {
    translation_ = translation_of(in_force_);
    rotation_ = rotation_of(in_force_);
    k_min_ = numerics::symmetric_eigenvalues<3>(rotation_.S)[0];
    rendered_T_ = translation_;
    rendered_R_ = rotation_;
    inverse_M_T_ = rendered_T_.M.inverse();
    inverse_M_R_ = rendered_R_.M.inverse();
    prepared_ = in_force_;
    is_prepared_ = true;
  }
  if (P_T_ != Matrix3d::Identity()) {
    rendered_T_ = restricted(translation_, R_BA.transpose() * P_T_ * R_BA);
    inverse_M_T_ = rendered_T_.M.inverse();
  }
  if (P_R_ != Matrix3d::Identity()) {
    rendered_R_ = restricted(rotation_, R_d.transpose() * P_R_ * R_d);
    inverse_M_R_ = rendered_R_.M.inverse();
  }
  if (h <= 0) return;
  propagator_.prepare(rendered_T_, h);
  rotation_step_.prepare(rendered_R_, h);
}

/// The moment of (3b) in the axes of the desired frame. A spring fixed to the tool is moved by the force at p_c, whose moment
/// about p_d is x × f, x = p_c − p_d.
Vector3d CartesianMotion::moment_in_desired(const Matrix3d& R_d, const Wrench& F, const Vector3d& x) const {
  const Vector3d m = F.tail<3>();
  if (axes_ != Axes::kTool) return R_d.transpose() * m;
  return R_d.transpose() * (m + P_R_ * x.cross(F.head<3>()));
}

/// The motion of the compliant frame for the deviation in force.
CartesianMotion::Motion CartesianMotion::compliant(const Motion& d, const Wrench& F) {
  const Quaterniond Q_dc = quaternion(quat_dc_);
  const Matrix3d R_d = d.pose.Q.toRotationMatrix();
  const Vector3d w_d = d.pose.V.tail<3>(), dw_d = d.acceleration.tail<3>();
  Motion c;
  c.pose.Q = (d.pose.Q * Q_dc).normalized();
  const Vector3d w = R_d * w_dc_;
  const Matrix3d R = axes(d.pose.Q, c.pose.Q);
  const Vector3d x = R * Delta_, dx = R * dDelta_;
  const Vector3d m = moment_in_desired(R_d, F, x);
  const Vector3d moment = elastic_moment(potential_, rendered_R_.S, Q_dc);
  const Vector3d dw_dc = inverse_M_R_ * (m - rendered_R_.D * w_dc_ - moment);
  c.pose.V.tail<3>() = w_d + w;
  c.acceleration.tail<3>() = dw_d + R_d * dw_dc + w_d.cross(w);

  Vector3d turn = Vector3d::Zero(), dturn = Vector3d::Zero();  // of the axes
  if (axes_ != Axes::kWorld) {
    turn = axes_ == Axes::kDesired ? w_d : Vector3d(c.pose.V.tail<3>());
    dturn = axes_ == Axes::kDesired ? dw_d : Vector3d(c.acceleration.tail<3>());
  }
  const Vector3d ddDelta = inverse_M_T_ * (R.transpose() * F.head<3>() - rendered_T_.D * dDelta_ - rendered_T_.S * Delta_);
  c.pose.p = d.pose.p + x;
  c.pose.V.head<3>() = d.pose.V.head<3>() + turn.cross(x) + dx;
  c.acceleration.head<3>() =
      d.acceleration.head<3>() + dturn.cross(x) + turn.cross(turn.cross(x)) + 2 * turn.cross(dx) + R * ddDelta;
  return c;
}

void CartesianMotion::start(LinkDynamics& links, const FromJoints& in) {
  update_frames();
  in_force_ = wanted_;
  in_force_is_checked_ = true;
  is_prepared_ = false;
  met_ = 0;
  contact_turn_ = 0;
  gears_undamped_ = follower_vibrates_ = 0;
  checked_step_ = delay_border_ = shaping_border_ = stiffness_border_ = 0;
  contact_.reset();
  tank_ = std::min(tank_start_, tank_max_);
  const Motion d = desired(links, in);
  q_scratch_ = map(in.q);
  const Pose X = links.forward_kinematics(q_scratch_, joints_.frame());
  const Matrix3d R_d = d.pose.Q.toRotationMatrix();
  const Vector3d phi = R_d.transpose() * P_R_ * R_d * axis_angle(d.pose.Q.conjugate() * Quaterniond(X.R));
  const Quaterniond Q_dc = quaternion_of(phi);
  quat_dc_ = array(Q_dc);
  w_dc_.setZero();
  const Matrix3d R = axes(d.pose.Q, d.pose.Q * Q_dc);
  Delta_ = R.transpose() * P_T_ * (X.p - d.pose.p);
  dDelta_.setZero();
  if (Delta_.norm() > 1e-6 || phi.norm() > 1e-6) note(kStart);
  prepare(R, R_d, 0);
  Motion c = compliant(d, Wrench::Zero());
  if ((Q_WB_ * c.pose.Q).w() < 0) c.pose.Q.coeffs() *= -1;
  p_before_ = c.pose.p;
  quat_before_ = array(c.pose.Q);
  V_before_ = c.pose.V;
  quat_d_before_ = array(d.pose.Q);
  self_motion_.start(links, q_scratch_);
  joints_.start(links, q_scratch_, c.pose.V, gains());
  write_outputs(links, c.pose);
}

void CartesianMotion::follow(double remaining, double h) {
  warnings_changed_ = false;
  self_motion_.follow(remaining);
  if (settled_) return;
  towards_ = wanted_;
  const bool bound = alpha_ > 0 && h > 0;
  const Quaterniond Q_dc = quaternion(quat_dc_);
  bool paid_T = true, paid_R = true;
  if (bound) {
    paid_T = change_slowly(in_force_, wanted_, remaining, alpha_, h, rate_of(potential_, Q_dc));
    keep_slow(in_force_, towards_);
  }
  cotwin::follow(in_force_, towards_, kCartesian, remaining);
  const Vector3d turn = potential_ == Potential::kQuaternion ? Vector3d(2 * Q_dc.vec()) : axis_angle(Q_dc);
  Tank tank{tank_, tank_max_};
  if (!bound) paid_T = change(in_force_, wanted_, kTranslation, remaining, {Delta_, dDelta_}, tank);
  if (!bound) paid_R = change(in_force_, wanted_, kRotation, remaining, {turn, w_dc_}, tank);
  if (!paid_T || !paid_R) note(kTank);
  tank_ = tank.energy;
}

void CartesianMotion::advance(LinkDynamics& links, const FromJoints& in, std::span<const Limits> limits, double h) {
  const Motion d = desired(links, in);
  const Wrench F0 = rendered(F_), F1 = rendered(F_ + h * dF_);
  const Quaterniond Q_d0 = quaternion(quat_d_before_), Q_c0 = quaternion(quat_before_);
  const Matrix3d R_d0 = Q_d0.toRotationMatrix(), R_d1 = d.pose.Q.toRotationMatrix();
  prepare(axes(d.pose.Q, Q_c0), R_d1, h);

  // Rotation, in the axes of the desired frame.
  const Vector3d x = Q_c0 * (Delta_ + h / 2 * dDelta_);
  const Vector3d m0 = moment_in_desired(R_d0, F0, x), m1 = moment_in_desired(R_d1, F1, x);
  if (potential_ == Potential::kQuaternion && k_min_ > 0 && std::max(m0.norm(), m1.norm()) > k_min_) note(kRunsAway);
  const Turn turn_before{quaternion(quat_dc_), w_dc_};
  const Turned turned = rotation_step_.advance(potential_, turn_before, m0, (m1 - m0) / h);
  quat_dc_ = array(turned.turn.Q);
  w_dc_ = turned.turn.w;

  // Translation, in its axes.
  const Matrix3d R0 = axes(Q_d0, Q_c0), R1 = axes(d.pose.Q, d.pose.Q * turned.turn.Q);
  const Vector3d u0 = R0.transpose() * F0.head<3>(), u1 = R1.transpose() * F1.head<3>();
  const Vector3d Delta_before = Delta_, dDelta_before = dDelta_;
  propagator_.advance(Delta_, dDelta_, u0, (u1 - u0) / h);
  const Vector3d way = Delta_ - Delta_before;
  // A lower bound of the energy that damping takes, as in admittance.cpp.
  tank_ = std::min(tank_ + turned.dissipated + way.dot(rendered_T_.D * way) / h, tank_max_);
  Wrench mean;
  mean << (u0 + u1) / 2, (m0 + m1) / 2;
  const bool confined = confine_frame(d, turn_before, Delta_before, dDelta_before, mean, h);

  Motion c = compliant(d, F1);
  if (c.pose.Q.dot(Q_c0) < 0) c.pose.Q.coeffs() *= -1;  // ±Q without a jump
  const MovingPose before{p_before_, Q_c0, V_before_};
  if (confined) c.acceleration = (c.pose.V - V_before_) / h;
  if (wrench_of_joints_) tau_scratch_ = map(in.tau_e) + h / 2 * map(in.tau_e_rate);
  Posture posture{q_scratch_, dq_scratch_, ddq_scratch_};
  if (desired_joints_) {
    q_scratch_ = map(in.q_d);
    dq_scratch_ = map(in.dq_d);
    ddq_scratch_ = map(in.ddq_d);
  }
  joints_.advance(links, before, c.pose, c.acceleration, tau_scratch_, desired_joints_ ? &posture : nullptr, limits, gains(),
                  h);
  hold_frame_at_joints(links, d, c);
  p_before_ = c.pose.p;
  quat_before_ = array(c.pose.Q);
  V_before_ = c.pose.V;
  quat_d_before_ = array(d.pose.Q);
  write_outputs(links, c.pose);
}

void CartesianMotion::write_outputs(LinkDynamics& links, const MovingPose& c) {
  const Matrix3d& R_WB = X_WB_.R;
  p_c_ = array(Vector3d(X_WB_ * c.p));
  const Quaterniond Q = Q_WB_ * c.Q;
  quat_c_ = array(Q);
  v_c_ = array(Vector3d(R_WB * c.V.head<3>()));
  w_c_ = array(Vector3d(R_WB * c.V.tail<3>()));
  const Quaterniond Q_d = c.Q * quaternion(quat_dc_).conjugate();
  Delta_p_ = array(Vector3d(R_WB * (axes(Q_d, c.Q) * Delta_)));
  epsilon_ = {quat_dc_[1], quat_dc_[2], quat_dc_[3]};
  sigma_min_ = joints_.sigma_min;
  lambda_ = joints_.lambda;
  if (lambda_ > 0) note(kSingular);
  const Pose X = links.forward_kinematics(joints_.q, joints_.frame());
  const Vector3d e_p = P_T_ * (c.p - X.p), e_r = P_R_ * axis_angle(c.Q * Quaterniond(X.R).conjugate());
  task_error_ = std::sqrt(e_p.squaredNorm() + JointMotion::kLength * JointMotion::kLength * e_r.squaredNorm());
  if (task_error_ > 1e-3) note(kTask);
  if (self_motion_.contradicts(in_force_.sigma_0[0])) note(kContradiction);
}

void CartesianMotion::restored() {
  update_frames();
  is_prepared_ = in_force_is_checked_ = settled_ = false;
}

void CartesianMotion::note(WarningBit what) {
  if ((met_ & what) != 0) return;
  met_ |= what;
  warnings_changed_ = true;
}

std::size_t CartesianMotion::longest_warning() {
  std::size_t length = 0;
  for (const Notice& s : kNotices) length += s.text.size() + kNoticeSeparator.size();
  constexpr std::size_t kOfSampling = 512;
  return length + kOfSampling;
}

void CartesianMotion::append_warning(std::string& warning) const {
  for (const Notice& s : kNotices) {
    if ((met_ & s.what) == 0) continue;
    if (!warning.empty()) warning += kNoticeSeparator;
    warning += s.text;
  }
  if ((met_ & kSampling) == 0) return;
  if (!warning.empty()) warning += kNoticeSeparator;
  append_sampling(warning);
}

}  // namespace cotwin::compliance
