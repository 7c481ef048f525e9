#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/bus.h"
#include "components/io/emulators/ethercat_slaves.h"
#include "components/unit/joint_variables.h"
#include "components/unit/variables.h"

namespace cotwin::io {

/// An emulated bus whose terminals are ports of the twin: what is wired to digital inputs and encoders comes in, what digital outputs
/// switch goes out. The bus may be served by another thread than the one that steps.
class EtherCatField {
 public:
  /// `slaves` must outlive it. At most one encoder per joint.
  EtherCatField(const std::vector<SlaveChoice>& slaves, std::size_t joints);

  void declare(Variables& v, JointVariables& joints);
  /// Makes the bus from the parameters: all slaves are switched on at `now` (ns).
  void initialise(std::int64_t now);

  /// On the thread that steps: gives the inputs to the bus, takes outputs from it.
  void exchange();
  /// On the thread that serves the bus: the terminals at `now` (ns).
  void apply(std::int64_t now);

  ethercat::Bus& bus() { return bus_; }

 private:
  struct Terminal {
    std::array<bool, 16> channels{};     // port
    std::atomic<std::uint32_t> bits{0};  // channels between the threads
    std::atomic<std::int64_t> counts{0};
    std::atomic<std::int32_t> state{0};
    std::int32_t start = 0;                  // of a drive, counts
    double position = 0;                     // port, counts
    bool fault = false, torque_off = false;  // ports
    std::atomic<double> axis{0};
    std::atomic<bool> cause{false}, is_off{false};
  };

  const std::vector<SlaveChoice>& slaves_;
  ethercat::Bus bus_;
  std::vector<Terminal> terminals_;
  std::vector<double> q_;  // port, of the axes at the encoders
  // Parameters and tunables.
  std::vector<double> counts_per_q_;
  std::vector<double> drift_, cable_;
  std::int32_t cut_ = -1, off_ = -1;
  std::atomic<std::int32_t> cut_wanted_{-1}, off_wanted_{-1};
  std::int32_t cut_now_ = -1, off_now_ = -1;
  std::vector<std::int32_t> states_;  // output
};

}  // namespace cotwin::io
