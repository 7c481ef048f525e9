#pragma once
#include <string>
#include <string_view>
#include <vector>

/// Checks documents against the definitions of FMI 2.0.4, FMI 3.0.2 and SSP 1.0, without the schema files of the standards and
/// without the program's own reader and writer.
namespace cotwin::testing {

enum class Standard { kFmi2, kFmi3, kSsd, kSsv };

/// Faults that the schema of the standard would report: order and number of elements, attributes, types of values. Each fault
/// with the line of its element. Empty: valid.
std::vector<std::string> schema_faults(std::string_view xml, Standard standard);

/// Further faults according to the text of the standard: names that are not unique, invalid references, combinations of
/// attributes. Only for documents without schema faults.
std::vector<std::string> meaning_faults(std::string_view xml, Standard standard);

/// Both.
std::vector<std::string> faults(std::string_view xml, Standard standard);

}  // namespace cotwin::testing
