#pragma once
#include <array>
#include <cstdint>
#include <span>

#include "components/io/emulators/ur/controller.h"

namespace cotwin::rtde {

/// RTDE has no motion commands: a program on the robot reads them from registers. Those of follow.script, and of its emulation here:
///   input double 24 to 29   commanded joint positions, rad
///   input int 24            counter, another number with each command
///   input int 25            1: the robot shall follow; 0: it shall rest
///   output int 24           the counter that the program has read last
///   output int 25           FollowState
/// Only a request that begins while the program waits is followed: after kLost, kFar and kHeld it has to end first. So a robot that stopped
/// or started again does not move before its client has decided so.
inline constexpr int kFirstRegister = 24;
using Joints = std::array<double, kJoints>;

enum class FollowState : std::int32_t {
  kOff,        // the program does not run
  kWaiting,    // for a request and a new command
  kFollowing,  // commands
  kLost,       // no new command for loss_time: at rest
  kFar,        // the first command was further than `near` from the robot: at rest
  kHeld        // the request was there before the program: at rest
};

struct FollowerSettings {
  Joints lower{}, upper{}, speed{};  // rad, rad/s: limits of the motion
  double acceleration = 40;          // rad/s², while following
  double lookahead = 0.03;           // s, time constant of the smoothing, as servoj's lookahead_time
  double loss_time = 0.1;            // s without a new command after which the robot stops
  double stop_time = 0.2;            // s from the full speed to rest
  double near = 0.1;                 // rad
};

/// What follow.script makes of the registers, and servoj and stopj of that. servoj's smoothing is not public; here
///   v = sign(e) min(|e|/lookahead, √(2 a |e|), speed)   e: distance to the commanded position
/// where v changes by at most `acceleration`. Limits of position and speed always hold.
class Follower {
 public:
  explicit Follower(const FollowerSettings& settings) : settings_(settings) {}

  /// At rest at q.
  void start(const Joints& q, const Controller& controller);
  /// A control cycle of h seconds. `running`: the program runs and the robot is ready. Where it does not follow, the robot rests, or
  /// moves to `own` if that is given; of its values that are not finite the last finite ones hold. Writes the output registers.
  void cycle(Controller& controller, double h, bool running, const Joints* own);

  FollowState state() const { return state_; }
  const Joints& q() const { return q_; }    // rad, set point
  const Joints& dq() const { return dq_; }  // rad/s
  std::uint64_t losses() const { return losses_; }

 private:
  void choose_state(const Controller& controller, double h, bool running);
  void approach(std::size_t i, double goal, double speed, double h);

  FollowerSettings settings_;
  FollowState state_ = FollowState::kOff;
  Joints q_{}, dq_{}, goal_{};
  double counter_ = 0, since_ = 0;
  std::uint64_t losses_ = 0;
};

}  // namespace cotwin::rtde
