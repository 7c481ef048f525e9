#include <algorithm>
#include <string>
#include <utility>

#include "components/services/json/schema_parts.h"
#include "components/services/json/verdict.h"

namespace cotwin::services {

namespace schemas {

namespace {

/// What is told of persons beside a motion, by name.
std::vector<std::pair<const char*, Json>> of_safety() {
  return {{"safe", described({{"type", {"boolean", "null"}}}, "null: nobody can say, safe_reason tells why")},
          {"safe_reason", kText},
          {"T_safe_s",
           described(kNumberOrNull, "duration from which on the move is within the limits; null: contact is not permitted")},
          {"worst_part", kText},
          {"mass", {{"enum", {"larger", "effective"}}}},
          {"load_kg", kNumber},
          {"effective", described(risk(), "worst_part with the effective mass of the frame")},
          {"iso_ts_15066", described(risk(), "worst_part with M/2 + m_L (ISO/TS 15066, A.3.4)")}};
}

/// Schemas of the replies, by the services' names.
const std::pair<const char*, Json (*)()> kReplies[] = {
    {"feasibility",
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
           .may("clear_of", clear_of())
           .may("motion", motion());
     }},
    {"cycle_time",
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
           .may("clear_of", clear_of())
           .may("motion", motion());
     }},
    {"energy",
     []() -> Json {
       Object o;
       o.must("T_s", kNumber).must("feasible", kBoolean).must("reason", kText);
       o.must("boundary", {{"type", "string"}, {"enum", {"mains", "joints"}}}).must("energy_J", kNumber);
       o.may("price", described(kNumberOrNull, "null: the price of energy is unknown"))
           .may("co2_kg", kNumberOrNull)
           .may("assumed", described(kText, "parameters of the drives that are assumptions"))
           .may("cycle_s", described(kNumber, "for which energy_J is, with the wait after the move"))
           .may("move_J", described(kNumber, "of the move without the wait"));
       o.may("best", Object()
                         .must("T_s", kNumber)
                         .must("energy_J", kNumber)
                         .must("saved_J", kNumber)
                         .must("at_shortest", kBoolean)
                         .must("at_longest", kBoolean)
                         .must("brakes_close", kBoolean));
       for (const char* name :
            {"work_positive_J", "work_negative_J", "friction_J",      "kinetic_J",     "potential_J", "copper_J",
             "converter_J",     "iron_J",          "idle_J",          "regenerable_J", "supplied_J",  "returned_J",
             "chopped_J",       "stored_J",        "supply_losses_J", "controller_J",  "wrench_J",    "drawn_J",
             "peak_power_W",    "peak_power_t_s",  "residual_J"})
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
    {"torques",
     []() -> Json {
       return Object()
           .must("T_s", kNumber)
           .must("feasible", kBoolean)
           .must("reason", kText)
           .may("joints", array_of(joint().must("t_s", kNumber).like(kValueNames, kNumber).may("share", kNumber)))
           .may("series", series())
           .may("torque_squared_integral", kNumber);
     }},
    {"peak_power",
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
    {"jerk",
     []() -> Json {
       return Object()
           .must("T_s", kNumber)
           .must("feasible", kBoolean)
           .must("reason", kText)
           .may("jerk_squared_integral_rad2_per_s5", kNumber)
           .may("acceleration_squared_integral_rad2_per_s3", kNumber)
           .may("jerk_squared_integral", kNumber)
           .may("acceleration_squared_integral", kNumber)
           .must("share_of_quintic", kNumberOrNull)
           .may("joints", array_of(joint().must("t_s", kNumber).like(kValueNames, kNumber).may("share", kNumber)));
     }},
    {"effective_mass",
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
    {"safety",
     []() -> Json {
       Object o;
       o.must("feasible", kBoolean).must("reason", kText).must("T_s", kNumber);
       for (const auto& [name, type] : of_safety()) o.must(name, type);
       return o.may("pace", described({{"const", "safe"}}, "T_s is at least T_safe_s"))
           .may("parts", array_of(risk().must("part", kText).must("effective", risk()).must("iso_ts_15066", risk())))
           .may("heaviest", place())
           .may("fastest", place())
           .may("series", masses());
     }},
    {"manipulability",
     []() -> Json {
       const auto ellipsoids = [](const char* translation, const char* rotation) {
         const Object at = Object()
                               .must("t_s", kNumber)
                               .must("measure", described(kNumber, "product of the longest half-axes of translation"))
                               .must(translation, described(kNumbers, "half-axes, longest first"))
                               .must(rotation, kNumbers);
         return Object()
             .must("dimensions", described({{"type", "integer"}}, "half-axes in the measure"))
             .must("least", at)
             .must("greatest", at)
             .may("series", Object()
                                .must("t_s", kNumbers)
                                .must("measure", kNumbers)
                                .must(translation, array_of(kNumbers))
                                .must(rotation, array_of(kNumbers)));
       };
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("T_s", kNumber)
           .must("kinematic",
                 described(ellipsoids("translation_m_per_s", "rotation_rad_per_s"), "speeds of the joints up to 1"))
           .must("dynamic", described(or_null(ellipsoids("translation_m_per_s2", "rotation_rad_per_s2")),
                                      "torques up to their bounds; null: a joint has none"));
     }},
    {"payload",
     []() -> Json {
       return Object()
           .must("feasible", described(kBoolean, "without the payload"))
           .must("reason", kText)
           .must("T_s", kNumber)
           .must("mass_kg",
                 described(kNumberOrNull, "a point mass; null: the motion is not feasible without it, or nothing limits it"))
           .may("limiting", limiting());
     }},
    {"reach",
     []() -> Json {
       return Object()
           .must("feasible", described(kBoolean, "all poses are reached"))
           .must("reason", described(kText, "of the first pose that is not reached"))
           .may("poses", array_of(Object()
                                      .must("reached", kBoolean)
                                      .must("reason", kText)
                                      .must("distance_m", described(kNumber, "that is left"))
                                      .must("angle_rad", kNumber)
                                      .may("q_rad", described(Json({{"type", {"array", "null"}}, {"items", kNumber}}),
                                                              "a posture; null: there is none"))
                                      .may("q", described(Json({{"type", {"array", "null"}}, {"items", kNumber}}),
                                                          "the same of a robot with prismatic joints"))));
     }},
    {"reaction",
     []() -> Json {
       return reaction()
           .may("feasible", described(kBoolean, "of a move: within the bounds, torques on the free base"))
           .may("reason", kText);
     }},
    {"reactionless",
     []() -> Json {
       const Json of_motion = Object().must("turn_rad", kNumber).must("worst_turn_rad", kNumber).must("costs", costs());
       return reaction()
           .must("feasible", described(kBoolean, "reaches the goal within the bounds, torques on the free base"))
           .must("reason", kText)
           .must("reactionless", described(kBoolean, "false: the base turns on the way, at the end as little as was found"))
           .must("to_go",
                 described(Object().must("distance_m", kNumber).must("angle_rad", kNumber), "what is left to the goal"))
           .may("to_q_rad", kNumbers)
           .may("to_q", kNumbers)
           .must("standard",
                 described(of_motion, "the quintic in the same time, to the given posture, without one to the posture found"))
           .may("motion", Object()
                              .must("unit", kText)
                              .must("t_s", kNumbers)
                              .may("q_rad", array_of(kNumbers))
                              .may("q", array_of(kNumbers)));
     }},
    {"throughput",
     []() -> Json {
       return Object()
           .must("feasible", kBoolean)
           .must("reason", kText)
           .must("T_move_s", kNumber)
           .must("T_settle_s", kNumber)
           .must("T_process_s", kNumber)
           .must("T_cycle_s", described(kNumberOrNull, "null: the move is not feasible"))
           .must("moves_per_hour", described(kNumberOrNull, "null: the move is not feasible"))
           .may("axes_T_settle_s", kNumbers)
           .may("stiff_moves_per_hour", kNumberOrNull)
           .may("lost_share", kNumberOrNull);
     }},
    {"optimise",
     []() -> Json {
       Object o;
       o.must("status", {{"type", "string"}, {"enum", {"feasible", "best-effort", "infeasible"}}}).must("reason", kText);
       o.may("complete", described(kBoolean, "false: ended early by evaluations_max or limit_s"));
       o.must("feasible", kBoolean).may("T_s", kNumber).may("cost", kNumber).may("costs", costs());
       o.may("quintic", Object()
                            .must("T_s", kNumber)
                            .must("feasible", kBoolean)
                            .must("reason", kText)
                            .must("cost", kNumber)
                            .must("costs", costs()));
       Object shares;
       for (const char* name : kCosts) shares.may(name, kNumberOrNull);
       o.may("saved_share", kNumberOrNull).may("saved_shares", shares).may("limiting", limiting()).may("motion", motion());
       o.may("device", described(kText, "that judged the particles, where a GPU was wanted: its name, or cpu"))
           .may("device_rounding", kNumber);
       o.may("evaluations", {{"type", "integer"}}).may("pruned", {{"type", "integer"}}).may("joints", peaks());
       for (const auto& [name, type] : of_safety()) o.may(name, type);
       o.may("clear_of", clear_of())
           .may("history", kNumbers)
           .may("verification", verified())
           .may("compliance", found_compliance());
       o.may("front", array_of(Object()
                                   .must("T_s", kNumber)
                                   .must("costs", costs())
                                   .must("verdict", verdict())
                                   .may("motion", motion())
                                   .may("compliance", array_of(Object()
                                                                   .must("direction", kNumbers)
                                                                   .must("M_kg", kNumber)
                                                                   .must("D_Ns_per_m", kNumber)
                                                                   .must("S_N_per_m", kNumber)))));
       return o;
     }},
    {"grow",
     []() -> Json {
       const Json integer{{"type", "integer"}}, numbers_or_null = array_of(kNumberOrNull);
       const Json motions = array_of(Object()
                                         .must("number", integer)
                                         .must("T_s", kNumber)
                                         .must("costs", costs())
                                         .must("motion", motion())
                                         .must("verdict", verdict()));
       Object quantiles;
       for (const char* p : {"0.05", "0.25", "0.5", "0.75", "0.95"}) quantiles.must(p, kNumber);
       const Json distribution =
           or_null(Object()
                       .must("least", kNumber)
                       .must("mean", kNumber)
                       .must("most", kNumber)
                       .must("quantiles", described(quantiles, "to 0.4 %"))
                       .may("histogram", described(Object().must("edges", kNumbers).must("motions", array_of(integer)),
                                                   "motions[i] from edges[i] to below edges[i + 1]"))
                       .may("best", motions));
       Object distributions, goals;
       for (const char* axis : {"x_m", "y_m", "z_m"}) goals.may(axis, kNumbers);
       const Json postures = array_of({{"type", {"array", "null"}}, {"items", kNumber}});
       goals.may("reached", array_of(kBoolean)).may("q_rad", postures).may("q", postures);
       goals.must("feasible_share", numbers_or_null);
       for (const char* name : kCosts) {
         distributions.may(name, described(distribution, "of feasible motions; null: none is"));
         goals.may(name, described(numbers_or_null, "least that was drawn; null: no motion is feasible"));
       }
       distributions.may("distance_m", described(distribution, "constraint base: from the frame's first place to its last"));
       const Object ends = Object().must("least_m", kNumbers).must("most_m", kNumbers);
       return Object()
           .must("feasible", described(kBoolean, "at least one motion"))
           .must("reason", kText)
           .must("motions", integer)
           .must("feasible_motions", integer)
           .must("forbidden", described(array_of(joint().must("bound", kText).must("motions", integer).must("share", kNumber)),
                                        "motions that are not feasible, by the bound that they exceed most"))
           .must("costs", distributions)
           .may("device", described(kText, "that judged the motions: the name of a GPU, or cpu"))
           .may("device_rounding", described(kNumber, "largest relative difference to the processor on 4096 motions"))
           .may("ends", described(ends, "constraint base: corners of the places at which the frame ends or begins"))
           .may("front", described(motions, "none is better than another in all costs"))
           .may("goals", described(goals, "of each posture of a list or place of a grid, x first"));
     }},
    {"verify", [] { return verified(); }},
};

}  // namespace

}  // namespace schemas

schemas::Json reply_schema(const std::string& name) {
  using namespace schemas;
  Json reply = std::ranges::find(kReplies, name, [](const auto& each) { return each.first; })->second();
  reply["properties"]["assumptions"] =
      described(array_of(Object()
                             .must("what", kText)
                             .must("value", {{"type", {"number", "array", "null"}}, {"items", kNumber}})
                             .must("effect", kText)
                             .must("file", kText)),
                "what is unknown or assumed, and counts nevertheless");
  reply["properties"]["verdict"] = verdict();
  reply["required"].push_back("verdict");
  reply["properties"]["notes"] = described(array_of(kText), "what else the reader of the reply has to know");
  return reply;
}

}  // namespace cotwin::services
