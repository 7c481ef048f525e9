#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/unit.h"

namespace cotwin {

/// The values of all variables of a unit at one instant: plain data, independent of the unit it was taken from.
class Snapshot {
 public:
  /// Copies the values alone, such as start values. Allocates only the first time (and where strings grow).
  void take(const Variables& variables);
  /// Copies the values, and what the unit keeps outside its variables (Unit::save_memory).
  void take(const Variables& variables, Unit& unit);
  /// Writes the values back and calls the unit's restore_memory() and restored(). Throws Error if the layout of `variables` is
  /// not that of the snapshot.
  void restore(const Variables& variables, Unit& unit) const;

  /// Writes only the values, for a unit that is initialised afterwards. Throws Error as restore.
  void write(const Variables& variables) const;

  /// A self-describing byte string (version, fingerprint, values; little-endian), which a new instance of the same unit can
  /// restore.
  std::string serialise() const;
  /// Throws Error for bytes that are not a snapshot, are truncated, or have another version.
  static Snapshot deserialise(std::string_view bytes);

  bool empty() const { return fingerprint_ == 0; }
  friend bool operator==(const Snapshot&, const Snapshot&) = default;

 private:
  void copy_values(const Variables& variables);

  std::uint64_t fingerprint_ = 0;
  std::vector<double> reals_;
  std::vector<std::int32_t> integers_;
  std::vector<std::uint8_t> booleans_;
  std::vector<std::string> strings_;
  std::string memory_;  // of Unit::save_memory
};

}  // namespace cotwin
