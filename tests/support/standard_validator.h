#pragma once
#include <string>
#include <string_view>
#include <vector>

/// Holds documents against the definitions of FMI 2.0.4, FMI 3.0.2 and SSP 1.0, without the standards' own schema files and
/// without the program's own reader and writer.
namespace cotwin::testing {

enum class Standard { kFmi2, kFmi3, kSsd, kSsv };

/// What the schema of the standard would refuse: order and number of elements, attributes, types of values. Each fault with the
/// line of its element. Empty: valid.
std::vector<std::string> schema_faults(std::string_view xml, Standard standard);

/// What the text of the standard refuses beyond: names that are not unique, references to what is not there, combinations of
/// attributes. Only of documents without schema faults.
std::vector<std::string> meaning_faults(std::string_view xml, Standard standard);

/// Both.
std::vector<std::string> faults(std::string_view xml, Standard standard);

}  // namespace cotwin::testing
