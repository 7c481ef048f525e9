// Loading: hostile archives, missing parts of FMUs, and no files left behind.
#include <dirent.h>
#include <fcntl.h>
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include <cctype>
#include <cstdio>
#include <cstring>
#include <map>
#include <sstream>
#include <thread>

#include "fmu/check/check.h"
#include "fmu/check/elf.h"
#include "fmu/import/fmu_store.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::fmu::load_test {
namespace {

namespace fs = std::filesystem;
using namespace testing;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

class Load : public ::testing::Test {
 protected:
  /// An archive of these files, with names that write_archive would refuse, too.
  fs::path raw_archive(const std::vector<std::pair<std::string, std::string>>& files) {
    const fs::path path = folder_.path() / "raw.fmu";
    fs::remove(path);
    int error = 0;
    zip_t* zip = zip_open(path.c_str(), ZIP_CREATE, &error);
    for (const auto& [name, content] : files) {
      zip_file_add(zip, name.c_str(), zip_source_buffer(zip, content.data(), content.size(), 0), ZIP_FL_ENC_UTF_8);
    }
    zip_close(zip);
    return path;
  }
  void expect_refusal(const fs::path& path, const std::string& why) {
    const std::size_t before = temporary_folders();
    EXPECT_THAT([&] { load(path); }, ThrowsMessage<Error>(HasSubstr(why)));
    EXPECT_EQ(temporary_folders(), before);
  }
  TemporaryFolder folder_;
};

TEST_F(Load, RefusesHostileArchivesAndLeavesNothingOnTheDisk) {
  const std::string xml = description_of("rogue2");
  expect_refusal(raw_archive({{"modelDescription.xml", xml}, {"../outside.txt", "x"}}), "leads outside the archive's folder");
  expect_refusal(raw_archive({{"modelDescription.xml", xml}, {"/etc/outside.txt", "x"}}), "is absolute");
  expect_refusal(raw_archive({{"modelDescription.xml", xml}, {"resources/zeros", std::string(64u << 20, '\0')}}), "raw.fmu");
  expect_refusal(raw_archive({{"readme.txt", "no FMU"}}), "modelDescription.xml");
  expect_refusal(raw_archive({{"modelDescription.xml", "<fmiModelDescription"}}), "modelDescription.xml:1");
  expect_refusal(raw_archive({{"modelDescription.xml", xml}}),
                 "no library for this platform, expected binaries/linux64/rogue.so; the FMU has binaries for no platform");
  expect_refusal(raw_archive({{"modelDescription.xml", xml}, {"binaries/win64/rogue.dll", "x"}, {"sources/a.c", "x"}}),
                 "has binaries for win64, and sources");
  expect_refusal(raw_archive({{"modelDescription.xml", xml}, {"binaries/linux64/rogue.so", "no library"}}),
                 "rogue.so: cannot be loaded");
  expect_refusal(folder_.path() / "none.fmu", "no such file");
  std::string bytes = read_text(make_fmu("rogue2", folder_.path()));
  for (const std::size_t length : {bytes.size() / 2, bytes.size() - 30, std::size_t{10}, std::size_t{0}}) {
    std::ofstream(folder_.path() / "cut.fmu", std::ios::binary) << bytes.substr(0, length);
    expect_refusal(folder_.path() / "cut.fmu", "cut.fmu");
  }
}

TEST_F(Load, RefusesFmi1AndKindsThatAreNotThere) {
  expect_refusal(raw_archive({{"modelDescription.xml", "<fmiModelDescription fmiVersion=\"1.0\"/>"}}),
                 "raw.fmu: modelDescription.xml:1: FMI 1.0 is not supported");
  LoadOptions options;
  options.kind = InterfaceChoice::kModelExchange;
  EXPECT_THAT([&] { load(make_fmu("rogue2", folder_.path()), options); },
              ThrowsMessage<Error>(HasSubstr("the FMU offers Co-Simulation, expected Model Exchange")));
  EXPECT_THAT([] { read_query("kind=xx", {}); }, ThrowsMessage<Error>("kind: 'xx', expected one of any, cs, me"));
  EXPECT_THAT([] { read_query("process=xx", {}); }, ThrowsMessage<Error>("process: 'xx', expected one of auto, shared, own"));
}

TEST_F(Load, NamesTheFunctionsThatALibraryLacks) {
  const fs::path path =
      raw_archive({{"modelDescription.xml", replaced(description_of("rogue2"), "CoSimulation model", "ModelExchange model")},
                   {"binaries/linux64/rogue.so", read_text(fs::path(places::foreign_libraries()) / "rogue2.so")}});
  expect_refusal(path, "rogue.so: lacks the functions fmi2EnterEventMode, fmi2NewDiscreteStates, fmi2EnterContinuousTimeMode");
}

TEST_F(Load, TakesAnUnpackedFolderToo) {
  const TemporaryFolder unpacked = unpack_archive(make_fmu("rogue2", folder_.path()));
  Instance instance = load(unpacked.path());
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 0.1), StepResult::kDone);
}

TEST_F(Load, ReadsItsSettingsFromAQuery) {
  EXPECT_EQ(read_query("stop=-1", {}).stop, -1);  // of a run that starts before 0
  const LoadOptions o = read_query("kind=me&process=own&timeout=2.5&tolerance=1e-4&locals=false&structural.n=4", {});
  EXPECT_EQ(o.kind, InterfaceChoice::kModelExchange);
  EXPECT_EQ(o.process, ProcessChoice::kOwn);
  EXPECT_EQ(o.timeout, 2.5);
  EXPECT_EQ(o.tolerance, 1e-4);
  EXPECT_FALSE(o.locals);
  EXPECT_EQ(o.structural.at("n"), 4u);
  EXPECT_THAT([] { read_query("kid=me", {}); }, ThrowsMessage<Error>(HasSubstr("'kid': not a setting of an FMU")));
  EXPECT_THROW(read_query("timeout=-1", {}), Error);
  EXPECT_THROW(read_query("locals=maybe", {}), Error);
}

TEST_F(Load, LeavesOutLocalsWhereTheyAreNotWanted) {
  LoadOptions options;
  options.locals = false;
  const Instance instance = load(make_fmu("rogue2", folder_.path()), options);
  EXPECT_EQ(instance.variables.find("y in mm"), nullptr);
  EXPECT_NE(instance.variables.find("reversed"), nullptr);
}

constexpr const char* kKind = "<CoSimulation ";
constexpr const char* kOnlyOnce = "<CoSimulation canBeInstantiatedOnlyOncePerProcess=\"true\" ";

TEST_F(Load, LoadsTheLibraryOfAHundredInstancesOnce) {
  const fs::path fmu = make_fmu("rogue2", folder_.path());
  fs::create_symlink(fmu, folder_.path() / "link.fmu");
  const std::size_t folders = temporary_folders();
  FmuStore store;
  std::vector<Instance> instances;
  for (int i = 0; i < 100; ++i)
    instances.push_back(load(store.open(i % 2 == 0 ? fmu : folder_.path() / "link.fmu", {}), LoadOptions{}));
  EXPECT_EQ(mapped_libraries("rogue.so"), 1u);
  EXPECT_EQ(temporary_folders(), folders + 1);
  for (Instance& instance : instances) instance.unit->initialise({});
  for (std::size_t i = 0; i < instances.size(); ++i) {
    real(instances[i], "u") = static_cast<double>(i);
    ASSERT_EQ(step(instances[i], 0, 0.1), StepResult::kDone);
  }
  for (std::size_t i = 0; i < instances.size(); ++i)
    EXPECT_NEAR(real(instances[i], "der(position of \"it\").y"), 0.1 * static_cast<double>(i), 1e-10);
  instances.erase(instances.begin(), instances.begin() + 99);  // the last one keeps library and files
  EXPECT_EQ(mapped_libraries("rogue.so"), 1u);
  ASSERT_EQ(step(instances.front(), 0.1, 0.1), StepResult::kDone);
  instances.clear();
  EXPECT_EQ(mapped_libraries("rogue.so"), 0u);
}

TEST_F(Load, GivesEachInstanceALibraryOfItsOwnWhereAProcessMayHoldOneOnly) {
  const fs::path fmu = make_fmu("rogue2", folder_.path(), {{kKind, kOnlyOnce}});
  const TemporaryFolder unpacked = unpack_archive(fmu);
  for (const fs::path& path : {fmu, unpacked.path()}) {
    const std::size_t folders = temporary_folders();
    {
      FmuStore store;
      std::vector<Instance> instances;
      for (int i = 0; i < 3; ++i) {
        instances.push_back(load(store.open(path, {}), LoadOptions{}));
        instances.back().unit->initialise({});
      }
      EXPECT_EQ(mapped_libraries("rogue.so"), 3u) << path;
    }
    EXPECT_EQ(mapped_libraries("rogue.so"), 0u);
    EXPECT_EQ(temporary_folders(), folders);
    EXPECT_TRUE(fs::exists(unpacked.path() / "modelDescription.xml"));
  }
  LoadOptions own;
  own.process = ProcessChoice::kOwn;
  FmuStore store;
  EXPECT_EQ(store.open(fmu, own), store.open(fmu, own)) << "each process loads the files itself";
}

TEST_F(Load, RemovesFilesOfKilledProgramsAndNothingElse) {
  const fs::path root = fs::temp_directory_path();
  const auto make = [&](const char* name, bool old) {
    fs::create_directories(root / name / "binaries");
    if (!old) return;
    const timespec past[2] = {{0, 0}, {1'000'000'000, 0}};
    ASSERT_EQ(utimensat(AT_FDCWD, (root / name).c_str(), past, 0), 0);
  };
  make("cotwin-1234-dead01", true);
  make("cotwin-1234-live01", true);
  make("cotwin-1234-young1", false);
  make("cotwin-somethingelse", true);
  const int lock = open((root / "cotwin-1234-live01").c_str(), O_RDONLY | O_DIRECTORY);
  ASSERT_EQ(flock(lock, LOCK_EX | LOCK_NB), 0);
  sweep_temporary_folders();
  EXPECT_FALSE(fs::exists(root / "cotwin-1234-dead01"));
  EXPECT_TRUE(fs::exists(root / "cotwin-1234-live01"));
  EXPECT_TRUE(fs::exists(root / "cotwin-1234-young1"));
  EXPECT_TRUE(fs::exists(root / "cotwin-somethingelse"));
  EXPECT_TRUE(fs::exists(folder_.path()));
  close(lock);
  for (const char* name : {"cotwin-1234-live01", "cotwin-1234-young1", "cotwin-somethingelse"}) fs::remove_all(root / name);
}

std::size_t open_files() {
  std::size_t n = 0;
  DIR* folder = opendir("/proc/self/fd");
  while (readdir(folder) != nullptr) ++n;
  closedir(folder);
  return n;
}

TEST_F(Load, LeaksNeitherMemoryNorFilesNorFoldersInAThousandLoads) {
  const fs::path rogue = make_fmu("rogue2", folder_.path()), ball = make_fmu("ball3", folder_.path());
  LoadOptions refused;
  refused.instance_name = "refused";
  const auto round = [&] {
    for (const fs::path& path : {rogue, ball}) {
      Instance instance = load(path, read_query("rollback=true", {}));  // the states of the ball stay in it
      instance.unit->initialise({});
      Snapshot snapshot;
      snapshot.take(instance.variables, *instance.unit);
      ASSERT_EQ(run(instance, 0, 0.1, 0.05), StepResult::kDone);
      snapshot.restore(instance.variables, *instance.unit);
    }
    EXPECT_THROW(load(rogue, refused), Error);
  };
  for (int i = 0; i < 20; ++i) round();
  const std::size_t files = open_files(), folders = temporary_folders(), heap = mallinfo2().uordblks;
  const int rounds = std::string(COTWIN_SANITIZERS).empty() ? 350 : 40;
  for (int i = 0; i < rounds; ++i) round();
  EXPECT_EQ(open_files(), files);
  EXPECT_EQ(temporary_folders(), folders);
  EXPECT_LT(mallinfo2().uordblks, heap + 20'000);  // a leak of one byte per variable would exceed it
}

TEST_F(Load, WorksFromSeveralThreadsAtOnce) {
  const fs::path rogue = make_fmu("rogue2", folder_.path());
  std::vector<std::thread> threads;
  std::vector<double> results(4);
  for (std::size_t t = 0; t < results.size(); ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 10; ++i) {
        Instance instance = load(rogue);
        instance.unit->initialise({});
        real(instance, "u") = static_cast<double>(t);
        if (run(instance, 0, 1, 0.01) != StepResult::kDone) return;
        results[t] = real(instance, "der(position of \"it\").y");
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t t = 0; t < results.size(); ++t) EXPECT_NEAR(results[t], static_cast<double>(t), 1e-10);
}

// The dynamic loader would end the program with SIGBUS, or report a missing file.
TEST_F(Load, RefusesALibraryThatIsCutShortOrForAnotherMachine) {
  const std::string xml = description_of("rogue2");
  const std::string library = read_text(fs::path(places::foreign_libraries()) / "rogue2.so");
  const auto with = [&](const std::string& bytes) {
    return raw_archive({{"modelDescription.xml", xml}, {"binaries/linux64/rogue.so", bytes}});
  };
  expect_refusal(with(library.substr(0, library.size() / 2)), "raw.fmu: rogue.so: is truncated");
  expect_refusal(with(library.substr(0, 100)), "raw.fmu: rogue.so: is truncated");
  std::string other = library;
  other[18] = '\x28';  // e_machine: 32-bit ARM
  expect_refusal(with(other), "raw.fmu: rogue.so: is for another machine, expected x86_64-linux");
}

TEST_F(Load, ChecksAnFmuWithAndWithoutLoadingIt) {
  const auto texts = [](const std::vector<Finding>& findings, Finding::Level level) {
    std::vector<std::string> all;
    for (const Finding& f : findings) {
      const bool sanitizer = !std::string(COTWIN_SANITIZERS).empty() && f.text.find("san.so.") != std::string::npos;
      if (f.level == level && !(sanitizer && level == Finding::Level::kWarning)) all.push_back(f.text);
    }
    return all;
  };
  const std::vector<Finding> good = check_fmu(make_fmu("ball3", folder_.path()), true);
  EXPECT_THAT(texts(good, Finding::Level::kError), ::testing::IsEmpty());
  EXPECT_THAT(texts(good, Finding::Level::kNote), Contains("Model Exchange: instantiated and initialised"));
  EXPECT_THAT(texts(good, Finding::Level::kNote), Contains(HasSubstr("binaries/x86_64-linux/ball.so needs glibc 2.")));
  const std::vector<Finding> ball = check_fmu(make_fmu("ball2", folder_.path()), true);
  EXPECT_THAT(texts(ball, Finding::Level::kWarning), ::testing::IsEmpty()) << "only Model Exchange";
  const std::vector<Finding> other =
      check_fmu(make_fmu("rogue2", folder_.path(), {{"guid=\"{rogue}\"", "guid=\"{x}\""}}), true);
  EXPECT_THAT(texts(other, Finding::Level::kError),
              Contains(::testing::StartsWith("Co-Simulation: rogue2.fmu: fmi2Instantiate returned no instance")));
  EXPECT_THAT(texts(other, Finding::Level::kWarning),
              Contains(HasSubstr("other tools refuse it: fmi2GetDirectionalDerivative")));
  const std::vector<Finding> empty = check_fmu(raw_archive({{"readme.txt", "no FMU"}}), true);
  ASSERT_EQ(empty.size(), 1u);
  EXPECT_EQ(empty[0].text, "raw.fmu: has no modelDescription.xml");
  const std::vector<Finding> broken = check_fmu(folder_.path() / "none.fmu", true);
  ASSERT_EQ(broken.size(), 1u);
  EXPECT_THAT(broken[0].text, HasSubstr("no such file"));
  std::ostringstream out;
  EXPECT_FALSE(write_findings(out, broken));
  EXPECT_THAT(out.str(), HasSubstr("1 error, 0 warnings"));
}

TEST_F(Load, ReportsTheKindOfAnFmu) {
  std::ostringstream out;
  write_info(out, make_fmu("rogue3", folder_.path()));
  EXPECT_THAT(out.str(),
              AllOf(HasSubstr("FMI version       3.0\n"),
                    HasSubstr("Co-Simulation     rogue, states, variable steps, event mode, early return, intermediate update"),
                    HasSubstr("Platforms         x86_64-linux"), HasSubstr("  output  y[3]  Float64")));
}

TEST(Elf, FindsExportedSymbolsAndNeededLibraries) {
  const ElfLibrary elf = read_elf(fs::path(places::foreign_libraries()) / "ball2.so");
  EXPECT_EQ(elf.machine, "x86_64");
  EXPECT_THAT(elf.exported, Contains("fmi2GetDerivatives"));
  EXPECT_THAT(elf.exported, Not(Contains("model_event")));
  EXPECT_THAT(elf.needed, Contains("libc.so.6"));
  EXPECT_THAT(elf.oldest_glibc, ::testing::StartsWith("2."));
}

// This program needs the C++ run-time library, and the glibc of the machine on which it was linked.
TEST(Elf, FindsTheNewestVersionOfEachNameAsObjdumpDoes) {
  const fs::path program = fs::read_symlink("/proc/self/exe");
  const ElfLibrary elf = read_elf(program);
  std::map<std::string, std::string> greatest;  // "GLIBCXX": "3.4.30"
  const auto listed = cotwin::testing::run_command({"objdump", "-T", program});
  ASSERT_EQ(listed.code, 0) << listed.err;
  for (const std::string& word : cotwin::testing::words(listed.out)) {
    const std::string version = word[0] == '(' ? word.substr(1, word.size() - 2) : word;
    const std::size_t number = version.rfind('_') + 1;
    if (number < 2 || !std::isdigit(static_cast<unsigned char>(version[number])) ||
        !std::isupper(static_cast<unsigned char>(version[0])))
      continue;
    std::string& known = greatest[version.substr(0, number - 1)];
    if (known.empty() || older_version(known, version.substr(number))) known = version.substr(number);
  }
  EXPECT_EQ(elf.oldest_glibc, greatest.at("GLIBC"));
  EXPECT_THAT(elf.other_versions.at("libstdc++.so.6"), Contains("GLIBCXX_" + greatest.at("GLIBCXX")));
  EXPECT_THAT(elf.other_versions.at("libstdc++.so.6"), Contains("CXXABI_" + greatest.at("CXXABI")));
  EXPECT_TRUE(older_version("2.4", "2.34"));
  EXPECT_FALSE(older_version("2.28", "2.28"));
  EXPECT_TRUE(older_version("2.3", "2.3.4"));
}

TEST(Elf, RefusesTruncatedAndDamagedFiles) {
  const TemporaryFolder folder;
  const fs::path file = folder.path() / "x.so";
  std::string bytes = read_text(fs::path(places::foreign_libraries()) / "ball2.so");
  std::uint32_t random = 1;
  for (int i = 0; i < 300; ++i) {
    std::string damaged = bytes;
    for (int k = 0; k < 20; ++k) {
      random = random * 1664525u + 1013904223u;
      damaged[(random >> 8) % damaged.size()] = static_cast<char>(random);
      if (k < 4) damaged[(random >> 8) % 64] = static_cast<char>(random >> 3);  // the header
    }
    damaged.resize(i % 3 == 0 ? (random >> 8) % damaged.size() : damaged.size());
    std::ofstream(file, std::ios::binary) << damaged;
    try {
      static_cast<void>(read_elf(file));
    } catch (const Error&) {
    }
  }
  std::ofstream(file, std::ios::binary) << "text";
  EXPECT_THROW(read_elf(file), Error);
}

}  // namespace
}  // namespace cotwin::fmu::load_test
