#pragma once
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>

namespace cotwin::master {

/// Packs numbers for the page of `cotwin view` (page/source/packed.ts unpacks them). Each list is a zlib stream of its own, so that the page
/// unpacks what it shows. A list of reals becomes either
///   steps   integers from 0 to 2²³, the steps from the least to the largest number: an error of at most 2⁻²⁴ of the range. Whole
///           numbers over a range of at most 2²³ are exact. Gaps (not finite numbers) are listed.
///   float   float32, an error of at most 2⁻²⁴ of each number: where a few numbers are far from the others, so that steps would be
///           too large for these, and where there are many gaps
/// or their differences, or second differences, whichever is shorter: low bytes of all numbers first, then the next ones.
class Packer {
 public:
  using Json = nlohmann::ordered_json;

  /// Returns the description of the stream (format.ts, Packed).
  Json add_reals(std::span<const double> values);
  /// Whole numbers of magnitude below 2⁵³.
  Json add_integers(std::span<const std::int64_t> values);
  /// The stream of these bytes: `at`, `size` and `count`, the number of bytes.
  Json add_bytes(std::string_view bytes);

  /// All streams as base64.
  std::string base64() const;

 private:
  std::string bytes_;
};

/// Base64 of bytes, with padding.
std::string to_base64(std::string_view bytes);

}  // namespace cotwin::master
