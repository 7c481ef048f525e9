#pragma once
#include <string>
#include <utility>
#include <vector>

#include "master/report/gnuplot.h"
#include "master/results/curve.h"

/// Curves over time as SVG, drawn by gnuplot and cleaned for a page.
namespace cotwin::report {

/// Number of styles (colour and dashes) of curves, the classes k0 … of page.css.
inline constexpr std::size_t kStyles = 8;

struct Line {
  std::string name;           // for the key
  std::vector<Point> points;  // NaN: interrupted
  std::size_t style = 0;      // below kStyles
};

struct Plot {
  std::string description;  // for those who do not see it
  std::string x_label = "t [s]", y_label;
  std::vector<Line> lines;
  std::vector<std::pair<double, double>> shaded;  // intervals of x
  bool log_y = false;
  double width = 760, height = 240;  // units of the SVG
};

/// Whether the plot has a point to draw.
bool has_points(const Plot& plot);

/// The SVG element: paths, lines and text with classes of page.css, without ids, styles, scripts and links. Curves are simplified
/// to 0.2 units. Throws Error if gnuplot fails; the plot must have points.
std::string draw(const Gnuplot& gnuplot, Plot plot);

/// The key of the lines with their names, as an HTML list.
std::string keys(const std::vector<Line>& lines);

/// Parses an SVG by gnuplot and writes it again from the elements, attributes and values that plots consist of; everything else
/// is left out. Throws Error for text that is not XML.
std::string cleaned_svg(const std::string& svg, const std::string& description);

}  // namespace cotwin::report
