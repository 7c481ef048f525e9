#pragma once
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "models/robot/coupled_dynamics.h"
#include "models/robot/dynamics.h"
#include "models/robot/kernels/kernels.h"

/// A robot as constants of the kernels: what Mechanism holds.
namespace cotwin::robot {

/// Numbers per joint are stored in multiples of eight.
inline int padded(int n) { return (n + 7) / 8 * 8; }

inline void store(const Eigen::Matrix3d& R, double* to) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) to[3 * r + c] = R(r, c);
}

inline void store(const Eigen::Vector3d& v, double* to) {
  for (int i = 0; i < 3; ++i) to[i] = v[i];
}

/// Mass, first and second moments ∫ r rᵀ dm about the origin of L. Torques are linear in them, and they add for composite
/// bodies.
struct Moments {
  double m = 0;
  Eigen::Vector3d h = Eigen::Vector3d::Zero();
  Eigen::Matrix3d S = Eigen::Matrix3d::Zero();
};

struct Mechanism::Impl {
  KernelModel model{};
  std::vector<KernelLink> links;
  std::vector<double> theta_0, c_alpha, s_alpha;  // padded
  std::vector<Pose> X_PL;                         // at q = 0, without theta_0
  std::vector<Pose> X_LJ;
  std::vector<Moments> moments;
  std::vector<double> zeros;  // n
  Pose X_BP;                  // the first link's P of a chain
  std::vector<KernelTreeLink> tree;
  std::vector<double> tree_inertia;
  const Kernels* kernels = nullptr;
  int dofs = 0;                        // independent joints; the kernels have those of the mimics as well
  std::unique_ptr<Coupling> coupling;  // nullptr without mimics
  std::vector<int> body;               // of the RobotModel, by the kernels' joint

  Impl(const RobotModel& robot, const char* isa);
  void update(const RobotModel& robot);

 private:
  void align_chain();
  void order_tree();
  void update_tree();
};

}  // namespace cotwin::robot
