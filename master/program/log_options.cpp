#include "master/program/log_options.h"

#include <algorithm>
#include <numbers>

#include "models/foundation/support/choice.h"
#include "models/trajectory/axes.h"
#include "models/trajectory/columns.h"

namespace cotwin::master {

void LogOptions::apply(tuning::Settings& s) const {
  s.format.t_unit = trajectory::seconds_per("--time-unit", time_unit);
  s.format.angle_unit = text::choose<double>("--angle-unit", angle_unit, {{"rad", 1}, {"deg", std::numbers::pi / 180}});
  s.format.q_offset = q_offset_in_angle_unit;
  if (s.format.angle_unit != 1 && !s.format.q_offset.empty()) {
    const std::vector<trajectory::Axis> axes = trajectory::axes_of(tuning::load_robot(s));
    for (std::size_t j = 0; j < std::min(axes.size(), s.format.q_offset.size()); ++j) {
      if (axes[j].revolute) s.format.q_offset[j] *= s.format.angle_unit;
    }
  }
}

void add_log_options(CLI::App& command, LogOptions& a, tuning::Settings& s) {
  const auto in = [](CLI::Option* option, const char* type) {
    option->group("The log");
    if (*type != '\0') option->type_name(type);
    return option;
  };
  in(command.add_option("--cutoff", s.cutoff, "Zero-phase low-pass filter in Hz (default: from the motion)"), "HZ");
  in(command.add_option("--order", s.order, "Order of the filter, per pass"), "N")->capture_default_str();
  in(command.add_option("--margin", s.margin, "Seconds omitted at both ends (default: 1/cutoff)"), "SECONDS");
  in(command.add_option("--q-columns", s.format.q_columns, "Names or pattern of the position columns, e.g. 'pos_{}'"), "NAMES");
  in(command.add_option("--dq-columns", s.format.dq_columns, "For velocities, to check the positions"), "NAMES");
  in(command.add_option("--tau-columns", s.format.tau_columns, "For torques"), "NAMES");
  in(command.add_option("--motor-columns", s.format.theta_columns,
                        "For motor positions behind the gears: friction at the motors' speeds, and joint stiffness"),
     "NAMES");
  in(command.add_option("--topic", s.format.topic, "Topic of a ROS bag (default: the only one with joints)"), "NAME");
  in(command.add_option("--t-column", s.format.t_column, "Name of the time column"), "NAME");
  in(command.add_option("--time-unit", a.time_unit, "s, ms, us or ns"), "")->capture_default_str();
  in(command.add_option("--rate", s.format.rate, "Sampling rate, if there is no time column"), "HZ");
  in(command.add_option("--angle-unit", a.angle_unit, "rad or deg"), "")->capture_default_str();
  in(command.add_option("--q-scale", s.format.q_scale, "Per joint: sign or gear ratio of the positions")->delimiter(','),
     "X,…");
  in(command
         .add_option("--q-offset", a.q_offset_in_angle_unit,
                     "Per joint: offset added to the positions, in --angle-unit; prismatic joints in m")
         ->delimiter(','),
     "X,…");
  in(command.add_option("--tau-scale", s.format.tau_scale, "Per joint: sign, gear ratio or torque constant of the torques")
         ->delimiter(','),
     "X,…");
  in(command.add_option("--max-gap", s.format.max_gap, "Time steps longer than N medians are gaps"), "N")
      ->capture_default_str();
  in(command.add_option("--skip-rows", s.skip_rows,
                        "Share of rows that may be left out as unreadable, not finite, out of order or too fast; 0: none"),
     "SHARE")
      ->capture_default_str();
  in(command.add_flag("--accept-data", s.accept_data, "Implausible data give a warning instead of an error"), "");
}

}  // namespace cotwin::master
