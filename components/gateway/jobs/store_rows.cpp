#include "components/gateway/jobs/store_rows.h"

#include <nlohmann/json.hpp>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

using Json = nlohmann::json;

std::vector<LocalizedText> texts_of(const std::string& json) {
  std::vector<LocalizedText> texts;
  for (const Json& text : Json::parse(json, nullptr, false)) {
    if (text.is_array() && text.size() == 2 && text[0].is_string() && text[1].is_string())
      texts.push_back({text[0].get<std::string>(), text[1].get<std::string>()});
  }
  return texts;
}

}  // namespace

const std::string kSelectJob =
    "SELECT sequence, id, version, state, result, service, robot, request, request_hash, description, comment, priority, "
    "start_time, end_time, deadline, time_limit_s, reuse, reason, progress, progress_message, retries, restarts, stored, "
    "started, "
    "ended, busy_s, result_number, problem, read, light FROM jobs ";

const std::string kInsertJob =
    "INSERT INTO jobs(id, version, state, service, robot, request, request_hash, stored, result, description, comment, "
    "priority, "
    "time_limit_s, reuse, reason, progress, progress_message, retries, restarts, busy_s, problem, read) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, 0, '[]', '[]', 0, 0, 1, '', 0, '', 0, 0, 0, '', 0)";

Job job_of(const Statement& row) {
  Job job;
  int c = 0;
  job.sequence = row.integer(c++);
  job.order.id = row.text(c++);
  job.version = row.integer(c++);
  job.state = static_cast<JobState>(row.integer(c++));
  job.result = static_cast<JobResult>(row.integer(c++));
  job.service = row.text(c++);
  job.robot = row.text(c++);
  job.order.request = row.text(c++);
  job.request_hash = row.text(c++);
  job.order.description = texts_of(row.text(c++));
  job.comment = texts_of(row.text(c++));
  job.order.priority = static_cast<std::int16_t>(row.integer(c++));
  job.order.start_time = row.optional_time(c++);
  job.order.end_time = row.optional_time(c++);
  job.order.deadline = row.optional_time(c++);
  job.order.time_limit_s = row.real(c++);
  job.order.reuse = row.integer(c++) != 0;
  job.reason = row.text(c++);
  job.progress = row.real(c++);
  job.progress_message = row.text(c++);
  job.retries = static_cast<int>(row.integer(c++));
  job.restarts = static_cast<int>(row.integer(c++));
  job.stored = row.time(c++);
  job.started = row.optional_time(c++);
  job.ended = row.optional_time(c++);
  job.busy_s = row.real(c++);
  if (!row.is_null(c)) job.result_number = row.integer(c);
  ++c;
  job.problem = row.text(c++);
  job.read = row.integer(c++) != 0;
  job.light = row.text(c++);
  return job;
}

std::int64_t sequence_of(const Statement& row) { return row.integer(0); }

std::optional<Job> one_job(Statement rows) {
  if (!rows.step()) return std::nullopt;
  return job_of(rows);
}

void update_row(Database& database, const Job& job) {
  database.run(
      "UPDATE jobs SET version = ?, state = ?, result = ?, service = ?, robot = ?, request = ?, request_hash = ?, description "
      "= ?, "
      "comment = ?, priority = ?, start_time = ?, end_time = ?, deadline = ?, time_limit_s = ?, reuse = ?, reason = ?, "
      "progress = ?, progress_message = ?, retries = ?, restarts = ?, started = ?, ended = ?, busy_s = ?, result_number = ?, "
      "problem = ?, light = ? WHERE sequence = ?",
      job.version, static_cast<int>(job.state), static_cast<int>(job.result), job.service, job.robot, job.order.request,
      job.request_hash, texts_to_json(job.order.description), texts_to_json(job.comment), int{job.order.priority},
      job.order.start_time, job.order.end_time, job.order.deadline, job.order.time_limit_s, job.order.reuse, job.reason,
      job.progress, job.progress_message, job.retries, job.restarts, job.started, job.ended, job.busy_s, job.result_number,
      job.problem, job.light.empty() ? std::nullopt : std::optional(job.light), job.sequence);
}

std::uint64_t bytes_of(const Job& job) {
  std::uint64_t bytes =
      job.order.request.size() + job.problem.size() + job.reason.size() + job.progress_message.size() + job.order.id.size();
  for (const auto* texts : {&job.order.description, &job.comment}) {
    for (const LocalizedText& text : *texts) bytes += text.locale.size() + text.text.size();
  }
  return bytes;
}

std::string texts_to_json(const std::vector<LocalizedText>& texts) {
  Json all = Json::array();
  for (const LocalizedText& text : texts) all.push_back(Json::array({text.locale, text.text}));
  return all.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void Conditions::equal(const std::string& column, const std::string& value) {
  if (value.empty()) return;
  add(column + " = ?");
  values.emplace_back(value);
}

void Conditions::times(const std::string& column, const std::optional<UtcTime>& from, const std::optional<UtcTime>& before) {
  const auto limit = [&](const char* condition, const std::optional<UtcTime>& time) {
    if (!time) return;
    add(column + condition);
    values.emplace_back(static_cast<std::int64_t>(time->time_since_epoch().count()));
  };
  limit(" >= ?", from);
  limit(" < ?", before);
}

std::string cursor_of(bool newest_first, std::int64_t number) { return (newest_first ? "d" : "a") + std::to_string(number); }

void Conditions::page(const std::string& column, bool newest_first, std::string_view cursor) {
  if (!cursor.empty()) {
    const auto number = text::parse_integer(cursor.substr(1));
    if (!number || *number < 1 || cursor_of(newest_first, *number) != cursor)
      throw Error("cursor", "is not of this list, expected one of an earlier page");
    add(column + (newest_first ? " < ?" : " > ?"));
    values.emplace_back(static_cast<std::int64_t>(*number));
  }
  text += " ORDER BY " + column + (newest_first ? " DESC" : "");
}

void Conditions::bind(Statement& statement) const {
  for (const auto& value : values) {
    if (const auto* word = std::get_if<std::string>(&value)) {
      statement.bind(*word);
    } else {
      statement.bind(std::get<std::int64_t>(value));
    }
  }
}

}  // namespace cotwin::gateway
