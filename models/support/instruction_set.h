#pragma once

/// Selects at run time among variants of code that are compiled once per instruction set (models/robot/kernels,
/// models/numerics/kernels).
namespace cotwin {

/// The x86-64 level (psABI: 2, 3 or 4) named by `requested`, for example "x86-64-v3"; the highest level of this machine if
/// `requested` is null, unknown or not supported. On other processors always 2, the only variant, "generic".
int instruction_set_level(const char* requested);
/// As above for the environment variable COTWIN_CPU, which is read at the first call.
int instruction_set_level();

}  // namespace cotwin
