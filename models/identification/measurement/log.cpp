#include "models/identification/measurement/log.h"

#include "models/foundation/support/error.h"

namespace cotwin::measurement {

LogReader::LogReader(const Log& log, std::span<const trajectory::Axis> axes, double gap) : log_(log), axes_(axes), gap_(gap) {
  if (log.files.empty()) throw Error("log", "no file, expected at least one");
  open(0);
}

bool LogReader::open(std::size_t file) {
  if (file >= log_.files.size()) return false;
  file_ = file;
  reader_ = std::make_unique<trajectory::RecordingReader>(log_.files[file], axes_, log_.format, true);
  if (!reader_->tau().present()) {
    throw Error(log_.files[file].string(),
                "has no columns of measured torques, expected 'tau1', 'tau2', … or their names in tau_columns");
  }
  fresh_ = true;
  return true;
}

bool LogReader::next() {
  for (;;) {
    if (!reader_->next()) {
      if (!open(file_ + 1)) return false;
    } else if (!fresh_ && reader_->t() == t_before_) {
      ++repeated_;
    } else {
      break;
    }
  }
  begins_ = fresh_ || reader_->t() - t_before_ > gap_;
  fresh_ = false;
  t_before_ = reader_->t();
  return true;
}

}  // namespace cotwin::measurement
