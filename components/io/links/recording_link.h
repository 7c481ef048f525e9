#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "components/io/link/link.h"
#include "components/unit/settings.h"
#include "models/trajectory/series/recording.h"

namespace cotwin::io {

/// Plays back measurements of a robot from a CSV file (models/trajectory/series/recording.h). The parameter `start` is the time in the
/// recording that corresponds to time 0 of the scenario.
///   q, q̇, q̈   the interpolating quintic spline (C⁴) through the positions, after a zero-phase low-pass if q_cutoff > 0, and
///             its derivatives;
///             with derivative = columns, q̇ is the spline through the velocity columns and q̈ its derivative
///   τ, τ_e    linear interpolation of the samples, unfiltered unless tau_cutoff > 0
/// After `end` the joints rest and the torques are constant. Commands are ignored. Outputs are functions of time alone, so
/// every step can be undone.
class RecordingLink final : public Link {
 public:
  /// `settings` resolves the path of the file.
  RecordingLink(const Settings& settings, std::vector<trajectory::Axis> axes);

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return true; }

 private:
  /// Everything that determines the loaded data; the file is read again only if one of these values changed.
  struct Source {
    std::filesystem::path file;
    std::filesystem::file_time_type written;
    trajectory::RecordingFormat format;
    double q_cutoff = 0, tau_cutoff = 0;
    std::int32_t filter_order = 0;
    bool velocity_columns = false;
    friend bool operator==(const Source&, const Source&) = default;
  };

  Source source() const;
  void load(const Source& source);
  void choose_part(std::string& warning);
  void measure(double from, double to, Measured& measured);

  Settings settings_;
  std::vector<trajectory::Axis> axes_;

  // Parameters, in the order of declaration.
  std::string file_, topic_, separator_, t_column_, t_unit_ = "s";
  double rate_ = 0;
  std::string q_columns_, dq_columns_, tau_columns_, tau_e_columns_, angle_ = "rad";
  std::vector<double> q_scale_, q_offset_, tau_scale_, tau_e_scale_;
  double max_gap_ = 5, max_speed_ = 0;
  double q_cutoff_ = 0, tau_cutoff_ = 0;
  std::int32_t filter_order_ = 2;
  std::string derivative_ = "position";
  double start_ = 0, end_ = 0;
  std::string limits_ = "warn";

  // Computed from the parameters.
  std::optional<Source> loaded_;
  trajectory::Path q_, dq_;         // dq_ with derivative = columns
  trajectory::Series tau_, tau_e_;  // empty if not recorded
  std::vector<double> instants_;    // of the samples
  double gap_ = 0;                  // s, shortest interval of samples that is a gap
  double last_ = 0;                 // s, time in the recording at which playback ends
  std::string time_warning_;        // warnings about its time stamps
  std::string ended_;               // the warning for the end of the recording
  std::vector<double> scratch_;
};

}  // namespace cotwin::io
