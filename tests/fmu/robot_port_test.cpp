// unit:io with a robot behind it as FMU: a simulator that knows nothing of FRI gets a robot's port. Two FMUs talk to each other, and
// one talks to the program `cotwin robot` in another process.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "tests/fmu/driver.h"
#include "tests/fmu/subjects.h"
#include "tests/support/files.h"
#include "tests/support/free_port.h"
#include "tests/support/patience.h"
#include "tests/support/run_program.h"

namespace cotwin::fmu::robot_port_test {
namespace {

using testing::Driver;
using ::testing::HasSubstr;
using testing::in_process;
using testing::LoadedFmu;
using testing::references;

constexpr std::array<double, 7> kHome{0, 0.3, 0, -1.2, 0, 0.9, 0};  // rad
constexpr double kStep = 2e-3;                                      // s

/// An exported unit with its variables by name.
class Exported {
 public:
  Exported(const std::string& source, Version version)
      : request_(testing::request_for({source, version})), reference_(in_process(request_)) {
    const auto archive = folder_.path() / "unit.fmu";
    pack_unit(request_, archive);
    fmu_ = std::make_unique<LoadedFmu>(archive, version);
    driver_ = std::make_unique<Driver>(*fmu_);
  }

  Driver& driver() { return *driver_; }
  std::string description() const { return read_archive_file(fmu_->archive(), "modelDescription.xml"); }
  template <class T>
  void set(const std::string& name, const std::vector<T>& values) {
    ASSERT_EQ(driver_->set(refs(name), std::span<const T>(values)), 0) << name << ": " << driver_->last_message();
  }
  void set(const std::string& name, const std::string& text) { set(name, std::vector<std::string>{text}); }
  std::vector<double> reals(const std::string& name) {
    std::vector<double> values(reference_.variables.at(name).size());
    EXPECT_EQ(driver_->get(refs(name), std::span(values)), 0) << name << ": " << driver_->last_message();
    return values;
  }
  int integer(const std::string& name) {
    std::array<std::int32_t, 1> value{};
    EXPECT_EQ(driver_->get(refs(name), std::span<std::int32_t>(value)), 0) << name;
    return value[0];
  }
  bool boolean(const std::string& name) {
    std::array<bool, 1> value{};
    EXPECT_EQ(driver_->get(refs(name), std::span<bool>(value)), 0) << name;
    return value[0];
  }
  void step() {
    ASSERT_EQ(driver_->step(static_cast<double>(n_) * kStep, kStep), 0) << driver_->last_message();
    ++n_;
  }

 private:
  std::vector<unsigned> refs(const std::string& name) const { return references(reference_.variables, name, request_.version); }

  PackRequest request_;
  Instance reference_;
  TemporaryFolder folder_;
  std::unique_ptr<LoadedFmu> fmu_;
  std::unique_ptr<Driver> driver_;
  std::int64_t n_ = 0;
};

std::string loopback(std::uint16_t port) { return "127.0.0.1:" + std::to_string(port); }

class RobotPort : public ::testing::TestWithParam<std::tuple<Version, std::string>> {
 protected:
  Version version() const { return std::get<0>(GetParam()); }
  std::string protocol() const { return std::get<1>(GetParam()); }
  Exported make(const std::string& link) { return {"unit:io?robot=lwr4&link=" + link + "&protocol=" + protocol(), version()}; }
};

TEST_P(RobotPort, RefusesToSaveItsStateAndSaysSoInItsDescription) {
  for (const char* link : {"fri", "fri_controller"}) {
    Exported unit = make(link);
    const std::string flag = version() == Version::k2 ? "canGetAndSetFMUstate" : "canGetAndSetFMUState";
    EXPECT_EQ(unit.description().find(flag + "=\"true\""), std::string::npos) << link;
    EXPECT_EQ(unit.description().find("canSerializeFMUstate=\"true\""), std::string::npos) << link;
    EXPECT_EQ(unit.description().find("canSerializeFMUState=\"true\""), std::string::npos) << link;
    ASSERT_TRUE(unit.driver().alive()) << unit.driver().last_message();
    unit.set("address", "127.0.0.1");
    unit.set("port", std::vector<std::int32_t>{0});
    unit.driver().initialise();
    unit.step();
    void* state = nullptr;
    EXPECT_EQ(unit.driver().save(&state), 3) << link;
    EXPECT_EQ(state, nullptr);
    EXPECT_THAT(unit.driver().last_message(), HasSubstr("communicates with the outside; its state cannot be saved"));
    unit.step();  // the refusal changes nothing
  }
}

TEST_P(RobotPort, TwinAndRobotAsFmusMoveTogether) {
  Exported twin = make("fri"), robot = make("fri_controller");
  const std::uint16_t port = cotwin::testing::free_ports();
  twin.set("mode", "position");
  twin.set("address", "127.0.0.1");
  twin.set("port", std::vector<std::int32_t>{port});
  robot.set("address", "127.0.0.1");
  robot.set("port", std::vector<std::int32_t>{0});
  robot.set("client", loopback(port));
  robot.set("period", std::vector<double>{kStep});
  robot.set("window", std::vector<std::int32_t>{20});
  robot.set("q", std::vector<double>(kHome.begin(), kHome.end()));
  twin.driver().initialise();
  robot.driver().initialise();
  std::vector<double> q(kHome.begin(), kHome.end()), wanted = q;
  wanted[1] += 0.05;
  const auto period = [&] {
    robot.set("q", q);
    robot.step();
    q = robot.reals("q_command");
    // Datagrams on the loopback device have come when sendto returns; a step never waits.
    twin.set("q_command", wanted);
    twin.step();
  };
  EXPECT_TRUE(cotwin::testing::within_patience([&] {
    period();
    return std::abs(twin.reals("q")[1] - wanted[1]) < 1e-6;
  }));
  EXPECT_TRUE(twin.boolean("commanding"));
  EXPECT_EQ(robot.integer("drops"), 0);
  EXPECT_EQ(twin.integer("lost"), 0);
  EXPECT_EQ(twin.driver().terminate(), 0);
  EXPECT_EQ(robot.driver().terminate(), 0);
}

TEST_P(RobotPort, CommandsARobotInAnotherProcess) {
  const cotwin::testing::TemporaryFolder folder("robot_port");
  Exported twin = make("fri");
  const std::uint16_t port = cotwin::testing::free_ports();
  twin.set("mode", "position");
  twin.set("address", "127.0.0.1");
  twin.set("port", std::vector<std::int32_t>{port});
  twin.driver().initialise();
  cotwin::testing::Process robot =
      cotwin::testing::start_program({"robot", "--fri", protocol(), "--address", "127.0.0.1", "--port", "0", "--client",
                                      loopback(port), "--period", "10", "--set", "controller.window=20", "--quiet", "--out",
                                      (folder.path() / "robot").string(), "--q0", "0 0.3 0 -1.2 0 0.9 0"});
  std::vector<double> wanted(kHome.begin(), kHome.end());
  wanted[1] += 0.02;
  EXPECT_TRUE(cotwin::testing::within_patience([&] {
    twin.set("q_command", wanted);
    twin.step();
    return twin.boolean("commanding") && std::abs(twin.reals("q")[1] - wanted[1]) < 2e-3;  // gravity and friction of the robot
  }));
  EXPECT_NEAR(twin.reals("q")[3], kHome[3], 2e-3);
  EXPECT_GT(twin.integer("answers"), 20);
  robot.signal(SIGINT);
  EXPECT_EQ(robot.wait().code, 128 + SIGINT);
}

INSTANTIATE_TEST_SUITE_P(Versions, RobotPort,
                         ::testing::Combine(::testing::Values(Version::k2, Version::k3),
                                            ::testing::Values("lwr", "sunrise-1.15")),
                         [](const auto& p) {
                           std::string name =
                               "Fmi" + std::to_string(static_cast<int>(std::get<0>(p.param))) + std::get<1>(p.param);
                           std::erase_if(name, [](char c) { return c == '-' || c == '.'; });
                           return name;
                         });

}  // namespace
}  // namespace cotwin::fmu::robot_port_test
