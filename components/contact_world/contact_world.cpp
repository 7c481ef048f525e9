#include "components/contact_world/contact_world.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "components/contact_world/assemble.h"
#include "components/contact_world/robot_links.h"
#include "models/robot/dynamics.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::contact_world {
namespace {

using Values = std::vector<double>;

/// (h ω)² of a gear and its link from which a step no longer resolves how they swing against each other.
constexpr double kResolved = 0.3;

Eigen::Map<Eigen::Vector3d> vector3(Values& v) { return Eigen::Map<Eigen::Vector3d>(v.data()); }

/// The pose that a place and a quaternion (w, x, y, z) give. Throws Error for a quaternion that is none.
Pose pose_of(const std::string& place, const Values& p, const Values& quat) {
  const Eigen::Quaterniond Q(quat[0], quat[1], quat[2], quat[3]);
  if (!(std::abs(Q.norm() - 1) < 1e-6)) {
    throw Error(place, "the quaternion (w, x, y, z) has the length " + text::to_text(Q.norm()) + ", expected 1");
  }
  return {Q.normalized().toRotationMatrix(), {p[0], p[1], p[2]}};
}

/// As (w, x, y, z), of the two the one with w ≥ 0.
void put_quaternion(const Eigen::Matrix3d& R, Values& quat) {
  Eigen::Quaterniond Q(R);
  if (Q.w() < 0) Q.coeffs() = -Q.coeffs();
  quat = {Q.w(), Q.x(), Q.y(), Q.z()};
}

/// A name as variables have it: what is no letter, digit, dot or underscore becomes one.
std::string identifier(const std::string& name) {
  std::string id = name;
  for (char& c : id) {
    const bool fits = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
    if (!fits) c = '_';
  }
  if (id.empty() || (id.front() >= '0' && id.front() <= '9')) id.insert(0, "_");
  return id;
}

}  // namespace

struct ContactWorld::Robot {
  Robot(const scene::PlacedRobot& robot)
      : placed(&robot),
        prefix(robot.name.empty() ? "" : identifier(robot.name) + "."),
        n(static_cast<std::size_t>(robot.model.n())),
        X_WL(n),
        V_WL(n) {
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
  std::string prefix;
  std::size_t n;
  Assembled parts;  // which bodies and joints of the world are its own
  Pose X_WB;
  std::unique_ptr<robot::Mechanism> mechanism;  // its base turned as it stands
  std::unique_ptr<robot::Data> data;

  Values base_p0{0, 0, 0}, base_quat0{1, 0, 0, 0}, q0, dq0, K, D, B;  // parameters
  Values q, dq, tau_J, dtheta;                                        // inputs (q, dq: outputs with link outside)
  Values q_link, dq_link, ddq, tau_e, f_c{0, 0, 0}, base_p{0, 0, 0}, base_quat{1, 0, 0, 0};  // outputs
  Values base_v{0, 0, 0}, base_w{0, 0, 0}, base_f_c{0, 0, 0}, base_m_c{0, 0, 0};
  Values dq_before;  // state
  Values tau, acceleration;
  Eigen::MatrixXd M, inverse_root;
  Eigen::LLT<Eigen::MatrixXd> root;  // of M
  Values mobility;                   // diagonal of M⁻¹
  std::vector<Pose> X_WL;
  std::vector<Twist> V_WL;
};

struct ContactWorld::Body {
  std::string name, prefix;
  std::size_t index;  // in the world
  scene::Motion motion;
  Values p0{0, 0, 0}, quat0{1, 0, 0, 0};                                                    // parameters
  Values f{0, 0, 0}, m{0, 0, 0};                                                            // inputs of a dynamic body
  Values v_d{0, 0, 0}, w_d{0, 0, 0};                                                        // inputs of a driven one
  Values p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0}, f_c{0, 0, 0}, m_c{0, 0, 0};  // outputs
};

void ContactWorld::declare_settings(SettingList& s) {
  s.cell();
  s.choice("link", {"inside", "outside"},
           "where the links of the robots move: in the drive train, whose q is an input here, or in this unit, which gives q");
  s.choice("actuation", {"torque", "prescribed"},
           "with link=inside: the links are driven by tau_J, or move as q and dq prescribe");
  s.choice("base", {"fixed", "floating"}, "whether the bases of the robots stand still or move, with link=outside");
  s.choice("method", {"tree", "pgs", "dantzig"},
           "solver of (1): joint trees solved exactly and contacts swept, projected Gauss-Seidel, or Dantzig's pivoting");
  s.integer("contacts", 256, 1, 1000000, "number of contact points that a step takes without allocating memory");
  s.integer("points", 8, 0, 1000, "number of contact points that are outputs");
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
  shown_ = static_cast<std::size_t>(settings.integer("points"));
  iterations_ = options_.iterations;
  tolerance_ = options_.tolerance;
  if (floating_ && link_ == Link::kInside) {
    throw Error(place_,
                "base=floating with link=inside: a drive train's links stand on a base that rests, expected link=outside");
  }
  if (actuation_ == Actuation::kPrescribed && link_ == Link::kOutside) {
    throw Error(place_, "actuation=prescribed with link=outside: the links would move by no torque, expected link=inside");
  }
  gravity_ = {cell_.scene.gravity.x(), cell_.scene.gravity.y(), cell_.scene.gravity.z()};
  for (const scene::PlacedRobot& placed : cell_.robots) robots_.push_back(std::make_unique<Robot>(placed));
  for (std::size_t i = 0; i < cell_.scene.bodies.size(); ++i) {
    const scene::Body& body = cell_.scene.bodies[i];
    auto made = std::make_unique<Body>();
    made->name = identifier(body.name);
    made->prefix = made->name + ".";
    made->index = i;
    made->motion = body.motion;
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

/// Every robot and body owns the variables that begin with its name.
void ContactWorld::check_names() const {
  std::map<std::string, std::string> owners;
  const auto take = [&](const std::string& prefix, const std::string& owner) {
    const auto [other, is_new] = owners.emplace(prefix, owner);
    if (is_new) return;
    throw Error(place_, other->second + " and " + owner + " would both name their variables " + prefix +
                            "…, expected names that differ in letters or digits");
  };
  for (const auto& robot : robots_) {
    if (!robot->prefix.empty()) take(robot->prefix, "robot '" + robot->placed->name + "'");
  }
  for (const auto& body : bodies_) take(body->prefix, "body '" + cell_.scene.bodies[body->index].name + "'");
}

void ContactWorld::declare_robot(Variables& v, Robot& r) {
  const std::string& x = r.prefix;
  const bool outside = link_ == Link::kOutside;
  const std::string of = r.placed->name.empty() ? "of the robot" : "of robot " + r.placed->name;
  if (outside) {
    v.output(x + "q", r.q, "rad", "link-side joint position " + of + " at the end of the step, for the drive train's (2c)");
    v.output(x + "dq", r.dq, "rad/s", "link-side joint speed");
  } else {
    v.input(x + "q", r.q, "rad", "link-side joint position " + of + " as the drive train's (2a) has it").essential();
    v.input(x + "dq", r.dq, "rad/s", "link-side joint speed, the derivative of q");
  }
  const bool torque = actuation_ == Actuation::kTorque;
  if (torque) {
    v.input(x + "tau_J", r.tau_J, "N.m", "joint torque of (2a) that drives the links").essential();
    auto dtheta =
        v.input(x + "dtheta", r.dtheta, "rad/s", "motor speed behind the gear, by which tau_J follows (2c) within the step");
    if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) dtheta.essential();
  }
  v.output(x + "tau_e", r.tau_e, "N.m", "external joint torque J^T F of the contacts in (2a), mean over the step").discrete();
  v.output(x + "q_link", r.q_link, "rad", "joint position of the links in the world at the end of the step, with either link");
  v.output(x + "dq_link", r.dq_link, "rad/s", "joint speed of the links in the world");
  v.output(x + "ddq_link", r.ddq, "rad/s2", "mean joint acceleration of the links over the step");
  v.output(x + "f_c", r.f_c, "N", "sum of the contact forces on the links, in W, mean over the step").discrete();
  v.parameter(x + "base_p0", r.base_p0, "m", "where the base stands in W at the start");
  v.parameter(x + "base_quat0", r.base_quat0, "1", "orientation of the base in W at the start, unit quaternion (w, x, y, z)");
  auto q0 = v.parameter(x + "q0", r.q0, "rad", "joint position at the start; link=outside");
  if (outside) q0.essential();
  v.parameter(x + "dq0", r.dq0, "rad/s", "joint speed at the start; link=outside");
  if (torque) {
    v.parameter(x + "K", r.K, "N.m/rad",
                "joint stiffness of (2c), by which tau_J follows the gear within a step; 0: tau_J is held")
        .range(0, 1e9);
    v.parameter(x + "D", r.D, "N.m.s/rad", "joint damping of the gear, likewise").range(0, 1e9);
  }
  if (torque && !outside) {
    v.parameter(x + "B", r.B, "kg.m2",
                "motor inertia behind the gear where the drive train's transmission is rigid; 0: it is behind K")
        .range(0, 1e9);
  }
  v.state(x + "dq_before", r.dq_before, "rad/s", "link=inside: dq at the start of the last step");
  v.output(x + "base_f_c", r.base_f_c, "N", "sum of the contact forces on the base, in W, mean over the step").discrete();
  v.output(x + "base_m_c", r.base_m_c, "N.m", "their moment about the base's origin, in W").discrete();
  if (!floating_) return;
  v.output(x + "base_p", r.base_p, "m", "place of the floating base in W");
  v.output(x + "base_quat", r.base_quat, "1", "its orientation in W, unit quaternion (w, x, y, z)");
  v.output(x + "base_v", r.base_v, "m/s", "velocity of its origin in W");
  v.output(x + "base_w", r.base_w, "rad/s", "its angular velocity in W");
}

void ContactWorld::declare_body(Variables& v, Body& b) {
  const std::string& x = b.prefix;
  v.parameter(x + "p0", b.p0, "m", "place of body " + b.name + " in W at the start");
  v.parameter(x + "quat0", b.quat0, "1", "orientation of body " + b.name + " in W at the start, unit quaternion (w, x, y, z)");
  v.output(x + "f_c", b.f_c, "N", "sum of the contact forces on the body, in W, mean over the step").discrete();
  v.output(x + "m_c", b.m_c, "N.m", "their moment about the body's origin, in W").discrete();
  if (b.motion == scene::Motion::kStatic) return;
  if (b.motion == scene::Motion::kDynamic) {
    v.input(x + "f", b.f, "N", "external force on the body at its origin, in W");
    v.input(x + "m", b.m, "N.m", "external moment on the body, in W");
  } else {
    v.input(x + "v_d", b.v_d, "m/s", "velocity of the body's origin, in W, that it is driven with");
    v.input(x + "w_d", b.w_d, "rad/s", "angular velocity, in W, that it is driven with");
  }
  v.output(x + "p", b.p, "m", "place of the body in W");
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
  v.output("joint_gap", joint_gap_, "m", "how far the anchors of a joint have come apart, the largest");
  v.output("energy", energy_, "J", "kinetic and potential energy of all bodies that move");
  v.output("iterations", used_iterations_, "sweeps and pivots that the solver made");
  v.output("residual", residual_, "m/s", "largest violation of the complementarity conditions that it left");
  v.output("degenerate", degenerate_, "constraints that were redundant or contradicted each other, and were relaxed");
  v.output("grown", grown_, "times that more contacts came than the setting `contacts` says, and memory was allocated");
  v.parameter("gravity", gravity_, "m/s2", "gravity in W");
  v.parameter("max_iterations", iterations_, "sweeps of the solver at most, in a step").range(1, 100000);
  v.parameter("tolerance", tolerance_, "m/s", "residual below which the sweeps end; 0: all are made").range(0, 1);
  if (shown_ > 0) {
    v.output("contact_p", contact_p_, "m",
             "place in W of each contact point, the first `points` of them; (x, y, z) after (x, y, z)");
    v.output("contact_f", contact_f_, "N", "force in W at each of them, on the second body");
    v.output("contact_gap", contact_gap_, "m", "their gaps; negative: interpenetration");
    v.output("contact_bodies", contact_bodies_,
             "their two bodies, counted from 1 through those of the scene, then each robot's base and links; 0: none");
  }
  v.state("world", state_, "1", "poses, twists and the solver's warm start");
  v.state("h_before", h_before_, "s", "duration of the last step; 0: there was none");
}

void ContactWorld::build() {
  scene::Scene scene = cell_.scene;
  scene.gravity = {gravity_[0], gravity_[1], gravity_[2]};
  for (const auto& body : bodies_) {
    scene.bodies[body->index].X_WB = pose_of(place_ + "." + body->name + ".quat0", body->p0, body->quat0);
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    r.X_WB = pose_of(place_ + "." + r.prefix + "base_quat0", r.base_p0, r.base_quat0);
    const Values& q = link_ == Link::kOutside ? r.q0 : r.q;
    const Values& dq = link_ == Link::kOutside ? r.dq0 : r.dq;
    r.parts = assemble(scene, *r.placed, r.X_WB, floating_ ? Base::kFloating : Base::kFixed, q, dq);
    robot::RobotModel turned = r.placed->model;
    turned.gravity = r.X_WB.R.transpose() * scene.gravity;
    r.mechanism = std::make_unique<robot::Mechanism>(turned);
    r.data = std::make_unique<robot::Data>(*r.mechanism);
    if (link_ == Link::kOutside) continue;
    for (const std::size_t joint : r.parts.joints) {  // the drive train's to keep
      scene.joints[joint].q_min = -scene::kInfinity;
      scene.joints[joint].q_max = scene::kInfinity;
    }
  }
  options_.iterations = iterations_;
  options_.tolerance = tolerance_;
  world_ = std::make_unique<World>(std::move(scene), options_);
  built_from_ = layout();
}

/// All parameters that build() reads, but for start values of states.
std::vector<double> ContactWorld::layout() const {
  Values all = gravity_;
  const auto add = [&](const Values& v) { all.insert(all.end(), v.begin(), v.end()); };
  for (const auto& body : bodies_) {
    add(body->p0);
    add(body->quat0);
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
  write_outputs(0);
}

/// The links are put where the drive train has them at the step's start, and go through the step by (1) as they will go there
/// by (2a): under τ_J and the contacts, whose mean is the τ_e of that very step. This forecast is what makes stiff contacts
/// stable; the next step begins where the drive train came to instead.
void ContactWorld::place(Robot& r, double h) {
  place_links(r.placed->model, r.X_WB, r.q, r.dq, r.X_WL, r.V_WL);
  for (std::size_t i = 0; i < r.n; ++i) {
    world_->set_pose(r.parts.bodies[i], r.X_WL[i]);
    world_->set_twist(r.parts.bodies[i], r.V_WL[i]);
  }
  for (std::size_t i = 0; i < r.n; ++i) r.acceleration[i] = h_before_ > 0 ? (r.dq[i] - r.dq_before[i]) / h_before_ : 0;
  if (actuation_ == Actuation::kPrescribed) {
    carry(r);
  } else {
    drive(r, h);
  }
  r.dq_before = r.dq;
}

/// actuation=prescribed: what drove the links besides the contacts in the last step, (2a), goes on.
void ContactWorld::carry(Robot& r) {
  robot::inverse_dynamics(*r.mechanism, *r.data, r.vector(r.q), r.vector(r.dq), r.vector(r.acceleration),
                          Eigen::Map<Eigen::VectorXd>(r.tau.data(), static_cast<Eigen::Index>(r.n)));
  for (std::size_t i = 0; i < r.n; ++i) {
    world_->set_inertia(r.parts.joints[i], 0);
    world_->set_tau(r.parts.joints[i], r.tau[i] - r.tau_e[i]);
  }
}

/// τ_J at the step's start, which has K (θ − q) + D (θ̇ − q̇) in it, goes on as the gear gives it while the link moves. Where the
/// step is too long to follow how link and gear swing against each other, they are damped as backward differences would: the
/// two units see different phases of such a motion, and without damping each would drive the other. It bounds the swing where
/// motions are free; in contact a gear that is stiff and undamped still makes the force alternate from step to step.
void ContactWorld::drive(Robot& r, double h) {
  if (std::any_of(r.K.begin(), r.K.end(), [](double K) { return K > 0; })) weigh(r);
  for (std::size_t i = 0; i < r.n; ++i) {
    const double damper = r.D[i] * (r.dtheta[i] - r.dq[i]);
    const double swing = h * h * r.K[i] * r.mobility[i];  // (h ω)²
    const double numerical = swing > kResolved ? h / 2 * r.K[i] * (1 - kResolved / swing) : 0;
    world_->set_inertia(r.parts.joints[i], r.B[i]);
    const double tau = r.tau_J[i] + r.B[i] * r.acceleration[i];  // (2b): what motor and friction give, as in the last step
    world_->set_tau(r.parts.joints[i], tau - damper, r.K[i], std::max(r.D[i], numerical), r.dtheta[i]);
  }
}

void ContactWorld::weigh(Robot& r) {
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
    if (link_ == Link::kInside) {
      place(*robot, h);
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
  return StepResult::kDone;
}

void ContactWorld::write_robot(Robot& r, double h) {
  for (std::size_t i = 0; i < r.n; ++i) {
    const double dq = world_->dq()[r.parts.joints[i]];
    const double dq_start = link_ == Link::kInside ? r.dq[i] : r.dq_link[i];
    r.ddq[i] = h > 0 ? (dq - dq_start) / h : 0;
    r.q_link[i] = world_->q()[r.parts.joints[i]];
    r.dq_link[i] = dq;
    if (link_ == Link::kOutside) {
      r.q[i] = r.q_link[i];
      r.dq[i] = dq;
    }
    r.X_WL[i] = world_->poses()[r.parts.bodies[i]];
  }
  std::fill(r.tau_e.begin(), r.tau_e.end(), 0.0);
  for (Values* f : {&r.f_c, &r.base_f_c, &r.base_m_c}) vector3(*f).setZero();
  if (!floating_) return;
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
    if (index == r.parts.base) {
      vector3(r.base_f_c) += f_W;
      vector3(r.base_m_c) += (p_W - world_->poses()[index].p).cross(f_W);
      return;
    }
    const auto link = std::find(r.parts.bodies.begin(), r.parts.bodies.end(), index);
    if (link == r.parts.bodies.end()) continue;
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
  grown_ = static_cast<std::int32_t>(status.grown);
  joint_gap_ = world_->largest_gap();
  energy_ = world_->energy();
  world_->save(state_);
}

void ContactWorld::restored() {
  if (layout() != built_from_) build();
  world_->restore(state_);
}

}  // namespace cotwin::contact_world
