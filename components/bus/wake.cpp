#include "components/bus/wake.h"

#include <fcntl.h>
#include <poll.h>
#include <time.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/eventfd.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include "models/foundation/support/error.h"

namespace cotwin::bus {

std::int64_t monotonic_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

bool wait_readable(int descriptor, std::int64_t deadline) {
  pollfd p{descriptor, POLLIN, 0};
  const std::int64_t left = deadline == kNever ? 0 : std::max<std::int64_t>(deadline - monotonic_ns(), 0);
#ifdef __linux__
  const timespec span{left / 1'000'000'000, left % 1'000'000'000};
  return ppoll(&p, 1, deadline == kNever ? nullptr : &span, nullptr) != 0;
#else
  const std::int64_t ms = std::min<std::int64_t>((left + 999'999) / 1'000'000, std::numeric_limits<int>::max());
  return poll(&p, 1, deadline == kNever ? -1 : static_cast<int>(ms)) != 0;
#endif
}

Wake::Wake(Kind kind) {
#ifdef __linux__
  if (kind == Kind::kBest) read_end_ = write_end_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
#endif
  if (read_end_ >= 0) return;
  int ends[2];
  if (pipe(ends) != 0) throw Error("bus", std::string("no pipe to wake a thread: ") + std::strerror(errno));
  read_end_ = ends[0];
  write_end_ = ends[1];
  for (const int end : ends) {
    fcntl(end, F_SETFL, O_NONBLOCK);
    fcntl(end, F_SETFD, FD_CLOEXEC);
  }
}

Wake::~Wake() {
  close(read_end_);
  if (write_end_ != read_end_) close(write_end_);
}

// A full pipe or eventfd is readable already: the error is none.
void Wake::write_descriptor() noexcept {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = write(write_end_, &one, sizeof one);
}

// A notifier that has taken the flag and not yet written makes the next wait return early once.
void Wake::drain() noexcept {
  std::uint64_t count;
  [[maybe_unused]] const auto got = read(read_end_, &count, sizeof count);
}

}  // namespace cotwin::bus
