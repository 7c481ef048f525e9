// cotwin serve: the gateway as a program of its own, for clients over HTTP (docs/gateway.md).
#include <algorithm>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "components/services/robots.h"
#include "master/program/commands/commands.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct ServeArguments {
  std::string address = "localhost";
  std::optional<std::string> robot;
  int port = 8080, workers = 1, threads = 2, connections = 128;
  fs::path tokens, certificate, key, out = "results/serve";
  std::vector<fs::path> robots;
  std::optional<fs::path> database;
  std::vector<std::string> hosts, origins, set;
  std::optional<double> seconds;
  std::string local_writes = "owner", unphysical = "error";
  bool no_jobs = false, commands = false, quiet = false;
};

std::string list_of(const std::vector<std::string>& items) {
  std::string list;
  for (const std::string& item : items) list += (list.empty() ? "" : ",") + item;
  return list;
}

fs::path serve_scenario() {
  for (const fs::path& folder : model_folders({})) {
    const fs::path file = folder / "scenarios/serve.ssd";
    std::error_code none;
    if (fs::is_regular_file(file, none)) return file;
  }
  throw Error("scenarios/serve.ssd", "is not in the model folders, expected it in those of Cotwin (COTWIN_MODELS adds others)");
}

/// Those of --robots, or the folders robots/ of the model folders.
std::vector<fs::path> robot_folders(const ServeArguments& a) {
  std::vector<fs::path> all;
  std::error_code none;
  for (const fs::path& folder : a.robots) {
    if (!fs::is_directory(folder, none))
      throw Error("--robots " + folder.string(), "is not a folder, expected one with robots");
    if (folder.string().find(',') != std::string::npos)
      throw Error("--robots " + folder.string(), "has a comma in its name, expected a folder without");
    all.push_back(fs::absolute(folder));
  }
  if (!all.empty()) return all;
  for (const fs::path& folder : model_folders({}))
    if (fs::is_directory(folder / "robots", none)) all.push_back(fs::absolute(folder / "robots"));
  return all;
}

/// The robot of requests that name none; "": there are several, and none of them is meant more than another.
std::string default_robot(const ServeArguments& a, const std::vector<fs::path>& folders) {
  robot::UrdfOptions options;
  robot::take_unphysical(a.unphysical, options);
  services::Robots robots(folders, a.robot.value_or(""), false, {}, options);
  const std::vector<std::string> names = robots.names();
  if (names.empty() && !a.robots.empty())
    throw Error("--robots " + a.robots.front().string(), "has no robot, expected FOLDER/NAME/robot.urdf or FOLDER/NAME.urdf");
  if (!a.robot) return std::ranges::find(names, "lwr4") != names.end() ? "lwr4" : names.size() == 1 ? names.front() : "";
  try {
    (void)robots.find(*a.robot);
  } catch (const Error& error) {
    throw Error("--robot " + *a.robot, error.what());
  }
  return *a.robot;
}

/// The names by which clients may call the gateway.
std::string names_of(const ServeArguments& a) {
  std::vector<std::string> names = {"localhost"};
  for (const std::string_view item : text::split(a.address, ',')) {
    const std::string address(text::trim(item));
    if (address.empty() || address == "localhost") continue;
    const bool v6 = address.find(':') != std::string::npos;
    names.push_back(address == "0.0.0.0" ? "127.0.0.1" : address == "::" ? "[::1]" : v6 ? "[" + address + "]" : address);
  }
  names.insert(names.end(), a.hosts.begin(), a.hosts.end());
  return text::joined(names);
}

/// Whether the results in a folder are those of an earlier `cotwin serve`, of which nobody needs them.
bool served_before(const fs::path& folder, const fs::path& scenario) {
  std::ifstream in(folder / "run.json");
  const auto record = nlohmann::json::parse(in, nullptr, false);
  const nlohmann::json::json_pointer file("/scenario/file");
  return record.contains(file) && record.at(file) == fs::absolute(scenario).string();
}

int serve(const ServeArguments& a) {
  if (a.no_jobs && a.database) throw Error("--database", "given with --no-jobs, expected one of the two");
  const std::vector<fs::path> folders = robot_folders(a);
  const std::string robot = default_robot(a, folders);
  const fs::path url_file = a.out / "url.txt";
  make_folder(a.out);
  ScenarioRun run;
  run.file = serve_scenario();
  run.out = a.out;
  run.stop = a.seconds;
  run.quiet = true;
  run.plain = true;
  run.resumable = false;
  run.overwrite = served_before(a.out, run.file);
  const auto set = [&](const std::string& name, const std::string& value) {
    run.set.push_back("gateway." + name + "=" + value);
  };
  set("address", a.address);
  set("port", std::to_string(a.port));
  set("tokens", a.tokens.string());
  set("certificate", a.certificate.string());
  set("key", a.key.string());
  set("hosts", list_of(a.hosts));
  set("origins", list_of(a.origins));
  set("robot", robot);
  set("robots", list_of({folders.begin(), folders.end()}));
  set("unphysical", a.unphysical);
  set("threads", std::to_string(a.threads));
  set("connections", std::to_string(a.connections));
  set("workers", std::to_string(a.workers));
  set("database", a.no_jobs ? "" : a.database.value_or(a.out / "jobs.sqlite").string());
  set("commands", a.commands ? "true" : "false");
  set("local_writes", a.local_writes);
  set("url_file", url_file.string());
  for (const std::string& one : a.set) {
    const std::string name = one.substr(0, one.find('='));
    run.set.push_back(name.find('.') == std::string::npos ? "gateway." + one : one);
  }
  run.started = [&] {
    std::ifstream in(url_file);
    std::string url;
    std::getline(in, url);
    if (a.quiet) return;
    std::cout << "gateway at " << url << ", described by " << url << "/openapi.json; Ctrl-C ends" << std::endl;
    if (a.address != "localhost")
      std::cout << "clients may call it by the names " << names_of(a) << "; --host adds names" << std::endl;
  };
  const int code = run_scenario(run);
  if (code > kExitSignalled && !a.no_jobs)
    std::cerr << "cotwin: jobs go on at the next cotwin serve"
              << (a.out == ServeArguments{}.out || a.database ? "" : " --out " + a.out.string())
              << (a.database ? " --database " + a.database->string() : "") << '\n';
  return code;
}

}  // namespace

void add_serve(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<ServeArguments>();
  ServeArguments& a = *all;
  CLI::App* command = app.add_subcommand("serve", "Answer requests over HTTP: services, jobs, events (docs/gateway.md)");
  command
      ->add_option("--address", a.address,
                   "Addresses to listen at, separated by commas; those that other machines reach need --token-file, "
                   "--certificate and --key")
      ->capture_default_str()
      ->type_name("ADDRESS");
  command->add_option("--port", a.port, "TCP port; 0: a free one")
      ->capture_default_str()
      ->check(CLI::Range(0, 65535))
      ->type_name("PORT");
  command
      ->add_option(
          "--token-file", a.tokens,
          "Tokens that clients must send: lines 'SCOPE[,SCOPE] TOKEN [name=NAME] [until=TIME]', mode 600 (docs/gateway.md)")
      ->type_name("FILE");
  command->add_option("--certificate", a.certificate, "Certificate and its chain for TLS, PEM")->type_name("FILE");
  command->add_option("--key", a.key, "Key of the certificate, PEM, mode 600")->type_name("FILE");
  command->add_option("--host", a.hosts, "Further name by which clients call the gateway; may be repeated")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command
      ->add_option("--origin", a.origins,
                   "Origin of web pages that may call the gateway, as https://mes.example; may be repeated")
      ->type_name("ORIGIN")
      ->allow_extra_args(false);
  command->add_option("--database", a.database, "SQLite file of jobs and results (default: jobs.sqlite in the folder of --out)")
      ->type_name("FILE");
  command->add_flag("--no-jobs", a.no_jobs, "No database: only immediate answers");
  command->add_flag(
      "--commands", a.commands,
      "Clients may also pause and stop this program's own run (POST /run/commands); without it they get status 403");
  command
      ->add_option("--local-writes", a.local_writes,
                   "Who on this machine may order jobs and change something without --token-file; owner: who runs the gateway, "
                   "and root; all: all users. The others may read")
      ->capture_default_str()
      ->check(CLI::IsMember({"owner", "all"}))
      ->type_name("WHO");
  command->add_option("--workers", a.workers, "Processes that compute jobs")
      ->capture_default_str()
      ->check(CLI::Range(1, 256))
      ->type_name("N");
  command->add_option("--threads", a.threads, "Threads that compute immediate answers")
      ->capture_default_str()
      ->check(CLI::Range(1, 64))
      ->type_name("N");
  command->add_option("--connections", a.connections, "Most connections at the same time")
      ->capture_default_str()
      ->check(CLI::Range(1, 10000))
      ->type_name("N");
  command
      ->add_option("--robot", a.robot,
                   "Robot of requests that name none (default: lwr4 or, without one of that name, the only robot; if there are "
                   "several, each request must name one)")
      ->type_name("NAME");
  command
      ->add_option(
          "--robots", a.robots,
          "Folder with robots that requests may name, FOLDER/NAME/robot.urdf or FOLDER/NAME.urdf; may be repeated, the "
          "first folder that has a robot counts; default: models/robots")
      ->allow_extra_args(false)
      ->type_name("FOLDER");
  add_unphysical(*command, a.unphysical);
  command->add_option("--seconds", a.seconds, "Duration (default: until Ctrl-C)")
      ->check(CLI::PositiveNumber)
      ->check(kNumber)
      ->type_name("SECONDS");
  command
      ->add_option("--set", a.set, "As in cotwin run, for the component gateway, whose name may be left out; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--out", a.out, "Folder for url.txt, jobs and the record of the run")
      ->capture_default_str()
      ->type_name("FOLDER");
  command->add_flag("--quiet", a.quiet, "Do not print the URL");
  command->callback([all, &chosen] { chosen = [all] { return serve(*all); }; });
}

}  // namespace cotwin::master
