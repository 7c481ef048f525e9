#include "master/workflows/tuning/bounds.h"

#include <algorithm>
#include <span>

#include "models/foundation/support/text.h"

namespace cotwin::master::tuning {
namespace {

using Bound = identification::ActiveBound::Kind;
using B = identification::Bounds;

constexpr double kTold = 0.01, kMatters = 0.05, kAlike = 0.02;  // of the weighted RMS

/// A kind of bounds that is active, and how far it is widened.
struct Wider {
  Bound kind;
  std::string name, option;  // of friction there is none
  double B::*most;
  double factor;
  double B::*least = nullptr;
  std::string value = {}, of = {};

  /// Widens as far as the option goes.
  void widen(double by, const B& b) { factor = option.empty() ? by : std::min(by, most_of_bound(kind) / b.*most); }
};

std::string figure(double x, int count = 3) { return text::to_text(x, count); }

std::vector<Wider> active(const B& b, const std::vector<identification::ActiveBound>& bounds) {
  const auto speeds = [](double from, double to) { return figure(from) + " to " + figure(to) + " rad/s"; };
  std::vector<Wider> kinds = {
      {Bound::kMass, "mass", "--mass-factor", &B::mass_factor, 10, nullptr, figure(b.mass_factor) + " times the URDF's"},
      {Bound::kStretch, "stretch of the mass distribution", "--stretch-factor", &B::stretch_factor, 10, nullptr,
       figure(b.stretch_factor)},
      {Bound::kShear, "shear of the mass distribution", "--shear", &B::shear, 3, nullptr, figure(b.shear)},
      {Bound::kShift, "shift of the centre of mass", "--shift", &B::shift, 3, nullptr, figure(b.shift)},
      {Bound::kVR, "v_R", "", &B::v_R_max, 10, &B::v_R_min, speeds(b.v_R_min, b.v_R_max)},
      {Bound::kVS, "v_S", "", &B::v_S_max, 10, &B::v_S_min, speeds(b.v_S_min, b.v_S_max)},
      {Bound::kS, "s", "", &B::s_max, 10, nullptr, speeds(-b.s_max, b.s_max)}};
  for (const identification::ActiveBound& bound : bounds)
    for (Wider& kind : kinds)
      if (kind.kind == bound.kind) text::append(kind.of, bound.of);
  std::erase_if(kinds, [](const Wider& kind) { return kind.of.empty(); });
  for (Wider& kind : kinds) kind.widen(kind.factor, b);
  return kinds;
}

}  // namespace

BoundsCost cost_of_bounds(const Settings& settings, const Data& data, const identification::Problem& problem,
                          const identification::FeasibleResult& solution, const Hooks& hooks) {
  const B& b = settings.bounds;
  const std::vector<Wider> kinds = active(b, problem.active_bounds(solution.xi));
  BoundsCost cost;
  if (kinds.empty()) return cost;
  const auto with = [&](std::span<const Wider> widened) {
    identification::ProblemOptions options = problem_options(settings);
    options.sigma = problem.sigma();
    for (const Wider& kind : widened) {
      options.bounds.*kind.most *= kind.factor;
      if (kind.least != nullptr) options.bounds.*kind.least /= kind.factor;
    }
    identification::FeasibleOptions feasible;
    feasible.stop = hooks.stop;
    return identification::solve_feasible(identification::Problem(data.training->data, data.robot, options), feasible);
  };
  const CompressedPart& judged = data.held_out ? *data.held_out : *data.training;
  const auto errors = [&](const identification::FeasibleResult& found) { return judged.data.rms(found.estimate); };
  const double now = solution.weighted_rms;
  const std::string says = ": weighted RMS " + figure(now, 5) + ", with ";
  const identification::FeasibleResult all = with(kinds);
  cost.with_all = errors(all);
  const bool matter = all.weighted_rms < (1 - kTold) * now;
  std::vector<double> alone;  // weighted RMS
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const Wider& kind = kinds[k];
    alone.push_back(matter && kinds.size() > 1 ? with(std::span(kinds).subspan(k, 1)).weighted_rms : all.weighted_rms);
    cost.sentences.push_back(kind.name + " (" + kind.value + "), of " + kind.of + ", is at its bound" + says +
                             (matter ? (kind.option.empty() ? "up to" : kind.option) + " " + figure(b.*kind.most * kind.factor)
                                     : "all bounds wider") +
                             " " + figure(alone.back(), 5));
  }
  if (matter && kinds.size() > 1) cost.sentences.push_back("together" + says + "all of these " + figure(all.weighted_rms, 5));
  if (!(all.weighted_rms < (1 - kMatters) * now)) return cost;

  // Kinds of bodies come first.
  const auto bodies =
      static_cast<std::size_t>(std::ranges::count_if(kinds, [](const Wider& kind) { return !kind.option.empty(); }));
  std::vector<Wider> of_bodies(kinds.begin(), kinds.begin() + static_cast<std::ptrdiff_t>(bodies));
  const std::span<const Wider> of_friction = std::span(kinds).subspan(bodies);
  if (!of_friction.empty()) {
    const identification::FeasibleResult wider = bodies == 0 ? all : with(of_friction);
    if (wider.weighted_rms < (1 - kMatters) * now) {
      cost.with_friction = errors(wider);
      for (const Wider& kind : of_friction) text::append(cost.friction, kind.name + " (" + kind.value + ")");
    }
  }
  if (bodies == 0) return cost;
  identification::FeasibleResult wider = of_friction.empty() ? all : with(of_bodies);
  const double best = wider.weighted_rms;
  if (hooks.stopped() || !(best < (1 - kMatters) * now)) return cost;
  const auto enough = [&](double rms) { return rms <= (1 + kAlike) * best; };
  // One kind, if it does; then as little as does.
  const auto first = std::ranges::min_element(alone.begin(), alone.begin() + static_cast<std::ptrdiff_t>(bodies));
  if (enough(*first)) of_bodies = {kinds[static_cast<std::size_t>(first - alone.begin())]};
  for (const double factor : {2.0, 4.0, 10.0}) {
    for (Wider& kind : of_bodies) kind.widen(factor, b);
    wider = with(of_bodies);
    if (enough(wider.weighted_rms)) break;
  }
  if (hooks.stopped()) return cost;
  cost.with_bodies = errors(wider);
  std::string where, how;
  for (const Wider& kind : of_bodies) {
    text::append(where, kind.name + " of " + kind.of + " is at its bound (" + kind.value + ")");
    how += (how.empty() ? "" : " ") + kind.option + " " + figure(b.*kind.most * kind.factor, 6);
    text::append(cost.options, kind.option);
  }
  cost.alarm = where + ": " + how + " lowers the weighted RMS from " + figure(now) + " to " + figure(wider.weighted_rms);
  return cost;
}

}  // namespace cotwin::master::tuning
