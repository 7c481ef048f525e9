// A file with a saved swarm: any bytes are an Error, or a state that gives the same bits again and from which a swarm can
// continue.
#include <cstdint>
#include <cstdlib>
#include <string>

#include "models/foundation/support/error.h"
#include "models/numerics/swarm.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin::numerics;
  try {
    const std::string given(reinterpret_cast<const char*>(data), size);
    const SwarmState state = SwarmState::from_bytes(given);
    if (state.bytes() != given) std::abort();
    SwarmOptions options;
    options.particles = 8;
    options.rounds = static_cast<int>(state.round % 1000) + 3;
    Swarm swarm(
        state,
        [](std::size_t, std::size_t count, const double* x, std::size_t, double* cost) {
          for (std::size_t k = 0; k < count; ++k) cost[k] = x[k] * x[k];
        },
        options);
    swarm.run();
  } catch (const cotwin::Error&) {
  }
  return 0;
}
