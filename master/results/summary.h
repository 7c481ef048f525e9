#pragma once
#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "master/run/master.h"

/// Writes the summary of a run as text and as JSON.
namespace cotwin::master {

/// Elements of a vector with the same unit of measure.
struct ElementKind {
  std::string si;
  std::vector<std::size_t> elements;  // from 0

  /// The figures of these elements of `all`.
  std::vector<double> of(const std::vector<double>& all) const;
};
/// All kinds, by their first elements. `si`: of all where `elements` has no other.
std::vector<ElementKind> kinds_of(const std::string& si, const Elements& elements, std::size_t size);
/// The RMS over all elements from the RMS of each, of equal numbers of samples.
double joined_rms(const std::vector<double>& rms);
/// The largest number; NaN of none.
double largest_of(const std::vector<double>& values);

struct Outcome {
  enum class State : std::uint8_t { kDone, kInterrupted, kFailed };
  State state = State::kDone;
  std::string message;  // the reason, unless kDone
};

/// "3.2 us", "41 ms", "12 s".
std::string duration(double seconds);

/// Writes tables with lines of at most 100 characters if the vectors allow it.
void write_report(std::ostream& out, const Summary& summary, const Outcome& outcome);

/// Writes the whole summary as one JSON object. Numbers that are not finite become null.
void write_json(std::ostream& out, const Summary& summary, const Outcome& outcome);

}  // namespace cotwin::master
