#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "components/unit/unit_table.h"
#include "master/api/cotwin.h"
#include "master/scenario/folders.h"
#include "master/services/verify.h"
#include "models/foundation/support/threads.h"

namespace cotwin {

namespace {

namespace fs = std::filesystem;

/// Robots by name, from the folders of the options or those of Cotwin.
services::Robots robots_of(const AskOptions& options) {
  std::vector<fs::path> folders;
  for (const fs::path& folder : options.robots) {
    if (!fs::is_directory(folder)) throw Error("robots: " + folder.string(), "is not a folder, expected one with robots");
    folders.push_back(folder);
  }
  fs::path people;
  for (const fs::path& folder : master::model_folders({})) {
    if (options.robots.empty()) folders.push_back(folder / "robots");
    if (const fs::path file = folder / "people/iso_ts_15066.csv"; people.empty() && fs::is_regular_file(file)) people = file;
  }
  return services::Robots(folders, options.robot, true, people);
}

}  // namespace

std::vector<std::string> service_names() { return services::service_names(); }

std::vector<std::string> unit_names() {
  std::vector<std::string> names;
  for (const UnitType& type : unit_types()) names.emplace_back(type.name);
  return names;
}

std::string service_schema(const std::string& service) { return services::schema(service); }

std::string ask(const std::string& request, const AskOptions& options) {
  if (options.threads < 1) throw Error("threads", "expected at least 1");
  numerics::Threads threads(options.threads);
  services::Context context;
  context.threads = &threads;
  if (options.progress) {
    context.progress = [&options](double share, const std::string& message) {
      if (!options.progress(share, message)) throw Error("ask", "was stopped by its progress function");
    };
  }
  context.verify = [](const services::Robot& robot, const services::Move& move, double T,
                      const services::VerificationOptions& chosen) {
    return master::verify(unit_types(), master::model_folders({}), robot, move, T, chosen);
  };
  services::Robots robots = robots_of(options);
  return services::answer(robots, request, context);
}

}  // namespace cotwin
