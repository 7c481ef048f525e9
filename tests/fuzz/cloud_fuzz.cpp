// Any bytes are a cloud (PCD, PLY or text) that its files give back, or an Error.
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string_view>

#include "models/cloud/cloud_file.h"
#include "models/cloud/tree.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  using cloud::Format;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  for (const Format format : {Format::kPcd, Format::kPly, Format::kText}) {
    try {
      const cloud::CloudFile read = cloud::parse_cloud(bytes, format, "cloud");
      if (read.cloud.points.empty()) std::abort();
      for (std::size_t k = 0; k < read.cloud.points.size(); ++k) {
        if (!read.cloud.point(k).allFinite()) std::abort();
      }
      for (const Format other : {Format::kPcd, Format::kPly, Format::kText}) {
        std::stringstream out;
        cloud::write_cloud(out, read.cloud, other);
        const cloud::CloudFile back = cloud::parse_cloud(out.str(), other, "back");
        if (back.cloud.points.size() + back.doubles != read.cloud.points.size() || !back.remarks.empty()) std::abort();
        if (read.cloud.origin.isZero(0) && back.cloud.origin.isZero(0) && back.cloud.points != read.cloud.points) std::abort();
      }
      const cloud::Tree tree(read.cloud);
      if (!(cloud::spacing(tree).largest > 0)) std::abort();
    } catch (const Error& error) {
      if (!std::string_view(error.what()).starts_with("cloud")) std::abort();
    }
  }
  return 0;
}
