// A stand-in of the driver's library of NVIDIA's GPUs: its memory is that of the process, and its programs are the entries of judgement.inc,
// compiled for this processor. Any call can be made to fail, and what was taken and not given back is counted.
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <string>

namespace {
unsigned thread_number = 0;
}

#define COTWIN_ONE_LANE
#define COTWIN_ENTRY extern "C" void
#define COTWIN_THREAD thread_number
#include "models/optimisation/judgement/entries.inc"
COTWIN_JUDGE(judge_tree, 0, false)
COTWIN_JUDGE(judge_chain, 0, true)
COTWIN_JUDGE(judge_chain_6, 6, true)
COTWIN_JUDGE(judge_chain_7, 7, true)

namespace {

using Entry = void (*)(const double*, unsigned, unsigned, const double*, double*);

constexpr int kOutOfMemory = 2, kInvalid = 1;
constexpr double kNoDamage = 1;

std::atomic<int> calls = 0;
int failing = std::getenv("STAND_IN_FAILS") ? std::atoi(std::getenv("STAND_IN_FAILS")) : 0;  // the number of the call, from 1
std::atomic<int> taken = 0;  // contexts, modules and parts of memory
int ratio = std::getenv("STAND_IN_RATIO") ? std::atoi(std::getenv("STAND_IN_RATIO")) : 2;  // single to double precision
double damage = kNoDamage;  // factor of the last figure of a batch
std::string failed;

bool fails(const char* name) {
  if (++calls != failing) return false;
  failed = name;
  return true;
}

}  // namespace

#define EXPORT extern "C" __attribute__((visibility("default")))

EXPORT void stand_in_fail(int call) {
  calls = 0;
  failing = call;
  failed.clear();
}
EXPORT int stand_in_calls() { return calls; }
EXPORT const char* stand_in_failed() { return failed.c_str(); }
EXPORT int stand_in_taken() { return taken; }
EXPORT void stand_in_damage(double factor) { damage = factor; }

EXPORT int cuInit(unsigned) { return fails("cuInit") ? kInvalid : 0; }
EXPORT int cuGetErrorName(int code, const char** name) {
  *name = code == kOutOfMemory ? "CUDA_ERROR_OUT_OF_MEMORY" : "CUDA_ERROR_INVALID_VALUE";
  return 0;
}
EXPORT int cuDeviceGet(int* device, int) {
  *device = 7;
  return fails("cuDeviceGet") ? kInvalid : 0;
}
EXPORT int cuDeviceGetName(char* name, int size, int device) {
  if (fails("cuDeviceGetName") || device != 7) return kInvalid;
  std::strncpy(name, "stand-in of a GPU", static_cast<std::size_t>(size));
  return 0;
}
EXPORT int cuDeviceGetAttribute(int* value, int attribute, int) {
  *value = ratio;
  return fails("cuDeviceGetAttribute") || attribute != 87 ? kInvalid : 0;
}
EXPORT int cuDevicePrimaryCtxRetain(void** context, int) {
  if (fails("cuDevicePrimaryCtxRetain")) return kInvalid;
  *context = &calls;
  ++taken;
  return 0;
}
EXPORT int cuDevicePrimaryCtxRelease(int) {
  --taken;
  return 0;
}
EXPORT int cuCtxSetCurrent(void* context) { return fails("cuCtxSetCurrent") || context != &calls ? kInvalid : 0; }
EXPORT int cuCtxSynchronize() { return fails("cuCtxSynchronize") ? kInvalid : 0; }
EXPORT int cuMemAlloc_v2(unsigned long long* address, std::size_t bytes) {
  if (fails("cuMemAlloc_v2")) return kOutOfMemory;
  *address = reinterpret_cast<unsigned long long>(std::malloc(bytes));
  ++taken;
  return 0;
}
EXPORT int cuMemFree_v2(unsigned long long address) {
  std::free(reinterpret_cast<void*>(address));
  --taken;
  return 0;
}
EXPORT int cuMemGetInfo_v2(std::size_t* free, std::size_t* total) {
  *total = 1000;
  *free = *total - static_cast<std::size_t>(taken);
  return 0;
}
EXPORT int cuMemcpyHtoD_v2(unsigned long long to, const void* from, std::size_t bytes) {
  if (fails("cuMemcpyHtoD_v2")) return kInvalid;
  std::memcpy(reinterpret_cast<void*>(to), from, bytes);
  return 0;
}
EXPORT int cuMemcpyDtoH_v2(void* to, unsigned long long from, std::size_t bytes) {
  if (fails("cuMemcpyDtoH_v2")) return kInvalid;
  std::memcpy(to, reinterpret_cast<const void*>(from), bytes);
  return 0;
}
EXPORT int cuModuleLoadDataEx(void** module, const void* text, unsigned, int*, void**) {
  if (fails("cuModuleLoadDataEx")) return kInvalid;
  *module = const_cast<void*>(text);
  ++taken;
  return 0;
}
EXPORT int cuModuleUnload(void*) {
  --taken;
  return 0;
}
EXPORT int cuModuleGetFunction(void** entry, void* module, const char* name) {
  if (fails("cuModuleGetFunction") ||
      std::string(static_cast<const char*>(module)).find(".visible .entry " + std::string(name) + "(") == std::string::npos)
    return kInvalid;
  static const std::map<std::string, Entry> entries{{"judge_tree", judge_tree},
                                                    {"judge_chain", judge_chain},
                                                    {"judge_chain_6", judge_chain_6},
                                                    {"judge_chain_7", judge_chain_7}};
  *entry = reinterpret_cast<void*>(entries.at(name));
  return 0;
}
EXPORT int cuLaunchKernel(void* entry, unsigned grid, unsigned, unsigned, unsigned block, unsigned, unsigned, unsigned, void*,
                          void** arguments, void**) {
  if (fails("cuLaunchKernel")) return kInvalid;
  const auto get = [&](int k, auto& value) { std::memcpy(&value, arguments[k], sizeof value); };
  const double *problem, *given;
  double* out;
  unsigned first, count;
  get(0, problem);
  get(1, first);
  get(2, count);
  get(3, given);
  get(4, out);
  static std::mutex mutex;  // of thread_number
  const std::lock_guard lock(mutex);
  for (thread_number = 0; thread_number < grid * block; ++thread_number)
    reinterpret_cast<Entry>(entry)(problem, first, count, given, out);
  const int terms = reinterpret_cast<const cotwin::optimisation::JudgedProblem*>(problem)->terms;
  if (damage != kNoDamage)
    for (unsigned i = 0; i < count; ++i)
      out[static_cast<std::size_t>(cotwin::optimisation::kVerdictCosts + terms - 1) * count + i] *= damage;
  return 0;
}
