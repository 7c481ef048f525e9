#include "components/services/json/control/tasks.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "components/services/json/control/control.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMost = 100000;

std::string word_of(const Json& request, const char* name) {
  return request.is_object() && request.contains(name) && request[name].is_string() ? request[name].get<std::string>() : "";
}

/// A URDF beside the file of tasks gets its path.
void beside(Json& request, const fs::path& folder) {
  const std::string robot = word_of(request, "robot");
  std::error_code none;
  if (const fs::path file = folder / robot; robot.ends_with(".urdf") && fs::is_regular_file(file, none))
    request["robot"] = file.string();
}

Task task_of(Json request, const std::string& name, const TaskDefaults& defaults) {
  Task task;
  task.name = name;
  if (request.is_object()) {
    if (const std::string own = word_of(request, "name"); !own.empty()) task.name = own;
    request.erase("name");
    if (!defaults.require.empty() && (!request.contains("require") || request["require"] == "amber"))
      request["require"] = defaults.require;  // the stricter one
    Json& members = is_chain(request) ? request["defaults"] : request;
    if (members.is_null() || members.is_object()) {
      if (!members.contains("robot")) members["robot"] = defaults.robot;
      if (!members.contains("detail") && !defaults.detail.empty()) members["detail"] = defaults.detail;
      if (!members.contains("detail") && !request.contains("audience") && defaults.brief) members["detail"] = "verdict";
      task.robot = word_of(members, "robot");
    }
    beside(members, defaults.folder);
    if (is_chain(request) && request["steps"].is_array())
      for (Json& step : request["steps"]) beside(step, defaults.folder);
  }
  task.service = is_chain(request) ? "chain" : word_of(request, "service");
  task.request = request.dump();
  return task;
}

constexpr std::string_view kOfChains[] = {"steps", "defaults", "audience", "require", "name"};

/// What a library says of a chain, in the defaults of its steps; those of the chain itself count.
void into_defaults(Json& chain) {
  Json members = Json::object(), own = Json::object();
  for (auto& [name, value] : chain.items()) (std::ranges::count(kOfChains, name) > 0 ? own : members)[name] = value;
  if (own.contains("defaults") && own["defaults"].is_object()) members.update(own["defaults"]);
  own["defaults"] = members;
  chain = std::move(own);
}

/// The members of a robot in a library: its name alone or an object.
Json robot_members(const Json& robot, const std::string& place) {
  if (robot.is_string()) return {{"robot", robot}};
  if (robot.is_object() && robot.contains("robot")) return robot;
  throw Error(place, "is neither the name of a robot nor an object with the member robot, expected one of them");
}

void cross(const Json& library, const std::string& place, const TaskDefaults& defaults, std::vector<Task>& tasks) {
  for (const auto& [name, value] : library.items())
    if (name != "robots" && name != "tasks" && name != "defaults")
      throw Error(place + ": /" + name.substr(0, 40), "is an unknown member, expected robots, tasks or defaults");
  if (!library.contains("tasks")) throw Error(place + ": /tasks", "is missing, expected an array of tasks");
  const Json common = library.value("defaults", Json::object());
  if (!common.is_object()) throw Error(place + ": /defaults", "is no object, expected members of requests");
  const Json all_robots = library.value("robots", Json::array({defaults.robot}));
  const Json& all_tasks = library["tasks"];
  if (!all_tasks.is_array()) throw Error(place + ": /tasks", "is no array, expected tasks");
  if (!all_robots.is_array()) throw Error(place + ": /robots", "is no array, expected robots");
  for (std::size_t k = 0; k < all_tasks.size(); ++k) {
    const std::string at = place + ": /tasks/" + std::to_string(k);
    const Json& task = all_tasks[k];
    const std::string number = std::to_string(k + 1);
    if (!task.is_object()) {
      tasks.push_back(task_of(task, number, defaults));
      continue;
    }
    Json robots = task.value("robots", all_robots);
    if (task.contains("robot")) robots = Json::array({task["robot"]});
    if (!robots.is_array()) throw Error(at + "/robots", "is no array, expected robots");
    if (robots.empty()) {
      Task none = task_of(task, number, defaults);
      none.robot.clear();
      none.problem = problem(RequestError("/robots", "is empty, expected at least one robot"));
      tasks.push_back(std::move(none));
    }
    for (std::size_t i = 0; i < robots.size(); ++i) {
      Json request = common;
      request.update(task);
      request.erase("robots");
      Json own = robot_members(robots[i], at + "/robots/" + std::to_string(i));
      const std::string label = word_of(own, "name");
      own.erase("name");
      request.update(own);
      if (is_chain(request)) into_defaults(request);
      Task one = task_of(std::move(request), number, defaults);
      if (!label.empty()) one.robot = label;
      tasks.push_back(std::move(one));
      if (tasks.size() > kMost) throw Error(place, "has more than " + std::to_string(kMost) + " tasks, expected fewer");
    }
  }
}

/// Numbers, words and truth values of a reply by name, and its notes as one text.
void flatten(const Json& value, const std::string& name, std::vector<std::pair<std::string, Json>>& cells) {
  if (value.is_object()) {
    for (const auto& [member, own] : value.items()) flatten(own, name.empty() ? member : name + "." + member, cells);
  } else if (name == "notes") {
    std::string all;
    for (const Json& note : value) all += (all.empty() ? "" : "; ") + note.get<std::string>();
    cells.emplace_back(name, all);
  } else if (!value.is_array()) {
    cells.emplace_back(name, value);
  }
}

struct Table {
  std::vector<std::string> columns;
  std::vector<std::map<std::string, Json>> rows;
};

Table table_of(const std::vector<Row>& rows) {
  Table table;
  table.columns = {"task", "robot", "service"};
  bool problems = false;
  for (const Row& row : rows) {
    std::map<std::string, Json>& own = table.rows.emplace_back();
    own = {{"task", row.task.name}, {"robot", row.task.robot}, {"service", row.task.service}};
    if (!row.problem.empty()) {
      const Json problem = Json::parse(row.problem);
      const std::string pointer = word_of(problem, "pointer");
      own["problem"] = (pointer.empty() ? "" : pointer + ": ") + problem["detail"].get<std::string>();
      problems = true;
      continue;
    }
    std::vector<std::pair<std::string, Json>> cells;
    flatten(Json::parse(row.reply), "", cells);
    for (auto& [name, value] : cells) {
      if (std::ranges::find(table.columns, name) == table.columns.end()) table.columns.push_back(name);
      own[name] = std::move(value);
    }
  }
  if (problems) table.columns.emplace_back("problem");
  return table;
}

std::string cell(const Table& table, std::size_t row, const std::string& column, int digits) {
  const auto at = table.rows[row].find(column);
  if (at == table.rows[row].end() || at->second.is_null()) return "";
  const Json& value = at->second;
  if (value.is_string()) {
    std::string words = value.get<std::string>();
    if (digits > 0)  // of the aligned table
      std::ranges::replace_if(
          words, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; }, ' ');
    return words;
  }
  if (value.is_number_float()) {
    const double x = value.get<double>();
    return digits > 0 ? text::to_text(x, digits) : text::to_text(x);
  }
  return value.dump();
}

std::string quoted_name(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string all = "\"";
  for (const char c : text) all += c == '"' ? std::string("\"\"") : std::string(1, c);
  return all + "\"";
}

/// Characters of UTF-8.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(
      std::ranges::count_if(text, [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

}  // namespace

std::vector<Task> read_tasks(std::string_view text, const std::string& place, const TaskDefaults& defaults) {
  Json file;
  try {
    file = parse_json(text);
  } catch (const RequestError& e) {
    throw Error(place, e.pointer().empty() ? e.detail() : e.what());
  }
  std::vector<Task> tasks;
  const bool library = file.is_object() && !file.contains("service") && !is_chain(file) &&
                       (file.contains("robots") || file.contains("defaults"));
  if (library || (file.is_object() && file.contains("tasks"))) {
    cross(file, place, defaults, tasks);
  } else if (file.is_object()) {
    tasks.push_back(task_of(file, "1", defaults));
  } else if (file.is_array()) {
    if (file.size() > kMost) throw Error(place, "has more than " + std::to_string(kMost) + " tasks, expected fewer");
    for (std::size_t k = 0; k < file.size(); ++k) tasks.push_back(task_of(file[k], std::to_string(k + 1), defaults));
  } else {
    throw Error(place, "is neither an object nor an array, expected requests or a library of tasks");
  }
  if (tasks.empty()) throw Error(place, "has no tasks, expected at least one");
  return tasks;
}

std::string unmet(const Row& row) {
  const bool required = row.task.request.find("\"require\"") != std::string::npos;
  return row.reply.empty() || !required ? "" : Json::parse(row.reply)["verdict"].value("unmet", "");
}

std::vector<Row> ask_all(Robots& robots, const std::vector<Task>& tasks, const Context& context) {
  std::vector<Row> rows;
  for (const Task& task : tasks) {
    Row row{task, "", ""};
    try {
      if (task.problem.empty()) {
        row.reply = answer(robots, task.request, context);
        if (task.service.empty()) row.task.service = Json::parse(row.reply)["choice"]["service"];
      } else {
        row.problem = task.problem;
      }
    } catch (const std::exception& e) {
      row.problem = problem(e);
    }
    rows.push_back(std::move(row));
    if (context.progress) context.progress(static_cast<double>(rows.size()) / static_cast<double>(tasks.size()), task.name);
  }
  return rows;
}

std::string to_json(const std::vector<Row>& rows) {
  Json all = Json::array();
  for (const Row& row : rows) {
    Json one{{"task", row.task.name}, {"robot", row.task.robot}, {"service", row.task.service}};
    if (row.problem.empty())
      one["reply"] = Json::parse(row.reply);
    else
      one["problem"] = Json::parse(row.problem);
    all.push_back(one);
  }
  return all.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string to_text_table(const std::vector<Row>& rows) {
  const Table table = table_of(rows);
  std::vector<std::vector<std::string>> lines{table.columns};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    lines.emplace_back();
    for (const std::string& column : table.columns) lines.back().push_back(cell(table, i, column, 6));
  }
  std::string text;
  for (const auto& line : lines) {
    std::string own;
    for (std::size_t c = 0; c < line.size(); ++c) {
      std::size_t widest = 0;
      for (const auto& other : lines) widest = std::max(widest, width(other[c]));
      own += line[c] + std::string(widest - width(line[c]) + 2, ' ');
    }
    own.erase(own.find_last_not_of(' ') + 1);
    text += own + "\n";
  }
  return text;
}

std::string to_csv(const std::vector<Row>& rows) {
  const Table table = table_of(rows);
  std::string text;
  for (std::size_t c = 0; c < table.columns.size(); ++c) text += (c ? "," : "") + quoted_name(table.columns[c]);
  text += "\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t c = 0; c < table.columns.size(); ++c)
      text += (c ? "," : "") + quoted_name(cell(table, i, table.columns[c], 0));
    text += "\n";
  }
  return text;
}

}  // namespace cotwin::services
