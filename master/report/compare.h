#pragma once
#include <string>
#include <vector>

#include "master/results/recording.h"

/// Differences of the signals of two recordings.
namespace cotwin::report {

/// A signal that both have: other − reference at the times of the reference, linear between the rows of the other.
struct SignalDifference {
  std::string name, unit;             // of a vector or a scalar
  std::vector<std::string> elements;  // names of columns
  std::vector<Curve> curves;          // as many
  /// Largest |difference| of all elements; NaN without common times.
  double largest() const;
};

struct RecordingComparison {
  std::vector<SignalDifference> signals;  // in the order of the reference
  std::size_t rows = 0;                   // of the reference, at times that both have
  double begin = 0, end = 0;              // s, of these
  std::vector<std::string> only_in_reference, only_in_other;
};

/// Reads both files again, row by row. Compares the plotted columns of `reference`. Throws Error if a file cannot be read.
RecordingComparison compare_recordings(const LoadedRecording& reference, const LoadedRecording& other);

}  // namespace cotwin::report
