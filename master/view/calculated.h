#pragma once
#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "master/scenery/recorded.h"
#include "models/robot/robot_model.h"

/// What a page shows beside the recording: ellipsoids of a robot's tip along the recorded motion.
namespace cotwin::master {

/// A symmetric matrix of the tip in the axes of the robot's base, as xx, xy, xz, yy, yz, zz over the rows.
using MatrixOverTime = std::array<std::vector<double>, 6>;

/// The rows of a recording for which ellipsoids are calculated: about `per_second` a second, at most `most`, the first and the last among them.
std::vector<std::size_t> chosen_rows(const Recorded& recorded, double per_second, std::size_t most);

/// Stiffness of a controller at one row of the recording: of the joints (n, N.m/rad) or of the frame itself.
struct Compliant {
  std::optional<std::array<double, 3>> frame;  // N/m, along the axes
  bool in_tool = false;                        // the axes are those of the tip, otherwise of the base
  std::vector<double> joints;                  // n; used if `frame` is empty
};

struct TipMatrices {
  std::optional<MatrixOverTime> mobility;   // Λ_v⁻¹, 1/kg; none if a body has no physical mass
  MatrixOverTime velocity;                  // J_v J_vᵀ: half-axes squared of velocities for joint speeds of norm 1
  std::optional<MatrixOverTime> stiffness;  // N/m; of joints (J_v S⁻¹ J_vᵀ)⁻¹
};

/// `q`: signal of n elements. Positions that are not finite are those of the row before. `compliant`: the stiffness in a row, if one is known.
/// `floating`: the base, which must have a physical mass, recoils: Λ_v⁻¹ of the whole and the generalised Jacobian.
TipMatrices tip_matrices(const robot::RobotModel& robot, const Recorded& recorded, const RecordedSignal& q,
                         const std::vector<std::size_t>& rows,
                         const std::function<std::optional<Compliant>(std::size_t)>& compliant, bool floating = false);

}  // namespace cotwin::master
