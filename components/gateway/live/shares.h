#pragma once
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace cotwin::gateway::live {

/// Places that several owners share. An owner may have at most half of those that the others leave: of `total` places the first one at most
/// total/2, the second one total/4 …, so that something is left for everyone. For all threads.
class Shares {
 public:
  explicit Shares(std::size_t total) : state_(std::make_shared<State>(total)) {}

  /// Places that an owner has as long as this lives, also after the end of the Shares.
  class Share;
  /// nullptr: the owner would have more than `permitted` then.
  std::shared_ptr<Share> take(const std::string& owner, std::size_t places, std::size_t& permitted) const;

 private:
  struct State {
    explicit State(std::size_t t) : total(t) {}
    const std::size_t total;
    std::mutex mutex;
    std::map<std::string, std::size_t> taken;  // by owner; only those with any
    std::size_t sum = 0;
  };
  std::shared_ptr<State> state_;
};

class Shares::Share {
 public:
  Share(std::shared_ptr<State> state, std::string owner, std::size_t places)
      : state_(std::move(state)), owner_(std::move(owner)), places_(places) {}
  ~Share();
  Share(const Share&) = delete;
  Share& operator=(const Share&) = delete;

 private:
  const std::shared_ptr<State> state_;
  const std::string owner_;
  const std::size_t places_;
};

}  // namespace cotwin::gateway::live
