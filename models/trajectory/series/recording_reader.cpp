#include "models/trajectory/series/recording_reader.h"

#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/columns.h"

namespace cotwin::trajectory {

namespace {

std::vector<double> values_or(const std::vector<double>& given, std::size_t n, double otherwise, const char* what) {
  if (given.empty()) return std::vector<double>(n, otherwise);
  if (given.size() != n)
    throw Error("recording", std::to_string(given.size()) + " values of " + what + ", expected " + std::to_string(n));
  return given;
}

}  // namespace

RecordingReader::RecordingReader(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format,
                                 bool equal_times)
    : file_(file.string()),
      csv_(csv::open(file, {format.separator, format.topic})),
      t_unit_(format.t_unit),
      rate_(format.rate),
      equal_times_(equal_times) {
  const std::size_t n = axes.size();
  const auto q_scale = values_or(format.q_scale, n, 1, "q_scale"), q_offset = values_or(format.q_offset, n, 0, "q_offset");
  const std::vector<double> zero(n, 0.0);
  std::vector<double> angle(n);
  for (std::size_t j = 0; j < n; ++j) angle[j] = q_scale[j] * (axes[j].revolute ? format.angle_unit : 1);
  auto tau_scale = values_or(format.tau_scale, n, 1, "tau_scale"),
       tau_e_scale = values_or(format.tau_e_scale, n, 1, "tau_e_scale");

  if (rate_ == 0) t_column_ = find_time_column(*csv_, file_, format.t_column);
  q_ = channel(format.q_columns, kPositions, axes, angle, q_offset);
  if (!q_.present())
    throw Error(file_,
                "has no columns of joint positions, expected 'q1', 'q2', … or their names in q_columns (cotwin tune and ask: "
                "--q-columns)" +
                    table_columns(csv_->names()));
  if (!format.theta_columns.empty()) theta_ = channel(format.theta_columns, kPositions, axes, angle, q_offset);
  dq_ = channel(format.dq_columns, kVelocities, axes, angle, zero);
  tau_ = channel(format.tau_columns, kTorques, axes, std::move(tau_scale), zero);
  tau_e_ = channel(format.tau_e_columns, kExternalTorques, axes, std::move(tau_e_scale), zero);
  std::vector<std::size_t> all;
  for (const Channel* one : {&q_, &theta_, &dq_, &tau_, &tau_e_})
    all.insert(all.end(), one->columns.begin(), one->columns.end());
  csv_->require(all);
}

RecordingReader::Channel RecordingReader::channel(const std::string& columns, const Quantity& quantity,
                                                  std::span<const Axis> axes, std::vector<double> factor,
                                                  std::vector<double> offset) const {
  Channel found{find_columns(*csv_, file_, columns, quantity, axes), std::move(factor), std::move(offset), {}};
  found.value.resize(found.columns.size());
  return found;
}

void RecordingReader::read(Channel& channel) const {
  for (std::size_t j = 0; j < channel.columns.size(); ++j) {
    const double value = csv_->real(channel.columns[j]);
    if (!std::isfinite(value))
      throw Error(csv_->place(channel.columns[j]), text::to_text(value) + ", expected a finite number");
    channel.value[j] = channel.factor[j] * value + channel.offset[j];
  }
}

// Returns the time since the first sample. Throws Error if it does not increase.
double RecordingReader::read_time() {
  if (rate_ > 0) return static_cast<double>(count_++) / rate_;
  const double raw = csv_->real(t_column_);
  if (!std::isfinite(raw)) throw Error(csv_->place(t_column_), text::to_text(raw) + ", expected a finite number");
  if (count_++ == 0) first_ = raw;
  // Subtracts before the conversion, so that epochs in nanoseconds keep their precision.
  const double t = (raw - first_) * t_unit_;
  if (count_ > 1 && !(t > t_) && !(equal_times_ && t == t_)) {
    const std::string before = csv_->row() + (" " + std::to_string(line_before_));
    throw Error(csv_->place(t_column_),
                t == t_ ? text::to_text(raw) + ", the same time as on " + before + ", expected a later one"
                        : text::to_text(raw) + " is before the time on " + before + ", expected increasing time");
  }
  return t;
}

bool RecordingReader::next() {
  if (!csv_->next()) return false;
  t_ = read_time();
  line_before_ = csv_->line();
  for (Channel* channel : {&q_, &dq_, &tau_, &tau_e_, &theta_}) read(*channel);
  return true;
}

}  // namespace cotwin::trajectory
