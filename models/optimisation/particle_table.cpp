#include "models/optimisation/particle_table.h"

#include <algorithm>
#include <string>
#include <vector>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"

namespace cotwin::optimisation {

namespace {

std::vector<std::string> columns_of(const Problem& problem) {
  check(problem);
  std::vector<std::string> names{"stage", "round", "particle", "T", "feasible", "kinematic", "torque"};
  for (const CostTerm& cost : problem.costs) {
    const std::string name = std::string("cost_") + to_text(cost.quantity);
    const auto same =
        std::count_if(names.begin(), names.end(), [&](const std::string& other) { return other.rfind(name, 0) == 0; });
    names.push_back(same > 0 ? name + "_" + std::to_string(same + 1) : name);
  }
  const std::size_t axes = problem.compliant ? problem.compliant->axes.size() : 0;
  for (std::size_t k = 1; k <= axes; ++k)
    for (const char* name : {"M", "D", "S"}) names.push_back(std::string(name) + "[" + std::to_string(k) + "]");
  const std::size_t n = problem.robot.joints.size(), K = static_cast<std::size_t>(problem.degree - 5);
  for (std::size_t j = 1; j <= n; ++j) names.push_back("q_to[" + std::to_string(j) + "]");
  for (std::size_t j = 1; j <= n; ++j)
    for (std::size_t k = 1; k <= K; ++k) names.push_back("c_r[" + std::to_string(j) + ";" + std::to_string(k) + "]");
  return names;
}

}  // namespace

struct ParticleTable::Table {
  std::vector<std::string> names;
  csv::Writer writer;
  Table(std::ostream& out, const Problem& problem) : names(columns_of(problem)), writer(out, names) {}
};

ParticleTable::ParticleTable(std::ostream& out, const Problem& problem, int every)
    : table_(std::make_unique<Table>(out, problem)), every_(every) {
  if (every < 1) throw Error("particles", "every " + std::to_string(every) + " rounds, expected at least 1");
}

ParticleTable::~ParticleTable() = default;

void ParticleTable::add(const Round& round) {
  if (round.round % every_ != 0) return;
  csv::Writer& w = table_->writer;
  for (std::size_t i = 0; i < round.particles.size(); ++i) {
    const Round::Particle& p = round.particles[i];
    for (const double x : {static_cast<double>(round.stage), static_cast<double>(round.round), static_cast<double>(i), p.T,
                           p.feasible() ? 1.0 : 0.0, p.kinematic, p.torque})
      w.cell(x);
    for (const double x : p.costs) w.cell(x);
    for (const ComplianceValues& v : p.compliance)
      for (const double x : {v.M, v.D, v.S}) w.cell(x);
    for (const auto* list : {&p.q_to, &p.c})
      for (const double x : *list) w.cell(x);
    w.end_row();
    ++rows_;
  }
}

std::function<bool(const Round&)> ParticleTable::on_round(std::function<bool(const Round&)> then) {
  return [this, then](const Round& round) {
    add(round);
    return !then || then(round);
  };
}

}  // namespace cotwin::optimisation
