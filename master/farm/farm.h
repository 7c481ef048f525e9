#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/farm/figures.h"
#include "master/farm/registry.h"
#include "master/farm/study.h"
#include "master/run/identity.h"
#include "master/scenario/scenario.h"
#include "models/foundation/support/file_store.h"

/// The farm: the runs of a study on all cores (V-A, V-B of the paper). Each run is a fresh Master without recording, and its figures are
/// those of `cotwin run` with the same assignments, to the bit, whatever the thread and the order.
namespace cotwin::master {

/// All must be given.
struct FarmHooks {
  std::function<bool()> stops;  // asked often, on any thread: whether the farm ends here
  /// Called a few times a second, on the caller's thread. `where`: what runs elsewhere, "3 RUNNING"; empty on threads.
  std::function<void(std::int64_t over, std::int64_t failed, const std::string& where)> progress;
};

class Farm {
 public:
  /// Reads the scenario and tries the extreme values of each factor without a step. Throws Error for a study that cannot run: unknown
  /// variables, values that a unit refuses, units that reach a robot, a bus or a network.
  Farm(Study study, std::span<const UnitType> types);

  const Study& study() const { return study_; }
  const std::vector<std::string>& figures() const { return figures_; }
  /// On what the results depend: study, scenario, models, program.
  Facts facts(const Build& build) const;

  /// One run on the calling thread. What goes wrong in it is its failure. Thread-safe. A run that `stops` is not over: `time` says how
  /// far it came.
  RunRow run(std::int64_t number, const std::function<bool()>& stops) const;
  /// The first run, the one in the middle and the last one, to learn their cost; fewer where that takes longer than 20 s.
  std::vector<RunRow> sample(const std::function<bool()>& stops) const;
  /// Makes the runs that `next` names, which is not called on two threads at once, until it returns 0 or `stops`. A few times a second `sink`
  /// gets those that are over, on the caller's thread; what it throws ends the runs.
  void run_all(int threads, const std::function<std::int64_t()>& next, const std::function<bool()>& stops,
               const std::function<void(std::span<const RunRow>)>& sink) const;
  /// Makes the runs that the registry lacks. Returns whether all are over. Throws Error if the registry cannot be written.
  bool fill(Registry& registry, int threads, const FarmHooks& hooks) const;

  /// Bytes that one twin takes from the heap; 0 where that is not known.
  std::size_t bytes_of_twin() const;

 private:
  Scenario scenario_of(const std::vector<std::string>& point) const;
  Master master_of(Scenario scenario) const;
  void try_values();
  void name_figures(Master& master);

  Study study_;
  std::span<const UnitType> types_;
  Scenario scenario_;
  std::vector<std::filesystem::path> folders_;
  std::shared_ptr<FileStore> models_ = std::make_shared<FileStore>();
  std::vector<std::string> keep_, figures_;
  std::vector<std::pair<Condition, std::size_t>> success_;  // with the index of its figure
  std::uint64_t scenarios_ = 0;                             // hash of the scenarios that were tried
};

/// What differs between a study's facts and those of now, as "the program is cotwin 0.2.0 …, was …"; empty: nothing.
std::string difference(const Facts& was, const Facts& now);

}  // namespace cotwin::master
