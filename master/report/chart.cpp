#include "master/report/chart.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "master/report/gnuplot.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master::plot {

namespace {

/// Colours that the colour-blind can tell apart (Okabe and Ito 2008); further curves are dashed.
constexpr std::array kColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000"};

const char* terminal_of(Format format) {
  switch (format) {
    case Format::kSvg:
      return "svg noenhanced background '#ffffff' font 'sans,12'";
    case Format::kPng:
      return "pngcairo noenhanced background '#ffffff' font 'sans,10'";
    case Format::kPdf:
      return "pdfcairo noenhanced background '#ffffff' font 'sans,8'";
  }
  return "";
}

std::string size_of(const Chart& chart, Format format) {
  const int height = chart.height > 0 ? chart.height : 60 + 240 * static_cast<int>(chart.panels.size());
  if (format != Format::kPdf) return std::to_string(chart.width) + "," + std::to_string(height);
  constexpr double kPerInch = 150;  // pixels
  return text::to_text(chart.width / kPerInch, 6) + "in," + text::to_text(height / kPerInch, 6) + "in";
}

}  // namespace

Curve thinned(Curve curve, std::size_t columns) {
  const std::size_t rows = curve.y.size();
  if (rows <= 4 * columns) return curve;
  Curve few;
  few.name = std::move(curve.name);
  for (std::size_t c = 0; c < columns; ++c) {
    const std::size_t begin = c * rows / columns, end = (c + 1) * rows / columns;
    std::size_t least = begin, greatest = begin, gap = end;
    for (std::size_t i = begin; i < end; ++i) {
      if (!std::isfinite(curve.y[i])) {
        if (gap == end) gap = i;
        continue;
      }
      if (!(curve.y[i] >= curve.y[least])) least = i;
      if (!(curve.y[i] <= curve.y[greatest])) greatest = i;
    }
    std::vector<std::size_t> kept = {begin, least, greatest, end - 1};
    if (gap != end) kept.push_back(gap);
    std::sort(kept.begin(), kept.end());
    kept.erase(std::unique(kept.begin(), kept.end()), kept.end());
    for (const std::size_t i : kept) {
      few.t.push_back(curve.t[i]);
      few.y.push_back(curve.y[i]);
    }
  }
  return few;
}

std::string script(const Chart& chart, Format format) {
  std::string all =
      "set encoding utf8\nset terminal " + std::string(terminal_of(format)) + " size " + size_of(chart, format) + "\n";
  double begin = std::numeric_limits<double>::infinity(), end = -begin;
  std::size_t number = 0, longest = 0;  // name
  for (const Panel& panel : chart.panels) {
    for (const Curve& curve : panel.curves) {
      longest = std::max(longest, curve.name.size());
      all += "$d" + std::to_string(number++) + " << END\n";
      for (std::size_t i = 0; i < curve.t.size(); ++i) {
        all += text::to_text(curve.t[i], 12) + " " + (std::isfinite(curve.y[i]) ? text::to_text(curve.y[i], 9) : "NaN") + "\n";
        begin = std::min(begin, curve.t[i]);
        end = std::max(end, curve.t[i]);
      }
      all += "END\n";
    }
  }
  if (begin < end) all += "set xrange [" + text::to_text(begin) + ":" + text::to_text(end) + "]\n";
  all += "set multiplot layout " + std::to_string(chart.panels.size()) + ",1 title " + report::Gnuplot::quoted(chart.title) +
         " noenhanced\n";
  all += "set grid lt 1 lc rgb '#cccccc'\nset key outside right top noenhanced\nset lmargin 12\n";
  all += "set rmargin " + std::to_string(std::min<std::size_t>(longest, 50) + 8) + "\n";  // characters, the same for all charts
  number = 0;
  for (std::size_t p = 0; p < chart.panels.size(); ++p) {
    const Panel& panel = chart.panels[p];
    all += "set ylabel " + report::Gnuplot::quoted(panel.unit) + " noenhanced\n";
    if (p + 1 == chart.panels.size()) all += "set xlabel 'time [s]'\n";
    all += "plot ";
    for (std::size_t i = 0; i < panel.curves.size(); ++i) {
      all += (i == 0 ? "" : ", ") + ("$d" + std::to_string(number++)) + " using 1:2 with lines lw 1.5 lc rgb '" +
             kColours[i % kColours.size()] + "' dt " + std::to_string(1 + i / kColours.size() % 5) + " title " +
             report::Gnuplot::quoted(panel.curves[i].name) + " noenhanced";
    }
    all += "\n";
  }
  return all + "unset multiplot\n";
}

std::string draw(const Chart& chart, Format format) {
  std::string picture = report::Gnuplot().run(script(chart, format));
  if (picture.empty()) throw Error("gnuplot", "ended without a picture and without an error");
  return picture;
}

}  // namespace cotwin::master::plot
