// A file with a saved swarm: any bytes are an Error, or a state that gives the same bits again and from which a swarm can
// continue.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "models/numerics/swarm.h"
#include "models/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin::numerics;
  try {
    const SwarmState state = SwarmState::from_bytes({data, size});
    const std::vector<unsigned char> bytes = state.bytes();
    if (!std::equal(bytes.begin(), bytes.end(), data, data + size)) std::abort();
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
