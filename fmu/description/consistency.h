#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "fmu/description/model_description.h"
#include "models/support/error.h"

/// What holds in every description that the rest of this folder works with, whether it was read from XML or from the bytes that
/// an exported scenario holds. Whatever throws here throws Error `fact, expectation`, without the place, which the reader
/// knows.
namespace cotwin::fmu {

/// What `call` throws without a place, with it.
template <class Call>
void at(const std::string& place, Call call) {
  try {
    call();
  } catch (const Error& error) {
    throw Error(place, error.what());
  }
}

inline bool is_float(Type type) { return type == Type::kFloat32 || type == Type::kFloat64; }

/// The integers of a type of up to 64 bits with a sign, or fewer without.
struct IntegerRange {
  std::int64_t min, max;
};
IntegerRange range_of(Type type);

/// The version that the attribute fmiVersion means, if it is one that is supported.
std::optional<Version> version_of(std::string_view fmi_version);

/// Whether this can be the name of a file in the folder that it is looked for in, and of no other one: not empty, no separator,
/// no control character, neither "." nor "..".
bool is_file_name(std::string_view name);
/// The same for a shared library's name without its ending, which does not begin with a dot.
bool is_library_name(std::string_view name);
bool is_variable_name(std::string_view name);

/// Exponents of at most 99, a factor other than 0, and finite numbers.
void check_unit(const UnitDefinition& unit);
void check_range(const Numeric& numeric);
void check_event_indicators(std::uint64_t n);
void check_dimension(const Dimension& dimension);

/// Checks variables and structure of a description the types and variables of which do not change any more.
class DescriptionCheck {
 public:
  explicit DescriptionCheck(const ModelDescription& description);

  /// The variable of a value reference, the first of them in FMI 2.
  std::optional<std::size_t> index_of(std::uint32_t reference) const;
  /// What a variable refers to, the number of its elements (of all variables so far together, too) and its start values.
  void variable(const ModelVariable& v);
  /// What a continuous state's derivative is the derivative of.
  void derivative(const Unknown& unknown) const;

 private:
  std::size_t elements(const ModelVariable& v) const;

  const ModelDescription& d_;
  std::unordered_map<std::uint32_t, std::size_t> index_;  // value reference → first variable
  std::unordered_map<std::string_view, const TypeDefinition*> types_;
  std::uint64_t total_ = 0;
};

/// All of it, and what no XML could say: indices beyond the end, names that stand twice, start values of another type, and what
/// FMI 2 does not know.
void check_all(const ModelDescription& description);

}  // namespace cotwin::fmu
