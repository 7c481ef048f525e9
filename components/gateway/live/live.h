#pragma once
#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "components/gateway/http/router.h"
#include "components/gateway/live/command.h"
#include "components/gateway/live/shares.h"
#include "components/gateway/live/streams.h"

/// The run that the gateway is in, for clients: its signals, its tunables, commands.
namespace cotwin::gateway::live {

/// The member of a request to a service that has the posture at the beginning: "from_q_rad", or "from_q" for a robot with prismatic joints.
using PostureName = std::function<std::string(const nlohmann::ordered_json& request)>;

/// The run, for all threads of the gateway. Without a run all requests are refused with status 503.
class Live {
 public:
  Live();
  ~Live();
  Live(const Live&) = delete;
  Live& operator=(const Live&) = delete;

  void observe(std::shared_ptr<bus::LiveRun> run);
  /// Whether ask() is permitted; without a call it is.
  void permit_commands(bool permitted) { commands_ = permitted; }
  /// Closes the streams. The run can still be asked for.
  void end() noexcept;

  /// Throws http::Refusal without one.
  std::shared_ptr<bus::LiveRun> run() const;
  /// The run, or nullptr.
  std::shared_ptr<bus::LiveRun> find_run() const;

  /// What the routes and MQTT answer; JSON text. Throw http::Refusal.
  std::string state(http::Scopes scopes) const;
  std::string signals(const std::string& component) const;
  /// Waits up to a second for the end of the tick. `owner`: whose share of the watched values it takes meanwhile.
  std::string values(const std::vector<std::string>& names, const std::string& owner) const;
  /// Waits up to two seconds for the loop. Refuses with status 403 where commands are not permitted, and without the scope for it: end for
  /// stop, acknowledge for inputs of that name, tune for everything else. `by`: see bus::LiveRun::Control.
  std::string ask(const RunRequest& request, http::Scopes scopes, const std::string& by) const;

  /// GET / and /run/page, if the run has a page; GET /run, /run/signals, /run/values, /run/stream; PUT /run/tunables/{name}; POST /run/commands. The table of routes ends before this.
  void add_routes(http::Router& router);

  /// Replaces the members "from": "run" and "from_signal" of a request to a service by the member `name` (default: "from_q_rad"), the
  /// present values of that signal: "drive.q"; without a name the only vector q of the run. Leaves other requests as they are. Throws
  /// http::Refusal.
  void fill(nlohmann::ordered_json& request, const PostureName& name = {}) const;

 private:
  static void add_schemas(http::Router& router);
  void add_page_routes(http::Router& router);
  http::Response front() const;
  void must_permit_commands() const;
  static void must_permit(const RunRequest& request, http::Scopes scopes);
  /// A value was changed.
  void hurry_streams() const;
  void begin(const std::shared_ptr<http::Stream>& to, const StreamOrder& order);
  std::shared_ptr<Shares::Share> reserve_elements(const std::string& owner, std::size_t elements) const;
  bus::LiveRun::Sample read(bus::LiveRun::Watch& watch, const bus::LiveRun& run) const;

  std::atomic<bool> commands_ = true;
  const Shares watches_, elements_;
  mutable std::mutex mutex_;
  std::shared_ptr<bus::LiveRun> run_;
  std::unique_ptr<Streams> streams_;
};

}  // namespace cotwin::gateway::live
