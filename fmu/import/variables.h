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

/// The variables of a foreign FMU as those of a unit, and how their values get to the FMU and back.
namespace cotwin::fmu {

/// The inputs that are slopes of other inputs (rate.h), in FMUs of FMI 3 that are ours: index of the slope → index of the
/// input.
std::map<std::size_t, std::size_t> rate_inputs(const ModelDescription& description);

/// Which variables an FMU shows, by what may be done with them and when.
enum class Exchange : std::uint8_t {
  kContinuousInput,  // floats that may be set at any time
  kDiscreteInput,    // set where they changed; in event mode where there is one
  kTunable,          // likewise
  kFixed,            // parameters: set before initialisation
  kConstant,         // read once
  kResult,           // outputs, calculated parameters and locals: read after every step
  kClockedInput,     // set while a clock of theirs is active
  kClockedResult,    // read then
  kClock,            // clocks (ForeignClocks)
  kSlope             // derivatives of outputs: read after every step, by a function of their own or from the outputs
};
inline constexpr std::size_t kExchanges = 10;

struct ForeignVariablesOptions {
  bool locals = true;                               // also those variables that are neither parameter nor input nor output
  std::map<std::string, std::uint64_t> structural;  // UInt64 by name, instead of their start values
  bool ramps = false;                               // continuous inputs have a rate
  bool si = true;                                   // values in SI; false: as the FMU has them, without a measure
  bool clocks = false;                              // clocks are variables, and what belongs to them waits for them
  bool slopes = false;  // also "der(y)" of continuous outputs y that have no derivative among them; not of our own FMUs
};

/// Roles: input → input; output, calculated parameter and constant → output; local → state; parameter → parameter or tunable;
/// structural parameter → parameter, if it is a UInt64 with its value as its range, since it may give the sizes of others;
/// clocks → boolean, where they are wanted; the independent variable is left out. Kinds: floats → real; integers of at most 32
/// bits signed, enumerations → integer; Int64, UInt32 and UInt64 → real, exact up to 2^53 and clamped to the type's range on
/// the way back; booleans; strings; binaries → string of hexadecimal digits, as in modelDescription.xml. Arrays are vectors,
/// row by row; in FMI 2, scalars named q[1] … q[n] that are alike are the vector q. Units of measure: values are converted to
/// SI by the FMU's own definition or, without one, by its name; a unit that nobody knows is left as it is and has no measure.
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
  /// Of the results those alone that may be read in Initialization Mode.
  void receive_outputs(ForeignInstance& instance);
  /// Whether "der(y)" are wanted that the FMU is asked for.
  bool asks_for_slopes() const { return !groups_[static_cast<std::size_t>(Exchange::kSlope)].empty(); }
  /// Asks an FMU that could make its first step for the slopes, one by one, until one is refused: true, and that one is asked
  /// for never again. Then the FMU had an error; a new instance is to be asked for the rest.
  bool refuses_a_slope(ForeignInstance& instance);
  /// After a step of `h`, s. Slopes that the FMU refused are those of this step, by the results, which must have been received.
  void receive_slopes(ForeignInstance& instance, double h);
  void clear_slopes();
  /// The variables are those of another instant.
  void restart_slopes();
  /// What there is to tell of slopes that were refused.
  const std::vector<std::string>& refused_slopes() const { return refused_slopes_; }
  /// Whether a step must be led by hand: a discrete input or a tunable changed, or an input has a rate.
  bool needs_care() const;
  /// Whether needs_care() may ever say so.
  bool may_need_care() const { return has_discrete_inputs_ || !rates_.empty(); }
  /// Whether the FMU was sent all of its continuous inputs, as step() takes for granted.
  bool knows_inputs() const { return plain_inputs_ == nullptr || plain_inputs_->sent; }
  /// Sends the continuous inputs that changed, lets the FMU step, and receives the results, with as few calls as that takes.
  /// False: see ForeignInstance::step().
  bool step(ForeignInstance& instance, Time now, Duration h);
  /// The last step is this one, whoever made it.
  void note_step(Time now, Duration h) {
    plain_now_ = now;
    plain_h_ = h;
    plain_.h = h.seconds();
  }
  /// The last step, and what came of step() if it returned false.
  Time stepped_from() const { return plain_now_; }
  Duration stepped_by() const { return plain_h_; }
  const StepOutcome& outcome() const { return plain_.outcome; }

  /// The boolean of a clock, empty if it is not among the variables.
  std::span<bool> clock(std::uint32_t reference);
  /// Those variables that belong to one of the `active` clocks.
  void send_clocked(ForeignInstance& instance, std::span<const std::uint32_t> active);
  void receive_clocked(ForeignInstance& instance, std::span<const std::uint32_t> active);

  /// Rates of the continuous inputs, in the FMU's own units, as derivatives or as inputs of their own; of those alone that are
  /// not 0 or were not. False if there are none.
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
  void warn(std::string warning) { warnings_.push_back(std::move(warning)); }

 private:
  /// A declared variable: one of the FMU's, or several as a vector.
  struct Item {
    std::string name, si;
    const std::string* description = nullptr;  // of the model description, or one that was made here
    Role role = Role::kOutput;
    Kind kind = Kind::kReal;
    Exchange exchange = Exchange::kResult;
    Type type = Type::kFloat64;
    std::vector<std::uint32_t> references;
    std::vector<std::uint32_t> clocks;         // in event mode alone, while one of these is active
    std::vector<std::uint32_t> derivative_of;  // value references of what these are the derivatives of
    std::size_t size = 0, first = 0;           // elements, in the storage of its kind
    double factor = 1, offset = 0;             // SI = factor · the FMU's + offset
    double min = 0, max = 0;
    std::string slope_of;                         // name of the output whose slope this is
    bool continuous = false;                      // variability
    bool settable = false;                        // its start value may be given …
    bool structural = false;                      // … in the configuration mode
    bool interpolated = true;                     // may have a rate where the FMU follows its inputs
    std::optional<std::uint32_t> rate_reference;  // of the input that is its rate
    StartValues start;
  };
  /// Values of one type that go through one call of the C interface; their elements lie side by side in the storage.
  struct Group {
    Type type = Type::kFloat64;
    Kind kind = Kind::kReal;
    bool sent = false;
    std::vector<std::uint32_t> references;
    std::size_t first = 0, size = 0;
    std::vector<std::uint32_t> clocks;
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
    T *values = nullptr, *sent = nullptr;   // as they are; as the FMU has them
    T *starts = nullptr, *given = nullptr;  // as the description and as the user want them at first
    std::unique_ptr<T[]> block;             // all of them
    std::size_t size = 0;
    void allocate(std::size_t n);
    std::span<T> of(const Item& item) { return {values + item.first, item.size}; }
  };

  void collect(const ForeignVariablesOptions& options);
  void collect_vectors(std::vector<Item>& items) const;
  void collect_slopes();
  void ask_for_told_slopes();
  void measure(Item& item, const Numeric& numeric, const DescriptionIndex& index);
  using FirstOfReference = std::unordered_map<std::uint32_t, const Item*>;  // the first item with that value reference in front
  const Item* antiderivative(const Item& item, const FirstOfReference& first) const;
  const std::string* keep(std::string text) { return &texts_.emplace_back(std::move(text)); }
  void lay_out();
  Group make_group(std::span<const Item* const> items) const;
  template <class Call>
  void with_store(Kind kind, Call call);
  template <class Call>
  void with_wire(Type type, Call call);
  void* to_wire(Group& group);
  void from_wire(Group& group);
  void* wire_of(Group& group);
  bool send_rate_inputs(ForeignInstance& instance);
  void set(ForeignInstance& instance, Group& group);
  void get(ForeignInstance& instance, Group& group);
  bool changed(const Group& group) const;
  bool takes_changed_inputs();
  void receive_others(ForeignInstance& instance, double h);
  bool send(ForeignInstance& instance, Group& group);

  // What every step looks at.
  PlainStep plain_;                // all continuous inputs, and those results, that are Float64 without conversion …
  Group* plain_inputs_ = nullptr;  // … and their group; the others go through calls of their own
  double* plain_sent_ = nullptr;
  Time plain_now_;    // of the last step() …
  Duration plain_h_;  // … likewise
  Store<double> reals_;
  bool has_other_inputs_ = false, has_other_results_ = false, has_discrete_inputs_ = false;
  std::vector<double> rates_;  // of the continuous inputs that are Float64

  const ModelDescription& description_;
  std::vector<Item> items_;
  std::array<std::vector<Group>, kExchanges> groups_;
  std::vector<Group> outputs_;  // of the results, for receive_outputs()
  Store<std::int32_t> integers_;
  Store<bool> booleans_;
  Store<std::string> strings_;
  std::vector<double> rate_scratch_;
  std::vector<std::int32_t> orders_, slope_orders_;
  std::vector<std::uint32_t> rate_references_;
  /// A slope that the FMU does not tell, and the values of its output before the step.
  struct Untold {
    const Item *slope, *of;
    std::vector<double> before;
  };
  std::vector<Untold> untold_slopes_;
  std::size_t slopes_asked_ = 0;  // that many of the items were found to be no slopes, told or untold
  std::vector<std::string> refused_slopes_;
  std::vector<const Item*> rated_items_;  // whose rates are inputs
  std::vector<bool> rate_known_;
  std::vector<std::uint32_t> structural_references_;
  std::vector<std::uint64_t> structural_values_;
  bool ramps_ = false, si_ = true;
  std::vector<std::string> warnings_;
  std::deque<std::string> texts_;        // that were made for items
  std::set<std::string> unknown_units_;  // that the warnings name
};

/// Whether the plain inputs changed since they were last sent, which they are taken to be from now on.
inline bool ForeignVariables::takes_changed_inputs() {
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

// Branches that are not taken leave the predictor's memory to those that tell one FMU from the next.
inline bool ForeignVariables::step(ForeignInstance& instance, Time now, Duration h) {
  if (h != plain_h_) [[unlikely]] {
    plain_h_ = h;
    plain_.h = h.seconds();
  }
  plain_now_ = now;
  plain_.now = now.seconds();
  if (has_other_inputs_) [[unlikely]]
    send(instance, Exchange::kContinuousInput);
  if (!instance.step(plain_, takes_changed_inputs())) [[unlikely]]
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
