#include "components/contact_world/latches.h"

#include <algorithm>

#include "components/contact_world/parts.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/robot_links.h"

namespace cotwin::contact_world {

std::vector<LatchPort> LatchPort::read(const std::string& place, const std::string& setting, const scene::Cell& cell) {
  std::vector<LatchPort> latches;
  for (const std::string_view item : text::split(setting, ';')) {
    if (text::trim(item).empty()) continue;
    const std::string where = place + ": latches=" + setting;
    const std::vector<std::string_view> parts = text::split(item, '|');
    if (parts.size() != 3)
      throw Error(where, "'" + std::string(item) + "', expected name|frame|frame, separated by semicolons");
    LatchPort one;
    one.name_ = text::identifier(std::string(text::trim(parts[0])));
    if (text::trim(parts[0]).empty()) throw Error(where, "'" + std::string(item) + "': no name, expected name|frame|frame");
    for (int k = 0; k < 2; ++k) one.ends_[k] = scene::find_frame(cell, parts[static_cast<std::size_t>(k) + 1], where);
    if (one.ends_[0].robot == one.ends_[1].robot && one.ends_[0].body == one.ends_[1].body)
      throw Error(where, "'" + one.name_ + "': both frames are on the same body, expected two bodies");
    one.law_.force = one.law_.moment = 0;
    latches.push_back(std::move(one));
  }
  return latches;
}

void LatchPort::declare(Variables& v) {
  const std::string x = name_ + ".", of = " of latch " + name_;
  v.input(x + "close", close_, "true closes the latch if its frames are within reach then, false opens it");
  v.output(x + "closed", closed_, "whether latch " + name_ + " is closed");
  v.output(x + "p", p_, "m", "position of the second body's frame in W");
  v.output(x + "f", f_, "N", "force on the second body at this frame, in W, mean over the step").discrete();
  v.output(x + "m", m_, "N.m", "moment on it about the frame's origin, in W").discrete();
  v.output(x + "distance", distance_, "m", "distance of the two frames" + of);
  v.output(x + "angle", angle_, "rad", "angle between them");
  v.tunable(x + "reach", law_.reach, "m", "largest distance of the frames at which it closes").range(0, 1000);
  v.tunable(x + "tilt", law_.tilt, "rad", "largest angle between the frames at which it closes").range(0, 4);
  v.tunable(x + "time", law_.time, "s", "in which it draws the frames together once it is closed; 0: they stay as they met")
      .range(0, 1e6);
  v.tunable(x + "stiffness", law_.stiffness, "N/m", "of the closed latch; 0: rigid").range(0, 1e15);
  v.tunable(x + "turn_stiffness", law_.turn_stiffness, "N.m/rad", "of the closed latch about its frame; 0: rigid")
      .range(0, 1e15);
  v.tunable(x + "breakaway_force", law_.force, "N", "force at which it opens, and at which it slips while it closes; 0: never")
      .range(0, 1e15);
  v.tunable(x + "breakaway_moment", law_.moment, "N.m", "moment likewise").range(0, 1e15);
  v.state(x + "close_before", closed_before_, "close in the last step");
  v.state(x + "missed", missed_, "1", "how often it closed on nothing; then the first time, s, distance, m, and angle, rad");
  v.state(x + "broken", broken_, "1", "how often it broke away; then the first time, s");
}

void LatchPort::add(scene::Scene& scene, const std::function<int(const scene::PlacedFrame&)>& body) const {
  scene::Joint joint;
  joint.name = name_;
  joint.type = scene::JointType::kFixed;
  joint.parent = body(ends_[0]);
  joint.child = body(ends_[1]);
  joint.X_PJ = ends_[0].X_BF;
  joint.X_CJ = ends_[1].X_BF;
  scene.latches.push_back(std::move(joint));
}

void LatchPort::reset() {
  closed_ = closed_before_ = false;
  std::ranges::fill(missed_, 0.0);
  std::ranges::fill(broken_, 0.0);
}

void LatchPort::follow(const std::string& place, World& world, std::size_t latch, double now) {
  for (const double value : {law_.reach, law_.tilt, law_.time, law_.stiffness, law_.turn_stiffness, law_.force, law_.moment}) {
    if (!(value >= 0 && value < scene::kInfinity))
      throw Error(place + "." + name_, "has a tunable that is " + text::to_text(value) + ", expected finite values >= 0");
  }
  LatchLaw law = law_;
  if (law.force == 0) law.force = scene::kInfinity;
  if (law.moment == 0) law.moment = scene::kInfinity;
  world.set_latch(latch, law);
  if (close_ && !closed_before_ && !world.close_latch(latch)) {
    const Latch& open = world.latches()[latch];
    if (missed_[0]++ == 0) std::ranges::copy(std::array{now, open.distance(), open.angle()}, missed_.begin() + 1);
  }
  if (!close_) world.open_latch(latch);
  closed_before_ = close_;
  closed_ = world.latches()[latch].closed;
}

void LatchPort::carry(const Eigen::Vector3d& impulse, const Eigen::Vector3d& moment) {
  carried_ += (Wrench() << impulse, moment).finished();
}

void LatchPort::write(const Latch& latch, double end, double h) {
  if (closed_ && !latch.closed && h > 0 && broken_[0]++ == 0) broken_[1] = end;
  closed_ = latch.closed;
  const double rate = h > 0 ? 1 / h : 0;
  wrench_ << rate * latch.sum.linear, rate * latch.sum.angular;
  Eigen::Map<Eigen::Vector3d>(f_.data()) = (wrench_ + rate * carried_).head<3>();
  Eigen::Map<Eigen::Vector3d>(m_.data()) = (wrench_ + rate * carried_).tail<3>();
  carried_.setZero();
  Eigen::Map<Eigen::Vector3d>(p_.data()) = latch.joint.p_child;
  distance_ = latch.distance();
  angle_ = latch.angle();
}

void LatchPort::append_notes(std::vector<std::string>& notes) const {
  const auto times = [](double count) { return count > 1 ? ", " + text::to_text(count) + " times in all" : std::string(); };
  if (missed_[0] > 0) {
    notes.push_back("latch '" + name_ + "' closed on nothing at " + text::to_text(missed_[1], 6) + " s" + times(missed_[0]) +
                    ", and stayed open: its frames were " + text::to_text(missed_[2], 3) + " m and " +
                    text::to_text(missed_[3], 3) + " rad apart, expected at most " + text::to_text(law_.reach, 3) + " m and " +
                    text::to_text(law_.tilt, 3) + " rad (" + name_ + ".reach, " + name_ + ".tilt)");
  }
  if (broken_[0] > 0) {
    notes.push_back("latch '" + name_ + "' broke away at " + text::to_text(broken_[1], 6) + " s" + times(broken_[0]));
  }
}

/// The wrench of a latch on a link or base of a robot: for the drive train.
void ContactWorld::add_latch(int body, const Eigen::Vector3d& p_W, const Wrench& F) {
  const Eigen::Vector3d f = F.head<3>(), m = F.tail<3>();
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    const auto link = std::ranges::find(r.parts.bodies, static_cast<std::size_t>(body));
    const bool is_link = link != r.parts.bodies.end();
    if (!is_link && static_cast<std::size_t>(body) != r.parts.base) continue;
    Eigen::Map<Eigen::Vector3d>(r.base_f.data()) += f;
    Eigen::Map<Eigen::Vector3d>(r.base_m.data()) += (p_W - world_->poses()[r.parts.base].p).cross(f) + m;
    if (is_link)
      scene::add_joint_torques(r.placed->model, r.X_WL, static_cast<int>(link - r.parts.bodies.begin()), p_W, F, r.tau_l);
  }
}

}  // namespace cotwin::contact_world
