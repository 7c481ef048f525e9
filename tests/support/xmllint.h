#pragma once
#include <filesystem>
#include <string>

#include "tests/support/run_program.h"

namespace cotwin::testing {

/// Checks an XML document against an XML Schema. Returns the errors of xmllint; "" if the document is valid.
inline std::string schema_errors(const std::filesystem::path& schema, const std::filesystem::path& document) {
  const RunResult checked = run_command({"xmllint", "--noout", "--nonet", "--schema", schema, document});
  return checked.code == 0 ? "" : checked.err + "exit code " + std::to_string(checked.code);
}

}  // namespace cotwin::testing
