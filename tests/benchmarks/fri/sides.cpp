#include "tests/benchmarks/fri/sides.h"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "components/io/link/datagram_queue.h"
#include "master/clock/realtime.h"
#include "models/foundation/support/error.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace cotwin::benchmark {

namespace {

constexpr double kHome[] = {0, 0.3, 0, -1.2, 0, 0.9, 0};  // rad

void sleep_until(std::int64_t time) {
  const timespec t{static_cast<time_t>(time / 1'000'000'000), static_cast<long>(time % 1'000'000'000)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) != 0) {
  }
}

void prepare(const master::ClockSpec& clock, std::size_t index) {
  if (!clock.real_time_thread()) return;
  std::vector<std::string> refused;
  master::realtime::prepare_thread(clock, index, refused);
  for (const std::string& sentence : refused) std::fprintf(stderr, "fri_loop: %s\n", sentence.c_str());
}

}  // namespace

double desired_offset(double t) { return 0.1 * (1 - std::cos(std::numbers::pi * t)); }

Side::Side(const std::string& link, const SessionSettings& settings)
    : settings_(settings),
      instance_(make_unit("unit:io?robot=lwr4&link=" + link + "&protocol=" + settings.protocol, {},
                          {std::filesystem::path(places::source()) / "models"}, unit_types())) {
  set("address", "127.0.0.1");
  set("port", "0");
}

void Side::set(const std::string& name, const std::string& value) { assign_text(instance_.variables.at(name), value); }

net::Endpoint Side::local() { return static_cast<io::DatagramQueue*>(instance_.unit->tick_source())->local(); }

Robot::Robot(const SessionSettings& settings) : Side("fri_controller", settings) {
  set("period", std::to_string(settings.period.seconds()));
  set("restart", "0.05");
  if (!settings.rates_answers) {
    set("good", "0.5");
    set("fair", "0");
  }
}

void Robot::initialise(const net::Endpoint& client) {
  set("client", net::to_text(client));
  std::ranges::copy(kHome, reals("q").begin());
  instance_.unit->initialise(Time{});
}

void Robot::run(std::int64_t start, const std::atomic<bool>& end) {
  prepare(settings_.clock, 0);
  const std::span<double> q = reals("q"), q_command = reals("q_command");
  const std::span<const bool> follows = instance_.variables.at("active").booleans();
  const Duration h = settings_.period;
  const auto settled = static_cast<std::int64_t>(0.5 / h.seconds());  // steps
  std::int64_t following = 0;
  const std::uint64_t before = testing::allocations();
  for (std::int64_t n = 0; !end;) {
    const std::int64_t due = start + n * h.ns;
    sleep_until(due);
    latest_ = std::max(latest_.load(), io::monotonic_now() - due);
    (void)instance_.unit->step(Time{n * h.ns}, h);
    if (!std::ranges::equal(q, q_command, [](double a, double b) { return std::abs(a - b) < 1e-9; })) moved_at = due + h.ns;
    std::ranges::copy(q_command, q.begin());
    active = follows[0];
    following = follows[0] ? following + 1 : 0;
    if (watch && following > settled) {
      const double offset = desired_offset(static_cast<double>(n) * h.seconds());
      for (std::size_t i = 0; i < q.size(); ++i) error_ = std::max(error_, std::abs(q[i] - kHome[i] - offset));
    }
    // A robot skips the periods that it has missed.
    const std::int64_t next = std::max(n + 1, (io::monotonic_now() - start) / h.ns);
    skipped_ += next - n - 1;
    n = next;
  }
  allocations_ = testing::allocations() - before;
}

Twin::Twin(const SessionSettings& settings) : Side("fri", settings) {
  answer_times_.reserve(static_cast<std::size_t>(settings.seconds / settings.period.seconds()));
}

void Twin::initialise() {
  set("mode", "position");
  instance_.unit->initialise(Time{});
}

void Twin::run(std::int64_t start, const std::atomic<bool>& end) {
  prepare(settings_.clock, 1);
  constexpr std::int64_t kPatience = 50'000'000;  // ns
  TickSource& source = *instance_.unit->tick_source();
  const std::span<double> q_command = reals("q_command");
  const std::uint64_t before = testing::allocations();
  for (bool last = false; !last;) {
    last = end;
    const std::optional<Arrival> arrival = source.wait(io::monotonic_now() + (last ? 0 : kPatience));
    const Time now{std::max<std::int64_t>(io::monotonic_now() - start, 0)};
    const double offset = desired_offset(now.seconds());
    for (std::size_t i = 0; i < q_command.size(); ++i) q_command[i] = kHome[i] + offset;
    (void)instance_.unit->step(now, settings_.period);
    if (arrival && answer_times_.size() < answer_times_.capacity()) {
      answer_times_.push_back(1e-9 * static_cast<double>(io::monotonic_now() - arrival->host));
    }
  }
  allocations_ = testing::allocations() - before;
}

}  // namespace cotwin::benchmark
