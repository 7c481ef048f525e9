#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "components/gateway/run_side.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::gateway {

/// The gateway of a twin: HTTP/JSON with the services, jobs, events and this run's signals, for whoever asks (docs/gateway.md). Its server
/// has threads of its own; a step only copies counters and never waits for a client, so that a step that is repeated does no harm. It
/// cannot be packed into an FMU.
class Gateway final : public Unit, public bus::RunObserver {
 public:
  static void declare_settings(SettingList& s);
  explicit Gateway(Settings& settings);
  ~Gateway() override;

  void declare(Variables& v) override;
  /// Starts the server and its workers; does nothing if they run with the same parameters.
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void observe(std::shared_ptr<bus::LiveRun> run) override { run_side_.observe(std::move(run)); }
  std::string url() const override;
  void append_notes(std::vector<std::string>& sentences) const override;
  /// Stops the server; jobs that run go back to the queue.
  void end() noexcept override;

 private:
  struct Running;
  struct Parameters;
  Parameters parameters() const;
  void write_outputs();

  std::vector<std::string> robot_folders_;
  std::string unphysical_;  // the setting
  std::string people_;      // the table of body parts in the model folders; empty: none
  std::unique_ptr<Running> running_;

  // Parameters, in the order of declaration.
  std::string address_ = "localhost";
  std::int32_t port_ = 8080;
  std::string tokens_, certificate_, key_, hosts_, origins_, url_file_, robot_ = "lwr4";
  std::int32_t threads_ = 2, connections_ = 128;
  std::string database_, program_;
  std::int32_t workers_ = 1;
  // Outputs.
  double requests_ = 0, refused_ = 0, open_ = 0, streams_ = 0, dropped_ = 0;

  RunSide run_side_;
  bool commands_ = true;
  std::int32_t address_connections_ = 64;
  std::string persons_, local_writes_ = "owner";
  double price_per_kWh_ = 0, co2_per_kWh_ = 0;
};

}  // namespace cotwin::gateway
