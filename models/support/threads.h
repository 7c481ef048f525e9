#pragma once
#include <cstddef>
#include <functional>
#include <memory>

namespace cotwin::numerics {

/// Persistent threads for work that falls into independent blocks. Work without a bound (tuning, farming) runs on them beside
/// the loop, not in it.
class Threads {
 public:
  /// `threads` in all, the caller's included; at least 1, which starts none.
  explicit Threads(int threads);
  ~Threads();
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

  int threads() const;
  /// Calls work(block) for all blocks in [0, blocks), each once, on any thread, and returns when all are done. Allocates
  /// nothing. If calls throw, the exception of the lowest block is thrown after all are done.
  void run(std::size_t blocks, const std::function<void(std::size_t block)>& work);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::numerics
