#include "master/report/energy_flow.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "master/report/page.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

/// Sums over the elements of variables: "meter.copper" → J.
using Ends = std::map<std::string, double>;

Ends ends_of(const Results& results) {
  Ends ends;
  if (const json& end = member(results.summary, "end"); end.is_object()) {
    for (const auto& [name, entry] : end.items()) {
      double sum = 0;
      for (const double value : numbers_of(member(entry, "values"))) sum += value;
      ends[name] = sum;
    }
    return ends;
  }
  if (!results.recording) return ends;
  for (const RecordedColumn& column : results.recording->columns) {
    const Figures& figures = column.curve.figures();
    if (figures.count > 0) ends[vector_of(column.name)] += figures.last;
  }
  return ends;
}

/// A flow into the link that may be negative: then it is one out of it, under another name.
void add(EnergyFlow& flow, double joules, const char* as_source, const char* as_sink) {
  if (joules > 0) flow.sources.push_back({as_source, joules});
  if (joules < 0) flow.sinks.push_back({as_sink, -joules});
}

}  // namespace

std::vector<EnergyFlow> energy_flows(const Results& results) {
  const Ends ends = ends_of(results);
  std::vector<EnergyFlow> flows;
  constexpr std::string_view kDrawn = ".drawn";
  for (const auto& [name, drawn] : ends) {
    if (!name.ends_with(kDrawn)) continue;
    EnergyFlow flow;
    flow.component = name.substr(0, name.size() - kDrawn.size());
    const auto value = [&](const char* entry) -> std::optional<double> {
      const auto found = ends.find(flow.component + "." + entry);
      return found == ends.end() || !std::isfinite(found->second) ? std::nullopt : std::optional(found->second);
    };
    const std::optional<double> positive = value("work_positive"), negative = value("work_negative"), idle = value("idle"),
                                copper = value("copper"), converter = value("converter"), iron = value("iron"),
                                chopped = value("chopped"), stored = value("stored"), losses = value("supply_losses"),
                                controller = value("controller_energy");
    const bool complete =
        std::isfinite(drawn) && positive && negative && idle && copper && converter && iron && chopped && losses && controller;
    if (!complete) continue;
    flow.drawn = drawn;
    flow.motor_work = *positive + *negative;
    flow.friction = value("friction");
    flow.residual = value("residual");
    flow.cost = value("cost");
    flow.co2 = value("co2");
    add(flow, drawn, "mains", "back to the mains");
    add(flow, -*negative, "motors that brake", "motors that brake");
    add(flow, -stored.value_or(0), "capacitor", "capacitor");
    add(flow, -*positive, "motors that drive", "motors that drive");
    add(flow, -*copper, "windings", "windings (copper)");
    add(flow, -*converter, "converters", "converters");
    add(flow, -*iron, "iron", "iron");
    add(flow, -*idle, "stand-by", "stand-by and brakes");
    add(flow, -*chopped, "brake resistors", "brake resistors");
    add(flow, -*losses, "supply", "losses of the supply");
    add(flow, -*controller, "controller", "controller");
    flows.push_back(std::move(flow));
  }
  return flows;
}

namespace {

constexpr double kWidth = 760, kLeft = 250, kRight = 500, kBar = 14, kTop = 12, kFlowHeight = 200, kLeastLabel = 17;

double total_of(const std::vector<FlowEntry>& entries) {
  double sum = 0;
  for (const FlowEntry& entry : entries) sum += entry.joules;
  return sum;
}

std::string coordinate(double value) { return text::to_text(std::round(10 * value) / 10, 7); }

/// One side of the picture: bands between the bar in the middle and the entries, whose labels do not overlap.
class Side {
 public:
  Side(std::string& out, bool left, double scale, double total) : out_(out), left_(left), scale_(scale), total_(total) {}

  void band(const FlowEntry& entry, std::size_t style) {
    const double height = scale_ * entry.joules, outer = std::max(outer_, label_ - 0.5 * height + 6);
    const double x0 = left_ ? kLeft : kRight, x1 = 0.5 * kWidth + (left_ ? -0.5 : 0.5) * kBar, bend = 0.5 * (x0 + x1);
    const auto curve = [&](double from_x, double from_y, double to_x, double to_y) {
      return coordinate(from_x) + " " + coordinate(from_y) + "C" + coordinate(bend) + " " + coordinate(from_y) + " " +
             coordinate(bend) + " " + coordinate(to_y) + " " + coordinate(to_x) + " " + coordinate(to_y);
    };
    const std::string fill = "f" + std::to_string(style % 8);
    out_ += "<path class=\"ribbon " + fill + "\" d=\"M" + curve(x0, outer, x1, inner_) + "L" +
            curve(x1, inner_ + height, x0, outer + height) + "Z\"/>\n";
    const double bar = left_ ? x0 - 5 : x0;
    out_ += "<rect class=\"" + fill + "\" x=\"" + coordinate(bar) + "\" y=\"" + coordinate(outer) + "\" width=\"5\" height=\"" +
            coordinate(std::max(height, 0.8)) + "\"/>\n";
    const double middle = outer + 0.5 * height + 4;
    out_ += "<text x=\"" + coordinate(left_ ? x0 - 10 : x0 + 10) + "\" y=\"" + coordinate(middle) + "\" font-size=\"12\"" +
            (left_ ? " text-anchor=\"end\"" : "") + ">" + escaped(entry.name) + " " + escaped(number(entry.joules)) + " J (" +
            escaped(number(100 * entry.joules / total_, 3)) + " %)</text>\n";
    inner_ += height;
    outer_ = outer + height + 2;
    label_ = middle - 4 + kLeastLabel - 6;
  }
  double bottom() const { return std::max(outer_, label_ + 6); }

 private:
  std::string& out_;
  bool left_;
  double scale_, total_;
  double inner_ = kTop, outer_ = kTop, label_ = kTop;  // next y at the bar, at the entries, of a label
};

std::vector<FlowEntry> by_size(std::vector<FlowEntry> entries) {
  std::ranges::stable_sort(entries, std::greater{}, &FlowEntry::joules);
  return entries;
}

}  // namespace

std::string flow_svg(const EnergyFlow& flow) {
  const double total = std::max(total_of(flow.sources), total_of(flow.sinks));
  if (!(total > 0) || !std::isfinite(total)) return "";
  std::string bands;
  Side sources(bands, true, kFlowHeight / total, total), sinks(bands, false, kFlowHeight / total, total);
  std::size_t style = 0;
  for (const FlowEntry& entry : by_size(flow.sources)) sources.band(entry, style++);
  for (const FlowEntry& entry : by_size(flow.sinks)) sinks.band(entry, style++);
  const double height = std::max({sources.bottom(), sinks.bottom(), kTop + kFlowHeight}) + 8;
  return "<svg class=\"flow\" viewBox=\"0 0 " + coordinate(kWidth) + " " + coordinate(height) +
         "\" role=\"img\" aria-label=\"Energy from its sources through the DC link to its sinks\">\n" + bands +
         "<rect class=\"f6\" x=\"" + coordinate(0.5 * (kWidth - kBar)) + "\" y=\"" + coordinate(kTop) + "\" width=\"" +
         coordinate(kBar) + "\" height=\"" + coordinate(kFlowHeight) + "\"/>\n</svg>";
}

}  // namespace cotwin::report
