#include "models/foundation/net/raw_socket.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <time.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::net::raw_socket_test {
namespace {

using ::testing::HasSubstr;

constexpr std::uint16_t kExperimental = 0x88b5;  // IEEE 802, local experiments

std::optional<RawSocket> loopback() {
  try {
    return RawSocket("lo", kExperimental, "test");
  } catch (const Error&) {
    return std::nullopt;
  }
}

TEST(RawSocket, NamesTheInterfaceThatIsMissingAndThoseThatAreThere) {
  const std::string error = cotwin::testing::error_of([] { RawSocket("no-such-if", kExperimental, "links.bus"); });
  EXPECT_THAT(error, HasSubstr("links.bus: interface 'no-such-if': there is no such interface, expected one of "));
  EXPECT_THAT(error, HasSubstr("lo"));
}

TEST(RawSocket, AFrameOnTheLoopbackArrivesOnceWithItsTimeAndWithoutAllocation) {
  auto a = loopback(), b = loopback();
  if (!a || !b) GTEST_SKIP() << "needs the permission for raw sockets and a loopback interface that is up";
  std::vector<std::uint8_t> frame(60, 0), buffer(1600);
  frame[12] = kExperimental >> 8;
  frame[13] = kExperimental & 0xff;
  frame[20] = 0x5a;
  const auto before = cotwin::testing::allocations();
  EXPECT_FALSE(b->receive(buffer).has_value());
  ASSERT_TRUE(a->send(frame));
  pollfd ready{b->descriptor(), POLLIN, 0};
  ASSERT_EQ(::poll(&ready, 1, 10'000), 1);
  const auto first = b->receive(buffer);
  EXPECT_EQ(cotwin::testing::allocations(), before);
  ASSERT_TRUE(first.has_value());
  EXPECT_EQ(first->size, frame.size());
  EXPECT_TRUE(std::equal(frame.begin(), frame.end(), buffer.begin()));
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  const std::int64_t now = t.tv_sec * 1'000'000'000 + t.tv_nsec;
  EXPECT_LE(first->arrival, now);
  EXPECT_GT(first->arrival, now - 60'000'000'000);
  EXPECT_FALSE(b->receive(buffer).has_value());  // not once more as an outgoing frame
  ASSERT_TRUE(a->send(frame));
  ASSERT_EQ(::poll(&ready, 1, 10'000), 1);
  const auto cut = b->receive(std::span(buffer).first(20));
  ASSERT_TRUE(cut.has_value());
  EXPECT_EQ(cut->size, 21u);  // longer than the buffer
}

TEST(RawSocket, MovesItsDescriptor) {
  auto a = loopback();
  if (!a) GTEST_SKIP() << "needs the permission for raw sockets and a loopback interface that is up";
  const int descriptor = a->descriptor();
  RawSocket moved(std::move(*a));
  EXPECT_EQ(moved.descriptor(), descriptor);
  EXPECT_EQ(a->descriptor(), -1);
}

}  // namespace
}  // namespace cotwin::net::raw_socket_test
