// The judgement of motions for GPUs. Its entries run on this processor, in a stand-in of the driver's library, and must give Evaluator's figures;
// with a GPU the tests RealDevice compare that one.
#include "models/optimisation/judgement/device_judge.h"

#include <dlfcn.h>
#include <gmock/gmock.h>

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <regex>
#include <set>
#include <thread>

#include "models/foundation/support/error.h"
#include "models/optimisation/growth/growth.h"
#include "models/robot/kernels/kernels.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/energetics/electrical_data.h"
#include "tests/support/places.h"

namespace cotwin::optimisation {

extern const char* const kJudgementPtx[robot::kKernelShapes];

namespace judgement_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// A trunk with two arms and a slide.
constexpr const char* kTree = R"(<robot name="tree"><link name="base"/>
  <joint name="trunk" type="revolute"><parent link="base"/><child link="t"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-3" upper="3" velocity="4" effort="900"/></joint>
  <joint name="left" type="revolute"><parent link="t"/><child link="l"/><origin xyz="0.2 0.1 0.5" rpy="0.3 -0.2 1"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="4" effort="300"/></joint>
  <joint name="slide" type="prismatic"><parent link="l"/><child link="s"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="2" effort="300"/></joint>
  <joint name="right" type="revolute"><parent link="t"/><child link="r"/><origin xyz="-0.2 0.1 0.5"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" velocity="4" effort="300"/></joint>
  <link name="t"><inertial><origin xyz="0.02 0.1 0.2"/><mass value="8"/><inertia ixx="0.3" iyy="0.25" izz="0.15" ixy="0.02" ixz="0.01" iyz="0"/></inertial></link>
  <link name="l"><inertial><origin xyz="0 0.05 0.2"/><mass value="3"/><inertia ixx="0.05" iyy="0.04" izz="0.01" ixy="0" ixz="0" iyz="0.003"/></inertial></link>
  <link name="s"><inertial><origin xyz="0.03 0 0.1"/><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="r"><inertial><origin xyz="0 0 -0.2"/><mass value="3"/><inertia ixx="0.05" iyy="0.045" izz="0.01" ixy="0" ixz="0.002" iyz="0"/></inertial></link>
  </robot>)";

struct Case {
  Problem problem;
  Drawing drawing;
};

/// Motions of which some are pruned, some exceed torques and some are feasible.
Case case_of(const std::string& robot, energetics::Bus bus = energetics::Bus::kShared) {
  Case c;
  Problem& p = c.problem;
  const std::string folder = places::source() + "/models/robots/" + robot;
  p.robot = robot == "tree" ? robot::parse_urdf(kTree, "tree") : robot::load_urdf(folder + "/robot.urdf");
  const std::size_t n = p.robot.joints.size();
  std::vector<double> from, to, zero(n);
  for (std::size_t j = 0; j < n; ++j) {
    const auto& joint = p.robot.joints[j];
    const double middle = std::isfinite(joint.q_max) ? 0.5 * (joint.q_min + joint.q_max) : 0;
    from.push_back(middle + 0.4 * std::sin(1.0 + 2 * static_cast<double>(j)));
    to.push_back(middle - 0.5 * std::cos(1.0 + 3 * static_cast<double>(j)));
  }
  p.ends = {from, zero, zero, to, zero, zero};
  p.T_min = 0.4;
  p.T_max = 4;
  p.degree = 9;
  p.bounds = bounds_of(p.robot);
  p.bounds.ddq.assign(n, 30.0);
  p.bounds.dddq.assign(n, 400.0);
  for (double& tau : p.bounds.tau) tau *= robot == "kr300_r2500" ? 0.8 : robot == "planar2" ? 0.25 : 0.12;
  p.drives.B.assign(n, 0.2);
  p.drives.sigma2.assign(n, 1.5);
  p.drives.tau_C.assign(n, 0.7);
  p.drives.tau_0.assign(n, -0.1);
  for (const Quantity q : {Quantity::kTime, Quantity::kTorque, Quantity::kWork, Quantity::kSharedWork, Quantity::kAcceleration,
                           Quantity::kJerk, Quantity::kEnergy})
    p.costs.push_back({q, 1, {}});
  p.samples = 56;
  Electrical e;
  e.losses = energetics::DriveLosses(n);
  e.losses.R.assign(n, 0.8);
  e.losses.k_t.assign(n, 3.0);
  e.losses.V_0.assign(n, 1.5);
  e.losses.k_h.assign(n, 0.3);
  e.losses.k_e.assign(n, 0.05);
  e.link = {0.01, 48, 60};
  e.supply.efficiency = 0.9;
  e.supply.eta_r = 0.7;
  e.standby.P_0 = 20;
  e.standby.controller = 35;
  e.bus = bus;
  p.electrical = e;
  c.drawing.from.list = {from};
  c.drawing.to.low = c.drawing.to.high = to;
  for (std::size_t j = 0; j < n; ++j) {
    c.drawing.to.low[j] -= 0.3;
    c.drawing.to.high[j] += 0.3;
  }
  c.drawing.c_max.assign(n, 0.2);
  return c;
}

class Judgement : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    library_ = dlopen(COTWIN_STAND_IN, RTLD_NOW | RTLD_GLOBAL);  // the driver's name is found among the libraries that are open
    ASSERT_NE(library_, nullptr) << dlerror();
  }
  void TearDown() override {
    call<void(int)>("stand_in_fail")(0);
    call<void(double)>("stand_in_damage")(1);
  }
  template <class F>
  static F* call(const char* name) {
    return reinterpret_cast<F*>(dlsym(library_, name));
  }
  static void* library_;
};
void* Judgement::library_ = nullptr;

std::shared_ptr<numerics::Device> open_device() { return std::make_shared<numerics::Device>(); }

/// The message of the Error that `work` throws.
template <class Work>
std::string error_of(Work work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

// Chains of 7, 6 and 2 joints, and a tree.
TEST_F(Judgement, HasTheFiguresOfTheEvaluator) {
  for (const char* robot : {"iiwa14", "kr300_r2500", "planar2", "tree"})
    for (const auto bus : {energetics::Bus::kSeparate, energetics::Bus::kShared, energetics::Bus::kGrid}) {
      const Case c = case_of(robot, bus);
      const Evaluator evaluator(c.problem);
      DeviceJudge judge(evaluator, c.drawing, 1, open_device());
      const double difference = judge.difference(evaluator, c.drawing);
      EXPECT_LT(difference, 1e-12) << robot;
      EXPECT_GT(difference, 0) << robot;
      Verdicts verdicts;
      judge.start(0, DeviceJudge::kCompared);
      judge.finish(verdicts);
      ASSERT_EQ(verdicts.count(), DeviceJudge::kCompared);
      std::size_t open = 0, pruned = 0, weak = 0, feasible = 0;
      for (std::size_t k = 0; k < verdicts.count(); ++k) {
        if (verdicts.open(k))
          ++open;
        else if (verdicts.kinematic(k) > 0)
          ++pruned;
        else
          ++(verdicts.torque(k) > 0 ? weak : feasible);
      }
      EXPECT_EQ(open, 0u) << robot;
      for (const std::size_t count : {pruned, weak, feasible}) EXPECT_GT(count, 40u) << robot;
    }
}

// From a posture or several, to several or a box; without torques; ends that move; few and many coefficients.
TEST_F(Judgement, HasThemForProblemsOfEveryKind) {
  const auto difference = [](const Case& c) {
    const Evaluator evaluator(c.problem);
    return DeviceJudge(evaluator, c.drawing, 1, open_device()).difference(evaluator, c.drawing);
  };
  Case c = case_of("iiwa14");
  std::swap(c.drawing.from, c.drawing.to);
  EXPECT_LT(difference(c), 1e-12);
  c.drawing.from.list = {c.drawing.from.low, c.drawing.from.high, c.problem.ends.q_from};
  c.drawing.to.list.push_back(c.problem.ends.q_to);
  EXPECT_LT(difference(c), 1e-12);
  c = case_of("iiwa14");
  c.problem.bounds.tau.assign(7, std::numeric_limits<double>::infinity());
  c.problem.bounds.ddq = c.problem.bounds.tau;
  c.problem.bounds.q_min.assign(7, -std::numeric_limits<double>::infinity());
  c.problem.bounds.q_max.assign(7, std::numeric_limits<double>::infinity());
  c.problem.costs = {{Quantity::kJerk, 1, {}}, {Quantity::kTime, 1, {}}};
  c.problem.electrical.reset();
  EXPECT_LT(difference(c), 1e-12);
  for (const int degree : {5, 31}) {
    c = case_of("tree");
    c.problem.degree = degree;
    c.problem.samples = 500;
    c.problem.T_min = c.problem.T_max = 2;
    EXPECT_LT(difference(c), 1e-12) << degree;
  }
  c = case_of("kr300_r2500");
  c.problem.ends.dq_from.assign(6, 0.1);
  c.problem.ends.ddq_to.assign(6, -0.3);
  EXPECT_LT(difference(c), 1e-12);
  c = case_of("iiwa14");  // stays where it is
  c.problem.degree = 5;
  c.problem.ends.q_to = c.problem.ends.q_from;
  c.drawing.to = c.drawing.from;
  EXPECT_LT(difference(c), 1e-10) << "rounding alone";
}

TEST_F(Judgement, GrowsWhatTheProcessorGrows) {
  Case c = case_of("planar2");
  c.problem.samples = 8;
  c.problem.costs = {{Quantity::kTime, 1, {}}, {Quantity::kEnergy, 1, {}}};
  GrowthOptions o;
  static_cast<Drawing&>(o) = c.drawing;
  o.to.list = {o.to.low, o.to.high, c.problem.ends.q_to};
  o.motions = 280000;  // more than a batch
  std::vector<Round::Particle> particles;
  o.on_batch = [&](const Round& batch) {
    for (std::size_t k = 0; k < batch.particles.size(); k += 97) particles.push_back(batch.particles[k]);
  };
  numerics::Threads threads(2);
  const auto run = [&](DeviceUse device) {
    particles.clear();
    o.device = device;
    return grow(c.problem, o, &threads);
  };
  const Harvest here = run(DeviceUse::kCpu);
  const std::vector<Round::Particle> expected = particles;
  const Harvest there = run(DeviceUse::kGpu);
  EXPECT_EQ(here.device, "");
  EXPECT_EQ(there.device, "stand-in of a GPU");
  EXPECT_EQ(here.not_device + there.not_device, "");
  EXPECT_EQ(there.feasible, here.feasible);
  EXPECT_EQ(there.forbidden, here.forbidden);
  EXPECT_GT(here.feasible, 10000u);
  ASSERT_EQ(there.front.size(), here.front.size());
  for (std::size_t k = 0; k < here.front.size(); ++k) EXPECT_EQ(there.front[k].number, here.front[k].number);
  for (std::size_t term = 0; term < 2; ++term) {
    EXPECT_NEAR(there.costs[term].mean(), here.costs[term].mean(), 1e-12 * here.costs[term].mean());
    for (std::size_t goal = 0; goal < 3; ++goal)
      EXPECT_NEAR(there.goals[goal].least[term], here.goals[goal].least[term], 1e-12 * here.goals[goal].least[term]);
  }
  ASSERT_EQ(particles.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    ASSERT_EQ(particles[k].number, expected[k].number);
    EXPECT_NEAR(particles[k].kinematic, expected[k].kinematic, 1e-12 * (1 + expected[k].kinematic));
    EXPECT_NEAR(particles[k].torque, expected[k].torque, 1e-12 * (1 + expected[k].torque));
    for (std::size_t term = 0; term < 2; ++term) {
      EXPECT_EQ(std::isnan(particles[k].costs[term]), std::isnan(expected[k].costs[term]));
      if (expected[k].kinematic == 0) {
        EXPECT_NEAR(particles[k].costs[term], expected[k].costs[term], 1e-12 * std::abs(expected[k].costs[term]));
      }
    }
  }
}

TEST_F(Judgement, HasTheFiguresOfAGivenRound) {
  Case c = case_of("kr300_r2500");
  c.problem.ends.dq_from.assign(6, 0.1);
  const Evaluator evaluator(c.problem);
  constexpr std::size_t kBlocks = 60;
  JudgedBlocks judged(evaluator, kBlocks, open_device());
  c.drawing.from.list = {c.problem.ends.q_from};
  std::vector<Motions> motions(kBlocks, evaluator.motions());
  for (std::size_t k = 0; k < kBlocks; ++k) {
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      draw(c.problem, c.drawing, static_cast<std::uint32_t>(k * kLanes + lane), motions[k], lane);
    judged.put(k, motions[k]);
  }
  judged.run();
  const auto scratch = evaluator.scratch();
  Values values = evaluator.values(), expected = evaluator.values();
  std::size_t kept = 0;
  for (std::size_t k = 0; k < kBlocks; ++k) {
    judged.take(k, motions[k], *scratch, values);
    evaluator.evaluate(motions[k], *scratch, expected);
    EXPECT_EQ(values.pruned, expected.pruned);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      EXPECT_NEAR(values.kinematic[lane], expected.kinematic[lane], 1e-12 * (1 + expected.kinematic[lane]));
      EXPECT_NEAR(values.torque[lane], expected.torque[lane], 1e-12 * (1 + expected.torque[lane]));
      if (expected.pruned[lane]) continue;
      ++kept;
      for (std::size_t i = lane; i < values.costs.size(); i += kLanes)
        EXPECT_NEAR(values.costs[i], expected.costs[i], 1e-12 * std::abs(expected.costs[i])) << i / kLanes;
    }
  }
  EXPECT_GT(kept, 100u);
}

TEST_F(Judgement, SearchesWithASwarmOnTheDevice) {
  Case c = case_of("planar2");
  Problem& p = c.problem;
  p.costs = {{Quantity::kTorque, 1, {}}};
  p.samples = 24;
  SearchOptions o;
  o.particles = 64;
  o.rounds = 40;
  std::vector<std::string> told;
  o.on_device = [&](const std::string& device, double, const std::string& reason) { told.push_back(device + reason); };
  const Solution here = minimise(p, o);
  EXPECT_TRUE(told.empty()) << "64 particles are not worth a device";
  o.device = DeviceUse::kGpu;
  const Solution there = minimise(p, o);
  ASSERT_EQ(there.status, Status::kFeasible);
  EXPECT_NEAR(there.cost, here.cost, 1e-6 * here.cost);
  EXPECT_THAT(told, ::testing::ElementsAre("stand-in of a GPU"));
  numerics::Threads threads(3);
  const Solution again = minimise(p, o, &threads);
  EXPECT_EQ(again.c, there.c);
  EXPECT_EQ(again.history, there.history);
  call<void(int)>("stand_in_fail")(40);
  EXPECT_THAT(error_of([&] { (void)minimise(p, o); }), HasSubstr("CUDA_ERROR_INVALID_VALUE"));
  o.device = DeviceUse::kAuto;
  o.particles = 10000;
  o.rounds = 4;
  o.refine = false;
  told.clear();
  call<void(int)>("stand_in_fail")(25);
  const Solution without = minimise(p, o);
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(told[0], "stand-in of a GPU");
  EXPECT_THAT(told[1], HasSubstr("CUDA_ERROR_INVALID_VALUE"));
  o.device = DeviceUse::kCpu;
  EXPECT_NEAR(minimise(p, o).cost, without.cost, 1e-9 * without.cost);
}

TEST_F(Judgement, HasTheSameBitsInBlocksOfAnySize) {
  const Case c = case_of("tree");
  DeviceJudge judge(Evaluator(c.problem), c.drawing, 1000, open_device());
  Verdicts one, other;
  judge.start(5, 1000, 32);
  judge.finish(one);
  for (const unsigned block : {1u, 128u, 1000u}) {
    judge.start(5, 1000, block);
    judge.finish(other);
    for (std::size_t k = 0; k < 1000; ++k) {
      EXPECT_EQ(other.kinematic(k), one.kinematic(k));
      EXPECT_EQ(other.torque(k), one.torque(k));
      if (one.kinematic(k) == 0 && !one.open(k)) {
        EXPECT_EQ(other.cost(6, k), one.cost(6, k));
      }
    }
  }
}

TEST_F(Judgement, TellsEachFailureOfTheDriverAndGivesEverythingBack) {
  Case c = case_of("planar2");
  c.problem.samples = 8;
  const Evaluator evaluator(c.problem);
  const int before = call<int()>("stand_in_taken")();
  std::set<std::string> told;
  const auto work = [&] {
    DeviceJudge judge(evaluator, c.drawing, 1, open_device());
    Verdicts verdicts;
    judge.start(0, 100);
    judge.finish(verdicts);
  };
  call<void(int)>("stand_in_fail")(0);
  work();
  const int all = call<int()>("stand_in_calls")();
  EXPECT_EQ(call<int()>("stand_in_taken")(), before);
  for (int k = 1; k <= all; ++k) {
    call<void(int)>("stand_in_fail")(k);
    const std::string error = error_of(work);
    const std::string failed = call<const char*()>("stand_in_failed")();
    EXPECT_EQ(call<int()>("stand_in_taken")(), before) << failed;
    // To give back is tried, and a failure of it tells nothing.
    if (error == "no error") continue;
    EXPECT_EQ(error,
              "GPU: " + failed + (failed == "cuMemAlloc_v2" ? ": CUDA_ERROR_OUT_OF_MEMORY" : ": CUDA_ERROR_INVALID_VALUE"));
    told.insert(failed);
  }
  EXPECT_THAT(told, ::testing::UnorderedElementsAre("cuInit", "cuDeviceGet", "cuDeviceGetName", "cuDeviceGetAttribute",
                                                    "cuDevicePrimaryCtxRetain", "cuCtxSetCurrent", "cuModuleLoadDataEx",
                                                    "cuModuleGetFunction", "cuMemAlloc_v2", "cuMemcpyHtoD_v2", "cuLaunchKernel",
                                                    "cuCtxSynchronize", "cuMemcpyDtoH_v2"));
}

TEST_F(Judgement, GoesOnWithTheProcessorWhereAGpuIsNotAsked) {
  Case c = case_of("planar2");
  c.problem.costs = {{Quantity::kTime, 1, {}}};
  for (auto* bounds : {&c.problem.bounds.tau, &c.problem.bounds.ddq, &c.problem.bounds.dddq})  // quickly judged
    bounds->assign(2, std::numeric_limits<double>::infinity());
  GrowthOptions o;
  static_cast<Drawing&>(o) = c.drawing;
  o.motions = 1000000;
  o.device = DeviceUse::kCpu;
  const Harvest here = grow(c.problem, o);
  o.device = DeviceUse::kAuto;
  const Harvest there = grow(c.problem, o);
  EXPECT_EQ(there.device, "stand-in of a GPU");
  EXPECT_EQ(there.forbidden, here.forbidden);
  call<void(int)>("stand_in_fail")(0);
  (void)DeviceJudge(Evaluator(c.problem), c.drawing, 1, numerics::Device::shared());
  const int opening = call<int()>("stand_in_calls")() - 3;  // less what gives back
  for (const int failing : {1, opening + 4}) {
    call<void(int)>("stand_in_fail")(failing);
    const Harvest later = grow(c.problem, o);
    EXPECT_THAT(later.not_device, HasSubstr("CUDA_ERROR")) << failing;
    EXPECT_EQ(later.device, failing == 1 ? "" : "stand-in of a GPU");
    EXPECT_EQ(later.forbidden, here.forbidden);
    EXPECT_EQ(later.feasible, here.feasible);
    o.device = DeviceUse::kGpu;
    call<void(int)>("stand_in_fail")(failing);
    EXPECT_THAT(error_of([&] { (void)grow(c.problem, o); }), HasSubstr("CUDA_ERROR"));
    o.device = DeviceUse::kAuto;
  }
  o.motions = 999999;
  EXPECT_EQ(grow(c.problem, o).device, "");
}

TEST_F(Judgement, RefusesAGpuWithOtherFiguresAndWhatItDoesNotKnow) {
  Case c = case_of("tree");
  const auto refusal = [](const Case& own) {
    return error_of([&] { DeviceJudge judge(Evaluator(own.problem), own.drawing, 1, open_device()); });
  };
  EXPECT_EQ(refusal(c), "no error");
  for (const double factor : {1 + 1e-5, 0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    call<void(double)>("stand_in_damage")(factor);
    EXPECT_THAT(refusal(c), HasSubstr("GPU: stand-in of a GPU differs by ")) << factor;
  }
  call<void(double)>("stand_in_damage")(1);
  Case own = c;
  own.problem.loads.wrench = robot::ExternalWrench{own.problem.robot.frames.front()};
  EXPECT_EQ(refusal(own), "GPU: judges no loads that come and go, and no wrench");
  own = c;
  own.problem.costs.push_back(
      {Quantity::kPower, 1, [](std::size_t n, const double*, const double*, double* power) { std::fill_n(power, n, 1.0); }});
  EXPECT_EQ(refusal(own), "GPU: judges no power");
  own = c;
  own.problem.compliant.emplace();
  own.problem.compliant->frame = own.problem.robot.frames.front();
  own.problem.compliant->axes = {{Eigen::Vector3d::UnitX(), {1, 1, 1}, {2, 2, 2}}};
  own.problem.compliant->load = own.problem.compliant->settled = 1;
  EXPECT_EQ(refusal(own), "GPU: judges no compliance");
  std::string chain = "<robot name=\"long\"><link name=\"l0\"/>";
  for (int i = 1; i <= 17; ++i) {
    const std::string k = std::to_string(i), before = std::to_string(i - 1);
    chain += "<joint name=\"j" + k + "\" type=\"revolute\"><parent link=\"l" + before + "\"/><child link=\"l" + k +
             R"("/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="900"/></joint><link name="l)" + k +
             R"("><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>)";
  }
  own.problem = {};
  own.problem.robot = robot::parse_urdf(chain + "</robot>", "long");
  const std::vector<double> zero(17, 0.0);
  own.problem.ends = {zero, zero, zero, zero, zero, zero};
  own.problem.bounds = bounds_of(own.problem.robot);
  own.problem.costs = {{Quantity::kTime, 1, {}}};
  EXPECT_EQ(refusal(own), "GPU: judges robots of at most 16 joints, this one has 17");
}

/// A number from the environment, of scripts/gpu_check.sh.
std::uint32_t number_of(const char* name, std::uint32_t standard) {
  const char* given = std::getenv(name);
  return given ? static_cast<std::uint32_t>(std::stoul(given)) : standard;
}

class RealDevice : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      device_ = open_device();
    } catch (const numerics::DeviceError& error) {
      GTEST_SKIP() << error.what();
    }
    if (device_->name().starts_with("stand-in") && !std::getenv("GPU_CHECK_MOTIONS"))
      GTEST_SKIP() << "no GPU, but its stand-in";
    std::cout << "GPU: " << device_->name() << "\n";
  }
  std::shared_ptr<numerics::Device> device_;
};

TEST_F(RealDevice, HasTheFiguresOfTheProcessor) {
  constexpr std::uint32_t kPart = 1 << 14;
  const std::uint32_t motions = number_of("GPU_CHECK_MOTIONS", 1000000);
  numerics::Threads threads(static_cast<int>(std::max(1u, std::thread::hardware_concurrency())));
  for (const char* robot : {"iiwa14", "kr300_r2500", "planar2", "tree"}) {
    const Case c = case_of(robot);
    const Evaluator evaluator(c.problem);
    std::vector<double> largest((motions + kPart - 1) / kPart);
    threads.run(largest.size(), [&](std::size_t k) {
      DeviceJudge judge(evaluator, c.drawing, kPart, device_);
      largest[k] = judge.difference(evaluator, c.drawing, static_cast<std::uint32_t>(k) * kPart, kPart);
    });
    const double difference = *std::ranges::max_element(largest);
    std::cout << robot << ": " << largest.size() * kPart << " motions differ by at most " << difference << "\n";
    EXPECT_LT(difference, 1e-12) << robot;
  }
}

TEST_F(RealDevice, KeepsNoMemory) {
  void* const driver = dlopen("libcuda.so.1", RTLD_NOW);
  const auto info = reinterpret_cast<int (*)(std::size_t*, std::size_t*)>(dlsym(driver, "cuMemGetInfo_v2"));
  ASSERT_NE(info, nullptr);
  const Case c = case_of("planar2");
  const Evaluator evaluator(c.problem);
  const auto left_after = [&](std::uint32_t calls) {
    for (std::uint32_t k = 0; k < calls; ++k) (void)DeviceJudge(evaluator, c.drawing, 1, device_);
    std::size_t free = 0, total = 0;
    EXPECT_EQ(info(&free, &total), 0);
    return free;
  };
  const std::size_t before = left_after(10);
  const std::uint32_t calls = number_of("GPU_CHECK_CALLS", 1000);
  EXPECT_GE(left_after(calls), before);
  std::cout << calls << " calls keep no memory of the GPU\n";
}

// What the driver would find only on a machine with a GPU: functions that nobody defines, and single precision.
TEST(JudgementPtx, CallsOnlyItsOwnFunctionsInDoublePrecision) {
  for (const char* text : kJudgementPtx) {
    const std::string ptx = text;
    if (ptx.empty()) GTEST_SKIP() << "built without clang";
    EXPECT_THAT(ptx, HasSubstr(".version 6.0\n.target sm_70\n.address_size 64"));
    EXPECT_THAT(ptx, Not(HasSubstr(".extern")));
    EXPECT_THAT(ptx, Not(::testing::ContainsRegex("[.](f32|f16|approx)")));
    EXPECT_THAT(ptx, HasSubstr("fma.rn.f64"));
    const auto names = [&](const std::string& pattern) {
      const std::regex regex(pattern);
      std::set<std::string> found;
      for (std::sregex_iterator at(ptx.begin(), ptx.end(), regex), end; at != end; ++at) found.insert((*at)[1]);
      return found;
    };
    const std::set<std::string> defined = names(R"(\.func\s+(?:\([^)]*\)\s*)?(\w+))"),
                                called = names(R"(call\.[\w.]*\s+(?:\([^)]*\),\s*)?(\w+))");
    for (const std::string& name : called) EXPECT_TRUE(defined.contains(name)) << name;
  }
}

}  // namespace
}  // namespace judgement_test
}  // namespace cotwin::optimisation
