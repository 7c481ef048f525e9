// Tests of every exported unit in both versions of FMI (subjects.h).
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <thread>

#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "tests/fmu/driver.h"
#include "tests/fmu/foreign.h"
#include "tests/fmu/old_glibc.h"
#include "tests/fmu/subjects.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/run_program.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::fmu::exported_units_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::run_command;
using testing::Driver;
using testing::excitation;
using testing::in_process;
using testing::LoadedFmu;
using testing::name_of;
using testing::references;
using testing::request_for;
using testing::Subject;
using testing::subjects;

constexpr std::int64_t kStep = 1'000'000;  // ns

class ExportedUnits : public ::testing::TestWithParam<Subject> {
 protected:
  void SetUp() override {
    request_ = request_for(GetParam());
    static TemporaryFolder archives;  // each is written once
    archive_ = archives.path() / (::testing::PrintToString(std::hash<std::string>{}(request_.source)) + "." +
                                  std::to_string(static_cast<int>(request_.version)) + ".fmu");
    if (!fs::exists(archive_)) pack_unit(request_, archive_);
    static std::map<fs::path, LoadedFmu> loaded;  // each is unpacked once
    fmu_ = &loaded.try_emplace(archive_, archive_, request_.version).first->second;
    reference_ = in_process(request_);
  }

  void excite(Driver& d, int number) const {
    std::size_t channel = 0;
    for (const Variable& v : reference_.variables) {
      if (v.role != Role::kInput || v.kind() != Kind::kReal) continue;
      const std::vector<double> values = excitation(v, channel, number);
      ASSERT_EQ(d.set(references(reference_.variables, v.name, request_.version), std::span<const double>(values)), 0)
          << d.last_message();
      channel += v.size();
    }
  }
  void excite(Instance& instance, int number) const {
    std::size_t channel = 0;
    for (const Variable& v : instance.variables) {
      if (v.role != Role::kInput || v.kind() != Kind::kReal) continue;
      const std::vector<double> values = excitation(v, channel, number);
      std::copy(values.begin(), values.end(), v.reals().begin());
      channel += v.size();
    }
  }

  /// The value of a variable as text with all bits.
  template <class T>
  static void append(std::string& text, const T& value) {
    if constexpr (std::is_same_v<T, std::string>) {
      text += value;
    } else {
      text.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    text += ';';
  }
  static std::string bits(const Variable& v) {
    std::string text;
    std::visit(
        [&](auto all) {
          for (const auto& value : all) append(text, value);
        },
        v.storage);
    return text;
  }
  std::string bits(Driver& d, const Variable& v) const {
    std::string text;
    const std::vector<unsigned> refs = references(reference_.variables, v.name, request_.version);
    const auto read = [&](auto& values) {
      EXPECT_EQ(d.get(refs, std::span(values)), 0) << v.name << ": " << d.last_message();
      for (const auto& value : values) append(text, value);
    };
    switch (v.kind()) {
      case Kind::kReal: {
        std::vector<double> values(v.size());
        read(values);
        break;
      }
      case Kind::kInteger: {
        std::vector<std::int32_t> values(v.size());
        read(values);
        break;
      }
      case Kind::kBoolean: {
        std::array<bool, 64> room{};
        std::span<bool> values = std::span(room).first(v.size());
        read(values);
        break;
      }
      case Kind::kString: {
        std::vector<std::string> values(v.size());
        read(values);
        break;
      }
    }
    return text;
  }

  static std::int64_t length(int number) { return number % 3 == 2 ? kStep / 2 : kStep; }

  /// Steps from step `begin` to `end`, starting at `now` ns, which it advances. Returns every output and state after each step.
  std::vector<std::string> run(Driver& d, int begin, int end, std::int64_t& now) const {
    std::vector<std::string> trace;
    for (int i = begin; i < end; ++i) {
      excite(d, i);
      EXPECT_EQ(d.step(static_cast<double>(now) * 1e-9, static_cast<double>(length(i)) * 1e-9), 0) << d.last_message();
      now += length(i);
      std::string all;
      for (const Variable& v : reference_.variables) {
        if (v.role == Role::kOutput || v.role == Role::kState) all += bits(d, v);
      }
      trace.push_back(std::move(all));
    }
    return trace;
  }
  std::vector<std::string> run(Driver& d, int steps) const {
    excite(d, 0);
    d.initialise();
    std::int64_t now = 0;
    return run(d, 0, steps, now);
  }

  TemporaryFolder folder_;
  PackRequest request_;
  fs::path archive_;
  const LoadedFmu* fmu_ = nullptr;
  Instance reference_;
};

/// What depends on the unit and not on its settings.
class ExportedLibraries : public ExportedUnits {};

TEST_P(ExportedUnits, HasADescriptionThatFollowsTheStandard) {
  const auto standard = request_.version == Version::k2 ? cotwin::testing::Standard::kFmi2 : cotwin::testing::Standard::kFmi3;
  const std::string xml = testing::read_text(fmu_->folder() / "modelDescription.xml");
  EXPECT_THAT(cotwin::testing::faults(xml, standard), ::testing::IsEmpty());
}

TEST_P(ExportedUnits, HasADescriptionThatTheSchemaAccepts) {
  const bool two = request_.version == Version::k2;
  const fs::path schema = fs::path(places::public_data("schemas")) /
                          (two ? "fmi2/fmi2ModelDescription.xsd" : "fmi3-3.0.2/fmi3ModelDescription.xsd");
  if (!fs::exists(schema)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  EXPECT_EQ(cotwin::testing::schema_errors(schema, fmu_->folder() / "modelDescription.xml"), "");
}

TEST_P(ExportedUnits, GivesTheBitsOfTheUnitInProcess) {
  Driver d(*fmu_);
  ASSERT_TRUE(d.alive()) << d.last_message();
  Instance alone = in_process(request_);
  for (const Variable& v : alone.variables) {  // a packed file has another name, and the unit still finds it
    if (v.kind() != Kind::kString && v.role != Role::kOutput) {
      EXPECT_EQ(bits(d, v), bits(v)) << v.name << " starts differently";
    }
  }
  excite(alone, 0);
  alone.unit->initialise(Time{});
  excite(d, 0);
  d.initialise();
  std::int64_t now = 0;
  for (int i = 0; i < 150; ++i) {
    excite(alone, i);
    ASSERT_EQ(alone.unit->step(Time{now}, Duration{length(i)}), StepResult::kDone);
    excite(d, i);
    ASSERT_EQ(d.step(static_cast<double>(now) * 1e-9, static_cast<double>(length(i)) * 1e-9), 0) << d.last_message();
    now += length(i);
    for (const Variable& v : alone.variables) {
      if (v.role != Role::kOutput && v.role != Role::kState) continue;
      if (v.name == "warning") continue;  // names files that are elsewhere
      ASSERT_EQ(bits(d, v), bits(v)) << v.name << " differs after step " << i;
    }
  }
}

TEST_P(ExportedUnits, GivesTheSameTrajectoryAfterAReset) {
  Driver d(*fmu_);
  const auto first = run(d, 60);
  ASSERT_EQ(d.reset(), 0) << d.last_message();
  EXPECT_EQ(run(d, 60), first);
}

TEST_P(ExportedUnits, GoesOnFromASavedStateHereAndInAFreshInstance) {
  if (!reference_.unit->restorable()) {  // has effects outside: nobody may take its steps back
    EXPECT_EQ(testing::read_text(fmu_->folder() / "modelDescription.xml")
                  .find(request_.version == Version::k2 ? "canGetAndSetFMUstate=\"true\"" : "canGetAndSetFMUState=\"true\""),
              std::string::npos);
    return;
  }
  Driver d(*fmu_);
  run(d, 37);
  std::int64_t now = 0;
  for (int i = 0; i < 37; ++i) now += length(i);
  void* state = nullptr;
  ASSERT_EQ(d.save(&state), 0) << d.last_message();
  std::int64_t t = now;
  const auto expected = run(d, 37, 90, t);

  ASSERT_EQ(d.restore(state), 0) << d.last_message();
  t = now;
  EXPECT_EQ(run(d, 37, 90, t), expected);

  Driver fresh(*fmu_);
  void* taken = nullptr;
  const std::vector<char> bytes = d.serialise(state);
  ASSERT_EQ(fresh.deserialise(bytes, &taken), 0) << fresh.last_message();
  ASSERT_EQ(fresh.restore(taken), 0) << fresh.last_message();
  t = now;
  EXPECT_EQ(run(fresh, 37, 90, t), expected);
}

TEST_P(ExportedUnits, ShareNothingBetweenInstancesAndThreads) {
  Driver alone(*fmu_);
  const auto expected = run(alone, 30);
  std::vector<std::unique_ptr<Driver>> drivers;
  for (int i = 0; i < 8; ++i) drivers.push_back(std::make_unique<Driver>(*fmu_));
  std::vector<std::vector<std::string>> traces(4);
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < traces.size(); ++k) {
    threads.emplace_back([&, k] {
      for (std::size_t i = k; i < drivers.size(); i += traces.size()) traces[k] = run(*drivers[i], 30);
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& trace : traces) EXPECT_EQ(trace, expected);
}

TEST_P(ExportedUnits, GivesTheDerivativesOfOutputsThatTheUnitDeclares) {
  Driver d(*fmu_);
  run(d, 20);
  int known = 0;
  for (const Variable& v : reference_.variables) {
    if (v.derivative_of.empty()) continue;
    const std::vector<unsigned> of = references(reference_.variables, v.derivative_of, request_.version);
    std::vector<int> orders(of.size(), 1);
    std::vector<double> values(v.size());
    ASSERT_EQ(d.output_derivatives(of, orders, values), 0) << d.last_message();
    std::string text;
    for (const double value : values) append(text, value);
    EXPECT_EQ(text, bits(d, v));
    orders.back() = 2;
    EXPECT_EQ(d.output_derivatives(of, orders, values), 3);
    EXPECT_THAT(d.last_message(), ::testing::HasSubstr("expected 1"));
    ++known;
  }
  const std::string xml = read_archive_file(archive_, "modelDescription.xml");
  EXPECT_EQ(xml.find("maxOutputDerivativeOrder=\"1\"") != std::string::npos, known > 0);
  // In FMI 3 the rates of inputs are derivatives, too.
  const bool rates = request_.version == Version::k3 &&
                     std::ranges::any_of(reference_.variables, [](const Variable& v) { return !v.rate.empty(); });
  EXPECT_EQ(xml.find(" derivative=\"") != std::string::npos, known > 0 || rates);
}

// Compares with the blocks of the unit itself, which its own tests compare with differences.
TEST_P(ExportedUnits, GivesTheDirectionalDerivativesOfTheUnit) {
  Driver d(*fmu_);
  const std::span<const Partial> list = reference_.unit->partials();
  const std::string xml = read_archive_file(archive_, "modelDescription.xml");
  const bool two = request_.version == Version::k2;
  const std::string flag = two ? "providesDirectionalDerivative=\"true\"" : "providesDirectionalDerivatives=\"true\"";
  EXPECT_EQ(xml.find(flag) != std::string::npos, !list.empty());
  if (list.empty()) {
    run(d, 1);
    EXPECT_EQ(d.directional({}, {}, {}, {}), 3);
    return;
  }
  EXPECT_EQ(d.directional({}, {}, {}, {}), 3);  // before Initialization Mode
  run(d, 20);
  excite(reference_, 0);
  reference_.unit->initialise(Time{});
  std::int64_t now = 0;
  for (int i = 0; i < 20; ++i) {
    excite(reference_, i);
    ASSERT_EQ(reference_.unit->step(Time{now}, Duration{length(i)}), StepResult::kDone);
    now += length(i);
  }
  // All unknowns by all knowns: J from the blocks
  const Variables& variables = reference_.variables;
  std::vector<const Variable*> unknowns, knowns;
  std::vector<unsigned> unknown_references, known_references;
  std::size_t rows = 0, columns = 0, size = 0;
  const auto add = [&](const char* name, auto& to, std::vector<unsigned>& refs, std::size_t& n) {
    const Variable* v = &variables.at(name);
    if (std::find(to.begin(), to.end(), v) != to.end()) return;
    to.push_back(v);
    for (const unsigned r : references(variables, name, request_.version)) refs.push_back(r);
    n += v->size();
  };
  for (const Partial& p : list) {
    add(p.unknown, unknowns, unknown_references, rows);
    add(p.known, knowns, known_references, columns);
    const std::size_t m = variables.at(p.unknown).size(), n = variables.at(p.known).size();
    size += p.elementwise ? m : m * n;
  }
  std::vector<double> values(size), J(rows * columns);
  reference_.unit->evaluate_partials(values);
  std::size_t at = 0;
  for (const Partial& p : list) {
    std::size_t row = 0, column = 0;
    for (const auto* v : unknowns) {
      if (v->name == p.unknown) break;
      row += v->size();
    }
    for (const auto* v : knowns) {
      if (v->name == p.known) break;
      column += v->size();
    }
    const std::size_t m = variables.at(p.unknown).size(), n = variables.at(p.known).size();
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        if (!p.elementwise || i == j) J[(row + i) * columns + column + j] = values[at + (p.elementwise ? i : i * n + j)];
      }
    }
    at += p.elementwise ? m : m * n;
  }
  std::vector<double> seed(columns), sensitivity(rows), expected(rows);
  for (std::size_t j = 0; j < columns; ++j) seed[j] = std::sin(1.0 + static_cast<double>(j));
  double size_of_sums = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      expected[i] += J[i * columns + j] * seed[j];
      size_of_sums = std::max(size_of_sums, std::abs(J[i * columns + j]));
    }
  }
  ASSERT_EQ(d.directional(unknown_references, known_references, seed, sensitivity), 0) << d.last_message();
  for (std::size_t i = 0; i < rows; ++i) EXPECT_NEAR(sensitivity[i], expected[i], 1e-12 * size_of_sums) << i;
  // Also in Initialization Mode
  Driver initialising(*fmu_);
  excite(initialising, 0);
  ASSERT_EQ(initialising.enter_initialisation(), 0);
  EXPECT_EQ(initialising.directional(unknown_references, known_references, seed, sensitivity), 0)
      << initialising.last_message();
  if (two) return;
  // wᵀ (J s) = (Jᵀ w)ᵀ s
  std::vector<double> w(rows), transposed(columns);
  for (std::size_t i = 0; i < rows; ++i) w[i] = std::cos(2.0 * static_cast<double>(i));
  ASSERT_EQ(d.adjoint(unknown_references, known_references, w, transposed), 0) << d.last_message();
  double left = 0, right = 0;
  for (std::size_t i = 0; i < rows; ++i) left += w[i] * expected[i];
  for (std::size_t j = 0; j < columns; ++j) right += transposed[j] * seed[j];
  EXPECT_NEAR(left, right, 1e-11 * size_of_sums * static_cast<double>(rows));
  EXPECT_EQ(d.adjoint(unknown_references, known_references, std::span(w).first(rows - 1), transposed), 3);
  EXPECT_THAT(d.last_message(), ::testing::HasSubstr("a seed of"));
}

TEST_P(ExportedLibraries, RunAsHundredsOfInstancesInSeveralThreads) {
  Driver alone(*fmu_);
  const auto expected = run(alone, 5);
  constexpr std::size_t kInstances = 200, kThreads = 6;
  std::vector<std::unique_ptr<Driver>> drivers(kInstances);
  std::vector<std::size_t> wrong(kThreads);
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < kThreads; ++k) {  // all exist at the same time
    threads.emplace_back([&, k] {
      for (std::size_t i = k; i < kInstances; i += kThreads) {
        drivers[i] = std::make_unique<Driver>(*fmu_);
        wrong[k] += run(*drivers[i], 5) != expected;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::size_t n : wrong) EXPECT_EQ(n, 0u);
}

TEST_P(ExportedLibraries, PackToTheSameBytesAgain) {
  setenv("SOURCE_DATE_EPOCH", "1700000000", 1);
  pack_unit(request_, folder_.path() / "a.fmu");
  pack_unit(request_, folder_.path() / "b.fmu");
  unsetenv("SOURCE_DATE_EPOCH");
  const auto read = [](const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_TRUE(read(folder_.path() / "a.fmu") == read(folder_.path() / "b.fmu"));
  EXPECT_THAT(read_archive_file(folder_.path() / "a.fmu", "modelDescription.xml"),
              ::testing::HasSubstr("generationDateAndTime=\"2023-11-14T22:13:20Z\""));
}

TEST_P(ExportedLibraries, StandAlone) {
  const std::string symbols = run_command({"nm", "-D", "--defined-only", fmu_->library()}).out;
  EXPECT_THAT(symbols, ::testing::HasSubstr(" T fmi2DoStep"));
  EXPECT_THAT(symbols, ::testing::HasSubstr(" T fmi3DoStep"));
  std::istringstream lines(symbols);
  for (std::string address, kind, name; lines >> address >> kind >> name;) {
    EXPECT_EQ(kind, "T") << name;
    EXPECT_TRUE(name.starts_with("fmi2") || name.starts_with("fmi3")) << name;
  }
  if (std::string(COTWIN_SANITIZERS).size() > 0) GTEST_SKIP() << "sanitizers need their library";
  EXPECT_THAT(run_command({"readelf", "--wide", "--syms", fmu_->library()}).out,
              ::testing::Not(::testing::HasSubstr("UNIQUE")));
}

TEST_P(ExportedLibraries, LoadWhereverGlibcIs228OrNewer) {
  if (std::string(COTWIN_SANITIZERS).size() > 0) GTEST_SKIP() << "sanitizers need their library";
  testing::expect_loads_with_old_glibc(fmu_->library(), run_command({"objdump", "-T", fmu_->library()}).out);
}

TEST_P(ExportedLibraries, HaveNoPathsOfThisMachineInTheArchive) {
  for (const ArchiveEntry& entry : list_archive(archive_)) {
    if (entry.name.ends_with(".so") || entry.name.starts_with("documentation/licenses/")) continue;
    const std::string content = read_archive_file(archive_, entry.name);
    EXPECT_EQ(content.find(places::source()), std::string::npos) << entry.name;
  }
}

// A symbol that old systems lack is an error when a unit is linked: here arc4random, of glibc 2.36.
TEST(OldGlibc, LacksNewerSymbols) {
  const std::string folder = COTWIN_OLD_GLIBC;
  if (folder.empty()) GTEST_SKIP() << "exported units are linked against this machine's glibc";
  const TemporaryFolder sources;
  const auto link = [&](const std::string& call) {
    std::ofstream(sources.path() / "x.c") << "#include <math.h>\n#include <stdlib.h>\ndouble f(double x) { return " << call
                                          << "; }\n";
    const fs::path library = sources.path() / "x.so";
    const std::string errors = run_command({COTWIN_C_COMPILER, "-fPIC", "-shared", "-Wl,--no-undefined", "-L" + folder, "-o",
                                            library, sources.path() / "x.c", "-lm"})
                                   .err;
    return errors.empty() ? "needs glibc " + read_elf(library).oldest_glibc : errors;
  };
  // hypot also has a version of glibc 2.35; the oldest version is that of the first glibc for this architecture.
  EXPECT_THAT(link("hypot(x, 1)"), ::testing::AnyOf("needs glibc 2.2.5", "needs glibc 2.17"));
  EXPECT_THAT(link("arc4random()"), ::testing::HasSubstr("undefined reference to `arc4random'"));
}

INSTANTIATE_TEST_SUITE_P(Fmi, ExportedUnits, ::testing::ValuesIn(subjects(true)), name_of);
INSTANTIATE_TEST_SUITE_P(Fmi, ExportedLibraries, ::testing::ValuesIn(subjects(false)), name_of);

}  // namespace
}  // namespace cotwin::fmu::exported_units_test
