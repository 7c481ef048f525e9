#include "components/io/emulators/ethercat_bus_link.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <limits>

#include "models/foundation/support/error.h"

namespace cotwin::io {

namespace {

const std::string kBusPlace = "unit:io?link=ethercat_bus";
constexpr int kMostFrames = 64;
constexpr std::int64_t kIdle = 1'000'000;  // ns without a frame after which watchdogs and filters are looked at

std::int64_t monotonic() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::int32_t narrow(std::int64_t value) {
  return static_cast<std::int32_t>(std::min<std::int64_t>(value, std::numeric_limits<std::int32_t>::max()));
}

}  // namespace

EtherCatBusLink::EtherCatBusLink(Settings& settings, std::size_t joints)
    : interface_(settings.text("interface")), slaves_(read_slaves(settings, kBusPlace)), field_(slaves_, joints) {
  joints_of(slaves_, joints, kBusPlace);
  if (interface_ == "emulated") {
    throw Error(
        kBusPlace,
        "interface is missing, expected the network interface at which a master operates the bus, as in interface=veth1");
  }
}

EtherCatBusLink::~EtherCatBusLink() { stop(); }

void EtherCatBusLink::stop() noexcept {
  if (!thread_.joinable()) return;
  ends_ = true;
  thread_.join();
}

void EtherCatBusLink::declare(Variables& v, JointVariables& joints) {
  v.output("frames", frames_, "frames of masters that were answered");
  v.output("unanswered", unanswered_,
           "frames that did not come back to the master: damaged, or the interface did not take them");
  field_.declare(v, joints);
}

void EtherCatBusLink::initialise(Time, Measured&) {
  stop();
  socket_.reset();
  socket_.emplace(interface_, ethercat::kEtherType, kBusPlace);
  ends_ = false;
  frames_served_ = frames_lost_ = 0;
  field_.initialise(monotonic());
  thread_ = std::thread([this] { serve(); });
}

StepResult EtherCatBusLink::step(Time, Duration, const Command&, Measured&) {
  field_.exchange();
  frames_ = narrow(frames_served_.load(std::memory_order_relaxed));
  unanswered_ = narrow(frames_lost_.load(std::memory_order_relaxed));
  return {};
}

void EtherCatBusLink::serve() {
  std::array<std::uint8_t, ethercat::kLongestFrame> buffer;
  while (!ends_) {
    socket_->wait(monotonic() + kIdle);
    field_.apply(monotonic());
    field_.bus().advance(monotonic());
    for (int n = 0; n < kMostFrames && !ends_; ++n) {  // also under a flood of frames the field is served
      const std::optional<net::RawSocket::Received> received = socket_->receive(buffer);
      if (!received) break;
      if (received->size > buffer.size()) continue;
      const std::span<std::uint8_t> frame = std::span(buffer).first(received->size);
      if (field_.bus().transmit(frame, monotonic()) && socket_->send(frame)) {
        frames_served_.fetch_add(1, std::memory_order_relaxed);
      } else {
        frames_lost_.fetch_add(1, std::memory_order_relaxed);
      }
    }
    field_.apply(monotonic());
  }
}

}  // namespace cotwin::io
