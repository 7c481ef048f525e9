#pragma once
#include <algorithm>
#include <chrono>
#include <cstdint>

#include "models/optimisation/search.h"

namespace cotwin::optimisation {

/// What is left of the limits of `options` for a further search.
class Budget {
 public:
  explicit Budget(const SearchOptions& options) : options_(options), start_(std::chrono::steady_clock::now()) {}
  void spend(std::uint64_t evaluations) { spent_ += evaluations; }
  SearchOptions left() const {
    SearchOptions own = options_;
    own.evaluations -= std::min(spent_, own.evaluations);
    own.limit -= std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    return own;
  }

 private:
  SearchOptions options_;
  std::chrono::steady_clock::time_point start_;
  std::uint64_t spent_ = 0;
};

}  // namespace cotwin::optimisation
