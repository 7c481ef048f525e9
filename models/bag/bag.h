#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

/// ROS 2 bags as tables: MCAP and SQLite files of rosbag2, or a folder of them with its metadata.yaml.
///
/// A row is a message of one topic, in the order of the log's time. Column "t": seconds since the first message, by the stamps of the messages'
/// headers, or by the log's time where a stamp is 0. Of a sensor_msgs/JointState, joints by name, in any order and number per message: position_NAME, velocity_NAME,
/// effort_NAME. Of other types all numbers: force.x, data[3] (from 0). Bytes are taken as the type's definition in the file says, or
/// a built-in one (WrenchStamped, Float64, Float64MultiArray). Splits of a folder are read one after the other.
namespace cotwin::bag {

struct TopicInfo {
  std::string name, type;
  std::int64_t messages = 0;
  double duration = 0;              // s, by the log's time
  std::vector<std::string> joints;  // of JointStates
  std::string trouble;              // why it cannot be read; "": it can
};

/// The topics of a bag, by name. Throws Error as csv::open().
std::vector<TopicInfo> topics_of(const std::filesystem::path& bag);

/// From now on csv::open() opens bags.
void start();

}  // namespace cotwin::bag
