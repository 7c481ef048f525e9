#include "models/numerics/kernels.h"

#include <cstdlib>
#include <cstring>

namespace cotwin::numerics {

const NumericsKernels& kernels(const char* isa) {
#if defined(__x86_64__)
  __builtin_cpu_init();
  // As in models/robot/kernels.cpp: marks of x86-64-v3 and v4 that every compiler can ask for.
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                  __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                  __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                  __builtin_cpu_supports("avx512vl");
  const struct {
    const NumericsKernels* kernels;
    bool here;
  } variants[] = {{&kernels_v4, v4}, {&kernels_v3, v3}, {&kernels_v2, true}};
  for (const auto& variant : variants)
    if (isa && variant.here && std::strcmp(variant.kernels->isa, isa) == 0) return *variant.kernels;
  for (const auto& variant : variants)
    if (variant.here) return *variant.kernels;
#else
  static_cast<void>(isa);
#endif
  return kernels_v2;
}

const NumericsKernels& kernels() {
  static const NumericsKernels& chosen = kernels(std::getenv("COTWIN_CPU"));
  return chosen;
}

}  // namespace cotwin::numerics
