// FMUs in a process of their own.
#include <dirent.h>
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <string_view>
#include <thread>

#include "fmu/process/process.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"

namespace cotwin::fmu::process_test {
namespace {

using namespace testing;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

enum { kPolite, kError, kCrash, kHang };

// A sanitizer's handler turns a signal into an exit.
constexpr bool kSanitized = std::string_view(COTWIN_SANITIZERS) != "";

class OwnProcess : public ::testing::Test {
 protected:
  Instance load_rogue(int mode, double timeout = 60) {
    LoadOptions options;
    options.process = ProcessChoice::kOwn;
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

/// The number of processes, in whatever group or session, that have loaded an FMU of this test, without this process.
std::size_t processes_with_fmus() {
  std::size_t n = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != std::string::npos || name == std::to_string(getpid())) continue;
    std::ifstream maps(entry.path() / "maps");
    for (std::string line; std::getline(maps, line);) {
      if (line.find(private_temporaries.path().string()) == std::string::npos) continue;
      ++n;
      break;
    }
  }
  return n;
}

constexpr const char* kPosition = "der(position of \"it\").y";

TEST_F(OwnProcess, GivesTheSameBitsAsInThisOne) {
  for (const char* name : {"rogue2", "rogue3", "ball2", "ball3"}) {
    const std::filesystem::path archive = make_fmu(name, folder_.path());
    LoadOptions own;
    own.process = ProcessChoice::kOwn;
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

TEST_F(OwnProcess, PassesErrorsOnAndContinuesAfterThem) {
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
      ThrowsMessage<Error>(AnyOf(HasSubstr("rogue2.fmu: the FMU's own process was killed by signal 11 (Segmentation fault)"),
                                 HasSubstr("exited with status"))));  // the latter by a sanitizer's handler
  EXPECT_NEAR(real(instance, kPosition), 0.9, 1e-12);                 // known values stay known
  EXPECT_THAT([&] { (void)step(instance, 0.9, 0.1); }, ThrowsMessage<Error>(HasSubstr("has ended")));
  integer(instance, "mode") = kPolite;
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 1), StepResult::kDone);
}

TEST_F(OwnProcess, TurnsAHangIntoAnErrorWithinItsTime) {
  Instance instance = load_rogue(kHang, 0.3);
  instance.unit->initialise({});
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_THAT([&] { (void)step(instance, 0, 1); }, ThrowsMessage<Error>(HasSubstr("did not answer for 0.3 s")));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
}

TEST_F(OwnProcess, ReportsLoadingErrorsAtOnce) {
  LoadOptions options;
  options.process = ProcessChoice::kOwn;
  options.instance_name = "refused";
  EXPECT_THAT([&] { load(make_fmu("rogue2", folder_.path()), options); }, ThrowsMessage<Error>(HasSubstr("100% sure")));
}

TEST_F(OwnProcess, PassesStatesFromOneProcessToAnother) {
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

// If a program is killed, its hanging FMU ends, too.
TEST_F(OwnProcess, EndsWithItsParent) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t parent = fork();
  if (parent == 0) {
    close(ends[0]);  // the other end stays open here, and in no child of this process
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
  for (int i = 0; i < 100 && left > 0; ++i) {  // the child notices it after some time
    left = processes_with_fmus();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_EQ(left, 0u);
  close(ends[0]);
}

// When a program with threads forks, another thread may hold a lock, for example during an allocation.
TEST_F(OwnProcess, StartsBesideOtherThreads) {
  std::atomic<bool> stop{false};
  std::thread busy([&] {
    while (!stop) std::string(100'000, 'x').shrink_to_fit();
  });
  for (int i = 0; i < 10; ++i) {
    Instance instance = load_rogue(kPolite);
    instance.unit->initialise({});
    EXPECT_EQ(step(instance, 0, 1), StepResult::kDone);
  }
  stop = true;
  busy.join();
}

TEST_F(OwnProcess, ReportsAMissingHostProgram) {
  setenv("COTWIN_FMU_HOST", "/nowhere/host", 1);
  EXPECT_THAT([&] { load_rogue(kPolite); }, ThrowsMessage<Error>(HasSubstr("/nowhere/host: cannot be started: No such file")));
  unsetenv("COTWIN_FMU_HOST");
}

/// The fault of harm2, the function, and the expected message.
struct Harm {
  const char *what, *where, *message;
};
void PrintTo(const Harm& harm, std::ostream* out) { *out << harm.what << " in " << harm.where; }

class HarmfulFmu : public OwnProcess {
 protected:
  ~HarmfulFmu() override {
    unsetenv("COTWIN_HARM");
    unsetenv("COTWIN_HARM_AT");
  }
  static void choose(const Harm& harm) {
    setenv("COTWIN_HARM", harm.what, 1);
    setenv("COTWIN_HARM_AT", harm.where, 1);
  }
  Instance load_harm(double timeout = 60) {
    LoadOptions options;
    options.process = ProcessChoice::kOwn;
    options.timeout = timeout;
    options.memory = 200e6;
    return load(make_fmu("harm2", folder_.path()), options);
  }
};
class AnyHarm : public HarmfulFmu, public ::testing::WithParamInterface<Harm> {};

TEST_P(AnyHarm, IsAnErrorWithKindAndFunctionAndTheNextAttemptStartsAfresh) {
  if (kSanitized && std::string_view(GetParam().what) == "reserve") GTEST_SKIP() << "a sanitizer reserves memory itself";
  choose(GetParam());
  const bool lasts = std::string_view(GetParam().message).find("did not answer") != std::string_view::npos;
  Instance instance;
  std::string message;
  double reached = 0;
  try {
    instance = load_harm(lasts ? 1 : 60);
    instance.unit->initialise({});
    for (int i = 0; i < 10; ++i) {
      ASSERT_EQ(step(instance, i * 0.1, 0.1), StepResult::kDone);
      reached = real(instance, "y");
    }
  } catch (const Error& error) {
    message = error.what();
  }
  EXPECT_THAT(message, ::testing::StartsWith("harm2.fmu: "));
  const bool signalled = std::string_view(GetParam().message).find("signal") != std::string_view::npos;
  if (!kSanitized || !signalled) {
    EXPECT_THAT(message, HasSubstr(GetParam().message));
  }
  EXPECT_THAT(message, HasSubstr(GetParam().where == std::string("load") ? "the loading of its library" : GetParam().where));
  if (GetParam().where == std::string("fmi2DoStep")) {
    EXPECT_NEAR(reached, 0.5, 1e-12);  // known values stay known
  }
  const bool lives = message.find("threw an exception") != std::string::npos;  // then the process is usable as before
  EXPECT_EQ(has_children(), lives && instance.unit);

  choose({"nothing", "nowhere", ""});
  if (lives || !instance.unit) instance = load_harm();
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
}

const Harm kHarms[] = {
    {"exit", "fmi2DoStep", "exited with status 0 in fmi2DoStep"},
    {"exit-3", "fmi2DoStep", "exited with status 3 in fmi2DoStep"},
    {"_exit", "fmi2DoStep", "exited with status 0 in fmi2DoStep"},
    {"quick_exit", "fmi2DoStep", "exited with status 0 in fmi2DoStep"},
    {"thread-exit", "fmi2DoStep", "exited with status 0 in fmi2DoStep"},
    {"abort", "fmi2DoStep", "signal 6 (Aborted) in fmi2DoStep"},
    {"segv", "fmi2DoStep", "signal 11 (Segmentation fault) in fmi2DoStep"},
    {"bus", "fmi2DoStep", "signal 7 (Bus error) in fmi2DoStep"},
    {"fpe", "fmi2DoStep", "signal 8 (Floating point exception) in fmi2DoStep"},
    {"ill", "fmi2DoStep", "signal 4 (Illegal instruction) in fmi2DoStep"},
    {"kill", "fmi2DoStep", "signal 9 (Killed) in fmi2DoStep"},
    {"overflow", "fmi2DoStep", "signal 11 (Segmentation fault) in fmi2DoStep"},
    {"closed", "fmi2DoStep", "signal 11 (Segmentation fault) in fmi2DoStep"},
    {"throw", "fmi2DoStep", "fmi2DoStep threw an exception (the pump is dry), expected a status"},
    {"throw-int", "fmi2DoStep", "fmi2DoStep threw an exception, expected a status"},
    {"hang", "fmi2DoStep", "did not answer for 1 s in fmi2DoStep and was killed"},
    {"child", "fmi2DoStep", "did not answer for 1 s in fmi2DoStep and was killed"},
    {"flood", "fmi2DoStep", "did not answer for 1 s in fmi2DoStep and was killed; its last output was 'the valve is open'"},
    {"memory", "fmi2DoStep", "of memory"},
    {"reserve", "fmi2DoStep", "signal 6 (Aborted) in fmi2DoStep"},
    {"last words", "fmi2DoStep", "in fmi2DoStep; its last output was 'assertion failed: p > 0'"},
    {"exit", "load", "exited with status 0 in the loading of its library"},
    {"abort", "fmi2Instantiate", "signal 6 (Aborted) in fmi2Instantiate"},
    {"exit", "fmi2Instantiate", "exited with status 0 in fmi2Instantiate"},
    {"throw", "fmi2Instantiate", "fmi2Instantiate threw an exception (the pump is dry)"},
    {"segv", "fmi2EnterInitializationMode", "signal 11 (Segmentation fault) in fmi2EnterInitializationMode"},
    {"hang", "fmi2EnterInitializationMode", "did not answer for 10 s in fmi2EnterInitializationMode"},
};
INSTANTIATE_TEST_SUITE_P(Harms, AnyHarm, ::testing::ValuesIn(kHarms), [](const auto& harm) {
  std::string name = std::string(harm.param.what) + "_" + harm.param.where;
  std::erase_if(name, [](char c) { return c == ' ' || c == '-'; });
  return name;
});

TEST_F(HarmfulFmu, CrashingWhileItIsFreedIsReported) {
  for (const auto& [what, where, message] :
       {Harm{"abort", "fmi2Terminate", "fmi2Terminate"}, Harm{"exit", "fmi2FreeInstance", "fmi2FreeInstance"},
        Harm{"hang", "fmi2FreeInstance", "fmi2FreeInstance"}, Harm{"segv", "unload", "the unloading of its library"}}) {
    choose({what, where, message});
    const int before = unclean_ends();
    ::testing::internal::CaptureStderr();
    {
      Instance instance = load_harm(1);
      instance.unit->initialise({});
      EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
    }
    EXPECT_THAT(::testing::internal::GetCapturedStderr(),
                ::testing::AllOf(HasSubstr("cotwin: fmu (harm2.fmu): the FMU's own process"), HasSubstr(message)))
        << what;
    EXPECT_EQ(unclean_ends(), before + 1) << what;
    EXPECT_FALSE(has_children());
  }
}

// Also those that have left its process group.
TEST_F(HarmfulFmu, EndsWithAllProcessesThatItHasStarted) {
  for (const std::string harm : {"daemon", "daemon and exit", "child"}) {
    choose({harm.c_str(), "fmi2DoStep", ""});
    {
      Instance instance = load_harm(0.5);
      instance.unit->initialise({});
      if (harm == "daemon") {
        EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
        // It is being started, by a process that ends.
        for (int i = 0, agree = 0; i < 5000 && agree < 10; ++i) {
          agree = processes_with_fmus() == 2 ? agree + 1 : 0;
          std::this_thread::sleep_for(std::chrono::milliseconds(2));
        }
        ASSERT_EQ(processes_with_fmus(), 2u);
      } else {
        EXPECT_THROW((void)run(instance, 0, 1, 0.1), Error);
      }
    }
    EXPECT_EQ(processes_with_fmus(), 0u) << harm;
    EXPECT_FALSE(has_children());
  }
}

TEST_F(HarmfulFmu, MayWriteAnythingAndTheBeginningIsShown) {
  choose({"stdout", "fmi2DoStep", ""});
  Instance instance = load_harm();
  instance.unit->initialise({});
  ::testing::internal::CaptureStderr();
  for (int i = 0; i < 6; ++i) ASSERT_EQ(step(instance, i * 0.1, 0.1), StepResult::kDone);
  std::vector<std::string> notes;
  instance.unit->append_notes(notes);
  const std::string shown = ::testing::internal::GetCapturedStderr();
  EXPECT_THAT(shown, ::testing::StartsWith("line 0 of five thousand\nline 1 "));
  EXPECT_THAT(shown, HasSubstr("wrote more than 64 KiB to stdout and stderr; the rest is not shown"));
  EXPECT_LT(shown.size(), HostProcess::kShownBytes + 1000);
  EXPECT_THAT(notes, ::testing::ElementsAre(HasSubstr("bytes to stdout and stderr")));
}

}  // namespace
}  // namespace cotwin::fmu::process_test
