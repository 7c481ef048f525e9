#include "components/gateway/live/shares.h"

#include <utility>

namespace cotwin::gateway::live {

std::shared_ptr<Shares::Share> Shares::take(const std::string& owner, std::size_t places, std::size_t& permitted) const {
  const std::lock_guard lock(state_->mutex);
  const auto found = state_->taken.find(owner);
  const std::size_t own = found == state_->taken.end() ? 0 : found->second;
  permitted = (state_->total - (state_->sum - own)) / 2;
  if (own + places > permitted) return nullptr;
  auto share = std::make_shared<Share>(state_, owner, places);
  state_->taken[owner] = own + places;
  state_->sum += places;
  return share;
}

Shares::Share::~Share() {
  const std::lock_guard lock(state_->mutex);
  const auto own = state_->taken.find(owner_);
  if ((own->second -= places_) == 0) state_->taken.erase(own);
  state_->sum -= places_;
}

}  // namespace cotwin::gateway::live
