#include <algorithm>
#include <optional>

#include "models/bag/storage.h"
#include "models/foundation/database/database.h"

namespace cotwin::bag {

namespace {

class SqliteStorage final : public Storage {
 public:
  explicit SqliteStorage(const std::filesystem::path& file) : database_(file) {
    for (const char* table : {"topics", "messages"})
      if (!has_table(table))
        throw Error(file.string(),
                    std::string("an SQLite database without a table '") + table + "', expected a bag of rosbag2");
    const bool defined = has_table("message_definitions");
    database::Statement found = database_.query(
        defined ? "SELECT id, name, type, serialization_format, coalesce((SELECT encoding || char(10) || "
                  "encoded_message_definition FROM message_definitions "
                  "WHERE topic_type = topics.type AND encoded_message_definition <> '' LIMIT 1), '') FROM topics ORDER BY id"
                : "SELECT id, name, type, serialization_format, '' FROM topics ORDER BY id");
    while (found.step()) {
      Topic topic{found.text(1), found.text(2), "", ""};
      const std::string format = found.text(3), definition = found.text(4);
      if (format != "cdr") topic.trouble = "is serialised as '" + format + "', expected cdr: ros2 bag convert";
      if (definition.starts_with("ros2msg\n")) topic.definition = definition.substr(8);
      ids_.push_back(found.integer(0));
      topics_.push_back(std::move(topic));
    }
  }

  void scan(const Visit& visit) override {
    database::Statement all = database_.query("SELECT topic_id, timestamp, data FROM messages ORDER BY id");
    for (Message message; read(all, message);) visit(message);
  }

  void select(std::vector<bool> wanted) override {
    wanted_ = std::move(wanted);
    rows_.reset();
    rows_.emplace(database_.query("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"));
  }

  bool next(Message& message) override {
    while (read(*rows_, message))
      if (wanted_[message.topic]) return true;
    return false;
  }

 private:
  bool has_table(const std::string& name) {
    return database_.query("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?", name).step();
  }

  bool read(database::Statement& rows, Message& message) {
    if (!rows.step()) return false;
    const std::int64_t id = rows.integer(0);
    const auto found = std::ranges::find(ids_, id);
    if (found == ids_.end())
      throw Error(database_.file(), "a message of topic " + std::to_string(id) + ", which 'topics' does not have");
    message = {static_cast<std::size_t>(found - ids_.begin()), rows.integer(1), rows.bytes(2)};
    return true;
  }

  database::Database database_;
  std::vector<std::int64_t> ids_;  // of topics_
  std::vector<bool> wanted_;
  std::optional<database::Statement> rows_;
};

}  // namespace

std::unique_ptr<Storage> open_sqlite(const std::filesystem::path& file) { return std::make_unique<SqliteStorage>(file); }

}  // namespace cotwin::bag
