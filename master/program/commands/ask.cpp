// cotwin ask: questions about motions (components/services), from options, from files of requests, or line by line from a queue.
#include <algorithm>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>
#include <thread>
#include <tuple>

#include "components/services/json/control/tasks.h"
#include "components/services/json/json.h"
#include "master/program/commands/commands.h"
#include "master/report/map.h"
#include "master/services/motion_file.h"
#include "master/services/row_file.h"
#include "master/services/verify.h"
#include "master/services/worker.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct AskArguments {
  std::string service, robot = "lwr4", more, detail, table, schema, q_columns, device, require, unphysical = "error";
  std::vector<double> from, to;
  std::string angle_unit = "rad";
  std::optional<double> T;
  std::vector<fs::path> files, robots, maps;
  std::optional<fs::path> motion, particles, series, rows;
  int threads = 0;
  bool worker = false, list_robots = false, robot_given = false;
};

/// Robots by name, from --robots or the model folders.
services::Robots robots_of(const AskArguments& a, bool paths) {
  std::vector<fs::path> folders;
  for (const fs::path& folder : a.robots) {
    if (!fs::is_directory(folder)) throw Error("--robots " + folder.string(), "is not a folder, expected one with robots");
    folders.push_back(folder);
  }
  fs::path people;
  for (const fs::path& folder : model_folders({})) {
    if (a.robots.empty()) folders.push_back(folder / "robots");
    if (const fs::path file = folder / "people/iso_ts_15066.csv"; people.empty() && fs::is_regular_file(file)) people = file;
  }
  robot::UrdfOptions options;
  robot::take_unphysical(a.unphysical, options);
  return services::Robots(folders, a.robot, paths, people, options);
}

services::Context context_of(numerics::Threads* threads) {
  services::Context context;
  context.threads = threads;
  context.verify = [](const services::Robot& robot, const services::Move& move, double T,
                      const services::VerificationOptions& options) {
    return verify(units(), model_folders({}), robot, move, T, options);
  };
  return context;
}

std::string names_of_services() { return text::joined(services::service_names()); }

/// Whether the request needs this member, and has neither it nor another one in its place.
bool lacks(const Json& request, const Json& schema, const std::string& member) {
  return std::ranges::any_of(schema.value("allOf", Json::array()), [&](const Json& list) {
    const auto any = [&](auto is) {
      return std::ranges::any_of(list["anyOf"], [&](const Json& one) { return is(one["required"][0].get<std::string>()); });
    };
    return any([&](const std::string& name) { return name == member; }) &&
           !any([&](const std::string& name) { return request.contains(name); });
  });
}

/// The request of the command line: what --with has and what the options add.
Json request_of(const AskArguments& a, services::Robots& robots) {
  if (a.service.empty()) throw Error("cotwin ask", "names no service, expected one of " + names_of_services() + ", or --file");
  const std::vector<std::string> services = services::service_names();
  if (std::ranges::find(services, a.service) == services.end())
    throw Error("cotwin ask", "'" + a.service + "' is no service, expected one of " + names_of_services());
  Json request = Json::object();
  try {
    if (!a.more.empty()) request = services::parse_object(a.more);
  } catch (const services::RequestError& e) {
    throw Error("--with", e.detail() + "; an example: {\"degree\": 9}");
  }
  if (request.contains("service") && request["service"] != a.service)
    throw Error("--with", "has the service " + request["service"].dump() + ", but the command asks for " + a.service +
                              ", expected one of them");
  request["service"] = a.service;
  const auto refuse_twice = [&](const std::string& option, const std::vector<std::string>& members) {
    for (const std::string& member : members)
      if (request.contains(member))
        throw Error(option, "is given beside the member " + member + " of --with, expected one of them");
  };
  if (a.robot_given) refuse_twice("--robot", {"robot"});
  const Json schema = Json::parse(services::schema(a.service))["request"];
  const auto takes = [&](const char* member) { return schema["properties"].contains(member); };
  const bool by_path = request.contains("series") || request.contains("waypoints") || a.series;
  const std::tuple<const char*, const char*, const std::vector<double>&> postures[] = {{"--from", "from_q", a.from},
                                                                                       {"--to", "to_q", a.to}};
  if (a.angle_unit == "deg" && a.from.empty() && a.to.empty() && !a.series)
    throw Error("--angle-unit deg",
                "is given without --from, --to and --series, expected one of them; members of --with have names with _deg");
  if (a.series) {
    if (!takes("series"))
      throw Error("--series", "is given for the service " + a.service + ", expected it with one that takes a series");
    refuse_twice("--series", {"series"});
    trajectory::RecordingFormat format;
    format.q_columns = a.q_columns;
    if (a.angle_unit == "deg") format.angle_unit = std::numbers::pi / 180;
    request["series"] = services::series_member(robots, request, *a.series, format);
  } else if (!a.q_columns.empty()) {
    throw Error("--q-columns", "is given without --series, expected it only with that");
  }
  for (const auto& [option, plain, q] : postures) {
    const std::string name = plain;
    const std::vector<std::string> members{name + "_rad", name + "_deg", name};
    if (!q.empty()) {
      if (by_path) throw Error(option, "is given beside a series or waypoints, expected one of them");
      if (!takes((name + "_rad").c_str()))
        throw Error(option, "is given for the service " + a.service + ", which takes no such posture");
      refuse_twice(option, members);
      std::string member = services::posture_member(robots, request, name);
      if (a.angle_unit == "deg" && member == plain)
        throw Error("--angle-unit deg", "is given for a robot with prismatic joints, expected postures in rad and m");
      if (a.angle_unit == "deg") member = name + "_deg";
      request[member] = q;
    } else if (lacks(request, schema, name + "_rad")) {
      throw Error(option,
                  "is missing, expected a posture, or " + services::posture_member(robots, request, name) + " in --with");
    }
  }
  if (a.T && (a.service == "cycle_time"))
    throw Error("--duration", "is given for cycle_time, which finds the duration, expected another service");
  if (a.T && by_path) throw Error("--duration", "is given beside a series or waypoints, which have their own times");
  if (a.T) {
    const std::string member = a.service == "optimise" ? "T_min_s" : "T_s";
    refuse_twice("--duration", {member});
    request[member] = *a.T;
  }
  if (!a.detail.empty()) {
    refuse_twice("--detail", {"detail"});
    request["detail"] = a.detail;
  }
  if (!a.require.empty()) {
    refuse_twice("--require", {"require"});
    request["require"] = a.require;
  }
  if (!a.device.empty()) {
    if (!takes("device"))
      throw Error("--device", "is given for the service " + a.service + ", expected it with grow or optimise");
    refuse_twice("--device", {"device"});
    request["device"] = a.device;
  }
  return request;
}

/// The parameters of the motion of a reply.
std::string motion_of(const AskArguments& a, services::Robots& robots, Json request, Json reply,
                      const services::Context& context) {
  if (request.contains("series") || request.contains("waypoints"))
    throw Error("--motion", "is given beside a series or waypoints, expected a move: unit:motion runs them as they are");
  // Only the whole reply of these services has the motion.
  if (!reply.contains("motion") && (a.service == "feasibility" || a.service == "cycle_time")) {
    request["detail"] = "all";
    reply = Json::parse(services::answer_object(robots, request, context));
  }
  if (!reply.contains("motion"))
    throw Error("--motion", "the rule pareto replies with many motions, expected the rule weighted or lexicographic");
  return motion_file(reply["motion"].dump());
}

/// Why a motion is not written.
std::string why_not(const Json& reply) {
  if (reply.contains("feasible") && reply["feasible"] == false) return "the move is not feasible: " + reply.value("reason", "");
  std::string why;
  for (const Json& finding : reply["verdict"]["findings"])
    if (finding["says"] != "yes") text::append(why, finding["why"].get<std::string>(), "; ");
  return "the light is " + reply["verdict"]["light"].get<std::string>() + (why.empty() ? "" : ": " + why);
}

int ask_one(const AskArguments& a, services::Robots& robots, services::Context context) {
  Json request = request_of(a, robots);
  const bool reactionless = a.service == "reactionless";
  const bool grow = a.service == "grow";
  if (a.motion && a.service != "feasibility" && a.service != "cycle_time" && a.service != "optimise" && !reactionless)
    throw Error("--motion", "the service " + a.service +
                                " replies with no motion, expected feasibility, cycle_time, optimise or reactionless");
  if (a.threads != 0 && a.service != "optimise" && !reactionless && !grow)
    throw Error("--threads", "is given for the service " + a.service +
                                 ", which uses one thread, expected it with optimise, reactionless or grow");
  for (const auto& [option, given] : {std::pair{"--rows", a.rows.has_value()}, {"--map", !a.maps.empty()}})
    if (given && !grow) throw Error(option, "is given for the service " + a.service + ", expected it with grow");
  for (const fs::path& map : a.maps) report::check_map_file(map);
  if (!a.maps.empty() && request.value("detail", "") == "verdict")
    throw Error("--map", "is given with the detail verdict, which tells no goals, expected another one");
  const std::string audience = request.contains("audience") ? request["audience"].dump() : "";
  if ((a.motion || !a.maps.empty()) && (audience == "\"operator\"" || audience == "\"planner\"") && !request.contains("detail"))
    throw Error(a.motion ? "--motion" : "--map",
                "is given for the audience " + audience + ", whose reply has no motions, expected a detail beside it");
  std::optional<RowFile> rows;
  if (a.rows) context.rows = &rows.emplace(*a.rows);
  // Only the whole reply has the motion, and it takes a search.
  const std::string detail = request.value("detail", "");
  if (reactionless && a.motion) request["detail"] = "all";
  std::ostringstream particles;
  if (a.particles) {
    if (a.service != "optimise")
      throw Error("--particles", "is given for the service " + a.service + ", expected it with optimise");
    context.particles = &particles;
  }
  Json reply = Json::parse(services::answer_object(robots, request, context));
  if (a.particles) write_file(*a.particles, particles.str());
  if (rows) rows->commit();
  const std::string unmet = reply["verdict"].value("unmet", "");
  if (!unmet.empty() || (a.motion && reply["verdict"]["light"] == "red")) {
    std::cout << reply.dump(2) << "\n";
    if (!unmet.empty()) std::cerr << "cotwin: the light is not the one that is required: " << unmet << "\n";
    if (a.motion) std::cerr << "cotwin: --motion " << a.motion->string() << ": not written, " << why_not(reply) << "\n";
    return kExitRunFailed;
  }
  if (a.motion) write_file(*a.motion, motion_of(a, robots, request, reply, context));
  if (reactionless && detail != "all") {
    reply.erase("motion");
    if (detail != "series") reply.erase("series");
    if (detail == "verdict") reply.erase("joints");
  }
  std::cout << reply.dump(2) << "\n";
  for (const fs::path& map : a.maps) report::write_map(map, reply);
  return kExitDone;
}

int ask_files(const AskArguments& a, services::Robots& robots, const services::Context& context) {
  std::vector<services::Task> tasks;
  for (const fs::path& file : a.files) {
    if (fs::is_directory(file)) throw Error(file.string(), "is a folder, expected a file with requests");
    std::ifstream in(file, std::ios::binary);
    if (!in) throw Error(file.string(), "cannot be read, expected a file with requests");
    const std::string content{std::istreambuf_iterator<char>(in), {}};
    // A table has room for verdicts.
    const services::TaskDefaults defaults{a.robot, a.detail, file.parent_path(), !a.table.empty(), a.require};
    for (services::Task& task : services::read_tasks(content, file.string(), defaults)) tasks.push_back(std::move(task));
  }
  const std::vector<services::Row> rows = services::ask_all(robots, tasks, context);
  if (a.table.empty())
    std::cout << Json::parse(services::to_json(rows)).dump(2) << "\n";
  else
    std::cout << (a.table == "csv" ? services::to_csv(rows) : services::to_text_table(rows));
  std::size_t refused = 0, worse = 0;
  for (const services::Row& row : rows) {
    refused += row.problem.empty() ? 0 : 1;
    const std::string unmet = services::unmet(row);
    if (unmet.empty()) continue;
    ++worse;
    std::cerr << "cotwin: task " << row.task.name << " has not the light that is required: " << unmet << "\n";
  }
  if (refused > 0) std::cerr << "cotwin: " << refused << " of " << rows.size() << " tasks could not be answered\n";
  return refused + worse == 0 ? kExitDone : kExitRunFailed;
}

/// Refuses options that would have no effect beside `chosen`.
void refuse_others(const AskArguments& a, const std::string& chosen, const std::vector<std::string>& allowed) {
  const std::pair<const char*, bool> given[] = {{"SERVICE", !a.service.empty()},
                                                {"--from", !a.from.empty()},
                                                {"--to", !a.to.empty()},
                                                {"--duration", a.T.has_value()},
                                                {"--with", !a.more.empty()},
                                                {"--detail", !a.detail.empty()},
                                                {"--require", !a.require.empty()},
                                                {"--motion", !!a.motion},
                                                {"--particles", !!a.particles},
                                                {"--rows", !!a.rows},
                                                {"--map", !a.maps.empty()},
                                                {"--device", !a.device.empty()},
                                                {"--series", !!a.series},
                                                {"--q-columns", !a.q_columns.empty()},
                                                {"--file", !a.files.empty()},
                                                {"--angle-unit", a.angle_unit != "rad"},
                                                {"--table", !a.table.empty()},
                                                {"--schema", !a.schema.empty()},
                                                {"--robots", !a.robots.empty()},
                                                {"--threads", a.threads != 0},
                                                {"--worker", a.worker},
                                                {"--list-robots", a.list_robots}};
  for (const auto& [name, is_given] : given)
    if (is_given && name != chosen && std::ranges::find(allowed, name) == allowed.end())
      throw Error(chosen == "SERVICE" ? "cotwin ask " + a.service : "cotwin ask " + chosen,
                  (name == std::string("SERVICE") ? "the service " + a.service : name) +
                      " is also given and would have no effect, expected it without");
}

/// A line for each robot: joints, and where the values of its files come from.
int list_robots(const Json& robots) {
  std::cout << std::left << std::setw(20) << "robot" << std::setw(8) << "joints"
            << text::joined({services::kDataFiles.begin(), services::kDataFiles.end()}, "  ") << "\n";
  for (const auto& [name, data] : robots.items()) {
    std::cout << std::setw(19) << name << " ";
    if (data.contains("problem")) {
      std::cout << data["problem"].get<std::string>() << "\n";
      continue;
    }
    std::cout << std::setw(8) << data["joints"].dump();
    for (const char* file : services::kDataFiles)
      std::cout << std::setw(file == services::kDataFiles.back() ? 0 : static_cast<int>(std::string_view(file).size()) + 2)
                << data[file].get<std::string>();
    std::cout << "\n";
  }
  return kExitDone;
}

int ask(const AskArguments& a) {
  if (!a.schema.empty())
    refuse_others(a, "--schema", {});
  else if (a.list_robots)
    refuse_others(a, "--list-robots", {"--robots"});
  else if (a.worker)
    refuse_others(a, "--worker", {"--robots", "--threads"});
  else if (!a.files.empty())
    refuse_others(a, "--file", {"--detail", "--require", "--table", "--robots", "--threads"});
  else
    refuse_others(a, "SERVICE",
                  {"--from", "--to", "--angle-unit", "--duration", "--with", "--detail", "--require", "--motion", "--particles",
                   "--rows", "--map", "--device", "--series", "--q-columns", "--robots", "--threads"});
  if (!a.schema.empty()) {
    const std::vector<std::string> names = services::service_names();
    if (std::ranges::find(names, a.schema) == names.end())
      throw Error("--schema", "'" + a.schema + "' is no service, expected one of " + names_of_services());
    std::cout << Json::parse(services::schema(a.schema)).dump(2) << "\n";
    return kExitDone;
  }
  if (a.list_robots) {
    services::Robots robots = robots_of(a, false);
    return list_robots(services::data_of_all(robots));
  }
  if (a.worker) {
    numerics::Threads threads(std::max(1, a.threads));
    services::Robots robots = robots_of(a, false);
    std::ios::sync_with_stdio(false);
    return run_worker(std::cin, std::cout, robots, context_of(&threads)) ? kExitDone : kExitRunFailed;
  }
  numerics::Threads threads(a.threads > 0 ? a.threads : std::max(1, static_cast<int>(std::thread::hardware_concurrency())));
  services::Robots robots = robots_of(a, true);
  const services::Context context = context_of(&threads);
  if (a.files.empty()) return ask_one(a, robots, context);
  return ask_files(a, robots, context);
}

}  // namespace

void add_ask(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<AskArguments>();
  AskArguments& a = *all;
  CLI::App* command =
      app.add_subcommand("ask", "Answer a question about a motion: feasible, how long, what it costs, which is cheaper");
  command->add_option("service", a.service, names_of_services());
  command->add_option("--robot", a.robot, "URDF, or name of a robot in models/robots")
      ->capture_default_str()
      ->type_name("URDF");
  command->add_option("--from", a.from, "Posture at the start, rad (m), separated by commas")->delimiter(',')->type_name("Q");
  command->add_option("--to", a.to, "Posture at the end, rad (m), separated by commas")->delimiter(',')->type_name("Q");
  command->add_option("--series", a.series, "Motion in place of --from and --to: CSV with times and joint positions")
      ->type_name("FILE");
  command
      ->add_option("--q-columns", a.q_columns, "Of --series: columns of the positions, names or a pattern, e.g. 'drive.q[{}]'")
      ->type_name("NAMES");
  command->add_option("--angle-unit", a.angle_unit, "Of --from, --to and --series: rad or deg")
      ->check(CLI::IsMember({"rad", "deg"}))
      ->type_name("WORD")
      ->capture_default_str();
  command->add_option("--duration", a.T, "Duration in seconds; without it the shortest one")->type_name("S");
  command->add_option("--with", a.more, "Further members of the request as a JSON object, for example {\"degree\": 9}")
      ->type_name("JSON");
  command->add_option("--detail", a.detail, "How much the reply tells: verdict, margins, series or all")->type_name("LEVEL");
  command
      ->add_option("--require", a.require, "The worst light that will do, green or amber: with a worse one the exit code is 1")
      ->check(CLI::IsMember({"green", "amber"}));
  command->add_option("--motion", a.motion, "Write the motion for unit:motion: parameters (SSV), of reactionless a table (CSV)")
      ->type_name("FILE");
  command->add_option("--particles", a.particles, "Write all motions that optimise tries as a table (CSV)")->type_name("FILE");
  command->add_option("--rows", a.rows, "Write all motions that grow draws as a table: .csv, or .npy for NumPy")
      ->type_name("FILE");
  command
      ->add_option("--map", a.maps,
                   "Write what grow finds of each goal: .csv, or .svg for the picture of a grid; may be repeated")
      ->allow_extra_args(false)
      ->type_name("FILE");
  command
      ->add_option("--device", a.device,
                   "Of grow and optimise: cpu, gpu, or auto for a GPU where there is one and it pays (docs/services.md)")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->type_name("WORD");
  command->add_option("--file", a.files, "Files with requests in JSON: one, an array, or robots and tasks (docs/services.md)")
      ->type_name("FILE");
  command->add_option("--table", a.table, "The answers of --file as a table: text or csv")
      ->check(CLI::IsMember({"text", "csv"}))
      ->type_name("FORM");
  command->add_option("--schema", a.schema, "Print the JSON Schemas of a service")->type_name("SERVICE");
  command
      ->add_option(
          "--robots", a.robots,
          "Folder with robots, FOLDER/NAME/robot.urdf or FOLDER/NAME.urdf; may be repeated, the first folder that has a "
          "robot counts; default: models/robots")
      ->allow_extra_args(false)
      ->type_name("FOLDER");
  add_unphysical(*command, a.unphysical);
  command->add_option("--threads", a.threads, "Threads of an optimisation (default: one per core; of a worker: one)")
      ->check(CLI::Range(1, 255))
      ->type_name("N");
  command->add_flag("--list-robots", a.list_robots, "List the robots that can be named, and which data each has");
  command->add_flag("--worker", a.worker, "Answer requests of queues, one per line on stdin, see docs/services.md");
  command->callback([&chosen, all, command] {
    all->robot_given = command->count("--robot") > 0;
    chosen = [all] { return ask(*all); };
  });
}

}  // namespace cotwin::master
