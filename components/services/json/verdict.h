#pragma once
#include <string>
#include <vector>

#include "components/services/json/request.h"

/// What a reply says of its motion: findings, and the light that follows from them (docs/services.md).
namespace cotwin::services {

enum class Of { kBounds, kPoses, kPower, kClearOf, kTwin, kCompliance, kBase, kPersons, kDeadline, kSearch };
enum class Says { kYes, kNo, kUnknown };

struct Finding {
  Of of;
  Says says;
  std::string why;  // for people, without a capital and a full stop; of a no never empty
};

inline const std::vector<std::string> kLights = {"green", "amber", "red"};  // the worse ones last

/// The findings on one motion. Whoever computes one adds it.
class Verdict {
 public:
  Verdict() = default;
  /// That of a reply, or of a motion in it.
  explicit Verdict(const Json& reply);

  void add(Of of, Says says, const std::string& why = "") { findings_.push_back({of, says, why}); }
  /// Yes, or no for a reason.
  void add(Of of, bool yes, const std::string& why) { add(of, yes ? Says::kYes : Says::kNo, yes ? "" : why); }
  const std::vector<Finding>& findings() const { return findings_; }
  /// nullptr: there is none.
  const Finding* find(Of of) const;
  /// No finding on the motion itself says no. Persons, deadline and search are not the motion's.
  bool feasible() const { return !obstacle(); }
  /// That of the first such no, or "".
  std::string reason() const { return obstacle() ? obstacle()->why : ""; }
  /// Index of kLights: red for any no, amber for anything unknown, and for what rests on assumptions.
  std::size_t light(bool assumed) const;

  /// The members feasible, reason and verdict.
  void tell(Json& reply) const;
  /// The member verdict, without the light, which has to wait for the assumptions: light_all().
  void tell_findings(Json& reply) const;

 private:
  const Finding* obstacle() const;

  std::vector<Finding> findings_;
};

/// Gives all verdicts in a reply their lights.
void light_all(Json& reply);
/// Index of kLights of a reply with a verdict.
std::size_t light_of(const Json& reply);

namespace schemas {
Json verdict();
}

}  // namespace cotwin::services
