#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/variables.h"
#include "models/trajectory/series/recording.h"
#include "models/trajectory/waypoints.h"

/// Sources of a desired motion: each declares its parameters and makes a path from their values.
namespace cotwin::motion {

/// Declares the settings of all sources.
void declare_source_settings(SettingList& s);

/// Waypoints from parameters or a file, with rests or passed through; with redundant coefficients for each leg.
class WaypointSource {
 public:
  WaypointSource(Settings& settings, std::vector<trajectory::Axis> axes);
  void declare(Variables& v, JointVariables& joints);
  trajectory::Path path();

 private:
  trajectory::Waypoints points() const;

  Settings settings_;
  std::vector<trajectory::Axis> axes_;
  int degree_;
  std::string file_, angle_ = "rad", q_columns_, passing_ = "rest";
  std::vector<double> t_, q_, dwell_, c_r_;
};

/// One polynomial with boundary conditions at both ends and redundant coefficients.
class PolynomialSource {
 public:
  PolynomialSource(Settings& settings, std::vector<trajectory::Axis> axes);
  void declare(Variables& v, JointVariables& joints);
  trajectory::Path path();

 private:
  struct End {
    std::vector<double> q, dq, ddq, dddq;  // n
  };

  std::size_t n_;
  bool jerk_;
  int degree_;
  double T_ = 1;
  End start_, end_;
  std::vector<double> c_r_;
};

/// A recorded motion: a spline through its samples, optionally after a zero-phase low-pass filter.
class RecordingSource {
 public:
  RecordingSource(Settings& settings, std::vector<trajectory::Axis> axes);
  void declare(Variables& v, JointVariables& joints);
  trajectory::Path path();
  /// Warnings about the file of the last path() call.
  const std::string& warning() const { return warning_; }

 private:
  /// Everything that determines the loaded data; the file is read again only if one of these values changed.
  struct Source {
    std::filesystem::path file;
    std::filesystem::file_time_type written;
    trajectory::RecordingFormat format;
    double cutoff = 0;
    std::int32_t filter_order = 0;
    friend bool operator==(const Source&, const Source&) = default;
  };
  Source source() const;

  Settings settings_;
  std::vector<trajectory::Axis> axes_;
  std::string file_, topic_, t_column_, t_unit_ = "s", q_columns_, angle_ = "rad";
  double rate_ = 0, max_gap_ = 5, max_speed_ = 0, cutoff_ = 0, begin_ = 0, end_ = 0;
  std::int32_t filter_order_ = 2;
  std::optional<Source> loaded_;
  trajectory::Path whole_;
  std::string warning_;
};

using AnySource = std::variant<WaypointSource, PolynomialSource, RecordingSource>;

}  // namespace cotwin::motion
