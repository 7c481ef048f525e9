#include "master/scenario/units.h"

#include <algorithm>

#include "models/foundation/support/error.h"

namespace cotwin::master::ssp {

namespace {

/// Returns whether the definition contradicts the standard meaning of its name.
bool contradicts_name(const UnitDefinition& definition) {
  try {
    return si::parse(definition.name) != si::from(definition);
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

void UnitTable::add(const UnitDefinition& definition) {
  definitions_.add(definition);
  if (definition.offset == 0) return;
  const si::Measure measure = si::from(definition);
  if (std::none_of(with_offset_.begin(), with_offset_.end(), [&](const si::Measure& m) { return si::convertible(m, measure); }))
    with_offset_.push_back(measure);
}

std::string UnitTable::intern(const UnitDefinitions& local, const std::string& name, const std::string& place) {
  const UnitDefinition* const definition = local.find(name);
  const UnitDefinition* const known = definitions_.find(name);
  if (definition == nullptr) {
    if (known != nullptr) return name;
    try {
      si::parse(name);
    } catch (const Error& error) {
      throw Error(place, std::string(error.what()) + ", and the file does not define it");
    }
    return name;
  }
  if (known != nullptr && si::from(*known) == si::from(*definition)) return name;
  if (known == nullptr && !contradicts_name(*definition)) {
    add(*definition);
    return name;
  }
  UnitDefinition own = *definition;
  own.name += " (" + place.substr(0, place.rfind(':')) + ")";
  add(own);
  return own.name;
}

si::Measure UnitTable::measure(const std::string& name) const {
  const UnitDefinition* const definition = definitions_.find(name);
  return definition != nullptr ? si::from(*definition) : si::parse(name);
}

bool UnitTable::has_offsets(const std::string& name) const {
  const si::Measure m = measure(name);
  return si::convertible(m, si::parse("degC")) ||
         std::any_of(with_offset_.begin(), with_offset_.end(),
                     [&](const si::Measure& other) { return si::convertible(m, other); });
}

}  // namespace cotwin::master::ssp
