#include "fmu/export/export.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>

#include "fmu/description/categories.h"
#include "fmu/description/rate.h"
#include "fmu/export/own_library.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kStateMagic = 0x31415453544f4343u;  // the bytes "CCOTSTA1": the format of a saved state and its version
constexpr double kNanoseconds = 1e9;                        // per second
constexpr double kLatest = 9e9;                             // s; latest time in 64-bit nanoseconds

/// Returns the folder resources/ of the unpacked archive that contains this library: <archive>/binaries/<platform>/<library>.
fs::path own_resources() {
  const fs::path library = own_library();
  return library.empty() ? library : library.parent_path().parent_path().parent_path() / "resources";
}

/// Returns the given folder or else own_resources(), the first that contains a package.
fs::path find_resources(const std::optional<fs::path>& given) {
  std::error_code ignored;
  const fs::path own = own_resources();
  if (given && fs::is_regular_file(*given / kPackageFile, ignored)) return *given;
  if (!own.empty() && fs::is_regular_file(own / kPackageFile, ignored)) return own;
  throw Error((given ? "no " + (*given / kPackageFile).string()
                     : "no resource path was given (fmi2Instantiate, fmi3InstantiateCoSimulation)") +
              ", and no file " + (own / kPackageFile).string());
}

std::string read(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream content;
  content << in.rdbuf();
  if (!in) throw Error(path.string(), "cannot be read");
  return content.str();
}

double seconds(std::int64_t ns) { return static_cast<double>(ns) / kNanoseconds; }

std::int64_t nanoseconds(double s, const char* what) {
  if (!(std::abs(s) < kLatest)) throw Error(std::string(what) + " = " + text::to_text(s) + " s, expected a time below 9e9 s");
  return static_cast<std::int64_t>(std::llround(s * kNanoseconds));
}

double ulp(double s) { return std::nextafter(std::abs(s), std::numeric_limits<double>::infinity()) - std::abs(s); }

}  // namespace

const char* name_of(State state) {
  switch (state) {
    case kInstantiated:
      return "before Initialization Mode";
    case kInitialising:
      return "in Initialization Mode";
    case kStepping:
      return "while stepping";
    case kStepDiscarded:
      return "after a discarded step; restore a state or reset";
    case kTerminated:
      return "after Terminate";
    case kFailed:
      return "after a failure; restore a state or reset";
  }
  return "";
}

Exported::Exported(References references, const std::string& token, const std::optional<fs::path>& resources)
    : references_(references), resources_(find_resources(resources)) {
  const fs::path file = resources_ / kPackageFile;
  package_ = deserialise_package(read(file), file.string());
  if (package_.unit != exported_unit().name) {
    throw Error(file.string(), "contains the unit " + package_.unit + ", expected " + exported_unit().name);
  }
  if (package_.token != token) {
    throw Error("the instantiation token is '" + token + "', expected that of modelDescription.xml, '" + package_.token + "'");
  }
  build();
}

void Exported::build() {
  Settings settings(package_.unit, package_.query, {}, {resources_});
  settings.set_robot(package_.robot);
  settings.set_cell(package_.cell);
  drop();  // before the new unit is built, for the unit, or an FMU inside, may allow only one instance per process
  unit_ = construct(exported_unit(), settings);
  unit_->declare(variables_);
  package_.start.write(variables_);
  warnings_ = settings.warnings();

  for (const Variable& variable : variables_) {
    const bool computed = variable.role == Role::kOutput || variable.role == Role::kState;
    if (computed && variable.kind() == Kind::kReal) computed_.push_back(variable.reals());
    add_slots(variable);
  }
  if (references_ == References::kVariables) {
    for (const Variable& variable : variables_) {
      if (!variable.rate.empty()) rates_.push_back(rate_variable(variable));
    }
    for (const Variable& rate : rates_) add_slots(rate);
  }
  find_partials();
  memory_ = {};
}

/// One for the variable, or for each element: arrays have one unit of measure.
void Exported::add_slots(const Variable& variable) {
  const std::size_t count = references_ == References::kVariables && !variable.mixed() ? variable.size() : 1;
  for (std::size_t i = 0; i < variable.size(); i += count) slots_.push_back({&variable, i, count});
}

/// Destroys the unit and all references to it; keeps the time.
void Exported::drop() {
  blocks_.clear();
  partials_.clear();
  computed_.clear();
  slots_.assign(1, {});
  rates_.clear();
  variables_ = {};
  unit_.reset();
}

Unit& Exported::unit() const {
  if (unit_ == nullptr) throw Error("the last reset failed; reset again or free the instance");
  return *unit_;
}

void Exported::find_partials() {
  std::size_t size = 0;
  for (const Partial& p : unit_->partials()) {
    const Variable &unknown = variables_.at(p.unknown), &known = variables_.at(p.known);
    blocks_.push_back({&unknown, &known, p.elementwise, size});
    size += p.elementwise ? unknown.size() : unknown.size() * known.size();
  }
  partials_.assign(size, 0.0);
}

void Exported::check_finite() const {
  bool finite = true;  // no branch in the loop, for it runs in every step
  for (const std::span<const double> values : computed_) {
    for (const double value : values) finite &= std::abs(value) <= std::numeric_limits<double>::max();
  }
  if (finite) return;
  if (const std::string name = variables_.first_not_finite(); !name.empty()) {
    throw Error(name + " is not finite at " + text::to_text(seconds(memory_.time_ns)) + " s");
  }
}

// Life cycle

void Exported::setup(double start, std::optional<double> stop) {
  const std::int64_t start_ns = nanoseconds(start, "startTime");
  const std::int64_t stop_ns = stop ? nanoseconds(*stop, "stopTime") : 0;
  if (stop && stop_ns < start_ns) {
    throw Error("stopTime = " + text::to_text(*stop) + " s, expected at least startTime = " + text::to_text(start) + " s");
  }
  memory_.start_ns = memory_.time_ns = start_ns;
  memory_.host_time = start;
  memory_.has_stop = stop.has_value();
  memory_.stop_ns = stop_ns;
}

void Exported::enter_initialisation() {
  memory_.state = kInitialising;
  memory_.initialised = false;
}

void Exported::initialise() {
  if (memory_.initialised) return;
  variables_.check_ranges();
  in_unit([&] {
    unit_->initialise(Time{memory_.start_ns});
    check_finite();
  });
  memory_.initialised = true;
  ++initialisation_;
}

void Exported::exit_initialisation() {
  initialise();
  memory_.state = kStepping;
}

void Exported::terminate() {
  memory_.state = kTerminated;
  if (unit_ == nullptr) return;
  unit_->end();
  std::vector<std::string> notes;
  unit_->append_notes(notes);
  for (const std::string& note : notes) report(Status::kWarning, note);
}

Status Exported::step(double now, double h) {
  if (!(h > 0) || !(std::abs(now) + h < kLatest)) {
    throw Error("a step of " + text::to_text(h) + " s at " + text::to_text(now) +
                " s, expected a positive step size and a time below 9e9 s");
  }
  if (memory_.finished) throw Error("the unit has ended the run at " + text::to_text(memory_.host_time) + " s");
  // Tolerance: a host that adds up its steps accumulates half an ulp of its time per step; 1 ns covers the rounding to whole
  // nanoseconds.
  const double end = now + h;
  const double slack_ns = 1 + static_cast<double>(memory_.steps + 1) * ulp(end) * kNanoseconds;
  if (std::abs(now * kNanoseconds - static_cast<double>(memory_.time_ns)) > slack_ns) {
    throw Error("currentCommunicationPoint = " + text::to_text(now) + " s, expected " + text::to_text(memory_.host_time) +
                " s, where the last step ended");
  }
  // A step of whole nanoseconds within rounding is made exactly so, and time is an exact multiple of it. Other steps end at the
  // nanosecond nearest to the host's time, so that rounding errors do not add up.
  const double h_ns = h * kNanoseconds;
  const double whole_ns = std::round(h_ns);
  const bool whole = std::abs(h_ns - whole_ns) <= std::min(0.25, 2 * ulp(end) * kNanoseconds + 1e-15 * h_ns);
  const std::int64_t end_ns = whole ? memory_.time_ns + static_cast<std::int64_t>(whole_ns) : std::llround(end * kNanoseconds);
  if (memory_.has_stop && static_cast<double>(end_ns - memory_.stop_ns) > slack_ns) {
    throw Error("a step to " + text::to_text(end) +
                " s, expected none beyond stopTime = " + text::to_text(seconds(memory_.stop_ns)) + " s");
  }
  StepResult result = StepResult::kDone;
  if (end_ns > memory_.time_ns) {  // else the step is only a rounding error of the host
    in_unit([&] { result = unit_->step(Time{memory_.time_ns}, Duration{end_ns - memory_.time_ns}); });
  }
  if (result == StepResult::kDiscard) {
    memory_.state = kStepDiscarded;
    return Status::kDiscard;
  }
  memory_.time_ns = std::max(end_ns, memory_.time_ns);
  memory_.host_time = end;
  ++memory_.steps;
  memory_.finished = result == StepResult::kFinished;
  in_unit([&] { check_finite(); });
  return Status::kOk;
}

void Exported::reset() {
  in_unit([&] { build(); });
}

// Saved states

const Exported::Saved& Exported::find(const void* saved) const {
  const auto found = saved_.find(saved);
  if (found == saved_.end()) throw Error("this state was not saved by this instance");
  return *found->second;
}

void* Exported::save(void* reuse) {
  if (!unit().restorable()) throw Error("the unit communicates with the outside; its state cannot be saved");
  const auto found = saved_.find(reuse);
  std::unique_ptr<Saved> fresh = found == saved_.end() ? std::make_unique<Saved>() : nullptr;
  Saved& saved = fresh ? *fresh : *found->second;
  saved.snapshot.take(variables_, *unit_);
  saved.memory = memory_;
  saved.initialisation = memory_.initialised ? initialisation_ : 0;
  if (fresh) saved_.emplace(&saved, std::move(fresh));
  return &saved;
}

void Exported::restore(const void* handle) {
  const Saved& saved = find(handle);
  static_cast<void>(unit());  // throws if there is no unit
  in_unit([&] {
    const bool same = saved.initialisation == initialisation_ && memory_.initialised && memory_.state != kFailed;
    if (saved.memory.initialised && same) {
      saved.snapshot.restore(variables_, *unit_);
    } else {
      saved.snapshot.write(variables_);
      if (saved.memory.initialised) {  // initialise() sets fixed parameters and buffers; then the states are restored
        unit_->initialise(Time{saved.memory.start_ns});
        ++initialisation_;
        saved.snapshot.restore(variables_, *unit_);
      }
    }
  });
  memory_ = saved.memory;
}

void Exported::free(void** saved) {
  if (saved == nullptr || saved_.erase(saved) != 0) return;  // fmusim 0.0.39 passes the state instead of its address
  if (*saved == nullptr) return;
  if (saved_.erase(*saved) == 0) throw Error("this state was not saved by this instance");
  *saved = nullptr;
}

std::string Exported::serialise(const void* handle) const {
  ByteWriter out;
  Putter(out).put(hash_of(package_.token), find(handle));
  return sealed(kStateMagic, out.take());
}

void* Exported::deserialise(std::span<const std::byte> bytes) {
  ByteReader in = opened(kStateMagic, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}, "serialised state",
                         "is not a state of this version");
  if (in.value<std::uint64_t>() != hash_of(package_.token)) in.fail("is a state of another FMU");
  auto saved = std::make_unique<Saved>();
  Getter(in).get(*saved);
  in.expect_end();
  const Memory& m = saved->memory;
  const bool known = m.state == kInstantiated || m.state == kInitialising || m.state == kStepping ||
                     m.state == kStepDiscarded || m.state == kTerminated || m.state == kFailed;
  constexpr auto kLatestNs = static_cast<std::int64_t>(kLatest * kNanoseconds);
  const auto is_time = [](std::int64_t ns) { return ns >= -kLatestNs && ns <= kLatestNs; };
  if (!known || !is_time(m.start_ns) || !is_time(m.time_ns) || !is_time(m.stop_ns) || !(std::abs(m.host_time) <= kLatest)) {
    in.fail("has an invalid state or time");
  }
  if ((m.state == kStepping || m.state == kStepDiscarded) && !m.initialised)
    in.fail("is in a stepping state, but not initialised");
  Saved* handle = saved.get();
  saved_.emplace(handle, std::move(saved));
  return handle;
}

// Logging

void Exported::report(Status status, const std::string& message) const {
  const auto category = static_cast<unsigned>(status) - static_cast<unsigned>(Status::kWarning);
  if (logging && log && (logged_categories & (1u << category)) != 0) log(status, kLogCategoryTexts[category].name, message);
}

void Exported::choose_categories(bool on, std::span<const char* const> categories) {
  unsigned chosen = categories.empty() ? ~0u : 0u;
  for (const char* category : categories) {
    const auto* known = std::find_if(std::begin(kLogCategoryTexts), std::end(kLogCategoryTexts), [&](const LogCategoryText& c) {
      return category != nullptr && std::strcmp(c.name, category) == 0;
    });
    if (known == std::end(kLogCategoryTexts)) {
      throw Error("no log category '" + std::string(category != nullptr ? category : "") +
                  "', expected logStatusWarning, logStatusDiscard or logStatusError");
    }
    chosen |= 1u << (known - std::begin(kLogCategoryTexts));
  }
  logging = on;
  logged_categories = chosen;
}

}  // namespace cotwin::fmu
