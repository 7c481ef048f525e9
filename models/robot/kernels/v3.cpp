#define COTWIN_VARIANT kernels_v3
#define COTWIN_ISA "x86-64-v3"
#include "models/robot/kernels/variant.inc"
