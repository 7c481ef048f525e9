#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <limits>
#include <map>
#include <string_view>
#include <utility>

#include "models/bag/storage.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::bag {

namespace {

using Bytes = std::span<const std::byte>;

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
enum Opcode : std::uint8_t { kFooter = 2, kSchema = 3, kChannel = 4, kMessage = 5, kChunk = 6, kAttachment = 9, kDataEnd = 15 };
constexpr std::size_t kHead = 9;                   // opcode and length of a record
constexpr std::uint64_t kMostHeld = 2 * kLargest;  // bytes of chunks whose times overlap

std::uint32_t crc_of(Bytes bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

/// Reads the members of a record. Throws Error instead of reading past its end.
class Fields {
 public:
  Fields(Bytes bytes, const std::string& place) : bytes_(bytes), place_(place) {}

  template <class T>
  T number() {
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  Bytes take(std::uint64_t count) {
    if (count > bytes_.size()) throw Error(place_, "a record that is shorter than what it holds, expected an intact MCAP file");
    const Bytes taken = bytes_.first(static_cast<std::size_t>(count));
    bytes_ = bytes_.subspan(static_cast<std::size_t>(count));
    return taken;
  }
  std::string text() {
    const Bytes taken = take(number<std::uint32_t>());
    return {reinterpret_cast<const char*>(taken.data()), taken.size()};
  }
  Bytes rest() const { return bytes_; }

 private:
  Bytes bytes_;
  const std::string& place_;
};

class McapStorage final : public Storage {
 public:
  explicit McapStorage(const std::filesystem::path& file)
      : place_(file.string()), file_(text::open_file(file, "an MCAP file")), size_(std::filesystem::file_size(file)) {
    if (size_ < kMagic.size() || !is_magic(read(0, kMagic.size(), body_)))
      throw Error(place_, "does not begin as MCAP of version 0");
  }

  void scan(const Visit& visit) override {
    std::uint64_t at = kMagic.size();
    std::uint32_t crc = crc_of(read(0, at, body_));
    bool whole = true;  // all bytes are in `crc`
    for (std::uint64_t length = 0;; at += kHead + length) {
      const Bytes head = read(at, kHead, head_);
      const auto opcode = std::to_integer<std::uint8_t>(head[0]);
      length = Fields(head.subspan(1), place_).number<std::uint64_t>();
      if (length > size_) cut();
      if (opcode == kAttachment) {
        whole = false;
        continue;
      }
      const Bytes content = body_of(at, length);
      if (opcode == kDataEnd || opcode == kFooter) {
        const auto expected = opcode == kDataEnd ? Fields(content, place_).number<std::uint32_t>() : 0;
        if (whole && expected != 0 && expected != crc)
          throw Error(place_, "the CRC of its data is another than their end says, expected an intact file");
        break;
      }
      crc = crc_of(content, crc_of(head, crc));
      if (opcode == kChunk) {
        unpack(content, unpacked_);
        std::int64_t begin = kNever;
        each_record(unpacked_, [&](std::uint8_t kind, Bytes record, std::size_t) {
          if (kind != kMessage) return declare(kind, record);
          const Message message = message_of(record);
          begin = std::min(begin, message.time);
          visit(message);
        });
        if (begin != kNever) chunks_.emplace_back(begin, at);
      } else if (opcode == kMessage) {
        const Message message = message_of(content);
        loose_.emplace_back(message.time, at);
        visit(message);
      } else {
        declare(opcode, content);
      }
    }
    if (size_ < 2 * kMagic.size() || !is_magic(read(size_ - kMagic.size(), kMagic.size(), head_))) cut();
    std::ranges::stable_sort(chunks_, {}, &Entry::first);
    std::ranges::stable_sort(loose_, {}, &Entry::first);
  }

  void select(std::vector<bool> wanted) override {
    wanted_ = std::move(wanted);
    next_chunk_ = next_loose_ = 0;
    held_.clear();
  }

  bool next(Message& message) override {
    for (;;) {
      std::erase_if(held_, [](const Held& held) { return held.next == held.order.size(); });
      // The chunk with the earliest message, of those that may have one before the next loose message.
      const auto chunk = std::ranges::min_element(held_, {}, &Held::time);
      const std::int64_t of_chunk = chunk != held_.end() ? chunk->time() : kNever;
      const std::int64_t of_loose = next_loose_ < loose_.size() ? loose_[next_loose_].first : kNever;
      if (next_chunk_ < chunks_.size() && chunks_[next_chunk_].first <= std::min(of_chunk, of_loose)) {
        hold(chunks_[next_chunk_++].second);
      } else if (chunk != held_.end() && of_chunk <= of_loose) {
        Fields record(Bytes(chunk->bytes).subspan(chunk->order[chunk->next++].second), place_);
        message = message_of(record.take(record.number<std::uint64_t>()));
        return true;
      } else if (next_loose_ < loose_.size()) {
        const std::uint64_t at = loose_[next_loose_++].second;
        const auto length = Fields(read(at, kHead, head_).subspan(1), place_).number<std::uint64_t>();
        message = message_of(body_of(at, length));
        if (wanted_[message.topic]) return true;
      } else {
        return false;
      }
    }
  }

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  using Entry = std::pair<std::int64_t, std::uint64_t>;  // the first time of a chunk, or that of a message; its place

  /// A chunk that is being read.
  struct Held {
    std::vector<std::byte> bytes;
    std::vector<Entry> order;  // of its wanted messages
    std::size_t next = 0;
    std::int64_t time() const { return order[next].first; }
  };
  struct Schema {
    std::string name, encoding, text;
  };

  [[noreturn]] void cut() const {
    throw Error(place_, "ends before its data do, as a recording that was cut off: 'mcap recover' keeps what is whole");
  }
  static bool is_magic(Bytes bytes) { return std::ranges::equal(bytes, std::as_bytes(std::span(kMagic))); }

  Bytes read(std::uint64_t at, std::uint64_t count, std::vector<std::byte>& to) {
    if (at > size_ || count > size_ - at) cut();
    to.resize(static_cast<std::size_t>(count));
    if (at != position_ && fseeko(file_.get(), static_cast<off_t>(at), SEEK_SET) != 0) throw Error(place_, "reading failed");
    if (std::fread(to.data(), 1, to.size(), file_.get()) != to.size()) throw Error(place_, "reading failed");
    position_ = at + count;
    return to;
  }

  Bytes body_of(std::uint64_t at, std::uint64_t length) {
    if (length > kLargest)
      throw Error(place_, "a record of " + std::to_string(length) + " bytes, expected at most " + std::to_string(kLargest) +
                              ": ros2 bag convert with a smaller chunkSize");
    return read(at + kHead, length, body_);
  }

  /// Calls `each` with the opcode and the content of all records of a chunk, and the place of their lengths.
  template <class Each>
  void each_record(Bytes records, Each each) const {
    for (std::size_t at = 0; at < records.size();) {
      Fields record(records.subspan(at), place_);
      const auto opcode = record.number<std::uint8_t>();
      const Bytes content = record.take(record.number<std::uint64_t>());
      each(opcode, content, at + 1);
      at += kHead + content.size();
    }
  }

  void unpack(Bytes content, std::vector<std::byte>& to) const {
    Fields chunk(content, place_);
    chunk.take(2 * sizeof(std::uint64_t));  // times
    const auto size = chunk.number<std::uint64_t>();
    const auto crc = chunk.number<std::uint32_t>();
    const std::string compression = chunk.text();
    const Bytes records = chunk.take(chunk.number<std::uint64_t>());
    decompress(compression, records, to, size, place_);
    if (crc != 0 && crc != crc_of(to))
      throw Error(place_, "a chunk whose CRC is another than it says, expected an intact file");
  }

  /// Schemas and channels.
  void declare(std::uint8_t opcode, Bytes content) {
    Fields record(content, place_);
    if (opcode == kSchema) {
      const auto id = record.number<std::uint16_t>();
      Schema schema{record.text(), record.text(), record.text()};
      constexpr std::size_t kMostText = 1 << 20;  // of all definitions
      defined_ += schema.text.size();
      if (defined_ > kMostText) schema.text.clear();
      schemas_.try_emplace(id, std::move(schema));
    } else if (opcode == kChannel) {
      const auto id = record.number<std::uint16_t>(), of = record.number<std::uint16_t>();
      const std::string name = record.text(), encoding = record.text();
      if (!channels_.try_emplace(id, topics_.size()).second) return;
      const auto schema = schemas_.find(of);
      Topic topic{name, schema != schemas_.end() ? schema->second.name : "", "", ""};
      if (schema != schemas_.end() && schema->second.encoding == "ros2msg") topic.definition = schema->second.text;
      if (encoding != "cdr")
        topic.trouble = "is encoded as '" + encoding + "', expected cdr" + (encoding == "ros1" ? ": rosbags-convert" : "");
      topics_.push_back(std::move(topic));
    }
  }

  Message message_of(Bytes content) const {
    Fields record(content, place_);
    const auto channel = channels_.find(record.number<std::uint16_t>());
    if (channel == channels_.end()) throw Error(place_, "a message of a channel that is not declared, expected an intact file");
    record.take(sizeof(std::uint32_t));  // sequence
    const auto time = static_cast<std::int64_t>(record.number<std::uint64_t>());
    record.take(sizeof(std::uint64_t));  // of publication
    return {channel->second, time, record.rest()};
  }

  void hold(std::uint64_t at) {
    const auto length = Fields(read(at, kHead, head_).subspan(1), place_).number<std::uint64_t>();
    Held& held = held_.emplace_back();
    unpack(body_of(at, length), held.bytes);
    std::uint64_t bytes = 0;
    for (const Held& one : held_) bytes += one.bytes.size();
    if (bytes > kMostHeld)
      throw Error(place_,
                  "chunks of more than " + std::to_string(kMostHeld) + " bytes at the same time: sort it with 'mcap sort'");
    each_record(held.bytes, [&](std::uint8_t opcode, Bytes record, std::size_t place) {
      if (opcode != kMessage) return;
      const Message message = message_of(record);
      if (wanted_[message.topic]) held.order.emplace_back(message.time, place);
    });
    std::ranges::stable_sort(held.order, {}, &Entry::first);
  }

  std::string place_;
  text::File file_;
  std::uint64_t size_ = 0, position_ = 0;
  std::size_t defined_ = 0;  // bytes of the definitions so far
  std::vector<std::byte> head_, body_, unpacked_;
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, std::size_t> channels_;  // index in topics_
  std::vector<Entry> chunks_, loose_;
  std::vector<bool> wanted_;
  std::size_t next_chunk_ = 0, next_loose_ = 0;
  std::vector<Held> held_;
};

}  // namespace

std::unique_ptr<Storage> open_mcap(const std::filesystem::path& file) { return std::make_unique<McapStorage>(file); }

}  // namespace cotwin::bag
