#pragma once
#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

/// MCAP files as ROS 2 writes them, and damaged ones. Those of other writers are in tests/models/bag/files.
namespace cotwin::testing {

/// Appends little-endian values, CDR with the alignment to their size.
class Bytes {
 public:
  template <class T>
  Bytes& number(T value) {
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), &value, sizeof(T));
    bytes.append(raw.data(), sizeof(T));
    return *this;
  }
  Bytes& text(std::string_view words) {
    number(static_cast<std::uint32_t>(words.size()));
    bytes += words;
    return *this;
  }
  std::string bytes;
};

class Cdr : public Bytes {
 public:
  Cdr() { bytes.assign("\0\1\0\0", 4); }
  template <class T>
  Cdr& value(T x) {
    while ((bytes.size() - 4) % sizeof(T) != 0) bytes += '\0';
    number(x);
    return *this;
  }
  Cdr& word(std::string_view words) {
    value(static_cast<std::uint32_t>(words.size() + 1));
    bytes += words;
    bytes += '\0';
    return *this;
  }
  Cdr& reals(const std::vector<double>& all) {
    value(static_cast<std::uint32_t>(all.size()));
    for (const double x : all) value(x);
    return *this;
  }
};

/// A sensor_msgs/JointState with a stamp in ns.
inline std::string joint_state(std::int64_t stamp, const std::vector<std::string>& names, const std::vector<double>& q,
                               const std::vector<double>& dq, const std::vector<double>& tau) {
  Cdr message;
  message.value(static_cast<std::int32_t>(stamp / 1'000'000'000))
      .value(static_cast<std::uint32_t>(stamp % 1'000'000'000))
      .word("");
  message.value(static_cast<std::uint32_t>(names.size()));
  for (const std::string& name : names) message.word(name);
  return message.reals(q).reals(dq).reals(tau).bytes;
}

class McapWriter {
 public:
  explicit McapWriter(bool chunked = false) : chunked_(chunked) {}

  std::uint16_t channel(const std::string& topic, const std::string& type, const std::string& encoding = "cdr",
                        const std::string& definition = "") {
    const auto id = static_cast<std::uint16_t>(++channels_);
    add(3, Bytes().number(id).text(type).text(definition.empty() ? "ros2idl" : "ros2msg").text(definition).bytes);
    add(4, Bytes().number(id).number(id).text(topic).text(encoding).text("").bytes);
    return id;
  }
  void message(std::uint16_t channel, std::int64_t time, const std::string& data) {
    const auto t = static_cast<std::uint64_t>(time);
    add(5, Bytes().number(channel).number(std::uint32_t{0}).number(t).number(t).bytes + data);
  }
  /// Any record; in a chunk if this is chunked.
  void add(std::uint8_t opcode, const std::string& content) { (chunked_ ? chunk_ : data_) += record(opcode, content); }
  /// Ends the chunk. `size`: uncompressed, as it says.
  void end_chunk(std::uint32_t crc = 0, const std::string& compression = "", std::int64_t size = -1) {
    const auto of = static_cast<std::uint64_t>(size < 0 ? static_cast<std::int64_t>(chunk_.size()) : size);
    Bytes chunk;
    chunk.number(std::uint64_t{0}).number(std::uint64_t{0}).number(of).number(crc).text(compression);
    chunk.number(static_cast<std::uint64_t>(chunk_.size()));
    data_ += record(6, chunk.bytes + chunk_);
    chunk_.clear();
  }
  std::string file() const {
    const std::string magic("\x89MCAP0\r\n", 8);
    const std::string footer = Bytes().number(std::uint64_t{0}).number(std::uint64_t{0}).number(std::uint32_t{0}).bytes;
    return magic + record(1, Bytes().text("ros2").text("").bytes) + data_ + record(15, Bytes().number(std::uint32_t{0}).bytes) +
           record(2, footer) + magic;
  }

 private:
  static std::string record(std::uint8_t opcode, const std::string& content) {
    return static_cast<char>(opcode) + Bytes().number(static_cast<std::uint64_t>(content.size())).bytes + content;
  }

  bool chunked_;
  int channels_ = 0;
  std::string data_, chunk_;
};

}  // namespace cotwin::testing
