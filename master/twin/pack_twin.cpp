#include "master/twin/pack_twin.h"

#include <algorithm>
#include <cctype>
#include <map>

#include "fmu/export/package.h"
#include "fmu/import/package.h"
#include "master/run/recorder.h"
#include "master/twin/twin_package.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// Collects the files below a folder, following links. `above`: the folders that contain it, as canonical paths.
void collect_files(const fs::path& folder, std::vector<fs::path> above, std::vector<fs::path>& files) {
  above.push_back(fs::canonical(folder));
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      files.push_back(entry.path());
      continue;
    }
    if (!entry.is_directory()) throw Error(entry.path().string(), "is neither a file nor a folder, which an FMU cannot hold");
    if (std::find(above.begin(), above.end(), fs::canonical(entry.path())) != above.end())
      throw Error(entry.path().string(), "is a link to a folder that it lies in");
    collect_files(entry.path(), above, files);
  }
}

class TwinPacker {
 public:
  TwinPacker(const Scenario& scenario, const PackageOptions& options)
      : scenario_(scenario), options_(options), members_(load_members(scenario, options.types, options.folders)) {
    package_.scenario = scenario;
    if (scenario.clock.kind != ClockKind::kFree)
      warnings_.push_back("the scenario's clock '" + std::string(text::word_of(scenario.clock.kind, kClockWords)) +
                          "' is not used: the importer of an FMU decides when it steps");
    for (const Column& column : choose_columns(scenario, members_)) {
      if (column.signal.member == members_.size()) continue;  // of the clock
      package_.outputs.insert(members_[column.signal.member].name() + "." + column.signal.variable->name);
    }
  }

  std::vector<std::string> pack(const fs::path& out) {
    for (Member& member : members_) {
      for (const std::string& warning : member.instance.warnings) warnings_.push_back(member.name() + ": " + warning);
      is_unit(member.spec) ? add_unit(member) : add_fmu(member);
      package_.given.push_back(member.given);
    }
    resources_.push_back({"resources/" + std::string(kTwinFile), serialise(package_)});

    Twin twin(scenario_, std::move(members_), package_.outputs, states_leave_);
    Variables variables;
    twin.declare(variables);
    const UnitType type{kTwinName, kTwinSummary, nullptr};
    fmu::PackRequest request;
    request.version = options_.version;
    request.name = scenario_.name;
    request.experiment = {scenario_.start.seconds(), scenario_.stop.seconds(), std::nullopt, scenario_.tick.seconds()};
    request.platforms = options_.platforms;
    request.libraries = options_.libraries;
    // Some tools tell FMUs apart by the names of their libraries.
    std::string identifier = "cotwin_" + scenario_.name;
    for (char& c : identifier) {
      if (!std::isalnum(static_cast<unsigned char>(c)) || (c & 0x80) != 0) c = '_';
    }
    fmu::pack({type, twin, variables, "", nullptr, nullptr, std::move(resources_), std::move(parts_), only_once_, needs_tool_,
               identifier},
              request, out);
    return std::move(warnings_);
  }

 private:
  void add_unit(Member& member) {
    // Builds the unit again, from settings that record which of them it used.
    const UnitSource source = parse_unit_source(member.spec.source);
    for (const std::filesystem::path& folder : options_.libraries_of_modules) {
      if (!std::filesystem::exists(folder / fmu::own_platform() / (source.unit + ".so"))) continue;
      fail(member.spec.place, "'" + member.name() +
                                  "' is a unit of a module, expected one of cotwin's own: pack it with `cotwin pack " +
                                  member.spec.source + "` and use that FMU in the scenario");
    }
    Settings settings(source.unit, source.query, settings_for(scenario_, member.name()), options_.folders);
    member.instance = {};  // first, as in add_fmu()
    member.instance = make_unit(settings, options_.types);
    apply(start_values(scenario_, member), member.variables());
    for (fmu::ArchiveFile& file : fmu::collect_files(settings, member.variables(), names_))
      resources_.push_back(std::move(file));
    fmu::Package unit;
    unit.unit = source.unit;
    unit.query = fmu::packed_query(settings);
    unit.robot = settings.robot_used();
    unit.cell = settings.cell_used();
    unit.start.take(member.variables());
    package_.packages.push_back(fmu::serialise(unit));
    parts_.push_back(source.unit);
  }

  /// The FMU's files are stored unpacked, so that the library needs no archives and no folder on the host's disk.
  void add_fmu(Member& member) {
    const FmuSource source = fmu_source(member.spec, scenario_);
    const std::shared_ptr<const fmu::ForeignFmu> held = fmus_.open(source.path, source.options);
    check_platforms(member, source, *held);
    fmu::ForeignPackage package{held->name, packed_folder(*held), source.options, held->description, {}};
    const fmu::Interface& interface = package.interface();
    states_leave_ = states_leave_ && interface.can_serialise_state;
    only_once_ = only_once_ || interface.only_once_per_process;
    needs_tool_ = needs_tool_ || interface.needs_execution_tool;

    member.instance = {};                                         // first: a process may have only one instance of some FMUs
    member.instance = fmu::make_instance(held, package.options);  // as in the library
    member.instance.robots = robots_of_fmu(held->folder);
    apply(start_values(scenario_, member), member.variables());
    package.start.take(member.variables());
    package_.packages.push_back(fmu::serialise(package));
  }

  void check_platforms(const Member& member, const FmuSource& source, const fmu::ForeignFmu& held) const {
    const auto refuse = [&](const std::string& what) {
      fail(member.spec.place, "component '" + member.name() + "': " + held.name + " " + what);
    };
    if (source.options.process == fmu::ProcessChoice::kOwn)
      refuse("is to run in a process of its own, expected it to be in that of the host, as all of a scenario as one FMU is");
    const fmu::Version version = held.description.version;
    const std::string& identifier =
        fmu::interface_of(held.description, fmu::chosen_kind(held.description, source.options.kind)).model_identifier;
    for (const std::string& platform : fmu::platforms_of(options_.platforms)) {
      if (!fmu::holds_fmus(platform)) refuse("is an FMU, which a scenario as one FMU cannot hold on " + platform);
      const std::string library = fmu::library_name(platform, version, identifier);
      if (!fs::is_regular_file(held.folder / library)) refuse("has no " + library + ", as platform " + platform + " needs");
    }
  }

  /// The folder of the FMU's files below resources/. Adds the files unless another component has the same FMU.
  std::string packed_folder(const fmu::ForeignFmu& held) {
    std::string& folder = packed_[&held];
    if (!folder.empty()) return folder;
    folder = folder_for(held.name);
    std::vector<fs::path> files;
    collect_files(held.folder, {}, files);
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
      const std::string name = file.lexically_relative(held.folder).generic_string();
      resources_.push_back({"resources/" + folder + "/" + name, text::read_file(file, "a file of an FMU", ~std::uint64_t{0})});
    }
    return folder;
  }

  std::string folder_for(const std::string& name) {
    std::string folder = name;
    for (int i = 2; !names_.insert(folder).second; ++i) folder = std::to_string(i) + "_" + name;
    return folder;
  }

  const Scenario& scenario_;
  const PackageOptions& options_;
  std::vector<Member> members_;
  TwinPackage package_;
  std::set<std::string> names_ = {fmu::kPackageFile, kTwinFile};  // taken in resources/
  std::vector<fmu::ArchiveFile> resources_;
  fmu::FmuStore fmus_;
  std::map<const fmu::ForeignFmu*, std::string> packed_;
  std::vector<std::string> parts_, warnings_;
  bool only_once_ = false, needs_tool_ = false, states_leave_ = true;
};

}  // namespace

std::vector<std::string> pack_twin(const Scenario& scenario, const PackageOptions& options, const fs::path& out) {
  if (scenario.tolerance > 0) {
    fail(scenario.file.filename().string(),
         "the communication step adapts to a tolerance, expected a fixed one: as one FMU the scenario steps as its host asks");
  }
  return TwinPacker(scenario, options).pack(out);
}

}  // namespace cotwin::master
