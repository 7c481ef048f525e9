#pragma once
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/patience.h"

extern char** environ;

/// The MQTT broker Mosquitto on a free port of 127.0.0.1, for tests.
namespace cotwin::testing {

inline std::string mosquitto_program() {
  for (const char* file : {"/usr/sbin/mosquitto", "/usr/bin/mosquitto", "/usr/local/sbin/mosquitto"}) {
    if (std::filesystem::exists(file)) return file;
  }
  return "";
}

/// A TCP port at which nobody listens: that of a socket that was bound to 0 and is closed.
inline std::uint16_t free_tcp_port() {
  const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in a = {};
  a.sin_family = AF_INET;
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof a;
  const bool bound = ::bind(s, reinterpret_cast<sockaddr*>(&a), sizeof a) == 0 &&
                     ::getsockname(s, reinterpret_cast<sockaddr*>(&a), &size) == 0;
  ::close(s);
  if (!bound) throw std::runtime_error("no free TCP port");
  return ntohs(a.sin_port);
}

inline bool listens(std::uint16_t port) {
  const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in to = {};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const bool there = ::connect(s, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
  ::close(s);
  return there;
}

class Mosquitto {
 public:
  /// `more`: further lines of the configuration. Does not start.
  explicit Mosquitto(std::filesystem::path folder, std::string more = "allow_anonymous true\n")
      : folder_(std::move(folder)), more_(std::move(more)), port_(free_tcp_port()) {}
  ~Mosquitto() { kill(); }
  Mosquitto(const Mosquitto&) = delete;
  Mosquitto& operator=(const Mosquitto&) = delete;

  std::uint16_t port() const { return port_; }
  std::string url(const std::string& scheme = "mqtt") const { return scheme + "://127.0.0.1:" + std::to_string(port_); }
  bool start() {
    const std::filesystem::path file = folder_ / "mosquitto.conf";
    std::ofstream(file) << "listener " << port_ << " 127.0.0.1\n" << more_ << "log_dest none\n";
    const std::string program = mosquitto_program(), name = file.string();
    std::vector<char*> arguments{const_cast<char*>(program.c_str()), const_cast<char*>("-c"), const_cast<char*>(name.c_str()),
                                 nullptr};
    if (::posix_spawn(&process_, program.c_str(), nullptr, nullptr, arguments.data(), environ) != 0) return false;
    return within_patience([&] { return listens(port_) || ::waitpid(process_, nullptr, WNOHANG) != 0; }) && listens(port_);
  }
  void kill() { send(SIGKILL, true); }
  /// It reads nothing until resume().
  void freeze() { send(SIGSTOP, false); }
  void resume() { send(SIGCONT, false); }

 private:
  void send(int signal, bool ends) {
    if (process_ <= 0) return;
    ::kill(process_, signal);
    if (!ends) return;
    ::waitpid(process_, nullptr, 0);
    process_ = 0;
  }
  std::filesystem::path folder_;
  std::string more_;
  std::uint16_t port_;
  pid_t process_ = 0;
};

}  // namespace cotwin::testing
