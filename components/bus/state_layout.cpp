#include "components/bus/state_layout.h"

#include <algorithm>
#include <cctype>
#include <limits>
#include <optional>
#include <set>
#include <utility>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::bus {

namespace {

std::size_t element_bytes(StateField::Kind kind) {
  return kind == StateField::Kind::kReal ? 8 : kind == StateField::Kind::kInteger ? 4 : 1;
}

std::string text_of(const StateField& f) {
  const std::string type = f.kind == StateField::Kind::kReal      ? f.si
                           : f.kind == StateField::Kind::kInteger ? "integer"
                                                                  : "boolean";
  return f.name + ":" + std::to_string(f.size) + ":" + type;
}

bool is_name(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) || c == '_'; });
}

}  // namespace

StateLayout::StateLayout(std::vector<StateField> fields) : fields_(std::move(fields)) {
  if (fields_.empty()) throw Error("states", "no field, expected at least one, as 'q:7:rad'");
  std::set<std::string_view> names;
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    const StateField& f = fields_[i];
    if (!is_name(f.name)) throw Error("states", "name '" + f.name + "', expected letters, digits and _");
    if (!names.insert(f.name).second) throw Error("states", "a second field '" + f.name + "'");
    if (f.size == 0 || f.size > kMaxBytes / element_bytes(f.kind)) {
      throw Error("states", f.name + " has " + std::to_string(f.size) + " elements, expected 1 to " +
                                std::to_string(kMaxBytes / element_bytes(f.kind)));
    }
    offsets_.push_back(bytes_);
    bytes_ += (f.size * element_bytes(f.kind) + 7) / 8 * 8;
    if (bytes_ > kMaxBytes) throw Error("states", "more than " + std::to_string(kMaxBytes) + " bytes in all");
    text_ += (i == 0 ? "" : ",") + text_of(f);
  }
  hash_ = hash_of(text_);
}

StateLayout StateLayout::parse(std::string_view text, const std::string& place) {
  std::vector<StateField> fields;
  for (const std::string_view item : text::split(text, ',')) {
    StateField f;
    const std::vector<std::string_view> parts = text::split(text::trim(item), ':');
    const auto fail = [&](const std::string& what) {
      throw Error(place, "'" + std::string(item) + "': " + what + ", expected NAME:SIZE:MEASURE as 'q:7:rad'");
    };
    if (parts.size() > 3) fail(std::to_string(parts.size()) + " parts");
    f.name = parts[0];
    if (parts.size() > 1) {
      const std::optional<long long> size = text::parse_integer(parts[1]);
      if (!size || *size < 1) fail("size '" + std::string(parts[1]) + "'");
      f.size = static_cast<std::size_t>(*size);
    }
    if (parts.size() > 2) {
      if (parts[2].empty()) fail("an empty unit of measure");
      f.kind = parts[2] == "integer"   ? StateField::Kind::kInteger
               : parts[2] == "boolean" ? StateField::Kind::kBoolean
                                       : StateField::Kind::kReal;
      if (f.kind == StateField::Kind::kReal) f.si = parts[2];
    }
    fields.push_back(std::move(f));
  }
  try {
    return StateLayout(std::move(fields));
  } catch (const Error& error) {
    throw Error(place, error.what());
  }
}

}  // namespace cotwin::bus
