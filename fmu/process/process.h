#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/declared_dependencies.h"
#include "components/unit/staged_initialisation.h"
#include "fmu/description/dependencies.h"
#include "fmu/import/load.h"
#include "fmu/import/unit/fmu_unit.h"
#include "fmu/process/channel.h"

namespace cotwin::fmu {

/// Returns the path of the program that runs an FMU in its own process: the environment variable COTWIN_FMU_HOST, else
/// bin/cotwin-fmu-host in installation(). "" if it is missing.
std::filesystem::path host_program();

/// Returns the number of FMU processes that did not end normally, for example after a crash in fmi2FreeInstance. Each was
/// reported on stderr.
int unclean_ends();

/// The process of one FMU. posix_spawn starts it, so other threads may run at that time. It inherits only the channel. It ends
/// when this program ends or is killed, and with it all processes that the FMU has started. The first kShownBytes of the FMU's stdout and stderr are copied to stderr.
class HostProcess {
 public:
  static constexpr std::size_t kShownBytes = 64 << 10;

  /// `name`: the FMU, for messages; `timeout`: of one call, s; `memory`: limit of the process, bytes.
  HostProcess(const Variables& variables, std::string name, double timeout, double memory);
  ~HostProcess();
  HostProcess(const HostProcess&) = delete;
  HostProcess& operator=(const HostProcess&) = delete;

  Channel& channel() { return channel_; }
  /// Makes the process execute `verb` and waits for the answer. Throws Error with the message that the FMU's unit threw. Throws
  /// Error too if the process has ended or was killed because it exceeded a limit: the message has the cause and the FMU's
  /// function, and alive() is false afterwards.
  void call(Verb verb);
  bool alive() const { return child_ > 0; }
  /// Copies the FMU's new output to stderr. Returns the number of bytes that the FMU has written in total.
  std::uint64_t pass_on_output();

 private:
  using Clock = std::chrono::steady_clock;

  void start();
  void wait_for_answer(double seconds);
  void check_memory();
  double memory_used();
  void close_lifeline() noexcept;
  bool ended(std::string& how);
  void kill() noexcept;
  [[noreturn]] void fail(const std::string& how);
  std::string in_function() const;
  std::string last_output() const;

  Channel channel_;
  std::string name_;
  double timeout_, memory_;
  std::uint32_t calls_ = 0;
  SpinWait spin_;
  int child_ = -1;       // process
  int lifeline_ = -1;    // write end of a pipe without data (kLifelineDescriptor)
  int output_ = -1;      // read end of the FMU's stdout and stderr
  int statistics_ = -1;  // /proc/<process with the FMU>/statm
  std::uint64_t written_ = 0;
  bool cut_ = false;
  std::string tail_;  // the last kTailBytes of the output
};

/// A foreign FMU in its own process. A crash, a hang, an exit or an exceeded limit of the FMU becomes an Error here.
class ProcessUnit final : public Unit, public StagedInitialisation, public DeclaredDependencies {
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
  bool has_cheap_rollback() const override { return goes_back_; }
  bool follows(const Variable& output, std::size_t row, const Variable& input, std::size_t column) const override {
    return declares_dependency(fmu_->description, output, row, input, column);
  }
  void save_memory(std::string& bytes) override;
  void restore_memory(const std::string& bytes) override;
  void append_notes(std::vector<std::string>& notes) const override;
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  void begin();
  void exchange_all(Verb verb, Time start);
  Channel& channel() { return host_->channel(); }

  std::shared_ptr<const ForeignFmu> fmu_;
  LoadOptions options_;
  ForeignVariables variables_;
  Variables declared_;
  bool restorable_ = false, goes_back_ = false;
  Time start_;
  std::vector<std::string> warnings_;  // from the unit in the process
  std::unique_ptr<HostProcess> host_;
};

}  // namespace cotwin::fmu
