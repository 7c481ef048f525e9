// Friction of a contact from the materials of its two surfaces.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {}  // namespace

/// Geometric mean of the scaled friction of two surfaces along two directions: those of the first surface that has any.
void World::Impl::set_friction(Contact& touch, const scene::Material& a, const scene::Material& b) const {
  const auto mean = [this](double x, double y) { return options.friction_scale * (x == y ? x : std::sqrt(x * y)); };
  const auto isotropic = [](const scene::Material& m) { return m.mu2 < 0 || m.mu2 == m.mu; };
  touch.mu = mean(a.mu, b.mu);
  touch.torsion = mean(a.torsion, b.torsion);
  if (touch.torsion > 0) {
    const double patch = std::max(a.patch_radius, b.patch_radius), surface = std::max(a.surface_radius, b.surface_radius);
    touch.torsion *= patch > 0 ? patch : std::sqrt(surface * std::max(-touch.point.gap, 0.0));
  }
  if (isotropic(a) && isotropic(b)) return;
  const Vector3d& n = touch.point.n_W;
  const auto first_of = [&](const scene::Material& m, int body) {
    const Vector3d t = bodies[index(body)].pose().R * m.first_direction;
    return Vector3d(t - n * n.dot(t));
  };
  const Vector3d of_a = first_of(a, touch.point.body_a), of_b = first_of(b, touch.point.body_b);
  Vector3d t = isotropic(a) ? of_b : of_a;
  if (!(t.norm() > 1e-6)) t = n.unitOrthogonal();  // the direction is along the normal
  t.normalize();
  const auto along = [&](const scene::Material& m, const Vector3d& first, const Vector3d& direction) {
    if (isotropic(m) || !(first.norm() > 1e-6)) return m.mu;
    const double cosine = std::min(std::abs(first.normalized().dot(direction)), 1.0);
    return std::hypot(m.mu * cosine, m.mu2 * std::sqrt(1 - cosine * cosine));
  };
  const Vector3d s = n.cross(t);
  const double first = mean(along(a, of_a, t), along(b, of_b, t)), second = mean(along(a, of_a, s), along(b, of_b, s));
  touch.mu = std::max(first, second);
  if (touch.mu == 0) return;
  touch.tangent = t;
  touch.mu_share[0] = first / touch.mu;
  touch.mu_share[1] = second / touch.mu;
}

}  // namespace cotwin::contact_world
