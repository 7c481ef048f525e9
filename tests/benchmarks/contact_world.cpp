// Compares the contact world with the Open Dynamics Engine and Bullet: the same bodies, masses, friction and step in each. A
// row is compared with the best figure of any peer. Usage: contact_world [table]; `table` prints the figures of all engines in
// Markdown.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/measure.h"

namespace {

using namespace cotwin::benchmark;

const std::vector<EngineKind> kEngines{
    {"tree", make_tree, true, false},
    {"PGS", make_pgs, true, false},
    {"Dantzig", make_dantzig, true, true},
    {"ODE quickstep 20", make_ode_quick, false, false},
    {"ODE Dantzig", make_ode_dantzig, false, true},
    {"Bullet SI 10", make_bullet_si, false, false},
    {"Bullet MLCP Dantzig", make_bullet_dantzig, false, true},
};

// One engine after the other in each round, so that changes of the machine's speed affect all alike.
std::vector<std::vector<Figure>> run(const Case& what, const std::string& engine) {
  std::vector<std::vector<Figure>> figures(kEngines.size());
  for (int round = 0; round < what.rounds; ++round) {
    for (std::size_t e = 0; e < kEngines.size(); ++e) {
      if ((what.many_contacts && kEngines[e].exact) || kEngines[e].name.find(engine) == std::string::npos) continue;
      std::vector<Figure> now = what.run(kEngines[e]);
      if (round > 0) now[0].value = std::min(now[0].value, figures[e][0].value);
      figures[e] = std::move(now);
    }
  }
  return figures;
}

void print_rows(const Case& what, const std::vector<std::vector<Figure>>& figures) {
  for (std::size_t f = 0; f < figures[0].size(); ++f) {
    std::size_t best = kEngines.size();
    for (std::size_t e = 0; e < kEngines.size(); ++e) {
      if (kEngines[e].ours || figures[e].empty() || !std::isfinite(figures[e][f].value)) continue;
      if (best == kEngines.size() || figures[e][f].value < figures[best][f].value) best = e;
    }
    for (std::size_t e = 0; e < kEngines.size(); ++e) {
      if (!kEngines[e].ours || figures[e].empty()) continue;
      const Figure& figure = figures[e][f];
      print({what.name + ", " + kEngines[e].name + ": " + figure.name, figure.unit, figure.value,
             best < kEngines.size() ? kEngines[best].name : "none", best < kEngines.size() ? figures[best][f].value : 0,
             figure.goal, false});
    }
  }
}

void print_table(const Case& what, const std::vector<std::vector<Figure>>& figures) {
  std::printf("\n| %s |", what.name.c_str());
  for (const EngineKind& kind : kEngines) std::printf(" %s |", kind.name.c_str());
  std::printf(" goal |\n|---|");
  for (std::size_t e = 0; e <= kEngines.size(); ++e) std::printf("---|");
  std::printf("\n");
  const auto some = std::find_if(figures.begin(), figures.end(), [](const auto& of_engine) { return !of_engine.empty(); });
  for (std::size_t f = 0; some != figures.end() && f < some->size(); ++f) {
    const Figure& figure = (*some)[f];
    std::printf("| %s, %s |", figure.name.c_str(), figure.unit.c_str());
    for (const auto& of_engine : figures) {
      of_engine.empty() ? std::printf(" – |") : std::printf(" %.3g |", of_engine[f].value);
    }
    figure.goal > 0 ? std::printf(" ≤ %g |\n", figure.goal) : std::printf(" |\n");
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const bool table = argc > 1 && std::string(argv[1]) == "table";
  const std::string filter = argc > 2 ? argv[2] : "", engine = argc > 3 ? argv[3] : "";
  for (const auto& cases : {scene_cases(), public_cases()}) {
    for (const Case& what : cases) {
      if (what.name.find(filter) == std::string::npos) continue;
      (table ? print_table : print_rows)(what, run(what, engine));
    }
  }
  return 0;
}
