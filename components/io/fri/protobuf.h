#pragma once
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>

#include "components/io/fri/fri.h"

/// The wire format of Protocol Buffers as far as FRI uses it: keys, varints, doubles and length-delimited fields. A key is
/// (field number << 3 | wire type).
namespace cotwin::fri::protobuf {

static_assert(std::endian::native == std::endian::little, "doubles are copied as they are in memory");

enum WireType : std::uint32_t { kVarint = 0, kFixed64 = 1, kLength = 2, kFixed32 = 5 };

/// Writes fields one after the other. After a write that does not fit, ok() is false and nothing more is written.
class Writer {
 public:
  explicit Writer(std::span<std::uint8_t> bytes) : begin_(bytes.data()), at_(begin_), end_(begin_ + bytes.size()) {}

  bool ok() const { return ok_; }
  std::size_t size() const { return static_cast<std::size_t>(at_ - begin_); }

  void varint(std::uint32_t field, std::uint64_t value) {
    key(field, kVarint);
    raw_varint(value);
  }
  /// A negative number has ten bytes, as the standard has it for int32.
  void integer(std::uint32_t field, std::int32_t value) {
    varint(field, static_cast<std::uint64_t>(static_cast<std::int64_t>(value)));
  }
  void real(std::uint32_t field, double value) {
    key(field, kFixed64);
    if (!room(sizeof value)) return;
    std::memcpy(at_, &value, sizeof value);
    at_ += sizeof value;
  }
  /// Each element with its key (not packed): decoders of nanopb 0.2.8 accept nothing else.
  void reals(std::uint32_t field, const double* values, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) real(field, values[i]);
  }
  void text(std::uint32_t field, std::string_view value) {
    key(field, kLength);
    raw_varint(value.size());
    if (!room(value.size())) return;
    if (!value.empty()) std::memcpy(at_, value.data(), value.size());
    at_ += value.size();
  }
  /// A message within the message: `content` writes its fields.
  template <class Content>
  void message(std::uint32_t field, Content&& content) {
    key(field, kLength);
    if (!room(1)) return;
    std::uint8_t* const length = at_++;
    content();
    if (!ok_) return;
    const std::size_t size = static_cast<std::size_t>(at_ - length) - 1;
    if (size < 0x80) {
      *length = static_cast<std::uint8_t>(size);
      return;
    }
    if (size > 0x3fff || !room(1)) {  // two bytes of length are enough for kMaxDatagram
      ok_ = false;
      return;
    }
    std::memmove(length + 2, length + 1, size);
    length[0] = static_cast<std::uint8_t>(size | 0x80);
    length[1] = static_cast<std::uint8_t>(size >> 7);
    ++at_;
  }

 private:
  void key(std::uint32_t field, WireType type) { raw_varint(field << 3 | type); }
  bool room(std::size_t n) {
    ok_ = ok_ && n <= static_cast<std::size_t>(end_ - at_);
    return ok_;
  }
  void raw_varint(std::uint64_t value) {
    do {
      if (!room(1)) return;
      const bool more = value >= 0x80;
      *at_++ = static_cast<std::uint8_t>((value & 0x7f) | (more ? 0x80u : 0u));
      value >>= 7;
    } while (value != 0);
  }

  std::uint8_t *begin_, *at_, *end_;
  bool ok_ = true;
};

/// Reads the fields of one message:
///   while (reader.next()) switch (reader.field()) { case 1: x = reader.varint(); break; default: reader.skip(); }
/// Every value must be read or skipped. After an error next() is false and fault() is the reason; values read then are 0.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : at_(bytes.data()), end_(at_ + bytes.size()) {}

  Fault fault() const { return fault_; }
  /// For an error of a message within this one, or of a value.
  void fail(Fault fault) {
    if (fault_ == Fault::kNone) fault_ = fault;
  }

  /// Goes to the next field.
  bool next() {
    if (fault_ != Fault::kNone || at_ == end_) return false;
    const std::uint64_t key = raw_varint();
    if (fault_ != Fault::kNone) return false;
    field_ = static_cast<std::uint32_t>(key >> 3);
    type_ = static_cast<std::uint32_t>(key & 7);
    if (key > 0xffffffff || field_ == 0) fail(Fault::kWireType);
    return fault_ == Fault::kNone;
  }
  std::uint32_t field() const { return field_; }

  std::uint64_t varint() { return is(kVarint) ? raw_varint() : 0; }
  std::uint32_t natural() { return static_cast<std::uint32_t>(varint()); }
  std::int32_t integer() { return static_cast<std::int32_t>(static_cast<std::uint32_t>(varint())); }
  double real() { return is(kFixed64) ? raw_real() : 0; }
  std::span<const std::uint8_t> bytes() { return is(kLength) ? raw_bytes() : std::span<const std::uint8_t>{}; }

  /// Appends the element or, if they are packed, the elements of the field to the `n` values read before.
  template <std::size_t N>
  void reals(std::array<double, N>& values, std::size_t& n) {
    if (type_ == kFixed64) {
      if (n >= N) return fail(Fault::kCount);
      values[n++] = raw_real();
      return;
    }
    const std::span<const std::uint8_t> packed = bytes();
    if (packed.size() % sizeof(double) != 0) return fail(Fault::kTruncated);
    if (packed.size() / sizeof(double) > N - n) return fail(Fault::kCount);
    if (packed.empty()) return;
    std::memcpy(&values[n], packed.data(), packed.size());
    n += packed.size() / sizeof(double);
  }

  /// Calls `add` with the number or, if they are packed, the numbers of the field.
  template <class Add>
  void numbers(Add&& add) {
    if (type_ == kVarint) return add(raw_varint());
    Reader packed(bytes());
    while (packed.fault_ == Fault::kNone && packed.at_ != packed.end_) add(packed.raw_varint());
    fail(packed.fault_);
  }

  /// Fields of unknown numbers. Groups, which FRI has never had, are an error.
  void skip() {
    switch (type_) {
      case kVarint:
        raw_varint();
        break;
      case kFixed64:
        advance(8);
        break;
      case kLength:
        raw_bytes();
        break;
      case kFixed32:
        advance(4);
        break;
      default:
        fail(Fault::kWireType);
    }
  }

 private:
  bool is(WireType type) {
    if (type_ != type) fail(Fault::kWireType);
    return fault_ == Fault::kNone;
  }
  bool advance(std::size_t n) {
    if (n > static_cast<std::size_t>(end_ - at_)) {
      fail(Fault::kTruncated);
      return false;
    }
    at_ += n;
    return true;
  }
  double raw_real() {
    double value = 0;
    if (advance(sizeof value)) std::memcpy(&value, at_ - sizeof value, sizeof value);
    return value;
  }
  std::span<const std::uint8_t> raw_bytes() {
    const std::uint64_t size = raw_varint();
    if (fault_ != Fault::kNone) return {};
    if (size > static_cast<std::uint64_t>(end_ - at_)) {
      fail(Fault::kTruncated);
      return {};
    }
    at_ += size;
    return {at_ - size, static_cast<std::size_t>(size)};
  }
  std::uint64_t raw_varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 70; shift += 7) {
      if (at_ == end_) {
        fail(Fault::kTruncated);
        return 0;
      }
      const std::uint64_t byte = *at_++;
      if (shift == 63 && byte > 1) break;  // more than 64 bits
      value |= (byte & 0x7f) << shift;
      if (byte < 0x80) return value;
    }
    fail(Fault::kWireType);
    return 0;
  }

  const std::uint8_t *at_, *end_;
  std::uint32_t field_ = 0, type_ = 0;
  Fault fault_ = Fault::kNone;
};

}  // namespace cotwin::fri::protobuf
