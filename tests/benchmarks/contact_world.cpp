// Compares the contact world with the Open Dynamics Engine and Bullet: the same bodies, masses, friction and step in each. A
// row is compared with the best figure of any peer. Times are processor times of the thread. Usage:
//   contact_world                           JSON rows
//   contact_world table [CASE [ENGINE]]     a table in Markdown, engines as columns
// CASE and ENGINE: parts of names. "does not end": more than 30 s of processor time.

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

constexpr unsigned kLimit = 30;  // s of processor time of a case in an engine

const std::vector<EngineKind> kEngines{
    {"default", make_default, true, false},       {"Dantzig", make_dantzig, true, true},
    {"ODE quickstep 20", make_ode, false, false}, {"Bullet SI 10", make_bullet, false, false},
    {"MuJoCo", make_mujoco, false, false},
};

// One engine after the other in each round, so that changes of the machine's speed affect all alike.
// `table`: all of Cotwin's methods, not only the default.
std::vector<Outcome> run(const Case& what, const std::string& engine, bool table) {
  std::vector<Outcome> outcomes(kEngines.size());
  for (int round = 0; round < shortened(what.rounds, 1); ++round) {
    for (std::size_t e = 0; e < kEngines.size(); ++e) {
      if ((!table && kEngines[e].ours && e > 0) || (what.many_contacts && kEngines[e].exact) ||
          kEngines[e].name.find(engine) == std::string::npos)
        continue;
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

// Of Cotwin's methods the default alone: what a user gets who chooses nothing.
void print_rows(const Case& what, const std::vector<Outcome>& outcomes) {
  const Outcome& ours = outcomes.front();
  if (!ours.failure.empty()) print({what.name + ": " + ours.failure, "failed runs", 1, "none", 0, 0.5, false});
  for (std::size_t f = 0; f < ours.figures.size(); ++f) {
    const std::size_t peer = best(outcomes, f, false);
    const bool none = peer == kEngines.size();
    print({what.name + ": " + ours.figures[f].name, ours.figures[f].unit, ours.figures[f].value,
           none ? "none" : kEngines[peer].name, none ? 0 : outcomes[peer].figures[f].value, ours.figures[f].goal, false});
  }
}

void print_header() {
  std::printf("| scene |");
  for (const EngineKind& kind : kEngines) std::printf(" %s |", kind.name.c_str());
  std::printf(" goal; ours leads |\n|---|");
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

// Errors below this value are equal.
double negligible(const std::string& unit) {
  if (unit == "um" || unit == "mm" || unit == "mm/s, mrad/s") return 1e-3;
  if (unit == "1" || unit == "rad" || unit == "mJ") return 1e-6;
  return 1e-9;
}

bool as_small(const Figure& figure, const Figure& other) {
  return figure.value <= other.value || figure.value <= negligible(figure.unit);
}

// Whether all errors are as small as the other's.
bool as_accurate(const std::vector<Figure>& figures, const std::vector<Figure>& others) {
  for (std::size_t f = 1; f < figures.size(); ++f) {
    if (!as_small(figures[f], others[f])) return false;
  }
  return true;
}

// The peer with the smallest error; with the smallest time of those that are as accurate as `ours`. kEngines.size(): none.
std::size_t rival(const std::vector<Outcome>& outcomes, std::size_t f, const Outcome& ours) {
  if (f > 0) return best(outcomes, f, false);
  std::vector<Outcome> accurate = outcomes;
  for (Outcome& outcome : accurate) {
    if (!outcome.figures.empty() && !as_accurate(outcome.figures, ours.figures)) outcome.figures.clear();
  }
  return best(accurate, f, false);
}

// "yes" if the default leads, the name of the method that leads, or the peer that does.
std::string leader(const std::vector<Outcome>& outcomes, std::size_t f) {
  std::string lost;
  for (std::size_t e = 0; e < kEngines.size(); ++e) {
    if (!kEngines[e].ours || outcomes[e].figures.empty()) continue;
    const std::size_t peer = rival(outcomes, f, outcomes[e]);
    if (peer == kEngines.size() || as_small(outcomes[e].figures[f], outcomes[peer].figures[f])) {
      return e == 0 ? "yes" : "with " + kEngines[e].name;
    }
    if (lost.empty()) lost = "**no**, " + kEngines[peer].name;
  }
  return lost;
}

// The last column: for errors, whether ours is the smallest; for times, among the engines whose errors are not larger.
void print_scene(const Case& what, const std::vector<Outcome>& outcomes) {
  const std::vector<Figure>* figures = any_figures(outcomes);
  for (std::size_t f = 0; figures != nullptr && f < figures->size(); ++f) {
    const Figure& figure = (*figures)[f];
    std::printf("| %s%s, %s |", f == 0 ? (what.name + ": ").c_str() : "… ", figure.name.c_str(), figure.unit.c_str());
    print_values(outcomes, f);
    if (goal(outcomes, f) > 0) std::printf(" ≤ %.3g;", goal(outcomes, f));
    std::printf(" %s |\n", leader(outcomes, f).c_str());
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "", filter = argc > 2 ? argv[2] : "", engine = argc > 3 ? argv[3] : "";
  if (!mode.empty()) print_header();
  for (const auto& cases : {scene_cases(), public_cases()}) {
    for (const Case& what : cases) {
      if (what.name.find(filter) != std::string::npos)
        (mode.empty() ? print_rows : print_scene)(what, run(what, engine, !mode.empty()));
    }
  }
  return 0;
}
