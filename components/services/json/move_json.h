#pragma once
#include "components/services/json/request.h"
#include "components/services/robots.h"
#include "components/services/services.h"
#include "models/collision/meeting/meeting.h"
#include "models/trajectory/series/series.h"

/// Moves in requests and joints in replies, for the sources of this folder.
namespace cotwin::services {

/// How much a reply tells.
enum class Detail { kVerdict, kMargins, kSeries, kAll };

/// Members that end with a unit of measure of the robot's joints: "from_q" + "_rad". A robot with prismatic joints has no common one:
/// its members have no suffix, and values are in m, m/s, … and N for those joints.
class JointUnits {
 public:
  explicit JointUnits(const robot::RobotModel& robot);
  bool all_revolute() const { return all_revolute_; }
  /// "rad", "rad_per_s", "rad_per_s2", "rad_per_s3", "Nm" of a revolute joint; "m" … "N" of a prismatic one; `order`: of the derivative
  /// of q, 4: torque.
  const char* of(std::size_t joint, int order) const;
  /// The name with the suffix of all joints: "c_r_rad", "c_r".
  std::string name(const std::string& plain, int order) const;
  /// Values per joint: "from_q_rad" or "from_q"; positions also "from_q_deg". Empty if optional and not given.
  std::vector<double> read(Reader& r, const std::string& plain, int order, bool optional, const char* what) const;
  /// The same, where null means no bound: `none`.
  std::vector<double> read_bounds(Reader& r, const std::string& plain, int order, double none, const char* what) const;

 private:
  const Json* member(Reader& r, const std::string& plain, int order, std::string& found) const;

  const robot::RobotModel& robot_;
  bool all_revolute_ = true;
};

/// What a service takes beside a move from rest to rest in a duration that is given or searched.
struct Takes {
  bool duration = true;    // T_s
  bool in_motion = false;  // velocities and accelerations at the ends
  bool paths = false;      // waypoints or a series in place of the move
  bool wrench = true;      // beside payloads
  bool intervals = true;   // of payloads and wrench
  bool start = true;       // from_q has to be given
};

inline constexpr Takes kAnyMotion{.in_motion = true, .paths = true};

/// A move with what only its request knows.
struct MoveRequest : Move {
  std::vector<collision::Tool> carried;  // shapes of payloads; `from` and `until` are shares of the motion
  std::vector<std::string> notes;
};

/// The members of a motion of any kind from rest to rest: ends, bounds, drives and loads. Without `posture` the end may be left out, and is empty.
MoveRequest read_goal(const Robot& robot, Reader& r, const Context& context, const Takes& takes, bool posture);
double read_duration(Reader& r);
/// The members of a move, or of a path in place of it. A reader that describes takes a robot without joints.
MoveRequest read_move(const Robot& robot, Reader& r, const Context& context, const Takes& takes);
Detail read_detail(Reader& r);
/// A motion of any kind, {"t_s": […], "q_rad": [[…], …], "cutoff_Hz"}, one row per time, without gaps. `notes`: a sentence where its accelerations
/// rest on noise.
trajectory::Path read_series(const Robot& robot, Reader& r, std::vector<std::string>* notes = nullptr);
/// Adds texts to the member "notes" of a reply, which only exists where there are notes.
void add_notes(Json& reply, const std::vector<std::string>& notes);
/// The member "bus": "shared", "none" or "grid".
energetics::Bus read_bus(Reader& r, const char* what);

/// [{"joint", "q_rad": {"value", "limit", "share", "t_s"}, …}] of each joint; bounds that there are none have no "limit" and "share".
Json peaks_of(const robot::RobotModel& robot, const std::vector<optimisation::Peak>& peaks);
/// The peak that uses most of its bound; null without bounds.
Json limiting_of(const robot::RobotModel& robot, const std::vector<optimisation::Peak>& peaks);
/// Parameters with which unit:motion runs the move unchanged: {"unit": "unit:motion?kind=polynomial&degree=9", "T_s", "q_start_rad", …}.
Json motion_of(const Robot& robot, const Move& move, double T);

}  // namespace cotwin::services
