#include "components/contact_world/engine/body/body.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/numerics/dense.h"

namespace cotwin::contact_world {
namespace {

using Eigen::Vector4d;

/// cos x and sin x / x from x²; the series is used where it is exact to the last bit.
struct Rotor {
  explicit Rotor(double x2) {
    if (x2 < 0.02) {
      cosine = 1 + x2 * (-1 / 2. + x2 * (1 / 24. + x2 * (-1 / 720. + x2 * (1 / 40320. + x2 * (-1 / 3628800.)))));
      sinc = 1 + x2 * (-1 / 6. + x2 * (1 / 120. + x2 * (-1 / 5040. + x2 * (1 / 362880. + x2 * (-1 / 39916800.)))));
    } else {
      const double x = std::sqrt(x2);
      cosine = std::cos(x);
      sinc = std::sin(x) / x;
    }
  }
  double cosine, sinc;
};

/// The Hamilton product.
Vector4d product(const Vector4d& a, const Vector4d& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

/// The quaternion of a rotation by the vector a, rad.
Vector4d rotation(const Vector3d& a) {
  const Rotor rotor(a.squaredNorm() / 4);
  Vector4d Q;
  Q << rotor.cosine, rotor.sinc / 2 * a;
  return Q;
}

Matrix3d matrix(const Vector4d& Q) { return Eigen::Quaterniond(Q[0], Q[1], Q[2], Q[3]).toRotationMatrix(); }

/// Rotates a body by rate · L_k · h about its own axis k, where L_P is the angular momentum in its axes: the exact flow of
/// ½ rate L_k².
void turn_about(int k, double rate, double h, Vector4d& Q, Vector3d& L_P) {
  const double half = rate * L_P[k] * h / 2;
  const Rotor rotor(half * half);
  const double c = rotor.cosine, s = rotor.sinc * half;
  const int i = (k + 1) % 3, j = (k + 2) % 3;
  const double C = 1 - 2 * s * s, S = 2 * s * c;
  const double Li = L_P[i], Lj = L_P[j];
  L_P[i] = C * Li + S * Lj;
  L_P[j] = C * Lj - S * Li;
  const Vector4d was = Q;
  Q[0] = c * was[0] - s * was[k + 1];
  Q[k + 1] = c * was[k + 1] + s * was[0];
  Q[i + 1] = c * was[i + 1] + s * was[j + 1];
  Q[j + 1] = c * was[j + 1] - s * was[i + 1];
}

double radius_about(const Vector3d& p_BP, const scene::Shape& shape) {
  const double half_length = shape.size[1] / 2;
  const double offset = (shape.X_BS.p - p_BP).norm();
  switch (shape.type) {
    case scene::ShapeType::kSphere:
      return offset + shape.size[0];
    case scene::ShapeType::kEllipsoid:
      return offset + shape.size.maxCoeff();
    case scene::ShapeType::kBox:
      return offset + shape.size.norm() / 2;
    case scene::ShapeType::kCylinder:
      return offset + std::hypot(shape.size[0], half_length);
    case scene::ShapeType::kCapsule:
      return offset + shape.size[0] + half_length;
    case scene::ShapeType::kTriangle:
    case scene::ShapeType::kHull: {
      double radius = 0;
      for (const Vector3d& vertex : shape.vertices) radius = std::max(radius, (shape.X_BS * vertex - p_BP).norm());
      return radius;
    }
    case scene::ShapeType::kPlane:
      return 0;  // without bounds
  }
  return 0;
}

double inverse(double x) { return x > 0 ? 1 / x : 0; }

}  // namespace

RigidBody::RigidBody(const scene::Body& body) : motion(body.motion) {
  set_inertia(body.inertia, body.shapes, body.name);
  set_pose(body.X_WB);
  set_twist(body.V_WB);
}

void RigidBody::set_inertia(const Inertia& inertia, std::span<const scene::Shape> shapes, const std::string& name) {
  const Pose X_WB = pose();
  const Twist V_WB = twist();
  if (dynamic()) {
    const std::string why = inertia.unphysical();
    if (!why.empty()) throw Error("body " + name, why);
    take(inertia);
  }
  X_PB = X_BP.inverse();
  radius = 0;
  for (const scene::Shape& shape : shapes) radius = std::max(radius, radius_about(X_BP.p, shape));
  set_pose(X_WB);
  set_twist(V_WB);
}

void RigidBody::take(const Inertia& inertia) {
  const numerics::SymmetricEigen<3> principal = numerics::symmetric_eigen<3>(inertia.I_CC);
  Matrix3d axes = principal.vectors;
  if (inertia.I_CC.isDiagonal(0)) {
    axes.setIdentity();
    moments = inertia.I_CC.diagonal();
  } else {
    if (axes.determinant() < 0) axes.col(0) = -axes.col(0);
    moments = principal.values.cwiseMax(0.0);
  }
  // Computes the rotation from the unit quaternion, so that R_WP of set_pose() equals that of Q.
  const Eigen::Quaterniond Q_BP = Eigen::Quaterniond(axes).normalized();
  X_BP = {Q_BP.toRotationMatrix(), inertia.p_LC};
  mass = inertia.mass;
  inverse_mass = 1 / mass;
  inverse_root_mass = std::sqrt(inverse_mass);
  inverse_moments = moments.unaryExpr(&inverse);
  root_moments = moments.cwiseSqrt();
  inverse_root_moments = inverse_moments.cwiseSqrt();
  int order[3] = {0, 1, 2};
  std::sort(order, order + 3, [&](int a, int b) { return inverse_moments[a] < inverse_moments[b]; });
  reference_axis_ = order[1];
}

void RigidBody::place() { R = matrix(Q); }

Pose RigidBody::pose() const { return Pose{R, p} * X_PB; }

Twist RigidBody::twist() const {
  Twist V_WB;
  V_WB << v + w.cross(R * X_PB.p), w;
  return V_WB;
}

void RigidBody::set_pose(const Pose& X_WB) {
  const Pose X_WP = X_WB * X_BP;
  const Eigen::Quaterniond quaternion = Eigen::Quaterniond(X_WP.R).normalized();
  Q << quaternion.w(), quaternion.x(), quaternion.y(), quaternion.z();
  R = matrix(Q);
  p = X_WP.p;
  if (dynamic()) set_spin(w);
}

void RigidBody::set_twist(const Twist& V_WB) {
  set_spin(V_WB.tail<3>());
  v = V_WB.head<3>() - w.cross(R * X_PB.p);
}

void RigidBody::set_spin(const Vector3d& w_W) {
  w = w_W;
  L = R * moments.cwiseProduct(R.transpose() * w);
}

void RigidBody::apply_impulse(const Vector3d& impulse, const Vector3d& moment) {
  v += inverse_mass * impulse;
  if (moment.isZero(0)) return;
  L += moment;
  w += R * inverse_moments.cwiseProduct(R.transpose() * moment);
}

double RigidBody::mobility(const Vector3d& d, const Vector3d& m, const Vector3d& at) const {
  if (!dynamic()) return 0;
  const Vector3d moment = R.transpose() * (m + (at - p).cross(d));
  return inverse_mass * d.squaredNorm() + inverse_moments.dot(moment.cwiseAbs2());
}

double RigidBody::kinetic_energy() const {
  const Vector3d w_P = R.transpose() * w;
  return (mass * v.squaredNorm() + moments.dot(w_P.cwiseAbs2())) / 2;
}

void RigidBody::drift(double h) {
  if (motion == scene::Motion::kStatic) return;
  p += h * v;
  if (!dynamic()) {
    if (w.isZero(0)) return;
    Q = product(rotation(h * w), Q).normalized();
    R = matrix(Q);
    return;
  }
  if (!w.isZero(0)) turn(h);
}

// Splits the energy ½ Σ L_k²/I_k into that of a sphere with the middle moment I_r, whose flow is a rotation that commutes with
// the others, and one term for each of the other two body axes, composed symmetrically. Symplectic, reversible, second order;
// keeps |L| in the body and L in space exactly; exact for bodies with two equal moments.
void RigidBody::turn(double h) {
  const int r = reference_axis_, a = (r + 1) % 3, b = (r + 2) % 3;
  const double rate_a = inverse_moments[a] - inverse_moments[r], rate_b = inverse_moments[b] - inverse_moments[r];
  if (rate_a != 0 || rate_b != 0) {
    Vector3d L_P = R.transpose() * L;
    turn_about(a, rate_a, h / 2, Q, L_P);
    turn_about(b, rate_b, h, Q, L_P);
    turn_about(a, rate_a, h / 2, Q, L_P);
  }
  Q = product(rotation(h * inverse_moments[r] * L), Q);
  Q *= 1 / Q.norm();
  R = matrix(Q);
  update_spin();
}

void RigidBody::update_spin() { w = R * inverse_moments.cwiseProduct(R.transpose() * L); }

}  // namespace cotwin::contact_world
