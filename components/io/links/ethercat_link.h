#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/emulated_wire.h"
#include "components/io/emulators/ethercat_field.h"
#include "components/io/emulators/ethercat_slaves.h"
#include "components/io/ethercat/master/master.h"
#include "components/io/link/acknowledgement.h"
#include "components/io/link/belief.h"
#include "components/io/link/link.h"
#include "components/io/links/ethercat_drives.h"
#include "components/io/links/ethercat_encoder.h"
#include "components/unit/settings.h"

namespace cotwin::io {

/// Devices on an EtherCAT bus, of which this is the master (ethercat/master/master.h). Each named slave has ports:
///   EL1809   output <name>: 16 channels           EL2809   input <name>: 16 channels
///   EL5101   output <name>_count: counts since the start, without wrapping; latch and set of the counter; it is also joint i of
///            the unit, i its number among the encoders and drives: q = q_scale · count + q_offset, q̇ its slope since the last data, low-pass `dq_cutoff`
///   drives   (DRIVE402, setting `drives`) joint i likewise: q from its position, commanded as ethercat_drives.h says
///   others   a port per channel of the SII's PDOs, or one port <name> if all channels of a direction are bits
/// initialise() brings the bus to SAFEOP and waits for it; the steps bring it to OP. A step sends the frames of a cycle and uses the
/// answers to those of the last one, so inputs are one step old, bits and numbers two more (BelievedNumbers). While the bus is not
/// operational, outputs are off and inputs held.
/// end() switches the outputs off and brings the slaves to INIT.
class EtherCatLink final : public Link {
 public:
  EtherCatLink(Settings& settings, const std::vector<trajectory::Axis>& joints);
  ~EtherCatLink() override;

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return false; }
  Needs needs() const override { return drives_.needs(); }
  TickSource* tick_source() override;
  void append_notes(std::vector<std::string>& sentences) const override;
  void end() noexcept override;

 private:
  class Source;
  struct Device;

  void declare_device(Variables& v, std::size_t i);
  void stop_drives() noexcept;
  void write_devices();
  void read_devices();
  void measure(Measured& measured);
  double patience() const { return std::max(timeout_, 6 * cycle_); }  // s
  void check_cycle(Duration h);
  int encoder_jumps() const;
  bool is_held() const;
  void write_statistics();

  std::string interface_;
  bool clocks_;
  std::vector<SlaveChoice> slaves_;
  std::vector<Device> devices_;
  std::vector<std::size_t> encoders_;  // positions
  std::vector<std::size_t> joint_of_;  // of each slave that has one
  std::size_t n_;
  std::vector<trajectory::Axis> axes_;
  EtherCatDrives drives_;
  std::optional<EtherCatField> field_;
  std::unique_ptr<ethercat::Wire> wire_;
  std::unique_ptr<ethercat::Master> master_;
  std::unique_ptr<Source> source_;
  bool failed_ = false, was_operational_ = false;  // at some time of the run: told at its end
  bool stepped_ = false, ended_ = false, stopped_ = true;
  Duration last_h_;        // of the step before
  std::int64_t zero_ = 0;  // of the emulated bus: its time at scenario time 0, ns

  // Parameters.
  double cycle_ = 1e-3, timeout_ = 0.02, wait_ = 0, sync0_shift_ = -1, dq_cutoff_ = 50;
  bool sync0_ = false;
  std::string sii_folder_;
  std::vector<double> q_scale_, q_offset_;
  // Outputs.
  bool operational_ = false;
  std::int32_t answering_ = 0;
  std::vector<std::int32_t> state_, al_code_;
  std::int32_t cycles_ = 0, lost_ = 0, late_ = 0, foreign_ = 0, unsent_ = 0, working_counter_errors_ = 0, slaves_lost_ = 0,
               slave_faults_ = 0, wrong_slaves_ = 0, unexpected_slaves_ = 0, recovered_ = 0, implausible_ = 0;
  double clock_difference_ = 0;
  std::int32_t clock_steps_ = 0;
  Acknowledgement acknowledgement_;
  BelievedNumbers numbers_;  // of the devices' inputs
  int jumps_ = 0;            // of the encoders, that were followed by a stop
  bool in_op_ = false;       // as the master has it, which waits for `timeout`
  bool bus_lost_ = false;    // it awaits the acknowledgement of a loss of the bus, not only of a stop of the drives
};

}  // namespace cotwin::io
