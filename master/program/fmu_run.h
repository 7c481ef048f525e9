#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fmu/description/model_description.h"
#include "master/run/master.h"
#include "master/run/row_file.h"
#include "models/support/csv.h"

/// One FMU by itself, with the options and the files of the Reference FMUs' fmusim.
namespace cotwin::master {

struct FmuRunOptions {
  std::filesystem::path file;
  std::string interface_type;         // "cs", "me"; "": cs where the FMU offers it
  std::optional<double> start, stop;  // s; else of the FMU's default experiment, else 0 and one second later
  std::optional<double> interval;     // s; else its step size, else a 500th of the time
  std::optional<double> tolerance;    // relative; else its own
  std::string process = "auto";       // "shared", "own" (fmu/import/load.h); auto: its own, if the FMU is not one of ours
  std::optional<double> timeout;      // s, of a call in a process of its own
  std::optional<double> memory;       // bytes, likewise
  bool set_stop_time = false;         // whether the FMU is told when the run ends
  std::vector<std::pair<std::string, std::string>> start_values;  // in the FMU's own units of measure
  std::vector<std::string> output_variables;                      // empty: all outputs
  std::filesystem::path input_file;                               // "": none
  std::filesystem::path output_file;                              // "": <FMU>_out.csv in the working directory
};

/// Inputs over time from a CSV whose first column is the time in seconds, and whose other columns are called as inputs or
/// tunable parameters are; arrays of FMI 3 are numbers separated by blanks. Before the first and after the last row values
/// stay.
class InputTable {
 public:
  /// Throws Error `file.csv:17: …` for columns that are not inputs, cells that do not fit, time that runs backwards.
  InputTable(const std::filesystem::path& file, std::span<const Member> members, const fmu::ModelDescription& description);

  /// Writes the inputs as they are at `now`: continuous reals between two rows along a line, all else as the last row at or
  /// before `now` has it. Of two rows of the same time the second holds from then on. Inputs that their unit follows linearly
  /// get the slope that leads to the value just before now + h.
  void apply(Time now, Duration h) const;

 private:
  struct Column {
    Signal signal;
    bool continuous = false;
    std::vector<double> numbers;     // rows · elements
    std::vector<std::string> texts;  // of a string
  };
  void read_cell(Column& column, const csv::Reader& reader, std::size_t c) const;
  double at(const Column& column, std::size_t element, Time time, bool before) const;

  std::vector<Time> times_;
  std::vector<Column> columns_;
};

/// A Master with one FMU, which reads its inputs and writes its outputs as fmusim does: a column for each variable by its own
/// name in quotes, time first, grouped by type, arrays of FMI 3 as one cell.
class FmuRun {
 public:
  /// Throws Error for an FMU, name, value or file that does not fit; nothing is written.
  explicit FmuRun(const FmuRunOptions& options);

  void initialise();
  bool step_tick();
  /// Closes the output. Throws Error if it could not be written.
  void finish();
  const Master& master() const { return master_; }
  const std::filesystem::path& output_file() const { return options_.output_file; }
  Summary summary() const;

 private:
  struct Output {
    std::string name;
    Signal signal;
    bool quoted = true;  // a string; a binary is hexadecimal digits
  };
  Signal find(const std::string& name, const std::string& place);
  void write_row();

  FmuRunOptions options_;
  fmu::ModelDescription description_;
  Master master_;
  std::vector<Output> outputs_;
  std::optional<InputTable> inputs_;
  std::optional<RowFile> out_;
  std::string line_;
  std::int64_t rows_ = 0;
};

}  // namespace cotwin::master
