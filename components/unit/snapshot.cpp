#include "components/unit/snapshot.h"

#include <bit>
#include <cstring>
#include <limits>

#include "models/support/error.h"

namespace cotwin {

namespace {

constexpr std::uint64_t kMagic = 0x3250414e53575443u;  // the bytes "CTWSNAP2": the format and its version

static_assert(std::endian::native == std::endian::little, "the byte string is little-endian");

class Writer {
 public:
  template <class T>
  void value(const T& v) {
    const auto* bytes = reinterpret_cast<const std::byte*>(&v);
    out_.insert(out_.end(), bytes, bytes + sizeof v);
  }
  template <class T>
  void list(const std::vector<T>& values) {
    value(static_cast<std::uint64_t>(values.size()));
    const auto* bytes = reinterpret_cast<const std::byte*>(values.data());
    out_.insert(out_.end(), bytes, bytes + values.size() * sizeof(T));
  }
  std::vector<std::byte> take() { return std::move(out_); }

 private:
  std::vector<std::byte> out_;
};

class Reader {
 public:
  explicit Reader(std::span<const std::byte> in) : in_(in) {}
  template <class T>
  T value() {
    T v;
    std::memcpy(&v, take(sizeof v), sizeof v);
    return v;
  }
  /// A length that the rest of the bytes can hold at `element_size` each.
  std::size_t length(std::size_t element_size) {
    const auto n = value<std::uint64_t>();
    if (n > in_.size() / element_size)
      throw Error("snapshot", "cut short or damaged: a list of " + std::to_string(n) + " elements");
    return static_cast<std::size_t>(n);
  }
  template <class T>
  std::vector<T> list() {
    std::vector<T> values(length(sizeof(T)));
    if (!values.empty()) std::memcpy(values.data(), take(values.size() * sizeof(T)), values.size() * sizeof(T));
    return values;
  }
  bool at_end() const { return in_.empty(); }

 private:
  const std::byte* take(std::size_t n) {
    if (n > in_.size()) throw Error("snapshot", "cut short: " + std::to_string(n - in_.size()) + " bytes are missing");
    const std::byte* begin = in_.data();
    in_ = in_.subspan(n);
    return begin;
  }
  std::span<const std::byte> in_;
};

}  // namespace

void Snapshot::take(const Variables& variables, Unit& unit) {
  take(variables);
  unit.save_memory(memory_);
}

void Snapshot::take(const Variables& variables) {
  fingerprint_ = variables.fingerprint();
  reals_.clear();
  integers_.clear();
  booleans_.clear();
  std::size_t strings = 0;
  for (const Variable& variable : variables) {
    switch (variable.kind()) {
      case Kind::kReal:
        reals_.insert(reals_.end(), variable.reals().begin(), variable.reals().end());
        reals_.insert(reals_.end(), variable.rate.begin(), variable.rate.end());
        break;
      case Kind::kInteger:
        integers_.insert(integers_.end(), variable.integers().begin(), variable.integers().end());
        break;
      case Kind::kBoolean:
        for (const bool b : variable.booleans()) booleans_.push_back(b ? 1 : 0);
        break;
      case Kind::kString:
        for (const std::string& s : variable.strings()) {
          if (strings == strings_.size()) strings_.emplace_back();
          strings_[strings++] = s;  // keeps the capacity of the last snapshot
        }
        break;
    }
  }
  strings_.resize(strings);
  memory_.clear();
}

void Snapshot::restore(const Variables& variables, Unit& unit) const {
  write(variables);
  unit.restore_memory(memory_);
  unit.restored();
}

void Snapshot::write(const Variables& variables) const {
  std::size_t reals = 0, integers = 0, booleans = 0, strings = 0;
  for (const Variable& variable : variables) {
    switch (variable.kind()) {
      case Kind::kReal:
        reals += variable.size() + variable.rate.size();
        break;
      case Kind::kInteger:
        integers += variable.size();
        break;
      case Kind::kBoolean:
        booleans += variable.size();
        break;
      case Kind::kString:
        strings += variable.size();
        break;
    }
  }
  if (fingerprint_ != variables.fingerprint() || reals != reals_.size() || integers != integers_.size() ||
      booleans != booleans_.size() || strings != strings_.size()) {
    throw Error("snapshot", "taken from a unit with other variables");
  }
  const double* real = reals_.data();
  const std::int32_t* integer = integers_.data();
  const std::uint8_t* boolean = booleans_.data();
  const std::string* string = strings_.data();
  for (const Variable& variable : variables) {
    switch (variable.kind()) {
      case Kind::kReal:
        for (double& value : variable.reals()) value = *real++;
        for (double& value : variable.rate) value = *real++;
        break;
      case Kind::kInteger:
        for (std::int32_t& value : variable.integers()) value = *integer++;
        break;
      case Kind::kBoolean:
        for (bool& value : variable.booleans()) value = *boolean++ != 0;
        break;
      case Kind::kString:
        for (std::string& value : variable.strings()) value = *string++;
        break;
    }
  }
}

std::vector<std::byte> Snapshot::serialise() const {
  Writer out;
  out.value(kMagic);
  out.value(fingerprint_);
  out.list(reals_);
  out.list(integers_);
  out.list(booleans_);
  out.value(static_cast<std::uint64_t>(strings_.size()));
  for (const std::string& s : strings_) out.list(std::vector<char>(s.begin(), s.end()));
  out.list(std::vector<char>(memory_.begin(), memory_.end()));
  return out.take();
}

Snapshot Snapshot::deserialise(std::span<const std::byte> bytes) {
  Reader in(bytes);
  if (in.value<std::uint64_t>() != kMagic) throw Error("snapshot", "these bytes are no snapshot of this version");
  Snapshot snapshot;
  snapshot.fingerprint_ = in.value<std::uint64_t>();
  snapshot.reals_ = in.list<double>();
  snapshot.integers_ = in.list<std::int32_t>();
  snapshot.booleans_ = in.list<std::uint8_t>();
  snapshot.strings_.resize(in.length(sizeof(std::uint64_t)));
  for (std::string& s : snapshot.strings_) {
    const std::vector<char> characters = in.list<char>();
    s.assign(characters.begin(), characters.end());
  }
  const std::vector<char> memory = in.list<char>();
  snapshot.memory_.assign(memory.begin(), memory.end());
  if (!in.at_end()) throw Error("snapshot", "bytes follow its end");
  return snapshot;
}

}  // namespace cotwin
