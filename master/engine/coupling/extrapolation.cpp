#include "master/engine/coupling/extrapolation.h"

#include <algorithm>
#include <cmath>

namespace cotwin::master {

namespace {

constexpr double kForgotten = 0.5;  // of a miss, with each step

}  // namespace

void Extrapolation::add(const Eigen::VectorXd& first, const Eigen::VectorXd& last, const Eigen::VectorXd& scale,
                        bool continues) {
  if (!continues) {
    known_ = 0;
    missed_ = {};
  }
  known_ = std::min(known_ + 1, kMostDegree + 1);
  for (double& missed : missed_) missed *= kForgotten;
  for (Eigen::Index i = 0; i < first.size(); ++i) {
    double difference = last[i] - first[i];
    for (int k = 0; k < known_; ++k) {
      double& missed = missed_[static_cast<std::size_t>(k)];
      missed = std::max(missed, std::abs(difference) / scale[i]);
      const double before = differences_(i, k);
      differences_(i, k) = difference;
      difference -= before;
    }
  }
}

int Extrapolation::degree() const {
  if (known_ <= 1) return known_;  // what a line misses is not known yet
  // The lowest one that is about as good: after a jump all miss by it, and higher ones would repeat it several times.
  const double least = *std::min_element(missed_.begin(), missed_.begin() + known_);
  int degree = 0;
  while (missed_[static_cast<std::size_t>(degree)] > 2 * least) ++degree;
  return degree;
}

void Extrapolation::advance(Eigen::VectorXd& x, int degree) const {
  for (int k = 0; k < degree; ++k) x += differences_.col(k);
}

void Extrapolation::save(std::span<double> numbers) const {
  double* to = std::copy_n(differences_.data(), differences_.size(), numbers.data());
  to = std::copy(missed_.begin(), missed_.end(), to);
  *to = known_;
}

void Extrapolation::restore(std::span<const double> numbers) {
  const auto all = static_cast<std::size_t>(differences_.size());
  std::copy_n(numbers.begin(), all, differences_.data());
  std::copy_n(numbers.begin() + static_cast<std::ptrdiff_t>(all), missed_.size(), missed_.begin());
  const double known = numbers[all + missed_.size()];
  known_ = known >= 0 && known <= kMostDegree + 1 ? static_cast<int>(known) : 0;
}

}  // namespace cotwin::master
