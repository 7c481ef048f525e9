#include "master/workflows/tuning/report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>

#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"

namespace cotwin::master::tuning {

namespace {

using Eigen::Index;
using Eigen::VectorXd;
using nlohmann::json;

std::string number(double x, int digits = 4) { return std::isfinite(x) ? text::to_text(x, digits) : "not determined"; }

double at(const VectorXd& v, std::size_t j) { return v[static_cast<Index>(j)]; }

/// A table, for a terminal or Markdown.
class Table {
 public:
  explicit Table(std::vector<std::string> header) : rows_{std::move(header)} {}
  void row(std::vector<std::string> cells) { rows_.push_back(std::move(cells)); }

  void write_plain(std::ostream& out) const {
    std::vector<std::size_t> width(rows_[0].size());
    for (const auto& row : rows_) {
      for (std::size_t c = 0; c < row.size(); ++c) width[c] = std::max(width[c], columns_of(row[c]));
    }
    for (const auto& row : rows_) {
      for (std::size_t c = 0; c < row.size(); ++c) {
        const std::string blanks(width[c] - columns_of(row[c]), ' ');
        out << (c == 0 ? row[c] + blanks : "  " + blanks + row[c]);
      }
      out << '\n';
    }
  }
  void write_markdown(std::ostream& out) const {
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      for (const std::string& cell : rows_[r]) out << "| " << escaped(cell) << ' ';
      out << "|\n";
      if (r > 0) continue;
      for (std::size_t c = 0; c < rows_[0].size(); ++c) out << (c == 0 ? "|---" : "|---:");
      out << "|\n";
    }
    out << '\n';
  }

 private:
  static std::string escaped(const std::string& cell) {
    std::string text;
    for (const char c : cell) text += c == '|' ? std::string("\\|") : std::string(1, c);
    return text;
  }
  /// Of a terminal: bytes of UTF-8 that begin a character.
  static std::size_t columns_of(const std::string& text) {
    return static_cast<std::size_t>(
        std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
  }
  std::vector<std::vector<std::string>> rows_;
};

/// The name of a joint in the first column; of a slide with what its numbers are in.
std::string row_name(const robot::Joint& joint) {
  return joint.name + (joint.type == robot::JointType::kPrismatic ? " (slide: m, kg, N)" : "");
}

/// RMS of every candidate, then the largest discrepancies of the prior and of the tuned twin.
Table errors_table(const Data& data, const Result& result, const PartErrors& part) {
  std::vector<std::string> header = {"joint", "torque"};
  for (const Candidate& candidate : result.candidates) header.push_back(candidate.name);
  const bool has_maximum = part.of.front().maximum.size() > 0;
  if (has_maximum) header.insert(header.end(), {"max, prior", "max, " + result.candidates[result.tuned].name});
  header.push_back("filtered off");
  Table table(header);
  for (std::size_t j = 0; j < data.robot.joints.size(); ++j) {
    std::vector<std::string> row = {row_name(data.robot.joints[j]), number(at(part.torque_rms, j))};
    for (const Errors& errors : part.of) row.push_back(number(at(errors.rms, j)));
    if (has_maximum) {
      row.push_back(number(at(part.of.front().maximum, j)));
      row.push_back(number(at(part.of[result.tuned].maximum, j)));
    }
    row.push_back(number(at(part.removed, j)));
    table.row(row);
  }
  return table;
}

std::string samples_of(const Data& data, std::size_t samples) {
  return std::to_string(samples) + " samples, " + number(static_cast<double>(samples) * data.smoothing.step) + " s";
}

std::string weighted_sentence(const Result& result) {
  std::string text = "weighted RMS, 1 at the floor: prior " + number(result.prior_rms);
  if (result.swarm) text += ", swarm " + number(result.swarm_rms, 5);
  if (result.feasible_rms > 0) text += ", feasible least squares " + number(result.feasible_rms, 5);
  return text + ", floor " + number(result.floor_rms, 5);
}

std::string swarm_sentence(const SwarmRun& swarm) {
  return std::to_string(swarm.progress.round) + " rounds, " + std::to_string(swarm.progress.reconfigurations) +
         " reconfigurations, " + numerics::to_text(swarm.progress.status);
}

/// `prior`: errors of the URDF.
Table survey_table(const Data& data, const VectorXd* prior = nullptr) {
  std::vector<std::string> header = {"joint",      "q, from",     "to",         "speed", "95 % of power below, Hz",
                                     "torque RMS", "gravity RMS", "correlation"};
  if (prior != nullptr) header.emplace_back("prior's error");
  Table table(std::move(header));
  for (std::size_t j = 0; j < data.survey.joints.size(); ++j) {
    const measurement::JointSurvey& joint = data.survey.joints[j];
    std::vector<std::string> row = {
        row_name(data.robot.joints[j]), number(joint.q_min),   number(joint.q_max),       number(joint.speed_max),
        number(joint.frequency),        number(joint.tau_rms), number(joint.gravity_rms), number(joint.gravity_correlation, 2)};
    if (prior != nullptr) row.push_back(number(at(*prior, j)));
    table.row(std::move(row));
  }
  return table;
}

void write_data(std::ostream& out, const Settings& settings, const Data& data, const Result& result) {
  const measurement::Survey& survey = data.survey;
  out << "## Data\n\n";
  const auto list = [&](const char* what, const std::vector<std::filesystem::path>& files) {
    for (const std::filesystem::path& file : files) out << "* " << what << ": `" << file.string() << "`\n";
  };
  out << "* robot: `" << settings.robot.string() << "`, " << data.robot.joints.size() << " joints\n";
  list(settings.held_out.empty() ? "log" : "training", settings.data);
  list("held out", settings.held_out);
  out << "* " << survey.samples << " samples in " << survey.segments.size()
      << (survey.segments.size() == 1 ? " segment, " : " segments, ") << number(survey.duration) << " s at "
      << number(survey.rate(), 6) << " Hz\n";
  if (settings.held_out.empty())
    out << "* trained on the first " << number(100 * settings.split) << " %, " << samples_of(data, data.training->samples)
        << '\n';
  out << "* zero-phase low-pass at " << number(data.smoothing.cutoff) << " Hz, order " << data.smoothing.order
      << " a pass, on positions and torques alike"
      << (settings.cutoff > 0 ? "" : " (ten times the frequency below which 95 % of the power of the joint velocities lies)")
      << "; " << number(data.smoothing.margin) << " s at both ends of each segment are left out\n\n";

  survey_table(data).write_markdown(out);
  out << "Gravity is the prior's; its correlation with the measured torque tells of signs. rad, rad/s, N·m.\n\n";
  if (result.warnings.empty()) return;
  out << "Warnings:\n\n";
  for (const std::string& warning : result.warnings) out << "* " << warning << '\n';
  out << '\n';
}

void write_settings(std::ostream& out, const Settings& settings, const Result& result) {
  const identification::ModelOptions& model = settings.model;
  out << "## Model and settings\n\n* method " << to_text(settings.method) << ", seed " << settings.seed << ", prior weight "
      << number(settings.prior_weight) << '\n';
  if (result.swarm) {
    out << "* swarm: " << settings.particles << " particles, " << swarm_sentence(*result.swarm) << " (at most "
        << settings.rounds << ")\n";
  }
  out << "* friction " << identification::to_text(model.friction) << (model.viscous ? ", viscous" : "")
      << (model.offset ? ", offset" : "") << (model.load ? ", with the load (μ of the tuned robot's gravity)" : "")
      << "; motor inertia "
      << (model.motor_inertia ? "sought (torques of the motors)" : "not sought (torques behind the gears)") << '\n';
  if (!settings.chosen.empty()) {
    out << "* chosen by cross-validation within the training part (five contiguous parts, each predicted by feasible least "
           "squares "
           "on the others; squared errors against the torques as measured, over those of the first trial, mean of the "
           "joints):\n";
    for (const std::string& sentence : settings.chosen) out << "  * " << sentence << '\n';
  }
  if (!model.harmonics.empty()) {
    out << "* harmonics of the joint's own position, for springs and counterbalances:";
    for (const int count : model.harmonics) out << ' ' << count;
    out << '\n';
  }
  out << '\n';
}

void write_parameters(std::ostream& out, const Data& data, const Result& result) {
  out << "## Parameters\n\n";
  Table bodies({"body", "mass before", "mass", "centre of mass, m", "principal moments, kg·m²"});
  for (std::size_t i = 0; i < result.robot.bodies.size(); ++i) {
    const Inertia& inertia = result.robot.bodies[i].inertia;
    const Eigen::Vector3d moments = numerics::symmetric_eigenvalues<3>(inertia.I_CC);
    bodies.row({result.robot.bodies[i].name, number(data.robot.bodies[i].inertia.mass), number(inertia.mass),
                number(inertia.p_LC.x()) + ", " + number(inertia.p_LC.y()) + ", " + number(inertia.p_LC.z()),
                number(moments[0]) + ", " + number(moments[1]) + ", " + number(moments[2])});
  }
  bodies.write_markdown(out);
  out << "Single masses and inertias are one choice of many with the same torques, the one nearest to the prior; every one is "
         "a body "
         "that can exist.\n\n";
  Table drives({"joint", "B, kg·m²", "τ_C, N·m", "τ_S, N·m", "v_R, rad/s", "s, rad/s", "v_S, rad/s", "σ2, N·m·s/rad",
                "τ_0, N·m", "μ", "harmonics, N·m"});
  const identification::Estimate& tuned = result.candidates[result.tuned].estimate;
  for (std::size_t j = 0; j < tuned.drive.size(); ++j) {
    const identification::JointDrive& d = tuned.drive[j];
    std::string harmonics;
    for (const double h : d.harmonics) text::append(harmonics, number(h));
    drives.row({row_name(data.robot.joints[j]), number(d.B), number(d.tau_C), number(d.tau_S), number(d.v_R), number(d.s),
                number(d.v_S), number(d.sigma2), number(d.tau_0), number(d.load), harmonics});
  }
  drives.write_markdown(out);
  if (result.evaluation.torsion.empty()) return;
  Table torsion({"joint", "stiffness K, N·m/rad", "standard deviation", "correlation of torsion and torque", "lag of q, ms"});
  for (std::size_t j = 0; j < result.evaluation.torsion.size(); ++j) {
    const identification::Torsion& t = result.evaluation.torsion[j];
    torsion.row({row_name(data.robot.joints[j]), t.K > 0 ? number(t.K) : "not found", t.K > 0 ? number(t.deviation, 2) : "",
                 number(t.correlation, 3), number(1e3 * t.lag, 3)});
  }
  torsion.write_markdown(out);
  out << "From θ − q = τ_J/K + lag · q̇ + constant on the training part; the correlation is that at equal speed. Not found: a "
         "standard deviation above 30 %, or less than half of the torsion's variance explained.\n\n";
}

void write_excitation(std::ostream& out, const Result& result) {
  const identification::Excitation& excitation = result.excitation;
  out << "## What the data determine\n\n"
      << excitation.rank << " of " << excitation.unknowns << " unknowns (" << excitation.structural
      << " base parameters, the others friction and motors); condition number " << number(excitation.condition)
      << " of the regressor with columns of unit length.\n\n";
  const std::vector<std::string>& bounds = result.bounds.sentences;
  if (!bounds.empty()) out << "Bounds at which feasible least squares stands, and what it reaches with wider ones:\n\n";
  for (const std::string& bound : bounds) out << "* " << bound << '\n';
  if (!bounds.empty()) out << '\n';
  Table joints({"joint", "σ, N·m (its weight is 1/σ²)", "rank", "of unknowns"});
  for (std::size_t j = 0; j < result.floor.joint_rank.size(); ++j) {
    joints.row({row_name(result.robot.joints[j]), number(at(result.floor.sigma, j)), std::to_string(result.floor.joint_rank[j]),
                std::to_string(result.floor.joint_unknowns[j])});
  }
  joints.write_markdown(out);
  out << "σ is the residual of unconstrained least squares; the rank is that of the joint's own torque.\n\n";
  std::vector<std::string> lost, weak;
  Table table({"unknown", "value", "standard deviation", "relative, %"});
  for (const identification::Determination& unknown : excitation.unknown) {
    const double relative = unknown.relative * result.deviation_factor;
    if (!unknown.determined) {
      lost.push_back(unknown.name);
      continue;
    }
    if (relative > 1) weak.push_back(unknown.name);
    table.row({unknown.name, number(unknown.value), number(unknown.deviation * result.deviation_factor, 3),
               number(100 * relative, 3)});
  }
  const auto list = [&](const char* sentence, const std::vector<std::string>& names) {
    if (names.empty()) return;
    out << sentence;
    for (const std::string& name : names) out << " `" << name << '`';
    out << "\n\n";
  };
  list("Not determined, or only in sums with one another; the pull to the prior decides about them:", lost);
  list("Determined, but not told from zero (standard deviation above the value):", weak);
  table.write_markdown(out);
  out << "Values are those of unconstrained least squares. Standard deviations are " << number(result.deviation_factor, 3)
      << " times those of independent errors: after the low-pass only every so manieth sample is new (2 · cutoff · duration of "
         "them).\n\n";
}

void write_twin(std::ostream& out, const Data& data, const Result& result) {
  if (!result.evaluation.replay) return;
  const Replay& replay = *result.evaluation.replay;
  out << "## The twin\n\n`cotwin run twin.ssd` in this folder moves the tuned twin as the robot moved in `motion.csv` and "
         "compares its "
         "torques with the measured ones (smoothed). These errors are to be expected, RMS in N·m:\n\n";
  Table table({"joint", "training", "torque", "held out", "torque"});
  for (std::size_t j = 0; j < data.robot.joints.size(); ++j) {
    std::vector<std::string> row = {row_name(data.robot.joints[j])};
    for (const Replay::Errors* errors : {&replay.training, &replay.held_out}) {
      row.push_back(errors->samples > 0 ? number(at(errors->rms, j)) : "");
      row.push_back(errors->samples > 0 ? number(at(errors->torque, j)) : "");
    }
    table.row(row);
  }
  table.write_markdown(out);
}

json body_json(const Inertia& inertia) {
  const Eigen::Vector3d moments = numerics::symmetric_eigenvalues<3>(inertia.I_CC);
  return {{"mass", inertia.mass},
          {"centre", std::vector<double>(inertia.p_LC.begin(), inertia.p_LC.end())},
          {"moments", std::vector<double>(moments.begin(), moments.end())}};
}

json drive_json(const identification::JointDrive& d) {
  return {{"B", d.B},     {"tau_C", d.tau_C},   {"tau_S", d.tau_S}, {"v_R", d.v_R},   {"s", d.s},
          {"v_S", d.v_S}, {"sigma2", d.sigma2}, {"tau_0", d.tau_0}, {"load", d.load}, {"harmonics", d.harmonics}};
}

/// The parameters before and after, and how well the data determine them.
void add_parameters(json& object, const Data& data, const Result& result) {
  object["bodies"] = json::array();
  for (std::size_t i = 0; i < result.robot.bodies.size(); ++i) {
    object["bodies"].push_back({{"name", result.robot.bodies[i].name},
                                {"before", body_json(data.robot.bodies[i].inertia)},
                                {"after", body_json(result.robot.bodies[i].inertia)}});
  }
  object["drives"] = json::array();
  const auto &before = result.candidates.front().estimate.drive, &after = result.candidates[result.tuned].estimate.drive;
  for (std::size_t j = 0; j < after.size(); ++j) {
    object["drives"].push_back(
        {{"joint", data.robot.joints[j].name}, {"before", drive_json(before[j])}, {"after", drive_json(after[j])}});
  }
  object["determination"] = json::array();
  for (const identification::Determination& unknown : result.excitation.unknown) {
    json entry = {{"name", unknown.name}, {"determined", unknown.determined}};
    if (unknown.determined) {
      entry["value"] = unknown.value;
      entry["deviation"] = unknown.deviation * result.deviation_factor;
    }
    object["determination"].push_back(std::move(entry));
  }
}

json findings_json(const Data& data) {
  constexpr const char* kKinds[] = {"gravity", "clock", "lag", "torque columns", "joints", "sign"};
  json list = json::array();
  for (const identification::Finding& finding : data.findings) {
    json joints = json::array();
    for (const int j : finding.joints) joints.push_back(data.robot.joints[static_cast<std::size_t>(j)].name);
    list.push_back({{"kind", kKinds[static_cast<std::size_t>(finding.kind)]},
                    {"joints", joints},
                    {"value", finding.value},
                    {"gravity", std::vector<double>(finding.gravity.begin(), finding.gravity.end())},
                    {"gain", finding.gain}});
  }
  return list;
}

json part_json(const PartErrors& part, const Result& result) {
  const auto list = [](const VectorXd& v) { return std::vector<double>(v.data(), v.data() + v.size()); };
  json object;
  object["samples"] = part.samples;
  object["torque"] = list(part.torque_rms);
  object["filtered_off"] = list(part.removed);
  for (std::size_t c = 0; c < part.of.size(); ++c) {
    object["rms"][result.candidates[c].name] = list(part.of[c].rms);
    if (part.of[c].maximum.size() > 0) object["max"][result.candidates[c].name] = list(part.of[c].maximum);
  }
  return object;
}

}  // namespace

void write_table(std::ostream& out, const Data& data, const Result& result) {
  out << data.robot.name << ": " << samples_of(data, data.training->samples) << " of training, low-pass "
      << number(data.smoothing.cutoff) << " Hz, " << result.excitation.rank << " of " << result.excitation.unknowns
      << " unknowns determined, condition number with friction and motors " << number(result.excitation.condition) << '\n';
  if (result.swarm) out << "swarm: " << swarm_sentence(*result.swarm) << ", " << number(result.swarm->seconds, 3) << " s\n";
  out << weighted_sentence(result) << "\n\ntraining, RMS in N.m\n";
  errors_table(data, result, result.evaluation.training).write_plain(out);
  if (!result.chosen.empty()) out << "\nnote: " << result.chosen << '\n';
  if (!result.evaluation.held_out) return;
  out << "\nheld out (" << samples_of(data, result.evaluation.held_out->samples) << "), RMS in N.m\n";
  errors_table(data, result, *result.evaluation.held_out).write_plain(out);
}

void write_check(std::ostream& out, const Data& data, const LogCheck& check) {
  survey_table(data, &check.prior).write_plain(out);
  out << "\nrad, rad/s, N.m (slides: m, m/s, N); gravity and prior: the URDF's\nthe motion determines " << check.excitation.rank
      << " of " << check.excitation.unknowns << " unknowns, condition number " << number(check.excitation.condition, 3) << '\n';
}

std::string check_json(const Data& data, const LogCheck& check) {
  json object;
  for (std::size_t j = 0; j < data.robot.joints.size(); ++j) {
    const measurement::JointSurvey& joint = data.survey.joints[j];
    object["joints"].push_back({{"name", data.robot.joints[j].name},
                                {"q", {joint.q_min, joint.q_max}},
                                {"speed", joint.speed_max},
                                {"torque", joint.tau_rms},
                                {"gravity", joint.gravity_rms},
                                {"correlation", joint.gravity_correlation},
                                {"prior", at(check.prior, j)}});
  }
  object["samples"] = data.survey.samples;
  object["rate"] = data.survey.rate();
  object["rank"] = check.excitation.rank;
  object["unknowns"] = check.excitation.unknowns;
  object["condition"] = check.excitation.condition;
  object["warnings"] = check.warnings;
  object["evidence"] = check.evidence;
  object["findings"] = findings_json(data);
  return object.dump(1) + "\n";
}

std::string report_markdown(const Settings& settings, const Data& data, const Result& result) {
  std::ostringstream out;
  out << "# Tuning of " << data.robot.name << "\n\n";
  if (result.interrupted)
    out << "**Interrupted**: the best parameters so far. `cotwin tune --resume` with this folder goes on.\n\n";
  if (!result.alarms.empty()) {
    out << "**Alarm**: the log or the result is not to be trusted.\n\n";
    for (const std::string& alarm : result.alarms) out << "* " << alarm << '\n';
    out << '\n';
  }
  out << "## Verdict\n\n";
  for (const std::string& verdict : result.verdicts) out << "* " << verdict << '\n';
  out << '\n';
  if (!result.chosen.empty()) out << "Note: " << result.chosen << ".\n\n";
  out << weighted_sentence(result) << ".\n\n## Torque errors, training ("
      << samples_of(data, result.evaluation.training.samples)
      << ")\n\nRMS in N·m; the floor is unconstrained least squares: in the weighted sum over the joints nothing falls below "
         "it.\n\n";
  errors_table(data, result, result.evaluation.training).write_markdown(out);
  if (result.evaluation.held_out) {
    out << "## Torque errors, held out (" << samples_of(data, result.evaluation.held_out->samples)
        << ")\n\nData that no solver has seen.\n\n";
    errors_table(data, result, *result.evaluation.held_out).write_markdown(out);
  } else {
    out << "Nothing was held out: how good the model is on other motions is not known.\n\n";
  }
  if (result.evaluation.every > 1)
    out << "`torques.csv` has every " << result.evaluation.every << "th sample; errors are of all.\n\n";
  write_twin(out, data, result);
  write_data(out, settings, data, result);
  write_settings(out, settings, result);
  write_parameters(out, data, result);
  write_excitation(out, result);
  return out.str();
}

std::string figures_json(const Settings& settings, const Data& data, const Result& result) {
  json object;
  object["state"] = result.interrupted ? "interrupted" : "done";
  object["settings"] = to_json(settings);
  for (const robot::Joint& joint : data.robot.joints) {
    object["joints"].push_back(joint.name);
    object["units"].push_back(joint.type == robot::JointType::kPrismatic ? "N" : "N.m");
  }
  object["tuned"] = result.candidates[result.tuned].name;
  object["alarms"] = result.alarms;
  object["cutoff"] = data.smoothing.cutoff;
  object["rate"] = data.survey.rate();
  object["training"] = part_json(result.evaluation.training, result);
  if (result.evaluation.held_out) object["held_out"] = part_json(*result.evaluation.held_out, result);
  if (result.evaluation.replay) {
    const Replay& replay = *result.evaluation.replay;
    object["twin"]["duration"] = static_cast<double>(replay.end - 1 - replay.begin) * replay.step;
    for (const auto& [name, errors] : {std::pair{"training", &replay.training}, std::pair{"held_out", &replay.held_out}}) {
      if (errors->samples == 0) continue;
      object["twin"][name]["rms"] = std::vector<double>(errors->rms.begin(), errors->rms.end());
      object["twin"][name]["torque"] = std::vector<double>(errors->torque.begin(), errors->torque.end());
    }
  }
  object["weighted_rms"]["prior"] = result.prior_rms;
  if (result.swarm) object["weighted_rms"]["swarm"] = result.swarm_rms;
  if (result.feasible_rms > 0) object["weighted_rms"]["feasible"] = result.feasible_rms;
  object["weighted_rms"]["floor"] = result.floor_rms;
  if (result.swarm) {
    object["swarm"]["rounds"] = result.swarm->progress.round;
    object["swarm"]["reconfigurations"] = result.swarm->progress.reconfigurations;
    object["swarm"]["history"] = result.swarm->history;
  }
  object["sigma"] = std::vector<double>(result.floor.sigma.begin(), result.floor.sigma.end());
  object["joint_rank"] = result.floor.joint_rank;
  object["joint_unknowns"] = result.floor.joint_unknowns;
  object["rank"] = result.excitation.rank;
  object["unknowns"] = result.excitation.unknowns;
  object["condition"] = result.excitation.condition;
  object["robot"] = data.robot.name;
  object["every"] = result.evaluation.every;
  if (!result.chosen.empty()) object["note"] = result.chosen;
  add_parameters(object, data, result);
  for (const identification::Torsion& t : result.evaluation.torsion) {
    object["stiffness"].push_back(t.K);
    object["lag"].push_back(t.lag);
  }
  object["warnings"] = result.warnings;
  object["verdicts"] = result.verdicts;
  object["bounds"] = result.bounds.sentences;
  object["findings"] = findings_json(data);
  for (const Repair& repair : result.repairs.found)
    object["repair"].push_back({{"options", repair.options},
                                {"before", std::vector<double>(repair.before.begin(), repair.before.end())},
                                {"after", std::vector<double>(repair.after.begin(), repair.after.end())}});
  return object.dump(1) + "\n";
}

}  // namespace cotwin::master::tuning
