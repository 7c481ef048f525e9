// What the user should know about a run.
#include <cmath>

#include "components/contact_world/contact_world.h"
#include "components/contact_world/parts.h"
#include "models/foundation/support/text.h"

namespace cotwin::contact_world {
namespace {

/// h ω of a soft contact above which the mean force over a step misses more than 5 % of its peaks.
constexpr double kResolvedSwing = 1;
constexpr double kUnsolvedTime = 0.05;  // s; single impacts that are not solved pass unnoticed
constexpr double kSmallGain = 0.003;

}  // namespace

void ContactWorld::append_notes(std::vector<std::string>& notes) const {
  notes.insert(notes.end(), beyond_limits_.begin(), beyond_limits_.end());
  for (const auto& body : bodies_) body->foundation.append_notes(notes);
  for (const LatchPort& latch : latches_) latch.append_notes(notes);
  if (world_->forgotten_dents() > 0) {
    notes.push_back(std::to_string(world_->forgotten_dents()) +
                    " dents were forgotten, expected more than dents=" + std::to_string(options_.dents));
  }
  if (unsolved_time_ > kUnsolvedTime) {
    notes.push_back("contacts were left unsolved for " + text::to_text(unsolved_time_, 3) +
                    " s of the run, with a residual of up to " + text::to_text(largest_unsolved_, 2) +
                    " m/s, expected at most the speed that gravity, or without it what presses bodies together, gives in two "
                    "steps, at rest "
                    "a twentieth of it or 1 mm/s: bodies may slide or fall where they should stand; more max_iterations or "
                    "smaller steps help");
  }
  const World::Gain gain = world_->gain();
  if (gain.share > kSmallGain) {
    const std::string body = "body '" + world_->scene().bodies[gain.body].name + "' and what joints connect to it";
    notes.push_back("energy has grown without work by " + text::to_text(gain.joules, 3) + " J, " +
                    (gain.of_body < gain.joules ? text::to_text(gain.of_body, 3) + " J of it in " : "in ") + body + ": " +
                    text::to_text(100 * gain.share, 3) +
                    " % of the energy that was there (kinetic, of springs, above the lowest place), expected at most " +
                    text::to_text(100 * kSmallGain) +
                    " %: the steps are too long for how fast bodies turn or roll, for contacts that stay unsolved, or for the "
                    "gears of a robot that "
                    "holds bodies with link_side=inside; smaller steps help");
  }
  if (largest_swing_ <= kResolvedSwing) return;
  notes.push_back("the step is " + text::to_text(std::round(10 * largest_swing_) / 10) +
                  " times 1/ω of the stiffest soft contact, expected at most 1: its force is a mean that misses peaks");
}

}  // namespace cotwin::contact_world
