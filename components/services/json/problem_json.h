#pragma once
#include <string>
#include <vector>

#include "components/services/json/move_json.h"
#include "models/optimisation/growth/growth.h"

namespace cotwin::services {

/// The name of a cost in replies, with its unit: "energy_J".
const char* unit_of(optimisation::Quantity quantity);
/// {"time_s": …} of the problem's costs.
Json costs_json(const optimisation::Problem& problem, const std::vector<double>& costs);
bool has_cost(const optimisation::Problem& problem, optimisation::Quantity quantity);

/// The members "motions" and "seed" of grow.
std::pair<std::uint32_t, std::uint64_t> read_draws(Reader& r);
/// Tells progress in steps of one percent, and of at most a million motions, if the context wants it.
std::function<void(std::uint32_t done)> percent_of(const Context& context, std::uint32_t motions);
/// The member "device": which processor judges motions. `worth`: from how many on a GPU is worth its opening.
optimisation::DeviceUse read_device(Reader& r, const char* worth);
/// Tells which one did, by its name, how much a GPU differs from this processor, and why this processor did in its place.
void tell_device(Json& reply, const std::string& device, double rounding, const std::string& reason);
/// [{"joint", "bound", "motions", "share"}] of optimisation::Harvest::forbidden, or of its first bound alone, most frequent first.
Json forbidden_json(const robot::RobotModel& robot, const std::vector<std::uint32_t>& forbidden, std::uint32_t motions);
/// {"least", "mean", "most", "quantiles", "histogram"}, the last from the detail series on; null without values.
Json distribution_json(const optimisation::Distribution& distribution, Detail detail);

/// The problem of a move whose redundant coefficients and duration are free, with the members "T_min_s", "T_max_s", "cost" (without it
/// `standard`) and "bus". `weight` becomes the place of the first weight of a cost, if one is given.
optimisation::Problem read_problem(const Robot& robot, const Move& move, Reader& r,
                                   const std::vector<optimisation::CostTerm>& standard, std::string& weight,
                                   std::vector<std::string>& notes);

}  // namespace cotwin::services
