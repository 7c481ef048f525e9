#pragma once
#include <optional>
#include <string>
#include <string_view>

/// Texts in JSON: identity of requests, lines of workers.
namespace cotwin::gateway {

inline constexpr const char* kChain = "chain";  // in place of a service

struct CanonicalRequest {
  std::string text;            // as canonical_json
  std::string hash;            // SHA-256 of the text, hexadecimal
  std::string service, robot;  // members of the request; robot may be missing: ""; of a chain kChain and ""
  bool reads_more =
      false;  // the reply depends on files of others than the robot: a scene, further robots, tools (clear_of, payload)
};

/// Throws Error with the JSON pointer: as canonical_json, and for a service or robot that is no string of 1 to 200 bytes.
CanonicalRequest canonical_request(std::string_view text);

/// SHA-256, hexadecimal.
std::string sha256(std::string_view bytes);

/// A line of a worker. `reply` and `problem` are the bytes of the value as they are in the line.
struct WorkerLine {
  std::string id;
  std::optional<double> progress;  // 0 to 1
  std::string message;
  std::string_view reply, problem;  // "": the line has none
};

/// Throws Error if the line is not of the protocol: jobs.h.
WorkerLine parse_worker_line(std::string_view line);

}  // namespace cotwin::gateway
