#include "master/program/view_server.h"

#include "models/foundation/support/error.h"

namespace cotwin::master {

ViewServer::ViewServer(std::optional<std::uint16_t> port, const std::string& local_writes, std::span<const UnitType> types,
                       const std::vector<std::filesystem::path>& folders)
    : instance_(make_unit("unit:gateway", {}, folders, types)),
      gateway_(dynamic_cast<bus::RunObserver*>(instance_.unit.get())) {
  if (gateway_ == nullptr) throw Error("unit:gateway", "shows no runs, expected the gateway of this version");
  if (port) {
    start(*port, local_writes);
    return;
  }
  try {
    start(kUsualPort, local_writes);
  } catch (const Error&) {
    start(0, local_writes);
  }
}

ViewServer::~ViewServer() { end(); }

void ViewServer::start(std::uint16_t port, const std::string& local_writes) {
  ParameterSet set;
  set.values.push_back({"port", std::int64_t{port}, "", "--view"});
  set.values.push_back({"local_writes", local_writes, "", "--local-writes"});
  apply(set, instance_.variables);
  instance_.unit->initialise(Time{});
}

void ViewServer::observe(std::shared_ptr<bus::LiveRun> run) { gateway_->observe(std::move(run)); }

std::string ViewServer::url() const {
  const std::string url = gateway_->url();
  return "http://localhost" + url.substr(url.rfind(':')) + "/";
}

void ViewServer::end() noexcept { instance_.unit->end(); }

}  // namespace cotwin::master
