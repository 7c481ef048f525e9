// Includes point down only (docs/architecture.md): tests, examples → master → fmu → the units → services, bus, unit → models, and from
// room to room within a floor. Folders and files stay small enough to be read.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/places.h"

namespace layers_test {
namespace {

namespace fs = std::filesystem;

struct Include {
  std::string from, to, place;
};

/// The quoted path of an #include line; "" of any other line.
std::string included_by(const std::string& line) {
  const std::size_t hash = line.find_first_not_of(" \t");
  if (hash == std::string::npos || line[hash] != '#') return "";
  const std::size_t word = line.find_first_not_of(" \t", hash + 1);
  if (word == std::string::npos || line.compare(word, 7, "include") != 0) return "";
  const std::size_t open = line.find_first_not_of(" \t", word + 7);
  if (open == std::string::npos || line[open] != '"') return "";
  return line.substr(open + 1, line.find('"', open + 1) - open - 1);
}

bool is_code(const fs::path& file) {
  const std::string extension = file.extension().string();
  return extension == ".h" || extension == ".cpp" || extension == ".c" || extension == ".inc";
}

std::vector<Include> includes_below(const std::string& folder) {
  std::vector<Include> found;
  const fs::path root = cotwin::places::source();
  for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
    if (!is_code(entry.path())) continue;
    std::ifstream in(entry.path());
    const std::string from = fs::relative(entry.path(), root).generic_string();
    std::string line;
    for (int number = 1; std::getline(in, line); ++number) {
      if (const std::string to = included_by(line); !to.empty())
        found.push_back({from, to, from + ":" + std::to_string(number)});
    }
  }
  return found;
}

bool starts_with_any(const std::string& text, const std::vector<std::string>& prefixes) {
  for (const std::string& prefix : prefixes) {
    if (text.rfind(prefix, 0) == 0) return true;
  }
  return false;
}

/// The folder of a component that contains a path: "components/drive_train/"; "" if there is none.
std::string component_of(const std::string& path) {
  if (path.rfind("components/", 0) != 0) return "";
  const std::size_t end = path.find('/', std::string("components/").size());
  return end == std::string::npos ? "" : path.substr(0, end + 1);
}

const std::vector<std::string> kModels = {"models/"};
const std::vector<std::string> kBelowUnits = {"models/", "components/unit/", "components/bus/", "components/services/"};

void expect_includes_of(const std::string& folder, std::vector<std::string> allowed) {
  allowed.push_back(folder + "/");
  for (const Include& i : includes_below(folder))
    EXPECT_TRUE(starts_with_any(i.to, allowed)) << i.place << " includes " << i.to;
}

TEST(Layers, ModelsIncludeNoUnit) { expect_includes_of("models", {}); }

TEST(Layers, UnitsIncludeWhatIsBelowThemButNeverOneAnother) {
  for (const Include& i : includes_below("components")) {
    std::vector<std::string> allowed = kBelowUnits;
    allowed.push_back(component_of(i.from));
    EXPECT_TRUE(starts_with_any(i.to, allowed)) << i.place << " includes " << i.to;
  }
}

TEST(Layers, WhatIsBelowTheUnitsIncludesNoConcreteUnit) {
  expect_includes_of("components/unit", kModels);
  expect_includes_of("components/robot_files", {"models/", "components/unit/"});
  expect_includes_of("components/bus", {"models/", "components/unit/"});
  expect_includes_of("components/services", kModels);
}

TEST(Layers, FmuAndMasterIncludeNoConcreteUnit) {
  expect_includes_of("fmu", {"models/", "components/unit/", "components/bus/"});
  std::vector<std::string> below_master = kBelowUnits;
  below_master.insert(below_master.end(), {"components/robot_files/", "fmu/"});
  expect_includes_of("master", below_master);
}

TEST(Layers, IncludesStartAtTheRootOfTheRepository) {
  const fs::path root = cotwin::places::source();
  for (const char* folder : {"models", "components", "fmu", "master", "tests"}) {
    for (const Include& i : includes_below(folder)) {
      if (i.from.starts_with("tests/install/consumer/")) continue;  // a project of its own
      EXPECT_TRUE(fs::exists(root / i.to)) << i.place << " includes " << i.to;
    }
  }
}

// Two types with the same name in the namespace of a folder are the same type for the linker. It then takes the functions of
// either, with the wrong size of memory.
TEST(Names, OfTypesAreUniqueInTheHeadersOfAFolder) {
  const fs::path root = cotwin::places::source();
  const std::regex pattern(R"(^(?:struct|class) (\w+)(?: final)?(?: : .*)? \{)");
  std::map<std::string, std::string> places;  // by folder and name
  for (const char* folder : {"models", "components", "fmu", "master"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (entry.path().extension() != ".h") continue;
      std::ifstream in(entry.path());
      std::string line;
      for (int number = 1; std::getline(in, line); ++number) {
        std::smatch match;
        if (!std::regex_search(line, match, pattern)) continue;
        const std::string place = entry.path().generic_string() + ":" + std::to_string(number);
        const auto [known, first] = places.emplace(entry.path().parent_path().generic_string() + " " + match[1].str(), place);
        EXPECT_TRUE(first) << place << ": " << match[1] << " is another one at " << known->second;
      }
    }
  }
  EXPECT_GT(places.size(), 100u);
}

/// The rooms of each folder from the bottom up; "" are the files beside the rooms. A file includes its own room and those before it.
const std::map<std::string, std::vector<std::string>> kRooms = {
    {"models",
     {"foundation/support",
      "foundation/formats",
      "foundation/net",
      "foundation/database",
      "bag",
      "numerics/kernels",
      "numerics/device",
      "numerics",
      "mechanics",
      "robot/kernels",
      "robot/drives",
      "robot",
      "robot/urdf",
      "robot/changes",
      "scene",
      "scene/sdf",
      "scene/urdf",
      "trajectory",
      "trajectory/series",
      "cloud",
      "collision",
      "collision/contact",
      "collision/cell",
      "collision/meeting",
      "control",
      "energetics",
      "optimisation/evaluation",
      "optimisation/judgement",
      "optimisation",
      "optimisation/reactionless",
      "optimisation/growth",
      "identification/measurement",
      "identification/torque_data",
      "identification",
      "identification/excitation",
      "anomaly"}},
    {"components/unit", {"", "surroundings"}},
    {"components/services", {"", "json", "json/answers", "json/control"}},
    {"components/io",
     {"fri", "rtde", "ethercat", "ethercat/master", "emulators/kuka", "emulators/ur", "emulators/ethercat", "link", "emulators",
      "links", ""}},
    {"components/compliance", {"joints", "cartesian/frame", "cartesian", ""}},
    {"components/contact_world", {"engine/solvers", "engine/body", "engine/joints", "engine/accounts", "engine", ""}},
    {"components/gateway", {"access", "http", "jobs", "live", "mqtt", "api", ""}},
    {"fmu", {"", "archive", "description", "import", "import/unit", "process", "check", "export"}},
    {"master",
     {"scenario",
      "engine/wiring",
      "engine/coupling",
      "engine",
      "clock",
      "run",
      "twin",
      "services",
      "results",
      "report",
      "scenery",
      "workflows/starter",
      "workflows/tuning",
      "workflows/anomaly",
      "workflows",
      "farm",
      "view",
      "api",
      "python",
      "program",
      "program/commands",
      "program/commands/run"}},
};

/// Includes against the order, each for a reason.
const std::set<std::pair<std::string, std::string>> kUpwards = {
    {"components/services/json/json.cpp", "components/services/json/answers/answers.h"},  // calls the services by their names
    {"components/services/json/json.cpp", "components/services/json/control/control.h"},  // which chooses them
    {"fmu/import/load.cpp", "fmu/process/process.h"},                                     // chooses where an FMU runs
    {"master/program/main.cpp", "master/program/commands/commands.h"},                    // the main function
};

/// The position in kRooms of the folder that contains the file, if `floor` has rooms.
std::ptrdiff_t room_of(const std::string& floor, const std::string& file) {
  const std::string folder = fs::path(file).parent_path().generic_string();
  const std::vector<std::string>& rooms = kRooms.at(floor);
  for (std::size_t i = 0; i < rooms.size(); ++i) {
    if (folder == (rooms[i].empty() ? floor : floor + "/" + rooms[i])) return static_cast<std::ptrdiff_t>(i);
  }
  ADD_FAILURE() << file << " is in a room that is not listed";
  return -1;
}

TEST(Layers, RoomsIncludeThoseBelowThem) {
  for (const auto& [floor, rooms] : kRooms) {
    std::size_t within = 0;
    for (const Include& i : includes_below(floor)) {
      if (!i.to.starts_with(floor + "/") || kUpwards.contains({i.from, i.to})) continue;
      EXPECT_GE(room_of(floor, i.from), room_of(floor, i.to)) << i.place << " includes " << i.to;
      ++within;
    }
    EXPECT_GT(within, rooms.size()) << floor;
  }
}

TEST(Layers, NothingIncludesTheProgram) {
  for (const char* folder : {"models", "components", "fmu", "master"}) {
    for (const Include& i : includes_below(folder)) {
      if (i.from.starts_with("master/program/")) continue;
      EXPECT_FALSE(i.to.starts_with("master/program/")) << i.place << " includes " << i.to;
    }
  }
}

/// The folders with code of the program, from the root of the repository, with the files directly inside.
std::map<std::string, std::vector<fs::path>> folders_with_code() {
  const fs::path root = cotwin::places::source();
  std::map<std::string, std::vector<fs::path>> found;
  for (const char* floor : {"models", "components", "fmu", "master"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / floor)) {
      if (is_code(entry.path())) found[fs::relative(entry.path().parent_path(), root).generic_string()].push_back(entry.path());
    }
  }
  return found;
}

TEST(Folders, AreListedInTheOrderOfTheirFloorOrAreUnits) {
  for (const auto& [folder, files] : folders_with_code()) {
    bool listed = fs::path(folder).parent_path() == "components";
    for (const auto& [floor, rooms] : kRooms) {
      for (const std::string& room : rooms) listed = listed || folder == (room.empty() ? floor : floor + "/" + room);
    }
    EXPECT_TRUE(listed) << folder;
  }
}

TEST(Folders, HaveAtMost25FilesOfCode) {
  const std::map<std::string, std::vector<fs::path>> folders = folders_with_code();
  ASSERT_GT(folders.size(), 50u);
  for (const auto& [folder, files] : folders) EXPECT_LE(files.size(), 25u) << folder;
}

/// Files that are longer than 500 lines. None may be added.
const std::set<std::string> kLongFiles = {
    "models/optimisation/search.cpp",  // one class: a search with its stages
};

TEST(Folders, HaveFilesOfAtMost500Lines) {
  const fs::path root = cotwin::places::source();
  std::set<std::string> long_files;
  for (const auto& [folder, files] : folders_with_code()) {
    for (const fs::path& file : files) {
      std::ifstream in(file);
      std::size_t lines = 0;
      for (std::string line; std::getline(in, line);) ++lines;
      if (lines > 500) long_files.insert(fs::relative(file, root).generic_string());
    }
  }
  EXPECT_EQ(long_files, kLongFiles);
}

// The first header to read has the name of its folder, or the README of the floor has a row "| `folder/` | `header.h` |".
TEST(Folders, HaveAFirstHeader) {
  const fs::path root = cotwin::places::source();
  const std::regex row(R"(^\| `([\w/]+)/` \| `([\w/]+\.h)` \|.*)");
  std::map<std::string, fs::path> first;  // by folder
  for (const char* floor : {"models", "components", "fmu", "master"}) {
    std::ifstream in(root / floor / "README.md");
    for (std::string line; std::getline(in, line);) {
      std::smatch match;
      if (std::regex_match(line, match, row))
        first[floor + ("/" + match[1].str())] = root / floor / match[1].str() / match[2].str();
    }
  }
  for (const auto& [folder, files] : folders_with_code()) {
    const fs::path named = root / folder / (fs::path(folder).filename().string() + ".h");
    if (fs::exists(named) || folder == "fmu") continue;  // fmu/ has the C headers of the standards
    EXPECT_TRUE(first.contains(folder)) << folder << " has no header of its name, and no row in the README of its floor";
  }
  for (const auto& [folder, header] : first) EXPECT_TRUE(fs::exists(header)) << header;
}

TEST(Layers, TheEngineOfTheContactWorldIncludesNoUnit) { expect_includes_of("components/contact_world/engine", kModels); }

}  // namespace
}  // namespace layers_test
