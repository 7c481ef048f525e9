#include "components/monitor/track.h"

#include <algorithm>

#include "models/foundation/support/text.h"

namespace cotwin::monitor {
namespace {

using Eigen::Vector3d;

constexpr double kLongAgo = 1e12;                            // s
constexpr double kRounding = 1e-9;                           // s
constexpr double kWindow = 0.2, kApart = 0.02, kRarest = 1;  // s
constexpr double kNoise = 0.1, kFarthest = 1e6;              // m
constexpr double kInexact = 0.1, kLeast = 0.01;              // 1, m: of v, that count for nothing
constexpr double kTold = 0.1;                                // s: of more than kMuch
constexpr double kMuch = 0.1;                                // m/s

}  // namespace

void Track::declare(Variables& v, const std::string& x) {
  v.state(
      x + "track", state_, "1",
      "last place, m; whether there is one; when it changed and jumped last, s; first jump: s, m, s; largest speed since the "
      "change, m/s; way that v told, m; speed that it did not tell, m/s, since when, s, and where that was most: s, m/s by "
      "p, m/s by v; places before: their number, which is the newest, s, m, way that v told, m");
}

void Track::reset() {
  state_ = {};
  state_[kJumped] = -kLongAgo;
  state_[kSince] = kLongAgo;
}

double* Track::entry(std::size_t back) {
  const auto newest = static_cast<std::size_t>(state_[kNewest]);
  return &state_[kRing + kEntry * ((newest + kEntries - back) % kEntries)];
}

/// The time before an entry, s.
double Track::gap(std::size_t back) {
  return static_cast<double>(back) + 1 < state_[kCount] ? entry(back)[0] - entry(back + 1)[0] : 0;
}

/// Whether the place p, finite, is a jump.
bool Track::jumps(const Vector3d& p, double t, double window, double v_max) {
  const double way = (p - place()).norm(), since = t - state_[kChanged];
  const bool far = p.lpNorm<Eigen::Infinity>() > kFarthest;
  const bool jump = far || (state_[kSamples] != 0 && !(way <= kNoise + v_max * std::min(since, window)));
  if (jump && state_[kFirst + 1] == 0) {
    state_[kFirst] = t;
    state_[kFirst + 1] = far ? kLongAgo : way;
    state_[kFirst + 2] = since;
  }
  return jump;
}

/// Takes a place that has changed, of a body that is not lost.
void Track::compare(const Vector3d& p, double t, double window) {
  const auto count = static_cast<std::size_t>(state_[kCount]);
  const double* from = nullptr;
  std::size_t back = 0;
  for (; back < count; ++back) {
    from = entry(back);
    if (t - from[0] >= window - kRounding) break;
  }
  state_[kUntold] = 0;
  if (from != nullptr) {
    const double age = t - from[0], T = age < 2 * std::max(window, gap(back)) ? std::max(age, window) : window;
    const double way = (p - Eigen::Map<const Vector3d>(from + 1)).norm(), told = state_[kWay] - from[4];
    state_[kUntold] = std::max(0.0, way - (1 + kInexact) * told - kLeast) / T;
    state_[kSince] = state_[kUntold] > kMuch ? std::min(state_[kSince], t) : kLongAgo;
    double* worst = &state_[kWorst];
    if (t - state_[kSince] > kTold && way / T - told / T > 1.001 * (worst[1] - worst[2]))
      std::ranges::copy(std::array{t, way / T, told / T}, worst);
  }
  if (count == 0 || t - entry(0)[0] >= kApart - kRounding) {
    state_[kNewest] = static_cast<double>((static_cast<std::size_t>(state_[kNewest]) + 1) % kEntries);
    state_[kCount] = static_cast<double>(std::min<std::size_t>(count + 1, kEntries));
    std::ranges::copy(std::array{t, p.x(), p.y(), p.z(), state_[kWay]}, entry(0));
  }
}

bool Track::take(bool finite, const Vector3d& p, const Vector3d& v, double t, double h, double v_max, double restart_delay) {
  const double window = std::max(kWindow, h), since = t - state_[kChanged];
  const auto waits = [&] { return state_[kJumped] == t || !(t - state_[kJumped] >= restart_delay - kRounding); };
  const bool known = p.allFinite(), changed = known && state_[kSamples] != 0 && p != place();
  if (known ? jumps(p, t, window, v_max) : waits()) state_[kJumped] = t;
  if (known && (changed || state_[kSamples] == 0)) {
    place() = p;
    state_[kSamples] = h > 0 ? 1 : 0;  // an input at the beginning may not be connected yet
    state_[kChanged] = t;
  }
  if (!finite || waits()) {
    state_[kCount] = state_[kUntold] = 0;
    state_[kSince] = kLongAgo;
    return true;
  }
  const double speed = std::min(v.norm(), kFarthest);
  state_[kFastest] = std::max(state_[kFastest], speed);
  if (changed) {
    state_[kWay] += state_[kFastest] * since;
    state_[kFastest] = speed;
    compare(p, t, window);
  } else if (since > 2 * std::clamp(gap(0), window, kRarest)) {
    state_[kUntold] = 0;
  }
  return false;
}

std::string Track::reason(double t) const {
  if (state_[kFirst + 1] == 0 || state_[kFirst] != t) return "its pose or speed was no number";
  if (state_[kFirst + 1] == kLongAgo) return "its place was beyond " + text::to_text(kFarthest) + " m";
  return "it jumped by " + text::to_text(state_[kFirst + 1], 3) + " m in " + text::to_text(state_[kFirst + 2], 3) + " s";
}

void Track::append_note(const std::string& body, std::vector<std::string>& notes) const {
  const double* worst = &state_[kWorst];
  if (worst[1] > 0)
    notes.push_back(body + " moved at " + text::to_text(worst[1], 3) + " m/s by its p, at " + text::to_text(worst[2], 3) +
                    " m/s by its v, at " + text::to_text(worst[0], 6) + " s: what v did not tell counted, too");
}

}  // namespace cotwin::monitor
