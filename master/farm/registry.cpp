#include "master/farm/registry.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "master/workflows/watched.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

constexpr std::int32_t kApplication = 0x4377466d;  // "CwFm"
constexpr std::int32_t kVersion = 1;
constexpr std::size_t kMostColumns = 1900;  // SQLite has 2000 at most
constexpr std::size_t kColumnsOfQuery = 100;
const std::vector<std::string> kOwnColumns = {"run", "state", "success", "time", "seconds", "session", "warnings", "message"};

std::string in_quotes(const std::string& text, char quote) {
  std::string all(1, quote);
  for (const char c : text) all += c == quote ? std::string(2, quote) : std::string(1, c);
  return all + quote;
}
std::string column(const std::string& name) { return in_quotes(name, '"'); }

/// SQLite compares the names of columns without their case.
std::vector<std::string> distinct(const std::vector<std::string>& names, std::set<std::string>& seen) {
  std::vector<std::string> all;
  for (const std::string& name : names) {
    std::string own = name;
    const auto is_new = [&] {
      std::string lower = own;
      std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      return seen.insert(lower).second;
    };
    for (int n = 2; !is_new(); ++n) own = name + " (" + std::to_string(n) + ")";
    all.push_back(own);
  }
  return all;
}

std::string schema_of(const Facts& facts, const std::vector<std::string>& factors, const std::vector<std::string>& figures) {
  if (factors.size() + figures.size() > kMostColumns)
    throw Error("keep", "gives " + std::to_string(figures.size()) + " figures of a run, expected at most " +
                            std::to_string(kMostColumns - factors.size()));
  std::set<std::string> seen(kOwnColumns.begin(), kOwnColumns.end());
  const std::vector<std::string> of_factors = distinct(factors, seen), of_figures = distinct(figures, seen);
  std::string schema =
      "CREATE TABLE study(name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;"
      "CREATE TABLE sessions(session INTEGER PRIMARY KEY, begun TEXT NOT NULL, host TEXT NOT NULL, process INTEGER NOT NULL, "
      "threads INTEGER NOT NULL);"
      "CREATE TABLE messages(failure INTEGER, kind TEXT, text TEXT NOT NULL, run INTEGER NOT NULL, runs INTEGER NOT NULL, "
      "PRIMARY KEY(failure, kind)) WITHOUT ROWID;"
      "CREATE TABLE runs(run INTEGER PRIMARY KEY, state TEXT NOT NULL, success INTEGER, time REAL NOT NULL, seconds REAL NOT "
      "NULL, "
      "session INTEGER NOT NULL, warnings INTEGER NOT NULL, message TEXT";
  for (const std::string& name : of_factors) schema += ", " + column(name);
  for (const std::string& name : of_figures) schema += ", " + column(name) + " REAL";
  schema += ");";
  Facts all = facts;
  all.emplace_back("factors", nlohmann::json(of_factors).dump());
  all.emplace_back("figures", nlohmann::json(of_figures).dump());
  for (const auto& [name, value] : all)
    schema += "INSERT INTO study VALUES (" + in_quotes(name, '\'') + ", " + in_quotes(value, '\'') + ");";
  return schema;
}

fs::path made(const fs::path& folder) {
  make_folder(folder);
  return folder;
}

}  // namespace

const std::string& fact_of(const Facts& facts, const std::string& name, const std::string& place) {
  const auto found = std::ranges::find(facts, name, &Facts::value_type::first);
  if (found == facts.end()) throw Error(place, "lacks '" + name + "', expected a study of this version of cotwin");
  return found->second;
}

Maker this_process(int threads) {
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
  return {host.data(), getpid(), threads};
}

Registry::Registry(const fs::path& folder, bool owned, const std::string& schema)
    : owner_(owned ? std::optional<database::OwnerLock>(std::in_place, folder / kFile) : std::nullopt),
      database_(folder / kFile, {kApplication, "one of a study", kVersion, schema}, owned) {
  read_facts();
}

Registry::Registry(const fs::path& folder, const Facts& facts, const std::vector<std::string>& factors,
                   const std::vector<std::string>& figures)
    : Registry(made(folder), true, schema_of(facts, factors, figures)) {
  for (const auto& [name, value] : facts) {
    if (fact(name) != value || totals().done + totals().failed > 0)
      throw Error(folder.string(),
                  "has a study already, expected another folder (--out), or: cotwin farm resume " + folder.string());
  }
}

Registry::Registry(const fs::path& folder, bool reads)
    : Registry(fs::exists(folder / kFile)
                   ? folder
                   : throw Error(folder.string(), std::string("has no study, expected the file ") + kFile + " in it"),
               !reads, "") {}

void Registry::read_facts() {
  database::Statement row = database_.query("SELECT name, value FROM study");
  while (row.step()) facts_.emplace_back(row.text(0), row.text(1));
  const auto names = [this](const char* of) { return nlohmann::json::parse(fact(of)).get<std::vector<std::string>>(); };
  factors_ = names("factors");
  figures_ = names("figures");
}

std::int64_t Registry::begin_session(const Maker& maker) {
  database_.run("INSERT INTO sessions(begun, host, process, threads) VALUES (strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), ?, ?, ?)",
                maker.host, maker.process, maker.threads);
  return database_.last_row();
}

std::string Registry::insert_statement() const {
  std::string marks = "?, ?, ?, ?, ?, ?, ?, ?";
  for (std::size_t k = 0; k < factors_.size() + figures_.size(); ++k) marks += ", ?";
  return "INSERT INTO runs VALUES (" + marks + ")";
}

void Registry::add(std::span<const RunRow> rows, std::int64_t session) {
  const std::string insert = insert_statement();
  database::Transaction transaction(database_, false);
  for (const RunRow& row : rows) {
    database::Statement statement =
        database_.query(insert, row.run, row.failure.empty() ? "done" : "failed", row.success, row.time, row.seconds, session,
                        static_cast<std::int64_t>(row.warnings.size()),
                        row.failure.empty() ? std::optional<std::string_view>() : std::optional<std::string_view>(row.failure));
    for (const std::string& value : row.values) {
      const auto number = text::parse_real(value);
      if (number && std::isfinite(*number)) {
        statement.bind(*number);
      } else {
        statement.bind(value);
      }
    }
    for (std::size_t k = 0; k < figures_.size(); ++k) {
      if (k < row.figures.size() && std::isfinite(row.figures[k])) {
        statement.bind(row.figures[k]);
      } else {
        statement.bind(std::nullopt);
      }
    }
    while (statement.step()) continue;
    std::set<std::string> kinds;
    const auto count = [&](bool failure, const std::string& text) {
      if (!kinds.insert(without_numbers(text)).second) return;
      database_.run(
          "INSERT INTO messages VALUES (?1, ?2, ?3, ?4, 1) ON CONFLICT DO UPDATE SET runs = runs + 1, "
          "text = iif(excluded.run < run, excluded.text, text), run = min(run, excluded.run)",
          failure, without_numbers(text), text, row.run);
    };
    if (!row.failure.empty()) count(true, row.failure);
    for (const std::string& warning : row.warnings) count(false, warning);
  }
  transaction.commit();
}

std::vector<bool> Registry::over(std::int64_t runs) {
  std::vector<bool> all(static_cast<std::size_t>(runs), false);
  database::Statement rows = database_.query("SELECT run FROM runs");
  while (rows.step()) {
    const std::int64_t run = rows.integer(0);
    if (run < 1 || run > runs)
      throw Error(database_.file(), "has a run " + std::to_string(run) + ", expected 1 to " + std::to_string(runs));
    all[static_cast<std::size_t>(run - 1)] = true;
  }
  return all;
}

Registry::Totals Registry::totals() {
  database::Statement row =
      database_.query("SELECT count(*), count(message), count(success), sum(success), sum(seconds) FROM runs");
  Totals t;
  if (!row.step()) return t;
  t.failed = row.integer(1);
  t.done = row.integer(0) - t.failed;
  t.judged = row.integer(2);
  t.successes = row.integer(3);
  t.seconds = row.real(4);
  return t;
}

std::vector<Registry::Spread> Registry::spreads() {
  std::vector<Spread> all;
  for (std::size_t first = 0; first < figures_.size(); first += kColumnsOfQuery) {
    const std::size_t last = std::min(figures_.size(), first + kColumnsOfQuery);
    std::string columns;
    for (std::size_t k = first; k < last; ++k) {
      const std::string name = column(figures_[k]);
      text::append(columns, "count(" + name + "), min(" + name + "), avg(" + name + "), max(" + name + ")");
    }
    database::Statement row = database_.query("SELECT " + columns + " FROM runs");
    if (!row.step()) break;
    for (std::size_t k = first; k < last; ++k) {
      const int at = 4 * static_cast<int>(k - first);
      all.push_back({figures_[k], row.integer(at), row.real(at + 1), row.real(at + 2), row.real(at + 3)});
    }
  }
  return all;
}

std::vector<Registry::Message> Registry::messages() {
  std::vector<Message> all;
  database::Statement rows = database_.query("SELECT failure, text, run, runs FROM messages ORDER BY failure DESC, run, kind");
  while (rows.step()) all.push_back({rows.integer(0) != 0, rows.text(1), rows.integer(2), rows.integer(3)});
  return all;
}

void Registry::write(std::ostream& out) {
  std::vector<std::string> names = kOwnColumns;
  names.insert(names.end(), factors_.begin(), factors_.end());
  names.insert(names.end(), figures_.begin(), figures_.end());
  csv::Writer table(out, names);
  database::Statement row = database_.query("SELECT * FROM runs ORDER BY run");
  while (row.step()) {
    for (int k = 0; k < static_cast<int>(names.size()); ++k) {
      if (row.is_real(k)) {
        table.cell(row.real(k));
      } else {
        table.cell(row.text(k));
      }
    }
    table.end_row();
  }
}

}  // namespace cotwin::master
