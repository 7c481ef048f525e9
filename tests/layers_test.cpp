// Includes point down only (docs/architecture.md): tests, examples → master → fmu → the units → unit, bus → models.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <string>
#include <vector>

#include "tests/support/places.h"

namespace {

namespace fs = std::filesystem;

struct Include {
  std::string from, to, place;
};

std::vector<Include> includes_below(const std::string& folder) {
  std::vector<Include> found;
  const fs::path root = cotwin::places::source();
  const std::regex pattern(R"(^\s*#\s*include\s+\"([^\"]+)\")");
  for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".h" && extension != ".cpp" && extension != ".c" && extension != ".inc") continue;
    std::ifstream in(entry.path());
    const std::string from = fs::relative(entry.path(), root).generic_string();
    std::string line;
    for (int number = 1; std::getline(in, line); ++number) {
      std::smatch match;
      if (std::regex_search(line, match, pattern)) found.push_back({from, match[1], from + ":" + std::to_string(number)});
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

TEST(Layers, ModelsIncludeNoUnit) {
  for (const Include& i : includes_below("models"))
    EXPECT_TRUE(starts_with_any(i.to, {"models/"})) << i.place << " includes " << i.to;
}

TEST(Layers, UnitsIncludeModelsUnitAndBusButNeverOneAnother) {
  for (const Include& i : includes_below("components")) {
    const bool allowed = starts_with_any(i.to, {"models/", "components/unit/", "components/bus/", component_of(i.from)});
    EXPECT_TRUE(allowed) << i.place << " includes " << i.to;
  }
}

TEST(Layers, UnitAndBusIncludeNoConcreteUnit) {
  for (const char* folder : {"components/unit", "components/bus"}) {
    for (const Include& i : includes_below(folder)) {
      EXPECT_TRUE(starts_with_any(i.to, {"models/", "components/unit/", "components/bus/"})) << i.place << " includes " << i.to;
    }
  }
}

TEST(Layers, FmuAndMasterIncludeNoConcreteUnit) {
  for (const char* folder : {"fmu", "master"}) {
    for (const Include& i : includes_below(folder)) {
      const bool allowed = starts_with_any(i.to, {"models/", "components/unit/", "components/bus/", "fmu/"}) ||
                           (std::string(folder) == "master" && starts_with_any(i.to, {"master/"}));
      EXPECT_TRUE(allowed) << i.place << " includes " << i.to;
    }
  }
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

/// Below `folder`, files may include their own room and the rooms before it; files beside the rooms are below all of them.
void expect_rooms_in_order(const std::string& folder, const std::vector<std::string>& rooms) {
  const auto room_of = [&](const std::string& path) -> std::ptrdiff_t {
    for (std::size_t i = 0; i < rooms.size(); ++i) {
      if (path.starts_with(folder + "/" + rooms[i] + "/")) return static_cast<std::ptrdiff_t>(i);
    }
    EXPECT_EQ(path.find('/', folder.size() + 1), std::string::npos) << path << " is in a room that is not listed";
    return -1;
  };
  for (const Include& i : includes_below(folder)) {
    if (!i.to.starts_with(folder + "/")) continue;
    if (i.from == "fmu/import/load.cpp" && i.to == "fmu/process/process.h") continue;  // it chooses where an FMU runs
    EXPECT_GE(room_of(i.from), room_of(i.to)) << i.place << " includes " << i.to;
  }
}

TEST(Layers, RoomsOfAFolderIncludeThoseBelowThem) {
  expect_rooms_in_order("fmu", {"archive", "description", "import", "process", "check", "export"});
  expect_rooms_in_order("master",
                        {"ssp", "engine", "clock", "run", "twin", "services", "report", "view", "program", "api", "python"});
}

TEST(Layers, TheEngineOfTheContactWorldIncludesNoUnit) {
  for (const Include& i : includes_below("components/contact_world/engine"))
    EXPECT_TRUE(starts_with_any(i.to, {"models/", "components/contact_world/engine/"})) << i.place << " includes " << i.to;
}

}  // namespace
