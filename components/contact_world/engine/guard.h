#pragma once
#include <cstddef>

namespace cotwin::contact_world {

/// Account of a world's energy and of its joints' gaps, which World::fault() judges. Energy is gained without work where
///   E(t + h) − E(t) − W + D > 0
/// E: kinetic with the inertias of axes, potential, that of the joints' springs and of soft contacts; W: work in the step of all that acts
/// from outside; D: energy lost in contacts, impacts, dampers, friction and limits of joints. Each work is impulse times mean speed, in each of the
/// two solutions of a step. Without D a loss would hide a gain of the same size.
struct Guard {
  static constexpr std::size_t kNumbers = 13;  // of the state

  void add_work(double joules) {
    work += joules;
    if (joules > 0) available += joules;
  }

  double energy = 0, potential = 0;      // at the end of the last step, J
  double excess = 0;                     // energy gained without work, less what was lost without a cause since then, >= 0, J
  double owed = 0;                       // work that contacts have done on balance and take back first, >= 0, J
  double jumped = 0;                     // gains that jumps of normals explain, less what was lost since then, >= 0, J
  double available = 0;                  // kinetic energy at the start and all positive work since then, J
  double highest = 0, fall = 0;          // highest potential; largest fall from there, J
  double nearest = 0, stalled = 0;       // while assembling: least gap of the worst joint, m; steps since it fell
  double start_gap = 0, start_tilt = 0;  // while assembling: largest ones when that began, m, rad
  bool assembling = false;               // joints that started apart or beyond their limits are still being corrected
  bool begun = false;
  bool moved = true;  // the state was changed from outside since the last step

  // Of this step, J
  double work = 0;
  double passive = 0;  // work of gravity, of soft contacts' springs, and of all that can only take energy but for errors
  double placed = 0;   // energy of soft contacts that begin deep, and of bodies that are moved apart
  double lifted = 0;   // most work of the corrections of depth
  double elastic = 0;  // of soft contacts, at its start
  bool counts = true;  // all its work can be determined
};

}  // namespace cotwin::contact_world
