#include "components/services/json/problem_json.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/text.h"

namespace cotwin::services {

using optimisation::CostTerm;
using optimisation::Problem;
using optimisation::Quantity;

const char* unit_of(Quantity q) {
  using Q = Quantity;
  switch (q) {
    case Q::kTime:
      return "time_s";
    case Q::kTorque:
      return "torque_squared_integral";
    case Q::kWork:
      return "work_J";
    case Q::kSharedWork:
      return "shared_work_J";
    case Q::kAcceleration:
      return "acceleration_squared_integral";
    case Q::kJerk:
      return "jerk_squared_integral";
    case Q::kMass:
      return "effective_mass_kg";
    case Q::kSafety:
      return "safety_share";
    case Q::kCycle:
      return "cycle_time_s";
    case Q::kStiffness:
      return "stiffness_N_per_m";
    default:
      return "energy_J";
  }
}

Json costs_json(const Problem& p, const std::vector<double>& costs) {
  Json all = Json::object();
  for (std::size_t i = 0; i < p.costs.size(); ++i) all[unit_of(p.costs[i].quantity)] = costs[i];
  return all;
}

bool has_cost(const Problem& p, Quantity quantity) {
  return std::ranges::any_of(p.costs, [&](const CostTerm& t) { return t.quantity == quantity; });
}

std::pair<std::uint32_t, std::uint64_t> read_draws(Reader& r) {
  const int motions = r.integer("motions", 1, 1000000000, 10000, "that are drawn");
  return {static_cast<std::uint32_t>(motions),
          static_cast<std::uint64_t>(r.integer("seed", 0, 2147483647, 1, "same seed, same motions"))};
}

std::function<void(std::uint32_t)> percent_of(const Context& context, std::uint32_t motions) {
  if (!context.progress) return {};
  constexpr std::uint32_t kMost = 1000000;
  return [&context, motions, step = std::clamp(motions / 100, 1u, kMost), told = 0u](std::uint32_t done) mutable {
    if (done / step == told / step && done < motions) return;
    context.progress(static_cast<double>(done) / motions, std::to_string(done) + " motions");
    told = done;
  };
}

optimisation::DeviceUse read_device(Reader& r, const char* worth) {
  const std::string word = r.word("device", {"auto", "cpu", "gpu"}, worth);
  return word == "auto"  ? optimisation::DeviceUse::kAuto
         : word == "cpu" ? optimisation::DeviceUse::kCpu
                         : optimisation::DeviceUse::kGpu;
}

void tell_device(Json& reply, const std::string& device, double rounding, const std::string& reason) {
  reply["device"] = device.empty() ? "cpu" : device;
  if (!device.empty()) reply["device_rounding"] = rounding;
  if (!reason.empty())
    add_notes(reply, {"device: " + std::string(device.empty() ? "" : "in part ") + "this processor: " + reason});
}

Json forbidden_json(const robot::RobotModel& robot, const std::vector<std::uint32_t>& forbidden, std::uint32_t motions) {
  constexpr const char* kBounds[] = {"q", "dq", "ddq", "dddq", "tau"};
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < forbidden.size(); ++k)
    if (forbidden[k] > 0) order.push_back(k);
  std::ranges::stable_sort(order, std::greater{}, [&](std::size_t k) { return forbidden[k]; });
  Json all = Json::array();
  for (const std::size_t k : order)
    all.push_back({{"bound", kBounds[k / robot.joints.size()]},
                   {"joint", robot.joints[k % robot.joints.size()].name},
                   {"motions", forbidden[k]},
                   {"share", static_cast<double>(forbidden[k]) / motions}});
  return all;
}

Json distribution_json(const optimisation::Distribution& d, Detail detail) {
  constexpr std::size_t kIntervals = 24;
  if (d.count() == 0) return nullptr;
  Json own{{"least", d.least()}, {"mean", d.mean()}, {"most", d.most()}};
  for (const double p : {0.05, 0.25, 0.5, 0.75, 0.95}) own["quantiles"][text::to_text(p)] = d.quantile(p);
  if (detail < Detail::kSeries) return own;
  const auto [edges, counts] = d.intervals(kIntervals);
  own["histogram"] = {{"edges", edges}, {"motions", counts}};
  return own;
}

namespace {

CostTerm term_of(const std::string& name, double weight, const std::string& pointer) {
  using Q = Quantity;
  std::string names;
  for (int i = 0; i <= static_cast<int>(Q::kStiffness); ++i) {
    CostTerm term;
    term.quantity = static_cast<Q>(i);
    if (term.quantity == Q::kPower) continue;  // a function in C++
    if (name == optimisation::to_text(term.quantity)) {
      term.weight = weight;
      return term;
    }
    text::append(names, optimisation::to_text(term.quantity));
  }
  throw RequestError(pointer, "is '" + name.substr(0, 40) + "', expected one of " + names);
}

std::vector<CostTerm> read_costs(Reader& r, const std::vector<CostTerm>& standard, std::string& weight) {
  const auto read = [](Reader& one) { return std::pair(one.text("name"), one.not_negative("weight", 1)); };
  if (r.describes())
    r.declare(
        "cost", {{"type", {"string", "array"}}, {"minItems", 1}, {"items", Reader::schema_of(read)}}, false,
        "time, torque, work, shared_work, acceleration, jerk, energy, effective_mass, safety, cycle_time or stiffness, or "
        "several with weights");
  const Json* given = r.any("cost");
  if (!given) return standard;
  if (given->is_string()) return {term_of(given->get<std::string>(), 1, r.pointer("cost"))};
  if (!given->is_array() || given->empty())
    throw RequestError(r.pointer("cost"), "expected the name of a cost, or an array of {\"name\", \"weight\"}");
  std::vector<CostTerm> terms;
  for (std::size_t i = 0; i < given->size(); ++i) {
    Reader one((*given)[i], r.pointer("cost") + "/" + std::to_string(i));
    const auto [name, factor] = read(one);
    one.finish();
    if (one.gives("weight") && weight.empty()) weight = one.pointer("weight");
    const CostTerm term = term_of(name, factor, one.pointer("name"));
    if (std::ranges::any_of(terms, [&](const CostTerm& t) { return t.quantity == term.quantity; }))
      throw RequestError(one.pointer("name"), "is '" + name + "' again, expected each cost once");
    terms.push_back(term);
  }
  return terms;
}

/// Without the drives' losses the energy is the mechanical work of the joints.
void work_for_energy(Problem& p) {
  if (has_cost(p, Quantity::kWork))
    throw RequestError("/cost",
                       "has energy beside work, but the robot has no energy.ssv beside its URDF, so that both are the same");
  for (CostTerm& term : p.costs)
    if (term.quantity == Quantity::kEnergy) term.quantity = Quantity::kWork;
}

}  // namespace

Problem read_problem(const Robot& robot, const Move& m, Reader& r, const std::vector<CostTerm>& standard, std::string& weight,
                     std::vector<std::string>& notes) {
  Problem p;
  p.robot = robot.model;
  p.ends = m.ends();
  p.loads = m.loads;
  p.degree = r.gives("degree") ? m.degree : 9;
  p.drives = m.drives;
  p.bounds = optimisation::bounds_of(robot.model, m.bounds);
  for (const char* other : {"T_s", "T_min"})
    if (r.gives(other))
      throw RequestError(r.pointer(other),
                         "is no member of " + r.text("service") + ", expected T_min_s, and T_max_s to search the duration");
  if (!r.has("T_min_s") && !r.has("T_max_s"))
    throw RequestError("",
                       "gives no duration, expected T_min_s, or T_max_s as the longest one, or both to search between them");
  p.T_min = r.duration("T_min_s", kBriefest, "shortest one; without it 0.0001 s");
  p.T_max = r.duration("T_max_s", p.T_min, "longest one; without it the duration is T_min_s");
  r.declare_one_of({"T_min_s", "T_max_s"});
  if (p.T_max < p.T_min) throw RequestError("/T_max_s", "is less than T_min_s, expected at least that");
  p.costs = read_costs(r, standard, weight);
  const energetics::Bus bus = read_bus(r, "for the cost energy: DC link shared, split (none), or regenerating (grid)");
  r.only_if(has_cost(p, Quantity::kEnergy) && robot.energy, "bus", "the cost energy and an energy.ssv beside the URDF");
  if (!has_cost(p, Quantity::kEnergy)) return p;
  if (!robot.energy) {
    work_for_energy(p);
    notes.emplace_back("the robot has no energy.ssv beside its URDF: the cost energy is the mechanical work of the joints");
    return p;
  }
  const EnergyData& e = *robot.energy;
  p.electrical = optimisation::Electrical{e.losses, e.current, bus, e.link, e.supply, e.standby};
  return p;
}

}  // namespace cotwin::services
