#include "components/gateway/mqtt/broker_session.h"

#include <mqtt/async_client.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "components/gateway/access/certificate.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::mqtt {

namespace {

constexpr std::chrono::seconds kConnectTimeout{5}, kKeepAlive{10};
constexpr std::chrono::milliseconds kDisconnectTimeout{500};
constexpr int kMostInFlight = 32;
constexpr std::uint32_t kWillDelay = 5;  // s: a short interruption is not reported

/// "tcp://…" or "ssl://…", as Paho calls them.
std::string server_of(const BrokerOptions& o) {
  const bool tls = o.url.starts_with("mqtts://");
  if (!tls && !o.url.starts_with("mqtt://"))
    throw Error(o.place, "broker '" + o.url + "', expected mqtt://HOST:PORT or mqtts://HOST:PORT");
  const std::string address = o.url.substr(o.url.find("//") + 2);
  const std::size_t colon = address.rfind(':');
  const std::string host = address.substr(0, colon);
  const long long port = colon == std::string::npos ? 0 : text::parse_integer(address.substr(colon + 1)).value_or(0);
  if (host.empty() || address.find_first_of("/@ ") != std::string::npos || port < 1 || port > 65535)
    throw Error(o.place, "broker '" + o.url + "', expected " + (tls ? "mqtts" : "mqtt") + "://HOST:PORT");
  const bool local = host == "localhost" || host == "[::1]" || host == "127.0.0.1";
  if (!tls && !local) throw Error(o.place, "broker '" + o.url + "' is on another machine, expected TLS for it (mqtts://)");
  if (o.certificate.empty() != o.key.empty())
    throw Error(o.place, "certificate and key of the MQTT client must be given together, expected both or neither");
  return (tls ? "ssl://" : "tcp://") + address;
}

}  // namespace

struct BrokerSession::Impl final : ::mqtt::iaction_listener {
  Impl(const BrokerOptions& options, Message will, std::function<void(Event)> given)
      : sink(std::move(given)), client(server_of(options), options.client_id, ::mqtt::create_options(MQTTVERSION_5)) {
    connecting.set_mqtt_version(MQTTVERSION_5);
    connecting.set_clean_start(true);  // commands that came while the gateway was away are not carried out late
    connecting.set_keep_alive_interval(kKeepAlive);
    connecting.set_connect_timeout(kConnectTimeout);
    connecting.set_max_inflight(kMostInFlight);
    connecting.set_properties({{::mqtt::property::MAXIMUM_PACKET_SIZE, static_cast<std::int32_t>(kLargestPacket)}});
    ::mqtt::will_options last(::mqtt::message(will.topic, will.payload.data(), will.payload.size(), will.qos, will.retained));
    last.set_properties({{::mqtt::property::WILL_DELAY_INTERVAL, static_cast<std::int32_t>(kWillDelay)}});
    connecting.set_will(last);
    if (!options.login.empty()) read_login(options.login);
    if (options.url.starts_with("mqtts://")) {
      ::mqtt::ssl_options tls;
      if (!options.authority.empty()) tls.set_trust_store(options.authority.string());
      if (!options.certificate.empty()) {
        (void)access::load_certificate(options.certificate, options.key, utc_now());
        tls.set_key_store(options.certificate.string());
        tls.set_private_key(options.key.string());
      }
      tls.set_ssl_version(MQTT_SSL_VERSION_TLS_1_2);
      tls.set_enable_server_cert_auth(true);
      tls.set_verify(true);
      connecting.set_ssl(tls);
    }
    client.set_connection_lost_handler([this](const std::string& cause) { report(Event::Kind::kLost, 0, cause); });
    client.set_disconnected_handler([this](const ::mqtt::properties&, ::mqtt::ReasonCode code) {
      report(Event::Kind::kLost, 0, "the broker closed the connection, reason " + std::to_string(static_cast<int>(code)));
    });
    client.set_message_callback([this](const ::mqtt::const_message_ptr& m) {
      Event event;
      event.kind = Event::Kind::kMessage;
      Message& message = event.message;
      message.topic = m->get_topic();
      message.payload = m->to_string();
      message.qos = m->get_qos();
      message.retained = m->is_retained();
      const ::mqtt::properties& properties = m->get_properties();
      if (properties.contains(::mqtt::property::RESPONSE_TOPIC))
        message.response_topic = ::mqtt::get<std::string>(properties, ::mqtt::property::RESPONSE_TOPIC);
      if (properties.contains(::mqtt::property::CORRELATION_DATA))
        message.correlation = ::mqtt::get<std::string>(properties, ::mqtt::property::CORRELATION_DATA);
      sink(std::move(event));
    });
  }

  void read_login(const std::filesystem::path& file) {
    const std::string content = access::read_secret(file, "user and password");
    const std::size_t end = content.find('\n');
    if (end == std::string::npos) throw Error(file.string(), "has one line, expected two: the user and the password");
    const std::string_view user = text::trim(std::string_view(content).substr(0, end));
    std::string_view password = std::string_view(content).substr(end + 1);
    while (!password.empty() && (password.back() == '\n' || password.back() == '\r')) password.remove_suffix(1);
    if (user.empty() || password.empty() || password.find('\n') != std::string_view::npos)
      throw Error(file.string(), "expected two lines: the user and the password");
    connecting.set_user_name(std::string(user));
    connecting.set_password(std::string(password));
  }

  void report(Event::Kind kind, std::uint64_t number, const std::string& text) { sink({kind, number, text, {}}); }
  /// Paho calls it a success if the broker refuses topics, and throws if that is the first one.
  static bool refused(const ::mqtt::token& token) {
    try {
      return std::ranges::any_of(token.get_subscribe_response().get_reason_codes(),
                                 [](::mqtt::ReasonCode code) { return static_cast<int>(code) >= 0x80; });
    } catch (const ::mqtt::exception&) {
      return true;
    }
  }
  void on_success(const ::mqtt::token& token) override { end(token, true); }
  void on_failure(const ::mqtt::token& token) override { end(token, false); }
  void end(const ::mqtt::token& token, bool good) {
    const auto number = static_cast<std::uint64_t>(reinterpret_cast<std::uintptr_t>(token.get_user_context()));
    const int reason = static_cast<int>(token.get_reason_code());
    const std::string code = "(return code " + std::to_string(token.get_return_code()) + ")";
    const std::string text = good          ? ""
                             : reason != 0 ? "the broker answered with reason code " + std::to_string(reason)
                             : token.get_type() == ::mqtt::token::CONNECT ? "no broker answers " + code
                                                                          : "the broker did not take it " + code;
    switch (token.get_type()) {
      case ::mqtt::token::CONNECT:
        return report(good ? Event::Kind::kConnected : Event::Kind::kLost, 0, text);
      case ::mqtt::token::SUBSCRIBE:
        if (!good || refused(token)) report(Event::Kind::kRefused, 0, good ? "the broker refused a subscription" : text);
        return;
      case ::mqtt::token::PUBLISH:
        return report(good ? Event::Kind::kDelivered : Event::Kind::kUndelivered, number, text);
      default:
        return;
    }
  }

  std::function<void(Event)> sink;
  ::mqtt::connect_options connecting;
  ::mqtt::async_client client;
};

BrokerSession::BrokerSession(const BrokerOptions& options, Message will, std::function<void(Event)> sink)
    : impl_(std::make_unique<Impl>(options, std::move(will), std::move(sink))) {}

BrokerSession::~BrokerSession() = default;

void BrokerSession::connect() {
  try {
    impl_->client.connect(impl_->connecting, nullptr, *impl_);
  } catch (const ::mqtt::exception& error) {
    impl_->report(Event::Kind::kLost, 0, error.what());
  }
}

bool BrokerSession::publish(std::uint64_t number, const Message& m) {
  try {
    ::mqtt::properties properties;
    if (!m.correlation.empty()) properties.add({::mqtt::property::CORRELATION_DATA, m.correlation});
    const auto message = ::mqtt::message::create(m.topic, m.payload.data(), m.payload.size(), m.qos, m.retained, properties);
    impl_->client.publish(message, reinterpret_cast<void*>(static_cast<std::uintptr_t>(number)), *impl_);
    return true;
  } catch (const ::mqtt::exception&) {
    return false;
  }
}

void BrokerSession::subscribe(const std::vector<std::string>& topics) {
  try {
    // As published: else the broker hides the retain flag of messages that come while the session lasts. One by one, because Paho's
    // call for several topics reads options that it has freed.
    const ::mqtt::subscribe_options as_published(false, true);
    for (const std::string& topic : topics) impl_->client.subscribe(topic, 1, nullptr, *impl_, as_published);
  } catch (const ::mqtt::exception& error) {
    impl_->report(Event::Kind::kRefused, 0, error.what());
  }
}

bool BrokerSession::open() const { return impl_->client.is_connected(); }

void BrokerSession::disconnect() noexcept {
  try {
    if (impl_->client.is_connected()) impl_->client.disconnect(kDisconnectTimeout)->wait_for(2 * kDisconnectTimeout);
  } catch (const std::exception&) {
    // The connection is lost already.
  }
}

}  // namespace cotwin::gateway::mqtt
