#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/staged_initialisation.h"
#include "fmu/import/fmu_unit.h"
#include "fmu/import/load.h"
#include "fmu/process/channel.h"

namespace cotwin::fmu {

/// The program that runs an FMU in a process of its own: COTWIN_FMU_HOST of the environment, else bin/cotwin-fmu-host in
/// installation(). "" if there is none.
std::filesystem::path host_program();

/// How many processes of FMUs did not end as they were asked to (a crash in fmi2FreeInstance, say). Each was reported on
/// stderr.
int unclean_ends();

/// The process of one FMU: started by posix_spawn, so at any time and with any threads; it gets nothing of this process but the
/// channel. It ends when this program ends, however that happens. What the FMU writes to stdout and stderr goes to stderr here,
/// up to kShownBytes.
class HostProcess {
 public:
  static constexpr std::size_t kShownBytes = 64 << 10;

  /// `name`: of the FMU; `timeout`: of one call, s.
  HostProcess(const Variables& variables, std::string name, double timeout, double memory);
  ~HostProcess();
  HostProcess(const HostProcess&) = delete;
  HostProcess& operator=(const HostProcess&) = delete;

  Channel& channel() { return channel_; }
  /// Asks for `verb` and waits for it. Throws Error for what the FMU's unit threw. Where the process ended, or was ended
  /// because it exceeded a limit, the Error says how, and in which function of the FMU; then it is no longer alive().
  void call(Verb verb);
  bool alive() const { return child_ > 0; }
  /// Passes on what the FMU wrote since the last time; returns the bytes of all that it wrote.
  std::uint64_t pass_on_output();

 private:
  using Clock = std::chrono::steady_clock;

  void start();
  void wait_for_answer(double seconds);
  void look_after();
  double memory_used() const;
  bool ended(std::string& how);
  void kill() noexcept;
  [[noreturn]] void lost(const std::string& how);
  std::string in_function() const;
  std::string last_words() const;

  Channel channel_;
  std::string name_;
  double timeout_, memory_;
  std::uint32_t calls_ = 0;
  Lookout lookout_;
  int child_ = -1;       // process
  int lifeline_ = -1;    // our end of a pipe that nobody writes to
  int output_ = -1;      // of the FMU
  int statistics_ = -1;  // /proc/<child>/statm
  std::uint64_t written_ = 0;
  bool cut_ = false;
  std::string tail_;  // of the output
};

/// A foreign unit in a process of its own: its crash, its hang, its exit and what exceeds a limit are Errors here.
class ProcessUnit final : public Unit, public StagedInitialisation {
 public:
  ProcessUnit(std::shared_ptr<const ForeignFmu> fmu, LoadOptions options);
  ~ProcessUnit() override;

  void declare(Variables& variables) override;
  void initialise(Time start) override;
  void enter_initialisation(Time start) override;
  void update_initialisation() override;
  void exit_initialisation() override;
  StepResult step(Time now, Duration h) override;
  bool restorable() const override { return restorable_; }
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  void tell(std::vector<std::string>& notes) const override;
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  void begin();
  void exchange_all(Verb verb, Time start);
  Channel& channel() { return host_->channel(); }

  std::shared_ptr<const ForeignFmu> fmu_;
  LoadOptions options_;
  ForeignVariables variables_;
  Variables declared_;
  bool restorable_;
  Time start_;
  std::vector<std::string> warnings_;  // of the unit in the process
  std::unique_ptr<HostProcess> host_;
};

}  // namespace cotwin::fmu
