#pragma once

/// Chooses at run time among variants of code that is compiled once per instruction set (models/robot/kernels,
/// models/numerics/kernels).
namespace cotwin {

/// The x86-64 level (psABI: 2, 3 or 4) named by `requested`, e.g. "x86-64-v3". The highest level of this machine if `requested`
/// is null, unknown, or above what the machine has. On other processors always 2, which stands for the only variant, "generic".
int instruction_set_level(const char* requested);
/// The same for the environment variable COTWIN_CPU, which is read at the first call.
int instruction_set_level();

}  // namespace cotwin
