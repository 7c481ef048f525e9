// Settings and variables of the monitor.
#include "components/monitor/monitor.h"
#include "components/unit/joint_variables.h"

namespace cotwin::monitor {

using surroundings::Velocity;

void Monitor::declare_settings(SettingList& s) {
  s.set_first_variables({"q", "dq", "distance", "least_distance", "p_a", "p_b", "normal", "pair", "time_to_contact", "r"});
  s.cell({"hulls", "all"});
  s.choice("base", {"fixed", "floating"}, "the bases of the robots are fixed or move, for example on rails or in space");
  s.text("ignore", "",
         "pairs whose distance does not count, name:name,name:name, of bodies of the scene, and of links as link_5:link_7 or "
         "left/link_5:table");
  s.text("separation", "",
         "bodies before which robots are to slow down or stop (speed and separation monitoring, ISO/TS 15066): name,name, or "
         "all that "
         "move and all obstacles: all");
  s.text(
      "cloud", "",
      "point cloud of what stands around the robots, a file (.pcd, .ply; .xyz, .csv), in m: its points are balls of the radius "
      "cloud.r, and stand as one body, cloud");
  s.text("obstacles", "",
         "static bodies of the scene that are moved, scaled and switched while the run goes on: name,name; nobody but this "
         "unit meets them");
}

void Monitor::declare_ports(Variables& v, Ports& ports, const std::string& x, const std::string& of) {
  v.output(x + "distance", ports.distance, "m",
           "least distance " + of + " from others, less the inflation; negative: overlap; 1e12: there is no pair");
  v.output(x + "least_distance", ports.least, "m", "the same since the last step, with joints linear in between").discrete();
  v.output(x + "p_a", ports.p_a, "m", "nearest point on the inflated robot, in W").discrete();
  v.output(x + "p_b", ports.p_b, "m", "nearest point on the other one, in W: p_a + distance normal").discrete();
  v.output(x + "normal", ports.n, "1", "unit vector in W from p_a to p_b").discrete();
  v.output(x + "points_known", ports.points_known,
           "1 while p_a and p_b are on the surfaces; 0: there is no pair, or they are not known, as one overlaps with the "
           "inside of a "
           "closed mesh");
  v.output(x + "pair", ports.pair,
           "the two bodies, that of the robot first: bodies of the scene from 1, then base and links of each robot; 0: none");
  v.output(x + "distance_rate", ports.rate, "m/s", "rate of the distance of this pair, n'(v_b - v_a); negative: they approach")
      .discrete();
  v.output(x + "time_to_contact", ports.time, "s", "-distance / distance_rate; 0 in contact, 1e12 if they do not approach")
      .discrete();
  v.output(x + "self_distance", ports.self, "m",
           "least distance of links " + of + " that are no neighbours, not inflated; 1e12: there is no pair");
}

void Monitor::declare_separation(Variables& v) {
  const auto add = [&](Ports& ports, const std::string& x, const std::string& of) {
    v.output(x + "zone", ports.zone, of + ": 0 clear, 1 slow, 2 stop");
    v.output(x + "speed", ports.speed, "1",
             "share of the planned speed at which " + of + " may move; for a motion with override=true")
        .discrete();
    v.output(x + "separation", ports.separation, "m",
             "least distance from bodies that move and obstacles, less S_p of the pair; negative: stop; 1e12: there is none")
        .discrete();
    v.output(x + "S_p", ports.S_p, "m", "protective separation distance of this pair (ISO/TS 15066, 5.5.4.2.3)").discrete();
    v.output(x + "separation_pair", ports.apart.pair, "this pair: link and body, as in pair; 0: there is none");
    v.output(x + "separation_p_a", ports.apart.p_a, "m", "its nearest point on the inflated robot, in W").discrete();
    v.output(x + "separation_p_b", ports.apart.p_b, "m", "its nearest point on the body, in W").discrete();
    v.output(x + "stopped_late", ports.late, "stops of " + of + " after which it still moved later than T_r and T_s");
    v.output(x + "least_while_moving", ports.least_moving, "m",
             "least distance of " + of + " from these bodies so far, of a robot that moved faster than 10 mm/s; 1e12: none did")
        .discrete();
    v.output(x + "separation_points_known", ports.apart.points_known, "1 while these two are on the surfaces, as points_known");
  };
  add(all_, "", robots_.size() == 1 ? "the robot" : "all robots");
  figures_.declare(v);
  for (const auto& robot : robots_) {
    const std::string of = robot->placed->name.empty() ? "the robot" : "robot " + robot->placed->name;
    if (!robot->prefix.empty()) add(robot->ports, robot->prefix, of);
    robot->separation->declare(v, robot->prefix, "of " + of);
  }
  events_.declare(
      v, "10 clear, 11 slow, 12 stop, 13 a body is lost: its pose or speed is no number, or it jumped, 14 did not stop",
      "the link, as in pair; 0: nobody is near", "m", "distance less S_p");
  v.output("event_body", event_body_, "of the last event: the body, as in pair; 0: nobody is near");
}

void Monitor::declare(Variables& v) {
  declare_ports(v, all_, "", robots_.size() == 1 ? "of the robot" : "of all robots");
  v.tunable("r", r_, "m", "inflation of the robots' shapes, the radius of a ball that is added to them").range(0, 100);
  const auto declare_obstacle = [&v](const std::string& x, Body& body, const std::string& of) {
    v.tunable(x + "present", body.present, "1", "1 while " + of + " is there, else 0").range(0, 1);
    v.tunable(x + "p", body.pose.p, "m", "position of " + of + " in W").range(-1e9, 1e9);
    v.tunable(x + "quat", body.pose.quat, "1",
              "orientation of " + of + " in W, quaternion (w, x, y, z) of any length; 0: not turned")
        .range(-1e9, 1e9);
    v.tunable(x + "scale", body.scale, "1", "size of " + of + ", about its origin, as a multiple of that in the scene")
        .range(kLeastScale, kMostScale);
  };
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    const JointMeasures measures(&r.placed->model);
    JointVariables joints(v, measures);
    joints.input(r.prefix + "q", r.q, "rad", "joint position " + r.of + " at the step's end").essential();
    joints.input(r.prefix + "dq", r.dq, "rad/s", "joint velocity at the step's end, for distance_rate");
    declare_pose(v, r.base_prefix, r.base, "of its base", floating_, Velocity::kUsed);
    if (!r.prefix.empty()) declare_ports(v, r.ports, r.prefix, r.of);
    declare_tools(v, r);
    declare_before(v, r, floating_);
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    Body& body = *bodies_[k];
    const collision::Part& part = cell_.parts[k];
    if (body.comes) {
      declare_obstacle(body.prefix, body, "body " + part.name);
      continue;
    }
    declare_pose(v, body.prefix, body.pose, k == cloud_ ? "of the point cloud" : "of body " + part.name, part.moves,
                 Velocity::kUsed, body.kept);
    if (k == cloud_) {
      v.tunable(
           "cloud.r", cloud_r_, "m",
           "radius of the balls around the points of the cloud; default: half of the spacing that 95 % of them have, so that "
           "those balls touch")
          .range(0, 100);
    }
    if (part.moves) v.state(body.prefix + "before", body.pose.before, "1", "pose at the last step");
    if (!body.kept) continue;
    v.state(body.prefix + "lost", body.lost, "1", "1 while it is lost, how often it was, and when first, s");
    body.track.declare(v, body.prefix);
  }
  if (separates_) declare_separation(v);
}

}  // namespace cotwin::monitor
