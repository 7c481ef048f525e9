#pragma once
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/variables.h"

namespace cotwin::monitor {

/// Figures of the protective separation distance that hold for all robots (ISO/TS 15066:2016, 5.5.4.2.3; ISO 13855).
struct SeparationFigures {
  double v_h = 1.6, v_max = 10, T_r = 0.1;           // m/s, m/s, s
  double C = 0, Z_d = 0, Z_r = 0;                    // m
  double slow = 0.25, band = 0.5, hysteresis = 0.1;  // 1, m, m
  double restart_delay = 0.5;                        // s

  void declare(Variables& v);
};

/// How one robot keeps its distance from bodies. For a body and a link whose fastest points move at v_h and v_r,
///   S_p = v_h (T_r + T_s) + v_r T_r + S_s + C + Z_d + Z_r,   S_s = v_r T_s / 2   if it is not given.
/// T_r counts two steps more: the one in which nobody has looked yet, and the one in which the robot is not yet told. Meanwhile, and as far as the
/// robot is not slowed yet, which is done evenly in T_s, v_r grows by a_r. Directions do not count, so that no point comes nearer than this.
///   stop   d < S_p          of any pair
///   slow   d < S_p + band
/// It goes on where d has been larger by the hysteresis for restart_delay, also with the speeds at which it was when all was clear (slow: with that
/// share of them). It stops while a body is lost, whose pose or speed is no number.
/// A stop is late if a point of the robot moves faster than kMoving later than T_r + T_s after it (T_r with the two steps) and before it ends.
class Separation {
 public:
  enum Zone { kClear, kSlow, kStop };
  static constexpr double kMoving = 0.01;  // m/s
  /// The pair that has the least d − S_p.
  struct Nearest {
    double margin, S_p = 0;          // m
    std::size_t link = 0, body = 0;  // parts
  };

  /// `a_r`: default, m/s², of the link that it is largest for; `shares`: of base and links, of it.
  Separation(std::vector<double> shares, double a_r)
      : a_r_(a_r), shares_(std::move(shares)), clear_speeds_(shares_.size(), 0.0) {}
  void declare(Variables& v, const std::string& x, const std::string& of);
  void reset();
  /// S_p of a link in m; `h`: step, s.
  double distance(const SeparationFigures& f, double h, std::size_t link, double v_h, double v_r) const;
  /// The speed of a link, m/s, if the robot goes on.
  double speed_ahead(const SeparationFigures& f, std::size_t link, double v_r) const;
  /// Takes the least d − S_p of all pairs, and the least one for speed_ahead(), m. `speeds`: of the links, m/s; `lost`: a body is. True: another zone.
  bool update(const SeparationFigures& f, const Nearest& nearest, double margin_ahead, const std::vector<double>& speeds,
              double t, bool lost);

  /// Judges, after update(), whether the robot stops in time: `fastest`: of its points, m/s. True: another stop is late.
  bool judge(double h, double t, double fastest);
  /// The least distance, m, of a body while the robot moved, so far; kNone: it did not.
  double least_while_moving() const { return state_[kLeast]; }
  void met(double d, std::size_t body);
  std::int32_t late() const { return static_cast<std::int32_t>(state_[kLates]); }

  Zone zone() const { return static_cast<Zone>(static_cast<int>(state_[0])); }
  double speed(const SeparationFigures& f) const { return zone() == kStop ? 0 : zone() == kSlow ? f.slow : 1; }
  /// `names`: of the parts.
  void append_note(const std::string& robot, const std::vector<std::string>& names, std::vector<std::string>& notes) const;

 private:
  enum Kept : std::size_t {
    kZone,
    kFreeSince,
    kSlows,
    kStops = kSlows + 6,
    kStopped = kStops + 6,
    kLimit,
    kIsJudged,
    kJudged,
    kIsLate,
    kLates,
    kWorst,
    kLeast = kWorst + 3,
    kNearest,
    kSize
  };
  double T_s_ = 0.5, S_s_ = -1, a_r_;
  std::vector<double> shares_, clear_speeds_;
  /// Zone; since when it could go on, s; how often it was asked to slow down, and the first time: s, link, body, margin, S_p; to stop likewise; when last,
  /// s; T_r + T_s then, s; whether that stop was judged; how many were; whether it is late; how many were; of the fastest of them when, s, how long after the stop, s, and how fast, m/s; least distance while it
  /// moved, m, and its body.
  std::array<double, kSize> state_{};
};

}  // namespace cotwin::monitor
