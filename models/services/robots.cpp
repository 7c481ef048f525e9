#include "models/services/robots.h"

#include <algorithm>
#include <cmath>
#include <system_error>

#include "models/robot/urdf/urdf.h"
#include "models/support/error.h"
#include "models/support/parameter_set.h"
#include "models/support/text.h"

namespace cotwin::services {

namespace fs = std::filesystem;

namespace {

constexpr double kLargest = 1e12;

[[noreturn]] void fail(const ParameterValue& v, const std::string& what) { throw Error(v.place + ": " + v.name, what); }

std::vector<double> numbers_of(const ParameterValue& v) {
  if (const double* x = std::get_if<double>(&v.value)) return {*x};
  if (const std::int64_t* x = std::get_if<std::int64_t>(&v.value)) return {static_cast<double>(*x)};
  const std::string* list = std::get_if<std::string>(&v.value);
  if (!list) fail(v, "is a boolean, expected numbers");
  std::string blanks = *list;
  std::ranges::replace_if(
      blanks, [](char c) { return c == '\n' || c == '\t' || c == '\r'; }, ' ');
  std::vector<double> all;
  for (const std::string_view part : text::split(blanks, ' ')) {
    if (text::trim(part).empty()) continue;
    const auto x = text::parse_real(text::trim(part));
    if (!x) fail(v, "has '" + std::string(part) + "', expected numbers separated by blanks");
    all.push_back(*x);
  }
  return all;
}

/// Sets the vector, all values or the element "name[k]". A single number holds for all.
void take(const ParameterValue& v, std::vector<double>& values, double min, double max) {
  const std::vector<double> given = numbers_of(v);
  for (const double x : given)
    if (!(x >= min && x <= max && std::isfinite(x)))
      fail(v, "is " + text::to_text(x) + ", expected " + text::to_text(min) + " to " + text::to_text(max));
  if (const std::size_t bracket = v.name.find('['); bracket != std::string::npos) {
    const auto k = text::parse_integer(std::string_view(v.name).substr(bracket + 1, v.name.size() - bracket - 2));
    if (!k || *k < 1 || static_cast<std::size_t>(*k) > values.size() || given.size() != 1)
      fail(v, "expected one number for an element from 1 to " + std::to_string(values.size()));
    values[static_cast<std::size_t>(*k - 1)] = given[0];
    return;
  }
  if (given.size() == 1) {
    std::ranges::fill(values, given[0]);
  } else if (given.size() == values.size()) {
    values = given;
  } else {
    fail(v, "has " + std::to_string(given.size()) + " values, expected one or " + std::to_string(values.size()));
  }
}

std::string vector_name(const ParameterValue& v) { return v.name.substr(0, v.name.find('[')); }

template <class Struct, class Table>
bool take_row(const ParameterValue& v, const Table& table, Struct& values) {
  const std::string name = vector_name(v);
  for (const auto& row : table) {
    if (name != row.name) continue;
    take(v, values.*row.values, row.min, row.max);
    return true;
  }
  return false;
}

/// Leaves only the values of the joints `kept`.
template <class Struct, class Table>
void select(Struct& values, const Table& table, const std::vector<std::size_t>& kept, std::size_t all) {
  for (const auto& row : table) {
    std::vector<double>& x = values.*row.values;
    const std::size_t per_joint = x.size() / all;
    std::vector<double> own;
    for (const std::size_t j : kept)
      for (std::size_t k = 0; k < per_joint; ++k) own.push_back(x[j * per_joint + k]);
    x = own;
  }
}

robot::DriveParameters load_drives(const fs::path& file, std::size_t joints) {
  robot::DriveParameters drives(joints);
  for (const ParameterValue& v : load_parameter_set(file).values) take_row(v, robot::kDriveParameters, drives);
  return drives;
}

EnergyData load_energy(const fs::path& file, std::size_t joints) {
  EnergyData e;
  e.losses = energetics::DriveLosses(joints);
  const std::pair<const char*, double*> scalars[] = {{"P_0", &e.standby.P_0},
                                                     {"P_off", &e.standby.P_off},
                                                     {"P_brake", &e.standby.P_brake},
                                                     {"E_release", &e.standby.E_release},
                                                     {"t_close", &e.standby.t_close},
                                                     {"t_release", &e.standby.t_release},
                                                     {"controller", &e.standby.controller},
                                                     {"C", &e.link.C},
                                                     {"V_min", &e.link.V_min},
                                                     {"V_max", &e.link.V_max},
                                                     {"efficiency", &e.supply.efficiency},
                                                     {"eta_r", &e.supply.eta_r},
                                                     {"price_per_kWh", &e.supply.price_per_kWh},
                                                     {"co2_per_kWh", &e.supply.co2_per_kWh}};
  for (const ParameterValue& v : load_parameter_set(file).values) {
    const auto text_of = [&] {
      const std::string* text = std::get_if<std::string>(&v.value);
      if (!text) fail(v, "expected a text");
      return *text;
    };
    if (v.name == "current") e.current = energetics::parse_current(v.place + ": current", text_of());
    if (v.name == "sources") e.sources = text_of();
    if (v.name == "assumed") e.assumed = text_of();
    for (const auto& [name, value] : scalars) {
      if (v.name != name) continue;
      std::vector<double> one{0};
      take(v, one, 0, kLargest);
      *value = one[0];
    }
    take_row(v, energetics::kDriveLosses, e.losses);
  }
  energetics::Accountant accountant(joints, energetics::Bus::kShared);
  accountant.losses = e.losses;
  accountant.current = e.current;
  accountant.link = e.link;
  accountant.supply = e.supply;
  accountant.check(file.string());
  return e;
}

bool is_file(const fs::path& path) {
  std::error_code none;
  return fs::is_regular_file(path, none);
}

}  // namespace

Robot load_robot(const fs::path& urdf, const std::string& name, const std::map<std::string, double>& locked) {
  Robot r;
  r.name = name;
  r.urdf = urdf;
  robot::UrdfOptions options;
  options.locked = locked;
  r.model = robot::load_urdf(urdf, options);
  const fs::path drives = urdf.parent_path() / "drive_train.ssv", energy = urdf.parent_path() / "energy.ssv";
  const bool has_drives = is_file(drives), has_energy = is_file(energy);
  if (!has_drives && !has_energy) return r;
  const robot::RobotModel whole = locked.empty() ? r.model : robot::load_urdf(urdf);
  const std::size_t n = whole.joints.size();
  if (has_drives) r.drives = load_drives(drives, n);
  if (has_energy) r.energy = load_energy(energy, n);
  if (locked.empty()) return r;
  std::vector<std::size_t> kept;
  for (const robot::Joint& joint : r.model.joints) {
    const auto at = std::ranges::find(whole.joints, joint.name, &robot::Joint::name);
    if (at == whole.joints.end())
      throw Error(urdf.string(),
                  "joint '" + joint.name + "' follows a locked one, expected the leader of the group to be locked");
    kept.push_back(static_cast<std::size_t>(at - whole.joints.begin()));
  }
  if (has_drives) select(*r.drives, robot::kDriveParameters, kept, n);
  if (has_energy) select(r.energy->losses, energetics::kDriveLosses, kept, n);
  return r;
}

Robots::Robots(std::vector<fs::path> folders, std::string fallback, bool paths, fs::path people)
    : folders_(std::move(folders)), fallback_(std::move(fallback)), paths_(paths) {
  for (const fs::path& folder : folders_)
    if (const fs::path beside = folder / "../people/iso_ts_15066.csv"; people.empty() && is_file(beside)) people = beside;
  if (!people.empty()) parts_ = robot::load_body_parts(people);
}

std::shared_ptr<const Robot> Robots::find(const std::string& name, const std::map<std::string, double>& locked) {
  const fs::path urdf = urdf_of(name);
  std::string key = name;
  for (const auto& [joint, q] : locked) key += "\n" + joint + "=" + text::to_text(q);
  const Times times = times_of(urdf);
  {
    const std::lock_guard lock(mutex_);
    if (const auto at = kept_.find(key); at != kept_.end() && at->second.times == times) return at->second.robot;
  }
  auto loaded = std::make_shared<Robot>(load_robot(urdf, name, locked));
  loaded->parts = parts_;
  const std::shared_ptr<const Robot> robot = std::move(loaded);
  constexpr std::size_t kMost = 64;  // locked joints at ever other positions would fill the memory
  const std::lock_guard lock(mutex_);
  if (kept_.size() >= kMost) kept_.clear();
  kept_[key] = {times, robot};
  return robot;
}

fs::path Robots::urdf_of(const std::string& name) const {
  if ((paths_ || name == fallback_) && is_file(name)) return name;
  const bool plain = !name.empty() && name.size() <= 100 && name.front() != '.' && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
  });
  if (!plain) throw Error("robot", "is not a name of letters, digits, '_', '-' and '.', expected one of the known robots");
  for (const fs::path& folder : folders_)
    for (const fs::path& file : {folder / name / "robot.urdf", folder / (name + ".urdf")})
      if (is_file(file)) return file;
  const std::string closest = text::closest(name, names());
  throw Error("robot", "'" + name + "' is unknown" + (closest.empty() ? "" : "; did you mean '" + closest + "'?") +
                           ", expected the name of a robot");
}

std::vector<std::string> Robots::names() const {
  std::vector<std::string> all;
  for (const fs::path& folder : folders_) {
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(folder, none)) {
      if (entry.path().extension() == ".urdf") all.push_back(entry.path().stem().string());
      if (is_file(entry.path() / "robot.urdf")) all.push_back(entry.path().filename().string());
    }
  }
  std::ranges::sort(all);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

Robots::Times Robots::times_of(const fs::path& urdf) {
  Times times;
  for (const fs::path& file : {urdf, urdf.parent_path() / "drive_train.ssv", urdf.parent_path() / "energy.ssv"}) {
    std::error_code missing;
    const auto time = fs::last_write_time(file, missing);
    times.push_back(missing ? std::nullopt : std::optional(time));
  }
  return times;
}

}  // namespace cotwin::services
