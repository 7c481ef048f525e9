// Exports every unit of the generated table as an FMU and imports it again: the same bits, so that a scenario can replace a
// unit by its FMU in one attribute.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "fmu/import/load.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"
#include "tests/support/places.h"
#include "tests/support/unit_sources.h"

namespace cotwin::fmu::both_ways_test {
namespace {

namespace fs = std::filesystem;

constexpr int kSteps = 60;

using cotwin::testing::properties_folder;

struct Subject {
  std::string source;
  Version version;
  ProcessChoice process;
};

void PrintTo(const Subject& s, std::ostream* out) {
  *out << s.source << ", FMI " << static_cast<int>(s.version) << ", process " << text::word_of(s.process, kProcessWords);
}

std::vector<Subject> subjects() {
  std::vector<Subject> all;
  for (const UnitType& type : unit_types()) {
    if (cotwin::testing::is_host_only(type)) continue;
    const std::string source = cotwin::testing::unit_sources(type).front();
    all.push_back({source, Version::k2, ProcessChoice::kShared});
    all.push_back({source, Version::k3, ProcessChoice::kShared});
    all.push_back({source, Version::k3, ProcessChoice::kOwn});
  }
  return all;
}

/// Unit and version, as "motion_fmi2".
std::string type_of(const Subject& subject) {
  return parse_unit_source(subject.source).unit + "_fmi" + std::to_string(static_cast<int>(subject.version));
}

class BothWays : public ::testing::TestWithParam<Subject> {
 protected:
  void SetUp() override {
    PackRequest request;
    request.source = GetParam().source;
    request.defaults = {{"robot", "lwr4"}};
    request.folders = {properties_folder(), fs::path(places::source()) / "models"};
    request.types = unit_types();
    request.version = GetParam().version;
    request.values = cotwin::testing::start_values(request.source);
    unit_ = make_unit(request.source, request.defaults, request.folders, request.types);
    for (const ParameterSet& set : request.values) apply(set, unit_.variables);
    static TemporaryFolder archives;  // each is written once
    archive_ = archives.path() / (type_of(GetParam()) + ".fmu");
    if (!fs::exists(archive_)) pack_unit(request, archive_);
    fmu_ = load_fmu();
  }
  Instance load_fmu() const {
    LoadOptions options;
    options.process = GetParam().process;
    return load(archive_, options);
  }
  void excite(Instance& instance, int number) const {
    std::size_t channel = 0;
    for (const Variable& v : instance.variables) {
      if (v.role != Role::kInput || v.kind() != Kind::kReal) continue;
      for (double& value : v.reals())
        value = std::min(std::max(0.1 * std::sin(0.013 * number + 0.7 * static_cast<double>(channel++)), v.min), v.max);
      for (double& rate : v.rate) rate = number % 3 == 0 ? 0.25 : 0;
    }
  }
  /// Parameters that are texts are files, which have the same name in the FMU but not the same folder.
  static std::string values(const Instance& instance) {
    std::ostringstream text;
    text << std::hexfloat;
    for (const Variable& v : instance.variables) {
      text << v.name << ':';
      std::visit(
          [&](auto all) {
            for (const auto& value : all) {
              if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>) {
                text << ' ' << (v.role == Role::kParameter ? fs::path(value).filename().string() : value);
              } else {
                text << ' ' << value;
              }
            }
          },
          v.storage);
      text << '\n';
    }
    return text.str();
  }
  fs::path archive_;
  Instance unit_, fmu_;
};

TEST_P(BothWays, TheVariablesAreTheSame) {
  ASSERT_EQ(fmu_.variables.size(), unit_.variables.size());
  for (std::size_t i = 0; i < unit_.variables.size(); ++i) {
    const Variable &a = unit_.variables.all()[i], &b = fmu_.variables.all()[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.role, b.role) << a.name;
    EXPECT_EQ(a.kind(), b.kind()) << a.name;
    EXPECT_EQ(a.size(), b.size()) << a.name;
    EXPECT_EQ(a.mixed(), b.mixed()) << a.name;
    for (std::size_t e = 0; e < a.size() && e < b.size(); ++e) EXPECT_EQ(a.si_of(e), b.si_of(e)) << a.name << ", element " << e;
    EXPECT_EQ(a.rate.size(), b.rate.size()) << a.name;
    EXPECT_EQ(std::pair(a.min, a.max), std::pair(b.min, b.max)) << a.name;
  }
}

TEST_P(BothWays, OnlyDeclaredCapabilitiesAreUsed) {
  LoadOptions options;
  options.process = GetParam().process;
  options.slopes = true;
  const bool tells =
      std::any_of(unit_.variables.begin(), unit_.variables.end(), [](const Variable& v) { return !v.derivative_of.empty(); });
  if (!tells) {
    EXPECT_THAT([&] { load(archive_, options); },
                ::testing::ThrowsMessage<Error>(::testing::HasSubstr("the FMU gives no derivatives of outputs, expected")));
    return;
  }
  Instance with_slopes = load(archive_, options);
  EXPECT_THAT(with_slopes.warnings, ::testing::Contains(::testing::HasSubstr("slopes=true has no effect")));
  EXPECT_EQ(with_slopes.variables.size(), unit_.variables.size());
  unit_.unit->initialise({});
  with_slopes.unit->initialise({});
  for (int n = 0; n < 3; ++n) {
    for (Instance* i : {&unit_, &with_slopes}) {
      excite(*i, n);
      ASSERT_EQ(i->unit->step({n * 1'000'000}, {1'000'000}), StepResult::kDone);
    }
    ASSERT_EQ(values(unit_), values(with_slopes)) << n;
  }
}

TEST_P(BothWays, TheStepsAreTheSameBitForBit) {
  unit_.unit->initialise({});
  fmu_.unit->initialise({});
  for (int n = 0; n < kSteps; ++n) {
    for (Instance* i : {&unit_, &fmu_}) {
      excite(*i, n);
      ASSERT_EQ(i->unit->step({n * 1'000'000}, {1'000'000}), StepResult::kDone);
    }
    ASSERT_EQ(values(unit_), values(fmu_)) << n;
  }
}

TEST_P(BothWays, AFreshInstanceGoesOnFromASnapshotAsTheUnitDoes) {
  ASSERT_EQ(fmu_.unit->restorable(), unit_.unit->restorable());
  if (!unit_.unit->restorable()) return;  // has effects outside
  fmu_.unit->initialise({});
  for (int n = 0; n < kSteps / 2; ++n) {
    excite(fmu_, n);
    ASSERT_EQ(fmu_.unit->step({n * 1'000'000}, {1'000'000}), StepResult::kDone);
  }
  Snapshot snapshot;
  snapshot.take(fmu_.variables, *fmu_.unit);
  Instance fresh = load_fmu();
  Snapshot::deserialise(snapshot.serialise()).restore(fresh.variables, *fresh.unit);
  for (int n = kSteps / 2; n < kSteps; ++n) {
    for (Instance* i : {&fmu_, &fresh}) {
      excite(*i, n);
      ASSERT_EQ(i->unit->step({n * 1'000'000}, {1'000'000}), StepResult::kDone);
    }
    ASSERT_EQ(values(fmu_), values(fresh)) << n;
  }
}

INSTANTIATE_TEST_SUITE_P(Units, BothWays, ::testing::ValuesIn(subjects()), [](const auto& subject) {
  return type_of(subject.param) + "_" + text::word_of(subject.param.process, kProcessWords);
});

}  // namespace
}  // namespace cotwin::fmu::both_ways_test
