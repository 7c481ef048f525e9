#pragma once

/// Selects at run time among variants of code that are compiled once per instruction set (models/robot/kernels,
/// models/numerics/kernels).
namespace cotwin {

/// The x86-64 level (psABI: 2, 3 or 4) of all functions, or a mixture of levels by function: AVX-512 is slower than AVX2 for
/// short vectors on Intel's processors, so the fastest level of each function was measured there (kernels.cpp beside the
/// kernels). The choice depends on the processor and COTWIN_CPU only, so that results have the same bits in every run.
struct InstructionSet {
  const char* name;
  int level;          // the highest level used
  bool per_function;  // levels by function as measured on Intel's processors with AVX-512
};

/// The one named by `requested`: "x86-64-v2", "x86-64-v3", "x86-64-v4" or "x86-64-v4-intel". If `requested` is null, unknown or
/// not supported: the last one on Intel's processors with AVX-512, otherwise the highest level of this machine. On other
/// processors than x86-64 there is one, "generic", with level 2.
InstructionSet instruction_set(const char* requested);
/// As above for the environment variable COTWIN_CPU, which is read at the first call.
InstructionSet instruction_set();

}  // namespace cotwin
