#include "models/foundation/support/threads.h"

#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::numerics {

struct Threads::Impl {
  std::mutex mutex;
  std::condition_variable wake, done;
  const std::function<void(std::size_t)>* work = nullptr;
  std::size_t blocks = 0;
  std::atomic<std::size_t> next{0};
  std::size_t generation = 0;
  std::size_t busy = 0;
  bool quit = false;
  std::exception_ptr failure;
  std::size_t failed_block = 0;
  std::vector<std::thread> threads;

  void run_blocks() {
    for (;;) {
      const std::size_t block = next.fetch_add(1, std::memory_order_relaxed);
      if (block >= blocks) return;
      try {
        (*work)(block);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure || block < failed_block) {
          failure = std::current_exception();
          failed_block = block;
        }
      }
    }
  }

  void wait_for_work() {
    std::size_t seen = 0;
    std::unique_lock lock(mutex);
    for (;;) {
      wake.wait(lock, [&] { return quit || generation != seen; });
      if (quit) return;
      seen = generation;
      lock.unlock();
      run_blocks();
      lock.lock();
      if (--busy == 0) done.notify_one();
    }
  }
};

Threads::Threads(int threads) : impl_(std::make_unique<Impl>()) {
  if (threads < 1) throw Error("threads", std::to_string(threads) + ", expected at least 1");
  for (int i = 1; i < threads; ++i) impl_->threads.emplace_back([this] { impl_->wait_for_work(); });
}

Threads::~Threads() {
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->quit = true;
  }
  impl_->wake.notify_all();
  for (auto& thread : impl_->threads) thread.join();
}

int Threads::threads() const { return static_cast<int>(impl_->threads.size()) + 1; }

void Threads::run(std::size_t blocks, const std::function<void(std::size_t)>& work) {
  Impl& m = *impl_;
  {
    const std::lock_guard lock(m.mutex);
    m.work = &work;
    m.blocks = blocks;
    m.next.store(0, std::memory_order_relaxed);
    m.failure = nullptr;
    m.busy = m.threads.size();
    ++m.generation;
  }
  m.wake.notify_all();
  m.run_blocks();
  std::unique_lock lock(m.mutex);
  m.done.wait(lock, [&] { return m.busy == 0; });
  if (m.failure) std::rethrow_exception(std::exchange(m.failure, nullptr));
}

}  // namespace cotwin::numerics
