#include "master/report/compare.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

namespace cotwin::report {

double SignalDifference::largest() const {
  double most = std::numeric_limits<double>::quiet_NaN();
  for (const Curve& curve : curves) {
    if (curve.figures().count > 0) most = std::fmax(most, curve.figures().largest());
  }
  return most;
}

namespace {

/// Values of a recording at increasing times, linear between its rows.
class Interpolated {
 public:
  Interpolated(const LoadedRecording& recording, std::vector<std::size_t> columns)
      : reader_(recording.file, recording.time),
        columns_(std::move(columns)),
        before_(columns_.size()),
        after_(columns_.size()) {
    there_ = take();
    if (there_) read_more();
  }
  /// Whether the recording has rows on both sides of t.
  bool move_to(double t) {
    if (!there_) return false;
    while (t > t_after_ && more_) read_more();
    return t >= t_before_ && t <= t_after_;
  }
  double value(std::size_t k, double t) const {
    if (t == t_after_ || t_after_ <= t_before_) return after_[k];
    if (t == t_before_) return before_[k];
    const double share = (t - t_before_) / (t_after_ - t_before_);
    return (1 - share) * before_[k] + share * after_[k];
  }

 private:
  bool take() {
    if (!reader_.next()) return false;
    std::swap(before_, after_);
    t_before_ = t_after_;
    t_after_ = reader_.t();
    for (std::size_t k = 0; k < columns_.size(); ++k) after_[k] = reader_.value(columns_[k]);
    return true;
  }
  void read_more() {
    more_ = take();
    if (!more_ && !twice_) t_before_ = t_after_, before_ = after_;  // a recording of one row
    twice_ = true;
  }

  RowReader reader_;
  std::vector<std::size_t> columns_;
  std::vector<double> before_, after_;
  double t_before_ = 0, t_after_ = 0;
  bool there_ = false, more_ = true, twice_ = false;
};

}  // namespace

RecordingComparison compare_recordings(const LoadedRecording& reference, const LoadedRecording& other) {
  RecordingComparison comparison;
  RowReader reader(reference.file, reference.time, {}, reference.facts);
  const std::vector<std::string> others = RowReader(other.file, other.time, {}, other.facts).names();
  std::unordered_map<std::string_view, std::size_t> index;
  for (std::size_t i = 0; i < others.size(); ++i) index.emplace(others[i], i);
  std::vector<std::size_t> mine, theirs;
  std::vector<std::pair<std::size_t, std::size_t>> places;  // signal and element
  std::vector<bool> common(others.size(), false);
  for (const ColumnGroup& group : reference.groups) {
    SignalDifference difference{group.name, group.unit, {}, {}};
    for (const std::size_t column : group.columns) {
      const RecordedColumn& recorded = reference.columns[column];
      const auto found = index.find(recorded.name);
      if (found == index.end()) {
        comparison.only_in_reference.push_back(recorded.name);
        continue;
      }
      common[found->second] = true;
      if (!recorded.plotted) continue;
      mine.push_back(column);
      theirs.push_back(found->second);
      places.emplace_back(comparison.signals.size(), difference.elements.size());
      difference.elements.push_back(recorded.name);
      difference.curves.emplace_back();
    }
    if (!difference.elements.empty()) comparison.signals.push_back(std::move(difference));
  }
  for (std::size_t i = 0; i < others.size(); ++i) {
    if (!common[i]) comparison.only_in_other.push_back(others[i]);
  }
  Interpolated values(other, theirs);
  while (reader.next()) {
    const double t = reader.t();
    if (!values.move_to(t)) continue;
    if (comparison.rows++ == 0) comparison.begin = t;
    comparison.end = t;
    for (std::size_t k = 0; k < mine.size(); ++k)
      comparison.signals[places[k].first].curves[places[k].second].add(t, values.value(k, t) - reader.value(mine[k]));
  }
  return comparison;
}

}  // namespace cotwin::report
