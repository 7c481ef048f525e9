#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/optimisation/reactionless/integrator.h"

namespace cotwin::optimisation {

void grow_reactionless(const ReactionlessProblem& p, std::uint32_t motions, std::uint64_t seed, numerics::Threads* threads,
                       const std::function<void(const ReactionlessGrown&)>& visit) {
  using Eigen::Index;
  numerics::Threads alone(1);
  if (!threads) threads = &alone;
  constexpr std::uint32_t kWorkers = 16, kBatch = 512;
  std::vector<std::unique_ptr<Integrator>> integrators;
  for (std::uint32_t k = 0; k < std::min(kWorkers, motions); ++k) integrators.push_back(std::make_unique<Integrator>(p));
  std::string obstacle;
  const auto basis = attitude_keeping(*integrators.front(), p.robot.n(), obstacle);
  if (!basis) throw NoReactionlessMotion(obstacle);
  for (auto& i : integrators) i->keep_attitude(*basis);
  const Eigen::MatrixXd phi = table_of(kSteps);
  std::vector<ReactionlessGrown> batch(std::min(kBatch, motions));
  for (std::uint32_t first = 0; first < motions;) {
    const std::uint32_t count = std::min(kBatch, motions - first);
    const auto evaluate = [&](std::size_t worker) {
      Eigen::MatrixXd rates(p.robot.n(), kSteps + 1);
      for (std::size_t at = worker; at < count; at += integrators.size()) {
        ReactionlessGrown& own = batch[at];
        own = {};
        own.number = first + static_cast<std::uint32_t>(at);
        integrators[worker]->run(
            drawn(basis->cols(), seed, own.number), phi,
            [&](Index k, const Eigen::VectorXd& q, const Eigen::VectorXd& dq, const Eigen::Quaterniond& Q) {
              rates.col(k) = dq;
              for (std::size_t j = 0; j < p.bounds.q_min.size(); ++j) {
                const double x = q[static_cast<Index>(j)], beyond = std::max(p.bounds.q_min[j] - x, x - p.bounds.q_max[j]);
                if (beyond <= own.beyond) continue;
                own.beyond = beyond;
                own.joint = j;
              }
              if (k < kSteps) return;
              own.q.assign(q.begin(), q.end());
              own.pose = integrators[worker]->pose(q, Q);
            });
        each_rate(rates, [&](Index, Index j, double dq, double ddq, double dddq) {
          const auto joint = static_cast<std::size_t>(j);
          own.T = std::max(
              {own.T, dq / p.bounds.dq[joint], std::sqrt(ddq / p.bounds.ddq[joint]), std::cbrt(dddq / p.bounds.dddq[joint])});
        });
      }
    };
    threads->run(integrators.size(), evaluate);
    for (std::uint32_t k = 0; k < count; ++k) visit(batch[k]);
    first += count;
  }
}

}  // namespace cotwin::optimisation
