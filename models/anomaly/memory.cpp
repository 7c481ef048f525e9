#include <cmath>
#include <type_traits>

#include "models/anomaly/anomaly.h"
#include "models/anomaly/constants.h"

namespace cotwin::anomaly {

template <class Self, class Visit>
void Watch::visit(Self& self, Visit&& visit) {
  for (auto* v : {&self.blocks_, &self.open_, &self.fastest_, &self.steepest_, &self.beta_, &self.sigma_, &self.peak_,
                  &self.mean_spread_, &self.resting_, &self.saturated_, &self.compared_})
    for (auto& x : *v) visit(x);
  for (auto& c : self.charts_) {
    visit(c.ready), visit(c.theta), visit(c.information), visit(c.scale), visit(c.rho), visit(c.limit), visit(c.dead),
        visit(c.doubt);
    visit(c.before), visit(c.follows), visit(c.sum.up), visit(c.sum.down), visit(c.sum.up_age), visit(c.sum.down_age);
  }
  for (auto& event : self.events_) visit_event(event, visit);
  visit_event(self.pending_, visit);
  visit_event(self.last_, visit);
  visit(self.ready_), visit(self.baselines_), visit(self.closed_), visit(self.elapsed_), visit(self.useful_),
      visit(self.moving_), visit(self.outside_);
  visit(self.found_), visit(self.hold_), visit(self.from_), visit(self.told_);
  visit(self.preparing_), visit(self.pooled_);
}

void Watch::write(ByteWriter& out) const {
  out.value(static_cast<std::uint64_t>(events_.size()));
  visit(*this, [&](const auto& x) {
    if constexpr (std::is_enum_v<std::remove_cvref_t<decltype(x)>>) {
      out.value(static_cast<std::int32_t>(x));
    } else {
      out.value(x);
    }
  });
}

void Watch::read(ByteReader& in) {
  const auto expect = [&](bool good) {
    if (!good) in.fail("is not the memory of a watch of this robot");
  };
  const auto size = in.value<std::uint64_t>();
  expect(size <= kMostEvents);
  events_.assign(size, Event{});
  visit(*this, [&]<class T>(T& x) {
    if constexpr (std::is_enum_v<T>) {
      const auto value = in.value<std::int32_t>();
      expect(value >= 0 && value <= static_cast<std::int32_t>(Cause::kEncoder));
      x = static_cast<T>(value);
    } else if constexpr (std::is_same_v<T, bool>) {
      x = in.value<std::uint8_t>() != 0;
    } else {
      x = in.value<T>();
      if constexpr (std::is_same_v<T, double>) expect(std::isfinite(x));
    }
  });
  constexpr double kMostBlocks = 1e12;
  expect(closed_ >= 0 && closed_ <= kMostBlocks && from_ >= 0 && from_ <= closed_ && hold_ >= 0 && hold_ <= kHold);
  expect(preparing_ >= 0 && preparing_ <= static_cast<double>(2 * (n_ + causes_)) &&
         (preparing_ == 0 || (closed_ >= kLeastBlocks && closed_ <= static_cast<double>(capacity_))));
  expect(found_ >= static_cast<double>(size) && (told_ == 0 || found_ >= 1) &&
         (size == kMostEvents || found_ == static_cast<double>(size)));
  const auto check = [&](const Event& e) {
    expect(e.joint >= 0 && e.joint < static_cast<int>(n_) && e.which >= -1 && e.which < static_cast<int>(causes_));
  };
  std::ranges::for_each(events_, check);
  check(pending_);
  check(last_);
}

}  // namespace cotwin::anomaly
