#include "fmu/import/package.h"

#include <cmath>
#include <concepts>
#include <cstring>
#include <type_traits>
#include <utility>

#include "fmu/description/consistency.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

constexpr std::size_t kUsual = 48;                     // bytes of a variable's other texts, start value and dependencies
constexpr std::uint64_t kMagic = 0x334e474645525443u;  // the bytes "CTREFGN3": the format and its version

// The list of fields of each structure, used for writing and for reading.
template <class T, class Structure>
concept Is = std::same_as<std::remove_const_t<T>, Structure>;

void fields(Is<Numeric> auto& n, auto each) {
  each(n.quantity, n.unit, n.display_unit, n.relative_quantity, n.unbounded, n.min, n.max, n.nominal);
}
void fields(Is<Clock> auto& c, auto each) {
  each(c.can_be_deactivated, c.priority, c.interval_variability, c.interval, c.shift, c.supports_fraction, c.resolution,
       c.interval_counter, c.shift_counter);
}
void fields(Is<Dimension> auto& d, auto each) { each(d.size, d.reference); }
void fields(Is<Alias> auto& a, auto each) { each(a.name, a.description, a.display_unit); }
void fields(Is<ModelVariable> auto& v, auto each) {
  each(v.name, v.reference, v.type, v.description, v.causality, v.variability, v.initial, v.can_handle_multiple_set, v.clocks,
       v.dimensions, v.intermediate_update, v.previous, v.declared_type, v.numeric, v.start, v.derivative, v.reinit,
       v.mime_type, v.max_size, v.clock, v.aliases, v.interpolated);
}
void fields(Is<EnumerationItem> auto& i, auto each) { each(i.name, i.value, i.description); }
void fields(Is<TypeDefinition> auto& t, auto each) {
  each(t.name, t.type, t.description, t.numeric, t.items, t.mime_type, t.max_size, t.clock);
}
void fields(Is<DisplayUnit> auto& u, auto each) { each(u.name, u.factor, u.offset, u.inverse); }
void fields(Is<UnitDefinition> auto& u, auto each) {
  each(u.name, u.kg, u.m, u.s, u.A, u.K, u.mol, u.cd, u.rad, u.factor, u.offset);
}
void fields(Is<MeasurementUnit> auto& u, auto each) { each(u.name, u.definition, u.display_units); }
void fields(Is<Unknown> auto& u, auto each) { each(u.variable, u.dependencies, u.kinds); }
void fields(Is<ModelStructure> auto& s, auto each) {
  each(s.outputs, s.derivatives, s.clocked_states, s.initial_unknowns, s.event_indicators);
}
void fields(Is<Interface> auto& i, auto each) {
  each(i.model_identifier, i.needs_execution_tool, i.only_once_per_process, i.can_get_and_set_state, i.can_serialise_state,
       i.provides_directional_derivatives, i.provides_adjoint_derivatives, i.provides_per_element_dependencies, i.variable_step,
       i.fixed_internal_step, i.max_output_derivative_order, i.recommended_input_smoothness, i.provides_intermediate_update,
       i.might_return_early, i.can_return_early_after_intermediate_update, i.has_event_mode,
       i.provides_evaluate_discrete_states, i.can_interpolate_inputs, i.can_run_asynchronously,
       i.needs_completed_integrator_step, i.can_not_use_memory_functions, i.source_files);
}
void fields(Is<DefaultExperiment> auto& e, auto each) { each(e.start, e.stop, e.tolerance, e.step); }
void fields(Is<LogCategory> auto& c, auto each) { each(c.name, c.description); }
void fields(Is<ModelDescription> auto& d, auto each) {
  each(d.version, d.fmi_version, d.model_name, d.token, d.description, d.author, d.model_version, d.copyright, d.license,
       d.generation_tool, d.generation_date, d.structured_names, d.event_indicators, d.model_exchange, d.co_simulation,
       d.scheduled_execution, d.units, d.types, d.log_categories, d.default_experiment, d.variables, d.structure);
}
void fields(Is<LoadOptions> auto& o, auto each) {
  each(o.instance_name, o.kind, o.locals, o.structural, o.stop, o.tolerance, o.si, o.slopes, o.rollback);
}
void fields(Is<ForeignPackage> auto& p, auto each) { each(p.name, p.folder, p.options, p.description); }

// The last value of each enumeration, and the first value, which is 0 except for Version.
constexpr Version last(Version) { return Version::k3; }
constexpr Type last(Type) { return Type::kClock; }
constexpr Causality last(Causality) { return Causality::kStructuralParameter; }
constexpr Variability last(Variability) { return Variability::kContinuous; }
constexpr Initial last(Initial) { return Initial::kCalculated; }
constexpr DependencyKind last(DependencyKind) { return DependencyKind::kDiscrete; }
constexpr IntervalVariability last(IntervalVariability) { return IntervalVariability::kTriggered; }
constexpr InterfaceChoice last(InterfaceChoice) { return InterfaceChoice::kModelExchange; }
constexpr Version first(Version) { return Version::k2; }
template <class Enum>
constexpr Enum first(Enum) {
  return Enum{};
}

template <class T>
concept Plain = std::is_arithmetic_v<T> || std::is_enum_v<T>;

class Putter {
 public:
  Putter() = default;
  explicit Putter(std::string buffer) : out_(std::move(buffer)) {}
  const std::string& bytes() const { return out_.bytes(); }
  std::string take() { return out_.take(); }

  void put(Plain auto value) {
    if constexpr (std::is_enum_v<decltype(value)>) {
      out_.value(static_cast<std::underlying_type_t<decltype(value)>>(value));
    } else {
      out_.value(value);
    }
  }
  void put(const std::string& text) { out_.text(text); }
  template <class T>
  void put(const std::optional<T>& value) {
    put(value.has_value());
    if (value) put(*value);
  }
  template <class T>
  void put(const std::vector<T>& list) {
    out_.value(static_cast<std::uint64_t>(list.size()));
    for (const T& item : list) put(item);
  }
  void put(const std::map<std::string, std::uint64_t>& map) {
    out_.value(static_cast<std::uint64_t>(map.size()));
    for (const auto& [key, value] : map) put(key), put(value);
  }
  void put(const StartValues& start) {
    put(static_cast<std::uint8_t>(start.index()));
    std::visit(
        [this](const auto& list) {
          if constexpr (!std::same_as<std::remove_cvref_t<decltype(list)>, std::monostate>) put(list);
        },
        start);
  }
  template <class T>
  requires(!Plain<T>) void put(const T& structure) {
    fields(structure, [this](const auto&... field) { (this->put(field), ...); });
  }

 private:
  ByteWriter out_;
};

/// Returns the smallest number of bytes of a T: empty strings and lists, no optional value.
template <class T>
std::size_t least_bytes() {
  static const std::size_t bytes = [] {
    Putter least;
    least.put(T{});
    return least.bytes().size();
  }();
  return bytes;
}

class Getter {
 public:
  explicit Getter(ByteReader& in) : in_(in) {}

  template <Plain T>
  void get(T& value) {
    if constexpr (std::is_enum_v<T>) {
      const auto number = in_.value<std::underlying_type_t<T>>();
      value = static_cast<T>(number);
      if (value < first(T{}) || value > last(T{}))
        in_.fail("has the invalid enumeration value " + std::to_string(number) + ", expected " +
                 std::to_string(static_cast<int>(first(T{}))) + " to " + std::to_string(static_cast<int>(last(T{}))));
    } else if constexpr (std::same_as<T, bool>) {
      value = in_.value<std::uint8_t>() != 0;
    } else {
      value = in_.value<T>();
    }
  }
  void get(std::string& text) { text = in_.text(); }
  template <class T>
  void get(std::optional<T>& value) {
    value.reset();
    if (in_.value<std::uint8_t>() != 0) get(value.emplace());
  }
  template <class T>
  void get(std::vector<T>& list) {
    list.resize(in_.count(least_bytes<T>()));
    for (std::size_t i = 0; i < list.size(); ++i) {
      if constexpr (std::same_as<T, bool>) {
        list[i] = in_.value<std::uint8_t>() != 0;
      } else {
        get(list[i]);
      }
    }
  }
  void get(std::map<std::string, std::uint64_t>& map) {
    for (std::size_t n = in_.count(2 * sizeof(std::uint64_t)); n > 0; --n) {
      const std::string key = in_.text();
      map[key] = in_.value<std::uint64_t>();
    }
  }
  void get(StartValues& start) { get_alternative<0>(start, in_.value<std::uint8_t>()); }
  template <class T>
  requires(!Plain<T>) void get(T& structure) {
    fields(structure, [this](auto&... field) { (this->get(field), ...); });
  }

 private:
  template <std::size_t I>
  void get_alternative(StartValues& start, std::size_t index) {
    if constexpr (I == std::variant_size_v<StartValues>) {
      in_.fail("has start values of an unknown type");
    } else if (I != index) {
      get_alternative<I + 1>(start, index);
    } else {
      auto& list = start.emplace<I>();
      if constexpr (I != 0) get(list);
    }
  }

  ByteReader& in_;
};

/// Throws Error, without a place, for an invalid package.
void check(const ForeignPackage& package) {
  if (!is_file_name(package.folder)) throw Error("'" + package.folder + "', expected the name of a folder");
  const LoadOptions& o = package.options;
  if ((o.stop && !std::isfinite(*o.stop)) || (o.tolerance && !(std::isfinite(*o.tolerance) && *o.tolerance > 0)))
    throw Error("stop time or tolerance not finite, or tolerance not above 0");
  check_all(package.description);
  static_cast<void>(package.interface());
}

}  // namespace

std::string serialise(const ForeignPackage& package) {
  at(package.name, [&] { check(package); });
  return serialise_checked(package.name, package.folder, package.options, package.description, package.start);
}

std::string serialise_checked(const std::string& name, const std::string& folder, const LoadOptions& options,
                              const ModelDescription& description, const Snapshot& start) {
  std::size_t size = 0;  // about, so that the bytes of large descriptions are not copied as they grow
  for (const ModelVariable& v : description.variables)
    size += least_bytes<ModelVariable>() + least_bytes<Unknown>() + v.name.size() + v.description.size() + kUsual;
  std::string buffer;
  buffer.reserve(size);
  Putter out(std::move(buffer));
  out.put(kMagic);
  out.put(std::uint64_t{0});  // the hash
  out.put(name);
  out.put(folder);
  out.put(options);
  out.put(description);
  out.put(start.serialise());
  std::string bytes = out.take();
  const std::uint64_t hash = hash_of(std::string_view(bytes).substr(2 * sizeof kMagic));
  std::memcpy(bytes.data() + sizeof kMagic, &hash, sizeof hash);
  return bytes;
}

bool is_foreign_package(std::string_view bytes) {
  return bytes.size() >= sizeof kMagic && std::memcmp(bytes.data(), &kMagic, sizeof kMagic) == 0;
}

ForeignPackage deserialise_foreign(std::string_view bytes, const std::string& place) {
  ByteReader in(as_bytes(bytes), place);
  if (!is_foreign_package(bytes) || in.value<std::uint64_t>() != kMagic) in.fail("is not a packed FMU of this version");
  if (in.value<std::uint64_t>() != hash_of(bytes.substr(2 * sizeof(std::uint64_t)))) in.fail("is damaged");
  ForeignPackage package;
  Getter(in).get(package);
  const std::string start = in.text();
  in.expect_end();
  at(place, [&] {
    package.start = Snapshot::deserialise(start);
    check(package);
  });
  return package;
}

bool holds_fmus(const std::string& platform) { return platform.ends_with("-linux"); }

Instance make_instance(ForeignPackage package, const std::filesystem::path& resources) {
#if defined(COTWIN_HOLDS_FMUS)
  auto fmu = std::make_shared<ForeignFmu>();
  fmu->name = package.name;
  fmu->folder = resources / package.folder;
  fmu->description = std::move(package.description);
  Instance instance;
  at(package.name, [&] {
    instance = make_instance(std::move(fmu), package.options);
    if (!package.start.empty()) package.start.write(instance.variables);
  });
  return instance;
#else
  throw Error((resources / package.folder).string(), "FMUs inside an FMU are not supported on this platform");
#endif
}

}  // namespace cotwin::fmu
