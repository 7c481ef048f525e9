#include "components/services/json/schema_parts.h"

#include <string_view>

namespace cotwin::services::schemas {

Json described(Json type, const char* description) {
  type["description"] = description;
  return type;
}

Json positive() { return {{"type", "number"}, {"exclusiveMinimum", 0}}; }
Json at_least_zero() { return {{"type", "number"}, {"minimum", 0}}; }
Json array_of(Json items) { return {{"type", "array"}, {"items", std::move(items)}}; }

Json or_null(Json object) {
  object["type"] = {"object", "null"};
  return object;
}

void joints(Object& o, const std::string& plain, const char* si, const Json& type, const char* what) {
  o.may((plain + "_" + si).c_str(), described(type, (std::string(what) + ", one per joint").c_str()));
  o.may(plain.c_str(),
        described(type,
                  (std::string(what) + ", one per joint of a robot with prismatic joints, those in m, m/s, … and N").c_str()));
  if (std::string_view(si) == "rad")
    o.may((plain + "_deg").c_str(), described(type, (std::string(what) + ", in degrees").c_str()));
}

Object joint() { return Object().must("joint", kText); }

Json peak() { return Object().must("value", kNumber).must("t_s", kNumber).may("limit", kNumber).may("share", kNumber); }
Json peaks() { return array_of(joint().like(kValueNames, peak())); }
Json limiting() {
  return or_null(Object()
                     .must("joint", kText)
                     .must("bound", kText)
                     .must("unit", kText)
                     .must("value", kNumber)
                     .must("t_s", kNumber)
                     .may("limit", kNumber)
                     .may("share", kNumber));
}
Json series() {
  return Object().must("t_s", kNumbers).must("joints", array_of(joint().like(kValueNames, kNumbers))).may("power_W", kNumbers);
}
Object reaction() {
  const Json vector = kNumbers, vectors = array_of(kNumbers);
  return Object()
      .must("T_s", kNumber)
      .may("limiting", limiting())
      .may("joints", peaks())
      .must("mass_kg", described(kNumber, "of the whole robot"))
      .must("momentum", Object().must("linear_Ns", vector).must("angular_Nms", vector))
      .must("end", base_at())
      .must("worst", Object().must("turn", base_at()).must("rate", base_at()).must("displacement", base_at()))
      .may("drift", described(base_at(), "with momentum: at the end if the joints stood still in the first posture"))
      .must("costs", costs())
      .may("series", Object()
                         .must("t_s", vector)
                         .must("turn_rad", vector)
                         .must("quaternion_wxyz", vectors)
                         .must("rate_rad_per_s", vectors)
                         .must("displacement_m", vectors));
}

Json motion() {
  Object o;
  o.must("unit", kText).must("T_s", kNumber);
  for (const auto& [plain, si] : {std::pair{"q_start", "rad"},
                                  {"q_end", "rad"},
                                  {"c_r", "rad"},
                                  {"dq_start", "rad_per_s"},
                                  {"dq_end", "rad_per_s"},
                                  {"ddq_start", "rad_per_s2"},
                                  {"ddq_end", "rad_per_s2"}})
    o.may((std::string(plain) + "_" + si).c_str(), kNumbers).may(plain, kNumbers);
  return o;
}
Json extreme() { return Object().must("power_W", kNumber).must("t_s", kNumber); }

Json base_at() {
  return Object()
      .must("t_s", kNumber)
      .must("turn_rad", described(kNumber, "angle of the rotation from the attitude at the start, 0 to pi"))
      .must("quaternion_wxyz", kNumbers)
      .must("rate_rad_per_s", kNumbers)
      .must("displacement_m", described(kNumbers, "of the base's origin; all vectors in the axes of the base at the start"));
}

Json place() { return Object().must("mass_kg", kNumberOrNull).must("speed_m_per_s", kNumber).must("t_s", kNumber); }
Json masses() {
  return Object()
      .must("t_s", kNumbers)
      .must("mass_kg", kNumbersOrNull)
      .must("inertia_kgm2", kNumbersOrNull)
      .must("speed_m_per_s", kNumbers);
}

Object risk() {
  return Object()
      .must("share", kNumberOrNull)
      .must("t_s", kNumber)
      .must("speed_m_per_s", kNumber)
      .must("mass_kg", kNumberOrNull)
      .must("limit_m_per_s", kNumberOrNull)
      .must("energy_J", kNumberOrNull)
      .must("energy_t_s", kNumber)
      .must("T_safe_s",
            described(kNumberOrNull, "from which on the move is within the limits; null: contact is not permitted"));
}

Json clear_of() {
  return Object()
      .must("clear", kBoolean)
      .must(
          "nearest",
          described(or_null(Object()
                                .must("t_s", kNumber)
                                .must("link", kText)
                                .must("obstacle", kText)
                                .must("distance_m", kNumber)
                                .must("p_link_m", kNumbers)
                                .must("p_obstacle_m", kNumbers)),
                    "not clear: the first time, of a link and what it meets; clear: the least distance; null: there is nothing "
                    "to meet"))
      .must("places",
            array_of(Object()
                         .must("name", kText)
                         .must("p_m", kNumbers)
                         .must("quaternion_wxyz", kNumbers)
                         .may("radius_m", kNumber)
                         .must("by", described({{"type", {"string", "null"}}}, "who places it; null: nobody, so at 0"))));
}

Json verified() {
  return Object()
      .must("feasible", kBoolean)
      .must("reason", kText)
      .must("T_s", kNumber)
      .must("settle_s", kNumber)
      .must("tracking_error_max", kNumber)
      .must("work_J", kNumber)
      .must("rigid_work_J", kNumber)
      .must("friction_J", kNumber)
      .must("drives", {{"type", "string"}, {"enum", {"elastic", "rigid"}}})
      .may("drawn_J", kNumber)
      .may("rigid_drawn_J", kNumber)
      .may("joints", array_of(joint().like(kValueNames, kNumber).may("share", kNumber)))
      .may("clear_of", clear_of());
}
Json found_compliance() {
  Object o;
  o.must("feasible", kBoolean).must("reason", kText);
  for (const char* name : {"T_settle_s", "T_cycle_s", "moves_per_hour"})
    o.must(name,
           described(kNumberOrNull, "null: no parameters meet the conditions, or of a cycle: the motion is not feasible"));
  for (const char* name : {"M_kg", "D_Ns_per_m", "S_N_per_m", "zeta", "omega_rad_per_s"})
    o.may(name, described(kNumberOrNull, "null: no parameters meet the conditions"));
  Object axis;
  axis.must("direction", kNumbers).must("M_kg", kNumber).must("D_Ns_per_m", kNumber).must("S_N_per_m", kNumber);
  for (const char* name : {"zeta", "omega_rad_per_s", "T_settle_s", "deflection_m"}) axis.must(name, kNumber);
  o.may("axes", array_of(axis));
  return o;
}
Json costs() {
  Object o;
  for (const char* name : kCosts) o.may(name, kNumber);
  return o;
}

}  // namespace cotwin::services::schemas
