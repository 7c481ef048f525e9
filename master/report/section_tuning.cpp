// The section of a tuning (cotwin tune).
#include <algorithm>
#include <array>
#include <cmath>

#include "master/report/sections.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

constexpr std::size_t kMostJoints = 100, kMostUnknowns = 400;

std::string joined_text(const json& list) {
  std::string all;
  for (const json& element : list_of(list)) text::append(all, text_of(element));
  return all;
}

void write_tuning_facts(Page& page, const Results& results) {
  const json& f = results.figures;
  page.heading(3, "Data and settings");
  const json& settings = member(f, "settings");
  Table table({"", ""}, 2);
  const auto add = [&](const char* what, const std::string& text) {
    if (!text.empty()) table.row({what, text});
  };
  add("robot", text_of(member(f, "robot")));
  add("URDF before", text_of(member(settings, "robot")));
  add("logs", joined_text(member(settings, "data")));
  add("held-out logs", joined_text(member(settings, "held_out")));
  add("state", text_of(member(f, "state")));
  add("program", text_of(member(results.resume, "program")));
  add("method", text_of(member(settings, "method")));
  add("written robot",
      text_of(member(f, "tuned")) + (text_of(member(f, "note")).empty() ? "" : ": " + text_of(member(f, "note"))));
  add("friction", text_of(member(member(settings, "model"), "friction")));
  add("seed", text_of(member(settings, "seed")));
  if (member(f, "cutoff").is_number())
    add("low-pass", number(number_of(member(f, "cutoff"))) + " Hz of " + number(number_of(member(f, "rate"))) + " Hz");
  const std::string training = text_of(member(member(f, "training"), "samples")),
                    held_out = text_of(member(member(f, "held_out"), "samples"));
  add("samples", training.empty() ? "" : training + " of training" + (held_out.empty() ? "" : ", " + held_out + " held out"));
  if (member(f, "rank").is_number())
    add("determined", text_of(member(f, "rank")) + " of " + text_of(member(f, "unknowns")) + " unknowns, condition number " +
                          number(number_of(member(f, "condition"))));
  page.table(table);
}

/// The unit of measure of the torque or force of a joint.
std::string unit_at(const json& figures, std::size_t joint) {
  const json::array_t& units = list_of(member(figures, "units"));
  return joint < units.size() ? text_of(units[joint]) : "";
}

/// The joints' names with the units of their torques.
std::vector<std::string> joints_of(const json& figures) {
  std::vector<std::string> names;
  for (const json& joint : list_of(member(figures, "joints"))) {
    if (names.size() < kMostJoints)
      names.push_back(text_of(joint) + (unit_at(figures, names.size()) == "N" ? " [N]" : " [N·m]"));
  }
  return names;
}

void write_errors(Page& page, const json& f, const std::vector<std::string>& joints) {
  page.heading(3, "Torque errors");
  const json& weighted = member(f, "weighted_rms");
  std::string sentence;
  for (const char* name : {"prior", "swarm", "feasible", "floor"}) {
    if (member(weighted, name).is_number())
      text::append(sentence, std::string(name) + " " + number(number_of(member(weighted, name)), 5));
  }
  if (!sentence.empty())
    page.paragraph("RMS over all joints, weighted by the residuals of the floor (unconstrained least squares), training: " +
                   escaped(sentence) + ".");
  for (const auto& [part, title] :
       {std::pair{"training", "Training: RMS of measured minus predicted torque"},
        std::pair{"held_out", "Held out, which no solver has seen: RMS of measured minus predicted torque"}}) {
    const json& errors = member(f, part);
    const json& rms = member(errors, "rms");
    if (!rms.is_object()) {
      if (std::string(part) == "held_out")
        page.note("Nothing was held out: how good the model is on other motions is not known.");
      continue;
    }
    std::vector<std::string> heads = {"joint", "torque"};
    std::vector<std::vector<double>> columns = {numbers_of(member(errors, "torque"))};
    const std::string tuned = text_of(member(f, "tuned"));
    for (const char* name : {"prior", "swarm", "feasible", "floor"}) {
      if (!member(rms, name).is_array()) continue;
      heads.push_back(name == tuned ? std::string(name) + " (written)" : name);
      columns.push_back(numbers_of(member(rms, name)));
    }
    heads.emplace_back("written / prior [%]");
    const std::vector<double> before = numbers_of(member(rms, "prior")), after = numbers_of(member(rms, tuned.c_str()));
    Table table(heads);
    for (std::size_t j = 0; j < joints.size(); ++j) {
      std::vector<Cell> cells = {joints[j]};
      for (const std::vector<double>& column : columns) cells.push_back(j < column.size() ? Cell(column[j]) : Cell(""));
      cells.push_back(j < before.size() && j < after.size() ? Cell(number(100 * after[j] / before[j], 3)) : Cell(""));
      table.row(std::move(cells));
    }
    page.table(table, title);
  }
}

/// The torques of torques.csv, joint by joint.
struct Torques {
  struct Joint {
    Curve measured, before, after, error_before, error_after;
  };
  std::vector<Joint> joints;
  std::vector<std::pair<double, double>> held_out;
  bool several_logs = false;
  std::vector<std::string> notes;
};

Torques load_torques(const std::filesystem::path& file, std::size_t joints) {
  Torques torques;
  RowReader reader(file, {}, {{"training", 0}, {"held_out", 1}});
  const std::vector<std::string>& names = reader.names();
  const auto column = [&](const std::string& name) {
    const auto found = std::ranges::find(names, name);
    if (found == names.end()) throw Error(file.string(), "has no column '" + name + "'");
    return static_cast<std::size_t>(found - names.begin());
  };
  const std::size_t part = column("part");
  std::vector<std::array<std::size_t, 3>> columns;
  for (std::size_t j = 0; j < joints; ++j) {
    const std::string index = "[" + std::to_string(j + 1) + "]";
    columns.push_back({column("tau_smooth" + index), column("tau_prior" + index), column("tau_tuned" + index)});
  }
  torques.joints.resize(joints);
  // The time of another log begins anew; the logs are drawn one after another.
  double shift = 0, before = 0;
  bool held = false;
  for (bool first = true; reader.next(); first = false) {
    if (!first && reader.t() + shift < before) {
      shift = before - reader.t();
      torques.several_logs = true;
    }
    const double t = reader.t() + shift;
    before = t;
    const bool is_held = reader.value(part) == 1;
    if (is_held && !held) torques.held_out.emplace_back(t, t);
    if (is_held) torques.held_out.back().second = t;
    held = is_held;
    for (std::size_t j = 0; j < joints; ++j) {
      const double measured = reader.value(columns[j][0]), prior = reader.value(columns[j][1]),
                   tuned = reader.value(columns[j][2]);
      Torques::Joint& joint = torques.joints[j];
      joint.measured.add(t, measured);
      joint.before.add(t, prior);
      joint.after.add(t, tuned);
      joint.error_before.add(t, measured - prior);
      joint.error_after.add(t, measured - tuned);
    }
  }
  torques.notes = reader.notes();
  return torques;
}

void write_torques(Page& page, const Results& results, const std::vector<std::string>& joints, const Gnuplot& gnuplot) {
  page.heading(3, "Measured and predicted torques, before and after");
  if (results.torques.empty()) {
    page.note("There is no torques.csv: the tuning was interrupted, or the file is missing.");
    return;
  }
  Torques torques;
  try {
    torques = load_torques(results.torques, joints.size());
  } catch (const Error& error) {
    page.note(std::string("The torques cannot be read: ") + error.what());
    return;
  }
  for (const std::string& note : torques.notes) page.note(note);
  page.paragraph(
      std::string("Measured torques are smoothed by the low-pass. Before: predicted by the URDF that was given. After: by the "
                  "tuned robot.") +
      (torques.held_out.empty() ? "" : " Shaded: held out.") +
      (torques.several_logs ? " The logs are drawn one after another." : ""));
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const Torques::Joint& joint = torques.joints[j];
    page.heading(4, joints[j]);
    Plot plot;
    plot.y_label = "torque";
    plot.description = "Torques of " + joints[j] + ": measured, predicted before and after the tuning";
    plot.shaded = torques.held_out;
    plot.height = 210;
    plot.lines = {
        {"measured", joint.measured.points(), 6}, {"before", joint.before.points(), 1}, {"after", joint.after.points(), 0}};
    Artist(page, gnuplot).plot(std::move(plot), "");
    Plot errors;
    errors.y_label = "measured − predicted";
    errors.description = "Errors of the predicted torques of " + joints[j];
    errors.shaded = torques.held_out;
    errors.height = 170;
    errors.lines = {{"error before", joint.error_before.points(), 1}, {"error after", joint.error_after.points(), 0}};
    Artist(page, gnuplot).plot(std::move(errors), "");
  }
}

void write_convergence(Page& page, const json& f, const Gnuplot& gnuplot) {
  const json& swarm = member(f, "swarm");
  const std::vector<double> history = numbers_of(member(swarm, "history"));
  if (history.empty()) return;
  page.heading(3, "Convergence of the swarm");
  page.paragraph(escaped(text_of(member(swarm, "rounds")) + " rounds, " + text_of(member(swarm, "reconfigurations")) +
                         " restarts of particles after stagnation; cost " + number(history.front(), 5) +
                         " after the first round, " + number(history.back(), 5) + " at the end."));
  Curve curve;
  bool positive = true;
  for (std::size_t i = 0; i < history.size(); ++i) {
    curve.add(static_cast<double>(i + 1), history[i]);
    positive = positive && history[i] > 0;
  }
  Plot plot;
  plot.x_label = "round";
  plot.y_label = "cost";
  plot.log_y = positive;
  plot.description = "Cost of the best particle after each round";
  plot.lines = {{"cost", curve.points(), 0}};
  Artist(page, gnuplot).plot(std::move(plot), "Cost of the best particle after each round");
}

/// A bar from the middle to the left or right: −100 % to +100 %.
std::string deviation_bar(double percent) {
  if (!std::isfinite(percent)) return "";
  const double length = std::min(std::abs(percent), 100.0) / 2, x = percent < 0 ? 50 - length : 50;
  return "<svg class=\"bar\" viewBox=\"0 0 100 8\" preserveAspectRatio=\"none\" aria-hidden=\"true\"><rect class=\"" +
         std::string(percent < 0 ? "f1" : "f0") + "\" x=\"" + text::to_text(x, 4) + "\" y=\"1\" width=\"" +
         text::to_text(length, 4) + "\" height=\"6\"/><path class=\"axis\" d=\"M50 0 50 8\"/></svg>";
}

class Deviations {
 public:
  void add(const std::string& owner, const std::string& what, double before, double after) {
    if (!std::isfinite(before) || !std::isfinite(after) || (before == 0 && after == 0)) return;
    const double percent = 100 * (after - before) / std::abs(before);
    table_.row({owner, what, before, after, before == 0 ? Cell("new") : Cell(number(percent, 3)),
                Cell::of_html(deviation_bar(percent))});
  }
  void write(Page& page, const char* caption) const {
    if (!table_.empty()) page.table(table_, caption);
  }

 private:
  Table table_{{"", "parameter", "before", "after", "change [%]", "−100 % … +100 %"}, 2, true};
};

void write_tuning_parameters(Page& page, const json& f) {
  const json::array_t &bodies = list_of(member(f, "bodies")), &drives = list_of(member(f, "drives"));
  if (bodies.empty() && drives.empty()) {
    page.note("figures.json has no parameters: it was written by an older version of cotwin. report.md beside it lists them.");
    return;
  }
  page.heading(3, "Parameters before and after");
  page.paragraph(
      "Single masses and inertias are one choice of many with the same torques, the one nearest to the URDF that was given.");
  Deviations of_bodies;
  for (const json& body : bodies) {
    const std::string name = text_of(member(body, "name"));
    const json &before = member(body, "before"), &after = member(body, "after");
    of_bodies.add(name, "mass [kg]", number_of(member(before, "mass")), number_of(member(after, "mass")));
    for (const auto& [key, names] :
         {std::pair{"centre", std::array{"centre of mass x [m]", "centre of mass y [m]", "centre of mass z [m]"}},
          std::pair{"moments", std::array{"smallest principal moment [kg·m²]", "middle principal moment [kg·m²]",
                                          "largest principal moment [kg·m²]"}}}) {
      const std::vector<double> a = numbers_of(member(before, key)), b = numbers_of(member(after, key));
      for (std::size_t i = 0; i < std::min({a.size(), b.size(), std::size_t{3}}); ++i)
        of_bodies.add(name, names[i], a[i], b[i]);
    }
  }
  of_bodies.write(page, "Bodies");
  Deviations of_drives;
  std::size_t joint = 0;
  for (const json& drive : drives) {
    const std::string name = text_of(member(drive, "joint"));
    const json &before = member(drive, "before"), &after = member(drive, "after");
    struct Shown {
      const char *key, *what, *unit, *of_slide;
    };
    const bool slide = unit_at(f, joint++) == "N";
    for (const auto& [key, what, unit, of_slide] : {Shown{"B", "motor inertia B", " [kg·m²]", " [kg]"},
                                                    {"tau_C", "Coulomb friction τ_C", " [N·m]", " [N]"},
                                                    {"tau_S", "stiction τ_S", " [N·m]", " [N]"},
                                                    {"sigma2", "viscous friction σ2", " [N·m·s/rad]", " [N·s/m]"},
                                                    {"tau_0", "offset τ_0", " [N·m]", " [N]"},
                                                    {"load", "load friction μ", "", ""}})
      of_drives.add(name, std::string(what) + (slide ? of_slide : unit), number_of(member(before, key)),
                    number_of(member(after, key)));
  }
  of_drives.write(page, "Drives (before: the friction of the URDF)");
  Table unknowns({"unknown", "value", "standard deviation", "relative [%]"});
  std::string lost;
  std::size_t rows = 0;
  for (const json& unknown : list_of(member(f, "determination"))) {
    if (member(unknown, "determined") == false) {
      text::append(lost, text_of(member(unknown, "name")));
      continue;
    }
    if (rows++ == kMostUnknowns) break;
    const double value = number_of(member(unknown, "value")), deviation = number_of(member(unknown, "deviation"));
    unknowns.row({text_of(member(unknown, "name")), value, Cell(number(deviation, 3)),
                  Cell(number(100 * deviation / std::abs(value), 3))});
  }
  if (unknowns.empty() && lost.empty()) return;
  page.heading(3, "What the data determine");
  if (!lost.empty()) page.paragraph("Not determined, or only in sums with one another: " + code(lost));
  if (!unknowns.empty()) page.table(unknowns, "Values of unconstrained least squares");
}

}  // namespace

void write_tuning(Page& page, const Results& results, const Gnuplot& gnuplot) {
  const json& f = results.figures;
  page.heading(2, results.name + ": tuning", true);
  if (text_of(member(f, "state")) == "interrupted")
    page.alarm("The tuning was interrupted: these are the best parameters so far.");
  for (const json& alarm : list_of(member(f, "alarms"))) page.alarm(text_of(alarm));
  for (const std::string& note : results.notes) page.note(note);
  for (const json& warning : list_of(member(f, "warnings"))) page.note("Warning: " + text_of(warning));
  for (const json& verdict : list_of(member(f, "verdicts"))) page.paragraph(escaped(text_of(verdict)));
  const std::vector<std::string> joints = joints_of(f);
  write_errors(page, f, joints);
  write_torques(page, results, joints, gnuplot);
  write_tuning_parameters(page, f);
  write_convergence(page, f, gnuplot);
  write_tuning_facts(page, results);
}

}  // namespace cotwin::report
