#include "models/optimisation/judgement/drawing.h"

#include <cmath>

namespace cotwin::optimisation {

namespace {
namespace drawn {

#define COTWIN_KEEP_LOOP
#include "models/optimisation/judgement/draw.inc"
#undef COTWIN_KEEP_LOOP

}  // namespace drawn
}  // namespace

Motions room_for(const Problem& p) {
  const std::size_t n = p.robot.joints.size();
  Motions m;
  m.c.resize(n * static_cast<std::size_t>(p.degree - 5) * kLanes);
  m.q_from.resize(n * kLanes);
  m.q_to.resize(n * kLanes);
  m.T.fill(p.T_max);
  return m;
}

void draw(const Problem& p, const Drawing& d, std::uint32_t number, Motions& m, std::size_t lane) {
  const std::size_t K = static_cast<std::size_t>(p.degree - 5);
  const std::size_t goals = std::max<std::size_t>(d.to.list.size(), 1), starts = std::max<std::size_t>(d.from.list.size(), 1);
  const auto taken = [lane](const PostureSet& set, std::size_t in_list, std::vector<double>& q) {
    return [&set, &q, in_list, lane](int joint, drawn::Draws& draws) {
      const auto j = static_cast<std::size_t>(joint);
      q[j * kLanes + lane] = set.list.empty() ? set.low[j] + draws.next() * (set.high[j] - set.low[j]) : set.list[in_list][j];
    };
  };
  m.T[lane] = drawn::draw(d.seed, number, static_cast<int>(p.robot.joints.size()), static_cast<int>(K), p.T_min, p.T_max,
                          std::log(p.T_max / p.T_min), taken(d.from, number / goals % starts, m.q_from),
                          taken(d.to, number % goals, m.q_to), [&](int joint, int k, double u) {
                            const auto j = static_cast<std::size_t>(joint);
                            m.c[(j * K + static_cast<std::size_t>(k)) * kLanes + lane] = d.c_max[j] * u;
                          });
}

}  // namespace cotwin::optimisation
