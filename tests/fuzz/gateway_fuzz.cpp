// What of the gateway reads bytes of strangers without a library: targets of requests, header values, names of hosts, token files, patterns
// of routes.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "components/gateway/access/access.h"
#include "components/gateway/http/router.h"
#include "models/foundation/support/error.h"

using namespace cotwin::gateway::access;
using namespace cotwin::gateway::http;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  Request request;
  std::string host;
  request.method = "GET";
  if (read_target(text, request, host).empty()) {
    for (const std::string& segment : request.segments) {
      // No segment can leave a folder, and each reads back from its escaped form.
      if (segment.empty() || segment == "." || segment == ".." || segment.find_first_of("/\\") != std::string::npos)
        std::abort();
      if (decode(encode_segment(segment), true) != segment) std::abort();
    }
    static const Router kRouter = [] {
      Router router;
      for (const char* pattern : {"/", "/a", "/a/{x}", "/a/{x}/{y}", "/a/b"})
        router.add("GET", pattern, [](const Request&) { return Response{}; });
      return router;
    }();
    const auto found = kRouter.find(request);
    if (const auto* const entry = std::get_if<0>(&found); entry != nullptr && request.matched.size() != (*entry)->names.size())
      std::abort();
  }
  if (const auto name = host_of(text); name && (name->empty() || name->find_first_of("/@ \r\n") != std::string::npos))
    std::abort();
  (void)accepts(text, "application/json");
  (void)preference(text, "wait");
  (void)media_type(text);
  try {
    const Tokens tokens = Tokens::parse(text, "tokens");
    // Nobody gets in without a line for it.
    if (tokens.find(digest_of(text), {}) != nullptr || tokens.size() > text.size() / (Tokens::kShortest + 2)) std::abort();
  } catch (const cotwin::Error& error) {
    if (!std::string_view(error.what()).starts_with("tokens")) std::abort();
  }
  try {
    Router router;
    router.add("GET", std::string(text), [](const Request&) { return Response{}; });
  } catch (const cotwin::Error&) {
  }
  Tickets tickets;
  if (tickets.redeem(text, std::chrono::steady_clock::now())) std::abort();
  return 0;
}
