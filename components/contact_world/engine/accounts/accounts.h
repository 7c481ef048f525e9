#pragma once
#include <cstddef>
#include <vector>

namespace cotwin::contact_world {

/// Sums over the accounts whose bodies touch one another in a step, J.
struct Together {
  double lifted = 0, higher = 0;  // most work of the corrections of depth; rise of heights and springs
  double raised = 0;              // by these corrections, of bodies that were not placed in one another
  double more = 0;                // energy without work
  double balance = 0;             // passive work without what is stored
  double loss = 0, gain = 0;      // of each alone
  double owed = 0, owing = 0;     // before the step; after it, by each alone
  double lost = 0, excess = 0;    // before the step
  double had = 0, small = 0;
};

/// Energy of a free body, or of bodies that joints, gears or latches connect. It is gained without work where
///   E(t + h) − E(t) − W + D > 0
/// E: kinetic with the inertias of axes, potential, that of the joints' springs and of soft contacts; W: work in the step of all that acts from outside,
/// other bodies included; D: energy lost in contacts, impacts, dampers, friction and limits of joints. Each work is impulse times mean speed, in each of
/// the two solutions of a step. Without D a loss would hide a gain of the same size. What two accounts lose or store in a contact counts half for each, and
/// those that touch are judged together, so that errors which one contact makes and another one takes back are no gain.
struct Account {
  double energy = 0, potential = 0;      // at the end of the last step, J
  double highest = 0, lowest = 0;        // since the start: largest energy without what was gained, least potential, J
  double excess = 0;                     // gained without work, less what was lost without a cause since then, >= 0, J
  double net = 0;                        // E − W since the start: gained less all that was lost, J
  double owed = 0;                       // work that contacts have done on balance and take back first, >= 0, J
  double lost = 0;                       // in contacts, which corrections of depth may give back, >= 0, J
  double jumped = 0;                     // gains that jumps of normals explain, less what was lost since then, >= 0, J
  double share = 0;                      // excess relative to had() of all that touched when it was gained
  double largest_share = 0, gained = 0;  // since the start; the excess then, J
  bool buried = false;                   // bodies that were placed in one another have not come out yet

  int bodies = 0;

  double had() const { return highest - lowest; }  // the most energy above the lowest place, J

  // At the end of a step, one after the other for all accounts
  void add_lifts(Together& all) const;
  void judge(Together& all);
  void end_step(const Together& all, bool counts);
  /// Adds to what was gained without work, relative to the energy that was there, J.
  void add_gain(double joules, double there);

  // Now, J
  double motion = 0, elastic = 0;  // kinetic and of springs; of it, that of soft contacts
  double height = 0;               // potential
  double total() const { return motion + height; }

  // Of this step, J
  double work = 0;
  double passive = 0;  // work of gravity, of soft contacts' springs, and of all that can only take energy but for errors
  double placed = 0;   // energy of soft contacts that begin deep
  double lifted = 0;   // most work of the corrections of depth
  double moved = 0;    // energy of bodies that are moved apart
  double jumps = 0;    // twice the energy of soft contacts whose normals may jump
  double stored = 0;   // elastic, at its start
  double before = 0;   // before impacts, or before bodies are moved apart
  double more = 0, loss = 0, gain = 0;
  double small = 0;                     // gains below are no error
  bool left_out = false;                // others judge it
  bool deep = false;                    // bodies are in one another
  bool grounded = false, held = false;  // touches rigid ground that stands still; something else
  std::size_t root = 0;                 // the first account of those that touch, also by way of others
  Together all;                         // of the root
};

/// Account of a world's energy and of its joints' gaps, which World::fault() and World::gain() judge.
struct Guard {
  std::vector<Account> accounts;
  double nearest = 0, stalled = 0;       // while assembling: least gap of the worst joint, m; steps since it fell
  double start_gap = 0, start_tilt = 0;  // while assembling: largest ones when that began, m, rad
  bool assembling = false;               // joints that started apart or beyond their limits are still being corrected
  bool begun = false;
  bool refreshed = false, replaced = false;  // the contacts are new in this step; because bodies were placed anew
  bool moved = true;                         // the state was changed from outside since the last step
  bool counts = true;                        // all work of this step can be determined
};

}  // namespace cotwin::contact_world
