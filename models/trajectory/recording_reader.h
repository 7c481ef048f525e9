#pragma once
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "models/support/csv.h"
#include "models/trajectory/recording.h"

namespace cotwin::trajectory {

/// A recording sample by sample, in SI and in memory for one sample, so that recordings may be larger than memory. Throws Error
/// that names file, line and column for cells that are empty, not numbers or not finite, and for time that stands still or runs
/// backwards.
class RecordingReader {
 public:
  /// Opens the file and finds its columns. Throws Error for columns that are missing or not as many as joints. `equal_times`:
  /// a time may be that of the row before.
  RecordingReader(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format,
                  bool equal_times = false);

  /// Goes to the next sample; false at the end.
  bool next();
  double t() const { return t_; }  // s since the first sample
  std::size_t line() const { return csv_.line(); }

  /// The columns of one quantity and how their values become SI: factor · value + offset, joint by joint.
  struct Channel {
    std::vector<std::size_t> columns;  // empty where the file has none
    std::vector<double> factor, offset;
    std::vector<double> value;  // of the current sample, n or none
    bool present() const { return !columns.empty(); }
  };
  const Channel& q() const { return q_; }
  const Channel& dq() const { return dq_; }
  const Channel& tau() const { return tau_; }
  const Channel& tau_e() const { return tau_e_; }
  const Channel& theta() const { return theta_; }
  /// The header's name of a joint's column.
  const std::string& name(const Channel& channel, std::size_t joint) const { return csv_.names()[channel.columns[joint]]; }
  /// "log.csv:17", "log.csv:17: column 'tau3'"
  std::string place() const { return csv_.place(); }
  std::string place(const Channel& channel, std::size_t joint) const { return csv_.place(channel.columns[joint]); }

 private:
  Channel channel(const std::string& columns, const struct Quantity& quantity, std::span<const Axis> axes,
                  std::vector<double> factor, std::vector<double> offset) const;
  void read(Channel& channel) const;
  double read_time();

  std::string file_;
  csv::Reader csv_;
  double t_unit_, rate_;
  bool equal_times_;
  std::size_t t_column_ = 0;
  std::size_t count_ = 0, line_before_ = 0;
  double t_ = 0, first_ = 0;
  Channel q_, dq_, tau_, tau_e_, theta_;
};

}  // namespace cotwin::trajectory
