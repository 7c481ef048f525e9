#pragma once
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// A client that sends any bytes to a server at 127.0.0.1, for tests.
namespace cotwin::testing {

struct HttpReply {
  int status = 0;  // 0: the server closed the connection without one
  std::vector<std::pair<std::string, std::string>> fields;
  std::string body;

  /// The value of a header field, in the case in which the server writes it; "" if there is none.
  std::string field(std::string_view name) const {
    for (const auto& [key, value] : fields) {
      if (key == name) return value;
    }
    return "";
  }
};

class RawClient {
 public:
  static constexpr int kPatience = 60'000;  // ms

  explicit RawClient(std::uint16_t port, int receive_buffer = 0) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    if (receive_buffer > 0) ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in to = {};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof to) != 0) throw std::runtime_error("connect failed");
  }
  ~RawClient() { ::close(socket_); }
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  /// False: the server closed the connection.
  bool send(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return false;
      bytes.remove_prefix(static_cast<std::size_t>(n));
    }
    return true;
  }
  /// Adds what arrives to received(). False: the connection is closed, or nothing came for kPatience.
  bool receive() {
    pollfd wait = {socket_, POLLIN, 0};
    if (::poll(&wait, 1, kPatience) <= 0) return false;
    char bytes[65536];
    const ssize_t n = ::recv(socket_, bytes, sizeof bytes, 0);
    if (n <= 0) return false;
    received_.append(bytes, static_cast<std::size_t>(n));
    return true;
  }
  /// Receives until the text has arrived. False: it did not.
  bool receive_until(std::string_view text) {
    while (received_.find(text) == std::string::npos) {
      if (!receive()) return false;
    }
    return true;
  }
  /// Receives the next response; removes it from received().
  HttpReply reply(bool head = false) {
    HttpReply all;
    if (!receive_until("\r\n\r\n")) return all;
    const std::size_t end = received_.find("\r\n\r\n");
    const std::string header = received_.substr(0, end);
    received_.erase(0, end + 4);
    all.status = std::stoi(header.substr(9, 3));
    std::size_t length = 0;
    for (std::size_t at = header.find("\r\n"); at != std::string::npos;) {
      const std::size_t next = header.find("\r\n", at + 2);
      const std::string line = header.substr(at + 2, next == std::string::npos ? next : next - at - 2);
      const std::size_t colon = std::min(line.find(": "), line.size());
      all.fields.emplace_back(line.substr(0, colon), colon + 2 <= line.size() ? line.substr(colon + 2) : "");
      if (all.fields.back().first == "Content-Length") length = std::stoul(all.fields.back().second);
      at = next;
    }
    while (!head && received_.size() < length && receive()) {
    }
    if (!head) {
      all.body = received_.substr(0, length);
      received_.erase(0, length);
    }
    return all;
  }
  /// Whether the server has closed the connection, or does so within kPatience.
  bool ended() {
    while (receive()) {
    }
    pollfd wait = {socket_, POLLIN, 0};
    return ::poll(&wait, 1, 0) > 0;
  }
  std::string& received() { return received_; }
  int descriptor() const { return socket_; }

 private:
  int socket_;
  std::string received_;
};

/// A request with Host and, if there is a body, its length and type.
inline std::string http_request(const std::string& method, const std::string& target, const std::string& body = "",
                                const std::string& fields = "") {
  std::string text = method + " " + target + " HTTP/1.1\r\nHost: localhost\r\n" + fields;
  if (!body.empty() || method == "POST" || method == "PUT") {
    text += "Content-Length: " + std::to_string(body.size()) + "\r\n";
    if (!body.empty() && fields.find("Content-Type") == std::string::npos) text += "Content-Type: application/json\r\n";
  }
  return text + "\r\n" + body;
}

/// One request on a connection of its own.
inline HttpReply http_call(std::uint16_t port, const std::string& method, const std::string& target,
                           const std::string& body = "", const std::string& fields = "") {
  RawClient client(port);
  client.send(http_request(method, target, body, fields));
  return client.reply(method == "HEAD");
}

}  // namespace cotwin::testing
