#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::io {

/// Keeps a robot and its twin together by positions alone (V-D). With the discrepancy e(k) = q_v(k) − q_r(k) between twin and
/// robot in cycle k, of h seconds:
///   q_cmd(k) = q_v(k) + K_P e(k−1) + K_D (e(k−1) − e(k−2))/h
/// For cycles without a measurement (lost packets) the correction is held, and the difference is taken over the time between the
/// two last measurements. A command differs from the one before by at most dq_max h, with h from that one on: a twin that is
/// elsewhere when commanding begins, or a correction after a loss, is approached at that speed. Values that are not finite change
/// nothing: the command or the correction before is kept.
class Synchronisation {
 public:
  /// Per joint.
  struct Gains {
    std::span<const double> K_P;     // 1
    std::span<const double> K_D;     // s
    std::span<const double> dq_max;  // rad/s; ∞: not limited
  };

  explicit Synchronisation(std::size_t joints);

  /// Begins at the command that the robot has at present.
  void start(std::span<const double> q);
  /// A measurement: e, `elapsed` seconds after the last one. Takes effect in the next command. One that is
  /// not younger than the last one changes nothing.
  void measure(std::span<const double> q_v, std::span<const double> q_r, const Gains& gains, double elapsed);
  /// The command of a cycle, h seconds after the last one.
  std::span<const double> command(std::span<const double> q_v, const Gains& gains, double h);

  std::span<const double> last() const { return q_; }         // command, rad
  std::span<const double> discrepancy() const { return e_; }  // e of the last measurement, rad
  std::span<const double> correction() const { return correction_; }

 private:
  std::vector<double> e_, correction_, q_;
  bool measured_ = false;  // since start()
};

/// Whether robot and twin stay together: all poles are inside the unit circle for a robot that follows its command with
/// q_r(k+1) = q_r(k) + a (q_cmd(k − delay) − q_r(k)), a > 0, and `delay` further cycles of transport. Characteristic polynomial
///   z^(3+delay) − (1 − a) z^(2+delay) + a (K_P + K_D/h) z − a K_D/h
bool is_synchronisation_stable(double a, double K_P, double K_D_over_h, std::size_t delay = 0);

}  // namespace cotwin::io
