#include "models/numerics/triangle.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>

#include "models/foundation/support/error.h"
#include "models/numerics/kernels/kernels.h"

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

void Triangle::clear() {
  rows_ = pending_ = 0;
  weight_ = 0;
  std::fill(R_.begin(), R_.end(), 0.0);
}

void Triangle::write(ByteWriter& out) const {
  out.value(std::uint64_t{rows_});
  out.value(std::uint64_t{pending_});
  out.value(weight_);
  for (std::size_t r = 0; r < columns_; ++r) out.values(std::span(R_).subspan(r * columns_ + r, columns_ - r));
  for (std::size_t c = 0; c < columns_; ++c) out.values(std::span(block_).subspan(c * kRows, pending_));
}

void Triangle::read(ByteReader& in) {
  constexpr std::uint64_t kMostRows = 1ull << 53;  // up to which a weight counts them exactly
  const auto rows = in.value<std::uint64_t>(), pending = in.value<std::uint64_t>();
  if (rows > kMostRows) in.fail("has a triangle of " + std::to_string(rows) + " rows, expected at most 2^53");
  if (pending >= kRows || pending > rows)
    in.fail("has " + std::to_string(pending) + " rows in an incomplete block of a triangle of " + std::to_string(rows) +
            " rows, expected fewer than " + std::to_string(kRows) + " and at most all");
  const auto take = [&in](std::span<double> to) {
    in.values(to);
    if (!std::all_of(to.begin(), to.end(), [](double x) { return std::isfinite(x); }))
      in.fail("has a number that is not finite in a triangle");
  };
  rows_ = rows;
  pending_ = pending;
  take({&weight_, 1});
  if (weight_ < 0) in.fail("has a triangle of weight " + std::to_string(weight_) + ", expected 0 or above");
  for (std::size_t r = 0; r < columns_; ++r) take(std::span(R_).subspan(r * columns_ + r, columns_ - r));
  for (std::size_t c = 0; c < columns_; ++c) take(std::span(block_).subspan(c * kRows, pending_));
}

}  // namespace cotwin::numerics
