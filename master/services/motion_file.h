#pragma once
#include <string>

namespace cotwin::master {

/// The member "motion" of a reply as a file for the unit in "unit": parameters of unit:motion (SSV), named like the unit, or a table of postures (CSV, columns t and q[1]…).
/// Throws Error for text that is no motion.
std::string motion_file(const std::string& motion);

}  // namespace cotwin::master
