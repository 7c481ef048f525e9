#pragma once
#include <Eigen/Geometry>
#include <cstdint>

#include "components/io/fri/fri.h"

namespace cotwin::fri {

struct PoseInterpolatorSettings {
  double linear_speed = 0;          // m/s
  double angular_speed = 0;         // rad/s
  std::int64_t message_period = 0;  // ns
  std::uint32_t multiplier = 1;     // messages per command
  std::int64_t stop_time = 0;       // ns
  std::int64_t slack = 0;           // ns, added to the time between two commands when their speed is checked
};

/// The controller's set points of a frame between the commands, by the rules of Interpolator: positions along lines, rotations
/// about a fixed axis with constant speed. Lost commands: p_k = p_a + (k − a) Δp, R_k = R_a exp((k − a) φ) with Δp and φ per
/// message from the last two commands.
class PoseInterpolator {
 public:
  explicit PoseInterpolator(const PoseInterpolatorSettings& settings) : settings_(settings) {}

  /// Rests at X. Later commands are answers to messages after `index`.
  void start(const Pose& X, std::int64_t index);
  void command(const Pose& X, std::int64_t index);
  /// Whether X is a step to message `index` beyond a speed limit, apart from the rounding of single floats.
  bool is_jump(const Pose& X, std::int64_t index) const;
  void begin_period(std::int64_t now, std::int64_t lost);
  void stop(std::int64_t now);
  /// The set point.
  Pose at(std::int64_t now) const;

 private:
  struct Frame {
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    Eigen::Quaterniond R = Eigen::Quaterniond::Identity();
  };
  /// Δp in the base's axes, φ in those of the frame where it begins.
  struct Change {
    Eigen::Vector3d p = Eigen::Vector3d::Zero(), phi = Eigen::Vector3d::Zero();
  };

  static Frame frame_of(const Pose& X);
  static Frame moved(const Frame& from, const Change& change, double share);
  static Change between(const Frame& from, const Frame& to);
  double period() const { return static_cast<double>(settings_.message_period) * settings_.multiplier * 1e-9; }  // s
  Frame frame_at(std::int64_t now) const;

  PoseInterpolatorSettings settings_;
  Frame newest_, from_;     // of the commands, and of the period or the stop
  Change slope_, step_;     // per message, and of the period
  std::int64_t index_ = 0;  // message that the newest command answers
  std::int64_t begin_ = 0;  // ns
  bool stopping_ = false;
};

}  // namespace cotwin::fri
