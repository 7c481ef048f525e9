// Any bytes are the package of an exported unit or scenario (unit.bin, scenario.bin) or an Error. A package that was read is
// equal after writing and reading it again, its robot has a mechanism, an FMU's variables can be declared, and a scenario can
// be built and stepped, or throws Error.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <memory>

#include "fmu/description/read.h"
#include "fmu/export/package.h"
#include "fmu/import/package.h"
#include "fmu/import/unit/fmu_unit.h"
#include "fmu/import/unit/variables.h"
#include "master/twin/twin_package.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/fuzz/edits.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;

class Integrator final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad/s", "rate").rate(rate_);
    v.output("y", y_, "rad", "integral");
    v.parameter("start", start_, "rad", "value at the start");
    v.tunable("gain", gain_, "1", "factor on u");
  }
  void initialise(Time) override { y_ = start_; }
  StepResult step(Time, Duration h) override {
    y_ += gain_ * h.seconds() * u_;
    return StepResult::kDone;
  }

 private:
  double u_ = 0, rate_ = 0, y_ = 0, start_ = 0, gain_ = 1;
};
constexpr UnitType kTypes[] = {
    {"integrator", "y = ∫u", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Integrator>(); }}};

std::string good_unit() {
  fmu::Package package;
  package.token = "{0}";
  package.unit = "drive_train";
  package.query = "link_side=inside&robot=arm";
  package.robot = std::make_shared<robot::RobotModel>(
      robot::load_urdf(cotwin::places::source() + "/tests/fuzz/corpus/urdf/arm.urdf", {robot::Unphysical::kWarn, ""}));
  Integrator unit;
  Variables variables;
  unit.declare(variables);
  package.start.take(variables);
  return fmu::serialise(package);
}

std::unique_ptr<fmu::ForeignVariables> variables_of(const fmu::ForeignPackage& package) {
  const fmu::ModelDescription& d = package.description;
  const fmu::LoadOptions& o = package.options;
  return std::make_unique<fmu::ForeignVariables>(
      d, fmu::variables_options(d, fmu::chosen_kind(d, o.kind), fmu::unit_options(d, o)));
}

std::string good_fmu(const std::string& name) {
  fmu::ForeignPackage package;
  package.name = package.folder = name;
  package.description =
      fmu::load_model_description(cotwin::places::source() + "/tests/fuzz/corpus/model_description/" + name + ".xml");
  const std::unique_ptr<fmu::ForeignVariables> values = variables_of(package);
  Variables variables;
  values->declare(variables);
  package.start.take(variables);
  return fmu::serialise(package);
}

std::string scenario_of(const std::string& unit) {
  master::TwinPackage twin;
  twin.scenario.name = "fuzz";
  twin.scenario.stop = Time::from_seconds(0.01);
  master::ComponentSpec spec;
  spec.name = "a";
  twin.scenario.components.push_back(spec);
  twin.packages.push_back(unit);
  return master::serialise(twin);
}

std::string good_scenario() {
  fmu::Package unit;
  unit.unit = "integrator";
  Integrator integrator;
  Variables variables;
  integrator.declare(variables);
  unit.start.take(variables);
  master::TwinPackage twin;
  master::Scenario& s = twin.scenario;
  s.name = "fuzz";
  s.stop = Time::from_seconds(0.01);
  for (const char* name : {"a", "b"}) {
    master::ComponentSpec spec;
    spec.name = name;
    spec.stage = name[0] == 'a' ? 0 : 1;
    s.components.push_back(spec);
    twin.packages.push_back(fmu::serialise(unit));
  }
  master::ConnectionSpec connection;
  connection.from = {"a", "y", "deg"};
  connection.to = {"b", "u", "deg/s"};
  connection.suppress_unit_conversion = true;
  s.connections.push_back(connection);
  master::EventSpec event;
  event.time = Time::from_seconds(0.003);
  event.variable = "a.gain";
  event.value = "2";
  event.ramp = Duration::from_seconds(0.002);
  s.events.push_back(event);
  twin.outputs = {"b.y"};
  return master::serialise(twin);
}

/// Both formats: 8 bytes of kind and version, 8 of hash, and the data of this hash.
std::string with_hash(const std::string& kind, const std::string& body) {
  ByteWriter head;
  head.value(hash_of(body));
  return kind + head.bytes() + body;
}

void read_unit(const std::string& bytes) {
  fmu::Package package;
  try {
    package = fmu::deserialise_package(bytes, "input");
  } catch (const Error&) {
    return;
  }
  const std::string again = fmu::serialise(package);  // any byte may have been a boolean
  if (fmu::serialise(fmu::deserialise_package(again, "again")) != again) std::abort();
  if (package.robot == nullptr || package.robot->n() > 100) return;
  const robot::Mechanism mechanism(*package.robot);
  robot::Data data(mechanism);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(mechanism.n());
  Eigen::VectorXd tau(mechanism.n());
  robot::inverse_dynamics(mechanism, data, zero, zero, zero, tau);
}

void read_fmu(const std::string& bytes) {
  try {
    const fmu::ForeignPackage package = fmu::deserialise_foreign(bytes, "input");
    const std::string again = fmu::serialise(package);
    if (fmu::serialise(fmu::deserialise_foreign(again, "again")) != again) std::abort();
    std::size_t size = 0;
    const fmu::DescriptionIndex index(package.description);
    for (const fmu::ModelVariable& v : package.description.variables) size += index.elements(v);
    if (size > 100'000) return;
    const std::unique_ptr<fmu::ForeignVariables> values = variables_of(package);
    Variables variables;
    values->declare(variables);
    package.start.write(variables);
  } catch (const Error&) {
  }
}

void read_scenario(const std::string& bytes) {
  try {
    const master::TwinPackage package = master::deserialise_twin(bytes, "input");
    const std::string again = master::serialise(package);
    if (master::serialise(master::deserialise_twin(again, "again")) != again) std::abort();
    const std::unique_ptr<master::Twin> twin = master::build_twin(package, ".", kTypes);
    Variables variables;
    twin->declare(variables);
    twin->initialise(Time{});
    for (int i = 0; i < 5; ++i) static_cast<void>(twin->step(Time{i * 1'000'000}, Duration{1'000'000}));
  } catch (const Error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string goods[] = {good_unit(), good_scenario(), good_fmu("rogue2"), good_fmu("rogue3"), good_fmu("ball3")};
  const std::string raw(reinterpret_cast<const char*>(data), size);
  read_unit(raw);
  read_scenario(raw);
  read_fmu(raw);
  if (size == 0) return 0;
  const std::size_t kind = data[0] % std::size(goods);
  const std::string& good = goods[kind];
  const std::string bytes = with_hash(good.substr(0, 8), fuzz::edited(good.substr(16), data + 1, size - 1));
  if (kind == 0) {
    read_unit(bytes);
  } else if (kind == 1) {
    read_scenario(bytes);
  } else {
    read_fmu(bytes);
    if (!fmu::is_foreign_package(bytes)) std::abort();
    read_scenario(scenario_of(bytes));  // ends at the latest where the FMU's library is loaded
  }
  return 0;
}
