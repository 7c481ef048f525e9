#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "components/unit/unit_table.h"

namespace cotwin::master {

/// The server of `cotwin run --view`: a gateway beside the scenario, at the addresses of this machine only. It is no component, so that the
/// scenario with its hash, its recording and its checkpoints is the same with and without it.
class ViewServer final : public bus::RunObserver {
 public:
  static constexpr std::uint16_t kUsualPort = 8081;  // 8080 is that of `cotwin serve` and of gateways

  /// `port`: 0: a free one; none: kUsualPort, or a free one if another program has that. Throws Error if there is no unit gateway, or the port
  /// is not free. `local_writes`: the gateway's parameter of that name.
  ViewServer(std::optional<std::uint16_t> port, const std::string& local_writes, std::span<const UnitType> types,
             const std::vector<std::filesystem::path>& folders);
  ~ViewServer() override;

  void observe(std::shared_ptr<bus::LiveRun> run) override;
  /// "http://localhost:8081/"
  std::string url() const override;
  /// Sends what the clients have not got, and closes the connections.
  void end() noexcept;

 private:
  void start(std::uint16_t port, const std::string& local_writes);

  Instance instance_;
  bus::RunObserver* gateway_ = nullptr;  // the same unit
};

}  // namespace cotwin::master
