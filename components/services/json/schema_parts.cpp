#include "components/services/json/schema_parts.h"

#include <string_view>

#include "components/services/json/json.h"

namespace cotwin::services::schemas {

Json described(Json type, const char* description) {
  type["description"] = description;
  return type;
}

Json positive() { return {{"type", "number"}, {"exclusiveMinimum", 0}}; }
Json duration(const char* what) {
  return {{"type", "number"}, {"minimum", kBriefest}, {"maximum", kLongest}, {"description", what}};
}
Json at_least_zero() { return {{"type", "number"}, {"minimum", 0}}; }
Json whole(int least, int most, int other) {
  return {{"type", "integer"}, {"minimum", least}, {"maximum", most}, {"default", other}};
}
Json words(std::initializer_list<const char*> all) {
  Json list = Json::array();
  for (const char* word : all) list.push_back(word);
  return {{"type", "string"}, {"enum", list}, {"default", list[0]}};
}
Json array_of(Json items) { return {{"type", "array"}, {"items", std::move(items)}}; }

Json or_null(Json object) {
  object["type"] = {"object", "null"};
  return object;
}

Object request(const char* service) {
  Object o;
  o.must("service", {{"const", service}});
  o.may("robot", described(kText, "name of a robot"));
  o.may("locked_q", {{"type", "object"},
                     {"additionalProperties", kNumber},
                     {"description", "joints that stand still, by name: position in rad or m"}});
  return o;
}

void joints(Object& o, const std::string& plain, const char* si, const Json& type, const char* what) {
  o.may((plain + "_" + si).c_str(), described(type, (std::string(what) + ", one per joint").c_str()));
  o.may(plain.c_str(),
        described(type,
                  (std::string(what) + ", one per joint of a robot with prismatic joints, those in m, m/s, … and N").c_str()));
  if (std::string_view(si) == "rad")
    o.may((plain + "_deg").c_str(), described(type, (std::string(what) + ", in degrees").c_str()));
}

void move(Object& o, bool timed) {
  joints(o, "from_q", "rad", kNumbers, "posture at the start");
  joints(o, "to_q", "rad", kNumbers, "posture at the end");
  o.one_of({"from_q_rad", "from_q_deg", "from_q"}).one_of({"to_q_rad", "to_q_deg", "to_q"});
  if (timed) o.may("T_s", duration("duration; without it the shortest one"));
  o.may("degree", described(whole(5, 31, 5), "of the polynomials"));
  joints(o, "c_r", "rad", kNumbers, "redundant coefficients, joint by joint, (degree - 5) each");
  joints(o, "q_min", "rad", kNumbersOrNull, "bound in place of the robot's, null: none");
  joints(o, "q_max", "rad", kNumbersOrNull, "bound in place of the robot's, null: none");
  joints(o, "dq_max", "rad_per_s", kNumbersOrNull, "bound in place of the robot's, null: none");
  joints(o, "ddq_max", "rad_per_s2", kNumbersOrNull, "bound, null: none");
  joints(o, "dddq_max", "rad_per_s3", kNumbersOrNull, "bound, null: none");
  joints(o, "tau_max", "Nm", kNumbersOrNull, "bound of the motors behind the gears in place of the robot's, null: none");
  o.may("drives", described(words({"robot", "none"}), "whether inertia and friction of the motors count"));
  o.may("detail", described(words({"margins", "verdict", "series", "all"}), "how much the reply tells"));
}

void samples(Object& o, int other) { o.may("samples", whole(2, 100000, other)); }

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
Json motion() {
  return Object()
      .must("unit", kText)
      .must("T_s", kNumber)
      .may("q_start_rad", kNumbers)
      .may("q_end_rad", kNumbers)
      .may("c_r_rad", kNumbers)
      .may("q_start", kNumbers)
      .may("q_end", kNumbers)
      .may("c_r", kNumbers);
}
Json extreme() { return Object().must("power_W", kNumber).must("t_s", kNumber); }

void contact(Object& o) {
  o.may("frame", described(kText, "of the URDF; without it the end effector"));
  o.may("direction", {{"type", "array"},
                      {"items", kNumber},
                      {"minItems", 3},
                      {"maxItems", 3},
                      {"description", "in the axes of the base; without it along the velocity of the frame"}});
  o.may("motors", described(words({"free", "held"}), "free: a blow; held: slower motions, the motors' inertias count"));
  samples(o, 401);
}
Json place() { return Object().must("mass_kg", kNumberOrNull).must("speed_m_per_s", kNumber).must("t_s", kNumber); }
Json masses() {
  return Object()
      .must("t_s", kNumbers)
      .must("mass_kg", kNumbersOrNull)
      .must("inertia_kgm2", kNumbersOrNull)
      .must("speed_m_per_s", kNumbers);
}

void verification(Object& o) {
  o.may("settle_s", described(positive(), "rest after the move that is also simulated"));
  for (const char* name : {"tracking_max_rad", "tracking_max"})
    o.may(name, described(positive(), "largest tracking error, of any joint"));
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
      .may("joints", array_of(joint().like(kValueNames, kNumber).may("share", kNumber)));
}
Json end_pose() {
  const Json names{"all", "x", "y", "z", "rx", "ry", "rz"};
  const auto vector = [](int size) {
    return Json{{"type", "array"}, {"items", kNumber}, {"minItems", size}, {"maxItems", size}};
  };
  return Object()
      .may("frame", described(kText, "of the URDF; without it the end effector"))
      .may("directions", {{"type", {"array", "string"}},
                          {"items", {{"type", "string"}, {"enum", names}}},
                          {"minItems", 1},
                          {"description", "that have to be reached; the joints may have one more; without it all six"}})
      .may("axes", described(words({"base", "tool"}), "of the directions"))
      .may("p_m", described(vector(3), "in the base"))
      .may("quaternion_wxyz", described(vector(4), "of the frame in the base"));
}
Json range(const char* what) {
  return {{"type", {"number", "array"}}, {"items", positive()}, {"exclusiveMinimum", 0}, {"minItems", 2}, {"maxItems", 2},
          {"description", what}};
}
Json compliance() {
  const auto parameters = [](Object o, bool must) {
    for (const char* name : {"M_kg", "D_Ns_per_m", "S_N_per_m"})
      must ? o.must(name, range("a number, or least and most")) : o.may(name, range("a number, or least and most"));
    return o;
  };
  const Json direction{{"type", "array"}, {"items", kNumber}, {"minItems", 3}, {"maxItems", 3}};
  return parameters(Object(), false)
      .may("axes",
           described({{"type", "array"},
                      {"items", parameters(Object().must("direction", direction), true)},
                      {"minItems", 1},
                      {"maxItems", 3}},
                     "searched together with the motion; M_kg, D_Ns_per_m and S_N_per_m are then those of the axes, and "
                     "load_kg and settled_m are required"))
      .may("frame", described(kText, "with axes: of the URDF; without it the end effector"))
      .may("load_kg", described(positive(), "with axes: mass at the frame, whose inertia deflects it"))
      .may("settled_m", described(positive(), "with axes: deflection that counts as settled"))
      .may("deflection_max_m", described(positive(), "with axes: bound of the deflection during the motion"))
      .may("zeta_min", described(positive(), "least damping ratio D/(2 sqrt(M S))"))
      .may("omega_max_rad_per_s", described(positive(), "largest natural frequency sqrt(S/M)"))
      .may("settled_share", {{"type", "number"}, {"exclusiveMinimum", 0}, {"exclusiveMaximum", 1}, {"default", 0.02}})
      .may("T_process_s", at_least_zero());
}
Json found_compliance() {
  Object o;
  o.must("feasible", kBoolean).must("reason", kText);
  for (const char* name : {"T_settle_s", "T_cycle_s", "moves_per_hour"})
    o.must(name, described(kNumberOrNull, "null: no parameters meet the conditions"));
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
