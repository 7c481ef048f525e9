#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "models/mechanics/inertia.h"
#include "models/mechanics/pose.h"

namespace cotwin::robot {

enum class JointType { kRevolute, kPrismatic };
constexpr JointType last(JointType) { return JointType::kPrismatic; }

/// A joint of one degree of freedom and the body that it moves. Fixed joints of the URDF are merged into bodies.
struct Joint {
  std::string name;                                         // of the URDF joint
  JointType type = JointType::kRevolute;                    // a continuous joint is a revolute one without limits
  int parent = -1;                                          // parent body; −1: the base. Always less than this joint's index
  Pose X_PJ;                                                // joint frame J in the parent body's frame P, at q = 0
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();          // unit vector in J
  double q_min = -std::numeric_limits<double>::infinity();  // rad or m
  double q_max = +std::numeric_limits<double>::infinity();
  double dq_max = +std::numeric_limits<double>::infinity();   // rad/s or m/s
  double ddq_max = +std::numeric_limits<double>::infinity();  // rad/s² or m/s²; URDF 1.2
  double dddq_max = +std::numeric_limits<double>::infinity();
  double tau_max = +std::numeric_limits<double>::infinity();  // N.m or N
  double damping = 0;                                         // URDF <dynamics damping>, N.m.s/rad or N.s/m
  double friction = 0;                                        // URDF <dynamics friction>, N.m or N
  bool passive = false;                                       // moves freely: has no motor and no gear

  static auto fields(auto& j, auto each) {
    return each(j.name, j.type, j.parent, j.X_PJ, j.axis, j.q_min, j.q_max, j.dq_max, j.ddq_max, j.dddq_max, j.tau_max,
                j.damping, j.friction, j.passive);
  }
  friend bool operator==(const Joint&, const Joint&) = default;
};

/// A joint that follows another, q = multiplier · q_leader + offset (URDF <mimic>). It is no degree of freedom: its leader's
/// position, speed and torque are those of the group.
struct Mimic {
  Joint joint;
  int leader = 0;         // index in RobotModel::joints
  double multiplier = 1;  // m/rad or rad/m if one of the two joints is prismatic
  double offset = 0;      // rad or m
  int place = 0;          // of this joint in RobotModel::depth_first()

  static auto fields(auto& m, auto each) { return each(m.joint, m.leader, m.multiplier, m.offset, m.place); }
  friend bool operator==(const Mimic&, const Mimic&) = default;
};

/// A rigid body: the URDF link that a joint moves, with all links rigidly attached to it. Its frame is the joint's frame J
/// after the motion q.
struct Body {
  std::string name;
  Inertia inertia;

  static auto fields(auto& b, auto each) { return each(b.name, b.inertia); }
  friend bool operator==(const Body&, const Body&) = default;
};

/// A named frame: every link of the URDF, merged or not, and every attachment.
struct Frame {
  std::string name;
  int body = -1;  // −1: the base
  Pose X_BF;      // in the body's frame

  static auto fields(auto& f, auto each) { return each(f.name, f.body, f.X_BF); }
  friend bool operator==(const Frame&, const Frame&) = default;
};

/// A further frame F on a mounted part with the frame A.
struct PartFrame {
  std::string name;
  Pose X_AF;

  friend bool operator==(const PartFrame&, const PartFrame&) = default;
};

/// One entry of a robot's history (IV-A2). before() in attachment.h restores the model before the change.
struct Change {
  enum class Kind { kAttach, kDetach, kSetInertia };

  std::string what;    // "attach ft_sensor to link_7: 0.25 kg at (0, 0, 0.03) m"
  std::string reason;  // given by the caller
  int body = -1;
  Inertia before;  // the body's inertia before the change
  Inertia after;
  Kind kind = Kind::kSetInertia;
  Frame frame;                     // attach, detach: the added or removed frame
  std::string parent;              // attach, detach: the parent frame of the mounting
  Inertia part;                    // attach, detach: inertia of the part in the body's frame
  std::size_t index = 0;           // attach, detach: index in the robot's frames
  Pose X_PF;                       // attach, detach: the frame in its parent frame
  Inertia own;                     // attach, detach: inertia of the part in its own frame
  std::vector<PartFrame> further;  // attach, detach: they follow `frame` in the robot's frames
  std::optional<double> time;      // s since the start of the scenario; none for a change outside of a run

  friend bool operator==(const Change&, const Change&) = default;
};

/// Complete description of a robot: kinematic tree, mass distribution, limits, history. `joints` are the independent ones, in
/// the order of q (from a URDF: depth-first, at each branch in the order of the file; for a chain from base to tip). Parents
/// come before their children in depth_first(), and without mimics in `joints`. dynamics.h evaluates (2a).
struct RobotModel {
  std::string name;
  std::vector<Joint> joints;             // n
  std::vector<Mimic> mimics;             // m, by `place`
  std::vector<Body> bodies;              // n + m; bodies[i] is moved by joints[i], bodies[n + k] by mimics[k]
  Body base;                             // links rigidly attached to the base, in the base frame B
  std::vector<Frame> frames;             // of the links in the order of the file, then of the attachments
  Eigen::Vector3d gravity{0, 0, -9.81};  // m/s² in B; 9.81 as in (2a)'s δ
  std::vector<Change> history;
  std::map<std::string, double> locked;  // joints of the URDF that were read as fixed at this position, rad or m

  int n() const { return static_cast<int>(joints.size()); }
  int body_count() const { return n() + static_cast<int>(mimics.size()); }
  /// The joint that moves body `body`, 0 to body_count() − 1.
  const Joint& joint_of(int body) const;
  /// The independent joint that moves body `body` relative to its parent: the body's own or the leader.
  int leader_of(int body) const;
  /// All bodies, each after its parent.
  std::vector<int> depth_first() const;
  /// Whether `body` moves with the independent joint `joint`, itself or through a mimic.
  bool moves(int joint, int body) const;
  /// Throws Error with the closest frame name.
  const Frame& frame(const std::string& name) const;
  /// The frame at the end of the longest chain: the last frame in `frames` on the body with the most joints between it and the
  /// base; among several such bodies, the one with the lowest index. Throws Error if that body has no frame.
  const Frame& end_effector() const;

  static auto fields(auto& r, auto each) { return each(r.name, r.joints, r.mimics, r.bodies, r.base, r.frames, r.gravity); }
  /// A unit knows neither of what its robot came to be nor of the file.
  static auto left_out(auto& r, auto each) { return each(r.history, r.locked); }
  friend bool operator==(const RobotModel&, const RobotModel&) = default;
};

}  // namespace cotwin::robot
