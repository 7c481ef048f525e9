#include "components/drive_train/limit_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace cotwin::drive_train {
namespace {

constexpr double kNever = -1e10;    // s, before any run
constexpr double kRounding = 1e-9;  // relative to the range between the limits, as for waypoints

double slack(double low, double high) { return std::isfinite(high - low) ? kRounding * (high - low) : 0; }

}  // namespace

LimitWatch::LimitWatch(std::vector<robot::Joint> joints)
    : passed_at(joints.size(), kNever), passed_below(joints.size(), kNever), joints_(std::move(joints)) {}

void LimitWatch::clear() {
  std::fill(passed_at.begin(), passed_at.end(), kNever);
  std::fill(passed_below.begin(), passed_below.end(), kNever);
}

void LimitWatch::look(const double* q, const Parameters& p, double t) {
  for (std::size_t i = 0; i < passed_at.size(); ++i) {
    if (q[i] > p.q_max[i] && passed_at[i] == kNever && q[i] > p.q_max[i] + slack(p.q_min[i], p.q_max[i])) passed_at[i] = t;
    if (q[i] < p.q_min[i] && passed_below[i] == kNever && q[i] < p.q_min[i] - slack(p.q_min[i], p.q_max[i]))
      passed_below[i] = t;
  }
}

std::size_t LimitWatch::count() const {
  std::size_t count = 0;
  for (std::size_t i = 0; i < passed_at.size(); ++i) count += passed_at[i] > kNever || passed_below[i] > kNever ? 1 : 0;
  return count;
}

void LimitWatch::describe(const Parameters& p, std::string& text) const {
  std::size_t first = passed_at.size();
  double when = 0;
  bool upper = true;
  const auto offer = [&](std::size_t i, double t, bool above) {
    if (t == kNever || (first < passed_at.size() && t >= when)) return;
    first = i;
    when = t;
    upper = above;
  };
  for (std::size_t i = 0; i < passed_at.size(); ++i) {
    offer(i, passed_at[i], true);
    offer(i, passed_below[i], false);
  }
  if (first == passed_at.size()) return;
  char what[200];
  const int length = std::snprintf(what, sizeof what, "joint %.60s %s its %s limit of %.6g %s at %.6g s",
                                   joints_[first].name.c_str(), p.stop_stiffness[first] > 0 ? "came to the stop at" : "passed",
                                   upper ? "upper" : "lower", upper ? p.q_max[first] : p.q_min[first],
                                   joints_[first].type == robot::JointType::kPrismatic ? "m" : "rad", when);
  text.append(what, static_cast<std::size_t>(std::clamp(length, 0, static_cast<int>(sizeof what) - 1)));
  const std::size_t others = count() - 1;
  if (others == 0) return;
  const int more = std::snprintf(what, sizeof what, ", and %zu other%s later", others, others > 1 ? "s" : "");
  text.append(what, static_cast<std::size_t>(std::max(more, 0)));
}

}  // namespace cotwin::drive_train
