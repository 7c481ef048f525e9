#include "components/contact_world/engine/accounts/accounts.h"

#include <algorithm>

namespace cotwin::contact_world {
namespace {

/// Gains are relative to the energy that was there and this part of the energy that counts as nothing.
constexpr double kSmallShare = 0.1;

}  // namespace

/// Adds what corrections of depth have lifted to that of all that touch.
void Account::add_lifts(Together& all) const {
  all.lifted += lifted;
  all.higher += std::max(0.0, height - potential) + std::max(0.0, elastic - stored);
}

/// Judges the step by itself, and adds to the sums of all that touch.
void Account::judge(Together& all) {
  // Corrections of depth lift bodies and press others together. The velocity stage takes their speed back, so they explain no
  // motion: impulses that bodies without room exert on one another have no bound.
  const double raised = moved + (all.lifted > 0 ? lifted * std::min(1.0, all.higher / all.lifted) : 0);
  // Without what gravity and the soft contacts' springs have stored. Errors of one solution that the next one takes back are no gain.
  const double balance = passive + height - potential + elastic - stored - placed - raised;
  loss = std::max(0.0, -balance - owed);
  more = total() - energy - work - placed - (buried ? raised : 0);
  all.more += more;
  all.balance += balance;
  all.owed += owed;
  all.raised += buried ? 0 : raised;
  all.lost += lost;
  all.loss += loss;
  all.excess += excess;
  all.had += had();
  all.small += small;
  gain = std::max(0.0, more + loss);
  all.gain += gain;
  owed = std::max(0.0, owed + balance);
  all.owing += owed;
  buried = buried && deep;
}

/// Takes its part of what all that touch have gained. `counts`: all of their work is known.
void Account::end_step(const Together& all, bool counts) {
  const double loss_of_all = std::max(0.0, -all.balance - all.owed);
  if (all.owing > 0) owed *= std::max(0.0, all.balance + all.owed) / all.owing;
  if (all.loss > 0) lost += loss / all.loss * loss_of_all;
  // What has sunk in gives up height for speed and loses that in the contact, and is no higher when it has been lifted.
  const double lost_by_all = all.lost + loss_of_all, given_back = std::min(all.raised, lost_by_all);
  if (lost_by_all > 0) lost *= 1 - given_back / lost_by_all;
  const double gain_of_all = all.more + loss_of_all - given_back;
  if (gain_of_all <= 0) {
    jumped = std::max(0.0, jumped + gain_of_all);
    gain = all.excess > 0 ? excess / all.excess * gain_of_all : 0;
  } else {
    gain *= all.gain > 0 ? gain_of_all / all.gain : 0;
  }
  // Jumps may give the energy of their springs and no more than there was before, in all steps together.
  if (gain > 0 && jumps > 0) {
    const double explained = std::clamp(jumps + had() + small - jumped, 0.0, gain);
    jumped += explained;
    gain -= explained;
  }
  if (counts) net += more;
  if (counts) add_gain(gain, all.had + kSmallShare * all.small);
  energy = total();
  potential = height;
  highest = std::max(highest, energy - excess);
  lowest = std::min(lowest, potential);
}

void Account::add_gain(double joules, double there) {
  if (joules > 0) {
    excess += joules;
    share += joules / there;
  } else if (excess > 0) {
    const double left = std::max(0.0, excess + joules);
    share *= left / excess;
    excess = left;
  }
}

}  // namespace cotwin::contact_world
