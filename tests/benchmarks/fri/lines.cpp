#include "tests/benchmarks/fri/lines.h"

namespace cotwin::benchmark {

namespace {

constexpr std::int64_t kMillisecond = 1'000'000;  // ns

}  // namespace

void Line::disturb() {
  testing::Disturbance d;
  d.loss = 0.05;
  d.jitter = 2 * kMillisecond;
  d.duplicate = 0.05;
  d.reorder = 0.04;
  d.hold = 3 * kMillisecond;
  relay_.set(d);
}

void Line::cut() {
  testing::Disturbance d;
  d.loss = 1;
  relay_.set(d);
}

}  // namespace cotwin::benchmark
