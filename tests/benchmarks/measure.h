#pragma once
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

/// Common code of the benchmarks: figures of Cotwin and a peer, measured in turn in the same run, printed as one JSON object
/// per line.
namespace cotwin::benchmark {

/// Whether this is a quick run (`./bench.sh --quick`): each row is printed after as little work as possible. Only that it is printed counts.
inline bool quick() {
  static const bool set = std::getenv("COTWIN_BENCH_QUICK") != nullptr;
  return set;
}
/// A number of repetitions, a size or a duration: `few` in a quick run.
template <class Number>
Number shortened(Number full, Number few) {
  return quick() ? few : full;
}

/// Keeps the compiler from removing a value that is not used.
template <class T>
inline void keep(const T& value) {
  asm volatile("" : : "g"(&value) : "memory");
}

inline double seconds_of(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}
inline double wall_seconds() { return seconds_of(CLOCK_MONOTONIC); }
/// Processor time of the calling thread: the load of the machine counts only through its caches.
inline double thread_seconds() { return seconds_of(CLOCK_THREAD_CPUTIME_ID); }

struct Figures {
  double ours = 0;  // median seconds per call
  double peer = 0;
};

/// Median seconds per call of two functions by `clock`, in alternating batches of at least `batch_seconds`, so that changes of the
/// machine's speed affect both alike.
inline Figures measure(const std::function<void()>& ours, const std::function<void()>& peer, int batches = 31,
                       double batch_seconds = 2e-3, double (*clock)() = wall_seconds) {
  if (quick()) {  // one call each
    batches = 1;
    batch_seconds = 0;
  }
  const auto seconds = [clock](const std::function<void()>& f, int calls) {
    const double begin = clock();
    for (int i = 0; i < calls; ++i) f();
    return clock() - begin;
  };
  const auto calls_for = [&](const std::function<void()>& f) {
    int calls = 1;
    while (seconds(f, calls) < batch_seconds) calls *= 2;
    return calls;
  };
  const auto median = [](std::vector<double> v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  const int n_ours = calls_for(ours), n_peer = calls_for(peer);
  std::vector<double> a, b;
  for (int i = 0; i < batches; ++i) {
    a.push_back(seconds(ours, n_ours) / n_ours);
    b.push_back(seconds(peer, n_peer) / n_peer);
  }
  return {median(a), median(b)};
}

/// One line of the report. `ours` and `peer_value` are in `unit`.
struct Row {
  std::string name;  // "mass matrix, 7 joints"
  std::string unit;  // "ns"
  double ours = 0;
  std::string peer;  // the peer: "KDL inverse dynamics"
  double peer_value = 0;
  double goal = 0;            // upper bound; 0: no goal, for information
  bool goal_is_ratio = true;  // whether the goal is for ours / peer_value or for ours
};

inline void print(const Row& row) {
  const double ratio = row.peer_value != 0 ? row.ours / row.peer_value : 0;
  const bool met = row.goal == 0 || (row.goal_is_ratio ? ratio : row.ours) <= row.goal;
  char goal[64] = "none";
  if (row.goal != 0) std::snprintf(goal, sizeof goal, "%s <= %g", row.goal_is_ratio ? "ratio" : "ours", row.goal);
  std::printf(
      "{\"name\": \"%s\", \"unit\": \"%s\", \"ours\": %.6g, \"peer\": \"%s\", \"peer_value\": %.6g, \"ratio\": %.4g, "
      "\"goal\": \"%s\", \"met\": %s}\n",
      row.name.c_str(), row.unit.c_str(), row.ours, row.peer.c_str(), row.peer_value, ratio, goal, met ? "true" : "false");
  std::fflush(stdout);
}

}  // namespace cotwin::benchmark
