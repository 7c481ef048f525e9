// The part of fmu/import/load.h that exported scenarios use too. They contain unpacked FMUs and parsed descriptions.
#include "fmu/description/rate.h"
#include "fmu/import/load.h"
#include "fmu/import/named.h"
#include "fmu/import/unit/fmu_unit.h"
#include "fmu/import/unit/model_exchange.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

std::unique_ptr<ForeignInstance> make_foreign(const ForeignFmu& fmu, ForeignOptions options) {
  return fmu.description.version == Version::k2 ? make_foreign_fmi2(fmu, std::move(options))
                                                : make_foreign_fmi3(fmu, std::move(options));
}

UnitOptions unit_options(const ModelDescription& description, const LoadOptions& options) {
  return {options.instance_name, options.locals,
          options.structural,    options.stop,
          options.tolerance,     options.si,
          options.slopes,        options.rollback.value_or(description.generation_tool == kGenerationTool)};
}

Instance make_instance(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options) {
  const InterfaceKind kind = chosen_kind(fmu->description, options.kind);
  Instance instance;
  if (interface_of(fmu->description, kind).needs_execution_tool)
    instance.warnings.push_back("the FMU needs the installation of its tool");
  if (kind == InterfaceKind::kCoSimulation) {
    instance.unit = make_named<FmuUnit>(fmu->name, instance.warnings, fmu, unit_options(fmu->description, options));
  } else {
    instance.unit = make_named<ModelExchangeUnit>(fmu->name, instance.warnings, fmu, unit_options(fmu->description, options));
  }
  for (std::string& warning : instance.warnings) warning = fmu->name + ": " + warning;
  instance.unit->declare(instance.variables);
  return instance;
}

}  // namespace cotwin::fmu
