#include "models/foundation/database/database.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/file.h"

namespace cotwin::database {

namespace {

constexpr int kBusy_ms = 2000;  // for a reader such as the program sqlite3 that holds a lock

[[noreturn]] void fail(sqlite3* database, const std::string& file) {
  const int code = sqlite3_extended_errcode(database);
  std::string reason = sqlite3_errmsg(database);
  if (const int number = sqlite3_system_errno(database); (code & 0xff) != SQLITE_CORRUPT && number != 0)
    reason += " (" + system_reason(number) + ")";
  throw DatabaseError(file, reason);
}

/// The name of this program, for the message in another process.
std::string name_of_this_process() {
  std::string name;
  std::getline(std::ifstream("/proc/self/comm"), name);
  return name;
}

}  // namespace

OwnerLock::OwnerLock(const std::filesystem::path& database) {
  const std::string file = database.string() + ".owner";
  descriptor_ = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (descriptor_ < 0) throw Error(file, "cannot be written: " + system_reason(errno));
  if (flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    std::array<char, 200> owner{};
    const ssize_t n = pread(descriptor_, owner.data(), owner.size() - 1, 0);
    close(descriptor_);
    if (error != EWOULDBLOCK) throw Error(file, "cannot be locked: " + system_reason(error));
    std::string who(owner.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
    if (const std::size_t end = who.find('\n'); end != std::string::npos) who.resize(end);
    throw InUse(database.string(), "is in use by process " + (who.empty() ? "(unknown)" : who) +
                                       ", expected a database that no other process has open");
  }
  std::string who = std::to_string(getpid());
  if (const std::string name = name_of_this_process(); !name.empty()) who += " (" + name + ")";
  who += "\n";
  // The text is for messages only: the lock does not depend on it.
  if (ftruncate(descriptor_, 0) == 0) static_cast<void>(!pwrite(descriptor_, who.data(), who.size(), 0));
}

OwnerLock::~OwnerLock() { close(descriptor_); }

Statement::~Statement() {
  if (statement_ == nullptr) return;
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
}

void Statement::bind(std::int64_t value) { sqlite3_bind_int64(statement_, next_++, value); }
void Statement::bind(double value) { sqlite3_bind_double(statement_, next_++, value); }
void Statement::bind(std::string_view value) {
  sqlite3_bind_text64(statement_, next_++, value.empty() ? "" : value.data(), value.size(), SQLITE_STATIC, SQLITE_UTF8);
}
void Statement::bind(std::nullopt_t) { sqlite3_bind_null(statement_, next_++); }

bool Statement::step() {
  switch (sqlite3_step(statement_)) {
    case SQLITE_ROW:
      return true;
    case SQLITE_DONE:
      return false;
    default:
      fail(database_, *file_);
  }
}

std::int64_t Statement::integer(int column) const { return sqlite3_column_int64(statement_, column); }
double Statement::real(int column) const { return sqlite3_column_double(statement_, column); }
bool Statement::is_real(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_FLOAT; }
bool Statement::is_null(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }

std::string Statement::text(int column) const {
  const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  return bytes == nullptr ? std::string()
                          : std::string(bytes, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
}

std::span<const std::byte> Statement::bytes(int column) const {
  const auto* const first = static_cast<const std::byte*>(sqlite3_column_blob(statement_, column));
  return {first, first == nullptr ? 0 : static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))};
}

Database::Database(const std::filesystem::path& file) : file_(file.string()) {
  try {
    open_to_read();
  } catch (...) {
    sqlite3_close(database_);
    throw;
  }
}

void Database::open_to_read() {
  constexpr int kMostBytes = 100'000'000;  // of a value
  static_cast<void>(text::open_file(file_, "a database"));
  std::string uri = "file:";
  constexpr std::string_view kHex = "0123456789ABCDEF";
  for (const char c : std::filesystem::absolute(file_).string()) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '/' || c == '.' ||
                       c == '-' || c == '_';
    const auto byte = static_cast<unsigned char>(c);
    uri += plain ? std::string(1, c) : std::string{'%', kHex[byte >> 4U], kHex[byte & 15U]};
  }
  // A log beside it is read, and needs a file for its index; without one, no lock is taken and nothing is written.
  std::error_code none;
  const bool is_alone = !std::filesystem::exists(file_ + "-wal", none) && !std::filesystem::exists(file_ + "-journal", none);
  uri += is_alone ? "?mode=ro&immutable=1" : "?mode=ro";
  if (sqlite3_open_v2(uri.c_str(), &database_, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX, nullptr) !=
      SQLITE_OK)
    fail(database_, file_);
  sqlite3_extended_result_codes(database_, 1);
  sqlite3_busy_timeout(database_, kBusy_ms);
  sqlite3_limit(database_, SQLITE_LIMIT_LENGTH, kMostBytes);
  execute("PRAGMA trusted_schema = OFF");
}

Database::Database(const std::filesystem::path& file, const Purpose& purpose, bool check) : file_(file.string()) {
  try {
    open(purpose, check);
  } catch (...) {
    for (const auto& [sql, statement] : statements_) sqlite3_finalize(statement);
    sqlite3_close(database_);
    throw;
  }
}

void Database::open(const Purpose& purpose, bool check) {
  const std::string what = purpose.what;
  // SQLite would give a new file, and those beside it, the mode that the umask leaves.
  if (const int created = ::open(file_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600); created >= 0) ::close(created);
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
  if (sqlite3_open_v2(file_.c_str(), &database_, flags, nullptr) != SQLITE_OK) fail(database_, file_);
  sqlite3_extended_result_codes(database_, 1);
  sqlite3_busy_timeout(database_, kBusy_ms);
  if (sqlite3_db_readonly(database_, "main") == 1) throw Error(file_, "is read-only, expected a database that can be written");
  try {
    const auto number_of = [&](const char* sql) {
      Statement statement = prepare(sql);
      return statement.step() ? statement.integer(0) : 0;
    };
    const bool empty = number_of("SELECT count(*) FROM sqlite_master") == 0;
    if (empty && number_of("PRAGMA user_version") == 0) {
      if (purpose.schema.empty()) throw Error(file_, "is empty, expected " + what);
      execute("PRAGMA auto_vacuum = INCREMENTAL");  // only before the first table
    } else if (number_of("PRAGMA application_id") != purpose.application) {
      throw Error(file_, "is a database of another program, expected " + what + " or a new file");
    }
    if (const std::int64_t found = number_of("PRAGMA user_version"); found > purpose.version)
      throw Error(file_, "has version " + std::to_string(found) + ", expected at most " + std::to_string(purpose.version) +
                             ": it was written by a newer cotwin");
    execute("PRAGMA journal_mode = WAL");
    execute("PRAGMA journal_size_limit = 16777216");
    execute("PRAGMA trusted_schema = OFF");
    Statement checked = prepare(check ? "PRAGMA quick_check(1)" : "SELECT 'ok'");
    if (checked.step() && checked.text(0) != "ok")
      throw Error(file_, "is damaged (" + checked.text(0) + "), expected an intact database; restore it or move it away");
  } catch (const DatabaseError& error) {
    if (const int code = sqlite3_errcode(database_) & 0xff; code == SQLITE_NOTADB || code == SQLITE_CORRUPT)
      throw Error(file_, std::string("is damaged or no SQLite database (") + sqlite3_errmsg(database_) + "), expected " + what +
                             "; restore it or move it away");
    throw;
  }
  Transaction transaction(*this, true);
  if (Statement statement = prepare("PRAGMA user_version"); statement.step() && statement.integer(0) < purpose.version) {
    execute((statement.integer(0) == 0 ? purpose.schema : purpose.upgrade).c_str());
    execute(("PRAGMA application_id = " + std::to_string(purpose.application)).c_str());
    execute(("PRAGMA user_version = " + std::to_string(purpose.version)).c_str());
  }
  transaction.commit();
}

Database::~Database() {
  for (const auto& [sql, statement] : statements_) sqlite3_finalize(statement);
  sqlite3_close(database_);  // writes the log into the database
}

Statement Database::prepare(const std::string& sql) {
  const auto at = statements_.find(sql);
  if (at != statements_.end()) return {database_, at->second, file_};
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(database_, sql.c_str(), static_cast<int>(sql.size()) + 1, &statement, nullptr) != SQLITE_OK)
    fail(database_, file_);
  statements_.emplace(sql, statement);
  return {database_, statement, file_};
}

void Database::execute(const char* sql) {
  if (sqlite3_exec(database_, sql, nullptr, nullptr, nullptr) != SQLITE_OK) fail(database_, file_);
}

std::int64_t Database::last_row() const { return sqlite3_last_insert_rowid(database_); }

// IMMEDIATE: a deferred transaction that reads before it writes fails at once if another process has written in between.
Transaction::Transaction(Database& database, bool durable) : database_(database) {
  database_.execute(durable ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
  database_.execute("BEGIN IMMEDIATE");
}

Transaction::~Transaction() {
  if (done_) return;
  try {
    database_.execute("ROLLBACK");
  } catch (const DatabaseError&) {
    // SQLite has rolled back by itself after errors such as a full disk.
  }
}

void Transaction::commit() {
  database_.execute("COMMIT");
  done_ = true;
}

}  // namespace cotwin::database
