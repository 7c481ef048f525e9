#include "master/api/program_units.h"

#include <algorithm>

#include "master/engine/wiring/members.h"

namespace cotwin {

namespace {

thread_local const ProgramUnits* loading = nullptr;

class Adapter final : public Unit {
 public:
  Adapter(std::string name, std::unique_ptr<ProgramUnit> unit) : name_(std::move(name)), unit_(std::move(unit)) {}

  void declare(Variables& v) override {
    if (variables_.empty())
      variables_ = unit_->variables();  // the master may declare again, for a comparison with start values
    for (const ProgramVariable& one : variables_) {
      const auto declared = [&]() -> Variables::Declared {
        std::span<double> values = one.values;
        if (values.empty()) throw Error(name_ + "." + one.name, "has no elements, expected at least 1");
        if (one.role == "input") return v.input(one.name, values, one.si, one.description);
        if (one.role == "output") return v.output(one.name, values, one.si, one.description);
        if (one.role == "parameter") return v.parameter(one.name, values, one.si, one.description);
        if (one.role == "tunable") return v.tunable(one.name, values, one.si, one.description);
        if (one.role == "state") return v.state(one.name, values, one.si, one.description);
        throw Error(name_ + "." + one.name,
                    "has the role '" + one.role + "', expected input, output, parameter, tunable or state");
      };
      declared().range(one.min, one.max);
    }
  }
  void initialise(Time start) override { unit_->initialise(start.seconds()); }
  StepResult step(Time now, Duration h) override {
    return unit_->step(now.seconds(), h.seconds()) ? StepResult::kDone : StepResult::kFinished;
  }
  void save_memory(std::string& bytes) override { unit_->save(bytes); }
  void restore_memory(const std::string& bytes) override { unit_->restore(bytes); }
  bool restorable() const override { return unit_->restorable(); }

 private:
  std::string name_;
  std::unique_ptr<ProgramUnit> unit_;
  std::vector<ProgramVariable> variables_;
};

bool is_name(const std::string& name) {
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  };
  return !name.empty() && std::ranges::all_of(name, fits);
}

}  // namespace

ProgramUnits::ProgramUnits(std::vector<ProgramUnitType> own, std::vector<UnitType> others)
    : own_(std::move(own)), types_(std::move(others)) {
  for (const ProgramUnitType& type : own_) {
    if (!is_name(type.name)) throw Error("unit '" + type.name + "'", "expected a name of letters, digits and '_'");
    if (!type.make) throw Error("unit '" + type.name + "'", "has no function that makes it");
    if (std::ranges::any_of(types_, [&](const UnitType& t) { return t.name == type.name; }))
      throw Error("unit '" + type.name + "'", "there is already a unit of this name, expected another one");
    types_.push_back({type.name.c_str(), type.summary.c_str(), make, nullptr});
  }
}

std::unique_ptr<Unit> ProgramUnits::make(Settings& settings) {
  const auto found = std::ranges::find(loading->own_, settings.unit(), &ProgramUnitType::name);
  std::unique_ptr<ProgramUnit> unit = found->make();
  if (!unit) throw Error("unit '" + settings.unit() + "'", "its program made none");
  return std::make_unique<Adapter>(settings.unit(), std::move(unit));
}

ProgramUnits::Loading::Loading(const ProgramUnits& units) : before_(loading) { loading = &units; }
ProgramUnits::Loading::~Loading() { loading = before_; }

void keep_on_the_loops_thread(std::span<const ProgramUnitType> units, master::Scenario& scenario) {
  for (master::ComponentSpec& component : scenario.components) {
    if (!master::is_unit(component)) continue;
    const std::string name = parse_unit_source(component.source).unit;
    if (std::ranges::any_of(units, [&](const ProgramUnitType& type) { return type.name == name; })) component.threads = false;
  }
}

}  // namespace cotwin
