// A checkpoint file of a run: any bytes are an Error or a checkpoint that is equal after writing and reading it again. With a
// correct hash it is an Error or a run that can continue.
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string_view>

#include "components/unit/unit_table.h"
#include "master/run/checkpoint.h"
#include "models/foundation/support/error.h"
#include "tests/fuzz/edits.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::master;

constexpr const char* kScenario = R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="fuzz" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="fuzz"><ssd:Elements>
    <ssd:Component name="motion" source="unit:motion?robot=planar2" type="application/x-cotwin-unit"/>
    <ssd:Component name="drive" source="unit:drive_train?robot=planar2&amp;method=cvode" type="application/x-cotwin-unit"/>
  </ssd:Elements></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1">
    <cotwin:Component name="motion" period="3"/>
    <cotwin:Event time="0.001" variable="drive.tau_e" value="1" ramp="0.5"/>
    <cotwin:Comparison name="c" a="drive.q" b="motion.q_d" segments="2"/>
  </cotwin:Master></ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>)";

Master make(std::optional<RunState> resume) {
  static const Scenario scenario = parse_scenario(kScenario, "fuzz.ssd", cotwin::places::source());
  MasterOptions options;
  options.types = unit_types();
  options.folders = {cotwin::places::source() + "/models"};
  options.threads = 1;
  options.resume = std::move(resume);
  return Master(scenario, std::move(options));
}

RunState saved() {
  Master master = make({});
  master.initialise();
  for (int i = 0; i < 10; ++i) static_cast<void>(master.step_tick());
  RunState state;
  master.save([&](RunState s) { state = std::move(s); });
  return state;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const RunState good = saved();
  try {
    const std::string_view bytes(reinterpret_cast<const char*>(data), size);
    if (to_bytes(parse_checkpoint(bytes, "checkpoint")) != bytes) std::abort();
  } catch (const Error&) {
  }
  RunState state = good;
  state.bytes = fuzz::edited(good.bytes, data, size);
  try {
    Master master = make(state);
    master.initialise();
    for (int i = 0; i < 3 && master.step_tick(); ++i) {
    }
    static_cast<void>(master.summary());
  } catch (const Error&) {
  }
  return 0;
}
