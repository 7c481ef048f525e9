#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fmu/description/model_description.h"
#include "master/results/row_file.h"
#include "master/run/master.h"
#include "models/foundation/formats/csv.h"

/// Runs a single FMU, with the options and files of fmusim (Reference FMUs).
namespace cotwin::master {

struct FmuRunOptions {
  std::filesystem::path file;
  fmu::InterfaceChoice interface_type = fmu::InterfaceChoice::kAny;
  std::optional<double> start, stop;  // s; default: of the FMU's default experiment, else 0 and start + 1
  std::optional<double> interval;     // s; default: step size of the default experiment, else 1/500 of the duration
  std::optional<double> tolerance;    // relative; default: that of the FMU
  fmu::ProcessChoice process = fmu::ProcessChoice::kAuto;         // kAuto: own unless Cotwin made the FMU
  std::optional<double> timeout;                                  // s, of a call in the FMU's own process
  std::optional<double> memory;                                   // bytes, of the FMU's own process
  bool set_stop_time = false;                                     // pass the stop time to the FMU
  std::vector<std::pair<std::string, std::string>> start_values;  // in the FMU's own units of measure
  std::vector<std::string> output_variables;                      // empty: all outputs
  std::filesystem::path input_file;                               // "": none
  std::filesystem::path output_file;                              // "": <FMU>_out.csv in the working directory
};

/// The output file: as chosen, otherwise by the name of the FMU.
std::filesystem::path output_file_of(const FmuRunOptions& options);

/// Inputs over time from a CSV. The first column is the time in seconds; the others have the names of inputs or tunable
/// parameters. Arrays of FMI 3 are numbers separated by blanks. Before the first and after the last row the values are
/// constant.
class InputTable {
 public:
  /// Throws Error `file.csv:17: …` for columns that are not inputs, invalid cells and decreasing time.
  InputTable(const std::filesystem::path& file, std::span<const Member> members, const fmu::ModelDescription& description);

  /// Writes the inputs at `now`: continuous reals are interpolated linearly, others have the value of the last row at or before
  /// `now`. Of two rows with the same time the second applies from then on. Inputs with a rate get the slope to the value just
  /// before now + h.
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

/// A Master with one FMU that reads inputs and writes outputs in the formats of fmusim: time first, then one column per
/// variable with its name in quotes, grouped by type; an array of FMI 3 is one cell.
class FmuRun {
 public:
  /// Throws Error for an invalid FMU, name, value or file. Writes nothing yet.
  explicit FmuRun(const FmuRunOptions& options);

  void initialise();
  bool step_tick();
  /// Closes the output. Throws Error if it could not be written.
  void finish();
  const Master& master() const { return master_; }
  Summary summary() const;

 private:
  struct Output {
    std::string name;
    Signal signal;
    bool quoted = true;  // strings are quoted, the hexadecimal digits of binaries are not
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
