#pragma once
#include <stddef.h>

/// The border between dynamics.h and its kernels, which are compiled from the same source (kernels/*.inc) into one translation
/// unit per instruction set. Those units share no inline code with others: plain structs and C headers only cross this file.
///
/// The environment variable COTWIN_CPU (models/support/instruction_set.h), read once when the first Mechanism is made, forces
/// a lower instruction set than the machine has; one that the machine lacks, or an unknown word, gives the best that it has.
/// Elsewhere than on x86-64 there is one variant, "generic".
namespace cotwin::robot {

/// Constants of one joint and of the body that it moves. Frame L of a body has the joint's axis as z; P is the L of the parent
/// body. In a chain the frames are turned about and slid along their own axes such that X_PL(q) = (p_x, p_y, 0) · Rx(alpha) ·
/// Rz(q + theta_0): always possible, exact, and well conditioned for any axes.
struct KernelLink {
  int parent;                                 // −1: the base
  int revolute;                               // 1: revolute, 0: prismatic
  double c_alpha, s_alpha;                    // chain: turn about x
  double cc_alpha, ss_alpha, cs_alpha;        // chain: cos², sin², cos · sin
  double p[3];                                // O_L in P at q = 0, m; p_z is zero in a chain
  double R[9];                                // R_PL at q = 0 without theta_0, row-major
  double m, h[3];                             // grouped mass, kg, and first moment about O_L, kg m
  double S_xx, S_yy, S_zz, S_xy, S_xz, S_yz;  // grouped second moments ∫ r rᵀ dm about O_L, kg m²
  double mass, first_moment[3];               // the body's own mass and first moment about O_L, kg, kg m
  double R_LJ[9], p_LJ[3];                    // the body's own (URDF) frame J in L
};

/// What the kernels read of a robot. A mass distribution on a revolute joint's own axis (mass, mass · z, mass · z²) belongs to
/// the parent body as well as to the body: `m, h_z, S_zz` of revolute links are moved there ("grouped"), which leaves M, C and
/// g as they are and the kernels fewer terms.
struct KernelModel {
  int n;
  const KernelLink* links;  // n
  const double* theta_0;    // rad, padded with zeros to a multiple of 8, as are:
  const double* c_alpha;
  const double* s_alpha;
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
  void (*derivatives)(const KernelModel&, double* scratch, const double* q, const double* dq, const double* ddq, double* tau,
                      double* dtau_dq, ptrdiff_t ld_q, double* dtau_ddq, ptrdiff_t ld_dq, double* M,
                      ptrdiff_t ld_M);  // tau, M: or null
  void (*regressor)(const KernelModel&, double* scratch, const double* q, const double* dq, const double* ddq, double* Y,
                    ptrdiff_t ld);
  void (*kinematics)(const KernelModel&, double* scratch, const double* q, int body, const KernelPose& X_JF, KernelPose* X_BF,
                     double* J,
                     ptrdiff_t ld);  // J: or null
  void (*jacobian_dot_times_dq)(const KernelModel&, double* scratch, const double* q, const double* dq, int body,
                                const KernelPose& X_JF, double* a);
  void (*operational_inertia_inverse)(const KernelModel&, double* scratch, const double* q, int body, const KernelPose& X_JF,
                                      double* Lambda_inverse, ptrdiff_t ld);
  double (*potential_energy)(const KernelModel&, double* scratch, const double* q);
};

/// Of one instruction set, for a shape of robot. `which`: 0 tree, 1 chain of any length, 2 chain of 6, 3 chain of 7.
enum KernelShape { kTree, kChain, kChain6, kChain7, kKernelShapes };
extern const Kernels kernels_v2[kKernelShapes];
#if defined(__x86_64__)
extern const Kernels kernels_v3[kKernelShapes];
extern const Kernels kernels_v4[kKernelShapes];
#endif

/// The table for a robot of this shape: the best that the machine has, or `isa` ("x86-64-v3") if it is given and the machine
/// has it.
const Kernels& choose_kernels(int n, bool chain, const char* isa);
/// What COTWIN_CPU or the machine says, e.g. "x86-64-v4".
const char* kernel_isa();
/// Doubles that the kernels need for n joints.
size_t scratch_doubles(int n);

}  // namespace cotwin::robot
