#pragma once
#include <string>
#include <vector>

/// Charts of recorded signals, drawn by gnuplot (master/report/gnuplot.h).
namespace cotwin::master::plot {

struct Curve {
  std::string name;
  std::vector<double> t, y;  // of equal length; NaN interrupts the curve
};

/// Curves over a common time axis.
struct Panel {
  std::string unit;  // of measure; "": none
  std::vector<Curve> curves;
};

enum class Format { kSvg, kPng, kPdf };

struct Chart {
  std::string title;
  std::vector<Panel> panels;     // from top to bottom
  int width = 1000, height = 0;  // pixels; height 0: by the number of panels
};

/// At most about four points per column of a picture `columns` wide: the first, the last, the least and the greatest of the rows
/// of each column, and a NaN where there is one.
Curve thinned(Curve curve, std::size_t columns);

/// The commands with the data.
std::string script(const Chart& chart, Format format);

/// Returns the picture. Throws Error as report::Gnuplot::run().
std::string draw(const Chart& chart, Format format);

}  // namespace cotwin::master::plot
