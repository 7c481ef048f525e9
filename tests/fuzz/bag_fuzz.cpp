// Any bytes are a bag, whose tables have as many rows as messages, or an Error that names it.
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <string>
#include <string_view>

#include "models/bag/bag.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  static const std::string file = [] {
    bag::start();
    const char* const folder = std::getenv("TMPDIR");
    return std::string(folder != nullptr ? folder : "/tmp") + "/bag_fuzz_" + std::to_string(::getpid());
  }();
  std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  if (!csv::is_bag(file)) return 0;
  try {
    for (const bag::TopicInfo& topic : bag::topics_of(file)) {
      if (!topic.trouble.empty() || topic.messages == 0) continue;
      const auto table = csv::open(file, {.topic = topic.name});
      while (table->next())
        if (table->text(table->names().size() - 1).empty()) std::abort();
      if (static_cast<std::int64_t>(table->line()) != topic.messages) std::abort();
    }
  } catch (const Error& error) {
    if (!std::string_view(error.what()).starts_with(file)) std::abort();
  }
  return 0;
}
