#include "models/optimisation/judgement/device_judge.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "models/foundation/support/text.h"
#include "models/optimisation/judgement/judgement.h"
#include "models/robot/mechanism.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::optimisation {

extern const char* const kJudgementPtx[robot::kKernelShapes];  // made by the build; "" without a compiler for it

namespace {

[[noreturn]] void refuse(const std::string& why) { throw numerics::DeviceError(why); }

constexpr const char* kEntries[robot::kKernelShapes] = {"judge_tree", "judge_chain", "judge_chain_6", "judge_chain_7"};
constexpr std::pair<Quantity, JudgedCost> kJudged[] = {
    {Quantity::kTime, kJudgedTime},
    {Quantity::kTorque, kJudgedTorque},
    {Quantity::kWork, kJudgedWork},
    {Quantity::kSharedWork, kJudgedSharedWork},
    {Quantity::kAcceleration, kJudgedAcceleration},
    {Quantity::kJerk, kJudgedJerk},
    {Quantity::kEnergy, kJudgedEnergy},
};

/// Fills the block of a JudgedProblem.
class Block {
 public:
  Block() : values_((sizeof(JudgedProblem) + sizeof(double) - 1) / sizeof(double)) {}
  JudgedProblem head{};

  template <class T>
  std::size_t add(const T* from, std::size_t count) {
    static_assert(alignof(T) <= sizeof(double) && std::is_trivially_copyable_v<T>);
    const std::size_t at = values_.size(), bytes = count * sizeof(T);
    values_.resize(at + (bytes + sizeof(double) - 1) / sizeof(double));
    if (bytes > 0) std::memcpy(values_.data() + at, from, bytes);
    return at;
  }
  std::size_t add(const std::vector<double>& values) { return add(values.data(), values.size()); }
  /// The rows of a matrix.
  std::size_t add(const numerics::BatchMatrix& A) {
    std::vector<double> rows(A.rows() * A.columns()), y(A.room()), unit(A.columns() * kLanes);
    for (std::size_t c = 0; c < A.columns(); ++c) {
      std::fill(unit.begin(), unit.end(), 0.0);
      unit[c * kLanes] = 1;
      A.times(unit.data(), kLanes, y.data());
      for (std::size_t r = 0; r < A.rows(); ++r) rows[r * A.columns() + c] = y[r * kLanes];
    }
    return add(rows);
  }
  const std::vector<double>& finished() {
    std::memcpy(values_.data(), &head, sizeof head);
    return values_;
  }

 private:
  std::vector<double> values_;
};

std::vector<double> rows_of(const std::vector<std::vector<double>>& list) {
  std::vector<double> all;
  for (const auto& row : list) all.insert(all.end(), row.begin(), row.end());
  return all;
}

robot::Mechanism mechanism_of(const Problem& p) {
  if (p.compliant) refuse("judges no compliance");
  if (p.loads.wrench || !p.loads.breaks().empty()) refuse("judges no loads that come and go, and no wrench");
  robot::Mechanism mechanism(robot::loaded(p.robot, p.loads, 0));
  if (mechanism.impl().coupling) refuse("judges no robots with mimic joints");
  if (mechanism.n() > kMostJudgedJoints)
    refuse("judges robots of at most " + std::to_string(kMostJudgedJoints) + " joints, this one has " +
           std::to_string(mechanism.n()));
  return mechanism;
}

std::vector<double> block_of(const Evaluator& e, const Drawing& d, const robot::Mechanism& mechanism) {
  const Problem& p = e.problem();
  const MotionBasis& basis = e.basis();
  const robot::Mechanism::Impl& kernels = mechanism.impl();
  const std::size_t n = e.joints(), K = basis.redundant();
  Block block;
  JudgedProblem& h = block.head;
  h.model = kernels.model;
  h.links_at = block.add(kernels.links.data(), n);
  h.theta_0_at = block.add(kernels.theta_0.data(), n);
  h.n = static_cast<int>(n);
  h.columns = static_cast<int>(basis.columns());
  h.boundary = static_cast<int>(basis.boundary_columns());
  h.redundant = static_cast<int>(K);
  h.degree = basis.degree();
  h.parts = Evaluator::kParts;
  h.samples = static_cast<int>(e.samples());
  if (h.columns > kMostJudgedColumns) refuse("judges motions of at most degree 31");
  for (int r = 0; r < 4; ++r) {
    h.hull_at[r] = block.add(basis.hull(Evaluator::kParts, r));
    h.points_at[r] = block.add(basis.hull(1, r));
  }
  std::vector<double> tables;
  for (const double s : e.nodes())
    for (int r = 0; r < 3; ++r)
      for (std::size_t c = 0; c < basis.columns(); ++c)
        tables.push_back(trajectory::bernstein::evaluate(basis.points(c), s)[static_cast<std::size_t>(r)]);
  h.tables_at = block.add(tables);
  h.weights_at = block.add(e.weights().data(), e.samples());
  const Quadrature exact = gauss_legendre(static_cast<std::size_t>(basis.degree()));
  for (int r = 2; r < 4; ++r) h.exact_at[r - 2] = block.add(basis.table(exact.s, r));
  h.exact_weights_at = block.add(exact.w);

  const bool bounded = std::ranges::any_of(p.bounds.tau, [](double limit) { return std::isfinite(limit); });
  h.torques = bounded || std::ranges::any_of(p.costs, [](const CostTerm& t) { return needs_torques(t.quantity); });
  for (const CostTerm& term : p.costs) {
    const auto* known = std::ranges::find(kJudged, term.quantity, &std::pair<Quantity, JudgedCost>::first);
    if (known == std::end(kJudged)) refuse(std::string("judges no ") + to_text(term.quantity));
    h.costs[h.terms++] = known->second;
  }
  DrivePower::Constants power{};
  if (p.electrical) power = DrivePower(*p.electrical, n).constants();
  h.separate = power.bus == energetics::Bus::kSeparate;
  h.shared = power.bus == energetics::Bus::kShared;
  h.idle = power.idle;
  h.controller = power.controller;
  h.per_supplied = power.per_supplied;
  h.per_returned = power.per_returned;
  h.least = power.least;
  h.most = power.most;
  h.start = power.start;

  std::vector<JudgedJoint> joints(n);
  for (std::size_t j = 0; j < n; ++j) {
    JudgedJoint& own = joints[j];
    const Bounds& b = p.bounds;
    const double high[] = {b.q_max[j], b.dq[j], b.ddq[j], b.dddq[j]};
    for (std::size_t r = 0; r < 4; ++r) {
      own.high[r] = high[r];
      own.low[r] = r == 0 ? b.q_min[j] : -high[r];
      own.scale[r] = r == 0 ? scale_of(own.low[r], own.high[r]) : high[r];
    }
    own.tau = (1 - p.torque_margin) * b.tau[j];
    const auto drive = [j](const std::vector<double>& values) { return values.empty() ? 0.0 : values[j]; };
    own.B = drive(p.drives.B);
    own.sigma2 = drive(p.drives.sigma2);
    own.tau_C = drive(p.drives.tau_C);
    own.tau_0 = drive(p.drives.tau_0);
    if (p.electrical) {
      own.copper = power.joints[j].copper;
      own.converter = power.joints[j].converter;
      own.iron = power.joints[j].iron;
      own.eddy = power.joints[j].eddy;
    }
    own.dq_from = p.ends.dq_from[j];
    own.ddq_from = p.ends.ddq_from[j];
    own.dq_to = p.ends.dq_to[j];
    own.ddq_to = p.ends.ddq_to[j];
    own.c_max = d.c_max[j];
    const auto box = [j](const PostureSet& set, double* to) {
      if (!set.list.empty()) return;
      to[0] = set.low[j];
      to[1] = set.high[j];
    };
    box(d.from, own.from);
    box(d.to, own.to);
  }
  h.joints_at = block.add(joints.data(), n);
  h.starts = static_cast<unsigned>(d.from.list.size());
  h.goals = static_cast<unsigned>(d.to.list.size());
  h.from_at = block.add(rows_of(d.from.list));
  h.to_at = block.add(rows_of(d.to.list));
  h.seed = d.seed;
  h.T_min = p.T_min;
  h.T_max = p.T_max;
  h.ln_T_ratio = std::log(p.T_max / p.T_min);
  return block.finished();
}

robot::KernelShape shape_of(const robot::Mechanism& m) {
  if (!m.impl().tree.empty()) return robot::kTree;
  return m.n() == 6 ? robot::kChain6 : m.n() == 7 ? robot::kChain7 : robot::kChain;
}

const char* program_for(const robot::Mechanism& m) {
  const char* ptx = kJudgementPtx[shape_of(m)];
  if (*ptx == 0) refuse("this program was built without a compiler for it");
  return ptx;
}

}  // namespace

std::shared_ptr<numerics::Device> device_for(DeviceUse use) {
  constexpr int kFast = 4;
  std::shared_ptr<numerics::Device> device = numerics::Device::shared();
  if (use == DeviceUse::kAuto && device->single_to_double() > kFast)
    refuse(device->name() + " is " + std::to_string(device->single_to_double()) +
           " times slower in double precision than in single, and taken only for device gpu");
  return device;
}

struct DeviceJudge::Impl {
  Impl(const Evaluator& e, const Drawing& d, const robot::Mechanism& m, std::size_t most,
       const std::shared_ptr<numerics::Device>& on)
      : device(on),
        rows(kVerdictCosts + e.problem().costs.size()),
        values(block_of(e, d, m)),
        program(on, program_for(m), kEntries[shape_of(m)]),
        block(on, values.size() * sizeof(double)),
        out(on, rows * most * sizeof(double)) {
    block.write(values.data(), values.size() * sizeof(double));
  }

  std::shared_ptr<numerics::Device> device;
  std::size_t rows, begun = 0;
  std::vector<double> values;
  numerics::DeviceProgram program;
  numerics::DeviceMemory block, out;
  std::optional<numerics::DeviceMemory> given;
};

DeviceJudge::DeviceJudge(const Evaluator& evaluator, const Drawing& drawing, std::size_t most,
                         std::shared_ptr<numerics::Device> device)
    : impl_(std::make_unique<Impl>(evaluator, drawing, mechanism_of(evaluator.problem()), std::max(most, kCompared), device)) {
  constexpr double kMost = 1e-6;
  rounding_ = difference(evaluator, drawing);
  if (!(rounding_ <= kMost))
    refuse(this->device() + " differs by " + text::to_text(rounding_, 3) + " from this processor on " +
           std::to_string(kCompared) + " motions, expected at most " + text::to_text(kMost));
}

DeviceJudge::~DeviceJudge() = default;

const std::string& DeviceJudge::device() const { return impl_->device->name(); }

void DeviceJudge::start(std::uint32_t first, std::size_t count, unsigned block) { launch(0, first, count, block); }

void DeviceJudge::start(const std::vector<double>& given, std::size_t count) {
  const std::size_t bytes = given.size() * sizeof(double);
  if (!impl_->given) impl_->given.emplace(impl_->device, bytes);
  impl_->given->write(given.data(), bytes);
  launch(impl_->given->address(), 0, count, 128);
}

void DeviceJudge::launch(unsigned long long given, std::uint32_t first, std::size_t count, unsigned block) {
  unsigned long long problem = impl_->block.address(), out = impl_->out.address();
  auto threads = static_cast<unsigned>(count);
  void* arguments[] = {&problem, &first, &threads, &given, &out};
  impl_->begun = count;
  impl_->program.start(threads, arguments, block);
}

void DeviceJudge::finish(Verdicts& verdicts) {
  verdicts.clear();
  verdicts.values_.resize(impl_->rows * impl_->begun);
  impl_->out.read(verdicts.values_.data(), verdicts.values_.size() * sizeof(double));
  verdicts.count_ = impl_->begun;
}

double DeviceJudge::difference(const Evaluator& e, const Drawing& drawing, std::uint32_t begin, std::size_t count) {
  const std::size_t terms = e.problem().costs.size(), n = e.joints();
  Verdicts verdicts;
  start(begin, count);
  finish(verdicts);
  const auto scratch = e.scratch();
  Motions motions = room_for(e.problem());
  Values values = e.values();
  double largest = 0;
  constexpr double kNothing = 1e-6;  // J, s, …: such costs are rounding, as those of a motion that stays
  std::vector<double> usual(terms);  // costs near zero are compared with what they are of the motions before
  for (std::size_t first = 0; first < count; first += kLanes) {
    motions.count = std::min(kLanes, count - first);
    for (std::size_t lane = 0; lane < motions.count; ++lane)
      draw(e.problem(), drawing, begin + static_cast<std::uint32_t>(first + lane), motions, lane);
    e.evaluate(motions, *scratch, values);
    for (std::size_t lane = 0; lane < motions.count; ++lane) {
      const std::size_t k = first + lane;
      if (verdicts.open(k)) continue;
      const auto differs = [&](double own, double right, double size) {
        if (own == right || (std::isnan(own) && std::isnan(right))) return;
        const double by = std::abs(own - right) / std::max(std::abs(right), size);
        largest = std::isnan(by) ? std::numeric_limits<double>::infinity() : std::max(largest, by);
      };
      differs(verdicts.kinematic(k), values.kinematic[lane], 1);
      differs(verdicts.torque(k), values.torque[lane], 1);
      const bool pruned = values.pruned[lane];
      for (std::size_t term = 0; term < terms; ++term) {
        const double right = pruned ? std::numeric_limits<double>::quiet_NaN() : values.costs[term * kLanes + lane];
        differs(verdicts.cost(term, k), right, std::max(1e-3 * usual[term], kNothing));
        if (!pruned) usual[term] = std::max(usual[term], std::abs(right));
      }
      if (!(verdicts.worst(k) < 5 * n)) largest = std::numeric_limits<double>::infinity();
    }
  }
  return largest;
}

namespace {

/// Motions from the problem's start to its end or end postures.
Drawing drawing_of(const Problem& p) {
  constexpr double kRange = 0.1;
  Drawing d;
  d.from.list = {p.ends.q_from};
  d.to.list = p.end_postures;
  if (d.to.list.empty()) d.to.list = {p.ends.q_to};
  d.c_max.assign(p.robot.joints.size(), kRange);
  return d;
}

}  // namespace

JudgedBlocks::JudgedBlocks(const Evaluator& evaluator, std::size_t blocks, std::shared_ptr<numerics::Device> device)
    : evaluator_(evaluator),
      count_(blocks * kLanes),
      judge_(evaluator, drawing_of(evaluator.problem()), count_, std::move(device)),
      given_((1 + evaluator.joints() * (1 + evaluator.basis().redundant())) * count_) {}

void JudgedBlocks::put(std::size_t block, const Motions& m) {
  double* to = given_.data() + block * kLanes;
  const auto add = [&](const double* lanes) {
    std::copy_n(lanes, kLanes, to);
    to += count_;
  };
  add(m.T.data());
  for (const auto* values : {&m.q_to, &m.c})
    for (std::size_t i = 0; i < values->size(); i += kLanes) add(values->data() + i);
}

void JudgedBlocks::run() {
  judge_.start(given_, count_);
  judge_.finish(verdicts_);
}

void JudgedBlocks::take(std::size_t block, const Motions& motions, Evaluator::Scratch& scratch, Values& values) const {
  const std::size_t first = block * kLanes;
  for (std::size_t lane = 0; lane < kLanes; ++lane)
    if (verdicts_.open(first + lane)) {
      evaluator_.evaluate(motions, scratch, values);
      return;
    }
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    values.kinematic[lane] = verdicts_.kinematic(first + lane);
    values.torque[lane] = verdicts_.torque(first + lane);
    values.pruned[lane] = values.kinematic[lane] > 0;
    for (std::size_t term = 0; term < evaluator_.problem().costs.size(); ++term)
      values.costs[term * kLanes + lane] = verdicts_.cost(term, first + lane);
  }
}

}  // namespace cotwin::optimisation
