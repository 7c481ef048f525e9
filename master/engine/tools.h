#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/time.h"
#include "master/engine/events.h"
#include "master/engine/wiring/members.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/changes/history.h"

namespace cotwin::robot {
class Mechanism;
class Data;
}  // namespace cotwin::robot

/// Tools that come and go during a run (IV-A2).
namespace cotwin::master {

/// The tool of an attach event.
robot::Attachment attachment(const ToolSpec& tool);

/// The joint of the robot whose torque g, which holds it at rest against gravity, exceeds its limit by the largest factor; −1 if
/// none does. Allocates nothing.
int overloaded_joint(const robot::RobotModel& robot, const Eigen::VectorXd& g);
/// "joint 'a2' needs 210 N.m against gravity, more than its limit of 176 N.m" for this joint; "" without one.
std::string describe_overload(const robot::RobotModel& robot, const Eigen::VectorXd& g);

/// Turns the attach and detach events of a scenario into values of the bodies' tunables of every component that has the robot.
/// A component's variables decide what a tool does to it:
///   mass, first_moment, inertia with tool_changes   it simulates the robot: its bodies change at once, at constant speeds
///   mass, first_moment, inertia                     a controller: it follows; a tool with known=false does not reach it
///   tool.NAME without bodies                        it watches the robot: the shapes of the tool come and go
///   tool_mass, tool_first_moment, tool_inertia      an estimator gets what known tools add to its bodies; an unknown one
///                                                   increases `restart`
/// In a world of several robots these names have the robot's prefix. A component whose bodies are fed by connections follows
/// those. The composite bodies are those of robot::attach() and robot::detach(), on the bodies that the component has at the
/// start.
class Tools {
 public:
  /// Makes a dry run of all events. Throws Error at the event's place if no component or several robots are meant, and for
  /// whatever attach() and detach() do not permit. With `report`, calls it with each such error instead.
  Tools(const Scenario& scenario, std::span<const Member> members, std::span<const Signal> fed,
        const Events::Report& report = nullptr);
  ~Tools();
  Tools(Tools&&) noexcept;
  Tools& operator=(Tools&&) noexcept;

  /// Plans the events again for the bodies that the components have now. The number and order of the jumps do not change.
  void plan();
  std::span<const Events::Jump> jumps() const { return jumps_; }

  /// Compares the torques that hold a simulated robot against gravity in its present pose with the joints' limits, after an
  /// event before or at `now`. Call after Events::apply. Allocates nothing.
  void check_load(Time now) {
    if (next_check_ < checks_.size() && checks_[next_check_].time <= now) check_loads_due(now);
  }
  /// Sentences on joints that cannot carry a tool, of the run so far.
  std::vector<std::string> warnings() const;
  /// Which components each tool reaches, one sentence a tool; empty without tools.
  std::vector<std::string> notes() const;

  /// The robots with their histories of the events before `end`; robots without such events are left out, and components with
  /// the same history share one entry.
  std::vector<robot::RobotHistory> histories(Time end) const;

 private:
  struct Carrier;
  /// The load on a simulated robot after an event.
  struct Check {
    Time time;
    std::size_t carrier = 0, tool = 0;  // of carriers_, scenario_->tools
    std::unique_ptr<robot::Mechanism> mechanism;
    std::unique_ptr<robot::Data> data;
    Eigen::VectorXd gravity;  // N.m or N
    bool overloaded = false;
    double seconds = 0;  // at which it was checked
  };

  void find_carriers(std::span<const Member> members, std::span<const Signal> fed);
  void find_watchers(std::span<const Member> members);
  void find_models();
  void check_events(const Events::Report& report) const;
  std::vector<std::size_t> named(const ToolSpec& tool) const;
  std::vector<std::size_t> reached(const ToolSpec& tool) const;
  std::vector<std::size_t> carrying(const ToolSpec& tool) const;
  void choose(const Events::Report& report);
  void begin_all();
  void change(Carrier& carrier, std::size_t tool) const;
  void check_loads_due(Time now);

  struct Watcher {
    const Variable* shapes;          // tool.NAME, 1 while they are there
    std::string label, robot, tool;  // "monitor.left", "left", the tool's identifier
  };

  const Scenario* scenario_;
  std::vector<Watcher> watchers_;
  std::vector<std::unique_ptr<Carrier>> carriers_;
  std::vector<std::vector<std::size_t>> reached_;  // carriers that each event changes
  std::vector<Events::Jump> jumps_;
  std::vector<Check> checks_;  // by time
  std::size_t next_check_ = 0;
};

}  // namespace cotwin::master
