#include "components/services/json/contact_json.h"

#include <algorithm>

#include "components/services/assumptions.h"
#include "models/foundation/support/error.h"

namespace cotwin::services {

robot::Frame read_frame(const Robot& robot, Reader& r, const char* what) {
  const std::string name = r.text("frame", "", what);
  if (r.describes()) return {};
  try {
    return name.empty() ? robot.model.end_effector() : robot.model.frame(name);
  } catch (const Error& e) {
    throw RequestError(r.pointer("frame"), e.what());
  }
}

ContactOptions read_contact_frame(const Robot& robot, Reader& r, const char* of_frame, const char* of_direction,
                                  const char* of_motors) {
  ContactOptions o;
  o.frame = read_frame(robot, r, of_frame).name;
  const bool given = r.any("direction") != nullptr;
  const std::vector<double> u = r.vector("direction", 3, true, of_direction);
  if (given) {
    o.u = Eigen::Vector3d(u[0], u[1], u[2]);
    if (!(o.u->norm() > 0))
      throw RequestError(r.pointer("direction"), "expected three numbers in the axes of the base, not all 0");
  }
  o.motors_held = r.word("motors", {"free", "held"}, of_motors) == "held";
  if (o.motors_held && !robot.drives)
    throw RequestError(r.pointer("motors"),
                       "is held, but the robot has no drive_train.ssv with the inertias of its motors, expected free");
  if (robot.drives) o.B = robot.drives->B;
  return o;
}

std::string words_of_part(const std::string& name) {
  std::string words = name.ends_with("_nd") ? name.substr(0, name.size() - 3) : name;  // of the hand that is not dominant
  std::ranges::replace(words, '_', ' ');
  return words;
}

void read_body_parts(const Robot& robot, Reader& r, ContactOptions& o, const char* of_parts) {
  if (robot.parts.empty() && !r.describes())
    throw RequestError("", "there is no table of body parts, expected people/iso_ts_15066.csv beside the folder of robots");
  for (const std::string& name : r.texts("parts", {"hands_and_fingers", "chest"}, of_parts)) {
    if (r.describes()) break;
    try {
      o.parts.push_back(robot::find_body_part(robot.parts, name, "parts"));
    } catch (const Error& e) {
      throw RequestError(r.pointer("parts"), e.what());
    }
  }
  o.transient = r.word("contact", {"transient", "quasi_static"}) == "transient";
  o.area = r.positive("contact_area_m2", 0, "also the permissible pressure counts");
  o.load = r.not_negative("load_kg", 0, "at the frame, in both masses of the robot; the move is planned without it");
  o.only_effective = r.word("mass", {"larger", "effective"},
                            "that counts: the larger one of M/2 + m_L (ISO/TS 15066, A.3.4) and the effective mass, or the "
                            "effective mass, for which the motors must be known") == "effective";
  if (const std::string why = r.describes() ? "" : unknown_motors(robot); o.only_effective && !why.empty())
    throw RequestError(r.pointer("mass"), "is effective, but " + why + ", expected larger");
}

}  // namespace cotwin::services
