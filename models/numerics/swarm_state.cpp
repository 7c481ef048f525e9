// A swarm's state as bytes.

#include "models/numerics/bytes.h"
#include "models/numerics/swarm.h"
#include "models/support/error.h"

namespace cotwin::numerics {
namespace {

constexpr std::uint64_t kMark = 0x31574d5241575343;  // "CSWARMW1", little-endian

}  // namespace

std::vector<unsigned char> SwarmState::bytes() const {
  ByteWriter out;
  out.number(kMark);
  for (const std::uint64_t count :
       {std::uint64_t{dimensions}, std::uint64_t{particles}, std::uint64_t{round}, std::uint64_t{reconfigurations},
        std::uint64_t{last_reconfiguration}, std::uint64_t{stagnated}, std::uint64_t{leader}})
    out.number(count);
  for (const auto* array : {&lower, &upper, &spread, &x, &v, &best_x, &cost, &best_cost, &history}) out.numbers(*array);
  return out.take();
}

SwarmState SwarmState::from_bytes(std::span<const unsigned char> bytes) {
  ByteReader in(bytes, "swarm state");
  if (in.number() != kMark) throw Error("swarm state", "does not begin with its mark, expected what SwarmState::bytes gave");
  const auto up_to = [&](std::uint64_t most) {
    const std::uint64_t n = in.number();
    if (n > most)
      throw Error("swarm state", "has " + std::to_string(n) + " where at most " + std::to_string(most) + " is expected");
    return static_cast<std::uint32_t>(n);
  };
  SwarmState s;
  s.dimensions = in.number();
  s.particles = in.number();
  s.round = up_to(0xffffffff);
  s.reconfigurations = up_to(0xffffffff);
  s.last_reconfiguration = up_to(0xffffffff);
  s.stagnated = up_to(1) != 0;
  s.leader = in.number();
  for (auto* v : {&s.lower, &s.upper, &s.spread, &s.x, &s.v, &s.best_x, &s.cost, &s.best_cost, &s.history}) *v = in.numbers();
  in.end();
  return s;
}

}  // namespace cotwin::numerics
