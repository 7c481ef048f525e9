// Any bytes are one Error with a place, or histories that are equal after writing and reading them again, and of which every
// earlier configuration can be exported.
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <string>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/changes/history.h"
#include "models/robot/urdf/urdf.h"

namespace {

void require(bool condition, const char* what) {
  if (condition) return;
  std::cerr << what << '\n';
  std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin::robot;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    const auto histories = parse_history(text, "fuzz.json");
    require(parse_history(to_json(histories), "again.json") == histories, "reads what it wrote");
    for (const RobotHistory& history : histories) {
      for (std::size_t k = 0; k <= history.robot.history.size(); ++k) (void)to_urdf(before(history.robot, k));
    }
  } catch (const cotwin::Error& error) {
    require(std::string_view(error.what()).substr(0, 9) == "fuzz.json", error.what());
  }
  return 0;
}
