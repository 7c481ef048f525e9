#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "models/foundation/support/error.h"

struct sqlite3;
struct sqlite3_stmt;

/// SQLite behind values and exceptions. Not thread-safe.
namespace cotwin::database {

using UtcTime = std::chrono::sys_time<std::chrono::milliseconds>;

/// A statement of SQLite failed: disk full, file damaged, no permission.
class DatabaseError : public Error {
 public:
  using Error::Error;
};

/// Another process owns a database.
class InUse : public Error {
 public:
  using Error::Error;
};

/// A file that one process at a time may own: <database>.owner. The kernel releases it when the process ends, however it ends.
class OwnerLock {
 public:
  /// Throws InUse, which names the database and the process that owns it, or Error.
  explicit OwnerLock(const std::filesystem::path& database);
  ~OwnerLock();
  OwnerLock(const OwnerLock&) = delete;
  OwnerLock& operator=(const OwnerLock&) = delete;

 private:
  int descriptor_ = -1;
};

/// A prepared statement with its values, until it is destroyed.
class Statement {
 public:
  Statement(sqlite3* database, sqlite3_stmt* statement, const std::string& file)
      : database_(database), statement_(statement), file_(&file) {}
  Statement(Statement&& other) noexcept
      : database_(other.database_),
        statement_(std::exchange(other.statement_, nullptr)),
        file_(other.file_),
        next_(other.next_) {}
  Statement& operator=(Statement&&) = delete;
  ~Statement();

  void bind(std::int64_t value);
  void bind(int value) { bind(static_cast<std::int64_t>(value)); }
  void bind(bool value) { bind(static_cast<std::int64_t>(value)); }
  void bind(double value);
  void bind(std::string_view value);  // must live as long as the statement
  void bind(const std::string& value) { bind(std::string_view(value)); }
  void bind(const char* value) { bind(std::string_view(value)); }
  void bind(UtcTime value) { bind(static_cast<std::int64_t>(value.time_since_epoch().count())); }
  void bind(std::nullopt_t);
  template <class Value>
  void bind(const std::optional<Value>& value) {
    if (value) {
      bind(*value);
    } else {
      bind(std::nullopt);
    }
  }

  /// False: no further row.
  bool step();
  std::int64_t integer(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  std::span<const std::byte> bytes(int column) const;  // until the next step()
  UtcTime time(int column) const { return UtcTime(std::chrono::milliseconds(integer(column))); }
  bool is_null(int column) const;
  bool is_real(int column) const;
  std::optional<UtcTime> optional_time(int column) const {
    return is_null(column) ? std::nullopt : std::optional<UtcTime>(time(column));
  }

 private:
  sqlite3* database_;
  sqlite3_stmt* statement_;
  const std::string* file_;
  int next_ = 1;
};

/// What a database is for, and its tables.
struct Purpose {
  std::int32_t application;  // application_id of the file
  const char* what;          // "one of jobs", for messages
  std::int32_t version;      // of the tables
  std::string schema;        // statements that create them; empty: there must be tables
  std::string upgrade{};     // statements that make them of those of the version before
};

class Database {
 public:
  /// Opens or creates the file, in WAL mode. `check`: reads all of it first. Throws Error if it is damaged, of another program or a
  /// newer version, or cannot be written.
  Database(const std::filesystem::path& file, const Purpose& purpose, bool check = true);
  /// Opens a file of another program to read it, with what is in a write-ahead log beside it. Throws Error if there is none or it is no database.
  explicit Database(const std::filesystem::path& file);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  template <class... Values>
  Statement query(const std::string& sql, const Values&... values) {
    Statement statement = prepare(sql);
    (statement.bind(values), ...);
    return statement;
  }
  template <class... Values>
  void run(const std::string& sql, const Values&... values) {
    Statement statement = query(sql, values...);
    while (statement.step()) continue;
  }
  void execute(const char* sql);
  std::int64_t last_row() const;
  const std::string& file() const { return file_; }

 private:
  Statement prepare(const std::string& sql);
  void open(const Purpose& purpose, bool check);
  void open_to_read();

  std::string file_;
  sqlite3* database_ = nullptr;
  std::map<std::string, sqlite3_stmt*, std::less<>> statements_;
};

/// BEGIN IMMEDIATE until commit(); otherwise rolled back. `durable`: commit() returns when the disk has the data, so that they
/// survive a loss of power too; otherwise they survive the end of the process.
class Transaction {
 public:
  Transaction(Database& database, bool durable);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Database& database_;
  bool done_ = false;
};

}  // namespace cotwin::database
