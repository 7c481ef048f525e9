#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::energetics {

/// Names of the columns of a log. Those of joints are followed by the joint's number, from 1 or 0. Empty: one of the usual names
/// is searched.
struct PowerColumns {
  std::string t;          // s: t, time, timestamp
  std::string power;      // W: P, power; else the product of the next two
  std::string voltage;    // V: u_dc, u, voltage, robot_voltage
  std::string current;    // A: i_dc, robot_current, current
  std::string q;          // rad: q
  std::string dq;         // rad/s: dq, qd
  std::string ddq;        // rad/s²: ddq, qdd, ddq_ref, qdd_ref; with a robot in place of tau
  std::string tau;        // N.m: tau, tau_m, tau_ref
  std::string i;          // A: i, i_m
  std::string reference;  // rad/s, tells when the robot moves: dq_ref, qd_ref; else dq
};

/// A log of motions with the power that a wattmeter or the bus of the arm showed: one or several recordings of the same robot.
struct PowerLog {
  std::vector<std::string> files;
  std::vector<double> t, P;         // s in each recording, W
  Eigen::MatrixXd dq, tau, i;       // one row per sample, one column per joint; tau, i: no columns where the log has none
  std::vector<bool> moving;         // per sample
  std::vector<std::size_t> begins;  // samples before which there is a gap or a recording ends, and 0
  std::size_t recordings = 1;
  std::vector<std::string> warnings;  // "a.csv: 2 rows …": what was left out

  std::string place() const;  // for messages: "a.csv, b.csv"
  std::size_t joints() const { return static_cast<std::size_t>(dq.cols()); }
  /// Mean power of samples at rest, W; NaN if there are none.
  double power_at_rest() const;
};

/// Reads a log (models/foundation/formats/csv.h). Rows with a value that is not finite are left out, with a warning. A step of more than five
/// times the usual one is a gap. Where the time goes back and ten rows without a gap follow, another recording begins. Where dq is missing it is
/// computed from q, within segments. With a `robot` (nullptr: none) and without a column of torques, tau is the inverse dynamics of
/// q, dq, ddq. Throws Error for missing columns, other times that go back, a power that is constant or mostly negative, and speeds
/// that do not fit the positions (degrees, milliseconds).
PowerLog read_power_log(const std::filesystem::path& file, const PowerColumns& columns = {},
                        const robot::RobotModel* robot = nullptr);
/// The same for several files, one after another. Throws Error where they differ in the number of joints, or where only some have
/// torques or currents.
PowerLog read_power_logs(std::span<const std::filesystem::path> files, const PowerColumns& columns = {},
                         const robot::RobotModel* robot = nullptr);

/// Samples [begin, end) of a motion with the sample at rest before it.
struct LoggedMotion {
  std::size_t begin = 0, end = 0;
};
/// The motions that are longer than `least` seconds; none contains a gap. Those that a recording or a gap cuts off are parts.
std::vector<LoggedMotion> motions_of(const PowerLog& log, double least = 0.2);

}  // namespace cotwin::energetics
