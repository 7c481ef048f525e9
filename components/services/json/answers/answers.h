#pragma once
#include "components/services/contact_service.h"
#include "components/services/json/move_json.h"
#include "components/services/json/verdict.h"
#include "components/services/verification.h"

/// The services, for json.cpp. Each reads its members, with their types, ranges, defaults and descriptions, up to Reader::finish(),
/// and then computes the reply. With a reader that describes, or a context that says only_read, it only reads, and returns null; a
/// reader that describes takes a robot without joints.
namespace cotwin::services {

/// plan(), or a RequestError where no duration is possible.
Plan plan_of(const Robot& robot, const Move& move);
/// With the finding on the bounds.
Verdict verdict_of(const optimisation::Solution& solution);

Json answer_feasibility(const Robot&, Reader&, const Context&);
Json answer_cycle_time(const Robot&, Reader&, const Context&);
Json answer_torques(const Robot&, Reader&, const Context&);
Json answer_peak_power(const Robot&, Reader&, const Context&);
Json answer_jerk(const Robot&, Reader&, const Context&);
Json answer_throughput(const Robot&, Reader&, const Context&);
Json answer_energy(const Robot&, Reader&, const Context&);
Json answer_effective_mass(const Robot&, Reader&, const Context&);
Json answer_safety(const Robot&, Reader&, const Context&);
Json answer_manipulability(const Robot&, Reader&, const Context&);
Json answer_payload(const Robot&, Reader&, const Context&);
Json answer_reach(const Robot&, Reader&, const Context&);
Json answer_reaction(const Robot&, Reader&, const Context&);
Json answer_reactionless(const Robot&, Reader&, const Context&);
Json answer_optimise(const Robot&, Reader&, const Context&);
Json answer_grow(const Robot&, Reader&, const Context&);
/// grow with the constraint base.
Json answer_grow_reactionless(const Robot&, Reader&, const Context&);
Json answer_verify(const Robot&, Reader&, const Context&);

/// The members settle_s and tracking_max of a verification, for the services verify and optimise; the joints are rigid with drives = none.
VerificationOptions read_verification(const Robot& robot, Reader& r);
/// Runs the move in the twin of `context` and tells the result, with its notes as the member "notes". Throws RequestError if there is no
/// twin.
Json verification_json(const Robot& robot, const Move& move, double T, const VerificationOptions& options,
                       const Context& context, Detail detail);
/// The finding on persons of a motion.
void judge_persons(const Robot& robot, const PathSafety& safety, Verdict& verdict);
/// The same, and the members safe to iso_ts_15066.
void add_safety(const Robot& robot, const Move& move, const ContactOptions& options, const PathSafety& safety, Json& reply,
                Verdict& verdict);
/// The finding of the twin.
void add_twin(const Json& verification, Verdict& verdict);

}  // namespace cotwin::services
