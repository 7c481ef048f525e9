#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace cotwin::bag {

/// A topic of a bag. Two publishers may have one each of the same name.
struct Topic {
  std::string name, type;  // "/joint_states", "sensor_msgs/msg/JointState"
  std::string definition;  // of the type, as ros2msg; "": none in the file
  std::string trouble;     // why its messages cannot be read, as the end of a sentence; "": they can
};

struct Message {
  std::size_t topic = 0;
  std::int64_t time = 0;            // ns, when it was recorded
  std::span<const std::byte> data;  // until the next one is read
};

/// The messages of a file. Throws Error `file: …` for what is damaged, cut short or not supported, and says what to do.
class Storage {
 public:
  using Visit = std::function<void(const Message&)>;

  virtual ~Storage() = default;
  /// All messages in the order of the file, once, before next(). Afterwards all of it has been checked.
  virtual void scan(const Visit& visit) = 0;
  const std::vector<Topic>& topics() const { return topics_; }  // so far
  /// Messages of `wanted` (by index) in the order of the log's time; false at the end.
  virtual void select(std::vector<bool> wanted) = 0;
  virtual bool next(Message& message) = 0;

 protected:
  std::vector<Topic> topics_;
};

/// rosbag2's SQLite, schema 1 to 4 (ros2/rosbag2, sqlite_storage.cpp).
std::unique_ptr<Storage> open_sqlite(const std::filesystem::path& file);
/// MCAP (github.com/foxglove/mcap, docs/specification), with or without an index.
std::unique_ptr<Storage> open_mcap(const std::filesystem::path& file);

/// The bytes of a chunk: `compression` is "", "lz4" or "zstd". Throws Error `place: …` for another one, for bytes that are damaged, and for another size than
/// `size`.
void decompress(const std::string& compression, std::span<const std::byte> bytes, std::vector<std::byte>& to, std::size_t size,
                const std::string& place);

/// Largest chunk or message, bytes.
inline constexpr std::uint64_t kLargest = std::uint64_t{48} << 20;

}  // namespace cotwin::bag
