// A swarm's state as bytes.

#include "models/foundation/support/bytes.h"
#include "models/numerics/swarm.h"

namespace cotwin::numerics {
namespace {

constexpr std::uint64_t kMark = 0x31574d5241575343;  // "CSWARMW1", little-endian

}  // namespace

std::string SwarmState::bytes() const {
  ByteWriter out;
  out.value(kMark);
  for (const std::uint64_t count :
       {std::uint64_t{dimensions}, std::uint64_t{particles}, std::uint64_t{round}, std::uint64_t{reconfigurations},
        std::uint64_t{last_reconfiguration}, std::uint64_t{stagnated}, std::uint64_t{leader}})
    out.value(count);
  for (const auto* array : {&lower, &upper, &spread, &x, &v, &best_x, &cost, &best_cost, &history}) out.list(*array);
  return out.take();
}

SwarmState SwarmState::from_bytes(std::string_view bytes) {
  ByteReader in(as_bytes(bytes), "swarm state");
  if (in.value<std::uint64_t>() != kMark) in.fail("does not begin with its mark, expected what SwarmState::bytes gave");
  const auto up_to = [&](std::uint64_t most) {
    const std::uint64_t n = in.value<std::uint64_t>();
    if (n > most) in.fail("has " + std::to_string(n) + " where at most " + std::to_string(most) + " is expected");
    return static_cast<std::uint32_t>(n);
  };
  SwarmState s;
  s.dimensions = in.value<std::uint64_t>();
  s.particles = in.value<std::uint64_t>();
  s.round = up_to(0xffffffff);
  s.reconfigurations = up_to(0xffffffff);
  s.last_reconfiguration = up_to(0xffffffff);
  s.stagnated = up_to(1) != 0;
  s.leader = in.value<std::uint64_t>();
  for (auto* v : {&s.lower, &s.upper, &s.spread, &s.x, &s.v, &s.best_x, &s.cost, &s.best_cost, &s.history})
    *v = in.list<double>();
  in.expect_end();
  return s;
}

}  // namespace cotwin::numerics
