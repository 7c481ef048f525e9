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
  std::vector<double> dq_before;  // state
  std::vector<double> tau, acceleration;
  Eigen::MatrixXd M, inverse_root;
  Eigen::LLT<Eigen::MatrixXd> root;  // of M
  std::vector<double> mobility;      // diagonal of M⁻¹
  std::vector<Pose> X_WL;            // of all bodies
  std::vector<Twist> V_WL;
};

struct ContactWorld::Body {
  Body(const std::string& place, const scene::Body& body)
      : name(text::identifier(body.name)), motion(body.motion), foundation(place, name, body) {}

  std::string name, prefix;
  std::size_t index;  // in the world
  scene::Motion motion;
  std::vector<double> p0{0, 0, 0}, quat0{1, 0, 0, 0}, v0{0, 0, 0}, w0{0, 0, 0};  // parameters
  std::vector<double> f{0, 0, 0}, m{0, 0, 0};                                    // inputs of a dynamic body
  std::vector<double> v_d{0, 0, 0}, w_d{0, 0, 0};                                // inputs of a driven one
  std::vector<double> p{0, 0, 0}, quat{1, 0, 0, 0}, v{0, 0, 0}, w{0, 0, 0}, f_c{0, 0, 0}, m_c{0, 0, 0};  // outputs
  Foundation foundation;
};

}  // namespace cotwin::contact_world
