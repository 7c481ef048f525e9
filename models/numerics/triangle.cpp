#include "models/numerics/triangle.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "models/numerics/kernels/kernels.h"
#include "models/support/error.h"

namespace cotwin::numerics {

Triangle::Triangle(std::size_t columns, double forgetting)
    : columns_(columns), forgetting_(forgetting), R_(columns * columns, 0.0), block_(columns * kRows, 0.0) {
  if (columns == 0) throw Error("triangle", "has 0 columns, expected at least 1");
  if (!(forgetting > 0 && forgetting <= 1))
    throw Error("triangle", "forgetting factor " + std::to_string(forgetting) + ", expected above 0 to 1");
}

double Triangle::weight() const {
  double weight = weight_;
  for (std::size_t r = 0; r < pending_; ++r) weight = forgetting_ * weight + 1;
  return weight;
}

void Triangle::add(const double* row) {
  double* to = next();
  for (std::size_t c = 0; c < columns_; ++c) to[c * kRows] = row[c];
  commit();
}

void Triangle::commit() {
  ++rows_;
  if (++pending_ == kRows) flush();
}

void Triangle::age(std::size_t rows) {
  if (forgetting_ == 1) return;
  const double factor = std::pow(forgetting_, 0.5 * static_cast<double>(rows));
  for (double& r : R_) r *= factor;
}

void Triangle::flush() {
  if (pending_ == 0) return;
  age(pending_);
  const double root = std::sqrt(forgetting_);
  for (std::size_t c = 0; c < columns_; ++c) {
    double* column = block_.data() + c * kRows;
    if (forgetting_ != 1) {
      double factor = 1;
      for (std::size_t r = pending_; r-- > 0; factor *= root) column[r] *= factor;
    }
    for (std::size_t r = pending_; r < kRows; ++r) column[r] = 0;
  }
  weight_ = weight();
  pending_ = 0;
  kernels().absorb(columns_, R_.data(), block_.data());
}

void Triangle::merge(const Triangle& other) {
  if (other.columns_ != columns_)
    throw Error("triangle", "of " + std::to_string(columns_) + " columns cannot take one of " + std::to_string(other.columns_));
  flush();
  Triangle older = other;
  older.flush();
  const double aged = forgetting_ == 1 ? 1 : std::pow(forgetting_, 0.5 * static_cast<double>(rows_));
  for (std::size_t first = 0; first < columns_; first += kRows) {
    for (std::size_t c = 0; c < columns_; ++c)
      for (std::size_t r = 0; r < kRows; ++r) block_[c * kRows + r] = first + r < columns_ ? aged * older(first + r, c) : 0.0;
    kernels().absorb(columns_, R_.data(), block_.data());
  }
  rows_ += older.rows_;
  weight_ += aged * aged * older.weight_;
}

void Triangle::store(double* to) const {
  *to++ = static_cast<double>(rows_ - pending_);
  *to++ = weight_;
  for (std::size_t r = 0; r < columns_; ++r) to = std::copy_n(R_.data() + r * columns_ + r, columns_ - r, to);
}

void Triangle::check(const double* from, const char* place) const {
  constexpr double kMostRows = 9007199254740992;  // 2^53, beyond which doubles do not count
  for (std::size_t i = 0; i < stored_doubles(); ++i) {
    if (!std::isfinite(from[i])) throw Error(place, "number " + std::to_string(i + 1) + " of a triangle is not finite");
  }
  if (!(from[0] >= 0 && from[0] <= kMostRows && from[0] == std::floor(from[0])))
    throw Error(place, "a triangle of " + std::to_string(from[0]) + " rows, expected a whole number from 0 to 2^53");
  if (from[1] < 0) throw Error(place, "a triangle of weight " + std::to_string(from[1]) + ", expected 0 or above");
}

void Triangle::load(const double* from) {
  check(from);
  rows_ = static_cast<std::size_t>(*from++);
  weight_ = *from++;
  pending_ = 0;
  for (std::size_t r = 0; r < columns_; ++r, from += columns_ - r + 1)
    std::copy_n(from, columns_ - r, R_.data() + r * columns_ + r);
}

}  // namespace cotwin::numerics
