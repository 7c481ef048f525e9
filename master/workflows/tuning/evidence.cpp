#include "master/workflows/tuning/evidence.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::master::tuning {

namespace {

using Kind = identification::Finding::Kind;

std::string digits(double x, int count = 3) { return text::to_text(x, count); }

/// "2.3 times better (joint_2: 4.1 to 0.9 N.m, …)": the joints that gain most, at most three.
std::string gain_of(const Data& data, const identification::Finding& finding) {
  std::vector<int> joints = finding.joints;
  const auto ratio = [&](int j) { return finding.before[j] / std::max(finding.after[j], 1e-300); };
  std::ranges::stable_sort(joints, [&](int a, int b) { return ratio(a) > ratio(b); });
  std::string names;
  for (std::size_t k = 0; k < std::min<std::size_t>(3, joints.size()); ++k) {
    const robot::Joint& joint = data.robot.joints[static_cast<std::size_t>(joints[k])];
    text::append(names, joint.name + ": " + digits(finding.before[joints[k]]) + " to " + digits(finding.after[joints[k]]) +
                            (joint.type == robot::JointType::kPrismatic ? " N" : " N.m"));
  }
  return digits(finding.gain) + " times better by least squares (" + names + ")";
}

std::string names_of(const Data& data, const identification::Finding& finding) {
  std::string names;
  for (const int j : finding.joints) text::append(names, data.robot.joints[static_cast<std::size_t>(j)].name);
  return names;
}

/// All columns of the log in the order of joints, those of the two of the finding exchanged.
std::string exchanged(const Data& data, const identification::Finding& finding, std::string measurement::JointSurvey::*column) {
  std::vector<std::string> columns;
  for (const measurement::JointSurvey& joint : data.survey.joints) columns.push_back(joint.*column);
  std::swap(columns[static_cast<std::size_t>(finding.joints[0])], columns[static_cast<std::size_t>(finding.joints[1])]);
  return text::joined(columns, ",");
}

std::string gravity(const Data& data, const identification::Finding& finding) {
  const Eigen::Vector3d to = finding.gravity.normalized(), from = data.robot.gravity.normalized();
  std::string text = "gravity along (" + digits(to.x()) + ", " + digits(to.y()) + ", " + digits(to.z()) +
                     ") of the robot's base, " + digits(finding.value * 180 / std::numbers::pi) +
                     " degrees from the URDF's, explains the torques " + gain_of(data, finding) +
                     "; is the base mounted so? Then ";
  std::vector<const robot::Joint*> roots;
  for (const robot::Joint& joint : data.robot.joints)
    if (joint.parent < 0) roots.push_back(&joint);
  if (roots.size() != 1) return text + "turn the base in the URDF";
  // What turns the found direction to the URDF's turns the robot.
  const Eigen::Matrix3d R = Eigen::Quaterniond::FromTwoVectors(to, from).toRotationMatrix();
  const Eigen::Vector3d rpy = robot::rpy_of(R * roots[0]->X_PJ.R);
  return text + "rpy=\"" + digits(rpy.x(), 4) + " " + digits(rpy.y(), 4) + " " + digits(rpy.z(), 4) +
         "\" of the <origin> of joint '" + roots[0]->name + "' turns it";
}

std::string signs(const Settings& settings, const Data& data, const identification::Finding& finding) {
  const std::string list = measurement::scales(settings.format.tau_scale, data.robot.joints.size(), finding.joints, -1);
  return "friction of " + names_of(data, finding) +
         " would drive the joint instead of braking it; has its torque, or its position, the other sign? Then --tau-scale " +
         list + " or --q-scale";
}

std::string sentence(const Settings& settings, const Data& data, const identification::Finding& finding) {
  switch (finding.kind) {
    case Kind::kGravity:
      return gravity(data, finding);
    case Kind::kClock:
      return "time that runs at " + digits(finding.value) + " times the log's explains the torques " + gain_of(data, finding) +
             "; is the unit or the rate of the time column another one? Then --time-unit or --rate";
    case Kind::kLag:
      return "torques of " + (finding.joints.size() == data.robot.joints.size() ? "all joints" : names_of(data, finding)) +
             " that come " + digits(1e3 * std::abs(finding.value)) + " ms " + (finding.value > 0 ? "after" : "before") +
             " the motion are explained " + gain_of(data, finding) + "; expected positions and torques of the same instant";
    case Kind::kTorques:
      return "with the torque columns of " + names_of(data, finding) + " exchanged they are explained " +
             gain_of(data, finding) + "; are they in another order? Then --tau-columns " +
             exchanged(data, finding, &measurement::JointSurvey::tau_column);
    case Kind::kJoints:
      return "with all columns of " + names_of(data, finding) + " exchanged the torques are explained " +
             gain_of(data, finding) + "; are the joints in another order? Then --q-columns " +
             exchanged(data, finding, &measurement::JointSurvey::q_column) + " --tau-columns " +
             exchanged(data, finding, &measurement::JointSurvey::tau_column);
    case Kind::kSign:
      return signs(settings, data, finding);
  }
  return "";
}

}  // namespace

std::vector<std::string> evidence(const Settings& settings, const Data& data) {
  std::vector<std::string> sentences = data.survey.damage;
  for (const identification::Finding& finding : data.findings)
    sentences.push_back(settings.data.front().string() + ": " + sentence(settings, data, finding));
  return sentences;
}

Verdict verdict_of(const Data& data, const Evaluation& evaluation, std::size_t candidate, std::size_t joint) {
  constexpr double kWorse = 1.02, kHeldBack = 1.5, kMatters = 0.02, kGood = 0.1, kFair = 0.3;  // the last three of the torque
  const robot::Joint& of = data.robot.joints[joint];
  if (!data.survey.moves(joint)) return {false, of.name + ": stands still, not judged"};
  const auto i = static_cast<Eigen::Index>(joint);
  const bool known = evaluation.held_out.has_value();
  const PartErrors &training = evaluation.training, &part = known ? *evaluation.held_out : training;
  const double error = part.of[candidate].rms[i], prior = part.of.front().rms[i], floor = part.of.back().rms[i],
               torque = part.torque_rms[i], before = training.of[candidate].rms[i], floor_before = training.of.back().rms[i];
  const auto newtons = [&](double x) { return digits(x) + (of.type == robot::JointType::kPrismatic ? " N" : " N.m"); };
  const std::string says = of.name + (known ? ": held-out error " : ": training error ") + newtons(error);
  if (known && !of.passive && error > kWorse * torque)
    return {true, says + ", expected below the torque itself, " + newtons(torque)};
  if (known && error > kWorse * prior) return {true, says + ", expected below that of the prior, " + newtons(prior)};
  if (known && error > kHeldBack * floor && before > kHeldBack * floor_before && error > kMatters * torque)
    return {true, says + " (training " + newtons(before) +
                      "), expected at most 1.5 times that of unconstrained least squares, " + newtons(floor) + " (" +
                      newtons(floor_before) +
                      "): no robot within the bounds has these torques; a sign, the order of columns, or a bound?"};
  const double share = torque > 0 ? error / torque : 0;
  const char* word = share <= kGood ? "good" : share <= kFair ? "fair" : "poor";
  return {false, says + " of " + newtons(torque) + " (" + digits(100 * share, 2) + " %), " +
                     digits(error / std::max(floor, 1e-300)) +
                     " times that of unconstrained least squares: " + (known ? word : "nothing was held out, not judged")};
}

std::vector<std::string> bounds_of(const Settings& settings, const Data& data, const identification::Problem& problem,
                                   const identification::FeasibleResult& solution, const Hooks& hooks) {
  constexpr double kMatters = 0.01;  // of the weighted RMS
  using Bound = identification::ActiveBound::Kind;
  using B = identification::Bounds;
  const identification::Bounds& b = settings.bounds;
  const auto speeds = [](double from, double to) { return " (" + digits(from) + " to " + digits(to) + " rad/s)"; };
  struct Wider {
    Bound kind;
    std::string name, option;
    double B::*most;
    double factor;
    double B::*least = nullptr;
    std::string of = {};
  };
  std::vector<Wider> kinds = {
      {Bound::kMass, "mass (" + digits(b.mass_factor) + " times the URDF's)", "--mass-factor ", &B::mass_factor, 10},
      {Bound::kStretch, "stretch of the mass distribution (" + digits(b.stretch_factor) + ")", "--stretch-factor ",
       &B::stretch_factor, 10},
      {Bound::kShear, "shear of the mass distribution (" + digits(b.shear) + ")", "--shear ", &B::shear, 3},
      {Bound::kShift, "shift of the centre of mass (" + digits(b.shift) + ")", "--shift ", &B::shift, 3},
      {Bound::kVR, "v_R" + speeds(b.v_R_min, b.v_R_max), "up to ", &B::v_R_max, 10, &B::v_R_min},
      {Bound::kVS, "v_S" + speeds(b.v_S_min, b.v_S_max), "up to ", &B::v_S_max, 10, &B::v_S_min},
      {Bound::kS, "s" + speeds(-b.s_max, b.s_max), "up to ", &B::s_max, 10}};
  for (const identification::ActiveBound& bound : problem.active_bounds(solution.xi))
    for (Wider& kind : kinds)
      if (kind.kind == bound.kind) text::append(kind.of, bound.of);
  std::erase_if(kinds, [](const Wider& kind) { return kind.of.empty(); });
  if (kinds.empty()) return {};
  const auto rms_with = [&](std::span<const Wider> widened) {
    identification::ProblemOptions options = problem_options(settings);
    options.sigma = problem.sigma();
    for (const Wider& kind : widened) {
      options.bounds.*kind.most *= kind.factor;
      if (kind.least != nullptr) options.bounds.*kind.least /= kind.factor;
    }
    identification::FeasibleOptions feasible;
    feasible.stop = hooks.stop;
    return identification::solve_feasible(identification::Problem(data.training->data, data.robot, options), feasible)
        .weighted_rms;
  };
  const std::string now = ": weighted RMS " + digits(solution.weighted_rms, 5) + ", with ";
  std::vector<std::string> sentences;
  const double all = rms_with(kinds);
  const bool matter = all < (1 - kMatters) * solution.weighted_rms;
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const Wider& kind = kinds[k];
    const double rms = matter && kinds.size() > 1 ? rms_with(std::span(kinds).subspan(k, 1)) : all;
    sentences.push_back(kind.name + ", of " + kind.of + ", is at its bound" + now +
                        (matter ? kind.option + digits(b.*kind.most * kind.factor) : "all bounds wider") + " " +
                        digits(rms, 5));
  }
  if (matter && kinds.size() > 1) sentences.push_back("together" + now + "all of these " + digits(all, 5));
  return sentences;
}

std::string moving_mass(const Data& data, const identification::Floor& floor) {
  constexpr double kSame = 1.5, kAlike = 0.5;
  const identification::BaseParameters& base = data.training->data.base();
  const Eigen::VectorXd prior = base.G * identification::estimate_of(data.robot).pi;
  double square = 0, product = 0, found = 0;
  for (std::size_t k = 0; k < base.columns.size(); ++k) {
    if (base.columns[k] % 10 > 3) continue;  // moments of inertia
    const auto i = static_cast<Eigen::Index>(k);
    square += prior[i] * prior[i];
    product += prior[i] * floor.beta[i];
    found += floor.beta[i] * floor.beta[i];
  }
  const double ratio = product / square;
  if (!(product > kAlike * std::sqrt(square * found)) || (ratio < kSame && ratio > 1 / kSame)) return "";
  return "moving mass " + digits(ratio, 2) +
         " times that of the URDF, by its moments about the axes: a load, another robot, lengths of links, zero positions or "
         "the scale of "
         "all torques (--tau-scale); no log tells which";
}

}  // namespace cotwin::master::tuning
