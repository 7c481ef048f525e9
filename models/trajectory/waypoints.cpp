#include "models/trajectory/waypoints.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <optional>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/columns.h"
#include "models/trajectory/polynomial.h"
#include "models/trajectory/spline.h"

namespace cotwin::trajectory {

namespace {

/// Positions, velocities and accelerations; a point with a dwell has a knot at its arrival and one at its departure.
struct Knots {
  std::vector<double> t, q, dq, ddq;
  std::vector<std::ptrdiff_t> leg;  // of the interval after the knot: index of the waypoint before it; −1: dwell
};

double dwell(const Waypoints& points, std::size_t k) { return points.dwell.empty() ? 0 : points.dwell[k]; }

void check(const Waypoints& points, std::size_t redundant, std::size_t given) {
  const std::size_t N = points.t.size(), n = points.joints;
  assert(points.q.size() == N * n && (points.dwell.empty() || points.dwell.size() == N));
  assert(points.places.empty() || points.places.size() == N);
  if (N < 2) throw Error("waypoints", std::to_string(N) + " given, expected at least 2");
  for (std::size_t k = 0; k < N; ++k) {
    const std::string place = points.places.empty() ? "waypoint " + std::to_string(k + 1) : points.places[k];
    if (!(dwell(points, k) >= 0)) throw Error(place, "dwell " + text::to_text(dwell(points, k)) + " s, expected >= 0");
    if (k > 0 && !(points.t[k] > points.t[k - 1] + dwell(points, k - 1))) {
      throw Error(place, "reached at " + text::to_text(points.t[k]) +
                             " s, expected after the departure from the previous point at " +
                             text::to_text(points.t[k - 1] + dwell(points, k - 1)) + " s");
    }
  }
  if (given != 0 && given != (N - 1) * n * redundant) {
    throw Error("waypoints", std::to_string(given) + " redundant coefficients, expected " +
                                 std::to_string((N - 1) * n * redundant) + ": legs x joints x (degree - 5)");
  }
}

/// Velocities and accelerations at the points: zero at rests, those of the spline of minimum jerk between two rests.
SplineKnots velocities(const Waypoints& points, Passing passing) {
  const std::size_t N = points.t.size(), n = points.joints;
  SplineKnots all{std::vector<double>(N * n, 0.0), std::vector<double>(N * n, 0.0)};
  if (passing == Passing::kRest) return all;
  for (std::size_t first = 0; first + 1 < N;) {
    std::size_t last = first + 1;
    while (last + 1 < N && dwell(points, last) == 0) ++last;
    std::vector<double> t(points.t.begin() + static_cast<std::ptrdiff_t>(first),
                          points.t.begin() + static_cast<std::ptrdiff_t>(last + 1));
    t.front() += dwell(points, first);
    const SplineKnots run = solve_spline(t, n, std::span(points.q).subspan(first * n, t.size() * n), SplineEnds::kRest);
    std::copy(run.dq.begin(), run.dq.end(), all.dq.begin() + static_cast<std::ptrdiff_t>(first * n));
    std::copy(run.ddq.begin(), run.ddq.end(), all.ddq.begin() + static_cast<std::ptrdiff_t>(first * n));
    first = last;
  }
  return all;
}

Knots knots_of(const Waypoints& points, Passing passing) {
  const std::size_t N = points.t.size(), n = points.joints;
  const SplineKnots v = velocities(points, passing);
  Knots knots;
  const auto add = [&](std::size_t k, double t, std::ptrdiff_t leg) {
    knots.t.push_back(t);
    knots.leg.push_back(leg);
    for (std::size_t j = 0; j < n; ++j) {
      knots.q.push_back(points.q[k * n + j]);
      knots.dq.push_back(v.dq[k * n + j]);
      knots.ddq.push_back(v.ddq[k * n + j]);
    }
  };
  for (std::size_t k = 0; k < N; ++k) {
    const std::ptrdiff_t leg = static_cast<std::ptrdiff_t>(k);
    if (dwell(points, k) > 0) {
      add(k, points.t[k], -1);
      add(k, points.t[k] + dwell(points, k), leg);
    } else {
      add(k, points.t[k], leg);
    }
  }
  return knots;
}

}  // namespace

Waypoints load_waypoints(const std::filesystem::path& file, std::span<const Axis> axes, const std::string& q_columns,
                         double angle_unit) {
  csv::Reader reader(file);
  const std::size_t time = find_time_column(reader, file.string(), "");
  const auto positions = find_columns(reader, file.string(), q_columns, kPositions, axes);
  if (positions.empty())
    throw Error(file.string(), "has no columns of joint positions, expected 'q1', 'q2', … or the joints' names");
  const auto dwell_column = std::find(reader.names().begin(), reader.names().end(), "dwell");
  const auto finite = [&](std::size_t column) {
    const double value = reader.real(column);
    if (!std::isfinite(value)) throw Error(reader.place(column), text::to_text(value) + ", expected a finite number");
    return value;
  };
  Waypoints points;
  points.joints = axes.size();
  while (reader.next()) {
    points.places.push_back(reader.place());
    points.t.push_back(finite(time));
    for (std::size_t j = 0; j < axes.size(); ++j)
      points.q.push_back(finite(positions[j]) * (axes[j].revolute ? angle_unit : 1));
    if (dwell_column != reader.names().end()) {
      points.dwell.push_back(finite(static_cast<std::size_t>(dwell_column - reader.names().begin())));
    }
  }
  return points;
}

Path make_path(const Waypoints& points, Passing passing, int degree, std::span<const double> c_r) {
  const RedundantTerms terms(degree);
  check(points, terms.size(), c_r.size());
  const std::size_t n = points.joints;
  Knots knots = knots_of(points, passing);
  if (degree == 5) return Path(n, std::move(knots.t), std::move(knots.q), std::move(knots.dq), std::move(knots.ddq));

  const std::vector<double> zero(terms.size(), 0.0);
  std::vector<double> control;
  for (std::size_t k = 0; k + 1 < knots.t.size(); ++k) {
    for (std::size_t j = 0; j < n; ++j) {
      const std::size_t a = k * n + j, b = a + n;
      const bool moves = knots.leg[k] >= 0 && !c_r.empty();
      const auto coefficients = moves
                                    ? c_r.subspan((static_cast<std::size_t>(knots.leg[k]) * n + j) * terms.size(), terms.size())
                                    : std::span<const double>(zero);
      const auto segment = make_polynomial({knots.q[a], knots.dq[a], knots.ddq[a], std::nullopt},
                                           {knots.q[b], knots.dq[b], knots.ddq[b], std::nullopt}, knots.t[k + 1] - knots.t[k],
                                           terms, coefficients);
      control.insert(control.end(), segment.begin(), segment.end());
    }
  }
  return Path(n, std::move(knots.t), degree, std::move(control));
}

double calm_duration(std::span<const Axis> axes, std::span<const double> from, std::span<const double> to) {
  constexpr double kPeakSpeed = 1.875, kPeakAcceleration = 5.774;  // of a quintic over a unit way in unit time: 15/8, 10/√3
  double T = 1;
  for (std::size_t j = 0; j < axes.size(); ++j) {
    const double way = std::abs(to[j] - from[j]);
    const double speed = std::isfinite(axes[j].dq_max) ? 0.3 * axes[j].dq_max : axes[j].revolute ? 0.5 : 0.1;
    const double acceleration = axes[j].revolute ? 2 : 0.5;
    T = std::max({T, kPeakSpeed * way / speed, std::sqrt(kPeakAcceleration * way / acceleration)});
  }
  return std::ceil(10 * T - 1e-9) / 10;
}

}  // namespace cotwin::trajectory
