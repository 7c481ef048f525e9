#include "components/contact_world/foundation.h"

#include "models/support/error.h"
#include "models/support/text.h"

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
}

void Foundation::declare(Variables& v, const std::string& prefix) {
  if (whole_) {
    v.parameter(prefix + "stiffness", stiffness_, "N/m", "stiffness of a whole contact with body " + name_).range(1e-9, 1e18);
    v.parameter(prefix + "yield_force", yield_, "N", "force at which the contact yields; 0: never").range(0, 1e18);
  } else {
    v.parameter(prefix + "stiffness_per_area", stiffness_, "Pa/m", "pressure per depth of contacts with body " + name_)
        .range(1e-9, 1e18);
    v.parameter(prefix + "yield_stress", yield_, "Pa", "pressure at which the surface yields; 0: never").range(0, 1e18);
  }
  v.parameter(prefix + "breakthrough", breakthrough_, "m", "depth at which the body is pierced there; 0: never").range(0, 1e9);
  v.output(prefix + "pressed", pressed_, "N", "sum of the normal forces of contacts that can yield, mean over the step")
      .discrete();
  v.output(prefix + "dent", dent_, "m", "depth of the deepest dent that has stayed since the start");
  v.output(prefix + "yield_energy", yield_energy_, "J", "energy that yielding and piercing have dissipated");
  v.output(prefix + "pierced", pierced_, "whether the body is pierced anywhere");
}

void Foundation::apply(scene::Body& body) const {
  for (scene::Shape& shape : body.shapes) {
    if (shape.material.foundation == 0) continue;
    shape.material.foundation = stiffness_;
    shape.material.yield = or_infinite(yield_);
    shape.material.breakthrough = or_infinite(breakthrough_);
  }
}

void Foundation::write(const Yielding& result) {
  dent_ = result.depth;
  pressed_ = result.force;
  yield_energy_ = result.work;
  pierced_ = result.pierced;
}

void Foundation::tell(std::vector<std::string>& notes) const {
  if (dent_ == 0 && !pierced_) return;
  notes.push_back("body '" + name_ + "' has yielded: dent " + text::to_text(1e3 * dent_, 4) + " mm, " +
                  text::to_text(yield_energy_, 4) + " J dissipated" + (pierced_ ? ", pierced" : ""));
}

}  // namespace cotwin::contact_world
