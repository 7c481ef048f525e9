#include <Eigen/Core>
#include <cmath>
#include <set>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/hull.h"
#include "models/scene/scene.h"
#include "models/scene/shapes.h"

namespace cotwin::scene {

namespace {

constexpr double kLargest = 1e9, kSmallest = 1e-9;  // m; beyond, squares of lengths lose precision

std::string shown(double value) { return text::to_text(value, 6); }

/// Checks of one object; messages begin with its place.
class Checker {
 public:
  explicit Checker(std::string place) : place_(std::move(place)) {}
  void expect(bool holds, const std::string& what) const {
    if (!holds) throw Error(place_, what);
  }
  void expect_pose(const Pose& X, const std::string& name) const {
    expect(X.p.allFinite() && X.R.allFinite(), name + " is not finite");
    expect(is_rotation(X.R), name + ": the matrix is not a rotation");
    expect(X.p.cwiseAbs().maxCoeff() <= kLargest,
           name + " is " + shown(X.p.cwiseAbs().maxCoeff()) + " m away, expected ≤ " + shown(kLargest) + " m");
  }
  void expect_at_least(double value, double least, const std::string& name) const {
    expect(value >= least, name + " " + shown(value) + ", expected ≥ " + shown(least));
  }

 private:
  std::string place_;
};

void check_material(const Checker& c, const Material& m) {
  c.expect_at_least(m.mu, 0, "friction");
  c.expect(m.mu2 >= 0 || m.mu2 == -1, "second friction " + shown(m.mu2) + ", expected ≥ 0");
  const double length = m.first_direction.norm();
  c.expect(length == 0 || std::abs(length - 1) < 1e-9, "direction of friction of length " + shown(length) + ", expected 1");
  c.expect_at_least(m.torsion, 0, "torsional friction");
  c.expect_at_least(m.patch_radius, 0, "patch radius");
  c.expect_at_least(m.surface_radius, 0, "surface radius");
  c.expect(m.restitution >= 0 && m.restitution <= 1, "restitution " + shown(m.restitution) + ", expected 0 … 1");
  c.expect(m.stiffness > 0, "stiffness " + shown(m.stiffness) + " N/m, expected > 0");
  c.expect(m.damping >= 0 && std::isfinite(m.damping), "damping " + shown(m.damping) + " N.s/m, expected ≥ 0 and finite");
  const std::string per_depth = m.whole ? " N/m" : " Pa/m", force = m.whole ? " N" : " Pa";
  c.expect(m.foundation >= 0 && std::isfinite(m.foundation),
           "foundation " + shown(m.foundation) + per_depth + ", expected ≥ 0 and finite");
  c.expect(m.foundation_damping >= 0 && std::isfinite(m.foundation_damping),
           "damping of the foundation " + shown(m.foundation_damping) + ", expected ≥ 0 and finite");
  c.expect(m.yield > 0, "yield limit " + shown(m.yield) + force + ", expected > 0");
  c.expect(m.breakthrough > 0, "breakthrough " + shown(m.breakthrough) + " m, expected > 0");
  c.expect(m.foundation > 0 || (m.yield == kInfinity && m.breakthrough == kInfinity && m.foundation_damping == 0),
           "a yield limit, breakthrough or damping of a foundation without a stiffness of it");
  c.expect(m.foundation == 0 || m.stiffness == kInfinity,
           "a stiffness of each point besides a foundation, expected one of them");
}

void check_shape(const Checker& c, const Shape& shape, Motion motion) {
  c.expect_pose(shape.X_BS, "pose");
  check_material(c, shape.material);
  const auto expect_length = [&](int i, const char* what) {
    const double x = shape.size[i];
    c.expect(x > 0, std::string(what) + " " + shown(x) + " m, expected > 0");
    c.expect(x >= kSmallest && x <= kLargest,
             std::string(what) + " " + shown(x) + " m, expected " + shown(kSmallest) + " … " + shown(kLargest) + " m");
  };
  switch (shape.type) {
    case ShapeType::kSphere:
      expect_length(0, "radius");
      break;
    case ShapeType::kEllipsoid:
      for (int i = 0; i < 3; ++i) expect_length(i, "radius");
      break;
    case ShapeType::kBox:
      for (int i = 0; i < 3; ++i) expect_length(i, "edge");
      break;
    case ShapeType::kCylinder:
    case ShapeType::kCapsule:
      expect_length(0, "radius");
      expect_length(1, "length");
      break;
    case ShapeType::kHull:
      for (const Eigen::Vector3d& v : shape.vertices) {
        c.expect(v.cwiseAbs().maxCoeff() <= kLargest, "a vertex beyond " + shown(kLargest) + " m");
      }
      try {
        convex_hull(shape.vertices);
      } catch (const Error& e) {
        c.expect(false, e.what());
      }
      break;
    case ShapeType::kTriangle:
      c.expect(shape.vertices.size() == 3, std::to_string(shape.vertices.size()) + " corners of a triangle, expected 3");
      for (const Eigen::Vector3d& v : shape.vertices) {
        c.expect(v.cwiseAbs().maxCoeff() <= kLargest, "a corner beyond " + shown(kLargest) + " m");
      }
      expect_length(0, "depth");
      c.expect(shape.size[1] >= 0 && shape.size[1] <= 7, "edges " + shown(shape.size[1]) + " of a triangle, expected 0 … 7");
      try {
        convex_hull(triangle_corners(shape));
      } catch (const Error& e) {
        c.expect(false, e.what());
      }
      break;
    case ShapeType::kPlane:
      c.expect(motion != Motion::kDynamic, "a plane on a dynamic body");
      break;
  }
}

void check_body(const std::string& place, const Body& body) {
  const Checker c(place);
  c.expect_pose(body.X_WB, "pose");
  c.expect(body.V_WB.allFinite(), "velocity is not finite");
  if (body.motion == Motion::kStatic) c.expect(body.V_WB.isZero(0), "a static body with a velocity");
  if (body.motion == Motion::kDynamic) {
    const Inertia& i = body.inertia;
    c.expect(std::isfinite(i.mass) && i.p_LC.allFinite() && i.I_CC.allFinite(), "inertia is not finite");
    const std::string why = i.unphysical();
    c.expect(why.empty(), why);
  }
  for (std::size_t s = 0; s < body.shapes.size(); ++s) {
    const Shape& shape = body.shapes[s];
    check_shape(Checker(place + ": shape " + (shape.name.empty() ? std::to_string(s) : "'" + shape.name + "'")), shape,
                body.motion);
  }
}

void check_joint(const Checker& c, const Joint& joint, int bodies) {
  const std::string range = ", expected 0 … " + std::to_string(bodies - 1);
  c.expect(joint.child >= 0 && joint.child < bodies, "child " + std::to_string(joint.child) + range);
  c.expect(joint.parent >= -1 && joint.parent < bodies,
           "parent " + std::to_string(joint.parent) + range + ", or -1 for the world");
  c.expect(joint.parent != joint.child, "parent and child are the same body");
  c.expect_pose(joint.X_PJ, "pose on the parent");
  c.expect_pose(joint.X_CJ, "pose on the child");
  c.expect(std::abs(joint.axis.norm() - 1) < 1e-9, "axis of length " + shown(joint.axis.norm()) + ", expected 1");
  c.expect(joint.q_min <= joint.q_max,
           "limits " + shown(joint.q_min) + " … " + shown(joint.q_max) + ", expected lower ≤ upper");
  c.expect(joint.friction >= 0 && std::isfinite(joint.friction), "friction " + shown(joint.friction) + ", expected ≥ 0");
  c.expect(joint.damping >= 0 && std::isfinite(joint.damping), "damping " + shown(joint.damping) + ", expected ≥ 0");
  c.expect(joint.stiffness >= 0 && std::isfinite(joint.stiffness), "stiffness " + shown(joint.stiffness) + ", expected ≥ 0");
  c.expect(std::isfinite(joint.q_spring), "the spring's rest position is not finite");
  c.expect(std::isfinite(joint.pitch), "pitch is not finite");
}

}  // namespace

void check(const Scene& scene) {
  const std::string place = "scene '" + scene.name + "'";
  const Checker c(place);
  c.expect(scene.gravity.allFinite(), "gravity is not finite");
  const auto count = static_cast<int>(scene.bodies.size());
  std::set<std::string> names;
  for (const Body& body : scene.bodies) {
    c.expect(names.insert(body.name).second, "two bodies with the name '" + body.name + "'");
    check_body(place + ": body '" + body.name + "'", body);
  }
  names.clear();
  for (const Joint& joint : scene.joints) {
    c.expect(names.insert(joint.name).second, "two joints with the name '" + joint.name + "'");
    check_joint(Checker(place + ": joint '" + joint.name + "'"), joint, count);
  }
  for (const Frame& frame : scene.frames) {
    const Checker own(place + ": frame '" + frame.name + "'");
    own.expect(frame.body >= -1 && frame.body < count,
               "body " + std::to_string(frame.body) + ", expected -1 to " + std::to_string(count - 1));
    own.expect_pose(frame.X_BF, "its pose");
  }
  for (const auto& [a, b] : scene.no_contact) {
    c.expect(a >= 0 && b >= 0 && a < count && b < count, "bodies " + std::to_string(a) + ", " + std::to_string(b) +
                                                             " without contact, expected indices below " +
                                                             std::to_string(count));
  }
}

}  // namespace cotwin::scene
