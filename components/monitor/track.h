#pragma once
#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "components/unit/variables.h"

namespace cotwin::monitor {

/// What the places of a body, as they come as numbers, say of it: whether they can be true, and how much faster it is than its velocity tells.
///
/// A place is a jump if it is farther from the one before than 0.1 m + v_max Δt, with the time Δt since they changed last, at most the window W of
/// 0.2 s (or a step, if that is longer), or beyond 1e6 m. After a jump the body is lost until places have come without one for restart_delay. From a
/// change of p to the one of W or more before, in time T (W after a rest),
///   untold = max(0, |Δp| − 1.1 ∫ |v| dt − 10 mm) / T
/// in which |v| is the largest one between two changes, so that p which comes rarely tells nothing more than v. It is 0 where p has not changed for
/// 2 W, or for twice the time between its changes.
class Track {
 public:
  void declare(Variables& v, const std::string& x);
  void reset();
  /// Takes place, m, and velocity, m/s, in W; `finite`: the body's numbers are; h: the step, s. Returns whether the body is lost.
  bool take(bool finite, const Eigen::Vector3d& p, const Eigen::Vector3d& v, double t, double h, double v_max,
            double restart_delay);
  /// The speed that v does not tell, m/s.
  double untold() const { return state_[kUntold]; }
  /// "it jumped by 1.2 m in 0.004 s", where `t`, s, is the time of the first jump.
  std::string reason(double t) const;
  /// Adds a note if v told 0.1 m/s less than p, or more, for more than 0.1 s.
  void append_note(const std::string& body, std::vector<std::string>& notes) const;

 private:
  enum Kept : std::size_t {
    kPlace,
    kSamples = kPlace + 3,
    kChanged,
    kJumped,
    kFirst,
    kFastest = kFirst + 3,
    kWay,
    kUntold,
    kSince,
    kWorst,
    kCount = kWorst + 3,
    kNewest,
    kRing,
    kEntry = 5,
    kEntries = 12,
    kSize = kRing + kEntry * kEntries
  };
  bool jumps(const Eigen::Vector3d& p, double t, double window, double v_max);
  void compare(const Eigen::Vector3d& p, double t, double window);
  Eigen::Map<Eigen::Vector3d> place() { return Eigen::Map<Eigen::Vector3d>(&state_[kPlace]); }
  /// t, p and the way that v told, of the place that came `back` entries before the newest.
  double* entry(std::size_t back);
  double gap(std::size_t back);

  /// The last place, m; whether there is one; when it changed last and when it jumped last, s; the first jump: s, m, s since the place before; since the
  /// last change the largest |v|, m/s; the way that v told, m; untold; since when, s; where that was most: s, m/s by p, m/s by v; how many entries there
  /// are, and which is the newest; these.
  std::array<double, kSize> state_{};
};

}  // namespace cotwin::monitor
