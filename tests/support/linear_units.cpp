#include "tests/support/linear_units.h"

#include <cmath>
#include <numbers>
#include <unsupported/Eigen/MatrixFunctions>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::testing {

LinearUnit::LinearUnit(LinearSystem system, LinearOptions options)
    : system_(std::move(system)), options_(options), x0_(system_.x0), x_(x0_) {
  const auto n = x0_.size();
  const auto inputs = static_cast<Eigen::Index>(system_.inputs.size());
  const auto outputs = static_cast<Eigen::Index>(system_.outputs.size());
  const auto expect = [](const char* name, const Eigen::MatrixXd& m, Eigen::Index rows, Eigen::Index columns) {
    if (m.rows() == rows && m.cols() == columns) return;
    throw Error(name, "is " + std::to_string(m.rows()) + " x " + std::to_string(m.cols()) + ", expected " +
                          std::to_string(rows) + " x " + std::to_string(columns));
  };
  expect("A", system_.A, n, n);
  expect("B", system_.B, n, inputs);
  expect("C", system_.C, outputs, n);
  expect("D", system_.D, outputs, inputs);
  x_next_.setZero(n);
  u_.setZero(inputs);
  du_.setZero(inputs);
  u_end_.setZero(inputs);
  y_.setZero(outputs);
  if (!options_.partials) return;
  for (Eigen::Index i = 0; i < outputs; ++i) {
    const char* y = system_.outputs[static_cast<std::size_t>(i)].name.c_str();
    for (Eigen::Index j = 0; j < inputs; ++j) {
      if (system_.D(i, j) != 0) partials_.push_back({y, system_.inputs[static_cast<std::size_t>(j)].name.c_str()});
    }
    if (!system_.C.row(i).isZero(0)) partials_.push_back({y, "x"});
  }
}

void LinearUnit::declare(Variables& v) {
  for (std::size_t i = 0; i < system_.inputs.size(); ++i) {
    const LinearPort& port = system_.inputs[i];
    const auto k = static_cast<Eigen::Index>(i);
    auto declared = v.input(port.name, u_[k], port.si, port.description);
    if (!options_.held) declared.rate(du_[k]);
  }
  for (std::size_t i = 0; i < system_.outputs.size(); ++i) {
    const LinearPort& port = system_.outputs[i];
    auto declared = v.output(port.name, y_[static_cast<Eigen::Index>(i)], port.si, port.description);
    if (!port.derivative_of.empty()) declared.derivative_of(port.derivative_of);
  }
  if (x_.size() == 0) return;
  v.parameter("x0", x0_, "1", "x at the start");
  v.state("x", x_, "1", "state of the equations");
}

void LinearUnit::initialise(Time) {
  x_ = x0_;
  output(0);
}

StepResult LinearUnit::step(Time, Duration h) {
  ++steps_;
  const Propagator& p = propagator(h);
  // lazyProduct: coefficient by coefficient, the fastest for these sizes, and without temporary vectors.
  x_next_ = p.Phi.lazyProduct(x_) + p.G.lazyProduct(u_);
  if (!options_.held) x_next_ += p.G_rate.lazyProduct(du_);
  x_ = x_next_;
  output(options_.held ? 0 : h.seconds());
  return StepResult::kDone;
}

/// y for the present x and the inputs s seconds after the beginning of the step.
void LinearUnit::output(double s) {
  u_end_ = u_ + s * du_;
  y_ = system_.C.lazyProduct(x_) + system_.D.lazyProduct(u_end_);
}

void LinearUnit::evaluate_partials(std::span<double> values) {
  std::size_t next = 0;
  for (Eigen::Index i = 0; i < y_.size(); ++i) {
    for (Eigen::Index j = 0; j < u_.size(); ++j) {
      if (system_.D(i, j) != 0) values[next++] = system_.D(i, j);
    }
    if (system_.C.row(i).isZero(0)) continue;
    for (Eigen::Index j = 0; j < x_.size(); ++j) values[next++] = system_.C(i, j);
  }
}

const LinearUnit::Propagator& LinearUnit::propagator(Duration h) {
  for (const Propagator& known : cache_) {
    if (known.ns == h.ns) return known;
  }
  // With z = [x; u; u̇]: ż = [A B 0; 0 0 1; 0 0 0] z, of which the exponential has Phi, G and G_rate in its first rows.
  const Eigen::Index n = x_.size(), m = u_.size();
  Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(n + 2 * m, n + 2 * m);
  Z.topLeftCorner(n, n) = system_.A;
  Z.block(0, n, n, m) = system_.B;
  Z.block(n, n + m, m, m).setIdentity();
  const Eigen::MatrixXd E = (Z * h.seconds()).exp();
  Propagator& entry = cache_[oldest_];
  oldest_ = (oldest_ + 1) % cache_.size();
  entry.ns = h.ns;
  entry.Phi = E.topLeftCorner(n, n);
  entry.G = E.block(0, n, n, m);
  entry.G_rate = E.block(0, n + m, n, m);
  return entry;
}

namespace {

/// y(t) of a function of time, with the declared derivative if `derivatives`.
class Source : public Unit {
 public:
  explicit Source(bool derivatives) : derivatives_(derivatives) {}
  void initialise(Time start) override { at(start); }
  StepResult step(Time now, Duration h) override {
    at(now + h);
    return StepResult::kDone;
  }

 protected:
  void declare_outputs(Variables& v, const std::string& si, const std::string& rate_si, const std::string& description) {
    v.output("y", y_, si, description);
    if (derivatives_) v.output("dy", dy_, rate_si, "derivative of y").derivative_of("y");
  }
  virtual void at(Time t) = 0;
  double y_ = 0, dy_ = 0;

 private:
  bool derivatives_;
};

class Clock final : public Source {
 public:
  using Source::Source;
  void declare(Variables& v) override { declare_outputs(v, "s", "1", "time"); }

 private:
  void at(Time t) override {
    y_ = t.seconds();
    dy_ = 1;
  }
};

class Cosine final : public Source {
 public:
  using Source::Source;
  void declare(Variables& v) override {
    declare_outputs(v, "1", "1/s", "cos(2 pi t / T)");
    v.parameter("T", T_, "s", "period");
  }

 private:
  void at(Time t) override {
    const double omega = 2 * std::numbers::pi / T_;
    y_ = std::cos(omega * t.seconds());
    dy_ = -omega * std::sin(omega * t.seconds());
  }
  double T_ = 1;
};

class Jump final : public Source {
 public:
  Jump() : Source(false) {}
  void declare(Variables& v) override {
    declare_outputs(v, "1", "1/s", "0 before t0, 1 from then on");
    v.parameter("t0", t0_, "s", "time of the jump");
  }

 private:
  void at(Time t) override { y_ = t >= Time::from_seconds(t0_) ? 1 : 0; }
  double t0_ = 1;
};

double number(Settings& settings, const std::string& key) {
  const std::string text = settings.text(key);
  const auto value = text::parse_real(text);
  if (!value) throw Error(key, "'" + text + "', expected a number");
  return *value;
}

void linear_settings(SettingList& s) {
  s.boolean("held", false, "inputs are constant over a step");
  s.boolean("partials", false, "the unit has an analytic Jacobian");
}
void body_settings(SettingList& s) {
  linear_settings(s);
  s.boolean("derivatives", false, "speeds are declared as derivatives of positions");
}
void source_settings(SettingList& s) { s.boolean("derivatives", false, "dy is declared as derivative of y"); }

std::unique_ptr<Unit> make_linear(LinearSystem system, Settings& s) {
  return std::make_unique<LinearUnit>(std::move(system), LinearOptions{s.boolean("held"), s.boolean("partials")});
}

/// One state, input and output: ẋ = a x + b u, y = c x.
LinearSystem first_order(double a, double b, double c, double x0, LinearPort input, LinearPort output) {
  const auto scalar = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  return {scalar(a),          scalar(b),          scalar(c), scalar(0), Eigen::VectorXd::Constant(1, x0),
          {std::move(input)}, {std::move(output)}};
}

const LinearPort kForce{"F", "N", "force between the two sides", ""};

std::unique_ptr<Unit> make_side_1(const TwoBodies& b, Settings& s) {
  LinearSystem system;
  system.A = Eigen::Matrix2d{{0, 1}, {-b.c1 / b.m1, -b.d1 / b.m1}};
  system.B = Eigen::Vector2d{0, 1 / b.m1};
  system.C = Eigen::Matrix2d::Identity();
  system.D = Eigen::Vector2d::Zero();
  system.x0 = Eigen::Vector2d{b.x1, b.v1};
  system.inputs = {kForce};
  system.outputs = {{"x1", "m", "position of body 1", ""},
                    {"v1", "m/s", "speed of body 1", s.boolean("derivatives") ? "x1" : ""}};
  return make_linear(std::move(system), s);
}

std::unique_ptr<Unit> make_side_2(const TwoBodies& b, Settings& s) {
  LinearSystem system;
  system.A = Eigen::Matrix2d{{0, 1}, {-(b.c2 + b.ck) / b.m2, -(b.d2 + b.dk) / b.m2}};
  system.B = Eigen::Matrix2d{{0, 0}, {b.ck / b.m2, b.dk / b.m2}};
  system.C = Eigen::Matrix<double, 3, 2>{{b.ck, b.dk}, {1, 0}, {0, 1}};
  system.D = Eigen::Matrix<double, 3, 2>{{-b.ck, -b.dk}, {0, 0}, {0, 0}};
  system.x0 = Eigen::Vector2d{b.x2, b.v2};
  system.inputs = {{"x1", "m", "position of body 1", ""}, {"v1", "m/s", "speed of body 1", ""}};
  system.outputs = {
      kForce, {"x2", "m", "position of body 2", ""}, {"v2", "m/s", "speed of body 2", s.boolean("derivatives") ? "x2" : ""}};
  return make_linear(std::move(system), s);
}

}  // namespace

std::span<const UnitType> linear_types() {
  static const UnitType kTypes[] = {
      {"lc_mass", "m dv/dt = -F",
       [](Settings& s) {
         return make_linear(first_order(0, -1 / number(s, "m"), 1, 1, kForce, {"v", "m/s", "speed of the mass", ""}), s);
       },
       [](SettingList& s) {
         linear_settings(s);
         s.text("m", "1", "mass, kg");
       }},
      {"lc_spring", "F = k x, dx/dt = v",
       [](Settings& s) {
         return make_linear(first_order(0, 1, number(s, "k"), 0, {"v", "m/s", "speed of the spring's end", ""}, kForce), s);
       },
       [](SettingList& s) {
         linear_settings(s);
         s.text("k", "100", "stiffness, N/m");
       }},
      {"two_mass_1", "side 1 of the two-mass oscillator", [](Settings& s) { return make_side_1(two_masses(), s); },
       body_settings},
      {"two_mass_2", "side 2 of the two-mass oscillator", [](Settings& s) { return make_side_2(two_masses(), s); },
       body_settings},
      {"contact_1", "a damped body", [](Settings& s) { return make_side_1(contact(0), s); }, body_settings},
      {"contact_2", "a light body on a stiff spring, and the contact",
       [](Settings& s) { return make_side_2(contact(number(s, "kc")), s); },
       [](SettingList& s) {
         body_settings(s);
         s.text("kc", "1e6", "contact stiffness, N/m");
       }},
      {"lag", "T dy/dt = u - y",
       [](Settings& s) {
         const double T = number(s, "T");
         return make_linear(first_order(-1 / T, 1 / T, 1, 0, {"u", "1", "what y follows", ""}, {"y", "1", "delayed input", ""}),
                            s);
       },
       [](SettingList& s) {
         linear_settings(s);
         s.text("T", "1", "time constant, s");
       }},
      {"clock", "y = t", [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Clock>(s.boolean("derivatives")); },
       source_settings},
      {"cosine", "y = cos(2 pi t / T)",
       [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Cosine>(s.boolean("derivatives")); },
       source_settings},
      {"jump", "y = 0, then 1", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Jump>(); }},
  };
  return kTypes;
}

TwoBodies two_masses() {
  TwoBodies b;
  b.m1 = 1, b.c1 = 10, b.d1 = 0.1;
  b.m2 = 2, b.c2 = 20, b.d2 = 0.1;
  b.ck = 100, b.dk = 1;
  b.x1 = 1;
  return b;
}

TwoBodies contact(double kc) {
  TwoBodies b;
  b.m1 = 5, b.d1 = 20;
  b.m2 = 0.5, b.c2 = 1e5, b.d2 = 10;
  b.ck = kc, b.dk = 50;
  b.v1 = 0.1;
  return b;
}

Eigen::Vector4d coupled_reference(const TwoBodies& bodies, double t) {
  const auto& [m1, c1, d1, m2, c2, d2, ck, dk, x1, v1, x2, v2] = bodies;
  // M ẍ = −K x − R ẋ, x = [x1; x2]
  const Eigen::Matrix2d M{{m1, 0}, {0, m2}};
  const Eigen::Matrix2d K{{c1 + ck, -ck}, {-ck, c2 + ck}};
  const Eigen::Matrix2d R{{d1 + dk, -dk}, {-dk, d2 + dk}};
  Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
  A.topRightCorner<2, 2>().setIdentity();
  A.bottomLeftCorner<2, 2>() = -M.inverse() * K;
  A.bottomRightCorner<2, 2>() = -M.inverse() * R;
  const Eigen::Matrix4d E = (A * t).exp();
  const Eigen::Vector4d z = E * Eigen::Vector4d{x1, x2, v1, v2};
  return {z[0], z[2], z[1], z[3]};
}

}  // namespace cotwin::testing
