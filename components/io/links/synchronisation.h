#pragma once
#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::io {

/// Keeps a robot and its twin together by positions alone (V-D). With the discrepancy e(k) = q_v(k) − q_r(k) between twin and
/// robot in cycle k, of h seconds:
///   q_cmd(k) = q_v(k) + K_P e(k−1) + K_D (e(k−1) − e(k−2))/h
/// For cycles without a measurement (lost packets) the correction is held, and the difference is taken over the time between the
/// two last measurements. A command differs from the one before by at most dq_max h, with h from that one on, and its speed by at most
/// ddq_max h. A twin that is elsewhere, or a correction after a loss, is approached within these limits, with an overshoot of at most ddq_max h²/8; a twin that
/// moves within them is followed without delay. For kSoftStart seconds after start() or rest() the speed limit rises from 0 to dq_max.
/// Values that are not finite change nothing: the command comes to rest, the correction before is kept.
class Synchronisation {
 public:
  /// Per joint.
  struct Gains {
    std::span<const double> K_P;     // 1
    std::span<const double> K_D;     // s
    std::span<const double> dq_max;  // rad/s; ∞: not limited
    double ddq_max;                  // rad/s²; ∞: not limited
  };
  static constexpr double kSoftStart = 0.5;  // s

  explicit Synchronisation(std::size_t joints);

  /// Begins at the command that the robot has at present, at rest.
  void start(std::span<const double> q);
  /// A measurement: e, `elapsed` seconds after the last one. Takes effect in the next command. One that is
  /// not younger than the last one changes nothing.
  void measure(std::span<const double> q_v, std::span<const double> q_r, const Gains& gains, double elapsed);
  /// The command of a cycle, h seconds after the last one.
  std::span<const double> command(std::span<const double> q_v, const Gains& gains, double h);

  /// The robot has gone on with the speed of the last commands for so many s without new ones: the next one goes on from there.
  void go_on(double time);
  /// Instead of command(): the command comes to rest.
  std::span<const double> rest(const Gains& gains, double h);
  /// Likewise, for a moment: command() then goes on without a soft start.
  std::span<const double> pause(const Gains& gains, double h);
  /// Of the soft start, 0 to 1.
  double share() const { return std::min(since_start_ / kSoftStart, 1.0); }

  std::span<const double> last() const { return q_; }         // command, rad
  std::span<const double> speed() const { return dq_; }       // of the command, rad/s
  std::span<const double> discrepancy() const { return e_; }  // e of the last measurement, rad
  std::span<const double> correction() const { return correction_; }

 private:
  void rest(std::size_t i, const Gains& gains, double h);

  std::vector<double> e_, correction_, q_, dq_;
  std::vector<double> target_;  // of the last command
  bool measured_ = false;       // since start()
  bool has_target_ = false;     // since start() or rest()
  double since_start_ = 0;      // s
};

}  // namespace cotwin::io
