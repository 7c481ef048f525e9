// The hash of a scenario, by which runs go on: every member counts, but those without which a run gives the same results.
#include "master/run/identity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "components/robot_files/robot_files.h"
#include "master/run/checkpoint.h"
#include "tests/support/files.h"
#include "tests/support/listed_once.h"

namespace cotwin::master::identity_test {
namespace {

using testing::TemporaryFolder;

template <class T>
concept Structure = requires(T& value) {
  T::fields(value, [](auto&...) {});
};
template <class T>
concept List = requires(T& value) {
  value.emplace_back();
}
&&!std::same_as<T, std::string>;

/// Gives a value another one.
template <class T>
void change(T& value) {
  if constexpr (std::same_as<T, bool>) {
    value = !value;
  } else if constexpr (std::is_enum_v<T>) {
    value = static_cast<T>(value == T{} ? 1 : 0);
  } else if constexpr (std::is_arithmetic_v<T>) {
    value += 1;
  } else if constexpr (std::same_as<T, std::string> || std::same_as<T, std::filesystem::path>) {
    value = "other";
  } else if constexpr (List<T>) {
    value.emplace_back();
  } else if constexpr (requires { value.emplace("name", "value"); }) {
    value.emplace("name", "value");
  } else if constexpr (requires { value.reset(new int); }) {
    value.reset(new int);
  } else if constexpr (std::same_as<T, ClockSpec>) {
    value.kind = ClockKind::kWall;
  } else if constexpr (std::same_as<T, ConnectorSpec>) {
    value.name = "other";
  } else if constexpr (requires { value.fill(0); }) {
    value.fill(7);
  } else if constexpr (std::same_as<T, std::optional<Time>>) {
    value = Time{5};
  } else {
    value = 0.5;  // of a start value
  }
}

/// Calls f(value) for the values of all members that are listed or that are left out, also in the items of lists.
template <class T, class F>
void each_value(T& value, bool listed, const F& f, bool in_list = true) {
  if constexpr (Structure<T>) {
    const auto enter = [&](bool is_listed) {
      return [&f, listed, is_listed](auto&... members) { (each_value(members, listed, f, is_listed), ...); };
    };
    T::fields(value, enter(true));
    if constexpr (requires { T::left_out(value, enter(false)); }) T::left_out(value, enter(false));
  } else {
    if (listed == in_list) f(value);
    if constexpr (requires { value.begin(), value.size(); } && !std::same_as<T, std::string>) {
      if (in_list) {
        for (auto& item : value) {
          if constexpr (!std::is_const_v<std::remove_reference_t<decltype(item)>> && !requires { item.second; })
            each_value(item, listed, f, in_list);
        }
      }
    }
  }
}

/// With an item in each list.
Scenario full() {
  Scenario s;
  s.name = "x";
  s.stop = Time::from_seconds(1);
  s.settings = {{"robot", "lwr4"}};
  s.nested_settings.emplace_back();
  ComponentSpec& unit = s.components.emplace_back();
  unit.name = "a";
  unit.source = "unit:drive_train?robot=lwr4";
  unit.start_values.push_back({"K", std::int64_t{3}, "m", "", false});
  s.components.emplace_back().source = "plant.fmu";
  s.connections.emplace_back();
  s.events.emplace_back();
  s.tools.emplace_back().frames.emplace_back();
  s.recording.emplace_back();
  s.comparisons.emplace_back();
  s.bonds.emplace_back();
  s.reports.emplace_back();
  s.units.emplace_back();
  return s;
}

/// The hashes of scenarios of which one value is changed.
std::vector<std::uint64_t> hashes_after_each_change(bool listed) {
  std::vector<std::uint64_t> hashes;
  Scenario counted = full();
  int values = 0;
  each_value(counted, listed, [&](auto&) { ++values; });
  for (int k = 0; k < values; ++k) {
    Scenario s = full();
    int at = 0;
    each_value(s, listed, [&](auto& value) {
      if (at++ == k) change(value);
    });
    hashes.push_back(hash_of(s));
  }
  return hashes;
}

TEST(Identity, DependsOnEachMemberThatDecidesResults) {
  std::vector<std::uint64_t> hashes = hashes_after_each_change(true);
  hashes.push_back(hash_of(full()));
  EXPECT_GT(hashes.size(), 100u);
  for (std::size_t k = 0; k < hashes.size(); ++k)
    EXPECT_EQ(std::count(hashes.begin(), hashes.end(), hashes[k]), 1) << "change " << k;
}

TEST(Identity, DoesNotDependOnWhatMayBeAnother) {
  const std::vector<std::uint64_t> hashes = hashes_after_each_change(false);
  EXPECT_GT(hashes.size(), 15u);
  for (std::size_t k = 0; k < hashes.size(); ++k) EXPECT_EQ(hashes[k], hash_of(full())) << "change " << k;
  Scenario s = full();
  s.comparisons[0].from = s.start;
  s.comparisons[0].to = s.stop;
  EXPECT_EQ(hash_of(s), hash_of(full())) << "as where they are not given";
}

TEST(Identity, DependsOnTheFilesThatAreNamedAndNotOnTheirFolder) {
  const TemporaryFolder first("identity"), second("identity");
  using Case = std::pair<std::string, std::function<void(Scenario&, const std::string&)>>;
  const Case cases[] = {
      {"setting", [](Scenario& s, const std::string& file) { s.settings["robot"] = file; }},
      {"nested setting", [](Scenario& s, const std::string& file) { s.nested_settings[0].value = file; }},
      {"start value", [](Scenario& s, const std::string& file) { s.components[0].start_values[0].value = file; }},
      {"setting of a unit",
       [](Scenario& s, const std::string& file) { s.components[0].source = "unit:io?a=b&recording=" + file; }},
      {"FMU", [](Scenario& s, const std::string& file) { s.components[1].source = file; }},
      {"unpacked FMU", [](Scenario& s, const std::string& file) { s.components[1].source = file.substr(0, file.find('/')); }},
      {"shapes of a tool", [](Scenario& s, const std::string& file) { s.tools[0].shapes = s.folder / file; }}};
  for (const Case& one : cases) {
    const std::string& what = one.first;
    const std::string file = what == "unpacked FMU" ? "plant/modelDescription.xml" : "named.txt";
    const auto hash_in = [&](const TemporaryFolder& folder, const std::string& content) {
      folder.write(file, content);
      Scenario s = full();
      s.folder = folder.path();
      one.second(s, file);
      return hash_of(s);
    };
    const std::uint64_t hash = hash_in(first, "1");
    EXPECT_EQ(hash_in(second, "1"), hash) << what;
    EXPECT_NE(hash_in(first, "2"), hash) << what;
    std::filesystem::remove(first / file);
    Scenario without = full();
    without.folder = first.path();
    one.second(without, file);
    EXPECT_NE(hash_of(without), hash) << what;
  }
}

TEST(Identity, DependsOnWhatUnitsHaveRead) {
  const auto hash_with = [](double x) {
    FileStore models;
    models.get<FoundCell>(std::string(kCellKey) + "scene.sdf", [&] {
      FoundCell found;
      found.cell.scene.bodies.emplace_back().shapes.emplace_back().vertices = {{x, 0, 0}};  // of a mesh
      return found;
    });
    return hash_of(models);
  };
  EXPECT_EQ(hash_with(1), hash_with(1));
  EXPECT_NE(hash_with(1), hash_with(2));
}

TEST(Identity, ListsEachMemberOnce) {
  testing::expect_each_member_once<Scenario, ComponentSpec, Port, ConnectionSpec, EventSpec, ToolSpec, ToolSpec::Frame,
                                   RecordSpec, NestedSetting, ComparisonSpec, BondSpec, ReportSpec, Build, RunState,
                                   RunCheckpoint, Recorder::Kept, Events::State, Events::Ramp, LoopCounts, bus::LiveRun::Value,
                                   bus::LiveRun::Deed, GivenStart, Time, Duration>();
}

}  // namespace
}  // namespace cotwin::master::identity_test
