#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/optimisation/budget.h"

namespace cotwin::optimisation {

namespace {

/// Whether a is at least as good as b in all costs.
bool no_worse(std::span<const double> a, std::span<const double> b) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!(a[i] <= b[i])) return false;
  return true;
}

/// Index of the member with the least room between its neighbours in the costs, the extreme ones excepted (NSGA-II's crowding
/// distance, Deb et al. 2002).
std::size_t most_crowded(const std::vector<Round::Particle>& members) {
  std::vector<double> room(members.size(), 0.0);
  std::vector<std::pair<double, std::size_t>> order(members.size());
  for (std::size_t i = 0; i < members.front().costs.size(); ++i) {
    for (std::size_t k = 0; k < order.size(); ++k) order[k] = {members[k].costs[i], k};
    if (i > 0) std::ranges::sort(order);  // by the first cost they are in order
    const double range = order.back().first - order.front().first;
    room[order.front().second] = room[order.back().second] = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k + 1 < order.size(); ++k)
      if (range > 0) room[order[k].second] += (order[k + 1].first - order[k - 1].first) / range;
  }
  return static_cast<std::size_t>(std::min_element(room.begin(), room.end()) - room.begin());
}

}  // namespace

bool Archive::covers(std::span<const double> costs) const {
  return std::ranges::any_of(members_, [&](const Round::Particle& member) { return no_worse(member.costs, costs); });
}

bool Archive::add(const Round::Particle& particle) {
  if (!particle.feasible() ||
      !std::all_of(particle.costs.begin(), particle.costs.end(), [](double x) { return std::isfinite(x); }))
    return false;
  if (covers(particle.costs)) return false;
  std::erase_if(members_, [&](const auto& member) { return no_worse(particle.costs, member.costs); });
  const auto place = std::upper_bound(members_.begin(), members_.end(), particle,
                                      [](const auto& a, const auto& b) { return a.costs < b.costs; });
  members_.insert(place, particle);
  if (members_.size() > capacity_) {
    const std::size_t crowded = most_crowded(members_);
    members_.erase(members_.begin() + static_cast<std::ptrdiff_t>(crowded));
  }
  return true;
}

std::vector<Round::Particle> pareto_front(const Problem& problem, int directions, const SearchOptions& options,
                                          numerics::Threads* threads, bool* complete, std::uint64_t* evaluations) {
  const std::size_t count = problem.costs.size();
  if (count < 2) throw Error("optimisation", "a Pareto front of one cost, expected at least two");
  if (directions < 2 || directions > 1000)
    throw Error("optimisation", std::to_string(directions) + " directions of a Pareto front, expected 2 to 1000");
  Archive archive;
  SearchOptions all = options;
  all.on_round = [&](const Round& round) {
    for (const auto& particle : round.particles) archive.add(particle);
    return !options.on_round || options.on_round(round);
  };
  Budget budget(all);
  if (complete) *complete = true;
  if (evaluations) *evaluations = 0;
  const auto keep = [&](Archive& kept, const Solution& s) {
    if (s.status == Status::kFeasible) kept.add({s.c, s.q_to, s.T, s.costs, 0, 0, s.compliance});
  };
  const std::vector<double> quintic(problem.robot.joints.size() * static_cast<std::size_t>(problem.degree - 5), 0.0);
  if (problem.end_postures.empty())
    for (const double T : {problem.T_min, problem.T_max}) keep(archive, assess(problem, quintic, problem.ends.q_to, T));
  Problem weighted = problem;
  const auto search = [&](const std::vector<double>& weights) {
    for (std::size_t i = 0; i < count; ++i) weighted.costs[i].weight = weights[i];
    Solution solution = minimise(weighted, budget.left(), threads);
    budget.spend(solution.evaluations);
    if (evaluations) *evaluations += solution.evaluations;
    if (complete) *complete = *complete && solution.complete;
    keep(archive, solution);
    return solution;
  };
  // The optimum of each cost alone gives the spread of the others.
  std::vector<double> least(count, std::numeric_limits<double>::infinity()), most(count, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<double> weights(count, 0.0);
    weights[i] = 1;
    const Solution solution = search(weights);
    for (std::size_t k = 0; k < count; ++k) {
      least[k] = std::min(least[k], solution.costs[k]);
      most[k] = std::max(most[k], solution.costs[k]);
    }
  }
  for (int step = 1; step + 1 < directions; ++step) {
    // Van der Corput's sequence in each further base spreads the weights for any number of costs.
    std::vector<double> weights(count);
    double rest = 1;
    for (std::size_t i = 0; i < count; ++i) {
      double share = static_cast<double>(step) / (directions - 1);
      if (i > 0) {
        share = 0;
        double digit = 1;
        for (int k = step, base = static_cast<int>(i) + 1; k > 0; k /= base) share += (digit /= base) * (k % base);
      }
      const double part = i + 1 == count ? rest : rest * share;
      rest -= part;
      weights[i] = part / std::max(most[i] - least[i], 1e-300);
    }
    search(weights);
  }
  Archive checked;
  for (const auto& member : archive.members())
    keep(checked, assess(problem, member.c, member.q_to, member.T, member.compliance));
  return checked.members();
}

}  // namespace cotwin::optimisation
