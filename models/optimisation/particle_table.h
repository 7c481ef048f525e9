#pragma once
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <memory>

#include "models/optimisation/search.h"

namespace cotwin::optimisation {

/// Writes every particle of a search as a row of a table (models/foundation/formats/csv.h), one after each round:
///   stage, round, particle, T, feasible, kinematic, torque, the costs by name, q_to[j], c_r[j;k]
/// Costs of pruned particles are "nan". To be used as SearchOptions::on_round.
class ParticleTable {
 public:
  /// `out` must outlive the table. `every`: only each `every`-th round of a stage is written, ≥ 1.
  ParticleTable(std::ostream& out, const Problem& problem, int every = 1);
  ~ParticleTable();

  void add(const Round& round);
  std::uint64_t rows() const { return rows_; }
  /// `then`: a further function of rounds, or none. The table must outlive the function.
  std::function<bool(const Round&)> on_round(std::function<bool(const Round&)> then = {});

 private:
  struct Table;
  std::unique_ptr<Table> table_;
  int every_;
  std::uint64_t rows_ = 0;
};

}  // namespace cotwin::optimisation
