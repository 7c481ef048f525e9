#include "models/bag/storage.h"
#include "models/foundation/support/error.h"

#ifdef COTWIN_LZ4
#include <lz4frame.h>
#endif
#ifdef COTWIN_ZSTD
#include <zstd.h>
#endif

namespace cotwin::bag {

namespace {

#ifdef COTWIN_LZ4
/// A frame of LZ4; the number of bytes, or more than `to` has for what is damaged or longer.
std::size_t from_lz4(std::span<const std::byte> bytes, std::vector<std::byte>& to) {
  const std::size_t wrong = to.size() + 1;
  LZ4F_dctx* context = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION)) != 0) return wrong;
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> freed(context, &LZ4F_freeDecompressionContext);
  std::size_t written = 0, hint = 1;
  while (hint != 0) {
    std::size_t in = bytes.size(), out = to.size() - written;
    hint = LZ4F_decompress(context, to.data() + written, &out, bytes.data(), &in, nullptr);
    if (LZ4F_isError(hint) != 0 || (in == 0 && out == 0 && hint != 0)) return wrong;
    bytes = bytes.subspan(in);
    written += out;
  }
  return written;
}
#endif

}  // namespace

void decompress(const std::string& compression, std::span<const std::byte> bytes, std::vector<std::byte>& to, std::size_t size,
                const std::string& place) {
  if (size > kLargest)
    throw Error(place, "a chunk of " + std::to_string(size) + " bytes, expected at most " + std::to_string(kLargest) +
                           ": ros2 bag convert with a smaller chunkSize");
  to.resize(size);
  std::size_t written = size + 1;
  if (compression.empty()) {
    to.assign(bytes.begin(), bytes.end());
    written = bytes.size();
#ifdef COTWIN_LZ4
  } else if (compression == "lz4") {
    written = from_lz4(bytes, to);
#endif
#ifdef COTWIN_ZSTD
  } else if (compression == "zstd") {
    written = ZSTD_decompress(to.data(), to.size(), bytes.data(), bytes.size());
#endif
  } else {
    throw Error(place, "a chunk with the compression '" + compression + "', expected none, lz4 or zstd" +
                           (compression == "lz4" || compression == "zstd" ? " (this program was built without that)" : ""));
  }
  if (written != size)
    throw Error(place, "a chunk whose " + compression + " data are damaged, or of another size than it says");
}

}  // namespace cotwin::bag
