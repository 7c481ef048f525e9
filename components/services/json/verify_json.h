#pragma once
#include "components/services/json/move_json.h"
#include "components/services/verification.h"

/// Verifications in requests and replies, for the services verify and optimise.
namespace cotwin::services {

/// The members settle_s and tracking_max; the joints are rigid with drives = none.
VerificationOptions read_verification(const Robot& robot, Reader& r);
/// Runs the move in the twin of `context` and tells the result, with its notes as the member "notes". Throws RequestError if there is no
/// twin.
Json verification_json(const Robot& robot, const Move& move, double T, const VerificationOptions& options,
                       const Context& context, Detail detail);

}  // namespace cotwin::services
