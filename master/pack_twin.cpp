#include "master/pack_twin.h"

#include "fmu/package.h"
#include "master/recorder.h"
#include "master/twin_package.h"

namespace cotwin::master {

namespace {

void check(const Scenario& scenario) {
  for (const ComponentSpec& spec : scenario.components) {
    if (is_unit(spec)) continue;
    fail(spec.place, "component '" + spec.name + "' is the FMU " + spec.source +
                         ", expected a unit: of a scenario as one FMU all components are units of this program");
  }
  if (scenario.tolerance > 0) {
    fail(scenario.file.filename().string(),
         "the communication step adapts to a tolerance, expected a fixed one: as one FMU the scenario steps as its host asks");
  }
}

}  // namespace

std::vector<std::string> pack_twin(const Scenario& scenario, const PackageOptions& options, const std::filesystem::path& out) {
  check(scenario);
  std::vector<Member> members = load_members(scenario, options.types, options.folders);
  std::vector<std::string> warnings;
  TwinPackage package;
  package.scenario = scenario;
  for (const Column& column : choose_columns(scenario, members)) {
    package.outputs.insert(members[column.signal.member].name() + "." + column.signal.variable->name);
  }

  std::set<std::string> names = {fmu::kPackageFile, kTwinFile};
  std::vector<fmu::ArchiveFile> resources;
  for (Member& member : members) {
    // Once more, from settings that tell afterwards what of them was used.
    const UnitSource source = parse_unit_source(member.spec.source);
    Settings settings(source.unit, source.query, scenario.settings, options.folders);
    for (const std::string& warning : member.instance.warnings) warnings.push_back(member.name() + ": " + warning);
    member.instance = make_unit(settings, options.types);
    apply(start_values(scenario, member), member.variables());
    for (fmu::ArchiveFile& file : fmu::take_files(settings, member.variables(), names)) resources.push_back(std::move(file));
    fmu::Package unit;
    unit.unit = source.unit;
    unit.query = fmu::packed_query(settings);
    unit.robot = settings.robot_used();
    unit.start.take(member.variables());
    package.packages.push_back(fmu::serialise(unit));
  }
  resources.push_back({"resources/" + std::string(kTwinFile), serialise(package)});

  Twin twin(scenario, std::move(members), package.outputs);
  Variables variables;
  twin.declare(variables);
  const UnitType type{kTwinName, kTwinSummary, nullptr};
  fmu::PackRequest request;
  request.version = options.version;
  request.name = scenario.name;
  request.experiment = {scenario.start.seconds(), scenario.stop.seconds(), std::nullopt, scenario.tick.seconds()};
  request.platforms = options.platforms;
  request.libraries = options.libraries;
  fmu::pack({type, twin, variables, "", nullptr, std::move(resources)}, request, out);
  return warnings;
}

}  // namespace cotwin::master
