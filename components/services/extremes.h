#pragma once
#include <cmath>
#include <cstddef>
#include <vector>

namespace cotwin::services {

/// The sample for which value(sample) is largest: of `grid`, samples with a time `t`, and then between the neighbours of the largest one
/// by golden sections of at(t).
template <class Sample, class At, class Value>
Sample largest(const std::vector<Sample>& grid, At at, Value value) {
  std::size_t k = 0;
  for (std::size_t i = 1; i < grid.size(); ++i)
    if (value(grid[i]) > value(grid[k])) k = i;
  Sample best = grid[k];
  if (k == 0 || k + 1 == grid.size() || !std::isfinite(value(best))) return best;
  constexpr double kGolden = 0.6180339887498949;
  double a = grid[k - 1].t, b = grid[k + 1].t;
  Sample x = at(b - kGolden * (b - a)), y = at(a + kGolden * (b - a));
  for (int i = 0; i < 40; ++i) {
    if (value(x) > value(y)) {
      b = y.t, y = x;
      x = at(b - kGolden * (b - a));
    } else {
      a = x.t, x = y;
      y = at(a + kGolden * (b - a));
    }
    for (const Sample& s : {x, y})
      if (value(s) > value(best)) best = s;
  }
  return best;
}

}  // namespace cotwin::services
