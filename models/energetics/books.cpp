#include "models/energetics/books.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::energetics {
namespace {

double sum(const std::vector<double>& x) { return std::accumulate(x.begin(), x.end(), 0.0); }

double gauss(const std::array<double, kNodes>& values) {
  double s = 0;
  for (std::size_t k = 0; k < kNodes; ++k) s += kWeight[k] * values[k];
  return s;
}

}  // namespace

EnergyBooks::EnergyBooks(std::size_t joints)
    : mechanical_positive(joints), mechanical_negative(joints), copper(joints), converter(joints), iron(joints) {}

void EnergyBooks::clear() {
  for (auto* v : {&mechanical_positive, &mechanical_negative, &copper, &converter, &iron}) std::ranges::fill(*v, 0.0);
  time = idle = regenerable = stored = supply_losses = controller = drawn = peak_power = 0;
  link = {};
}

double EnergyBooks::mechanical() const { return sum(mechanical_positive) + sum(mechanical_negative); }

double EnergyBooks::residual() const {
  return drawn -
         (mechanical() + sum(copper) + sum(converter) + sum(iron) + idle + stored + link.chopped + supply_losses + controller);
}

Accountant::Accountant(std::size_t joints, Bus bus)
    : losses(joints), tau(kNodes * joints), speed(kNodes * joints), i(kNodes * joints), n_(joints), bus_(bus), r_(joints) {
  adopt();
}

void Accountant::check(const std::string& place) const {
  check_values(losses, kDriveLosses, place);
  const auto fail = [&](const char* name, double value, const char* expected) {
    throw Error(place + "." + name, "is " + text::to_text(value) + ", expected " + expected);
  };
  if (!(link.C >= 0 && std::isfinite(link.C))) fail("C", link.C, "a finite value >= 0");
  if (!(link.V_min > 0 && std::isfinite(link.V_min))) fail("V_min", link.V_min, "a finite value > 0");
  if (!(link.V_max >= link.V_min && std::isfinite(link.V_max))) fail("V_max", link.V_max, "a finite value, at least V_min");
  if (!(supply.efficiency > 0 && supply.efficiency <= 1)) fail("efficiency", supply.efficiency, "a value above 0, up to 1");
  if (!(supply.eta_r >= 0 && supply.eta_r <= 1)) fail("eta_r", supply.eta_r, "0 to 1");
}

void Accountant::adopt() {
  for (std::size_t j = 0; j < n_; ++j) r_[j] = copper_factor(current) * losses.R[j];
}

void Accountant::currents_from_torques() {
  for (std::size_t k = 0; k < kNodes; ++k)
    for (std::size_t j = 0; j < n_; ++j) i[k * n_ + j] = tau[k * n_ + j] / losses.k_t[j];
}

void Accountant::add(double h, bool energised, double idle, double extra, double controller, double& V,
                     EnergyBooks& books) const {
  std::array<double, kNodes> bus{};
  LinkFlows flows;
  for (std::size_t j = 0; j < n_; ++j) {
    std::array<double, kNodes> mech, copper, converter, iron, all;
    for (std::size_t k = 0; k < kNodes; ++k) {
      const double w = speed[k * n_ + j], a = energised ? i[k * n_ + j] : 0;
      mech[k] = tau[k * n_ + j] * w;
      copper[k] = r_[j] * a * a;
      converter[k] = losses.V_0[j] * std::abs(a);
      iron[k] = losses.k_h[j] * std::abs(w) + losses.k_e[j] * w * w;
      all[k] = mech[k] + copper[k] + converter[k] + iron[k];
      bus[k] += all[k];
    }
    const Parts work = parts(through(mech));
    books.mechanical_positive[j] += h * work.positive;
    books.mechanical_negative[j] += h * work.negative;
    books.copper[j] += h * gauss(copper);
    books.converter[j] += h * gauss(converter);
    books.iron[j] += h * gauss(iron);
    if (bus_ != Bus::kSeparate) continue;
    const Parts taken = parts(through(all));
    flows.supplied += h * taken.positive;
    flows.chopped -= h * taken.negative;
  }
  // Work that the nodes do not show counts as done evenly over the interval, by the first joint that does any.
  if (extra != 0 && n_ > 0) (extra > 0 ? books.mechanical_positive : books.mechanical_negative)[0] += extra;
  const double more = idle + extra / h;
  const double V_before = V;
  Cubic p = through(bus);
  p[0] += extra / h;
  books.regenerable -= h * parts(p).negative;
  p[0] += idle;
  for (const double power : bus) books.peak_power = std::max(books.peak_power, power + more);
  if (bus_ == Bus::kSeparate) {
    flows.supplied += h * idle;
    (extra > 0 ? flows.supplied : flows.chopped) += std::abs(extra);
  } else if (bus_ == Bus::kShared) {
    V = draw(link, V, p, h, flows);
  } else {
    const Parts exchanged = parts(p);
    flows.supplied += h * exchanged.positive;
    flows.returned -= h * exchanged.negative;
  }
  const double lost = flows.supplied * (1 / supply.efficiency - 1) + flows.returned * (1 - supply.eta_r);
  books.time += h;
  books.idle += h * idle;
  books.link.supplied += flows.supplied;
  books.link.returned += flows.returned;
  books.link.chopped += flows.chopped;
  if (bus_ == Bus::kShared) books.stored += link.stored(V) - link.stored(V_before);
  books.supply_losses += lost;
  books.controller += h * controller;
  books.drawn += flows.supplied / supply.efficiency - supply.eta_r * flows.returned + h * controller;
}

double Accountant::holding_power(std::span<const double> tau_m) const {
  double power = 0;
  for (std::size_t j = 0; j < n_; ++j) {
    const double a = tau_m[j] / losses.k_t[j];
    power += r_[j] * a * a + losses.V_0[j] * std::abs(a);
  }
  return power;
}

}  // namespace cotwin::energetics
