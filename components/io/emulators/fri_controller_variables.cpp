// The ports and parameters of an emulated KUKA controller.
#include "components/io/emulators/fri_controller_link.h"

namespace cotwin::io {

void FriControllerLink::declare(Variables& v, JointVariables& joints) {
  const bool lwr = protocol_ == fri::Protocol::kLwr;
  joints.input("q", q_, "rad", "measured joint position of the emulated robot").essential();
  joints.input("tau", tau_, "N.m", "measured joint torque of the emulated robot");
  joints.input("tau_e", tau_e_, "N.m", "external joint torque, as the emulated robot estimates it");
  joints.input("q_d", q_d_, "rad", "position of the robot's own motion, if hold is false");
  if (lwr) krl_.declare_inputs(v, "krl", "from the robot's program, $FRI_TO");
  reads_.declare_input(v, "io_value", "I/O values of the robot");

  joints.output("q_command", q_command_, "rad", "position that the robot's drives have to follow");
  joints.output("dq_command", dq_command_, "rad/s", "its rate while the robot follows the client; else 0").discrete();
  joints
      .output("tau_command", tau_command_, "N.m",
              "joint torque that the client adds; with a robot's URDF also that of the wrench that it adds")
      .discrete();
  v.output("F_command", F_command_, "1", "force and moment that the client adds at the tool, x y z each, in N and N.m")
      .discrete();
  joints
      .output("stiffness_command", stiffness_command_, "N.m/rad",
              "joint stiffness, the client's if it gives one, else that of the tunable")
      .discrete();
  v.output("damping_command", damping_command_, "1", "joint damping ratio, likewise").discrete();
  v.output("active", active_, "whether the robot follows the client");
  v.output("connected", connected_, "whether the client has answered within the last second");
  v.output("state", state_,
           "0 idle, 1 monitoring, 2 monitoring in good quality, 3 waiting for the first commands, 4 commanding");
  v.output("quality", quality_,
           "rating of the client's answers: 0 poor (unacceptable), 1 fair (bad), 2 good (OK), 3 excellent");
  v.output(
      "drop", drop_,
      "why commanding ended last: 0 not yet, 1 request, 2 quality, 3 lost commands, 4 speed, 5 position, 6 torque, 7 robot, "
      "8 other quantities, 9 closed, 10 stiffness or damping, 11 no posture for the pose, 12 acceleration");
  v.output("drops", drops_, "how often commanding ended for another reason than request");
  if (lwr) krl_client_.declare_outputs(v, "krl_command", "to the robot's program, $FRI_FRM");
  writes_.declare_output(v, "io_command", "I/O values that the client has written");
  counts_.declare(v);

  v.parameter("address", address_,
              "IPv4 address of this machine that messages are sent from; 127.0.0.1 to 127.255.255.254: this machine only");
  v.parameter(
       "port", port_,
       "UDP port that messages are sent from; 0: the system chooses; -1: 0 with LWR and at an address of this machine only, "
       "where clients bind 30200 themselves, else 30200")
      .range(-1, 65535);
  v.parameter("client", client_, "IPv4 address and port of the client");
  v.parameter("period", period_, "s", "send period; Sunrise: whole milliseconds").range(1e-3, 0.1);
  v.parameter("receive_multiplier", receive_multiplier_, "Sunrise: the client answers every so many messages").range(1, 100);
  v.parameter("client_mode", client_mode_, "Sunrise: what is asked from the client: position, torque, wrench or pose");
  v.parameter("control", control_,
              "control that is reported: position, joint_impedance or cartesian_impedance; empty: what client_mode (LWR: the "
              "client's commands) needs, joint_impedance for torques, cartesian_impedance for wrenches, else position");
  v.parameter("window", window_, "command periods over which answers are rated").range(1, 10'000);
  v.parameter("excellent", excellent_, "1", "share of answers in time for excellent quality").range(0, 1);
  v.parameter("excellent_latency", excellent_latency_, "1", "largest mean latency for excellent quality, in command periods")
      .range(0, 1);
  v.parameter("good", good_, "1", "share of answers in time for good quality, at which commanding may begin").range(0, 1);
  v.parameter("fair", fair_, "1", "share of answers in time for fair quality; commanding ends below it").range(0, 1);
  v.parameter("max_lost", max_lost_, "lost commands in a row that are extrapolated; one more stops the robot").range(0, 255);
  v.parameter("stop_time", stop_time_, "s", "time from full speed to rest when commanding ends").range(0, 10);
  v.parameter("safety_factor", safety_factor_, "1", "scales the limits of speed and torque (friStart)").range(0, 1);
  v.parameter("restart", restart_, "s", "after commanding has ended by itself, it is requested again after this time; 0: never")
      .range(0, 1e9);
  v.parameter("hold", hold_, "the robot's own motion is rest where it is at the start; false: q_d");
  joints.parameter("q_min", q_min_, "rad", "lower limit of commanded positions, from the URDF").range(-kNoLimit, kNoLimit);
  joints.parameter("q_max", q_max_, "rad", "upper limit of commanded positions, from the URDF").range(-kNoLimit, kNoLimit);
  joints.parameter("dq_max", dq_max_, "rad/s", "limit of commanded speeds, from the URDF").range(0, kMostSpeed);
  joints
      .parameter("tau_command_max", tau_command_max_, "N.m",
                 "limit of added torques, also of those of an added wrench; from the URDF")
      .range(0, kNoLimit);
  v.tunable("request", request_, "the robot's program asks the client for commands (friStart); false: it ends commanding");
  v.tunable("ready", ready_, "the drives are on and there is no safety stop");
  v.tunable("open", open_, "the session is open (friOpen); false: it ends (friClose), and nothing is sent");
  v.tunable("stiffness", stiffness_, "N.m/rad", "joint stiffness of the robot's program").range(0, 1e9);
  v.tunable("damping", damping_, "1", "joint damping ratio of the robot's program").range(0, 1);

  v.parameter("force_max", force_max_, "N", "limit of an added force").range(0, kNoLimit);
  v.parameter("moment_max", moment_max_, "N.m", "limit of an added moment").range(0, kNoLimit);
  v.parameter("stiffness_max", stiffness_max_, "N.m/rad", "LWR: largest joint stiffness that a client may ask for")
      .range(0, kNoLimit);
  v.parameter("translational_stiffness_max", translational_stiffness_max_, "N/m", "LWR: likewise, Cartesian, along the axes")
      .range(0, kNoLimit);
  v.parameter("rotational_stiffness_max", rotational_stiffness_max_, "N.m/rad", "LWR: likewise, Cartesian, about the axes")
      .range(0, kNoLimit);
  v.parameter("v_command_max", v_command_max_, "m/s", "limit of the linear speed of commanded poses").range(0, 1e3);
  v.parameter("w_command_max", w_command_max_, "rad/s", "limit of the angular speed of commanded poses").range(0, 1e3);
  v.parameter(
       "start_time", start_time_, "s",
       "Sunrise: time stamp of the messages at t = 0, since 1970 in UTC; -1: the host's time at the first step; LWR's time "
       "stamps are t")
      .range(-1, 4294967295.0);
  v.parameter("spacing", spacing_, "s",
              "least time between two messages on the host's clock; a run on the wall clock that is late and catches up skips "
              "messages instead of sending many at once; 0: none is skipped")
      .range(0, 0.1);
  v.output("unsent", unsent_, "messages that the system did not send: no way to the client, no free buffer");
  v.output("unmatched", unmatched_, "commands that reflect none of the session's last 256 messages; they are not used");
  v.output("displaced", displaced_, "datagrams of the client that were not read because more than 64 came in a step");
  v.output(
      "last_fault", last_fault_,
      "why a datagram of the client was rejected last: 0 not yet, 1 size, 2 identifier, 3 truncated, 4 wire type, 5 number of "
      "elements, 6 missing field, 7 value out of range, 8 checksum, 9 not finite, 10 another sender");
  v.output("latency_median", latency_median_, "s", "half of the answers took less, from a message to its answer; to 9 %")
      .discrete();
  v.output("latency_99", latency_99_, "s", "99 % of the answers took less; to 9 %").discrete();
  v.output("latency_max", latency_max_, "s", "the longest time to an answer").discrete();
  v.parameter("ddq_max", ddq_max_, "rad/s2", "limit of the acceleration of commanded joint positions (KUKA's are not public)")
      .range(1e-3, 1e9);
  v.parameter("transformations", transformations_,
              "Sunrise: names of the transformations that the robot requests from the client, at most five, with commas");
  v.output("warning", warning_, "warnings for the summary of the run; empty: none");
}

}  // namespace cotwin::io
