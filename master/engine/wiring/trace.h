#pragma once
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "master/engine/wiring/wiring.h"

/// Where the value of an input comes from, by connections and through units whose outputs follow an input.
namespace cotwin::master {

/// One element of a variable of a member.
struct OneElement {
  std::size_t member = 0;
  const Variable* variable = nullptr;
  std::size_t element = 0;
};

class Trace {
 public:
  /// The members must not change during its lifetime.
  Trace(std::span<const Member> members, std::span<const ResolvedConnection> links);

  /// The connection that feeds this element of an input; nullptr if none does.
  const ResolvedConnection* into(const Variable& input, std::size_t element = 0) const;
  /// The output at its other end.
  std::optional<OneElement> source(const Variable& input, std::size_t element = 0) const;
  /// Back to where the posture or the speed of a robot's joint comes from: through controllers, drive trains, contact worlds and sensors to an output of
  /// a unit:motion, a recording or another unit or FMU that is not known to follow an input of its own; from a loop to where it closes.
  OneElement origin(OneElement output) const;
  /// Whether a variable of `from` reaches an input of `to` by connections, through any members.
  bool reaches(std::size_t from, std::size_t to) const;

 private:
  std::optional<OneElement> followed(const OneElement& output) const;

  std::span<const Member> members_;
  std::map<std::pair<const Variable*, std::size_t>, const ResolvedConnection*> into_;  // input, element
  std::span<const ResolvedConnection> links_;
};

/// "left." of "left.q", "" of "q"; and the rest.
std::string prefix_of(const std::string& name);
std::string last_part(const std::string& name);

}  // namespace cotwin::master
