#include "components/gateway/access/local_user.h"

#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>

namespace cotwin::gateway::access {

namespace {

// The user of all whose user namespace knows no number for them.
constexpr std::uint32_t kNobody = 65534;

struct End {
  std::array<std::uint32_t, 4> address{};  // in network order; only the first one for IPv4
  std::uint16_t port = 0;                  // in network order
};

End end_of(const sockaddr& address) {
  End end;
  if (address.sa_family == AF_INET) {
    sockaddr_in v4{};
    std::memcpy(&v4, &address, sizeof v4);
    end.address[0] = v4.sin_addr.s_addr;
    end.port = v4.sin_port;
  } else {
    sockaddr_in6 v6{};
    std::memcpy(&v6, &address, sizeof v6);
    std::memcpy(end.address.data(), &v6.sin6_addr, sizeof v6.sin6_addr);
    end.port = v6.sin6_port;
  }
  return end;
}

struct Found {
  std::uint32_t user = kNobody;
  std::uint64_t inode = 0;  // 0: not found, or no process has the socket any more; the system calls its user 0 then, as root
};

/// sock_diag(7), one exact look-up. Nothing: there is no such socket, or the kernel does not answer such questions.
std::optional<Found> ask_kernel(int family, const End& peer, const End& own) {
  struct Question {
    nlmsghdr head;
    inet_diag_req_v2 body;
  } question{};
  question.head.nlmsg_len = sizeof question;
  question.head.nlmsg_type = SOCK_DIAG_BY_FAMILY;
  question.head.nlmsg_flags = NLM_F_REQUEST;
  question.body.sdiag_family = static_cast<std::uint8_t>(family);
  question.body.sdiag_protocol = IPPROTO_TCP;
  question.body.idiag_states = ~std::uint32_t{0};
  inet_diag_sockid& id = question.body.id;
  id.idiag_sport = peer.port;
  id.idiag_dport = own.port;
  std::memcpy(id.idiag_src, peer.address.data(), sizeof id.idiag_src);
  std::memcpy(id.idiag_dst, own.address.data(), sizeof id.idiag_dst);
  id.idiag_cookie[0] = id.idiag_cookie[1] = INET_DIAG_NOCOOKIE;
  const int socket = ::socket(AF_NETLINK, SOCK_DGRAM | SOCK_CLOEXEC, NETLINK_SOCK_DIAG);
  if (socket < 0) return std::nullopt;
  alignas(nlmsghdr) std::array<char, 4096> answer{};
  ssize_t size = ::send(socket, &question, sizeof question, 0);
  if (size == sizeof question) size = ::recv(socket, answer.data(), answer.size(), MSG_DONTWAIT);  // it is there already
  ::close(socket);
  nlmsghdr head{};
  if (size < static_cast<ssize_t>(sizeof head)) return std::nullopt;
  std::memcpy(&head, answer.data(), sizeof head);
  if (head.nlmsg_type != SOCK_DIAG_BY_FAMILY || size < static_cast<ssize_t>(NLMSG_LENGTH(sizeof(inet_diag_msg))))
    return std::nullopt;
  inet_diag_msg message{};
  std::memcpy(&message, answer.data() + NLMSG_HDRLEN, sizeof message);
  return Found{message.idiag_uid, message.idiag_inode};
}

/// As the columns local_address and rem_address have it: "0100007F:1F90".
std::string column(const End& end, std::size_t words, bool mapped) {
  std::string text = mapped ? "0000000000000000FFFF0000" : "";
  std::array<char, 16> part{};
  for (std::size_t i = 0; i < words; ++i) {
    std::snprintf(part.data(), part.size(), "%08X", end.address[i]);
    text += part.data();
  }
  std::snprintf(part.data(), part.size(), ":%04X", static_cast<unsigned>(ntohs(end.port)));
  return text + part.data();
}

/// proc_net_tcp: all sockets, line by line.
Found read_table(const char* file, const std::string& peer, const std::string& own) {
  std::ifstream in(file);
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream fields(line);
    std::string number, local, remote, skipped;
    Found found;
    if (!(fields >> number >> local >> remote) || local != peer || remote != own) continue;
    fields >> skipped >> skipped >> skipped >> skipped >> found.user >> skipped >> found.inode;
    return fields ? found : Found{};
  }
  return {};
}

Found read_tables(int family, const End& peer, const End& own) {
  if (family == AF_INET6) return read_table("/proc/net/tcp6", column(peer, 4, false), column(own, 4, false));
  const Found found = read_table("/proc/net/tcp", column(peer, 1, false), column(own, 1, false));
  // A client may reach an IPv4 address through a socket for IPv6.
  return found.inode != 0 ? found : read_table("/proc/net/tcp6", column(peer, 1, true), column(own, 1, true));
}

bool are_comparable(const sockaddr& a, const sockaddr& b) {
  return a.sa_family == b.sa_family && (a.sa_family == AF_INET || a.sa_family == AF_INET6);
}

std::optional<std::uint32_t> user_of(const Found& found) {
  if (found.inode == 0 || found.user == kNobody) return std::nullopt;
  return found.user;
}

}  // namespace

std::optional<std::uint32_t> user_at(const sockaddr& peer, const sockaddr& own) {
  static std::atomic<bool> kernel_answers = false;
  if (!are_comparable(peer, own)) return std::nullopt;
  const std::optional<Found> found = ask_kernel(peer.sa_family, end_of(peer), end_of(own));
  if (found) kernel_answers = true;
  // Where it does, the tables are not read for each client that hangs up: they can be long.
  if (found || kernel_answers) return user_of(found.value_or(Found{}));
  return user_in_tables(peer, own);
}

std::optional<std::uint32_t> user_in_tables(const sockaddr& peer, const sockaddr& own) {
  if (!are_comparable(peer, own)) return std::nullopt;
  return user_of(read_tables(peer.sa_family, end_of(peer), end_of(own)));
}

}  // namespace cotwin::gateway::access
