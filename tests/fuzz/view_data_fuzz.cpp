// Any bytes are what pages show of a run, or an Error with their place.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "master/scenery/recorded.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const cotwin::master::Recorded recorded =
        cotwin::master::parse_view_data({reinterpret_cast<const char*>(data), size}, "view.bin");
    for (const auto& column : recorded.columns) {
      if (column.size() != recorded.time.size()) std::abort();
    }
    if (recorded.names.size() != recorded.columns.size()) std::abort();
  } catch (const cotwin::Error& error) {
    if (!std::string_view(error.what()).starts_with("view.bin: ")) std::abort();
  }
  return 0;
}
