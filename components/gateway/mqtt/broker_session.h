#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace cotwin::gateway::mqtt {

/// How to reach the broker.
struct BrokerOptions {
  std::string url;                  // mqtt://host:1883 or mqtts://host:8883; without TLS only at 127.0.0.1, ::1 and localhost
  std::string client_id;            // unique at the broker
  std::filesystem::path login;      // file of two lines, user and password, mode 600; empty: none
  std::filesystem::path authority;  // TLS: PEM of the authorities that are trusted; empty: the system's
  std::filesystem::path certificate, key;  // TLS: the client's own, PEM; both or neither
  std::string place = "gateway";           // in messages
};

/// A connection to an MQTT 5 broker through Paho. No function waits for the broker, except disconnect() and the destructor.
class BrokerSession {
 public:
  struct Message {
    std::string topic, payload;
    int qos = 0;
    bool retained = false;
    std::string response_topic, correlation;  // of a request
  };
  struct Event {
    enum class Kind : std::uint8_t {
      kConnected,
      kLost,         // the connection, or an attempt to get one
      kDelivered,    // the message `number`: to the broker (QoS 1), or to the socket (QoS 0)
      kUndelivered,  // likewise
      kRefused,      // a subscription
      kMessage
    };
    Kind kind = Kind::kLost;
    std::uint64_t number = 0;
    std::string text;  // why
    Message message;
  };

  static constexpr std::uint32_t kLargestPacket = (1 << 20) + (1 << 16);  // bytes; the broker sends no larger one

  /// `sink` is called on Paho's threads and must not wait. `will`: published by the broker when the connection is lost. Throws Error for
  /// options that are not permitted and files that cannot be read.
  BrokerSession(const BrokerOptions& options, Message will, std::function<void(Event)> sink);
  ~BrokerSession();
  BrokerSession(const BrokerSession&) = delete;
  BrokerSession& operator=(const BrokerSession&) = delete;

  /// kConnected or kLost follows.
  void connect();
  /// False: not now. Otherwise kDelivered or kUndelivered follows, unless the connection is lost.
  bool publish(std::uint64_t number, const Message& message);
  void subscribe(const std::vector<std::string>& topics);
  /// Whether Paho still holds a connection, also one that disconnect() has not closed yet. Must be false before connect().
  bool open() const;
  /// Closes the connection in order, so that the broker does not publish the will. Waits for at most a second.
  void disconnect() noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::gateway::mqtt
