#include "master/clock/host_time.h"

#include <time.h>

namespace cotwin::master {

std::int64_t HostTime::now() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

void HostTime::sleep_until(std::int64_t deadline) {
  if (now() >= deadline) return;
  const timespec t{deadline / 1'000'000'000, deadline % 1'000'000'000};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

HostTime& HostTime::system() {
  static HostTime host;
  return host;
}

}  // namespace cotwin::master
