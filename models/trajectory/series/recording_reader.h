#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "models/foundation/formats/csv.h"
#include "models/trajectory/series/recording.h"

namespace cotwin::trajectory {

/// Reads a recording (CSV or ROS bag) sample by sample, in SI, with one sample in memory, so that recordings may exceed the memory. Throws Error
/// with file, line and column for cells that are empty, not numbers or not finite, and for times that do not increase.
class RecordingReader {
 public:
  /// Opens the file and finds its columns. Throws Error if columns are missing or their number differs from that of the joints.
  /// `equal_times`: a time may equal that of the previous row.
  RecordingReader(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format,
                  bool equal_times = false);

  /// Reads the next sample; false at the end.
  bool next();
  double t() const { return t_; }                    // s since the first sample,
  double begin() const { return first_ * t_unit_; }  // whose time in the file this is
  std::size_t line() const { return csv_->line(); }
  const csv::Source& table() const { return *csv_; }

  /// The columns of one quantity and the conversion of their values to SI: factor · value + offset, per joint.
  struct Channel {
    std::vector<std::size_t> columns;  // empty if the file has none
    std::vector<double> factor, offset;
    std::vector<double> value;  // of the current sample; n or 0 elements
    bool present() const { return !columns.empty(); }
  };
  const Channel& q() const { return q_; }
  const Channel& dq() const { return dq_; }
  const Channel& tau() const { return tau_; }
  const Channel& tau_e() const { return tau_e_; }
  const Channel& theta() const { return theta_; }
  const std::vector<std::string>& names() const { return csv_->names(); }
  /// Name of a joint's column in the header.
  const std::string& name(const Channel& channel, std::size_t joint) const { return csv_->names()[channel.columns[joint]]; }
  /// "log.csv:17", "log.csv:17: column 'tau3'"
  std::string place() const { return csv_->place(); }
  std::string place(const Channel& channel, std::size_t joint) const { return csv_->place(channel.columns[joint]); }

 private:
  Channel channel(const std::string& columns, const struct Quantity& quantity, std::span<const Axis> axes,
                  std::vector<double> factor, std::vector<double> offset) const;
  void read(Channel& channel) const;
  double read_time();

  std::string file_;
  std::unique_ptr<csv::Source> csv_;
  double t_unit_, rate_;
  bool equal_times_;
  std::size_t t_column_ = 0;
  std::size_t count_ = 0, line_before_ = 0;
  double t_ = 0, first_ = 0;
  Channel q_, dq_, tau_, tau_e_, theta_;
};

}  // namespace cotwin::trajectory
