#include "models/numerics/kernels/kernels.h"

#include "models/foundation/support/instruction_set.h"

namespace cotwin::numerics {
namespace {

const NumericsKernels& of_level(int level) {
#if defined(__x86_64__)
  if (level == 4) return kernels_v4;
  if (level == 3) return kernels_v3;
#else
  static_cast<void>(level);
#endif
  return kernels_v2;
}

}  // namespace

const NumericsKernels& kernels(const char* isa) { return of_level(instruction_set(isa).level); }

const NumericsKernels& kernels() {
  static const NumericsKernels& chosen = of_level(instruction_set().level);
  return chosen;
}

}  // namespace cotwin::numerics
