#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "fmu/description/model_description.h"
#include "models/foundation/support/error.h"

/// Consistency checks of a model description. They hold for descriptions read from XML and for those read from the bytes of an
/// exported scenario. The functions throw Error `fact, expectation` without a place; the caller adds it with at().
namespace cotwin::fmu {

/// Runs `call` and puts `place` in front of the message of an Error that it throws.
template <class Call>
void at(const std::string& place, Call call) {
  try {
    call();
  } catch (const Error& error) {
    throw Error(place, error.what());
  }
}

inline bool is_float(Type type) { return type == Type::kFloat32 || type == Type::kFloat64; }

/// The range of an integer type: signed up to 64 bits, unsigned up to 32 bits.
struct IntegerRange {
  std::int64_t min, max;
};
IntegerRange range_of(Type type);

/// Returns the version of the attribute fmiVersion, or nothing if it is not supported.
std::optional<Version> version_of(std::string_view fmi_version);

/// Returns whether this is a plain file name that cannot lead to another folder: not empty, no separator, no control character,
/// neither "." nor "..".
bool is_file_name(std::string_view name);
/// The same for the name of a shared library without its ending; it must not begin with a dot.
bool is_library_name(std::string_view name);
bool is_variable_name(std::string_view name);

/// Throws Error unless the exponents are at most 99, the factor is not 0 and all numbers are finite.
void check_unit(const UnitDefinition& unit);
void check_range(const Numeric& numeric);
void check_event_indicators(std::uint64_t n);
void check_dimension(const Dimension& dimension);

/// Checks the variables and the structure of a description. Its types and variables must not change meanwhile.
class DescriptionCheck {
 public:
  explicit DescriptionCheck(const ModelDescription& description);

  /// Returns the index of the variable with this value reference, in FMI 2 the first of several.
  std::optional<std::size_t> index_of(std::uint32_t reference) const;
  /// Checks the references of a variable, its number of elements (also summed over all variables so far) and its start values.
  void variable(const ModelVariable& v);
  /// Checks that this is the derivative of a continuous state.
  void derivative(const Unknown& unknown) const;

 private:
  std::size_t elements(const ModelVariable& v) const;

  const ModelDescription& d_;
  std::unordered_map<std::uint32_t, std::size_t> index_;  // value reference → first variable
  std::unordered_map<std::string_view, const TypeDefinition*> types_;
  std::uint64_t total_ = 0;
};

/// Makes all these checks, and those that the XML reader makes while it reads: indices, unique names, types of start values,
/// and features that FMI 2 does not have.
void check_all(const ModelDescription& description);

}  // namespace cotwin::fmu
