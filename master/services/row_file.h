#pragma once
#include <filesystem>
#include <memory>

#include "components/services/json/json.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/atomic_file.h"

namespace cotwin::master {

/// A table that appears as a file when it is complete: CSV, or with the suffix .npy an array of records for NumPy (format 1.0), one
/// field of eight bytes per column. Throws Error with the system's message.
class RowFile final : public services::RowSink {
 public:
  explicit RowFile(const std::filesystem::path& place);
  void begin(const std::vector<std::string>& columns, std::size_t rows) override;
  void row(const std::vector<double>& values) override;
  void commit() { file_.commit(); }

 private:
  AtomicFile file_;
  bool numpy_;
  std::unique_ptr<csv::Writer> csv_;
};

}  // namespace cotwin::master
