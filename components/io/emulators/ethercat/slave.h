#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "components/io/emulators/ethercat/coe_server.h"
#include "components/io/emulators/ethercat/esc.h"
#include "components/io/ethercat/sii.h"

namespace cotwin::ethercat {

struct SlaveOptions {
  EscOptions esc;
  /// Whether AL status copies AL control without checks, as in terminals without a processor; none: bit 8 of PDI control in the SII.
  std::optional<bool> copies_states;
  std::int64_t state_time = 0;            // ns from the request of a state to the new state
  std::int64_t outputs_wait = 200000000;  // ns that a request of OP waits for outputs
};

/// An emulated slave that is described by its SII image alone: the controller, the state machine with AL status codes, the process
/// data, and CoE with an object dictionary made from the image (identity, PDOs, assignment of PDOs). Devices derive from it.
/// Times are ns of simulated time that does not decrease. Allocates in the constructor only.
class Slave : private ObjectOwner {
 public:
  /// Throws Error if the image is not valid.
  explicit Slave(std::vector<std::uint8_t> image, const SlaveOptions& options = {});
  ~Slave() override = default;
  Slave(const Slave&) = delete;
  Slave& operator=(const Slave&) = delete;

  /// Switched on: everything at its initial value, state INIT.
  void power_on(std::int64_t now);
  /// A frame passes; see Esc::process.
  bool process(std::span<std::uint8_t> frame, std::int64_t now);
  /// The slave at `now` without a frame: watchdog, filters, pulses, pending states.
  void advance(std::int64_t now);

  Esc& esc() { return esc_; }
  const Esc& esc() const { return esc_; }
  const Sii& sii() const { return sii_; }
  State state() const { return state_; }
  bool has_error() const { return (esc_.al_status() & kStateError) != 0; }
  /// Process data from the master, the output sync managers one after another: zero unless the state is OP and outputs arrive.
  std::span<const std::uint8_t> outputs() const { return std::span(outputs_).first(output_bytes_); }
  /// Process data to the master. Bytes beyond input_bytes() are not sent.
  std::span<std::uint8_t> inputs() { return std::span(inputs_).first(input_bytes_); }
  std::size_t output_bytes() const { return output_bytes_; }
  std::size_t input_bytes() const { return input_bytes_; }

 protected:
  /// The device at `now`: reads outputs(), sets inputs(). Called before and after each frame.
  virtual void update(std::int64_t) {}
  /// Switched on.
  virtual void restart() {}
  /// Where an assigned PDO begins in outputs() or inputs(), bits; none if it is not assigned.
  std::optional<std::size_t> place_of(std::uint16_t pdo) const;
  ObjectDictionary& objects() { return objects_; }
  const ObjectDictionary& objects() const { return objects_; }

 private:
  void refresh(const ObjectEntry& entry) override;
  SdoAbort check(const ObjectEntry& entry, std::span<const std::uint8_t> value) override;
  SdoAbort check_assignment(int n, const ObjectEntry& entry, std::uint64_t value) const;

  void make_objects();
  const Pdo* pdo(std::uint16_t index) const;
  void list_assigned(int n);
  std::size_t expected_length(int n) const;
  void measure_process_data();
  bool is(int n, SyncManagerType type) const;
  int find(SyncManagerType type) const;

  void serve(std::int64_t now);
  void serve_state(std::int64_t now);
  void serve_mailbox();
  void exchange();
  AlCode change_to(State wanted) const;
  AlCode check_mailbox(const SiiMailbox& mailbox) const;
  AlCode check_process_data() const;
  bool outputs_arrive() const;
  void enter(State state, AlCode code);

  Sii sii_;
  SlaveOptions options_;
  Esc esc_;
  bool copies_states_;
  ObjectDictionary objects_;
  std::optional<CoeServer> coe_;
  std::span<const std::uint8_t> reply_;  // of coe_, not yet in the mailbox
  std::span<const std::uint8_t> sent_;   // last reply that was put into the mailbox
  State state_ = State::kInit;
  std::optional<State> wanted_;  // requested, not reached yet
  std::int64_t wanted_at_ = 0, wanted_until_ = 0;
  std::array<std::vector<const Pdo*>, kMostSyncManagers> assigned_;  // of sii_, per sync manager with process data
  std::array<std::size_t, kMostSyncManagers> lengths_{};             // of the sync managers with process data, bytes
  std::size_t output_bytes_ = 0, input_bytes_ = 0;
  std::vector<std::uint8_t> outputs_, inputs_;
};

}  // namespace cotwin::ethercat
