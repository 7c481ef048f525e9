// Springs of soft contacts and the dents that yielding leaves in their surfaces.
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Distance from a point up to which its dent covers the surface, relative to the root of its area: that of a quarter of a
/// square or disc reaches its middle, that of a point alone covers its disc.
constexpr double kReach = 0.85, kReachAlone = 0.57;

struct Spring {
  double stiffness = kInfinity, damping = 0, limit = kInfinity;
};

Spring spring_of(const scene::Material& m, double area, double share) {
  if (m.foundation == 0) return {m.stiffness, m.damping, kInfinity};
  const double of = m.whole ? share : area;
  return {m.foundation * of, m.foundation_damping * of, m.yield * of};
}

bool can_yield(const scene::Material& m) { return m.foundation > 0 && (m.yield < kInfinity || m.breakthrough < kInfinity); }

}  // namespace

/// Place of a contact point on the surface that yields, in that body.
Vector3d World::Impl::place_on_surface(const Contact& touch) const {
  const ContactPoint& point = touch.point;
  const Vector3d surface = point.p_W + (touch.yields_b ? 0.5 : -0.5) * point.gap * point.n_W;
  return bodies[index(touch.yields_b ? point.body_b : point.body_a)].pose().inverse() * surface;
}

/// Index of the dent that covers the place and is nearest to it, or their number.
std::size_t World::Impl::dent_at(const Contact& touch) const {
  const int body = touch.yields_b ? touch.point.body_b : touch.point.body_a;
  const int shape = touch.yields_b ? touch.point.shape_b : touch.point.shape_a;
  const Vector3d p = place_on_surface(touch);
  std::size_t found = dents.size();
  double nearest = kInfinity;
  for (std::size_t d = 0; d < dents.size(); ++d) {
    const Dent& dent = dents[d];
    if (dent.body != body || dent.shape != shape || dent.is_new) continue;
    const double distance = (dent.p - p).norm();
    if (distance > dent.reach || !(distance < nearest)) continue;
    nearest = distance;
    found = d;
  }
  return found;
}

/// Sets stiffness, damping, limit and gap of a contact's spring. Springs in series carry the same force; each damper sees its
/// spring's share of the speed. In a dent, the spring begins at the depth that stays; the area of a round surface remains there.
void World::Impl::set_spring(Contact& touch) const {
  const ContactPoint& point = touch.point;
  const scene::Material& a = *materials[index(point.body_a)][index(point.shape_a)];
  const scene::Material& b = *materials[index(point.body_b)][index(point.shape_b)];
  const auto set = [&](double area) {
    const Spring of_a = spring_of(a, area, point.share), of_b = spring_of(b, area, point.share);
    const bool two = of_a.stiffness < kInfinity && of_b.stiffness < kInfinity;
    const double share_a = two ? of_b.stiffness / (of_a.stiffness + of_b.stiffness) : of_a.stiffness < kInfinity ? 1 : 0;
    touch.stiffness = 1 / (1 / of_a.stiffness + 1 / of_b.stiffness);
    touch.damping = of_a.damping * share_a * share_a + of_b.damping * (1 - share_a) * (1 - share_a);
    touch.limit = std::min(of_a.limit, of_b.limit);
    touch.yields_b = of_b.limit < of_a.limit || (of_b.limit == of_a.limit && !can_yield(a));
  };
  touch.gap = point.gap;
  touch.fresh = true;
  touch.without_effect = false;
  touch.can_yield = can_yield(a) || can_yield(b);
  const bool by_area = (a.foundation > 0 && !a.whole) || (b.foundation > 0 && !b.whole);
  if (by_area && point.area == 0) {
    touch.stiffness = touch.damping = 0;
    touch.without_effect = true;
    return;
  }
  set(point.area);
  if (by_area) touch.gap = -point.load;
  if (!touch.can_yield) return;
  const std::size_t d = dent_at(touch);
  if (d == dents.size()) return;
  const Dent& dent = dents[d];
  touch.fresh = false;
  touch.without_effect = dent.pierced;
  if (by_area && point.load < -point.gap && dent.area > point.area) set(dent.area);
  touch.gap = point.gap + dent.depth;
  if (!dent.pierced) return;
  touch.stiffness = touch.damping = 0;
  touch.limit = kInfinity;
}

/// The dent at a contact point, a new one if there is none.
Dent& World::Impl::make_dent(const Contact& touch) {
  const std::size_t d = dent_at(touch);
  if (d < dents.size()) return dents[d];
  Dent& dent = dents[next_dent];
  next_dent = (next_dent + 1) % dents.size();
  if (dent.body >= 0) ++forgotten;
  dent = {};
  dent.is_new = true;
  dent.body = touch.yields_b ? touch.point.body_b : touch.point.body_a;
  dent.shape = touch.yields_b ? touch.point.shape_b : touch.point.shape_a;
  dent.p = place_on_surface(touch);
  dent.reach = (touch.point.share < 1 ? kReach : kReachAlone) * std::sqrt(touch.point.area);
  return dent;
}

/// Return mapping at the new poses: where the force would exceed the limit, the depth that stays grows. A damper shares the
/// limit: (limit − k e)/d bounds the rate of the elastic depth e.
void World::Impl::yield(double h) {
  if (dents.empty()) return;
  const auto account_of = [&](const Contact& touch) -> Yielding& {
    const int body = touch.yields_b ? touch.point.body_b : touch.point.body_a;
    return *std::find_if(yielding.begin(), yielding.end(), [&](const Yielding& one) { return one.body == index(body); });
  };
  for (Contact& touch : touches) {
    if (!touch.can_yield || touch.without_effect || !(touch.gap < 0)) continue;
    const double rate = touch.damping / h, before = touch.matched ? std::max(-touch.gap_before, 0.0) : 0;
    const double most = (touch.limit + rate * before) / (touch.stiffness + rate);
    const double more = -touch.gap - most;
    if (!(more > 0)) continue;
    Dent& dent = make_dent(touch);
    dent.depth = std::max(dent.depth, -touch.point.gap - most);
    dent.area = std::max(dent.area, touch.point.area);
    Yielding& account = account_of(touch);
    account.depth = std::max(account.depth, dent.depth);
    account.work += touch.limit * more;
  }
  for (Dent& dent : dents) dent.is_new = false;
  for (std::size_t first = 0, end = 0; first < touches.size(); first = end) {
    const auto same = [&](const Contact& t) {
      const ContactPoint &one = t.point, &other = touches[first].point;
      return one.body_a == other.body_a && one.body_b == other.body_b && one.shape_a == other.shape_a &&
             one.shape_b == other.shape_b;
    };
    bool breaks = false;
    for (end = first; end < touches.size() && same(touches[end]); ++end) {
      const Contact& touch = touches[end];
      if (!touch.can_yield || touch.without_effect) continue;
      const int body = touch.yields_b ? touch.point.body_b : touch.point.body_a;
      const int shape = touch.yields_b ? touch.point.shape_b : touch.point.shape_a;
      breaks = breaks || -touch.point.gap >= materials[index(body)][index(shape)]->breakthrough;
    }
    for (std::size_t t = first; t < end && breaks; ++t) {
      Contact& touch = touches[t];
      if (touch.without_effect) continue;
      Dent& dent = make_dent(touch);
      dent.pierced = true;
      Yielding& account = account_of(touch);
      account.pierced = true;
      account.work += touch.stored() / 2;
    }
  }
  for (Dent& dent : dents) dent.is_new = false;
  for (Contact& touch : touches) {
    if (touch.can_yield) set_spring(touch);
  }
}

/// Normal forces on the bodies that yield, of the step.
void World::Impl::sum_yielding(double h) {
  for (Yielding& one : yielding) one.force = 0;
  for (const Contact& touch : touches) {
    if (!touch.can_yield) continue;
    const std::size_t body = index(touch.yields_b ? touch.point.body_b : touch.point.body_a);
    for (Yielding& one : yielding) {
      if (one.body == body) one.force += touch.point.n_W.dot(touch.sum) / h;
    }
  }
}

void World::Impl::make_dents() {
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    const auto& shapes = scene.bodies[b].shapes;
    if (std::any_of(shapes.begin(), shapes.end(), [](const scene::Shape& s) { return can_yield(s.material); }))
      yielding.push_back({b, 0, 0, 0, false});
  }
  if (!yielding.empty()) dents.resize(std::max<std::size_t>(options.dents, 1));
}

}  // namespace cotwin::contact_world
