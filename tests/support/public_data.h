#pragma once
#include <filesystem>
#include <string>

#include "tests/support/places.h"

namespace cotwin::places {

/// A measurement or model of a real robot (examples/public_data.md): in build/public_data if scripts/fetch_logs.py has fetched it, else in
/// shared(), where it may not exist.
inline std::string public_data(const std::string& file) {
  const std::string fetched = source() + "/build/public_data/" + file;
  return std::filesystem::exists(fetched) ? fetched : shared() + "/data/" + file;
}

}  // namespace cotwin::places
