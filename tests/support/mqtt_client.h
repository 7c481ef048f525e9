#pragma once
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>

#include "tests/support/patience.h"

/// A client of MQTT 5 over TCP that subscribes to all topics, for tests. Paho, which the gateway uses, has one thread for all clients
/// of a process, so that a second one connects two seconds late.
namespace cotwin::testing {

class MqttClient {
 public:
  struct Message {
    std::string topic, payload, correlation;
    bool retained = false;
  };

  /// Connects and subscribes. Throws std::runtime_error if the broker refuses either.
  MqttClient(std::uint16_t port, const std::string& name) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in to = {};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const bool there = ::connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
    constexpr char kCleanStart = 2;
    write(0x10, text("MQTT") + std::string{5, kCleanStart, 0, 60, 0} + text(name));
    Packet accepted = read(), granted;
    if (accepted.type == 0x20) {
      write(0x82, std::string{0, 1, 0} + text("#") + std::string(1, kQos));
      granted = read();
    }
    if (!there || accepted.body.size() < 2 || accepted.body[1] != 0 || granted.type != 0x90 || granted.body.back() != kQos) {
      ::close(socket_);
      throw std::runtime_error("the broker refuses the connection or the subscription");
    }
    reader_ = std::thread([this] { receive(); });
  }
  ~MqttClient() {
    write(0xe0, "");
    ::shutdown(socket_, SHUT_RDWR);
    reader_.join();
    ::close(socket_);
  }
  MqttClient(const MqttClient&) = delete;
  MqttClient& operator=(const MqttClient&) = delete;

  /// With quality of service 1; returns when the broker has it.
  void send(const std::string& topic, const std::string& payload, const std::string& reply_to = "", bool retained = false,
            const std::string& correlation = "") {
    std::string properties;
    if (!reply_to.empty()) properties += "\x08" + text(reply_to);
    if (!correlation.empty()) properties += "\x09" + text(correlation);
    const std::size_t before = acknowledged();
    write(static_cast<char>(0x32 | (retained ? 1 : 0)),
          text(topic) + std::string{0, 2} + length(properties.size()) + properties + payload);
    within_patience([&] { return acknowledged() > before || ended(); });
  }
  /// The first message at the topic whose payload has the text; removes it and those before it at this topic. Empty: none came.
  std::optional<Message> next(const std::string& topic, const std::string& part = "") {
    std::optional<Message> found;
    within_patience([&] {
      const std::lock_guard lock(mutex_);
      for (auto m = messages_.begin(); m != messages_.end() && !found;) {
        const bool here = m->topic == topic;
        if (here && m->payload.find(part) != std::string::npos) found = *m;
        m = here ? messages_.erase(m) : std::next(m);
      }
      return found.has_value();
    });
    return found;
  }
  std::size_t count(const std::string& topic) {
    const std::lock_guard lock(mutex_);
    return static_cast<std::size_t>(std::ranges::count_if(messages_, [&](const Message& m) { return m.topic == topic; }));
  }

 private:
  static constexpr char kQos = 1;
  struct Packet {
    unsigned type = 0;  // 0: the connection has ended
    std::string body;
  };
  static std::string text(const std::string& s) {
    return std::string{static_cast<char>(s.size() >> 8), static_cast<char>(s.size())} + s;
  }
  static std::string length(std::size_t n) {
    std::string bytes;
    do {
      bytes += static_cast<char>((n & 0x7f) | (n > 0x7f ? 0x80 : 0));
      n >>= 7;
    } while (n > 0);
    return bytes;
  }
  void write(unsigned type, const std::string& body) {
    const std::string all = std::string(1, static_cast<char>(type)) + length(body.size()) + body;
    const std::lock_guard lock(writing_);
    for (std::size_t at = 0; at < all.size();) {
      const ssize_t n = ::send(socket_, all.data() + at, all.size() - at, MSG_NOSIGNAL);
      if (n <= 0) return;
      at += static_cast<std::size_t>(n);
    }
  }
  Packet read() {
    const auto bytes = [&](char* to, std::size_t n) {
      return n == 0 || ::recv(socket_, to, n, MSG_WAITALL) == static_cast<ssize_t>(n);
    };
    char byte = 0;
    if (!bytes(&byte, 1)) return {};
    Packet packet;
    packet.type = static_cast<unsigned char>(byte);
    std::size_t size = 0;
    for (unsigned shift = 0; shift == 0 || (byte & 0x80) != 0; shift += 7) {
      if (!bytes(&byte, 1)) return {};
      size |= static_cast<std::size_t>(byte & 0x7f) << shift;
    }
    packet.body.resize(size);
    return bytes(packet.body.data(), size) ? packet : Packet{};
  }
  static std::size_t number(std::string_view& from, int bytes) {
    std::size_t n = 0;
    for (; bytes > 0; --bytes, from.remove_prefix(1)) n = n << 8 | static_cast<unsigned char>(from[0]);
    return n;
  }
  static std::string_view take(std::string_view& from, std::size_t size) {
    const std::string_view part = from.substr(0, size);
    from.remove_prefix(size);
    return part;
  }
  void receive() {
    for (Packet packet = read(); packet.type != 0; packet = read()) {
      std::string_view rest = packet.body;
      if (packet.type >> 4 == 4) {
        const std::lock_guard lock(mutex_);
        ++acknowledged_;
      }
      if (packet.type >> 4 != 3) continue;
      Message m;
      m.retained = (packet.type & 1) != 0;
      m.topic = take(rest, number(rest, 2));
      if ((packet.type & 6) != 0) write(0x40, std::string(take(rest, 2)));
      std::size_t size = 0;
      for (unsigned shift = 0;; shift += 7) {
        const std::size_t byte = number(rest, 1);
        size |= (byte & 0x7f) << shift;
        if (byte < 0x80) break;
      }
      // Properties with a text or bytes (MQTT 5, 2.2.2): only these come from the gateway.
      for (std::string_view properties = take(rest, size); !properties.empty();) {
        const std::size_t identifier = number(properties, 1);
        const std::string_view value = take(properties, number(properties, 2));
        if (identifier == 9) m.correlation = value;
      }
      m.payload = rest;
      const std::lock_guard lock(mutex_);
      messages_.push_back(std::move(m));
    }
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  std::size_t acknowledged() {
    const std::lock_guard lock(mutex_);
    return acknowledged_;
  }
  bool ended() {
    const std::lock_guard lock(mutex_);
    return ended_;
  }

  int socket_;
  std::mutex mutex_, writing_;
  std::deque<Message> messages_;
  std::size_t acknowledged_ = 0;
  bool ended_ = false;
  std::thread reader_;
};

}  // namespace cotwin::testing
