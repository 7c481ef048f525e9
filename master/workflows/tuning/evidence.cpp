#include "master/workflows/tuning/evidence.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

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

/// The torque limit of a joint, N.m (prismatic: N); 0 where it is none, or a placeholder.
double limit_of(const Data& data, std::size_t joint) {
  constexpr double kPlaceholder = 30;  // times the largest torque
  const measurement::JointSurvey& survey = data.survey.joints[joint];
  const double limit = data.robot.joints[joint].tau_max;
  return limit <= kPlaceholder * std::max(std::abs(survey.tau_min), std::abs(survey.tau_max)) ? limit : 0;
}

/// Smaller errors are no alarm, N.m (prismatic: N).
double error_that_matters(const Data& data, std::size_t joint) {
  constexpr double kOfLimit = 0.02, kOfTorque = 0.1;
  const double limit = limit_of(data, joint);
  return limit > 0 ? kOfLimit * limit : kOfTorque * data.survey.joints[joint].tau_rms;
}

/// ", 0.4 % of the limit", where there is one.
std::string of_limit(const Data& data, std::size_t joint, double error) {
  const double limit = limit_of(data, joint);
  return limit > 0 ? ", " + digits(100 * error / limit, 2) + " % of the limit" : "";
}

bool matters(const Data& data, const identification::Finding& finding) {
  if (finding.kind != Kind::kLag || finding.joints.size() != 1) return true;
  return finding.before[finding.joints.front()] > error_that_matters(data, static_cast<std::size_t>(finding.joints.front()));
}

std::string late(const identification::Finding& finding) {
  return (finding.value > 0 ? "late by " : "early by ") + digits(1e3 * std::abs(finding.value)) + " ms";
}

std::string sentence(const Data& data, const identification::Finding& finding) {
  switch (finding.kind) {
    case Kind::kGravity:
      return gravity(data, finding);
    case Kind::kClock:
      return "time that runs at " + digits(finding.value) + " times the log's explains the torques " + gain_of(data, finding) +
             "; is the unit or the rate of the time column another one?";
    case Kind::kLag:
      return "torques of " + (finding.joints.size() == data.robot.joints.size() ? "all joints" : names_of(data, finding)) +
             " that come " + digits(1e3 * std::abs(finding.value)) + " ms " + (finding.value > 0 ? "after" : "before") +
             " the motion are explained " + gain_of(data, finding) + "; expected positions and torques of the same instant";
    case Kind::kTorques:
      return "with the torque columns of " + names_of(data, finding) + " exchanged they are explained " +
             gain_of(data, finding) + "; are they in another order?";
    case Kind::kJoints:
      return "with all columns of " + names_of(data, finding) + " exchanged the torques are explained " +
             gain_of(data, finding) + "; are the joints in another order?";
    case Kind::kSign:
      return "friction of " + names_of(data, finding) +
             " would drive the joint instead of braking it; has its torque, or its position, the other sign?";
  }
  return "";
}

std::string newtons(const robot::Joint& joint, double x) {
  return digits(x) + (joint.type == robot::JointType::kPrismatic ? " N" : " N.m");
}

/// "--tau-columns tau2,tau1: held out joint_1 5.82 to 0.32 N.m, …": the joints whose errors change.
std::string told(const Data& data, const Repair& repair) {
  constexpr double kSame = 0.02;
  std::string joints;
  for (std::size_t j = 0; j < data.robot.joints.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const double before = repair.before[i], after = repair.after[i];
    if (data.survey.moves(j) && std::abs(after - before) > kSame * before)
      text::append(joints, data.robot.joints[j].name + " " + digits(before) + " to " + newtons(data.robot.joints[j], after));
  }
  return repair.options + ": " + (data.held_out ? "held out " : "training ") + joints;
}

}  // namespace

std::vector<std::string> evidence(const Settings& settings, const Data& data, const Repairs& repairs) {
  std::vector<std::string> sentences = data.survey.damage;
  std::string all;
  for (const identification::Finding& finding : data.findings)
    if (matters(data, finding)) text::append(all, sentence(data, finding), "; then ");
  if (all.empty()) return sentences;
  all += all.back() == '?' ? "" : ".";
  if (!repairs.untried.empty()) {
    all += " Not tried: " + repairs.untried;
  } else if (repairs.looked && repairs.found.empty()) {
    all += " Options that mend it were looked for, not found";
  } else if (!repairs.found.empty()) {
    all += " Tried: " + told(data, repairs.found[0]);
    if (repairs.found.size() > 1)
      all += "; or " + told(data, repairs.found[1]) + "; the log does not tell which: the other one is a mirrored robot";
  }
  sentences.push_back(settings.data.front().string() + ": " + all);
  return sentences;
}

std::size_t count_alarms(const Data& data, const Evaluation& evaluation, std::size_t candidate) {
  std::size_t count = data.survey.damage.size();
  for (const identification::Finding& finding : data.findings) count += matters(data, finding) ? 1 : 0;
  for (std::size_t j = 0; j < data.robot.joints.size(); ++j)
    count += verdict_of(data, evaluation, {}, candidate, j).alarm ? 1 : 0;
  return count;
}

Verdict verdict_of(const Data& data, const Evaluation& evaluation, const BoundsCost& bounds, std::size_t candidate,
                   std::size_t joint) {
  constexpr double kWorse = 1.02, kHeldBack = 1.5, kHelps = 0.95, kGood = 0.1, kFair = 0.3;  // the last two of the torque
  const robot::Joint& of = data.robot.joints[joint];
  if (!data.survey.moves(joint)) return {false, of.name + ": stands still, not judged"};
  const auto i = static_cast<Eigen::Index>(joint);
  const bool known = evaluation.held_out.has_value();
  const PartErrors &training = evaluation.training, &part = known ? *evaluation.held_out : training;
  const double error = part.of[candidate].rms[i], prior = part.of.front().rms[i], floor = part.of.back().rms[i],
               torque = part.torque_rms[i], before = training.of[candidate].rms[i], floor_before = training.of.back().rms[i];
  const std::string says = of.name + (known ? ": held-out error " : ": training error ") + newtons(of, error);
  if (known && !of.passive && error > kWorse * torque)
    return {true, says + ", expected below the torque itself, " + newtons(of, torque)};
  if (known && error > kWorse * prior) return {true, says + ", expected below that of the prior, " + newtons(of, prior)};
  // Of a passive joint least squares makes the bodies zero, which has no error.
  const bool held_back = known && !of.passive && error > kHeldBack * floor && before > kHeldBack * floor_before;
  if (held_back && error > error_that_matters(data, joint)) {
    const double wider = bounds.with_all.size() > 0 ? bounds.with_all[i] : error;
    return {true, says + " (training " + newtons(of, before) +
                      "), expected at most 1.5 times that of unconstrained least squares, " + newtons(of, floor) + " (" +
                      newtons(of, floor_before) + "): no robot within the bounds has these torques, " +
                      (wider <= kHeldBack * floor ? "with all bounds wider it is " + newtons(of, wider)
                                                  : "nor with all bounds wider; a sign, or the order of columns?")};
  }
  const double share = torque > 0 ? error / torque : 0;
  std::string word = share <= kGood && !held_back ? "good" : share <= kFair ? "fair" : "poor", at;
  if (bounds.with_bodies.size() > 0 && bounds.with_bodies[i] < kHelps * error) at = "at a bound, see " + bounds.options;
  if (bounds.with_friction.size() > 0 && bounds.with_friction[i] < kHelps * error)
    text::append(at, "at a bound of friction: " + bounds.friction);
  if (!at.empty()) word = word == "good" ? at : word + ", " + at;
  if (held_back) word += of_limit(data, joint, error);
  for (const identification::Finding& finding : data.findings)
    if (!matters(data, finding) && finding.joints.front() == static_cast<int>(joint))
      word += ", " + late(finding) + of_limit(data, joint, finding.before[i]);
  return {false, says + " of " + newtons(of, torque) + " (" + digits(100 * share, 2) + " %), " +
                     digits(error / std::max(floor, 1e-300)) +
                     " times that of unconstrained least squares: " + (known ? word : "nothing was held out, not judged")};
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
