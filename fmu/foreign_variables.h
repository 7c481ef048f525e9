#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/unit/variables.h"
#include "fmu/foreign.h"

/// The variables of a foreign FMU as those of a unit, and how their values get to the FMU and back.
namespace cotwin::fmu {

/// Which variables an FMU shows, by what may be done with them and when.
enum class Exchange : std::uint8_t {
  kContinuousInput,  // floats that may be set at any time
  kDiscreteInput,    // set where they changed; in event mode where there is one
  kTunable,          // likewise
  kFixed,            // parameters: set before initialisation
  kConstant,         // read once
  kResult            // outputs, calculated parameters and locals: read after every step
};
inline constexpr std::size_t kExchanges = 6;

struct ForeignVariablesOptions {
  bool locals = true;                               // also those variables that are neither parameter nor input nor output
  std::map<std::string, std::uint64_t> structural;  // structural parameters by name, instead of their start values
  bool ramps = false;                               // continuous inputs have a rate
  bool si = true;                                   // values in SI; false: as the FMU has them, without a measure
};

/// Roles: input → input; output, calculated parameter and constant → output; local → state; parameter → parameter or tunable;
/// structural parameter → a parameter whose range is its value, since it gives the sizes of others; the independent variable
/// and clocks are left out. Kinds: floats → real; integers of at most 32 bits signed, enumerations → integer; Int64, UInt32 and
/// UInt64 → real, exact up to 2^53 and clamped to the type's range on the way back; booleans; strings; binaries → string of
/// hexadecimal digits, as in modelDescription.xml. Arrays are vectors, row by row; in FMI 2, scalars named q[1] … q[n] that are
/// alike are the vector q. Units of measure: values are converted to SI by the FMU's own definition or, without one, by its
/// name; a unit that nobody knows is left as it is and has no measure.
class ForeignVariables {
 public:
  /// The description must live as long as this.
  ForeignVariables(const ModelDescription& description, const ForeignVariablesOptions& options);
  ForeignVariables(const ForeignVariables&) = delete;
  ForeignVariables& operator=(const ForeignVariables&) = delete;

  void declare(Variables& variables);

  /// Notices which start values of results were written since the last receive(); `instance` is one that has run, or nullptr.
  void adopt_starts(ForeignInstance* instance);
  /// Before initialisation: sends everything whose start value is not that of the description.
  void set_starts(ForeignInstance& instance);
  /// Sends those that changed since they were last sent; all after forget(). Returns whether there were any.
  bool send(ForeignInstance& instance, Exchange exchange);
  /// Whether send() would send anything.
  bool changed(Exchange exchange) const;
  void forget();
  /// Which rates the FMU has that are not 0: part of its state, and false after forget().
  std::vector<bool>& rates_known() { return rate_known_; }
  /// The FMU knows what the variables say: it is not sent again.
  void settle(Exchange exchange);
  void receive(ForeignInstance& instance, Exchange exchange);

  /// Rates of the continuous inputs, in the FMU's own units; of those alone that are not 0 or were not. False if there are
  /// none.
  bool send_rates(ForeignInstance& instance);
  /// Sends the continuous inputs as they are `dt` after their values: value + rate · dt.
  void send_ramped(ForeignInstance& instance, double dt);
  bool any_rate() const;
  /// Those continuous inputs that are Float64, and their rates where there are any.
  std::span<const double> continuous_values() const;
  std::span<const double> rates() const { return rates_; }
  /// Value references of the continuous inputs.
  std::vector<std::uint32_t> continuous_inputs() const;
  /// What there is to be told to the user, once.
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  /// A declared variable: one of the FMU's, or several as a vector.
  struct Item {
    std::string name, description, si;
    Role role = Role::kOutput;
    Kind kind = Kind::kReal;
    Exchange exchange = Exchange::kResult;
    Type type = Type::kFloat64;
    std::vector<std::uint32_t> references;
    std::size_t size = 0, first = 0;  // elements, in the storage of its kind
    double factor = 1, offset = 0;    // SI = factor · the FMU's + offset
    double min = 0, max = 0;
    bool settable = false;     // its start value may be given
    bool interpolated = true;  // may have a rate where the FMU follows its inputs
    StartValues start;
  };
  /// Values of one type that go through one call of the C interface; their elements lie side by side in the storage.
  struct Group {
    Type type = Type::kFloat64;
    Kind kind = Kind::kReal;
    std::vector<std::uint32_t> references;
    std::size_t first = 0, size = 0;
    bool sent = false;
    std::vector<double> factors, offsets;  // empty: none to convert
    std::vector<std::byte> wire;           // where the C interface has another type than the storage
    std::vector<const char*> texts;
    std::vector<const std::uint8_t*> bytes;
    std::vector<std::size_t> sizes;  // of bytes
    std::vector<std::vector<std::uint8_t>> binaries;
  };
  /// All values of one kind.
  template <class T>
  struct Store {
    std::unique_ptr<T[]> values, starts, given, sent;  // as they are; the description's; the user's; the FMU's
    std::size_t size = 0;
    void allocate(std::size_t n);
    std::span<T> of(const Item& item) { return {values.get() + item.first, item.size}; }
  };

  void collect(const ForeignVariablesOptions& options);
  void collect_vectors(std::vector<Item>& items) const;
  void measure(Item& item, const Numeric& numeric);
  void lay_out();
  Group make_group(std::span<const Item* const> items) const;
  template <class Call>
  void with_store(Kind kind, Call call);
  template <class Call>
  void with_wire(Type type, Call call);
  void* to_wire(Group& group);
  void from_wire(Group& group);
  void* wire_of(Group& group);
  void set(ForeignInstance& instance, Group& group);
  void get(ForeignInstance& instance, Group& group);
  bool changed(const Group& group) const;

  const ModelDescription& description_;
  std::vector<Item> items_;
  std::array<std::vector<Group>, kExchanges> groups_;
  Store<double> reals_;
  Store<std::int32_t> integers_;
  Store<bool> booleans_;
  Store<std::string> strings_;
  std::vector<double> rates_, rate_scratch_;  // of the continuous inputs that are Float64
  std::vector<std::int32_t> orders_;
  std::vector<std::uint32_t> rate_references_;
  std::vector<bool> rate_known_;
  std::vector<std::uint32_t> structural_references_;
  std::vector<std::uint64_t> structural_values_;
  bool ramps_ = false, si_ = true;
  std::vector<std::string> warnings_;
};

template <class T>
void ForeignVariables::Store<T>::allocate(std::size_t n) {
  size = n;
  for (auto* array : {&values, &starts, &given, &sent}) *array = std::make_unique<T[]>(n);
}

template <class Call>
void ForeignVariables::with_store(Kind kind, Call call) {
  switch (kind) {
    case Kind::kReal:
      return call(reals_);
    case Kind::kInteger:
      return call(integers_);
    case Kind::kBoolean:
      return call(booleans_);
    case Kind::kString:
      return call(strings_);
  }
}

/// Calls `call` with a value of the C interface's type, and one of the storage's; not for strings, binaries and clocks.
template <class Call>
void ForeignVariables::with_wire(Type type, Call call) {
  const bool two = description_.version == Version::k2;
  switch (type) {
    case Type::kFloat32:
      return call(float{}, reals_);
    case Type::kFloat64:
      return call(double{}, reals_);
    case Type::kUInt32:
      return call(std::uint32_t{}, reals_);
    case Type::kInt64:
      return call(std::int64_t{}, reals_);
    case Type::kUInt64:
      return call(std::uint64_t{}, reals_);
    case Type::kInt8:
      return call(std::int8_t{}, integers_);
    case Type::kUInt8:
      return call(std::uint8_t{}, integers_);
    case Type::kInt16:
      return call(std::int16_t{}, integers_);
    case Type::kUInt16:
      return call(std::uint16_t{}, integers_);
    case Type::kInt32:
      return call(std::int32_t{}, integers_);
    case Type::kEnumeration:
      return two ? call(std::int32_t{}, integers_) : call(std::int64_t{}, integers_);
    case Type::kBoolean:
      return two ? call(int{}, booleans_) : call(bool{}, booleans_);
    case Type::kString:
    case Type::kBinary:
    case Type::kClock:
      return;
  }
}

}  // namespace cotwin::fmu
