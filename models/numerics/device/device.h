#pragma once
#include <cstddef>
#include <memory>
#include <string>

#include "models/foundation/support/error.h"

/// A GPU of NVIDIA as a place of memory and of programs in PTX, through its driver's library alone, which is opened when it is needed.
namespace cotwin::numerics {

/// A GPU that is not there, fails or cannot do what it is asked: `GPU: cuMemAlloc_v2: CUDA_ERROR_OUT_OF_MEMORY`.
class DeviceError : public Error {
 public:
  explicit DeviceError(const std::string& why) : Error("GPU", why) {}
};

/// The first GPU of the machine. May be used by several threads. All functions throw DeviceError.
class Device {
 public:
  Device();
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  /// That of this process, which stays open once it was found: opening it takes some tenths of a second.
  static std::shared_ptr<Device> shared();

  const std::string& name() const { return name_; }  // "NVIDIA H100 80GB HBM3"
  /// How many times as fast single precision is: 2 for GPUs of data centres, 32 or 64 for others.
  int single_to_double() const { return single_to_double_; }

  struct Driver;

 private:
  friend class DeviceMemory;
  friend class DeviceProgram;
  std::unique_ptr<Driver> driver_;
  std::string name_;
  int single_to_double_ = 0;
};

/// Memory of a device.
class DeviceMemory {
 public:
  DeviceMemory(std::shared_ptr<Device> device, std::size_t bytes);
  ~DeviceMemory();
  DeviceMemory(const DeviceMemory&) = delete;
  DeviceMemory& operator=(const DeviceMemory&) = delete;

  void write(const void* from, std::size_t bytes);
  /// Waits for what was begun.
  void read(void* to, std::size_t bytes) const;
  unsigned long long address() const { return address_; }

 private:
  std::shared_ptr<Device> device_;
  unsigned long long address_ = 0;
};

/// A program with one entry.
class DeviceProgram {
 public:
  DeviceProgram(std::shared_ptr<Device> device, const char* ptx, const char* entry);
  ~DeviceProgram();
  DeviceProgram(const DeviceProgram&) = delete;
  DeviceProgram& operator=(const DeviceProgram&) = delete;

  /// Begins to run it in at least `threads` threads, in blocks of `block`. arguments: the address of each.
  void start(unsigned threads, void** arguments, unsigned block = 128) const;

 private:
  std::shared_ptr<Device> device_;
  void* module_ = nullptr;
  void* entry_ = nullptr;
};

}  // namespace cotwin::numerics
