#define COTWIN_VARIANT kernels_v4
#define COTWIN_ISA "x86-64-v4"
#include "models/numerics/kernels/kernels.inc"
