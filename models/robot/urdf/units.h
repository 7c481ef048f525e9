#pragma once
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/robot/robot_model.h"

/// Units of measure in which the numbers of a URDF seem to be although the format has SI: those of drawings and data sheets.
namespace cotwin::robot {

/// Factors from the units of a file to SI. Text: "length=mm,mass=g,limit=deg,speed=deg/s,rpy=deg", or "si".
struct UrdfUnits {
  double length = 1;                 // m, mm, cm, in
  double mass = 1;                   // kg, g, lb
  double inertia = 1;                // mass times length squared, unless it is given: kg.m2, kg.mm2, kg.cm2, g.m2, g.mm2, g.cm2
  double limit = 1;                  // positions of revolute joints: rad, deg
  double speed = 1;                  // of revolute joints: rad/s, deg/s, rpm
  double rpy = 1;                    // rad, deg
  std::string text;                  // that was parsed
  std::set<std::string> named = {};  // quantities that the text names: "length"; of "si" all
};

/// Throws Error `place: …` with the quantities, or the units of one.
UrdfUnits parse_urdf_units(const std::string& text, const std::string& place);

/// Whether a word names a unit of SI in which files of robots have their numbers ("kg", "N.m", "rad/s", "SI"), or none.
bool is_si_unit(std::string_view word);

/// Whether the factor of a quantity ("length") is 1.
bool is_si(const UrdfUnits& units, const std::string& quantity);

/// Something that is not plausible in SI, and the text of UrdfUnits with which it would be.
struct UnitSuspicion {
  std::string what;   // "the robot reaches 850 m"
  std::string units;  // "length=mm"; "limit=rad" if one joint alone is not plausible, which no unit of all cures
};

/// Reach above 20 m (length); slides with a mass that go further than that (length=m); radii of gyration above 5 m and five times the reach of half
/// of the links (inertia); more than 100 kg and 2500 kg per cubic metre of reach and travel of slides (mass); limits of
/// turning joints between 20 and 1100 rad (limit, and speed if half of them are between 30 and 1100 rad/s; limit=rad where they are fewer than
/// half of those that have some, or one of two without such a speed, and in half units, as degrees are). Of 483 public URDFs the largest reach is 6.7 m, and 900 kg/m³ and 10 rad are
/// exceeded by none, except that 10⁶ and more stand for no limit. Of a tool: a centre of mass or a frame farther than 20 m away.
std::vector<UnitSuspicion> suspect_units(const RobotModel& robot);

/// Throws Error if a URDF that was read in `units` is not plausible: OtherUnits where they leave out a quantity, Error `place: …` where
/// they name one in another unit than SI. What they name in SI is not looked at.
void check_units(std::string_view converted, const std::string& place, const UrdfUnits& units);

/// More than a turn: an rpy in degrees. The largest in the same files is 4.7 rad.
inline constexpr double kLargestPlausibleAngle = 6.9;  // rad

/// The error for a file with these suspicions, at least one. It names the option that reads the file in these units.
class OtherUnits : public Error {
 public:
  OtherUnits(const std::string& text, std::string units) : Error(text), units(std::move(units)) {}
  std::string units;  // of all suspicions; "" if they cure none
};
OtherUnits other_units(const std::string& place, const std::vector<UnitSuspicion>& found);

}  // namespace cotwin::robot
