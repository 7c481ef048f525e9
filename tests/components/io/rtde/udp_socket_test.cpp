#include "models/foundation/net/udp_socket.h"

#include <gtest/gtest.h>
#include <poll.h>

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::net::udp_socket_test {
namespace {

constexpr std::uint32_t kLoopback = 0x7f000001;

/// Waits until a datagram has arrived.
bool arrives(const UdpSocket& socket) {
  pollfd wait{socket.descriptor(), POLLIN, 0};
  return ::poll(&wait, 1, 10'000) == 1;
}

std::int64_t monotonic_now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

TEST(Endpoint, IsReadAndWritten) {
  EXPECT_EQ(endpoint_of("192.168.0.20:30200", 1, "io"), (Endpoint{0xc0a80014, 30200}));
  EXPECT_EQ(endpoint_of("127.0.0.2", 49938, "io"), (Endpoint{0x7f000002, 49938}));
  EXPECT_EQ(to_text(Endpoint{0xc0a80014, 30200}), "192.168.0.20:30200");
  for (const char* wrong : {"", "localhost", "1.2.3", "1.2.3.4.5", "1.2.3.256", "1.2.3.4:", "1.2.3.4:65536", "1.2.3.4:5 ",
                            " 1.2.3.4", "1.2.3.-4"}) {
    EXPECT_NE(testing::error_of([&] { endpoint_of(wrong, 1, "io.remote"); }), "") << wrong;
  }
  EXPECT_EQ(testing::error_of([] { endpoint_of("robot", 1, "io.remote"); }),
            "io.remote: 'robot' is no IPv4 address, expected one like 192.168.0.20 or 192.168.0.20:30200");
}

TEST(Endpoint, CoversAnyAddressAndPortWithZero) {
  const Endpoint sender{0xc0a80014, 30200};
  EXPECT_TRUE((Endpoint{}).covers(sender));
  EXPECT_TRUE((Endpoint{0xc0a80014, 0}).covers(sender));
  EXPECT_TRUE(sender.covers(sender));
  EXPECT_FALSE((Endpoint{0xc0a80014, 30201}).covers(sender));
  EXPECT_FALSE((Endpoint{0xc0a80015, 0}).covers(sender));
}

TEST(UdpSocket, SendsAndReceivesWithoutBlockingOrAllocating) {
  UdpSocket a({kLoopback, 0}, "a"), b({kLoopback, 0}, "b");
  ASSERT_NE(a.local().port, 0);
  std::array<std::uint8_t, 64> buffer{};
  EXPECT_FALSE(b.receive(buffer));
  const std::array<std::uint8_t, 3> bytes{1, 2, 3};
  const std::int64_t before = monotonic_now();
  const std::uint64_t allocations = testing::allocations();
  ASSERT_TRUE(a.send(bytes, b.local()));
  ASSERT_TRUE(arrives(b));
  const std::int64_t after = monotonic_now();
  const auto received = b.receive(buffer);
  EXPECT_EQ(testing::allocations(), allocations);
  ASSERT_TRUE(received);
  EXPECT_EQ(received->size, 3u);
  EXPECT_EQ(received->from, a.local());
  EXPECT_EQ(buffer[2], 3);
  // The kernel's stamp, by another clock: between sending and the end of the wait, to some microseconds.
  EXPECT_GE(received->arrival, before - 1'000'000);
  EXPECT_LE(received->arrival, after + 1'000'000);
  EXPECT_FALSE(b.receive(buffer));
}

TEST(UdpSocket, ReportsDatagramsThatWereCutAsLongerThanTheBuffer) {
  UdpSocket a({kLoopback, 0}, "a"), b({kLoopback, 0}, "b");
  const std::vector<std::uint8_t> bytes(100, 7);
  std::array<std::uint8_t, 10> buffer{};
  ASSERT_TRUE(a.send(bytes, b.local()));
  ASSERT_TRUE(a.send({}, b.local()));
  ASSERT_TRUE(arrives(b));
  const auto received = b.receive(buffer);
  ASSERT_TRUE(received);
  EXPECT_GT(received->size, buffer.size());
  ASSERT_TRUE(arrives(b));
  const auto empty = b.receive(buffer);
  ASSERT_TRUE(empty);
  EXPECT_EQ(empty->size, 0u);
}

TEST(UdpSocket, NamesThePlaceAndTheReasonIfItCannotBind) {
  UdpSocket first({kLoopback, 0}, "first");
  const std::string error = testing::error_of([&] { UdpSocket(first.local(), "io.local"); });
  EXPECT_EQ(error, "io.local: UDP socket at " + to_text(first.local()) +
                       ": bind: Address already in use, expected an address of this machine and a free port");
  EXPECT_NE(testing::error_of([] { UdpSocket({0x01020304, 0}, "io.local"); }), "");
}

TEST(UdpSocket, GoesOnAfterSendingToAClosedPort) {
  UdpSocket a({kLoopback, 0}, "a");
  Endpoint closed;
  {
    const UdpSocket gone({kLoopback, 0}, "gone");
    closed = gone.local();
  }
  const std::array<std::uint8_t, 1> bytes{1};
  std::array<std::uint8_t, 8> buffer{};
  for (int i = 0; i < 20; ++i) {
    a.send(bytes, closed);
    EXPECT_FALSE(a.receive(buffer));
  }
  UdpSocket moved = std::move(a);
  EXPECT_EQ(a.descriptor(), -1);
  ASSERT_TRUE(moved.send(bytes, moved.local()));
  ASSERT_TRUE(arrives(moved));
  EXPECT_TRUE(moved.receive(buffer));
}

}  // namespace
}  // namespace cotwin::net::udp_socket_test
