#include "models/optimisation/evaluation/motion_basis.h"

#include <algorithm>

#include "models/trajectory/bernstein.h"

namespace cotwin::optimisation {

namespace bernstein = trajectory::bernstein;

namespace {
bool zero(const std::vector<double>& v) {
  return std::ranges::all_of(v, [](double x) { return x == 0; });
}
}  // namespace

bool Ends::at_rest() const { return zero(dq_from) && zero(ddq_from) && at_rest_at_end(); }
bool Ends::at_rest_at_end() const { return zero(dq_to) && zero(ddq_to); }

MotionBasis::MotionBasis(int degree, bool at_rest) : terms_(degree), at_rest_(at_rest) {
  const auto add = [&](const std::array<double, 3>& start, const std::array<double, 3>& end) {
    points_.push_back(bernstein::elevate(bernstein::quintic(start, end), degree));
  };
  add({1, 0, 0}, {});
  add({}, {1, 0, 0});
  if (!at_rest) {
    add({0, 1, 0}, {});
    add({0, 0, 1}, {});
    add({}, {0, 1, 0});
    add({}, {0, 0, 1});
  }
  for (std::size_t k = 0; k < terms_.size(); ++k) points_.emplace_back(terms_.term(k).begin(), terms_.term(k).end());
}

numerics::BatchMatrix MotionBasis::table(std::span<const double> s, int derivative) const {
  std::vector<double> A(s.size() * columns());
  for (std::size_t k = 0; k < s.size(); ++k)
    for (std::size_t c = 0; c < columns(); ++c)
      A[k * columns() + c] = bernstein::evaluate(points_[c], s[k])[static_cast<std::size_t>(derivative)];
  return {s.size(), columns(), A.data()};
}

numerics::BatchMatrix MotionBasis::hull(int parts, int derivative) const {
  const std::size_t own = static_cast<std::size_t>(degree() - derivative);
  const std::size_t rows = static_cast<std::size_t>(parts) * own + 1;
  std::vector<double> A(rows * columns());
  for (std::size_t c = 0; c < columns(); ++c) {
    std::vector<double> b = points_[c];
    for (int r = 0; r < derivative; ++r) {
      const double d = static_cast<double>(b.size() - 1);
      for (std::size_t i = 0; i + 1 < b.size(); ++i) b[i] = d * (b[i + 1] - b[i]);
      b.pop_back();
    }
    for (int part = 0; part < parts; ++part) {  // cuts off the first of the remaining parts (de Casteljau)
      const double at = 1.0 / static_cast<double>(parts - part);
      std::vector<double> first = b;
      for (std::size_t level = 1; level < b.size(); ++level) {
        for (std::size_t i = 0; i + level < b.size(); ++i) b[i] = (1 - at) * b[i] + at * b[i + 1];
        first[level] = b[0];
      }
      for (std::size_t i = 0; i < first.size(); ++i) A[(static_cast<std::size_t>(part) * own + i) * columns() + c] = first[i];
    }
  }
  return {rows, columns(), A.data()};
}

}  // namespace cotwin::optimisation
