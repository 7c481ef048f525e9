#include "models/identification/swarm_search.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/identification/problem_impl.h"
#include "models/numerics/batch.h"
#include "models/numerics/dense.h"

namespace cotwin::identification {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using numerics::kSwarmBlock;

constexpr std::uint64_t kMark = 0x31474e494e555443;  // "CTUNING1", little-endian

std::vector<double> list(const VectorXd& v) { return {v.begin(), v.end()}; }

/// The swarm's coordinates y: ξ = centre + E y. The columns of E are the principal axes of (∂r/∂ξ)ᵀ(∂r/∂ξ) at the centre. A
/// coordinate ξ_i on a face of the box is an axis of its own, because steps along any other axis would be clamped to the face.
struct Chart {
  VectorXd centre;
  RowMajor E;
  VectorXd curvature;  // per axis
  double promise = 0;  // decrease of the cost that the quadratic model at the centre predicts

  Chart() = default;
  Chart(const Problem& problem, const VectorXd& at) : centre(at) {
    VectorXd r;
    MatrixXd J;
    problem.residuals(at, r, &J);
    MatrixXd H = J.transpose() * J;
    for (Index i = 0; i < at.size(); ++i) {
      if (at[i] > problem.lower()[i] && at[i] < problem.upper()[i]) continue;
      const double own = H(i, i);
      H.row(i).setZero();
      H.col(i).setZero();
      H(i, i) = own;
    }
    const numerics::SymmetricEigen<Eigen::Dynamic> axes = numerics::symmetric_eigen(H);
    E = axes.vectors;
    curvature = axes.values.cwiseMax(1e-300);
    promise = (E.transpose() * (J.transpose() * r)).cwiseAbs2().cwiseQuotient(curvature).sum();
  }
  /// Half widths of a box in y that contains the box of the problem; points outside that box are clamped.
  VectorXd reach(const Problem& problem) const {
    const VectorXd far = (problem.lower() - centre).cwiseAbs().cwiseMax((problem.upper() - centre).cwiseAbs());
    return E.cwiseAbs().transpose() * far;
  }
  /// Standard deviations at which the cost grows by about `excess`, at most `most`. `careful`: smaller again on axes of little
  /// curvature (damped like Levenberg–Marquardt steps). Otherwise a swarm far from the optimum, which follows a few axes,
  /// drifts along all the others to the faces of the box.
  VectorXd spread(double excess, double most, bool careful) const {
    const double share = excess / static_cast<double>(curvature.size());
    if (!careful) return (share * curvature.cwiseInverse()).cwiseSqrt().cwiseMin(most);
    const double damping = share / (most * most);
    return std::sqrt(share) * (curvature.array().sqrt() / (curvature.array() + damping)).matrix();
  }
};

}  // namespace

struct SwarmSearch::Impl {
  const Problem* problem;
  SwarmSearchOptions options;
  Chart chart;
  numerics::BatchMatrix turn;
  std::vector<std::vector<double>> scratch;  // per block
  std::unique_ptr<numerics::Swarm> swarm;

  Impl(const Problem& p, const SwarmSearchOptions& o) : problem(&p), options(o) {
    if (!(options.spread > 0)) throw Error("spread", std::to_string(options.spread) + ", expected above 0");
  }

  void use(Chart c) {
    chart = std::move(c);
    const auto d = static_cast<std::size_t>(chart.centre.size());
    turn = numerics::BatchMatrix(d, d, chart.E.data());
  }

  numerics::Swarm::Cost cost() {
    return [this](std::size_t block, std::size_t, const double* y, std::size_t stride, double* costs) {
      double* const xi = scratch[block].data();
      turn.times(y, stride, xi);
      for (Index i = 0; i < chart.centre.size(); ++i)
        for (std::size_t k = 0; k < kSwarmBlock; ++k) {
          double& x = xi[static_cast<std::size_t>(i) * kSwarmBlock + k];
          x = std::clamp(chart.centre[i] + x, problem->lower()[i], problem->upper()[i]);
        }
      problem->cost(xi, kSwarmBlock, xi + turn.room(), costs);
    };
  }

  void make_scratch() {
    const std::size_t blocks = (static_cast<std::size_t>(options.swarm.particles) + kSwarmBlock - 1) / kSwarmBlock;
    scratch.assign(blocks, std::vector<double>(turn.room() + problem->scratch_doubles()));
  }

  void start() {
    use(Chart(*problem, VectorXd::Zero(problem->dimensions())));
    make_scratch();
    const VectorXd reach = chart.reach(*problem);
    const double at_prior = problem->cost(chart.centre);
    swarm = std::make_unique<numerics::Swarm>(list(-reach), list(reach),
                                              std::vector<double>(static_cast<std::size_t>(reach.size()), 0.0),
                                              list(chart.spread(at_prior, options.spread, true)), cost(), options.swarm);
  }

  /// Rotates the swarm to the axes at its best position, before a reconfiguration. The spread is careful and wide in turn:
  /// where the model does not fit, the optimum may be far along axes of little curvature.
  void turn_to_best() {
    const Chart before = chart;
    use(Chart(*problem, best()));
    // y' = E'ᵀ (ξ − c') with ξ = c + E y
    const RowMajor A = chart.E.transpose() * before.E;
    const VectorXd b = before.E.transpose() * (chart.centre - before.centre);
    const VectorXd reach = chart.reach(*problem);
    const double best_cost = swarm->best_cost();
    const double least = 1e-3 * best_cost;
    const double excess = std::max(std::min(best_cost - problem->floor().cost, chart.promise), least);
    const bool careful = swarm->state().reconfigurations % 2 == 0;
    swarm->change_coordinates({A.data(), static_cast<std::size_t>(A.size())}, {b.data(), static_cast<std::size_t>(b.size())},
                              list(-reach), list(reach), list(chart.spread(excess, options.spread, careful)));
  }

  VectorXd best() const {
    VectorXd y(chart.centre.size());
    swarm->best({y.data(), static_cast<std::size_t>(y.size())});
    return (chart.centre + chart.E * y).cwiseMax(problem->lower()).cwiseMin(problem->upper());
  }

  std::uint64_t fingerprint() const {
    std::uint64_t hash = 0xcbf29ce484222325;  // FNV-1a over 64-bit words
    const auto take = [&](std::uint64_t word) { hash = (hash ^ word) * 0x100000001b3; };
    const auto hash_all = [&](const auto& values) {
      for (Index i = 0; i < values.size(); ++i) take(std::bit_cast<std::uint64_t>(values.data()[i]));
    };
    VectorXd r;
    MatrixXd J;
    problem->residuals(VectorXd::Zero(problem->dimensions()), r, &J);
    hash_all(r);
    hash_all(J);
    hash_all(problem->lower());
    hash_all(problem->upper());
    const numerics::SwarmOptions& s = options.swarm;
    for (const double x :
         {static_cast<double>(s.particles), s.threshold, s.inertia, s.cognitive, s.social, static_cast<double>(s.neighbours),
          static_cast<double>(s.stagnation_rounds), s.stagnation_rate, s.spread, options.spread})
      take(std::bit_cast<std::uint64_t>(x));
    take(s.seed);
    return hash;
  }
};

SwarmSearch::SwarmSearch(const Problem& problem, const SwarmSearchOptions& options)
    : impl_(std::make_unique<Impl>(problem, options)) {
  impl_->start();
}

SwarmSearch::SwarmSearch(const Problem& problem, const SwarmSearchOptions& options, std::string_view saved)
    : impl_(std::make_unique<Impl>(problem, options)) {
  ByteReader in(as_bytes(saved), "saved search");
  if (in.value<std::uint64_t>() != kMark) in.fail("does not begin with its mark, expected what SwarmSearch::save gave");
  if (in.value<std::uint64_t>() != impl_->fingerprint())
    in.fail("was made with other data, prior or options, expected the same ones");
  const std::vector<double> centre = in.list<double>(), E = in.list<double>(), curvature = in.list<double>();
  const auto d = static_cast<std::size_t>(problem.dimensions());
  if (centre.size() != d || E.size() != d * d || curvature.size() != d)
    in.fail("has axes of " + std::to_string(centre.size()) + " coordinates, expected " + std::to_string(d));
  Chart chart;
  const auto size = static_cast<Index>(d);
  chart.centre = Eigen::Map<const VectorXd>(centre.data(), size);
  chart.E = Eigen::Map<const RowMajor>(E.data(), size, size);
  chart.curvature = Eigen::Map<const VectorXd>(curvature.data(), size);
  impl_->use(std::move(chart));
  impl_->make_scratch();
  const std::string_view swarm = saved.substr(saved.size() - in.rest().size());
  impl_->swarm =
      std::make_unique<numerics::Swarm>(numerics::SwarmState::from_bytes(swarm), impl_->cost(), impl_->options.swarm);
}

SwarmSearch::~SwarmSearch() = default;
SwarmSearch::SwarmSearch(SwarmSearch&&) noexcept = default;
SwarmSearch& SwarmSearch::operator=(SwarmSearch&&) noexcept = default;

SwarmSearchProgress SwarmSearch::round(numerics::Threads* threads) {
  numerics::Swarm& swarm = *impl_->swarm;
  if (swarm.status() == numerics::SwarmStatus::kRunning) {
    if (swarm.stagnated()) impl_->turn_to_best();
    swarm.round(threads);
  }
  return progress();
}

SwarmSearchProgress SwarmSearch::run(numerics::Threads* threads) {
  while (round(threads).status == numerics::SwarmStatus::kRunning) {
  }
  return progress();
}

SwarmSearchProgress SwarmSearch::progress() const {
  const numerics::SwarmState& state = impl_->swarm->state();
  SwarmSearchProgress progress;
  progress.round = state.round;
  progress.reconfigurations = state.reconfigurations;
  progress.status = impl_->swarm->status();
  if (state.round == 0) return progress;
  progress.cost = impl_->swarm->best_cost();
  progress.weighted_rms = std::sqrt(std::max(progress.cost - impl_->problem->prior_cost(best()), 0.0));
  return progress;
}

VectorXd SwarmSearch::best() const { return impl_->best(); }
Estimate SwarmSearch::estimate() const { return impl_->problem->estimate(best()); }
const std::vector<double>& SwarmSearch::history() const { return impl_->swarm->state().history; }

std::string SwarmSearch::save() const {
  const Chart& chart = impl_->chart;
  ByteWriter out;
  out.value(kMark);
  out.value(impl_->fingerprint());
  out.list(list(chart.centre));
  out.list(std::vector<double>(chart.E.data(), chart.E.data() + chart.E.size()));
  out.list(list(chart.curvature));
  return out.bytes() + impl_->swarm->state().bytes();
}

}  // namespace cotwin::identification
