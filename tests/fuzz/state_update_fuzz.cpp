// Messages of a state database with any bytes, alone and in a sequence: refused without a change, or applied within the image. The
// first byte chooses between raw messages and edits of valid ones, and whether the replica has the states before.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>

#include "components/bus/state_database.h"
#include "models/foundation/support/bytes.h"
#include "tests/fuzz/edits.h"

namespace {

using namespace cotwin::bus;

std::string text_of(std::span<const std::byte> bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto layout = [] { return StateLayout::parse("q:7:rad,mode:3:integer,contact:5:boolean", "fuzz"); };
  StateOwner owner(layout(), 5);
  StateReplica replica(layout());
  for (std::size_t i = 0; i < owner.image().size(); i += 3) owner.image()[i] = static_cast<std::byte>(i);
  (void)owner.publish(1);
  (void)replica.request();
  if (data[0] % 2 == 1) replica.receive(owner.full(replica.requested()));
  const bool edits = data[0] % 4 >= 2;
  ++data;
  --size;
  // Up to 8 messages: a byte with the size of each.
  for (int i = 0; i < 8 && size > 0; ++i) {
    const std::size_t part = std::min<std::size_t>(data[0], size - 1);
    std::string message(reinterpret_cast<const char*>(data + 1), part);
    if (edits) {
      owner.image()[static_cast<std::size_t>(i) * 8] ^= std::byte{1};
      const std::string good = text_of(i % 3 == 2 ? owner.full(replica.requested()) : owner.publish(i + 2));
      message = cotwin::fuzz::edited(good, data + 1, part);
    }
    const std::string before = text_of(replica.image());
    const Reception reception = replica.receive(cotwin::as_bytes(message));
    const bool applied = reception == Reception::kUpdated || reception == Reception::kCopied;
    if (applied ? !replica.complete() : text_of(replica.image()) != before) std::abort();
    StateMessage m;
    if (decode(cotwin::as_bytes(message), 0, 0, m) && m.payload.size() + m.text.size() > message.size()) std::abort();
    data += 1 + part;
    size -= 1 + part;
  }
  return 0;
}
