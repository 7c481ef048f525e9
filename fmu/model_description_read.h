#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "fmu/model_description.h"

namespace cotwin::fmu {

/// Reads modelDescription.xml of FMI 2.0 and 3.0: Co-Simulation, Model Exchange and (to say that it is there) Scheduled
/// Execution. What the rest of this folder relies on holds afterwards: names are unique, references and indices lead to
/// variables, numbers have the type of their variable, every extent of an array can be computed (extents()) and start values
/// fit it. Defaults of the standard are filled in for causality, variability and initial. Attributes that the standard does not
/// know are let be. Throws Error `place:line: …` for anything else, and for FMI 1.0 and versions yet to come.
ModelDescription parse_model_description(std::string_view xml, const std::string& place);

/// The same from a file of at most 256 MiB.
ModelDescription load_model_description(const std::filesystem::path& file);

/// The largest array and the largest FMU, in elements, that this importer takes.
inline constexpr std::uint64_t kMaxElements = 10'000'000;

/// The number of elements of a variable: the product of its dimensions, where structural parameters have their start values or
/// what `chosen` says of them (by value reference). Throws Error past kMaxElements and for an extent that cannot be found.
std::size_t elements(const ModelDescription& description, const Variable& variable,
                     const std::map<std::uint32_t, std::uint64_t>& chosen = {});

/// The variable of that value reference, the first of them in FMI 2 where several share it; nullptr if there is none.
const Variable* find(const ModelDescription& description, std::uint32_t reference);

/// Limits, unit and nominal value of a variable: its own, and where it does not say, those of its declared type.
Numeric effective(const ModelDescription& description, const Variable& variable);

}  // namespace cotwin::fmu
