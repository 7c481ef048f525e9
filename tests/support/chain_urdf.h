#pragma once
#include <string>

namespace cotwin::testing {

/// A URDF of a chain of revolute joints with the axes z, y, z, y … on links of 0.1 m and 0.5 kg, strong enough to hold itself.
inline std::string chain_urdf(int joints) {
  std::string xml = R"(<robot name="chain"><link name="link_0"/>)";
  for (int i = 1; i <= joints; ++i) {
    const std::string number = std::to_string(i);
    xml +=
        R"(<joint name="joint_)" + number + R"(" type="revolute"><parent link="link_)" + std::to_string(i - 1) +
        R"("/><child link="link_)" + number + R"("/><origin xyz="0 0 0.1"/><axis xyz=")" + (i % 2 == 1 ? "0 0 1" : "0 1 0") +
        R"("/><limit lower="-3" upper="3" velocity="3" effort="500"/></joint><link name="link_)" + number +
        R"("><inertial><origin xyz="0 0 0.05"/><mass value="0.5"/><inertia ixx="0.001" iyy="0.001" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>)";
  }
  return xml + "</robot>";
}

}  // namespace cotwin::testing
