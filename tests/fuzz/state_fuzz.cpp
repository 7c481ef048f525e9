// Any bytes are a serialised state of an exported FMU or an Error, and one that is taken can be stepped from, or says why not.
// The unit is a drive train with a history of steps (method=cvode), which is as much as a state can hold.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>

#include "components/drive_train/drive_train.h"
#include "fmu/archive.h"
#include "fmu/bytes.h"
#include "fmu/export.h"
#include "fmu/package.h"
#include "models/text/error.h"
#include "tests/fuzz/edits.h"

namespace cotwin::fmu {

const UnitType& exported_unit() {
  static constexpr UnitType kType{"drive_train", "to be restored", [](Settings& s) -> std::unique_ptr<cotwin::Unit> {
                                    return std::make_unique<drive_train::DriveTrain>(s);
                                  }};
  return kType;
}

}  // namespace cotwin::fmu

namespace {

using namespace cotwin;

constexpr const char* kToken = "{fuzz}";

/// resources/ with the package of the unit.
const std::filesystem::path& resources() {
  static const fmu::TemporaryFolder folder;
  static const bool written = [] {
    fmu::Package package;
    package.token = kToken;
    package.unit = "drive_train";
    package.query = "joints=2&link=outside&method=cvode&robot=";
    Settings settings(package.unit, package.query, {}, {});
    drive_train::DriveTrain unit(settings);
    Variables variables;
    unit.declare(variables);
    package.start.take(variables);
    std::ofstream(folder.path() / fmu::kPackageFile, std::ios::binary) << fmu::serialise(package);
    return true;
  }();
  static_cast<void>(written);
  return folder.path();
}

struct Good {
  std::string state;
  Good() {
    fmu::Exported exported(fmu::References::kVariables, kToken, resources());
    exported.setup(0, {});
    exported.enter_initialisation();
    exported.exit_initialisation();
    for (int i = 0; i < 5; ++i) static_cast<void>(exported.step(i * 1e-3, 1e-3));
    state = exported.serialise(exported.save(nullptr));
  }
};

void use(const std::string& bytes) {
  static fmu::Exported exported(fmu::References::kVariables, kToken, resources());
  void* state = nullptr;
  try {
    state = exported.deserialise(fmu::as_bytes(bytes));
  } catch (const Error&) {
    return;
  }
  try {
    // Written again it says the same; a truth value may have been any byte.
    const std::string again = exported.serialise(state);
    void* second = exported.deserialise(fmu::as_bytes(again));
    if (exported.serialise(second) != again) std::abort();
    exported.free(&second);
    exported.restore(state);
    if (exported.state() == fmu::kStepping && !exported.finished()) static_cast<void>(exported.step(exported.time(), 1e-3));
  } catch (const Error&) {
  }
  exported.free(&state);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Good good;
  use(std::string(reinterpret_cast<const char*>(data), size));
  // The state is 8 bytes of kind and version, 8 of hash, and what this hash is of.
  std::string body = fuzz::edited(good.state.substr(16), data, size);
  fmu::ByteWriter head;
  head.value(fmu::hash_of(body));
  use(good.state.substr(0, 8) + head.bytes() + body);
  return 0;
}
