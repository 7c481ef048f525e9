#include "components/contact_world/contact_world.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "components/contact_world/assemble.h"
#include "components/contact_world/foundation.h"
#include "components/contact_world/port_values.h"
#include "components/contact_world/robot_links.h"
#include "components/unit/joint_variables.h"
#include "models/robot/dynamics.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::contact_world {
namespace {

using Values = std::vector<double>;

/// (h ω)² of a gear and its link above which a step does not resolve their oscillation.
constexpr double kLargestResolved = 0.3;

/// h ω of a soft contact above which the mean force over a step misses more than 5 % of its peaks.
constexpr double kResolvedSwing = 1;

Eigen::Map<Eigen::Vector3d> vector3(Values& v) { return Eigen::Map<Eigen::Vector3d>(v.data()); }

}  // namespace

struct ContactWorld::Robot {
  Robot(const scene::PlacedRobot& robot)
      : placed(&robot),
        prefix(robot.name.empty() ? "" : identifier(robot.name) + "."),
        n(static_cast<std::size_t>(robot.model.n())),
        X_WL(robot.model.bodies.size()),
        V_WL(robot.model.bodies.size()) {
    for (Values* v : {&q0, &dq0, &K, &D, &B, &q, &dq, &tau_J, &dtheta, &q_link, &dq_link, &ddq, &tau_e, &dq_before, &tau,
                      &acceleration, &mobility}) {
      v->assign(n, 0.0);
    }
    const auto size = static_cast<Eigen::Index>(n);
    M.resize(size, size);
    inverse_root.resize(size, size);
    root.compute(Eigen::MatrixXd::Identity(size, size));
  }

  Eigen::Map<const Eigen::VectorXd> vector(const Values& v) const { return {v.data(), static_cast<Eigen::Index>(n)}; }

  const scene::PlacedRobot* placed;
  Link link = Link::kInside;
  std::string prefix;
  std::size_t n;
  Assembled parts;  // its bodies and joints in the world
  Pose X_WB;
  std::unique_ptr<robot::Mechanism> mechanism;  // with gravity in the base's frame
  std::unique_ptr<robot::Data> data;

  Values base_p0{0, 0, 0}, base_quat0{1, 0, 0, 0}, q0, dq0, K, D, B;  // parameters
  Values q, dq, tau_J, dtheta;                                        // inputs (q, dq: outputs with link outside)
  Values q_link, dq_link, ddq, tau_e, f_c{0, 0, 0}, base_p{0, 0, 0}, base_quat{1, 0, 0, 0};  // outputs
  Values base_v{0, 0, 0}, base_w{0, 0, 0}, base_f_c{0, 0, 0}, base_m_c{0, 0, 0}, base_f{0, 0, 0}, base_m{0, 0, 0};
  Values dq_before;  // state
  Values tau, acceleration;
  Eigen::MatrixXd M, inverse_root;
  Eigen::LLT<Eigen::MatrixXd> root;  // of M
  Values mobility;                   // diagonal of M⁻¹
  std::vector<Pose> X_WL;            // of all bodies
  std::vector<Twist> V_WL;
};

struct ContactWorld::Body {
  Body(const std::string& place, const scene::Body& body)
      : name(identifier(body.name)), motion(body.motion), foundation(place, name, body) {}

  std::string name, prefix;
  std::size_t index;  // in the world
  scene::Motion motion;
  Values p0{0, 0, 0}, quat0{1, 0, 0, 0};                                                    // parameters
  Values f{0, 0, 0}, m{0, 0, 0};                                                            // inputs of a dynamic body
  Values v_d{0, 0, 0}, w_d{0, 0, 0};                                                        // inputs of a driven one
  Values p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0}, f_c{0, 0, 0}, m_c{0, 0, 0};  // outputs
  Foundation foundation;
};

void ContactWorld::declare_settings(SettingList& s) {
  s.cell();
  s.choice("link", {"inside", "outside"},
           "which unit integrates the links of the robots: the drive train (q is an input) or this unit (q is an output)");
  s.choice("actuation", {"torque", "prescribed"},
           "with link=inside: tau_J drives the links, or q and dq prescribe their motion");
  s.choice("base", {"fixed", "floating"}, "the bases of the robots are fixed or move freely");
  s.choice("method", {"tree", "pgs", "dantzig"},
           "solver of (1): joint trees exactly and contacts by sweeps, projected Gauss-Seidel, or Dantzig's pivoting");
  s.integer("contacts", 256, 1, 1000000, "number of contact points that a step takes without allocating memory");
  s.integer("points", 8, 0, 1000, "number of contact points that are outputs");
  s.text("maximal", "", "with link=inside: names of robots, separated by commas, that this unit integrates all the same");
  s.integer("dents", 64, 1, 100000,
            "number of places where a surface that yields remembers its dents, then the oldest is forgotten");
}

ContactWorld::ContactWorld(Settings& settings)
    : place_(settings.unit()),
      cell_(settings.cell()),
      link_(settings.choice("link") == "inside" ? Link::kInside : Link::kOutside),
      actuation_(settings.choice("actuation") == "torque" ? Actuation::kTorque : Actuation::kPrescribed),
      floating_(settings.choice("base") == "floating") {
  const std::string method = settings.choice("method");
  options_.method = method == "tree" ? Method::kTree : method == "pgs" ? Method::kPgs : Method::kDantzig;
  options_.contacts = static_cast<std::size_t>(settings.integer("contacts"));
  options_.dents = static_cast<std::size_t>(settings.integer("dents"));
  shown_ = static_cast<std::size_t>(settings.integer("points"));
  iterations_ = options_.iterations;
  tolerance_ = options_.tolerance;
  if (floating_ && actuation_ == Actuation::kPrescribed) {
    throw Error(place_, "base=floating with actuation=prescribed: no base is recorded, expected actuation=torque");
  }
  if (actuation_ == Actuation::kPrescribed && link_ == Link::kOutside) {
    throw Error(place_, "actuation=prescribed with link=outside: no torque would drive the links, expected link=inside");
  }
  gravity_ = {cell_.scene.gravity.x(), cell_.scene.gravity.y(), cell_.scene.gravity.z()};
  for (const scene::PlacedRobot& placed : cell_.robots) {
    const std::string why = placed.model.base.inertia.unphysical();
    if (floating_ && !why.empty())
      throw Error(place_, "base=floating: the base of robot '" + placed.model.name + "' cannot float: " + why);
    robots_.push_back(std::make_unique<Robot>(placed));
    robots_.back()->link = link_;
  }
  const std::string maximal = settings.text("maximal");
  for (const std::string_view part : text::split(maximal, ',')) {
    if (part.empty()) continue;
    const std::string name(part);
    const auto robot = std::ranges::find_if(robots_, [&](const auto& r) { return r->placed->name == name; });
    if (robot == robots_.end())
      throw Error(place_, "maximal=" + name + ": there is no robot of this name in the setting robots");
    if (actuation_ == Actuation::kPrescribed)
      throw Error(place_,
                  "maximal=" + name + " with actuation=prescribed: no torque would drive it, expected actuation=torque");
    (*robot)->link = Link::kOutside;
  }
  for (std::size_t i = 0; i < cell_.scene.bodies.size(); ++i) {
    const scene::Body& body = cell_.scene.bodies[i];
    auto made = std::make_unique<Body>(place_, body);
    made->prefix = made->name + ".";
    made->index = i;
    vector3(made->p0) = body.X_WB.p;
    put_quaternion(body.X_WB.R, made->quat0);
    bodies_.push_back(std::move(made));
  }
  check_names();
  contact_p_.resize(3 * shown_);
  contact_f_.resize(3 * shown_);
  contact_gap_.resize(shown_);
  contact_bodies_.resize(2 * shown_);
  build();
  state_.resize(world_->state_size());
}

ContactWorld::~ContactWorld() = default;

/// Throws Error if two robots or bodies have the same prefix of variable names.
void ContactWorld::check_names() const {
  std::map<std::string, std::string> owners;
  const auto take = [&](const std::string& prefix, const std::string& owner) {
    const auto [other, is_new] = owners.emplace(prefix, owner);
    if (is_new) return;
    throw Error(place_, other->second + " and " + owner + " have the same variable prefix " + prefix +
                            ", expected names that differ in letters or digits");
  };
  for (const auto& robot : robots_) {
    if (!robot->prefix.empty()) take(robot->prefix, "robot '" + robot->placed->name + "'");
  }
  for (const auto& body : bodies_) take(body->prefix, "body '" + cell_.scene.bodies[body->index].name + "'");
}

void ContactWorld::declare_robot(Variables& v, Robot& r) {
  const std::string& x = r.prefix;
  const JointMeasures measures(&r.placed->model);
  JointVariables joints(v, measures);
  const bool outside = r.link == Link::kOutside;
  const std::string of = r.placed->name.empty() ? "of the robot" : "of robot " + r.placed->name;
  if (outside) {
    joints.output(x + "q", r.q, "rad",
                  "link-side joint position " + of + " at the end of the step, input of the drive train's (2c)");
    joints.output(x + "dq", r.dq, "rad/s", "link-side joint speed");
  } else {
    joints.input(x + "q", r.q, "rad", "link-side joint position " + of + ", output of the drive train's (2a)").essential();
    joints.input(x + "dq", r.dq, "rad/s", "link-side joint speed, the derivative of q");
  }
  const bool torque = actuation_ == Actuation::kTorque;
  if (torque) {
    joints.input(x + "tau_J", r.tau_J, "N.m", "joint torque of (2a) that drives the links").essential();
    auto dtheta = joints.input(x + "dtheta", r.dtheta, "rad/s",
                               "motor speed behind the gear; tau_J changes with it by (2c) within the step");
    if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) dtheta.essential();
  }
  joints.output(x + "tau_e", r.tau_e, "N.m", "external joint torque J^T F of the contacts in (2a), mean over the step")
      .discrete();
  joints.output(x + "q_link", r.q_link, "rad",
                "joint position of the links in the world at the end of the step, for either value of link");
  joints.output(x + "dq_link", r.dq_link, "rad/s", "joint speed of the links in the world");
  joints.output(x + "ddq_link", r.ddq, "rad/s2", "mean joint acceleration of the links over the step");
  v.output(x + "f_c", r.f_c, "N", "sum of the contact forces on the links, in W, mean over the step").discrete();
  v.parameter(x + "base_p0", r.base_p0, "m", "position of the base in W at the start");
  v.parameter(x + "base_quat0", r.base_quat0, "1", "orientation of the base in W at the start, unit quaternion (w, x, y, z)");
  auto q0 = joints.parameter(x + "q0", r.q0, "rad", "joint position at the start; link=outside");
  if (outside) q0.essential();
  joints.parameter(x + "dq0", r.dq0, "rad/s", "joint speed at the start; link=outside");
  if (torque) {
    joints
        .parameter(x + "K", r.K, "N.m/rad",
                   "joint stiffness of (2c) for the change of tau_J within a step; 0: tau_J is constant")
        .range(0, 1e9);
    joints.parameter(x + "D", r.D, "N.m.s/rad", "joint damping of the gear for the change of tau_J within a step")
        .range(0, 1e9);
  }
  if (torque && !outside) {
    joints
        .parameter(x + "B", r.B, "kg.m2",
                   "motor inertia behind the gear if the drive train's transmission is rigid; 0: elastic transmission")
        .range(0, 1e9);
  }
  joints.state(x + "dq_before", r.dq_before, "rad/s", "link=inside: dq at the start of the last step");
  v.output(x + "base_f_c", r.base_f_c, "N", "sum of the contact forces on the base, in W, mean over the step").discrete();
  v.output(x + "base_m_c", r.base_m_c, "N.m", "their moment about the base's origin, in W").discrete();
  if (!floating_) return;
  if (!outside) {
    v.input(x + "base_p", r.base_p, "m", "position of the floating base in W").essential();
    v.input(x + "base_quat", r.base_quat, "1", "its orientation in W, unit quaternion (w, x, y, z)").essential();
    v.input(x + "base_v", r.base_v, "m/s", "velocity of its origin in W");
    v.input(x + "base_w", r.base_w, "rad/s", "its angular velocity in W");
    v.output(x + "base_f", r.base_f, "N", "sum of the contact forces on base and links, in W, mean over the step").discrete();
    v.output(x + "base_m", r.base_m, "N.m", "their moment about the base's origin, in W").discrete();
    return;
  }
  v.output(x + "base_p", r.base_p, "m", "position of the floating base in W");
  v.output(x + "base_quat", r.base_quat, "1", "its orientation in W, unit quaternion (w, x, y, z)");
  v.output(x + "base_v", r.base_v, "m/s", "velocity of its origin in W");
  v.output(x + "base_w", r.base_w, "rad/s", "its angular velocity in W");
}

void ContactWorld::declare_body(Variables& v, Body& b) {
  const std::string& x = b.prefix;
  v.parameter(x + "p0", b.p0, "m", "position of body " + b.name + " in W at the start");
  v.parameter(x + "quat0", b.quat0, "1", "orientation of body " + b.name + " in W at the start, unit quaternion (w, x, y, z)");
  v.output(x + "f_c", b.f_c, "N", "sum of the contact forces on the body, in W, mean over the step").discrete();
  v.output(x + "m_c", b.m_c, "N.m", "their moment about the body's origin, in W").discrete();
  if (b.motion == scene::Motion::kStatic) return;
  if (b.motion == scene::Motion::kDynamic) {
    v.input(x + "f", b.f, "N", "external force on the body at its origin, in W");
    v.input(x + "m", b.m, "N.m", "external moment on the body, in W");
  } else {
    v.input(x + "v_d", b.v_d, "m/s", "prescribed velocity of the body's origin, in W");
    v.input(x + "w_d", b.w_d, "rad/s", "prescribed angular velocity of the body, in W");
  }
  v.output(x + "p", b.p, "m", "position of the body in W");
  v.output(x + "quat", b.quat, "1", "orientation of the body in W, unit quaternion (w, x, y, z) with w >= 0");
  v.output(x + "v", b.v, "m/s", "velocity of the body's origin, in W");
  v.output(x + "w", b.w, "rad/s", "angular velocity of the body, in W");
}

void ContactWorld::declare(Variables& v) {
  for (const auto& robot : robots_) declare_robot(v, *robot);
  for (const auto& body : bodies_) declare_body(v, *body);
  v.output("contacts", contacts_, "contact points in the step");
  v.output("penetration", penetration_, "m", "deepest interpenetration of two shapes");
  v.output("force", largest_force_, "N", "largest force at one contact point, mean over the step");
  v.output("joint_gap", joint_gap_, "m", "largest distance between the two anchors of a joint");
  v.output("energy", energy_, "J", "kinetic and potential energy of all moving bodies");
  v.output("iterations", used_iterations_, "sweeps or pivots of the solver in the step");
  v.output("residual", residual_, "m/s", "largest remaining violation of the complementarity conditions");
  v.output("degenerate", degenerate_, "redundant or contradicting constraints that were relaxed");
  v.output("grown", grown_, "number of steps with more contacts than the setting `contacts`, each of which allocated memory");
  v.parameter("gravity", gravity_, "m/s2", "gravity in W");
  v.parameter("max_iterations", iterations_, "largest number of sweeps of the solver in a step").range(1, 100000);
  v.parameter("tolerance", tolerance_, "m/s", "residual below which the sweeps end; 0: always max_iterations").range(0, 1);
  v.parameter("joint_gap_limit", joint_gap_limit_, "m",
              "gap of a joint that ends the run with an error, as does a tilt of 0.1 rad; 0: no check")
      .range(0, 1000);
  v.parameter("energy_limit", energy_limit_, "1",
              "energy gained without work that ends the run with an error, as a share of all that was available; 0: no check")
      .range(0, 1000);
  if (shown_ > 0) {
    v.output("contact_p", contact_p_, "m", "position in W of the first `points` contact points, x, y, z of each");
    v.output("contact_f", contact_f_, "N", "force in W on the second body at each of these points");
    v.output("contact_gap", contact_gap_, "m", "gap at each of these points; negative: interpenetration");
    v.output("contact_bodies", contact_bodies_,
             "the two bodies of each of these points: bodies of the scene from 1, then base and links of each robot; 0: none");
  }
  v.state("world", state_, "1", "poses, twists and the solver's warm start");
  v.state("h_before", h_before_, "s", "duration of the last step; 0: no step yet");
  v.output("impacts", impacts_, "rounds of impacts with restitution, one after the other");
  v.output("contact_swing", contact_swing_, "1",
           "largest h ω of a loaded soft contact, with its spring and the mobility behind it; above 1 `force` misses peaks");
  v.output("extended", extended_,
           "islands of contacts at rest that took more than max_iterations sweeps in the step, up to 50 times as many");
  for (const auto& body : bodies_) {
    if (body->foundation.any()) body->foundation.declare(v, body->prefix);
  }
}

void ContactWorld::build() {
  scene::Scene scene = cell_.scene;
  scene.gravity = {gravity_[0], gravity_[1], gravity_[2]};
  for (const auto& body : bodies_) {
    body->foundation.apply(scene.bodies[body->index]);
    scene.bodies[body->index].X_WB = pose_of(place_ + "." + body->name + ".quat0", body->p0, body->quat0);
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    const bool outside = r.link == Link::kOutside;
    r.X_WB = floating_ && !outside ? pose_of_input(place_, r.prefix, r.base_p, r.base_quat)
                                   : pose_of(place_ + "." + r.prefix + "base_quat0", r.base_p0, r.base_quat0);
    const Values& q = outside ? r.q0 : r.q;
    const Values& dq = outside ? r.dq0 : r.dq;
    r.parts = assemble(scene, *r.placed, r.X_WB, floating_ ? Base::kFloating : Base::kFixed, q, dq);
    robot::RobotModel turned = r.placed->model;
    turned.gravity = r.X_WB.R.transpose() * scene.gravity;
    r.mechanism = std::make_unique<robot::Mechanism>(turned);
    r.data = std::make_unique<robot::Data>(*r.mechanism);
    if (outside) continue;
    for (const std::size_t joint : r.parts.joints) {  // limits belong to the drive train
      scene.joints[joint].q_min = -scene::kInfinity;
      scene.joints[joint].q_max = scene::kInfinity;
    }
  }
  options_.iterations = iterations_;
  options_.tolerance = tolerance_;
  world_ = std::make_unique<World>(std::move(scene), options_);
  built_from_ = layout();
}

/// All parameters that build() reads, except start values of states.
std::vector<double> ContactWorld::layout() const {
  Values all = gravity_;
  const auto add = [&](const Values& v) { all.insert(all.end(), v.begin(), v.end()); };
  for (const auto& body : bodies_) {
    add(body->p0);
    add(body->quat0);
    if (body->foundation.any()) add(body->foundation.parameters());
  }
  for (const auto& robot : robots_) {
    add(robot->base_p0);
    add(robot->base_quat0);
  }
  all.push_back(iterations_);
  all.push_back(tolerance_);
  return all;
}

void ContactWorld::check_parameters() const {
  const auto check = [&](const std::string& owner, const char* name, const Values& v) {
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (std::isfinite(v[i])) continue;
      throw Error(place_ + "." + owner + name + "[" + std::to_string(i + 1) + "]",
                  "is " + text::to_text(v[i]) + ", expected a finite value");
    }
  };
  check("", "gravity", gravity_);
  for (const auto& r : robots_) {
    check(r->prefix, "base_p0", r->base_p0);
    check(r->prefix, "q0", r->q0);
    check(r->prefix, "dq0", r->dq0);
    check(r->prefix, "K", r->K);
    check(r->prefix, "D", r->D);
    check(r->prefix, "B", r->B);
  }
  for (const auto& b : bodies_) check(b->prefix, "p0", b->p0);
}

void ContactWorld::check_inputs(Time now) const {
  const auto check = [&](const std::string& owner, const char* name, const Values& v) {
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (std::isfinite(v[i])) continue;
      throw Error(place_ + "." + owner + name + "[" + std::to_string(i + 1) + "]",
                  "is " + text::to_text(v[i]) + " at " + text::to_text(now.seconds()) + " s, expected a finite value");
    }
  };
  for (const auto& r : robots_) {
    check(r->prefix, "q", r->q);
    check(r->prefix, "dq", r->dq);
    check(r->prefix, "tau_J", r->tau_J);
    check(r->prefix, "dtheta", r->dtheta);
    check(r->prefix, "base_p", r->base_p);
    check(r->prefix, "base_quat", r->base_quat);
    check(r->prefix, "base_v", r->base_v);
    check(r->prefix, "base_w", r->base_w);
  }
  for (const auto& b : bodies_) {
    check(b->prefix, "f", b->f);
    check(b->prefix, "m", b->m);
    check(b->prefix, "v_d", b->v_d);
    check(b->prefix, "w_d", b->w_d);
  }
}

void ContactWorld::initialise(Time start) {
  check_parameters();
  check_inputs(start);
  build();
  for (const auto& robot : robots_) {
    robot->dq_before = robot->dq;
    std::fill(robot->ddq.begin(), robot->ddq.end(), 0.0);
  }
  h_before_ = 0;
  largest_swing_ = 0;
  write_outputs(0);
}

/// Sets the links to the drive train's q, q̇ at the start of the step. The world then predicts their motion by (1) under τ_J and
/// the contacts, and the mean contact torque is the τ_e of the same step of the drive train. The prediction makes stiff
/// contacts stable. The next step starts from the drive train's result, not from the prediction.
void ContactWorld::set_links(Robot& r, double h) {
  if (floating_) r.X_WB = pose_of_input(place_, r.prefix, r.base_p, r.base_quat);
  place_links(r.placed->model, r.X_WB, r.q, r.dq, r.X_WL, r.V_WL);
  if (floating_) {
    const Eigen::Vector3d v = vector3(r.base_v), w = vector3(r.base_w);
    Twist V_WB;
    V_WB << v, w;
    world_->set_pose(r.parts.base, r.X_WB);
    world_->set_twist(r.parts.base, V_WB);
    for (std::size_t i = 0; i < r.X_WL.size(); ++i) {
      r.V_WL[i].head<3>() += v + w.cross(r.X_WL[i].p - r.X_WB.p);
      r.V_WL[i].tail<3>() += w;
    }
  }
  for (std::size_t i = 0; i < r.X_WL.size(); ++i) {
    world_->set_pose(r.parts.bodies[i], r.X_WL[i]);
    world_->set_twist(r.parts.bodies[i], r.V_WL[i]);
  }
  for (std::size_t i = 0; i < r.n; ++i) r.acceleration[i] = h_before_ > 0 ? (r.dq[i] - r.dq_before[i]) / h_before_ : 0;
  if (actuation_ == Actuation::kPrescribed) {
    apply_last_torque(r);
  } else {
    drive(r, h);
  }
  r.dq_before = r.dq;
}

/// actuation=prescribed: applies the torque that explains the last step by (2a), without the contacts.
void ContactWorld::apply_last_torque(Robot& r) {
  robot::inverse_dynamics(*r.mechanism, *r.data, r.vector(r.q), r.vector(r.dq), r.vector(r.acceleration),
                          Eigen::Map<Eigen::VectorXd>(r.tau.data(), static_cast<Eigen::Index>(r.n)));
  for (std::size_t i = 0; i < r.n; ++i) {
    world_->set_inertia(r.parts.joints[i], 0);
    world_->set_tau(r.parts.joints[i], r.tau[i] - r.tau_e[i]);
  }
}

/// τ_J at the start of the step contains K (θ − q) + D (θ̇ − q̇); its change within the step follows the motion of the link.
/// Where the step does not resolve the oscillation of link and gear, numerical damping like that of backward differences is
/// added: the two units see different phases of the oscillation and would otherwise excite each other. The damping bounds free
/// oscillations; in contact, a stiff undamped gear still makes the force alternate from step to step.
void ContactWorld::drive(Robot& r, double h) {
  if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) compute_mobility(r);
  for (std::size_t i = 0; i < r.n; ++i) {
    if (r.placed->model.joints[i].passive) continue;
    const double damper = r.D[i] * (r.dtheta[i] - r.dq[i]);
    const double swing = h * h * r.K[i] * r.mobility[i];  // (h ω)²
    const double numerical = swing > kLargestResolved ? h / 2 * r.K[i] * (1 - kLargestResolved / swing) : 0;
    world_->set_inertia(r.parts.joints[i], r.B[i]);
    const double tau = r.tau_J[i] + r.B[i] * r.acceleration[i];  // (2b): motor and friction torque of the last step
    world_->set_tau(r.parts.joints[i], tau - damper, r.K[i], std::max(r.D[i], numerical), r.dtheta[i]);
  }
}

void ContactWorld::compute_mobility(Robot& r) {
  robot::mass_matrix(*r.mechanism, *r.data, r.vector(r.q), r.M);
  r.root.compute(r.M);
  r.inverse_root.setIdentity();
  r.root.matrixL().solveInPlace(r.inverse_root);
  for (std::size_t i = 0; i < r.n; ++i) r.mobility[i] = r.inverse_root.col(static_cast<Eigen::Index>(i)).squaredNorm();
}

StepResult ContactWorld::step(Time now, Duration duration) {
  check_inputs(now);
  const double h = duration.seconds();
  for (const auto& robot : robots_) {
    if (robot->link == Link::kInside) {
      set_links(*robot, h);
    } else {
      drive(*robot, h);
    }
  }
  for (const auto& b : bodies_) {
    if (b->motion == scene::Motion::kDynamic) {
      Wrench F;
      F << vector3(b->f), vector3(b->m);
      world_->apply(b->index, F);
    } else if (b->motion == scene::Motion::kDriven) {
      Twist V;
      V << vector3(b->v_d), vector3(b->w_d);
      world_->set_twist(b->index, V);
    }
  }
  world_->step(h);
  h_before_ = h;
  write_outputs(h);
  const std::string fault = world_->fault(joint_gap_limit_, energy_limit_);
  if (!fault.empty()) throw Error(place_, "at " + text::to_text((now + duration).seconds()) + " s " + fault);
  return StepResult::kDone;
}

void ContactWorld::write_robot(Robot& r, double h) {
  for (std::size_t i = 0; i < r.n; ++i) {
    const double dq = world_->dq()[r.parts.joints[i]];
    const double dq_start = r.link == Link::kInside ? r.dq[i] : r.dq_link[i];
    r.ddq[i] = h > 0 ? (dq - dq_start) / h : 0;
    r.q_link[i] = world_->q()[r.parts.joints[i]];
    r.dq_link[i] = dq;
    if (r.link == Link::kOutside) {
      r.q[i] = r.q_link[i];
      r.dq[i] = dq;
    }
  }
  for (std::size_t i = 0; i < r.X_WL.size(); ++i) r.X_WL[i] = world_->poses()[r.parts.bodies[i]];
  std::fill(r.tau_e.begin(), r.tau_e.end(), 0.0);
  for (Values* f : {&r.f_c, &r.base_f_c, &r.base_m_c, &r.base_f, &r.base_m}) vector3(*f).setZero();
  if (!floating_ || r.link == Link::kInside) return;
  const Pose& X_WB = world_->poses()[r.parts.base];
  const Twist& V_WB = world_->twists()[r.parts.base];
  vector3(r.base_p) = X_WB.p;
  put_quaternion(X_WB.R, r.base_quat);
  vector3(r.base_v) = V_WB.head<3>();
  vector3(r.base_w) = V_WB.tail<3>();
}

void ContactWorld::add_contact(int body, const Eigen::Vector3d& p_W, const Eigen::Vector3d& f_W) {
  const auto index = static_cast<std::size_t>(body);
  if (index < bodies_.size()) {
    Body& b = *bodies_[index];
    vector3(b.f_c) += f_W;
    vector3(b.m_c) += (p_W - world_->poses()[index].p).cross(f_W);
    return;
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    const auto add_to_robot = [&] {
      vector3(r.base_f) += f_W;
      vector3(r.base_m) += (p_W - world_->poses()[r.parts.base].p).cross(f_W);
    };
    if (index == r.parts.base) {
      add_to_robot();
      vector3(r.base_f_c) += f_W;
      vector3(r.base_m_c) += (p_W - world_->poses()[index].p).cross(f_W);
      return;
    }
    const auto link = std::find(r.parts.bodies.begin(), r.parts.bodies.end(), index);
    if (link == r.parts.bodies.end()) continue;
    add_to_robot();
    vector3(r.f_c) += f_W;
    add_joint_torques(r.placed->model, r.X_WL, static_cast<int>(link - r.parts.bodies.begin()), p_W, f_W, r.tau_e);
    return;
  }
}

void ContactWorld::write_outputs(double h) {
  for (const auto& robot : robots_) write_robot(*robot, h);
  for (const auto& body : bodies_) {
    Body& b = *body;
    vector3(b.f_c).setZero();
    vector3(b.m_c).setZero();
    vector3(b.p) = world_->poses()[b.index].p;
    put_quaternion(world_->poses()[b.index].R, b.quat);
    vector3(b.v) = world_->twists()[b.index].head<3>();
    vector3(b.w) = world_->twists()[b.index].tail<3>();
  }

  for (const Yielding& one : world_->yielding()) {
    if (one.body < bodies_.size()) bodies_[one.body]->foundation.write(one);
  }
  const std::span<const ContactPoint> points = world_->contacts();
  const std::span<const Eigen::Vector3d> forces = world_->forces();
  std::fill(contact_p_.begin(), contact_p_.end(), 0.0);
  std::fill(contact_f_.begin(), contact_f_.end(), 0.0);
  std::fill(contact_gap_.begin(), contact_gap_.end(), 0.0);
  std::fill(contact_bodies_.begin(), contact_bodies_.end(), 0);
  penetration_ = largest_force_ = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ContactPoint& point = points[i];
    penetration_ = std::max(penetration_, -point.gap);
    largest_force_ = std::max(largest_force_, forces[i].norm());
    add_contact(point.body_b, point.p_W, forces[i]);
    add_contact(point.body_a, point.p_W, -forces[i]);
    if (i >= shown_) continue;
    Eigen::Map<Eigen::Vector3d>(contact_p_.data() + 3 * i) = point.p_W;
    Eigen::Map<Eigen::Vector3d>(contact_f_.data() + 3 * i) = forces[i];
    contact_gap_[i] = point.gap;
    contact_bodies_[2 * i] = point.body_a + 1;
    contact_bodies_[2 * i + 1] = point.body_b + 1;
  }
  const Status& status = world_->status();
  contacts_ = static_cast<std::int32_t>(points.size());
  used_iterations_ = status.iterations;
  residual_ = status.residual;
  degenerate_ = status.degenerate;
  extended_ = status.extended;
  grown_ = static_cast<std::int32_t>(status.grown);
  impacts_ = status.impacts;
  contact_swing_ = status.swing;
  largest_swing_ = std::max(largest_swing_, contact_swing_);
  joint_gap_ = world_->largest_gap();
  energy_ = world_->energy();
  world_->save(state_);
}

void ContactWorld::tell(std::vector<std::string>& notes) const {
  for (const auto& body : bodies_) body->foundation.tell(notes);
  if (world_->forgotten_dents() > 0) {
    notes.push_back(std::to_string(world_->forgotten_dents()) +
                    " dents were forgotten, expected more than dents=" + std::to_string(options_.dents));
  }
  if (largest_swing_ <= kResolvedSwing) return;
  notes.push_back("the step is " + text::to_text(std::round(10 * largest_swing_) / 10) +
                  " times 1/ω of the stiffest soft contact, expected at most 1: its force is a mean that misses peaks");
}

void ContactWorld::restored() {
  if (layout() != built_from_) build();
  world_->restore(state_);
}

}  // namespace cotwin::contact_world
