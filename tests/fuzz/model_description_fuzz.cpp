// Any bytes are a model description or an Error. Its variables can be declared, and it can be written and read again.
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string_view>

#include "fmu/check/check.h"
#include "fmu/description/read.h"
#include "fmu/import/unit/variables.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  fmu::ModelDescription description;
  try {
    description = fmu::parse_model_description(text, "input");
  } catch (const Error&) {
    return 0;
  }
  static_cast<void>(fmu::check_description(description));
  std::size_t elements = 0;
  const fmu::DescriptionIndex index(description);
  for (const fmu::ModelVariable& v : description.variables) elements += index.elements(v);
  if (elements < 100'000) {
    try {
      fmu::ForeignVariables foreign(description, {true, {}, true});
      Variables variables;
      foreign.declare(variables);
      variables.check_ranges();
    } catch (const Error&) {
    }
  }
  std::ostringstream xml;
  try {
    fmu::write(xml, description);
  } catch (const Error&) {  // more than its version can express
    return 0;
  }
  const fmu::ModelDescription again = fmu::parse_model_description(xml.str(), "again");
  if (again.variables.size() != description.variables.size()) std::abort();
  return 0;
}
