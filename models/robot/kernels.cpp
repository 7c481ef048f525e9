#include "models/robot/kernels.h"

#include <cstdlib>
#include <cstring>

namespace cotwin::robot {
namespace {

/// Kernels of an instruction set that this machine has, best first.
const Kernels* find_kernels(const char* isa) {
#if defined(__x86_64__)
  __builtin_cpu_init();
  // The marks of x86-64-v3 and v4 that both compilers can ask for (clang 14 does not know the levels by name); no machine has
  // these without the rest of its level.
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                  __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                  __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                  __builtin_cpu_supports("avx512vl");
  const struct {
    const Kernels* kernels;
    bool here;
  } variants[] = {{kernels_v4, v4}, {kernels_v3, v3}};
  bool known = false;  // asking for less than the machine has is a choice, asking for something else is not
  for (const auto& variant : variants) known = known || (variant.here && isa && std::strcmp(variant.kernels->isa, isa) == 0);
  known = known || (isa && std::strcmp(kernels_v2->isa, isa) == 0);
  for (const auto& variant : variants)
    if (variant.here && (!known || std::strcmp(variant.kernels->isa, isa) == 0)) return variant.kernels;
#else
  static_cast<void>(isa);
#endif
  return kernels_v2;
}

const Kernels* machine_kernels() {
  static const Kernels* const kernels = find_kernels(std::getenv("COTWIN_CPU"));
  return kernels;
}

}  // namespace

const Kernels& choose_kernels(int n, bool chain, const char* isa) {
  const Kernels* kernels = isa ? find_kernels(isa) : machine_kernels();
  return kernels[!chain ? kTree : n == 6 ? kChain6 : n == 7 ? kChain7 : kChain];
}

const char* kernel_isa() { return machine_kernels()->isa; }

}  // namespace cotwin::robot
