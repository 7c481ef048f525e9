// Any bytes are a study or an Error. A study that was read is the same one where its text is read; each of its runs has values.
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string_view>

#include "components/services/json/json.h"
#include "components/services/json/request.h"
#include "master/farm/study.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (text.find("table") != std::string_view::npos) return 0;  // files of the machine
  if (text.find('{') == std::string_view::npos) {
    static_cast<void>(master::distribution_of(text));
    return 0;
  }
  try {
    const master::Study study = master::read_study(services::parse_object(text), "study.json", "/");
    if (master::read_study(services::parse_object(study.text), "study.json", "/elsewhere").text != study.text) std::abort();
    for (const std::int64_t run : {std::int64_t{1}, study.design.runs}) {
      const auto point = study.design.point(run);
      if (point.size() != study.design.factors.size()) std::abort();
      static_cast<void>(study.assignments(point));
    }
    static_cast<void>(study.design.extremes());
  } catch (const Error&) {
  }
  return 0;
}
