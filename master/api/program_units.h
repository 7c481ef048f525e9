#pragma once
#include <span>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/api/cotwin.h"
#include "master/scenario/scenario.h"

/// Units of the calling program (ProgramUnit) as units of the master.
namespace cotwin {

/// The units of Cotwin and its modules, and those of the program.
class ProgramUnits {
 public:
  /// Throws Error for a program's unit whose name is malformed or taken.
  ProgramUnits(std::vector<ProgramUnitType> own, std::vector<UnitType> others);
  ProgramUnits(const ProgramUnits&) = delete;
  ProgramUnits& operator=(const ProgramUnits&) = delete;

  std::span<const UnitType> types() const { return types_; }

  /// While it exists, units of the program can be made on this thread. UnitType::make is a plain function, so it finds the program's
  /// units by their names here.
  class Loading {
   public:
    explicit Loading(const ProgramUnits& units);
    ~Loading();
    Loading(const Loading&) = delete;
    Loading& operator=(const Loading&) = delete;

   private:
    const ProgramUnits* before_;
  };

 private:
  static std::unique_ptr<Unit> make(Settings& settings);

  std::vector<ProgramUnitType> own_;
  std::vector<UnitType> types_;
};

/// Components with units of the program are not stepped on worker threads.
void keep_on_the_loops_thread(std::span<const ProgramUnitType> units, master::Scenario& scenario);

}  // namespace cotwin
