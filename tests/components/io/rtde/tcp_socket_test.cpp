#include "models/foundation/net/tcp_socket.h"

#include <gtest/gtest.h>
#include <poll.h>

#include <array>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::net::tcp_socket_test {
namespace {

const Endpoint kAny{0x7f000001, 0};

bool ready(int descriptor, short events) {
  pollfd wait{descriptor, events, 0};
  return ::poll(&wait, 1, 10'000) == 1;
}

struct Line {
  TcpListener listener{kAny, "test"};
  TcpStream client = TcpStream::connect(listener.local());
  std::optional<TcpStream> server;

  Line() {
    if (ready(listener.descriptor(), POLLIN)) server = listener.accept();
  }
};

std::span<const std::uint8_t> view(const char* text) {
  return {reinterpret_cast<const std::uint8_t*>(text), std::strlen(text)};
}

TEST(TcpSocket, CarriesBytesBothWaysWithoutBlockingOrAllocating) {
  Line line;
  ASSERT_TRUE(line.server);
  ASSERT_TRUE(ready(line.client.descriptor(), POLLOUT));
  ASSERT_EQ(line.client.state(), TcpStream::State::kOpen);
  EXPECT_FALSE(line.listener.accept());
  std::array<std::uint8_t, 16> buffer;
  const std::uint64_t before = testing::allocations();
  EXPECT_EQ(line.client.receive(buffer), 0u);
  EXPECT_EQ(line.client.send(view("robot")), 5u);
  EXPECT_TRUE(ready(line.server->descriptor(), POLLIN));
  EXPECT_EQ(line.server->receive(buffer), 5u);
  EXPECT_EQ(line.server->send(view("twin")), 4u);
  EXPECT_TRUE(ready(line.client.descriptor(), POLLIN));
  EXPECT_EQ(line.client.receive(buffer), 4u);
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_EQ(std::memcmp(buffer.data(), "twinr", 4), 0);
  EXPECT_EQ(line.client.state(), TcpStream::State::kOpen);
}

TEST(TcpSocket, TakesNothingWhenTheOtherSideDoesNotRead) {
  Line line;
  ASSERT_TRUE(line.server && ready(line.client.descriptor(), POLLOUT));
  ASSERT_EQ(line.client.state(), TcpStream::State::kOpen);
  const std::vector<std::uint8_t> much(1'000'000);
  int sends = 0;
  while (line.client.send(much) > 0) ASSERT_LT(++sends, 1000);
  EXPECT_EQ(line.client.state(), TcpStream::State::kOpen);
}

TEST(TcpSocket, NoticesThatTheOtherSideHasGone) {
  Line line;
  ASSERT_TRUE(line.server && ready(line.client.descriptor(), POLLOUT));
  ASSERT_EQ(line.client.state(), TcpStream::State::kOpen);
  line.server.reset();
  ASSERT_TRUE(ready(line.client.descriptor(), POLLIN));
  std::array<std::uint8_t, 16> buffer;
  EXPECT_EQ(line.client.receive(buffer), 0u);
  EXPECT_EQ(line.client.state(), TcpStream::State::kClosed);
  EXPECT_EQ(line.client.descriptor(), -1);
  EXPECT_EQ(line.client.send(view("x")), 0u);
}

TEST(TcpSocket, IsClosedWhereNobodyListens) {
  Endpoint nobody;
  { nobody = TcpListener(kAny, "test").local(); }
  TcpStream client = TcpStream::connect(nobody);
  if (client.descriptor() >= 0) ready(client.descriptor(), POLLOUT);
  EXPECT_EQ(client.state(), TcpStream::State::kClosed);
  TcpListener again(nobody, "test");  // the port is free at once
  EXPECT_EQ(again.local(), nobody);
  EXPECT_NE(testing::error_of([&] { TcpListener(nobody, "io: port"); }).find("io: port: TCP socket at 127.0.0.1:"),
            std::string::npos);
  EXPECT_NE(testing::error_of([&] { TcpListener({0x08080808, 0}, "io: address"); }), "");
}

}  // namespace
}  // namespace cotwin::net::tcp_socket_test
