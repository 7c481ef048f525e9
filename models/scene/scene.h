#pragma once
#include <Eigen/Core>
#include <limits>
#include <string>
#include <vector>

#include "models/mechanics/inertia.h"
#include "models/mechanics/pose.h"

/// Bodies, shapes, joints and contact parameters of an environment: the input of the contact world.
namespace cotwin::scene {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Contact parameters of a surface. For a pair of surfaces: μ is the geometric mean, springs with their dampers act in series
/// (d = d_a (k_b / (k_a + k_b))² + d_b (k_a / (k_a + k_b))²), restitution is the larger one.
struct Material {
  double mu = 0.5;                                            // Coulomb friction
  double restitution = 0;                                     // of the normal speed before the impact, 0 … 1
  double stiffness = kInfinity;                               // N/m of one contact; infinite: rigid
  double damping = 0;                                         // N.s/m of one contact; ignored if rigid
  double mu2 = -1;                                            // across first_direction; negative: as mu
  Eigen::Vector3d first_direction = Eigen::Vector3d::Zero();  // of mu, in the body's frame, unit; zero: isotropic
  double torsion = 0;         // moment about the normal that resists spin: at most torsion × patch radius × normal force
  double patch_radius = 0;    // m; 0: √(surface_radius × depth), which is 0 for rigid contacts
  double surface_radius = 0;  // m
  // Elastic foundation: replaces stiffness and damping by those of the area in contact, or of the whole contact if `whole`.
  double foundation = 0;            // Pa/m (whole: N/m); 0: none
  double foundation_damping = 0;    // Pa.s/m (whole: N.s/m)
  double yield = kInfinity;         // Pa (whole: N) that the foundation carries; beyond, it stays indented
  double breakthrough = kInfinity;  // m; where the contact is deeper, the foundation is pierced and carries nothing
  bool whole = false;

  bool soft() const { return stiffness < kInfinity || foundation > 0; }

  static auto fields(auto& m, auto each) {
    return each(m.mu, m.restitution, m.stiffness, m.damping, m.mu2, m.first_direction, m.torsion, m.patch_radius,
                m.surface_radius, m.foundation, m.foundation_damping, m.yield, m.breakthrough, m.whole);
  }
  friend bool operator==(const Material&, const Material&) = default;
};

enum class ShapeType { kSphere, kBox, kCylinder, kCapsule, kHull, kPlane, kTriangle, kEllipsoid };
constexpr ShapeType last(ShapeType) { return ShapeType::kEllipsoid; }

/// A convex piece of a body's surface, in its own frame S.
struct Shape {
  std::string name;
  ShapeType type = ShapeType::kSphere;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  // m; box: edge lengths; sphere: (radius, –, –); cylinder, capsule about
      // S's z: (radius, length without the caps, –); plane z = 0 of S, solid below;
      // ellipsoid: radii; triangle: (depth of the solid behind it, sum of 1, 2, 4 for each edge that is smooth or concave, –)
  std::vector<Eigen::Vector3d> vertices;  // hull: in S, m; triangle: its corners, counter-clockwise seen from outside
  Eigen::Vector3d turns =
      Eigen::Vector3d::Zero();  // triangle: at each of these edges, angle to the neighbour's normal if it is convex, rad
  Pose X_BS;                    // in the body's frame
  Material material;
  std::string tool = {};  // the shape comes and goes with the tool of this name; "": it is always there

  static auto fields(auto& s, auto each) {
    return each(s.name, s.type, s.size, s.vertices, s.turns, s.X_BS, s.material, s.tool);
  }
  friend bool operator==(const Shape&, const Shape&) = default;
};

enum class Motion {
  kStatic,  // fixed
  kDriven,  // moves with a prescribed twist; contacts do not change it
  kDynamic  // moves by (1)
};
constexpr Motion last(Motion) { return Motion::kDynamic; }

struct Body {
  std::string name;
  Motion motion = Motion::kDynamic;
  Pose X_WB;                   // at the start
  Twist V_WB = Twist::Zero();  // of the frame's origin, expressed in W
  Inertia inertia;             // in B; kDynamic only
  std::vector<Shape> shapes;

  static auto fields(auto& b, auto each) { return each(b.name, b.motion, b.X_WB, b.V_WB, b.inertia, b.shapes); }
  friend bool operator==(const Body&, const Body&) = default;
};

enum class JointType { kRevolute, kPrismatic, kSpherical, kFixed, kScrew };
constexpr JointType last(JointType) { return JointType::kScrew; }

/// A joint between frame P' on the parent and frame J on the child; at position zero they coincide.
struct Joint {
  std::string name;
  JointType type = JointType::kRevolute;
  int parent = -1;  // index of a body; −1: the world
  int child = -1;
  Pose X_PJ;                                        // the joint's frame on the parent
  Pose X_CJ;                                        // the joint's frame on the child
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();  // unit vector in J; revolute, prismatic, screw
  double q = 0;                                     // initial position, including whole turns
  double q_min = -kInfinity, q_max = kInfinity;     // rad or m
  double friction = 0;                              // Coulomb, N.m or N
  double damping = 0;                               // N.m.s/rad or N.s/m
  double stiffness = 0, q_spring = 0;               // of a spring, N.m/rad or N/m, and where it is at rest
  double pitch = 0;                                 // screw: advance of the child along the axis, m/rad

  static auto fields(auto& j, auto each) {
    return each(j.name, j.type, j.parent, j.child, j.X_PJ, j.X_CJ, j.axis, j.q, j.q_min, j.q_max, j.friction, j.damping,
                j.stiffness, j.q_spring, j.pitch);
  }
  friend bool operator==(const Joint&, const Joint&) = default;
};

/// Two joints that a gear couples: q_follower = ratio · q_leader + offset.
struct Gear {
  int leader = -1, follower = -1;  // indices of revolute or prismatic joints
  double ratio = 1;                // m/rad or rad/m if one of the two is prismatic
  double offset = 0;               // rad or m

  static auto fields(auto& g, auto each) { return each(g.leader, g.follower, g.ratio, g.offset); }
  friend bool operator==(const Gear&, const Gear&) = default;
};

/// A named frame on a body, of an SDF scene: frame, MODEL.frame.
struct Frame {
  std::string name;
  int body = -1;  // −1: the world
  Pose X_BF;

  static auto fields(auto& f, auto each) { return each(f.name, f.body, f.X_BF); }
  friend bool operator==(const Frame&, const Frame&) = default;
};

struct Scene {
  std::string name;
  Eigen::Vector3d gravity{0, 0, -9.81};  // m/s² in W
  std::vector<Body> bodies;
  std::vector<Joint> joints;
  std::vector<Gear> gears;
  std::vector<Frame> frames;
  std::vector<Joint> latches;                   // of type kFixed; open at the start
  std::vector<std::pair<int, int>> no_contact;  // pairs of bodies without contacts, besides bodies connected by a joint

  static auto fields(auto& s, auto each) {
    return each(s.name, s.gravity, s.bodies, s.joints, s.gears, s.frames, s.no_contact);
  }
  /// The contact world adds them from its settings.
  static auto left_out(auto& s, auto each) { return each(s.latches); }
  friend bool operator==(const Scene&, const Scene&) = default;
};

/// Throws Error `scene 'name': body 'x': …` for numbers that are not finite, frames that are no rotations, unphysical inertias
/// of dynamic bodies, negative sizes, hulls without volume, planes on dynamic bodies, surface parameters out of range,
/// duplicate names, invalid indices and axes of joints, and limits with lower > upper. Loops of joints are allowed.
void check(const Scene& scene);

}  // namespace cotwin::scene
