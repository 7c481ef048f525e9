#pragma once
#include <functional>
#include <memory>
#include <optional>

#include "components/services/json/move_json.h"
#include "components/services/json/verdict.h"
#include "models/collision/meeting/meeting.h"

/// The member clear_of of requests and replies, for the sources of this folder.
namespace cotwin::services {

/// The member `places` of replies and of summaries: name, p_m, quaternion_wxyz, of a cloud radius_m, and who says so, null: nobody.
Json places_json(const std::vector<collision::Place>& places);

/// What a motion of the robot is to keep clear of: a scene, other robots, itself.
class ClearOf {
 public:
  /// Nothing if it is not given. `carried`: what the move carries meanwhile. Throws RequestError.
  static std::optional<ClearOf> read(const Robot& robot, Reader& r, const Context& context,
                                     const std::vector<collision::Tool>& carried);
  collision::Verdict check(const trajectory::Path& path);
  /// The member of the reply; also adds the notes.
  Json json(const collision::Verdict& verdict, Json& reply) const;
  /// "link_5 meets box at 0.83 s"; "" for a motion that is clear.
  std::string reason(const collision::Verdict& verdict) const;
  /// The member and the finding of a motion.
  void judge(const trajectory::Path& path, Json& reply, Verdict& verdict);

 private:
  double clearance_ = 0;
  std::function<std::unique_ptr<collision::Checker>(double begin, double T)> make_;
  std::unique_ptr<collision::Checker> checker_;
  double begin_ = 0, T_ = 1;  // of the motion that the checker is for, where payloads come or go
  bool timed_ = false;
  std::vector<collision::Motion> motions_;  // that of the robot first
  std::vector<std::string> notes_;
  std::vector<collision::Place> places_;
};

}  // namespace cotwin::services
