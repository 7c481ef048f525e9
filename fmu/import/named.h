#pragma once
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "components/unit/declared_dependencies.h"
#include "components/unit/local_memory.h"
#include "components/unit/staged_initialisation.h"
#include "components/unit/unit.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

/// A unit that puts the FMU's name in front of the messages of its errors.
template <class Made>
class Named final : public Unit, public StagedInitialisation, public DeclaredDependencies, public LocalMemory {
  template <class Call>
  [[gnu::always_inline]] auto named(Call call) {
    try {
      return call();
    } catch (const Error& error) {
      throw Error(name_, error.what());
    }
  }

 public:
  template <class... Arguments>
  explicit Named(std::string name, Arguments&&... arguments)
      : unit_(std::forward<Arguments>(arguments)...), name_(std::move(name)) {}
  const std::vector<std::string>& warnings() const { return unit_.warnings(); }

  void declare(Variables& v) override { unit_.declare(v); }
  void initialise(Time start) override {
    named([&] { unit_.initialise(start); });
  }
  void enter_initialisation(Time start) override {
    named([&] { unit_.enter_initialisation(start); });
  }
  void update_initialisation() override {
    named([&] { unit_.update_initialisation(); });
  }
  void exit_initialisation() override {
    named([&] { unit_.exit_initialisation(); });
  }
  StepResult step(Time now, Duration h) override {
    return named([&] { return unit_.step(now, h); });
  }
  void restored() override { unit_.restored(); }
  void save_memory(std::string& bytes) override {
    named([&] { unit_.save_memory(bytes); });
  }
  void save_local_memory(std::string& bytes) override {
    named([&] {
      if constexpr (std::is_base_of_v<LocalMemory, Made>) {
        unit_.save_local_memory(bytes);
      } else {
        unit_.save_memory(bytes);
      }
    });
  }
  void restore_memory(const std::string& bytes) override {
    named([&] { unit_.restore_memory(bytes); });
  }
  bool restorable() const override { return unit_.restorable(); }
  bool has_cheap_rollback() const override { return unit_.has_cheap_rollback(); }
  bool follows(const Variable& output, std::size_t row, const Variable& input, std::size_t column) const override {
    return unit_.follows(output, row, input, column);
  }
  void append_notes(std::vector<std::string>& notes) const override { unit_.append_notes(notes); }

 private:
  Made unit_;
  std::string name_;
};

template <class Made, class... Arguments>
std::unique_ptr<Unit> make_named(const std::string& name, std::vector<std::string>& warnings, Arguments&&... arguments) {
  auto unit = std::make_unique<Named<Made>>(name, std::forward<Arguments>(arguments)...);
  warnings.insert(warnings.end(), unit->warnings().begin(), unit->warnings().end());
  return unit;
}

}  // namespace cotwin::fmu
