#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "components/io/rtde/rtde.h"

namespace cotwin::rtde {

struct ControllerSettings {
  double frequency = 500;  // Hz of control cycles and of the fastest data packages; e-Series: 500, CB3: 125
  std::array<std::uint32_t, 4> version{5, 14, 0, 0};  // of the controller that is reported
};

/// What happened with the clients so far.
struct ControllerStatistics {
  std::uint64_t clients = 0;   // connections that were accepted
  std::uint64_t refused = 0;   // connections beyond Controller::kClients
  std::uint64_t sent = 0;      // data packages
  std::uint64_t dropped = 0;   // data packages for which a client was too slow
  std::uint64_t received = 0;  // input packages
  std::uint64_t rejected =
      0;  // input packages with a wrong size, an unknown recipe, a number that is not finite, or before the start
  std::uint64_t faults = 0;  // other packages that could not be read; connections that ended because of one
};

/// The controller's side of RTDE for up to kClients at once, after UR's documentation:
///   versions 1 and 2; without a request, version 1, whose data packages have no recipe id and come with 125 Hz
///   an output that is not known: NOT_FOUND; an input that another client writes: IN_USE; then the recipe has the id 0 and does not exist
///   start fails without an output recipe; several input recipes per client; a new output recipe replaces the old one
///   a client that does not read loses data packages, replies never; the newest values are sent as soon as it reads again
///   inputs keep their values when their client has gone
/// Bytes in, bytes out: the caller moves them between a client and its socket. Nothing allocates after construction.
class Controller {
 public:
  static constexpr std::size_t kClients = 4;

  explicit Controller(const ControllerSettings& settings);

  const Directory& directory() const { return directory_; }
  /// Of all quantities: outputs are set by the caller, inputs by the clients. Masked inputs (speed slider, digital and analog outputs) have
  /// taken effect in the outputs that report them.
  std::span<double> values() { return values_; }
  std::span<const double> values() const { return values_; }
  double& at(std::string_view name, std::size_t i = 0) { return values_[directory_.slot(name) + i]; }

  /// A client has connected. Its number, or −1 if there are too many.
  int connect();
  /// A client has gone: others may write its inputs.
  void disconnect(std::size_t client);
  bool connected(std::size_t client) const { return clients_[client].connected; }

  /// Where bytes of the client go, and that so many have come: its packages take effect.
  std::span<std::uint8_t> space(std::size_t client) { return clients_[client].reader.space(); }
  void received(std::size_t client, std::size_t bytes);
  /// Bytes for the client, and that the socket took so many.
  std::span<const std::uint8_t> waiting(std::size_t client) const { return clients_[client].writer.waiting(); }
  void sent(std::size_t client, std::size_t bytes) { clients_[client].writer.sent(bytes); }
  /// The client has to be disconnected: its stream makes no sense, or it does not read the replies.
  bool broken(std::size_t client) const { return clients_[client].broken; }

  /// A control cycle: data packages of the present values for the clients that are due.
  void cycle();

  /// How often the field was written by a client.
  std::uint64_t writes(const Field& field) const { return writes_[field.slot]; }
  /// Clients to whom data are sent.
  std::size_t started() const;
  const ControllerStatistics& statistics() const { return statistics_; }

 private:
  static constexpr std::size_t kInputRecipes = 16;  // per client
  struct Client {
    bool connected = false, broken = false, started = false, has_outputs = false;
    int version = 1;
    double frequency = 125;  // Hz
    double phase = 0;        // cycles until the next data package, as a share of its period
    PackageReader reader;
    PackageWriter writer;
    Recipe outputs;
    std::array<Recipe, kInputRecipes> inputs;
    std::size_t input_recipes = 0;
  };

  void handle(std::size_t client, const PackageReader::Raw& package);
  void reply(Client& c, Package kind, bool accepted);
  void request_protocol(Client& c, std::span<const std::uint8_t> contents);
  void give_version(Client& c);
  void set_up_outputs(std::size_t client, std::span<const std::uint8_t> contents);
  void set_up_inputs(std::size_t client, std::span<const std::uint8_t> contents);
  bool read_names(std::size_t client, std::string_view names, bool inputs, Recipe& recipe);
  void read_inputs(Client& c, std::span<const std::uint8_t> contents);
  void apply(const Recipe& recipe);
  void say(Client& c, std::string_view text, Level level);

  ControllerSettings settings_;
  Directory directory_;
  Values values_;
  std::vector<std::uint64_t> writes_;  // by slot
  std::vector<int> owners_;            // by slot, of inputs: the client; −1: none
  std::array<Client, kClients> clients_;
  std::vector<char> types_;  // of a reply
  ControllerStatistics statistics_;
};

}  // namespace cotwin::rtde
