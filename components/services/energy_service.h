#pragma once
#include "components/services/robots.h"
#include "components/services/services.h"
#include "models/energetics/motion_energy.h"
#include "models/energetics/waiting.h"

namespace cotwin::services {

struct EnergyOptions {
  energetics::Bus bus = energetics::Bus::kShared;
  double cycle = 0;                                  // s, for the move and the wait after it; 0: no wait
  std::optional<double> price_per_kWh, co2_per_kWh;  // in place of the robot's
  bool best = false;                                 // also the best duration
  double T_longest = 0;                              // s, of the best duration; 0: cycle, or ten times the shortest one
};

/// Energy of a move with its boundary: what flowed from the mains, where the robot has data of its drives, else the work of the
/// motors alone.
struct MotionCost {
  bool with_drives = false;  // false: only mechanical work and friction are known
  Plan plan;
  energetics::MotionEnergy energy;
  energetics::Waiting waiting;  // after the move, with a cycle, at the DC link
  double waiting_energy = 0;    // J, from the mains, with supply and controller
  double price = 0, co2 = 0;    // of move and wait; any currency, kg
  std::string assumed;          // parameters of the drives that are assumptions

  /// The duration of least energy for this shape, with the wait in a cycle.
  struct Best {
    double T = 0, energy = 0, energy_here = 0;  // s, J, J; of move and wait, at T and at the move's own duration
    bool at_shortest = false, at_longest = false;
    bool brakes_close = false;
  };
  std::optional<Best> best;  // only with data of the drives
  double total() const { return energy.books.drawn + waiting_energy; }
};

/// Energy of the rigid robot with motor inertia and friction of `move.drives`. Throws Error for a robot with passive joints, a cycle
/// shorter than the move, and if no duration meets the bounds.
MotionCost energy_of(const Robot& robot, const Move& move, const EnergyOptions& options = {});

/// B and friction of motor and link together, from drive_train.ssv; without it friction by <dynamics> of the URDF; empty where both
/// are missing.
optimisation::DriveTerms drive_terms(const Robot& robot);

}  // namespace cotwin::services
