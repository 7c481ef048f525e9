#include "tests/components/io/fri/messages.h"

#include <cmath>

namespace cotwin::testing {

using namespace fri;
using M = Monitoring;
using C = Command;

namespace {

bool quaternions(Protocol p) { return p >= Protocol::kSunrise2_5; }

}  // namespace

std::uint32_t monitoring_fields(Protocol protocol, SessionState state) {
  if (protocol == Protocol::kLwr) {
    return M::kMeasuredPosition | M::kMeasuredTorque | M::kCommandedPosition | M::kExternalTorque | M::kInterpolatorPosition |
           M::kMeasuredPose | M::kCommandedPose | M::kInterpolatorPose | M::kExternalWrench | M::kTime | M::kControlMode |
           M::kDriveStates | M::kDynamics;
  }
  std::uint32_t fields = M::kMeasuredPosition | M::kMeasuredTorque | M::kCommandedTorque | M::kExternalTorque | M::kTime |
                         M::kSafetyState | M::kOperationMode | M::kControlMode | M::kDriveStates;
  if (!quaternions(protocol)) fields |= M::kCommandedPosition;
  if (quaternions(protocol)) fields |= M::kMeasuredPose | M::kMeasuredRedundancy;
  if (protocol == Protocol::kSunrise2_7) fields |= M::kExternalWrench;
  if (is_commanding(state)) {
    fields |= M::kInterpolatorPosition | M::kCommandMode | M::kOverlay | M::kTracking;
    if (quaternions(protocol)) fields |= M::kInterpolatorPose | M::kInterpolatorRedundancy;
  }
  return fields;
}

std::uint32_t command_fields(Protocol protocol) {
  if (protocol == Protocol::kLwr) {
    return C::kPosition | C::kPose | C::kTorque | C::kWrench | C::kJointStiffness | C::kJointDamping | C::kCartesianStiffness |
           C::kCartesianDamping;
  }
  return C::kPosition | C::kTorque | C::kWrench | (quaternions(protocol) ? C::kPose | C::kRedundancy : 0u);
}

Monitoring RandomMessages::monitoring() {
  const bool lwr = protocol_ == Protocol::kLwr;
  Monitoring m;
  m.counter = counter();
  m.reflected = counter();
  m.joints = static_cast<std::uint32_t>(joints_);
  m.quality = static_cast<Quality>(natural(4));
  m.state = static_cast<SessionState>(natural(5));
  if (lwr) {
    m.state = natural(2) == 0               ? SessionState::kCommandingActive
              : m.quality >= Quality::kGood ? SessionState::kMonitoringReady
                                            : SessionState::kMonitoringWait;
  }
  m.fields = lwr ? monitoring_fields(protocol_, m.state) : word() & monitoring_fields(protocol_, m.state);
  m.send_period = lwr ? real(0.001, 0.1) : natural(101) * 1e-3;
  m.receive_multiplier = lwr ? 1 : 1 + natural(5);
  m.command_period = lwr ? real(0.001, 0.1) : m.send_period * m.receive_multiplier;
  m.time = lwr ? std::int64_t{natural(256)} * 1'953'125
               : std::int64_t{natural(4'000'000'000)} * 1'000'000'000 + natural(1'000'000'000);
  m.safety = static_cast<SafetyState>(natural(4));
  m.operation = static_cast<OperationMode>(natural(3));
  m.control = static_cast<ControlMode>(natural(4));
  for (std::size_t i = 0; i < joints_; ++i) m.drives[i] = static_cast<DriveState>(lwr ? 2 * natural(2) : natural(3));
  m.command_mode = static_cast<ClientCommandMode>(natural(quaternions(protocol_) ? 5 : 4));
  m.overlay = static_cast<OverlayType>(natural(3));
  m.tracking_performance = real(0, 1);
  for (Joints* values :
       {&m.q_measured, &m.q_commanded, &m.q_interpolator, &m.tau_measured, &m.tau_commanded, &m.tau_external}) {
    *values = joints();
  }
  for (Pose* X : {&m.X_measured, &m.X_commanded, &m.X_interpolator}) *X = pose();
  m.redundancy_measured = {static_cast<std::int32_t>(word()), real()};
  m.redundancy_interpolator = {4, real()};
  m.F_external = wrench();
  if (!lwr) {
    for (std::uint32_t n = natural(3); n > 0; --n) *m.transformations.add() = transformation();
    if (protocol_ != Protocol::kSunrise1_11) {
      for (std::uint32_t n = natural(4); n > 0; --n) *m.ios.add() = io();
    }
    return m;
  }
  m.krl = krl();
  m.safety_factor = real();
  m.answer_rate = real();
  m.miss_rate = real();
  m.latency = real();
  m.jitter = real();
  m.misses = word();
  m.errors = static_cast<std::uint16_t>(word());
  m.warnings = static_cast<std::uint16_t>(word());
  for (double& value : m.temperature) value = real();
  for (double& value : m.jacobian) value = real();
  for (double& value : m.mass) value = real();
  for (double& value : m.gravity) value = real();
  return m;
}

Command RandomMessages::command() {
  Command c;
  c.counter = counter();
  c.reflected = counter();
  c.joints = static_cast<std::uint32_t>(joints_);
  c.fields = word() & command_fields(protocol_);
  c.q = joints();
  c.tau = joints();
  c.F = wrench();
  c.X = pose();
  c.redundancy = {0, real()};
  c.joint_stiffness = joints();
  c.joint_damping = joints();
  c.cartesian_stiffness = wrench();
  c.cartesian_damping = wrench();
  if (protocol_ == Protocol::kLwr) {
    c.krl = krl();
    return c;
  }
  for (std::uint32_t n = natural(4); n > 0; --n) *c.transformations.add() = transformation();
  if (protocol_ != Protocol::kSunrise1_11) {
    for (std::uint32_t n = natural(4); n > 0; --n) *c.ios.add() = io();
  }
  return c;
}

namespace {

/// Collects the names of what differs.
class Comparison {
 public:
  explicit Comparison(Protocol protocol) : lwr_(protocol == Protocol::kLwr) {}

  template <class T>
  void equal(const char* name, const T& a, const T& b) {
    if (!(a == b)) add(name);
  }
  void near(const char* name, double a, double b, double tolerance) {
    if (!(std::abs(a - b) <= tolerance)) add(name);
  }
  void joints(const char* name, const Joints& a, const Joints& b, std::size_t n, double tolerance = 0) {
    for (std::size_t i = 0; i < n; ++i) near(name, a[i], b[i], tolerance);
  }
  // A single float has 24 bits: 2⁻²⁴ · 4 of a number below 4 or the sum of two. The rotation goes through a quaternion, and the
  // position through millimetres: a few ulp.
  void pose(const char* name, const Pose& a, const Pose& b) {
    const double tolerance = lwr_ ? 1e-6 : 4e-15;
    near(name, (a.R - b.R).cwiseAbs().maxCoeff(), 0, tolerance);
    near(name, (a.p - b.p).cwiseAbs().maxCoeff(), 0, tolerance);
  }
  template <class Values>
  void transformations(const Values& a, const Values& b) {
    equal("number of transformations", a.count, b.count);
    if (a.count != b.count) return;
    for (std::size_t i = 0; i < a.count; ++i) {
      equal("name", a.values[i].name, b.values[i].name);
      equal("time", a.values[i].time, b.values[i].time);
      pose("transformation", a.values[i].pose, b.values[i].pose);
    }
  }
  template <class Values>
  void ios(const Values& a, const Values& b) {
    equal("number of I/O values", a.count, b.count);
    if (a.count != b.count) return;
    for (std::size_t i = 0; i < a.count; ++i) equal("I/O value", a.values[i], b.values[i]);
  }
  const std::string& text() const { return text_; }

 private:
  void add(const char* name) { text_ += (text_.empty() ? "" : ", ") + std::string(name); }

  bool lwr_;
  std::string text_;
};

}  // namespace

std::string difference(Protocol protocol, const Monitoring& a, const Monitoring& b) {
  Comparison c(protocol);
  const std::size_t n = a.joints;
  c.equal("fields", a.fields, b.fields);
  c.equal("counter", a.counter, b.counter);
  c.equal("reflected", a.reflected, b.reflected);
  c.equal("joints", a.joints, b.joints);
  c.equal("state", a.state, b.state);
  c.equal("quality", a.quality, b.quality);
  c.near("send_period", a.send_period, b.send_period, 1e-15);
  c.equal("receive_multiplier", a.receive_multiplier, b.receive_multiplier);
  c.near("command_period", a.command_period, b.command_period, 1e-15);
  const double sum = protocol == Protocol::kLwr ? 1e-6 : 0;
  if (a.has(M::kTime)) c.equal("time", a.time, b.time);
  if (a.has(M::kSafetyState)) c.equal("safety", a.safety, b.safety);
  if (a.has(M::kOperationMode)) c.equal("operation", a.operation, b.operation);
  if (a.has(M::kControlMode)) c.equal("control", a.control, b.control);
  if (a.has(M::kDriveStates)) c.equal("drives", a.drives, b.drives);
  if (a.has(M::kCommandMode)) c.equal("command_mode", a.command_mode, b.command_mode);
  if (a.has(M::kOverlay)) c.equal("overlay", a.overlay, b.overlay);
  if (a.has(M::kTracking)) c.equal("tracking", a.tracking_performance, b.tracking_performance);
  if (a.has(M::kMeasuredPosition)) c.joints("q_measured", a.q_measured, b.q_measured, n);
  if (a.has(M::kCommandedPosition)) c.joints("q_commanded", a.q_commanded, b.q_commanded, n, sum);
  if (a.has(M::kInterpolatorPosition)) c.joints("q_interpolator", a.q_interpolator, b.q_interpolator, n);
  if (a.has(M::kMeasuredTorque)) c.joints("tau_measured", a.tau_measured, b.tau_measured, n);
  if (a.has(M::kCommandedTorque)) c.joints("tau_commanded", a.tau_commanded, b.tau_commanded, n);
  if (a.has(M::kExternalTorque)) c.joints("tau_external", a.tau_external, b.tau_external, n);
  if (a.has(M::kMeasuredPose)) c.pose("X_measured", a.X_measured, b.X_measured);
  if (a.has(M::kCommandedPose)) c.pose("X_commanded", a.X_commanded, b.X_commanded);
  if (a.has(M::kInterpolatorPose)) c.pose("X_interpolator", a.X_interpolator, b.X_interpolator);
  if (a.has(M::kMeasuredRedundancy)) c.equal("redundancy", a.redundancy_measured, b.redundancy_measured);
  if (a.has(M::kInterpolatorRedundancy)) c.equal("ipo redundancy", a.redundancy_interpolator, b.redundancy_interpolator);
  if (a.has(M::kExternalWrench)) c.equal("F_external", a.F_external, b.F_external);
  c.transformations(a.transformations, b.transformations);
  c.ios(a.ios, b.ios);
  if (!a.has(M::kDynamics)) return c.text();
  c.equal("krl", a.krl, b.krl);
  c.equal("safety_factor", a.safety_factor, b.safety_factor);
  c.equal("rates", std::pair(a.answer_rate, a.miss_rate), std::pair(b.answer_rate, b.miss_rate));
  c.equal("times", std::pair(a.latency, a.jitter), std::pair(b.latency, b.jitter));
  c.equal("misses", a.misses, b.misses);
  c.equal("errors", std::pair(a.errors, a.warnings), std::pair(b.errors, b.warnings));
  c.equal("temperature", a.temperature, b.temperature);
  c.equal("jacobian", a.jacobian, b.jacobian);
  c.equal("mass", a.mass, b.mass);
  c.equal("gravity", a.gravity, b.gravity);
  return c.text();
}

std::string difference(Protocol protocol, const Command& a, const Command& b) {
  Comparison c(protocol);
  const std::size_t n = a.joints;
  c.equal("fields", a.fields, b.fields);
  c.equal("counter", a.counter, b.counter);
  c.equal("reflected", a.reflected, b.reflected);
  c.equal("joints", a.joints, b.joints);
  if (a.has(C::kPosition)) c.joints("q", a.q, b.q, n);
  if (a.has(C::kTorque)) c.joints("tau", a.tau, b.tau, n);
  if (a.has(C::kWrench)) c.equal("F", a.F, b.F);
  if (a.has(C::kPose)) c.pose("X", a.X, b.X);
  if (a.has(C::kRedundancy)) c.equal("redundancy", a.redundancy, b.redundancy);
  if (a.has(C::kJointStiffness)) c.joints("joint_stiffness", a.joint_stiffness, b.joint_stiffness, n);
  if (a.has(C::kJointDamping)) c.joints("joint_damping", a.joint_damping, b.joint_damping, n);
  if (a.has(C::kCartesianStiffness)) c.equal("cartesian_stiffness", a.cartesian_stiffness, b.cartesian_stiffness);
  if (a.has(C::kCartesianDamping)) c.equal("cartesian_damping", a.cartesian_damping, b.cartesian_damping);
  c.transformations(a.transformations, b.transformations);
  c.ios(a.ios, b.ios);
  if (protocol == Protocol::kLwr) c.equal("krl", a.krl, b.krl);
  return c.text();
}

}  // namespace cotwin::testing
