// Scenes with closed forms in all engines, at several steps and sizes.
#include "tests/benchmarks/contact/closed_forms.h"

#include <cmath>
#include <cstdio>

#include "tests/benchmarks/contact/cases.h"
#include "tests/benchmarks/contact/isolated.h"
#include "tests/benchmarks/contact/run.h"
#include "tests/support/closed_forms.h"

namespace cotwin::benchmark {
namespace {

constexpr unsigned kLimit = 60;  // s of processor time of a cell

const std::vector<EngineKind> kEngines{{"tree", make_user_tree, true, false},
                                       {"pgs", make_user_pgs, true, false},
                                       {"dantzig", make_user_dantzig, true, true},
                                       {"ODE quickstep 20", make_ode_quick, false, false},
                                       {"ODE Dantzig", make_ode_dantzig, false, true},
                                       {"Bullet SI 10", make_bullet_si, false, false},
                                       {"Bullet MLCP Dantzig", make_bullet_dantzig, false, true}};

using testing::Setting, testing::kSettings;

std::vector<Figure> watch(const testing::ClosedForm& form, const EngineKind& kind, const Setting& setting) {
  const scene::Scene unscaled = form.make();
  const double time = std::sqrt(setting.scale), force = std::pow(setting.scale, 3);
  Run run(kind, testing::scaled(unscaled, setting.scale), setting.h);
  std::vector<Pose> start, X(unscaled.bodies.size());
  std::vector<Twist> V(unscaled.bodies.size());
  for (const scene::Body& body : unscaled.bodies) start.push_back(body.X_WB);
  double value = 0;
  const auto steps = std::lround(form.duration * time / setting.h);
  for (long k = 1; k <= steps && !run.engine().ended(); ++k) {
    for (std::size_t b = 0; form.load != nullptr && b < X.size(); ++b) {
      if (unscaled.bodies[b].motion == scene::Motion::kDynamic) run.engine().apply(b, form.load(b) * force);
    }
    run.step();
    for (std::size_t b = 0; b < X.size(); ++b) {
      X[b] = {run.X_WB[b].R, run.X_WB[b].p / setting.scale};
      V[b] << run.V_WB[b].head<3>() / setting.scale * time, run.V_WB[b].tail<3>() * time;
    }
    value = form.value(unscaled, {start, X, V, static_cast<double>(k) * setting.h / time}, value);
  }
  return {{form.figure, form.unit, value, 0},
          {"told", "1", run.engine().told() ? 1.0 : 0.0, 0},
          {"ended", "1", run.engine().ended() ? 1.0 : 0.0, 0}};
}

enum class Verdict { kRight, kTold, kWrong, kEnded };

Verdict judge(const testing::ClosedForm& form, const Setting& setting, const Outcome& outcome) {
  if (outcome.figures.empty()) return outcome.failure == "–" ? Verdict::kRight : Verdict::kTold;
  if (outcome.figures[2].value > 0) return Verdict::kEnded;
  if (form.is_right(outcome.figures[0].value, setting)) return Verdict::kRight;
  return outcome.figures[1].value > 0 ? Verdict::kTold : Verdict::kWrong;
}

void print_cell(const Outcome& outcome, Verdict verdict) {
  if (outcome.figures.empty()) {
    std::printf(" %s |", outcome.failure.c_str());
    return;
  }
  if (verdict == Verdict::kEnded) {
    std::printf(" error |");
    return;
  }
  const char* const words[] = {"", ", told", ", **wrong**"};
  std::printf(" %.2g%s |", outcome.figures[0].value, words[static_cast<int>(verdict)]);
}

}  // namespace

int print_closed_forms(const std::string& filter, const std::string& engine) {
  std::printf("| scene | step, ms | size | closed form |");
  for (const EngineKind& kind : kEngines) std::printf(" %s |", kind.name.c_str());
  std::printf("\n|---|---|---|---|");
  for (std::size_t e = 0; e < kEngines.size(); ++e) std::printf("---|");
  std::printf("\n");
  int silent = 0;
  for (const testing::ClosedForm& form : testing::closed_forms()) {
    if (form.scene.find(filter) == std::string::npos) continue;
    for (const Setting& setting : kSettings) {
      if (&setting == kSettings) {
        std::printf("| %s: %s, %s |", form.scene.c_str(), form.figure.c_str(), form.unit.c_str());
      } else {
        std::printf("| … |");
      }
      std::printf(" %g | %g | %s |", 1e3 * setting.h, setting.scale, form.exact.c_str());
      for (const EngineKind& kind : kEngines) {
        if (kind.name.find(engine) == std::string::npos) continue;
        const Case what{form.scene, [&](const EngineKind& one) { return watch(form, one, setting); }};
        const Outcome outcome = run_isolated(what, kind, kLimit);
        const Verdict verdict = judge(form, setting, outcome);
        silent += kind.ours && verdict == Verdict::kWrong;
        print_cell(outcome, verdict);
        std::fflush(stdout);
      }
      std::printf("\n");
    }
  }
  std::printf("\n%d cells of Cotwin are wrong and not told.\n", silent);
  return silent;
}

}  // namespace cotwin::benchmark
