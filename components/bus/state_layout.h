#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace cotwin::bus {

/// A vector of a state database.
struct StateField {
  enum class Kind : std::uint8_t { kReal, kInteger, kBoolean };  // 8, 4 and 1 bytes per element

  std::string name;
  Kind kind = Kind::kReal;
  std::size_t size = 1;  // elements
  std::string si = "1";  // unit of measure of a real

  friend bool operator==(const StateField&, const StateField&) = default;
};

/// The fields of a state database and their places in its image: little-endian, one after the other, each at a multiple of 8 bytes,
/// with zeros between them. Two programs exchange states only if their layouts have the same text.
class StateLayout {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 24;

  /// Throws Error for doubled or empty names, sizes of 0 and more than kMaxBytes.
  explicit StateLayout(std::vector<StateField> fields);
  /// Reads "q:7:rad,dq:7:rad/s,gain,mode:1:integer,contact:4:boolean": name, size (1) and unit of measure (1), `integer` or
  /// `boolean`. Throws Error `place: …`. Does not check units of measure.
  static StateLayout parse(std::string_view text, const std::string& place);

  const std::vector<StateField>& fields() const { return fields_; }
  std::size_t offset(std::size_t field) const { return offsets_[field]; }
  /// Of the image; a multiple of 8.
  std::size_t bytes() const { return bytes_; }
  /// What parse() reads.
  const std::string& text() const { return text_; }
  /// Of the text.
  std::uint64_t hash() const { return hash_; }

 private:
  std::vector<StateField> fields_;
  std::vector<std::size_t> offsets_;
  std::size_t bytes_ = 0;
  std::string text_;
  std::uint64_t hash_ = 0;
};

}  // namespace cotwin::bus
