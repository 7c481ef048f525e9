#include "models/trajectory/series/recording.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/series/recording_reader.h"

namespace cotwin::trajectory {

namespace {

void check_gaps(const Recording& recording, double max_gap) {
  const std::vector<double>& t = recording.q.t;
  const double median = median_step(t);
  for (std::size_t k = 1; k < t.size(); ++k) {
    if (t[k] - t[k - 1] > max_gap * median) {
      throw Error(recording.before + std::to_string(recording.lines[k]),
                  "a gap: " + text::to_text(t[k] - t[k - 1], 6) + " s after the sample on " + recording.row + " " +
                      std::to_string(recording.lines[k - 1]) + ", expected at most " + text::to_text(max_gap * median, 6) +
                      " s (max_gap, " + text::to_text(max_gap, 6) + " median steps)");
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
      throw Error(recording.before + std::to_string(recording.lines[k]) + ": column '" + names[j] + "'",
                  axes[j].name + " would be at " + text::to_text(value, 6) + " rad, expected " +
                      text::to_text(axes[j].q_min, 6) + " to " + text::to_text(axes[j].q_max, 6) +
                      " rad; are these degrees? Then angle = deg");
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
      throw Error(recording.before + std::to_string(recording.lines[k]) + ": column '" + names[j] + "'",
                  axes[j].name + " would have moved with " + text::to_text(speed, 6) + si + " since " + recording.row + " " +
                      std::to_string(recording.lines[k - 1]) + ", expected at most " + text::to_text(limit, 6) + si +
                      " (max_speed)" + (degrees ? "; are these degrees? Then angle = deg" : ""));
    }
  }
}

}  // namespace

Recording load_recording(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format) {
  RecordingReader reader(file, axes, format);
  Recording recording;
  recording.file = file.string();
  recording.row = reader.table().row();
  recording.before = reader.table().before();
  const std::array<const RecordingReader::Channel*, 4> channels = {&reader.q(), &reader.dq(), &reader.tau(), &reader.tau_e()};
  const std::array<Series*, 4> series = {&recording.q, &recording.dq, &recording.tau, &recording.tau_e};
  for (Series* s : series) s->width = axes.size();
  while (reader.next()) {
    recording.q.t.push_back(reader.t());
    recording.lines.push_back(reader.line());
    for (std::size_t c = 0; c < channels.size(); ++c)
      series[c]->x.insert(series[c]->x.end(), channels[c]->value.begin(), channels[c]->value.end());
  }
  recording.notes = reader.table().notes();
  if (recording.lines.size() < 2) {
    throw Error(recording.file, "holds " + std::to_string(recording.lines.size()) + " samples, expected at least two");
  }
  for (std::size_t c = 1; c < channels.size(); ++c) {
    if (channels[c]->present()) series[c]->t = recording.q.t;
  }
  check_gaps(recording, format.max_gap);
  std::vector<std::string> names;
  for (std::size_t j = 0; j < axes.size(); ++j) names.push_back(reader.name(reader.q(), j));
  if (format.angle_unit == 1) check_positions(recording, names, axes);
  check_speeds(recording, names, axes, format);
  return recording;
}

std::string time_unit_warning(const std::vector<double>& t) {
  constexpr double kSlowest = 0.1, kFastest = 1e-5;  // s: robots are logged at 10 Hz to 100 kHz
  const double step = t.size() < 2 ? kSlowest : median_step(t);
  if (step >= kFastest && step <= kSlowest) return "";
  const bool slow = step > kSlowest;
  return "its samples are " + text::to_text(step, 4) + " s apart, expected at " + (slow ? "most " : "least ") +
         text::to_text(slow ? kSlowest : kFastest) + " s; are its times in another unit (t_unit)?";
}

}  // namespace cotwin::trajectory
