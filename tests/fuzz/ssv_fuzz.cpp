// Any bytes are a parameter set or an Error. A set that was read and written is read and written as the same text.
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string_view>

#include "components/unit/si.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  cotwin::ParameterSet set;
  try {
    set = cotwin::parse_parameter_set(text, "input");
  } catch (const cotwin::Error&) {
    return 0;
  }
  std::ostringstream once, twice;
  cotwin::write_parameter_set(once, set);
  cotwin::write_parameter_set(twice, cotwin::parse_parameter_set(once.str(), "written"));
  if (once.str() != twice.str()) std::abort();
  try {
    cotwin::si::define_units(set);
  } catch (const cotwin::Error&) {
  }
  return 0;
}
