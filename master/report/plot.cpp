#include "master/report/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "master/report/page.h"
#include "models/foundation/formats/xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

constexpr double kTolerance = 0.2;                        // units of the SVG
constexpr double kDot = 2;                                // units: length of a point without neighbours
constexpr double kMargins = 90, kHighMargins = 60;        // of the axes, about
constexpr double kLargest = 1e300;                        // beyond, gnuplot's ranges overflow
constexpr std::size_t kMostShaded = 400;                  // intervals
constexpr int kAxis = 1, kGrid = 2, kShade = 3, kK = 10;  // colours rgb(n, n, n) of the script that stand for classes

std::string rgb(int n) {
  char text[16];
  std::snprintf(text, sizeof text, "'#%02x%02x%02x'", n, n, n);
  return text;
}

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double x) {
    low = std::min(low, x);
    high = std::max(high, x);
  }
  double width() const { return high - low; }
};

std::pair<Range, Range> ranges_of(const Plot& plot) {
  Range x, y;
  for (const Line& line : plot.lines) {
    for (const Point& p : line.points) {
      if (std::isnan(p.y)) continue;
      x.add(p.t);
      y.add(p.y);
    }
  }
  return {x, y};
}

bool drawable(const Plot& plot, const Point& p) {
  return std::isfinite(p.t) && std::isfinite(p.y) && std::abs(p.t) < kLargest && std::abs(p.y) < kLargest &&
         (!plot.log_y || p.y > 0);
}

void append_number(std::string& out, double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", value);
  out += text;
}

void append_point(std::string& out, double t, double y) {
  append_number(out, t);
  out += ' ';
  append_number(out, y);
  out += '\n';
}

std::string script_of(const Plot& plot, double x_offset) {
  const auto [x, y] = ranges_of(plot);
  std::string s = "set encoding utf8\nset terminal svg noenhanced size " + text::to_text(plot.width) + "," +
                  text::to_text(plot.height) + " font 'Arial,11' linewidth 1\n";
  s += "set border 3 linecolor rgb " + rgb(kAxis) + "\nset tics nomirror textcolor rgb " + rgb(kAxis) +
       "\nset grid xtics ytics linetype 1 linecolor rgb " + rgb(kGrid) + "\nset key off\n";
  const auto label = [&](const char* axis, const std::string& what) {
    if (!what.empty())
      s += std::string("set ") + axis + "label " + Gnuplot::quoted(what) + " textcolor rgb " + rgb(kAxis) + "\n";
  };
  label("x", plot.x_label);
  label("y", plot.y_label);
  if (plot.log_y) s += "set logscale y\n";
  const double x_margin = x.width() > 0 ? 0 : std::max(0.5, 0.01 * std::abs(x.high));
  s += "set xrange [";
  append_number(s, x.low - x_offset - x_margin);
  s += ":";
  append_number(s, x.high - x_offset + x_margin);
  s += "]\n";
  if (!plot.log_y) {
    // A constant signal gets a range of its own, so that rounding is not drawn.
    const double size = std::max(std::abs(y.low), std::abs(y.high));
    const double margin = y.width() > 1e-12 * size ? 0.04 * y.width() : (size > 0 ? 0.1 * size : 1);
    s += "set yrange [";
    append_number(s, y.low - margin);
    s += ":";
    append_number(s, y.high + margin);
    s += "]\n";
  }
  int object = 0;
  for (const auto& [from, to] : plot.shaded) {
    if (static_cast<std::size_t>(object) == kMostShaded) break;
    const double a = std::max(from, x.low), b = std::min(to, x.high);
    if (!(a <= b)) continue;
    s += "set object " + std::to_string(++object) + " rectangle from ";
    append_number(s, a - x_offset);
    s += ",graph 0 to ";
    append_number(s, b - x_offset);
    s += ",graph 1 behind fillcolor rgb " + rgb(kShade) + " fillstyle solid 1 noborder\n";
  }
  const double dot = kDot * (x.width() + 2 * x_margin) / plot.width;
  for (std::size_t i = 0; i < plot.lines.size(); ++i) {
    s += "$d" + std::to_string(i) + " << EOD\n";
    const std::vector<Point>& points = plot.lines[i].points;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const bool alone = (k == 0 || std::isnan(points[k - 1].y)) && (k + 1 == points.size() || std::isnan(points[k + 1].y));
      if (!std::isnan(points[k].y)) append_point(s, points[k].t - x_offset, points[k].y);
      if (!std::isnan(points[k].y) && alone) append_point(s, points[k].t - x_offset + dot, points[k].y);
      if (std::isnan(points[k].y)) s += '\n';
    }
    s += "EOD\n";
  }
  s += "plot ";
  for (std::size_t i = 0; i < plot.lines.size(); ++i) {
    s += std::string(i > 0 ? ", " : "") + "$d" + std::to_string(i) + " using 1:2 with lines linewidth 1 linecolor rgb " +
         rgb(kK + static_cast<int>(plot.lines[i].style % kStyles));
  }
  return s + "\n";
}

/// The class that the colour rgb(n, n, n) stands for; "" for other colours.
std::string class_of(const std::string& colour) {
  int r = -1, g = -1, b = -1;
  if (std::sscanf(colour.c_str(), "rgb(%d,%d,%d)", &r, &g, &b) != 3 || r != g || g != b) return "";
  if (r == kAxis) return "axis";
  if (r == kGrid) return "grid";
  if (r == kShade) return "shade";
  const int style = r - kK;
  return style >= 0 && style < static_cast<int>(kStyles) ? "k k" + std::to_string(style) : "";
}

/// A list of numbers and the letters of `letters`, with numbers rounded to tenths; nothing for other text.
std::optional<std::string> rounded(std::string_view text, std::string_view letters) {
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == ' ' || c == ',' || c == '\t' || c == '\n') {
      ++i;
    } else if (letters.find(c) != std::string_view::npos) {
      if (c != 'L') out += c;  // more points after a point are lines
      ++i;
    } else {
      const std::size_t end = std::min(text.find_first_not_of("0123456789.-+e", i), text.size());
      const std::optional<double> value = end > i ? text::parse_real(text.substr(i, end - i)) : std::nullopt;
      if (!value || !std::isfinite(*value) || std::abs(*value) > 1e6) return std::nullopt;
      const double tenths = std::round(10 * *value);
      if (!out.empty() && tenths >= 0 && letters.find(out.back()) == std::string_view::npos) out += ' ';
      const auto whole = static_cast<long>(std::abs(tenths));
      out += (tenths < 0 ? "-" : "") + std::to_string(whole / 10);
      if (whole % 10 != 0) out += "." + std::to_string(whole % 10);
      i = end;
    }
  }
  return out;
}

std::string attribute(const xml::Element& element, std::string_view name) {
  const std::string* value = xml::find(element, name);
  return value == nullptr ? "" : *value;
}

std::string position_of(const xml::Element& group) {
  const std::string transform = attribute(group, "transform");
  double x = 0, y = 0, angle = 0;
  const int found = std::sscanf(transform.c_str(), "translate(%lf,%lf) rotate(%lf)", &x, &y, &angle);
  if (found < 2 || !std::isfinite(x + y + angle)) return "";
  std::string out = "translate(" + rounded(text::to_text(x, 7), "").value_or("0") + " " +
                    rounded(text::to_text(y, 7), "").value_or("0") + ")";
  if (found == 3) out += " rotate(" + std::to_string(std::lround(angle)) + ")";
  return out;
}

class Cleaner {
 public:
  explicit Cleaner(std::string& out) : out_(out) {}

  void element(const xml::Element& e, const xml::Element* group, std::string stroke) {
    if (e.name == "defs" || e.name == "title" || e.name == "desc") return;
    if (const std::string own = attribute(e, "stroke"); !own.empty()) stroke = own;
    if (e.name == "path") path(e, stroke);
    if (e.name == "polygon") polygon(e);
    if (e.name == "text" && group != nullptr) text(e, *group);
    for (const xml::Element& child : e.children) element(child, e.name == "g" ? &e : group, stroke);
  }

 private:
  void path(const xml::Element& e, const std::string& stroke) {
    const std::string style = class_of(stroke);
    const std::optional<std::string> d = rounded(attribute(e, "d"), "MLZz");
    if (style.empty() || !d || d->empty()) return;
    out_ += "<path class=\"" + style + "\" d=\"" + *d + "\"/>\n";
  }
  void polygon(const xml::Element& e) {
    const std::string style = class_of(attribute(e, "fill"));
    const std::optional<std::string> points = rounded(attribute(e, "points"), "");
    if (style != "shade" || !points || points->empty()) return;
    out_ += "<polygon class=\"shade\" points=\"" + *points + "\"/>\n";
  }
  void text(const xml::Element& e, const xml::Element& group) {
    const std::string place = position_of(group), anchor = attribute(group, "text-anchor");
    if (place.empty() || e.content.empty()) return;
    out_ += "<text class=\"faint\" transform=\"" + place + "\" font-size=\"11\"";
    if (anchor == "middle" || anchor == "end") out_ += " text-anchor=\"" + anchor + "\"";
    out_ += ">" + escaped(e.content) + "</text>\n";
  }
  std::string& out_;
};

/// Makes room for rounding: times such as 1700000000.25 s are drawn from their beginning on.
double offset_of(const Range& x) {
  const double size = std::max(std::abs(x.low), std::abs(x.high));
  return x.width() > 0 && size > 1e4 * x.width() ? std::floor(x.low) : 0;
}

}  // namespace

bool has_points(const Plot& plot) {
  return std::ranges::any_of(plot.lines, [&](const Line& line) {
    return std::ranges::any_of(line.points, [&](const Point& p) { return drawable(plot, p); });
  });
}

std::string draw(const Gnuplot& gnuplot, Plot plot) {
  for (Line& line : plot.lines) {
    for (Point& p : line.points) {
      if (!drawable(plot, p)) p.y = std::numeric_limits<double>::quiet_NaN();
      if (!std::isfinite(p.t)) p.t = 0;
    }
  }
  const auto [x, y] = ranges_of(plot);
  const double x_scale = x.width() > 0 ? (plot.width - kMargins) / x.width() : 0;
  const double y_scale = y.width() > 0 ? (plot.height - kHighMargins) / y.width() : 0;
  if (!plot.log_y) {
    for (Line& line : plot.lines) line.points = simplified(line.points, x_scale, y_scale, kTolerance);
  }
  std::erase_if(plot.lines, [](const Line& line) {
    return std::ranges::all_of(line.points, [](const Point& p) { return std::isnan(p.y); });
  });
  const double offset = offset_of(x);
  if (offset != 0) plot.x_label += ", from " + text::to_text(offset) + " on";
  return cleaned_svg(gnuplot.run(script_of(plot, offset)), plot.description);
}

std::string keys(const std::vector<Line>& lines) {
  std::string out = "<ul class=\"keys\">";
  for (const Line& line : lines) {
    out += "<li><svg viewBox=\"0 0 44 14\" aria-hidden=\"true\"><path class=\"k k" + std::to_string(line.style % kStyles) +
           "\" d=\"M0 7 44 7\"/></svg>" + code(line.name) + "</li>";
  }
  return out + "</ul>";
}

std::string cleaned_svg(const std::string& svg, const std::string& description) {
  // The document type of other versions of gnuplot has no meaning here and would be refused.
  const std::size_t begin = svg.find("<svg");
  if (begin == std::string::npos) throw Error("gnuplot", "wrote no SVG");
  const xml::Element root = xml::parse(std::string_view(svg).substr(begin), "gnuplot");
  std::array<double, 4> box{};
  if (std::sscanf(attribute(root, "viewBox").c_str(), "%lf %lf %lf %lf", &box[0], &box[1], &box[2], &box[3]) != 4 ||
      !(box[2] > 0 && box[3] > 0))
    throw Error("gnuplot", "wrote an SVG without a viewBox");
  std::string out = "<svg class=\"plot\" viewBox=\"0 0 " + text::to_text(box[2]) + " " + text::to_text(box[3]) +
                    "\" role=\"img\" aria-label=\"" + escaped(description, 300) + "\">\n";
  Cleaner(out).element(root, nullptr, "");
  return out + "</svg>";
}

}  // namespace cotwin::report
