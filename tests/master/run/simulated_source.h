#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <optional>
#include <random>

#include "components/unit/tick_source.h"
#include "master/clock/host_time.h"

/// Time and a robot or bus of tests, which do not depend on the speed of the machine.
namespace cotwin::testing {

inline constexpr std::int64_t kMs = 1'000'000, kUs = 1'000;

/// Time that passes only while somebody sleeps, or when the test moves it.
class SimulatedHost final : public master::HostTime {
 public:
  std::int64_t now() override { return now_; }
  void sleep_until(std::int64_t deadline) override {
    ++sleeps_;
    if (sleeps_ == interrupted_) return;  // by a signal
    now_ = std::max(now_, deadline);
  }
  void work(std::int64_t ns) { now_ += ns; }
  void interrupt_next() { interrupted_ = sleeps_ + 1; }

 private:
  std::int64_t now_ = 50'000 * kMs;
  int sleeps_ = 0, interrupted_ = -1;
};

/// A robot or bus with its own clock and packets that are late, lost, doubled …
class SimulatedSource final : public TickSource {
 public:
  struct Packet {
    std::int64_t host = 0, source = 0;
  };
  explicit SimulatedSource(SimulatedHost& host) : host_(host) {}

  std::optional<Arrival> wait(std::int64_t deadline) override {
    const auto pop_newest = [&]() -> std::optional<Arrival> {
      std::optional<Arrival> newest;
      for (; !packets_.empty() && packets_.front().host <= host_.now(); packets_.pop_front())
        newest = {packets_.front().host, packets_.front().source};
      return newest;
    };
    ++waits_;
    if (const auto arrival = pop_newest()) return arrival;
    if (!packets_.empty() && packets_.front().host <= deadline) {
      host_.sleep_until(packets_.front().host);
      return pop_newest();
    }
    if (host_.now() < deadline) host_.sleep_until(deadline);
    return std::nullopt;
  }
  std::int64_t period() const override { return period_; }
  bool answers_only() const override { return answers_only_; }

  /// Packets in the order in which they come.
  void send(std::int64_t host, std::int64_t source) {
    const auto later = [](const Packet& p, std::int64_t at) { return p.host < at; };
    packets_.insert(std::lower_bound(packets_.begin(), packets_.end(), host, later), {host, source});
  }

  std::int64_t period_ = 0;
  bool answers_only_ = false;
  int waits_ = 0;

 private:
  SimulatedHost& host_;
  std::deque<Packet> packets_;
};

/// Standard normal, by Box and Muller: std::normal_distribution differs between libraries.
inline double gaussian(std::mt19937_64& random) {
  const double u = (static_cast<double>(random() >> 11) + 1) / 9007199254740993.0,
               v = static_cast<double>(random() >> 11) / 9007199254740992.0;
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * M_PI * v);
}

}  // namespace cotwin::testing
