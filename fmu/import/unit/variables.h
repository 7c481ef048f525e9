#pragma once
#include <array>
#include <bit>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "components/unit/time.h"
#include "components/unit/variables.h"
#include "fmu/import/foreign.h"

/// Maps the variables of a foreign FMU to variables of a unit and exchanges their values with the FMU.
namespace cotwin::fmu {

/// Returns the inputs of our own FMI 3 FMUs that are slopes of other inputs (rate.h): index of the slope → index of the input.
std::map<std::size_t, std::size_t> rate_inputs(const ModelDescription& description);

/// When the values of a variable are exchanged with the FMU.
enum class Exchange : std::uint8_t {
  kContinuousInput,  // floats that may be set at any time
  kDiscreteInput,    // set after a change; in event mode if the FMU has it
  kTunable,          // likewise
  kFixed,            // parameters: set before initialisation
  kConstant,         // read once
  kResult,           // outputs, calculated parameters and locals: read after every step
  kClockedInput,     // set while one of its clocks is active
  kClockedResult,    // read while one of its clocks is active
  kClock,            // clocks (ForeignClocks)
  kSlope             // derivatives of outputs, after every step: read from the FMU or computed from the outputs
};
inline constexpr std::size_t kExchanges = 10;

struct ForeignVariablesOptions {
  bool locals = true;                               // also local variables
  std::map<std::string, std::uint64_t> structural;  // values of UInt64 structural parameters, by name
  bool ramps = false;                               // continuous inputs have a rate
  bool si = true;                                   // convert values to SI; false: keep the FMU's values, without a unit
  bool clocks = false;                              // clocks are variables; clocked variables are exchanged at their ticks
  bool slopes = false;  // also "der(y)" of continuous outputs y without a declared derivative; not for our own FMUs
};

/// Roles: input → input; output, calculated parameter, constant → output; local → state; parameter → parameter or tunable;
/// structural parameter → parameter (a UInt64 one has its value as its range, because it can be the size of arrays); clock →
/// boolean, if requested. The independent variable is omitted.
/// Kinds: floats → real; Int8 … Int32, UInt8, UInt16, enumerations → integer; Int64, UInt32, UInt64 →
/// real, where 64-bit start values that double does not have are sent exactly and results are an Error; other integers are clamped to the type's range when set; booleans; strings; binaries → string of hexadecimal digits,
/// as in modelDescription.xml. Arrays are vectors, row by row. In FMI 2, and in FMUs of Cotwin, similar scalars q[1] … q[n] become the vector q. Units
/// of measure: values are converted to SI by the FMU's definition of the unit, else by the unit's name. Values with an unknown
/// unit are not converted and have no unit.
class ForeignVariables {
 public:
  /// `description` must outlive this object.
  ForeignVariables(const ModelDescription& description, const ForeignVariablesOptions& options);
  ForeignVariables(const ForeignVariables&) = delete;
  ForeignVariables& operator=(const ForeignVariables&) = delete;

  void declare(Variables& variables);

  /// Finds the start values of results that were written since the last receive(). `instance`: one that has run, or nullptr.
  void collect_written_starts(ForeignInstance* instance);
  /// Before initialisation: sends all start values that differ from those of the description.
  void set_starts(ForeignInstance& instance);
  /// Sends the values that changed since they were last sent; after forget() all values. Returns whether there were any.
  bool send(ForeignInstance& instance, Exchange exchange);
  /// Returns whether send() would send anything.
  bool changed(Exchange exchange) const;
  void forget();
  /// The rates that were last set to a value other than 0. They are part of the FMU's state. All false after forget().
  std::vector<bool>& nonzero_rates() { return nonzero_rate_; }
  /// Marks the present values as known to the FMU.
  void mark_sent(Exchange exchange);
  void receive(ForeignInstance& instance, Exchange exchange);
  /// Receives only the results that may be read in Initialization Mode.
  void receive_outputs(ForeignInstance& instance);
  /// Returns whether slopes "der(y)" are read from the FMU.
  bool reads_slopes() const { return !groups_[static_cast<std::size_t>(Exchange::kSlope)].empty(); }
  /// Reads the slopes one by one from an initialised FMU. Returns true at the first one that fails; that slope is computed from
  /// now on. The instance is then unusable; repeat with a new one until the result is false.
  bool find_unavailable_slope(ForeignInstance& instance);
  /// After a step of `h`, s: reads the slopes. Those that the FMU does not give are computed over this step from the results,
  /// which must have been received before.
  void receive_slopes(ForeignInstance& instance, double h);
  void clear_slopes();
  /// The computed slopes begin at the present values, for example after a state was restored.
  void restart_slopes();
  /// Notes about slopes that the FMU does not give.
  const std::vector<std::string>& slope_notes() const { return slope_notes_; }
  /// Returns whether the next step must be a full one: a discrete input or a tunable changed, or an input has a rate.
  bool needs_full_step() const;
  /// Returns whether needs_full_step() can become true.
  bool may_need_full_step() const { return has_discrete_inputs_ || !rates_.empty(); }
  /// Returns whether all continuous inputs were sent to the FMU, as step() requires.
  bool inputs_sent() const { return plain_inputs_ == nullptr || plain_inputs_->sent; }
  /// Sends the changed continuous inputs, calls doStep and receives the results, with as few calls as possible. Returns false
  /// as ForeignInstance::step() does.
  bool step(ForeignInstance& instance, Time now, Duration h);
  /// Records the last step if step() did not make it.
  void note_step(Time now, Duration h) {
    plain_now_ = now;
    plain_h_ = h;
    plain_.h = h.seconds();
  }
  /// The last step, and its outcome if step() returned false.
  Time stepped_from() const { return plain_now_; }
  Duration stepped_by() const { return plain_h_; }
  const StepOutcome& outcome() const { return plain_.outcome; }

  /// Returns the boolean variable of a clock; empty if there is none.
  std::span<bool> clock(std::uint32_t reference);
  /// Exchange the variables of the `active` clocks.
  void send_clocked(ForeignInstance& instance, std::span<const std::uint32_t> active);
  void receive_clocked(ForeignInstance& instance, std::span<const std::uint32_t> active);

  /// Sends the rates of continuous inputs, in the FMU's units, as derivatives or as inputs der(u); only those that are or were
  /// not 0. Returns false if there are none.
  bool send_rates(ForeignInstance& instance);
  /// Sends the continuous inputs extrapolated by `dt`, s: value + rate · dt.
  void send_ramped(ForeignInstance& instance, double dt);
  bool any_rate() const;
  /// The continuous inputs of type Float64, and their rates if they have any.
  std::span<const double> continuous_values() const;
  std::span<const double> rates() const { return rates_; }
  /// Value references of the continuous inputs.
  std::vector<std::uint32_t> continuous_inputs() const;
  /// Warnings for the user, to be shown once.
  const std::vector<std::string>& warnings() const { return warnings_; }
  void warn(std::string warning) { warnings_.push_back(std::move(warning)); }

 private:
  /// A declared variable: one variable of the FMU, or several scalars combined to a vector.
  struct Item {
    std::string name, si;
    const std::string* description = nullptr;  // in the model description or in texts_
    Role role = Role::kOutput;
    Kind kind = Kind::kReal;
    Exchange exchange = Exchange::kResult;
    Type type = Type::kFloat64;
    std::vector<std::uint32_t> references;
    std::vector<std::uint32_t> clocks;         // if not empty: exchanged only while one of these is active
    std::vector<std::uint32_t> derivative_of;  // value references of the variables whose derivatives these are
    std::size_t size = 0, first = 0;           // number of elements, index of the first in the storage of the kind
    bool relative = false;                     // a difference
    double factor = 1, offset = 0;             // SI value = factor · FMU value + offset
    double min = 0, max = 0;
    double nominal = 0;                          // in SI; 0: not given
    std::string slope_of;                        // name of the output whose slope this is
    bool continuous = false;                     // variability
    bool settable = false;                       // its start value may be set …
    bool structural = false;                     // … in Configuration Mode
    bool interpolated = true;                    // may have a rate if the FMU interpolates inputs
    std::vector<std::uint32_t> rate_references;  // of the inputs that are its rate
    std::vector<std::string> element_si;         // where elements differ; then `si` is that of the first
    const std::string& si_of(std::size_t element) const { return element_si.empty() ? si : element_si[element]; }
    StartValues start;
  };
  /// Values of one type that one call of the C interface exchanges. Their elements are contiguous in the storage.
  struct Group {
    Type type = Type::kFloat64;
    Kind kind = Kind::kReal;
    bool sent = false;
    std::vector<std::uint32_t> references;
    std::size_t first = 0, size = 0;
    std::vector<std::uint32_t> clocks;
    std::vector<double> factors, offsets;  // empty: no conversion
    std::vector<std::byte> wire;           // buffer, if the C interface has another type than the storage
    std::vector<const char*> texts;
    std::vector<const std::uint8_t*> bytes;
    std::vector<std::size_t> sizes;  // of bytes
    std::vector<std::vector<std::uint8_t>> binaries;
  };
  /// All values of one kind.
  template <class T>
  struct Store {
    T *values = nullptr, *sent = nullptr;   // present values; values last sent
    T *starts = nullptr, *given = nullptr;  // start values of the description; of the user
    std::unique_ptr<T[]> block;             // memory of all four
    std::size_t size = 0;
    void allocate(std::size_t n);
    std::span<T> of(const Item& item) { return {values + item.first, item.size}; }
  };

  void collect(const ForeignVariablesOptions& options);
  void collect_vectors(std::vector<Item>& items) const;
  void collect_slopes();
  void group_available_slopes();
  void measure(Item& item, const Numeric& numeric, const DescriptionIndex& index);
  using FirstOfReference = std::unordered_map<std::uint32_t, const Item*>;  // value reference → first item that begins with it
  const Item* antiderivative(const Item& item, const FirstOfReference& first) const;
  const std::string* store_text(std::string text) { return &texts_.emplace_back(std::move(text)); }
  void lay_out();
  void keep_exact(const Item& item, std::size_t i);
  Group make_group(std::span<const Item* const> items) const;
  template <class Call>
  void with_store(Kind kind, Call call);
  template <class Call>
  void with_wire(Type type, Call call);
  void* to_wire(Group& group);
  void from_wire(Group& group);
  std::string name_of(const Group& group, std::size_t element) const;
  void* wire_of(Group& group);
  bool send_rate_inputs(ForeignInstance& instance);
  void set(ForeignInstance& instance, Group& group);
  void get(ForeignInstance& instance, Group& group);
  bool changed(const Group& group) const;
  bool mark_changed_inputs();
  void receive_others(ForeignInstance& instance, double h);
  bool send(ForeignInstance& instance, Group& group);

  // Used in every step. "Plain": continuous inputs and results of type Float64 without conversion.
  PlainStep plain_;
  Group* plain_inputs_ = nullptr;  // nullptr if not all continuous inputs are plain
  double* plain_sent_ = nullptr;
  Time plain_now_;  // of the last step()
  Duration plain_h_;
  Store<double> reals_;
  bool has_other_inputs_ = false, has_other_results_ = false, has_discrete_inputs_ = false;
  std::vector<double> rates_;  // of the continuous inputs that are Float64

  const ModelDescription& description_;
  std::vector<Item> items_;
  std::array<std::vector<Group>, kExchanges> groups_;
  std::vector<Group> outputs_;  // of the results, for receive_outputs()
  ExactIntegers exact_;         // start values
  Store<std::int32_t> integers_;
  Store<bool> booleans_;
  Store<std::string> strings_;
  std::vector<double> rate_scratch_;
  std::vector<std::int32_t> orders_, slope_orders_;
  std::vector<std::uint32_t> rate_references_;
  /// A slope that the FMU does not give, and the values of its output before the step.
  struct ComputedSlope {
    const Item *slope, *of;
    std::vector<double> before;
  };
  std::vector<ComputedSlope> computed_slopes_;
  std::size_t slopes_probed_ = 0;  // number of items that find_unavailable_slope() has checked
  std::vector<std::string> slope_notes_;
  std::vector<const Item*> rated_items_;  // items whose rates are inputs
  std::vector<bool> nonzero_rate_;
  std::vector<std::uint32_t> structural_references_;
  std::vector<std::uint64_t> structural_values_;
  bool ramps_ = false, si_ = true;
  std::vector<std::string> warnings_;
  std::deque<std::string> texts_;        // descriptions made for items
  std::set<std::string> unknown_units_;  // already named in a warning
};

/// Returns whether the plain inputs changed since they were last sent, and marks them as sent.
inline bool ForeignVariables::mark_changed_inputs() {
  if (plain_.set_values.empty()) return false;
  std::uint64_t difference = 0;
  const double* now = plain_.set_values.data();
  double* sent = plain_sent_;
  const auto take = [&](std::size_t i) {
    difference |= std::bit_cast<std::uint64_t>(now[i]) ^ std::bit_cast<std::uint64_t>(sent[i]);
    sent[i] = now[i];
  };
  take(0);
  for (std::size_t i = 1; i < plain_.set_values.size(); ++i) [[unlikely]] take(i);
  return difference != 0;
}

// Rare cases are marked [[unlikely]] and moved out of the straight path: a master calls this for many FMUs in turn, and the
// branch predictor then has room for the branches that differ between them.
inline bool ForeignVariables::step(ForeignInstance& instance, Time now, Duration h) {
  if (h != plain_h_) [[unlikely]] {
    plain_h_ = h;
    plain_.h = h.seconds();
  }
  plain_now_ = now;
  plain_.now = now.seconds();
  if (has_other_inputs_) [[unlikely]]
    send(instance, Exchange::kContinuousInput);
  if (!instance.step(plain_, mark_changed_inputs())) [[unlikely]]
    return false;
  if (has_other_results_) [[unlikely]]
    receive_others(instance, plain_.h);
  return true;
}

template <class T>
void ForeignVariables::Store<T>::allocate(std::size_t n) {
  size = n;
  block = std::make_unique<T[]>(4 * n);
  values = block.get();
  sent = values + n;
  starts = sent + n;
  given = starts + n;
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

/// Calls `call` with a value of the C interface's type and the storage of the kind; not for strings, binaries and clocks.
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
