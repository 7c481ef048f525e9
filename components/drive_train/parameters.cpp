// Declaration and checks of the drive train's parameters.
#include <cmath>

#include "components/drive_train/drive_train.h"
#include "components/drive_train/floating_links.h"
#include "models/foundation/support/assumed.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/start.h"

namespace cotwin::drive_train {

void DriveTrain::declare_parameters(Variables& v) {
  JointVariables joints(v, measures_);
  // CVODE's history is replayed after a restored snapshot with the present parameters: they must not have changed since the
  // history began. A change of the bodies begins a new history.
  const bool tunable = !uses_cvode();
  auto q0 = joints.parameter("q0", q0_, "rad", "link-side joint position at the start, inside");
  if (equations_.inside()) q0.essential();
  joints.parameter("dq0", dq0_, "rad/s", "link-side and motor speed at the start, inside");
  for (const auto& row : robot::kDriveParameters) {
    if (row.values == &robot::DriveParameters::v_R) declare_stops_and_solver(v);  // keeps the FMI value references
    joints.parameter(wanted_, row, tunable);
  }
  if (tunable) {
    v.state("drives", drives_, "1", "the tunables B, sigma2, tau_C … v_R in force, each of all joints, in the order above");
  }
  if (equations_.inside()) declare_bodies(v, equations_.bodies(), true);
}

void DriveTrain::declare_stops_and_solver(Variables& v) {
  JointVariables joints(v, measures_);
  for (const auto& row : kStopParameters) joints.parameter(wanted_, row);
  v.parameter("rtol", rtol_, "1", "relative local error allowed in a sub-step").range(0, 1);
  joints.parameter("atol", atol_, "rad", "absolute local error allowed in q and theta").range(1e-14, 1);
  joints.parameter("atol_speed", atol_speed_, "rad/s", "absolute local error allowed in dq and dtheta").range(1e-14, 1e3);
  v.parameter("max_substeps", max_substeps_, "attempts in one step, after which the tolerance is given up; not with cvode")
      .range(1, 100000);
  v.parameter("input_order", input_order_,
              "0: inputs are held over a step, or follow their rates; 1: they go linearly from their last value to the new "
              "one, which is that at the step's end (q and dq outside: a cubic; with 0 q moves on with dq)")
      .range(0, 1);
  v.parameter("link_order", link_order_,
              "the same for q and dq with link_side=outside: 1 where their source makes its step before this unit's; -1: as "
              "input_order")
      .range(-1, 1);
  v.parameter("transition", transition_, "s", "time constant with which what is in force follows the tunables; 0: at once")
      .range(0, 1e6);
}

void DriveTrain::check_parameters() const {
  constexpr double kFastest = 1e6;  // rad/s or m/s
  const Parameters& p = wanted_;
  check_values(p, robot::kDriveParameters, place_);
  check_values(p, kStopParameters, place_);
  check_assumed(place_ + ".assumed", assumed_, robot::kDriveParameterNames);
  if (equations_.floating()) equations_.floating()->check_parameters(place_);
  const auto fail = [&](const char* name, std::size_t i, double value, const std::string& expected) {
    throw Error(place_ + "." + name + "[" + std::to_string(i + 1) + "]",
                "is " + text::to_text(value) + ", expected " + expected);
  };
  for (std::size_t i = 0; i < n_; ++i) {
    const bool driven = !equations_.passive(i);
    if (driven && p.B[i] == 0) fail("B", i, 0, "a finite value > 0");
    if (driven && equations_.flexible() && p.K[i] == 0) fail("K", i, 0, "a finite value > 0");
    if (p.tau_S[i] < p.tau_C[i])
      fail("tau_S", i, p.tau_S[i], "at least tau_C = " + text::to_text(p.tau_C[i]) + " " + measures_.si("N.m", i));
    if (equations_.has_bristles() && p.sigma0[i] == 0 && p.tau_S[i] > 0) {
      const bool coulomb = p.tau_C[i] > 0;
      fail(coulomb ? "tau_C" : "tau_S", i, coulomb ? p.tau_C[i] : p.tau_S[i],
           "0 where no bristle carries it (sigma0 = 0), or friction=coulomb or smooth");
    }
    if (!equations_.inside()) continue;
    if (!std::isfinite(q0_[i])) fail("q0", i, q0_[i], "a finite value");
    if (!std::isfinite(dq0_[i])) fail("dq0", i, dq0_[i], "a finite value");
    if (!(std::abs(dq0_[i]) <= kFastest)) fail("dq0", i, dq0_[i], "at most 1e6 " + measures_.si("rad/s", i));
    if (!(p.q_min[i] < p.q_max[i]))
      fail("q_min", i, p.q_min[i], "below q_max = " + text::to_text(p.q_max[i]) + " " + measures_.si("rad", i));
  }
  if (equations_.inside()) robot::check_start(place_, limits_.joints(), q0_, p.q_min, p.q_max);
}

}  // namespace cotwin::drive_train
