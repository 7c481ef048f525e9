#pragma once
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "components/services/json/verdict.h"

/// Application control (V-A, Figs. 3 and 4): which service a request means, for whom it is answered, and several of them in a row.
///
/// A request without the member "service" means one by its goal, by what it gives and leaves out, and by its context: one row of a
/// table (choice.cpp, docs/services.md). A chain {"steps": [{"name", "service" or "goal", …}, …], "defaults": {…}, "audience"} has
/// requests whose values may be taken from answers to earlier ones: "$NAME/POINTER".
namespace cotwin::services {

using Json = nlohmann::ordered_json;

inline constexpr double kNear_m = 1.6;  // a person who is nearer counts as near: what one walks in a second (ISO 13855)

/// A row of the table.
struct Choice {
  const char *name, *goal, *service;
  const char* given;           // members of which each must be given, "a|b" of which one; separated by blanks
  const char* missing;         // members that may not be given
  int near;                    // 1: only beside a person, -1: only where none is known to be near, 0: both
  const char* sets;            // members that it adds, JSON
  const char *time, *becomes;  // a member and its name in the request to the service, "": none
  const char* why;
};
const std::vector<Choice>& choices();
/// schema(), read once.
const Json& schemas_of(const std::string& service);
/// The row of a "choice" that choose() has seen.
const Choice& row_of(const Json& choice);

/// Replaces what a request says in place of a service by the service and "choice": {"row", "persons", "deadline_s"}. A request with a service
/// stays as it is. Throws RequestError where no row fits or several do, and for a choice that is none.
void choose(Json& request);

inline bool is_chain(const Json& request) { return request.is_object() && request.contains("steps"); }
/// Makes a request or chain ready to be stored, so that it always gives the same answer: defaults become members of the steps,
/// complete(request, pointer) adds to each what it does not say, services are chosen, and references are looked at. Throws
/// RequestError.
void settle(Json& request, const std::function<void(Json& request, const std::string& pointer)>& complete = {});

/// Of a chain that is settled and has answers to its first steps: the request of the next step, with values in place of references, and without
/// members that are not the service's; "": all are answered. Throws RequestError for a reference to what is not in the answer.
std::string next_step(const std::string& chain, const std::vector<std::string>& replies);
/// Asks all steps. Throws RequestError for the first one that cannot be answered.
std::string answer_chain(Robots& robots, Json chain, const Context& context);
/// check_object() of all steps; of those with references only the names of members.
void check_chain(Robots& robots, Json chain);
/// {"steps": [{"name", "service", "reply"}, …]} for its audience.
std::string chain_reply(const std::string& chain, const std::vector<std::string>& replies);
/// The problem of a step as one of the chain.
std::string chain_problem(const std::string& chain, std::size_t failed, const std::string& problem);

/// Who reads a reply, and what of it.
struct Audience {
  std::string name = {};   // "operator", "planner", "engineer", or "": nobody in particular
  bool whole = true;       // nothing is left out
  std::string least = {};  // the light that is required, or ""
};
/// That of a request or chain; `detail`: whether a detail is given. Throws RequestError.
Audience audience_of(const Json& request, bool detail);
/// The reply with its verdict as its reader wants it. `choice`: of the request, null without one; it adds the findings on persons and
/// deadline.
Json presented(const std::string& service, const Audience& audience, const Json& choice, Json reply);
/// The detail of a reply without the member "detail"; "": that of the services.
std::string detail_for(const std::string& audience);

inline constexpr std::size_t kMostSteps = 100;
inline const std::vector<std::string> kAudiences = {"operator", "planner", "engineer"};
inline const std::vector<std::string> kRequired = {"green", "amber"};  // lights that may be required, see Audience
namespace schemas {
Json light_required();
}
/// Requests without a service, chains, and the replies to these: {"chosen", "chain", "chain_reply"}.
Json control_schemas();
/// Adds what a request may leave to the control, and what a reply then has.
void add_control_schemas(const std::string& service, Json& request, Json& reply);

}  // namespace cotwin::services
