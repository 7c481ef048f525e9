#include "components/contact_world/contact_world.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "components/contact_world/parts.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/start.h"
#include "models/scene/robot_links.h"

namespace cotwin::contact_world {
namespace {

using Values = std::vector<double>;

}  // namespace

ContactWorld::ContactWorld(Settings& settings)
    : place_(settings.unit()),
      cell_(settings.cell()),
      link_(settings.choice("link_side") == "inside" ? LinkSide::kInside : LinkSide::kOutside),
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
  if (actuation_ == Actuation::kPrescribed && link_ == LinkSide::kOutside) {
    throw Error(place_,
                "actuation=prescribed with link_side=outside: no torque would drive the links, expected link_side=inside");
  }
  gravity_ = {cell_.scene.gravity.x(), cell_.scene.gravity.y(), cell_.scene.gravity.z()};
  for (const scene::PlacedRobot& placed : cell_.robots) {
    const std::string why = placed.model.base.inertia.unphysical();
    if (floating_ && !why.empty())
      throw Error(place_, "base=floating: the base of robot '" + placed.model.name + "' cannot float: " + why);
    robots_.push_back(std::make_unique<Robot>(placed));
    robots_.back()->link = link_;
    robots_.back()->place = place_ + (robots_.back()->prefix.empty() ? "" : "." + placed.name);
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
    (*robot)->link = LinkSide::kOutside;
  }
  for (std::size_t i = 0; i < cell_.scene.bodies.size(); ++i) {
    const scene::Body& body = cell_.scene.bodies[i];
    auto made = std::make_unique<Body>(place_, body);
    made->prefix = made->name + ".";
    made->index = i;
    made->jointed = std::ranges::any_of(cell_.scene.joints, [i](const scene::Joint& joint) {
      return joint.parent == static_cast<int>(i) || joint.child == static_cast<int>(i);
    });
    vector3(made->p0) = body.X_WB.p;
    put_quaternion(body.X_WB.R, made->quat0);
    vector3(made->v0) = body.V_WB.head<3>();
    vector3(made->w0) = body.V_WB.tail<3>();
    bodies_.push_back(std::move(made));
  }
  latches_ = LatchPort::read(place_, settings.text("latches"), cell_);
  const bool parts = std::ranges::any_of(bodies_, [](const auto& b) { return b->motion == scene::Motion::kDynamic; });
  loads_ = std::make_unique<Loads>(latches_.size(), parts && actuation_ == Actuation::kTorque);
  grips_.resize(loads_->grips * Loads::kNumbers);
  for (const auto& r : robots_) {
    r->J.resize(loads_->free.rows(), static_cast<Eigen::Index>(r->n));
    r->response.resize(static_cast<Eigen::Index>(r->n), loads_->free.rows());
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
  for (const LatchPort& latch : latches_) take(latch.name() + ".", "latch '" + latch.name() + "'");
}

void ContactWorld::build() {
  scene::Scene scene = cell_.scene;
  scene.gravity = {gravity_[0], gravity_[1], gravity_[2]};
  for (const auto& body : bodies_) {
    body->foundation.apply(scene.bodies[body->index]);
    scene::Body& placed = scene.bodies[body->index];
    placed.X_WB = pose_of(place_ + "." + body->name + ".quat0", body->p0, body->quat0);
    placed.V_WB << vector3(body->v0), vector3(body->w0);
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    const bool outside = r.link == LinkSide::kOutside;
    r.X_WB = floating_ && !outside ? pose_of_input(place_, r.prefix, "base_quat", r.base_p, r.base_quat)
                                   : pose_of(place_ + "." + r.prefix + "base_quat0", r.base_p0, r.base_quat0);
    const Values& q = outside ? r.q0 : r.q;
    const Values& dq = outside ? r.dq0 : r.dq;
    r.parts = assemble(scene, *r.placed, r.X_WB, floating_ ? Base::kFloating : Base::kFixed, q, dq);
    robot::RobotModel turned = r.placed->model;
    turned.gravity = r.X_WB.R.transpose() * scene.gravity;
    r.mechanism = std::make_unique<robot::Mechanism>(turned);
    r.data = std::make_unique<robot::Data>(*r.mechanism);
    r.inertias.set_gravity(turned.gravity);
    r.inertias.restored(*r.mechanism);
    for (std::size_t i = 0; i < r.parts.bodies.size(); ++i)
      scene.bodies[r.parts.bodies[i]].inertia = r.inertias.robot().bodies[i].inertia;
    if (outside) continue;
    for (const std::size_t joint : r.parts.joints) {  // limits belong to the drive train
      scene.joints[joint].q_min = -scene::kInfinity;
      scene.joints[joint].q_max = scene::kInfinity;
    }
  }
  for (const LatchPort& latch : latches_) {
    latch.add(scene, [&](const scene::PlacedFrame& end) {
      if (end.robot < 0) return end.body;
      const Assembled& parts = robots_[static_cast<std::size_t>(end.robot)]->parts;
      return static_cast<int>(end.body < 0 ? parts.base : parts.bodies[static_cast<std::size_t>(end.body)]);
    });
  }
  note_limits(scene);
  options_.iterations = iterations_;
  options_.tolerance = tolerance_;
  options_.friction_scale = friction_scale_;
  world_ = std::make_unique<World>(std::move(scene), options_);
  for (const auto& robot : robots_) show_tools(*robot, false);
  built_from_ = layout();
}

/// Notes the joints of the scene that start beyond a limit, because 0 is: position correction brings them back slowly.
void ContactWorld::note_limits(const scene::Scene& scene) {
  beyond_limits_.clear();
  constexpr double kRounding = 1e-9;
  for (const scene::Joint& joint : scene.joints) {
    const bool below = joint.q < joint.q_min - kRounding;
    if (!below && !(joint.q > joint.q_max + kRounding)) continue;
    const std::string si = joint.type == scene::JointType::kPrismatic ? " m" : " rad";
    beyond_limits_.push_back("joint '" + joint.name + "' starts at " + text::to_text(joint.q, 6) + si + ", beyond its " +
                             (below ? "lower" : "upper") + " limit " + text::to_text(below ? joint.q_min : joint.q_max, 6) +
                             si + ": it is brought back slowly");
  }
}

/// All parameters that build() reads, except start values of states and tunables.
std::vector<double> ContactWorld::layout() const {
  Values all = gravity_;
  const auto add = [&](const Values& v) { all.insert(all.end(), v.begin(), v.end()); };
  for (const auto& body : bodies_) {
    add(body->p0);
    add(body->quat0);
    add(body->v0);
    add(body->w0);
  }
  for (const auto& robot : robots_) {
    add(robot->base_p0);
    add(robot->base_quat0);
  }
  all.push_back(iterations_);
  all.push_back(tolerance_);
  all.push_back(friction_scale_);
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
    if (r->link == LinkSide::kOutside)
      robot::check_start(place_ + (r->prefix.empty() ? "" : "." + r->placed->name), r->placed->model, r->q0);
    check(r->prefix, "K", r->K);
    check(r->prefix, "D", r->D);
    check(r->prefix, "B", r->B);
  }
  for (const auto& b : bodies_) {
    for (const auto& [name, v] : {std::pair{"p0", &b->p0}, {"v0", &b->v0}, {"w0", &b->w0}}) check(b->prefix, name, *v);
  }
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
    check(r->prefix, "tau_other", r->tau_other);
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
  for (const auto& robot : robots_) {
    robot->inertias.take(robot->place, *robot->mechanism);
    robot->tools_in_force = robot->tools_wanted;
  }
  for (const auto& body : bodies_) body->foundation.take();
  for (LatchPort& latch : latches_) latch.reset();
  build();
  for (const auto& robot : robots_) {
    robot->dq_before = robot->dq;
    robot->q_before = robot->q;
    std::fill(robot->ddq.begin(), robot->ddq.end(), 0.0);
  }
  h_before_ = 0;
  largest_swing_ = 0;
  unsolved_time_ = largest_unsolved_ = 0;
  write_outputs(start.seconds(), 0);
}

/// Adds or removes the shapes of the robot's tools: those in force that are there, or all.
void ContactWorld::show_tools(const Robot& r, bool all) {
  for (std::size_t k = 0; k < r.tools.size(); ++k) {
    const bool present = r.tools_in_force[k] != 0;
    if (!present && !all) continue;
    world_->set_tool(r.parts.base, r.tools[k], present);
    for (const std::size_t body : r.parts.bodies) world_->set_tool(body, r.tools[k], present);
  }
}

/// Brings changed bodies of the robot, such as those with a tool, into force at once.
void ContactWorld::set_bodies(Robot& r) {
  if (r.tools_wanted != r.tools_in_force) {
    r.tools_in_force = r.tools_wanted;
    show_tools(r, true);
  }
  if (!r.inertias.follow(r.place, 0, *r.mechanism)) return;
  for (std::size_t i = 0; i < r.parts.bodies.size(); ++i)
    world_->set_body(r.parts.bodies[i], r.inertias.robot().bodies[i].inertia);
}

StepResult ContactWorld::step(Time now, Duration duration) {
  check_inputs(now);
  const double h = duration.seconds();
  for (const auto& body : bodies_) {
    if (body->foundation.any()) body->foundation.follow(place_, body->name, *world_, body->index);
  }
  for (const auto& robot : robots_) {
    set_bodies(*robot);
    if (robot->link == LinkSide::kInside) {
      set_links(*robot, h);
    } else {
      drive(*robot, h);
    }
  }
  carry_loads();
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
  for (std::size_t i = 0; i < latches_.size(); ++i) {
    const bool was_closed = world_->latches()[i].closed;
    latches_[i].follow(place_, *world_, i, now.seconds());
    for (const auto& r : robots_) {  // its drive train loses the speed that this unit takes from the links
      if (!was_closed && world_->latches()[i].closed && gives_loads(*r)) world_->leave_out(r->parts.bodies.back());
    }
  }
  world_->step(h);
  h_before_ = h;
  write_outputs((now + duration).seconds(), h);
  const std::string fault = world_->fault(joint_gap_limit_, energy_limit_);
  if (!fault.empty()) throw Error(place_, "at " + text::to_text((now + duration).seconds()) + " s " + fault);
  return StepResult::kDone;
}

void ContactWorld::write_robot(Robot& r, double h) {
  for (std::size_t i = 0; i < r.n; ++i) {
    const double dq = world_->dq()[r.parts.joints[i]];
    const double dq_start = r.link == LinkSide::kInside ? r.dq[i] : r.dq_link[i];
    r.ddq[i] = h > 0 ? (dq - dq_start) / h : 0;
    r.q_link[i] = world_->q()[r.parts.joints[i]];
    r.dq_link[i] = dq;
    if (r.link == LinkSide::kOutside) {
      r.q[i] = r.q_link[i];
      r.dq[i] = dq;
    }
  }
  for (std::size_t i = 0; i < r.X_WL.size(); ++i) r.X_WL[i] = world_->poses()[r.parts.bodies[i]];
  for (std::size_t i = 0; i < r.n; ++i) r.tau_e[i] = r.mean_other(i, h);
  std::ranges::fill(r.tau_l, 0.0);
  for (Values* f : {&r.f_c, &r.base_f_c, &r.base_m_c, &r.base_f, &r.base_m}) vector3(*f).setZero();
  if (!floating_ || r.link == LinkSide::kInside) return;
  const Pose& X_WB = world_->poses()[r.parts.base];
  const Twist& V_WB = world_->twists()[r.parts.base];
  vector3(r.base_p) = X_WB.p;
  put_quaternion(X_WB.R, r.base_quat);
  vector3(r.base_v) = V_WB.head<3>();
  vector3(r.base_w) = V_WB.tail<3>();
}

void ContactWorld::add_contact(int body, const Eigen::Vector3d& p_W, const Eigen::Vector3d& f_W, bool grips) {
  const auto index = static_cast<std::size_t>(body);
  if (index < bodies_.size()) {
    Body& b = *bodies_[index];
    vector3(b.f_c) += f_W;
    const Eigen::Vector3d moment = (p_W - world_->poses()[index].p).cross(f_W);
    vector3(b.m_c) += moment;
    if (!grips) b.outer += (Wrench() << f_W, moment).finished();
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
    scene::add_joint_torques(r.placed->model, r.X_WL, static_cast<int>(link - r.parts.bodies.begin()), p_W, f_W,
                             grips ? r.tau_l : r.tau_e);
    return;
  }
}

void ContactWorld::write_outputs(double now, double h) {
  for (const auto& robot : robots_) write_robot(*robot, h);
  std::ranges::fill(grips_, 0.0);
  loads_->gripping = 0;
  for (const auto& body : bodies_) {
    Body& b = *body;
    b.outer.setZero();
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
    const bool in_grip = grips(point, forces[i]);
    if (in_grip) add_grip(i, h);
    add_contact(point.body_b, point.p_W, forces[i], in_grip);
    add_contact(point.body_a, point.p_W, -forces[i], in_grip);
    if (i >= shown_) continue;
    Eigen::Map<Eigen::Vector3d>(contact_p_.data() + 3 * i) = point.p_W;
    Eigen::Map<Eigen::Vector3d>(contact_f_.data() + 3 * i) = forces[i];
    contact_gap_[i] = point.gap;
    contact_bodies_[2 * i] = point.body_a + 1;
    contact_bodies_[2 * i + 1] = point.body_b + 1;
  }
  for (std::size_t i = 0; i < latches_.size(); ++i) {
    const Latch& latch = world_->latches()[i];
    latches_[i].write(latch, now, h);
    const Wrench& F = latches_[i].wrench();
    if (F.isZero(0)) continue;
    add_latch(latch.joint.child, latch.joint.p_child, F);
    add_latch(latch.joint.parent, latch.joint.p_child, -F);
  }
  for (const auto& r : robots_) {
    for (std::size_t i = 0; i < r->n; ++i) r->tau_e[i] += r->tau_l[i];
  }
  write_loads(h);
  const Status& status = world_->status();
  contacts_ = static_cast<std::int32_t>(points.size());
  used_iterations_ = status.iterations;
  residual_ = status.residual;
  degenerate_ = status.degenerate;
  extended_ = status.extended;
  unsolved_ = status.unsolved;
  if (unsolved_ > 0) unsolved_time_ += h;
  if (unsolved_ > 0) largest_unsolved_ = std::max(largest_unsolved_, residual_);
  grown_ = static_cast<std::int32_t>(status.grown);
  impacts_ = status.impacts;
  contact_swing_ = status.swing;
  largest_swing_ = std::max(largest_swing_, contact_swing_);
  joint_gap_ = world_->largest_gap();
  energy_ = world_->energy();
  world_->save(state_);
}

void ContactWorld::restored() {
  if (layout() != built_from_) build();
  for (const auto& body : bodies_) {
    if (body->foundation.any()) body->foundation.restored(*world_, body->index);
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    r.inertias.restored(*r.mechanism);
    for (std::size_t i = 0; i < r.parts.bodies.size(); ++i)
      world_->set_body(r.parts.bodies[i], r.inertias.robot().bodies[i].inertia);
    show_tools(r, true);
  }
  world_->restore(state_);
  find_loads(h_before_);
}

}  // namespace cotwin::contact_world
