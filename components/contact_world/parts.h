#pragma once
#include <Eigen/Cholesky>
#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "components/contact_world/assemble.h"
#include "components/contact_world/contact_world.h"
#include "components/contact_world/foundation.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"
#include "models/robot/body_parameters.h"
#include "models/robot/dynamics.h"
#include "models/robot/start.h"

/// The robots and bodies of the unit, with their variables.
namespace cotwin::contact_world {

inline Eigen::Map<Eigen::Vector3d> vector3(std::vector<double>& v) { return Eigen::Map<Eigen::Vector3d>(v.data()); }

struct ContactWorld::Robot {
  Robot(const scene::PlacedRobot& robot)
      : placed(&robot),
        prefix(robot.name.empty() ? "" : text::identifier(robot.name) + "."),
        n(static_cast<std::size_t>(robot.model.n())),
        inertias(robot.model),
        X_WL(robot.model.bodies.size()),
        V_WL(robot.model.bodies.size()) {
    for (std::vector<double>* v : {&q0, &dq0, &K, &D, &B, &q, &dq, &tau_J, &dtheta, &q_link, &dq_link, &ddq, &tau_e, &dq_before,
                                   &tau_other, &tau_other_rate, &tau, &acceleration, &mobility}) {
      v->assign(n, 0.0);
    }
    for (std::vector<double>* v : {&load_torque, &load_damping, &damping, &q_before, &tau_l}) {
      v->assign(n, 0.0);
    }
    load_factor.assign(n * n, 0.0);
    for (std::size_t i = 0; i < n; ++i) q0[i] = robot::default_start(robot.model.joints[i]);
    for (const std::vector<scene::Shape>& shapes : robot.shapes) {
      for (const scene::Shape& shape : shapes) {
        if (!shape.tool.empty() && std::ranges::find(tools, shape.tool) == tools.end()) tools.push_back(shape.tool);
      }
    }
    tools_wanted.assign(tools.size(), 0.0);
    tools_in_force = tools_wanted;
    const auto size = static_cast<Eigen::Index>(n);
    M.resize(size, size);
    inverse_root.resize(size, size);
    root.compute(Eigen::MatrixXd::Identity(size, size));
  }

  Eigen::Map<const Eigen::VectorXd> vector(const std::vector<double>& v) const {
    return {v.data(), static_cast<Eigen::Index>(n)};
  }

  /// Mean of tau_other over a step of h seconds.
  double mean_other(std::size_t i, double h) const { return tau_other[i] + h / 2 * tau_other_rate[i]; }

  const scene::PlacedRobot* placed;
  LinkSide link = LinkSide::kInside;
  std::string prefix;
  std::size_t n;
  Assembled parts;  // its bodies and joints in the world
  Pose X_WB;
  std::unique_ptr<robot::Mechanism> mechanism;  // with gravity in the base's frame
  std::unique_ptr<robot::Data> data;
  robot::BodyParameters inertias;
  std::string place;                                 // of the inertias, for messages
  double tool_changes = 0;                           // tunable
  std::vector<std::string> tools;                    // with shapes
  std::vector<double> tools_wanted, tools_in_force;  // tunables and state, 1: the shapes are there

  std::vector<double> base_p0{0, 0, 0}, base_quat0{1, 0, 0, 0}, q0, dq0, K, D, B;  // parameters
  std::vector<double> q, dq, tau_J, dtheta;                                        // inputs (q, dq: outputs with link outside)
  std::vector<double> tau_other, tau_other_rate;                                   // input with its rate
  std::vector<double> q_link, dq_link, ddq, tau_e, f_c{0, 0, 0}, base_p{0, 0, 0}, base_quat{1, 0, 0, 0};  // outputs
  std::vector<double> base_v{0, 0, 0}, base_w{0, 0, 0}, base_f_c{0, 0, 0}, base_m_c{0, 0, 0}, base_f{0, 0, 0}, base_m{0, 0, 0};
  double takes_loads = 0;                                      // input
  std::vector<double> load_factor, load_torque, load_damping;  // outputs
  std::vector<double> dq_before, q_before;                     // states
  std::vector<double> tau_l;                                   // state: tau_e of latches and grips
  std::vector<double> damping;                                 // of the gears, in the last step
  std::vector<double> tau, acceleration;
  Eigen::MatrixXd M, inverse_root;
  Eigen::LLT<Eigen::MatrixXd> root;  // of M
  std::vector<double> mobility;      // diagonal of M⁻¹
  bool held = false;                 // by a closed latch, or it grips
  Eigen::MatrixXd J, response;       // of the rows of Loads: rows x n; with the gears within half a step, n x rows
  std::vector<Pose> X_WL;            // of all bodies
  std::vector<Twist> V_WL;
};

/// What latches and grips hold, as rows: the relative motion of the second body against the first one along one direction, at p.
struct ContactWorld::Loads {
  static constexpr std::size_t kGrips = 16, kNumbers = 10;  // contacts that are taken into account, and numbers of each

  Loads(std::size_t latches, bool has_parts) : grips(has_parts ? kGrips : 0) {
    const std::size_t most = 6 * latches + 3 * grips;
    const auto size = static_cast<Eigen::Index>(most);
    rows.reserve(most);
    free.resize(size, size);
    factor.resize(size, size);
    body.resize(size, 6);
    motion.setZero(size, 2);
  }
  struct Row {
    /// Reads the latch after a step h.
    void read(const Latch& of, double h) {
      parent = of.joint.parent;
      child = of.joint.child;
      p = of.joint.p_child;
      (turns ? m : d) = of.joint.R_parent.col(axis);
      stiffness = turns ? of.law.turn_stiffness : of.law.stiffness;
      softness = stiffness > 0 ? 4 / (stiffness * h * h) : 0;
      const Latch::Aim aim = of.aim(Stage::kPosition, h);
      error = (turns ? m : d).dot(turns ? aim.error.angular : aim.error.linear);
      cosine = aim.cosine;
    }
    int latch = -1;  // −1: a contact
    int axis = 0;
    bool turns = false;
    int parent = -1, child = -1;                                // bodies of the scene; −1: the world
    Eigen::Vector3d d = Eigen::Vector3d::Zero(), m = d, p = d;  // in W; d or m is 0
    double softness = 0;                                        // of the implicit midpoint rule, speed per impulse
    double stiffness = 0, error = 0, cosine = 1;  // of a latch: N/m or N.m/rad, 0: rigid; m or its sine; of the whole turn
    /// −1 for the first frame's body, 1 for the second one's, 0 for others.
    double sign(std::size_t of) const { return (child == static_cast<int>(of)) - (parent == static_cast<int>(of)); }
    double along(const Eigen::Vector3d& linear, const Eigen::Vector3d& angular) const { return d.dot(linear) + m.dot(angular); }
  };

  std::size_t grips;         // most of them
  std::size_t gripping = 0;  // now
  std::vector<Row> rows;
  Eigen::MatrixXd free;    // mobility of the bodies that are no links, and softness
  Eigen::MatrixXd factor;  // scratch
  Eigen::MatrixXd body;    // that of one body is U Uᵀ with this U
  Eigen::MatrixXd motion;  // speeds and displacements by which the drive trains have moved the frames otherwise than expected
  double energy = 0;       // of the held bodies and the springs at the start of a step, J
  double given = 0;        // that latches and grips have given to drive trains in the last step, J
};

struct ContactWorld::Body {
  Body(const std::string& place, const scene::Body& body)
      : name(text::identifier(body.name)), motion(body.motion), foundation(place, name, body) {}

  std::string name, prefix;
  std::size_t index;                    // in the world
  bool jointed = false;                 // a joint of the scene holds it
  bool held = false, was_held = false;  // a latch or a grip holds it; did so in the step before
  bool latched = false;                 // a latch does, and no joint
  Wrench outer = Wrench::Zero();        // of contacts without grips, at its origin
  Pose X_start;                         // where a step began with it
  scene::Motion motion;
  std::vector<double> p0{0, 0, 0}, quat0{1, 0, 0, 0}, v0{0, 0, 0}, w0{0, 0, 0};  // parameters
  std::vector<double> f{0, 0, 0}, m{0, 0, 0};                                    // inputs of a dynamic body
  std::vector<double> v_d{0, 0, 0}, w_d{0, 0, 0};                                // inputs of a driven one
  std::vector<double> p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0}, f_c{0, 0, 0}, m_c{0, 0, 0};  // outputs
  Foundation foundation;
};

}  // namespace cotwin::contact_world
