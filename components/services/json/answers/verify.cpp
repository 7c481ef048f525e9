#include <algorithm>
#include <cmath>

#include "components/services/json/answers/answers.h"
#include "components/services/json/clear_json.h"

namespace cotwin::services {

VerificationOptions read_verification(const Robot& robot, Reader& r) {
  VerificationOptions o;
  o.rigid = r.word("drives", {"robot", "none"}) == "none";
  o.settle = r.positive("settle_s", o.settle, "rest after the move that is also simulated");
  if (o.settle > 60) throw RequestError("/settle_s", "is more than 60, expected at most that");
  const char* const kTracking = "largest tracking error, of any joint";
  o.tracking_max = r.positive(JointUnits(robot.model).name("tracking_max", 0).c_str(), o.tracking_max, kTracking);
  r.declare("tracking_max", schemas::positive(), false, kTracking);
  return o;
}

Json verification_json(const Robot& robot, const Move& m, double T, const VerificationOptions& options, const Context& context,
                       Detail detail) {
  if (!context.verify)
    throw RequestError("/verify", "needs a co-simulation, which this program does not have, expected cotwin ask");
  const Verification v = context.verify(robot, m, T, options);
  const JointUnits units(robot.model);
  Json reply{{"feasible", v.feasible},
             {"reason", v.reason},
             {"T_s", v.T},
             {"settle_s", v.settle},
             {"tracking_error_max", *std::ranges::max_element(v.tracking)},
             {"work_J", v.work},
             {"rigid_work_J", v.work_rigid},
             {"friction_J", v.friction},
             {"drives", v.rigid ? "rigid" : "elastic"}};
  add_notes(reply, v.notes);
  if (v.with_drives) {
    reply["drawn_J"] = v.drawn;
    reply["rigid_drawn_J"] = v.drawn_rigid;
  }
  if (detail < Detail::kMargins) return reply;
  Json joints = Json::array();
  for (std::size_t j = 0; j < robot.model.joints.size(); ++j) {
    Json own{{"joint", robot.model.joints[j].name},
             {std::string("tracking_error_") + units.of(j, 0), v.tracking[j]},
             {std::string("end_error_") + units.of(j, 0), v.end_error[j]},
             {std::string("dq_") + units.of(j, 1), v.dq[j]},
             {std::string("tau_") + units.of(j, 4), v.tau[j]},
             {std::string("rigid_tau_") + units.of(j, 4), v.tau_rigid[j]}};
    if (std::isfinite(v.tau_limit[j])) {
      own[std::string("limit_") + units.of(j, 4)] = v.tau_limit[j];
      own["share"] = v.tau[j] / v.tau_limit[j];
    }
    joints.push_back(own);
  }
  reply["joints"] = joints;
  return reply;
}

void add_twin(const Json& verification, Verdict& verdict) {
  verdict.add(Of::kTwin, verification["feasible"] == true, verification["reason"].get<std::string>());
}

Json answer_verify(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, {.in_motion = true});
  const Detail detail = read_detail(r);
  const VerificationOptions options = read_verification(robot, r);
  std::optional<ClearOf> clear = ClearOf::read(robot, r, context, m.carried);
  r.only_if(r.describes() || m.ends().at_rest_at_end(), "settle_s", "a move that ends at rest");
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  Json reply = verification_json(robot, m, p.solution.T, options, context, detail);
  Verdict verdict = verdict_of(p.solution);
  add_twin(reply, verdict);
  if (clear) clear->judge(p.solution.path, reply, verdict);
  verdict.tell(reply);
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  return reply;
}

}  // namespace cotwin::services
