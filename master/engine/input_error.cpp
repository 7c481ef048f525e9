#include "master/engine/input_error.h"

#include <algorithm>
#include <cmath>

#include "master/engine/engine.h"
#include "models/foundation/support/fields.h"

namespace cotwin::master {

InputError::InputError(const std::vector<ResolvedConnection>& links, std::span<const Member> members, double tolerance)
    : tolerance_(tolerance) {
  const auto steps_freely = [&](std::size_t m) {
    return members[m].spec.period == 1 && members[m].instance.unit->restorable();
  };
  std::size_t size = 0;
  for (const ResolvedConnection& link : links) {
    if (!is_continuous(link) || !steps_freely(link.from.member) || !steps_freely(link.to.member)) continue;
    const double nominal = link.from.variable->nominal;
    sources_.push_back({&link, link.from.reals(), size, false, nominal > 0 ? nominal : kSmall});
    size += link.from.count;
  }
  last_.resize(size);
  slope_.resize(size);
  expected_.resize(size);
  first_.resize(size);
}

void InputError::start(const Engine& engine) {
  std::ranges::fill(slope_, 0);
  for (Source& s : sources_) {
    s.linear = engine.solves(*s.link) || !s.link->to.variable->rate.empty();
    for (const double value : s.values) s.scale = std::max(s.scale, std::abs(value));
    std::ranges::copy(s.values, last_.begin() + static_cast<std::ptrdiff_t>(s.first));
  }
}

void InputError::begin(Duration h) {
  for (const Source& s : sources_) {
    for (std::size_t i = 0; i < s.values.size(); ++i) {
      const double slope = !s.linear ? 0 : !s.link->derivative.empty() ? s.link->derivative[i] : slope_[s.first + i];
      expected_[s.first + i] = s.values[i] + slope * h.seconds();
    }
  }
}

double InputError::end() {
  double worst = 0;
  for (Source& s : sources_) {
    if (s.jumps == kMostJumps) continue;
    double scale = s.scale, difference = 0;
    for (std::size_t i = 0; i < s.values.size(); ++i) {
      scale = std::max(scale, std::abs(s.values[i]));
      difference = std::max(difference, std::abs(s.values[i] - expected_[s.first + i]));
    }
    s.error = difference / (tolerance_ * scale);
    worst = std::max(worst, s.error);
  }
  return worst;
}

/// Whether the values changed in one direction: much more in all jumps together than in the last one.
bool InputError::has_drifted(const Source& s) const {
  constexpr double kDrift = 8;
  double change = 0, last = 0;
  for (std::size_t i = 0; i < s.values.size(); ++i) {
    change = std::max(change, std::abs(s.values[i] - first_[s.first + i]));
    last = std::max(last, std::abs(s.values[i] - expected_[s.first + i]));
  }
  return change > kDrift * last;
}

void InputError::accept(Duration h, bool shortest) {
  for (Source& s : sources_) {
    if (s.jumps < kMostJumps) {
      const auto at = static_cast<std::ptrdiff_t>(s.first);
      if (s.jumps == 0) std::copy_n(last_.begin() + at, s.values.size(), first_.begin() + at);
      s.jumps = shortest && s.error > 1 ? s.jumps + 1 : 0;
      if (s.jumps == kMostJumps && has_drifted(s)) s.jumps = 0;
    }
    for (std::size_t i = 0; i < s.values.size(); ++i) {
      s.scale = std::max(s.scale, std::abs(s.values[i]));
      slope_[s.first + i] = (s.values[i] - last_[s.first + i]) / h.seconds();
      last_[s.first + i] = s.values[i];
    }
  }
}

std::vector<std::string> InputError::noisy() const {
  std::vector<std::string> names;
  for (const Source& s : sources_) {
    const bool known = std::ranges::find(names, s.link->from.name) != names.end();
    if (s.jumps == kMostJumps && !known) names.push_back(s.link->from.name);
  }
  return names;
}

void InputError::read(ByteReader& in) {
  const std::size_t inputs = last_.size(), sources = sources_.size();
  Getter(in).get(*this);
  if (last_.size() != inputs || slope_.size() != inputs || first_.size() != inputs) in.fail("has the slopes of other inputs");
  if (sources_.size() != sources) in.fail("has the scales of other inputs");
  for (const Source& s : sources_) {
    if (s.jumps < 0 || s.jumps > kMostJumps) in.fail("is damaged");
  }
}

}  // namespace cotwin::master
