#pragma once

namespace cotwin::fmu {

/// Log categories of exported units, in the order of the status that they belong to. FMI 2 fixes the names; FMI 3 uses them
/// too.
struct LogCategoryText {
  const char* name;
  const char* description;
};
inline constexpr LogCategoryText kLogCategoryTexts[] = {
    {"logStatusWarning", "warnings, once after instantiation"},
    {"logStatusDiscard", "why a step was discarded"},
    {"logStatusError", "errors of a call"},
};

}  // namespace cotwin::fmu
