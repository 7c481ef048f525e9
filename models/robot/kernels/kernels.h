#pragma once
#include <stddef.h>

/// The interface between dynamics.h and its kernels, which are compiled from the same source (kernels/*.inc) into one
/// translation unit per instruction set. These units share no inline code with others: only plain structs and C headers are
/// used here.
///
/// The environment variable COTWIN_CPU (models/foundation/support/instruction_set.h), read when the first Mechanism is made, selects
/// another instruction set than that of the machine; an unsupported or unknown value selects that of the machine. On Intel's
/// processors with AVX-512 it is "x86-64-v4-intel", a choice by function. On other processors than x86-64 there is one variant,
/// "generic".
namespace cotwin::robot {

/// Constants of one joint and of the body that it moves. Frame L of a body has the joint's axis as z; P is the L of the parent
/// body. In a chain the frames are rotated about and translated along their own axes so that X_PL(q) = (p_x, p_y, 0) ·
/// Rx(alpha) · Rz(q + theta_0), which is always possible, exact, and well conditioned for any axes.
struct KernelLink {
  int parent;                                 // −1: the base
  int revolute;                               // 1: revolute, 0: prismatic
  double c_alpha, s_alpha;                    // chain: rotation about x
  double cc_alpha, ss_alpha, cs_alpha;        // chain: cos², sin², cos · sin
  double p[3];                                // O_L in P at q = 0, m; p_z is zero in a chain
  double R[9];                                // R_PL at q = 0 without theta_0, row-major
  double m, h[3];                             // grouped mass, kg, and first moment about O_L, kg m
  double S_xx, S_yy, S_zz, S_xy, S_xz, S_yz;  // grouped second moments ∫ r rᵀ dm about O_L, kg m²
  double mass, first_moment[3];               // the body's own mass and first moment about O_L, kg, kg m
  double R_LJ[9], p_LJ[3];                    // the body's own (URDF) frame J in L
};

/// One link of a tree, by slot: its place in a depth-first order of the joints.
struct KernelTreeLink {
  int joint;     // its index in `links`
  int parent;    // slot; −1: the base
  int size;      // number of links from this one outward; their slots are consecutive
  int sweep;     // the slot that is visited in this place of a sweep from the base outward, by distance from the base
  int revolute;  // 1: revolute, 0: prismatic
  double R[9];   // as in KernelLink
  double p[3];
};

/// Constants of a robot for the kernels. A mass distribution on a revolute joint's own axis (mass, mass · z, mass · z²) can be
/// assigned to the parent body: `m, h_z, S_zz` of revolute links are added to the parent ("grouped"), which does not change M,
/// C and g and saves operations.
struct KernelModel {
  int n;
  const KernelLink* links;  // n
  const double* theta_0;    // rad, padded with zeros to a multiple of 8, like:
  const double* c_alpha;
  const double* s_alpha;
  const KernelTreeLink* tree;  // tree: n, by slot, like:
  const double*
      tree_inertia;         // 11 arrays of rounded_up(n): grouped m, h (3), S_xx, S_yy, S_zz, S_xy, S_xz, S_yz, and `revolute`
  int tree_in_order;        // 1: slot k is joint k
  int reference;            // slot of the link whose origin is the reference point of moments; −1: the base
  double R_BP[9], p_BP[3];  // the first link's P in the base (tree: identity)
  double a_0[3];            // −gravity in P, m/s²
  double gravity[3];        // in B, m/s²
};

/// Pose with R row-major.
struct KernelPose {
  double R[9], p[3];
};

/// One function per entry of dynamics.h. `scratch` is 64-byte aligned and has scratch_doubles(n) elements. Matrices are
/// column-major with leading dimension `ld`.
struct Kernels {
  const char* isa;  // "x86-64-v3"
  void (*sine_cosine)(int count, const double* q, double* sine, double* cosine);
  void (*inverse_dynamics)(const KernelModel&, double* scratch, const double* a_0, const double* q, const double* dq,
                           const double* ddq, double* tau);
  void (*inverse_dynamics_batch)(const KernelModel&, double* scratch, size_t count, const double* q, const double* dq,
                                 const double* ddq, double* tau);
  void (*mass_matrix)(const KernelModel&, double* scratch, const double* q, double* M, ptrdiff_t ld);
  void (*mass_matrix_and_bias)(const KernelModel&, double* scratch, const double* q, const double* dq, double* M, ptrdiff_t ld,
                               double* h);
  void (*coriolis_matrix)(const KernelModel&, double* scratch, const double* q, const double* dq, double* C, ptrdiff_t ld);
  void (*forward_dynamics)(const KernelModel&, double* scratch, const double* q, const double* dq, const double* tau,
                           double* ddq);
  void (*derivatives)(const KernelModel&, double* scratch, const double* q, const double* dq, const double* ddq,
                      double* dtau_dq, ptrdiff_t ld_q, double* dtau_ddq, ptrdiff_t ld_dq);
  void (*regressor)(const KernelModel&, double* scratch, const double* q, const double* dq, const double* ddq, double* Y,
                    ptrdiff_t ld);
  void (*kinematics)(const KernelModel&, double* scratch, const double* q, int body, const KernelPose& X_JF, KernelPose* X_BF,
                     double* J,
                     ptrdiff_t ld);  // J: may be null
  void (*jacobian_dot_times_dq)(const KernelModel&, double* scratch, const double* q, const double* dq, int body,
                                const KernelPose& X_JF, double* a);
  double (*potential_energy)(const KernelModel&, double* scratch, const double* q);
};

/// Kernels of one instruction set, for each shape of robot: tree, chain of any length, chain of 6, chain of 7.
enum KernelShape { kTree, kChain, kChain6, kChain7, kKernelShapes };
extern const Kernels kernels_v2[kKernelShapes];
#if defined(__x86_64__)
extern const Kernels kernels_v3[kKernelShapes];
extern const Kernels kernels_v4[kKernelShapes];
#endif

/// The table for a robot of this shape: the machine's or COTWIN_CPU's, or that of `isa` ("x86-64-v3") if it is given and
/// supported.
const Kernels& choose_kernels(int n, bool chain, const char* isa);
/// Instruction set selected by COTWIN_CPU or the machine, for example "x86-64-v4-intel".
const char* kernel_isa();
/// Doubles of scratch memory for n joints.
size_t scratch_doubles(int n);

}  // namespace cotwin::robot
