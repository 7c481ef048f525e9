// Compares the contact world with the Open Dynamics Engine and Bullet: the same bodies, masses, friction and step in each. A
// row is compared with the best figure of any peer. Times are processor times of the thread. Usage:
//   contact_world                           JSON rows
//   contact_world table [CASE [ENGINE]]     a table in Markdown for each case, engines as columns
//   contact_world scenes [CASE [ENGINE]]    the hard scenes as one table, with the ratio to the best peer
// CASE and ENGINE: parts of names.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/isolated.h"
#include "tests/benchmarks/measure.h"

namespace {

using namespace cotwin::benchmark;

constexpr unsigned kLimit = 60;  // s of processor time of a case in an engine

const std::vector<EngineKind> kEngines{
    {"default", make_default, true, false},
    {"tree", make_tree, true, false},
    {"PGS", make_pgs, true, false},
    {"Dantzig", make_dantzig, true, true},
    {"ODE quickstep 20", make_ode_quick, false, false},
    {"ODE Dantzig", make_ode_dantzig, false, true},
    {"Bullet SI 10", make_bullet_si, false, false},
    {"Bullet MLCP Dantzig", make_bullet_dantzig, false, true},
    {"Bullet multibody", make_bullet_multibody, false, false},
    {"MuJoCo", make_mujoco, false, false},
};

// One engine after the other in each round, so that changes of the machine's speed affect all alike.
std::vector<Outcome> run(const Case& what, const std::string& engine) {
  std::vector<Outcome> outcomes(kEngines.size());
  for (int round = 0; round < what.rounds; ++round) {
    for (std::size_t e = 0; e < kEngines.size(); ++e) {
      if ((what.many_contacts && kEngines[e].exact) || kEngines[e].name.find(engine) == std::string::npos) continue;
      if (!outcomes[e].failure.empty()) continue;
      Outcome now = run_isolated(what, kEngines[e], kLimit);
      if (round > 0 && now.failure.empty()) {
        now.figures[0].value = std::min(now.figures[0].value, outcomes[e].figures[0].value);
      }
      outcomes[e] = std::move(now);
    }
  }
  return outcomes;
}

// The engine with the smallest figure; kEngines.size() if none has a number.
std::size_t best(const std::vector<Outcome>& outcomes, std::size_t f, bool ours) {
  std::size_t best = kEngines.size();
  for (std::size_t e = 0; e < kEngines.size(); ++e) {
    if (kEngines[e].ours != ours || outcomes[e].figures.empty() || !std::isfinite(outcomes[e].figures[f].value)) continue;
    if (best == kEngines.size() || outcomes[e].figures[f].value < outcomes[best].figures[f].value) best = e;
  }
  return best;
}

const std::vector<Figure>* any_figures(const std::vector<Outcome>& outcomes) {
  const auto some = std::find_if(outcomes.begin(), outcomes.end(), [](const Outcome& o) { return !o.figures.empty(); });
  return some != outcomes.end() ? &some->figures : nullptr;
}

void print_rows(const Case& what, const std::vector<Outcome>& outcomes) {
  const std::vector<Figure>* figures = any_figures(outcomes);
  for (std::size_t f = 0; figures != nullptr && f < figures->size(); ++f) {
    const std::size_t peer = best(outcomes, f, false);
    for (std::size_t e = 0; e < kEngines.size(); ++e) {
      if (!kEngines[e].ours || outcomes[e].figures.empty()) continue;
      const Figure& figure = outcomes[e].figures[f];
      print({what.name + ", " + kEngines[e].name + ": " + figure.name, figure.unit, figure.value,
             peer < kEngines.size() ? kEngines[peer].name : "none",
             peer < kEngines.size() ? outcomes[peer].figures[f].value : 0, figure.goal, false});
    }
  }
}

void print_engines(const std::string& first, const std::string& last) {
  std::printf("\n| %s |", first.c_str());
  for (const EngineKind& kind : kEngines) std::printf(" %s |", kind.name.c_str());
  std::printf(" %s |\n|---|", last.c_str());
  for (std::size_t e = 0; e <= kEngines.size(); ++e) std::printf("---|");
  std::printf("\n");
}

void print_values(const std::vector<Outcome>& outcomes, std::size_t f) {
  for (const Outcome& outcome : outcomes) {
    if (outcome.figures.empty()) {
      std::printf(" %s |", outcome.failure.empty() ? "–" : outcome.failure.c_str());
    } else {
      std::printf(" %.2g |", outcome.figures[f].value);
    }
  }
}

double goal(const std::vector<Outcome>& outcomes, std::size_t f) {
  double goal = 0;
  for (std::size_t e = 0; e < kEngines.size(); ++e) {
    if (kEngines[e].ours && !outcomes[e].figures.empty()) goal = std::max(goal, outcomes[e].figures[f].goal);
  }
  return goal;
}

void print_table(const Case& what, const std::vector<Outcome>& outcomes) {
  print_engines(what.name, "goal");
  const std::vector<Figure>* figures = any_figures(outcomes);
  for (std::size_t f = 0; figures != nullptr && f < figures->size(); ++f) {
    std::printf("| %s, %s |", (*figures)[f].name.c_str(), (*figures)[f].unit.c_str());
    print_values(outcomes, f);
    goal(outcomes, f) > 0 ? std::printf(" ≤ %.3g |\n", goal(outcomes, f)) : std::printf(" |\n");
  }
  std::fflush(stdout);
}

// Errors below this share of a figure's unit are rounding: no engine leads there.
constexpr double kRounding = 1e-9;

// The last column compares our default and our best method with the best peer.
void print_scene(const Case& what, const std::vector<Outcome>& outcomes) {
  const std::vector<Figure>* figures = any_figures(outcomes);
  for (std::size_t f = 0; figures != nullptr && f < figures->size(); ++f) {
    std::printf("| %s%s, %s |", f == 0 ? (what.name + ": ").c_str() : "… ", (*figures)[f].name.c_str(),
                (*figures)[f].unit.c_str());
    print_values(outcomes, f);
    const std::size_t ours = best(outcomes, f, true), peer = best(outcomes, f, false);
    if (goal(outcomes, f) > 0) std::printf(" ≤ %.3g;", goal(outcomes, f));
    if (ours == kEngines.size() || peer == kEngines.size()) {
      std::printf(" |\n");
      continue;
    }
    const double theirs = outcomes[peer].figures[f].value;
    const auto leads = [&](double value) { return value <= theirs || value < kRounding; };
    const bool by_default = !outcomes[0].figures.empty() && leads(outcomes[0].figures[f].value);
    if (by_default) {
      std::printf(" yes |\n");
    } else if (leads(outcomes[ours].figures[f].value)) {
      std::printf(" with %s |\n", kEngines[ours].name.c_str());
    } else {
      std::printf(" **no**, %s |\n", kEngines[peer].name.c_str());
    }
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "", filter = argc > 2 ? argv[2] : "", engine = argc > 3 ? argv[3] : "";
  std::vector<std::vector<Case>> all{loop_cases(), static_cases(), shape_cases(), sim_benchmark(), foreign_cases()};
  if (mode != "scenes") {
    all.insert(all.begin(), {scene_cases(), public_cases()});
  } else {
    print_engines("scene", "goal; ours leads");
  }
  const auto print_case = mode == "table" ? print_table : mode == "scenes" ? print_scene : print_rows;
  for (const auto& cases : all) {
    for (const Case& what : cases) {
      if (what.name.find(filter) != std::string::npos) print_case(what, run(what, engine));
    }
  }
  return 0;
}
