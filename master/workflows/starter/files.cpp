#include "master/workflows/starter/files.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <tuple>

#include "master/scenario/ssd_text.h"
#include "models/foundation/formats/xml.h"
#include "models/foundation/support/text.h"

namespace cotwin::master::starter {

namespace {

using text::to_text;

constexpr const char* kNamespaces =
    "xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\"\n"
    "    xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\"";

/// For a comment of XML or CSV: on one line, without "--".
std::string in_comment(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20) c = ' ';
  }
  for (std::size_t at = 0; (at = text.find("--", at)) != std::string::npos;) text.replace(at, 2, "- ");
  return text;
}

std::string list(std::span<const double> values) { return text::joined(values); }
std::string list(const Eigen::Vector3d& v) {
  std::string all;
  for (const double x : v) text::append(all, to_text(std::round(x * 1e9) / 1e9 + 0.0), " ");
  return all;
}

/// A file of start values.
class Values {
 public:
  Values(const std::string& name, const std::string& purpose) {
    text_ = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- " + in_comment(purpose) + " -->\n";
    text_ += "<ssv:ParameterSet version=\"1.0\" name=\"" + name + "\" " + kNamespaces + ">\n  <ssv:Parameters>\n";
  }
  void comment(const std::string& comment) { text_ += "    <!-- " + in_comment(comment) + " -->\n"; }
  void add(const std::string& name, std::span<const double> values) {
    text_ += "    <ssv:Parameter name=\"" + name + "\"><ssv:String value=\"" + list(values) + "\"/></ssv:Parameter>\n";
  }
  void add(const std::string& name, double value) {
    text_ += "    <ssv:Parameter name=\"" + name + "\"><ssv:Real value=\"" + to_text(value) + "\"/></ssv:Parameter>\n";
  }
  void add_text(const std::string& name, const std::string& value) {
    text_ += "    <ssv:Parameter name=\"" + name + "\"><ssv:String value=\"" + value + "\"/></ssv:Parameter>\n";
  }
  std::string text() const { return text_ + "  </ssv:Parameters>\n</ssv:ParameterSet>\n"; }

 private:
  std::string text_;
};

std::string describe(const robot::Joint& joint) {
  const bool revolute = joint.type == robot::JointType::kRevolute;
  std::string text = "'" + joint.name + "' in " + (revolute ? "rad" : "m");
  if (std::isfinite(joint.q_min) || std::isfinite(joint.q_max))
    text += ", from " + to_text(joint.q_min, 6) + " to " + to_text(joint.q_max, 6);
  if (std::isfinite(joint.dq_max)) text += ", at most " + to_text(joint.dq_max, 6) + (revolute ? " rad/s" : " m/s");
  return text;
}

std::string waypoints_csv(const Sketch& sketch, const robot::RobotModel& robot) {
  std::string csv =
      "# Waypoints of the desired motion. t: time of arrival, s; dwell: rest there, s. Joints rest at every waypoint.\n";
  for (std::size_t i = 0; i < robot.joints.size(); ++i)
    csv += "# q" + std::to_string(i + 1) + ": " + in_comment(describe(robot.joints[i])) + "\n";
  csv += "t";
  for (std::size_t i = 0; i < robot.joints.size(); ++i) csv += ",q" + std::to_string(i + 1);
  csv += ",dwell\n";
  for (const Waypoint& w : sketch.waypoints) {
    csv += to_text(std::round(w.t * 1e6) / 1e6);
    for (const double q : w.q) csv += "," + to_text(std::round(q * 1e6) / 1e6 + 0.0);
    csv += "," + to_text(w.dwell) + "\n";
  }
  return csv;
}

std::string drive_values(const Sketch& sketch) {
  Values values(
      "drive_train",
      "ASSUMPTIONS: nothing is known of the drives. Put here what is known of yours; the controller has the same values in "
      "compliance.ssv. cotwin describe unit:drive_train lists all parameters. One number per joint, or one for all.");
  values.comment("inertia of the motors behind the gears, kg.m2: half of that of the links");
  values.add("B", sketch.drives.B);
  values.comment("friction of the motors: viscous, N.m.s/rad, and Coulomb, N.m; from the URDF's <dynamics>, else 0");
  values.add("sigma2", sketch.drives.sigma2);
  values.add("tau_C", sketch.drives.tau_C);
  values.add("tau_S", sketch.drives.tau_C);
  values.add_text("sources", "assumptions of cotwin new from the URDF");
  values.add_text("assumed", "all");
  return values.text();
}

std::string energy_values(const Sketch& sketch) {
  Values values("energy",
                "ASSUMPTIONS: nothing is known of the electrical side of the drives. Put here what is known of yours, and its "
                "name out of assumed. "
                "cotwin describe unit:energy lists all parameters. cotwin ask reads this file beside the URDF.");
  const bool large =
      sketch.drives.power > 5000;  // W; an industrial robot on a rectifier of 3 x 400 V, else a light one on 48 V
  const double n = static_cast<double>(sketch.drives.k_t.size());
  values.comment(
      "equivalent motors of 1 Ohm that lose a third of their power at the limits of torque and speed; k_t: N.m/A behind the "
      "gear");
  values.add_text("current", "dc");
  values.add("R", 1);
  values.add("k_t", sketch.drives.k_t);
  values.comment("stand-by, brakes and controller, W; like a robot of " +
                 std::string(large ? "300 kg payload" : "5 to 15 kg payload"));
  for (const auto& [name, of_light, of_large] : {std::tuple{"P_0", 5 * n, 40 * n},
                                                 {"P_off", 2 * n, 8 * n},
                                                 {"P_brake", n, 16 * n},
                                                 {"E_release", 0.7 * n, 5 * n},
                                                 {"t_close", 0.1, 0.2},
                                                 {"controller", 50.0, 150.0},
                                                 {"C", 0.005, 0.002},
                                                 {"V_min", 48.0, 560.0},
                                                 {"V_max", 56.0, 700.0},
                                                 {"efficiency", 0.88, 0.96}})
    values.add(name, large ? of_large : of_light);
  values.add_text("sources", "assumptions of cotwin new from the limits of the URDF");
  values.add_text("assumed", "all");
  return values.text();
}

std::string compliance_values(const Sketch& sketch, const robot::RobotModel& robot) {
  Values values(
      "compliance",
      "Gains and compliance. cotwin describe unit:compliance lists all parameters. One number per joint, or one for all.");
  if (sketch.assumed) {
    values.comment("the drives as the controller knows them: as in drive_train.ssv; K: rigid joints");
    values.add("K", 0);
    values.add("B", sketch.drives.B);
    values.add("sigma2", sketch.drives.sigma2);
    values.add("tau_C", sketch.drives.tau_C);
    values.add("tau_S", sketch.drives.tau_C);
    values.comment("tracking by computed torque: natural frequency of the error, rad/s");
    values.add("omega", 40);
  }
  if (!sketch.without_limit.empty()) {
    std::vector<double> limits;
    for (const robot::Joint& joint : robot.joints) {
      const bool aside =
          std::find(sketch.without_limit.begin(), sketch.without_limit.end(), joint.name) != sketch.without_limit.end();
      limits.push_back(aside || !std::isfinite(joint.tau_max) ? 0 : joint.tau_max);
    }
    values.comment("limits of the motor torques, N.m; 0: none. Otherwise they are the effort limits of the URDF");
    values.add("tau_max", limits);
  }
  values.comment("joint admittance: M_a in kg.m2 and S_a in N.m/rad; zeta_a 1: deviations vanish without overshoot");
  values.add("M_a", sketch.M_a);
  values.add("S_a", sketch.S_a);
  values.add("zeta_a", sketch.zeta_a);
  return values.text();
}

std::string scene(const Contact& c) {
  const std::string size = list(Eigen::Vector3d(c.width, c.width, c.height));
  return "<?xml version=\"1.0\"?>\n<!-- A plate in the way of the probe. The origin is that of the robot's base. -->\n"
         "<sdf version=\"1.11\">\n  <world name=\"plate\">\n    <gravity>0 0 -9.81</gravity>\n    <model name=\"plate\">\n"
         "      <static>true</static>\n      <pose>" +
         list(c.p_WO) + " " + list(c.rpy) +
         "</pose>\n      <link name=\"plate\">\n        <collision name=\"plate\">\n          <geometry><box><size>" + size +
         "</size></box></geometry>\n          <surface>\n            <friction><ode><mu>0</mu></ode></friction>  <!-- without "
         "friction, so that the force can be predicted -->\n"
         "            <!-- stiffness in N/m and damping in N.s/m of the contact -->\n            <contact><ode><kp>" +
         to_text(c.kp) + "</kp><kd>" + to_text(c.kd) +
         "</kd></ode></contact>\n          </surface>\n        </collision>\n      </link>\n    </model>\n  </world>\n</sdf>\n";
}

std::string probe(const Contact& c) {
  return "<?xml version=\"1.0\"?>\n<!-- The sphere that touches the plate. Replace it by your tool: mass, inertia and shapes. "
         "-->\n"
         "<robot name=\"probe\">\n  <link name=\"probe\">\n    <collision>\n      <geometry><sphere radius=\"" +
         to_text(c.radius) + "\"/></geometry>\n    </collision>\n  </link>\n</robot>\n";
}

/// The scenario file.
class ScenarioFile {
 public:
  ScenarioFile(const Sketch& sketch, const robot::RobotModel& robot, const Naming& naming)
      : sketch_(sketch),
        robot_(robot),
        naming_(naming),
        contact_(sketch.contact.has_value()),
        ssd_(naming.scenario, naming.scenario, introduction(), "1 ms") {}

  std::string text() {
    components();
    connections();
    annotation();
    return ssd_.text(to_text(sketch_.stop));
  }

 private:
  std::string introduction() const {
    std::string text =
        "  " + in_comment(naming_.scenario) + ", written by `cotwin new`. It runs as it is: cotwin run twin.ssd\n\n";
    switch (sketch_.kind) {
      case Kind::kMotion:
        text +=
            "  The robot moves through the waypoints of waypoints.csv. The report has joint torques, tracking error and "
            "energy.\n";
        break;
      case Kind::kCompliance:
        text +=
            "  The robot stands and is pushed with the same torque twice: from 1 to 4 s and, with twice the stiffness S_a, "
            "from 7 to\n"
            "  10 s. The deviation of joint i is tau_e[i]/S_a[i], so it is half as large the second time.\n";
        break;
      case Kind::kContact:
        text += "  A probe at '" + in_comment(sketch_.contact->frame) + "' presses against a plate: the desired motion goes " +
                to_text(1e3 * sketch_.contact->depth, 3) +
                " mm into it, and the compliance\n  gives way. The force at rest is about " +
                to_text(sketch_.contact->force, 3) + " N.\n";
        break;
    }
    text += "\n  Files beside this one: waypoints.csv, the motion; compliance.ssv, gains and compliance";
    if (sketch_.assumed) text += "; drive_train.ssv, the drives";
    if (sketch_.energy_assumed) text += ";\n  energy.ssv, their electrical side, for cotwin ask beside the URDF";
    if (contact_) text += ";\n  scene.sdf, the plate; probe.urdf";
    text += ".\n\n  The joints, in the order of all vectors:\n";
    for (std::size_t i = 0; i < robot_.joints.size(); ++i)
      text += "    [" + std::to_string(i + 1) + "] " + in_comment(describe(robot_.joints[i])) + "\n";
    if (!sketch_.notes.empty()) text += "\n  Notes:\n";
    for (const std::string& note : sketch_.notes) text += "    * " + in_comment(note) + "\n";
    return text;
  }

  void components() {
    ssd_.component("motion", "unit:motion?kind=waypoints", {}, {{"file", "waypoints.csv"}, {"passing", "rest"}},
                   "the desired motion; passing=through passes the waypoints without a stop");
    ssd_.component("compliance", "unit:compliance", {"compliance.ssv"}, {},
                   "the controller: it follows the desired motion and gives way to external torques");
    if (sketch_.assumed) {
      ssd_.component("drive", "unit:drive_train?transmission=rigid&friction=smooth", {"drive_train.ssv"}, {},
                     "motors, gears, friction and links; with known stiffness of the gears, transmission=flexible and K");
    } else {
      ssd_.component("drive", "unit:drive_train", {}, {},
                     "motors, gears, friction and links, with the parameters beside the URDF");
    }
    if (!contact_) return;
    const Drives& d = sketch_.drives;
    SsdText::Values gears = {{"K", list(d.K)}, {"D", list(d.D)}};
    if (sketch_.assumed) gears.emplace_back("B", list(d.B));
    ssd_.component("world",
                   std::string("unit:contact_world?scene=scene.sdf") + (sketch_.robot_shapes ? "" : "&robot_shapes=none"), {},
                   gears, "bodies that the robot touches; the drives as the world sees them");
  }

  void connections() {
    ssd_.connect("motion", "compliance", {"q_d", "dq_d", "ddq_d"});
    ssd_.comment_connections("the robot begins where the motion begins");
    ssd_.connect("motion", "q_d", "drive", "q0");
    ssd_.connect("motion", "dq_d", "drive", "dq0");
    ssd_.connect("compliance", "drive", {"tau_m"});
    ssd_.connect("drive", "compliance", {"q", "dq", "theta", "dtheta"});
    if (!contact_) return;
    ssd_.comment_connections("contact: the world returns the torques of the contact forces");
    ssd_.connect("drive", "world", {"q", "dq", "tau_J", "dtheta"});
    ssd_.connect("world", "drive", {"tau_e"});
    ssd_.connect("world", "compliance", {"tau_e"});
  }

  void line(const std::string& text) { ssd_.annotate(text); }
  void event(const std::string& time, const std::string& variable, const std::string& value, const std::string& ramp) {
    line("<cotwin:Event time=\"" + time + "\" variable=\"" + variable + "\" value=\"" + value + "\"" +
         (ramp.empty() ? "" : " ramp=\"" + ramp + "\"") + "/>");
  }

  void annotation() {
    line("<cotwin:Setting name=\"robot\" value=\"" + xml::escaped(naming_.robot) + "\"/>");
    if (!naming_.lock.empty()) line("<cotwin:Setting name=\"lock\" value=\"" + xml::escaped(naming_.lock) + "\"/>");
    if (naming_.unphysical != "error")
      line("<cotwin:Setting name=\"unphysical\" value=\"" + naming_.unphysical +
           "\"/>  <!-- inertias that no body can have are " +
           (naming_.unphysical == "warn" ? "used as they are" : "replaced by estimates") + " -->");
    line("<!-- within a tick, one stage after the other -->");
    const char* const drive_stage = contact_ ? "3" : "2";
    line("<cotwin:Component name=\"motion\" stage=\"0\"/>");
    line("<cotwin:Component name=\"compliance\" stage=\"1\"/>");
    if (contact_) line("<cotwin:Component name=\"world\" stage=\"2\"/>");
    line(std::string("<cotwin:Component name=\"drive\" stage=\"") + drive_stage + "\"/>");
    events();
    line("<cotwin:Recording decimation=\"10\">");
    line(
        "  <cotwin:Record variables=\"motion.q_d compliance.q_c compliance.tau_m compliance.tau_id drive.q drive.dq "
        "drive.tau_J drive.tau_f" +
        std::string(sketch_.kind == Kind::kCompliance ? " drive.tau_e" : "") +
        (contact_ ? " world.f_c world.tau_e world.penetration world.contacts world.contact_p world.contact_f" : "") + "\"/>");
    line("</cotwin:Recording>");
    line("<cotwin:Report name=\"joint torque\" kind=\"signal\" a=\"drive.tau_J\"/>");
    line("<cotwin:Report name=\"motor torque\" kind=\"signal\" a=\"compliance.tau_m\"/>");
    line("<cotwin:Report name=\"tracking error\" kind=\"difference\" a=\"drive.q\" b=\"compliance.q_c\"/>");
    if (sketch_.kind != Kind::kMotion)
      line("<cotwin:Report name=\"compliant deviation\" kind=\"difference\" a=\"drive.q\" b=\"motion.q_d\"/>");
    if (contact_) {
      line("<cotwin:Report name=\"contact force\" kind=\"signal\" a=\"world.f_c\"/>");
      line("<cotwin:Report name=\"penetration\" kind=\"signal\" a=\"world.penetration\"/>");
    }
    line("<cotwin:Report name=\"work of the motors\" kind=\"energy\" a=\"compliance.tau_m\" b=\"drive.dtheta\"/>");
  }

  void events() {
    if (sketch_.kind == Kind::kCompliance) {
      line("<!-- the same torque pushes the links and is measured by the controller -->");
      const std::string push = list(sketch_.push);
      const auto push_all = [&](const char* time, const std::string& value) {
        for (const char* variable : {"drive.tau_e", "compliance.tau_e"}) event(time, variable, value, "50 ms");
      };
      std::vector<double> stiffer;
      for (const double S : sketch_.S_a) stiffer.push_back(2 * S);
      push_all("1", push);
      push_all("4", "0");
      event("6", "compliance.S_a", list(stiffer), "");
      push_all("7", push);
      push_all("10", "0");
    }
    if (contact_) {
      line("<!-- the probe at the end-effector, without mass; a tool with mass: see docs/scenario.md -->");
      line("<cotwin:Event time=\"0\" attach=\"" + sketch_.contact->tool + "\" parent=\"" +
           xml::escaped(sketch_.contact->frame) + "\" xyz=\"" + list(sketch_.contact->p_FP) + "\" file=\"probe.urdf\"/>");
    }
  }

  const Sketch& sketch_;
  const robot::RobotModel& robot_;
  const Naming& naming_;
  bool contact_;
  SsdText ssd_;
};

}  // namespace

std::vector<File> files_of(const Sketch& sketch, const robot::RobotModel& robot, const Naming& naming) {
  std::vector<File> files = {{"twin.ssd", ScenarioFile(sketch, robot, naming).text()},
                             {"waypoints.csv", waypoints_csv(sketch, robot)},
                             {"compliance.ssv", compliance_values(sketch, robot)}};
  if (sketch.assumed) files.push_back({"drive_train.ssv", drive_values(sketch)});
  if (sketch.energy_assumed) files.push_back({"energy.ssv", energy_values(sketch)});
  if (sketch.contact) {
    files.push_back({"scene.sdf", scene(*sketch.contact)});
    files.push_back({"probe.urdf", probe(*sketch.contact)});
  }
  return files;
}

}  // namespace cotwin::master::starter
