#include "components/contact_world/foundation.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::contact_world {
namespace {

double or_zero(double limit) { return limit < scene::kInfinity ? limit : 0; }
double or_infinite(double limit) { return limit > 0 ? limit : scene::kInfinity; }

}  // namespace

Foundation::Foundation(const std::string& place, const std::string& name, const scene::Body& body) : name_(name) {
  for (const scene::Shape& shape : body.shapes) {
    const scene::Material& m = shape.material;
    if (m.foundation == 0) continue;
    if (stiffness_ > 0 && (m.whole != whole_ || m.foundation != stiffness_ || or_zero(m.yield) != yield_ ||
                           or_zero(m.breakthrough) != breakthrough_)) {
      throw Error(place, "body '" + body.name + "': shapes with different foundations, expected a body for each");
    }
    whole_ = m.whole;
    stiffness_ = m.foundation;
    yield_ = or_zero(m.yield);
    breakthrough_ = or_zero(m.breakthrough);
  }
  take();
}

void Foundation::declare(Variables& v, const std::string& prefix) {
  if (whole_) {
    v.tunable(prefix + "stiffness", stiffness_, "N/m", "stiffness of a whole contact with body " + name_).range(1e-9, 1e18);
    v.tunable(prefix + "yield_force", yield_, "N", "force at which the contact yields; 0: never").range(0, 1e18);
  } else {
    v.tunable(prefix + "stiffness_per_area", stiffness_, "Pa/m", "pressure per depth of contacts with body " + name_)
        .range(1e-9, 1e18);
    v.tunable(prefix + "yield_stress", yield_, "Pa", "pressure at which the surface yields; 0: never").range(0, 1e18);
  }
  v.tunable(prefix + "breakthrough", breakthrough_, "m", "depth at which the body is pierced there; 0: never").range(0, 1e9);
  v.output(prefix + "pressed", pressed_, "N", "sum of the normal forces of contacts that can yield, mean over the step")
      .discrete();
  v.output(prefix + "dent", dent_, "m", "depth of the deepest dent that has stayed since the start");
  v.output(prefix + "yield_energy", yield_energy_, "J", "energy that yielding and piercing have dissipated");
  v.output(prefix + "pierced", pierced_, "whether the body is pierced anywhere");
}

void Foundation::declare_state(Variables& v, const std::string& prefix) {
  v.state(prefix + "foundation", in_force_, "1", "the tunables of the foundation of body " + name_ + " in force");
}

void Foundation::apply(scene::Body& body) const {
  for (scene::Shape& shape : body.shapes) {
    if (shape.material.foundation == 0) continue;
    shape.material.foundation = in_force_[0];
    shape.material.yield = or_infinite(in_force_[1]);
    shape.material.breakthrough = or_infinite(in_force_[2]);
  }
}

void Foundation::follow(const std::string& place, const std::string& variables, World& world, std::size_t body) {
  const double wanted[] = {stiffness_, yield_, breakthrough_};
  if (std::ranges::equal(wanted, in_force_)) return;
  const char* const names[] = {whole_ ? "stiffness" : "stiffness_per_area", whole_ ? "yield_force" : "yield_stress",
                               "breakthrough"};
  for (std::size_t k = 0; k < 3; ++k) {
    const bool is_limit = k > 0, was_none = is_limit && in_force_[k] == 0;
    if (std::isfinite(wanted[k]) && (was_none ? wanted[k] == 0 : wanted[k] > 0)) continue;
    throw Error(place + "." + variables + "." + names[k], "is " + text::to_text(wanted[k]) + ", expected " +
                                                              (was_none ? "0 (never), as at the start" : "a finite value > 0"));
  }
  std::ranges::copy(wanted, in_force_.begin());
  restored(world, body);
}

void Foundation::restored(World& world, std::size_t body) const {
  world.set_foundation(body, in_force_[0], or_infinite(in_force_[1]), or_infinite(in_force_[2]));
}

void Foundation::write(const Yielding& result) {
  dent_ = result.depth;
  pressed_ = result.force;
  yield_energy_ = result.work;
  pierced_ = result.pierced;
}

void Foundation::append_notes(std::vector<std::string>& notes) const {
  if (dent_ == 0 && !pierced_) return;
  notes.push_back("body '" + name_ + "' has yielded: dent " + text::to_text(1e3 * dent_, 4) + " mm, " +
                  text::to_text(yield_energy_, 4) + " J dissipated" + (pierced_ ? ", pierced" : ""));
}

}  // namespace cotwin::contact_world
