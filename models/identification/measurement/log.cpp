#include "models/identification/measurement/log.h"

#include <cmath>
#include <numbers>

#include "models/foundation/support/text.h"
#include "models/trajectory/columns.h"

namespace cotwin::measurement {

std::string too_fast(const trajectory::Axis& axis, const trajectory::RecordingFormat& format, double dq, double dt) {
  constexpr double kFactor = 4;      // noise and overshoot stay below, degrees (57) do not
  constexpr double kRevolute = 30;   // rad/s, beyond the joints of industrial arms
  constexpr double kPrismatic = 10;  // m/s
  constexpr double kTurn = 2 * std::numbers::pi, kNearTurn = 0.5;
  const double usual = std::isfinite(axis.dq_max) ? kFactor * axis.dq_max : axis.revolute ? kRevolute : kPrismatic;
  const double limit = format.max_speed > 0 ? format.max_speed : usual, speed = std::abs(dq) / dt;
  if (!(speed > limit)) return "";
  if (axis.revolute && std::abs(std::abs(dq) - kTurn) < kNearTurn)
    return axis.name + " would have turned by " + text::to_text(dq, 4) +
           " rad since the sample before, nearly a whole turn: positions are wrapped, expected ones that go on beyond half a "
           "turn";
  const std::string unit = axis.revolute ? " rad/s" : " m/s";
  return axis.name + " would have moved with " + text::to_text(speed, 4) + unit +
         " since the sample before, expected at most " + text::to_text(limit, 4) + unit + " (4 times the URDF's limit)" +
         (!axis.revolute           ? "; are these millimetres? Then --q-scale 0.001 for this joint"
          : format.angle_unit == 1 ? "; are these degrees? Then --angle-unit deg"
                                   : "") +
         "; or is the unit of time another one? Then --time-unit";
}

LogReader::LogReader(const Log& log, std::span<const trajectory::Axis> axes, double gap, double step)
    : log_(log), axes_(axes), gap_(gap), step_(step) {
  if (log.files.empty()) throw Error("log", "no file, expected at least one");
  open(0);
}

bool LogReader::open(std::size_t file) {
  if (file >= log_.files.size()) return false;
  file_ = file;
  reader_ = std::make_unique<trajectory::RecordingReader>(log_.files[file], axes_, log_.format, true);
  if (!reader_->tau().present()) {
    throw Error(log_.files[file].string(),
                "has no columns of measured torques, expected 'tau1', 'tau2', … or their names in tau_columns" +
                    trajectory::table_columns(reader_->names()));
  }
  fresh_ = true;
  rows_ = bad_ = fast_ = 0;
  bad_last_ = false;
  return true;
}

void LogReader::keep_notes() {
  for (const std::string& note : reader_->table().notes()) notes_.push_back(log_.files[file_].string() + ": " + note);
}

void LogReader::check_speed() {
  if (!(log_.skip > 0) || !log_.skip_fast || !(step_ > 0) || fresh_ || reader_->t() - t_before_ > gap_) return;
  const double dt = std::max(reader_->t() - t_before_, step_);
  for (std::size_t j = 0; j < axes_.size(); ++j)
    if (const std::string fact = too_fast(axes_[j], log_.format, reader_->q().value[j] - q_before_[j], dt); !fact.empty()) {
      const Error error(reader_->place(reader_->q(), j), fact + " (--accept-data takes it as it is)");
      if (++fast_ == 1) jump_ = error;
      throw error;
    }
  fast_ = 0;
}

void LogReader::leave_out(const Error& error) {
  constexpr double kFirst = 100;  // rows that may be bad at the beginning of a long file
  if (bad_++ == 0) first_bad_ = error;
  if (fast_ > 1) throw *jump_;  // two rows that are far from the one before are no outliers
  if (!(log_.skip > 0) || static_cast<double>(bad_) > kFirst + log_.skip * static_cast<double>(rows_)) throw *first_bad_;
  bad_last_ = true;
  if (left_out_++ == 0) why_ = error.what();
}

void LogReader::finish_file() const {
  const bool cut = bad_ == 1 && bad_last_;  // the last row of a file is often half written
  if (cut || !(static_cast<double>(bad_) > log_.skip * static_cast<double>(rows_ + bad_))) return;
  throw Error(std::string(first_bad_->what()) + "; " + std::to_string(bad_) + " of " + std::to_string(rows_ + bad_) +
              " rows are like this, expected at most " + text::to_text(100 * log_.skip) + " % (--skip-rows)");
}

/// The next row that can be used; false at the end of the file.
bool LogReader::next_row() {
  for (;;) {
    try {
      if (!reader_->next()) return false;
      check_speed();
      return true;
    } catch (const Error& error) {
      leave_out(error);
    }
  }
}

bool LogReader::next() {
  for (;;) {
    if (!next_row()) {
      finish_file();
      keep_notes();
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
  q_before_ = reader_->q().value;
  bad_last_ = false;
  ++rows_;
  return true;
}

}  // namespace cotwin::measurement
