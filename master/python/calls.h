#pragma once
#include <pybind11/pybind11.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <ctime>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

/// Long calls without the lock of the interpreter (GIL), and their end on Ctrl-C.
namespace cotwin::python {

namespace py = pybind11;

/// Runs the handlers of Python's signals about ten times per second during a call that does not hold the GIL. A handler that raises
/// (KeyboardInterrupt) ends the call.
class Signals {
 public:
  /// On the thread of the call; true: the call shall end, by raise(). Cheap. On other threads: whether the call shall end.
  bool pending() {
    if (stop_.load(std::memory_order_relaxed)) return true;
    if (std::this_thread::get_id() != owner_) return false;
    const std::int64_t now = coarse_ns();
    if (now < next_) return false;
    next_ = now + kEvery;
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals() != 0) keep_error();
    return stop_.load(std::memory_order_relaxed);
  }
  /// Keeps the present Python error and asks the call to end. With the GIL.
  void keep_error() {
    error_.emplace();
    stop_.store(true, std::memory_order_relaxed);
  }
  /// With the GIL, after the call: throws the kept error, if there is one.
  void raise() {
    if (!error_) return;
    py::error_already_set error = std::move(*error_);
    error_.reset();
    throw error;
  }

 private:
  static constexpr std::int64_t kEvery = 50'000'000;  // ns
  static std::int64_t coarse_ns() {
    timespec t{};
    clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
    return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
  }

  const std::thread::id owner_ = std::this_thread::get_id();
  std::int64_t next_ = coarse_ns() + kEvery;
  std::atomic<bool> stop_{false};
  std::optional<py::error_already_set> error_;
};

/// An object that one thread uses at a time: others wait without the GIL, so that the user can take it meanwhile.
class Turn {
 public:
  explicit Turn(std::mutex& mutex) : lock_(mutex, std::try_to_lock) {
    if (lock_.owns_lock()) return;
    const py::gil_scoped_release no_gil;
    lock_.lock();
  }

 private:
  std::unique_lock<std::mutex> lock_;
};

}  // namespace cotwin::python
