#include "models/robot/inverse_kinematics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/numerics/random.h"

namespace cotwin::robot {

namespace {

using Eigen::Matrix3d, Eigen::MatrixXd, Eigen::Quaterniond, Eigen::Vector3d, Eigen::VectorXd;

constexpr double kLength = 0.3;       // m: a rotation by 1 rad counts as much as this distance
constexpr double kTolerance = 1e-10;  // m, rad: a pose is reached
constexpr double kRank = 1e-7;        // of the largest singular value
constexpr double kPi = std::numbers::pi;
constexpr const char* kNames[6] = {"x", "y", "z", "rx", "ry", "rz"};

Matrix3d cross(const Vector3d& v) { return (Matrix3d() << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0).finished(); }

double wrapped(double angle) { return std::remainder(angle, 2 * kPi); }

/// The quaternion of the error with w >= 0, in the base or in the tool.
Quaterniond rotation_left(const Quaterniond& target, const Quaterniond& at, bool of_tool) {
  Quaterniond E = of_tool ? at.conjugate() * target : target * at.conjugate();
  if (E.w() < 0) E.coeffs() = -E.coeffs();
  return E;
}

Vector3d rotation_vector(const Quaterniond& E) {
  const double sine = E.vec().norm();
  return sine > 0 ? Vector3d(2 * std::atan2(sine, E.w()) / sine * E.vec()) : Vector3d(2 * E.vec());
}

/// B with ψ̇ = −B ω for the rotation vector ψ of the error and the angular velocity ω of the frame. Regular up to |ψ| = π.
Matrix3d rate_matrix(const Vector3d& psi) {
  const double x = psi.squaredNorm(), r = std::sqrt(x);
  const double c = x < 1e-4 ? 1.0 / 12 + x / 720 : (1 - 0.5 * r / std::tan(0.5 * r)) / x;
  return Matrix3d::Identity() + 0.5 * cross(psi) + c * cross(psi) * cross(psi);
}

}  // namespace

int TaskDirections::count() const { return static_cast<int>(std::count(used.begin(), used.end(), true)); }

TaskDirections task_directions(const std::string& names, bool of_tool) {
  TaskDirections task;
  task.of_tool = of_tool;
  if (text::trim(names) == "all") return task;
  task.used.fill(false);
  for (const std::string_view part : text::split(names, ',')) {
    const auto* const found = std::find(std::begin(kNames), std::end(kNames), text::trim(part));
    if (found == std::end(kNames)) {
      throw Error("task directions", "'" + std::string(text::trim(part)) + "', expected all, or some of x, y, z, rx, ry, rz");
    }
    task.used[static_cast<std::size_t>(found - std::begin(kNames))] = true;
  }
  return task;
}

double arm_angle(const Vector3d& shoulder, const Vector3d& elbow, const Vector3d& wrist) {
  const Vector3d line = (wrist - shoulder).normalized();
  const Vector3d up = Vector3d::UnitZ() - line * line.z(), out = elbow - shoulder;
  return std::atan2(line.dot(up.cross(out)), up.dot(out));
}

InverseKinematics::InverseKinematics(const RobotModel& robot, const Frame& frame, const TaskDirections& task,
                                     const PostureChoice& choice)
    : robot_(robot),
      frame_(frame.name),
      task_(task),
      choice_(choice),
      n_(robot.n()),
      rows_(task.count()),
      kinematics_(robot, frame),
      mechanism_(robot),
      data_(mechanism_),
      q_min_(n_),
      q_max_(n_),
      weight_(VectorXd::Ones(n_)),
      J_(6, n_) {
  if (rows_ == 0) throw Error("inverse kinematics", "no task direction, expected at least one of x, y, z, rx, ry, rz");
  for (int i = 0; i < n_; ++i) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(i)];
    q_min_[i] = joint.q_min;
    q_max_[i] = joint.q_max;
    const double half = 0.5 * (joint.q_max - joint.q_min);
    if (choice.kind == PostureChoice::Kind::kCentre) {
      const double range = std::isfinite(half) ? half : joint.type == JointType::kRevolute ? kPi : 1;
      weight_[i] = range > 0 ? 1 / (range * range) : 1;
    }
  }
  if (choice.kind == PostureChoice::Kind::kJoint && (choice.joint < 0 || choice.joint >= n_)) {
    throw Error("inverse kinematics", "joint " + std::to_string(choice.joint + 1) + ", expected 1 to " + std::to_string(n_));
  }
  if (choice.kind == PostureChoice::Kind::kArmAngle) {
    bool seven = n_ == 7 && robot.mimics.empty();
    for (int i = 0; i < n_; ++i) {
      const Joint& joint = robot.joints[static_cast<std::size_t>(i)];
      seven = seven && joint.type == JointType::kRevolute && joint.parent == i - 1;
    }
    if (!seven)
      throw Error("inverse kinematics", robot.name + " is not a chain of seven revolute joints, which an arm angle needs");
  }
}

double InverseKinematics::value_of(const VectorIn& q) {
  if (choice_.kind == PostureChoice::Kind::kJoint) return q[choice_.joint];
  const auto origin = [&](int body) { return forward_kinematics(mechanism_, data_, q, {body, Pose{}}).p; };
  return arm_angle(origin(1), origin(3), origin(5));
}

FrameMotion InverseKinematics::linearise(const PoseTarget& target, const VectorIn& q, VectorOut e, MatrixOut J) {
  const FrameMotion at = kinematics_.jacobian(q, J_);
  const Quaterniond E = rotation_left(target.Q, at.Q, task_.of_tool);
  Vector3d distance = target.p - at.p;
  const Matrix3d A = E.w() * Matrix3d::Identity() + cross(E.vec());
  const Matrix3d to_tool = task_.of_tool ? Matrix3d(target.Q.toRotationMatrix().transpose()) : Matrix3d::Identity();
  distance = to_tool * distance;
  for (int i = 0, row = 0; i < 6; ++i) {
    if (!task_.used[static_cast<std::size_t>(i)]) continue;
    e[row] = i < 3 ? distance[i] : 2 * E.vec()[i - 3];
    const Eigen::RowVector3d weights = i < 3 ? Eigen::RowVector3d(to_tool.row(i)) : Eigen::RowVector3d(A.row(i - 3) * to_tool);
    J.row(row++).noalias() = weights.lazyProduct(J_.middleRows<3>(i < 3 ? 0 : 3));
  }
  return at;
}

InverseKinematics::Residual InverseKinematics::residual(const PoseTarget& target, const VectorIn& q) {
  const bool extra = choice_.kind == PostureChoice::Kind::kJoint || choice_.kind == PostureChoice::Kind::kArmAngle;
  Residual r;
  r.e.resize(rows_ + (extra ? 1 : 0));
  r.J.resize(r.e.size(), n_);
  const FrameMotion at = kinematics_.jacobian(q, J_);
  const Vector3d psi = rotation_vector(rotation_left(target.Q, at.Q, task_.of_tool));
  const Matrix3d to_tool = task_.of_tool ? Matrix3d(target.Q.toRotationMatrix().transpose()) : Matrix3d::Identity();
  const Vector3d distance = to_tool * (target.p - at.p);
  const Matrix3d B = rate_matrix(psi) * to_tool;
  for (int i = 0, row = 0; i < 6; ++i) {
    if (!task_.used[static_cast<std::size_t>(i)]) continue;
    if (i < 3) {
      r.e[row] = distance[i];
      r.J.row(row++) = to_tool.row(i) * J_.topRows<3>();
      r.distance = std::max(r.distance, std::abs(distance[i]));
    } else {
      r.e[row] = kLength * psi[i - 3];
      r.J.row(row++) = kLength * B.row(i - 3) * J_.bottomRows<3>();
      r.angle = std::max(r.angle, std::abs(psi[i - 3]));
    }
  }
  if (!extra) return r;
  double left = choice_.value - value_of(q);
  if (choice_.kind == PostureChoice::Kind::kJoint) {
    r.J.row(rows_).setZero();
    r.J(rows_, choice_.joint) = kLength;
  } else {
    left = wrapped(left);
    VectorXd moved = q;
    for (int j = 0; j < n_; ++j) {
      constexpr double kStep = 1e-6;  // rad
      moved[j] = q[j] + kStep;
      const double after = value_of(moved);
      moved[j] = q[j] - kStep;
      r.J(rows_, j) = kLength * wrapped(after - value_of(moved)) / (2 * kStep);
      moved[j] = q[j];
    }
  }
  r.e[rows_] = kLength * left;
  r.choice = std::abs(left);
  return r;
}

std::array<double, 2> InverseKinematics::error(const PoseTarget& target, const VectorIn& q) {
  const Residual r = residual(target, q);
  return {r.distance, r.angle};
}

/// Levenberg–Marquardt steps within the joint limits from q. A joint at a limit that the gradient pushes outwards is held.
InverseKinematics::Residual InverseKinematics::search(const PoseTarget& target, VectorXd& q) {
  q = q.cwiseMax(q_min_).cwiseMin(q_max_);
  Residual r = residual(target, q);
  double E = 0.5 * r.e.squaredNorm(), nu = 1;
  for (int iteration = 0; iteration < 120; ++iteration) {
    if (r.within(1e-14)) break;
    const VectorXd gradient = r.J.transpose() * r.e;
    MatrixXd H = r.J.transpose() * r.J;
    VectorXd g = gradient;
    for (int i = 0; i < n_; ++i) {
      const bool held = (q[i] <= q_min_[i] && g[i] < 0) || (q[i] >= q_max_[i] && g[i] > 0);
      if (!held) continue;
      H.row(i).setZero();
      H.col(i).setZero();
      g[i] = 0;
    }
    if (g.norm() < 1e-9 * std::sqrt(2 * E) && !r.within(kTolerance)) break;  // a minimum that is not the pose
    bool better = false;
    for (int trial = 0; trial < 12 && !better; ++trial) {
      MatrixXd damped = H;
      damped.diagonal().array() += nu * E + 1e-15;
      VectorXd step = numerics::solve_ldlt(damped, g);
      const double largest = step.cwiseAbs().maxCoeff();
      if (!(largest < 1e6)) break;
      if (largest > 0.8) step *= 0.8 / largest;  // rad, m
      const VectorXd next = (q + step).cwiseMax(q_min_).cwiseMin(q_max_);
      Residual there = residual(target, next);
      const double E_there = 0.5 * there.e.squaredNorm();
      better = E_there < E;
      nu = better ? std::max(nu / 4, 1e-3) : nu * 8;
      if (!better) continue;
      const bool stalls = E_there > 0.9999 * E && E > 1e-18;
      q = next;
      r = std::move(there);
      E = E_there;
      if (stalls && iteration > 60) return r;
    }
    if (!better) break;
  }
  return r;
}

VectorXd InverseKinematics::desired(const VectorIn& reference) const {
  if (choice_.kind != PostureChoice::Kind::kCentre) return reference;
  VectorXd centre(n_);
  for (int i = 0; i < n_; ++i) {
    const double middle = 0.5 * (q_min_[i] + q_max_[i]);
    centre[i] = std::isfinite(middle) ? middle : 0;
  }
  return centre;
}

double InverseKinematics::preference(const VectorIn& reference, const VectorIn& q) const {
  return (q - desired(reference)).cwiseAbs2().dot(weight_);
}

/// Turns revolute joints by whole turns to where they are closest to the desired posture, within their limits.
void InverseKinematics::unwind(const VectorIn& reference, VectorXd& q) const {
  const VectorXd wanted = desired(reference);
  for (int i = 0; i < n_; ++i) {
    const auto leads = [i](const Mimic& m) { return m.leader == i; };
    if (robot_.joints[static_cast<std::size_t>(i)].type != JointType::kRevolute) continue;
    if (std::any_of(robot_.mimics.begin(), robot_.mimics.end(), leads)) continue;
    if (choice_.kind == PostureChoice::Kind::kJoint && choice_.joint == i) continue;
    const double turns = std::round((wanted[i] - q[i]) / (2 * kPi));
    for (double k = turns; k != 0; k -= turns > 0 ? 1 : -1) {
      const double turned = q[i] + 2 * kPi * k;
      if (turned < q_min_[i] || turned > q_max_[i]) continue;
      q[i] = turned;
      break;
    }
  }
}

/// Moves a solution along its self-motion towards the desired posture, within the limits.
void InverseKinematics::improve(const PoseTarget& target, const VectorIn& reference, VectorXd& q) {
  const VectorXd wanted = desired(reference);
  double best = preference(reference, q), share = 1;
  for (int iteration = 0; iteration < 100 && share > 1e-4; ++iteration) {
    const Residual r = residual(target, q);
    const VectorXd pull = wanted - q;
    VectorXd move;
    std::vector<bool> held(static_cast<std::size_t>(n_), false);
    for (int pass = 0; pass <= n_; ++pass) {  // joints at a limit that the motion would pass are held
      MatrixXd J = r.J;
      for (int i = 0; i < n_; ++i) {
        if (held[static_cast<std::size_t>(i)]) J.col(i).setZero();
      }
      // Least |W^½ (pull − move)| with J move = 0: projection of the pull in the metric W.
      const VectorXd root = weight_.cwiseSqrt();
      const MatrixXd scaled = J * root.cwiseInverse().asDiagonal();
      const numerics::Svd svd = numerics::svd(scaled);
      const VectorXd& sigma = svd.values;
      const auto rank = (sigma.array() > kRank * sigma[0]).count();
      const MatrixXd Z = svd.V.rightCols(n_ - rank);
      VectorXd pulled = root.cwiseProduct(pull);
      for (int i = 0; i < n_; ++i) {
        if (held[static_cast<std::size_t>(i)]) pulled[i] = 0;
      }
      move = root.cwiseInverse().cwiseProduct(Z * (Z.transpose() * pulled));
      bool passes = false;
      for (int i = 0; i < n_; ++i) {
        const bool out = (q[i] <= q_min_[i] && move[i] < 0) || (q[i] >= q_max_[i] && move[i] > 0);
        passes = passes || (out && !held[static_cast<std::size_t>(i)]);
        if (out) held[static_cast<std::size_t>(i)] = true;
      }
      if (!passes) break;
    }
    if (move.cwiseAbs().maxCoeff() < 1e-7) return;
    const double longest = move.cwiseAbs().maxCoeff();
    VectorXd next = q + share * std::min(1.0, 0.3 / longest) * move;
    const bool solved = search(target, next).within(kTolerance);
    const double there = preference(reference, next);
    if (solved && there < best && (next - q).cwiseAbs().maxCoeff() < 1) {
      q = next;
      best = there;
      share = std::min(1.0, 2 * share);
    } else {
      share /= 2;
    }
  }
}

VectorXd InverseKinematics::draw(int start) const {
  VectorXd q(n_);
  for (int i = 0; i < n_; ++i) {
    const bool revolute = robot_.joints[static_cast<std::size_t>(i)].type == JointType::kRevolute;
    const double width = revolute ? kPi : 1;
    const double low = std::isfinite(q_min_[i]) ? q_min_[i] : std::isfinite(q_max_[i]) ? q_max_[i] - 2 * width : -width;
    const double high = std::isfinite(q_max_[i]) ? q_max_[i] : std::isfinite(q_min_[i]) ? q_min_[i] + 2 * width : width;
    const double x = numerics::uniform(
        {.seed = 14, .stream = 0, .round = static_cast<std::uint32_t>(start), .particle = static_cast<std::uint32_t>(i)});
    q[i] = start == 1 ? 0.5 * (low + high) : low + x * (high - low);
  }
  return q;
}

Posture InverseKinematics::solve(const PoseTarget& target, const VectorIn& reference, int starts) {
  const int most = std::max(starts, 128);
  Posture best;
  double best_value = 0;
  Residual least;
  for (int start = 0; start < most && (start < starts || best.solutions == 0); ++start) {
    VectorXd q = start == 0 ? VectorXd(reference) : draw(start);
    const Residual r = search(target, q);
    ++best.starts;
    if (!r.within(kTolerance)) {
      if (best.solutions > 0 || (least.e.size() > 0 && least.e.squaredNorm() <= r.e.squaredNorm())) continue;
      least = r;
      best.q = q;
      best.distance = r.distance;
      best.angle = r.angle;
      best.choice_error = r.choice;
      continue;
    }
    unwind(reference, q);
    improve(target, reference, q);
    VectorXd exact = q;
    if (track(target, reference, exact) && (exact - q).cwiseAbs().maxCoeff() < 0.01 &&
        (exact.array() >= q_min_.array()).all() && (exact.array() <= q_max_.array()).all()) {
      q = exact;
    }
    const double value = preference(reference, q);
    if (best.solutions++ > 0 && value >= best_value) continue;
    const Residual reached = residual(target, q);
    best_value = value;
    best.q = q;
    best.reached = true;
    best.distance = reached.distance;
    best.angle = reached.angle;
    best.choice_error = reached.choice;
  }
  if (!best.reached) best.message = shortfall(least, best.q);
  return best;
}

std::string InverseKinematics::shortfall(const Residual& r, const VectorIn& q) const {
  const auto number = [](double x) { return text::to_text(x, 3); };
  std::string limits;
  for (int i = 0; i < n_; ++i) {
    const Joint& joint = robot_.joints[static_cast<std::size_t>(i)];
    const bool low = q[i] <= q_min_[i] + 1e-9, high = q[i] >= q_max_[i] - 1e-9;
    if (!low && !high) continue;
    text::append(limits, joint.name + " at its limit of " + text::to_text(low ? q_min_[i] : q_max_[i], 6) +
                             (joint.type == JointType::kRevolute ? " rad" : " m"));
  }
  std::string left = number(r.distance) + " m and " + number(r.angle) + " rad";
  if (choice_.kind == PostureChoice::Kind::kJoint) left += " (and " + number(r.choice) + " of the given joint)";
  if (choice_.kind == PostureChoice::Kind::kArmAngle) left += " (and " + number(r.choice) + " rad of the arm angle)";
  const std::string few = n_ < rows_ ? "; " + std::to_string(n_) + " joints cannot follow " + std::to_string(rows_) +
                                           " directions everywhere, name those that count"
                                     : "";
  return left + " are left for " + frame_ + " of " + robot_.name + ", with " +
         (limits.empty() ? std::string("no joint at its limit: out of reach") : limits) + few;
}

bool InverseKinematics::track(const PoseTarget& target, const VectorIn& reference, VectorXd& q) {
  const VectorXd wanted = desired(reference), root = weight_.cwiseSqrt();
  for (int iteration = 0; iteration < 30; ++iteration) {
    const Residual r = residual(target, q);
    if (!r.e.allFinite() || !q.allFinite()) return false;
    const numerics::Svd svd = numerics::svd(r.J * root.cwiseInverse().asDiagonal());
    const VectorXd& sigma = svd.values;
    const auto rank = (sigma.array() > kRank * sigma[0]).count();
    VectorXd step = VectorXd::Zero(n_);  // of W^½ q
    for (Eigen::Index k = 0; k < rank; ++k) {
      const double damped = sigma[k] / (sigma[k] * sigma[k] + 1e-3 * r.e.squaredNorm());
      step += svd.V.col(k) * (damped * svd.U.col(k).dot(r.e));
    }
    VectorXd slide = VectorXd::Zero(n_);
    if (const auto free = n_ - rank; free > 0) {
      // Newton's step along the self-motion: the slope of the projected gradient by differences along each direction.
      const MatrixXd Z = svd.V.rightCols(free);
      const auto projected_pull = [&](const VectorXd& at) {
        const Residual there = residual(target, at);
        const MatrixXd N = numerics::svd(there.J * root.cwiseInverse().asDiagonal()).V.rightCols(free);
        return VectorXd(N * (N.transpose() * root.cwiseProduct(wanted - at)));
      };
      const VectorXd pull = projected_pull(q);
      MatrixXd slope(free, free);
      for (Eigen::Index k = 0; k < free; ++k) {
        constexpr double kStep = 1e-5;
        const VectorXd along = root.cwiseInverse().cwiseProduct(Z.col(k)) * kStep;
        slope.col(k) = Z.transpose() * (projected_pull(q - along) - projected_pull(q + along)) / (2 * kStep);
      }
      slope = 0.5 * (slope + slope.transpose()).eval();
      // A maximum or saddle of the preference: follow the pull itself.
      const auto newton = numerics::solve_semidefinite(slope, Z.transpose() * pull);
      slide = newton && slope.diagonal().minCoeff() > 1e-3 ? VectorXd(Z * *newton) : pull;
    }
    const double task_step = step.cwiseAbs().maxCoeff(), null_step = slide.cwiseAbs().maxCoeff();
    if (r.within(1e-12) && null_step < 1e-10) return true;
    step += slide;
    const double longest = step.cwiseAbs().maxCoeff();
    if (longest > 0.2) step *= 0.2 / longest;
    if (task_step < 1e-15 && null_step < 1e-12) return r.within(kTolerance);
    q += root.cwiseInverse().cwiseProduct(step);
  }
  return residual(target, q).within(kTolerance);
}

}  // namespace cotwin::robot
