#include "models/robot/indices.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>

namespace cotwin::robot {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
/// Pivots of M below this part of the diagonal are rounding: the joint moves no mass.
constexpr double kPivot = 1e-14;
/// A motion per force below this part of the frame's largest one is rounding, also a lever arm below this part of the frame's
/// distance from the base, or of 1 m. It is squared in Λ⁻¹.
constexpr double kStuck = 1e-12;
/// Eigenvalues of Λ⁻¹ below this part of the largest one, and squares of a direction's part in their space, are rounding.
/// Cosine of the angle between rows that count as orthogonal, and a bound of the sweeps, of which five are usual.
constexpr double kOrthogonal = 1e-14;
constexpr int kMostSweeps = 30;

/// M = L D Lᵀ.
void factorise(FrameInertia& f) {
  const Eigen::Index n = f.M.rows();
  f.massless = false;
  for (Eigen::Index j = 0; j < n; ++j) {
    double d = f.M(j, j);
    for (Eigen::Index k = 0; k < j; ++k) d -= f.L(j, k) * f.L(j, k) * f.D[k];
    const bool massless = !(d > kPivot * static_cast<double>(n) * f.M(j, j));
    f.massless |= massless;
    f.D[j] = massless ? 0 : d;
    f.L(j, j) = 1;
    for (Eigen::Index i = j + 1; i < n; ++i) {
      double l = massless ? 0 : f.M(i, j);
      for (Eigen::Index k = 0; k < j && !massless; ++k) l -= f.L(i, k) * f.L(j, k) * f.D[k];
      f.L(i, j) = massless ? 0 : l / d;
    }
  }
}

/// W, J M⁻¹ and Λ⁻¹ from J and the factors of M.
void transform(FrameInertia& f) {
  const Eigen::Index n = f.M.rows();
  f.Lambda_inverse.setZero();
  for (Eigen::Index i = 0; i < n; ++i) {
    Vector6 w = f.J.col(i);
    for (Eigen::Index k = 0; k < i; ++k) w -= f.L(i, k) * f.W.col(k);
    f.W.col(i) = w;
    const double inverse = f.D[i] > 0 ? 1 / f.D[i] : 0;
    f.J_over_M.col(i) = inverse * w;
    f.Lambda_inverse.noalias() += inverse * w * w.transpose();
  }
  for (Eigen::Index i = n; i-- > 0;)
    for (Eigen::Index k = i + 1; k < n; ++k) f.J_over_M.col(i) -= f.L(k, i) * f.J_over_M.col(k);
}

/// Adds the motors' inertia; locks joints.
void add_motors(const VectorIn& B, Eigen::Index first, FrameInertia& f) {
  f.locked.setConstant(false);
  for (Eigen::Index i = 0; i < B.size(); ++i) {
    const Eigen::Index j = first + i;
    f.locked[j] = std::isinf(B[i]);
    if (f.locked[j]) {
      f.M.row(j).setZero();
      f.M.col(j).setZero();
      f.M(j, j) = 1;
      f.J.col(j).setZero();
    } else {
      f.M(j, j) += B[i];
    }
  }
}

/// Block of a direction in the six dimensions: 0 translation, 3 rotation.
enum Block : Eigen::Index { kTranslation = 0, kRotation = 3 };

/// Length whose rounding is that of positions, m.
double reach(const FrameInertia& f) { return std::max(1.0, f.X_BF.p.norm()); }

/// Largest uᵀ Λ⁻¹ u of a block, in translations that of rotations at the distance `reach` if it is larger.
double largest_mobility(const Matrix6& Lambda_inverse, Block block, double distance) {
  const double rotation = Lambda_inverse.bottomRightCorner<3, 3>().trace();
  return block == kRotation ? rotation : Lambda_inverse.topLeftCorner<3, 3>().trace() + rotation * distance * distance;
}

/// uᵀ Λ⁻¹ u of a block; 0 if it is rounding; +∞ if u moves a joint without mass.
double mobility(const FrameInertia& f, Block block, const Eigen::Vector3d& u) {
  const double distance = reach(f);
  double sum = 0;
  for (Eigen::Index i = 0; i < f.D.size(); ++i) {
    const double w = u.dot(f.W.col(i).segment<3>(block));
    if (f.D[i] > 0) {
      sum += w * w / f.D[i];
    } else {
      const double turn = f.W.col(i).tail<3>().norm();
      const double most = block == kRotation ? turn : f.W.col(i).head<3>().norm() + turn * distance;
      if (std::abs(w) > kStuck * most) return kInfinite;
    }
  }
  return sum <= kStuck * kStuck * largest_mobility(f.Lambda_inverse, block, distance) ? 0 : sum;
}

/// y_k = uᵀ ∂(J_v a)/∂q_k. Without mimics joints are in the order of the chain, where ∂J_v,i/∂q_k = ω_min(i,k) × J_v,max(i,k).
void turn_jacobian_of_chain(FrameInertia& f, const Eigen::Vector3d& u) {
  Eigen::Vector3d before = Eigen::Vector3d::Zero(), after = Eigen::Vector3d::Zero();
  for (Eigen::Index i = 0; i < f.x.size(); ++i) after += f.x[i] * f.J.col(i).head<3>();
  for (Eigen::Index k = 0; k < f.x.size(); ++k) {
    const Eigen::Vector3d w = f.J.col(k).tail<3>();
    after -= f.x[k] * f.J.col(k).head<3>();
    f.y[k] = u.dot(w.cross(after));
    before += f.x[k] * w;
    f.y[k] += u.dot(before.cross(f.J.col(k).head<3>()));
  }
}

/// The same for any robot: J̇ q̇ is a quadratic form of q̇, of which (a, e_k) gives ∂(J_v a)/∂q_k.
void turn_jacobian(const Mechanism& mechanism, Data& data, const VectorIn& q, const FrameOnBody& frame, FrameInertia& f,
                   const Eigen::Vector3d& u) {
  Twist plus, minus;
  for (Eigen::Index k = 0; k < f.x.size(); ++k) {
    const double x = f.x[k];
    f.x[k] = x + 1;
    jacobian_dot_times_dq(mechanism, data, q, f.x, frame, plus);
    f.x[k] = x - 1;
    jacobian_dot_times_dq(mechanism, data, q, f.x, frame, minus);
    f.x[k] = x;
    f.y[k] = u.dot((plus - minus).head<3>()) / 4;
  }
}

/// Rotations of the columns of `rows` until they are at right angles (one-sided Jacobi method, Hestenes 1958), which leaves small
/// lengths accurate; turn(p, r, …) also turns what belongs to the columns p and r. Eigen's JacobiSVD of a matrix with n rows allocates.
template <class Rows, class Turn>
void make_orthogonal(Rows& rows, Turn turn) {
  bool turned = true;
  for (int sweep = 0; turned && sweep < kMostSweeps; ++sweep) {
    turned = false;
    for (Eigen::Index p = 0; p + 1 < rows.cols(); ++p) {
      for (Eigen::Index r = p + 1; r < rows.cols(); ++r) {
        const double a = rows.col(p).squaredNorm(), b = rows.col(r).squaredNorm(), c = rows.col(p).dot(rows.col(r));
        if (!(std::abs(c) > kOrthogonal * std::sqrt(a * b))) continue;
        turned = true;
        const double zeta = (b - a) / (2 * c);
        const double t = std::copysign(1 / (std::abs(zeta) + std::hypot(1, zeta)), zeta);
        const double cosine = 1 / std::hypot(1, t), sine = cosine * t;
        const auto rotate = [&](auto x, auto y) {
          for (Eigen::Index i = 0; i < x.size(); ++i) {
            const double before = x[i];
            x[i] = cosine * before - sine * y[i];
            y[i] = sine * before + cosine * y[i];
          }
        };
        rotate(rows.col(p), rows.col(r));
        turn(rotate, p, r);
      }
    }
  }
}

/// Axes and lengths of {A x, ‖x‖ ≤ 1} from Aᵀ in `rows`.
void compute_axes(Manipulability& m, Ellipsoid& ellipsoid) {
  Eigen::Matrix3d V = Eigen::Matrix3d::Identity();
  make_orthogonal(m.rows, [&](const auto& rotate, Eigen::Index p, Eigen::Index r) { rotate(V.col(p), V.col(r)); });
  const Eigen::Vector3d lengths = m.rows.colwise().norm();
  std::array<Eigen::Index, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(),
            [&](Eigen::Index i, Eigen::Index k) { return lengths[i] != lengths[k] ? lengths[i] > lengths[k] : i < k; });
  for (Eigen::Index i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = V.col(order[static_cast<std::size_t>(i)]);
    ellipsoid.lengths[i] = lengths[order[static_cast<std::size_t>(i)]];
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    ellipsoid.axes.col(i) = axis[largest] < 0 ? Eigen::Vector3d(-axis) : axis;
  }
  ellipsoid.axes.col(2) = ellipsoid.axes.col(0).cross(ellipsoid.axes.col(1));
}

}  // namespace

FrameInertia::FrameInertia(int n)
    : J(6, n),
      M(n, n),
      L(Eigen::MatrixXd::Identity(n, n)),
      D(n),
      W(6, n),
      J_over_M(6, n),
      locked(n),
      C(n, n),
      x(Eigen::VectorXd::Zero(n)),
      y(n) {
  Lambda_inverse.setZero();
}

void frame_inertia(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& B, const FrameOnBody& frame,
                   FrameInertia& f) {
  assert(q.size() == f.D.size() && (B.size() == 0 || B.size() == q.size()));
  mass_matrix(mechanism, data, q, f.M);
  f.X_BF = jacobian(mechanism, data, q, frame, f.J);
  add_motors(B, 0, f);
  factorise(f);
  transform(f);
}

void frame_inertia(const FloatingMechanism& mechanism, FloatingData& d, const VectorIn& q, const VectorIn& B,
                   const FrameOnBody& frame, FrameInertia& f) {
  const Eigen::Index n = mechanism.n(), base = f.D.size() - n;
  assert(q.size() == n && base == 6 && (B.size() == 0 || B.size() == n));
  d.q.tail(n) = q;
  mass_matrix(mechanism.with_base(), d.data, d.q, f.M);
  f.X_BF = jacobian(mechanism.with_base(), d.data, d.q, {frame.body + static_cast<int>(base), frame.X_BF}, f.J);
  add_motors(B, base, f);
  factorise(f);
  transform(f);
}

double effective_mass(const FrameInertia& f, const Eigen::Vector3d& u) { return 1 / mobility(f, kTranslation, u); }
double effective_mass(const FrameInertia& f, const Eigen::Vector3d& u, double load) {
  if (!(load > 0)) return effective_mass(f, u);
  const double free = mobility(f, kTranslation, u);
  if (free == 0) return kInfinite;
  if (std::isinf(free)) return load;  // a joint without mass moves the frame
  const Eigen::Matrix3d P = f.Lambda_inverse.topLeftCorner<3, 3>();
  return 1 / u.dot((Eigen::Matrix3d::Identity() + load * P).partialPivLu().solve(P * u));
}
double effective_inertia(const FrameInertia& f, const Eigen::Vector3d& u) { return 1 / mobility(f, kRotation, u); }

void effective_mass_gradient(const Mechanism& mechanism, Data& data, const VectorIn& q, const FrameOnBody& frame,
                             FrameInertia& f, const Eigen::Vector3d& u, Direction direction, VectorOut gradient) {
  assert(q.size() == f.D.size() && gradient.size() == q.size());
  const double inverse = mobility(f, kTranslation, u);
  if (!(inverse > 0) || std::isinf(inverse)) {
    gradient.setZero();
    return;
  }
  for (Eigen::Index i = 0; i < f.x.size(); ++i) f.x[i] = u.dot(f.J_over_M.col(i).head<3>());
  if (mechanism.body_count() == mechanism.n()) {
    turn_jacobian_of_chain(f, u);
  } else {
    turn_jacobian(mechanism, data, q, frame, f, u);
  }
  coriolis_matrix(mechanism, data, q, f.x, f.C);
  const Eigen::Vector3d motion = f.Lambda_inverse.topLeftCorner<3, 3>() * u;
  for (Eigen::Index k = 0; k < f.x.size(); ++k) {
    double change = 2 * f.y[k];
    for (Eigen::Index i = 0; i < f.x.size(); ++i) change -= 2 * f.C(i, k) * f.x[i];
    const Eigen::Vector3d w = f.J.col(k).tail<3>();
    if (direction == Direction::kInFrame) change += 2 * w.cross(u).dot(motion);
    gradient[k] = f.locked[k] ? 0 : -change / inverse / inverse;
  }
}

Manipulability::Manipulability(int n) : rows(n, 3) {}

void kinematic_manipulability(const FrameInertia& f, Manipulability& m) {
  m.rows = f.J.topRows<3>().transpose();
  compute_axes(m, m.translation);
  m.rows = f.J.bottomRows<3>().transpose();
  compute_axes(m, m.rotation);
  m.translation.centre.setZero();
  m.rotation.centre.setZero();
}

void dynamic_manipulability(const Mechanism& mechanism, Data& data, const VectorIn& q, const VectorIn& dq,
                            const FrameOnBody& frame, FrameInertia& f, const VectorIn& tau_max, Manipulability& m) {
  const Eigen::Index n = f.D.size();
  assert(q.size() == n && dq.size() == n && tau_max.size() == n);
  for (Eigen::Index i = 0; i < n; ++i) m.rows.row(i) = tau_max[i] * f.J_over_M.col(i).head<3>().transpose();
  compute_axes(m, m.translation);
  for (Eigen::Index i = 0; i < n; ++i) m.rows.row(i) = tau_max[i] * f.J_over_M.col(i).tail<3>().transpose();
  compute_axes(m, m.rotation);
  if (f.massless) m.translation.lengths = m.rotation.lengths = Eigen::Vector3d::Constant(kInfinite);

  Twist centre;
  jacobian_dot_times_dq(mechanism, data, q, dq, frame, centre);
  bias(mechanism, data, q, dq, f.x);
  for (Eigen::Index i = 0; i < n; ++i) centre -= f.x[i] * f.J_over_M.col(i);
  m.translation.centre = centre.head<3>();
  m.rotation.centre = centre.tail<3>();
}

void singular_values(Eigen::Ref<Eigen::MatrixXd> rows, VectorOut values) {
  assert(values.size() == rows.cols());
  make_orthogonal(rows, [](const auto&, Eigen::Index, Eigen::Index) {});
  values = rows.colwise().norm().transpose();
  std::sort(values.data(), values.data() + values.size(), std::greater<>());
}

double moving_mass(const RobotModel& robot) {
  double M = 0;
  for (const Body& body : robot.bodies) M += body.inertia.mass;
  return M;
}

double simple_effective_mass(double M, double m_L) { return M / 2 + m_L; }

double reduced_mass(double m_u, double m_H) { return 1 / (1 / m_u + 1 / m_H); }
double collision_energy(double mu, double v) { return mu * v * v / 2; }
double speed_limit_of_force(double F_max, double k_H, double mu) { return F_max / std::sqrt(mu * k_H); }

}  // namespace cotwin::robot
