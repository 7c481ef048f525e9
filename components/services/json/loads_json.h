#pragma once
#include <Eigen/Core>

#include "components/services/json/move_json.h"

/// What a robot carries and what pushes it, in requests, for the sources of this folder.
namespace cotwin::services {

/// The members "p_m" and "quaternion_wxyz".
Pose read_pose(Reader& r, const char* what);
/// The members "mass_kg", "com_m" and "inertia_kg_m2", which a point mass may leave out. Numbers are below 1e15, and the inertia may be unphysical.
Inertia read_inertia(Reader& r, bool may_be_point, const char* of_mass, const char* of_com);
/// A member with N numbers below 1e15; 0 where it is optional and not given.
template <int N>
Eigen::Matrix<double, N, 1> read_vector(Reader& r, const char* name, bool optional, const char* what) {
  const std::vector<double> x = r.vector(name, N, optional, what);
  Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
  if (!x.empty()) v = Eigen::Map<const Eigen::Matrix<double, N, 1>>(x.data());
  if (!(v.cwiseAbs().maxCoeff() < 1e15))
    throw RequestError(r.pointer(name), "has numbers of 1e15 and more, expected smaller ones");
  return v;
}
/// One shape, a box with these edges about a place.
std::vector<scene::Shape> box_of(Reader& r, const std::vector<double>& edges, const Pose& X_BA);

/// The members "from_share" and "to_share".
robot::Interval read_interval(Reader& r);

/// The members "payload", and with `takes.wrench` "wrench", as loads of the move; shapes of payloads become `m.carried`.
void read_loads(const Robot& robot, Reader& r, const Context& context, const Takes& takes, MoveRequest& m);

}  // namespace cotwin::services
