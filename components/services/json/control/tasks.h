#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "components/services/json/json.h"

/// Libraries of tasks: robots × tasks in files that a person can write.
namespace cotwin::services {

/// A request with the name of its task.
struct Task {
  std::string name, robot, service;
  std::string request;       // JSON
  std::string problem = {};  // why it cannot be asked, a line of JSON
};

/// Reads a request, an array of requests, or
///   {"robots": ["lwr4", {"name": "elbow locked", "robot": "lwr4", "locked_q": {…}}],
///    "defaults": {members of every task},
///    "tasks": [{"name": "pick", "service": "energy", "from_q_deg": […], …, "robots": […]}]}
/// where each task is asked of each robot, or of its own `robots`. A task may itself be no object or lack members: it is then asked,
/// and refused. A "robot" that is the path of a URDF is relative to `folder`. Throws Error with `place` for text that is not JSON or has another form, and for more
/// than 100000 tasks.
struct TaskDefaults {
  std::string robot;   // of tasks that name none
  std::string detail;  // of tasks that have none; "": that of the services
  std::filesystem::path folder;
  bool brief = false;     // tasks without detail and audience have the verdict
  std::string require{};  // the light that each task requires at least; "": none
};
std::vector<Task> read_tasks(std::string_view text, const std::string& place, const TaskDefaults& defaults);

/// A task's answer: reply or problem, each one line of JSON.
struct Row {
  Task task;
  std::string reply, problem;
};
/// Why the light of the reply is worse than the task requires, or "".
std::string unmet(const Row& row);
/// Asks all. A task that cannot be answered does not end the others.
std::vector<Row> ask_all(Robots& robots, const std::vector<Task>& tasks, const Context& context = {});

/// [{"task", "robot", "service", "reply" or "problem"}], one line.
std::string to_json(const std::vector<Row>& rows);
/// A table of the numbers, words and truth values of the replies: columns task, robot, service, the members in the order in which they
/// first come ("limiting.joint" for members of members; arrays other than notes are left out), and the problem if there is any. Text is aligned, with
/// six digits; CSV (RFC 4180) has all digits.
std::string to_text_table(const std::vector<Row>& rows);
std::string to_csv(const std::vector<Row>& rows);

}  // namespace cotwin::services
