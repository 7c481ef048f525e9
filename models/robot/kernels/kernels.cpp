#include "models/robot/kernels/kernels.h"

#include <array>

#include "models/foundation/support/instruction_set.h"

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

/// Levels by function on Intel's processors with AVX-512: those that were measured (November 2026) to be the fastest on
/// a Xeon of the fourth generation (Sapphire Rapids); level 4 where both take the same time.
Kernels intel_kernels(KernelShape shape) {
  using Levels = std::array<int, kKernelShapes>;  // tree, chain, chain of 6, chain of 7
  Kernels kernels = of_level(4)[shape];
  kernels.isa = "x86-64-v4-intel";
  const auto set = [&](auto function, const Levels& levels) {
    kernels.*function = of_level(levels[static_cast<std::size_t>(shape)])[shape].*function;
  };
  set(&Kernels::inverse_dynamics, {4, 4, 3, 3});
  set(&Kernels::mass_matrix_and_bias, {4, 4, 3, 3});
  set(&Kernels::forward_dynamics, {4, 4, 3, 3});
  set(&Kernels::regressor, {4, 4, 3, 4});
  set(&Kernels::kinematics, {3, 3, 3, 3});
  set(&Kernels::jacobian_dot_times_dq, {4, 3, 3, 3});
  set(&Kernels::potential_energy, {3, 3, 4, 4});
  return kernels;
}

const Kernels* of_set(const InstructionSet& set) {
  if (!set.per_function) return of_level(set.level);
  static const std::array<Kernels, kKernelShapes> intel{intel_kernels(kTree), intel_kernels(kChain), intel_kernels(kChain6),
                                                        intel_kernels(kChain7)};
  return intel.data();
}

}  // namespace

const Kernels& choose_kernels(int n, bool chain, const char* isa) {
  return of_set(isa ? instruction_set(isa) : instruction_set())[!chain ? kTree : n == 6 ? kChain6 : n == 7 ? kChain7 : kChain];
}

const char* kernel_isa() { return of_set(instruction_set())->isa; }

}  // namespace cotwin::robot
