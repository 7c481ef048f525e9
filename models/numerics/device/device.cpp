#include "models/numerics/device/device.h"

#if defined(_WIN32)
#include <windows.h>
#else
#include <dlfcn.h>
#endif

#include <mutex>

namespace cotwin::numerics {

namespace {

/// The functions of a library by their names. Stays open: a driver leaves threads behind.
class Library {
 public:
#if defined(_WIN32)
  Library() : handle_(LoadLibraryA("nvcuda.dll")) {}
  void* find(const char* name) const { return reinterpret_cast<void*>(GetProcAddress(handle_, name)); }

 private:
  HMODULE handle_;
#else
  Library() : handle_(dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL)) {}
  void* find(const char* name) const { return dlsym(handle_, name); }

 private:
  void* handle_;
#endif
 public:
  bool open() const { return handle_ != nullptr; }
};

[[noreturn]] void fail(const std::string& why) { throw DeviceError(why); }

}  // namespace

/// The interface of the driver of CUDA 4 and later: status codes are 0 for success, handles are pointers, addresses integers of 64 bits.
struct Device::Driver {
  Driver() {
    const Library library;
    if (!library.open()) fail("no driver of NVIDIA is installed");
    const auto take = [&](const char* name, auto& function) {
      function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(library.find(name));
      if (!function) fail(std::string("the driver has no ") + name + ", expected one of 2017 or later");
    };
#define COTWIN_TAKE(name) take(#name, name)
    COTWIN_TAKE(cuInit);
    COTWIN_TAKE(cuGetErrorName);
    COTWIN_TAKE(cuDeviceGet);
    COTWIN_TAKE(cuDeviceGetName);
    COTWIN_TAKE(cuDeviceGetAttribute);
    COTWIN_TAKE(cuDevicePrimaryCtxRetain);
    COTWIN_TAKE(cuDevicePrimaryCtxRelease);
    COTWIN_TAKE(cuCtxSetCurrent);
    COTWIN_TAKE(cuCtxSynchronize);
    COTWIN_TAKE(cuMemAlloc_v2);
    COTWIN_TAKE(cuMemFree_v2);
    COTWIN_TAKE(cuMemcpyHtoD_v2);
    COTWIN_TAKE(cuMemcpyDtoH_v2);
    COTWIN_TAKE(cuModuleLoadDataEx);
    COTWIN_TAKE(cuModuleUnload);
    COTWIN_TAKE(cuModuleGetFunction);
    COTWIN_TAKE(cuLaunchKernel);
#undef COTWIN_TAKE
  }

  int (*cuInit)(unsigned);
  int (*cuGetErrorName)(int, const char**);
  int (*cuDeviceGet)(int*, int);
  int (*cuDeviceGetName)(char*, int, int);
  int (*cuDeviceGetAttribute)(int*, int, int);
  int (*cuDevicePrimaryCtxRetain)(void**, int);
  int (*cuDevicePrimaryCtxRelease)(int);
  int (*cuCtxSetCurrent)(void*);
  int (*cuCtxSynchronize)();
  int (*cuMemAlloc_v2)(unsigned long long*, std::size_t);
  int (*cuMemFree_v2)(unsigned long long);
  int (*cuMemcpyHtoD_v2)(unsigned long long, const void*, std::size_t);
  int (*cuMemcpyDtoH_v2)(void*, unsigned long long, std::size_t);
  int (*cuModuleLoadDataEx)(void**, const void*, unsigned, int*, void**);
  int (*cuModuleUnload)(void*);
  int (*cuModuleGetFunction)(void**, void*, const char*);
  int (*cuLaunchKernel)(void*, unsigned, unsigned, unsigned, unsigned, unsigned, unsigned, unsigned, void*, void**, void**);

  int device = 0;
  void* context = nullptr;

  void check(int code, const char* name) const {
    if (code == 0) return;
    const char* word = nullptr;
    if (cuGetErrorName(code, &word) != 0 || word == nullptr) word = "an unknown error";
    fail(std::string(name) + ": " + word);
  }
  /// The context belongs to a thread.
  void enter() const { check(cuCtxSetCurrent(context), "cuCtxSetCurrent"); }
};

#define COTWIN_CALL(driver, function, ...) (driver).check((driver).function(__VA_ARGS__), #function)

Device::Device() : driver_(std::make_unique<Driver>()) {
  Driver& d = *driver_;
  COTWIN_CALL(d, cuInit, 0);
  COTWIN_CALL(d, cuDeviceGet, &d.device, 0);
  char name[256] = {};
  COTWIN_CALL(d, cuDeviceGetName, name, sizeof name - 1, d.device);
  name_ = name;
  constexpr int kSingleToDoublePrecisionPerfRatio = 87;
  COTWIN_CALL(d, cuDeviceGetAttribute, &single_to_double_, kSingleToDoublePrecisionPerfRatio, d.device);
  COTWIN_CALL(d, cuDevicePrimaryCtxRetain, &d.context, d.device);
}

Device::~Device() { (void)driver_->cuDevicePrimaryCtxRelease(driver_->device); }

std::shared_ptr<Device> Device::shared() {
  static std::mutex mutex;
  static std::shared_ptr<Device> device;
  const std::lock_guard lock(mutex);
  if (!device) device = std::make_shared<Device>();
  return device;
}

DeviceMemory::DeviceMemory(std::shared_ptr<Device> device, std::size_t bytes) : device_(std::move(device)) {
  const Device::Driver& d = *device_->driver_;
  d.enter();
  COTWIN_CALL(d, cuMemAlloc_v2, &address_, bytes);
}

DeviceMemory::~DeviceMemory() {
  const Device::Driver& d = *device_->driver_;
  (void)d.cuCtxSetCurrent(d.context);
  (void)d.cuMemFree_v2(address_);
}

void DeviceMemory::write(const void* from, std::size_t bytes) {
  const Device::Driver& d = *device_->driver_;
  d.enter();
  COTWIN_CALL(d, cuMemcpyHtoD_v2, address_, from, bytes);
}

void DeviceMemory::read(void* to, std::size_t bytes) const {
  const Device::Driver& d = *device_->driver_;
  d.enter();
  COTWIN_CALL(d, cuCtxSynchronize);  // tells the errors of a program
  COTWIN_CALL(d, cuMemcpyDtoH_v2, to, address_, bytes);
}

DeviceProgram::DeviceProgram(std::shared_ptr<Device> device, const char* ptx, const char* entry) : device_(std::move(device)) {
  const Device::Driver& d = *device_->driver_;
  d.enter();
  COTWIN_CALL(d, cuModuleLoadDataEx, &module_, ptx, 0, nullptr, nullptr);
  try {
    COTWIN_CALL(d, cuModuleGetFunction, &entry_, module_, entry);
  } catch (const DeviceError&) {
    (void)d.cuModuleUnload(module_);
    throw;
  }
}

DeviceProgram::~DeviceProgram() {
  const Device::Driver& d = *device_->driver_;
  (void)d.cuCtxSetCurrent(d.context);
  (void)d.cuModuleUnload(module_);
}

void DeviceProgram::start(unsigned threads, void** arguments, unsigned block) const {
  const Device::Driver& d = *device_->driver_;
  d.enter();
  COTWIN_CALL(d, cuLaunchKernel, entry_, (threads + block - 1) / block, 1, 1, block, 1, 1, 0, nullptr, arguments, nullptr);
}

#undef COTWIN_CALL

}  // namespace cotwin::numerics
