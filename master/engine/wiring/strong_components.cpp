#include "master/engine/wiring/strong_components.h"

#include <algorithm>
#include <utility>

namespace cotwin::master {

namespace {

using Graph = std::vector<std::vector<std::size_t>>;

/// Tarjan's algorithm with an explicit stack instead of recursion, for long chains.
class StrongComponents {
 public:
  explicit StrongComponents(const Graph& edges)
      : edges_(edges), index_(edges.size(), kNone), low_(edges.size()), on_stack_(edges.size()) {
    for (std::size_t node = 0; node < edges.size(); ++node) {
      if (index_[node] == kNone) visit(node);
    }
    std::reverse(found_.begin(), found_.end());  // Tarjan finds sinks first
  }
  std::vector<std::vector<std::size_t>> take() { return std::move(found_); }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  struct Frame {
    std::size_t node, next_edge;
  };

  void open(std::size_t node) {
    index_[node] = low_[node] = count_++;
    stack_.push_back(node);
    on_stack_[node] = true;
    frames_.push_back({node, 0});
  }

  void visit(std::size_t root) {
    open(root);
    while (!frames_.empty()) {
      const std::size_t node = frames_.back().node;
      if (frames_.back().next_edge < edges_[node].size()) {
        const std::size_t other = edges_[node][frames_.back().next_edge++];
        if (index_[other] == kNone) {
          open(other);
        } else if (on_stack_[other]) {
          low_[node] = std::min(low_[node], index_[other]);
        }
        continue;
      }
      frames_.pop_back();
      if (!frames_.empty()) low_[frames_.back().node] = std::min(low_[frames_.back().node], low_[node]);
      if (low_[node] == index_[node]) close(node);
    }
  }

  void close(std::size_t node) {
    std::vector<std::size_t> component;
    do {
      component.push_back(stack_.back());
      on_stack_[stack_.back()] = false;
      stack_.pop_back();
    } while (component.back() != node);
    std::sort(component.begin(), component.end());
    found_.push_back(std::move(component));
  }

  const Graph& edges_;
  std::vector<std::size_t> index_, low_;
  std::vector<bool> on_stack_;
  std::vector<std::size_t> stack_;
  std::vector<Frame> frames_;
  std::size_t count_ = 0;
  std::vector<std::vector<std::size_t>> found_;
};

}  // namespace

std::vector<std::vector<std::size_t>> strong_components(const Graph& edges) { return StrongComponents(edges).take(); }

}  // namespace cotwin::master
