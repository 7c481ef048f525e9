// The ports and parameters of a Universal Robots arm.
#include "components/io/links/rtde_link.h"

namespace cotwin::io {

void RtdeLink::declare(Variables& v, JointVariables& joints) {
  Variables::Declared digital = v.input("digital_command", digital_command_,
                                        "standard digital outputs 0 to 7 as bits, of which those of digital_mask are written");
  if (digital_mask_ != 0 && mode_ != "monitor") digital.required();
  v.input("double_command", double_command_, "1",
          "input double registers 24 to 47, written if `registers` is set; mode=position writes 24 to 29 itself");
  v.input("int_command", int_command_, "input int registers 24 to 47, likewise; mode=position writes 24 and 25 itself");

  v.output("connected", connected_, "whether data of the robot come");
  v.output("state", state_,
           "of the program on the robot: 0 off (also while it does not play), 1 waiting, 2 following, 3 stopped after a loss "
           "of commands, 4 stopped because commands were too far or the robot jumped, 5 waiting for the end of a request from "
           "before");
  v.output("commanding", commanding_, "whether the robot follows the commands of this unit");
  v.output("robot_mode", robot_mode_, "as reported: 7 running, 5 idle, 3 power off, …");
  v.output("safety", safety_, "safety mode, as reported: 1 normal, 2 reduced, 3 protective stop, …; 0: not known");
  v.output("runtime", runtime_, "state of the robot's program, as reported: 1 stopped, 2 playing, 4 paused, …");
  v.output("t_robot", t_robot_, "s", "time of the robot's clock").discrete();
  v.output("speed_scaling", speed_scaling_, "1", "as reported").discrete();
  joints.output("q_robot", q_robot_, "rad", "position that the robot commands (target_q)").discrete();
  joints.output("q_sent", q_sent_, "rad", "commanded position that was sent last, with the synchronisation").discrete();
  joints.output("e", e_, "rad", "discrepancy between q_command and the robot, from which the synchronisation corrects")
      .discrete();
  v.output("current", current_, "A", "motor currents, as reported").discrete();
  v.output("F_e", F_e_, "1",
           "force and moment on the tool, as reported: in the base frame, at the flange (e-Series) or the TCP (CB3), x y z "
           "each, in N and N.m")
      .discrete();
  v.output("p", p_, "m", "position of the TCP, as reported").discrete();
  v.output("quat", quat_, "1", "orientation of the TCP, as reported, (w, x, y, z)").discrete();
  v.output("digital_in", digital_in_,
           "digital inputs, as reported: bits 0 to 7 standard, 8 to 15 configurable, 16 and 17 tool");
  v.output("digital_out", digital_out_, "digital outputs, as reported, likewise");
  v.output("double_value", double_value_, "1", "output double registers 24 to 47").discrete();
  v.output("int_value", int_value_, "output int registers 24 to 47");
  v.output("version", version_, "of the controller's software: major, minor, bugfix, build");
  v.output("received", received_, "data packages received");
  v.output("skipped", skipped_,
           "data packages that the robot left out, or that had no room between two steps, by its time stamps");
  v.output("rejected", rejected_,
           "packages that could not be read, with numbers that are not finite or larger than 1e9, or with a time stamp that "
           "jumps by more than 1 h");
  belief_.declare(v, "packages");
  v.output("sent", sent_, "commands sent");
  v.output("unsent", unsent_, "commands that the network did not take in time");
  v.output("refused", refused_,
           "steps with data in which q_command or double_command was not finite, or q_command larger than 1e9: the last usable "
           "values were sent");
  v.output("connections", connections_, "how often a connection was set up");
  v.output("losses", losses_, "how often the robot became silent");
  v.output("jitter", jitter_, "s", "mean deviation of the interval between packages from the robot's time (RFC 3550)")
      .discrete();
  v.output("round_trip", round_trip_, "s",
           "mean time from a command to the first package in which the robot's program reflects it")
      .discrete();

  v.parameter("controller", controller_, "IPv4 address of the robot's controller, perhaps with :port (30004)");
  v.parameter("mode", mode_, "monitor: nothing is written; position: registers for the program follow.script");
  v.parameter("frequency", frequency_, "Hz",
              "of the data packages that the robot is asked for, at most 500 (e-Series) or 125 (CB3)")
      .range(1, 1000);
  v.parameter("timeout", timeout_, "s",
              "without data for this time, or twenty packages if that is longer, the robot is not connected")
      .range(1e-3, 3600);
  v.parameter("wait", wait_, "s", "initialisation waits so long for the robot; 0: not").range(0, 3600);
  v.parameter("ddq_cutoff", ddq_cutoff_, "Hz", "cutoff frequency of the first-order low-pass of ddq; 0: no filter")
      .range(0, 1e6);
  v.parameter("digital_mask", digital_mask_, "mode=position: standard digital outputs that this unit writes, as bits; 0: none")
      .range(0, 255);
  joints
      .parameter("dq_command_max", dq_command_max_, "rad/s",
                 "speed limit of commanded positions, at first the URDF's, but at most 0.5 rad/s; a twin that is elsewhere is "
                 "approached "
                 "with it")
      .range(1e-6, 1e9);
  v.parameter("registers", registers_,
              "mode=position: all input registers 24 to 47 are written; other clients cannot write them then");
  v.parameter("torque_per_current", torque_per_current_, "N.m/A",
              "for tau where the controller does not give torques; 0: then there are none. UR does not publish it")
      .range(0, 1e6);
  v.tunable("command", command_, "q_command is followed; false: the last commanded position is held");
  v.parameter("K_P", K_P_, "1", "proportional gain of the synchronisation of robot and twin").range(-0.999, 1e3);
  v.parameter("K_D", K_D_, "s", "derivative gain of the synchronisation").range(-1e3, 1e3);
  v.tunable("tau_e_gated", tau_e_gated_, "tau_e is given only while the robot follows commands, else 0");
  acknowledgement_.declare(v, "nothing is commanded", "data of the robot come and it is ready");
  v.parameter("ddq_command_max", ddq_command_max_, "rad/s2", "limit of the acceleration of commanded positions")
      .range(1e-3, 1e9);
  gains_.declare(v);
}

}  // namespace cotwin::io
