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
/// Throws Error at `place` for a fact that is not there.
const std::string& fact_of(const Facts& facts, const std::string& name, const std::string& place);

/// A process that makes runs.
struct Maker {
  std::string host;
  std::int64_t process = 0;
  int threads = 1;
};
Maker this_process(int threads);

class Registry {
 public:
  static constexpr const char* kFile = "farm.db";

  /// Creates the registry of a new study in `folder`. Throws Error if there is one, and for more figures than a table can have.
  Registry(const std::filesystem::path& folder, const Facts& facts, const std::vector<std::string>& factors,
           const std::vector<std::string>& figures);
  /// Opens the registry of a study. `reads`: beside a farm that may add runs. Otherwise no other process may add runs. Throws Error.
  Registry(const std::filesystem::path& folder, bool reads);

  const Facts& facts() const { return facts_; }
  /// Throws Error for a fact that is not there.
  const std::string& fact(const std::string& name) const { return fact_of(facts_, name, database_.file()); }
  /// Begins a session, the number of which is returned.
  std::int64_t begin_session(const Maker& maker);
  /// In one transaction, which survives the end of the process.
  void add(std::span<const RunRow> rows, std::int64_t session);

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
  void read_facts();
  std::string insert_statement() const;

  std::optional<database::OwnerLock> owner_;
  database::Database database_;
  Facts facts_;
  std::vector<std::string> factors_, figures_;  // names of their columns
};

}  // namespace cotwin::master
