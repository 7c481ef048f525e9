#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/surroundings/surroundings.h"
#include "components/unit/unit.h"
#include "models/collision/cell/cell.h"
#include "models/scene/cell.h"

namespace cotwin::scanner {

using surroundings::Values;

/// A laser scanner that measures profiles of the robots' links, their tools and the bodies of a scene, mostly from a robot's flange (VI-F, Fig. 16c).
/// Its frame S is fixed to a frame F of a robot or of the scene:
///   X_WS = X_WF X_FS      α_i = (i − (N + 1)/2) δ, i = 1 … N, δ = opening/(N − 1)      p_i = p_scan + R(quat_scan) r_i (sin α_i, 0, cos α_i)
/// so the middle of its beams is z, and they are in the plane of x and z.
///
/// A rising edge of `trigger` takes one profile of where everything was at the beginning of that step, at once; so it does not depend on the length of
/// steps. A measured range is d + σ n(0, 1), in whole steps of the resolution, with numbers n that are functions of seed, profile and beam alone. It
/// is 0 where nothing is met up to range_max, where the result is not between range_min and range_max, with the probability `dropout`, and for all
/// beams from inside a body. All bodies reflect alike, at any angle; a beam has no width.
class Scanner final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  /// Throws Error for an unknown frame, and for none where there is not just one robot.
  explicit Scanner(Settings& settings);

  void declare(Variables& v) override;
  /// Throws Error for quaternions whose length is not 1, and unless range_min < range_max.
  void initialise(Time start) override;
  /// Throws Error if an input is not finite, or a quaternion is 0.
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void append_notes(std::vector<std::string>& notes) const override;

 private:
  /// A part that beams may meet.
  struct Target {
    std::size_t part;
    double least;                 // no point of it is nearer to the scanner, m
    Eigen::Vector3d middle, p_B;  // of it from the scanner, in W; the scanner in its frame
    bool around;                  // the scanner is inside a closed mesh of it
  };

  void check_inputs(Time now) const;
  void remember();
  void place_static();
  void place();
  Pose pose() const;
  void find_targets(const Pose& X_WS);
  /// The distance to the first part along d, in W, up to range_max; else infinity. `part`: which one.
  double first_along(const Eigen::Vector3d& d, std::size_t& part) const;
  double measured(double distance, std::size_t beam) const;
  void scan(Time now);

  std::string place_;  // for messages
  scene::Cell given_;
  bool floating_;
  scene::PlacedFrame frame_;
  collision::Cell cell_;  // its first parts are bodies_
  std::vector<surroundings::Body> bodies_;
  std::vector<std::unique_ptr<surroundings::Robot>> robots_;
  std::vector<Target> targets_;
  Values sin_, cos_;  // of the beams

  // Parameters.
  double opening_, range_min_ = 0, range_max_ = 10, sigma_ = 0, resolution_ = 0, dropout_ = 0;
  std::int32_t seed_ = 1;
  Values mount_p_{0, 0, 0}, mount_quat_{1, 0, 0, 0};
  Pose X_FS_;

  bool trigger_ = false, trigger_before_ = false;  // input and state
  Values ranges_, p_scan_{0, 0, 0}, quat_scan_{1, 0, 0, 0};
  double t_scan_ = 0, angle_increment_ = 0;
  std::int32_t count_ = 0;
  double met_ = 0;          // state: beams with a range
  Values inside_{0, 0, 0};  // state: profiles from inside a body; the first one's time, s, and part
};

}  // namespace cotwin::scanner
