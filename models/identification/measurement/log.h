#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/trajectory/series/recording_reader.h"

namespace cotwin::measurement {

/// A log of a robot: one or several files of the same format, each with its own time.
struct Log {
  std::vector<std::filesystem::path> files;
  trajectory::RecordingFormat format;
  /// Share of the rows of a file that may be left out because they are unreadable, not finite, out of order, or, with
  /// `skip_fast`, alone so far from the row before that the joint would have moved too fast.
  double skip = 0;
  bool skip_fast = true;
};

/// The sentence of a joint that would have moved by dq in dt too fast: more than 4 times its limit, or format.max_speed. Empty
/// where it is not.
std::string too_fast(const trajectory::Axis& axis, const trajectory::RecordingFormat& format, double dq, double dt);

/// Reads the files of a log in order, in memory for one sample. A gap in time and each file start a new segment; nothing is
/// interpolated or filtered across segments. Of rows with equal time the first one is used.
class LogReader {
 public:
  /// `gap`: s; a longer step starts a segment. `step`: s, the usual one; shorter ones are inaccurate time stamps. Throws Error
  /// as RecordingReader, for files without torques, and with the first bad row for more of them than log.skip.
  LogReader(const Log& log, std::span<const trajectory::Axis> axes, double gap, double step = 0);

  /// Goes to the next sample; false at the end of the last file.
  bool next();
  /// True for the first sample of a segment.
  bool begins() const { return begins_; }
  std::size_t file() const { return file_; }
  std::size_t repeated() const { return repeated_; }  // rows so far with the time of the row before
  std::size_t left_out() const { return left_out_; }  // rows so far
  const std::string& why() const { return why_; }     // place and fact of the first of them
  const trajectory::RecordingReader& sample() const { return *reader_; }
  const std::vector<std::string>& notes() const { return notes_; }  // of the files that are read, see csv::Source

 private:
  bool open(std::size_t file);
  void keep_notes();
  bool next_row();
  void check_speed();
  void leave_out(const Error& error);
  void finish_file() const;

  const Log& log_;
  std::span<const trajectory::Axis> axes_;
  double gap_, step_;
  std::size_t file_ = 0, repeated_ = 0, left_out_ = 0;
  std::string why_;
  std::vector<std::string> notes_;
  std::size_t rows_ = 0, bad_ = 0, fast_ = 0;  // of this file; successive rows that are too fast
  bool bad_last_ = false;
  std::optional<Error> first_bad_, jump_;
  std::vector<double> q_before_;
  std::unique_ptr<trajectory::RecordingReader> reader_;
  bool begins_ = false, fresh_ = true;
  double t_before_ = 0;
};

}  // namespace cotwin::measurement
