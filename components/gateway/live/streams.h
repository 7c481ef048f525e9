#pragma once
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "components/bus/live_run.h"
#include "components/gateway/http/stream.h"
#include "components/gateway/live/shares.h"

namespace cotwin::gateway::live {

/// The order of a stream: elements, rate and format.
struct StreamOrder {
  std::vector<std::string> names;
  double rate_hz = 20;  // messages per second of wall time, at most; after a change one comes early, in place of the next one
  std::int64_t every = 0;  // ticks between two records, which are all sent; 0: the newest values with each message
  std::shared_ptr<Shares::Share> watch, elements;  // its places among the watchers and the watched values
};

/// Records of the run as JSON: {"tick":…,"time_s":…,"values":{"drive.q":[…]}}. Numbers that are not finite are null.
std::string to_json(std::span<const bus::LiveElements> elements, const bus::LiveRun::Sample& sample, std::uint64_t lost);
/// {"phase":…,"tick":…,"time_s":…,"changes":…}
std::string to_json(const bus::RunPosition& position);

/// Streams of the run's signals to clients, on one thread. A client that does not read in time gets the newest values later; the
/// records between are counted as lost.
class Streams {
 public:
  static constexpr double kLowest = 0.01, kHighest = 200;  // Hz
  static constexpr std::size_t kMostRecords = 500;         // in a message

  explicit Streams(std::shared_ptr<bus::LiveRun> run);
  /// end()
  ~Streams();
  /// Begins a stream. Throws Error for unknown names, and if there are too many watches.
  void add(std::shared_ptr<http::Stream> to, const StreamOrder& order);
  /// A value of the run was changed: streams that are due within their period send the newest values at once.
  void hurry() noexcept;
  /// Sends the last records and the state, closes all streams and ends the thread.
  void end() noexcept;

 private:
  struct Client {
    std::shared_ptr<http::Stream> to;
    std::shared_ptr<Shares::Share> places[2];  // given back after the watch has ended
    std::unique_ptr<bus::LiveRun::Watch> watch;
    std::vector<std::string> names;
    std::int64_t every = 0, period = 0, due = 0, again = 0;  // period, due and again: ns of CLOCK_MONOTONIC
    std::optional<std::int64_t> late_since;                  // the client has not read the last message since then
    bool asked = false;                                      // a record was requested and has not come
    bus::RunPhase phase = bus::RunPhase::kEnded;             // last sent
    std::int64_t tick = -1, changes = -1;                    // last sent
    std::uint64_t id = 0, left_out = 0;
  };

  void work();
  bool serve(Client& client, std::int64_t now, bool hurried);
  void send_newest(Client& client);
  void send_records(Client& client);
  void send_rest(Client& client);
  void send_phase(Client& client);

  std::shared_ptr<bus::LiveRun> run_;
  // Two, so that records for others do not wake the thread while it waits for none: waking costs the loop a system call.
  bus::Wake wake_;                                                      // for the thread's own orders
  std::shared_ptr<bus::Wake> records_ = std::make_shared<bus::Wake>();  // while a requested record has not come
  std::mutex mutex_;
  std::vector<std::unique_ptr<Client>> incoming_;
  std::atomic<bool> arrived_ = false, hurried_ = false, ending_ = false;
  std::vector<std::unique_ptr<Client>> clients_;  // of the thread
  std::thread thread_;
};

}  // namespace cotwin::gateway::live
