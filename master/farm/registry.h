#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "models/foundation/database/database.h"

/// The registry of a study: an SQLite database in its folder, which other programs may read while runs are added.
namespace cotwin::master {

/// A run that is over.
struct RunRow {
  std::int64_t run = 0;             // from 1
  std::vector<std::string> values;  // of the factors
  std::string failure;              // empty: it is done
  std::optional<bool> success;      // nothing for a failed run, and in a study without conditions
  double time = 0;                  // s, reached in the run
  double seconds = 0;               // of wall time
  std::vector<double> figures;      // empty of a failed run
  std::vector<std::string> warnings;
};

/// Named texts on which the results of a study depend.
using Facts = std::vector<std::pair<std::string, std::string>>;

class Registry {
 public:
  static constexpr const char* kFile = "farm.db";

  /// Creates the registry of a new study in `folder`. Throws Error if there is one, and for more figures than a table can have.
  Registry(const std::filesystem::path& folder, const Facts& facts, const std::vector<std::string>& factors,
           const std::vector<std::string>& figures);
  /// Opens the registry of a study. `reads`: beside a farm that may add runs. Otherwise no other process may add runs. Throws Error.
  Registry(const std::filesystem::path& folder, bool reads);

  /// Throws Error for a fact that is not there.
  std::string fact(const std::string& name);
  /// Begins a session of this process, to which the runs belong that are added.
  void begin_session(int threads);
  /// In one transaction, which survives the end of the process.
  void add(std::span<const RunRow> rows);

  /// Whether each run from 1 to `runs` is over.
  std::vector<bool> over(std::int64_t runs);
  struct Totals {
    std::int64_t done = 0, failed = 0, judged = 0, successes = 0;
    double seconds = 0;  // of all runs
  };
  Totals totals();
  struct Spread {
    std::string name;
    std::int64_t count = 0;  // runs that have a finite figure
    double min = 0, mean = 0, max = 0;
  };
  std::vector<Spread> spreads();
  /// Failures and warnings; those that differ only in numbers are one.
  struct Message {
    bool failure = false;
    std::string text;       // of the first run
    std::int64_t run = 0;   // the first one
    std::int64_t runs = 0;  // their number
  };
  std::vector<Message> messages();
  /// All runs as CSV.
  void write(std::ostream& out);

 private:
  Registry(const std::filesystem::path& folder, bool owned, const std::string& schema);
  void read_columns();
  std::string insert_statement() const;

  std::optional<database::OwnerLock> owner_;
  database::Database database_;
  std::vector<std::string> factors_, figures_;  // names of their columns
  std::int64_t session_ = 0;
};

}  // namespace cotwin::master
