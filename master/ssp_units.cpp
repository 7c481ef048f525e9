#include "master/ssp_units.h"

#include <algorithm>

#include "models/text/error.h"

namespace cotwin::master::ssp {

namespace {

/// Whether the name is that of a common measure and the definition says another thing of it.
bool means_otherwise(const UnitDefinition& definition) {
  try {
    return si::parse(definition.name) != si::from(definition);
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

std::string UnitTable::intern(const std::vector<UnitDefinition>& local, const std::string& name, const std::string& place) {
  const auto named = [&](const std::string& n) { return [&n](const UnitDefinition& d) { return d.name == n; }; };
  const auto definition = std::find_if(local.begin(), local.end(), named(name));
  const auto known = std::find_if(definitions_.begin(), definitions_.end(), named(name));
  if (definition == local.end()) {
    if (known != definitions_.end()) return name;
    try {
      si::parse(name);
    } catch (const Error& error) {
      throw Error(place, std::string(error.what()) + ", and the file does not define it");
    }
    return name;
  }
  if (known != definitions_.end() && si::from(*known) == si::from(*definition)) return name;
  if (known == definitions_.end() && !means_otherwise(*definition)) {
    definitions_.push_back(*definition);
    return name;
  }
  UnitDefinition own = *definition;
  own.name += " (" + place.substr(0, place.rfind(':')) + ")";
  if (std::none_of(definitions_.begin(), definitions_.end(), named(own.name))) definitions_.push_back(own);
  return own.name;
}

si::Measure UnitTable::measure(const std::string& name) const {
  for (const UnitDefinition& d : definitions_) {
    if (d.name == name) return si::from(d);
  }
  return si::parse(name);
}

bool UnitTable::has_offsets(const std::string& name) const {
  const si::Measure m = measure(name);
  return si::convertible(m, si::parse("degC")) ||
         std::any_of(definitions_.begin(), definitions_.end(),
                     [&](const UnitDefinition& d) { return d.offset != 0 && si::convertible(m, si::from(d)); });
}

}  // namespace cotwin::master::ssp
