#pragma once
#include <cmath>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

/// Scenes with a closed form, for any engine, step and size. No engine appears here. Numbers are SI; z is up.
namespace cotwin::testing {

/// The same scene with all lengths times `scale` at the same density and gravity: masses follow with the third power, forces as weights, times and
/// speeds with the square root. An engine without constants of its own gives the same motion, if the step is scaled as times.
scene::Scene scaled(scene::Scene scene, double scale);

/// A run that a closed form watches. All values are those of the unscaled scene.
struct Motion {
  std::span<const Pose> start, X_WB;
  std::span<const Twist> V_WB;
  double t = 0;  // s
};

/// A step, and the size of the scene.
struct Setting {
  double h = 1e-3;  // s
  double scale = 1;
  /// The step that gives the same motion at the size 1, s.
  double unscaled_h() const { return h / std::sqrt(scale); }
};
inline constexpr Setting kSettings[] = {{1e-3, 1}, {1e-4, 1}, {4e-3, 1}, {1e-3, 0.01}, {1e-3, 100}};

/// A scene, and a figure of which the closed form is known.
struct ClosedForm {
  std::string scene, figure, unit, exact;  // `exact`: what theory says
  double least = 0, most = 0;              // of the figure, where it is right
  double duration = 0;                     // s, of the unscaled scene
  bool second_order =
      false;  // `most` is that of steps up to 1 ms of the unscaled scene; it grows with the square of longer ones
  scene::Scene (*make)() = nullptr;
  Wrench (*load)(std::size_t body) = nullptr;                                              // on each body, constant; null: none
  double (*value)(const scene::Scene& scene, const Motion& now, double so_far) = nullptr;  // after each step; starts with 0
  bool is_right(double value, const Setting& setting) const;
};

std::vector<ClosedForm> closed_forms();

}  // namespace cotwin::testing
