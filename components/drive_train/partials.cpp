#include "components/drive_train/partials.h"

#include <algorithm>

#include "components/drive_train/ldlt.h"

namespace cotwin::drive_train {

namespace {

bool is_scalar(std::string_view unknown) { return unknown.rfind("energy_", 0) == 0 || unknown.rfind("power_", 0) == 0; }

}  // namespace

Partials::Partials(const Equations& e) : n_(e.n()), x_(e.size()), point_(n_), ddq_(n_), column_(n_) {
  for (auto* v : {&factors_, &by_q_, &by_dq_, &load_by_q_, &scratch_}) v->resize(n_ * n_);
  const auto add = [this](const char* unknown, std::initializer_list<const char*> knowns, bool elementwise) {
    for (const char* known : knowns) list_.push_back({unknown, known, elementwise});
  };
  const bool held = e.friction() == Friction::kCoulomb;  // friction of a sticking motor follows from (2b)
  if (e.inside()) {
    for (const char* state : {"q", "dq"}) add(state, {state}, true);
    if (e.flexible()) {
      for (const char* state : {"theta", "dtheta"}) add(state, {state}, true);
      add("ddq", {"tau_e", "load_torque", "q", "dq", "theta", "dtheta"}, false);
    } else {
      add("theta", {"q"}, true);
      add("dtheta", {"dq"}, true);
      add("ddq", {"tau_m", "tau_e", "load_torque", "q", "dq", "z"}, false);
      add("tau_J", {"tau_m", "tau_e", "load_torque", "q", "dq", "z"}, false);
      add("tau_f", {"dq", "z"}, true);
    }
  } else {
    for (const char* state : {"theta", "dtheta"}) add(state, {state}, true);
  }
  if (e.flexible()) {
    add("tau_J", {"q", "dq", "theta", "dtheta"}, true);
    if (held) {
      add("tau_f", {"tau_m", "q", "dq", "theta", "dtheta"}, true);
    } else {
      add("tau_f", {"dtheta", "z"}, true);
    }
  }
  if (e.inside()) {
    add("energy_kinetic", {"q", "dq"}, false);
    add("energy_potential", {"q"}, false);
  }
  if (e.flexible()) add("energy_kinetic", {"dtheta"}, false);
  add("energy_elastic", {"z"}, false);
  if (e.flexible()) {
    add("energy_elastic", {"q", "theta"}, false);
  } else {
    add("energy_elastic", {"q"}, false);
  }
  add("power_m", {"tau_m"}, false);
  add("power_m", {e.flexible() ? "dtheta" : "dq"}, false);
  add("power_e", {"dq"}, false);
  if (e.inside()) {
    add("power_e", {"tau_e"}, false);
  } else {
    add("power_e", {"q", "theta", "dtheta"}, false);
  }
}

std::size_t Partials::size_of(const Partial& p) const { return p.elementwise || is_scalar(p.unknown) ? n_ : n_ * n_; }

Partials::Block Partials::block(std::span<double> values, std::string_view unknown, std::string_view known) const {
  double* at = values.data();
  for (const Partial& p : list_) {
    if (unknown == p.unknown && known == p.known) return {at, p.elementwise ? 0 : n_};
    at += size_of(p);
  }
  return {};
}

void Partials::evaluate(Equations& e, std::span<const double> tau_m, std::span<const double> tau_e,
                        std::span<const double> tau_load, std::span<double> values) {
  std::fill(values.begin(), values.end(), 0.0);
  e.evaluate(x_.data(), point_);
  for (const char* state : {"q", "dq", "theta", "dtheta"}) {
    const Block same = block(values, state, state);
    for (std::size_t i = 0; i < n_; ++i) same.add(i, i, 1);
  }
  if (!e.flexible()) {  // θ = q
    const Block theta = block(values, "theta", "q"), dtheta = block(values, "dtheta", "dq");
    for (std::size_t i = 0; i < n_; ++i) {
      theta.add(i, i, 1);
      dtheta.add(i, i, 1);
    }
  }
  if (e.inside()) accelerations(e, tau_m, tau_e, tau_load, values);
  torques(e, values);
  energies(e, values);
  powers(e, tau_m, tau_e, values);
}

void Partials::accelerations(Equations& e, std::span<const double> tau_m, std::span<const double> tau_e,
                             std::span<const double> tau_load, std::span<double> values) {
  const Point& p = point_;
  factors_ = p.M;
  ldlt(factors_.data(), n_);
  for (std::size_t i = 0; i < n_; ++i) {
    ddq_[i] = e.link_balance(p, i, tau_e[i] + tau_load[i], e.passive(i) ? 0 : tau_m[i], p.h[i]);  // (2a)
  }
  solve_ldlt(factors_.data(), n_, ddq_.data());
  e.inverse_dynamics_derivatives(x_.data(), ddq_.data(), by_q_.data(), by_dq_.data());

  if (e.has_load()) e.load_derivatives(x_.data(), p, load_by_q_.data(), scratch_.data());
  const Parameters& k = e.parameters();
  const char* knowns[] = {"tau_e", "tau_m", "q", "dq", "theta", "dtheta", "z", "load_torque"};
  for (std::size_t c = 0; c < std::size(knowns); ++c) {
    const Block ddq = block(values, "ddq", knowns[c]), tau_J = block(values, "tau_J", knowns[c]);
    if (ddq.values == nullptr) continue;
    for (std::size_t j = 0; j < n_; ++j) {
      // the torque on the links per unit of known j
      std::fill(column_.begin(), column_.end(), 0.0);
      const double w = e.flexible() ? k.D[j] : p.f_w[j];  // damping of q̇ at the gear
      switch (c) {
        case 0:
          column_[j] = 1;
          break;
        case 1:
          column_[j] = e.passive(j) ? 0 : 1;
          break;
        case 2:
          for (std::size_t i = 0; i < n_; ++i) column_[i] = -by_q_[j * n_ + i];
          column_[j] -= p.k_l[j] + (e.flexible() ? p.kappa[j] : 0);
          for (std::size_t i = 0; i < n_ && e.has_load(); ++i) column_[i] -= load_by_q_[j * n_ + i];
          break;
        case 3:
          for (std::size_t i = 0; i < n_; ++i) column_[i] = -by_dq_[j * n_ + i];
          column_[j] -= p.d_l[j] + w;
          break;
        case 4:
          column_[j] = p.kappa[j];
          break;
        case 5:
          column_[j] = k.D[j];
          break;
        case 6:
          column_[j] = -p.f_z[j];
          break;
        default:
          column_[j] = 1;
      }
      solve_ldlt(factors_.data(), n_, column_.data());
      for (std::size_t i = 0; i < n_; ++i) {
        ddq.add(i, j, column_[i]);
        if (!e.flexible()) tau_J.add(i, j, -k.B[i] * column_[i]);  // (2b): τ_J = τ_m − τ_f − B q̈
      }
    }
  }
}

void Partials::torques(const Equations& e, std::span<double> values) const {
  const Point& p = point_;
  const Parameters& k = e.parameters();
  const auto add = [&](const char* unknown, const char* known, std::size_t i, double value) {
    block(values, unknown, known).add(i, i, value);
  };
  for (std::size_t i = 0; i < n_; ++i) {
    if (e.passive(i)) continue;
    if (!e.flexible()) {
      add("tau_f", "dq", i, p.f_w[i]);
      add("tau_f", "z", i, p.f_z[i]);
      add("tau_J", "tau_m", i, 1);
      add("tau_J", "dq", i, -p.f_w[i]);
      add("tau_J", "z", i, -p.f_z[i]);
      continue;
    }
    const double sign = e.stuck(i) ? -1 : 0;  // of τ_J in τ_f
    const struct {
      const char* known;
      double slope;
    } of_tau_J[] = {{"theta", p.kappa[i]}, {"q", -p.kappa[i]}, {"dtheta", k.D[i]}, {"dq", -k.D[i]}};  // (2c)
    for (const auto& [known, slope] : of_tau_J) {
      add("tau_J", known, i, slope);
      add("tau_f", known, i, sign * slope);
    }
    if (e.stuck(i)) {
      add("tau_f", "tau_m", i, 1);
    } else {
      add("tau_f", "dtheta", i, p.f_w[i]);
      add("tau_f", "z", i, p.f_z[i]);
    }
  }
}

void Partials::energies(Equations& e, std::span<double> values) {
  const double *q = x_.data(), *dq = q + n_, *theta = q + 2 * n_, *dtheta = q + 3 * n_, *z = q + 4 * n_;
  const Parameters& k = e.parameters();
  const Block potential = block(values, "energy_potential", "q"), by_q = block(values, "energy_kinetic", "q");
  const Block by_dq = block(values, "energy_kinetic", "dq"), by_dtheta = block(values, "energy_kinetic", "dtheta");
  if (e.inside()) {
    double *kinetic_by_q = by_q_.data(), *potential_by_q = by_dq_.data();
    e.energy_gradients(x_.data(), kinetic_by_q, potential_by_q);
    e.times_M(point_.M.data(), dq, column_.data());  // M of a rigid transmission has B inside
    for (std::size_t i = 0; i < n_; ++i) {
      for (std::size_t j = 0; j < n_; ++j) column_[i] -= e.load()[j * n_ + i] * dq[j];
      potential.add(0, i, potential_by_q[i]);
      by_q.add(0, i, kinetic_by_q[i]);
      by_dq.add(0, i, column_[i]);
    }
  }
  const Block elastic_q = block(values, "energy_elastic", "q"), elastic_theta = block(values, "energy_elastic", "theta");
  const Block elastic_z = block(values, "energy_elastic", "z");
  for (std::size_t i = 0; i < n_; ++i) {
    by_dtheta.add(0, i, k.B[i] * dtheta[i]);
    elastic_z.add(0, i, k.sigma0[i] * z[i]);
    elastic_q.add(0, i, e.modes().stop[i] * e.stop_spring(i, q[i]) + e.link_side(i).spring.at(q[i]).torque);
    if (!e.flexible()) continue;
    const double spring = e.torsion(i).at(theta[i] - q[i]).torque;
    elastic_q.add(0, i, -spring);
    elastic_theta.add(0, i, spring);
  }
}

void Partials::powers(const Equations& e, std::span<const double> tau_m, std::span<const double> tau_e,
                      std::span<double> values) const {
  const double *dq = x_.data() + n_, *dtheta = x_.data() + 3 * n_;
  const Parameters& k = e.parameters();
  const char* speed = e.flexible() ? "dtheta" : "dq";
  const Block m_by_tau = block(values, "power_m", "tau_m"), m_by_speed = block(values, "power_m", speed);
  const Block by_q = block(values, "power_e", "q"), by_dq = block(values, "power_e", "dq");
  const Block by_theta = block(values, "power_e", "theta"), by_dtheta = block(values, "power_e", "dtheta");
  const Block by_tau_e = block(values, "power_e", "tau_e");
  for (std::size_t i = 0; i < n_; ++i) {
    if (!e.passive(i)) {
      m_by_tau.add(0, i, e.flexible() ? dtheta[i] : dq[i]);
      m_by_speed.add(0, i, tau_m[i]);
    }
    if (e.inside()) {
      by_tau_e.add(0, i, dq[i]);
      by_dq.add(0, i, tau_e[i]);
    } else {  // −τ_J q̇
      by_q.add(0, i, point_.kappa[i] * dq[i]);
      by_dq.add(0, i, k.D[i] * dq[i] - point_.tau_J[i]);
      by_theta.add(0, i, -point_.kappa[i] * dq[i]);
      by_dtheta.add(0, i, -k.D[i] * dq[i]);
    }
  }
}

}  // namespace cotwin::drive_train
