#include "models/bag/joint_state.h"

#include <algorithm>
#include <set>

namespace cotwin::bag {

namespace {

constexpr std::size_t kMostJoints = 10'000, kMostLayouts = 1000;

}  // namespace

std::size_t JointStates::sets() const {
  std::set<std::set<std::size_t>> all;
  for (const auto& [names, layout] : layouts_) all.emplace(layout.joints.begin(), layout.joints.end());
  return all.size();
}

const JointStates::Layout& JointStates::read(Cdr& message, std::array<std::vector<double>, kQuantities>& values) {
  message.number<std::int32_t>();
  message.number<std::uint32_t>();
  message.text();  // frame_id
  // The names are nearly always those of the message before.
  message.align(sizeof(std::uint32_t));
  const std::size_t begin = message.at();
  if (last_ == nullptr || !message.skip(last_->first)) {
    std::set<std::string> seen;
    std::vector<std::size_t> of_message;
    for (std::size_t left = message.count(); left > 0; --left) {
      const std::string name(message.text());
      if (name.empty()) throw Fault("has a joint without a name");
      if (!seen.insert(name).second) throw Fault("has joint '" + name.substr(0, 80) + "' twice");
      const auto known = std::ranges::find(joints_, name);
      of_message.push_back(static_cast<std::size_t>(known - joints_.begin()));
      if (known == joints_.end()) joints_.push_back(name);
    }
    if (joints_.size() > kMostJoints || layouts_.size() > kMostLayouts)
      throw Fault("has other joints than " + std::to_string(kMostLayouts) + " sets of them before");
    const std::span<const std::byte> bytes = message.from(begin);
    last_ = &*layouts_.try_emplace({reinterpret_cast<const char*>(bytes.data()), bytes.size()}).first;
    last_->second.joints = std::move(of_message);
  }
  ++last_->second.messages;
  const std::size_t n = last_->second.joints.size();
  for (std::size_t k = 0; k < kQuantities; ++k) {
    const std::size_t count = message.count();
    if (count != 0 && count != n)
      throw Fault("has " + std::to_string(count) + " values of " + kNames[k] + " for " + std::to_string(n) + " joints");
    values[k].resize(count);
    for (double& value : values[k]) value = message.number<double>();
  }
  return last_->second;
}

}  // namespace cotwin::bag
