// Any bytes are a serialised state of an exported FMU or an Error; an accepted state can be stepped from, or throws Error. The
// first byte selects the unit. A drive train with a history of steps (method=cvode) has the largest state.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <memory>

#include "components/unit/unit_table.h"
#include "fmu/archive/archive.h"
#include "fmu/export/export.h"
#include "fmu/export/package.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/cell.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/fuzz/edits.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;

constexpr const char* kToken = "{fuzz}";
const std::string kModels = cotwin::places::source() + "/models/";

/// A unit with the settings of its package, and its other contents.
struct Choice {
  const char* unit;
  const char* query;
  const char* robot = "";  // of models/robots
  const char* scene = "";  // of models/scenes
};

constexpr std::array kChoices = {
    Choice{"drive_train", "joints=2&link_side=outside&method=cvode&robot="},
    Choice{"compliance", "", "planar2"},
    Choice{"motion", "points=4&degree=8", "planar2"},
    Choice{"motion", "kind=polynomial&degree=7&jerk=true", "planar2"},
    Choice{"io", "link=sensors", "planar2"},
    Choice{"contact_world", "link_side=outside", "planar2", "table"},
    Choice{"contact_world", "method=dantzig", "", "stack"},
    Choice{"contact_world", "latches=a|box_1|box_2;b|box_2|box_4", "", "stack"},
    Choice{"tuner", "friction=sigmoid&motor_inertia=true", "planar2"},
    Choice{"motion", "robot=planar2&space=cartesian&from=relative&inverse=true", "planar2"},
};

const UnitType& type_of(const Choice& choice) {
  for (const UnitType& type : unit_types()) {
    if (std::string_view(type.name) == choice.unit) return type;
  }
  std::abort();
}

const UnitType* exported = nullptr;  // of the instance that is being created

/// An instance, and its state after some steps.
class Subject {
 public:
  explicit Subject(const Choice& choice) {
    exported = &type_of(choice);
    fmu::Package package;
    package.token = kToken;
    package.unit = choice.unit;
    package.query = choice.query;
    const std::string robot = choice.robot, scene = choice.scene;
    const std::filesystem::path urdf = kModels + ("robots/" + robot) + "/robot.urdf";
    if (!robot.empty()) {
      robot::RobotModel model = robot::load_urdf(urdf);
      model.history.clear();
      package.robot = std::make_shared<const robot::RobotModel>(std::move(model));
    }
    if (!scene.empty()) {
      scene::Cell cell;
      cell.scene = scene::load(kModels + ("scenes/" + scene) + "/scene.sdf");
      if (package.robot) cell.robots.push_back({"", *package.robot, scene::shapes_of_urdf(urdf, *package.robot)});
      package.cell = std::make_shared<const scene::Cell>(std::move(cell));
    }
    Settings settings(package.unit, package.query, {}, {});
    settings.set_robot(package.robot);
    settings.set_cell(package.cell);
    const std::unique_ptr<Unit> unit = construct(*exported, settings);
    Variables variables;
    unit->declare(variables);
    package.start.take(variables);
    std::ofstream(folder_.path() / fmu::kPackageFile, std::ios::binary) << fmu::serialise(package);
    instance_ = std::make_unique<fmu::Exported>(fmu::References::kVariables, kToken, folder_.path());
    instance_->setup(0, {});
    instance_->enter_initialisation();
    instance_->exit_initialisation();
    for (int i = 0; i < 5; ++i) static_cast<void>(instance_->step(i * 1e-3, 1e-3));
    good_ = instance_->serialise(instance_->save(nullptr));
  }

  const std::string& good() const { return good_; }
  void use(const std::string& bytes) {
    fmu::Exported& unit = *instance_;
    void* state = nullptr;
    try {
      state = unit.deserialise(as_bytes(bytes));
    } catch (const Error&) {
      return;
    }
    try {
      // The state is equal after writing it again; any byte may have been a boolean.
      const std::string again = unit.serialise(state);
      void* second = unit.deserialise(as_bytes(again));
      if (unit.serialise(second) != again) std::abort();
      unit.free(&second);
      unit.restore(state);
      if (unit.state() == fmu::kStepping && !unit.finished()) static_cast<void>(unit.step(unit.time(), 1e-3));
    } catch (const Error&) {
    }
    unit.free(&state);
  }

 private:
  fmu::TemporaryFolder folder_;
  std::unique_ptr<fmu::Exported> instance_;
  std::string good_;
};

}  // namespace

namespace cotwin::fmu {

const UnitType& exported_unit() { return *exported; }

}  // namespace cotwin::fmu

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static std::array<std::unique_ptr<Subject>, kChoices.size()> subjects;
  if (size == 0) return 0;
  const std::size_t chosen = data[0] % kChoices.size();
  std::unique_ptr<Subject>& subject = subjects[chosen];
  if (!subject) subject = std::make_unique<Subject>(kChoices[chosen]);
  subject->use(std::string(reinterpret_cast<const char*>(data), size));
  // The state is 8 bytes of kind and version, 8 of hash, and the data of this hash.
  const std::string body = fuzz::edited(subject->good().substr(16), data + 1, size - 1);
  ByteWriter head;
  head.value(hash_of(body));
  subject->use(subject->good().substr(0, 8) + head.bytes() + body);
  return 0;
}
