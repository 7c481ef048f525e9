#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

namespace cotwin {

/// The four kinds of value that a port carries. The order is that of Variable::storage.
enum class Kind : std::uint8_t { kReal, kInteger, kBoolean, kString };

/// What a variable is to the unit that declares it.
///   input      written by others before a step; the unit only reads it
///   output     holds at now + h after a step; others only read it
///   parameter  fixed from initialise on
///   tunable    a parameter that may change between two steps, and then without a jump
///   state      values kept from step to step; part of every snapshot, readable by all, written by the unit alone
enum class Role : std::uint8_t { kInput, kOutput, kParameter, kTunable, kState };

std::string_view name_of(Kind kind);
std::string_view name_of(Role role);

/// 64-bit integers that double does not have, as their bits, by the element that has the nearest double. They hold while it has.
using ExactIntegers = std::unordered_map<const double*, std::uint64_t>;

/// What the elements of a vector belong to, for example the joints of a robot.
struct Elements {
  std::vector<std::string> names;  // of each element; empty: they have numbers only
  std::vector<std::string> si;     // units of measure of each, where they differ; else empty
};

/// One variable of a unit: its meaning, and the member of the unit that holds it. Every variable is a vector; a scalar has one
/// element. The storage must keep its address and length from declare() until the unit is destroyed.
struct Variable {
  using Storage = std::variant<std::span<double>, std::span<std::int32_t>, std::span<bool>, std::span<std::string>>;

  std::string name;  // unique within the unit, an identifier: "tau_J" (any text after Variables::foreign())
  Role role = Role::kInput;
  Storage storage;
  std::string si;           // unit of measure of kReal, e.g. "N.m/rad"; "1" for a pure number; "" for the other kinds, for
                            // reals of foreign units without a unit of measure, and where elements differ (si_of)
  std::string description;  // one sentence: meaning, frame, equation
  double min = -std::numeric_limits<double>::infinity();  // in `si`; both ends belong to the range
  double max = +std::numeric_limits<double>::infinity();
  std::span<double> rate;  // of an input that may be ramped: its first time derivative over the next step; else empty
  bool has_start = false;  // of an output: a start value may be given before initialise, as for a state
  std::optional<std::vector<std::string>>
      initial_inputs;         // of an output: on these its value after initialise depends; no value: on all
  std::string derivative_of;  // name of the variable whose first time derivative this one is; else empty
  bool relative = false;      // of a real: a difference, whose units of measure have no offset (FMI: relativeQuantity)
  bool discrete = false;      // of a real output: not a point of a curve (a mean over the step); inputs hold it
  bool essential =
      false;  // of an input, parameter or state: without a connection, a start value or an event the unit cannot be used
  bool required = false;           // essential, and a scenario that leaves it out is refused
  bool may_be_lost = false;        // of a real input: the unit knows what to do while it is no number
  ExactIntegers* exact = nullptr;  // of a real whose values are integers of another program; else nullptr
  double nominal = 0;              // of a real: typical magnitude in `si`, to which tolerances are relative; 0: not declared
  std::shared_ptr<const Elements> elements{};  // nullptr: they have no names, and all are in `si`

  Kind kind() const { return static_cast<Kind>(storage.index()); }
  /// Whether elements differ in their units of measure.
  bool mixed() const { return elements != nullptr && !elements->si.empty(); }
  /// The unit of measure of an element, counted from 0.
  const std::string& si_of(std::size_t element) const { return mixed() ? elements->si[element] : si; }
  std::size_t size() const {
    return std::visit([](auto s) { return s.size(); }, storage);
  }
  std::span<double> reals() const { return std::get<std::span<double>>(storage); }
  std::span<std::int32_t> integers() const { return std::get<std::span<std::int32_t>>(storage); }
  std::span<bool> booleans() const { return std::get<std::span<bool>>(storage); }
  std::span<std::string> strings() const { return std::get<std::span<std::string>>(storage); }
};

/// The list of a unit's variables, in the order of declaration (which is the order of FMI value references: append, never
/// reorder).
class Variables {
 public:
  /// Properties of a variable, set after its declaration: v.input("q", …).range(-3, 3).
  class Declared {
   public:
    Declared(Variables& list, std::size_t index) : list_(list), index_(index) {}
    Declared& range(double min, double max);
    /// The unit follows the input linearly over a step: value + rate · (t − now). `storage` is as long as the input.
    template <class T>
    Declared& rate(T& storage) {
      return set_rate(view(storage));
    }
    /// The output has a start value that may be given before initialise.
    Declared& start();
    /// After initialise the output depends on these inputs only, and on parameters and start values. Throws Error unless it is an output.
    Declared& initially_from(std::vector<std::string> inputs);
    /// The variable is the first time derivative of another one, declared before and of the same size. Throws Error if sizes or
    /// units of measure do not fit.
    Declared& derivative_of(std::string name);
    /// The real output does not change continuously (FMI: variability "discrete"), for example a mean over the step. Inputs
    /// that interpolate over a step hold it.
    Declared& discrete();
    /// The input, parameter or state has no useful default: a scenario without a connection or a value for it gets a warning.
    /// Throws Error for an output.
    Declared& essential();
    /// As essential(), for values whose default is dangerous, as a position that a robot would move to: a scenario without a
    /// connection or a value for it is refused.
    Declared& required();
    /// The unit goes on while the real input is no number, as of a sensor that sees nothing: an output that feeds only such inputs does not end the run.
    /// Throws Error unless it is a real input.
    Declared& may_be_lost();
    /// The typical magnitude of the real variable, in its unit of measure. It is not part of the fingerprint. Throws Error if
    /// it is not positive and finite, or the variable not real.
    Declared& nominal(double magnitude);
    /// The real variable is a difference: 5 degC are 5 K.
    Declared& relative();
    /// Names and units of measure of the elements; nullptr: none. Throws Error if there are not as many as elements.
    Declared& elements(std::shared_ptr<const Elements> elements);
    /// The values of the real variable are 64-bit integers; `storage` keeps those of a text that double does not have.
    Declared& exact(ExactIntegers& storage);

   private:
    Declared& set_rate(Variable::Storage storage);
    Variables& list_;
    std::size_t index_;
  };

  /// Real variables. `storage` is a double, or anything contiguous with data() and size() (vector, array, span, Eigen vector).
  /// The others (integer, boolean, string) leave out the unit of measure. Throws Error on a doubled or malformed name, an
  /// unreadable unit of measure or an empty description.
  template <class T>
  Declared input(std::string name, T&& storage, std::string si, std::string description) {
    return add(std::move(name), Role::kInput, view(storage), std::move(si), std::move(description));
  }
  template <class T>
  Declared output(std::string name, T&& storage, std::string si, std::string description) {
    return add(std::move(name), Role::kOutput, view(storage), std::move(si), std::move(description));
  }
  template <class T>
  Declared parameter(std::string name, T&& storage, std::string si, std::string description) {
    return add(std::move(name), Role::kParameter, view(storage), std::move(si), std::move(description));
  }
  template <class T>
  Declared tunable(std::string name, T&& storage, std::string si, std::string description) {
    return add(std::move(name), Role::kTunable, view(storage), std::move(si), std::move(description));
  }
  template <class T>
  Declared state(std::string name, T&& storage, std::string si, std::string description) {
    return add(std::move(name), Role::kState, view(storage), std::move(si), std::move(description));
  }
  template <class T>
  Declared input(std::string name, T&& storage, std::string description) {
    return add(std::move(name), Role::kInput, view(storage), "", std::move(description));
  }
  template <class T>
  Declared output(std::string name, T&& storage, std::string description) {
    return add(std::move(name), Role::kOutput, view(storage), "", std::move(description));
  }
  template <class T>
  Declared parameter(std::string name, T&& storage, std::string description) {
    return add(std::move(name), Role::kParameter, view(storage), "", std::move(description));
  }
  template <class T>
  Declared tunable(std::string name, T&& storage, std::string description) {
    return add(std::move(name), Role::kTunable, view(storage), "", std::move(description));
  }
  template <class T>
  Declared state(std::string name, T&& storage, std::string description) {
    return add(std::move(name), Role::kState, view(storage), "", std::move(description));
  }

  /// The variables declared from now on are those of an imported FMU: names may be any text without control characters
  /// ("der(x)", "A[1,2]"), and reals may have no unit of measure ("").
  void foreign() { foreign_ = true; }

  std::span<const Variable> all() const { return list_; }
  auto begin() const { return list_.begin(); }
  auto end() const { return list_.end(); }
  std::size_t size() const { return list_.size(); }

  /// Returns nullptr if there is no variable of that name.
  const Variable* find(std::string_view name) const;
  /// Throws Error with the closest name if there is no such variable.
  const Variable& at(std::string_view name) const;

  /// Throws Error `K[2] = -1 N.m/rad, expected 0 to 1e+07` for the first parameter or input outside its range, or NaN.
  void check_ranges() const;
  /// The first output or state that is not finite (±inf or NaN), as "tau_J[3]"; empty if there is none. Allocates only then.
  std::string first_not_finite() const;
  /// A hash of names, roles, kinds, sizes, units of measure and ranges: equal for interchangeable units.
  std::uint64_t fingerprint() const;

 private:
  template <class T>
  static Variable::Storage view(T& storage) {
    using Value = std::remove_cvref_t<T>;
    if constexpr (std::is_same_v<Value, double> || std::is_same_v<Value, std::int32_t> || std::is_same_v<Value, bool> ||
                  std::is_same_v<Value, std::string>) {
      return std::span<Value>(&storage, 1);
    } else {
      using Element = std::remove_reference_t<decltype(*storage.data())>;
      return std::span<Element>(storage.data(), static_cast<std::size_t>(storage.size()));
    }
  }
  Declared add(std::string name, Role role, Variable::Storage storage, std::string si, std::string description);

  struct NameHash {
    using is_transparent = void;
    std::size_t operator()(std::string_view name) const { return std::hash<std::string_view>{}(name); }
  };

  std::vector<Variable> list_;
  std::unordered_map<std::string, std::size_t, NameHash, std::equal_to<>> index_;  // by name; never iterated
  bool foreign_ = false;
  std::vector<std::string> known_si_;
  mutable std::uint64_t fingerprint_ = 0;  // 0: to be computed
};

/// The range of the variable as text: "0 to 10", ">= 0", "<= 10", "a number".
std::string allowed_values(const Variable& variable);

/// Assigns `value`, read as the variable's kind, to element `element` (counted from 0) or, without one, to the whole vector:
/// one value stands for every element, or as many as the vector has, separated by commas or blanks. Throws Error naming
/// variable, text and expectation; then nothing is changed. Does not check the role: that is up to the caller.
void assign_text(const Variable& variable, std::string_view value);
void assign_text(const Variable& variable, std::size_t element, std::string_view value);

/// A name with an optional element, "tau_J[3]" → {"tau_J", 2}. Throws Error for "q[0]", "q[x]", "q[".
struct ElementName {
  std::string name;
  std::ptrdiff_t element = -1;  // −1: the whole variable
};
ElementName parse_element_name(std::string_view text);

/// The variable of exactly this name, else an element of a variable, "tau_J[3]". `variable` is nullptr if there is neither. The
/// element is not checked against the size.
struct FoundElement {
  const Variable* variable = nullptr;
  std::ptrdiff_t element = -1;  // −1: the whole variable
};
FoundElement find_element(const Variables& variables, std::string_view text);

}  // namespace cotwin
