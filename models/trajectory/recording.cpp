#include "models/trajectory/recording.h"

#include <algorithm>
#include <cmath>

#include "models/text/csv.h"
#include "models/text/error.h"
#include "models/text/text.h"
#include "models/trajectory/columns.h"

namespace cotwin::trajectory {

namespace {

std::string number(double x) { return text::to_text(x, 6); }

/// Columns of one quantity and how their values become SI: factor · value + offset, joint by joint.
struct Channel {
  std::vector<std::size_t> columns;
  std::vector<double> factor, offset;
  Series* series;

  void read(const csv::Reader& reader) {
    for (std::size_t j = 0; j < columns.size(); ++j) {
      const double value = reader.real(columns[j]);
      if (!std::isfinite(value)) throw Error(reader.place(columns[j]), number(value) + ", expected a finite number");
      series->x.push_back(factor[j] * value + offset[j]);
    }
  }
};

std::vector<double> or_all(const std::vector<double>& given, std::size_t n, double otherwise, const char* what) {
  if (given.empty()) return std::vector<double>(n, otherwise);
  if (given.size() != n)
    throw Error("recording", std::to_string(given.size()) + " values of " + what + ", expected " + std::to_string(n));
  return given;
}

/// Time in s since the first sample; checked to run forwards.
class TimeColumn {
 public:
  TimeColumn(const csv::Reader& reader, const std::string& file, const RecordingFormat& format) : format_(format) {
    if (format.rate == 0) column_ = find_time_column(reader, file, format.t_column);
  }
  double next(const csv::Reader& reader) {
    if (format_.rate > 0) return static_cast<double>(count_++) / format_.rate;
    const double raw = reader.real(column_);
    if (!std::isfinite(raw)) throw Error(reader.place(column_), number(raw) + ", expected a finite number");
    if (count_++ == 0) first_ = raw;
    // The difference is taken before the conversion: epochs in nanoseconds keep what their digits hold.
    const double t = (raw - first_) * format_.t_unit;
    if (count_ > 1 && !(t > last_)) {
      throw Error(reader.place(column_), t == last_ ? text::to_text(raw) + ", the same time as on line " +
                                                          std::to_string(line_) + ", expected a later one"
                                                    : text::to_text(raw) + " is before the time on line " +
                                                          std::to_string(line_) + ", expected increasing time");
    }
    last_ = t;
    line_ = reader.line();
    return t;
  }

 private:
  const RecordingFormat& format_;
  std::size_t column_ = 0;
  std::size_t count_ = 0, line_ = 0;
  double first_ = 0, last_ = 0;
};

void check_gaps(const Recording& recording, double max_gap) {
  const std::vector<double>& t = recording.q.t;
  const double median = median_step(t);
  for (std::size_t k = 1; k < t.size(); ++k) {
    if (t[k] - t[k - 1] > max_gap * median) {
      throw Error(recording.file + ":" + std::to_string(recording.lines[k]),
                  "a gap: " + number(t[k] - t[k - 1]) + " s after the sample on line " +
                      std::to_string(recording.lines[k - 1]) + ", expected at most " + number(max_gap * median) +
                      " s (max_gap, " + number(max_gap) + " median steps)");
    }
  }
}

void check_positions(const Recording& recording, const std::vector<std::string>& names, std::span<const Axis> axes) {
  const Series& q = recording.q;
  for (std::size_t j = 0; j < q.width; ++j) {
    const double reach = std::max(std::abs(axes[j].q_min), std::abs(axes[j].q_max));
    for (std::size_t k = 0; axes[j].revolute && k < q.size(); ++k) {
      const double value = q.x[k * q.width + j];
      if (std::abs(value) <= 2 * reach) continue;
      throw Error(recording.file + ":" + std::to_string(recording.lines[k]) + ": column '" + names[j] + "'",
                  axes[j].name + " would be at " + number(value) + " rad, expected " + number(axes[j].q_min) + " to " +
                      number(axes[j].q_max) + " rad; are these degrees? Then angle = deg");
    }
  }
}

void check_speeds(const Recording& recording, const std::vector<std::string>& names, std::span<const Axis> axes,
                  const RecordingFormat& format) {
  const Series& q = recording.q;
  const std::size_t n = q.width;
  const double median = median_step(q.t);
  constexpr double kFactor = 4;      // noise and overshoot stay below, degrees (57) do not
  constexpr double kRevolute = 30;   // rad/s, beyond the joints of industrial arms
  constexpr double kPrismatic = 10;  // m/s
  for (std::size_t j = 0; j < n; ++j) {
    const bool known = std::isfinite(axes[j].dq_max);
    const double usual = known ? kFactor * axes[j].dq_max : axes[j].revolute ? kRevolute : kPrismatic;
    const double limit = format.max_speed > 0 ? format.max_speed : usual;
    for (std::size_t k = 1; k < q.size(); ++k) {
      const double speed = std::abs(q.x[k * n + j] - q.x[(k - 1) * n + j]) / std::max(q.t[k] - q.t[k - 1], median);
      if (speed <= limit) continue;
      const std::string si = axes[j].revolute ? " rad/s" : " m/s";
      const bool degrees = axes[j].revolute && format.angle_unit == 1;
      throw Error(recording.file + ":" + std::to_string(recording.lines[k]) + ": column '" + names[j] + "'",
                  axes[j].name + " would have moved with " + number(speed) + si + " since line " +
                      std::to_string(recording.lines[k - 1]) + ", expected at most " + number(limit) + si + " (max_speed)" +
                      (degrees ? "; are these degrees? Then angle = deg" : ""));
    }
  }
}

}  // namespace

Recording load_recording(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format) {
  csv::Reader reader(file, {format.separator});
  Recording recording;
  recording.file = file.string();
  const std::size_t n = axes.size();
  const auto q_scale = or_all(format.q_scale, n, 1, "q_scale"), q_offset = or_all(format.q_offset, n, 0, "q_offset");
  const std::vector<double> zero(n, 0.0);
  std::vector<double> angle(n);
  for (std::size_t j = 0; j < n; ++j) angle[j] = q_scale[j] * (axes[j].revolute ? format.angle_unit : 1);

  TimeColumn time(reader, recording.file, format);
  std::vector<Channel> channels;
  const auto add = [&](const std::string& columns, const Quantity& quantity, std::vector<double> factor,
                       std::vector<double> offset, Series& series) {
    const auto found = find_columns(reader, recording.file, columns, quantity, axes);
    if (!found.empty()) channels.push_back({found, std::move(factor), std::move(offset), &series});
    series.width = n;
  };
  add(format.q_columns, kPositions, angle, q_offset, recording.q);
  if (channels.empty())
    throw Error(recording.file, "has no columns of joint positions, expected 'q1', 'q2', … or their names in q_columns");
  add(format.dq_columns, kVelocities, angle, zero, recording.dq);
  add(format.tau_columns, kTorques, or_all(format.tau_scale, n, 1, "tau_scale"), zero, recording.tau);
  add(format.tau_e_columns, kExternalTorques, or_all(format.tau_e_scale, n, 1, "tau_e_scale"), zero, recording.tau_e);

  while (reader.next()) {
    recording.q.t.push_back(time.next(reader));
    recording.lines.push_back(reader.line());
    for (Channel& channel : channels) channel.read(reader);
  }
  if (recording.lines.size() < 2) {
    throw Error(recording.file, "holds " + std::to_string(recording.lines.size()) + " samples, expected at least two");
  }
  for (Channel& channel : channels) channel.series->t = recording.q.t;
  check_gaps(recording, format.max_gap);
  std::vector<std::string> names;
  for (const std::size_t c : channels.front().columns) names.push_back(reader.names()[c]);
  if (format.angle_unit == 1) check_positions(recording, names, axes);
  check_speeds(recording, names, axes, format);
  return recording;
}

}  // namespace cotwin::trajectory
