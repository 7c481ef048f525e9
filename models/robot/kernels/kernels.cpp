#include "models/robot/kernels/kernels.h"

#include "models/support/instruction_set.h"

namespace cotwin::robot {
namespace {

const Kernels* of_level(int level) {
#if defined(__x86_64__)
  if (level == 4) return kernels_v4;
  if (level == 3) return kernels_v3;
#else
  static_cast<void>(level);
#endif
  return kernels_v2;
}

}  // namespace

const Kernels& choose_kernels(int n, bool chain, const char* isa) {
  const int level = isa ? instruction_set_level(isa) : instruction_set_level();
  return of_level(level)[!chain ? kTree : n == 6 ? kChain6 : n == 7 ? kChain7 : kChain];
}

const char* kernel_isa() { return of_level(instruction_set_level())->isa; }

}  // namespace cotwin::robot
