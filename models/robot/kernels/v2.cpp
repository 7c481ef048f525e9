// Also the generic variant for other processors.
#define COTWIN_VARIANT kernels_v2
#if defined(__x86_64__)
#define COTWIN_ISA "x86-64-v2"
#else
#define COTWIN_ISA "generic"
#endif
#include "models/robot/kernels/variant.inc"
