#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "models/trajectory/series/recording_reader.h"

namespace cotwin::measurement {

/// A log of a robot: one or several files of the same format, each with its own time.
struct Log {
  std::vector<std::filesystem::path> files;
  trajectory::RecordingFormat format;
};

/// Reads the files of a log in order, in memory for one sample. A gap in time and each file start a new segment; nothing is
/// interpolated or filtered across segments. Of rows with equal time the first one is used.
class LogReader {
 public:
  /// `gap`: s; a longer step starts a segment. Throws Error as RecordingReader, and for files without torques.
  LogReader(const Log& log, std::span<const trajectory::Axis> axes, double gap);

  /// Goes to the next sample; false at the end of the last file.
  bool next();
  /// True for the first sample of a segment.
  bool begins() const { return begins_; }
  std::size_t file() const { return file_; }
  std::size_t repeated() const { return repeated_; }  // rows so far with the time of the row before
  const trajectory::RecordingReader& sample() const { return *reader_; }

 private:
  bool open(std::size_t file);

  const Log& log_;
  std::span<const trajectory::Axis> axes_;
  double gap_;
  std::size_t file_ = 0, repeated_ = 0;
  std::unique_ptr<trajectory::RecordingReader> reader_;
  bool begins_ = false, fresh_ = true;
  double t_before_ = 0;
};

}  // namespace cotwin::measurement
