#include "components/io/emulators/ur/follower.h"

#include <algorithm>
#include <cmath>

namespace cotwin::rtde {

namespace {

const std::string kCounter = "input_int_register_24", kRequest = "input_int_register_25";
const std::string kCommand = "input_double_register_24";  // and the five after it

double value(const Controller& c, std::string_view name, std::size_t i = 0) { return c.values()[c.directory().slot(name) + i]; }

}  // namespace

void Follower::start(const Joints& q, const Controller& controller) {
  q_ = goal_ = q;
  dq_ = {};
  state_ = FollowState::kOff;
  counter_ = value(controller, kCounter);
  since_ = 0;
  losses_ = 0;
}

void Follower::choose_state(const Controller& c, double h, bool running) {
  const double counter = value(c, kCounter);
  const bool fresh = counter != counter_, request = value(c, kRequest) == 1;
  counter_ = counter;
  since_ = fresh ? 0 : since_ + h;
  if (!running) {
    state_ = FollowState::kOff;
  } else if (!request) {
    state_ = FollowState::kWaiting;
  } else if (state_ == FollowState::kOff) {
    state_ = FollowState::kHeld;
  } else if (state_ == FollowState::kFollowing && since_ > settings_.loss_time) {
    state_ = FollowState::kLost;
    ++losses_;
  } else if (state_ == FollowState::kWaiting && fresh) {
    bool near = true;
    for (std::size_t i = 0; i < kJoints; ++i) {
      near = near && dq_[i] == 0 && std::abs(value(c, kCommand, i) - q_[i]) <= settings_.near;
    }
    state_ = near ? FollowState::kFollowing : FollowState::kFar;
  }
}

void Follower::approach(std::size_t i, double goal, double speed, double h) {
  const double e = std::clamp(goal, settings_.lower[i], settings_.upper[i]) - q_[i], a = settings_.acceleration;
  const double wanted = std::min({std::abs(e) / std::max(settings_.lookahead, h), std::sqrt(2 * a * std::abs(e)), speed});
  dq_[i] = std::clamp(std::copysign(wanted, e), dq_[i] - a * h, dq_[i] + a * h);
}

void Follower::cycle(Controller& controller, double h, bool running, const Joints* own) {
  choose_state(controller, h, running);
  const double fraction = std::clamp(controller.at("target_speed_fraction"), 0.0, 1.0);
  for (std::size_t i = 0; i < kJoints; ++i) {
    const double speed = settings_.speed[i] * fraction;
    const bool moves_itself = own != nullptr && state_ == FollowState::kOff;
    if (!moves_itself) goal_[i] = q_[i];
    if (moves_itself && std::isfinite((*own)[i])) goal_[i] = (*own)[i];
    if (state_ == FollowState::kFollowing) {
      approach(i, value(controller, kCommand, i), speed, h);
    } else if (moves_itself) {
      approach(i, goal_[i], speed, h);
    } else {
      const double slower = settings_.stop_time > 0 ? settings_.speed[i] / settings_.stop_time * h : settings_.speed[i];
      dq_[i] = std::copysign(std::max(std::abs(dq_[i]) - slower, 0.0), dq_[i]);
    }
    q_[i] = std::clamp(q_[i] + dq_[i] * h, settings_.lower[i], settings_.upper[i]);
  }
  controller.at("output_int_register_24") = counter_;
  controller.at("output_int_register_25") = static_cast<double>(state_);
}

}  // namespace cotwin::rtde
