// cotwin completion: candidates for the completion of command lines by a shell.
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <span>
#include <sstream>

#include "master/engine/wiring/members.h"
#include "master/program/commands/commands.h"
#include "master/scenario/scenario.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

// The program computes the candidates. bash splits the word at '=', ':' and '?' and replaces only the last part.
constexpr const char* kBash = R"(# bash completion of cotwin: source <(cotwin completion bash)
_cotwin() {
  local line=${COMP_LINE:0:COMP_POINT} candidate
  local word=${line##*[[:space:]]}
  local kept=${word%"${word##*[=:]}"}
  COMPREPLY=()
  while IFS= read -r candidate; do
    [[ $candidate == "$word"* ]] && COMPREPLY+=("${candidate#"$kept"}")
  done < <("${COMP_WORDS[0]}" completion candidates "$line" 2>/dev/null)
  [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *[=.?] ]] && compopt -o nospace
}
complete -o default -F _cotwin cotwin
)";

using Candidates = std::vector<std::string>;

/// Adds "name=value" for each value of a setting with listed values, else "name=".
void add_setting(Candidates& found, const std::string& name, const Setting& setting) {
  switch (setting.kind) {
    case Setting::Kind::kChoice:
      for (const std::string& choice : setting.choices) found.push_back(name + "=" + choice);
      return;
    case Setting::Kind::kBoolean:
      found.push_back(name + "=true");
      found.push_back(name + "=false");
      return;
    case Setting::Kind::kInteger:
    case Setting::Kind::kText:
      found.push_back(name + "=");
      return;
  }
}

/// Returns the candidates after --set for this scenario. For a component that cannot be built, these are its settings.
Candidates assignments(const fs::path& file) {
  const Scenario scenario = load_scenario(file);
  const std::vector<fs::path> folders = model_folders(scenario.folder);
  Candidates found;
  fmu::FmuStore fmus;
  for (const ComponentSpec& spec : scenario.components) {
    if (is_unit(spec)) {
      const std::string unit = parse_unit_source(spec.source).unit;
      for (const Setting& setting : settings_of(find_type(unit, units()))) {
        add_setting(found, spec.name + "." + setting.name, setting);
        add_setting(found, setting.name, setting);
      }
    }
    try {
      const Member member = load_member(spec, scenario, units(), folders, fmus);
      for (const Variable& v : member.variables()) {
        if (v.role != Role::kOutput || v.has_start) found.push_back(spec.name + "." + v.name + "=");
      }
    } catch (const Error&) {
      continue;
    }
  }
  std::ranges::sort(found);
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

/// Returns the sources of units or, after a '?', the settings of that unit.
Candidates sources(const std::string& word) {
  Candidates found;
  const std::size_t question = word.find('?');
  for (const UnitType& type : units()) {
    for (const std::string prefix : {"", "unit:"}) {
      const std::string source = prefix + type.name;
      if (question == std::string::npos) {
        found.push_back(source);
      } else if (word.substr(0, question) == source) {
        const std::string given =
            word.substr(0, std::max(question, word.find('&') == std::string::npos ? 0 : word.rfind('&')) + 1);
        for (const Setting& setting : settings_of(type)) add_setting(found, given + setting.name, setting);
      }
    }
  }
  return found;
}

/// The names of the robots in the model folders.
Candidates robots() {
  Candidates found;
  for (const fs::path& folder : model_folders({})) {
    std::error_code none;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder / "robots", none)) {
      if (fs::is_regular_file(entry.path() / "robot.urdf", none)) found.push_back(entry.path().filename().string());
    }
  }
  return found;
}

/// The signals of a recording.
Candidates signals_of(const fs::path& results) {
  Candidates found;
  std::error_code none;
  for (const fs::path& file : {results, results / "signals.csv", results / "signals.csv.part"}) {
    if (!fs::is_regular_file(file, none)) continue;
    const std::unique_ptr<csv::Source> recording = csv::open(file);
    for (const std::string& name : recording->names()) {
      const std::string variable = name.substr(0, name.rfind('['));
      if (found.empty() || found.back() != variable) found.push_back(variable);
    }
    break;
  }
  return found;
}

/// The words between braces in the description of an option's values, as CLI::IsMember writes them.
Candidates values_of(const CLI::Option& option) {
  Candidates found;
  const std::string type = option.get_type_name();
  const std::size_t open = type.find('{'), close = type.find('}');
  if (open == std::string::npos || close == std::string::npos) return found;
  for (const std::string_view word : text::split(std::string_view(type).substr(open + 1, close - open - 1), ','))
    found.emplace_back(word);
  return found;
}

/// The first existing file among the words.
std::optional<fs::path> file_among(std::span<const std::string> words) {
  std::error_code none;
  const auto file = std::ranges::find_if(words, [&](const std::string& w) { return fs::is_regular_file(w, none); });
  return file == words.end() ? std::nullopt : std::optional<fs::path>(*file);
}

Candidates candidates(const CLI::App& app, const std::string& line) {
  std::vector<std::string> words;
  std::istringstream in(line);
  for (std::string word; in >> word;) words.push_back(word);
  if (line.empty() || line.back() == ' ') words.emplace_back();
  Candidates found;
  const auto all = [](const CLI::App* a) { return a->get_subcommands([](const CLI::App*) { return true; }); };
  const auto names_of = [&](const CLI::App* a) {
    for (const CLI::App* command : all(a)) found.push_back(command->get_name());
    return found;
  };
  const auto find = [&](const CLI::App* a, const std::string& name) {
    const std::vector<const CLI::App*> commands = all(a);
    const auto named = std::ranges::find(commands, name, [](const CLI::App* c) { return c->get_name(); });
    return named == commands.end() ? nullptr : *named;
  };
  if (words.size() <= 2) return names_of(&app);
  const std::string &word = words.back(), &before = words[words.size() - 2];
  const CLI::App* command = find(&app, words[1]);
  if (command == nullptr) return found;
  if (!all(command).empty()) {
    if (words.size() == 3) return names_of(command);
    if (const CLI::App* part = find(command, words[2])) command = part;
  }
  if (before == "--set") {
    const auto file = file_among(std::span(words).subspan(2, words.size() - 4));
    return file ? assignments(*file) : found;
  }
  if (before == "--robot") return robots();
  if (before.starts_with('-')) {
    if (const CLI::Option* option = command->get_option_no_throw(before); option != nullptr && option->get_items_expected() > 0)
      return values_of(*option);
  }
  if (word.starts_with('-')) {
    for (const CLI::Option* option : command->get_options()) {
      for (const std::string& name : option->get_lnames()) found.push_back("--" + name);
    }
  } else if (words[1] == "describe" || (words[1] == "pack" && word.starts_with("unit:"))) {
    return sources(word);
  } else if (words[1] == "plot" && words.size() > 3) {
    return signals_of(words[2]);
  } else if (words.size() == 3) {
    for (const CLI::Option* option : command->get_options()) {
      if (option->nonpositional() || !found.empty()) continue;
      found = values_of(*option);
    }
  }
  return found;
}

}  // namespace

void add_completion(CLI::App& app, Chosen& chosen) {
  struct Arguments {
    std::string what, line;
  };
  const auto all = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("completion", "Write a shell script for the completion of command lines");
  command->add_option("SHELL", all->what, "bash; or 'candidates': list the completions of LINE")
      ->required()
      ->check(CLI::IsMember({"bash", "candidates"}));
  command->add_option("LINE", all->line, "Command line up to the cursor, for 'candidates'");
  command->callback([all, &app, &chosen] {
    chosen = [all, &app] {
      if (all->what == "bash") {
        std::cout << kBash;
      } else {
        for (const std::string& candidate : candidates(app, all->line)) std::cout << candidate << '\n';
      }
      return kExitDone;
    };
  });
}

}  // namespace cotwin::master
