#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/io/ethercat/coe.h"

/// The slave's side of CoE: an object dictionary and the answers to SDO requests.
namespace cotwin::ethercat {

/// Data types of objects (ETG.1000.6, section 5.6.7).
namespace object_type {
inline constexpr std::uint16_t kBool = 1, kI8 = 2, kI16 = 3, kI32 = 4, kU8 = 5, kU16 = 6, kU32 = 7, kText = 9;
}

struct ObjectEntry {
  std::uint16_t index = 0;
  std::uint8_t subindex = 0;
  bool writable = false;
  std::uint16_t type = object_type::kU8;
  std::uint16_t bits = 8;
  std::size_t value = 0;  // offset of the value's bytes
  std::string name;

  std::size_t bytes() const { return (bits + 7u) / 8; }
};

/// Objects with their values, sorted by index and subindex.
class ObjectDictionary {
 public:
  void add(std::uint16_t index, std::uint8_t subindex, const std::string& name, std::uint16_t type, std::uint16_t bits,
           std::uint64_t value, bool writable = false);
  void add_text(std::uint16_t index, std::uint8_t subindex, const std::string& name, const std::string& value,
                bool writable = false);

  bool has(std::uint16_t index) const;
  const ObjectEntry* find(std::uint16_t index, std::uint8_t subindex) const;
  std::span<std::uint8_t> bytes(const ObjectEntry& e) { return std::span(values_).subspan(e.value, e.bytes()); }
  std::span<const std::uint8_t> bytes(const ObjectEntry& e) const { return std::span(values_).subspan(e.value, e.bytes()); }
  /// The value of an entry of at most 8 bytes; 0 if it does not exist.
  std::uint64_t number(std::uint16_t index, std::uint8_t subindex) const;
  void set_number(std::uint16_t index, std::uint8_t subindex, std::uint64_t value);
  std::span<const ObjectEntry> entries() const { return entries_; }
  /// Sets all values to those that were added.
  void restore() { values_ = initial_; }

 private:
  void insert(ObjectEntry e, std::span<const std::uint8_t> value);

  std::vector<ObjectEntry> entries_;
  std::vector<std::uint8_t> values_, initial_;
};

/// The application behind an object dictionary.
class ObjectOwner {
 public:
  virtual ~ObjectOwner() = default;
  /// Brings the value of an entry up to date before it is read.
  virtual void refresh(const ObjectEntry& entry) = 0;
  /// Decides about a download before the value changes.
  virtual SdoAbort check(const ObjectEntry& entry, std::span<const std::uint8_t> value) = 0;
};

/// Answers the SDO requests and SDO information requests of a master. Allocates in the constructor only.
class CoeServer {
 public:
  /// `out`, `in`: bytes of the mailboxes that the master writes and reads, at least 16. `largest`: of a downloaded value, bytes.
  CoeServer(ObjectDictionary& objects, ObjectOwner& owner, std::size_t out, std::size_t in, std::size_t largest = 4096);

  /// The answer to a mail; empty: none. Valid until the next call. A mail with the counter of the last one is that one again, sent by a
  /// master that missed the answer of the bus: it is dropped. (The master gets a lost answer again by the sync manager's repeat bit.)
  std::span<const std::uint8_t> answer(std::span<const std::uint8_t> mail);
  /// The next part of an answer that is longer than a mailbox; empty: none.
  std::span<const std::uint8_t> next_part();
  /// Ends a transfer in progress.
  void reset();

 private:
  using Content = std::span<const std::uint8_t>;
  enum class Transfer : std::uint8_t { kNone, kUpload, kDownload };

  std::span<const std::uint8_t> send(CoeService service, std::size_t size);
  std::span<const std::uint8_t> mail_error(std::uint16_t detail);
  std::span<const std::uint8_t> abort(std::uint16_t index, std::uint8_t subindex, SdoAbort code);
  std::span<const std::uint8_t> upload(Content request);
  std::span<const std::uint8_t> upload_segment(Content request);
  std::span<const std::uint8_t> download(Content request);
  std::span<const std::uint8_t> download_segment(Content request);
  std::span<const std::uint8_t> finish_download();
  std::span<const std::uint8_t> information(Content request);
  std::span<const std::uint8_t> object_list(std::uint16_t list);
  std::span<const std::uint8_t> information_error(SdoAbort code);
  SdoAbort access(std::uint16_t index, std::uint8_t subindex, std::uint8_t command, const ObjectEntry*& entry) const;

  ObjectDictionary& objects_;
  ObjectOwner& owner_;
  std::size_t in_;
  std::vector<std::uint8_t> reply_, data_;
  std::span<std::uint8_t> content_;  // of reply_, after the CoE header
  std::uint8_t counter_ = 0;
  std::uint8_t heard_ = 0;  // counter of the last mail
  Transfer transfer_ = Transfer::kNone;
  std::uint16_t index_ = 0;
  std::uint8_t subindex_ = 0, toggle_ = 0;
  std::size_t size_ = 0, done_ = 0;
  std::size_t listed_ = 0, to_list_ = 0;  // indices of an object list that were sent, all of them
};

}  // namespace cotwin::ethercat
