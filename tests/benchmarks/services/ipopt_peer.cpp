#include <IpStdCInterface.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/benchmarks/services/moves.h"

namespace cotwin::benchmark {

using namespace optimisation;

namespace {

constexpr std::size_t kPlaces = 65;

/// A bound of a joint: position (0), speed (1) or torque (2).
struct Block {
  int kind;
  std::size_t joint;
  friend bool operator==(const Block&, const Block&) = default;
};

/// The nonlinear program: x = (c, T if it is free); values: those of the blocks, positions and speeds at places, torques at the
/// samples, each by its bound.
class Program {
 public:
  Program(const Problem& problem, std::vector<Block> blocks)
      : problem_(problem),
        blocks_(std::move(blocks)),
        evaluator_(problem_),
        scratch_(evaluator_.scratch()),
        motions_(evaluator_.motions()),
        values_(evaluator_.values()),
        d_(evaluator_.joints() * evaluator_.basis().redundant()),
        free_T_(problem.T_min < problem.T_max) {
    for (std::size_t i = 0; i < kPlaces; ++i) places_.push_back(static_cast<double>(i) / (kPlaces - 1));
    for (int r = 0; r < 2; ++r) tables_[r] = evaluator_.basis().table(places_, r);
    rows_.resize(tables_[0].room());
    for (const Block& block : blocks_) {
      begins_.push_back(low_.size());
      const std::size_t size = block.kind == 2 ? evaluator_.samples() : kPlaces;
      low_.insert(low_.end(), size, block.kind == 0 ? problem_.bounds.q_min[block.joint] : -1);
      high_.insert(high_.end(), size, block.kind == 0 ? problem_.bounds.q_max[block.joint] : 1);
    }
  }

  std::size_t variables() const { return d_ + (free_T_ ? 1 : 0); }
  std::size_t values() const { return low_.size(); }
  std::vector<double>& low() { return low_; }
  std::vector<double>& high() { return high_; }
  bool free_T() const { return free_T_; }
  std::size_t coefficients() const { return d_; }

  struct Point {
    double cost = 0;
    std::vector<double> values;
  };
  /// Up to eight points.
  void evaluate(const std::vector<std::vector<double>>& x, std::vector<Point>& points) {
    points.resize(x.size());
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::vector<double>& own = x[std::min(k, x.size() - 1)];
      for (std::size_t i = 0; i < d_; ++i) motions_.c[i * kLanes + k] = own[i];
      motions_.T[k] = free_T_ ? own[d_] : problem_.T_max;
    }
    for (Point& p : points) p.values.resize(values());
    motions_.count = x.size();
    evaluator_.evaluate(motions_, *scratch_, values_, true,
                        [&](std::size_t lane, std::size_t first, std::size_t count, const double* tau, const double*) {
                          for (std::size_t b = 0; b < blocks_.size(); ++b)
                            for (std::size_t s = 0; blocks_[b].kind == 2 && s < count; ++s)
                              points[lane].values[begins_[b] + first + s] =
                                  tau[blocks_[b].joint * count + s] / problem_.bounds.tau[blocks_[b].joint];
                        });
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      const auto [kind, joint] = blocks_[b];
      if (kind == 2) continue;
      tables_[kind].times(evaluator_.coordinates(*scratch_, kind, joint), kLanes, rows_.data());
      const double scale = kind == 0 ? 1 : problem_.bounds.dq[joint];
      for (std::size_t i = 0; i < kPlaces; ++i)
        for (std::size_t k = 0; k < x.size(); ++k) points[k].values[begins_[b] + i] = rows_[i * kLanes + k] / scale;
    }
    for (std::size_t k = 0; k < x.size(); ++k) points[k].cost = values_.costs[k];
  }

  const Point& at(const double* x) {
    std::vector<double> own(x, x + variables());
    if (own != x_) {
      std::vector<Point> points;
      evaluate({own}, points);
      x_ = own;
      point_ = points[0];
    }
    return point_;
  }

  /// Central differences.
  void derivatives(const double* x, std::vector<double>& gradient, std::vector<double>& jacobian) {
    const std::size_t n = variables();
    std::vector<double> own(x, x + n);
    if (own != derived_) {
      gradient_.resize(n);
      jacobian_.resize(n * values());
      std::vector<Point> points;
      constexpr double h = 1e-5;
      for (std::size_t first = 0; first < n; first += 4) {
        const std::size_t count = std::min<std::size_t>(4, n - first);
        std::vector<std::vector<double>> at;
        for (std::size_t i = 0; i < count; ++i)
          for (const double side : {h, -h}) {
            at.push_back(own);
            at.back()[first + i] += side;
          }
        evaluate(at, points);
        for (std::size_t i = 0; i < count; ++i) {
          const Point &a = points[2 * i], &b = points[2 * i + 1];
          gradient_[first + i] = (a.cost - b.cost) / (2 * h);
          for (std::size_t k = 0; k < values(); ++k) jacobian_[k * n + first + i] = (a.values[k] - b.values[k]) / (2 * h);
        }
      }
      derived_ = own;
    }
    gradient = gradient_;
    jacobian = jacobian_;
  }

 private:
  Problem problem_;
  std::vector<Block> blocks_;
  std::vector<std::size_t> begins_;  // of the blocks' values
  Evaluator evaluator_;
  std::unique_ptr<Evaluator::Scratch> scratch_;
  Motions motions_;
  Values values_;
  std::size_t d_;
  bool free_T_;
  std::vector<double> places_, low_, high_, rows_;
  numerics::BatchMatrix tables_[2];
  std::vector<double> x_, derived_, gradient_, jacobian_;
  Point point_;
};

Program& program(UserDataPtr data) { return *static_cast<Program*>(data); }

Bool eval_f(Index, Number* x, Bool, Number* f, UserDataPtr data) {
  *f = program(data).at(x).cost;
  return std::isfinite(*f);
}
Bool eval_g(Index, Number* x, Bool, Index, Number* g, UserDataPtr data) {
  const auto& values = program(data).at(x).values;
  std::copy(values.begin(), values.end(), g);
  return TRUE;
}
Bool eval_grad_f(Index, Number* x, Bool, Number* gradient, UserDataPtr data) {
  std::vector<double> g, J;
  program(data).derivatives(x, g, J);
  std::copy(g.begin(), g.end(), gradient);
  return TRUE;
}
Bool eval_jac_g(Index n, Number* x, Bool, Index m, Index, Index* row, Index* column, Number* values, UserDataPtr data) {
  if (values == nullptr) {
    for (Index i = 0; i < m; ++i)
      for (Index k = 0; k < n; ++k) {
        row[i * n + k] = i;
        column[i * n + k] = k;
      }
    return TRUE;
  }
  std::vector<double> g, J;
  program(data).derivatives(x, g, J);
  std::copy(J.begin(), J.end(), values);
  return TRUE;
}
Bool eval_h(Index, Number*, Bool, Number, Index, Number*, Bool, Index, Index*, Index*, Number*, UserDataPtr) { return FALSE; }

}  // namespace

PeerSolution minimise_by_ipopt(const Problem& problem, double T_start) {
  const bool free_T = problem.T_min < problem.T_max;
  const std::size_t d = problem.robot.joints.size() * static_cast<std::size_t>(problem.degree - 5);
  std::vector<double> x(d + (free_T ? 1 : 0), 0.0), lower(x.size(), -10.0), upper(x.size(), 10.0);
  if (free_T) {
    x.back() = T_start;
    lower.back() = problem.T_min;
    upper.back() = problem.T_max;
  }
  PeerSolution solution;
  std::vector<Block> blocks;
  // The bounds that the last solution comes close to are added until it keeps all of them.
  for (int round = 0; round < 8; ++round) {
    const double T = free_T ? x.back() : problem.T_max;
    const Solution found = assess(problem, {x.data(), d}, problem.ends.q_to, T);
    solution.share = 0;
    bool more = false;
    for (const Peak& peak : found.peaks) {
      const int kind = peak.bound == "q" ? 0 : peak.bound == "dq" ? 1 : 2;
      if (!std::isfinite(peak.limit)) continue;
      solution.share = std::max(solution.share, peak.share);
      const Block block{kind, peak.joint};
      if (peak.share < (round == 0 ? 0.8 : 1.003) || std::find(blocks.begin(), blocks.end(), block) != blocks.end()) continue;
      blocks.push_back(block);
      more = true;
    }
    if (round > 0 && !more) break;
    Program program(problem, blocks);
    const Index n = static_cast<Index>(program.variables()), m = static_cast<Index>(program.values());
    const IpoptProblem nlp = CreateIpoptProblem(n, lower.data(), upper.data(), m, program.low().data(), program.high().data(),
                                                n * m, 0, 0, eval_f, eval_g, eval_grad_f, eval_jac_g, eval_h);
    char hessian[] = "hessian_approximation", limited[] = "limited-memory", level[] = "print_level", tol[] = "tol",
         most[] = "max_iter", sb[] = "sb", yes[] = "yes";
    AddIpoptStrOption(nlp, hessian, limited);
    AddIpoptStrOption(nlp, sb, yes);
    AddIpoptIntOption(nlp, level, 0);
    AddIpoptIntOption(nlp, most, 300);
    AddIpoptNumOption(nlp, tol, 1e-4);
    const ApplicationReturnStatus status =
        IpoptSolve(nlp, x.data(), nullptr, &solution.cost, nullptr, nullptr, nullptr, &program);
    FreeIpoptProblem(nlp);
    solution.solved = status == Solve_Succeeded || status == Solved_To_Acceptable_Level;
  }
  solution.T = free_T ? x.back() : problem.T_max;
  solution.c.assign(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(d));
  return solution;
}

}  // namespace cotwin::benchmark
