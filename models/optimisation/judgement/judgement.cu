// The judgement of motions for NVIDIA's GPUs, compiled to PTX without a header of CUDA: the entry COTWIN_NAME for robots of the shape COTWIN_SHAPE.
#pragma clang force_cuda_host_device begin
#define COTWIN_ONE_LANE
#define COTWIN_ENTRY extern "C" __attribute__((global)) void
#define COTWIN_THREAD (__nvvm_read_ptx_sreg_ctaid_x() * __nvvm_read_ptx_sreg_ntid_x() + __nvvm_read_ptx_sreg_tid_x())
#include "models/optimisation/judgement/entries.inc"
COTWIN_JUDGE(COTWIN_NAME, COTWIN_SHAPE)
#pragma clang force_cuda_host_device end
