#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/bus/state_exchange.h"
#include "components/bus/udp_transport.h"
#include "components/shared_states/field_values.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::shared_states {

/// States that two runs share over UDP (V-D): each publishes its inputs of the setting `publish` and has the other's as outputs of
/// the setting `subscribe`. In every step it sends what changed and takes what has arrived, so that a step never waits for the
/// peer. All outputs of a step are of one publication of the peer, or of the last one if none arrived.
class SharedStates final : public Unit, private TickSource {
 public:
  static void declare_settings(SettingList& s);
  explicit SharedStates(Settings& settings);

  void declare(Variables& v) override;
  /// Opens the socket; waits for the peer's states if `wait` > 0. Until the next step, calls for the same time and addresses only
  /// publish the inputs: the outputs must not change while the master looks for values that fit together.
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  bool restorable() const override { return false; }
  void append_notes(std::vector<std::string>& sentences) const override;
  /// Ticks at the publications of the peer, whose times are the source's clock.
  TickSource* tick_source() override { return subscribed_ ? this : nullptr; }

 private:
  std::optional<Arrival> wait(std::int64_t deadline) override;
  void open();
  void await_peer();
  void receive();
  void refuse_other_layout();
  void warn_of_two_owners();
  void write_outputs();
  std::string mismatch() const;

  std::optional<FieldValues> published_, subscribed_;
  std::unique_ptr<bus::UdpTransport> transport_;
  std::optional<bus::StateExchange> exchange_;
  std::string address_, peer_address_;  // of the open transport, as given
  std::optional<Time> initialised_;     // at this time, and no step since then
  bool arrived_ = false;                // something new since the last step

  // Parameters, in the order of declaration.
  std::string listen_ = "127.0.0.1:30260", peer_ = "127.0.0.1:30261";
  double timeout_ = 0.1, wait_ = 0;  // s
  // Outputs.
  bool connected_ = false, fresh_ = false;
  double age_ = 0, peer_time_ = 0;  // s
  double updates_ = 0, recoveries_ = 0, missed_ = 0, old_ = 0, refused_ = 0;
  double sent_ = 0, sent_bytes_ = 0, received_ = 0, received_bytes_ = 0, unsent_ = 0, foreign_ = 0, damaged_ = 0;
  std::string warning_;
  double restarts_ = 0;
};

}  // namespace cotwin::shared_states
