#pragma once
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace cotwin {

/// What was read from files, kept for many readers: robots, cells and start values for the units of many runs. Thread-safe. A file that
/// changes meanwhile is not read again.
class FileStore {
 public:
  /// The result of `read` in the first call with this key, which is of one type. What throws is not kept.
  template <class T, class Read>
  std::shared_ptr<const T> get(const std::string& key, Read read) {
    {
      const std::lock_guard lock(mutex_);
      if (const auto found = all_.find(key); found != all_.end()) return std::static_pointer_cast<const T>(found->second);
    }
    auto made = std::make_shared<const T>(read());
    const std::lock_guard lock(mutex_);
    return std::static_pointer_cast<const T>(all_.try_emplace(key, std::move(made)).first->second);
  }
  /// What is kept under keys with this beginning, by key.
  template <class T>
  std::vector<std::shared_ptr<const T>> all(const std::string& beginning) const {
    const std::lock_guard lock(mutex_);
    std::vector<std::shared_ptr<const T>> found;
    for (auto at = all_.lower_bound(beginning); at != all_.end() && at->first.starts_with(beginning); ++at)
      found.push_back(std::static_pointer_cast<const T>(at->second));
    return found;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<const void>> all_;
};

/// As get() of `store`, or by `read` alone without one.
template <class T, class Read>
std::shared_ptr<const T> read_once(FileStore* store, const std::string& key, Read read) {
  return store != nullptr ? store->get<T>(key, read) : std::make_shared<const T>(read());
}

}  // namespace cotwin
