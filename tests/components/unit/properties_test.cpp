// Property tests of every unit of the generated table. Settings and start values that a unit needs are in
// tests/components/properties/<unit>.sources (one line per variant: the query of its source) and <unit>.ssv.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"
#include "tests/support/unit_sources.h"

namespace cotwin::properties_test {
namespace {

namespace fs = std::filesystem;

constexpr Duration kStep{1'000'000};

using testing::properties_folder;

std::vector<std::string> sources() {
  std::vector<std::string> all;
  for (const UnitType& type : unit_types()) {
    for (std::string& source : testing::unit_sources(type)) all.push_back(std::move(source));
  }
  return all;
}

Instance make(const std::string& source) {
  const std::vector<fs::path> folders = {properties_folder(), fs::path(places::source()) / "models"};
  Instance instance = make_unit(source, {{"robot", "lwr4"}}, folders, unit_types());
  for (const ParameterSet& values : testing::start_values(source)) apply(values, instance.variables);
  for (const Variable& v : instance.variables) {
    if (v.kind() != Kind::kString) continue;
    for (std::string& text : v.strings()) {
      if (v.role == Role::kParameter && fs::exists(properties_folder() / text) && !text.empty()) {
        text = (properties_folder() / text).string();
      }
    }
  }
  return instance;
}

/// Inputs of step `number`: smooth, small, different for each element, within the declared range.
void excite(const Variables& variables, int number) {
  int channel = 0;
  for (const Variable& v : variables) {
    if (v.role != Role::kInput || v.kind() != Kind::kReal) continue;
    for (double& value : v.reals()) {
      const double wave = 0.1 * std::sin(0.013 * number + 0.7 * channel++);
      value = std::min(std::max(wave, v.min), v.max);
    }
  }
}

/// All bits of every output and state.
std::vector<std::uint64_t> bits(const Variables& variables) {
  std::vector<std::uint64_t> all;
  for (const Variable& v : variables) {
    if (v.role != Role::kOutput && v.role != Role::kState) continue;
    if (v.kind() == Kind::kReal) {
      for (const double value : v.reals()) {
        std::uint64_t word;
        std::memcpy(&word, &value, sizeof word);
        all.push_back(word);
      }
    } else if (v.kind() == Kind::kInteger) {
      for (const std::int32_t value : v.integers()) all.push_back(static_cast<std::uint32_t>(value));
    } else if (v.kind() == Kind::kBoolean) {
      for (const bool value : v.booleans()) all.push_back(value ? 1 : 0);
    } else {
      for (const std::string& value : v.strings()) all.push_back(std::hash<std::string>{}(value));
    }
  }
  return all;
}

/// Steps from step number `begin` to `end`. Returns the bits after each.
std::vector<std::vector<std::uint64_t>> run(Instance& instance, int begin, int end) {
  std::vector<std::vector<std::uint64_t>> trace;
  for (int i = begin; i < end; ++i) {
    excite(instance.variables, i);
    const Duration h = i % 3 == 2 ? Duration{kStep.ns / 2} : kStep;  // the length of the last step may differ
    EXPECT_EQ(instance.unit->step(Time{i * kStep.ns}, h), StepResult::kDone);
    trace.push_back(bits(instance.variables));
  }
  return trace;
}

class UnitProperties : public ::testing::TestWithParam<std::string> {
 protected:
  Instance start() {
    Instance instance = make(GetParam());
    excite(instance.variables, 0);
    instance.unit->initialise(Time{});
    return instance;
  }
};

TEST_P(UnitProperties, DeclaresEachVariableCompletely) {
  Instance instance = make(GetParam());
  EXPECT_GT(instance.variables.size(), 0u);
  for (const Variable& v : instance.variables) {
    EXPECT_GT(v.size(), 0u) << v.name;
    EXPECT_GT(v.description.size(), 4u) << v.name << " needs a longer description";
    EXPECT_LT(v.min, v.max) << v.name;
  }
  EXPECT_NO_THROW(instance.variables.check_ranges()) << "start values lie within their ranges";
}

TEST_P(UnitProperties, HasNoSettingWithTheNameOfAVariableThatCanBeGiven) {
  // Otherwise --set component.name=value would be ambiguous.
  const Instance instance = make(GetParam());
  for (const Setting& setting : settings_of(find_type(parse_unit_source(GetParam()).unit, unit_types()))) {
    const Variable* variable = instance.variables.find(setting.name);
    EXPECT_TRUE(variable == nullptr || (variable->role == Role::kOutput && !variable->has_start)) << setting.name;
  }
}

/// Sets the inputs of step 0, but those of `other` to values of another step, and initialises.
void initialise_with(Instance& instance, const Variable& other, int number) {
  excite(instance.variables, number);
  const std::vector<double> values(other.reals().begin(), other.reals().end());
  excite(instance.variables, 0);
  std::copy(values.begin(), values.end(), other.reals().begin());
  instance.unit->initialise(Time{});
}

TEST_P(UnitProperties, StartsOutputsFromTheInputsThatItDeclares) {
  Instance instance = start();
  const auto text_of = [](const Variable& v) {
    return std::visit(
        [](auto values) { return std::string(reinterpret_cast<const char*>(values.data()), values.size_bytes()); }, v.storage);
  };
  std::map<std::string, std::string> before;
  for (const Variable& v : instance.variables) before[v.name] = text_of(v);
  for (const Variable& input : instance.variables) {
    if (input.role != Role::kInput || input.kind() != Kind::kReal) continue;
    for (const int number : {100, 777}) {
      initialise_with(instance, input, number);
      for (const Variable& v : instance.variables) {
        if (v.role != Role::kOutput || !v.initial_inputs) continue;
        const bool declared = std::ranges::find(*v.initial_inputs, input.name) != v.initial_inputs->end();
        if (!declared) {
          EXPECT_EQ(text_of(v), before[v.name]) << v.name << " depends on " << input.name;
        }
      }
    }
  }
}

TEST_P(UnitProperties, KeepsItsStorageInPlace) {
  Instance instance = start();
  Variables again;
  run(instance, 0, 3);
  instance.unit->declare(again);  // binds the same members again
  ASSERT_EQ(again.size(), instance.variables.size());
  for (std::size_t i = 0; i < again.size(); ++i) {
    const Variable &a = again.all()[i], &b = instance.variables.all()[i];
    const auto address = [](const Variable& v) {
      return std::visit([](auto s) { return static_cast<const void*>(s.data()); }, v.storage);
    };
    EXPECT_EQ(address(a), address(b)) << a.name << " moved";
    EXPECT_EQ(a.size(), b.size()) << a.name << " changed its length";
  }
}

TEST_P(UnitProperties, HasNoOutputLeftAsNaN) {
  Instance instance = start();
  EXPECT_EQ(instance.variables.first_not_finite(), "") << "after initialise";
  run(instance, 0, 100);
  EXPECT_EQ(instance.variables.first_not_finite(), "") << "after 100 steps";
}

TEST_P(UnitProperties, StartsAfreshWhenInitialisedAgain) {
  Instance instance = start();
  Snapshot at_start;
  at_start.take(instance.variables, *instance.unit);
  const auto first = run(instance, 0, 50);
  at_start.restore(instance.variables, *instance.unit);
  excite(instance.variables, 0);
  instance.unit->initialise(Time{});
  EXPECT_EQ(run(instance, 0, 50), first);
}

TEST_P(UnitProperties, StepsAlikeAfterASnapshotIsRestored) {
  Instance instance = start();
  if (!instance.unit->restorable()) return;  // has effects outside: nobody may take its steps back
  run(instance, 0, 37);
  Snapshot snapshot;
  snapshot.take(instance.variables, *instance.unit);
  const auto first = run(instance, 37, 120);
  snapshot.restore(instance.variables, *instance.unit);
  EXPECT_EQ(run(instance, 37, 120), first);
}

// Steps that measure a loop or are repeated are no part of the run.
TEST_P(UnitProperties, ForgetsNotesOfStepsThatAreTakenBack) {
  Instance instance = start();
  if (!instance.unit->restorable()) return;  // has effects outside: nobody may take its steps back
  const auto notes = [&] {
    std::vector<std::string> all;
    instance.unit->append_notes(all);
    return all;
  };
  Snapshot at_start;
  at_start.take(instance.variables, *instance.unit);
  const std::vector<std::string> first = notes();
  run(instance, 0, 120);
  at_start.restore(instance.variables, *instance.unit);
  EXPECT_EQ(notes(), first);
}

TEST_P(UnitProperties, StepsAlikeWhenAFreshInstanceTakesOverItsSnapshot) {
  Instance instance = start();
  if (!instance.unit->restorable()) return;  // has effects outside: nobody may take its steps back
  run(instance, 0, 37);
  Snapshot snapshot;
  snapshot.take(instance.variables, *instance.unit);
  const auto first = run(instance, 37, 120);

  Instance fresh = start();
  Snapshot::deserialise(snapshot.serialise()).restore(fresh.variables, *fresh.unit);
  EXPECT_EQ(run(fresh, 37, 120), first);
}

TEST_P(UnitProperties, TakingASnapshotChangesNothing) {
  Instance instance = start(), watched = start();
  const auto first = run(instance, 0, 60);
  std::vector<std::vector<std::uint64_t>> second;
  for (int i = 0; i < 60; ++i) {
    Snapshot snapshot;
    snapshot.take(watched.variables, *watched.unit);
    second.push_back(run(watched, i, i + 1).front());
  }
  EXPECT_EQ(second, first);
}

TEST_P(UnitProperties, AllocatesNothingInAStep) {
  Instance instance = start();
  run(instance, 0, 10);
  std::uint64_t allocated = 0;
  for (int i = 10; i < 200; ++i) {
    excite(instance.variables, i);
    const std::uint64_t before = testing::allocations();
    (void)instance.unit->step(Time{i * kStep.ns}, kStep);
    allocated += testing::allocations() - before;
  }
  EXPECT_EQ(allocated, 0u);
}

TEST_P(UnitProperties, GivesTheSameBitsOnAnyThread) {
  Instance alone = start();
  const auto expected = run(alone, 0, 40);
  std::vector<Instance> instances;
  for (int i = 0; i < 4; ++i) instances.push_back(start());
  std::vector<std::vector<std::vector<std::uint64_t>>> traces(instances.size());
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < instances.size(); ++i) {
    threads.emplace_back([&, i] { traces[i] = run(instances[i], 0, 40); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& trace : traces) EXPECT_EQ(trace, expected);
}

INSTANTIATE_TEST_SUITE_P(Units, UnitProperties, ::testing::ValuesIn(sources()), [](const auto& instance) {
  std::string name = instance.param.substr(5);
  for (char& c : name) {
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  }
  return name;
});

TEST(UnitTable, NamesEachUnitOnce) {
  std::set<std::string> names;
  for (const UnitType& type : unit_types()) {
    EXPECT_TRUE(names.insert(type.name).second) << type.name;
    EXPECT_GT(std::strlen(type.summary), 10u) << type.name;
  }
}

TEST(UnitTable, DeclaresEverySettingCompletely) {
  for (const UnitType& type : unit_types()) {
    const SettingList settings = settings_of(type);
    EXPECT_GT(settings.all().size(), 0u) << type.name;
    for (const Setting& s : settings) {
      EXPECT_GT(s.description.size(), 10u) << type.name << ' ' << s.name;
      EXPECT_LT(s.min, s.max) << type.name << ' ' << s.name;
      EXPECT_TRUE(s.kind != Setting::Kind::kChoice || s.choices.size() > 1) << type.name << ' ' << s.name;
    }
  }
}

TEST(UnitTable, TakesEveryChoiceOfEverySetting) {
  // Each setting alone. If the unit refuses it, the message must name the setting that it contradicts.
  const std::vector<fs::path> folders = {properties_folder(), fs::path(places::source()) / "models"};
  for (const UnitType& type : unit_types()) {
    for (const Setting& s : settings_of(type)) {
      const std::vector<std::string> values = s.kind == Setting::Kind::kChoice    ? s.choices
                                              : s.kind == Setting::Kind::kBoolean ? std::vector<std::string>{"true", "false"}
                                                                                  : std::vector<std::string>{};
      for (const std::string& value : values) {
        const std::string source = std::string("unit:") + type.name + "?" + s.name + "=" + value;
        try {
          (void)make_unit(source, {{"robot", "planar2"}}, folders, unit_types());
        } catch (const Error& error) {
          EXPECT_NE(std::string(error.what()).find(s.name + "=" + value), std::string::npos) << source << ": " << error.what();
        }
      }
    }
  }
}

}  // namespace
}  // namespace cotwin::properties_test
