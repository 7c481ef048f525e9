#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/variables.h"
#include "models/trajectory/recording.h"
#include "models/trajectory/waypoints.h"

/// Where a desired motion comes from: each kind declares its parameters, and makes a path of their values.
namespace cotwin::motion {

/// The settings of all kinds.
void declare_source_settings(SettingList& s);

/// Waypoints, from parameters or a file; rest to rest or through them; with redundant coefficients for each leg.
class WaypointSource {
 public:
  WaypointSource(Settings& settings, std::vector<trajectory::Axis> axes);
  void declare(Variables& v);
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
  void declare(Variables& v);
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

/// A recorded motion: the spline through its samples, after a zero-phase low-pass where wanted.
class RecordingSource {
 public:
  RecordingSource(Settings& settings, std::vector<trajectory::Axis> axes);
  void declare(Variables& v);
  trajectory::Path path();
  /// What the user should know of the file after path().
  const std::string& doubt() const { return doubt_; }

 private:
  /// All that decides what is loaded; the file is read again only if one of them changed.
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
  std::string file_, t_column_, t_unit_ = "s", q_columns_, angle_ = "rad";
  double rate_ = 0, max_gap_ = 5, max_speed_ = 0, cutoff_ = 0, begin_ = 0, end_ = 0;
  std::int32_t filter_order_ = 2;
  std::optional<Source> loaded_;
  trajectory::Path whole_;
  std::string doubt_;
};

using AnySource = std::variant<WaypointSource, PolynomialSource, RecordingSource>;

}  // namespace cotwin::motion
