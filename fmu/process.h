#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "fmu/fmu_unit.h"

namespace cotwin::fmu {

/// A foreign unit in a process of its own: its crash, its hang and its exit are an Error here, and so is one of the host's time
/// limit.
///
/// The process is a copy of this one (fork without exec), so that it works in every program that has this library, the tests
/// included; of what it copies it keeps nothing but the channel. Values cross in memory that
/// both share, numbers and booleans in a fixed place each, texts behind one another. A call is one word that the other side
/// waits for: it looks a while (where there is more than one core), then sleeps on it (futex). The child notices the end of its
/// parent on a pipe.
class ProcessUnit final : public cotwin::Unit, public StagedInitialisation {
 public:
  /// `make` is called in the child. `timeout`: of one call, s.
  ProcessUnit(std::function<std::unique_ptr<ForeignUnit>()> make, std::shared_ptr<const ForeignFmu> fmu,
              const ForeignVariablesOptions& variables, bool restorable, double timeout);
  ~ProcessUnit() override;

  void declare(Variables& variables) override;
  void initialise(Time start) override;
  void enter_initialisation(Time start) override { initialise(start_ = start); }
  void update_initialisation() override { initialise(start_); }
  void exit_initialisation() override {}
  StepResult step(Time now, Duration h) override;
  bool restorable() const override { return restorable_; }
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  const std::vector<std::string>& warnings() const { return variables_.warnings(); }

 private:
  struct Channel;

  void begin();
  void end() noexcept;
  void call();
  [[noreturn]] void lost(const std::string& how);

  std::function<std::unique_ptr<ForeignUnit>()> make_;
  std::shared_ptr<const ForeignFmu> fmu_;
  ForeignVariables variables_;
  Variables declared_;
  bool restorable_;
  double timeout_;
  Time start_;
  std::unique_ptr<Channel> channel_;
};

}  // namespace cotwin::fmu
