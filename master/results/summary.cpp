#include "master/results/summary.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <ostream>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr std::size_t kLabel = 20, kCell = 10, kWidth = 80;
constexpr std::size_t kLongestName = 24;  // of a joint; of longer ones the middle is left out
constexpr std::size_t kMostUnits = 20;    // with their own line in the table of times

std::string number(double value, int digits = 4) { return std::isnan(value) ? "-" : text::to_text(value, digits); }

/// Returns the number of characters of UTF-8 text.
std::size_t width(const std::string& s) {
  return static_cast<std::size_t>(std::count_if(s.begin(), s.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string left(const std::string& s, std::size_t columns) {
  return s + std::string(columns > width(s) ? columns - width(s) : 1, ' ');
}
std::string right(const std::string& s, std::size_t columns) {
  return std::string(columns > width(s) ? columns - width(s) : 1, ' ') + s;
}

/// A text of at most kLongestName characters (bytes of a text that is not ASCII may be parted, so that is shown as it is).
std::string shortened(const std::string& name) {
  constexpr std::size_t kHalf = kLongestName / 2;
  const bool ascii = width(name) == name.size();
  if (name.size() <= kLongestName || !ascii) return name;
  return name.substr(0, kHalf - 1) + "…" + name.substr(name.size() - kHalf);
}

/// A table with a column per element and a last column for all; wide vectors take several blocks, very wide ones have that column alone.
class ElementTable {
 public:
  ElementTable(const ElementKind& kind, const Elements& elements) : elements_(kind.elements.size()) {
    for (const std::size_t i : kind.elements) {
      heads_.push_back(elements.names.empty() ? "[" + std::to_string(i + 1) + "]" : shortened(elements.names[i]));
      cells_.push_back(std::max(kCell, width(heads_.back()) + 2));
    }
    has_heads_ = elements_ > 1 || !elements.names.empty();
  }
  void row(std::string label, std::vector<double> values, double all) {
    rows_.push_back({std::move(label), std::move(values), all});
  }
  void print(std::ostream& out) const {
    std::size_t begin = elements_ > kMostElements ? elements_ : 0, end = begin;
    for (bool first = true; first || begin < elements_; first = false, begin = end) {
      for (std::size_t used = 0; end < elements_ && (end == begin || used + cells_[end] <= kWidth); ++end) used += cells_[end];
      const bool last = end == elements_;
      if (has_heads_) {
        out << left("", kLabel);
        for (std::size_t i = begin; i < end; ++i) out << right(heads_[i], cells_[i]);
        out << (last && elements_ > 1 ? right("all", kCell) : "") << '\n';
      }
      for (const Row& r : rows_) {
        out << left("  " + r.label, kLabel);
        for (std::size_t i = begin; i < end; ++i) out << right(number(r.values[i]), cells_[i]);
        out << (last && elements_ > 1 ? right(number(r.all), kCell) : "") << '\n';
      }
    }
  }

 private:
  static constexpr std::size_t kMostElements = 48;  // beyond, as of beams of a scanner, nobody reads them here
  struct Row {
    std::string label;
    std::vector<double> values;
    double all;
  };
  std::size_t elements_;
  std::vector<std::string> heads_;
  std::vector<std::size_t> cells_;  // widths
  bool has_heads_ = false;
  std::vector<Row> rows_;
};

std::string heading(const std::string& name, const std::string& si, const std::string& what) {
  return name + (si.empty() || si == "1" ? "" : " [" + si + "]") + (name == what ? "" : ": " + what);
}

/// "a, b, c"; of long lists the first and the number.
std::string members_of(const LoopReport& loop) {
  constexpr std::size_t kMostNames = 8, kFirst = 3;
  const auto names = static_cast<std::size_t>(std::ranges::count(loop.members, ',')) + 1;
  if (names <= kMostNames) return loop.members;
  std::size_t end = 0;
  for (std::size_t i = 0; i < kFirst; ++i) end = loop.members.find(',', end) + 1;
  return loop.members.substr(0, end) + " ... (" + std::to_string(names) + " units)";
}

void write_loop(std::ostream& out, const LoopReport& loop) {
  out << "loop " << members_of(loop) << ": " << (loop.solved ? "implicit" : "explicit");
  if (loop.solved && std::isfinite(loop.solved_from))
    out << " from t = " << number(loop.solved_from, 6) << " s on, because explicit steps let its values grow";
  if (loop.algebraic) out << ", without delay";
  if (std::isfinite(loop.gain)) out << ", gain " << number(loop.gain, 3) << " in a tick";
  if (!loop.solved && loop.unmeasurable) out << ", gain not measured: a unit has no cheap way back (FMU: rollback=true)";
  const LoopCounts& c = loop.counts;
  if (loop.solved && c.steps > 0) {
    const auto per_step = [&](std::int64_t count) {
      return number(static_cast<double>(count) / static_cast<double>(c.steps), 3);
    };
    out << "; per step " << per_step(c.iterations) << " iterations and " << per_step(c.evaluations) << " unit steps; "
        << text::counted(c.linearisations, "Jacobian");
    if (c.divided > 0) out << ", " << text::counted(c.divided, "step") << " divided";
  }
  out << '\n';
}

void write_delays(std::ostream& out, const char* what, const Histogram& h) {
  const auto at = [&](double p) { return duration(1e-9 * static_cast<double>(h.quantile(p))); };
  out << what << ": median " << at(0.5) << ", 99 % within " << at(0.99) << ", 99.99 % within " << at(0.9999) << ", "
      << duration(1e-9 * static_cast<double>(h.max())) << " at most\n";
}

void write_clock(std::ostream& out, const Summary& s) {
  if (s.overruns > 0) out << text::counted(s.overruns, "tick") << " began late, by " << duration(s.worst_delay) << " at most\n";
  const ClockReport& clock = s.clock;
  if (clock.kind == ClockKind::kFree || clock.start_delays.count() == 0) return;
  if (clock.state.skipped > 0) out << text::counted(clock.state.skipped, "tick") << " left out\n";
  if (clock.kind != ClockKind::kWall) {
    out << "clock of the source: "
        << (clock.state.locked   ? "locked"
            : clock.state.silent ? "silent"
                                 : "not locked")
        << ", offset " << number(1e6 * clock.rms_offset, 3) << " us rms, " << number(1e6 * clock.state.worst, 3)
        << " us at most, drift " << number(1e6 * clock.state.drift, 3) << " ppm";
    if (clock.state.missed > 0)
      out << "; " << text::counted(static_cast<std::int64_t>(clock.state.missed), "packet") << " missed or far from their time";
    if (clock.state.steps > 0) out << "; " << text::counted(static_cast<std::int64_t>(clock.state.steps), "step");
    out << '\n';
  }
  write_delays(out, "delay of the start of ticks", clock.start_delays);
  if (clock.run_times.count() > 0) write_delays(out, "run time of ticks", clock.run_times);
  if (clock.page_faults)
    out << text::counted(static_cast<std::int64_t>(*clock.page_faults), "page fault") << " after the start\n";
}

void write_head(std::ostream& out, const Summary& s, const Outcome& outcome) {
  out << s.scenario << ": ";
  if (outcome.state == Outcome::State::kInterrupted) out << "interrupted at t = " << number(s.reached, 9) << " s; ";
  if (outcome.state == Outcome::State::kFailed) out << "failed at t = " << number(s.reached, 9) << " s; ";
  out << number(s.reached - s.start, 9) << " s in " << text::counted(s.ticks, "tick") << " of " << duration(s.tick)
      << ", run in " << duration(s.wall_seconds);
  if (s.ticks > 0) out << ": " << number(s.real_time_factor, 3) << " times real time";
  out << (s.threads > 1 ? " on " + std::to_string(s.threads) + " threads" : "") << '\n';
  write_clock(out, s);
  if (!s.initialisation.loop.empty()) {
    out << "algebraic loop at initialisation solved in " << text::counted(s.initialisation.iterations, "iteration") << ":";
    for (const std::string& member : s.initialisation.loop) out << ' ' << member;
    out << '\n';
  }
  if (s.discarded > 0) {
    out << text::counted(s.discarded, "step") << " discarded and repeated in up to " << s.most_parts << " parts, discarded by";
    for (const auto& [name, count] : s.discarded_by) out << ' ' << name << " (" << count << ")";
    out << '\n';
  }
  if (s.mean_parts > 1) {
    out << "ticks were divided into " << number(s.mean_parts, 3) << " parts on average, " << s.most_parts << " at most";
    if (s.rejected > 0) out << "; " << text::counted(s.rejected, "step") << " rejected and repeated";
    out << '\n';
  }
  for (const LoopReport& loop : s.loops) write_loop(out, loop);
}

void write_figures(std::ostream& out, const Summary& s) {
  for (const Tally& t : s.tallies) {
    for (const ElementKind& kind : kinds_of(t.si, t.elements, t.rms.size())) {
      out << '\n' << heading(t.name, kind.si, t.what) << '\n';
      ElementTable table(kind, t.elements);
      table.row("RMS", kind.of(t.rms), joined_rms(kind.of(t.rms)));
      table.row("max", kind.of(t.max), largest_of(kind.of(t.max)));
      table.print(out);
    }
  }
  for (const Compared& c : s.comparisons) {
    for (const ElementKind& kind : kinds_of(c.si, c.elements, c.max.size())) {
      out << '\n' << heading(c.name, kind.si, c.what) << ", t = " << number(c.from, 6) << " to " << number(c.to, 6) << " s\n";
      ElementTable table(kind, c.elements);
      table.row("max |a - b|", kind.of(c.max), largest_of(kind.of(c.max)));
      table.row("at t [s]", kind.of(c.time_of_max), std::numeric_limits<double>::quiet_NaN());
      for (std::size_t k = 0; k < c.segment_rms.size(); ++k) {
        const std::vector<double> rms = kind.of(c.segment_rms[k]);
        table.row("RMS, part " + std::to_string(k + 1), rms, joined_rms(rms));
      }
      table.row("RMS", kind.of(c.rms), joined_rms(kind.of(c.rms)));
      table.print(out);
    }
  }
  if (!s.works.empty()) {
    out << '\n'
        << left("energy [J]", 32) << right("net", kCell) << right("positive", kCell) << right("negative", kCell) << '\n';
  } else if (!s.bonds.empty()) {
    out << "\nenergy [J]\n";
  }
  for (const Work& w : s.works) {
    out << "  " << left(w.name, 30) << right(number(w.value), kCell) << right(number(w.positive), kCell)
        << right(number(w.negative), kCell) << (w.name == w.what ? "" : "   " + w.what) << '\n';
  }
  for (const Bonded& b : s.bonds) {
    out << "  " << left(b.name, 30) << right(number(b.energy_a), kCell) << " out, " << number(b.energy_b) << " in, leak "
        << number(b.leak, 3);
    if (b.throughput > 0) out << " (" << number(100 * b.share, 2) << " % of " << number(b.throughput) << " J exchanged)";
    out << '\n';
  }
}

void write_time(std::ostream& out, const Summary& s) {
  // Shows the units that take most time, in the order of the scenario.
  std::vector<std::size_t> shown(s.units.size());
  std::iota(shown.begin(), shown.end(), std::size_t{0});
  std::stable_sort(shown.begin(), shown.end(),
                   [&](std::size_t x, std::size_t y) { return s.units[x].share > s.units[y].share; });
  double others = 0;
  for (std::size_t k = kMostUnits; k < shown.size(); ++k) others += s.units[shown[k]].share;
  const std::size_t hidden = shown.size() > kMostUnits ? shown.size() - kMostUnits : 0;
  shown.resize(shown.size() - hidden);
  std::sort(shown.begin(), shown.end());
  std::size_t label = kLabel;
  for (const std::size_t u : shown) label = std::max(label, width(s.units[u].name) + 2);

  const auto row = [&](const std::string& name, const std::string& per_step, double share) {
    out << left("  " + name, label) << right(per_step, kCell) << right(number(100 * share, 3) + " %", kCell) << '\n';
  };
  out << '\n' << left("time", label) << right("per step", kCell) << right("share", kCell) << '\n';
  for (const std::size_t u : shown) row(s.units[u].name, duration(s.units[u].seconds_per_step), s.units[u].share);
  if (hidden > 0) row(std::to_string(hidden) + " others", "", others);
  row("master: exchange", "", s.exchange_share);
  row("master: checks", "", s.check_share);
  row("master: recording", "", s.observe_share);
}

/// Returns null for a number that JSON cannot represent.
nlohmann::ordered_json finite(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}
nlohmann::ordered_json finite(const std::vector<double>& values) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const double v : values) list.push_back(finite(v));
  return list;
}

using nlohmann::ordered_json;

/// "unit"; "units" where elements differ; "joints": their names.
void write_elements(ordered_json& entry, const Elements& elements) {
  if (!elements.si.empty()) entry["units"] = elements.si;
  if (!elements.names.empty()) entry["joints"] = elements.names;
}

/// The signals of a difference a − (factor · b + offset).
void write_signals(ordered_json& entry, const std::string& a, const std::string& b, double factor, double offset) {
  entry["a"] = a;
  if (b.empty()) return;
  entry["b"] = b;
  if (factor != 1) entry["factor"] = factor;
  if (offset != 0) entry["offset"] = offset;
}

ordered_json histogram_of(const Histogram& h) {
  ordered_json bins = ordered_json::array();  // [upper edge, count] of those that are not empty
  for (std::size_t bin = 0; bin < Histogram::kBins; ++bin) {
    const std::int64_t edge = bin + 1 < Histogram::kBins ? Histogram::edge(bin) : h.max();
    if (h.counts()[bin] > 0) bins.push_back({1e-9 * static_cast<double>(edge), h.counts()[bin]});
  }
  return {{"count", h.count()},
          {"mean", 1e-9 * h.mean()},
          {"median", 1e-9 * static_cast<double>(h.quantile(0.5))},
          {"p99", 1e-9 * static_cast<double>(h.quantile(0.99))},
          {"p99_99", 1e-9 * static_cast<double>(h.quantile(0.9999))},
          {"max", 1e-9 * static_cast<double>(h.max())},
          {"bins", bins}};
}

ordered_json clock_of(const ClockReport& clock) {
  ordered_json j{{"kind", text::word_of(clock.kind, kClockWords)}};
  if (clock.kind == ClockKind::kFree) return j;
  const ClockState& state = clock.state;
  if (clock.kind != ClockKind::kWall) {
    j["locked"] = state.locked;
    j["silent"] = state.silent;
    j["offset"] = state.offset;
    j["offset_rms"] = clock.rms_offset;
    j["offset_worst"] = state.worst;
    j["jitter"] = state.jitter;
    j["drift"] = state.drift;
    j["missed"] = state.missed;
    j["steps"] = state.steps;
  }
  j["skipped"] = state.skipped;
  j["start_delay"] = histogram_of(clock.start_delays);
  j["run_time"] = histogram_of(clock.run_times);
  j["page_faults"] = clock.page_faults ? ordered_json(*clock.page_faults) : ordered_json();
  return j;
}

}  // namespace

std::vector<double> ElementKind::of(const std::vector<double>& all) const {
  std::vector<double> chosen;
  for (const std::size_t i : elements) {
    if (i < all.size()) chosen.push_back(all[i]);
  }
  return chosen;
}

std::vector<ElementKind> kinds_of(const std::string& si, const Elements& elements, std::size_t size) {
  std::vector<ElementKind> kinds;
  for (std::size_t i = 0; i < size; ++i) {
    const std::string& own = i < elements.si.size() ? elements.si[i] : si;
    auto kind = std::ranges::find(kinds, own, &ElementKind::si);
    if (kind == kinds.end()) kind = kinds.insert(kind, {own, {}});
    kind->elements.push_back(i);
  }
  return kinds;
}

double largest_of(const std::vector<double>& values) {
  double most = std::numeric_limits<double>::quiet_NaN();
  for (const double value : values) most = std::fmax(most, value);
  return most;
}

double joined_rms(const std::vector<double>& rms) {
  double squares = 0;
  for (const double r : rms) squares += r * r;
  return std::sqrt(squares / static_cast<double>(rms.size()));
}

std::string duration(double seconds) {
  if (seconds < 1e-6) return text::to_text(seconds * 1e9, 3) + " ns";
  if (seconds < 1e-3) return text::to_text(seconds * 1e6, 3) + " us";
  if (seconds < 1) return text::to_text(seconds * 1e3, 3) + " ms";
  return text::to_text(seconds, 4) + " s";
}

void write_report(std::ostream& out, const Summary& s, const Outcome& outcome) {
  write_head(out, s, outcome);
  write_figures(out, s);
  write_time(out, s);
  if (!s.notes.empty()) out << '\n';
  for (const std::string& note : s.notes) out << note << '\n';
  if (!s.warnings.empty()) out << '\n';
  for (const std::string& warning : s.warnings) out << "warning: " << warning << '\n';
  if (!s.recording.empty())
    out << "\nresults: " << s.recording.string() << " (" << text::counted(static_cast<std::int64_t>(s.rows), "row") << ")\n";
}

void write_json(std::ostream& out, const Summary& s, const Outcome& outcome) {
  ordered_json j;
  j["scenario"] = s.scenario;
  constexpr std::pair<const char*, Outcome::State> kWords[] = {
      {"done", Outcome::State::kDone}, {"interrupted", Outcome::State::kInterrupted}, {"failed", Outcome::State::kFailed}};
  j["state"] = text::word_of(outcome.state, kWords);
  if (!outcome.message.empty()) j["message"] = outcome.message;
  j["start"] = s.start;
  j["reached"] = s.reached;
  j["stop"] = s.stop;
  j["tick"] = s.tick;
  j["ticks"] = s.ticks;
  j["wall_seconds"] = s.wall_seconds;
  j["real_time_factor"] = finite(s.real_time_factor);
  j["threads"] = s.threads;
  j["initialisation"] = {
      {"rounds", s.initialisation.rounds}, {"loop", s.initialisation.loop}, {"iterations", s.initialisation.iterations}};
  j["signals"] = ordered_json::array();
  for (const Tally& t : s.tallies) {
    j["signals"].push_back({{"name", t.name},
                            {"what", t.what},
                            {"unit", t.si},
                            {"rms", finite(t.rms)},
                            {"max", finite(t.max)},
                            {"time_of_max", finite(t.time_of_max)},
                            {"total_rms", finite(t.total_rms)},
                            {"total_max", finite(t.total_max)}});
    write_signals(j["signals"].back(), t.a, t.b, t.factor, t.offset);
    if (t.attitude) j["signals"].back()["attitude"] = true;
    write_elements(j["signals"].back(), t.elements);
    if (t.elements.si.empty()) continue;
    for (const ElementKind& kind : kinds_of(t.si, t.elements, t.rms.size()))
      j["signals"].back()["totals"].push_back(
          {{"unit", kind.si}, {"rms", finite(joined_rms(kind.of(t.rms)))}, {"max", finite(largest_of(kind.of(t.max)))}});
  }
  j["comparisons"] = ordered_json::array();
  for (const Compared& c : s.comparisons) {
    ordered_json segments = ordered_json::array();
    for (const auto& rms : c.segment_rms) segments.push_back(finite(rms));
    j["comparisons"].push_back({{"name", c.name},
                                {"what", c.what},
                                {"unit", c.si},
                                {"from", c.from},
                                {"to", c.to},
                                {"max", finite(c.max)},
                                {"time_of_max", finite(c.time_of_max)},
                                {"segment_rms", segments},
                                {"rms", finite(c.rms)}});
    write_signals(j["comparisons"].back(), c.a, c.b, c.factor, c.offset);
    write_elements(j["comparisons"].back(), c.elements);
  }
  j["energy"] = ordered_json::array();
  for (const Work& w : s.works)
    j["energy"].push_back({{"name", w.name},
                           {"what", w.what},
                           {"unit", w.si},
                           {"value", finite(w.value)},
                           {"positive", finite(w.positive)},
                           {"negative", finite(w.negative)}});
  j["bonds"] = ordered_json::array();
  for (const Bonded& b : s.bonds) {
    j["bonds"].push_back({{"name", b.name},
                          {"energy_a", finite(b.energy_a)},
                          {"energy_b", finite(b.energy_b)},
                          {"leak", finite(b.leak)},
                          {"throughput", finite(b.throughput)},
                          {"share", finite(b.share)},
                          {"tolerance", b.tolerance}});
  }
  j["units"] = ordered_json::array();
  for (const Summary::Share& u : s.units)
    j["units"].push_back({{"name", u.name}, {"seconds_per_step", u.seconds_per_step}, {"share", u.share}});
  j["master"] = {{"exchange", s.exchange_share}, {"checks", s.check_share}, {"recording", s.observe_share}};
  j["discarded"] = s.discarded;
  j["discarded_by"] = ordered_json::object();
  for (const auto& [name, count] : s.discarded_by) j["discarded_by"][name] = count;
  j["parts"] = {{"most", s.most_parts}, {"mean", s.mean_parts}};
  j["rejected"] = s.rejected;
  j["loops"] = ordered_json::array();
  for (const LoopReport& loop : s.loops) {
    j["loops"].push_back({{"members", loop.members},
                          {"coupling", loop.solved ? "implicit" : "explicit"},
                          {"solved_from", finite(loop.solved_from)},
                          {"algebraic", loop.algebraic},
                          {"gain", finite(loop.gain)},
                          {"steps", loop.counts.steps},
                          {"iterations", loop.counts.iterations},
                          {"jacobians", loop.counts.linearisations},
                          {"unit_steps", loop.counts.evaluations},
                          {"divided", loop.counts.divided}});
  }
  j["clock"] = clock_of(s.clock);
  j["overruns"] = s.overruns;
  j["worst_delay"] = s.worst_delay;
  j["recording"] = s.recording.string();
  j["rows"] = s.rows;
  j["dropped_rows"] = s.dropped_rows;
  j["end"] = ordered_json::object();
  for (const Summary::End& end : s.ends) {
    j["end"][end.name] = {{"unit", end.si}, {"values", finite(end.values)}};
    write_elements(j["end"][end.name], end.elements);
  }
  j["notes"] = s.notes;
  j["warnings"] = s.warnings;
  out << j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << '\n';
}

}  // namespace cotwin::master
