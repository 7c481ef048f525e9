#include "master/workflows/starter/make.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "components/services/robots.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "fmu/archive/archive.h"
#include "master/scenario/folders.h"
#include "master/workflows/starter/contact.h"
#include "master/workflows/starter/trial.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/units.h"
#include "models/scene/urdf/urdf_in_si.h"

namespace cotwin::master::starter {

namespace {

namespace fs = std::filesystem;

class Search {
 public:
  Search(const Request& request, std::span<const UnitType> types) : request_(request), types_(types) {}

  Starter make() {
    if (!request_.end_effector.empty() && request_.kind != Kind::kContact)
      throw Error("--end-effector " + request_.end_effector, "is of --kind contact, expected that kind or no end-effector");
    prepare();
    read();
    if (request_.kind == Kind::kContact) {
      make_contact_scenario();
    } else {
      result_.sketch = make_sketch(result_.model, request_.kind, drives_);
      try_it();
    }
    // Lines of the URDF that is written, not of the one for the trial.
    for (std::string& note : notes_)
      if (!result_.converted.empty() && note.starts_with(setting_)) note = "robot.urdf" + note.substr(setting_.size());
    Sketch& sketch = result_.sketch;
    notes_.insert(notes_.begin(), converted_.begin(), converted_.end());
    sketch.notes.insert(sketch.notes.begin(), notes_.begin(), notes_.end());
    std::error_code none;
    sketch.energy_assumed =
        sketch.assumed && !fs::is_regular_file(urdf_of(request_.robot).parent_path() / services::kEnergyFile, none);
    if (sketch.energy_assumed)
      sketch.notes.emplace_back(
          "drive_train.ssv and energy.ssv are all assumed; cotwin ask reads them beside the URDF, if they are copied there");
    return std::move(result_);
  }

 private:
  void prepare() {
    result_.lock = request_.lock;
    result_.unphysical = request_.unphysical;
    setting_ = request_.robot;
    if (request_.units.empty()) return;
    const robot::UrdfUnits units = robot::parse_urdf_units(request_.units, "--urdf-units");
    const fs::path file = urdf_of(request_.robot);
    result_.converted = scene::urdf_in_si(file, units, &converted_);
    robot::check_units(result_.converted, file.string(), units);
    setting_ = (folder_.path() / "robot.urdf").string();
    write_file(setting_, result_.converted);
    // What is known of the robot goes with it; compliance.ssv is the scenario's own.
    for (const char* name : {services::kDrivesFile, services::kEnergyFile}) {
      const fs::path known = file.parent_path() / name;
      std::error_code none;
      if (!fs::is_regular_file(known, none)) continue;
      result_.companions.push_back({name, text::read_file(known, "parameters of a robot", 16'000'000)});
      write_file(folder_.path() / name, result_.companions.back().text);
    }
  }

  Settings settings() const {
    Settings settings("drive_train", "", {{"robot", setting_}, {"lock", result_.lock}, {"unphysical", result_.unphysical}},
                      model_folders({}));
    settings.declare(settings_of(find_type("drive_train", types_)));
    return settings;
  }

  /// The robot, its drives if files beside it have them, and warnings of the reader as notes.
  void read() {
    Settings first = settings();
    result_.model = first.robot();
    std::string stuck;
    for (const robot::Joint& joint : result_.model.joints) {
      if (joint.q_min == joint.q_max) text::append(stuck, joint.name + ":" + text::to_text(joint.q_min), ",");
    }
    notes_ = first.warnings();
    if (!stuck.empty()) {
      text::append(result_.lock, stuck, ",");
      Settings again = settings();
      result_.model = again.robot();
      notes_ = again.warnings();
      notes_.push_back("joints whose lower and upper limit are the same are locked: " + stuck);
    }
    result_.robot = result_.model.name;
    if (result_.model.n() == 0) return;
    Settings known = settings();
    const Instance drive = make_unit(known, types_);
    if (drive.given.empty()) return;
    const auto values = [&](const char* name) {
      const std::span<double> reals = drive.variables.at(name).reals();
      return std::vector<double>(reals.begin(), reals.end());
    };
    drives_ = Drives{values("K"), values("D"), values("B"), values("sigma2"), values("tau_C"), {}, 0};
  }

  fs::path write() const {
    const fs::path place = folder_.path() / "trial";
    make_folder(place);
    for (const File& file : result_.files("trial", setting_)) write_file(place / file.name, file.text);
    return place / "twin.ssd";
  }
  void try_it() const { try_scenario(write(), result_.sketch, result_.model, types_); }

  /// With the shapes of the links, unless they touch one another or something else at the start.
  void try_contact() {
    const std::optional<std::string> touching = touching_at_start(write(), result_.model, types_);
    std::string why = touching.value_or("");
    if (!touching) {
      try {
        try_it();
        return;
      } catch (const Error& error) {
        why = error.what();
      }
    }
    result_.sketch.robot_shapes = false;
    try_it();
    result_.sketch.notes.push_back(
        "only the probe touches the plate (robot_shapes=none in twin.ssd), because with the shapes of the links " + why);
  }

  /// The flange, and the ends of other chains, if the user gave no frame.
  std::vector<robot::Frame> ends() const {
    const robot::RobotModel& robot = result_.model;
    if (!request_.end_effector.empty()) return {robot.frame(request_.end_effector)};
    constexpr std::size_t kMostEnds = 6;
    std::vector<robot::Frame> all = {flange(robot)};
    for (int body = 0; body < robot.body_count() && all.size() < kMostEnds; ++body) {
      bool is_last = true;
      for (int other = 0; other < robot.body_count(); ++other) is_last = is_last && robot.joint_of(other).parent != body;
      if (!is_last || body == robot.end_effector().body) continue;
      const auto last =
          std::find_if(robot.frames.rbegin(), robot.frames.rend(), [&](const robot::Frame& f) { return f.body == body; });
      if (last != robot.frames.rend()) all.push_back(*last);
    }
    return all;
  }

  /// Tries presses of a probe at a frame until one runs. Returns "" then, otherwise why the first did not.
  std::string try_presses(const robot::Frame& end) {
    std::string first;
    bool tried = false;
    try {
      ContactPlanner planner(result_.model, end);
      constexpr int kMostTrials = 6;
      int trials = 0;
      for (const double scale : kPressScales) {
        for (int direction = 0; direction < kPressDirections; ++direction) {
          for (int posture = 0; posture < kPressPostures && trials < kMostTrials; ++posture) {
            try {
              std::optional<Sketch> sketch = make_contact(result_.model, planner, {posture, direction, scale}, drives_);
              if (!sketch) continue;
              result_.sketch = *std::move(sketch);
              ++trials;
              try_contact();
              return "";
            } catch (const Error& error) {
              if (first.empty() || (trials == 1 && !tried)) first = error.what();
              tried = trials > 0;
            }
          }
        }
      }
    } catch (const Error& error) {
      return error.what();
    }
    return first.empty() ? "robot '" + result_.model.name + "', frame '" + end.name + "': it does not move well" : first;
  }

  void make_contact_scenario() {
    const robot::RobotModel& robot = result_.model;
    check_robot(robot);
    const std::vector<robot::Frame> all = ends();
    std::string first;
    for (const robot::Frame& end : all) {
      const std::string why = try_presses(end);
      if (first.empty()) first = why;
      if (!why.empty()) continue;
      const std::string mounted = "the probe is mounted at '" + end.name + "', not at ";
      if (!first.empty()) {
        result_.sketch.notes.push_back(mounted + "'" + all.front().name + "' (--end-effector LINK): " + first);
      } else if (request_.end_effector.empty() && end.name != robot.end_effector().name) {
        result_.sketch.notes.push_back(mounted + "the finger '" + robot.end_effector().name + "' (--end-effector LINK)");
      }
      return;
    }
    throw Error("no contact of robot '" + robot.name + "' was found that runs as promised",
                "the first that was tried: " + first + ", expected --end-effector LINK, or --kind motion or compliance");
  }

  const Request& request_;
  std::span<const UnitType> types_;
  fmu::TemporaryFolder folder_;
  std::string setting_;  // of the robot, for the trial
  std::optional<Drives> drives_;
  std::vector<std::string> converted_;  // notes of the units
  std::vector<std::string> notes_;
  Starter result_;
};

constexpr const char* kUnits = "--urdf-units ";

/// The line with the options that cure an error, or why those that were tried do not; "" for an error that has no option. Units other than SI are a guess that a trial cannot
/// confirm: a robot a thousand times as large may run as well.
std::string advice(const Request& request, const std::string& options, const Error& error, std::span<const UnitType> types) {
  Request other = request;
  std::string option;
  if (const auto* units = dynamic_cast<const robot::OtherUnits*>(&error);
      units != nullptr && !units->units.empty() && request.units.empty()) {
    other.units = units->units;
    option = kUnits + units->units;
  } else if (dynamic_cast<const robot::UnphysicalValue*>(&error) != nullptr) {
    other.unphysical = "estimate";
    option = "--unphysical estimate";
  } else {
    return "";
  }
  const std::string all = options + (options.empty() ? "" : " ") + option;
  const bool guesses_units = all.starts_with(kUnits) || all.find(" " + std::string(kUnits)) != std::string::npos;
  try {
    const Starter made = Search(other, types).make();
    if (std::ranges::any_of(made.sketch.notes, [](const std::string& note) { return note.ends_with("; ignored"); })) return "";
    if (!guesses_units) return "\nit runs with: " + all;
    return "\nif its numbers are in these units it runs with: " + all + "; if they are in SI: " + std::string(kUnits) + "si";
  } catch (const Error& next) {
    const std::string more = advice(other, all, next, types);
    if (!more.empty()) return more;
    const bool same = std::string(next.what()) == error.what();  // a fault of another kind
    return same ? "" : "\nwith " + all + ": " + next.what();
  }
}

}  // namespace

std::vector<File> Starter::files(const std::string& scenario, const std::string& robot_setting) const {
  std::vector<File> all = files_of(sketch, model, {scenario, robot_setting, lock, unphysical});
  if (!converted.empty()) all.push_back({"robot.urdf", converted});
  all.insert(all.end(), companions.begin(), companions.end());
  return all;
}

Starter make_starter(const Request& request, std::span<const UnitType> types) {
  try {
    return Search(request, types).make();
  } catch (const Error& error) {
    throw Error(error.what() + advice(request, "", error, types));
  }
}

}  // namespace cotwin::master::starter
