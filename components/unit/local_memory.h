#pragma once
#include <string>

namespace cotwin {

/// A unit that saves its memory in less time for itself than for another instance: an FMU need not serialise its state then.
class LocalMemory {
 public:
  virtual ~LocalMemory() = default;
  /// As Unit::save_memory(), but only restore_memory() of this instance may get the bytes. The memory of the last 16 calls is kept; a call with the
  /// bytes of an earlier one replaces that one's.
  virtual void save_local_memory(std::string& bytes) = 0;
};

}  // namespace cotwin
