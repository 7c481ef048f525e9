#include "components/services/contact_service.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <tuple>

#include "components/services/extremes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

constexpr double kResting = 1e-9;  // m/s; below, a velocity has no direction

/// Mass and speed of the frame at any time of a move.
class Along {
 public:
  Along(const robot::RobotModel& robot, const Move& move, const ContactOptions& o)
      : u_(o.u),
        dynamics_(robot, move.loads),
        scratch_(dynamics_),
        frame_(robot::on_body(o.frame.empty() ? robot.end_effector() : robot.frame(o.frame))),
        B_(o.motors_held ? o.B : std::vector<double>{}),
        load_(o.load),
        f_(static_cast<int>(robot.joints.size())),
        q_(robot.n()),
        dq_(robot.n()),
        ddq_(robot.n()),
        dddq_(robot.n()) {
    if (o.samples < 2 || o.samples > 1000000)
      throw Error("effective mass", std::to_string(o.samples) + " samples, expected 2 to 1000000");
    if (o.u && !(o.u->norm() > 1e-150 && o.u->allFinite()))
      throw Error("direction", "has no length, expected a finite one above 0");
    if (o.motors_held && o.B.size() != robot.joints.size())
      throw Error("motors", "are held, but the robot has no inertias of motors, expected a drive_train.ssv");
    const optimisation::Solution s = plan(robot, move).solution;
    if (move.searched() && s.status != optimisation::Status::kFeasible)
      throw Error("move", "no duration can be given (" + s.reason + "), expected T or other bounds");
    path_ = s.path;
    T = s.T;
  }
  /// Of the motion at the time t.
  double share(double t) const { return (t - path_.begin()) / T; }

  struct Sample : MassAt {
    double inertia = 0;
    bool counts = false;  // for masses along the motion: the frame moves
  };
  Sample at(double t) {
    path_.at(t, span(q_), span(dq_), span(ddq_), span(dddq_));
    robot::frame_inertia(dynamics_.mechanism(share(t)), scratch_.data, q_,
                         Eigen::Map<const Eigen::VectorXd>(B_.data(), static_cast<Eigen::Index>(B_.size())), frame_, f_);
    const Eigen::Vector3d v = f_.J.topRows<3>() * dq_;
    const bool moves = v.norm() > kResting;
    // At rest along the acceleration, into which the velocity turns, and where that is 0 up to rounding along the jerk: J times them at the ends.
    constexpr double kRounding = 1e-6;
    const Eigen::Vector3d a = f_.J.topRows<3>() * ddq_, jerk = f_.J.topRows<3>() * dddq_;
    const Eigen::Vector3d towards = moves ? v : a.norm() > kRounding * T * jerk.norm() ? a : jerk;
    const Eigen::Vector3d u = u_                   ? u_->stableNormalized()
                              : towards.norm() > 0 ? Eigen::Vector3d(towards.stableNormalized())
                                                   : Eigen::Vector3d::UnitX();
    Sample s;
    s.t = t;
    s.mass = robot::effective_mass(f_, u, load_);
    s.speed = u.dot(v);
    s.inertia = robot::effective_inertia(f_, u);
    s.counts = u_.has_value() || moves;
    return s;
  }

  /// On a grid that does not depend on the samples of the series.
  template <class Value>
  Sample largest(const std::vector<Sample>& grid, Value value) {
    return services::largest(
        grid, [this](double t) { return at(t); }, value);
  }

  std::vector<Sample> grid() {
    const std::size_t intervals = std::max<std::size_t>(1000, 2 * path_.times().size());
    std::vector<Sample> all;
    for (std::size_t i = 0; i <= intervals; ++i)
      all.push_back(at(path_.begin() + T * static_cast<double>(i) / static_cast<double>(intervals)));
    if (std::ranges::none_of(all, &Sample::counts))
      for (Sample& s : all) s.counts = true;
    return all;
  }

  PathMasses masses(const std::vector<Sample>& grid, std::size_t samples) {
    constexpr double kNever = -std::numeric_limits<double>::infinity();
    const bool all = grid.front().counts && grid.back().counts;
    PathMasses m;
    m.T = T;
    m.start = grid.front();
    m.end = grid.back();
    m.lightest = largest(grid, [&](const Sample& s) { return all || s.counts ? -s.mass : kNever; });
    m.heaviest = largest(grid, [&](const Sample& s) { return all || s.counts ? s.mass : kNever; });
    m.fastest = largest(grid, [](const Sample& s) { return std::abs(s.speed); });
    for (std::size_t i = 0; i < samples; ++i) {
      const Sample s = at(path_.begin() + T * static_cast<double>(i) / static_cast<double>(samples - 1));
      m.t.push_back(s.t);
      m.mass.push_back(s.mass);
      m.inertia.push_back(s.inertia);
      m.speed.push_back(s.speed);
    }
    return m;
  }

  double T = 0;  // s

 private:
  static std::span<double> span(Eigen::VectorXd& x) { return {x.data(), static_cast<std::size_t>(x.size())}; }

  std::optional<Eigen::Vector3d> u_;
  robot::LoadedDynamics dynamics_;
  robot::LoadedDynamics::Scratch scratch_;
  robot::FrameOnBody frame_;
  std::vector<double> B_;
  double load_;
  robot::FrameInertia f_;
  Eigen::VectorXd q_, dq_, ddq_, dddq_;
  trajectory::Path path_;
};

}  // namespace

PathMasses masses_along(const robot::RobotModel& robot, const Move& move, const ContactOptions& options) {
  Along along(robot, move, options);
  return along.masses(along.grid(), options.samples);
}

PathSafety safety_along(const robot::RobotModel& robot, const Move& move, const ContactOptions& o) {
  if (o.parts.empty()) throw Error("parts", "name no body part, expected at least one");
  for (const auto& [name, value, unit] : {std::tuple{"area", o.area, " m2"}, {"load", o.load, " kg"}})
    if (!(value >= 0 && std::isfinite(value)))
      throw Error(name, text::to_text(value) + unit + ", expected a number of 0 or more");
  Along along(robot, move, o);
  const std::vector<Along::Sample> grid = along.grid();
  const bool scales = move.is_path() || move.ends().at_rest();
  PathSafety r;
  r.masses = along.masses(grid, o.samples);
  r.T = along.T;
  r.safe = true;
  // Of the robot with the load and what it carries at that time.
  const auto simple = [&, M = robot::moving_mass(robot)](MassAt s) {
    double load = o.load;
    for (const robot::Payload& payload : move.loads.payloads)
      if (payload.when.has(along.share(s.t))) load += payload.part.inertia.mass;
    s.mass = robot::simple_effective_mass(M, load);
    return s;
  };
  for (const robot::BodyPart& part : o.parts) {
    const double force = (o.transient ? part.transient : part.quasi_static).on(o.area);
    const auto limit = [&](double mass) {
      return force > 0 ? robot::speed_limit_of_force(force, part.stiffness, robot::reduced_mass(mass, part.mass)) : 0;
    };
    const auto share = [&](double mass, double speed) {
      const double permitted = limit(mass);
      return speed == 0 ? 0 : permitted > 0 ? std::abs(speed) / permitted : std::numeric_limits<double>::infinity();
    };
    const auto energy = [&](double mass, double speed) {
      return robot::collision_energy(robot::reduced_mass(mass, part.mass), std::abs(speed));
    };
    const auto risk = [&](const MassAt& worst, const MassAt& hardest) {
      MassRisk m;
      m.mass = worst.mass;
      m.share = share(worst.mass, worst.speed);
      m.t = worst.t;
      m.speed = std::abs(worst.speed);
      m.limit = limit(worst.mass);
      m.energy = energy(hardest.mass, hardest.speed);
      m.t_energy = m.energy > 0 ? hardest.t : 0;
      // Speeds are proportional to 1/T, masses and limits depend on the shape alone, unless the ends have speeds of their own.
      m.T_safe = scales ? r.T * m.share : std::numeric_limits<double>::infinity();
      return m;
    };
    const auto share_at = [&](const MassAt& s) { return share(s.mass, s.speed); };
    const auto energy_at = [&](const MassAt& s) { return energy(s.mass, s.speed); };
    PartRisk own;
    own.name = part.name;
    own.effective = risk(along.largest(grid, share_at), along.largest(grid, energy_at));
    own.simple = move.loads.payloads.empty()
                     ? risk(simple(r.masses.fastest), simple(r.masses.fastest))
                     : risk(simple(along.largest(grid, [&](const MassAt& s) { return share_at(simple(s)); })),
                            simple(along.largest(grid, [&](const MassAt& s) { return energy_at(simple(s)); })));
    // At each time the larger mass has the larger share and the larger energy: so have their largest values.
    own.decisive = !o.only_effective && own.simple.share > own.effective.share ? own.simple : own.effective;
    if (!o.only_effective && own.simple.energy > own.effective.energy) {
      own.decisive.energy = own.simple.energy;
      own.decisive.t_energy = own.simple.t_energy;
    }
    r.safe = r.safe && own.decisive.share <= 1 + 1e-12;
    r.parts.push_back(own);
  }
  return r;
}

}  // namespace cotwin::services
