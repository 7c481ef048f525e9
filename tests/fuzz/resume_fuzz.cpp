// The file of a stopped tuning, with any contents: an Error, or settings that are equal after writing and reading them again.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "master/workflows/tuning/resume.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin::master::tuning;
  try {
    const Resume resume = parse_resume({reinterpret_cast<const char*>(data), size}, "resume.json");
    const std::string text = to_text(resume);
    if (to_text(parse_resume(text, "again")) != text) std::abort();
  } catch (const cotwin::Error&) {
  }
  return 0;
}
