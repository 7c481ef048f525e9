#include "master/twin/package.h"

#include <algorithm>
#include <cctype>
#include <set>
#include <sstream>

#include "fmu/archive/archive.h"
#include "master/engine/engine.h"
#include "master/run/recorder.h"
#include "master/twin/ssd_write.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// Makes unique file names that need no escapes in a URI.
class FileNames {
 public:
  std::string make(const std::string& wanted, const std::string& ending) {
    std::string stem = wanted;
    for (char& c : stem) {
      const auto code = static_cast<unsigned char>(c);
      if (code >= 128 || (std::isalnum(code) == 0 && c != '_' && c != '-' && c != '.')) c = '_';
    }
    std::string name = stem + ending;
    for (int i = 2; !taken_.insert(name).second; ++i) name = stem + "_" + std::to_string(i) + ending;
    return "resources/" + name;
  }

 private:
  std::set<std::string> taken_;
};

/// Appends values of elements, in the variable's own unit of measure; none of a string.
void append(ParameterSet& set, const Variable& v, std::size_t first, std::size_t count) {
  for (std::size_t i = first; i < first + count && v.kind() != Kind::kString; ++i) {
    ParameterValue value{v.size() == 1 ? v.name : v.name + "[" + std::to_string(i + 1) + "]", 0.0, v.si_of(i), ""};
    if (v.kind() == Kind::kReal) value.value = v.reals()[i];
    if (v.kind() == Kind::kInteger) value.value = std::int64_t{v.integers()[i]};
    if (v.kind() == Kind::kBoolean) value.value = static_cast<bool>(v.booleans()[i]);
    set.values.push_back(std::move(value));
  }
}

/// The start values of a unit after their conversion.
ParameterSet values_of_unit(const Member& member) {
  std::set<const Variable*> given;
  for (const ParameterValue& value : member.spec.start_values) {
    given.insert(find_element(member.variables(), value.name).variable);
  }
  ParameterSet set{member.name(), {}, {}};
  for (const Variable& v : member.variables()) {
    if (given.count(&v) != 0) append(set, v, 0, v.size());
  }
  si::define_units(set);
  return set;
}

/// The start values of a foreign FMU, unchanged; of each name the last one.
ParameterSet values_of_foreign(const Member& member, const Scenario& scenario) {
  ParameterSet set{member.name(), {}, {}};
  std::set<std::string> names;
  for (auto value = member.spec.start_values.rbegin(); value != member.spec.start_values.rend(); ++value) {
    if (find_element(member.variables(), value->name).variable != nullptr && names.insert(value->name).second)
      set.values.push_back(*value);
  }
  std::reverse(set.values.begin(), set.values.end());
  for (const UnitDefinition& unit : scenario.units) {
    const bool used = std::any_of(set.values.begin(), set.values.end(), [&](const auto& v) { return v.unit == unit.name; });
    if (used) set.units.push_back(unit);
  }
  si::define_units(set);
  return set;
}

class ScenarioPacker {
 public:
  ScenarioPacker(const Scenario& scenario, const PackageOptions& options)
      : scenario_(scenario), options_(options), members_(load(scenario, options)) {}

  std::vector<std::string> pack(const fs::path& out) {
    const std::vector<ResolvedConnection> links = resolve_connections(scenario_, members_);
    (void)choose_columns(scenario_, members_);  // reports errors of the recording now, not to the user of the package
    std::vector<ParameterSet> values;
    for (const Member& member : members_) {
      if (member.spec.period > 1)
        warnings_.push_back(member.name() + ": of other tools only libcosim keeps its period of " +
                            std::to_string(member.spec.period) +
                            " ticks, and OMSimulator refuses the package; within one FMU (--as-fmu) all tools keep it");
      values.push_back(is_unit(member.spec) ? values_of_unit(member) : values_of_foreign(member, scenario_));
    }
    initialise();
    std::vector<PackedComponent> components;
    for (std::size_t m = 0; m < members_.size(); ++m) components.push_back(add(m, links, values[m]));
    const bool scalars = options_.version == fmu::Version::k2;
    files_.insert(files_.begin(), {"SystemStructure.ssd", to_ssd(scenario_, members_, links, components, scalars)});
    fmu::write_archive(out, files_);
    return std::move(warnings_);
  }

 private:
  /// With foreign FMUs in processes of their own, because they will be initialised.
  static std::vector<Member> load(Scenario scenario, const PackageOptions& options) {
    const std::vector<ComponentSpec> wanted = scenario.components;
    for (ComponentSpec& spec : scenario.components) spec.process = trial_process(spec);
    std::vector<Member> members = load_members(scenario, options.types, options.folders);
    for (std::size_t m = 0; m < members.size(); ++m) members[m].spec.process = wanted[m].process;
    return members;
  }

  /// Connected inputs get the values that they have at the start of a run, for a tool that sets none before the first step.
  void initialise() {
    const auto outside = std::find_if(members_.begin(), members_.end(), reaches_outside);
    std::string why = outside == members_.end() ? "" : "'" + outside->name() + "' would reach outside this program";
    try {
      if (why.empty()) Engine(scenario_, members_, 1, false).initialise(scenario_.start);
    } catch (const Error& error) {
      why = error.what();
    }
    is_initialised_ = why.empty();
    if (!is_initialised_)
      warnings_.push_back("connected inputs have the start values of their units, not those of a run: " + why);
  }

  ParameterSet inputs_of(std::size_t m, const std::vector<ResolvedConnection>& links) const {
    ParameterSet inputs;
    for (const ResolvedConnection& link : links) {
      if (link.to.member == m && is_initialised_) append(inputs, *link.to.variable, link.to.first, link.to.count);
    }
    return inputs;
  }

  PackedComponent add(std::size_t m, const std::vector<ResolvedConnection>& links, const ParameterSet& values) {
    const Member& member = members_[m];
    const bool foreign = !is_unit(member.spec);
    PackedComponent packed{foreign ? copy(member) : make(member, inputs_of(m, links)), "", foreign};
    if (values.values.empty()) return packed;
    std::ostringstream text;
    write_parameter_set(text, values);
    packed.values = text.str();
    packed.values.erase(0, packed.values.find('\n') + 1);  // the XML declaration
    for (const ParameterValue& value : values.values) packed.valued.insert(value.name);
    return packed;
  }

  std::string make(const Member& member, ParameterSet inputs) {
    fmu::PackRequest request;
    request.source = member.spec.source;
    request.defaults = settings_for(scenario_, member.name());
    request.folders = options_.folders;
    request.types = options_.types;
    request.values = {start_values(scenario_, member), std::move(inputs)};
    request.version = options_.version;
    request.experiment = {scenario_.start.seconds(), scenario_.stop.seconds(), std::nullopt,
                          static_cast<double>(member.spec.period) * scenario_.tick.seconds()};
    request.alone = false;
    request.platforms = options_.platforms;
    request.libraries = options_.libraries;
    request.libraries_of_modules = options_.libraries_of_modules;
    const std::string name = names_.make(member.name(), ".fmu");
    const fs::path file = scratch_.path() / fs::path(name).filename();
    for (const std::string& warning : fmu::pack_unit(request, file)) warnings_.push_back(member.name() + ": " + warning);
    files_.push_back({name, file});
    return name;
  }

  std::string copy(const Member& member) {
    const std::size_t question = member.spec.source.rfind('?');
    const fs::path file = scenario_.folder / member.spec.source.substr(0, question);
    if (!fs::is_regular_file(file)) {
      fail(member.spec.place,
           "component '" + member.name() + "': " + file.string() + " is a folder, expected an archive (.fmu) for a package");
    }
    const std::string name = names_.make(file.stem().string(), ".fmu");
    files_.push_back({name, file});
    return question == std::string::npos ? name : name + member.spec.source.substr(question);
  }

  const Scenario& scenario_;
  const PackageOptions& options_;
  std::vector<Member> members_;
  fmu::TemporaryFolder scratch_;
  FileNames names_;
  std::vector<fmu::ArchiveFile> files_;
  std::vector<std::string> warnings_;
  bool is_initialised_ = false;
};

}  // namespace

std::vector<std::string> pack_scenario(const Scenario& scenario, const PackageOptions& options, const fs::path& out) {
  return ScenarioPacker(scenario, options).pack(out);
}

}  // namespace cotwin::master
