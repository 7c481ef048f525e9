#pragma once
#include <cstddef>
#include <functional>
#include <memory>

namespace cotwin::numerics {

/// Persistent threads for work in independent blocks. Work of unbounded duration (tuning, parallel runs) uses them beside the
/// real-time loop, not in it.
class Threads {
 public:
  /// `threads`: total number including the caller's, at least 1.
  explicit Threads(int threads);
  ~Threads();
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

  int threads() const;
  /// Calls work(block) once for each block in [0, blocks), on any thread, and returns after all calls. Allocates nothing. If
  /// calls throw, throws the exception of the lowest block after all calls.
  void run(std::size_t blocks, const std::function<void(std::size_t block)>& work);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::numerics
