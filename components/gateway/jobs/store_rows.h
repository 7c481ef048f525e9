#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "components/gateway/jobs/job.h"
#include "models/foundation/database/database.h"

/// Rows of the tables as values.
namespace cotwin::gateway {

using database::Database;
using database::Statement;
using database::Transaction;

inline constexpr std::uint64_t kPageBytes = std::uint64_t{4} << 20;  // a page ends early at so many

/// "SELECT … FROM jobs ": columns for job_of.
extern const std::string kSelectJob;
/// id, version, state, service, robot, request, request_hash, stored; update_row writes the other columns.
extern const std::string kInsertJob;

Job job_of(const Statement& row);
std::int64_t sequence_of(const Statement& row);
std::optional<Job> one_job(Statement rows);
void update_row(Database& database, const Job& job);

/// Of what clients and workers have written, for the size of pages.
std::uint64_t bytes_of(const Job& job);

std::string texts_to_json(const std::vector<LocalizedText>& texts);

/// Conditions of a list with their values.
struct Conditions {
  std::string text;  // " WHERE … ORDER BY …"
  std::vector<std::variant<std::string, std::int64_t>> values;

  void add(const std::string& condition) { text += (text.empty() ? " WHERE " : " AND ") + condition; }
  void equal(const std::string& column, const std::string& value);  // "": no condition
  void times(const std::string& column, const std::optional<UtcTime>& from, const std::optional<UtcTime>& before);
  /// Order and start of the page; call it last. Throws Error for a cursor of another list.
  void page(const std::string& column, bool newest_first, std::string_view cursor);
  void bind(Statement& statement) const;
};

/// Of the page after the row with this number.
std::string cursor_of(bool newest_first, std::int64_t number);

}  // namespace cotwin::gateway
