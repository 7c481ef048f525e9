#include "components/shared_states/shared_states.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::shared_states {

namespace {

const char* const kPlace = "unit:shared_states";
constexpr std::uint16_t kPort = 30260;        // if an address has none; FRI has 30200
constexpr std::int64_t kRepeat = 50'000'000;  // ns until a request is repeated while initialise waits

std::optional<FieldValues> values_of(Settings& settings, const std::string& key) {
  const std::string text = settings.text(key);
  if (text.empty()) return std::nullopt;
  return FieldValues(bus::StateLayout::parse(text, std::string(kPlace) + "?" + key));
}

std::optional<bus::StateLayout> layout_of(const std::optional<FieldValues>& values) {
  return values ? std::optional(values->layout()) : std::nullopt;
}

}  // namespace

void SharedStates::declare_settings(SettingList& s) {
  s.text("publish", "",
         "states that are sent, inputs of the unit: NAME:SIZE:MEASURE, separated by commas, as q:7:rad,gain,mode:1:integer; "
         "SIZE is "
         "1 and MEASURE 1 if left out, MEASURE may be integer or boolean");
  s.text("subscribe", "", "states that are received, outputs of the unit: the same text as publish of the peer");
}

SharedStates::SharedStates(Settings& settings)
    : published_(values_of(settings, "publish")), subscribed_(values_of(settings, "subscribe")) {
  if (!published_ && !subscribed_)
    throw MissingSetting(std::string(kPlace) + ": neither publish nor subscribe, expected at least one, as publish=q:7:rad");
  if (!published_ || !subscribed_) return;
  for (const bus::StateField& sent : published_->layout().fields()) {
    for (const bus::StateField& received : subscribed_->layout().fields()) {
      if (sent.name == received.name)
        throw Error(kPlace, "'" + sent.name + "' is published and subscribed, expected different names");
    }
  }
}

void SharedStates::declare(Variables& v) {
  if (published_) published_->declare_inputs(v);
  if (subscribed_) subscribed_->declare_outputs(v);
  v.parameter("listen", listen_, "own address and UDP port, IPv4; 0.0.0.0: every address of this machine; port 0: a free one");
  v.parameter("peer", peer_, "address and UDP port of the peer; datagrams of others are ignored");
  v.parameter("timeout", timeout_, "s", "the peer is connected until it has been silent for this long").range(0, 1e9);
  v.parameter("wait", wait_, "s", "longest time, of the wall clock, that the start waits for the peer's states; 0: it does not")
      .range(0, 1e6);
  v.output("connected", connected_, "whether states of the peer arrived within timeout; false without subscribe");
  v.output("fresh", fresh_, "whether states of the peer arrived since the last step");
  v.output("age", age_, "s", "time of the scenario since states of the peer arrived last").discrete();
  v.output("peer_time", peer_time_, "s", "time of the peer's scenario at which it published these states").discrete();
  v.output("updates", updates_, "1", "number of updates of the peer that were applied").discrete();
  v.output("recoveries", recoveries_, "1", "number of full copies of the peer's states: at the start and after losses")
      .discrete();
  v.output("missed", missed_, "1", "number of changes of the peer's states that were lost and replaced by full copies")
      .discrete();
  v.output("old", old_, "1", "number of messages that came twice or after later ones").discrete();
  v.output("refused", refused_, "1", "number of messages of a peer with other states or another wire format").discrete();
  v.output("sent", sent_, "1", "number of datagrams sent").discrete();
  v.output("sent_bytes", sent_bytes_, "1", "number of bytes in them").discrete();
  v.output("received", received_, "1", "number of datagrams received from the peer").discrete();
  v.output("received_bytes", received_bytes_, "1", "number of bytes in them").discrete();
  v.output("unsent", unsent_, "1", "number of datagrams that the system did not take").discrete();
  v.output("foreign", foreign_, "1", "number of datagrams of other senders, ignored").discrete();
  v.output("damaged", damaged_, "1", "number of datagrams and messages of the peer that are damaged, ignored").discrete();
  v.output("warning", warning_, "warnings for the summary of the run; empty: none");
  v.output("restarts", restarts_, "1", "number of times that the peer was started again").discrete();
}

void SharedStates::open() {
  const net::Endpoint peer = net::endpoint_of(peer_, kPort, std::string(kPlace) + ".peer");
  const net::Endpoint local = net::endpoint_of(listen_, kPort, std::string(kPlace) + ".listen");
  if (!transport_ || address_ != listen_) {
    transport_.reset();
    transport_ = std::make_unique<bus::UdpTransport>(local, peer, std::string(kPlace) + ".listen");
  }
  address_ = listen_;
  peer_address_ = peer_;
  transport_->restart(peer);
}

// Calls after a step are new starts: the peer sees an owner that was started again.
void SharedStates::initialise(Time start) {
  if (initialised_ == start && address_ == listen_ && peer_address_ == peer_) {
    if (!published_) return;
    published_->write_to(exchange_->owner()->image());
    exchange_->publish(start.ns);
    return;
  }
  initialised_.reset();
  open();
  exchange_.reset();
  try {
    exchange_.emplace(*transport_, layout_of(published_), layout_of(subscribed_));
  } catch (const Error& error) {
    throw Error(kPlace, error.what());
  }
  connected_ = fresh_ = arrived_ = false;
  age_ = peer_time_ = 0;
  warning_.clear();
  if (published_) {
    published_->write_to(exchange_->owner()->image());
    exchange_->publish(start.ns);
  }
  if (subscribed_ && wait_ > 0) await_peer();
  receive();
  write_outputs();
  initialised_ = start;
}

void SharedStates::await_peer() {
  const std::int64_t deadline = bus::monotonic_ns() + Duration::from_seconds(wait_).ns;
  while (!exchange_->replica()->complete()) {
    const std::int64_t now = bus::monotonic_ns();
    if (now >= deadline) {
      throw Error(kPlace, "no states of the peer " + peer_ + " within " + text::to_text(wait_, 3) +
                              " s, expected a run that publishes '" + subscribed_->layout().text() + "' to " +
                              net::to_text(transport_->local()));
    }
    exchange_->request();
    transport_->wait(std::min(deadline, now + kRepeat));
    receive();
  }
}

void SharedStates::receive() {
  arrived_ |= exchange_->receive();
  const bus::StateExchange::Counts& c = exchange_->counts();
  if (c.other_layout + c.other_format > 0) refuse_other_layout();
  if (subscribed_ && exchange_->replica()->returns() > 0) warn_of_two_owners();
}

/// What differs between the peer and this unit; empty as long as it is not known.
std::string SharedStates::mismatch() const {
  if (exchange_->counts().other_format > 0) return "uses another wire format, expected the same version of Cotwin";
  const bus::StateReplica* const replica = exchange_->replica();
  if (replica != nullptr && !replica->other_layout().empty())
    return "publishes '" + replica->other_layout() + "', expected '" + replica->layout().text() + "' (setting subscribe)";
  return "";
}

void SharedStates::warn_of_two_owners() {
  if (!warning_.empty()) return;
  warning_ = "the peer " + peer_ + " came back to an earlier start, expected one program that publishes from this address";
}

// A peer with other states is an error before the first states of the right ones. Later it may be a program that was started by
// mistake: the states are held.
void SharedStates::refuse_other_layout() {
  const bus::StateReplica* const replica = exchange_->replica();
  if (replica != nullptr && !replica->complete()) {
    if (const std::string what = mismatch(); !what.empty()) throw Error(kPlace, "the peer " + peer_ + " " + what);
  }
  if (!warning_.empty()) return;
  if (const std::string& expected = exchange_->expected_layout(); !expected.empty()) {
    warning_ = "the peer " + peer_ + " expects '" + expected + "', but '" +
               (published_ ? published_->layout().text() : std::string()) + "' is published";
  } else if (const std::string what = mismatch(); !what.empty()) {
    warning_ = "the peer " + peer_ + " " + what;
  }
}

StepResult SharedStates::step(Time now, Duration h) {
  initialised_.reset();
  if (published_) {
    published_->write_to(exchange_->owner()->image());
    exchange_->publish(now.ns);
  }
  receive();
  age_ = arrived_ ? 0 : age_ + h.seconds();
  write_outputs();
  return StepResult::kDone;
}

void SharedStates::write_outputs() {
  const bus::StateExchange::Counts& c = exchange_->counts();
  const bus::UdpTransport::Counts& udp = transport_->counts();
  const auto number = [](std::uint64_t n) { return static_cast<double>(n); };
  fresh_ = arrived_;
  arrived_ = false;
  if (const bus::StateReplica* const replica = exchange_->replica()) {
    if (fresh_) subscribed_->read_from(replica->image());
    connected_ = replica->complete() && age_ <= timeout_;
    peer_time_ = Time{replica->epoch()}.seconds();
    missed_ = number(replica->missed());
    restarts_ = number(replica->restarts());
  }
  updates_ = number(c.updates);
  recoveries_ = number(c.copies);
  old_ = number(c.old);
  refused_ = number(c.other_layout + c.other_format);
  sent_ = number(udp.sent);
  sent_bytes_ = number(udp.sent_bytes);
  received_ = number(udp.received);
  received_bytes_ = number(udp.received_bytes);
  unsent_ = number(udp.unsent);
  foreign_ = number(udp.foreign);
  damaged_ = number(udp.damaged + c.damaged);
}

std::optional<Arrival> SharedStates::wait(std::int64_t deadline) {
  const auto datagrams = [this] { return transport_->counts().received + transport_->counts().foreign; };
  for (bool waited = false;; waited = true) {
    const std::uint64_t before = datagrams();
    if (exchange_->receive()) {
      arrived_ = true;
      return Arrival{bus::monotonic_ns(), exchange_->replica()->epoch()};
    }
    const bool interrupted = waited && datagrams() == before;
    if (interrupted || (waited && bus::monotonic_ns() >= deadline) || !transport_->wait(deadline)) return std::nullopt;
  }
}

void SharedStates::append_notes(std::vector<std::string>& sentences) const {
  if (!exchange_) return;
  if (subscribed_) {
    sentences.push_back("states of the peer " + peer_ + ": " + text::to_text(updates_, 12) + " updates, " +
                        text::to_text(recoveries_, 12) + " full copies, " + text::to_text(missed_, 12) + " changes missed" +
                        (restarts_ > 0 ? ", " + text::to_text(restarts_, 12) + " restarts" : "") +
                        (connected_ ? "" : "; it was silent at the end"));
  }
  if (published_) {
    const bus::StateExchange::Counts& c = exchange_->counts();
    sentences.push_back(
        "published to the peer " + peer_ + ": " + std::to_string(c.published) + " updates of " +
        text::to_text(static_cast<double>(c.published_bytes) / static_cast<double>(std::max<std::uint64_t>(c.published, 1)),
                      4) +
        " bytes on average, " + std::to_string(c.copies_sent) + " full copies");
  }
}

}  // namespace cotwin::shared_states
