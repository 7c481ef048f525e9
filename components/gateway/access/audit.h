#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "components/gateway/access/offences.h"

namespace cotwin::gateway::access {

/// Prints a line of the gateway's log on stderr, printable ASCII only. From any thread; never waits:
/// while nobody reads it, lines are left out and counted.
void log(const std::string& line) noexcept;

/// What somebody wants to change.
struct Deed {
  std::string by;       // name of the token, "local user 1000", kBrokerName; "": unknown
  std::string address;  // of the client; "": it came over the broker
  std::string what;     // "PUT /run/tunables/drive.K"
  std::string body;     // as it came
};

/// Who changed what, line by line as JSON in audit.jsonl of a result folder: a line before it is done, and one with the status
/// after it. Only appended to, for the owner only (mode 600); from kMost on a new file is begun, and the last one is kept as
/// audit.1.jsonl. Also printed by log(). From all threads; several may have the same folder, as the gateways of one run.
class Audit {
 public:
  static constexpr const char* kFile = "audit.jsonl";
  static constexpr const char* kEarlier = "audit.1.jsonl";
  static constexpr std::uint64_t kMost = 10 << 20;      // bytes of a file
  static constexpr std::size_t kMostOfBody = 2048;      // bytes of a body that a line repeats
  static constexpr std::size_t kMostWaiting = 1 << 20;  // bytes of lines before the folder is known

  Audit() = default;
  ~Audit();
  Audit(const Audit&) = delete;
  Audit& operator=(const Audit&) = delete;

  /// The folder, which is there; "": no file is written, only the log. Lines until now follow. Throws Error if the file cannot be appended to, or
  /// is no regular file.
  void open(const std::filesystem::path& folder);
  /// Called with what was done, after its end.
  void on_done(std::function<void(const Deed&)> function);
  /// Before something is done. Returns its number. Throws Error if the line cannot be written: it must not be done.
  std::uint64_t begin(const Deed& deed);
  /// What became of it: a status of HTTP, and why it was refused.
  void end(std::uint64_t number, const Deed& deed, int status, const std::string& why) noexcept;
  /// Was refused without being begun. Of many of one client, some are only counted.
  void refused(const Deed& deed, int status, const std::string& why) noexcept;

 private:
  void append(const std::string& line);
  void open_file();
  bool is_there() const;

  enum class State : std::uint8_t { kWaiting, kNone, kOpen } state_ = State::kWaiting;
  std::function<void(const Deed&)> done_;
  std::filesystem::path file_;
  int descriptor_ = -1;
  std::string waiting_;
  Offences refusals_{60};
};

}  // namespace cotwin::gateway::access
