#pragma once
#include <malloc.h>

#include <algorithm>
#include <ctime>

namespace cotwin::testing {

/// The processor time of `work(4 n)` as a multiple of that of `work(n)`: about 4 where the time is in proportion to n, 16 where it grows with its
/// square. The least of three trials of each, so that other load does not count.
template <class Work>
double growth(int n, Work work) {
  // Memory stays with the process: what the kernel takes for new pages is no work of the algorithm.
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  const auto least = [&work](int size) {
    double seconds = 1e9;
    for (int trial = 0; trial < 3; ++trial) {
      const std::clock_t begin = std::clock();
      work(size);
      seconds = std::min(seconds, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
    }
    return seconds;
  };
  return least(4 * n) / std::max(least(n), 1e-6);
}

}  // namespace cotwin::testing
