#include "models/bag/joint_state.h"

#include <algorithm>
#include <set>

namespace cotwin::bag {

namespace {

constexpr std::size_t kMostJoints = 1000, kMostSets = 100, kMostLayouts = 16, kLongestName = 1000;

}  // namespace

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
      if (name.empty() || name.size() > kLongestName ||
          std::ranges::any_of(name, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }))
        throw Fault("has a joint whose name is empty, long or not plain text");
      if (!seen.insert(name).second) throw Fault("has joint '" + name.substr(0, 80) + "' twice");
      const auto [known, is_new] = index_.try_emplace(name, joints_.size());
      of_message.push_back(known->second);
      if (is_new) joints_.push_back(name);
      if (joints_.size() > kMostJoints)
        throw Fault("has more than " + std::to_string(kMostJoints) + " joints with those before");
    }
    std::vector<std::size_t> sorted = of_message;
    std::ranges::sort(sorted);
    if (sets_.size() < kMostSets) sets_.insert(std::move(sorted));
    if (layouts_.size() == kMostLayouts) layouts_.clear();
    const std::span<const std::byte> bytes = message.from(begin);
    last_ = &*layouts_.try_emplace({reinterpret_cast<const char*>(bytes.data()), bytes.size()}).first;
    last_->second.joints = std::move(of_message);
  }
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
