#pragma once
#include "components/gateway/http/message.h"

namespace cotwin::gateway::http {

/// Call before something is done that a request asks for: writes that to the request's audit. The reply in place of the given one also
/// writes what became of it. Throws Refusal 503 if it cannot be written: then it must not be done.
Reply audited(const Request& request, Reply reply);

/// Writes that a request was refused before it was begun.
void audit_refusal(const Request& request, const Response& response);

}  // namespace cotwin::gateway::http
