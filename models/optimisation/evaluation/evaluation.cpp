#include "models/optimisation/evaluation/evaluation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "models/robot/drives/rigid_friction.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::optimisation {

namespace {

constexpr std::size_t kGroup = 8;  // nodes of a panel of the quadrature
constexpr std::size_t kPart = 64;  // samples of a motion whose dynamics are computed together
constexpr double kSlack = 1e-9;    // relative rounding of bounds that an end attains

}  // namespace

double scale_of(double low, double high) {
  const double range = high - low;
  return std::isfinite(range) && range > 0 ? range : 1.0;
}

Evaluator::Scratch::Scratch(const Evaluator& e) : loaded(e.dynamics_) {
  const std::size_t n = e.n_;
  for (auto& part : x) part.assign(n * e.basis_.columns() * kLanes, 0.0);
  std::size_t room = std::max(e.exact_tables_[0].room(), e.exact_tables_[1].room());
  for (const auto& hull : e.hull_) room = std::max(room, hull.room());
  rows.resize(room);
  undecided.reserve(4 * n * kLanes);
  own.resize(n * e.basis_.columns());
  for (auto* part : {&q, &dq, &ddq, &tau}) part->assign(n * kPart, 0.0);
  largest.resize(n);
  squares.resize(n);
  power.resize(kPart);
  sums.resize(e.problem_.costs.size());
  if (e.electrical_) drawn.resize(e.samples());
  const Problem& p = e.problem();
  if (e.contact_) contact.emplace(robot::loaded(p.robot, p.loads, 0), *p.contact);
  if (e.compliant_) {
    compliant.emplace(p.robot, *p.compliant);
    compliance.resize(p.compliant->axes.size());
    responses.resize(compliance.size());
  }
  const std::size_t places = std::max(e.contact_tables_[0].size(), e.compliant_tables_[0].size()) / e.basis_.columns();
  for (auto& part : at_places) part.resize(n * places);
}

Evaluator::Evaluator(const Problem& problem)
    : problem_((check(problem), problem)),
      n_(problem.robot.joints.size()),
      basis_(problem.degree, problem.ends.at_rest()),
      dynamics_(problem.robot, problem.loads),
      nodes_(gauss_panels((problem.samples + kGroup - 1) / kGroup, problem.loads.breaks())),
      exact_(gauss_legendre(static_cast<std::size_t>(problem.degree))) {
  for (int r = 0; r < 4; ++r) hull_[static_cast<std::size_t>(r)] = basis_.hull(kParts, r);
  const auto set_tables = [&](std::array<std::vector<double>, 3>& tables, const std::vector<double>& places) {
    for (auto& table : tables) table.reserve(basis_.columns() * places.size());
    for (std::size_t c = 0; c < basis_.columns(); ++c)
      for (const double place : places) {
        const auto values = trajectory::bernstein::evaluate(basis_.points(c), place);
        for (std::size_t r = 0; r < 3; ++r) tables[r].push_back(values[r]);
      }
  };
  set_tables(tables_, nodes_.s);
  std::vector<double> begins = dynamics_.begins();
  begins.push_back(1);
  const auto sample_at = [&](double s) {
    return static_cast<std::size_t>(std::ranges::lower_bound(nodes_.s, s) - nodes_.s.begin());
  };
  for (std::size_t k = 0; k + 1 < begins.size(); ++k)
    for (std::size_t next = sample_at(begins[k]); next < sample_at(begins[k + 1]); next += kPart) parts_.push_back(next);
  parts_.push_back(nodes_.s.size());
  for (int r = 2; r < 4; ++r) exact_tables_[static_cast<std::size_t>(r - 2)] = basis_.table(exact_.s, r);
  torques_ =
      std::any_of(problem.costs.begin(), problem.costs.end(), [](const CostTerm& t) { return needs_torques(t.quantity); });
  for (double limit : problem.bounds.tau) torques_ = torques_ || std::isfinite(limit);
  const std::size_t blocks = (problem.samples + kGroup - 1) / kGroup;
  const auto has = [&](auto... quantities) {
    return std::ranges::any_of(problem.costs, [&](const CostTerm& t) { return ((t.quantity == quantities) || ...); });
  };
  if ((contact_ = has(Quantity::kMass, Quantity::kSafety))) {
    std::vector<double> places((blocks + 7) / 8 * 8);
    for (std::size_t i = 0; i < places.size(); ++i)
      places[i] = (static_cast<double>(i) + 0.5) / static_cast<double>(places.size());
    set_tables(contact_tables_, places);
  }
  if ((compliant_ = problem.compliant.has_value())) {
    std::vector<double> places((blocks + 1) / 2 * 8);
    for (std::size_t i = 0; i < places.size(); ++i) places[i] = static_cast<double>(i) / static_cast<double>(places.size() - 1);
    set_tables(compliant_tables_, places);
  }
  const auto is_energy = [](const CostTerm& t) { return t.quantity == Quantity::kEnergy; };
  if (std::any_of(problem.costs.begin(), problem.costs.end(), is_energy)) electrical_.emplace(*problem.electrical, n_);
}

Evaluator::~Evaluator() = default;

Motions Evaluator::motions() const {
  Motions m;
  m.c.assign(n_ * basis_.redundant() * kLanes, 0.0);
  for (std::size_t j = 0; j < n_; ++j) {
    m.q_from.insert(m.q_from.end(), kLanes, problem_.ends.q_from[j]);
    m.q_to.insert(m.q_to.end(), kLanes, problem_.ends.q_to[j]);
  }
  m.T.fill(problem_.T_max);
  if (problem_.compliant) {
    for (const CompliantFrame::Axis& axis : problem_.compliant->axes)
      for (const auto part : {&ComplianceValues::M, &ComplianceValues::D, &ComplianceValues::S})
        m.compliance.insert(m.compliance.end(), kLanes, std::sqrt(axis.least.*part * axis.most.*part));
  }
  return m;
}

Values Evaluator::values() const {
  Values v;
  v.costs.assign(problem_.costs.size() * kLanes, 0.0);
  return v;
}

std::unique_ptr<Evaluator::Scratch> Evaluator::scratch() const { return std::make_unique<Scratch>(*this); }

void Evaluator::set_coordinates(const Motions& m, Scratch& s) const {
  const std::size_t columns = basis_.columns(), first = basis_.boundary_columns(), K = basis_.redundant();
  const Ends& ends = problem_.ends;
  for (std::size_t k = 0; k < kLanes; ++k) {
    const double T = m.T[k];
    for (std::size_t j = 0; j < n_; ++j) {
      double* x = s.x[0].data() + j * columns * kLanes + k;
      x[0] = m.q_from[j * kLanes + k];
      x[kLanes] = m.q_to[j * kLanes + k];
      if (!basis_.at_rest()) {
        x[2 * kLanes] = T * ends.dq_from[j];
        x[3 * kLanes] = T * T * ends.ddq_from[j];
        x[4 * kLanes] = T * ends.dq_to[j];
        x[5 * kLanes] = T * T * ends.ddq_to[j];
      }
      for (std::size_t i = 0; i < K; ++i) x[(first + i) * kLanes] = m.c[(j * K + i) * kLanes + k];
    }
  }
  std::array<double, kLanes> rate;
  for (std::size_t k = 0; k < kLanes; ++k) rate[k] = 1 / m.T[k];
  for (std::size_t r = 1; r < 4; ++r)
    for (std::size_t i = 0; i < n_ * columns; ++i)
      for (std::size_t k = 0; k < kLanes; ++k) s.x[r][i * kLanes + k] = s.x[r - 1][i * kLanes + k] * rate[k];
}

double Evaluator::violation(const Scratch& s, std::size_t j, int derivative, std::size_t lane, double low, double high) const {
  const std::size_t r = static_cast<std::size_t>(derivative), columns = basis_.columns();
  std::array<double, trajectory::bernstein::kMaxDegree + 1> b{};
  const std::size_t size = static_cast<std::size_t>(basis_.degree()) + 1;
  for (std::size_t c = 0; c < columns; ++c) {
    const double x = s.x[r][(j * columns + c) * kLanes + lane];
    const auto points = basis_.points(c);
    for (std::size_t i = 0; i < size; ++i) b[i] += x * points[i];
  }
  const std::span<double> own(b.data(), size);
  const auto above = trajectory::bernstein::value_above(own, derivative, high);
  for (double& x : own) x = -x;
  const auto below = trajectory::bernstein::value_above(own, derivative, -low);
  return std::max(above ? *above - high : 0.0, below ? *below + low : 0.0);
}

void Evaluator::check_kinematics(Scratch& s, Values& values) const {
  const auto exceeds = [&](int r, std::size_t j, std::size_t k, double by) {
    values.kinematic[k] += by;
    if (!(by <= values.worst[k].by)) values.worst[k] = {r, j, by};
  };
  const Bounds& limits = problem_.bounds;
  const std::size_t columns = basis_.columns();
  const auto limits_of = [&](int r, std::size_t j) {
    const double high = (r == 0 ? limits.q_max : r == 1 ? limits.dq : r == 2 ? limits.ddq : limits.dddq)[j];
    return std::pair{r == 0 ? limits.q_min[j] : -high, high};
  };
  s.undecided.clear();
  for (int r = 3; r >= 0; --r) {
    const std::size_t order = static_cast<std::size_t>(r), own = static_cast<std::size_t>(basis_.degree() - r);
    for (std::size_t j = 0; j < n_; ++j) {
      const auto [low, high] = limits_of(r, j);
      if (!std::isfinite(high) && !std::isfinite(low)) continue;
      hull_[order].times(s.x[order].data() + j * columns * kLanes, kLanes, s.rows.data());
      const numerics::LaneRange range = numerics::range_of(kParts * own + 1, own, s.rows.data());
      const double scale = r == 0 ? scale_of(low, high) : high;
      for (std::size_t k = 0; k < kLanes; ++k) {
        if (std::max(range.most[k] - high, low - range.least[k]) <= kSlack * scale) continue;
        const double attained = std::max(range.most_of_few[k] - high, low - range.least_of_few[k]) / scale;
        if (attained <= kSlack)
          s.undecided.push_back({r, j, k});
        else
          exceeds(r, j, k, attained);
      }
    }
  }
  // The exact search is slow. A motion that is pruned anyway does not need it.
  std::array<bool, kLanes> pruned;
  for (std::size_t k = 0; k < kLanes; ++k) pruned[k] = values.kinematic[k] > 0;
  for (const auto& [r, j, k] : s.undecided) {
    if (pruned[k]) continue;
    const auto [low, high] = limits_of(r, j);
    const double scale = r == 0 ? scale_of(low, high) : high, slack = kSlack * scale;
    const double beyond = violation(s, j, r, k, low - slack, high + slack) / scale;
    if (!(beyond <= 0)) exceeds(r, j, k, beyond);
  }
}

void Evaluator::exact_costs(const Motions& m, Scratch& s, Values& values) const {
  const std::size_t columns = basis_.columns();
  for (std::size_t term = 0; term < problem_.costs.size(); ++term) {
    const Quantity quantity = problem_.costs[term].quantity;
    double* cost = values.costs.data() + term * kLanes;
    if (quantity == Quantity::kTime) std::copy(m.T.begin(), m.T.end(), cost);
    if (quantity != Quantity::kAcceleration && quantity != Quantity::kJerk) continue;
    const std::size_t r = quantity == Quantity::kAcceleration ? 2 : 3;
    std::fill_n(cost, kLanes, 0.0);
    for (std::size_t j = 0; j < n_; ++j) {
      exact_tables_[r - 2].times(s.x[r].data() + j * columns * kLanes, kLanes, s.rows.data());
      for (std::size_t i = 0; i < exact_.s.size(); ++i)
        for (std::size_t k = 0; k < kLanes; ++k) cost[k] += exact_.w[i] * s.rows[i * kLanes + k] * s.rows[i * kLanes + k];
    }
    for (std::size_t k = 0; k < kLanes; ++k) cost[k] *= m.T[k];
  }
}

void Evaluator::add_drives(Scratch& s, std::size_t count) const {
  const DriveTerms& d = problem_.drives;
  for (std::size_t j = 0; j < n_; ++j) {
    const auto term = [j](const std::vector<double>& values) { return values.empty() ? 0.0 : values[j]; };
    const double B = term(d.B), sigma2 = term(d.sigma2), tau_C = term(d.tau_C), tau_0 = term(d.tau_0);
    if (B == 0 && sigma2 == 0 && tau_C == 0 && tau_0 == 0) continue;
    double* __restrict tau = s.tau.data() + j * count;
    const double* __restrict dq = s.dq.data() + j * count;
    const double* __restrict ddq = s.ddq.data() + j * count;
    for (std::size_t i = 0; i < count; ++i)
      tau[i] = tau[i] + B * ddq[i] + sigma2 * dq[i] + tau_C * robot::coulomb_share(dq[i]) + tau_0;
  }
}

void Evaluator::dynamics(const Motions& m, std::size_t lane, Scratch& s, Values& values, const Visit& visit) const {
  const std::size_t columns = basis_.columns(), S = nodes_.s.size();
  std::fill(s.largest.begin(), s.largest.end(), 0.0);
  std::fill(s.squares.begin(), s.squares.end(), 0.0);
  std::fill(s.sums.begin(), s.sums.end(), 0.0);
  for (std::size_t part = 0; part + 1 < parts_.size(); ++part) {
    const std::size_t first = parts_[part], count = parts_[part + 1] - first;
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t i = 0; i < n_ * columns; ++i) s.own[i] = s.x[r][i * kLanes + lane];
      numerics::combine(n_, columns, count, s.own.data(), tables_[r].data() + first, S,
                        (r == 0   ? s.q
                         : r == 1 ? s.dq
                                  : s.ddq)
                            .data());
    }
    dynamics_.inverse_dynamics(s.loaded, count, nodes_.s.data() + first, s.q.data(), s.dq.data(), s.ddq.data(), s.tau.data());
    add_drives(s, count);
    if (visit) visit(lane, first, count, s.tau.data(), s.dq.data());
    const double* w = nodes_.w.data() + first;
    numerics::add_moments(n_, count, w, s.tau.data(), s.squares.data(), s.largest.data());
    for (std::size_t term = 0; term < problem_.costs.size(); ++term) {
      const CostTerm& cost = problem_.costs[term];
      switch (cost.quantity) {
        case Quantity::kWork:
        case Quantity::kSharedWork: {
          const bool shared = cost.quantity == Quantity::kSharedWork;
          std::fill_n(s.power.begin(), count, 0.0);
          for (std::size_t j = 0; j < n_; ++j)
            for (std::size_t i = 0; i < count; ++i) {
              const double own = s.tau[j * count + i] * s.dq[j * count + i];
              s.power[i] += shared ? own : std::max(own, 0.0);
            }
          for (std::size_t i = 0; i < count; ++i) s.sums[term] += w[i] * std::max(s.power[i], 0.0);
          break;
        }
        case Quantity::kPower:
          cost.power(count, s.tau.data(), s.dq.data(), s.power.data());
          for (std::size_t i = 0; i < count; ++i) s.sums[term] += w[i] * s.power[i];
          break;
        case Quantity::kEnergy:
          electrical_->power(count, s.tau.data(), s.dq.data(), s.drawn.data() + first);
          break;
        default:  // computed elsewhere
          break;
      }
    }
  }
  for (std::size_t term = 0; term < problem_.costs.size(); ++term) {
    const Quantity quantity = problem_.costs[term].quantity;
    if (!needs_torques(quantity)) continue;
    double& cost = values.costs[term * kLanes + lane];
    if (quantity == Quantity::kEnergy)
      cost = electrical_->drawn(s.drawn, nodes_.w, m.T[lane]);
    else if (quantity == Quantity::kTorque)
      cost = std::accumulate(s.squares.begin(), s.squares.end(), 0.0) * m.T[lane];
    else
      cost = s.sums[term] * m.T[lane];
  }
  const double share = 1 - problem_.torque_margin;
  for (std::size_t j = 0; j < n_; ++j) {
    const double beyond = s.largest[j] / (share * problem_.bounds.tau[j]) - 1;
    if (beyond <= 0) continue;
    values.torque[lane] += beyond;
    if (!(beyond <= values.worst[lane].by)) values.worst[lane] = {4, j, beyond};
  }
}

void Evaluator::states_at(const std::array<std::vector<double>, 3>& tables, std::size_t lane, Scratch& s) const {
  const std::size_t columns = basis_.columns(), count = tables[0].size() / columns;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t i = 0; i < n_ * columns; ++i) s.own[i] = s.x[r][i * kLanes + lane];
    numerics::combine(n_, columns, count, s.own.data(), tables[r].data(), count, s.at_places[r].data());
  }
}

void Evaluator::frames(const Motions& m, std::size_t lane, Scratch& s, Values& values) const {
  ContactMotion::Largest largest;
  double settle = 0, stiffness = 0;
  const auto& [q, dq, ddq] = s.at_places;
  if (contact_) {
    states_at(contact_tables_, lane, s);
    largest = s.contact->largest(contact_tables_[0].size() / basis_.columns(), q.data(), dq.data(), ddq.data(),
                                 problem_.smooth_maxima);
  }
  if (compliant_) {
    states_at(compliant_tables_, lane, s);
    s.compliant->set(compliant_tables_[0].size() / basis_.columns(), m.T[lane], q.data(), dq.data(), ddq.data());
    for (std::size_t k = 0; k < s.compliance.size(); ++k) {
      const double* own = m.compliance.data() + 3 * k * kLanes + lane;
      s.compliance[k] = {own[0], own[kLanes], own[2 * kLanes]};
      s.responses[k] = s.compliant->respond(k, s.compliance[k]);
      settle = std::max(settle, s.responses[k].settle);
      stiffness += s.compliance[k].S;
    }
    values.torque[lane] += s.compliant->violation(s.compliance, s.responses);
  }
  for (std::size_t term = 0; term < problem_.costs.size(); ++term) {
    double& cost = values.costs[term * kLanes + lane];
    const Quantity quantity = problem_.costs[term].quantity;
    if (quantity == Quantity::kMass) cost = largest.mass;
    if (quantity == Quantity::kSafety) cost = largest.share;
    if (quantity == Quantity::kCycle) cost = m.T[lane] + settle + problem_.compliant->T_process;
    if (quantity == Quantity::kStiffness) cost = stiffness;
  }
}

void Evaluator::evaluate(const Motions& motions, Scratch& s, Values& values, bool all, const Visit& visit) const {
  set_coordinates(motions, s);
  values.kinematic.fill(0);
  values.worst.fill({});
  if (!all) check_kinematics(s, values);
  values.torque.fill(0);
  exact_costs(motions, s, values);
  for (std::size_t k = 0; k < kLanes; ++k) {
    values.pruned[k] = values.kinematic[k] > 0;
    if (values.pruned[k] || k >= motions.count) continue;
    if (torques_) dynamics(motions, k, s, values, visit);
    if (contact_ || compliant_) frames(motions, k, s, values);
  }
}

Evaluator::Compliance Evaluator::compliance(const Scratch& s) const { return {s.compliance, s.responses}; }

const double* Evaluator::coordinates(const Scratch& s, int derivative, std::size_t joint) const {
  return s.x[static_cast<std::size_t>(derivative)].data() + joint * basis_.columns() * kLanes;
}

std::vector<double> Evaluator::control_points(const Motions& m, std::size_t lane, std::size_t joint) const {
  const Ends& e = problem_.ends;
  const std::size_t K = basis_.redundant();
  std::vector<double> c(K);
  for (std::size_t i = 0; i < K; ++i) c[i] = m.c[(joint * K + i) * kLanes + lane];
  const trajectory::Boundary from{m.q_from[joint * kLanes + lane], e.dq_from[joint], e.ddq_from[joint], {}};
  const trajectory::Boundary to{m.q_to[joint * kLanes + lane], e.dq_to[joint], e.ddq_to[joint], {}};
  return trajectory::make_polynomial(from, to, m.T[lane], basis_.terms(), c);
}

}  // namespace cotwin::optimisation
