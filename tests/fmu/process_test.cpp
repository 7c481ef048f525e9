// FMUs in a process of their own.
#include <dirent.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "models/text/error.h"
#include "tests/fmu/foreign.h"

namespace cotwin::fmu {
namespace {

using namespace testing;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

enum { kPolite, kError, kCrash, kHang };

class OwnProcess : public ::testing::Test {
 protected:
  Instance load_rogue(int mode, double timeout = 60) {
    LoadOptions options;
    options.process = "own";
    options.timeout = timeout;
    Instance instance = load(make_fmu("rogue2", folder_.path()), options);
    integer(instance, "mode") = mode;
    return instance;
  }
  TemporaryFolder folder_;
};

std::size_t open_files() {
  std::size_t n = 0;
  DIR* folder = opendir("/proc/self/fd");
  while (readdir(folder) != nullptr) ++n;
  closedir(folder);
  return n;
}

bool has_children() { return waitpid(-1, nullptr, WNOHANG) != -1; }

constexpr const char* kPosition = "der(position of \"it\").y";

TEST_F(OwnProcess, GivesTheSameBitsAsInThisOne) {
  for (const char* name : {"rogue2", "rogue3", "ball2", "ball3"}) {
    const std::filesystem::path archive = make_fmu(name, folder_.path());
    LoadOptions own;
    own.process = "own";
    Instance here = load(archive), there = load(archive, own);
    EXPECT_EQ(here.variables.fingerprint(), there.variables.fingerprint());
    for (Instance* i : {&here, &there}) {
      i->unit->initialise({});
      for (int n = 0; n < 100; ++n) {
        real(*i, "u") = 0.1 * n;
        if (i->variables.find("text") != nullptr) i->variables.at("text").strings()[0] = std::to_string(n);
        ASSERT_EQ(step(*i, n * 0.01, 0.01), StepResult::kDone);
      }
    }
    Snapshot a, b;
    a.take(here.variables);
    b.take(there.variables);
    EXPECT_EQ(a, b) << name;
  }
}

TEST_F(OwnProcess, CarriesErrorsAndGoesOnAfterThem) {
  Instance instance = load_rogue(kError);
  instance.unit->initialise({});
  EXPECT_THAT([&] { (void)step(instance, 0, 1); }, ThrowsMessage<Error>(HasSubstr("the sum does not converge")));
  integer(instance, "mode") = kPolite;
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 1), StepResult::kDone);
}

TEST_F(OwnProcess, TurnsACrashIntoAnErrorAndCanBeginAfresh) {
  Instance instance = load_rogue(kCrash);
  instance.unit->initialise({});
  real(instance, "u") = 1;
  EXPECT_EQ(run(instance, 0, 0.9, 0.1), StepResult::kDone);
  EXPECT_THAT(
      [&] { (void)step(instance, 0.9, 0.1); },
      ThrowsMessage<Error>(AnyOf(HasSubstr("rogue2.fmu: the FMU's own process was ended by signal 11 (Segmentation fault)"),
                                 HasSubstr("exited with status"))));  // the latter by a sanitizer's handler
  EXPECT_NEAR(real(instance, kPosition), 0.9, 1e-12);                 // what was known before stays known
  EXPECT_THAT([&] { (void)step(instance, 0.9, 0.1); }, ThrowsMessage<Error>(HasSubstr("has ended")));
  integer(instance, "mode") = kPolite;
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 1), StepResult::kDone);
}

TEST_F(OwnProcess, TurnsAHangIntoAnErrorWithinItsTime) {
  Instance instance = load_rogue(kHang, 0.3);
  instance.unit->initialise({});
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_THAT([&] { (void)step(instance, 0, 1); }, ThrowsMessage<Error>(HasSubstr("gave no answer for 0.3 s")));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
}

TEST_F(OwnProcess, TellsAtOnceWhatCannotBeLoaded) {
  LoadOptions options;
  options.process = "own";
  options.instance_name = "refused";
  EXPECT_THAT([&] { load(make_fmu("rogue2", folder_.path()), options); }, ThrowsMessage<Error>(HasSubstr("100% sure")));
}

TEST_F(OwnProcess, CarriesStatesFromOneProcessToAnother) {
  Instance one = load_rogue(kPolite), other = load_rogue(kPolite);
  one.unit->initialise({});
  real(one, "u") = 0.3;
  ASSERT_EQ(run(one, 0, 0.5, 0.1), StepResult::kDone);
  Snapshot snapshot;
  snapshot.take(one.variables, *one.unit);
  snapshot.restore(other.variables, *other.unit);
  ASSERT_EQ(run(one, 0.5, 1, 0.1), StepResult::kDone);
  ASSERT_EQ(run(other, 0.5, 1, 0.1), StepResult::kDone);
  EXPECT_EQ(real(one, kPosition), real(other, kPosition));
}

TEST_F(OwnProcess, LeavesNoProcessFileOrFolderBehind) {
  const std::size_t files = open_files(), folders = temporary_folders();
  for (int i = 0; i < 50; ++i) {
    Instance instance = load_rogue(i % 2 == 0 ? kPolite : kCrash);
    instance.unit->initialise({});
    if (i % 2 == 1) {
      EXPECT_THROW((void)step(instance, 0, 1), Error);
    }
  }
  EXPECT_EQ(open_files(), files);
  EXPECT_EQ(temporary_folders(), folders);
  EXPECT_FALSE(has_children());
}

// The hanging FMU of a program that is killed ends with it.
TEST_F(OwnProcess, EndsWithItsParent) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t parent = fork();
  if (parent == 0) {
    close(ends[0]);  // the other end stays open here, and in no child of this
    Instance instance = load_rogue(kHang, 1000);
    instance.unit->initialise({});
    std::thread([] { std::this_thread::sleep_for(std::chrono::milliseconds(300)), kill(getpid(), SIGKILL); }).detach();
    (void)step(instance, 0, 1);
    _exit(1);
  }
  close(ends[1]);
  int status = 0;
  ASSERT_EQ(waitpid(parent, &status, 0), parent);
  EXPECT_TRUE(WIFSIGNALED(status));
  std::size_t left = 1;
  for (int i = 0; i < 100 && left > 0; ++i) {  // the child notices on its own time
    left = 0;
    for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
      const std::string name = entry.path().filename().string();
      if (name.find_first_not_of("0123456789") != std::string::npos) continue;
      std::ifstream maps(entry.path() / "maps");
      for (std::string line; std::getline(maps, line);) {
        if (line.find(private_temporaries.path().string()) != std::string::npos) {
          ++left;
          break;
        }
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_EQ(left, 0u);
  close(ends[0]);
}

}  // namespace
}  // namespace cotwin::fmu
