#pragma once
#include <memory>
#include <vector>

#include "components/io/link/link.h"
#include "components/unit/settings.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// The interface between the twin and its robot. The ports (Measured and Command) are the same for a robot, an emulated robot
/// and a recording. Links: `recording` (recording_link.h), `sensors` of an emulated robot (sensor_link.h), `fri` of a KUKA robot
/// (fri_link.h), `rtde` of a Universal Robots arm (rtde_link.h), and the robot's sides of both, `fri_controller` (fri_controller_link.h) and
/// `rtde_controller` (rtde_controller_link.h), whose ports are the other way round.
class Io final : public Unit {
 public:
  /// Declares the settings of the unit.
  static void declare_settings(SettingList& s);
  explicit Io(Settings& settings);

  void declare(Variables& v) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  bool restorable() const override { return link_->restorable(); }
  TickSource* tick_source() override { return link_->tick_source(); }
  void append_notes(std::vector<std::string>& sentences) const override { link_->append_notes(sentences); }
  void end() noexcept override { link_->end(); }

 private:
  Io(std::vector<trajectory::Axis> joints, Settings& settings);

  JointMeasures measures_;
  Measured measured_;
  Command command_;
  std::unique_ptr<Link> link_;
};

}  // namespace cotwin::io
