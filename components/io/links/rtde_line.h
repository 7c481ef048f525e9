#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "components/io/rtde/client.h"
#include "components/unit/tick_source.h"
#include "models/foundation/net/tcp_socket.h"

namespace cotwin::io {

/// A connection to an RTDE controller that is set up again whenever it ends, by the host's clock. Its data packages are ticks; they stay
/// for the next step of the unit. Allocates nothing after open() and never blocks but in wait().
class RtdeLine final : public TickSource {
 public:
  /// Begins to connect; an open connection to another controller ends. A connection over which nothing comes for `silence` (ns) ends,
  /// too: a controller without current sends no FIN. Throws Error at `place`.
  void open(const net::Endpoint& controller, const rtde::ClientSettings& settings, std::int64_t silence,
            const std::string& place);

  rtde::Client& client() { return *client_; }
  const rtde::Client& client() const { return *client_; }
  const net::Endpoint& controller() const { return controller_; }
  /// Connects, sets up, takes bytes that have come, and sends bytes that wait. True if bytes have come.
  bool serve();
  /// How often the set-up was complete.
  std::uint64_t set_ups() const { return set_ups_; }
  /// Why there is no connection, a sentence's end such as "nobody answers"; with the quantity, where there is one.
  const char* reason() const { return reason_; }
  std::string_view culprit() const { return culprit_; }

  std::optional<Arrival> wait(std::int64_t deadline) override;
  std::int64_t period() const override { return period_; }

 private:
  void end(const char* reason, std::string_view culprit = {});
  std::int64_t source_time(double timestamp);

  net::Endpoint controller_;
  net::TcpStream stream_;
  std::optional<rtde::Client> client_;
  std::int64_t period_ = 0;                // ns
  std::int64_t retry_ = 0, patience_ = 0;  // ns, host: when to connect again; until when a connection has to come about
  std::int64_t silence_ = 0, heard_ = 0;   // ns: without bytes until the end; host, of the last bytes
  std::uint64_t set_ups_ = 0;
  bool was_running_ = false, connecting_ = false;
  const char* reason_ = "not connected yet";
  std::string_view culprit_;
  // Of the ticks: time stamp and number of the first cycle since the controller's clock went back last.
  bool stamped_ = false;
  double first_stamp_ = 0, last_stamp_ = 0;
  std::int64_t first_number_ = 0, number_ = 0;
};

}  // namespace cotwin::io
