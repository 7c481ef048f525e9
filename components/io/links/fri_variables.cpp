// The ports and parameters of a KUKA robot.
#include "components/io/links/fri_link.h"

namespace cotwin::io {

void FriLink::declare(Variables& v, JointVariables& joints) {
  Variables::Declared F =
      v.input("F_command", F_command_, "1",
              "mode=wrench, cartesian_impedance: force and moment added at the tool, x y z each, in N and N.m");
  if (mode_text_ == "wrench") F.required();
  Variables::Declared p =
      v.input("p_command", p_command_, "m", "mode=cartesian_impedance: commanded position of the tool in the robot's base");
  if (mode_text_ == "cartesian_impedance") p.required();
  Variables::Declared quat =
      v.input("quat_command", quat_command_, "1", "mode=cartesian_impedance: commanded orientation of the tool, (w, x, y, z)");
  if (mode_text_ == "cartesian_impedance") quat.required();
  if (protocol_ == fri::Protocol::kLwr) krl_command_.declare_inputs(v, "krl_command", "to the robot's program, $FRI_FRM");
  writes_.declare_input(v, "io_command", "I/O values to be written");

  v.output("connected", connected_, "whether messages of the robot come");
  v.output("state", state_,
           "0 idle, 1 monitoring, 2 monitoring in good quality, 3 waiting for the first commands, 4 commanding");
  v.output("quality", quality_,
           "the robot's rating of the answers: 0 poor (unacceptable), 1 fair (bad), 2 good (OK), 3 excellent");
  v.output("commanding", commanding_, "whether the robot follows the commands of this unit");
  v.output("client_mode", command_mode_, "Sunrise: what the robot asks for, 0 none, 1 position, 2 wrench, 3 torque, 4 pose");
  v.output("t_robot", t_robot_, "s", "time of the robot's clock").discrete();
  v.output("period", period_, "s", "send period of the robot's messages").discrete();
  joints.output("q_robot", q_robot_, "rad", "position that the robot commands, with what it takes from this unit").discrete();
  joints.output("q_own", q_own_, "rad", "position of the robot's own motion, without this unit").discrete();
  joints.output("q_sent", q_sent_, "rad", "commanded position that was sent last, with the synchronisation").discrete();
  joints.output("e", e_, "rad", "discrepancy between q_command and the robot, from which the synchronisation corrects")
      .discrete();
  v.output("F_e", F_e_, "1", "external force and moment at the tool, as reported, x y z each, in N and N.m; else 0").discrete();
  v.output("p", p_, "m", "position of the tool, as reported").discrete();
  v.output("quat", quat_, "1", "orientation of the tool, as reported, (w, x, y, z)").discrete();
  if (protocol_ == fri::Protocol::kLwr) krl_.declare_outputs(v, "krl", "from the robot's program, $FRI_TO");
  reads_.declare_output(v, "io_value", "I/O values of the robot");
  counts_.declare(v);
  v.output("losses", losses_, "how often the connection was lost");

  v.parameter("address", address_,
              "IPv4 address of this machine that messages come to; 127.0.0.1: from this machine only; 0.0.0.0: any");
  v.parameter("port", port_, "UDP port that messages come to; 0: the system chooses").range(0, 65535);
  v.parameter("controller", controller_,
              "IPv4 address of the robot's controller, perhaps with :port; messages of others are rejected; empty: the first "
              "sender's, on "
              "this machine only");
  v.parameter("mode", mode_text_,
              "what is commanded: monitor (nothing, the robot's own position is mirrored), position, torque, wrench (added to "
              "positions), joint_impedance or "
              "cartesian_impedance (LWR: with stiffness and damping)");
  v.parameter("timeout", timeout_, "s",
              "without a message for this time, or twenty send periods if that is longer, the robot is not connected")
      .range(1e-3, 3600);
  v.parameter("wait", wait_, "s", "initialisation waits so long for the first message of the robot; 0: not").range(0, 3600);
  v.parameter("dq_cutoff", dq_cutoff_, "Hz", "cutoff frequency of the first-order low-pass of dq; 0: no filter").range(0, 1e6);
  joints
      .parameter(
          "dq_command_max", dq_command_max_, "rad/s",
          "speed limit of commanded positions, at first the URDF's, but at most 0.5 rad/s (prismatic: 0.5 m/s); a twin that "
          "is elsewhere is approached with it")
      .range(1e-6, 1e9);
  v.parameter("v_command_max", v_command_max_, "m/s", "mode=cartesian_impedance: speed limit of p_command").range(1e-6, 1e9);
  v.parameter("w_command_max", w_command_max_, "rad/s", "mode=cartesian_impedance: speed limit of quat_command")
      .range(1e-6, 1e9);
  v.tunable("command", command_, "q_command and the rest are followed; false: the last commanded position is held");
  v.parameter("K_P", K_P_, "1", "proportional gain of the synchronisation of robot and twin").range(-0.999, 1e3);
  v.parameter("K_D", K_D_, "s", "derivative gain of the synchronisation").range(-1e3, 1e3);
  v.tunable("stiffness", stiffness_, "N.m/rad", "mode=joint_impedance: stiffness of the robot's joints").range(0, 1e9);
  v.tunable("damping", damping_, "1", "mode=joint_impedance: damping ratio of the robot's joints").range(0, 1);
  v.tunable("cartesian_stiffness", cartesian_stiffness_, "1",
            "mode=cartesian_impedance: stiffness x y z in N/m, about x y z in N.m/rad")
      .range(0, 1e9);
  v.tunable("cartesian_damping", cartesian_damping_, "1", "mode=cartesian_impedance: damping ratios").range(0, 1);
  v.tunable("tau_e_gated", tau_e_gated_,
            "tau_e is given only while the robot follows commands, else 0: a guided twin does not move away from a robot that "
            "does not follow");
  v.output("refused", refused_, "steps in which an input was not finite or larger than 1e9: its last usable value was used");
  v.output("unsent", unsent_, "answers that the system did not send");
  v.output("restarts", restarts_,
           "how often the robot's controller began anew within timeout: another address, counters or time stamps that jump");
  belief_.declare(v, "messages");
  acknowledgement_.declare(v, "nothing is commanded", "messages of the robot come and it reports no safety stop");
  v.parameter("ddq_command_max", ddq_command_max_, "rad/s2", "limit of the acceleration of commanded positions")
      .range(1e-3, 1e9);
  gains_.declare(v);
}

}  // namespace cotwin::io
