#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/engine/wiring/members.h"
#include "master/scenario/scenario.h"
#include "models/collision/cell/placed_cell.h"

/// Where a scenario places robots, bodies and clouds at its start: the one place that asks for it.
namespace cotwin::master {

/// A component with its start values. `models`: as for Settings. Throws what load_member() and apply() throw.
Member member_of(const Scenario& scenario, const std::string& component, std::span<const UnitType> types,
                 const std::vector<std::filesystem::path>& folders, const std::shared_ptr<FileStore>& models = nullptr);

/// The start values of a component's variable: `otherwise` where it has none, none where a connection feeds it.
using StartValues = std::function<std::vector<double>(const std::string& component, const std::string& variable,
                                                      std::vector<double> otherwise)>;
/// As a run has them: of member_of() for each component that is asked for.
StartValues values_of_units(const Scenario& scenario, std::span<const UnitType> types,
                            const std::vector<std::filesystem::path>& folders, const std::shared_ptr<FileStore>& models);
/// As the texts of parameters give them, in the measures in which they stand there: makes no unit.
StartValues values_of_texts(const Scenario& scenario);

/// Of one element.
double start_value(const StartValues& values, const std::string& component, const std::string& variable, double otherwise);

/// The largest one that it has at the start, or by an event.
double largest_value(const Scenario& scenario, const StartValues& values, const std::string& component,
                     const std::string& variable);

struct StartPose {
  Pose X_W;
  bool fed = false;  // by a connection, so that X_W is only where the file has it
};
/// The pose of a body (`prefix` "post."), a base ("left.base_") or a cloud ("cloud.") by its variables p0, quat0 or p, quat; `otherwise` where nobody says
/// more. Throws Error for numbers that are not finite, and for a parameter quat0 whose length is not 1.
StartPose start_pose(const StartValues& values, const std::string& component, const std::string& prefix, const Pose& otherwise);

/// Whether poses differ by more than 0.1 mm, or 0.2 mrad: quaternions are written with four digits.
bool differ(const Pose& a, const Pose& b);

/// What stands elsewhere by another component than by the first one.
class Differing {
 public:
  /// `what`: the same for the same thing; `told`: ", scaled by 2 by world", " in cell.sdf of monitor"; `size`: scale, 0: not there; of a cloud the radius, m.
  void add(const std::string& name, const std::string& what, const Pose& X_W, const std::string& told, double size = 1);
  std::vector<std::string> sentences;

 private:
  std::map<std::string, collision::Place> first_;
};

/// "NAME: x y z roll pitch yaw" in m and rad, the angles and "NAME:" optional, as a name and the pose of a base. Throws Error with `option`.
std::pair<std::string, Pose> read_base(const std::string& text, const std::string& option = "--base");

/// What stands around the robots of a scenario, and the robots, of which a check takes those that it needs.
struct ScenarioCell {
  struct Robot {
    std::string motion;                   // unit:motion that it follows; "": none is known
    std::vector<std::string> components;  // that compute or control it
    bool changed = false;                 // a connection gives it other positions, or some of them only
  };
  collision::PlacedCell cell;          // robots in the order of `robots`, those that a motion moves with its name
  std::vector<Robot> robots;           // of each robot
  std::vector<std::string> notes;      // sentences: what readers warn of, and what does not stand as in the scenario
  std::vector<std::string> differing;  // sentences: what stands in two places by two components
};
/// Whether two robots are in one component, so that neither is a twin of the other.
bool share_component(const ScenarioCell::Robot& a, const ScenarioCell::Robot& b);

struct CellRequest {
  std::vector<std::string> names;                                 // as --clear-of
  std::vector<std::string> watching = {};                         // components whose bodies and clouds count, too
  std::vector<std::string> bases = {};                            // texts for read_base()
  std::vector<std::pair<std::string, std::size_t>> motions = {};  // unit:motion with their numbers of joints
};
/// The cell of a scenario at its start. `names`: components, whose bodies, cloud, `ignore` and `r` count (at most one), and of a scene and a cloud at
/// most one each, as paths (a cloud by its ending) or NAME of scenes/NAME/scene.sdf or scenes/NAME/scene.pcd of the model folders. Bodies are those of a
/// component if their file, links followed, and their name are the same, clouds if their file is; they stand where a contact world, a monitor or a
/// scanner has them, in this order, with their radius, presence and scale, and otherwise as in their file. Robots that nobody places have
/// `by` "". Throws Error.
ScenarioCell cell_of(const Scenario& scenario, const CellRequest& request, std::span<const UnitType> types);
/// The scenes and clouds `names` as in their files, with what their readers warn of.
collision::PlacedCell cell_of(const std::vector<std::string>& names, std::vector<std::string>& notes);

}  // namespace cotwin::master
