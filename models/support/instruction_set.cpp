#include "models/support/instruction_set.h"

#include <cstdlib>
#include <cstring>

namespace cotwin {

int instruction_set_level(const char* requested) {
#if defined(__x86_64__)
  __builtin_cpu_init();
  // clang 14 does not support level names here. Every machine with these features has its whole level.
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                  __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                  __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                  __builtin_cpu_supports("avx512vl");
  const int highest = v4 ? 4 : v3 ? 3 : 2;
  if (requested && std::strcmp(requested, "x86-64-v2") == 0) return 2;
  if (requested && std::strcmp(requested, "x86-64-v3") == 0 && highest >= 3) return 3;
  return highest;
#else
  static_cast<void>(requested);
  return 2;
#endif
}

int instruction_set_level() {
  static const int level = instruction_set_level(std::getenv("COTWIN_CPU"));
  return level;
}

}  // namespace cotwin
