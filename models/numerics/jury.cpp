#include "models/numerics/jury.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "models/foundation/support/error.h"

namespace cotwin::numerics {

bool is_stable_polynomial(std::span<const double> c) {
  if (c.empty() || c.size() > kMaxDegree + 1 || c[0] == 0 ||
      !std::ranges::all_of(c, [](double x) { return std::isfinite(x); })) {
    throw Error("stability of a polynomial", std::to_string(c.size()) + " coefficients, expected 1 to " +
                                                 std::to_string(kMaxDegree + 1) + " finite ones of which the first is not 0");
  }
  std::array<double, kMaxDegree + 1> row{};
  std::ranges::copy(c, row.begin());
  // A row of the table from the last one: the reversed row, times the reflection coefficient, is subtracted, which removes the last
  // element. All reflection coefficients are below 1 exactly if all zeros are inside.
  for (std::size_t n = c.size() - 1; n > 0; --n) {
    const double reflection = row[n] / row[0];
    if (!(std::abs(reflection) < 1)) return false;
    std::array<double, kMaxDegree + 1> next{};
    for (std::size_t i = 0; i < n; ++i) next[i] = row[i] - reflection * row[n - i];
    row = next;
  }
  return true;
}

}  // namespace cotwin::numerics
