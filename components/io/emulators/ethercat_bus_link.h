#pragma once
#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "components/io/emulators/ethercat_field.h"
#include "components/io/emulators/ethercat_slaves.h"
#include "components/io/link/link.h"
#include "components/unit/settings.h"
#include "models/foundation/net/raw_socket.h"

namespace cotwin::io {

/// An emulated EtherCAT bus at a network interface, which a foreign master operates: its terminals are ports of the twin
/// (ethercat_field.h). Frames are answered by a thread of the link as soon as they come, whatever the steps of the run do. The bus's
/// clock is CLOCK_MONOTONIC.
class EtherCatBusLink final : public Link {
 public:
  EtherCatBusLink(Settings& settings, std::size_t joints);
  ~EtherCatBusLink() override;

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  bool is_robot() const override { return true; }
  /// From now on no frame is answered: terminals whose master goes on would move after the run.
  void end() noexcept override { stop(); }

 private:
  void serve();
  void stop() noexcept;

  std::string interface_;
  std::vector<SlaveChoice> slaves_;
  EtherCatField field_;
  std::optional<net::RawSocket> socket_;
  std::thread thread_;
  std::atomic<bool> ends_{false};
  std::atomic<std::int64_t> frames_served_{0}, frames_lost_{0};
  // Outputs.
  std::int32_t frames_ = 0, unanswered_ = 0;
};

}  // namespace cotwin::io
