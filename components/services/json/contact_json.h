#pragma once
#include "components/services/contact_service.h"
#include "components/services/json/request.h"
#include "components/services/robots.h"

namespace cotwin::services {

/// The member "frame", without it the end effector. Throws RequestError.
robot::Frame read_frame(const Robot& robot, Reader& r, const char* what);
/// The members "frame", "direction" and "motors" with their descriptions. Throws RequestError.
ContactOptions read_contact_frame(const Robot& robot, Reader& r, const char* of_frame, const char* of_direction,
                                  const char* of_motors);
/// The name of a body part as people read it: "back of the hand".
std::string words_of_part(const std::string& name);
/// The members "parts", "contact" and "contact_area_m2". Throws RequestError, also without a table of body parts.
void read_body_parts(const Robot& robot, Reader& r, ContactOptions& options, const char* of_parts);

}  // namespace cotwin::services
