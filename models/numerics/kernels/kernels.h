#pragma once
#include <stddef.h>
#include <stdint.h>

/// The interface of the kernels, which are compiled from kernels.inc once per instruction set and share no inline code with
/// other files (cf. models/robot/kernels/kernels.h, also for COTWIN_CPU).
namespace cotwin::numerics {

/// The arguments of moving a block of kSwarmBlock particles; arrays by coordinate with `stride`, see SwarmState.
struct Move {
  size_t dimensions, stride, first;  // `first`: particle of the block's first lane
  uint64_t seed;
  uint32_t round;
  double inertia, cognitive, social;
  const double *lower, *upper, *best_x;
  const uint32_t* informant;
  double *x, *v;
};

struct NumericsKernels {
  const char* isa;
  /// [R; block] → [R'; 0] by Householder reflections: R p x p row-major, block 64 x p by column (destroyed).
  void (*absorb)(size_t p, double* R, double* block);
  /// y = A x in eight lanes: A packed by eight rows (element (r, c) at [((r / 8) · columns + c) · 8 + r % 8]), of which columns
  /// before first[r / 8] are zero; x: coordinate c at [c · stride]; y: row r at [8 r], rows rounded up to eight.
  void (*times)(size_t rows, size_t columns, const double* A, const size_t* first, const double* x, size_t stride, double* y);
  void (*move)(const Move&);
  /// y = X A: X rows x columns row-major, A columns x count with `stride` between its rows, y rows x count row-major. `count` is a
  /// multiple of eight.
  void (*combine)(size_t rows, size_t columns, size_t count, const double* X, const double* A, size_t stride, double* y);
  /// Least and greatest values of each of eight lanes over the rows y[8 r]: of all rows in range[0 … 15], and of every `step`-th
  /// row, beginning with the first, in range[16 … 31].
  void (*range)(size_t rows, size_t step, const double* y, double* range);
  /// Of each row of y (rows x count): adds Σ w y² to squares[r] and raises most[r] to max |y|. `count` is a multiple of eight.
  void (*moments)(size_t rows, size_t count, const double* w, const double* y, double* squares, double* most);
};

extern const NumericsKernels kernels_v2;
#if defined(__x86_64__)
extern const NumericsKernels kernels_v3, kernels_v4;
#endif

/// The kernels of the machine's highest level, or those that COTWIN_CPU selects. The highest level is the fastest one for all
/// functions (docs/decisions.md).
const NumericsKernels& kernels();
/// The kernels of one instruction set ("x86-64-v3"), or the best ones where the machine lacks it: for tests.
const NumericsKernels& kernels(const char* isa);

/// Streams of random numbers, one per purpose (Key::stream); `move` draws from the first.
enum Stream : uint32_t { kMoves, kStart, kReconfiguration, kTrials };

}  // namespace cotwin::numerics
