#pragma once
#include <span>
#include <string>

#include "master/report/gnuplot.h"
#include "master/report/page.h"
#include "master/report/plot.h"
#include "master/results/results.h"
#include "master/results/summary.h"

/// The parts of a page.
namespace cotwin::report {

/// Draws plots on a page. What cannot be drawn becomes a note.
class Artist {
 public:
  Artist(Page& page, const Gnuplot& gnuplot) : page_(page), gnuplot_(gnuplot) {}
  /// `caption_html`: above the plot; the key is below it. Without gnuplot and without points nothing is written.
  void plot(Plot plot, const std::string& caption_html);

 private:
  Page& page_;
  const Gnuplot& gnuplot_;
};

/// A run: its outcome, figures, contacts, residuals, signals, energy, events, parameters, time of the units; origin and machine come last.
void write_run(Page& page, const Results& results, const Gnuplot& gnuplot);

/// A tuning: errors, torques before and after, parameters, convergence, data and settings.
void write_tuning(Page& page, const Results& results, const Gnuplot& gnuplot);

/// Several runs or tunings beside each other; the first one is the reference.
void write_comparison(Page& page, std::span<const Results> all, const Gnuplot& gnuplot);

/// The table of recorded figures of a group of columns, and one plot for each eight of them.
void write_group(Page& page, const LoadedRecording& recording, const ColumnGroup& group, const Gnuplot& gnuplot);

/// The joint's name of a column, or as below.
std::string element_of(const RecordedColumn& column);
/// The name of the joint of "drive.q[3]", "[3]" if it has none; of a scalar the name without its component.
std::string element_of(const LoadedRecording& recording, const std::string& name);

/// The kinds of elements of an entry of a summary with `size` elements.
std::vector<master::ElementKind> kinds_of(const json& entry, std::size_t size);

/// The state of a run in words, and whether it is one to worry about.
struct RunState {
  std::string words;
  bool good = true;
};
RunState state_of(const Results& results);

}  // namespace cotwin::report
