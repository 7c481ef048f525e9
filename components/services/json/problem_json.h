#pragma once
#include <string>
#include <vector>

#include "components/services/json/move_json.h"

namespace cotwin::services {

/// The name of a cost in replies, with its unit: "energy_J".
const char* unit_of(optimisation::Quantity quantity);
/// {"time_s": …} of the problem's costs.
Json costs_json(const optimisation::Problem& problem, const std::vector<double>& costs);
bool has_cost(const optimisation::Problem& problem, optimisation::Quantity quantity);

/// The problem of a move whose redundant coefficients and duration are free, with the members "T_min_s", "T_max_s", "cost" (without it
/// `standard`) and "bus". `weight` becomes the place of the first weight of a cost, if one is given.
optimisation::Problem read_problem(const Robot& robot, const Move& move, Reader& r,
                                   const std::vector<optimisation::CostTerm>& standard, std::string& weight,
                                   std::vector<std::string>& notes);

}  // namespace cotwin::services
