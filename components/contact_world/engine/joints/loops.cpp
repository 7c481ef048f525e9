#include "components/contact_world/engine/joints/loops.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cotwin::contact_world {
namespace {

using scene::JointType;

/// Singular values below this share of the largest are rounding: their directions are not constrained.
constexpr double kResolvedColumn = 1e-5;

/// A singular value that changes to 0 within this number of steps belongs to a singular pose.
constexpr double kStepsToSingular = 3;

/// Largest speed of a correction along one direction: this share of the tree's motion, and a speed of the bodies in m/s.
constexpr double kShareOfMotion = 0.2, kCreep = 0.05;

double dot(const double* a, const double* b, std::size_t n) {
  double sum = 0;
  for (std::size_t i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

int linear_rows(JointType type) { return type == JointType::kPrismatic ? 2 : 3; }

int angular_rows(JointType type) {
  switch (type) {
    case JointType::kSpherical:
      return 0;
    case JointType::kRevolute:
    case JointType::kScrew:
      return 2;
    case JointType::kPrismatic:
    case JointType::kFixed:
      return 3;
  }
  return 0;
}

double error_of(const Loops::Row& row, std::span<const Joint> joints) {
  const Motion6 e = joints[static_cast<std::size_t>(row.joint)].error();
  return row.d.dot(e.linear) + row.m.dot(e.angular);
}

}  // namespace

void Loops::add(int joint, JointType type, int node_a, int node_b, int carrier_a, int carrier_b) {
  Row row;
  row.joint = joint;
  row.node_a = node_a;
  row.node_b = node_b;
  row.carrier_a = carrier_a;
  row.carrier_b = carrier_b;
  rows_.insert(rows_.end(), static_cast<std::size_t>(linear_rows(type) + angular_rows(type)), row);
}

void Loops::reserve(int freedoms) {
  freedoms_ = static_cast<std::size_t>(freedoms);
  const std::size_t n = rows_.size();
  rank_ = std::min(n, freedoms_);
  Y_.resize(n * freedoms_);
  U_.resize(n * rank_);
  V_.resize(freedoms_ * rank_);
  for (std::vector<double>* v : {&sigma_, &along_}) v->resize(rank_);
  for (std::vector<double>* v : {&present_, &wanted_}) v->resize(n);
  memory_.resize(3 * n + 2 * rank_ + 1);
  const auto size = static_cast<Eigen::Index>(rank_);
  gram_.resize(size, size);
}

void Loops::place(const Vector3d& O, std::span<const RigidBody> bodies, std::span<const Joint> joints) {
  int last = -1, k = 0;
  for (Row& row : rows_) {
    k = row.joint == last ? k + 1 : 0;
    last = row.joint;
    const Joint& joint = joints[static_cast<std::size_t>(row.joint)];
    const int linear = linear_rows(joint.type);
    row.d = row.m = Vector3d::Zero();
    (k < linear ? row.d : row.m) = joint.R_parent.col(k < linear ? k : k - linear);
    if (joint.type == JointType::kScrew && k == 2) row.m = -joint.pitch * joint.axis();
    row.p = joint.p_child;
    const Vector3d moment = row.m + (row.p - O).cross(row.d);
    row.f = {row.d[0], row.d[1], row.d[2], moment[0], moment[1], moment[2]};
    double mobility = 0;
    for (const int body : {joint.parent, joint.child}) {
      if (body >= 0) mobility += bodies[static_cast<std::size_t>(body)].mobility(row.d, row.m, row.p);
    }
    row.scale = mobility > 0 ? 1 / std::sqrt(mobility) : 0;
  }
}

// The singular values from the eigenvalues of Y Yᵀ or Yᵀ Y, whichever is smaller. Squaring loses values below √ε of the largest,
// which are not resolved anyway.
void Loops::decompose(std::uint32_t locks) {
  const std::size_t n = rows_.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < freedoms_; ++k) Y_[i * freedoms_ + k] *= rows_[i].scale;
  }
  const bool by_rows = n <= freedoms_;
  const auto entry = [&](std::size_t i, std::size_t k) { return Y_[i * freedoms_ + k]; };
  for (std::size_t i = 0; i < rank_; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = 0;
      if (by_rows) {
        sum = dot(&Y_[i * freedoms_], &Y_[j * freedoms_], freedoms_);
      } else {
        for (std::size_t k = 0; k < n; ++k) sum += entry(k, i) * entry(k, j);
      }
      gram_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = sum;
    }
  }
  kept_ = 0;
  if (rank_ == 0) return;
  solver_.compute(gram_);
  const auto& values = solver_.eigenvalues();
  const auto& vectors = solver_.eigenvectors();
  const double largest = std::max(0.0, values[static_cast<Eigen::Index>(rank_) - 1]);
  double *last = memory_.data() + 3 * n, *change = last + rank_, *last_locks = change + rank_;
  const bool comparable = since_ == Since::kStep && *last_locks == static_cast<double>(locks);
  for (std::size_t k = rank_; k-- > 0;) {  // the largest first
    const auto column = static_cast<Eigen::Index>(k);
    const double sigma = std::sqrt(std::max(0.0, values[column]));
    if (comparable) change[k] = std::max(std::abs(sigma - last[k]), change[k] / 2);
    if (since_ != Since::kSamePlace) last[k] = sigma;
    if (!(values[column] > kResolvedColumn * kResolvedColumn * largest) || sigma < kStepsToSingular * change[k]) continue;
    double *u = &U_[kept_ * n], *v = &V_[kept_ * freedoms_];
    if (by_rows) {
      std::fill_n(v, freedoms_, 0.0);
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < freedoms_; ++j) v[j] += vectors(static_cast<Eigen::Index>(i), column) * entry(i, j);
      }
    } else {
      for (std::size_t j = 0; j < freedoms_; ++j) v[j] = vectors(static_cast<Eigen::Index>(j), column);
    }
    for (std::size_t earlier = 0; earlier < kept_; ++earlier) {  // small values lose their right angle to the large ones
      const double share = dot(v, &V_[earlier * freedoms_], freedoms_);
      for (std::size_t j = 0; j < freedoms_; ++j) v[j] -= share * V_[earlier * freedoms_ + j];
    }
    const double length = std::sqrt(dot(v, v, freedoms_));
    if (!(length > 0)) continue;
    for (std::size_t j = 0; j < freedoms_; ++j) v[j] /= length;
    double square = 0;
    for (std::size_t i = 0; i < n; ++i) {
      u[i] = dot(&Y_[i * freedoms_], v, freedoms_);
      square += u[i] * u[i];
    }
    sigma_[kept_] = std::sqrt(square);
    for (std::size_t i = 0; i < n; ++i) u[i] /= sigma_[kept_];
    ++kept_;
  }
  if (since_ != Since::kSamePlace) *last_locks = locks;
  since_ = Since::kSamePlace;
}

bool Loops::nearly_singular() const {
  constexpr double kNever = 1e-7, kWell = 0.05;  // of the largest singular value
  const double* sigma = memory_.data() + 3 * rows_.size();
  const double largest = rank_ == 0 ? 0 : *std::max_element(sigma, sigma + rank_);
  return std::any_of(sigma, sigma + rank_, [&](double s) { return s > kNever * largest && s < kWell * largest; });
}

void Loops::project(double* y) const {
  for (std::size_t k = 0; k < kept_; ++k) {
    const double* v = &V_[k * freedoms_];
    const double share = dot(v, y, freedoms_);
    for (std::size_t j = 0; j < freedoms_; ++j) y[j] -= share * v[j];
  }
}

void Loops::solve() {
  if (!limited_) limit_start();
  const std::size_t n = rows_.size();
  for (Row& row : rows_) row.impulse = 0;
  for (std::size_t k = 0; k < kept_; ++k) {
    const double* u = &U_[k * n];
    double change = 0;
    for (std::size_t i = 0; i < n; ++i) change += u[i] * rows_[i].scale * (rows_[i].speed - present_[i]);
    change /= sigma_[k] * sigma_[k];
    for (std::size_t i = 0; i < n; ++i) rows_[i].impulse += u[i] * rows_[i].scale * change;
  }
}

void Loops::clear_speeds() {
  for (Row& row : rows_) row.speed = 0;
  limited_ = true;
}

/// Replaces speeds of the rows by the nearest that the freedoms can reach within the limit along each direction. Returns
/// whether the limit was less than a wanted speed.
bool Loops::limit(std::span<double> speeds) {
  const std::size_t n = rows_.size();
  bool held_back = false;
  for (std::size_t k = 0; k < kept_; ++k) {
    double share = 0;
    for (std::size_t i = 0; i < n; ++i) share += U_[k * n + i] * rows_[i].scale * speeds[i];
    const double most = furthest_ * sigma_[k];
    held_back = held_back || std::abs(share) > most;
    along_[k] = std::clamp(share, -most, most);
  }
  for (std::size_t i = 0; i < n; ++i) {
    speeds[i] = 0;
    if (rows_[i].scale == 0) continue;
    for (std::size_t k = 0; k < kept_; ++k) speeds[i] += U_[k * n + i] * along_[k] / rows_[i].scale;
  }
  return held_back;
}

void Loops::limit_start() {
  const auto replace = [&](double Row::*speed) {
    for (std::size_t i = 0; i < rows_.size(); ++i) wanted_[i] = rows_[i].*speed;
    held_back_ = limit(wanted_) || held_back_;
    for (std::size_t i = 0; i < rows_.size(); ++i) rows_[i].*speed = wanted_[i];
  };
  replace(&Row::start);
  replace(&Row::speed);
  limited_ = true;
}

void Loops::predict(std::span<const Joint> joints, double h, double momentum) {
  double heaviest = 0;
  for (const Row& row : rows_) {
    if (!row.d.isZero(0)) heaviest = std::max(heaviest, row.scale);
  }
  furthest_ = kShareOfMotion * momentum + kCreep * heaviest;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    rows_[i].start = -error_of(rows_[i], joints) / h;
    rows_[i].speed = rows_[i].start + 3 * curve(i)[0] - 3 * curve(i)[1] + curve(i)[2];
  }
  limited_ = held_back_ = false;
}

void Loops::restart() {
  for (Row& row : rows_) row.speed = row.start;
}

double Loops::measure(std::span<const Joint> joints, double h) {
  for (std::size_t i = 0; i < rows_.size(); ++i) wanted_[i] = rows_[i].speed - error_of(rows_[i], joints) / h;
  held_back_ = limit(wanted_) || held_back_;
  double largest = 0;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    rows_[i].correction = wanted_[i] - rows_[i].speed;
    largest = std::max(largest, std::abs(rows_[i].correction) * h);
  }
  return largest;
}

void Loops::correct() {
  for (Row& row : rows_) row.speed += row.correction;
}

void Loops::store() {
  if (held_back_) return clear_history();
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const Row& row = rows_[i];
    curve(i)[2] = curve(i)[1];
    curve(i)[1] = curve(i)[0];
    curve(i)[0] = row.speed + row.correction - row.start;
  }
}

void Loops::clear_history() { std::fill_n(memory_.begin(), 3 * rows_.size(), 0.0); }

}  // namespace cotwin::contact_world
