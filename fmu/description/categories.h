#pragma once

namespace cotwin::fmu {

/// What exported units log, in the order of the status they go with: the names that FMI 2 fixes, used for FMI 3, too.
struct LogCategoryText {
  const char* name;
  const char* description;
};
inline constexpr LogCategoryText kLogCategoryTexts[] = {
    {"logStatusWarning", "what the user should know of, once after instantiation"},
    {"logStatusDiscard", "why a step could not be made"},
    {"logStatusError", "what was wrong with a call, or went wrong in it"},
};

}  // namespace cotwin::fmu
