#include "components/unit/snapshot.h"

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"

namespace cotwin {

namespace {

constexpr std::uint64_t kMagic = 0x3250414e53575443u;  // the bytes "CTWSNAP2": the format and its version

}  // namespace

void Snapshot::take(const Variables& variables, Unit& unit) {
  copy_values(variables);
  unit.save_memory(memory_);
}

void Snapshot::take(const Variables& variables) {
  copy_values(variables);
  memory_.clear();
}

void Snapshot::copy_values(const Variables& variables) {
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

std::string Snapshot::serialise() const {
  ByteWriter out;
  out.value(kMagic);
  out.value(fingerprint_);
  out.list(reals_);
  out.list(integers_);
  out.list(booleans_);
  out.value(std::uint64_t{strings_.size()});
  for (const std::string& s : strings_) out.text(s);
  out.text(memory_);
  return out.take();
}

Snapshot Snapshot::deserialise(std::string_view bytes) {
  ByteReader in(as_bytes(bytes), "snapshot");
  if (in.value<std::uint64_t>() != kMagic) in.fail("is not of this version");
  Snapshot snapshot;
  snapshot.fingerprint_ = in.value<std::uint64_t>();
  snapshot.reals_ = in.list<double>();
  snapshot.integers_ = in.list<std::int32_t>();
  snapshot.booleans_ = in.list<std::uint8_t>();
  snapshot.strings_.resize(in.count(sizeof(std::uint64_t)));
  for (std::string& s : snapshot.strings_) s = in.text();
  snapshot.memory_ = in.text();
  in.expect_end();
  return snapshot;
}

}  // namespace cotwin
