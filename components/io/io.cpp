#include "components/io/io.h"

#include "components/io/emulators/ethercat_bus_link.h"
#include "components/io/emulators/fri_controller_link.h"
#include "components/io/emulators/rtde_controller_link.h"
#include "components/io/links/ethercat_link.h"
#include "components/io/links/fri_link.h"
#include "components/io/links/recording_link.h"
#include "components/io/links/rtde_link.h"
#include "components/io/links/sensor_link.h"
#include "models/foundation/support/error.h"
#include "models/robot/robot_model.h"

namespace cotwin::io {

namespace {

std::vector<trajectory::Axis> axes_of(Settings& settings) {
  if (settings.text("robot").empty()) return trajectory::free_axes(static_cast<std::size_t>(settings.integer("joints", 1)));
  std::vector<trajectory::Axis> axes = trajectory::axes_of(settings.robot(Settings::Masses::kUnused));
  const long long n = static_cast<long long>(axes.size());
  if (const long long joints = settings.integer("joints", n); joints != n) {
    throw Error("unit:io", "joints=" + std::to_string(joints) + ", but the robot has " + std::to_string(n));
  }
  return axes;
}

std::unique_ptr<Link> make_link(Settings& settings, std::vector<trajectory::Axis> joints) {
  const std::string link = settings.choice("link");
  if (link == "sensors")
    return std::make_unique<SensorLink>(joints.size(), static_cast<std::size_t>(settings.integer("history")));
  if (link == "ethercat") return std::make_unique<EtherCatLink>(settings, joints);
  if (link == "ethercat_bus") return std::make_unique<EtherCatBusLink>(settings, joints.size());
  if (link == "fri") return std::make_unique<FriLink>(settings, std::move(joints));
  if (link == "fri_controller") return std::make_unique<FriControllerLink>(settings, std::move(joints));
  if (link == "rtde") return std::make_unique<RtdeLink>(settings, joints);
  if (link == "rtde_controller") return std::make_unique<RtdeControllerLink>(settings, joints);
  return std::make_unique<RecordingLink>(settings, std::move(joints));
}

}  // namespace

void Io::declare_settings(SettingList& s) {
  s.set_first_variables({"q_command", "q", "dq", "tau", "tau_e", "fresh", "t_measured", "done", "file", "warning"});
  s.robot("a name in models/robots, or a path to a URDF file, for the number of joints, their names and their limits");
  s.integer("joints", 1, 1, 1000, "number of joints").fallback_rule("the robot's, else 1");
  s.choice("link", {"recording", "sensors", "fri", "fri_controller", "ethercat", "ethercat_bus", "rtde", "rtde_controller"},
           "what is behind the ports: a recording, the sensors of an emulated robot, a KUKA robot (FRI), devices on an "
           "EtherCAT bus, a Universal Robots arm (RTDE); or, the other way round, clients of an emulated KUKA or Universal "
           "Robots arm, or the master of an emulated EtherCAT bus");
  s.integer("history", 0, 0, 1'000'000, "link=sensors: samples kept for their delay, more than delay/step; 0: no delay");
  declare_fri_settings(s);
  declare_ethercat_settings(s);
}

Io::Io(Settings& settings) : Io(axes_of(settings), settings) {}

Io::Io(std::vector<trajectory::Axis> joints, Settings& settings)
    : measures_(settings.robot_used().get()),
      measured_(joints.size()),
      command_(joints.size()),
      link_(make_link(settings, std::move(joints))) {}

void Io::declare(Variables& v) {
  JointVariables joints(v, measures_);
  if (link_->is_robot()) return link_->declare(v, joints);
  const Link::Needs needs = link_->needs();
  Variables::Declared q_command = joints.input("q_command", command_.q, "rad", "commanded joint position");
  if (needs.q) q_command.required();
  Variables::Declared tau_command = joints.input("tau_command", command_.tau, "N.m", "commanded joint torque");
  if (needs.tau) tau_command.required();
  joints.output("q", measured_.q, "rad", "measured joint position");
  joints.output("dq", measured_.dq, "rad/s", "measured joint velocity").derivative_of("q");
  joints.output("ddq", measured_.ddq, "rad/s2", "joint acceleration, derived from measurements").derivative_of("dq");
  joints.output("tau", measured_.tau, "N.m", "measured joint torque; 0 if has_tau is false");
  joints.output("tau_e", measured_.tau_e, "N.m", "external joint torque reported by the robot; 0 if has_tau_e is false");
  v.output("fresh", measured_.fresh, "whether there was a measurement within the last step");
  v.output("done", measured_.done, "whether the link has no further measurements");
  v.output("has_tau", measured_.has_tau, "whether the robot reports joint torques");
  v.output("has_tau_e", measured_.has_tau_e, "whether the robot reports external joint torques");
  v.output("warning", measured_.warning, "warnings for the summary of the run; empty: none");
  link_->declare(v, joints);
  v.output("t_measured", measured_.t, "s",
           "time of the last measurement, by the robot's clock from one to the next; connect it to the tuner's")
      .discrete();
}

void Io::initialise(Time start) {
  measured_.warning.clear();
  measured_.t = start.seconds();
  link_->initialise(start, measured_);
}

StepResult Io::step(Time now, Duration h) {
  measured_.elapsed = 0;
  const StepResult result = link_->step(now, h, command_, measured_);
  if (measured_.fresh || measured_.between)
    measured_.t = measured_.elapsed > 0 ? measured_.t + measured_.elapsed : (now + h).seconds();
  return result;
}

}  // namespace cotwin::io
