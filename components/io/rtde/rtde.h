#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Universal Robots' Real-Time Data Exchange: packages, types, and the directory of quantities, as functions of bytes. Sockets and
/// clocks are elsewhere. A package is its size (2 bytes, with itself), its kind (1 byte) and its contents; all numbers are big-endian.
/// Client and controller agree on recipes, lists of names of quantities; data packages carry their values without names.
/// Source: UR, "Real-Time Data Exchange (RTDE)", manual SW 5 and SW 10; names and types also from the recipes in UR's client libraries.
namespace cotwin::rtde {

inline constexpr std::uint16_t kPort = 30004;
inline constexpr std::size_t kHeader = 3;         // bytes
inline constexpr std::size_t kMaxPackage = 8192;  // bytes that are read here; the largest data package has about 3000
inline constexpr std::size_t kMaxNames = 2048;    // bytes of the list of names in a setup, as UR's manual says
inline constexpr std::size_t kJoints = 6;
inline constexpr double kLargestNumber = 1e9;  // of what a robot measures and computes; more is no measurement

enum class Package : std::uint8_t {
  kRequestProtocol = 'V',
  kGetVersion = 'v',
  kText = 'M',
  kData = 'U',
  kSetupOutputs = 'O',
  kSetupInputs = 'I',
  kStart = 'S',
  kPause = 'P'
};

enum class Level : std::uint8_t { kException, kError, kWarning, kInfo };  // of a text message

enum class Type : std::uint8_t {
  kBool,
  kUint8,
  kUint32,
  kUint64,
  kInt32,
  kDouble,
  kVector3d,
  kVector6d,
  kVector6Int32,
  kVector6Uint32,
  kNotFound,  // in the reply to a setup: there is no such quantity
  kInUse      // likewise: another client writes it
};

std::string_view name_of(Type type);
std::optional<Type> type_of(std::string_view name);
std::size_t values_of(Type type);  // 1, 3 or 6; 0 of kNotFound, kInUse
std::size_t bytes_of(Type type);

/// A quantity that the controller gives, takes, or both (a register that a client writes and another one reads).
struct Field {
  std::string name;
  Type type = Type::kDouble;
  bool output = true, input = false;
  std::size_t slot = 0;  // of its first value among Values
  double largest = 0;    // absolute value that read_values() accepts
};

/// The values of all fields of a directory, integers as doubles: exact up to 2^53.
using Values = std::vector<double>;

/// The quantities of UR's documentation. Registers 24 to 47 and bits 64 to 127 are for clients of RTDE; the lower ones belong to field buses
/// but can be used.
class Directory {
 public:
  Directory();
  /// nullptr if there is no such field. Allocates nothing.
  const Field* find(std::string_view name) const;
  std::span<const Field> all() const { return fields_; }
  std::size_t slots() const { return slots_; }
  /// The first slot of a field that exists.
  std::size_t slot(std::string_view name) const { return find(name)->slot; }

 private:
  void add(std::string name, Type type, bool output, bool input);
  std::vector<Field> fields_;  // by name
  std::size_t slots_ = 0;
};

/// The fields of a data package, in their order.
class Recipe {
 public:
  Recipe() { fields_.reserve(kMaxFields); }
  static constexpr std::size_t kMaxFields = 512;  // a list of kMaxNames bytes has fewer
  void clear() { fields_.clear(), bytes_ = 0; }
  bool add(const Field& field);
  std::span<const Field* const> fields() const { return fields_; }
  std::size_t bytes() const { return bytes_; }
  bool has(const Field& field) const;

 private:
  std::vector<const Field*> fields_;
  std::size_t bytes_ = 0;
};

/// Writes the values of the recipe's fields; integers are limited to the range of their type. `to` has recipe.bytes().
void write_values(const Recipe& recipe, std::span<const double> values, std::uint8_t* to);

enum class Fault : std::uint8_t { kNone, kSize, kNotFinite };
/// Reads the values of the recipe's fields. With a fault, nothing is changed. kNotFinite is also a value beyond Field::largest:
/// kLargestNumber of doubles, except registers, whose meaning a program gives.
Fault read_values(const Recipe& recipe, std::span<const std::uint8_t> from, std::span<double> values);

/// Splits a byte stream into packages. Never holds more than kMaxPackage bytes.
class PackageReader {
 public:
  struct Raw {
    Package kind;
    std::span<const std::uint8_t> contents;  // until the next call of space()
  };

  PackageReader() : buffer_(kMaxPackage) {}
  void clear() { begin_ = end_ = 0, broken_ = false; }
  /// Where the next bytes of the stream go; empty if packages have to be taken first.
  std::span<std::uint8_t> space();
  void received(std::size_t bytes) { end_ += bytes; }
  /// The next whole package.
  std::optional<Raw> next();
  /// The package `offset` bytes after the next one to be taken, and the offset of the one after it; for a look ahead.
  std::optional<Raw> peek(std::size_t& offset) const;
  /// Whether the package at `offset` has a size that no package has.
  bool senseless(std::size_t offset) const;
  /// A size that no package has: the rest of the stream has no meaning.
  bool broken() const { return broken_; }
  std::size_t waiting() const { return end_ - begin_; }

 private:
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  mutable bool broken_ = false;
};

/// Packages that wait for the socket, whole ones only. Never holds more than kCapacity bytes.
class PackageWriter {
 public:
  static constexpr std::size_t kCapacity = 32'768;
  PackageWriter() : buffer_(kCapacity) {}
  void clear() { begin_ = end_ = 0; }
  /// Where the contents of a package of this size go; nullptr if there is no room: the package is lost.
  std::uint8_t* add(Package kind, std::size_t contents);
  bool add_flag(Package kind, bool flag);
  /// A text message; `version` of the protocol. Towards the client, version 1 has no source. At most 255 characters each.
  bool add_text(int version, bool to_client, std::string_view text, std::string_view source, Level level);
  std::span<const std::uint8_t> waiting() const { return {buffer_.data() + begin_, end_ - begin_}; }
  void sent(std::size_t bytes);

 private:
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;
};

}  // namespace cotwin::rtde
