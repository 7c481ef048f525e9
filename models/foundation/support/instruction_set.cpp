#include "models/foundation/support/instruction_set.h"

#include <cstdlib>
#include <cstring>

namespace cotwin {

InstructionSet instruction_set(const char* requested) {
#if defined(__x86_64__)
  static constexpr InstructionSet kSets[] = {
      {"x86-64-v2", 2, false}, {"x86-64-v3", 3, false}, {"x86-64-v4", 4, false}, {"x86-64-v4-intel", 4, true}};
  __builtin_cpu_init();
  // clang 14 does not support level names here. Every machine with these features has its whole level.
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                  __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                  __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                  __builtin_cpu_supports("avx512vl");
  const int highest = v4 ? 4 : v3 ? 3 : 2;
  if (requested)
    for (const InstructionSet& set : kSets)
      if (std::strcmp(requested, set.name) == 0 && set.level <= highest) return set;
  return kSets[v4 && __builtin_cpu_is("intel") ? 3 : highest - 2];
#else
  static_cast<void>(requested);
  return {"generic", 2, false};
#endif
}

InstructionSet instruction_set() {
  static const InstructionSet set = instruction_set(std::getenv("COTWIN_CPU"));
  return set;
}

}  // namespace cotwin
