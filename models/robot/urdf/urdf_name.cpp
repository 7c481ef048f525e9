#include "models/robot/urdf/urdf_name.h"

#include <algorithm>

#include "models/foundation/formats/xml_text.h"

namespace cotwin::robot {

bool is_urdf_name(std::string_view name) {
  const bool has_control = std::any_of(name.begin(), name.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; });
  return !name.empty() && name.size() <= 1000 && !has_control && xml::is_xml_text(name);
}

}  // namespace cotwin::robot
