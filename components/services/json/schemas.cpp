#include "components/services/json/schemas.h"

#include "components/services/json/json.h"
#include "components/services/json/schema_parts.h"

namespace cotwin::services {

namespace schemas {

namespace {

constexpr const char* kDialect = "https://json-schema.org/draft/2020-12/schema";

struct Service {
  const char *name, *description;
  Object (*request)();
  Json (*reply)();
};

const Service kServices[] = {
    {"feasibility", "Can the robot make the move? Names joint, time and bound.",
     [] {
       Object o = request("feasibility");
       move(o, true);
       samples(o, 101);
       return o;
     },
     []() -> Json {
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("T_s", kNumberOrNull)
           .must("limiting", limiting())
           .may("joints", peaks())
           .may("series", series())
           .may("torque_squared_integral", kNumber)
           .may("work_J", kNumber)
           .may("shared_work_J", kNumber)
           .may("motion", motion());
     }},
    {"cycle_time", "The shortest duration of the move within the bounds.",
     [] {
       Object o = request("cycle_time");
       move(o, false);
       o.may("T_process_s", at_least_zero());
       return o;
     },
     []() -> Json {
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("T_s", kNumberOrNull)
           .must("T_cycle_s", kNumberOrNull)
           .must("moves_per_hour", kNumberOrNull)
           .must("limiting", limiting())
           .may("joints", peaks())
           .may("series", series())
           .may("motion", motion());
     }},
    {"energy", "What the move costs: books from the mains to the joints, and the duration of least energy.",
     [] {
       Object o = request("energy");
       move(o, true);
       o.may("bus", described(words({"shared", "none", "grid"}), "DC link: shared, split (none), or regenerating (grid)"));
       o.may("cycle_s", described(positive(), "time for the move and the wait after it"));
       o.may("price_per_kWh", at_least_zero());
       o.may("co2_kg_per_kWh", at_least_zero());
       o.may("best", {{"type", "boolean"}, {"default", false}, {"description", "also the duration of least energy"}});
       o.may("T_max_s", duration("longest duration for that"));
       return o;
     },
     []() -> Json {
       Object o;
       o.must("T_s", kNumber).must("feasible", kBoolean).must("reason", kText);
       o.must("boundary", {{"type", "string"}, {"enum", {"mains", "joints"}}}).must("energy_J", kNumber);
       o.may("price", described(kNumberOrNull, "null: the price of energy is unknown"))
           .may("co2_kg", kNumberOrNull)
           .may("assumed", described(kText, "parameters of the drives that are assumptions"));
       o.may("best", Object()
                         .must("T_s", kNumber)
                         .must("energy_J", kNumber)
                         .must("saved_J", kNumber)
                         .must("at_shortest", kBoolean)
                         .must("at_longest", kBoolean)
                         .must("brakes_close", kBoolean));
       for (const char* name : {"work_positive_J", "work_negative_J", "friction_J",   "kinetic_J",      "potential_J",
                                "copper_J",        "converter_J",     "iron_J",       "idle_J",         "regenerable_J",
                                "supplied_J",      "returned_J",      "chopped_J",    "stored_J",       "supply_losses_J",
                                "controller_J",    "drawn_J",         "peak_power_W", "peak_power_t_s", "residual_J"})
         o.may(name, kNumber);
       o.may("waiting", Object().must("T_s", kNumber).must("energy_J", kNumber).must("brakes_close", kBoolean));
       o.may("joints", array_of(joint()
                                    .must("work_positive_J", kNumber)
                                    .must("work_negative_J", kNumber)
                                    .may("copper_J", kNumber)
                                    .may("converter_J", kNumber)
                                    .may("iron_J", kNumber)));
       o.may("series", Object().must("t_s", kNumbers).must("mechanical_power_W", kNumbers));
       return o;
     }},
    {"torques", "Torques of the move by terms: inertia, Coriolis, gravity, drives.",
     [] {
       Object o = request("torques");
       move(o, true);
       samples(o, 101);
       return o;
     },
     []() -> Json {
       return Object()
           .must("T_s", kNumber)
           .must("feasible", kBoolean)
           .must("reason", kText)
           .may("joints", array_of(joint().must("t_s", kNumber).like(kValueNames, kNumber).may("share", kNumber)))
           .may("series", series())
           .may("torque_squared_integral", kNumber);
     }},
    {"peak_power", "The largest mechanical power of the motors, drawn and returned.",
     [] {
       Object o = request("peak_power");
       move(o, true);
       samples(o, 101);
       o.may("power_max_W", described(positive(), "bound for a verdict"));
       return o;
     },
     []() -> Json {
       return Object()
           .must("T_s", kNumber)
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("drawn", extreme())
           .must("returned", extreme())
           .may("joints", array_of(joint().must("drawn", extreme()).must("returned", extreme())))
           .may("series", Object().must("t_s", kNumbers).must("power_W", kNumbers));
     }},
    {"jerk", "Jerk of the move against its bound and against the quintic of the same duration.",
     [] {
       Object o = request("jerk");
       move(o, true);
       return o;
     },
     []() -> Json {
       return Object()
           .must("T_s", kNumber)
           .may("jerk_squared_integral_rad2_per_s5", kNumber)
           .may("acceleration_squared_integral_rad2_per_s3", kNumber)
           .may("jerk_squared_integral", kNumber)
           .may("acceleration_squared_integral", kNumber)
           .must("share_of_quintic", kNumberOrNull)
           .may("joints", array_of(joint().must("t_s", kNumber).like(kValueNames, kNumber).may("share", kNumber)));
     }},
    {"effective_mass", "Mass that a frame shows along the move. null: it cannot move in that direction.",
     [] {
       Object o = request("effective_mass");
       move(o, true);
       contact(o);
       return o;
     },
     []() -> Json {
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("T_s", kNumber)
           .must("lightest", place())
           .must("heaviest", place())
           .may("fastest", place())
           .may("start", place())
           .may("end", place())
           .may("series", masses());
     }},
    {"safety", "Speeds of a frame against limits of body parts (ISO/TS 15066). Not a proof of safety.",
     [] {
       Object o = request("safety");
       move(o, true);
       contact(o);
       o.may("parts", {{"type", {"array", "string"}}, {"items", kText}, {"description", "body parts or regions"}});
       o.may("contact", words({"transient", "quasi_static"}));
       o.may("contact_area_m2", described(positive(), "also the permissible pressure counts"));
       return o;
     },
     []() -> Json {
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("safe", kBoolean)
           .must("T_s", kNumber)
           .must("T_safe_s", described(kNumberOrNull,
                                       "duration from which on the move is within the limits; null: contact is not permitted"))
           .must("worst_part", kText)
           .may("parts", array_of(Object()
                                      .must("part", kText)
                                      .must("share", kNumberOrNull)
                                      .must("t_s", kNumber)
                                      .must("speed_m_per_s", kNumber)
                                      .must("limit_m_per_s", kNumberOrNull)
                                      .must("energy_J", kNumberOrNull)
                                      .must("energy_t_s", kNumber)
                                      .must("T_safe_s", kNumberOrNull)))
           .may("heaviest", place())
           .may("fastest", place())
           .may("series", masses());
     }},
    {"throughput", "Time of a cycle and moves per hour when a compliance M x'' + D x' + S x must settle after the move.",
     [] {
       Object o = request("throughput");
       move(o, true);
       const Json one_or_more{{"type", {"number", "array"}}, {"items", kNumber}, {"minItems", 1}};
       o.must("M_kg", one_or_more).must("S_N_per_m", one_or_more).may("D_Ns_per_m", one_or_more);
       o.may("zeta", described(one_or_more, "in place of D_Ns_per_m"));
       o.one_of({"D_Ns_per_m", "zeta"});
       o.may("settled_share", {{"type", "number"}, {"exclusiveMinimum", 0}, {"exclusiveMaximum", 1}, {"default", 0.02}});
       o.may("T_process_s", at_least_zero());
       return o;
     },
     []() -> Json {
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("T_move_s", kNumber)
           .must("T_settle_s", kNumber)
           .must("T_process_s", kNumber)
           .must("T_cycle_s", kNumber)
           .must("moves_per_hour", kNumber)
           .may("axes_T_settle_s", kNumbers)
           .may("stiff_moves_per_hour", kNumber)
           .may("lost_share", kNumber);
     }},
    {"optimise", "The better motion: redundant coefficients and duration of least cost within the bounds.",
     [] {
       Object o = request("optimise");
       move(o, false);
       o.may("T_min_s", duration("shortest one; without it 0.0001 s"))
           .may("T_max_s", duration("longest one; without it the duration is T_min_s"))
           .one_of({"T_min_s", "T_max_s"});
       o.may(
           "cost",
           {{"type", {"string", "array"}},
            {"minItems", 1},
            {"items", Object().must("name", kText).may("weight", at_least_zero())},
            {"description",
             "time, torque, work, shared_work, acceleration, jerk, energy, effective_mass, safety, cycle_time or stiffness, or "
             "several with weights"}});
       o.may("bus", described(words({"shared", "none", "grid"}),
                              "for the cost energy: DC link shared, split (none), or regenerating (grid)"));
       o.may("rule", words({"weighted", "lexicographic", "pareto"}));
       o.may("tolerance",
             described(at_least_zero(), "lexicographic: by which an earlier cost may exceed its optimum, relative"));
       o.may("directions", described(whole(2, 1000, 11), "pareto: searches with different weights"));
       o.may("particles", whole(8, 100000, 200)).may("rounds", whole(1, 100000, 500)).may("seed", whole(0, 2147483647, 1));
       o.may("refine", {{"type", "boolean"}, {"default", true}, {"description", "Newton's method after the swarm"}});
       o.may("evaluations_max",
             described(whole(1, 1000000000, 10000000), "motions that are tried before the search ends early"));
       o.may("limit_s", described(positive(), "real time before the search ends early; the reply then depends on the machine"));
       o.may("verify", {{"type", "boolean"}, {"default", false}, {"description", "also a co-simulation of the twin"}});
       verification(o);
       o.may("to_pose", described(end_pose(),
                                  "the motion may end in any posture that reaches this pose; without p_m and "
                                  "quaternion_wxyz the pose at to_q"));
       o.may("compliance", described(compliance(), "parameters of M x'' + D x' + S x of least settling time after the move"));
       o.may("frame", described(kText, "of the costs effective_mass and safety; without it the end effector"));
       o.may("direction", {{"type", "array"},
                           {"items", kNumber},
                           {"minItems", 3},
                           {"maxItems", 3},
                           {"description", "in the axes of the base; without it along the velocity"}});
       o.may("motors", described(words({"free", "held"}), "whether the inertias of the motors count"));
       o.may("parts", {{"type", {"array", "string"}}, {"items", kText}, {"description", "of the cost safety"}});
       o.may("contact", words({"transient", "quasi_static"}));
       o.may("contact_area_m2", described(positive(), "also the permissible pressure counts"));
       return o;
     },
     []() -> Json {
       Object o;
       o.must("status", {{"type", "string"}, {"enum", {"feasible", "best-effort", "infeasible"}}}).must("reason", kText);
       o.may("complete", described(kBoolean, "false: ended early by evaluations_max or limit_s"));
       o.may("feasible", kBoolean).may("T_s", kNumber).may("cost", kNumber).may("costs", costs());
       o.may("quintic", Object()
                            .must("T_s", kNumber)
                            .must("feasible", kBoolean)
                            .must("reason", kText)
                            .must("cost", kNumber)
                            .must("costs", costs()));
       Object shares;
       for (const char* name : kCosts) shares.may(name, kNumberOrNull);
       o.may("saved_share", kNumberOrNull).may("saved_shares", shares).may("limiting", limiting()).may("motion", motion());
       o.may("evaluations", {{"type", "integer"}}).may("pruned", {{"type", "integer"}}).may("joints", peaks());
       o.may("history", kNumbers).may("verification", verified()).may("compliance", found_compliance());
       o.may("front", array_of(Object()
                                   .must("T_s", kNumber)
                                   .must("costs", costs())
                                   .may("motion", motion())
                                   .may("compliance", array_of(Object()
                                                                   .must("direction", kNumbers)
                                                                   .must("M_kg", kNumber)
                                                                   .must("D_Ns_per_m", kNumber)
                                                                   .must("S_N_per_m", kNumber)))));
       return o;
     }},
    {"verify",
     "The move in a co-simulation of the twin, with elastic joints and friction where the robot has data of its drives.",
     [] {
       Object o = request("verify");
       move(o, true);
       verification(o);
       return o;
     },
     [] { return verified(); }},
};

}  // namespace

}  // namespace schemas

std::string schema(const std::string& name) {
  using namespace schemas;
  for (const Service& s : kServices) {
    if (name != s.name) continue;
    Json ask = s.request(), reply = s.reply();
    reply["properties"]["notes"] = described(array_of(kText), "what else the reader of the reply has to know");
    ask["$schema"] = reply["$schema"] = kDialect;
    return Json{{"title", s.name}, {"description", s.description}, {"request", ask}, {"reply", reply}}.dump();
  }
  throw Error("schema", "'" + name + "' is no service, expected one of those that service_names() lists");
}

std::string problem_schema() {
  using namespace schemas;
  Json all = Object()
                 .must("title", kText)
                 .must("detail", kText)
                 .may("pointer", described(kText, "RFC 6901, of the member of the request"));
  all["$schema"] = kDialect;
  return all.dump();
}

}  // namespace cotwin::services
