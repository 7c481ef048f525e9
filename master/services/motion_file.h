#pragma once
#include <string>

namespace cotwin::master {

/// The member "motion" of a reply as parameters of unit:motion (SSV). Its source must be that in "unit", which is the name of the set.
/// Throws Error for text that is no motion.
std::string motion_file(const std::string& motion);

}  // namespace cotwin::master
