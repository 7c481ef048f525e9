#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/fri/client.h"
#include "components/io/link/belief.h"
#include "components/unit/settings.h"
#include "components/unit/variables.h"

/// Values beside the joints that a session of FRI carries, as ports of a unit.
namespace cotwin::io {

/// Variables of the robot's program (LWR): 16 reals, 16 integers, 16 booleans.
struct KrlPorts {
  std::array<double, 16> real{};
  std::array<std::int32_t, 16> integer{};
  std::array<bool, 16> boolean{};

  /// `prefix`: of the names; `what`: "from the robot's program, $FRI_TO".
  void declare_inputs(Variables& v, const std::string& prefix, const std::string& what);
  void declare_outputs(Variables& v, const std::string& prefix, const std::string& what);
  void read(const fri::KrlVariables& values);
  void write(fri::KrlVariables& values) const;
};

/// Field-bus values by name (Sunrise): the list "Gripper.Open:boolean, Tool.Force:analog".
class IoPorts {
 public:
  IoPorts() = default;
  /// Throws Error at `place`.
  IoPorts(const std::string& list, fri::Io::Direction direction, const std::string& place);

  bool empty() const { return values_.empty(); }
  void declare_input(Variables& v, const std::string& name, const std::string& what);
  void declare_output(Variables& v, const std::string& name, const std::string& what);
  /// What read() takes may be damaged: what is believed of it is used (BelievedNumbers).
  void examine();
  /// Takes those of the values that are in the list; the others keep what they have.
  void read(const fri::Few<fri::Io, fri::kMaxIos>& values);
  void write(fri::Few<fri::Io, fri::kMaxIos>& values) const;

 private:
  std::string names() const;

  std::vector<fri::Io> ios_;
  std::vector<double> values_;  // 0 or 1 of booleans
  std::optional<BelievedNumbers> believed_;
};

/// Statistics of a session as integers of a port: what has occurred so far.
struct ClientCounts {
  std::int32_t received = 0, lost = 0, duplicates = 0, reordered = 0, rejected = 0, strangers = 0, answers = 0, unreflected = 0;
  double jitter = 0, round_trip = 0;

  void declare(Variables& v);
  void read(const fri::ClientStatistics& statistics);
};

struct ControllerCounts {
  std::int32_t sent = 0, in_time = 0, late = 0, missing = 0, lost = 0, duplicates = 0, reordered = 0, rejected = 0,
               strangers = 0, bridged = 0, skipped = 0;
  double latency = 0, jitter = 0;

  void declare(Variables& v);
  void read(const fri::ControllerStatistics& statistics);
};

/// The settings of both sides.
void declare_fri_settings(SettingList& s);
/// The setting `protocol`.
fri::Protocol protocol_of(Settings& settings);
/// The port that KUKA's programs use.
std::int32_t default_port(fri::Protocol protocol);

/// A count as the integer of a port: stays at the largest one.
std::int32_t saturated(std::uint64_t count);

}  // namespace cotwin::io
