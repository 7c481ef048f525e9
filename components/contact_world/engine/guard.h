#pragma once
#include <cstddef>

namespace cotwin::contact_world {

/// Account of a world's energy and of its joints' gaps, which World::fault() judges. Energy is gained without work where
///   E(t + h) − E(t) − W > 0
/// E: kinetic with the inertias of axes, potential, that of the joints' springs and of soft contacts; W: work of all that acts from outside
/// in the step.
struct Guard {
  static constexpr std::size_t kNumbers = 12;  // of the state

  void add_work(double joules) {
    work += joules;
    if (joules > 0) available += joules;
  }

  double energy = 0, potential = 0;      // at the end of the last step, J
  double excess = 0;                     // energy gained without work, less what was lost since then, >= 0, J
  double jumped = 0;                     // gains that jumps of normals explain, less what was lost since then, >= 0, J
  double available = 0;                  // kinetic energy at the start and all positive work since then, J
  double highest = 0, fall = 0;          // highest potential; largest fall from there, J
  double nearest = 0, stalled = 0;       // while assembling: least gap of the worst joint, m; steps since it fell
  double start_gap = 0, start_tilt = 0;  // while assembling: largest ones when that began, m, rad
  bool assembling = false;               // joints that started apart or beyond their limits are still being corrected
  bool begun = false;
  bool moved = true;  // the state was changed from outside since the last step

  double work = 0;     // of this step, J
  double lifted = 0;   // most work of the corrections of depth in this step, J
  double elastic = 0;  // of soft contacts, at the start of this step, J
  bool counts = true;  // all work of this step can be determined
};

}  // namespace cotwin::contact_world
